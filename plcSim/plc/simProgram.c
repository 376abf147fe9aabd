/* simProgram: the program in the PLC that talks to EPICS: IE_COMMS, CHECKSYNC, PACK_TX_DB
 * and UNPACK_RX_DB, named as in the paper of the Canadian Light Source. It works on PLC
 * memory and knows nothing of sockets, files or consoles.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <cantProceed.h>

#include "simProgram.h"

#define PAIR (2 * SIM_ANY)
#define SPARE_PAIRS 8 /* free places in a pointer table */

/* ---- ANY pointers ---- */

static const struct anyType {
    const char *name;
    epicsUInt8 code;
    size_t bits; /* of one element */
} anyTypes[] = {
    {"BOOL",          0x01, 1 },
    {"BYTE",          0x02, 8 },
    {"CHAR",          0x03, 8 },
    {"WORD",          0x04, 16},
    {"INT",           0x05, 16},
    {"DWORD",         0x06, 32},
    {"DINT",          0x07, 32},
    {"REAL",          0x08, 32},
    {"DATE",          0x09, 16},
    {"TIME_OF_DAY",   0x0a, 32},
    {"TIME",          0x0b, 32},
    {"S5TIME",        0x0c, 16},
    {"DATE_AND_TIME", 0x0e, 64},
};

#define ANY_TYPES (sizeof(anyTypes) / sizeof(anyTypes[0]))

static const struct anyType *anyType(epicsUInt8 code)
{
    size_t i;

    for (i = 0; i < ANY_TYPES; i++)
        if (anyTypes[i].code == code)
            return &anyTypes[i];
    return NULL;
}

size_t simAnySize(const simAny *any)
{
    const struct anyType *type = anyType(any->type);

    return type ? (type->bits * any->count + 7) / 8 : 0;
}

void simAnyEncode(const simAny *any, epicsUInt8 bytes[SIM_ANY])
{
    bytes[0] = 0x10;
    bytes[1] = any->type;
    simPutInt(bytes + 2, 2, 1, any->count);
    simPutInt(bytes + 4, 2, 1, any->db);
    simPutInt(bytes + 6, 4, 1, (epicsUInt32)any->area << 24 | any->bit);
}

void simAnyDecode(const epicsUInt8 bytes[SIM_ANY], simAny *any)
{
    epicsUInt32 pointer = (epicsUInt32)simGetInt(bytes + 6, 4, 1);

    any->type = bytes[1];
    any->count = (epicsUInt16)simGetInt(bytes + 2, 2, 1);
    any->db = (epicsUInt16)simGetInt(bytes + 4, 2, 1);
    any->area = (epicsUInt8)(pointer >> 24);
    any->bit = pointer & 0xffffff;
}

/* "DB2.DBX4.0", "M4.0", "I4.0", "Q4.0" */
static int anyAddress(const char *text, simAny *any)
{
    static const struct {
        const char *format;
        epicsUInt8 area;
    } forms[] = {
        {"%*1[Mm]%u.%u%c", SIM_AREA_M},
        {"%*1[Ii]%u.%u%c", SIM_AREA_I},
        {"%*1[Qq]%u.%u%c", SIM_AREA_Q},
    };
    unsigned db, byte, bit;
    char rest;
    size_t i;

    if (strlen(text) > 24)
        return -1;
    if (sscanf(text, "%*1[Dd]%*1[Bb]%5u.%*1[Dd]%*1[Bb]%*1[Xx]%5u.%1u%c", &db, &byte, &bit,
               &rest) == 3) {
        any->area = SIM_AREA_DB;
    } else {
        db = 0;
        for (i = 0; i < sizeof(forms) / sizeof(forms[0]); i++)
            if (sscanf(text, forms[i].format, &byte, &bit, &rest) == 2)
                break;
        if (i == sizeof(forms) / sizeof(forms[0]))
            return -1;
        any->area = forms[i].area;
    }
    if (db > 65535 || byte > 65535 || bit > 7)
        return -1;
    any->db = (epicsUInt16)db;
    any->bit = byte * 8 + bit;
    return 0;
}

