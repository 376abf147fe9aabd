/* The thread of a station: it waits in poll() for a wake-up, its connections and its
 * timers, and does what they ask. It waits for nothing else, but for records in a small
 * scan pass (plcScanHere).
 *
 * Reads from top to bottom: log, input, connections, output, loop.
 */
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <epicsAtomic.h>
#include <epicsStdio.h>
#include <errlog.h>

#include "plcClock.h"
#include "plcStationPvt.h"

#define NS_PER_MS 1e6
#define NEVER ((epicsUInt64)-1)

/* Waits before attempts to connect, ms: the first at once, then up to the last. */
static const unsigned backoff[] = {0, 50, 100, 200, 400, 700};

/* A connection that lasted this long is a good one, ms. */
#define SETTLED_MS 2000

/* A put may take this long, beyond the send interval, until the PLC shows it; ms. */
#define PATIENCE_MS 1000

/* With sync=on the PLC expects blocks, also where heartbeat= is not set; ms. */
#define SYNC_HEARTBEAT_MS 500

/* So long a PLC may refuse before we say what may be wrong, ms. */
#define SYNC_DOUBT_MS 5000

/* Records that have not processed so long after a loss have something else to do, ms. */
#define LOSS_SEEN_MS 500

/* Log lines per minute and station; the rest is counted. */
#define LOG_LINES 20

static epicsUInt64 msToNs(double ms)
{
    return (epicsUInt64)(ms * NS_PER_MS);
}

static void earlier(epicsUInt64 *wake, epicsUInt64 time)
{
    if (time < *wake)
        *wake = time;
}

/* --- Log: transitions only, limited ------------------------------------------------------*/

static void logLine(plcStation *s, errlogSevEnum severity, epicsUInt64 now,
                    const char *text)
{
    if (now >= s->logRefill) {
        if (s->logDropped)
            errlogSevPrintf(errlogMinor, "s7plc %s: %u more messages in the last minute\n",
                            s->name, s->logDropped);
        s->logDropped = 0;
        s->logTokens = LOG_LINES;
        s->logRefill = now + msToNs(60000);
    }
    if (s->logTokens == 0) {
        s->logDropped++;
        return;
    }
    s->logTokens--;
    errlogSevPrintf(severity, "s7plc %s: %s\n", s->name, text);
}

void plcStationLog(plcStation *s, int severity, const char *text)
{
    logLine(s, (errlogSevEnum)severity, epicsMonotonicGet(), text);
}

/* --- Input ------------------------------------------------------------------------------*/

static int isPair(plcStation *s)
{
    return s->policy->links > 1;
}

/* Output records are told in a callback that the PLC is back, or that outputs took a value
 * from it. Not while iocInit initialises them: it is made up for when the IOC runs. */
static void requestFollow(plcStation *s, unsigned places)
{
    epicsMutexMustLock(s->lock);
    s->stats.readbacks += places;
    epicsMutexUnlock(s->lock);
    if (epicsAtomicGetIntT(&s->running) && s->follow &&
        epicsAtomicCmpAndSwapIntT(&s->following, 0, 1) == 0 &&
        callbackRequest(&s->followCallback))
        epicsAtomicSetIntT(&s->following, 0);
}

/* For record threads: outputs go somewhere, or soon will. While the data of a pair is
 * valid, a new leader is expected, and it will get them. */
static void setLeads(plcStation *s)
{
    int before = epicsAtomicGetIntT(&s->leads);
    int leads = s->leader >= 0 || (isPair(s) && s->valid);

    epicsAtomicSetIntT(&s->leads, leads);
    plcStationGate(s);
    if (leads && !before)
        requestFollow(s, 0);
}

static void setState(plcStation *s, int state)
{
    epicsMutexMustLock(s->lock);
    s->stats.state = state;
    s->stats.alive = state == plcStateOk;
    epicsMutexUnlock(s->lock);
}

/* The data of the PLC is not to be used, or there is a better reason why not. I/O Intr
 * records process once when data was lost, and never before there was any: sites hang
 * chains on the first processing, which must see the first block. */
static void invalidate(plcStation *s, int state, const char *reason)
{
    int lost = s->valid;

    setState(s, state);
    s->holding = 0;
    s->valid = 0;
    epicsAtomicSetIntT(&s->taken, 0);
    setLeads(s);
    plcImageInvalidate(s->in, reason);
    if (lost)
        plcScanRequestAll(s->inScan);
    plcScanRequestAll(s->statusScan);
}

/* The time stamp of a block: its arrival, or the PLC's own clock. */
static epicsTimeStamp blockStamp(plcStation *s, const char *block)
{
    epicsTimeStamp arrival, plc;
    int bad;

    epicsTimeGetCurrent(&arrival);
    if (s->now.timestamp < 0)
        return arrival;
    block += (size_t)s->now.timestamp;
    bad = s->now.timestampFormat == plcClockIsDtl
              ? plcClockDtl(block, s->bigEndian, &plc)
              : plcClockDateAndTime(block, &plc);
    epicsMutexMustLock(s->lock);
    if (bad)
        s->stats.clockErrors++;
    else
        s->stats.clockOffset = epicsTimeDiffInSeconds(&plc, &arrival);
    epicsMutexUnlock(s->lock);
    return bad ? arrival : plc;
}

