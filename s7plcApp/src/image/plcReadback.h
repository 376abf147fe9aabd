/* Where the PLC shows what it holds of our outputs: places in the input block, and how they
 * get into the output image without a write.
 *
 * Knows two images and byte ranges; no records, no sockets, no clock. Places may come and go
 * from any thread; the rest is for the station's thread.
 */
#ifndef INC_plcReadback_H
#define INC_plcReadback_H

#include <stddef.h>

#include <epicsTypes.h>

#include "plcImage.h"

#define PLC_MASK_MAX 8 /* bytes of a place of which only some bits count */

typedef struct plcReadback plcReadback;

plcReadback *plcReadbackCreate(void);
void plcReadbackDestroy(plcReadback *readback);

/* `length` bytes at `out` of the output block are shown at `in` of the input block; only
 * the bits in mask (NULL: all; else length is at most PLC_MASK_MAX). `key` is whose place
 * it is; one place for each key. */
void plcReadbackAdd(plcReadback *readback, const void *key, size_t out, size_t in,
                    size_t length, const void *mask);
void plcReadbackRemove(plcReadback *readback, const void *key);

/* The number of places. */
unsigned plcReadbackCount(plcReadback *readback);

/* 1 when the output image holds at every place what the input block shows there. */
int plcReadbackSame(plcReadback *readback, const void *block, plcImage *out);

/* Copies what the block shows into the output image, but for places of which a bit is set in `hidden`
 * (as long as the block; NULL: all is shown). Returns the number of places that changed by it. */
unsigned plcReadbackTake(plcReadback *readback, const void *block, const void *hidden,
                         plcImage *out);

/* The same, but only for the places that were added since the last plcReadbackTake, and that
 * nobody has put to meanwhile. Returns their number. */
unsigned plcReadbackTakeNew(plcReadback *readback, const void *block, const void *hidden,
                            plcImage *out);

/* --- Tracking: the image follows what the PLC shows from block to block -------------------
 *
 * After a put a place waits: it is left alone until the PLC has shown what was put, or for
 * at most `limit`. Each value that was put and has left may still be shown later, in its order;
 * so a place that shows our value is only done when it has shown what was put before. A wire that
 * tells of each bit when it was read needs no such rule: plcShownAfter. */

/* From now on (on = 1) puts are noted: before tracking begins. Any thread. */
void plcReadbackNote(plcReadback *readback, int on);

/* plcImageWrite into the output image, and a note for the places of both lists that it
 * touches, before either is tracked again. `now` is monotonic, ns. Any thread. */
int plcReadbackWrite(plcReadback *readback, plcReadback *more, plcImage *out, size_t offset,
                     size_t length, const void *src, const void *mask, plcWritten *written,
                     epicsUInt64 now);

/* All places wait, as if what the image holds had been put now. leaves = 1: it is about to
 * leave (to another PLC); 0: it has left, nobody knows when. */
void plcReadbackWait(plcReadback *readback, plcImage *out, epicsUInt64 now, int leaves);

/* The number of places that wait. */
unsigned plcReadbackWaiting(plcReadback *readback);

/* What is known of the age of what is shown: all puts up to `through` are through, and only
 * the bits set in `older`, as long as the block, have not been read since. */
typedef struct plcShownAfter {
    epicsUInt64 through;
    const void *older;
} plcShownAfter;

/* What this block shows goes into the output image where no place waits. Called with every
 * block; now and limit in ns. `through`: all that was taken from the image so far has
 * reached the PLC. The limit counts from when the put has left. With `after` (NULL: it is not
 * known) neither time nor value counts: a place waits until it was read after its put was
 * through. Returns the number of places that changed. */
unsigned plcReadbackTrack(plcReadback *readback, const void *block, const void *hidden,
                          plcImage *out, epicsUInt64 now, epicsUInt64 limit, int through,
                          const plcShownAfter *after);

#endif /* INC_plcReadback_H */
