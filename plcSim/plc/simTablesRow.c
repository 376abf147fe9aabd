/* simTablesRow: the checks of one row of a table of pointers: form, area, bounds, the
 * PLC's own list of memory, what other rows write and show. As MAP_ROW of
 * docs/plc-tables.scl.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include "simTablesRow.h"
#include "simValue.h"

#define COUNT_MAX 1024 /* bytes of a row */
#define OWN_DBS 4      /* MAP_A and MAP_B, and what stands behind them in a real PLC */
#define ACCEPTED_DB 5  /* IE_ACC of a real PLC */
#define HELD_DB 6      /* its IE_HELD */
#define FLAGS_MAX 16384

static int number16(const epicsUInt8 *bytes) /* as an INT of the PLC */
{
    return (epicsInt16)simGetInt(bytes, 2, 1);
}

int simTableRowsTx(const simBlock *table)
{
    return number16(table->bytes + 2);
}

int simTableRowsRx(const simBlock *table)
{
    return number16(table->bytes + 4);
}

typedef struct pointer {
    unsigned head; /* syntax id and type */
    int count, number, start;
    epicsUInt32 address;
    unsigned area;
} pointer;

static pointer pointerAt(const simBlock *table, int row, int side)
{
    const epicsUInt8 *b =
        table->bytes + SIM_TABLE_HEAD + row * SIM_TABLE_ROW + side * SIM_TABLE_ROW / 2;
    pointer p;

    p.head = (unsigned)simGetInt(b, 2, 1);
    p.count = number16(b + 2);
    p.number = number16(b + 4);
    p.address = (epicsUInt32)simGetInt(b + 6, 4, 1);
    p.area = p.address >> 24;
    p.start = (int)((p.address & 0x3ffff) >> 3);
    return p;
}

static int isOwn(const simTables *t, int number)
{
    int first = (int)t->table[0]->number;

    return number == (int)t->tx->number || number == (int)t->rx->number ||
           number == ACCEPTED_DB || number == HELD_DB ||
           (number >= first && number < first + OWN_DBS);
}

static int isAllowed(const simTables *t, const pointer *p, int write)
{
    size_t i;

    for (i = 0; i < t->allowCount; i++) {
        const simAllow *a = &t->allows[i];

        if (a->block->area == p->area && (int)a->block->number == p->number &&
            (a->write || !write) && p->start >= (int)a->start &&
            p->start + p->count <= (int)(a->start + a->size))
            return 1;
    }
    return 0;
}

static int checkForeign(const simTables *t, const pointer *p, int write)
{
    const simBlock *block;

    if (p->area == SIM_AREA_M) {
        if (p->start > FLAGS_MAX - p->count)
            return errorEnd;
    } else {
        if (isOwn(t, p->number))
            return errorForbidden;
        block = p->number > 0 ? simMemoryFind(t->memory, SIM_AREA_DB, (unsigned)p->number)
                              : NULL;
        if (!block)
            return errorMissing;
        if (p->start > (epicsInt16)block->size - p->count)
            return errorEnd;
    }
    return isAllowed(t, p, write) ? errorNone : errorForbidden;
}

static int checkSide(const simTables *t, const pointer *p, int isRx, int ours)
{
    const simBlock *block = isRx ? t->rx : t->tx;
    int head = isRx ? 4 : SIM_TABLES_STATUS;

    if (p->head != 0x1002 || p->count < 1 || p->count > COUNT_MAX)
        return errorPointer;
    if (p->area != SIM_AREA_DB && (p->area != SIM_AREA_M || ours || p->number))
        return errorArea;
    if (p->address & 7)
        return errorBit;
    if (p->address & 0xfc0000)
        return errorEnd;
    if (!ours)
        return checkForeign(t, p, isRx);
    return p->number == (int)block->number && p->start >= head &&
                   p->start <= (int)block->size - p->count
               ? errorNone
               : errorOurs;
}

static int sameBlock(const pointer *a, const pointer *b)
{
    return a->area == b->area && a->number == b->number;
}

static int overlap(const simBlock *table, int first, int row, const pointer *target)
{
    int other;

    for (other = first; other < row; other++) {
        pointer p = pointerAt(table, other, 1);

        if (sameBlock(&p, target) && target->start < p.start + p.count &&
            p.start < target->start + target->count)
            return 1;
    }
    return 0;
}

/* A TX row has all bytes that this RX row sets. */
static int isShown(const simBlock *table, const pointer *target)
{
    int other;

    for (other = 0; other < simTableRowsTx(table); other++) {
        pointer p = pointerAt(table, other, 0);

        if (sameBlock(&p, target) && p.start <= target->start &&
            target->start + target->count <= p.start + p.count)
            return 1;
    }
    return 0;
}

int simTableCheckRow(const simTables *t, const simBlock *table, int row)
{
    int isRx = row >= simTableRowsTx(table), side, error;
    pointer p[2];

    for (side = 0; side < 2; side++) {
        p[side] = pointerAt(table, row, side);
        error = checkSide(t, &p[side], isRx, isRx == (side == 0));
        if (error)
            return error;
    }
    if (p[0].count != p[1].count)
        return errorLengths;
    if (overlap(table, isRx ? simTableRowsTx(table) : 0, row, &p[1]))
        return errorTwice;
    if (isRx && !isShown(table, &p[1]))
        return errorHidden;
    return errorNone;
}