int simAnyParse(char **words, simAny *any, char error[SIM_ERROR_SIZE])
{
    unsigned long count;
    char *end;
    size_t i;

    memset(any, 0, sizeof(*any));
    if (strncasecmp(words[0], "P#", 2) || anyAddress(words[0] + 2, any))
        return simFail(error,
                       "\"%.40s\" is no pointer: it looks like P#DB2.DBX4.0 BYTE 34",
                       words[0]);
    for (i = 0; i < ANY_TYPES && strcasecmp(words[1], anyTypes[i].name); i++)
        ;
    if (i == ANY_TYPES)
        return simFail(error, "\"%.40s\" is no type of an ANY pointer", words[1]);
    any->type = anyTypes[i].code;
    errno = 0;
    count = strtoul(words[2], &end, 10);
    if (!isdigit((unsigned char)words[2][0]) || *end || errno || count < 1 ||
        count > 65535)
        return simFail(error, "\"%.40s\": the length of a pointer is 1 ... 65535",
                       words[2]);
    any->count = (epicsUInt16)count;
    return 0;
}

/* Finds the bytes of a pointer. Returns 0, or the low byte of the error code that a CPU's
 * BLKMOV gives: 01 syntax, 22 length, 24 area, 28 alignment, 3A no such data block. */
static unsigned anyBytes(const simMemory *memory, const epicsUInt8 *bytes,
                         epicsUInt8 **target, size_t *size)
{
    simAny any;
    simBlock *block;

    simAnyDecode(bytes, &any);
    *size = simAnySize(&any);
    if (bytes[0] != 0x10 || !*size)
        return 0x01;
    if (any.area != SIM_AREA_DB && any.area != SIM_AREA_M && any.area != SIM_AREA_I &&
        any.area != SIM_AREA_Q)
        return 0x24;
    if (any.bit % 8 || (any.type == 0x01 && any.count % 8))
        return 0x28;
    block = simMemoryFind(memory, any.area, any.area == SIM_AREA_DB ? any.db : 0);
    if (!block)
        return 0x3a;
    if (any.bit / 8 > block->size || *size > block->size - any.bit / 8)
        return 0x22;
    *target = block->bytes + any.bit / 8;
    return 0;
}

static const char *retValText(unsigned code)
{
    static const struct {
        unsigned code;
        const char *text;
    } texts[] = {
        {0x01, "no valid ANY pointer"       },
        {0x22, "beyond the end of the block"},
        {0x23, "lengths differ"             },
        {0x24, "wrong area"                 },
        {0x28, "not on a byte boundary"     },
        {0x3a, "no such data block"         },
    };
    size_t i = 0;

    while (i + 1 < sizeof(texts) / sizeof(texts[0]) && texts[i].code != (code & 0xff))
        i++;
    return texts[i].text;
}

/* ---- transfers ---- */

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

    code = anyBytes(program->memory, pair, &m->from, &m->size);
    if (code)
        return 0x8100 | code;
    code = anyBytes(program->memory, pair + SIM_ANY, &m->to, &toSize);
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
            (retVal & 0xf00) == 0x100 ? "source" : "destination", retValText(retVal));
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

int simProgramTransfer(simProgram *program, int isTx, char **words, size_t count,
                       char error[SIM_ERROR_SIZE])
{
    simTransfers *t = isTx ? &program->pack : &program->unpack;
    simBlock *wire = isTx ? program->tx : program->rx;
    simAssign a;
    size_t i;

    if (!wire)
        return simFail(error, "there is no %s: it has 0 bytes", isTx ? "IE_TX" : "IE_RX");
    for (i = 0; i < count; i++)
        if (isPointer(words[i]))
            return pointerTransfer(program, isTx, words, count, error);
    if (count != 3 || strcmp(words[1], "->"))
        return simFail(error, "a transfer wants: <from> -> <to>");
    if (simPlaceParse(program->memory, words[0], wire, &a.from, error) ||
        simPlaceParse(program->memory, words[2], wire, &a.to, error) ||
        matchWidths(&a.from, &a.to, error))
        return -1;
    if ((isTx ? a.to.block : a.from.block) != wire)
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
                            (t->pairCount + SPARE_PAIRS) * PAIR, name);
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

void simProgramFillTables(simProgram *program)
{
    if (program->tables.rows) {
        preload(program);
        return;
    }
    fillTable(&program->pack);
    fillTable(&program->unpack);
}

