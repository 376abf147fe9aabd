/* Modbus without a network: frames with each of their fields wrong in turn, the same as on a serial
 * line, and which puts leave together. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcModbusFrame.h"
#include "plcModbusPlan.h"
#include "hexBytes.h"

#define COUNT(table) (sizeof(table) / sizeof(table[0]))

static plcFrame frameOf(const char *hex)
{
    plcFrame f = {{0}, 0};

    f.size = hexBytes(hex, f.bytes);
    return f;
}

/* --- Is it the answer? -------------------------------------------------------------------- */

#define READ3 "00 01 00 00 00 06 01 03 00 64 00 02"
#define WRITE16 "00 01 00 00 00 0B 01 10 00 64 00 02 04 00 05 00 06"
#define MASK22 "00 01 00 00 00 08 01 16 00 64 FF FE 00 01"

static const struct {
    const char *what, *request, *answer;
    const char *why;  /* NULL: it is the answer */
    int exception;
} answers[] = {
    {"two registers",                  READ3, "00 01 00 00 00 07 01 03 04 00 05 00 06", NULL, 0},
    {"three registers for two",        READ3, "00 01 00 00 00 09 01 03 06 00 05 00 06 00 07",
     "bad answer: too long", 0},
    {"one register for two",           READ3, "00 01 00 00 00 05 01 03 02 00 05", "bad answer: too short", 0},
    {"two registers that say three",   READ3, "00 01 00 00 00 07 01 03 06 00 05 00 06",
     "bad answer: wrong number of bytes", 0},
    {"two registers that say one",     READ3, "00 01 00 00 00 07 01 03 02 00 05 00 06",
     "bad answer: wrong number of bytes", 0},
    {"an exception",                   READ3, "00 01 00 00 00 03 01 83 02", NULL, 2},
    {"exception 0",                    READ3, "00 01 00 00 00 03 01 83 00", "bad answer: exception 0", 0},
    {"an exception with more behind",  READ3, "00 01 00 00 00 04 01 83 02 00", "bad answer: too long", 0},
    {"nine coils",                     "00 01 00 00 00 06 01 01 00 00 00 09", "00 01 00 00 00 05 01 01 02 FF 01", NULL, 0},
    {"eight discrete inputs",          "00 01 00 00 00 06 01 02 00 00 00 08", "00 01 00 00 00 04 01 02 01 FF", NULL, 0},
    {"input registers",                "00 01 00 00 00 06 01 04 00 00 00 01", "00 01 00 00 00 05 01 04 02 12 34", NULL, 0},
    {"a write",                        WRITE16, "00 01 00 00 00 06 01 10 00 64 00 02", NULL, 0},
    {"a write elsewhere",              WRITE16, "00 01 00 00 00 06 01 10 00 65 00 02", "bad answer: address 101, not 100", 0},
    {"a write of less",                WRITE16, "00 01 00 00 00 06 01 10 00 64 00 01", "bad answer: not what was written", 0},
    {"a mask",                         MASK22, "00 01 00 00 00 08 01 16 00 64 FF FE 00 01", NULL, 0},
    {"another mask",                   MASK22, "00 01 00 00 00 08 01 16 00 64 FF FE 00 03", "bad answer: not what was written", 0},
    {"a single register",              "00 01 00 00 00 06 01 06 00 64 12 34", "00 01 00 00 00 06 01 06 00 64 12 34", NULL, 0},
    {"a single coil",                  "00 01 00 00 00 06 01 05 00 64 FF 00", "00 01 00 00 00 06 01 05 00 64 00 00",
     "bad answer: not what was written", 0},
};

static void testAnswers(void)
{
    size_t i;

    for (i = 0; i < COUNT(answers); i++) {
        plcFrame q = frameOf(answers[i].request), a = frameOf(answers[i].answer);
        plcModbusResult x = {0};
        int status = plcFrameCheck(&q, &a, &x);

        testOk(answers[i].why ? status == -1 && x.lost && strcmp(x.why, answers[i].why) == 0
                              : status == 0 && !x.lost && x.exception == answers[i].exception,
               "%s: %s", answers[i].what, x.lost ? x.why : "the answer");
    }
}

static const struct {
    const char *header, *why;
    size_t size;
} headers[] = {
    {"12 34 00 00 00 06", NULL,                         12 },
    {"12 34 00 00 00 03", NULL,                         9  },
    {"12 34 00 00 00 FE", NULL,                         260},
    {"12 34 00 00 00 02", "bad answer: length 2",       0  },
    {"12 34 00 00 00 FF", "bad answer: length 255",     0  },
    {"12 34 00 00 01 06", "bad answer: length 262",     0  },
    {"12 34 00 01 00 06", "bad answer: no Modbus/TCP",  0  },
    {"12 34 01 00 00 06", "bad answer: no Modbus/TCP",  0  },
};

