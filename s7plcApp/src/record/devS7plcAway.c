/* Output records whose alarm depends on what becomes of their value after they processed: it
 * waits for the PLC, and the alarm ends when the PLC is back; or the PLC refused it, and the
 * alarm begins then, and ends when it has taken another; or the PLC does not show it any more.
 *
 * The value itself is in the output image; nothing is written or processed here.
 */
#include <stdlib.h>

#include <alarm.h>
#include <dbAccess.h>
#include <dbEvent.h>
#include <dbLock.h>

#include "devS7plc.h"
#include "plcCompat.h"

static int isAway(devRecord *dev)
{
    return !plcStationOutputConnected(dev->station, NULL) || plcStationHeld(dev->station) ||
           (dev->shown && !plcStationTaken(dev->station));
}

int devIsRefused(const devRecord *dev, char reason[PLC_REASON_SIZE])
{
    epicsUInt8 mask[DEV_SCALAR];

    return dev->faults &&
           plcFaultsFind(dev->faults, dev->offset, dev->length, devMask(dev, mask), reason);
}

/* Raises an alarm, and keeps in mind which one it hides. Returns -1. */
static long raiseAlarm(dbCommon *prec, devRecord *dev, epicsEnum16 alarm, const char *reason)
{
    epicsEnum16 status = prec->nsta, severity = prec->nsev;

    if (alarm == READ_ALARM)
        devOverUndefined(prec);
    if (recGblSetSevrMsg(prec, alarm, INVALID_ALARM, "%s", reason)) {
        dev->raised = alarm;
        dev->hiddenStatus = status;
        dev->hiddenSeverity = severity;
    }
    return -1;
}

/* The record joins before it looks whether the PLC is still away: if the PLC comes back
 * after that, the record is found in the list. */
long devAway(dbCommon *prec, devRecord *dev, const char *reason)
{
    devListJoin(dev, devWaiting);
    return isAway(dev) ? raiseAlarm(prec, dev, COMM_ALARM, reason) : 0;
}

long devRefused(dbCommon *prec, devRecord *dev)
{
    char reason[PLC_REASON_SIZE];

    return devIsRefused(dev, reason) ? raiseAlarm(prec, dev, WRITE_ALARM, reason) : 0;
}

long devUnseen(dbCommon *prec, devRecord *dev)
{
    char reason[PLC_REASON_SIZE];

    return dev->unseen && dev->unseen(dev, reason) ? raiseAlarm(prec, dev, READ_ALARM, reason) : 0;
}

/* The record is locked and does not process. Its alarm becomes that of its value, or this one
 * (0: none). */
static void settle(dbCommon *prec, devRecord *dev, epicsEnum16 alarm, const char *reason)
{
    int replaced = prec->stat != dev->raised; /* another one has come in its place */

    dev->raised = 0;
    if (replaced && !alarm)
        return;
    if (replaced) {
        dev->hiddenStatus = prec->stat;
        dev->hiddenSeverity = prec->sevr;
    }
    plcClearMessage(prec);
    if (dev->held[0] && dev->hiddenStatus == WRITE_ALARM) /* that of the pulse: it comes again below, */
        dev->hiddenStatus = dev->hiddenSeverity = NO_ALARM; /* with its reason */
    prec->nsta = dev->hiddenStatus;
    prec->nsev = dev->hiddenSeverity;
    if (alarm)
        raiseAlarm(prec, dev, alarm, reason);
    else if (dev->held[0])
        recGblSetSevrMsg(prec, WRITE_ALARM, INVALID_ALARM, "%s", dev->held);
    devStamp(prec); /* archivers drop what is older than what they have */
    if (recGblResetAlarms(prec))
        db_post_events(prec, NULL, DBE_ALARM);
}

static void update(dbCommon *prec, const plcStation *station)
{
    devRecord *dev = prec->dpvt;
    char reason[PLC_REASON_SIZE];
    epicsEnum16 alarm = 0;

    if (!dev || dev->station != station || prec->pact)
        return;
    if (dev->raised == COMM_ALARM && isAway(dev)) {
        if (!plcStationOutputConnected(dev->station, reason) && prec->stat == COMM_ALARM &&
            !devSays(prec, reason))
            settle(prec, dev, COMM_ALARM, reason); /* it is away for another reason now */
        return;
    }
    if (devIsRefused(dev, reason))
        alarm = WRITE_ALARM;
    else if (dev->unseen && dev->unseen(dev, reason))
        alarm = READ_ALARM;
    if (dev->raised || alarm)
        settle(prec, dev, alarm, reason);
    if (!dev->faults)
        devListLeave(dev, devWaiting);
}

void devAwayUpdate(plcStation *station)
{
    size_t count, i;
    dbCommon **records = devListRecords(station, devWaiting, &count);

    for (i = 0; i < count; i++) {
        dbScanLock(records[i]);
        update(records[i], station);
        dbScanUnlock(records[i]);
    }
    free(records);
}
