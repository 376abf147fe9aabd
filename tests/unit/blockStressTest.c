/* An IOC with one PLC under random episodes: puts that come back to an old value, changes at
 * the HMI, broken connections, links that change, iocPause. The PLC shows what it holds, late.
 *
 * What must be true, whatever happens:
 *   - what the PLC receives of an output is a row of what was put, in its order: nothing that
 *     nobody put, nothing old after something newer (unless the HMI or a loss had a hand in it);
 *   - when it is quiet, record, output image and PLC hold the same; where neither HMI nor loss
 *     had a hand in it, the last put;
 *   - an output without read-back holds the last put, always;
 *   - a put that the PLC has never received, while it holds another value, is told by its record's alarm
 *     until the next put; only where a loss had a hand in it;
 *   - inputs show the last block, and nothing else has an alarm.
 *
 * Arguments: number of episodes (30, or PLCLINK_EPISODES; "600s": so long), seed (from the
 * clock). One thread plays the PLC, the HMI and the client.
 */
#include <arpa/inet.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <dbAccess.h>
#include <epicsStdio.h>
#include <epicsTime.h>
#include <epicsUnitTest.h>
#include <iocInit.h>
#include <testMain.h>

#include "recordTest.h"
#include "testTools.h"

#define WORDS 6       /* outputs of 4 bytes */
#define FOLLOWERS 3   /* the first of them have a record with a read-back; word 5 may have */
#define SPARE 5       /* the third one's other place */
#define IN 48         /* 0 counter  4 slow  16 what the PLC holds */
#define OUT 24
#define MIRROR 16
#define SLEPT_S 0.4   /* so long the PLC must not stand still: the driver is patient for 1 s */
#define LIFE 15       /* episodes of one IOC */
#define PUTS 64
#define QUEUE 64

static const char *const records[] = {"f0", "f1", "f2", "p3", "p4"};
#define RECORDS (sizeof(records) / sizeof(records[0]))

/* One output as it must be. */
static struct {
    epicsInt32 puts[PUTS]; /* of this episode, in their order */
    unsigned count, at;    /* the PLC has received those before `at` */
    epicsInt32 received;   /* last */
    epicsInt32 wanted;     /* last put, or what it held before the episode */
    int got;               /* the PLC has received that since it was put */
    int others;            /* the HMI or a loss had a hand in it in this episode */
} word[WORDS];

static struct {
    int listener, port, fd; /* -1: none */
    epicsInt32 holds[WORDS], counter, slow;
    epicsUInt8 part[OUT];
    size_t filled;
    double period, reaction, nextSend, lastStep;
    struct {
        double due;
        epicsInt32 words[WORDS];
    } queue[QUEUE];
    unsigned queued;
} plc;

static int wasVoid[RECORDS]; /* it said so at the end of the episode before, and has not put since */
static plcStation *station;
static unsigned long long state;
static epicsInt32 number = 1000;
static int place2 = 2; /* the word of f2 */
static int slept, paused;
static char failure[200];
static unsigned putCount, backCount, hmiCount, breaks, links, pauses, voids, excused;

static unsigned randomBelow(unsigned n)
{
    state = state * 6364136223846793005ull + 1442695040888963407ull;
    return (unsigned)(state >> 33) % n;
}

static double clockNow(void)
{
    return epicsMonotonicGet() * 1e-9;
}

static void fail(const char *what, int w, epicsInt32 value)
{
    if (!failure[0])
        epicsSnprintf(failure, sizeof(failure), "word %d: %s: %d (put %d, PLC %d)", w, what,
                      (int)value, (int)word[w].wanted, (int)plc.holds[w]);
}

/* --- The PLC ---------------------------------------------------------------------------*/

static void judge(int w, epicsInt32 value)
{
    unsigned i;

    if (value == word[w].received)
        return;
    word[w].received = value;
    if (word[w].others)
        return;
    for (i = word[w].at; i < word[w].count && word[w].puts[i] != value; i++)
        ;
    if (i == word[w].count)
        fail("received out of order, or put by nobody", w, value);
    word[w].at = i + 1;
}

static void receiveBlock(double now)
{
    epicsInt32 words[WORDS];
    int w;

    memcpy(words, plc.part, OUT);
    for (w = 0; w < WORDS; w++) {
        words[w] = (epicsInt32)ntohl((epicsUInt32)words[w]);
        judge(w, words[w]);
        word[w].got |= words[w] == word[w].wanted;
    }
    if (plc.queued == QUEUE)
        testAbort("the PLC cannot keep up");
    plc.queue[plc.queued].due = now + plc.reaction;
    memcpy(plc.queue[plc.queued++].words, words, sizeof(words));
}

