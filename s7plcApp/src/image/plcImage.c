/* An image: its life, and the bytes that come in, from the station's thread to the records.
 *
 * Knows nothing of sockets, records or types. What goes out is in plcImageOut.c.
 *
 * Two buffers. `blocks` counts what was published; its lowest bit tells which
 * buffer others see. The next block goes into the other one, then `blocks` moves on. A
 * reader takes no lock: what it copied is of one block when `blocks` has not moved
 * meanwhile, else it copies again, at last with the lock. Buffers are arrays of machine
 * words, read and written in atomic pieces with acquire and release, so that a copy that
 * comes too late is noticed on every machine.
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>

#include "plcHot.h"
#include "plcImagePvt.h"

#define TRIES 3 /* before a reader takes the lock: blocks come too fast for it */

static word *makeWords(size_t size)
{
    return callocMustSucceed(STAMP_WORDS + WORDS(size) + 1, WORD, "plcImageCreate");
}

plcImage *plcImageCreate(size_t size)
{
    plcImage *image = callocMustSucceed(1, sizeof(*image), "plcImageCreate");

    image->lock = epicsMutexMustCreate();
    image->size = size;
    image->words[0] = makeWords(size);
    image->words[1] = makeWords(size);
    strcpy(image->reason, "not connected yet");
    return image;
}

void plcImageDestroy(plcImage *image)
{
    if (!image)
        return;
    epicsMutexDestroy(image->lock);
    free(image->words[0]);
    free(image->words[1]);
    plcPutsDestroy(image->puts);
    plcPutsDestroy(image->edges);
    free(image->batch);
    free(image->ours);
    free(image);
}

size_t plcImageSize(const plcImage *image)
{
    return __atomic_load_n(&image->size, __ATOMIC_RELAXED);
}

void plcImageUse(plcImage *image, size_t size)
{
    epicsMutexMustLock(image->lock);
    __atomic_store_n(&image->size, size, __ATOMIC_RELAXED);
    if (image->puts)
        plcPutsUse(image->puts, size);
    epicsMutexUnlock(image->lock);
}

/* --- Input ------------------------------------------------------------------------- */

/* Later loads stay behind these, so that none sees an older `blocks` than they did. */
static word load(const word *from)
{
    return __atomic_load_n(from, __ATOMIC_ACQUIRE);
}

/* Copies `length` bytes at byte `offset` of words that may change meanwhile. */
static void copyOut(void *dst, const word *from, size_t offset, size_t length)
{
    char *to = dst;
    word piece[2];
    size_t first = offset % WORD, count;

    from += offset / WORD;
    if (first + length <= 2 * WORD && length) {
        piece[0] = load(from);
        if (first + length > WORD)
            piece[1] = load(from + 1);
        memcpy(to, (char *)piece + first, length);
        return;
    }
    for (; length; to += count, length -= count, first = 0) {
        count = length < WORD - first ? length : WORD - first;
        piece[0] = load(from++);
        memcpy(to, (char *)piece + first, count);
    }
}

/* None of these stores comes before an earlier store of `blocks`. */
static void copyIn(word *to, const void *src, size_t length)
{
    const char *from = src;
    word piece;

    for (; length >= WORD; length -= WORD, from += WORD) {
        memcpy(&piece, from, WORD);
        __atomic_store_n(to++, piece, __ATOMIC_RELEASE);
    }
    if (length) {
        piece = 0;
        memcpy(&piece, from, length);
        __atomic_store_n(to, piece, __ATOMIC_RELEASE);
    }
}

PLC_HOT int plcImageRead(plcImage *image, size_t offset, size_t length, void *dst,
                         epicsTimeStamp *stamp)
{
    const word *from;
    word block;
    int tries = 0;
    int moved;

    do {
        if (!__atomic_load_n(&image->valid, __ATOMIC_ACQUIRE))
            return -1;
        if (++tries > TRIES)
            epicsMutexMustLock(image->lock); /* now no block takes its place */
        block = load(&image->blocks);
        from = image->words[block & 1];
        copyOut(dst, from + STAMP_WORDS, offset, length);
        if (stamp)
            copyOut(stamp, from, 0, sizeof(*stamp));
        moved = __atomic_load_n(&image->blocks, __ATOMIC_RELAXED) != block;
        if (tries > TRIES)
            epicsMutexUnlock(image->lock);
    } while (moved);
    return 0;
}

void plcImageReason(plcImage *image, char reason[PLC_REASON_SIZE])
{
    epicsMutexMustLock(image->lock);
    memcpy(reason, image->reason, PLC_REASON_SIZE);
    epicsMutexUnlock(image->lock);
}

PLC_HOT void plcImagePublish(plcImage *image, const void *block,
                             const epicsTimeStamp *stamp)
{
    word next = image->blocks + 1; /* only this thread changes it */
    word *to = image->words[next & 1];

    copyIn(to, stamp, sizeof(*stamp));
    copyIn(to + STAMP_WORDS, block, image->size);
    epicsMutexMustLock(image->lock);
    __atomic_store_n(&image->blocks, next, __ATOMIC_RELEASE);
    __atomic_store_n(&image->valid, 1, __ATOMIC_RELEASE);
    image->reason[0] = 0;
    epicsMutexUnlock(image->lock);
}

PLC_HOT const void *plcImageBytes(const plcImage *image)
{
    return plcImageSeen(image);
}

void plcImageInvalidate(plcImage *image, const char *reason)
{
    epicsMutexMustLock(image->lock);
    __atomic_store_n(&image->valid, 0, __ATOMIC_RELEASE);
    epicsSnprintf(image->reason, sizeof(image->reason), "%s", reason);
    epicsMutexUnlock(image->lock);
}
