/* Device support "S7plc", the part that is the same for every record type: from the link
 * to a place in an image, what Base calls, and links that change at run time.
 *
 * Knows no record type: their fields are in devS7plcIn.c, devS7plcOut.c, devS7plcArray.c.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <alarm.h>
#include <cantProceed.h>
#include <dbAccess.h>
#include <dbDefs.h>
#include <dbEvent.h>
#include <dbLink.h>
#include <dbScan.h>
#include <epicsStdio.h>
#include <epicsString.h>
#include <epicsThread.h>
#include <epicsTime.h>
#include <errlog.h>
#include <link.h>
#include <menuConvert.h>

#include "plcCompat.h"
#include "devS7plc.h"
#include "plcHot.h"

#define QUOTE_MAX 70  /* characters of a link that a message shows */
#define QUOTE_LEAD 40 /* of them before the place of the error, in a long link */

static int running;         /* 1 after iocInit: add_record means a link that changed */
static IOSCANPVT neverScan; /* I/O Intr of records whose link was refused */

/* --- Messages ----------------------------------------------------------------------- */

/* Says what is wrong, then the link and a caret under the place. Of a long link only
 * the surroundings of the place are shown. */
static void printRefusal(dbCommon *prec, const char *text, const plcLinkError *error)
{
    const devSupport *support = devSupportOf(prec);
    size_t length = strlen(text);
    size_t column = error->column < length ? error->column : length;
    size_t from = length > QUOTE_MAX && column > QUOTE_LEAD ? column - QUOTE_LEAD : 0;
    const char *head = from ? "..." : "@";
    const char *tail = length - from > QUOTE_MAX ? "..." : "";

    errlogPrintf("%s %s \"%s\" %s: %s\n    %s%.*s%s\n    %*s\n", support->dtyp,
                 support->shape.recordType, prec->name, support->field, error->text, head,
                 QUOTE_MAX, text + from, tail, (int)(strlen(head) + column - from + 1),
                 "^");
}

/* The message without what is allowed, in whole words: it must fit into AMSG. */
static char *shortReason(const plcLinkError *error)
{
    char reason[PLC_REASON_SIZE];
    size_t length = strcspn(error->text, ";");

    if (length >= sizeof(reason)) {
        length = sizeof(reason) - 1;
        while (length > sizeof(reason) / 2 && error->text[length] != ' ')
            length--;
    }
    memcpy(reason, error->text, length);
    reason[length] = 0;
    return epicsStrDup(reason);
}

/* --- From the link to a place in a block -------------------------------------------- */

int devFindStation(devRecord *dev, const char *name, plcLinkError *error)
{
    char names[200];

    dev->station = plcStationFind(name);
    if (dev->station)
        return 0;
    plcStationNames(names, sizeof(names));
    return plcLinkFail(error, 0, "no PLC \"%.40s\"; configured: %s", name,
                       names[0] ? names : "none (s7plcConfigure comes before iocInit)");
}

/* Refuses a value that does not lie in the block, "in" or "out". */
static int checkPlace(size_t offset, size_t length, size_t size, const char *block,
                      size_t column, plcLinkError *error)
{
    if (offset <= size && length <= size - offset)
        return 0;
    if (size == 0)
        return plcLinkFail(error, column, "the PLC has no %sput block; %sSize is 0", block,
                           block);
    return plcLinkFail(error, column, "%lu + %lu bytes exceed the %sput block; %sSize is %lu",
                       (unsigned long)offset, (unsigned long)length, block, block,
                       (unsigned long)size);
}

/* The bytes of a string: not more than the record has room for. An S7STRING is as long as
 * the PLC has it, whatever the record holds of it. Returns 0 or -1. */
