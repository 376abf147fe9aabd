/* What a Modbus PLC is asked: ranges of registers and bits as the user wrote them, the
 * requests that read them, and the requests that write what has changed.
 *
 * Pure: no socket, no thread, no clock, no libmodbus. Source of functions and limits: the
 * MODBUS Application Protocol Specification V1.1b3.
 */
#ifndef INC_plcModbusPlan_H
#define INC_plcModbusPlan_H

#include <stddef.h>

#include <epicsTypes.h>

#include "plcPuts.h"

/* Limits of one request */
#define PLC_READ_REGISTERS 125
#define PLC_READ_BITS 2000
#define PLC_WRITE_REGISTERS 123
#define PLC_WRITE_BITS 1968

typedef enum { plcHolding, plcInputRegisters, plcCoils, plcDiscrete } plcTable;

/* "holding", "input", "coils", "discrete" */
const char *plcTableName(plcTable table);

/* A run of registers or bits, and where it lies in an image. */
typedef struct plcRange {
    plcTable table;
    unsigned start, count; /* protocol addresses, from 0; registers or bits */
    size_t offset;         /* bytes from the start of the image */
    unsigned period;       /* ms between two reads; 0: outputs */
    int unit;              /* its number plus 1; PLC_UNIT_OF_PLC: that of the PLC */
} plcRange;

#define PLC_UNIT_OF_PLC 0

/* Bytes in the image: 2 per register; bits 8 to a byte, the first one is bit 0. */
size_t plcRangeBytes(const plcRange *range);

/* Parses "table start count [at offset] [every ms] [unit n], ..." into a new array, to be freed.
 * `output`: only holding and coils, and no `every`; none may write a register twice.
 * Numbers are decimal, or hexadecimal with 0x. Returns the number of ranges (0 for an
 * empty or missing text), and *size, the bytes of the image; or -1 with a message that
 * names the range, what is wrong and what is allowed; then *ranges is NULL. */
int plcRangesParse(const char *text, int output, plcRange **ranges, size_t *size,
                   char *error, size_t errorSize);

/* What is allowed of ranges[i], but may be a mistake: registers at an odd byte, or that a range before it
 * has too. `unit` is the unit of the PLC. A line in text, or "". */
void plcRangeDoubt(const plcRange *ranges, unsigned i, int unit, char *text, size_t size);

/* May a value lie in `length` bytes from `offset` on? `mask` (NULL: all) has the bits of them that it
 * has: each must be there. All of it must be in one range: what is in two need not come in one request.
 * A number, which has no mask, may have bits behind the last coil of a range: they read 0. Returns 1,
 * and a doubt ("": none) where they are written (output); or 0 with a line of what is wrong and what is
 * allowed, and *fits, how many bytes from `offset` on would do. */
int plcRangesHold(const plcRange *ranges, unsigned count, size_t offset, size_t length,
                  const void *mask, int output, size_t *fits, char *error, size_t errorSize);

/* One request of function 1 to 6, 15, 16 or 22. */
typedef struct plcRequest {
    epicsUInt8 function;
    plcTable table;
    unsigned start, count; /* registers or bits */
    unsigned period;       /* ms; reads only */
    int unit;              /* as in the range */
} plcRequest;

/* What one request may hold, where a PLC takes less than the standard allows; 0: that. */
typedef struct plcLimits {
    unsigned registers, bits;
} plcLimits;

/* The reads for these ranges: as few as the limits force. `joined` (NULL: nothing is known)
 * has a byte per byte of the image: not 0 means that this byte belongs to the same value
 * as the one before it (1: a number, else a text): no request ends there, nor within a byte of bits. A value is cut
 * only where it is longer than a request. Returns their number, and a new array,
 * to be freed. */
unsigned plcPlanReads(const plcRange *ranges, unsigned count, const epicsUInt8 *joined,
                      plcLimits limits, plcRequest **requests);

/* The writes for the bits set in `mask` (as large as the image): runs of whole registers,
 * runs of coils, and each register of which only some bits are set. `joined` as above.
 * `single`: functions 6 and 5 for requests of one register or coil. Bits that lie in no
 * range are left out. Returns the number of requests, and a new array, to be freed. */
unsigned plcPlanWrites(const plcRange *ranges, unsigned count, const epicsUInt8 *mask,
                       const epicsUInt8 *joined, plcLimits limits, int single,
                       plcRequest **requests);

/* May a put leave in one request with those before it? Only when it begins where they end, in
 * the same table of the same unit, whole registers after whole registers, coils after coils, or more bits of
 * the one register; so that halves of a refused request keep the order. */
typedef struct plcJoin {
    const plcRange *ranges; /* as above, set by the caller; the rest is 0 at first */
    unsigned count;
    plcLimits limits;
    unsigned most;          /* registers or coils that may still join */
    plcTable table;
    int unit;
    int whole;              /* whole registers, or coils */
    unsigned end;           /* behind the last one */
} plcJoin;
int plcPlanJoins(void *join, const plcPut *put);

/* Halves a request that was refused, at the last place before its middle (else the first
 * behind it) that cuts no value; coils of a byte that is no part of a longer value are
 * single values. Both have the function of the whole. Returns 1; or 0 when it holds one
 * value only. */
int plcPlanHalve(const plcRange *ranges, unsigned count, const epicsUInt8 *joined,
                 const plcRequest *request, plcRequest halves[2]);

/* How many registers or bits at the beginning and at the end of a request are a part only of a number
 * that is longer than a request may be. Both 0: none is. */
void plcPlanTorn(const plcRange *ranges, unsigned count, const epicsUInt8 *joined,
                 const plcRequest *request, unsigned *head, unsigned *tail);

/* Where a request lies in the image: a piece for each range of its table, unit and period that
 * it touches. The range may lie anywhere in the image, and coils may begin within a byte.
 * Returns their number, at most `max`; as many as there are ranges is always enough. */
typedef struct plcPiece {
    size_t offset;     /* in the image */
    unsigned first, count; /* registers or bits of the request, from 0 */
    unsigned bit;      /* bits: position of the first one in the byte at offset */
} plcPiece;
unsigned plcPlanPieces(const plcRange *ranges, unsigned count, const plcRequest *request,
                       plcPiece *pieces, unsigned max);

/* An exception code in words: "exception 2, illegal data address". */
void plcExceptionText(int code, char *text, size_t size);

#endif /* INC_plcModbusPlan_H */
