/* plcSimTestModbus: the simulator's Modbus without a network: areas, requests and answers
 * by literal bytes, and which faults meet which requests.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcSimBuilt.h"
#include "simModbusServer.h"

static simLoop loop;
static plcSimBuilt built;
static simModbus *modbus; /* of its server */

static int build(const char *text)
{
    int errors = plcSimBuild(&built, &loop, text);
    simModbusServer *server = simPlcServerOf(&built.plc, &simModbusServerType);

    modbus = &server->modbus;
    return errors;
}

static void dismantle(void)
{
    plcSimDismantle(&built);
}

/* ---- the file ---- */

#define DB "modbus_port = 0\ndb 10 20\ndb 11 2\n"

/* clang-format off */
static const struct {
    const char *what, *text, *message;
} bad[] = {
    {"a port that is too large", "modbus_port = 65536",
     "modbus_port = 65536: allowed is off or a number 0 ... 65535"},
    {"a unit that is too large", "modbus_unit = 256",
     "allowed is any or a number 0 ... 255"},
    {"areas without a port", "db 10 20\nmodbus holding 0 1 -> DB10.0",
     "modbus_port = off"},
    {"a pair", "modbus_port = 0\nrole = pair", "modbus_port needs role = single"},
    {"an unknown table", DB "modbus holdings 0 1 -> DB10.0",
     "t.plc:4: modbus holdings: allowed are holding, input, coils, discrete and without"},
    {"no table", DB "modbus", "t.plc:4: modbus: allowed are"},
    {"no arrow", DB "modbus holding 0 1 DB10.0",
     "modbus holding wants: <first> <count> ->"},
    {"a word too many", DB "modbus holding 0 1 -> DB10.0 often", "modbus holding wants"},
    {"no count", DB "modbus holding 0 0 -> DB10.0", "allowed are addresses 0 ... 65535"},
    {"an address that is too large", DB "modbus holding 65536 1 -> DB10.0",
     "allowed are"},
    {"a count that goes beyond", DB "modbus holding 65535 2 -> DB10.0", "allowed are"},
    {"a negative address", DB "modbus holding -1 2 -> DB10.0", "allowed are"},
    {"an unknown block", DB "modbus holding 0 1 -> DB12.0", "no block \"DB12\""},
    {"one register too many", DB "modbus holding 0 11 -> DB10.0",
     "11 registers from DB10.0 on take 22 bytes and are outside of DB10, which has 20 "
     "bytes"},
    {"one register too far", DB "modbus holding 0 10 -> DB10.1", "outside of DB10"},
    {"one bit too many", DB "modbus coils 0 17 -> DB11.0",
     "17 bits from DB11.0 on take 3 bytes"},
    {"one bit too far", DB "modbus coils 0 14 -> DB11.DBX0.3", "outside of DB11"},
    {"a register at a bit", DB "modbus input 0 1 -> DB10.DBX0.0", "names a bit"},
    {"areas that overlap",
     DB "modbus holding 0 5 -> DB10.0\nmodbus holding 4 2 -> DB10.10",
     "t.plc:5: modbus holding: 0 ... 4 and 4 ... 5 overlap"},
    {"a function 0", DB "modbus without 3 0",
     "modbus without 0: a function is 1 ... 127"},
    {"without nothing", DB "modbus without", "modbus without wants"},
};
/* clang-format on */

static void testBad(void)
{
    size_t i;

    for (i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        int errors = build(bad[i].text);

        testOk(errors >= 1 && built.messages.text && strstr(built.messages.text, bad[i].message),
               "%s: %.*s", bad[i].what,
               built.messages.text ? (int)strcspn(built.messages.text, "\n") : 4,
               built.messages.text ? built.messages.text : "none");
        dismantle();
    }
}

/* ---- requests and answers ---- */

/* DB10, 40 bytes: holding 0..9 are bytes 0..19, 10..14 are bytes 30..39 (read only);
 * input 100..103 are bytes 0..7. DB20, 4 bytes: coils 0..9, 16..23, from bit 3 of byte 0
 * on. */
