/* An image: the bytes that go out, from the records to the station's thread: what was written,
 * what has left, and which puts wait until a change of a bit has.
 *
 * Knows nothing of sockets, records or types.
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>

#include "plcHot.h"
#include "plcImagePvt.h"

/* The lock is held. */
static void setDirty(plcImage *image, int dirty)
{
    __atomic_store_n(&image->dirty, dirty, __ATOMIC_RELEASE);
}

/* Of an image that keeps edges: its bytes when it was taken last. */
static epicsUInt8 *leftOf(const plcImage *image)
{
    return (epicsUInt8 *)(image->words[!(image->blocks & 1)] + STAMP_WORDS);
}

/* True when puts wait for the next take. The lock is held. */
static int someWait(const plcImage *image)
{
    return image->edges && plcPutsCount(image->edges);
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

/* These bits were written. The lock is held. Returns the number of the put. */
static epicsUInt64 mark(plcImage *image, size_t offset, size_t length,
                        const epicsUInt8 *src, const epicsUInt8 *mask, plcLastPut *last)
{
    plcPut what = {offset, length, src, mask, last};
    size_t i;

    for (i = 0; i < length; i++)
        image->ours[offset + i] |= mask ? mask[i] : 0xFF;
    return plcPutsAdd(image->puts, &what, mask || image->allEdges);
}

/* These bits are the PLC's from now on. The lock is held. */
static void unmark(plcImage *image, size_t offset, size_t length, const epicsUInt8 *value,
                   const epicsUInt8 *mask)
{
    size_t i;

    for (i = 0; i < length; i++)
        image->ours[offset + i] &= mask ? (epicsUInt8)~mask[i] : 0;
    plcPutsReplace(image->puts, offset, length, value, mask);
}

/* True when the put would undo a change of a bit that has not left, or comes behind one that
 * waits. The lock is held. */
static int mustWait(const plcImage *image, size_t offset, size_t length, const epicsUInt8 *src,
                    const epicsUInt8 *mask)
{
    const epicsUInt8 *now = plcImageSeen(image) + offset, *left = leftOf(image) + offset;
    size_t i;

    if (!image->edges || image->away)
        return 0;
    if (plcPutsCount(image->edges) && plcPutsOverlay(image->edges, offset, length, mask, NULL))
        return 1;
    for (i = 0; mask && i < length; i++)
        if ((now[i] ^ left[i]) & (now[i] ^ src[i]) & mask[i])
            return 1;
    return 0;
}

/* What waits is in the image now, the newest of each bit, at these bytes. The lock is held. */
static void waitNoMore(plcImage *image, size_t offset, size_t length, const epicsUInt8 *mask)
{
    if (!someWait(image))
        return;
    plcPutsOverlay(image->edges, offset, length, mask, plcImageSeen(image) + offset);
    plcPutsVoid(image->edges, offset, length, mask);
}

/* What the PLC holds, for all that is known, is this. The lock is held. */
static void hasLeft(plcImage *image)
{
    if (image->edges && image->size)
        memcpy(leftOf(image), plcImageSeen(image), image->size);
}

static int always(void *arg, const plcPut *what)
{
    (void)arg, (void)what;
    return 1;
}

/* The image was taken: what waits is written, until a bit would change again. The lock is held.
 * Returns how many wait still. */
static unsigned writeWaiting(plcImage *image)
{
    if (!someWait(image))
        return 0;
    memset(image->batch, 0, image->size);
    plcPutsTake(image->edges, always, NULL, plcImageSeen(image), image->batch);
    plcPutsDone(image->edges);
    setDirty(image, 1);
    return plcPutsCount(image->edges);
}

int plcImageWrite(plcImage *image, size_t offset, size_t length, const void *src,
                  const void *mask, plcWritten *written)
{
    plcWritten ignored = {.last = NULL};
    int first;

    if (!written)
        written = &ignored;
    epicsMutexMustLock(image->lock);
    written->takes = image->takes;
    written->number = 0;
    if (image->closed) {
        epicsMutexUnlock(image->lock);
        return -1;
    }
    if (mustWait(image, offset, length, src, mask)) {
        plcPut what = {offset, length, src, mask, NULL};

        plcPutsAdd(image->edges, &what, mask != NULL);
        written->takes += plcPutsCount(image->edges);
    } else {
        put(plcImageSeen(image) + offset, src, mask, length);
    }
    if (image->puts)
        written->number = mark(image, offset, length, src, mask, written->last);
    else if (written->last)
        plcLastPutBegin(NULL, written->last, 0,
                        &(plcPut){offset, length, src, mask, NULL});
    if (written->last)
        written->last->takes = written->takes;
    first = !plcImageDirty(image);
    setDirty(image, 1);
    epicsMutexUnlock(image->lock);
    return first;
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
    if (closed)
        waitNoMore(image, 0, image->size, NULL);
    epicsMutexUnlock(image->lock);
}

int plcImageSet(plcImage *image, size_t offset, size_t length, const void *src,
                const void *mask, const void *expected)
{
    epicsUInt8 *to;
    int wanted, changed;

    epicsMutexMustLock(image->lock);
    to = plcImageSeen(image) + offset;
    waitNoMore(image, offset, length, mask);
    wanted = !expected || memcmp(to, expected, length) == 0;
    changed = wanted && differs(to, src, mask, length);
    if (changed)
        put(to, src, mask, length);
    if (wanted && image->edges)
        put(leftOf(image) + offset, src, mask, length);
    if (wanted && image->puts)
        unmark(image, offset, length, src, mask);
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
    if (image->puts)
        plcPutsVoidAll(image->puts);
    hasLeft(image);
}

unsigned plcImageTake(plcImage *image, void *dst)
{
    unsigned waiting;

    epicsMutexMustLock(image->lock);
    if (image->size)
        memcpy(dst, plcImageSeen(image), image->size);
    forget(image);
    image->takes++;
    waiting = writeWaiting(image);
    epicsMutexUnlock(image->lock);
    return waiting;
}

void plcImageForget(plcImage *image)
{
    epicsMutexMustLock(image->lock);
    waitNoMore(image, 0, image->size, NULL);
    forget(image);
    epicsMutexUnlock(image->lock);
}

void plcImagePeek(plcImage *image, size_t offset, size_t length, void *dst)
{
    epicsMutexMustLock(image->lock);
    if (length)
        memcpy(dst, plcImageSeen(image) + offset, length);
    if (length && someWait(image))
        plcPutsOverlay(image->edges, offset, length, NULL, dst);
    epicsMutexUnlock(image->lock);
}

/* --- Whole images, and the edges of bits -------------------------------------------- */

void plcImageKeepEdges(plcImage *image, unsigned most)
{
    epicsMutexMustLock(image->lock);
    if (!image->edges && !image->puts) {
        image->edges = plcPutsCreate(image->size, most);
        image->batch = callocMustSucceed(image->size + 1, 1, "plcImageKeepEdges");
        image->away = 1;
    }
    epicsMutexUnlock(image->lock);
}

/* The lock is held. */
static void edgesAway(plcImage *image, int away)
{
    waitNoMore(image, 0, image->size, NULL);
    hasLeft(image);
    image->away = away;
}

/* --- Output that leaves piece by piece --------------------------------------------- */

void plcImageKeepPuts(plcImage *image, unsigned most)
{
    epicsMutexMustLock(image->lock);
    if (!image->puts) {
        plcPutsDestroy(image->edges); /* all edges are kept in another way */
        image->edges = NULL;
        image->puts = plcPutsCreate(image->size, most);
        image->ours = callocMustSucceed(image->size + 1, 1, "plcImageKeepPuts");
    }
    epicsMutexUnlock(image->lock);
}

void plcImageAllEdges(plcImage *image, int all)
{
    epicsMutexMustLock(image->lock);
    image->allEdges = all;
    epicsMutexUnlock(image->lock);
}

void plcImageAway(plcImage *image, int away)
{
    epicsMutexMustLock(image->lock);
    if (image->edges)
        edgesAway(image, away);
    if (image->puts) {
        plcPutsBack(image->puts);
        plcPutsAway(image->puts, away);
        if (!away && plcPutsCount(image->puts))
            setDirty(image, 1);
    }
    epicsMutexUnlock(image->lock);
}

void plcImageHandOver(plcImage *image)
{
    epicsMutexMustLock(image->lock);
    setDirty(image, 0);
    image->takes++;
    epicsMutexUnlock(image->lock);
}

unsigned plcImageTakePuts(plcImage *image, int (*joins)(void *arg, const plcPut *put),
                          void *arg, void *values, void *mask)
{
    unsigned count;

    epicsMutexMustLock(image->lock);
    count = plcPutsTake(image->puts, joins, arg, values, mask);
    epicsMutexUnlock(image->lock);
    return count;
}

void plcImagePutsBack(plcImage *image)
{
    epicsMutexMustLock(image->lock);
    plcPutsBack(image->puts);
    epicsMutexUnlock(image->lock);
}

void plcImagePutsDone(plcImage *image)
{
    epicsMutexMustLock(image->lock);
    plcPutsDone(image->puts);
    epicsMutexUnlock(image->lock);
}

/* These bits of one byte are not ours any more, but for those of a newer put that waits. The lock
 * is held. */
static void disown(plcImage *image, size_t at, epicsUInt8 bits)
{
    unsigned bit;

    if (!plcPutsOverlay(image->puts, at, 1, &bits, NULL)) {
        image->ours[at] &= (epicsUInt8)~bits;
        return;
    }
    for (bit = 1; bit < 0x100; bit <<= 1) {
        epicsUInt8 one = (epicsUInt8)(bits & bit);

        if (one && !plcPutsOverlay(image->puts, at, 1, &one, NULL))
            image->ours[at] &= (epicsUInt8)~one;
    }
}

void plcImagePutsGiveUp(plcImage *image, const void *mask)
{
    const epicsUInt8 *bits = mask;
    size_t i;

    epicsMutexMustLock(image->lock);
    plcPutsEnd(image->puts, mask);
    for (i = 0; i < image->size; i++)
        if (bits[i])
            disown(image, i, bits[i]);
    epicsMutexUnlock(image->lock);
}

plcPutFate plcImageCancel(plcImage *image, epicsUInt64 number, size_t offset, size_t length,
                          const void *mask)
{
    const epicsUInt8 *bits = mask;
    plcPutFate fate;
    size_t i;

    epicsMutexMustLock(image->lock);
    fate = plcPutsCancel(image->puts, number);
    for (i = 0; fate != plcPutThrough && i < length; i++)
        disown(image, offset + i, bits ? bits[i] : 0xff);
    epicsMutexUnlock(image->lock);
    return fate;
}

void plcImageWithdraw(plcImage *image, const plcLastPut *last)
{
    const epicsUInt8 *bits = last->masked ? last->mask : NULL;
    size_t i;

    epicsMutexMustLock(image->lock);
    if (image->puts) {
        plcPutsAgainNot(image->puts, last->offset, last->length, bits);
        for (i = 0; i < last->length; i++)
            disown(image, last->offset + i, bits ? bits[i] : 0xff);
    }
    epicsMutexUnlock(image->lock);
}

/* --- What became of a put --------------------------------------------------------- */

void plcImageAsk(plcImage *image, plcLastPut *last)
{
    epicsMutexMustLock(image->lock);
    if (image->puts)
        plcPutsAsk(image->puts, last);
    epicsMutexUnlock(image->lock);
}

void plcImageAskNot(plcImage *image, plcLastPut *last)
{
    epicsMutexMustLock(image->lock);
    if (image->puts)
        plcPutsAskNot(image->puts, last);
    epicsMutexUnlock(image->lock);
}

void plcImageRefuse(plcImage *image, plcLastPut *last, const char *why)
{
    epicsMutexMustLock(image->lock);
    if (!last->goesOn)
        last->first = last->number;
    plcLastPutFail(image->puts, last, PLC_PUT_NEVER, why);
    epicsMutexUnlock(image->lock);
}

void plcImageForgive(plcImage *image, plcLastPut *last)
{
    epicsMutexMustLock(image->lock);
    plcLastPutForgive(image->puts, last);
    epicsMutexUnlock(image->lock);
}

int plcImageWhyNot(plcImage *image, const plcLastPut *last, char why[PLC_REASON_SIZE])
{
    why[0] = 0;
    if (!__atomic_load_n(&last->why[0], __ATOMIC_ACQUIRE))
        return 0;
    epicsMutexMustLock(image->lock);
    memcpy(why, last->why, PLC_REASON_SIZE);
    epicsMutexUnlock(image->lock);
    return why[0] != 0;
}

int plcImageWaits(plcImage *image, const plcLastPut *last)
{
    int waits;

    epicsMutexMustLock(image->lock);
    waits = last->waits;
    epicsMutexUnlock(image->lock);
    return waits;
}

void plcImagePutsFail(plcImage *image, size_t offset, size_t length, const void *mask,
                      const char *why)
{
    epicsMutexMustLock(image->lock);
    plcPutsFail(image->puts, offset, length, mask, why);
    epicsMutexUnlock(image->lock);
}

int plcImagePutsFailed(plcImage *image)
{
    int failed;

    epicsMutexMustLock(image->lock);
    failed = image->puts && plcPutsFailed(image->puts);
    epicsMutexUnlock(image->lock);
    return failed;
}

int plcImagePutsShown(plcImage *image, const void *shown, const void *unknown)
{
    int news;

    epicsMutexMustLock(image->lock);
    news = plcPutsShown(image->puts, shown, unknown);
    epicsMutexUnlock(image->lock);
    return news;
}

unsigned plcImagePutsWaiting(plcImage *image, void *values, void *mask)
{
    epicsUInt8 *bits = mask;
    unsigned count;

    epicsMutexMustLock(image->lock);
    count = image->puts ? plcPutsCount(image->puts) : 0;
    if (image->edges)
        count = plcPutsCount(image->edges);
    if (mask && image->size)
        memset(bits, 0, image->size);
    if (mask && image->size && image->puts) {
        plcPutsBits(image->puts, bits);
    }
    if (mask && values)
        put(values, plcImageSeen(image), bits, image->size);
    epicsMutexUnlock(image->lock);
    return count;
}

epicsUInt64 plcImagePutsThrough(plcImage *image, epicsUInt64 *dropped)
{
    epicsUInt64 through;

    epicsMutexMustLock(image->lock);
    through = image->puts ? plcPutsThrough(image->puts) : 0;
    if (dropped)
        *dropped = image->puts    ? plcPutsDropped(image->puts)
                   : image->edges ? plcPutsDropped(image->edges)
                                  : 0;
    epicsMutexUnlock(image->lock);
    return through;
}

/* Where the value that begins at byte i ends: whole registers, and what is joined to it. */
static size_t valueEnd(const plcImage *image, const epicsUInt8 *joined, size_t i)
{
    for (i++; joined && i < image->size && (joined[i] || i % 2); i++)
        ;
    return i;
}

/* Sets in `again` what differs in bytes first to end - 1, one value. Returns 1 when something
 * does. The lock is held. */
static int markAgain(plcImage *image, const epicsUInt8 *shown, size_t first, size_t end,
                     epicsUInt8 *again)
{
    const epicsUInt8 *now = plcImageSeen(image);
    int any = 0, whole = end - first > 1;
    size_t i;

    for (i = first; i < end; i++) {
        again[i] = (epicsUInt8)(image->ours[i] & (shown ? now[i] ^ shown[i] : 0xFF));
        any |= again[i];
        whole &= image->ours[i] == 0xFF;
    }
    if (any && whole)
        memset(again + first, 0xFF, end - first);
    return any != 0;
}

int plcImagePutAgain(plcImage *image, const void *shown, const epicsUInt8 *joined)
{
    epicsUInt8 *again = callocMustSucceed(image->size + 1, 1, "plcImagePutAgain");
    int any = 0;
    size_t i, end;

    epicsMutexMustLock(image->lock);
    for (i = 0; image->puts && i < image->size; i = end) {
        end = valueEnd(image, joined, i);
        any |= markAgain(image, shown, i, end, again);
    }
    if (any)
        plcPutsAhead(image->puts, plcImageSeen(image), again);
    if (any)
        setDirty(image, 1);
    epicsMutexUnlock(image->lock);
    free(again);
    return any;
}
