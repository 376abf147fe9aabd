/* The data types of a PLC block: names, sizes, limits and the way of their bytes.
 *
 * Knows bytes and numbers; knows no records, no links and no sockets.
 */
#include <string.h>

#include <epicsEndian.h>
#include <epicsStdio.h>
#include <epicsString.h>

#include "plcCodec.h"
#include "plcHot.h"

#if EPICS_BYTE_ORDER == EPICS_ENDIAN_BIG
#define HOST plcBigEndian
#define OTHER plcLittleEndian
#else
#define HOST plcLittleEndian
#define OTHER plcBigEndian
#endif

#if defined(__GNUC__)
#define NOINLINE __attribute__((noinline))
#else
#define NOINLINE
#endif

/* In the order of the documentation. The most negative value of a signed type is not a
 * default limit, so that it is never written by chance. 64-bit types have no limits: both
 * are 0. */
const plcType plcTypes[] = {
    {"INT8",   plcSigned,   1, -0x7F,       0x7F        },
    {"UINT8",  plcUnsigned, 1, 0,           0xFF        },
    {"INT16",  plcSigned,   2, -0x7FFF,     0x7FFF      },
    {"UINT16", plcUnsigned, 2, 0,           0xFFFF      },
    {"INT32",  plcSigned,   4, -0x7FFFFFFF, 0x7FFFFFFF  },
    {"UINT32", plcUnsigned, 4, 0,           0xFFFFFFFFLL},
    {"INT64",  plcSigned,   8, 0,           0           },
    {"UINT64", plcUnsigned, 8, 0,           0           },
    {"REAL32", plcReal,     4, 0,           0           },
    {"REAL64", plcReal,     8, 0,           0           },
    {"STRING", plcString,   1, 0,           0           },
    {"TIME",   plcBcd,      1, 0,           0           },
    {"S7STRING", plcS7String, 1, 0,         0           },
    {"BCD16",  plcDigits,   2, 0,           9999        },
    {"BCD32",  plcDigits,   4, 0,           99999999    },
    {"SM16",   plcMagnitude, 2, -0x7FFF,    0x7FFF      },
    {"SBCD16", plcSignedDigits, 2, -7999,       7999        },
    {NULL,     0,           0, 0,           0           },
};

/* Other names of the same types. */
static const struct {
    const char *alias;
    const char *name;
} aliases[] = {
    {"UNSIGN8",  "UINT8" },
    {"BYTE",     "UINT8" },
    {"CHAR",     "UINT8" },
    {"SHORT",    "INT16" },
    {"UNSIGN16", "UINT16"},
    {"WORD",     "UINT16"},
    {"LONG",     "INT32" },
    {"UNSIGN32", "UINT32"},
    {"DWORD",    "UINT32"},
    {"LONGLONG", "INT64" },
    {"UNSIGN64", "UINT64"},
    {"QWORD",    "UINT64"},
    {"FLOAT32",  "REAL32"},
    {"FLOAT",    "REAL32"},
    {"FLOAT64",  "REAL64"},
    {"DOUBLE",   "REAL64"},
    {"BCD",      "TIME"  },
    {NULL,       NULL    },
};

/* The whole of `word`, not only its beginning: FLOAT is not FLOAT64. */
static int sameWord(const char *word, const char *name, size_t length)
{
    return strlen(word) == length && epicsStrnCaseCmp(word, name, length) == 0;
}

const plcType *plcTypeFind(const char *name, size_t length)
{
    const plcType *type;
    int i;

    for (i = 0; aliases[i].alias; i++) {
        if (sameWord(aliases[i].alias, name, length)) {
            name = aliases[i].name;
            length = strlen(name);
            break;
        }
    }
    for (type = plcTypes; type->name; type++) {
        if (sameWord(type->name, name, length))
            return type;
    }
    return NULL;
}

const plcType *plcTypeOf(plcKind kind, unsigned size)
{
    const plcType *type;

    for (type = plcTypes; type->name; type++) {
        if (type->kind == kind && type->size == size)
            return type;
    }
    return NULL;
}

