/* The worker of EtherNet/IP against a controller of this test, which lies: answers with a wrong
 * context, answers of another request, frames that are cut, random bytes. No value is ever
 * wrong, none stands still for good, and nothing grows.
 *
 * EIP_LIES=10000 for so many of each kind; else 50.
 */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/socket.h>

#include <epicsAtomic.h>
#include <epicsEvent.h>
#include <epicsStdio.h>
#include <epicsString.h>
#include <epicsThread.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "eipWorker.h"
#include "testTools.h"

enum { wrote = 0x1234567, left = 0x7654321 };
enum { tagCount = 8, imageSize = 4096, frameMax = 70000, warmUp = 6 };

/* The value of tag n: such as no random bytes have. */
static epicsUInt32 valueOf(unsigned n)
{
    return 0x5a00c300u + n * 0x01010101u;
}

/* --- The controller: its own code, byte by byte -------------------------------------------- */

typedef enum {
    tells = -1, /* the truth */
    wrongContext,
    another,    /* request's answer: that of the one before */
    truncated,  /* and closed */
    tooShort,   /* the length says more */
    noise,      /* instead of the frame */
    badBody,    /* random bytes in a frame that is right */
    wrongSequence,
    lies
} lie;

static const char *const lieNames[] = {
    "a wrong context",     "the answer of the request before", "a frame that is cut",
    "a frame too short",   "random bytes",                     "a random message",
    "a wrong sequence"};

static struct {
    int listener, port;
    int lie;       /* atomic: what it does */
    int told;      /* atomic: how many lies of this kind */
    int written;   /* atomic: the last value that was written */
    epicsUInt32 seed;
    unsigned char frame[frameMax], answer[frameMax], last[frameMax];
    size_t lastLength;
    epicsUInt32 connection; /* T->O of the client */
} plc;

static unsigned randomBelow(unsigned n)
{
    plc.seed = plc.seed * 1664525u + 1013904223u;
    return (plc.seed >> 8) % n;
}

static unsigned get16(const unsigned char *at)
{
    return at[0] | (unsigned)at[1] << 8;
}

static void put16(unsigned char *at, unsigned value)
{
    at[0] = value & 0xff;
    at[1] = value >> 8 & 0xff;
}

static void put32(unsigned char *at, epicsUInt32 value)
{
    put16(at, value & 0xffff);
    put16(at + 2, value >> 16);
}

/* One service: Read Tag of "T0" to "T7", Write Tag of one element; all else is refused. Returns the bytes. */
static size_t serve(const unsigned char *q, unsigned char *a)
{
    const unsigned char *path = q + 2;

    memset(a, 0, 4);
    a[0] = q[0] | 0x80;
    if (q[0] == 0x4c && path[0] == 0x91 && path[1] == 2 && path[2] == 'T' && path[3] >= '0' &&
        path[3] < '0' + tagCount) {
        put16(a + 4, 0xc4);
        put32(a + 6, valueOf(path[3] - '0'));
        return 10;
    }
    if (q[0] == 0x4d && path[0] == 0x91 && path[1] == 2 && path[2] == 'T') {
        epicsAtomicSetIntT(&plc.written, (int)(get16(path + 8) | get16(path + 10) << 16));
        return 4;
    }
    if (q[0] == 0x5b) { /* Large Forward Open: the ids, and the triad back */
        put32(a + 4, 0x11223344);
        memcpy(a + 8, q + 12, 4);
        memcpy(&plc.connection, q + 12, 4);
        memcpy(a + 12, q + 16, 8);
        put32(a + 20, 2000000);
        put32(a + 24, 2000000);
        put16(a + 28, 0);
        return 30;
    }
    a[2] = q[0] == 0x4c ? 5 : 8;
    return 4;
}

/* A message, perhaps of several services. */
static size_t answerMessage(const unsigned char *q, unsigned char *a)
{
    unsigned count, i;
    size_t n;

    if (q[0] == 0x52) /* Unconnected_Send: what is in it */
        return serve(q + 10, a);
    if (q[0] != 0x0a)
        return serve(q, a);
    count = get16(q + 6);
    memset(a, 0, 4);
    a[0] = 0x8a;
    put16(a + 4, count);
    n = 2 + 2 * count;
    for (i = 0; i < count; i++) {
        put16(a + 6 + 2 * i, (unsigned)n);
        n += serve(q + 6 + get16(q + 8 + 2 * i), a + 4 + n);
    }
    return n + 4;
}

