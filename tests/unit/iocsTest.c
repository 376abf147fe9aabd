/* Several IOCs one after the other in one process, as test programs of a site have them: each
 * configures its PLCs anew, single ones, pairs and asyn ports, and knows nothing of the ones
 * before. And how an IOC ends. */
#include <stdio.h>
#include <string.h>

#include <dbAccess.h>
#include <dbStaticLib.h>
#include <dbUnitTest.h>
#include <epicsStdio.h>
#include <epicsUnitTest.h>
#include <epicsVersion.h>
#include <initHooks.h>
#include <testMain.h>

#include "drvS7plc.h"
#include "phoenixRedund.h"
#include "plcStation.h"
#include "testTools.h"
#ifdef WITH_ASYN
#include <asynDriver.h>

#include "drvAsynS7plc.h"
#endif

enum { iocs = 3, outSize = 4 };

int iocsTest_registerRecordDeviceDriver(struct dbBase *base);

static int plc, listener; /* our end of the connection to PLC; who listens for it */
static int closedInTime;  /* the connection was closed while the records were there */

static void hook(initHookState state)
{
#if EPICS_VERSION_INT >= VERSION_INT(7, 0, 4, 0)
    if (state == initHookAfterCloseLinks)
        closedInTime = toolClosed(plc);
#endif
}

static void load(const char *type, const char *name, const char *dtyp, const char *link,
                 const char *text)
{
    DBENTRY entry;

    dbInitEntry(pdbbase, &entry);
    if (dbFindRecordType(&entry, type) || dbCreateRecord(&entry, name) ||
        dbFindField(&entry, "DTYP") || dbPutString(&entry, dtyp) ||
        dbFindField(&entry, link) || dbPutString(&entry, text))
        testAbort("no record %s", name);
    if (strcmp(link, "INP") == 0 &&
        (dbFindField(&entry, "SCAN") || dbPutString(&entry, "I/O Intr")))
        testAbort("no I/O Intr for %s", name);
    dbFinishEntry(&entry);
}

static epicsInt32 value(const char *name)
{
    DBADDR address;
    epicsInt32 number = -1;

    if (dbNameToAddr(name, &address) || dbGetField(&address, DBR_LONG, &number, NULL, NULL, NULL))
        testAbort("no record %s", name);
    return number;
}

static int severity(const char *record)
{
    char name[60];

    epicsSnprintf(name, sizeof(name), "%s.SEVR", record);
    return value(name);
}

static void configure(int i, int port)
{
    char text[12];
    const char *pair[9] = {"PAIR", "127.0.0.2,127.0.0.3", text, "8", "8", "1", "500", "50", "1"};
    plcStation *s;

    testOk(s7plcConfigure("PLC", "127.0.0.1", port, 4u * (i + 1), outSize, 1, 60000, 10) == 0,
           "IOC %d: PLC is configured", i);
    s = plcStationFind("PLC");
    testOk(s && plcStationInSize(s) == 4u * (i + 1), "IOC %d: as this IOC says", i);
    sprintf(text, "%d", toolFreePort());
    testOk(phoenixplcConfigure(pair) == 0, "IOC %d: a pair is configured", i);
#ifdef WITH_ASYN
    if (i == 0)
        pasynManager->registerPort("TAKEN", 0, 1, 0, 0);
    testOk(drvAsynS7plcConfigure("TAKEN", "PLC", NULL) == -1,
           "IOC %d: no asyn port of a name that another driver has", i);
    testOk(drvAsynS7plcConfigure("PORT", "PLC", NULL) == 0, "IOC %d: an asyn port", i);
    testOk(drvAsynS7plcConfigure("PORT", "PAIR", NULL) == -1,
           "IOC %d: none of a name that is in use", i);
#else
    testSkip(3, "without asyn");
#endif
}

static void records(int i)
{
    char place[40];

    sprintf(place, "@PLC/%d T=INT32", 4 * i);
    load("longin", "in", "S7plc", "INP", place);
    load("longout", "out", "S7plc", "OUT", "@PLC/0 T=INT32 R=0");
    load("bi", "up", "S7plc stat", "INP", "@PLC");
    load("bi", "pairUp", "S7plc stat", "INP", "@PAIR");
    load("mbbi", "backup", "phoenixplc", "INP", "@PAIR");
#ifdef WITH_ASYN
    sprintf(place, "@asyn(PORT)%d T=INT32", 4 * i);
    load("longin", "asynIn", "asynInt32", "INP", place);
#endif
}

static void sendBlock(int i, int number)
{
    unsigned char block[4 * iocs] = {0};

    block[4 * i + 3] = (unsigned char)number;
    toolSend(plc, block, 4u * (i + 1));
}

static void run(int i)
{
    int port = 0, number = 10 * (i + 1);
    unsigned char block[outSize];

    testDiag("IOC %d", i);
    listener = toolListen(&port);
    testdbPrepare();
    testdbReadDatabase("iocsTest.dbd", NULL, NULL);
    iocsTest_registerRecordDeviceDriver(pdbbase);
    configure(i, port);
    records(i);
    initHookRegister(hook);
    closedInTime = 0;
    testIocInitOk();
    plc = toolAccept(listener);
    sendBlock(i, number);
    WAIT_FOR(value("in") == number && value("out") == (i ? 0 : number) && value("up"));
    testOk(value("in") == number && severity("in") == 0, "IOC %d: a block comes in", i);
    testOk(value("up") == 1, "IOC %d: the PLC is connected", i);
    WAIT_FOR(value("backup") == 5);
    testOk(value("pairUp") == 0 && value("backup") == 5, "IOC %d: the pair is not", i);
    testdbPutFieldOk("out", DBR_LONG, 77 + i);
    WAIT_FOR(toolReceive(plc, block, outSize) < outSize || block[3] == 77 + i);
    testOk(block[3] == 77 + i, "IOC %d: a put goes out", i);
#ifdef WITH_ASYN
    WAIT_FOR(value("asynIn") == number);
    testOk(value("asynIn") == number, "IOC %d: a block comes in by asyn", i);
#else
    testSkip(1, "without asyn");
#endif
    testIocShutdownOk();
#if EPICS_VERSION_INT >= VERSION_INT(7, 0, 4, 0)
    testOk(closedInTime, "IOC %d: it leaves its PLC before its records go", i);
#else
    testSkip(1, "this Base does not say when");
    plcStationsStop();
#endif
    testdbCleanup();
    toolClose(plc);
    toolClose(listener);
    testOk(!s7plcOpen("PLC"), "IOC %d: nobody finds its PLC any more", i);
}

/* A function of its own: so the stacks of the thread sanitizer have one that its suppressions name. */
__attribute__((noinline)) static void runAll(void)
{
    int i;

    for (i = 0; i < iocs; i++)
        run(i);
    testdbPrepare();
    testdbReadDatabase("iocsTest.dbd", NULL, NULL);
    iocsTest_registerRecordDeviceDriver(pdbbase);
    testIocInitOk();
    testOk(!s7plcOpen("PLC"), "an IOC without PLCs has none");
    testIocShutdownOk();
    testdbCleanup();
    plcStationsDestroy();
}

MAIN(iocsTest)
{
    testPlan(14 * iocs + 1);
    runAll();
    return testDone();
}
