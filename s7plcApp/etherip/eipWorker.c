/* The thread of one PLC: mailbox, session, and what is due next; see eipWorker.h. */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>

#include "eipWorkerPvt.h"

enum { keepMs = 8000 }; /* 4 intervals of a connection: it may be silent for so long */

static void worker(void *arg);

/* --- Life ---------------------------------------------------------------------------------- */

eipWorker *eipWorkerCreate(const plcTransportSetup *setup, const eipConnectOptions *connect,
                           eipWantsSource *source, void *arg)
{
    eipWorker *w = callocMustSucceed(1, sizeof(*w), "eipWorker");
    size_t size = setup->inSize + 1;

    w->setup = *setup;
    w->source = source;
    w->sourceArg = arg;
    w->canWake = plcWakeInit(&w->wake) == 0;
    w->lock = epicsMutexMustCreate();
    w->tagsLock = epicsMutexMustCreate();
    w->handed = INVALID_SOCKET;
    w->options.requestTimeout = 1000;
    w->options.relearn = 3000;
    w->connectOptions = *connect;
    w->inNews = callocMustSucceed(12, size, "eipWorker");
    w->outNews = w->inNews + size;
    w->in = w->outNews + size;
    w->leaving = w->in + size;
    w->values = w->leaving + size;
    w->waiting = w->values + size;
    w->written = w->waiting + size;
    w->older = w->written + size;
    w->olderTaken = w->older + size;
    w->back = w->olderTaken + size;
    w->holds = w->back + size;
    w->unread = w->holds + size;
    w->frame = mallocMustSucceed(eipFrameMax, "eipWorker");
    w->message = mallocMustSucceed(eipMessageMax, "eipWorker");
    eipSocketInit(&w->socket);
    eipConnectInit(&w->connect, connect);
    eipTagsInit(&w->tags);
    return w;
}

void eipWorkerBegin(eipWorker *w)
{
    epicsThreadOpts opts = EPICS_THREAD_OPTS_INIT;
    char name[64];

    if (w->thread || !w->canWake)
        return;
    opts.priority = epicsThreadPriorityHigh;
    opts.stackSize = epicsThreadStackBig;
    opts.joinable = 1;
    w->ending = 0;
    epicsSnprintf(name, sizeof(name), "%.40s-eip", w->setup.name);
    w->thread = epicsThreadCreateOpt(name, worker, w, &opts);
}

/* A request that is under way ends at once; else the worker says goodbye to the PLC. The lock
 * is held. */
static void interrupt(eipWorker *w)
{
    if (w->on && w->busy)
        shutdown(w->socket.fd, SHUT_RDWR);
}

void eipWorkerEnd(eipWorker *w)
{
    if (!w->thread)
        return;
    epicsMutexMustLock(w->lock);
    w->ending = 1;
    interrupt(w);
    if (w->handed != INVALID_SOCKET)
        epicsSocketDestroy(w->handed);
    w->handed = INVALID_SOCKET;
    epicsMutexUnlock(w->lock);
    plcWakeUp(&w->wake);
    epicsThreadMustJoin(w->thread);
    w->thread = NULL;
}

void eipWorkerDestroy(eipWorker *w)
{
    eipWorkerEnd(w);
    eipBrowseEnd(w);
    eipPlansFree(w);
    eipTagsFree(&w->tags);
    eipSocketFree(&w->socket);
    free(w->inNews);
    free(w->byPlace);
    free(w->queued);
    free(w->frame);
    free(w->message);
    free(w->assembly);
    plcWakeFree(&w->wake);
    epicsMutexDestroy(w->tagsLock);
    epicsMutexDestroy(w->lock);
    free(w);
}

/* --- The mailbox ---------------------------------------------------------------------------- */

void eipWorkerSetOptions(eipWorker *w, const eipWorkerOptions *options)
{
    epicsMutexMustLock(w->lock);
    w->options = *options;
    epicsMutexUnlock(w->lock);
    plcWakeUp(&w->wake);
}

void eipWorkerSetConnect(eipWorker *w, const eipConnectOptions *connect)
{
    epicsMutexMustLock(w->lock);
    w->connectOptions = *connect;
    w->newConnect = 1;
    epicsMutexUnlock(w->lock);
}

void eipWorkerWant(eipWorker *w)
{
    plcWakeUp(&w->wake);
}

