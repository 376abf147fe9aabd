/* Block framing and block size diagnosis; see plcFraming.h. */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>

#include "plcFraming.h"
#include "plcHot.h"

/* Bytes that come after this much quiet begin a new burst. */
#define QUIET_NS 2000000u
/* Equal bursts in a row, over at least two blocks, that prove a wrong size: a PLC that
 * sends its blocks in pieces has a piece of another size at the end of each. */
#define PROOF 3
/* The same for bursts under half a block, which are more likely pieces of a block. */
#define PROOF_SMALL 32
/* Blocks and bursts without one common end that prove that there is no block size. */
#define PROOF_NEVER 64
/* Bursts of the block size that begin within a block, in a row, that prove that the stream is
 * out of step. */
#define PROOF_STEP 3
/* Equal bursts of a multiple or a fraction of the block size that raise a suspicion. */
#define SUSPICION 20
/* Blocks after which data is taken when there was too little quiet to judge. */
#define UNJUDGED 3

/* So many blocks in a row that end where all ends that has come: from then on they must. The
 * one that makes the stream trusted is enough, when it is by its end. */
#define KNOWN 3
/* Times between blocks, and pauses in blocks, that are remembered; and how many it takes to
 * tell one from the other. */
#define MEMORY 8
#define LEARNED 5
/* Good blocks in a row that end a doubt. */
#define CLEAN 2
/* Runs of any size, in a doubt, that prove that there is no block size. */
#define RUNS_MAX 16
/* The longest doubt, looked at when bytes come. */
#define DOUBT_NS 55000000000u
/* A burst of so many blocks and so long comes without any quiet: it cannot be judged. */
#define FLOOD 8
#define FLOOD_NS 50000000u

struct plcFraming {
    size_t blockSize;
    size_t capacity; /* a multiple of blockSize */
    size_t fill;     /* bytes in the buffer */
    plcFramingVerdict verdict;
    size_t suspect;  /* burst size, when it is not blockSize */
    int hold;        /* whole blocks in the buffer are not to be shown (yet) */
    size_t held;     /* blocks that were dropped for that since one was shown */
    unsigned known;  /* so many blocks in a row ended where all ended that had come */
    epicsUInt64 began; /* when the first bytes came */
    /* the burst that is coming in */
    epicsUInt64 last; /* time of its newest bytes, 0: none yet */
    epicsUInt64 burstBegan;
    size_t burst;     /* its bytes so far */
    /* the bursts before it */
    size_t equalSize;
    unsigned equal;     /* bursts of equalSize in a row */
    unsigned step;      /* bursts of blockSize in a row that began within a block */
    unsigned bursts;    /* since the last end of a burst at the end of a block */
    size_t unaligned;   /* bytes since then */
    /* the rhythm, and the run that is coming in: all bursts since the last long quiet */
    epicsUInt64 quiet[MEMORY]; /* before a block */
    epicsUInt64 pause[MEMORY]; /* the longest in a block */
    unsigned learned;          /* how often one was remembered */
    epicsUInt64 limit;         /* so much quiet is that before a block; 0: unknown */
    epicsUInt64 longest;       /* the longest pause in the block that is coming in */
    size_t run;
    int runAligned;            /* it began with a block */
    /* in doubt */
    epicsUInt64 since;   /* that, or since blocks are held back */
    unsigned clean;      /* good blocks in a row */
    unsigned runs;       /* since */
    size_t runSize;      /* of the run before */
    unsigned runEqual;   /* of that size in a row */
    unsigned doubts;
    char *buffer;
};

plcFraming *plcFramingCreate(size_t blockSize)
{
    plcFraming *f = callocMustSucceed(1, sizeof(*f), "plcFramingCreate");
    size_t unit = blockSize ? blockSize : 4096;

    f->blockSize = blockSize;
    f->capacity = unit < 32768 ? 65536 / unit * unit : 2 * unit;
    f->buffer = mallocMustSucceed(f->capacity, "plcFramingCreate");
    f->runAligned = 1;
    return f;
}

void plcFramingDestroy(plcFraming *f)
{
    if (!f)
        return;
    free(f->buffer);
    free(f);
}

void plcFramingReset(plcFraming *f)
{
    plcFraming fresh = {.blockSize = f->blockSize,
                        .capacity = f->capacity,
                        .runAligned = 1,
                        .buffer = f->buffer};

    *f = fresh;
}

PLC_HOT void *plcFramingSpace(plcFraming *f, size_t *room)
{
    *room = f->capacity - f->fill;
    return f->buffer + f->fill;
}

/* --- The end of a burst: what its size says at any time -------------------------------- */

