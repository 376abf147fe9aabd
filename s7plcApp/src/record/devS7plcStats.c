/* Device support "S7plc stats": the health of a station in records. INP is @PLCname/name;
 * the names are the table of plcStatsTable.c.
 *
 * Uses only the station; no bytes of a block. A value is shown whether the PLC is there or
 * not: that is what it is for, so there is no alarm but for a wrong link.
 */
#include <string.h>

#include <aaiRecord.h>
#include <aiRecord.h>
#include <alarm.h>
#include <biRecord.h>
#include <boRecord.h>
#include <epicsStdio.h>
#include <int64inRecord.h>
#include <longinRecord.h>
#include <lsiRecord.h>
#include <mbbiRecord.h>
#include <menuFtype.h>
#include <stringinRecord.h>
#include <waveformRecord.h>

#include "plcCompat.h"
#include "devS7plc.h"
#include "plcStatsTable.h"

#include <epicsExport.h> /* last */

/* What a record type can show. */
static const struct {
    const char *recordType;
    unsigned kinds;
} abilities[] = {
    {"bi",       plcStatInteger              },
    {"mbbi",     plcStatInteger              },
    {"longin",   plcStatNumber               },
    {"int64in",  plcStatNumber               },
    {"ai",       plcStatNumber               },
    {"stringin", plcStatNumber | plcStatText },
    {"lsi",      plcStatNumber | plcStatText },
    {"waveform", plcStatArray                },
    {"aai",      plcStatArray                },
    {"bo",       plcStatOrder                },
};

static unsigned kindsOf(const char *recordType)
{
    size_t i;

    for (i = 0; strcmp(abilities[i].recordType, recordType); i++)
        ;
    return abilities[i].kinds;
}

/* The link, @PLCname/name: blanks at either end do no harm. */
static int resolveStatistic(dbCommon *prec, devRecord *dev, const char *text,
                            plcLinkError *error)
{
    const char *recordType = devSupportOf(prec)->shape.recordType;
    char station[PLC_NAME_MAX + 1], name[40], names[600];
    size_t start = strspn(text, "@ \t"), length = strcspn(text + start, "/ \t");
    const char *slash = text + start + length;
    unsigned kinds = kindsOf(recordType);

    slash += strspn(slash, " \t");
    if (length == 0 || length > PLC_NAME_MAX || *slash != '/')
        return plcLinkFail(error, start, "a link of S7plc stats is @PLCname/name");
    epicsSnprintf(station, sizeof(station), "%.*s", (int)length, text + start);
    slash += 1 + strspn(slash + 1, " \t");
    length = strcspn(slash, " \t");
    if (slash[length + strspn(slash + length, " \t")])
        return plcLinkFail(error, (size_t)(slash - text) + length,
                           "text behind the name of a statistic");
    if (devFindStation(dev, station, error))
        return -1;
    epicsSnprintf(name, sizeof(name), "%.*s", (int)length, slash);
    dev->statistic = plcStatFind(name, kinds);
    if (dev->statistic)
        return 0;
    plcStatNames(kinds, names, sizeof(names));
    return plcLinkFail(error, (size_t)(slash - text), "no statistic \"%s\" for %s; allowed: %s",
                       name, recordType, names);
}

/* --- One adapter per record type --------------------------------------------------------- */

/* Returns 0 with the value, or -1 with an alarm. */
static int get(dbCommon *common, plcStatValue *value)
{
    const devRecord *dev = devOf(common);

    if (!dev)
        return -1;
    devStampNow(common);
    plcStatGet(dev->statistic, dev->station, value);
    common->udf = FALSE;
    return 0;
}

static long readAi(dbCommon *common)
{
    plcStatValue value;

    if (get(common, &value))
        return -1;
    ((aiRecord *)common)->val = value.real;
    return 2;
}

/* Counters that are too large for 32 bits stay at the highest value. */
static long readLongin(dbCommon *common)
{
    plcStatValue value;

    if (get(common, &value))
        return -1;
    ((longinRecord *)common)->val =
        value.integer > 0x7FFFFFFF ? 0x7FFFFFFF : (epicsInt32)value.integer;
    return 0;
}

static long readInt64in(dbCommon *common)
{
    plcStatValue value;

    if (get(common, &value))
        return -1;
    ((int64inRecord *)common)->val = value.integer;
    return 0;
}

static long readBi(dbCommon *common)
{
    plcStatValue value;

    if (get(common, &value))
        return -1;
    ((biRecord *)common)->rval = value.integer != 0;
    return 0;
}

/* A state with an alarm says why, for who sees only the alarm: the record would raise it
 * without words. */
static void sayReason(mbbiRecord *prec)
{
#ifdef HAS_ALARM_MESSAGE
    const devRecord *dev = prec->dpvt;
    const epicsEnum16 *severities = &prec->zrsv;
    plcStatValue reason;

    if (strcmp(dev->statistic->name, "state") || prec->val > 15)
        return;
    plcStatGet(plcStatFind("reason", plcStatText), dev->station, &reason);
    if (severities[prec->val] != NO_ALARM && reason.text[0])
        recGblSetSevrMsg(prec, STATE_ALARM, severities[prec->val], "%s", reason.text);
#else
    (void)prec;
#endif
}

