/* EtherNet/IP without a network: what is rare. Routes and paths that have no room, a connection that is
 * opened again, answers that are cut or of another kind, templates that are none. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "eipBrowse.h"
#include "eipConnect.h"
#include "hexBytes.h"

#define COUNT(table) (sizeof(table) / sizeof(table[0]))

static char why[80];

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

/* --- Requests ----------------------------------------------------------------------------- */

static void testRequests(void)
{
    static const epicsUInt8 zeros[512];
    epicsUInt8 bytes[600], path[12];
    char route[200] = "1,0", error[80];
    eipWriter w = eipWriterOf(bytes, sizeof(bytes));
    eipRoute r = {{1, 5}, 2};
    int i;

    for (i = 0; i < 32; i++)
        strcat(route, ",1,0");
    testOk(eipRouteParse(route, &r, error, sizeof(error)) == -1 && !r.length,
           "a route of 33 ports is refused: 64 bytes are 32");
    testOk(eipRouteParse(route + 4, &r, error, sizeof(error)) == 0 && r.length == 64,
           "one of 32 is not");
    eipRequestPut(&w, eipReadTag, zeros, 3);
    testOk(w.full, "a path has an even number of bytes");
    w = eipWriterOf(bytes, sizeof(bytes));
    eipRequestPut(&w, eipReadTag, zeros, 510);
    testOk(!w.full && w.n == 512 && bytes[1] == 255, "and at most 510");
    w = eipWriterOf(bytes, sizeof(bytes));
    eipRequestPut(&w, eipReadTag, zeros, 512);
    testOk(w.full, "512 are too many");
    w = eipWriterOf(path, sizeof(path));
    w.n = eipObjectPath(path, 0x300, 0x1234, 5);
    isBytes("numbers above 255 have two bytes", &w, "21 00 00 03 25 00 34 12 30 05");
    w.n = eipObjectPath(path, 0xff, 0x100, 0);
    isBytes("255 has one, and no attribute is none", &w, "20 FF 25 00 00 01");
    r = (eipRoute){{1, 5}, 2};
    w = eipWriterOf(bytes, sizeof(bytes));
    eipUnconnectedSendPut(&w, "\x4c\x00\x01", 3, &r, 5000);
    isBytes("a message of odd length is filled up, its length is not", &w,
            "52 02 20 06 24 01 0A 05 03 00 4C 00 01 00 01 00 01 05");
    w = eipWriterOf(bytes, sizeof(bytes));
    eipUnconnectedSendPut(&w, "\x4c\x00", 2, &r, 0);
    testOk(bytes[7] == 1, "no time is one tick");
    w = eipWriterOf(bytes, sizeof(bytes));
    eipUnconnectedSendPut(&w, "\x4c\x00", 2, &r, 1025);
    testOk(bytes[7] == 2, "1025 ms are two of 1024");
    w = eipWriterOf(bytes, sizeof(bytes));
    eipUnconnectedSendPut(&w, "\x4c\x00", 2, &r, 10000000);
    testOk(bytes[7] == 255, "more than 255 ticks are 255");
}

static const struct {
    const char *what, *answer;
    unsigned service;
    int failure;
} routeFailures[] = {
    {"the route's, to a read",              "D2 00 01 01 12 03", eipReadTag,      1},
    {"the route's, to a fragment",          "D2 00 01 01 04 02", eipReadFragment, 1},
    {"no resource on the way",              "D2 00 02 00",       eipReadFragment, 1},
    {"the tag's, to a fragment",            "D2 00 05 00",       eipReadFragment, 0},
    {"a fragment that is good",             "D2 00 00 00 C4 00", eipReadFragment, 0},
    {"the tag's, to a read",                "CC 00 05 00",       eipReadTag,      0},
    {"cut",                                 "D2 00 01",          eipReadTag,      0},
};

