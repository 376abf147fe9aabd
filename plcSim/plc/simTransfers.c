/* simTransfers: what moves between PLC memory and the blocks; see simTransfers.h.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <cantProceed.h>

#include "simTransfers.h"
#include "simValue.h"

#define PAIR (2 * SIM_ANY)
#define FREE_PAIRS 8 /* places left in a pointer table */

/* ---- moves ---- */

/* One move of bytes, or of one bit. */
typedef struct move {
    epicsUInt8 *from, *to;
    int fromBit, toBit; /* -1 = bytes */
    size_t size;        /* bytes */
} move;

/* Returns nonzero to stop. */
typedef int (*moveFn)(simProgram *program, const move *m, void *arg);

static int inside(const simBlock *block, const epicsUInt8 *p, size_t size)
{
    return block && p >= block->bytes && p < block->bytes + block->size &&
           size <= block->size - (size_t)(p - block->bytes);
}

/* Error code as BLKMOV's RET_VAL: 8xnn, x = 1 for the source, 3 for the destination. */
static unsigned readPair(simProgram *program, const simTransfers *t,
                         const epicsUInt8 *pair, move *m)
{
    size_t toSize;
    unsigned code;

    code = simAnyBytes(program->memory, pair, &m->from, &m->size);
    if (code)
        return 0x8100 | code;
    code = simAnyBytes(program->memory, pair + SIM_ANY, &m->to, &toSize);
    if (code)
        return 0x8300 | code;
    if (toSize != m->size)
        return 0x8323;
    if (t == &program->unpack && !inside(program->rx, m->from, m->size))
        return 0x8124;
    if (t == &program->pack && !inside(program->tx, m->to, m->size))
        return 0x8324;
    m->fromBit = m->toBit = -1;
    return 0;
}

/* Tells of a bad pointer once, and when all are good again. */
static void notePointers(simProgram *program, simTransfers *t, unsigned retVal,
                         size_t entry)
{
    const char *who = t == &program->pack ? "PACK_TX_DB" : "UNPACK_RX_DB";
    const char *table = t == &program->pack ? "DB_TX_PTRS" : "DB_RX_PTRS";

    if (retVal)
        program->counts.pointerErrors++;
    if (retVal == t->retVal && (!retVal || entry == t->badEntry))
        return;
    t->retVal = retVal;
    t->badEntry = entry;
    if (retVal)
        simComplain(
            program->name, "%s: entry %lu of %s refused, RET_VAL W#16#%04X: %s: %s", who,
            (unsigned long)entry, table, retVal,
            (retVal & 0xf00) == 0x100 ? "source" : "destination", simAnyError(retVal));
    else
        simLog(program->name, "%s: all pointers of %s are good", who, table);
}

/* Pair number `entry`, NULL behind the last. */
static const epicsUInt8 *pairAt(const simProgram *program, const simTransfers *t,
                                size_t entry)
{
    int isTx = t == &program->pack;

    if (program->tables.rows)
        return entry < simTablesRows(&program->tables, isTx)
                   ? simTablesRow(&program->tables, isTx, entry)
                   : NULL;
    if (!t->table || (entry + 1) * PAIR > t->table->size ||
        t->table->bytes[entry * PAIR] == 0)
        return NULL;
    return t->table->bytes + entry * PAIR;
}

static int forPairs(simProgram *program, simTransfers *t, moveFn fn, void *arg)
{
    unsigned firstBad = 0, code;
    size_t badEntry = 0, entry;
    const epicsUInt8 *pair;
    int stop = 0;
    move m;

    for (entry = 0; !stop && (pair = pairAt(program, t, entry)); entry++) {
        code = readPair(program, t, pair, &m);
        if (!code) {
            stop = fn(program, &m, arg);
        } else if (!firstBad) {
            firstBad = code;
            badEntry = entry;
        }
    }
    if (!stop)
        notePointers(program, t, firstBad, badEntry);
    return stop;
}

static int forMoves(simProgram *program, simTransfers *t, moveFn fn, void *arg)
{
    size_t i;

    for (i = 0; i < t->assignCount; i++) {
        const simAssign *a = &t->assigns[i];
        move m = {a->from.block->bytes + a->from.offset,
                  a->to.block->bytes + a->to.offset,
                  a->from.bit,
                  a->to.bit,
                  a->from.width};

        if (fn(program, &m, arg))
            return 1;
    }
    return forPairs(program, t, fn, arg);
}

static int getBit(const epicsUInt8 *p, int bit)
{
    return *p >> bit & 1;
}