/* VAL directly: the texts are ZRST and so on, whether there are ..VL or not. */
static long readMbbi(dbCommon *common)
{
    plcStatValue value;

    if (get(common, &value))
        return -1;
    ((mbbiRecord *)common)->val = (epicsEnum16)value.integer;
    sayReason((mbbiRecord *)common);
    return 2;
}

static long readStringin(dbCommon *common)
{
    stringinRecord *prec = (stringinRecord *)common;
    plcStatValue value;

    if (get(common, &value))
        return -1;
    epicsSnprintf(prec->val, sizeof(prec->val), "%s", value.text);
    return 0;
}

static long readLsi(dbCommon *common)
{
    lsiRecord *prec = (lsiRecord *)common;
    plcStatValue value;

    if (get(common, &value))
        return -1;
    epicsSnprintf(prec->val, prec->sizv, "%s", value.text);
    prec->len = (epicsUInt32)strlen(prec->val) + 1;
    return 0;
}

/* An order: 1 does it, 0 does nothing. */
static long writeBo(dbCommon *common)
{
    const devRecord *dev = devOf(common);

    if (!dev)
        return -1;
    devStampNow(common);
    if (((boRecord *)common)->val)
        plcStatDo(dev->statistic, dev->station);
    return 0;
}

/* --- Arrays ------------------------------------------------------------------------------ */

/* Element types that can show a bin. */
static int storeBin(void *array, size_t i, unsigned ftvl, double value)
{
    switch (ftvl) {
    case menuFtypeLONG:
        ((epicsInt32 *)array)[i] = (epicsInt32)value;
        return 0;
    case menuFtypeULONG:
        ((epicsUInt32 *)array)[i] = (epicsUInt32)value;
        return 0;
    case menuFtypeFLOAT:
        ((epicsFloat32 *)array)[i] = (epicsFloat32)value;
        return 0;
    case menuFtypeDOUBLE:
        ((epicsFloat64 *)array)[i] = value;
        return 0;
    default:
        return -1;
    }
}

static long readArray(dbCommon *common, void *array, unsigned ftvl, size_t room,
                      epicsUInt32 *nord)
{
    const devRecord *dev = devOf(common);
    double values[PLC_BINS];
    size_t count, i;

    if (!dev)
        return -1;
    devStampNow(common);
    count = plcStatGetArray(dev->statistic, dev->station, values, room);
    for (i = 0; i < count; i++)
        if (storeBin(array, i, ftvl, values[i])) {
            recGblSetSevrMsg(common, READ_ALARM, INVALID_ALARM,
                             "FTVL must be DOUBLE FLOAT LONG ULONG");
            return -1;
        }
    *nord = (epicsUInt32)count;
    common->udf = FALSE;
    return 0;
}

static long readWaveform(dbCommon *common)
{
    waveformRecord *prec = (waveformRecord *)common;

    return readArray(common, prec->bptr, prec->ftvl, prec->nelm, &prec->nord);
}

static long readAai(dbCommon *common)
{
    aaiRecord *prec = (aaiRecord *)common;

    return readArray(common, prec->bptr, prec->ftvl, prec->nelm, &prec->nord);
}

/* --- The rows ---------------------------------------------------------------------------- */

#define ROW(read, scale, type)                                                            \
    {.common = DEV_DSET, .transfer = read, .linconv = scale, .dtyp = "S7plc stats",       \
     .field = "INP", .direction = devStatistics, .shape = {.recordType = type},           \
     .resolve = resolveStatistic}

static long noLinconv(dbCommon *common, int after)
{
    (void)common, (void)after;
    return 0;
}

/* clang-format off */
const devSupport devS7plcStatsAi       = ROW(readAi,       noLinconv, "ai");
const devSupport devS7plcStatsLongin   = ROW(readLongin,   NULL, "longin");
const devSupport devS7plcStatsInt64in  = ROW(readInt64in,  NULL, "int64in");
const devSupport devS7plcStatsBi       = ROW(readBi,       NULL, "bi");
const devSupport devS7plcStatsMbbi     = ROW(readMbbi,     NULL, "mbbi");
const devSupport devS7plcStatsStringin = ROW(readStringin, NULL, "stringin");
const devSupport devS7plcStatsLsi      = ROW(readLsi,      NULL, "lsi");
const devSupport devS7plcStatsWaveform = ROW(readWaveform, NULL, "waveform");
const devSupport devS7plcStatsAai      = ROW(readAai,      NULL, "aai");
const devSupport devS7plcStatsBo = {.common = {6, NULL, devInit, devInitRecord, NULL},
    .transfer = writeBo, .dtyp = "S7plc stats", .field = "OUT", .direction = devStatistics,
    .shape = {.recordType = "bo"}, .initStatus = 2, .resolve = resolveStatistic};
/* clang-format on */

epicsExportAddress(dset, devS7plcStatsAi);
epicsExportAddress(dset, devS7plcStatsLongin);
epicsExportAddress(dset, devS7plcStatsInt64in);
epicsExportAddress(dset, devS7plcStatsBi);
epicsExportAddress(dset, devS7plcStatsMbbi);
epicsExportAddress(dset, devS7plcStatsStringin);
epicsExportAddress(dset, devS7plcStatsLsi);
epicsExportAddress(dset, devS7plcStatsWaveform);
epicsExportAddress(dset, devS7plcStatsAai);
epicsExportAddress(dset, devS7plcStatsBo);
