/* I/O Intr scanning: passes over groups of records, never more than one at a time.
 *
 * Knows byte ranges, not types or sockets.
 *
 *   request --> pending --(begin)--> running --(last priority ends)--> done()
 *                  ^                    |                                |
 *                  +-- queue was full --+      pending again? begin  <---+
 *
 * One mutex guards all of a plcScan. It is never held while callbackRequest,
 * dbProcess, scanIoImmediate or done() run. Our own way through the records does without
 * the lock of Base's scan lists at each of them, and has the next ones brought into the
 * cache while one is processed. A set of priorities is a mask with bit 1 << prio.
 */
#include <stdlib.h>
#include <string.h>

#include <callback.h>
#include <cantProceed.h>
#include <compilerSpecific.h>
#include <dbAccess.h>
#include <dbCommon.h>
#include <dbLock.h>
#include <epicsAtomic.h>
#include <epicsMutex.h>
#include <epicsThread.h>
#include <epicsTime.h>
#include <epicsTimer.h>

#include "plcHot.h"
#include "plcScan.h"

#define ALL_PRIOS ((1u << NUM_CALLBACK_PRIORITIES) - 1)
#define WORD 8          /* bytes; the index knows which groups touch a word */
#define CHUNK 512       /* bytes compared at once; a multiple of WORD */
#define WIDE (8 * WORD) /* groups longer than this are not in the index */
#define LINE 64         /* bytes of a cache line */
#define BATCH 64        /* records copied under the lock, then processed without it */

#define HERE_RECORDS 2000 /* a pass of more only begins in the thread that asks for it; */
#define HERE_NS 20000000  /* after one that took longer there, it never gets another */

#define AGAIN_S 0.05 /* a pass is asked for again so long after its queue was full */

#ifdef __GNUC__
#define FETCH(address) __builtin_prefetch(address)
#else
#define FETCH(address) ((void)(address))
#endif

/* Records of others, in a list of Base's: plcScanJoin. */
typedef struct strangers {
    IOSCANPVT list;
    unsigned count[NUM_CALLBACK_PRIORITIES];
    int anyPrio; /* there are some of which not even the priority is known */
} strangers;

/* Records that read the same bytes. Our own ones stand in `records` by priority, then by
 * PHAS, then as they came. */
typedef struct group {
    epicsUInt32 offset, length;
    struct group *next; /* in its hash bucket */
    dbCommon **records;
    dbCommon *only; /* where `records` points to while there is room for one */
    epicsUInt32 room;
    epicsUInt32 count[NUM_CALLBACK_PRIORITIES]; /* of `records` */
    epicsUInt8 pending; /* priorities that wait; not 0: is in scan->pending */
    epicsUInt8 running; /* priorities of the running pass */
    strangers *others;  /* NULL: none yet */
} group;

/* An entry of the index: says whether a group is touched, without looking at the group. */
typedef struct entry {
    epicsUInt32 offset, length;
    group *group;
} entry;

/* Memory for many groups. Each fills one line of the cache, and begins with it. */
typedef struct bulk {
    struct bulk *next;
    group *unused; /* the first of those that are left */
    char memory[];
} bulk;

/* Records of our own that have joined, and were in no pass yet. */
typedef struct newcomer {
    dbCommon *record; /* NULL: has left again */
    group *group;
} newcomer;

typedef struct newcomers {
    newcomer *list;
    size_t count, room;
} newcomers;

/* What is next in a pass, for one priority. */
typedef struct cursor {
    size_t newcomer; /* number of the newcomer; after them */
    size_t group;   /* number of the group in the pass, */
    group *inside;  /* the group itself */
    unsigned index; /* and number of the record among those of this priority in it */
} cursor;

/* One step of a pass: a record, or a list of Base's. */
typedef struct target {
    dbCommon *record;
    IOSCANPVT list;
} target;

/* What a callback needs to know, one for each priority */
typedef struct part {
    epicsCallback callback;
    plcScan *scan;
    int prio;
    cursor at;
} part;

struct plcScan {
    epicsMutexId lock;
    size_t blockSize;
    plcScanDone *done;
    void *pvt;
    int byRange;
    IOSCANPVT parked;   /* where Base keeps the records that we process; never scanned */
    int here;           /* passes may run in the thread that asks for them */
    epicsUInt64 held;   /* how long one of them held that thread up, ns; 0: none did */
    part part[NUM_CALLBACK_PRIORITIES];
    unsigned count[NUM_CALLBACK_PRIORITIES]; /* records in all groups */
    int total;          /* atomic: their sum */

