/* Tables of pointers, IOC side: the step function by a table of events, and an exhaustive
 * walk over every order of events between an IOC and a PLC, whose rules are those of plcSim
 * (simTables).
 *
 * The walk has two IOCs with different good tables, one with a table that reaches for
 * forbidden memory, breaks, restarts, LOCAL, the key switch and silence. After each step:
 * the table in use is one that was brought whole and is good, byte for byte; and from every
 * state the PLC comes to work with the IOC's good table once faults stop.
 */
#include <stdlib.h>
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "pointersText.h"
#include "plcSync.h"
#include "plcTables.h"
#include "simTables.h"

#define IN 48
#define OUT 32

/* --- Single events ----------------------------------------------------------------------*/

static const epicsUInt8 *ours;
static size_t ourSize;

/* What the PLC shows: flags, version, state, error, row, our CRC?, expected, session, rows/8 */
typedef struct shown {
    int flags, version, state, error, row, same, expected, session, rows;
} shown;

static void statusBlock(epicsUInt8 *b, const shown *s)
{
    epicsUInt32 crc = plcPointersCrc(ours, ourSize);

    memset(b, 0, IN);
    b[0] = (epicsUInt8)s->flags;
    b[4] = (epicsUInt8)s->version;
    b[5] = (epicsUInt8)s->state;
    b[6] = (epicsUInt8)s->error;
    b[7] = (epicsUInt8)s->row;
    if (!s->same)
        crc ^= 1;
    b[8] = (epicsUInt8)(crc >> 24);
    b[9] = (epicsUInt8)(crc >> 16);
    b[10] = (epicsUInt8)(crc >> 8);
    b[11] = (epicsUInt8)crc;
    b[13] = (epicsUInt8)s->expected;
    b[14] = (epicsUInt8)s->session;
    b[15] = (epicsUInt8)s->rows;
}

