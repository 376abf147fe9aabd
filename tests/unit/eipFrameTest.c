/* EtherNet/IP without a network: requests as literal bytes, answers with each of their fields
 * wrong in turn, the way to a session step by step, and random bytes. */
#include <stdlib.h>
#include <string.h>

#include <epicsStdio.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "eipConnect.h"

#define COUNT(table) (sizeof(table) / sizeof(table[0]))

static epicsUInt8 frame[eipFrameMax];
static char why[80];

/* Same numbers in each run. */
static epicsUInt32 seed = 1;

static unsigned randomBelow(unsigned n)
{
    seed = seed * 1664525u + 1013904223u;
    return (seed >> 8) % n;
}

static unsigned nibble(char c)
{
    return (unsigned)(c <= '9' ? c - '0' : (c | 32) - 'a' + 10);
}

/* "6F 00 .." to bytes. Returns their number. */
static size_t bytesOf(const char *hex, epicsUInt8 *bytes)
{
    size_t n = 0;

    for (; *hex; hex++)
        if (*hex != ' ') {
            bytes[n++] = (epicsUInt8)(nibble(hex[0]) << 4 | nibble(hex[1]));
            hex++;
        }
    return n;
}

static int isBytes(const char *what, const void *got, size_t n, const char *hex)
{
    static epicsUInt8 wanted[eipFrameMax];
    size_t length = bytesOf(hex, wanted), i;
    int same = length == n && memcmp(got, wanted, n) == 0;

    testOk(same, "%s", what);
    for (i = 0; !same && i < n; i += 16) {
        char line[64] = "";
        size_t k;

        for (k = i; k < n && k < i + 16; k++)
            sprintf(line + strlen(line), "%02X ", ((const epicsUInt8 *)got)[k]);
        testDiag("%s", line);
    }
    return same;
}

/* --- Routes ------------------------------------------------------------------------------- */

static const struct {
    const char *text, *bytes; /* NULL: refused */
} routes[] = {
    {"1,0",                    "01 00"                                                       },
    {"1,5",                    "01 05"                                                       },
    {"",                       ""                                                            },
    {"-1",                     ""                                                            },
    {"2,10.0.0.4,1,0",         "12 08 31 30 2E 30 2E 30 2E 34 01 00"                         },
    {"1,6,18,10.206.1.40,1,4",
     "01 06 1F 0B 12 00 31 30 2E 32 30 36 2E 31 2E 34 30 00 01 04"                           },
    {"1",                      NULL                                                          },
    {"1,",                     NULL                                                          },
    {"0,1",                    NULL                                                          },
    {"a,1",                    NULL                                                          },
    {"1,0,",                   NULL                                                          },
    {"1,-2",                   NULL                                                          },
    {"1,256",                  NULL                                                          },
    {"1,99999999999999999999", NULL                                                          },
    {"2,10.0.0.400",           NULL                                                          },
    {"2,300.0.0.4",            NULL                                                          },
    {"2,10.0.4",               NULL                                                          },
    {"14,1",                   "0E 01"                                                       },
    {"15,1",                   "0F 0F 00 01"                                                 },
    {"2,host,1,255",           "12 04 68 6F 73 74 01 FF"                                     },
};

static void testRoutes(void)
{
    char error[200], wanted[200];
    eipRoute route;
    size_t i;

    for (i = 0; i < COUNT(routes); i++) {
        int status = eipRouteParse(routes[i].text, &route, error, sizeof(error));

        epicsSnprintf(wanted, sizeof(wanted),
                      "route \"%s\"; allowed: port,link,port,link ... as 1,0 or 1,6,18,10.0.0.4,1,0; or -1",
                      routes[i].text);
        if (!routes[i].bytes)
            testOk(status == -1 && strcmp(error, wanted) == 0, "refused: %s", error);
        else
            isBytes(routes[i].text[0] ? routes[i].text : "no route", route.bytes,
                    route.length, routes[i].bytes);
    }
}

/* --- Requests ----------------------------------------------------------------------------- */

static const epicsUInt8 readTest[] = {0x4c, 0x03, 0x91, 0x04, 'T', 'E', 'S', 'T', 1, 0};