/* A connection by a route: who has refused, the controller or somebody before it? */
static void testRouteFailures(void)
{
    epicsUInt8 bytes[20], frame[80];
    eipSession s = {.handle = 5, .command = eipSendRRData, .service = eipReadTag, .routed = 1};
    eipAnswer a;
    size_t i, n;

    for (i = 0; i < COUNT(routeFailures); i++) {
        n = hexBytes(routeFailures[i].answer, bytes);
        testOk(eipIsRouteFailure(bytes, n, routeFailures[i].service) == routeFailures[i].failure,
               "%s: %s of the route", routeFailures[i].what,
               routeFailures[i].failure ? "a failure" : "none");
    }
    n = hexBytes("6F 00 16 00 05 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00"
                " 00 00 00 00 00 00 02 00 00 00 00 00 B2 00 06 00 D2 00 01 01 12 03",
                frame);
    testOk(eipSessionUnwrap(&s, frame, n, &a, why, sizeof(why)) == 0 &&
               a.status == eipConnectionFailure && a.extended == 0x312 && a.service == eipReadTag,
           "an answer of the route is one to the request");
    s = (eipSession){.handle = 5, .command = eipSendUnitData, .service = eipReadTag};
    n = hexBytes("70 00 00 00 05 00 00 00 01 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00", frame);
    testOk(eipSessionUnwrap(&s, frame, n, &a, why, sizeof(why)) == 0 &&
               a.status == eipConnectionFailure && a.extended == eipExtNoConnection,
           "a bare status 1 on a connection says that it is forgotten");
    s.command = frame[0] = eipSendRRData;
    testOk(eipSessionUnwrap(&s, frame, n, &a, why, sizeof(why)) == -1,
           "elsewhere it ends the session: %s", why);
}

static void testPlain(void)
{
    epicsUInt8 frame[28];
    eipSession s = {.handle = 5};
    epicsUInt32 status, handle;
    eipReader r;
    size_t n = eipSessionPlain(&s, eipRegisterSession, frame, sizeof(frame));

    testOk(eipFrameLength(frame, 3) == 0, "three bytes do not tell how long a frame is");
    testOk(eipFrameLength(frame, 4) == 28 && n == 28, "four do");
    testOk(eipSessionPlainTake(&s, frame, n, &r, &status, &handle, why, sizeof(why)) == 0,
           "RegisterSession is answered");
    frame[12] ^= 1;
    testOk(eipSessionPlainTake(&s, frame, n, &r, &status, &handle, why, sizeof(why)) == -1 &&
               strcmp(why, "answer to another request") == 0,
           "another context: %s", why);
    frame[0] = eipListServices;
    testOk(eipSessionPlainTake(&s, frame, n, &r, &status, &handle, why, sizeof(why)) == -1 &&
               strcmp(why, "answer to another command") == 0,
           "another command: %s", why);
    testOk(strcmp(eipFrameStatusText(0), "success") == 0 &&
               strcmp(eipFrameStatusText(0x69), "protocol revision not supported") == 0 &&
               strcmp(eipFrameStatusText(0x77), "encapsulation error") == 0,
           "status in words, of which there is none for most");
}

/* --- The way to a session ----------------------------------------------------------------- */

/* An answer in a frame of RR data to what is asked. */
static size_t wrapped(epicsUInt8 *frame, const char *message)
{
    epicsUInt8 context[8], body[80];
    eipWriter w = eipWriterOf(frame, 200);
    size_t n = hexBytes(message, body);

    memcpy(context, frame + 12, 8);
    w.n = eipHeaderSize;
    frame[0] = eipSendRRData;
    eipItemsUnconnected(&w, 0);
    eipPutBytes(&w, body, n);
    eipItemsEnd(&w);
    memcpy(frame + 12, context, 8);
    return eipFrameEnd(&w);
}

static eipConnect connectAt(eipStep step, unsigned skip)
{
    eipConnectOptions o = {.connected = 1, .size = eipSizeLarge, .room = eipUnconnectedRoom,
                           .timeout = 5000};
    eipConnect c;

    eipConnectInit(&c, &o);
    c.skip = skip;
    eipConnectBegin(&c, 42);
    c.step = step;
    c.session.opening.large = step == eipStepLarge;
    c.session.opening.size = step == eipStepLarge ? eipSizeLarge : eipSizeSmall;
    return c;
}

