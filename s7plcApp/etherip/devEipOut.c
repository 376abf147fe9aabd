/* Device support "EtherIP": the output records. One adapter and one row per record type; the
 * way from the value to the tag is in devEip.c.
 *
 * No init touches VAL (autosave has set it): the first value comes from the PLC.
 */
#include <math.h>
#include <string.h>

#include <aaoRecord.h>
#include <alarm.h>
#include <aoRecord.h>
#include <boRecord.h>
#include <calcoutRecord.h>
#include <cvtTable.h>
#include <int64outRecord.h>
#include <longoutRecord.h>
#include <lsoRecord.h>
#include <mbboDirectRecord.h>
#include <mbboRecord.h>
#include <menuConvert.h>
#include <menuFtype.h>
#include <menuIvoa.h>
#include <menuYesNo.h>
#include <stringoutRecord.h>

#include "devEip.h"

#include <epicsExport.h> /* last */

/* --- ao and calcout ------------------------------------------------------------------------------ */

/* Real tags get the value as it is; integers what the record has made of it, also where that is
 * beyond RVAL. */
static long writeAo(dbCommon *common)
{
    aoRecord *prec = (aoRecord *)common;
    devRecord *dev = devOf(common);
    const eipType *type;
    eipNumber number;
    int plain = prec->linr == menuConvertNO_CONVERSION && prec->roff == 0 &&
                prec->aoff == 0.0 && (prec->aslo == 0.0 || prec->aslo == 1.0);

    if (!dev)
        return -1;
    type = devEipType(dev);
    if ((type && type->kind == eipReal) || plain || isnan(prec->oval))
        number = devEipReal(prec->oval);
    else if (prec->rval == 0x7fffffff || prec->rval == -0x7fffffff - 1)
        number = devEipReal(devAoRaw(prec));
    else
        number = devEipSigned(prec->rval);
    return devEipStore(common, &number);
}

static void followAo(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    aoRecord *prec = (aoRecord *)common;
    eipNumber number;
    double value;

    devEipShown(dev, bytes, &number);
    value = eipNumberReal(&number);
    if (number.kind != eipReal) {
        prec->rval = (epicsInt32)number.u.integer;
        value += prec->roff;
        if (prec->aslo != 0.0)
            value *= prec->aslo;
        value += prec->aoff;
        if (prec->linr == menuConvertLINEAR || prec->linr == menuConvertSLOPE)
            value = value * prec->eslo + prec->eoff;
        else if (prec->linr != menuConvertNO_CONVERSION)
            cvtRawToEngBpt(&value, prec->linr, prec->init, (void *)&prec->pbrk, &prec->lbrk);
    }
    prec->val = prec->oval = prec->pval = value;
}

static long writeCalcout(dbCommon *common)
{
    eipNumber number = devEipReal(((calcoutRecord *)common)->oval);

    return devEipStore(common, &number);
}

/* A write will come at the end of the delay. */
static int delaysCalcout(const dbCommon *common)
{
    const calcoutRecord *prec = (const calcoutRecord *)common;

    return prec->dlya && (prec->nsev < INVALID_ALARM ||
                          prec->ivoa != menuIvoaDon_t_drive_outputs);
}

/* calcout has no value of its own to set: OVAL shows the PLC's until the next calculation. */
static void followCalcout(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    eipNumber number;

    devEipShown(dev, bytes, &number);
    ((calcoutRecord *)common)->oval = eipNumberReal(&number);
}

/* --- Bits ---------------------------------------------------------------------------------------- */

/* Without bits in its link a bo writes 0 or 1. */
static long writeBo(dbCommon *common)
{
    eipNumber number = devEipSigned(((boRecord *)common)->rval != 0);

    return devEipStore(common, &number);
}

static int resolveBo(dbCommon *common, devRecord *dev, const char *text, plcLinkError *error)
{
    ((boRecord *)common)->mask = 1;
    return devEipBit(common, dev, text, error);
}