static void wrong(plcFraming *f, size_t size)
{
    f->suspect = size;
    f->verdict = plcFramingWrong;
}

static void closeBurst(plcFraming *f, int aligned)
{
    size_t size = f->burst;
    int odd = f->blockSize % size && size % f->blockSize;

    f->equal = size == f->equalSize ? f->equal + 1 : 1;
    f->equalSize = size;
    f->step = size == f->blockSize && !aligned ? f->step + 1 : 0;
    f->bursts++;
    if (aligned) {
        f->bursts = 0;
        f->unaligned = 0;
    }
    if (size == f->blockSize)
        f->suspect = 0;
    else if (!odd && f->equal >= SUSPICION)
        f->suspect = size;

    if (odd && f->equal >= (2 * size >= f->blockSize ? PROOF : PROOF_SMALL) &&
        f->equal * size >= 2 * f->blockSize)
        wrong(f, size);
    else if (f->step >= PROOF_STEP)
        wrong(f, f->blockSize);
    else if (f->bursts >= PROOF_NEVER && f->unaligned >= PROOF_NEVER * f->blockSize)
        wrong(f, 0);
}

/* --- Rhythm: the quiet before a block, and pauses in it ---------------------------------- */

/* The second smallest (or, with `largest`, the second largest): one odd time counts not. */
static epicsUInt64 second(const epicsUInt64 *times, unsigned count, int largest)
{
    epicsUInt64 flip = largest ? ~(epicsUInt64)0 : 0;
    epicsUInt64 first = ~(epicsUInt64)0, next = first;
    unsigned i;

    for (i = 0; i < count; i++) {
        epicsUInt64 t = times[i] ^ flip;

        if (t < first) {
            next = first;
            first = t;
        } else if (t < next) {
            next = t;
        }
    }
    return next ^ flip;
}

/* A block was good, and after so much quiet the next one begins. */
PLC_HOT static void learn(plcFraming *f, epicsUInt64 quiet)
{
    unsigned count, place = f->learned++ % MEMORY;
    epicsUInt64 low, high, middle;

    f->quiet[place] = quiet;
    f->pause[place] = f->longest;
    count = f->learned < MEMORY ? f->learned : MEMORY;
    if (count < LEARNED)
        return;
    low = second(f->quiet, count, 0);
    high = second(f->pause, count, 1);
    middle = (low + high) / 2;
    f->limit = low / 5 * 3;
    if (middle > f->limit)
        f->limit = middle;
    if (high > low / 5 * 4)
        f->limit = 0; /* one looks like the other */
}

/* --- Doubt ------------------------------------------------------------------------------- */

PLC_COLD static void doubt(plcFraming *f, epicsUInt64 now)
{
    f->clean = 0;
    if (f->verdict != plcFramingTrusted)
        return;
    f->verdict = plcFramingDoubt;
    f->since = now;
    f->runs = f->runEqual = 0;
    f->doubts++;
}

/* In a doubt a run of this size is over. */
PLC_COLD static void judgeRun(plcFraming *f, size_t size, int aligned)
{
    int step = size % f->blockSize == 0;

    f->runs++;
    f->runEqual = size == f->runSize ? f->runEqual + 1 : 1;
    f->runSize = size;
    if (f->runEqual >= PROOF_STEP && step && !aligned)
        wrong(f, f->blockSize);
    else if (!step && f->runEqual >= PROOF &&
             (f->runEqual >= PROOF_SMALL || f->runEqual * size >= 2 * f->blockSize))
        wrong(f, size);
    else if (f->runs >= RUNS_MAX)
        wrong(f, f->runEqual > RUNS_MAX / 2 ? size : 0);
}

/* What the bursts since then look like: of the size of a block, of another one, or of none. */
PLC_COLD static size_t guess(const plcFraming *f)
{
    if (f->step || f->burst == f->blockSize || f->runSize == f->blockSize)
        return f->blockSize;
    if (f->runEqual + (f->run == f->runSize) > 1)
        return f->runSize;
    return f->equal + (f->burst == f->equalSize) > 1 ? f->equalSize : 0;
}

PLC_COLD void plcFramingGiveUp(plcFraming *f)
{
    int doubted = f->verdict == plcFramingDoubt;

    if (doubted || (f->verdict == plcFramingTrusted && f->held))
        wrong(f, guess(f));
}

/* --- Bytes come ---------------------------------------------------------------------------*/

