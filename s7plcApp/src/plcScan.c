/* I/O Intr scanning: passes over groups of records, never more than one at a time.
 *
 * Knows byte ranges, not types or sockets.
 *
 *   request --> pending --(begin)--> running --(last priority ends)--> done()
 *                  ^                    |                                |
 *                  +-- queue was full --+      pending again? begin  <---+
 *
 * One mutex guards all of a plcScan. It is never held while callbackRequest,
 * scanIoImmediate or done() run. A set of priorities is a mask with bit 1 << prio.
 */
#include <stdlib.h>
#include <string.h>

#include <callback.h>
#include <cantProceed.h>
#include <dbAccess.h>
#include <epicsMutex.h>
#include <epicsTime.h>

#include "plcScan.h"

#define ALL_PRIOS ((1u << NUM_CALLBACK_PRIORITIES) - 1)
#define WORD 8          /* bytes; the index knows which groups touch a word */
#define CHUNK 512       /* bytes compared at once; a multiple of WORD */
#define WIDE (8 * WORD) /* groups longer than this are not in the index */
#define BATCH 64        /* groups copied under the lock, then processed without it */

typedef struct group {
    IOSCANPVT list;
    size_t offset;
    size_t length;
    struct group *next; /* in its hash bucket */
    unsigned count[NUM_CALLBACK_PRIORITIES];
    unsigned pending; /* priorities that wait; not 0: is in scan->pending */
    unsigned running; /* priorities of the running pass */
} group;

/* What a callback needs to know, one for each priority */
typedef struct part {
    epicsCallback callback;
    plcScan *scan;
    int prio;
} part;

struct plcScan {
    epicsMutexId lock;
    size_t blockSize;
    plcScanDone *done;
    void *pvt;
    int byRange;
    part part[NUM_CALLBACK_PRIORITIES];
    unsigned count[NUM_CALLBACK_PRIORITIES]; /* records in all groups */

    group **groups; /* all of them; with room for `room`, as the two arrays below */
    size_t numGroups, room;
    group **pending;
    size_t numPending;
    group **running;
    size_t numRunning;
    unsigned allPending; /* priorities for which all groups wait */
    unsigned allRunning; /* priorities for which the pass has all groups */
    int busy;            /* a pass runs */
    unsigned remaining;  /* priorities of the pass that are not yet over */
    int partial;         /* a priority of the pass could not be queued */
    epicsUInt64 pendingSince, runningSince; /* ns; 0: no one asked while scans were on */

    group **buckets; /* hash of (offset, length); a power of 2 */
    size_t numBuckets;

    int indexOld;      /* groups came since the index was built */
    size_t *wordStart; /* word i has the groups wordGroups[wordStart[i] .. [i+1]) */
    group **wordGroups;
    group **wide;
    size_t numWide;
};

static void pass(epicsCallback *callback);

/* --- Groups ------------------------------------------------------------------------- */

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

/* Room for twice as many groups; the hash grows with them. */
static void grow(plcScan *scan)
{
    size_t i;

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
    group *g = callocMustSucceed(1, sizeof(*g), "plcScan");
    group **bucket;

    scanIoInit(&g->list);
    g->offset = offset;
    g->length = length;
    if (scan->numGroups == scan->room)
        grow(scan);
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
    return scan;
}

void plcScanDestroy(plcScan *scan)
{
    size_t i;

    if (!scan)
        return;
    for (i = 0; i < scan->numGroups; i++)
        free(scan->groups[i]);
    free(scan->groups);
    free(scan->pending);
    free(scan->running);
    free(scan->buckets);
    free(scan->wordStart);
    free(scan->wordGroups);
    free(scan->wide);
    epicsMutexDestroy(scan->lock);
    free(scan);
}

void plcScanByRange(plcScan *scan, int byRange)
{
    epicsMutexMustLock(scan->lock);
    scan->byRange = byRange;
    epicsMutexUnlock(scan->lock);
}