/* A download of 70 bytes in parts of 20: session 6, `done` bytes are there. */
static const struct {
    const char *title;
    int mode, before, done;
    shown plc;
    int good, after, command;
    const char *reason;
} events[] = {
    /* clang-format off */
    {"a PLC without tables has its own",     plcMapDownload, plcTablesWaiting, 0, {2, 0, 0, 0, 0, 0, 0, 0, 0}, 1, plcTablesFixed, 0, ""},
    {"check: so it has",                     plcMapCheck, plcTablesWaiting, 0, {2, 0, 0, 0, 0, 0, 0, 0, 0}, 1, plcTablesFixed, 0, ""},
    {"the same table",                       plcMapDownload, plcTablesWaiting, 0, {10, 1, 3, 0, 0, 1, 0, 5, 4}, 1, plcTablesEqual, 0, ""},
    {"the same table, in LOCAL and locked",  plcMapCheck, plcTablesWaiting, 0, {8, 1, 3, 0, 0, 1, 0, 5, 0}, 1, plcTablesEqual, 0, ""},
    {"the same while another one was refused", plcMapDownload, plcTablesWaiting, 0, {10, 1, 4, 5, 2, 1, 0, 5, 4}, 1, plcTablesEqual, 0, ""},
    {"the CRC of a PLC without a table counts for nothing", plcMapCheck, plcTablesWaiting, 0, {10, 1, 0, 0, 0, 1, 0, 5, 4}, 0, plcTablesMismatch, 0, "the PLC has another table"},
    {"check: another table",                 plcMapCheck, plcTablesWaiting, 0, {10, 1, 3, 0, 0, 0, 0, 5, 4}, 0, plcTablesMismatch, 0, "the PLC has another table"},
    {"another version is left alone",        plcMapDownload, plcTablesWaiting, 0, {10, 2, 3, 0, 0, 0, 0, 5, 4}, 0, plcTablesMismatch, 0, "tables of version 2, known: 1"},
    {"another table: BEGIN",                 plcMapDownload, plcTablesWaiting, 0, {10, 1, 3, 0, 0, 0, 0, 5, 4}, 0, plcTablesBeginning, plcTablesBegin, "table is being downloaded"},
    {"no table at all: BEGIN",               plcMapDownload, plcTablesWaiting, 0, {10, 1, 0, 0, 0, 0, 0, 5, 4}, 0, plcTablesBeginning, plcTablesBegin, "table is being downloaded"},
    {"another one in LOCAL: waits",          plcMapDownload, plcTablesWaiting, 0, {8, 1, 3, 0, 0, 0, 0, 5, 4}, 0, plcTablesMismatch, 0, "another table; PLC in LOCAL"},
    {"another one, locked: waits",           plcMapDownload, plcTablesWaiting, 0, {10, 1, 3, 0, 0, 0, 0, 5, 0}, 0, plcTablesMismatch, 0, "another table; the PLC's are locked"},
    {"too many rows for the PLC",            plcMapDownload, plcTablesWaiting, 0, {10, 1, 3, 0, 0, 0, 0, 5, -1}, 0, plcTablesMismatch, 0, "table of 3 rows, the PLC has 0"},
    {"LOCAL is over: BEGIN",                 plcMapDownload, plcTablesMismatch, 0, {10, 1, 3, 0, 0, 0, 0, 5, 4}, 0, plcTablesBeginning, plcTablesBegin, "table is being downloaded"},
    {"BEGIN is not there yet",               plcMapDownload, plcTablesBeginning, 0, {10, 1, 3, 0, 0, 0, 0, 5, 4}, 0, plcTablesBeginning, 0, "x"},
    {"BEGIN is taken: the first part",       plcMapDownload, plcTablesBeginning, 0, {10, 1, 1, 0, 0, 0, 0, 6, 4}, 0, plcTablesLoading, plcTablesPart, "x"},
    {"BEGIN is refused",                     plcMapDownload, plcTablesBeginning, 0, {10, 1, 4, 26, 0, 0, 0, 6, 0}, 0, plcTablesRefused, 0, "the PLC's tables are locked"},
    {"the part is not there yet",            plcMapDownload, plcTablesLoading, 20, {10, 1, 1, 0, 0, 0, 20, 6, 4}, 0, plcTablesLoading, 0, "x"},
    {"the part is there: the next one",      plcMapDownload, plcTablesLoading, 20, {10, 1, 1, 0, 0, 0, 40, 6, 4}, 0, plcTablesLoading, plcTablesPart, "x"},
    {"the last part is there: COMMIT",       plcMapDownload, plcTablesLoading, 60, {10, 1, 1, 0, 0, 0, 70, 6, 4}, 0, plcTablesCommitting, plcTablesCommit, "x"},
    {"a part went astray: anew",             plcMapDownload, plcTablesLoading, 20, {10, 1, 1, 0, 0, 0, 33, 6, 4}, 0, plcTablesBeginning, plcTablesBegin, "table is being downloaded"},
    {"it waits for the first part again: anew", plcMapDownload, plcTablesLoading, 20, {10, 1, 1, 0, 0, 0, 0, 6, 4}, 0, plcTablesBeginning, plcTablesBegin, "table is being downloaded"},
    {"a part is refused",                    plcMapDownload, plcTablesLoading, 20, {10, 1, 4, 21, 0, 0, 20, 6, 4}, 0, plcTablesRefused, 0, "a part is missing"},
    {"a part is refused for a reason that is not known", plcMapDownload, plcTablesLoading, 20, {10, 1, 4, 77, 0, 0, 20, 6, 4}, 0, plcTablesRefused, 0, "unknown error"},
    {"COMMIT came when it had dropped it: anew", plcMapDownload, plcTablesCommitting, 70, {10, 1, 4, 20, 0, 0, 70, 6, 4}, 0, plcTablesBeginning, plcTablesBegin, "table is being downloaded"},
    {"the same, and it is locked: waits",    plcMapDownload, plcTablesCommitting, 70, {10, 1, 4, 20, 0, 0, 70, 6, 0}, 0, plcTablesMismatch, 0, "another table; the PLC's are locked"},
    {"another one's session: anew",          plcMapDownload, plcTablesLoading, 20, {10, 1, 1, 0, 0, 0, 0, 9, 4}, 0, plcTablesBeginning, plcTablesBegin, "table is being downloaded"},
    {"the PLC has dropped it: anew",         plcMapDownload, plcTablesLoading, 20, {10, 1, 3, 29, 0, 0, 20, 6, 4}, 0, plcTablesBeginning, plcTablesBegin, "table is being downloaded"},
    {"LOCAL in the middle: waits",           plcMapDownload, plcTablesLoading, 20, {8, 1, 3, 27, 0, 0, 20, 6, 4}, 0, plcTablesMismatch, 0, "another table; PLC in LOCAL"},
    {"locked in the middle: waits",          plcMapDownload, plcTablesLoading, 20, {10, 1, 3, 26, 0, 0, 20, 6, 0}, 0, plcTablesMismatch, 0, "another table; the PLC's are locked"},
    {"COMMIT is not there yet",              plcMapDownload, plcTablesCommitting, 70, {10, 1, 1, 0, 0, 0, 70, 6, 4}, 0, plcTablesCommitting, 0, "x"},
    {"the PLC checks",                       plcMapDownload, plcTablesCommitting, 70, {10, 1, 2, 0, 1, 0, 70, 6, 4}, 0, plcTablesCommitting, 0, "x"},
    {"the PLC works with it",                plcMapDownload, plcTablesCommitting, 70, {10, 1, 3, 0, 0, 1, 70, 6, 4}, 1, plcTablesEqual, 0, ""},
    {"a row is refused",                     plcMapDownload, plcTablesCommitting, 70, {10, 1, 4, 5, 2, 0, 70, 6, 4}, 0, plcTablesRefused, 0, "row 2: memory that the PLC does not allow"},
    {"refused is refused",                   plcMapDownload, plcTablesRefused, 0, {10, 1, 4, 5, 2, 0, 70, 6, 4}, 0, plcTablesRefused, 0, "x"},
    {"refused because of LOCAL: again",      plcMapDownload, plcTablesRefused, 0, {10, 1, 4, 27, 0, 0, 0, 6, 4}, 0, plcTablesBeginning, plcTablesBegin, "table is being downloaded"},
    {"refused because of the key switch: again", plcMapDownload, plcTablesRefused, 0, {10, 1, 4, 26, 0, 0, 0, 6, 4}, 0, plcTablesBeginning, plcTablesBegin, "table is being downloaded"},
    {"refused, and it has the table after all", plcMapDownload, plcTablesRefused, 0, {10, 1, 3, 0, 0, 1, 0, 6, 4}, 1, plcTablesEqual, 0, ""},
    {"the table is lost again: BEGIN",       plcMapDownload, plcTablesEqual, 0, {10, 1, 0, 0, 0, 0, 0, 6, 4}, 0, plcTablesBeginning, plcTablesBegin, "table is being downloaded"},
    {"a disconnected one minds nothing",     plcMapDownload, plcTablesDisconnected, 0, {10, 1, 0, 0, 0, 0, 0, 6, 4}, 1, plcTablesDisconnected, 0, "x"},
    {"without the option nothing is looked at", plcMapOff, plcTablesWaiting, 0, {10, 9, 0, 0, 0, 0, 0, 6, 4}, 1, plcTablesWaiting, 0, "x"},
    /* clang-format on */
};

