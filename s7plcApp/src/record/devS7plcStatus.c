/* Device support for the connection itself: "S7plc stat" (bi) shows whether the PLC is
 * connected, "S7plc addr" (stringout) shows its address and moves it.
 *
 * Uses only the station; no bytes of a block. Links: @PLCname.
 */
#include <string.h>

#include <alarm.h>
#include <biRecord.h>
#include <dbAccess.h>
#include <dbEvent.h>
#include <stringoutRecord.h>

#include "plcCompat.h"
#include "devS7plc.h"

#include <epicsExport.h> /* last */

/* 1 connected, 0 not: the value tells it all, so there is no alarm. */
static long readStat(dbCommon *common)
{
    biRecord *prec = (biRecord *)common;
    devRecord *dev = devOf(common);

    if (!dev)
        return -1;
    if (devIsIn(dev, devSilent))
        devListLeave(dev, devSilent);
    devStampNow(common);
    prec->rval = plcStationConnected(dev->station, NULL) != 0;
    return 0;
}

/* Moves the PLC to host[:port]: the connection is closed and made anew at once. */
static long writeAddr(dbCommon *common)
{
    stringoutRecord *prec = (stringoutRecord *)common;
    const devRecord *dev = devOf(common);
    char error[160];

    if (!dev)
        return -1;
    devStampNow(common);
    if (plcStationMove(dev->station, prec->val, error, sizeof(error)))
        return devRefuseWrite(common, "%s", error);
    return 0;
}

/* VAL shows the address from s7plcConfigure, unless the database or autosave set one; that of the
 * PLC of a link that changes. */
static int prepareAddr(dbCommon *common, devRecord *dev, const plcLink *link,
                       plcLinkError *error)
{
    stringoutRecord *prec = (stringoutRecord *)common;

    (void)link, (void)error;
    if (prec->val[0] && !interruptAccept)
        return 0;
    plcStationAddress(dev->station, prec->val, sizeof(prec->val));
    prec->udf = FALSE;
    if (interruptAccept)
        db_post_events(common, prec->val, DBE_VALUE | DBE_LOG);
    else
        prec->sevr = NO_ALARM; /* it has a value now */
    return 0;
}

/* clang-format off */
const devSupport devS7plcStat = {
    .common = DEV_DSET, .transfer = readStat, .dtyp = "S7plc stat", .field = "INP",
    .direction = devStatus, .shape = {.recordType = "bi"}};
const devSupport devS7plcAddr = {
    .common = {6, NULL, devInit, devInitRecord, NULL}, .transfer = writeAddr,
    .dtyp = "S7plc addr", .field = "OUT", .direction = devStatus,
    .shape = {.recordType = "stringout"}, .prepare = prepareAddr};
/* clang-format on */

epicsExportAddress(dset, devS7plcStat);
epicsExportAddress(dset, devS7plcAddr);
