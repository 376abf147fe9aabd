/* Links: every form that is allowed, every refusal with its message and place, and a
 * hundred thousand malformed texts. */
#include <stdlib.h>
#include <string.h>

#include <epicsStdio.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcLink.h"

#define TEXTS "ABCD CDAB BADC DCBA A0 0A" /* W= of texts */

#define COUNT(table) (sizeof(table) / sizeof(table[0]))

/* --- The text ----------------------------------------------------------------------- */

static const struct {
    const char *what;
    const char *text;
    const char *station;
    size_t offset;
    const char *type; /* "" = none given */
} places[] = {
    {"a name and no more",                      "@PLC",                "PLC",              0,           ""      },
    {"a slash without offset",                  "@PLC/",               "PLC",              0,           ""      },
    {"no offset but a type",                    "@PLC/T=BYTE",         "PLC",              0,           "UINT8" },
    {"a blank in place of the offset",          "@PLC/ T=BYTE",        "PLC",              0,           "UINT8" },
    {"a quote in place of the offset",          "@PLC/'T=BYTE'",       "PLC",              0,           "UINT8" },
    {"offset 0",                                "@PLC/0",              "PLC",              0,           ""      },
    {"a decimal offset",                        "@PLC/20",             "PLC",              20,          ""      },
    {"a hexadecimal offset",                    "@PLC/0x8",            "PLC",              8,           ""      },
    {"a hexadecimal offset in capitals",        "@PLC/0X1F",           "PLC",              31,          ""      },
    {"a sum",                                   "@PLC/20+3+2",         "PLC",              25,          ""      },
    {"a sum with a blank after the +",          "@PLC/4+ 2",           "PLC",              6,           ""      },
    {"a sum of decimal and hexadecimal",        "@PLC/4+0x10+1",       "PLC",              21,          ""      },
    {"a sum that begins with +",                "@PLC/+4+2",           "PLC",              6,           ""      },
    {"a sum with an empty macro in it",         "@PLC/4++2",           "PLC",              6,           ""      },
    {"a sum with an empty macro at its end",    "@PLC/4+",             "PLC",              4,           ""      },
    {"a sum with an empty macro before a type", "@PLC/4+ T=BYTE",      "PLC",              4,           "UINT8" },
    {"a negative number in a sum",              "@PLC/4+-2",           "PLC",              2,           ""      },
    {"a sum that begins with -",                "@PLC/-2+6",           "PLC",              4,           ""      },
    {"two numbers that cancel",                 "@PLC/4+-4",           "PLC",              0,           ""      },
    {"an offset beyond 16 bits",                "@PLC/65537",          "PLC",              65537,       ""      },
    {"an offset beyond 31 bits",                "@PLC/0x80000000",     "PLC",              0x80000000u, ""      },
    {"no @",                                    "PLC/4",               "PLC",              4,           ""      },
    {"blanks before @",                         " \t@PLC/4",           "PLC",              4,           ""      },
    {"blanks after @",                          "@ PLC/4",             "PLC",              4,           ""      },
    {"a blank before the slash",                "@PLC /4",             "PLC",              4,           ""      },
    {"a blank after the slash",                 "@PLC/ 4",             "PLC",              4,           ""      },
    {"blanks at the end",                       "@PLC/4 T=BYTE \t ",   "PLC",              4,           "UINT8" },
    {"a name with colons",                      "@SITE:PLC:1/4",       "SITE:PLC:1",       4,           ""      },
    {"a name with dashes, dots and digits",     "@vak-4.b_7/4",        "vak-4.b_7",        4,           ""      },
    {"a name with any sign but / and blank",    "@P+L=C'\"$#/4",       "P+L=C'\"$#",       4,           ""      },
    {"a name with % signs",                     "@%n%s%n",             "%n%s%n",           0,           ""      },
    {"quotes that belong to the name",          "@PLC'T=INT8'",        "PLC'T=INT8'",      0,           ""      },
    {"a name in UTF-8",                         "@Pr\xC3\xA4zision/4", "Pr\xC3\xA4zision", 4,           ""      },
    {"a type",                                  "@PLC/4 T=INT32",      "PLC",              4,           "INT32" },
    {"a type in small letters",                 "@PLC/4 T=float64",    "PLC",              4,           "REAL64"},
    {"an option in small letters",              "@PLC/4 t=Int8",       "PLC",              4,           "INT8"  },
    {"an alias",                                "@PLC/4 T=DWORD",      "PLC",              4,           "UINT32"},
    {"T=LONGLONG",                              "@PLC/4 T=LONGLONG",   "PLC",              4,           "INT64" },
    {"T=QWORD",                                 "@PLC/4 T=QWORD",      "PLC",              4,           "UINT64"},
    {"T=BCD",                                   "@PLC/4 T=BCD",        "PLC",              4,           "TIME"  },
    {"no blank before the type",                "@PLC/4T=INT8",        "PLC",              4,           "INT8"  },
    {"no blank after a sum",                    "@PLC/4+2T=INT8",      "PLC",              6,           "INT8"  },
    {"several blanks",                          "@PLC/4 \t  T=INT8",   "PLC",              4,           "INT8"  },
    {"quotes",                                  "@PLC/4 'T=INT8'",     "PLC",              4,           "INT8"  },
    {"quotes without a blank before them",      "@PLC/4'T=INT8'",      "PLC",              4,           "INT8"  },
    {"quotes with blanks inside",               "@PLC/4 ' T=INT8 ' ",  "PLC",              4,           "INT8"  },
    {"empty quotes",                            "@PLC/4 ''",           "PLC",              4,           ""      },
};

static void testPlaces(void)
{
    size_t i;

    for (i = 0; i < COUNT(places); i++) {
        plcLink link;
        plcLinkError error;
        int status = plcLinkParse(places[i].text, &link, &error);

        testOk(status == 0 && error.text[0] == 0 &&
                   strcmp(link.station, places[i].station) == 0 &&
                   link.offset == places[i].offset &&
                   strcmp(link.type ? link.type->name : "", places[i].type) == 0 &&
                   link.has == (places[i].type[0] ? plcHasT : 0u),
               "%s: %s is %s at %lu %s", places[i].what, places[i].text, link.station,
               (unsigned long)link.offset, error.text);
    }
}

static const struct {
    const char *what;
    const char *options;
    unsigned has;
    epicsInt64 low, high;
    unsigned bit;
    size_t readback;
} optionRows[] = {
    {"L",                      "L=5",                    plcHasL,                               5,                          0,                     0,  0    },
    {"negative L",             "L=-5",                   plcHasL,                               -5,                         0,                     0,  0    },
    {"L with a +",             "L=+5",                   plcHasL,                               5,                          0,                     0,  0    },
    {"hexadecimal L and H",    "L=0x10 H=0xfF",          plcHasL | plcHasH,                     16,                         255,                   0,  0    },
    {"negative hexadecimal L", "L=-0x7FFF",              plcHasL,                               -32767,                     0,                     0,  0    },
    {"H and L in any order",   "H=7 L=3",                plcHasL | plcHasH,                     3,                          7,                     0,  0    },
    {"the largest H",          "H=9223372036854775807",  plcHasH,                               0,                          9223372036854775807LL, 0,  0    },
    {"the smallest L",         "L=-9223372036854775808", plcHasL,                               -9223372036854775807LL - 1, 0,
     0,                                                                                                                                                0    },
    {"B without T",            "B=15",                   plcHasB,                               0,                          0,                     15, 0    },
    {"hexadecimal B",          "B=0x1f",                 plcHasB,                               0,                          0,                     31, 0    },
    {"a blank after B=",       "B= 3",                   plcHasB,                               0,                          0,                     3,  0    },
    {"a blank after L=",       "L= -3",                  plcHasL,                               -3,                         0,                     0,  0    },
    {"R",                      "R=40",                   plcHasR,                               0,                          0,                     0,  40   },
    {"R as a sum",             "R=40+ 4+0x1 B=2",        plcHasR | plcHasB,                     0,                          0,                     2,  45   },
    {"R beyond 16 bits",       "R=65540",                plcHasR,                               0,                          0,                     0,  65540},
    {"no blanks between",      "L=-1H=2B=3R=4",          plcHasL | plcHasH | plcHasB | plcHasR, -1,                         2,
     3,                                                                                                                                                4    },
    {"small letters",          "l=1 h=2 b=3 r=4",        plcHasL | plcHasH | plcHasB | plcHasR, 1,                          2,                     3,
     4                                                                                                                                                      },
    {"quotes",                 "'L=1 H=2'",              plcHasL | plcHasH,                     1,                          2,                     0,  0    },
};