static int answered(eipConnect *c, const char *message)
{
    epicsUInt8 frame[200] = {0};

    if (!eipConnectNext(c, frame, sizeof(frame)))
        return -2;
    return eipConnectTake(c, frame, wrapped(frame, message), why, sizeof(why));
}

static void testConnect(void)
{
    eipConnect c = connectAt(eipStepIdentity, 0);
    epicsUInt8 frame[200] = {0};
    char text[60];
    epicsUInt32 id;

    testOk(answered(&c, "81 00 01 01 12 03") == -1, "nobody in the slot ends it: %s", why);
    c = connectAt(eipStepIdentity, 0);
    testOk(answered(&c, "81 00 00 00 01 00 0E 00 37 00 14 0B 60 31 78 56 34 12 24 41 41 41 41 41"
                        " 41 41 41 41 41 41 41 41 41 41 41 41 41 41 41 41 41 41 41 41 41 41 41 41"
                        " 41 41 41 41 41 41 41") == 0 &&
               c.identity.known && strlen(c.identity.name) == 32,
           "a name of 36 characters is cut to 32");
    c = connectAt(eipStepIdentity, 0);
    testOk(answered(&c, "81 00 00 00 01 00") == 0 && !c.identity.known && !c.identity.name[0],
           "an identity that is cut is not known");
    c = connectAt(eipStepIdentity, 0);
    testOk(answered(&c, "8E 00 00 00") == -1, "an answer to another service ends it: %s", why);
    c = connectAt(eipStepLarge, 1u << eipStepSmall);
    testOk(answered(&c, "DB 00 01 02 09 01 F4 01") == 0 && c.step == eipStepDone &&
               !c.session.connected,
           "500 bytes, where small connections are not stood: none");
    c = connectAt(eipStepSmall, 0);
    testOk(answered(&c, "D4 00 00 00 01 00 00 00 02 00 00 00 03 00 04 00 05 00 00 00 00 00 00 00"
                        " 00 00 00 00 00 00") == -1 &&
               strcmp(why, "answer to another connection") == 0,
           "an answer to another opening ends it: %s", why);
    c = connectAt(eipStepList, 0);
    eipConnectNext(&c, frame, sizeof(frame));
    testOk(eipConnectTake(&c, frame, 20, why, sizeof(why)) == -1, "so does one that is cut: %s", why);
    c = connectAt(eipStepSmall, 0);
    id = c.session.opening.id;
    eipConnectText(&c, text, sizeof(text));
    testOk(strcmp(text, "unconnected, 490 bytes") == 0, "%s", text);
    testOk(eipConnectClose(&c, frame, sizeof(frame)) == 0, "what is not open is not closed");
    c.session.connected = 1;
    c.session.sequence = 7;
    c.tries = 2;
    eipConnectText(&c, text, sizeof(text));
    testOk(strcmp(text, "connected, 504 bytes") == 0, "%s", text);
    c.step = eipStepDone;
    testOk(eipConnectNext(&c, frame, sizeof(frame)) == 0, "when all is done nothing is asked");
    testOk(eipConnectNoAnswer(&c) == 0, "and no answer is missing");
    eipConnectReopen(&c);
    testOk(c.step == eipStepSmall && !c.session.connected && !c.session.sequence && !c.tries &&
               c.session.opening.id != id,
           "opened again: small as it was, with another number");
    c.session.opening.large = 1;
    eipConnectReopen(&c);
    testOk(c.step == eipStepLarge, "or large");
}

/* --- Lists and templates ------------------------------------------------------------------ */

static const struct {
    const char *name;
    unsigned type;
    int counts;
} symbols[] = {
    {"Speed",        0xc4,          1},
    {"",             0xc4,          0},
    {"Program:Main", 0x1068,        1},
    {"program:main", 0x1068,        1},
    {"Hidden",       0x1000 | 0xc4, 0},
    {"__l01",        0xc4,          0},
    {"Map:Local",    0xc4,          0},
    {"Cxn:x",        0xc4,          0},
    {"Task:x",       0xc4,          0},
    {"Routine:x",    0xc4,          0},
    {"UDI:x",        0xc4,          0},
    {"UDIx",         0xc4,          1},
    {"_l",           0xc4,          1},
};

