/* plcSimTestProgram: the PLC program: pointers, PACK, UNPACK, CHECKSYNC, IE_COMMS, by literal
 * bytes and by time that the test sets.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdlib.h>
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "simConfig.h"
#include "simLog.h"
#include "simProgram.h"
#include "simTransfers.h"

/* Setpoints in DB10: DBW0, DBD2, DBX6.5. They come at bytes 4, 6 and bit 0 of byte 10 of
 * IE_RX, and are read back at the same places of IE_TX. */
static simMemory mem;
static simProgram program;
static simBlock *tx, *rx, *db10;
static double now;

static void transfer(int isTx, const char *line)
{
    char error[SIM_ERROR_SIZE] = "";
    char text[100];
    char *words[10];
    int count;

    strcpy(text, line);
    count = simSplit(text, words, 10, error);
    if (simTransfersAdd(&program, isTx, words, (size_t)count, error))
        testAbort("%s: %s", line, error);
}

static void setUp(int sync)
{
    char error[SIM_ERROR_SIZE];

    memset(&program, 0, sizeof(program));
    simMemoryInit(&mem, 1);
    tx = simMemoryAdd(&mem, SIM_AREA_DB, 1, 12, "IE_TX");
    rx = simMemoryAdd(&mem, SIM_AREA_DB, 2, 12, "IE_RX");
    db10 = simMemoryAdd(&mem, SIM_AREA_DB, 10, 8, "");
    program.name = "PLC";
    program.memory = &mem;
    program.tx = tx;
    program.rx = rx;
    program.sync = sync;
    program.layout = 0x1234;
    program.watchdog = 3;
    transfer(1, "P#DB10.DBX0.0 WORD 3 -> 4");
    transfer(1, "DB10.DBX6.5 -> DB1.DBX10.0");
    transfer(0, "4 -> P#DB10.DBX0.0 WORD 1");
    transfer(0, "DB2.DBD6 -> DB10.DBD2");
    transfer(0, "DB2.DBX10.0 -> DB10.DBX6.5");
    if (simProgramInit(&program, 3, 4, error))
        testAbort("%s", error);
    memcpy(db10->bytes, "\x01\x02\x03\x04\x05\x06\x20\0", 8);
    now = 1000;
}

static void tearDown(void)
{
    simProgramFree(&program);
    simMemoryFree(&mem);
}

static void call(int connected, int remote, int send, const char *block)
{
    simInputs in = {.now = now,
                    .connected = connected,
                    .remote = remote,
                    .send = send,
                    .received = (const epicsUInt8 *)block};

    IE_COMMS(&program, &in);
}

/* Sends a block from the IOC; then the flags in the next block to it. */
static int answer(const char *block, int remote)
{
    call(1, remote, 0, block);
    call(1, remote, 1, NULL);
    return tx->bytes[0];
}

#define EQUAL "\x01\x02\x03\x04\x05\x06\x01\0"
#define CHECK "\x01\x01\x12\x34" EQUAL
#define CHECK_OTHER "\x01\x01\x12\x34\x01\x02\x03\x04\x05\x07\x01\0"
#define DATA "\x02\x02\x12\x34\x11\x12\x13\x14\x15\x16\0\0"
#define BEAT "\0\x03\x12\x34" EQUAL

