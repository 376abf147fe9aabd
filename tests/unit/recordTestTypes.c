/* Every data type on every record type, in both byte orders: the literal bytes it reads
 * or writes, or the refusal.
 */
#include <stdio.h>
#include <string.h>

#include <epicsStdio.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "recordTest.h"

#define SLOT 16 /* bytes of the block for one record */

/* The bytes of a type, most and least significant first, and what the records make of
 * them. `number` is the value that output records write, too. */
static const struct {
    const char *type;
    const char *msb, *lsb;
    const char *number;  /* of ai, ao, calcout, int64in, int64out */
    const char *longin;  /* 32 bits only */
    const char *lowBits; /* the lower four, of mbbi */
} types[] = {
    {"INT8", "83", "83", "-125", "-125", "3"},
    {"UINT8", "83", "83", "131", "131", "3"},
    {"INT16", "8102", "0281", "-32510", "-32510", "2"},
    {"UINT16", "8102", "0281", "33026", "33026", "2"},
    {"INT32", "81020304", "04030281", "-2130574588", "-2130574588", "4"},
    {"UINT32", "81020304", "04030281", "2164392708", "-2130574588", "4"},
    {"INT64", "8102030405060708", "0807060504030281", "-9150748177064392952", "", ""},
    {"UINT64", "0102030405060709", "0907060504030201", "72623859790382857", "", ""},
    {"REAL32", "c0490000", "000049c0", "-3.140625", "", ""},
    {"REAL64", "c009200000000000", "00000000002009c0", "-3.140625", "", ""},
    {"STRING", "48656c6c6f000000", "48656c6c6f000000", "Hello", "", ""},
    {"TIME", "2613590000000000", "2613590000000000", "", "", ""},
};

/* y: allowed, in the order of `types`. */
static const struct {
    const char *record;
    const char *allowed;
    const char *fields;
} records[] = {
    /*              INT8-32  64 REALs S T */
    {"ai",         "yyyyyy" "--" "yy" "--", ""},
    {"ao",         "yyyyyy" "--" "yy" "--", ""},
    {"calcout",    "yyyyyy" "--" "yy" "--", "|CALC=A"},
    {"bi",         "yyyyyy" "yy" "--" "--", ""},
    {"bo",         "yyyyyy" "yy" "--" "--", ""},
    {"mbbi",       "yyyyyy" "--" "--" "--", "|NOBT=4"},
    {"mbbo",       "yyyyyy" "--" "--" "--", "|NOBT=4"},
    {"mbbiDirect", "yyyyyy" "--" "--" "--", "|NOBT=4"},
    {"mbboDirect", "yyyyyy" "--" "--" "--", "|NOBT=4"},
    {"longin",     "yyyyyy" "--" "--" "--", ""},
    {"longout",    "yyyyyy" "--" "--" "--", ""},
    {"int64in",    "yyyyyy" "yy" "--" "--", ""},
    {"int64out",   "yyyyyy" "yy" "--" "--", ""},
    {"stringin",   "------" "--" "--" "y-", ""},
    {"stringout",  "------" "--" "--" "y-", ""},
    {"lsi",        "------" "--" "--" "y-", "|SIZV=40"},
    {"lso",        "------" "--" "--" "y-", "|SIZV=40"},
};

/* Arrays of two elements (of eight, T=STRING and TIME). */
static const struct {
    const char *ftvl;
    const char *allowed;
} arrays[] = {
    /*       8    16   32   64   REALs S T */
    {"CHAR",   "yy" "--" "--" "--" "--" "yy"},
    {"UCHAR",  "yy" "--" "--" "--" "--" "yy"},
    {"SHORT",  "--" "yy" "--" "--" "--" "--"},
    {"USHORT", "--" "yy" "--" "--" "--" "--"},
    {"LONG",   "--" "--" "yy" "--" "--" "--"},
    {"ULONG",  "--" "--" "yy" "--" "--" "--"},
    {"INT64",  "--" "--" "--" "yy" "--" "--"},
    {"UINT64", "--" "--" "--" "yy" "--" "--"},
    {"FLOAT",  "--" "--" "--" "--" "y-" "--"},
    {"DOUBLE", "--" "--" "--" "--" "-y" "--"},
    {"STRING", "--" "--" "--" "--" "--" "--"},
};
static const char *const arrayRecords[] = {"waveform", "aai", "aao"};

#define TYPES COUNT(types)
#define RECORDS COUNT(records)
#define ARRAYS COUNT(arrays)
#define SLOTS ((RECORDS + COUNT(arrayRecords) * ARRAYS) * TYPES)
#define BLOCK (SLOTS * SLOT + 24) /* strings at the end have 40 bytes */

static const char *const orders[] = {"least", "most"};

static const char *pvName(const char *record, const char *ftvl, size_t type, int big)
{
    static char name[60];

    epicsSnprintf(name, sizeof(name), "%s%s:%s:%d", record, ftvl, types[type].type, big);
    return name;
}

