/* The worker of a Modbus PLC: its life, its mailbox with the station's thread, its
 * thread; see plcModbus.h and plcModbusPvt.h. */
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>
#include <epicsString.h>

#include "plcModbusPvt.h"

/* Until a heartbeat register that was not answered is written again, ns. */
#define BEAT_REST_NS (60000ull * NS_PER_MS)

static void worker(void *arg);

/* --- Life ------------------------------------------------------------------------- */

static void signalWorker(void *arg)
{
    plcModbus *m = arg;

    plcWakeUp(&m->wake);
}

static void *zeroed(size_t size)
{
    return callocMustSucceed(1, size + 1, "plcModbusCreate");
}

static int unitOf(const plcModbusSetup *setup, unsigned i)
{
    const plcRange *r = i < setup->inputCount ? &setup->inputs[i]
                                              : &setup->outputs[i - setup->inputCount];

    return r->unit == PLC_UNIT_OF_PLC ? setup->unit : r->unit - 1;
}

static unsigned countUnits(const plcModbusSetup *setup)
{
    unsigned i, j, count = 0, all = setup->inputCount + setup->outputCount;

    for (i = 0; i < all; i++) {
        for (j = 0; j < i && unitOf(setup, j) != unitOf(setup, i); j++)
            ;
        count += j == i;
    }
    return count;
}

plcModbus *plcModbusCreate(const plcModbusSetup *setup)
{
    plcModbus *m = zeroed(sizeof(*m));
    unsigned most =
        setup->inputCount > setup->outputCount ? setup->inputCount : setup->outputCount;

    epicsSnprintf(m->name, sizeof(m->name), "%s-mb", setup->name);
    m->setup = *setup;
    m->setup.name = m->name;
    m->canWake = plcWakeInit(&m->wake) == 0;
    m->lock = epicsMutexMustCreate();
    m->options.requestTimeout = 1000;
    m->options.readPeriod = 1000;
    m->options.heartbeatRegister = -1;
    m->handed = INVALID_SOCKET;
    m->joinedIn = zeroed(setup->inSize);
    m->ownJoinedIn = zeroed(setup->inSize);
    m->in = zeroed(setup->inSize);
    m->inNews = zeroed(setup->inSize);
    m->readable = zeroed(setup->inSize);
    m->clearing = zeroed(setup->inSize);
    m->joinedOut = zeroed(setup->outSize);
    m->ownJoinedOut = zeroed(setup->outSize);
    m->out = zeroed(setup->outSize);
    m->outNews = zeroed(setup->outSize);
    m->hidden = zeroed(setup->outSize);
    m->hiddenTaken = zeroed(setup->outSize);
    m->leaving = zeroed(setup->outSize);
    m->waiting = zeroed(setup->outSize);
    m->values = zeroed(setup->outSize);
    m->unsure = zeroed(setup->outSize);
    m->doubt = zeroed(setup->outSize);
    m->told = zeroed(setup->outSize);
    m->givenUp = zeroed(setup->outSize);
    m->pieces = zeroed((most + 1) * sizeof(*m->pieces));
    m->relay = plcModbusRelayCreate(setup->name, signalWorker, m);
    m->units = countUnits(setup);
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
    plcModbusRelayCut(m->relay);
    memset(&m->news, 0, sizeof(m->news));
    m->hasNews = m->mayWrite = 0;
    m->moreLog = 0;
    memset(m->readable, 0, m->setup.inSize);
    memset(m->clearing, 0, m->setup.inSize);
    m->someReadable = m->someClearing = 0;
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
        plcWakeUp(&m->wake);
        epicsThreadMustJoin(m->thread);
    }
    plcModbusRelayDestroy(m->relay);
    plcWakeFree(&m->wake);
    epicsMutexDestroy(m->lock);
    free(m->joinedIn);
    free(m->ownJoinedIn);
    free(m->in);
    free(m->inNews);
    free(m->readable);
    free(m->clearing);
    free(m->joinedOut);
    free(m->ownJoinedOut);
    free(m->out);
    free(m->outNews);
    free(m->hidden);
    free(m->hiddenTaken);
    free(m->leaving);
    free(m->waiting);
    free(m->values);
    free(m->unsure);
    free(m->doubt);
    free(m->told);
    free(m->givenUp);
    free(m->pieces);
    free(m->session.turns);
    free(m->cuts);
    plcHolesFree(&m->holes);
    free(m);
}