static void testOptions(void)
{
    size_t i;

    for (i = 0; i < COUNT(optionRows); i++) {
        char text[100];
        plcLink link;
        plcLinkError error;
        int status;

        epicsSnprintf(text, sizeof(text), "@PLC/4 %s", optionRows[i].options);
        status = plcLinkParse(text, &link, &error);
        testOk(status == 0 && error.text[0] == 0 && link.has == optionRows[i].has &&
                   link.low == optionRows[i].low && link.high == optionRows[i].high &&
                   link.bit == optionRows[i].bit &&
                   link.readback == optionRows[i].readback,
               "%s: %s %s", optionRows[i].what, text, error.text);
    }
}

/* W= comes with another option, or without. */
static const struct {
    const char *options;
    unsigned has;
    int highWordFirst;
    epicsInt64 low;
} wordRows[] = {
    {"W=high",           plcHasW,           1, 0},
    {"W=low",            plcHasW,           0, 0},
    {"w=High",           plcHasW,           1, 0},
    {"W=LOW",            plcHasW,           0, 0},
    {"'W=high'",         plcHasW,           1, 0},
    {"W=highL=5",        plcHasW | plcHasL, 1, 5},
    {"L=5W=low",         plcHasW | plcHasL, 0, 5},
    {"L=5 W=high ",      plcHasW | plcHasL, 1, 5},
    {"T=FLOATW=high",    plcHasW | plcHasT, 1, 0},
    {"W=lowT=WORD",      plcHasW | plcHasT, 0, 0},
    {"R=4W=high",        plcHasW | plcHasR, 1, 0},
    {"B=3\tW=low",       plcHasW | plcHasB, 0, 0},
    {"W=ABCD",           plcHasW,           1, 0},
    {"W=cdab",           plcHasW,           0, 0},
    {"W=BADC",           plcHasW,           1, 0},
    {"W=DCBA",           plcHasW,           0, 0},
    {"W=A0",             plcHasW,           -1, 0},
    {"w=0a",             plcHasW,           -1, 0},
    {"W=0AL=5",          plcHasW | plcHasL, -1, 5},
};

static void testWords(void)
{
    size_t i;

    for (i = 0; i < COUNT(wordRows); i++) {
        char text[100];
        plcLink link;
        plcLinkError error;
        int status;

        epicsSnprintf(text, sizeof(text), "@PLC/4 %s", wordRows[i].options);
        status = plcLinkParse(text, &link, &error);
        testOk(status == 0 && error.text[0] == 0 && link.has == wordRows[i].has &&
                   link.highWordFirst == wordRows[i].highWordFirst &&
                   link.low == wordRows[i].low &&
                   link.column.W == strcspn(text, "Ww"),
               "%s %s", text, error.text);
    }
}

/* The bytes of 0x0A0B0C0D, and of 0x0A0B, whatever bigEndian is. */
static const struct {
    const char *options;
    epicsUInt8 bytes[4];
    epicsInt64 value;
} letters[] = {
    {"T=INT32 W=ABCD", {0x0A, 0x0B, 0x0C, 0x0D}, 0x0A0B0C0D},
    {"T=INT32 W=CDAB", {0x0C, 0x0D, 0x0A, 0x0B}, 0x0A0B0C0D},
    {"T=INT32 W=BADC", {0x0B, 0x0A, 0x0D, 0x0C}, 0x0A0B0C0D},
    {"T=INT32 W=DCBA", {0x0D, 0x0C, 0x0B, 0x0A}, 0x0A0B0C0D},
    {"T=INT16 W=ABCD", {0x0A, 0x0B},             0x0A0B    },
    {"T=INT16 W=BADC", {0x0B, 0x0A},             0x0A0B    },
    {"T=INT16 W=DCBA", {0x0B, 0x0A},             0x0A0B    },
};

static void testLetters(void)
{
    size_t i;
    int big;

    for (i = 0; i < COUNT(letters); i++)
        for (big = 0; big < 2; big++) {
            char text[100];
            plcLink link;
            plcLinkError error;

            epicsSnprintf(text, sizeof(text), "@PLC/4 %s", letters[i].options);
            testOk(plcLinkParse(text, &link, &error) == 0 &&
                       plcGetInt(link.type, letters[i].bytes, plcLinkOrder(&link, big, 0)) ==
                           letters[i].value,
                   "%s, bigEndian %d", letters[i].options, big);
        }
}

static void testColumns(void)
{
    plcLink link;
    plcLinkError error;

    testOk1(plcLinkParse("@PLC/4 T=INT8 L=1 'B", &link, &error) == -1);
    testOk1(plcLinkParse("@PLC/ 4 B=1  T=INT8 R=3", &link, &error) == 0);
    testOk(link.column.offset == 6 && link.column.B == 8 && link.column.T == 13 &&
               link.column.R == 20,
           "the link remembers where offset, B, T and R stand");
    testOk(link.column.L == 23 && link.column.H == 23 && link.column.W == 23,
           "what is not there is at the end");
    testOk(plcLinkParse(NULL, &link, &error) == -1, "no text at all is refused");
}

/* Accepted, with a word of doubt. */
static const struct {
    const char *what;
    const char *text;
    size_t column;
    const char *message;
    size_t offset;
    epicsInt64 low;
} doubts[] = {
    {"an octal offset",               "@PLC/010",         5,
     "offset \"010\" is octal because of its leading 0: 8",                                                  8,  0  },
    {"an octal number in a sum",      "@PLC/4+0100",      7,
     "offset \"0100\" is octal because of its leading 0: 64",                                                68, 0  },
    {"an octal limit",                "@PLC/0 L=-020",    10,
     "L= \"020\" is octal because of its leading 0: 16",                                                     0,  -16},
    {"an empty limit",                "@PLC/1 L= H=5",    9,  "L= has no value: taken as 0",                 1,  0  },
    {"an empty bit",                  "@PLC/1 B=",        9,  "B= has no value: taken as 0",                 1,  0  },
    {"the same option twice",         "@PLC/1 L=1 L=2",   11,
     "L= is given twice: the last one counts",                                                               1,  2  },
    {"an open quote",                 "@PLC/1 'L=2",      7,  "the quote ' is not closed",                   1,  2  },
    {"text behind the quotes",        "@PLC/1 'L=2' B=3", 13,
     "what follows the closing quote ' is ignored",                                                          1,  2  },
    {"double quotes",                 "@PLC/1 ''L=2''",   9,  "what follows the closing quote ' is ignored",
     1,                                                                                                          0  },
    {"two doubts: the first is told", "@PLC/010 L=1 L=2", 5,
     "offset \"010\" is octal because of its leading 0: 8",                                                  8,  2  },
};

