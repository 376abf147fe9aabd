/* The command drvAsynS7plcConfigure: a station as an asyn port. */
#include <stdio.h>

#include <drvSup.h>
#include <epicsStdlib.h>
#include <errlog.h>
#include <iocsh.h>

#include "drvAsynS7plc.h"
#include "plcAsynPort.h"

#include <epicsExport.h> /* last */

int drvAsynS7plcConfigure(const char *port, const char *PLCname, const char *initialWait)
{
    double wait = 0;

    if (initialWait && initialWait[0] &&
        (epicsParseDouble(initialWait, &wait, NULL) || !(wait >= 0 && wait <= 60000))) {
        errlogSevPrintf(errlogMajor,
                        "drvAsynS7plcConfigure %s: initialWait=%s; allowed: 0 "
                        "to 60000 ms\n",
                        port ? port : "", initialWait);
        return -1;
    }
    return plcAsynPortCreate(port ? port : "", PLCname ? PLCname : "", wait);
}

static const iocshArg arg0 = {"port", iocshArgString};
static const iocshArg arg1 = {"PLCname", iocshArgString};
static const iocshArg arg2 = {"initialWait [ms]", iocshArgString};
static const iocshArg *const args[] = {&arg0, &arg1, &arg2};
static const iocshFuncDef configureDef = {
    "drvAsynS7plcConfigure", 3, args
#ifdef IOCSHFUNCDEF_HAS_USAGE
    ,
    "Makes an asyn port of a PLC that is configured. initialWait: how long iocInit may\n"
    "wait for the first block, for outputs whose value the PLC shows (default 0).\n"
    "  drvAsynS7plcConfigure PLC-A-asyn,PLC-A\n"
#endif
};

static void configureCall(const iocshArgBuf *values)
{
    iocshSetError(
        drvAsynS7plcConfigure(values[0].sval, values[1].sval, values[2].sval));
}

static void s7plcAsynRegister(void)
{
    iocshRegister(&configureDef, configureCall);
}

/* --- Driver entry ----------------------------------------------------------------- */

static long init(void)
{
    plcAsynPortsBegin();
    return 0;
}

/* dbior */
static long report(int level)
{
    (void)level; /* asynReport says more */
    plcAsynPortsReport(stdout);
    return 0;
}

static drvet s7plcAsyn = {2, (DRVSUPFUN)report, (DRVSUPFUN)init};

epicsExportAddress(drvet, s7plcAsyn);
epicsExportRegistrar(s7plcAsynRegister);
