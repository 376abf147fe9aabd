/* Block framing and the diagnosis of a wrong block size: bytes and times in, blocks and a
 * verdict out. Time is made up here, so nothing depends on how fast the machine is. */
#include <stdlib.h>
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "framingTest.h"
#include "plcFraming.h"

#define MS 1000000ull

/* A sender with its clock, and what the receiver made of it. */
typedef struct stream {
    plcFraming *framing;
    size_t blockSize;
    epicsUInt64 now;
    size_t sent;     /* bytes since the connection was made */
    size_t used;     /* blocks that a station would have used */
    size_t wrong;    /* of them: not what the sender meant as a block */
    size_t senderBlock;
} stream;

static void streamOpen(stream *s, size_t blockSize, size_t senderBlock)
{
    memset(s, 0, sizeof(*s));
    s->framing = plcFramingCreate(blockSize);
    s->blockSize = blockSize;
    s->senderBlock = senderBlock;
    s->now = 5000000 * MS;
}

/* Byte i of each of the sender's blocks is i modulo 251. */
static void look(stream *s)
{
    const unsigned char *newest = plcFramingNewest(s->framing);
    size_t i;

    if (newest && plcFramingJudge(s->framing) == plcFramingTrusted) {
        s->used += plcFramingCount(s->framing);
        for (i = 0; i < s->blockSize && newest[i] == (unsigned char)(i % 251); i++)
            ;
        s->wrong += i < s->blockSize;
    }
    plcFramingConsume(s->framing);
}

/* `size` bytes that arrive `gap` ns after those before. */
static void arrive(stream *s, size_t size, epicsUInt64 gap)
{
    s->now += gap;
    while (size) {
        size_t room, i;
        unsigned char *space = plcFramingSpace(s->framing, &room);

        if (room > size)
            room = size;
        for (i = 0; i < room; i++)
            space[i] = (unsigned char)((s->sent + i) % s->senderBlock % 251);
        s->sent += room;
        plcFramingAdd(s->framing, room, s->now);
        look(s);
        size -= room;
    }
}

static const char *const verdicts[] = {"open", "trusted", "doubt", "wrong"};

static const struct {
    const char *sentence;
    size_t blockSize; /* configured */
    size_t sends;     /* bytes of a block of the sender */
    size_t piece;     /* each sender block comes in pieces of this size, 0 = whole */
    epicsUInt64 quiet;    /* ms before each piece */
    int blocks;
    plcFramingVerdict verdict;
    size_t burst;
    size_t minUsed;
} rows[] = {
    {"64 bytes each 100 ms where 64 are configured: all blocks are used", 64, 64, 0, 100, 50,
     plcFramingTrusted, 0, 50},
    {"a first block alone is used at once", 64, 64, 0, 100, 1, plcFramingTrusted, 0, 1},
    {"60 where 64 are configured: wrong, both sizes known", 64, 60, 0, 100, 20,
     plcFramingWrong, 60, 0},
    {"100 where 64 are configured: wrong", 64, 100, 0, 100, 20, plcFramingWrong, 100, 0},
    {"96 where 64 are configured, equal ends now and then: wrong", 64, 96, 0, 100, 20,
     plcFramingWrong, 96, 0},
    {"40 where 64 are configured: three of them, a fourth has come, are not two blocks yet", 64, 40, 0, 100, 4,
     plcFramingOpen, 0, 0},
    {"four of 40 are more than two blocks: wrong", 64, 40, 0, 100, 5, plcFramingWrong, 40, 0},
    {"48 where 64 are configured: wrong", 64, 48, 0, 100, 20, plcFramingWrong, 48, 0},
    {"63 where 64 are configured: wrong", 64, 63, 0, 100, 20, plcFramingWrong, 63, 0},
    {"65 where 64 are configured: wrong", 64, 65, 0, 100, 20, plcFramingWrong, 65, 0},
    {"10 where 64 are configured: wrong, after more proof", 64, 10, 0, 100, 100,
     plcFramingWrong, 10, 0},
    {"3 ms between blocks are enough to tell", 64, 60, 0, 3, 20, plcFramingWrong, 60, 0},
    {"pieces of 10 with quiet between them are the pieces of one block", 64, 64, 10, 5, 100,
     plcFramingTrusted, 0, 100},
    {"pieces of 40 with quiet between them are the pieces of one block", 64, 64, 40, 5, 100,
     plcFramingTrusted, 0, 100},
    {"single bytes, one per second: a suspicion, but used", 64, 64, 1, 1000, 5, plcFramingTrusted, 1, 5},
    {"twice the size is a suspicion, not a verdict", 64, 128, 0, 100, 30, plcFramingTrusted,
     128, 30},
    {"half the size is a suspicion, not a verdict", 64, 32, 0, 100, 60, plcFramingTrusted, 32,
     20},
    {"no quiet at all: taken as it comes", 64, 64, 0, 0, 2000, plcFramingTrusted, 0, 1000},
    {"no quiet, and no end of a block for 20 blocks: not yet", 64, 65, 0, 0, 20, plcFramingOpen, 0, 0},
    {"for 24 blocks: taken as it comes", 64, 65, 0, 0, 26, plcFramingTrusted, 0, 1},
    {"blocks of one byte", 1, 1, 0, 10, 100, plcFramingTrusted, 0, 100},
    {"two bytes where one is configured: a suspicion", 1, 2, 0, 10, 100, plcFramingTrusted, 2,
     100},
    {"blocks of 64 KiB in one piece", 65536, 65536, 0, 50, 10, plcFramingTrusted, 0, 10},
    {"blocks of 64 KiB in segments of 1460", 65536, 65536, 1460, 0, 100, plcFramingTrusted, 0,
     10},
    {"65535 bytes where 65536 are configured: wrong", 65536, 65535, 0, 50, 10,
     plcFramingWrong, 65535, 0},
    {"blocks of 1 MiB", 1 << 20, 1 << 20, 8192, 0, 40, plcFramingTrusted, 0, 10},
};

