/* plcSimTestEipServer: the simulator's EtherNet/IP server over loopback: sessions, frames
 * that are wrong, CIP connections and who owns them, each fault as the client sees it,
 * and frames of any bytes.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcSimBuilt.h"
#include "plcSimClient.h"
#include "simEipFrame.h"
#include "simEipServer.h"

static plcSimBuilt built;
static simEip *eip; /* of its server */

static void setUp(const char *more)
{
    char text[500];

    snprintf(text, sizeof(text),
             "port = off\nbyteorder = little\netherip_port = 0\nperiod = 5 ms\n"
             "tag D DINT = 0x11223344\ntag I INT[1000]\n%s",
             more);
    plcSimStart(&built, &clientLoop, text);
    eip = &((simEipServer *)simPlcServerOf(&built.plc, &simEipServerType))->eip;
}

static void tearDown(void)
{
    plcSimDismantle(&built);
    simLoopFree(&clientLoop);
}

static void command(const char *line)
{
    char text[100], error[SIM_ERROR_SIZE];
    char *words[20];
    int count;

    strcpy(text, line);
    count = simSplit(text, words, 20, error);
    if (simEipFaultParse(&eip->controller.faults, words, (size_t)count, error))
        testAbort("%s: %s", line, error);
}

/* ---- frames ---- */

#define CONTEXT "01 02 03 04 05 06 07 08 "
#define REGISTER "65 00 04 00 00 00 00 00 00 00 00 00 " CONTEXT "00 00 00 00 01 00 00 00"
#define READ_D "4c 02 91 01 44 00 01 00"
#define IS_D "cc 00 00 00 c4 00 44 33 22 11"

static int openClient(void)
{
    return clientOpen(&eip->clients);
}

/* The session of the newest client, as the registration tells it. */
static unsigned long register_(int fd)
{
    epicsUInt8 bytes[28];

    clientSay(fd, REGISTER);
    if (clientHear(fd, bytes, 28) != 28 || bytes[0] != 0x65 || bytes[8])
        testDiag("no session");
    return (unsigned long)simEipGet(bytes + 4, 4);
}

static const char *le32(unsigned long value)
{
    static char texts[4][13];
    static unsigned next;
    char *text = texts[next++ % 4];

    sprintf(text, "%02lx %02lx %02lx %02lx ", value & 0xFF, value >> 8 & 0xFF,
            value >> 16 & 0xFF, value >> 24 & 0xFF);
    return text;
}

static size_t hexSize(const char *hex)
{
    return (strlen(hex) + 1) / 3;
}

/* A message without a connection. */
static void sayDirect(int fd, unsigned long session, const char *message)
{
    char frame[4000];
    size_t size = hexSize(message);

    sprintf(frame,
            "6f 00 %02x %02x %s00 00 00 00 " CONTEXT "00 00 00 00 "
            "00 00 00 00 0a 00 02 00 00 00 00 00 b2 00 %02x %02x %s",
            (unsigned)(size + 16) & 0xFF, (unsigned)(size + 16) >> 8, le32(session),
            (unsigned)size & 0xFF, (unsigned)size >> 8, message);
    clientSay(fd, frame);
}

static int hearsDirect(int fd, unsigned long session, const char *message)
{
    char frame[4000];
    size_t size = hexSize(message);

    sprintf(frame,
            "6f 00 %02x %02x %s00 00 00 00 " CONTEXT "00 00 00 00 "
            "00 00 00 00 00 00 02 00 00 00 00 00 b2 00 %02x %02x %s",
            (unsigned)(size + 16) & 0xFF, (unsigned)(size + 16) >> 8, le32(session),
            (unsigned)size & 0xFF, (unsigned)size >> 8, message);
    return clientHears(fd, frame);
}

/* A message on a connection. */
static void sayConnected(int fd, unsigned long session, unsigned long id,
                         unsigned sequence, const char *message)
{
    char frame[4000];
    size_t size = hexSize(message) + 2;

    sprintf(frame,
            "70 00 %02x %02x %s00 00 00 00 " CONTEXT "00 00 00 00 "
            "00 00 00 00 0a 00 02 00 a1 00 04 00 %sb1 00 %02x %02x %02x %02x %s",
            (unsigned)(size + 20) & 0xFF, (unsigned)(size + 20) >> 8, le32(session),
            le32(id), (unsigned)size & 0xFF, (unsigned)size >> 8, sequence & 0xFF,
            sequence >> 8, message);
    clientSay(fd, frame);
}