static void plcReads(double now)
{
    long n;

    while (plc.fd >= 0 &&
           (n = toolPeek(plc.fd, plc.part + plc.filled, OUT - plc.filled)) != 0) {
        if (n < 0) {
            toolClose(plc.fd);
            plc.fd = -1;
            return;
        }
        plc.filled += (size_t)n;
        if (plc.filled < OUT)
            return;
        plc.filled = 0;
        receiveBlock(now);
    }
}

static void plcSends(double now)
{
    epicsUInt32 block[IN / 4] = {0};
    int w;

    if (plc.fd < 0 || now < plc.nextSend)
        return;
    plc.nextSend = now + plc.period;
    block[0] = htonl((epicsUInt32)++plc.counter);
    block[1] = htonl((epicsUInt32)plc.slow);
    for (w = 0; w < WORDS; w++)
        block[MIRROR / 4 + w] = htonl((epicsUInt32)plc.holds[w]);
    toolSend(plc.fd, block, IN);
}

static void plcStep(void)
{
    double now = clockNow();

    slept |= plc.lastStep && now - plc.lastStep > SLEPT_S;
    plc.lastStep = now;
    if (plc.fd < 0 && plc.listener >= 0 && toolWaiting(plc.listener)) {
        plc.fd = toolAccept(plc.listener);
        plc.filled = 0;
    }
    plcReads(now);
    while (plc.queued && plc.queue[0].due <= now) {
        memcpy(plc.holds, plc.queue[0].words, sizeof(plc.holds));
        memmove(plc.queue, plc.queue + 1, --plc.queued * sizeof(plc.queue[0]));
    }
    plcSends(now);
}

static void run(double seconds)
{
    double end = clockNow() + seconds;
    struct pollfd none = {-1, 0, 0};

    do {
        plcStep();
        poll(&none, 1, 1);
    } while (clockNow() < end);
}

#define runUntil(condition, what)                                                           \
    do {                                                                                    \
        double end_ = clockNow() + PATIENCE_S;                                              \
        while (!(condition) && clockNow() < end_)                                           \
            run(0.001);                                                                     \
        if (!(condition) && !failure[0])                                                    \
            epicsSnprintf(failure, sizeof(failure), "never: %s", what);                     \
    } while (0)

/* --- The actors ------------------------------------------------------------------------*/

static int wordOf(unsigned r)
{
    return r == 2 ? place2 : (int)r;
}

static void putValue(unsigned r, epicsInt32 value)
{
    int w = wordOf(r);
    char text[20];

    if (word[w].count == PUTS)
        return;
    putCount++;
    wasVoid[r] = word[w].got = 0;
    word[w].puts[word[w].count++] = word[w].wanted = value;
    /* with a read-back, what waits for a connection is replaced by the PLC's value */
    if (r < FOLLOWERS && (plc.fd < 0 || !plcStationTaken(station) ||
                          !plcStationOutputConnected(station, NULL)))
        word[w].others = 1;
    sprintf(text, "%d", (int)value);
    put(records[r], text);
}

/* Half of the puts are of what was there before the last one, or of a few values. */
static void client(void)
{
    unsigned r = randomBelow(RECORDS), count = word[wordOf(r)].count;
    int w = wordOf(r);

    if (count > 1 && randomBelow(2)) {
        backCount++;
        putValue(r, word[w].puts[count - 2]);
    } else if (randomBelow(2)) {
        putValue(r, (epicsInt32)randomBelow(3));
    } else {
        putValue(r, ++number);
    }
}

/* There and back, with little time between: what is shown meanwhile is older than both. */
static void pulse(void)
{
    unsigned r = randomBelow(RECORDS), i, count = 2 + randomBelow(4);
    epicsInt32 before = word[wordOf(r)].wanted, after = ++number;

    for (i = 0; i < count; i++) {
        putValue(r, i % 2 ? before : after);
        run(randomBelow(12) * 1e-3);
    }
}

static void hmi(void)
{
    int w = wordOf(randomBelow(FOLLOWERS));

    hmiCount++;
    word[w].others = 1;
    plc.holds[w] = ++number;
}

static void breakOff(void)
{
    int w, down = randomBelow(2);

    breaks++;
    for (w = 0; w < WORDS; w++)
        if (w != 3 && w != 4)
            word[w].others = 1;
    toolClose(plc.fd);
    plc.fd = -1;
    if (!down)
        return;
    toolClose(plc.listener);
    plc.listener = -1;
    while (randomBelow(4))
        client();
    run(randomBelow(30) * 1e-3);
    plc.listener = toolListen(&plc.port);
}