static void testHeaders(void)
{
    plcFrame q = frameOf(READ3), a = frameOf("00 01 00 00 00 07 02 03 04");
    plcModbusResult x = {0};
    size_t i;

    for (i = 0; i < COUNT(headers); i++) {
        plcFrame f = frameOf(headers[i].header);

        x = (plcModbusResult){0};
        testOk(plcFrameSize(f.bytes, &x) == headers[i].size && x.lost == !headers[i].size &&
                   (!x.lost || strcmp(x.why, headers[i].why) == 0),
               "%s: %s", headers[i].header, x.lost ? x.why : "a frame");
        testOk(plcFrameTransaction(f.bytes) == 0x1234, "its transaction");
    }
    testOk(plcFrameCheckHead(&q, a.bytes, 2, &x) == 0 && plcFrameCheckHead(&q, a.bytes, -1, &x) == 0,
           "the unit that is wanted, or any");
    testOk(plcFrameCheckHead(&q, a.bytes, 1, &x) == -1 &&
               strcmp(x.why, "bad answer: unit 2 instead of 1") == 0,
           "another one: %s", x.why);
    a.bytes[7] = 0x84;
    testOk(plcFrameCheckHead(&q, a.bytes, -1, &x) == -1 &&
               strcmp(x.why, "bad answer: function 4 instead of 3") == 0,
           "the exception of another function: %s", x.why);
    a.bytes[7] = 0x83;
    testOk(plcFrameCheckHead(&q, a.bytes, -1, &x) == 0, "that of this one is an answer");
    plcFrameRefuse(&q, &a);
    testOk(a.size == 9 && plcFrameSize(a.bytes, &x) == 9 && plcFrameTransaction(a.bytes) == 1,
           "a refusal is a frame of its request");
    x = (plcModbusResult){0};
    testOk(plcFrameCheck(&q, &a, &x) == 0 && x.exception == 4, "with exception 4");
}

static void testRtu(void)
{
    plcFrame q = frameOf("00 01 00 00 00 06 11 03 00 6B 00 03"), rtu, a;
    plcModbusResult x = {0};
    plcFrame wanted = frameOf("11 03 00 6B 00 03 76 87");
    plcFrame got = frameOf("11 03 06 AE 41 56 52 43 40 49 AD"), bad;

    plcFrameToRtu(&q, &rtu);
    testOk(rtu.size == wanted.size && memcmp(rtu.bytes, wanted.bytes, rtu.size) == 0,
           "a request as on a serial line, its CRC low byte first");
    testOk(plcRtuSize(&q, got.bytes) == 11, "how long its answer is");
    testOk(plcRtuSize(&q, (const epicsUInt8 *)"\x11\x83") == 5, "and an exception");
    testOk(plcFrameFromRtu(&q, got.bytes, got.size, &a, &x) == 0 && a.size == 15 &&
               plcFrameSize(a.bytes, &x) == 15 && plcFrameCheck(&q, &a, &x) == 0 &&
               memcmp(a.bytes + 9, "\xae\x41\x56\x52\x43\x40", 6) == 0,
           "the answer, with a header");
    bad = got;
    bad.bytes[9] ^= 1;
    testOk(plcFrameFromRtu(&q, bad.bytes, bad.size, &a, &x) == -1 &&
               strcmp(x.why, "bad answer: wrong CRC") == 0,
           "another low byte of the CRC: %s", x.why);
    bad = got;
    bad.bytes[10] ^= 1;
    testOk(plcFrameFromRtu(&q, bad.bytes, bad.size, &a, &x) == -1, "another high byte");
    bad = got;
    bad.bytes[4] ^= 0x80;
    testOk(plcFrameFromRtu(&q, bad.bytes, bad.size, &a, &x) == -1, "another byte of the value");
}

/* --- Which puts leave together ------------------------------------------------------------ */

/* holding 100 to 139 at byte 0, coils 0 to 31 at 80, holding 140 of another unit at 84, coils 140 to 155 at 104; at most 10
 * registers and 20 coils in a request */
static const plcRange ranges[] = {{plcHolding, 100, 40, 0, 0, 0},
                                  {plcCoils, 0, 32, 80, 0, 0},
                                  {plcHolding, 140, 10, 84, 0, 3},
                                  {plcCoils, 140, 16, 104, 0, 0}};

