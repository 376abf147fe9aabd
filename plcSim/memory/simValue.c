/* simValue: values in PLC memory, as numbers and as text. It does not know where they are nor what
 * they are for.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <ctype.h>
#include <errno.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <time.h>

#include <cantProceed.h>

#include "simValue.h"

void simPutInt(epicsUInt8 *p, size_t size, int bigEndian, epicsUInt64 value)
{
    size_t i;

    for (i = 0; i < size; i++) {
        p[bigEndian ? size - 1 - i : i] = (epicsUInt8)value;
        value >>= 8;
    }
}

epicsUInt64 simGetInt(const epicsUInt8 *p, size_t size, int bigEndian)
{
    epicsUInt64 value = 0;
    size_t i;

    for (i = 0; i < size; i++)
        value = value << 8 | p[bigEndian ? i : size - 1 - i];
    return value;
}

static epicsInt64 getSigned(const epicsUInt8 *p, size_t size, int bigEndian)
{
    epicsUInt64 value = simGetInt(p, size, bigEndian);
    /* NOLINTNEXTLINE(clang-analyzer-core.UndefinedBinaryOperatorResult): size is 1 to 8 */
    epicsUInt64 sign = (epicsUInt64)1 << (8 * size - 1);

    return (epicsInt64)((value ^ sign) - sign);
}

static void putFloat(epicsUInt8 *p, size_t size, int bigEndian, double value)
{
    epicsUInt32 bits32;
    epicsUInt64 bits;

    if (size == 4) {
        /* beyond the range of a float the C conversion is undefined */
        float single = value > FLT_MAX && !isinf(value)    ? FLT_MAX
                       : value < -FLT_MAX && !isinf(value) ? -FLT_MAX
                                                           : (float)value;
        memcpy(&bits32, &single, 4);
        bits = bits32;
    } else {
        memcpy(&bits, &value, 8);
    }
    simPutInt(p, size, bigEndian, bits);
}

static double getFloat(const epicsUInt8 *p, size_t size, int bigEndian)
{
    epicsUInt64 bits = simGetInt(p, size, bigEndian);
    epicsUInt32 bits32 = (epicsUInt32)bits;
    double value;
    float single;

    if (size == 4) {
        memcpy(&single, &bits32, 4);
        return single;
    }
    memcpy(&value, &bits, 8);
    return value;
}

static epicsUInt64 realToSigned(double value, size_t size)
{
    double limit = ldexp(1.0, (int)(8 * size - 1));
    epicsUInt64 highest = ((epicsUInt64)1 << (8 * size - 1)) - 1;

    if (value >= limit)
        return highest;
    if (value <= -limit)
        return ~highest;
    return (epicsUInt64)(epicsInt64)value;
}

static epicsUInt64 realToUnsigned(double value, size_t size)
{
    double limit = ldexp(1.0, (int)(8 * size));

    if (value >= limit)
        return ~(epicsUInt64)0;
    return value <= 0 ? 0 : (epicsUInt64)value;
}

static void putBit(epicsUInt8 *p, int bit, int value)
{
    if (value)
        *p |= (epicsUInt8)(1u << bit);
    else
        *p &= (epicsUInt8) ~(1u << bit);
}

void simPutReal(const simTypeInfo *info, epicsUInt8 *p, int bit, int bigEndian,
                double value)
{
    if (info->kind == simReal) {
        putFloat(p, info->size, bigEndian, value);
        return;
    }
    if (isnan(value))
        value = 0;
    value = floor(value + 0.5);
    if (info->kind == simBool)
        putBit(p, bit, value != 0);
    else if (info->kind == simInteger)
        simPutInt(p, info->size, bigEndian, realToSigned(value, info->size));
    else if (info->kind == simUnsigned)
        simPutInt(p, info->size, bigEndian, realToUnsigned(value, info->size));
}

void simPutText(const simType *type, epicsUInt8 *p, const char *text)
{
    size_t size = type->count, length = strlen(text);

    if (length > size)
        length = size;
    if (type->info->kind == simS7String) {
        *p++ = (epicsUInt8)size;
        *p++ = (epicsUInt8)length;
    }
    /* NOLINTNEXTLINE(bugprone-not-null-terminated-result): a full one has no zero */
    memcpy(p, text, length);
    memset(p + length, 0, size - length);
}

