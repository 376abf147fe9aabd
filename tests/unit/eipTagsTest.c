/* The tags of a PLC without a network: types and numbers, texts of tags and their paths, which
 * services go into one message, what the list and the templates tell, and where data goes. */
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <epicsMath.h>
#include <epicsStdio.h>
#include <epicsString.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "eipLink.h"
#include "eipPlaces.h"
#include "eipTags.h"
#include "hexBytes.h"

#define COUNT(table) (sizeof(table) / sizeof(table[0]))

static epicsUInt32 seed = 1;

static unsigned randomBelow(unsigned n)
{
    seed = seed * 1664525u + 1013904223u;
    return (seed >> 8) % n;
}

static void hexOf(const void *bytes, size_t n, char *text)
{
    size_t i;

    text[0] = 0;
    for (i = 0; i < n; i++)
        sprintf(text + strlen(text), "%s%02X", i ? " " : "", ((const epicsUInt8 *)bytes)[i]);
}

/* --- Types -------------------------------------------------------------------------------- */

static const struct {
    const char *type, *bytes, *text;
    const char *tooMuch; /* the first number that it has not; NULL: none */
} numbers[] = {
    {"BOOL",  "00",                      "0",                    NULL                  },
    {"BOOL",  "FF",                      "1",                    NULL                  },
    {"SINT",  "80",                      "-128",                 "-129"                },
    {"SINT",  "7F",                      "127",                  "128"                 },
    {"INT",   "00 80",                   "-32768",               "-32769"              },
    {"INT",   "FF 7F",                   "32767",                "32768"               },
    {"DINT",  "00 00 00 80",             "-2147483648",          "-2147483649"         },
    {"DINT",  "D2 02 96 49",             "1234567890",           "2147483648"          },
    {"LINT",  "00 00 00 00 00 00 00 80", "-9223372036854775808", NULL                  },
    {"LINT",  "FF FF FF FF FF FF FF 7F", "9223372036854775807",  "9223372036854775808" },
    {"USINT", "FF",                      "255",                  "256"                 },
    {"USINT", "00",                      "0",                    "-1"                  },
    {"UINT",  "40 9C",                   "40000",                "65536"               },
    {"UDINT", "FF FF FF FF",             "4294967295",           "4294967296"          },
    {"ULINT", "FF FF FF FF FF FF FF FF", "18446744073709551615", NULL                  },
    {"REAL",  "CD CC CC 3D",             "0.1",                  "1e39"                },
    {"REAL",  "00 00 20 C1",             "-10",                  NULL                  },
    {"LREAL", "9A 99 99 99 99 99 B9 3F", "0.1",                  NULL                  },
    {"BYTE",  "A5",                      "165",                  "256"                 },
    {"WORD",  "A5 5A",                   "23205",                "65536"               },
    {"DWORD", "01 00 00 80",             "2147483649",           "4294967296"          },
    {"LWORD", "01 00 00 00 00 00 00 80", "9223372036854775809",  NULL                  },
};

static void testNumbers(void)
{
    size_t i, n;

    for (i = 0; i < COUNT(numbers); i++) {
        const eipType *type = eipTypeNamed(numbers[i].type);
        epicsUInt8 raw[8], back[8] = {0};
        eipNumber number, parsed = {eipSigned, {0}};
        char text[40];

        n = hexBytes(numbers[i].bytes, raw);
        eipNumberGet(type, raw, &number);
        eipNumberText(type, &number, text, sizeof(text));
        testOk(n == type->size && strcmp(text, numbers[i].text) == 0, "%s %s is %s",
               type->name, numbers[i].bytes, text);
        testOk(eipNumberParse(type, text, &parsed) == 0 &&
                   eipNumberPut(type, back, &parsed) == 0 &&
                   (memcmp(raw, back, n) == 0 || type->code == eipBool),
               "and back");
        if (!numbers[i].tooMuch)
            continue;
        parsed.kind = numbers[i].tooMuch[0] == '-' ? eipSigned : eipUnsigned;
        parsed.u.integer = parsed.kind == eipSigned
                               ? strtoll(numbers[i].tooMuch, NULL, 10)
                               : (epicsInt64)strtoull(numbers[i].tooMuch, NULL, 10);
        if (type->kind == eipReal) {
            parsed.kind = eipReal;
            parsed.u.real = strtod(numbers[i].tooMuch, NULL);
        }
        testOk(eipNumberPut(type, back, &parsed) == -1, "%s has no %s", type->name,
               numbers[i].tooMuch);
    }
}

static const struct {
    double value;
    const char *type;
    const char *bytes; /* NULL: it does not fit */
} reals[] = {
    {2.5,           "DINT",  "03 00 00 00"            },
    {-2.5,          "INT",   "FD FF"                  },
    {-0.4,          "USINT", "00"                     },
    {-0.5,          "INT",   "FF FF"                  },
    {0.5,           "INT",   "01 00"                  },
    {-0.6,          "USINT", NULL                     },
    {32767.4,       "INT",   "FF 7F"                  },
    {32767.5,       "INT",   NULL                     },
    {1e19,          "LINT",  NULL                     },
    {1e19,          "ULINT", "00 00 E8 89 04 23 C7 8A"},
    {3.0,           "BOOL",  "01"                     },
    {1e300,         "REAL",  NULL                     },
};

static void testReals(void)
{
    size_t i;

    for (i = 0; i < COUNT(reals); i++) {
        const eipType *type = eipTypeNamed(reals[i].type);
        eipNumber number = {eipReal, {0}};
        epicsUInt8 raw[8] = {0}, wanted[8] = {0};
        int status;

        number.u.real = reals[i].value;
        status = eipNumberPut(type, raw, &number);
        if (reals[i].bytes)
            hexBytes(reals[i].bytes, wanted);
        testOk(status == (reals[i].bytes ? 0 : -1) && memcmp(raw, wanted, 8) == 0,
               "%g %s %s", reals[i].value, reals[i].bytes ? "as" : "does not fit",
               reals[i].type);
    }
    {
        eipNumber number = {eipReal, {0}};
        epicsUInt8 raw[8];

        number.u.real = epicsNAN;
        testOk(eipNumberPut(eipTypeNamed("DINT"), raw, &number) == -1, "NaN is no DINT");
        testOk(eipNumberPut(eipTypeNamed("REAL"), raw, &number) == 0, "but a REAL");
        number.u.real = epicsINF;
        testOk(eipNumberPut(eipTypeNamed("REAL"), raw, &number) == 0, "so is infinity");
    }
}