static void changeLink(void)
{
    links++;
    word[2].others = word[SPARE].others = 1;
    place2 = place2 == 2 ? SPARE : 2;
    put("f2.OUT", place2 == 2 ? "@P/8 T=INT32 R=24" : "@P/20 T=INT32 R=36");
}

static void pauseOrRun(void)
{
    pauses += !paused;
    if (paused ? iocRun() : iocPause())
        testAbort("iocPause or iocRun");
    paused = !paused;
}

static void slowChanges(void)
{
    plc.slow = ++number;
}

static const struct {
    void (*act)(void);
    unsigned weight;
} actors[] = {
    {client, 40}, {pulse, 12}, {slowChanges, 8}, {hmi, 6}, {breakOff, 3}, {changeLink, 3},
    {pauseOrRun, 3},
};
#define WEIGHTS 75

static void act(unsigned weights)
{
    unsigned draw = randomBelow(weights), i = 0;

    while (draw >= actors[i].weight)
        draw -= actors[i++].weight;
    actors[i].act();
}

/* --- Episodes --------------------------------------------------------------------------*/

static epicsInt32 imageHolds(int w)
{
    epicsUInt32 wire;

    plcImagePeek(plcStationOutput(station), 4 * (size_t)w, 4, &wire);
    return (epicsInt32)ntohl(wire);
}

static int isGood(const char *record)
{
    char pv[20];

    epicsSnprintf(pv, sizeof(pv), "%s.SEVR", record);
    return strcmp(get(pv), "NO_ALARM") == 0;
}

/* It says that its last put is not in the PLC, or perhaps not. */
static int saysVoid(const char *record)
{
    char pv[20];

    epicsSnprintf(pv, sizeof(pv), "%s.STAT", record);
    return strcmp(get(pv), "WRITE") == 0 &&
           (isReason(record, plcNotWritten) || isReason(record, plcNotConfirmed));
}

/* Its alarm is true. f2 has another place now and then: with a new link it knows of no put. */
static int alarmIsTrue(unsigned r)
{
    int w = wordOf(r);

    if (isGood(records[r]))
        return r >= 2 || word[w].got || plc.holds[w] == word[w].wanted;
    return r < FOLLOWERS && saysVoid(records[r]) && (word[w].others || wasVoid[r]);
}

/* Record, image and PLC agree, and on what they must. */
static int settled(unsigned r)
{
    int w = wordOf(r);

    return !plc.queued && alarmIsTrue(r) && imageHolds(w) == plc.holds[w] &&
           atoi(get(records[r])) == plc.holds[w] &&
           (word[w].others || plc.holds[w] == word[w].wanted);
}

static int inputsGood(void)
{
    return isGood("counter") && isGood("slow") && atoi(get("slow")) == plc.slow &&
           plc.counter - atoi(get("counter")) < 100;
}

static int allSettled(void)
{
    unsigned r;

    for (r = 0; r < RECORDS; r++)
        if (!settled(r))
            return 0;
    return 1;
}

/* For longer than a block is on its way. */
static int stayedSettled(void)
{
    static double since;

    if (!allSettled())
        since = 0;
    else if (!since)
        since = clockNow();
    return since && clockNow() - since > 0.1;
}

static void sayWhich(void)
{
    unsigned r;

    for (r = 0; r < RECORDS; r++) {
        int w = wordOf(r);
        char value[20];

        strcpy(value, get(records[r]));
        testDiag("%s: %s, image %d, PLC %d, put %d%s, %s", records[r], value,
                 (int)imageHolds(w), (int)plc.holds[w], (int)word[w].wanted,
                 word[w].others ? ", not only puts" : "", isGood(records[r]) ? "good" : "alarm");
    }
    testDiag("counter %d of %d", atoi(get("counter")), (int)plc.counter);
    testDiag("slow %d of %d", atoi(get("slow")), (int)plc.slow);
}

static void settle(void)
{
    int w;

    if (paused)
        pauseOrRun();
    runUntil(plc.fd >= 0 && plcStationTaken(station), "connected");
    runUntil(stayedSettled(), "record, output and PLC agree");
    runUntil(inputsGood(), "inputs show the last block");
    if (failure[0])
        sayWhich();
    for (w = 0; w < (int)RECORDS; w++) {
        wasVoid[w] = !isGood(records[w]);
        voids += wasVoid[w];
    }
    for (w = 0; w < WORDS; w++) {
        word[w].wanted = word[w].received = plc.holds[w];
        word[w].count = word[w].at = 0;
        word[w].got = 1;
        word[w].others = (w == 2 || w == SPARE) && w != place2; /* nobody's */
    }
}

