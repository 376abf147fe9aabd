/* The reads of a Modbus PLC, each by its period, and what becomes of the answers; see
 * plcModbusPvt.h. Does not know how a turn is taken apart. All functions run in the worker's thread. */
#include <stdlib.h>
#include <string.h>

#include <epicsStdio.h>

#include "plcModbusPvt.h"

/* --- What the log says of it --------------------------------------------------------- */

/* What is refused now. A value of which all parts could be read is told of as its parts were, until it
 * was asked for as a whole. */
static plcHoles refusedNow(const plcModbus *m)
{
    plcHoles now = {NULL, 0, 0};
    unsigned i;

    for (i = 0; i < m->session.turnCount; i++) {
        const turn *t = &m->session.turns[i];
        plcHole hole = {t->request.table, t->request.unit, t->request.start, t->request.count,
                        t->refused};

        if (t->refused && t->unsure)
            plcHolesWithin(&now, hole, &m->holes);
        else if (t->refused)
            plcHolesAdd(&now, hole);
    }
    return now;
}

/* Lines for these holes, one for each reason and unit: "read of holding 4: ... (and of holding 17, coils 3)".
 * `good`: it is none any more. The lock is held. */
static void tellHoles(plcModbus *m, plcHoles *holes, int good)
{
    while (holes->count) {
        plcHole first = holes->hole[0];
        char text[40], unit[20], reason[PLC_REASON_SIZE], others[180] = "";
        unsigned i, left = 0, more = 0;
        size_t used = 0;

        for (i = 1; i < holes->count; i++) {
            plcHole *h = &holes->hole[i];

            if (h->unit != first.unit || (h->code != first.code && !good)) {
                holes->hole[left++] = *h;
                continue;
            }
            plcWorkerWhere(&(plcRequest){0, h->table, h->start, h->count, 0, h->unit}, text);
            if (used + strlen(text) > sizeof(others) - 40)
                more++;
            else
                used += (size_t)epicsSnprintf(others + used, sizeof(others) - used, "%s%s",
                                              used ? ", " : " (and of ", text);
        }
        holes->count = left;
        if (more)
            used += (size_t)epicsSnprintf(others + used, sizeof(others) - used, " and %u more", more);
        if (used)
            strcpy(others + used, ")");
        plcWorkerReason(m, first.code, reason);
        plcWorkerWhere(&(plcRequest){0, first.table, first.start, first.count, 0, first.unit}, text);
        plcWorkerNote(m, "read of %s%s: %s%s", text, plcWorkerUnit(m, first.unit, unit),
                      good ? "good again" : reason, others);
        m->hasNews = 1;
    }
}

/* Says what is news of the reads that are refused: each register once, whichever reads ask for it, and
 * not again after a new plan or connection. The lock is held. */
static void tellRefused(plcModbus *m)
{
    plcHoles now = refusedNow(m), bad = {NULL, 0, 0}, good = {NULL, 0, 0};
    unsigned i;

    for (i = 0; i < now.count; i++)
        plcHolesRest(&bad, now.hole[i], &m->holes, 0);
    for (i = 0; i < m->holes.count; i++)
        plcHolesRest(&good, m->holes.hole[i], &now, 1);
    tellHoles(m, &bad, 0);
    tellHoles(m, &good, 1);
    plcHolesFree(&bad);
    plcHolesFree(&good);
    plcHolesFree(&m->holes);
    m->holes = now;
    m->session.toTell = 0;
}

/* --- Answers ------------------------------------------------------------------------- */

/* These bits are good again in the image that is news next, or are not. The lock is held.
 */
static void markReadable(plcModbus *m, size_t offset, size_t size, const epicsUInt8 *mask,
                       int good)
{
    size_t i;

    for (i = 0; i < size; i++) {
        m->readable[offset + i] &= (epicsUInt8)~mask[i];
        m->clearing[offset + i] &= (epicsUInt8)~mask[i];
        m->readable[offset + i] |= good ? mask[i] : 0;
    }
    m->someReadable |= good;
}