static void testWays(void)
{
    eipSession s = {.handle = 0x11223344, .routeTimeout = 5000};
    size_t n;

    n = eipSessionPlain(&s, eipListServices, frame, sizeof(frame));
    isBytes("ListServices", frame, n,
            "04 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00");
    s.handle = 0;
    n = eipSessionPlain(&s, eipRegisterSession, frame, sizeof(frame));
    isBytes("RegisterSession", frame, n,
            "65 00 04 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00"
            "01 00 00 00");
    s.handle = 0x11223344;
    n = eipSessionWrap(&s, eipWayNormal, readTest, sizeof(readTest), frame, sizeof(frame));
    memset(frame + 12, 0, 8);
    isBytes("a read to the module itself", frame, n,
            "6F 00 1A 00 44 33 22 11 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00"
            "00 00 00 00 06 00 02 00 00 00 00 00 B2 00 0A 00"
            "4C 03 91 04 54 45 53 54 01 00");
    eipRouteParse("1,3", &s.route, why, sizeof(why));
    n = eipSessionWrap(&s, eipWayNormal, readTest, sizeof(readTest), frame, sizeof(frame));
    memset(frame + 12, 0, 8);
    isBytes("a read through Unconnected_Send", frame, n,
            "6F 00 28 00 44 33 22 11 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00"
            "00 00 00 00 06 00 02 00 00 00 00 00 B2 00 18 00"
            "52 02 20 06 24 01 0A 05 0A 00 4C 03 91 04 54 45 53 54 01 00 01 00 01 03");
    s.connected = 1;
    s.opened.toPlc = 0xa1b2c3d4;
    s.sequence = 0xffff;
    n = eipSessionWrap(&s, eipWayNormal, readTest, sizeof(readTest), frame, sizeof(frame));
    memset(frame + 12, 0, 8);
    isBytes("a read on a connection", frame, n,
            "70 00 20 00 44 33 22 11 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00"
            "00 00 00 00 00 00 02 00 A1 00 04 00 D4 C3 B2 A1 B1 00 0C 00 00 00"
            "4C 03 91 04 54 45 53 54 01 00");
    testOk(eipSessionWrap(&s, eipWayNormal, readTest, sizeof(readTest), frame, 50) == 0,
           "a frame that has no room is none");
}

static void testMultiple(void)
{
    epicsUInt8 message[100];
    eipWriter w = eipWriterOf(message, sizeof(message));
    eipAnswer a = {0};
    epicsUInt8 answer[60];
    size_t length;

    eipMultipleBegin(&w, 2);
    eipMultipleNext(&w, 0);
    eipPutBytes(&w, readTest, sizeof(readTest));
    eipMultipleNext(&w, 1);
    eipPutBytes(&w, readTest, sizeof(readTest));
    isBytes("two services in one", message, w.n,
            "0A 02 20 02 24 01 02 00 06 00 10 00 4C 03 91 04 54 45 53 54 01 00"
            "4C 03 91 04 54 45 53 54 01 00");
    a.data = answer;
    a.length = bytesOf("02 00 06 00 0E 00 CC 00 00 00 C4 00 01 00 CC 00 05 00", answer);
    testOk(eipMultipleTake(&a, 2, 0, &length) == answer + 6 && length == 8,
           "the first of two answers");
    testOk(eipMultipleTake(&a, 2, 1, &length) == answer + 14 && length == 4,
           "the second of two answers");
    testOk(!eipMultipleTake(&a, 3, 0, &length), "another number of answers is none");
    answer[4] = 0x30;
    testOk(!eipMultipleTake(&a, 2, 0, &length), "an answer behind the end is none");
    answer[4] = 5;
    testOk(!eipMultipleTake(&a, 2, 0, &length), "answers in wrong order are none");
    answer[2] = 3;
    testOk(!eipMultipleTake(&a, 2, 0, &length), "an answer among the offsets is none");
}

/* --- Answers ------------------------------------------------------------------------------ */

static const char good[] = "6F 00 1A 00 44 33 22 11 00 00 00 00 01 02 03 04 05 06 07 08 00 00 00 00"
                           "00 00 00 00 00 00 02 00 00 00 00 00 B2 00 0A 00"
                           "CC 00 00 00 CA 00 00 80 38 3B";
static const char connected[] =
    "70 00 20 00 44 33 22 11 00 00 00 00 01 02 03 04 05 06 07 08 00 00 00 00"
    "00 00 00 00 00 00 02 00 A1 00 04 00 78 56 34 12 B1 00 0C 00 07 00"
    "CC 00 00 00 CA 00 00 80 38 3B";

