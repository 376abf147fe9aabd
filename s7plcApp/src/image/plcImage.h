/* An image: the bytes of one block, in or out, as records see them.
 *
 * Knows nothing of sockets, records or types. The one place where record threads and the
 * station's thread meet. All functions may be called from any thread; none blocks longer
 * than a copy of the block takes: the lock is never held across a system call, errlog,
 * a scan request or record processing. Reading of input takes no lock at all.
 */
#ifndef INC_plcImage_H
#define INC_plcImage_H

#include <stddef.h>

#include <epicsTime.h>
#include <epicsTypes.h>

#include "plcPuts.h"

typedef struct plcImage plcImage;

/* An image of `size` bytes, all zero, not valid, with the reason "not connected yet". */
plcImage *plcImageCreate(size_t size);
void plcImageDestroy(plcImage *image);
size_t plcImageSize(const plcImage *image);

/* Only its first bytes are in use, at most those that it was made with: the others are neither
 * published nor taken until this rises. By the thread that publishes. */
void plcImageUse(plcImage *image, size_t size);

/* --- Input: the station publishes, records read ------------------------------------- */

/* Copies `length` bytes at `offset` to `dst`; all of them are of one block. The caller
 * has checked offset + length <= size, once, when the record was initialised. stamp (may
 * be NULL): time stamp of the block. Returns 0, or -1 when the image is not valid: then
 * nothing is copied. */
int plcImageRead(plcImage *image, size_t offset, size_t length, void *dst,
                 epicsTimeStamp *stamp);

/* Why the image is not valid, in words for AMSG; "" when it is valid. */
void plcImageReason(plcImage *image, char reason[PLC_REASON_SIZE]);

/* A whole new block: the image is valid from now on. Only one thread publishes. */
void plcImagePublish(plcImage *image, const void *block, const epicsTimeStamp *stamp);

/* The bytes as they stand, for the thread that publishes, and for no other. They stay
 * unchanged until the publish after the next one: to compare a block with the one before.
 */
const void *plcImageBytes(const plcImage *image);

/* No data any more, or a better reason why not. */
void plcImageInvalidate(plcImage *image, const char *reason);

/* --- Output: records write, the station takes --------------------------------------- */

/* What became of a write. */
typedef struct plcWritten {
    size_t takes;       /* how often the image had been taken just before, or will have been at
                         * most when a put that waits is written: it leaves with a later take */
    epicsUInt64 number; /* of the put; 0: the image does not keep puts */
    plcLastPut *last;   /* set by the caller: filled when the write is made; NULL: nobody asks */
} plcWritten;

/* Writes `length` bytes at `offset`, only the bits that are set in `mask` (NULL: all).
 * Returns 1 when this is the first write since plcImageTake, else 0; or -1 when the image
 * is closed: then nothing was written. written: may be NULL. */
int plcImageWrite(plcImage *image, size_t offset, size_t length, const void *src,
                  const void *mask, plcWritten *written);

/* How often the image was taken, or handed over. */
size_t plcImageTakes(plcImage *image);

/* Closes the image for writes, or opens it: no write is under way when this returns. */
void plcImageClose(plcImage *image, int closed);

/* True when something was written since the last plcImageTake. */
int plcImageDirty(plcImage *image);

/* Marks the image as written, so that it leaves again (reconnect, forced send). */
void plcImageTouch(plcImage *image);

/* From now on no edge of a bit is lost, though only whole images leave: a put of single bits
 * that would undo a change which has not left waits, and so does every put to these bits after
 * it. At most `most` wait in their order. Without effect where puts are kept (see below).
 * Call it before the first write; the PLC is away (plcImageAway). */
void plcImageKeepEdges(plcImage *image, unsigned most);

/* Copies the whole image to `dst` and forgets that it was written. What waited is written now,
 * from the first put on, until one would change a bit again; the image is dirty by that. Returns
 * how many puts wait still. */
unsigned plcImageTake(plcImage *image, void *dst);

/* Sets bytes without a write: they do not leave because of it, and a closed image takes
 * them too. expected (may be NULL): only if the image holds just these bytes now.
 * Returns 1 when a bit changed. */
int plcImageSet(plcImage *image, size_t offset, size_t length, const void *src,
                const void *mask, const void *expected);

/* --- Output that leaves put by put (plcPuts.h) ---------------------------------------- */

