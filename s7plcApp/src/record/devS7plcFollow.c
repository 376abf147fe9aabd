/* Output records that follow the PLC: their VAL takes what the PLC shows of them, and a
 * refused put goes back to it.
 *
 * The station copies read-backs into the output image; here records take their value from
 * there. A record follows by processing, with a flag that makes devWrite read instead of
 * write: so alarms, monitors and forward links are the record's own business, as ever.
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <dbAccess.h>
#include <dbEvent.h>
#include <dbLock.h>

#include "devS7plc.h"

/* True when the bits that are ours differ from those that VAL shows. */
static int isNews(const devRecord *dev, const epicsUInt8 *bytes)
{
    epicsInt64 difference;

    if (!dev->known || !dev->mask)
        return !dev->known || memcmp(bytes, dev->shown, dev->length) != 0;
    difference = plcGetInt(dev->type, bytes, dev->order) ^
                 plcGetInt(dev->type, dev->shown, dev->order);
    return (difference & (epicsInt64)dev->mask) != 0;
}

int devNotShown(const devRecord *dev, char reason[PLC_REASON_SIZE])
{
    int byBlock = dev->has & plcHasR; /* at connect by the registers */
    plcFaults *inFaults = plcStationInFaults(dev->station);
    epicsUInt8 bits[DEV_SCALAR];
    const void *mask = devMask(dev, bits);

    if (dev->known && plcIsWrong(dev->type, dev->shown, dev->length, dev->order, reason))
        return 1;
    if (dev->known && !dev->taken)
        return 0; /* what was put */
    if (byBlock)
        return inFaults && plcFaultsFind(inFaults, dev->readback, dev->length, mask, reason);
    return plcStationHides(dev->station, dev->offset, dev->length, mask, reason);
}

void devTakeValue(dbCommon *prec, devRecord *dev)
{
    const devSupport *support = devSupportOf(prec);
    char wrong[PLC_WRONG_SIZE];

    devShow(dev);
    dev->taken = 1;
    dev->unproven = 0;
    devHasValue(dev);
    if (!plcIsWrong(dev->type, dev->shown, dev->length, dev->order, wrong))
        support->follow(prec, dev, dev->shown);
    prec->udf = FALSE;
}

/* The same for a record that does not process for it, or did and did not come to its write
 * (OOPT of a longout). Its alarms stay what they are. */
static void takeQuietly(dbCommon *prec, devRecord *dev)
{
    epicsUInt8 udf = prec->udf;

    devTakeValue(prec, dev);
    prec->udf = udf;
    devStamp(prec);
    db_post_events(prec, NULL, DBE_VALUE | DBE_LOG);
}

static int hasNews(const devRecord *dev)
{
    epicsUInt8 *bytes = mallocMustSucceed(dev->length + 1, "devFollow");
    int news;

    plcImagePeek(dev->image, dev->offset, dev->length, bytes);
    news = isNews(dev, bytes);
    free(bytes);
    return news;
}

void devGoBack(dbCommon *prec, devRecord *dev)
{
    const devSupport *support = devSupportOf(prec);

    if (!dev->shown || !dev->known || (support->follows && !support->follows(prec)) ||
        !hasNews(dev))
        return;
    devTakeValue(prec, dev);
}

/* Processes the record so that it takes its value. */
static void followByProcess(dbCommon *prec, devRecord *dev)
{
    const devSupport *support = devSupportOf(prec);
    double *pulse = support->pulse ? support->pulse(prec) : NULL;
    double length = pulse ? *pulse : 0;

    if (pulse)
        *pulse = 0; /* what the PLC shows is no put, at whose end another one follows */
    dev->following = 1;
    /* Already here, since the record looks at its limits before it writes. */
    if (!support->follows || support->follows(prec))
        devTakeValue(prec, dev);
    prec->udf = FALSE; /* it is about to get a value: no IVOA for want of one */
    dbProcess(prec);
    if (pulse)
        *pulse = length;
    if (dev->following)
        takeQuietly(prec, dev);
    dev->following = 0;
}

