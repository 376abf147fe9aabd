/* The table of options: each key with its range, what is refused and in which words. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <epicsString.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "phoenixPair.h"
#include "plcOptions.h"
#include "testTools.h"
#ifdef WITH_MODBUS
#include "plcModbusOptions.h"
#endif

/* A table that is added, as transports do. */
typedef struct ownOptions {
    double place;
    int choice;
    double number, whole;
} ownOptions;

static const plcOptionRow ownRows[] = {
    {.key = "ownPlace", .kind = plcOptPlace, .field = offsetof(ownOptions, place), .max = 65535,
     .unit = "register", .initial = PLC_OFF, .help = "a place"},
    {.key = "ownChoice", .kind = plcOptChoice, .field = offsetof(ownOptions, choice),
     .words = "refuse|rmw", .initial = 1, .help = "a choice"},
    {.key = "ownNumber", .kind = plcOptNumber, .field = offsetof(ownOptions, number), .min = 1,
     .max = 9, .unit = "ms", .initial = 7, .help = "a number"},
    {.key = "ownWhole", .kind = plcOptWhole, .field = offsetof(ownOptions, whole), .min = 1,
     .max = 9, .unit = "registers", .initial = 7, .help = "a whole number"},
};

static plcOptionTable ownTable = {.rows = ownRows, .count = 4, .size = sizeof(ownOptions),
                                  .of = "own", .uses = "heartbeat", .usesWith = "ownPlace"};

#define BLOCKS (plcOptInBlocks | plcOptOutBlocks | plcOptOffsets)
#define REGISTERS (plcOptRequests | plcOptAcks | plcOptOffsets)
#define TAGS (plcOptRequests | plcOptAcks)

/* Options that have no effect: on which PLC, and what is said of it. */
static const struct {
    const char *set; /* key=value ... */
    unsigned wire;
    const char *name; /* of its transport */
    const char *line; /* NULL: nothing is said */
} idle[] = {
    {"recvTimeout=500", BLOCKS, "", NULL},
    {"recvTimeout=500", REGISTERS, "own", "recvTimeout=500 has no effect on this PLC: only for PLCs that send blocks"},
    {"recvTimeout=500", TAGS, "tags", "recvTimeout=500 has no effect on this PLC: only for PLCs that send blocks"},
    {"sendInterval=50 holdoff=3 offlineWrites=reject minUpdate=50 scan=changed track=on log=io", TAGS, "tags", NULL},
    {"requestTimeout=50", BLOCKS, "", "requestTimeout=50 has no effect on this PLC: only for PLCs that are asked by requests"},
    {"requestTimeout=50 readPeriod=20 complete=sent writes=all", REGISTERS, "own", NULL},
    {"requestTimeout=50 complete=sent writes=all", TAGS, "tags", NULL},
    {"complete=sent", BLOCKS, "", "complete=sent has no effect on this PLC: only for wires that acknowledge puts"},
    {"writes=all", BLOCKS, "", "writes=all has no effect on this PLC: only for wires that acknowledge puts"},
    {"readPeriod=20", BLOCKS, "", "only for PLCs that are asked by requests"},
    {"readPeriod=20", TAGS, "tags", "only for values with offsets, not names"},
    {"wordOrder=low", TAGS, "tags", "wordOrder=low has no effect on this PLC: only for values with offsets, not names"},
    {"textOrder=BADC", TAGS, "tags", "only for values with offsets, not names"},
    {"wordOrder=low textOrder=BADC", REGISTERS, "own", NULL},
    {"heartbeat=500", BLOCKS, "", NULL},
    {"heartbeat=500", TAGS, "tags", "heartbeat=500 has no effect on this PLC: only for outputs that leave in blocks"},
    {"heartbeat=500", REGISTERS, "own", "heartbeat=500 has no effect on this PLC: it needs option ownPlace"},
    {"heartbeat=500 ownPlace=7", REGISTERS, "own", NULL},
    {"ownNumber=5", REGISTERS, "own", NULL},
    {"ownNumber=5", BLOCKS, "", "ownNumber=5 has no effect on this PLC: only for: own"},
    {"ownNumber=7", BLOCKS, "", NULL}, /* as it is by default */
    {"pingPeriod=100", BLOCKS, "", "pingPeriod=100 has no effect on this PLC: only for: redundant pair"},
    {"pingPeriod=100", BLOCKS, "redundant pair", NULL},
    {"layout=5", BLOCKS, "", "layout=5 has no effect on this PLC: it needs option sync or layoutAt"},
    {"layout=5 layoutAt=2", BLOCKS, "", NULL},
    {"sync=on layout=5", BLOCKS, "", NULL},
    {"aliveTimeout=50", BLOCKS, "", "aliveTimeout=50 has no effect on this PLC: it needs option alive"},
    {"alive=4 aliveTimeout=50", BLOCKS, "", NULL},
};

