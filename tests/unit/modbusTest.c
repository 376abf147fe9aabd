/* The Modbus worker against a server of libmodbus on loopback, which does as it is told:
 * holds its answer back, refuses, answers wrong, dribbles, closes. */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <sys/resource.h>

#include <modbus/modbus.h>

#include <cantProceed.h>
#include <epicsEvent.h>
#include <epicsMutex.h>
#include <epicsStdio.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcModbus.h"
#include "testFaults.h"
#include "testTools.h"

#define COUNT(table) (sizeof(table) / sizeof(table[0]))

/* --- The PLC ---------------------------------------------------------------------- */

enum { tableSize = 1000, logSize = 10000, headerSize = 7 };

/* What the PLC does with a request. */
typedef enum {
    replies,
    refuses, /* with an exception code */
    isSilent,
    holdsBack, /* until plcRelease */
    closes,
    closesWithin, /* an answer */
    stopsWithin,  /* an answer */
    dribbles,     /* a byte now and then */
    wrongNumber,  /* of the transaction */
    wrongUnit,
    wrongFunction,
    wrongProtocol,
    wrongLength, /* of the data */
    wrongHeader, /* length in the header */
    wrongEcho,   /* of the address */
    answersTwice
} plcAct;

typedef struct plcRule {
    int function;         /* 0: any */
    unsigned first, last; /* touches one of these addresses */
    plcAct act;
    int code;  /* of the exception */
    int times; /* how often; 0: always */
} plcRule;

typedef struct plcSeen {
    int function;
    unsigned start, count;
} plcSeen;

typedef struct plc {
    int listener, port;
    modbus_t *context;
    epicsThreadId thread;
    epicsEventId release, seen;
    epicsMutexId lock; /* guards from here on */
    modbus_mapping_t *memory;
    plcRule rules[4];
    unsigned ruleCount;
    plcSeen log[logSize];
    unsigned logged;
    int unit;
    int connected, socket;
} plc;

static plcSeen look(const epicsUInt8 *q)
{
    plcSeen s = {q[headerSize], q[8] << 8 | q[9], 1};

    if (s.function <= 4 || s.function == 15 || s.function == 16)
        s.count = q[10] << 8 | q[11];
    return s;
}

/* The rule that a request meets; the lock is held. */
static plcRule meet(plc *p, const plcSeen *s)
{
    static const plcRule none = {.act = replies};
    unsigned i;

    for (i = 0; i < p->ruleCount; i++) {
        plcRule *r = &p->rules[i];

        if ((r->function && r->function != s->function) || s->start > r->last ||
            s->start + s->count <= r->first || r->times < 0)
            continue;
        if (r->times && --r->times == 0)
            r->times = -1;
        return *r;
    }
    return none;
}

/* The answer that would be right, from libmodbus itself, by way of a pair of sockets. */
static int rightAnswer(plc *p, const epicsUInt8 *q, int size, epicsUInt8 *answer)
{
    int pair[2], socket = modbus_get_socket(p->context), n;

    if (socketpair(AF_UNIX, SOCK_STREAM, 0, pair))
        return -1;
    modbus_set_socket(p->context, pair[0]);
    epicsMutexMustLock(p->lock);
    modbus_reply(p->context, q, size, p->memory);
    epicsMutexUnlock(p->lock);
    modbus_set_socket(p->context, socket);
    n = (int)recv(pair[1], answer, MODBUS_TCP_MAX_ADU_LENGTH, 0);
    close(pair[0]);
    close(pair[1]);
    return n;
}

static void dribble(int fd, const epicsUInt8 *a, int n)
{
    int i;

    for (i = 0; i < n; i++) {
        if (toolSend(fd, a + i, 1))
            return;
        epicsThreadSleep(0.2); /* a PLC this slow */
    }
}

/* An answer with an error in it. */
static void spoil(epicsUInt8 *a, int *n, plcAct act)
{
    switch (act) {
    case wrongNumber:
        a[1]++;
        break;
    case wrongProtocol:
        a[3] = 1;
        break;
    case wrongUnit:
        a[6]++;
        break;
    case wrongFunction:
        a[7] ^= 7;
        break;
    case wrongEcho:
        a[9]++;
        break;
    case wrongLength: /* two bytes less, and the header says so */
        *n -= 2;
        a[5] -= 2;
        break;
    default: /* wrongHeader */
        a[4] = 0xff;
    }
}

/* Returns -1: the connection is to be closed. */
static int act(plc *p, const epicsUInt8 *q, int size, const plcRule *rule)
{
    epicsUInt8 a[MODBUS_TCP_MAX_ADU_LENGTH];
    int fd = modbus_get_socket(p->context), n = 0;

    if (rule->act == holdsBack)
        epicsEventWaitWithTimeout(p->release, PATIENCE_S);
    if (rule->act == isSilent)
        return 0;
    if (rule->act == closes)
        return -1;
    if (rule->act == refuses) {
        memcpy(a, q, 8);
        a[4] = 0;
        a[5] = 3;
        a[7] |= 0x80;
        a[8] = (epicsUInt8)rule->code;
        return toolSend(fd, a, 9);
    }
    n = rightAnswer(p, q, size, a);
    if (n < 9)
        return -1;
    if (rule->act == dribbles) {
        dribble(fd, a, n);
        return 0;
    }
    if (rule->act == answersTwice)
        toolSend(fd, a, n);
    if (rule->act == closesWithin || rule->act == stopsWithin)
        n--;
    else if (rule->act >= wrongNumber && rule->act != answersTwice)
        spoil(a, &n, rule->act);
    if (toolSend(fd, a, n))
        return -1;
    return rule->act == closesWithin ? -1 : 0;
}

static void serve(plc *p)
{
    epicsUInt8 q[MODBUS_TCP_MAX_ADU_LENGTH];
    plcRule rule;
    plcSeen s;
    int n;

    do {
        n = modbus_receive(p->context, q);
        if (n <= 0)
            break;
        s = look(q);
        epicsMutexMustLock(p->lock);
        rule = meet(p, &s);
        if (p->logged < logSize)
            p->log[p->logged++] = s;
        p->unit = q[6];
        epicsMutexUnlock(p->lock);
        epicsEventSignal(p->seen);
    } while (act(p, q, n, &rule) == 0);
    epicsMutexMustLock(p->lock);
    p->connected = 0;
    epicsMutexUnlock(p->lock);
    modbus_close(p->context);
}

static void plcThread(void *arg)
{
    plc *p = arg;

    while (modbus_tcp_accept(p->context, &p->listener) >= 0) {
        epicsMutexMustLock(p->lock);
        p->connected = 1;
        p->socket = modbus_get_socket(p->context);
        epicsMutexUnlock(p->lock);
        serve(p);
    }
}

