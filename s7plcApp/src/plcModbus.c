/* The worker of a Modbus PLC; see plcModbus.h.
 *
 * The worker's thread alone uses `session` and calls libmodbus, never with the lock held.
 * What goes between it and the station's thread is in the structure under the lock. Each
 * start and stop makes a new generation: the worker gives nothing away, and takes
 * nothing, when its session is of an older one.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsEvent.h>
#include <epicsMutex.h>
#include <epicsStdio.h>
#include <epicsString.h>
#include <epicsThread.h>

#include "plcModbus.h"
#include "plcModbusWire.h"

#define NEVER (~(epicsUInt64)0)
#define MS 1000000ull /* ns */

enum {
    busyPause = 20, /* ms until a PLC that is busy is asked again */
    maskMax = 256   /* bytes of the image in one piece of a request, at most 251 */
};

/* A read that comes back by its period */
typedef struct turn {
    plcRequest request;
    int output;      /* of the output ranges */
    epicsUInt64 due; /* ns */
    int refused;     /* by the PLC, the last time */
} turn;

/* One connection, the worker's own. */
typedef struct session {
    unsigned generation;
    int on;
    char lost[PLC_REASON_SIZE]; /* why the connection is; "": it is not */
    plcModbusOptions options;   /* a copy, made before each step */
    turn *turns;
    unsigned turnCount, room;
    epicsUInt64 round; /* reads due by then belong to this round; 0: none */
    int inputsRead;    /* some, in this round */
    int inputsTried;   /* all of them, once */
    int outputsTried;
    char refusal[PLC_REASON_SIZE]; /* of an output range, in this round; "": none */
    char unread[PLC_REASON_SIZE];  /* why the outputs are not shown; "": they are */
    int knowsIn, knowsOut;         /* where values lie */
    int noMaskWrite;               /* the PLC has no FC22 */
    epicsUInt64 beat;              /* ns, when the heartbeat is due */
    int beatRefused;
} session;

struct plcModbus {
    char name[40];
    plcModbusSetup setup;
    plcModbusWire *wire;
    epicsEventId event;
    epicsThreadId thread;

    epicsMutexId lock; /* guards from here on */
    int ending;
    plcModbusOptions options;
    unsigned generation;
    int running;   /* started and not stopped */
    SOCKET handed; /* for the worker; INVALID_SOCKET: none */
    epicsUInt8 *glueIn, *glueOut;
    int knowsIn, knowsOut;    /* glue was given */
    epicsUInt8 *order, *owed; /* newest values, and which bits have not left */
    int ordered;              /* some bits of owed are set */
    int writing;              /* a write is under way */
    plcModbusNews news;
    int hasNews;
    unsigned moreLog; /* lines for which there was no room */
    epicsUInt8 *inNews, *outNews;
    epicsUInt8 *healed;       /* bits of inNews that were refused before */
    epicsUInt8 *healing;      /* the same of the image that was taken last: their fault ends
                               * when the records have it */
    int someHealed, someHealing;

    /* the worker's own */
    session session;
    epicsUInt8 *in, *out;         /* the images as the PLC has them */
    epicsUInt8 *leaving, *values; /* bits that a plan is still to write, their values */
    epicsUInt8 *unsure;           /* bits under way when a connection ended */
    epicsUInt8 *ownGlueIn, *ownGlueOut;
    plcPiece *pieces;
    epicsUInt16 beatCount;
    epicsUInt16 registers[PLC_READ_REGISTERS];
    epicsUInt8 bits[PLC_READ_BITS]; /* one each, as libmodbus has them */
};

static void worker(void *arg);

/* --- Life ------------------------------------------------------------------------- */

static void signalWorker(void *arg)
{
    plcModbus *m = arg;

    epicsEventSignal(m->event);
}

static void *zeroed(size_t size)
{
    return callocMustSucceed(1, size + 1, "plcModbusCreate");
}

plcModbus *plcModbusCreate(const plcModbusSetup *setup)
{
    plcModbus *m = zeroed(sizeof(*m));
    unsigned most =
        setup->inputCount > setup->outputCount ? setup->inputCount : setup->outputCount;

    epicsSnprintf(m->name, sizeof(m->name), "%s-mb", setup->name);
    m->setup = *setup;
    m->setup.name = m->name;
    m->event = epicsEventMustCreate(epicsEventEmpty);
    m->lock = epicsMutexMustCreate();
    m->options.requestTimeout = 1000;
    m->options.readPeriod = 1000;
    m->options.heartbeatRegister = -1;
    m->handed = INVALID_SOCKET;
    m->glueIn = zeroed(setup->inSize);
    m->ownGlueIn = zeroed(setup->inSize);
    m->in = zeroed(setup->inSize);
    m->inNews = zeroed(setup->inSize);
    m->healed = zeroed(setup->inSize);
    m->healing = zeroed(setup->inSize);
    m->glueOut = zeroed(setup->outSize);
    m->ownGlueOut = zeroed(setup->outSize);
    m->out = zeroed(setup->outSize);
    m->outNews = zeroed(setup->outSize);
    m->order = zeroed(setup->outSize);
    m->owed = zeroed(setup->outSize);
    m->leaving = zeroed(setup->outSize);
    m->values = zeroed(setup->outSize);
    m->unsure = zeroed(setup->outSize);
    m->pieces = zeroed((most + 1) * sizeof(*m->pieces));
    m->wire = plcModbusWireCreate(setup->name, setup->unit, signalWorker, m);
    return m;
}

