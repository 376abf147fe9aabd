/* Where blocks begin and end in the byte stream of one connection, whether the PLC sends
 * blocks of the size that was configured, and whether it is still in step.
 *
 * Pure: bytes and times go in, blocks and a verdict come out; no socket, no clock.
 *
 * TCP has no block boundaries: a PLC that sends 60 bytes where 64 are configured fills
 * each block with the tail of one and the head of the next. What gives it away is that its
 * bytes come in bursts with quiet between them, and that the bursts do not end where the
 * blocks end. Three stages:
 *   - Until one burst has ended at the end of a block (or there were no quiet times to
 *     judge by), blocks are held back as not yet trusted.
 *   - Once a rhythm is known, a block is shown only when all that came ends where it ends.
 *     The quiet before a block and the pauses within one are remembered: what comes after a
 *     quiet that is long enough must begin a block.
 *   - If it does not, that is doubt: nothing is shown until two blocks in a row begin and
 *     end where they should, or it is clear what is wrong.
 * A good block is shown when its last byte is there; nothing waits for quiet.
 */
#ifndef INC_plcFraming_H
#define INC_plcFraming_H

#include <stddef.h>

#include <epicsTypes.h>

typedef struct plcFraming plcFraming;

typedef enum {
    plcFramingOpen,    /* nothing known yet: blocks are not to be used */
    plcFramingTrusted, /* blocks are what the PLC sent */
    plcFramingDoubt,   /* they were, until a block began where none should: not to be used */
    plcFramingWrong    /* the block size is wrong, or the stream is out of step */
} plcFramingVerdict;

/* For blocks of blockSize bytes; 0: everything that comes is dropped. */
plcFraming *plcFramingCreate(size_t blockSize);
void plcFramingDestroy(plcFraming *framing);

/* Forgets everything: a new connection. */
void plcFramingReset(plcFraming *framing);

/* Where the next bytes go, and how many at most (never 0). */
void *plcFramingSpace(plcFraming *framing, size_t *room);

/* `count` bytes were put there at the time `now` (monotonic, ns). */
void plcFramingAdd(plcFraming *framing, size_t count, epicsUInt64 now);

/* The number of whole blocks that came since blocks were last taken; 0 while they are held
 * back, because it is not known yet whether they end where the PLC's blocks end. */
size_t plcFramingCount(const plcFraming *framing);

/* The newest whole block, valid until plcFramingConsume; NULL when there is none. */
const void *plcFramingNewest(const plcFraming *framing);

/* Drops all whole blocks; a block begun stays. Those that were held back are counted when
 * the next ones are taken. */
void plcFramingConsume(plcFraming *framing);

plcFramingVerdict plcFramingJudge(const plcFraming *framing);

/* Blocks came, and none could be shown for too long: a doubt becomes plcFramingWrong. When
 * there is none, nothing happens. */
void plcFramingGiveUp(plcFraming *framing);

/* Bytes per burst that the PLC seems to send, when that is not blockSize; 0: no sign of
 * it, or (with plcFramingWrong) no constant size at all. With plcFramingTrusted a multiple
 * or a fraction of blockSize is only a suspicion. With plcFramingWrong blockSize itself
 * says that the size is right, but its blocks begin elsewhere: out of step. */
size_t plcFramingBurst(const plcFraming *framing);

/* Doubts since the connection was made. */
unsigned plcFramingDoubts(const plcFraming *framing);

#endif /* INC_plcFraming_H */
