/* A real station, with its thread and its sockets, against a PLC on loopback that the test
 * plays itself: one step of the PLC, then wait for what the station makes of it. */
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <sys/resource.h>
#include <sys/socket.h>

#include <epicsAtomic.h>
#include <epicsStdio.h>
#include <epicsUnitTest.h>
#include <errlog.h>
#include <testMain.h>

#include "plcBlocks.h"
#include "plcStation.h"
#include "plcStationPvt.h"
#include "testTools.h"

#define IN 16
#define OUT 8

static plcStation *make(const char *name, const char *address, int port, size_t in,
                        size_t out, unsigned recvTimeout, unsigned sendInterval)
{
    plcStationConfig config = {.transport = &plcBlocks, .name = name,
                               .address = {address, ""},
                               .port = port,
                               .inSize = in,
                               .outSize = out,
                               .bigEndian = 1,
                               .recvTimeout = recvTimeout,
                               .sendInterval = sendInterval};

    return plcStationCreate(&config);
}

static void set(plcStation *s, const char *key, const char *value)
{
    char error[400];

    if (plcStationSetOption(s, key, value, error, sizeof(error)))
        testAbort("%s", error);
}

/* A station that is connected to us, with scans on. Returns the PLC's end. */
static int station(plcStation **s, int *listener, const char *option, const char *value,
                   unsigned sendInterval)
{
    int port = 0;

    *listener = toolListen(&port);
    *s = make("PLC", "127.0.0.1", port, IN, OUT, 60000, sendInterval);
    if (option)
        set(*s, option, value);
    plcStationsStart();
    plcStationsRun();
    return toolAccept(*listener);
}

static void end(int fd, int listener)
{
    plcStationsDestroy();
    toolClose(fd);
    toolClose(listener);
}

static plcStats stats(plcStation *s)
{
    plcStats st;

    plcStationStats(s, &st);
    return st;
}

static const char *reason(plcStation *s)
{
    static char text[PLC_REASON_SIZE];

    plcImageReason(plcStationInput(s), text);
    return text;
}

/* The first byte of the input block; -1: not valid. */
static int value(plcStation *s)
{
    unsigned char byte;

    return plcImageRead(plcStationInput(s), 0, 1, &byte, NULL) ? -1 : byte;
}

static void sendBlock(int fd, int first)
{
    unsigned char block[IN];

    memset(block, 0, sizeof(block));
    block[0] = (unsigned char)first;
    toolSend(fd, block, sizeof(block));
}

/* Sends a block and waits until it is in the image. */
static int blockArrives(plcStation *s, int fd, int first)
{
    sendBlock(fd, first);
    WAIT_FOR(value(s) == first);
    return value(s) == first;
}

static int put(plcStation *s, size_t offset, int byte)
{
    char text[PLC_REASON_SIZE];
    unsigned char data = (unsigned char)byte;

    return plcStationWrite(s, offset, 1, &data, NULL, text);
}

/* True when the station has looked around and sent nothing: it took a block meanwhile. */
static int silent(plcStation *s, int fd)
{
    static int token;
    char bytes[100];

    token = token % 250 + 1;
    return blockArrives(s, fd, token) && toolPeek(fd, bytes, sizeof(bytes)) == 0;
}

static int outBlock(int fd, unsigned char block[OUT])
{
    return toolReceive(fd, block, OUT) == OUT;
}

/* --- Input ------------------------------------------------------------------------------*/

static void testFirstBlock(void)
{
    plcStation *s;
    int listener, fd = station(&s, &listener, NULL, NULL, 50);
    plcStats st;

    testDiag("Each connection begins invalid");
    WAIT_FOR(stats(s).state == plcStateWaiting);
    testOk(stats(s).state == plcStateWaiting && value(s) == -1 &&
               strcmp(reason(s), "connected, waiting for first block") == 0,
           "connected: not valid, \"%s\"", reason(s));
    toolSend(fd, "\1\2\3\4\5\6\7\10\11\12\13\14\15\16\17", IN - 1);
    WAIT_FOR(stats(s).bytesIn == IN - 1);
    testOk(stats(s).bytesIn == IN - 1 && value(s) == -1, "all but one byte: not valid");
    toolSend(fd, "\20", 1);
    WAIT_FOR(value(s) == 1);
    testOk(value(s) == 1 && reason(s)[0] == 0, "the last byte makes it valid");
    WAIT_FOR(stats(s).state == plcStateOk);
    st = stats(s);
    testOk(st.connected && st.alive && st.state == plcStateOk && st.blocksIn == 1,
           "connected, alive, one block");
    testOk(blockArrives(s, fd, 77), "the next block replaces it");
    toolClose(fd);
    fd = toolAccept(listener);
    WAIT_FOR(stats(s).connects == 2);
    testOk(value(s) == -1, "a new connection: old data is not valid");
    testOk(strcmp(stats(s).lastError, "connection closed by PLC") == 0, "last error: %s",
           stats(s).lastError);
    testOk(blockArrives(s, fd, 78), "until its first block");
    st = stats(s);
    testOk(st.connects == 2 && st.disconnects == 1 && st.blocksIn == 3 &&
               st.bytesIn == 3 * IN,
           "all of it is counted");
    plcStationStatsReset(s);
    st = stats(s);
    testOk(st.connects == 0 && st.blocksIn == 0 && st.connected && st.state == plcStateOk,
           "and set to zero on demand");
    end(fd, listener);
}

static void testClosed(void)
{
    plcStation *s;
    int listener, fd = station(&s, &listener, NULL, NULL, 50);

    blockArrives(s, fd, 1);
    toolClose(listener);
    toolClose(fd);
    WAIT_FOR(stats(s).connectErrors > 3);
    testOk(value(s) == -1 && stats(s).state == plcStateConnecting &&
               strcmp(reason(s), "connection refused by PLC") == 0,
           "PLC off: not valid, \"%s\"", reason(s));
    testOk(!plcStationConnected(s, NULL), "not connected");
    end(-1, -1);
}

static void testBacklog(void)
{
    enum { N = 200 };
    unsigned char blocks[N][IN];
    plcStation *s;
    int listener, fd = station(&s, &listener, NULL, NULL, 50), i;
    plcStats st;

    for (i = 0; i < N; i++)
        memset(blocks[i], i + 1, IN);
    toolSend(fd, blocks, sizeof(blocks));
    WAIT_FOR(value(s) == N);
    st = stats(s);
    testOk(value(s) == N && st.blocksIn == N, "%d blocks at once: all counted, the newest "
           "is in the image (%llu skipped)", N, (unsigned long long)st.skipped);
    end(fd, listener);
}

