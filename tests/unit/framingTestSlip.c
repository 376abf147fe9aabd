/* Streams that slip on a running connection, played against the framing alone: a PLC that
 * has sent good blocks loses some bytes, or sends some too many, or changes the size of its
 * blocks. Every shift, several sizes, periods, pieces and seeds; time is made up.
 *
 * The framing skips no byte, so a block that it shows is known by its place in the stream.
 * It is right when the PLC sent just these bytes as one block.
 */
#include <string.h>

#include <epicsUnitTest.h>

#include "framingTest.h"
#include "plcFraming.h"

#define MS 1000000ull
#define MARKS 64

/* How a PLC sends. */
typedef struct manner {
    double period;  /* ms */
    int pieces;     /* of a block, at most */
    int scheduled;  /* 1: blocks begin each period, all pauses of one are under a third of
                       it; 0: each pause is, and a period of quiet follows the block */
    int together;   /* bytes of a piece arrive together */
} manner;

/* A PLC, and what the framing made of its bytes. */
typedef struct plc {
    plcFraming *framing;
    size_t inSize;
    manner how;
    unsigned long long seed;
    double now, begins;  /* ms; when this block began */
    size_t sent;         /* bytes, in the stream */
    size_t good[MARKS];  /* where the newest good blocks begin */
    unsigned blocks;     /* of them, all in all */
    unsigned shown;      /* times that a block was shown */
    unsigned wrong;      /* of them: not a good block */
    unsigned used;       /* blocks, those that were held back included */
    unsigned excuses;    /* an end of a piece was, by chance, where a block would have ended */
} plc;

static unsigned below(plc *p, unsigned n)
{
    p->seed = p->seed * 6364136223846793005ull + 1442695040888963407ull;
    return (unsigned)(p->seed >> 33) % n;
}

static double fraction(plc *p)
{
    return below(p, 1000000) * 1e-6;
}

static void look(plc *p)
{
    size_t begin = p->sent / p->inSize * p->inSize - p->inSize;
    unsigned i, right = 0;

    if (plcFramingJudge(p->framing) == plcFramingTrusted && plcFramingCount(p->framing)) {
        for (i = 0; i < MARKS && i < p->blocks; i++)
            right |= p->good[(p->blocks - 1 - i) % MARKS] == begin;
        p->used += plcFramingCount(p->framing);
        p->shown++;
        p->wrong += !right;
    }
    plcFramingConsume(p->framing);
}

static void arrive(plc *p, size_t count)
{
    while (count) {
        size_t room, part = p->how.together ? count : 1 + below(p, (unsigned)count);

        plcFramingSpace(p->framing, &room);
        if (part > room)
            part = room;
        p->sent += part;
        plcFramingAdd(p->framing, part, (epicsUInt64)(p->now * MS));
        look(p);
        p->now += p->how.together ? 0 : 0.02;
        count -= part;
    }
}

/* Sends `size` bytes in pieces, of which `good` of inSize are a block from `from` on. */
static void sendBytes(plc *p, size_t size, int good, size_t from)
{
    unsigned pieces = 1 + below(p, (unsigned)p->how.pieces), i;
    size_t start = p->sent, left = size;
    double third = p->how.period / 3 * 0.98;

    if (good)
        p->good[p->blocks++ % MARKS] = start + from;
    p->begins = p->now;
    for (i = 0; left; i++) {
        size_t piece = i + 1 < pieces ? 1 + below(p, (unsigned)left) : left;

        if (i)
            p->now += fraction(p) * third / (p->how.scheduled ? pieces : 1);
        arrive(p, piece);
        left -= piece;
        p->excuses += size > p->inSize && p->sent % p->inSize == 0 && left;
    }
    p->now = (p->how.scheduled ? p->begins : p->now) + p->how.period * (0.9 + fraction(p) / 5);
}

static void sendBlocks(plc *p, unsigned count)
{
    while (count--)
        sendBytes(p, p->inSize, 1, 0);
}

static void begin(plc *p, size_t inSize, const manner *how, unsigned long long seed)
{
    memset(p, 0, sizeof(*p));
    p->framing = plcFramingCreate(inSize);
    p->inSize = inSize;
    p->how = *how;
    p->seed = seed * 2862933555777941757ull + inSize;
    p->now = 1000;
    sendBlocks(p, 10 + below(p, 10));
}

/* --- What can happen ------------------------------------------------------------------ */

typedef enum { dropsFirst, dropsLast, addsBefore, addsBehind, changesSize, faults } fault;