static plc *plcCreate(void)
{
    epicsThreadOpts options = EPICS_THREAD_OPTS_INIT;
    plc *p = callocMustSucceed(1, sizeof(*p), "plcCreate");
    int i;

    options.joinable = 1;
    p->listener = toolListen(&p->port);
    p->context = modbus_new_tcp("127.0.0.1", p->port);
    p->memory = modbus_mapping_new(tableSize, tableSize, tableSize, tableSize);
    for (i = 0; i < tableSize; i++) {
        p->memory->tab_registers[i] = (uint16_t)(0x1000 + i);
        p->memory->tab_input_registers[i] = (uint16_t)(0x2000 + i);
        p->memory->tab_bits[i] = i % 3 == 0;
        p->memory->tab_input_bits[i] = i % 5 == 0;
    }
    p->lock = epicsMutexMustCreate();
    p->release = epicsEventMustCreate(epicsEventEmpty);
    p->seen = epicsEventMustCreate(epicsEventEmpty);
    p->thread = epicsThreadCreateOpt("plc", plcThread, p, &options);
    return p;
}

static void plcDestroy(plc *p)
{
    shutdown(p->listener, SHUT_RDWR);
    epicsEventSignal(p->release);
    epicsThreadMustJoin(p->thread);
    close(p->listener);
    modbus_mapping_free(p->memory);
    modbus_free(p->context);
    epicsMutexDestroy(p->lock);
    epicsEventDestroy(p->release);
    epicsEventDestroy(p->seen);
    free(p);
}

static void plcSetRules(plc *p, const plcRule *rules, unsigned count)
{
    epicsMutexMustLock(p->lock);
    p->ruleCount = count;
    if (count)
        memcpy(p->rules, rules, count * sizeof(*rules));
    epicsMutexUnlock(p->lock);
}

static void plcOneRule(plc *p, int function, unsigned first, unsigned last, plcAct act,
                       int code)
{
    plcRule rule = {function, first, last, act, code, 0};

    plcSetRules(p, &rule, 1);
}

static void plcForget(plc *p)
{
    epicsMutexMustLock(p->lock);
    p->logged = 0;
    epicsMutexUnlock(p->lock);
}

static unsigned plcLogged(plc *p)
{
    unsigned n;

    epicsMutexMustLock(p->lock);
    n = p->logged;
    epicsMutexUnlock(p->lock);
    return n;
}

static plcSeen plcLog(plc *p, unsigned i)
{
    plcSeen s;

    epicsMutexMustLock(p->lock);
    s = p->log[i];
    epicsMutexUnlock(p->lock);
    return s;
}

/* How many requests of this function (0: any) touched the address? */
static unsigned plcAsked(plc *p, int function, unsigned address)
{
    unsigned i, n = 0;

    epicsMutexMustLock(p->lock);
    for (i = 0; i < p->logged; i++)
        n += (!function || p->log[i].function == function) &&
             address >= p->log[i].start && address - p->log[i].start < p->log[i].count;
    epicsMutexUnlock(p->lock);
    return n;
}

static unsigned plcRegister(plc *p, unsigned address)
{
    unsigned value;

    epicsMutexMustLock(p->lock);
    value = p->memory->tab_registers[address];
    epicsMutexUnlock(p->lock);
    return value;
}

static void plcSetRegister(plc *p, unsigned address, unsigned value)
{
    epicsMutexMustLock(p->lock);
    p->memory->tab_registers[address] = (uint16_t)value;
    epicsMutexUnlock(p->lock);
}

static unsigned plcCoil(plc *p, unsigned address)
{
    unsigned value;

    epicsMutexMustLock(p->lock);
    value = p->memory->tab_bits[address];
    epicsMutexUnlock(p->lock);
    return value;
}

static int plcUnit(plc *p)
{
    int unit;

    epicsMutexMustLock(p->lock);
    unit = p->unit;
    epicsMutexUnlock(p->lock);
    return unit;
}

/* The PLC closes, whatever it does. */
static void plcHangUp(plc *p)
{
    epicsMutexMustLock(p->lock);
    if (p->connected)
        shutdown(p->socket, SHUT_RDWR);
    epicsMutexUnlock(p->lock);
}

static int plcConnected(plc *p)
{
    int connected;

    epicsMutexMustLock(p->lock);
    connected = p->connected;
    epicsMutexUnlock(p->lock);
    return connected;
}

/* --- The station ------------------------------------------------------------------ */

typedef struct world {
    plc *plc;
    plcModbus *modbus;
    plcModbusOptions options;
    plcRange *inputs, *outputs;
    size_t inSize, outSize;
    plcFaults *inFaults, *outFaults;
    epicsEventId woken;
    SOCKET socket;
    plcNews all; /* since the start: sums, and the last words */
    char log[2000];
    plcImage *out; /* puts wait here */
    epicsUInt8 input[4096], output[4096], image[4096], mask[4096];
} world;

static void wake(void *arg)
{
    epicsEventSignal(arg);
}

static int parse(const char *text, int output, plcRange **ranges, size_t *size)
{
    char error[200];
    int n = plcRangesParse(text, output, ranges, size, error, sizeof(error));

    if (n < 0)
        testAbort("%s", error);
    return n;
}

static world *worldCreate(plc *p, const char *inputs, const char *outputs, int bigEndian)
{
    world *w = callocMustSucceed(1, sizeof(*w), "worldCreate");
    plcModbusSetup setup = {
        .name = "test", .unit = 7, .bigEndian = bigEndian, .wake = wake};

    w->plc = p;
    setup.inputCount = parse(inputs, 0, &w->inputs, &w->inSize);
    setup.outputCount = parse(outputs, 1, &w->outputs, &w->outSize);
    setup.inputs = w->inputs;
    setup.outputs = w->outputs;
    setup.inSize = w->inSize;
    setup.outSize = w->outSize;
    setup.out = w->out = plcImageCreate(w->outSize);
    plcImageKeepPuts(w->out, 1000);
    setup.inFaults = w->inFaults = plcFaultsCreate(w->inSize);
    setup.outFaults = w->outFaults = plcFaultsCreate(w->outSize);
    setup.arg = w->woken = epicsEventMustCreate(epicsEventEmpty);
    w->socket = INVALID_SOCKET;
    w->options =
        (plcModbusOptions){.requestTimeout = PATIENCE_S * 1000, .heartbeatRegister = -1};
    w->modbus = plcModbusCreate(&setup);
    plcModbusSetOptions(w->modbus, &w->options);
    return w;
}

static void worldDestroy(world *w)
{
    plcModbusDestroy(w->modbus);
    if (w->socket != INVALID_SOCKET)
        toolClose(w->socket);
    plcFaultsDestroy(w->inFaults);
    plcFaultsDestroy(w->outFaults);
    plcImageDestroy(w->out);
    epicsEventDestroy(w->woken);
    free(w->inputs);
    free(w->outputs);
    free(w);
}

/* A connection to the PLC, as the station's thread makes it. */
static SOCKET connectTo(plc *p)
{
    struct sockaddr_in peer = {.sin_family = AF_INET, .sin_port = htons(p->port)};
    SOCKET s = socket(AF_INET, SOCK_STREAM, 0);

    peer.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (connect(s, (struct sockaddr *)&peer, sizeof(peer)))
        testAbort("cannot connect: %s", strerror(errno));
    fcntl(s, F_SETFL, fcntl(s, F_GETFL) | O_NONBLOCK);
    return s;
}

static void stop(world *w)
{
    plcModbusStop(w->modbus);
    if (w->socket != INVALID_SOCKET)
        toolClose(w->socket); /* as the station does */
    w->socket = INVALID_SOCKET;
}

