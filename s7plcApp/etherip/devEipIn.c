/* Device support "EtherIP": the input records. One adapter and one row per record type; the way
 * from the link to the value is in devEip.c.
 */
#include <math.h>
#include <string.h>

#include <aaiRecord.h>
#include <aiRecord.h>
#include <alarm.h>
#include <biRecord.h>
#include <int64inRecord.h>
#include <longinRecord.h>
#include <lsiRecord.h>
#include <mbbiDirectRecord.h>
#include <mbbiRecord.h>
#include <menuConvert.h>
#include <menuFtype.h>
#include <menuYesNo.h>
#include <stringinRecord.h>
#include <waveformRecord.h>

#include "plcCompat.h"
#include "devEip.h"

#include <epicsExport.h> /* last */

/* --- ai ---------------------------------------------------------------------------------------- */

/* Only SLOPE has a meaning where there are no raw limits. */
static int resolveAi(dbCommon *common, devRecord *dev, const char *text, plcLinkError *error)
{
    aiRecord *prec = (aiRecord *)common;

    if (prec->linr != menuConvertSLOPE)
        prec->linr = menuConvertNO_CONVERSION;
    return devEipNumber(common, dev, text, error);
}

static long readStatistic(aiRecord *prec, const devRecord *dev)
{
    devStampNow((dbCommon *)prec);
    if (devEipStatistic(dev, &prec->val)) {
        recGblSetSevrMsg(prec, READ_ALARM, INVALID_ALARM, "no reads with this period yet");
        return -1;
    }
    prec->udf = FALSE;
    return 2;
}

/* An integer beyond RVAL: the conversion of the record, in double. */
static long readLarge(aiRecord *prec, double value)
{
    value += prec->roff;
    if (prec->aslo != 0.0)
        value *= prec->aslo;
    value += prec->aoff;
    if (prec->linr == menuConvertSLOPE)
        value = value * prec->eslo + prec->eoff;
    prec->val = value;
    return 2;
}

static long readAi(dbCommon *common)
{
    aiRecord *prec = (aiRecord *)common;
    devRecord *dev = devOf(common);
    eipNumber number;

    if (!dev)
        return -1;
    if (eipOf(dev)->statistic)
        return readStatistic(prec, dev);
    if (devEipFetch(common, &number))
        return -1;
    if (number.kind == eipReal) {
        prec->val = number.u.real;
        return 2;
    }
    if (number.u.integer != (epicsInt32)number.u.integer ||
        (number.kind == eipUnsigned && number.u.integer < 0))
        return readLarge(prec, eipNumberReal(&number));
    prec->rval = (epicsInt32)number.u.integer;
    if (prec->udf)
        prec->init = TRUE; /* the record does not smooth its first value */
    return 0;
}

/* --- Bits and integers --------------------------------------------------------------------------- */

static long readBi(dbCommon *common)
{
    eipNumber number;

    if (devEipFetch(common, &number))
        return -1;
    if (isnan(eipNumberReal(&number)))
        return devEipUnshown(common, devEipNan);
    ((biRecord *)common)->rval = eipNumberReal(&number) != 0;
    return 0;
}


static long readMbbi(dbCommon *common)
{
    eipNumber number;

    if (devEipFetch(common, &number))
        return -1;
    ((mbbiRecord *)common)->rval = (epicsUInt32)devEipInteger(&number);
    return 0;
}

static long readMbbiDirect(dbCommon *common)
{
    eipNumber number;

    if (devEipFetch(common, &number))
        return -1;
    ((mbbiDirectRecord *)common)->rval = (epicsUInt32)devEipInteger(&number);
    return 0;
}

static long readLongin(dbCommon *common)
{
    eipNumber number;

    if (devEipFetch(common, &number))
        return -1;
    ((longinRecord *)common)->val = (epicsInt32)devEipInteger(&number);
    return 0;
}

static long readInt64in(dbCommon *common)
{
    eipNumber number;

    if (devEipFetch(common, &number))
        return -1;
    ((int64inRecord *)common)->val = devEipInteger(&number);
    return 0;
}

/* --- Strings ------------------------------------------------------------------------------------- */

/* The text, cut to `size` bytes with its terminator. Returns its length, or -1. */
static long readText(dbCommon *common, char *text, size_t size)
{
    devRecord *dev = devOf(common);
    const epicsUInt8 *place;
    size_t n;

    if (!dev || devEipFetchPlace(common, dev->buffer))
        return -1;
    place = dev->buffer;
    n = (size_t)eipGetUnsigned(place + eipPlaceCountAt, 4);
    if (n > eipOf(dev)->room - eipPlaceHead)
        n = eipOf(dev)->room - eipPlaceHead;
    if (n > size - 1)
        n = size - 1;
    memcpy(text, place + eipPlaceHead, n);
    text[n] = 0;
    common->udf = FALSE;
    return (long)n;
}