/* The whole answer to plc.frame in plc.answer. Returns its bytes. */
static size_t answerFrame(void)
{
    unsigned char *a = plc.answer;
    size_t n = 0;

    memcpy(a, plc.frame, 24);
    switch (plc.frame[0]) {
    case 0x65:
        put32(a + 4, 0x77);
        memcpy(a + 24, plc.frame + 24, 4);
        n = 4;
        break;
    case 0x6f:
        memcpy(a + 24, plc.frame + 24, 16);
        n = answerMessage(plc.frame + 40, a + 40);
        put16(a + 38, (unsigned)n);
        n += 16;
        break;
    case 0x70:
        memcpy(a + 24, plc.frame + 24, 22);
        memcpy(a + 36, &plc.connection, 4);
        n = answerMessage(plc.frame + 46, a + 46) + 2;
        put16(a + 42, (unsigned)n);
        n += 20;
        break;
    default:
        put32(a + 8, 1); /* no such command */
        break;
    }
    put16(a + 2, (unsigned)n);
    return n + 24;
}

/* Sends the answer, or a lie in its place. Returns 0 when the connection is to end. */
static int sendAnswer(int fd, size_t n, int kind)
{
    unsigned char *a = plc.answer;
    size_t i;

    switch (kind) {
    case wrongContext:
        a[12 + randomBelow(8)] ^= 1 + randomBelow(255);
        break;
    case another:
        return toolSend(fd, plc.last, plc.lastLength) == 0;
    case truncated:
        toolSend(fd, a, randomBelow((unsigned)n));
        return 0;
    case tooShort:
        put16(a + 2, (unsigned)n - 24 - 1 - randomBelow((unsigned)n - 30));
        break;
    case noise:
        n = 24 + randomBelow(400);
        for (i = 0; i < n; i++)
            a[i] = randomBelow(256);
        break;
    case badBody:
        for (i = 46; i < n; i++)
            a[i] = randomBelow(256);
        break;
    case wrongSequence:
        put16(a + 44, get16(a + 44) + 1 + randomBelow(65535));
        break;
    default:
        break;
    }
    return toolSend(fd, a, n) == 0;
}

/* One client, until it goes or a lie ends it. */
static void converse(int fd)
{
    unsigned connected = 0, start = 1 + randomBelow(warmUp);

    while (toolReceive(fd, plc.frame, 24) == 24) {
        size_t length = get16(plc.frame + 2), n;
        int kind = epicsAtomicGetIntT(&plc.lie);

        if (toolReceive(fd, plc.frame + 24, length) != length)
            return;
        n = answerFrame();
        connected += plc.frame[0] == 0x70;
        /* not before there was an answer to give again */
        if (plc.frame[0] != 0x70 || connected <= start)
            kind = tells;
        if (kind != tells)
            epicsAtomicIncrIntT(&plc.told);
        if (kind != another) {
            memcpy(plc.last, plc.answer, n);
            plc.lastLength = n;
        }
        if (!sendAnswer(fd, n, kind))
            return;
    }
}

static void plcThread(void *arg)
{
    int fd, on = 1;

    (void)arg;
    while ((fd = accept(plc.listener, NULL, NULL)) >= 0) {
        setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
        converse(fd);
        close(fd);
    }
}

/* --- The station, as far as the worker needs one --------------------------------------------- */

static struct {
    eipWorker *worker;
    plcTransportSetup setup;
    epicsEventId news;
    int fd; /* -1: not connected */
    epicsUInt8 in[imageSize], out[imageSize];
    unsigned blocks, losses, wrong, good[tagCount];
} station;

static void wake(void *arg)
{
    (void)arg;
    epicsEventSignal(station.news);
}

static void dial(void)
{
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons((unsigned short)plc.port)};

    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    station.fd = socket(AF_INET, SOCK_STREAM, 0);
    if (connect(station.fd, (struct sockaddr *)&to, sizeof(to)))
        testAbort("cannot connect");
    eipWorkerStart(station.worker, station.fd);
}

static void hangUp(void)
{
    eipWorkerStop(station.worker);
    close(station.fd);
}

