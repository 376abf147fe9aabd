/* plcSimTestConfig: the simulator's file: what is read, and what each error says.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "simBlockServer.h"
#include "simConfig.h"
#include "simLog.h"
#include "simLoop.h"
#include "simPlc.h"
#include "simServers.h"

/* Builds a PLC from text. Returns the number of errors; messages are in out. */
static int build(const char *text, simConfig *config, simPlc *plc, simText *out)
{
    static simLoop loop;
    int errors;

    simLoopInit(&loop);
    simConfigInit(config);
    simServersKeys(config);
    errors = simConfigReadText(config, "t.plc", text, out);
    errors += simPlcBuild(plc, &loop, config, simServers, "PLC", out);
    return errors;
}

static void dismantle(simConfig *config, simPlc *plc, simText *out)
{
    simPlcFree(plc);
    simConfigFree(config);
    simTextFree(out);
}

static const struct {
    const char *what, *text, *message;
} bad[] = {
    {"a size that is no number", "in = abc", "t.plc:1: in = abc: allowed is a number 0 ... 65536"},
    {"a size that is too large", "\nout = 65537", "t.plc:2: out = 65537: allowed"},
    {"a negative size", "in = -1", "t.plc:1: in = -1: allowed"},
    {"a port that is too large", "port = 65536", "t.plc:1: port = 65536: allowed"},
    {"an unknown key", "inn = 5", "t.plc:1: \"inn\" is no key"},
    {"an unknown byte order", "byteorder = middle", "allowed is little|big"},
    {"an unknown unit", "period = 5 parsec", "unknown unit"},
    {"a period of 0", "period = 0 ms", "period = 0 ms: allowed is 0.1 ms ... 3600 s"},
    {"an empty value", "period =", "is no time"},
    {"an empty name", "name =", "name: allowed are 1 ... 31 characters"},
    {"an unknown statement", "sginal 0 INT16 counter", "\"sginal\" is no statement"},
    {"a missing quote", "in = 8\nsignal 0 STRING text \"a", "t.plc:2: a \" is missing"},
    {"a signal outside", "in = 8\nsignal 7 INT16 counter", "t.plc:2: INT16 of 2 bytes at offset 7"},
    {"a signal without block", "signal 0 INT16 counter", "in = 0"},
    {"a mirror without arrow", "in = 8\nout = 8\nmirror 0 8 0", "t.plc:3: a mirror wants"},
    {"a mirror outside of out", "in = 8\nout = 8\nmirror 4 5 -> 0", "outside of the 8 bytes of out"},
    {"a mirror outside of in", "in = 8\nout = 8\nmirror 0 4 -> 5", "outside of the 8 bytes of in"},
    {"a mirror with sync", "in = 8\nout = 8\nsync = on\nmirror 0 4 -> 4", "no mirror with sync"},
    {"two blocks with one number", "db 10 8\ndb 10 8", "t.plc:2: there is a DB10 already"},
    {"two blocks with one name", "db 10 8 a\ndb 11 8 A", "t.plc:2: there is a block \"A\""},
    {"a block of 0 bytes", "db 10 0", "a data block wants"},
    {"a block with IE_TX's number", "in = 8\ndb 1 8", "there is a DB1 already"},
    {"IE_TX and IE_RX in one", "in = 8\nout = 8\nie_rx = 1", "different DB numbers"},
    {"an init that does not fit", "db 10 8\ninit DB10.DBB0 256", "does not fit into UINT8"},
    {"sync with 3 bytes", "in = 3\nout = 8\nsync = on", "need 4 bytes at least"},
    {"tx to another block", "in = 8\ndb 9 8\ntx DB9.DBW0 -> DB9.DBW2", "tx goes to IE_TX"},
    {"rx from another block", "out = 8\ndb 9 8\nrx DB9.DBW0 -> DB9.DBW2", "rx comes from IE_RX"},
    {"a transfer of two widths", "in = 8\ndb 9 8\ntx DB9.DBW0 -> in.DBD0", "equally wide"},
    {"a transfer without width", "in = 8\ndb 9 8\ntx DB9.0 -> 0", "equally wide"},
    {"a transfer beyond the end", "in = 8\ndb 9 8\ntx DB9.DBD0 -> 6", "beyond the end"},
    {"a pointer with a bad type", "in = 8\ndb 9 8\ntx P#DB9.DBX0.0 BITE 4 -> 0", "is no type"},
    {"a pointer without length", "in = 8\ndb 9 8\ntx P#DB9.DBX0.0 BYTE -> 0", "a transfer wants"},
    {"a pointer with length 0", "in = 8\ndb 9 8\ntx P#DB9.DBX0.0 BYTE 0 -> 0", "1 ... 65535"},
    {"a pointer to a byte", "in = 8\ndb 9 8\ntx P#DB9.DBB0 BYTE 4 -> 0", "is no pointer"},
    {"pointers of two lengths",
     "in = 8\ndb 9 8\ntx P#DB9.DBX0.0 BYTE 4 -> P#DB1.DBX0.0 BYTE 3", "different lengths"},
    {"a table where a block is", "in = 8\ndb 3 8\ntx P#DB3.DBX0.0 BYTE 4 -> 0",
     "DB_TX_PTRS cannot be DB3"},
    {"map without sync", "in = 32\nout = 32\nmap = on", "map = on needs sync = on"},
    {"map_rows between two multiples", "in = 48\nout = 32\nmap = on\nsync = on\nmap_rows = 33",
     "map_rows is a multiple of 8"},
    {"tables without room for their header, and a transfer",
     "in = 32\nout = 12\nmap = on\nsync = on\ndb 9 8\ntx P#DB9.DBX0.0 BYTE 4 -> 20",
     "need 16 bytes at least"},
};

