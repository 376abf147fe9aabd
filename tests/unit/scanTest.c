/* Scan passes, with real records in a real IOC's callback threads. */
#include <string.h>

#include <callback.h>
#include <dbAccess.h>
#include <dbUnitTest.h>
#include <devSup.h>
#include <epicsAtomic.h>
#include <epicsEvent.h>
#include <epicsMutex.h>
#include <epicsStdio.h>
#include <epicsThread.h>
#include <epicsTime.h>
#include <errlog.h>
#include <iocInit.h>
#include <longinRecord.h>
#include <testMain.h>

#include "plcScan.h"
#include "testTools.h"

#include <epicsExport.h>

#define BLOCK 203
#define NO_HANG 60.0 /* s; only a test that would hang for ever waits so long */

void scanTest_registerRecordDeviceDriver(struct dbBase *);

/* A scan and what its done() saw. */
typedef struct probe {
    plcScan *scan;
    epicsEventId over;
    epicsMutexId lock; /* of the rest */
    int passes;
    epicsUInt64 requested;
} probe;

static probe all, range, own, large, any;

static void done(void *pvt, epicsUInt64 requested)
{
    probe *p = pvt;

    epicsMutexMustLock(p->lock);
    p->requested = requested;
    p->passes++;
    epicsMutexUnlock(p->lock);
    epicsEventMustTrigger(p->over);
}

static int passesOf(probe *p)
{
    int passes;

    epicsMutexMustLock(p->lock);
    passes = p->passes;
    epicsMutexUnlock(p->lock);
    return passes;
}

/* Waits until as many passes are over, since the start of the test. */
static int waitPasses(probe *p, int passes)
{
    while (passesOf(p) < passes) {
        if (epicsEventWaitWithTimeout(p->over, NO_HANG) != epicsEventWaitOK)
            return 0;
    }
    return passesOf(p) == passes;
}

static void create(probe *p, size_t blockSize, int byRange)
{
    p->passes = 0;
    p->lock = epicsMutexMustCreate();
    p->over = epicsEventMustCreate(epicsEventEmpty);
    p->scan = plcScanCreate(blockSize, done, p);
    plcScanByRange(p->scan, byRange);
}

static void destroy(probe *p)
{
    plcScanDestroy(p->scan);
    epicsEventDestroy(p->over);
    epicsMutexDestroy(p->lock);
}

/* --- A device support that counts --------------------------------------------------- */

typedef struct place {
    probe *p;
    size_t offset, length;
    int isOther; /* the scan knows not the record but only its PRIO */
} place;

#define OWN 100 /* records of scan "own" */
#define LARGE 2100 /* records of scan "large": too many for the thread that asks */
#define MAX_RECORDS (17 + OWN + LARGE)
static place places[MAX_RECORDS];
static int numPlaces;

/* The record that stops in its processing until the gate is opened. */
static EpicsAtomicPtrT gateRecord; /* a record that waits when it processes; NULL: none */
static epicsEventId gateReached, gateOpen;

static long initRecord(dbCommon *common)
{
    longinRecord *prec = (longinRecord *)common;
    unsigned long offset, length;
    char name[20];
    place *at = &places[numPlaces++];

    if (sscanf(prec->inp.value.instio.string, "%19s %lu %lu", name, &offset, &length) !=
        3)
        return S_db_badField;
    at->p = strcmp(name, "all") == 0     ? &all
            : strcmp(name, "own") == 0   ? &own
            : strcmp(name, "large") == 0 ? &large
            : strcmp(name, "any") == 0   ? &any
                                         : &range;
    at->isOther = !strcmp(common->name, "all:low2") || !strcmp(common->name, "r:4b");
    at->offset = offset;
    at->length = length;
    prec->dpvt = at;
    return 0;
}

static long getIoIntInfo(int cmd, dbCommon *prec, IOSCANPVT *list)
{
    place *at = prec->dpvt;

    if (at->p == &any)
        *list = plcScanJoin(at->p->scan, 0, BLOCK, PLC_SCAN_ANY_PRIO, 0);
    else if (at->isOther)
        *list = plcScanJoin(at->p->scan, at->offset, at->length, prec->prio, cmd);
    else
        *list = plcScanRecord(at->p->scan, at->offset, at->length, prec, cmd);
    return 0;
}

/* The records of scan "own" in the order in which they were processed, and by whom. */
static longinRecord *sequence[OWN];
static int numSequence;
static epicsThreadId processedBy;

static void noteOwn(longinRecord *prec)
{
    epicsMutexMustLock(own.lock);
    if (numSequence < OWN) {
        sequence[numSequence++] = prec;
        processedBy = epicsThreadGetIdSelf();
    }
    epicsMutexUnlock(own.lock);
}