/* The lock is held. */
static void newGeneration(eipWorker *w, int running)
{
    w->generation++;
    w->running = running;
    if (w->handed != INVALID_SOCKET)
        epicsSocketDestroy(w->handed);
    w->handed = INVALID_SOCKET;
    w->mayWrite = 0;
    memset(&w->news, 0, sizeof(w->news));
    w->hasNews = 0;
    w->moreLog = 0;
    w->state.connected = 0;
}

void eipWorkerStart(eipWorker *w, SOCKET socket)
{
    SOCKET own = dup(socket);
    const char *why = NULL;

    eipWorkerBegin(w); /* if there was no thread for it until now */
    if (own == INVALID_SOCKET || !w->canWake)
        why = "too many open files in IOC";
    else if (!w->thread)
        why = "no thread for EtherNet/IP";
    if (why && own != INVALID_SOCKET)
        epicsSocketDestroy(own);
    epicsMutexMustLock(w->lock);
    newGeneration(w, 1);
    w->handed = why ? INVALID_SOCKET : own;
    if (why) {
        w->news.lost = w->hasNews = 1;
        strcpy(w->news.why, why);
    }
    epicsMutexUnlock(w->lock);
    plcWakeUp(&w->wake);
    if (why)
        w->setup.wake(w->setup.arg);
}

void eipWorkerStop(eipWorker *w)
{
    epicsMutexMustLock(w->lock);
    newGeneration(w, 0);
    interrupt(w);
    epicsMutexUnlock(w->lock);
    plcWakeUp(&w->wake);
}

void eipWorkerPut(eipWorker *w)
{
    epicsMutexMustLock(w->lock);
    w->mayWrite = 1;
    epicsMutexUnlock(w->lock);
    plcWakeUp(&w->wake);
}

int eipWorkerTake(eipWorker *w, plcNews *news, void *input, void *output)
{
    int has;

    epicsMutexMustLock(w->lock);
    has = w->hasNews;
    *news = w->news;
    if (news->blocks)
        memcpy(input, w->inNews, w->newsUsed);
    if (news->shown) {
        memcpy(output, w->outNews, w->newsUsed);
        memcpy(w->olderTaken, w->older, w->newsUsed);
        w->throughTaken = w->through;
        w->takenUsed = w->newsUsed;
    }
    if (w->moreLog)
        epicsSnprintf(news->log + strlen(news->log), sizeof(news->log) - strlen(news->log),
                      " (and %u more: drvEtherIP_dump)", w->moreLog);
    memset(&w->news, 0, sizeof(w->news));
    w->hasNews = 0;
    w->moreLog = 0;
    epicsMutexUnlock(w->lock);
    return has;
}

void eipWorkerAge(eipWorker *w, epicsUInt64 *through, void *older)
{
    memcpy(older, w->olderTaken, w->takenUsed);
    *through = w->throughTaken;
}

void eipWorkerStateGet(eipWorker *w, eipWorkerState *state)
{
    unsigned i;

    epicsMutexMustLock(w->tagsLock);
    epicsMutexMustLock(w->lock);
    *state = w->state;
    epicsMutexUnlock(w->lock);
    state->tags = w->tags.tagCount;
    state->units = w->tags.unitCount;
    state->known = state->bad = 0;
    for (i = 0; i < w->tags.tagCount; i++) {
        state->known += w->tags.tags[i].state == eipTagKnown;
        state->bad += w->tags.tags[i].state == eipTagBad;
    }
    epicsMutexUnlock(w->tagsLock);
}

/* While it opens a session it asks on and on; then a period is due, or the connection must be
 * kept. */
double eipWorkerPause(eipWorker *w)
{
    double pause = keepMs;
    unsigned i;

    epicsMutexMustLock(w->lock);
    if (w->state.connected && !w->state.keeps)
        pause = w->classCount ? 1e10 : 0;
    for (i = 0; w->state.connected && i < w->classCount; i++)
        if (w->classes[i].period < pause)
            pause = w->classes[i].period;
    epicsMutexUnlock(w->lock);
    return pause;
}