static void testDeadline(void)
{
    plcStation *s;
    int listener, fd = station(&s, &listener, "recvTimeout", "200", 50);
    epicsUInt64 start;

    blockArrives(s, fd, 1);
    start = epicsMonotonicGet();
    WAIT_FOR(stats(s).disconnects == 1);
    testOk(stats(s).disconnects == 1 && epicsMonotonicGet() - start > 190000000ull &&
               strcmp(stats(s).lastError, "no block for 0.2 s") == 0,
           "silence: %s", stats(s).lastError);
    toolClose(fd);
    fd = toolAccept(listener);
    blockArrives(s, fd, 2);
    WAIT_FOR(toolSend(fd, "x", 1) || stats(s).disconnects == 2 || stats(s).bytesIn > 3 * IN);
    testOk(stats(s).disconnects == 2 || stats(s).bytesIn > 3 * IN,
           "bytes that trickle do not put the deadline off");
    end(fd, listener);
}

/* A PLC that takes connections and says nothing: the reason is not that of each moment. */
static void testSilent(void)
{
    plcStation *s;
    int port = 0, listener = toolListen(&port), fd, again;
    plcStats st;

    s = make("PLC", "127.0.0.1", port, IN, 0, 100, 50);
    plcStationsStart();
    plcStationsRun();
    fd = toolAccept(listener);
    WAIT_FOR(stats(s).state == plcStateWaiting);
    testOk(strcmp(reason(s), "connected, waiting for first block") == 0,
           "the first connection: %s", reason(s));
    again = toolAccept(listener);
    set(s, "recvTimeout", "60000");
    WAIT_FOR(stats(s).connects > 1 && stats(s).state == plcStateWaiting);
    st = stats(s);
    testOk(st.state == plcStateWaiting && strcmp(reason(s), "no block for 0.1 s") == 0,
           "the next one: what the last was lost by stays: %s", reason(s));
    toolClose(fd);
    fd = st.connects > 2 ? toolAccept(listener) : again;
    testOk(blockArrives(s, fd, 1) && reason(s)[0] == 0, "until a block comes");
    if (fd != again)
        toolClose(again);
    toolClose(fd);
    fd = toolAccept(listener);
    WAIT_FOR(stats(s).state == plcStateWaiting);
    testOk(strcmp(reason(s), "connected, waiting for first block") == 0,
           "a PLC that had sent: %s", reason(s));
    toolClose(fd);
    fd = toolAccept(listener);
    WAIT_FOR(strcmp(reason(s), "connection closed by PLC") == 0 &&
             stats(s).state == plcStateWaiting);
    testOk(strcmp(reason(s), "connection closed by PLC") == 0, "one that hangs up first: %s",
           reason(s));
    end(fd, listener);
}

static void testNoInput(void)
{
    plcStation *s;
    int port = 0, listener = toolListen(&port), fd;

    s = make("PLC", "127.0.0.1", port, 0, OUT, 100, 50);
    plcStationsStart();
    plcStationsRun();
    fd = toolAccept(listener);
    WAIT_FOR(stats(s).state == plcStateOk);
    testOk(stats(s).state == plcStateOk && reason(s)[0] == 0,
           "inSize 0: connected, no reason (\"%s\")", reason(s));
    toolClose(listener);
    toolClose(fd);
    WAIT_FOR(strcmp(reason(s), "connection refused by PLC") == 0);
    testOk(strcmp(reason(s), "connection refused by PLC") == 0, "lost: %s", reason(s));
    end(-1, -1);
}

static void testTrickle(void)
{
    plcStation *s;
    int port = 0, listener = toolListen(&port), fd, i;

    s = make("PLC", "127.0.0.1", port, 65536, 0, 300, 50);
    plcStationsStart();
    plcStationsRun();
    fd = toolAccept(listener);
    for (i = 0; i < 60000 && stats(s).disconnects == 0; i++) {
        toolSend(fd, "x", 1);
        epicsThreadSleep(0.001); /* the PLC's period */
    }
    testOk(stats(s).disconnects == 1 && stats(s).blocksIn == 0 &&
               strcmp(stats(s).lastError, "no block for 0.3 s") == 0,
           "one deadline for the whole block: %d bytes did not put it off", i);
    end(fd, listener);
}

static void testWrongSize(void)
{
    unsigned char block[60] = {0};
    plcStation *s;
    int listener, fd = station(&s, &listener, NULL, NULL, 50), i;
    epicsUInt64 sent = 0;

    for (i = 0; i < 50 && !stats(s).sizeMismatches; i++) {
        toolSend(fd, block, 14);
        sent += 14;
        WAIT_FOR(stats(s).bytesIn == sent || stats(s).sizeMismatches);
        epicsThreadSleep(0.005); /* the PLC's period */
    }
    testOk(stats(s).sizeMismatches == 1 && stats(s).blocksIn == 0,
           "14 bytes where 16 are configured: found out, no block was used");
    testOk(strcmp(reason(s), "PLC sends 14 bytes, inSize is 16") == 0 &&
               stats(s).state == plcStateWrongSize && stats(s).burstSize == 14,
           "both sizes are told: %s", reason(s));
    testOk(toolClosed(fd), "the connection is closed");
    toolClose(fd);
    fd = toolAccept(listener);
    WAIT_FOR(stats(s).connects == 2);
    testOk(strcmp(reason(s), "PLC sends 14 bytes, inSize is 16") == 0 && value(s) == -1,
           "connected again: the reason stays");
    testOk(blockArrives(s, fd, 5), "blocks of the right size are taken");
    WAIT_FOR(stats(s).burstSize == 0 && stats(s).state == plcStateOk);
    testOk(stats(s).state == plcStateOk && stats(s).burstSize == 0, "and all is well again");
    end(fd, listener);
}

/* Two dozen good blocks of a PLC with a period, then these many bytes more or less. */
static void slip(plcStation *s, int fd, int by)
{
    unsigned char block[2 * IN] = {0};
    int i;

    for (i = 1; i <= 24; i++) {
        blockArrives(s, fd, i);
        epicsThreadSleep(0.005); /* the PLC's period */
    }
    toolSend(fd, block, (size_t)(IN + by));
}

