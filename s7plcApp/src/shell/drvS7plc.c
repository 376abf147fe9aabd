/* The face of the driver towards EPICS: driver entry, iocsh commands, and the C functions
 * of drvS7plc.h. What they do is in plcStation. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <callback.h>
#include <drvSup.h>
#include <epicsAtomic.h>
#include <epicsExit.h>
#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <epicsString.h>
#include <epicsVersion.h>
#include <errlog.h>
#include <initHooks.h>
#include <iocsh.h>

#include "drvS7plc.h"
#include "plcComplete.h"
#include "plcConfigure.h"
#include "plcDriver.h"
#include "plcOptions.h"
#include "plcScan.h"
#include "plcShow.h"
#include "plcStation.h"
#include "plcVersion.h"

#include <epicsExport.h>

/* --- C functions ------------------------------------------------------------------------*/

s7plcStation *s7plcOpen(char *PLCname)
{
    return PLCname ? plcStationFind(PLCname) : NULL;
}

/* True when the elements lie in a block of `size` bytes. */
static int fits(size_t size, size_t offset, size_t dlen, size_t nelem)
{
    return (dlen == 1 || dlen == 2 || dlen == 4 || dlen == 8) && offset <= size &&
           nelem <= (size - offset) / dlen;
}

int s7plcReadArray(s7plcStation *station, unsigned int offset, unsigned int dlen,
                   unsigned int nelem, void *pdata)
{
    size_t length = (size_t)dlen * nelem;
    char *bytes;
    int status;

    if (!station || !fits(plcStationInSize(station), offset, dlen, nelem))
        return S7PLC_BAD_PARAM;
    bytes = malloc(length + 1);
    if (!bytes)
        return S7PLC_BAD_PARAM;
    status = plcImageRead(plcStationInput(station), offset, length, bytes, NULL);
    if (status == 0)
        plcCopyElements(pdata, bytes, dlen, nelem, plcStationOrder(station));
    free(bytes);
    return status ? S7PLC_NO_CONN : S7PLC_OK;
}

int s7plcWriteMaskedArray(s7plcStation *station, unsigned int offset, unsigned int dlen,
                          unsigned int nelem, void *pdata, void *pmask)
{
    size_t length = (size_t)dlen * nelem;
    char reason[PLC_REASON_SIZE];
    char *bytes, *mask = NULL;
    unsigned int i;
    int status;

    if (!station || !fits(plcStationOutSize(station), offset, dlen, nelem))
        return S7PLC_BAD_PARAM;
    bytes = malloc(2 * length + 1);
    if (!bytes)
        return S7PLC_BAD_PARAM;
    plcCopyElements(bytes, pdata, dlen, nelem, plcStationOrder(station));
    if (pmask) {
        mask = bytes + length;
        for (i = 0; i < nelem; i++)
            plcCopyElements(mask + i * dlen, pmask, dlen, 1, plcStationOrder(station));
    }
    status = plcStationWrite(station, offset, length, bytes, mask, reason);
    free(bytes);
    return status ? S7PLC_REFUSED : reason[0] ? S7PLC_NO_CONN : S7PLC_OK;
}

IOSCANPVT s7plcGetInScanPvt(s7plcStation *station)
{
    return plcStationInScan(station, 0, plcStationInSize(station), PLC_SCAN_ANY_PRIO, 0);
}

IOSCANPVT s7plcGetOutScanPvt(s7plcStation *station)
{
    return plcStationOutScan(station, PLC_SCAN_ANY_PRIO, 0);
}

int s7plcConfigure(char *PLCname, char *IPaddr, unsigned int port, unsigned int inSize,
                   unsigned int outSize, unsigned int bigEndian,
                   unsigned int recvTimeout, unsigned int sendInterval)
{
    char numbers[6][12];
    const unsigned int values[6] = {port, inSize, outSize, bigEndian, recvTimeout,
                                    sendInterval};
    const char *args[8] = {PLCname, IPaddr};
    int i;

    for (i = 0; i < 6; i++) {
        sprintf(numbers[i], "%d", (int)values[i]);
        args[i + 2] = numbers[i];
    }
    return plcConfigure("s7plcConfigure", args, &plcSingle, NULL) ? 0 : -1;
}

/* --- iocsh ------------------------------------------------------------------------------*/

