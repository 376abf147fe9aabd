/* From a block to the records: what the station's thread does with the data of the PLC
 * that leads: time stamp, validity, alive word, read-back of outputs, sync handshake,
 * delivery.
 *
 * Knows nothing of sockets. All functions run in the station's thread.
 */
#include <string.h>

#include <epicsAtomic.h>
#include <epicsStdio.h>
#include <errlog.h>

#include "plcClock.h"
#include "plcHot.h"
#include "plcStationPvt.h"

/* A put may take this long, beyond the send interval, until the PLC shows it; ms. */
#define SHOWN_MS 1000

/* So long a PLC may refuse before we say what may be wrong, ms. */
#define SYNC_DOUBT_MS 5000

/* So long after its queue was full the callback is asked for again, ms. */
#define AGAIN_MS 50

/* Records are told in a callback. Not while iocInit initialises them: it is made up for when
 * the IOC runs. */
static void askFollow(plcStation *s)
{
    s->followAgain = 0;
    if (!epicsAtomicGetIntT(&s->running) || !epicsAtomicGetIntT(&s->follows) ||
        epicsAtomicCmpAndSwapIntT(&s->following, 0, 1))
        return;
    if (callbackRequest(&s->followCallback)) {
        epicsAtomicSetIntT(&s->following, 0);
        plcScanQueueFull();
        s->followAgain = epicsMonotonicGet() + plcMsToNs(AGAIN_MS);
    }
}

void plcInputFollow(plcStation *s, unsigned places)
{
    epicsMutexMustLock(s->lock);
    s->stats.readbacks += places;
    epicsMutexUnlock(s->lock);
    askFollow(s);
    plcStationChanged(s);
}

PLC_HOT void plcInputFollowStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    int wanted = epicsAtomicGetIntT(&s->tell) && epicsAtomicCmpAndSwapIntT(&s->tell, 1, 0);

    if (wanted || (s->followAgain && now >= s->followAgain))
        askFollow(s);
    if (s->followAgain)
        plcEarlier(wake, s->followAgain);
}

/* Outputs go somewhere. A wire that acknowledges puts is connected when it has answered: a server that
 * takes connections and is silent would else be connected for a second, again and again. */
static void tellOutputs(plcStation *s)
{
    int goes = epicsAtomicGetIntT(&s->leads) &&
               !(s->shows && epicsAtomicGetIntT(&s->waitsFirst));
    int before;

    epicsMutexMustLock(s->lock);
    before = s->stats.outputConnected;
    s->stats.outputConnected = goes;
    epicsMutexUnlock(s->lock);
    if (goes != before)
        plcStationChanged(s);
}

/* What the PLC holds of the outputs is read by requests on each connection, blocks or not. */
void plcInputHeld(plcStation *s)
{
    int before = epicsAtomicGetIntT(&s->waitsFirst), held;

    if (s->now.sync)
        held = 0; /* puts are refused */
    else if (s->shows)
        held = !epicsAtomicGetIntT(&s->taken);
    else
        held = (s->now.layoutAt >= 0 && s->layoutState == plcLayoutUnknown) ||
               (plcReadbackCount(s->readback) && !epicsAtomicGetIntT(&s->taken));
    if (held == before)
        return;
    epicsAtomicSetIntT(&s->waitsFirst, held);
    tellOutputs(s);
    if (!held)
        plcInputFollow(s, 0);
}

/* For record threads: outputs go somewhere, or soon will. While the data of a pair is
 * valid, a new leader is expected, and it will get them. */
void plcInputSetLeads(plcStation *s)
{
    int before = epicsAtomicGetIntT(&s->leads);
    int connected = s->leader >= 0 || (plcStationIsPair(s) && s->valid);
    int leads = connected;

    plcInputHeld(s);
    if (plcStationHasOutLine(s))
        leads = s->lines[s->outLine].connection.state == plcConnectionUp;
    /* Who accepts connections and answers nothing is not there: that changes with an answer. */
    if (s->shows && s->lines[s->outLine].lostEmpty)
        leads = 0;
    epicsAtomicSetIntT(&s->connected, connected);
    epicsAtomicSetIntT(&s->leads, leads);
    tellOutputs(s);
    if (leads != before)
        plcStationChanged(s);
    plcStationGate(s);
    if (leads != before)
        plcInputFollow(s, 0);
}

/* ok is what the PLC shows all of. The lock is held. */
static int refine(const plcStats *stats, int state)
{
    if (state != plcStateOk || !stats->refusedReads)
        return state;
    return stats->refusedReads < stats->refusedOf ? plcStateSome : plcStateRefused;
}