static void testRow(size_t row)
{
    stream s;
    int block;

    streamOpen(&s, rows[row].blockSize, rows[row].sends);
    for (block = 0; block < rows[row].blocks; block++) {
        size_t left = rows[row].sends, piece = rows[row].piece ? rows[row].piece : left;

        if (plcFramingJudge(s.framing) == plcFramingWrong)
            break;
        for (; left; left -= piece) {
            if (piece > left)
                piece = left;
            arrive(&s, piece, rows[row].quiet * MS);
        }
    }
    testOk(plcFramingJudge(s.framing) == rows[row].verdict &&
               plcFramingBurst(s.framing) == rows[row].burst &&
               s.used >= rows[row].minUsed &&
               (rows[row].verdict != plcFramingWrong || s.used == 0) &&
               (rows[row].blockSize != rows[row].sends || s.wrong == 0),
           "%s", rows[row].sentence);
    testDiag("%s after %d blocks, bursts of %lu, %lu blocks used, %lu of them wrong",
             verdicts[plcFramingJudge(s.framing)], block,
             (unsigned long)plcFramingBurst(s.framing), (unsigned long)s.used,
             (unsigned long)s.wrong);
    plcFramingDestroy(s.framing);
}

/* Pseudo random numbers that are the same on each run. */
static unsigned next(unsigned *seed)
{
    *seed = *seed * 1664525u + 1013904223u;
    return *seed >> 8;
}

static void testRandomPieces(void)
{
    unsigned seed = 4711;
    int good = 0, run;

    for (run = 0; run < 50; run++) {
        size_t size = 2 + next(&seed) % 2000;
        int block;
        stream s;

        streamOpen(&s, size, size);
        for (block = 0; block < 200; block++) {
            size_t left, piece;

            for (left = size; left; left -= piece) {
                piece = 1 + next(&seed) % left;
                arrive(&s, piece, next(&seed) % 5 * MS);
            }
        }
        good += plcFramingJudge(s.framing) == plcFramingTrusted && s.wrong == 0 &&
                s.used >= 190;
        plcFramingDestroy(s.framing);
    }
    testOk(good == 50, "blocks in random pieces are never taken for a wrong size (%d of 50)",
           good);
}

static void testNoSize(void)
{
    unsigned seed = 815;
    stream s;
    int i;

    streamOpen(&s, 64, 1);
    for (i = 0; i < 2000 && plcFramingJudge(s.framing) != plcFramingWrong; i++)
        arrive(&s, 65 + next(&seed) % 60, 10 * MS);
    testOk(plcFramingJudge(s.framing) == plcFramingWrong && plcFramingBurst(s.framing) == 0,
           "pieces of random size that fit nothing: wrong, and no size is claimed (%d)", i);
    plcFramingDestroy(s.framing);
}

static void testLateChange(void)
{
    stream s;
    int i;

    streamOpen(&s, 64, 64);
    for (i = 0; i < 1000; i++)
        arrive(&s, 64, 10 * MS);
    testOk(plcFramingJudge(s.framing) == plcFramingTrusted, "right for long");
    s.senderBlock = 60;
    for (i = 0; i < 10; i++)
        arrive(&s, 60, 10 * MS);
    testOk(plcFramingJudge(s.framing) == plcFramingWrong && plcFramingBurst(s.framing) == 60,
           "then the PLC program changes to 60 bytes: found out");
    plcFramingReset(s.framing);
    testOk(plcFramingJudge(s.framing) == plcFramingOpen && !plcFramingBurst(s.framing) &&
               !plcFramingCount(s.framing),
           "a new connection forgets all of it");
    s.sent = 0;
    s.senderBlock = 64;
    s.used = 0;
    arrive(&s, 64, 10 * MS);
    testOk(s.used == 1, "and takes its first block");
    plcFramingDestroy(s.framing);
}

