/* Every data type on every record type, in all four orders of bytes and words: the literal
 * bytes it reads or writes, or the refusal.
 */
#include <stdio.h>
#include <string.h>

#include <epicsStdio.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "recordTest.h"

#define SLOT 16 /* bytes of the block for one record */

/* The orders of plcCodec.h, each by another way: a station without and with the option
 * wordOrder, and links with W=. */
static const struct {
    const char *station; /* its name */
    int bigEndian;
    const char *wordOrder;
    const char *link;
    const char *title;
} orders[] = {
    {"least", 0, "bytes", "", "least significant byte first"},
    {"most", 1, "bytes", "", "most significant byte first"},
    {"leastInWord", 0, "high", "", "high word first, its least significant byte first"},
    {"mostInWord", 1, "bytes", " W=low", "low word first, its most significant byte first"},
};

#define ORDERS COUNT(orders)

/* The bytes of a type in these orders, and what the records make of them. `number` is the
 * value that output records write, too. */
static const struct {
    const char *type;
    const char *bytes[ORDERS];
    const char *number;  /* of ai, ao, calcout, int64in, int64out */
    const char *longin;  /* 32 bits only */
    const char *lowBits; /* the lower four, of mbbi */
} types[] = {
    {"INT8", {"83", "83", "83", "83"}, "-125", "-125", "3"},
    {"UINT8", {"83", "83", "83", "83"}, "131", "131", "3"},
    {"INT16", {"0281", "8102", "0281", "8102"}, "-32510", "-32510", "2"},
    {"UINT16", {"0281", "8102", "0281", "8102"}, "33026", "33026", "2"},
    {"INT32", {"04030281", "81020304", "02810403", "03048102"}, "-2130574588",
     "-2130574588", "4"},
    {"UINT32", {"04030281", "81020304", "02810403", "03048102"}, "2164392708",
     "-2130574588", "4"},
    {"INT64",
     {"0807060504030281", "8102030405060708", "0281040306050807", "0708050603048102"},
     "-9150748177064392952", "", ""},
    {"UINT64",
     {"0907060504030201", "0102030405060709", "0201040306050907", "0709050603040102"},
     "72623859790382857", "", ""},
    {"REAL32", {"000049c0", "c0490000", "49c00000", "0000c049"}, "-3.140625", "", ""},
    {"REAL64",
     {"00000000002009c0", "c009200000000000", "09c0002000000000", "000000002000c009"},
     "-3.140625", "", ""},
    {"STRING",
     {"48656c6c6f000000", "48656c6c6f000000", "48656c6c6f000000", "48656c6c6f000000"},
     "Hello", "", ""},
    {"TIME",
     {"2613590000000000", "2613590000000000", "2613590000000000", "2613590000000000"},
     "", "", ""},
    {"S7STRING",
     {"0603534f53000000", "0603534f53000000", "0603534f53000000", "0603534f53000000"},
     "SOS", "", ""},
    {"BCD16", {"0281", "8102", "0281", "8102"}, "8102", "8102", ""},
    {"BCD32", {"04030281", "81020304", "02810403", "03048102"}, "81020304", "81020304", ""},
    {"SM16", {"0281", "8102", "0281", "8102"}, "-258", "-258", ""},
    {"SBCD16", {"0281", "8102", "0281", "8102"}, "-102", "-102", ""},
};

/* y: allowed, in the order of `types`. */
static const struct {
    const char *record;
    const char *allowed;
    const char *fields;
} records[] = {
    /*              INT8-32  64 REALs S T S7, BCD16 BCD32 SM16 SBCD16 */
    {"ai",         "yyyyyy" "--" "yy" "---" "yyyy", ""},
    {"ao",         "yyyyyy" "--" "yy" "---" "yyyy", ""},
    {"calcout",    "yyyyyy" "--" "yy" "---" "yyyy", "|CALC=A"},
    {"bi",         "yyyyyy" "yy" "--" "---" "----", ""},
    {"bo",         "yyyyyy" "yy" "--" "---" "----", ""},
    {"mbbi",       "yyyyyy" "--" "--" "---" "----", "|NOBT=4"},
    {"mbbo",       "yyyyyy" "--" "--" "---" "----", "|NOBT=4"},
    {"mbbiDirect", "yyyyyy" "--" "--" "---" "----", "|NOBT=4"},
    {"mbboDirect", "yyyyyy" "--" "--" "---" "----", "|NOBT=4"},
    {"longin",     "yyyyyy" "--" "--" "---" "yyyy", ""},
    {"longout",    "yyyyyy" "--" "--" "---" "yyyy", ""},
    {"int64in",    "yyyyyy" "yy" "--" "---" "yyyy", ""},
    {"int64out",   "yyyyyy" "yy" "--" "---" "yyyy", ""},
    {"stringin",   "------" "--" "--" "y-y" "----", ""},
    {"stringout",  "------" "--" "--" "y-y" "----", ""},
    {"lsi",        "------" "--" "--" "y-y" "----", "|SIZV=40"},
    {"lso",        "------" "--" "--" "y-y" "----", "|SIZV=40"},
};

