/* Passes over groups of records, never more than one at a time.
 *
 *   request --> pending --(begin)--> running --(last priority ends)--> done()
 *                  ^                    |                                |
 *                  +-- queue was full --+      pending again? begin  <---+
 *
 * Our own way through the records does without the lock of Base's scan lists at each of them,
 * and has the next ones brought into the cache while one is processed.
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <compilerSpecific.h>
#include <dbAccess.h>
#include <dbLock.h>
#include <epicsAtomic.h>
#include <epicsThread.h>
#include <epicsTime.h>
#include <errlog.h>

#include "plcHot.h"
#include "plcScanPvt.h"

#define HERE_RECORDS 2000 /* a pass of more only begins in the thread that asks for it; */
#define HERE_NS 20000000  /* after one that took longer there, it never gets another */

#define AGAIN_S 0.05 /* a pass is asked for again so long after its queue was full */

static epicsTimerQueueId timers; /* of all scans */
static epicsThreadOnceId timersOnce = EPICS_THREAD_ONCE_INIT;

/* The priorities of `prios` for which these counts are not 0. */
static unsigned inUse(const unsigned count[NUM_CALLBACK_PRIORITIES], unsigned prios)
{
    unsigned used = 0;
    int prio;

    for (prio = 0; prio < NUM_CALLBACK_PRIORITIES; prio++) {
        if (count[prio])
            used |= prios & 1u << prio;
    }
    return used;
}

static unsigned inUseBy(const group *g, unsigned prios)
{
    if (!g->others)
        return inUse(g->count, prios);
    return g->others->anyPrio ? prios
                              : inUse(g->count, prios) | inUse(g->others->count, prios);
}

static unsigned bitCount(unsigned prios)
{
    return (prios & 1) + (prios >> 1 & 1) + (prios >> 2 & 1);
}

void plcScanAddNewcomer(newcomers *n, dbCommon *prec, group *g)
{
    newcomer *list;

    if (n->count == n->room) {
        n->room = n->room ? 2 * n->room : 16;
        list = callocMustSucceed(n->room, sizeof(*list), "plcScan");
        if (n->count)
            memcpy(list, n->list, n->count * sizeof(*list));
        free(n->list);
        n->list = list;
    }
    n->list[n->count].record = prec;
    n->list[n->count++].group = g;
}

/* Makes the newcomers that wait those of the pass. Returns their priorities. */
static unsigned beginNewcomers(plcScan *scan)
{
    newcomers empty = scan->newRunning;
    unsigned prios = 0;
    size_t i;

    scan->newRunning = scan->newPending;
    scan->newPending = empty;
    scan->newPending.count = 0;
    for (i = 0; i < scan->newRunning.count; i++) {
        const newcomer *n = &scan->newRunning.list[i];

        n->group->running = 0; /* of an older pass; the new one begins with newcomers */
        if (n->record)
            prios |= 1u << n->record->prio;
    }
    return prios;
}

/* Makes what is pending the running pass. Returns its priorities: none when no record is
 * concerned, then no pass runs. Lock held; no pass runs. */
PLC_HOT unsigned plcScanBegin(plcScan *scan)
{
    group **empty = scan->running;
    unsigned prios;
    size_t i;

    scan->running = scan->pending;
    scan->numRunning = scan->numPending;
    scan->pending = empty;
    scan->numPending = 0;
    scan->allRunning = inUse(scan->count, scan->allPending);
    scan->allPending = 0;
    prios = scan->allRunning | beginNewcomers(scan);
    scan->size = scan->newRunning.count;
    for (i = 0; i < scan->numRunning; i++) {
        group *g = scan->running[i];

        g->running = (epicsUInt8)inUseBy(g, g->pending);
        g->pending = 0;
        prios |= g->running;
        scan->size += sizeOf(g);
    }
    for (i = 0; i < NUM_CALLBACK_PRIORITIES; i++) {
        memset(&scan->part[i].at, 0, sizeof(scan->part[i].at));
        if (scan->allRunning & 1u << i)
            scan->size += scan->count[i];
    }
    /* what was asked for while the IOC was paused is answered from now on */
    scan->runningSince = prios && !scan->pendingSince ? epicsMonotonicGet()
                                                      : scan->pendingSince;
    scan->pendingSince = 0;
    scan->busy = prios != 0;
    scan->remaining = bitCount(prios);
    scan->partial = 0;
    return prios;
}