static int hearsConnected(int fd, unsigned long session, unsigned sequence,
                          const char *message)
{
    char frame[4000];
    size_t size = hexSize(message) + 2;

    sprintf(
        frame,
        "70 00 %02x %02x %s00 00 00 00 " CONTEXT "00 00 00 00 "
        "00 00 00 00 00 00 02 00 a1 00 04 00 44 33 22 11 b1 00 %02x %02x %02x %02x %s",
        (unsigned)(size + 20) & 0xFF, (unsigned)(size + 20) >> 8, le32(session),
        (unsigned)size & 0xFF, (unsigned)size >> 8, sequence & 0xFF, sequence >> 8,
        message);
    return clientHears(fd, frame);
}

/* A header alone. */
static int hearsError(int fd, unsigned commandCode, unsigned long session,
                      unsigned status)
{
    char frame[200];

    sprintf(frame, "%02x 00 00 00 %s%02x 00 00 00 " CONTEXT "00 00 00 00", commandCode,
            le32(session), status);
    return clientHears(fd, frame);
}

static int works(int fd, unsigned long session)
{
    sayDirect(fd, session, READ_D);
    return hearsDirect(fd, session, IS_D);
}

static int freshWorks(void)
{
    int fd = openClient();
    int good = works(fd, register_(fd));

    close(fd);
    return good;
}

/* Opens a connection of 500 bytes; its answers carry 11223344. Returns the id that
 * requests carry, 0 when it was refused. */
static unsigned long openConnection(int fd, unsigned long session, unsigned serial)
{
    char request[300];
    epicsUInt8 bytes[70];

    sprintf(request,
            "54 02 20 06 24 01 0a 0e 00 00 00 00 44 33 22 11 %02x %02x 37 13 2a 00 00 00 "
            "01 00 00 00 40 42 0f 00 f4 43 40 42 0f 00 f4 43 a3 03 01 00 20 02 24 01",
            serial & 0xFF, serial >> 8);
    sayDirect(fd, session, request);
    if (clientHear(fd, bytes, 44) != 44 || bytes[42])
        return 0;
    clientHear(fd, bytes + 44, 26);
    return (unsigned long)simEipGet(bytes + 44, 4);
}

/* ---- the encapsulation ---- */

/* clang-format off */
static const struct {
    const char *what, *say, *hear;
} frames[] = {
    {"ListServices: CIP over TCP",
     "04 00 00 00 00 00 00 00 00 00 00 00 " CONTEXT "00 00 00 00",
     "04 00 1a 00 00 00 00 00 00 00 00 00 " CONTEXT "00 00 00 00 01 00 00 01 14 00 01 00 "
     "20 01 43 6f 6d 6d 75 6e 69 63 61 74 69 6f 6e 73 00 00"},
    {"ListInterfaces: none",
     "64 00 00 00 00 00 00 00 00 00 00 00 " CONTEXT "00 00 00 00",
     "64 00 02 00 00 00 00 00 00 00 00 00 " CONTEXT "00 00 00 00 00 00"},
    {"ListIdentity: address, port, identity",
     "63 00 00 00 00 00 00 00 00 00 00 00 " CONTEXT "00 00 00 00",
     "63 00 33 00 00 00 00 00 00 00 00 00 " CONTEXT "00 00 00 00 01 00 0c 00 2d 00 01 00 "
     "00 02 ## ## 7f 00 00 01 00 00 00 00 00 00 00 00 01 00 0e 00 a6 00 21 0b 60 30 ee ff "
     "c0 00 0b 31 37 35 36 2d 4c 38 33 45 2f 42 03"},
    {"a NOP gets nothing, what comes behind it an answer",
     "00 00 02 00 00 00 00 00 00 00 00 00 " CONTEXT "00 00 00 00 00 00 "
     "64 00 00 00 00 00 00 00 00 00 00 00 " CONTEXT "00 00 00 00",
     "64 00 02 00 00 00 00 00 00 00 00 00 " CONTEXT "00 00 00 00 00 00"},
    {"options that are not 0 neither",
     "64 00 00 00 00 00 00 00 00 00 00 00 " CONTEXT "01 00 00 00 "
     "64 00 00 00 00 00 00 00 00 00 00 00 " CONTEXT "00 00 00 00",
     "64 00 02 00 00 00 00 00 00 00 00 00 " CONTEXT "00 00 00 00 00 00"},
    {"a command that is not known: 01",
     "99 00 00 00 00 00 00 00 00 00 00 00 " CONTEXT "00 00 00 00",
     "99 00 00 00 00 00 00 00 01 00 00 00 " CONTEXT "00 00 00 00"},
    {"a registration without data: 65",
     "65 00 00 00 00 00 00 00 00 00 00 00 " CONTEXT "00 00 00 00",
     "65 00 00 00 00 00 00 00 65 00 00 00 " CONTEXT "00 00 00 00"},
    {"of version 2: 69",
     "65 00 04 00 00 00 00 00 00 00 00 00 " CONTEXT "00 00 00 00 02 00 00 00",
     "65 00 00 00 00 00 00 00 69 00 00 00 " CONTEXT "00 00 00 00"},
    {"a message without a session: 64",
     "6f 00 18 00 00 00 00 00 00 00 00 00 " CONTEXT "00 00 00 00 00 00 00 00 0a 00 02 00 "
     "00 00 00 00 b2 00 08 00 " READ_D,
     "6f 00 00 00 00 00 00 00 64 00 00 00 " CONTEXT "00 00 00 00"},
};