int simProgramInit(simProgram *program, unsigned txPtrsDb, unsigned rxPtrsDb,
                   char error[SIM_ERROR_SIZE])
{
    size_t size = program->rx ? program->rx->size : 1;

    program->accepted = callocMustSucceed(1, size, "simProgramInit");
    program->remote = 1;
    if (program->sync && (!program->tx || program->tx->size < SIM_HEADER ||
                          !program->rx || program->rx->size < SIM_HEADER))
        return simFail(error, "with sync = on, in and out need %d bytes at least",
                       SIM_HEADER);
    if (program->tables.rows && !program->sync)
        return simFail(error, "map = on needs sync = on");
    if (program->tables.rows % 8)
        return simFail(error, "map_rows is a multiple of 8");
    if (program->pack.pairCount + program->unpack.pairCount > program->tables.rows &&
        program->tables.rows)
        return simFail(error, "more pairs of pointers than map_rows");
    if (makeTable(program, &program->pack, txPtrsDb, "DB_TX_PTRS", error) ||
        makeTable(program, &program->unpack, rxPtrsDb, "DB_RX_PTRS", error))
        return -1;
    simProgramFillTables(program);
    return 0;
}

static void freeTransfers(simTransfers *t)
{
    free(t->assigns);
    free(t->pairs);
}

void simProgramFree(simProgram *program)
{
    freeTransfers(&program->pack);
    freeTransfers(&program->unpack);
    simTablesFree(&program->tables);
    free(program->accepted);
}

/* ---- the four functions ---- */

int CHECKSYNC(simProgram *program, epicsUInt8 *setpoints)
{
    if (program->refuseSync) {
        strcpy(program->difference, "refused at the console");
        return 0;
    }
    return !forMoves(program, &program->unpack, compareMove, setpoints);
}

static void packHeader(simProgram *program)
{
    epicsUInt8 *tx = program->tx->bytes;

    if (!program->counterFrozen)
        program->counter++;
    tx[0] = (epicsUInt8)((program->synced ? SIM_TX_SYNC : 0) |
                         (program->remote ? SIM_TX_REMOTE : 0) |
                         (program->timedOut ? SIM_TX_TIMEOUT : 0));
    tx[1] = program->counter;
    simPutInt(tx + 2, 2, program->memory->bigEndian, program->layout);
    if (program->tables.rows) {
        tx[0] |= SIM_TX_MAP;
        simTablesPack(&program->tables);
    }
}

void PACK_TX_DB(simProgram *program)
{
    forMoves(program, &program->pack, copyMove, NULL);
    if (program->sync)
        packHeader(program);
}

void UNPACK_RX_DB(simProgram *program)
{
    forMoves(program, &program->unpack, copyMove, NULL);
    memcpy(program->accepted, program->rx->bytes, program->rx->size);
    program->counts.unpacked++;
}

/* The one place where SYNC changes. */
static void setSync(simProgram *program, int synced, const char *reason)
{
    if (program->synced == synced)
        return;
    program->synced = synced;
    if (synced) {
        program->counts.syncs++;
        program->timedOut = 0;
        program->difference[0] = 0;
    } else {
        program->counts.syncsLost++;
    }
    simLog(program->name, "%s: %s", synced ? "SYNC" : "SYNC falls", reason);
}

static void interfere(simProgram *program, simPoint point)
{
    if (program->interfere)
        program->interfere(program->arg, point);
}

/* Layouts are compared when both sides have one. */
static int layoutDiffers(simProgram *program)
{
    unsigned theirs =
        (unsigned)simGetInt(program->rx->bytes + 2, 2, program->memory->bigEndian);
    int wrong = program->layout && theirs && theirs != program->layout;

    if (wrong && !program->layoutWrong)
        simComplain(program->name, "layout of the IOC is 0x%04x, of the PLC 0x%04x",
                    theirs, program->layout);
    program->layoutWrong = wrong;
    program->counts.layoutErrors += (epicsUInt64)wrong;
    return wrong;
}

/* In each cycle: SYNC stands only in REMOTE, and while the setpoints are those that were
 * last accepted. Whoever else moves one ends it, so that no block with the old value can
 * undo that. */
static void watchSetpoints(simProgram *program)
{
    if (!program->sync || !program->synced)
        return;
    if (!program->remote)
        setSync(program, 0, "LOCAL");
    else if (!CHECKSYNC(program, program->accepted))
        setSync(program, 0, "a setpoint was moved in the PLC");
}

static void check(simProgram *program)
{
    char last[sizeof(program->difference)];

    strcpy(last, program->difference);
    program->counts.checks++;
    if (CHECKSYNC(program, program->rx->bytes)) {
        memcpy(program->accepted, program->rx->bytes, program->rx->size);
        interfere(program, pointCheck);
        setSync(program, 1, "the IOC holds the PLC's values");
        return;
    }
    program->counts.checksFailed++;
    if (strcmp(last, program->difference))
        simLog(program->name, "CHECKSYNC: %s", program->difference);
    setSync(program, 0, "the IOC asked for a check that failed");
}