static const struct {
    const char *what;
    int connected;
    size_t at;         /* this byte is another one */
    epicsUInt8 value;
    const char *why;   /* "": it is good all the same */
} lies[] = {
    {"command",                0, 0,  0x70, "answer to another command"    },
    {"length",                 0, 2,  0x19, "answer of wrong length"       },
    {"session",                0, 4,  0x45, "answer to another session"    },
    {"status",                 0, 8,  0x64, "session not known to the PLC" },
    {"context",                0, 12, 0x02, "answer to another request"    },
    {"end of the context",     0, 19, 0x09, "answer to another request"    },
    {"options",                0, 20, 0x01, "answer with options"          },
    {"interface",              0, 24, 0x01, "answer not understood"        },
    {"number of items",        0, 30, 0x01, "answer not understood"        },
    {"more items than there",  0, 30, 0x03, "answer not understood"        },
    {"type of the first item", 0, 32, 0xa1, "answer not understood"        },
    {"type of the second",     0, 36, 0xb1, "answer not understood"        },
    {"length of the second",   0, 38, 0x0b, "answer not understood"        },
    {"a shorter second",       0, 38, 0x09, "answer not understood"        },
    {"service",                0, 40, 0xcd, "answer to another service"    },
    {"a request as answer",    0, 40, 0x4c, "answer to another service"    },
    {"reserved byte",          0, 41, 0x01, "answer to another service"    },
    {"words of status",        0, 43, 0x04, "answer to another service"    },
    {"timeout",                0, 28, 0x01, ""                             },
    {"status of the service",  0, 42, 0x05, ""                             },
    {"connection",             1, 36, 0x79, "answer on another connection" },
    {"sequence",               1, 44, 0x08, "answer out of sequence"       },
    {"end of the sequence",    1, 45, 0x01, "answer out of sequence"       },
    {"service",                1, 46, 0xd2, "answer to another service"    },
    {"context",                1, 12, 0x02, "answer to another request"    },
    {"type of the first item", 1, 32, 0x00, "answer not understood"        },
    {"length of the first",    1, 34, 0x03, "answer not understood"        },
};

static eipSession sessionOf(int isConnected)
{
    eipSession s = {.handle = 0x11223344, .service = eipReadTag, .sequence = 7};

    s.command = isConnected ? eipSendUnitData : eipSendRRData;
    s.connected = isConnected;
    s.opened.fromPlc = 0x12345678;
    s.opened.toPlc = 0x0abcdef0;
    bytesOf("01 02 03 04 05 06 07 08", s.context);
    return s;
}

static void testLies(void)
{
    eipAnswer a;
    size_t n, i;
    int isConnected;

    for (isConnected = 0; isConnected < 2; isConnected++) {
        eipSession s = sessionOf(isConnected);

        n = bytesOf(isConnected ? connected : good, frame);
        testOk(eipSessionUnwrap(&s, frame, n, &a, why, sizeof(why)) == 0 && a.length == 6 &&
                   a.data[0] == 0xca && a.status == 0,
               "a good answer, %s", isConnected ? "connected" : "unconnected");
        for (i = 0; i < n; i++)
            if (eipSessionUnwrap(&s, frame, i, &a, why, sizeof(why)) == 0)
                break;
        testOk(i == n, "cut anywhere it is none");
    }
    for (i = 0; i < COUNT(lies); i++) {
        eipSession s = sessionOf(lies[i].connected);
        int status;

        n = bytesOf(lies[i].connected ? connected : good, frame);
        frame[lies[i].at] = lies[i].value;
        why[0] = 0;
        status = eipSessionUnwrap(&s, frame, n, &a, why, sizeof(why));
        testOk(status == (lies[i].why[0] ? -1 : 0) && strcmp(why, lies[i].why) == 0,
               "another %s: \"%s\"", lies[i].what, why);
    }
}

/* Answers that come in each other's place, bytes that are changed, random bytes: none of them
 * passes for the answer, unless it is one. */
