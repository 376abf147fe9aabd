/* The data types of a controller's tags; see eipType.h. */
#include <ctype.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <epicsMath.h>
#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <epicsString.h>

#include "eipBytes.h"
#include "eipType.h"

/* clang-format off */
const eipType eipTypes[] = {
    {"BOOL",         eipBool,          eipUnsigned,  1},
    {"SINT",         eipSint,          eipSigned,    1},
    {"INT",          eipInt,           eipSigned,    2},
    {"DINT",         eipDint,          eipSigned,    4},
    {"LINT",         0xc5,             eipSigned,    8},
    {"USINT",        eipUsint,         eipUnsigned,  1},
    {"UINT",         0xc7,             eipUnsigned,  2},
    {"UDINT",        0xc8,             eipUnsigned,  4},
    {"ULINT",        0xc9,             eipUnsigned,  8},
    {"REAL",         eipRealCode,      eipReal,      4},
    {"LREAL",        0xcb,             eipReal,      8},
    {"STRING",       eipStringCode,    eipText,      0},
    {"BYTE",         eipByte,          eipUnsigned,  1},
    {"WORD",         0xd2,             eipUnsigned,  2},
    {"DWORD",        eipDword,         eipUnsigned,  4},
    {"LWORD",        eipLword,         eipUnsigned,  8},
    {"SHORT_STRING", eipShortString,   eipText,      0},
    {"STIME",        0xcc,             eipSigned,    4},
    {"DATE",         0xcd,             eipUnsigned,  2},
    {"TIME_OF_DAY",  0xce,             eipUnsigned,  4},
    {"FTIME",        0xd6,             eipSigned,    4},
    {"LTIME",        0xd7,             eipSigned,    8},
    {"ITIME",        0xd8,             eipSigned,    2},
    {"TIME",         0xdb,             eipSigned,    4},
    {"ENUM",         0x07,             eipSigned,    4}, /* from here on Omron's: */
    {"DATE_NSEC",    0x08,             eipSigned,    8},
    {"TIME_NSEC",    0x09,             eipSigned,    8},
    {"DATE_AND_TIME_NSEC", 0x0a,       eipSigned,    8},
    {"TIME_OF_DAY_NSEC",   0x0b,       eipSigned,    8},
    {"STRUCT",       eipStructureCode, eipStructure, 0},
    {NULL,           0,                0,            0},
};
/* clang-format on */

const eipType *eipTypeOf(unsigned code)
{
    const eipType *type;

    for (type = eipTypes; type->name; type++)
        if (type->code == code)
            return type;
    return NULL;
}

const eipType *eipTypeNamed(const char *name)
{
    const eipType *type;

    for (type = eipTypes; type->name; type++)
        if (epicsStrCaseCmp(type->name, name) == 0)
            return type;
    return NULL;
}

/* --- Numbers ------------------------------------------------------------------------------ */

static float floatOf(epicsUInt32 bits)
{
    float value;

    memcpy(&value, &bits, sizeof(value));
    return value;
}

static double doubleOf(epicsUInt64 bits)
{
    double value;

    memcpy(&value, &bits, sizeof(value));
    return value;
}

void eipNumberGet(const eipType *type, const epicsUInt8 *raw, eipNumber *number)
{
    epicsUInt64 bits = eipGetUnsigned(raw, type->size);
    unsigned unused = 64 - 8 * type->size;

    number->kind = type->kind;
    if (type->kind == eipReal)
        number->u.real = type->size == 4 ? floatOf((epicsUInt32)bits) : doubleOf(bits);
    else if (type->code == eipBool)
        number->u.integer = bits != 0;
    else if (type->kind == eipSigned)
        number->u.integer = (epicsInt64)(bits << unused) >> unused;
    else
        number->u.integer = (epicsInt64)bits;
}

double eipNumberReal(const eipNumber *number)
{
    if (number->kind == eipReal)
        return number->u.real;
    return number->kind == eipUnsigned ? (double)(epicsUInt64)number->u.integer
                                       : (double)number->u.integer;
}