int eipWorkerTimes(eipWorker *w, unsigned period, eipTimes *times)
{
    unsigned i, best = 0, found = 0;

    epicsMutexMustLock(w->lock);
    for (i = 0; i < w->classCount; i++) {
        unsigned mine = w->classes[i].period, other = w->classes[best].period;

        if (!found || (mine > period ? mine - period : period - mine) <
                          (other > period ? other - period : period - other))
            best = i;
        found = 1;
    }
    if (found)
        *times = w->classes[best].times;
    found = found && times->turns;
    epicsMutexUnlock(w->lock);
    return found ? 0 : -1;
}

void eipWorkerTimesReset(eipWorker *w)
{
    unsigned i;

    epicsMutexMustLock(w->lock);
    for (i = 0; i < w->classCount; i++)
        memset(&w->classes[i].times, 0, sizeof(w->classes[i].times));
    w->state.late = 0;
    epicsMutexUnlock(w->lock);
}

void eipWorkerEachTag(eipWorker *w, void (*visit)(const eipTag *tag, void *arg), void *arg)
{
    unsigned i;

    epicsMutexMustLock(w->tagsLock);
    for (i = 0; i < w->tags.tagCount; i++)
        visit(&w->tags.tags[i], arg);
    epicsMutexUnlock(w->tagsLock);
}

/* --- The session ----------------------------------------------------------------------------- */

/* Takes over a connection, if there is a new one. */
static void takeSocket(eipWorker *w)
{
    SOCKET fd;
    eipConnectOptions options;
    int fresh = 0;

    epicsMutexMustLock(w->lock);
    fd = w->handed;
    w->handed = INVALID_SOCKET;
    if (fd != INVALID_SOCKET) {
        w->session = w->generation;
        fresh = w->newConnect;
        w->newConnect = 0;
        options = w->connectOptions;
        w->on = 1;
        eipSocketUse(&w->socket, fd);
    }
    epicsMutexUnlock(w->lock);
    if (fd == INVALID_SOCKET)
        return;
    if (fresh)
        eipConnectInit(&w->connect, &options);
    w->open = w->taught = 0;
    w->lost[0] = 0;
    memset(w->unread, 0, w->used);
    w->asking = eipAskOther;
    memset(w->leaving, 0, w->used);
    memset(w->written, 0, w->used);
    memset(w->back, 0, w->used);
    w->someBack = 0;
    eipConnectBegin(&w->connect, (epicsUInt32)epicsMonotonicGet());
}

/* When a PLC does not answer a step, the connection is lost; it is left out on the next one. */
static void openSession(eipWorker *w)
{
    size_t n, length;

    while ((n = eipConnectNext(&w->connect, w->frame, eipFrameMax)) != 0) {
        if (eipWorkerExchange(w, n, eipWorkerTimeout(w), &length) != eipAnswered) {
            if (eipWorkerEnter(w)) {
                epicsMutexUnlock(w->lock);
                eipConnectNoAnswer(&w->connect);
            }
            return;
        }
        if (eipConnectTake(&w->connect, w->socket.buffer, length, w->lost, sizeof(w->lost)))
            return;
    }
    if (eipConnectOpened(&w->connect)) {
        strcpy(w->lost, "asks again for what was not answered");
        eipSocketTell(&w->socket, w->frame,
                      eipConnectClose(&w->connect, w->frame, eipFrameMax));
        return;
    }
    w->open = 1;
    w->limits.room = w->connect.room;
    w->limits.multiple = w->noMultiple ? 1 : w->connect.multiple;
    w->epoch = epicsMonotonicGet();
    w->askMost = eipAskMost;
    epicsMutexMustLock(w->tagsLock);
    w->tags.omron = w->connect.identity.vendor == eipVendorOmron;
    epicsMutexUnlock(w->tagsLock);
    eipLearnBegin(w);
    eipReadsBegin(w);
    if (eipWorkerEnter(w)) {
        w->state.connected = 1;
        w->news.opened = 1;
        w->state.identity = w->connect.identity;
        w->state.keeps = w->connect.session.connected;
        eipConnectText(&w->connect, w->state.way, sizeof(w->state.way));
        if (!w->setup.outSize)
            w->news.shown = 1;
        eipWorkerTell(w);
    }
}