static void testRandom(void)
{
    epicsUInt8 right[200];
    unsigned i, k, passed = 0, wrong = 0;
    eipAnswer a;
    size_t n, m;

    for (i = 0; i < 10000; i++) { /* swapped: that of another request */
        eipSession s = sessionOf(i & 1), other;
        epicsUInt8 message[] = {eipReadTag, 0};

        s.handle = 1;
        eipSessionWrap(&s, eipWayNormal, message, 2, frame, sizeof(frame));
        other = s;
        eipSessionWrap(&s, eipWayNormal, message, 2, frame, sizeof(frame));
        n = bytesOf(i & 1 ? connected : good, frame);
        memset(frame + 4, 0, 4);
        frame[4] = 1;
        memcpy(frame + 12, other.context, 8);
        if (i & 1)
            eipSetUnsigned(frame + 44, 2, other.sequence);
        passed += eipSessionUnwrap(&s, frame, n, &a, why, sizeof(why)) == 0;
    }
    testOk(!passed, "10,000 answers of the request before are refused");
    for (i = 0; i < 10000; i++) { /* one byte of the head is another one */
        eipSession s = sessionOf(i & 1);

        n = bytesOf(i & 1 ? connected : good, right);
        memcpy(frame, right, n);
        k = randomBelow(24);
        frame[k] ^= (epicsUInt8)(1 + randomBelow(255));
        passed += eipSessionUnwrap(&s, frame, n, &a, why, sizeof(why)) == 0;
    }
    testOk(!passed, "10,000 answers with another byte in the header are refused");
    for (i = 0; i < 10000; i++) { /* cut */
        eipSession s = sessionOf(i & 1);

        n = bytesOf(i & 1 ? connected : good, frame);
        m = randomBelow((unsigned)n);
        if (i & 2 && m >= eipHeaderSize)
            eipSetUnsigned(frame + 2, 2, m - eipHeaderSize);
        if (eipSessionUnwrap(&s, frame, m, &a, why, sizeof(why)) == 0)
            wrong += a.length + 4 > m;
    }
    testOk(!wrong, "10,000 answers that are cut give no bytes that are not there");
    for (i = 0; i < 10000; i++) { /* random */
        eipSession s = sessionOf(i & 1);

        n = randomBelow(200);
        for (k = 0; k < n; k++)
            right[k] = (epicsUInt8)randomBelow(256);
        passed += eipSessionUnwrap(&s, right, n, &a, why, sizeof(why)) == 0;
    }
    testOk(!passed, "10,000 frames of random bytes are refused");
    for (i = 0; i < 10000; i++) { /* random message in a good frame */
        eipSession s = sessionOf(0);
        eipAnswer part = {0};

        n = bytesOf(good, frame);
        for (k = 44; k < n; k++)
            frame[k] = (epicsUInt8)randomBelow(256);
        if (eipSessionUnwrap(&s, frame, n, &a, why, sizeof(why)))
            continue;
        for (k = 0; k < 4; k++) {
            const epicsUInt8 *one = eipMultipleTake(&a, randomBelow(3), k, &m);

            if (one && (one < frame || one + m > frame + n))
                wrong++;
            if (one)
                eipAnswerTake(one, m, eipReadTag, &part);
        }
    }
    testOk(!wrong, "10,000 random messages give no bytes that are not there");
}

/* --- The way to a session ----------------------------------------------------------------- */

/* The answer to the request in `frame`, with this status and data. */
static size_t answerTo(unsigned status, const char *data)
{
    epicsUInt8 body[200];
    size_t n = data ? bytesOf(data, body) : 0;
    unsigned command = frame[0];
    eipWriter w = eipWriterOf(frame, sizeof(frame));
    unsigned service = frame[40];
    int routed = service == 0x52 && frame[42] == 0x20 && frame[43] == 0x06;

    if (routed)
        service = frame[50];
    w.n = eipHeaderSize;
    if (command == eipRegisterSession)
        eipSetUnsigned(frame + 4, 4, 0x55);
    if (command == eipSendRRData) {
        eipItemsUnconnected(&w, 0);
        eipPut8(&w, service | 0x80);
        eipPut8(&w, 0);
        eipPut8(&w, status);
        if (status)
            eipPut8(&w, (unsigned)n / 2);
        else
            eipPut8(&w, 0);
    }
    eipPutBytes(&w, body, n);
    if (command == eipSendRRData)
        eipItemsEnd(&w);
    return eipFrameEnd(&w);
}

static const char services[] = "01 00 00 01 14 00 01 00 20 01 43 6F 6D 6D 75 6E 69 63 61 74 69 6F 6E"
                               "73 00 00";
static const char identity[] = "01 00 0E 00 37 00 14 0B 60 31 78 56 34 12 05 31 37 35 36 2D";

