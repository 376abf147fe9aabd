/* Device support "EtherIP": from a link to the place of its tag in the images; see devEip.h. */
#include <stdlib.h>
#include <string.h>

#include <aaiRecord.h>
#include <aaoRecord.h>
#include <cantProceed.h>
#include <dbAccess.h>
#include <dbScan.h>
#include <dbStaticLib.h>
#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <epicsString.h>
#include <lsiRecord.h>
#include <lsoRecord.h>
#include <mbbiDirectRecord.h>
#include <mbbiRecord.h>
#include <mbboDirectRecord.h>
#include <mbboRecord.h>
#include <menuFtype.h>
#include <waveformRecord.h>

#include "plcCompat.h"
#include "devEip.h"
#include "drvEtherIP.h"

enum {
    defaultPeriod = 1000, /* ms */
    stringMax = 40        /* bytes of VAL of stringin and stringout */
};

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

/* S wins, then a periodic SCAN, then the default; 0: none. */
static double secondsOf(const dbCommon *prec, const eipLink *link)
{
    double seconds = link->period;

    if (!(seconds > 0))
        seconds = scanSeconds(prec->scan);
    return seconds > 0 ? seconds : drvEtherIP_default_rate;
}

static unsigned periodOf(const dbCommon *prec, const eipLink *link)
{
    double seconds = secondsOf(prec, link);

    if (!(seconds > 0))
        return defaultPeriod;
    return seconds < 0.001 ? 1 : seconds > 4e6 ? 4000000000u : (unsigned)(seconds * 1000 + 0.5);
}

/* What is odd in a link that is taken; one that is refused has its line already. */
static void tellDoubts(dbCommon *prec, const eipLink *link)
{
    const struct link *text = dbGetDevLink(prec);

    if (link->doubt[0])
        devWarn(prec, "%s: @%.80s", link->doubt, text->value.instio.string);
    if (!link->statistic && !(secondsOf(prec, link) > 0))
        devWarn(prec, "no period: S seconds in the link, SCAN or drvEtherIP_default_rate "
                "would say one; 1 s is taken");
}

/* The PLC refuses to show the tag of an output, or the second of two. */
static int isUnseen(const devRecord *dev, char reason[PLC_REASON_SIZE])
{
    const devEip *own = eipOf(dev);
    plcFaults *faults = plcStationInFaults(dev->station);

    return own->place &&
           (plcFaultsFind(faults, own->at, own->room, NULL, reason) ||
            (own->second && plcFaultsFind(faults, eipPlaceOffset(own->second), eipCellSize, NULL,
                                          reason)) ||
            devEipLacks(dev, reason));
}

static void forget(devRecord *dev)
{
    devEip *own = eipOf(dev);

    if (own->last.bytes)
        plcImageAskNot(dev->image, &own->last);
    free(own->last.bytes);
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
        return plcLinkFail(error, 0,
                           "%.40s is no PLC with tags; drvEtherIP_define_PLC or etheripConfigure "
                           "makes one. Here DTYP \"S7plc\" is needed, as in @%.40s/0", link->plc, link->plc);
    if (link->statistic && strcmp(supportOf(prec)->shape.recordType, "ai"))
        return plcLinkFail(error, 0, "%s is for ai only; allowed here: E, S seconds, B bit, FORCE",
                           eipStatisticWord(link->statistic));
    if (link->force && supportOf(prec)->direction != devOut) {
        epicsSnprintf(link->doubt, sizeof(link->doubt), "FORCE means nothing to an input");
        link->force = 0;
    }
    own = callocMustSucceed(1, sizeof(*own), "EtherIP");
    own->plc = eipPlcFind(link->plc);
    own->period = periodOf(prec, link);
    own->force = link->force;
    own->statistic = link->statistic;
    dev->own = own;
    dev->forget = forget;
    dev->unseen = isUnseen;
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
        return plcLinkFail(error, strlen(link->plc) + 1,
                           "the image of %.40s is full: %lu bytes; allowed: more by "
                           "etheripConfigure image=bytes or drvEtherIP_image_size before it",
                           link->plc, (unsigned long)plcStationInSize(dev->station));
    own->at = eipPlaceOffset(own->place);
    own->room = eipPlaceRoom(own->place);
    dev->image = out ? plcStationOutput(dev->station) : plcStationInput(dev->station);
    dev->faults = out ? plcStationOutFaults(dev->station) : plcStationInFaults(dev->station);
    dev->type = plcTypeOf(plcUnsigned, wish->kind == eipCell ? 8 : 1);
    dev->order = plcLittleEndian;
    dev->offset = own->at + skip;
    dev->length = own->room - skip;
    dev->head = skip;
    if (wish->kind != eipCell)
        dev->buffer = callocMustSucceed(1, own->room, "EtherIP");
    eipPlcWantsChanged(own->plc);
    tellDoubts(prec, link);
    return 0;
}