/* A command with a wrong argument sets iocsh's error: `on error halt` ends st.cmd there.
 * Numbers are strings here, so that a missing or mistyped one gets a message of ours. */
static const iocshArg configureArg0 = {"PLCname", iocshArgString};
static const iocshArg configureArg1 = {"IPaddr", iocshArgString};
static const iocshArg configureArg2 = {"port", iocshArgString};
static const iocshArg configureArg3 = {"inSize [bytes]", iocshArgString};
static const iocshArg configureArg4 = {"outSize [bytes]", iocshArgString};
static const iocshArg configureArg5 = {"bigEndian [0|1]", iocshArgString};
static const iocshArg configureArg6 = {"recvTimeout [ms]", iocshArgString};
static const iocshArg configureArg7 = {"sendInterval [ms]", iocshArgString};
static const iocshArg *const configureArgs[] = {
    &configureArg0, &configureArg1, &configureArg2, &configureArg3,
    &configureArg4, &configureArg5, &configureArg6, &configureArg7};

static void configureCall(const iocshArgBuf *args)
{
    const char *text[8];
    int i;

    for (i = 0; i < 8; i++)
        text[i] = args[i].sval;
    iocshSetError(plcConfigure("s7plcConfigure", text, &plcSingle, NULL) ? 0 : -1);
}

static const iocshArg stationArg = {"PLCname (none: all)", PLC_ARG_STATION};
static const iocshArg oneStationArg = {"PLCname", PLC_ARG_STATION};
static const iocshArg keyArg = {"option", iocshArgString};
static const iocshArg valueArg = {"value", iocshArgString};
static const iocshArg levelArg = {"level [1]", iocshArgString};

/* The station a command is about. Returns NULL after an error line. */
static plcStation *needStation(const char *command, const char *name)
{
    plcStation *station = name ? plcStationFind(name) : NULL;
    char names[400];

    if (!station) {
        plcStationNames(names, sizeof(names));
        fprintf(stderr, "%s: no PLC \"%.60s\"; configured: %s\n", command, name ? name : "",
                names[0] ? names : "none");
        iocshSetError(-1);
    }
    return station;
}

static const iocshArg detailArg = {"type or format", iocshArgString};
/* iocsh takes a comma in the value as the end of an argument: `alive, 4,UINT16` */
static const iocshArg *const optionArgs[] = {&oneStationArg, &keyArg, &valueArg, &detailArg};

static void optionCall(const iocshArgBuf *args)
{
    const char *name = args[0].sval, *key = args[1].sval, *value = args[2].sval;
    plcStation *station;
    char error[400], joined[200];

    if (!name) {
        printf("Options of a PLC, their defaults, and what they do:\n");
        plcOptionsPrint(NULL, stdout);
        return;
    }
    station = needStation("s7plcSetOption", name);
    if (!station)
        return;
    if (!key) {
        plcStationOptions(station, stdout);
        return;
    }
    if (args[3].sval) {
        epicsSnprintf(joined, sizeof(joined), "%s,%s", value, args[3].sval);
        value = joined;
    }
    if (plcStationSetOption(station, key, value ? value : "", error, sizeof(error)))
        iocshSetError(fprintf(stderr, "s7plcSetOption %s: %s\n", name, error));
}

typedef struct reportArgs {
    FILE *file;
    epicsInt32 level;
} reportArgs;

static void reportOne(plcStation *station, void *arg)
{
    reportArgs *r = arg;

    plcStationReport(station, r->file, r->level);
    if (r->level >= 3) {
        plcShow(station, "in", r->file);
        plcShow(station, "out", r->file);
    }
}

static void reportAll(reportArgs *r)
{
    fprintf(r->file, "plclink %s\n", s7plcVersion());
    plcStationEach(reportOne, r);
}

static void resetOne(plcStation *station, void *arg)
{
    (void)arg;
    plcStationStatsReset(station);
}

static const iocshArg *const reportArgList[] = {&stationArg, &levelArg};

static void reportCall(const iocshArgBuf *args)
{
    reportArgs r = {stdout, 1};
    plcStation *station;

    if (args[1].sval && (epicsParseInt32(args[1].sval, &r.level, 0, NULL) || r.level < 0))
        iocshSetError(fprintf(stderr, "s7plcReport: level \"%.40s\"; allowed: 0 to 3\n",
                              args[1].sval));
    else if (!args[0].sval)
        reportAll(&r);
    else if ((station = needStation("s7plcReport", args[0].sval)))
        reportOne(station, &r);
}