/* Hands a block to the records. */
static void deliver(plcStation *s, const void *block, const epicsTimeStamp *stamp,
                    epicsUInt64 now)
{
    const void *before = plcImageBytes(s->in);
    int changesOnly = s->valid;
    int coalesced;

    plcImagePublish(s->in, block, stamp);
    if (!s->valid)
        setState(s, plcStateOk);
    s->valid = 1;
    s->holding = 0;
    s->lastDeliver = now;
    coalesced = changesOnly
                    ? plcScanRequestChanged(s->inScan, before, plcImageBytes(s->in))
                    : plcScanRequestAll(s->inScan);
    if (!changesOnly)
        plcScanRequestAll(s->statusScan);
    if (coalesced) {
        epicsMutexMustLock(s->lock);
        s->stats.coalesced++;
        epicsMutexUnlock(s->lock);
    }
}

/* True when records may have a new block; else *wake may be set to the time they may. */
static int mayDeliver(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    epicsUInt64 due = s->lastDeliver + msToNs(s->now.minUpdate);

    if (!s->valid)
        return 1;
    if (s->now.minUpdate > 0 && now < due) {
        earlier(wake, due);
        return 0;
    }
    if (!s->now.wholeBlock)
        return 1;
    epicsAtomicSetIntT(&s->waiting, 1);
    if (plcScanBusy(s->inScan))
        return 0;
    epicsAtomicSetIntT(&s->waiting, 0);
    return 1;
}

static void holdStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    if (s->holding && mayDeliver(s, now, wake))
        deliver(s, s->held, &s->heldStamp, now);
}

/* Watches the word that moves while the PLC program runs. Returns 1 when data is good. */
static int aliveWord(plcStation *s, const char *block, epicsUInt64 now)
{
    epicsInt64 word;

    if (s->now.alive < 0)
        return 1;
    word = plcGetInt(s->now.aliveType, block + (size_t)s->now.alive, s->bigEndian);
    if (s->lastAlive && word == s->aliveWord)
        return !s->frozen;
    s->aliveWord = word;
    s->lastAlive = now;
    if (s->frozen)
        logLine(s, errlogInfo, now, "alive again");
    s->frozen = 0;
    return 1;
}

static void aliveStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    epicsUInt64 due = s->lastAlive + msToNs(s->now.aliveTimeout);

    if (s->now.alive < 0 || !s->lastAlive || s->frozen || !s->valid)
        return;
    if (now < due) {
        earlier(wake, due);
        return;
    }
    s->frozen = 1;
    logLine(s, errlogMajor, now, "frozen: blocks come, but the alive word stands still");
    invalidate(s, plcStateFrozen, "PLC frozen: alive word stands still");
}

/* The outputs take what the PLC shows. */
static void takeReadback(plcStation *s, const void *block)
{
    int first = !epicsAtomicGetIntT(&s->taken);
    unsigned places;

    /* What was put there before is void: no block leaves because of it. */
    if (first && !epicsAtomicGetIntT(&s->written)) {
        plcImageForget(s->out);
        s->dirtySince = 0;
    }
    places = plcReadbackTake(s->readback, block, s->out);

    epicsAtomicSetIntT(&s->taken, 1);
    if (places || first)
        requestFollow(s, places);
}

/* Outputs follow the PLC from block to block. */
static void trackReadback(plcStation *s, const void *block, epicsUInt64 now)
{
    epicsUInt64 patience = msToNs(s->now.sendInterval + PATIENCE_MS);
    unsigned places = plcReadbackTrack(s->readback, block, s->out, now, patience);

    if (places)
        requestFollow(s, places);
}

/* The one place where the state of the handshake shows to others. */
static void syncShow(plcStation *s, epicsUInt64 now)
{
    int before, remote = (s->sync.flags & plcFlagRemote) != 0;
    char text[120];

    epicsMutexMustLock(s->lock);
    before = s->stats.syncState;
    s->stats.syncState = s->sync.state;
    s->stats.remote = remote;
    if (before != (int)s->sync.state)
        s->stats.syncSince = now;
    s->stats.syncs += s->sync.state == plcSyncSynced && before != plcSyncSynced;
    s->stats.syncsLost += s->sync.state != plcSyncSynced && before == plcSyncSynced;
    epicsMutexUnlock(s->lock);
    if (before == (int)s->sync.state)
        return;
    s->syncSince = now;
    s->syncDoubted = 0;
    plcStationGate(s);
    epicsSnprintf(text, sizeof(text), "sync: %s -> %s%s", plcSyncStateName(before),
                  plcSyncStateName(s->sync.state),
                  s->sync.flags & plcFlagTimeout ? " (the PLC's watchdog had expired)" : "");
    if (s->sync.state == plcSyncLayoutMismatch)
        epicsSnprintf(text, sizeof(text), "sync: the PLC has layout id %u, the IOC %u; "
                      "nothing is sent", s->sync.theirs, s->sync.layout);
    logLine(s, s->sync.state == plcSyncLayoutMismatch ? errlogMajor : errlogInfo, now, text);
    plcScanRequestAll(s->statusScan);
}