static void receive(simProgram *program, const epicsUInt8 *block)
{
    epicsUInt8 flags = block[0];

    if (program->tables.rows && !simTablesReady(&program->tables))
        return;
    if (!program->sync) {
        if (program->remote)
            UNPACK_RX_DB(program);
        return;
    }
    interfere(program, pointReceive);
    watchSetpoints(program);
    if (layoutDiffers(program))
        setSync(program, 0, "layouts differ");
    else if (flags & SIM_RX_CHECK && program->remote)
        check(program);
    else if (flags & SIM_RX_DATA && program->synced)
        UNPACK_RX_DB(program);
    else if (flags & SIM_RX_DATA)
        program->counts.ignored++;
}

static void takeInputs(simProgram *program, const simInputs *in)
{
    program->remote = in->remote;
    if (in->connected == program->connected)
        return;
    program->connected = in->connected;
    program->lastBlock = in->now;
    setSync(program, 0, in->connected ? "a new connection" : "the connection is gone");
}

static void watch(simProgram *program, double now)
{
    if (!program->sync || program->watchdog <= 0 || !program->connected ||
        now - program->lastBlock < program->watchdog)
        return;
    if (!program->timedOut) {
        program->counts.watchdogs++;
        simLog(program->name, "RECEIVE watchdog: no block from the IOC for %g s",
               program->watchdog);
    }
    setSync(program, 0, "RECEIVE watchdog");
    program->timedOut = 1;
}

/* The tables, before anything that needs them. Returns 1 when the block was for them. */
static int loadTables(simProgram *program, const simInputs *inputs, int reset)
{
    simTablesInputs in = {inputs->now, 0, reset, inputs->remote};

    if (!program->tables.rows || inputs->passive)
        return 0;
    in.table = inputs->received && inputs->received[0] & SIM_RX_TABLE;
    simTablesStep(&program->tables, &in);
    program->layout = simTablesLayout(&program->tables);
    if (!simTablesReady(&program->tables))
        setSync(program, 0, "the table of pointers is not ready");
    return in.table;
}

void IE_COMMS(simProgram *program, const simInputs *inputs)
{
    int edge = inputs->connected != program->connected, taken;

    takeInputs(program, inputs);
    if (inputs->received && program->rx) {
        program->lastBlock = inputs->now;
        memcpy(program->rx->bytes, inputs->received, program->rx->size);
    }
    taken = loadTables(program, inputs, edge);
    if (inputs->received && program->rx && !taken)
        receive(program, inputs->received);
    watch(program, inputs->now);
    watchSetpoints(program);
    if (inputs->send && program->tx)
        PACK_TX_DB(program);
}

void simProgramRestart(simProgram *program)
{
    setSync(program, 0, "PLC restart");
    program->timedOut = 0;
    program->connected = 0;
    program->counter = 0;
    program->layoutWrong = 0;
    program->difference[0] = 0;
    simTablesRestart(&program->tables);
}

void simProgramStatus(const simProgram *program, simText *out)
{
    const simProgramCounts *n = &program->counts;

    if (program->pack.table || program->unpack.table)
        simTextAdd(out, "pointers: %s, %llu errors\n",
                   program->pack.retVal || program->unpack.retVal ? "bad" : "good",
                   (unsigned long long)n->pointerErrors);
    if (!program->sync)
        return;
    if (program->tables.rows)
        simTablesStatus(&program->tables, out);
    simTextAdd(out, "sync: %s%s%s\n", program->synced ? "SYNC" : "none",
               program->timedOut ? ", TIMEOUT" : "",
               program->layoutWrong ? ", layouts differ" : "");
    simTextAdd(out,
               "checks: %llu, %llu failed; syncs: %llu, %llu lost; watchdogs: %llu; "
               "layout errors: %llu\n",
               (unsigned long long)n->checks, (unsigned long long)n->checksFailed,
               (unsigned long long)n->syncs, (unsigned long long)n->syncsLost,
               (unsigned long long)n->watchdogs, (unsigned long long)n->layoutErrors);
    simTextAdd(out, "taken: %llu blocks, %llu ignored\n", (unsigned long long)n->unpacked,
               (unsigned long long)n->ignored);
    if (program->difference[0])
        simTextAdd(out, "CHECKSYNC: %s\n", program->difference);
}
