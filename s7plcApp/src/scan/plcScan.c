/* I/O Intr scanning: groups of records, who joins and leaves; see plcScan.h.
 *
 * Knows byte ranges, not types or sockets. Which groups a change touches is in plcScanIndex.c,
 * passes over them in plcScanPass.c.
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <dbAccess.h>
#include <epicsAtomic.h>

#include "plcHot.h"
#include "plcScanPvt.h"

/* --- Groups ------------------------------------------------------------------------ */

static size_t hash(const plcScan *scan, size_t offset, size_t length)
{
    epicsUInt64 key = (epicsUInt64)offset * 0x9E3779B97F4A7C15ull + length;

    key *= 0xFF51AFD7ED558CCDull;
    return (size_t)(key >> 32) & (scan->numBuckets - 1);
}

static group *findGroup(const plcScan *scan, size_t offset, size_t length)
{
    group *g = scan->buckets[hash(scan, offset, length)];

    while (g && (g->offset != offset || g->length != length))
        g = g->next;
    return g;
}

static group **growArray(group **old, size_t used, size_t room)
{
    group **array = callocMustSucceed(room, sizeof(*array), "plcScan");

    if (used)
        memcpy(array, old, used * sizeof(*array));
    free(old);
    return array;
}

static void addBulk(plcScan *scan, size_t count)
{
    bulk *b = callocMustSucceed(1, sizeof(*b) + LINE + count * sizeof(group), "plcScan");
    size_t past = (size_t)b->memory % LINE;

    b->unused = (group *)(b->memory + (past ? LINE - past : 0));
    b->next = scan->bulks;
    scan->bulks = b;
}

/* Room for twice as many groups; the hash grows with them. */
static void grow(plcScan *scan)
{
    size_t i;

    addBulk(scan, scan->room ? scan->room : 1);
    scan->room = scan->room ? 2 * scan->room : 1;
    scan->groups = growArray(scan->groups, scan->numGroups, scan->room);
    scan->pending = growArray(scan->pending, scan->numPending, scan->room);
    scan->running = growArray(scan->running, scan->numRunning, scan->room);
    free(scan->buckets);
    scan->numBuckets = 2 * scan->room;
    scan->buckets =
        callocMustSucceed(scan->numBuckets, sizeof(*scan->buckets), "plcScan");
    for (i = 0; i < scan->numGroups; i++) {
        group *g = scan->groups[i];
        group **bucket = &scan->buckets[hash(scan, g->offset, g->length)];

        g->next = *bucket;
        *bucket = g;
    }
}

static group *addGroup(plcScan *scan, size_t offset, size_t length)
{
    group *g, **bucket;

    if (scan->numGroups == scan->room)
        grow(scan);
    g = scan->bulks->unused++;
    g->offset = (epicsUInt32)offset;
    g->length = (epicsUInt32)length;
    g->records = &g->only;
    g->room = 1;
    bucket = &scan->buckets[hash(scan, offset, length)];
    g->next = *bucket;
    *bucket = g;
    scan->groups[scan->numGroups++] = g;
    scan->indexOld = 1;
    return g;
}

plcScan *plcScanCreate(size_t blockSize, plcScanDone *done, void *pvt)
{
    plcScan *scan = callocMustSucceed(1, sizeof(*scan), "plcScanCreate");
    int prio;

    scan->lock = epicsMutexMustCreate();
    scan->blockSize = scan->used = blockSize;
    scan->done = done;
    scan->pvt = pvt;
    for (prio = 0; prio < NUM_CALLBACK_PRIORITIES; prio++) {
        part *own = &scan->part[prio];

        own->scan = scan;
        own->prio = prio;
        callbackSetCallback(plcScanPass, &own->callback);
        callbackSetPriority(prio, &own->callback);
        callbackSetUser(own, &own->callback);
    }
    grow(scan);
    scan->indexOld = 1; /* there is none yet */
    return scan;
}

void plcScanDestroy(plcScan *scan)
{
    bulk *b;
    size_t i;

    if (!scan)
        return;
    plcScanFreeTimer(scan);
    for (i = 0; i < scan->numGroups; i++) {
        group *g = scan->groups[i];

        if (g->records != &g->only)
            free(g->records);
        free(g->others);
    }
    while ((b = scan->bulks)) {
        scan->bulks = b->next;
        free(b);
    }
    free(scan->groups);
    free(scan->pending);
    free(scan->running);
    free(scan->buckets);
    free(scan->wordStart);
    free(scan->entries);
    free(scan->wide);
    free(scan->newPending.list);
    free(scan->newRunning.list);
    epicsMutexDestroy(scan->lock);
    free(scan);
}

void plcScanByRange(plcScan *scan, int byRange)
{
    epicsMutexMustLock(scan->lock);
    scan->byRange = byRange;
    epicsMutexUnlock(scan->lock);
}

void plcScanHere(plcScan *scan, int on)
{
    epicsMutexMustLock(scan->lock);
    scan->here = on;
    epicsMutexUnlock(scan->lock);
}

double plcScanHeld(plcScan *scan)
{
    double ms;

    epicsMutexMustLock(scan->lock);
    ms = (double)scan->held / 1e6;
    epicsMutexUnlock(scan->lock);
    return ms;
}

void plcScanUse(plcScan *scan, size_t size)
{
    epicsMutexMustLock(scan->lock);
    scan->used = size;
    scan->indexOld = 1;
    epicsMutexUnlock(scan->lock);
}