/* Behind a registration; the session stands at S. */
static const struct {
    const char *what, *data;
    unsigned command, status;
} items[] = {
    {"no data", "", 0x6F, 0x65},
    {"an interface", "01 00 00 00 0a 00 02 00 00 00 00 00 b2 00 08 00 " READ_D, 0x6F, 3},
    {"three items", "00 00 00 00 0a 00 03 00 00 00 00 00 b2 00 08 00 " READ_D, 0x6F, 3},
    {"one item", "00 00 00 00 0a 00 01 00 b2 00 08 00 " READ_D, 0x6F, 3},
    {"an address that is not empty",
     "00 00 00 00 0a 00 02 00 00 00 02 00 00 00 b2 00 08 00 " READ_D, 0x6F, 3},
    {"another first item", "00 00 00 00 0a 00 02 00 a1 00 00 00 b2 00 08 00 " READ_D,
     0x6F, 3},
    {"another second item", "00 00 00 00 0a 00 02 00 00 00 00 00 b1 00 08 00 " READ_D,
     0x6F, 3},
    {"a length that is too short", "00 00 00 00 0a 00 02 00 00 00 00 00 b2 00 07 00 "
     READ_D, 0x6F, 3},
    {"a length that is too long", "00 00 00 00 0a 00 02 00 00 00 00 00 b2 00 09 00 "
     READ_D, 0x6F, 3},
    {"70 without a connection", "00 00 00 00 0a 00 02 00 00 00 00 00 b1 00 0a 00 01 00 "
     READ_D, 0x70, 3},
    {"70 with half an id", "00 00 00 00 0a 00 02 00 a1 00 02 00 01 00 b1 00 0a 00 01 00 "
     READ_D, 0x70, 3},
    {"70 without a sequence count",
     "00 00 00 00 0a 00 02 00 a1 00 04 00 01 00 00 00 b1 00 01 00 01", 0x70, 3},
    {"70 with an id that nobody has",
     "00 00 00 00 0a 00 02 00 a1 00 04 00 01 00 00 00 b1 00 0a 00 01 00 " READ_D, 0x70,
     1},
};
/* clang-format on */

static void testFrames(void)
{
    int fd = openClient();
    size_t i;

    for (i = 0; i < sizeof(frames) / sizeof(frames[0]); i++) {
        clientSay(fd, frames[i].say);
        testOk(clientHears(fd, frames[i].hear), "%s", frames[i].what);
    }
    close(fd);
}

static void testItems(void)
{
    int fd = openClient();
    unsigned long session = register_(fd);
    size_t i;

    for (i = 0; i < sizeof(items) / sizeof(items[0]); i++) {
        char frame[400];

        sprintf(frame, "%02x 00 %02x 00 %s00 00 00 00 " CONTEXT "00 00 00 00 %s",
                items[i].command, (unsigned)hexSize(items[i].data), le32(session),
                items[i].data);
        clientSay(fd, frame);
        testOk(hearsError(fd, items[i].command, session, items[i].status), "%s: %02x",
               items[i].what, items[i].status);
    }
    testOk(works(fd, session), "the session goes on all the same");
    close(fd);
}