/* Records of scan "large": how many were processed, and by whom, the first and the last. */
static int numLarge;
static epicsThreadId firstBy, lastBy;

static void noteLarge(void)
{
    epicsMutexMustLock(large.lock);
    lastBy = epicsThreadGetIdSelf();
    if (numLarge++ == 0)
        firstBy = lastBy;
    epicsMutexUnlock(large.lock);
}

static long readLongin(longinRecord *prec)
{
    prec->val++;
    prec->udf = 0;
    if (((place *)prec->dpvt)->p == &own)
        noteOwn(prec);
    if (((place *)prec->dpvt)->p == &large)
        noteLarge();
    if (epicsAtomicCmpAndSwapPtrT(&gateRecord, prec, prec) == prec) {
        epicsEventMustTrigger(gateReached);
        epicsEventMustWait(gateOpen);
    }
    return 0;
}

/* longindset, which Base has since 7.0.4 */
static const struct {
    dset common;
    long (*read)(longinRecord *prec);
} devScanTest = {
    {5, NULL, NULL, initRecord, getIoIntInfo},
    readLongin
};
epicsExportAddress(dset, devScanTest);

static longinRecord *record(const char *name)
{
    return (longinRecord *)testdbRecordPtr(name);
}

static void closeGate(const char *name)
{
    epicsAtomicCmpAndSwapPtrT(&gateRecord, NULL, record(name));
}

static void openGate(void)
{
    epicsAtomicCmpAndSwapPtrT(&gateRecord, epicsAtomicGetPtrT(&gateRecord), NULL);
    epicsEventMustTrigger(gateOpen);
}

/* --- One group ---------------------------------------------------------------------- */

static const char *const allNames[] = {"all:low", "all:low2", "all:medium", "all:high"};

/* True when each record of scan "all" has been processed that often. */
static int allCount(int expected)
{
    int good = 1;
    size_t i;

    for (i = 0; i < sizeof(allNames) / sizeof(allNames[0]); i++) {
        if (record(allNames[i])->val != expected) {
            testDiag("%s was processed %d times", allNames[i], record(allNames[i])->val);
            good = 0;
        }
    }
    return good && record("all:passive")->val == 0;
}

static void testBeforeInit(void)
{
    testOk(plcScanRequestAll(all.scan) == 0 && plcScanRequestAll(all.scan) == 0,
           "requests before iocInit begin no pass");
    testOk(!plcScanBusy(all.scan), "and the scan is not busy");
}

static void testAll(void)
{
    epicsUInt64 before, after;

    testOk(plcScanCount(all.scan) == 4, "4 of 5 records are I/O Intr");
    testOk(allCount(0), "none of them was processed by iocInit");
    before = epicsMonotonicGet();
    testOk(plcScanRequestAll(all.scan) == 0, "a request begins a pass of its own");
    testOk(waitPasses(&all, 1), "done() is called once");
    after = epicsMonotonicGet();
    testOk(allCount(1), "all records of the three priorities were processed once");
    testOk(before <= all.requested && all.requested <= after,
           "done() gets the time of the request");
    testOk(!plcScanBusy(all.scan), "after it the scan is not busy");
    testOk(plcScanRequestChanged(all.scan, NULL, NULL) == 0 && waitPasses(&all, 2) &&
               allCount(2),
           "with one group nothing is compared: every block is a pass");
}

/* Asked for while the IOC was paused, done when it runs again. */
static void testPaused(void)
{
    epicsUInt64 start = epicsMonotonicGet();
    int passes = passesOf(&all);

    closeGate("all:medium");
    plcScanRequestAll(all.scan);
    epicsEventMustWait(gateReached);
    interruptAccept = FALSE;
    plcScanRequestAll(all.scan);
    interruptAccept = TRUE;
    openGate();
    testOk(waitPasses(&all, passes + 2), "a request in a pause is done behind it");
    testOk(all.requested >= start && all.requested <= epicsMonotonicGet(),
           "and its time is not before the pause");
}

static void testFlood(void)
{
    callbackQueueStats stats;
    epicsUInt64 first;
    int i, merged = 0;

    callbackQueueStatus(1, NULL);
    closeGate("all:medium");
    plcScanRequestAll(all.scan);
    epicsEventMustWait(gateReached);
    testOk(plcScanBusy(all.scan), "a pass that hangs in a record is busy");
    first = epicsMonotonicGet();
    testOk(plcScanRequestAll(all.scan) == 0,
           "the first request meanwhile waits for its own");
    for (i = 0; i < 100000; i++)
        merged += plcScanRequestAll(all.scan);
    testOk(merged == 100000, "100000 more are merged into that one");
    callbackQueueStatus(0, &stats);
    testOk(stats.numUsed[0] <= 1 && stats.numUsed[1] <= 1 && stats.numUsed[2] <= 1,
           "the callback queues hold no more than one of them");
    openGate();
    testOk(waitPasses(&all, 4) && allCount(4), "they become one more pass");
    testOk(all.requested >= first && all.requested <= epicsMonotonicGet(),
           "and done() gets the time of the first of them");
    callbackQueueStatus(0, &stats);
    testOk(stats.numOverflow[0] + stats.numOverflow[1] + stats.numOverflow[2] == 0,
           "no callback queue overflowed");
    testOk(!plcScanBusy(all.scan), "nothing waits any more");
}

