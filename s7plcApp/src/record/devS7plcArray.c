/* Device support "S7plc": waveform, aai and aao. Their data type comes from FTVL; the way
 * from the link to the bytes is in devS7plc.c.
 *
 * Copies between the block and the record's own array (BPTR), which Base has allocated.
 */
#include <string.h>

#include <aaiRecord.h>
#include <aaoRecord.h>
#include <dbAccess.h>
#include <dbEvent.h>
#include <dbFldTypes.h>
#include <epicsStdio.h>
#include <menuFtype.h>
#include <menuYesNo.h>
#include <waveformRecord.h>

#include "plcCompat.h"
#include "devS7plc.h"

#include <epicsExport.h> /* last */

/* What FTVL allows: the integer or real type of its size; single bytes more than that. */
static const struct {
    const char *name;
    unsigned kinds;
    unsigned size;
    const char *defaultType;
} elementTypes[] = {
    /* clang-format off */
    [menuFtypeCHAR]    = {"CHAR",   plcInteger | plcText | plcBcd, 1, "INT8"},
    [menuFtypeUCHAR]   = {"UCHAR",  plcInteger | plcText | plcBcd, 1, "UINT8"},
    [menuFtypeSHORT]   = {"SHORT",  plcInteger,                      2, "INT16"},
    [menuFtypeUSHORT]  = {"USHORT", plcInteger,                      2, "UINT16"},
    [menuFtypeLONG]    = {"LONG",   plcInteger,                      4, "INT32"},
    [menuFtypeULONG]   = {"ULONG",  plcInteger,                      4, "UINT32"},
    [menuFtypeINT64]   = {"INT64",  plcInteger,                      8, "INT64"},
    [menuFtypeUINT64]  = {"UINT64", plcInteger,                      8, "UINT64"},
    [menuFtypeFLOAT]   = {"FLOAT",  plcReal,                         4, "REAL32"},
    [menuFtypeDOUBLE]  = {"DOUBLE", plcReal,                         8, "REAL64"},
    [menuFtypeENUM]    = {"ENUM",   plcInteger,                      2, "UINT16"},
    /* clang-format on */
};

#define NUM_FTVL (sizeof(elementTypes) / sizeof(elementTypes[0]))

/* The names of the types of these kinds and exactly this size. */
static void listTypes(unsigned kinds, unsigned size, char *text, size_t room)
{
    const plcType *type;
    size_t used = 0;

    for (type = plcTypes; type->name && used < room; type++) {
        if (type->kind & kinds && type->size == size)
            used += (size_t)epicsSnprintf(text + used, room - used, "%s%s",
                                          used ? " " : "", type->name);
    }
}

/* Takes the type from FTVL where the link is silent, and refuses what does not go
 * together. T=STRING: the whole array by default. */
static int adaptArray(unsigned ftvl, size_t nelm, const plcLink *link, plcShape *shape,
                      size_t *room, plcLinkError *error)
{
    const plcType *type = link->type;
    char allowed[80];

    if (ftvl >= NUM_FTVL || !elementTypes[ftvl].name)
        return plcLinkFail(error, link->column.offset,
                           "FTVL=STRING is not possible; allowed: FTVL=CHAR with T=STRING, "
                           "numbers");
    shape->kinds = elementTypes[ftvl].kinds;
    shape->maxSize = elementTypes[ftvl].size;
    shape->defaultType = elementTypes[ftvl].defaultType;
    *room = nelm;
    if (type && (!(type->kind & shape->kinds) || type->size != shape->maxSize)) {
        listTypes(shape->kinds, shape->maxSize, allowed, sizeof(allowed));
        return plcLinkFail(error, link->column.T, "T=%s does not fit FTVL=%s; allowed: %s",
                           type->name, elementTypes[ftvl].name, allowed);
    }
    return 0;
}

/* All NELM elements, or the L bytes of a string, go through a buffer. NORD is NELM from
 * the start, unless autosave or DOL has filled the array. */
static int prepareArray(devRecord *dev, size_t nelm, epicsUInt32 *nord)
{
    if (!(dev->type->kind & plcText))
        dev->length = nelm * dev->type->size;
    if (*nord == 0)
        *nord = (epicsUInt32)nelm;
    dev->buffered = 1;
    return 0;
}

/* --- SIMM=YES: Base leaves SIOL of aai and aao, alone, to device support -------------- */

long devReadSimulated(aaiRecord *prec)
{
    long n = (long)prec->nelm, status;

    if (dbLinkIsConstant(&prec->siol))
        return 0;
    status = dbGetLink(&prec->siol, prec->ftvl, prec->bptr, NULL, &n);
    if (status)
        return status;
    prec->udf = FALSE;
    if (prec->nord != (epicsUInt32)n) {
        prec->nord = (epicsUInt32)n;
        db_post_events(prec, &prec->nord, DBE_VALUE | DBE_LOG);
    }
    return 0;
}

long devWriteSimulated(aaoRecord *prec)
{
    return dbPutLink(&prec->siol, prec->ftvl, prec->bptr, (long)prec->nord);
}

/* --- Reading ------------------------------------------------------------------------ */

/* Bytes in wire order become the elements of an array. Returns their number, NORD: all of
 * them; of an S7STRING the characters that it has, with zeros behind. */
static epicsUInt32 toArray(const devRecord *dev, const epicsUInt8 *bytes, void *array,
                           size_t nelm)
{
    size_t chars;

    if (dev->type->kind == plcS7String) {
        chars = plcGetText(dev->type, bytes, dev->length, dev->order, array, nelm);
        memset((char *)array + chars, 0, nelm - chars);
        return (epicsUInt32)chars;
    }
    if (dev->type->kind == plcBcd)
        plcBcdDecode(array, bytes, dev->length);
    else if (dev->type->kind == plcString)
        plcTextFromBytes(array, bytes, dev->length, dev->order);
    else
        plcCopyElements(array, bytes, dev->type->size, dev->length / dev->type->size,
                        dev->order);
    return (epicsUInt32)nelm;
}

