/* Data types and their bytes: literal bytes in all orders, every alias, every limit. */
#include <math.h>
#include <string.h>

#include <epicsMath.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcCodec.h"

static const plcType *find(const char *name)
{
    return plcTypeFind(name, strlen(name));
}

static const struct {
    const char *name;
    const char *type; /* "" = there is no such type */
} names[] = {
    {"INT8",     "INT8"  },
    {"UINT8",    "UINT8" },
    {"UNSIGN8",  "UINT8" },
    {"BYTE",     "UINT8" },
    {"CHAR",     "UINT8" },
    {"INT16",    "INT16" },
    {"SHORT",    "INT16" },
    {"UINT16",   "UINT16"},
    {"UNSIGN16", "UINT16"},
    {"WORD",     "UINT16"},
    {"INT32",    "INT32" },
    {"LONG",     "INT32" },
    {"UINT32",   "UINT32"},
    {"UNSIGN32", "UINT32"},
    {"DWORD",    "UINT32"},
    {"INT64",    "INT64" },
    {"LONGLONG", "INT64" },
    {"UINT64",   "UINT64"},
    {"UNSIGN64", "UINT64"},
    {"QWORD",    "UINT64"},
    {"REAL32",   "REAL32"},
    {"FLOAT32",  "REAL32"},
    {"FLOAT",    "REAL32"},
    {"REAL64",   "REAL64"},
    {"FLOAT64",  "REAL64"},
    {"DOUBLE",   "REAL64"},
    {"STRING",   "STRING"},
    {"TIME",     "TIME"  },
    {"BCD",      "TIME"  },
    {"s7string", "S7STRING"},
    {"bcd16",    "BCD16" },
    {"SM16",     "SM16"  },
    {"int16",    "INT16" },
    {"Float64",  "REAL64"},
    {"longlong", "INT64" },
    {"",         ""      },
    {"INT",      ""      },
    {"INT1",     ""      },
    {"INT128",   ""      },
    {"INT16X",   ""      },
    {"UINT",     ""      },
    {"FLOAT6",   ""      },
    {"FLOAT640", ""      },
    {"LONGLON",  ""      },
    {"REAL",     ""      },
    {"STRIN",    ""      },
    {"BOOL",     ""      },
    {"INT16 ",   ""      },
};

static void testNames(void)
{
    size_t i;

    for (i = 0; i < sizeof(names) / sizeof(names[0]); i++) {
        const plcType *type = find(names[i].name);

        if (names[i].type[0])
            testOk(type && strcmp(type->name, names[i].type) == 0, "%s is %s",
                   names[i].name, names[i].type);
        else
            testOk(!type, "\"%s\" is no type", names[i].name);
    }
    testOk(plcTypeFind("FLOAT64 B=3", 5) == find("FLOAT"),
           "only `length` characters of the name count");
}

static const struct {
    const char *name;
    plcKind kind;
    unsigned size;
    epicsInt64 low, high;
} types[] = {
    {"INT8",   plcSigned,   1, -127,        127         },
    {"UINT8",  plcUnsigned, 1, 0,           255         },
    {"INT16",  plcSigned,   2, -32767,      32767       },
    {"UINT16", plcUnsigned, 2, 0,           65535       },
    {"INT32",  plcSigned,   4, -2147483647, 2147483647  },
    {"UINT32", plcUnsigned, 4, 0,           4294967295LL},
    {"INT64",  plcSigned,   8, 0,           0           },
    {"UINT64", plcUnsigned, 8, 0,           0           },
    {"REAL32", plcReal,     4, 0,           0           },
    {"REAL64", plcReal,     8, 0,           0           },
    {"STRING", plcString,   1, 0,           0           },
    {"TIME",   plcBcd,      1, 0,           0           },
    {"S7STRING", plcS7String, 1, 0,         0           },
    {"BCD16",  plcDigits,   2, 0,           9999        },
    {"BCD32",  plcDigits,   4, 0,           99999999    },
    {"SM16",   plcMagnitude, 2, -32767,     32767       },
    {"SBCD16", plcSignedDigits, 2, -7999,       7999        },
};