/* After so much quiet, at this place in a block, something new begins. */
PLC_HOT static void newBurst(plcFraming *f, epicsUInt64 quiet, size_t place,
                             epicsUInt64 now)
{
    int newRun = f->limit ? quiet >= f->limit : !place;
    size_t run = f->run;
    int aligned = f->runAligned;

    closeBurst(f, !place);
    if (place && quiet > f->longest)
        f->longest = quiet;
    if (!place && f->verdict == plcFramingTrusted && !f->hold)
        learn(f, quiet);
    if (!place)
        f->longest = 0;
    if (newRun) {
        f->run = 0;
        f->runAligned = !place;
    } else if (!f->limit && place && f->burst > place) {
        f->runAligned = 0; /* it went on beyond the end of a block */
    }
    f->burst = 0;
    f->burstBegan = now;
    if (!newRun || !f->limit)
        return;
    if (place && f->known >= KNOWN)
        doubt(f, now);
    if (f->verdict == plcFramingDoubt)
        judgeRun(f, run, aligned);
}

/* Is the stream to be trusted from now on? Where bursts are of the size of a block and begin within
 * one, it is out of step, or will be found so: a PLC whose size has just been corrected. */
static void trust(plcFraming *f)
{
    /* A block's end counts when the burst began with a block, or is of the first block. */
    int whole = f->fill % f->blockSize == 0 &&
                (f->burst % f->blockSize == 0 || f->unaligned <= f->blockSize);
    int longEnough = (f->bursts > UNJUDGED && f->equal <= UNJUDGED && !f->step &&
                      f->unaligned >= UNJUDGED * f->blockSize) ||
                     (f->bursts == 0 && f->unaligned >= 8 * UNJUDGED * f->blockSize);

    if (whole || longEnough)
        f->verdict = plcFramingTrusted;
    if (whole)
        f->known = KNOWN;
}

/* What comes never pauses: no rhythm is known any more. */
static int floods(plcFraming *f, epicsUInt64 now)
{
    if (f->burst < FLOOD * f->blockSize || now - f->burstBegan < FLOOD_NS)
        return 0;
    f->known = 0;
    f->learned = 0;
    f->limit = 0;
    return 1;
}

/* True when blocks in the buffer may be shown, as to their ends. */
PLC_HOT static int shows(plcFraming *f, epicsUInt64 now)
{
    int ends = f->fill % f->blockSize == 0;

    if (f->verdict == plcFramingDoubt) {
        if (!ends || !f->runAligned || ++f->clean < CLEAN)
            return 0;
        f->verdict = plcFramingTrusted;
        return 1;
    }
    if (f->verdict != plcFramingTrusted)
        return 1;
    if (f->known >= KNOWN)
        return (ends && f->runAligned) || floods(f, now);
    if (ends)
        f->known++;
    else if (f->fill >= f->blockSize)
        f->known = 0;
    return 1;
}

PLC_HOT void plcFramingAdd(plcFraming *f, size_t count, epicsUInt64 now)
{
    if (!f->blockSize || !count)
        return;
    if (!f->burst)
        f->began = f->burstBegan = now;
    else if (now - f->last >= QUIET_NS)
        newBurst(f, now - f->last, f->fill % f->blockSize, now);
    f->last = now;
    f->burst += count;
    f->unaligned += count;
    f->fill += count;
    f->run += count;
    if (f->verdict == plcFramingOpen)
        trust(f);
    if (f->verdict == plcFramingOpen && now - f->began >= DOUBT_NS &&
        f->unaligned >= 2 * f->blockSize)
        wrong(f, 0);
    f->hold = !shows(f, now);
    if (f->verdict == plcFramingTrusted && !f->held)
        f->since = now;
    else if (now - f->since >= DOUBT_NS)
        plcFramingGiveUp(f);
}

PLC_HOT size_t plcFramingCount(const plcFraming *f)
{
    size_t whole = f->blockSize ? f->fill / f->blockSize : 0;

    return whole && !f->hold ? whole + f->held : 0;
}

PLC_HOT const void *plcFramingNewest(const plcFraming *f)
{
    if (!plcFramingCount(f))
        return NULL;
    return f->buffer + (f->fill / f->blockSize - 1) * f->blockSize;
}

PLC_HOT void plcFramingConsume(plcFraming *f)
{
    size_t whole = f->blockSize ? f->fill / f->blockSize : 0;
    size_t rest = f->blockSize ? f->fill % f->blockSize : 0;

    if (whole) {
        memmove(f->buffer, f->buffer + f->fill - rest, rest);
        f->held = f->hold ? f->held + whole : 0;
    }
    f->fill = rest;
}

PLC_HOT plcFramingVerdict plcFramingJudge(const plcFraming *f)
{
    return f->verdict;
}

PLC_HOT size_t plcFramingBurst(const plcFraming *f)
{
    return f->suspect;
}

unsigned plcFramingDoubts(const plcFraming *f)
{
    return f->doubts;
}