static void setState(plcStation *s, int state)
{
    int alive;

    epicsMutexMustLock(s->lock);
    state = refine(&s->stats, state);
    alive = state == plcStateOk || state == plcStateSome;
    if (state != s->stats.state)
        s->stats.stateSince = epicsMonotonicGet();
    if (s->stats.alive && !alive)
        epicsTimeGetCurrent(&s->stats.lostTime);
    s->stats.state = state;
    s->stats.alive = alive;
    epicsMutexUnlock(s->lock);
}

void plcInputRefused(plcStation *s, unsigned count, unsigned of, const char *first)
{
    epicsMutexMustLock(s->lock);
    s->stats.refusedReads = count;
    s->stats.refusedOf = of;
    s->stats.refusal[0] = 0;
    if (count)
        epicsSnprintf(s->stats.refusal, sizeof(s->stats.refusal), "%s (%u of %u refused)", first,
                      count, of);
    epicsMutexUnlock(s->lock);
    if (s->valid && of)
        setState(s, plcStateOk);
}

/* The one place where a layout id in the input block (layoutAt) changes something. */
static void layoutShow(plcStation *s, int state)
{
    int before;

    epicsMutexMustLock(s->lock);
    before = s->layoutState;
    s->layoutState = state;
    s->stats.layoutMismatches += state == plcLayoutDiffers && before != state;
    epicsMutexUnlock(s->lock);
    if (before != state)
        plcStationGate(s);
}

/* Compares the layout id that the PLC shows at layoutAt. Returns 1 when its data is good. */
static int layoutAgrees(plcStation *s, const char *block)
{
    static const plcType *type;
    unsigned theirs, ours = (unsigned)s->now.layout;
    int state, before = s->layoutState;
    char text[120];

    if (s->now.layoutAt < 0)
        return 1;
    if (!type)
        type = plcTypeOf(plcUnsigned, 2);
    theirs = (unsigned)plcGetInt(type, block + (size_t)s->now.layoutAt, s->bigEndian);
    state = ours && theirs && ours != theirs ? plcLayoutDiffers : plcLayoutAgrees;
    epicsMutexMustLock(s->lock);
    s->stats.layoutPlc = (int)theirs;
    epicsMutexUnlock(s->lock);
    if (state == plcLayoutDiffers && before != state) {
        epicsSnprintf(text, sizeof(text), "layout: the PLC has layout id %u at byte %u, the "
                      "IOC %u; nothing is sent", theirs, (unsigned)s->now.layoutAt, ours);
        plcStationLog(s, errlogMajor, text);
    }
    if (state == plcLayoutAgrees && before == plcLayoutDiffers)
        plcStationLog(s, errlogInfo, "layout: the ids of PLC and IOC agree again");
    layoutShow(s, state);
    return state == plcLayoutAgrees;
}

/* The data of the PLC is not to be used, or there is a better reason why not. I/O Intr
 * records process once when data was lost, and never before there was any: sites hang
 * chains on the first processing, which must see the first block. */
PLC_COLD void plcInputInvalidate(plcStation *s, int state, const char *reason)
{
    int lost = s->valid;
    char before[PLC_REASON_SIZE];

    plcImageReason(s->in, before);
    setState(s, state);
    if (state != plcStateLayout)
        layoutShow(s, plcLayoutUnknown);
    s->holding = 0;
    s->valid = 0;
    if (!plcStationHasOutLine(s)) /* else the outputs have a fate of their own */
        epicsAtomicSetIntT(&s->taken, 0);
    plcInputSetLeads(s);
    plcImageInvalidate(s->in, reason);
    if (lost)
        plcScanRequestAll(s->inScan);
    plcScanRequestAll(s->statusScan);
    if (strncmp(before, reason, PLC_REASON_SIZE - 1))
        plcInputFollow(s, 0);
    else
        plcStationChanged(s);
}

void plcInputNone(plcStation *s)
{
    epicsTimeStamp now;

    epicsTimeGetCurrent(&now);
    plcImagePublish(s->in, "", &now);
    setState(s, plcStateOk);
    s->valid = 1;
    plcScanRequestAll(s->inScan);
}

