/* Device support "S7plc": the output records but arrays. One adapter and one row per
 * record type; the way from the link to the bytes is in devS7plc.c.
 *
 * No init touches VAL (autosave has set it), nor the output image.
 */
#include <math.h>
#include <string.h>

#include <alarm.h>
#include <aoRecord.h>
#include <boRecord.h>
#include <calcoutRecord.h>
#include <cvtTable.h>
#include <epicsMath.h>
#include <int64outRecord.h>
#include <longoutRecord.h>
#include <lsoRecord.h>
#include <mbboDirectRecord.h>
#include <mbboRecord.h>
#include <menuConvert.h>
#include <menuIvoa.h>
#include <stringoutRecord.h>

#include "plcCompat.h"
#include "devS7plc.h"

#include <epicsExport.h> /* last */

#define ALL_BITS (~(epicsUInt64)0)
#define INT32_HIGHEST 0x7FFFFFFF

/* --- ao and calcout ----------------------------------------------------------------- */

static long linconv(aoRecord *prec, const devRecord *dev)
{
    devScale(dev, prec->egul, prec->eguf, &prec->eslo, &prec->eoff);
    return 0;
}

static long linconvAo(dbCommon *common, int after)
{
    const devRecord *dev = common->dpvt;

    return after && dev && dev->station ? linconv((aoRecord *)common, dev) : 0;
}

static int prepareAo(dbCommon *common, devRecord *dev, const plcLink *link,
                     plcLinkError *error)
{
    aoRecord *prec = (aoRecord *)common;

    (void)link, (void)error;
    devCheckScale(common, dev, prec->linr, prec->egul, prec->eguf);
    return (int)linconv(prec, dev);
}

/* Cuts a value to L..H. An L below the type is a point of the LINEAR scale: what is
 * written ends at the type. */
static epicsInt64 clip(devRecord *dev, double value)
{
    epicsInt64 least = dev->type->low - (dev->type->kind == plcSigned);

    if (least < dev->low)
        least = dev->low;
    dev->cut = value < (double)least || value > (double)dev->high;
    if (value <= (double)least)
        return least;
    if (value >= (double)dev->high)
        return dev->high;
    return (epicsInt64)value;
}

double devAoRaw(aoRecord *prec)
{
    double value = prec->oval;

    if (prec->linr == menuConvertLINEAR || prec->linr == menuConvertSLOPE)
        value = prec->eslo == 0.0 ? 0.0 : (value - prec->eoff) / prec->eslo;
    else if (prec->linr != menuConvertNO_CONVERSION &&
             cvtEngToRawBpt(&value, prec->linr, prec->init, (void *)&prec->pbrk,
                            &prec->lbrk) != 0)
        return prec->rval;
    value -= prec->aoff;
    if (prec->aslo != 0.0)
        value /= prec->aslo;
    return floor(value - prec->roff + 0.5);
}

static long storeReal(dbCommon *common, double value)
{
    const devRecord *dev = common->dpvt;
    epicsUInt8 bytes[DEV_SCALAR];

    plcPutReal(dev->type, bytes, dev->order, value);
    return devStore(common, bytes, NULL);
}

static long writeAo(dbCommon *common)
{
    aoRecord *prec = (aoRecord *)common;
    devRecord *dev = devOf(common);
    int far = prec->rval == INT32_HIGHEST || prec->rval == -INT32_HIGHEST - 1;

    if (!dev)
        return -1;
    if (dev->type->kind == plcReal) {
        double value = prec->oval - prec->aoff;

        return storeReal(common, prec->aslo != 0.0 ? value / prec->aslo : value);
    }
    if (isnan(prec->oval))
        return devRefuseWrite(common, "NaN does not fit %s", dev->type->name);
    if (far)
        return devStoreInt(common, clip(dev, devAoRaw(prec)), ALL_BITS);
    return devStoreInt(common, clip(dev, prec->rval), ALL_BITS);
}

/* Whole numbers: what is behind the point is cut off. */
static long writeCalcout(dbCommon *common)
{
    double value = ((calcoutRecord *)common)->oval;
    devRecord *dev = devOf(common);

    if (!dev)
        return -1;
    if (dev->type->kind == plcReal)
        return storeReal(common, value);
    if (isnan(value))
        return devRefuseWrite(common, "NaN does not fit %s", dev->type->name);
    return devStoreInt(common, clip(dev, value), ALL_BITS);
}

