/* CIP messages; see eipCip.h. */
#include <ctype.h>
#include <stdlib.h>

#include <epicsStdio.h>

#include "eipCip.h"

enum {
    classRouter = 0x02,
    classManager = 0x06,
    tick = 0x0a, /* 2^10 ms: 1,024 ms */
    ticksMax = 255,
    transportClass3 = 0xa3, /* server, application triggered */
    sizeSmall = 0x01ff,
    paramsSmall = 0x4200, /* point to point, low priority, variable size */
    openingAnswer = 26    /* bytes, without an application reply */
};
static const epicsUInt32 paramsLarge = 0x42000000;

/* --- Routes ------------------------------------------------------------------------------- */

static int routeFail(char *error, size_t size, const char *text)
{
    epicsSnprintf(error, size, "route \"%.60s\"; allowed: port,link,port,link ... as "
                               "1,0 or 1,6,18,10.0.0.4,1,0; or -1",
                  text);
    return -1;
}

/* One field up to a comma or the end, as a number below 65536; -1: it is none. */
static long routeNumber(const char *text, size_t length)
{
    long value = 0;
    size_t i;

    for (i = 0; i < length; i++) {
        if (!isdigit((unsigned char)text[i]) || value > 65535)
            return -1;
        value = value * 10 + text[i] - '0';
    }
    return length && value <= 65535 ? value : -1;
}

/* A port of up to 14 in the low nibble; 15 there: a word with the number follows. 16 beside
 * it: the link is a text. */
static void putPort(eipWriter *w, long port, const char *link, size_t length)
{
    long number = routeNumber(link, length);
    int text = number < 0 || number > 255;

    eipPut8(w, (unsigned)(port < 15 ? port : 15) | (text ? 0x10 : 0));
    if (text)
        eipPut8(w, (unsigned)length);
    if (port >= 15)
        eipPut16(w, (unsigned)port);
    if (text)
        eipPutBytes(w, link, length);
    else
        eipPut8(w, (unsigned)number);
    if (w->n % 2)
        eipPut8(w, 0);
}

/* A number that a link may be. */
static int isByte(const char *text, size_t length)
{
    long number = routeNumber(text, length);

    return number >= 0 && number <= 255;
}

/* A slot, four numbers of an address, or a name: what looks like a number must be one. */
static int isLink(const char *text, size_t length)
{
    size_t n, points = 0;

    if (strspn(text, "0123456789.") < length)
        return 1;
    for (; (n = strcspn(text, ".")) < length; points++, text += n + 1, length -= n + 1)
        if (!isByte(text, n))
            return 0;
    return isByte(text, length) && (points == 0 || points == 3);
}

int eipRouteParse(const char *text, eipRoute *route, char *error, size_t size)
{
    eipWriter w = eipWriterOf(route->bytes, sizeof(route->bytes));
    const char *at = text + strspn(text, " ");
    size_t length;
    long port;

    route->length = 0;
    if (!*at || strcmp(at, "-1") == 0)
        return 0;
    for (;;) {
        length = strcspn(at, ",");
        port = routeNumber(at, length);
        if (port < 1 || !at[length])
            return routeFail(error, size, text);
        at += length + 1;
        length = strcspn(at, ",");
        if (!length || length > 48 || memchr(at, ' ', length) || *at == '-' ||
            !isLink(at, length))
            return routeFail(error, size, text);
        putPort(&w, port, at, length);
        at += length;
        if (!*at)
            break;
        at++;
    }
    if (w.full)
        return routeFail(error, size, text);
    route->length = (unsigned)w.n;
    return 0;
}

/* --- Requests and answers ----------------------------------------------------------------- */

void eipRequestPut(eipWriter *w, eipService service, const void *path, size_t length)
{
    eipPut8(w, service);
    eipPut8(w, (unsigned)length / 2);
    eipPutBytes(w, path, length);
    if (length % 2 || length > 510)
        w->full = 1;
}

static void putLogical(eipWriter *w, unsigned type, unsigned value)
{
    if (value < 256) {
        eipPut8(w, type);
        eipPut8(w, value);
    } else {
        eipPut8(w, type | 1);
        eipPut8(w, 0);
        eipPut16(w, value);
    }
}

size_t eipObjectPath(epicsUInt8 path[12], unsigned class, unsigned instance,
                     unsigned attribute)
{
    eipWriter w = eipWriterOf(path, 12);

    putLogical(&w, 0x20, class);
    putLogical(&w, 0x24, instance);
    if (attribute)
        putLogical(&w, 0x30, attribute);
    return w.n;
}

