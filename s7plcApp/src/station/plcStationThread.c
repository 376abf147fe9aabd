/* The thread of a station: it waits in poll() for a wake-up, its connections and its
 * timers, and does what they ask. It waits for nothing else, but for records in a small
 * scan pass (plcScanHere).
 *
 * Reads from top to bottom: output, statistics, loop. What comes in is handled in
 * plcStationLines.c and plcStationInput.c.
 */
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include <epicsAtomic.h>
#include <epicsStdio.h>
#include <errlog.h>

#include "plcHot.h"
#include "plcStationPvt.h"

/* With sync=on the PLC expects blocks, also where heartbeat= is not set; ms. */
#define SYNC_HEARTBEAT_MS 500

/* A block that is due waits so long for the PLC to take the one before, until that is called
 * slow; and so long the PLC must be fast until it is said again; ms. */
#define SLOW_MS 500
#define SLOW_AGAIN_MS 60000

/* How often it is looked whether the block before has left, at first and at last; ms. */
#define LOOK_MS 1
#define LOOK_MAX_MS 16

/* Records that hold up threads of PLCs are in the log once in so many seconds. */
#define HELD_AGAIN_S 60

/* --- Output ------------------------------------------------------------------------- */

static void countSent(plcStation *s, epicsUInt64 now)
{
    epicsMutexMustLock(s->lock);
    s->stats.blocksOut++;
    s->stats.bytesOut += s->outSize;
    s->stats.lastSend = now;
    if (s->dirtySince)
        plcStatsSend(&s->stats, (now - s->dirtySince) / PLC_NS_PER_MS);
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
    plcLine *line = &s->lines[leader];
    int status = line->transport->send(line->pvt, &line->connection, restart, now);

    if (status > 0) {
        countSent(s, now);
        if (plcStationTraces(s, PLC_TRACE_BLOCKS))
            plcStationTraceBlock(s, "out", line->transport->space(line->pvt), s->outSize);
        if (s->listener && s->listener->sent)
            s->listener->sent(s->listenerPvt, line->transport->space(line->pvt));
    } else if (status < 0) {
        plcLineLost(s, leader, now, line->connection.error);
    }
    if (status)
        *wake = now;
}

/* When the output image should leave; PLC_NEVER when there is no reason to. */
static epicsUInt64 sendDue(plcStation *s)
{
    epicsUInt64 due = PLC_NEVER, free;

    if (s->dirtySince) {
        due = s->dirtySince + plcMsToNs(s->now.holdoff);
        free = s->lastSend ? s->lastSend + plcMsToNs(s->now.sendInterval) : 0;
        return due > free ? due : free;
    }
    if (s->now.heartbeat > 0)
        due = s->lastSend ? s->lastSend + plcMsToNs(s->now.heartbeat) : 0;
    else if (s->now.sync)
        due = s->lastSend ? s->lastSend + plcMsToNs(SYNC_HEARTBEAT_MS) : 0;
    return due;
}

/* A PLC that must show its layout id (layoutAt) has shown the one that we have. */
static int layoutKnown(const plcStation *s)
{
    return s->now.layoutAt < 0 || s->layoutState == plcLayoutAgrees;
}

/* Not before the PLC has shown what it holds, where it does; not where sync forbids it.
 */
static int maySend(plcStation *s)
{
    if (s->now.sync)
        return plcSyncMaySend(&s->sync) || s->tables.command;
    return epicsAtomicGetIntT(&s->taken) || !plcReadbackCount(s->readback);
}

/* A block is due, but the one before has not left: nothing queues up, the newest values
 * count when it has. No event tells when that is. */
PLC_COLD static void waitToSend(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    if (!s->slowSince) {
        s->slowSince = now;
        s->slowLook = plcMsToNs(LOOK_MS);
        epicsMutexMustLock(s->lock);
        s->stats.slowSends++;
        epicsMutexUnlock(s->lock);
    } else if (s->slowLook < plcMsToNs(LOOK_MAX_MS)) {
        s->slowLook *= 2;
    }
    plcEarlier(wake, now + s->slowLook);
    if (now - s->slowSince < plcMsToNs(SLOW_MS))
        return;
    if (!s->slowSaid || now - s->slowSaid >= plcMsToNs(SLOW_AGAIN_MS))
        plcStationLog(s, errlogMinor, "PLC takes blocks slowly: what is put waits for it");
    s->slowSaid = now;
}

