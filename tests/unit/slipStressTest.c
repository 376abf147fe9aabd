/* Streams that slip, against a real station: a PLC on loopback, played by the test, sends good
 * blocks and then loses bytes, sends some too many, changes its block size, or begins to send
 * in pieces. The station has read-backs with track=on, and puts come all the time.
 *
 * What must hold: each block that the records get is one that the PLC has sent, and each word
 * that the PLC gets is one that it has shown or that was put. A PLC that sends in pieces loses
 * no block. In the end it is said what is wrong, and good blocks come again.
 *
 * Arguments: number of episodes (8, or PLCLINK_EPISODES), seed (from the clock). A machine
 * that sleeps makes a PLC of other times than meant; such an episode is told from a wrong one
 * by the times at which each piece was sent and read, and not counted.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <epicsMutex.h>
#include <epicsThread.h>
#include <epicsTime.h>
#include <epicsUnitTest.h>
#include <errlog.h>
#include <testMain.h>

#include "plcBlocks.h"
#include "plcStation.h"
#include "testTools.h"

#define MS 1000000ull
#define IN_MAX 300
#define OUT 8
#define MIRROR 4 /* where the input block shows the output block */
#define KEPT 256 /* blocks that are remembered */
#define LAST_BLOCKS 60

typedef enum { drops, adds, resizes, pieces, faults } fault;

static const char *const faultNames[faults] = {"bytes lost", "bytes too many", "another size",
                                               "begins to send in pieces"};

typedef struct world {
    plcStation *station;
    int listener, fd;
    size_t inSize;
    double period; /* ms */
    unsigned most; /* pieces of a block */
    epicsUInt64 due;
    epicsUInt64 bytes, closed;    /* the station has read so many when it has read all; and so
                                     often it had lost the connection before this one */
    unsigned sent, good;          /* blocks; good ones */
    unsigned char out[OUT];       /* as the PLC has it */
    unsigned char partial[OUT];   /* of the block from the IOC */
    size_t fill;
    unsigned words;               /* numbers of setpoints */
    double late;                  /* ms: so long after its time a piece was sent and read */
    int excused;                  /* an end of a piece looked like that of a block */
    const char *failure;
    /* with the station's thread: */
    epicsMutexId lock;
    unsigned char kept[KEPT][IN_MAX];
    unsigned shown, wrong;
} world;

static world w;
static unsigned long long state;

static unsigned below(unsigned n)
{
    state = state * 6364136223846793005ull + 1442695040888963407ull;
    return (unsigned)(state >> 33) % n;
}

static void fails(const char *why)
{
    if (!w.failure)
        w.failure = why;
}

/* --- Words and blocks that are known again ------------------------------------------------ */

/* Setpoint number `n` of the HMI or of a put: its last byte is the sum of the others. */
static void makeWord(unsigned char *at, int byHmi)
{
    unsigned n = ++w.words;

    at[0] = byHmi ? 0xa5 : 0x5a;
    at[1] = (unsigned char)(n >> 8);
    at[2] = (unsigned char)n;
    at[3] = (unsigned char)(at[0] * 3 + at[1] * 5 + at[2] * 7 + 1);
}

static int goodWord(const unsigned char *at)
{
    static const unsigned char none[4] = {0, 0, 0, 0};

    return memcmp(at, none, 4) == 0 ||
           ((at[0] == 0xa5 || at[0] == 0x5a) &&
            at[3] == (unsigned char)(at[0] * 3 + at[1] * 5 + at[2] * 7 + 1));
}

static void makeBlock(unsigned char *block, size_t size, unsigned n)
{
    size_t i;

    for (i = 0; i < size; i++)
        block[i] = (unsigned char)((n * 2654435761u + i * 40503u) >> 7);
    block[0] = (unsigned char)(n >> 8);
    block[1] = (unsigned char)n;
    memcpy(block + MIRROR, w.out, OUT);
}

/* In the station's thread: the records have this block now. */
static void delivered(void *pvt, const void *block, const epicsTimeStamp *stamp)
{
    const unsigned char *bytes = block;
    unsigned i;

    (void)pvt, (void)stamp;
    epicsMutexMustLock(w.lock);
    w.shown++;
    for (i = 0; i < KEPT && memcmp(w.kept[i], bytes, w.inSize); i++)
        ;
    if (i == KEPT)
        w.wrong++;
    epicsMutexUnlock(w.lock);
}

/* Blocks that the records have got. */
static unsigned shown(void)
{
    unsigned count;

    epicsMutexMustLock(w.lock);
    count = w.shown;
    epicsMutexUnlock(w.lock);
    return count;
}

static const plcListener listener = {.delivered = delivered};

