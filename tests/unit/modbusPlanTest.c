/* What a Modbus PLC is asked: texts of ranges, good, bad and random; the reads of thousands of
 * random sets of ranges against a simple reference; writes of random masks. */
#include <stdlib.h>
#include <string.h>

#include <epicsStdio.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcModbusPlan.h"

#define COUNT(table) (sizeof(table) / sizeof(table[0]))

static const plcLimits standard = {0, 0};

/* Same numbers in each run. */
static epicsUInt32 seed = 1;

static unsigned randomBelow(unsigned n)
{
    seed = seed * 1664525u + 1013904223u;
    return (seed >> 8) % n;
}

/* --- The text --------------------------------------------------------------------- */

static const struct {
    const char *what, *text;
    int output;
    size_t size;
    int count;
    plcRange ranges[4];
} texts[] = {
    {"no text",                      NULL,                           0, 0,      0, {{0}}                              },
    {"an empty text",                "",                             1, 0,      0, {{0}}                              },
    {"blanks only",                  " \t ",                         0, 0,      0, {{0}}                              },
    {"a range",                      "holding 0 100",                0, 200,    1, {{plcHolding, 0, 100, 0, 100, 0}}     },
    {"a range with a period",        "input 5 1 every 1",            0, 2,      1, {{plcInputRegisters, 5, 1, 0, 1, 0}}  },
    {"a range at a place",           "coils 8 9 at 3",               0, 5,      1, {{plcCoils, 8, 9, 3, 100, 0}}         },
    {"place, then period",           "discrete 1 8 at 1 every 7",    0, 2,      1, {{plcDiscrete, 1, 8, 1, 7, 0}}        },
    {"period, then place",           "discrete 1 8 every 7 at 1",    0, 2,      1, {{plcDiscrete, 1, 8, 1, 7, 0}}        },
    {"capitals",                     "HOLDING 1 2 AT 4 EVERY 5",     0, 8,      1, {{plcHolding, 1, 2, 4, 5, 0}}         },
    {"hexadecimal numbers",          "holding 0x10 0X0a",            0, 20,     1, {{plcHolding, 16, 10, 0, 100, 0}}     },
    {"capital digits",               "holding 0xFA 1",               0, 2,      1, {{plcHolding, 250, 1, 0, 100, 0}}    },
    {"leading zeros are decimal",    "holding 010 010",              0, 20,     1, {{plcHolding, 10, 10, 0, 100, 0}}     },
    {"the last register",            "holding 65535 1",              0, 2,      1, {{plcHolding, 65535, 1, 0, 100, 0}}   },
    {"a whole table",                "input 0 65536",                0, 131072, 1, {{plcInputRegisters, 0, 65536, 0, 100, 0}}},
    {"blanks and line ends",         "  holding\t0  1 ,\n coils 0 1 ", 0, 3,    2,
     {{plcHolding, 0, 1, 0, 100, 0}, {plcCoils, 0, 1, 2, 100, 0}}                                                           },
    {"the example of the design",
     "holding 0 100 every 100, input 0 20, coils 0 64 at 300 every 500",                            0, 308,    3,
     {{plcHolding, 0, 100, 0, 100, 0}, {plcInputRegisters, 0, 20, 200, 100, 0}, {plcCoils, 0, 64, 300, 500, 0}}                },
    {"registers behind an odd byte", "coils 0 3,holding 0 1,discrete 0 1,coils 9 1",                0, 6,      4,
     {{plcCoils, 0, 3, 0, 100, 0}, {plcHolding, 0, 1, 2, 100, 0}, {plcDiscrete, 0, 1, 4, 100, 0}, {plcCoils, 9, 1, 5, 100, 0}}   },
    {"an odd place that was asked for", "holding 0 1 at 3",          0, 5,      1, {{plcHolding, 0, 1, 3, 100, 0}}       },
    {"a range before the one before", "holding 0 2 at 4, holding 9 2 at 0",                         0, 8,      2,
     {{plcHolding, 0, 2, 4, 100, 0}, {plcHolding, 9, 2, 0, 100, 0}}                                                         },
    {"input registers twice",        "input 0 2, input 0 2",         0, 8,      2,
     {{plcInputRegisters, 0, 2, 0, 100, 0}, {plcInputRegisters, 0, 2, 4, 100, 0}}                                           },
    {"outputs have no period",       "holding 0 2, coils 0 2",       1, 5,      2,
     {{plcHolding, 0, 2, 0, 0, 0}, {plcCoils, 0, 2, 4, 0, 0}}                                                               },
};

static void testTexts(void)
{
    size_t i;

    for (i = 0; i < COUNT(texts); i++) {
        plcRange *ranges;
        size_t size;
        char error[300] = "";
        int j, count = plcRangesParse(texts[i].text, texts[i].output, &ranges, &size, error,
                                      sizeof(error));
        int good = count == texts[i].count && size == texts[i].size && (count > 0) == !!ranges;

        for (j = 0; good && j < count; j++) {
            const plcRange *a = &ranges[j], *b = &texts[i].ranges[j];

            good = a->table == b->table && a->start == b->start && a->count == b->count &&
                   a->offset == b->offset && a->period == b->period;
        }
        testOk(good, "%s: %d ranges, %lu bytes%s", texts[i].what, count, (unsigned long)size,
               error);
        free(ranges);
    }
}

