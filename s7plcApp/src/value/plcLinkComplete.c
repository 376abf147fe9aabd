/* The text of a link, taken apart, completed by what the record type allows.
 *
 * Knows the data types, but no station, no record and no block size.
 */
#include <string.h>

#include "plcLink.h"

#define INT64_HIGHEST 0x7FFFFFFFFFFFFFFFLL

/* The type: what the link says, else the record type's default. */
static int completeType(plcLink *link, const plcShape *shape, plcLinkError *error)
{
    const plcType *type = link->type;
    char types[160];

    if (!(link->has & plcHasT))
        type = plcTypeFind(shape->defaultType, strlen(shape->defaultType));
    if (type && type->kind & shape->kinds &&
        (!(type->kind & plcWhole) || type->size <= shape->maxSize)) {
        link->type = type;
        return 0;
    }
    plcTypeList(shape->kinds, shape->maxSize, types, sizeof(types));
    return plcLinkFail(error, link->column.T, "T=%s does not fit %s; allowed: %s",
                       type ? type->name : shape->defaultType, shape->recordType, types);
}

/* The limits that hold when nothing is said. */
static void defaultLimits(const plcType *type, epicsInt64 *low, epicsInt64 *high)
{
    *low = type->low;
    *high = type->high;
    if (type->size == 8) {
        *low = type->kind == plcSigned ? -INT64_HIGHEST : 0;
        *high = INT64_HIGHEST;
    }
}

/* L and H of an integer type. As with s7plc, H alone means L=0, and L=0 H=0 (which macros
 * like to leave) means the type's own limits. */
static int completeLimits(plcLink *link, const plcShape *shape, plcLinkError *error)
{
    const plcType *type = link->type;
    int matters = shape->options & plcHasH;
    epicsInt64 low, high;

    defaultLimits(type, &low, &high);
    if (link->high > high) /* without H it is 0 */
        return plcLinkFail(error, link->column.H,
                           "H=%lld is beyond the type; allowed for %s: up to %lld",
                           (long long)link->high, type->name, (long long)high);
    if (!(link->has & plcHasH))
        link->high = high;
    if (!(link->has & (plcHasL | plcHasH)))
        link->low = low;
    if (link->low == 0 && link->high == 0) {
        link->low = low;
        link->high = high;
    }
    if (matters && link->low >= link->high)
        return plcLinkFail(error, link->has & plcHasL ? link->column.L : link->column.H,
                           "L=%lld H=%lld: L must be less than H", (long long)link->low,
                           (long long)link->high);
    if (matters && link->low < low - (type->kind == plcSigned))
        plcLinkWarn(error, link->column.L, "L=%lld is below the type: %s begins at %lld",
                    (long long)link->low, type->name,
                    (long long)low - (type->kind == plcSigned));
    return 0;
}

/* L of a string: its length in bytes. */
static int completeString(plcLink *link, size_t length, plcLinkError *error)
{
    if (link->low < 0 || (link->low == 0 && length == 0))
        return plcLinkFail(error, link->column.L,
                           "L=%lld: the length of a string must be 1 byte or more",
                           (long long)link->low);
    if (link->low == 0)
        link->low = (epicsInt64)length;
    return 0;
}

/* L of an S7 STRING[L]; without it, as in the PLC, 254. */
static int completeS7String(plcLink *link, plcLinkError *error)
{
    if (!(link->has & plcHasL))
        link->low = PLC_S7STRING_MAX;
    if (link->low < 1 || link->low > PLC_S7STRING_MAX)
        return plcLinkFail(error, link->column.L,
                           "L=%lld: an S7STRING has 1 to %d characters, as the PLC's STRING[n]",
                           (long long)link->low, PLC_S7STRING_MAX);
    return 0;
}

/* A bit of the type, even where the record type has no use for it. */
static int completeBit(const plcLink *link, plcLinkError *error)
{
    unsigned bits = 8 * link->type->size;

    if (link->type->kind & plcText || link->bit < bits)
        return 0;
    return plcLinkFail(error, link->column.B, "B=%u: %s has bits 0 to %u", link->bit,
                       link->type->name, bits - 1);
}

/* Limits are for whole numbers. L=0 H=0 is what macros like to leave. */
static void completeReal(const plcLink *link, plcLinkError *error)
{
    if (link->type->kind == plcReal && (link->low || link->high))
        plcLinkWarn(error, link->has & plcHasL ? link->column.L : link->column.H,
                    "L= and H= have no effect on %s: it is neither cut nor scaled by them",
                    link->type->name);
}

