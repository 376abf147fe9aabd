/* A pair in real life: a station's thread, two PLCs on loopback, and everything that can
 * happen to them, one after the other. What leads to which decision is in roleTest.c.
 */
#include <arpa/inet.h>
#include <stdio.h>
#include <string.h>

#include <epicsThread.h>
#include <epicsTime.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "pairWorld.h"
#include "phoenixRedund.h"

#define PERIOD 10.0       /* ms */
#define SLOW 250.0        /* ms that each fourth block is later */
#define RECV_TIMEOUT 1500 /* ms; much longer than a busy machine makes a PLC wait */
#define BIG (16u << 20)   /* bytes that do not fit into the buffers of a connection */

static pairWorld w;

#define seen(which) pairWorldSeen(&w, which)
#define waitFor(condition) pairWorldWait(&w, condition)

/* Why the last connection ended. */
static const char *lastError(void)
{
    static plcStats stats;

    plcStationStats(w.station, &stats);
    return stats.lastError;
}

static unsigned long long ignored(void)
{
    plcStats stats;

    plcStationStats(w.station, &stats);
    return stats.ignored;
}

static void beginWorld(const char *name, size_t outSize)
{
    pairWorldBegin(&w, name, outSize, RECV_TIMEOUT, PERIOD);
    pairPeerSlow(w.plc[0], SLOW);
    pairPeerSlow(w.plc[1], SLOW);
}

static void start(void)
{
    testDiag("At the start");
    beginWorld("PLC-A", 8);
    testOk(w.now.primary == pairNobody && w.now.backup == phoenixUnknown,
           "both connected, none sends: no PRIMARY, BACKUP unknown");
    pairWorldPut(&w, 100);
    pairPeerSend(w.plc[0], 1);
    testOk(waitFor(w.who == 1) && w.now.primary == pairFirst,
           "FIRST sends: it is PRIMARY, its values are there");
    testOk(w.now.backup == phoenixSecondLinked, "the BACKUP is plc-2nd, linked");
    testOk(waitFor(seen(0).last == 100), "a put made before goes to FIRST");
    testOk(w.now.switchovers == 0, "the first PRIMARY is no switch-over");
    pairWorldPut(&w, 101);
    testOk(waitFor(seen(0).last == 101), "a put goes to FIRST");
    testOk(seen(1).received == 0, "SECOND gets nothing");
}

static void orderly(void)
{
    epicsUInt32 counter;

    testDiag("Orderly switch-over, both connections stay");
    waitFor(w.mirror == 101);
    pairPeerSend(w.plc[0], 0);
    pairPeerSend(w.plc[1], 1);
    testOk(waitFor(w.who == 2) && w.now.primary == pairSecond,
           "SECOND sends, FIRST no longer: SECOND is PRIMARY, its values are there");
    counter = seen(0).received;
    testOk(w.now.switchovers == 1, "one switch-over");
    testOk(strncmp(w.now.switchReason, "FIRST silent", 12) == 0, "the reason is \"%s\"",
           w.now.switchReason);
    testOk(w.now.switchDuration > 0 && w.now.switchDuration < RECV_TIMEOUT,
           "it took more than 0, less than recvTimeout");
    testDiag("%.1f ms from the last block of FIRST", w.now.switchDuration);
    testOk(w.now.backup == phoenixFirstLinked, "the BACKUP is plc-1st, linked");
    testOk(waitFor(pairPeerCount(w.plc[1], 101) == 1),
           "the present output block goes to SECOND at once");
    pairWorldPut(&w, 102);
    testOk(waitFor(pairPeerCount(w.plc[1], 102) == 1) && seen(0).received == counter,
           "a put goes to SECOND only");
    testOk(!w.gap, "the data was valid all the time");
}

