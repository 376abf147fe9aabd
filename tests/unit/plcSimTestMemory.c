/* plcSimTestMemory: addresses and values of the simulator's PLC memory, byte for byte.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdlib.h>
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "simConfig.h"
#include "simLog.h"
#include "simMemory.h"
#include "simValue.h"

static simMemory mem;
static simBlock *db1;

static void makeMemory(int bigEndian)
{
    simMemoryInit(&mem, bigEndian);
    db1 = simMemoryAdd(&mem, SIM_AREA_DB, 1, 32, "IE_TX");
    simMemoryAdd(&mem, SIM_AREA_DB, 2, 16, "IE_RX");
    simMemoryAdd(&mem, SIM_AREA_DB, 10, 8, "Motor");
    simMemoryAdd(&mem, SIM_AREA_M, 0, 4, NULL);
}

static const struct {
    const char *text;
    unsigned area, number;
    size_t offset;
    int bit;
    size_t width;
} places[] = {
    {"DB10.DBX4.3", SIM_AREA_DB, 10, 4,  3,  1},
    {"DB10.DBB7",   SIM_AREA_DB, 10, 7,  -1, 1},
    {"db10.dbw6",   SIM_AREA_DB, 10, 6,  -1, 2},
    {"DB10.DBD4",   SIM_AREA_DB, 10, 4,  -1, 4},
    {"Motor.4",     SIM_AREA_DB, 10, 4,  -1, 0},
    {"Motor.4.7",   SIM_AREA_DB, 10, 4,  7,  0},
    {"in.0x1f",     SIM_AREA_DB, 1,  31, -1, 0},
    {"out.3",       SIM_AREA_DB, 2,  3,  -1, 0},
    {"IE_RX.DBB15", SIM_AREA_DB, 2,  15, -1, 1},
    {"31",          SIM_AREA_DB, 1,  31, -1, 0},
    {"8.3",         SIM_AREA_DB, 1,  8,  3,  0},
    {"M3.7",        SIM_AREA_M,  0,  3,  7,  0},
    {"MB3",         SIM_AREA_M,  0,  3,  -1, 1},
    {"MW2",         SIM_AREA_M,  0,  2,  -1, 2},
    {"MD0",         SIM_AREA_M,  0,  0,  -1, 4},
};

static const char *const badPlaces[] = {
    "",          "DB10",      "DB11.DBW0",  "DB10.DBW7",   "DB10.DBD5", "DB10.DBB8",
    "DB10.DBX4", "DB10.DBB4.3", "DB10.DBX4.8", "DB10.DBF4", "DB10.-1",  "DB10.DBW 4",
    "in.32",     "nowhere.4", "I0.0",       "MB4",         "MD1",       "4.",
    "0x",        "99999999999999999999",    "DB10.DBX1.3.2", "DB65536.DBB0",
};

static void testPlaces(void)
{
    char error[SIM_ERROR_SIZE];
    simPlace p;
    size_t i;

    for (i = 0; i < sizeof(places) / sizeof(places[0]); i++) {
        int ok = simPlaceParse(&mem, places[i].text, db1, &p, error) == 0;

        testOk(ok && p.block->area == places[i].area && p.block->number == places[i].number &&
                   p.offset == places[i].offset && p.bit == places[i].bit &&
                   p.width == places[i].width,
               "address %s is block %u byte %lu bit %d width %lu", places[i].text,
               places[i].number, (unsigned long)places[i].offset, places[i].bit,
               (unsigned long)places[i].width);
    }
    for (i = 0; i < sizeof(badPlaces) / sizeof(badPlaces[0]); i++) {
        error[0] = 0;
        testOk(simPlaceParse(&mem, badPlaces[i], db1, &p, error) && error[0],
               "address \"%s\" is refused: %s", badPlaces[i], error);
    }
}

/* What `set` writes, and how `get` shows it. */
static const struct {
    const char *type, *value, *shown;
    size_t size;
    const char *big, *little; /* bytes */
} values[] = {
    {"INT8",      "-128", "-128", 1, "\x80", "\x80"},
    {"UINT8",     "255", "255", 1, "\xff", "\xff"},
    {"INT16",     "-2", "-2", 2, "\xff\xfe", "\xfe\xff"},
    {"INT16",     "0xffff", "-1", 2, "\xff\xff", "\xff\xff"},
    {"UINT16",    "4660", "4660", 2, "\x12\x34", "\x34\x12"},
    {"UINT16",    "-1", "65535", 2, "\xff\xff", "\xff\xff"},
    {"INT32",     "-2147483648", "-2147483648", 4, "\x80\0\0\0", "\0\0\0\x80"},
    {"UINT32",    "0x12345678", "305419896", 4, "\x12\x34\x56\x78", "\x78\x56\x34\x12"},
    {"INT64",     "-9223372036854775808", "-9223372036854775808", 8, "\x80\0\0\0\0\0\0\0",
     "\0\0\0\0\0\0\0\x80"},
    {"UINT64",    "18446744073709551615", "18446744073709551615", 8,
     "\xff\xff\xff\xff\xff\xff\xff\xff", "\xff\xff\xff\xff\xff\xff\xff\xff"},
    {"INT64",     "1", "1", 8, "\0\0\0\0\0\0\0\1", "\1\0\0\0\0\0\0\0"},
    {"REAL32",    "1.5", "1.5", 4, "\x3f\xc0\0\0", "\0\0\xc0\x3f"},
    {"REAL32",    "1e300", "3.40282347e+38", 4, "\x7f\x7f\xff\xff", "\xff\xff\x7f\x7f"},
    {"REAL64",    "-2", "-2", 8, "\xc0\0\0\0\0\0\0\0", "\0\0\0\0\0\0\0\xc0"},
    {"STRING[6]", "abc", "\"abc\"", 6, "abc\0\0\0", "abc\0\0\0"},
    {"STRING[3]", "abcdef", "\"abc\"", 3, "abc", "abc"},
    {"S7STRING[6]", "abc", "\"abc\"", 8, "\6\3abc\0\0\0", "\6\3abc\0\0\0"},
    {"S7STRING[2]", "abc", "\"ab\"", 4, "\2\2ab", "\2\2ab"},
    {"S7STRING[2]", "", "\"\"", 4, "\2\0\0\0", "\2\0\0\0"},
    {"SINT",      "-1", "-1", 1, "\xff", "\xff"},
    {"USINT",     "255", "255", 1, "\xff", "\xff"},
    {"INT",       "-2", "-2", 2, "\xff\xfe", "\xfe\xff"},
    {"UINT",      "65535", "65535", 2, "\xff\xff", "\xff\xff"},
    {"DINT",      "-2", "-2", 4, "\xff\xff\xff\xfe", "\xfe\xff\xff\xff"},
    {"UDINT",     "4294967295", "4294967295", 4, "\xff\xff\xff\xff", "\xff\xff\xff\xff"},
    {"LINT",      "1", "1", 8, "\0\0\0\0\0\0\0\1", "\1\0\0\0\0\0\0\0"},
    {"ULINT",     "18446744073709551615", "18446744073709551615", 8,
     "\xff\xff\xff\xff\xff\xff\xff\xff", "\xff\xff\xff\xff\xff\xff\xff\xff"},
    {"LWORD",     "1", "1", 8, "\0\0\0\0\0\0\0\1", "\1\0\0\0\0\0\0\0"},
    {"LREAL",     "-2", "-2", 8, "\xc0\0\0\0\0\0\0\0", "\0\0\0\0\0\0\0\xc0"},
    {"DT",        "2611231201023455", "2611231201023455", 8,
     "\x26\x11\x23\x12\x01\x02\x34\x55", "\x26\x11\x23\x12\x01\x02\x34\x55"},
    {"BYTE",      "0xab", "171", 1, "\xab", "\xab"},
    {"CHAR",      "65", "65", 1, "\x41", "\x41"},
    {"WORD",      "0xabcd", "43981", 2, "\xab\xcd", "\xcd\xab"},
    {"DWORD",     "0x12345678", "305419896", 4, "\x12\x34\x56\x78", "\x78\x56\x34\x12"},
    {"REAL",      "1.5", "1.5", 4, "\x3f\xc0\0\0", "\0\0\xc0\x3f"},
    {"DATE",      "1", "1", 2, "\0\1", "\1\0"},
    {"S5TIME",    "1", "1", 2, "\0\1", "\1\0"},
    {"TIME_OF_DAY", "1", "1", 4, "\0\0\0\1", "\1\0\0\0"},
    {"TOD",       "1", "1", 4, "\0\0\0\1", "\1\0\0\0"},
    {"LTIME",     "1", "1", 8, "\0\0\0\0\0\0\0\1", "\1\0\0\0\0\0\0\0"},
    {"LTOD",      "1", "1", 8, "\0\0\0\0\0\0\0\1", "\1\0\0\0\0\0\0\0"},
    {"LDT",       "1", "1", 8, "\0\0\0\0\0\0\0\1", "\1\0\0\0\0\0\0\0"},
    {"DATE_AND_TIME", "2611231201023455", "2611231201023455", 8,
     "\x26\x11\x23\x12\x01\x02\x34\x55", "\x26\x11\x23\x12\x01\x02\x34\x55"},
    {"TIME",      "2611231201023455", "2611231201023455", 8, "\x26\x11\x23\x12\x01\x02\x34\x55",
     "\x26\x11\x23\x12\x01\x02\x34\x55"},
};