static const struct {
    const char *key, *value;
    const char *summary; /* all options that differ from the default; NULL: refused */
} rows[] = {
    {"recvTimeout", "500", "recvTimeout=500"},
    {"recvTimeout", "10", "recvTimeout=10"},
    {"recvTimeout", "3600000", "recvTimeout=3600000"},
    {"recvTimeout", "9.9", NULL},
    {"recvTimeout", "0", NULL},
    {"recvTimeout", "-1", NULL},
    {"recvTimeout", "3600001", NULL},
    {"recvTimeout", "", NULL},
    {"recvTimeout", "fast", NULL},
    {"recvTimeout", "5 s", NULL},
    {"recvTimeout", "nan", NULL},
    {"recvTimeout", "inf", NULL},
    {"RECVTIMEOUT", "500", "recvTimeout=500"},
    {"sendInterval", "1", "sendInterval=1"},
    {"sendInterval", "0.5", NULL},
    {"holdoff", "0", "holdoff=0"},
    {"holdoff", "10000", "holdoff=10000"},
    {"holdoff", "10001", NULL},
    {"heartbeat", "500", "heartbeat=500"},
    {"heartbeat", "0", ""},
    {"heartbeat", "-1", NULL},
    {"heartbeat", "1", "heartbeat=1"},
    {"heartbeat", "0.0001", NULL},
    {"heartbeat", "-0", ""},
    {"heartbeat", "nan", NULL},
    {"heartbeat", "inf", NULL},
    {"heartbeat", "1e300", NULL},
    {"holdoff", "0.1", "holdoff=0.1"},
    {"holdoff", "1e-9", NULL},
    {"minUpdate", "0.001", NULL},
    {"minUpdate", "1", "minUpdate=1"},
    {"readPeriod", "1e-7", NULL},
    {"readPeriod", "10", "readPeriod=10"},
    {"readPeriod", "9.999", NULL},
    {"pingPeriod", "0", "pingPeriod=0"},
    {"pingPeriod", "0.001", NULL},
    {"pingPeriod", "50", "pingPeriod=50"},
    {"pingPeriod", "-inf", NULL},
    {"requestTimeout", "1e-7", NULL},
    {"connectTimeout", "nan", NULL},
    {"aliveTimeout", "1e-7", NULL},
    {"alive", "-4294967292", NULL},
    {"readback", "-18446744073709551612", NULL},
    {"ownPlace", "-4294967295", NULL},
    {"layout", "nan", NULL},
    {"layout", "-1", NULL},
    {"layout", "65536", NULL},
    {"layout", "65535", "layout=65535"},
    {"layout", "0xCAFE", "layout=51966"},
    {"layout", "010", "layout=10"},
    {"layout", "1.5", NULL},
    {"layout", "1e2", NULL},
    {"layout", "4294967297", NULL},
    {"layout", "18446744073709551617", NULL},
    {"layout", "-18446744073709551615", NULL},
    {"layout", "", NULL},
    {"layout", "7 8", NULL},
    {"ownWhole", "9", "ownWhole=9"},
    {"ownWhole", "1.5", NULL},
    {"ownWhole", "0", NULL},
#ifdef WITH_MODBUS
    {"maxRegisters", "1.5", NULL},
    {"maxRegisters", "1e2", NULL},
    {"maxBits", "7.9", NULL},
    {"maxBits", "2000", ""},
#endif
    {"offlineWrites", "reject", "offlineWrites=reject"},
    {"offlineWrites", "REJECT", "offlineWrites=reject"},
    {"offlineWrites", "keep", ""},
    {"offlineWrites", "rej", NULL},
    {"offlineWrites", "rejected", NULL},
    {"offlineWrites", "", NULL},
    {"offlineWrites", "1", NULL},
    {"minUpdate", "50", "minUpdate=50"},
    {"minUpdate", "-0.1", NULL},
    {"scan", "changed", "scan=changed"},
    {"scan", "all", ""},
    {"scan", "some", NULL},
    {"wholeBlock", "on", "wholeBlock=on"},
    {"wholeBlock", "1", "wholeBlock=on"},
    {"wholeBlock", "0", ""},
    {"wholeBlock", "2", NULL},
    {"scanThread", "callback", "scanThread=callback"},
    {"scanThread", "own", ""},
    {"scanThread", "1", NULL},
    {"alive", "4", "alive=4,UINT16"},
    {"alive", "0x10,UINT32", "alive=16,UINT32"},
    {"alive", "4,byte", "alive=4,UINT8"},
    {"alive", "4,INT64", "alive=4,INT64"},
    {"alive", "off", ""},
    {"alive", "4,REAL32", NULL},
    {"alive", "4,STRING", NULL},
    {"alive", "4,", NULL},
    {"alive", "4 UINT16", NULL},
    {"alive", "-4", NULL},
    {"alive", "", NULL},
    {"alive", "16777217", NULL},
    {"aliveTimeout", "100", "aliveTimeout=100"},
    {"aliveTimeout", "9", NULL},
    {"timestamp", "8", "timestamp=8,DT"},
    {"timestamp", "8,DTL", "timestamp=8,DTL"},
    {"timestamp", "8,dt", "timestamp=8,DT"},
    {"timestamp", "8,UTC", NULL},
    {"timestamp", "off", ""},
    {"readback", "64", "readback=64"},
    {"readback", "64,DT", NULL},
    {"readback", "off", ""},
    {"track", "on", "track=on"},
    {"track", "maybe", NULL},
    {"connectTimeout", "50", "connectTimeout=50"},
    {"connectTimeout", "49", NULL},
    {"wordOrder", "low", "wordOrder=low"},
    {"wordOrder", "HIGH", "wordOrder=high"},
    {"wordOrder", "bytes", ""},
    {"wordOrder", "off", NULL},
    {"wordOrder", "1", NULL},
    {"requestTimeout", "10", "requestTimeout=10"},
    {"requestTimeout", "60000", "requestTimeout=60000"},
    {"requestTimeout", "9", NULL},
    {"requestTimeout", "60001", NULL},
    {"readPeriod", "0", "readPeriod=0"},
    {"readPeriod", "-1", NULL},
    {"ownChoice", "refuse", "ownChoice=refuse"},
    {"ownChoice", "rmw", ""},
    {"ownChoice", "1", NULL},
    {"ownNumber", "9", "ownNumber=9"},
    {"ownNumber", "10", NULL},
    {"ownPlace", "0", "ownPlace=0"},
    {"ownPlace", "65535", "ownPlace=65535"},
    {"ownPlace", "0x100", "ownPlace=256"},
    {"ownPlace", "off", ""},
    {"ownPlace", "65536", NULL},
    {"ownPlace", "-1", NULL},
    {"ownPlace", "5,DT", NULL},
    {"noSuchKey", "1", NULL},
    {"", "1", NULL},
};