static void bothSend(void)
{
    testDiag("Two PRIMARIES");
    pairPeerSend(w.plc[0], 1);
    testOk(waitFor(w.now.twoPrimaries), "both send: two PRIMARIES");
    testOk(w.now.primary == pairSecond && w.now.switchovers == 1, "SECOND stays");
    testOk(w.now.twoPrimariesCount == 1, "counted once");
    testOk(waitFor(ignored() > 2), "the blocks of FIRST are counted as ignored");
    pairWorldPut(&w, 103);
    testOk(waitFor(pairPeerCount(w.plc[1], 103) == 1) && !pairPeerCount(w.plc[0], 103),
           "a put goes to SECOND only");
    pairPeerSend(w.plc[0], 0);
    testOk(waitFor(!w.now.twoPrimaries) && w.now.primary == pairSecond,
           "FIRST stops: one PRIMARY again");
    pairPeerSend(w.plc[0], 1);
    waitFor(w.now.twoPrimaries);
    pairPeerSend(w.plc[1], 0);
    testOk(waitFor(w.now.primary == pairFirst && w.who == 1),
           "two PRIMARIES, the present one stops: the other leads");
    testOk(waitFor(!w.now.twoPrimaries) && w.now.switchovers == 2 && !w.gap,
           "one more switch-over, data valid all the time");
    testOk(waitFor(strcmp(lastError(), "silent; its connection is made anew") == 0),
           "is SECOND still there? %s", lastError());
}

static void closing(void)
{
    testDiag("The connection of the PRIMARY breaks");
    waitFor(pairPeerCount(w.plc[0], 103) == 1);
    pairPeerSend(w.plc[0], 0);
    pairPeerClose(w.plc[0], 1);
    testOk(waitFor(w.now.primary == pairNobody) && w.now.backup == phoenixUnknown,
           "connection of FIRST closed: no PRIMARY, BACKUP unknown");
    testOk(w.valid && plcStationConnected(w.station, NULL),
           "the data stays valid, puts are taken");
    pairWorldPut(&w, 104);
    pairPeerSend(w.plc[1], 1);
    testOk(waitFor(w.who == 2) && w.now.primary == pairSecond && w.now.switchovers == 3,
           "SECOND sends: it leads with its first block");
    testOk(strncmp(w.now.switchReason, "FIRST disconnected", 18) == 0,
           "the reason is \"%s\"", w.now.switchReason);
    testOk(w.now.backup == phoenixFirstUnlinked, "the BACKUP is plc-1st, unlinked");
    testOk(waitFor(pairPeerCount(w.plc[1], 104) == 1),
           "the put of the gap goes to SECOND");
    pairPeerUp(w.plc[0]);
    testOk(waitFor(w.now.backup == phoenixFirstLinked) && w.now.primary == pairSecond,
           "FIRST is back: BACKUP, linked, SECOND still leads");
    testOk(!w.gap, "the data was valid all the time");
    testOk(pairPeerCount(w.plc[1], 104) == 1 && !pairPeerCount(w.plc[0], 104),
           "the put of the gap was sent once, to SECOND only");
}

static void restart(void)
{
    epicsUInt32 switches = w.now.switchovers;

    testDiag("The PRIMARY restarts, and no one takes over");
    pairPeerClose(w.plc[1], 1);
    waitFor(w.now.primary == pairNobody);
    pairWorldPut(&w, 105);
    pairPeerUp(w.plc[1]);
    testOk(waitFor(w.now.primary == pairSecond && w.who == 2) &&
               w.now.switchovers == switches,
           "SECOND leads again, and no switch-over is counted");
    testOk(waitFor(pairPeerCount(w.plc[1], 105) == 1), "it gets the put of the gap");
    testOk(!w.gap, "the data was valid all the time");
}

static void pull(void)
{
    epicsUInt32 before;

    testDiag("The cable of the PRIMARY is pulled");
    pairPeerPull(w.plc[1], 1);
    before = seen(1).received;
    pairWorldPut(&w, 106);
    pairPeerSend(w.plc[0], 1);
    testOk(waitFor(w.now.primary == pairFirst && w.who == 1), "FIRST sends: it leads");
    testOk(waitFor(pairPeerCount(w.plc[0], 106) == 1),
           "the put of the gap goes to FIRST");
    pairWorldPut(&w, 107);
    testOk(waitFor(pairPeerCount(w.plc[0], 107) == 1), "so does the next one");
    pairPeerSend(w.plc[1], 0);
    pairPeerPull(w.plc[1], 0);
    testOk(waitFor(w.now.backup == phoenixSecondLinked), "plugged again: plc-2nd linked");
    pairPeerClose(w.plc[1], 0); /* so that all that was sent to it has been read */
    testOk(!pairPeerCount(w.plc[1], 107) && seen(1).received <= before + 1,
           "the old PRIMARY got nothing more");
    testOk(!w.gap, "the data was valid all the time");
}