/* --- A group for each range --------------------------------------------------------- */

static const char *const rangeNames[] = {
    "r:0", "r:1", "r:4a", "r:4b", "r:6x4", "r:wide", "r:64bytes", "r:last", "r:whole"};

#define NUM_RANGES (sizeof(rangeNames) / sizeof(rangeNames[0]))

static int rangeVals[NUM_RANGES];

static void rememberRanges(void)
{
    size_t i;

    for (i = 0; i < NUM_RANGES; i++)
        rangeVals[i] = record(rangeNames[i])->val;
}

/* True when the records named in `which` were processed once since rememberRanges, and no
 * others. */
static int onlyProcessed(const char *which)
{
    char list[200], name[20];
    int good = 1;
    size_t i;

    epicsSnprintf(list, sizeof(list), " %s ", which);
    for (i = 0; i < NUM_RANGES; i++) {
        int times = record(rangeNames[i])->val - rangeVals[i];

        epicsSnprintf(name, sizeof(name), " %s ", rangeNames[i] + 2);
        if (times != (strstr(list, name) ? 1 : 0)) {
            testDiag("%s was processed %d times", rangeNames[i], times);
            good = 0;
        }
    }
    return good;
}

#define EVERYONE "0 1 4a 4b 6x4 wide 64bytes last whole"

static const struct {
    const char *what;
    int first, last; /* bytes that change; the first and the last of them do */
    const char *records;
} changes[] = {
    {"the first byte",                                0,   0,   "0 whole"           },
    {"its neighbour in the same word",                1,   1,   "1 whole"           },
    {"a byte that only the whole block has",          2,   2,   "whole"             },
    {"a byte of two records with one range",          4,   4,   "4a 4b whole"       },
    {"a byte of two ranges",                          7,   7,   "4a 4b 6x4 whole"   },
    {"a byte beyond the word where the range begins", 9,   9,   "6x4 whole"         },
    {"two bytes far apart",                           1,   202, "1 last whole"      },
    {"the first byte of a long range",                60,  60,  "wide whole"        },
    {"the byte before it",                            59,  59,  "whole"             },
    {"a byte of two long ranges",                     101, 101, "wide 64bytes whole"},
    {"the last byte of a long range",                 159, 159, "wide 64bytes whole"},
    {"the byte after it",                             160, 160, "64bytes whole"     },
    {"the last byte of the block",                    202, 202, "last whole"        },
};

static void testRanges(void)
{
    char before[BLOCK] = "", after[BLOCK] = "";
    int passes = 0;
    size_t i;

    testOk(plcScanCount(range.scan) == NUM_RANGES,
           "all records of the block are I/O Intr");
    for (i = 0; i < sizeof(changes) / sizeof(changes[0]); i++) {
        int merged;

        memcpy(after, before, BLOCK);
        after[changes[i].first] ^= 0x10;
        if (changes[i].last != changes[i].first)
            after[changes[i].last] ^= 0x01;
        rememberRanges();
        merged = plcScanRequestChanged(range.scan, before, after);
        testOk(!merged && waitPasses(&range, ++passes) &&
                   onlyProcessed(changes[i].records),
               "%s processes %s", changes[i].what, changes[i].records);
        memcpy(before, after, BLOCK);
    }
    rememberRanges();
    testOk(plcScanRequestChanged(range.scan, before, after) == 0 &&
               !plcScanBusy(range.scan) && onlyProcessed(""),
           "no change begins no pass");
    memset(after, 0x55, BLOCK);
    plcScanRequestChanged(range.scan, before, after);
    testOk(waitPasses(&range, ++passes) && onlyProcessed(EVERYONE),
           "a change of everything processes each record once");
    rememberRanges();
    plcScanRequestAll(range.scan);
    testOk(waitPasses(&range, ++passes) && onlyProcessed(EVERYONE),
           "a request for all needs no change");
}