#define EVENTS (sizeof(events) / sizeof(events[0]))

static void singleEvents(void)
{
    epicsUInt8 block[IN];
    size_t i;

    for (i = 0; i < EVENTS; i++) {
        shown s = events[i].plc;
        plcTables t;
        int good, same;

        plcTablesInit(&t, events[i].mode, ours, ourSize, OUT);
        t.state = events[i].before;
        t.done = (unsigned)events[i].done;
        t.length = events[i].before == plcTablesCommitting ? 0 : events[i].done == 60 ? 10 : 20;
        t.session = 6;
        t.plc.error = s.error;
        strcpy(t.reason, "x");
        if (s.rows < 0)
            s.rows = 0, t.size = 0;
        statusBlock(block, &s);
        if (events[i].plc.rows < 0) /* fewer rows than the table has, but not none */
            block[15] = 1, t.size = PLC_TABLE_HEAD + 9 * PLC_TABLE_ROW;
        same = plcTablesSame(&t, block, 1);
        good = plcTablesBlock(&t, block, 1);
        testOk(good == events[i].good &&
                   (same == good || events[i].before == plcTablesDisconnected) && (int)t.state == events[i].after &&
                   t.command == events[i].command &&
                   !strcmp(t.reason, events[i].plc.rows < 0 ? "table of 9 rows, the PLC has 8" : events[i].reason),
               "%s%s%s", events[i].title, t.reason[1] ? ": " : "",
               t.reason[1] ? t.reason : "");
    }
}