/* Makes the block that leaves now: the image, with what the handshake or the download of the table
 * of pointers has to say. */
static void makeBlock(plcStation *s, char *block)
{
    if (plcImageTake(s->out, block) || s->saidDropped)
        plcStationCountPuts(s);
    if (s->now.sync)
        plcSyncHeader(&s->sync, block, s->bigEndian);
    if (s->tables.command)
        block[0] = (char)plcTablesPack(&s->tables, block, s->bigEndian);
}

static void outputStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    plcLine *line;
    plcConnection *c;
    epicsUInt64 due;

    if (!epicsAtomicGetIntT(&s->running) || !s->outSize || !layoutKnown(s))
        return;
    if (s->exchange) {
        plcExchangeOutputStep(s, now, wake);
        return;
    }
    if (s->leader < 0)
        return;
    line = &s->lines[s->leader];
    c = &line->connection;
    if (c->state != plcConnectionUp || !maySend(s))
        return;
    if (line->transport->sending(line->pvt)) {
        sendBlock(s, 0, now, wake);
        if (c->state != plcConnectionUp || !line->transport->sending(line->pvt))
            return;
    } else if (!s->dirtySince && plcImageDirty(s->out)) {
        s->dirtySince = now;
    }
    due = epicsAtomicGetIntT(&s->sendNow) || s->tables.command ? 0 : sendDue(s);
    if (now < due) {
        s->slowSince = 0;
        plcEarlier(wake, due);
        return;
    }
    if (line->transport->sending(line->pvt) || !plcConnectionReady(c, now)) {
        waitToSend(s, now, wake);
        return;
    }
    s->slowSince = 0;
    epicsAtomicSetIntT(&s->sendNow, 0);
    makeBlock(s, line->transport->space(line->pvt));
    s->lastSend = now;
    sendBlock(s, 1, now, wake);
}

/* Output records with SCAN=I/O Intr: every sendInterval while connected. */
static void outScanStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    if (!epicsAtomicGetIntT(&s->leads) || !epicsAtomicGetIntT(&s->running) ||
        !plcScanCount(s->outScan))
        return;
    if (now >= s->nextOutScan) {
        plcScanRequestAll(s->outScan);
        s->nextOutScan += plcMsToNs(s->now.sendInterval);
        if (s->nextOutScan <= now)
            s->nextOutScan = now + plcMsToNs(s->now.sendInterval);
    }
    plcEarlier(wake, s->nextOutScan);
}

/* --- Statistics --------------------------------------------------------------------- */

#define STATS_PERIOD_MS 1000

/* Records of statistics: at once when the state changes, else once a second. */
static void statsStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    int state;

    if (!epicsAtomicGetIntT(&s->running) || !plcScanCount(s->statsScan))
        return;
    epicsMutexMustLock(s->lock);
    state = s->stats.state | s->stats.syncState << 8 | s->stats.remote << 16 |
            s->stats.mapState << 17 | s->stats.mapProgress << 21;
    epicsMutexUnlock(s->lock);
    if (state != s->toldState || s->leader != s->toldLeader || now >= s->nextStatsScan) {
        s->toldState = state;
        s->toldLeader = s->leader;
        s->nextStatsScan = now + plcMsToNs(STATS_PERIOD_MS);
        plcScanRequestAll(s->statsScan);
    }
    plcEarlier(wake, s->nextStatsScan);
}

/* --- Loop --------------------------------------------------------------------------- */

/* With track=on read-backs know what was put. What was put before may be on its way. */
PLC_COLD static void noteWrites(plcStation *s, epicsUInt64 now)
{
    int on = s->now.track && !s->now.sync;
    int leaves = plcImageDirty(s->out);

    plcReadbackNote(s->readback, on);
    plcReadbackNote(s->tracked, on);
    if (!on || s->tracks == on) {
        s->tracks = on;
        return;
    }
    s->tracks = on;
    if (!epicsAtomicGetIntT(&s->taken))
        return;
    plcReadbackWait(s->readback, s->out, now, leaves);
    plcReadbackWait(s->tracked, s->out, now, leaves);
}

/* True when somebody counts on this thread: the watchdog of a PLC, its partner, who compares
 * outputs with what the PLC shows. A record that waits must not hold it up then. */