/* The group for these bytes; a new one when there is none. Lock held. */
static group *groupOf(plcScan *scan, size_t offset, size_t length)
{
    group *g;

    if (!scan->byRange) {
        offset = 0;
        length = scan->blockSize;
    } else {
        if (offset > scan->blockSize)
            offset = scan->blockSize;
        if (length > scan->blockSize - offset)
            length = scan->blockSize - offset;
    }
    g = findGroup(scan, offset, length);
    return g ? g : addGroup(scan, offset, length);
}

/* Lock held. */
static void countRecords(plcScan *scan, int prio, int by)
{
    scan->count[prio] += by;
    epicsAtomicAddIntT(&scan->total, by);
}

static int isPriority(int prio)
{
    return prio >= 0 && prio < NUM_CALLBACK_PRIORITIES;
}

/* Records whose priority is not known: passes go through all of them. Lock held. */
static void joinAnyPrio(plcScan *scan, otherRecords *others)
{
    int prio;

    for (prio = 0; !others->anyPrio && prio < NUM_CALLBACK_PRIORITIES; prio++)
        scan->count[prio]++;
    others->anyPrio = 1;
    epicsAtomicAddIntT(&scan->total, 1);
}

IOSCANPVT plcScanJoin(plcScan *scan, size_t offset, size_t length, int prio, int leave)
{
    IOSCANPVT list;
    group *g;

    epicsMutexMustLock(scan->lock);
    g = groupOf(scan, offset, length);
    if (!g->others) {
        g->others = callocMustSucceed(1, sizeof(*g->others), "plcScan");
        scanIoInit(&g->others->list);
    }
    list = g->others->list;
    if (prio == PLC_SCAN_ANY_PRIO) {
        joinAnyPrio(scan, g->others);
    } else if (isPriority(prio) && !leave) {
        g->others->count[prio]++;
        countRecords(scan, prio, 1);
    } else if (isPriority(prio) && g->others->count[prio] > 0) {
        g->others->count[prio]--;
        countRecords(scan, prio, -1);
    }
    epicsMutexUnlock(scan->lock);
    return list;
}

/* --- Our own records --------------------------------------------------------------- */

static void makeRoom(group *g)
{
    unsigned used = sizeOf(g);
    dbCommon **records;

    if (used < g->room)
        return;
    g->room = 2 * g->room;
    records = callocMustSucceed(g->room, sizeof(*records), "plcScan");
    memcpy(records, g->records, used * sizeof(*records));
    if (g->records != &g->only)
        free(g->records);
    g->records = records;
}

/* The place of a new record among the `count` that start at `own`: behind its PHAS. */
static unsigned placeOf(dbCommon *const *own, unsigned count, short phas)
{
    unsigned low = 0, high = count;

    if (count && own[count - 1]->phas <= phas)
        return count;
    while (low < high) {
        unsigned middle = (low + high) / 2;

        if (own[middle]->phas <= phas)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* A pass that is inside of this group neither skips nor repeats another record. */
static void shiftCursor(plcScan *scan, const group *g, int prio, unsigned place, int by)
{
    cursor *at = &scan->part[prio].at;

    if (at->inside == g && place < at->index)
        at->index += by;
}

static void insert(plcScan *scan, group *g, dbCommon *prec)
{
    int prio = prec->prio;
    unsigned used = sizeOf(g), place;
    dbCommon **own;

    makeRoom(g);
    own = g->records + firstOf(g, prio);
    place = placeOf(own, g->count[prio], prec->phas);
    own += place;
    memmove(own + 1, own, (g->records + used - own) * sizeof(*own));
    *own = prec;
    g->count[prio]++;
    countRecords(scan, prio, 1);
    shiftCursor(scan, g, prio, place, 1);
}

static void removeRecord(plcScan *scan, group *g, const dbCommon *prec)
{
    int prio = prec->prio;
    unsigned used = sizeOf(g), place = 0;
    dbCommon **own = g->records + firstOf(g, prio);

    while (place < g->count[prio] && own[place] != prec)
        place++;
    if (place == g->count[prio])
        return;
    own += place;
    memmove(own, own + 1, (g->records + used - own - 1) * sizeof(*own));
    g->count[prio]--;
    countRecords(scan, prio, -1);
    shiftCursor(scan, g, prio, place, -1);
}

static void dropNewcomer(newcomers *n, const dbCommon *prec)
{
    size_t i;

    for (i = 0; i < n->count; i++) {
        if (n->list[i].record == prec)
            n->list[i].record = NULL;
    }
}

IOSCANPVT plcScanRecord(plcScan *scan, size_t offset, size_t length, dbCommon *prec,
                        int leave)
{
    unsigned prios = 0;
    group *g;

    epicsMutexMustLock(scan->lock);
    if (!scan->parked)
        scanIoInit(&scan->parked);
    g = groupOf(scan, offset, length);
    if (isPriority(prec->prio) && leave) {
        removeRecord(scan, g, prec);
        dropNewcomer(&scan->newPending, prec);
        dropNewcomer(&scan->newRunning, prec);
    } else if (isPriority(prec->prio)) {
        insert(scan, g, prec);
        if (scan->live)
            plcScanAddNewcomer(&scan->newPending, prec, g);
        if (scan->live && interruptAccept && !scan->busy)
            prios = plcScanBegin(scan);
    }
    epicsMutexUnlock(scan->lock);
    plcScanQueue(scan, prios);
    return scan->parked;
}