/* Arrays of two elements (of eight, texts and TIME). */
static const struct {
    const char *ftvl;
    const char *allowed;
} arrays[] = {
    /*       8    16   32   64   REALs S T S7, BCD16 ... */
    {"CHAR",   "yy" "--" "--" "--" "--" "yyy" "----"},
    {"UCHAR",  "yy" "--" "--" "--" "--" "yyy" "----"},
    {"SHORT",  "--" "yy" "--" "--" "--" "---" "----"},
    {"USHORT", "--" "yy" "--" "--" "--" "---" "----"},
    {"LONG",   "--" "--" "yy" "--" "--" "---" "----"},
    {"ULONG",  "--" "--" "yy" "--" "--" "---" "----"},
    {"INT64",  "--" "--" "--" "yy" "--" "---" "----"},
    {"UINT64", "--" "--" "--" "yy" "--" "---" "----"},
    {"FLOAT",  "--" "--" "--" "--" "y-" "---" "----"},
    {"DOUBLE", "--" "--" "--" "--" "-y" "---" "----"},
    {"STRING", "--" "--" "--" "--" "--" "---" "----"},
};
static const char *const arrayRecords[] = {"waveform", "aai", "aao"};

#define TYPES COUNT(types)
#define RECORDS COUNT(records)
#define ARRAYS COUNT(arrays)
#define SLOTS ((RECORDS + COUNT(arrayRecords) * ARRAYS) * TYPES)
#define BLOCK (SLOTS * SLOT + 24) /* strings at the end have 40 bytes */

static const char *pvName(const char *record, const char *ftvl, size_t type, int order)
{
    static char name[60];

    epicsSnprintf(name, sizeof(name), "%s%s:%s:%d", record, ftvl, types[type].type, order);
    return name;
}

static void makeOne(const char *record, const char *ftvl, size_t type, int order,
                    size_t slot, const char *fields)
{
    char text[200];

    epicsSnprintf(text, sizeof(text), "%s=@%s/%lu T=%s%s%s%s", linkField(record),
                  orders[order].station, (unsigned long)(slot * SLOT), types[type].type,
                  strcmp(types[type].type, "S7STRING") ? "" : " L=6",
                  orders[order].link, fields);
    makeRecord(record, pvName(record, ftvl, type, order), text);
}

static void fillSlot(epicsUInt8 *block, size_t slot, size_t type, int order)
{
    unhex(types[type].bytes[order], block + slot * SLOT);
}

/* What VAL of this record shows of the type's bytes. */
static const char *expected(const char *record, size_t type)
{
    if (strcmp(record, "longin") == 0)
        return types[type].longin;
    if (strcmp(record, "bi") == 0)
        return types[type].lowBits[0] == '3' || strcmp(types[type].type, "UINT64") == 0
                   ? "1" : "0";
    if (strncmp(record, "mbbi", 4) == 0)
        return types[type].lowBits;
    return types[type].number;
}

static void checkRefused(const char *pv, const char *title)
{
    char field[80];

    epicsSnprintf(field, sizeof(field), "%s.PROC", pv);
    put(field, "1");
    epicsSnprintf(field, sizeof(field), "%s.STAT", pv);
    isValue(field, "LINK", title);
}

static void checkInput(const char *record, size_t type, int order)
{
    const char *pv = pvName(record, "", type, order);
    char title[120], field[80];

    epicsSnprintf(title, sizeof(title), "%s reads %s, %s", record, types[type].type,
                  orders[order].title);
    epicsSnprintf(field, sizeof(field), "%s.PROC", pv);
    put(field, "1");
    epicsSnprintf(field, sizeof(field), "%s.VAL", pv);
    isValue(field, expected(record, type), title);
}

/* Where the least significant of `size` bytes stands. */
static size_t lowestByte(size_t size, int order)
{
    static const size_t places[][ORDERS] = {
        [1] = {0, 0, 0, 0}, [2] = {0, 1, 0, 1}, [4] = {0, 3, 2, 1}, [8] = {0, 7, 6, 1}};

    return places[size][order];
}

/* Bits are written as 1 or 3 into zeros: only the lowest byte shows them. */
static void checkOutput(plcStation *station, const char *record, size_t type, int order,
                        size_t slot)
{
    const char *pv = pvName(record, "", type, order);
    const char *bytes = types[type].bytes[order];
    int bits = record[0] == 'b' || record[0] == 'm';
    char title[120], field[80], zeros[2 * SLOT + 1];

    epicsSnprintf(title, sizeof(title), "%s writes %s, %s", record, types[type].type,
                  orders[order].title);
    epicsSnprintf(field, sizeof(field), "%s.%s", pv,
                  strcmp(record, "calcout") == 0 ? "A" : "VAL");
    put(field, bits ? "1" : strcmp(record, "longout") ? types[type].number
                                                      : types[type].longin);
    if (!bits) {
        isOutput(station, slot * SLOT, bytes, title);
        return;
    }
    memset(zeros, '0', sizeof(zeros));
    zeros[strlen(bytes)] = 0;
    zeros[2 * lowestByte(strlen(bytes) / 2, order) + 1] = '1';
    isOutput(station, slot * SLOT, zeros, title);
}