/* Ends the session that there is. The lock is held. */
static void endSession(plcModbus *m)
{
    m->generation++;
    m->running = 0;
    if (m->handed != INVALID_SOCKET)
        epicsSocketDestroy(m->handed);
    m->handed = INVALID_SOCKET;
    plcModbusWireCut(m->wire);
    memset(&m->news, 0, sizeof(m->news));
    m->hasNews = m->ordered = m->writing = 0;
    m->moreLog = 0;
    memset(m->owed, 0, m->setup.outSize);
    memset(m->healed, 0, m->setup.inSize);
    memset(m->healing, 0, m->setup.inSize);
    m->someHealed = m->someHealing = 0;
    if (m->setup.inFaults)
        plcFaultsClearAll(m->setup.inFaults); /* no data at all says it better */
}

void plcModbusDestroy(plcModbus *m)
{
    if (!m)
        return;
    epicsMutexMustLock(m->lock);
    m->ending = 1;
    endSession(m);
    epicsMutexUnlock(m->lock);
    if (m->thread) {
        epicsEventSignal(m->event);
        epicsThreadMustJoin(m->thread);
    }
    plcModbusWireDestroy(m->wire);
    epicsEventDestroy(m->event);
    epicsMutexDestroy(m->lock);
    free(m->glueIn);
    free(m->ownGlueIn);
    free(m->in);
    free(m->inNews);
    free(m->healed);
    free(m->healing);
    free(m->glueOut);
    free(m->ownGlueOut);
    free(m->out);
    free(m->outNews);
    free(m->order);
    free(m->owed);
    free(m->leaving);
    free(m->values);
    free(m->unsure);
    free(m->pieces);
    free(m->session.turns);
    free(m);
}

static void startThread(plcModbus *m)
{
    epicsThreadOpts options = EPICS_THREAD_OPTS_INIT;

    options.priority = epicsThreadPriorityMedium;
    options.stackSize = epicsThreadStackMedium;
    options.joinable = 1;
    m->thread = epicsThreadCreateOpt(m->name, worker, m, &options);
    if (!m->thread)
        cantProceed("plcModbus %s: cannot start its thread\n", m->name);
}

/* --- For the station's thread ----------------------------------------------------- */

void plcModbusSetOptions(plcModbus *m, const plcModbusOptions *options)
{
    epicsMutexMustLock(m->lock);
    m->options = *options;
    epicsMutexUnlock(m->lock);
    epicsEventSignal(m->event);
}

static int copyGlue(epicsUInt8 *to, const epicsUInt8 *from, size_t size)
{
    if (from)
        memcpy(to, from, size);
    return from != NULL;
}

void plcModbusStart(plcModbus *m, SOCKET socket, const epicsUInt8 *glueIn,
                    const epicsUInt8 *glueOut)
{
    int copy = fcntl(socket, F_DUPFD_CLOEXEC, 0), error = errno;

    epicsMutexMustLock(m->lock);
    endSession(m);
    m->running = 1;
    m->handed = copy;
    if (copy < 0) {
        m->news.lost = m->hasNews = 1;
        epicsSnprintf(m->news.why, sizeof(m->news.why), "%s", strerror(error));
    }
    m->knowsIn = copyGlue(m->glueIn, glueIn, m->setup.inSize);
    m->knowsOut = copyGlue(m->glueOut, glueOut, m->setup.outSize);
    if (!m->thread)
        startThread(m);
    epicsMutexUnlock(m->lock);
    epicsEventSignal(m->event);
    if (copy < 0)
        m->setup.wake(m->setup.arg);
}

void plcModbusStop(plcModbus *m)
{
    epicsMutexMustLock(m->lock);
    endSession(m);
    epicsMutexUnlock(m->lock);
    epicsEventSignal(m->event);
}

/* Bits of `from` that are set in the mask, into `to`. */
static void mix(epicsUInt8 *to, const epicsUInt8 *from, const epicsUInt8 *mask,
                size_t size)
{
    size_t i;

    for (i = 0; i < size; i++)
        if (mask[i])
            to[i] = (epicsUInt8)((to[i] & ~mask[i]) | (from[i] & mask[i]));
}

void plcModbusWrite(plcModbus *m, const void *image, const void *mask)
{
    const epicsUInt8 *bits = mask;
    size_t i, size = m->setup.outSize;

    epicsMutexMustLock(m->lock);
    mix(m->order, image, bits, size);
    for (i = 0; i < size; i++)
        m->owed[i] |= bits[i];
    if (m->news.shown)
        mix(m->outNews, image, bits, size); /* what it shows is older than that */
    m->ordered = 1;
    epicsMutexUnlock(m->lock);
    epicsEventSignal(m->event);
}

