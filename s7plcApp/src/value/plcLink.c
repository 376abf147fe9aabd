/* The text of an INP or OUT link taken apart, and completed by what the record type
 * allows.
 *
 * Knows the data types, but no station, no record and no block size. All numbers are
 * checked for overflow; no text, however malformed, is read beyond its end.
 */
#include <ctype.h>
#include <stdarg.h>
#include <string.h>

#include <epicsStdio.h>
#include <epicsString.h>

#include "plcLink.h"
#include "plcOtherTypes.h"

#define INT64_HIGHEST 0x7FFFFFFFFFFFFFFFLL
#define QUOTE_SIZE 33 /* characters of the link in a message, with the terminator */

/* The place in the text where we are. */
typedef struct cursor {
    const char *text;
    size_t at;
    plcLinkError *error;
} cursor;

int plcLinkFail(plcLinkError *error, size_t column, const char *format, ...)
{
    va_list args;

    error->column = column;
    va_start(args, format);
    epicsVsnprintf(error->text, sizeof(error->text), format, args);
    va_end(args);
    return -1;
}

void plcLinkWarn(plcLinkError *error, size_t column, const char *format, ...)
{
    va_list args;

    if (error->text[0])
        return;
    error->column = column;
    va_start(args, format);
    epicsVsnprintf(error->text, sizeof(error->text), format, args);
    va_end(args);
}

static char here(const cursor *c)
{
    return c->text[c->at];
}

static int isBlank(char x)
{
    return isspace((unsigned char)x);
}

static int isDigit(char x)
{
    return x >= '0' && x <= '9';
}

static void skipBlanks(cursor *c)
{
    while (isBlank(here(c)))
        c->at++;
}

/* True where an option begins: its letter and the =. */
static int atOption(const char *text)
{
    return text[0] && strchr("TLHBRWtlhbrw", text[0]) && text[1] == '=';
}

/* True where a number or a word may end. Options need no blank between them. */
static int atEnd(const cursor *c)
{
    return here(c) == 0 || isBlank(here(c)) || here(c) == '\'' ||
           atOption(c->text + c->at);
}