#define AREAS                                                                            \
    "modbus_port = 0\n"                                                                  \
    "db 10 40\n"                                                                         \
    "db 20 4\n"                                                                          \
    "modbus holding 0 10 -> DB10.0\n"                                                    \
    "modbus holding 10 5 -> DB10.30 readonly\n"                                          \
    "modbus holding 65530 6 -> DB10.18\n"                                                \
    "modbus input 100 4 -> DB10.0\n"                                                     \
    "modbus coils 0 10 -> DB20.DBX0.3\n"                                                 \
    "modbus coils 16 8 -> DB20.3\n"                                                      \
    "modbus discrete 0 32 -> DB20.0\n"                                                   \
    "modbus without 4 99\n"                                                              \
    "init DB10.0 UINT16[4] 0x0102 0x0304 0x0506 0x0708\n"                                \
    "init DB10.DBW30 0x1112\n"                                                           \
    "init DB20.DBB0 0xa8\n"                                                              \
    "init DB20.DBB3 0x81\n"

static size_t fromHex(const char *text, epicsUInt8 *bytes)
{
    size_t count = 0;
    unsigned value;
    int used;

    for (; sscanf(text, " %2x%n", &value, &used) == 1; text += used)
        bytes[count++] = (epicsUInt8)value;
    return count;
}

/* A request of this PDU, unit 7, transaction 0x5152. Returns bytes. */
static size_t frame(const char *pdu, epicsUInt8 *bytes)
{
    size_t size = fromHex(pdu, bytes + SIM_MBAP);

    bytes[0] = 0x51;
    bytes[1] = 0x52;
    bytes[2] = bytes[3] = bytes[4] = 0;
    bytes[5] = (epicsUInt8)(size + 1);
    bytes[6] = 7;
    return size + SIM_MBAP;
}

static size_t ask(const epicsUInt8 *bytes, size_t size, epicsUInt8 *answer)
{
    simRequest request;
    int code = simRequestParse(&request, bytes, size);

    if (!code)
        code = simRequestCheck(&request, &modbus->map);
    return code ? simAnswerException(&modbus->answerer, &request, code, answer)
                : simAnswer(&modbus->answerer, &request, answer);
}

static void testAsk(const char *what, const char *pdu, const char *wanted)
{
    epicsUInt8 bytes[2 * SIM_MODBUS_ADU], answer[SIM_MODBUS_ADU], want[SIM_MODBUS_ADU];
    size_t size = ask(bytes, frame(pdu, bytes), answer);
    size_t wantSize = frame(wanted, want);
    simText got = {NULL, 0, 0};

    simTextHex(&got, answer, size);
    testOk(size == wantSize && !memcmp(answer, want, size), "%s: %s", what, got.text);
    simTextFree(&got);
}