/* What was refused is good again, and the records have it: the caller has come back. The
 * lock is held. */
static void heal(plcModbus *m)
{
    if (!m->someHealing)
        return;
    if (plcFaultsClear(m->setup.inFaults, 0, m->setup.inSize, m->healing))
        m->news.inFaults = m->hasNews = 1;
    memset(m->healing, 0, m->setup.inSize);
    m->someHealing = 0;
}

/* The caller takes an image; with it what is good again in it. The lock is held. */
static void takeHealed(plcModbus *m)
{
    epicsUInt8 *none = m->healing;

    if (!m->someHealed)
        return;
    m->healing = m->healed;
    m->healed = none;
    m->someHealing = 1;
    m->someHealed = 0;
}

int plcModbusTake(plcModbus *m, plcModbusNews *news, void *input, void *output)
{
    int has, again;

    epicsMutexMustLock(m->lock);
    heal(m);
    if (m->news.blocks)
        takeHealed(m);
    has = m->hasNews;
    *news = m->news;
    news->idle = !m->ordered && !m->writing;
    if (m->news.blocks)
        memcpy(input, m->inNews, m->setup.inSize);
    if (m->news.shown)
        memcpy(output, m->outNews, m->setup.outSize);
    if (m->moreLog)
        epicsSnprintf(news->log + strlen(news->log),
                      sizeof(news->log) - strlen(news->log), " (and %u more)",
                      m->moreLog);
    memset(&m->news, 0, sizeof(m->news));
    m->hasNews = 0;
    m->moreLog = 0;
    again = m->someHealing;
    epicsMutexUnlock(m->lock);
    if (again)
        m->setup.wake(m->setup.arg);
    return has;
}

/* --- What the worker tells -------------------------------------------------------- */

/* Locks, if the session is still the one that counts. Returns 0 when it is not. */
static int enter(plcModbus *m)
{
    epicsMutexMustLock(m->lock);
    if (m->session.on && m->running && m->generation == m->session.generation)
        return 1;
    epicsMutexUnlock(m->lock);
    m->session.on = 0;
    return 0;
}

/* Ends what enter began; there is news. */
static void tell(plcModbus *m)
{
    m->hasNews = 1;
    epicsMutexUnlock(m->lock);
    m->setup.wake(m->setup.arg);
}

/* A line for the log; the lock is held. */
static void note(plcModbus *m, const char *format, ...) EPICS_PRINTF_STYLE(2, 3);

static void note(plcModbus *m, const char *format, ...)
{
    va_list args;

    if (m->news.log[0]) {
        m->moreLog++;
        return;
    }
    va_start(args, format);
    epicsVsnprintf(m->news.log, sizeof(m->news.log), format, args);
    va_end(args);
}

/* "holding 100" or "coils 0 to 9" */
static const char *where(const plcRequest *q, char text[40])
{
    if (q->count == 1)
        epicsSnprintf(text, 40, "%s %u", plcTableName(q->table), q->start);
    else
        epicsSnprintf(text, 40, "%s %u to %u", plcTableName(q->table), q->start,
                      q->start + q->count - 1);
    return text;
}

/* "PLC: exception 2, illegal data address" */
static void reasonOf(int code, char reason[PLC_REASON_SIZE])
{
    char text[PLC_REASON_SIZE];

    plcExceptionText(code, text, sizeof(text));
    epicsSnprintf(reason, PLC_REASON_SIZE, "PLC: %.34s", text);
}

/* The connection is of no use any more, for the reason in session.lost. What was to leave
 * on it has not left: that is a fault until it has. */
static void giveUp(plcModbus *m)
{
    size_t i;

    plcModbusWireCut(m->wire);
    if (enter(m)) {
        for (i = 0; i < m->setup.outSize; i++)
            m->leaving[i] |= m->owed[i];
        m->news.outFaults |= plcFaultsSet(m->setup.outFaults, 0, m->setup.outSize,
                                          m->leaving, m->session.lost);
        m->news.lost = 1;
        strcpy(m->news.why, m->session.lost);
        tell(m);
    }
    m->session.on = 0;
}

/* --- One request ------------------------------------------------------------------ */

/* What kind of request needs what of libmodbus; the values are in m->registers or
 * m->bits, for FC22 the AND mask and the OR mask. */