static void testOutOfStep(void)
{
    plcStation *s;
    int listener, fd = station(&s, &listener, NULL, NULL, 50), i, shown = 0;
    epicsUInt64 doubts;

    slip(s, fd, 7);
    for (i = 100; i < 200 && !stats(s).outOfStep; i++) {
        epicsThreadSleep(0.005); /* the PLC's period */
        sendBlock(fd, i);
        shown += value(s) >= 0 && value(s) != 24;
    }
    WAIT_FOR(value(s) == -1);
    testOk(stats(s).outOfStep == 1 && stats(s).doubts == 1 && stats(s).sizeMismatches == 0,
           "7 bytes too many: out of step, after %d blocks", i - 100);
    testOk(shown == 0 && value(s) == -1 && toolClosed(fd) &&
               strcmp(stats(s).lastError, "PLC out of step: bytes lost or too many") == 0,
           "nothing of it was shown; connected anew: %s", stats(s).lastError);
    toolClose(fd);
    fd = toolAccept(listener);
    testOk(blockArrives(s, fd, 1), "and all is well again");
    set(s, "recvTimeout", "1000");
    slip(s, fd, -1);
    /* 20 ms: the PLC's period */
    WAIT_FOR(stats(s).doubts > 1 || (epicsThreadSleep(0.02), sendBlock(fd, 9), 0));
    doubts = stats(s).doubts;
    WAIT_FOR(stats(s).outOfStep == 2 && value(s) == -1);
    testOk(doubts == 2 && stats(s).outOfStep == 2 && value(s) == -1 &&
               strcmp(stats(s).lastError, "PLC out of step: bytes lost or too many") == 0,
           "in doubt at the end of recvTimeout: %s", stats(s).lastError);
    end(fd, listener);
}

static void sendAlive(int fd, int first, int word)
{
    unsigned char block[IN] = {0};

    block[0] = (unsigned char)first;
    block[5] = (unsigned char)word;
    toolSend(fd, block, IN);
}

static void testAlive(void)
{
    plcStation *s;
    int listener, fd = station(&s, &listener, "alive", "4,UINT16", 50);

    set(s, "aliveTimeout", "150");
    sendAlive(fd, 1, 7);
    WAIT_FOR(value(s) == 1);
    testOk(value(s) == 1, "alive word: the first block is valid");
    WAIT_FOR((sendAlive(fd, 2, 7), stats(s).state == plcStateFrozen));
    testOk(stats(s).state == plcStateFrozen && value(s) == -1 && stats(s).connected &&
               strcmp(reason(s), "PLC frozen: alive word stands still") == 0,
           "it stands still: \"%s\"", reason(s));
    sendAlive(fd, 3, 8);
    WAIT_FOR(value(s) == 3);
    testOk(value(s) == 3, "it moves: valid");
    WAIT_FOR((sendAlive(fd, 4, 8), stats(s).state == plcStateFrozen));
    toolClose(fd);
    fd = toolAccept(listener);
    WAIT_FOR(stats(s).connects == 2);
    sendAlive(fd, 5, 8);
    WAIT_FOR(value(s) == 5);
    testOk(value(s) == 5, "a new connection begins afresh");
    set(s, "alive", "off");
    WAIT_FOR((sendAlive(fd, 6, 8), value(s) == 6));
    testOk(value(s) == 6, "option off: the word means nothing");
    end(fd, listener);
}

static void sendLayout(int fd, int first, unsigned id)
{
    unsigned char block[IN] = {0};

    block[0] = (unsigned char)first;
    block[6] = (unsigned char)(id >> 8);
    block[7] = (unsigned char)id;
    toolSend(fd, block, IN);
}

/* A layout id in the input block, without the handshake. */
static void testLayout(void)
{
    char text[PLC_REASON_SIZE], error[200];
    unsigned char block[OUT];
    plcStation *s;
    int fd, port = 0, listener = toolListen(&port);

    s = make("PLC", "127.0.0.1", port, IN, OUT, 60000, 50);
    testOk(plcStationSetOption(s, "layoutAt", "15", error, sizeof(error)) == -1, "%s", error);
    set(s, "layoutAt", "6");
    set(s, "layout", "4660");
    testOk(plcStationSetOption(s, "sync", "on", error, sizeof(error)) == -1, "%s", error);
    plcStationsStart();
    plcStationsRun();
    testOk(plcStationSetOption(s, "layout", "5", error, sizeof(error)) == -1, "%s", error);
    fd = toolAccept(listener);
    WAIT_FOR(stats(s).connected);
    testOk(put(s, 0, 7) == 0 && stats(s).blocksOut == 0,
           "nothing leaves before the PLC has shown its layout id");
    sendLayout(fd, 1, 0x1234);
    WAIT_FOR(value(s) == 1);
    testOk(outBlock(fd, block) && block[0] == 7, "the same id: the value leaves");
    testOk(stats(s).layoutPlc == 0x1234 && stats(s).layoutMismatches == 0,
           "and the statistics show it");
    sendLayout(fd, 2, 0x1235);
    WAIT_FOR(stats(s).state == plcStateLayout);
    testOk(value(s) == -1 && strcmp(reason(s), "layout ids of PLC and IOC differ") == 0,
           "another id: \"%s\"", reason(s));
    memset(block, 8, 1);
    testOk(plcStationWrite(s, 0, 1, block, NULL, text) == -1 &&
               strcmp(text, "layout ids of PLC and IOC differ") == 0,
           "a put is refused: \"%s\"", text);
    sendLayout(fd, 3, 0x1236);
    WAIT_FOR(stats(s).layoutPlc == 0x1236);
    testOk(stats(s).layoutMismatches == 1, "it is counted once");
    sendLayout(fd, 4, 0);
    WAIT_FOR(value(s) == 4);
    testOk(value(s) == 4 && put(s, 0, 9) == 0, "a PLC that shows 0 is not checked");
    sendLayout(fd, 5, 0x1234);
    WAIT_FOR(value(s) == 5);
    testOk(outBlock(fd, block) && block[0] == 9, "the same again: all is well");
    toolClose(fd);
    fd = toolAccept(listener);
    WAIT_FOR(stats(s).connects == 2);
    sendLayout(fd, 6, 1);
    WAIT_FOR(stats(s).state == plcStateLayout);
    testOk(stats(s).layoutMismatches == 2, "a new connection is checked afresh");
    end(fd, listener);
}

static void testMinUpdate(void)
{
    plcStation *s;
    int listener, fd = station(&s, &listener, "minUpdate", "3600000", 50);

    testOk(blockArrives(s, fd, 1), "minUpdate: the first block is taken at once");
    sendBlock(fd, 2);
    sendBlock(fd, 3);
    WAIT_FOR(stats(s).blocksIn == 3);
    testOk(stats(s).blocksIn == 3 && value(s) == 1, "the next ones wait");
    set(s, "minUpdate", "0");
    WAIT_FOR(value(s) == 3);
    testOk(value(s) == 3, "of those that waited the newest is taken");
    end(fd, listener);
}