void plcTypeList(unsigned kinds, unsigned maxSize, char *text, size_t size)
{
    const plcType *type;
    size_t used = 0;

    if (size == 0)
        return;
    text[0] = 0;
    for (type = plcTypes; type->name; type++) {
        size_t length = strlen(type->name);

        if (!(type->kind & kinds) || (type->kind & plcWhole && type->size > maxSize))
            continue;
        if (used + (used > 0) + length + 1 > size)
            return;
        if (used)
            text[used++] = ' ';
        memcpy(text + used, type->name, length + 1);
        used += length;
    }
}

int plcOrder(int bigEndian, int highWordFirst)
{
    int order = bigEndian ? plcBigEndian : plcLittleEndian;

    return !bigEndian == !highWordFirst ? order : order | plcWordsSwapped;
}

/* Shifts, not builtins: every compiler we met makes one instruction of each. */
static epicsUInt16 swap16(epicsUInt16 x)
{
    return (epicsUInt16)(x << 8 | x >> 8);
}

static epicsUInt32 swap32(epicsUInt32 x)
{
    return x << 24 | (x & 0xFF00u) << 8 | (x >> 8 & 0xFF00u) | x >> 24;
}

static epicsUInt64 swap64(epicsUInt64 x)
{
    return (epicsUInt64)swap32((epicsUInt32)x) << 32 | swap32((epicsUInt32)(x >> 32));
}

/* An element between the order on the wire and that of this machine, both ways. */
static epicsUInt16 turn16(epicsUInt16 x, int order)
{
    return (order & plcBigEndian) == HOST ? x : swap16(x);
}

/* With the 16-bit words the other way round. Not in line: the two usual orders must cost
 * no more than they would without these. */
static NOINLINE epicsUInt32 turnWords32(epicsUInt32 x, int order)
{
    x = x << 16 | x >> 16;
    return (order & plcBigEndian) == HOST ? x : swap32(x);
}

static NOINLINE epicsUInt64 turnWords64(epicsUInt64 x, int order)
{
    x = x << 48 | (x & 0xFFFF0000u) << 16 | (x >> 16 & 0xFFFF0000u) | x >> 48;
    return (order & plcBigEndian) == HOST ? x : swap64(x);
}

static epicsUInt32 turn32(epicsUInt32 x, int order)
{
    if (order == OTHER)
        return swap32(x);
    return order == HOST ? x : turnWords32(x, order);
}

static epicsUInt64 turn64(epicsUInt64 x, int order)
{
    if (order == OTHER)
        return swap64(x);
    return order == HOST ? x : turnWords64(x, order);
}

/* An element of 1, 2, 4 or 8 bytes, zero- or sign-extended. */
static epicsUInt64 load(const void *bytes, unsigned size, int order, int sign)
{
    epicsUInt8 u8;
    epicsUInt16 u16;
    epicsUInt32 u32;
    epicsUInt64 u64;

    switch (size) {
    case 1:
        u8 = *(const epicsUInt8 *)bytes;
        return sign ? (epicsUInt64)(epicsInt8)u8 : u8;
    case 2:
        memcpy(&u16, bytes, 2);
        u16 = turn16(u16, order);
        return sign ? (epicsUInt64)(epicsInt16)u16 : u16;
    case 4:
        memcpy(&u32, bytes, 4);
        u32 = turn32(u32, order);
        return sign ? (epicsUInt64)(epicsInt32)u32 : u32;
    default:
        memcpy(&u64, bytes, 8);
        return turn64(u64, order);
    }
}

/* The low bytes of `value` as an element of 1, 2, 4 or 8 bytes. */
static void store(void *bytes, unsigned size, int order, epicsUInt64 value)
{
    epicsUInt16 u16;
    epicsUInt32 u32;

    switch (size) {
    case 1:
        *(epicsUInt8 *)bytes = (epicsUInt8)value;
        break;
    case 2:
        u16 = turn16((epicsUInt16)value, order);
        memcpy(bytes, &u16, 2);
        break;
    case 4:
        u32 = turn32((epicsUInt32)value, order);
        memcpy(bytes, &u32, 4);
        break;
    default:
        value = turn64(value, order);
        memcpy(bytes, &value, 8);
        break;
    }
}

/* Digits beyond 9 count as what they are. */
static NOINLINE epicsInt64 decode(const plcType *type, epicsUInt64 coded)
{
    int negative = type->kind != plcDigits && coded & 0x8000;
    epicsInt64 value = 0;
    int shift;

    if (negative)
        coded &= 0x7FFF;
    if (type->kind == plcMagnitude)
        return negative ? -(epicsInt64)coded : (epicsInt64)coded;
    for (shift = 8 * (int)type->size - 4; shift >= 0; shift -= 4)
        value = value * 10 + (epicsInt64)(coded >> shift & 0xF);
    return negative ? -value : value;
}