static void blocks(void)
{
    epicsUInt8 b[OUT], expected[OUT];
    plcTables t;
    int flags, i;

    plcTablesInit(&t, plcMapDownload, ours, ourSize, OUT);
    t.state = plcTablesLoading;
    t.session = 0x33;
    t.done = 60;
    t.length = 10;
    for (i = 0; i < 2; i++) {
        memset(b, 0xee, sizeof(b));
        memset(expected, 0, sizeof(expected));
        memset(expected, 0xee, 4);
        memcpy(expected + 4, i ? "\x02\x33\x00\x3c\x00\x0a\0\0" : "\x02\x33\x3c\x00\x0a\x00\0\0",
               8);
        memcpy(expected + 12, ours + 60, 10);
        t.command = plcTablesPart;
        flags = plcTablesPack(&t, b, i);
        testOk(flags == plcFlagTable && !t.command && memcmp(b, expected, OUT) == 0,
               "a part, %s endian", i ? "big" : "little");
    }
    testOk(plcTablesPack(&t, b, 1) == 0 && memcmp(b + 4, "\x02\x33", 2) == 0,
           "nothing is packed twice");
    t.command = plcTablesCommit;
    plcTablesPack(&t, b, 1);
    memset(expected + 4, 0, OUT - 4);
    memcpy(expected + 4, "\x03\x33", 2);
    memcpy(expected + 12, ours + 6, 4);
    testOk(memcmp(b, expected, OUT) == 0, "COMMIT with the CRC");
    t.state = plcTablesLoading;
    testOk(plcTablesProgress(&t) == 60 * 99 / 70, "progress in %%");
    t.state = plcTablesEqual;
    testOk(plcTablesProgress(&t) == 100, "100 %% when the PLC works with it");
    plcTablesLost(&t);
    testOk(plcTablesProgress(&t) == 0 && !t.command &&
               !strcmp(t.reason, "PLC not connected"), "nothing is left of it when lost");
}

/* A PLC that does not answer: begun anew, then given up with ABORT, until it connects. */
static void noAnswer(void)
{
    shown s = {10, 1, 3, 0, 0, 0, 0, 5, 4};
    epicsUInt8 in[IN], out[OUT];
    int begins = 0, aborts = 0, i;
    plcTables t;

    plcTablesInit(&t, plcMapDownload, ours, ourSize, OUT);
    plcTablesConnected(&t);
    statusBlock(in, &s);
    for (i = 0; i < 1000; i++) {
        plcTablesBlock(&t, in, 1);
        begins += t.command == plcTablesBegin;
        aborts += t.command == plcTablesAbort;
        plcTablesPack(&t, out, 1);
    }
    testOk(begins == 3 && aborts == 1 && t.state == plcTablesMismatch &&
               !strcmp(t.reason, "the download does not end"),
           "a PLC that does not answer is asked three times");
    plcTablesConnected(&t);
    plcTablesBlock(&t, in, 1);
    testOk(t.command == plcTablesBegin, "and again on the next connection");
    for (i = 0; i < 10; i++) {
        in[0] ^= plcFlagRemote;
        plcTablesBlock(&t, in, 1);
    }
    testOk(t.command == plcTablesBegin, "LOCAL in between counts for nothing");
    s.same = 1;
    statusBlock(in, &s);
    plcTablesBlock(&t, in, 1);
    s.same = 0;
    statusBlock(in, &s);
    begins = 0;
    for (i = 0; i < 1000; i++) {
        plcTablesBlock(&t, in, 1);
        begins += t.command == plcTablesBegin;
        plcTablesPack(&t, out, 1);
    }
    testOk(begins == 3, "three times anew when it had the table and has lost it");
}

/* --- The walk ---------------------------------------------------------------------------*/

enum { TABLES = 3, ROOM = 2, ROWS = 8 };

/* Good, good, and one whose only row reaches for forbidden memory. */
static plcPointers *tables[TABLES];

typedef struct wire {
    int count;
    epicsUInt8 blocks[ROOM][IN];
} wire;

typedef struct world {
    simTables plc;
    epicsUInt8 memory[2][SIM_TABLE_HEAD + ROWS * SIM_TABLE_ROW];
    epicsUInt8 kept[32];
    plcTables ioc;
    int who; /* whose table the IOC has */
    int connected, remote;
    wire toIoc, toPlc;
} world;

static simMemory memory;
static simBlock *mapA, *mapB, *kept, *ieTx, *ieRx;

static void load(const world *w)
{
    memcpy(mapA->bytes, w->memory[0], sizeof(w->memory[0]));
    memcpy(mapB->bytes, w->memory[1], sizeof(w->memory[1]));
    memcpy(kept->bytes, w->kept, sizeof(w->kept));
}

static void save(world *w)
{
    memcpy(w->memory[0], mapA->bytes, sizeof(w->memory[0]));
    memcpy(w->memory[1], mapB->bytes, sizeof(w->memory[1]));
    memcpy(w->kept, kept->bytes, sizeof(w->kept));
    w->plc.loads = w->plc.refusals = 0; /* no part of the state of the walk */
}

static void push(wire *c, const epicsUInt8 *block, size_t size)
{
    memset(c->blocks[c->count], 0, IN);
    memcpy(c->blocks[c->count++], block, size);
}

