/* Device support "EtherIP": between the place of a tag and its record, the part that is the same for
 * every record type; see devEip.h. */
#include <math.h>
#include <string.h>

#include <alarm.h>
#include <epicsStdio.h>

#include "plcCompat.h"
#include "devEip.h"

/* --- Reading ----------------------------------------------------------------------------------- */

/* The controller has BOOL[n] as n bytes, not packed into DINTs. */
static const char noBits[] = "each BOOL is an element: E in the link";

static long noValue(dbCommon *prec)
{
    recGblSetSevrMsg(prec, READ_ALARM, INVALID_ALARM, "the tag has not been read yet");
    return -1;
}

/* Elements that hold all of the bits by themselves. */
static const char noNext[] = "an element has these bits: E in the link";

static long fetchAcross(dbCommon *prec, const devRecord *dev, eipNumber *number)
{
    const devEip *own = eipOf(dev);
    const epicsUInt8 *place = dev->buffer;
    const eipType *type;
    epicsUInt64 bits;

    if (devEipFetchPlace(prec, dev->buffer))
        return -1;
    type = eipTypeOf((unsigned)eipGetUnsigned(place, 2));
    if (!type || !type->size)
        return noValue(prec);
    if (type->size > 4) {
        recGblSetSevrMsg(prec, READ_ALARM, INVALID_ALARM, noNext);
        return -1;
    }
    bits = eipGetUnsigned(place + eipPlaceHead, type->size) |
           eipGetUnsigned(place + eipPlaceHead + type->size, type->size) << 32;
    number->kind = eipUnsigned;
    number->u.integer = (epicsInt64)(bits >> own->shift & own->across);
    return 0;
}

long devEipFetch(dbCommon *prec, eipNumber *number)
{
    devRecord *dev = devOf(prec);
    epicsUInt8 cell[eipCellSize];
    epicsUInt64 bits;

    if (dev && eipOf(dev)->across)
        return fetchAcross(prec, dev, number);
    if (!dev || devFetch(prec, cell))
        return -1;
    if (plcImageRead(dev->image, eipOf(dev)->at, sizeof(cell), cell, NULL) ||
        (!cell[0] && !cell[1]))
        return noValue(prec);
    if (eipOf(dev)->counted && eipGetUnsigned(cell, 2) == eipBool) {
        recGblSetSevrMsg(prec, READ_ALARM, INVALID_ALARM, noBits);
        return -1;
    }
    bits = eipGetUnsigned(cell + eipPlaceHead, 8);
    number->kind = (eipKind)cell[eipPlaceKindAt];
    if (dev->mask && number->kind != eipReal) {
        number->kind = eipUnsigned;
        bits = (bits & dev->mask) >> eipOf(dev)->shift;
    }
    memcpy(&number->u, &bits, sizeof(bits));
    return 0;
}

long devEipFetchPlace(dbCommon *prec, epicsUInt8 *bytes)
{
    devRecord *dev = devOf(prec);

    if (!dev || devFetch(prec, bytes))
        return -1;
    if (plcImageRead(dev->image, eipOf(dev)->at, eipOf(dev)->room, bytes, NULL) ||
        (!bytes[0] && !bytes[1]))
        return noValue(prec);
    return 0;
}

epicsInt64 devEipInteger(const eipNumber *number)
{
    double value;

    if (number->kind != eipReal)
        return number->u.integer;
    value = number->u.real < 0 ? ceil(number->u.real - 0.5) : floor(number->u.real + 0.5);
    if (isnan(value))
        return 0;
    if (value >= 9223372036854775807.0)
        return 0x7fffffffffffffffLL;
    return value <= -9223372036854775808.0 ? -0x7fffffffffffffffLL - 1 : (epicsInt64)value;
}

/* --- Writing ----------------------------------------------------------------------------------- */

const eipType *devEipType(const devRecord *dev)
{
    epicsUInt8 head[2];

    if (plcImageRead(plcStationInput(dev->station), eipOf(dev)->at, sizeof(head), head, NULL))
        return NULL;
    return eipTypeOf((unsigned)eipGetUnsigned(head, 2));
}

long devEipRefuse(dbCommon *prec, const char *format, const char *what)
{
    devRecord *dev = prec->dpvt;
    char text[PLC_REASON_SIZE];

    dev->refused = 1;
    epicsSnprintf(text, sizeof(text), format, what);
    return devRefuseWrite(prec, "%s", text);
}