    group **groups; /* all of them; with room for `room`, as the two arrays below */
    size_t numGroups, room;
    group **pending;
    size_t numPending;
    group **running;
    size_t numRunning;
    size_t size;         /* records of the running pass */
    unsigned allPending; /* priorities for which all groups wait */
    unsigned allRunning; /* priorities for which the pass has all groups */
    int busy;            /* a pass runs */
    unsigned remaining;  /* priorities of the pass that are not yet over */
    int partial;         /* a priority of the pass could not be queued */
    int live;            /* there was a pass, or would have been with records */
    newcomers newPending, newRunning;
    epicsUInt64 pendingSince, runningSince; /* ns; 0: no one asked while scans were on */
    epicsTimerId again; /* NULL: no queue was full yet */

    group **buckets; /* hash of (offset, length); a power of 2 */
    size_t numBuckets;
    bulk *bulks;

    int indexOld;           /* groups came since the index was built */
    epicsUInt32 *wordStart; /* word i has the groups in entries[wordStart[i] .. [i+1]) */
    entry *entries;
    entry *wide;
    size_t numWide;
};

static epicsTimerQueueId timers; /* of all scans */
static epicsThreadOnceId timersOnce = EPICS_THREAD_ONCE_INIT;

static void pass(epicsCallback *callback);
static unsigned begin(plcScan *scan);
static void queue(plcScan *scan, unsigned prios);

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
    scan->blockSize = blockSize;
    scan->done = done;
    scan->pvt = pvt;
    for (prio = 0; prio < NUM_CALLBACK_PRIORITIES; prio++) {
        part *own = &scan->part[prio];

        own->scan = scan;
        own->prio = prio;
        callbackSetCallback(pass, &own->callback);
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
    if (scan->again)
        epicsTimerQueueDestroyTimer(timers, scan->again);
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
static void joinAnyPrio(plcScan *scan, strangers *others)
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

/* Where those of a priority begin in g->records. */
static unsigned firstOf(const group *g, int prio)
{
    unsigned first = 0;

    while (prio-- > 0)
        first += g->count[prio];
    return first;
}

static unsigned sizeOf(const group *g)
{
    return firstOf(g, NUM_CALLBACK_PRIORITIES);
}

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

static void addNewcomer(newcomers *n, dbCommon *prec, group *g)
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
            addNewcomer(&scan->newPending, prec, g);
        if (scan->live && interruptAccept && !scan->busy)
            prios = begin(scan);
    }
    epicsMutexUnlock(scan->lock);
    queue(scan, prios);
    return scan->parked;
}

/* --- Which groups a change touches ------------------------------------------------- */

/* First and last word that a group touches. Its length is not 0. */
static size_t firstWord(const group *g)
{
    return g->offset / WORD;
}

static size_t lastWord(const group *g)
{
    return (g->offset + g->length - 1) / WORD;
}

static entry entryOf(group *g)
{
    entry e = {g->offset, g->length, g};

    return e;
}

/* Counts the groups of each word, then fills them in behind each other. */
PLC_COLD static void buildIndex(plcScan *scan)
{
    size_t numWords = scan->blockSize / WORD + 1;
    size_t i, w;

    free(scan->wordStart);
    free(scan->entries);
    free(scan->wide);
    scan->wordStart =
        callocMustSucceed(numWords + 2, sizeof(*scan->wordStart), "plcScan");
    scan->wide = callocMustSucceed(scan->numGroups + 1, sizeof(entry), "plcScan");
    scan->numWide = 0;
    for (i = 0; i < scan->numGroups; i++) {
        group *g = scan->groups[i];

        if (g->length > WIDE)
            scan->wide[scan->numWide++] = entryOf(g);
        else if (g->length)
            for (w = firstWord(g); w <= lastWord(g); w++)
                scan->wordStart[w + 2]++;
    }
    for (w = 2; w < numWords + 2; w++)
        scan->wordStart[w] += scan->wordStart[w - 1];
    scan->entries =
        callocMustSucceed(scan->wordStart[numWords + 1] + 1, sizeof(entry), "plcScan");
    for (i = 0; i < scan->numGroups; i++) {
        group *g = scan->groups[i];

        if (g->length && g->length <= WIDE)
            for (w = firstWord(g); w <= lastWord(g); w++)
                scan->entries[scan->wordStart[w + 1]++] = entryOf(g);
    }
    scan->indexOld = 0;
}

static void addPending(plcScan *scan, group *g, unsigned prios)
{
    if (prios && !g->pending)
        scan->pending[scan->numPending++] = g;
    g->pending |= (epicsUInt8)prios;
}

static int isTouched(const entry *e, const char *before, const char *after)
{
    return memcmp(before + e->offset, after + e->offset, e->length) != 0;
}

static void addTouched(plcScan *scan, group *const groups[], unsigned n)
{
    unsigned i;

    for (i = 0; i < n; i++)
        addPending(scan, groups[i], ALL_PRIOS);
}