static void pop(wire *c, epicsUInt8 *block)
{
    memcpy(block, c->blocks[0], IN);
    c->count--;
    memmove(c->blocks[0], c->blocks[1], sizeof(c->blocks[0]));
    memset(c->blocks[c->count], 0, IN);
}

static void cut(world *w)
{
    memset(&w->toIoc, 0, sizeof(w->toIoc));
    memset(&w->toPlc, 0, sizeof(w->toPlc));
    w->connected = 0;
    plcTablesLost(&w->ioc);
}

/* One cycle of the PLC, with a block or without. `late`: the silence lasts. */
static void cycle(world *w, const epicsUInt8 *block, int reset, int late)
{
    simTablesInputs in = {late ? 100 : 1, 0, reset, w->remote};

    load(w);
    if (block) {
        memcpy(ieRx->bytes, block, OUT);
        in.table = (block[0] & SIM_RX_TABLE) != 0;
    }
    if (late && w->plc.pause < 0)
        w->plc.pause = 1;
    simTablesStep(&w->plc, &in);
    if (w->plc.pause > 0)
        w->plc.pause = 1;
    save(w);
}

static void newIoc(world *w, int who)
{
    w->who = who;
    plcTablesInit(&w->ioc, plcMapDownload, tables[who]->bytes, tables[who]->size, OUT);
}

enum { actions = 13 };

static int act(world *w, int a)
{
    epicsUInt8 block[IN] = {0};

    switch (a) {
    case 0: /* the PLC sends */
        if (!w->connected || w->toIoc.count == ROOM)
            return 0;
        load(w);
        memset(ieTx->bytes, 0, IN);
        ieTx->bytes[0] = (epicsUInt8)(SIM_TX_MAP | (w->remote ? plcFlagRemote : 0));
        simTablesPack(&w->plc);
        push(&w->toIoc, ieTx->bytes, IN);
        return 1;
    case 1: /* the IOC takes a block */
        if (!w->toIoc.count)
            return 0;
        pop(&w->toIoc, block);
        plcTablesBlock(&w->ioc, block, 1);
        w->ioc.unchanged = 0; /* else it counts without end */
        return 1;
    case 2: /* the IOC sends */
        if (!w->connected || w->toPlc.count == ROOM || !w->ioc.command)
            return 0;
        block[0] = (epicsUInt8)plcTablesPack(&w->ioc, block, 1);
        push(&w->toPlc, block, OUT);
        return 1;
    case 3: /* the PLC takes a block */
        if (!w->toPlc.count)
            return 0;
        pop(&w->toPlc, block);
        cycle(w, block, 0, 0);
        return 1;
    case 4: /* the PLC works on */
        cycle(w, NULL, 0, 0);
        return 1;
    case 5: /* the connection breaks */
        if (!w->connected)
            return 0;
        cut(w);
        cycle(w, NULL, 1, 0);
        return 1;
    case 6: /* connected */
        if (w->connected)
            return 0;
        w->connected = 1;
        plcTablesConnected(&w->ioc);
        cycle(w, NULL, 1, 0);
        return 1;
    case 7: /* LOCAL <-> REMOTE */
        w->remote = !w->remote;
        cycle(w, NULL, 0, 0);
        return 1;
    case 8: /* the key switch */
        w->plc.allow = !w->plc.allow;
        cycle(w, NULL, 0, 0);
        return 1;
    case 9: /* the PLC restarts */
        cut(w);
        load(w);
        simTablesRestart(&w->plc);
        save(w);
        return 1;
    case 10: /* silence */
        if (w->plc.state != simMapLoading)
            return 0;
        cycle(w, NULL, 0, 1);
        return 1;
    default: /* another IOC takes over, with another table */
        cut(w);
        newIoc(w, (w->who + a - 10) % TABLES);
        cycle(w, NULL, 1, 0);
        return 1;
    }
}

/* The table in use is a good one, byte for byte, or there is none. */
static int intact(const world *w)
{
    const epicsUInt8 *bytes = w->memory[w->plc.active < 0 ? 0 : w->plc.active];
    int i;

    if (w->plc.active < 0)
        return w->plc.inUse == 0;
    for (i = 0; i < TABLES - 1; i++)
        if (w->plc.inUse == plcPointersCrc(tables[i]->bytes, tables[i]->size) &&
            memcmp(bytes, tables[i]->bytes, tables[i]->size) == 0)
            return 1;
    return 0;
}

