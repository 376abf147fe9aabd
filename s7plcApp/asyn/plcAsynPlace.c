/* From a drvInfo to a place in a block, and from its bytes to the values of one asyn
 * interface; see plcAsynPlace.h. */
#include <ctype.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>
#include <epicsString.h>

#include "plcAsynPlace.h"

#define NUMBERS (plcWhole | plcReal)
#define BYTES (plcInteger | plcString | plcBcd)
#define ONE_VALUE (plcHasL | plcHasH | plcHasB | plcHasR | plcHasW)
#define ONE_BIT (plcHasB | plcHasR | plcHasW)
#define MANY_VALUES (plcHasR | plcHasW)

static const char *const allowed = "allowed: [in|out] offset T=type L= H= B= R= W=";

/* What each interface takes, and the size of its elements when it has many. */
static const struct {
    plcShape shape;
    unsigned element;
} faces[plcAsynFaces] = {
    /* clang-format off */
    [plcAsynInt32] = {{"asynInt32", plcWhole, 4, ONE_VALUE, "INT16"}, 0},
    [plcAsynInt64] = {{"asynInt64", plcWhole, 8, ONE_VALUE, "INT16"}, 0},
    [plcAsynUInt32Digital] = {{"asynUInt32Digital", plcInteger, 4, ONE_BIT, "INT16"}, 0},
    [plcAsynFloat64] = {{"asynFloat64", NUMBERS, 8, ONE_VALUE, "INT16"}, 0},
    [plcAsynOctet] = {{"asynOctet", plcText, 1, plcHasL | plcHasR | plcHasW, "STRING"}, 1},
    [plcAsynInt8Array] = {{"asynInt8Array", BYTES, 1, MANY_VALUES, "INT8"}, 1},
    [plcAsynInt16Array] = {{"asynInt16Array", plcInteger, 2, MANY_VALUES, "INT16"}, 2},
    [plcAsynInt32Array] = {{"asynInt32Array", plcInteger, 4, MANY_VALUES, "INT32"}, 4},
    [plcAsynInt64Array] = {{"asynInt64Array", plcInteger, 8, MANY_VALUES, "INT64"}, 8},
    [plcAsynFloat32Array] = {{"asynFloat32Array", plcReal, 4, MANY_VALUES, "REAL32"}, 4},
    [plcAsynFloat64Array] = {{"asynFloat64Array", plcReal, 8, MANY_VALUES, "REAL64"}, 8},
    /* clang-format on */
};

static int fail(char *error, size_t size, const char *format, ...)
    EPICS_PRINTF_STYLE(3, 4);

static int fail(char *error, size_t size, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    epicsVsnprintf(error, size, format, args);
    va_end(args);
    return -1;
}

const char *plcAsynFaceName(plcAsynFace face)
{
    return faces[face].shape.recordType;
}

unsigned plcAsynElementSize(plcAsynFace face)
{
    return faces[face].element;
}

/* --- From the text to a place ---------------------------------------------------- */

/* Takes "in" or "out" from the front of the text. Returns 1 for out. */
static int takeDirection(const char **text)
{
    static const char *const words[] = {"in", "out"};
    int i, found = 0;

    while (isspace((unsigned char)**text))
        (*text)++;
    for (i = 0; i < 2; i++) {
        size_t length = strlen(words[i]);

        if (epicsStrnCaseCmp(*text, words[i], length) == 0 &&
            strchr("/ \t", (*text)[length])) {
            *text += length;
            found = i;
            break;
        }
    }
    while (isspace((unsigned char)**text))
        (*text)++;
    if (**text == '/')
        (*text)++;
    return found;
}

static size_t blockSize(const plcAsynPlace *place)
{
    return place->output ? plcStationOutSize(place->station)
                         : plcStationInSize(place->station);
}

/* Refuses bytes that do not lie in the block, "in" or "out". */
static int checkPlace(size_t offset, size_t length, size_t size, const char *block,
                      char *error, size_t errorSize)
{
    if (size == 0)
        return fail(error, errorSize, "the PLC has no %sput block; %sSize is 0", block,
                    block);
    if (offset > size || length > size - offset)
        return fail(error, errorSize,
                    "%lu + %lu bytes exceed the %sput block; %sSize is "
                    "%lu",
                    (unsigned long)offset, (unsigned long)length, block, block,
                    (unsigned long)size);
    return 0;
}