static void testSymbols(void)
{
    epicsUInt8 bytes[400];
    char program[300];
    eipWriter w = eipWriterOf(bytes, sizeof(bytes));
    eipSymbol symbol = {.type = 0};
    size_t i;

    for (i = 0; i < COUNT(symbols); i++) {
        strcpy(symbol.name, symbols[i].name);
        symbol.type = symbols[i].type;
        testOk(eipSymbolCounts(&symbol) == symbols[i].counts, "\"%s\" is %s", symbols[i].name,
               symbols[i].counts ? "somebody's" : "the controller's own");
    }
    memset(program, 'p', sizeof(program));
    program[256] = 0;
    eipSymbolsPut(&w, program, 0);
    testOk(w.full, "a program of 256 characters has no path");
    w = eipWriterOf(bytes, sizeof(bytes));
    program[255] = 0;
    eipSymbolsPut(&w, program, 0);
    testOk(!w.full && bytes[1] == (2 + 256 + 6) / 2 && bytes[3] == 255, "one of 255 has");
    w = eipWriterOf(bytes, sizeof(bytes));
    eipTemplateSizePut(&w, 0x101);
    isBytes("how large a template is, is asked", &w,
            "03 03 20 6C 25 00 01 01 04 00 04 00 05 00 02 00 01 00");
    w = eipWriterOf(bytes, sizeof(bytes));
    eipTemplateReadPut(&w, 5, 0x12345, 400);
    isBytes("a part of it is read", &w, "4C 02 20 6C 24 05 45 23 01 00 90 01");
}

static const struct {
    const char *what, *answer;
} sizes[] = {
    {"an attribute that nobody asked for", "01 00 03 00 00 00 05 00"                           },
    {"an attribute with a status",         "01 00 04 00 16 00"                                 },
    {"one of four missing",                "03 00 04 00 00 00 2A 00 00 00 05 00 00 00 20 00 00 00"
                                           " 02 00 00 00 06 00"                                },
    {"cut",                                "04 00 04 00 00 00 2A 00 00 00 05 00 00 00 20 00 00 00"
                                           " 02 00 00 00 06 00 01 00 00 00 EF"                 },
    {"a definition of 5 words",            "04 00 04 00 00 00 05 00 00 00 05 00 00 00 20 00 00 00"
                                           " 02 00 00 00 06 00 01 00 00 00 EF BE"              },
    {"a definition of more than a MB",     "04 00 04 00 00 00 01 00 04 00 05 00 00 00 20 00 00 00"
                                           " 02 00 00 00 06 00 01 00 00 00 EF BE"              },
    {"a structure of more than a MB",      "04 00 04 00 00 00 2A 00 00 00 05 00 00 00 01 00 10 00"
                                           " 02 00 00 00 06 00 01 00 00 00 EF BE"              },
};