static void testStrings(void)
{
    epicsUInt8 raw[300];
    char longText[256];
    const char *text;
    size_t n;

    testOk(eipTextPut(eipStructureCode, raw, 88, 82, "hello", 5) == 88 && raw[0] == 5 &&
               memcmp(raw + 4, "hello\0\0", 7) == 0 && raw[87] == 0,
           "a STRING is written whole");
    text = eipTextGet(eipStructureCode, raw, 88, &n);
    testOk(text && n == 5 && memcmp(text, "hello", 5) == 0, "and read");
    testOk(eipTextPut(eipStructureCode, raw, 16, 10, "hello world", 11) == 0,
           "a text of 11 does not fit STRING_10");
    testOk(eipTextPut(eipStringCode, raw, 50, 0, "abc", 3) == 5 &&
               memcmp(raw, "\3\0abc", 5) == 0,
           "STRING D0 has a length of two bytes");
    testOk(eipTextPut(eipStringCode, raw, 4, 0, "abc", 3) == 0, "but not more than the tag has bytes for");
    testOk(eipTextPut(eipShortString, raw, 50, 0, "abc", 3) == 4 &&
               memcmp(raw, "\3abc", 4) == 0,
           "SHORT_STRING of one");
    memset(longText, 'x', sizeof(longText));
    testOk(eipTextPut(eipStringCode, raw, sizeof(raw), 0, longText, 256) == 258 &&
               eipTextPut(eipShortString, raw, sizeof(raw), 0, longText, 256) == 0 &&
               eipTextPut(eipShortString, raw, sizeof(raw), 0, longText, 255) == 256,
           "256 characters go into a STRING D0, not into a SHORT_STRING");
    raw[0] = 83;
    testOk(!eipTextGet(eipStructureCode, raw, 86, &n), "a length beyond the bytes is none");
    raw[3] = 0x80;
    testOk(!eipTextGet(eipStructureCode, raw, 88, &n), "nor is a negative one");
}

static const struct {
    const char *from, *bytes, *to;
    const char *as; /* bytes; or why not */
} casts[] = {
    {"UDINT", "FF FF FF 7F",             "DINT",  "FF FF FF 7F"                       },
    {"UDINT", "00 28 6B EE",             "DINT",  "4000000000 is above 2147483647"    },
    {"LINT",  "FF FF FF 7F FF FF FF FF", "DINT",  "-2147483649 is below -2147483648"  },
    {"ULINT", "FF FF FF FF FF FF FF FF", "LINT",  "18446744073709551615 is above 2^63-1"},
    {"ULINT", "FF FF FF FF FF FF FF FF", "DINT",  "18446744073709551615 is above 2^31-1"},
    {"LINT",  "00 00 00 00 00 00 00 80", "DINT",  "-9223372036854775808 is below -2^31"},
    {"SINT",  "FF",                      "UDINT", "-1 is below 0"                     },
    {"SINT",  "FF",                      "INT",   "FF FF"                             },
    {"SINT",  "FF",                      "USINT", "FF"                                },
    {"INT",   "C8 00",                   "SINT",  "200 is above 127"                  },
    {"DWORD", "FF FF FF FF",             "DINT",  "FF FF FF FF"                       },
    {"DINT",  "FF FF FF FF",             "DWORD", "FF FF FF FF"                       },
    {"INT",   "FF FF",                   "DWORD", "FF FF 00 00"                       },
    {"DINT",  "FF FF FF FF",             "WORD",  "-1 is below 0"                     },
    {"LWORD", "FF FF FF FF 01 00 00 00", "DINT",  "8589934591 is above 2147483647"    },
    {"LWORD", "FF FF FF FF FF FF FF FF", "LINT",  "FF FF FF FF FF FF FF FF"           },
    {"REAL",  "CA F2 49 71",             "DINT",  "1e+30 is above 2147483647"         },
    {"REAL",  "CA F2 49 71",             "LINT",  "1e+30 is above 2^63-1"             },
    {"REAL",  "00 00 C0 7F",             "LINT",  "NaN is no whole number"            },
    {"REAL",  "00 00 80 FF",             "DINT",  "-inf is below -2147483648"         },
    {"REAL",  "00 00 20 C0",             "DINT",  "FD FF FF FF"                       },
    {"LREAL", "9C 75 00 88 3C E4 37 7E", "REAL",  "1e+300 is above 3.4028235e+38"},
    {"BOOL",  "FF",                      "DINT",  "01 00 00 00"                       },
    {"REAL",  "00 00 80 4F",             "DINT",  "4294967296 is above 2147483647"    },
    {"LREAL", "6F 74 D3 AD F9 C1 72 40", "USINT", "300.123457 is above 255"           },
};

static void testCasts(void)
{
    size_t i;

    for (i = 0; i < COUNT(casts); i++) {
        const eipType *from = eipTypeNamed(casts[i].from), *to = eipTypeNamed(casts[i].to);
        char why[40] = "", text[40] = "";
        epicsUInt8 raw[8];
        eipNumber number;
        int status;

        hexBytes(casts[i].bytes, raw);
        eipNumberGet(from, raw, &number);
        status = eipNumberAs(to, from, &number, why, sizeof(why));
        if (!status && eipNumberPut(to, raw, &number) == 0)
            hexOf(raw, to->size, text);
        testOk(strcmp(status ? why : text, casts[i].as) == 0, "%s %s as %s: %s", casts[i].from,
               casts[i].bytes, casts[i].to, status ? why : text);
    }
}

/* --- Names -------------------------------------------------------------------------------- */

static const struct {
    const char *text, *base; /* NULL: refused */
    int base0;
    unsigned dimensions;
    epicsUInt32 index[3];
    int bit;
    const char *path;        /* of the base, 0 index of it */
} names[] = {
    {"TEST",                "TEST",            0, 0, {0},         -1, "91 04 54 45 53 54"                          },
    {"abc",                 "abc",             0, 0, {0},         -1, "91 03 61 62 63 00"                          },
    {"a.b",                 "a.b",             0, 0, {0},         -1, "91 01 61 00 91 01 62 00"                    },
    {"a[3]",                "a",               0, 1, {3},         -1, "91 01 61 00"                                },
    {"a[1,2]",              "a",               0, 2, {1, 2},      -1, "91 01 61 00"                                },
    {"a[1, 2 ,3]",          "a",               0, 3, {1, 2, 3},   -1, "91 01 61 00"                                },
    {"a[300].b",            "a[300].b",        0, 0, {0},         -1, "91 01 61 00 29 00 2C 01 91 01 62 00"        },
    {"a[1,70000].b[4]",     "a[1,70000].b",    0, 1, {4},         -1,
     "91 01 61 00 28 01 2A 00 70 11 01 00 91 01 62 00"                                                             },
    {"tag.5",               "tag",             0, 0, {0},         5,  "91 03 74 61 67 00"                          },
    {"tag[2].31",           "tag",             0, 1, {2},         31, "91 03 74 61 67 00"                          },
    {"Local:2:I.Ch0Data",   "Local:2:I.Ch0Data", 0, 0, {0},       -1,
     "91 09 4C 6F 63 61 6C 3A 32 3A 49 00 91 07 43 68 30 44 61 74 61 00"                                              },
    {"Program:M.x",         "Program:M.x",     0, 0, {0},         -1,
     "91 09 50 72 6F 67 72 61 6D 3A 4D 00 91 01 78 00"                                                             },
    {"5",                   "5",               0, 0, {0},         -1, "91 01 35 00"                                },
    {"N\xC3\xA3o",          "N\xC3\xA3o",      0, 0, {0},         -1, "91 04 4E C3 A3 6F"                          },
    {"a[010]",              "a",               0, 1, {10},        -1, NULL                                         },
    {"a[010]",              "a",               1, 1, {8},         -1, NULL                                         },
    {"a[0x10]",             "a",               1, 1, {16},        -1, NULL                                         },
    {"a[010].b[010]",       "a[010].b",        1, 1, {8},         -1, "91 01 61 00 28 0A 91 01 62 00"              },
    {"a[08]",               NULL,              1, 0, {0},         0,  NULL                                         },
    {"a[0x10]",             NULL,              0, 0, {0},         0,  NULL                                         },
    {"",                    NULL,              0, 0, {0},         0,  NULL                                         },
    {"a.",                  NULL,              0, 0, {0},         0,  NULL                                         },
    {".a",                  NULL,              0, 0, {0},         0,  NULL                                         },
    {"a..b",                NULL,              0, 0, {0},         0,  NULL                                         },
    {"a[",                  NULL,              0, 0, {0},         0,  NULL                                         },
    {"a[]",                 NULL,              0, 0, {0},         0,  NULL                                         },
    {"a[1",                 NULL,              0, 0, {0},         0,  NULL                                         },
    {"a[-1]",               NULL,              0, 0, {0},         0,  NULL                                         },
    {"a[4294967296]",       NULL,              0, 0, {0},         0,  NULL                                         },
    {"a[1,2,3,4]",          NULL,              0, 0, {0},         0,  NULL                                         },
    {"a[1]b",               NULL,              0, 0, {0},         0,  NULL                                         },
    {"a[1][2]",             NULL,              0, 0, {0},         0,  NULL                                         },
    {"tag.64",              NULL,              0, 0, {0},         0,  NULL                                         },
    {"a.5b",                NULL,              0, 0, {0},         0,  NULL                                         },
    {"a b",                 NULL,              0, 0, {0},         0,  NULL                                         },
    {"a$",                  NULL,              0, 0, {0},         0,  NULL                                         },
};