static int call(plcModbus *m, const plcRequest *q)
{
    modbus_t *context = plcModbusWireContext(m->wire);
    int start = (int)q->start, count = (int)q->count;

    switch (q->function) {
    case 1:
        return modbus_read_bits(context, start, count, m->bits);
    case 2:
        return modbus_read_input_bits(context, start, count, m->bits);
    case 3:
        return modbus_read_registers(context, start, count, m->registers);
    case 4:
        return modbus_read_input_registers(context, start, count, m->registers);
    case 5:
        return modbus_write_bit(context, start, m->bits[0]);
    case 6:
        return modbus_write_register(context, start, m->registers[0]);
    case 15:
        return modbus_write_bits(context, start, count, m->bits);
    case 16:
        return modbus_write_registers(context, start, count, m->registers);
    default:
        return modbus_mask_write_register(context, start, m->registers[0],
                                          m->registers[1]);
    }
}

static void countRequest(plcModbus *m, const plcExchange *x)
{
    m->news.requests++;
    m->news.exceptions += x->exception != 0;
    m->news.timeouts += x->timeout != 0;
    m->news.bytesOut += x->sent;
    m->news.bytesIn += x->received;
    if (x->latency > 0)
        m->news.latency = x->latency;
    if (x->latency > m->news.latencyMax)
        m->news.latencyMax = x->latency;
    m->hasNews = 1;
}

/* Returns 0, the code of an exception, or -1: the session is over. When that is because
 * the connection is lost, session.lost says why; `step` tells it. */
static int askOnce(plcModbus *m, const plcRequest *q)
{
    plcExchange x;
    int status;

    if (!enter(m))
        return -1;
    epicsMutexUnlock(m->lock);
    plcModbusWireTimeout(m->wire, m->session.options.requestTimeout);
    status = call(m, q);
    plcModbusWireLast(m->wire, &x);
    if (status < 0 && !x.lost && !x.exception) {
        x.lost = 1;
        epicsSnprintf(x.why, sizeof(x.why), "libmodbus: %.28s", modbus_strerror(errno));
    }
    if (!enter(m))
        return -1;
    countRequest(m, &x);
    epicsMutexUnlock(m->lock);
    strcpy(m->session.lost, x.why);
    return x.lost ? -1 : x.exception;
}

/* Waits, but not longer than the session lasts. Returns 0 when it has ended. */
static int rest(plcModbus *m, unsigned ms)
{
    epicsUInt64 end = epicsMonotonicGet() + ms * MS, now;

    while (enter(m)) {
        epicsMutexUnlock(m->lock);
        now = epicsMonotonicGet();
        if (now >= end)
            return 1;
        epicsEventWaitWithTimeout(m->event, (double)(end - now) / 1e9);
    }
    return 0;
}

/* As askOnce; a PLC that is busy is asked again for as long as a request may take. */
static int ask(plcModbus *m, const plcRequest *q)
{
    epicsUInt64 end =
        epicsMonotonicGet() + (epicsUInt64)(m->session.options.requestTimeout * MS);

    for (;;) {
        int status = askOnce(m, q);

        if ((status != 5 && status != 6) || epicsMonotonicGet() + busyPause * MS >= end)
            return status;
        if (!rest(m, busyPause))
            return -1;
    }
}

/* --- Bits and registers in an image ----------------------------------------------- */

static int isBits(plcTable table)
{
    return table == plcCoils || table == plcDiscrete;
}

static size_t pieceBytes(const plcRequest *q, const plcPiece *p)
{
    return isBits(q->table) ? (p->bit + p->count + 7) / 8 : (size_t)p->count * 2;
}

/* Which bits of its bytes belong to the piece. */
static void pieceMask(const plcRequest *q, const plcPiece *p, epicsUInt8 *mask)
{
    unsigned i;

    memset(mask, isBits(q->table) ? 0 : 0xff, pieceBytes(q, p));
    for (i = p->bit; isBits(q->table) && i < p->bit + p->count; i++)
        mask[i / 8] |= (epicsUInt8)(1 << i % 8);
}

static epicsUInt16 getRegister(const plcModbus *m, const epicsUInt8 *at)
{
    return m->setup.bigEndian ? (epicsUInt16)(at[0] << 8 | at[1])
                              : (epicsUInt16)(at[1] << 8 | at[0]);
}

static void putRegister(const plcModbus *m, epicsUInt8 *at, epicsUInt16 value)
{
    at[m->setup.bigEndian ? 0 : 1] = (epicsUInt8)(value >> 8);
    at[m->setup.bigEndian ? 1 : 0] = (epicsUInt8)value;
}

/* From m->registers or m->bits into the image. */
static void store(plcModbus *m, const plcRequest *q, const plcPiece *p, epicsUInt8 *image)
{
    epicsUInt8 *at = image + p->offset;
    unsigned i;

    for (i = 0; i < p->count; i++) {
        unsigned bit = p->bit + i;

        if (!isBits(q->table))
            putRegister(m, at + 2 * i, m->registers[p->first + i]);
        else if (m->bits[p->first + i])
            at[bit / 8] |= (epicsUInt8)(1 << bit % 8);
        else
            at[bit / 8] &= (epicsUInt8)~(1 << bit % 8);
    }
}

