/* simTables: tables of pointers that the IOC brings; see simTables.h.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <cantProceed.h>

#include "simTables.h"
#include "simTablesRow.h"
#include "simValue.h"

#define CRC_BYTES 64   /* of a new table that a cycle checks */
#define TAIL_BYTES 4   /* of the table in use */
#define PART_PAUSE 5.0 /* s without a part that end a download */
#define KEPT_CRC 4     /* where MAP has them, as in the SCL */
#define KEPT_ACTIVE 12
#define KEPT_SIZE 32

enum { cmdBegin = 1, cmdPart, cmdCommit, cmdAbort };

static int makeBlocks(simTables *t, unsigned db, char error[SIM_ERROR_SIZE])
{
    static const char *const names[] = {"MAP_A", "MAP_B"};
    int i;

    if (!t->tx || !t->rx || t->tx->size < SIM_TABLES_STATUS || t->rx->size < 16)
        return simFail(error, "with map = on, in and out need 16 bytes at least");
    for (i = 0; i < 2; i++) {
        t->table[i] = simMemoryAdd(t->memory, SIM_AREA_DB, db + (unsigned)i,
                                   SIM_TABLE_HEAD + t->rows * SIM_TABLE_ROW, names[i]);
        if (!t->table[i])
            return simFail(error, "%s cannot be DB%u: there is such a block already",
                           names[i], db + (unsigned)i);
    }
    t->kept = simMemoryAdd(t->memory, SIM_AREA_DB, db + 2, KEPT_SIZE, "MAP");
    if (!t->kept)
        return simFail(error, "MAP cannot be DB%u: there is such a block already",
                       db + 2);
    return 0;
}

int simTablesInit(simTables *t, unsigned db, char error[SIM_ERROR_SIZE])
{
    t->active = -1;
    t->pause = -1;
    if (!t->rows || makeBlocks(t, db, error) == 0)
        return 0;
    t->rows = 0; /* what is read of the file behind the error finds no tables */
    return -1;
}

static void keep(simTables *t)
{
    unsigned number = t->active < 0 ? 0 : t->table[t->active]->number;

    simPutInt(t->kept->bytes + KEPT_CRC, 4, 1, t->inUse);
    simPutInt(t->kept->bytes + KEPT_ACTIVE, 2, 1, number);
}

static void recall(simTables *t)
{
    unsigned number = (unsigned)simGetInt(t->kept->bytes + KEPT_ACTIVE, 2, 1);

    t->inUse = (epicsUInt32)simGetInt(t->kept->bytes + KEPT_CRC, 4, 1);
    t->active = number == t->table[0]->number   ? 0
                : number == t->table[1]->number ? 1
                                                : -1;
}

void simTablesFree(simTables *t)
{
    free(t->allows);
}

static simBlock *blockNamed(const simMemory *memory, const char *word)
{
    unsigned number;
    char rest;

    if (strcasecmp(word, "M") == 0)
        return simMemoryFind(memory, SIM_AREA_M, 0);
    if (sscanf(word, "%*1[Dd]%*1[Bb]%5u%c", &number, &rest) == 1)
        return simMemoryFind(memory, SIM_AREA_DB, number);
    return simMemoryFindName(memory, word);
}

int simTablesAllow(simTables *t, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    simAllow allow = {NULL, 0, 0, 0};
    unsigned long start = 0, size;
    char rest;

    if ((count != 2 && count != 4) ||
        (strcmp(words[0], "read") && strcmp(words[0], "write")))
        return simFail(error, "allow wants: read|write <block> [<first byte> <bytes>]");
    allow.block = blockNamed(t->memory, words[1]);
    if (!allow.block)
        return simFail(error, "\"%.40s\" is no block: DB10, a name, or M", words[1]);
    size = allow.block->size;
    if (count == 4 && (sscanf(words[2], "%6lu%c", &start, &rest) != 1 ||
                       sscanf(words[3], "%6lu%c", &size, &rest) != 1))
        return simFail(error, "first byte and number of bytes are numbers");
    if (start > allow.block->size || size > allow.block->size - start)
        return simFail(error, "%s has %lu bytes", simBlockName(allow.block),
                       (unsigned long)allow.block->size);
    allow.start = start;
    allow.size = size;
    allow.write = strcmp(words[0], "write") == 0;
    t->allows = realloc(t->allows, (t->allowCount + 1) * sizeof(simAllow));
    if (!t->allows)
        cantProceed("simTables: out of memory");
    t->allows[t->allowCount++] = allow;
    return 0;
}

/* ---- bytes of a table ---- */

static int rowsFit(const simTables *t, const simBlock *table)
{
    int tx = simTableRowsTx(table), rx = simTableRowsRx(table), most = (int)t->rows;

    return tx >= 0 && rx >= 0 && tx <= most && rx <= most - tx;
}

static int sizeOf(const simBlock *table)
{
    return SIM_TABLE_HEAD +
           (simTableRowsTx(table) + simTableRowsRx(table)) * SIM_TABLE_ROW;
}