static void nobody(void)
{
    char reason[PLC_REASON_SIZE];
    unsigned connects;

    testDiag("Nobody sends");
    waitFor(w.now.connected[1]);
    pairPeerPull(w.plc[0], 1);
    testOk(waitFor(!w.valid), "silence for recvTimeout: the data is not valid");
    plcImageReason(plcStationInput(w.station), reason);
    testOk(w.now.primary == pairNobody && w.now.backup == phoenixUnknown,
           "no PRIMARY, BACKUP unknown; the records say \"%s\"", reason);
    testOk(!plcStationConnected(w.station, reason) && reason[0],
           "puts are told why not: \"%s\"", reason);
    connects = seen(1).connects;
    testOk(waitFor(seen(1).connects > connects + 1),
           "SECOND is connected to anew and anew: its connection may be dead");
    pairPeerPull(w.plc[0], 0);
    testOk(waitFor(w.now.primary == pairFirst && w.valid), "FIRST sends again: it leads");
    w.gap = 0;
}

static void move(void)
{
    testDiag("Moving the pair");
    testOk(plcStationMove(w.station, "127.0.0.2", (char[100]){0}, 100) == 0 &&
               waitFor(w.now.connected[0] && w.now.connected[1] && w.valid &&
                       w.now.primary == pairFirst),
           "\"S7plc addr\" with the same address: both connect anew, FIRST leads");
}

static void halfSent(void)
{
    unsigned i;

    testDiag("A block that is half sent when the PRIMARY falls silent");
    beginWorld("PLC-BIG", BIG);
    pairPeerSend(w.plc[0], 1);
    waitFor(w.who == 1);
    pairPeerPull(w.plc[0], 1);
    pairWorldPut(&w, 200);
    /* Until the connection is full: the put can be seen to have left the image. */
    waitFor(!plcImageDirty(plcStationOutput(w.station)));
    pairPeerSend(w.plc[1], 1);
    testOk(waitFor(w.now.primary == pairSecond), "SECOND leads");
    testOk(waitFor(strcmp(lastError(), "leads no longer, output discarded") == 0),
           "what was on its way to FIRST is dropped: %s", lastError());
    testOk(waitFor(pairPeerCount(w.plc[1], 200) == 1), "SECOND gets the whole block");
    i = seen(0).connects;
    pairPeerSend(w.plc[0], 0);
    pairPeerPull(w.plc[0], 0);
    testOk(waitFor(seen(0).connects > i), "FIRST gets a new connection");
    testOk(seen(0).received == 0, "the rest of the block never reached FIRST");
    testOk(!w.gap, "the data was valid all the time");
}

static void reach(void)
{
    char error[200];
    epicsUInt64 since;
    int asks;

    testDiag("The watch on the BACKUP");
    beginWorld("PLC-W", 8);
    plcStationSetOption(w.station, "pingPeriod", "200", error, sizeof(error));
    pairPeerSend(w.plc[0], 1);
    waitFor(w.who == 1);
    since = epicsMonotonicGet();
    asks = waitFor(w.now.reachable[0] == phoenixAnswers ||
                   epicsMonotonicGet() - since > 3e9);
    asks = asks && w.now.reachable[0] == phoenixAnswers;
    testSkip(asks ? 0 : 3, "this machine has no way to ask by ICMP echo");
    if (asks) {
        testOk(waitFor(w.now.reachable[1] == phoenixAnswers), "both answer ICMP echo");
        pairPeerSend(w.plc[0], 0);
        pairPeerSend(w.plc[1], 1);
        testOk(waitFor(w.now.primary == pairSecond && w.now.backup == phoenixFirstLinked),
               "after a switch-over the new BACKUP is linked as soon as it has answered");
        plcStationSetOption(w.station, "pingPeriod", "0", error, sizeof(error));
        testOk(waitFor(w.now.reachable[0] == phoenixNotKnown) &&
                   w.now.backup == phoenixFirstLinked,
               "pingPeriod=0: nobody is asked, TCP alone tells");
    }
    plcStationReport(w.station, stdout, 1);
}