/* Returns 0, or -1: there is no thread. */
static int startThread(plcModbus *m)
{
    epicsThreadOpts options = EPICS_THREAD_OPTS_INIT;

    if (m->thread)
        return 0;
    options.priority = epicsThreadPriorityMedium;
    options.stackSize = epicsThreadStackMedium;
    options.joinable = 1;
    m->thread = epicsThreadCreateOpt(m->name, worker, m, &options);
    return m->thread ? 0 : -1;
}

/* --- For the station's thread ----------------------------------------------------- */

void plcModbusSetOptions(plcModbus *m, const plcModbusOptions *options)
{
    epicsMutexMustLock(m->lock);
    m->options = *options;
    epicsMutexUnlock(m->lock);
    plcWakeUp(&m->wake);
}

static int copyJoined(epicsUInt8 *to, const epicsUInt8 *from, size_t size)
{
    if (from)
        memcpy(to, from, size);
    return from != NULL;
}

void plcModbusStart(plcModbus *m, SOCKET socket, const epicsUInt8 *joinedIn,
                    const epicsUInt8 *joinedOut)
{
    int copy = fcntl(socket, F_DUPFD_CLOEXEC, 0);
    const char *why = copy < 0 || !m->canWake ? "too many open files in IOC"
                      : startThread(m)        ? "no thread for Modbus"
                                              : NULL;

    epicsMutexMustLock(m->lock);
    endSession(m);
    m->running = 1;
    m->handed = why ? INVALID_SOCKET : copy;
    m->knowsIn = copyJoined(m->joinedIn, joinedIn, m->setup.inSize);
    m->knowsOut = copyJoined(m->joinedOut, joinedOut, m->setup.outSize);
    m->joinedIsNew = 0;
    if (why) {
        m->news.lost = m->hasNews = 1;
        strcpy(m->news.why, why);
    }
    epicsMutexUnlock(m->lock);
    plcWakeUp(&m->wake);
    if (why) {
        if (copy >= 0)
            epicsSocketDestroy(copy);
        m->setup.wake(m->setup.arg);
    }
}

void plcModbusJoined(plcModbus *m, const epicsUInt8 *joinedIn, const epicsUInt8 *joinedOut)
{
    epicsMutexMustLock(m->lock);
    m->knowsIn = copyJoined(m->joinedIn, joinedIn, m->setup.inSize);
    m->knowsOut = copyJoined(m->joinedOut, joinedOut, m->setup.outSize);
    m->joinedIsNew = 1;
    epicsMutexUnlock(m->lock);
    plcWakeUp(&m->wake);
}

void plcModbusStop(plcModbus *m)
{
    epicsMutexMustLock(m->lock);
    endSession(m);
    epicsMutexUnlock(m->lock);
    plcWakeUp(&m->wake);
}

void plcModbusWrite(plcModbus *m)
{
    epicsMutexMustLock(m->lock);
    m->mayWrite = 1;
    epicsMutexUnlock(m->lock);
    plcWakeUp(&m->wake);
}

/* What was refused is good again, and the records have it: the caller has come back. The
 * lock is held. */
static void endFaults(plcModbus *m)
{
    if (!m->someClearing)
        return;
    if (plcFaultsClear(m->setup.inFaults, 0, m->setup.inSize, m->clearing))
        m->news.inFaults = m->hasNews = 1;
    memset(m->clearing, 0, m->setup.inSize);
    m->someClearing = 0;
}

/* The caller takes an image; with it what is good again in it. The lock is held. */
static void takeReadable(plcModbus *m)
{
    epicsUInt8 *none = m->clearing;

    if (!m->someReadable)
        return;
    m->clearing = m->readable;
    m->readable = none;
    m->someClearing = 1;
    m->someReadable = 0;
}

int plcModbusHidden(plcModbus *m, void *mask)
{
    memcpy(mask, m->hiddenTaken, m->setup.outSize);
    return m->hidesTaken;
}