/* A PLC that never agrees compares something that we do not read back. Says so once. */
static void syncDoubt(plcStation *s, epicsUInt64 now)
{
    if (s->sync.state != plcSyncChecking || s->syncDoubted ||
        now - s->syncSince < msToNs(SYNC_DOUBT_MS))
        return;
    s->syncDoubted = 1;
    logLine(s, errlogMinor, now, "sync: the PLC does not agree. Does it show every setpoint "
            "that it compares, and has each an output record with R= or readback=?");
}

/* Another PLC gets our output (leader >= 0), or none. */
static void syncLeader(plcStation *s, epicsUInt64 now)
{
    if (!s->now.sync)
        return;
    if (s->leader >= 0)
        plcSyncConnected(&s->sync);
    else
        plcSyncLost(&s->sync);
    syncShow(s, now);
}

/* What the block says of our outputs. Returns 1 when its data is good. Before the PINI run
 * is over nothing is taken: its values would come later and count as puts. */
static int outputsFollow(plcStation *s, const void *block, epicsUInt64 now)
{
    int todo, same;

    if (!epicsAtomicGetIntT(&s->running))
        return 1;
    if (!s->now.sync && plcReadbackCount(s->readback)) {
        if (!epicsAtomicGetIntT(&s->taken))
            takeReadback(s, block);
        else if (s->now.track)
            trackReadback(s, block, now);
    }
    if (!s->now.sync)
        return 1;
    same = s->sync.state == plcSyncChecking && plcReadbackSame(s->readback, block, s->out);
    todo = plcSyncBlock(&s->sync, block, same, s->bigEndian);
    syncShow(s, now); /* closes the image before it takes anything */
    syncDoubt(s, now);
    if (todo & plcSyncTake) {
        takeReadback(s, block);
        plcImageForget(s->out);
        s->dirtySince = 0;
    }
    if (todo & plcSyncSend)
        plcImageTouch(s->out);
    return s->sync.state != plcSyncLayoutMismatch;
}

/* Whole blocks came from the PLC that leads; this is the newest. */
static void leaderBlock(plcStation *s, const void *block, epicsTimeStamp stamp,
                        size_t count, epicsUInt64 now)
{
    epicsUInt64 wake = NEVER;

    epicsMutexMustLock(s->lock);
    if (s->lastBlock)
        plcStatsPeriod(&s->stats, (now - s->lastBlock) / NS_PER_MS / count);
    s->stats.lastBlock = now;
    s->stats.blockTime = stamp;
    if (s->holding)
        s->stats.coalesced++;
    epicsMutexUnlock(s->lock);
    s->lastBlock = now;
    if (!outputsFollow(s, block, now)) {
        invalidate(s, plcStateLayout, plcSyncReason(plcSyncLayoutMismatch));
        return;
    }
    if (!aliveWord(s, block, now))
        return;
    if (mayDeliver(s, now, &wake)) {
        deliver(s, block, &stamp, now);
    } else {
        memcpy(s->held, block, s->inSize);
        s->heldStamp = stamp;
        s->holding = 1;
    }
}

/* --- Connections ------------------------------------------------------------------------*/

/* Which PLC is meant, for log lines about one of a pair. */
static const char *lineName(plcStation *s, unsigned i)
{
    static const char *const names[] = {"FIRST ", "SECOND "};

    return isPair(s) ? names[i] : "";
}

static void setReason(plcStation *s, const char *reason)
{
    epicsMutexMustLock(s->lock);
    epicsSnprintf(s->reason, sizeof(s->reason), "%s", reason);
    epicsSnprintf(s->stats.lastError, sizeof(s->stats.lastError), "%s", reason);
    epicsMutexUnlock(s->lock);
    plcStationGate(s);
}

static void lineLost(plcStation *s, unsigned i, epicsUInt64 now, const char *why);

/* This line leads no longer. What still is on its way to the PLC must not get there: not
 * now, and not when its cable is plugged in again. And a connection that fell silent is
 * made anew, so that it is known soon whether the PLC is there. */
static void retire(plcStation *s, unsigned i, epicsUInt64 now)
{
    const plcConnection *c = &s->lines[i].connection;

    if (c->state != plcConnectionUp)
        return;
    if (!plcConnectionDelivered(c))
        lineLost(s, i, now, "leads no longer, output discarded");
    else if (s->policy->suspect && s->policy->suspect(s->policyPvt, i))
        lineLost(s, i, now, "fell silent, is connected anew");
}