static void testDoubts(void)
{
    static const char *const same[] = {"@PLC/00", "@PLC/07", "@PLC/0 L=00 H=007 B=01"};
    plcLink link;
    plcLinkError error;
    size_t i;

    for (i = 0; i < COUNT(doubts); i++) {
        int status = plcLinkParse(doubts[i].text, &link, &error);

        testOk(status == 0 && error.column == doubts[i].column &&
                   strcmp(error.text, doubts[i].message) == 0 &&
                   link.offset == doubts[i].offset && link.low == doubts[i].low,
               "%s: %s: %lu: %s", doubts[i].what, doubts[i].text,
               (unsigned long)error.column, error.text);
    }
    for (i = 0; i < COUNT(same); i++)
        testOk(plcLinkParse(same[i], &link, &error) == 0 && error.text[0] == 0,
               "%s means the same in octal: no doubt", same[i]);
}

/* Refused. The column of each is where the caret goes. */
static const struct {
    const char *text;
    size_t column;
    const char *message;
} refusals[] = {
    {"",                                                            0,  "no PLC name; allowed: @PLCname/offset T=type ..."            },
    {"@",                                                           1,  "no PLC name; allowed: @PLCname/offset T=type ..."            },
    {"  ",                                                          2,  "no PLC name; allowed: @PLCname/offset T=type ..."            },
    {"@/4",                                                         1,  "no PLC name; allowed: @PLCname/offset T=type ..."            },
    {"/",                                                           0,  "no PLC name; allowed: @PLCname/offset T=type ..."            },
    {"@PLC T=INT8",                                                 5,  "\"/\" expected before \"T=INT8\", as in @PLC/0"              },
    {"@PLC 4",                                                      5,  "\"/\" expected before \"4\", as in @PLC/0"                   },
    {"@PLC//4",                                                     5,  "offset \"/4\" is no number; allowed: such as 20 or 20+2"     },
    {"@PLC/4/2",                                                    6,  "offset \"4/2\": only sums such as 4+2 are allowed"           },
    {"@PLC/4-2",                                                    6,  "offset \"4-2\": only sums such as 4+2 are allowed"           },
    {"@PLC/4*2",                                                    6,  "offset \"4*2\": only sums such as 4+2 are allowed"           },
    {"@PLC/4.5",                                                    6,  "offset \"4.5\": only sums such as 4+2 are allowed"           },
    {"@PLC/4e1",                                                    6,  "offset \"4e1\": only sums such as 4+2 are allowed"           },
    {"@PLC/(4)",                                                    5,  "offset \"(4)\" is no number; allowed: such as 20 or 20+2"    },
    {"@PLC/abc",                                                    5,  "offset \"abc\" is no number; allowed: such as 20 or 20+2"    },
    {"@PLC/INT8",                                                   5,  "offset \"INT8\" is no number; allowed: such as 20 or 20+2"   },
    {"@PLC/$(OFFS)",                                                5,  "offset \"$(OFFS)\" is no number; allowed: such as 20 or 20+2"},
    {"@PLC/4 +2",                                                   7,  "no blank is allowed before the + of offset"                  },
    {"@PLC/4 + 2",                                                  7,  "no blank is allowed before the + of offset"                  },
    {"@PLC/-4",                                                     5,  "offset -4 is negative; allowed: 0 and more"                  },
    {"@PLC/4+-6",                                                   5,  "offset -2 is negative; allowed: 0 and more"                  },
    {"@PLC/- 4",                                                    6,  "offset \"\" is no number; allowed: such as 20 or 0x14"       },
    {"@PLC/4--2",                                                   6,  "offset \"4--2\": only sums such as 4+2 are allowed"          },
    {"@PLC/0x",                                                     5,  "offset \"0x\" is no number; allowed: such as 20 or 0x14"     },
    {"@PLC/0xg",                                                    5,  "offset \"0xg\" is no number; allowed: such as 20 or 0x14"    },
    {"@PLC/09",                                                     6,  "offset \"09\": a leading 0 means octal, without digit 9"     },
    {"@PLC/4,T=INT8",                                               6,  "offset \"4,T=INT8\": only sums such as 4+2 are allowed"      },
    {"@PLC/4&T=INT8",                                               6,  "offset \"4&T=INT8\": only sums such as 4+2 are allowed"      },
    {"@PLC/4 2",                                                    7,  "unknown option \"2\"; allowed: T= L= H= B= R= W="            },
    {"@PLC/4 /2",                                                   7,  "unknown option \"/2\"; allowed: T= L= H= B= R= W="           },
    {"@PLC/99999999999999999999",                                   5,  ""                                                            },
    {"@PLC/0x8000000000000000",                                     5,  ""                                                            },
    {"@PLC/9223372036854775807+1",                                  25,
     "the sum is too large; allowed: up to 9223372036854775807"                                                                       },
    {"@PLC/-9223372036854775807+-9223372036854775807",              26,
     "the sum is too small; allowed: 0 and more"                                                                                      },
    {"@PLC/4 foo",                                                  7,  "unknown option \"foo\"; allowed: T= L= H= B= R= W="          },
    {"@PLC/4 X=3",                                                  7,  "unknown option \"X=3\"; allowed: T= L= H= B= R= W="          },
    {"@PLC/4 T=INT8 X=3",                                           14, "unknown option \"X=3\"; allowed: T= L= H= B= R= W="          },
    {"@PLC/4 TYPE=INT8",                                            7,  "unknown option \"TYPE=INT8\"; allowed: T= L= H= B= R= W="    },
    {"@PLC/4 =3",                                                   7,  "unknown option \"=3\"; allowed: T= L= H= B= R= W="           },
    {"@PLC/4 # comment",                                            7,  "unknown option \"#\"; allowed: T= L= H= B= R= W="            },
    {"@PLC/4 \x01\xff",                                             7,  "unknown option \"??\"; allowed: T= L= H= B= R= W="           },
    {"@PLC/4 abcdefghijklmnopqrstuvwxyzabcdefghijklmnopqrstuvwxyz", 7,
     "unknown option \"abcdefghijklmnopqrstuvwxyzabc...\"; allowed: T= L= H= B= R= W="                                                },
    {"@PLC/4 T",                                                    7,  "unknown option \"T\"; allowed: T= L= H= B= R= W="            },
    {"@PLC/4 L",                                                    7,  "unknown option \"L\"; allowed: T= L= H= B= R= W="            },
    {"@PLC/4 B1",                                                   7,  "unknown option \"B1\"; allowed: T= L= H= B= R= W="           },
    {"@PLC/4 T =INT8",                                              7,  "unknown option \"T\"; allowed: T= L= H= B= R= W="            },
    {"@PLC/4 T= INT8",                                              9,  "T= has no value; allowed: such as T=INT16"                   },
    {"@PLC/4 T=",                                                   9,  "T= has no value; allowed: such as T=INT16"                   },
    {"@PLC/4 T=L=4",                                                9,  "T= has no value; allowed: such as T=INT16"                   },
    {"@PLC/4 T='INT8'",                                             9,  "T= has no value; allowed: such as T=INT16"                   },
    {"@PLC/4 T=DINT", 9, "T=DINT is no data type; allowed: T=INT32, a DINT of the PLC"},
    {"@PLC/4 T=REAL", 9, "T=REAL is no data type; allowed: T=REAL32, a REAL of the PLC"},
    {"@PLC/4 T=LREAL", 9, "T=LREAL is no data type; allowed: T=REAL64, an LREAL of the PLC"},
    {"@PLC/4 T=SINT", 9, "T=SINT is no data type; allowed: T=INT8, a SINT of the PLC"},
    {"@PLC/4 T=USINT", 9, "T=USINT is no data type; allowed: T=UINT8, a USINT of the PLC"},
    {"@PLC/4 T=INT", 9, "T=INT is no data type; allowed: T=INT16, an INT of the PLC"},
    {"@PLC/4 T=UINT", 9, "T=UINT is no data type; allowed: T=UINT16, a UINT of the PLC"},
    {"@PLC/4 T=UDINT", 9, "T=UDINT is no data type; allowed: T=UINT32, a UDINT of the PLC"},
    {"@PLC/4 T=LINT", 9, "T=LINT is no data type; allowed: T=INT64, a LINT of the PLC"},
    {"@PLC/4 T=ULINT", 9, "T=ULINT is no data type; allowed: T=UINT64, a ULINT of the PLC"},
    {"@PLC/4 T=BOOL", 9, "T=BOOL is no data type; allowed: T=BYTE B=bit, in a bi or bo"},
    {"@PLC/4 T=INT32_BE", 9,
     "T=INT32_BE is no data type; allowed: T=INT32 W=ABCD, the same in asyn's modbus"},
    {"@PLC/4 T=float64_le_bs", 9,
     "T=float64_le_bs is no data type; allowed: T=REAL64 W=DCBA, the same in asyn's modbus"},
    {"@PLC/4 T=BCD_SIGNED", 9,
     "T=BCD_SIGNED is no data type; allowed: T=SBCD16, the same in asyn's modbus"},
    {"@PLC/4 T=BCD_UNSIGNED", 9,
     "T=BCD_UNSIGNED is no data type; allowed: T=BCD16, the same in asyn's modbus"},
    {"@PLC/4 T=INT16SM", 9, "T=INT16SM is no data type; allowed: T=SM16, the same in asyn's modbus"},
    {"@PLC/4 T=STRING_HIGH", 9,
     "T=STRING_HIGH is no data type; allowed: T=STRING W=A0, the same in asyn's modbus"},
    {"@PLC/4 T=STRING_LOW", 9,
     "T=STRING_LOW is no data type; allowed: T=STRING W=0A, the same in asyn's modbus"},
    {"@PLC/4 T=STRING_HIGH_LOW", 9,
     "T=STRING_HIGH_LOW is no data type; allowed: T=STRING, the same in asyn's modbus"},
    {"@PLC/4 T=STRING_LOW_HIGH", 9,
     "T=STRING_LOW_HIGH is no data type; allowed: T=STRING W=BADC, the same in asyn's modbus"},
    {"@PLC/4 T=ZSTRING_HIGH", 9,
     "T=ZSTRING_HIGH is no data type; allowed: T=STRING W=A0, the same in asyn's modbus"},
    {"@PLC/4 T=ZSTRING_LOW", 9,
     "T=ZSTRING_LOW is no data type; allowed: T=STRING W=0A, the same in asyn's modbus"},
    {"@PLC/4 T=ZSTRING_HIGH_LOW", 9,
     "T=ZSTRING_HIGH_LOW is no data type; allowed: T=STRING, the same in asyn's modbus"},
    {"@PLC/4 T=UINT32_LE", 9,
     "T=UINT32_LE is no data type; allowed: T=UINT32 W=CDAB, the same in asyn's modbus"},
    {"@PLC/4 T=INT64_BE_BS", 9,
     "T=INT64_BE_BS is no data type; allowed: T=INT64 W=BADC, the same in asyn's modbus"},
    {"@PLC/4 T=UINT64_BE", 9,
     "T=UINT64_BE is no data type; allowed: T=UINT64 W=ABCD, the same in asyn's modbus"},
    {"@PLC/4 T=FLOAT32_LE", 9,
     "T=FLOAT32_LE is no data type; allowed: T=REAL32 W=CDAB, the same in asyn's modbus"},
    {"@PLC/4 T=ZSTRING_LOW_HIGH", 9,
     "T=ZSTRING_LOW_HIGH is no data type; allowed: T=STRING W=BADC, the same in asyn's modbus"},
    {"@PLC/4 T=INT32_", 9, ""},
    {"@PLC/4 T=INT16_LE", 9, ""},
    {"@PLC/4 T=FLOT",                                               9,
     "T=FLOT is no data type; allowed: INT8 UINT8 INT16 UINT16 INT32 UINT32 INT64 UINT64 "
     "REAL32 REAL64 STRING TIME S7STRING BCD16 BCD32 SM16 SBCD16"                                                                                                      },
    {"@PLC/4 T=INT16X",                                             9,  ""                                                            },
    {"@PLC/4 T=INT1",                                               9,  ""                                                            },
    {"@PLC/4 T=INT",                                                9,  ""                                                            },
    {"@PLC/4 T=INT128",                                             9,  ""                                                            },
    {"@PLC/4 T=FLOATX",                                             9,  ""                                                            },
    {"@PLC/4 T=REAL",                                               9,  ""                                                            },
    {"@PLC/4 T=BOOL",                                               9,  ""                                                            },
    {"@PLC/4 T=DINT",                                               9,  ""                                                            },
    {"@PLC/4 T=INT8,L=0",                                           9,  ""                                                            },
    {"@PLC/4 T=INT8, L=0",                                          9,  ""                                                            },
    {"@PLC/4 T=INT8;L=0",                                           9,  ""                                                            },
    {"@PLC/4 T=INT8/",                                              9,  ""                                                            },
    {"@PLC/4 T=INT8@",                                              9,  ""                                                            },
    {"@PLC/4 T=INT8+",                                              9,  ""                                                            },
    {"@PLC/4 T=INT8L",                                              9,  ""                                                            },
    {"@PLC/4 T=INT8'",                                              13, "a quote ' is allowed only around all options"                },
    {"@PLC/4 T=INT8 'B=1'",                                         14, "a quote ' is allowed only around all options"                },
    {"@PLC/4 'foo'",                                                8,  "unknown option \"foo'\"; allowed: T= L= H= B= R= W="         },
    {"@PLC/4 'T=INT8 X=3'",                                         15, "unknown option \"X=3'\"; allowed: T= L= H= B= R= W="         },
    {"@PLC/4 L=- 5",                                                10, "L= \"\" is no number; allowed: such as 20 or 0x14"           },
    {"@PLC/4 L=-",                                                  10, ""                                                            },
    {"@PLC/4 L=--5",                                                10, ""                                                            },
    {"@PLC/4 L=x",                                                  9,  "L=x is no number; allowed: such as L=20 or L=0x14"           },
    {"@PLC/4 L=1e3",                                                10, "L=1e3 is no whole number"                                    },
    {"@PLC/4 L=1.5",                                                10, "L=1.5 is no whole number"                                    },
    {"@PLC/4 L=1,5",                                                10, "L=1,5 is no whole number"                                    },
    {"@PLC/4 L=5-3",                                                10, "L=5-3 is no whole number"                                    },
    {"@PLC/4 L=5+3",                                                10, "L=5+3 is no whole number"                                    },
    {"@PLC/4 L=inf",                                                9,  ""                                                            },
    {"@PLC/4 H=08",                                                 10, "H= \"08\": a leading 0 means octal, without digit 8"         },
    {"@PLC/4 H=0x",                                                 9,  ""                                                            },
    {"@PLC/4 H=9223372036854775808",                                9,
     "H= \"9223372036854775808\" is too large; allowed: up to 9223372036854775807"                                                    },
    {"@PLC/4 L=-9223372036854775809",                               10,
     "L= \"9223372036854775809\" is too large; allowed: up to 9223372036854775808"                                                    },
    {"@PLC/4 L=99999999999999999999",                               9,  ""                                                            },
    {"@PLC/4 B=-1",                                                 9,  "B=-1 is no bit number; allowed: 0 to 63"                     },
    {"@PLC/4 B=64",                                                 9,  "B=64 is no bit number; allowed: 0 to 63"                     },
    {"@PLC/4 B=4294967296",                                         9,  "B=4294967296 is no bit number; allowed: 0 to 63"             },
    {"@PLC/4 B=one",                                                9,  "B=one is no number; allowed: such as B=20 or B=0x14"         },
    {"@PLC/4 B=1.2",                                                10, "B=1.2 is no whole number"                                    },
    {"@PLC/4 B=0x1B=1",                                             13, ""                                                            },
    {"@PLC/4 R=",                                                   9,  "R= \"\" is no number; allowed: such as 20 or 20+2"           },
    {"@PLC/4 W=",                                                   9,  "W= has no value; allowed: W=high low ABCD CDAB BADC DCBA, for texts " TEXTS},
    {"@PLC/4 W= high",                                              9,  "W= has no value; allowed: W=high low ABCD CDAB BADC DCBA, for texts " TEXTS},
    {"@PLC/4 W=''",                                                 9,  "W= has no value; allowed: W=high low ABCD CDAB BADC DCBA, for texts " TEXTS},
    {"@PLC/4 W=hi",                                                 9,  "W=hi is no word order; allowed: W=high low ABCD CDAB BADC DCBA, for texts " TEXTS},
    {"@PLC/4 W=lower",                                              9,  "W=lower is no word order; allowed: W=high low ABCD CDAB BADC DCBA, for texts " TEXTS},
    {"@PLC/4 W=1",                                                  9,  "W=1 is no word order; allowed: W=high low ABCD CDAB BADC DCBA, for texts " TEXTS},
    {"@PLC/4 T=FLOAT W=low=",                                       17, "W=low= is no word order; allowed: W=high low ABCD CDAB BADC DCBA, for texts " TEXTS},
    {"@PLC/4 R=-1",                                                 9,  "R= -1 is negative; allowed: 0 and more"                      },
    {"@PLC/4 R=4-2",                                                10, "R= \"4-2\": only sums such as 4+2 are allowed"               },
    {"@PLC/4 R=x",                                                  9,  ""                                                            },
    {"@PLC/4 R=4 +2",                                               11, "no blank is allowed before the + of R="                      },
    {"@PLC/4 M=1",                                                  7,  ""                                                            },
    {"@PLC/4 %s%n",                                                 7,  "unknown option \"%s%n\"; allowed: T= L= H= B= R= W="         },
    {"@PLC/4 \"T=INT8\"",                                           7,  ""                                                            },
    {"@PLC/4 [T=INT8]",                                             7,  ""                                                            },
    {"@PLC/4 T==INT8",                                              9,  ""                                                            },
    {"@PLC/4 T=INT8=",                                              9,  ""                                                            },
    {"@PLC/4 L==1",                                                 9,  ""                                                            },
    {"@PLC/4 L=1=",                                                 10, ""                                                            },
    {"@PLC/4 B=1'",                                                 10, ""                                                            },
    {"@PLC/4++-",                                                   9,  ""                                                            },
    {"@PLC/4x",                                                     6,  ""                                                            },
    {"@PLC/0x4g",                                                   8,  ""                                                            },
    {"@PLC/4T",                                                     6,  ""                                                            },
    {"@PLC/4+abc",                                                  7,  ""                                                            },
    {"@PLC/\xC3\xA4",                                               5,  ""                                                            },
    {"@@PLC/4 foo",                                                 8,  ""                                                            },
};