static void moveBytes(const move *m, const epicsUInt8 *from, epicsUInt8 *to, size_t size)
{
    if (m->fromBit < 0)
        memmove(to, from, size);
    else if (getBit(from, m->fromBit))
        *to |= (epicsUInt8)(1u << m->toBit);
    else
        *to &= (epicsUInt8) ~(1u << m->toBit);
}

static int copyMove(simProgram *program, const move *m, void *arg)
{
    (void)program;
    (void)arg;
    moveBytes(m, m->from, m->to, m->size);
    return 0;
}

/* Compares PLC memory with `arg`, a block as IE_RX has it. */
static int compareMove(simProgram *program, const move *m, void *arg)
{
    size_t offset = (size_t)(m->from - program->rx->bytes), i = 0;
    const epicsUInt8 *from = (const epicsUInt8 *)arg + offset;
    int equal = m->fromBit < 0 ? !memcmp(from, m->to, m->size)
                               : getBit(from, m->fromBit) == getBit(m->to, m->toBit);

    if (equal)
        return 0;
    if (m->fromBit >= 0) {
        snprintf(program->difference, sizeof(program->difference),
                 "byte %lu bit %d of IE_RX is %d, the PLC has %d", (unsigned long)offset,
                 m->fromBit, getBit(from, m->fromBit), getBit(m->to, m->toBit));
        return 1;
    }
    while (from[i] == m->to[i])
        i++;
    snprintf(program->difference, sizeof(program->difference),
             "byte %lu of IE_RX is 0x%02x, the PLC has 0x%02x",
             (unsigned long)(offset + i), from[i], m->to[i]);
    return 1;
}

void simTransfersCopy(simProgram *program, simTransfers *t)
{
    forMoves(program, t, copyMove, NULL);
}

int simTransfersSame(simProgram *program, epicsUInt8 *setpoints)
{
    return !forMoves(program, &program->unpack, compareMove, setpoints);
}

/* ---- adding transfers ---- */

static int isPointer(const char *word)
{
    return !strncasecmp(word, "P#", 2);
}

static int addPair(simProgram *program, int isTx, simAnyPair *pair,
                   char error[SIM_ERROR_SIZE])
{
    simTransfers *t = isTx ? &program->pack : &program->unpack;

    if (simAnySize(&pair->from) != simAnySize(&pair->to))
        return simFail(
            error, "the two pointers have different lengths: %lu and %lu bytes",
            (unsigned long)simAnySize(&pair->from), (unsigned long)simAnySize(&pair->to));
    t->pairs = realloc(t->pairs, (t->pairCount + 1) * sizeof(simAnyPair));
    if (!t->pairs)
        cantProceed("simProgram: out of memory");
    t->pairs[t->pairCount++] = *pair;
    return 0;
}

/* The short form of a pointer into IE_TX or IE_RX: the offset alone. */
static int shortPointer(simProgram *program, int isTx, const char *word,
                        const simAny *other, simAny *any, char error[SIM_ERROR_SIZE])
{
    simBlock *block = isTx ? program->tx : program->rx;
    simPlace place;

    if (simPlaceParse(program->memory, word, block, &place, error))
        return -1;
    *any = *other;
    any->area = (epicsUInt8)place.block->area;
    any->db = (epicsUInt16)place.block->number;
    any->bit = (epicsUInt32)place.offset * 8;
    return 0;
}

/* Either side, or both, are pointers of three words. */
static int pointerTransfer(simProgram *program, int isTx, char **words, size_t count,
                           char error[SIM_ERROR_SIZE])
{
    int fromPointer = isPointer(words[0]);
    size_t arrow = fromPointer ? 3 : 1;
    int toPointer;
    simAnyPair pair;

    if (count < arrow + 2 || strcmp(words[arrow], "->"))
        return simFail(error, "a transfer wants: <from> -> <to>");
    toPointer = isPointer(words[arrow + 1]);
    if (count != arrow + (toPointer ? 4u : 2u))
        return simFail(error, "a pointer wants an address, a type and a length");
    if ((fromPointer && simAnyParse(words, &pair.from, error)) ||
        (toPointer && simAnyParse(words + arrow + 1, &pair.to, error)))
        return -1;
    if (!fromPointer &&
        shortPointer(program, isTx, words[0], &pair.to, &pair.from, error))
        return -1;
    if (!toPointer &&
        shortPointer(program, isTx, words[arrow + 1], &pair.from, &pair.to, error))
        return -1;
    return addPair(program, isTx, &pair, error);
}