static void testClock(void)
{
    static const unsigned char dt[8] = {0x24, 0x02, 0x29, 0x12, 0x34, 0x56, 0x78, 0x95};
    unsigned char block[IN] = {1};
    epicsTimeStamp stamp = {0, 0}, arrival;
    plcStation *s;
    int listener, fd = station(&s, &listener, "timestamp", "8", 50);
    unsigned char byte;

    memcpy(block + 8, dt, 8);
    toolSend(fd, block, IN);
    WAIT_FOR(value(s) == 1);
    plcImageRead(plcStationInput(s), 0, 1, &byte, &stamp);
    testOk(stamp.secPastEpoch == 1078058096u && stamp.nsec == 789000000,
           "the PLC's clock stamps the block");
    epicsTimeGetCurrent(&arrival);
    testOk(fabs(stats(s).clockOffset - epicsTimeDiffInSeconds(&stamp, &arrival)) < 3600,
           "its offset to ours is known");
    block[0] = 2;
    block[9] = 0x13; /* month 13 */
    toolSend(fd, block, IN);
    WAIT_FOR(value(s) == 2);
    plcImageRead(plcStationInput(s), 0, 1, &byte, &stamp);
    testOk(fabs(epicsTimeDiffInSeconds(&stamp, &arrival)) < 3600 &&
               stats(s).clockErrors == 1,
           "nonsense in its place: the time of arrival, and it is counted");
    end(fd, listener);
}

/* --- Connections ------------------------------------------------------------------------*/

static void testRefused(void)
{
    int port = toolFreePort(), listener, fd;
    plcStation *s = make("PLC", "127.0.0.1", port, IN, OUT, 60000, 50);

    plcStationsStart();
    plcStationsRun();
    WAIT_FOR(stats(s).connectErrors >= 5);
    testOk(stats(s).connectErrors >= 5 && stats(s).state == plcStateConnecting &&
               strcmp(reason(s), "connection refused by PLC") == 0,
           "refused: tries on, \"%s\"", reason(s));
    listener = toolListen(&port);
    fd = toolAccept(listener);
    testOk(fd >= 0 && blockArrives(s, fd, 9), "and is there when the PLC comes");
    end(fd, listener);
}

#define HANG_UPS 7

static const double pauses[HANG_UPS] = {0, 0.05, 0.1, 0.2, 0.4, 0.7, 0.7}; /* s */

/* A PLC that hangs up at once, HANG_UPS times: keeps the least time until the next attempt in `least`. Returns
 * how many came too early. */
static int hangUps(int *fd, int listener, double *least)
{
    int i, early = 0;

    for (i = 0; i < HANG_UPS; i++) {
        epicsUInt64 before = epicsMonotonicGet();
        double seconds;

        toolClose(*fd);
        *fd = toolAccept(listener);
        seconds = (epicsMonotonicGet() - before) * 1e-9;
        early += seconds < 0.9 * pauses[i];
        if (seconds < least[i])
            least[i] = seconds;
    }
    return early;
}

static int isLate(const double *least)
{
    int i;

    for (i = 0; i < HANG_UPS; i++)
        if (least[i] > 2 * pauses[i] + 0.1)
            return 1;
    return 0;
}

/* The least of some rounds: a busy machine may hold up one. */
static void testBackoff(void)
{
    double least[HANG_UPS] = {99, 99, 99, 99, 99, 99, 99};
    plcStation *s;
    int listener = -1, fd = -1, early = 0, round = 0;

    do {
        if (round)
            end(fd, listener);
        fd = station(&s, &listener, NULL, NULL, 50);
        early += hangUps(&fd, listener, least);
    } while (++round < 20 && isLate(least));
    testOk(!early, "a PLC that hangs up at once is tried slower and slower");
    testOk(!isLate(least), "after 0, 50, 100, 200, 400 and then each 700 ms (%.0f, %.0f, %.0f, %.0f, %.0f, %.0f, "
           "%.0f)", least[0] * 1e3, least[1] * 1e3, least[2] * 1e3, least[3] * 1e3, least[4] * 1e3, least[5] * 1e3,
           least[6] * 1e3);
    testOk(blockArrives(s, fd, 3), "but never given up");
    end(fd, listener);
}

/* What the log has had of a PLC. */
static struct {
    int lines;
    char more[200]; /* the line that tells what was left out */
} logged;

static void listenToLog(void *arg, const char *message)
{
    const char *line = strstr(message, "s7plc PLC: ");

    if (!line)
        return;
    logged.lines++;
    if (strstr(line, "more messages"))
        epicsSnprintf(logged.more, sizeof(logged.more), "%s", line);
}

static void testLogLimit(void)
{
    plcStation *s = make("PLC", "", 0, IN, OUT, 60000, 50);
    int i;

    errlogFlush();
    errlogAddListener(listenToLog, NULL);
    for (i = 0; i < 30; i++) {
        plcStationLog(s, errlogMinor, "a line");
        errlogFlush(); /* an older Base has no room for 20 */
    }
    testOk(logged.lines == 20, "of 30 lines in a minute %d are in the log", logged.lines);
    s->logRefill = 0; /* the minute is over */
    plcStationLog(s, errlogMinor, "another");
    errlogFlush();
    testOk(logged.lines == 22 &&
               strcmp(logged.more, "s7plc PLC: 10 more messages in the last minute\n") == 0,
           "then what was left out is told: %.46s", logged.more);
    errlogRemoveListeners(listenToLog, NULL);
    plcStationsDestroy();
}

static void testMove(void)
{
    char error[200], text[300];
    int port2 = 0, listener2 = toolListen(&port2), fd2;
    plcStation *s;
    int listener, fd = station(&s, &listener, NULL, NULL, 50);
    static const char *const bad[] = {"", ":", ":80", "host:", "host:0", "host:65536",
                                      "host:x", "a b:5", "host:80x"};
    size_t i;

    blockArrives(s, fd, 1);
    for (i = 0; i < sizeof(bad) / sizeof(bad[0]); i++)
        testOk(plcStationMove(s, bad[i], error, sizeof(error)) == -1, "\"%s\": %s", bad[i],
               error);
    testOk(stats(s).connected, "none of these touches the connection");
    sprintf(text, "localhost:%d", port2);
    testOk(plcStationMove(s, text, error, sizeof(error)) == 0, "moved");
    fd2 = toolAccept(listener2);
    testOk(fd2 >= 0 && toolClosed(fd), "the new PLC is connected, the old one is not");
    testOk(strcmp(stats(s).lastError, "PLC address changed") == 0, "last error: %s", stats(s).lastError);
    plcStationAddress(s, error, sizeof(error));
    testOk(strcmp(error, text) == 0, "its address is %s", error);
    testOk(blockArrives(s, fd2, 2), "and its blocks are data");
    toolClose(fd2);
    toolClose(listener2);
    end(fd, listener);
}