static const char *const faultNames[faults] = {
    "bytes lost at the head of a block", "bytes lost at its end", "bytes too many before it",
    "bytes too many behind it",          "blocks of another size"};

/* The fault, then blocks until the framing has said what is wrong. Returns the blocks that
 * it took, at most 100. */
static unsigned slip(plc *p, fault what, size_t by)
{
    unsigned n;

    if (what == dropsFirst || what == dropsLast)
        sendBytes(p, p->inSize - by, 0, 0);
    else if (what != changesSize)
        sendBytes(p, p->inSize + by, 1, what == addsBefore ? by : 0);
    for (n = 0; n < 100 && plcFramingJudge(p->framing) != plcFramingWrong; n++)
        sendBytes(p, what == changesSize ? by : p->inSize, what != changesSize, 0);
    return n;
}

typedef struct tally {
    unsigned runs, wrong, excused, unsaid, untrue, slowest;
    size_t size, by; /* of the first that was wrong */
} tally;

static void play(tally *t, size_t inSize, const manner *how, fault what, size_t by,
                 unsigned long long seed)
{
    plc p;
    unsigned took;

    begin(&p, inSize, how, seed);
    p.wrong = p.excuses = 0;
    took = slip(&p, what, by);
    t->runs++;
    if (p.wrong > 1 || (p.wrong && how->together && !p.excuses)) {
        t->wrong++;
        t->size = inSize;
        t->by = by;
    }
    t->excused += p.wrong;
    t->unsaid += plcFramingJudge(p.framing) != plcFramingWrong;
    if (plcFramingJudge(p.framing) == plcFramingWrong)
        t->untrue += plcFramingBurst(p.framing) != (what == changesSize ? by : inSize);
    if (took > t->slowest)
        t->slowest = took;
    plcFramingDestroy(p.framing);
}

static const double periods[] = {10, 30, 100, 1000};
static const size_t sizes[] = {2, 3, 7, 16, 60, 96, 256};

/* All shifts, of all sizes; or, for changesSize, all other sizes up to twice as many bytes:
 * those that are no multiple, which is what a backlog looks like. */
static void testFault(fault what, const manner *base)
{
    tally t = {0, 0, 0, 0, 0, 0, 0, 0};
    manner how = *base;
    size_t i, j, by;

    for (i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++)
        for (j = 0; j < sizeof(periods) / sizeof(periods[0]); j++)
            for (by = 1; by < (what == changesSize ? 2 * sizes[i] : sizes[i]); by++) {
                how.period = periods[j];
                if (by != sizes[i] || what != changesSize)
                    play(&t, sizes[i], &how, what, by, 31 * by + j);
            }
    testOk(t.runs && !t.wrong, "%s, up to %d pieces%s%s: nothing wrong is shown",
           faultNames[what], how.pieces, how.scheduled ? " within a third of the period" : "",
           how.together ? "" : ", bytes one by one");
    if (t.wrong)
        testDiag("wrong: %u, for example inSize %u, %u bytes", t.wrong, (unsigned)t.size,
                 (unsigned)t.by);
    testOk(!t.unsaid, "and it is said what is wrong");
    testDiag("%u streams, %u blocks excused, at most %u blocks until it is said, %u times "
             "not the true size", t.runs, t.excused, t.slowest, t.untrue);
}

/* A stream that slips before its rhythm is known, when each block comes at once. */
static void testEarly(void)
{
    manner how = {100, 1, 1, 1};
    unsigned good, wrong = 0, unsaid = 0, runs = 0;
    size_t by;
    int what;

    for (good = 1; good < 10; good++)
        for (by = 1; by < 96; by++)
            for (what = dropsFirst; what < changesSize; what++) {
                plc p;

                begin(&p, 96, &how, by);
                plcFramingReset(p.framing);
                p.sent = 0;
                p.blocks = 0;
                sendBlocks(&p, good);
                slip(&p, (fault)what, by);
                runs++;
                wrong += p.wrong;
                unsaid += plcFramingBurst(p.framing) != 96;
                plcFramingDestroy(p.framing);
            }
    testOk(runs && !wrong && !unsaid,
           "a slip after 1 to 9 good blocks shows nothing wrong either (%u streams, %u wrong, "
           "%u not said)", runs, wrong, unsaid);
}