static void testUnion(void)
{
    char blocks[4][BLOCK];
    int passes = passesOf(&range);

    memset(blocks, 0, sizeof(blocks));
    blocks[1][0] = 1;
    memcpy(blocks[2], blocks[1], BLOCK);
    blocks[2][1] = 1;
    memcpy(blocks[3], blocks[2], BLOCK);
    blocks[3][202] = 1;
    rememberRanges();
    closeGate("r:0");
    plcScanRequestChanged(range.scan, blocks[0], blocks[1]);
    epicsEventMustWait(gateReached);
    testOk(plcScanRequestChanged(range.scan, blocks[1], blocks[1]) == 0,
           "no change while a pass runs asks for nothing");
    testOk(plcScanRequestChanged(range.scan, blocks[1], blocks[2]) == 0,
           "a change while a pass runs waits for the next");
    testOk(plcScanRequestChanged(range.scan, blocks[2], blocks[3]) == 1,
           "a second change is merged into it");
    openGate();
    testOk(waitPasses(&range, passes + 2), "both make one pass");
    record("r:whole")->val--; /* it is in both passes */
    testOk(onlyProcessed("0 1 last whole"), "with the records of both changes");
    record("r:whole")->val++;

    rememberRanges();
    closeGate("r:0");
    plcScanRequestChanged(range.scan, blocks[0], blocks[1]);
    epicsEventMustWait(gateReached);
    plcScanRequestChanged(range.scan, blocks[1], blocks[2]);
    testOk(plcScanRequestAll(range.scan) == 1, "a request for all joins waiting changes");
    testOk(plcScanRequestChanged(range.scan, blocks[2], blocks[3]) == 1,
           "and a change joins waiting all");
    openGate();
    testOk(waitPasses(&range, passes + 4), "again one pass");
    record("r:0")->val--;
    record("r:whole")->val--;
    testOk(onlyProcessed(EVERYONE), "that processes each record once");
    record("r:0")->val++;
    record("r:whole")->val++;
}

/* --- A callback queue that is full -------------------------------------------------- */

#define QUEUE 10

static epicsEventId hangs, goOn, marked;

static void hang(epicsCallback *callback)
{
    (void)callback;
    epicsEventMustTrigger(hangs);
    epicsEventMustWait(goOn);
}

static void mark(epicsCallback *callback)
{
    (void)callback;
    epicsEventMustTrigger(marked);
}

static void nothing(epicsCallback *callback)
{
    (void)callback;
}

static void prepare(epicsCallback *callback, CALLBACKFUNC function, int prio)
{
    callbackSetCallback(function, callback);
    callbackSetPriority(prio, callback);
}

/* Waits until all that is now in the queue of this priority has been done. */
static void waitQueue(int prio)
{
    epicsCallback callback;

    prepare(&callback, mark, prio);
    callbackRequest(&callback);
    epicsEventMustWait(marked);
}

/* The thread of this priority hangs and its queue is full. */
static void fillQueue(int prio)
{
    static epicsCallback hanging, filler;

    prepare(&hanging, hang, prio);
    prepare(&filler, nothing, prio);
    callbackRequest(&hanging);
    epicsEventMustWait(hangs);
    while (callbackRequest(&filler) == 0)
        ;
}

static void countFull(void *arg, const char *message)
{
    if (strstr(message, "s7plc: a callback queue of the IOC is full") &&
        strstr(message, "callbackSetQueueSize"))
        ++*(int *)arg;
}

static void testQueueFull(void)
{
    static const char block[BLOCK] = "";
    int passes = passesOf(&range), told = 0;

    errlogAddListener(countFull, &told);

    rememberRanges();
    fillQueue(priorityLow);
    testOk(plcScanRequestAll(range.scan) == 0, "a request while the LOW queue is full");
    waitQueue(priorityMedium);
    waitQueue(priorityHigh);
    testOk(onlyProcessed("1 4b 6x4 wide"), "the HIGH and MEDIUM records were processed");
    testOk(!plcScanBusy(range.scan), "nothing hangs");
    testOk(passesOf(&range) == passes, "done() was not called: the pass is not over");
    testOk(plcScanRequestChanged(range.scan, block, block) == 1,
           "what could not be queued is waiting");
    testOk(!plcScanBusy(range.scan), "the queue is still full");
    epicsEventMustTrigger(goOn);
    while (passesOf(&range) == passes) { /* the queue is open again soon */
        waitQueue(priorityMedium);
        plcScanRequestChanged(range.scan, block, block);
    }
    testOk(waitPasses(&range, passes + 1), "the next request ends it");
    testOk(onlyProcessed(EVERYONE), "with the LOW records only");
    testOk(plcScanRequestChanged(range.scan, block, block) == 0,
           "nothing waits any more");
    errlogFlush();
    errlogRemoveListeners(countFull, &told);
    testOk(told == 1, "that the queue was full is said once, with what to do: %d", told);
}