static void testNoAddress(void)
{
    char error[200], text[40];
    int port = 0, listener = toolListen(&port), fd;
    plcStation *s = make("PLC", "", 0, IN, OUT, 60000, 50);

    plcStationsStart();
    plcStationsRun();
    WAIT_FOR(stats(s).state == plcStateNoAddress);
    WAIT_FOR(strcmp(reason(s), "no address configured") == 0);
    testOk(strcmp(reason(s), "no address configured") == 0, "no address: \"%s\"", reason(s));
    testOk(plcStationMove(s, "127.0.0.1", error, sizeof(error)) == -1,
           "a host alone is not enough: %s", error);
    sprintf(text, "127.0.0.1:%d", port);
    plcStationMove(s, text, error, sizeof(error));
    fd = toolAccept(listener);
    testOk(fd >= 0 && blockArrives(s, fd, 4), "host:port is");
    end(fd, listener);
}

static void testUnknownHost(void)
{
    plcStation *s = make("PLC", "no-such-plc.invalid", 2000, IN, OUT, 60000, 50);

    plcStationsStart();
    plcStationsRun();
    WAIT_FOR(stats(s).connectErrors > 0 && strcmp(reason(s), "not connected yet") != 0);
    testOk(strncmp(reason(s), "no address for host", 19) == 0, "unknown host: \"%s\"",
           reason(s));
    end(-1, -1);
}

/* --- Output -----------------------------------------------------------------------------*/

static void testBeforeRun(void)
{
    int port = 0, listener = toolListen(&port), fd;
    plcStation *s = make("PLC", "127.0.0.1", port, IN, OUT, 60000, 50);
    unsigned char block[OUT];

    plcStationsStart();
    fd = toolAccept(listener);
    put(s, 0, 11);
    put(s, 1, 22);
    testOk(silent(s, fd), "before the PINI run is over nothing leaves");
    put(s, 2, 33);
    plcStationsRun();
    testOk(outBlock(fd, block) && memcmp(block, "\13\26\41\0\0\0\0", 8) == 0,
           "then all of it in one block");
    testOk(silent(s, fd) && stats(s).blocksOut == 1, "and only once");
    end(fd, listener);
}

static void testInterval(void)
{
    plcStation *s;
    int listener, fd = station(&s, &listener, NULL, NULL, 3600000);
    unsigned char block[OUT];

    testOk(silent(s, fd), "nothing was written: nothing leaves");
    put(s, 0, 1);
    testOk(outBlock(fd, block) && block[0] == 1, "the first write leaves at once");
    put(s, 0, 2);
    testOk(silent(s, fd), "the next one waits for its interval");
    plcStationSend(s);
    testOk(outBlock(fd, block) && block[0] == 2, "unless s7plcSend sends it");
    plcStationSend(s);
    testOk(outBlock(fd, block) && block[0] == 2, "which also sends what has not changed");
    put(s, 0, 3);
    set(s, "sendInterval", "1");
    testOk(outBlock(fd, block) && block[0] == 3, "a shorter interval holds at once");
    end(fd, listener);
}

static void testRate(void)
{
    enum { INTERVAL = 40 };
    plcStation *s;
    int listener, fd = station(&s, &listener, "holdoff", "0", INTERVAL), i = 0, count = 0;
    epicsUInt64 start = epicsMonotonicGet();
    unsigned char block[OUT] = {0};
    double ms;

    while (count < 8) {
        put(s, 0, i++ & 0x7f);
        if (stats(s).blocksOut > (epicsUInt64)count)
            count += outBlock(fd, block);
        epicsThreadSleep(0.001); /* the pace of the writer */
    }
    put(s, 0, 200);
    do
        count += outBlock(fd, block);
    while (block[0] != 200 && count < 1000);
    ms = (epicsMonotonicGet() - start) * 1e-6;
    testOk(block[0] == 200, "the last of %d writes arrives", i + 1);
    testOk(count <= ms / INTERVAL + 1, "never more than one block each %d ms: %d in %.0f ms",
           INTERVAL, count, ms);
    end(fd, listener);
}

static void testHoldoff(void)
{
    plcStation *s;
    int listener, fd = station(&s, &listener, "holdoff", "800", 1);
    epicsUInt64 start = epicsMonotonicGet();
    unsigned char block[OUT];

    put(s, 0, 1);
    put(s, 1, 2);
    put(s, 2, 3);
    testOk(outBlock(fd, block) && memcmp(block, "\1\2\3", 3) == 0 &&
               epicsMonotonicGet() - start > 790000000ull,
           "holdoff: a burst of writes is one block");
    end(fd, listener);
}

static void testHeartbeat(void)
{
    plcStation *s;
    int listener, fd = station(&s, &listener, "heartbeat", "30", 10), i, good = 0;
    epicsUInt64 start = epicsMonotonicGet();
    unsigned char block[OUT];
    double ms;

    for (i = 0; i < 6; i++)
        good += outBlock(fd, block);
    ms = (epicsMonotonicGet() - start) * 1e-6;
    testOk(good == 6 && stats(s).heartbeats >= 5, "heartbeat: unchanged blocks leave");
    testOk(ms > 5 * 30 - 35, "each 30 ms (6 in %.0f ms)", ms);
    end(fd, listener);
}

/* A PLC that takes no blocks, with room for a few: what waits is the newest, and nothing else.
 */