/* Names that no link holds are refused where they are known: here only their length is.
 */
static void testNames(void)
{
    char text[PLC_NAME_MAX + 10];
    plcLink link;
    plcLinkError error;

    memset(text, 'n', sizeof(text));
    strcpy(text + PLC_NAME_MAX, "/4");
    testOk(plcLinkParse(text, &link, &error) == 0 && strlen(link.station) == PLC_NAME_MAX,
           "a name may have %d characters", PLC_NAME_MAX);
    memset(text, 'n', sizeof(text));
    strcpy(text + PLC_NAME_MAX + 1, "/4");
    testOk(plcLinkParse(text, &link, &error) == -1 &&
               strcmp(error.text, "the PLC name is too long; allowed: 255 characters") ==
                   0,
           "but not more: %s", error.text);
}

static void testRefusals(void)
{
    size_t i;

    for (i = 0; i < COUNT(refusals); i++) {
        const char *text = refusals[i].text, *message = refusals[i].message;
        plcLink link;
        plcLinkError error;
        int status = plcLinkParse(text, &link, &error);

        if (sizeof(size_t) < 8 && strstr(text, "9223372036854775807")) {
            testSkip(1, "no offset of this machine is so large: it is refused by itself");
            continue;
        }
        testOk(status == -1 && error.column == refusals[i].column && error.text[0] &&
                   (!message[0] || strcmp(error.text, message) == 0),
               "refused: %s: %lu: %s", text, (unsigned long)error.column, error.text);
    }
}