static eipWant wishOf(eipLink *link, eipPlaceKind kind)
{
    eipWant wish = {.tag = link->tag, .index = link->index, .count = 1,
                    .alone = link->alone, .kind = kind, .indexed = link->indexed,
                    .element = link->hasIndex};

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
    own->ofNumber = link->bit < 0;
    if (link->bit < 0 && link->hasIndex && bits && !link->alone) {
        own->ofNumber = 0;
        own->counted = link->index > 0;
        link->bit = (int)(link->index & 31);
        link->index >>= 5;
    }
    if (link->bit >= 0 && link->bit + bits > 64)
        return plcLinkFail(error, 0, "bits %d to %u; allowed: up to 63", link->bit,
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

/* What VAL of this record type can have; NULL: any number. */
static const eipType *numberOf(const char *recordType)
{
    if (strncmp(recordType, "long", 4) == 0)
        return eipTypeNamed("DINT");
    return strncmp(recordType, "int64", 5) == 0 ? eipTypeNamed("LINT") : NULL;
}

/* What an element of this FTVL can have. */
static const eipType *elementOf(int ftvl)
{
    static const char *const names[] = {
        [menuFtypeCHAR] = "SINT",  [menuFtypeUCHAR] = "USINT",  [menuFtypeSHORT] = "INT",
        [menuFtypeUSHORT] = "UINT", [menuFtypeLONG] = "DINT",   [menuFtypeULONG] = "UDINT",
        [menuFtypeINT64] = "LINT", [menuFtypeUINT64] = "ULINT", [menuFtypeFLOAT] = "REAL",
        [menuFtypeDOUBLE] = "LREAL", [menuFtypeENUM] = "UINT"};

    return eipTypeNamed(names[ftvl]);
}

int devEipNumber(dbCommon *prec, devRecord *dev, const char *text, plcLinkError *error)
{
    eipLink link;

    if (begin(prec, dev, text, &link, error))
        return -1;
    if (link.statistic) {
        dev->image = plcStationInput(dev->station);
        tellDoubts(prec, &link);
        return 0;
    }
    eipOf(dev)->holds = numberOf(supportOf(prec)->shape.recordType);
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
    epicsUInt8 bits[8];

    if (take(prec, dev, link, &wish, eipPlaceHead, error))
        return -1;
    dev->mask = own->across << own->shift & 0xffffffffu;
    wish.index++;
    own->second = eipPlacesGet(own->plc->places, &wish, own->period, 1);
    if (!own->second)
        return plcLinkFail(error, 0, "the image of %.40s is full", link->plc);
    eipSetUnsigned(bits, 8, own->across >> (32 - own->shift));
    devAsk(dev, &own->last, eipPlaceOffset(own->second) + eipPlaceHead, 8, bits);
    return 0;
}

/* Bits that begin in one element, at link->bit, and end in the next: for inputs, as an array of
 * two. */
static int takeAcross(dbCommon *prec, devRecord *dev, eipLink *link, unsigned nobt,
                      plcLinkError *error)
{
    devEip *own = eipOf(dev);
    eipWant wish;

    own->shift = (unsigned)link->bit;
    own->across = ((epicsUInt64)1 << nobt) - 1;
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
    eipOf(dev)->holds = eipTypeOf(eipDword);
    if (nobt > 32)
        return plcLinkFail(error, 0, "NOBT is %u; allowed: 0 (all) to 32", nobt);
    if (link.hasIndex && !link.alone) {
        unsigned bit = link.bit < 0 ? link.index & 31 : (unsigned)link.bit;

        if (bit < 32 && bit + nobt > 32) {
            if (link.bit < 0)
                link.index >>= 5;
            link.bit = (int)bit;
            return takeAcross(prec, dev, &link, nobt, error);
        }
    }
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
        return plcLinkFail(error, 0, "a string has no bits; allowed: a tag without .bit and B");
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
    if (link.bit >= 0)
        return plcLinkFail(error, 0, "%s has no bit %d; allowed: a tag without .bit and B", type,
                           link.bit);
    if (link.alone && type[0] == 'w')
        return plcLinkFail(error, 0, "E is not for a waveform; allowed: a tag without E");
    wish = wishOf(&link, eipArrayPlace);
    wish.count = type[0] == 'w'   ? ((waveformRecord *)prec)->nelm
                 : type[2] == 'i' ? ((aaiRecord *)prec)->nelm
                                  : ((aaoRecord *)prec)->nelm;
    if (wish.count == 0 || wish.count > 65535)
        return plcLinkFail(error, 0, "NELM %u is too large; allowed: 1 to 65535", wish.count);
    eipOf(dev)->elements = wish.count;
    eipOf(dev)->holds = elementOf(type[0] == 'w'   ? ((waveformRecord *)prec)->ftvl
                                  : type[2] == 'i' ? ((aaiRecord *)prec)->ftvl
                                                   : ((aaoRecord *)prec)->ftvl);
    return take(prec, dev, &link, &wish, eipPlaceKindAt, error);
}
