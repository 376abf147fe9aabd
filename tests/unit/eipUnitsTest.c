/* The tags of a PLC without a network: what is rare. Tags that are refused by themselves, members of members
 * of elements, data that does not go into its place, names without a path. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <epicsString.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "eipLink.h"
#include "eipPlaces.h"
#include "eipTags.h"
#include "hexBytes.h"

#define COUNT(table) (sizeof(table) / sizeof(table[0]))

static void isBytes(const char *what, const eipWriter *w, const char *hex)
{
    epicsUInt8 wanted[600];
    size_t n = hexBytes(hex, wanted);

    testOk(!w->full && w->n == n && memcmp(w->start, wanted, n) == 0, "%s", what);
}

static eipAnswer answerOf(const char *hex, epicsUInt8 *bytes)
{
    eipAnswer a = {.data = bytes};

    a.length = hexBytes(hex, bytes);
    return a;
}

/* --- Tags --------------------------------------------------------------------------------- */

static eipWant want(const char *tag, epicsUInt32 index, eipPlaceKind kind, size_t place)
{
    return (eipWant){.tag = epicsStrDup(tag), .index = index, .count = 1, .kind = kind,
                     .period = 100, .place = place,
                     .room = kind == eipCell ? eipCellSize : eipPlaceHead + 8};
}

static void learn(eipTags *t, const char *base, const char *hex)
{
    epicsUInt8 bytes[200];
    eipAnswer a = answerOf(hex, bytes);
    unsigned i;

    for (i = 0; i < t->tagCount; i++)
        if (strcmp(t->tags[i].base, base) == 0)
            eipTagLearn(t, &t->tags[i], &a);
}

static void testLearning(void)
{
    eipWant *w = calloc(5, sizeof(*w));
    eipSymbol list = {.id = 9, .name = "c", .type = 0x2000 | eipDint, .dimension = {7, 0, 0}};
    eipTags t;

    w[0] = want("a", 0, eipCell, 16);
    w[1] = want("a", 0, eipCell, 0);
    w[2] = want("b", 0, eipCell, 32);
    w[3] = want("c", 0, eipCell, 48);
    w[4] = want("d.x", 0, eipCell, 64);
    eipTagsInit(&t);
    eipTagsSet(&t, w, 5);
    testOk(t.tagCount == 4 && t.wants[0].place == 0 && t.wants[1].place == 16,
           "two wishes for one element stand by their places");
    learn(&t, "a", "C0 00 00 00");
    testOk(t.tags[0].state == eipTagBad && strcmp(t.tags[0].reason, "PLC: type 00C0 is not known") == 0,
           "%s", t.tags[0].reason);
    learn(&t, "b", "C4 00 01 02 03");
    testOk(t.tags[1].state == eipTagBad &&
               strcmp(t.tags[1].reason, "PLC: answer without a value") == 0,
           "%s", t.tags[1].reason);
    learn(&t, "b", "D0 00");
    testOk(t.tags[1].state == eipTagBad, "a string without its length is none either");
    testOk(t.unknown == 2, "both are known to be bad, two are not known yet");
    testOk(eipTagsListed(&t, &list, NULL) == 1 && t.tags[2].elements == 7 && t.tags[2].instance == 9,
           "an array of the list has its elements");
    list.type = eipDint;
    testOk(eipTagsListed(&t, &list, NULL) == 1 && t.tags[2].elements == 1, "a number has one");
    list.type = 0x4000 | eipDint;
    t.tags[2].elements = 3;
    testOk(eipTagsListed(&t, &list, NULL) == 1 && t.tags[2].elements == 3,
           "one of two dimensions tells nothing of that");
    strcpy(list.name, "d");
    testOk(eipTagsListed(&t, &list, "Program:M") == 0, "another d, of a program, is not ours");
    testOk(eipTagsListed(&t, &list, NULL) == 1 && t.tags[3].elements == 0, "of d.x only the root is told");
    eipTagsFree(&t);
}