/* --- The record type ---------------------------------------------------------------- */

#define LH (plcHasL | plcHasH)
#define LHW (LH | plcHasW)

static const plcShape ai = {"ai", plcInteger | plcReal, 4, LHW, "INT16"};
static const plcShape ao = {"ao", plcInteger | plcReal, 4, LHW | plcHasR, "INT16"};
static const plcShape bi = {"bi", plcInteger, 8, plcHasB, "INT16"};
static const plcShape longin = {"longin", plcInteger, 4, 0, "INT16"};
static const plcShape longout = {"longout", plcWhole, 4, plcHasR | plcHasW, "INT16"};
static const plcShape int64in = {"int64in", plcInteger, 8, LH, "INT16"};
static const plcShape stringin = {"stringin", plcText, 8, plcHasL | plcHasW, "STRING"};
static const plcShape aao = {"aao", plcInteger, 2, plcHasL | plcHasR, "INT8"};
static const plcShape chars = {"waveform", plcInteger | plcString | plcBcd, 1, 0,
                               "UINT8"};

static const struct {
    const plcShape *shape;
    size_t length;
    const char *options;
    const char *type;
    epicsInt64 low, high;
    const char *warning;
} completions[] = {
    {&ai,       0,  "",                           "INT16",  -32767,                 32767,                 ""},
    {&ai,       0,  "T=INT8",                     "INT8",   -127,                   127,                   ""},
    {&ai,       0,  "T=UINT8",                    "UINT8",  0,                      255,                   ""},
    {&ai,       0,  "T=UINT16",                   "UINT16", 0,                      65535,                 ""},
    {&ai,       0,  "T=INT32",                    "INT32",  -2147483647,            2147483647,            ""},
    {&ai,       0,  "T=UINT32",                   "UINT32", 0,                      4294967295LL,          ""},
    {&ai,       0,  "T=FLOAT",                    "REAL32", 0,                      0,                     ""},
    {&ai,       0,  "T=DOUBLE L=5 H=1 B=63",      "REAL64", 5,                      1,
     "L= and H= have no effect on REAL64: it is neither cut nor scaled by them"},
    {&ai,       0,  "T=DOUBLE L=0 H=0",           "REAL64", 0,                      0,                     ""},
    {&ai,       0,  "L=0 H=27648",                "INT16",  0,                      27648,                 ""},
    {&ai,       0,  "H=27648",                    "INT16",  0,                      27648,                 ""},
    {&ai,       0,  "L=5",                        "INT16",  5,                      32767,                 ""},
    {&ai,       0,  "L=0 H=0",                    "INT16",  -32767,                 32767,                 ""},
    {&ai,       0,  "H=0",                        "INT16",  -32767,                 32767,                 ""},
    {&ai,       0,  "L=-100 H=0",                 "INT16",  -100,                   0,                     ""},
    {&ai,       0,  "L=-100 H=-50",               "INT16",  -100,                   -50,                   ""},
    {&ai,       0,  "L=-32768",                   "INT16",  -32768,                 32767,                 ""},
    {&ai,       0,  "T=INT8 L=-128 H=127",        "INT8",   -128,                   127,                   ""},
    {&ai,       0,  "T=UINT32 L=10 H=0xFFFFFFFF", "UINT32", 10,                     4294967295LL,          ""},
    {&ai,       0,  "B=15",                       "INT16",  -32767,                 32767,                 ""},
    {&ai,       0,  "T=INT32 W=low",              "INT32",  -2147483647,            2147483647,            ""},
    {&ai,       0,  "T=DOUBLE W=high",            "REAL64", 0,                      0,                     ""},
    {&ai,       0,  "W=low",                      "INT16",  -32767,                 32767,
     "W= has no effect on INT16: only types of 4 and 8 bytes have an order of words; allowed: W=BADC "
     "DCBA, the lower byte first"                                                                       },
    {&ai,       0,  "W=BADC",                     "INT16",  -32767,                 32767,                 ""},
    {&ai,       0,  "T=BYTE W=BADC",              "UINT8",  0,                      255,
     "W= has no effect on UINT8: only types of 4 and 8 bytes have an order of words"                         },
    {&ai,       0,  "T=BYTE W=high",              "UINT8",  0,                      255,
     "W= has no effect on UINT8: only types of 4 and 8 bytes have an order of words"                         },
    {&stringin, 40, "W=high",                     "STRING", 40,                     0,
     "W=high and W=low have no effect on STRING: the order of a text is W=" TEXTS                             },
    {&chars,    8,  "T=TIME W=high",              "TIME",   0,                      0,
     "W= has no effect on TIME: only types of 4 and 8 bytes have an order of words"                          },
    {&ai,       0,  "L=-40000 H=100 W=low",       "INT16",  -40000,                 100,
     "L=-40000 is below the type: INT16 begins at -32768"                                                    },
    {&ai,       0,  "L=-40000 H=100",             "INT16",  -40000,                 100,
     "L=-40000 is below the type: INT16 begins at -32768"                                                    },
    {&ai,       0,  "T=UINT8 L=-10 H=100",        "UINT8",  -10,                    100,
     "L=-10 is below the type: UINT8 begins at 0"                                                            },
    {&ao,       0,  "R=5",                        "INT16",  -32767,                 32767,                 ""},
    {&bi,       0,  "",                           "INT16",  -32767,                 32767,                 ""},
    {&bi,       0,  "T=QWORD B=63",               "UINT64", 0,                      9223372036854775807LL, ""},
    {&bi,       0,  "T=INT64 B=32",               "INT64",  -9223372036854775807LL, 9223372036854775807LL, ""},
    {&bi,       0,  "B=7 T=BYTE",                 "UINT8",  0,                      255,                   ""},
    {&longin,   0,  "L=10 H=1",                   "INT16",  10,                     1,                     ""},
    {&longin,   0,  "L=-40000",                   "INT16",  -40000,                 32767,                 ""},
    {&int64in,  0,  "T=INT64",                    "INT64",  -9223372036854775807LL, 9223372036854775807LL, ""},
    {&aao,      8,  "L=200",                      "INT8",   200,                    127,                   ""},
    {&stringin, 40, "",                           "STRING", 40,                     0,                     ""},
    {&stringin, 40, "L=4",                        "STRING", 4,                      0,                     ""},
    {&stringin, 40, "T=STRING L=40",              "STRING", 40,                     0,                     ""},
    {&stringin, 40, "L=0",                        "STRING", 40,                     0,                     ""},
    {&stringin, 40, "B=16",                       "STRING", 40,                     0,                     ""},
    {&stringin, 40, "L=1000",                     "STRING", 1000,                   0,                     ""},
    {&chars,    8,  "",                           "UINT8",  0,                      255,                   ""},
    {&chars,    8,  "T=TIME",                     "TIME",   0,                      0,                     ""},
    {&stringin, 40, "T=S7STRING L=16",            "S7STRING", 16,                   0,                     ""},
    {&stringin, 40, "T=S7STRING",                 "S7STRING", 254,                  0,                     ""},
    {&chars,    8,  "T=STRING",                   "STRING", 8,                      0,                     ""},
    {&chars,    8,  "T=STRING L=3",               "STRING", 3,                      0,                     ""},
};