/* Each cell has no value, or the right one. */
static void look(void)
{
    unsigned i;

    for (i = 0; i < tagCount; i++) {
        const epicsUInt8 *cell = station.in + i * eipCellSize;

        if (!cell[0] && !cell[1])
            continue;
        if (cell[0] == 0xc4 && !cell[1] &&
            eipGetUnsigned(cell + eipPlaceHead, 8) ==
                (epicsUInt64)(epicsInt64)(epicsInt32)valueOf(i))
            station.good[i]++;
        else
            station.wrong++;
    }
}

/* Waits for news and takes them; a connection that is lost is made anew. */
static void turn(void)
{
    plcNews news;

    epicsEventWaitWithTimeout(station.news, 1);
    if (!eipWorkerTake(station.worker, &news, station.in, station.out))
        return;
    if (news.blocks) {
        station.blocks += news.blocks;
        look();
    }
    if (news.lost) {
        station.losses++;
        hangUp();
        plcImageAway(station.setup.out, 1);
        plcImageAway(station.setup.out, 0);
        dial();
        eipWorkerPut(station.worker);
    }
}

/* --- What is wanted, by one who also puts ---------------------------------------------------- */

typedef enum { putsNothing, putsWanted, putsLeft } putting;

static struct {
    int changed; /* atomic */
    int without; /* atomic: the last tag is not wanted */
    int puts;    /* atomic: what it puts when it is asked the next time */
} source;

static eipWant *wants(unsigned count)
{
    eipWant *w = calloc(tagCount + 1, sizeof(*w));
    unsigned i;

    for (i = 0; i < count; i++) {
        char name[] = "T0";

        name[1] = (char)('0' + i);
        w[i] = (eipWant){.tag = epicsStrDup(name), .count = 1, .kind = eipCell, .period = 1,
                         .place = i * eipCellSize, .room = eipCellSize};
    }
    return w;
}

/* A number for the last tag, whole. */
static void putLast(epicsUInt32 value)
{
    epicsUInt8 cell[eipCellSize] = {0}, mask[eipCellSize];
    epicsUInt64 number = value;
    unsigned i;

    memset(mask, 0xff, sizeof(mask));
    cell[eipPlaceKindAt] = eipSigned;
    for (i = 0; i < 8; i++)
        cell[eipPlaceHead + i] = number >> 8 * i & 0xff;
    plcImageWrite(station.setup.out, (tagCount - 1) * eipCellSize, eipCellSize, cell, mask,
                  NULL);
}

/* Nothing is new; in the next moment somebody wants the last tag, and puts something, or puts it
 * without. */
static int tell(void *arg, eipWant **all, unsigned *count, size_t *used)
{
    int what = epicsAtomicGetIntT(&source.puts);

    (void)arg;
    if (what != putsNothing) {
        putLast(what == putsWanted ? wrote : left);
        eipWorkerPut(station.worker);
        epicsAtomicSetIntT(&source.without, what != putsWanted);
        epicsAtomicSetIntT(&source.changed, what == putsWanted);
        epicsAtomicSetIntT(&source.puts, putsNothing);
        return 0;
    }
    if (!epicsAtomicGetIntT(&source.changed))
        return 0;
    epicsAtomicSetIntT(&source.changed, 0);
    *count = tagCount - (unsigned)epicsAtomicGetIntT(&source.without);
    *used = imageSize;
    *all = wants(*count);
    return 1;
}

static void begin(void)
{
    eipConnectOptions connect = {.connected = 1, .size = eipSizeLarge,
                                 .room = eipUnconnectedRoom, .timeout = 1000};
    eipWorkerOptions options = {.requestTimeout = 20, .relearn = 0};

    eipRouteParse("1,0", &connect.route, (char[100]){0}, 100);
    station.news = epicsEventMustCreate(epicsEventEmpty);
    station.setup = (plcTransportSetup){.name = "LIAR", .inSize = imageSize,
                                        .outSize = imageSize, .wake = wake,
                                        .inFaults = plcFaultsCreate(imageSize),
                                        .outFaults = plcFaultsCreate(imageSize)};
    station.setup.out = plcImageCreate(imageSize);
    plcImageKeepPuts(station.setup.out, 100);
    source.changed = 1;
    station.worker = eipWorkerCreate(&station.setup, &connect, tell, NULL);
    eipWorkerSetOptions(station.worker, &options);
    eipWorkerBegin(station.worker);
    dial();
}