/* clang-format off */
static const struct {
    const char *what, *request, *answer;
} exchanges[] = {
    {"FC3 reads in big endian", "03 0000 0003", "03 06 0102 0304 0506"},
    {"FC3 reads over two areas", "03 0009 0002", "03 04 0000 1112"},
    {"FC3 reads the last address", "03 ffff 0001", "03 02 0000"},
    {"FC3 beyond the last address", "03 ffff 0002", "83 02"},
    {"FC3 from 0 on: an end that has no area", "03 000e 0002", "83 02"},
    {"FC4 is without", "04 0064 0002", "84 01"},
    {"FC1 reads from bit 3 on", "01 0000 000a", "01 02 15 00"},
    {"FC1 into the gap", "01 0009 0002", "81 02"},
    {"FC2 reads the same memory", "02 0000 0008", "02 01 a8"},
    {"FC2 reads all", "02 0000 0020", "02 04 a8 00 00 81"},
    {"FC2 reads one too many", "02 0000 0021", "82 02"},
    {"FC5 sets a bit", "05 0001 ff00", "05 0001 ff00"},
    {"and no other", "02 0000 0008", "02 01 b8"},
    {"FC5 clears it", "05 0001 0000", "05 0001 0000"},
    {"and no other", "02 0000 0008", "02 01 a8"},
    {"FC5 with another value", "05 0001 0001", "85 03"},
    {"FC6 writes", "06 0001 abcd", "06 0001 abcd"},
    {"and FC3 reads it", "03 0000 0003", "03 06 0102 abcd 0506"},
    {"FC6 to what is read only", "06 000a abcd", "86 02"},
    {"FC15 writes over a byte border", "0f 0004 0003 01 07", "0f 0004 0003"},
    {"and nothing else", "02 0000 0020", "02 04 a8 03 00 81"},
    {"FC15 into the gap writes nothing", "0f 0009 0002 01 03", "8f 02"},
    {"so nothing changed", "02 0000 0020", "02 04 a8 03 00 81"},
    {"FC15 with a wrong byte count", "0f 0000 0009 01 ff", "8f 03"},
    {"FC16 writes", "10 0004 0002 04 2122 2324", "10 0004 0002"},
    {"FC3 reads it", "03 0003 0004", "03 08 0708 2122 2324 0000"},
    {"FC16 half into what is read only", "10 0009 0002 04 ffff ffff", "90 02"},
    {"so nothing changed", "03 0009 0002", "03 04 0000 1112"},
    {"FC16 with a wrong byte count", "10 0000 0002 02 ffff", "90 03"},
    {"FC16 with a byte too many", "10 0000 0001 02 ffff ff", "90 03"},
    {"FC16 with 0 registers", "10 0000 0000 00", "90 03"},
    {"FC22 sets and clears bits", "16 0004 00f0 0004", "16 0004 00f0 0004"},
    {"(2122 AND 00f0) OR (0004 AND NOT 00f0)", "03 0004 0001", "03 02 0024"},
    {"FC22 to what is read only", "16 000a 0000 0000", "96 02"},
    {"FC22 that is too short", "16 0004 00f0", "96 03"},
    {"FC23 writes, then reads", "17 0003 0003 0004 0001 02 3132", "17 06 0708 3132 2324"},
    {"FC23 reads where nothing is", "17 0010 0001 0004 0001 02 0000", "97 02"},
    {"then it has written nothing", "03 0004 0001", "03 02 3132"},
    {"FC23 writes where nothing is", "17 0000 0001 0010 0001 02 0000", "97 02"},
    {"FC3 with 0 registers", "03 0000 0000", "83 03"},
    {"FC3 with 126 registers", "03 0000 007e", "83 03"},
    {"FC1 with 2001 bits", "01 0000 07d1", "81 03"},
    {"FC3 that is too short", "03 0000", "83 03"},
    {"FC3 that is too long", "03 0000 0001 00", "83 03"},
    {"FC3 without anything", "03", "83 03"},
    {"FC7, which nobody knows", "07", "87 01"},
    {"FC17, which libmodbus knows", "11", "91 01"},
    {"FC43", "2b 0e 01 00", "ab 01"},
    {"FC0", "00", "80 01"},
    {"FC99, which is without", "63", "e3 01"},
};
/* clang-format on */

static void testExchanges(void)
{
    size_t i;

    if (build(AREAS) || simAnswererOpen(&modbus->answerer, &modbus->map, "PLC"))
        testAbort("%s", built.messages.text);
    for (i = 0; i < sizeof(exchanges) / sizeof(exchanges[0]); i++)
        testAsk(exchanges[i].what, exchanges[i].request, exchanges[i].answer);
    simAnswererClose(&modbus->answerer);
    dismantle();
}

