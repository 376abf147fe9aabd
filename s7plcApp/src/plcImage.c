/* An image: the bytes of one block between record threads and the station's thread.
 *
 * Knows nothing of sockets, records or types. One mutex guards all of an image; it is
 * held for a copy of at most the block and for nothing else. A new input block is copied
 * before the lock is taken.
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsMutex.h>
#include <epicsStdio.h>

#include "plcImage.h"

struct plcImage {
    epicsMutexId lock;
    size_t size;
    epicsUInt8 *bytes; /* what others see */
    epicsUInt8 *spare; /* the block before, or the next one; the publisher's own */
    epicsTimeStamp stamp;
    int valid;
    int dirty;
    int closed; /* writes are refused */
    char reason[PLC_REASON_SIZE]; /* "" when valid */
};

plcImage *plcImageCreate(size_t size)
{
    plcImage *image = callocMustSucceed(1, sizeof(*image), "plcImageCreate");

    image->lock = epicsMutexMustCreate();
    image->size = size;
    image->bytes = callocMustSucceed(1, size ? size : 1, "plcImageCreate");
    image->spare = callocMustSucceed(1, size ? size : 1, "plcImageCreate");
    strcpy(image->reason, "not connected yet");
    return image;
}

void plcImageDestroy(plcImage *image)
{
    if (!image)
        return;
    epicsMutexDestroy(image->lock);
    free(image->bytes);
    free(image->spare);
    free(image);
}

size_t plcImageSize(const plcImage *image)
{
    return image->size;
}

int plcImageRead(plcImage *image, size_t offset, size_t length, void *dst,
                 epicsTimeStamp *stamp)
{
    int valid;

    epicsMutexMustLock(image->lock);
    valid = image->valid;
    if (valid) {
        memcpy(dst, image->bytes + offset, length);
        if (stamp)
            *stamp = image->stamp;
    }
    epicsMutexUnlock(image->lock);
    return valid ? 0 : -1;
}

void plcImageReason(plcImage *image, char reason[PLC_REASON_SIZE])
{
    epicsMutexMustLock(image->lock);
    memcpy(reason, image->reason, PLC_REASON_SIZE);
    epicsMutexUnlock(image->lock);
}

void plcImagePublish(plcImage *image, const void *block, const epicsTimeStamp *stamp)
{
    epicsUInt8 *fresh = image->spare;

    if (image->size)
        memcpy(fresh, block, image->size);
    epicsMutexMustLock(image->lock);
    image->spare = image->bytes;
    image->bytes = fresh;
    image->stamp = *stamp;
    image->valid = 1;
    image->reason[0] = 0;
    epicsMutexUnlock(image->lock);
}

const void *plcImageBytes(const plcImage *image)
{
    return image->bytes;
}

void plcImageInvalidate(plcImage *image, const char *reason)
{
    epicsMutexMustLock(image->lock);
    image->valid = 0;
    epicsSnprintf(image->reason, sizeof(image->reason), "%s", reason);
    epicsMutexUnlock(image->lock);
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

int plcImageWrite(plcImage *image, size_t offset, size_t length, const void *src,
                  const void *mask)
{
    int first;

    epicsMutexMustLock(image->lock);
    if (image->closed) {
        epicsMutexUnlock(image->lock);
        return -1;
    }
    put(image->bytes + offset, src, mask, length);
    first = !image->dirty;
    image->dirty = 1;
    epicsMutexUnlock(image->lock);
    return first;
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
    int changed;

    epicsMutexMustLock(image->lock);
    to = image->bytes + offset;
    changed = (!expected || memcmp(to, expected, length) == 0) &&
              differs(to, src, mask, length);
    if (changed)
        put(to, src, mask, length);
    epicsMutexUnlock(image->lock);
    return changed;
}

void plcImageForget(plcImage *image)
{
    epicsMutexMustLock(image->lock);
    image->dirty = 0;
    epicsMutexUnlock(image->lock);
}

int plcImageDirty(plcImage *image)
{
    int dirty;

    epicsMutexMustLock(image->lock);
    dirty = image->dirty;
    epicsMutexUnlock(image->lock);
    return dirty;
}

void plcImageTouch(plcImage *image)
{
    epicsMutexMustLock(image->lock);
    image->dirty = 1;
    epicsMutexUnlock(image->lock);
}

void plcImageTake(plcImage *image, void *dst)
{
    epicsMutexMustLock(image->lock);
    if (image->size)
        memcpy(dst, image->bytes, image->size);
    image->dirty = 0;
    epicsMutexUnlock(image->lock);
}

void plcImagePeek(plcImage *image, size_t offset, size_t length, void *dst)
{
    epicsMutexMustLock(image->lock);
    if (length)
        memcpy(dst, image->bytes + offset, length);
    epicsMutexUnlock(image->lock);
}
