/* Output records that wait for the PLC: over a wire that acknowledges puts a record is active
 * (PACT) from its put until the PLC has taken or refused it, so that put-callbacks, sequences
 * and forward links come after that, with the alarm that the answer brought.
 *
 * A record stays active for no other reason: when the connection is lost, or its link changes,
 * it ends at once. The value itself is in the output image.
 */
#include <stdlib.h>

#include <dbAccess.h>
#include <dbLock.h>

#include "devS7plc.h"

/* The record processes to its end. It is locked. */
static void finish(dbCommon *prec)
{
    prec->rset->process(prec);
}

/* The list is unlocked. A record that is in it may have a put that is through already: it is
 * looked at again after it has joined. */
int devPutWait(dbCommon *prec, devRecord *dev)
{
    if (!dev->mark.number || plcStationThrough(dev->station, &dev->mark))
        return 0;
    devListJoin(dev, devPutting);
    plcStationAwait(dev->station, 1);
    if (!plcStationThrough(dev->station, &dev->mark)) {
        prec->pact = TRUE;
        return 1;
    }
    return devPutLeave(dev) ? 0 : (prec->pact = TRUE, 1); /* else it is being finished */
}

int devPutLeave(devRecord *dev)
{
    int waits = devListLeave(dev, devPutting);

    if (waits)
        plcStationAwait(dev->station, -1);
    return waits;
}

static int isThrough(devRecord *dev)
{
    return plcStationThrough(dev->station, &dev->mark);
}

/* In a callback thread. The record may have got another link before it is locked. */
void devPutUpdate(plcStation *station)
{
    dbCommon *prec;

    while ((prec = devListTake(station, devPutting, isThrough))) {
        devRecord *dev;

        plcStationAwait(station, -1);
        dbScanLock(prec);
        dev = prec->dpvt;
        if (prec->pact && dev && dev->station == station && dev->mark.number &&
            !devIsIn(dev, devPutting)) {
            finish(prec);
            devFollowOne(prec, station);
        }
        dbScanUnlock(prec);
    }
}

/* --- A record whose link changes while it waits -------------------------------------------
 *
 * Its put ends here, with an alarm: whoever waits for it is told, forward links run, and nothing
 * leaves for the old place any more. */

static const char *const ends[] = {
    [plcPutNever] = "link changed: value not written",
    [plcPutMaybe] = "link changed: value maybe written",
};

/* The 0 at the end of a pulse, to the old place. Returns 0; or -1 and why it does not get there. */
static int putOff(devRecord *dev, char reason[PLC_REASON_SIZE])
{
    static const epicsUInt8 zeros[DEV_SCALAR];
    epicsUInt8 mask[DEV_SCALAR];
    int follows = dev->shown != NULL;

    if (plcStationAcknowledges(dev->station) && plcStationKeeps(dev->station, follows, reason))
        return -1;
    return plcStationPut(dev->station, dev->offset, dev->length, zeros, devMask(dev, mask), reason,
                         follows, NULL);
}

/* Returns the words for the alarm of a record that leaves a 1 behind. */
static const char *leaveOn(dbCommon *prec, devRecord *dev, const char *reason)
{
    plcImageWithdraw(dev->image, &dev->last);
    devWarn(prec, "the link has changed during its pulse, and 0 was not written (%s): @%s stays 1",
            reason, devLinkText(prec));
    return "link changed: the old place stays 1";
}

static void cancel(dbCommon *prec, devRecord *dev)
{
    char reason[PLC_REASON_SIZE];
    epicsUInt8 mask[DEV_SCALAR];
    plcPutFate fate =
        plcStationCancel(dev->station, &dev->mark, dev->offset, dev->length, devMask(dev, mask));

    if (fate == plcPutThrough) { /* its own answer has come meanwhile */
        if (plcImageWhyNot(dev->image, &dev->last, reason))
            plcImageWithdraw(dev->image, &dev->last);
        else if (dev->pulses && putOff(dev, reason))
            dev->ends = leaveOn(prec, dev, reason);
        if (!prec->rpro || dev->ends)
            return;
        fate = plcPutNever; /* of the put that was to follow */
    }
    dev->ends = ends[fate];
    devWarn(prec, "the link has changed while its put waited for the PLC: the old place %s",
            fate == plcPutNever ? "was not written" : "may have been written");
}

const char *devPutWithdraw(dbCommon *prec, devRecord *dev)
{
    char reason[PLC_REASON_SIZE] = "", why[PLC_REASON_SIZE];

    dev->ended |= dev->pulses;
    if (dev->pulses && putOff(dev, reason) == 0)
        return NULL;
    if (plcStationAcknowledges(dev->station) && plcImageWaits(dev->image, &dev->last)) {
        dev->mark.number = dev->last.number;
        cancel(prec, dev);
        return dev->ends;
    }
    if (plcImageWhyNot(dev->image, &dev->last, why)) {
        plcImageWithdraw(dev->image, &dev->last);
        return NULL;
    }
    return dev->pulses ? leaveOn(prec, dev, reason) : NULL;
}

void devPutAbandon(devRecord *dev)
{
    dbCommon *prec = dev->prec;
    const devSupport *support;
    double *pulse, length;

    if (!dev->mark.number || !prec || !prec->pact)
        return;
    if (plcStationStops(dev->station)) { /* the IOC ends: no link has changed */
        devPutLeave(dev);
        return;
    }
    support = devSupportOf(prec);
    pulse = support->pulse ? support->pulse(prec) : NULL;
    length = pulse ? *pulse : 0;
    if (pulse)
        *pulse = 0; /* the end of the pulse would go to the new place */
    devPutLeave(dev);
    cancel(prec, dev);
    prec->rpro = FALSE; /* what was put meanwhile would go to the new place */
    finish(prec);
    if (pulse)
        *pulse = length;
}