static void testNames(void)
{
    size_t i, column;

    for (i = 0; i < COUNT(names); i++) {
        char error[200] = "", hex[200] = "";
        epicsUInt8 path[eipPathMax];
        eipWriter w = eipWriterOf(path, sizeof(path));
        eipName name;
        int status =
            eipNameParse(names[i].text, names[i].base0, &name, &column, error, sizeof(error));

        if (!names[i].base) {
            testOk(status == -1 && error[0], "\"%s\": %s", names[i].text, error);
            continue;
        }
        testOk(status == 0 && strcmp(name.base, names[i].base) == 0 &&
                   name.dimensions == names[i].dimensions && name.bit == names[i].bit &&
                   memcmp(name.index, names[i].index, name.dimensions * 4) == 0,
               "\"%s\" is %s, %u indices, bit %d", names[i].text, name.base,
               name.dimensions, name.bit);
        if (!names[i].path)
            continue;
        eipPathPut(&w, name.base, 0);
        hexOf(path, w.n, hex);
        testOk(strcmp(hex, names[i].path) == 0 && eipPathBytes(name.base, 0) == w.n,
               "its path is %s", hex);
    }
}

/* What is wrong with a name, and where, in whole words. */
static const struct {
    const char *text;
    int base0;
    size_t column;
    const char *error;
} badNames[] = {
    {"",           0, 0, "a name is missing at the end of the tag; allowed: name, name.member, Program:name.tag"},
    {"a.",         0, 2, "a name is missing at the end of the tag; allowed: name, name.member, Program:name.tag"},
    {"a[1].{b",    0, 5,
     "'{' is not possible in a tag; allowed: letters, digits, _ : with . and [index] between names"},
    {".a",         0, 0,
     "'.' is not possible in a tag; allowed: letters, digits, _ : with . and [index] between names"},
    {"a{b",        0, 1, "'{' is not possible here; allowed: . or the end"},
    {"a$b",        0, 1, "'$' is not possible here; allowed: . or the end"},
    {"a[1]b",      0, 4, "'b' is not possible here; allowed: . or the end"},
    {"a[1",        0, 1, "\"[1\" does not end with ]; allowed: [i], [i,j], [i,j,k]"},
    {"a[0x10]",    0, 1, "\"[0x10]\" is no index; allowed: decimal numbers, [i], [i,j], [i,j,k]"},
    {"a[08]",      1, 1, "\"[08]\" is no index; allowed: [8], with a leading 0 octal: [010], or [0x8]"},
    {"a[1,2,3,4]", 0, 8, "more than 3 dimensions; allowed: [i], [i,j], [i,j,k]"},
    {"a[-1]",      0, 2, "-1 is no index; allowed: [0] to [4294967295]"},
    {"a[1,]",      0, 4, "an index is missing; allowed: [0] to [4294967295]"},
    {"tag.64",     0, 4, "bit 64; allowed: 0 to 63"},
    {"a.5b",       0, 2, "\"5b\" is no name: it begins with a digit"},
};

static void testBadNames(void)
{
    char text[300], error[200];
    size_t i, column;
    eipName name;

    for (i = 0; i < COUNT(badNames); i++) {
        int status = eipNameParse(badNames[i].text, badNames[i].base0, &name, &column, error, sizeof(error));

        testOk(status == -1 && column == badNames[i].column && strcmp(error, badNames[i].error) == 0,
               "\"%s\" at %u: %s", badNames[i].text, (unsigned)column, error);
    }
    memset(text, 'a', sizeof(text));
    text[255] = 0;
    testOk(eipNameParse(text, 0, &name, &column, error, sizeof(error)) == 0, "255 characters are a tag");
    strcpy(text + 255, "a");
    testOk(eipNameParse(text, 0, &name, &column, error, sizeof(error)) == -1 &&
               strcmp(error, "the tag has more than 255 characters") == 0,
           "256 are not: %s", error);
}

static void testInstances(void)
{
    static const struct {
        epicsUInt32 instance;
        const char *path;
    } rows[] = {{5, "20 6B 24 05 91 01 62 00"},
                {0x1234, "20 6B 25 00 34 12 91 01 62 00"},
                {0x12345, "20 6B 26 00 45 23 01 00 91 01 62 00"}};
    size_t i;

    for (i = 0; i < COUNT(rows); i++) {
        epicsUInt8 path[40];
        char hex[200];
        eipWriter w = eipWriterOf(path, sizeof(path));

        eipPathPut(&w, "tag.b", rows[i].instance);
        hexOf(path, w.n, hex);
        testOk(strcmp(hex, rows[i].path) == 0, "instance %X: %s", rows[i].instance, hex);
    }
    testOk(eipIndexBytes(255) == 2 && eipIndexBytes(256) == 4 && eipIndexBytes(65535) == 4 &&
               eipIndexBytes(65536) == 6,
           "an index of one, two and four bytes");
    testOk(eipNameRoot("Program:Main.x.y") == 14, "the root of Program:Main.x.y has 14");
    testOk(eipNameRoot("Local:1:I.Data") == 9, "that of Local:1:I.Data 9");
}