static const iocshArg *const stationArgs[] = {&stationArg};

static void resetCall(const iocshArgBuf *args)
{
    plcStation *station;

    if (!args[0].sval)
        plcStationEach(resetOne, NULL);
    else if ((station = needStation("s7plcStatsReset", args[0].sval)))
        plcStationStatsReset(station);
}

static const iocshArg whatArg = {"in|out|records", iocshArgString};
static const iocshArg *const showArgs[] = {&oneStationArg, &whatArg};

static void showCall(const iocshArgBuf *args)
{
    plcStation *station = needStation("s7plcShow", args[0].sval);
    const char *what = args[1].sval;

    if (!station)
        return;
    if (!what) {
        plcShow(station, "in", stdout);
        plcShow(station, "out", stdout);
    } else if (plcShow(station, what, stdout)) {
        iocshSetError(
            fprintf(stderr, "s7plcShow: \"%.60s\"; allowed: in, out, records\n", what));
    }
}

static const iocshArg *const sendArgs[] = {&oneStationArg};

static void sendCall(const iocshArgBuf *args)
{
    plcStation *station = needStation("s7plcSend", args[0].sval);

    if (!station)
        return;
    if (!plcStationOutSize(station)) {
        iocshSetError(
            fprintf(stderr, "s7plcSend: PLC \"%s\" has outSize 0\n", args[0].sval));
        return;
    }
    plcStationSend(station);
}

static const iocshArg fileArg = {"file.ptr", PLC_ARG_PATH};
static const iocshArg *const tableArgs[] = {&oneStationArg, &fileArg};

static int takeTable(plcStation *station, const char *name, const char *path)
{
    FILE *file = path ? fopen(path, "r") : NULL;
    plcPointers *table;
    char error[300];

    if (!file)
        return fprintf(stderr, "s7plcTables %s: cannot read \"%.200s\": %s\n", name,
                       path ? path : "", path ? strerror(errno) : "no file given");
    table = plcPointersRead(file, error, sizeof(error));
    fclose(file);
    if (!table)
        return fprintf(stderr, "s7plcTables %s: %s: %s\n", name, path, error);
    if (plcStationSetTable(station, table)) {
        plcPointersFree(table);
        return fprintf(stderr, "s7plcTables %s: only before iocInit\n", name);
    }
    return 0;
}

static void tableCall(const iocshArgBuf *args)
{
    plcStation *station = needStation("s7plcTables", args[0].sval);

    if (station && takeTable(station, args[0].sval, args[1].sval))
        iocshSetError(-1);
}

static const iocshFuncDef configureDef = {
    "s7plcConfigure", 8, configureArgs
#ifdef IOCSHFUNCDEF_HAS_USAGE
    ,
    "Makes a station: an S7 PLC with a send/receive connection. Before iocInit. recvTimeout:\n"
    "ms from block to block (0: 2000); sendInterval: ms between two blocks (0: 1000).\n"
    "  s7plcConfigure PLC,192.168.0.10,2000,96,112,1,2000,100\n"
#endif
};
static const iocshFuncDef optionDef = {
    "s7plcSetOption", 4, optionArgs
#ifdef IOCSHFUNCDEF_HAS_USAGE
    ,
    "Sets an option of a PLC. Without value: shows its options. Without PLC: all keys.\n"
    "  s7plcSetOption PLC heartbeat 500\n"
#endif
};
static const iocshFuncDef tableDef = {
    "s7plcTables", 2, tableArgs
#ifdef IOCSHFUNCDEF_HAS_USAGE
    ,
    "The table of pointers that a PLC with the option map works with.\n"
    "  s7plcTables PLC plant.ptr\n"
#endif
};
static const iocshFuncDef reportDef = {
    "s7plcReport", 2, reportArgList
#ifdef IOCSHFUNCDEF_HAS_USAGE
    ,
    "State and statistics of one or all PLCs. level 0: a line, 1: more, 2: histograms,\n"
    "3: the blocks with their records.\n"
    "  s7plcReport PLC 2\n"
#endif
};
static const iocshFuncDef resetDef = {
    "s7plcStatsReset", 1, stationArgs
#ifdef IOCSHFUNCDEF_HAS_USAGE
    ,
    "Sets the statistics of one or all PLCs to zero.\n"
    "  s7plcStatsReset PLC\n"
#endif
};
static const iocshFuncDef showDef = {
    "s7plcShow", 2, showArgs
#ifdef IOCSHFUNCDEF_HAS_USAGE
    ,
    "Bytes of the input or output block with the records beside them, who overlaps whom,\n"
    "and which bytes no record uses. Without the second argument: both blocks.\n"
    "  s7plcShow PLC in\n"
#endif
};
static const iocshFuncDef sendDef = {
    "s7plcSend", 1, sendArgs
#ifdef IOCSHFUNCDEF_HAS_USAGE
    ,
    "Sends the output block of a PLC now, changed or not.\n"
    "  s7plcSend PLC\n"
#endif
};

