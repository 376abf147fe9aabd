/* Device support "EtherIP", the part that is the same for every record type; see devEip.h. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <aaiRecord.h>
#include <aaoRecord.h>
#include <alarm.h>
#include <cantProceed.h>
#include <dbAccess.h>
#include <dbScan.h>
#include <dbStaticLib.h>
#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <epicsString.h>
#include <errlog.h>
#include <lsiRecord.h>
#include <lsoRecord.h>
#include <mbbiDirectRecord.h>
#include <mbbiRecord.h>
#include <mbboDirectRecord.h>
#include <mbboRecord.h>
#include <waveformRecord.h>

#include "plcCompat.h"
#include "devEip.h"
#include "drvEtherIP.h"

enum {
    defaultPeriod = 1000, /* ms */
    stringMax = 40        /* bytes of VAL of stringin and stringout */
};

static const plcType *wide; /* 8 bytes, as a cell has them */

/* --- From the link to a place ----------------------------------------------------------------- */

static const devSupport *supportOf(const dbCommon *prec)
{
    return (const devSupport *)prec->dset;
}

/* The period of a SCAN in seconds, from its text: ".5 second", "10 Hz"; 0: it has none. Base
 * itself knows it only when records are initialised. */
static double scanSeconds(int scan)
{
    static const struct {
        const char *unit;
        double seconds;
    } units[] = {{"second", 1}, {"minute", 60}, {"hour", 3600}};
    const dbMenu *menu = dbFindMenu(pdbbase, "menuScan");
    const char *text;
    double number;
    char *unit;
    size_t i;

    if (!menu || scan < SCAN_1ST_PERIODIC || scan >= menu->nChoice)
        return 0;
    text = menu->papChoiceValue[scan];
    number = epicsStrtod(text, &unit);
    unit += strspn(unit, " ");
    if (!(number > 0))
        return 0;
    for (i = 0; i < sizeof(units) / sizeof(units[0]); i++)
        if (epicsStrnCaseCmp(unit, units[i].unit, strlen(units[i].unit)) == 0)
            return number * units[i].seconds;
    return epicsStrnCaseCmp(unit, "H", 1) == 0 ? 1 / number : number;
}

/* S wins, then a periodic SCAN, then the default. */
static unsigned periodOf(dbCommon *prec, const eipLink *link)
{
    double seconds = link->period;

    if (!(seconds > 0))
        seconds = scanSeconds(prec->scan);
    if (!(seconds > 0))
        seconds = drvEtherIP_default_rate;
    if (!(seconds > 0)) {
        if (!link->statistic)
            devWarn(prec, "no period: S seconds in the link, SCAN or drvEtherIP_default_rate "
                    "would say one; 1 s is taken");
        return defaultPeriod;
    }
    return seconds < 0.001 ? 1 : seconds > 4e6 ? 4000000000u : (unsigned)(seconds * 1000 + 0.5);
}

static void forget(devRecord *dev)
{
    devEip *own = eipOf(dev);

    if (own->second)
        eipPlacesLeave(own->plc->places, own->second, own->period, own->output);
    if (own->place) {
        eipPlacesLeave(own->plc->places, own->place, own->period, own->output);
        eipPlcWantsChanged(own->plc);
    }
    free(own);
    dev->own = NULL;
}

/* Parses the text and finds the PLC. Returns 0 or -1 with *error. */
static int begin(dbCommon *prec, devRecord *dev, const char *text, eipLink *link,
                 plcLinkError *error)
{
    devEip *own;

    if (eipLinkParse(text, link, &error->column, error->text, sizeof(error->text)))
        return -1;
    if (devFindStation(dev, link->plc, error))
        return -1;
    if (!eipPlcFind(link->plc))
        return devFail(error, 0,
                       "%.40s is no PLC with tags; drvEtherIP_define_PLC or etheripConfigure "
                       "makes one", link->plc);
    if (link->statistic && strcmp(supportOf(prec)->shape.recordType, "ai"))
        return devFail(error, 0, "a statistic; allowed: with ai only");
    if (link->force && supportOf(prec)->direction != devOut)
        link->force = 0;
    own = callocMustSucceed(1, sizeof(*own), "EtherIP");
    own->plc = eipPlcFind(link->plc);
    own->period = periodOf(prec, link);
    own->force = link->force;
    own->statistic = link->statistic;
    dev->own = own;
    dev->forget = forget;
    if (!wide)
        wide = plcTypeOf(plcUnsigned, 8);
    return 0;
}