static void makeOne(const char *record, const char *ftvl, size_t type, int big,
                    size_t slot, const char *fields)
{
    char text[200];

    epicsSnprintf(text, sizeof(text), "%s=@%s/%lu T=%s%s", linkField(record),
                  orders[big], (unsigned long)(slot * SLOT), types[type].type, fields);
    makeRecord(record, pvName(record, ftvl, type, big), text);
}

static void fillSlot(epicsUInt8 *block, size_t slot, size_t type, int big)
{
    unhex(big ? types[type].msb : types[type].lsb, block + slot * SLOT);
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

static void checkInput(const char *record, size_t type, int big)
{
    const char *pv = pvName(record, "", type, big);
    char title[120], field[80];

    epicsSnprintf(title, sizeof(title), "%s reads %s, %s significant byte first", record,
                  types[type].type, orders[big]);
    epicsSnprintf(field, sizeof(field), "%s.PROC", pv);
    put(field, "1");
    epicsSnprintf(field, sizeof(field), "%s.VAL", pv);
    isValue(field, expected(record, type), title);
}

/* Bits are written as 1 or 3 into zeros: only the lowest byte shows them. */
static void checkOutput(plcStation *station, const char *record, size_t type, int big,
                        size_t slot)
{
    const char *pv = pvName(record, "", type, big);
    const char *bytes = big ? types[type].msb : types[type].lsb;
    int bits = record[0] == 'b' || record[0] == 'm';
    char title[120], field[80], zeros[2 * SLOT + 1];

    epicsSnprintf(title, sizeof(title), "%s writes %s, %s significant byte first", record,
                  types[type].type, orders[big]);
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
    zeros[big ? strlen(bytes) - 1 : 1] = '1';
    isOutput(station, slot * SLOT, zeros, title);
}

static void checkScalar(plcStation *station, size_t r, size_t type, int big)
{
    const char *record = records[r].record;
    char title[120];

    if (records[r].allowed[type] != 'y') {
        epicsSnprintf(title, sizeof(title), "%s refuses %s", record, types[type].type);
        checkRefused(pvName(record, "", type, big), title);
    } else if (strcmp(linkField(record), "INP") == 0) {
        checkInput(record, type, big);
    } else {
        checkOutput(station, record, type, big, r * TYPES + type);
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
                       int big, size_t slot)
{
    const char *pv = pvName(record, arrays[a].ftvl, type, big);
    int in = strcmp(linkField(record), "INP") == 0;
    char title[140], field[80];

    if (arrays[a].allowed[type] != 'y') {
        epicsSnprintf(title, sizeof(title), "%s FTVL=%s refuses %s", record,
                      arrays[a].ftvl, types[type].type);
        checkRefused(pv, title);
        return;
    }
    epicsSnprintf(title, sizeof(title), "%s FTVL=%s %s %s, %s significant byte first",
                  record, arrays[a].ftvl, in ? "reads" : "writes", types[type].type,
                  orders[big]);
    if (in) {
        epicsSnprintf(field, sizeof(field), "%s.PROC", pv);
        put(field, "1");
        epicsSnprintf(field, sizeof(field), "%s.VAL", pv);
        isValue(field, arrayText(type, arrays[a].ftvl), title);
        return;
    }
    epicsSnprintf(field, sizeof(field), "%s.VAL", pv);
    put(field, arrayText(type, arrays[a].ftvl));
    isOutput(station, slot * SLOT, big ? types[type].msb : types[type].lsb, title);
}

/* Visits all records of one byte order: makes them, or checks them. */
static void visit(plcStation *station, int big, epicsUInt8 *block)
{
    size_t r, a, type, slot = 0;
    char fields[60];

    for (r = 0; r < RECORDS; r++) {
        for (type = 0; type < TYPES; type++, slot++) {
            if (!block) {
                checkScalar(station, r, type, big);
                continue;
            }
            makeOne(records[r].record, "", type, big, slot, records[r].fields);
            fillSlot(block, slot, type, big);
        }
    }
    for (r = 0; r < COUNT(arrayRecords); r++) {
        for (a = 0; a < ARRAYS; a++) {
            for (type = 0; type < TYPES; type++, slot++) {
                if (!block) {
                    checkArray(station, arrayRecords[r], a, type, big, slot);
                    continue;
                }
                epicsSnprintf(fields, sizeof(fields), "|FTVL=%s|NELM=%d", arrays[a].ftvl,
                              type >= 10 ? 8 : 2);
                makeOne(arrayRecords[r], arrays[a].ftvl, type, big, slot, fields);
                fillSlot(block, slot, type, big);
            }
        }
    }
}

MAIN(recordTestTypes)
{
    static epicsUInt8 blocks[2][BLOCK];
    plcStation *stations[2];
    int big;

    testPlan(2 * SLOTS);
    iocBegin();
    for (big = 0; big < 2; big++) {
        stations[big] = makeStation(orders[big], big, BLOCK, BLOCK);
        visit(stations[big], big, blocks[big]);
    }
    iocRunOk();
    for (big = 0; big < 2; big++) {
        publish(stations[big], blocks[big], 1);
        visit(stations[big], big, NULL);
    }
    iocEnd();
    return testDone();
}