/* A put: "o4" 4 bytes at offset o; "o4:0F00" only these bits of the first bytes. */
static const struct {
    const char *what, *puts, *together; /* for each put: does it join those before? */
} joins[] = {
    {"one register after another",             "0,2 2,2 4,2",               "nyy"},
    {"with a gap",                             "0,2 4,2",                   "nn" },
    {"backwards",                              "2,2 0,2",                   "nn" },
    {"values of two registers",                "0,4 4,4",                   "ny" },
    {"up to ten registers",                    "0,4 4,4 8,4 12,4 16,4 20,2", "nyyyyn"},
    {"a value that would be cut",              "0,4 4,4 8,4 12,4 16,2 18,4", "nyyyyn"},
    {"as many again",                          "0,10 10,10 20,10 30,10",    "nyny"},
    {"one longer than a request",              "0,22 22,2",                 "nn" },
    {"bits of one register",                   "0,2:0100 0,2:0001",         "ny" },
    {"bits of two registers",                  "0,2:0100 2,2:0100",         "nn" },
    {"bits, then the whole register",          "0,2:0100 0,2",              "nn" },
    {"a register, then bits of it",            "0,2 0,2:0100",              "nn" },
    {"a register, then bits of the next",      "0,2 2,2:0100",              "nn" },
    {"half a register is bits of it",          "0,1 1,1",                   "ny" },
    {"bits over two registers",                "0,4:00010100 4,2",          "nn" },
    {"bits of two registers, then of the second", "0,4:01000100 2,2:0100", "nn" },
    {"all bits of one are a whole one",        "0,2:FFFF 2,2",              "ny" },
    {"no bits at all",                         "0,2:0000 0,2",              "nn" },
    {"coils after coils",                      "80,1:0F 80,1:F0 81,1:01",   "nyy"},
    {"coils with a gap",                       "80,1:01 80,1:04",           "nn" },
    {"a put of coils with a gap inside",       "80,1:05 80,1:08",           "nn" },
    {"up to 20 coils",                         "80,1 81,1 82,1:0F 82,1:10", "nyyn"},
    {"registers, then coils",                  "76,2 78,2 80,1",            "nyn"},
    {"the coil of the next number",            "78,2 104,1",                "nn" },
    {"the next register of another unit",      "78,2 84,2 86,2",            "nny"},
    {"a put outside of all ranges",            "120,2 0,2 2,2",             "nny"},
    {"one outside of them between neighbours", "0,2 120,2 2,2",              "nnn"},
    {"a put over the end of one",              "78,4 78,2",                 "nn" },
};

static const char *putOf(const char *at, plcPut *put, epicsUInt8 *mask)
{
    static const epicsUInt8 data[64];
    unsigned bits, i;
    int n = 0;
    unsigned long offset, length;

    sscanf(at, "%lu,%lu%n", &offset, &length, &n);
    *put = (plcPut){offset, length, data, NULL, NULL};
    at += n;
    if (*at == ':') {
        put->mask = mask;
        for (at++, i = 0; *at && *at != ' '; at += 2) {
            sscanf(at, "%2x", &bits);
            mask[i++] = (epicsUInt8)bits;
        }
    }
    return at + strspn(at, " ");
}

static void testJoins(void)
{
    size_t i;

    for (i = 0; i < COUNT(joins); i++) {
        plcJoin join = {.ranges = ranges, .count = COUNT(ranges), .limits = {10, 20}};
        const char *at = joins[i].puts;
        char got[20] = "";
        epicsUInt8 mask[16];
        plcPut put;

        while (*at) {
            at = putOf(at, &put, mask);
            strcat(got, plcPlanJoins(&join, &put) ? "y" : "n");
        }
        testOk(strcmp(got, joins[i].together) == 0, "%s: %s", joins[i].what, got);
    }
}

/* --- Words -------------------------------------------------------------------------------- */

static const char *const exceptions[] = {
    "exception 0, not in the standard",     "exception 1, illegal function",
    "exception 2, illegal data address",    "exception 3, illegal data value",
    "exception 4, device failure",          "exception 5, acknowledge",
    "exception 6, device busy",             "exception 7, negative acknowledge",
    "exception 8, memory parity error",     "exception 9, not in the standard",
    "exception 10, no gateway path",        "exception 11, gateway: no answer",
};

static void testExceptions(void)
{
    char text[40];
    int i;

    for (i = 0; i < (int)COUNT(exceptions); i++) {
        plcExceptionText(i, text, sizeof(text));
        testOk(strcmp(text, exceptions[i]) == 0, "%s", text);
    }
}

/* --- Ranges ------------------------------------------------------------------------------- */

static void testRanges(void)
{
    plcRange *r;
    size_t size;
    char error[200];
    int n = plcRangesParse("holding 0 2 unit 3 every 50, coils 0 9 unit 0x10", 0, &r, &size, error,
                           sizeof(error));

    testOk(n == 2 && r[0].unit == 4 && r[0].period == 50 && r[1].unit == 17 && r[1].offset == 4,
           "ranges of units 3 and 16, which is kept plus one: 0 is that of the command");
    free(r);
    testOk(plcRangesParse("holding 0 2 unit 256", 0, &r, &size, error, sizeof(error)) == -1 &&
               strcmp(error, "range 1 \"holding 0 2 unit 256\": unit \"256\"; allowed: 0 to 255") == 0,
           "%s", error);
    testOk(plcRangesParse("holding 0 2 unit 1 unit 1", 0, &r, &size, error, sizeof(error)) == -1,
           "once: %s", error);
    testOk(strcmp(plcTableName(plcHolding), "holding") == 0 &&
               strcmp(plcTableName(plcDiscrete), "discrete") == 0,
           "tables have names");
}

MAIN(modbusFrameTest)
{
    testPlan(0);
    testAnswers();
    testHeaders();
    testRtu();
    testJoins();
    testExceptions();
    testRanges();
    return testDone();
}