/* Gives the record the place of this wish; `skip` bytes at its head are no value. */
static int take(dbCommon *prec, devRecord *dev, const eipLink *link, const eipWant *wish,
                size_t skip, plcLinkError *error)
{
    int out = supportOf(prec)->direction == devOut;
    devEip *own = eipOf(dev);

    own->output = out;
    own->place = eipPlacesGet(own->plc->places, wish, own->period, out);
    if (!own->place)
        return devFail(error, strlen(link->plc) + 1,
                       "the image of %.40s is full: %lu bytes; allowed: more by "
                       "etheripConfigure image=bytes or drvEtherIP_image_size before it",
                       link->plc, (unsigned long)plcStationInSize(dev->station));
    own->at = eipPlaceOffset(own->place);
    own->room = eipPlaceRoom(own->place);
    dev->image = out ? plcStationOutput(dev->station) : plcStationInput(dev->station);
    dev->faults = out ? plcStationOutFaults(dev->station) : plcStationInFaults(dev->station);
    dev->type = wish->kind == eipCell ? wide : plcTypeOf(plcUnsigned, 1);
    dev->order = plcLittleEndian;
    dev->offset = own->at + skip;
    dev->length = own->room - skip;
    if (wish->kind != eipCell)
        dev->buffer = callocMustSucceed(1, own->room, "EtherIP");
    eipPlcWantsChanged(own->plc);
    return 0;
}

static eipWant wishOf(eipLink *link, eipPlaceKind kind)
{
    eipWant wish = {.tag = link->tag, .index = link->index, .count = 1,
                    .alone = link->alone, .kind = kind, .indexed = link->indexed};

    return wish;
}

/* `bits` of the element, 0: all. An index that counts bits becomes one of elements. */
static int takeCell(dbCommon *prec, devRecord *dev, eipLink *link, unsigned bits,
                    plcLinkError *error)
{
    eipWant wish;
    devEip *own = eipOf(dev);

    if (link->bit >= 0 && !bits)
        bits = 1;
    if (link->bit < 0 && link->hasIndex && bits && !link->alone) {
        link->bit = (int)(link->index & 31);
        link->index >>= 5;
    }
    if (link->bit >= 0 && link->bit + bits > 64)
        return devFail(error, 0, "bits %d to %u; allowed: up to 63", link->bit,
                       (unsigned)link->bit + bits - 1);
    wish = wishOf(link, eipCell);
    if (take(prec, dev, link, &wish, eipPlaceHead, error))
        return -1;
    if (link->bit >= 0) {
        own->shift = (unsigned)link->bit;
        dev->mask = (bits >= 64 ? ~(epicsUInt64)0 : ((epicsUInt64)1 << bits) - 1)
                    << own->shift;
    } else if (bits > 1) {
        dev->mask = ((epicsUInt64)1 << bits) - 1;
    }
    return 0;
}

int devEipNumber(dbCommon *prec, devRecord *dev, const char *text, plcLinkError *error)
{
    eipLink link;

    if (begin(prec, dev, text, &link, error))
        return -1;
    if (link.statistic) {
        dev->image = plcStationInput(dev->station);
        return 0;
    }
    return takeCell(prec, dev, &link, 0, error);
}

int devEipBit(dbCommon *prec, devRecord *dev, const char *text, plcLinkError *error)
{
    eipLink link;

    if (begin(prec, dev, text, &link, error))
        return -1;
    return takeCell(prec, dev, &link, 1, error);
}

/* NOBT of the multibit records; SHFT is 0 from now on: the bit is in the link. */
static unsigned nobtOf(dbCommon *prec)
{
    const char *type = supportOf(prec)->shape.recordType;

    if (strcmp(type, "mbbi") == 0) {
        ((mbbiRecord *)prec)->shft = 0;
        return ((mbbiRecord *)prec)->nobt;
    }
    if (strcmp(type, "mbbo") == 0) {
        ((mbboRecord *)prec)->shft = 0;
        return ((mbboRecord *)prec)->nobt;
    }
    if (strcmp(type, "mbbiDirect") == 0) {
        ((mbbiDirectRecord *)prec)->shft = 0;
        return (unsigned)((mbbiDirectRecord *)prec)->nobt;
    }
    ((mbboDirectRecord *)prec)->shft = 0;
    return (unsigned)((mbboDirectRecord *)prec)->nobt;
}

/* Outputs whose bits lie in two elements: a cell for each. */
static int takeTwo(dbCommon *prec, devRecord *dev, eipLink *link, plcLinkError *error)
{
    devEip *own = eipOf(dev);
    eipWant wish = wishOf(link, eipCell);

    if (take(prec, dev, link, &wish, eipPlaceHead, error))
        return -1;
    dev->mask = own->across << own->shift & 0xffffffffu;
    wish.index++;
    own->second = eipPlacesGet(own->plc->places, &wish, own->period, 1);
    return own->second ? 0 : devFail(error, 0, "the image of %.40s is full", link->plc);
}