/* The word from column `from` up to the next blank, fit to be printed in a message. */
static const char *wordFrom(const cursor *c, size_t from, char quote[QUOTE_SIZE])
{
    const char *word = c->text + from;
    size_t i;

    for (i = 0; word[i] && !isBlank(word[i]); i++) {
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
    if (isDigit(digit))
        return (unsigned)(digit - '0');
    if (digit >= 'a' && digit <= 'f')
        return (unsigned)(digit - 'a' + 10);
    if (digit >= 'A' && digit <= 'F')
        return (unsigned)(digit - 'A' + 10);
    return 16;
}

/* The base that the beginning of a number says: decimal, 0x hex or 0 octal. */
static unsigned takeBase(cursor *c)
{
    if (here(c) != '0')
        return 10;
    if (c->text[c->at + 1] != 'x' && c->text[c->at + 1] != 'X')
        return 8;
    c->at += 2;
    return 16;
}

/* A number without sign, at most `max`. `what` names it in messages. What follows the
 * digits is the caller's business. */
static int parseNumber(cursor *c, const char *what, epicsUInt64 max, epicsUInt64 *value)
{
    char quote[QUOTE_SIZE];
    size_t start = c->at;
    unsigned base = takeBase(c);
    size_t first = c->at;

    for (*value = 0; digitValue(here(c)) < base; c->at++) {
        unsigned digit = digitValue(here(c));

        if (*value > max / base || *value * base > max - digit)
            return plcLinkFail(c->error, start, "%s \"%s\" is too large; allowed: up to %llu",
                               what, wordFrom(c, start, quote), (unsigned long long)max);
        *value = *value * base + digit;
    }
    if (c->at == first)
        return plcLinkFail(c->error, start,
                           "%s \"%s\" is no number; allowed: such as 20 or 0x14", what,
                           wordFrom(c, start, quote));
    if (base == 8 && isDigit(here(c)))
        return plcLinkFail(c->error, c->at,
                           "%s \"%s\": a leading 0 means octal, without digit %c", what,
                           wordFrom(c, start, quote), here(c));
    if (base == 8 && *value > 7)
        plcLinkWarn(c->error, start, "%s \"%s\" is octal because of its leading 0: %llu", what,
                    wordFrom(c, start, quote), (unsigned long long)*value);
    return 0;
}

/* One number of a sum, which may be negative. Blanks before it have been skipped. */
static int addNumber(cursor *c, const char *what, epicsInt64 *sum)
{
    const epicsUInt64 sizeMax = (size_t)-1;
    const epicsUInt64 max = sizeMax > INT64_HIGHEST ? INT64_HIGHEST : sizeMax;
    size_t start = c->at;
    int negative = here(c) == '-';
    epicsUInt64 value;

    if (negative)
        c->at++;
    if (parseNumber(c, what, max, &value))
        return -1;
    if (!negative && *sum > 0 && value > max - (epicsUInt64)*sum)
        return plcLinkFail(c->error, start, "the sum is too large; allowed: up to %llu",
                           (unsigned long long)max);
    if (negative && *sum < 0 && value > (epicsUInt64)(INT64_HIGHEST + *sum))
        return plcLinkFail(c->error, start, "the sum is too small; allowed: 0 and more");
    *sum += negative ? -(epicsInt64)value : (epicsInt64)value;
    return 0;
}

/* A sum of numbers, 20+3+2, for an offset and R=. Blanks may follow a +. Macros that are
 * empty leave a + without a number: 20++2, 20+. */
static int parseSum(cursor *c, const char *what, size_t *result, size_t *open)
{
    char quote[QUOTE_SIZE];
    size_t start = c->at, after, plus;
    epicsInt64 sum = 0;

    if (here(c) != '+' && here(c) != '-' && !isDigit(here(c)))
        return plcLinkFail(c->error, start,
                           "%s \"%s\" is no number; allowed: such as 20 or 20+2", what,
                           wordFrom(c, start, quote));
    for (;;) {
        if ((here(c) == '-' || isDigit(here(c))) && addNumber(c, what, &sum))
            return -1;
        if (here(c) != '+')
            break;
        plus = c->at++;
        skipBlanks(c);
        if (here(c) != '-' && !isDigit(here(c)))
            *open = plus;
        if (atOption(c->text + c->at))
            break;
    }
    if (!atEnd(c) && !(c->at > start && isBlank(c->text[c->at - 1])))
        return plcLinkFail(c->error, c->at, "%s \"%s\": only sums such as 4+2 are allowed", what,
                           wordFrom(c, start, quote));
    after = c->at;
    skipBlanks(c);
    if (here(c) == '+')
        return plcLinkFail(c->error, c->at, "no blank is allowed before the + of %s", what);
    c->at = after;
    if (sum < 0)
        return plcLinkFail(c->error, start, "%s %lld is negative; allowed: 0 and more", what,
                           (long long)sum);
    *result = (size_t)sum;
    return 0;
}

/* A number with or without sign in the range of epicsInt64: L, H, B. Nothing is 0. */
static int parseSigned(cursor *c, char letter, epicsInt64 *result)
{
    const char what[] = {letter, '=', 0};
    char quote[QUOTE_SIZE];
    size_t start = c->at;
    epicsUInt64 value;
    int negative;

    *result = 0;
    skipBlanks(c);
    negative = here(c) == '-';
    if (!negative && here(c) != '+' && !isDigit(here(c))) {
        c->at = start;
        if (!atEnd(c))
            return plcLinkFail(c->error, start,
                               "%s%s is no number; allowed: such as %s20 or %s0x14", what,
                               wordFrom(c, start, quote), what, what);
        plcLinkWarn(c->error, start, "%s has no value: taken as 0", what);
        return 0;
    }
    start = c->at;
    if (negative || here(c) == '+')
        c->at++;
    if (parseNumber(c, what, (epicsUInt64)INT64_HIGHEST + negative, &value))
        return -1;
    if (!atEnd(c))
        return plcLinkFail(c->error, c->at, "%s%s is no whole number", what,
                           wordFrom(c, start, quote));
    *result = (epicsInt64)(negative ? 0 - value : value);
    return 0;
}

static int parseT(cursor *c, plcLink *link)
{
    char quote[QUOTE_SIZE], types[160];
    size_t start = c->at;

    while (!atEnd(c))
        c->at++;
    if (c->at == start)
        return plcLinkFail(c->error, start, "T= has no value; allowed: such as T=INT16");
    link->type = plcTypeFind(c->text + start, c->at - start);
    if (link->type)
        return 0;
    if (!plcOtherType(c->text + start, c->at - start, types, sizeof(types)))
        plcTypeList(~0u, 8, types, sizeof(types));
    return plcLinkFail(c->error, start, "T=%s is no data type; allowed: %s",
                       wordFrom(c, start, quote), types);
}

static int parseL(cursor *c, plcLink *link)
{
    return parseSigned(c, 'L', &link->low);
}

static int parseH(cursor *c, plcLink *link)
{
    return parseSigned(c, 'H', &link->high);
}

static int parseB(cursor *c, plcLink *link)
{
    size_t start = c->at;
    epicsInt64 bit;

    if (parseSigned(c, 'B', &bit))
        return -1;
    if (bit < 0 || bit > 63)
        return plcLinkFail(c->error, start, "B=%lld is no bit number; allowed: 0 to 63",
                           (long long)bit);
    link->bit = (unsigned)bit;
    return 0;
}

static int parseR(cursor *c, plcLink *link)
{
    skipBlanks(c);
    return parseSum(c, "R=", &link->readback, &link->column.open);
}

static int parseW(cursor *c, plcLink *link)
{
    static const struct {
        const char *word;
        int high, bigEndian, text;
    } orders[] = {
        {"low",  0,  -1, -1         },
        {"high", 1,  -1, -1         },
        {"ABCD", 1,  1,  plcTextABCD},
        {"CDAB", 0,  1,  plcTextCDAB},
        {"BADC", 1,  0,  plcTextBADC},
        {"DCBA", 0,  0,  plcTextDCBA},
        {"A0",   -1, -1, plcTextA0  },
        {"0A",   -1, -1, plcText0A  },
    };
    unsigned i;
    char quote[QUOTE_SIZE];
    size_t start = c->at;

    while (!atEnd(c))
        c->at++;
    if (c->at == start)
        return plcLinkFail(c->error, start,
                           "W= has no value; allowed: W=" PLC_WORD_ORDERS ", for texts " PLC_TEXT_ORDERS);
    for (i = 0; i < sizeof(orders) / sizeof(orders[0]); i++) {
        if (strlen(orders[i].word) != c->at - start ||
            epicsStrnCaseCmp(c->text + start, orders[i].word, c->at - start))
            continue;
        link->highWordFirst = orders[i].high;
        link->wordBigEndian = orders[i].bigEndian;
        link->textOrder = orders[i].text;
        return 0;
    }
    return plcLinkFail(c->error, start,
                       "W=%s is no word order; allowed: W=" PLC_WORD_ORDERS ", for texts " PLC_TEXT_ORDERS,
                       wordFrom(c, start, quote));
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
    {'W', plcHasW, parseW, offsetof(plcLink, column.W)},
};

/* One option, T=INT16. When it comes twice, the last one counts. */
static int parseOption(cursor *c, plcLink *link)
{
    char quote[QUOTE_SIZE];
    char letter = (char)toupper((unsigned char)here(c));
    size_t start = c->at, i = 0;

    if (!atOption(c->text + start))
        return plcLinkFail(c->error, start, "unknown option \"%s\"; allowed: T= L= H= B= R= W=",
                           wordFrom(c, start, quote));
    while (options[i].letter != letter)
        i++;
    if (link->has & options[i].has)
        plcLinkWarn(c->error, start, "%c= is given twice: the last one counts", letter);
    link->has |= options[i].has;
    *(size_t *)((char *)link + options[i].column) = start;
    c->at += 2;
    return options[i].parse(c, link);
}

/* All options up to the end of the text, or all up to the closing quote. */
static int parseOptions(cursor *c, plcLink *link)
{
    size_t quote;

    skipBlanks(c);
    quote = c->at;
    if (here(c) == '\'')
        c->at++;
    for (;;) {
        skipBlanks(c);
        if (here(c) == 0)
            break;
        if (here(c) == '\'') {
            if (c->text[quote] != '\'')
                return plcLinkFail(c->error, c->at,
                                   "a quote ' is allowed only around all options");
            c->at++;
            skipBlanks(c);
            if (here(c))
                plcLinkWarn(c->error, c->at, "what follows the closing quote ' is ignored");
            return 0;
        }
        if (parseOption(c, link))
            return -1;
    }
    if (c->text[quote] == '\'')
        plcLinkWarn(c->error, quote, "the quote ' is not closed");
    return 0;
}

/* The station's name, up to the slash. */
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
        return plcLinkFail(c->error, start, "no PLC name; allowed: @PLCname/offset T=type ...");
    if (length > PLC_NAME_MAX)
        return plcLinkFail(c->error, start, "the PLC name is too long; allowed: %d characters",
                           PLC_NAME_MAX);
    memcpy(link->station, c->text + start, length);
    link->station[length] = 0;
    return 0;
}

/* The slash and the offset behind the name. Nothing at all is offset 0. */
static int parseOffset(cursor *c, plcLink *link)
{
    char quote[QUOTE_SIZE];

    skipBlanks(c);
    if (here(c) == 0)
        return 0;
    if (here(c) != '/')
        return plcLinkFail(c->error, c->at, "\"/\" expected before \"%s\", as in @%.40s/0",
                           wordFrom(c, c->at, quote), link->station);
    c->at++;
    skipBlanks(c);
    link->column.offset = c->at;
    if (here(c) == 0 || here(c) == '\'' || atOption(c->text + c->at))
        return 0;
    return parseSum(c, "offset", &link->offset, &link->column.open);
}

int plcLinkParse(const char *text, plcLink *link, plcLinkError *error)
{
    cursor c = {text ? text : "", 0, error};
    size_t end = strlen(c.text);

    memset(link, 0, sizeof(*link));
    memset(error, 0, sizeof(*error));
    link->column.offset = link->column.T = link->column.L = end;
    link->column.H = link->column.B = link->column.R = link->column.W = end;
    link->column.open = PLC_NO_COLUMN;
    if (parseStation(&c, link) || parseOffset(&c, link) || parseOptions(&c, link))
        return -1;
    return 0;
}