/* The one place where the leader changes. */
static void setLeader(plcStation *s, int leader, epicsUInt64 now)
{
    int before = s->lastLeader;

    if (leader == s->leader)
        return;
    s->leader = leader;
    if (leader >= 0)
        s->lastLeader = leader;
    epicsMutexMustLock(s->lock);
    s->stats.leader = leader;
    s->stats.connected = leader >= 0;
    s->stats.connectedSince = leader >= 0 ? now : 0;
    if (leader >= 0)
        epicsTimeGetCurrent(&s->stats.connectTime);
    epicsMutexUnlock(s->lock);
    setLeads(s);
    syncLeader(s, now);
    if (leader >= 0) {
        /* The new PLC gets what the old one had, at once. */
        s->lastSend = 0;
        s->dirtySince = 0;
        epicsAtomicSetIntT(&s->sendNow, 0);
        s->nextOutScan = now + msToNs(s->now.sendInterval);
        if (epicsAtomicGetIntT(&s->written) && !s->now.sync)
            plcImageTouch(s->out);
    }
    plcScanRequestAll(s->statusScan);
    if (leader >= 0 && before >= 0 && before != leader) {
        s->lastAlive = 0; /* another PLC, another alive word */
        retire(s, before, now);
    }
}

static void tellPolicy(plcStation *s, plcEvent event, unsigned i, epicsUInt64 now)
{
    int before = s->leader;
    plcLine *line;

    s->policyWake = 0;
    setLeader(s, s->policy->step(s->policyPvt, event, i, now, &s->policyWake), now);
    if (s->leader < 0 || s->leader == before)
        return;
    line = &s->lines[s->leader];
    if (line->spared && event != plcEventBlock)
        leaderBlock(s, line->spare, line->spareStamp, 1, now);
    line->spared = 0;
}

/* Sets the time of the next attempt: the first at once, then later and later. */
static void retryLater(plcLine *line, epicsUInt64 now)
{
    unsigned last = sizeof(backoff) / sizeof(backoff[0]) - 1;

    line->retryAt = now + msToNs(backoff[line->failures < last ? line->failures : last]);
    line->failures++;
}

static int otherIsUp(plcStation *s, unsigned i)
{
    return isPair(s) && s->lines[!i].connection.state == plcConnectionUp;
}

/* An attempt to connect failed, or an address could not be found. */
static void lineFailed(plcStation *s, unsigned i, epicsUInt64 now, const char *why)
{
    plcLine *line = &s->lines[i];
    char text[200];

    retryLater(line, now);
    epicsMutexMustLock(s->lock);
    s->stats.connectErrors++;
    epicsMutexUnlock(s->lock);
    if (s->leader < 0 && !line->wrongSize)
        setReason(s, why);
    if (!line->logged) {
        line->logged = 1;
        epicsSnprintf(text, sizeof(text), "cannot connect to %s%s%s port %d: %s; trying on",
                      lineName(s, i), s->address[i], s->plus[i] ? "+1" : "", line->port,
                      why);
        logLine(s, errlogMajor, now, text);
    }
    if (s->leader < 0 && !line->wrongSize && !(isPair(s) && (s->valid || otherIsUp(s, i))))
        invalidate(s, plcStateConnecting, why);
}

/* A connection that was up is gone, or has to go: closes it and says so. */
static void lineLost(plcStation *s, unsigned i, epicsUInt64 now, const char *why)
{
    plcLine *line = &s->lines[i];
    char text[200];
    int led = (int)i == s->leader;

    /* One that held for a while was good: a PLC that hangs up at once is tried slower. */
    if (now - line->connection.since >= msToNs(SETTLED_MS))
        line->failures = 0;
    epicsSnprintf(text, sizeof(text), "%sdisconnected: %s", lineName(s, i), why);
    if (!line->fruitless)
        logLine(s, errlogMajor, now, text);
    /* One that accepts connections and sends nothing says so once. */
    line->fruitless = s->inSize && !isPair(s) && !line->lastBlock;
    /* No old block may reach one of a pair when another leads already. */
    if (isPair(s))
        plcConnectionAbort(&line->connection, why, now);
    else
        plcConnectionClose(&line->connection, why, now);
    line->lostAt = now;
    line->lastBlock = 0;
    line->spared = 0;
    line->logged = 1;
    retryLater(line, now);
    epicsMutexMustLock(s->lock);
    s->stats.disconnects++;
    epicsMutexUnlock(s->lock);
    setReason(s, why);
    tellPolicy(s, plcEventLost, i, now);
    /* A pair keeps its data until recvTimeout: the other PLC may be about to take over. */
    if (led && s->leader < 0 && !isPair(s)) {
        s->lastBlock = 0;
        invalidate(s, line->wrongSize ? plcStateWrongSize : plcStateConnecting, why);
    }
}