static int stringLength(dbCommon *prec, devRecord *dev, const plcLink *link, size_t room,
                        plcLinkError *error)
{
    size_t bytes = plcTextBytes(dev->order, room);

    if (link->type->kind == plcS7String) {
        if (link->has & plcHasL && link->low > (epicsInt64)room)
            devWarn(prec, "the record holds %lu of the %lld characters",
                    (unsigned long)room, (long long)link->low);
        dev->length = plcTextBytes(dev->order, (size_t)link->low + PLC_S7STRING_HEAD);
    } else if (link->has & plcHasL && link->low > (epicsInt64)bytes) {
        bytes -= bytes % plcTextUnit(dev->order);
        devWarn(prec, "L=%lld is more than the record holds: reduced to %lu",
                (long long)link->low, (unsigned long)bytes);
        dev->length = bytes;
    } else {
        dev->length = link->has & plcHasL ? (size_t)link->low : bytes;
    }
    return plcLinkTextLength(link, dev->order, &dev->length, error);
}

/* Where the PLC shows this output: R=, or the station's mirror of the whole block. */
static int placeReadback(devRecord *dev, const plcLink *link, plcLinkError *error)
{
    long mirror = plcStationMirror(dev->station);

    if (mirror < 0)
        return 0;
    if (link->has & plcHasR && link->readback != mirror + dev->offset)
        return plcLinkFail(error, link->column.R,
                           "the PLC's option readback=%ld shows this "
                           "place at %ld; leave R= out",
                           mirror, mirror + (long)dev->offset);
    dev->has |= plcHasR;
    dev->readback = mirror + dev->offset;
    return 0;
}

/* Values that have names have no offsets. */
static int checkOffsets(const devRecord *dev, const plcLink *link, plcLinkError *error)
{
    const char *wire = plcStationByName(dev->station);

    return wire ? plcLinkFail(error, link->column.offset,
                              "a PLC by %s has tags, no offsets; needed: %s", wire,
                              plcStationNameForm(dev->station))
                : 0;
}

/* Refuses a value for which the transport has no place there, or not as a whole. */
static int checkHeld(const devRecord *dev, int out, size_t offset, size_t column,
                     plcLinkError *error)
{
    epicsUInt8 bits[DEV_SCALAR];
    char why[400];
    size_t fits;

    if (!plcStationHolds(dev->station, out, offset, dev->length, devMask(dev, bits), &fits, why,
                         sizeof(why)))
        return plcLinkFail(error, column, "%s", why);
    if (why[0])
        devWarn(dev->prec, "%s: %s", devSupportOf(dev->prec)->field, why);
    return 0;
}

/* Fills dev from the completed link. */
static int place(dbCommon *prec, devRecord *dev, const plcLink *link, size_t room,
                 plcLinkError *error)
{
    const devSupport *support = devSupportOf(prec);
    int out = support->direction == devOut;

    if (checkOffsets(dev, link, error))
        return -1;
    dev->image = out ? plcStationOutput(dev->station) : plcStationInput(dev->station);
    dev->faults = out ? plcStationOutFaults(dev->station) : plcStationInFaults(dev->station);
    dev->type = link->type;
    dev->order = plcLinkOrder(link, plcStationOrder(dev->station),
                              plcStationTextOrder(dev->station));
    dev->offset = link->offset;
    dev->length = link->type->size;
    if (link->type->kind & plcText && stringLength(prec, dev, link, room, error))
        return -1;
    dev->has = link->has;
    dev->readback = link->readback;
    dev->low = link->low;
    dev->high = link->high;
    if (support->prepare && support->prepare(prec, dev, link, error))
        return -1;
    if (checkPlace(dev->offset, dev->length, plcImageSize(dev->image), out ? "out" : "in",
                   link->column.offset, error) ||
        checkHeld(dev, out, dev->offset, link->column.offset, error))
        return -1;
    if (link->has & plcHasR &&
        (checkPlace(link->readback, dev->length, plcStationInSize(dev->station), "in",
                    link->column.R, error) ||
         checkHeld(dev, 0, link->readback, link->column.R, error)))
        return -1;
    if (dev->buffered)
        dev->buffer = callocMustSucceed(1, dev->length, "S7plc buffer");
    if (out && dev->offset < plcStationHeader(dev->station))
        return plcLinkFail(error, link->column.offset,
                           "bytes 0 to %u are the header of the "
                           "sync handshake; allowed: %u and up",
                           (unsigned)plcStationHeader(dev->station) - 1,
                           (unsigned)plcStationHeader(dev->station));
    if (!out)
        return 0;
    if (placeReadback(dev, link, error))
        return -1;
    if (plcStationHeader(dev->station) && !(dev->has & plcHasR))
        devWarn(prec, "with sync=on the PLC must show this output, unless it is a command that the "
                "PLC does not compare: add R=offset, or set the PLC's option readback");
    return 0;
}

