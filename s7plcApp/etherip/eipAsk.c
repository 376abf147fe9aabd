/* One request of a worker, or several in one message, and what their answers are worth; see
 * eipWorkerPvt.h. All functions run in the worker's thread. */
#include <string.h>
#include <stdlib.h>

#include <cantProceed.h>
#include <epicsStdio.h>

#include "eipWorkerPvt.h"

/* --- One request ---------------------------------------------------------------------------- */

eipWriter eipWorkerWriter(eipWorker *w)
{
    return eipWriterOf(w->message, eipMessageMax);
}

unsigned eipWorkerTimeout(const eipWorker *w)
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
eipOutcome eipWorkerExchange(eipWorker *w, size_t n, unsigned ms, size_t *length)
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
           (a->extended == 0x0203 || a->extended == 0x0204 || a->extended == 0x0205 || a->extended == 0x0311 ||
            a->extended == 0x0312);
}

/* What was being asked when the connection was lost, twice, is not asked for again. */
void eipWorkerBlame(eipWorker *w)
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

/* Opens the connection in the controller again, as it was. Returns 0, or -1: the session is
 * over. */
static int reopen(eipWorker *w)
{
    unsigned room = w->connect.room;
    size_t n, length;

    eipConnectReopen(&w->connect);
    while ((n = eipConnectNext(&w->connect, w->frame, eipFrameMax)) != 0)
        if (eipWorkerExchange(w, n, eipWorkerTimeout(w), &length) != eipAnswered ||
            eipConnectTake(&w->connect, w->socket.buffer, length, w->lost, sizeof(w->lost)))
            return -1;
    if (w->connect.session.connected && w->connect.room >= room) {
        eipWorkerNote(w, "the PLC did not know the connection any more: opened again");
        return 0;
    }
    strcpy(w->lost, "connection not known to the PLC");
    return -1;
}

static int ask(eipWorker *w, eipWriter *m, eipAnswer *answer)
{
    size_t length, n = m->full ? 0
                               : eipSessionWrap(&w->connect.session, eipWayNormal, m->start,
                                                m->n, w->frame, eipFrameMax);

    if (!n) {
        strcpy(w->lost, "a message is too long");
        return -1;
    }
    if (eipWorkerExchange(w, n, eipWorkerTimeout(w), &length) != eipAnswered)
        return -1;
    if (eipSessionUnwrap(&w->connect.session, w->socket.buffer, length, answer, w->lost,
                         sizeof(w->lost))) {
        eipWorkerBlame(w); /* twice: it has answered, and does not know this */
        return -1;
    }
    return 0;
}

static int isForgotten(const eipAnswer *a)
{
    return a->status == eipConnectionFailure && a->extended == eipExtNoConnection;
}