/* One row per refusal of phoenixplcConfigure. */
static void configure(void)
{
    static const struct {
        const char *sentence;
        const char *args[9];
        int good;
    } rows[] = {
        {"redundancy=2 is refused",
         {"X1", "10.0.0.1", "2000", "8", "8", "1", "0", "0", "2"},
         0},
        {"redundancy=yes is refused",
         {"X2", "10.0.0.1", "2000", "8", "8", "1", "0", "0", "yes"},
         0},
        {"a pair at .254 is refused: there is no IPaddr+1",
         {"X3", "10.0.0.254", "2000", "8", "8", "1", "0", "0", "1"},
         0},
        {"a pair at .255 is refused",
         {"X4", "10.0.0.255", "2000", "8", "8", "1", "0", "0", "1"},
         0},
        {"two addresses without redundancy are refused",
         {"X5", "10.0.0.1,10.0.0.9", "2000", "8", "8", "1", "0", "0", "0"},
         0},
        {"the same address twice is refused",
         {"X6", "10.0.0.1,10.0.0.1", "2000", "8", "8", "1", "0", "0", "1"},
         0},
        {"a pair without input block is refused: who would be PRIMARY?",
         {"X7", "10.0.0.1", "2000", "0", "8", "1", "0", "0", "1"},
         0},
        {"a pair without address is refused",
         {"X8", "", "0", "8", "8", "1", "0", "0", "1"},
         0},
        {"no redundancy argument means one PLC",
         {"X9", "10.0.0.254", "2000", "8", "8", "1", "0", "0", NULL},
         1},
        {"a pair at .253 is SECOND at .254",
         {"XA", "10.0.0.253", "2000", "8", "8", "1", "0", "0", "1"},
         1},
        {"a SECOND PLC of three numbers is refused",
         {"XD", "10.0.0.254,10.0.1", "2000", "8", "8", "1", "0", "0", "1"},
         0},
        {"a pair with two addresses may lie anywhere",
         {"XB", "10.0.0.254,10.0.3.1", "2000", "8", "8", "1", "0", "0", "1"},
         1},
        {"a host name is resolved before 1 is added",
         {"XC", "plc-a.invalid", "2000", "8", "8", "1", "0", "0", "1"},
         1},
        {"the same name twice is refused",
         {"XA", "10.0.0.1", "2000", "8", "8", "1", "0", "0", "1"},
         0},
    };
    size_t i;

    testDiag("phoenixplcConfigure");
    for (i = 0; i < sizeof(rows) / sizeof(rows[0]); i++)
        testOk((phoenixplcConfigure(rows[i].args) == 0) == rows[i].good, "%s",
               rows[i].sentence);
    testOk(!phoenixPairFind("X9") && phoenixPairFind("XA") && phoenixPairFind("XB") &&
               !phoenixPairFind("X3"),
           "a pair exists for each of the good ones with redundancy=1, and no other");
}

/* A put with a read-back belongs to the pair, not to the PLC that has shown it. */
static void readBack(int track)
{
    epicsUInt32 held;

    testDiag("Puts with a read-back, track=%s", track ? "on" : "off");
    beginWorld(track ? "PLC-T" : "PLC-R", 8);
    pairWorldReadback(&w, track);
    pairPeerSend(w.plc[0], 1);
    waitFor(w.who == 1);
    pairWorldPut(&w, 301);
    testOk(waitFor(w.mirror == 301), "FIRST shows a put");
    pairPeerSend(w.plc[0], 0);
    pairPeerSend(w.plc[1], 1);
    testOk(waitFor(pairPeerCount(w.plc[1], 301) == 1), "SECOND gets it when it leads");
    testOk(waitFor(w.who == 2 && w.mirror == 301), "and shows it");
    pairPeerPull(w.plc[1], 1);
    pairWorldPut(&w, 302);
    pairPeerSend(w.plc[0], 1);
    testOk(waitFor(pairPeerCount(w.plc[0], 302) == 1),
           "FIRST gets what was put while SECOND hung");
    testOk(waitFor(w.who == 1 && w.mirror == 302) && !w.gap, "and shows it");
    plcImagePeek(plcStationOutput(w.station), 0, 4, &held);
    testOk(held == htonl(302), "the output holds it");
    pairPeerPull(w.plc[1], 0);
    pairWorldEnd(&w);
}

MAIN(pairTest)
{
    testPlan(72 + 2 * 6);
    configure();
    plcStationsDestroy();
    start();
    orderly();
    bothSend();
    closing();
    restart();
    pull();
    nobody();
    move();
    pairWorldEnd(&w);
    halfSent();
    pairWorldEnd(&w);
    reach();
    pairWorldEnd(&w);
    readBack(0);
    readBack(1);
    return testDone();
}
