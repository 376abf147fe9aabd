/* The lines of a station: its connections to the PLC, or to both of a pair. When to
 * connect, what becomes of one that is lost, and which of them leads. Knows nothing of what came in.
 *
 * All functions run in the station's thread; none waits.
 */
#include <string.h>

#include <epicsAtomic.h>
#include <epicsStdio.h>
#include <errlog.h>

#include "plcHot.h"
#include "plcStationPvt.h"

/* Waits before attempts to connect, ms: the first at once, then up to the last. */
static const unsigned backoff[] = {0, 50, 100, 200, 400, 700};

/* A connection that lasted this long is a good one, ms. */
#define SETTLED_MS 2000
#define TAKEN_MS 2000 /* see looksTaken */
#define HANG_UPS 3    /* see countHangUps */

/* How far an attempt to connect came; what stops it there is said once. */
enum { ofTcp = 1, ofSession = 2 };

/* Which PLC is meant, for log lines about one of a pair. */
static const char *lineName(plcStation *s, unsigned i)
{
    static const char *const names[] = {"FIRST ", "SECOND "};

    if (plcStationIsPair(s))
        return names[i];
    return s->lines[i].transport->prefix;
}

/* This line leads no longer. What still is on its way to the PLC must not get there: not
 * now, and not when its cable is plugged in again. And a connection that fell silent is
 * made anew, so that it is known soon whether the PLC is there. */
PLC_COLD static void leadsNoLonger(plcStation *s, unsigned i, epicsUInt64 now)
{
    if (s->lines[i].connection.state != plcConnectionUp)
        return;
    if (!plcLineDelivered(&s->lines[i]))
        plcLineLost(s, i, now, "leads no longer, output discarded");
    else if (s->policy->suspect && s->policy->suspect(s->policyPvt, i))
        plcLineLost(s, i, now, "silent; its connection is made anew");
}

/* The image leaves to another PLC, or on another connection, with every put that a record
 * holds. Until the PLC has had time to show it, what it shows is older. */
PLC_COLD static void leaveAgain(plcStation *s, epicsUInt64 now)
{
    if (!epicsAtomicGetIntT(&s->written) && !epicsAtomicGetIntT(&s->followed))
        return;
    plcImageTouch(s->out);
    plcReadbackWait(s->readback, s->out, now, 1);
}

/* The one place where the leader changes. */
PLC_COLD static void setLeader(plcStation *s, int leader, epicsUInt64 now)
{
    int before = s->lastLeader;

    if (leader == s->leader)
        return;
    s->leader = leader;
    s->leaderSince = now;
    if (leader >= 0)
        s->lastLeader = leader;
    epicsMutexMustLock(s->lock);
    s->stats.leader = leader;
    s->stats.connected = leader >= 0;
    s->stats.connectedSince = leader >= 0 ? now : 0;
    if (leader >= 0)
        epicsTimeGetCurrent(&s->stats.connectTime);
    epicsMutexUnlock(s->lock);
    if (!s->shows)
        plcImageAway(s->out, leader < 0);
    plcInputSetLeads(s);
    plcInputSyncLeader(s, now);
    if (leader >= 0) {
        /* The new PLC gets what the old one had, at once. */
        s->lastSend = 0;
        s->dirtySince = 0;
        s->slowSince = 0;
        epicsAtomicSetIntT(&s->sendNow, 0);
        s->nextOutScan = now + plcMsToNs(s->now.sendInterval);
        if (!s->now.sync && !s->shows)
            leaveAgain(s, now);
    }
    plcScanRequestAll(s->statusScan);
    plcStationChanged(s);
    if (leader >= 0 && before >= 0 && before != leader) {
        s->lastAlive = 0; /* another PLC, another alive word */
        leadsNoLonger(s, before, now);
    }
}

PLC_HOT void plcLineTellPolicy(plcStation *s, plcEvent event, unsigned i, epicsUInt64 now)
{
    int before = s->leader;
    plcLine *line;

    s->policyWake = 0;
    setLeader(s, s->policy->step(s->policyPvt, event, i, now, &s->policyWake), now);
    if (s->leader < 0 || s->leader == before)
        return;
    line = &s->lines[s->leader];
    if (line->isKept && event != plcEventBlock)
        plcInputBlock(s, line->kept, line->keptStamp, 1, now);
    line->isKept = 0;
}