static void testSessions(void)
{
    int one = openClient(), two = openClient();
    unsigned long first = register_(one), second = register_(two);
    char frame[200];
    size_t i;

    testOk(first && second && first != second, "two clients have two sessions");
    sayDirect(one, second, READ_D);
    testOk(hearsError(one, 0x6F, second, 0x64), "one has no use for the other's: 64");
    testOk(works(one, first) && works(two, second), "both work");
    clientSay(one, REGISTER);
    testOk(hearsError(one, 0x65, 0, 1), "a second registration: 01");
    sprintf(frame, "66 00 00 00 %s00 00 00 00 " CONTEXT "00 00 00 00", le32(first));
    clientSay(one, frame);
    testOk(clientHearsEnd(one) == ENDED, "UnregisterSession ends the connection");
    testOk(works(two, second), "not the other's");
    sprintf(frame,
            "6f 00 18 00 %s00 00 00 00 " CONTEXT "00 00 00 00 00 00 00 00 0a 00 02 00 "
            "00 00 00 00 b2 00 08 00 " READ_D,
            le32(second));
    for (i = 0; frame[i]; i += 3) {
        char byte[3] = {frame[i], frame[i + 1], 0};

        clientSay(two, byte);
        clientTurn();
        if (!frame[i + 2])
            break;
    }
    testOk(hearsDirect(two, second, IS_D), "a frame in single bytes is answered");
    close(one);
    close(two);
}

/* ---- CIP connections ---- */

static void testConnected(void)
{
    int fd = openClient();
    unsigned long session = register_(fd);
    unsigned long id = openConnection(fd, session, 1);
    char error[SIM_ERROR_SIZE];
    simEipPlace place;

    testOk(id != 0, "a connection opens");
    sayConnected(fd, session, id, 7, READ_D);
    testOk(hearsConnected(fd, session, 7, IS_D),
           "a request on it: the answer has the client's id and the sequence count");
    simEipTagsPlace(&eip->controller.tags, "D", &place, error);
    place.bytes[0] = 0x55;
    sayConnected(fd, session, id, 7, READ_D);
    testOk(hearsConnected(fd, session, 7, IS_D), "the same count again: the same answer");
    sayConnected(fd, session, id, 8, READ_D);
    testOk(hearsConnected(fd, session, 8, "cc 00 00 00 c4 00 55 33 22 11"),
           "the next one is served");
    testOk(eip->controller.connections.duplicates == 1, "duplicates are counted");
    place.bytes[0] = 0x44;
    close(fd);
}

static void testSizes(void)
{
    int fd = openClient();
    unsigned long session = register_(fd);
    unsigned long id = openConnection(fd, session, 2);
    char write[4000] = "4d 02 91 01 49 00 c3 00 f2 00";
    epicsUInt8 bytes[600];
    int i;

    for (i = 0; i < 242; i++) /* with path, type, count and sequence 496 bytes */
        strcat(write, " 01 00");
    sayConnected(fd, session, id, 1, write);
    testOk(hearsConnected(fd, session, 1, "cd 00 00 00"), "a write of 496 bytes");
    strcpy(write, "4d 02 91 01 49 00 c3 00 f5 00");
    for (i = 0; i < 245; i++)
        strcat(write, " 01 00");
    sayConnected(fd, session, id, 2, write);
    testOk(hearsError(fd, 0x70, session, 0x65), "of 502 bytes, more than it has: 65");
    sayConnected(fd, session, id, 3, "4c 02 91 01 49 00 e8 03");
    testOk(clientHear(fd, bytes, 544) == 544 && bytes[48] == 6 && bytes[42] == 0xF4 &&
               bytes[43] == 1,
           "1000 INT: 06 and as many as fit in 500 bytes");
    sayDirect(fd, session, "4c 02 91 01 49 00 e8 03");
    testOk(clientHear(fd, bytes, 544) == 544 && bytes[42] == 6 &&
               simEipGet(bytes + 38, 2) == 504,
           "without a connection: 504 bytes");
    strcpy(write, "4d 02 91 01 49 00 c3 00 10 01");
    for (i = 0; i < 272; i++)
        strcat(write, " 01 00");
    sayDirect(fd, session, write);
    testOk(hearsDirect(fd, session, "cd 00 02 00"), "a write of 554 bytes: no resource");
    close(fd);
}