static int hasDuty(plcStation *s)
{
    return s->now.heartbeat > 0 || s->now.sync || plcStationIsPair(s) ||
           plcReadbackCount(s->readback) || plcReadbackCount(s->tracked);
}

static void chooseScanThread(plcStation *s)
{
    plcScanHere(s->inScan, s->now.scanThread == plcPassOwn && !hasDuty(s));
}

/* True for the first PLC that asks; for others not before a minute is over: where the machine
 * stood still, it stood still for all. */
static int firstToSay(epicsUInt64 now)
{
    static size_t next; /* s, monotonic; atomic */
    size_t before = epicsAtomicGetSizeT(&next), seconds = (size_t)(now / 1000000000u);

    return seconds >= before &&
           epicsAtomicCmpAndSwapSizeT(&next, before, seconds + HELD_AGAIN_S) == before;
}

/* A record made this thread wait. Says so once; s7plcReport does for each PLC. */
static void heldUp(plcStation *s, epicsUInt64 now)
{
    double ms = s->heldTold ? 0 : plcScanHeld(s->inScan);
    char text[200];

    if (!(ms > 0))
        return;
    s->heldTold = 1;
    if (!firstToSay(now))
        return;
    epicsSnprintf(text, sizeof(text),
                  "records that process by I/O Intr took %.0f ms, and the PLC's own thread "
                  "waited for them: callback threads process them from now on",
                  ms);
    plcStationLog(s, errlogMinor, text);
}

static void tellIdle(void *arg, const char *line)
{
    plcStationLog(arg, errlogMinor, line);
}

/* Options that are new in s->now, and do nothing here. */
PLC_COLD static void lookAtOptions(plcStation *s, const plcOptions *before)
{
    const char *names[PLC_LINES_MAX + 2] = {s->policy->name};
    unsigned i, wire = plcStationByName(s) ? 0 : plcOptOffsets;

    for (i = 0; i < s->lineCount; i++) {
        const plcTransport *t = s->lines[i].transport;

        names[i + 1] = t->name;
        wire |= t->receive && !(i && i == s->outLine) ? plcOptInBlocks : 0;
        wire |= t->news ? plcOptRequests : 0;
        wire |= t->takesPuts ? plcOptAcks : 0;
    }
    wire |= s->lines[s->outLine].transport->send ? plcOptOutBlocks : 0;
    plcOptionsIdle(before, &s->now, wire, names, tellIdle, s);
}