/* What is wrong for every interface. */
static int checkLink(const plcAsynPlace *place, char *error, size_t size)
{
    const plcLink *link = &place->link;
    unsigned bytes = link->type ? link->type->size : 1;

    if (!place->output && link->has & plcHasR)
        return fail(error, size,
                    "R= (read-back) is for outputs only; allowed: out offset T=type R=");
    if (link->has & plcHasB && link->type && link->type->kind & ~plcInteger)
        return fail(error, size, "B= is for whole numbers only, not %s",
                    link->type->name);
    if (link->has & plcHasB && link->type && link->bit >= 8 * bytes)
        return fail(error, size, "B=%u: %s has bits 0 to %u", link->bit, link->type->name,
                    8 * bytes - 1);
    if (checkPlace(link->offset, bytes, blockSize(place), place->output ? "out" : "in",
                   error, size))
        return -1;
    if (link->has & plcHasR &&
        checkPlace(link->readback, bytes, plcStationInSize(place->station), "in", error,
                   size))
        return -1;
    if (place->output && link->offset < plcStationHeader(place->station))
        return fail(
            error, size,
            "bytes 0 to %u are the header of the sync handshake; allowed: %u and up",
            (unsigned)plcStationHeader(place->station) - 1,
            (unsigned)plcStationHeader(place->station));
    return 0;
}

/* Parses the text as a link of this station. */
static int parse(plcAsynPlace *place, const char *text, char *error, char *warning,
                 size_t size)
{
    const char *name = plcStationName(place->station);
    plcLinkError doubt;
    char *whole;
    int status;

    place->output = takeDirection(&text);
    if (!*text)
        return fail(error, size, "no offset; %s", allowed);
    whole = mallocMustSucceed(strlen(name) + strlen(text) + 2, "plcAsynPlace");
    sprintf(whole, "%s/%s", name, text);
    status = plcLinkParse(whole, &place->link, &doubt);
    free(whole);
    if (status)
        return fail(error, size, "%s%s%s", doubt.text,
                    strstr(doubt.text, "allowed:") ? "" : "; ",
                    strstr(doubt.text, "allowed:") ? "" : allowed);
    epicsSnprintf(warning, size, "%s", doubt.text);
    return checkLink(place, error, size);
}

plcAsynPlace *plcAsynPlaceCreate(plcStation *station, const char *text, char *error,
                                 char *warning, size_t size)
{
    plcAsynPlace *place = callocMustSucceed(1, sizeof(*place), "plcAsynPlace");

    warning[0] = 0;
    place->station = station;
    if (parse(place, text, error, warning, size)) {
        free(place);
        return NULL;
    }
    place->text = epicsStrDup(text);
    return place;
}

/* --- From a place to what one interface makes of it ------------------------------ */

/* L= of an array is the number of its elements; without it the array is open. */
static int measureArray(plcAsynView *view, const plcLink *link, char *error, size_t size)
{
    unsigned element = view->type->size;
    size_t room = blockSize(view->place);

    room = link->offset < room ? room - link->offset : 0;
    view->open = !(link->has & plcHasL);
    if (view->open)
        view->length = room - room % element;
    else if (link->low < 1)
        return fail(error, size, "L=%lld; allowed for %s: 1 element or more",
                    (long long)link->low, plcAsynFaceName(view->face));
    else if ((epicsUInt64)link->low > room / element)
        view->length = room + 1; /* too long: checkPlace says so */
    else
        view->length = (size_t)link->low * element;
    return 0;
}

/* Refuses bytes for which the transport has no place, or not as a whole. An open array ends where
 * they do. */
static int checkHeld(plcAsynView *view, int output, size_t offset, plcLinkError *doubt,
                     char *error, size_t size)
{
    unsigned element = view->type->size;
    size_t fits;

    if (plcStationHolds(view->place->station, output, offset,
                        view->length ? view->length : element,
                        view->bit >= 0 ? view->mask : NULL, &fits, error, size)) {
        if (error[0] && !doubt->text[0])
            plcLinkWarn(doubt, 0, "%s", error);
        return 0;
    }
    if (!view->open || fits < element)
        return -1;
    view->length = fits - fits % element;
    return 0;
}