static void testAny(void)
{
    static const struct {
        const char *text[3];
        const char *bytes;
        size_t size;
    } rows[] = {
        {{"P#DB2.DBX4.0", "BYTE", "34"}, "\x10\x02\x00\x22\x00\x02\x84\x00\x00\x20", 34},
        {{"P#DB10.DBX0.0", "BYTE", "8"}, "\x10\x02\x00\x08\x00\x0a\x84\x00\x00\x00", 8},
        {{"P#DB2.DBX4.3", "BOOL", "8"}, "\x10\x01\x00\x08\x00\x02\x84\x00\x00\x23", 1},
        {{"P#DB258.DBX8191.0", "WORD", "2"}, "\x10\x04\x00\x02\x01\x02\x84\x00\xff\xf8", 4},
        {{"P#M10.0", "REAL", "3"}, "\x10\x08\x00\x03\x00\x00\x83\x00\x00\x50", 12},
        {{"p#i4.2", "bool", "1"}, "\x10\x01\x00\x01\x00\x00\x81\x00\x00\x22", 1},
        {{"P#Q0.0", "DWORD", "16384"}, "\x10\x06\x40\x00\x00\x00\x82\x00\x00\x00", 65536},
        {{"P#DB1.DBX0.0", "DATE_AND_TIME", "1"}, "\x10\x0e\x00\x01\x00\x01\x84\x00\x00\x00", 8},
        {{"P#DB1.DBX0.0", "CHAR", "3"}, "\x10\x03\x00\x03\x00\x01\x84\x00\x00\x00", 3},
        {{"P#DB1.DBX0.0", "INT", "3"}, "\x10\x05\x00\x03\x00\x01\x84\x00\x00\x00", 6},
        {{"P#DB1.DBX0.0", "DINT", "3"}, "\x10\x07\x00\x03\x00\x01\x84\x00\x00\x00", 12},
        {{"P#DB1.DBX0.0", "DATE", "3"}, "\x10\x09\x00\x03\x00\x01\x84\x00\x00\x00", 6},
        {{"P#DB1.DBX0.0", "TIME_OF_DAY", "3"}, "\x10\x0a\x00\x03\x00\x01\x84\x00\x00\x00", 12},
        {{"P#DB1.DBX0.0", "TIME", "3"}, "\x10\x0b\x00\x03\x00\x01\x84\x00\x00\x00", 12},
        {{"P#DB1.DBX0.0", "S5TIME", "3"}, "\x10\x0c\x00\x03\x00\x01\x84\x00\x00\x00", 6},
    };
    size_t i;

    for (i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        char error[SIM_ERROR_SIZE];
        epicsUInt8 bytes[SIM_ANY];
        simAny any, back;
        int ok = simAnyParse((char **)rows[i].text, &any, error) == 0;

        simAnyEncode(&any, bytes);
        testOk(ok && !memcmp(bytes, rows[i].bytes, SIM_ANY), "%s %s %s has the right 10 bytes",
               rows[i].text[0], rows[i].text[1], rows[i].text[2]);
        simAnyDecode(bytes, &back);
        testOk(back.type == any.type && back.count == any.count && back.db == any.db &&
                   back.area == any.area && back.bit == any.bit &&
                   simAnySize(&back) == rows[i].size,
               "and they read back, %lu bytes", (unsigned long)rows[i].size);
    }
}

static void testPack(void)
{
    setUp(1);
    testOk(!memcmp(program.pack.table->bytes,
                   "\x10\x04\x00\x03\x00\x0a\x84\x00\x00\x00"
                   "\x10\x04\x00\x03\x00\x01\x84\x00\x00\x20\0",
                   21),
           "DB_TX_PTRS holds source and destination");
    PACK_TX_DB(&program);
    testOk(!memcmp(tx->bytes, "\x02\x01\x12\x34\x01\x02\x03\x04\x05\x06\x01\0", 12),
           "PACK_TX_DB fills header, pointer transfer and bit");
    PACK_TX_DB(&program);
    testOk(tx->bytes[1] == 2, "the counter counts blocks");
    program.counter = 255;
    PACK_TX_DB(&program);
    testOk(tx->bytes[1] == 0, "the counter goes from 255 to 0");
    program.counterFrozen = 1;
    PACK_TX_DB(&program);
    testOk(tx->bytes[1] == 0, "a frozen counter stands");
    tearDown();

    setUp(0);
    memset(tx->bytes, 0xee, 12);
    PACK_TX_DB(&program);
    testOk(!memcmp(tx->bytes, "\xee\xee\xee\xee\x01\x02\x03\x04\x05\x06\xef\xee", 12),
           "without sync there is no header");
    tearDown();

    setUp(1);
    mem.bigEndian = 0;
    PACK_TX_DB(&program);
    testOk(tx->bytes[2] == 0x34 && tx->bytes[3] == 0x12, "the layout id in little endian");
    tearDown();
}

static void testUnpack(void)
{
    setUp(0);
    call(1, 1, 0, DATA);
    testOk(!memcmp(db10->bytes, "\x11\x12\x13\x14\x15\x16\0\0", 8),
           "without sync a block is taken at once");
    call(1, 0, 0, "\x02\x02\x12\x34" EQUAL);
    testOk(db10->bytes[0] == 0x11 && rx->bytes[4] == 1,
           "in LOCAL it stays in IE_RX and is not taken");
    tearDown();
}