static void testSlow(void)
{
    enum { SIZE = 2000 };
    static unsigned char block[SIZE];
    plcStation *s;
    int port = 0, listener = toolListen(&port), room = 4096, fd, i;
    epicsUInt64 sent, taken = 0;

    setsockopt(listener, SOL_SOCKET, SO_RCVBUF, &room, sizeof(room));
    s = make("PLC", "127.0.0.1", port, IN, SIZE, 60000, 1);
    plcStationsStart();
    plcStationsRun();
    fd = toolAccept(listener);
    for (i = 0; i < 20000 && !stats(s).slowSends; i++) {
        put(s, 0, i & 0x7f);
        epicsThreadSleep(0.001); /* the pace of the writer */
    }
    testOk(stats(s).slowSends == 1, "a PLC that takes no blocks: one waits, after %llu",
           (unsigned long long)stats(s).blocksOut);
    sent = stats(s).blocksOut;
    for (i = 0; i < 300; i++) {
        put(s, 0, i & 0x7f);
        epicsThreadSleep(0.001); /* the pace of the writer */
    }
    put(s, 0, 200);
    testOk(stats(s).blocksOut <= sent + 2, "then hardly any is queued for it (%llu)",
           (unsigned long long)(stats(s).blocksOut - sent));
    do
        taken += toolReceive(fd, block, SIZE) == SIZE;
    while (block[0] != 200 && taken < sent + 10);
    testOk(block[0] == 200 && taken <= sent + 3,
           "when it takes them again the newest value follows at once");
    end(fd, listener);
}

static void testReconnect(void)
{
    plcStation *s;
    int listener, fd = station(&s, &listener, NULL, NULL, 1);
    unsigned char block[OUT];

    blockArrives(s, fd, 1);
    toolClose(fd);
    fd = toolAccept(listener);
    testOk(silent(s, fd), "connected again, nothing was ever written: nothing leaves");
    put(s, 3, 44);
    outBlock(fd, block);
    toolClose(fd);
    fd = toolAccept(listener);
    testOk(outBlock(fd, block) && block[3] == 44,
           "connected again: the image leaves, for a PLC that has forgotten it");
    testOk(silent(s, fd), "once");
    end(fd, listener);
}

static void testOffline(void)
{
    char text[PLC_REASON_SIZE];
    unsigned char block[OUT];
    plcStation *s;
    int port = toolFreePort(), listener, fd, status;

    s = make("PLC", "127.0.0.1", port, IN, OUT, 60000, 1);
    plcStationsStart();
    plcStationsRun();
    WAIT_FOR(stats(s).connectErrors);
    status = plcStationWrite(s, 0, 1, "\5", NULL, text);
    testOk(status == 0 && strcmp(text, "connection refused by PLC") == 0,
           "a write while the PLC is away is kept, and says: %s", text);
    set(s, "offlineWrites", "reject");
    status = plcStationWrite(s, 1, 1, "\6", NULL, text);
    testOk(status == -1 && strcmp(text, "connection refused by PLC") == 0 &&
               stats(s).refusedWrites == 1,
           "offlineWrites=reject: refused and counted");
    listener = toolListen(&port);
    fd = toolAccept(listener);
    testOk(outBlock(fd, block) && block[0] == 5 && block[1] == 0,
           "on connect the kept one leaves, the refused one does not");
    testOk(put(s, 1, 7) == 0 && outBlock(fd, block) && block[1] == 7,
           "connected: writes pass");
    end(fd, listener);
}

static void testOfflineReject(void)
{
    plcStation *s;
    int port = toolFreePort(), listener, fd;

    s = make("PLC", "127.0.0.1", port, IN, OUT, 60000, 1);
    set(s, "offlineWrites", "reject");
    plcStationsStart();
    plcStationsRun();
    testOk(put(s, 0, 5) == -1, "refused before the first connect");
    listener = toolListen(&port);
    fd = toolAccept(listener);
    testOk(silent(s, fd), "nothing is queued to jump out later");
    end(fd, listener);
}

/* The PLC reads slowly and hangs up within a block, again and again. */
static void testKilledSends(void)
{
    const size_t size = 4 << 20;
    unsigned char *block = malloc(size), *data = malloc(size);
    int port = 0, listener = toolListen(&port), fd, round, spliced = 0;
    plcStation *s;
    char text[PLC_REASON_SIZE];
    size_t i;

    s = make("PLC", "127.0.0.1", port, 0, size, 60000, 1);
    plcStationsStart();
    plcStationsRun();
    for (round = 1; round <= 6; round++) {
        fd = toolAccept(listener);
        WAIT_FOR(plcStationConnected(s, NULL));
        memset(data, round, size);
        plcStationWrite(s, 0, size, data, NULL, text);
        /* blocks of one value each, the first of them maybe the one from before */
        toolReceive(fd, block, (size_t)round * 300001);
        for (i = 1; i < (size_t)round * 300001; i++)
            spliced += block[i] != block[0];
        if (round & 1)
            toolReset(fd);
        else
            toolClose(fd);
        WAIT_FOR(stats(s).disconnects >= (epicsUInt64)round);
    }
    fd = toolAccept(listener);
    toolReceive(fd, block, size);
    for (i = 0; i < size; i++)
        spliced += block[i] != 6;
    testOk(spliced == 0, "killed within a block six times: none is spliced, and the last "
           "value arrives");
    free(block);
    free(data);
    end(fd, listener);
}

/* --- Many stations, life and death --------------------------------------------------------*/

static void testWriteOnly(void)
{
    int port = 0, listener = toolListen(&port), fd;
    plcStation *s = make("PLC", "127.0.0.1", port, 0, OUT, 50, 1);
    unsigned char block[OUT];

    plcStationsStart();
    plcStationsRun();
    fd = toolAccept(listener);
    WAIT_FOR(stats(s).state == plcStateOk);
    testOk(stats(s).state == plcStateOk, "inSize 0: a connection is all it needs");
    toolSend(fd, "garbage", 7);
    WAIT_FOR(stats(s).bytesIn == 7);
    put(s, 0, 9);
    testOk(outBlock(fd, block) && block[0] == 9 && stats(s).disconnects == 0,
           "it writes, and needs no block to stay connected");
    toolClose(fd);
    WAIT_FOR(stats(s).disconnects == 1);
    testOk(stats(s).disconnects == 1, "but sees when the PLC hangs up");
    end(-1, listener);
}

static void count(plcStation *s, void *arg)
{
    (void)s;
    ++*(int *)arg;
}

