/* One TCP connection against a real peer on loopback: made, refused, closed, reset, blocks
 * in, and a block out that the kernel takes in pieces. */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcBlocks.h"
#include "plcConnection.h"
#include "plcErrno.h"
#include "plcFraming.h"
#include "testTools.h"

static const struct in_addr *loopback(void)
{
    static struct in_addr address;

    address.s_addr = htonl(INADDR_LOOPBACK);
    return &address;
}

static epicsUInt64 now(void)
{
    return epicsMonotonicGet();
}

static void *blocks; /* that leave by the connection that is tested, */

/* Waits as a station does. Returns the events, 0 when patience is at an end. */
static short await(plcConnection *c)
{
    struct pollfd p = {c->socket, plcConnectionEvents(c, plcBlocks.sending(blocks)), 0};

    return poll(&p, 1, PATIENCE_S * 1000) > 0 ? p.revents : 0;
}

static plcFraming *framing; /* and those that come */

static void begin(plcConnection *c, size_t inSize, size_t outSize)
{
    plcTransportSetup setup = {.outSize = outSize};

    plcConnectionInit(c);
    blocks = plcBlocks.create(&setup, NULL);
    framing = plcFramingCreate(inSize);
}

static void end(plcConnection *c)
{
    plcConnectionClose(c, NULL, 0);
    plcBlocks.destroy(blocks);
    plcFramingDestroy(framing);
}

static int sendBlock(plcConnection *c, int start)
{
    return plcBlocks.send(blocks, c, start, now());
}

static int receive(plcConnection *c, epicsUInt64 time)
{
    size_t room;
    void *space = plcFramingSpace(framing, &room);
    int got = plcConnectionReceive(c, space, room, time);

    if (got > 0)
        plcFramingAdd(framing, (size_t)got, time);
    return got;
}

static int finish(plcConnection *c)
{
    int status = 0;

    while (status == 0 && await(c))
        status = plcConnectionFinish(c, now());
    if (status > 0) {
        plcFramingReset(framing);
        plcBlocks.connected(blocks, c);
    }
    return status;
}

/* Connects to a listener. Returns the PLC's end. */
static int connected(plcConnection *c, size_t inSize, size_t outSize)
{
    int port = 0, listener = toolListen(&port), fd;

    begin(c, inSize, outSize);
    if (plcConnectionOpen(c, *loopback(), htons((unsigned short)port), now()))
        testAbort("cannot connect");
    fd = toolAccept(listener);
    if (fd < 0 || finish(c) != 1)
        testAbort("no connection");
    toolClose(listener);
    return fd;
}

static void testRefused(void)
{
    plcConnection c;
    int status;

    begin(&c, 10, 10);
    testOk(c.state == plcConnectionDown && plcConnectionEvents(&c, 0) == 0,
           "not connected at first");
    status = plcConnectionOpen(&c, *loopback(), htons((unsigned short)toolFreePort()), now());
    if (status == 0)
        status = finish(&c);
    testOk(status == -1 && c.state == plcConnectionDown && c.socket == INVALID_SOCKET &&
               strcmp(c.error, "connection refused by PLC") == 0,
           "refused: %s", c.error);
    end(&c);
}

/* What the system says of an attempt, in the words of an operator. */
/* The words for errors that loopback does not make. */
static const struct {
    int number;
    const char *words;
} words[] = {
    {EHOSTUNREACH, "no route to PLC"}, {ENETUNREACH, "network unreachable"},
    {EHOSTDOWN, "PLC host is down"}, {EADDRNOTAVAIL, "no local port or address"},
    {ETIMEDOUT, "PLC does not answer"},
};
#define WORDS (sizeof(words) / sizeof(words[0]))

static void testWords(void)
{
    size_t i;

    for (i = 0; i < WORDS; i++)
        testOk(strcmp(plcErrnoText(words[i].number), words[i].words) == 0, "error %d: %s", words[i].number,
               plcErrnoText(words[i].number));
}

static void testNoDescriptor(void)
{
    struct rlimit before, none;
    plcConnection c;
    int status, fd = dup(0);

    close(fd);
    begin(&c, 10, 10);
    getrlimit(RLIMIT_NOFILE, &before);
    none = before;
    none.rlim_cur = (rlim_t)fd; /* the lowest that is free: none is left */
    setrlimit(RLIMIT_NOFILE, &none);
    status = plcConnectionOpen(&c, *loopback(), htons(1), now());
    setrlimit(RLIMIT_NOFILE, &before);
    testOk(status == -1 && c.state == plcConnectionDown && strcmp(c.error, "too many open files in IOC") == 0,
           "no descriptor is left: %s", c.error);
    end(&c);
}

static void testMade(void)
{
    plcConnection c;
    int fd = connected(&c, 4, 4);

    testOk(c.state == plcConnectionUp && c.error[0] == 0, "connected");
    testOk(!plcBlocks.sending(blocks) && plcConnectionEvents(&c, 0) == POLLIN,
           "idle: it waits for input only");
    testOk(receive(&c, now()) == 0, "nothing there: 0 bytes, no error");
    plcConnectionClose(&c, "test is over", now());
    testOk(c.state == plcConnectionDown && strcmp(c.error, "test is over") == 0, "closed");
    testOk(toolClosed(fd), "and the peer sees it");
    toolClose(fd);
    end(&c);
}