static long maxKilobytes(void)
{
    struct rusage usage;

    getrusage(RUSAGE_SELF, &usage);
    return usage.ru_maxrss;
}

static int allGood(void)
{
    unsigned i;

    for (i = 0; i < tagCount; i++)
        if (!station.good[i])
            return 0;
    return 1;
}

/* So many lies of one kind, then the truth: all values come. */
static void testLie(int kind, int count)
{
    unsigned losses = station.losses;
    epicsUInt64 end;

    epicsAtomicSetIntT(&plc.told, 0);
    epicsAtomicSetIntT(&plc.lie, kind);
    station.wrong = 0;
    end = epicsMonotonicGet() + (epicsUInt64)(60 + count / 20) * 1000000000u;
    while (epicsAtomicGetIntT(&plc.told) < count && epicsMonotonicGet() < end)
        turn();
    testOk(epicsAtomicGetIntT(&plc.told) >= count, "%s, %d times: none stops the worker",
           lieNames[kind], epicsAtomicGetIntT(&plc.told));
    testOk(station.wrong == 0, "and no value is wrong (%u)", station.wrong);
    testOk(station.losses > losses, "each is a lost connection (%u)", station.losses - losses);
    epicsAtomicSetIntT(&plc.lie, tells);
    memset(station.good, 0, sizeof(station.good));
    end = epicsMonotonicGet() + (epicsUInt64)PATIENCE_S * 1000000000u;
    while (!allGood() && epicsMonotonicGet() < end)
        turn();
    testOk(allGood(), "then all values come again");
}

/* Puts just when the worker has asked what is wanted. */
static int putNow(putting what)
{
    epicsUInt64 end = epicsMonotonicGet() + (epicsUInt64)PATIENCE_S * 1000000000u;

    epicsAtomicSetIntT(&source.puts, what);
    eipWorkerWant(station.worker);
    while ((epicsAtomicGetIntT(&source.puts) != putsNothing ||
            plcImagePutsWaiting(station.setup.out, NULL, NULL)) && epicsMonotonicGet() < end)
        turn();
    return !plcImagePutsWaiting(station.setup.out, NULL, NULL);
}

static void testPutBeforeWish(void)
{
    eipWorkerOptions patient = {.requestTimeout = 5000, .relearn = 0};

    eipWorkerSetOptions(station.worker, &patient);
    epicsAtomicSetIntT(&source.without, 1);
    epicsAtomicSetIntT(&source.changed, 1);
    eipWorkerWant(station.worker);
    WAIT_FOR((turn(), !epicsAtomicGetIntT(&source.changed)));
    testOk(putNow(putsLeft) && epicsAtomicGetIntT(&plc.written) == 0,
           "a put to a tag that nobody wants is not written, and holds up nothing");
    testOk(putNow(putsWanted), "a put that is there before its wish has left");
    testOk(epicsAtomicGetIntT(&plc.written) == wrote, "and was written: %#x",
           (unsigned)epicsAtomicGetIntT(&plc.written));
}

MAIN(eipWorkerTest)
{
    const char *text = getenv("EIP_LIES");
    int count = text ? atoi(text) : 50, kind;
    long before = 0;

    testPlan(4 * lies + 5);
    plc.seed = 7;
    plc.listener = toolListen(&plc.port);
    plc.lie = tells;
    epicsThreadMustCreate("plc", epicsThreadPriorityMedium,
                          epicsThreadGetStackSize(epicsThreadStackMedium), plcThread, NULL);
    begin();
    WAIT_FOR((turn(), allGood()));
    testOk(allGood(), "all values come");
    for (kind = 0; kind < lies; kind++) {
        testLie(kind, count);
        if (kind == 0)
            before = maxKilobytes();
    }
    testOk(maxKilobytes() - before < 4000, "nothing grows: %ld kB", maxKilobytes() - before);
    testPutBeforeWish();
    hangUp();
    eipWorkerDestroy(station.worker);
    plcImageDestroy(station.setup.out);
    plcFaultsDestroy(station.setup.inFaults);
    plcFaultsDestroy(station.setup.outFaults);
    epicsEventDestroy(station.news);
    return testDone();
}