static const struct {
    const char *text;
    int output;
    const char *error;
} badTexts[] = {
    {",", 0, "range 1 \"\": it is empty; allowed: holding|input|coils|discrete start count [at offset] [every ms] [unit n]"},
    {"holding 0 1,", 0, "range 2 \"\": it is empty; allowed: holding|input|coils|discrete start count [at offset] [every ms] [unit n]"},
    {"holding 0 1, ,", 1, "range 2 \"\": it is empty; allowed: holding|coils start count [at offset] [unit n]"},
    {"registers 0 1", 0, "range 1 \"registers 0 1\": table \"registers\"; allowed: holding, input, coils, discrete"},
    {"hold 0 1", 0, "range 1 \"hold 0 1\": table \"hold\"; allowed: holding, input, coils, discrete"},
    {"holding 0 1, input 0 1", 1, "range 2 \"input 0 1\": table \"input\"; allowed: holding, coils"},
    {"discrete 0 1", 1, "range 1 \"discrete 0 1\": table \"discrete\"; allowed: holding, coils"},
    {"holding", 0, "range 1 \"holding\": start is missing; allowed: 0 to 65535"},
    {"holding 1", 0, "range 1 \"holding 1\": count is missing; allowed: 1 to 65535"},
    {"40001 10", 0,
     "range 1 \"40001 10\": table \"40001\": 4xxxx is holding, 3xxxx input, 1xxxx discrete, 0xxxx coils, "
     "and they count from 1: 40001 is \"holding 0\""},
    {"holding -1 1", 0, "range 1 \"holding -1 1\": start \"-1\"; allowed: 0 to 65535"},
    {"holding 65536 1", 0, "range 1 \"holding 65536 1\": start \"65536\"; allowed: 0 to 65535"},
    {"holding 1.5 1", 0, "range 1 \"holding 1.5 1\": start \"1.5\"; allowed: 0 to 65535"},
    {"holding 0x 1", 0, "range 1 \"holding 0x 1\": start \"0x\"; allowed: 0 to 65535"},
    {"holding 0a 1", 0, "range 1 \"holding 0a 1\": start \"0a\"; allowed: 0 to 65535"},
    {"holding 99999999999999999999999 1", 0,
     "range 1 \"holding 99999999999999999999999 1\": start \"99999999999999999999999\"; allowed: 0 to 65535"},
    {"holding 0 0000000000000000000000000000000000000000000000000000000000000001x", 0,
     "range 1 \"holding 0 00000000000000000000000000000000000000000000000000\": "
     "count \"000000000000000000000000000000000000000000000000000000000000\"; allowed: 1 to 65536"},
    {"holding 0 0", 0, "range 1 \"holding 0 0\": count \"0\"; allowed: 1 to 65536"},
    {"holding 65535 2", 0, "range 1 \"holding 65535 2\": count \"2\"; allowed: 1 to 1"},
    {"holding 0 1 at", 0, "range 1 \"holding 0 1 at\": offset is missing; allowed: 0 to 16777216 bytes"},
    {"holding 0 1 at x", 0, "range 1 \"holding 0 1 at x\": offset \"x\"; allowed: 0 to 16777216 bytes"},
    {"holding 0 1 at 16777215", 0,
     "range 1 \"holding 0 1 at 16777215\": it ends behind byte 16777216 of the image; allowed: up to there"},
    {"holding 0 1 every 0", 0, "range 1 \"holding 0 1 every 0\": period \"0\"; allowed: 1 to 3600000 ms"},
    {"holding 0 1 every 3600001", 0, "range 1 \"holding 0 1 every 3600001\": period \"3600001\"; allowed: 1 to 3600000 ms"},
    {"holding 0 1 each 100", 0, "range 1 \"holding 0 1 each 100\": \"each\"; allowed here: at offset, every ms, unit n, each once"},
    {"holding 0 1 at 0 at 0", 0, "range 1 \"holding 0 1 at 0 at 0\": \"at\"; allowed here: at offset, every ms, unit n, each once"},
    {"holding 0 1 every 100", 1,
     "range 1 \"holding 0 1 every 100\": \"every\"; allowed here: at offset, unit n, each once (outputs are not polled)"},
    {"holding 0 1; input 0 1", 0, "range 1 \"holding 0 1; input 0 1\": count \"1;\"; allowed: 1 to 65536"},
    {"holding 0 4, input 0 1 at 6", 0,
     "range 2 \"input 0 1 at 6\": its bytes 6 to 7 overlap range 1; allowed: bytes that no other range has"},
    {"coils 0 9 at 4, holding 0 4 at 0", 0,
     "range 2 \"holding 0 4 at 0\": its bytes 0 to 7 overlap range 1; allowed: bytes that no other range has"},
    {"holding 0 4, coils 0 4, holding 3 1", 1,
     "range 3 \"holding 3 1\": it writes the same registers as range 1; allowed: each one once"},
    {"coils 0 4, coils 3 1", 1, "range 2 \"coils 3 1\": it writes the same coils as range 1; allowed: each one once"},
};

static void testBadTexts(void)
{
    size_t i;

    for (i = 0; i < COUNT(badTexts); i++) {
        plcRange *ranges = (plcRange *)&ranges;
        size_t size = 1;
        char error[300] = "";
        int count = plcRangesParse(badTexts[i].text, badTexts[i].output, &ranges, &size, error,
                                   sizeof(error));

        if (!testOk(count == -1 && !ranges && strcmp(error, badTexts[i].error) == 0,
                    "\"%s\" is refused", badTexts[i].text))
            testDiag("%d: %s", count, error);
        free(ranges);
    }
}