static void testSync(void)
{
    setUp(1);
    testOk(answer(BEAT, 1) == SIM_TX_REMOTE, "a heartbeat gives no SYNC");
    testOk(answer(DATA, 1) == SIM_TX_REMOTE && db10->bytes[0] == 1, "data without SYNC is ignored");
    testOk(answer(CHECK_OTHER, 1) == SIM_TX_REMOTE, "CHECKSYNC with another value gives no SYNC");
    testOk(strstr(program.difference, "byte 9 of IE_RX is 0x07, the PLC has 0x06") != NULL,
           "and says where: %s", program.difference);
    testOk(!memcmp(db10->bytes, "\x01\x02\x03\x04\x05\x06\x20\0", 8), "and nothing has moved");
    testOk(answer("\x01\x01\x12\x34\x01\x02\x03\x04\x05\x06\0\0", 1) == SIM_TX_REMOTE,
           "one bit that differs gives no SYNC");
    testOk(answer(CHECK, 1) == (SIM_TX_SYNC | SIM_TX_REMOTE), "equal values give SYNC");
    testOk(answer(CHECK, 1) == (SIM_TX_SYNC | SIM_TX_REMOTE), "with equal values again SYNC stays");
    testOk(answer(DATA, 1) == (SIM_TX_SYNC | SIM_TX_REMOTE) &&
               !memcmp(db10->bytes, "\x11\x12\x13\x14\x15\x16\0\0", 8),
           "then data is taken");
    testOk(!memcmp(tx->bytes + 4, "\x11\x12\x13\x14\x15\x16\0", 7), "and comes back");
    testOk(answer(BEAT, 1) == (SIM_TX_SYNC | SIM_TX_REMOTE) && db10->bytes[0] == 0x11,
           "a heartbeat with old values moves nothing");
    testOk(answer(CHECK, 1) == SIM_TX_REMOTE && db10->bytes[0] == 0x11,
           "a check that fails ends SYNC and moves nothing");
    tearDown();
}

static void testWhatEndsSync(void)
{
    setUp(1);
    answer(CHECK, 1);
    call(0, 1, 1, NULL);
    testOk(tx->bytes[0] == SIM_TX_REMOTE, "a lost connection ends SYNC");
    call(1, 1, 1, NULL);
    testOk(tx->bytes[0] == SIM_TX_REMOTE, "and a new one begins without");
    tearDown();

    setUp(1);
    answer(CHECK, 1);
    simProgramRestart(&program);
    call(1, 1, 1, NULL);
    testOk(tx->bytes[0] == SIM_TX_REMOTE && tx->bytes[1] == 1, "a PLC restart ends SYNC");
    tearDown();

    setUp(1);
    answer(CHECK, 1);
    now += 2.999;
    call(1, 1, 1, NULL);
    testOk(tx->bytes[0] == (SIM_TX_SYNC | SIM_TX_REMOTE), "just before the watchdog SYNC stands");
    now += 0.002;
    call(1, 1, 1, NULL);
    testOk(tx->bytes[0] == (SIM_TX_TIMEOUT | SIM_TX_REMOTE), "the watchdog ends SYNC: TIMEOUT");
    testOk(answer(BEAT, 1) == (SIM_TX_TIMEOUT | SIM_TX_REMOTE), "TIMEOUT stays until SYNC");
    testOk(answer(CHECK, 1) == (SIM_TX_SYNC | SIM_TX_REMOTE), "SYNC ends TIMEOUT");
    now += 2;
    call(1, 1, 0, BEAT);
    now += 2;
    call(1, 1, 1, NULL);
    testOk(tx->bytes[0] == (SIM_TX_SYNC | SIM_TX_REMOTE), "heartbeats keep the watchdog quiet");
    testOk(program.counts.watchdogs == 1, "it expired once");
    program.watchdog = 0;
    now += 1e6;
    call(1, 1, 1, NULL);
    testOk(tx->bytes[0] == (SIM_TX_SYNC | SIM_TX_REMOTE), "watchdog 0: never");
    tearDown();
}