/* --- The PLC ------------------------------------------------------------------------------ */

/* What the IOC has sent: the PLC takes it. Returns 0 when the connection is gone. */
static int takeOutput(void)
{
    for (;;) {
        long n = toolPeek(w.fd, w.partial + w.fill, OUT - w.fill);

        if (n < 0)
            return 0;
        if (n == 0)
            return 1;
        w.fill += (size_t)n;
        if (w.fill < OUT)
            continue;
        w.fill = 0;
        if (!goodWord(w.partial) || !goodWord(w.partial + 4))
            fails("the IOC sent a word that nobody has made");
        memcpy(w.out, w.partial, OUT);
    }
}

static void sleepUntil(epicsUInt64 time)
{
    epicsUInt64 now = epicsMonotonicGet();

    if (now < time)
        epicsThreadSleep((time - now) * 1e-9);
}

/* The next connection of the station. */
static void acceptStation(void)
{
    plcStats st;

    w.fd = toolAccept(w.listener);
    plcStationStats(w.station, &st);
    w.bytes = st.bytesIn;
    w.closed = st.disconnects;
    w.fill = 0;
    w.due = epicsMonotonicGet() + 5 * MS;
}

/* A machine that is awake has each piece sent, and read by the station, in this time, ms. */
static double awake(void)
{
    return w.period / 8;
}

static int isRead(void)
{
    plcStats st;

    plcStationStats(w.station, &st);
    return st.bytesIn >= w.bytes || st.disconnects > w.closed;
}

/* Sends what is due at that time, and sees the station read it. */
static int sendPiece(const unsigned char *bytes, size_t size, epicsUInt64 at)
{
    double late;

    sleepUntil(at);
    if (toolSend(w.fd, bytes, size))
        return 0;
    w.bytes += size;
    while (late = (double)(epicsMonotonicGet() - at) / MS, !isRead() && late < awake())
        epicsThreadSleep(0.0002); /* the pace of the looks */
    if (late > w.late)
        w.late = late;
    return 1;
}

static void putSometimes(void)
{
    unsigned char word[4];
    char reason[PLC_REASON_SIZE];

    if (below(3))
        return;
    makeWord(word, 0);
    plcStationPut(w.station, 4 * below(2), 4, word, NULL, reason, 1, NULL);
}

/* Sends the bytes of a block in pieces, then waits for the time of the next. */
static int sendPieces(const unsigned char *bytes, size_t size)
{
    unsigned count = 1 + below(w.most), i;
    size_t done = 0;
    epicsUInt64 at = w.due;

    for (i = 0; done < size; i++) {
        size_t piece = i + 1 < count ? 1 + below((unsigned)(size - done)) : size - done;

        if (i)
            at += (epicsUInt64)(below(1000) * 0.3e-3 * w.period * MS);
        if (!sendPiece(bytes + done, piece, at))
            return 0;
        done += piece;
        w.excused |= size > w.inSize && done == w.inSize && done < size;
    }
    w.due = at + (epicsUInt64)(w.period * MS);
    putSometimes();
    return takeOutput();
}

/* A good block, with so many bytes (random ones) before it. */
static int sendGood(size_t before)
{
    unsigned char bytes[2 * IN_MAX];
    size_t i;

    for (i = 0; i < before; i++)
        bytes[i] = (unsigned char)below(256);
    if (!below(4))
        makeWord(w.out + 4 * below(2), 1);
    makeBlock(bytes + before, w.inSize, ++w.sent);
    epicsMutexMustLock(w.lock);
    memcpy(w.kept[w.sent % KEPT], bytes + before, w.inSize);
    epicsMutexUnlock(w.lock);
    w.good++;
    return sendPieces(bytes, w.inSize + before);
}

/* A block of `size` bytes, the last or the first ones of a good one. */
static int sendBad(size_t size, int tail)
{
    unsigned char bytes[2 * IN_MAX];

    makeBlock(bytes, 2 * IN_MAX, ++w.sent);
    return sendPieces(bytes + (tail && size < w.inSize ? w.inSize - size : 0), size);
}

/* --- Episodes ------------------------------------------------------------------------------ */

