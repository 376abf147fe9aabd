/* What records ask of a station; any thread, see plcStation.h.
 *
 * Only copies, and words left for the thread.
 */
#include <string.h>

#include <epicsAtomic.h>
#include <epicsStdio.h>

#include "plcStationPvt.h"

const char *plcStationName(const plcStation *s)
{
    return s->name;
}

int plcStationOrder(const plcStation *s)
{
    return s->order;
}

int plcStationTextOrder(const plcStation *s)
{
    return s->textOrder;
}

const char *plcStationByName(const plcStation *s)
{
    return s->exchange && s->exchange->transport->used ? s->exchange->transport->name : NULL;
}

const char *plcStationNameForm(const plcStation *s)
{
    return plcStationByName(s) ? s->exchange->transport->form : NULL;
}

int plcStationTells(const plcStation *s, const void *image, size_t offset, char *what,
                    size_t whatSize, char *value, size_t valueSize)
{
    const plcExchange *x = s->exchange;

    if (!x || !x->transport->tells)
        return 0;
    x->transport->tells(x->pvt, image, offset, what, whatSize, value, valueSize);
    return 1;
}

int plcStationHolds(const plcStation *s, int output, size_t offset, size_t length,
                    const void *mask, size_t *fits, char *error, size_t errorSize)
{
    const plcExchange *x = s->exchange;

    error[0] = 0;
    if (!x || !x->transport->holds || (!output && x->line))
        return 1;
    return x->transport->holds(x->pvt, output, offset, length, mask, fits, error, errorSize);
}

size_t plcStationInSize(const plcStation *s)
{
    return s->inSize;
}

size_t plcStationOutSize(const plcStation *s)
{
    return s->outSize;
}

plcImage *plcStationInput(plcStation *s)
{
    return s->in;
}

plcImage *plcStationOutput(plcStation *s)
{
    return s->out;
}

int plcStationPutBy(plcStation *s, plcLastPut *last, size_t offset, size_t length,
                    const void *data, const void *mask, char reason[PLC_REASON_SIZE],
                    int follows, plcPutMark *mark)
{
    epicsUInt64 now = epicsMonotonicGet();
    plcWritten written = {.last = last};
    plcPutMark ignored;
    int status;

    if (!mark)
        mark = &ignored;
    mark->losses = epicsAtomicGetIntT(&s->outLosses);
    status = plcReadbackWrite(s->readback, s->tracked, s->out, offset, length, data, mask,
                              &written, now);
    reason[0] = 0;
    mark->number = 0;
    if (status < 0) {
        epicsMutexMustLock(s->lock);
        s->stats.refusedWrites++;
        memcpy(reason, s->refusal, PLC_REASON_SIZE);
        epicsMutexUnlock(s->lock);
        if (plcStationTraces(s, PLC_TRACE_PUTS))
            plcStationTracePut(s, offset, length, data, mask, reason);
        return -1;
    }
    if (plcStationTraces(s, PLC_TRACE_PUTS))
        plcStationTracePut(s, offset, length, data, mask, NULL);
    epicsAtomicSetIntT(follows ? &s->followed : &s->written, 1);
    if (status > 0)
        plcStationWake(s);
    plcStationKeeps(s, follows, reason);
    if (epicsAtomicGetIntT(&s->acknowledges))
        mark->number = written.number;
    return 0;
}

int plcStationPut(plcStation *s, size_t offset, size_t length, const void *data,
                  const void *mask, char reason[PLC_REASON_SIZE], int follows,
                  plcPutMark *mark)
{
    return plcStationPutBy(s, NULL, offset, length, data, mask, reason, follows, mark);
}

int plcStationKeeps(plcStation *s, int follows, char reason[PLC_REASON_SIZE])
{
    if (!plcStationOutputConnected(s, reason))
        return 1;
    if (follows && !plcStationTaken(s))
        strcpy(reason, "waiting for the PLC's value");
    else if (!follows && plcStationHeld(s))
        epicsSnprintf(reason, PLC_REASON_SIZE, "waits for the PLC's first %s",
                      s->shows ? "answer" : "block");
    return reason[0] != 0;
}