/* Where the PLC shows this output: R=, or the station's mirror of the whole block. */
static int placeReadback(plcAsynView *view, const plcLink *link, plcLinkError *doubt, char *error,
                         size_t size)
{
    long mirror = plcStationMirror(view->place->station);

    view->hasReadback = (link->has & plcHasR) != 0;
    view->readback = link->readback;
    if (view->hasReadback && view->open)
        return fail(error, size, "R= needs the length; allowed: L=%s",
                    view->face == plcAsynOctet ? "characters" : "elements");
    if (view->hasReadback && mirror >= 0 && link->readback != mirror + view->offset)
        return fail(error, size,
                    "the PLC's option readback=%ld shows this place at %ld; "
                    "leave R= out",
                    mirror, mirror + (long)view->offset);
    if (view->hasReadback)
        return checkPlace(view->readback, view->length,
                          plcStationInSize(view->place->station), "in", error, size) ||
                       checkHeld(view, 0, view->readback, doubt, error, size)
                   ? -1 : 0;
    if (mirror >= 0 && !view->open) {
        view->hasReadback = 1;
        view->readback = mirror + view->offset;
    }
    return 0;
}

static int resolve(plcAsynView *view, plcLinkError *doubt, char *error, size_t size)
{
    const plcAsynPlace *place = view->place;
    const plcShape *shape = &faces[view->face].shape;
    plcLink link = place->link;

    if (plcLinkComplete(&link, shape, blockSize(place), doubt))
        return fail(error, size, "%s", doubt->text);
    if (faces[view->face].element && doubt->column == link.column.L)
        doubt->text[0] = 0; /* L= is a number of elements here */
    if (link.has & plcHasB & ~shape->options)
        return fail(error, size, "B= (one bit) does not fit %s", shape->recordType);
    if (faces[view->face].element && link.type->size != faces[view->face].element)
        return fail(error, size, "T=%s does not fit %s; allowed: types of %u bytes",
                    link.type->name, shape->recordType, faces[view->face].element);
    view->type = link.type;
    view->offset = link.offset;
    view->length = link.type->size;
    view->low = link.low;
    view->high = link.high;
    view->clips = (place->link.has & (plcHasL | plcHasH)) != 0;
    view->bit = place->link.has & plcHasB ? (int)link.bit : -1;
    view->order = plcLinkOrder(&link, plcStationOrder(place->station),
                               plcStationTextOrder(place->station));
    if (view->face != plcAsynOctet && link.type->kind & plcText)
        view->order = plcTextABCD; /* an array has the bytes as they are */
    if (link.type->kind == plcS7String) /* as long as the PLC has it */
        view->length =
            plcTextBytes(view->order, (size_t)link.low + PLC_S7STRING_HEAD);
    else if (faces[view->face].element && measureArray(view, &place->link, error, size))
        return -1;
    if (view->face == plcAsynOctet &&
        plcLinkTextLength(&link, view->order, &view->length, doubt))
        return fail(error, size, "%s", doubt->text);
    if (checkPlace(view->offset, view->length ? view->length : view->type->size, blockSize(place),
                   place->output ? "out" : "in", error, size))
        return -1;
    if (view->bit >= 0)
        plcPutInt(view->type, view->mask, view->order, (epicsInt64)((epicsUInt64)1 << view->bit));
    if (checkHeld(view, place->output, view->offset, doubt, error, size))
        return -1;
    return place->output ? placeReadback(view, &place->link, doubt, error, size) : 0;
}

/* Tells the station whose bytes these are, and where the PLC shows them. */
static void enlist(plcAsynView *view, const char *port)
{
    plcStation *station = view->place->station;
    plcOwner *owner = &view->owner;

    owner->name = port;
    owner->recordType = plcAsynFaceName(view->face);
    owner->output = view->place->output;
    owner->offset = view->offset;
    owner->length = view->length;
    owner->type = view->type;
    owner->order = view->order;
    owner->mask = view->bit >= 0 ? (epicsUInt64)1 << view->bit : 0;
    owner->hasReadback = view->hasReadback;
    owner->readback = view->readback;
    plcOwnersAdd(plcStationOwners(station), owner);
    view->faults =
        owner->output ? plcStationOutFaults(station) : plcStationInFaults(station);
    view->follows = view->hasReadback ||
                    (owner->output && !view->open && plcStationShowsOutputs(station));
    if (view->follows)
        plcStationAddReadback(station, view, view->offset,
                              view->hasReadback ? view->readback : PLC_NO_PLACE,
                              view->length, view->bit >= 0 ? view->mask : NULL);
}