static eipConnect connectOf(const char *route, unsigned skip)
{
    eipConnectOptions o = {.connected = 1, .size = eipSizeLarge, .room = eipUnconnectedRoom,
                           .timeout = 5000};
    eipConnect c;

    eipRouteParse(route, &o.route, why, sizeof(why));
    eipConnectInit(&c, &o);
    c.skip = skip;
    eipConnectBegin(&c, 42);
    why[0] = 0;
    return c;
}

/* One step; its number in *step. Returns what eipConnectTake does. */
static int answerStep(eipConnect *c, unsigned status, const char *data)
{
    size_t n = eipConnectNext(c, frame, sizeof(frame));

    return n ? eipConnectTake(c, frame, answerTo(status, data), why, sizeof(why)) : -2;
}

/* Up to the first opening. */
static eipConnect upToOpening(const char *route)
{
    eipConnect c = connectOf(route, 0);

    answerStep(&c, 0, services);
    answerStep(&c, 0, "01 00 00 00");
    answerStep(&c, 0, identity);
    return c;
}

/* A good answer to an opening: the ids that were asked for. */
static void accept(eipConnect *c)
{
    epicsUInt8 data[26] = {0x78, 0x56, 0x34, 0x12};
    const eipOpening *o = &c->session.opening;
    char text[80] = "";
    size_t i;

    eipConnectNext(c, frame, sizeof(frame));
    eipSetUnsigned(data + 4, 4, o->id);
    eipSetUnsigned(data + 8, 2, o->serial);
    eipSetUnsigned(data + 10, 2, o->vendor);
    eipSetUnsigned(data + 12, 4, o->originator);
    for (i = 0; i < sizeof(data); i++)
        sprintf(text + strlen(text), "%02X ", data[i]);
    eipConnectTake(c, frame, answerTo(0, text), why, sizeof(why));
}

static void testOpening(void)
{
    eipConnect c = upToOpening("1,0");
    epicsUInt8 request[80];
    size_t n;

    testOk(c.identity.known && c.identity.vendor == 1 && c.identity.major == 20 &&
               strcmp(c.identity.name, "1756-") == 0,
           "the identity: %s", c.identity.name);
    testOk(c.step == eipStepLarge, "a large connection is tried first");
    c = connectOf("1,0", 0);
    answerStep(&c, 0, services);
    answerStep(&c, 0, "01 00 00 00");
    answerStep(&c, 0, "01 00 0E 00 37 00 14 0B 60 31 78 56 34 12 05 31 37 35 36 2D 41 42 43 44 FF");
    testOk(strcmp(c.identity.name, "1756-") == 0, "what stands behind the name is not of it: %s", c.identity.name);
    n = eipConnectNext(&c, frame, sizeof(frame));
    memcpy(request, frame + 40, n - 40);
    memset(request + 12, 0, 12); /* numbers that differ each time */
    isBytes("Large Forward Open", request, n - 40,
            "5B 02 20 06 24 01 0A 05 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00"
            "02 00 00 00 80 84 1E 00 A2 0F 00 42 80 84 1E 00 A2 0F 00 42 A3 03 01 00 20 02 24 01");
    accept(&c);
    testOk(c.step == eipStepDone && c.session.connected && c.room == 4000 &&
               c.session.opened.toPlc == 0x12345678,
           "a connection of 4002 bytes: 4000 of a message");
    n = eipConnectClose(&c, frame, sizeof(frame));
    testOk(n > 60 && frame[40] == eipForwardClose, "and it is closed");
}