/* What was refused by itself is asked for seldom, and alone. */
static void testRefused(void)
{
    eipWant *w = calloc(3, sizeof(*w));
    epicsUInt8 bytes[40];
    eipWriter out = eipWriterOf(bytes, sizeof(bytes));
    eipTags t;
    int round;

    w[0] = want("A", 0, eipCell, 0);
    w[1] = want("A", 1, eipCell, 16);
    w[2] = want("A", 2, eipCell, 32);
    eipTagsInit(&t);
    eipTagsSet(&t, w, 3);
    learn(&t, "A", "C4 00 00 00 00 00");
    t.wants[1].refused = 1;
    eipUnitsMake(&t);
    testOk(t.unitCount == 2 && t.units[0].count == 3 && t.units[0].pieces == 2 && !t.units[0].refused,
           "two elements are read together, with what is between them");
    testOk(t.units[1].refused && t.units[1].first == 1 && t.units[1].count == 1 &&
               t.units[1].period == eipRetryMs && t.pieces[t.units[1].from].want == 1,
           "the refused one alone, each 10 s");
    t.tags[0].period = 60000;
    eipUnitsMake(&t);
    testOk(t.units[1].period == 60000, "or more seldom, if it was wanted so");
    eipUnitPut(&out, &t, &t.units[0], 0, 0x1234);
    isBytes("a fragment says where it begins", &out, "52 02 91 01 41 00 03 00 34 12 00 00");
    for (round = 0; round < 2; round++) {
        w = calloc(3, sizeof(*w));
        w[0] = want("A", 0, eipCell, 0);
        w[1] = want("A", 1, eipCell, 16);
        w[2] = want("A", 3, eipCell, 32);
        w[1].fresh = round;
        eipTagsSet(&t, w, 3);
        testOk(!t.wants[0].refused && !!t.wants[1].refused == !round && !t.wants[2].refused,
               round ? "unless its record has come anew" : "it stays refused when another one comes, which is not");
    }
    out = eipWriterOf(bytes, sizeof(bytes));
    eipTagPathPut(&out, &t, &t.tags[0], 2, eipWriteTag);
    isBytes("a write goes by name, to its element", &out, "4D 03 91 01 41 00 28 02");
    out = eipWriterOf(bytes, sizeof(bytes));
    eipTagAskPut(&out, &t, &t.tags[0]);
    isBytes("the question for the type is one element", &out, "4C 02 91 01 41 00 01 00");
    t.omron = 1;
    out = eipWriterOf(bytes, sizeof(bytes));
    eipUnitPut(&out, &t, &t.units[0], 0, -1);
    isBytes("to an Omron the first element stands in the path", &out,
            "4C 03 91 01 41 00 28 00 03 00");
    testOk(eipUnitLoad(&t, &t.units[0], 0).request == 10 &&
               eipUnitLoad(&t, &t.units[0], 0).answer == 4 + 2 + 12 + 1,
           "with its bytes; the answer has what was asked for");
    out = eipWriterOf(bytes, sizeof(bytes));
    eipTagAskPut(&out, &t, &t.tags[0]);
    isBytes("the question for the type too", &out, "4C 03 91 01 41 00 28 00 01 00");
    t.wants[0].index = 1;
    out = eipWriterOf(bytes, sizeof(bytes));
    eipTagAskPut(&out, &t, &t.tags[0]);
    isBytes("and it is about an element that is wanted", &out, "4C 03 91 01 41 00 28 01 01 00");
    testOk(eipTagAskBytes(&t, &t.tags[0]) == 6, "whose path has 6 bytes");
    t.tags[0].array = 0;
    out = eipWriterOf(bytes, sizeof(bytes));
    eipTagPathPut(&out, &t, &t.tags[0], 0, eipWriteTag);
    isBytes("what is no array has none", &out, "4D 02 91 01 41 00");
    t.units[0].count = 0x7fffffff;
    testOk(eipUnitLoad(&t, &t.units[0], 0).answer == 0x7fffffff, "the load of too much has an end");
    eipTagsFree(&t);
}

