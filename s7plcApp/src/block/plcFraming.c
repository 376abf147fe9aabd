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
/* Equal bursts of a multiple or a fraction of the block size that raise a suspicion. */
#define SUSPICION 20
/* Blocks after which data is taken when there was too little quiet to judge. */
#define PATIENCE 3

struct plcFraming {
    size_t blockSize;
    size_t capacity; /* a multiple of blockSize */
    size_t fill;     /* bytes in the buffer */
    plcFramingVerdict verdict;
    size_t suspect;  /* burst size, when it is not blockSize */
    /* the burst that is coming in */
    epicsUInt64 last; /* time of its newest bytes, 0: none yet */
    size_t burst;     /* its bytes so far */
    /* the bursts before it */
    size_t equalSize;
    unsigned equal;     /* bursts of equalSize in a row */
    unsigned bursts;    /* since the last end of a burst at the end of a block */
    size_t unaligned;   /* bytes since then */
    char *buffer;
};

plcFraming *plcFramingCreate(size_t blockSize)
{
    plcFraming *f = callocMustSucceed(1, sizeof(*f), "plcFramingCreate");
    size_t unit = blockSize ? blockSize : 4096;

    f->blockSize = blockSize;
    f->capacity = unit < 32768 ? 65536 / unit * unit : 2 * unit;
    f->buffer = mallocMustSucceed(f->capacity, "plcFramingCreate");
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
    f->fill = f->suspect = f->burst = f->equalSize = f->unaligned = 0;
    f->equal = f->bursts = 0;
    f->last = 0;
    f->verdict = plcFramingOpen;
}

PLC_HOT void *plcFramingSpace(plcFraming *f, size_t *room)
{
    *room = f->capacity - f->fill;
    return f->buffer + f->fill;
}

/* A burst is over: what does its size say? */
static void closeBurst(plcFraming *f, int aligned)
{
    size_t size = f->burst;
    int odd = f->blockSize % size && size % f->blockSize;

    f->equal = size == f->equalSize ? f->equal + 1 : 1;
    f->equalSize = size;
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
        f->equal * size >= 2 * f->blockSize) {
        f->suspect = size;
        f->verdict = plcFramingWrong;
    } else if (f->bursts >= PROOF_NEVER &&
               f->unaligned >= PROOF_NEVER * f->blockSize) {
        f->suspect = 0;
        f->verdict = plcFramingWrong;
    }
}

PLC_HOT void plcFramingAdd(plcFraming *f, size_t count, epicsUInt64 now)
{
    int whole;

    if (!f->blockSize || !count)
        return;
    if (f->burst && now - f->last >= QUIET_NS) {
        closeBurst(f, f->fill % f->blockSize == 0);
        f->burst = 0;
    }
    f->last = now;
    f->burst += count;
    f->unaligned += count;
    f->fill += count;
    /* A block's end counts when the burst began with a block, or is of the first block. */
    whole = f->fill % f->blockSize == 0 &&
            (f->burst % f->blockSize == 0 || f->unaligned <= f->blockSize);
    if (f->verdict == plcFramingOpen &&
        (whole ||
         (f->bursts > PATIENCE && f->equal <= PATIENCE &&
          f->unaligned >= PATIENCE * f->blockSize) ||
         (f->bursts == 0 && f->unaligned >= 8 * PATIENCE * f->blockSize)))
        f->verdict = plcFramingTrusted;
}

PLC_HOT size_t plcFramingCount(const plcFraming *f)
{
    return f->blockSize ? f->fill / f->blockSize : 0;
}

PLC_HOT const void *plcFramingNewest(const plcFraming *f)
{
    size_t whole = plcFramingCount(f);

    return whole ? f->buffer + (whole - 1) * f->blockSize : NULL;
}

PLC_HOT void plcFramingConsume(plcFraming *f)
{
    size_t rest = f->blockSize ? f->fill % f->blockSize : 0;

    if (rest != f->fill)
        memmove(f->buffer, f->buffer + f->fill - rest, rest);
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