static void testLocal(void)
{
    setUp(1);
    testOk(answer(CHECK, 0) == 0, "no SYNC in LOCAL");
    answer(CHECK, 1);
    testOk(answer(DATA, 0) == 0 && db10->bytes[0] == 1, "LOCAL ends SYNC, data is not taken");
    db10->bytes[0] = 7;
    call(1, 0, 1, NULL);
    testOk(tx->bytes[4] == 7, "what the HMI sets goes to the IOC");
    testOk(answer(DATA, 1) == SIM_TX_REMOTE && db10->bytes[0] == 7, "REMOTE needs a new check");
    tearDown();
}

static void testLayout(void)
{
    setUp(1);
    testOk(answer("\x01\x01\x12\x35" EQUAL, 1) == SIM_TX_REMOTE, "another layout: no SYNC");
    testOk(answer("\x01\x01\0\0" EQUAL, 1) == (SIM_TX_SYNC | SIM_TX_REMOTE),
           "layout 0 is not checked");
    testOk(answer("\x02\x01\x34\x12\x11" EQUAL, 1) == SIM_TX_REMOTE && db10->bytes[0] == 1,
           "a layout that changes ends SYNC, and nothing is taken");
    program.layout = 0;
    testOk(answer("\x01\x01\x34\x12" EQUAL, 1) == (SIM_TX_SYNC | SIM_TX_REMOTE),
           "a PLC without layout takes any");
    tearDown();
}

static void testRefuse(void)
{
    setUp(1);
    program.refuseSync = 1;
    testOk(answer(CHECK, 1) == SIM_TX_REMOTE, "refuse sync: equal values give no SYNC");
    program.refuseSync = 0;
    testOk(answer(CHECK, 1) == (SIM_TX_SYNC | SIM_TX_REMOTE), "and do when it is over");
    tearDown();
}

static void moveSetpoint(void *arg, simPoint point)
{
    if (point == *(simPoint *)arg)
        db10->bytes[1] = 0x77;
}

static void testInterference(void)
{
    simPoint when = pointReceive;

    setUp(1);
    program.interfere = moveSetpoint;
    program.arg = &when;
    testOk(answer(CHECK, 1) == SIM_TX_REMOTE, "the HMI acts before the compare: no SYNC");
    tearDown();

    setUp(1);
    when = pointCheck;
    program.interfere = moveSetpoint;
    program.arg = &when;
    testOk(answer(CHECK, 1) == SIM_TX_REMOTE && db10->bytes[1] == 0x77 &&
               program.counts.syncs == 1 && program.counts.syncsLost == 1,
           "the HMI acts after the compare: SYNC falls in the same cycle");
    tearDown();
}

/* SYNC stands only while the setpoints are those that were last accepted. */
static void testMoved(void)
{
    setUp(1);
    answer(CHECK, 1);
    db10->bytes[0] = 7;
    call(1, 1, 1, NULL);
    testOk(tx->bytes[0] == SIM_TX_REMOTE && tx->bytes[4] == 7,
           "a setpoint moved after a check: its value goes out without SYNC");
    testOk(answer(DATA, 1) == SIM_TX_REMOTE && db10->bytes[0] == 7,
           "and a block that was on its way is not taken");
    testOk(answer(CHECK, 1) == SIM_TX_REMOTE, "nor is a check with the old value");
    testOk(answer("\x01\x01\x12\x34\x07\x02\x03\x04\x05\x06\x01\0", 1) ==
               (SIM_TX_SYNC | SIM_TX_REMOTE),
           "a check with the new value gives SYNC");
    tearDown();

    setUp(1);
    answer(CHECK, 1);
    answer(DATA, 1);
    db10->bytes[6] |= 0x20;
    testOk(answer(DATA, 1) == SIM_TX_REMOTE && db10->bytes[6] == 0x20,
           "a bit moved after data: the next block is not taken");
    tearDown();

    setUp(1);
    answer(CHECK, 1);
    db10->bytes[7] = 1;
    testOk(answer(BEAT, 1) == (SIM_TX_SYNC | SIM_TX_REMOTE),
           "a byte that is no setpoint may move");
    db10->bytes[0] = 7;
    db10->bytes[0] = 1;
    testOk(answer(BEAT, 1) == (SIM_TX_SYNC | SIM_TX_REMOTE),
           "there and back within one cycle is no change");
    tearDown();
}