static void testMany(void)
{
    enum { N = 200 };
    int port = 0, listener = toolListen(&port), fd[N], i, good = 0, visited = 0, wrong = 0;
    char name[20], names[60];
    plcStation *s[N];
    unsigned char block[OUT];

    for (i = 0; i < N; i++) {
        sprintf(name, "PLC%03d", i);
        s[i] = make(name, "127.0.0.1", port, IN, OUT, 60000, 1);
    }
    testOk(plcStationFind("PLC117") == s[117] && !plcStationFind("PLC"), "found by name");
    plcStationEach(count, &visited);
    testOk(visited == N, "all are visited");
    plcStationNames(names, sizeof(names));
    testOk(strncmp(names, "PLC000 PLC001 ", 14) == 0 && strlen(names) < sizeof(names) &&
               strcmp(names + strlen(names) - 3, "...") == 0,
           "and named, with dots where there are more: %s", names);
    plcStationsStart();
    plcStationsRun();
    for (i = 0; i < N; i++)
        fd[i] = toolAccept(listener);
    for (i = 0; i < N; i++)
        sendBlock(fd[i], 1 + i % 200);
    for (i = 0; i < N; i++) {
        WAIT_FOR(value(s[i]) > 0);
        good += value(s[i]) > 0;
        put(s[i], 0, i % 256);
    }
    for (i = 0; i < N; i++)
        wrong += !outBlock(fd[i], block);
    testOk(good == N && wrong == 0, "%d stations: each gets its block and sends one", N);
    plcStationsDestroy();
    for (i = 0; i < N; i++)
        toolClose(fd[i]);
    toolClose(listener);
}

static void testManyDescriptors(void)
{
    enum { N = 1100 };
    struct rlimit limit;
    int fd[N], i, listener, peer;
    unsigned char block[OUT];
    plcStation *s;

    getrlimit(RLIMIT_NOFILE, &limit);
    if (limit.rlim_cur < 2000 && limit.rlim_max >= 2000) {
        limit.rlim_cur = 2000;
        setrlimit(RLIMIT_NOFILE, &limit);
    }
    for (i = 0; i < N; i++)
        fd[i] = open("/dev/null", O_RDONLY);
    if (fd[N - 1] < 0) {
        testSkip(2, "not so many descriptors allowed here");
    } else {
        peer = station(&s, &listener, NULL, NULL, 1);
        testOk(peer > 1023 && blockArrives(s, peer, 99), "descriptors above 1023: reads");
        put(s, 0, 98);
        testOk(outBlock(peer, block) && block[0] == 98, "and writes");
        end(peer, listener);
    }
    for (i = 0; i < N; i++)
        if (fd[i] >= 0)
            close(fd[i]);
}

/* exit() may come at any moment. */
static void testStop(void)
{
    int port = 0, closedPort = toolFreePort(), listener = toolListen(&port), i, fd[3];
    plcStation *s;
    size_t size = 8 << 20;

    make("no-address", "", 0, IN, OUT, 60000, 50);
    make("refused", "127.0.0.1", closedPort, IN, OUT, 60000, 50);
    make("black-hole", "192.0.2.1", 2000, IN, OUT, 60000, 50);
    make("resolving", "no-such-plc.invalid", 2000, IN, OUT, 60000, 50);
    make("local", "localhost", closedPort, IN, OUT, 60000, 50);
    make("waiting", "127.0.0.1", port, IN, OUT, 60000, 50);
    make("half-a-block", "127.0.0.1", port, IN, OUT, 60000, 50);
    s = make("sending", "127.0.0.1", port, IN, size, 60000, 50);
    plcStationsStart();
    plcStationsRun();
    for (i = 0; i < 3; i++) {
        fd[i] = toolAccept(listener);
        toolSend(fd[i], "half", 4);
    }
    put(s, 0, 1);
    WAIT_FOR(stats(plcStationFind("refused")).connectErrors > 1);
    WAIT_FOR(stats(s).bytesIn == 4);
    plcStationsStop();
    for (i = 0; i < 3; i++)
        testOk(toolClosed(fd[i]), "stopped: connection %d is closed", i + 1);
    testOk(plcStationConnected(s, NULL) == 0 || 1, "records may still ask");
    plcStationsDestroy();
    for (i = 0; i < 3; i++)
        toolClose(fd[i]);
    toolClose(listener);

    make("never-started", "127.0.0.1", 1, IN, OUT, 60000, 50);
    plcStationsDestroy();
    plcStationsDestroy();
    testPass("stopped before the start, and twice");
    for (i = 0; i < 50; i++) {
        make("PLC", i & 1 ? "localhost" : "127.0.0.1", closedPort, IN, OUT, 60000, 50);
        plcStationsStart();
        plcStationsDestroy();
    }
    testPass("stopped at once, 50 times");
}

static void testOptions(void)
{
    char error[400], *text = NULL;
    size_t size = 0;
    FILE *file;
    plcStation *s = make("PLC", "", 0, IN, OUT, 1500, 70);

    testOk(plcStationSetOption(s, "alive", "15", error, sizeof(error)) == -1 &&
               strcmp(error, "option alive: 2 bytes at 15 do not fit the input block of 16") ==
                   0,
           "%s", error);
    testOk(plcStationSetOption(s, "timestamp", "9", error, sizeof(error)) == -1, "%s", error);
    testOk(plcStationSetOption(s, "readback", "9", error, sizeof(error)) == -1, "%s", error);
    testOk(plcStationSetOption(s, "readback", "8", error, sizeof(error)) == 0, "readback=8");
    testOk(plcStationSetOption(s, "scan", "changed", error, sizeof(error)) == 0,
           "scan=changed before the start");
    plcStationsStart();
    testOk(plcStationSetOption(s, "scan", "all", error, sizeof(error)) == -1, "%s", error);
    file = open_memstream(&text, &size);
    plcStationReport(s, file, 2);
    plcStationOptions(s, file);
    fclose(file);
    testOk(strstr(text, "recvTimeout=1500 sendInterval=70 scan=changed readback=8") != NULL,
           "the report shows them");
    free(text);
    end(-1, -1);
}

static int writerStops; /* atomic */

static void otherWriter(void *pvt)
{
    plcStation *s = ((void **)pvt)[0];
    char value[12];
    int i;

    for (i = 0; !epicsAtomicGetIntT(&writerStops); i++) {
        sprintf(value, "%d", 1 + i % 100);
        set(s, "minUpdate", value);
    }
    epicsEventSignal(((void **)pvt)[1]);
}

/* Each of two threads sets an option of its own: none takes the other's back. */
static void testTwoWriters(void)
{
    plcStation *s = make("PLC", "", 0, IN, OUT, 1500, 70);
    void *pvt[2] = {s, epicsEventMustCreate(epicsEventEmpty)};
    char value[12];
    plcOptions o;
    int i, lost = 0;

    epicsThreadMustCreate("writer", epicsThreadPriorityMedium,
                          epicsThreadGetStackSize(epicsThreadStackMedium), otherWriter, pvt);
    for (i = 0; i < 20000; i++) {
        sprintf(value, "%d", 1 + i % 1000);
        set(s, "heartbeat", value);
        plcStationGetOptions(s, &o);
        lost += o.heartbeat != 1 + i % 1000;
    }
    epicsAtomicSetIntT(&writerStops, 1);
    epicsEventMustWait(pvt[1]);
    epicsEventDestroy(pvt[1]);
    testOk(lost == 0, "two threads set options: %d of %d updates were lost", lost, i);
    end(-1, -1);
}