static long readStringin(dbCommon *common)
{
    stringinRecord *prec = (stringinRecord *)common;

    return readText(common, prec->val, sizeof(prec->val)) < 0 ? -1 : 0;
}

/* LEN counts the terminator. */
static long readLsi(dbCommon *common)
{
    lsiRecord *prec = (lsiRecord *)common;
    long n = readText(common, prec->val, prec->sizv);

    if (n < 0)
        return -1;
    prec->len = (epicsUInt32)n + 1;
    return 0;
}

/* --- Arrays -------------------------------------------------------------------------------------- */

/* Returns the number of elements, or -1: the array stays as it is. */
static long readArray(dbCommon *common, void *array, size_t nelm)
{
    devRecord *dev = devOf(common);
    char reason[PLC_REASON_SIZE];
    const epicsUInt8 *place;
    const eipType *type;
    size_t n;

    if (!dev || devEipFetchPlace(common, dev->buffer))
        return -1;
    place = dev->buffer;
    type = eipTypeOf((unsigned)eipGetUnsigned(place, 2));
    n = (size_t)eipGetUnsigned(place + eipPlaceCountAt, 4);
    if (!type || !type->size || n > nelm)
        n = 0;
    if (n && (devEipElements(dev, type, place + eipPlaceHead, n, NULL, reason) ||
              devEipElements(dev, type, place + eipPlaceHead, n, array, reason)))
        return devEipUnshown(common, reason);
    common->udf = FALSE;
    return (long)n;
}

static long readWaveform(dbCommon *common)
{
    waveformRecord *prec = (waveformRecord *)common;
    long n = readArray(common, prec->bptr, prec->nelm);

    if (n < 0)
        return -1;
    prec->nord = (epicsUInt32)n;
    return 0;
}

static long readAai(dbCommon *common)
{
    aaiRecord *prec = (aaiRecord *)common;
    long n;

    if (prec->simm == menuYesNoYES)
        return devReadSimulated(prec);
    n = readArray(common, prec->bptr, prec->nelm);
    if (n < 0)
        return -1;
    prec->nord = (epicsUInt32)n;
    return 0;
}

static int isNumberArray(int ftvl, plcLinkError *error)
{
    if (ftvl != menuFtypeSTRING)
        return 0;
    return plcLinkFail(error, 0, "FTVL=STRING is not possible; allowed: numbers");
}

static int resolveWaveform(dbCommon *common, devRecord *dev, const char *text,
                           plcLinkError *error)
{
    return isNumberArray(((waveformRecord *)common)->ftvl, error) ||
                   devEipArray(common, dev, text, error)
               ? -1
               : 0;
}

static int resolveAai(dbCommon *common, devRecord *dev, const char *text,
                      plcLinkError *error)
{
    return isNumberArray(((aaiRecord *)common)->ftvl, error) ||
                   devEipArray(common, dev, text, error)
               ? -1
               : 0;
}

/* --- The rows ------------------------------------------------------------------------------------ */

#define INPUT(type, read, find)                                                            \
    {                                                                                      \
        .common = DEV_DSET, .transfer = read, .dtyp = "EtherIP", .field = "INP",           \
        .direction = devIn, .shape = {type, 0, 0, 0, NULL}, .resolve = find                \
    }

const devSupport devEipAi = INPUT("ai", readAi, resolveAi);
const devSupport devEipBi = INPUT("bi", readBi, devEipBit);
const devSupport devEipMbbi = INPUT("mbbi", readMbbi, devEipBits);
const devSupport devEipMbbiDirect = INPUT("mbbiDirect", readMbbiDirect, devEipBits);
const devSupport devEipLongin = INPUT("longin", readLongin, devEipNumber);
const devSupport devEipInt64in = INPUT("int64in", readInt64in, devEipNumber);
const devSupport devEipStringin = INPUT("stringin", readStringin, devEipText);
const devSupport devEipLsi = INPUT("lsi", readLsi, devEipText);
const devSupport devEipWaveform = INPUT("waveform", readWaveform, resolveWaveform);
const devSupport devEipAai = INPUT("aai", readAai, resolveAai);

epicsExportAddress(dset, devEipAi);
epicsExportAddress(dset, devEipBi);
epicsExportAddress(dset, devEipMbbi);
epicsExportAddress(dset, devEipMbbiDirect);
epicsExportAddress(dset, devEipLongin);
epicsExportAddress(dset, devEipInt64in);
epicsExportAddress(dset, devEipStringin);
epicsExportAddress(dset, devEipLsi);
epicsExportAddress(dset, devEipWaveform);
epicsExportAddress(dset, devEipAai);