static void testRow(size_t row)
{
    plcOptions options, before;
    char error[400] = "", summary[400];
    int status;

    plcOptionsDefault(&options);
    before = options;
    status = plcOptionsSet(&options, rows[row].key, rows[row].value, 0, error, sizeof(error));
    plcOptionsSummary(&options, summary, sizeof(summary));
    if (rows[row].summary)
        testOk(status == 0 && strcmp(summary, rows[row].summary) == 0,
               "%s=%s is taken: \"%s\"", rows[row].key, rows[row].value, summary);
    else
        testOk(status == -1 && memcmp(&options, &before, sizeof(options)) == 0 &&
                   strstr(error, "allowed:"),
               "%s=%s is refused: %s", rows[row].key, rows[row].value, error);
}

static void note(void *arg, const char *line)
{
    strcat(arg, line);
}

static void setAll(plcOptions *o, const char *text)
{
    char copy[200], key[40], value[40], error[400], *save = NULL, *word;

    strcpy(copy, text);
    for (word = epicsStrtok_r(copy, " ", &save); word; word = epicsStrtok_r(NULL, " ", &save))
        if (sscanf(word, "%39[^=]=%39s", key, value) != 2 ||
            plcOptionsSet(o, key, value, 0, error, sizeof(error)))
            testAbort("%s", word);
}