/* The PLC has answered this read: code 0, or it was refused. */
static void setRefused(plcModbus *m, turn *t, int code)
{
    m->session.toTell |= t->refused != code || t->unsure;
    t->refused = code;
    t->asked = 1;
    t->unsure = 0;
}

static void inputRead(plcModbus *m, turn *t, int code)
{
    const plcRequest *q = &t->request;
    unsigned i, n = plcWorkerInPieces(m, q);
    int changed = 0;
    char reason[PLC_REASON_SIZE];

    plcWorkerReason(m, code, reason);
    if (!plcWorkerEnter(m))
        return;
    for (i = 0; i < n; i++) {
        const plcPiece *p = &m->pieces[i];
        epicsUInt8 mask[maskMax];

        plcWorkerPieceMask(q, p, mask);
        if (code)
            changed |= plcFaultsSet(m->setup.inFaults, p->offset,
                                    plcWorkerPieceBytes(q, p), mask, reason);
        else
            plcWorkerStore(m, q, p, m->in);
        if (t->refused || code || plcFaultsCount(m->setup.inFaults, p->offset, plcWorkerPieceBytes(q, p)))
            markReadable(m, p->offset, plcWorkerPieceBytes(q, p), mask, !code);
    }
    setRefused(m, t, code);
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

    plcImagePutsWaiting(m->setup.out, NULL, m->waiting);
    for (i = 0; i < m->setup.outSize; i++) {
        epicsUInt8 good = m->unsure[i];

        good &= (epicsUInt8) ~((m->out[i] ^ m->values[i]) | m->waiting[i]);
        if (!good)
            continue;
        m->unsure[i] &= (epicsUInt8)~good;
        m->news.outFaults |= plcFaultsClear(m->setup.outFaults, i, 1, &good);
    }
}

/* Which bits of the outputs the PLC refuses to show. Returns how many requests it answers. The
 * lock is held. */
static unsigned findHidden(plcModbus *m, const turn **first)
{
    session *s = &m->session;
    unsigned i, k, n, shown = 0;

    *first = NULL;
    m->hides = 0;
    memset(m->hidden, 0, m->setup.outSize);
    for (i = 0; i < s->turnCount; i++) {
        const turn *t = &s->turns[i];

        shown += t->output && !t->refused;
        if (!t->output || !t->refused)
            continue;
        *first = *first ? *first : t;
        n = plcWorkerOutPieces(m, &t->request);
        for (k = 0; k < n; k++) {
            epicsUInt8 mask[maskMax], *to = m->hidden + m->pieces[k].offset;
            size_t b, size = plcWorkerPieceBytes(&t->request, &m->pieces[k]);

            plcWorkerPieceMask(&t->request, &m->pieces[k], mask);
            for (b = 0; b < size; b++)
                to[b] |= mask[b];
        }
        m->hides |= n > 0;
    }
    return shown;
}

/* None of its outputs, and says so at once, not register by register. The lock is held. */
static void tellUnread(plcModbus *m)
{
    session *s = &m->session;
    unsigned i;

    plcWorkerNote(m, "outputs cannot be read: %s", m->news.unread);
    for (i = 0; i < s->turnCount; i++) {
        const plcRequest *q = &s->turns[i].request;

        if (s->turns[i].output)
            plcHolesAdd(&m->holes, (plcHole){q->table, q->unit, q->start, q->count,
                                            s->turns[i].refused});
    }
}

/* What was read of an input does not count. */
static void wholeIsRefused(plcModbus *m, turn *t)
{
    unsigned i, n = plcWorkerInPieces(m, &t->request);
    char reason[PLC_REASON_SIZE];

    t->refused = t->wholeCode;
    t->unsure = m->session.toTell = 1;
    plcWorkerReason(m, t->refused, reason);
    if (t->output || !plcWorkerEnter(m))
        return;
    for (i = 0; i < n; i++) {
        const plcPiece *p = &m->pieces[i];
        size_t size = plcWorkerPieceBytes(&t->request, p);
        epicsUInt8 mask[maskMax];

        plcWorkerPieceMask(&t->request, p, mask);
        m->news.inFaults |= plcFaultsSet(m->setup.inFaults, p->offset, size, mask, reason);
        markReadable(m, p->offset, size, mask, 0);
    }
    epicsMutexUnlock(m->lock);
}