/* The IOC with the bad table is never told that the PLC works with it. */
static int honest(const world *w)
{
    return w->ioc.state != plcTablesEqual ||
           (w->who < TABLES - 1 && w->ioc.plc.crc == w->ioc.crc);
}

/* Once faults stop: the PLC works with the IOC's table, or has refused the bad one. */
static int settles(world w)
{
    int round, good = w.who < TABLES - 1;

    w.remote = 1;
    w.plc.allow = 1;
    act(&w, 5);
    act(&w, 6);
    for (round = 0; round < 40; round++) {
        act(&w, 4);
        act(&w, 0);
        act(&w, 1);
        act(&w, 2);
        act(&w, 3);
    }
    return intact(&w) &&
           (good ? w.ioc.state == plcTablesEqual && w.plc.inUse == w.ioc.crc &&
                       plcTablesProgress(&w.ioc) == 100
                 : w.ioc.state == plcTablesRefused);
}

/* Hashes of the states seen: open addressing. */
static epicsUInt64 *seen;
static size_t capacity, stored;

static int isNew(const world *w)
{
    const unsigned char *p = (const unsigned char *)w;
    epicsUInt64 hash = 1469598103934665603u;
    size_t i;

    for (i = 0; i < sizeof(*w); i++)
        hash = (hash ^ p[i]) * 1099511628211u;
    hash += !hash;
    for (i = hash % capacity; seen[i]; i = (i + 1) % capacity)
        if (seen[i] == hash)
            return 0;
    if (stored * 2 > capacity)
        return 0;
    seen[i] = hash;
    stored++;
    return 1;
}

static void prepare(world *start)
{
    static const char *const files[TABLES] = {
        "layout 1\ntx P#DB10.DBX0.0 BYTE 4 -> 16\n",
        "layout 2\ntx P#DB10.DBX4.0 BYTE 4 -> 16\nrx 4 -> P#DB10.DBX4.0 BYTE 4\n",
        "layout 3\ntx P#DB12.DBX0.0 BYTE 4 -> 16\n"};
    char error[SIM_ERROR_SIZE], *words[] = {"write", "DB10"};
    int i;

    simMemoryInit(&memory, 1);
    memset(start, 0, sizeof(*start));
    ieTx = simMemoryAdd(&memory, SIM_AREA_DB, 1, IN, "IE_TX");
    ieRx = simMemoryAdd(&memory, SIM_AREA_DB, 2, OUT, "IE_RX");
    simMemoryAdd(&memory, SIM_AREA_DB, 10, 16, "");
    simMemoryAdd(&memory, SIM_AREA_DB, 12, 16, "");
    start->plc.name = "walk";
    start->plc.memory = &memory;
    start->plc.tx = ieTx;
    start->plc.rx = ieRx;
    start->plc.rows = ROWS;
    start->plc.allow = start->remote = 1;
    if (simTablesInit(&start->plc, 20, error) ||
        simTablesAllow(&start->plc, words, 2, error))
        testAbort("%s", error);
    mapA = start->plc.table[0];
    mapB = start->plc.table[1];
    kept = start->plc.kept;
    for (i = 0; i < TABLES; i++)
        if (!(tables[i] = read(files[i], error, sizeof(error))))
            testAbort("%s", error);
    newIoc(start, 0);
    simLogQuiet(2);
}

typedef struct walker {
    world *queue;
    size_t tail, most;
    size_t broken, lies, lost, equal;
} walker;

/* Everything that can happen to a state, once. */
static void visit(walker *v, const world *w)
{
    int a;

    for (a = 0; a < actions && v->tail < v->most; a++) {
        world next = *w;

        if (!act(&next, a) || !isNew(&next))
            continue;
        v->broken += !intact(&next);
        v->lies += !honest(&next);
        v->equal += next.ioc.state == plcTablesEqual;
        v->lost += !settles(next);
        v->queue[v->tail++] = next;
    }
}

/* The moments of two downloads without a fault, the second while the first table is in
 * use: from each of them the walk begins. */
static void moments(walker *v)
{
    static const int order[] = {4, 0, 1, 2, 3};
    world w;
    int i;

    prepare(&w);
    act(&w, 6);
    for (i = 0; i < 300; i++) {
        if (i == 150) {
            act(&w, 11); /* another IOC with another table */
            act(&w, 6);
        }
        if (act(&w, order[i % 5]) && isNew(&w))
            v->queue[v->tail++] = w;
    }
}