/* --- Bits: the others in the same place stay as they are ---------------------------- */

static long writeBo(dbCommon *common)
{
    const devRecord *dev = devOf(common);

    if (!dev)
        return -1;
    return devStoreInt(common, ((boRecord *)common)->rval ? (epicsInt64)dev->mask : 0,
                       dev->mask);
}

/* MASK and RVAL show the bit in its half of a 64-bit type. */
static int prepareBo(dbCommon *common, devRecord *dev, const plcLink *link,
                     plcLinkError *error)
{
    (void)error;
    dev->mask = (epicsUInt64)1 << link->bit;
    ((boRecord *)common)->mask = (epicsUInt32)1 << link->bit % 32;
    return 0;
}

static long writeMbbo(dbCommon *common)
{
    mbboRecord *prec = (mbboRecord *)common;

    return devStoreInt(common, prec->rval, prec->mask);
}

static int prepareMbbo(dbCommon *common, devRecord *dev, const plcLink *link,
                       plcLinkError *error)
{
    mbboRecord *prec = (mbboRecord *)common;

    devCheckStates(common, &prec->zrvl, prec->zrst, sizeof(prec->zrst));
    return devPrepareMask(common, dev, link, error, &prec->mask, prec->nobt, prec->shft);
}

static long writeMbboDirect(dbCommon *common)
{
    mbboDirectRecord *prec = (mbboDirectRecord *)common;

    return devStoreInt(common, prec->rval, prec->mask);
}

static int prepareMbboDirect(dbCommon *common, devRecord *dev, const plcLink *link,
                             plcLinkError *error)
{
    mbboDirectRecord *prec = (mbboDirectRecord *)common;

    return devPrepareMask(common, dev, link, error, &prec->mask, prec->nobt, prec->shft);
}

/* --- Integers: the low bytes are written, modulo 2^n -------------------------------- */

static long writeLongout(dbCommon *common)
{
    return devStoreInt(common, ((longoutRecord *)common)->val, ALL_BITS);
}

static long writeInt64out(dbCommon *common)
{
    return devStoreInt(common, ((int64outRecord *)common)->val, ALL_BITS);
}

/* --- Strings ------------------------------------------------------------------------ */

/* Writes the string, cut off or filled up with NULs. `size` bytes are the record's own. */
static long storeString(dbCommon *common, const char *text, size_t size)
{
    devRecord *dev = devOf(common);
    const char *nul;
    size_t length, head;

    if (!dev)
        return -1;
    head = dev->type->kind == plcS7String ? PLC_S7STRING_HEAD : 0;
    nul = memchr(text, 0, size);
    length = nul ? (size_t)(nul - text) : size;
    plcPutText(dev->type, dev->buffer, dev->length, dev->order, text, length);
    dev->cut = plcTextBytes(dev->order, length + head) > dev->length;
    return devStore(common, dev->buffer, NULL);
}

static long writeStringout(dbCommon *common)
{
    stringoutRecord *prec = (stringoutRecord *)common;

    return storeString(common, prec->val, sizeof(prec->val));
}

static int adaptStringout(dbCommon *common, const plcLink *link, plcShape *shape,
                          size_t *room, plcLinkError *error)
{
    (void)link, (void)shape, (void)error;
    *room = sizeof(((stringoutRecord *)common)->val);
    return 0;
}

static long writeLso(dbCommon *common)
{
    lsoRecord *prec = (lsoRecord *)common;

    return storeString(common, prec->val, prec->sizv);
}

static int adaptLso(dbCommon *common, const plcLink *link, plcShape *shape, size_t *room,
                    plcLinkError *error)
{
    (void)link, (void)shape, (void)error;
    *room = ((lsoRecord *)common)->sizv;
    return 0;
}

/* --- Following: the value comes from the PLC ---------------------------------------- */