/* What the output image says of the number in a place; written only when it is news. */
static int tellKind(dbCommon *prec, const devRecord *dev, unsigned kind)
{
    char reason[PLC_REASON_SIZE];
    epicsUInt8 now, byte = (epicsUInt8)kind;

    plcImagePeek(dev->image, eipOf(dev)->at + eipPlaceKindAt, 1, &now);
    if (now == byte)
        return 0;
    if (plcStationWrite(dev->station, eipOf(dev)->at + eipPlaceKindAt, 1, &byte, NULL,
                        reason) == 0)
        return 0;
    return (int)devEipRefuse(prec, "%s", reason);
}

/* The number as the tag would show it, where its type is known. Returns 0, or -1: the tag has
 * no such value. */
static int asTag(const eipType *type, const eipNumber *number, eipNumber *shown)
{
    epicsUInt8 raw[8];

    *shown = *number;
    if (!type || !type->size)
        return 0;
    if (eipNumberPut(type, raw, number))
        return -1;
    eipNumberGet(type, raw, shown);
    return 0;
}

/* The part of a number whose bits are in the second element. Returns 0, or -1 with an alarm. */
static int storeSecond(dbCommon *prec, const devRecord *dev, epicsUInt64 value)
{
    const devEip *own = eipOf(dev);
    epicsUInt8 bytes[8], mask[8];
    char reason[PLC_REASON_SIZE];

    eipSetUnsigned(bytes, 8, (value & own->across) >> (32 - own->shift));
    eipSetUnsigned(mask, 8, own->across >> (32 - own->shift));
    if (plcStationWrite(dev->station, eipPlaceOffset(own->second) + eipPlaceHead, 8, bytes, mask,
                        reason) == 0)
        return 0;
    return (int)devEipRefuse(prec, "%s", reason);
}

/* What the PLC shows of it, in its place among the bits of the number. */
static epicsUInt64 shownSecond(const devRecord *dev)
{
    const devEip *own = eipOf(dev);
    unsigned first = 32 - own->shift;
    epicsUInt8 bytes[8];

    if (plcImageRead(plcStationInput(dev->station),
                     eipPlaceOffset(own->second) + eipPlaceHead, 8, bytes, NULL))
        return 0;
    return (eipGetUnsigned(bytes, 8) & own->across >> first) << first;
}

long devEipStore(dbCommon *prec, const eipNumber *number)
{
    devRecord *dev = devOf(prec);
    const eipType *type;
    epicsUInt8 bytes[8], mask[DEV_SCALAR];
    eipNumber shown;
    epicsUInt64 bits;

    if (!dev)
        return -1;
    type = devEipType(dev);
    if (dev->mask) {
        bits = (epicsUInt64)number->u.integer << eipOf(dev)->shift & dev->mask;
        if (type && type->code == eipBool && eipOf(dev)->counted)
            return devEipRefuse(prec, "%s", noBits);
        if (type && type->size > 4 && eipOf(dev)->second)
            return devEipRefuse(prec, "%s", noNext);
        if (type && type->size && type->code != eipBool && dev->mask >> (8 * type->size - 1) > 1)
            return devEipRefuse(prec, "%s has no such bits", type->name);
        if (eipOf(dev)->second && storeSecond(prec, dev, (epicsUInt64)number->u.integer))
            return -1;
        eipSetUnsigned(bytes, 8, bits);
        return devStore(prec, bytes, devMask(dev, mask));
    }
    if (asTag(type, number, &shown))
        return devEipRefuse(prec, "the value does not fit %s", type->name);
    if (tellKind(prec, dev, shown.kind))
        return -1;
    memcpy(&bits, &shown.u, sizeof(bits));
    eipSetUnsigned(bytes, 8, bits);
    return devStore(prec, bytes, NULL);
}

long devEipStoreText(dbCommon *prec, const char *text, size_t length)
{
    devRecord *dev = devOf(prec);
    epicsUInt8 *bytes;

    if (!dev)
        return -1;
    if (length > eipOf(dev)->room - eipPlaceHead)
        length = eipOf(dev)->room - eipPlaceHead;
    bytes = dev->buffer;
    memset(bytes, 0, eipOf(dev)->room);
    eipSetUnsigned(bytes, 4, length);
    memcpy(bytes + eipPlaceHead - eipPlaceCountAt, text, length);
    return devStore(prec, bytes, NULL);
}

/* One element of the machine as a number. */
static void elementGet(const void *array, eipKind kind, unsigned size, size_t i,
                       eipNumber *number)
{
    const epicsUInt8 *at = (const epicsUInt8 *)array + i * size;
    epicsUInt8 raw[8];
    eipType from = {"", 0, kind, size};

    plcCopyElements(raw, at, size, 1, plcLittleEndian);
    eipNumberGet(&from, raw, number);
}

