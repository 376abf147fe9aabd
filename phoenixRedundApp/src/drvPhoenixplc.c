/* The command phoenixplcConfigure: the paper's nine arguments, from text to a station. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <drvSup.h>
#include <epicsStdlib.h>
#include <errlog.h>
#include <initHooks.h>
#include <iocsh.h>

#include "phoenixPair.h"
#include "phoenixRedund.h"
#include "plcConfigure.h"

#include <epicsExport.h> /* last */

/* What makes no sense for a pair, beside what makes none for any PLC. */
static int refusePair(const char *command, const char *name, const char *address,
                      const char *inSize)
{
    size_t length = strcspn(address, ",");
    const char *error = NULL;

    if (!address[0])
        error =
            "a pair needs an address: of FIRST (SECOND is IPaddr+1), or \"FIRST,SECOND\"";
    else if (address[length] && strlen(address) == 2 * length + 1 &&
             strncmp(address, address + length + 1, length) == 0)
        error = "FIRST and SECOND have the same address; allowed: two different ones";
    else if (inSize && strtol(inSize, NULL, 0) == 0)
        error =
            "inSize=0; allowed with redundancy=1: 1 to 16777216 bytes: who sends blocks "
            "is PRIMARY";
    if (error)
        errlogSevPrintf(errlogMajor, "%s %s: %s\n", command, name, error);
    return error != NULL;
}

int phoenixplcConfigure(const char *const args[9])
{
    static const char command[] = "phoenixplcConfigure";
    const char *name = args[0] ? args[0] : "";
    epicsInt32 redundancy = 0;
    phoenixPair *pair;

    if (args[8] && (epicsParseInt32(args[8], &redundancy, 0, NULL) || redundancy < 0 ||
                    redundancy > 1)) {
        errlogSevPrintf(errlogMajor,
                        "%s %s: redundancy=%s; allowed: 0 (one PLC) or 1 "
                        "(FIRST at IPaddr, SECOND at IPaddr+1)\n",
                        command, name, args[8]);
        return -1;
    }
    if (!redundancy)
        return plcConfigure(command, args, &plcSingle, NULL) ? 0 : -1;
    if (plcStationFind(name)) /* plcConfigure refuses it in its own words */
        return plcConfigure(command, args, &phoenixPolicy, NULL) ? 0 : -1;
    if (refusePair(command, name, args[1] ? args[1] : "", args[3]))
        return -1;
    pair = phoenixPairCreate(name);
    if (plcConfigure(command, args, &phoenixPolicy, pair))
        return 0;
    phoenixPairDestroy(pair);
    return -1;
}

/* Numbers are strings here, so that a missing or mistyped one gets a message of ours. */
static const iocshArg arg0 = {"PLCname", iocshArgString};
static const iocshArg arg1 = {"IPaddr[,IPaddr of SECOND]", iocshArgString};
static const iocshArg arg2 = {"IPport", iocshArgString};
static const iocshArg arg3 = {"inSize [bytes]", iocshArgString};
static const iocshArg arg4 = {"outSize [bytes]", iocshArgString};
static const iocshArg arg5 = {"bigEndian [0|1]", iocshArgString};
static const iocshArg arg6 = {"recvTimeout [ms]", iocshArgString};
static const iocshArg arg7 = {"sendInterval [ms]", iocshArgString};
static const iocshArg arg8 = {"redundancy [0|1]", iocshArgString};
static const iocshArg *const configureArgs[] = {&arg0, &arg1, &arg2, &arg3, &arg4,
                                                &arg5, &arg6, &arg7, &arg8};
static const iocshFuncDef configureDef = {
    "phoenixplcConfigure", 9, configureArgs
#ifdef IOCSHFUNCDEF_HAS_USAGE
    ,
    "Makes a station: one PLC (redundancy=0) or a redundant pair of PLCs (1), FIRST at\n"
    "IPaddr and SECOND at IPaddr+1, or \"a,b\".\n"
    "  phoenixplcConfigure PLC-A,192.168.0.10,2000,96,112,1,2000,100,1\n"
#endif
};

static void configureCall(const iocshArgBuf *args)
{
    const char *text[9];
    int i;

    for (i = 0; i < 9; i++)
        text[i] = args[i].sval;
    iocshSetError(phoenixplcConfigure(text));
}

static void phoenixplcRegister(void)
{
    phoenixPairInit();
    iocshRegister(&configureDef, configureCall);
}

/* --- Driver entry ------------------------------------------------------------------- */

static void hook(initHookState state)
{
    if (state == initHookAfterIocRunning)
        phoenixPairsRun();
}

static long init(void)
{
    initHookRegister(hook); /* each IOC anew: an ended one has dropped its hooks */
    return 0;
}

static void reportPair(plcStation *station, void *level)
{
    if (phoenixPairFind(plcStationName(station)))
        plcStationReport(station, stdout, *(int *)level);
}

/* dbior: the pairs only; the driver s7plc reports all stations. */
static long report(int level)
{
    plcStationEach(reportPair, &level);
    return 0;
}

static drvet phoenixplc = {2, (DRVSUPFUN)report, (DRVSUPFUN)init};

epicsExportAddress(drvet, phoenixplc);
epicsExportRegistrar(phoenixplcRegister);