static void testTypes(void)
{
    size_t i;

    for (i = 0; i < sizeof(types) / sizeof(types[0]); i++) {
        const plcType *type = &plcTypes[i];

        testOk(strcmp(type->name, types[i].name) == 0 && type->kind == types[i].kind &&
                   type->size == types[i].size && type->low == types[i].low &&
                   type->high == types[i].high,
               "%s has %u bytes and default limits %lld to %lld", types[i].name,
               types[i].size, (long long)types[i].low, (long long)types[i].high);
        testOk(plcTypeOf(types[i].kind, types[i].size) == type,
               "%s is found by its kind and size", types[i].name);
    }
    testOk(!plcTypes[i].name, "the table ends after %u types", (unsigned)i);
    testOk(!plcTypeOf(plcReal, 2), "there is no real of 2 bytes");
}

static const struct {
    const char *what;
    unsigned kinds, maxSize;
    size_t size;
    const char *list;
} lists[] = {
    {"integers to 16 bits",           plcInteger,           2, 100, "INT8 UINT8 INT16 UINT16"},
    {"integers to 32 bits and reals", plcInteger | plcReal, 4, 100,
     "INT8 UINT8 INT16 UINT16 INT32 UINT32 REAL32 REAL64"                                    },
    {"strings",                       plcString,            8, 100, "STRING"                 },
    {"both kinds of text",            plcText,              8, 100, "STRING S7STRING"        },
    {"no kind",                       0,                    8, 100, ""                       },
    {"signed in 10 characters",       plcSigned,            8, 10,  "INT8"                   },
    {"signed in 11 characters",       plcSigned,            8, 11,  "INT8 INT16"             },
    {"signed in 1 character",         plcSigned,            8, 1,   ""                       },
    {"everything",                    ~0u,                  8, 110,
     "INT8 UINT8 INT16 UINT16 INT32 UINT32 INT64 UINT64 REAL32 REAL64 STRING TIME S7STRING "
     "BCD16 BCD32 SM16 SBCD16"  },
};

static void testLists(void)
{
    size_t i;

    for (i = 0; i < sizeof(lists) / sizeof(lists[0]); i++) {
        char text[111];

        memset(text, '#', sizeof(text));
        plcTypeList(lists[i].kinds, lists[i].maxSize, text, lists[i].size);
        testOk(strcmp(text, lists[i].list) == 0 && text[lists[i].size] == '#',
               "list of %s: \"%s\"", lists[i].what, text);
    }
}

static const struct {
    const char *type;
    epicsUInt8 big[8]; /* most significant byte first */
    epicsInt64 value;
} integers[] = {
    {"INT8",   {0x00},                                           0                    },
    {"INT8",   {0x7F},                                           127                  },
    {"INT8",   {0x80},                                           -128                 },
    {"INT8",   {0xFF},                                           -1                   },
    {"UINT8",  {0x80},                                           128                  },
    {"UINT8",  {0xFF},                                           255                  },
    {"INT16",  {0x12, 0x34},                                     0x1234               },
    {"INT16",  {0x80, 0x00},                                     -32768               },
    {"INT16",  {0x80, 0x01},                                     -32767               },
    {"INT16",  {0xFF, 0xFE},                                     -2                   },
    {"UINT16", {0x00, 0xFF},                                     255                  },
    {"UINT16", {0x80, 0x01},                                     32769                },
    {"UINT16", {0xFF, 0xFF},                                     65535                },
    {"INT32",  {0x12, 0x34, 0x56, 0x78},                         0x12345678           },
    {"INT32",  {0x80, 0x00, 0x00, 0x00},                         -2147483647 - 1      },
    {"INT32",  {0xFF, 0xFF, 0xFF, 0x85},                         -123                 },
    {"UINT32", {0x80, 0x00, 0x00, 0x02},                         2147483650LL         },
    {"UINT32", {0xFF, 0xFF, 0xFF, 0xFF},                         4294967295LL         },
    {"INT64",  {0x01, 0x23, 0x45, 0x67, 0x89, 0xAB, 0xCD, 0xEF}, 0x0123456789ABCDEFLL },
    {"INT64",  {0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFD}, -3                   },
    {"INT64",
     {0x80, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00},
     -0x7FFFFFFFFFFFFFFFLL - 1                                                        },
    {"UINT64", {0xFE, 0xDC, 0xBA, 0x98, 0x76, 0x54, 0x32, 0x10}, -0x0123456789ABCDF0LL},
    {"STRING", {0xE4},                                           0xE4                 },
    {"TIME",   {0x59},                                           0x59                 },
    {"BCD16",  {0x00, 0x00},                                     0                    },
    {"BCD16",  {0x12, 0x34},                                     1234                 },
    {"BCD16",  {0x99, 0x99},                                     9999                 },
    {"BCD32",  {0x01, 0x23, 0x45, 0x67},                         1234567              },
    {"BCD32",  {0x99, 0x99, 0x99, 0x99},                         99999999             },
    {"SM16",   {0x00, 0x05},                                     5                    },
    {"SM16",   {0x80, 0x05},                                     -5                   },
    {"SM16",   {0x7F, 0xFF},                                     32767                },
    {"SM16",   {0xFF, 0xFF},                                     -32767               },
    {"SBCD16", {0x12, 0x34},                                     1234                 },
    {"SBCD16", {0x92, 0x34},                                     -1234                },
    {"SBCD16", {0x79, 0x99},                                     7999                 },
    {"SBCD16", {0xF9, 0x99},                                     -7999                },
};

