/* The sync handshake: the table of transitions, and a proof by exhaustion that IOC and PLC
 * together never let a stale setpoint through.
 *
 * The PLC here is a model written after the rules of the handshake, in this file, with
 * nothing of the driver or of plcSim in it. The walk visits every state that the two and a
 * lossy channel can reach within a number of steps.
 */
#include <stdlib.h>
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcSync.h"

/* --- Transitions ------------------------------------------------------------------------*/

enum { event_up, event_lost, event_block };

/* layout ids: ours is 7 */
static const struct {
    const char *title;
    plcSyncState before;
    int asked, event;
    unsigned char flags;
    unsigned char layout;
    plcSyncState after;
    int todo;
    int other; /* the PLC shows other values than those we hold */
} rows[] = {
    /* clang-format off */
    {"disconnected: a connection leads to waiting",            plcSyncDisconnected, 0, event_up, 0, 0, plcSyncWaiting, 0, 0},
    {"disconnected: a late block changes nothing",             plcSyncDisconnected, 0, event_block, 3, 7, plcSyncDisconnected, 0, 0},
    {"waiting: the first block is read back and shown",        plcSyncWaiting, 0, event_block, 2, 7, plcSyncChecking, plcSyncTake | plcSyncSend, 0},
    {"waiting: SYNC of an earlier time is not believed",       plcSyncWaiting, 0, event_block, 3, 7, plcSyncChecking, plcSyncTake | plcSyncSend, 0},
    {"waiting: LOCAL is followed",                             plcSyncWaiting, 0, event_block, 0, 7, plcSyncLocal, plcSyncTake, 0},
    {"waiting: SYNC without REMOTE is LOCAL",                  plcSyncWaiting, 0, event_block, 1, 7, plcSyncLocal, plcSyncTake, 0},
    {"waiting: another layout stops everything",               plcSyncWaiting, 0, event_block, 3, 8, plcSyncLayoutMismatch, 0, 0},
    {"waiting: layout 0 of the PLC is not checked",            plcSyncWaiting, 0, event_block, 2, 0, plcSyncChecking, plcSyncTake | plcSyncSend, 0},
    {"waiting: the loss of the connection",                    plcSyncWaiting, 0, event_lost, 0, 0, plcSyncDisconnected, 0, 0},
    {"waiting: another PLC begins anew",                       plcSyncWaiting, 0, event_up, 0, 0, plcSyncWaiting, 0, 0},
    {"checking: SYNC before we asked is not believed",         plcSyncChecking, 0, event_block, 3, 7, plcSyncChecking, plcSyncTake | plcSyncSend, 0},
    {"checking: SYNC after we asked is the permission",        plcSyncChecking, 1, event_block, 3, 7, plcSyncSynced, 0, 0},
    {"checking: TIMEOUT beside SYNC does not matter",          plcSyncChecking, 1, event_block, 7, 7, plcSyncSynced, 0, 0},
    {"checking: SYNC with values that are not ours is not ours", plcSyncChecking, 1, event_block, 3, 7, plcSyncChecking, plcSyncTake | plcSyncSend, 1},
    {"checking: no SYNC yet: read back and shown again",       plcSyncChecking, 1, event_block, 2, 7, plcSyncChecking, plcSyncTake | plcSyncSend, 0},
    {"checking: LOCAL is followed",                            plcSyncChecking, 1, event_block, 0, 7, plcSyncLocal, plcSyncTake, 0},
    {"checking: LOCAL wins over SYNC",                         plcSyncChecking, 1, event_block, 1, 7, plcSyncLocal, plcSyncTake, 0},
    {"checking: another layout stops everything",              plcSyncChecking, 1, event_block, 3, 8, plcSyncLayoutMismatch, 0, 0},
    {"checking: the loss of the connection",                   plcSyncChecking, 1, event_lost, 0, 0, plcSyncDisconnected, 0, 0},
    {"checking: another PLC begins anew",                      plcSyncChecking, 1, event_up, 0, 0, plcSyncWaiting, 0, 0},
    {"synced: stays so while SYNC stands",                     plcSyncSynced, 1, event_block, 3, 7, plcSyncSynced, 0, 0},
    {"synced: SYNC falls: read back and asked again",          plcSyncSynced, 1, event_block, 2, 7, plcSyncChecking, plcSyncTake | plcSyncSend, 0},
    {"synced: the watchdog of the PLC: asked again",           plcSyncSynced, 1, event_block, 6, 7, plcSyncChecking, plcSyncTake | plcSyncSend, 0},
    {"synced: LOCAL is followed",                              plcSyncSynced, 1, event_block, 0, 7, plcSyncLocal, plcSyncTake, 0},
    {"synced: LOCAL wins over SYNC",                           plcSyncSynced, 1, event_block, 1, 7, plcSyncLocal, plcSyncTake, 0},
    {"synced: another layout stops everything",                plcSyncSynced, 1, event_block, 3, 8, plcSyncLayoutMismatch, 0, 0},
    {"synced: the loss of the connection",                     plcSyncSynced, 1, event_lost, 0, 0, plcSyncDisconnected, 0, 0},
    {"synced: another PLC begins anew",                        plcSyncSynced, 1, event_up, 0, 0, plcSyncWaiting, 0, 0},
    {"LOCAL: each block is followed",                          plcSyncLocal, 0, event_block, 0, 7, plcSyncLocal, plcSyncTake, 0},
    {"LOCAL: REMOTE again: asked first",                       plcSyncLocal, 0, event_block, 2, 7, plcSyncChecking, plcSyncTake | plcSyncSend, 0},
    {"LOCAL: REMOTE with SYNC: asked first all the same",      plcSyncLocal, 0, event_block, 3, 7, plcSyncChecking, plcSyncTake | plcSyncSend, 0},
    {"LOCAL: another layout stops everything",                 plcSyncLocal, 0, event_block, 0, 8, plcSyncLayoutMismatch, 0, 0},
    {"LOCAL: the loss of the connection",                      plcSyncLocal, 0, event_lost, 0, 0, plcSyncDisconnected, 0, 0},
    {"LOCAL: another PLC begins anew",                         plcSyncLocal, 0, event_up, 0, 0, plcSyncWaiting, 0, 0},
    {"layout mismatch: stays while the ids differ",            plcSyncLayoutMismatch, 0, event_block, 3, 8, plcSyncLayoutMismatch, 0, 0},
    {"layout mismatch: the right layout is asked",             plcSyncLayoutMismatch, 0, event_block, 3, 7, plcSyncChecking, plcSyncTake | plcSyncSend, 0},
    {"layout mismatch: the right layout in LOCAL is followed", plcSyncLayoutMismatch, 0, event_block, 0, 7, plcSyncLocal, plcSyncTake, 0},
    {"layout mismatch: the loss of the connection",            plcSyncLayoutMismatch, 0, event_lost, 0, 0, plcSyncDisconnected, 0, 0},
    {"layout mismatch: another PLC begins anew",               plcSyncLayoutMismatch, 0, event_up, 0, 0, plcSyncWaiting, 0, 0},
    /* clang-format on */
};