static void start(world *w, const epicsUInt8 *joinedIn, const epicsUInt8 *joinedOut)
{
    memset(&w->all, 0, sizeof(w->all));
    w->log[0] = 0;
    stop(w);
    plcImageAway(w->out, 1); /* as the station does */
    plcImageForget(w->out);
    plcImageAway(w->out, 0);
    w->socket = connectTo(w->plc);
    plcModbusStart(w->modbus, w->socket, joinedIn, joinedOut);
}

/* Takes the news, adds them up. */
static void take(world *w)
{
    plcNews n;

    plcModbusTake(w->modbus, &n, w->input, w->output);
    w->all.blocks += n.blocks;
    w->all.shown += n.shown;
    w->all.lost |= n.lost;
    w->all.inFaults |= n.inFaults;
    w->all.outFaults |= n.outFaults;
    w->all.requests += n.requests;
    w->all.exceptions += n.exceptions;
    w->all.timeouts += n.timeouts;
    w->all.bytesIn += n.bytesIn;
    w->all.bytesOut += n.bytesOut;
    w->all.writes += n.writes;
    if (n.latencyMax > w->all.latencyMax)
        w->all.latencyMax = n.latencyMax;
    if (n.blocks)
        w->all.stamp = n.stamp;
    if (n.lost)
        strcpy(w->all.why, n.why);
    if (n.unread[0])
        strcpy(w->all.unread, n.unread);
    if (n.log[0] && strlen(w->log) + strlen(n.log) + 2 < sizeof(w->log))
        strcat(strcat(w->log, n.log), "; ");
}

/* All puts are through, or refused. */
static int idle(world *w)
{
    return !plcImagePutsWaiting(w->out, NULL, NULL);
}

/* Until the condition is true; news are taken whenever there are some. */
#define UNTIL(w, condition)                                                              \
    do {                                                                                 \
        epicsUInt64 end_ = epicsMonotonicGet() + PATIENCE_S * 1000000000ull;             \
        for (take(w); !(condition) && epicsMonotonicGet() < end_; take(w))               \
            epicsEventWaitWithTimeout((w)->woken, 0.01);                                 \
    } while (0)

static void setOptions(world *w)
{
    plcModbusSetOptions(w->modbus, &w->options);
}

/* Puts a register or a bit into the image; it leaves with `send`. */
static void putRegister(world *w, unsigned index, unsigned value)
{
    w->image[2 * index] = (epicsUInt8)(value >> 8);
    w->image[2 * index + 1] = (epicsUInt8)value;
    w->mask[2 * index] = w->mask[2 * index + 1] = 0xff;
}

static void putBit(world *w, unsigned byte, unsigned bit, int value)
{
    w->mask[byte] |= 1 << bit;
    w->image[byte] &= (epicsUInt8)~(1 << bit);
    w->image[byte] |= (epicsUInt8)(!!value << bit);
}

static void sendOrders(world *w)
{
    size_t i;

    for (i = 0; i < w->outSize; i++) {
        if (i % 2 == 0 && i + 1 < w->outSize && w->mask[i] == 0xff && w->mask[i + 1] == 0xff)
            plcImageWrite(w->out, i, 2, w->image + i, NULL, NULL);
        else if (w->mask[i] && (i % 2 == 0 || w->mask[i] != 0xff || w->mask[i - 1] != 0xff))
            plcImageWrite(w->out, i, 1, w->image + i, w->mask + i, NULL);
    }
    plcModbusWrite(w->modbus);
    memset(w->mask, 0, sizeof(w->mask));
}

static unsigned get16(const epicsUInt8 *at)
{
    return at[0] << 8 | at[1];
}

static const char *fault(plcFaults *faults, size_t offset, size_t length)
{
    static char reason[PLC_REASON_SIZE];

    plcFaultsFind(faults, offset, length, NULL, reason);
    return reason;
}

static int isSame(plcSeen a, plcSeen b)
{
    return a.function == b.function && a.start == b.start && a.count == b.count;
}

/* --- Reads ------------------------------------------------------------------------ */

static void testInputs(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "holding 10 300, input 0 20, coils 1 64, discrete 3 9",
                           "holding 500 4", 1);
    static const plcSeen expected[] = {
        {3, 500, 4  },
        {3, 10,  125},
        {3, 135, 125},
        {3, 260, 50 },
        {4, 0,   20 },
        {1, 1,   64 },
        {2, 3,   9  }
    };
    unsigned i, good = 1;
    epicsTimeStamp now;

    start(w, NULL, NULL);
    UNTIL(w, w->all.blocks);
    testOk(w->all.shown == 1 && get16(w->output) == 0x11f4 &&
               get16(w->output + 6) == 0x11f7,
           "the outputs are shown first");
    for (i = 0; i < COUNT(expected); i++)
        good &= isSame(plcLog(p, i), expected[i]);
    testOk(good, "outputs first, then all ranges in order, no more requests than needed");
    testOk(plcUnit(p) == 7, "the unit");
    for (i = 0, good = 1; i < 300; i++)
        good &= get16(w->input + 2 * i) == 0x100a + i;
    testOk(good, "holding registers");
    for (i = 0, good = 1; i < 20; i++)
        good &= get16(w->input + 600 + 2 * i) == 0x2000 + i;
    testOk(good, "input registers");
    for (i = 0, good = 1; i < 64; i++)
        good &= (w->input[640 + i / 8] >> i % 8 & 1) == ((i + 1) % 3 == 0);
    testOk(good, "coils");
    for (i = 0, good = 1; i < 9; i++)
        good &= (w->input[648 + i / 8] >> i % 8 & 1) == ((i + 3) % 5 == 0);
    testOk(good, "discrete inputs");
    epicsTimeGetCurrent(&now);
    testOk(epicsTimeDiffInSeconds(&now, &w->all.stamp) < PATIENCE_S &&
               w->all.requests >= 7 && w->all.bytesOut >= 7 * 12 &&
               w->all.bytesIn >= 600 && w->all.latencyMax > 0,
           "time stamp and counts");
    i = w->all.blocks;
    plcSetRegister(p, 309, 0xabcd);
    UNTIL(w, get16(w->input + 598) == 0xabcd);
    testOk(get16(w->input + 598) == 0xabcd && w->all.blocks > i,
           "and again by its period");
    worldDestroy(w);
    plcDestroy(p);
}

static void testLittleEndian(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "holding 0 2", "holding 0 2", 0);

    start(w, NULL, NULL);
    UNTIL(w, w->all.blocks);
    testOk(w->input[0] == 0 && w->input[1] == 0x10 && w->input[2] == 1, "LSB first");
    w->image[0] = 0x34;
    w->image[1] = 0x12;
    w->mask[0] = w->mask[1] = 0xff;
    sendOrders(w);
    UNTIL(w, w->all.writes == 1);
    testOk(plcRegister(p, 0) == 0x1234 && plcRegister(p, 1) == 0x1001, "and out");
    worldDestroy(w);
    plcDestroy(p);
}

