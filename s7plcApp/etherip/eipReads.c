/* The reads of a worker: which units are due together, in which messages they go, and what
 * becomes of the answers; see eipWorkerPvt.h. All functions run in the worker's thread. */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>

#include "eipWorkerPvt.h"

enum {
    together = 10,      /* % of the shortest period: what is due by then goes along */
    publishMs = 50,     /* a turn that takes longer shows what it has so far */
    lateMs = 200,       /* so long after its time a turn goes on between puts */
    wholeMax = 1 << 22, /* bytes of one unit */
    lostTags = 5        /* so many that are unknown at once: another program */
};

/* --- Plans ------------------------------------------------------------------------------------ */

static unsigned classOf(const eipWorker *w, unsigned period)
{
    unsigned i, best = 0;

    for (i = 0; i < w->classCount; i++)
        if (w->classes[i].period == period)
            return i;
    for (i = 0; i < w->classCount; i++) /* too many: the next faster one */
        if (w->classes[i].period < period &&
            (w->classes[best].period > period ||
             w->classes[i].period > w->classes[best].period))
            best = i;
    return best;
}

void eipReadsBegin(eipWorker *w)
{
    unsigned i;

    eipPlansFree(w);
    w->firstTurn = 1;
    w->stored = 0;
    w->published = 0;
    for (i = 0; i < w->classCount; i++)
        w->classes[i].due = 0;
}

/* Instances are good only with the answer to the question for the program. */
static int isVerifying(const eipWorker *w)
{
    return w->tags.byInstance && w->programLength;
}

/* What a message has room for, beside that question. */
static eipLimits planLimits(const eipWorker *w)
{
    eipLimits limits = w->limits;

    if (!isVerifying(w))
        return limits;
    limits.room -= eipProgramLoad(w);
    if (limits.multiple > 1)
        limits.multiple--;
    return limits;
}

/* The messages for all units of these classes. */
static eipReadPlan *makePlan(eipWorker *w, epicsUInt64 classes)
{
    const eipTags *t = &w->tags;
    eipReadPlan *plan = &w->plans[w->planNext];
    eipLoad *loads = callocMustSucceed(t->unitCount + 1, sizeof(*loads), "etherip");
    unsigned *units = callocMustSucceed(t->unitCount + 1, sizeof(*units), "etherip");
    unsigned *bins = callocMustSucceed(t->unitCount + 1, sizeof(*bins), "etherip");
    eipLimits limits = planLimits(w);
    unsigned n = 0, i;

    if (w->planNext < w->planCount) {
        free(plan->units);
        free(plan->ends);
    } else {
        w->planCount++;
    }
    w->planNext = (w->planNext + 1) % eipPlansMax;
    for (i = 0; i < t->unitCount; i++)
        if (classes >> classOf(w, t->units[i].period) & 1) {
            loads[n] = eipUnitLoad(t, &t->units[i], t->byInstance);
            units[n++] = i;
        }
    plan->classes = classes;
    plan->messages = eipPack(loads, n, &limits, 0, bins);
    plan->units = callocMustSucceed(n + 1, sizeof(*units), "etherip");
    plan->ends = callocMustSucceed(plan->messages + 1, sizeof(*units), "etherip");
    for (i = 0; i < n; i++)
        plan->ends[bins[i]]++;
    for (i = 1; i < plan->messages; i++)
        plan->ends[i] += plan->ends[i - 1];
    for (i = n; i-- > 0;) /* ends are starts, and back again */
        plan->units[--plan->ends[bins[i]]] = units[i];
    for (i = 0; i + 1 < plan->messages; i++)
        plan->ends[i] = plan->ends[i + 1];
    if (plan->messages)
        plan->ends[plan->messages - 1] = n;
    free(loads);
    free(units);
    free(bins);
    return plan;
}

static eipReadPlan *planFor(eipWorker *w, epicsUInt64 classes)
{
    unsigned i;

    for (i = 0; i < w->planCount; i++)
        if (w->plans[i].classes == classes)
            return &w->plans[i];
    return makePlan(w, classes);
}

/* --- Turns ------------------------------------------------------------------------------------ */

/* The classes that are due, or nearly so; their next time is set. 0: none, and *next says when
 * there is one. */