int plcModbusTake(plcModbus *m, plcNews *news, void *input, void *output)
{
    int has, again;

    epicsMutexMustLock(m->lock);
    endFaults(m);
    if (m->news.blocks)
        takeReadable(m);
    has = m->hasNews;
    *news = m->news;
    if (m->news.blocks)
        memcpy(input, m->inNews, m->setup.inSize);
    if (m->news.shown) {
        memcpy(output, m->outNews, m->setup.outSize);
        memcpy(m->hiddenTaken, m->hidden, m->setup.outSize);
        m->hidesTaken = m->hides;
    }
    if (m->moreLog)
        epicsSnprintf(news->log + strlen(news->log),
                      sizeof(news->log) - strlen(news->log), " (and %u more)",
                      m->moreLog);
    memset(&m->news, 0, sizeof(m->news));
    m->hasNews = 0;
    m->moreLog = 0;
    again = m->someClearing;
    epicsMutexUnlock(m->lock);
    if (again)
        m->setup.wake(m->setup.arg);
    return has;
}

/* The connection is of no use any more, for the reason in session.lost. What was to leave
 * on it has not left: that is a fault until it has. */
static void giveUp(plcModbus *m)
{
    size_t i;

    plcModbusRelayCut(m->relay);
    if (plcWorkerEnter(m)) {
        plcImagePutsWaiting(m->setup.out, NULL, m->waiting);
        for (i = 0; i < m->setup.outSize; i++)
            m->leaving[i] |= m->waiting[i];
        m->news.outFaults |= plcFaultsSet(m->setup.outFaults, 0, m->setup.outSize,
                                          m->leaving, m->session.lost);
        plcImagePutsBack(m->setup.out);
        m->news.lost = 1;
        strcpy(m->news.why, m->session.lost);
        plcWorkerTell(m);
    }
    m->session.on = 0;
}

/* --- Heartbeat -------------------------------------------------------------------- */

/* The PLC gave no good answer: it gets the count once more after the reconnect, then once a
 * minute. Returns as beat does. */
static int beatUnanswered(plcModbus *m, int status)
{
    session *s = &m->session;

    if (m->beatDoubt)
        s->beat = m->beatRest = epicsMonotonicGet() + BEAT_REST_NS;
    if (m->beatDoubt && !s->beatRefused && plcWorkerEnter(m)) {
        s->beatRefused = 1;
        plcWorkerNote(m, "heartbeat register %d: %s; tried once a minute",
                      s->options.heartbeatRegister, status < 0 ? s->lost : s->silentWhy);
        plcWorkerTell(m);
    }
    m->beatDoubt = 1;
    return status < 0 ? -1 : 0;
}

/* Returns 0, or -1: the session is over. */
static int beat(plcModbus *m)
{
    session *s = &m->session;
    const plcModbusOptions *o = &s->options;
    plcRequest q = {6, plcHolding, (unsigned)o->heartbeatRegister, 1, 0, PLC_UNIT_OF_PLC};
    epicsUInt64 period =
        (epicsUInt64)((o->heartbeat > 0 ? o->heartbeat : 1000) * NS_PER_MS);
    epicsUInt64 now = epicsMonotonicGet();
    char reason[PLC_REASON_SIZE];
    int status;

    m->beatRest = 0;
    s->beat = s->beat ? plcWorkerNext(s->beat, period, now) : now + period;
    m->registers[0] = ++m->beatCount;
    s->mayBeSilent = m->beatDoubt;
    status = plcWorkerAsk(m, &q);
    s->mayBeSilent = 0;
    if (status == PLC_WORKER_SILENT || (status < 0 && s->lost[0]))
        return beatUnanswered(m, status);
    if (status >= 0)
        m->beatDoubt = 0;
    if (status < 0 || (status > 0) == s->beatRefused || !plcWorkerEnter(m))
        return status < 0 ? -1 : 0;
    s->beatRefused = status > 0;
    plcWorkerReason(m, status, reason);
    plcWorkerNote(m, "heartbeat register %d: %s", o->heartbeatRegister,
                  status ? reason : "the PLC takes it again");
    plcWorkerTell(m);
    return 0;
}

