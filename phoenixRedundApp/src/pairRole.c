/* Roles of a redundant pair; see pairRole.h. */
#include <string.h>

#include "pairRole.h"

/* And a sixteenth: how much later than ever a block may come */
#define MARGIN_NS 1000000u
#define REFUTED 3 /* claims that no block still on its way explains any more */
#define KNOWN 4   /* intervals that tell enough about a PLC */

void pairRoleInit(pairRole *r, epicsUInt64 recvTimeout)
{
    memset(r, 0, sizeof(*r));
    r->recvTimeout = recvTimeout;
    r->leader = r->lastLeader = pairNobody;
}

/* --- Time --------------------------------------------------------------------------- */

static epicsUInt64 longestOf(const pairMember *m)
{
    epicsUInt64 longest = 0;
    unsigned i;

    for (i = 0; i < m->intervals && i < PAIR_INTERVALS; i++)
        if (m->interval[i] > longest)
            longest = m->interval[i];
    return longest;
}

/* The longest interval of late; of the partner too while there are few: both run the same
 * program. 0: nothing known. */
static epicsUInt64 longest(const pairRole *r, unsigned which)
{
    epicsUInt64 own = longestOf(&r->plc[which]);
    epicsUInt64 other = longestOf(&r->plc[!which]);

    return r->plc[which].intervals < KNOWN && other > own ? other : own;
}

/* How long this PLC may be silent: so many intervals and a margin. */
static epicsUInt64 silentAtMost(const pairRole *r, unsigned which, double intervals)
{
    epicsUInt64 interval = longest(r, which);

    if (!interval)
        return r->recvTimeout / 2;
    return (epicsUInt64)(intervals * interval) + interval / 16 + MARGIN_NS;
}

/* When the PRIMARY is overdue, and a claim succeeds: after one interval; after more with each
 * claim it refuted, up to two when both send. */
static epicsUInt64 overdueAt(const pairRole *r)
{
    unsigned refuted = r->plc[!r->leader].refuted;
    double intervals = refuted < REFUTED ? 1 + (double)refuted / REFUTED : 2;

    return r->plc[r->leader].lastBlock + silentAtMost(r, r->leader, intervals);
}

int pairRoleMissed(const pairRole *r)
{
    return r->switchovers && r->reason == pairSilent &&
           r->duration > silentAtMost(r, !r->leader, 2);
}

/* When a PLC that does not lead counts as quiet again. */
static epicsUInt64 quietAt(const pairRole *r, unsigned which)
{
    return r->plc[which].lastBlock + silentAtMost(r, which, 3);
}

/* --- What happens ------------------------------------------------------------------- */

static void forgetClaims(pairRole *r)
{
    unsigned i;

    for (i = 0; i < PLC_LINES_MAX; i++)
        r->plc[i].claims = r->plc[i].refuted = 0;
    r->twoPrimaries = 0;
}

/* The one place where a PLC begins to lead. */
static void lead(pairRole *r, unsigned which, pairReason reason, epicsUInt64 silentSince,
                 epicsUInt64 now)
{
    if (r->lastLeader != pairNobody && r->lastLeader != (pairWho)which) {
        r->switchovers++;
        r->reason = reason;
        r->duration = now - silentSince;
    }
    r->leader = r->lastLeader = which;
    forgetClaims(r);
}

/* What is much longer than ever says that the IOC stood still, not how long the PLC's period is: a PLC
 * that has become slower is learned step by step. The least step: blocks that an IOC finds together
 * have no time between them. */
static epicsUInt64 plausible(const pairRole *r, const pairMember *m, epicsUInt64 interval)
{
    epicsUInt64 most = 2 * longestOf(m), least = r->recvTimeout / 8;

    if (most < least)
        most = least;
    return m->intervals >= KNOWN && interval > most ? most : interval;
}

/* Learns the period of a PLC. The time in which it was the BACKUP is no interval. */
static void noteInterval(pairRole *r, unsigned which, epicsUInt64 now)
{
    pairMember *m = &r->plc[which];
    int leads = r->leader == (pairWho)which;

    if (m->lastBlock && !leads && now > quietAt(r, which))
        m->refuted = 0;
    if (m->lastBlock && (leads || now - m->lastBlock <= silentAtMost(r, which, 2)))
        m->interval[m->intervals++ % PAIR_INTERVALS] = plausible(r, m, now - m->lastBlock);
    m->lastBlock = now;
}

static void block(pairRole *r, unsigned which, epicsUInt64 now)
{
    pairMember *m = &r->plc[which], *other = &r->plc[!which];

    m->connected = 1;
    noteInterval(r, which, now);
    if (r->leader == pairNobody) {
        lead(r, which, r->lostBy, r->silentSince, now);
    } else if (r->leader == (pairWho)which) {
        other->refuted += other->claims;
        other->claims = 0;
    } else {
        m->claims = 1;
        if (m->refuted >= REFUTED && !r->twoPrimaries) {
            r->twoPrimaries = 1;
            r->twoPrimariesCount++;
        }
    }
}

static void lost(pairRole *r, unsigned which, epicsUInt64 now)
{
    pairMember *m = &r->plc[which], *other = &r->plc[!which];
    int otherSends = other->claims || r->twoPrimaries;

    if (r->leader == (pairWho)which) {
        r->leader = pairNobody;
        r->silentSince = m->lastBlock;
        r->lostBy =
            now - m->lastBlock >= r->recvTimeout ? pairTimedOut : pairDisconnected;
        if (otherSends && other->connected)
            lead(r, !which, r->lostBy, r->silentSince, now);
    }
    m->connected = m->claims = m->refuted = 0;
    m->lastBlock = 0;
    r->twoPrimaries = 0;
}

/* What is due at this time. Only on a tick, when all that had come in was looked at: else
 * a thread that is late would take a block it has not read yet for silence. */
static void settle(pairRole *r, epicsUInt64 now)
{
    unsigned other;

    if (r->leader == pairNobody)
        return;
    other = !r->leader;
    if (r->plc[other].claims && now >= overdueAt(r))
        lead(r, other, pairSilent, r->plc[r->leader].lastBlock, now);
    else if (r->twoPrimaries && now > quietAt(r, other))
        forgetClaims(r);
}

static void nextTick(const pairRole *r, epicsUInt64 *wake)
{
    if (r->leader == pairNobody)
        return;
    if (r->plc[!r->leader].claims)
        *wake = overdueAt(r);
    else if (r->twoPrimaries)
        *wake = quietAt(r, !r->leader) + 1;
}

pairWho pairRoleStep(pairRole *r, plcEvent event, unsigned which, epicsUInt64 now,
                     epicsUInt64 *wake)
{
    if (event == plcEventConnected)
        r->plc[which].connected = 1;
    else if (event == plcEventBlock)
        block(r, which, now);
    else if (event == plcEventLost)
        lost(r, which, now);
    else
        settle(r, now);
    nextTick(r, wake);
    return r->leader;
}