static void testPeriods(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "holding 0 2 every 5, holding 2 2 every 3600000", "", 1);

    start(w, NULL, NULL);
    UNTIL(w, w->all.blocks >= 5);
    testOk(w->all.shown == 1, "no outputs: shown at once");
    testOk(plcAsked(p, 3, 0) >= 5 && plcAsked(p, 3, 2) == 1,
           "each range by its own period");
    worldDestroy(w);
    plcDestroy(p);
}

static void testRefusedRange(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(
        p, "holding 0 50 every 5, holding 50 50 every 5, coils 0 8 every 5", "", 1);
    unsigned blocks;

    plcOneRule(p, 3, 60, 60, refuses, 2);
    start(w, NULL, NULL);
    UNTIL(w, w->all.blocks && w->log[0]);
    testOk(w->all.inFaults && strcmp(fault(w->inFaults, 100, 100),
                                     "PLC: exception 2, illegal data address") == 0,
           "the refused range is faulty: %s", fault(w->inFaults, 100, 100));
    testOk(!fault(w->inFaults, 0, 100)[0] && !fault(w->inFaults, 200, 1)[0] &&
               get16(w->input + 98) == 0x1031 && w->input[200] == 0x49,
           "the others are not, though they were read together");
    testOk(w->all.exceptions >= 2 &&
               strstr(w->log, "read of holding 60: PLC: exception 2"),
           "log: %s", w->log);
    plcForget(p);
    blocks = w->all.blocks;
    UNTIL(w, w->all.blocks > blocks + 1 && plcAsked(p, 3, 99));
    testOk(plcLog(p, 0).count <= 50, "from then on each is read by itself");
    plcSetRules(p, NULL, 0);
    UNTIL(w, get16(w->input + 100) == 0x1032);
    testOk(fault(w->inFaults, 100, 100)[0], "a fault does not end before its bytes are there");
    UNTIL(w, !fault(w->inFaults, 100, 100)[0]);
    blocks = w->all.blocks;
    UNTIL(w, w->all.blocks > blocks);
    testOk(!fault(w->inFaults, 100, 100)[0] && get16(w->input + 100) == 0x1032 &&
               strstr(w->log, "good again"),
           "it is good again when the PLC shows it");
    worldDestroy(w);
    plcDestroy(p);
}

static void testAllRefused(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "holding 0 50, coils 0 8", "holding 0 10", 1);

    plcOneRule(p, 0, 0, 65535, refuses, 11);
    start(w, NULL, NULL);
    UNTIL(w, w->all.blocks);
    testOk(w->all.blocks == 1 && fault(w->inFaults, 0, 1)[0] &&
               fault(w->inFaults, 100, 1)[0],
           "all refused: a block with faults, %s", fault(w->inFaults, 100, 1));
    testOk(!w->all.shown &&
               strcmp(w->all.unread, "PLC: exception 11, gateway: no answer") == 0,
           "outputs unread: %s", w->all.unread);
    worldDestroy(w);
    plcDestroy(p);
}

/* --- Writes ----------------------------------------------------------------------- */

static void testWrites(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "", "holding 100 200, coils 0 100, holding 300 10", 1);
    unsigned i, good;

    start(w, NULL, NULL);
    UNTIL(w, w->all.shown);
    plcForget(p);
    putRegister(w, 3, 0x1234);
    sendOrders(w);
    UNTIL(w, w->all.writes == 1 && idle(w));
    testOk(plcRegister(p, 103) == 0x1234 && plcRegister(p, 102) == 0x1066 &&
               plcRegister(p, 104) == 0x1068 && plcAsked(p, 16, 103) == 1 &&
               plcLogged(p) == 1,
           "one register: one FC16, its neighbours untouched");
    plcForget(p);
    for (i = 0; i < 200; i++)
        putRegister(w, i, 0x4000 + i);
    sendOrders(w);
    UNTIL(w, w->all.writes == 3 && idle(w));
    for (i = 0, good = 1; i < 200; i++)
        good &= plcRegister(p, 100 + i) == 0x4000 + i;
    testOk(good && plcLogged(p) == 2 && plcLog(p, 0).count == 123,
           "200 registers: two requests");
    plcForget(p);
    putBit(w, 6, 0, 1);
    putBit(w, 6, 7, 0);
    putBit(w, 7, 1, 1);
    plcSetRegister(p, 103, 0xaaaa);
    sendOrders(w);
    UNTIL(w, w->all.writes == 4 && idle(w));
    testOk(plcRegister(p, 103) == 0x2baa && plcAsked(p, 22, 103) == 1 &&
               plcLogged(p) == 1,
           "bits of a register: FC22, 0x%x", plcRegister(p, 103));
    plcForget(p);
    for (i = 8; i < 32; i++)
        putBit(w, 400 + i / 8, i % 8, i % 2);
    sendOrders(w);
    UNTIL(w, w->all.writes == 5 && idle(w));
    for (i = 8, good = 1; i < 32; i++)
        good &= plcCoil(p, i) == i % 2;
    testOk(good && plcCoil(p, 6) == 1 && plcCoil(p, 33) == 1 &&
               plcLog(p, 0).count == 24 && plcLogged(p) == 1,
           "coils: one FC15");
    plcForget(p);
    w->options.singleWrite = 1;
    setOptions(w);
    putBit(w, 400, 0, 0);
    putRegister(w, 0, 77);
    sendOrders(w);
    UNTIL(w, w->all.writes == 7 && idle(w));
    testOk(plcCoil(p, 0) == 0 && plcRegister(p, 100) == 77 && plcAsked(p, 5, 0) == 1 &&
               plcAsked(p, 6, 100) == 1,
           "singleWrite: FC5 and FC6");
    plcOneRule(p, 16, 0, 999, refuses, 1);
    w->all.exceptions = 0;
    for (i = 0; i < 5; i++)
        putRegister(w, i, 0x600 + i);
    sendOrders(w);
    UNTIL(w, w->all.writes == 12 && idle(w));
    testOk(plcRegister(p, 100) == 0x600 && plcRegister(p, 104) == 0x604 &&
               w->all.exceptions,
           "singleWrite, and no FC16: one by one");
    w->all.exceptions = 0;
    testOk(!w->all.outFaults && !w->all.lost && !w->log[0] && w->all.exceptions == 0,
           "no faults, nothing to log");
    worldDestroy(w);
    plcDestroy(p);
}

static void testLastValue(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "", "holding 0 10", 1);
    unsigned i;

    start(w, NULL, NULL);
    UNTIL(w, w->all.shown);
    plcForget(p);
    plcOneRule(p, 16, 0, 9, holdsBack, 0);
    putRegister(w, 1, 1);
    sendOrders(w);
    WAIT_FOR(plcAsked(p, 16, 1) == 1);
    take(w);
    testOk(!idle(w), "under way");
    for (i = 2; i <= 50; i++) {
        putRegister(w, 1, i);
        sendOrders(w);
    }
    putRegister(w, 2, 99);
    sendOrders(w);
    plcSetRules(p, NULL, 0);
    epicsEventSignal(p->release);
    UNTIL(w, w->all.writes == 2 && idle(w));
    testOk(plcRegister(p, 1) == 50 && plcRegister(p, 2) == 99 && plcLogged(p) == 2,
           "fifty puts while a request is under way: one more request, the last value");
    worldDestroy(w);
    plcDestroy(p);
}

