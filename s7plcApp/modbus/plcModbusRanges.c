/* The ranges of a Modbus PLC from the text of a command; see plcModbusPlan.h. */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>
#include <epicsString.h>

#include "plcModbusPlan.h"

#define TABLE_SIZE 65536u /* registers or bits in a table */
#define IMAGE_MAX ((size_t)16 << 20) /* bytes: a larger image is a typing error */

enum { periodDefault = 100, periodMax = 3600000 }; /* ms */

static const char *const tableNames[] = {"holding", "input", "coils", "discrete"};

const char *plcTableName(plcTable table)
{
    return tableNames[table];
}

size_t plcRangeBytes(const plcRange *range)
{
    if (range->table == plcHolding || range->table == plcInputRegisters)
        return (size_t)range->count * 2;
    return ((size_t)range->count + 7) / 8;
}

/* A piece of the text, not terminated. */
typedef struct span {
    const char *text;
    size_t length;
} span;

typedef struct parser {
    int output;
    unsigned number; /* of the range, from 1 */
    span item;       /* its text */
    char *error;
    size_t errorSize;
} parser;

static int isBlank(char c)
{
    return c == ' ' || c == '\t' || c == '\n' || c == '\r';
}

/* Takes the next word from *rest; length 0: there is none. */
static span nextWord(span *rest)
{
    span word;

    while (rest->length && isBlank(*rest->text))
        rest->text++, rest->length--;
    word.text = rest->text;
    while (rest->length && !isBlank(*rest->text))
        rest->text++, rest->length--;
    word.length = rest->text - word.text;
    return word;
}

static span trim(span s)
{
    while (s.length && isBlank(*s.text))
        s.text++, s.length--;
    while (s.length && isBlank(s.text[s.length - 1]))
        s.length--;
    return s;
}

static int same(span word, const char *text)
{
    return word.length == strlen(text) &&
           epicsStrnCaseCmp(word.text, text, word.length) == 0;
}

/* What a message shows of a text that may be long. */
static int shown(span s)
{
    return (int)(s.length > 60 ? 60 : s.length);
}

/* One line: which range, what is wrong. Returns -1. */
static int refuse(const parser *p, const char *format, ...)
{
    char what[200];
    va_list args;

    va_start(args, format);
    epicsVsnprintf(what, sizeof(what), format, args);
    va_end(args);
    epicsSnprintf(p->error, p->errorSize, "range %u \"%.*s\": %s", p->number,
                  shown(p->item), p->item.text, what);
    return -1;
}

/* A word: decimal, or hexadecimal with 0x. Returns 0, or -1 when it is no number up to max. */
static int parseNumber(span word, unsigned long max, unsigned long *value)
{
    unsigned base = 10;
    size_t i = 0;

    if (word.length > 2 && word.text[0] == '0' && (word.text[1] | 0x20) == 'x') {
        base = 16;
        i = 2;
    }
    for (*value = 0; i < word.length; i++) {
        char c = word.text[i];
        unsigned digit = c >= '0' && c <= '9'                     ? (unsigned)(c - '0')
                         : (c | 0x20) >= 'a' && (c | 0x20) <= 'f' ? (c | 0x20) - 'a' + 10u
                                                                  : 16u;

        if (digit >= base)
            return -1;
        *value = *value * base + digit;
        if (*value > max)
            return -1;
    }
    return 0;
}

/* The next word as a number. Returns 0, or -1 with a message. */
static int takeNumber(const parser *p, span *rest, const char *name, unsigned long min,
                      unsigned long max, const char *unit, unsigned long *value)
{
    span word = nextWord(rest);

    if (word.length == 0)
        return refuse(p, "%s is missing; allowed: %lu to %lu%s", name, min, max, unit);
    if (parseNumber(word, max, value) || *value < min)
        return refuse(p, "%s \"%.*s\"; allowed: %lu to %lu%s", name, shown(word),
                      word.text, min, max, unit);
    return 0;
}

/* 40001, 400001, 4xxxx: the reference numbers of manuals. */
static int isReference(span word)
{
    size_t i;

    for (i = 0; i < word.length && ((word.text[i] >= '0' && word.text[i] <= '9') ||
                                (i > 0 && (word.text[i] | 0x20) == 'x')); i++)
        ;
    return i == word.length && (i == 5 || i == 6);
}

static int takeTable(const parser *p, span *rest, plcTable *table)
{
    const char *allowed =
        p->output ? "holding, coils" : "holding, input, coils, discrete";
    span word = nextWord(rest);
    int i;

    if (word.length == 0)
        return refuse(p, "it is empty; allowed: %s start count [at offset]%s [unit n]",
                      p->output ? "holding|coils" : "holding|input|coils|discrete",
                      p->output ? "" : " [every ms]");
    for (i = plcHolding; i <= plcDiscrete; i++)
        if (same(word, tableNames[i]) &&
            (!p->output || i == plcHolding || i == plcCoils)) {
            *table = (plcTable)i;
            return 0;
        }
    if (isReference(word))
        return refuse(p, "table \"%.*s\": 4xxxx is holding, 3xxxx input, 1xxxx discrete, 0xxxx "
                      "coils, and they count from 1: 40001 is \"holding 0\"", shown(word),
                      word.text);
    return refuse(p, "table \"%.*s\"; allowed: %s", shown(word), word.text, allowed);
}