static int hasWrongDigit(epicsUInt64 coded, unsigned size)
{
    unsigned shift;

    for (shift = 0; shift < 8 * size; shift += 4)
        if ((coded >> shift & 0xF) > 9)
            return 1;
    return 0;
}

NOINLINE int plcIsWrong(const plcType *type, const void *bytes, size_t length, int order,
                        char text[PLC_WRONG_SIZE])
{
    const epicsUInt8 *byte = bytes;
    epicsUInt64 coded;
    size_t i;

    for (i = 0; type->kind == plcBcd && i < length; i++)
        if (hasWrongDigit(byte[i], 1)) {
            epicsSnprintf(text, PLC_WRONG_SIZE, "byte %lu is 0x%02X: no BCD", (unsigned long)i,
                          byte[i]);
            return 1;
        }
    if (!(type->kind & (plcDigits | plcSignedDigits)))
        return 0;
    coded = load(bytes, type->size, order, 0);
    if (!hasWrongDigit(type->kind == plcDigits ? coded : coded & 0x7FFF, type->size))
        return 0;
    epicsSnprintf(text, PLC_WRONG_SIZE, "0x%0*llX is no BCD number", 2 * (int)type->size,
                  (unsigned long long)coded);
    return 1;
}

/* A number with more digits than there is room for is the largest, a negative one 0. */
static NOINLINE epicsUInt64 encode(const plcType *type, epicsInt64 value)
{
    epicsUInt64 coded = 0, sign;
    unsigned shift;

    value = value < type->low ? type->low : value > type->high ? type->high : value;
    sign = value < 0 ? 0x8000u : 0;
    if (value < 0)
        value = -value;
    if (type->kind == plcMagnitude)
        return sign | (epicsUInt64)value;
    for (shift = 0; shift < 8 * type->size; shift += 4, value /= 10)
        coded |= (epicsUInt64)(value % 10) << shift;
    return sign | coded;
}

PLC_HOT epicsInt64 plcGetInt(const plcType *type, const void *bytes, int order)
{
    if (type->kind & plcCoded)
        return decode(type, load(bytes, type->size, order, 0));
    return (epicsInt64)load(bytes, type->size, order, type->kind == plcSigned);
}

void plcPutInt(const plcType *type, void *bytes, int order, epicsInt64 value)
{
    store(bytes, type->size, order,
          type->kind & plcCoded ? encode(type, value) : (epicsUInt64)value);
}

PLC_HOT double plcGetReal(const plcType *type, const void *bytes, int order)
{
    epicsUInt64 bits = load(bytes, type->size, order, 0);
    double value;

    if (type->size == 4) {
        epicsUInt32 bits32 = (epicsUInt32)bits;
        float value32;

        memcpy(&value32, &bits32, 4);
        return value32;
    }
    memcpy(&value, &bits, 8);
    return value;
}

void plcPutReal(const plcType *type, void *bytes, int order, double value)
{
    epicsUInt64 bits;

    if (type->size == 4) {
        float value32 = (float)value;
        epicsUInt32 bits32;

        memcpy(&bits32, &value32, 4);
        bits = bits32;
    } else {
        memcpy(&bits, &value, 8);
    }
    store(bytes, type->size, order, bits);
}

/* Elements of 4 and 8 bytes with their words the other way round. */
static NOINLINE void copyWords(epicsUInt8 *to, const epicsUInt8 *from, unsigned size,
                               size_t n, int order)
{
    size_t i;

    for (i = 0; i < n; i++)
        store(to + size * i, size, HOST, load(from + size * i, size, order, 0));
}