/* A link that is accepted, but looks like a mistake. */
static void warn(dbCommon *prec, const plcLinkError *doubt)
{
    if (doubt->text[0])
        devWarn(prec, "%s: %s", devSupportOf(prec)->field, doubt->text);
}

/* A link to a PLC whose values have names is told so, whatever else is wrong with it. */
static int parse(devRecord *dev, const char *text, plcLink *link, plcLinkError *error)
{
    size_t column;

    if (plcLinkParse(text, link, error) == 0)
        return 0;
    column = error->column;
    dev->station = link->station[0] ? plcStationFind(link->station) : NULL;
    if (dev->station && checkOffsets(dev, link, error))
        error->column = column;
    return -1;
}

static int resolve(dbCommon *prec, devRecord *dev, const char *text, plcLinkError *error)
{
    const devSupport *support = devSupportOf(prec);
    plcShape shape = support->shape;
    size_t room = 0;
    plcLink link, given;

    if (support->resolve)
        return support->resolve(prec, dev, text, error);
    if (parse(dev, text, &link, error))
        return -1;
    warn(prec, error);
    if (devFindStation(dev, link.station, error))
        return -1;
    if (support->direction == devStatus)
        return support->prepare ? support->prepare(prec, dev, &link, error) : 0;
    if (support->adapt && support->adapt(prec, &link, &shape, &room, error))
        return -1;
    given = link;
    if (plcLinkComplete(&link, &shape, room, error))
        return -1;
    warn(prec, error);
    plcLinkIdle(&given, link.type, &shape, error);
    warn(prec, error);
    return place(prec, dev, &link, room, error);
}

/* Tells the station whose bytes these are. */
static void enlist(dbCommon *prec, devRecord *dev)
{
    const devSupport *support = devSupportOf(prec);
    plcOwner *owner = &dev->owner;

    if (!dev->type)
        return;
    owner->name = prec->name;
    owner->recordType = support->shape.recordType;
    owner->output = owner->unwritten = support->direction == devOut;
    owner->offset = dev->offset;
    owner->length = dev->length;
    owner->type = dev->type;
    owner->order = dev->order;
    owner->mask = dev->shifted ? *dev->shifted : dev->mask;
    owner->hasReadback = (dev->has & plcHasR) != 0;
    owner->readback = dev->readback;
    plcOwnersAdd(plcStationOwners(dev->station), owner);
    dev->listed = 1;
}

static void release(devRecord *dev)
{
    if (!dev)
        return;
    devPutAbandon(dev);
    devFollowLeave(dev);
    devListLeave(dev, devWaiting);
    devListLeave(dev, devSilent);
    if (dev->listed)
        plcOwnersRemove(plcStationOwners(dev->station), &dev->owner);
    if (dev->shifted)
        *dev->shifted = dev->unshifted;
    if (dev->last.bytes)
        plcImageAskNot(dev->image, &dev->last);
    if (dev->forget)
        dev->forget(dev);
    free(dev->last.bytes);
    free(dev->reason);
    free(dev->buffer);
    free(dev);
}

void devAsk(devRecord *dev, plcLastPut *last, size_t offset, size_t length, const void *mask)
{
    last->offset = offset;
    last->length = length;
    last->masked = mask != NULL;
    if (mask)
        memcpy(last->mask, mask, length);
    last->bytes = callocMustSucceed(1, length + 1, "S7plc put");
    plcImageAsk(dev->image, last);
}

