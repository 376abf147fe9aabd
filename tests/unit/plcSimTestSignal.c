/* plcSimTestSignal: the simulator's signals at chosen moments, byte for byte, both orders.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdlib.h>
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "simConfig.h"
#include "simSignal.h"

/* 2026-11-23 12:34:56.789 UTC, a Monday. (A quarter of a millisecond more, since binary
 * fractions are a little too small.) */
#define WALL 1795437296.78925

static const struct {
    const char *line; /* behind "signal" */
    double time;
    epicsUInt64 block;
    size_t offset, size;
    const char *big, *little;
} rows[] = {
    {"2 INT16 constant -300", 5, 0, 2, 2, "\xfe\xd4", "\xd4\xfe"},
    {"0 INT16 ramp 0 100 10s", 0, 0, 0, 2, "\0\0", "\0\0"},
    {"0 INT16 ramp 0 100 10s", 5, 0, 0, 2, "\0\x32", "\x32\0"},
    {"0 INT16 ramp 0 100 10s", 12.5, 0, 0, 2, "\0\x19", "\x19\0"},
    {"0 UINT16 ramp -10 10 1s", 0, 0, 0, 2, "\0\0", "\0\0"},
    {"0 INT8 ramp 200 300 1s", 0.5, 0, 0, 1, "\x7f", "\x7f"},
    {"0 INT8 constant -1e9", 0, 0, 0, 1, "\x80", "\x80"},
    {"0 UINT32 constant 4294967295", 0, 0, 0, 4, "\xff\xff\xff\xff", "\xff\xff\xff\xff"},
    {"0 INT64 constant -2", 0, 0, 0, 8, "\xff\xff\xff\xff\xff\xff\xff\xfe",
     "\xfe\xff\xff\xff\xff\xff\xff\xff"},
    {"0 UINT64 constant 1e30", 0, 0, 0, 8, "\xff\xff\xff\xff\xff\xff\xff\xff",
     "\xff\xff\xff\xff\xff\xff\xff\xff"},
    {"4 REAL32 sine -4 4 20s", 5, 0, 4, 4, "\x40\x80\0\0", "\0\0\x80\x40"},
    {"4 REAL64 sine 0 4 20s", 0, 0, 4, 8, "\x40\0\0\0\0\0\0\0", "\0\0\0\0\0\0\0\x40"},
    {"0 REAL32 square 1 2 2s", 0.9, 0, 0, 4, "\x3f\x80\0\0", "\0\0\x80\x3f"},
    {"0 REAL32 square 1 2 2s", 1.1, 0, 0, 4, "\x40\0\0\0", "\0\0\0\x40"},
    {"8.3 BOOL square 0 1 2s", 1.5, 0, 8, 1, "\x08", "\x08"},
    {"0 BYTE counter", 0, 258, 0, 1, "\2", "\2"},
    {"0 UINT16 counter", 0, 65538, 0, 2, "\0\2", "\2\0"},
    {"0 UINT32 counter", 0, 66051, 0, 4, "\0\1\2\3", "\3\2\1\0"},
    {"0 INT16 counter 100ms", 2.55, 7, 0, 2, "\0\x19", "\x19\0"},
    {"0.0 BOOL counter", 0, 3, 0, 1, "\1", "\1"},
    {"0 STRING[8] text hello", 9, 0, 0, 8, "hello\0\0\0", "hello\0\0\0"},
    {"0 STRING[3] text a \"b c d\" 2s", 3, 0, 0, 3, "b c", "b c"},
    {"0 STRING[3] text a b 2s", 4.5, 0, 0, 3, "a\0\0", "a\0\0"},
    {"0 TIME clock", 0, 0, 0, 8, "\x26\x11\x23\x12\x34\x56\x78\x92",
     "\x26\x11\x23\x12\x34\x56\x78\x92"},
    {"0 TIME clock -1 h", 0, 0, 0, 8, NULL, NULL},
    {"0 TIME clock -1h", 0, 0, 0, 8, "\x26\x11\x23\x11\x34\x56\x78\x92",
     "\x26\x11\x23\x11\x34\x56\x78\x92"},
    {"0 DTL clock", 0, 0, 0, 8, "\x07\xea\x0b\x17\x02\x0c\x22\x38",
     "\xea\x07\x0b\x17\x02\x0c\x22\x38"},
    {"0 INT16[3] ramp 0 30 10s", 0, 0, 0, 6, "\0\0\0\x0a\0\x14", "\0\0\x0a\0\x14\0"},
    {"DB2.DBW2 INT16 constant 5", 0, 0, 0, 0, "", ""},
};