static void followAo(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    aoRecord *prec = (aoRecord *)common;
    double value;

    if (dev->type->kind == plcReal) {
        value = plcGetReal(dev->type, bytes, dev->order);
    } else {
        epicsInt64 raw = plcGetInt(dev->type, bytes, dev->order);

        prec->rval = (epicsInt32)raw;
        value = (double)raw + prec->roff;
    }
    if (prec->aslo != 0.0)
        value *= prec->aslo;
    value += prec->aoff;
    if (dev->type->kind != plcReal) {
        if (prec->linr == menuConvertLINEAR || prec->linr == menuConvertSLOPE)
            value = value * prec->eslo + prec->eoff;
        else if (prec->linr != menuConvertNO_CONVERSION)
            cvtRawToEngBpt(&value, prec->linr, prec->init, (void *)&prec->pbrk,
                           &prec->lbrk);
    }
    prec->val = prec->oval = prec->pval = value;
}

/* calcout has no value of its own to set: OVAL shows the PLC's until the next
 * calculation. */
static void followCalcout(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    ((calcoutRecord *)common)->oval =
        dev->type->kind == plcReal ? plcGetReal(dev->type, bytes, dev->order)
                                   : (double)plcGetInt(dev->type, bytes, dev->order);
}

/* A write will come at the end of the delay. */
static int delaysCalcout(const dbCommon *common)
{
    const calcoutRecord *prec = (const calcoutRecord *)common;

    return prec->dlya && (prec->nsev < INVALID_ALARM ||
                          prec->ivoa != menuIvoaDon_t_drive_outputs);
}

static void followBo(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    boRecord *prec = (boRecord *)common;
    epicsInt64 raw = plcGetInt(dev->type, bytes, dev->order);

    prec->val = (raw & (epicsInt64)dev->mask) != 0;
    prec->rval = prec->val ? prec->mask : 0;
}

static double *pulseBo(dbCommon *common)
{
    return &((boRecord *)common)->high;
}

static int pulseEndsBo(const dbCommon *common)
{
    const boRecord *prec = (const boRecord *)common;

    return prec->high > 0 && !prec->val && !prec->putf;
}

/* The state whose value this is; without states the number itself. */
static void followMbbo(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    mbboRecord *prec = (mbboRecord *)common;
    const epicsUInt32 *states = &prec->zrvl;
    epicsUInt32 value;
    int i;

    prec->rval = (epicsUInt32)plcGetInt(dev->type, bytes, dev->order) & prec->mask;
    value = prec->shft < 32 ? prec->rval >> prec->shft : 0;
    if (!prec->sdef) {
        prec->val = (epicsEnum16)value;
        return;
    }
    prec->val = 65535; /* unknown state */
    for (i = 0; i < 16; i++)
        if (states[i] == value) {
            prec->val = (epicsEnum16)i;
            return;
        }
}

static void followMbboDirect(dbCommon *common, const devRecord *dev,
                             const epicsUInt8 *bytes)
{
    mbboDirectRecord *prec = (mbboDirectRecord *)common;
    epicsUInt8 *bit = &prec->b0;
    unsigned bits = (unsigned)sizeof(prec->val) * 8, i;

    prec->rval = (epicsUInt32)plcGetInt(dev->type, bytes, dev->order) & prec->mask;
    prec->val = prec->shft < 32 ? prec->rval >> prec->shft : 0;
    for (i = 0; i < bits; i++)
        bit[i] = prec->val >> i & 1;
}

static void followLongout(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    ((longoutRecord *)common)->val = (epicsInt32)plcGetInt(dev->type, bytes, dev->order);
}

static void followInt64out(dbCommon *common, const devRecord *dev,
                           const epicsUInt8 *bytes)
{
    ((int64outRecord *)common)->val = plcGetInt(dev->type, bytes, dev->order);
}

/* Terminated; returns the length. */
static size_t followString(char *text, size_t size, const devRecord *dev,
                           const epicsUInt8 *bytes)
{
    size_t length = plcGetText(dev->type, bytes, dev->length, dev->order, text, size - 1);

    text[length] = 0;
    return length;
}

static void followStringout(dbCommon *common, const devRecord *dev,
                            const epicsUInt8 *bytes)
{
    stringoutRecord *prec = (stringoutRecord *)common;

    followString(prec->val, sizeof(prec->val), dev, bytes);
}

static void followLso(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    lsoRecord *prec = (lsoRecord *)common;

    prec->len = (epicsUInt32)followString(prec->val, prec->sizv, dev, bytes) + 1;
}