/* CRC-32 of some bytes, on top of sum; the table's own field counts as 0. */
static epicsUInt32 crcOf(const simBlock *table, int start, int count, epicsUInt32 sum)
{
    int i, bit;

    for (i = start; i < start + count; i++) {
        if (i < 6 || i > 9)
            sum ^= table->bytes[i];
        for (bit = 0; bit < 8; bit++)
            sum = sum & 1 ? sum >> 1 ^ 0xedb88320u : sum >> 1;
    }
    return sum;
}

static epicsUInt32 crcOfAll(const simBlock *table)
{
    return crcOf(table, 0, sizeOf(table), 0xffffffffu) ^ 0xffffffffu;
}

/* ---- the loader ---- */

static int idle(const simTables *t)
{
    return t->active < 0 ? simMapNone : simMapActive;
}

static int isBusy(const simTables *t)
{
    return t->state == simMapLoading || t->state == simMapChecking;
}

static simBlock *otherTable(const simTables *t)
{
    return t->table[t->active == 0 ? 1 : 0];
}

static int begin(simTables *t, const simTablesInputs *in)
{
    t->state = idle(t);
    t->error = t->row = t->expected = 0;
    t->session = t->rx->bytes[5];
    if (!t->allow)
        return errorLocked;
    if (!in->remote)
        return errorLocal;
    t->state = simMapLoading;
    return 0;
}

static int part(simTables *t, int start, int count)
{
    if (start != t->expected)
        return errorGap;
    if (count < 1 || count > (int)t->rx->size - 12)
        return errorPart;
    if (start + count > (int)otherTable(t)->size)
        return errorRows;
    memcpy(otherTable(t)->bytes + start, t->rx->bytes + 12, (size_t)count);
    t->expected = start + count;
    return 0;
}

static int commit(simTables *t)
{
    const simBlock *table = otherTable(t);

    if (t->expected < SIM_TABLE_HEAD || simTableRowsTx(table) < 0 ||
        simTableRowsRx(table) < 0)
        return errorIncomplete;
    if (!rowsFit(t, table))
        return errorRows;
    if (simTableRowsTx(table) + simTableRowsRx(table) < 1 || t->expected != sizeOf(table))
        return errorIncomplete;
    t->state = simMapChecking;
    t->wanted = (epicsUInt32)simGetInt(t->rx->bytes + 12, 4, t->memory->bigEndian);
    t->sum = 0xffffffffu;
    t->position = 0;
    t->nextRow = -1;
    return 0;
}

static int command(simTables *t, const simTablesInputs *in)
{
    const epicsUInt8 *rx = t->rx->bytes;
    int start = (epicsInt16)simGetInt(rx + 6, 2, t->memory->bigEndian);
    int count = (epicsInt16)simGetInt(rx + 8, 2, t->memory->bigEndian);

    if (rx[4] == cmdBegin)
        return begin(t, in);
    if (rx[4] == cmdAbort) {
        if (t->session == rx[5] && isBusy(t))
            t->state = idle(t);
        return 0;
    }
    if (t->state != simMapLoading || t->session != rx[5])
        return errorSession;
    if (rx[4] == cmdPart)
        return part(t, start, count);
    if (rx[4] == cmdCommit)
        return commit(t);
    return errorCommand;
}

/* What another table has put into IE_TX. */
static void clearData(simTables *t)
{
    memset(t->tx->bytes + SIM_TABLES_STATUS, 0, t->tx->size - SIM_TABLES_STATUS);
}

static void activate(simTables *t)
{
    t->active = t->active == 0 ? 1 : 0;
    t->state = simMapActive;
    t->inUse = t->wanted;
    t->row = 0;
    t->tailPos = 0;
    t->loads++;
    clearData(t);
    simLog(t->name, "table of pointers in use: CRC 0x%08x, layout 0x%04x",
           (unsigned)t->inUse, simTablesLayout(t));
}

/* Some of the check of a new table. */
static int check(simTables *t)
{
    const simBlock *table = otherTable(t);
    int count = t->expected - t->position, error;

    if (t->nextRow < 0) {
        if (count > CRC_BYTES)
            count = CRC_BYTES;
        t->sum = crcOf(table, t->position, count, t->sum);
        t->position += count;
        if (t->position < t->expected)
            return 0;
        t->nextRow = 0;
        return (t->sum ^ 0xffffffffu) == t->wanted ? 0 : errorCrc;
    }
    if (t->nextRow < simTableRowsTx(table) + simTableRowsRx(table)) {
        error = simTableCheckRow(t, table, t->nextRow);
        t->row = t->nextRow++ & 0xff;
        return error;
    }
    activate(t);
    return 0;
}

/* The first error stays. */
static void refuse(simTables *t, int error)
{
    if (!error || t->state == simMapRefused)
        return;
    t->state = simMapRefused;
    t->error = error;
    t->refusals++;
    simLog(t->name, "table of pointers refused: error %d, row %d", error, t->row);
}

