/* An image: the bytes of one block between record threads and the station's thread.
 *
 * Knows nothing of sockets, records or types.
 *
 * Input: two buffers. `blocks` counts what was published; its lowest bit tells which
 * buffer others see. The next block goes into the other one, then `blocks` moves on. A
 * reader takes no lock: what it copied is of one block when `blocks` has not moved
 * meanwhile, else it copies again, at last with the lock. Buffers are arrays of machine
 * words, read and written in atomic pieces with acquire and release, so that a copy that
 * comes too late is noticed on every machine.
 *
 * Output, reasons, and which buffer is seen: one mutex, held for a copy of at most the
 * block and for nothing else.
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsMutex.h>
#include <epicsStdio.h>

#include "plcHot.h"
#include "plcImage.h"

typedef size_t word;

#define WORD sizeof(word)
#define WORDS(size) (((size) + WORD - 1) / WORD)
#define STAMP_WORDS WORDS(sizeof(epicsTimeStamp))
#define TRIES 3 /* before a reader takes the lock: blocks come too fast for it */

struct plcImage {
    word *words[2]; /* atomic; the stamp of the block, then its bytes */
    word blocks;    /* atomic */
    int valid;      /* atomic */
    size_t size;
    int dirty;      /* atomic; changed while the lock is held */
    epicsMutexId lock; /* guards the rest */
    int closed;                   /* writes are refused */
    size_t takes;                 /* how often the output was taken */
    char reason[PLC_REASON_SIZE]; /* "" when valid */
    epicsUInt8 *changed; /* bits written since the last take; NULL: not tracked */
    epicsUInt8 *ours;    /* bits ever written, and not set since */
};

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
    free(image->changed);
    free(image->ours);
    free(image);
}

size_t plcImageSize(const plcImage *image)
{
    return image->size;
}

/* The bytes that others see. By the thread that publishes, or with the lock held. */
static epicsUInt8 *bytesOf(const plcImage *image)
{
    return (epicsUInt8 *)(image->words[image->blocks & 1] + STAMP_WORDS);
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
    return bytesOf(image);
}

void plcImageInvalidate(plcImage *image, const char *reason)
{
    epicsMutexMustLock(image->lock);
    __atomic_store_n(&image->valid, 0, __ATOMIC_RELEASE);
    epicsSnprintf(image->reason, sizeof(image->reason), "%s", reason);
    epicsMutexUnlock(image->lock);
}

/* --- Output ------------------------------------------------------------------------ */

/* The lock is held. */
static void setDirty(plcImage *image, int dirty)
{
    __atomic_store_n(&image->dirty, dirty, __ATOMIC_RELEASE);
}

/* Only the bits set in mask; NULL: all. */
static void put(epicsUInt8 *to, const epicsUInt8 *from, const epicsUInt8 *mask,
                size_t length)
{
    size_t i;

    if (!mask && length)
        memcpy(to, from, length);
    for (i = 0; mask && i < length; i++)
        to[i] = (epicsUInt8)((to[i] & ~mask[i]) | (from[i] & mask[i]));
}

/* True when put() would change something. */
static int differs(const epicsUInt8 *to, const epicsUInt8 *from, const epicsUInt8 *mask,
                   size_t length)
{
    size_t i;

    if (!mask)
        return memcmp(to, from, length) != 0;
    for (i = 0; i < length; i++)
        if ((to[i] ^ from[i]) & mask[i])
            return 1;
    return 0;
}

/* These bits were written. The lock is held. */
static void mark(plcImage *image, size_t offset, size_t length, const epicsUInt8 *mask)
{
    size_t i;
    epicsUInt8 bits;

    for (i = 0; i < length; i++) {
        bits = mask ? mask[i] : 0xFF;
        image->changed[offset + i] |= bits;
        image->ours[offset + i] |= bits;
    }
}

/* These bits are not ours any more. The lock is held. */
static void unmark(plcImage *image, size_t offset, size_t length, const epicsUInt8 *mask)
{
    size_t i;
    epicsUInt8 others;

    for (i = 0; i < length; i++) {
        others = mask ? (epicsUInt8)~mask[i] : 0;
        image->changed[offset + i] &= others;
        image->ours[offset + i] &= others;
    }
}

int plcImageWriteCounted(plcImage *image, size_t offset, size_t length, const void *src,
                         const void *mask, size_t *takes)
{
    int first;

    epicsMutexMustLock(image->lock);
    *takes = image->takes;
    if (image->closed) {
        epicsMutexUnlock(image->lock);
        return -1;
    }
    put(bytesOf(image) + offset, src, mask, length);
    if (image->changed)
        mark(image, offset, length, mask);
    first = !plcImageDirty(image);
    setDirty(image, 1);
    epicsMutexUnlock(image->lock);
    return first;
}