/* Allowed, with a line about the last range; the unit of the PLC is 1. */
static const struct {
    const char *text;
    int output;
    const char *doubt;
} doubts[] = {
    {"holding 0 4", 0, ""},
    {"holding 0 4 at 2, coils 0 9 at 11", 0, ""},
    {"holding 0 4 at 1", 0, "range 1 has its registers at an odd byte, 1: usual are even ones"},
    {"input 0 4 at 3", 0, "range 1 has its registers at an odd byte, 3: usual are even ones"},
    {"holding 0 4 at 7", 1, "range 1 has its registers at an odd byte, 7: usual are even ones"},
    {"holding 0 10, holding 5 10", 0, "range 2 has holding 5 to 9 once more: they are in range 1 too"},
    {"holding 5 10, input 0 20, holding 0 100", 0, "range 3 has holding 5 to 14 once more: they are in range 1 too"},
    {"coils 0 9, coils 8 1 at 9", 0, "range 2 has coils 8 to 8 once more: they are in range 1 too"},
    {"holding 0 10, holding 10 10", 0, ""},
    {"holding 0 10, input 0 10", 0, ""},
    {"holding 0 10, holding 0 10 unit 2", 0, ""},
    {"holding 0 10, holding 0 10 unit 1", 1, "range 2 has holding 0 to 9 once more: they are in range 1 too"},
};

static void testDoubts(void)
{
    size_t i;

    for (i = 0; i < COUNT(doubts); i++) {
        char text[200] = "x", error[300] = "";
        plcRange *ranges;
        size_t size;
        int count = plcRangesParse(doubts[i].text, doubts[i].output, &ranges, &size, error,
                                   sizeof(error));

        if (count > 0)
            plcRangeDoubt(ranges, (unsigned)count - 1, 1, text, sizeof(text));
        testOk(count > 0 && strcmp(text, doubts[i].doubt) == 0, "\"%s\": %s%s", doubts[i].text, text,
               error);
        free(ranges);
    }
}

static const char *const words[] = {"holding", "input", "coils", "discrete", "at", "every",
                                    "0", "1", "7", "100", "65535", "0x", "0xff", ",", ",",
                                    " ", "-1", "99999999999999999999", "%s%n", "\t", "\xff"};

static void testRandomTexts(void)
{
    int i, good = 0, wrong = 0;

    for (i = 0; i < 100000; i++) {
        char text[200] = "", error[80] = "";
        unsigned j, length = randomBelow(10), output = randomBelow(2);
        plcRange *ranges;
        size_t size, k;
        int count;

        if (randomBelow(2))
            strcpy(text, randomBelow(2) ? "holding 9 3 " : "coils 0 9 at 1,holding 2 1 ");
        for (j = 0; j < length; j++) {
            strcat(text, words[randomBelow(COUNT(words))]);
            if (randomBelow(8))
                strcat(text, " ");
        }
        for (k = strlen(text); k && randomBelow(4) == 0; k = strlen(text))
            text[randomBelow((unsigned)k)] = (char)randomBelow(256);
        count = plcRangesParse(text, output, &ranges, &size, error, sizeof(error));
        if (count < 0)
            wrong += ranges || size || !error[0] || strchr(error, '\0') > error + 79;
        for (j = 0; (int)j < count; j++)
            wrong += ranges[j].offset + plcRangeBytes(&ranges[j]) > size ||
                     ranges[j].count < 1 || ranges[j].start + ranges[j].count > 65536 ||
                     (output ? ranges[j].period != 0 : ranges[j].period < 1);
        good += count > 0;
        free(ranges);
    }
    testOk(wrong == 0, "100000 random texts, %d of them good", good);
}

/* A long text and a small buffer for the message */
static void testLongText(void)
{
    enum { size = 100000 };
    char *text = malloc(size + 1), error[40];
    plcRange *ranges;
    size_t bytes;

    memset(text, 'x', size);
    text[size] = 0;
    testOk(plcRangesParse(text, 0, &ranges, &bytes, error, sizeof(error)) == -1 &&
               strncmp(error, "range 1 \"xxxx", 13) == 0 && strlen(error) == 39,
           "a long text: the message is cut, not the memory");
    free(text);
}

/* --- Reads ------------------------------------------------------------------------ */

static unsigned limit(plcTable table)
{
    return table == plcHolding || table == plcInputRegisters ? PLC_READ_REGISTERS
                                                             : PLC_READ_BITS;
}

static void show(const plcRequest *requests, unsigned count)
{
    unsigned i;

    for (i = 0; i < count; i++)
        testDiag("FC%d %s %u %u every %u", requests[i].function,
                 plcTableName(requests[i].table), requests[i].start, requests[i].count,
                 requests[i].period);
}

static const struct {
    const char *what, *ranges;
    int count;
    plcRequest requests[6];
} reads[] = {
    {"one request", "holding 0 125", 1, {{3, plcHolding, 0, 125, 100, 0}}},
    {"one register more", "holding 0 126", 2,
     {{3, plcHolding, 0, 125, 100, 0}, {3, plcHolding, 125, 1, 100, 0}}},
    {"2000 bits", "coils 1 2000", 1, {{1, plcCoils, 1, 2000, 100, 0}}},
    {"2001 bits", "discrete 1 2001", 2,
     {{2, plcDiscrete, 1, 2000, 100, 0}, {2, plcDiscrete, 2001, 1, 100, 0}}},
    {"side by side in the table, not in the image",
     "holding 0 10, input 0 1, holding 10 10", 2,
     {{3, plcHolding, 0, 20, 100, 0}, {4, plcInputRegisters, 0, 1, 100, 0}}},
    {"the other way round", "holding 10 10, holding 0 10", 1, {{3, plcHolding, 0, 20, 100, 0}}},
    {"a gap is not read", "holding 0 10, holding 11 10", 2,
     {{3, plcHolding, 0, 10, 100, 0}, {3, plcHolding, 11, 10, 100, 0}}},
    {"other periods", "holding 0 10, holding 10 10 every 50", 2,
     {{3, plcHolding, 0, 10, 100, 0}, {3, plcHolding, 10, 10, 50, 0}}},
    {"the same registers twice", "input 0 10, input 5 10", 1,
     {{4, plcInputRegisters, 0, 15, 100, 0}}},
    {"one within the other", "input 0 100, input 5 10, input 100 1", 1,
     {{4, plcInputRegisters, 0, 101, 100, 0}}},
    {"each table for itself", "holding 0 1, input 1 1, coils 2 1, discrete 3 1", 4,
     {{3, plcHolding, 0, 1, 100, 0}, {4, plcInputRegisters, 1, 1, 100, 0},
      {1, plcCoils, 2, 1, 100, 0}, {2, plcDiscrete, 3, 1, 100, 0}}},
    {"the end of the table", "holding 65400 136", 2,
     {{3, plcHolding, 65400, 125, 100, 0}, {3, plcHolding, 65525, 11, 100, 0}}},
};