/* Nobody asks again: the last request must not be lost for that. */
static void testQueueFullOnce(void)
{
    int passes = passesOf(&range);

    rememberRanges();
    fillQueue(priorityLow);
    plcScanRequestAll(range.scan);
    waitQueue(priorityMedium);
    waitQueue(priorityHigh);
    epicsEventMustTrigger(goOn);
    testOk(waitPasses(&range, passes + 1), "a queue that was full: the pass ends on its own");
    testOk(onlyProcessed(EVERYONE), "with all records");
}

/* --- Records come and go ------------------------------------------------------------ */

static void testJoin(void)
{
    int passes = passesOf(&all), low = record("all:low")->val;

    testdbPutFieldOk("all:passive.SCAN", DBR_STRING, "I/O Intr");
    testOk(plcScanCount(all.scan) == 5, "a record joins at run time");
    testOk(waitPasses(&all, passes + 1) && record("all:passive")->val == 1 &&
               record("all:low")->val == low,
           "and is processed at once, it alone");
    plcScanRequestAll(all.scan);
    testOk(waitPasses(&all, passes + 2) && record("all:passive")->val == 2,
           "and with each pass");
    testdbPutFieldOk("all:passive.PRIO", DBR_STRING, "HIGH");
    testOk(plcScanCount(all.scan) == 5, "it changes its priority");
    testOk(waitPasses(&all, passes + 3) && record("all:passive")->val == 3,
           "and is processed at once");
    plcScanRequestAll(all.scan);
    testOk(waitPasses(&all, passes + 4) && record("all:passive")->val == 4,
           "and still once with each pass");
    testdbPutFieldOk("all:passive.SCAN", DBR_STRING, "Passive");
    testdbPutFieldOk("all:low.SCAN", DBR_STRING, "Passive");
    testdbPutFieldOk("all:low2.SCAN", DBR_STRING, "Passive");
    testdbPutFieldOk("all:medium.SCAN", DBR_STRING, "Passive");
    testOk(plcScanCount(all.scan) == 1, "records leave");
    plcScanRequestAll(all.scan);
    testOk(waitPasses(&all, passes + 5) &&
               record("all:low")->val == record("all:medium")->val,
           "a pass of one priority is over too");
    testdbPutFieldOk("all:high.SCAN", DBR_STRING, "Passive");
    testOk(plcScanRequestAll(all.scan) == 0 && plcScanRequestAll(all.scan) == 0 &&
               !plcScanBusy(all.scan) && passesOf(&all) == passes + 5,
           "without records requests are over at once, without done()");
    plcScanJoin(all.scan, 0, 1, priorityLow, 1);
    testOk(plcScanCount(all.scan) == 0, "to leave twice does no harm");
    /* Base frees only what is in a list at the end */
    testdbPutFieldOk("all:passive.SCAN", DBR_STRING, "I/O Intr");
    testdbPutFieldOk("all:low.SCAN", DBR_STRING, "I/O Intr");
    testdbPutFieldOk("all:low2.SCAN", DBR_STRING, "I/O Intr");
    testdbPutFieldOk("all:medium.SCAN", DBR_STRING, "I/O Intr");
    testdbPutFieldOk("all:high.SCAN", DBR_STRING, "I/O Intr");
    testOk(plcScanCount(all.scan) == 5, "all records join again");
    WAIT_FOR(!plcScanBusy(all.scan));
    testOk(!plcScanBusy(all.scan), "what their joining has asked for ends");
}

/* With a group for each range only the one that joins needs a pass: its bytes may stand
 * still for days. */
static void testNewcomers(void)
{
    static const char block[BLOCK] = "";
    int passes = passesOf(&range);

    rememberRanges();
    testdbPutFieldOk("r:4a.SCAN", DBR_STRING, "Passive");
    testdbPutFieldOk("r:4a.SCAN", DBR_STRING, "I/O Intr");
    testOk(waitPasses(&range, passes + 1) && onlyProcessed("4a"),
           "a record that joins is processed at once, though nothing changes");
    rememberRanges();
    closeGate("r:0");
    testdbPutFieldOk("r:0.SCAN", DBR_STRING, "Passive");
    testdbPutFieldOk("r:0.SCAN", DBR_STRING, "I/O Intr");
    epicsEventMustWait(gateReached);
    testdbPutFieldOk("r:4a.SCAN", DBR_STRING, "Passive");
    testdbPutFieldOk("r:4a.SCAN", DBR_STRING, "I/O Intr");
    testdbPutFieldOk("r:6x4.SCAN", DBR_STRING, "Passive");
    testdbPutFieldOk("r:6x4.SCAN", DBR_STRING, "I/O Intr");
    testdbPutFieldOk("r:6x4.SCAN", DBR_STRING, "Passive");
    testdbPutFieldOk("r:wide.PRIO", DBR_STRING, "LOW");
    openGate();
    testOk(waitPasses(&range, passes + 3) && onlyProcessed("0 4a wide"),
           "those that join while a pass runs make one more; one that left again is not in it");
    testdbPutFieldOk("r:6x4.SCAN", DBR_STRING, "I/O Intr");
    testdbPutFieldOk("r:wide.PRIO", DBR_STRING, "HIGH");
    waitPasses(&range, passes + 5);
    rememberRanges();
    fillQueue(priorityMedium);
    testdbPutFieldOk("r:6x4.SCAN", DBR_STRING, "Passive");
    testdbPutFieldOk("r:6x4.SCAN", DBR_STRING, "I/O Intr");
    epicsEventMustTrigger(goOn);
    passes = passesOf(&range);
    while (passesOf(&range) == passes) {
        waitQueue(priorityHigh);
        plcScanRequestChanged(range.scan, block, block);
    }
    testOk(onlyProcessed("6x4"), "one for which the queue was full comes with the next block");
}