/* Puts alone in half of the episodes: there nothing excuses a wrong order. */
static int episode(void)
{
    unsigned i, count = 2 + randomBelow(25), weights = randomBelow(2) ? 60 : WEIGHTS;

    failure[0] = 0;
    slept = 0;
    plc.period = 1e-3 * (1 + randomBelow(8));
    plc.reaction = 1e-3 * randomBelow(40);
    for (i = 0; i < count && !failure[0]; i++) {
        act(weights);
        run(randomBelow(3) ? randomBelow(5) * 1e-3 : randomBelow(25) * 1e-3);
    }
    settle();
    if (failure[0] && slept) {
        testDiag("the machine slept, else: %s", failure);
        excused++;
        failure[0] = 0;
        settle();
    }
    return failure[0] == 0;
}

static void option(const char *key, const char *value)
{
    char error[300];

    if (plcStationSetOption(station, key, value, error, sizeof(error)))
        testAbort("%s", error);
}

static void iocStarts(void)
{
    char address[40], error[200], interval[12];

    iocBegin();
    station = makeStation("P", 1, IN, OUT);
    option("track", "on");
    option("scan", randomBelow(2) ? "changed" : "all");
    sprintf(interval, "%u", 1 + randomBelow(40));
    option("sendInterval", interval);
    place2 = 2;
    makeRecord("longout", "f0", "OUT=@P/0 T=INT32 R=16");
    makeRecord("longout", "f1", "OUT=@P/4 T=INT32 R=20");
    makeRecord("longout", "f2", "OUT=@P/8 T=INT32 R=24");
    makeRecord("longout", "p3", "OUT=@P/12 T=INT32");
    makeRecord("longout", "p4", "OUT=@P/16 T=INT32");
    makeRecord("longin", "counter", "INP=@P/0 T=INT32|SCAN=I/O Intr");
    makeRecord("longin", "slow", "INP=@P/4 T=INT32|SCAN=I/O Intr");
    iocRunOk();
    sprintf(address, "127.0.0.1:%d", plc.port);
    plcStationMove(station, address, error, sizeof(error));
    memset(word, 0, sizeof(word));
    memset(wasVoid, 0, sizeof(wasVoid));
    word[0].others = word[1].others = word[2].others = 1;
    word[0].got = word[1].got = word[2].got = 1;
    putValue(3, ++number);
    putValue(4, ++number);
    settle();
}

static void iocEnds(void)
{
    iocEnd();
    toolClose(plc.fd);
    plc.fd = -1;
}

/* True when this was the last episode. */
static int isOver(unsigned long done, unsigned long wanted, double seconds, double begin)
{
    return seconds > 0 ? clockNow() - begin >= seconds : done >= wanted;
}

MAIN(blockStressTest)
{
    const char *wanted = argc > 1 ? argv[1] : getenv("PLCLINK_EPISODES");
    unsigned long episodes = wanted ? strtoul(wanted, NULL, 0) : 30, i = 0;
    double seconds = wanted && strchr(wanted, 's') ? (double)episodes : 0, begin = clockNow();
    unsigned long long seed = argc > 2 ? strtoull(argv[2], NULL, 0) : epicsMonotonicGet();

    testPlan(0);
    state = seed;
    testDiag("%s episodes, seed %llu", wanted ? wanted : "30", seed);
    plc.fd = -1;
    plc.period = 0.002;
    plc.listener = toolListen(&plc.port);
    while (!failure[0] && !isOver(i, episodes, seconds, begin)) {
        if (i % LIFE == 0)
            iocStarts();
        if (!failure[0] && episode())
            i++;
        if (i % LIFE == 0 || failure[0] || isOver(i, episodes, seconds, begin))
            iocEnds();
    }
    testOk(!failure[0], "%lu episodes: nothing lost, nothing doubled, nothing wrong%s%s", i,
           failure[0] ? "; then: " : "", failure);
    testDiag("%u puts, %u of them of the value before; HMI %u; breaks %u; links %u; pauses %u; "
             "not written %u; %.0f s",
             putCount, backCount, hmiCount, breaks, links, pauses, voids, clockNow() - begin);
    testOk(excused * 10 <= i + 10, "the machine slept in few of them (%u)", excused);
    toolClose(plc.listener);
    return testDone();
}