/* Some blocks of another size, then of the right one, on a new connection. */
static void testCorrected(void)
{
    size_t old, others, i;
    unsigned right = 0, count = 0;

    for (old = 40; old < 64; old++) {
        for (others = 1; others < 3; others++, count++) {
            stream s;

            streamOpen(&s, 64, 64);
            for (i = 0; i < others; i++)
                arrive(&s, old, 100 * MS);
            for (i = 0; i < 10 && plcFramingJudge(s.framing) == plcFramingOpen; i++)
                arrive(&s, 64, 100 * MS);
            right += s.used == 0 && plcFramingJudge(s.framing) == plcFramingWrong &&
                     plcFramingBurst(s.framing) == 64;
            plcFramingDestroy(s.framing);
        }
    }
    testOk(right == count, "one or two blocks of another size, then of the right one: out of step, "
           "and nothing is shown (%u of %u)", right, count);
}

static void testBacklog(void)
{
    unsigned char *space;
    size_t room, i;
    plcFraming *f = plcFramingCreate(100);

    space = plcFramingSpace(f, &room);
    testOk(room >= 1000, "room for a backlog");
    for (i = 0; i < 350; i++)
        space[i] = (unsigned char)(i / 100);
    plcFramingAdd(f, 350, MS);
    testOk(plcFramingCount(f) == 3 && *(const char *)plcFramingNewest(f) == 2,
           "of three and a half blocks the third is the newest whole one");
    plcFramingConsume(f);
    space = plcFramingSpace(f, &room);
    memset(space, 3, 50);
    plcFramingAdd(f, 50, MS);
    testOk(plcFramingCount(f) == 1 && *(const char *)plcFramingNewest(f) == 3,
           "the half block stays and is completed by what comes");
    plcFramingDestroy(f);
}

static void testNoInput(void)
{
    plcFraming *f = plcFramingCreate(0);
    size_t room;
    int i, ok = 1;

    for (i = 0; i < 1000; i++) {
        plcFramingSpace(f, &room);
        ok = ok && room > 0;
        plcFramingAdd(f, room, i * 10 * MS);
        ok = ok && plcFramingCount(f) == 0 && !plcFramingNewest(f) &&
             plcFramingJudge(f) == plcFramingOpen;
        plcFramingConsume(f);
    }
    testOk(ok, "inSize 0: what comes is dropped, there is always room");
    plcFramingDestroy(f);
    plcFramingDestroy(NULL);
}

/* 20 blocks of 64 bytes with a rhythm of 10 ms, then one byte of the next. */
static void rhythmEnds(stream *s)
{
    int i;

    streamOpen(s, 64, 64);
    for (i = 0; i < 20; i++)
        arrive(s, 64, 10 * MS);
    arrive(s, 1, 10 * MS);
}

/* A PLC whose blocks had a rhythm, and then come without any pause, in segments of any size. */
static void testFlood(void)
{
    unsigned seed = 99;
    size_t used;
    stream s;
    int i;

    rhythmEnds(&s);
    for (i = 0; i < 45; i++) /* an odd number of bytes is no block */
        arrive(&s, 2 + next(&seed) % 25 * 2, MS);
    used = s.used;
    testOk(used == 20, "no pause any more: whole blocks are held back until all ends (%d used)", (int)used);
    for (i = 0; i < 10; i++)
        arrive(&s, 2 + next(&seed) % 25 * 2, MS);
    testOk(s.used > used && s.wrong == 0, "after 50 ms they are shown, wherever all ends (%d)",
           (int)(s.used - used));
    for (i = 0; i < 200; i++)
        arrive(&s, 1 + next(&seed) % 50, MS);
    testOk(plcFramingJudge(s.framing) == plcFramingTrusted && s.wrong == 0 && s.used > used + 60,
           "and taken as they come (%d)", (int)(s.used - used));
    used = s.used;
    arrive(&s, (s.sent + 130) % 64 ? 130 : 131, 10 * MS);
    testOk(s.used > used && s.wrong == 0, "after a pause too: a rhythm is to be found anew");
    arrive(&s, 64 - s.sent % 64, MS);
    used = s.used;
    for (i = 0; i < 20; i++)
        arrive(&s, 64, 10 * MS);
    testOk(s.used == used + 20 && s.wrong == 0, "and with pauses again each");
    arrive(&s, 100, 10 * MS);
    testOk(s.used == used + 20 && plcFramingCount(s.framing) == 0,
           "then a block that does not end all is held back again");
    plcFramingDestroy(s.framing);
}