static void testReads(void)
{
    size_t i;

    for (i = 0; i < COUNT(reads); i++) {
        plcRange *ranges;
        plcRequest *requests;
        size_t size;
        char error[200] = "";
        int count = plcRangesParse(reads[i].ranges, 0, &ranges, &size, error, sizeof(error));
        int j, good, made = (int)plcPlanReads(ranges, count, NULL, standard, &requests);

        good = made == reads[i].count;
        for (j = 0; good && j < made; j++) {
            const plcRequest *a = &requests[j], *b = &reads[i].requests[j];

            good = a->function == b->function && a->table == b->table &&
                   a->start == b->start && a->count == b->count && a->period == b->period;
        }
        if (!testOk(good, "reads: %s %s", reads[i].what, error))
            show(requests, made);
        free(requests);
        free(ranges);
    }
}

/* 2,000 registers in 8 ranges: 16 requests where they are side by side, 16 where not. */
static void test2000(void)
{
    unsigned gap;

    for (gap = 0; gap <= 10; gap += 10) {
        plcRange ranges[8];
        plcRequest *requests;
        unsigned i, made, largest = 0;

        for (i = 0; i < 8; i++)
            ranges[i] = (plcRange){plcHolding, i * (250 + gap), 250, i * 500, 100, 0};
        made = plcPlanReads(ranges, 8, NULL, standard, &requests);
        for (i = 0; i < made; i++)
            largest = requests[i].count > largest ? requests[i].count : largest;
        testOk(made == 16 && largest == 125, "2000 registers in 8 ranges %u apart: %u requests",
               gap, made);
        free(requests);
    }
}

/* The reference works on a whole small world: a table of `worldSize` addresses. */
enum { worldSize = 4096 };

typedef struct world {
    plcRange ranges[8];
    unsigned count;
    size_t size;
    epicsUInt8 *joined;
} world;

/* Random ranges, far from each other or close together, in the image in random order. */
static world makeWorld(int outputs, unsigned span)
{
    world w = {.count = 1 + randomBelow(8)};
    unsigned i, at = 0;

    for (i = 0; i < w.count; i++) {
        plcRange *r = &w.ranges[i];

        r->table = outputs ? (randomBelow(2) ? plcHolding : plcCoils)
                           : (plcTable)randomBelow(4);
        r->period = outputs ? 0 : 100 * (1 + randomBelow(2));
        if (i && randomBelow(2) && !outputs) { /* right behind another one */
            const plcRange *other = &w.ranges[randomBelow(i)];

            r->table = other->table;
            r->period = other->period;
            r->start = other->start + other->count;
        } else {
            r->start = outputs ? at + randomBelow(3) : randomBelow(span);
        }
        if (r->start >= span)
            r->start = span - 1;
        r->count = 1 + randomBelow(randomBelow(4) ? span / 8 : 20);
        if (r->count > worldSize - r->start)
            r->count = worldSize - r->start;
        at = r->start + r->count;
        r->offset = w.size + randomBelow(3);
        w.size = r->offset + plcRangeBytes(r);
    }
    for (i = 0; i < w.count; i++) { /* two change their places if they are of one size */
        plcRange *a = &w.ranges[i], *b = &w.ranges[randomBelow(w.count)];

        if (plcRangeBytes(a) == plcRangeBytes(b)) {
            size_t offset = a->offset;

            a->offset = b->offset;
            b->offset = offset;
        }
    }
    w.joined = calloc(1, w.size);
    return w;
}

/* Values of 1 to `longest` bytes side by side, some bytes free. */
static void addJoined(world *w, unsigned longest)
{
    size_t i = 0, end;

    while (i < w->size) {
        end = i + 1 + randomBelow(longest);
        if (randomBelow(4) == 0)
            end = i + 1;
        for (i++; i < end && i < w->size; i++)
            w->joined[i] = 1;
    }
}

static int isBits(plcTable table)
{
    return table == plcCoils || table == plcDiscrete;
}

/* Byte and bit of an address in a range: the first bit of it in the image. */
static size_t placeOf(const plcRange *r, unsigned address)
{
    unsigned i = address - r->start;

    return isBits(r->table) ? r->offset * 8 + i : (r->offset + 2 * (size_t)i) * 8;
}

static int hasAddress(const plcRange *r, plcTable table, unsigned period, unsigned address)
{
    return r->table == table && r->period == period && address >= r->start &&
           address - r->start < r->count;
}