static epicsUInt64 dueClasses(eipWorker *w, epicsUInt64 now, epicsUInt64 *next)
{
    epicsUInt64 first = EIP_NEVER, shortest = EIP_NEVER, classes = 0, limit;
    unsigned i;

    for (i = 0; i < w->classCount; i++) {
        epicsUInt64 period = w->classes[i].period * EIP_NS_PER_MS;

        if (w->classes[i].due < first)
            first = w->classes[i].due;
        if (period < shortest)
            shortest = period;
    }
    if (first > now) {
        if (first < *next)
            *next = first;
        return 0;
    }
    limit = now + shortest * together / 100;
    for (i = 0; i < w->classCount; i++) {
        eipClass *c = &w->classes[i];
        epicsUInt64 period = c->period * EIP_NS_PER_MS, behind;

        if (c->due > limit)
            continue;
        classes |= (epicsUInt64)1 << i;
        behind = c->due > now ? c->due : now;
        if (c->due && now > c->due + period) {
            epicsMutexMustLock(w->lock);
            w->state.late += (now - c->due) / period;
            epicsMutexUnlock(w->lock);
        }
        c->due = eipNextDue(w->epoch, period, behind);
    }
    return classes;
}

/* What was written since it was read is newer than that, and so is what waits, once the
 * outputs have taken their first values from the PLC. */
void eipReadsShow(eipWorker *w)
{
    size_t i;

    if (!w->setup.outSize || w->firstTurn)
        return;
    w->newsUsed = w->used;
    w->through = plcImagePutsThrough(w->setup.out, NULL); /* first: what comes now is not in it */
    memcpy(w->outNews, w->in, w->used);
    memset(w->waiting, 0, w->used);
    if (w->mayWrite)
        plcImagePutsWaiting(w->setup.out, NULL, w->waiting);
    plcImagePeek(w->setup.out, 0, w->used, w->values);
    for (i = 0; i < w->used; i++) {
        epicsUInt8 ours = w->waiting[i], held = w->written[i] & (epicsUInt8)~ours;

        w->older[i] = ours | w->unread[i];
        w->outNews[i] = (epicsUInt8)((w->outNews[i] & ~(ours | held)) | (w->values[i] & ours) |
                                     (w->holds[i] & held));
    }
    w->news.shown = 1;
}

/* Places have a value, for the first time or again: outputs that had none follow it, and what
 * was refused before is of no interest any more. The lock is held. */
static void endFaults(eipWorker *w)
{
    if (!w->someBack)
        return;
    w->news.inFaults |= plcFaultsClear(w->setup.inFaults, 0, w->used, w->back);
    plcFaultsClear(w->setup.outFaults, 0, w->used, w->back);
    w->news.outFaults = 1;
    memset(w->back, 0, w->used);
    w->someBack = 0;
}

static void publish(eipWorker *w, epicsUInt64 now)
{
    w->stored = 0;
    w->published = now;
    if (!eipWorkerEnter(w))
        return;
    memcpy(w->inNews, w->in, w->used);
    w->newsUsed = w->used;
    epicsTimeGetCurrent(&w->news.stamp);
    w->news.blocks++;
    eipReadsShow(w);
    endFaults(w);
    eipWorkerTell(w);
}

static void endTurn(eipWorker *w)
{
    epicsUInt64 now = epicsMonotonicGet();
    double took = (double)(now - w->turnStart) / 1e9;
    unsigned i;

    epicsMutexMustLock(w->lock);
    w->state.requests = w->turnRequests;
    for (i = 0; i < w->classCount; i++) {
        eipTimes *t = &w->classes[i].times;

        if (!(w->turn->classes >> i & 1))
            continue;
        t->last = took;
        t->min = t->turns && t->min < took ? t->min : took;
        t->max = t->max > took ? t->max : took;
        t->turns++;
        epicsTimeGetCurrent(&t->stamp);
    }
    epicsMutexUnlock(w->lock);
    w->turn = NULL;
    w->turnEnded = 1;
    w->firstTurn = 0;
    publish(w, now);
    if (w->unknownRefusals >= lostTags) {
        eipWorkerNote(w, "%u tags are unknown at once: all are learned anew",
                      w->unknownRefusals);
        w->relearn = 1;
    }
    w->unknownRefusals = 0;
}

/* --- Answers ---------------------------------------------------------------------------------- */