static void testLittleEndian(void)
{
    if (build("byteorder = little\n" AREAS) ||
        simAnswererOpen(&modbus->answerer, &modbus->map, "PLC"))
        testAbort("%s", built.messages.text);
    testOk(!memcmp(simMemoryFind(&built.plc.memory, SIM_AREA_DB, 10)->bytes, "\x02\x01\x04\x03",
                   4),
           "a little endian PLC has the low byte first");
    testAsk("and Modbus the high one", "03 0000 0002", "03 04 0102 0304");
    testAsk("FC6", "06 0001 abcd", "06 0001 abcd");
    testOk(!memcmp(simMemoryFind(&built.plc.memory, SIM_AREA_DB, 10)->bytes, "\x02\x01\xcd\xab",
                   4),
           "writes the low byte first");
    testAsk("coils are the same bits", "01 0000 0005", "01 01 15");
    simAnswererClose(&modbus->answerer);
    dismantle();
}

/* ---- limits ---- */

/* A write of `count` values of `bytes` bytes in all. */
static size_t writeFrame(unsigned function, unsigned count, size_t bytes, epicsUInt8 *out)
{
    char head[20];
    size_t size;

    snprintf(head, sizeof(head), "%02x 0000 %04x %02x", function, count, (unsigned)bytes);
    size = frame(head, out);
    memset(out + size, 0x5a, bytes);
    size += bytes;
    out[4] = (epicsUInt8)((size - 6) >> 8);
    out[5] = (epicsUInt8)(size - 6);
    return size;
}

static void testLimits(void)
{
    static const struct {
        unsigned function, count;
        size_t bytes;
        int code;
    } rows[] = {
        {15, 1968, 246, 0},
        {15, 1969, 247, 3},
        {16, 123,  246, 0},
        {16, 124,  248, 3},
        {16, 1,    246, 3},
        {15, 1960, 246, 3}, {16, 127, 254, 3},
    };
    epicsUInt8 bytes[2 * SIM_MODBUS_ADU], answer[SIM_MODBUS_ADU];
    size_t i;

    if (build("modbus_port = 0\ndb 10 4000\nmodbus holding 0 2000 -> DB10.0\n"
              "modbus coils 0 32000 -> DB10.0\n") ||
        simAnswererOpen(&modbus->answerer, &modbus->map, "PLC"))
        testAbort("%s", built.messages.text);
    for (i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        size_t size = writeFrame(rows[i].function, rows[i].count, rows[i].bytes, bytes);
        size_t got = ask(bytes, size, answer);

        testOk(rows[i].code ? got == 9 && answer[8] == rows[i].code
                            : got == 12 && answer[7] == rows[i].function,
               "FC%u with %u values in %lu bytes: %s", rows[i].function, rows[i].count,
               (unsigned long)rows[i].bytes, rows[i].code ? "exception 3" : "done");
    }
    testOk(ask(bytes, frame("03 0000 007d", bytes), answer) == 259,
           "125 registers are read");
    testOk(ask(bytes, frame("01 0000 07d0", bytes), answer) == 259, "2000 bits are read");
    testOk(answer[9] == 0x5a, "and they are what was written");
    simAnswererClose(&modbus->answerer);
    dismantle();
}

static void testFrames(void)
{
    /* clang-format off */
    static const struct {
        const char *what, *bytes;
        size_t size;
    } rows[] = {
        {"nothing yet", "", 8},
        {"half a header", "00 01 00 00 00", 8},
        {"a header", "00 01 00 00 00 06", 12},
        {"a request and more", "00 01 00 00 00 06 01 03 00 00 00 01 00 02", 12},
        {"the longest", "00 01 00 00 00 fe", 260},
        {"longer, for exception 3", "00 01 00 00 01 26", 300},
        {"still longer", "00 01 00 00 01 27", 0},
        {"a length of 1", "00 01 00 00 00 01", 0},
        {"a length of 0", "00 01 00 00 00 00", 0},
        {"another protocol", "00 01 00 01", 0},
        {"HTTP", "47 45 54 20 2f 20", 0},
    };
    /* clang-format on */
    epicsUInt8 bytes[SIM_MODBUS_ADU];
    size_t i;

    for (i = 0; i < sizeof(rows) / sizeof(rows[0]); i++)
        testOk(simFrameSize(bytes, fromHex(rows[i].bytes, bytes)) == rows[i].size,
               "%s: %lu bytes", rows[i].what, (unsigned long)rows[i].size);
}