/* Is a structure a string? Its handle may say so, else its template. */
static void testTextKinds(void)
{
    eipWant *w = calloc(1, sizeof(*w));
    char base[260];
    epicsUInt8 bytes[600];
    eipWriter out = eipWriterOf(bytes, sizeof(bytes));
    eipTag long_ = {.base = base};
    eipTags t;
    int i;

    w[0] = want("S", 0, eipTextPlace, 0);
    eipTagsInit(&t);
    eipTagsSet(&t, w, 1);
    learn(&t, "S", "A0 02 34 12 01 00 00 00 41 00");
    eipUnitsMake(&t);
    testOk(t.pieces[0].text == eipTextPerhaps, "a structure may be a string");
    t.tags[0].plain = 1;
    eipUnitsMake(&t);
    testOk(t.pieces[0].text == eipTextNo, "not when its template has shown that it is none");
    t.tags[0].characters = 20;
    eipUnitsMake(&t);
    testOk(t.pieces[0].text == eipTextYes, "but when it has room for characters");
    t.tags[0].characters = 0;
    t.tags[0].code = eipStringCode;
    eipUnitsMake(&t);
    testOk(t.pieces[0].text == eipTextYes, "a STRING of its own type is one in any case");
    eipTagsFree(&t);
    for (i = 0; i < 128; i++)
        memcpy(base + 2 * i, "a.", 2);
    base[255] = 0;
    eipTagAskPut(&out, &t, &long_);
    testOk(out.full, "what has a path of 512 bytes is not asked for");
    out = eipWriterOf(bytes, sizeof(bytes));
    long_.base = "a.";
    eipTagAskPut(&out, &t, &long_);
    testOk(out.full, "nor what has none");
}

static eipTemplate *templateOf(const eipMember *members, unsigned count, unsigned id, unsigned size)
{
    eipTemplate *t = calloc(1, sizeof(*t));

    *t = (eipTemplate){.id = id, .handle = id + 0x1000, .size = size, .count = count};
    t->members = calloc(count, sizeof(*members));
    memcpy(t->members, members, count * sizeof(*members));
    return t;
}

/* Members of a member of an element: M[2].In.A, .B, .C, and what keeps them from being read whole. */
static void testInner(void)
{
    static const eipMember inner[] = {
        {"A", 0, eipDint, 0}, {"B", 0, eipDint, 4}, {"C", 2, 0x2000 | eipInt, 8}};
    static const eipMember outer[] = {{"In", 0, 0x8102, 0}, {"N", 0, eipDint, 12}};
    eipWant *w = calloc(3, sizeof(*w));
    eipTags t;
    unsigned i;

    w[0] = want("M[2].In.A", 0, eipCell, 0);
    w[1] = want("M[2].In.B", 0, eipCell, 16);
    w[2] = want("M[2].In.C", 1, eipCell, 32);
    eipTagsInit(&t);
    eipTagsSet(&t, w, 3);
    learn(&t, "M[2].In.A", "C4 00 00 00 00 00");
    learn(&t, "M[2].In.B", "C4 00 00 00 00 00");
    learn(&t, "M[2].In.C", "C3 00 00 00");
    for (i = 0; i < 3; i++)
        t.tags[i].template = 0x101;
    t.templates->table[0x101] = templateOf(outer, 2, 0x101, 16);
    eipUnitsMake(&t);
    testOk(t.unitCount == 3, "without the inner template each is read by itself");
    t.templates->table[0x102] = templateOf(inner, 3, 0x102, 12);
    eipUnitsMake(&t);
    testOk(t.unitCount == 1 && strcmp(t.units[0].whole, "M[2].In") == 0 &&
               t.units[0].handle == 0x1102 && t.units[0].size == 12 &&
               t.pieces[2].offset == 10,
           "with it the inner structure is read whole, C[1] is at byte 10");
    t.wants[2].index = 2;
    eipUnitsMake(&t);
    testOk(t.unitCount == 3, "an element behind the end keeps it from that");
    t.wants[2].index = 0;
    t.wants[1].refused = 1;
    eipUnitsMake(&t);
    testOk(t.unitCount == 3, "so does one that was refused");
    t.wants[1].refused = 0;
    t.tags[1].code = 0xca;
    eipUnitsMake(&t);
    testOk(t.unitCount == 3, "so does another type than the template's");
    t.tags[1].code = eipDint;
    t.tags[1].size = 2;
    eipUnitsMake(&t);
    testOk(t.unitCount == 3, "another size");
    t.tags[1].size = 4;
    t.tags[1].apart = 1;
    eipUnitsMake(&t);
    testOk(t.unitCount == 3, "and a structure that the PLC did not show whole");
    t.tags[1].apart = 0;
    eipUnitsMake(&t);
    testOk(t.unitCount == 1, "else it is read whole again");
    t.templates->table[0x101]->members[0].type = eipDint;
    eipUnitsMake(&t);
    testOk(t.unitCount == 3, "members of what is no structure are none");
    eipTagsFree(&t);
}