static void startTimers(void *arg)
{
    (void)arg;
    timers = epicsTimerQueueAllocate(1, epicsThreadPriorityScanLow);
}

static void again(void *pvt);

/* No lock is held. */
PLC_COLD static void askAgain(plcScan *scan)
{
    epicsTimerId mine, surplus = NULL;

    epicsThreadOnce(&timersOnce, startTimers, NULL);
    epicsMutexMustLock(scan->lock);
    mine = scan->again;
    epicsMutexUnlock(scan->lock);
    if (!mine) {
        mine = epicsTimerQueueCreateTimer(timers, again, scan);
        epicsMutexMustLock(scan->lock);
        if (scan->again) { /* of another priority, just now */
            surplus = mine;
            mine = scan->again;
        }
        scan->again = mine;
        epicsMutexUnlock(scan->lock);
    }
    if (surplus)
        epicsTimerQueueDestroyTimer(timers, surplus);
    epicsTimerStartDelay(mine, AGAIN_S);
}

void plcScanFreeTimer(plcScan *scan)
{
    if (scan->again)
        epicsTimerQueueDestroyTimer(timers, scan->again);
}

PLC_COLD void plcScanQueueFull(void)
{
    static int told;

    if (epicsAtomicCmpAndSwapIntT(&told, 0, 1) == 0)
        errlogSevPrintf(errlogMinor, "s7plc: a callback queue of the IOC is full: records process a little "
                        "later, none is lost. callbackSetQueueSize before iocInit makes it longer\n");
}

/* These priorities could not be queued: they wait for the next request, or the timer. */
PLC_COLD static void putBack(plcScan *scan, unsigned prios)
{
    size_t i;

    epicsMutexMustLock(scan->lock);
    scan->allPending |= scan->allRunning & prios;
    scan->allRunning &= ~prios;
    for (i = 0; i < scan->numRunning; i++) {
        addPending(scan, scan->running[i], scan->running[i]->running & prios);
        scan->running[i]->running &= (epicsUInt8)~prios;
    }
    for (i = 0; i < scan->newRunning.count; i++) {
        newcomer *n = &scan->newRunning.list[i];

        if (n->record && prios & 1u << n->record->prio) {
            plcScanAddNewcomer(&scan->newPending, n->record, n->group);
            n->record = NULL;
        }
    }
    scan->pendingSince = scan->runningSince;
    scan->partial = 1;
    scan->remaining -= bitCount(prios);
    if (scan->remaining == 0)
        scan->busy = 0;
    epicsMutexUnlock(scan->lock);
    plcScanQueueFull();
    askAgain(scan);
}

/* Queues one callback for each of these priorities of the pass, the highest first. */
void plcScanQueue(plcScan *scan, unsigned prios)
{
    unsigned failed = 0;
    int prio;

    for (prio = NUM_CALLBACK_PRIORITIES - 1; prio >= 0; prio--) {
        if (prios & 1u << prio && callbackRequest(&scan->part[prio].callback) != 0)
            failed |= 1u << prio;
    }
    if (failed)
        putBack(scan, failed);
}

/* In the thread of the timer: a pass over what is still pending. */
PLC_COLD static void again(void *pvt)
{
    plcScan *scan = pvt;
    unsigned prios = 0;

    epicsMutexMustLock(scan->lock);
    if (interruptAccept && !scan->busy)
        prios = plcScanBegin(scan);
    epicsMutexUnlock(scan->lock);
    plcScanQueue(scan, prios);
}