static void testRefusals(void)
{
    eipConnect c = connectOf("", 0);
    epicsUInt32 id;
    int i;

    answerStep(&c, 0, services);
    answerStep(&c, 0, "01 00 00 00");
    isBytes("the question for the identity", frame + 40, eipConnectNext(&c, frame, sizeof(frame)) - 40,
            "01 02 20 01 24 01");
    c = upToOpening("1,0");
    for (i = 0; i < 4; i++)
        answerStep(&c, 0x01, "00 01");
    testOk(c.step == eipStepSmall && c.session.opening.size == 504,
           "the number of a large connection is in use four times: a small one");
    c = upToOpening("1,0");

    answerStep(&c, 0x08, NULL);
    testOk(c.step == eipStepSmall && c.session.opening.size == 504,
           "no Large Forward Open: Forward Open of 504 bytes");
    accept(&c);
    testOk(c.room == 502, "and a message has 502");
    c = upToOpening("1,0");
    id = c.session.opening.id;
    answerStep(&c, 0x01, "09 01 D0 07");
    testOk(c.step == eipStepLarge && c.session.opening.size == 2000 && c.learned,
           "the size that the refusal names: 2000 bytes");
    testOk(c.session.opening.id != id, "with another number: the PLC may remember the first one");
    accept(&c);
    testOk(c.room == 1998, "and a message has 1998");
    for (i = 0; i < 2; i++) {
        c = upToOpening("1,0");
        answerStep(&c, 0x01, i ? "09 01 A2 0F" : "09 01 FF FF");
        testOk(c.step == eipStepSmall && c.session.opening.size == 504 && !c.learned,
               "a refusal that names %s is no smaller size: a small connection",
               i ? "the size that was asked for" : "65535 bytes");
    }
    c = upToOpening("1,0");
    answerStep(&c, 0x01, "09 01 F4 01");
    testOk(c.step == eipStepSmall && c.session.opening.size == 500,
           "a size below 512 is no large connection");
    id = c.session.opening.id;
    answerStep(&c, 0x01, "00 01");
    testOk(c.step == eipStepSmall && c.session.opening.id != id,
           "in use: another number is tried");
    answerStep(&c, 0x08, NULL);
    testOk(c.step == eipStepDone && !c.session.connected && c.room == 490,
           "no connection at all: unconnected, 490 bytes");
    c = upToOpening("1,0");
    testOk(answerStep(&c, 0x01, "12 03") == -1 &&
               strcmp(why, "no module in that slot (01 0312)") == 0,
           "an empty slot ends it: %s", why);
    c = upToOpening("1,0");
    testOk(answerStep(&c, 0x01, "11 03") == -1 && strcmp(why, "no backplane: slot -1 (01 0311)") == 0,
           "a slot where there is none: %s", why);
    c = upToOpening("");
    testOk(answerStep(&c, 0x01, "15 03") == -1 &&
               strcmp(why, "no controller, slot needed (01 0315)") == 0,
           "none where there is one: %s", why);
    c = upToOpening("");
    accept(&c);
    testOk(c.session.connected, "slot -1 opens a connection, too");
}

/* A device that never answers a step, session by session: 1 where it was asked for it. */
static void testAsksAgain(void)
{
    static const char wanted[] = "11.1..1....1";
    char asked[sizeof(wanted)] = "";
    eipConnect c = connectOf("1,0", 0);
    int again = 0;
    size_t i;

    testOk(eipConnectOpened(&c) == 0, "all steps are answered: nothing is asked again");
    for (i = 0; i + 1 < sizeof(wanted); i++) {
        asked[i] = c.skip ? '.' : '1';
        c.step = eipStepLarge;
        eipConnectNoAnswer(&c);
        again += eipConnectOpened(&c);
    }
    testOk(strcmp(asked, wanted) == 0 && again == 1,
           "a step without an answer is asked again in sessions %s, at once after the first", asked);
    c.skip = 0;
    eipConnectOpened(&c);
    c.step = eipStepIdentity;
    eipConnectNoAnswer(&c);
    testOk(eipConnectOpened(&c) == 1 && !c.skip, "at once again, after a session with all steps");
}