/* The other way round. */
static void load(plcModbus *m, const plcRequest *q, const plcPiece *p,
                 const epicsUInt8 *image)
{
    const epicsUInt8 *at = image + p->offset;
    unsigned i;

    for (i = 0; i < p->count; i++) {
        unsigned bit = p->bit + i;

        if (isBits(q->table))
            m->bits[p->first + i] = at[bit / 8] >> bit % 8 & 1;
        else
            m->registers[p->first + i] = getRegister(m, at + 2 * i);
    }
}

static unsigned inPieces(plcModbus *m, const plcRequest *q)
{
    return plcPlanPieces(m->setup.inputs, m->setup.inputCount, q, m->pieces,
                         m->setup.inputCount);
}

static unsigned outPieces(plcModbus *m, const plcRequest *q)
{
    return plcPlanPieces(m->setup.outputs, m->setup.outputCount, q, m->pieces,
                         m->setup.outputCount);
}

/* --- Writes ----------------------------------------------------------------------- */

/* A write's values are fetched when it leaves, so that they are the newest. Returns 0, or
 * -1 when the session is over. */
static int fetchValues(plcModbus *m, const plcRequest *q)
{
    unsigned i, n = outPieces(m, q);

    if (!enter(m))
        return -1;
    for (i = 0; i < n; i++) {
        const plcPiece *p = &m->pieces[i];
        epicsUInt8 mask[maskMax];
        size_t k, size = pieceBytes(q, p);

        pieceMask(q, p, mask);
        mix(m->values + p->offset, m->order + p->offset, mask, size);
        for (k = 0; k < size; k++) {
            size_t at = p->offset + k;

            if (q->function == 22) /* newer bits of the same register go with it */
                m->leaving[at] |= m->owed[at];
            m->owed[at] &= (epicsUInt8)~(mask[k] & m->leaving[at]);
        }
    }
    epicsMutexUnlock(m->lock);
    return 0;
}

/* The write is through: it was acknowledged (reason ""), or not. */
static void settle(plcModbus *m, const plcRequest *q, const char *reason)
{
    unsigned i, n = outPieces(m, q);
    int changed = 0;
    char text[40];

    if (!enter(m))
        return;
    for (i = 0; i < n; i++) {
        const plcPiece *p = &m->pieces[i];
        epicsUInt8 mask[maskMax];
        size_t k, size = pieceBytes(q, p);

        pieceMask(q, p, mask);
        for (k = 0; k < size; k++) {
            epicsUInt8 *unsure = &m->unsure[p->offset + k];

            mask[k] &= m->leaving[p->offset + k];
            m->leaving[p->offset + k] &= (epicsUInt8)~mask[k];
            *unsure &= (epicsUInt8)~mask[k];
            *unsure |= m->session.lost[0] ? mask[k] : 0;
        }
        if (reason[0]) {
            changed |= plcFaultsSet(m->setup.outFaults, p->offset, size, mask, reason);
        } else {
            changed |= plcFaultsClear(m->setup.outFaults, p->offset, size, mask);
            mix(m->out + p->offset, m->values + p->offset, mask, size);
        }
    }
    if (changed && reason[0] && !m->session.lost[0])
        note(m, "write of %s: %s", where(q, text), reason);
    m->news.writes += !reason[0];
    m->news.outFaults |= changed;
    tell(m);
}

/* Sets only some bits of a register. Returns as ask does. */
static int readModifyWrite(plcModbus *m, const plcRequest *q, epicsUInt16 mask,
                           epicsUInt16 value)
{
    plcRequest read = {3, q->table, q->start, 1, 0};
    plcRequest write = {6, q->table, q->start, 1, 0};
    int status = ask(m, &read);

    if (status)
        return status;
    m->registers[0] = (epicsUInt16)((m->registers[0] & ~mask) | (value & mask));
    return ask(m, &write);
}

/* FC22, or what takes its place. Returns as ask does; 1 where the PLC has no FC22. */
static int writeBits(plcModbus *m, const plcRequest *q)
{
    epicsUInt16 mask, value;
    int status;

    if (outPieces(m, q) == 0)
        return 0;
    mask = getRegister(m, m->leaving + m->pieces[0].offset);
    value = getRegister(m, m->values + m->pieces[0].offset);
    if (!m->session.noMaskWrite) {
        m->registers[0] = (epicsUInt16)~mask;
        m->registers[1] = value & mask;
        status = ask(m, q);
        if (status != 1)
            return status;
        m->session.noMaskWrite = 1;
    }
    return m->session.options.readModifyWrite ? readModifyWrite(m, q, mask, value) : 1;
}

static int writeWhole(plcModbus *m, const plcRequest *q)
{
    unsigned i, n = outPieces(m, q);

    for (i = 0; i < n; i++)
        load(m, q, &m->pieces[i], m->values);
    return ask(m, q);
}

/* Can it help to ask for less? Not where the PLC has no such function, or no time. */
static int lessMayHelp(int code)
{
    return code >= 2 && code <= 4;
}