static void testBisect(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "", "holding 0 100, coils 0 50", 1);
    epicsUInt8 joined[213] = {0};
    unsigned i, good;
    int faulty;

    joined[81] = joined[82] = joined[83] = 1; /* registers 40 and 41 are one value */
    start(w, NULL, joined);
    UNTIL(w, w->all.shown);
    {
        plcRule rules[] = {
            {16, 41, 41, refuses, 3, 0},
            {16, 70, 70, refuses, 2, 0},
            {15, 20, 20, refuses, 2, 0}
        };
        plcSetRules(p, rules, 3);
    }
    for (i = 0; i < 100; i++)
        putRegister(w, i, i);
    for (i = 0; i < 50; i++)
        putBit(w, 200 + i / 8, i % 8, 1);
    sendOrders(w);
    UNTIL(w, idle(w) && plcCoil(p, 49));
    for (i = 0, good = 1; i < 100; i++)
        if (i != 40 && i != 41 && i != 70)
            good &= plcRegister(p, i) == i && !fault(w->outFaults, 2 * i, 2)[0];
    testOk(good, "all registers are written but those that the PLC refuses");
    testOk(plcRegister(p, 40) == 0x1028 &&
               strcmp(fault(w->outFaults, 80, 2),
                      "PLC: exception 3, illegal data value") == 0 &&
               strcmp(fault(w->outFaults, 82, 2),
                      "PLC: exception 3, illegal data value") == 0,
           "a value of two registers is one: %s", fault(w->outFaults, 80, 2));
    testOk(strcmp(fault(w->outFaults, 140, 2),
                  "PLC: exception 2, illegal data address") == 0,
           "another reason for another one: %s", fault(w->outFaults, 140, 2));
    for (i = 0, good = 1; i < 50; i++) {
        epicsUInt8 bit = 1 << i % 8;
        char reason[PLC_REASON_SIZE];

        faulty = plcFaultsFind(w->outFaults, 200 + i / 8, 1, &bit, reason);
        good &= faulty == (i == 20) && (i == 20 || plcCoil(p, i) == 1);
    }
    testOk(good, "of the coils, only one is faulty");
    testOk(w->all.outFaults &&
               strstr(w->log, "write of holding 40 to 41: PLC: exception 3"),
           "log: %s", w->log);
    plcSetRules(p, NULL, 0);
    putRegister(w, 70, 7);
    sendOrders(w);
    UNTIL(w, !fault(w->outFaults, 140, 2)[0]);
    testOk(!fault(w->outFaults, 140, 2)[0] && fault(w->outFaults, 80, 2)[0],
           "a fault ends when that register is written, and no other one");
    worldDestroy(w);
    plcDestroy(p);
}

static void testCodes(void)
{
    static const int codes[] = {1, 2, 3, 4, 5, 6, 7, 8, 10, 11, 0x80, 0xff};
    plc *p = plcCreate();
    world *w = worldCreate(p, "", "holding 0 4", 1);
    size_t i;

    start(w, NULL, NULL);
    UNTIL(w, w->all.shown);
    for (i = 0; i < COUNT(codes); i++) {
        char text[40], expected[PLC_REASON_SIZE];

        plcExceptionText(codes[i], text, sizeof(text));
        epicsSnprintf(expected, sizeof(expected), "PLC: %.34s", text);
        if (codes[i] == 1)
            strcpy(expected, "PLC has no FC16: set singleWrite=on");
        plcOneRule(p, 16, 0, 9, refuses, codes[i]);
        if (codes[i] == 5) { /* those that are asked again */
            w->options.requestTimeout = 1000;
            setOptions(w);
        }
        if (codes[i] == 7) {
            w->options.requestTimeout = PATIENCE_S * 1000;
            setOptions(w);
        }
        plcForget(p);
        putRegister(w, 0, (unsigned)i);
        sendOrders(w);
        UNTIL(w, idle(w) && strcmp(fault(w->outFaults, 0, 2), expected) == 0);
        testOk(strcmp(fault(w->outFaults, 0, 2), expected) == 0 && !w->all.lost, "%s",
               fault(w->outFaults, 0, 2));
    }
    for (i = 5; i <= 6; i++) {
        plcRule rule = {16, 0, 9, refuses, (int)i, 2};

        plcSetRules(p, &rule, 1);
        plcForget(p);
        putRegister(w, 0, 50 + (unsigned)i);
        sendOrders(w);
        UNTIL(w, idle(w) && plcRegister(p, 0) == 50 + i &&
                     !fault(w->outFaults, 0, 2)[0]);
        testOk(plcRegister(p, 0) == 50 + i && plcAsked(p, 16, 0) == 3 &&
                   !fault(w->outFaults, 0, 2)[0],
               "exception %d twice: asked again, then it is done", (int)i);
    }
    worldDestroy(w);
    plcDestroy(p);
}

static void testNoMaskWrite(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "", "holding 0 10", 1);

    plcOneRule(p, 22, 0, 9, refuses, 1);
    start(w, NULL, NULL);
    UNTIL(w, w->all.shown);
    putBit(w, 1, 0, 1);
    sendOrders(w);
    UNTIL(w, idle(w) && w->all.outFaults);
    testOk(strcmp(fault(w->outFaults, 1, 1), "PLC has no FC22: set maskWrite=rmw") == 0,
           "%s", fault(w->outFaults, 1, 1));
    putBit(w, 3, 0, 1);
    sendOrders(w);
    UNTIL(w, idle(w) && fault(w->outFaults, 3, 1)[0]);
    testOk(plcAsked(p, 22, 0) == 1 && plcAsked(p, 22, 1) == 0 &&
               fault(w->outFaults, 3, 1)[0],
           "the PLC is not asked again");
    w->options.readModifyWrite = 1;
    setOptions(w);
    plcForget(p);
    plcSetRegister(p, 0, 0xff00);
    putBit(w, 1, 0, 1);
    putBit(w, 0, 7, 0);
    sendOrders(w);
    UNTIL(w, w->all.writes == 1 && idle(w));
    testOk(plcRegister(p, 0) == 0x7f01 && plcAsked(p, 3, 0) == 1 &&
               plcAsked(p, 6, 0) == 1 && !fault(w->outFaults, 0, 2)[0],
           "maskWrite=rmw: read, modify, write: 0x%x", plcRegister(p, 0));
    plcOneRule(p, 6, 0, 9, refuses, 2);
    putBit(w, 5, 0, 1);
    sendOrders(w);
    UNTIL(w, idle(w) && fault(w->outFaults, 5, 1)[0]);
    testOk(strcmp(fault(w->outFaults, 5, 1), "PLC: exception 2, illegal data address") ==
               0,
           "and its refusal: %s", fault(w->outFaults, 5, 1));
    plcSetRules(p, NULL, 0);
    start(w, NULL, NULL);
    UNTIL(w, w->all.shown);
    putBit(w, 3, 0, 1);
    sendOrders(w);
    UNTIL(w, w->all.writes == 1);
    testOk(plcAsked(p, 22, 1) == 1, "with a new connection FC22 is tried again");
    worldDestroy(w);
    plcDestroy(p);
}

/* --- Outputs as the PLC has them -------------------------------------------------- */