static void testOwners(void)
{
    int one = openClient(), two = openClient();
    unsigned long first = register_(one), second = register_(two);
    unsigned long id = openConnection(one, first, 3);

    sayConnected(two, second, id, 1, READ_D);
    testOk(hearsError(two, 0x70, second, 1), "a connection belongs to its client: 01");
    close(one);
    UNTIL(eip->clients.count == 1);
    testOk(simEipConnectionFind(&eip->controller.connections, (epicsUInt32)id) != NULL,
           "it outlives its TCP connection");
    sayConnected(two, second, id, 1, READ_D);
    testOk(hearsError(two, 0x70, second, 1), "and belongs to nobody else");
    testOk(openConnection(two, second, 3) == 0, "its triad is in use");
    clientHears(two, "## ## ## ## ## ## ## ## ## ## ## ##");
    sayDirect(two, second,
              "4e 02 20 06 24 01 0a 0e 03 00 37 13 2a 00 00 00 03 00 01 00 20 02 24 01");
    testOk(hearsDirect(two, second, "ce 00 00 00 03 00 37 13 2a 00 00 00 00 00"),
           "anybody may close it by its triad");
    testOk(openConnection(two, second, 3) != 0, "then it opens");
    close(two);
}

static void testTimeouts(void)
{
    int fd = openClient();
    unsigned long session = register_(fd);
    unsigned long id = openConnection(fd, session, 4);
    simEipConnection *k =
        simEipConnectionFind(&eip->controller.connections, (epicsUInt32)id);

    k->timeout = 1e-3;
    UNTIL(simNow() - k->heard > 2e-3);
    sayConnected(fd, session, id, 1, READ_D);
    testOk(hearsError(fd, 0x70, session, 1), "a connection that was silent is gone: 01");
    testOk(works(fd, session), "the session is not");
    eip->lostSilent = 1;
    sayConnected(fd, session, id, 2, READ_D);
    testOk(works(fd, session), "etherip_lostid = silence: no answer to that");
    eip->lostSilent = 0;
    close(fd);
}

/* ---- faults ---- */

/* clang-format off */
static const struct {
    const char *fault;
    const char *hear; /* of a frame that would be 50 bytes */
} spoiled[] = {
    {"wrongcontext next 1", "6f 00 1a 00 ## ## ## ## 00 00 00 00 00 02 03 04 05 06 07 08"},
    {"length 5 next 1", "6f 00 1f 00 ## ## ## ## 00 00 00 00 " CONTEXT "00 00 00 00"},
    {"wrongservice next 1",
     "6f 00 1a 00 ## ## ## ## 00 00 00 00 " CONTEXT "00 00 00 00 00 00 00 00 00 00 02 00 00 "
     "00 00 00 b2 00 0a 00 cd 00 00 00 c4 00 44 33 22 11"},
};
/* clang-format on */

static void testSpoiled(void)
{
    size_t i;

    for (i = 0; i < sizeof(spoiled) / sizeof(spoiled[0]); i++) {
        int fd = openClient();
        unsigned long session = register_(fd);

        command(spoiled[i].fault);
        sayDirect(fd, session, READ_D);
        testOk(clientHears(fd, spoiled[i].hear), "%s", spoiled[i].fault);
        close(fd);
    }
}

static void testConnectedFaults(void)
{
    int fd = openClient();
    unsigned long session = register_(fd);
    unsigned long id = openConnection(fd, session, 5);

    command("wrongsequence connected next 1");
    sayConnected(fd, session, id, 2, READ_D);
    testOk(hearsConnected(fd, session, 3, IS_D), "wrongsequence: 3 instead of 2");
    command("wrongid connected next 1");
    sayConnected(fd, session, id, 4, READ_D);
    testOk(clientHears(fd, "70 00 20 00 ## ## ## ## 00 00 00 00 " CONTEXT
                           "00 00 00 00 00 00 00 00 00 00 02 00 a1 00 04 00 45 33 22 11 "
                           "b1 00 0c 00 04 00 " IS_D),
           "wrongid: 11223345");
    command("wrongsession next 1");
    sayConnected(fd, session, id, 5, READ_D);
    testOk(hearsConnected(fd, session ^ 1, 5, IS_D), "wrongsession");
    sayConnected(fd, session, id, 6, "4c 02 91 01 49 00 01 00");
    hearsConnected(fd, session, 6, "cc 00 00 00 c3 00 01 00");
    command("old next 1");
    sayConnected(fd, session, id, 7, READ_D);
    testOk(hearsConnected(fd, session, 7, "cc 00 00 00 c3 00 01 00"),
           "old: the data of the answer before");
    command("swap next 1");
    sayConnected(fd, session, id, 8, READ_D);
    sayConnected(fd, session, id, 9, "4c 02 91 01 49 00 01 00");
    testOk(hearsConnected(fd, session, 9, "cc 00 00 00 c3 00 01 00") &&
               hearsConnected(fd, session, 8, IS_D),
           "swap: the answer comes behind the next one");
    close(fd);
}