/* NULL bytes above and these: refused. */
static const char *const bad[] = {
    "",
    "0 INT16",
    "0 INT16 wobble 1 2 3s",
    "0 INT16 ramp 1 2",
    "0 INT16 ramp 1 2 3 parsec",
    "0 INT16 ramp 1 2 0s",
    "0 INT16 ramp 1 2 -1s",
    "0 INT16 ramp one 2 1s",
    "0 INT16 ramp nan 2 1s",
    "0 INT16 noise 1",
    "0 INT16 text a",
    "0 STRING[4] ramp 0 1 1s",
    "0 TIME counter",
    "0 INT32 clock",
    "0 BOOL square 0 1 1s",
    "31 INT16 counter",
    "0 STRING[33] text a",
    "DB9.DBW0 INT16 counter",
    "0 INT16[17] counter",
};

static int parse(const simMemory *mem, const char *line, simSignal *signal,
                 char error[SIM_ERROR_SIZE])
{
    char text[100];
    char *words[20] = {NULL};
    int count;

    strcpy(text, line);
    count = simSplit(text, words, 20, error);
    return simSignalParse(mem, simMemoryFindName(mem, "in"), words, (size_t)count, signal,
                          error);
}

static void testRows(int bigEndian)
{
    simMemory mem;
    simBlock *in;
    size_t i;

    simMemoryInit(&mem, bigEndian);
    in = simMemoryAdd(&mem, SIM_AREA_DB, 1, 32, "IE_TX");
    simMemoryAdd(&mem, SIM_AREA_DB, 2, 8, NULL);
    for (i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        const char *bytes = bigEndian ? rows[i].big : rows[i].little;
        simMoment moment = {rows[i].time, WALL, rows[i].block};
        char error[SIM_ERROR_SIZE] = "";
        simSignal signal;

        memset(in->bytes, 0, in->size);
        if (parse(&mem, rows[i].line, &signal, error)) {
            testOk(!bytes, "signal %s: %s", rows[i].line, error);
            continue;
        }
        simSignalWrite(&mem, &signal, &moment);
        testOk(bytes && !memcmp(in->bytes + rows[i].offset, bytes, rows[i].size),
               "signal %s at %g s, block %lu, %s endian", rows[i].line, rows[i].time,
               (unsigned long)rows[i].block, bigEndian ? "big" : "little");
        simSignalFree(&signal);
    }
    simMemoryFree(&mem);
}

static void testBad(void)
{
    char error[SIM_ERROR_SIZE];
    simMemory mem;
    simSignal signal;
    size_t i;

    simMemoryInit(&mem, 1);
    simMemoryAdd(&mem, SIM_AREA_DB, 1, 32, "IE_TX");
    for (i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        error[0] = 0;
        testOk(parse(&mem, bad[i], &signal, error) && error[0], "signal %s is refused: %s",
               bad[i], error);
    }
    simMemoryFree(&mem);
}

static void testNoise(void)
{
    char error[SIM_ERROR_SIZE];
    simMemory mem;
    simBlock *in;
    simSignal signal;
    simMoment moment = {0, 0, 0};
    int inRange = 1, changes = 0, last = -1;

    simMemoryInit(&mem, 1);
    in = simMemoryAdd(&mem, SIM_AREA_DB, 1, 32, "IE_TX");
    parse(&mem, "0 UINT8 noise 10 20", &signal, error);
    for (moment.block = 0; moment.block < 1000; moment.block++) {
        simSignalWrite(&mem, &signal, &moment);
        inRange &= in->bytes[0] >= 10 && in->bytes[0] <= 20;
        changes += in->bytes[0] != last;
        last = in->bytes[0];
    }
    testOk(inRange && changes > 700, "noise moves and stays in its range");
    moment.block = 5;
    simSignalWrite(&mem, &signal, &moment);
    last = in->bytes[0];
    simSignalWrite(&mem, &signal, &moment);
    testOk(in->bytes[0] == last, "noise is the same for the same block");
    simSignalFree(&signal);
    simMemoryFree(&mem);
}

MAIN(plcSimTestSignal)
{
    testPlan(2 * 29 + 19 + 2);
    testRows(1);
    testRows(0);
    testBad();
    testNoise();
    return testDone();
}