void plcCopyElements(void *dst, const void *src, unsigned size, size_t n, int order)
{
    const epicsUInt8 *from = src;
    epicsUInt8 *to = dst;
    size_t i;

    if (n == 0)
        return;
    if (size == 1 || order == HOST) {
        memcpy(dst, src, size * n);
    } else if (order != OTHER && size == 2) {
        plcCopyElements(dst, src, size, n, order & plcBigEndian);
    } else if (order != OTHER) {
        copyWords(to, from, size, n, order);
    } else if (size == 2) {
        for (i = 0; i < n; i++)
            store(to + 2 * i, 2, HOST, load(from + 2 * i, 2, OTHER, 0));
    } else if (size == 4) {
        for (i = 0; i < n; i++)
            store(to + 4 * i, 4, HOST, load(from + 4 * i, 4, OTHER, 0));
    } else {
        for (i = 0; i < n; i++)
            store(to + 8 * i, 8, HOST, load(from + 8 * i, 8, OTHER, 0));
    }
}

void plcBcdDecode(epicsUInt8 *dst, const epicsUInt8 *src, size_t n)
{
    size_t i;

    for (i = 0; i < n; i++)
        dst[i] = (epicsUInt8)((src[i] >> 4) * 10 + (src[i] & 0xF));
}

void plcBcdEncode(epicsUInt8 *dst, const epicsUInt8 *src, size_t n)
{
    size_t i;

    for (i = 0; i < n; i++)
        dst[i] = (epicsUInt8)((src[i] / 10 % 10) << 4 | src[i] % 10);
}

/* The byte of a character, by its number. The numbers of the four orders are what two bytes
 * that change places differ by. */
static size_t placeOf(int order, size_t i)
{
    return order >= plcTextA0 ? 2 * i + (order == plcText0A) : i ^ (size_t)order;
}

const char *plcTextOrderName(int order)
{
    static const char *const names[] = {"ABCD", "BADC", "CDAB", "DCBA", "A0", "0A"};

    return names[order];
}

unsigned plcTextUnit(int order)
{
    return order == plcTextABCD ? 1 : order == plcTextCDAB || order == plcTextDCBA ? 4 : 2;
}

size_t plcTextBytes(int order, size_t chars)
{
    return order >= plcTextA0 ? 2 * chars : chars;
}

static size_t charsOf(int order, size_t length)
{
    return order >= plcTextA0 ? length / 2 : length;
}

void plcTextFromBytes(void *text, const void *bytes, size_t length, int order)
{
    const epicsUInt8 *from = bytes;
    epicsUInt8 *to = text;
    size_t i;

    if (order == plcTextABCD)
        memcpy(to, from, length);
    for (i = 0; order != plcTextABCD && i < charsOf(order, length); i++)
        to[i] = from[placeOf(order, i)];
}

void plcTextToBytes(void *bytes, const void *text, size_t length, int order)
{
    const epicsUInt8 *from = text;
    epicsUInt8 *to = bytes;
    size_t i;

    if (order == plcTextABCD) {
        memcpy(to, from, length);
        return;
    }
    memset(to, 0, length);
    for (i = 0; i < charsOf(order, length); i++)
        to[placeOf(order, i)] = from[i];
}

size_t plcGetText(const plcType *type, const void *bytes, size_t length, int order, char *text,
                  size_t size)
{
    const epicsUInt8 *from = bytes, *nul;
    size_t head = type->kind == plcS7String ? PLC_S7STRING_HEAD : 0;
    size_t chars = charsOf(order, length) - head, i;

    if (head && from[placeOf(order, 1)] < chars)
        chars = from[placeOf(order, 1)];
    if (chars > size)
        chars = size;
    if (order == plcTextABCD) {
        nul = memchr(from + head, 0, chars);
        chars = nul ? (size_t)(nul - (from + head)) : chars;
        memcpy(text, from + head, chars);
        return chars;
    }
    for (i = 0; i < chars; i++) {
        text[i] = (char)from[placeOf(order, head + i)];
        if (!text[i])
            break;
    }
    return i;
}

void plcPutText(const plcType *type, void *bytes, size_t length, int order, const char *text,
                size_t chars)
{
    epicsUInt8 *to = bytes;
    size_t head = type->kind == plcS7String ? PLC_S7STRING_HEAD : 0;
    size_t room = charsOf(order, length) - head, i;

    if (chars > room)
        chars = room;
    memset(to, 0, length);
    if (head) {
        to[placeOf(order, 0)] = (epicsUInt8)room;
        to[placeOf(order, 1)] = (epicsUInt8)chars;
    }
    for (i = 0; i < chars; i++)
        to[placeOf(order, head + i)] = (epicsUInt8)text[i];
}
