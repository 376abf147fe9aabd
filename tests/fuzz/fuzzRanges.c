/* Fuzz target: ranges of a Modbus PLC from their text, the requests that read them all, and the
 * requests that write what a mask says. Each request keeps the limits and lies in ranges; the
 * reads show every byte, the writes write every bit of the mask, and no other. */
#include <stdlib.h>
#include <string.h>

#include "fuzz.h"
#include "plcModbusPlan.h"

fuzzTarget fuzzRanges;

enum { imageMost = 4096, rangesMost = 60 };

static int isBits(plcTable table)
{
    return table == plcCoils || table == plcDiscrete;
}

/* Sets, in the image, the bits that a request covers. */
static void cover(const plcRange *ranges, unsigned count, const plcRequest *q, epicsUInt8 *seen)
{
    plcPiece *pieces = malloc(count * sizeof(*pieces));
    unsigned n = plcPlanPieces(ranges, count, q, pieces, count), i, k;

    fuzzCheck(n <= count);
    for (i = 0; i < n; i++) {
        unsigned width = isBits(q->table) ? 1 : 16;

        fuzzCheck(pieces[i].first + pieces[i].count <= q->count);
        for (k = 0; k < pieces[i].count * width; k++)
            seen[pieces[i].offset + (pieces[i].bit + k) / 8] |=
                (epicsUInt8)(1 << (pieces[i].bit + k) % 8);
    }
    free(pieces);
}

static void checkLimits(const plcRequest *q, plcLimits limits, int writes)
{
    unsigned registers = writes ? PLC_WRITE_REGISTERS : PLC_READ_REGISTERS;
    unsigned bits = writes ? PLC_WRITE_BITS : PLC_READ_BITS;
    unsigned most = isBits(q->table) ? limits.bits : limits.registers;
    unsigned standard = isBits(q->table) ? bits : registers;

    fuzzCheck(q->count > 0 && q->start + q->count <= 65536);
    fuzzCheck(q->count <= (most && most < standard ? most : standard));
}

static void halve(const plcRange *ranges, unsigned count, const epicsUInt8 *joined,
                  const plcRequest *q)
{
    plcRequest halves[2];

    if (!plcPlanHalve(ranges, count, joined, q, halves))
        return;
    fuzzCheck(halves[0].start == q->start && halves[0].count > 0 && halves[1].count > 0);
    fuzzCheck(halves[1].start == q->start + halves[0].count);
    fuzzCheck(halves[0].count + halves[1].count == q->count);
    fuzzCheck(halves[0].function == q->function && halves[1].function == q->function);
}

static void reads(const plcRange *ranges, unsigned count, size_t size, plcLimits limits,
                  const epicsUInt8 *joined)
{
    epicsUInt8 *seen = calloc(1, size);
    plcRequest *requests = NULL;
    unsigned n = plcPlanReads(ranges, count, joined, limits, &requests), i, k;

    for (i = 0; i < n; i++) {
        checkLimits(&requests[i], limits, 0);
        cover(ranges, count, &requests[i], seen);
        halve(ranges, count, joined, &requests[i]);
    }
    for (i = 0; i < count; i++) /* all of it, but for what is left of a byte of bits */
        for (k = 0; k < (isBits(ranges[i].table) ? ranges[i].count : 16 * ranges[i].count); k++)
            fuzzCheck(seen[ranges[i].offset + k / 8] >> k % 8 & 1);
    free(requests);
    free(seen);
}

static void writes(const plcRange *ranges, unsigned count, size_t size, plcLimits limits,
                   const epicsUInt8 *joined, const epicsUInt8 *mask, int single)
{
    epicsUInt8 *seen = calloc(1, size), *ours = calloc(1, size);
    plcRequest *requests = NULL;
    unsigned n = plcPlanWrites(ranges, count, mask, joined, limits, single, &requests), i, k;

    for (i = 0; i < n; i++) {
        checkLimits(&requests[i], limits, 1);
        fuzzCheck(strchr("\5\6\17\20\26", requests[i].function) && requests[i].function);
        cover(ranges, count, &requests[i], seen);
    }
    for (i = 0; i < count; i++)
        for (k = 0; k < (isBits(ranges[i].table) ? ranges[i].count : 16 * ranges[i].count); k++)
            ours[ranges[i].offset + k / 8] |= (epicsUInt8)(1 << k % 8);
    for (i = 0; i < size; i++) {
        fuzzCheck((mask[i] & ours[i] & ~seen[i]) == 0); /* nothing is left out */
        fuzzCheck((seen[i] & ~ours[i]) == 0);
    }
    free(requests);
    free(seen);
    free(ours);
}

/* The text; behind a NUL, bytes for masks, joined and limits. */
int fuzzRanges(const epicsUInt8 *data, size_t size)
{
    char *text = fuzzText(data, size), error[300] = "";
    size_t used = strlen(text), bytes = 0, i;
    fuzzBytes b = {data + (used < size ? used + 1 : size), used < size ? size - used - 1 : 0};
    int output = (int)(size & 1);
    epicsUInt8 *mask, *joined;
    plcRange *ranges = NULL;
    plcLimits limits;
    int n = plcRangesParse(text, output, &ranges, &bytes, error, sizeof(error));

    if (n <= 0) {
        fuzzCheck(!ranges && bytes == 0 && (n == 0 || error[0]));
        free(text);
        return 0;
    }
    fuzzCheck(ranges && bytes > 0 && bytes <= 16u << 20);
    if (bytes <= imageMost && n <= rangesMost) {
        limits.registers = fuzzTake(&b) % (PLC_READ_REGISTERS + 5);
        limits.bits = fuzzTake16(&b) % (PLC_READ_BITS + 5);
        mask = malloc(bytes);
        joined = malloc(bytes);
        for (i = 0; i < bytes; i++) {
            mask[i] = (epicsUInt8)fuzzTake(&b);
            joined[i] = i && (mask[i] & 0x42) == 0x42;
        }
        reads(ranges, (unsigned)n, bytes, limits, b.left & 1 ? joined : NULL);
        if (output)
            writes(ranges, (unsigned)n, bytes, limits, joined, mask, (int)(size & 2));
        free(mask);
        free(joined);
    }
    free(ranges);
    free(text);
    return 0;
}
