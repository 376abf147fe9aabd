/* The text of an INP or OUT link taken apart, and completed by what the record type allows.
 *
 * Knows the data types, but no station, no record and no block size. All numbers are
 * checked for overflow; no text, however malformed, is read beyond its end.
 */
#include <ctype.h>
#include <limits.h>
#include <stdarg.h>
#include <string.h>

#include <epicsStdio.h>

#include "plcLink.h"

#define INT64_HIGHEST 0x7FFFFFFFFFFFFFFFLL
#define QUOTE_SIZE 33 /* characters of the link in a message, with the terminator */

/* The place in the text where we are. */
typedef struct cursor {
    const char *text;
    size_t at;
    int quoted; /* inside '...' */
    plcLinkError *error;
} cursor;

static int fail(plcLinkError *error, size_t column, const char *format, ...)
    EPICS_PRINTF_STYLE(3, 4);

/* Fills in the error. Returns -1, so that a refusal is one line. */
static int fail(plcLinkError *error, size_t column, const char *format, ...)
{
    va_list args;

    error->column = column;
    va_start(args, format);
    epicsVsnprintf(error->text, sizeof(error->text), format, args);
    va_end(args);
    return -1;
}

static char here(const cursor *c)
{
    return c->text[c->at];
}

static int isBlank(char x)
{
    return isspace((unsigned char)x);
}

static void skipBlanks(cursor *c)
{
    while (isBlank(here(c)))
        c->at++;
}

/* True where a number or a word may end: before a blank, the closing quote, the end. */
static int atEnd(const cursor *c)
{
    return here(c) == 0 || isBlank(here(c)) || here(c) == '\'';
}

/* The word from column `from` up to the next blank, fit to be printed in a message. */
static const char *wordFrom(const cursor *c, size_t from, char quote[QUOTE_SIZE])
{
    const char *word = c->text + from;
    size_t i;

    for (i = 0; word[i] && !isBlank(word[i]) && word[i] != '\''; i++) {
        if (i == QUOTE_SIZE - 4) {
            strcpy(quote + i, "...");
            return quote;
        }
        quote[i] = isprint((unsigned char)word[i]) ? word[i] : '?';
    }
    quote[i] = 0;
    return quote;
}

/* The value of a digit in any base up to 16; 16 for what is no digit. */
static unsigned digitValue(char digit)
{
    if (digit >= '0' && digit <= '9')
        return (unsigned)(digit - '0');
    if (digit >= 'a' && digit <= 'f')
        return (unsigned)(digit - 'a' + 10);
    if (digit >= 'A' && digit <= 'F')
        return (unsigned)(digit - 'A' + 10);
    return 16;
}

/* An octal number means something else than it seems to: accepted, but told. */
static void warnOctal(cursor *c, size_t start, epicsUInt64 value)
{
    if (c->at - start > 2 || value > 7)
        fail(c->error, start, "%.*s is octal and means %llu: write it without the leading 0",
             (int)(c->at - start > 20 ? 20 : c->at - start), c->text + start,
             (unsigned long long)value);
}

/* A number without sign: decimal, 0x hex, 0 octal; at most `max`. `what` names it in
 * messages. What follows the digits is the caller's business. */
static int parseNumber(cursor *c, const char *what, epicsUInt64 max, epicsUInt64 *value)
{
    char quote[QUOTE_SIZE];
    size_t start = c->at;
    unsigned base = 10;
    size_t first;

    if (here(c) == '0' && tolower((unsigned char)c->text[c->at + 1]) == 'x') {
        base = 16;
        c->at += 2;
    } else if (here(c) == '0') {
        base = 8;
    }
    *value = 0;
    for (first = c->at; digitValue(here(c)) < base; c->at++) {
        unsigned digit = digitValue(here(c));

        if (digit > max || *value > (max - digit) / base)
            return fail(c->error, start, "%s \"%s\" is too large: at most %llu", what,
                        wordFrom(c, start, quote), (unsigned long long)max);
        *value = *value * base + digit;
    }
    if (c->at == first)
        return fail(c->error, start,
                    "%s \"%s\" is no number; allowed: decimal or 0x hexadecimal", what,
                    wordFrom(c, start, quote));
    if (base == 8 && (here(c) == '8' || here(c) == '9'))
        return fail(c->error, start, "%s \"%s\": a leading 0 means octal, so no digit %c",
                    what, wordFrom(c, start, quote), here(c));
    if (base == 8)
        warnOctal(c, start, *value);
    return 0;
}