/* It will soon be known what structures are. */
static int templatesCome(const eipWorker *w)
{
    return w->browser.stage != eipBrowseDone && w->noBrowse < eipSilentTwice;
}

static void storeUnit(eipWorker *w, eipUnit *u, const eipData *data)
{
    const eipTags *t = &w->tags;
    const char *why;
    unsigned i;

    for (i = u->from; i < u->from + u->pieces; i++) {
        const eipPiece *p = &t->pieces[i];
        const eipWant *want = &t->wants[p->want];
        unsigned before = (unsigned)eipGetUnsigned(w->in + want->place, 2);

        memset(w->written + want->place, 0, want->room);
        memset(w->unread + want->place, 0, want->room);
        if (want->kind == eipTextPlace && p->text == eipTextPerhaps && templatesCome(w))
            continue;
        why = eipPieceStore(t, p, data->bytes, data->length, w->in);
        if (why)
            eipWorkerBad(w, want, why);
        else if (before != p->code) { /* it has a value again, or it is another one */
            memset(w->back + want->place, 0xff, want->room);
            w->someBack = 1;
        }
    }
    w->stored = 1;
    if (u->refused) {
        w->tags.wants[t->pieces[u->from].want].refused = 0;
        w->replan = 1;
    }
}

/* The tag is another one than it was. */
static void relearn(eipWorker *w, eipTag *tag, int newProgram)
{
    epicsMutexMustLock(w->tagsLock);
    eipTagSetState(&w->tags, tag, eipTagNew);
    tag->instance = 0; /* they change with a download */
    epicsMutexUnlock(w->tagsLock);
    w->unknownRefusals += (unsigned)newProgram;
    w->replan = 1;
}

static void badUnit(eipWorker *w, eipUnit *u, const char *reason)
{
    const eipTag *tag = &w->tags.tags[u->tag];
    char name[eipNameMax + 16];
    unsigned i;

    for (i = u->from; i < u->from + u->pieces; i++) {
        eipWant *want = &w->tags.wants[w->tags.pieces[i].want];

        if (want->kind == eipArrayPlace && !eipTypeOf(tag->code)->size)
            reason = eipNoArray; /* that the PLC has but one of it is not what is wrong */
        eipWorkerBad(w, want, reason);
        want->refused = 1;
    }
    if (!u->refused) {
        eipElementText(tag->base, tag->indexed, u->first, name, sizeof(name));
        eipWorkerNoteOf(w, &w->tags.wants[w->tags.pieces[u->from].want], "tag %.80s: %s", name, reason);
        w->replan = 1;
    }
    u->refused = 1;
}

static void refused(eipWorker *w, unsigned number, const eipAnswer *answer)
{
    eipUnit *u = &w->tags.units[number];
    eipTag *tag = &w->tags.tags[u->tag];
    int isEnd = eipAnswerIsEnd(answer);
    int isUnknown = answer->status == eipPathSegment || answer->status == eipPathUnknown;
    /* Some say of an element beyond the end what they say of a tag that is not there. */
    int isElement = isUnknown && (u->first > 0 || u->pieces > 1);
    int split;
    char reason[PLC_REASON_SIZE];

    eipWorkerReason(answer, reason);
    if (isElement)
        epicsSnprintf(reason, sizeof(reason), "PLC: no such element (%02X)", answer->status);
    if (u->whole || ((isEnd || isElement) && u->pieces > 1)) {
        epicsMutexMustLock(w->tagsLock);
        split = eipUnitSplit(&w->tags, number);
        epicsMutexUnlock(w->tagsLock);
        if (split)
            w->replan = 2; /* the parts are read at once */
    } else if ((isUnknown && !isElement) || eipAnswerIsOtherType(answer)) {
        relearn(w, tag, isUnknown);
    } else {
        badUnit(w, u, reason);
    }
}

static int isSameType(const eipWorker *w, const eipUnit *u, const eipData *data)
{
    const eipTag *tag = &w->tags.tags[u->tag];

    if (u->whole)
        return data->code == eipStructureCode && data->handle == u->handle;
    return data->code == tag->code && data->handle == tag->handle;
}