/* A bad entry in front of a good one. */
static void testBadPointers(void)
{
    static const struct {
        const char *what;
        const char *pair;
        unsigned retVal;
    } rows[] = {
        {"byte 0 is not 0x10",
         "\x11\x02\0\x02\0\x0a\x84\0\0\0\x10\x02\0\x02\0\x01\x84\0\0\x40", 0x8101},
        {"unknown type", "\x10\x77\0\x02\0\x0a\x84\0\0\0\x10\x02\0\x02\0\x01\x84\0\0\x40", 0x8101},
        {"length 0", "\x10\x02\0\0\0\x0a\x84\0\0\0\x10\x02\0\x02\0\x01\x84\0\0\x40", 0x8101},
        {"no such block", "\x10\x02\0\x02\0\x63\x84\0\0\0\x10\x02\0\x02\0\x01\x84\0\0\x40", 0x813a},
        {"no such area", "\x10\x02\0\x02\0\x0a\x77\0\0\0\x10\x02\0\x02\0\x01\x84\0\0\x40", 0x8124},
        {"source beyond the end",
         "\x10\x02\0\x02\0\x0a\x84\0\0\x38\x10\x02\0\x02\0\x01\x84\0\0\x40", 0x8122},
        {"source far beyond the end",
         "\x10\x02\xff\xff\0\x0a\x84\xff\xff\xf8\x10\x02\0\x02\0\x01\x84\0\0\x40", 0x8122},
        {"destination beyond the end",
         "\x10\x02\0\x02\0\x0a\x84\0\0\0\x10\x02\0\x02\0\x01\x84\0\0\x58", 0x8322},
        {"destination not in IE_TX",
         "\x10\x02\0\x02\0\x0a\x84\0\0\0\x10\x02\0\x02\0\x02\x84\0\0\x40", 0x8324},
        {"not on a byte", "\x10\x02\0\x02\0\x0a\x84\0\0\x01\x10\x02\0\x02\0\x01\x84\0\0\x40", 0x8128},
        {"7 bits", "\x10\x01\0\x07\0\x0a\x84\0\0\0\x10\x02\0\x01\0\x01\x84\0\0\x40", 0x8128},
        {"lengths differ", "\x10\x02\0\x02\0\x0a\x84\0\0\0\x10\x02\0\x03\0\x01\x84\0\0\x40", 0x8323},
    };
    static const char good[] = "\x10\x02\0\x01\0\x0a\x84\0\0\0\x10\x02\0\x01\0\x01\x84\0\0\x58";
    size_t i;

    for (i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        epicsUInt8 before[8];

        setUp(1);
        memcpy(program.pack.table->bytes, rows[i].pair, 20);
        memcpy(program.pack.table->bytes + 20, good, 20);
        memcpy(before, db10->bytes, 8);
        PACK_TX_DB(&program);
        PACK_TX_DB(&program);
        testOk(program.pack.retVal == rows[i].retVal && program.counts.pointerErrors == 2 &&
                   tx->bytes[8] == 0 && tx->bytes[11] == 1 && !memcmp(before, db10->bytes, 8),
               "%s: RET_VAL W#16#%04X, refused; the next pointer is served", rows[i].what,
               program.pack.retVal);
        simTransfersFill(&program);
        PACK_TX_DB(&program);
        testOk(program.pack.retVal == 0 && tx->bytes[4] == 1, "and again good when mended");
        tearDown();
    }
}

static void testBadSource(void)
{
    setUp(0);
    memcpy(program.unpack.table->bytes + 4, "\x00\x01", 2);
    call(1, 1, 0, DATA);
    testOk(program.unpack.retVal == 0x8124 && db10->bytes[0] == 1 && db10->bytes[2] == 0x13,
           "source not in IE_RX: RET_VAL W#16#%04X, refused; the next one is served",
           program.unpack.retVal);
    tearDown();
}

MAIN(plcSimTestProgram)
{
    testPlan(30 + 7 + 2 + 12 + 10 + 4 + 4 + 2 + 2 + 7 + 24 + 1);
    simLogQuiet(2);
    testAny();
    testPack();
    testUnpack();
    testSync();
    testWhatEndsSync();
    testLocal();
    testLayout();
    testRefuse();
    testInterference();
    testMoved();
    testBadPointers();
    testBadSource();
    return testDone();
}