/* Bits that begin in one element and end in the next: for inputs, as an array of two. */
static int takeAcross(dbCommon *prec, devRecord *dev, eipLink *link, unsigned nobt,
                      plcLinkError *error)
{
    devEip *own = eipOf(dev);
    eipWant wish;

    own->shift = link->index & 31;
    own->across = ((epicsUInt64)1 << nobt) - 1;
    link->index >>= 5;
    if (supportOf(prec)->direction == devOut)
        return takeTwo(prec, dev, link, error);
    wish = wishOf(link, eipArrayPlace);
    wish.count = own->elements = 2;
    return take(prec, dev, link, &wish, eipPlaceKindAt, error);
}

int devEipBits(dbCommon *prec, devRecord *dev, const char *text, plcLinkError *error)
{
    unsigned nobt = nobtOf(prec);
    eipLink link;

    if (begin(prec, dev, text, &link, error))
        return -1;
    if (nobt > 32)
        return devFail(error, 0, "NOBT is %u; allowed: 0 (all) to 32", nobt);
    if (link.bit < 0 && link.hasIndex && !link.alone && (link.index & 31) + nobt > 32)
        return takeAcross(prec, dev, &link, nobt, error);
    if (nobt == 0 && (link.bit >= 0 || (link.hasIndex && !link.alone)))
        nobt = 1; /* a single bit is meant */
    if (takeCell(prec, dev, &link, nobt, error))
        return -1;
    if (!dev->mask && nobt == 1)
        dev->mask = 1; /* NOBT is 1: of the whole number, bit 0 */
    return 0;
}

static size_t textRoom(dbCommon *prec)
{
    const char *type = supportOf(prec)->shape.recordType;

    if (strcmp(type, "lsi") == 0)
        return ((lsiRecord *)prec)->sizv;
    if (strcmp(type, "lso") == 0)
        return ((lsoRecord *)prec)->sizv;
    return stringMax;
}

int devEipText(dbCommon *prec, devRecord *dev, const char *text, plcLinkError *error)
{
    eipLink link;
    eipWant wish;

    if (begin(prec, dev, text, &link, error))
        return -1;
    if (link.bit >= 0)
        return devFail(error, 0, "a string has no bits; allowed: a tag without .bit and B");
    wish = wishOf(&link, eipTextPlace);
    wish.room = eipPlaceHead + textRoom(prec);
    return take(prec, dev, &link, &wish, eipPlaceCountAt, error);
}

int devEipArray(dbCommon *prec, devRecord *dev, const char *text, plcLinkError *error)
{
    const char *type = supportOf(prec)->shape.recordType;
    eipLink link;
    eipWant wish;

    if (begin(prec, dev, text, &link, error))
        return -1;
    if (link.bit >= 0 || (link.alone && type[0] == 'w'))
        return devFail(error, 0, "an array is read as it is; allowed: a tag without B and E");
    wish = wishOf(&link, eipArrayPlace);
    wish.count = type[0] == 'w'   ? ((waveformRecord *)prec)->nelm
                 : type[2] == 'i' ? ((aaiRecord *)prec)->nelm
                                  : ((aaoRecord *)prec)->nelm;
    if (wish.count == 0 || wish.count > 65535)
        return devFail(error, 0, "NELM is %u; allowed: 1 to 65535", wish.count);
    eipOf(dev)->elements = wish.count;
    return take(prec, dev, &link, &wish, eipPlaceKindAt, error);
}

/* --- Reading ----------------------------------------------------------------------------------- */

static long noValue(dbCommon *prec)
{
    recGblSetSevrMsg(prec, READ_ALARM, INVALID_ALARM, "the tag has not been read yet");
    return -1;
}

static long fetchAcross(dbCommon *prec, const devRecord *dev, eipNumber *number)
{
    const devEip *own = eipOf(dev);
    const epicsUInt8 *place = dev->buffer;
    const eipType *type;
    epicsUInt64 bits;

    if (devEipFetchPlace(prec, dev->buffer))
        return -1;
    type = eipTypeOf((unsigned)eipGetUnsigned(place, 2));
    if (!type || !type->size || type->size > 4)
        return noValue(prec);
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
    plcFaults *faults = plcStationInFaults(dev->station);
    char reason[PLC_REASON_SIZE];

    dev->following = 0;
    prec->udf = TRUE;
    if (!faults || !plcFaultsFind(faults, eipOf(dev)->at, eipOf(dev)->room, NULL, reason))
        return noValue(prec);
    recGblSetSevrMsg(prec, READ_ALARM, INVALID_ALARM, "%s", reason);
    return -1;
}

/* FORCE: what the PLC shows is no reason to follow, once the record has a value of its own. */
long devEipWrite(dbCommon *prec)
{
    devRecord *dev = prec->dpvt;

    if (dev && dev->station && dev->following && !devEipType(dev))
        return notShown(prec, dev);
    if (dev && dev->station && dev->following && eipOf(dev)->force &&
        eipOf(dev)->forced) {
        long status;

        dev->following = 0;
        status = supportOf(prec)->write(prec);
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