/* iocPause, iocRun. */
static void testPause(void)
{
    char before[BLOCK] = "", after[BLOCK] = "";
    int passes = passesOf(&range), low = record("all:low")->val;

    rememberRanges();
    testOk(iocPause() == 0, "the IOC is paused");
    after[0] = 1;
    plcScanRequestChanged(range.scan, before, after);
    plcScanRequestChanged(range.scan, after, after);
    testdbPutFieldOk("r:wide.PRIO", DBR_STRING, "MEDIUM");
    plcScanRequestAll(all.scan);
    testOk(!plcScanBusy(range.scan) && onlyProcessed(""), "no pass begins");
    testOk(iocRun() == 0, "it runs again");
    plcScanResume(range.scan);
    testOk(waitPasses(&range, passes + 1) && onlyProcessed("0 whole wide"),
           "what changed meanwhile, or joined, is made up for");
    testOk(range.requested != 0, "and done() gets a time");
    plcScanResume(range.scan);
    testOk(!plcScanBusy(range.scan) && passesOf(&range) == passes + 1, "once");
    passes = passesOf(&all);
    plcScanResume(all.scan);
    testOk(waitPasses(&all, passes + 1) && record("all:low")->val == low + 1,
           "the same with one group");
    passes = passesOf(&range);
    rememberRanges();
    iocPause();
    plcScanRequestChanged(range.scan, before, after);
    iocRun();
    plcScanRequestChanged(range.scan, before, after);
    testOk(waitPasses(&range, passes + 1) && onlyProcessed("0 whole"),
           "the next change of the same bytes begins a pass, too");
    testdbPutFieldOk("r:wide.PRIO", DBR_STRING, "HIGH");
    waitPasses(&range, passes + 2);
}

/* Device support that knows no PRIO when it asks for the list. */
static void testAnyPrio(void)
{
    int passes = passesOf(&any);

    plcScanRequestAll(any.scan);
    testOk(waitPasses(&any, passes + 1) && record("any:low")->val == 1 &&
               record("any:medium")->val == 1 && record("any:high")->val == 1,
           "records of all priorities are processed, when none was given");
}

/* --- Many records of one group ------------------------------------------------------ */

static longinRecord *ownRecord(int number)
{
    char name[20];

    epicsSnprintf(name, sizeof(name), "own:%d", number);
    return record(name);
}

/* Two of three have PHAS 0, every third one 1. */
static int orderIsRight(void)
{
    int i, phas, n = 0;

    for (phas = 0; phas < 2; phas++) {
        for (i = 0; i < OWN; i++) {
            if (ownRecord(i)->phas == phas && sequence[n++] != ownRecord(i))
                return 0;
        }
    }
    return numSequence == OWN;
}

/* True when each was processed that often, but number `other`, which was `times`. */
static int ownCount(int each, int other, int times)
{
    int i, good = 1;

    for (i = 0; i < OWN; i++) {
        int val = ownRecord(i)->val;

        if (val != (i == other ? times : each)) {
            testDiag("own:%d was processed %d times", i, val);
            good = 0;
        }
    }
    return good;
}

static void startAndHang(const char *name)
{
    closeGate(name);
    plcScanRequestAll(own.scan);
    epicsEventMustWait(gateReached);
}