/* Elements 0 to 9 of an array, and one of them by itself: one read of its own has all ten. So with two
 * members beside it 114 bytes go and come by members, and 100 for the whole structure of 80 bytes. */
static void testCheaper(void)
{
    static const eipMember members[] = {
        {"A", 10, 0x2000 | eipDint, 0}, {"B", 0, eipDint, 40}, {"C", 0, eipDint, 44}};
    eipWant *w = calloc(4, sizeof(*w));
    eipTags t;
    unsigned i;

    w[0] = want("M.A", 0, eipArrayPlace, 0);
    w[0].count = 10;
    w[0].room = eipPlaceHead + 80;
    w[1] = want("M.A", 1, eipCell, 100);
    w[2] = want("M.B", 0, eipCell, 116);
    w[3] = want("M.C", 0, eipCell, 132);
    eipTagsInit(&t);
    eipTagsSet(&t, w, 4);
    learn(&t, "M.A", "C4 00 00 00 00 00");
    learn(&t, "M.B", "C4 00 00 00 00 00");
    learn(&t, "M.C", "C4 00 00 00 00 00");
    for (i = 0; i < 3; i++)
        t.tags[i].template = 0x101;
    t.templates->table[0x101] = templateOf(members, 3, 0x101, 80);
    eipUnitsMake(&t);
    testOk(t.unitCount == 1 && t.units[0].whole, "80 bytes whole are less than ten elements and two members");
    t.templates->table[0x101]->size = 94;
    eipUnitsMake(&t);
    testOk(t.unitCount == 3 && !t.units[0].whole, "94 are not");
    eipTagsFree(&t);
}

static const struct {
    const char *what;
    eipPlaceKind kind;
    unsigned code, size;
    eipTextKind text;
    const char *data, *error; /* NULL: it is stored */
} stores[] = {
    {"a number in a cell",              eipCell,       eipInt,           2, eipTextYes,     "FE FF",       NULL                                },
    {"a number that is cut",            eipCell,       eipInt,           2, eipTextYes,     "FE",          "answer is too short"               },
    {"a type that there is not",        eipCell,       0xc0,             2, eipTextYes,     "FE FF",       "answer is too short"               },
    {"a structure in a cell",           eipCell,       eipStructureCode, 4, eipTextYes,     "01 00 00 00", "the tag is a structure, no number" },
    {"a string in a cell",              eipCell,       eipStringCode,    4, eipTextYes,     "02 00 61 62", "the tag is a string, no number"    },
    {"a number as text",                eipTextPlace,  eipInt,           2, eipTextYes,     "FE FF",       "the tag is a number, no string"    },
    {"a string as text",                eipTextPlace,  eipStringCode,    1, eipTextYes,     "02 00 61 62", NULL                                },
    {"ten characters where eight have room", eipTextPlace, eipStringCode, 1, eipTextYes,
     "0A 00 61 62 63 64 65 66 67 68 69 6A", NULL                                                                                      },
    {"a string of three with two",      eipTextPlace,  eipStringCode,    1, eipTextYes,     "03 00 61 62", "its length is more than the string has"},
    {"a structure that is no string",   eipTextPlace,  eipStructureCode, 4, eipTextNo,      "01 00 00 00", "the tag is a structure, no string" },
    {"what may be a string",            eipTextPlace,  eipStructureCode, 6, eipTextPerhaps, "01 00 00 00 41 00", NULL                          },
    {"what may be one and is none",     eipTextPlace,  eipStructureCode, 6, eipTextPerhaps, "09 00 00 00 41 00",
     "the tag is a structure, no string"                                                                                                 },
    {"a string as array",               eipArrayPlace, eipStringCode,    1, eipTextYes,     "00",          "the tag is no array of numbers"    },
    {"a string as array, cut",          eipArrayPlace, eipStringCode,    4, eipTextYes,     "00 00",       "answer is too short"               },
    {"an array of one LINT",            eipArrayPlace, 0xc5,             8, eipTextYes,     "01 02 03 04 05 06 07 08", NULL                    },
};