/* The time stamp of a block: its arrival, or the PLC's own clock. */
PLC_HOT epicsTimeStamp plcInputStamp(plcStation *s, const char *block)
{
    epicsTimeStamp arrival, plc;
    int bad;

    epicsTimeGetCurrent(&arrival);
    if (s->now.timestamp < 0)
        return arrival;
    block += (size_t)s->now.timestamp;
    bad = s->now.timestampFormat == plcClockIsDtl ? plcClockDtl(block, s->bigEndian, &plc)
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
PLC_HOT static void deliver(plcStation *s, const void *block, const epicsTimeStamp *stamp,
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
    if (s->listener && s->listener->delivered)
        s->listener->delivered(s->listenerPvt, block, stamp);
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
    epicsUInt64 due = s->lastDeliver + plcMsToNs(s->now.minUpdate);

    if (!s->valid)
        return 1;
    if (s->now.minUpdate > 0 && now < due) {
        plcEarlier(wake, due);
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

PLC_HOT void plcInputHoldStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
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
    word = plcGetInt(s->now.aliveType, block + (size_t)s->now.alive, s->order);
    if (s->lastAlive && word == s->aliveWord)
        return !s->frozen;
    s->aliveWord = word;
    s->lastAlive = now;
    if (s->frozen)
        plcStationLog(s, errlogInfo, "alive again");
    s->frozen = 0;
    return 1;
}

PLC_HOT void plcInputAliveStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    epicsUInt64 due = s->lastAlive + plcMsToNs(s->now.aliveTimeout);

    if (s->now.alive < 0 || !s->lastAlive || s->frozen || !s->valid)
        return;
    if (now < due) {
        plcEarlier(wake, due);
        return;
    }
    s->frozen = 1;
    plcStationLog(s, errlogMajor, "frozen: blocks come, but the alive word stands still");
    plcInputInvalidate(s, plcStateFrozen, "PLC frozen: alive word stands still");
}

/* The bits of the block that the PLC did not show; NULL: it has shown all. */
static const void *notInBlock(plcStation *s)
{
    return s->inFaults && plcFaultsMask(s->inFaults, s->notInBlock) ? s->notInBlock : NULL;
}

/* The outputs take what the PLC shows. */
PLC_COLD static void takeReadback(plcStation *s, const void *block)
{
    int first = !epicsAtomicGetIntT(&s->taken);
    unsigned places;

    places = plcReadbackTake(s->readback, block, notInBlock(s), s->out);
    /* What was put there before is void: no block leaves because of it. */
    if (first && !epicsAtomicGetIntT(&s->written)) {
        plcImageForget(s->out);
        s->dirtySince = 0;
    }
    if (first) {
        epicsAtomicSetSizeT(&s->arrived, s->takesSeen[1]);
        epicsAtomicSetSizeT(&s->left, plcImageTakes(s->out));
        epicsAtomicIncrIntT(&s->takes);
        epicsAtomicSetIntT(&s->followed, 0); /* as all that followers have put */
    }

    epicsAtomicSetIntT(&s->taken, 1);
    plcInputHeld(s);
    if (places || first)
        plcInputFollow(s, places);
}

/* The first block of a connection. Where the wire shows what the PLC holds of the
 * outputs, that counts; the block does where it does not. */
static void takeShown(plcStation *s, const void *block)
{
    if (s->shows && !s->unread)
        return;
    takeReadback(s, block);
    if (s->shows)
        plcImagePutAgain(s->out, NULL, NULL);
}

/* Places of records that joined later, whose link is new: they begin with the PLC's value. */
static void takeNew(plcStation *s, const void *block)
{
    unsigned places = plcReadbackTakeNew(s->readback, block, notInBlock(s), s->out);

    if (places)
        plcInputFollow(s, places);
}

/* Outputs follow the PLC from block to block. */
static void trackReadback(plcStation *s, const void *block, epicsUInt64 now)
{
    epicsUInt64 limit = plcMsToNs(s->now.sendInterval + SHOWN_MS);
    int through = !plcReadbackWaiting(s->readback) || plcStationDelivered(s);
    unsigned places =
        plcReadbackTrack(s->readback, block, notInBlock(s), s->out, now, limit, through, NULL);

    if (places)
        plcInputFollow(s, places);
}

/* The one place where the state of the handshake shows to others. */
PLC_COLD static void syncShow(plcStation *s, epicsUInt64 now)
{
    int before, remote = (s->sync.flags & plcFlagRemote) != 0;
    char text[120];

    epicsMutexMustLock(s->lock);
    before = s->stats.syncState;
    s->stats.syncState = s->sync.state;
    s->stats.remote = remote;
    s->stats.layoutPlc = s->sync.theirs;
    s->stats.layoutMismatches += s->sync.state == plcSyncLayoutMismatch &&
                                 before != plcSyncLayoutMismatch;
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
                  s->sync.flags & plcFlagTimeout ? " (the PLC's watchdog had expired)"
                                                 : "");
    if (s->sync.state == plcSyncLayoutMismatch)
        epicsSnprintf(text, sizeof(text),
                      "sync: the PLC has layout id %u, the IOC %u; "
                      "nothing is sent",
                      s->sync.theirs, s->sync.layout);
    plcStationLog(s, s->sync.state == plcSyncLayoutMismatch ? errlogMajor : errlogInfo,
                  text);
    plcScanRequestAll(s->statusScan);
}