/* --- The thread ------------------------------------------------------------------- */

/* The lock is held. */
static void takeJoined(plcModbus *m)
{
    session *s = &m->session;

    s->knowsIn = copyJoined(m->ownJoinedIn, m->knowsIn ? m->joinedIn : NULL, m->setup.inSize);
    s->knowsOut = copyJoined(m->ownJoinedOut, m->knowsOut ? m->joinedOut : NULL, m->setup.outSize);
    m->joinedIsNew = 0;
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
        s->beat = m->beatRest;
        memset(m->leaving, 0, m->setup.outSize);
        takeJoined(m);
    }
    epicsMutexUnlock(m->lock);
    if (socket == INVALID_SOCKET)
        return;
    if (plcModbusRelayOpen(m->relay, socket, s->lost)) {
        giveUp(m);
        return;
    }
    modbus_flush(plcModbusRelayContext(m->relay)); /* if a request has failed halfway */
    if (plcWorkerEnter(m)) {
        epicsMutexUnlock(m->lock);
        plcWorkerPlan(m);
    } else {
        plcModbusRelayCut(m->relay); /* stopped meanwhile, before the relay had the socket */
    }
}

/* Returns 1 when requests have other limits now. */
static int takeOptions(plcModbus *m)
{
    session *s = &m->session;
    double before = s->options.readPeriod;
    plcLimits limits = s->options.limits;
    int beatRegister = s->options.heartbeatRegister;
    epicsUInt64 now = epicsMonotonicGet();
    unsigned i;

    s->options = m->options;
    if (beatRegister != s->options.heartbeatRegister)
        s->beat = m->beatRest = m->beatDoubt = s->beatRefused = 0;
    for (i = 0; i < s->turnCount && before != s->options.readPeriod; i++)
        if (s->turns[i].output && s->turns[i].due > now) {
            s->turns[i].due = now;
            plcWorkerSetDue(s, &s->turns[i]);
        }
    return limits.registers != s->options.limits.registers ||
           limits.bits != s->options.limits.bits;
}

/* The heartbeat or one read of the outputs; in turns where both are due. Returns 0, or -1: the session
 * is over. */
static int beatOrRead(plcModbus *m)
{
    session *s = &m->session;

    s->beatWasLast = plcWorkerBeatIsDue(s) && !(s->beatWasLast && plcWorkerIsDue(s, 1));
    if (s->beatWasLast)
        return beat(m);
    plcWorkerRead(m, 1);
    return s->on && !s->lost[0] ? 0 : -1;
}

/* One lot of puts, one other request, one read of inputs, as they are due: so inputs are read after two
 * requests at most, and nobody waits for all that others have to do. Returns when to go on, monotonic ns,
 * 0: at once. */
static epicsUInt64 step(plcModbus *m)
{
    session *s = &m->session;
    epicsUInt64 next = PLC_WORKER_NEVER;
    int plan, more;

    if (!plcWorkerEnter(m))
        return PLC_WORKER_NEVER;
    s->planIsOld |= takeOptions(m) || m->joinedIsNew;
    plan = s->planIsOld && !s->round[0] && !s->round[1]; /* not within a round of reads */
    if (plan) {
        takeJoined(m);
        s->planIsOld = 0;
    }
    epicsMutexUnlock(m->lock);
    if (plan)
        plcWorkerPlan(m);
    if (!plcModbusRelayBroken(m->relay, s->lost) && (more = plcWorkerWriteAll(m)) >= 0 &&
        beatOrRead(m) == 0) {
        plcWorkerRead(m, 0);
        next = more ? 0 : plcWorkerNextRead(s);
    }
    if (s->on && s->lost[0])
        giveUp(m);
    if (!s->on)
        return PLC_WORKER_NEVER;
    if (s->options.heartbeatRegister >= 0 && s->outputsTried && s->beat < next)
        next = s->beat;
    return next;
}

static void worker(void *arg)
{
    plcModbus *m = arg;
    int ending = 0;

    while (!ending) {
        beginSession(m);
        plcWakeWait(&m->wake, step(m));
        epicsMutexMustLock(m->lock);
        ending = m->ending;
        epicsMutexUnlock(m->lock);
    }
}