/* The alarm that a refused link has left behind ends with a good one, not only with the next put. */
static void linkIsGood(dbCommon *prec)
{
    if (prec->stat != LINK_ALARM)
        return;
    plcClearMessage(prec);
    if (prec->udf)
        recGblSetSevr(prec, UDF_ALARM, prec->udfs);
    devStamp(prec);
    if (recGblResetAlarms(prec))
        db_post_events(prec, NULL, DBE_ALARM);
}

/* Binds the record to its place. A refused link leaves it with the reason and INVALID. */
static void attach(dbCommon *prec)
{
    devRecord *dev = callocMustSucceed(1, sizeof(*dev), "S7plc record");
    const char *text = devLinkText(prec);
    plcLinkError error = {0, ""};
    epicsUInt8 bits[DEV_SCALAR];

    prec->dpvt = dev;
    dev->prec = prec;
    devFindSimulation(dev);
    if (resolve(prec, dev, text, &error) == 0) {
        int out = devSupportOf(prec)->direction == devOut;

        if (dev->has & plcHasR || (out && plcStationShowsOutputs(dev->station)))
            devFollowJoin(dev);
        if (dev->shown && !dev->unseen)
            dev->unseen = devNotShown;
        if (out && running) /* what is put now is no value of the start */
            dev->takes = plcStationTakes(dev->station);
        if (out)
            devAsk(dev, &dev->last, dev->offset, dev->length, devMask(dev, bits));
        if (out && dev->faults)
            devListJoin(dev, devWaiting);
        plcStationOnTake(dev->station, devFollowAll);
        plcStationOnThrough(dev->station, devPutUpdate);
        enlist(prec, dev);
        if (!out && dev->statistic == NULL)
            devSilentJoin(dev, running);
        if (running && devSupportOf(prec)->field[0] == 'O')
            linkIsGood(prec);
        return;
    }
    dev->station = NULL;
    dev->reason = shortReason(&error);
    printRefusal(prec, text, &error);
    recGblSetSevrMsg(prec, LINK_ALARM, INVALID_ALARM, "%s", dev->reason);
    if (running)
        devStamp(prec);
    if (recGblResetAlarms(prec) && running)
        db_post_events(prec, NULL, DBE_ALARM);
}

/* --- Functions that Base calls ------------------------------------------------------ */

long devInitRecord(dbCommon *prec)
{
    attach(prec);
    return devSupportOf(prec)->initStatus;
}

/* The record whose link changes in this thread, while a pulse runs that began at its old place. */
static epicsThreadPrivateId pulsing;

/* At iocInit Base calls this before init_record, which does the work then. Never refuses:
 * Base would take the record out of service and forget that it was scanned by I/O Intr.
 */
static long addRecord(dbCommon *prec)
{
    if (!running)
        return 0;
    attach(prec);
    ((devRecord *)prec->dpvt)->ended = epicsThreadPrivateGet(pulsing) == prec;
    epicsThreadPrivateSet(pulsing, NULL);
    return 0;
}

/* The alarm of a put ends with the link; but what waits for the old place does not get there. */
static long delRecord(dbCommon *prec)
{
    devRecord *dev = prec->dpvt;

    if (running && dev && dev->last.bytes && !prec->pact && !plcStationStops(dev->station))
        devAwayLeave(prec, dev, devPutWithdraw(prec, dev));
    if (running)
        epicsThreadPrivateSet(pulsing, dev && dev->ended ? prec : NULL);
    release(dev);
    prec->dpvt = NULL;
    return 0;
}

static dsxt extension = {addRecord, delRecord};

long devInit(int after)
{
    /* after an IOC that has ended its scan lists are gone */
    if (!after && (running || !neverScan))
        scanIoInit(&neverScan);
    if (!after && !pulsing)
        pulsing = epicsThreadPrivateCreate();
    if (!after)
        devExtend(&extension);
    running = after;
    return 0;
}