/* Parses the options and completes them. */
static int complete(const plcShape *shape, size_t length, const char *options,
                    plcLink *link, plcLinkError *error)
{
    char text[100];

    epicsSnprintf(text, sizeof(text), "@PLC/4 %s", options);
    if (plcLinkParse(text, link, error))
        testAbort("%s is refused: %s", text, error->text);
    return plcLinkComplete(link, shape, length, error);
}

/* What is taken and does nothing is told. */
static const struct {
    const plcShape *shape;
    const char *place;
    const char *message; /* its beginning; "": nothing is said */
    size_t column;
} idleRows[] = {
    {&longout,  "@PLC/4 L=1 H=9",           "L= H= have no effect on longout: a value that does not fit wraps in INT16; L= and H= are for ai, ao and calcout, L= for texts, B= for bi and bo", 7},
    {&longout,  "@PLC/4 H=9",               "H= has no effect on longout: a value that does not fit wraps in INT16;", 7},
    {&longout,  "@PLC/4 H=9 T=BCD16",       "H= has no effect on longout;", 7},
    {&longout,  "@PLC/4 B=3",               "B= has no effect on longout;", 7},
    {&longout,  "@PLC/4 L=0 H=0 B=0",       "", 0},
    {&longin,   "@PLC/4 L=1 H=9 B=3",       "L= H= B= have no effect on longin;", 7},
    {&ai,       "@PLC/4 B=3",               "B= has no effect on ai;", 7},
    {&ai,       "@PLC/4 L=0",               "", 0},
    {&ai,       "@PLC/4 L=1 H=9",           "", 0},
    {&bi,       "@PLC/4 B=3",               "", 0},
    {&bi,       "@PLC/4 B=3 H=7",           "H= has no effect on bi;", 11},
    {&aao,      "@PLC/4 L=200",             "L= has no effect on aao", 7},
    {&stringin, "@PLC/4 L=4",               "", 0},
    {&stringin, "@PLC/4 L=0",               "L=0 is taken as the length that the record has", 7},
    {&stringin, "@PLC/4 H=4",               "H= has no effect on stringin;", 7},
    {&stringin, "@PLC/4 B=1 T=S7STRING",    "B= has no effect on stringin;", 7},
    {&ai,       "@PLC/4+",                  "nothing follows a +: taken as 0", 6},
    {&ai,       "@PLC/4+ T=BYTE",           "nothing follows a +: taken as 0", 6},
    {&ai,       "@PLC/4++2",                "nothing follows a +: taken as 0", 6},
    {&ai,       "@PLC/4+ 2",                "", 0},
    {&ai,       "@PLC/+4+-2",               "", 0},
    {&ao,       "@PLC/4 R=4+",              "nothing follows a +: taken as 0", 10},
    {&ao,       "@PLC/4 R=4+2",             "", 0},
};