/* "at offset", "every ms", "unit n", in any order, each once. Returns 0, or -1 with a message. */
static int takeExtras(const parser *p, span *rest, plcRange *range)
{
    int at = 0, every = 0, unit = 0;
    unsigned long value = 0;
    span word;

    while ((word = nextWord(rest)).length) {
        if (same(word, "at") && !at++) {
            if (takeNumber(p, rest, "offset", 0, IMAGE_MAX, " bytes", &value))
                return -1;
            range->offset = value;
        } else if (same(word, "every") && !p->output && !every++) {
            if (takeNumber(p, rest, "period", 1, periodMax, " ms", &value))
                return -1;
            range->period = (unsigned)value;
        } else if (same(word, "unit") && !unit++) {
            if (takeNumber(p, rest, "unit", 0, 255, "", &value))
                return -1;
            range->unit = (int)value + 1;
        } else {
            return refuse(
                p, "\"%.*s\"; allowed here: at offset, %sunit n, each once%s", shown(word),
                word.text, p->output ? "" : "every ms, ",
                p->output ? " (outputs are not polled)" : "");
        }
    }
    return 0;
}

static int overlap(size_t a, size_t aLength, size_t b, size_t bLength)
{
    return a < b + bLength && b < a + aLength;
}

/* Against the ranges before it. Returns 0, or -1 with a message. */
static int checkPlace(const parser *p, const plcRange *ranges, const plcRange *range)
{
    size_t bytes = plcRangeBytes(range);
    unsigned i;

    if (range->offset > IMAGE_MAX || bytes > IMAGE_MAX - range->offset)
        return refuse(p, "it ends behind byte %lu of the image; allowed: up to there",
                      (unsigned long)IMAGE_MAX);
    for (i = 0; i + 1 < p->number; i++) {
        const plcRange *other = &ranges[i];

        if (overlap(range->offset, bytes, other->offset, plcRangeBytes(other)))
            return refuse(p,
                          "its bytes %lu to %lu overlap range %u; allowed: bytes that no "
                          "other range has",
                          (unsigned long)range->offset,
                          (unsigned long)(range->offset + bytes - 1), i + 1);
        if (p->output && range->table == other->table && range->unit == other->unit &&
            overlap(range->start, range->count, other->start, other->count))
            return refuse(p, "it writes the same %s as range %u; allowed: each one once",
                          range->table == plcCoils ? "coils" : "registers", i + 1);
    }
    return 0;
}

static int unitOf(const plcRange *range, int unit)
{
    return range->unit == PLC_UNIT_OF_PLC ? unit : range->unit - 1;
}

void plcRangeDoubt(const plcRange *ranges, unsigned i, int unit, char *text, size_t size)
{
    const plcRange *r = &ranges[i];
    int registers = r->table == plcHolding || r->table == plcInputRegisters;
    unsigned j, first, last;

    text[0] = 0;
    for (j = 0; j < i; j++) {
        const plcRange *o = &ranges[j];

        if (o->table != r->table || unitOf(o, unit) != unitOf(r, unit) ||
            !overlap(r->start, r->count, o->start, o->count))
            continue;
        first = r->start > o->start ? r->start : o->start;
        last = r->start + r->count < o->start + o->count ? r->start + r->count
                                                         : o->start + o->count;
        epicsSnprintf(text, size, "range %u has %s %u to %u once more: they are in range %u too",
                      i + 1, tableNames[r->table], first, last - 1, j + 1);
        return;
    }
    if (registers && r->offset & 1)
        epicsSnprintf(text, size, "range %u has its registers at an odd byte, %lu: usual are even ones",
                      i + 1, (unsigned long)r->offset);
}

/* One range. `ranges` holds those before it. Returns 0, or -1 with a message. */
static int parseRange(const parser *p, const plcRange *ranges, plcRange *range)
{
    const plcRange *before = p->number > 1 ? range - 1 : NULL;
    span rest = p->item;
    unsigned long value = 0;

    if (takeTable(p, &rest, &range->table) ||
        takeNumber(p, &rest, "start", 0, TABLE_SIZE - 1, "", &value))
        return -1;
    range->start = (unsigned)value;
    if (takeNumber(p, &rest, "count", 1, TABLE_SIZE - range->start, "", &value))
        return -1;
    range->count = (unsigned)value;
    range->offset = before ? before->offset + plcRangeBytes(before) : 0;
    if (range->table == plcHolding || range->table == plcInputRegisters)
        range->offset += range->offset & 1;
    range->unit = PLC_UNIT_OF_PLC;
    range->period = p->output ? 0 : periodDefault;
    if (takeExtras(p, &rest, range))
        return -1;
    return checkPlace(p, ranges, range);
}

int plcRangesParse(const char *text, int output, plcRange **ranges, size_t *size,
                   char *error, size_t errorSize)
{
    parser p = {.output = output, .error = error, .errorSize = errorSize};
    const char *end = text ? text + strlen(text) : NULL;
    unsigned room = 1;
    const char *c;

    *ranges = NULL;
    *size = 0;
    if (!text || trim((span){text, end - text}).length == 0)
        return 0;
    for (c = text; *c; c++)
        room += *c == ',';
    *ranges = callocMustSucceed(room, sizeof(**ranges), "plcRangesParse");
    for (; text <= end; text += strcspn(text, ",") + 1) {
        plcRange *range = &(*ranges)[p.number++];

        p.item = trim((span){text, strcspn(text, ",")});
        if (parseRange(&p, *ranges, range)) {
            free(*ranges);
            *ranges = NULL;
            *size = 0;
            return -1;
        }
        if (range->offset + plcRangeBytes(range) > *size)
            *size = range->offset + plcRangeBytes(range);
        if (!text[strcspn(text, ",")])
            break;
    }
    return (int)p.number;
}