static int setText(const char *place, const char *typeName, char *value,
                   char error[SIM_ERROR_SIZE])
{
    simPlace p;
    simType type;

    if (simPlaceParse(&mem, place, db1, &p, error) || simTypeParse(typeName, &type, error))
        return -1;
    return simValueSet(&mem, &p, &type, &value, 1, error);
}

static void testValues(int bigEndian)
{
    char error[SIM_ERROR_SIZE] = "";
    size_t i;

    for (i = 0; i < sizeof(values) / sizeof(values[0]); i++) {
        const char *bytes = bigEndian ? values[i].big : values[i].little;
        char text[40];
        simText shown = {NULL, 0, 0};
        simPlace p;
        simType type;
        int ok;

        memset(db1->bytes, 0x55, db1->size);
        strcpy(text, values[i].value);
        ok = setText("in.5", values[i].type, text, error) == 0;
        testOk(ok && !memcmp(db1->bytes + 5, bytes, values[i].size) && db1->bytes[4] == 0x55 &&
                   db1->bytes[5 + values[i].size] == 0x55,
               "%s %s has the right bytes, %s endian, and none beside", values[i].type,
               values[i].value, bigEndian ? "big" : "little");
        simPlaceParse(&mem, "in.5", db1, &p, error);
        simTypeParse(values[i].type, &type, error);
        simValueGet(&mem, &p, &type, &shown);
        testOk(!strcmp(shown.text, values[i].shown), "%s %s reads as %s", values[i].type,
               values[i].value, shown.text);
        simTextFree(&shown);
    }
}

