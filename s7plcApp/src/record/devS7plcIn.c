/* Device support "S7plc": the input records but arrays. One adapter and one row per
 * record type; the way from the link to the bytes is in devS7plc.c.
 */
#include <math.h>
#include <string.h>

#include <aiRecord.h>
#include <alarm.h>
#include <biRecord.h>
#include <cvtTable.h>
#include <epicsMath.h>
#include <int64inRecord.h>
#include <longinRecord.h>
#include <lsiRecord.h>
#include <mbbiDirectRecord.h>
#include <mbbiRecord.h>
#include <menuConvert.h>
#include <stringinRecord.h>

#include "devS7plc.h"
#include "drvS7plc.h"
#include "plcCompat.h"
#include "plcHot.h"

#include <epicsExport.h> /* last */

#define INT32_HIGHEST 0x7FFFFFFF

/* --- ai ----------------------------------------------------------------------------- */

static long linconv(aiRecord *prec, const devRecord *dev)
{
    devScale(dev, prec->egul, prec->eguf, &prec->eslo, &prec->eoff);
    return 0;
}

static long linconvAi(dbCommon *common, int after)
{
    const devRecord *dev = common->dpvt;

    return after && dev && dev->station ? linconv((aiRecord *)common, dev) : 0;
}

static int prepareAi(dbCommon *common, devRecord *dev, const plcLink *link,
                     plcLinkError *error)
{
    aiRecord *prec = (aiRecord *)common;

    (void)link, (void)error;
    devCheckScale(common, dev, prec->linr, prec->egul, prec->eguf);
    return (int)linconv(prec, dev);
}

/* The smoothing filter of the ai record, for values that do not go through RVAL. There is
 * nothing to smooth with while VAL is undefined. */
static void smoothAi(aiRecord *prec, double value)
{
    if (prec->smoo != 0.0 && finite(prec->val) && !prec->udf)
        value = value * (1.0 - prec->smoo) + prec->val * prec->smoo;
    prec->val = value;
}

/* The conversion of the ai record, in double from the start: RVAL has only 31 bits for a
 * UINT32. */
static void convertAi(aiRecord *prec, double value)
{
    value += prec->roff;
    if (prec->aslo != 0.0)
        value *= prec->aslo;
    value += prec->aoff;
    if (prec->linr == menuConvertLINEAR || prec->linr == menuConvertSLOPE)
        value = value * prec->eslo + prec->eoff;
    else if (prec->linr != menuConvertNO_CONVERSION &&
             cvtRawToEngBpt(&value, prec->linr, prec->init, (void *)&prec->pbrk,
                            &prec->lbrk) != 0)
        recGblSetSevrMsg(prec, SOFT_ALARM, MAJOR_ALARM, "BPT Error");
    smoothAi(prec, value);
}

static long readAiReal(aiRecord *prec, double value)
{
    if (prec->aslo != 0.0)
        value *= prec->aslo;
    smoothAi(prec, value + prec->aoff);
    return 2;
}

PLC_HOT static long readAi(dbCommon *common)
{
    aiRecord *prec = (aiRecord *)common;
    const devRecord *dev = common->dpvt;
    epicsUInt8 bytes[DEV_SCALAR];
    epicsInt64 raw;

    if (devFetch(common, bytes))
        return -1;
    if (dev->type->kind == plcReal)
        return readAiReal(prec, plcGetReal(dev->type, bytes, dev->order));
    if (dev->type->kind & plcCoded && devCheckDigits(common, dev, bytes))
        return -1;
    raw = plcGetInt(dev->type, bytes, dev->order);
    prec->rval = (epicsInt32)raw;
    if (prec->udf)
        prec->init = TRUE; /* the record does not smooth its first value */
    if (raw <= INT32_HIGHEST)
        return 0;
    convertAi(prec, (double)raw);
    return 2;
}

/* --- Bits --------------------------------------------------------------------------- */

/* bi: RVAL shows the bit in its place, but of 64 bits it has room for only half: then it
 * is 1. MASK shows the bit in its half of a 64-bit type. */