/* The newcomers of this priority; not those whose group has its turn. */
static unsigned nextNewcomers(plcScan *scan, part *own, target targets[BATCH])
{
    unsigned n = 0;

    while (n < BATCH && own->at.newcomer < scan->newRunning.count) {
        const newcomer *next = &scan->newRunning.list[own->at.newcomer++];

        if (next->record && next->record->prio == own->prio &&
            !(next->group->running & 1u << own->prio))
            targets[n++].record = next->record;
    }
    return n;
}

/* The next steps of the pass for this priority. Returns how many, 0 at the end. */
static unsigned nextTargets(plcScan *scan, part *own, target targets[BATCH])
{
    int prio = own->prio;
    unsigned bit = 1u << prio, n = 0;
    cursor *at = &own->at;
    int all;

    epicsMutexMustLock(scan->lock);
    all = (scan->allRunning & bit) != 0;
    if (!all)
        n = nextNewcomers(scan, own, targets);
    while (n < BATCH && at->group < (all ? scan->numGroups : scan->numRunning)) {
        group *g = all ? scan->groups[at->group] : scan->running[at->group];
        dbCommon **records = g->records + firstOf(g, prio);
        int mine = all || g->running & bit;

        at->inside = g;
        while (mine && n < BATCH && at->index < g->count[prio])
            targets[n++].record = records[at->index++];
        if (n == BATCH)
            break;
        if (mine && g->others && (g->others->anyPrio || g->others->count[prio])) {
            targets[n].record = NULL;
            targets[n++].list = g->others->list;
        }
        at->group++;
        at->index = 0;
        at->inside = NULL;
    }
    epicsMutexUnlock(scan->lock);
    return n;
}

#define FAR 4      /* records ahead, whose fields are fetched, */
#define NEAR 2     /* and those to which the fields must point by now */
#define FIELDS 128 /* records need their fields from this byte on, */
#define END 1216   /* up to about this one */

/* Has the cache fetch the fields of record number i. These two help, and do nothing else.
 * Always inline: gcc 12 takes a call without effects out. */
static EPICS_ALWAYS_INLINE void fetchFields(const target targets[], unsigned n,
                                            unsigned i)
{
    const char *prec = i < n ? (const char *)targets[i].record : NULL;
    size_t at;

    for (at = FIELDS; prec && at < END; at += LINE)
        FETCH(prec + at);
}

/* The same for what its fields point to. */
static EPICS_ALWAYS_INLINE void fetchTargets(const target targets[], unsigned n,
                                             unsigned i)
{
    const dbCommon *prec = i < n ? targets[i].record : NULL;

    if (prec) {
        FETCH(prec->lset);
        FETCH(prec->dpvt);
        FETCH((const char *)prec->dpvt + LINE);
    }
}

static void processTarget(const target *t, int prio)
{
    dbCommon *prec = t->record;

    if (!prec) {
        scanIoImmediate(t->list, prio);
        return;
    }
    dbScanLock(prec);
    if (prec->scan == SCAN_IO_EVENT) /* it may have left since */
        dbProcess(prec);
    dbScanUnlock(prec);
}

/* One priority of the pass is over. The last one reports it and begins the next pass. */
static void finish(plcScan *scan)
{
    epicsUInt64 since = 0;
    unsigned prios = 0;
    int over;

    epicsMutexMustLock(scan->lock);
    over = --scan->remaining == 0;
    if (over) {
        since = scan->runningSince;
        over = !scan->partial;
        scan->busy = 0;
        if (interruptAccept)
            prios = plcScanBegin(scan);
    }
    epicsMutexUnlock(scan->lock);
    if (over && scan->done)
        scan->done(scan->pvt, since);
    plcScanQueue(scan, prios);
}

/* The next records of one priority of a pass. Half of the time that many records take is
 * waiting for memory, if nothing fetches them ahead. Returns how many, 0 at the end. */
