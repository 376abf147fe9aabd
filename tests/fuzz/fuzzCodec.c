/* Fuzz target: bytes of a block as values of all types and orders, and back; clocks of PLCs. */
#include <stdlib.h>
#include <string.h>

#include <epicsTime.h>

#include "fuzz.h"
#include "plcClock.h"
#include "plcCodec.h"

fuzzTarget fuzzCodec;

static void number(const plcType *type, const epicsUInt8 *bytes, int order)
{
    epicsUInt8 back[8], copy[8];

    if (type->kind & plcReal) {
        double value = plcGetReal(type, bytes, order);

        plcPutReal(type, back, order, value);
        fuzzCheck(value != value || memcmp(back, bytes, type->size) == 0);
    } else {
        plcPutInt(type, back, order, plcGetInt(type, bytes, order));
        if (type->kind & plcCoded) { /* no digits, or the sign of a 0, do not come back */
            plcPutInt(type, copy, order, plcGetInt(type, back, order));
            fuzzCheck(memcmp(copy, back, type->size) == 0);
        } else {
            fuzzCheck(memcmp(back, bytes, type->size) == 0);
        }
    }
    plcCopyElements(copy, bytes, type->size, 1, order);
    plcCopyElements(back, copy, type->size, 1, order);
    fuzzCheck(memcmp(back, bytes, type->size) == 0);
}

static void text(const plcType *type, const epicsUInt8 *bytes, size_t size, int order)
{
    size_t head = plcTextBytes(order, type->kind == plcS7String ? PLC_S7STRING_HEAD : 0);
    size_t chars, again;
    char *at = malloc(size + 1), *twice = malloc(size + 1);
    epicsUInt8 *back = malloc(size + 1);

    size -= size % plcTextUnit(order);
    if (size >= head) {
        chars = plcGetText(type, bytes, size, order, at, size);
        fuzzCheck(chars <= size);
        fuzzCheck(chars == 0 || !memchr(at, 0, chars));
        if (size > head && size <= plcTextBytes(order, PLC_S7STRING_HEAD + PLC_S7STRING_MAX)) {
            plcPutText(type, back, size, order, at, chars);
            again = plcGetText(type, back, size, order, twice, size);
            fuzzCheck(again == chars && memcmp(twice, at, chars) == 0);
        }
        plcTextFromBytes(at, bytes, size, order);
        plcTextToBytes(back, at, size, order);
        fuzzCheck(order >= plcTextA0 || memcmp(back, bytes, size) == 0);
    }
    free(back);
    free(twice);
    free(at);
}

static void clocks(const epicsUInt8 *bytes, size_t size)
{
    epicsTimeStamp stamp = {0, 0};

    if (size >= PLC_CLOCK_DT_SIZE && plcClockDateAndTime(bytes, &stamp) == 0)
        fuzzCheck(stamp.nsec < 1000000000u);
    if (size >= PLC_CLOCK_DTL_SIZE && plcClockDtl(bytes, (int)(size & 1), &stamp) == 0)
        fuzzCheck(stamp.nsec < 1000000000u);
}

int fuzzCodec(const epicsUInt8 *data, size_t size)
{
    const plcType *type;
    epicsUInt8 *bcd = malloc(size + 1), *again = malloc(size + 1);
    size_t i;
    int order;

    for (type = plcTypes; type->name; type++) {
        for (order = 0; order < 4 && !(type->kind & plcText); order++)
            if (size >= type->size)
                number(type, data, order);
        for (order = plcTextABCD; order <= plcText0A && type->kind & plcText; order++)
            text(type, data, size, order);
    }
    plcBcdDecode(bcd, data, size);
    plcBcdEncode(again, bcd, size);
    for (i = 0; i < size; i++)
        fuzzCheck((data[i] & 0xf) > 9 || data[i] >> 4 > 9 || again[i] == data[i]);
    clocks(data, size);
    free(bcd);
    free(again);
    return 0;
}