static void testInput(void)
{
    plcConnection c;
    int fd = connected(&c, 4, 0), got, total = 0;

    toolSend(fd, "ABCDEFGHIJ", 10);
    while (total < 10 && await(&c)) {
        got = receive(&c, now());
        if (got < 0)
            break;
        total += got;
    }
    testOk(total == 10 && plcFramingCount(framing) == 2 &&
               memcmp(plcFramingNewest(framing), "EFGH", 4) == 0,
           "ten bytes are two blocks of four, EFGH the newest");
    plcFramingConsume(framing);
    toolSend(fd, "KL", 2);
    while (plcFramingCount(framing) == 0 && await(&c) && receive(&c, now()) >= 0)
        ;
    testOk(plcFramingCount(framing) == 1 &&
               memcmp(plcFramingNewest(framing), "IJKL", 4) == 0,
           "the third block comes in two parts");
    toolSend(fd, "MNOP", 4);
    toolClose(fd);
    plcFramingConsume(framing);
    while (await(&c) && receive(&c, now()) >= 0)
        ;
    testOk(c.state == plcConnectionDown && plcFramingCount(framing) == 1 &&
               strcmp(c.error, "connection closed by PLC") == 0,
           "closed by the PLC: the block before the end is there");
    end(&c);
}

static void testLasted(void)
{
    plcConnection c;
    int fd = connected(&c, 4, 0), status = 0;
    epicsUInt64 later = c.since + 3000000000u;

    toolClose(fd);
    while (status >= 0 && await(&c))
        status = receive(&c, later);
    testOk(status == -1 && c.since == later && c.lasted == 3000000000u,
           "closed by the PLC after 3 s: it is known how long the connection lasted");
    end(&c);
}

static void testReset(void)
{
    plcConnection c;
    int fd = connected(&c, 4, 4), status = 0;

    toolReset(fd);
    while (status >= 0 && await(&c))
        status = receive(&c, now());
    testOk(status == -1 && c.state == plcConnectionDown &&
               strcmp(c.error, "connection reset by PLC") == 0,
           "reset while receiving: %s", c.error);
    end(&c);

    fd = connected(&c, 4, 4);
    toolReset(fd);
    await(&c);
    memcpy(plcBlocks.space(blocks), "1234", 4);
    status = sendBlock(&c, 1);
    if (status >= 0)
        status = sendBlock(&c, 1);
    testOk(status == -1 && c.state == plcConnectionDown &&
               strcmp(c.error, "connection reset by PLC") == 0,
           "reset while sending: %s (and no SIGPIPE)", c.error);
    end(&c);
}

/* More than the kernel takes at once, to a peer that does not read at first. */
static void testPartialSend(void)
{
    const size_t size = 12 << 20;
    char *block = malloc(size), *received = malloc(size);
    plcConnection c;
    int fd = connected(&c, 0, size), status, stops = 0;
    size_t i, got = 0;

    for (i = 0; i < size; i++)
        block[i] = (char)(i * 2654435761u >> 13);
    memcpy(plcBlocks.space(blocks), block, size);
    status = sendBlock(&c, 1);
    testOk(status == 0 && plcBlocks.sending(blocks) &&
               plcConnectionEvents(&c, 1) == (POLLIN | POLLOUT),
           "a block that the kernel does not take whole: it waits for room");
    while (status == 0) {
        long n = toolPeek(fd, received + got, size - got > 65536 ? 65536 : size - got);

        if (n < 0)
            break;
        got += (size_t)n;
        status = sendBlock(&c, 0);
        stops += status == 0;
    }
    testOk(status == 1 && !plcBlocks.sending(blocks), "it goes on as the peer reads (%d times)",
           stops);
    got += toolReceive(fd, received + got, size - got);
    testOk(got == size && memcmp(block, received, size) == 0, "and arrives byte by byte");

    sendBlock(&c, 1);
    plcConnectionClose(&c, "given up", now());
    plcBlocks.connected(blocks, &c);
    testOk(!plcBlocks.sending(blocks), "a half sent block is forgotten on the next connection");
    toolClose(fd);
    end(&c);
    free(block);
    free(received);
}

/* The second connection of one plcConnection begins afresh. */
static void testAgain(void)
{
    int port = 0, listener = toolListen(&port), fd, round;
    plcConnection c;
    char block[4];

    begin(&c, 4, 4);
    for (round = 0; round < 3; round++) {
        plcConnectionOpen(&c, *loopback(), htons((unsigned short)port), now());
        fd = toolAccept(listener);
        finish(&c);
        toolSend(fd, "ABCDEF", 6);
        while (plcFramingCount(framing) == 0 && await(&c) &&
               receive(&c, now()) >= 0)
            ;
        memcpy(plcBlocks.space(blocks), "WXYZ", 4);
        sendBlock(&c, 1);
        testOk(memcmp(plcFramingNewest(framing), "ABCD", 4) == 0 &&
                   toolReceive(fd, block, 4) == 4 && memcmp(block, "WXYZ", 4) == 0,
               "connection %d carries whole blocks", round + 1);
        /* Opening anew closes the old one. */
        plcConnectionOpen(&c, *loopback(), htons((unsigned short)port), now());
        testOk(toolClosed(fd), "the old one is closed");
        toolClose(fd);
        fd = toolAccept(listener);
        toolClose(fd);
    }
    toolClose(listener);
    end(&c);
}

MAIN(connectionTest)
{
    testPlan(2 + 1 + 5 + 3 + 1 + 2 + 4 + 6 + (int)WORDS);
    testRefused();
    testNoDescriptor();
    testWords();
    testMade();
    testInput();
    testLasted();
    testReset();
    testPartialSend();
    testAgain();
    return testDone();
}