/* A long text never leaves the buffer. */
static void testLongName(void)
{
    char text[600], error[200];
    eipName name;
    unsigned i, bad = 0;

    for (i = 0; i < 127; i++)
        memcpy(text + 2 * i, "a.", 2);
    strcpy(text + 2 * i, "a");
    testOk(eipNameParse(text, 0, &name, NULL, error, sizeof(error)) == 0 &&
               eipPathBytes(name.base, 0) == 0,
           "128 names of one letter make no path: it would have 512 bytes");
    for (i = 0; i < 10000; i++) {
        static const char letters[] = "ab[].,:0123456789_ ";
        unsigned n = randomBelow(400), k;

        for (k = 0; k < n; k++)
            text[k] = letters[randomBelow(sizeof(letters) - 1)];
        text[n] = 0;
        if (eipNameParse(text, i & 1, &name, NULL, error, sizeof(error)) == 0)
            bad += strlen(name.base) > eipNameMax || eipPathBytes(name.base, 0) > eipPathMax;
    }
    testOk(!bad, "10,000 random texts stay within their bounds");
}

/* --- Plans -------------------------------------------------------------------------------- */

/* Each message holds what it may, each load is in one, and none is empty. */
static int isPacked(const eipLoad *loads, unsigned count, const eipLimits *limits,
                    const unsigned *bin, unsigned n)
{
    unsigned i, b;

    for (b = 0; b < n; b++) {
        unsigned request = 8, answer = 6, k = 0;

        for (i = 0; i < count; i++)
            if (bin[i] == b) {
                request += loads[i].request + 2;
                answer += loads[i].answer + 2;
                k++;
            }
        if (!k || (limits->multiple && k > limits->multiple))
            return 0;
        if (k > 1 && (request > limits->room || answer > limits->room))
            return 0;
        }
    for (i = 0; i < count; i++)
        if (bin[i] >= n)
            return 0;
    return 1;
}

static void testPack(void)
{
    eipLimits limits = {100, 0};
    eipLoad loads[200];
    unsigned bin[200], i, round, n, wrong = 0, disorder = 0;

    /* 6 + 2 x (45 + 2) = 100 */
    for (i = 0; i < 4; i++)
        loads[i] = (eipLoad){10, 45};
    testOk(eipPack(loads, 4, &limits, 0, bin) == 2, "two answers of 45 bytes fill 100");
    loads[0].answer = 46;
    testOk(eipPack(loads, 2, &limits, 0, bin) == 2, "46 and 45 do not fit");
    for (i = 0; i < 4; i++)
        loads[i] = (eipLoad){44, 10};
    testOk(eipPack(loads, 4, &limits, 0, bin) == 2, "two requests of 44 bytes fill 100");
    loads[0] = (eipLoad){500, 500};
    testOk(eipPack(loads, 3, &limits, 0, bin) == 2 && bin[0] != bin[1] && bin[1] == bin[2],
           "what never fits is alone");
    limits.multiple = 1;
    testOk(eipPack(loads, 3, &limits, 0, bin) == 3, "one in each message, where that is so");
    limits.multiple = 0;
    limits.room = 4000;
    for (i = 0; i < 53; i++) /* 2,000 REAL in arrays of 40, and some */
        loads[i] = (eipLoad){14, 4 + 2 + 160};
    testOk(eipPack(loads, 50, &limits, 0, bin) == 3, "50 arrays of 40 REAL: 3 messages");
    limits.room = 490;
    testOk(eipPack(loads, 50, &limits, 0, bin) == 25, "or 25 of 490 bytes");
    limits.room = 100;
    for (i = 0; i < 4; i++)
        loads[i] = (eipLoad){10, i < 2 ? 38 : 52};
    testOk(eipPack(loads, 4, &limits, 0, bin) == 2 && eipPack(loads, 4, &limits, 1, bin) == 3,
           "answers of 38, 38, 52 and 52 bytes: the long ones first fill 2, in order 3");
    for (round = 0; round < 2000; round++) {
        unsigned count = 1 + randomBelow(200);
        int inOrder = round & 1;

        limits = (eipLimits){100 + randomBelow(4000), randomBelow(4) ? 0 : 1 + randomBelow(40)};
        for (i = 0; i < count; i++)
            loads[i] = (eipLoad){4 + randomBelow(60), 6 + randomBelow(600)};
        n = eipPack(loads, count, &limits, inOrder, bin);
        wrong += !isPacked(loads, count, &limits, bin, n);
        for (i = 1; inOrder && i < count; i++)
            disorder += bin[i] < bin[i - 1];
    }
    testOk(!wrong, "2,000 random sets keep to the limits");
    testOk(!disorder, "and to their order");
}

static void testRuns(void)
{
    epicsUInt32 first[] = {0, 1, 5, 16, 100}, count[] = {1, 1, 1, 1, 1};
    eipRun run[5];
    unsigned n = eipRuns(first, count, 5, 4, 0, run);

    testOk(n == 3 && run[0].count == 6 && run[0].wants == 3 && run[1].first == 16 &&
               run[2].first == 100,
           "a gap of 3 DINT is read over, one of 10 is not");
    n = eipRuns(first, count, 5, 1, 0, run);
    testOk(n == 2 && run[0].count == 17, "one of 10 SINT is");
    n = eipRuns(first, count, 5, 1, 8, run);
    testOk(n == 3 && run[0].count == 6, "but not for more elements than may be");
}

/* --- The list and templates --------------------------------------------------------------- */

static void testSymbols(void)
{
    epicsUInt8 bytes[200], request[60];
    eipWriter w = eipWriterOf(request, sizeof(request));
    char hex[200];
    eipSymbol s;
    eipReader r;
    size_t n;

    eipSymbolsPut(&w, NULL, 0);
    hexOf(request, w.n, hex);
    testOk(strcmp(hex, "55 03 20 6B 25 00 00 00 03 00 01 00 02 00 08 00") == 0,
           "asks for the list: %s", hex);
    w.n = 0;
    eipSymbolsPut(&w, "Program:M", 7);
    hexOf(request, w.n, hex);
    testOk(strcmp(hex, "55 09 91 09 50 72 6F 67 72 61 6D 3A 4D 00 20 6B 25 00 07 00"
                       " 03 00 01 00 02 00 08 00") == 0,
           "and for that of a program: %s", hex);
    /* the second one is a structure: type 8123, three zero dimensions */
    n = hexBytes("05 00 00 00 04 00 52 45 41 4C CA 20 28 00 00 00 00 00 00 00 00 00 00 00 "
                "09 00 00 00 01 00 75 23 81 00 00 00 00 00 00 00 00 00 00 00 00",
                bytes);
    r = eipReaderOf(bytes, n);
    testOk(eipSymbolTake(&r, &s) == 1 && s.id == 5 && strcmp(s.name, "REAL") == 0 &&
               eipElementCode(s.type) == 0xca && eipDimensions(s.type) == 1 &&
               eipSymbolElements(&s) == 40,
           "REAL[40]");
    testOk(eipSymbolTake(&r, &s) == 1 && s.id == 9 && eipIsStructure(s.type) &&
               eipTemplateId(s.type) == 0x123 && eipSymbolElements(&s) == 1,
           "a structure");
    testOk(eipSymbolTake(&r, &s) == 0, "and that is all");
    r = eipReaderOf(bytes, n - 1);
    eipSymbolTake(&r, &s);
    testOk(eipSymbolTake(&r, &s) == -1, "a list that is cut is broken");
}

/* struct Motor { DINT Speed; BOOL On, Fault; Axis axis[2]; REAL Temps[4]; } of 32 bytes, with
 * struct Axis { INT Pos; SINT State; } of 4 bytes. */