/* The reference: do the addresses before and at `address` show parts of one value? */
static int joined(const world *w, plcTable table, unsigned period, unsigned address)
{
    unsigned i, j;

    for (i = 0; i < w->count; i++)
        for (j = 0; j < w->count; j++) {
            const plcRange *a = &w->ranges[i], *b = &w->ranges[j];
            size_t last, first;

            if (!hasAddress(a, table, period, address - 1) ||
                !hasAddress(b, table, period, address))
                continue;
            last = (placeOf(a, address - 1) + (isBits(table) ? 0 : 15)) / 8;
            first = placeOf(b, address) / 8;
            if (last == first || (last + 1 == first && w->joined[first]))
                return 1;
        }
    return 0;
}

/* Fewest requests for a run, of `max` each, where a cut is allowed: one step after the other,
 * all of them tried. */
static unsigned fewest(const epicsUInt8 *mayCut, unsigned start, unsigned end, unsigned max)
{
    static unsigned best[worldSize + 1];
    unsigned i, j;

    best[start] = 0;
    for (i = start + 1; i <= end; i++) {
        best[i] = 1000000;
        if (i < end && !mayCut[i])
            continue;
        for (j = i > start + max ? i - max : start; j < i; j++)
            if (best[j] + 1 < best[i])
                best[i] = best[j] + 1;
    }
    return best[end];
}

/* All requests of one table and period. Returns 0, or what is wrong. */
static const char *checkTable(const world *w, int known, plcTable table, unsigned period,
                              const plcRequest *requests, unsigned made)
{
    static epicsUInt8 wanted[worldSize + 1], got[worldSize + 1], mayCut[worldSize + 1];
    unsigned i, j, k, start, max = limit(table), needed = 0, used = 0;

    memset(wanted, 0, sizeof(wanted));
    memset(got, 0, sizeof(got));
    memset(mayCut, 1, sizeof(mayCut));
    for (i = 0; i < w->count; i++)
        for (j = 0; j < w->ranges[i].count; j++)
            if (w->ranges[i].table == table && w->ranges[i].period == period)
                wanted[w->ranges[i].start + j] = 1;
    for (i = 1; known && i < worldSize; i++)
        if (wanted[i - 1] && wanted[i])
            mayCut[i] = !joined(w, table, period, i);
    for (i = 1; known && i < worldSize; i = j) { /* what is longer than a request is cut */
        for (j = i; j < worldSize && !mayCut[j]; j++)
            ;
        if (j - i + 1 > max)
            memset(mayCut + i, 1, j - i);
        j += j == i;
    }
    for (start = 0; start < worldSize; start = k + 1) {
        for (k = start; wanted[k]; k++)
            ;
        if (k > start)
            needed += fewest(mayCut, start, k, max);
    }
    for (i = 0; i < made; i++) {
        if (requests[i].table != table || requests[i].period != period)
            continue;
        used++;
        if (requests[i].count < 1 || requests[i].count > max)
            return "a request of a wrong size";
        for (j = 0; j < requests[i].count; j++)
            if (got[requests[i].start + j]++)
                return "something is read twice";
        j = requests[i].start;
        if (j && wanted[j - 1] && !mayCut[j])
            return "a value is cut";
    }
    if (memcmp(wanted, got, sizeof(wanted)))
        return "not what the ranges say";
    return used == needed ? NULL : "more requests than needed";
}

static void testRandomReads(int known, unsigned longest, int rounds)
{
    const char *wrong = NULL;
    unsigned largest = 0;
    int round;

    for (round = 0; round < rounds && !wrong; round++) {
        world w = makeWorld(0, round % 4 ? 1200 : worldSize);
        plcRequest *requests;
        unsigned made, i;

        if (known)
            addJoined(&w, longest);
        made = plcPlanReads(w.ranges, w.count, known ? w.joined : NULL, standard, &requests);
        for (i = 0; i < 8 && !wrong; i++)
            wrong = checkTable(&w, known, (plcTable)(i % 4), 100 * (1 + i / 4), requests, made);
        if (made > largest)
            largest = made;
        if (wrong)
            show(requests, made);
        free(requests);
        free(w.joined);
    }
    testOk(!wrong, "%d random sets of ranges, %s%u bytes, up to %u requests%s%s", round,
           known ? "values up to " : "no values known, ", longest, largest, wrong ? ": " : "",
           wrong ? wrong : "");
}

/* --- Writes ----------------------------------------------------------------------- */

static const struct {
    const char *what;
    unsigned first, count, part; /* registers of 0.. and one of which only a bit is written */
    int single;
    int requests;
    plcRequest expected[3];
} writes[] = {
    {"one register",                   5,   1,   999, 0, 1, {{16, plcHolding, 5, 1, 0, 0}}                             },
    {"one register, singleWrite",      5,   1,   999, 1, 1, {{6, plcHolding, 5, 1, 0, 0}}                              },
    {"two registers",                  5,   2,   999, 1, 1, {{16, plcHolding, 5, 2, 0, 0}}                             },
    {"123 registers",                  0,   123, 999, 0, 1, {{16, plcHolding, 0, 123, 0, 0}}                           },
    {"124 registers",                  0,   124, 999, 0, 2, {{16, plcHolding, 0, 123, 0, 0}, {16, plcHolding, 123, 1, 0, 0}}},
    {"124 registers, singleWrite",     0,   124, 999, 1, 2, {{16, plcHolding, 0, 123, 0, 0}, {6, plcHolding, 123, 1, 0, 0}}},
    {"a bit",                          0,   0,   7,   0, 1, {{22, plcHolding, 7, 1, 0, 0}}                             },
    {"a bit, singleWrite",             0,   0,   7,   1, 1, {{22, plcHolding, 7, 1, 0, 0}}                             },
    {"a bit between registers",        0,   9,   4,   0, 3,
     {{16, plcHolding, 0, 4, 0, 0}, {22, plcHolding, 4, 1, 0, 0}, {16, plcHolding, 5, 4, 0, 0}}                              },
};

