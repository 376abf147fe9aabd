/* Output records whose value waits for the PLC: their alarm ends when the PLC is back,
 * not only when they process again.
 *
 * The value itself is in the output image and leaves with the next block; nothing is
 * written or processed here.
 */
#include <stdlib.h>

#include <alarm.h>
#include <cantProceed.h>
#include <dbAccess.h>
#include <dbEvent.h>
#include <dbLock.h>
#include <epicsMutex.h>
#include <epicsThread.h>

#include "devS7plc.h"
#include "plcCompat.h"

/* Records that wait, of all stations. The lock is only held to look at the list or to
 * change it, never while a record is locked by us or processes. */
static ELLLIST waiting = ELLLIST_INIT;
static epicsMutexId lock;
static epicsThreadOnceId once = EPICS_THREAD_ONCE_INIT;

static void initOnce(void *arg)
{
    (void)arg;
    lock = epicsMutexMustCreate();
}

static void join(dbCommon *prec, devRecord *dev)
{
    epicsThreadOnce(&once, initOnce, NULL);
    epicsMutexMustLock(lock);
    dev->prec = prec;
    if (!dev->waits)
        ellAdd(&waiting, &dev->awayNode);
    dev->waits = 1;
    epicsMutexUnlock(lock);
}

void devAwayLeave(devRecord *dev)
{
    epicsThreadOnce(&once, initOnce, NULL);
    epicsMutexMustLock(lock);
    if (dev->waits)
        ellDelete(&waiting, &dev->awayNode);
    dev->waits = 0;
    epicsMutexUnlock(lock);
}

static int isAway(devRecord *dev)
{
    return !plcStationConnected(dev->station, NULL) ||
           (dev->shown && !plcStationTaken(dev->station));
}

/* The record joins before it looks whether the PLC is still away: if the PLC comes back
 * after that, the record is found in the list. */
long devAway(dbCommon *prec, devRecord *dev, const char *reason)
{
    epicsEnum16 status = prec->nsta, severity = prec->nsev;

    join(prec, dev);
    if (!isAway(dev))
        return 0;
    if (recGblSetSevrMsg(prec, COMM_ALARM, INVALID_ALARM, "%s", reason)) {
        dev->away = 1;
        dev->hiddenStatus = status;
        dev->hiddenSeverity = severity;
    }
    return -1;
}

/* The record is locked. It shows the alarm that its value has by itself. */
static void endAlarm(dbCommon *prec, const plcStation *station)
{
    devRecord *dev = prec->dpvt;

    if (!dev || dev->station != station || !dev->away || prec->pact || isAway(dev))
        return;
    dev->away = 0;
    devAwayLeave(dev);
    if (prec->stat != COMM_ALARM)
        return;
    plcClearMessage(prec);
    prec->nsta = dev->hiddenStatus;
    prec->nsev = dev->hiddenSeverity;
    if (recGblResetAlarms(prec))
        db_post_events(prec, NULL, DBE_ALARM);
}

void devAwayEnd(plcStation *station)
{
    dbCommon **records;
    size_t count = 0, i;
    ELLNODE *node;

    epicsThreadOnce(&once, initOnce, NULL);
    epicsMutexMustLock(lock);
    records = callocMustSucceed(ellCount(&waiting) + 1, sizeof(*records), "devAwayEnd");
    for (node = ellFirst(&waiting); node; node = ellNext(node)) {
        devRecord *dev = CONTAINER(node, devRecord, awayNode);

        if (dev->station == station)
            records[count++] = dev->prec;
    }
    epicsMutexUnlock(lock);
    for (i = 0; i < count; i++) {
        dbScanLock(records[i]);
        endAlarm(records[i], station);
        dbScanUnlock(records[i]);
    }
    free(records);
}