static void testStores(void)
{
    epicsUInt8 data[40], image[100];
    size_t i, n;

    for (i = 0; i < COUNT(stores); i++) {
        eipWant w = {.count = 1, .kind = stores[i].kind, .place = 8,
                     .room = stores[i].kind == eipCell ? eipCellSize : eipPlaceHead + 8};
        eipTags t = {.wants = &w, .wantCount = 1};
        eipPiece p = {.code = stores[i].code, .size = stores[i].size, .bit = -1, .text = stores[i].text};
        const char *error;

        memset(image, 0x55, sizeof(image));
        n = hexBytes(stores[i].data, data);
        error = eipPieceStore(&t, &p, data, n, image);
        testOk(stores[i].error ? error && strcmp(error, stores[i].error) == 0
                               : !error && image[8] == (epicsUInt8)stores[i].code,
               "%s: %s", stores[i].what, error ? error : "stored");
        testOk(image[7] == 0x55 && image[8 + w.room] == 0x55 && (!error || image[8] == 0x55),
               "nothing beside its place");
    }
    {
        eipWant w = {.count = 2, .kind = eipArrayPlace, .place = 0, .room = eipPlaceHead + 8};
        eipTags t = {.wants = &w, .wantCount = 1};
        eipPiece p = {.code = 0xc5, .size = 8, .bit = -1};
        const char *error;

        memset(data, 0, sizeof(data));
        error = eipPieceStore(&t, &p, data, 16, image);
        testOk(error && strcmp(error, "the array has no room") == 0, "two LINTs where one has room: %s",
               error);
        p.offset = 17;
        error = eipPieceStore(&t, &p, data, 16, image);
        testOk(error && strcmp(error, "answer is too short") == 0, "a place behind the data: %s", error);
    }
}

/* A controller that takes so many services in a message at most. */
static void testMultiple(void)
{
    static const eipLoad loads[] = {{10, 10}, {10, 10}, {10, 10}, {10, 10}, {10, 10}};
    eipLimits limits = {.room = 500, .multiple = 2};
    unsigned place[5];

    testOk(eipPack(loads, 5, &limits, 1, place) == 3 && place[0] == 0 && place[1] == 0 &&
               place[2] == 1 && place[3] == 1 && place[4] == 2,
           "at most two in a message: five are three messages");
    limits.multiple = 5;
    testOk(eipPack(loads, 5, &limits, 1, place) == 1, "at most five: one");
    limits.multiple = 1;
    testOk(eipPack(loads, 5, &limits, 0, place) == 5, "one: five");
    limits.multiple = 0;
    testOk(eipPack(loads, 5, &limits, 0, place) == 1, "any number: one");
}

/* --- Links, paths, places ----------------------------------------------------------------- */

static const char *const paths[] = {"a[", "a[x", "a[1", "a[1 2]", "a..b", "a."};