PLC_HOT static long readBi(dbCommon *common)
{
    biRecord *prec = (biRecord *)common;
    const devRecord *dev = common->dpvt;
    epicsInt64 raw;

    if (devFetchInt(common, &raw))
        return -1;
    raw &= (epicsInt64)dev->mask;
    prec->rval = dev->type->size == 8 ? raw != 0 : (epicsUInt32)raw;
    return 0;
}

static int prepareBi(dbCommon *common, devRecord *dev, const plcLink *link,
                     plcLinkError *error)
{
    (void)error;
    dev->mask = (epicsUInt64)1 << link->bit;
    ((biRecord *)common)->mask = (epicsUInt32)1 << link->bit % 32;
    return 0;
}

/* The bits that the type has: those of a sign above them are not the PLC's. */
static epicsUInt32 bitsOf(const devRecord *dev, epicsInt64 raw)
{
    return (epicsUInt32)raw & 0xFFFFFFFFu >> (32 - 8 * dev->type->size);
}

PLC_HOT static long readMbbi(dbCommon *common)
{
    mbbiRecord *prec = (mbbiRecord *)common;
    const devRecord *dev = common->dpvt;
    epicsInt64 raw;

    if (devFetchInt(common, &raw))
        return -1;
    prec->rval = bitsOf(dev, raw) & prec->mask;
    return 0;
}

static int prepareMbbi(dbCommon *common, devRecord *dev, const plcLink *link,
                       plcLinkError *error)
{
    mbbiRecord *prec = (mbbiRecord *)common;

    devCheckStates(common, &prec->zrvl, prec->zrst, sizeof(prec->zrst));
    return devPrepareMask(common, dev, link, error, &prec->mask, prec->nobt, prec->shft);
}

PLC_HOT static long readMbbiDirect(dbCommon *common)
{
    mbbiDirectRecord *prec = (mbbiDirectRecord *)common;
    const devRecord *dev = common->dpvt;
    epicsInt64 raw;

    if (devFetchInt(common, &raw))
        return -1;
    prec->rval = bitsOf(dev, raw) & prec->mask;
    return 0;
}

static int prepareMbbiDirect(dbCommon *common, devRecord *dev, const plcLink *link,
                             plcLinkError *error)
{
    mbbiDirectRecord *prec = (mbbiDirectRecord *)common;

    return devPrepareMask(common, dev, link, error, &prec->mask, prec->nobt, prec->shft);
}

/* --- Integers ----------------------------------------------------------------------- */

/* longin: a UINT32 above 2147483647 shows as negative, VAL has no more bits. */
PLC_HOT static long readLongin(dbCommon *common)
{
    epicsInt64 raw;

    if (devFetchInt(common, &raw))
        return -1;
    ((longinRecord *)common)->val = (epicsInt32)raw;
    return 0;
}

static int prepareLongin(dbCommon *common, devRecord *dev, const plcLink *link,
                         plcLinkError *error)
{
    (void)link, (void)error;
    if (s7plcDebug > 0 && dev->type->kind == plcUnsigned && dev->type->size == 4)
        devWarn(common,
                "longin shows a UINT32 above 2147483647 as negative, int64in does not");
    return 0;
}

static long readInt64in(dbCommon *common)
{
    epicsInt64 raw;

    if (devFetchInt(common, &raw))
        return -1;
    ((int64inRecord *)common)->val = raw;
    return 0;
}

/* --- Strings ------------------------------------------------------------------------ */

/* Copies the PLC's text into a string of `size` bytes, terminated. Returns its length
 * without the terminator. */
static size_t copyString(char *dst, size_t size, const devRecord *dev)
{
    size_t length =
        plcGetText(dev->type, dev->buffer, dev->length, dev->order, dst, size - 1);

    dst[length] = 0;
    return length;
}

static long readStringin(dbCommon *common)
{
    stringinRecord *prec = (stringinRecord *)common;
    const devRecord *dev = devOf(common);

    if (!dev || devFetch(common, dev->buffer))
        return -1;
    copyString(prec->val, sizeof(prec->val), dev);
    prec->udf = FALSE;
    return 0;
}