static void checkScalar(plcStation *station, size_t r, size_t type, int order)
{
    const char *record = records[r].record;
    char title[120];

    if (records[r].allowed[type] != 'y') {
        epicsSnprintf(title, sizeof(title), "%s refuses %s", record, types[type].type);
        checkRefused(pvName(record, "", type, order), title);
    } else if (strcmp(linkField(record), "INP") == 0) {
        checkInput(record, type, order);
    } else {
        checkOutput(station, record, type, order, r * TYPES + type);
    }
}

/* The first element of an array of integers or reals; a text or time as a whole. */
static const char *arrayText(size_t type, const char *ftvl)
{
    static char text[100];
    int other = (ftvl[0] == 'U') != (types[type].type[0] == 'U');

    if (strcmp(types[type].type, "STRING") == 0)
        return "72,101,108,108,111,0,0,0";
    if (strcmp(types[type].type, "TIME") == 0)
        return "26,13,59,0,0,0,0,0";
    if (strcmp(types[type].type, "S7STRING") == 0)
        return "83,79,83";
    /* T and FTVL differ in sign: the same bits, seen as FTVL */
    if (other)
        type += types[type].type[0] == 'U' ? -1 : 1;
    if (other && strstr(types[type].type, "INT64"))
        epicsSnprintf(text, sizeof(text), "%s,0", types[type].type[0] == 'U'
                          ? "9295995896645158664" : "72623859790382857");
    else
        epicsSnprintf(text, sizeof(text), "%s,0", types[type].number);
    return text;
}

static void checkArray(plcStation *station, const char *record, size_t a, size_t type,
                       int order, size_t slot)
{
    const char *pv = pvName(record, arrays[a].ftvl, type, order);
    int in = strcmp(linkField(record), "INP") == 0;
    char title[140], field[80];

    if (arrays[a].allowed[type] != 'y') {
        epicsSnprintf(title, sizeof(title), "%s FTVL=%s refuses %s", record,
                      arrays[a].ftvl, types[type].type);
        checkRefused(pv, title);
        return;
    }
    epicsSnprintf(title, sizeof(title), "%s FTVL=%s %s %s, %s", record, arrays[a].ftvl,
                  in ? "reads" : "writes", types[type].type, orders[order].title);
    if (in) {
        epicsSnprintf(field, sizeof(field), "%s.PROC", pv);
        put(field, "1");
        epicsSnprintf(field, sizeof(field), "%s.VAL", pv);
        isValue(field, arrayText(type, arrays[a].ftvl), title);
        return;
    }
    epicsSnprintf(field, sizeof(field), "%s.VAL", pv);
    put(field, arrayText(type, arrays[a].ftvl));
    isOutput(station, slot * SLOT, types[type].bytes[order], title);
}

/* Visits all records of one order: makes them, or checks them. */
static void visit(plcStation *station, int order, epicsUInt8 *block)
{
    size_t r, a, type, slot = 0;
    char fields[60];

    for (r = 0; r < RECORDS; r++) {
        for (type = 0; type < TYPES; type++, slot++) {
            if (!block) {
                checkScalar(station, r, type, order);
                continue;
            }
            makeOne(records[r].record, "", type, order, slot, records[r].fields);
            fillSlot(block, slot, type, order);
        }
    }
    for (r = 0; r < COUNT(arrayRecords); r++) {
        for (a = 0; a < ARRAYS; a++) {
            for (type = 0; type < TYPES; type++, slot++) {
                if (!block) {
                    checkArray(station, arrayRecords[r], a, type, order, slot);
                    continue;
                }
                epicsSnprintf(fields, sizeof(fields), "|FTVL=%s|NELM=%d", arrays[a].ftvl,
                              type >= 10 && type <= 12 ? 8 : 2);
                makeOne(arrayRecords[r], arrays[a].ftvl, type, order, slot, fields);
                fillSlot(block, slot, type, order);
            }
        }
    }
}

MAIN(recordTestTypes)
{
    static epicsUInt8 blocks[ORDERS][BLOCK];
    plcStation *stations[ORDERS];
    char error[200];
    int order;

    testPlan(ORDERS * SLOTS);
    iocBegin();
    for (order = 0; order < (int)ORDERS; order++) {
        stations[order] =
            makeStation(orders[order].station, orders[order].bigEndian, BLOCK, BLOCK);
        if (plcStationSetOption(stations[order], "wordOrder", orders[order].wordOrder,
                                error, sizeof(error)))
            testAbort("%s", error);
        visit(stations[order], order, blocks[order]);
    }
    iocRunOk();
    for (order = 0; order < (int)ORDERS; order++) {
        publish(stations[order], blocks[order], 1);
        visit(stations[order], order, NULL);
    }
    iocEnd();
    return testDone();
}