static const char motorBytes[] =
    "00 00 C4 00 00 00 00 00  00 00 C2 00 04 00 00 00  00 00 C1 00 04 00 00 00"
    "01 00 C1 00 04 00 00 00  02 00 02 A1 08 00 00 00  04 00 CA 20 10 00 00 00";
static const char axisBytes[] = "00 00 C3 00 00 00 00 00  00 00 C2 00 02 00 00 00";

static size_t clean(const char *hex, epicsUInt8 *bytes)
{
    char packed[1000];
    size_t n = 0;

    for (; *hex; hex++)
        if (*hex != ' ')
            packed[n++] = *hex;
    packed[n] = 0;
    return hexBytes(packed, bytes);
}

static eipTemplate *templateOf(const char *hex, const char *texts, size_t length, unsigned id,
                               unsigned handle, unsigned size, unsigned count)
{
    epicsUInt8 bytes[500];
    size_t n = clean(hex, bytes);
    eipTemplate *t = calloc(1, sizeof(*t));

    memcpy(bytes + n, texts, length);
    t->id = id;
    t->handle = handle;
    t->size = size;
    t->count = count;
    if (eipTemplateParse(t, bytes, n + length))
        testAbort("template");
    return t;
}

static eipTemplate *motor(void)
{
    static const char texts[] = "Motor;nECA\0Speed\0ZZZZZZZZZZMotor1\0On\0Fault\0axis\0Temps";

    return templateOf(motorBytes, texts, sizeof(texts), 0x101, 0xbeef, 32, 6);
}

static eipTemplate *axis(void)
{
    static const char texts[] = "Axis;nEB\0Pos\0State";

    return templateOf(axisBytes, texts, sizeof(texts), 0x102, 0xcafe, 4, 2);
}

static const struct {
    const char *path;
    int status;
    epicsUInt32 offset;
    unsigned code;
    epicsUInt32 elements;
    int bit;
} members[] = {
    {"Speed",         0,  0,  0xc4, 1, -1},
    {"speed",         0,  0,  0xc4, 1, -1},
    {"On",            0,  4,  0xc1, 1, 0 },
    {"Fault",         0,  4,  0xc1, 1, 1 },
    {"axis[1].Pos",   0,  12, 0xc3, 1, -1},
    {"axis[1].State", 0,  14, 0xc2, 1, -1},
    {"axis[2].Pos",   -1, 0,  0,    0, 0 },
    {"Temps",         0,  16, 0xca, 4, -1},
    {"Temps[3]",      0,  28, 0xca, 1, -1},
    {"Temps[4]",      -1, 0,  0,    0, 0 },
    {"Spee",          -1, 0,  0,    0, 0 },
    {"Speed.x",       -1, 0,  0,    0, 0 },
    {"",              -1, 0,  0,    0, 0 },
};

static void testTemplates(void)
{
    eipTemplates known = {{0}};
    eipTemplate *t = motor();
    epicsUInt8 bytes[200];
    eipMemberPlace place = {0};
    eipAnswer a = {.data = bytes};
    eipTemplate read;
    size_t i;

    testOk(strcmp(t->name, "Motor") == 0 && strcmp(t->members[5].name, "Temps") == 0,
           "members of %s", t->name);
    testOk(eipMemberFind(&known, 0, "Pos", &place) == -1, "no structure has template 0");
    memset(&read, 0, sizeof(read));
    read.count = 65535;
    for (i = 1; i < 4; i++)
        known.table[i] = &read;
    testOk(eipTemplatesHaveRoom(&known, &read), "four templates of 65,535 members are kept");
    known.table[4] = &read;
    testOk(!eipTemplatesHaveRoom(&known, &read), "a fifth is not");
    for (i = 1; i < 5; i++)
        known.table[i] = NULL;
    known.table[0x101] = t;
    testOk(eipMemberFind(&known, 0x101, "axis[1].Pos", &place) == 0x102,
           "the template of a member is needed");
    known.table[0x102] = axis();
    for (i = 0; i < COUNT(members); i++) {
        int status;

        memset(&place, 0, sizeof(place));
        status = eipMemberFind(&known, 0x101, members[i].path, &place);
        testOk(status == members[i].status &&
                   (status || (place.offset == members[i].offset &&
                               eipElementCode(place.type) == members[i].code &&
                               place.elements == members[i].elements &&
                               place.bit == members[i].bit)),
               "member \"%s\": %d, offset %u", members[i].path, status, place.offset);
    }
    {
        static const char texts[] = "Odd;nEC\0X";

        known.table[0x103] = templateOf("00 00 EE 00 00 00 00 00", texts, sizeof(texts), 0x103, 0,
                                        4, 1);
        testOk(eipMemberFind(&known, 0x103, "X", &place) == -1,
               "a member of a type that is not known has no place");
    }
    eipTemplatesClear(&known);
    a.length = clean("04 00 04 00 00 00 2A 00 00 00 05 00 00 00 20 00 00 00"
                     "02 00 00 00 06 00 01 00 00 00 EF BE",
                     bytes);
    testOk(eipTemplateSizeTake(&a, 0x101, &read) == 0 && read.words == 42 &&
               read.size == 32 && read.count == 6 && read.handle == 0xbeef &&
               eipTemplateBytes(&read) == 148,
           "how large a template is");
    bytes[4] = 0x16;
    testOk(eipTemplateSizeTake(&a, 0x101, &read) == -1, "unless it is not there");
    {
        static const char texts[] = "ASCIISTRING82\0LEN\0DATA";

        t = templateOf("00 00 C4 00 00 00 00 00 52 00 C2 20 04 00 00 00", texts, sizeof(texts),
                       0xfce, 0xfce, 88, 2);
        testOk(eipTemplateIsString(t) == 82, "a STRING has room for 82");
        eipTemplateFree(t);
        free(t);
    }
    {
        unsigned broken = 0;

        for (i = 0; i < 10000; i++) {
            size_t n = randomBelow(sizeof(bytes)), k;

            memset(&read, 0, sizeof(read));
            read.count = randomBelow(30);
            read.size = randomBelow(100);
            for (k = 0; k < n; k++)
                bytes[k] = (epicsUInt8)randomBelow(256);
            if (eipTemplateParse(&read, bytes, n))
                broken++;
            else
                eipTemplateFree(&read);
        }
        testOk(broken > 0, "10,000 random templates stay within their bounds (%u refused)",
               broken);
    }
}

/* --- Tags and units ----------------------------------------------------------------------- */

static eipWant want(const char *tag, epicsUInt32 index, epicsUInt32 count, eipPlaceKind kind,
                    unsigned period, size_t place)
{
    eipWant w = {.tag = epicsStrDup(tag), .index = index, .count = count, .kind = kind,
                 .period = period, .place = place,
                 .room = kind == eipCell ? eipCellSize : eipPlaceHead + 8 * count};

    if (kind == eipTextPlace)
        w.room = eipPlaceHead + 40;
    return w;
}

static void learn(eipTags *t, const char *base, const char *hex)
{
    epicsUInt8 bytes[200];
    eipAnswer a = {.data = bytes};
    unsigned i;

    a.length = clean(hex, bytes);
    for (i = 0; i < t->tagCount; i++)
        if (strcmp(t->tags[i].base, base) == 0)
            eipTagLearn(t, &t->tags[i], &a);
}