static const struct {
    const char *type;
    epicsUInt8 big[8];
    double value;
} reals[] = {
    {"REAL32", {0x00, 0x00, 0x00, 0x00},                         0.0                   },
    {"REAL32", {0x3F, 0x80, 0x00, 0x00},                         1.0                   },
    {"REAL32", {0xC0, 0x49, 0x0F, 0xDB},                         -3.1415927410125732   },
    {"REAL32", {0x7F, 0x7F, 0xFF, 0xFF},                         3.4028234663852886e38 },
    {"REAL32", {0x00, 0x00, 0x00, 0x01},                         1.401298464324817e-45 },
    {"REAL64", {0x3F, 0xF0, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00}, 1.0                   },
    {"REAL64", {0xC0, 0x09, 0x21, 0xFB, 0x54, 0x44, 0x2D, 0x18}, -3.141592653589793    },
    {"REAL64", {0x7F, 0xEF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF}, 1.7976931348623157e308},
    {"REAL64", {0x40, 0xC8, 0x1C, 0xD6, 0xE6, 0x31, 0xF8, 0xA1}, 12345.6789            },
};

static const char *const orderNames[] = {"little-endian", "big-endian"};

/* The bytes of an element in this order, at an odd address. */
static epicsUInt8 *arrange(epicsUInt8 *buffer, const epicsUInt8 *big, unsigned size,
                           int bigEndian)
{
    unsigned i;

    for (i = 0; i < size; i++)
        buffer[1 + i] = bigEndian ? big[i] : big[size - 1 - i];
    return buffer + 1;
}

static void testNoRoom(void)
{
    char text[6] = "x";

    plcTypeList(plcInteger, 8, text, 0);
    testOk(text[0] == 'x', "a list of types writes nothing where there is no room");
    plcTypeList(plcInteger, 8, text, sizeof(text));
    testOk(strcmp(text, "INT8") == 0, "and whole names only: %s", text);
}

static void testIntegers(int bigEndian)
{
    size_t i;

    for (i = 0; i < sizeof(integers) / sizeof(integers[0]); i++) {
        const plcType *type = find(integers[i].type);
        epicsUInt8 buffer[10], written[10];
        const epicsUInt8 *bytes = arrange(buffer, integers[i].big, type->size, bigEndian);
        epicsInt64 value = plcGetInt(type, bytes, bigEndian);

        testOk(value == integers[i].value, "%s reads %lld, %s", type->name,
               (long long)value, orderNames[bigEndian]);
        memset(written, 0xA5, sizeof(written));
        plcPutInt(type, written + 1, bigEndian, integers[i].value);
        testOk(memcmp(written + 1, bytes, type->size) == 0 && written[0] == 0xA5 &&
                   written[1 + type->size] == 0xA5,
               "%s writes %lld into its %u bytes only, %s", type->name,
               (long long)integers[i].value, type->size, orderNames[bigEndian]);
    }
}

static void testReals(int bigEndian)
{
    size_t i;

    for (i = 0; i < sizeof(reals) / sizeof(reals[0]); i++) {
        const plcType *type = find(reals[i].type);
        epicsUInt8 buffer[10], written[10];
        const epicsUInt8 *bytes = arrange(buffer, reals[i].big, type->size, bigEndian);
        double value = plcGetReal(type, bytes, bigEndian);

        testOk(value == reals[i].value, "%s reads %.17g, %s", type->name, value,
               orderNames[bigEndian]);
        memset(written, 0xA5, sizeof(written));
        plcPutReal(type, written + 1, bigEndian, reals[i].value);
        testOk(memcmp(written + 1, bytes, type->size) == 0 && written[0] == 0xA5 &&
                   written[1 + type->size] == 0xA5,
               "%s writes %.17g into its %u bytes only, %s", type->name, reals[i].value,
               type->size, orderNames[bigEndian]);
    }
}