static int putReal(const eipType *type, epicsUInt8 *raw, double value)
{
    epicsUInt64 bits;
    epicsUInt32 half;
    float narrow;

    if (type->size == 8) {
        memcpy(&bits, &value, sizeof(bits));
        eipSetUnsigned(raw, 8, bits);
        return 0;
    }
    if (!isnan(value) && !isinf(value) && fabs(value) > FLT_MAX)
        return -1;
    narrow = (float)value;
    memcpy(&half, &narrow, sizeof(half));
    eipSetUnsigned(raw, 4, half);
    return 0;
}

/* The nearest integer as bits. Returns -1 when 64 bits, with sign or without, have it not. */
static int integerOf(double value, int isSigned, epicsInt64 *integer)
{
    double limit = isSigned ? 9223372036854775808.0 : 18446744073709551616.0;

    value = value < 0 ? ceil(value - 0.5) : floor(value + 0.5);
    if (isnan(value) || value >= limit || value < (isSigned ? -limit : 0))
        return -1;
    *integer = isSigned ? (epicsInt64)value : (epicsInt64)(epicsUInt64)value;
    return 0;
}

static int fits(const eipType *type, const eipNumber *number, epicsInt64 value)
{
    unsigned bits = 8 * type->size;
    epicsUInt64 high = type->kind == eipSigned ? ~(epicsUInt64)0 >> (65 - bits)
                                               : ~(epicsUInt64)0 >> (64 - bits);
    int negative = number->kind != eipUnsigned && value < 0 &&
                   !(number->kind == eipReal && type->kind == eipUnsigned);

    if (negative)
        return type->kind == eipSigned && value >= -(epicsInt64)high - 1;
    return (epicsUInt64)value <= high;
}

int eipNumberPut(const eipType *type, epicsUInt8 *raw, const eipNumber *number)
{
    epicsInt64 value = number->u.integer;

    if (type->kind == eipReal)
        return putReal(type, raw, eipNumberReal(number));
    if (number->kind == eipReal &&
        integerOf(number->u.real, type->kind == eipSigned || type->code == eipBool, &value))
        return -1;
    if (type->code == eipBool)
        value = value != 0;
    else if (!fits(type, number, value))
        return -1;
    eipSetUnsigned(raw, type->size, (epicsUInt64)value);
    return 0;
}

static int isBits(const eipType *type)
{
    return type->code >= eipByte && type->code <= eipLword;
}

/* Does an integer go over bit by bit, whatever number that is? */
static int keepsBits(const eipType *to, const eipType *from, epicsUInt64 bits)
{
    if (isBits(to) || isBits(from))
        return bits <= ~(epicsUInt64)0 >> (64 - 8 * to->size);
    return to->size == 1 && from->size == 1;
}

/* "2147483647"; `brief`: "2^31-1". */
static void limitText(const eipType *type, int isLow, int brief, char *text, size_t size)
{
    unsigned bits = 8 * type->size - (type->kind == eipSigned);

    if (type->kind == eipReal)
        epicsSnprintf(text, size, "%s%.8g", isLow ? "-" : "", type->size == 4 ? FLT_MAX : DBL_MAX);
    else if (isLow && type->kind == eipUnsigned)
        epicsSnprintf(text, size, "0");
    else if (brief || bits > 32)
        epicsSnprintf(text, size, isLow ? "-2^%u" : "2^%u-1", bits);
    else
        epicsSnprintf(text, size, "%lld",
                      isLow ? -(1LL << bits) : (long long)((epicsUInt64)1 << bits) - 1);
}

