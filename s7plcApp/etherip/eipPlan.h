/* Which services go together into one message: exact arithmetic of bytes, and runs of array
 * elements that are read at once.
 *
 * Knows numbers only. Pure; any thread.
 */
#ifndef INC_eipPlan_H
#define INC_eipPlan_H

#include <stddef.h>

#include <epicsTypes.h>

enum { eipGapMax = 40 }; /* bytes that are read over rather than asked for anew */

/* What one service needs by itself, in bytes, its answer with status, type and data. */
typedef struct eipLoad {
    unsigned request, answer;
} eipLoad;

typedef struct eipLimits {
    unsigned room;     /* bytes of a message, and of an answer */
    unsigned multiple; /* services in one message, 0: any number, 1: each alone */
} eipLimits;

/* Does it fit into a message by itself? */
static inline int eipFitsAlone(const eipLoad *load, const eipLimits *limits)
{
    return load->request <= limits->room && load->answer <= limits->room;
}

/* Puts each load into a message: bin[i] is the number of its message, from 0 on. A load that
 * does not fit alone gets a message of its own. inOrder: none overtakes another, messages
 * leave in the order of their numbers; else the fewest messages that first fit by decreasing
 * size finds. Returns the number of messages, at most count. */
unsigned eipPack(const eipLoad *loads, unsigned count, const eipLimits *limits, int inOrder,
                 unsigned *bin);

/* Elements of one array that somebody wants. */
typedef struct eipRun {
    epicsUInt32 first, count;
    unsigned from, wants; /* what it is made of: these of the sorted wishes */
} eipRun;

/* Joins wishes, sorted by their first element, to runs: over gaps of less than eipGapMax
 * bytes, and never longer than `most` elements (0: any number). `runs` has room for `count`.
 * Returns their number. */
unsigned eipRuns(const epicsUInt32 *first, const epicsUInt32 *length, unsigned count,
                 unsigned elementSize, epicsUInt32 most, eipRun *runs);

/* When it is due next, ns: the first multiple of `period` ns behind `now`, counted from
 * `epoch`. Period 0: at once. */
static inline epicsUInt64 eipNextDue(epicsUInt64 epoch, epicsUInt64 period, epicsUInt64 now)
{
    return period ? epoch + ((now - epoch) / period + 1) * period : now;
}

#endif /* INC_eipPlan_H */