/* Returns 0, with the array and NORD filled, or -1. */
static long readArray(dbCommon *common, void *array, size_t nelm, epicsUInt32 *nord)
{
    const devRecord *dev = devOf(common);

    if (!dev || devFetch(common, dev->buffer))
        return -1;
    *nord = toArray(dev, dev->buffer, array, nelm);
    common->udf = FALSE;
    if (dev->type->kind == plcBcd)
        devCheckDigits(common, dev, dev->buffer); /* the array shows what the bytes are */
    return 0;
}

static long readWaveform(dbCommon *common)
{
    waveformRecord *prec = (waveformRecord *)common;

    return readArray(common, prec->bptr, prec->nelm, &prec->nord);
}

static int adaptWaveform(dbCommon *common, const plcLink *link, plcShape *shape,
                         size_t *room, plcLinkError *error)
{
    waveformRecord *prec = (waveformRecord *)common;

    return adaptArray(prec->ftvl, prec->nelm, link, shape, room, error);
}

static int prepareWaveform(dbCommon *common, devRecord *dev, const plcLink *link,
                           plcLinkError *error)
{
    waveformRecord *prec = (waveformRecord *)common;

    (void)link, (void)error;
    return prepareArray(dev, prec->nelm, &prec->nord);
}

static long readAai(dbCommon *common)
{
    aaiRecord *prec = (aaiRecord *)common;

    if (prec->simm == menuYesNoYES)
        return devReadSimulated(prec);
    return readArray(common, prec->bptr, prec->nelm, &prec->nord);
}

static int adaptAai(dbCommon *common, const plcLink *link, plcShape *shape, size_t *room,
                    plcLinkError *error)
{
    aaiRecord *prec = (aaiRecord *)common;

    return adaptArray(prec->ftvl, prec->nelm, link, shape, room, error);
}

static int prepareAai(dbCommon *common, devRecord *dev, const plcLink *link,
                      plcLinkError *error)
{
    aaiRecord *prec = (aaiRecord *)common;

    (void)link, (void)error;
    return prepareArray(dev, prec->nelm, &prec->nord);
}

/* --- Writing ------------------------------------------------------------------------ */

/* Writes the whole array, also what is behind the NORD elements of the last put; an
 * S7STRING has NORD characters, up to the first NUL. */
static long writeAao(dbCommon *common)
{
    const aaoRecord *prec = (aaoRecord *)common;
    const void *array = prec->bptr;
    const devRecord *dev = devOf(common);
    const char *nul;

    if (!dev)
        return -1;
    if (dev->type->kind == plcS7String) {
        nul = memchr(array, 0, prec->nord);
        plcPutText(dev->type, dev->buffer, dev->length, dev->order, array,
                   nul ? (size_t)(nul - (const char *)array) : prec->nord);
    } else if (dev->type->kind == plcBcd) {
        plcBcdEncode(dev->buffer, array, dev->length);
    } else if (dev->type->kind == plcString) {
        plcTextToBytes(dev->buffer, array, dev->length, dev->order);
    } else {
        plcCopyElements(dev->buffer, array, dev->type->size,
                        dev->length / dev->type->size, dev->order);
    }
    return devStore(common, dev->buffer, NULL);
}

static long transferAao(dbCommon *common)
{
    aaoRecord *prec = (aaoRecord *)common;

    return prec->simm == menuYesNoYES ? devWriteSimulated(prec) : devWrite(common);
}

static void followAao(dbCommon *common, const devRecord *dev, const epicsUInt8 *bytes)
{
    aaoRecord *prec = (aaoRecord *)common;

    prec->nord = toArray(dev, bytes, prec->bptr, prec->nelm);
}

static int adaptAao(dbCommon *common, const plcLink *link, plcShape *shape, size_t *room,
                    plcLinkError *error)
{
    aaoRecord *prec = (aaoRecord *)common;

    return adaptArray(prec->ftvl, prec->nelm, link, shape, room, error);
}

static int prepareAao(dbCommon *common, devRecord *dev, const plcLink *link,
                      plcLinkError *error)
{
    aaoRecord *prec = (aaoRecord *)common;

    (void)link, (void)error;
    return prepareArray(dev, prec->nelm, &prec->nord);
}

/* --- The rows: adapt fills in what the shape allows --------------------------------- */

/* clang-format off */
const devSupport devS7plcWaveform = {
    .common = DEV_DSET, .transfer = readWaveform, .dtyp = "S7plc", .field = "INP",
    .direction = devIn, .shape = {"waveform", 0, 0, plcHasL | plcHasW, NULL},
    .adapt = adaptWaveform, .prepare = prepareWaveform};
const devSupport devS7plcAai = {
    .common = DEV_DSET, .transfer = readAai, .dtyp = "S7plc", .field = "INP",
    .direction = devIn, .shape = {"aai", 0, 0, plcHasL | plcHasW, NULL},
    .adapt = adaptAai, .prepare = prepareAai};
const devSupport devS7plcAao = {
    .common = DEV_DSET, .transfer = transferAao, .dtyp = "S7plc", .field = "OUT",
    .direction = devOut, .shape = {"aao", 0, 0, plcHasL | plcHasR | plcHasW, NULL},
    .adapt = adaptAao, .prepare = prepareAao, .write = writeAao, .follow = followAao};
/* clang-format on */

epicsExportAddress(dset, devS7plcWaveform);
epicsExportAddress(dset, devS7plcAai);
epicsExportAddress(dset, devS7plcAao);