int plcImageWrite(plcImage *image, size_t offset, size_t length, const void *src,
                  const void *mask)
{
    size_t takes;

    return plcImageWriteCounted(image, offset, length, src, mask, &takes);
}

size_t plcImageTakes(plcImage *image)
{
    size_t takes;

    epicsMutexMustLock(image->lock);
    takes = image->takes;
    epicsMutexUnlock(image->lock);
    return takes;
}

void plcImageClose(plcImage *image, int closed)
{
    epicsMutexMustLock(image->lock);
    image->closed = closed;
    epicsMutexUnlock(image->lock);
}

int plcImageSet(plcImage *image, size_t offset, size_t length, const void *src,
                const void *mask, const void *expected)
{
    epicsUInt8 *to;
    int wanted, changed;

    epicsMutexMustLock(image->lock);
    to = bytesOf(image) + offset;
    wanted = !expected || memcmp(to, expected, length) == 0;
    changed = wanted && differs(to, src, mask, length);
    if (changed)
        put(to, src, mask, length);
    if (wanted && image->changed)
        unmark(image, offset, length, mask);
    epicsMutexUnlock(image->lock);
    return changed;
}

PLC_HOT int plcImageDirty(plcImage *image)
{
    return __atomic_load_n(&image->dirty, __ATOMIC_ACQUIRE);
}

void plcImageTouch(plcImage *image)
{
    epicsMutexMustLock(image->lock);
    setDirty(image, 1);
    epicsMutexUnlock(image->lock);
}

/* Nothing is left to send. The lock is held. */
static void forget(plcImage *image)
{
    setDirty(image, 0);
    if (image->changed)
        memset(image->changed, 0, image->size);
}

void plcImageTake(plcImage *image, void *dst)
{
    epicsMutexMustLock(image->lock);
    if (image->size)
        memcpy(dst, bytesOf(image), image->size);
    forget(image);
    image->takes++;
    epicsMutexUnlock(image->lock);
}

void plcImageForget(plcImage *image)
{
    epicsMutexMustLock(image->lock);
    forget(image);
    epicsMutexUnlock(image->lock);
}

void plcImagePeek(plcImage *image, size_t offset, size_t length, void *dst)
{
    epicsMutexMustLock(image->lock);
    if (length)
        memcpy(dst, bytesOf(image) + offset, length);
    epicsMutexUnlock(image->lock);
}

/* --- Output that leaves piece by piece --------------------------------------------- */

void plcImageTrackWrites(plcImage *image)
{
    epicsMutexMustLock(image->lock);
    if (!image->changed) {
        image->changed = callocMustSucceed(image->size + 1, 1, "plcImageTrackWrites");
        image->ours = callocMustSucceed(image->size + 1, 1, "plcImageTrackWrites");
    }
    epicsMutexUnlock(image->lock);
}

void plcImageTakeChanges(plcImage *image, void *dst, void *mask)
{
    epicsMutexMustLock(image->lock);
    if (image->size) {
        memcpy(dst, bytesOf(image), image->size);
        if (image->changed)
            memcpy(mask, image->changed, image->size);
        else
            memset(mask, 0, image->size);
    }
    forget(image);
    image->takes++;
    epicsMutexUnlock(image->lock);
}

/* Where the value that begins at byte i ends: whole registers, and what is glued. */
static size_t valueEnd(const plcImage *image, const epicsUInt8 *glue, size_t i)
{
    for (i++; glue && i < image->size && (glue[i] || i % 2); i++)
        ;
    return i;
}

/* Marks what differs in bytes first to end - 1, one value. Returns 1 when something does.
 * The lock is held. */
static int owe(plcImage *image, const epicsUInt8 *shown, size_t first, size_t end)
{
    const epicsUInt8 *now = bytesOf(image);
    int any = 0, whole = end - first > 1;
    size_t i;

    for (i = first; i < end; i++) {
        epicsUInt8 owed =
            (epicsUInt8)(image->ours[i] & (shown ? now[i] ^ shown[i] : 0xFF));

        image->changed[i] |= owed;
        any |= owed;
        whole &= image->ours[i] == 0xFF;
    }
    if (any && whole)
        memset(image->changed + first, 0xFF, end - first);
    return any != 0;
}

int plcImageOwe(plcImage *image, const void *shown, const epicsUInt8 *glue)
{
    int any = 0;
    size_t i, end;

    epicsMutexMustLock(image->lock);
    for (i = 0; image->changed && i < image->size; i = end) {
        end = valueEnd(image, glue, i);
        any |= owe(image, shown, i, end);
    }
    if (any)
        setDirty(image, 1);
    epicsMutexUnlock(image->lock);
    return any;
}
