/* Fuzz target: numbers and strings of EtherNet/IP: from text to bytes and back, and strings in
 * their three forms. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "eipType.h"
#include "fuzz.h"

fuzzTarget fuzzEipType;

static void numberText(const eipType *type, const char *text)
{
    epicsUInt8 raw[8] = {0}, back[8] = {0};
    eipNumber number, again, third;
    char shown[64];

    if (eipNumberParse(type, text, &number) || eipNumberPut(type, raw, &number))
        return;
    eipNumberGet(type, raw, &again);
    eipNumberText(type, &again, shown, sizeof(shown));
    fuzzCheck(shown[0] && strlen(shown) < sizeof(shown) - 1);
    if (type->kind == eipReal && !isfinite(eipNumberReal(&again)))
        return;
    fuzzCheck(eipNumberParse(type, shown, &third) == 0);
    fuzzCheck(eipNumberPut(type, back, &third) == 0);
    fuzzCheck(memcmp(raw, back, type->size) == 0);
}

static void string(unsigned code, const epicsUInt8 *data, size_t size)
{
    size_t n = 0, m = 0, put;
    const char *text = eipTextGet(code, data, size, &n), *again;
    epicsUInt8 *raw;

    if (!text)
        return;
    fuzzCheck(n <= size);
    fuzzCheck(n == 0 || ((const epicsUInt8 *)text >= data &&
                         (const epicsUInt8 *)text + n <= data + size));
    raw = malloc(size + 8);
    put = eipTextPut(code, raw, size, 0, text, n);
    fuzzCheck(put <= size);
    if (put) {
        again = eipTextGet(code, raw, put, &m);
        fuzzCheck(again && m == n && memcmp(again, text, n) == 0);
    }
    free(raw);
}

int fuzzEipType(const epicsUInt8 *data, size_t size)
{
    char *text = fuzzText(data, size), shown[64];
    const eipType *type;
    eipNumber number;

    for (type = eipTypes; type->name; type++) {
        if (!type->size || type->kind == eipStructure || type->kind == eipText)
            continue;
        numberText(type, text);
        if (size >= type->size) {
            eipNumberGet(type, data, &number);
            eipNumberText(type, &number, shown, sizeof(shown));
            numberText(type, shown);
        }
    }
    string(eipStringCode, data, size);
    string(eipShortString, data, size);
    string(eipStructureCode, data, size);
    free(text);
    return 0;
}