/* A PLC that never agrees compares something that we do not read back. Says so once. */
PLC_COLD static void syncDoubt(plcStation *s, epicsUInt64 now)
{
    if (s->sync.state != plcSyncChecking || s->syncDoubted ||
        now - s->syncSince < plcMsToNs(SYNC_DOUBT_MS))
        return;
    s->syncDoubted = 1;
    plcStationLog(
        s, errlogMinor,
        "sync: the PLC does not agree. Does it show every setpoint "
        "that it compares, and has each an output record with R= or readback=?");
}

/* Another PLC gets our output (leader >= 0), or none. */
void plcInputSyncLeader(plcStation *s, epicsUInt64 now)
{
    if (!s->now.sync)
        return;
    if (s->leader >= 0)
        plcSyncConnected(&s->sync);
    else
        plcSyncLost(&s->sync);
    plcTablesLeader(s);
    syncShow(s, now);
}

/* What had left before the block before this one has reached the PLC, for all that is known. */
static void seeTakes(plcStation *s)
{
    if (!plcReadbackCount(s->readback) || !epicsAtomicGetIntT(&s->taken))
        return;
    s->takesSeen[1] = s->takesSeen[0];
    s->takesSeen[0] = plcImageTakes(s->out);
}

/* What the block says of our outputs. Returns 1 when its data is good. Before the PINI
 * run is over nothing is taken: its values would come later and count as puts. */
static int outputsFollow(plcStation *s, const void *block, epicsUInt64 now)
{
    int todo, same;

    if (!epicsAtomicGetIntT(&s->running))
        return plcTablesLook(s, block);
    seeTakes(s);
    if (!s->now.sync && plcReadbackCount(s->readback)) {
        if (!epicsAtomicGetIntT(&s->taken))
            takeShown(s, block);
        else
            takeNew(s, block);
        if (s->now.track)
            trackReadback(s, block, now);
    }
    if (!s->now.sync)
        return 1;
    if (!plcTablesLook(s, block)) {
        syncShow(s, now);
        return 0;
    }
    same =
        s->sync.state == plcSyncChecking && plcReadbackSame(s->readback, block, s->out);
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

/* Why the data of the PLC is not what our records expect. */
static const char *disagreement(const plcStation *s)
{
    int tables = s->sync.state == plcSyncMapMismatch || s->sync.state == plcSyncMapDownload;

    return plcSyncReason(tables ? (int)s->sync.state : plcSyncLayoutMismatch);
}

/* Whole blocks came from the PLC that leads; this is the newest. */
PLC_HOT void plcInputBlock(plcStation *s, const void *block, epicsTimeStamp stamp,
                           size_t count, epicsUInt64 now)
{
    epicsUInt64 wake = PLC_NEVER;

    if (plcStationTraces(s, PLC_TRACE_BLOCKS))
        plcStationTraceBlock(s, "in", block, plcImageSize(s->in));
    if (s->listener && s->listener->received)
        s->listener->received(s->listenerPvt, block);
    epicsMutexMustLock(s->lock);
    if (s->lastBlock)
        plcStatsPeriod(&s->stats, (now - s->lastBlock) / PLC_NS_PER_MS / count);
    s->stats.lastBlock = now;
    s->stats.blockTime = stamp;
    if (s->holding)
        s->stats.coalesced++;
    epicsMutexUnlock(s->lock);
    s->lastBlock = now;
    if (!layoutAgrees(s, block) || !outputsFollow(s, block, now)) {
        plcInputInvalidate(s, plcStateLayout, disagreement(s));
        return;
    }
    if (!aliveWord(s, block, now))
        return;
    if (mayDeliver(s, now, &wake)) {
        deliver(s, block, &stamp, now);
    } else {
        memcpy(s->held, block, plcImageSize(s->in));
        s->heldStamp = stamp;
        s->holding = 1;
    }
}
