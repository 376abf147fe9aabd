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

/* Copies what the block shows into the output image. Returns the number of places that
 * changed by it. */
unsigned plcReadbackTake(plcReadback *readback, const void *block, plcImage *out);

/* The same, but only for places where the difference is not a write of ours that is still
 * on its way: such a place waits until the PLC shows our value, or `patience` ns. Called
 * with every block; `now` is monotonic, ns. */
unsigned plcReadbackTrack(plcReadback *readback, const void *block, plcImage *out,
                          epicsUInt64 now, epicsUInt64 patience);

#endif /* INC_plcReadback_H */