const char *plcStationVoid(plcStation *s, const plcLastPut *last)
{
    if (s->exchange || last->takes < epicsAtomicGetSizeT(&s->arrived))
        return NULL;
    return last->takes < epicsAtomicGetSizeT(&s->left) ? plcNotConfirmed : plcNotWritten;
}

int plcStationAcknowledges(plcStation *s)
{
    return s->exchange && s->exchange->transport->takesPuts;
}

int plcStationThrough(plcStation *s, const plcPutMark *mark)
{
    return mark->losses != epicsAtomicGetIntT(&s->outLosses) ||
           plcImagePutsThrough(s->out, NULL) >= mark->number;
}

plcPutFate plcStationCancel(plcStation *s, const plcPutMark *mark, size_t offset, size_t length,
                            const void *mask)
{
    int lost = mark->losses != epicsAtomicGetIntT(&s->outLosses);
    plcPutFate fate = plcImageCancel(s->out, mark->number, offset, length, mask);

    return fate == plcPutNever && lost ? plcPutMaybe : fate;
}

static void throughNow(epicsCallback *callback)
{
    plcStation *s;

    callbackGetUser(s, callback);
    epicsAtomicSetIntT(&s->telling, 0);
    s->through(s);
}

void plcStationOnThrough(plcStation *s, void (*through)(plcStation *station))
{
    epicsMutexMustLock(s->lock);
    if (!s->through) {
        callbackSetCallback(throughNow, &s->throughCallback);
        callbackSetPriority(priorityMedium, &s->throughCallback);
        callbackSetUser(s, &s->throughCallback);
        s->through = through;
    }
    epicsMutexUnlock(s->lock);
}

void plcStationAwait(plcStation *s, int more)
{
    epicsAtomicAddIntT(&s->awaited, more);
}

int plcStationListen(plcStation *s, const plcListener *listener, void *pvt)
{
    if (s->started || (s->listener && listener))
        return -1;
    s->listener = listener;
    s->listenerPvt = pvt;
    return 0;
}

void plcStationAddReadback(plcStation *s, const void *key, size_t out, size_t in,
                           size_t length, const void *mask)
{
    int placed = in != PLC_NO_PLACE;

    if (placed)
        plcReadbackAdd(s->readback, key, out, in, length, mask);
    if (s->shows)
        plcReadbackAdd(placed ? s->atConnect : s->tracked, key, out, out, length, mask);
    epicsMutexMustLock(s->lock);
    s->optionsChanged = 1; /* a duty more for the thread: see chooseScanThread */
    epicsMutexUnlock(s->lock);
    plcStationWake(s);
}

void plcStationRemoveReadback(plcStation *s, const void *key)
{
    plcReadbackRemove(s->readback, key);
    plcReadbackRemove(s->atConnect, key);
    plcReadbackRemove(s->tracked, key);
    plcStationWake(s); /* was it the last one? then outputs need not wait for it */
}

int plcStationStops(const plcStation *s)
{
    return epicsAtomicGetIntT(&s->stop);
}

int plcStationTracks(plcStation *s)
{
    int track;

    epicsMutexMustLock(s->lock);
    track = s->options.track;
    epicsMutexUnlock(s->lock);
    return track;
}

int plcStationShowsOutputs(plcStation *s)
{
    return s->shows && plcStationTracks(s);
}

long plcStationMirror(plcStation *s)
{
    long offset;

    epicsMutexMustLock(s->lock);
    offset = (long)s->options.readback;
    epicsMutexUnlock(s->lock);
    return offset;
}

int plcStationTaken(plcStation *s)
{
    return epicsAtomicGetIntT(&s->taken);
}