/* The connection is of no use any more. What was to leave on it waits again. */
static void giveUp(eipWorker *w)
{
    eipWorkerBlame(w);
    w->asking = eipAskOther;
    if (!w->lost[0])
        strcpy(w->lost, "connection lost");
    if (eipWorkerEnter(w)) {
        plcImagePutsBack(w->setup.out);
        w->news.outFaults = 1;
        w->news.lost = 1;
        strcpy(w->news.why, w->lost);
        w->state.connected = 0;
        eipWorkerTell(w);
    }
}

/* Ends what there is of a session; a PLC whose connection still stands is told. */
static void endSession(eipWorker *w, int polite)
{
    size_t n = polite && w->open ? eipConnectClose(&w->connect, w->frame, eipFrameMax) : 0;

    if (n)
        eipSocketTell(&w->socket, w->frame, n);
    epicsMutexMustLock(w->lock);
    w->on = w->open = 0;
    eipSocketClose(&w->socket);
    epicsMutexUnlock(w->lock);
    eipBrowseEnd(w);
    w->turn = NULL;
}

/* --- The thread ------------------------------------------------------------------------------ */

static void takeOrders(eipWorker *w)
{
    epicsMutexMustLock(w->lock);
    w->now = w->options;
    epicsMutexUnlock(w->lock);
    eipWantsTake(w);
}

/* A connection on which nobody asks anything would be closed by the PLC. */
static int keepAlive(eipWorker *w, epicsUInt64 now, epicsUInt64 *next)
{
    epicsUInt64 pause = keepMs * EIP_NS_PER_MS;
    epicsUInt8 path[12];
    eipWriter m = eipWorkerWriter(w);
    eipAnswer answer;

    if (!w->connect.session.connected)
        return 0;
    if (now < w->lastAsk + pause) {
        if (w->lastAsk + pause < *next)
            *next = w->lastAsk + pause;
        return 0;
    }
    eipRequestPut(&m, eipGetAttributeSingle, path, eipObjectPath(path, 1, 1, 1));
    return eipWorkerAsk(w, &m, &answer) ? -1 : 1;
}

static int readsStep(eipWorker *w, epicsUInt64 now, epicsUInt64 *next)
{
    int status = eipReadsStep(w, now, next);

    if (w->otherProgram)
        eipLearnChanged(w);
    else if (w->relearn)
        eipLearnBegin(w);
    w->relearn = 0;
    return status;
}

/* Does what is due first: one message, after all that is to be written. Returns when to go on,
 * ns; 0: at once. */
static epicsUInt64 step(eipWorker *w)
{
    epicsUInt64 now, next = EIP_NEVER;
    int status;

    takeOrders(w);
    if (eipSocketBroken(&w->socket, w->lost, sizeof(w->lost)))
        return 0;
    if (!w->open) {
        openSession(w);
        return 0;
    }
    if (eipWriteAll(w))
        return 0;
    now = epicsMonotonicGet();
    status = eipLearnStep(w, now, &next);
    if (!status && !w->turn && w->turnEnded) /* also where reads never come to an end */
        status = eipBrowseStep(w, now, &next);
    w->turnEnded = 0;
    if (!status)
        status = readsStep(w, now, &next);
    if (!status)
        status = eipBrowseStep(w, now, &next);
    if (!status)
        status = keepAlive(w, now, &next);
    return status ? 0 : next;
}

static void sleepUntil(eipWorker *w, epicsUInt64 next)
{
    epicsUInt64 now = epicsMonotonicGet(), most = 500 * EIP_NS_PER_MS;

    if (next <= now)
        return;
    /* A PLC that closes the connection is noticed at the next request, or by then. */
    if (next - now > most && w->on)
        next = now + most;
    plcWakeWait(&w->wake, next);
}

static void worker(void *arg)
{
    eipWorker *w = arg;
    int ending = 0;

    while (!ending) {
        epicsUInt64 next = EIP_NEVER;

        takeSocket(w);
        if (w->on) {
            next = step(w);
            if (!eipWorkerEnter(w)) {
                endSession(w, !w->lost[0]);
                next = 0;
            } else {
                epicsMutexUnlock(w->lock);
                if (w->lost[0]) {
                    giveUp(w);
                    endSession(w, 0);
                    next = EIP_NEVER;
                }
            }
        } else {
            takeOrders(w);
        }
        sleepUntil(w, next);
        epicsMutexMustLock(w->lock);
        ending = w->ending;
        epicsMutexUnlock(w->lock);
    }
    if (w->on)
        endSession(w, 1);
}