static const struct {
    const char *word;
    eipStatistic statistic;
} statistics[] = {
    {"PLC_ERRORS",         eipPlcErrors      },
    {"PLC_TASK_SLOW",      eipPlcTaskSlow    },
    {"LIST_ERRORS",        eipListErrors     },
    {"LIST_TICKS",         eipListTicks      },
    {"LIST_TIME",          eipListTime       },
    {"LIST_SCAN_TIME",     eipListScanTime   },
    {"LIST_MIN_SCAN_TIME", eipListMinScanTime},
    {"LIST_MAX_SCAN_TIME", eipListMaxScanTime},
    {"TAG_TRANSFER_TIME",  eipTagTransferTime},
};

static void testStatistics(void)
{
    char text[60], error[200];
    eipLink link;
    size_t i, column;

    for (i = 0; i < COUNT(statistics); i++) {
        sprintf(text, "@plc tag S 1 %s", statistics[i].word);
        testOk(eipLinkParse(text, &link, &column, error, sizeof(error)) == 0 &&
                   link.statistic == statistics[i].statistic && link.period == 1,
               "%s is a statistic", statistics[i].word);
    }
}

static void testPaths(void)
{
    epicsUInt8 bytes[8];
    char text[700] = "@plc ", error[200];
    eipWriter w;
    eipLink link;
    size_t i, column;

    for (i = 0; i < COUNT(paths); i++)
        testOk(eipPathBytes(paths[i], 0) == 0, "\"%s\" has no path", paths[i]);
    w = eipWriterOf(bytes, sizeof(bytes));
    testOk(eipPathPut(&w, "a.", 0) == -1, "it is refused, as one that ends with a dot");
    w = eipWriterOf(bytes, 5);
    testOk(eipPathPut(&w, "abc", 0) == -1, "nor has a name for which there is no room");
    w = eipWriterOf(bytes, 6);
    testOk(eipPathPut(&w, "abc", 0) == 0 && w.n == 6, "with one byte more it has");
    testOk(eipLinkParse("@plc tag.64", &link, &column, error, sizeof(error)) == -1 &&
               strcmp(error, "bit 64; allowed: 0 to 63") == 0,
           "%s", error);
    memset(text + 5, 'x', 256);
    testOk(eipLinkParse(text, &link, &column, error, sizeof(error)) == -1 &&
               strstr(error, "more than 255 characters"),
           "a tag of 256 characters: %s", error);
    for (i = 0; i < 127; i++)
        memcpy(text + 5 + 2 * i, "a.", 2);
    strcpy(text + 5 + 2 * i, "a");
    testOk(eipLinkParse(text, &link, &column, error, sizeof(error)) == -1 &&
               strstr(error, "no path of at most"),
           "128 names make no path: %s", error);
}

/* One place for all who want the same, and what makes it another one. */
static void testPlaceKeys(void)
{
    eipPlaces *p = eipPlacesCreate(1000);
    eipWant array = {.tag = "A", .count = 4, .kind = eipArrayPlace}, other = array;
    eipPlace *first = eipPlacesGet(p, &array, 100, 0);

    other.room = 99;
    testOk(first && eipPlacesGet(p, &other, 100, 0) == first,
           "the room of an array is that of its elements, whatever is asked for");
    other = array;
    other.count = 5;
    testOk(eipPlacesGet(p, &other, 100, 0) != first, "another number of elements");
    other = array;
    other.index = 1;
    testOk(eipPlacesGet(p, &other, 100, 0) != first, "another first one");
    other = array;
    other.alone = 1;
    testOk(eipPlacesGet(p, &other, 100, 0) != first, "alone");
    other = array;
    other.indexed = 1;
    testOk(eipPlacesGet(p, &other, 100, 0) != first, "an index that stands in the path");
    other = (eipWant){.tag = "A", .count = 4, .kind = eipTextPlace, .room = 16};
    first = eipPlacesGet(p, &other, 100, 0);
    other.room = 24;
    testOk(first && eipPlacesGet(p, &other, 100, 0) != first, "a text with more room has another place");
    eipPlacesDestroy(p);
}