static const struct {
    const char *type;
    epicsInt64 value, read;
} overflows[] = {
    {"INT8",   300,          44           },
    {"UINT8",  -1,           255          },
    {"INT16",  40000,        -25536       },
    {"UINT16", 65537,        1            },
    {"INT32",  2147483648LL, -2147483648LL},
    {"UINT32", -1,           4294967295LL },
    {"BCD16",  10000,        9999         },
    {"BCD16",  -1,           0            },
    {"BCD32",  1234567890,   99999999     },
    {"SM16",   40000,        32767        },
    {"SM16",   -32768,       -32767       },
    {"SBCD16", 8000,         7999         },
    {"SBCD16", -8000,        -7999        },
};

static void testOverflows(void)
{
    size_t i;

    for (i = 0; i < sizeof(overflows) / sizeof(overflows[0]); i++) {
        const plcType *type = find(overflows[i].type);
        epicsUInt8 bytes[8];

        plcPutInt(type, bytes, 1, overflows[i].value);
        testOk(plcGetInt(type, bytes, 1) == overflows[i].read,
               "%lld into %s is cut to %lld", (long long)overflows[i].value, type->name,
               (long long)overflows[i].read);
    }
}

static void testSpecialReals(void)
{
    static const epicsUInt8 inf[] = {0x7F, 0x80, 0, 0}, minusInf[] = {0xFF, 0x80, 0, 0};
    static const epicsUInt8 nan[] = {0x7F, 0xC0, 0, 0};
    const plcType *real32 = find("REAL32"), *real64 = find("REAL64");
    epicsUInt8 bytes[8];

    plcPutReal(real32, bytes, 1, 1e39);
    testOk(memcmp(bytes, inf, 4) == 0, "1e39 into REAL32 is infinite");
    plcPutReal(real32, bytes, 1, -1e39);
    testOk(memcmp(bytes, minusInf, 4) == 0, "-1e39 into REAL32 is minus infinite");
    testOk(plcGetReal(real32, minusInf, 1) == -epicsINF, "REAL32 reads minus infinity");
    testOk(isnan(plcGetReal(real32, nan, 1)), "REAL32 reads NaN");
    plcPutReal(real64, bytes, 1, epicsNAN);
    testOk(isnan(plcGetReal(real64, bytes, 1)), "REAL64 carries NaN");
}

/* An element in the order of this machine, as the compiler sees it. */
static epicsUInt64 nativeValue(const void *element, unsigned size)
{
    union {
        epicsUInt8 u8;
        epicsUInt16 u16;
        epicsUInt32 u32;
        epicsUInt64 u64;
    } any;

    memcpy(&any, element, size);
    return size == 1 ? any.u8 : size == 2 ? any.u16 : size == 4 ? any.u32 : any.u64;
}

/* The order of this machine. */
static int nativeOrder(void)
{
    const epicsUInt16 one = 1;

    return *(const epicsUInt8 *)&one ? plcLittleEndian : plcBigEndian;
}

static const epicsUInt8 wire[] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16};

/* The bytes of `wire` as elements. The first and the last of them, written out. */
static const struct {
    unsigned size;
    epicsUInt64 first[2], last[2]; /* little-endian, big-endian */
} copies[] = {
    {1, {0x01, 0x01},                          {0x10, 0x10}            },
    {2, {0x0201, 0x0102},                      {0x100F, 0x0F10}        },
    {4, {0x04030201, 0x01020304},              {0x100F0E0D, 0x0D0E0F10}},
    {8,
     {0x0807060504030201, 0x0102030405060708},
     {0x100F0E0D0C0B0A09, 0x090A0B0C0D0E0F10}                          },
};