static void testIdle(size_t row)
{
    const char *const names[] = {"single PLC", idle[row].name, NULL};
    char said[1000] = "", again[1000] = "";
    plcOptions before, now;

    plcOptionsDefault(&before);
    now = before;
    setAll(&now, idle[row].set);
    plcOptionsIdle(&before, &now, idle[row].wire, names, note, said);
    plcOptionsIdle(&now, &now, idle[row].wire, names, note, again);
    testOk((idle[row].line ? strstr(said, idle[row].line) != NULL : !said[0]) && !again[0],
           "%s over \"%s\": %s", idle[row].set, idle[row].name, said[0] ? said : "used");
}

static void testTexts(void)
{
    plcOptions options;
    char error[400];

    plcOptionsDefault(&options);
    plcOptionsSet(&options, "heartbeat", "-1", 0, error, sizeof(error));
    testOk(strcmp(error, "option heartbeat=-1; allowed: 0, or 1 to 3600000 ms") == 0,
           "a number says its range and unit: %s", error);
    plcOptionsSet(&options, "layout", "-1", 0, error, sizeof(error));
    testOk(strcmp(error, "option layout=-1; allowed: 0 to 65535") == 0,
           "a number without a unit its range alone: %s", error);
    plcOptionsSet(&options, "layout", "1e2", 0, error, sizeof(error));
    testOk(strcmp(error, "option layout=1e2; allowed: 0 to 65535, a whole number") == 0,
           "one that must be whole says so: %s", error);
    plcOptionsSet(&options, "scan", "x", 0, error, sizeof(error));
    testOk(strcmp(error, "option scan=x; allowed: all|changed") == 0,
           "a choice says its words: %s", error);
    plcOptionsSet(&options, "ownPlace", "x", 0, error, sizeof(error));
    testOk(strcmp(error, "option ownPlace=x; allowed: off, or register 0 to 65535") == 0,
           "a register says its range: %s", error);
    {
        char many[1001];

        memset(many, 'x', sizeof(many) - 1);
        many[sizeof(many) - 1] = 0;
        plcOptionsSet(&options, "scan", many, 0, error, sizeof(error));
        testOk(strstr(error, "xxx; allowed: all|changed") != NULL, "behind a long value, too");
        plcOptionsSet(&options, many, "1", 0, error, sizeof(error));
        testOk(strstr(error, "xxx\"; allowed: recvTimeout") != NULL, "and behind a long key");
    }
    plcOptionsSet(&options, "hartbeat", "1", 0, error, sizeof(error));
    testOk(strstr(error, "\"hartbeat\"") && strstr(error, " heartbeat") &&
               strstr(error, " connectTimeout"),
           "an unknown key names all keys");
    testOk(plcOptionsSet(&options, "scan", "changed", 1, error, sizeof(error)) == -1 &&
               strstr(error, "before iocInit"),
           "scan only before iocInit: %s", error);
    testOk(plcOptionsSet(&options, "readback", "4", 1, error, sizeof(error)) == -1 &&
               strstr(error, "before iocInit"),
           "readback only before iocInit");
    testOk(plcOptionsSet(&options, "wordOrder", "low", 1, error, sizeof(error)) == -1 &&
               strstr(error, "before iocInit"),
           "wordOrder only before iocInit");
    testOk(plcOptionsSet(&options, "heartbeat", "100", 1, error, sizeof(error)) == 0 &&
               options.heartbeat == 100,
           "heartbeat at any time");
    {
        char small[10] = "";

        plcOptionsSet(&options, "heartbeat", "forever", 0, small, sizeof(small));
        testOk(strlen(small) < sizeof(small), "a small buffer is not overrun");
        plcOptionsSummary(&options, small, sizeof(small));
        testOk(strlen(small) < sizeof(small), "nor by the summary");
        plcOptionsSet(&options, "no", "1", 0, small, sizeof(small));
        testOk(strlen(small) < sizeof(small), "nor by the list of keys");
    }
}

