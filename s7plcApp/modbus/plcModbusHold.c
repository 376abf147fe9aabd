/* May a value lie in these bytes of the image of a Modbus PLC? See plcModbusPlan.h. */
#include <string.h>

#include <epicsStdio.h>

#include "plcModbusPlan.h"

typedef struct bytes {
    size_t first, last;
} bytes;

static int isBits(const plcRange *r)
{
    return r->table == plcCoils || r->table == plcDiscrete;
}

static bytes bytesOf(const plcRange *r)
{
    return (bytes){r->offset, r->offset + plcRangeBytes(r) - 1};
}

static const plcRange *rangeAt(const plcRange *ranges, unsigned count, size_t byte)
{
    unsigned i;

    for (i = 0; i < count; i++)
        if (byte >= ranges[i].offset && byte - ranges[i].offset < plcRangeBytes(&ranges[i]))
            return &ranges[i];
    return NULL;
}

/* Which bits of a byte of the range are registers or coils. */
static epicsUInt8 bitsAt(const plcRange *r, size_t byte)
{
    size_t behind = isBits(r) ? r->count - 8 * (byte - r->offset) : 8;

    return behind < 8 ? (epicsUInt8)((1u << behind) - 1) : 0xff;
}

/* "byte 5", "bits 3 to 7" */
static void span(char text[60], const char *what, size_t first, size_t last)
{
    if (first == last)
        epicsSnprintf(text, 60, "%s %lu", what, (unsigned long)first);
    else
        epicsSnprintf(text, 60, "%ss %lu to %lu", what, (unsigned long)first, (unsigned long)last);
}

/* "bytes 0 to 5, 8 to 13": as many ranges as there is room for. */
static void list(const plcRange *ranges, unsigned count, char text[200])
{
    size_t used = 0;
    unsigned i;

    strcpy(text, count ? "" : "none, there are no ranges");
    for (i = 0; i < count; i++) {
        bytes b = bytesOf(&ranges[i]);
        char one[60];

        epicsSnprintf(one, sizeof(one), "%s%lu to %lu", i ? ", " : "bytes ",
                      (unsigned long)b.first, (unsigned long)b.last);
        if (used + strlen(one) > 190) {
            strcpy(text + used, ", ...");
            return;
        }
        strcpy(text + used, one);
        used += strlen(one);
    }
}

static int inNoRange(const plcRange *ranges, unsigned count, bytes gap, size_t end, char *error,
                     size_t size)
{
    char where[60], allowed[200];

    while (gap.last < end && !rangeAt(ranges, count, gap.last + 1))
        gap.last++;
    span(where, "byte", gap.first, gap.last);
    list(ranges, count, allowed);
    epicsSnprintf(error, size, "%s %s in no range; allowed: %s", where,
                  gap.first == gap.last ? "is" : "are", allowed);
    return 0;
}

static int inTwoRanges(const plcRange *ranges, unsigned count, bytes value, char *error, size_t size)
{
    char where[60], allowed[200];

    span(where, "byte", value.first, value.last);
    list(ranges, count, allowed);
    epicsSnprintf(error, size, "%s are in two ranges; allowed: a value in one of them: %s", where,
                  allowed);
    return 0;
}

/* Says which of the wanted bits a byte of the range has not. Returns 1, or 0 when it has all. */
static int bitsMissing(const plcRange *r, size_t byte, epicsUInt8 wanted, int output, char *error,
                       size_t size)
{
    const char *what = r->table == plcCoils ? "coils" : "discrete inputs";
    epicsUInt8 has = bitsAt(r, byte), none = (epicsUInt8)(wanted & ~has);
    unsigned first = 0, last = 7, highest = 0;
    char where[60], there[60];

    if (!none)
        return 0;
    while (!(none >> first & 1))
        first++;
    while (!(none >> last & 1))
        last--;
    while (has >> highest & 2)
        highest++;
    span(where, "bit", first, last);
    span(there, "bit", 0, highest);
    epicsSnprintf(error, size, wanted == 0xff && output ?
                  "byte %lu has no %s, they are not written; there are: %s, which are %s" :
                  "byte %lu has no %s; allowed: %s, which are %s", (unsigned long)byte, where, there,
                  what);
    return 1;
}

/* The bytes of which a mask has bits. */
static bytes used(size_t offset, size_t length, const epicsUInt8 *mask)
{
    bytes b = {offset, offset + length - 1};

    while (mask && b.first < b.last && !mask[b.first - offset])
        b.first++;
    while (mask && b.last > b.first && !mask[b.last - offset])
        b.last--;
    return b;
}

int plcRangesHold(const plcRange *ranges, unsigned count, size_t offset, size_t length,
                  const void *mask, int output, size_t *fits, char *error, size_t errorSize)
{
    const epicsUInt8 *bits = mask;
    bytes value = used(offset, length, bits);
    const plcRange *r = length ? rangeAt(ranges, count, value.first) : NULL;
    size_t i;

    error[0] = 0;
    *fits = r ? bytesOf(r).last + 1 - offset : 0;
    for (i = value.first; length && i <= value.last; i++)
        if (!rangeAt(ranges, count, i) && !(bits && !bits[i - offset]))
            return inNoRange(ranges, count, (bytes){i, i}, value.last, error, errorSize);
    if (r && value.last > bytesOf(r).last)
        return inTwoRanges(ranges, count, value, error, errorSize);
    for (i = value.first; r && i <= value.last; i++)
        if (bits ? bitsMissing(r, i, bits[i - offset], 0, error, errorSize)
                 : output && bitsMissing(r, i, 0xff, 1, error, errorSize))
            return !bits;
    return 1;
}