static void testCopies(int bigEndian)
{
    unsigned i;

    for (i = 0; i < sizeof(copies) / sizeof(copies[0]); i++) {
        unsigned size = copies[i].size, n = sizeof(wire) / size;
        epicsUInt8 there[18], back[16];

        memset(there, 0xA5, sizeof(there));
        plcCopyElements(there + 1, wire, size, n, bigEndian);
        testOk(nativeValue(there + 1, size) == copies[i].first[bigEndian] &&
                   nativeValue(there + 17 - size, size) == copies[i].last[bigEndian] &&
                   there[0] == 0xA5 && there[17] == 0xA5,
               "%u elements of %u bytes are copied, %s", n, size, orderNames[bigEndian]);
        plcCopyElements(back, there + 1, size, n, bigEndian);
        testOk(memcmp(back, wire, sizeof(wire)) == 0,
               "and the same function brings them back");
    }
    plcCopyElements(NULL, NULL, 2, 0, bigEndian);
    testPass("no elements need no memory");
}

/* All four orders, byte by byte: 0x0A0B0C0D and so on; the reals are made of such bytes. */
static const struct {
    const char *type;
    epicsInt64 value;   /* of integers */
    double real;        /* of reals */
    epicsUInt8 bytes[4][8]; /* by order */
} wordOrders[] = {
    {"INT8", -0x76, 0, {{0x8A}, {0x8A}, {0x8A}, {0x8A}}},
    {"UINT8", 0x8A, 0, {{0x8A}, {0x8A}, {0x8A}, {0x8A}}},
    {"INT16", -0x75F5, 0, {{0x0B, 0x8A}, {0x8A, 0x0B}, {0x0B, 0x8A}, {0x8A, 0x0B}}},
    {"UINT16", 0x8A0B, 0, {{0x0B, 0x8A}, {0x8A, 0x0B}, {0x0B, 0x8A}, {0x8A, 0x0B}}},
    {"INT32",
     -0x75F4F3F3LL,
     0,
     {{0x0D, 0x0C, 0x0B, 0x8A},
      {0x8A, 0x0B, 0x0C, 0x0D},
      {0x0B, 0x8A, 0x0D, 0x0C},
      {0x0C, 0x0D, 0x8A, 0x0B}}},
    {"UINT32",
     0x8A0B0C0DLL,
     0,
     {{0x0D, 0x0C, 0x0B, 0x8A},
      {0x8A, 0x0B, 0x0C, 0x0D},
      {0x0B, 0x8A, 0x0D, 0x0C},
      {0x0C, 0x0D, 0x8A, 0x0B}}},
    {"INT64",
     0x0A0B0C0D0E0F1011LL,
     0,
     {{0x11, 0x10, 0x0F, 0x0E, 0x0D, 0x0C, 0x0B, 0x0A},
      {0x0A, 0x0B, 0x0C, 0x0D, 0x0E, 0x0F, 0x10, 0x11},
      {0x0B, 0x0A, 0x0D, 0x0C, 0x0F, 0x0E, 0x11, 0x10},
      {0x10, 0x11, 0x0E, 0x0F, 0x0C, 0x0D, 0x0A, 0x0B}}},
    {"UINT64",
     -0x75F4F3F2F1F0EFEFLL,
     0,
     {{0x11, 0x10, 0x0F, 0x0E, 0x0D, 0x0C, 0x0B, 0x8A},
      {0x8A, 0x0B, 0x0C, 0x0D, 0x0E, 0x0F, 0x10, 0x11},
      {0x0B, 0x8A, 0x0D, 0x0C, 0x0F, 0x0E, 0x11, 0x10},
      {0x10, 0x11, 0x0E, 0x0F, 0x0C, 0x0D, 0x8A, 0x0B}}},
    {"REAL32",
     0,
     -3.1415927410125732,
     {{0xDB, 0x0F, 0x49, 0xC0},
      {0xC0, 0x49, 0x0F, 0xDB},
      {0x49, 0xC0, 0xDB, 0x0F},
      {0x0F, 0xDB, 0xC0, 0x49}}},
    {"REAL64",
     0,
     12345.6789,
     {{0xA1, 0xF8, 0x31, 0xE6, 0xD6, 0x1C, 0xC8, 0x40},
      {0x40, 0xC8, 0x1C, 0xD6, 0xE6, 0x31, 0xF8, 0xA1},
      {0xC8, 0x40, 0xD6, 0x1C, 0x31, 0xE6, 0xA1, 0xF8},
      {0xF8, 0xA1, 0xE6, 0x31, 0x1C, 0xD6, 0x40, 0xC8}}},
};

#define WORD_ORDERS (sizeof(wordOrders) / sizeof(wordOrders[0]))