/* ---- faults ---- */

static int parse(simModbusFaults *faults, const char *line, char *error)
{
    char text[200];
    char *words[20];

    strcpy(text, line);
    return simModbusFaultParse(faults, words, (size_t)simSplit(text, words, 20, error),
                               error);
}

static void testFaultWords(void)
{
    static const struct {
        const char *line, *text; /* NULL: refused */
    } rows[] = {
        {"exception 2",                    " exception=2"                     },
        {"exception 11 holding 17",        " exception=11,holding=17..17"     },
        {"exception 2 holding 17 3 write", " exception=2,write,holding=17..19"},
        {"exception 4 function 16 next 5", " exception=4,function=16,next=5"  },
        {"exception 4 coils read",         " exception=4,read,coils"          },
        {"busy 3",                         " exception=6,next=3"              },
        {"busy",                           " exception=6"                     },
        {"slow 200",                       " slow=200"                        },
        {"slow 200 next 1",                " slow=200,next=1"                 },
        {"silent",                         " silent"                          },
        {"silent on",                      " silent"                          },
        {"silent next 2 write",            " silent,write,next=2"             },
        {"wrongunit",                      " wrongunit"                       },
        {"wrongid next 1",                 " wrongid,next=1"                  },
        {"short 5",                        " short=5"                         },
        {"short 5 close next 1",           " short=5,close,next=1"            },
        {"close reply",                    " close"                           },
        {"close next 1",                   " close,next=1"                    },
        {"garbage 30",                     " garbage=30"                      },
        {"silent off",                     " none"                            },
        {"exception",                      NULL                               },
        {"exception 0",                    NULL                               },
        {"exception 12",                   NULL                               },
        {"exception two",                  NULL                               },
        {"exception 2 holding 65536",      NULL                               },
        {"exception 2 holding 65535 2",    NULL                               },
        {"exception 2 registers 5",        NULL                               },
        {"exception 2 next",               NULL                               },
        {"exception 2 next 0",             NULL                               },
        {"slow",                           NULL                               },
        {"slow -1",                        NULL                               },
        {"silent 5",                       NULL                               },
        {"short",                          NULL                               },
        {"short 261",                      NULL                               },
    };
    size_t i;

    for (i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        char error[SIM_ERROR_SIZE] = "";
        simModbusFaults faults;
        simText text = {NULL, 0, 0};
        int status;

        memset(&faults, 0, sizeof(faults));
        status = parse(&faults, rows[i].line, error);
        simModbusFaultsText(&faults, &text);
        if (rows[i].text)
            testOk(status == 0 && !strcmp(text.text, rows[i].text), "\"%s\" is%s",
                   rows[i].line, text.text);
        else
            testOk(status == -1 && error[0] && faults.count == 0, "\"%s\" is refused: %s",
                   rows[i].line, error);
        simTextFree(&text);
    }
}

/* The fate of a request with this PDU. */
static simModbusFate meet(simModbusFaults *faults, const char *pdu)
{
    epicsUInt8 bytes[2 * SIM_MODBUS_ADU];
    simRequest request;
    simModbusFate fate;

    simRequestParse(&request, bytes, frame(pdu, bytes));
    simModbusFaultsMeet(faults, &request, &fate);
    return fate;
}