PLC_HOT static unsigned runBatch(part *own)
{
    target targets[BATCH];
    unsigned n = nextTargets(own->scan, own, targets), i;

    for (i = 0; i < FAR; i++)
        fetchFields(targets, n, i);
    for (i = 0; i < NEAR; i++)
        fetchTargets(targets, n, i);
    for (i = 0; i < n; i++) {
        fetchFields(targets, n, i + FAR);
        fetchTargets(targets, n, i + NEAR);
        processTarget(&targets[i], own->prio);
    }
    return n;
}

/* One priority of a pass, or what is left of it. */
PLC_HOT static void runPart(part *own)
{
    while (runBatch(own) > 0)
        ;
    finish(own->scan);
}

/* Runs in a callback thread of this priority. */
void plcScanPass(epicsCallback *callback)
{
    void *own;

    callbackGetUser(own, callback);
    runPart(own);
}

/* True when the pass over these priorities may begin in the thread that asks for it. */
static int mayRunHere(plcScan *scan, unsigned prios)
{
    return scan->here && !scan->held && bitCount(prios) == 1;
}

static void keepAway(plcScan *scan, epicsUInt64 took)
{
    epicsMutexMustLock(scan->lock);
    scan->held = took;
    epicsMutexUnlock(scan->lock);
}

/* A pass in the thread that asks for it: to wake another one costs as much as some hundred
 * records. Of a large one the first records, which then need not wait for that; the rest
 * is not for this thread. Only when all records have one priority, so that none waits for
 * less important ones; never again when it took long: some record makes others wait. */
static void runHere(plcScan *scan, unsigned prios, int all)
{
    epicsUInt64 start = epicsMonotonicGet(), took;
    int prio = 0;

    while (!(prios & 1u << prio))
        prio++;
    if (all) {
        runPart(&scan->part[prio]);
    } else {
        runBatch(&scan->part[prio]);
        plcScanQueue(scan, prios);
    }
    took = epicsMonotonicGet() - start;
    if (took > HERE_NS)
        keepAway(scan, took);
}

/* The request is marked as pending: begins a pass unless one runs. Lock held; unlocks.
 * Like scanIoRequest nothing is processed before iocInit is through or while the IOC is
 * paused, but it stays pending for the next request. */
PLC_HOT static void request(plcScan *scan)
{
    unsigned prios = 0;
    int here, all;

    if (interruptAccept) {
        scan->live = 1;
        if (!scan->pendingSince)
            scan->pendingSince = epicsMonotonicGet();
        if (!scan->busy)
            prios = plcScanBegin(scan);
    }
    here = mayRunHere(scan, prios);
    all = scan->size <= HERE_RECORDS;
    epicsMutexUnlock(scan->lock);
    if (here)
        runHere(scan, prios, all);
    else
        plcScanQueue(scan, prios);
}

int plcScanRequestAll(plcScan *scan)
{
    int waiting;

    epicsMutexMustLock(scan->lock);
    waiting = scan->pendingSince != 0;
    scan->allPending = ALL_PRIOS;
    request(scan);
    return waiting;
}

PLC_HOT int plcScanRequestChanged(plcScan *scan, const void *before, const void *after)
{
    int waiting;

    if (!scan->byRange)
        return plcScanRequestAll(scan);
    epicsMutexMustLock(scan->lock);
    waiting = scan->pendingSince != 0;
    if (scan->allPending != ALL_PRIOS)
        plcScanTouch(scan, before, after);
    if (!scan->allPending && !scan->numPending && !scan->newPending.count) {
        epicsMutexUnlock(scan->lock);
        return 0;
    }
    request(scan);
    return waiting;
}

void plcScanResume(plcScan *scan)
{
    epicsMutexMustLock(scan->lock);
    request(scan);
}

int plcScanBusy(plcScan *scan)
{
    int busy;

    epicsMutexMustLock(scan->lock);
    busy = scan->busy;
    epicsMutexUnlock(scan->lock);
    return busy;
}

PLC_HOT unsigned plcScanCount(plcScan *scan)
{
    return (unsigned)epicsAtomicGetIntT(&scan->total);
}
