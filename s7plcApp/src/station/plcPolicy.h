/* Which of a station's connections counts: the table of functions by which the core knows
 * a policy (a single PLC, a redundant pair) without knowing what it is.
 *
 * A policy is pure: it has no socket, no thread and no clock. The station's thread tells
 * it what happened and when, and does what it answers.
 */
#ifndef INC_plcPolicy_H
#define INC_plcPolicy_H

#include <stdio.h>

#include <epicsTypes.h>
#include <osiSock.h>

struct plcOptions;
struct plcStation;

#define PLC_LINES_MAX 2 /* connections of one station */

typedef enum {
    plcEventConnected, /* TCP connection `which` is up */
    plcEventBlock,     /* a whole block came in on connection `which` */
    plcEventLost,      /* connection `which` broke, or was silent for recvTimeout */
    plcEventTick       /* time went by, and all that had come in was looked at; `which`
                          means nothing */
} plcEvent;

typedef struct plcPolicy {
    const char *name;
    unsigned lines; /* connections it wants: 1 or 2 */
    /* All run in the station's thread. `now` is monotonic, in ns.
     * step returns the connection that leads from now on: its blocks are data and it gets
     * the output; -1: none. It may set *wake to the time when it wants the next tick. */
    int (*step)(void *pvt, plcEvent event, unsigned which, epicsUInt64 now,
                epicsUInt64 *wake);
    /* What a policy may want to know besides; all may be NULL, all run in the station's
     * thread: it begins, an option is new (also at the beginning), connection `which` goes
     * to this address from now on, it ends. */
    void (*begin)(void *pvt, struct plcStation *station);
    void (*options)(void *pvt, const struct plcOptions *options);
    void (*address)(void *pvt, unsigned which, struct in_addr host);
    /* Connection `which` led until now. Returns 1 when it may be dead, though it looks
     * sound: then it is made anew. May be NULL; in the station's thread. */
    int (*suspect)(void *pvt, unsigned which);
    void (*end)(void *pvt);
    /* A line for dbior and s7plcReport. Any thread. */
    void (*report)(void *pvt, FILE *file, int level);
    /* The station ends; its thread has been joined. */
    void (*destroy)(void *pvt);
} plcPolicy;

/* One PLC, one connection: it leads while it is up. */
extern const plcPolicy plcSingle;

#endif /* INC_plcPolicy_H */