/* Sets the time of the next attempt: the first at once, then later and later. */
static void retryLater(plcLine *line, epicsUInt64 now)
{
    unsigned last = sizeof(backoff) / sizeof(backoff[0]) - 1;

    line->retryAt =
        now + plcMsToNs(backoff[line->failures < last ? line->failures : last]);
    line->failures++;
}

void plcLineRetrySlowly(plcLine *line, epicsUInt64 now)
{
    line->failures = sizeof(backoff);
    retryLater(line, now);
}

static int otherIsUp(plcStation *s, unsigned i)
{
    return plcStationIsPair(s) && s->lines[!i].connection.state == plcConnectionUp;
}

/* An attempt to connect failed, or an address could not be found. */
PLC_COLD static void lineFailed(plcStation *s, unsigned i, epicsUInt64 now, unsigned stage,
                                const char *why)
{
    plcLine *line = &s->lines[i];
    char text[200];

    retryLater(line, now);
    epicsMutexMustLock(s->lock);
    s->stats.connectErrors++;
    epicsMutexUnlock(s->lock);
    if (plcLineIsOutput(s, i) || (s->leader < 0 && !line->wrongSize)) {
        int another = strncmp(s->outReason, why, PLC_REASON_SIZE - 1) != 0;

        plcStationReason(s, i, why);
        if (plcLineIsOutput(s, i) && another)
            plcInputFollow(s, 0);
    }
    if (!(line->logged & stage)) {
        line->logged |= stage;
        epicsSnprintf(text, sizeof(text),
                      "cannot connect to %s%s%s port %d: %s; the driver keeps trying", lineName(s, i),
                      line->host, line->plus ? "+1" : "", line->port, why);
        plcStationLog(s, errlogMajor, text);
    }
    if (!plcLineIsOutput(s, i) && s->leader < 0 && !line->wrongSize &&
        !(plcStationIsPair(s) && (s->valid || otherIsUp(s, i))))
        plcInputInvalidate(s, plcStateConnecting, why);
}

PLC_COLD void plcLineFailed(plcStation *s, unsigned i, epicsUInt64 now, const char *why)
{
    lineFailed(s, i, now, ofTcp, why);
}

PLC_COLD int plcLineChangesOften(const plcLine *line)
{
    return line->verdicts > 2;
}

PLC_HOT epicsUInt64 plcLineSilenceDue(const plcStation *s, const plcLine *line)
{
    epicsUInt64 since = line->lastBlock ? line->lastBlock : line->connection.since;

    if (s->leader < 0 && since < s->leaderSince)
        since = s->leaderSince;
    return since + plcMsToNs(s->now.recvTimeout);
}

/* One that ends at once, without a block: many PLCs serve one client for each port. */
static int looksTaken(const plcStation *s, unsigned i, epicsUInt64 lasted, const char *why)
{
    return s->inSize && !plcLineIsOutput(s, i) && !plcLineExchanges(s, i) &&
           !plcStationIsPair(s) && !s->lines[i].lastBlock && lasted < plcMsToNs(TAKEN_MS) &&
           (strstr(why, "closed by PLC") || strstr(why, "reset by PLC"));
}

PLC_HOT int plcLineMustSend(const plcStation *s, unsigned i)
{
    return !plcStationIsPair(s) || s->leader < 0 || (int)i == s->leader;
}

/* Who was lost, why, where, and after how long. */
PLC_COLD static void logLost(plcStation *s, unsigned i, epicsUInt64 lasted, const char *why)
{
    const plcLine *line = &s->lines[i];
    char text[400];

    epicsSnprintf(text, sizeof(text), "%sdisconnected: %s (%.200s%s port %d, connected for "
                  "%.1f s)%s", lineName(s, i), why, line->host, line->plus ? "+1" : "",
                  line->port, lasted * 1e-9,
                  looksTaken(s, i, lasted, why) ? "; is another client connected to it?" : "");
    plcStationLog(s, errlogMajor, text);
}