/* The PLC was away, and its value replaces what was put. */
static void findVoid(devRecord *dev)
{
    const char *why = plcStationVoid(dev->station, &dev->last);

    if (!dev->unproven || !why)
        return;
    plcImageRefuse(dev->image, &dev->last, why);
    devListJoin(dev, devWaiting);
}

/* The record is locked. Its link may have changed since it was listed. A calcout whose delayed
 * write began before the connection showed its values is about to write an older one: that
 * write follows instead. */
static void followRecord(dbCommon *prec, const plcStation *station, int takes)
{
    devRecord *dev = prec->dpvt;
    int (*delays)(const dbCommon *prec) = devSupportOf(prec)->delays;
    char reason[PLC_REASON_SIZE];
    int first, met, news;

    if (!dev || dev->station != station || !dev->shown)
        return;
    first = dev->takes != takes;
    met = dev->takes != 0;
    dev->takes = takes;
    if (prec->pact) {
        if (first && delays && delays(prec))
            dev->following = 1;
        return;
    }
    if (devIsSimulated(prec)) {
        dev->known = 0; /* the PLC's value is news, once it is not any more */
        plcStationTellLater(dev->station);
        return;
    }
    if (!dev->known && dev->unseen && !dev->own && dev->unseen(dev, reason))
        return; /* the image has no value of the PLC there */
    if (!met)
        plcImageForgive(dev->image, &dev->last); /* at the start the PLC's value comes first */
    news = hasNews(dev);
    if (first && met && news)
        findVoid(dev);
    if (first)
        dev->unproven = 0;
    if (!news)
        return;
    if (delays)
        takeQuietly(prec, dev);
    else if (devSupportOf(prec)->rests && devSupportOf(prec)->rests(prec))
        plcStationTellLater(dev->station);
    else
        followByProcess(prec, dev);
}

void devFollowOne(dbCommon *prec, plcStation *station)
{
    if (plcStationTaken(station))
        followRecord(prec, station, plcStationTakes(station));
}

static void followAll(plcStation *station)
{
    size_t count, i;
    int takes = plcStationTakes(station);
    dbCommon **records = devListRecords(station, devFollowers, &count);

    for (i = 0; i < count; i++) {
        dbScanLock(records[i]);
        followRecord(records[i], station, takes);
        dbScanUnlock(records[i]);
    }
    free(records);
}

/* Before the first block the output image does not hold the PLC's values yet. */
void devFollowAll(plcStation *station)
{
    if (plcStationTaken(station))
        followAll(station);
    devAwayUpdate(station);
    devSilentUpdate(station);
}

void devFollowJoin(devRecord *dev)
{
    epicsUInt8 mask[DEV_SCALAR];

    if (dev->shifted)
        dev->mask = *dev->shifted;
    dev->shown = callocMustSucceed(1, dev->length + 1, "devFollowJoin");
    devListJoin(dev, devFollowers); /* first: its place may be filled at once, and that is told once */
    plcStationAddReadback(dev->station, dev, dev->offset,
                          dev->has & plcHasR ? dev->readback : PLC_NO_PLACE, dev->length,
                          devMask(dev, mask));
}

void devFollowLeave(devRecord *dev)
{
    if (!dev->shown)
        return;
    plcStationRemoveReadback(dev->station, dev);
    devListLeave(dev, devFollowers);
    free(dev->shown);
}

void devShow(devRecord *dev)
{
    plcImagePeek(dev->image, dev->offset, dev->length, dev->shown);
    dev->known = 1;
}

void devWrote(devRecord *dev, const epicsUInt8 *bytes, const epicsUInt8 *mask)
{
    size_t i;

    for (i = 0; i < dev->length; i++)
        dev->shown[i] = (epicsUInt8)(mask ? (dev->shown[i] & ~mask[i]) | (bytes[i] & mask[i])
                                          : bytes[i]);
    dev->known = dev->unproven = 1;
    dev->taken = 0;
}