static void testShown(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "", "holding 0 4, coils 0 8", 1);
    epicsUInt8 hidden[9];
    unsigned asked;
    int shown;

    w->options.readPeriod = 5;
    setOptions(w);
    start(w, NULL, NULL);
    UNTIL(w, w->all.shown);
    testOk(get16(w->output + 6) == 0x1003 && w->output[8] == 0x49, "shown at connect");
    plcSetRegister(p, 3, 0x55aa);
    UNTIL(w, get16(w->output + 6) == 0x55aa);
    testOk(get16(w->output + 6) == 0x55aa, "shown again when the PLC has changed it");
    w->options.readPeriod = 0;
    setOptions(w);
    UNTIL(w, idle(w));
    plcOneRule(p, 16, 0, 9, holdsBack, 0);
    putRegister(w, 0, 1);
    sendOrders(w);
    WAIT_FOR(plcAsked(p, 16, 0) == 1);
    w->options.readPeriod = 5;
    setOptions(w);
    putRegister(w, 0, 2);
    sendOrders(w);
    plcOneRule(p, 16, 0, 9, replies, 0);
    epicsEventSignal(p->release);
    take(w);
    shown = w->all.shown;
    UNTIL(w, w->all.shown > shown && w->all.writes == 2);
    testOk(get16(w->output) == 2, "what is on its way is shown as it will be");
    plcOneRule(p, 1, 0, 9, refuses, 2);
    UNTIL(w, w->all.unread[0]);
    shown = w->all.shown;
    UNTIL(w, w->all.shown > shown && strstr(w->log, "read of"));
    testOk(strcmp(w->all.unread, "PLC: exception 2, illegal data address") == 0 &&
               strstr(w->log, "read of coils 0 to 7: PLC: exception 2") &&
               plcModbusHidden(w->modbus, hidden) == 1 && hidden[7] == 0 && hidden[8] == 0xff,
           "some not shown any more, the others are: %s", w->all.unread);
    w->all.unread[0] = 0;
    plcOneRule(p, 0, 0, 9, refuses, 4);
    UNTIL(w, w->all.unread[0]);
    shown = w->all.shown;
    testOk(strcmp(w->all.unread, "PLC: exception 4, device failure") == 0 &&
               strstr(w->log, "outputs cannot be read: PLC: exception 4"),
           "not shown any more: %s", w->all.unread);
    plcSetRules(p, NULL, 0);
    UNTIL(w, w->all.shown > shown && plcModbusHidden(w->modbus, hidden) == 0);
    testOk(w->all.shown > shown, "and all shown again");
    w->all.unread[0] = 0;
    asked = plcAsked(p, 1, 0);
    plcOneRule(p, 1, 0, 9, refuses, 2);
    WAIT_FOR(plcAsked(p, 1, 0) > asked + 4); /* and nobody takes the news */
    take(w);
    testOk(strcmp(w->all.unread, "PLC: exception 2, illegal data address") == 0,
           "what is read again before anybody knows why it was refused keeps the reason: %s", w->all.unread);
    worldDestroy(w);
    plcDestroy(p);
}

static void testHeartbeat(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "", "holding 0 4", 1);
    unsigned first;

    w->options.heartbeatRegister = 900;
    w->options.heartbeat = 3;
    setOptions(w);
    plcSetRegister(p, 900, 0);
    start(w, NULL, NULL);
    UNTIL(w, plcRegister(p, 900) >= 3);
    first = plcRegister(p, 900);
    UNTIL(w, plcRegister(p, 900) > first + 2);
    testOk(plcAsked(p, 6, 900) >= plcRegister(p, 900) && plcRegister(p, 900) > first + 2,
           "the heartbeat register counts up, one by one");
    testOk(plcLog(p, 0).function == 3, "the outputs are read first");
    plcOneRule(p, 6, 900, 900, refuses, 2);
    UNTIL(w, w->log[0]);
    testOk(strcmp(w->log,
                  "heartbeat register 900: PLC: exception 2, illegal data address; ") ==
               0,
           "refused: %s", w->log);
    plcSetRules(p, NULL, 0);
    UNTIL(w, strstr(w->log, "again"));
    testOk(!w->all.lost && strstr(w->log, "the PLC takes it again"), "and taken again");
    worldDestroy(w);
    plcDestroy(p);
}

/* --- Lost ------------------------------------------------------------------------- */

static const struct {
    plcAct act;
    double timeout;
    const char *why;
    int late;
} losses[] = {
    {isSilent,      50,                "no answer for 50 ms",                   1},
    {isSilent,      1100,              "no answer for 1.1 s",                   1},
    {stopsWithin,   1000,              "answer is not complete after 1.0 s",    1},
    {dribbles,      1000,              "answer is not complete after 1.0 s",    1},
    {closes,        PATIENCE_S * 1000, "connection closed by PLC",              0},
    {closesWithin,  PATIENCE_S * 1000, "closed by PLC within an answer",        0},
    {wrongNumber,   PATIENCE_S * 1000, "bad answer: wrong transaction number",  0},
    {wrongProtocol, PATIENCE_S * 1000, "bad answer: no Modbus/TCP",             0},
    {wrongUnit,     PATIENCE_S * 1000, "bad answer: unit 8 instead of 7",       0},
    {wrongFunction, PATIENCE_S * 1000, "bad answer: function 23 instead of 16", 0},
    {wrongLength,   PATIENCE_S * 1000, "bad answer: too short",                 0},
    {wrongHeader,   PATIENCE_S * 1000, "bad answer: length 65286",              0},
    {wrongEcho,     PATIENCE_S * 1000, "bad answer: address 3, not 2",          0},
};