static void testBad(void)
{
    size_t i;

    for (i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        simConfig config;
        simPlc plc;
        simText out = {NULL, 0, 0};
        int errors = build(bad[i].text, &config, &plc, &out);

        testOk(errors >= 1 && out.text && strstr(out.text, bad[i].message),
               "%s is refused: %.*s", bad[i].what,
               out.text ? (int)strcspn(out.text, "\n") : 4, out.text ? out.text : "none");
        dismantle(&config, &plc, &out);
    }
}

static void testGood(void)
{
    static const char text[] = "# a comment\n"
                               "  port=0x7d0   # another\n"
                               "In = 128\r\n"
                               "out = 64\n"
                               "byteorder = LITTLE\n"
                               "period = 0.02 s\n"
                               "name = \"Press 1\"\n"
                               "db 10 64 Motor\n"
                               "init Motor.4 INT16 -2\n"
                               "init in.100 REAL32[2] 1 2\n"
                               "signal 0 INT16 constant 5\n"
                               "mirror 0 64 -> 64\n";
    simConfig config;
    simPlc plc;
    simText out = {NULL, 0, 0};
    int errors = build(text, &config, &plc, &out);
    const simBlockServer *blocks;

    testOk(errors == 0, "a good file has no errors");
    blocks = simPlcServerOf(&plc, &simBlockServerType);
    testOk(blocks->keys->port == 2000 && config.in == 128 && config.out == 64, "port and sizes");
    testOk(!config.bigEndian && config.period == 0.02, "byte order and period");
    testOk(!strcmp(config.name, "Press 1"), "a name with a blank");
    testOk(plc.signalCount == 1 && blocks->mirrorCount == 1, "a signal and a mirror");
    testOk(!memcmp(simMemoryFindName(&plc.memory, "Motor")->bytes + 4, "\xfe\xff", 2),
           "init writes in the PLC's byte order");
    testOk(!memcmp(plc.tx->bytes + 100, "\0\0\x80\x3f\0\0\0\x40", 8), "init of an array");
    dismantle(&config, &plc, &out);
}

static const struct {
    const char *text;
    double seconds;
} times[] = {
    {"100",     0.1  },
    {"100 ms",  0.1  },
    {"1.5s",    1.5  },
    {"2 min",   120  },
    {"1h",      3600 },
    {"500us",   0.0005},
};

static void testTimes(void)
{
    char error[SIM_ERROR_SIZE];
    double seconds;
    size_t i;

    for (i = 0; i < sizeof(times) / sizeof(times[0]); i++)
        testOk(simTimeParse(times[i].text, &seconds, error) == 0 &&
                   seconds > times[i].seconds * 0.999999 && seconds < times[i].seconds * 1.000001,
               "%s is %g s", times[i].text, times[i].seconds);
}

MAIN(plcSimTestConfig)
{
    testPlan(39 + 7 + 6);
    testBad();
    testGood();
    testTimes();
    return testDone();
}