static void testWrites(void)
{
    plcRange range = {plcHolding, 0, 1000, 0, 0, 0};
    epicsUInt8 mask[2000];
    size_t i;

    for (i = 0; i < COUNT(writes); i++) {
        plcRequest *requests;
        int j, made, good;

        memset(mask, 0, sizeof(mask));
        memset(mask + writes[i].first * 2, 0xff, writes[i].count * 2);
        memset(mask + writes[i].part * 2, 0, 2);
        if (writes[i].part < 999)
            mask[writes[i].part * 2] = 0x10;
        made = (int)plcPlanWrites(&range, 1, mask, NULL, standard, writes[i].single, &requests);
        good = made == writes[i].requests;
        for (j = 0; good && j < made; j++)
            good = requests[j].function == writes[i].expected[j].function &&
                   requests[j].start == writes[i].expected[j].start &&
                   requests[j].count == writes[i].expected[j].count;
        if (!testOk(good, "writes: %s", writes[i].what))
            show(requests, made);
        free(requests);
    }
}

static void testSideBySide(void)
{
    static const plcRange ranges[] = {
        {plcHolding, 100, 2, 0, 0, 0}, {plcCoils, 0, 8, 4, 0, 0}, {plcHolding, 102, 2, 6, 0, 0},
        {plcCoils, 8, 8, 10, 0, 0}, {plcDiscrete, 0, 8, 11, 0, 0}};
    static const plcRange units[] = {{plcHolding, 0, 2, 0, 0, 7}, {plcHolding, 0, 2, 4, 0, 3}};
    epicsUInt8 mask[12];
    plcRequest *requests;
    unsigned made;

    memset(mask, 0xff, sizeof(mask));
    made = plcPlanWrites(ranges, 5, mask, NULL, standard, 0, &requests);
    testOk(made == 2 && requests[0].function == 16 && requests[0].start == 100 &&
               requests[0].count == 4 && requests[1].function == 15 &&
               requests[1].start == 0 && requests[1].count == 16,
           "side by side in the table, not in the image: one request each");
    free(requests);
    memset(mask, 0, sizeof(mask));
    made = plcPlanWrites(ranges, 5, mask, NULL, standard, 0, &requests);
    testOk(made == 0, "nothing to write: no request");
    free(requests);
    mask[4] = 0x80;
    made = plcPlanWrites(ranges, 5, mask, NULL, standard, 1, &requests);
    testOk(made == 1 && requests[0].function == 5 && requests[0].start == 7 &&
               requests[0].count == 1, "one coil, singleWrite");
    free(requests);
    memset(mask, 0xff, sizeof(mask));
    made = plcPlanWrites(units, 2, mask, NULL, standard, 0, &requests);
    testOk(made == 2 && requests[0].unit == 7 && requests[1].unit == 3,
           "the same registers of two units are two requests, whatever their order");
    free(requests);
}

/* Some bits, some bytes, long runs. */
static void randomMask(epicsUInt8 *mask, size_t size)
{
    size_t i = 0, end;

    while (i < size) {
        unsigned kind = randomBelow(4);

        for (end = i + 1 + randomBelow(kind == 3 ? 600 : 20); i < end && i < size; i++)
            mask[i] = kind == 0 ? 0 : kind == 1 ? (epicsUInt8)randomBelow(256) : 0xff;
    }
}

/* Sets in `covered` what a write changes. Returns 0, or what is wrong with the request. */
static const char *checkWrite(const world *w, const plcRequest *q, const epicsUInt8 *mask,
                              epicsUInt8 *covered, int single)
{
    static const struct {
        epicsUInt8 function;
        plcTable table;
        unsigned max;
    } allowed[] = {{16, plcHolding, 123}, {6, plcHolding, 1}, {22, plcHolding, 1},
                   {15, plcCoils, 1968}, {5, plcCoils, 1}};
    plcPiece pieces[8];
    unsigned i, j, n, total = 0;

    for (i = 0; i < 5 && allowed[i].function != q->function; i++)
        ;
    if (i == 5 || q->table != allowed[i].table || q->count < 1 || q->count > allowed[i].max)
        return "a wrong request";
    if (single ? q->count == 1 && q->function >= 15 && q->function <= 16 : q->function < 15)
        return "not the function for it";
    n = plcPlanPieces(w->ranges, w->count, q, pieces, 8);
    for (i = 0; i < n; i++)
        for (j = 0; j < pieces[i].count; j++) {
            size_t bit = q->table == plcCoils ? pieces[i].offset * 8 + pieces[i].bit + j
                                              : (pieces[i].offset + 2 * j) * 8;

            total++;
            if (q->table == plcCoils) {
                covered[bit / 8] |= 1 << bit % 8;
            } else if (q->function == 22) {
                covered[bit / 8] |= mask[bit / 8];
                covered[bit / 8 + 1] |= mask[bit / 8 + 1];
            } else {
                covered[bit / 8] = covered[bit / 8 + 1] = 0xff;
            }
        }
    return total == q->count ? NULL : "writes beside the ranges";
}

/* No request ends between two parts of a value that are both written. */
static int valueCut(const world *w, const plcRequest *requests, unsigned made)
{
    unsigned i, j;

    for (i = 0; i < made; i++)
        for (j = 0; j < made; j++)
            if (requests[i].table == requests[j].table && requests[i].function == 16 &&
                requests[j].function == 16 &&
                requests[i].start + requests[i].count == requests[j].start &&
                joined(w, requests[i].table, 0, requests[j].start))
                return 1;
    return 0;
}

