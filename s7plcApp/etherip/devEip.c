/* Device support "EtherIP": between the place of a tag and its record, the part that is the same for
 * every record type; see devEip.h. */
#include <math.h>
#include <string.h>

#include <alarm.h>
#include <epicsStdio.h>

#include "plcCompat.h"
#include "devEip.h"

/* --- Reading ----------------------------------------------------------------------------------- */

static const char noFit[] = "the value does not fit %s";

/* The controller has BOOL[n] as n bytes, not packed into DINTs. */
static const char noBits[] = "each BOOL is an element: E in the link";

/* Elements that hold all of the bits by themselves. */
static const char noNext[] = "an element has these bits: E in link";

static const char notRead[] = "the tag has not been read yet";

long devEipUnshown(dbCommon *prec, const char *reason)
{
    recGblSetSevrMsg(prec, READ_ALARM, INVALID_ALARM, "%s", reason);
    return -1;
}

static long noValue(dbCommon *prec)
{
    return devEipUnshown(prec, notRead);
}

static epicsUInt64 bitsOf(const eipType *type)
{
    return ~(epicsUInt64)0 >> (type->code == eipBool ? 63 : 64 - 8 * type->size);
}

/* Bits that the type has not. Of an input one of them is enough, the others read 0; so do those
 * that an index counts, as ether_ip has it: an array is one of DINTs then. */
static int lacksBits(const devEip *own, epicsUInt64 mask, const eipType *type)
{
    if (own->output)
        return (mask & ~bitsOf(type)) && !(own->ofNumber && type->code == eipBool);
    return !own->counted && !(mask & bitsOf(type));
}

/* Why bits of this type are no value for the record. Returns 0: they are. */
static int lacks(const devRecord *dev, const eipType *type, char reason[PLC_REASON_SIZE])
{
    const devEip *own = eipOf(dev);

    if (!dev->mask && !own->across)
        return 0;
    if (own->counted && type->code == eipBool)
        epicsSnprintf(reason, PLC_REASON_SIZE, "%s", noBits);
    else if (own->across && type->size > 4)
        epicsSnprintf(reason, PLC_REASON_SIZE, "%s", noNext);
    else if (type->kind == eipReal && (own->output || !own->ofNumber))
        epicsSnprintf(reason, PLC_REASON_SIZE, "%s has no bits", type->name);
    else if (type->kind != eipReal && dev->mask && lacksBits(own, dev->mask, type))
        epicsSnprintf(reason, PLC_REASON_SIZE,
                      type->code == eipBool ? "%s has bit 0 only" : "%s has bits 0 to %u",
                      type->name, 8 * type->size - 1);
    else
        return 0;
    return 1;
}

/* The record's part of a number: its bits, or all of it. Returns 0; or -1 when the record cannot
 * have it, and why. */
static int partOf(const devRecord *dev, const eipType *type, eipNumber *number,
                  char reason[PLC_REASON_SIZE])
{
    const devEip *own = eipOf(dev);
    epicsUInt64 bits = (epicsUInt64)number->u.integer & bitsOf(type);

    if (dev->mask && number->kind != eipReal) {
        number->kind = eipUnsigned;
        number->u.integer = (epicsInt64)((bits & dev->mask) >> own->shift);
        return 0;
    }
    if (own->holds && eipNumberAs(own->holds, type, number, reason, PLC_REASON_SIZE))
        return -1;
    if (!dev->mask || !((epicsUInt64)number->u.integer & ~dev->mask))
        return 0;
    epicsSnprintf(reason, PLC_REASON_SIZE, "%llu is above %llu",
                  (unsigned long long)number->u.integer, (unsigned long long)dev->mask);
    return -1;
}