/* A sum of numbers: 20+3+2, with blanks around the + or without. `offset` and `R`. */
static int parseSum(cursor *c, const char *what, size_t *sum)
{
    const epicsUInt64 max = (size_t)-1;
    char quote[QUOTE_SIZE];
    size_t start = c->at;
    epicsUInt64 total = 0, value;

    for (;;) {
        size_t after;

        if (parseNumber(c, what, max, &value))
            return -1;
        if (value > max - total)
            return fail(c->error, start, "%s \"%s\" is too large: at most %llu", what,
                        wordFrom(c, start, quote), (unsigned long long)max);
        total += value;
        after = c->at;
        skipBlanks(c);
        if (here(c) != '+') {
            c->at = after;
            break;
        }
        c->at++;
        skipBlanks(c);
    }
    if (!atEnd(c))
        return fail(c->error, c->at, "%s \"%s\": only sums such as 4+2 are allowed", what,
                    wordFrom(c, start, quote));
    *sum = (size_t)total;
    return 0;
}

/* A limit: a number with or without sign, in the range of epicsInt64. */
static int parseLimit(cursor *c, const char *what, epicsInt64 *limit)
{
    char quote[QUOTE_SIZE];
    size_t start = c->at;
    int negative = here(c) == '-';
    epicsUInt64 value;

    if (here(c) == '-' || here(c) == '+')
        c->at++;
    if (parseNumber(c, what, (epicsUInt64)INT64_HIGHEST + negative, &value))
        return -1;
    if (!atEnd(c))
        return fail(c->error, c->at, "%s=%s is no whole number", what,
                    wordFrom(c, start, quote));
    *limit = (epicsInt64)(negative ? 0 - value : value);
    return 0;
}

static int parseT(cursor *c, plcLink *link)
{
    char quote[QUOTE_SIZE], types[100];
    size_t start = c->at;

    while (!atEnd(c))
        c->at++;
    link->type = plcTypeFind(c->text + start, c->at - start);
    if (link->type)
        return 0;
    plcTypeList(~0u, 8, types, sizeof(types));
    return fail(c->error, start, "T=%s is no data type; allowed: %s",
                wordFrom(c, start, quote), types);
}

static int parseL(cursor *c, plcLink *link)
{
    return parseLimit(c, "L", &link->low);
}

static int parseH(cursor *c, plcLink *link)
{
    return parseLimit(c, "H", &link->high);
}

static int parseB(cursor *c, plcLink *link)
{
    char quote[QUOTE_SIZE];
    size_t start = c->at;
    epicsUInt64 value;

    if (parseNumber(c, "B", UINT_MAX, &value))
        return -1;
    if (!atEnd(c))
        return fail(c->error, c->at, "B=%s is no bit number; allowed: 0 to 63",
                    wordFrom(c, start, quote));
    link->bit = (unsigned)value;
    return 0;
}

static int parseR(cursor *c, plcLink *link)
{
    return parseSum(c, "R", &link->readback);
}

static const struct {
    char letter;
    unsigned has;
    int (*parse)(cursor *c, plcLink *link);
    size_t column; /* offset of the option's column in plcLink */
} options[] = {
    {'T', plcHasT, parseT, offsetof(plcLink, column.T)},
    {'L', plcHasL, parseL, offsetof(plcLink, column.L)},
    {'H', plcHasH, parseH, offsetof(plcLink, column.H)},
    {'B', plcHasB, parseB, offsetof(plcLink, column.B)},
    {'R', plcHasR, parseR, offsetof(plcLink, column.R)},
};

#define NUM_OPTIONS (sizeof(options) / sizeof(options[0]))

/* One option, T=INT16. Blanks around the = do no harm. */
static int parseOption(cursor *c, plcLink *link)
{
    char quote[QUOTE_SIZE];
    char letter = (char)toupper((unsigned char)here(c));
    size_t start = c->at;
    size_t i;

    for (i = 0; i < NUM_OPTIONS && options[i].letter != letter; i++)
        ;
    c->at++;
    skipBlanks(c);
    if (i == NUM_OPTIONS || here(c) != '=')
        return fail(c->error, start, "unknown option \"%s\"; allowed: T= L= H= B= R=",
                    wordFrom(c, start, quote));
    c->at++;
    skipBlanks(c);
    if (here(c) == 0 || here(c) == '\'')
        return fail(c->error, c->at, "%c= has no value", letter);
    if (link->has & options[i].has)
        return fail(c->error, start, "%c= is given twice", letter);
    link->has |= options[i].has;
    *(size_t *)((char *)link + options[i].column) = start;
    return options[i].parse(c, link);
}