static void testRandomWrites(int rounds)
{
    const char *wrong = NULL;
    unsigned largest = 0;
    int round;

    for (round = 0; round < rounds && !wrong; round++) {
        world w = makeWorld(1, worldSize);
        epicsUInt8 *mask = calloc(1, w.size), *covered = calloc(1, w.size);
        epicsUInt8 *inRange = calloc(1, w.size);
        plcRequest *requests;
        unsigned made, i;
        size_t k;
        int single = round % 2, known = round % 3;

        randomMask(mask, w.size);
        if (known)
            addJoined(&w, 16);
        for (i = 0; i < w.count; i++)
            for (k = 0; k < w.ranges[i].count; k++) {
                size_t bit = placeOf(&w.ranges[i], w.ranges[i].start + (unsigned)k);

                if (isBits(w.ranges[i].table))
                    inRange[bit / 8] |= 1 << bit % 8;
                else
                    inRange[bit / 8] = inRange[bit / 8 + 1] = 0xff;
            }
        made = plcPlanWrites(w.ranges, w.count, mask, known ? w.joined : NULL, standard, single, &requests);
        for (i = 0; i < made && !wrong; i++)
            wrong = checkWrite(&w, &requests[i], mask, covered, single);
        for (k = 0; k < w.size && !wrong; k++)
            if (covered[k] != (mask[k] & inRange[k]))
                wrong = "not what the mask says";
        if (!wrong && known && valueCut(&w, requests, made))
            wrong = "a value is cut";
        if (made > largest)
            largest = made;
        if (wrong)
            show(requests, made);
        free(requests);
        free(mask);
        free(covered);
        free(inRange);
        free(w.joined);
    }
    testOk(!wrong, "%d random masks, up to %u requests%s%s", round, largest,
           wrong ? ": " : "", wrong ? wrong : "");
}

/* --- Halves ----------------------------------------------------------------------- */

/* Halves down to the end. Returns the number of parts; 0: something is lost. */
static unsigned halveAll(const world *w, int known, const plcRequest *q, unsigned *at,
                         const char **wrong)
{
    plcRequest halves[2];

    if (plcPlanHalve(w->ranges, w->count, known ? w->joined : NULL, q, halves)) {
        unsigned first, second;

        if (halves[0].start != q->start || halves[0].count < 1 || halves[1].count < 1 ||
            halves[0].start + halves[0].count != halves[1].start ||
            halves[0].count + halves[1].count != q->count ||
            halves[1].function != q->function || halves[1].table != q->table)
            *wrong = "the halves are not the whole";
        if (*wrong)
            return 0;
        if (known && q->table == plcHolding && joined(w, q->table, 0, halves[1].start))
            *wrong = "a value is cut";
        first = halveAll(w, known, &halves[0], at, wrong);
        second = halveAll(w, known, &halves[1], at, wrong);
        return first + second;
    }
    if (q->start != *at)
        *wrong = "out of order";
    *at = q->start + q->count;
    if (q->count > 1 && !known)
        *wrong = "more than one register is left";
    if (known && q->table == plcHolding) {
        unsigned i;

        for (i = q->start + 1; i < q->start + q->count; i++)
            if (!joined(w, q->table, 0, i))
                *wrong = "more than one value is left";
    }
    return 1;
}

static void testHalves(int rounds)
{
    const char *wrong = NULL;
    int round;

    for (round = 0; round < rounds && !wrong; round++) {
        world w = makeWorld(1, worldSize);
        const plcRange *r = &w.ranges[randomBelow(w.count)];
        plcRequest q = {r->table == plcCoils ? 15 : 16, r->table, r->start, r->count, 0, 0};
        unsigned at = r->start, known = round % 2;

        if (known)
            addJoined(&w, 12);
        halveAll(&w, known, &q, &at, &wrong);
        if (!wrong && at != r->start + r->count)
            wrong = "a part is lost";
        free(w.joined);
    }
    testOk(!wrong, "%d writes halved down to single values%s%s", round, wrong ? ": " : "",
           wrong ? wrong : "");
}

static void testHalfOf(void)
{
    static const plcRange registers = {plcHolding, 10, 4, 0, 0, 0}, coils = {plcCoils, 0, 16, 0, 0, 0};
    static const epicsUInt8 late[8] = {0, 1, 0, 1, 0, 1, 0, 1}, /* four registers */
        real[8] = {0, 1, 1, 1, 0, 1, 0, 1},                     /* 32 bits and two of 16 */
        all[8] = {0, 1, 1, 1, 1, 1, 1, 1}, behind[8] = {0, 1, 1, 1, 1, 1, 0, 0};
    static const epicsUInt8 word[2] = {0, 1}, bytes[2] = {0, 0};
    plcRequest q = {16, plcHolding, 10, 4, 0, 0}, bits = {15, plcCoils, 0, 16, 0, 0}, halves[2];
    plcRequest byte = {15, plcCoils, 0, 8, 0, 0}, one = {16, plcHolding, 10, 1, 0, 0};

    testOk(plcPlanHalve(&registers, 1, late, &q, halves) && halves[0].count == 2,
           "four registers: in the middle");
    testOk(plcPlanHalve(&registers, 1, real, &q, halves) && halves[0].count == 2,
           "a REAL32 first: behind it");
    testOk(plcPlanHalve(&registers, 1, behind, &q, halves) && halves[0].count == 3,
           "a value over the middle: behind it");
    testOk(!plcPlanHalve(&registers, 1, all, &q, halves), "one value of four: not at all");
    testOk(!plcPlanHalve(&registers, 1, NULL, &one, halves), "one register: not at all");
    testOk(!plcPlanHalve(&coils, 1, word, &bits, halves), "16 coils that are one value");
    testOk(plcPlanHalve(&coils, 1, bytes, &bits, halves) && halves[0].count == 8,
           "16 coils in two bytes");
    testOk(plcPlanHalve(&coils, 1, bytes, &byte, halves) && halves[0].count == 4,
           "8 coils are single bits");
}