static const struct {
    const char *place, *type, *value;
} badValues[] = {
    {"in.0",      "INT8",      "128"                 },
    {"in.0",      "INT8",      "-129"                },
    {"in.0",      "UINT8",     "256"                 },
    {"in.0",      "INT16",     "32768"               },
    {"in.0",      "INT16",     "1.5"                 },
    {"in.0",      "INT16",     "0x10000"             },
    {"in.0",      "INT16",     ""                    },
    {"in.0",      "INT16",     "12x"                 },
    {"in.0",      "UINT64",    "18446744073709551616"},
    {"in.0",      "REAL32",    "one"                 },
    {"in.0",      "TIME",      "26"                  },
    {"in.0",      "TIME",      "261123120102345g"    },
    {"in.0",      "BOOL",      "1"                   },
    {"in.0.1",    "BOOL",      "2"                   },
    {"in.0.1",    "INT16",     "2"                   },
    {"in.31",     "INT16",     "2"                   },
    {"in.0",      "STRING[33]", "x"                  },
    {"DB1.DBW0",  "INT32",     "2"                   },
    {"in.0",      "INT17",     "2"                   },
    {"in.0",      "INT16[0]",  "2"                   },
    {"in.0",      "INT16[2",   "2"                   },
    {"in.0",      "INT16[2]",  "2"                   },
    {"in.0",      "TIME[2]",   "2"                   },
};