long devIointInfo(int leave, dbCommon *prec, IOSCANPVT *list)
{
    const devRecord *dev = prec->dpvt;

    if (!dev || !dev->station) {
        *list = neverScan;
        return 0;
    }
    switch (devSupportOf(prec)->direction) {
    case devIn:
        *list = plcStationInRecord(dev->station, dev->offset - dev->head, dev->length + dev->head,
                                   prec, leave);
        break;
    case devOut:
        *list = plcStationOutScan(dev->station, prec->prio, leave);
        break;
    case devStatistics:
        *list = plcStationStatsScan(dev->station, prec->prio, leave);
        break;
    default:
        *list = plcStationInRecord(dev->station, 0, 0, prec, leave);
        break;
    }
    return 0;
}

/* --- What several record types prepare ---------------------------------------------- */

void devScale(const devRecord *dev, double egul, double eguf, double *eslo, double *eoff)
{
    double low = (double)dev->low, high = (double)dev->high;

    if (!(dev->type->kind & plcWhole) || low == high)
        return;
    *eslo = (eguf - egul) / (high - low);
    *eoff = (high * egul - low * eguf) / (high - low);
}

void devCheckScale(dbCommon *prec, const devRecord *dev, unsigned linr, double egul,
                   double eguf)
{
    if (linr == menuConvertNO_CONVERSION)
        return;
    if (dev->type->kind == plcReal)
        devWarn(prec, "LINR has no effect on %s, which is VAL as it is. Scale it with ASLO "
                "and AOFF", dev->type->name);
    else if (linr == menuConvertLINEAR && egul == eguf)
        devWarn(prec, "LINR=LINEAR, but EGUL and EGUF are both %g: the record always %s the "
                "same. Set them to what L and H are in EGU", egul,
                devSupportOf(prec)->direction == devOut ? "writes" : "reads");
}

int devPrepareString(dbCommon *prec, devRecord *dev, const plcLink *link,
                     plcLinkError *error)
{
    (void)prec, (void)link, (void)error;
    dev->buffered = 1;
    return 0;
}

int devPrepareMask(dbCommon *prec, devRecord *dev, const plcLink *link,
                   plcLinkError *error, epicsUInt32 *mask, unsigned nobt, unsigned shft)
{
    int out = devSupportOf(prec)->direction == devOut;
    epicsUInt64 wanted = *mask ? *mask : nobt < 64 ? ((epicsUInt64)1 << nobt) - 1 : ~0ull;
    unsigned bits = 8 * dev->type->size;
    epicsUInt64 has = shft < bits ? ~0ull >> (64 - bits + shft) : 0;

    if (out ? wanted & ~has : wanted && !has)
        return plcLinkFail(error, link->column.T, "NOBT=%u SHFT=%u: %s has bits 0 to %u", nobt,
                           shft, dev->type->name, bits - 1);
    if (wanted & ~has)
        devWarn(prec, "NOBT=%u SHFT=%u: %s has bits 0 to %u, the others read 0", nobt, shft,
                dev->type->name, bits - 1);
    if (!wanted)
        devWarn(prec, "NOBT is 0: the record always %s. Set NOBT to its number of bits",
                out ? "writes nothing" : "reads 0");
    dev->shifted = mask;
    dev->unshifted = *mask;
    *mask = shft < 32 ? (epicsUInt32)(wanted & has) << shft : 0;
    return 0;
}

void devCheckStates(dbCommon *prec, const epicsUInt32 *values, const char *texts,
                    size_t size)
{
    static const char prefixes[16][3] = {"ZR", "ON", "TW", "TH", "FR", "FV", "SX", "SV",
                                         "EI", "NI", "TE", "EL", "TV", "TT", "FT", "FF"};
    int out = devSupportOf(prec)->direction == devOut, first = -1, i;
    char fields[16 * 5 + 1] = "";

    for (i = 0; i < 16; i++) {
        if (!texts[i * size] || values[i])
            continue;
        if (first < 0)
            first = i;
        else
            sprintf(fields + strlen(fields), " %sVL", prefixes[i]);
    }
    if (fields[0])
        devWarn(prec, "states with a text have no value of their own: the record %s %sST. "
                "Set%s to the PLC's numbers", out ? "writes them as 0, like" :
                "never shows them; it reads 0 as", prefixes[first], fields);
}