int eipAnswerTake(const void *bytes, size_t length, unsigned service, eipAnswer *a)
{
    eipReader r = eipReaderOf(bytes, length);
    unsigned answered = eipTake8(&r), reserved = eipTake8(&r), words, i;

    memset(a, 0, sizeof(*a));
    a->service = service;
    a->status = eipTake8(&r);
    words = eipTake8(&r);
    for (i = 0; i < words; i++) {
        unsigned word = eipTake16(&r);

        if (i == 0)
            a->extended = word;
        else if (i == 1)
            a->size = word;
    }
    a->data = r.at;
    a->length = r.left;
    return r.bad || answered != (service | 0x80) || reserved != 0 ? -1 : 0;
}

/* --- Several in one ----------------------------------------------------------------------- */

void eipMultipleBegin(eipWriter *w, unsigned count)
{
    static const epicsUInt8 path[] = {0x20, classRouter, 0x24, 1};
    unsigned i;

    eipRequestPut(w, eipMultipleService, path, sizeof(path));
    eipPut16(w, count);
    for (i = 0; i < count; i++)
        eipPut16(w, 0);
}

/* The writer began with the request: offsets count from behind its path. */
void eipMultipleNext(eipWriter *w, unsigned i)
{
    size_t from = eipMultipleHead - 2, place = eipMultipleHead + i * eipMultipleEach;

    if (!w->full)
        eipSetUnsigned(w->start + place, 2, w->n - from);
}

const epicsUInt8 *eipMultipleTake(const eipAnswer *a, unsigned count, unsigned i,
                                  size_t *length)
{
    eipReader r = eipReaderOf(a->data, a->length);
    size_t from, to;

    *length = 0;
    if (eipTake16(&r) != count || i >= count)
        return NULL;
    eipTake(&r, (size_t)i * eipMultipleEach);
    from = eipTake16(&r);
    to = i + 1 < count ? eipTake16(&r) : a->length;
    if (r.bad || from < 2 + (size_t)count * eipMultipleEach || to < from ||
        to > a->length)
        return NULL;
    *length = to - from;
    return a->data + from;
}

int eipAnswerIsEnd(const eipAnswer *a)
{
    return (a->status == eipGeneral && a->extended == eipExtEnd) ||
           (a->status == eipParameter && a->extended == eipExtRange);
}

int eipAnswerIsOtherType(const eipAnswer *a)
{
    return (a->status == eipGeneral && a->extended == eipExtType) ||
           (a->status == eipParameter && a->extended == eipExtNotType);
}

/* --- The connection manager --------------------------------------------------------------- */

static void putTimeout(eipWriter *w, unsigned ms)
{
    unsigned ticks = (ms + 1023) / 1024;

    eipPut8(w, tick);
    eipPut8(w, ticks < 1 ? 1 : ticks > ticksMax ? ticksMax : ticks);
}

static void putManager(eipWriter *w, eipService service)
{
    static const epicsUInt8 path[] = {0x20, classManager, 0x24, 1};

    eipRequestPut(w, service, path, sizeof(path));
}

void eipUnconnectedSendPut(eipWriter *w, const void *message, size_t length,
                           const eipRoute *route, unsigned ms)
{
    putManager(w, eipUnconnectedSend);
    putTimeout(w, ms);
    eipPut16(w, (unsigned)length);
    eipPutBytes(w, message, length);
    if (length % 2)
        eipPut8(w, 0);
    eipPut8(w, route->length / 2);
    eipPut8(w, 0);
    eipPutBytes(w, route->bytes, route->length);
}

/* Service D2 is also the answer of a fragment that was read: but no tag gives these. */
int eipIsRouteFailure(const epicsUInt8 *answer, size_t length, unsigned service)
{
    eipAnswer a;

    if (eipAnswerTake(answer, length, eipUnconnectedSend, &a) || !a.status)
        return 0;
    if (service != eipUnconnectedSend)
        return 1;
    return a.status == eipConnectionFailure || a.status == 0x02;
}

/* The path of a connection: the route, then the message router. */
static void putConnectionPath(eipWriter *w, const eipRoute *route, int pad)
{
    static const epicsUInt8 router[] = {0x20, classRouter, 0x24, 1};

    eipPut8(w, (route->length + (unsigned)sizeof(router)) / 2);
    if (pad)
        eipPut8(w, 0);
    eipPutBytes(w, route->bytes, route->length);
    eipPutBytes(w, router, sizeof(router));
}

static void putTriad(eipWriter *w, const eipOpening *o)
{
    eipPut16(w, o->serial);
    eipPut16(w, o->vendor);
    eipPut32(w, o->originator);
}

