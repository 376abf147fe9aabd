/* Input records with SCAN "I/O Intr" that no block has made process yet, or none since the PLC
 * was lost: what they show until one does. A data record says in its alarm why there is no data,
 * without processing: sites hang chains on the first processing, which must see the first block.
 * "S7plc stat" says that the PLC is not there.
 *
 * Knows records and reasons; not how blocks come.
 */
#include <stdlib.h>
#include <string.h>

#include <alarm.h>
#include <dbAccess.h>
#include <dbEvent.h>
#include <dbLock.h>
#include <dbScan.h>

#include "devS7plc.h"
#include "plcCompat.h"

/* The record is locked. */
static void sayWhy(dbCommon *prec, const devRecord *dev)
{
    char reason[PLC_REASON_SIZE];

    plcImageReason(dev->image, reason);
    if (!reason[0] || (prec->stat == COMM_ALARM && devSays(prec, reason)) || devIsSimulated(prec))
        return; /* a pass is about to process it; or it has been said */
    plcClearMessage(prec);
    recGblSetSevrMsg(prec, COMM_ALARM, INVALID_ALARM, "%s", reason);
    devStamp(prec);
    recGblResetAlarms(prec);
    db_post_events(prec, NULL, DBE_ALARM);
}

static void update(dbCommon *prec, plcStation *station)
{
    devRecord *dev = prec->dpvt;

    if (!dev || dev->station != station || !devIsIn(dev, devSilent) || prec->pact ||
        prec->scan != SCAN_IO_EVENT)
        return;
    if (dev->image && dev->lost && plcStationConnected(station, NULL))
        return; /* a block is on its way, or the next reason */
    if (dev->image)
        sayWhy(prec, dev);
    else if (!plcStationConnected(station, NULL))
        dbProcess(prec); /* "S7plc stat" */
}

void devSilentJoin(devRecord *dev, int later)
{
    devListJoin(dev, devSilent);
    if (later)
        plcStationTell(dev->station); /* SCAN is not what it was, until the put is through */
}

void devSilentUpdate(plcStation *station)
{
    size_t count, i;
    dbCommon **records = devListRecords(station, devSilent, &count);

    for (i = 0; i < count; i++) {
        dbScanLock(records[i]);
        update(records[i], station);
        dbScanUnlock(records[i]);
    }
    free(records);
}