static void lineUp(plcStation *s, unsigned i, epicsUInt64 now)
{
    plcLine *line = &s->lines[i];
    char text[200];

    if (!line->wrongSize && !line->fruitless) {
        if (line->lostAt)
            epicsSnprintf(text, sizeof(text), "%sconnected to %s%s port %d, after %.1f s",
                          lineName(s, i), s->address[i], s->plus[i] ? "+1" : "",
                          line->port, (now - line->lostAt) * 1e-9);
        else
            epicsSnprintf(text, sizeof(text), "%sconnected to %s%s port %d", lineName(s, i),
                          s->address[i], s->plus[i] ? "+1" : "", line->port);
        logLine(s, errlogInfo, now, text);
    }
    line->logged = 0;
    line->lastBlock = 0;
    s->frozen = 0;    /* the alive word may have stood still all the time; */
    s->lastAlive = 0; /* judged from the first block of this connection on */
    epicsMutexMustLock(s->lock);
    s->stats.connects++;
    epicsMutexUnlock(s->lock);
    tellPolicy(s, plcEventConnected, i, now);
    if (s->leader == (int)i && s->inSize && !s->valid && !line->wrongSize)
        invalidate(s, plcStateWaiting, "connected, waiting for first block");
    if (s->leader == (int)i && !s->inSize) {
        setState(s, plcStateOk);
        s->valid = 1; /* there is no data to wait for */
        plcScanRequestAll(s->inScan);
    }
    if (isPair(s) && s->leader < 0 && !s->valid)
        invalidate(s, plcStateNoPrimary, "no PRIMARY: neither PLC sends");
}

static void lineOpen(plcStation *s, unsigned i, epicsUInt64 now)
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
        lineFailed(s, i, now, error);
    else if (plcConnectionOpen(&line->connection, host, htons(line->port), now))
        lineFailed(s, i, now, line->connection.error);
}

/* True when records have processed because of the loss, so that they saw it and its reason
 * before the next connection takes its place. */
static int lossSeen(plcStation *s, const plcLine *line, epicsUInt64 now, epicsUInt64 *wake)
{
    if (!line->lostAt || now - line->lostAt >= msToNs(LOSS_SEEN_MS))
        return 1;
    epicsAtomicSetIntT(&s->waiting, 1);
    if (!plcScanBusy(s->inScan))
        return 1;
    earlier(wake, line->lostAt + msToNs(LOSS_SEEN_MS));
    return 0;
}

/* Timers of one connection. */
static void lineStep(plcStation *s, unsigned i, epicsUInt64 now, epicsUInt64 *wake)
{
    plcLine *line = &s->lines[i];
    plcConnection *c = &line->connection;
    epicsUInt64 due;
    char why[PLC_REASON_SIZE];

    if (!line->resolver)
        return;
    if (c->state == plcConnectionConnecting) {
        due = c->since + msToNs(s->now.connectTimeout);
        if (now >= due) {
            plcConnectionClose(c, "PLC does not answer", now);
            lineFailed(s, i, now, c->error);
            line->retryAt = now; /* it has waited long enough */
        } else {
            earlier(wake, due);
        }
    }
    if (c->state == plcConnectionUp && s->inSize && (!isPair(s) || (int)i == s->leader)) {
        due = (line->lastBlock ? line->lastBlock : c->since) + msToNs(s->now.recvTimeout);
        if (s->looked >= due) {
            epicsSnprintf(why, sizeof(why), "no block for %.1f s",
                          s->now.recvTimeout / 1000);
            lineLost(s, i, now, why);
        } else {
            earlier(wake, due);
        }
    }
    if (c->state == plcConnectionDown) {
        if (now >= line->retryAt && lossSeen(s, line, now, wake))
            lineOpen(s, i, now);
        if (c->state == plcConnectionDown && line->retryAt > now)
            earlier(wake, line->retryAt);
        if (c->state == plcConnectionConnecting)
            earlier(wake, now + msToNs(s->now.connectTimeout));
    }
}

/* Says once that the block size is wrong, and gives the connection up. */
static void lineWrongSize(plcStation *s, unsigned i, epicsUInt64 now)
{
    plcLine *line = &s->lines[i];
    size_t burst = plcFramingBurst(line->connection.framing);
    int first = !line->wrongSize;
    char why[PLC_REASON_SIZE], text[200];

    if (burst) {
        epicsSnprintf(why, sizeof(why), "PLC sends %u bytes, inSize is %u",
                      (unsigned)burst, (unsigned)s->inSize);
        epicsSnprintf(text, sizeof(text), "the PLC sends blocks of %u bytes, but inSize "
                      "is %u: set inSize to %u or correct the PLC", (unsigned)burst,
                      (unsigned)s->inSize, (unsigned)burst);
    } else {
        epicsSnprintf(why, sizeof(why), "PLC sends no blocks of %u bytes",
                      (unsigned)s->inSize);
        epicsSnprintf(text, sizeof(text), "what the PLC sends has no block size that "
                      "fits inSize %u", (unsigned)s->inSize);
    }
    line->wrongSize = 1;
    epicsMutexMustLock(s->lock);
    s->stats.sizeMismatches++;
    s->stats.burstSize = (epicsUInt32)burst;
    epicsMutexUnlock(s->lock);
    setReason(s, why);
    if (first) {
        logLine(s, errlogMajor, now, text);
        lineLost(s, i, now, why);
    } else {
        plcConnectionClose(&line->connection, why, now);
        tellPolicy(s, plcEventLost, i, now);
    }
    if (s->leader < 0) /* else the other one of a pair has good data */
        invalidate(s, plcStateWrongSize, why);
    line->failures = sizeof(backoff); /* trying fast helps nobody */
    retryLater(line, now);
}