void eipForwardOpenPut(eipWriter *w, const eipOpening *o, const eipRoute *route)
{
    unsigned i;

    putManager(w, o->large ? eipLargeForwardOpen : eipForwardOpen);
    putTimeout(w, 5000);
    eipPut32(w, 0);
    eipPut32(w, o->id);
    putTriad(w, o);
    eipPut8(w, o->multiplier);
    eipPutBytes(w, "\0\0\0", 3);
    for (i = 0; i < 2; i++) {
        eipPut32(w, o->interval);
        if (o->large)
            eipPut32(w, paramsLarge + o->size);
        else
            eipPut16(w, paramsSmall | (o->size & sizeSmall));
    }
    eipPut8(w, transportClass3);
    putConnectionPath(w, route, 0);
}

int eipForwardOpenTake(const eipAnswer *a, const eipOpening *o, eipOpened *opened)
{
    eipReader r = eipReaderOf(a->data, a->length);
    unsigned serial, vendor;
    epicsUInt32 originator;

    opened->toPlc = eipTake32(&r);
    opened->fromPlc = eipTake32(&r);
    serial = eipTake16(&r);
    vendor = eipTake16(&r);
    originator = eipTake32(&r);
    opened->interval = eipTake32(&r);
    eipTake32(&r);
    return a->length < openingAnswer || r.bad || opened->fromPlc != o->id ||
                   serial != o->serial || vendor != o->vendor ||
                   originator != o->originator
               ? -1
               : 0;
}

void eipForwardClosePut(eipWriter *w, const eipOpening *o, const eipRoute *route)
{
    putManager(w, eipForwardClose);
    putTimeout(w, 1000);
    putTriad(w, o);
    putConnectionPath(w, route, 1);
}

/* --- Words -------------------------------------------------------------------------------- */

static const struct {
    unsigned status, extended; /* 0: any */
    const char *text;
} words[] = {
    {0x01, 0x0100, "connection in use"             },
    {0x01, 0x0107, "connection not known"          },
    {0x01, 0x0109, "connection size refused"       },
    {0x01, 0x0113, "no connection left in PLC"     },
    {0x01, 0x0203, "connection timed out"          },
    {0x01, 0x0204, "no answer from controller"     },
    {0x01, 0x0205, "error on the way to the slot"  },
    {0x01, 0x0311, "no such port in the route"     },
    {0x01, 0x0312, "no module in that slot"        },
    {0x01, 0x0315, "route not understood"          },
    {0x01, 0x0318, "route leads back to itself"    },
    {0x01, 0,      "connection failed"             },
    {0x02, 0,      "PLC has no resources left"     },
    {0x03, 0,      "value not valid"               },
    {0x04, 0,      "no such tag or member"         },
    {0x05, 0,      "no such tag"                   },
    {0x06, 0,      "does not fit one answer"       },
    {0x08, 0,      "PLC has no such service"       },
    {0x09, 0,      "attribute value not valid"     },
    {0x0a, 0,      "attribute not known"           },
    {0x0c, 0,      "not possible in this state"    },
    {0x0d, 0,      "exists already"                },
    {0x0e, 0,      "cannot be written"             },
    {0x0f, 0,      "no right to access it"         },
    {0x10, 0x2101, "key switch not in REM"         },
    {0x10, 0,      "not possible in this mode"     },
    {0x11, 0,      "answer too long"               },
    {0x13, 0,      "PLC got too few data"          },
    {0x14, 0,      "attribute not supported"       },
    {0x15, 0,      "PLC got too many data"         },
    {0x16, 0,      "no such object"                },
    {0x1e, 0,      "one of several has failed"     },
    {0x20, 0x8017, "is no array"                   },
    {0x20, 0x8018, "index beyond the end"          },
    {0x20, 0x8022, "tag has another type"          },
    {0x20, 0,      "parameter not valid"           },
    {0x26, 0,      "path size not valid"           },
    {0xff, 0x2104, "offset beyond the end"         },
    {0xff, 0x2105, "index beyond the end"          },
    {0xff, 0x2107, "tag has another type"          },
    {0xff, 0x210a, "tag name not understood"       },
    {0xff, 0,      "general error"                 },
};

void eipStatusText(unsigned status, unsigned extended, char *text, size_t size)
{
    const char *word = "error";
    size_t i;

    for (i = 0; i < sizeof(words) / sizeof(words[0]); i++)
        if (words[i].status == status &&
            (!words[i].extended || words[i].extended == extended)) {
            word = words[i].text;
            break;
        }
    if (extended)
        epicsSnprintf(text, size, "%s (%02X %04X)", word, status, extended);
    else
        epicsSnprintf(text, size, "%s (%02X)", word, status);
}