#define ROWS (sizeof(rows) / sizeof(rows[0]))

static void transitions(void)
{
    size_t i;

    for (i = 0; i < ROWS; i++) {
        unsigned char header[4] = {rows[i].flags, 99, 0, rows[i].layout};
        plcSync sync;
        int todo = 0;

        plcSyncInit(&sync, 7);
        sync.state = rows[i].before;
        sync.asked = rows[i].asked;
        if (rows[i].event == event_up)
            plcSyncConnected(&sync);
        else if (rows[i].event == event_lost)
            plcSyncLost(&sync);
        else
            todo = plcSyncBlock(&sync, header, !rows[i].other, 1);
        testOk(sync.state == rows[i].after && todo == rows[i].todo, "%s", rows[i].title);
    }
}

static void headers(void)
{
    static const struct {
        const char *title;
        plcSyncState state;
        int bigEndian, sends, refuses;
        unsigned char bytes[4];
    } table[] = {
        {"disconnected: nothing is sent, puts are refused", plcSyncDisconnected, 1, 0, 1, {0, 11, 0x12, 0x34}},
        {"waiting: nothing is sent, puts are refused", plcSyncWaiting, 1, 0, 1, {0, 11, 0x12, 0x34}},
        {"checking: CHECK, puts are refused", plcSyncChecking, 1, 1, 1, {1, 11, 0x12, 0x34}},
        {"checking, little endian: the layout id turned round", plcSyncChecking, 0, 1, 1, {1, 11, 0x34, 0x12}},
        {"synced: DATA, puts pass", plcSyncSynced, 1, 1, 0, {2, 11, 0x12, 0x34}},
        {"LOCAL: neither CHECK nor DATA, puts are refused", plcSyncLocal, 1, 1, 1, {0, 11, 0x12, 0x34}},
        {"layout mismatch: nothing is sent, puts are refused", plcSyncLayoutMismatch, 1, 0, 1, {0, 11, 0x12, 0x34}},
    };
    size_t i;

    for (i = 0; i < sizeof(table) / sizeof(table[0]); i++) {
        unsigned char header[4];
        plcSync sync;

        plcSyncInit(&sync, 0x1234);
        sync.state = table[i].state;
        sync.counter = 10;
        plcSyncHeader(&sync, header, table[i].bigEndian);
        testOk(plcSyncMaySend(&sync) == table[i].sends &&
                   (plcSyncReason(sync.state)[0] != 0) == table[i].refuses &&
                   strlen(plcSyncReason(sync.state)) < 40 &&
                   memcmp(header, table[i].bytes, 4) == 0,
               "%s", table[i].title);
    }
}