static void testWordOrders(int order)
{
    size_t i, k;

    for (i = 0; i < WORD_ORDERS; i++) {
        const plcType *type = find(wordOrders[i].type);
        const epicsUInt8 *bytes = wordOrders[i].bytes[order];
        int real = type->kind == plcReal;
        epicsUInt8 written[9], many[24], there[24], back[24];

        testOk(real ? plcGetReal(type, bytes, order) == wordOrders[i].real
                    : plcGetInt(type, bytes, order) == wordOrders[i].value,
               "%s is read, order %d", type->name, order);
        memset(written, 0xA5, sizeof(written));
        if (real)
            plcPutReal(type, written, order, wordOrders[i].real);
        else
            plcPutInt(type, written, order, wordOrders[i].value);
        testOk(memcmp(written, bytes, type->size) == 0 && written[type->size] == 0xA5,
               "and written");
        for (k = 0; k < 3; k++)
            memcpy(many + k * type->size, bytes, type->size);
        plcCopyElements(there, many, type->size, 3, order);
        plcCopyElements(back, there, type->size, 3, order);
        for (k = 0; k < 3; k++)
            if (nativeValue(there + k * type->size, type->size) !=
                nativeValue(wordOrders[i].bytes[nativeOrder()], type->size))
                break;
        testOk(k == 3 && memcmp(back, many, 3 * type->size) == 0,
               "and three of them are copied in both directions");
    }
}

static void testOrders(void)
{
    testOk(plcOrder(1, 1) == plcBigEndian && plcOrder(0, 0) == plcLittleEndian,
           "words as bytes are the usual orders");
    testOk(plcOrder(1, 0) == (plcBigEndian | plcWordsSwapped) &&
               plcOrder(0, 1) == (plcLittleEndian | plcWordsSwapped),
           "else the words are swapped");
}

static const struct {
    epicsUInt8 bcd, value;
} bcds[] = {
    {0x00, 0 },
    {0x09, 9 },
    {0x10, 10},
    {0x59, 59},
    {0x99, 99}
};

static const struct {
    const char *type;
    epicsUInt8 bytes[4];
    const char *text; /* "": all digits are some */
} digits[] = {
    {"BCD16", {0x99, 0x99}, ""},
    {"BCD16", {0x1A, 0x2F}, "0x1A2F is no BCD number"},
    {"BCD16", {0xF0, 0x00}, "0xF000 is no BCD number"},
    {"BCD16", {0x00, 0x0A}, "0x000A is no BCD number"},
    {"BCD32", {0x12, 0x34, 0x56, 0x78}, ""},
    {"BCD32", {0x12, 0x34, 0xB6, 0x78}, "0x1234B678 is no BCD number"},
    {"SBCD16", {0xF9, 0x99}, ""},
    {"SBCD16", {0x9A, 0x00}, "0x9A00 is no BCD number"},
    {"TIME", {0x59, 0x00, 0x99, 0x12}, ""},
    {"TIME", {0x59, 0x00, 0xFF, 0x12}, "byte 2 is 0xFF: no BCD"},
    {"SM16", {0xFF, 0xFF}, ""},
    {"UINT16", {0xFF, 0xFF}, ""},
    {"REAL32", {0xFF, 0xFF, 0xFF, 0xFF}, ""},
};

static void testDigits(void)
{
    size_t i;

    for (i = 0; i < sizeof(digits) / sizeof(digits[0]); i++) {
        const plcType *type = plcTypeFind(digits[i].type, strlen(digits[i].type));
        size_t length = type->kind == plcBcd ? 4 : type->size;
        char text[PLC_WRONG_SIZE] = "";
        int wrong = plcIsWrong(type, digits[i].bytes, length, plcBigEndian, text);

        testOk(wrong == !!digits[i].text[0] && strcmp(text, digits[i].text) == 0, "%s %s",
               digits[i].type, wrong ? text : "has digits");
    }
}