static int isText(const simType *type)
{
    return type->info->kind == simString || type->info->kind == simS7String;
}

/* The characters of a text; *length of them, at most. */
static const epicsUInt8 *textOf(const simType *type, const epicsUInt8 *p, size_t *length)
{
    *length = type->count;
    if (type->info->kind != simS7String)
        return p;
    if (p[1] < *length)
        *length = p[1];
    return p + SIM_S7STRING_HEAD;
}

/* Splits the time; weekday 1 is Sunday. Times that gmtime cannot say become 1970. */
static long splitTime(double seconds, struct tm *tm)
{
    double whole;
    time_t t;

    if (!(seconds >= 0 && seconds < 4e9)) /* up to the year 2096 */
        seconds = 0;
    whole = floor(seconds);
    t = (time_t)whole;
    gmtime_r(&t, tm);
    return (long)((seconds - whole) * 1e9);
}

static epicsUInt8 bcd(int value)
{
    return (epicsUInt8)((value / 10 % 10) << 4 | value % 10);
}

void simPutBcdTime(epicsUInt8 *p, double seconds)
{
    struct tm tm;
    int ms = (int)(splitTime(seconds, &tm) / 1000000);

    p[0] = bcd(tm.tm_year % 100);
    p[1] = bcd(tm.tm_mon + 1);
    p[2] = bcd(tm.tm_mday);
    p[3] = bcd(tm.tm_hour);
    p[4] = bcd(tm.tm_min);
    p[5] = bcd(tm.tm_sec);
    p[6] = bcd(ms / 10);
    p[7] = (epicsUInt8)((ms % 10) << 4 | (tm.tm_wday + 1));
}

void simPutDtl(epicsUInt8 *p, int bigEndian, double seconds)
{
    struct tm tm;
    long ns = splitTime(seconds, &tm);

    simPutInt(p, 2, bigEndian, (epicsUInt64)tm.tm_year + 1900);
    p[2] = (epicsUInt8)(tm.tm_mon + 1);
    p[3] = (epicsUInt8)tm.tm_mday;
    p[4] = (epicsUInt8)(tm.tm_wday + 1);
    p[5] = (epicsUInt8)tm.tm_hour;
    p[6] = (epicsUInt8)tm.tm_min;
    p[7] = (epicsUInt8)tm.tm_sec;
    simPutInt(p + 8, 4, bigEndian, (epicsUInt64)ns);
}

/* ---- values as text ---- */

static int setInteger(const simTypeInfo *info, epicsUInt8 *p, int bigEndian,
                      const char *word, char error[SIM_ERROR_SIZE])
{
    int negative = word[0] == '-';
    const char *digits = word + (negative || word[0] == '+');
    int hex = digits[0] == '0' && tolower((unsigned char)digits[1]) == 'x';
    unsigned bits = (unsigned)(8 * info->size);
    /* NOLINTNEXTLINE(clang-analyzer-core.UndefinedBinaryOperatorResult): bits is 8 to 64 */
    epicsUInt64 lowest = (epicsUInt64)1 << (bits - 1); /* of negative numbers */
    /* 0xffff is a way to write an INT16, 65535 is not */
    epicsUInt64 highest =
        info->kind == simUnsigned || hex ? ~(epicsUInt64)0 >> (64 - bits) : lowest - 1;
    unsigned long long value;
    char *end;

    errno = 0;
    value = strtoull(digits, &end, hex ? 16 : 10);
    if (!isdigit((unsigned char)digits[0]) || *end)
        return simFail(error, "\"%.40s\" is no integer", word);
    if (errno || value > (negative ? lowest : highest))
        return simFail(error, "%.40s does not fit into %s", word, info->name);
    simPutInt(p, info->size, bigEndian,
              negative ? 0 - (epicsUInt64)value : (epicsUInt64)value);
    return 0;
}

static int setReal(const simTypeInfo *info, epicsUInt8 *p, int bigEndian,
                   const char *word, char error[SIM_ERROR_SIZE])
{
    char *end;
    double value = strtod(word, &end);

    if (end == word || *end)
        return simFail(error, "\"%.40s\" is no number", word);
    putFloat(p, info->size, bigEndian, value);
    return 0;
}