/* --- The walk ---------------------------------------------------------------------------*/

/* Two setpoints with three values each are enough for every race of two writers. */
enum { POINTS = 2, VALUES = 3, ROOM = 2 };

/* A setpoint on its way. `put` is the number of a client's put after SYNC, 0 for none. Once
 * the PLC has taken a put, its number is wiped out everywhere: each put counts once, and
 * what comes after it with the same value is stale. */
typedef struct point {
    unsigned char value, put;
} point;

typedef struct block {
    unsigned char flags;
    point points[POINTS];
} block;

typedef struct channel {
    unsigned char count;
    block blocks[ROOM];
} channel;

typedef struct world {
    /* the PLC */
    unsigned char memory[POINTS], accepted[POINTS];
    unsigned char sync, remote;
    /* the IOC */
    plcSync ioc;
    point image[POINTS];
    unsigned char dirty;
    /* the wire; a break empties both */
    unsigned char connected;
    channel toIoc, toPlc;
    unsigned char broken; /* a stale setpoint was taken */
} world;

static block *last(channel *c)
{
    return &c->blocks[c->count++];
}

static block first(channel *c)
{
    block b = c->blocks[0];

    c->count--;
    memmove(&c->blocks[0], &c->blocks[1], sizeof(b) * (ROOM - 1));
    memset(&c->blocks[c->count], 0, sizeof(b) * (ROOM - c->count));
    return b;
}

static void cut(world *w)
{
    memset(&w->toIoc, 0, sizeof(w->toIoc));
    memset(&w->toPlc, 0, sizeof(w->toPlc));
    w->connected = 0;
    w->sync = 0;
    plcSyncLost(&w->ioc);
}

/* The PLC's rule, in each of its cycles: SYNC stands only while its setpoints are those
 * that it last accepted. */
static void plcWatch(world *w)
{
    if (memcmp(w->memory, w->accepted, POINTS))
        w->sync = 0;
}

static void plcSends(world *w)
{
    block *b = last(&w->toIoc);
    int i;

    plcWatch(w);
    b->flags = (w->sync ? plcFlagSync : 0) | (w->remote ? plcFlagRemote : 0);
    for (i = 0; i < POINTS; i++)
        b->points[i] = (point){w->memory[i], 0};
}

static void wipe(world *w, int i, int put)
{
    int n;

    if (w->image[i].put == put)
        w->image[i].put = 0;
    for (n = 0; n < ROOM; n++)
        if (w->toPlc.blocks[n].points[i].put == put)
            w->toPlc.blocks[n].points[i].put = 0;
}

static void plcReceives(world *w)
{
    block b = first(&w->toPlc);
    int i, equal = 1;

    plcWatch(w);
    if (!w->remote)
        return;
    for (i = 0; i < POINTS; i++)
        equal &= b.points[i].value == w->memory[i];
    if (b.flags & plcFlagCheck) {
        w->sync = (unsigned char)equal;
        memcpy(w->accepted, w->memory, POINTS);
        return;
    }
    if (!(b.flags & plcFlagData) || !w->sync)
        return;
    for (i = 0; i < POINTS; i++) {
        if (b.points[i].value != w->memory[i] && !b.points[i].put)
            w->broken = 1;
        wipe(w, i, b.points[i].put);
        w->memory[i] = w->accepted[i] = b.points[i].value;
    }
}

static void iocReceives(world *w)
{
    block b = first(&w->toIoc);
    unsigned char header[4] = {b.flags};
    int i, same = 1, todo;

    for (i = 0; i < POINTS; i++)
        same &= w->image[i].value == b.points[i].value;
    todo = plcSyncBlock(&w->ioc, header, same, 1);
    for (i = 0; (todo & plcSyncTake) && i < POINTS; i++)
        w->image[i] = b.points[i];
    if (todo & plcSyncTake)
        w->dirty = 0;
    if (todo & plcSyncSend)
        w->dirty = 1;
}