static void followNow(epicsCallback *callback)
{
    plcStation *s;

    callbackGetUser(s, callback);
    epicsAtomicSetIntT(&s->following, 0);
    s->follow(s);
}

void plcStationOnTake(plcStation *s, void (*follow)(plcStation *station))
{
    epicsMutexMustLock(s->lock);
    if (!epicsAtomicGetIntT(&s->follows)) { /* the callback may be in use from now on */
        callbackSetCallback(followNow, &s->followCallback);
        callbackSetPriority(priorityMedium, &s->followCallback);
        callbackSetUser(s, &s->followCallback);
        s->follow = follow;
        epicsAtomicSetIntT(&s->follows, 1);
    }
    epicsMutexUnlock(s->lock);
}

int plcStationWrite(plcStation *s, size_t offset, size_t length, const void *data,
                    const void *mask, char reason[PLC_REASON_SIZE])
{
    return plcStationPut(s, offset, length, data, mask, reason, 0, NULL);
}

int plcStationTakes(plcStation *s)
{
    return epicsAtomicGetIntT(&s->takes);
}

int plcStationHeld(plcStation *s)
{
    return epicsAtomicGetIntT(&s->waitsFirst);
}

void plcStationTell(plcStation *s)
{
    epicsAtomicSetIntT(&s->tell, 1);
    plcStationWake(s);
}

void plcStationTellLater(plcStation *s)
{
    epicsAtomicSetIntT(&s->tell, 1);
}

/* Fills reason (unless NULL) with why, which is guarded by the lock, unless it is fine. */
static int sayWhy(plcStation *s, int fine, const char *why, char *reason)
{
    if (!reason)
        return fine;
    reason[0] = 0;
    if (fine)
        return 1;
    epicsMutexMustLock(s->lock);
    memcpy(reason, why, PLC_REASON_SIZE);
    epicsMutexUnlock(s->lock);
    return 0;
}

int plcStationConnected(plcStation *s, char reason[PLC_REASON_SIZE])
{
    return sayWhy(s, epicsAtomicGetIntT(&s->connected), s->reason, reason);
}

int plcStationOutputConnected(plcStation *s, char reason[PLC_REASON_SIZE])
{
    return sayWhy(s, epicsAtomicGetIntT(&s->leads), plcStationOutReason(s), reason);
}

plcFaults *plcStationInFaults(plcStation *s)
{
    return s->inFaults;
}

plcFaults *plcStationOutFaults(plcStation *s)
{
    return s->outFaults;
}

int plcStationHides(plcStation *s, size_t offset, size_t length, const void *mask,
                    char reason[PLC_REASON_SIZE])
{
    return s->hidden && plcFaultsFind(s->hidden, offset, length, mask, reason);
}

IOSCANPVT plcStationInRecord(plcStation *s, size_t offset, size_t length,
                             struct dbCommon *prec, int leave)
{
    return plcScanRecord(s->inScan, offset, length, prec, leave);
}

IOSCANPVT plcStationInScan(plcStation *s, size_t offset, size_t length, int prio,
                           int leave)
{
    return plcScanJoin(s->inScan, offset, length, prio, leave);
}

IOSCANPVT plcStationOutScan(plcStation *s, int prio, int leave)
{
    return plcScanJoin(s->outScan, 0, s->outSize, prio, leave);
}

IOSCANPVT plcStationStatusRecord(plcStation *s, struct dbCommon *prec, int leave)
{
    return plcScanRecord(s->statusScan, 0, 0, prec, leave);
}

IOSCANPVT plcStationStatsScan(plcStation *s, int prio, int leave)
{
    IOSCANPVT list = plcScanJoin(s->statsScan, 0, 0, prio, leave);

    plcStationWake(s); /* its timer may have to start */
    return list;
}

plcLists *plcStationLists(plcStation *s)
{
    return &s->lists;
}

plcOwners *plcStationOwners(plcStation *s)
{
    return s->owners;
}