IOSCANPVT plcScanJoin(plcScan *scan, size_t offset, size_t length, int prio, int leave)
{
    IOSCANPVT list;
    group *g;

    epicsMutexMustLock(scan->lock);
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
    if (!g)
        g = addGroup(scan, offset, length);
    list = g->list;
    if (prio >= 0 && prio < NUM_CALLBACK_PRIORITIES) {
        if (!leave) {
            g->count[prio]++;
            scan->count[prio]++;
        } else if (g->count[prio] > 0) {
            g->count[prio]--;
            scan->count[prio]--;
        }
    }
    epicsMutexUnlock(scan->lock);
    return list;
}

/* --- Which groups a change touches -------------------------------------------------- */

/* First and last word that a group touches. Its length is not 0. */
static size_t firstWord(const group *g)
{
    return g->offset / WORD;
}

static size_t lastWord(const group *g)
{
    return (g->offset + g->length - 1) / WORD;
}

/* Counts the groups of each word, then fills them in behind each other. */
static void buildIndex(plcScan *scan)
{
    size_t numWords = scan->blockSize / WORD + 1;
    size_t i, w;

    free(scan->wordStart);
    free(scan->wordGroups);
    free(scan->wide);
    scan->wordStart = callocMustSucceed(numWords + 2, sizeof(size_t), "plcScan");
    scan->wide = callocMustSucceed(scan->numGroups + 1, sizeof(group *), "plcScan");
    scan->numWide = 0;
    for (i = 0; i < scan->numGroups; i++) {
        group *g = scan->groups[i];

        if (g->length > WIDE)
            scan->wide[scan->numWide++] = g;
        else if (g->length)
            for (w = firstWord(g); w <= lastWord(g); w++)
                scan->wordStart[w + 2]++;
    }
    for (w = 2; w < numWords + 2; w++)
        scan->wordStart[w] += scan->wordStart[w - 1];
    scan->wordGroups =
        callocMustSucceed(scan->wordStart[numWords + 1] + 1, sizeof(group *), "plcScan");
    for (i = 0; i < scan->numGroups; i++) {
        group *g = scan->groups[i];

        if (g->length && g->length <= WIDE)
            for (w = firstWord(g); w <= lastWord(g); w++)
                scan->wordGroups[scan->wordStart[w + 1]++] = g;
    }
    scan->indexOld = 0;
}

static void addPending(plcScan *scan, group *g, unsigned prios)
{
    if (prios && !g->pending)
        scan->pending[scan->numPending++] = g;
    g->pending |= prios;
}

static void touchGroup(plcScan *scan, group *g, const char *before, const char *after)
{
    if (g->pending != ALL_PRIOS &&
        memcmp(before + g->offset, after + g->offset, g->length) != 0)
        addPending(scan, g, ALL_PRIOS);
}

/* The groups of all words in [at, end) that changed. */
static void touchWords(plcScan *scan, const char *before, const char *after, size_t at,
                       size_t end)
{
    for (; at < end; at += WORD) {
        size_t length = end - at < WORD ? end - at : WORD;
        size_t i;

        if (memcmp(before + at, after + at, length) == 0)
            continue;
        for (i = scan->wordStart[at / WORD]; i < scan->wordStart[at / WORD + 1]; i++)
            touchGroup(scan, scan->wordGroups[i], before, after);
    }
}

/* Marks the groups whose bytes differ as pending. Returns their number. */
static size_t touchChanged(plcScan *scan, const char *before, const char *after)
{
    size_t waiting = scan->numPending;
    int changed = 0;
    size_t at, i;

    if (scan->indexOld)
        buildIndex(scan);
    for (at = 0; at < scan->blockSize; at += CHUNK) {
        size_t length = scan->blockSize - at < CHUNK ? scan->blockSize - at : CHUNK;

        if (memcmp(before + at, after + at, length) == 0)
            continue;
        changed = 1;
        touchWords(scan, before, after, at, at + length);
    }
    for (i = 0; changed && i < scan->numWide; i++)
        touchGroup(scan, scan->wide[i], before, after);
    return scan->numPending - waiting;
}

/* --- Passes ------------------------------------------------------------------------- */

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

static unsigned bitCount(unsigned prios)
{
    return (prios & 1) + (prios >> 1 & 1) + (prios >> 2 & 1);
}