/* Whole blocks on a line whose size is right. */
static void lineBlocks(plcStation *s, unsigned i, size_t count, epicsUInt64 now)
{
    plcLine *line = &s->lines[i];
    size_t burst = plcFramingBurst(line->connection.framing);
    const void *block;
    char text[200];

    if (line->wrongSize)
        logLine(s, errlogInfo, now, "the block size is right now");
    else if (line->fruitless)
        logLine(s, errlogInfo, now, "blocks come again");
    line->wrongSize = line->fruitless = 0;
    line->lastBlock = now;
    epicsMutexMustLock(s->lock);
    s->stats.blocksIn += count;
    s->stats.skipped += count - 1;
    if (burst && burst != s->stats.burstSize)
        epicsSnprintf(text, sizeof(text), "bytes come %u at a time: is inSize %u right?",
                      (unsigned)burst, (unsigned)s->inSize);
    else
        text[0] = 0;
    s->stats.burstSize = (epicsUInt32)burst;
    epicsMutexUnlock(s->lock);
    if (text[0])
        logLine(s, errlogMinor, now, text);
    tellPolicy(s, plcEventBlock, i, now);
    block = plcFramingNewest(line->connection.framing);
    if (s->leader == (int)i) {
        leaderBlock(s, block, blockStamp(s, block), count, now);
        return;
    }
    /* Kept: when the leader turns out to be silent, this is the newest there is. */
    memcpy(line->spare, block, s->inSize);
    line->spareStamp = blockStamp(s, block);
    line->spared = 1;
    epicsMutexMustLock(s->lock);
    s->stats.ignored += count;
    epicsMutexUnlock(s->lock);
}

/* Reads until nothing is left, for a while: the other line must have its turn. */
static void lineReceive(plcStation *s, unsigned i, epicsUInt64 now)
{
    plcLine *line = &s->lines[i];
    plcConnection *c = &line->connection;
    size_t room, count;
    int got, turns = 16;

    do {
        plcFramingSpace(c->framing, &room);
        got = plcConnectionReceive(c, now);
        if (got <= 0)
            break;
        epicsMutexMustLock(s->lock);
        s->stats.bytesIn += got;
        epicsMutexUnlock(s->lock);
        if (!s->inSize)
            continue;
        if (plcFramingJudge(c->framing) == plcFramingWrong) {
            lineWrongSize(s, i, now);
            return;
        }
        count = plcFramingCount(c->framing);
        if (count && plcFramingJudge(c->framing) == plcFramingTrusted)
            lineBlocks(s, i, count, now);
        plcFramingConsume(c->framing);
    } while ((size_t)got == room && --turns);
    if (got < 0)
        lineLost(s, i, now, c->error);
}

/* poll() reported something about this line. */
static void lineReady(plcStation *s, unsigned i, short revents, epicsUInt64 now)
{
    plcLine *line = &s->lines[i];
    plcConnection *c = &line->connection;
    int status;

    if (c->state == plcConnectionConnecting) {
        status = plcConnectionFinish(c, now);
        if (status > 0)
            lineUp(s, i, now);
        else if (status < 0)
            lineFailed(s, i, now, c->error);
        return;
    }
    if (c->state == plcConnectionUp && (revents & (POLLIN | POLLHUP | POLLERR)))
        lineReceive(s, i, now);
}

/* The data of a pair lives on for recvTimeout without a leader. */
static void dataStep(plcStation *s, epicsUInt64 *wake)
{
    epicsUInt64 due = s->lastBlock + msToNs(s->now.recvTimeout);

    if (!s->valid || s->leader >= 0 || !isPair(s))
        return;
    if (s->looked < due) {
        earlier(wake, due);
        return;
    }
    s->lastBlock = 0;
    invalidate(s, plcStateNoPrimary, "no PRIMARY: neither PLC sends");
}

/* --- Output -----------------------------------------------------------------------------*/

static void countSent(plcStation *s, epicsUInt64 now)
{
    epicsMutexMustLock(s->lock);
    s->stats.blocksOut++;
    s->stats.bytesOut += s->outSize;
    s->stats.lastSend = now;
    if (s->dirtySince)
        plcStatsSend(&s->stats, (now - s->dirtySince) / NS_PER_MS);
    else
        s->stats.heartbeats++;
    epicsMutexUnlock(s->lock);
    s->dirtySince = 0;
}