static void testLosses(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "", "holding 0 10", 1);
    size_t i;
    int good;

    for (i = 0; i < COUNT(losses); i++) {
        plcSetRules(p, NULL, 0);
        w->options.requestTimeout = PATIENCE_S * 1000;
        setOptions(w);
        start(w, NULL, NULL);
        UNTIL(w, w->all.shown);
        putRegister(w, 2, (unsigned)i);
        sendOrders(w);
        UNTIL(w, idle(w) && w->all.writes == 1);
        w->options.requestTimeout = losses[i].timeout;
        setOptions(w);
        plcOneRule(p, 16, 0, 9, losses[i].act, 0);
        putRegister(w, 2, 0x100);
        sendOrders(w);
        UNTIL(w, w->all.lost);
        testOk(w->all.lost && strcmp(w->all.why, losses[i].why) == 0 &&
                   w->all.timeouts == (unsigned)losses[i].late,
               "lost: %s", w->all.why);
        testOk(strcmp(fault(w->outFaults, 4, 2), losses[i].why) == 0,
               "the write that was under way is faulty, for the same reason");
        stop(w);
    }
    /* A PLC that has taken a value, and does not say so */
    plcSetRules(p, NULL, 0);
    start(w, NULL, NULL);
    UNTIL(w, w->all.shown);
    plcOneRule(p, 16, 0, 9, closesWithin, 0);
    putRegister(w, 2, 0x101);
    putRegister(w, 3, 0x102);
    sendOrders(w);
    UNTIL(w, w->all.lost && plcRegister(p, 2) == 0x101);
    stop(w);
    plcSetRegister(p, 3, 0);
    plcSetRules(p, NULL, 0);
    good = fault(w->outFaults, 4, 2)[0] && fault(w->outFaults, 6, 2)[0];
    start(w, NULL, NULL);
    UNTIL(w, w->all.shown);
    testOk(good && w->all.outFaults && !fault(w->outFaults, 4, 2)[0] &&
               fault(w->outFaults, 6, 2)[0],
           "the fault ends where the PLC shows the value, and only there");
    /* Reads, and a PLC that closes when nobody asks */
    plcOneRule(p, 3, 0, 9, wrongLength, 0);
    start(w, NULL, NULL);
    UNTIL(w, w->all.lost);
    testOk(strcmp(w->all.why, "bad answer: too short") == 0, "a short read: %s",
           w->all.why);
    plcSetRules(p, NULL, 0);
    start(w, NULL, NULL);
    UNTIL(w, w->all.shown);
    plcHangUp(p);
    putRegister(w, 4, 0x303);
    sendOrders(w);
    UNTIL(w, plcRegister(p, 4) == 0x303 && idle(w));
    testOk(!w->all.lost && !fault(w->outFaults, 8, 2)[0],
           "closed while nobody asks: the next request has a new connection");
    plcOneRule(p, 16, 0, 9, answersTwice, 0);
    for (i = 0; i < 3; i++) {
        putRegister(w, 4, 0x304 + (unsigned)i);
        sendOrders(w);
        UNTIL(w, plcRegister(p, 4) == 0x304 + i && idle(w));
    }
    testOk(!w->all.lost && !fault(w->outFaults, 8, 2)[0], "an answer that comes twice is dropped");
    worldDestroy(w);
    plcDestroy(p);
}

/* --- Start, stop, end ------------------------------------------------------------- */

static void testStop(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "holding 0 10 every 5", "holding 20 10", 1);
    plcNews news;
    int i, silent = 1;

    plcOneRule(p, 0, 0, 65535, isSilent, 0);
    for (i = 0; i < 20; i++) {
        start(w, NULL, NULL);
        WAIT_FOR(plcAsked(p, 3, 20) == (unsigned)i + 1);
        plcModbusStop(w->modbus);
        silent &= !plcModbusTake(w->modbus, &news, w->input, w->output);
        toolClose(w->socket);
        w->socket = INVALID_SOCKET;
        WAIT_FOR(!plcConnected(p));
        silent &= !plcModbusTake(w->modbus, &news, w->input, w->output) && !news.lost;
    }
    testOk(!plcConnected(p), "stopped during a request, 20 times: it does not wait");
    testOk(silent, "and there is no news of it");
    plcSetRules(p, NULL, 0);
    start(w, NULL, NULL);
    UNTIL(w, w->all.blocks >= 3);
    testOk(w->all.blocks >= 3 && w->all.shown == 1 && !w->all.lost, "started again");
    worldDestroy(w);
    plcDestroy(p);
}

/* Orders of an old connection never reach a new one. */
static void testOldOrders(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "", "holding 0 10", 1);
    int i, bad = 0;

    for (i = 0; i < 200; i++) {
        start(w, NULL, NULL);
        if (i % 2)
            UNTIL(w, w->all.shown);
        plcSetRegister(p, 5, 0);
        putRegister(w, 4, (unsigned)i);
        sendOrders(w);
        putRegister(w, 5, 0xdead);
        plcModbusStop(w->modbus);
        sendOrders(w);
        plcModbusStart(w->modbus, w->socket, NULL, NULL);
        stop(w);
        bad += plcRegister(p, 5) == 0xdead;
    }
    start(w, NULL, NULL);
    UNTIL(w, w->all.shown && idle(w));
    testOk(!bad && plcRegister(p, 5) != 0xdead,
           "what was ordered before the start is void");
    worldDestroy(w);
    plcDestroy(p);
}

static void testDestroy(void)
{
    plc *p = plcCreate();
    world *w;
    int i;

    worldDestroy(worldCreate(p, "holding 0 10", "", 1));
    testPass("destroyed before it was started");
    plcOneRule(p, 0, 0, 65535, isSilent, 0);
    for (i = 0; i < 20; i++) {
        w = worldCreate(p, "holding 0 10", "holding 0 10", 1);
        start(w, NULL, NULL);
        if (i % 2)
            WAIT_FOR(plcAsked(p, 3, 0) == 1);
        worldDestroy(w);
        WAIT_FOR(!plcConnected(p));
        plcForget(p);
    }
    testPass("destroyed during a request");
    plcDestroy(p);
}

/* --- Values that come to be known later ---------------------------------------------- */

static void testNewJoined(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "holding 0 130 every 5", "", 1);
    epicsUInt8 joined[260] = {0};
    static const plcSeen whole = {3, 0, 124}, rest = {3, 124, 6};
    unsigned i, n = 0;

    start(w, NULL, NULL);
    UNTIL(w, w->all.blocks);
    testOk(plcAsked(p, 3, 124) && plcLog(p, 0).count == 125, "125 registers at once");
    memset(joined + 249, 1, 3); /* registers 124 and 125 */
    plcModbusJoined(w->modbus, joined, NULL);
    UNTIL(w, isSame(plcLog(p, plcLogged(p) - 1), rest));
    plcForget(p);
    UNTIL(w, plcLogged(p) >= 20);
    for (i = 0; i < 20; i++)
        n += isSame(plcLog(p, i), whole) || isSame(plcLog(p, i), rest);
    testOk(n == 20, "a new record with a value across the limit: it stays whole");
    testOk(!w->all.lost && w->all.blocks > 1, "and blocks go on");
    worldDestroy(w);
    plcDestroy(p);
}

/* --- A PLC that answers that it is busy: the worker rests and asks again ----------- */

static void destroyThread(void *arg)
{
    void **both = arg;

    worldDestroy(both[0]);
    epicsEventSignal(both[1]);
}

/* Returns 0 when it does not come to an end. */
static int endsInTime(world *w)
{
    void *both[2] = {w, epicsEventMustCreate(epicsEventEmpty)};

    epicsThreadMustCreate("destroy", epicsThreadPriorityMedium,
                          epicsThreadGetStackSize(epicsThreadStackMedium), destroyThread,
                          both);
    if (epicsEventWaitWithTimeout(both[1], PATIENCE_S) != epicsEventOK)
        return 0;
    epicsEventDestroy(both[1]);
    return 1;
}

static void testRest(void)
{
    plc *p = plcCreate();
    world *w;
    int i, ends = 1, good = 0;

    for (i = 0; i < 40 && ends; i++) {
        plcForget(p);
        plcOneRule(p, 0, 0, 65535, refuses, i % 2 ? 5 : 6);
        w = worldCreate(p, "holding 0 10 every 5", "holding 20 10", 1);
        start(w, NULL, NULL);
        WAIT_FOR(plcLogged(p) > (unsigned)i % 5);
        ends = endsInTime(w);
        WAIT_FOR(!plcConnected(p));
    }
    testOk(ends, "destroyed while it waits for a PLC that is busy, %d times", i);
    if (!ends)
        testAbort("it does not come to an end");
    w = worldCreate(p, "holding 0 10 every 5", "holding 20 10", 1);
    for (i = 0; i < 20; i++) {
        plcForget(p);
        plcOneRule(p, 0, 0, 65535, refuses, 6);
        start(w, NULL, NULL);
        WAIT_FOR(plcLogged(p) >= 2);
        stop(w);
        WAIT_FOR(!plcConnected(p));
        plcSetRules(p, NULL, 0);
        start(w, NULL, NULL);
        UNTIL(w, w->all.blocks);
        good += w->all.blocks > 0;
        stop(w);
        WAIT_FOR(!plcConnected(p));
    }
    testOk(good == 20, "stopped and started anew while it waits: %d of 20", good);
    worldDestroy(w);
    plcDestroy(p);
}