int eipWorkerAsk(eipWorker *w, eipWriter *m, eipAnswer *answer)
{
    if (ask(w, m, answer))
        return -1;
    if (isForgotten(answer) && w->connect.session.connected &&
        (reopen(w) || ask(w, m, answer)))
        return -1;
    if (isOver(answer) || isForgotten(answer)) {
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

/* --- Which program --------------------------------------------------------------------------- */

static const unsigned programAttributes[] = {1, 2, 3, 4, 10};

enum {
    programClass = 0xac,
    programCount = sizeof(programAttributes) / sizeof(programAttributes[0]),
    programAsk = 2 + 4 + 2 + 2 * programCount /* bytes */
};

void eipProgramPut(eipWriter *m)
{
    epicsUInt8 path[12];
    unsigned i;

    eipRequestPut(m, eipGetAttributeList, path, eipObjectPath(path, programClass, 1, 0));
    eipPut16(m, programCount);
    for (i = 0; i < programCount; i++)
        eipPut16(m, programAttributes[i]);
}

int eipProgramIs(const eipWorker *w, const eipAnswer *answer)
{
    return !answer->status && answer->length == w->programLength &&
           memcmp(answer->data, w->program, answer->length) == 0;
}

unsigned eipProgramLoad(const eipWorker *w)
{
    unsigned answer = eipAnswerHead + (unsigned)w->programLength;

    return eipMultipleEach + (answer > programAsk ? answer : programAsk);
}

/* Behind others in one message. Returns 1 when these count. One that did not fit any more says
 * nothing: the message was too large. */
static int isVerified(eipWorker *w, const eipAnswer *answer)
{
    if (eipProgramIs(w, answer))
        return 1;
    if (answer->status != eipPartial || w->limits.room <= 200) {
        w->otherProgram = 1;
        return 0;
    }
    w->limits.room -= eipProgramLoad(w);
    eipWorkerNote(w, "answers of the PLC have %u bytes at most", w->limits.room);
    eipPlansRenew(w);
    return 0;
}

/* --- Several ---------------------------------------------------------------------------------- */

/* The answers of several: only when all of them are sound does any count. take may ask on, so
 * request and answer are copied first. The last one is `verifying`. */
static int takeMany(eipWorker *w, unsigned count, int verifying, const eipAnswer *all,
                    void (*take)(eipWorker *w, unsigned i, const eipAnswer *answer,
                                 void *arg),
                    void *arg)
{
    epicsUInt8 *copy = mallocMustSucceed(all->length + count + 1, "etherip");
    epicsUInt8 *services = copy + all->length;
    eipAnswer local = *all, one = *all;
    const epicsUInt8 *bytes;
    size_t length;
    unsigned good = count, i;

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
    if (verifying)
        good = !w->lost[0] && isVerified(w, &one) ? count - 1 : 0;
    for (i = 0; i < good && !w->lost[0]; i++) {
        bytes = eipMultipleTake(&local, count, i, &length);
        eipAnswerTake(bytes, length, services[i], &one);
        take(w, i, &one, arg);
    }
    free(copy);
    return w->lost[0] ? -1 : 0;
}

int eipWorkerAskMany(eipWorker *w, unsigned count, eipAskHow how,
                     void (*put)(eipWorker *w, eipWriter *m, unsigned i, void *arg),
                     void (*take)(eipWorker *w, unsigned i, const eipAnswer *answer,
                                  void *arg),
                     void *arg)
{
    int several = count > 1 || (how != eipAskPlain && w->limits.multiple != 1);
    int verifying = several && how == eipAskVerified;
    eipWriter m = eipWorkerWriter(w);
    eipAnswer answer;
    unsigned i;

    if (several)
        eipMultipleBegin(&m, count + (unsigned)verifying);
    for (i = 0; i < count; i++) {
        if (several)
            eipMultipleNext(&m, i);
        put(w, &m, i, arg);
    }
    if (verifying) {
        eipMultipleNext(&m, count);
        eipProgramPut(&m);
    }
    if (eipWorkerAsk(w, &m, &answer))
        return -1;
    if (!several) {
        take(w, 0, &answer, arg);
        return w->lost[0] ? -1 : 0;
    }
    if (answer.status == eipSuccess || answer.status == eipEmbedded)
        return takeMany(w, count + (unsigned)verifying, verifying, &answer, take, arg);
    if (answer.status == eipNoService && w->limits.multiple != 1) {
        w->limits.multiple = 1;
        w->noMultiple = 1;
        eipWorkerNote(w, "the PLC takes one service in a message only");
        eipPlansRenew(w);
        return 0; /* all of it comes again */
    }
    if (how == eipAskSeveral && count > 1) { /* what their answers take is not known yet */
        w->askMost = count / 2;
        return 0;
    }
    if (w->limits.room > 200) { /* too much for this PLC: less the next time */
        w->limits.room -= w->limits.room / 4;
        eipWorkerNote(w, "the PLC refuses %u services in a message: %u bytes from now on",
                      count, w->limits.room);
        eipPlansRenew(w);
        return 0;
    }
    for (i = 0; i < count; i++)
        take(w, i, &answer, arg);
    return w->lost[0] ? -1 : 0;
}