static const struct {
    const char *base;
    int indexed;
    epicsUInt32 index;
    const char *text;
} elements[] = {{"a", 0, 0, "a"}, {"a", 0, 3, "a[3]"}, {"a", 1, 0, "a[0]"}, {"a[1]", 1, 2, "a[1,2]"},
               {"a[1]", 0, 0, "a[1]"}};

/* An index that the PLC finds, and what is said of one that it does not */
static void testIndexed(void)
{
    eipWant *w = calloc(1, sizeof(*w));
    eipAnswer none = {.status = eipPathSegment}, unknown = {.status = eipPathUnknown};
    char text[20];
    eipTags t;
    size_t i;

    for (i = 0; i < COUNT(elements); i++) {
        eipElementText(elements[i].base, elements[i].indexed, elements[i].index, text, sizeof(text));
        testOk(strcmp(text, elements[i].text) == 0, "%s", text);
    }
    w[0] = want("A", 0, eipCell, 0);
    w[0].indexed = 1;
    eipTagsInit(&t);
    eipTagsSet(&t, w, 1);
    eipTagLearn(&t, &t.tags[0], &none);
    testOk(t.tags[0].state == eipTagBad && strcmp(t.tags[0].reason, "PLC: no such tag or dimension (04)") == 0,
           "%s", t.tags[0].reason);
    eipTagsFree(&t);
    w = calloc(1, sizeof(*w));
    w[0] = want("A[9].x", 0, eipCell, 0);
    eipTagsInit(&t);
    eipTagsSet(&t, w, 1);
    eipTagLearn(&t, &t.tags[0], &unknown);
    testOk(strcmp(t.tags[0].reason, "PLC: no such tag or index (05)") == 0, "%s", t.tags[0].reason);
    eipTagsFree(&t);
}

static void testBadPlaces(void)
{
    eipPlaces *p = eipPlacesCreate(64);
    plcFaults *faults = plcFaultsCreate(64);
    eipWant a = {.tag = "A", .count = 1, .kind = eipCell}, b = {.tag = "B", .count = 1, .kind = eipCell};
    eipPlace *first = eipPlacesGet(p, &a, 100, 0);
    char text[60] = "?";
    unsigned of;
    size_t at;

    eipPlacesGet(p, &b, 100, 0);
    testOk(eipPlacesBad(p, faults, &of, text, sizeof(text)) == 0 && of == 2 && !text[0],
           "no place of two is bad");
    plcFaultsSet(faults, 16, 16, NULL, "PLC: no such tag (05)");
    testOk(eipPlacesBad(p, faults, &of, text, sizeof(text)) == 1 && of == 2 &&
               strcmp(text, "B: no such tag (05)") == 0,
           "one is: %s", text);
    plcFaultsSet(faults, 0, 16, NULL, "not read yet");
    testOk(eipPlacesBad(p, faults, &of, text, sizeof(text)) == 2 && strcmp(text, "A: not read yet") == 0,
           "two are, the first is told: %s", text);
    testOk(eipPlacesTag(p, 20, text, sizeof(text), &at) == 0 && strcmp(text, "B") == 0 && at == 16 &&
               eipPlacesTag(p, 40, text, sizeof(text), &at) == -1,
           "each byte has the tag of its place, where there is one");
    eipPlacesLeave(p, first, 100, 0);
    testOk(eipPlacesBad(p, faults, &of, text, sizeof(text)) == 1 && of == 1 && text[0] == 'B',
           "a place of nobody does not count");
    eipPlacesDestroy(p);
    plcFaultsDestroy(faults);
}

MAIN(eipUnitsTest)
{
    testPlan(0);
    testLearning();
    testRefused();
    testTextKinds();
    testInner();
    testCheaper();
    testStores();
    testMultiple();
    testStatistics();
    testPaths();
    testPlaceKeys();
    testIndexed();
    testBadPlaces();
    return testDone();
}