static long fetchAcross(dbCommon *prec, const devRecord *dev, eipNumber *number)
{
    const devEip *own = eipOf(dev);
    const epicsUInt8 *place = dev->buffer;
    char reason[PLC_REASON_SIZE];
    const eipType *type;
    epicsUInt64 bits;

    if (devEipFetchPlace(prec, dev->buffer))
        return -1;
    type = eipTypeOf((unsigned)eipGetUnsigned(place, 2));
    if (!type || !type->size)
        return noValue(prec);
    if (lacks(dev, type, reason))
        return devEipUnshown(prec, reason);
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
    char reason[PLC_REASON_SIZE];
    const eipType *type;
    epicsUInt64 bits;

    if (dev && eipOf(dev)->across)
        return fetchAcross(prec, dev, number);
    if (!dev || devFetch(prec, cell))
        return -1;
    if (plcImageRead(dev->image, eipOf(dev)->at, sizeof(cell), cell, NULL) ||
        (!cell[0] && !cell[1]))
        return noValue(prec);
    type = eipTypeOf((unsigned)eipGetUnsigned(cell, 2));
    if (!type || !type->size)
        return noValue(prec);
    bits = eipGetUnsigned(cell + eipPlaceHead, 8);
    number->kind = (eipKind)cell[eipPlaceKindAt];
    memcpy(&number->u, &bits, sizeof(bits));
    if (lacks(dev, type, reason) || partOf(dev, type, number, reason))
        return devEipUnshown(prec, reason);
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

    if (number->kind == eipUnsigned && number->u.integer < 0)
        return 0x7fffffffffffffffLL;
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
static int asTag(const eipType *type, const eipType *from, const eipNumber *number,
                 eipNumber *shown)
{
    char why[PLC_REASON_SIZE];
    epicsUInt8 raw[8];

    *shown = *number;
    if (!type || !type->size)
        return 0;
    if (from)
        return eipNumberAs(type, from, shown, why, sizeof(why));
    if (eipNumberPut(type, raw, number))
        return -1;
    eipNumberGet(type, raw, shown);
    return 0;
}

/* The part of a number whose bits are in the second element. Returns 0, or -1 with an alarm. */
static int storeSecond(dbCommon *prec, const devRecord *dev, epicsUInt64 value)
{
    devEip *own = eipOf(dev);
    epicsUInt8 bytes[8], mask[8];
    char reason[PLC_REASON_SIZE];

    eipSetUnsigned(bytes, 8, (value & own->across) >> (32 - own->shift));
    eipSetUnsigned(mask, 8, own->across >> (32 - own->shift));
    own->last.goesOn = dev->last.goesOn;
    own->last.tells = dev->takes != 0;
    if (plcStationPutBy(dev->station, &own->last, own->last.offset, 8, bytes, mask, reason, 1,
                        NULL) == 0)
        return 0;
    return (int)devEipRefuse(prec, "%s", reason);
}

/* More than the bits of the record. */
static int exceeds(const devRecord *dev, epicsUInt64 value)
{
    const devEip *own = eipOf(dev);

    return (value & ~(own->across ? own->across : dev->mask >> own->shift)) != 0;
}

/* Of bits in two elements one is not there, or not known: half of the value would be written. */
static int lacksHalf(const devRecord *dev, char reason[PLC_REASON_SIZE])
{
    const devEip *own = eipOf(dev);
    plcFaults *faults = plcStationInFaults(dev->station);
    epicsUInt8 first[2], second[2];

    if (!own->second)
        return 0;
    if (plcFaultsFind(faults, own->at, own->room, NULL, reason) ||
        plcFaultsFind(faults, eipPlaceOffset(own->second), eipCellSize, NULL, reason))
        return 1;
    if (plcImageRead(plcStationInput(dev->station), own->at, 2, first, NULL) ||
        plcImageRead(plcStationInput(dev->station), eipPlaceOffset(own->second), 2, second, NULL) ||
        (first[0] && second[0]))
        return 0; /* the PLC is away: its values come first; or both are there */
    epicsSnprintf(reason, PLC_REASON_SIZE, "%s", notRead);
    return 1;
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

/* Some bits of the tag. */
static long storeBits(dbCommon *prec, devRecord *dev, const eipType *type, const eipNumber *number)
{
    epicsUInt64 value = (epicsUInt64)devEipInteger(number);
    epicsUInt8 bytes[8], mask[DEV_SCALAR];
    char reason[PLC_REASON_SIZE];

    if ((type && type->size && lacks(dev, type, reason)) || lacksHalf(dev, reason))
        return devEipRefuse(prec, "%s", reason);
    if (exceeds(dev, value) || isnan(eipNumberReal(number)))
        return devEipRefuse(prec, noFit, "its bits");
    if (type && type->code == eipBool && value > 1)
        return devEipRefuse(prec, noFit, type->name);
    if (eipOf(dev)->second && storeSecond(prec, dev, value))
        return -1;
    eipSetUnsigned(bytes, 8, value << eipOf(dev)->shift & dev->mask);
    return devStore(prec, bytes, devMask(dev, mask));
}

long devEipStore(dbCommon *prec, const eipNumber *number)
{
    devRecord *dev = devOf(prec);
    const eipType *type;
    epicsUInt8 bytes[8];
    eipNumber shown;
    epicsUInt64 bits;

    if (!dev)
        return -1;
    eipOf(dev)->misfit[0] = 0;
    type = devEipType(dev);
    if (dev->mask)
        return storeBits(prec, dev, type, number);
    if (asTag(type, eipOf(dev)->holds, number, &shown))
        return devEipRefuse(prec, noFit, type->name);
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

long devEipStoreArray(dbCommon *prec, const void *array, size_t count)
{
    devRecord *dev = devOf(prec);
    const eipType *type, *from;
    epicsUInt8 *bytes, *at;
    size_t i;

    if (!dev)
        return -1;
    eipOf(dev)->misfit[0] = 0;
    from = eipOf(dev)->holds;
    type = devEipType(dev);
    if (!type || !type->size)
        type = from;
    if (count > eipOf(dev)->elements)
        count = eipOf(dev)->elements;
    bytes = dev->buffer; /* begins at eipPlaceKindAt */
    memset(bytes, 0, eipOf(dev)->room);
    bytes[0] = (epicsUInt8)type->kind;
    bytes[1] = (epicsUInt8)type->size;
    eipSetUnsigned(bytes + eipPlaceCountAt - eipPlaceKindAt, 4, count);
    at = bytes + eipPlaceHead - eipPlaceKindAt;
    for (i = 0; i < count; i++) {
        char why[PLC_REASON_SIZE];
        epicsUInt8 raw[8];
        eipNumber number;

        plcCopyElements(raw, (const epicsUInt8 *)array + i * from->size, from->size, 1,
                        plcLittleEndian);
        eipNumberGet(from, raw, &number);
        if (eipNumberAs(type, from, &number, why, sizeof(why)) ||
            eipNumberPut(type, at + i * type->size, &number))
            return devEipRefuse(prec, "an element does not fit %s", type->name);
    }
    return devStore(prec, bytes, NULL);
}

/* CHAR of a larger type, as ether_ip has it: any character, with sign or without. */
static const eipType *characterOf(const eipType *to, const eipNumber *number)
{
    return to->size == 1 && eipNumberReal(number) >= 0 ? eipTypeOf(eipUsint) : to;
}

int devEipElements(const devRecord *dev, const eipType *from, const epicsUInt8 *bytes, size_t count,
                   void *array, char reason[PLC_REASON_SIZE])
{
    const eipType *holds = eipOf(dev)->holds, *to;
    size_t i;

    for (i = 0; i < count; i++) {
        epicsUInt8 raw[8];
        eipNumber number;

        eipNumberGet(from, bytes + i * from->size, &number);
        to = characterOf(holds, &number);
        if (eipNumberAs(to, from, &number, reason, PLC_REASON_SIZE) ||
            eipNumberPut(to, raw, &number))
            return -1;
        if (array)
            plcCopyElements((epicsUInt8 *)array + i * to->size, raw, to->size, 1,
                            plcLittleEndian);
    }
    return 0;
}

void devEipShown(const devRecord *dev, const epicsUInt8 *bytes, eipNumber *number)
{
    devEip *own = eipOf(dev);
    const eipType *type = devEipType(dev);
    epicsUInt64 bits = eipGetUnsigned(bytes, 8);
    epicsUInt8 kind = 0;

    plcImagePeek(dev->image, own->at + eipPlaceKindAt, 1, &kind);
    if (!type || !type->size)
        type = eipTypeNamed(kind == eipReal ? "LREAL" : kind == eipUnsigned ? "ULINT" : "LINT");
    number->kind = type->kind;
    memcpy(&number->u, &bits, sizeof(bits));
    own->misfit[0] = 0;
    partOf(dev, type, number, own->misfit);
    if (own->second)
        number->u.integer |= (epicsInt64)shownSecond(dev);
}

const char devEipNan[] = "NaN is no whole number";

int devEipIsNan(const devRecord *dev, const eipNumber *number)
{
    if (!isnan(eipNumberReal(number)))
        return 0;
    strcpy(eipOf(dev)->misfit, devEipNan);
    return 1;
}

int devEipLacks(const devRecord *dev, char reason[PLC_REASON_SIZE])
{
    const eipType *type = devEipType(dev);

    if (type && type->size && lacks(dev, type, reason))
        return 1;
    strcpy(reason, eipOf(dev)->misfit);
    return reason[0] != 0;
}

/* The part of a put that lies in the second element was refused. Returns -1 then, else `status`. */
static long secondRefused(dbCommon *prec, const devRecord *dev, long status)
{
    const devEip *own = eipOf(dev);
    char reason[PLC_REASON_SIZE];

    if (!own->second || !plcImageWhyNot(dev->image, &own->last, reason))
        return status;
    recGblSetSevrMsg(prec, WRITE_ALARM, INVALID_ALARM, "%s", reason);
    return -1;
}

/* The PLC does not show this place: there is nothing to follow, and what it shows next is news. */
static long notShown(dbCommon *prec, devRecord *dev)
{
    const eipType *type = devEipType(dev);

    if (type && type->size) /* why, also while the PLC is away */
        lacks(dev, type, eipOf(dev)->misfit);
    dev->following = dev->known = 0;
    prec->udf = TRUE;
    return devRefused(prec, dev) || devUnseen(prec, dev) ? -1 : noValue(prec);
}

/* FORCE: what the PLC shows is no reason to follow, once the record has a value of its own. */
static int isForced(const devRecord *dev)
{
    return eipOf(dev)->force && eipOf(dev)->forced;
}

/* What the PLC shows of it is a value for the record, or nearly one. */
static int isShown(const devRecord *dev)
{
    const eipType *type = devEipType(dev);
    char reason[PLC_REASON_SIZE];

    return type && !(type->size && lacks(dev, type, reason)) && !lacksHalf(dev, reason);
}

int devEipFollows(const dbCommon *prec)
{
    const devRecord *dev = prec->dpvt;

    return isShown(dev) && !isForced(dev);
}

/* Reads of its period until now; 0: none yet. */
static epicsUInt64 turnsOf(const devEip *own)
{
    eipTimes times;

    return eipWorkerTimes(own->plc->worker, own->period, &times) ? 0 : times.turns;
}

int devEipRests(const dbCommon *prec)
{
    const devRecord *dev = prec->dpvt;
    const devEip *own = eipOf(dev);
    char reason[PLC_REASON_SIZE];

    return isForced(dev) && own->turns == turnsOf(own) &&
           (plcImageWhyNot(dev->image, &dev->last, reason) ||
            (own->second && plcImageWhyNot(dev->image, &own->last, reason)));
}

/* FORCE: its value again. What was refused stays so until the PLC has taken it. */
static long writeAgain(dbCommon *prec, devRecord *dev)
{
    devEip *own = eipOf(dev);
    long status;

    dev->following = 0;
    dev->last.goesOn = 0;
    dev->last.again = own->last.again = 1;
    status = devSupportOf(prec)->write(prec);
    dev->last.again = own->last.again = 0;
    dev->mark.number = 0; /* nobody waits for it */
    if (!status)
        status = devRefused(prec, dev);
    return secondRefused(prec, dev, status);
}

long devEipWrite(dbCommon *prec)
{
    devRecord *dev = prec->dpvt;
    int follows = dev && dev->following, ends = prec->pact;
    long status;

    if (!dev || !dev->station)
        return devWrite(prec);
    devStampNow(prec);
    if (follows && !isShown(dev))
        return notShown(prec, dev);
    if (eipOf(dev)->force && !ends)
        eipOf(dev)->turns = turnsOf(eipOf(dev)); /* first: a read that ends now may be older */
    if (follows && isForced(dev))
        return writeAgain(prec, dev);
    if (!follows)
        eipOf(dev)->forced = 1;
    status = devWrite(prec);
    if (follows && eipOf(dev)->misfit[0])
        return devUnseen(prec, dev);
    return prec->pact && !ends ? status : secondRefused(prec, dev, status);
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