static void testIdle(void)
{
    size_t i, room;

    for (i = 0; i < COUNT(idleRows); i++) {
        plcLink given, link;
        plcLinkError error;

        room = idleRows[i].shape == &stringin ? 40 : 0;
        if (plcLinkParse(idleRows[i].place, &link, &error))
            testAbort("%s", error.text);
        given = link;
        if (plcLinkComplete(&link, idleRows[i].shape, room, &error))
            testAbort("%s", error.text);
        plcLinkIdle(&given, link.type, idleRows[i].shape, &error);
        testOk((idleRows[i].message[0] ? strstr(error.text, idleRows[i].message) == error.text
                                       : !error.text[0]) &&
                   error.column == idleRows[i].column,
               "%s %s: %lu: %s", idleRows[i].shape->recordType, idleRows[i].place,
               (unsigned long)error.column, error.text);
    }
}

static void testCompletions(void)
{
    size_t i;

    for (i = 0; i < COUNT(completions); i++) {
        plcLink link;
        plcLinkError error;
        int status = complete(completions[i].shape, completions[i].length,
                              completions[i].options, &link, &error);

        testOk(status == 0 && strcmp(error.text, completions[i].warning) == 0 &&
                   strcmp(link.type->name, completions[i].type) == 0 &&
                   link.low == completions[i].low && link.high == completions[i].high,
               "%s with \"%s\" is %s from %lld to %lld %s",
               completions[i].shape->recordType, completions[i].options,
               completions[i].type, (long long)link.low, (long long)link.high,
               error.text);
    }
}

static const struct {
    const char *options;
    int orders[4]; /* for each order of the station */
} orderRows[] = {
    {"T=INT32",        {0, 1, 2, 3}},
    {"T=INT32 W=high", {2, 1, 2, 1}},
    {"T=INT32 W=low",  {0, 3, 0, 3}},
    {"T=FLOAT W=low",  {0, 3, 0, 3}},
    {"T=DOUBLE",       {0, 1, 2, 3}},
    {"",               {0, 1, 0, 1}},
    {"W=high",         {0, 1, 0, 1}},
    {"T=BYTE W=low",   {0, 1, 0, 1}},
};

static void testOrders(void)
{
    size_t i;
    int order;

    for (i = 0; i < COUNT(orderRows); i++) {
        plcLink link;
        plcLinkError error;

        complete(&ai, 0, orderRows[i].options, &link, &error);
        for (order = 0;
             order < 4 && plcLinkOrder(&link, order, 5 - order) == orderRows[i].orders[order];
             order++)
            ;
        testOk(order == 4, "the order with \"%s\"", orderRows[i].options);
    }
}

/* Texts: the order where the PLC has this one, and how much of a length counts. */
static const struct {
    const char *options;
    int ofPlc, order;
    size_t length, left; /* 0: refused */
    const char *message;
} textRows[] = {
    {"T=STRING", plcTextABCD, plcTextABCD, 5, 5, ""},
    {"T=STRING", plcTextBADC, plcTextBADC, 5, 4, ""},
    {"T=STRING W=ABCD", plcTextBADC, plcTextABCD, 5, 5, ""},
    {"T=STRING W=BADC", plcTextABCD, plcTextBADC, 40, 40, ""},
    {"T=STRING W=CDAB", plcTextABCD, plcTextCDAB, 41, 40, ""},
    {"T=STRING W=DCBA", plcTextABCD, plcTextDCBA, 41, 40, ""},
    {"T=STRING W=A0", plcTextABCD, plcTextA0, 80, 80, ""},
    {"T=STRING W=0A", plcTextABCD, plcText0A, 81, 80, ""},
    {"T=STRING W=low", plcTextBADC, plcTextBADC, 8, 8,
     "W=high and W=low have no effect on STRING: the order of a text is W=" TEXTS},
    {"T=STRING L=5 W=BADC", plcTextABCD, plcTextBADC, 5, 0,
     "L=5: in this order a text has a multiple of 2 bytes; allowed: such as L=6"},
    {"T=STRING L=6 W=DCBA", plcTextABCD, plcTextDCBA, 6, 0,
     "L=6: in this order a text has a multiple of 4 bytes; allowed: such as L=8"},
    {"T=STRING L=0777777777777777777777 W=DCBA", plcTextABCD, plcTextDCBA, 39, 0,
     "L=9223372036854775807: in this order a text has a multiple of 4 bytes; allowed: such as "
     "L=9223372036854775804"},
    {"T=S7STRING L=5", plcTextBADC, plcTextBADC, 7, 0,
     "L=5: in this order a text has a multiple of 2 bytes with its head; allowed: such as L=6"},
    {"T=STRING W=CDAB", plcTextABCD, plcTextCDAB, 3, 0,
     "no room for a text of 4 bytes, the least in this order"},
};

static void testTextOrders(void)
{
    size_t i;

    for (i = 0; i < COUNT(textRows); i++) {
        plcLink link;
        plcLinkError error;
        int status = complete(&stringin, 40, textRows[i].options, &link, &error);
        size_t length = textRows[i].length;
        int refused = plcLinkTextLength(&link, textRows[i].order, &length, &error);

        testOk(status == 0 && plcLinkOrder(&link, 3, textRows[i].ofPlc) == textRows[i].order &&
                   (textRows[i].left ? !refused && length == textRows[i].left : refused) &&
                   strcmp(error.text, textRows[i].message) == 0,
               "a text with \"%s\" of %u bytes: %u %s", textRows[i].options,
               (unsigned)textRows[i].length, (unsigned)length, error.text);
    }
}