static int setBool(epicsUInt8 *p, int bit, const char *word, char error[SIM_ERROR_SIZE])
{
    if (strcmp(word, "0") && strcmp(word, "1"))
        return simFail(error, "\"%.40s\": a bit is 0 or 1", word);
    putBit(p, bit, word[0] == '1');
    return 0;
}

static int hexDigit(char c)
{
    return isdigit((unsigned char)c) ? c - '0' : tolower((unsigned char)c) - 'a' + 10;
}

/* TIME and DTL are given as hex bytes: "26112312000000 01" without blanks. */
static int setHex(epicsUInt8 *p, size_t size, const char *word,
                  char error[SIM_ERROR_SIZE])
{
    size_t i;

    if (strlen(word) != 2 * size || strspn(word, "0123456789abcdefABCDEF") != 2 * size)
        return simFail(error, "\"%.40s\": give the %lu bytes as %lu hex digits", word,
                       (unsigned long)size, (unsigned long)(2 * size));
    for (i = 0; i < size; i++)
        p[i] = (epicsUInt8)(hexDigit(word[2 * i]) << 4 | hexDigit(word[2 * i + 1]));
    return 0;
}

static int setElement(const simTypeInfo *info, epicsUInt8 *p, int bit, int bigEndian,
                      const char *word, char error[SIM_ERROR_SIZE])
{
    switch (info->kind) {
    case simBool:
        return setBool(p, bit, word, error);
    case simInteger:
    case simUnsigned:
        return setInteger(info, p, bigEndian, word, error);
    case simReal:
        return setReal(info, p, bigEndian, word, error);
    default:
        return setHex(p, info->size, word, error);
    }
}

int simValueSet(const simMemory *mem, const simPlace *place, const simType *type,
                char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    epicsUInt8 *target = place->block->bytes + place->offset;
    size_t size = simTypeSize(type);
    size_t want = isText(type) ? 1 : type->count;
    epicsUInt8 *copy;
    int status = 0;
    size_t i;

    if (simPlaceCheck(place, type, error))
        return -1;
    if (count != want)
        return simFail(error, "%lu value(s) given, but %lu wanted", (unsigned long)count,
                       (unsigned long)want);
    if (isText(type)) {
        simPutText(type, target, words[0]);
        return 0;
    }
    copy = callocMustSucceed(1, size, "simValueSet");
    memcpy(copy, target, size);
    for (i = 0; i < count && status == 0; i++)
        status = setElement(type->info, copy + i * type->info->size, place->bit,
                            mem->bigEndian, words[i], error);
    if (status == 0)
        memcpy(target, copy, size);
    free(copy);
    return status;
}

static void getElement(const simTypeInfo *info, const epicsUInt8 *p, int bit,
                       int bigEndian, simText *out)
{
    size_t i;

    switch (info->kind) {
    case simBool:
        simTextAdd(out, "%d", *p >> bit & 1);
        break;
    case simInteger:
        simTextAdd(out, "%lld", (long long)getSigned(p, info->size, bigEndian));
        break;
    case simUnsigned:
        simTextAdd(out, "%llu", (unsigned long long)simGetInt(p, info->size, bigEndian));
        break;
    case simReal:
        simTextAdd(out, info->size == 4 ? "%.9g" : "%.17g",
                   getFloat(p, info->size, bigEndian));
        break;
    default:
        for (i = 0; i < info->size; i++)
            simTextAdd(out, "%02x", p[i]);
    }
}

void simValueGet(const simMemory *mem, const simPlace *place, const simType *type,
                 simText *out)
{
    const epicsUInt8 *p = place->block->bytes + place->offset;
    size_t i, length;

    if (isText(type)) {
        p = textOf(type, p, &length);
        simTextAdd(out, "\"");
        for (i = 0; i < length && p[i]; i++)
            simTextAdd(out,
                       isprint(p[i]) && p[i] != '"' && p[i] != '\\' ? "%c" : "\\x%02x",
                       p[i]);
        simTextAdd(out, "\"");
        return;
    }
    for (i = 0; i < type->count; i++) {
        if (i)
            simTextAdd(out, " ");
        getElement(type->info, p + i * type->info->size, place->bit, mem->bigEndian, out);
    }
}
