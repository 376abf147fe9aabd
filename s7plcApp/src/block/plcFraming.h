/* Where blocks begin and end in the byte stream of one connection, and whether the PLC
 * sends blocks of the size that was configured.
 *
 * Pure: bytes and times go in, blocks and a verdict come out; no socket, no clock.
 *
 * TCP has no block boundaries: a PLC that sends 60 bytes where 64 are configured fills
 * each block with the tail of one and the head of the next. What gives it away is that its
 * bytes come in bursts with quiet between them, and that the bursts do not end where the
 * blocks end. Until one burst has ended at the end of a block (or there were no quiet
 * times to judge by), blocks are held back as not yet trusted.
 */
#ifndef INC_plcFraming_H
#define INC_plcFraming_H

#include <stddef.h>

#include <epicsTypes.h>

typedef struct plcFraming plcFraming;

typedef enum {
    plcFramingOpen,    /* nothing known yet: blocks are not to be used */
    plcFramingTrusted, /* blocks are what the PLC sent */
    plcFramingWrong    /* the block size is wrong */
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

/* The number of whole blocks that wait to be consumed. */
size_t plcFramingCount(const plcFraming *framing);

/* The newest whole block, valid until plcFramingConsume; NULL when there is none. */
const void *plcFramingNewest(const plcFraming *framing);

/* Drops all whole blocks; a block begun stays. */
void plcFramingConsume(plcFraming *framing);

plcFramingVerdict plcFramingJudge(const plcFraming *framing);

/* Bytes per burst that the PLC seems to send, when that is not blockSize; 0: no sign of
 * it, or (with plcFramingWrong) no constant size at all. A multiple or a fraction of
 * blockSize is only a suspicion: the verdict stays as it is. */
size_t plcFramingBurst(const plcFraming *framing);

#endif /* INC_plcFraming_H */