/* Takes over what other threads have changed. */
PLC_HOT static void takeOrders(plcStation *s, epicsUInt64 now)
{
    plcOptions before;
    const char *why;
    unsigned i;
    unsigned moved;
    int changed, up;

    epicsMutexMustLock(s->lock);
    changed = s->optionsChanged;
    if (changed) {
        before = s->now;
        s->now = s->options;
    }
    s->optionsChanged = 0;
    moved = s->moved;
    s->moved = 0;
    why = s->anew ? "connects anew by command" : "PLC address changed";
    s->anew = 0;
    epicsMutexUnlock(s->lock);
    if (changed && s->policy->options)
        s->policy->options(s->policyPvt, &s->now);
    if (changed)
        plcExchangeOptions(s);
    if (changed)
        lookAtOptions(s, &before);
    if (changed)
        chooseScanThread(s);
    if (changed)
        noteWrites(s, now);
    for (i = 0; i < s->lineCount; i++) {
        if (!(moved & 1u << i))
            continue;
        s->lines[i].logged = ~0u; /* that an attempt ends by an order is no failure to be told */
        up = s->lines[i].connection.state == plcConnectionUp;
        if (!up || plcLineDelivered(&s->lines[i]))
            plcConnectionClose(&s->lines[i].connection, why, now); /* in good order */
        if (up)
            plcLineLost(s, i, now, why);
        plcLineAddress(s, i, now);
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
    plcExchangeBegin(s);
    plcOptionsDefault(&s->now); /* what is set is new */
    takeOrders(s, 0);
    plcSyncInit(&s->sync, (epicsUInt16)s->now.layout);
    plcTablesStart(s);
    if (s->now.readback >= 0) {
        size_t header = plcStationHeader(s);

        plcReadbackAdd(s->readback, s, header, (size_t)s->now.readback + header,
                       s->outSize - header, NULL);
    }
    for (i = 0; i < s->lineCount; i++)
        plcLineAddress(s, i, 0);
    if (!s->lines[0].resolver) {
        plcStationReason(s, 0, "no address configured");
        plcInputInvalidate(s, plcStateNoAddress, "no address configured");
    }
}

/* Waits until something happens or the time `wake` comes. */
static void waitFor(plcStation *s, epicsUInt64 wake)
{
    struct pollfd fds[1 + PLC_LINES_MAX];
    epicsUInt64 now = epicsMonotonicGet();
    epicsUInt64 wait = wake > now ? wake - now : 0;
    unsigned i, n, first;

    fds[0].fd = plcWakeDescriptor(&s->wake);
    fds[0].events = POLLIN;
    for (i = 0; i < s->lineCount; i++)
        plcLinePoll(s, i, &fds[i + 1]);
#ifdef __linux__
    struct timespec limit = {wait / 1000000000u, wait % 1000000000u};
    int ready = ppoll(fds, i + 1, wake == PLC_NEVER ? NULL : &limit, NULL);
#else
    int ms = wait < plcMsToNs(3600000) ? (int)((wait + 999999) / 1000000) : 3600000;
    int ready = poll(fds, i + 1, wake == PLC_NEVER ? -1 : ms);
#endif
    s->looked = now;
    if (ready <= 0)
        return;
    now = epicsMonotonicGet();
    if (fds[0].revents)
        plcWakeTake(&s->wake);
    /* The leader first: who is late to look must not take the other's block for a sign
     * that the leader is silent. */
    first = s->leader > 0 ? s->leader : 0;
    for (n = 0; n < s->lineCount; n++) {
        i = first ^ n;
        if (fds[i + 1].revents)
            plcLineReady(s, i, fds[i + 1].revents, now);
    }
}

/* The IOC runs, for the first time or again after a pause (iocPause). Returns how often it
 * began to run. */
PLC_COLD static int goOn(plcStation *s, int before)
{
    int running = epicsAtomicGetIntT(&s->running);

    if (!before) {
        chooseScanThread(s); /* all records have joined */
        /* Blocks that came before scans were on have reached no record. */
        if (s->valid)
            plcScanRequestAll(s->inScan);
        plcScanRequestAll(s->statusScan);
        plcInputFollow(s, 0);
        return running;
    }
    plcScanResume(s->inScan);
    plcScanResume(s->outScan);
    plcScanResume(s->statusScan);
    plcScanResume(s->statsScan);
    return running;
}

static void exchangeStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    char why[PLC_REASON_SIZE];

    if (plcExchangeNews(s, now, plcLineOpened, wake, why))
        plcLineLost(s, s->exchange->line, now, why);
    plcExchangePuts(s, now, wake);
}

PLC_HOT void plcStationThread(plcStation *s)
{
    int ran = 0;
    unsigned i;

    begin(s);
    while (!epicsAtomicGetIntT(&s->stop)) {
        epicsUInt64 now = epicsMonotonicGet();
        epicsUInt64 wake = PLC_NEVER;

        takeOrders(s, now);
        if (ran != epicsAtomicGetIntT(&s->running))
            ran = goOn(s, ran);
        if (s->policyWake && s->looked >= s->policyWake)
            plcLineTellPolicy(s, plcEventTick, 0, now);
        if (s->exchange)
            exchangeStep(s, now, &wake);
        for (i = 0; i < s->lineCount; i++)
            plcLineStep(s, i, now, &wake);
        plcLineDataStep(s, &wake);
        plcInputAliveStep(s, now, &wake);
        plcInputHoldStep(s, now, &wake);
        plcInputHeld(s);
        plcInputFollowStep(s, now, &wake);
        outputStep(s, now, &wake);
        outScanStep(s, now, &wake);
        statsStep(s, now, &wake);
        heldUp(s, now);
        if (s->policyWake)
            plcEarlier(&wake, s->policyWake);
        waitFor(s, wake);
    }
    plcExchangeEnd(s);
    for (i = 0; i < s->lineCount; i++) {
        plcConnectionClose(&s->lines[i].connection, NULL, 0);
        plcResolverRelease(s->lines[i].resolver);
        s->lines[i].resolver = NULL;
    }
    if (s->policy->end)
        s->policy->end(s->policyPvt);
}