/* Tables of others are apart from each other and from ours. */
static void testOwn(void)
{
    plcOptions options;
    const ownOptions *own;
    char error[400];

    plcOptionsAdd(&ownTable); /* a second time is nothing */
    plcOptionsDefault(&options);
    own = plcOptionsOwn(&options, &ownTable);
    testOk(own->place == PLC_OFF && own->choice == 1 && own->number == 7,
           "an added table has its defaults");
    plcOptionsSet(&options, "ownNumber", "5", 0, error, sizeof(error));
    plcOptionsSet(&options, "pingPeriod", "70", 0, error, sizeof(error));
    plcOptionsSet(&options, "heartbeat", "3", 0, error, sizeof(error));
    testOk(own->place == PLC_OFF && own->choice == 1 && own->number == 5 &&
               options.heartbeat == 3,
           "and its values, whatever others have");
}

/* The printed table has a line for each key. */
static void testPrint(void)
{
    plcOptions options;
    char error[200], *text = NULL;
    size_t size = 0;
    FILE *file = open_memstream(&text, &size);

    plcOptionsDefault(&options);
    plcOptionsSet(&options, "alive", "6,INT32", 0, error, sizeof(error));
    plcOptionsPrint(&options, file);
    fclose(file);
    testOk(strstr(text, "recvTimeout") && strstr(text, "6,INT32") &&
               strstr(text, "keep|reject") && strstr(text, "connectTimeout"),
           "the table shows keys, values and what is allowed");
    free(text);
    file = open_memstream(&text, &size);
    plcOptionsPrint(NULL, file);
    fclose(file);
    testOk(strstr(text, "alive             off") != NULL, "or the defaults");
    free(text);
}

/* The manual has a line for each key, with its range. */
static void testManual(void)
{
    char *manual = toolReadFile("docs/options.md"), *text = NULL, *line, key[40], cell[60];
    size_t size = 0;
    FILE *file = open_memstream(&text, &size);
    int count = 0, missing = 0;

    plcOptionsPrint(NULL, file);
    fclose(file);
    for (line = strtok(text, "\n"); line; line = strtok(NULL, "\n")) {
        if (line[2] == ' ' || sscanf(line, "%39s", key) != 1 || strncmp(key, "own", 3) == 0)
            continue;
        count++;
        sprintf(cell, "| `%s` ", key);
        if (!strstr(manual, cell)) {
            missing++;
            testDiag("docs/options.md has no %s", key);
        }
    }
    testOk(count > 10 && missing == 0, "docs/options.md has all %d options", count);
    free(text);
    free(manual);
}

/* What s7plcConfigure may be told, as the options have it. */
static void testLimits(void)
{
    double min = 0, max = 0, initial = -1;

    testOk(plcOptionsLimits("recvTimeout", &min, &max, &initial) == 0 && min == 10 && max == 3600000,
           "the limits of a number: %g to %g", min, max);
    testOk(plcOptionsLimits("scan", &min, &max, &initial) == -1 &&
               plcOptionsLimits("nonsense", &min, &max, &initial) == -1 && min == 10,
           "of a choice there are none, nor of an unknown key");
}

MAIN(optionsTest)
{
    size_t i;

    testPlan((int)(sizeof(rows) / sizeof(rows[0]) + sizeof(idle) / sizeof(idle[0])) + 22);
    phoenixPairInit();
#ifdef WITH_MODBUS
    plcOptionsAdd(&plcModbusOptionTable);
#endif
    plcOptionsAdd(&ownTable);
    for (i = 0; i < sizeof(rows) / sizeof(rows[0]); i++)
        testRow(i);
    for (i = 0; i < sizeof(idle) / sizeof(idle[0]); i++)
        testIdle(i);
    testTexts();
    testOwn();
    testPrint();
    testManual();
    testLimits();
    return testDone();
}