static void walk(int depth, size_t most)
{
    walker v = {NULL, 0, most, 0, 0, 0, 0};
    size_t head = 0, levelEnd, begin;
    int level;

    capacity = most * 2 + 2;
    seen = calloc(capacity, sizeof(*seen));
    v.queue = calloc(most + 1, sizeof(*v.queue));
    if (!seen || !v.queue)
        testAbort("no memory for the walk");
    moments(&v);
    begin = v.tail;
    for (level = 0; level < depth && head < v.tail; level++)
        for (levelEnd = v.tail; head < levelEnd; head++)
            visit(&v, &v.queue[head]);
    testDiag("%u states: all orders of %d events from %u moments of a download; in %u of "
             "them PLC and IOC have the same table", (unsigned)v.tail, level,
             (unsigned)begin, (unsigned)v.equal);
    testOk(v.tail < most && v.equal > 100,
           "the walk visits every state within its depth, and downloads end in many of them");
    testOk(v.broken == 0, "the table in use is always a whole good one, byte for byte");
    testOk(v.lies == 0, "the IOC never takes another table for its own");
    testOk(v.lost == 0, "from every state the PLC takes a good table and refuses a bad one "
           "once faults stop");
    simTablesFree(&v.queue[0].plc); /* the copies in all states share it */
    simMemoryFree(&memory);
    for (level = 0; level < TABLES; level++)
        plcPointersFree(tables[level]);
    free(seen);
    free(v.queue);
}

/* A table of 100 rows over blocks of 32 bytes: blocks of the PLC from BEGIN to use. */
static void arithmetic(void)
{
    char text[100 * 50 + 1] = "", error[SIM_ERROR_SIZE];
    char *words[] = {"read", "DB11"};
    simTables *plc = calloc(1, sizeof(*plc));
    simTablesInputs in = {1, 0, 0, 1};
    simBlock *tx = NULL, *rx = NULL;
    epicsUInt8 block[2048] = {0};
    plcPointers *table;
    unsigned count = 0, i, last = 0, falls = 0;
    plcTables ioc;

    for (i = 0; i < 100; i++)
        sprintf(text + strlen(text), "tx P#DB11.DBX%u.0 BYTE 2 -> %u\n", i * 2, 16 + i * 2);
    table = read(text, error, sizeof(error));
    simMemoryInit(&memory, 1);
    tx = simMemoryAdd(&memory, SIM_AREA_DB, 1, 240, "IE_TX");
    rx = simMemoryAdd(&memory, SIM_AREA_DB, 2, OUT, "IE_RX");
    simMemoryAdd(&memory, SIM_AREA_DB, 11, 200, "");
    plc->name = "rows";
    plc->memory = &memory;
    plc->tx = tx;
    plc->rx = rx;
    plc->rows = 104;
    plc->allow = 1;
    if (!table || simTablesInit(plc, 20, error) || simTablesAllow(plc, words, 2, error))
        testAbort("%s", error);
    plcTablesInit(&ioc, plcMapDownload, table->bytes, table->size, OUT);
    plcTablesConnected(&ioc);
    for (; count < 1000 && ioc.state != plcTablesEqual; count++) {
        tx->bytes[0] = SIM_TX_MAP | plcFlagRemote;
        simTablesPack(plc);
        plcTablesBlock(&ioc, tx->bytes, 1);
        falls += plcTablesProgress(&ioc) < (int)last;
        last = (unsigned)plcTablesProgress(&ioc);
        in.table = ioc.command;
        block[0] = (epicsUInt8)plcTablesPack(&ioc, block, 1);
        memcpy(rx->bytes, block, OUT);
        simTablesStep(plc, &in);
        in.table = 0;
        for (i = 0; i < 9; i++) /* ten cycles to a block: 10 ms and 100 ms */
            simTablesStep(plc, &in);
    }
    /* BEGIN, 2010 / 20 parts and COMMIT, one a block; 2010 / 64 cycles for the CRC, one a
     * row and one to begin with it, ten a block; and the block that shows it. */
    testOk(count == 1 + 101 + 1 + (32 + 100 + 1 + 9) / 10, "100 rows in %u blocks", count);
    testOk(falls == 0 && last == 100, "progress rises from 0 to 100 %%");
    simTablesFree(plc);
    free(plc);
    simMemoryFree(&memory);
    plcPointersFree(table);
}