/* What is ordered while something else waits for the PLC is not forgotten. */
static void testOrderInRest(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "", "holding 20 10", 1);
    unsigned i;

    w->options.requestTimeout = 500;
    w->options.heartbeatRegister = 900;
    w->options.heartbeat = 3600000;
    setOptions(w);
    plcOneRule(p, 6, 900, 900, refuses, 6);
    start(w, NULL, NULL);
    WAIT_FOR(plcAsked(p, 6, 900) >= 2);
    for (i = 0; i < 10; i++) {
        putRegister(w, i, 0xabc0 + i);
        sendOrders(w);
        epicsThreadSleep(0.001); /* the pace of the writer */
    }
    UNTIL(w, plcRegister(p, 29) == 0xabc9);
    testOk(plcRegister(p, 29) == 0xabc9 && plcRegister(p, 20) == 0xabc0,
           "an order that comes while the heartbeat waits is written");
    worldDestroy(w);
    plcDestroy(p);
}

/* --- The clock of the machine is set back ----------------------------------------------- */

static void testClock(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "holding 0 10 every 5", "holding 20 10", 1);
    unsigned before;

    start(w, NULL, NULL);
    UNTIL(w, w->all.blocks);
    faultClockBack(1);
    before = plcLogged(p);
    WAIT_FOR(plcLogged(p) > before + 50);
    testOk(plcLogged(p) > before + 50, "the clock is set back: it polls on");
    plcOneRule(p, 0, 0, 65535, refuses, 6);
    before = plcLogged(p);
    WAIT_FOR(plcLogged(p) > before + 5);
    testOk(plcLogged(p) > before + 5, "and asks a PLC that is busy again");
    faultClockBack(0);
    worldDestroy(w);
    plcDestroy(p);
}

/* --- No thread for it --------------------------------------------------------------- */

static void testNoThread(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "holding 0 10 every 5", "holding 20 10", 1);
    int i, good = 0;

    faultNoThreads(1);
    for (i = 0; i < 3; i++) {
        start(w, NULL, NULL);
        UNTIL(w, w->all.lost);
        good += strcmp(w->all.why, "no thread for Modbus") == 0;
        stop(w);
    }
    testOk(good == 3, "no thread: lost at once: %s", w->all.why);
    faultNoThreads(0);
    start(w, NULL, NULL);
    UNTIL(w, w->all.blocks);
    testOk(w->all.blocks && !w->all.lost, "as soon as there is one: connected");
    worldDestroy(w);
    plcDestroy(p);
}

/* Writes and polls at once: each of them goes on. */
static void testBusy(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "holding 0 125 every 1, holding 200 125 every 1",
                           "holding 500 100", 1);
    unsigned i;

    start(w, NULL, NULL);
    UNTIL(w, w->all.shown);
    for (i = 1; w->all.blocks < 200 && i < 200000; i++) {
        putRegister(w, i % 100, i);
        sendOrders(w);
        take(w);
    }
    UNTIL(w, idle(w) && w->all.blocks >= 200);
    testOk(w->all.blocks >= 200 && w->all.writes > 20 && !w->all.lost &&
               plcRegister(p, 500 + (i - 1) % 100) == ((i - 1) & 0xffff),
           "%u puts, %u writes, %u blocks", i - 1, w->all.writes, w->all.blocks);
    worldDestroy(w);
    plcDestroy(p);
}

/* --- Descriptors ------------------------------------------------------------------ */

enum { fillers = 1200 };

static void openAll(int *fds)
{
    int i;

    for (i = 0; i < fillers; i++)
        fds[i] = open("/dev/null", O_RDONLY | O_CLOEXEC);
}

static void closeAll(int *fds)
{
    int i;

    for (i = 0; i < fillers; i++)
        close(fds[i]);
}

static void testDescriptors(void)
{
    plc *p = plcCreate();
    world *w = worldCreate(p, "holding 0 10", "holding 20 10", 1), *late;
    struct rlimit limit;
    int fds[fillers], more[fillers], low, keep, pair[2];

    getrlimit(RLIMIT_NOFILE, &limit);
    limit.rlim_cur = limit.rlim_max;
    if (limit.rlim_max < 3 * fillers || setrlimit(RLIMIT_NOFILE, &limit)) {
        testSkip(3, "not allowed to open so many descriptors");
        worldDestroy(w);
        plcDestroy(p);
        return;
    }
    low = connectTo(p);
    WAIT_FOR(plcConnected(p)); /* the server's descriptor must be a low one */
    openAll(fds);
    w->socket = fcntl(low, F_DUPFD, 1100);
    dup2(fds[0], low);
    plcModbusStart(w->modbus, w->socket, NULL, NULL);
    UNTIL(w, w->all.blocks && w->all.shown);
    putRegister(w, 3, 0x7777);
    sendOrders(w);
    UNTIL(w, w->all.writes == 1);
    testOk(w->socket >= 1100 && w->all.blocks && plcRegister(p, 23) == 0x7777 &&
               !w->all.lost,
           "%d descriptors are open: reads and writes", fillers);
    keep = fcntl(w->socket, F_DUPFD, 1100); /* the server's next descriptor must be a low one, too */
    worldDestroy(w);
    openAll(more);
    late = worldCreate(p, "holding 0 10", "holding 20 10", 1);
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair))
        testAbort("no sockets");
    plcModbusStart(late->modbus, pair[0], NULL, NULL);
    UNTIL(late, late->all.lost);
    testOk(strcmp(late->all.why, "no descriptor below 1024 for Modbus") == 0,
           "without a low one: %s", late->all.why);
    plcModbusStop(late->modbus);
    closeAll(fds);
    closeAll(more);
    close(keep);
    close(low);
    close(pair[0]);
    close(pair[1]);
    start(late, NULL, NULL);
    UNTIL(late, late->all.blocks);
    testOk(late->all.blocks && !late->all.lost, "as soon as there is one: connected");
    worldDestroy(late);
    plcDestroy(p);
}

MAIN(modbusTest)
{
    testPlan(116);
    testInputs();
    testLittleEndian();
    testPeriods();
    testRefusedRange();
    testAllRefused();
    testWrites();
    testLastValue();
    testBisect();
    testCodes();
    testNoMaskWrite();
    testShown();
    testHeartbeat();
    testLosses();
    testStop();
    testOldOrders();
    testDestroy();
    testBusy();
    testNewJoined();
    testRest();
    testOrderInRest();
    testNoThread();
    testClock();
    testDescriptors();
    return testDone();
}