static void testBcd(void)
{
    static const epicsUInt8 date[] = {0x26, 0x11, 0x23, 0x14, 0x25, 0x59, 0x98, 0x72};
    static const epicsUInt8 plain[] = {26, 11, 23, 14, 25, 59, 98, 72};
    epicsUInt8 out[8], in;
    size_t i;

    for (i = 0; i < sizeof(bcds) / sizeof(bcds[0]); i++) {
        plcBcdDecode(out, &bcds[i].bcd, 1);
        testOk(out[0] == bcds[i].value, "BCD 0x%02X is %d", bcds[i].bcd, bcds[i].value);
        plcBcdEncode(out, &bcds[i].value, 1);
        testOk(out[0] == bcds[i].bcd, "%d is BCD 0x%02X", bcds[i].value, bcds[i].bcd);
    }
    plcBcdDecode(out, date, 8);
    testOk(memcmp(out, plain, 8) == 0, "a DATE_AND_TIME is decoded byte by byte");
    plcBcdEncode(out, plain, 8);
    testOk(memcmp(out, date, 8) == 0, "and encoded again");
    in = 0xFF;
    plcBcdDecode(out, &in, 1);
    testOk(out[0] == 165, "BCD 0xFF, which has no digits, gives 165");
    in = 123;
    plcBcdEncode(out, &in, 1);
    testOk(out[0] == 0x23, "123 is written as BCD 0x23");
}

/* Texts: what stands in the bytes, and the bytes that a text makes. */
static const struct {
    const char *title, *type;
    size_t length;
    const char *bytes, *text;
} texts[] = {
    {"STRING ends at the first NUL", "STRING", 4, "ab\0d", "ab"},
    {"STRING without NUL", "STRING", 2, "abcd", "ab"},
    {"S7STRING ends as its second byte says", "S7STRING", 6, "\4\2abcd", "ab"},
    {"S7STRING that is full", "S7STRING", 6, "\4\4abcd", "abcd"},
    {"S7STRING that is empty", "S7STRING", 6, "\4\0abcd", ""},
    {"S7STRING ends at a NUL too", "S7STRING", 6, "\4\4a\0cd", "a"},
    {"S7STRING whose length is nonsense", "S7STRING", 6, "\4\xff""abcd", "abcd"},
    {"S7STRING that was never filled", "S7STRING", 6, "\0\0\0\0\0\0", ""},
    {"S7STRING of one character", "S7STRING", 3, "\1\1x", "x"},
};

static const struct {
    const char *title, *type;
    size_t length;
    const char *text, *bytes;
} written[] = {
    {"STRING is filled up", "STRING", 4, "ab", "ab\0\0#"},
    {"STRING is cut off", "STRING", 2, "abcd", "ab#"},
    {"S7STRING has two lengths in front", "S7STRING", 6, "ab", "\4\2ab\0\0#"},
    {"S7STRING that is full", "S7STRING", 6, "abcd", "\4\4abcd#"},
    {"S7STRING is cut off", "S7STRING", 5, "abcd", "\3\3abc#"},
    {"S7STRING of nothing", "S7STRING", 4, "", "\2\0\0\0#"},
};

/* The same texts in each order; the other way the bytes are made of the text. */
static const struct {
    const char *title, *type;
    int order;
    size_t length;
    const char *bytes, *text;
} ordered[] = {
    {"ABCD", "STRING", plcTextABCD, 8, "ABCDEFGH", "ABCDEFGH"},
    {"BADC", "STRING", plcTextBADC, 8, "BADCFEHG", "ABCDEFGH"},
    {"CDAB", "STRING", plcTextCDAB, 8, "CDABGHEF", "ABCDEFGH"},
    {"DCBA", "STRING", plcTextDCBA, 8, "DCBAHGFE", "ABCDEFGH"},
    {"A0", "STRING", plcTextA0, 8, "A\0B\0C\0D\0", "ABCD"},
    {"0A", "STRING", plcText0A, 8, "\0A\0B\0C\0D", "ABCD"},
    {"BADC that ends within a register", "STRING", plcTextBADC, 6, "BA\0C\0\0", "ABC"},
    {"CDAB that ends within its first word", "STRING", plcTextCDAB, 8, "\0\0A\0\0\0\0\0", "A"},
    {"DCBA that ends within its words", "STRING", plcTextDCBA, 8, "DCBA\0\0\0E", "ABCDE"},
    {"A0 that ends", "STRING", plcTextA0, 6, "A\0B\0\0\0", "AB"},
    {"0A that is empty", "STRING", plcText0A, 4, "\0\0\0\0", ""},
    {"S7STRING in BADC, with its head", "S7STRING", plcTextBADC, 6, "\2\4BA\0\0", "AB"},
    {"S7STRING in CDAB", "S7STRING", plcTextCDAB, 8, "AB\6\3\0\0C\0", "ABC"},
    {"S7STRING in DCBA", "S7STRING", plcTextDCBA, 8, "BA\3\6\0\0\0C", "ABC"},
    {"S7STRING in 0A: a WSTRING", "S7STRING", plcText0A, 10, "\0\3\0\2\0A\0B\0\0", "AB"},
};