static void misfitText(const eipType *to, const eipType *from, const eipNumber *number, char *why,
                       size_t size)
{
    char value[32], limit[32];
    int isLow = eipNumberReal(number) < 0;

    eipNumberText(from, number, value, sizeof(value));
    /* Whole numbers whole: rounded they might be within the limit. */
    if (number->kind == eipReal && number->u.real == floor(number->u.real) &&
        fabs(number->u.real) < 1e20)
        epicsSnprintf(value, sizeof(value), "%.0f", number->u.real);
    else if (number->kind == eipReal && strlen(value) > 15)
        epicsSnprintf(value, sizeof(value), "%.9g", number->u.real);
    limitText(to, isLow, strlen(value) > 16, limit, sizeof(limit)); /* AMSG is short */
    if (number->kind == eipReal && isnan(number->u.real))
        epicsSnprintf(why, size, "NaN is no whole number");
    else
        epicsSnprintf(why, size, "%s is %s %s", value, isLow ? "below" : "above", limit);
}

int eipNumberAs(const eipType *to, const eipType *from, eipNumber *number, char *why, size_t size)
{
    epicsUInt64 bits = (epicsUInt64)number->u.integer & ~(epicsUInt64)0 >> (64 - 8 * from->size);
    epicsUInt8 raw[8];

    if (to->kind != eipReal && number->kind != eipReal && keepsBits(to, from, bits)) {
        eipSetUnsigned(raw, to->size, bits);
    } else if (eipNumberPut(to, raw, number)) {
        misfitText(to, from, number, why, size);
        return -1;
    }
    eipNumberGet(to, raw, number);
    return 0;
}

void eipNumberText(const eipType *type, const eipNumber *number, char *text, size_t size)
{
    int digits;

    if (number->kind == eipUnsigned) {
        epicsSnprintf(text, size, "%llu", (unsigned long long)number->u.integer);
        return;
    }
    if (number->kind == eipSigned) {
        epicsSnprintf(text, size, "%lld", (long long)number->u.integer);
        return;
    }
    for (digits = type->size == 4 ? 6 : 15; digits < 18; digits++) {
        epicsSnprintf(text, size, "%.*g", digits, number->u.real);
        if (type->size == 4 ? (float)strtod(text, NULL) == (float)number->u.real
                            : strtod(text, NULL) == number->u.real)
            return;
    }
}

int eipNumberParse(const eipType *type, const char *text, eipNumber *number)
{
    const char *digits = text + strspn(text, " +-");
    int base = digits[0] == '0' && tolower((unsigned char)digits[1]) == 'x' ? 16 : 10;
    epicsUInt64 bits;

    number->kind = type->kind;
    if (type->code == eipBool && epicsStrCaseCmp(text, "true") == 0)
        text = "1";
    else if (type->code == eipBool && epicsStrCaseCmp(text, "false") == 0)
        text = "0";
    if (type->kind == eipReal)
        return epicsParseDouble(text, &number->u.real, NULL) ? -1 : 0;
    if (type->kind == eipSigned)
        return epicsParseInt64(text, &number->u.integer, base, NULL) ? -1 : 0;
    if (type->kind != eipUnsigned || strchr(text, '-') ||
        epicsParseUInt64(text, &bits, base, NULL) || (type->code == eipBool && bits > 1))
        return -1;
    number->u.integer = (epicsInt64)bits;
    return 0;
}

/* --- Strings ------------------------------------------------------------------------------ */

const char *eipTextGet(unsigned code, const epicsUInt8 *raw, size_t length,
                       size_t *characters)
{
    size_t head = code == eipStringCode ? 2 : code == eipShortString ? 1 : eipStringData;
    epicsUInt64 n;

    if (length < head)
        return NULL;
    n = eipGetUnsigned(raw, (unsigned)head);
    if (n > length - head)
        return NULL;
    *characters = (size_t)n;
    return (const char *)raw + head;
}

size_t eipTextPut(unsigned code, epicsUInt8 *raw, size_t length, size_t room,
                  const char *text, size_t characters)
{
    size_t head = code == eipStringCode ? 2 : code == eipShortString ? 1 : eipStringData;

    if (length < head || characters > length - head || (room && characters > room) ||
        (code == eipShortString && characters > 255))
        return 0;
    if (code == eipStringCode || code == eipShortString)
        length = head + characters;
    memset(raw, 0, length);
    eipSetUnsigned(raw, (unsigned)head, characters);
    memcpy(raw + head, text, characters);
    return length;
}