/* A PLC that begins to send in pieces, up to a whole period of them, loses no block. */
static void testBeginsPieces(void)
{
    unsigned lost = 0, doubts = 0, runs = 0, seed;
    manner one = {0, 1, 0, 1};
    size_t i, j;

    for (i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++)
        for (j = 0; j < sizeof(periods) / sizeof(periods[0]); j++)
            for (seed = 0; seed < 20; seed++) {
                plc p;

                one.period = periods[j];
                begin(&p, sizes[i], &one, seed);
                p.how.pieces = 2 + seed % 4;
                p.how.scheduled = seed % 2;
                sendBlocks(&p, 50);
                runs++;
                lost += p.blocks - p.shown + p.wrong;
                doubts += plcFramingDoubts(p.framing);
                plcFramingDestroy(p.framing);
            }
    testOk(runs && !lost && !doubts,
           "a PLC that begins to send in pieces loses no block (%u streams, %u blocks lost, "
           "%u doubts)", runs, lost, doubts);
}

/* A network that holds back the rest of a block for long: the PLC goes on. */
static void testStall(void)
{
    manner how = {100, 1, 1, 1};
    unsigned n, bad = 0;

    for (n = 1; n < 96; n++) {
        plc p;
        unsigned shown;

        begin(&p, 96, &how, n);
        p.good[p.blocks++ % MARKS] = p.sent;
        arrive(&p, n);
        p.now += 300;
        arrive(&p, 96 - n);
        p.now += 100;
        shown = p.shown;
        sendBlocks(&p, 2);
        bad += p.wrong || p.shown != shown + 1 || p.used != p.blocks ||
               plcFramingDoubts(p.framing) != 1;
        sendBlocks(&p, 20);
        bad += p.wrong || p.shown != shown + 21 || plcFramingDoubts(p.framing) != 1;
        plcFramingDestroy(p.framing);
    }
    testOk(!bad, "a long stall within a block: two good blocks end the doubt (%u not)", bad);
}

static void testGiveUp(void)
{
    manner how = {1000, 1, 1, 1};
    plc p;

    begin(&p, 96, &how, 1);
    plcFramingGiveUp(p.framing);
    testOk(plcFramingJudge(p.framing) == plcFramingTrusted, "without a doubt nothing ends");
    sendBytes(&p, 89, 0, 0);
    sendBytes(&p, 96, 1, 0);
    testOk(plcFramingJudge(p.framing) == plcFramingDoubt && plcFramingDoubts(p.framing) == 1,
           "7 bytes are missing: doubt");
    plcFramingGiveUp(p.framing);
    testOk(plcFramingJudge(p.framing) == plcFramingWrong && plcFramingBurst(p.framing) == 96,
           "if it must end now: out of step");
    plcFramingReset(p.framing);
    p.sent = 0;
    p.blocks = p.shown = 0;
    sendBlocks(&p, 12);
    testOk(p.shown == 12 && !p.wrong, "a new connection forgets it");
    sendBytes(&p, 60, 0, 0);
    sendBytes(&p, 60, 0, 0);
    plcFramingGiveUp(p.framing);
    testOk(plcFramingJudge(p.framing) == plcFramingWrong && plcFramingBurst(p.framing) == 60,
           "two bursts of 60: a matter of the size");
    plcFramingDestroy(p.framing);
}

/* A stream that never says what it is. */
static void testMinute(void)
{
    manner how = {3900, 1, 1, 1};
    double since;
    plc p;

    begin(&p, 96, &how, 1);
    sendBytes(&p, 95, 0, 0);
    since = p.now;
    while (plcFramingJudge(p.framing) != plcFramingWrong && p.now < since + 1e6)
        sendBytes(&p, 1 + below(&p, 95), 0, 0);
    testOk(p.now - since > 50000 && p.now - since < 60000 + 2 * 3900,
           "a doubt ends after a minute (%.1f s)", (p.now - since) / 1000);
    testOk(p.wrong == 0, "and nothing was shown meanwhile");
    plcFramingDestroy(p.framing);
}

int framingSlipTests(void)
{
    return 2 * faults * 4 + 3 + 5 + 2;
}

void framingSlips(void)
{
    static const manner manners[] = {
        {0, 1, 1, 1}, {0, 5, 1, 1}, {0, 5, 0, 1}, {0, 5, 1, 0}};
    int what;
    size_t i;

    for (i = 0; i < sizeof(manners) / sizeof(manners[0]); i++)
        for (what = 0; what < faults; what++)
            testFault((fault)what, &manners[i]);
    testEarly();
    testBeginsPieces();
    testStall();
    testGiveUp();
    testMinute();
}