/* With singleWrite a PLC may have no function for more than one. */
static int halvesMayHelp(const plcModbus *m, int code)
{
    return lessMayHelp(code) || (code == 1 && m->session.options.singleWrite);
}

static int writeOne(plcModbus *m, const plcRequest *request);

/* Returns as writeOne does. */
static int refused(plcModbus *m, const plcRequest *q, int code)
{
    plcRequest half[2];
    char reason[PLC_REASON_SIZE];

    if (halvesMayHelp(m, code) &&
        plcPlanHalve(m->setup.outputs, m->setup.outputCount,
                     m->session.knowsOut ? m->ownGlueOut : NULL, q, half))
        return writeOne(m, &half[0]) || writeOne(m, &half[1]) ? -1 : 0;
    reasonOf(code, reason);
    if (q->function == 22 && code == 1 && !m->session.options.readModifyWrite)
        epicsSnprintf(reason, sizeof(reason), "PLC has no FC22: set maskWrite=rmw");
    settle(m, q, reason);
    return 0;
}

/* Writes, in parts where the PLC refuses the whole. Returns 0, or -1: session over. */
static int writeOne(plcModbus *m, const plcRequest *request)
{
    plcRequest q = *request;
    int status;

    if (q.count == 1 && q.function != 22 && m->session.options.singleWrite)
        q.function = isBits(q.table) ? 5 : 6;
    if (fetchValues(m, &q))
        return -1;
    status = q.function == 22 ? writeBits(m, &q) : writeWhole(m, &q);
    if (status > 0)
        return refused(m, &q, status);
    if (status == 0 || m->session.lost[0])
        settle(m, &q, m->session.lost);
    return status;
}

/* What is ordered now. Returns 0, or -1: the session is over. */
static int writeAll(plcModbus *m)
{
    plcRequest *requests;
    unsigned i, n;
    int status = 0;

    if (!enter(m))
        return -1;
    m->writing = m->ordered;
    m->ordered = 0;
    memcpy(m->leaving, m->owed, m->setup.outSize);
    memset(m->owed, 0, m->setup.outSize);
    i = m->writing;
    epicsMutexUnlock(m->lock);
    if (!i)
        return 0;
    n = plcPlanWrites(m->setup.outputs, m->setup.outputCount, m->leaving,
                      m->session.knowsOut ? m->ownGlueOut : NULL,
                      m->session.options.singleWrite, &requests);
    for (i = 0; i < n && status == 0; i++)
        status = writeOne(m, &requests[i]);
    free(requests);
    if (enter(m)) {
        m->writing = 0;
        tell(m);
    }
    return status;
}

/* --- Heartbeat -------------------------------------------------------------------- */

/* The next time after `now` in step with `due`. */
static epicsUInt64 nextTime(epicsUInt64 due, epicsUInt64 period, epicsUInt64 now)
{
    return due > now ? due : due + period * ((now - due) / period + 1);
}

static int beat(plcModbus *m)
{
    session *s = &m->session;
    const plcModbusOptions *o = &s->options;
    plcRequest q = {6, plcHolding, (unsigned)o->heartbeatRegister, 1, 0};
    epicsUInt64 period = (epicsUInt64)((o->heartbeat > 0 ? o->heartbeat : 1000) * MS);
    epicsUInt64 now = epicsMonotonicGet();
    char reason[PLC_REASON_SIZE];
    int status;

    if (o->heartbeatRegister < 0 || !s->outputsTried || now < s->beat)
        return 0;
    s->beat = s->beat ? nextTime(s->beat, period, now) : now + period;
    m->registers[0] = ++m->beatCount;
    status = ask(m, &q);
    if (status < 0 || (status > 0) == s->beatRefused || !enter(m))
        return status < 0 ? -1 : 0;
    s->beatRefused = status > 0;
    reasonOf(status, reason);
    note(m, "heartbeat register %d: %s", o->heartbeatRegister,
         status ? reason : "the PLC takes it again");
    tell(m);
    return 0;
}

/* --- Reads ------------------------------------------------------------------------ */

static void addTurn(session *s, const plcRequest *q, int output, epicsUInt64 due)
{
    if (s->turnCount == s->room) {
        s->room = s->room * 2 + 16;
        s->turns = realloc(s->turns, s->room * sizeof(*s->turns));
        if (!s->turns)
            cantProceed("plcModbus: no memory for %u requests\n", s->room);
    }
    s->turns[s->turnCount++] = (turn){*q, output, due, 0};
}

/* A read that was refused comes again as one for each range. Returns 0 when it is of one
 * range only. */
static int split(plcModbus *m, unsigned at)
{
    session *s = &m->session;
    turn t = s->turns[at];
    const plcRange *ranges = t.output ? m->setup.outputs : m->setup.inputs;
    unsigned count = t.output ? m->setup.outputCount : m->setup.inputCount;
    unsigned i, end = t.request.start + t.request.count, place = end;

    for (i = 0; i < count; i++) {
        unsigned start = ranges[i].start, behind = start + ranges[i].count;

        if (ranges[i].table != t.request.table || ranges[i].period != t.request.period)
            continue;
        if (start > t.request.start && start < place)
            place = start;
        if (behind > t.request.start && behind < place)
            place = behind;
    }
    if (place == end)
        return 0;
    s->turns[at].request.count = place - t.request.start;
    t.request.start = place;
    t.request.count = end - place;
    addTurn(s, &t.request, t.output, t.due);
    split(m, s->turnCount - 1);
    return 1;
}