/* --- The listener -------------------------------------------------------------------*/

static struct {
    int received, delivered, sent, changed; /* atomic: how often */
    int in, out;                            /* atomic: first byte of the last block */
} heard;

static void hearReceived(void *pvt, const void *block)
{
    (void)block;
    testOk(pvt == &heard, "received: with our argument");
    epicsAtomicIncrIntT(&heard.received);
}

static void hearDelivered(void *pvt, const void *block, const epicsTimeStamp *stamp)
{
    (void)pvt, (void)stamp;
    epicsAtomicSetIntT(&heard.in, *(const unsigned char *)block);
    epicsAtomicIncrIntT(&heard.delivered);
}

static void hearSent(void *pvt, const void *block)
{
    (void)pvt;
    epicsAtomicSetIntT(&heard.out, *(const unsigned char *)block);
    epicsAtomicIncrIntT(&heard.sent);
}

static void hearChanged(void *pvt)
{
    (void)pvt;
    epicsAtomicIncrIntT(&heard.changed);
}

static void testListener(void)
{
    static const plcListener all = {.received = hearReceived,
                                     .delivered = hearDelivered,
                                     .sent = hearSent,
                                     .changed = hearChanged};
    static const plcListener none = {.received = NULL};
    unsigned char block[OUT];
    int port = 0, listener = toolListen(&port), fd, before;
    plcStation *s = make("PLC", "127.0.0.1", port, IN, OUT, 60000, 10);

    testDiag("Who listens to a station beside the records");
    testOk(plcStationListen(s, &all, &heard) == 0, "one may listen");
    testOk(plcStationListen(s, &none, NULL) == -1, "a second may not");
    plcStationsStart();
    plcStationsRun();
    fd = toolAccept(listener);
    blockArrives(s, fd, 5);
    WAIT_FOR(epicsAtomicGetIntT(&heard.delivered) == 1);
    testOk(epicsAtomicGetIntT(&heard.received) == 1 &&
               epicsAtomicGetIntT(&heard.in) == 5,
           "it gets the block that records get");
    put(s, 0, 9);
    testOk(outBlock(fd, block) && block[0] == 9, "a block leaves");
    WAIT_FOR(epicsAtomicGetIntT(&heard.sent) > 0);
    testOk(epicsAtomicGetIntT(&heard.out) == 9, "and it gets that one too");
    before = epicsAtomicGetIntT(&heard.changed);
    toolClose(fd);
    WAIT_FOR(epicsAtomicGetIntT(&heard.changed) > before && value(s) == -1);
    testOk(epicsAtomicGetIntT(&heard.changed) > before, "it hears of a loss");
    end(-1, listener);
    listener = toolListen(&port);
    s = make("PLC", "127.0.0.1", port, IN, OUT, 60000, 10);
    plcStationListen(s, &none, NULL);
    plcStationsStart();
    plcStationsRun();
    fd = toolAccept(listener);
    testOk(blockArrives(s, fd, 6), "one that wants to hear nothing hears nothing");
    s = make("LATE", "127.0.0.1", port, IN, OUT, 60000, 10);
    testOk(plcStationListen(s, &all, NULL) == -1, "one that comes late is refused");
    end(fd, listener);
}

/* --- A thread that does not end ------------------------------------------------------*/

static epicsEventId inside, mayGo;

static void waits(void *pvt, const void *block)
{
    (void)pvt, (void)block;
    epicsEventSignal(inside);
    epicsEventMustWait(mayGo);
}

static void stopper(void *ended)
{
    plcStationsStop();
    epicsEventSignal(ended);
}

/* Something waits in the station's thread, as a record may do. */
static void testStuck(void)
{
    static const plcListener listener = {.received = waits};
    epicsEventId ended = epicsEventMustCreate(epicsEventEmpty);
    int port = 0, socket = toolListen(&port), fd, found, i;
    plcStation *s = make("STUCK", "127.0.0.1", port, IN, OUT, 60000, 50);

    make("OTHER", "", 0, IN, OUT, 60000, 50);
    inside = epicsEventMustCreate(epicsEventEmpty);
    mayGo = epicsEventMustCreate(epicsEventEmpty);
    plcStationListen(s, &listener, NULL);
    for (i = 0; i < 2; i++) {
        if (i) {
            s = make("STUCK", "127.0.0.1", port, IN, OUT, 60000, 50);
            plcStationListen(s, &listener, NULL);
        }
        plcStationsStart();
        plcStationsRun();
        fd = toolAccept(socket);
        sendBlock(fd, 1);
        epicsEventMustWait(inside);
        epicsThreadMustCreate("stopper", epicsThreadPriorityMedium,
                              epicsThreadGetStackSize(epicsThreadStackMedium), stopper, ended);
        WAIT_FOR(!plcStationFind("STUCK"));
        found = plcStationFind("STUCK") != NULL;
        if (i == 0)
            epicsEventSignal(mayGo);
        testOk(!found, "while threads end, others may look for a PLC");
        testOk(epicsEventWaitWithTimeout(ended, PATIENCE_S) == epicsEventOK,
               i ? "a thread that does not end is left behind" : "all have ended");
        if (i)
            epicsEventSignal(mayGo);
        plcStationsDestroy();
        testOk(toolClosed(fd), "its connection ends when it can");
        toolClose(fd);
    }
    toolClose(socket);
    epicsEventDestroy(ended);
}

MAIN(stationTest)
{
    testPlan(139 + 7 + 1);
    eltc(0); /* the log is for people; here the test speaks */
    testFirstBlock();
    testClosed();
    testBacklog();
    testDeadline();
    testSilent();
    testNoInput();
    testTrickle();
    testWrongSize();
    testOutOfStep();
    testAlive();
    testLayout();
    testMinUpdate();
    testClock();
    testRefused();
    testBackoff();
    testLogLimit();
    testMove();
    testNoAddress();
    testUnknownHost();
    testBeforeRun();
    testInterval();
    testRate();
    testHoldoff();
    testHeartbeat();
    testSlow();
    testReconnect();
    testOffline();
    testOfflineReject();
    testKilledSends();
    testWriteOnly();
    testMany();
    testManyDescriptors();
    testStop();
    testOptions();
    testListener();
    testStuck();
    testTwoWriters();
    return testDone();
}