static void testSteps(void)
{
    eipConnect c = connectOf("1,0", 0);
    size_t n;

    n = eipConnectNext(&c, frame, sizeof(frame));
    eipSetUnsigned(frame + 8, 4, 1); /* a command that is not known */
    testOk(n && eipConnectTake(&c, frame, n, why, sizeof(why)) == 0 &&
               c.step == eipStepRegister,
           "no ListServices: on to RegisterSession");
    testOk(eipConnectNoAnswer(&c) == 0, "RegisterSession is never left out");
    c = connectOf("1,0", 0);
    eipConnectNext(&c, frame, sizeof(frame));
    testOk(eipConnectNoAnswer(&c) == 1, "a ListServices without an answer");
    eipConnectBegin(&c, 43);
    testOk(c.step == eipStepRegister, "is left out the next time");
    c = connectOf("1,0", 1u << eipStepLarge);
    testOk(c.step == eipStepList, "another step that is left out does not leave it out");
    c.options.connected = 0;
    answerStep(&c, 0, services);
    answerStep(&c, 0, "01 00 00 00");
    testOk(answerStep(&c, 0, identity) == 0 && c.step == eipStepDone && !c.session.connected,
           "unconnected: nothing is opened");
    c = connectOf("1,0", 0);
    testOk(answerStep(&c, 0,
                      "01 00 00 01 14 00 01 00 00 01 43 6F 6D 6D 75 6E 69 63 61 74 69 6F 6E"
                      "73 00 00") == -1 &&
               strcmp(why, "no CIP over TCP there") == 0,
           "a server without CIP over TCP is refused: %s", why);
    c = connectOf("1,0", 0);
    testOk(answerStep(&c, 0, "01 00 00 01 02 00 AA BB") == 0 && c.step == eipStepRegister,
           "an item too short to tell is not read beyond its end");
    c = connectOf("1,0", 1u << eipStepList);
    eipConnectNext(&c, frame, sizeof(frame));
    eipSetUnsigned(frame + 8, 4, 1);
    eipSetUnsigned(frame + 4, 4, 9);
    testOk(eipConnectTake(&c, frame, 28, why, sizeof(why)) == -1 &&
               strcmp(why, "session refused: command not known to") == 0,
           "a session that is refused ends it: %s", why);
    c = connectOf("1,0", 0);
    answerStep(&c, 0, services);
    answerStep(&c, 0, "01 00 00 00");
    answerStep(&c, 0, "01 00 0E 00 37 00 14 0B 60 31 78 56 34 12 06 32 30 38 30 2D 4C");
    testOk(c.multiple == 1, "a Micro800 gets one service in a message");
    c = connectOf("1,0", 0);
    answerStep(&c, 0, services);
    answerStep(&c, 0, "01 00 00 00");
    answerStep(&c, 0, "2F 00 0E 00 37 00 14 0B 60 31 78 56 34 12 02 4E 4A");
    testOk(c.multiple == 32, "an Omron at most 32");
    c = connectOf("1,0", 0);
    answerStep(&c, 0, services);
    answerStep(&c, 0, "01 00 00 00");
    answerStep(&c, 0x08, NULL);
    testOk(c.step == eipStepLarge && !c.identity.known, "a PLC without identity is good, too");
}

/* Each status in words; what stands for any extended status has none here. */
static const struct {
    unsigned status, extended;
    const char *text;
} statusWords[] = {
    {0x01, 0x0100, "connection in use (01 0100)"},
    {0x01, 0x0107, "connection not known (01 0107)"},
    {0x01, 0x0109, "connection size refused (01 0109)"},
    {0x01, 0x0113, "no connection left in PLC (01 0113)"},
    {0x01, 0x0203, "connection timed out (01 0203)"},
    {0x01, 0x0204, "no answer from controller (01 0204)"},
    {0x01, 0x0205, "error on the way to the slot (01 0205)"},
    {0x01, 0x0311, "no such port in the route (01 0311)"},
    {0x01, 0x0312, "no module in that slot (01 0312)"},
    {0x01, 0x0315, "route not understood (01 0315)"},
    {0x01, 0x0318, "route leads back to itself (01 0318)"},
    {0x01, 0, "connection failed (01)"},
    {0x02, 0, "PLC has no resources left (02)"},
    {0x03, 0, "value not valid (03)"},
    {0x04, 0, "no such tag or member (04)"},
    {0x05, 0, "no such tag (05)"},
    {0x06, 0, "does not fit one answer (06)"},
    {0x08, 0, "PLC has no such service (08)"},
    {0x09, 0, "attribute value not valid (09)"},
    {0x0a, 0, "attribute not known (0A)"},
    {0x0c, 0, "not possible in this state (0C)"},
    {0x0d, 0, "exists already (0D)"},
    {0x0e, 0, "cannot be written (0E)"},
    {0x0f, 0, "no right to access it (0F)"},
    {0x10, 0x2101, "key switch not in REM (10 2101)"},
    {0x10, 0, "not possible in this mode (10)"},
    {0x11, 0, "answer too long (11)"},
    {0x13, 0, "PLC got too few data (13)"},
    {0x14, 0, "attribute not supported (14)"},
    {0x15, 0, "PLC got too many data (15)"},
    {0x16, 0, "no such object (16)"},
    {0x1e, 0, "one of several has failed (1E)"},
    {0x20, 0, "parameter not valid (20)"},
    {0x20, 0x8017, "is no array (20 8017)"},
    {0x20, 0x8018, "index beyond the end (20 8018)"},
    {0x20, 0x8022, "tag has another type (20 8022)"},
    {0x20, 0x8009, "parameter not valid (20 8009)"},
    {0x26, 0, "path size not valid (26)"},
    {0xff, 0x2104, "offset beyond the end (FF 2104)"},
    {0xff, 0x2105, "index beyond the end (FF 2105)"},
    {0xff, 0x2107, "tag has another type (FF 2107)"},
    {0xff, 0x210a, "tag name not understood (FF 210A)"},
    {0xff, 0, "general error (FF)"},
    {0x01, 0x0999, "connection failed (01 0999)"},
    {0x77, 0, "error (77)"},
    {0x77, 0x1234, "error (77 1234)"},
};

