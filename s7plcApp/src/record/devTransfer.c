/* Device support: bytes between an image and a record that processes, and what becomes of an
 * output's put: written, refused, on its way, or taken from the PLC instead.
 *
 * Knows no record type and no link: the place is in devRecord.
 */
#include <stdlib.h>

#include <alarm.h>
#include <dbAccess.h>
#include <dbScan.h>
#include <epicsStdio.h>
#include <epicsTime.h>

#include "plcCompat.h"
#include "devS7plc.h"
#include "plcHot.h"

/* --- Inputs ---------------------------------------------------------------------------- */

/* The PLC may have refused to show this place. */
static long devUnread(dbCommon *prec, const devRecord *dev)
{
    epicsUInt8 mask[DEV_SCALAR];
    char reason[PLC_REASON_SIZE];

    if (!plcFaultsFind(dev->faults, dev->offset, dev->length, devMask(dev, mask), reason))
        return 0;
    recGblSetSevrMsg(prec, READ_ALARM, INVALID_ALARM, "%s", reason);
    return -1;
}

PLC_HOT long devFetch(dbCommon *prec, void *bytes)
{
    devRecord *dev = devOf(prec);
    char reason[PLC_REASON_SIZE];

    if (!dev)
        return -1;
    if (devIsIn(dev, devSilent)) {
        devListLeave(dev, devSilent);
        dev->lost = 0;
    }
    if (plcImageRead(dev->image, dev->offset, dev->length, bytes,
                     prec->tse == epicsTimeEventDeviceTime ? &prec->time : NULL) == 0)
        return dev->faults ? devUnread(prec, dev) : 0;
    plcImageReason(dev->image, reason);
    recGblSetSevrMsg(prec, COMM_ALARM, INVALID_ALARM, "%s", reason);
    devStampNow(prec);
    if (prec->scan == SCAN_IO_EVENT) {
        dev->lost = 1; /* before the PLC is back it does not process: its reason may change */
        devSilentJoin(dev, 0);
    }
    return -1;
}

long devCheckDigits(dbCommon *prec, const devRecord *dev, const void *bytes)
{
    char text[PLC_WRONG_SIZE];

    if (!plcIsWrong(dev->type, bytes, dev->length, dev->order, text))
        return 0;
    recGblSetSevrMsg(prec, READ_ALARM, INVALID_ALARM, "%s", text);
    return -1;
}

PLC_HOT long devFetchInt(dbCommon *prec, epicsInt64 *value)
{
    const devRecord *dev = prec->dpvt;
    epicsUInt8 bytes[DEV_SCALAR];

    if (devFetch(prec, bytes))
        return -1;
    if (dev->type->kind & plcCoded && devCheckDigits(prec, dev, bytes))
        return -1;
    *value = plcGetInt(dev->type, bytes, dev->order);
    return 0;
}

/* --- Outputs --------------------------------------------------------------------------- */

long devStore(dbCommon *prec, const void *bytes, const void *mask)
{
    devRecord *dev = devOf(prec);
    char reason[PLC_REASON_SIZE];

    if (!dev)
        return -1;
    reason[0] = 0;
    dev->raised = 0;
    dev->last.tells = dev->takes != 0; /* at the start the PLC's value comes first anyway */
    dev->refused = plcStationPutBy(dev->station, &dev->last, dev->offset, dev->length, bytes, mask,
                                   reason, dev->shown != NULL, &dev->mark) != 0;
    if (dev->refused)
        return devRefuseWrite(prec, "%s", reason);
    devHasValue(dev);
    if (dev->shown)
        devWrote(dev, bytes, mask);
    if (!reason[0])
        return 0;
    dev->mark.number = 0; /* nobody knows when it will leave */
    return devAway(prec, dev);
}