static void testFilters(void)
{
    static const struct {
        const char *fault, *pdu;
        int meets;
    } rows[] = {
        {"exception 2 holding 17",       "03 0011 0001",                   1},
        {"exception 2 holding 17",       "03 0010 0001",                   0},
        {"exception 2 holding 17",       "03 0012 0001",                   0},
        {"exception 2 holding 17",       "03 0000 007d",                   1},
        {"exception 2 holding 17",       "10 0010 0002 04 0000 0000",      1},
        {"exception 2 holding 17",       "04 0011 0001",                   0},
        {"exception 2 holding 17 write", "03 0011 0001",                   0},
        {"exception 2 holding 17 write", "06 0011 0001",                   1},
        {"exception 2 holding 17 write", "16 0011 0001 0001",              1},
        {"exception 2 holding 17 write", "17 0011 0001 0010 0001 02 0000", 0},
        {"exception 2 holding 17 write", "17 0010 0001 0011 0001 02 0000", 1},
        {"exception 2 holding 17 read",  "17 0011 0001 0010 0001 02 0000", 1},
        {"exception 2 holding 17 3",     "03 0013 0001",                   1},
        {"exception 2 holding 17 3",     "03 0014 0001",                   0},
        {"exception 2 holding",          "03 1234 0001",                   1},
        {"exception 2 holding",          "01 1234 0001",                   0},
        {"exception 2 coils",            "0f 0000 0001 01 01",             1},
        {"exception 2 write",            "05 0000 ff00",                   1},
        {"exception 2 write",            "01 0000 0001",                   0},
        {"exception 2 function 3",       "03 0000 0001",                   1},
        {"exception 2 function 3",       "04 0000 0001",                   0},
        {"exception 2",                  "2b 0e 01 00",                    1},
    };
    char error[SIM_ERROR_SIZE];
    size_t i;

    for (i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        simModbusFaults faults;

        memset(&faults, 0, sizeof(faults));
        parse(&faults, rows[i].fault, error);
        testOk((meet(&faults, rows[i].pdu).exception == 2) == rows[i].meets, "%s %s %s",
               rows[i].fault, rows[i].meets ? "meets" : "does not meet", rows[i].pdu);
    }
}

static void testFates(void)
{
    static simModbusFaults faults;
    char error[SIM_ERROR_SIZE];
    simModbusFate fate;
    int i;

    fate = meet(&faults, "03 0000 0001");
    testOk(!fate.silent && !fate.exception && fate.delay == 0 && fate.shorten == -1 &&
               fate.garbage == -1 && !fate.half && !fate.wrongId && !fate.wrongUnit,
           "without faults nothing happens");
    parse(&faults, "busy 2", error);
    testOk(meet(&faults, "03 0000 0001").exception == 6, "busy 2: once");
    testOk(meet(&faults, "03 0000 0001").exception == 6, "twice");
    testOk(meet(&faults, "03 0000 0001").exception == 0 && faults.count == 0,
           "and no more");

    parse(&faults, "exception 4", error);
    parse(&faults, "exception 2 holding 5 next 1", error);
    parse(&faults, "slow 250", error);
    fate = meet(&faults, "03 0005 0001");
    testOk(fate.exception == 2 && fate.delay == 0.25, "the newer exception, and slow");
    testOk(meet(&faults, "03 0005 0001").exception == 4, "then the older one");
    parse(&faults, "exception 5", error);
    testOk(meet(&faults, "03 0005 0001").exception == 5 && faults.count == 2,
           "a new one for the same requests replaces the old one");
    parse(&faults, "exception off", error);
    testOk(meet(&faults, "03 0005 0001").exception == 0 && faults.count == 1,
           "exception off leaves slow");
    simModbusFaultsClear(&faults);
    testOk(faults.count == 0, "clear ends all");
    for (i = 0; i < SIM_MODBUS_RULES; i++) {
        char line[40];

        snprintf(line, sizeof(line), "exception 2 holding %d", i);
        parse(&faults, line, error);
    }
    testOk(faults.count == SIM_MODBUS_RULES && parse(&faults, "silent", error) == -1,
           "there is room for %d: then %s", SIM_MODBUS_RULES, error);
}

MAIN(plcSimTestModbus)
{
    testPlan(163);
    simLogQuiet(2);
    testBad();
    testExchanges();
    testLittleEndian();
    testLimits();
    testFrames();
    testFaultWords();
    testFilters();
    testFates();
    return testDone();
}