static void iocSends(world *w)
{
    block *b = last(&w->toPlc);
    unsigned char header[4];

    plcSyncHeader(&w->ioc, header, 1);
    w->ioc.counter = 0; /* not part of the state of the walk */
    b->flags = header[0];
    memcpy(b->points, w->image, sizeof(b->points));
    w->dirty = 0;
}

/* A number that no put on the wire has. */
static unsigned char freshPut(const world *w, int i)
{
    unsigned char put = 1;
    int n;

    for (n = 0; n < ROOM; n++)
        if (w->toPlc.blocks[n].points[i].put == put) {
            put++;
            n = -1;
        }
    return put;
}

enum { actions = 9 + 2 * POINTS * VALUES };

/* Does action number `a`; returns 0 when it is not possible now. */
static int act(world *w, int a)
{
    int i, value;

    switch (a) {
    case 0: /* PLC sends */
        if (!w->connected || w->toIoc.count == ROOM)
            return 0;
        plcSends(w);
        return 1;
    case 1: /* IOC takes a block */
        if (!w->toIoc.count)
            return 0;
        iocReceives(w);
        return 1;
    case 2: /* IOC sends: a change, or a heartbeat */
        if (!w->connected || w->toPlc.count == ROOM || !plcSyncMaySend(&w->ioc))
            return 0;
        iocSends(w);
        return 1;
    case 3: /* PLC takes a block */
        if (!w->toPlc.count)
            return 0;
        plcReceives(w);
        return 1;
    case 4: /* the connection breaks */
        if (!w->connected)
            return 0;
        cut(w);
        return 1;
    case 5: /* connected */
        if (w->connected)
            return 0;
        w->connected = 1;
        plcSyncConnected(&w->ioc);
        return 1;
    case 6: /* LOCAL <-> REMOTE */
        w->remote = !w->remote;
        w->sync = w->sync && w->remote;
        return 1;
    case 7: /* the PLC's watchdog expires, or its program restarts */
        if (!w->sync)
            return 0;
        w->sync = 0;
        return 1;
    case 8: /* the IOC restarts with values of yesterday */
        cut(w);
        plcSyncInit(&w->ioc, 0);
        for (i = 0; i < POINTS; i++)
            w->image[i] = (point){2, 0};
        w->dirty = 1;
        return 1;
    }
    a -= 9;
    i = a / VALUES % POINTS;
    value = a % VALUES;
    if (a < POINTS * VALUES) { /* a client's put: the gate is the driver's */
        if (plcSyncReason(w->ioc.state)[0])
            return 0;
        w->image[i] = (point){(unsigned char)value, freshPut(w, i)};
        w->dirty = 1;
        return 1;
    }
    if (w->memory[i] == value)
        return 0;
    w->memory[i] = (unsigned char)value; /* the HMI moves it, the PLC's next cycle sees it */
    plcWatch(w);
    return 1;
}

/* Once faults stop, the two must find each other. Returns 1 when they do. */
static int settles(world w)
{
    int round;

    w.remote = 1;
    act(&w, 5);
    for (round = 0; round < 12; round++) {
        act(&w, 0);
        act(&w, 1);
        if (w.dirty)
            act(&w, 2);
        act(&w, 3);
    }
    return w.ioc.state == plcSyncSynced && w.sync && !w.broken &&
           w.image[0].value == w.memory[0] && w.image[1].value == w.memory[1];
}

/* States seen: open addressing, grown by doubling. */
static world *table;
static unsigned char *used;
static size_t capacity, stored;

static size_t place(const world *w)
{
    const unsigned char *p = (const unsigned char *)w;
    epicsUInt64 hash = 1469598103934665603ull;
    size_t i;

    for (i = 0; i < sizeof(*w); i++)
        hash = (hash ^ p[i]) * 1099511628211ull;
    for (i = (size_t)(hash % capacity); used[i] && memcmp(&table[i], w, sizeof(*w));
         i = (i + 1) % capacity)
        ;
    return i;
}

static int isNew(const world *w)
{
    size_t i = place(w);

    if (used[i] || stored * 2 > capacity)
        return 0;
    used[i] = 1;
    table[i] = *w;
    stored++;
    return 1;
}

