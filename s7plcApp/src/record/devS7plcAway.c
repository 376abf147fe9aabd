/* Output records whose alarm depends on what becomes of their value after they processed: it
 * waits for the PLC, and the alarm ends when the PLC is back; or the PLC refused it, and the
 * alarm begins then, and ends when it has taken another; or the PLC does not show it any more.
 *
 * The value itself is in the output image; nothing is written or processed here.
 */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <alarm.h>
#include <dbAccess.h>
#include <dbEvent.h>
#include <dbLock.h>
#include <epicsStdio.h>

#include "devS7plc.h"
#include "plcCompat.h"

static int isAway(devRecord *dev, char reason[PLC_REASON_SIZE])
{
    return plcStationKeeps(dev->station, dev->shown != NULL, reason);
}

/* The PLC is there again, and has not got yet what was put before. */
static int hasTurn(devRecord *dev, char reason[PLC_REASON_SIZE])
{
    if (!plcStationAcknowledges(dev->station) || !plcImageWaits(dev->image, &dev->last))
        return 0;
    strcpy(reason, "waits for its turn");
    return 1;
}

/* Raises an alarm, and keeps in mind which one it hides. Returns -1. */
static long raiseAlarm(dbCommon *prec, devRecord *dev, epicsEnum16 alarm, const char *reason)
{
    epicsEnum16 status = prec->nsta, severity = prec->nsev;

    if (alarm != COMM_ALARM)
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
long devAway(dbCommon *prec, devRecord *dev)
{
    char reason[PLC_REASON_SIZE];

    devListJoin(dev, devWaiting);
    return isAway(dev, reason) || hasTurn(dev, reason)
               ? raiseAlarm(prec, dev, COMM_ALARM, reason)
               : 0;
}

long devRefused(dbCommon *prec, devRecord *dev)
{
    char why[PLC_REASON_SIZE];

    return plcImageWhyNot(dev->image, &dev->last, why) ? raiseAlarm(prec, dev, WRITE_ALARM, why)
                                                       : 0;
}

long devRefuseWrite(dbCommon *prec, const char *format, ...)
{
    devRecord *dev = prec->dpvt;
    char text[PLC_REASON_SIZE];
    va_list args;

    va_start(args, format);
    epicsVsnprintf(text, sizeof(text), format, args);
    va_end(args);
    if (dev && dev->last.bytes) {
        plcImageRefuse(dev->image, &dev->last, text);
        return devRefused(prec, dev);
    }
    devOverUndefined(prec);
    recGblSetSevrMsg(prec, WRITE_ALARM, INVALID_ALARM, "%s", text);
    return -1;
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
    prec->nsta = dev->hiddenStatus;
    prec->nsev = dev->hiddenSeverity;
    if (alarm)
        raiseAlarm(prec, dev, alarm, reason);
    devStamp(prec); /* archivers drop what is older than what they have */
    if (recGblResetAlarms(prec))
        db_post_events(prec, NULL, DBE_ALARM);
}

void devAwayLeave(dbCommon *prec, devRecord *dev, const char *why)
{
    if (why || dev->raised)
        settle(prec, dev, why ? WRITE_ALARM : 0, why);
}

/* The alarm that it is to have now for its last put, or for want of a value to show; 0: none. */
static epicsEnum16 alarmOf(devRecord *dev, char reason[PLC_REASON_SIZE])
{
    if (plcImageWhyNot(dev->image, &dev->last, reason))
        return WRITE_ALARM;
    if ((dev->raised == COMM_ALARM || plcImageWaits(dev->image, &dev->last)) &&
        isAway(dev, reason))
        return COMM_ALARM;
    if (dev->raised == COMM_ALARM && hasTurn(dev, reason))
        return COMM_ALARM;
    return dev->unseen && dev->unseen(dev, reason) ? READ_ALARM : 0;
}

static void update(dbCommon *prec, const plcStation *station)
{
    devRecord *dev = prec->dpvt;
    char reason[PLC_REASON_SIZE];
    epicsEnum16 alarm;

    if (!dev || dev->station != station || prec->pact)
        return;
    alarm = alarmOf(dev, reason);
    if (alarm != dev->raised ||
        (alarm && (prec->stat != alarm || !devSays(prec, reason))))
        settle(prec, dev, alarm, reason);
    if (!dev->faults && alarm != COMM_ALARM)
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