static int adaptStringin(dbCommon *common, const plcLink *link, plcShape *shape,
                         size_t *room, plcLinkError *error)
{
    (void)link, (void)shape, (void)error;
    *room = sizeof(((stringinRecord *)common)->val);
    return 0;
}

/* LEN counts the terminator. */
static long readLsi(dbCommon *common)
{
    lsiRecord *prec = (lsiRecord *)common;
    const devRecord *dev = devOf(common);

    if (!dev || devFetch(common, dev->buffer))
        return -1;
    prec->len = (epicsUInt32)copyString(prec->val, prec->sizv, dev) + 1;
    prec->udf = FALSE;
    return 0;
}

static int adaptLsi(dbCommon *common, const plcLink *link, plcShape *shape, size_t *room,
                    plcLinkError *error)
{
    (void)link, (void)shape, (void)error;
    *room = ((lsiRecord *)common)->sizv;
    return 0;
}

/* --- The rows ----------------------------------------------------------------------- */

#define ANALOG (plcWhole | plcReal)

/* clang-format off */
const devSupport devS7plcAi = {
    .common = DEV_DSET, .transfer = readAi, .linconv = linconvAi, .dtyp = "S7plc",
    .field = "INP", .direction = devIn,
    .shape = {"ai", ANALOG, 4, plcHasL | plcHasH | plcHasW, "INT16"},
    .prepare = prepareAi};
const devSupport devS7plcBi = {
    .common = DEV_DSET, .transfer = readBi, .dtyp = "S7plc", .field = "INP",
    .direction = devIn, .shape = {"bi", plcInteger, 8, plcHasB | plcHasW, "INT16"},
    .prepare = prepareBi};
const devSupport devS7plcMbbi = {
    .common = DEV_DSET, .transfer = readMbbi, .dtyp = "S7plc", .field = "INP",
    .direction = devIn, .shape = {"mbbi", plcInteger, 4, plcHasW, "INT16"},
    .prepare = prepareMbbi};
const devSupport devS7plcMbbiDirect = {
    .common = DEV_DSET, .transfer = readMbbiDirect, .dtyp = "S7plc", .field = "INP",
    .direction = devIn, .shape = {"mbbiDirect", plcInteger, 4, plcHasW, "INT16"},
    .prepare = prepareMbbiDirect};
const devSupport devS7plcLongin = {
    .common = DEV_DSET, .transfer = readLongin, .dtyp = "S7plc", .field = "INP",
    .direction = devIn, .shape = {"longin", plcWhole, 4, plcHasW, "INT16"},
    .prepare = prepareLongin};
const devSupport devS7plcInt64in = {
    .common = DEV_DSET, .transfer = readInt64in, .dtyp = "S7plc", .field = "INP",
    .direction = devIn, .shape = {"int64in", plcWhole, 8, plcHasW, "INT16"}};
const devSupport devS7plcStringin = {
    .common = DEV_DSET, .transfer = readStringin, .dtyp = "S7plc", .field = "INP",
    .direction = devIn, .shape = {"stringin", plcText, 1, plcHasL | plcHasW, "STRING"},
    .adapt = adaptStringin, .prepare = devPrepareString};
const devSupport devS7plcLsi = {
    .common = DEV_DSET, .transfer = readLsi, .dtyp = "S7plc", .field = "INP",
    .direction = devIn, .shape = {"lsi", plcText, 1, plcHasL | plcHasW, "STRING"},
    .adapt = adaptLsi, .prepare = devPrepareString};
/* clang-format on */

epicsExportAddress(dset, devS7plcAi);
epicsExportAddress(dset, devS7plcBi);
epicsExportAddress(dset, devS7plcMbbi);
epicsExportAddress(dset, devS7plcMbbiDirect);
epicsExportAddress(dset, devS7plcLongin);
epicsExportAddress(dset, devS7plcInt64in);
epicsExportAddress(dset, devS7plcStringin);
epicsExportAddress(dset, devS7plcLsi);