/* Values of which all parts could be read are asked for as a whole the next time, and not shown
 * before: the parts may be of different moments. */
static void mendValues(plcModbus *m, int output)
{
    session *s = &m->session;
    unsigned i = 0, k, refused;

    while (i < s->turnCount) {
        const turn *t = &s->turns[i];

        for (refused = k = 0; k < s->turnCount; k++)
            refused += plcWorkerSameValue(t, &s->turns[k]) && s->turns[k].refused;
        if (!t->wholeCount || t->output != output || refused) {
            i++;
            continue;
        }
        wholeIsRefused(m, plcWorkerJoinParts(m, *t));
        i = 0;
    }
}

/* All output ranges have been read, or refused. */
static void tellOutputs(plcModbus *m)
{
    session *s = &m->session;
    const turn *refused;
    char reason[PLC_REASON_SIZE] = "";
    unsigned shown;

    s->outputsTried = 1;
    if (!plcWorkerEnter(m))
        return;
    shown = findHidden(m, &refused);
    if (refused)
        plcWorkerReason(m, refused->refused, reason);
    if (shown || !refused) {
        checkUnsure(m);
        memcpy(m->outNews, m->out, m->setup.outSize);
        /* What waits is newer than what was read, once outputs have what the PLC holds. */
        if (m->mayWrite)
            plcImagePutsWaiting(m->setup.out, m->outNews, m->waiting);
        m->news.shown = 1;
    }
    if (!refused) {
        m->news.unread[0] = 0;
    } else if (strcmp(reason, s->unread)) {
        strcpy(m->news.unread, reason);
        if (!shown)
            tellUnread(m);
    }
    strcpy(s->unread, reason);
    plcWorkerTell(m);
}

static void outputRead(plcModbus *m, turn *t, int code)
{
    unsigned i, n = plcWorkerOutPieces(m, &t->request);

    setRefused(m, t, code);
    for (i = 0; i < n && !code; i++)
        plcWorkerStore(m, &t->request, &m->pieces[i], m->out);
}

void plcWorkerSetDue(session *s, turn *t)
{
    double period = t->output ? s->options.readPeriod : t->request.period;

    t->due = period > 0 ? plcWorkerNext(t->due, (epicsUInt64)(period * NS_PER_MS),
                                        epicsMonotonicGet())
                        : PLC_WORKER_NEVER;
}

static int readTurn(plcModbus *m, unsigned at)
{
    session *s = &m->session;
    plcRequest q = s->turns[at].request;
    int code = s->turns[at].torn ? PLC_WORKER_TORN : plcWorkerAsk(m, &q), silent = code == PLC_WORKER_SILENT || code < 0;

    if (silent && (code > 0 || m->session.lost[0]))
        plcWorkerTurnsSilent(m, &s->turns[at]);
    if (code < 0)
        return -1;
    if (plcWorkerLessMayHelp(code) && !s->turns[at].refused && plcWorkerTurnsSplit(m, at, code))
        return 0;
    plcWorkerSetDue(s, &s->turns[at]);
    (s->turns[at].output ? outputRead : inputRead)(m, &s->turns[at], code);
    return 0;
}

/* All input ranges that were due have been read, or refused: the input image is complete. */
static void tellInputs(plcModbus *m)
{
    session *s = &m->session;
    int whole = m->setup.inputCount && (s->inputsRead || !s->inputsTried);

    if (plcWorkerEnter(m)) {
        if (whole) {
            memcpy(m->inNews, m->in, m->setup.inSize);
            epicsTimeGetCurrent(&m->news.stamp);
            m->news.blocks++;
        }
        if (whole || m->news.inFaults)
            plcWorkerTell(m); /* also when the PLC has just refused all there is */
        else
            epicsMutexUnlock(m->lock);
    }
    s->inputsTried = 1;
    s->inputsRead = 0;
}