static void testTemplates(void)
{
    epicsUInt8 bytes[100];
    eipMember members[2] = {{"LEN", 0, eipDint, 0}, {"DATA", 82, 0x2000 | eipSint, 4}};
    eipTemplate t = {.count = 2, .size = 88, .members = members};
    eipMember hidden = {.name = "ZZZZZZZZZZMotor1"};
    eipAnswer a;
    size_t i;

    for (i = 0; i < COUNT(sizes); i++) {
        a = answerOf(sizes[i].answer, bytes);
        testOk(eipTemplateSizeTake(&a, 1, &t) == -1, "%s is no template", sizes[i].what);
    }
    a = answerOf("04 00 04 00 00 00 00 00 04 00 05 00 00 00 00 00 10 00"
                 " 02 00 00 00 06 00 01 00 00 00 EF BE", bytes);
    testOk(eipTemplateSizeTake(&a, 1, &t) == 0 && t.id == 1 && t.words == 1 << 18,
           "just a MB of each is one");
    t = (eipTemplate){.count = 2, .size = 88, .members = members};
    testOk(eipTemplateIsString(&t) == 82, "LEN and DATA are a string");
    t.size = 85;
    testOk(eipTemplateIsString(&t) == 0, "not where DATA is longer than the structure");
    t.size = 86;
    testOk(eipTemplateIsString(&t) == 82, "it may fill it");
    t.members[1].offset = 8;
    testOk(eipTemplateIsString(&t) == 0, "nor where DATA is elsewhere");
    t.members[1].offset = 4;
    t.members[1].type = eipSint;
    testOk(eipTemplateIsString(&t) == 0, "nor where it is no array");
    testOk(eipMemberIsHidden(&hidden), "the host of a BOOL is hidden");
    strcpy(hidden.name, "_x");
    testOk(eipMemberIsHidden(&hidden), "so is what begins with _");
    strcpy(hidden.name, "ZZZ");
    testOk(!eipMemberIsHidden(&hidden), "ZZZ is not");
    memset(bytes, 0, sizeof(bytes));
    t = (eipTemplate){.count = 13, .size = 4};
    testOk(eipTemplateParse(&t, bytes, 100) == -1, "13 members have no room in 100 bytes");
    bytes[4] = 4;
    t = (eipTemplate){.count = 1, .size = 4};
    testOk(eipTemplateParse(&t, bytes, 20) == -1 && !t.members, "a member behind the end is none");
    bytes[4] = 3;
    t = (eipTemplate){.count = 1, .size = 4};
    testOk(eipTemplateParse(&t, bytes, 20) == 0 && t.members[0].offset == 3, "its last byte is one");
    eipTemplateFree(&t);
}

static void testClear(void)
{
    eipTemplates *known = calloc(1, sizeof(*known));
    unsigned i, n = 0;

    for (i = 1; i < eipTemplatesMax; i += 4094) {
        known->table[i] = calloc(1, sizeof(eipTemplate));
        known->table[i]->count = 1;
        known->table[i]->members = calloc(1, sizeof(eipMember));
    }
    testOk(known->table[1] && known->table[eipTemplatesMax - 1], "the first and the last template");
    eipTemplatesClear(known);
    for (i = 0; i < eipTemplatesMax; i++)
        n += known->table[i] != NULL;
    testOk(n == 0, "none is known any more");
    free(known);
}

/* --- Types -------------------------------------------------------------------------------- */

/* As the standard has them; those of numbers with values are in eipTagsTest. */
static const struct {
    const char *name;
    unsigned code, size;
    eipKind kind;
} codes[] = {
    {"BOOL",         0xc1,   1, eipUnsigned },
    {"SINT",         0xc2,   1, eipSigned   },
    {"INT",          0xc3,   2, eipSigned   },
    {"DINT",         0xc4,   4, eipSigned   },
    {"LINT",         0xc5,   8, eipSigned   },
    {"USINT",        0xc6,   1, eipUnsigned },
    {"UINT",         0xc7,   2, eipUnsigned },
    {"UDINT",        0xc8,   4, eipUnsigned },
    {"ULINT",        0xc9,   8, eipUnsigned },
    {"REAL",         0xca,   4, eipReal     },
    {"LREAL",        0xcb,   8, eipReal     },
    {"STIME",        0xcc,   4, eipSigned   },
    {"DATE",         0xcd,   2, eipUnsigned },
    {"TIME_OF_DAY",  0xce,   4, eipUnsigned },
    {"STRING",       0xd0,   0, eipText     },
    {"BYTE",         0xd1,   1, eipUnsigned },
    {"WORD",         0xd2,   2, eipUnsigned },
    {"DWORD",        0xd3,   4, eipUnsigned },
    {"LWORD",        0xd4,   8, eipUnsigned },
    {"FTIME",        0xd6,   4, eipSigned   },
    {"LTIME",        0xd7,   8, eipSigned   },
    {"ITIME",        0xd8,   2, eipSigned   },
    {"SHORT_STRING", 0xda,   0, eipText     },
    {"TIME",         0xdb,   4, eipSigned   },
    {"ENUM",         0x07,   4, eipSigned   },
    {"DATE_NSEC",    0x08,   8, eipSigned   },
    {"TIME_NSEC",    0x09,   8, eipSigned   },
    {"DATE_AND_TIME_NSEC", 0x0a, 8, eipSigned},
    {"TIME_OF_DAY_NSEC", 0x0b, 8, eipSigned },
    {"STRUCT",       0x02a0, 0, eipStructure},
};