static void begin(void)
{
    static const double periods[] = {10, 20, 20, 30, 50, 100, 200};
    plcStationConfig config = {.transport = &plcBlocks, .name = "PLC", .address = {"127.0.0.1", ""}, .bigEndian = 1,
                               .outSize = OUT, .recvTimeout = 60000, .sendInterval = 5};
    char error[200];

    w.inSize = MIRROR + OUT + below(below(2) ? 8 : IN_MAX - MIRROR - OUT);
    w.period = periods[below(sizeof(periods) / sizeof(periods[0]))];
    w.most = below(2) ? 1 : 1 + below(5);
    w.sent = w.good = w.shown = w.wrong = w.words = 0;
    w.late = w.excused = 0;
    w.failure = NULL;
    memset(w.out, 0, OUT);
    memset(w.kept, 0xee, sizeof(w.kept));
    w.listener = toolListen(&config.port);
    config.inSize = w.inSize;
    w.station = plcStationCreate(&config);
    if (plcStationSetOption(w.station, "track", "on", error, sizeof(error)) ||
        plcStationListen(w.station, &listener, NULL))
        testAbort("%s", error);
    plcStationAddReadback(w.station, &w, 0, MIRROR, OUT, NULL);
    plcStationsStart();
    plcStationsRun();
    acceptStation();
}

static void finish(void)
{
    plcStationsDestroy();
    toolClose(w.fd);
    toolClose(w.listener);
}

/* Sends on until the station has had enough. Returns 1 when it closed the connection. */
static int sendOn(fault what, size_t size)
{
    int i;

    for (i = 0; i < LAST_BLOCKS; i++)
        if (!(what == resizes ? sendBad(size, 0) : sendGood(0)))
            return 1;
    return 0;
}

static int isSaid(void)
{
    plcStats st;

    plcStationStats(w.station, &st);
    return strstr(st.lastError, "out of step") || strstr(st.lastError, "inSize") ||
           strstr(st.lastError, "no blocks");
}

static void slips(fault what)
{
    size_t by = 1 + below((unsigned)w.inSize - 1), size = w.inSize;
    unsigned before;

    if (what == resizes)
        while (size % w.inSize == 0) /* a multiple looks like a backlog */
            size = w.inSize / 2 + below((unsigned)w.inSize);
    if (what == drops)
        sendBad(w.inSize - by, (int)below(2));
    else if (what == adds)
        sendGood(by);
    if (!sendOn(what, size)) {
        fails("it is not found out");
        return;
    }
    WAIT_FOR(isSaid()); /* the connection ends first */
    if (!isSaid())
        fails("it is not said what is wrong");
    toolClose(w.fd);
    acceptStation();
    before = shown();
    sendGood(0);
    WAIT_FOR(shown() > before);
    if (shown() == before)
        fails("after it no good block is shown");
}

static void sendsPieces(void)
{
    unsigned before = w.good, then, i;
    plcStats st;

    WAIT_FOR(shown() == before || w.late >= awake());
    then = shown();
    w.most = 2 + below(4);
    for (i = 0; i < 20; i++)
        sendGood(0);
    WAIT_FOR(shown() - then == w.good - before || w.late >= awake());
    plcStationStats(w.station, &st);
    if (st.skipped || st.doubts)
        fails("a PLC that begins to send in pieces has lost a block");
}

static int episode(int number)
{
    fault what = (fault)below(faults);
    int n, good = 10 + (int)below(6);

    begin();
    for (n = 0; n < good; n++)
        sendGood(0);
    if (what == pieces)
        sendsPieces();
    else
        slips(what);
    finish();
    if (w.wrong > 1 || (w.wrong && !w.excused))
        fails("a block was shown that the PLC has not sent");
    if (w.failure && (w.late >= awake() || (w.wrong && w.excused))) {
        testDiag("episode %d, %s each %.0f ms: the machine slept for %.1f ms, or the end of a "
                 "piece looked like that of a block (%s)", number, faultNames[what], w.period,
                 w.late, w.failure);
        return 0;
    }
    if (w.failure)
        testDiag("episode %d, %s, %u bytes each %.0f ms in up to %u pieces: %s (%u wrong)",
                 number, faultNames[what], (unsigned)w.inSize, w.period, w.most, w.failure,
                 w.wrong);
    return w.failure ? -1 : 1;
}

MAIN(slipStressTest)
{
    const char *text = getenv("PLCLINK_EPISODES");
    int count = argc > 1 ? atoi(argv[1]) : text ? atoi(text) : 8;
    int i, result, good = 0, bad = 0;

    testPlan(2);
    eltc(0); /* the log is for people; here the test speaks */
    state = argc > 2 ? strtoull(argv[2], NULL, 0) : epicsMonotonicGet();
    testDiag("%d episodes, seed %llu", count, state);
    w.lock = epicsMutexMustCreate();
    /* Where the machine slept in all of them, some more. */
    for (i = 0; (i < count || (i < 5 * count && !good)) && bad < 10; i++) {
        result = episode(i);
        good += result > 0;
        bad += result < 0;
    }
    testOk(!bad, "streams that slip: nothing wrong is shown or sent, and no block is lost");
    testOk(good > 0, "in %d of %d episodes (in the others the machine slept)", good, i);
    return testDone();
}