/* All options up to the end of the text; quotes around them may be there or not. */
static int parseOptions(cursor *c, plcLink *link)
{
    size_t quote = 0;

    for (;;) {
        skipBlanks(c);
        if (here(c) == 0) {
            if (c->quoted)
                return fail(c->error, quote, "the quote ' is not closed");
            return 0;
        }
        if (here(c) == '\'') {
            quote = c->at++;
            c->quoted = !c->quoted;
            continue;
        }
        if (parseOption(c, link))
            return -1;
    }
}

/* The station's name: up to the slash, or up to the end when there is no offset. */
static int parseStation(cursor *c, plcLink *link)
{
    size_t start, length;

    skipBlanks(c);
    if (here(c) == '@')
        c->at++;
    skipBlanks(c);
    start = c->at;
    while (here(c) && here(c) != '/' && !isBlank(here(c)))
        c->at++;
    length = c->at - start;
    if (length == 0)
        return fail(c->error, start, "no PLC name; a link is @PLCname/offset T=type");
    if (length > PLC_NAME_MAX)
        return fail(c->error, start, "the PLC name has %lu characters; allowed: %d",
                    (unsigned long)length, PLC_NAME_MAX);
    memcpy(link->station, c->text + start, length);
    link->station[length] = 0;
    return 0;
}

/* The slash and the offset behind the name. No offset is 0. */
static int parseOffset(cursor *c, plcLink *link)
{
    skipBlanks(c);
    if (here(c) != '/')
        return 0;
    c->at++;
    skipBlanks(c);
    link->column.offset = c->at;
    if (here(c) == 0 || here(c) == '\'' || isalpha((unsigned char)here(c)))
        return 0;
    return parseSum(c, "offset", &link->offset);
}

int plcLinkParse(const char *text, plcLink *link, plcLinkError *error)
{
    cursor c = {text ? text : "", 0, 0, error};
    size_t end = strlen(c.text);

    memset(link, 0, sizeof(*link));
    memset(error, 0, sizeof(*error));
    link->column.offset = link->column.T = link->column.L = end;
    link->column.H = link->column.B = link->column.R = end;
    if (parseStation(&c, link) || parseOffset(&c, link) || parseOptions(&c, link))
        return -1;
    return 0;
}

/* The type: what the link says, else the record type's default. */
static int completeType(plcLink *link, const plcShape *shape, plcLinkError *error)
{
    const plcType *type = link->type;
    char types[100];

    if (!(link->has & plcHasT))
        type = plcTypeFind(shape->defaultType, strlen(shape->defaultType));
    if (type && type->kind & shape->kinds &&
        (!(type->kind & plcInteger) || type->size <= shape->maxSize)) {
        link->type = type;
        return 0;
    }
    plcTypeList(shape->kinds, shape->maxSize, types, sizeof(types));
    return fail(error, link->column.T, "T=%s does not fit %s; allowed: %s",
                type ? type->name : shape->defaultType, shape->recordType, types);
}

/* L and H of an integer type, as given or as the type's default. */
static int completeLimits(plcLink *link, const plcType *type, plcLinkError *error)
{
    epicsInt64 low = type->low, high = type->high;

    if (type->size == 8) {
        low = type->kind == plcSigned ? -INT64_HIGHEST : 0;
        high = INT64_HIGHEST;
    }
    if (!(link->has & plcHasL))
        link->low = low;
    if (!(link->has & plcHasH))
        link->high = high;
    if (link->low < link->high)
        return 0;
    return fail(error, link->has & plcHasL ? link->column.L : link->column.H,
                "L=%lld H=%lld: L must be less than H", (long long)link->low,
                (long long)link->high);
}

/* L of a string: its length in bytes. */
static int completeString(plcLink *link, size_t length, plcLinkError *error)
{
    if (!(link->has & plcHasL))
        link->low = (epicsInt64)length;
    if (link->low >= 1)
        return 0;
    return fail(error, link->column.L,
                "L=%lld: the length of a T=STRING must be at least 1 byte",
                (long long)link->low);
}

int plcLinkComplete(plcLink *link, const plcShape *shape, size_t length,
                    plcLinkError *error)
{
    unsigned bits;

    memset(error, 0, sizeof(*error));
    if (completeType(link, shape, error))
        return -1;
    if (link->type->kind == plcString) {
        if (completeString(link, length, error))
            return -1;
    } else if (link->type->kind & plcInteger && shape->options & (plcHasL | plcHasH)) {
        if (completeLimits(link, link->type, error))
            return -1;
    }
    bits = 8 * link->type->size;
    if (shape->options & plcHasB && link->bit >= bits)
        return fail(error, link->column.B, "B=%u: %s has bits 0 to %u", link->bit,
                    link->type->name, bits - 1);
    if (link->has & plcHasR & ~shape->options)
        return fail(error, link->column.R, "R= (read-back) is for output records, not %s",
                    shape->recordType);
    return 0;
}