/* The times between the blocks before it count no more. */
static void testAfterFlood(void)
{
    size_t used;
    stream s;
    int i;

    rhythmEnds(&s);
    for (i = 0; i < 60; i++)
        arrive(&s, 20, MS);
    arrive(&s, 64 - s.sent % 64, MS);
    for (i = 0; i < 3; i++)
        arrive(&s, 64, 100 * MS);
    used = s.used;
    arrive(&s, 40, 100 * MS);
    arrive(&s, 24, 20 * MS);
    testOk(s.used == used + 1 && plcFramingDoubts(s.framing) == 0 && s.wrong == 0,
           "after a flood the rhythm is another: a pause of twice the old one is in a block");
    plcFramingDestroy(s.framing);
}

static void testNeverTold(void)
{
    stream s;
    int i;

    streamOpen(&s, 64, 1);
    for (i = 0; i < 14; i++)
        arrive(&s, 10 + (size_t)i * 3 % 5, 4000 * MS);
    testOk(plcFramingJudge(s.framing) == plcFramingOpen && s.used == 0,
           "few bytes now and then tell nothing, and nothing is shown");
    for (; i < 16; i++)
        arrive(&s, 10 + (size_t)i * 3 % 5, 4000 * MS);
    testOk(plcFramingJudge(s.framing) == plcFramingWrong && plcFramingBurst(s.framing) == 0,
           "for not a minute");
    plcFramingDestroy(s.framing);
}

/* What a doubt that must end now is told by. */
static void testGuess(void)
{
    stream s;
    int i;

    streamOpen(&s, 96, 96);
    for (i = 0; i < 20; i++)
        arrive(&s, 96, 1000 * MS);
    arrive(&s, 40, 1000 * MS);
    arrive(&s, 40, 1000 * MS);
    arrive(&s, 40, 5 * MS);
    testOk(plcFramingJudge(s.framing) == plcFramingDoubt, "40 bytes, and 80 in two bursts: doubt");
    plcFramingGiveUp(s.framing);
    testOk(plcFramingJudge(s.framing) == plcFramingWrong && plcFramingBurst(s.framing) == 40,
           "which is told by the bursts of 40");
    plcFramingReset(s.framing);
    s.sent = 0;
    for (i = 0; i < 20; i++)
        arrive(&s, 96, 1000 * MS);
    arrive(&s, 40, 1000 * MS);
    arrive(&s, 31, 1000 * MS);
    arrive(&s, 12, 5 * MS);
    plcFramingGiveUp(s.framing);
    testOk(plcFramingJudge(s.framing) == plcFramingWrong && plcFramingBurst(s.framing) == 0,
           "where no two are equal no size is told");
    plcFramingReset(s.framing);
    s.sent = 0;
    for (i = 0; i < 20; i++)
        arrive(&s, 96, 1000 * MS);
    for (i = 0; i < 16; i++)
        arrive(&s, 41 + (size_t)i * 7 % 50, 1000 * MS);
    testOk(plcFramingJudge(s.framing) == plcFramingDoubt, "portions of 15 sizes leave a doubt");
    for (; i < 18; i++)
        arrive(&s, 41 + (size_t)i * 7 % 50, 1000 * MS);
    testOk(plcFramingJudge(s.framing) == plcFramingWrong && plcFramingBurst(s.framing) == 0,
           "those of 16 end it: there is no block size");
    plcFramingReset(s.framing);
    s.sent = 0;
    for (i = 0; i < 20; i++)
        arrive(&s, 96, 1000 * MS);
    for (i = 0; i < 17; i++)
        arrive(&s, 10, 1000 * MS);
    testOk(plcFramingJudge(s.framing) == plcFramingWrong && plcFramingBurst(s.framing) == 10,
           "16 equal ones, not two blocks yet, end it as well: blocks are of their size");
    plcFramingDestroy(s.framing);
}

MAIN(framingTest)
{
    size_t i;

    testPlan((int)(sizeof(rows) / sizeof(rows[0])) + 13 + 13 + framingSlipTests());
    for (i = 0; i < sizeof(rows) / sizeof(rows[0]); i++)
        testRow(i);
    testRandomPieces();
    testNoSize();
    testLateChange();
    testCorrected();
    testBacklog();
    testNoInput();
    testFlood();
    testAfterFlood();
    testNeverTold();
    testGuess();
    framingSlips();
    return testDone();
}