/* Its lowest byte */
#define WRITE_D(byte) "4d 02 91 01 44 00 c4 00 01 00 " byte " 33 22 11"

static void testEnds(void)
{
    int fd = openClient(), slow = openClient();
    unsigned long session = register_(fd), other = register_(slow);
    char error[SIM_ERROR_SIZE];
    epicsUInt8 bytes[100], *d;
    simEipPlace place;
    double start;

    simEipTagsPlace(&eip->controller.tags, "D", &place, error);
    d = place.bytes;
    command("silent next 1");
    sayDirect(fd, session, "4d 02 91 01 44 00 c4 00 01 00 01 02 03 04");
    testOk(works(fd, session),
           "silent: nothing is done, nothing is said; the next works");
    testOk(eip->counts.silent == 1, "which is counted");
    command("garbage 10 next 1");
    sayDirect(fd, session, WRITE_D("45"));
    testOk(clientHear(fd, bytes, 10) == 10 && d[0] == 0x45, "garbage: it is done, 10 bytes");
    command("slow 60 next 1");
    start = simNow();
    sayDirect(fd, session, WRITE_D("44"));
    UNTIL(d[0] == 0x44);
    testOk(d[0] == 0x44, "slow: it is done");
    testOk(hearsDirect(fd, session, "cd 00 00 00") && simNow() - start >= 0.06,
           "slow: the answer comes, not before its time");
    command("slow 3600000 next 1");
    sayDirect(slow, other, WRITE_D("46"));
    UNTIL(d[0] == 0x46);
    testOk(d[0] == 0x46 && recv(slow, bytes, 1, MSG_DONTWAIT) < 0, "slow: it is done at once");
    close(slow);
    command("short 30 next 1");
    sayDirect(fd, session, WRITE_D("44"));
    testOk(clientHear(fd, bytes, 30) == 30 && d[0] == 0x44, "short: it is done, 30 bytes");
    sayDirect(fd, session, READ_D);
    UNTIL(eip->counts.silent == 2);
    testOk(recv(fd, bytes, 1, MSG_DONTWAIT) < 0, "and nothing more");
    close(fd);
    fd = openClient();
    session = register_(fd);
    command("close next 1");
    sayDirect(fd, session, WRITE_D("47"));
    testOk(clientHear(fd, bytes, 99) == 22 && clientHearsEnd(fd) == ENDED && d[0] == 0x47,
           "close: it is done, half of the answer, then the end");
    close(fd);
    fd = openClient();
    session = register_(fd);
    command("drop next 1");
    sayDirect(fd, session, WRITE_D("48"));
    testOk(clientHearsEnd(fd) == ENDED && d[0] == 0x47, "drop: nothing is done, the end");
    d[0] = 0x44;
    close(fd);
    testOk(freshWorks() && eip->controller.faults.count == 0, "all faults are used up");
}

/* ---- the PLC ---- */

static void testPower(void)
{
    int fd = openClient();
    unsigned long session = register_(fd);

    openConnection(fd, session, 6);
    simEipPower(eip, 0);
    testOk(clientHearsEnd(fd) == WAS_RESET, "off: the connection is reset");
    testOk(simEipConnectionsCount(&eip->controller.connections) == 0,
           "no CIP connection is left");
    simEipPower(eip, 1);
    testOk(freshWorks(), "on: it works");
    close(fd);
    fd = openClient();
    session = register_(fd);
    simClientsUnplug(&eip->clients, 1);
    sayDirect(fd, session, READ_D);
    clientTurn();
    simClientsUnplug(&eip->clients, 0);
    testOk(hearsDirect(fd, session, IS_D),
           "the cable is back: what was asked is answered");
    close(fd);
}