static const struct {
    epicsUInt32 status;
    const char *text;
} frameWords[] = {
    {0x00, "success"},
    {0x01, "command not known to the PLC"},
    {0x02, "no memory left in the PLC"},
    {0x03, "data not understood by the PLC"},
    {0x64, "session not known to the PLC"},
    {0x65, "length not understood by the PLC"},
    {0x69, "protocol revision not supported"},
    {0x66, "encapsulation error"},
};

static void testStatusWords(void)
{
    char text[60];
    size_t i;

    for (i = 0; i < COUNT(statusWords); i++) {
        eipStatusText(statusWords[i].status, statusWords[i].extended, text, sizeof(text));
        testOk(strcmp(text, statusWords[i].text) == 0, "%s", text);
    }
    for (i = 0; i < COUNT(frameWords); i++)
        testOk(strcmp(eipFrameStatusText(frameWords[i].status), frameWords[i].text) == 0,
               "of a frame: %s", eipFrameStatusText(frameWords[i].status));
}

/* What each make of controller says. */
static void testKinds(void)
{
    static const struct {
        unsigned status, extended;
        int isEnd, isOtherType;
    } rows[] = {{0xff, 0x2105, 1, 0}, {0x20, 0x8018, 1, 0}, {0xff, 0x8018, 0, 0}, {0x20, 0x2105, 0, 0},
                {0xff, 0x2107, 0, 1}, {0x20, 0x8022, 0, 1}, {0xff, 0x8022, 0, 0}, {0x20, 0x2107, 0, 0},
                {0x05, 0x2105, 0, 0}, {0x20, 0x8017, 0, 0}, {0xff, 0, 0, 0}};
    size_t i;

    for (i = 0; i < COUNT(rows); i++) {
        eipAnswer a = {.status = rows[i].status, .extended = rows[i].extended};

        testOk(eipAnswerIsEnd(&a) == rows[i].isEnd && eipAnswerIsOtherType(&a) == rows[i].isOtherType,
               "%02X %04X is%s", a.status, a.extended,
               rows[i].isEnd ? " beyond the end" : rows[i].isOtherType ? " another type" : " neither");
    }
}

static void testWords(void)
{
    char text[60];
    static const unsigned tags[][2] = {
        {0x04, 0}, {0x05, 0}, {0x06, 0}, {0x08, 0}, {0x0e, 0}, {0x0f, 0}, {0x10, 0x2101},
        {0x13, 0}, {0x15, 0}, {0xff, 0x2104}, {0xff, 0x2105}, {0xff, 0x2107}};
    unsigned status, extended, longest = 0, i;

    for (status = 0; status < 256; status++)
        for (extended = 0; extended < 0x3000; extended++) {
            eipStatusText(status, extended, text, sizeof(text));
            if (strlen(text) > longest)
                longest = (unsigned)strlen(text);
        }
    testOk(longest <= 38, "no status has more than AMSG, 38 characters: %u", longest);
    for (i = 0, longest = 0; i < sizeof(tags) / sizeof(tags[0]); i++) {
        eipStatusText(tags[i][0], tags[i][1], text, sizeof(text));
        if (strlen(text) > longest)
            longest = (unsigned)strlen(text);
    }
    testOk(longest <= 33, "nor has one about a tag, behind \"PLC: \": %u and 5", longest);
    eipStatusText(0xff, 0x2105, text, sizeof(text));
    testOk(strcmp(text, "index beyond the end (FF 2105)") == 0, "%s", text);
}

MAIN(eipFrameTest)
{
    testPlan(0);
    testRoutes();
    testWays();
    testMultiple();
    testLies();
    testRandom();
    testOpening();
    testRefusals();
    testSteps();
    testAsksAgain();
    testWords();
    testStatusWords();
    testKinds();
    return testDone();
}