static void putOf(const eipTags *t, const eipUnit *u, char *hex)
{
    epicsUInt8 bytes[200];
    eipWriter w = eipWriterOf(bytes, sizeof(bytes));

    eipUnitPut(&w, t, u, 1, -1);
    hexOf(bytes, w.n, hex);
    testOk(eipUnitLoad(t, u, 1).request == w.n, "its %u bytes were planned", (unsigned)w.n);
}

static void testUnits(void)
{
    eipWant *w = calloc(6, sizeof(*w));
    epicsUInt8 image[400] = {0}, data[100];
    char hex[200];
    eipTags t;
    eipUnit *u;
    size_t n;

    w[0] = want("REALs", 7, 1, eipCell, 500, 0);
    w[1] = want("REALs", 3, 1, eipCell, 1000, 16);
    w[2] = want("reals", 39, 1, eipCell, 1000, 32);
    w[3] = want("Name", 0, 1, eipTextPlace, 1000, 48);
    w[4] = want("nix", 0, 1, eipCell, 1000, 100);
    w[5] = want("INTs", 10, 5, eipArrayPlace, 100, 116);
    eipTagsInit(&t);
    eipTagsSet(&t, w, 6);
    testOk(t.tagCount == 4 && t.unknown == 4, "six wishes are four tags");
    learn(&t, "REALs", "CA 00 00 00 80 3F");
    learn(&t, "Name", "A0 02 CE 0F 02 00 00 00 61 62");
    learn(&t, "INTs", "C3 00 01 00");
    {
        eipAnswer a = {.status = eipPathUnknown};
        unsigned i;

        for (i = 0; i < t.tagCount; i++)
            if (t.tags[i].state == eipTagNew)
                eipTagLearn(&t, &t.tags[i], &a);
    }
    testOk(t.unknown == 0, "all were answered");
    eipUnitsMake(&t);
    testOk(t.unitCount == 4, "four units: two runs of REALs, a string, INTs");
    u = &t.units[0];
    putOf(&t, u, hex);
    testOk(strcmp(hex, "4C 04 91 04 49 4E 54 73 28 0A 05 00") == 0, "INTs: %s", hex);
    n = clean("01 00 02 00 FD FF 04 00 05 00", data);
    testOk(!eipPieceStore(&t, &t.pieces[u->from], data, n, image) && image[116] == 0xc3 &&
               image[118] == eipSigned && image[119] == 2 && image[120] == 5 &&
               memcmp(image + 124, data, 10) == 0,
           "goes as it is into its place");
    testOk(eipPieceStore(&t, &t.pieces[u->from], data, n - 1, image) != NULL,
           "unless a byte is missing");
    u = &t.units[2];
    putOf(&t, u, hex);
    testOk(strcmp(hex, "4C 05 91 05 52 45 41 4C 73 00 28 03 05 00") == 0 &&
               eipUnitLoad(&t, u, 1).answer == 4 + 2 + 20 && u->period == 500,
           "REALs[3] to [7], by the fastest period: %s", hex);
    n = clean("00 00 80 3F 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 C0", data);
    testOk(!eipPieceStore(&t, &t.pieces[u->from], data, n, image) &&
               !eipPieceStore(&t, &t.pieces[u->from + 1], data, n, image) &&
               image[16] == 0xca && image[18] == eipReal && image[19] == 4 &&
               memcmp(image + 24, "\0\0\0\0\0\0\xf0\x3f", 8) == 0 &&
               memcmp(image + 8, "\0\0\0\0\0\0\0\xc0", 8) == 0,
           "each to its cell, as double");
    u = &t.units[1];
    testOk(!eipPieceStore(&t, &t.pieces[u->from],
                          (const epicsUInt8 *)"\2\0\0\0ab", 6, image) &&
               image[52] == 2 && memcmp(image + 56, "ab\0", 3) == 0,
           "the string to its own");
    eipUnitSplit(&t, 2);
    testOk(t.unitCount == 5 && t.units[2].first == 3 && t.units[2].count == 1 &&
               t.units[4].first == 7,
           "a run that was refused is halved");
    testOk(eipUnitSplit(&t, 4) == 0, "a single element is not");
    eipTagsFree(&t);
}

/* A run of three that was refused */
static void testThree(void)
{
    eipWant *w = calloc(3, sizeof(*w));
    eipTags t;
    unsigned i;

    for (i = 0; i < 3; i++)
        w[i] = want("A", i, 1, eipCell, 100, 16 * i);
    eipTagsInit(&t);
    eipTagsSet(&t, w, 3);
    learn(&t, "A", "C4 00 01 00 00 00");
    eipUnitsMake(&t);
    testOk(t.unitCount == 1 && eipUnitSplit(&t, 0) == 1 && t.unitCount == 2 && t.units[0].count == 1 &&
               t.units[1].first == 1 && t.units[1].count == 2,
           "three elements become one and two");
    testOk(t.pieces[t.units[1].from].offset == 0 && t.pieces[t.units[1].from + 1].offset == 4,
           "whose data begins anew");
    eipTagsFree(&t);
}

/* A row of an array of more than one dimension, as Omron reads it: from the element that is wanted. */
static void testOmronRow(void)
{
    eipWant *w = calloc(1, sizeof(*w));
    char hex[200];
    eipTags t;

    w[0] = want("Grid[1]", 2, 3, eipArrayPlace, 100, 0);
    w[0].indexed = 1;
    eipTagsInit(&t);
    t.omron = 1;
    eipTagsSet(&t, w, 1);
    learn(&t, "Grid[1]", "C4 00 01 00 00 00");
    eipUnitsMake(&t);
    putOf(&t, &t.units[0], hex);
    testOk(strcmp(hex, "4C 05 91 04 47 72 69 64 28 01 28 02 03 00") == 0, "Omron's row: %s", hex);
    eipTagsFree(&t);
}

