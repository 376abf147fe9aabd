/* A pair under random episodes: switch-overs, pulls, closes, restarts, two PRIMARIES,
 * streams that slip. After each of them leader, counters and values must be what a small
 * model says.
 *
 * What is put has a read-back in two of three pairs, in one with track=on.
 *
 * Arguments: number of episodes (30, or PLCLINK_EPISODES; "600s": so long), seed of the random
 * numbers (from the clock).
 * PLCs send every few ms. A machine that lets a PLC of the test sleep makes it silent in
 * earnest; such an episode is told from a wrong one by the PLC's own record of its times.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <epicsThread.h>
#include <epicsTime.h>
#include <epicsUnitTest.h>
#include <errlog.h>
#include <testMain.h>

#include "pairWorld.h"

#define PERIOD 8.0        /* ms */
#define RECV_TIMEOUT 3000 /* ms */
#define LIFE 10           /* episodes of one pair */

/* What must be true. */
typedef struct model {
    int leader;
    epicsUInt32 switchovers;
    epicsUInt32 twoPrimaries;
    epicsUInt32 word; /* last put */
    epicsUInt32 number; /* of the last put with a value of its own */
} model;

static pairWorld w;
static model m;
static unsigned long long state;
static const char *failure; /* of the episode, NULL: none */
static int excused;         /* the machine slept */

static unsigned randomBelow(unsigned n)
{
    state = state * 6364136223846793005ull + 1442695040888963407ull;
    return (unsigned)(state >> 33) % n;
}

/* The time until the next accident. */
static void aWhile(void)
{
    epicsThreadSleep(randomBelow(12) * 1e-3);
}

static void must(int true_, const char *what)
{
    if (!true_ && !failure)
        failure = what;
}

#define mustBecome(condition, what) must(pairWorldWait(&w, condition), what)

static void put(void)
{
    m.word = ++m.number;
    pairWorldPut(&w, m.word);
}

/* There and back: the last word is an old one. */
static void pulse(void)
{
    epicsUInt32 before = m.word;

    put();
    if (randomBelow(2))
        aWhile();
    m.word = before;
    pairWorldPut(&w, before);
}

static void sometimesPut(void)
{
    switch (randomBelow(3)) {
    case 0: put(); break;
    case 1: pulse(); break;
    default: break;
    }
}

/* The other one leads from now on. */
static void taken(void)
{
    m.leader = !m.leader;
    m.switchovers++;
}

/* --- Episodes ----------------------------------------------------------------------- */

/* The PRIMARY stops, the other one begins. */
static void handOver(void)
{
    int old = m.leader;

    pairPeerSend(w.plc[old], 0);
    if (randomBelow(2))
        aWhile();
    sometimesPut();
    pairPeerSend(w.plc[!old], 1);
    taken();
}

/* The cable of the PRIMARY is pulled; later plugged in again. */
static void pull(void)
{
    int old = m.leader;

    pairPeerPull(w.plc[old], 1);
    sometimesPut();
    aWhile();
    pairPeerSend(w.plc[!old], 1);
    taken();
    mustBecome(w.now.primary == m.leader, "after a pull the other one leads");
    put();
    pairPeerSend(w.plc[old], 0);
    pairPeerPull(w.plc[old], 0);
}

/* The connection of the PRIMARY breaks, and the other one takes over. */
static void breakOff(void)
{
    int old = m.leader;

    pairPeerSend(w.plc[old], 0);
    pairPeerClose(w.plc[old], 1);
    sometimesPut();
    aWhile();
    pairPeerSend(w.plc[!old], 1);
    taken();
    if (randomBelow(2))
        mustBecome(w.now.primary == m.leader && !w.now.connected[old],
                   "after a break the other one leads");
    pairPeerUp(w.plc[old]);
}

/* The PRIMARY restarts, and still is PRIMARY. */
static void restart(void)
{
    pairPeerClose(w.plc[m.leader], 1);
    sometimesPut();
    aWhile();
    pairPeerUp(w.plc[m.leader]);
}

/* The BACKUP restarts. */
static void restartBackup(void)
{
    pairPeerClose(w.plc[!m.leader], 1);
    aWhile();
    pairPeerUp(w.plc[!m.leader]);
}