/* The order of words, where there are words: elements of 4 and 8 bytes; and that of texts. */
static int completeWords(const plcLink *link, const plcShape *shape, plcLinkError *error)
{
    const char *name = link->type->name;
    int text = link->type->kind & plcText;

    if (!(link->has & plcHasW))
        return 0;
    if (!text && link->highWordFirst < 0)
        return plcLinkFail(error, link->column.W,
                           "W=A0 and W=0A are for texts, not %s; allowed: W=" PLC_WORD_ORDERS, name);
    if (shape->options & plcHasW && text && link->textOrder < 0)
        plcLinkWarn(error, link->column.W,
                    "W=high and W=low have no effect on %s: the order of a text is "
                    "W=" PLC_TEXT_ORDERS, name);
    else if (!(shape->options & plcHasW) ||
             (!text && link->type->size < (link->wordBigEndian < 0 ? 4 : 2)))
        plcLinkWarn(error, link->column.W,
                    "W= has no effect on %s: only types of 4 and 8 bytes have an order of words%s",
                    name,
                    shape->options & plcHasW && link->type->size == 2
                        ? "; allowed: W=BADC DCBA, the lower byte first" : "");
    return 0;
}

int plcLinkComplete(plcLink *link, const plcShape *shape, size_t length,
                    plcLinkError *error)
{
    memset(error, 0, sizeof(*error));
    if (completeType(link, shape, error))
        return -1;
    if (link->type->kind & plcWhole && completeLimits(link, shape, error))
        return -1;
    if (link->type->kind == plcString && completeString(link, length, error))
        return -1;
    if (link->type->kind == plcS7String && completeS7String(link, error))
        return -1;
    if (completeBit(link, error))
        return -1;
    completeReal(link, error);
    if (link->has & plcHasR & ~shape->options)
        return plcLinkFail(error, link->column.R, "R= (read-back) is for outputs only, not %s",
                           shape->recordType);
    return completeWords(link, shape, error);
}

/* L= H= B= that do nothing: a mask of plcHasL | ... 0 is what macros like to leave. */
static unsigned idleOptions(const plcLink *given, const plcType *type, const plcShape *shape)
{
    unsigned idle = given->has & ~shape->options;

    if (!(shape->options & plcHasH) && !(type->kind & plcText)) /* L= is the length of a text */
        idle |= given->has & plcHasL;
    return idle & ((given->low ? plcHasL : 0u) | (given->high ? plcHasH : 0u) |
                   (given->bit ? plcHasB : 0u));
}

void plcLinkIdle(const plcLink *given, const plcType *type, const plcShape *shape,
                 plcLinkError *error)
{
    unsigned idle = idleOptions(given, type, shape);
    int wraps = idle & (plcHasL | plcHasH) && type->kind & plcInteger &&
                shape->options & plcHasR && shape->kinds & plcCoded; /* longout, int64out */

    memset(error, 0, sizeof(*error));
    if (idle)
        plcLinkWarn(error,
                    idle & plcHasL   ? given->column.L
                    : idle & plcHasH ? given->column.H
                                     : given->column.B,
                    "%s%s%s%s no effect on %s%s%s; L= and H= are for ai, ao and calcout, L= for "
                    "texts, B= for bi and bo",
                    idle & plcHasL ? "L= " : "", idle & plcHasH ? "H= " : "",
                    idle & plcHasB ? "B= " : "", idle & (idle - 1) ? "have" : "has",
                    shape->recordType, wraps ? ": a value that does not fit wraps in " : "",
                    wraps ? type->name : "");
    else if (given->has & plcHasL && !given->low && type->kind == plcString)
        plcLinkWarn(error, given->column.L, "L=0 is taken as the length that the record has");
    else if (given->column.open != PLC_NO_COLUMN)
        plcLinkWarn(error, given->column.open, "nothing follows a +: taken as 0");
}

int plcLinkTextLength(const plcLink *link, int order, size_t *length, plcLinkError *error)
{
    size_t unit = plcTextUnit(order), over = *length % unit;
    long long low = (long long)link->low;
    long long step = (long long)(unit - over);

    if (over && link->has & plcHasL)
        return plcLinkFail(error, link->column.L,
                           "L=%lld: in this order a text has a multiple of %u bytes%s; allowed: such as "
                           "L=%lld",
                           low, (unsigned)unit, link->type->kind == plcS7String ? " with its head" : "",
                           low > INT64_HIGHEST - step ? low - (long long)over : low + step);
    *length -= over;
    return *length ? 0
                   : plcLinkFail(error, link->column.offset,
                                 "no room for a text of %u bytes, the least in this order",
                                 (unsigned)unit);
}

int plcLinkOrder(const plcLink *link, int order, int textOrder)
{
    int bigEndian = order & plcBigEndian;

    if (link->type->kind & plcText)
        return link->has & plcHasW && link->textOrder >= 0 ? link->textOrder : textOrder;
    if (link->has & plcHasW && link->wordBigEndian >= 0)
        bigEndian = link->wordBigEndian ? plcBigEndian : 0;
    if (link->type->size < 4)
        return bigEndian;
    return link->has & plcHasW ? plcOrder(bigEndian, link->highWordFirst) : order;
}