/* Goes on with a block that is half sent, or begins one (restart). When it is
 * through, or lost, timers have changed that were looked at before: *wake is now. */
static void sendBlock(plcStation *s, int restart, epicsUInt64 now, epicsUInt64 *wake)
{
    int leader = s->leader;
    plcConnection *c = &s->lines[leader].connection;
    int status = plcConnectionSend(c, restart, now);

    if (status > 0)
        countSent(s, now);
    else if (status < 0)
        lineLost(s, leader, now, c->error);
    if (status)
        *wake = now;
}

/* When the output image should leave; NEVER when there is no reason to. */
static epicsUInt64 sendDue(plcStation *s)
{
    epicsUInt64 due = NEVER, free;

    if (s->dirtySince) {
        due = s->dirtySince + msToNs(s->now.holdoff);
        free = s->lastSend ? s->lastSend + msToNs(s->now.sendInterval) : 0;
        return due > free ? due : free;
    }
    if (s->now.heartbeat > 0)
        due = s->lastSend ? s->lastSend + msToNs(s->now.heartbeat) : 0;
    else if (s->now.sync)
        due = s->lastSend ? s->lastSend + msToNs(SYNC_HEARTBEAT_MS) : 0;
    return due;
}

/* Not before the PLC has shown what it holds, where it does; not where sync forbids it. */
static int maySend(plcStation *s)
{
    if (s->now.sync)
        return plcSyncMaySend(&s->sync);
    return epicsAtomicGetIntT(&s->taken) || !plcReadbackCount(s->readback);
}

static void outputStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    plcConnection *c;
    epicsUInt64 due;

    if (!epicsAtomicGetIntT(&s->running) || !s->outSize || s->leader < 0)
        return;
    c = &s->lines[s->leader].connection;
    if (c->state != plcConnectionUp || !maySend(s))
        return;
    if (!plcConnectionIdle(c)) {
        sendBlock(s, 0, now, wake);
        return;
    }
    if (!s->dirtySince && plcImageDirty(s->out))
        s->dirtySince = now;
    due = epicsAtomicGetIntT(&s->sendNow) ? 0 : sendDue(s);
    if (now < due) {
        earlier(wake, due);
        return;
    }
    epicsAtomicSetIntT(&s->sendNow, 0);
    plcImageTake(s->out, c->out);
    if (s->now.sync)
        plcSyncHeader(&s->sync, c->out, s->bigEndian);
    s->lastSend = now;
    sendBlock(s, 1, now, wake);
}

/* Output records with SCAN=I/O Intr: every sendInterval while connected. */
static void outScanStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    if (s->leader < 0 || !epicsAtomicGetIntT(&s->running) || !plcScanCount(s->outScan))
        return;
    if (now >= s->nextOutScan) {
        plcScanRequestAll(s->outScan);
        s->nextOutScan += msToNs(s->now.sendInterval);
        if (s->nextOutScan <= now)
            s->nextOutScan = now + msToNs(s->now.sendInterval);
    }
    earlier(wake, s->nextOutScan);
}

/* --- Statistics -------------------------------------------------------------------------*/

#define STATS_PERIOD_MS 1000

/* Records of statistics: at once when the state changes, else once a second. */
static void statsStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    int state;

    if (!epicsAtomicGetIntT(&s->running) || !plcScanCount(s->statsScan))
        return;
    epicsMutexMustLock(s->lock);
    state = s->stats.state | s->stats.syncState << 8 | s->stats.remote << 16;
    epicsMutexUnlock(s->lock);
    if (state != s->toldState || s->leader != s->toldLeader || now >= s->nextStatsScan) {
        s->toldState = state;
        s->toldLeader = s->leader;
        s->nextStatsScan = now + msToNs(STATS_PERIOD_MS);
        plcScanRequestAll(s->statsScan);
    }
    earlier(wake, s->nextStatsScan);
}

/* --- Loop -------------------------------------------------------------------------------*/

/* (Re)creates what finds the address of a line. */
static void lineAddress(plcStation *s, unsigned i, epicsUInt64 now)
{
    plcLine *line = &s->lines[i];
    char host[PLC_NAME_MAX + 1];
    int plus;

    epicsMutexMustLock(s->lock);
    strcpy(host, s->address[i]);
    plus = s->plus[i];
    line->port = s->port[i];
    epicsMutexUnlock(s->lock);
    plcResolverRelease(line->resolver);
    line->resolver = host[0] ? plcResolverCreate(host, plus, plcStationWake, s) : NULL;
    line->failures = line->wrongSize = line->fruitless = line->logged = 0;
    line->retryAt = now;
}