long devStoreInt(dbCommon *prec, epicsInt64 value, epicsUInt64 mask)
{
    devRecord *dev = devOf(prec);
    epicsUInt8 bytes[DEV_SCALAR], bits[DEV_SCALAR];

    if (!dev)
        return -1;
    plcPutInt(dev->type, bytes, dev->order, value);
    if (mask == ~(epicsUInt64)0) {
        dev->cut |= plcGetInt(dev->type, bytes, dev->order) != value;
        return devStore(prec, bytes, NULL);
    }
    plcPutInt(dev->type, bits, dev->order, (epicsInt64)mask);
    return devStore(prec, bytes, bits);
}

/* With track=on a record shows what the PLC holds: so, too, where its value did not fit. */
static void showCut(dbCommon *prec, devRecord *dev)
{
    if (dev->cut && dev->shown && plcStationTracks(dev->station))
        devTakeValue(prec, dev);
    dev->cut = 0;
}

/* The record that was active until now gets the alarm that the answer has brought. Without a
 * put it has changed its link meanwhile. */
static long putEnds(dbCommon *prec, devRecord *dev)
{
    int waits;

    if (!dev || !dev->station || !dev->mark.number)
        return 0;
    dev->mark.number = 0;
    if (dev->ends)
        return devRefuseWrite(prec, "%s", dev->ends);
    waits = plcImageWaits(dev->image, &dev->last); /* before: it may end meanwhile */
    if (devRefused(prec, dev) || (waits && devAway(prec, dev)) || (waits && devRefused(prec, dev))) {
        devGoBack(prec, dev);
        return -1;
    }
    showCut(prec, dev);
    return devUnseen(prec, dev);
}

/* What the record knows of its last put is of no interest any more. */
static void forgetPut(dbCommon *prec, devRecord *dev)
{
    const devSupport *support = devSupportOf(prec);

    dev->refused = dev->cut = dev->ended = 0;
    dev->mark.number = 0;
    dev->last.goesOn = support->pulseEnds && support->pulseEnds(prec);
}

static int isOn(const devRecord *dev)
{
    size_t i;

    for (i = 0; i < dev->length; i++)
        if (dev->last.bytes[i])
            return 1;
    return 0;
}

/* The 0 of a pulse that has begun at another place, and has ended there: nobody has put it here, and
 * the alarm stays until somebody puts. */
static long pulseOfBefore(dbCommon *prec, devRecord *dev)
{
    if (dev->shown) {
        dev->known = 0; /* VAL is to be what the PLC shows here, not that 0 */
        plcStationTell(dev->station);
    }
    if (prec->stat != WRITE_ALARM)
        return 0;
    recGblSetSevrMsg(prec, WRITE_ALARM, INVALID_ALARM, "%s", plcMessage(prec));
    return -1;
}

long devWrite(dbCommon *prec)
{
    const devSupport *support = devSupportOf(prec);
    devRecord *dev = prec->dpvt;
    long status;

    devStampNow(prec);
    if (dev) { /* what it had raised ends with this processing */
        dev->raised = 0;
        plcClearMessage(prec);
    }
    if (prec->pact && !support->delays) /* the put is through */
        return putEnds(prec, dev);
    if (dev && dev->following) {
        dev->following = 0;
        plcClearMessage(prec);
        devTakeValue(prec, dev);
        status = devRefused(prec, dev);
        return status || dev->own ? status : devUnseen(prec, dev);
    }
    if (dev && dev->ended && dev->station && support->pulseEnds && support->pulseEnds(prec)) {
        dev->ended = 0;
        return pulseOfBefore(prec, dev);
    }
    if (dev)
        forgetPut(prec, dev);
    status = support->write(prec);
    if (dev && dev->station && support->pulse)
        dev->pulses = *support->pulse(prec) > 0 && !dev->refused && isOn(dev);
    if (dev && dev->mark.number && !support->delays && devPutWait(prec, dev))
        return 0;
    if (dev && dev->station && !status)
        status = devRefused(prec, dev); /* of the 1 of a pulse, or by now */
    if (dev && !status)
        showCut(prec, dev);
    /* A refused put goes back to the PLC's value, when that is known. */
    if (dev && dev->refused && dev->shown && dev->known)
        devTakeValue(prec, dev);
    return dev && dev->station && !status ? devUnseen(prec, dev) : status;
}