/* Adds the words in [at, end) that changed to the n that are there. Returns the new n. */
static unsigned changedWords(const char *before, const char *after, size_t at, size_t end,
                             epicsUInt32 words[], unsigned n)
{
    for (; end - at >= WORD; at += WORD) {
        epicsUInt64 old, new;

        memcpy(&old, before + at, WORD);
        memcpy(&new, after + at, WORD);
        words[n] = (epicsUInt32)(at / WORD);
        n += old != new;
    }
    if (at < end && memcmp(before + at, after + at, end - at) != 0)
        words[n++] = (epicsUInt32)(at / WORD);
    return n;
}

/* The touched groups of these words. In steps, so that the cache fetches what the next one
 * needs for many words, or groups, at a time. */
PLC_HOT static void touchWords(plcScan *scan, const char *before, const char *after,
                               const epicsUInt32 words[], unsigned n)
{
    const epicsUInt32 *start = scan->wordStart;
    group *touched[BATCH];
    unsigned i, m = 0;
    size_t k;

    for (i = 0; i < n; i++)
        FETCH(&scan->entries[start[words[i]]]);
    for (i = 0; i < n; i++) {
        for (k = start[words[i]]; k < start[words[i] + 1]; k++) {
            if (!isTouched(&scan->entries[k], before, after))
                continue;
            if (m == BATCH) {
                addTouched(scan, touched, m);
                m = 0;
            }
            FETCH(scan->entries[k].group);
            touched[m++] = scan->entries[k].group;
        }
    }
    addTouched(scan, touched, m);
}

/* Marks the groups whose bytes differ as pending. */
PLC_HOT static void touchChanged(plcScan *scan, const char *before, const char *after)
{
    epicsUInt32 words[2 * CHUNK / WORD] = {0};
    int changed = 0;
    unsigned m, n = 0;
    size_t at, i;

    if (scan->indexOld)
        buildIndex(scan);
    for (at = 0; at < scan->blockSize; at += CHUNK) {
        size_t length = scan->blockSize - at < CHUNK ? scan->blockSize - at : CHUNK;

        if (memcmp(before + at, after + at, length) == 0)
            continue;
        changed = 1;
        m = n;
        n = changedWords(before, after, at, at + length, words, n);
        for (; m < n; m++)
            FETCH(&scan->wordStart[words[m]]);
        if (n > CHUNK / WORD) {
            touchWords(scan, before, after, words, n);
            n = 0;
        }
    }
    touchWords(scan, before, after, words, n);
    for (i = 0; changed && i < scan->numWide; i++) {
        if (isTouched(&scan->wide[i], before, after))
            addPending(scan, scan->wide[i].group, ALL_PRIOS);
    }
}

/* --- Passes ------------------------------------------------------------------------ */

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

/* The same for newcomers. Returns their priorities. */
static unsigned beginNewcomers(plcScan *scan)
{
    newcomers spare = scan->newRunning;
    unsigned prios = 0;
    size_t i;

    scan->newRunning = scan->newPending;
    scan->newPending = spare;
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
PLC_HOT static unsigned begin(plcScan *scan)
{
    group **spare = scan->running;
    unsigned prios;
    size_t i;

    scan->running = scan->pending;
    scan->numRunning = scan->numPending;
    scan->pending = spare;
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
    epicsTimerId mine, spare = NULL;

    epicsThreadOnce(&timersOnce, startTimers, NULL);
    epicsMutexMustLock(scan->lock);
    mine = scan->again;
    epicsMutexUnlock(scan->lock);
    if (!mine) {
        mine = epicsTimerQueueCreateTimer(timers, again, scan);
        epicsMutexMustLock(scan->lock);
        if (scan->again) { /* of another priority, just now */
            spare = mine;
            mine = scan->again;
        }
        scan->again = mine;
        epicsMutexUnlock(scan->lock);
    }
    if (spare)
        epicsTimerQueueDestroyTimer(timers, spare);
    epicsTimerStartDelay(mine, AGAIN_S);
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
            addNewcomer(&scan->newPending, n->record, n->group);
            n->record = NULL;
        }
    }
    scan->pendingSince = scan->runningSince;
    scan->partial = 1;
    scan->remaining -= bitCount(prios);
    if (scan->remaining == 0)
        scan->busy = 0;
    epicsMutexUnlock(scan->lock);
    askAgain(scan);
}

/* Queues one callback for each of these priorities of the pass, the highest first. */
static void queue(plcScan *scan, unsigned prios)
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
        prios = begin(scan);
    epicsMutexUnlock(scan->lock);
    queue(scan, prios);
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
            prios = begin(scan);
    }
    epicsMutexUnlock(scan->lock);
    if (over && scan->done)
        scan->done(scan->pvt, since);
    queue(scan, prios);
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
static void pass(epicsCallback *callback)
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
        queue(scan, prios);
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
            prios = begin(scan);
    }
    here = mayRunHere(scan, prios);
    all = scan->size <= HERE_RECORDS;
    epicsMutexUnlock(scan->lock);
    if (here)
        runHere(scan, prios, all);
    else
        queue(scan, prios);
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
        touchChanged(scan, before, after);
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