static void testBadValues(void)
{
    char error[SIM_ERROR_SIZE];
    epicsUInt8 before[32];
    char text[40];
    size_t i;

    memset(db1->bytes, 0x5a, db1->size);
    memcpy(before, db1->bytes, sizeof(before));
    for (i = 0; i < sizeof(badValues) / sizeof(badValues[0]); i++) {
        strcpy(text, badValues[i].value);
        error[0] = 0;
        testOk(setText(badValues[i].place, badValues[i].type, text, error) && error[0] &&
                   !memcmp(before, db1->bytes, sizeof(before)),
               "%s %s \"%s\" is refused: %s", badValues[i].place, badValues[i].type,
               badValues[i].value, error);
    }
}

static void testBits(void)
{
    char error[SIM_ERROR_SIZE];
    char one[] = "1", zero[] = "0";

    memset(db1->bytes, 0, db1->size);
    testOk(setText("DB1.DBX2.7", "BOOL", one, error) == 0 && db1->bytes[2] == 0x80,
           "DBX2.7 is the highest bit of byte 2");
    setText("DB1.DBX2.0", "BOOL", one, error);
    testOk(db1->bytes[2] == 0x81, "DBX2.0 is the lowest bit, the others stay");
    setText("DB1.DBX2.7", "BOOL", zero, error);
    testOk(db1->bytes[2] == 0x01, "a bit is cleared, the others stay");
}

static void testBlocks(void)
{
    testOk(simMemoryAdd(&mem, SIM_AREA_DB, 1, 4, NULL) == NULL, "no second DB1");
    testOk(simMemoryAdd(&mem, SIM_AREA_DB, 20, 0, NULL) == NULL, "no block of 0 bytes");
    testOk(simMemoryAdd(&mem, SIM_AREA_DB, 20, 65537, NULL) == NULL, "no block of 65537 bytes");
    testOk(simMemoryAdd(&mem, SIM_AREA_DB, 20, 65536, NULL) != NULL, "a block of 65536 bytes");
    testOk(simMemoryFindName(&mem, "in") == db1 && simMemoryFindName(&mem, "ie_tx") == db1,
           "in and ie_tx are IE_TX");
    testOk(simMemoryFindName(&mem, "") == NULL, "no name finds no block");
}

static const struct {
    const char *line;
    int count;
    const char *words[4];
} lines[] = {
    {"", 0, {NULL}},
    {"   # comment", 0, {NULL}},
    {"a b  c", 3, {"a", "b", "c"}},
    {"a\tb # c", 2, {"a", "b"}},
    {"a#b", 1, {"a#b"}},
    {"text \"two words\" x", 3, {"text", "two words", "x"}},
    {"\"a \\\" b \\\\\"", 1, {"a \" b \\"}},
    {"\"\" x", 2, {"", "x"}},
    {"\"open", -1, {NULL}},
    {"a b c d e", -1, {NULL}},
};

static void testSplit(void)
{
    char error[SIM_ERROR_SIZE];
    char text[64];
    char *words[4];
    size_t i;

    for (i = 0; i < sizeof(lines) / sizeof(lines[0]); i++) {
        int same, j, count;

        strcpy(text, lines[i].line);
        count = simSplit(text, words, 4, error);
        same = count == lines[i].count;
        for (j = 0; same && j < count; j++)
            same = !strcmp(words[j], lines[i].words[j]);
        testOk(same, "the line <%s> has %d words", lines[i].line, lines[i].count);
    }
}

MAIN(plcSimTestMemory)
{
    testPlan(15 + 22 + 4 * 44 + 23 + 3 + 6 + 10);
    makeMemory(1);
    testPlaces();
    testValues(1);
    testBadValues();
    testBits();
    testBlocks();
    testSplit();
    simMemoryFree(&mem);
    makeMemory(0);
    testValues(0);
    simMemoryFree(&mem);
    return testDone();
}