/* These bits are good again in the image that is news next, or are not. The lock is held. */
static void markHealed(plcModbus *m, size_t offset, size_t size, const epicsUInt8 *mask,
                       int good)
{
    size_t i;

    for (i = 0; i < size; i++) {
        m->healed[offset + i] &= (epicsUInt8)~mask[i];
        m->healing[offset + i] &= (epicsUInt8)~mask[i];
        m->healed[offset + i] |= good ? mask[i] : 0;
    }
    m->someHealed |= good;
}

static void inputRead(plcModbus *m, turn *t, int code)
{
    const plcRequest *q = &t->request;
    unsigned i, n = inPieces(m, q);
    int changed = 0;
    char text[40], reason[PLC_REASON_SIZE];

    reasonOf(code, reason);
    if (!enter(m))
        return;
    for (i = 0; i < n; i++) {
        const plcPiece *p = &m->pieces[i];
        epicsUInt8 mask[maskMax];

        pieceMask(q, p, mask);
        if (code)
            changed |= plcFaultsSet(m->setup.inFaults, p->offset, pieceBytes(q, p), mask,
                                    reason);
        else
            store(m, q, p, m->in);
        if (t->refused || code)
            markHealed(m, p->offset, pieceBytes(q, p), mask, !code);
    }
    if (t->refused != !!code)
        note(m, "read of %s: %s", where(q, text), code ? reason : "good again");
    t->refused = !!code;
    m->session.inputsRead |= !code;
    m->news.inFaults |= changed;
    m->hasNews = 1;
    epicsMutexUnlock(m->lock);
}

/* A write without an answer may have come through: where the PLC shows what was written,
 * it is no fault. The lock is held. */
static void checkUnsure(plcModbus *m)
{
    size_t i;

    for (i = 0; i < m->setup.outSize; i++) {
        epicsUInt8 good = m->unsure[i];

        good &= (epicsUInt8)~((m->out[i] ^ m->values[i]) | m->owed[i]);
        if (!good)
            continue;
        m->unsure[i] &= (epicsUInt8)~good;
        m->news.outFaults |= plcFaultsClear(m->setup.outFaults, i, 1, &good);
    }
}

/* All output ranges have been read, or refused. */
static void tellOutputs(plcModbus *m)
{
    session *s = &m->session;

    s->outputsTried = 1;
    if (!enter(m))
        return;
    if (!s->refusal[0]) {
        checkUnsure(m);
        memcpy(m->outNews, m->out, m->setup.outSize);
        /* What is ordered is newer than what was read. */
        mix(m->outNews, m->order, m->owed, m->setup.outSize);
        m->news.shown = 1;
        m->news.unread[0] = 0;
    } else if (strcmp(s->refusal, s->unread)) {
        strcpy(m->news.unread, s->refusal);
        note(m, "outputs cannot be read: %s", s->refusal);
    }
    strcpy(s->unread, s->refusal);
    s->refusal[0] = 0;
    tell(m);
}

static void outputRead(plcModbus *m, turn *t, int code)
{
    session *s = &m->session;
    unsigned i, n = outPieces(m, &t->request);

    if (code && !s->refusal[0])
        reasonOf(code, s->refusal);
    for (i = 0; i < n && !code; i++)
        store(m, &t->request, &m->pieces[i], m->out);
    for (i = 0; i < s->turnCount; i++)
        if (s->turns[i].output && s->turns[i].due <= s->round)
            return;
    tellOutputs(m);
}

static void setDue(session *s, turn *t)
{
    double period = t->output ? s->options.readPeriod : t->request.period;

    t->due = period > 0
                 ? nextTime(t->due, (epicsUInt64)(period * MS), epicsMonotonicGet())
                 : NEVER;
}

static int readTurn(plcModbus *m, unsigned at)
{
    session *s = &m->session;
    plcRequest q = s->turns[at].request;
    int code = ask(m, &q);

    if (code < 0)
        return -1;
    if (lessMayHelp(code) && split(m, at))
        return 0;
    setDue(s, &s->turns[at]);
    (s->turns[at].output ? outputRead : inputRead)(m, &s->turns[at], code);
    return 0;
}

/* All reads that were due have been made: the input image is complete. */
static void endRound(plcModbus *m)
{
    session *s = &m->session;
    int whole = m->setup.inputCount && (s->inputsRead || !s->inputsTried);

    s->round = 0;
    if (enter(m)) {
        if (whole) {
            memcpy(m->inNews, m->in, m->setup.inSize);
            epicsTimeGetCurrent(&m->news.stamp);
            m->news.blocks++;
        }
        if (whole || m->news.inFaults)
            tell(m); /* also when the PLC has just refused all there is */
        else
            epicsMutexUnlock(m->lock);
    }
    s->inputsTried = 1;
    s->inputsRead = 0;
}