static void testCodes(void)
{
    size_t i, n = 0;

    for (i = 0; i < COUNT(codes); i++) {
        const eipType *type = eipTypeOf(codes[i].code);

        testOk(type && type == eipTypeNamed(codes[i].name) && type->size == codes[i].size &&
                   type->kind == codes[i].kind,
               "%s is type %02X", codes[i].name, codes[i].code);
    }
    while (eipTypes[n].name)
        n++;
    testOk(n == COUNT(codes), "there are no others");
}

static void testTypes(void)
{
    eipNumber number = {eipUnsigned, {.integer = -1}};
    const eipType *boolean = eipTypeNamed("bool");
    epicsUInt8 raw[8] = {3, 0, 'a', 'b'};
    size_t n = 0;

    testOk(!eipTypeOf(0xc0) && !eipTypeNamed("REEL"), "there is no type C0, and none called REEL");
    testOk(boolean && boolean->code == eipBool, "names of types are the same in small letters");
    testOk(eipNumberReal(&number) == 18446744073709551615., "all bits without a sign");
    number.kind = eipSigned;
    testOk(eipNumberReal(&number) == -1, "and with it");
    number = (eipNumber){eipReal, {.real = 2.5}};
    testOk(eipNumberReal(&number) == 2.5, "a real number stays what it is");
    testOk(eipNumberParse(boolean, "TRUE", &number) == 0 && number.u.integer == 1, "true is 1");
    testOk(eipNumberParse(boolean, "false", &number) == 0 && number.u.integer == 0, "false is 0");
    testOk(eipNumberParse(boolean, "yes", &number) == -1, "yes is no BOOL");
    testOk(eipNumberParse(eipTypeNamed("REAL"), "yes", &number) == -1, "nor a REAL");
    testOk(eipNumberParse(eipTypeNamed("UINT"), "-1", &number) == -1, "a UINT has no sign");
    testOk(eipNumberParse(eipTypeNamed("UINT"), "0x10", &number) == 0 && number.u.integer == 16,
           "0x10 is 16");
    testOk(eipNumberParse(eipTypeNamed("DINT"), "-0X10", &number) == 0 && number.u.integer == -16,
           "-0X10 is -16");
    testOk(eipNumberParse(eipTypeNamed("DINT"), "010", &number) == 0 && number.u.integer == 10,
           "010 is 10");
    testOk(eipNumberParse(eipTypeNamed("UINT"), "010", &number) == 0 && number.u.integer == 10,
           "without a sign too");
    testOk(eipNumberParse(boolean, "2", &number) == -1 &&
               eipNumberParse(boolean, "1", &number) == 0 && number.u.integer == 1,
           "a BOOL is 1, but not 2");
    testOk(!eipTextGet(eipStringCode, raw, 1, &n), "one byte is no string with two for the length");
    testOk(!eipTextGet(eipStringCode, raw, 4, &n), "nor are two characters one of three");
    raw[0] = 2;
    testOk(eipTextGet(eipStringCode, raw, 4, &n) == (char *)raw + 2 && n == 2, "but one of two");
    testOk(eipTextPut(eipStringCode, raw, 4, 2, "abc", 3) == 0, "which has no room for a third");
}

MAIN(eipRareTest)
{
    testPlan(0);
    testRequests();
    testRouteFailures();
    testPlain();
    testConnect();
    testSymbols();
    testTemplates();
    testClear();
    testCodes();
    testTypes();
    return testDone();
}