plcAsynView *plcAsynPlaceView(plcAsynPlace *place, plcAsynFace face, const char *port)
{
    plcAsynView *view = place->views[face];
    plcLinkError doubt = {0, ""};
    char error[640];

    if (view)
        return view;
    view = callocMustSucceed(1, sizeof(*view), "plcAsynPlaceView");
    view->place = place;
    view->face = face;
    if (resolve(view, &doubt, error, sizeof(error)))
        view->refused = epicsStrDup(error);
    else
        enlist(view, port);
    if (!view->refused && doubt.text[0])
        view->doubt = epicsStrDup(doubt.text);
    place->views[face] = view;
    return view;
}

/* --- Bytes and values ------------------------------------------------------------ */

int plcAsynIsWrong(const plcAsynView *view, const void *bytes, char text[PLC_WRONG_SIZE])
{
    return view->type->kind & plcCoded &&
           plcIsWrong(view->type, bytes, view->type->size, view->order, text);
}

epicsInt64 plcAsynGetInt(const plcAsynView *view, const void *bytes)
{
    epicsInt64 value = plcGetInt(view->type, bytes, view->order);

    return view->bit < 0 ? value : (epicsInt64)((epicsUInt64)value >> view->bit & 1);
}

double plcAsynGetReal(const plcAsynView *view, const void *bytes)
{
    if (view->type->kind == plcReal)
        return plcGetReal(view->type, bytes, view->order);
    if (view->type->kind == plcUnsigned)
        return (double)(epicsUInt64)plcAsynGetInt(view, bytes);
    return (double)plcAsynGetInt(view, bytes);
}

size_t plcAsynGetText(const plcAsynView *view, const void *bytes, size_t length,
                      char *text, size_t size)
{
    size_t count = plcGetText(view->type, bytes, length, view->order, text, size);

    if (count < size)
        text[count] = 0;
    return count;
}

void plcAsynGetArray(const plcAsynView *view, const void *bytes, void *values, size_t n)
{
    if (view->type->kind == plcBcd)
        plcBcdDecode(values, bytes, n);
    else
        plcCopyElements(values, bytes, view->type->size, n, view->order);
}

/* True when the low bytes of the value are the value, read with or without a sign. */
static int fitsType(const plcType *type, epicsInt64 value)
{
    unsigned bits = 8 * type->size;

    if (type->kind & plcCoded)
        return value >= type->low && value <= type->high;
    return bits == 64 ||
           (value >= -((epicsInt64)1 << (bits - 1)) && value < ((epicsInt64)1 << bits));
}

/* The least value that is written: L= may be below the type. */
static epicsInt64 leastOf(const plcAsynView *view)
{
    epicsInt64 least = view->type->low - (view->type->kind == plcSigned);

    return view->type->size < 8 && view->low < least ? least : view->low;
}

int plcAsynPutInt(const plcAsynView *view, epicsInt64 value, void *bytes, char *error,
                  size_t size)
{
    if (view->bit >= 0) {
        value = value ? (epicsInt64)((epicsUInt64)1 << view->bit) : 0;
    } else if (view->clips) {
        value = value > view->high ? view->high : value;
        value = value < leastOf(view) ? leastOf(view) : value;
    } else if (!fitsType(view->type, value)) {
        return fail(error, size, "%lld does not fit %s", (long long)value,
                    view->type->name);
    }
    plcPutInt(view->type, bytes, view->order, value);
    return 0;
}

/* As an ao record of DTYP "S7plc": rounded, and cut to L and H. */
int plcAsynPutReal(const plcAsynView *view, double value, void *bytes, char *error,
                   size_t size)
{
    epicsInt64 least, whole;

    if (view->type->kind == plcReal) {
        plcPutReal(view->type, bytes, view->order, value);
        return 0;
    }
    if (isnan(value))
        return fail(error, size, "NaN does not fit %s", view->type->name);
    if (view->bit >= 0)
        return plcAsynPutInt(view, value != 0, bytes, error, size);
    value = floor(value + 0.5);
    least = leastOf(view);
    if (value <= (double)least)
        whole = least;
    else if (value >= (double)view->high)
        whole = view->high;
    else
        whole = (epicsInt64)value;
    plcPutInt(view->type, bytes, view->order, whole);
    return 0;
}

void plcAsynPutText(const plcAsynView *view, const char *text, size_t length, void *bytes)
{
    plcPutText(view->type, bytes, view->length, view->order, text, length);
}

void plcAsynPutArray(const plcAsynView *view, const void *values, void *bytes, size_t n)
{
    if (view->type->kind == plcBcd)
        plcBcdEncode(bytes, values, n);
    else
        plcCopyElements(bytes, values, view->type->size, n, view->order);
}