/* What ends a download without a block. */
static void interrupt(simTables *t, const simTablesInputs *in, int late)
{
    int error = !in->remote ? errorLocal : !t->allow ? errorLocked : late ? errorLate : 0;

    if (isBusy(t) && error) {
        t->state = idle(t);
        t->error = error;
    }
    if (in->reset) {
        t->state = idle(t);
        t->error = t->row = t->expected = 0;
    }
}

/* Is the table in use what it was? A spoilt one is none. */
static void watchTail(simTables *t)
{
    const simBlock *table = t->active < 0 ? NULL : t->table[t->active];
    int size, count, spoilt = 0;

    if (!table)
        return;
    size = sizeOf(table);
    if (size < SIM_TABLE_HEAD || size > (int)table->size || t->tailPos > size) {
        spoilt = 1;
    } else {
        if (t->tailPos == 0)
            t->tailSum = 0xffffffffu;
        count = size - t->tailPos < TAIL_BYTES ? size - t->tailPos : TAIL_BYTES;
        t->tailSum = crcOf(table, t->tailPos, count, t->tailSum);
        t->tailPos += count;
        if (t->tailPos == size) {
            t->tailPos = 0;
            spoilt = (t->tailSum ^ 0xffffffffu) != t->inUse;
        }
    }
    if (!spoilt)
        return;
    simComplain(t->name, "the table of pointers in use is spoilt: there is none now");
    t->active = -1;
    t->inUse = 0;
    t->state = simMapNone;
    t->error = 0;
    clearData(t);
}

/* An on-delay, as TON has it: it begins with the first cycle without a part. */
static int isLate(simTables *t, const simTablesInputs *in)
{
    if (t->state != simMapLoading || in->table) {
        t->pause = -1;
        return 0;
    }
    if (t->pause < 0)
        t->pause = in->now;
    return in->now - t->pause >= PART_PAUSE;
}

void simTablesStep(simTables *t, const simTablesInputs *in)
{
    int late = isLate(t, in);

    if (t->active < 0)
        t->inUse = 0;
    interrupt(t, in, late);
    if (in->table)
        refuse(t, command(t, in));
    else if (t->state == simMapChecking)
        refuse(t, check(t));
    watchTail(t);
    keep(t);
}

void simTablesRestart(simTables *t)
{
    const simBlock *table;

    if (!t->rows)
        return;
    recall(t);
    table = t->active < 0 ? NULL : t->table[t->active];
    if (!table || !rowsFit(t, table) || crcOfAll(table) != t->inUse)
        t->active = -1;
    if (t->active < 0)
        t->inUse = 0;
    t->state = idle(t);
    t->error = t->row = t->expected = t->session = t->tailPos = 0;
    t->pause = -1;
    keep(t);
}

void simTablesPreload(simTables *t, const epicsUInt8 *bytes, size_t size)
{
    memcpy(t->table[0]->bytes, bytes, size);
    t->active = 0;
    t->inUse = crcOfAll(t->table[0]);
    simPutInt(t->table[0]->bytes + 6, 4, 1, t->inUse);
    t->state = simMapActive;
    keep(t);
}

int simTablesReady(const simTables *t)
{
    return t->active >= 0 && !isBusy(t);
}

size_t simTablesRows(const simTables *t, int isTx)
{
    const simBlock *table = t->active < 0 ? NULL : t->table[t->active];

    return table ? (size_t)(isTx ? simTableRowsTx(table) : simTableRowsRx(table)) : 0;
}

epicsUInt8 *simTablesRow(const simTables *t, int isTx, size_t row)
{
    const simBlock *table = t->table[t->active];

    return table->bytes + SIM_TABLE_HEAD +
           (row + (isTx ? 0 : (size_t)simTableRowsTx(table))) * SIM_TABLE_ROW;
}

unsigned simTablesLayout(const simTables *t)
{
    return t->active < 0 ? 0 : (unsigned)simGetInt(t->table[t->active]->bytes, 2, 1);
}

void simTablesPack(const simTables *t)
{
    epicsUInt8 *tx = t->tx->bytes;
    int big = t->memory->bigEndian;

    tx[4] = 1;
    tx[5] = (epicsUInt8)t->state;
    tx[6] = (epicsUInt8)t->error;
    tx[7] = (epicsUInt8)t->row;
    simPutInt(tx + 8, 4, big, t->inUse);
    simPutInt(tx + 12, 2, big, (epicsUInt64)t->expected);
    tx[14] = (epicsUInt8)t->session;
    tx[15] = (epicsUInt8)(t->allow ? t->rows / 8 : 0);
}

void simTablesStatus(const simTables *t, simText *out)
{
    static const char *const states[] = {"none", "loading", "checking", "active",
                                         "refused"};

    simTextAdd(out,
               "map: %s, error %d, row %d, CRC 0x%08x, session %d, %s; %u loaded, %u "
               "refused\n",
               states[t->state], t->error, t->row, (unsigned)t->inUse, t->session,
               t->allow ? "allowed" : "locked", t->loads, t->refusals);
}
