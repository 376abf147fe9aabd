/* One put on its way: its bits, and which of them it has in common with others; see plcPutsPvt.h.
 * Knows nothing of other puts and their order, nor of who asks for one. */
#include <string.h>

#include <cantProceed.h>

#include "plcPutsPvt.h"

int plcEntrySamePlace(entry *e, const plcPut *put)
{
    if (e->offset != put->offset || e->length != put->length || e->masked != !!put->mask)
        return 0;
    return !put->mask || memcmp(plcEntryMask(e), put->mask, e->length) == 0;
}

int plcEntryTouches(entry *e, size_t offset, size_t length, const epicsUInt8 *mask)
{
    size_t i, at;

    for (i = 0; i < e->length; i++) {
        at = e->offset + i;
        if (at >= offset && at < offset + length &&
            (e->masked ? plcEntryMask(e)[i] : 0xff) & (mask ? mask[at - offset] : 0xff))
            return 1;
    }
    return 0;
}

int plcEntryIsWithin(entry *e, size_t offset, size_t length, const epicsUInt8 *mask)
{
    size_t i, at;

    for (i = 0; i < e->length; i++) {
        epicsUInt8 bits = e->masked ? plcEntryMask(e)[i] : 0xff;

        at = e->offset + i;
        if (bits && (at < offset || at >= offset + length ||
                     (mask && bits & ~mask[at - offset])))
            return 0;
    }
    return 1;
}

int plcEntryLiesIn(entry *e, const plcLastPut *who)
{
    return plcEntryTouches(e, who->offset, who->length, who->masked ? who->mask : NULL);
}

entry *plcEntryOf(const plcPut *put, int edges, epicsUInt64 number)
{
    entry *e = callocMustSucceed(1, sizeof(*e) + 2 * put->length, "plcPuts");

    *e = (entry){.first = number, .last = number, .offset = put->offset,
                 .length = put->length, .edges = edges, .masked = put->mask != NULL,
                 .who = put->last};
    memcpy(e->bytes, put->data, put->length);
    if (put->mask)
        memcpy(plcEntryMask(e), put->mask, put->length);
    return e;
}

int plcEntryWithout(entry *e, size_t offset, size_t length, const epicsUInt8 *mask)
{
    size_t i, at;
    epicsUInt8 any = 0, *bits;

    if (e->offset + e->length <= offset || offset + length <= e->offset)
        return 0;
    if (!e->masked) {
        e->masked = 1;
        memset(plcEntryMask(e), 0xff, e->length);
    }
    bits = plcEntryMask(e);
    for (i = 0; i < e->length; i++) {
        at = e->offset + i;
        if (at >= offset && at < offset + length)
            bits[i] &= mask ? (epicsUInt8)~mask[at - offset] : 0;
        any |= bits[i];
    }
    return !any;
}

int plcEntryIsOther(entry *e, size_t offset, size_t length, const epicsUInt8 *value,
                    const epicsUInt8 *mask)
{
    size_t i, at;

    for (i = 0; i < e->length; i++) {
        at = e->offset + i;
        if (at >= offset && at < offset + length &&
            (e->bytes[i] ^ value[at - offset]) & (mask ? mask[at - offset] : 0xff) &
                (e->masked ? plcEntryMask(e)[i] : 0xff))
            return 1;
    }
    return 0;
}

int plcEntryChanges(entry *e, const epicsUInt8 *values, const epicsUInt8 *mask)
{
    size_t i, at;

    for (i = 0; i < e->length; i++) {
        at = e->offset + i;
        if ((e->bytes[i] ^ values[at]) & mask[at] & (e->masked ? plcEntryMask(e)[i] : 0xff))
            return 1;
    }
    return 0;
}

void plcEntryTake(entry *e, epicsUInt8 *values, epicsUInt8 *mask)
{
    size_t i, at;
    epicsUInt8 bits;

    for (i = 0; i < e->length; i++) {
        at = e->offset + i;
        bits = e->masked ? plcEntryMask(e)[i] : 0xff;
        values[at] = (epicsUInt8)((values[at] & ~bits) | (e->bytes[i] & bits));
        mask[at] |= bits;
    }
}