void plcDriverRegister(void)
{
    iocshRegister(&configureDef, configureCall);
    iocshRegister(&optionDef, optionCall);
    iocshRegister(&tableDef, tableCall);
    iocshRegister(&reportDef, reportCall);
    iocshRegister(&resetDef, resetCall);
    iocshRegister(&sendDef, sendCall);
    iocshRegister(&showDef, showCall);
    plcCompleteInstall();
}

/* --- Driver entry -----------------------------------------------------------------------*/

static int hooked; /* an IOC that has ended has dropped its hooks */

/* The end comes while there still are records. Base announces it since 7.0.4; before, the exit
 * handler that was registered last runs first: Base registers its own in initDatabase. */
#if EPICS_VERSION_INT >= VERSION_INT(7, 0, 4, 0)
#define HAVE_SHUTDOWN_HOOK
#else
static void stop(void *arg)
{
    (void)arg;
    hooked = 0;
    plcStationsStop();
}
#endif

/* A hook of another module that fails (that of PVA, where the machine has no network) ends iocInit
 * before ours is called. What PINI=RUNNING does is over by then. */
#define LATE 20 /* s */

static int runs; /* atomic: all hooks were called */
static epicsCallback lateCallback;

static void runLate(epicsCallback *callback)
{
    (void)callback;
    if (epicsAtomicGetIntT(&runs))
        return;
    errlogSevPrintf(errlogMajor,
                    "s7plc: another module has broken off iocInit (see its message above): "
                    "outputs begin %d s later\n", LATE);
    plcStationsRun();
}

static void hook(initHookState state)
{
    if (state == initHookAfterInitDatabase) {
        plcStationsReady();
#ifndef HAVE_SHUTDOWN_HOOK
        epicsAtExit(stop, NULL);
#endif
    } else if (state == initHookAfterDatabaseRunning) {
        epicsAtomicSetIntT(&runs, 0);
        memset(&lateCallback, 0, sizeof(lateCallback)); /* its timer ended with the IOC before */
        callbackSetCallback(runLate, &lateCallback);
        callbackSetPriority(priorityLow, &lateCallback);
        callbackRequestDelayed(&lateCallback, LATE);
    } else if (state == initHookAfterIocRunning) {
        epicsAtomicSetIntT(&runs, 1);
        plcStationsRun();
#ifndef HAVE_SHUTDOWN_HOOK
        hooked = 0; /* nobody says when the IOC ends: the next one registers again */
#else
    } else if (state == initHookAtShutdown) {
        hooked = 0;
        callbackCancelDelayed(&lateCallback);
        plcStationsStop();
#endif
    }
}

void plcDriverInit(void)
{
    if (!hooked)
        initHookRegister(hook);
    hooked = 1;
    plcStationsStart();
}

static long init(void)
{
    printf("s7plc: plclink %s\n", s7plcVersion());
    plcDriverInit();
    return 0;
}

/* dbior */
static long report(int level)
{
    reportArgs r = {stdout, level};

    reportAll(&r);
    return 0;
}

static drvet s7plc = {2, (DRVSUPFUN)report, (DRVSUPFUN)init};

epicsExportAddress(drvet, s7plc);
epicsExportAddress(int, s7plcDebug);

static void s7plcRegister(void)
{
    plcDriverRegister();
}
epicsExportRegistrar(s7plcRegister);