/* --- The rows ----------------------------------------------------------------------- */

#define ANALOG (plcWhole | plcReal)

/* clang-format off */
const devSupport devS7plcAo = {
    .common = DEV_DSET, .transfer = devWrite, .linconv = linconvAo, .dtyp = "S7plc",
    .field = "OUT", .direction = devOut,
    .shape = {"ao", ANALOG, 4, plcHasL | plcHasH | plcHasR | plcHasW, "INT16"},
    .initStatus = 2, .prepare = prepareAo, .write = writeAo, .follow = followAo};
const devSupport devS7plcCalcout = {
    .common = DEV_DSET, .transfer = devWrite, .dtyp = "S7plc", .field = "OUT",
    .direction = devOut,
    .shape = {"calcout", ANALOG, 4, plcHasL | plcHasH | plcHasR | plcHasW, "INT16"},
    .write = writeCalcout, .follow = followCalcout, .delays = delaysCalcout};
const devSupport devS7plcBo = {
    .common = DEV_DSET, .transfer = devWrite, .dtyp = "S7plc", .field = "OUT",
    .direction = devOut,
    .shape = {"bo", plcInteger, 8, plcHasB | plcHasR | plcHasW, "INT16"}, .initStatus = 2,
    .prepare = prepareBo, .write = writeBo, .follow = followBo, .pulse = pulseBo,
    .pulseEnds = pulseEndsBo};
const devSupport devS7plcMbbo = {
    .common = DEV_DSET, .transfer = devWrite, .dtyp = "S7plc", .field = "OUT",
    .direction = devOut, .shape = {"mbbo", plcInteger, 4, plcHasR | plcHasW, "INT16"},
    .initStatus = 2, .prepare = prepareMbbo, .write = writeMbbo, .follow = followMbbo};
const devSupport devS7plcMbboDirect = {
    .common = DEV_DSET, .transfer = devWrite, .dtyp = "S7plc", .field = "OUT",
    .direction = devOut,
    .shape = {"mbboDirect", plcInteger, 4, plcHasR | plcHasW, "INT16"}, .initStatus = 2,
    .prepare = prepareMbboDirect, .write = writeMbboDirect, .follow = followMbboDirect};
const devSupport devS7plcLongout = {
    .common = DEV_DSET, .transfer = devWrite, .dtyp = "S7plc", .field = "OUT",
    .direction = devOut, .shape = {"longout", plcWhole, 4, plcHasR | plcHasW, "INT16"},
    .write = writeLongout, .follow = followLongout};
const devSupport devS7plcInt64out = {
    .common = DEV_DSET, .transfer = devWrite, .dtyp = "S7plc", .field = "OUT",
    .direction = devOut, .shape = {"int64out", plcWhole, 8, plcHasR | plcHasW, "INT16"},
    .write = writeInt64out, .follow = followInt64out};
const devSupport devS7plcStringout = {
    .common = DEV_DSET, .transfer = devWrite, .dtyp = "S7plc", .field = "OUT",
    .direction = devOut, .shape = {"stringout", plcText, 1, plcHasL | plcHasR | plcHasW, "STRING"},
    .adapt = adaptStringout, .prepare = devPrepareString, .write = writeStringout,
    .follow = followStringout};
const devSupport devS7plcLso = {
    .common = DEV_DSET, .transfer = devWrite, .dtyp = "S7plc", .field = "OUT",
    .direction = devOut, .shape = {"lso", plcText, 1, plcHasL | plcHasR | plcHasW, "STRING"},
    .adapt = adaptLso, .prepare = devPrepareString, .write = writeLso,
    .follow = followLso};
/* clang-format on */

epicsExportAddress(dset, devS7plcAo);
epicsExportAddress(dset, devS7plcCalcout);
epicsExportAddress(dset, devS7plcBo);
epicsExportAddress(dset, devS7plcMbbo);
epicsExportAddress(dset, devS7plcMbboDirect);
epicsExportAddress(dset, devS7plcLongout);
epicsExportAddress(dset, devS7plcInt64out);
epicsExportAddress(dset, devS7plcStringout);
epicsExportAddress(dset, devS7plcLso);