/* An answer that is through. */
static void takeData(eipWorker *w, unsigned number, const eipAnswer *answer,
                     const eipData *data)
{
    eipUnit *u = &w->tags.units[number];

    if (answer->status)
        refused(w, number, answer);
    else if (isSameType(w, u, data))
        storeUnit(w, u, data);
    else if (u->whole)
        refused(w, number, answer);
    else
        relearn(w, &w->tags.tags[u->tag], 0);
}

static void putFragment(eipWorker *w, const eipUnit *u, size_t from, eipAnswer *answer,
                        int *status)
{
    eipWriter m = eipWorkerWriter(w);

    eipUnitPut(&m, &w->tags, u, 0, from ? (long)from : -1);
    *status = eipWorkerAsk(w, &m, answer);
}

/* Whole elements only: offsets are multiples of them. */
static size_t whole(const eipUnit *u, size_t got)
{
    return u->size && got > u->size && u->size <= 8 ? got - got % u->size : got;
}

static void assemble(eipWorker *w, size_t at, const epicsUInt8 *bytes, size_t length)
{
    if (at + length > w->assemblyRoom) {
        w->assemblyRoom = (at + length) * 2;
        w->assembly = realloc(w->assembly, w->assemblyRoom);
        if (!w->assembly)
            cantProceed("etherip: no memory for a tag of %lu bytes\n", (unsigned long)at);
    }
    memcpy(w->assembly + at, bytes, length);
}

/* A controller that has no fragments: as many elements at a time as fit. */
static int readRuns(eipWorker *w, const eipUnit *u, eipAnswer *answer, eipData *data)
{
    size_t all = (size_t)u->count * u->size, got, length;
    unsigned head = eipUnitLoad(&w->tags, u, 0).answer - (unsigned)all;
    unsigned most = w->limits.room < head + u->size ? 1 : (w->limits.room - head) / u->size, code = 0;
    eipUnit run = *u;
    eipData part = {0};

    answer->status = 0;
    for (got = 0; got < all; got += length, run.first += run.count) {
        eipWriter m = eipWorkerWriter(w);
        unsigned left = (unsigned)((all - got) / u->size);

        run.count = left < most ? left : most;
        length = (size_t)run.count * u->size;
        eipUnitPut(&m, &w->tags, &run, 0, -1);
        if (eipWorkerAsk(w, &m, answer))
            return -1;
        if (answer->status)
            return 0;
        if (eipDataTake(answer, &part) || part.length < length || (got && part.code != code)) {
            strcpy(w->lost, "part of an array not understood");
            return -1;
        }
        code = part.code;
        assemble(w, got, part.bytes, length);
    }
    *data = (eipData){part.code, part.handle, w->assembly, got};
    return 0;
}

int eipReadWhole(eipWorker *w, const eipUnit *u, size_t from, eipAnswer *answer,
                 eipData *data)
{
    size_t got = from;
    eipData part;
    int status;

    if (w->tags.omron && u->count > 1)
        return readRuns(w, u, answer, data);
    do {
        putFragment(w, u, got, answer, &status);
        if (status)
            return -1;
        if (answer->status && answer->status != eipPartial)
            return 0;
        if (eipDataTake(answer, &part) || got + part.length > wholeMax ||
            (answer->status == eipPartial && !whole(u, part.length))) {
            strcpy(w->lost, "fragment not understood");
            return -1;
        }
        assemble(w, got, part.bytes, part.length);
        got += answer->status == eipPartial ? whole(u, part.length) : part.length;
    } while (answer->status == eipPartial);
    *data = (eipData){part.code, part.handle, w->assembly, got};
    return 0;
}

/* The answer did not fit: the message was planned too large. */
static void learnRoom(eipWorker *w, const eipUnit *u, const eipAnswer *answer)
{
    unsigned planned = eipUnitLoad(&w->tags, u, 0).answer;
    unsigned got = eipAnswerHead + (unsigned)answer->length;
    unsigned less = planned > got ? planned - got : 0;

    if (!less || planned > w->limits.room || w->limits.room < less + 100)
        return;
    w->limits.room -= less;
    eipWorkerNote(w, "answers of the PLC have %u bytes at most", w->limits.room);
    w->replan = 1;
}

/* --- Messages --------------------------------------------------------------------------------- */

/* One goes by its name; several by their instances. */
static void putUnit(eipWorker *w, eipWriter *m, unsigned i, void *arg)
{
    const unsigned *units = arg;

    eipUnitPut(m, &w->tags, &w->tags.units[units[i]], 0, -1);
}