static void testTexts(void)
{
    char text[20], bytes[20];
    size_t i, chars;

    for (i = 0; i < sizeof(texts) / sizeof(texts[0]); i++) {
        chars = plcGetText(find(texts[i].type), texts[i].bytes, texts[i].length, plcTextABCD, text,
                           sizeof(text));
        testOk(chars == strlen(texts[i].text) && memcmp(text, texts[i].text, chars) == 0,
               "%s: \"%.*s\"", texts[i].title, (int)chars, text);
    }
    for (i = 0; i < sizeof(written) / sizeof(written[0]); i++) {
        memset(bytes, '#', sizeof(bytes));
        plcPutText(find(written[i].type), bytes, written[i].length, plcTextABCD, written[i].text,
                   strlen(written[i].text));
        testOk(memcmp(bytes, written[i].bytes, written[i].length + 1) == 0,
               "%s, nothing behind it is touched", written[i].title);
    }
}

static void testTextOrders(void)
{
    static const char *const names[] = {"ABCD", "BADC", "CDAB", "DCBA", "A0", "0A"};
    char text[20], bytes[20], all[20], back[20];
    size_t i, chars, length;
    int order;

    for (i = 0; i < sizeof(ordered) / sizeof(ordered[0]); i++) {
        const plcType *type = find(ordered[i].type);

        order = ordered[i].order;
        length = ordered[i].length;
        memset(text, '#', sizeof(text));
        chars = plcGetText(type, ordered[i].bytes, length, order, text, sizeof(text));
        testOk(chars == strlen(ordered[i].text) && memcmp(text, ordered[i].text, chars) == 0 &&
                   text[chars] != 'Z',
               "%s: \"%.*s\"", ordered[i].title, (int)chars, text);
        memset(bytes, '#', sizeof(bytes));
        plcPutText(type, bytes, length, order, text, chars);
        testOk(memcmp(bytes, ordered[i].bytes, length) == 0 && bytes[length] == '#',
               "%s: the bytes are made", ordered[i].title);
        chars = plcGetText(type, ordered[i].bytes, length, order, text, 1);
        testOk(chars == (ordered[i].text[0] != 0) && (!chars || text[0] == ordered[i].text[0]),
               "%s: not more than there is room for", ordered[i].title);
    }
    for (order = plcTextABCD; order <= plcText0A; order++) {
        testOk(strcmp(plcTextOrderName(order), names[order]) == 0, "the name of W=%s", names[order]);
        length = plcTextBytes(order, 8);
        for (i = 0; i < sizeof(all); i++)
            all[i] = (char)('a' + i % 3);
        all[3] = 0;
        memset(bytes, '#', sizeof(bytes));
        memset(back, '#', sizeof(back));
        plcTextToBytes(bytes, all, length, order);
        plcTextFromBytes(back, bytes, length, order);
        testOk(length % plcTextUnit(order) == 0 && memcmp(all, back, 8) == 0 && back[8] == '#' &&
                   bytes[length] == '#',
               "W=%s: all of %u bytes there and back", plcTextOrderName(order), (unsigned)length);
    }
}

MAIN(codecTest)
{
    int order;

    testPlan(48 + 1 + 36 + 9 + 15 + 4 * 37 + 4 * 9 + 13 + 5 + 2 * 9 +
             4 * 3 * (int)WORD_ORDERS + 2 + 2 + 14 +
             3 * (int)(sizeof(ordered) / sizeof(ordered[0])) + 12 + 13);
    testDiag("Names");
    testNames();
    testDiag("Table");
    testTypes();
    testLists();
    testNoRoom();
    testDiag("Bytes");
    testIntegers(0);
    testIntegers(1);
    testReals(0);
    testReals(1);
    testOverflows();
    testSpecialReals();
    testCopies(0);
    testCopies(1);
    testDiag("The order of words");
    for (order = 0; order < 4; order++)
        testWordOrders(order);
    testOrders();
    testDiag("BCD");
    testBcd();
    testDigits();
    testDiag("Texts");
    testTexts();
    testTextOrders();
    return testDone();
}