static void testOwn(void)
{
    testOk(plcScanCount(own.scan) == OWN, "%d records in one group", OWN);
    plcScanRequestAll(own.scan);
    testOk(waitPasses(&own, 1) && ownCount(1, -1, 0), "all are processed once");
    testOk(orderIsRight(), "by PHAS, then in the order of the database");

    startAndHang("own:10");
    testdbPutFieldOk("own:4.SCAN", DBR_STRING, "Passive");
    openGate();
    testOk(waitPasses(&own, 2) && ownCount(2, -1, 0),
           "one that leaves behind a pass makes it skip nothing");
    startAndHang("own:10");
    testdbPutFieldOk("own:4.PHAS", DBR_STRING, "-1");
    testdbPutFieldOk("own:4.SCAN", DBR_STRING, "I/O Intr");
    openGate();
    testOk(waitPasses(&own, 4) && ownCount(3, -1, 0),
           "one that joins behind a pass makes it repeat nothing, and gets a pass of its own");
    startAndHang("own:10");
    testdbPutFieldOk("own:12.SCAN", DBR_STRING, "Passive");
    testdbPutFieldOk("own:98.SCAN", DBR_STRING, "Passive");
    openGate();
    testOk(waitPasses(&own, 5) && ownRecord(12)->val == 3 && ownRecord(98)->val == 3 &&
               ownRecord(13)->val == 4 && ownRecord(97)->val == 4,
           "one that leaves before its turn is not processed");
    testdbPutFieldOk("own:12.SCAN", DBR_STRING, "I/O Intr");
    waitPasses(&own, 6);
    testdbPutFieldOk("own:98.SCAN", DBR_STRING, "I/O Intr");
    waitPasses(&own, 7);
}

static void testHere(void)
{
    epicsThreadId self = epicsThreadGetIdSelf();
    int passes = passesOf(&own);

    testOk(processedBy != self, "a pass runs in a callback thread");
    plcScanHere(own.scan, 1);
    numSequence = 0;
    plcScanRequestAll(own.scan);
    testOk(numSequence == OWN && processedBy == self,
           "a pass \"here\" is over when the request returns");
    testOk(passesOf(&own) == passes + 1 && !plcScanBusy(own.scan), "done() was called");
    numSequence = 0;
    testdbPutFieldOk("own:1.PRIO", DBR_STRING, "HIGH");
    waitPasses(&own, passes + 2);
    testOk(numSequence == 1 && processedBy != self,
           "a record that joins is processed in a callback thread");
    numSequence = 0;
    plcScanRequestAll(own.scan);
    testOk(waitPasses(&own, passes + 3) && processedBy != self,
           "records of two priorities go to the callback threads");
    testdbPutFieldOk("own:1.PRIO", DBR_STRING, "LOW");
    waitPasses(&own, passes + 4);
    plcScanHere(large.scan, 1);
    plcScanRequestAll(large.scan);
    testOk(waitPasses(&large, 1) && numLarge == LARGE && firstBy == self && lastBy != self,
           "a large pass begins \"here\", the rest goes to a callback thread");
}

static void openSoon(void *ended)
{
    epicsEventMustWait(gateReached);
    epicsThreadSleep(0.03); /* so long does the record hold the thread */
    openGate();
    epicsEventMustTrigger(ended);
}

/* A record makes the thread that asked wait: once, and never again. */
static void testHeld(void)
{
    epicsThreadId self = epicsThreadGetIdSelf();
    epicsEventId ended = epicsEventMustCreate(epicsEventEmpty);
    int i, passes, here = 0;

    testOk(plcScanHeld(own.scan) == 0, "no pass has held us up so far");
    closeGate("own:10");
    epicsThreadMustCreate("opener", epicsThreadPriorityMedium,
                          epicsThreadGetStackSize(epicsThreadStackSmall), openSoon, ended);
    plcScanRequestAll(own.scan);
    epicsEventMustWait(ended);
    testOk(plcScanHeld(own.scan) >= 30, "one did, for %.0f ms", plcScanHeld(own.scan));
    for (i = 0; i < 500; i++) {
        passes = passesOf(&own);
        plcScanRequestAll(own.scan);
        here += !waitPasses(&own, passes + 1) || processedBy == self;
    }
    testOk(here == 0, "%d more passes: all in a callback thread", i);
    epicsEventDestroy(ended);
}

static void testEmpty(void)
{
    plcScan *scan = plcScanCreate(0, NULL, NULL);

    plcScanByRange(scan, 1);
    testOk(plcScanRequestAll(scan) == 0 && !plcScanBusy(scan),
           "a block of 0 bytes has no pass");
    plcScanJoin(scan, 0, 4, priorityLow, 0);
    testOk(plcScanRequestChanged(scan, "", "") == 0 && !plcScanBusy(scan),
           "and never changes");
    plcScanDestroy(scan);
    scan = plcScanCreate(4, NULL, NULL);
    plcScanByRange(scan, 1);
    plcScanRequestAll(scan);
    testOk(plcScanRequestChanged(scan, "1234", "1235") == 0 && !plcScanBusy(scan),
           "a block without records may change");
    plcScanDestroy(scan);
    plcScanDestroy(NULL);
}

#define MANY 20000