long devEipStoreArray(dbCommon *prec, const void *array, eipKind kind, unsigned size,
                      size_t count)
{
    devRecord *dev = devOf(prec);
    const eipType *type;
    epicsUInt8 *bytes, *at;
    size_t i;

    if (!dev)
        return -1;
    type = devEipType(dev);
    if (!type || !type->size)
        type = NULL;
    if (count > eipOf(dev)->elements)
        count = eipOf(dev)->elements;
    bytes = dev->buffer; /* begins at eipPlaceKindAt */
    memset(bytes, 0, eipOf(dev)->room);
    bytes[0] = (epicsUInt8)(type ? type->kind : kind);
    bytes[1] = (epicsUInt8)(type ? type->size : size);
    eipSetUnsigned(bytes + eipPlaceCountAt - eipPlaceKindAt, 4, count);
    at = bytes + eipPlaceHead - eipPlaceKindAt;
    for (i = 0; i < count; i++) {
        eipNumber number;

        elementGet(array, kind, size, i, &number);
        if (type && eipNumberPut(type, at + i * type->size, &number))
            return devEipRefuse(prec, "an element does not fit %s", type->name);
        if (!type)
            plcCopyElements(at + i * size, (const epicsUInt8 *)array + i * size, size, 1,
                            plcLittleEndian);
    }
    return devStore(prec, bytes, NULL);
}

void devEipShown(const devRecord *dev, const epicsUInt8 *bytes, eipNumber *number)
{
    const eipType *type = devEipType(dev);
    epicsUInt64 bits = eipGetUnsigned(bytes, 8);
    epicsUInt8 kind = 0;

    if (type && type->size)
        kind = (epicsUInt8)type->kind;
    else
        plcImagePeek(dev->image, eipOf(dev)->at + eipPlaceKindAt, 1, &kind);
    number->kind = kind ? (eipKind)kind : eipSigned;
    if (dev->mask && number->kind != eipReal) {
        number->kind = eipUnsigned;
        bits = (bits & dev->mask) >> eipOf(dev)->shift;
        if (eipOf(dev)->second)
            bits |= shownSecond(dev);
    }
    memcpy(&number->u, &bits, sizeof(bits));
}

/* The PLC does not show this place: there is nothing to follow. */
static long notShown(dbCommon *prec, devRecord *dev)
{
    dev->following = 0;
    prec->udf = TRUE;
    return devRefused(prec, dev) || devUnseen(prec, dev) ? -1 : noValue(prec);
}

/* FORCE: what the PLC shows is no reason to follow, once the record has a value of its own. */
static int isForced(const devRecord *dev)
{
    return eipOf(dev)->force && eipOf(dev)->forced;
}

int devEipFollows(const dbCommon *prec)
{
    const devRecord *dev = prec->dpvt;

    return devEipType(dev) && !isForced(dev);
}

long devEipWrite(dbCommon *prec)
{
    devRecord *dev = prec->dpvt;

    if (dev && dev->station && dev->following && !devEipType(dev))
        return notShown(prec, dev);
    if (dev && dev->station && dev->following && isForced(dev)) {
        long status;

        dev->following = 0;
        status = ((const devSupport *)prec->dset)->write(prec);
        dev->mark.number = 0; /* nobody waits for it */
        return status;
    }
    if (dev && dev->station && !dev->following)
        eipOf(dev)->forced = 1;
    return devWrite(prec);
}

/* --- Statistics -------------------------------------------------------------------------------- */

int devEipStatistic(const devRecord *dev, double *value)
{
    const devEip *own = eipOf(dev);
    eipWorkerState state;
    eipTimes times;
    plcStats stats;

    switch (own->statistic) {
    case eipPlcErrors:
    case eipListErrors:
        plcStationStats(dev->station, &stats);
        *value = (double)(stats.disconnects + stats.connectErrors);
        return 0;
    case eipPlcTaskSlow:
        eipWorkerStateGet(own->plc->worker, &state);
        *value = (double)state.late;
        return 0;
    default:
        break;
    }
    if (eipWorkerTimes(own->plc->worker, own->period, &times))
        return -1;
    switch (own->statistic) {
    case eipListTicks:
    case eipListTime:
        *value = times.stamp.secPastEpoch;
        break;
    case eipListMinScanTime:
        *value = times.min;
        break;
    case eipListMaxScanTime:
        *value = times.max;
        break;
    default:
        *value = times.last;
        break;
    }
    return 0;
}