/* The cable of the BACKUP is pulled for a while. */
static void pullBackup(void)
{
    pairPeerPull(w.plc[!m.leader], 1);
    sometimesPut();
    aWhile();
    pairPeerPull(w.plc[!m.leader], 0);
}

/* Both send for a while; then one of them stops. */
static void bothSend(void)
{
    int old = m.leader;

    pairPeerSend(w.plc[!old], 1);
    m.twoPrimaries++;
    mustBecome(w.now.twoPrimaries || w.now.primary != old, "two PRIMARIES are seen");
    if (w.now.primary != old)
        return; /* settle() finds out why */
    sometimesPut();
    aWhile();
    if (randomBelow(2)) {
        pairPeerSend(w.plc[!old], 0);
        return;
    }
    pairWorldLook(&w);
    must(w.now.primary == old && w.now.twoPrimaries, "of two PRIMARIES the old one stays");
    pairPeerSend(w.plc[old], 0);
    taken();
}

/* A single late block of the BACKUP, long enough before the next one. */
static void stray(void)
{
    int backup = !m.leader;
    epicsUInt32 sent = pairWorldSeen(&w, backup).sent;
    epicsUInt64 quiet = epicsMonotonicGet() + (epicsUInt64)(4 * PERIOD * 1e6);

    pairPeerPeriod(w.plc[backup], 1000);
    pairPeerSend(w.plc[backup], 1);
    mustBecome(pairWorldSeen(&w, backup).sent == sent + 1, "a block is sent");
    pairPeerSend(w.plc[backup], 0);
    pairPeerPeriod(w.plc[backup], PERIOD);
    mustBecome(epicsMonotonicGet() > quiet, "time goes by");
}

/* The stream of the PRIMARY slips, after enough blocks that its rhythm is known. */
static void slip(void)
{
    int by = 1 + (int)randomBelow(PEER_IN - 1);
    epicsUInt32 sent = pairWorldSeen(&w, m.leader).sent;
    plcStats before, now;

    mustBecome(pairWorldSeen(&w, m.leader).sent > sent + 12, "blocks are sent");
    plcStationStats(w.station, &before);
    sometimesPut();
    pairPeerSlip(w.plc[m.leader], randomBelow(2) ? by : -by);
    mustBecome((plcStationStats(w.station, &now), now.outOfStep > before.outOfStep),
               "a stream that slipped is found out of step");
}

static struct {
    const char *name;
    void (*run)(void);
    unsigned count;
} episodes[] = {
    {"handOver",      handOver,      0},
    {"pull",          pull,          0},
    {"breakOff",      breakOff,      0},
    {"restart",       restart,       0},
    {"restartBackup", restartBackup, 0},
    {"pullBackup",    pullBackup,    0},
    {"bothSend",      bothSend,      0},
    {"stray",         stray,         0},
    {"slip",          slip,          0},
};

#define EPISODES (sizeof(episodes) / sizeof(episodes[0]))

/* --- After each --------------------------------------------------------------------- */

/* True when a PLC that should have sent slept for longer than the driver is patient. */
static int slept(void)
{
    int i;

    for (i = 0; i < 2; i++)
        if (pairWorldSeen(&w, i).longest > (PERIOD * 17 / 16 + 0.5) * 1e6)
            return 1;
    return 0;
}

/* All is as the model says. */
static void check(void)
{
    epicsUInt32 counter, received;
    pairPeerSeen leader, backup;

    mustBecome(w.now.connected[0] && w.now.connected[1], "both are connected again");
    mustBecome(w.now.primary == m.leader, "the PRIMARY is who it must be");
    mustBecome(w.who == (epicsUInt32)m.leader + 1, "the values are the PRIMARY's");
    mustBecome(!w.now.twoPrimaries, "one PRIMARY");
    mustBecome(w.now.backup == (m.leader ? phoenixFirstLinked : phoenixSecondLinked),
               "the BACKUP is linked");
    counter = w.counter;
    mustBecome(w.counter > counter + 1, "new values come");
    must(w.now.switchovers == m.switchovers, "switch-overs are counted right");
    must(!w.gap, "the data was valid all the time");
    must(!w.strange, "each value is one that a PLC has sent");
    mustBecome(pairWorldSeen(&w, m.leader).last == m.word,
               "the PRIMARY has the last put");
    backup = pairWorldSeen(&w, !m.leader);
    received = backup.received;
    put();
    mustBecome(pairWorldSeen(&w, m.leader).last == m.word, "the PRIMARY gets a put");
    leader = pairWorldSeen(&w, m.leader);
    must(leader.lastCount == 1, "it gets it once");
    backup = pairWorldSeen(&w, !m.leader);
    must(backup.received == received, "the BACKUP gets nothing");
    mustBecome(w.mirror == m.word, "the read-back comes");
}