/* Makes what is pending the running pass. Returns its priorities: none when no record is
 * concerned, then no pass runs. Lock held; no pass runs. */
static unsigned begin(plcScan *scan)
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
    prios = scan->allRunning;
    for (i = 0; i < scan->numRunning; i++) {
        group *g = scan->running[i];

        g->running = inUse(g->count, g->pending);
        g->pending = 0;
        prios |= g->running;
    }
    scan->runningSince = scan->pendingSince;
    scan->pendingSince = 0;
    scan->busy = prios != 0;
    scan->remaining = bitCount(prios);
    scan->partial = 0;
    return prios;
}

/* These priorities could not be queued: they wait for the next request. */
static void putBack(plcScan *scan, unsigned prios)
{
    size_t i;

    epicsMutexMustLock(scan->lock);
    scan->allPending |= scan->allRunning & prios;
    scan->allRunning &= ~prios;
    for (i = 0; i < scan->numRunning; i++) {
        addPending(scan, scan->running[i], scan->running[i]->running & prios);
        scan->running[i]->running &= ~prios;
    }
    scan->pendingSince = scan->runningSince;
    scan->partial = 1;
    scan->remaining -= bitCount(prios);
    if (scan->remaining == 0)
        scan->busy = 0;
    epicsMutexUnlock(scan->lock);
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

/* The lists of the next groups that the pass has for this priority, from group number *at
 * on. Returns how many, 0 at the end. */
static unsigned nextLists(plcScan *scan, int prio, size_t *at, IOSCANPVT lists[BATCH])
{
    unsigned bit = 1u << prio;
    unsigned n = 0;
    int all;

    epicsMutexMustLock(scan->lock);
    all = (scan->allRunning & bit) != 0;
    while (n < BATCH && *at < (all ? scan->numGroups : scan->numRunning)) {
        group *g = all ? scan->groups[*at] : scan->running[*at];

        ++*at;
        if (g->count[prio] && (all || g->running & bit))
            lists[n++] = g->list;
    }
    epicsMutexUnlock(scan->lock);
    return n;
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

/* Runs in a callback thread of this priority. */
static void pass(epicsCallback *callback)
{
    IOSCANPVT lists[BATCH];
    part *own;
    plcScan *scan;
    size_t at = 0;
    unsigned n, i;
    void *user;

    callbackGetUser(user, callback);
    own = user;
    scan = own->scan;
    while ((n = nextLists(scan, own->prio, &at, lists)) > 0) {
        for (i = 0; i < n; i++)
            scanIoImmediate(lists[i], own->prio);
    }
    finish(scan);
}

/* The request is marked as pending: begins a pass unless one runs. Lock held; unlocks.
 * Like scanIoRequest nothing is processed before iocInit is through or while the IOC is
 * paused, but it stays pending for the next request. */
static void request(plcScan *scan)
{
    unsigned prios = 0;

    if (interruptAccept) {
        if (!scan->pendingSince)
            scan->pendingSince = epicsMonotonicGet();
        if (!scan->busy)
            prios = begin(scan);
    }
    epicsMutexUnlock(scan->lock);
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

int plcScanRequestChanged(plcScan *scan, const void *before, const void *after)
{
    int waiting;

    if (!scan->byRange)
        return plcScanRequestAll(scan);
    epicsMutexMustLock(scan->lock);
    waiting = scan->pendingSince != 0;
    if (scan->allPending != ALL_PRIOS && !touchChanged(scan, before, after) && !waiting) {
        epicsMutexUnlock(scan->lock);
        return 0;
    }
    request(scan);
    return waiting;
}

int plcScanBusy(plcScan *scan)
{
    int busy;

    epicsMutexMustLock(scan->lock);
    busy = scan->busy;
    epicsMutexUnlock(scan->lock);
    return busy;
}

unsigned plcScanCount(plcScan *scan)
{
    unsigned count = 0;
    int prio;

    epicsMutexMustLock(scan->lock);
    for (prio = 0; prio < NUM_CALLBACK_PRIORITIES; prio++)
        count += scan->count[prio];
    epicsMutexUnlock(scan->lock);
    return count;
}
