/* Where a value may lie in the image of a Modbus PLC: rows, and random ranges and values against a
 * reference that knows for each bit whose it is. */
#include <stdlib.h>
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcModbusPlan.h"

#define COUNT(table) (sizeof(table) / sizeof(table[0]))

static const char layout[] = "holding 0 3, holding 100 3 at 8, coils 0 3, coils 8 8 at 20";
#define BYTES "bytes 0 to 5, 8 to 13, 14 to 14, 20 to 20"

static const struct {
    const char *what;
    size_t offset, length;
    const char *mask; /* NULL: all */
    int output, may;
    size_t fits;
    const char *error; /* or doubt */
} rows[] = {
    {"a register", 0, 2, NULL, 1, 1, 6, ""},
    {"half of one", 5, 1, NULL, 1, 1, 1, ""},
    {"all of a range", 8, 6, NULL, 1, 1, 6, ""},
    {"a gap", 6, 2, NULL, 0, 0, 0, "bytes 6 to 7 are in no range; allowed: " BYTES},
    {"one byte of a gap", 5, 2, NULL, 0, 0, 1, "byte 6 is in no range; allowed: " BYTES},
    {"a gap within", 4, 6, NULL, 0, 0, 2, "bytes 6 to 7 are in no range; allowed: " BYTES},
    {"beyond all", 21, 4, NULL, 0, 0, 0, "bytes 21 to 24 are in no range; allowed: " BYTES},
    {"two ranges", 12, 3, NULL, 0, 0, 2, "bytes 12 to 14 are in two ranges; allowed: a value in one of them: " BYTES},
    {"a bit beside a gap", 5, 2, "\x01\x00", 1, 1, 1, ""},
    {"a bit in a gap", 5, 2, "\x00\x80", 1, 0, 0, "byte 6 is in no range; allowed: " BYTES},
    {"bits around a gap", 5, 4, "\x01\x00\x00\x01", 1, 0, 1,
     "bytes 5 to 8 are in two ranges; allowed: a value in one of them: " BYTES},
    {"a coil", 14, 1, "\x04", 1, 1, 1, ""},
    {"a bit behind the coils", 14, 1, "\x08", 0, 0, 1, "byte 14 has no bit 3; allowed: bits 0 to 2, which are coils"},
    {"bits behind the coils", 14, 1, "\x7e", 0, 0, 1, "byte 14 has no bits 3 to 6; allowed: bits 0 to 2, which are coils"},
    {"a number with spare bits that is written", 14, 1, NULL, 1, 1, 1,
     "byte 14 has no bits 3 to 7, they are not written; there are: bits 0 to 2, which are coils"},
    {"a number with spare bits that is read", 14, 1, NULL, 0, 1, 1, ""},
    {"eight coils", 20, 1, NULL, 1, 1, 1, ""},
};

static void testRows(void)
{
    plcRange *ranges;
    size_t size, fits, i;
    char error[400];
    int count = plcRangesParse(layout, 0, &ranges, &size, error, sizeof(error));

    for (i = 0; i < COUNT(rows); i++) {
        int may = plcRangesHold(ranges, (unsigned)count, rows[i].offset, rows[i].length,
                                rows[i].mask, rows[i].output, &fits, error, sizeof(error));

        if (!testOk(may == rows[i].may && strcmp(error, rows[i].error) == 0 &&
                        fits == rows[i].fits, "%s", rows[i].what))
            testDiag("%d, %lu: %s", may, (unsigned long)fits, error);
    }
    free(ranges);
}

/* --- Random ranges and values --------------------------------------------------------- */

enum { span = 40 };

/* Same numbers in each run. */
static epicsUInt32 seed = 1;

static unsigned randomBelow(unsigned n)
{
    seed = seed * 1664525u + 1013904223u;
    return (seed >> 8) % n;
}

/* Ranges one behind the other with gaps; in owner[] which one has each bit, 0: none, and in
 * byteOwner[] which has its byte. */
static unsigned makeRanges(plcRange ranges[4], int owner[8 * span], int byteOwner[span])
{
    size_t at = randomBelow(3), i;
    unsigned count = 0;

    memset(owner, 0, 8 * span * sizeof(*owner));
    memset(byteOwner, 0, span * sizeof(*byteOwner));
    while (count < 4) {
        plcRange *r = &ranges[count];

        memset(r, 0, sizeof(*r));
        r->table = (plcTable)randomBelow(4);
        r->count = 1 + randomBelow(r->table == plcCoils || r->table == plcDiscrete ? 30 : 4);
        r->offset = at;
        if (at + plcRangeBytes(r) > span)
            break;
        count++;
        for (i = 0; i < plcRangeBytes(r); i++)
            byteOwner[at + i] = (int)count;
        for (i = 0; i < 8 * plcRangeBytes(r); i++)
            if (r->table == plcHolding || r->table == plcInputRegisters || i < r->count)
                owner[8 * at + i] = (int)count;
        at += plcRangeBytes(r) + randomBelow(3);
    }
    return count;
}

/* What plcRangesHold is to say. */
static int mayLie(const int *owner, const int *byteOwner, size_t offset, size_t length,
                  const epicsUInt8 *mask)
{
    int whose = 0;
    size_t i;

    for (i = 0; i < 8 * length; i++) {
        size_t bit = 8 * offset + i;
        int has = mask ? owner[bit] : byteOwner[bit / 8];

        if (mask && !(mask[i / 8] >> i % 8 & 1))
            continue;
        if (!has || (whose && whose != has))
            return 0;
        whose = has;
    }
    return 1;
}

static void testRandom(void)
{
    static const epicsUInt8 one[8] = {1, 2, 4, 8, 16, 32, 64, 128};
    int owner[8 * span], byteOwner[span], round, wrong = 0, good = 0;

    for (round = 0; round < 200000; round++) {
        plcRange ranges[4];
        unsigned i, count = makeRanges(ranges, owner, byteOwner), output = randomBelow(2);
        size_t length = 1 + randomBelow(8), offset = randomBelow((unsigned)(span - length)), fits;
        epicsUInt8 bits[8] = {0}, *mask = randomBelow(2) ? bits : NULL;
        char error[400];
        int may;

        for (i = 0; i < 1 + randomBelow(4); i++)
            bits[randomBelow((unsigned)length)] |= one[randomBelow(8)];
        may = plcRangesHold(ranges, count, offset, length, mask, (int)output, &fits, error,
                            sizeof(error));
        wrong += may != mayLie(owner, byteOwner, offset, length, mask) ||
                 (!may && !error[0]);
        if (!mask && !may && fits) /* so much of it may */
            wrong += fits >= length || !mayLie(owner, byteOwner, offset, fits, NULL);
        good += may;
    }
    testOk(wrong == 0 && good > 1000, "200000 random values, %d of them may lie there", good);
}

MAIN(modbusHoldTest)
{
    testPlan(COUNT(rows) + 1);
    testRows();
    testRandom();
    return testDone();
}