/* When the machine slept, the roles may differ; then the model follows the facts. */
static void settle(void)
{
    epicsUInt32 two;

    pairWorldLook(&w);
    check();
    two = w.now.twoPrimariesCount;
    if ((failure || two != m.twoPrimaries) && slept()) {
        excused++;
        failure = NULL;
        mustBecome(w.now.primary != pairNobody && !w.now.twoPrimaries &&
                       w.now.connected[0] && w.now.connected[1],
                   "a machine that slept: there is one PRIMARY");
        m.leader = w.now.primary;
        pairPeerSend(w.plc[m.leader], 1);
        pairPeerSend(w.plc[!m.leader], 0);
        m.switchovers = w.now.switchovers;
        put(); /* with a read-back, one that came while no data was valid is void */
        check();
        two = w.now.twoPrimariesCount;
    } else {
        must(two == m.twoPrimaries, "two PRIMARIES are counted right");
    }
    m.twoPrimaries = two;
    pairPeerSeenReset(w.plc[0]);
    pairPeerSeenReset(w.plc[1]);
}

/* One pair: its values without read-back, with one, with track=on. */
static void beginPair(unsigned kind)
{
    static const char *const names[] = {"PLC-S", "PLC-R", "PLC-T"};

    pairWorldBegin(&w, names[kind], 8, RECV_TIMEOUT, PERIOD);
    if (kind)
        pairWorldReadback(&w, kind == 2);
    m.leader = 0;
    m.switchovers = m.twoPrimaries = 0;
    pairPeerSend(w.plc[0], 1);
    mustBecome(w.who == 1, "the first block comes");
    put();
    check();
}

MAIN(pairStressTest)
{
    const char *wanted = argc > 1 ? argv[1] : getenv("PLCLINK_EPISODES");
    unsigned n = wanted ? (unsigned)atoi(wanted) : 30, i, which, last = 99;
    epicsUInt64 from = epicsMonotonicGet();
    epicsUInt64 until = wanted && strchr(wanted, 's') ? from + n * 1000000000ull : 0;

    state = argc > 2 ? strtoull(argv[2], NULL, 0) : from;
    testPlan(2);
    testDiag("%s episodes, seed %llu", wanted ? wanted : "30", state);
    eltc(0); /* the log of so many switch-overs is not to be read */
    for (i = 0; (until ? epicsMonotonicGet() < until : i < n) && !failure; i++) {
        if (i % LIFE == 0) {
            if (i)
                pairWorldEnd(&w);
            beginPair(i / LIFE % 3);
        }
        last = which = randomBelow(EPISODES);
        episodes[which].count++;
        episodes[which].run();
        settle();
    }
    testOk(!failure,
           "%u episodes, each with the right PRIMARY, counters and values%s%s%s%s", i,
           failure ? "; not so after " : "", failure && last < EPISODES ? episodes[last].name : "",
           failure ? ": " : "", failure ? failure : "");
    for (i = 0, n = 0; i < EPISODES; i++) {
        testDiag("%-14s %u", episodes[i].name, episodes[i].count);
        n += episodes[i].count;
    }
    testDiag("%.1f s; the machine slept in %d", (epicsMonotonicGet() - from) * 1e-9, excused);
    testOk(excused * 4 < (int)n, "the machine slept in less than a quarter of them");
    plcStationReport(w.station, stdout, 1);
    pairWorldEnd(&w);
    return testDone();
}