/* All reads of a plan have been made at least once. */
static int allAsked(const session *s)
{
    unsigned i;

    for (i = 0; i < s->turnCount && s->turns[i].asked; i++)
        ;
    return i == s->turnCount;
}

/* All reads of one kind that were due have been made. What is refused is told when those of the other
 * kind have been made, too: one line for both. */
static void endRound(plcModbus *m, int output)
{
    session *s = &m->session;
    int later = s->round[!output] && s->toTell == 1;

    s->round[output] = 0;
    mendValues(m, output);
    plcWorkerTurnsJoin(m, output);
    (output ? tellOutputs : tellInputs)(m);
    if (s->toTell && later) {
        s->toTell = 2; /* but not for ever */
    } else if (s->toTell && allAsked(s) && plcWorkerEnter(m)) {
        tellRefused(m);
        plcWorkerTell(m);
    }
}

/* The read of inputs, or of outputs, that is due first; turnCount: there is none. */
static unsigned firstTurn(const session *s, int output)
{
    unsigned i, first = s->turnCount;

    for (i = 0; i < s->turnCount; i++)
        if (s->turns[i].output == output &&
            (first == s->turnCount || s->turns[i].due < s->turns[first].due))
            first = i;
    return first;
}

static epicsUInt64 dueOf(const session *s, int output)
{
    unsigned first = firstTurn(s, output);

    return first < s->turnCount ? s->turns[first].due : PLC_WORKER_NEVER;
}

int plcWorkerIsDue(const session *s, int output)
{
    if (s->round[output])
        return 1;
    if (s->planIsOld || (!output && !s->outputsTried)) /* the plan, or the outputs, come first */
        return 0;
    return dueOf(s, output) <= epicsMonotonicGet();
}

void plcWorkerRead(plcModbus *m, int output)
{
    session *s = &m->session;

    if (!plcWorkerIsDue(s, output))
        return;
    if (!s->round[output])
        s->round[output] = epicsMonotonicGet();
    if (readTurn(m, firstTurn(s, output)) == 0 && dueOf(s, output) > s->round[output])
        endRound(m, output);
}

epicsUInt64 plcWorkerNextRead(const session *s)
{
    epicsUInt64 in = s->outputsTried ? dueOf(s, 0) : PLC_WORKER_NEVER, out = dueOf(s, 1);

    if (s->round[0] || s->round[1] || s->planIsOld)
        return 0;
    return in < out ? in : out;
}

epicsUInt64 plcWorkerPoll(plcModbus *m)
{
    plcWorkerRead(m, 1);
    if (m->session.on && !m->session.lost[0])
        plcWorkerRead(m, 0);
    return plcWorkerNextRead(&m->session) <= epicsMonotonicGet() ? 0 : plcWorkerNextRead(&m->session);
}

void plcWorkerPlan(plcModbus *m)
{
    session *s = &m->session;
    epicsUInt64 now = epicsMonotonicGet();
    plcRequest *requests;
    unsigned i, n;

    s->toTell = 1;
    plcWorkerTurnsClear(m);
    n = plcPlanReads(m->setup.outputs, m->setup.outputCount,
                     s->knowsOut ? m->ownJoinedOut : NULL, s->options.limits, &requests);
    for (i = 0; i < n; i++)
        plcWorkerTurnsAdd(m, requests[i], 1, now - 1); /* before all others */
    free(requests);
    if (n == 0 && !s->outputsTried)
        tellOutputs(m);
    n = plcPlanReads(m->setup.inputs, m->setup.inputCount,
                     s->knowsIn ? m->ownJoinedIn : NULL, s->options.limits, &requests);
    for (i = 0; i < n; i++)
        plcWorkerTurnsAdd(m, requests[i], 0, now);
    free(requests);
}
