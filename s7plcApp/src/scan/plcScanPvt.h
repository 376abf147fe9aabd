/* Inside of plcScan; only for plcScan*.c.
 *
 * One mutex guards all of a plcScan. It is never held while callbackRequest, dbProcess,
 * scanIoImmediate or done() run. A set of priorities is a mask with bit 1 << prio.
 */
#ifndef INC_plcScanPvt_H
#define INC_plcScanPvt_H

#include <callback.h>
#include <dbCommon.h>
#include <epicsMutex.h>
#include <epicsTimer.h>

#include "plcScan.h"

#define ALL_PRIOS ((1u << NUM_CALLBACK_PRIORITIES) - 1)
#define LINE 64  /* bytes of a cache line */
#define BATCH 64 /* records, or groups, looked at together */

#ifdef __GNUC__
#define FETCH(address) __builtin_prefetch(address)
#else
#define FETCH(address) ((void)(address))
#endif

/* Records of others, in a list of Base's: plcScanJoin. */
typedef struct otherRecords {
    IOSCANPVT list;
    unsigned count[NUM_CALLBACK_PRIORITIES];
    int anyPrio; /* there are some of which not even the priority is known */
} otherRecords;

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
    otherRecords *others; /* NULL: none yet */
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
    size_t newcomer; /* number of the newcomer; they come first */
    size_t group;    /* number of the group in the pass, */
    group *inside;   /* the group itself, */
    unsigned index;  /* and number of the record among those of this priority in it */
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
    size_t used; /* bytes of it that may change */
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

/* Where those of a priority begin in g->records. */
static inline unsigned firstOf(const group *g, int prio)
{
    unsigned first = 0;

    while (prio-- > 0)
        first += g->count[prio];
    return first;
}

static inline unsigned sizeOf(const group *g)
{
    return firstOf(g, NUM_CALLBACK_PRIORITIES);
}

static inline void addPending(plcScan *scan, group *g, unsigned prios)
{
    if (prios && !g->pending)
        scan->pending[scan->numPending++] = g;
    g->pending |= (epicsUInt8)prios;
}

/* plcScanIndex.c: marks the groups whose bytes differ as pending. Lock held. */
void plcScanTouch(plcScan *scan, const char *before, const char *after);

/* plcScanPass.c. Makes what is pending the running pass; returns its priorities, none when no
 * record is concerned. Lock held; no pass runs. */
unsigned plcScanBegin(plcScan *scan);

/* This record, of this group, will be in the next pass. Lock held. */
void plcScanAddNewcomer(newcomers *n, dbCommon *prec, group *g);

/* Queues one callback for each of these priorities of the pass, the highest first. */
void plcScanQueue(plcScan *scan, unsigned prios);

/* The callback: one priority of a pass, or what is left of it. */
void plcScanPass(epicsCallback *callback);

/* Its timer, which asks again after a queue was full, is freed. */
void plcScanFreeTimer(plcScan *scan);

#endif /* INC_plcScanPvt_H */