/* --- Numbers longer than a request -------------------------------------------------------- */

static const struct {
    const char *what;
    unsigned start, count, head, tail;
} torn[] = {
    {"from the first register to the last", 0,   310, 0,   0  },
    {"the beginning of it",                 0,   125, 0,   115},
    {"a part within it",                    125, 125, 125, 0  },
    {"its end, and what is behind",         250, 60,  50,  0  },
    {"its end alone",                       250, 50,  50,  0  },
    {"what is behind it",                   300, 10,  0,   0  },
    {"what is before it",                   0,   10,  0,   0  },
    {"the first of it",                     10,  1,   0,   1  },
};

/* 10 registers, a number of 290, and 10 registers */
static void testTorn(void)
{
    static const plcRange range = {plcHolding, 0, 310, 0, 0, 0};
    epicsUInt8 joined[620];
    plcRequest q = {3, plcHolding, 0, 0, 0, 0}, *requests;
    unsigned i, made, head, tail;

    for (i = 0; i < sizeof(joined); i++)
        joined[i] = i >= 20 && i < 600 ? i > 20 : i % 2;
    for (i = 0; i < COUNT(torn); i++) {
        q.start = torn[i].start;
        q.count = torn[i].count;
        plcPlanTorn(&range, 1, joined, &q, &head, &tail);
        testOk(head == torn[i].head && tail == torn[i].tail, "torn: %s: %u, %u", torn[i].what, head,
               tail);
        plcPlanTorn(&range, 1, NULL, &q, &head, &tail);
        testOk(!head && !tail, "torn: %s: nothing where no values are known", torn[i].what);
    }
    for (i = 20; i < 600; i++)
        joined[i] = i > 20 ? 2 : 0;
    q.start = q.count = 125;
    plcPlanTorn(&range, 1, joined, &q, &head, &tail);
    testOk(!head && !tail, "torn: a text is not");
    memset(joined, 1, sizeof(joined));
    made = plcPlanReads(&range, 1, joined, standard, &requests);
    testOk(made == 3 && requests[1].start == 125 && requests[2].start == 250,
           "a value that begins at address 0 and needs three requests has three");
    free(requests);
}

/* --- Pieces ----------------------------------------------------------------------- */

static void testPieces(void)
{
    static const plcRange ranges[] = {
        {plcHolding, 100, 10, 40, 100, 0}, {plcHolding, 110, 10, 0, 100, 0},
        {plcHolding, 100, 20, 60, 500, 0}, {plcCoils, 3, 20, 100, 100, 0},
        {plcInputRegisters, 100, 20, 110, 100, 0}, {plcHolding, 100, 20, 150, 100, 5}};
    plcRequest registers = {3, plcHolding, 105, 10, 100, 0}, bits = {1, plcCoils, 13, 5, 100, 0};
    plcPiece pieces[4];
    unsigned count = plcPlanPieces(ranges, 6, &registers, pieces, 4);

    testOk(count == 2 && pieces[0].offset == 50 && pieces[0].first == 0 &&
               pieces[0].count == 5 && pieces[1].offset == 0 && pieces[1].first == 5 &&
               pieces[1].count == 5,
           "a request over two ranges has two pieces; those of another period, table or unit are not meant");
    testOk(plcPlanPieces(ranges, 4, &registers, pieces, 1) == 1, "never more than asked for");
    count = plcPlanPieces(ranges, 4, &bits, pieces, 4);
    testOk(count == 1 && pieces[0].offset == 101 && pieces[0].bit == 2 &&
               pieces[0].first == 0 && pieces[0].count == 5, "coils within a byte");
}

/* --- Words ------------------------------------------------------------------------ */

static void testExceptions(void)
{
    char text[40], small[10];
    int i, fits = 1;

    plcExceptionText(2, text, sizeof(text));
    testOk(strcmp(text, "exception 2, illegal data address") == 0, "%s", text);
    plcExceptionText(11, text, sizeof(text));
    testOk(strcmp(text, "exception 11, gateway: no answer") == 0, "%s", text);
    plcExceptionText(9, text, sizeof(text));
    testOk(strcmp(text, "exception 9, not in the standard") == 0, "%s", text);
    for (i = 0; i < 256; i++) {
        plcExceptionText(i, text, sizeof(text));
        fits &= strlen(text) + strlen("PLC: ") < 40;
        plcExceptionText(i, small, sizeof(small));
    }
    testOk(fits, "all fit into an alarm message");
}

MAIN(modbusPlanTest)
{
    testPlan(COUNT(texts) + COUNT(badTexts) + COUNT(doubts) + COUNT(reads) + COUNT(writes) + 2 * COUNT(torn) + 30);
    testTexts();
    testBadTexts();
    testDoubts();
    testRandomTexts();
    testLongText();
    testReads();
    test2000();
    testRandomReads(0, 0, 3000);
    testRandomReads(1, 8, 3000);
    testRandomReads(1, 600, 1000);
    testWrites();
    testSideBySide();
    testRandomWrites(3000);
    testHalves(3000);
    testHalfOf();
    testTorn();
    testPieces();
    testExceptions();
    return testDone();
}