static void testStatus(void)
{
    int fd = openClient();
    unsigned long session = register_(fd);
    unsigned long id = openConnection(fd, session, 7);
    simText out = {NULL, 0, 0};

    simEipClear(eip);
    sayConnected(fd, session, id, 1,
                 "0a 02 20 02 24 01 02 00 06 00 0e 00 " READ_D
                 " 4c 02 91 01 51 00 01 00");
    hearsConnected(fd, session, 1, "8a 00 1e 00 02 00 06 00 10 00 " IS_D " cc 00 04 00");
    simEipStatus(eip, &out);
    testOk(strstr(out.text,
                  " profile=l8x slot=0 key=remote tags=6 downloads=0 clients=1") != NULL,
           "the status: %.*s", (int)strcspn(out.text, "\n"), out.text);
    testOk(
        strstr(out.text, "etherip requests: total=1 connected=1 answered=1 silent=0") &&
            strstr(out.text, "etherip services: 0a=1 4c=2\n") &&
            strstr(out.text, "etherip statuses: 00=1 04=1 1e=1\n") &&
            strstr(out.text, "etherip largest: request=28 answer=24\n") &&
            strstr(out.text, "request=500 answer=500 timeout=8.000") &&
            strstr(out.text, "etherip faults: none\n"),
        "requests, services, statuses, sizes, connections, faults");
    simTextFree(&out);
    simEipReceived(eip, 5, &out);
    testOk(strstr(out.text, " sequence=1 request=28 answer=24 4c:D=00 4c:Q=04\n") != NULL,
           "the request: %s", out.text);
    simTextFree(&out);
    close(fd);
}

/* ---- anything at all ---- */

static void sayMutated(int fd, const char *hex)
{
    epicsUInt8 bytes[600];
    size_t count = 0;
    unsigned value;
    int used, n = 1 + rand() % 3;

    for (; sscanf(hex, " %2x%n", &value, &used) == 1; hex += used)
        bytes[count++] = (epicsUInt8)value;
    while (n-- > 0)
        bytes[(size_t)rand() % count] = (epicsUInt8)(rand() >> 5);
    if (rand() % 4 == 0)
        count = (size_t)rand() % (count + 1);
    if (send(fd, bytes, count, MSG_NOSIGNAL | MSG_DONTWAIT) < 0)
        return;
}

static void testMutated(void)
{
    int fd = -1, left = 0, n;
    unsigned long session = 0, id = 0;
    char frame[400];
    epicsUInt8 bytes[4096];

    srand(20260406);
    for (n = 0; n < 20000; n++) {
        if (left-- <= 0) {
            if (fd >= 0)
                close(fd);
            fd = openClient();
            session = register_(fd);
            id = openConnection(fd, session, (unsigned)n + 100);
            left = 20 + rand() % 200;
            simEipConnectionsClear(&eip->controller.connections);
        }
        if (n % 2)
            sprintf(frame,
                    "6f 00 18 00 %s00 00 00 00 " CONTEXT
                    "00 00 00 00 00 00 00 00 0a 00 02 "
                    "00 00 00 00 00 b2 00 08 00 " READ_D,
                    le32(session));
        else
            sprintf(frame,
                    "70 00 1e 00 %s00 00 00 00 " CONTEXT
                    "00 00 00 00 00 00 00 00 0a 00 02 "
                    "00 a1 00 04 00 %sb1 00 0a 00 01 00 " READ_D,
                    le32(session), le32(id));
        sayMutated(fd, frame);
        simLoopRun(&clientLoop, simNow());
        while (recv(fd, bytes, sizeof(bytes), MSG_DONTWAIT) > 0)
            ;
    }
    close(fd);
    testOk(freshWorks(), "after 20000 spoiled frames a new client works");
    UNTIL(eip->clients.count == 0);
    testOk(eip->clients.count == 0, "and nobody is left");
}

MAIN(plcSimTestEipServer)
{
    testPlan(77);
    simLogQuiet(2);
    setUp("");
    testFrames();
    testItems();
    testSessions();
    testConnected();
    testSizes();
    testOwners();
    testTimeouts();
    testSpoiled();
    testConnectedFaults();
    testEnds();
    testPower();
    testStatus();
    testMutated();
    tearDown();
    return testDone();
}