static void testWhole(void)
{
    eipWant *w = calloc(4, sizeof(*w));
    epicsUInt8 image[100] = {0}, data[40];
    eipSymbol symbol = {3, "M", 0x8101, {0, 0, 0}};
    char hex[200];
    eipTags t;
    eipUnit *u;
    size_t n;

    w[0] = want("M.Speed", 0, 1, eipCell, 100, 0);
    w[1] = want("M.Fault", 0, 1, eipCell, 100, 16);
    w[2] = want("M.Temps", 2, 1, eipCell, 100, 32);
    w[3] = want("M.On", 0, 1, eipCell, 1000, 48);
    eipTagsInit(&t);
    eipTagsSet(&t, w, 4);
    learn(&t, "M.Speed", "C4 00 00 00 00 00");
    learn(&t, "M.Fault", "C1 00 00");
    learn(&t, "M.Temps", "CA 00 00 00 00 00");
    learn(&t, "M.On", "C1 00 00");
    eipUnitsMake(&t);
    testOk(t.unitCount == 4, "without a template each member is read by itself");
    testOk(eipTagsListed(&t, &symbol, NULL) == 4 && t.tags[0].instance == 3 &&
               t.tags[0].template == 0x101,
           "the list tells what M is");
    t.templates->table[0x101] = motor();
    t.templates->table[0x102] = axis();
    eipUnitsMake(&t);
    testOk(t.unitCount == 4, "two of one period are no reason to read it whole");
    for (n = 0; n < t.tagCount; n++)
        t.tags[n].period = 100;
    eipUnitsMake(&t);
    testOk(t.unitCount == 1 && t.units[0].pieces == 4, "four of one period are");
    u = &t.units[0];
    putOf(&t, u, hex);
    testOk(strcmp(hex, "4C 02 20 6B 24 03 01 00") == 0 &&
               eipUnitLoad(&t, u, 1).answer == 4 + 4 + 32,
           "by its instance: %s", hex);
    memset(data, 0, sizeof(data));
    data[0] = 0xfe;
    memset(data + 1, 0xff, 3);
    data[4] = 2; /* Fault, not On */
    data[27] = 0x40;
    for (n = 0; n < u->pieces; n++)
        testOk(!eipPieceStore(&t, &t.pieces[u->from + n], data, 32, image), "piece %u",
               (unsigned)n);
    testOk(memcmp(image + 8, "\xfe\xff\xff\xff\xff\xff\xff\xff", 8) == 0, "Speed is -2");
    testOk(image[24] == 1 && image[56] == 0, "Fault is set, On is not");
    testOk(image[47] == 0x40 && image[34] == eipReal, "Temps[2] is 2");
    eipUnitSplit(&t, 0);
    testOk(t.unitCount == 4 && !t.units[0].whole, "refused whole, it is read by members");
    for (n = 0; n < 4; n++)
        testOk(t.units[n].tag == n && t.tags[n].apart, "%s by itself", t.tags[n].base);
    eipUnitsMake(&t);
    testOk(t.unitCount == 4, "and stays so");
    eipTagsForget(&t);
    testOk(t.unknown == 4 && t.unitCount == 0 && t.tags[0].instance == 0 && t.tags[0].template == 0 &&
               t.tags[0].code == 0 && t.tags[0].handle == 0 && t.tags[0].size == 0 &&
               t.tags[0].characters == 0,
           "a new program: nothing is known");
    eipTagsFree(&t);
}

static void testTexts(void)
{
    eipWant *w = calloc(4, sizeof(*w));
    eipTags t;

    w[0] = want("D", 0, 1, eipTextPlace, 100, 0);
    w[1] = want("D", 1, 1, eipTextPlace, 100, 48);
    w[2] = want("S", 0, 1, eipTextPlace, 100, 96);
    w[3] = want("S", 1, 1, eipTextPlace, 100, 144);
    eipTagsInit(&t);
    eipTagsSet(&t, w, 4);
    learn(&t, "D", "D0 00 02 00 61 62");
    learn(&t, "S", "A0 02 CE 0F 02 00 00 00 61 62 00 00");
    eipUnitsMake(&t);
    testOk(t.unitCount == 3 && t.units[0].count == 1 && t.units[1].count == 1 &&
               t.units[2].count == 2,
           "strings of no fixed size are read one by one, others together");
    eipTagsFree(&t);
}

static void testSet(void)
{
    eipWant *w = calloc(2, sizeof(*w)), *more = calloc(3, sizeof(*more));
    eipTags t;

    w[0] = want("a", 0, 1, eipCell, 100, 0);
    w[1] = want("a.b", 0, 1, eipCell, 100, 16);
    eipTagsInit(&t);
    eipTagsSet(&t, w, 2);
    learn(&t, "a", "C4 00 00 00 00 00");
    more[0] = want("a", 4, 1, eipCell, 100, 0);
    more[1] = want("b", 0, 1, eipCell, 100, 16);
    more[2] = want("a", 0, 1, eipCell, 100, 32);
    more[2].alone = 1;
    eipTagsSet(&t, more, 3);
    testOk(t.tagCount == 3 && t.tags[0].state == eipTagKnown && t.unknown == 2,
           "a tag that stays stays known; read alone it is another one");
    eipTagsFree(&t);
}

/* --- Links and places --------------------------------------------------------------------- */

static const struct {
    const char *text, *tag; /* NULL: refused */
    epicsUInt32 index;
    int hasIndex, indexed, alone, bit, force;
    double period;
    eipStatistic statistic;
} links[] = {
    {"@plc tag",                 "tag",     0,  0, 0, 0, -1, 0, 0,    eipNoStatistic    },
    {"plc tag",                  "tag",     0,  0, 0, 0, -1, 0, 0,    eipNoStatistic    },
    {"@plc  tag[3]   S .5",      "tag",     3,  1, 0, 0, -1, 0, 0.5,  eipNoStatistic    },
    {"@plc tag[010] S 1",        "tag",     8,  1, 0, 0, -1, 0, 1,    eipNoStatistic    },
    {"@plc tag[010] E",          "tag",     10, 1, 0, 1, -1, 0, 0,    eipNoStatistic    },
    {"@plc tag Element S 2",     "tag",     0,  0, 0, 1, -1, 0, 2,    eipNoStatistic    },
    {"@plc tag B 7 FORCE",       "tag",     0,  0, 0, 0, 7,  1, 0,    eipNoStatistic    },
    {"@plc a.b[2].c.31",         "a.b[2].c", 0, 0, 0, 0, 31, 0, 0,    eipNoStatistic    },
    {"@plc a[1,2]",              "a[1]",    2,  1, 1, 0, -1, 0, 0,    eipNoStatistic    },
    {"@plc a[1,2,3]",            "a[1,2]",  3,  1, 1, 0, -1, 0, 0,    eipNoStatistic    },
    {"@plc tag S .0001",         "tag",     0,  0, 0, 0, -1, 0, 0.001, eipNoStatistic   },
    {"@plc tag S 86401",         NULL,      0,  0, 0, 0, 0,  0, 0,    eipNoStatistic    },
    {"@plc tag S 0",             "tag",     0,  0, 0, 0, -1, 0, 0,    eipNoStatistic    },
    {"@plc 100 S 1",             "100",     0,  0, 0, 0, -1, 0, 1,    eipNoStatistic    },
    {"@plc tag S 10 LIST_TIME",  "tag",     0,  0, 0, 0, -1, 0, 10,   eipListTime       },
    {"@plc tag TAG_TRANSFER_TIME", "tag",   0,  0, 0, 0, -1, 0, 0,    eipTagTransferTime},
    {"",                         NULL,      0,  0, 0, 0, 0,  0, 0,    eipNoStatistic    },
    {"@plc",                     NULL,      0,  0, 0, 0, 0,  0, 0,    eipNoStatistic    },
    {"@plc tag S",               NULL,      0,  0, 0, 0, 0,  0, 0,    eipNoStatistic    },
    {"@plc tag S x",             NULL,      0,  0, 0, 0, 0,  0, 0,    eipNoStatistic    },
    {"@plc tag S -1",            NULL,      0,  0, 0, 0, 0,  0, 0,    eipNoStatistic    },
    {"@plc tag S nan",           NULL,      0,  0, 0, 0, 0,  0, 0,    eipNoStatistic    },
    {"@plc tag B -1",            NULL,      0,  0, 0, 0, 0,  0, 0,    eipNoStatistic    },
    {"@plc tag B 1.5",           NULL,      0,  0, 0, 0, 0,  0, 0,    eipNoStatistic    },
    {"@plc tag B 64",            NULL,      0,  0, 0, 0, 0,  0, 0,    eipNoStatistic    },
    {"@plc tag.1 B 2",           NULL,      0,  0, 0, 0, 0,  0, 0,    eipNoStatistic    },
    {"@plc tag force",           NULL,      0,  0, 0, 0, 0,  0, 0,    eipNoStatistic    },
    {"@plc tag[",                NULL,      0,  0, 0, 0, 0,  0, 0,    eipNoStatistic    },
};