/* The read that is due first. */
static unsigned firstTurn(const session *s)
{
    unsigned i, first = 0;

    for (i = 1; i < s->turnCount; i++)
        if (s->turns[i].due < s->turns[first].due)
            first = i;
    return first;
}

/* One read, if one is due. Returns when to go on, 0: at once; or NEVER. */
static epicsUInt64 pollRanges(plcModbus *m)
{
    session *s = &m->session;
    unsigned first = firstTurn(s);
    epicsUInt64 due = s->turnCount ? s->turns[first].due : NEVER;
    epicsUInt64 now = epicsMonotonicGet();

    if (!s->round && due <= now)
        s->round = now;
    if (!s->round)
        return due;
    if (due <= s->round)
        readTurn(m, first);
    else
        endRound(m);
    return 0;
}

/* --- The thread ------------------------------------------------------------------- */

static void planSession(plcModbus *m)
{
    session *s = &m->session;
    epicsUInt64 now = epicsMonotonicGet();
    plcRequest *requests;
    unsigned i, n;

    n = plcPlanReads(m->setup.outputs, m->setup.outputCount,
                     s->knowsOut ? m->ownGlueOut : NULL, &requests);
    for (i = 0; i < n; i++)
        addTurn(s, &requests[i], 1, now - 1); /* before all others */
    free(requests);
    if (n == 0)
        tellOutputs(m);
    n = plcPlanReads(m->setup.inputs, m->setup.inputCount,
                     s->knowsIn ? m->ownGlueIn : NULL, &requests);
    for (i = 0; i < n; i++)
        addTurn(s, &requests[i], 0, now);
    free(requests);
}

/* Takes over a connection, if there is a new one. */
static void beginSession(plcModbus *m)
{
    session *s = &m->session;
    SOCKET socket;

    epicsMutexMustLock(m->lock);
    socket = m->handed;
    m->handed = INVALID_SOCKET;
    if (socket != INVALID_SOCKET) {
        free(s->turns);
        memset(s, 0, sizeof(*s));
        s->generation = m->generation;
        s->on = 1;
        s->options = m->options;
        memset(m->leaving, 0, m->setup.outSize);
        s->knowsIn =
            copyGlue(m->ownGlueIn, m->knowsIn ? m->glueIn : NULL, m->setup.inSize);
        s->knowsOut =
            copyGlue(m->ownGlueOut, m->knowsOut ? m->glueOut : NULL, m->setup.outSize);
    }
    epicsMutexUnlock(m->lock);
    if (socket == INVALID_SOCKET)
        return;
    if (plcModbusWireOpen(m->wire, socket, s->lost)) {
        giveUp(m);
        return;
    }
    modbus_flush(plcModbusWireContext(m->wire)); /* if a request has failed halfway */
    if (enter(m)) {
        epicsMutexUnlock(m->lock);
        planSession(m);
    } else {
        plcModbusWireCut(m->wire); /* stopped meanwhile, before the wire had the socket */
    }
}

static void takeOptions(plcModbus *m)
{
    session *s = &m->session;
    double before = s->options.readPeriod;
    epicsUInt64 now = epicsMonotonicGet();
    unsigned i;

    s->options = m->options;
    for (i = 0; i < s->turnCount && before != s->options.readPeriod; i++)
        if (s->turns[i].output && s->turns[i].due > now) {
            s->turns[i].due = now;
            setDue(s, &s->turns[i]);
        }
}

/* Does what is due first: writes before others, but one read after each lot of writes.
 * Returns when to go on, monotonic ns, 0: at once. */
static epicsUInt64 step(plcModbus *m)
{
    session *s = &m->session;
    epicsUInt64 next;

    if (!enter(m))
        return NEVER;
    takeOptions(m);
    epicsMutexUnlock(m->lock);
    if (plcModbusWireBroken(m->wire, s->lost) || writeAll(m) || beat(m))
        next = NEVER;
    else
        next = pollRanges(m);
    if (s->on && s->lost[0])
        giveUp(m);
    if (!s->on)
        return NEVER;
    if (s->options.heartbeatRegister >= 0 && s->outputsTried && s->beat < next)
        next = s->beat;
    return next;
}

static void worker(void *arg)
{
    plcModbus *m = arg;
    int ending = 0;

    while (!ending) {
        epicsUInt64 next, now;

        beginSession(m);
        next = step(m);
        now = epicsMonotonicGet();
        if (next > now)
            epicsEventWaitWithTimeout(
                m->event, next - now > 3600000 * MS ? 3600 : (double)(next - now) / 1e9);
        epicsMutexMustLock(m->lock);
        ending = m->ending;
        epicsMutexUnlock(m->lock);
    }
}