/* In "DB4.DBD12 -> 8" the offset alone takes the width of the other side. */
static int matchWidths(simPlace *from, simPlace *to, char error[SIM_ERROR_SIZE])
{
    if (!from->width && from->bit < 0)
        from->width = to->width;
    if (!to->width && to->bit < 0)
        to->width = from->width;
    if (from->bit >= 0 && to->bit >= 0)
        from->width = to->width = 1;
    if (!from->width || from->width != to->width || (from->bit < 0) != (to->bit < 0))
        return simFail(
            error, "both sides of a transfer must be equally wide, such as DBW and DBW");
    if (from->width > from->block->size - from->offset ||
        to->width > to->block->size - to->offset)
        return simFail(error, "the transfer goes beyond the end of a block");
    return 0;
}

int simTransfersAdd(simProgram *program, int isTx, char **words, size_t count,
                       char error[SIM_ERROR_SIZE])
{
    simTransfers *t = isTx ? &program->pack : &program->unpack;
    simBlock *block = isTx ? program->tx : program->rx;
    simAssign a;
    size_t i;

    if (!block)
        return simFail(error, "there is no %s: it has 0 bytes", isTx ? "IE_TX" : "IE_RX");
    for (i = 0; i < count; i++)
        if (isPointer(words[i]))
            return pointerTransfer(program, isTx, words, count, error);
    if (count != 3 || strcmp(words[1], "->"))
        return simFail(error, "a transfer wants: <from> -> <to>");
    if (simPlaceParse(program->memory, words[0], block, &a.from, error) ||
        simPlaceParse(program->memory, words[2], block, &a.to, error) ||
        matchWidths(&a.from, &a.to, error))
        return -1;
    if ((isTx ? a.to.block : a.from.block) != block)
        return simFail(error, isTx ? "tx goes to IE_TX" : "rx comes from IE_RX");
    t->assigns = realloc(t->assigns, (t->assignCount + 1) * sizeof(simAssign));
    if (!t->assigns)
        cantProceed("simProgram: out of memory");
    t->assigns[t->assignCount++] = a;
    return 0;
}

static int makeTable(simProgram *program, simTransfers *t, unsigned db, const char *name,
                     char error[SIM_ERROR_SIZE])
{
    if (!t->pairCount || program->tables.rows)
        return 0;
    t->table = simMemoryAdd(program->memory, SIM_AREA_DB, db,
                            (t->pairCount + FREE_PAIRS) * PAIR, name);
    if (!t->table)
        return simFail(error, "%s cannot be DB%u: there is such a block already", name,
                       db);
    return 0;
}

static void fillTable(simTransfers *t)
{
    size_t i;

    if (!t->table)
        return;
    memset(t->table->bytes, 0, t->table->size);
    for (i = 0; i < t->pairCount; i++) {
        simAnyEncode(&t->pairs[i].from, t->table->bytes + i * PAIR);
        simAnyEncode(&t->pairs[i].to, t->table->bytes + i * PAIR + SIM_ANY);
    }
}

static epicsUInt8 *putPairs(const simTransfers *t, epicsUInt8 *to)
{
    size_t i;

    for (i = 0; i < t->pairCount; i++, to += PAIR) {
        simAnyEncode(&t->pairs[i].from, to);
        simAnyEncode(&t->pairs[i].to, to + SIM_ANY);
    }
    return to;
}

/* With tables the pairs of the file are the table that the PLC begins with. */
static void preload(simProgram *program)
{
    epicsUInt8 bytes[SIM_TABLE_HEAD + 255 * SIM_TABLE_ROW] = {0};
    epicsUInt8 *end;

    if (program->pack.pairCount + program->unpack.pairCount == 0)
        return;
    simPutInt(bytes, 2, 1, program->layout);
    simPutInt(bytes + 2, 2, 1, program->pack.pairCount);
    simPutInt(bytes + 4, 2, 1, program->unpack.pairCount);
    end = putPairs(&program->unpack, putPairs(&program->pack, bytes + SIM_TABLE_HEAD));
    simTablesPreload(&program->tables, bytes, (size_t)(end - bytes));
}

void simTransfersFill(simProgram *program)
{
    if (program->tables.rows) {
        preload(program);
        return;
    }
    fillTable(&program->pack);
    fillTable(&program->unpack);
}

int simTransfersInit(simProgram *program, unsigned txPtrsDb, unsigned rxPtrsDb,
                     char error[SIM_ERROR_SIZE])
{
    if (makeTable(program, &program->pack, txPtrsDb, "DB_TX_PTRS", error) ||
        makeTable(program, &program->unpack, rxPtrsDb, "DB_RX_PTRS", error))
        return -1;
    simTransfersFill(program);
    return 0;
}

static void freeTransfers(simTransfers *t)
{
    free(t->assigns);
    free(t->pairs);
}

void simTransfersFree(simProgram *program)
{
    freeTransfers(&program->pack);
    freeTransfers(&program->unpack);
}