/* A PLC that hangs up again and again before it has answered: many serve one client only. */
PLC_COLD static void countHangUps(plcStation *s, unsigned i, epicsUInt64 lasted, const char *why)
{
    plcLine *line = &s->lines[i];

    if (!plcLineExchanges(s, i) || line->lastBlock || epicsAtomicGetIntT(&s->taken) ||
        lasted >= plcMsToNs(TAKEN_MS) ||
        !(strstr(why, "closed by PLC") || strstr(why, "reset by PLC"))) {
        line->hangUps = 0;
        return;
    }
    if (++line->hangUps == HANG_UPS)
        plcStationLog(s, errlogMinor, "the PLC hangs up before it answers, again and again: another "
                      "client takes this connection, or its unit is not there");
}

/* TCP was there, but not the PLC behind it. */
PLC_COLD static void lineNotOpened(plcStation *s, unsigned i, epicsUInt64 now, epicsUInt64 lasted,
                                   const char *why)
{
    countHangUps(s, i, lasted, why);
    plcExchangeDown(s);
    plcConnectionClose(&s->lines[i].connection, why, now);
    lineFailed(s, i, now, ofSession, why);
}

/* A connection that was up is gone, or has to go: closes it and says so. */
PLC_COLD void plcLineLost(plcStation *s, unsigned i, epicsUInt64 now, const char *why)
{
    plcLine *line = &s->lines[i];
    const plcConnection *c = &line->connection;
    epicsUInt64 lasted = c->state == plcConnectionUp ? now - c->since : c->lasted;
    int led = (int)i == s->leader, saidBefore = line->lostEmpty;

    if (!line->opened) {
        lineNotOpened(s, i, now, lasted, why);
        return;
    }
    /* One that held for a while was good: a PLC that hangs up at once is tried slower. */
    if (lasted >= plcMsToNs(SETTLED_MS))
        line->failures = 0;
    if (!line->lostEmpty && !(line->wrongSize && plcLineChangesOften(line)))
        logLost(s, i, lasted, why);
    countHangUps(s, i, lasted, why);
    if (!line->lostEmpty)
        line->quietSince = line->lastBlock ? line->lastBlock : c->since;
    /* One that accepts connections and sends nothing says so once. */
    line->lostEmpty = plcLineIsOutput(s, i) || (plcLineExchanges(s, i) && !s->inSize)
                          ? !epicsAtomicGetIntT(&s->taken)
                          : s->inSize && !line->lastBlock && plcLineMustSend(s, i);
    if (plcLineExchanges(s, i)) {
        plcExchangeLost(s, why);
        plcExchangeDown(s);
    }
    /* What did not get there in time must not come later: behind newer values of the next
     * connection, or to one of a pair when another leads already. */
    if (plcStationIsPair(s) || plcLineExchanges(s, i) || !plcLineDelivered(line))
        plcConnectionAbort(&line->connection, why, now);
    else
        plcConnectionClose(&line->connection, why, now);
    /* A PLC that connects and says nothing: that it is connected for the moment is no news. */
    if (!line->lastBlock || s->looked >= plcLineSilenceDue(s, line))
        epicsSnprintf(line->lostWhy, sizeof(line->lostWhy), "%s", why);
    line->lostAt = now;
    line->lastBlock = 0;
    line->isKept = 0;
    line->logged = saidBefore ? ofTcp : 0; /* why it cannot be made again may be something else */
    retryLater(line, now);
    epicsMutexMustLock(s->lock);
    s->stats.disconnects++;
    epicsMutexUnlock(s->lock);
    plcStationReason(s, i, why);
    if (plcLineIsOutput(s, i)) {
        plcInputSetLeads(s);
        return;
    }
    plcLineTellPolicy(s, plcEventLost, i, now);
    /* A pair keeps its data until recvTimeout: the other PLC may be about to take over.
     */
    if (led && s->leader < 0 && !plcStationIsPair(s)) {
        s->lastBlock = 0;
        plcInputInvalidate(s, line->wrongSize ? plcStateWrongSize : plcStateConnecting,
                           why);
    }
}