/* Takes over what other threads have changed. */
static void takeOrders(plcStation *s, epicsUInt64 now)
{
    const char *why = "PLC address changed";
    unsigned i;
    int moved, changed;

    epicsMutexMustLock(s->lock);
    changed = s->optionsChanged;
    if (changed)
        s->now = s->options;
    s->optionsChanged = 0;
    moved = s->moved;
    s->moved = 0;
    epicsMutexUnlock(s->lock);
    if (changed && s->policy->options)
        s->policy->options(s->policyPvt, &s->now);
    for (i = 0; moved && i < s->policy->links; i++) {
        if (s->lines[i].connection.state == plcConnectionUp)
            lineLost(s, i, now, why);
        plcConnectionClose(&s->lines[i].connection, why, now);
        lineAddress(s, i, now);
    }
}

/* First look at the world. */
static void begin(plcStation *s)
{
    unsigned i;

    if (s->policy->begin)
        s->policy->begin(s->policyPvt, s);
    epicsMutexMustLock(s->lock);
    s->optionsChanged = 1;
    epicsMutexUnlock(s->lock);
    takeOrders(s, 0);
    plcScanHere(s->inScan);
    plcSyncInit(&s->sync, (epicsUInt16)s->now.layout);
    if (s->now.readback >= 0) {
        size_t header = plcStationHeader(s);

        plcReadbackAdd(s->readback, s, header, (size_t)s->now.readback + header,
                       s->outSize - header, NULL);
    }
    for (i = 0; i < s->policy->links; i++)
        lineAddress(s, i, 0);
    if (!s->lines[0].resolver) {
        setReason(s, "no address configured");
        invalidate(s, plcStateNoAddress, "no address configured");
    }
}

static void drainPipe(plcStation *s)
{
    char buffer[16];

    while (read(s->wakePipe[0], buffer, sizeof(buffer)) > 0)
        ;
    /* Last: a byte that comes in between would be read while `woken` stays set, and no wake
     * would ever write another. A full barrier: what was to be done is looked at later. */
    epicsAtomicCmpAndSwapIntT(&s->woken, 1, 0);
}

/* Waits until something happens or the time `wake` comes. */
static void waitFor(plcStation *s, epicsUInt64 wake)
{
    struct pollfd fds[1 + PLC_LINKS_MAX];
    epicsUInt64 now = epicsMonotonicGet();
    epicsUInt64 wait = wake > now ? wake - now : 0;
    unsigned i, n, first;

    fds[0].fd = s->wakePipe[0];
    fds[0].events = POLLIN;
    for (i = 0; i < s->policy->links; i++) {
        plcConnection *c = &s->lines[i].connection;

        fds[i + 1].fd = c->state == plcConnectionDown ? -1 : c->socket;
        fds[i + 1].events = plcConnectionEvents(c);
        fds[i + 1].revents = 0;
    }
#ifdef __linux__
    struct timespec limit = {wait / 1000000000u, wait % 1000000000u};
    int ready = ppoll(fds, i + 1, wake == NEVER ? NULL : &limit, NULL);
#else
    int ms = wait < msToNs(3600000) ? (int)((wait + 999999) / 1000000) : 3600000;
    int ready = poll(fds, i + 1, wake == NEVER ? -1 : ms);
#endif
    s->looked = now;
    if (ready <= 0)
        return;
    now = epicsMonotonicGet();
    if (fds[0].revents)
        drainPipe(s);
    /* The leader first: who is late to look must not take the other's block for a sign that
     * the leader is silent. */
    first = s->leader > 0 ? s->leader : 0;
    for (n = 0; n < s->policy->links; n++) {
        i = first ^ n;
        if (fds[i + 1].revents)
            lineReady(s, i, fds[i + 1].revents, now);
    }
}

void plcStationThread(void *arg)
{
    plcStation *s = arg;
    int ran = 0;
    unsigned i;

    begin(s);
    while (!epicsAtomicGetIntT(&s->stop)) {
        epicsUInt64 now = epicsMonotonicGet();
        epicsUInt64 wake = NEVER;

        takeOrders(s, now);
        if (!ran && epicsAtomicGetIntT(&s->running)) {
            /* Blocks that came before scans were on have reached no record. */
            ran = 1;
            if (s->valid)
                plcScanRequestAll(s->inScan);
            plcScanRequestAll(s->statusScan);
            if (epicsAtomicGetIntT(&s->leads))
                requestFollow(s, 0);
        }
        if (s->policyWake && s->looked >= s->policyWake)
            tellPolicy(s, plcEventTick, 0, now);
        for (i = 0; i < s->policy->links; i++)
            lineStep(s, i, now, &wake);
        dataStep(s, &wake);
        aliveStep(s, now, &wake);
        holdStep(s, now, &wake);
        outputStep(s, now, &wake);
        outScanStep(s, now, &wake);
        statsStep(s, now, &wake);
        if (s->policyWake)
            earlier(&wake, s->policyWake);
        waitFor(s, wake);
    }
    for (i = 0; i < s->policy->links; i++) {
        plcConnectionClose(&s->lines[i].connection, NULL, 0);
        plcResolverRelease(s->lines[i].resolver);
        s->lines[i].resolver = NULL;
    }
    if (s->policy->end)
        s->policy->end(s->policyPvt);
    epicsEventSignal(s->ended);
}