/* From now on the image keeps its puts, at most so many, and remembers which bits were ever
 * written. Call it before the first write. */
void plcImageKeepPuts(plcImage *image, unsigned most);

/* Every value is to leave, in its order (1), or of numbers and texts the newest of those that
 * follow directly on each other (0, so it begins). Of single bits every value leaves. */
void plcImageAllEdges(plcImage *image, int all);

/* The PLC is away (1), or back (0): what is under way waits again, and makes the image dirty
 * when it is back. Of puts that wait for their edges the image holds the newest, and none waits
 * while it is away; so, too, when the image is closed. */
void plcImageAway(plcImage *image, int away);

/* The puts are somebody's business now: a take of the image, which copies nothing. */
void plcImageHandOver(plcImage *image);

/* For whoever sends: see plcPutsTake, plcPutsDone, plcPutsBack. joins is called with the lock held. */
unsigned plcImageTakePuts(plcImage *image, int (*joins)(void *arg, const plcPut *put),
                          void *arg, void *values, void *mask);
void plcImagePutsDone(plcImage *image);
void plcImagePutsBack(plcImage *image);

/* These bits of what is under way are given up: they do not wait again, and are not put again on
 * another connection, until somebody puts them anew. mask is as large as the image. */
void plcImagePutsGiveUp(plcImage *image, const void *mask);

/* The put of this number, to these bits, is to be made no more; nor are they put again on another
 * connection. */
plcPutFate plcImageCancel(plcImage *image, epicsUInt64 number, size_t offset, size_t length,
                          const void *mask);

/* Who asks leaves his place: what he has put there is not put again on another connection. */
void plcImageWithdraw(plcImage *image, const plcLastPut *last);

/* --- What became of a put: see plcLastPut ------------------------------------------------- */

/* These are asked for by their owner from now on, / no longer. Of an image that keeps no puts
 * only what plcImageRefuse says is known. */
void plcImageAsk(plcImage *image, plcLastPut *last);
void plcImageAskNot(plcImage *image, plcLastPut *last);

/* The last put was not made, or is not in the PLC, for this reason; its value is of no interest. */
void plcImageRefuse(plcImage *image, plcLastPut *last, const char *why);

/* What became of the last put is of no interest any more. */
void plcImageForgive(plcImage *image, plcLastPut *last);

/* Returns 1 and the reason when the last put is not in the PLC, else 0 and "". */
int plcImageWhyNot(plcImage *image, const plcLastPut *last, char why[PLC_REASON_SIZE]);

/* 1 while the last put has not left, or has no answer. */
int plcImageWaits(plcImage *image, const plcLastPut *last);

/* See plcPutsFail, plcPutsFailed, plcPutsShown. */
void plcImagePutsFail(plcImage *image, size_t offset, size_t length, const void *mask,
                      const char *why);
int plcImagePutsFailed(plcImage *image);
int plcImagePutsShown(plcImage *image, const void *shown, const void *unknown);

/* How many puts wait or are under way; of puts that are kept also their bits in mask, and what
 * the image holds there, in values (both as large as the image, may be NULL). */
unsigned plcImagePutsWaiting(plcImage *image, void *values, void *mask);

/* All puts that are kept, up to this number, are through, or void; and how many were dropped (may be NULL)
 * since the beginning, because too many waited. */
epicsUInt64 plcImagePutsThrough(plcImage *image, epicsUInt64 *dropped);

/* A new connection, where the PLC shows that it holds `shown` (as large as the image; NULL:
 * it does not show it): every bit that was ever written, differs and does not wait is put
 * before all that waits.
 * joined (may be NULL) has a byte per byte of the image, not 0: it belongs to the same value as
 * the byte before it. A value that was written whole is put again whole, as are the two bytes of a
 * register, so that it leaves as it was put.
 * Places that plcImageSet has set since are not ours any more, and do not count.
 * Returns 1 when a bit that was ever written differs, else 0. The image is dirty then. */
int plcImagePutAgain(plcImage *image, const void *shown, const epicsUInt8 *joined);

/* What was written since plcImageTake is no reason to send any more. Bits that were ever
 * written stay remembered. */
void plcImageForget(plcImage *image);

/* Copies without forgetting (show, read-back of an output): what was put last, also where it
 * waits. */
void plcImagePeek(plcImage *image, size_t offset, size_t length, void *dst);

#endif /* INC_plcImage_H */