/* All after "@PLC/4 ": column 7 is the first character of the options. */
static const struct {
    const plcShape *shape;
    size_t length;
    const char *options;
    size_t column;
    const char *message;
} misfits[] = {
    {&ai,       0,  "T=STRING",              7,
     "T=STRING does not fit ai; allowed: INT8 UINT8 INT16 UINT16 INT32 UINT32 REAL32 "
     "REAL64"                                                                                         },
    {&ai,       0,  "T=INT32 W=A0",          15,
     "W=A0 and W=0A are for texts, not INT32; allowed: W=high low ABCD CDAB BADC DCBA"},
    {&ai,       0,  "T=TIME",                7,  ""                                                   },
    {&ai,       0,  "T=INT64",               7,  ""                                                   },
    {&ai,       0,  "L=1 T=QWORD",           11, ""                                                   },
    {&bi,       0,  "T=FLOAT",               7,
     "T=REAL32 does not fit bi; allowed: INT8 UINT8 INT16 UINT16 INT32 UINT32 INT64 "
     "UINT64"                                                                                         },
    {&bi,       0,  "T=DOUBLE",              7,  ""                                                   },
    {&longin,   0,  "T=LONGLONG",            7,  ""                                                   },
    {&longin,   0,  "T=FLOAT",               7,  ""                                                   },
    {&stringin, 40, "T=INT16",               7,  "T=INT16 does not fit stringin; allowed: STRING S7STRING"},
    {&stringin, 40, "T=S7STRING L=255",      18,
     "L=255: an S7STRING has 1 to 254 characters, as the PLC's STRING[n]"                            },
    {&stringin, 40, "L=0 T=S7STRING",        7,
     "L=0: an S7STRING has 1 to 254 characters, as the PLC's STRING[n]"                              },
    {&chars,    8,  "T=INT16",               7,
     "T=INT16 does not fit waveform; allowed: INT8 UINT8 STRING TIME"                                 },
    {&ai,       0,  "L=1 H=1",               7,  "L=1 H=1: L must be less than H"                     },
    {&ai,       0,  "H=1 L=10",              11, "L=10 H=1: L must be less than H"                    },
    {&ai,       0,  "H=-5",                  7,  "L=0 H=-5: L must be less than H"                    },
    {&ai,       0,  "T=UINT8 L=255",         15, "L=255 H=255: L must be less than H"                 },
    {&ai,       0,  "L=0x8001 H=0x7FFF",     7,  "L=32769 H=32767: L must be less than H"             },
    {&ai,       0,  "T=INT8 H=1000",         14,
     "H=1000 is beyond the type; allowed for INT8: up to 127"                                         },
    {&ai,       0,  "H=4294967295",          7,  ""                                                   },
    {&ai,       0,  "T=UINT32 H=4294967296", 16, ""                                                   },
    {&longin,   0,  "T=INT8 H=1000",         14, ""                                                   },
    {&stringin, 40, "L=-1",                  7,  "L=-1: the length of a string must be 1 byte or more"},
    {&stringin, 0,  "",                      7,  "L=0: the length of a string must be 1 byte or more" },
    {&bi,       0,  "B=16",                  7,  "B=16: INT16 has bits 0 to 15"                       },
    {&bi,       0,  "B=8 T=INT8",            7,  "B=8: INT8 has bits 0 to 7"                          },
    {&bi,       0,  "T=INT32 B=32",          15, "B=32: INT32 has bits 0 to 31"                       },
    {&ai,       0,  "B=16",                  7,  "B=16: INT16 has bits 0 to 15"                       },
    {&ai,       0,  "T=FLOAT B=32",          15, ""                                                   },
    {&chars,    8,  "T=TIME B=8",            14, ""                                                   },
    {&ai,       0,  "R=4",                   7,  "R= (read-back) is for outputs only, not ai"         },
};

static void testMisfits(void)
{
    size_t i;

    for (i = 0; i < COUNT(misfits); i++) {
        const char *message = misfits[i].message;
        plcLink link;
        plcLinkError error;
        int status = complete(misfits[i].shape, misfits[i].length, misfits[i].options,
                              &link, &error);

        testOk(status == -1 && error.column == misfits[i].column && error.text[0] &&
                   (!message[0] || strcmp(error.text, message) == 0),
               "%s refuses \"%s\": %lu: %s", misfits[i].shape->recordType,
               misfits[i].options, (unsigned long)error.column, error.text);
    }
}

/* --- Noise -------------------------------------------------------------------------- */

#define NOISE 100000

static epicsUInt32 seed = 20000; /* the same texts in every run */

static unsigned roll(unsigned below)
{
    seed = seed * 1664525u + 1013904223u;
    return (seed >> 8) % below;
}

static void randomBytes(char *text, size_t size)
{
    size_t length = roll((unsigned)size), i;

    for (i = 0; i < length; i++)
        text[i] = (char)(1 + roll(255));
    text[length] = 0;
}

static void randomPieces(char *text, size_t size)
{
    static const char *const pieces[] = {
        "@",     "PLC",   "/",  "4",  "+",  "-",        " ",  "'",
        "T=",    "INT16", "L=", "H=", "B=", "R=",       "0x", "99999999999",
        "FLOAT", "\t",    "=",  "0",  "8",  "T=STRING", "\"", "\xFF",
        "W=",    "W=low", "high",
    };
    int n = (int)roll(14);

    text[0] = 0;
    while (n-- > 0) {
        const char *piece = pieces[roll(COUNT(pieces))];

        if (strlen(text) + strlen(piece) + 1 < size)
            strcat(text, piece);
    }
}

/* A good link with some characters replaced, left out or doubled. */
static void mutation(char *text, size_t size)
{
    int n = 1 + (int)roll(4);

    epicsSnprintf(text, size, "@PLC-1:a/20+3+2 'T=INT32 L=-5 H=0x7FFF B=12 R=4+0x10 W=low' ");
    while (n-- > 0) {
        size_t length = strlen(text), at = roll((unsigned)length);

        switch (roll(3)) {
        case 0:
            text[at] = (char)(1 + roll(255));
            break;
        case 1:
            memmove(text + at, text + at + 1, length - at);
            break;
        default:
            if (length + 2 < size)
                memmove(text + at + 1, text + at, length - at + 1);
            break;
        }
    }
}

static void testNoise(void)
{
    static void (*const make[])(char *, size_t) = {randomBytes, randomPieces, mutation};
    static const plcShape *const shapes[] = {&ai, &ao, &bi, &int64in, &stringin, &chars};
    int refused = 0, accepted = 0, silent = 0, misplaced = 0;
    int i;

    for (i = 0; i < NOISE; i++) {
        char buffer[120], *text;
        plcLink link;
        plcLinkError error;
        int status;

        make[i % 3](buffer, sizeof(buffer));
        text = malloc(strlen(buffer) + 1); /* a sanitizer sees a step beyond its end */
        strcpy(text, buffer);
        status = plcLinkParse(text, &link, &error);
        if (status == 0)
            status = plcLinkComplete(&link, shapes[roll(COUNT(shapes))], 40, &error);
        refused += status == -1;
        accepted += status == 0;
        silent += status == -1 && error.text[0] == 0;
        misplaced += error.column > strlen(text);
        free(text);
    }
    testOk(refused + accepted == NOISE, "%d malformed links: %d refused, %d accepted",
           NOISE, refused, accepted);
    testOk(refused > NOISE / 2 && accepted > NOISE / 100, "enough of both");
    testOk(silent == 0, "each refusal has a message");
    testOk(misplaced == 0, "and a place inside the text");
}

MAIN(linkTest)
{
    testPlan(2 * COUNT(letters) + COUNT(places) + COUNT(optionRows) + COUNT(wordRows) + 5 + COUNT(doubts) + 3 +
             COUNT(refusals) + 2 + COUNT(completions) + COUNT(idleRows) + COUNT(misfits) + COUNT(textRows) +
             COUNT(orderRows) + 4);
    testDiag("Place and type");
    testPlaces();
    testDiag("Options");
    testOptions();
    testWords();
    testLetters();
    testColumns();
    testDiag("Accepted with a warning");
    testDoubts();
    testDiag("Refused");
    testRefusals();
    testNames();
    testDiag("What record types allow");
    testCompletions();
    testIdle();
    testMisfits();
    testOrders();
    testTextOrders();
    testDiag("Noise");
    testNoise();
    return testDone();
}