static void walk(int depth)
{
    size_t broken = 0, lost = 0, synced = 0, head, tail = 0, levelEnd;
    world *queue, start;
    int level, a;

    capacity = (size_t)1 << 23;
    table = calloc(capacity, sizeof(*table));
    used = calloc(capacity, 1);
    queue = calloc(capacity, sizeof(*queue));
    if (!table || !used || !queue)
        testAbort("no memory for the walk");
    memset(&start, 0, sizeof(start));
    plcSyncInit(&start.ioc, 0);
    start.remote = 1;
    start.image[0].value = start.image[1].value = 2; /* yesterday's */
    isNew(&start);
    queue[tail++] = start;
    for (head = 0, level = 0; level < depth && head < tail; level++) {
        for (levelEnd = tail; head < levelEnd; head++)
            for (a = 0; a < actions; a++) {
                world next = queue[head];

                if (!act(&next, a) || !isNew(&next))
                    continue;
                broken += next.broken;
                synced += next.ioc.state == plcSyncSynced;
                lost += !settles(next);
                queue[tail++] = next;
            }
    }
    testDiag("%u states within %d steps, %u of them synced", (unsigned)tail, level,
             (unsigned)synced);
    testOk(stored * 2 <= capacity && synced > 1000,
           "the walk visits every state within its depth, and many of them are synced");
    testOk(broken == 0, "the PLC never takes a setpoint that is neither its own nor put "
           "by a client after SYNC");
    testOk(lost == 0, "from every state, IOC and PLC synchronise once faults stop");
    free(table);
    free(used);
    free(queue);
}

/* Another table of pointers: no block counts until the PLC has ours. */
static void tables(void)
{
    static const unsigned char remote[] = {2, 0, 0, 0}, local[] = {0, 0, 0, 0};
    unsigned char header[4];
    int i, first, wrong = 0;
    plcSync s;

    plcSyncInit(&s, 7);
    plcSyncMap(&s, remote, 1);
    testOk(s.state == plcSyncDisconnected, "a table of pointers makes no connection");
    plcSyncConnected(&s);
    s.asked = 1;
    plcSyncMap(&s, remote, 0);
    testOk(s.state == plcSyncMapMismatch && !s.asked && *plcSyncReason(s.state) && !plcSyncMaySend(&s) &&
               s.flags == 2,
           "another table, and nothing is done about it: no put passes, nothing is sent");
    plcSyncMap(&s, local, 1);
    testOk(s.state == plcSyncMapDownload && *plcSyncReason(s.state) && plcSyncMaySend(&s) && s.flags == 0,
           "it gets ours: parts of it are sent, no put passes");
    testOk(strcmp(plcSyncReason(plcSyncDisconnected), "not synchronised: PLC not connected") == 0 &&
               strcmp(plcSyncReason(plcSyncWaiting), "not synchronised: no block yet") == 0 &&
               strcmp(plcSyncReason(plcSyncChecking), "not synchronised: PLC checks") == 0 &&
               strcmp(plcSyncReason(plcSyncMapMismatch), "PLC has another table of pointers") == 0 &&
               strcmp(plcSyncReason(plcSyncMapDownload), "PLC is getting its table of pointers") == 0 &&
               strcmp(plcSyncReason(plcSyncLayoutMismatch), "layout ids of PLC and IOC differ") == 0 &&
               strcmp(plcSyncReason(plcSyncLocal), "PLC in LOCAL") == 0 &&
               strcmp(plcSyncReason(plcSyncSynced), "") == 0,
           "what a refused put is told, by the state");
    testOk(strcmp(plcSyncStateName(plcSyncMapDownload), "map download") == 0 &&
               strcmp(plcSyncStateName(plcSyncDisconnected), "disconnected") == 0 &&
               strcmp(plcSyncStateName(plcSyncWaiting), "waiting") == 0 &&
               strcmp(plcSyncStateName(plcSyncChecking), "checking") == 0 &&
               strcmp(plcSyncStateName(plcSyncSynced), "synced") == 0 &&
               strcmp(plcSyncStateName(plcSyncLocal), "LOCAL") == 0 &&
               strcmp(plcSyncStateName(plcSyncLayoutMismatch), "layout mismatch") == 0 &&
               strcmp(plcSyncStateName(plcSyncMapMismatch), "map mismatch") == 0 &&
               strcmp(plcSyncStateName(-1), "?") == 0 &&
               strcmp(plcSyncStateName(plcSyncMapDownload + 1), "?") == 0,
           "states have names, and no others have");
    plcSyncInit(&s, 7);
    plcSyncConnected(&s);
    plcSyncHeader(&s, header, 1);
    first = header[1];
    for (i = 1; i <= 600; i++) {
        plcSyncHeader(&s, header, 1);
        wrong += header[1] != (first + i) % 256;
    }
    testOk(!wrong, "the counter goes up by 1 with each block, from 255 to 0");
    testOk(!s.asked, "a header that is made before the PLC has shown anything asks nothing");
}

MAIN(syncTest)
{
    (void)argc;
    (void)argv;
    testPlan(ROWS + 7 + 5 + 4 + 1);
    transitions();
    headers();
    tables();
    walk(14);
    return testDone();
}