static void followBo(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    boRecord *prec = (boRecord *)common;
    eipNumber number;

    devEipShown(dev, bytes, &number);
    if (devEipIsNan(dev, &number))
        return;
    prec->rval = prec->val = eipNumberReal(&number) != 0;
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

static long writeMbbo(dbCommon *common)
{
    eipNumber number = devEipSigned(((mbboRecord *)common)->rval);

    return devEipStore(common, &number);
}

/* The state whose value this is; without states the number itself. */
static void followMbbo(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    mbboRecord *prec = (mbboRecord *)common;
    const epicsUInt32 *states = &prec->zrvl;
    eipNumber number;
    int i;

    devEipShown(dev, bytes, &number);
    prec->rval = (epicsUInt32)devEipInteger(&number);
    if (!prec->sdef) {
        prec->val = (epicsEnum16)prec->rval;
        return;
    }
    prec->val = 65535; /* unknown state */
    for (i = 0; i < 16; i++)
        if (states[i] == prec->rval) {
            prec->val = (epicsEnum16)i;
            return;
        }
}

static long writeMbboDirect(dbCommon *common)
{
    eipNumber number = devEipSigned(((mbboDirectRecord *)common)->rval);

    return devEipStore(common, &number);
}

static void followMbboDirect(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    mbboDirectRecord *prec = (mbboDirectRecord *)common;
    epicsUInt8 *bit = &prec->b0;
    unsigned bits = (unsigned)sizeof(prec->val) * 8, i;
    eipNumber number;

    devEipShown(dev, bytes, &number);
    prec->rval = (epicsUInt32)devEipInteger(&number);
    prec->val = (epicsInt32)prec->rval;
    for (i = 0; i < bits; i++)
        bit[i] = prec->val >> i & 1;
}

/* --- Integers ------------------------------------------------------------------------------------ */

static long writeLongout(dbCommon *common)
{
    eipNumber number = devEipSigned(((longoutRecord *)common)->val);

    return devEipStore(common, &number);
}

static void followLongout(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    eipNumber number;
    epicsInt64 value;

    devEipShown(dev, bytes, &number);
    value = devEipInteger(&number);
    ((longoutRecord *)common)->val = value > 0x7fffffff      ? 0x7fffffff
                                     : value < -0x7fffffff - 1 ? -0x7fffffff - 1
                                                               : (epicsInt32)value;
}

static long writeInt64out(dbCommon *common)
{
    eipNumber number = devEipSigned(((int64outRecord *)common)->val);

    return devEipStore(common, &number);
}

static void followInt64out(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    eipNumber number;

    devEipShown(dev, bytes, &number);
    ((int64outRecord *)common)->val = devEipInteger(&number);
}

/* --- Strings: the bytes begin with the length --------------------------------------------------- */

static long writeText(dbCommon *common, const char *text, size_t size)
{
    const char *nul = memchr(text, 0, size);

    return devEipStoreText(common, text, nul ? (size_t)(nul - text) : size);
}

static size_t followText(char *text, size_t size, const devRecord *dev, const epicsUInt8 *bytes)
{
    size_t n = (size_t)eipGetUnsigned(bytes, 4);

    if (n > dev->length - 4)
        n = dev->length - 4;
    if (n > size - 1)
        n = size - 1;
    memcpy(text, bytes + 4, n);
    text[n] = 0;
    return n;
}

static long writeStringout(dbCommon *common)
{
    stringoutRecord *prec = (stringoutRecord *)common;

    return writeText(common, prec->val, sizeof(prec->val));
}

static void followStringout(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    stringoutRecord *prec = (stringoutRecord *)common;

    followText(prec->val, sizeof(prec->val), dev, bytes);
}

static long writeLso(dbCommon *common)
{
    lsoRecord *prec = (lsoRecord *)common;

    return writeText(common, prec->val, prec->sizv);
}

static void followLso(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    lsoRecord *prec = (lsoRecord *)common;

    prec->len = (epicsUInt32)followText(prec->val, prec->sizv, dev, bytes) + 1;
}

/* --- aao ----------------------------------------------------------------------------------------- */

/* The NORD elements of the last put. */
static long writeAao(dbCommon *common)
{
    aaoRecord *prec = (aaoRecord *)common;

    return devEipStoreArray(common, prec->bptr, prec->nord);
}

/* The bytes begin with kind and size of an element, then their number. An array of which the record
 * cannot have an element is not taken. */
static void followAao(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    aaoRecord *prec = (aaoRecord *)common;
    eipType from = {"", 0, (eipKind)bytes[0], bytes[1]};
    const eipType *type = devEipType(dev);
    size_t n = (size_t)eipGetUnsigned(bytes + 2, 4);
    char *misfit = eipOf(dev)->misfit;

    if (type && type->kind == from.kind && type->size == from.size)
        from = *type;
    misfit[0] = 0;
    if (!from.size || from.size > 8 || n > prec->nelm || n * from.size > dev->length - 6)
        return;
    if (devEipElements(dev, &from, bytes + 6, n, NULL, misfit) ||
        devEipElements(dev, &from, bytes + 6, n, prec->bptr, misfit))
        return;
    prec->nord = (epicsUInt32)n;
}

static long transferAao(dbCommon *common)
{
    aaoRecord *prec = (aaoRecord *)common;

    return prec->simm == menuYesNoYES ? devWriteSimulated(prec) : devEipWrite(common);
}

static int resolveAao(dbCommon *common, devRecord *dev, const char *text, plcLinkError *error)
{
    if (((aaoRecord *)common)->ftvl == menuFtypeSTRING)
        return plcLinkFail(error, 0, "FTVL=STRING is not possible; allowed: numbers");
    return devEipArray(common, dev, text, error);
}

/* --- The rows ------------------------------------------------------------------------------------ */

#define OUTPUT(type, status, find, puts, takes, ...)                                       \
    OUTPUT_BY(devEipWrite, type, status, find, puts, takes, __VA_ARGS__)
#define OUTPUT_BY(transfers, type, status, find, puts, takes, ...)                         \
    {                                                                                      \
        .common = DEV_DSET, .transfer = transfers, .dtyp = "EtherIP", .field = "OUT",      \
        .direction = devOut, .shape = {type, 0, 0, 0, NULL}, .initStatus = status,         \
        .write = puts, .follow = takes, .follows = devEipFollows, .rests = devEipRests,    \
        .resolve = find, __VA_ARGS__                                                       \
    }

const devSupport devEipAo = OUTPUT("ao", 2, devEipNumber, writeAo, followAo, .pulse = NULL);
const devSupport devEipCalcout =
    OUTPUT("calcout", 0, devEipNumber, writeCalcout, followCalcout, .delays = delaysCalcout);
const devSupport devEipBo = OUTPUT("bo", 2, resolveBo, writeBo, followBo, .pulse = pulseBo,
                                   .pulseEnds = pulseEndsBo);
const devSupport devEipMbbo = OUTPUT("mbbo", 2, devEipBits, writeMbbo, followMbbo, .pulse = NULL);
const devSupport devEipMbboDirect =
    OUTPUT("mbboDirect", 2, devEipBits, writeMbboDirect, followMbboDirect, .pulse = NULL);
const devSupport devEipLongout =
    OUTPUT("longout", 0, devEipNumber, writeLongout, followLongout, .pulse = NULL);
const devSupport devEipInt64out =
    OUTPUT("int64out", 0, devEipNumber, writeInt64out, followInt64out, .pulse = NULL);
const devSupport devEipStringout =
    OUTPUT("stringout", 0, devEipText, writeStringout, followStringout, .pulse = NULL);
const devSupport devEipLso = OUTPUT("lso", 0, devEipText, writeLso, followLso, .pulse = NULL);
const devSupport devEipAao =
    OUTPUT_BY(transferAao, "aao", 0, resolveAao, writeAao, followAao, .pulse = NULL);

epicsExportAddress(dset, devEipAo);
epicsExportAddress(dset, devEipCalcout);
epicsExportAddress(dset, devEipBo);
epicsExportAddress(dset, devEipMbbo);
epicsExportAddress(dset, devEipMbboDirect);
epicsExportAddress(dset, devEipLongout);
epicsExportAddress(dset, devEipInt64out);
epicsExportAddress(dset, devEipStringout);
epicsExportAddress(dset, devEipLso);
epicsExportAddress(dset, devEipAao);