/* What a PLC may say is wrong, in the words of docs/plc-tables.md; of what is below 20 with the row. */
static const struct {
    int error;
    const char *reason;
} wrongs[] = {
    {1, "row 2: no pointer to 1 to 1024 bytes"},
    {2, "row 2: area is neither DB nor M"},
    {3, "row 2: not on a byte boundary"},
    {4, "row 2: no such data block"},
    {5, "row 2: memory that the PLC does not allow"},
    {6, "row 2: beyond the end of the data block"},
    {7, "row 2: source and destination differ in length"},
    {8, "row 2: not in the data of IE_TX or IE_RX"},
    {9, "row 2: bytes that another row has too"},
    {10, "row 2: a setpoint that no TX row shows"},
    {21, "a part is missing"},
    {22, "a part is too long"},
    {23, "the table is incomplete"},
    {24, "the CRC is wrong"},
    {25, "unknown command"},
    {26, "the PLC's tables are locked"},
    {27, "PLC in LOCAL"},
    {28, "more rows than the PLC has"},
    {29, "no part for 5 s"},
};

#define WRONGS (sizeof(wrongs) / sizeof(wrongs[0]))

static void errorWords(void)
{
    epicsUInt8 block[IN];
    size_t i;

    for (i = 0; i < WRONGS; i++) {
        shown s = {10, 1, 4, wrongs[i].error, 2, 0, 20, 6, 4};
        plcTables t;

        plcTablesInit(&t, plcMapDownload, ours, ourSize, OUT);
        t.state = plcTablesLoading;
        t.session = 6;
        statusBlock(block, &s);
        plcTablesBlock(&t, block, 1);
        testOk(t.state == plcTablesRefused && strcmp(t.reason, wrongs[i].reason) == 0, "error %d: %s",
               wrongs[i].error, t.reason);
    }
}

/* Another session than the PLC has shown, and never 0. */
static void sessions(void)
{
    static const int rows[][2] = {{0, 1}, {5, 6}, {253, 254}, {254, 255}, {255, 1}};
    epicsUInt8 block[IN];
    size_t i;

    for (i = 0; i < 5; i++) {
        shown s = {10, 1, 3, 0, 0, 0, 0, rows[i][0], 4};
        plcTables t;

        plcTablesInit(&t, plcMapDownload, ours, ourSize, OUT);
        plcTablesConnected(&t);
        statusBlock(block, &s);
        plcTablesBlock(&t, block, 1);
        testOk(t.command == plcTablesBegin && t.session == rows[i][1], "behind session %d begins %d", rows[i][0],
               t.session);
    }
}

static void words(void)
{
    plcTables t;
    epicsUInt8 block[IN];
    shown s = {10, 1, 3, 0, 0, 0, 0, 5, 4};

    testOk(strcmp(plcTablesStateName(plcTablesDisconnected), "disconnected") == 0 &&
               strcmp(plcTablesStateName(plcTablesWaiting), "waiting") == 0 &&
               strcmp(plcTablesStateName(plcTablesFixed), "fixed tables") == 0 &&
               strcmp(plcTablesStateName(plcTablesEqual), "equal") == 0 &&
               strcmp(plcTablesStateName(plcTablesMismatch), "map mismatch") == 0 &&
               strcmp(plcTablesStateName(plcTablesBeginning), "beginning") == 0 &&
               strcmp(plcTablesStateName(plcTablesLoading), "loading") == 0 &&
               strcmp(plcTablesStateName(plcTablesCommitting), "PLC checks") == 0 &&
               strcmp(plcTablesStateName(plcTablesRefused), "refused") == 0 &&
               strcmp(plcTablesStateName(-1), "?") == 0 &&
               strcmp(plcTablesStateName(plcTablesRefused + 1), "?") == 0,
           "states have names, and no others have");
    plcTablesInit(&t, plcMapDownload, NULL, 0, 32);
    plcTablesConnected(&t);
    testOk(strcmp(t.reason, "no block yet") == 0, "connected: %s", t.reason);
    statusBlock(block, &s);
    testOk(!plcTablesBlock(&t, block, 1) && t.state == plcTablesMismatch &&
               strcmp(t.reason, "the IOC has no table: s7plcTables") == 0,
           "without a table of its own the IOC brings none: %s", t.reason);
}

MAIN(tablesTest)
{
    char error[300];
    plcPointers *table;

    testPlan(EVENTS + 7 + 4 + 4 + 2 + 3 + 5 + WRONGS);
    table = read(goodFile, error, sizeof(error));
    ours = table->bytes;
    ourSize = table->size;
    singleEvents();
    blocks();
    noAnswer();
    walk(argc > 1 ? atoi(argv[1]) : 7, 400000);
    arithmetic();
    words();
    errorWords();
    sessions();
    plcPointersFree(table);
    return testDone();
}