/* The PLC is connected: says so, and counts it. */
PLC_COLD static void sayUp(plcStation *s, unsigned i, epicsUInt64 now)
{
    plcLine *line = &s->lines[i];
    char text[200];

    if (!line->wrongSize && !line->lostEmpty) {
        if (line->lostAt && now - line->lostAt >= plcMsToNs(100))
            epicsSnprintf(text, sizeof(text), "%sconnected to %s%s port %d, after %.1f s",
                          lineName(s, i), line->host, line->plus ? "+1" : "",
                          line->port, (now - line->lostAt) * 1e-9);
        else
            epicsSnprintf(text, sizeof(text), "%sconnected to %s%s port %d",
                          lineName(s, i), line->host, line->plus ? "+1" : "",
                          line->port);
        plcStationLog(s, errlogInfo, text);
    }
    line->logged = 0;
    line->lastBlock = 0;
    epicsMutexMustLock(s->lock);
    s->stats.connects++;
    epicsMutexUnlock(s->lock);
}

/* What becomes of that. */
PLC_COLD static void goUp(plcStation *s, unsigned i, epicsUInt64 now)
{
    plcLine *line = &s->lines[i];

    if (plcLineIsOutput(s, i)) {
        plcInputSetLeads(s);
        return;
    }
    s->frozen = 0;    /* the alive word may have stood still all the time; */
    s->lastAlive = 0; /* judged from the first block of this connection on */
    plcLineTellPolicy(s, plcEventConnected, i, now);
    if (s->leader == (int)i && s->inSize && !s->valid && !line->wrongSize)
        plcInputInvalidate(s, plcStateWaiting,
                           line->lostWhy[0]          ? line->lostWhy
                           : plcLineExchanges(s, i) ? "connected, waiting for first answer"
                                                    : "connected, waiting for first block");
    if (s->leader == (int)i && !s->inSize)
        plcInputNone(s); /* there is no data to wait for */
    if (plcStationIsPair(s) && s->leader < 0 && !s->valid)
        plcInputInvalidate(s, plcStateNoPrimary, "no PRIMARY: neither PLC sends");
}

PLC_COLD void plcLineOpened(plcStation *s, unsigned i, epicsUInt64 now)
{
    s->lines[i].opened = 1;
    sayUp(s, i, now);
    goUp(s, i, now);
}

PLC_COLD void plcLineUp(plcStation *s, unsigned i, epicsUInt64 now)
{
    plcLine *line = &s->lines[i];

    line->opened = !line->transport->opens;
    if (line->opened)
        sayUp(s, i, now);
    if (line->transport->connected)
        line->transport->connected(line->pvt, &line->connection);
    if (plcLineExchanges(s, i))
        plcExchangeUp(s);
    if (line->opened)
        goUp(s, i, now);
}

PLC_COLD void plcLineOpen(plcStation *s, unsigned i, epicsUInt64 now)
{
    plcLine *line = &s->lines[i];
    struct in_addr host;
    char error[80];
    int known;

    known = plcResolverAddress(line->resolver, 1, &host, error, sizeof(error));
    if (known > 0 && s->policy->address)
        s->policy->address(s->policyPvt, i, host);
    if (known == 0)
        return; /* it will wake us */
    if (known < 0)
        plcLineFailed(s, i, now, error);
    else if (plcConnectionOpen(&line->connection, host, htons(line->port), now))
        plcLineFailed(s, i, now, line->connection.error);
}

/* The data of a pair lives on for recvTimeout without a leader. */
PLC_HOT void plcLineDataStep(plcStation *s, epicsUInt64 *wake)
{
    epicsUInt64 due = s->lastBlock + plcMsToNs(s->now.recvTimeout);

    if (!s->valid || s->leader >= 0 || !plcStationIsPair(s))
        return;
    if (s->looked < due) {
        plcEarlier(wake, due);
        return;
    }
    s->lastBlock = 0;
    plcInputInvalidate(s, plcStateNoPrimary, "no PRIMARY: neither PLC sends");
}

/* (Re)creates what finds the address of a line. */
void plcLineAddress(plcStation *s, unsigned i, epicsUInt64 now)
{
    plcLine *line = &s->lines[i];

    epicsMutexMustLock(s->lock);
    strcpy(line->host, s->address[i]);
    line->plus = s->plus[i];
    line->port = s->port[i];
    epicsMutexUnlock(s->lock);
    plcResolverRelease(line->resolver);
    line->resolver = line->host[0] ? plcResolverCreate(line->host, line->plus,
                                                      plcStationWake, s)
                                   : NULL;
    line->failures = line->wrongSize = line->lostEmpty = line->logged = 0;
    line->lostWhy[0] = 0;
    line->retryAt = now;
}