static void testLinks(void)
{
    size_t i, column;
    char error[400];
    eipLink l;

    for (i = 0; i < COUNT(links); i++) {
        int status = eipLinkParse(links[i].text, &l, &column, error, sizeof(error));

        if (!links[i].tag) {
            testOk(status == -1 && error[0] && column <= strlen(links[i].text),
                   "\"%s\": %s", links[i].text, error);
            continue;
        }
        testOk(status == 0 && strcmp(l.plc, "plc") == 0 && strcmp(l.tag, links[i].tag) == 0 &&
                   l.index == links[i].index && l.hasIndex == links[i].hasIndex &&
                   l.indexed == links[i].indexed && l.alone == links[i].alone &&
                   l.bit == links[i].bit && l.force == links[i].force &&
                   l.period == links[i].period && l.statistic == links[i].statistic,
               "\"%s\" is %s, element %u, bit %d, %g s", links[i].text, l.tag, l.index, l.bit,
               l.period);
    }
}

/* What is said of a good link */
static void testDoubts(void)
{
    char error[400], text[300] = "@";
    size_t column;
    eipLink l;

    testOk(eipLinkParse("@plc tag S 1 S 2", &l, &column, error, sizeof(error)) == 0 && l.period == 2 &&
               strcmp(l.doubt, "S stands there twice; the last one counts") == 0,
           "%s", l.doubt);
    testOk(strcmp(eipStatisticWord(eipListTime), "LIST_TIME") == 0 && !eipStatisticWord(eipNoStatistic)[0],
           "a statistic has its word, none has none");
    memset(text + 1, 'p', 256);
    strcpy(text + 257, " tag");
    testOk(eipLinkParse(text, &l, &column, error, sizeof(error)) == -1 &&
               strcmp(error, "the PLC's name is too long; allowed: 255 characters") == 0,
           "%s", error);
}

/* What is wrong with a link, and where, in whole words. */
static const struct {
    const char *text;
    size_t column;
    const char *error;
} badLinks[] = {
    {"", 0, "no link to a PLC; allowed: @PLC tag [flags]"},
    {"@plc", 4, "no tag; allowed: @PLC tag [flags]"},
    {"@plc tag S x", 11, "S x is no period; allowed: S, a blank, 0 to 86400"},
    {"@plc tag B 64", 11, "B 64 is no bit; allowed: B, a blank, 0 to 63"},
    {"@plc tag.1 B 2", 5, "a bit in the tag (.1) and B 2; allowed: one of them"},
    {"@plc tag[1", 8, "\"[1\" does not end with ]; allowed: [i], [i,j], [i,j,k]"},
    {"@plc tag B 1.5", 10, "B 1.5 is no bit; allowed: B, a blank, 0 to 63"},
    {"@plc tag force", 9,
     "\"force\" is no flag; allowed: E, S seconds, B bit, FORCE, or one of PLC_ERRORS PLC_TASK_SLOW "
     "LIST_ERRORS LIST_TICKS LIST_TIME LIST_SCAN_TIME LIST_MIN_SCAN_TIME LIST_MAX_SCAN_TIME "
     "TAG_TRANSFER_TIME"},
};

static void testBadLinks(void)
{
    char text[300] = "@plc ", error[400];
    size_t i, column;
    eipLink l;

    for (i = 0; i < COUNT(badLinks); i++) {
        int status = eipLinkParse(badLinks[i].text, &l, &column, error, sizeof(error));

        testOk(status == -1 && column == badLinks[i].column && strcmp(error, badLinks[i].error) == 0,
               "\"%s\" at %u: %s", badLinks[i].text, (unsigned)column, error);
    }
    for (i = 0; i < 127; i++)
        strcat(text, "a.");
    strcat(text, "a");
    testOk(eipLinkParse(text, &l, &column, error, sizeof(error)) == -1 && column == 5 &&
               strcmp(error, "the tag has no path of at most 510 bytes") == 0,
           "128 names of one letter: %s", error);
}

static void testPlaces(void)
{
    eipPlaces *p = eipPlacesCreate(64);
    eipWant a = {.tag = "A", .count = 1, .kind = eipCell};
    eipWant small = {.tag = "a", .count = 1, .kind = eipCell};
    eipWant b = {.tag = "B", .count = 1, .kind = eipCell};
    eipWant text = {.tag = "A", .count = 1, .kind = eipTextPlace, .room = 41};
    eipPlace *first = eipPlacesGet(p, &a, 500, 0), *second, *third;
    eipWant *w;
    size_t used;
    unsigned n, i;

    testOk(first && eipPlaceOffset(first) == 0 && eipPlaceRoom(first) == 16, "a place of 16");
    testOk(eipPlacesGet(p, &small, 100, 1) == first, "the same for the same tag");
    second = eipPlacesGet(p, &b, 1000, 1);
    testOk(second && eipPlaceOffset(second) == 16, "another for another");
    testOk(!eipPlacesGet(p, &text, 100, 0), "none where there is no room");
    testOk(eipPlacesWants(p, 0, &w, &n, &used) == 1 && n == 2 && w[0].period == 100 && !w[0].shared &&
               w[0].fresh && w[1].period == 1000,
           "wishes have the shortest period of those who have them");
    for (i = 0; i < n; i++)
        free(w[i].tag);
    free(w);
    testOk(eipPlacesWants(p, 0, &w, &n, &used) == 0, "and are told once");
    eipPlacesLeave(p, first, 100, 1);
    eipPlacesGet(p, &b, 1000, 1);
    testOk(eipPlacesWants(p, 0, &w, &n, &used) == 1 && w[0].period == 500 && w[1].shared &&
               !w[0].shared && !w[0].fresh,
           "one has left: the period is that of the other");
    for (i = 0; i < n; i++)
        free(w[i].tag);
    free(w);
    eipPlacesLeave(p, first, 500, 0);
    testOk(eipPlacesWants(p, 0, &w, &n, &used) == 1 && n == 1, "nobody wants it any more");
    for (i = 0; i < n; i++)
        free(w[i].tag);
    free(w);
    third = eipPlacesGet(p, &a, 100, 0);
    testOk(third == first && eipPlacesUsed(p) == 32, "it is its place for ever");
    eipPlacesDestroy(p);
}

MAIN(eipTagsTest)
{
    testPlan(0);
    testNumbers();
    testReals();
    testCasts();
    testStrings();
    testNames();
    testBadNames();
    testInstances();
    testLongName();
    testPack();
    testRuns();
    testSymbols();
    testTemplates();
    testUnits();
    testThree();
    testOmronRow();
    testWhole();
    testTexts();
    testSet();
    testLinks();
    testDoubts();
    testBadLinks();
    testPlaces();
    return testDone();
}
