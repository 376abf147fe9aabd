/* The thread of one PLC: mailbox, session, and what is due next; see eipWorker.h. */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>

#include "eipWorkerPvt.h"

static void worker(void *arg);

/* --- Life ---------------------------------------------------------------------------------- */

eipWorker *eipWorkerCreate(const plcTransportSetup *setup, const eipConnectOptions *connect)
{
    eipWorker *w = callocMustSucceed(1, sizeof(*w), "eipWorker");
    size_t size = setup->inSize + 1;

    w->setup = *setup;
    w->canWake = plcWakeInit(&w->wake) == 0;
    w->lock = epicsMutexMustCreate();
    w->tagsLock = epicsMutexMustCreate();
    w->handed = INVALID_SOCKET;
    w->options.requestTimeout = 1000;
    w->options.relearn = 3000;
    w->connectOptions = *connect;
    w->order = callocMustSucceed(7, size, "eipWorker");
    w->owed = w->order + size;
    w->inNews = w->owed + size;
    w->outNews = w->inNews + size;
    w->in = w->outNews + size;
    w->leaving = w->in + size;
    w->values = w->leaving + size;
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

static void freeWants(eipWorker *w)
{
    unsigned i;

    for (i = 0; i < w->wantCount; i++)
        free(w->wants[i].tag);
    free(w->wants);
    w->wants = NULL;
    w->wantCount = 0;
}

void eipWorkerDestroy(eipWorker *w)
{
    eipWorkerEnd(w);
    freeWants(w);
    eipBrowseEnd(w);
    eipReadsFree(w);
    eipTagsFree(&w->tags);
    eipSocketFree(&w->socket);
    free(w->order);
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

void eipWorkerWant(eipWorker *w, eipWant *wants, unsigned count)
{
    epicsMutexMustLock(w->lock);
    freeWants(w);
    w->wants = wants;
    w->wantCount = count;
    w->newWants = 1;
    epicsMutexUnlock(w->lock);
    plcWakeUp(&w->wake);
}

/* The lock is held. What is ordered and has not left is void. */
static void newGeneration(eipWorker *w, int running)
{
    w->generation++;
    w->running = running;
    if (w->handed != INVALID_SOCKET)
        epicsSocketDestroy(w->handed);
    w->handed = INVALID_SOCKET;
    memset(w->owed, 0, w->setup.outSize);
    w->ordered = 0;
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

void eipWorkerPut(eipWorker *w, const void *image, const void *mask)
{
    const epicsUInt8 *bytes = image, *bits = mask;
    size_t i;

    epicsMutexMustLock(w->lock);
    for (i = 0; i < w->setup.outSize; i++) {
        if (!bits[i])
            continue;
        w->order[i] = (epicsUInt8)((w->order[i] & ~bits[i]) | (bytes[i] & bits[i]));
        w->owed[i] |= bits[i];
        if (w->news.shown)
            w->outNews[i] = w->order[i];
    }
    w->ordered = 1;
    epicsMutexUnlock(w->lock);
    plcWakeUp(&w->wake);
}

int eipWorkerTake(eipWorker *w, plcNews *news, void *input, void *output)
{
    int has;

    epicsMutexMustLock(w->lock);
    has = w->hasNews;
    *news = w->news;
    news->idle = !w->ordered && !w->writing;
    if (news->blocks)
        memcpy(input, w->inNews, w->setup.inSize);
    if (news->shown)
        memcpy(output, w->outNews, w->setup.outSize);
    if (w->moreLog)
        epicsSnprintf(news->log + strlen(news->log), sizeof(news->log) - strlen(news->log),
                      " (and %u more)", w->moreLog);
    memset(&w->news, 0, sizeof(w->news));
    w->hasNews = 0;
    w->moreLog = 0;
    epicsMutexUnlock(w->lock);
    return has;
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

/* --- What the worker tells ------------------------------------------------------------------ */

int eipWorkerEnter(eipWorker *w)
{
    epicsMutexMustLock(w->lock);
    if (w->on && w->running && w->generation == w->session)
        return 1;
    epicsMutexUnlock(w->lock);
    return 0;
}

void eipWorkerTell(eipWorker *w)
{
    w->hasNews = 1;
    epicsMutexUnlock(w->lock);
    w->setup.wake(w->setup.arg);
}

void eipWorkerNote(eipWorker *w, const char *format, ...)
{
    va_list args;

    if (!eipWorkerEnter(w))
        return;
    if (w->news.log[0]) {
        w->moreLog++;
    } else {
        va_start(args, format);
        epicsVsnprintf(w->news.log, sizeof(w->news.log), format, args);
        va_end(args);
    }
    eipWorkerTell(w);
}

void eipWorkerReason(const eipAnswer *answer, char reason[PLC_REASON_SIZE])
{
    char text[64];

    eipStatusText(answer->status, answer->extended, text, sizeof(text));
    epicsSnprintf(reason, PLC_REASON_SIZE, "PLC: %.34s", text);
}

void eipWorkerBad(eipWorker *w, const eipWant *want, const char *reason)
{
    int changed = plcFaultsSet(w->setup.inFaults, want->place, want->room, NULL, reason);

    if (w->in[want->place] || w->in[want->place + 1]) {
        memset(w->in + want->place, 0, 2); /* no type: no value */
        changed = 1;
    }
    if (!changed)
        return;
    w->stored = 1;
    if (eipWorkerEnter(w)) {
        w->news.inFaults = 1;
        w->hasNews = 1;
        epicsMutexUnlock(w->lock);
    }
}

void eipWorkerTagBad(eipWorker *w, const eipTag *tag, const char *reason)
{
    unsigned i;

    for (i = 0; i < tag->wants; i++)
        eipWorkerBad(w, &w->tags.wants[tag->from + i], reason);
}

/* --- One request ---------------------------------------------------------------------------- */

eipWriter eipWorkerWriter(eipWorker *w)
{
    return eipWriterOf(w->message, eipMessageMax);
}

static unsigned timeoutMs(const eipWorker *w)
{
    return w->now.requestTimeout < 10 ? 10 : (unsigned)w->now.requestTimeout;
}

static void count(eipWorker *w, size_t sent, size_t received, epicsUInt64 began,
                  eipOutcome outcome)
{
    double latency = (double)(epicsMonotonicGet() - began) / 1e6;

    w->lastAsk = epicsMonotonicGet();
    w->turnRequests++;
    if (!eipWorkerEnter(w))
        return;
    w->news.requests++;
    w->news.bytesOut += sent;
    w->news.bytesIn += received;
    w->news.timeouts += outcome == eipTooLate;
    if (outcome == eipAnswered) {
        w->news.latency = latency;
        if (latency > w->news.latencyMax)
            w->news.latencyMax = latency;
    }
    w->hasNews = 1;
    epicsMutexUnlock(w->lock);
}

/* Sends n bytes of w->frame; the answer is in w->socket.buffer. Returns its outcome; eipBroken
 * also when the session is over. */
static eipOutcome exchange(eipWorker *w, size_t n, unsigned ms, size_t *length)
{
    epicsUInt64 began = epicsMonotonicGet();
    eipOutcome outcome;

    *length = 0;
    if (!eipWorkerEnter(w))
        return eipBroken;
    w->busy = 1;
    epicsMutexUnlock(w->lock);
    outcome = eipSocketAsk(&w->socket, w->frame, n, ms, length, w->lost, sizeof(w->lost));
    epicsMutexMustLock(w->lock);
    w->busy = 0;
    epicsMutexUnlock(w->lock);
    count(w, n, *length, began, outcome);
    return outcome;
}

/* The PLC's end of the connection is gone, or the controller behind the module. */
static int isOver(const eipAnswer *a)
{
    return a->status == eipConnectionFailure &&
           (a->extended == eipExtNoConnection || a->extended == 0x0203 ||
            a->extended == 0x0204 || a->extended == 0x0205 || a->extended == 0x0311 ||
            a->extended == 0x0312);
}

/* What was being asked when the connection was lost, twice, is not asked for again. */
static void blame(eipWorker *w)
{
    switch (w->asking) {
    case eipAskBrowse:
        w->noBrowse++;
        break;
    case eipAskProgram:
        w->noProgram++;
        break;
    case eipAskModify:
        w->noModify++;
        break;
    default:
        break;
    }
}

int eipWorkerAsk(eipWorker *w, eipWriter *m, eipAnswer *answer)
{
    size_t length, n = m->full ? 0
                               : eipSessionWrap(&w->connect.session, eipWayNormal, m->start,
                                                m->n, w->frame, eipFrameMax);

    if (!n) {
        strcpy(w->lost, "a message is too long");
        return -1;
    }
    if (exchange(w, n, timeoutMs(w), &length) != eipAnswered)
        return -1;
    if (eipSessionUnwrap(&w->connect.session, w->socket.buffer, length, answer, w->lost,
                         sizeof(w->lost))) {
        blame(w); /* twice: it has answered, and does not know this */
        return -1;
    }
    if (isOver(answer)) {
        eipStatusText(answer->status, answer->extended, w->lost, sizeof(w->lost));
        return -1;
    }
    if (answer->status && answer->status != eipPartial && eipWorkerEnter(w)) {
        w->news.exceptions++;
        epicsMutexUnlock(w->lock);
    }
    w->asking = eipAskOther;
    return 0;
}

/* The answers of several: only when all of them are sound does any count. take may ask on, so
 * request and answer are copied first. */
static int takeMany(eipWorker *w, unsigned count, const eipAnswer *all,
                    void (*take)(eipWorker *w, unsigned i, const eipAnswer *answer,
                                 void *arg),
                    void *arg)
{
    epicsUInt8 *copy = mallocMustSucceed(all->length + count + 1, "etherip");
    epicsUInt8 *services = copy + all->length;
    eipAnswer local = *all, one;
    const epicsUInt8 *bytes;
    size_t length;
    unsigned i;

    memcpy(copy, all->data, all->length);
    local.data = copy;
    for (i = 0; i < count && !w->lost[0]; i++) {
        services[i] = w->message[eipMultipleHead - 2 +
                                 eipGetUnsigned(w->message + eipMultipleHead +
                                                    eipMultipleEach * i, 2)];
        bytes = eipMultipleTake(&local, count, i, &length);
        if (!bytes || eipAnswerTake(bytes, length, services[i], &one))
            strcpy(w->lost, "answer of several not understood");
    }
    for (i = 0; i < count && !w->lost[0]; i++) {
        bytes = eipMultipleTake(&local, count, i, &length);
        eipAnswerTake(bytes, length, services[i], &one);
        take(w, i, &one, arg);
    }
    free(copy);
    return w->lost[0] ? -1 : 0;
}

int eipWorkerAskMany(eipWorker *w, unsigned count, int always,
                     void (*put)(eipWorker *w, eipWriter *m, unsigned i, void *arg),
                     void (*take)(eipWorker *w, unsigned i, const eipAnswer *answer,
                                  void *arg),
                     void *arg)
{
    int several = count > 1 || (always && w->limits.multiple != 1);
    eipWriter m = eipWorkerWriter(w);
    eipAnswer answer;
    unsigned i;

    if (several)
        eipMultipleBegin(&m, count);
    for (i = 0; i < count; i++) {
        if (several)
            eipMultipleNext(&m, i);
        put(w, &m, i, arg);
    }
    if (eipWorkerAsk(w, &m, &answer))
        return -1;
    if (!several) {
        take(w, 0, &answer, arg);
        return w->lost[0] ? -1 : 0;
    }
    if (answer.status == eipSuccess || answer.status == eipEmbedded)
        return takeMany(w, count, &answer, take, arg);
    if (answer.status == eipNoService && w->limits.multiple != 1) {
        w->limits.multiple = 1;
        w->noMultiple = 1;
        eipWorkerNote(w, "the PLC takes one service in a message only");
        eipReadsReplan(w);
        return 0; /* all of it comes again */
    }
    if (w->limits.room > 200) { /* too much for this PLC: less the next time */
        w->limits.room -= w->limits.room / 4;
        eipWorkerNote(w, "the PLC refuses %u services in a message: %u bytes from now on",
                      count, w->limits.room);
        eipReadsReplan(w);
        return 0;
    }
    for (i = 0; i < count; i++)
        take(w, i, &answer, arg);
    return w->lost[0] ? -1 : 0;
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
    if (fresh) {
        unsigned skip = w->connect.skip;

        eipConnectInit(&w->connect, &options);
        w->connect.skip = skip;
    }
    w->open = w->taught = 0;
    w->lost[0] = 0;
    w->asking = eipAskOther;
    memset(w->leaving, 0, w->setup.outSize);
    eipConnectBegin(&w->connect, (epicsUInt32)epicsMonotonicGet());
}

/* The first time that a PLC does not answer a step, the connection is lost; it is left out on
 * the next one. */
static void openSession(eipWorker *w)
{
    size_t n, length;

    while ((n = eipConnectNext(&w->connect, w->frame, eipFrameMax)) != 0) {
        if (exchange(w, n, timeoutMs(w), &length) != eipAnswered) {
            if (eipWorkerEnter(w)) {
                epicsMutexUnlock(w->lock);
                eipConnectNoAnswer(&w->connect);
            }
            return;
        }
        if (eipConnectTake(&w->connect, w->socket.buffer, length, w->lost, sizeof(w->lost)))
            return;
    }
    w->open = 1;
    w->limits.room = w->connect.room;
    w->limits.multiple = w->noMultiple ? 1 : w->connect.multiple;
    w->epoch = epicsMonotonicGet();
    epicsMutexMustLock(w->tagsLock);
    w->tags.omron = w->connect.identity.vendor == eipVendorOmron;
    epicsMutexUnlock(w->tagsLock);
    eipLearnBegin(w);
    eipReadsBegin(w);
    if (eipWorkerEnter(w)) {
        w->state.connected = 1;
        w->state.identity = w->connect.identity;
        eipConnectText(&w->connect, w->state.way, sizeof(w->state.way));
        if (!w->setup.outSize)
            w->news.shown = 1;
        eipWorkerTell(w);
    }
}

/* The connection is of no use any more. What was to leave on it has not left: that is a fault
 * until it has. */
static void giveUp(eipWorker *w)
{
    size_t i;

    blame(w);
    w->asking = eipAskOther;
    if (!w->lost[0])
        strcpy(w->lost, "connection lost");
    if (eipWorkerEnter(w)) {
        for (i = 0; i < w->setup.outSize; i++)
            w->leaving[i] |= w->owed[i];
        w->news.outFaults |= plcFaultsSet(w->setup.outFaults, 0, w->setup.outSize,
                                          w->leaving, w->lost);
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
    eipWant *wants = NULL;
    unsigned count = 0, i;
    int fresh;

    epicsMutexMustLock(w->lock);
    w->now = w->options;
    fresh = w->newWants;
    if (fresh) {
        wants = w->wants;
        count = w->wantCount;
        w->wants = NULL;
        w->wantCount = 0;
        w->newWants = 0;
    }
    epicsMutexUnlock(w->lock);
    if (!fresh)
        return;
    for (i = 0; i < count; i++)
        if (wants[i].fresh) {
            memset(w->in + wants[i].place, 0, wants[i].room);
            plcFaultsClear(w->setup.inFaults, wants[i].place, wants[i].room, NULL);
        }
    epicsMutexMustLock(w->tagsLock);
    w->turn = NULL;
    if (eipTagsSet(&w->tags, wants, count))
        cantProceed("etherip: no memory for %u tags\n", count);
    epicsMutexUnlock(w->tagsLock);
    w->browser.stage = w->browser.stage == eipBrowseNot ? eipBrowseNot : eipBrowseTags;
    eipBrowseEnd(w);
    w->replan = 1;
}

/* A connection on which nobody asks anything would be closed by the PLC. */
static int keepAlive(eipWorker *w, epicsUInt64 now, epicsUInt64 *next)
{
    epicsUInt64 pause = (epicsUInt64)w->connect.session.opening.interval * 4000;
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
    if (!status)
        status = eipReadsStep(w, now, &next);
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