static void putByInstance(eipWorker *w, eipWriter *m, unsigned i, void *arg)
{
    const unsigned *units = arg;

    eipUnitPut(m, &w->tags, &w->tags.units[units[i]], 1, -1);
}

static void takeUnit(eipWorker *w, unsigned i, const eipAnswer *answer, void *arg)
{
    const unsigned *units = arg;
    eipUnit *u = &w->tags.units[units[i]], copy;
    eipAnswer last = *answer;
    eipData data = {0};

    if (answer->status == eipPartial) {
        learnRoom(w, u, answer);
        copy = *u;
        if (eipReadWhole(w, &copy, 0, &last, &data))
            return;
    } else if (!answer->status && eipDataTake(answer, &data)) {
        last.status = eipGeneral; /* a type that nobody knows */
    }
    takeData(w, units[i], &last, &data);
}

/* The next message of the turn. */
static int sendMessage(eipWorker *w)
{
    eipReadPlan *plan = w->turn;
    unsigned from = w->turnMessage ? plan->ends[w->turnMessage - 1] : 0;
    unsigned count = plan->ends[w->turnMessage] - from, i;
    unsigned *units = mallocMustSucceed(count * sizeof(*units) + 1, "etherip");
    eipLoad load;
    eipAnswer answer;
    eipData data = {0};
    eipUnit copy;
    int status = 0;

    for (i = 0; i < count; i++)
        units[i] = plan->units[from + i];
    w->turnMessage++;
    load = eipUnitLoad(&w->tags, &w->tags.units[units[0]], 0);
    if (count == 1 && !eipFitsAlone(&load, &w->limits)) {
        copy = w->tags.units[units[0]];
        status = eipReadWhole(w, &copy, 0, &answer, &data);
        if (!status)
            takeData(w, units[0], &answer, &data);
    } else if (count == 1 || !w->tags.byInstance) {
        status = eipWorkerAskMany(w, count, eipAskPlain, putUnit, takeUnit, units);
    } else {
        status = eipWorkerAskMany(w, count, isVerifying(w) ? eipAskVerified : eipAskPlain,
                                  putByInstance, takeUnit, units);
        w->programDue = epicsMonotonicGet() + (epicsUInt64)w->now.relearn * EIP_NS_PER_MS;
    }
    free(units);
    return status || w->lost[0] ? -1 : 1;
}

int eipReadsStep(eipWorker *w, epicsUInt64 now, epicsUInt64 *next)
{
    epicsUInt64 classes;
    unsigned i;

    if (!w->taught)
        return 0;
    if (!w->turn) {
        if (!w->classCount && w->firstTurn) {
            w->firstTurn = 0; /* nothing is wanted, or nothing is good */
            publish(w, now);
        }
        classes = dueClasses(w, now, next);
        if (!classes) {
            if (w->stored)
                publish(w, now);
            return 0;
        }
        w->turn = planFor(w, classes);
        w->turnMessage = 0;
        w->turnStart = now;
        w->turnRequests = 0;
    }
    if (w->turnMessage < w->turn->messages && sendMessage(w) < 0)
        return -1;
    if (!w->turn || w->otherProgram) /* the plan is void: the turn begins anew */
        return 1;
    if (w->turnMessage >= w->turn->messages) {
        int again = w->replan == 2;

        endTurn(w);
        if (again) {
            eipPlansRenew(w);
            w->replan = 0;
            for (i = 0; i < w->classCount; i++)
                w->classes[i].due = 0;
        }
    } else if (w->stored && !w->firstTurn && now > w->turnStart + publishMs * EIP_NS_PER_MS &&
               now > w->published + publishMs * EIP_NS_PER_MS) {
        publish(w, now);
    }
    return 1;
}

/* Else many puts to a slow PLC would leave old values with the records as good. */
int eipReadsLate(const eipWorker *w)
{
    epicsUInt64 limit = epicsMonotonicGet() - lateMs * EIP_NS_PER_MS;
    unsigned i;

    if (!w->taught)
        return 0;
    if (w->turn)
        return w->turnStart < limit;
    for (i = 0; i < w->classCount; i++)
        if (w->classes[i].due < limit)
            return 1;
    return 0;
}