static void testMany(void)
{
    static char before[2 * MANY], after[2 * MANY];
    probe many;
    IOSCANPVT first, lists[4];
    size_t i;

    create(&many, sizeof(before), 1);
    first = plcScanJoin(many.scan, 0, 2, priorityLow, 0);
    for (i = 1; i < MANY; i++)
        lists[i % 4] = plcScanJoin(many.scan, 2 * i, 2, (int)(i % 3), 0);
    testOk(plcScanCount(many.scan) == MANY, "%d ranges", MANY);
    testOk(plcScanJoin(many.scan, 0, 2, priorityLow, 0) == first,
           "a range is found again among them");
    testOk(lists[0] != lists[1] && lists[1] != lists[2], "each has a list of its own");
    for (i = 0; i < 10; i++) {
        after[i * 1000] ^= 1;
        plcScanRequestChanged(many.scan, before, after);
        memcpy(before, after, sizeof(before));
        waitPasses(&many, (int)i + 1);
    }
    testOk(passesOf(&many) == 10, "a change in one of them makes a pass");
    memset(after, 7, sizeof(after));
    plcScanRequestChanged(many.scan, before, after);
    testOk(waitPasses(&many, 11), "so does a change in each of them");
    memcpy(before, after, sizeof(before));
    plcScanUse(many.scan, MANY);
    after[MANY] ^= 1;
    testOk(plcScanRequestChanged(many.scan, before, after) == 0 && !plcScanBusy(many.scan),
           "of a block that has become shorter the rest never changes");
    after[MANY - 1] ^= 1;
    plcScanRequestChanged(many.scan, before, after);
    testOk(waitPasses(&many, 12), "its last byte does");
    waitQueue(priorityLow);
    waitQueue(priorityMedium);
    waitQueue(priorityHigh);
    destroy(&many);
}

/* --- All together ------------------------------------------------------------------- */

static void loadMany(void)
{
    char macros[40];
    int i;

    for (i = 0; i < OWN; i++) {
        epicsSnprintf(macros, sizeof(macros), "S=own,N=%d,PHAS=%d", i, i % 3 == 2);
        testdbReadDatabase("scanTestOwn.db", NULL, macros);
    }
    for (i = 0; i < LARGE; i++) {
        epicsSnprintf(macros, sizeof(macros), "S=large,N=%d,PHAS=0", i);
        testdbReadDatabase("scanTestOwn.db", NULL, macros);
    }
}

static void startIoc(void)
{
    testdbPrepare();
    callbackSetQueueSize(QUEUE);
    testdbReadDatabase("scanTest.dbd", NULL, NULL);
    scanTest_registerRecordDeviceDriver(pdbbase);
    testdbReadDatabase("scanTest.db", NULL, NULL);
    loadMany();
    gateReached = epicsEventMustCreate(epicsEventEmpty);
    gateOpen = epicsEventMustCreate(epicsEventEmpty);
    hangs = epicsEventMustCreate(epicsEventEmpty);
    goOn = epicsEventMustCreate(epicsEventEmpty);
    marked = epicsEventMustCreate(epicsEventEmpty);
    create(&all, BLOCK, 0);
    create(&range, BLOCK, 1);
    create(&own, BLOCK, 0);
    create(&large, BLOCK, 0);
    create(&any, BLOCK, 1);
}

static void stopIoc(void)
{
    testIocShutdownOk();
    testOk(plcScanRequestAll(range.scan) == 0 && !plcScanBusy(range.scan),
           "a request after the IOC stopped does nothing");
    testdbCleanup();
    destroy(&all);
    destroy(&range);
    destroy(&own);
    destroy(&large);
    destroy(&any);
    epicsEventDestroy(gateReached);
    epicsEventDestroy(gateOpen);
    epicsEventDestroy(hangs);
    epicsEventDestroy(goOn);
    epicsEventDestroy(marked);
}

MAIN(scanTest)
{
    testPlan(1 + 2 + 2 + 8 + 8 + 17 + 9 + 9 + 2 + 24 + 17 + 10 + 1 + 13 + 8 + 3 + 3 + 7 + 1);
    startIoc();
    testBeforeInit();
    eltc(0); /* no messages of full queues */
    testIocInitOk();
    testDiag("One group of all records");
    testAll();
    testDiag("A flood of requests while a pass hangs");
    testFlood();
    testDiag("A group for each range");
    testRanges();
    testDiag("Changes while a pass hangs");
    testUnion();
    testDiag("A callback queue that is full");
    testQueueFull();
    testQueueFullOnce();
    testDiag("Records come and go");
    testPaused();
    testJoin();
    testDiag("A group for each range: records come and go");
    testNewcomers();
    testDiag("A pause of the IOC");
    testPause();
    testAnyPrio();
    testDiag("Many records of one group");
    testOwn();
    testDiag("Passes in the thread that asks for them");
    testHere();
    testHeld();
    testDiag("No bytes, many ranges");
    testEmpty();
    testMany();
    eltc(1);
    stopIoc();
    return testDone();
}
