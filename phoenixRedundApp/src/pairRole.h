/* Who leads a redundant pair of PLCs: the roles as a pure function.
 *
 * It knows blocks, losses and times, as the station's thread tells them; no socket, no
 * thread, no clock, no record. FIRST and SECOND are names of the two PLCs for good;
 * PRIMARY (leads) and BACKUP are roles that change.
 *
 * The rules, in the order in which they apply:
 *   1. Nobody leads: the first block makes its sender the PRIMARY, at once.
 *   2. The PRIMARY's connection is lost: if the other one sends, it leads at once; else
 *      nobody leads.
 *   3. A block of the other PLC while one leads is a claim. It succeeds as soon as the
 *      PRIMARY is overdue: silent for longer than its longest interval of late (and a
 *      sixteenth and 1 ms more). That is at once when the PRIMARY has fallen silent
 *      before; else when its next block does not come in time. A block of the PRIMARY
 *      refutes the claim, and gives it a third of an interval more next time.
 *      An interval counts at most twice the longest before it, or an eighth of recvTimeout:
 *      it may be that the IOC stood still.
 *   4. Who claims again after it was refuted three times shows that both send: "two
 *      PRIMARIES". The present one stays until it misses two blocks.
 * So neither blocks of the old PRIMARY that were still on their way nor two PRIMARIES make
 * the roles go to and fro.
 */
#ifndef INC_pairRole_H
#define INC_pairRole_H

#include <epicsTypes.h>

#include "plcPolicy.h"

#define PAIR_INTERVALS 8 /* how far "of late" reaches back */

typedef enum { pairNobody = -1, pairFirst, pairSecond } pairWho;

typedef enum {
    pairSilent,       /* the old PRIMARY was overdue */
    pairTimedOut,     /* it was silent for recvTimeout */
    pairDisconnected, /* its connection broke */
} pairReason;

typedef struct pairMember {
    int connected;
    epicsUInt64 lastBlock;                /* monotonic ns; 0: none on this connection */
    epicsUInt64 interval[PAIR_INTERVALS]; /* ns from block to block, a ring */
    unsigned intervals;                   /* how many were put in */
    int claims;                           /* it has sent since the PRIMARY's last block */
    unsigned refuted; /* how often the PRIMARY has sent since it claimed */
} pairMember;

typedef struct pairRole {
    epicsUInt64 recvTimeout; /* ns; the caller keeps it up to date */
    pairMember plc[PLC_LINES_MAX];
    pairWho leader;
    pairWho lastLeader; /* who leads or led last */
    int twoPrimaries;
    /* what happened since the start */
    epicsUInt32 switchovers; /* PRIMARY became another PLC; the first does not count */
    epicsUInt32 twoPrimariesCount;
    pairReason reason;       /* of the last switch-over */
    epicsUInt64 duration;    /* ns from the last block of the old PRIMARY until then */
    epicsUInt64 silentSince; /* last block of who led last, when nobody leads */
    pairReason lostBy;       /* how it was lost */
} pairRole;

void pairRoleInit(pairRole *role, epicsUInt64 recvTimeout);

/* What happened to connection `which` at `now` (monotonic ns, not 0, never backwards).
 * Returns who leads from now on. *wake is set to the time of the tick it needs, when it
 * needs one; a time that has passed means: at once, after a look at what has come in. */
pairWho pairRoleStep(pairRole *role, plcEvent event, unsigned which, epicsUInt64 now,
                     epicsUInt64 *wake);

/* True when the last switch-over was because the old PRIMARY had missed several blocks:
 * not an orderly one. */
int pairRoleMissed(const pairRole *role);

#endif /* INC_pairRole_H */
