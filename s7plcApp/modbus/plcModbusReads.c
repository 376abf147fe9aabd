/* The reads of a Modbus PLC, each by its period, and what becomes of the answers; see
 * plcModbusPvt.h. All functions run in the worker's thread. */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>

#include "plcModbusPvt.h"

static void addTurn(session *s, const plcRequest *q, int output, epicsUInt64 due)
{
    if (s->turnCount == s->room) {
        s->room = s->room * 2 + 16;
        s->turns = realloc(s->turns, s->room * sizeof(*s->turns));
        if (!s->turns)
            cantProceed("plcModbus: no memory for %u requests\n", s->room);
    }
    s->turns[s->turnCount++] = (turn){.request = *q, .output = output, .due = due};
}

/* --- Where a request is not to go on ------------------------------------------------- */

static cut *findCut(plcModbus *m, const plcRequest *q, int output, unsigned at)
{
    unsigned i;

    for (i = 0; i < m->cutCount; i++)
        if (m->cuts[i].at == at && m->cuts[i].table == q->table &&
            m->cuts[i].unit == q->unit && m->cuts[i].output == output)
            return &m->cuts[i];
    return NULL;
}

static void addCut(plcModbus *m, const plcRequest *q, int output, unsigned at, int inValue)
{
    if (findCut(m, q, output, at))
        return;
    if (m->cutCount == m->cutRoom) {
        m->cutRoom = m->cutRoom * 2 + 16;
        m->cuts = realloc(m->cuts, m->cutRoom * sizeof(*m->cuts));
        if (!m->cuts)
            cantProceed("plcModbus: no memory for %u requests\n", m->cutRoom);
    }
    m->cuts[m->cutCount++] = (cut){q->table, output, q->unit, at, inValue};
}

static void dropCut(plcModbus *m, cut *c)
{
    if (c)
        *c = m->cuts[--m->cutCount];
}

/* Parts of a number, which are not asked for. */
static void addTorn(plcModbus *m, plcRequest q, unsigned start, unsigned count, int output,
                    epicsUInt64 due)
{
    q.start = start;
    q.count = count;
    if (!count)
        return;
    addTurn(&m->session, &q, output, due);
    m->session.turns[m->session.turnCount - 1].torn = 1;
}

/* A request that was planned, as one or more turns. */
static void addTurns(plcModbus *m, plcRequest q, int output, epicsUInt64 due)
{
    const session *s = &m->session;
    unsigned at, head, tail, end;

    if (output)
        plcPlanTorn(m->setup.outputs, m->setup.outputCount, s->knowsOut ? m->ownJoinedOut : NULL, &q,
                    &head, &tail);
    else
        plcPlanTorn(m->setup.inputs, m->setup.inputCount, s->knowsIn ? m->ownJoinedIn : NULL, &q,
                    &head, &tail);
    addTorn(m, q, q.start, head, output, due);
    addTorn(m, q, q.start + q.count - tail, tail, output, due);
    q.start += head;
    q.count -= head + tail;
    end = q.start + q.count;
    if (!q.count)
        return;
    for (at = q.start + 1; m->cutCount && at < end; at++) {
        if (!findCut(m, &q, output, at))
            continue;
        q.count = at - q.start;
        addTurn(&m->session, &q, output, due);
        q.start = at;
    }
    q.count = end - q.start;
    addTurn(&m->session, &q, output, due);
}

/* The first place within a request where one of the user's ranges begins or ends; or its end. */
static unsigned rangePlace(const plcModbus *m, const turn *t)
{
    const plcRange *ranges = t->output ? m->setup.outputs : m->setup.inputs;
    unsigned count = t->output ? m->setup.outputCount : m->setup.inputCount;
    unsigned i, place = t->request.start + t->request.count;

    for (i = 0; i < count; i++) {
        unsigned start = ranges[i].start, behind = start + ranges[i].count;

        if (ranges[i].table != t->request.table || ranges[i].unit != t->request.unit ||
            ranges[i].period != t->request.period)
            continue;
        if (start > t->request.start && start < place)
            place = start;
        if (behind > t->request.start && behind < place)
            place = behind;
    }
    return place;
}

/* A read of several ranges got no answer: they are not read together any more. */
static void readSilent(plcModbus *m, const turn *t)
{
    turn rest = *t;
    unsigned end = rest.request.start + rest.request.count, place;

    while ((place = rangePlace(m, &rest)) < end) {
        addCut(m, &rest.request, rest.output, place, 0);
        rest.request.start = place;
        rest.request.count = end - place;
    }
}

/* A read that was refused comes again in this round as two: first where the user's ranges meet,
 * then in halves, until it is known which registers the PLC refuses; also those of one value, so that
 * its neighbours that share one of them are read. Returns 0 when it is of one register or bit. */
static int split(plcModbus *m, unsigned at, int code)
{
    session *s = &m->session;
    turn t = s->turns[at];
    const plcRange *ranges = t.output ? m->setup.outputs : m->setup.inputs;
    unsigned count = t.output ? m->setup.outputCount : m->setup.inputCount;
    const epicsUInt8 *joined = t.output ? (s->knowsOut ? m->ownJoinedOut : NULL)
                                        : (s->knowsIn ? m->ownJoinedIn : NULL);
    unsigned end = t.request.start + t.request.count, place = rangePlace(m, &t);
    plcRequest half[2];

    if (t.request.count == 1)
        return 0;
    if (place == end && !t.wholeCount && plcPlanHalve(ranges, count, joined, &t.request, half)) {
        place = half[1].start;
    } else if (place == end) { /* within a value */
        place = t.request.start + t.request.count / 2;
        if (!t.wholeCount) {
            t.whole = t.request.start;
            t.wholeCount = t.request.count;
            t.wholeCode = code;
        }
    }
    addCut(m, &t.request, t.output, place, t.wholeCount != 0);
    s->turns[at] = t;
    s->turns[at].request.count = place - t.request.start;
    t.request.start = place;
    t.request.count = end - place;
    addTurn(s, &t.request, t.output, t.due);
    t.request = s->turns[s->turnCount - 1].request;
    s->turns[s->turnCount - 1] = t;
    return 1;
}

/* What can be read together when it is refused anyway: the turn at i goes on with that at k. */
static int continues(const session *s, unsigned i, unsigned k)
{
    const turn *a = &s->turns[i], *b = &s->turns[k];

    return a->refused && a->refused == b->refused && a->torn == b->torn &&
           a->unsure == b->unsure && a->output == b->output && a->request.table == b->request.table &&
           a->request.unit == b->request.unit && a->request.period == b->request.period &&
           a->wholeCount == b->wholeCount && (!a->wholeCount || a->whole == b->whole) &&
           a->request.start + a->request.count == b->request.start &&
           a->request.count + b->request.count <=
               (plcWorkerIsBits(a->request.table) ? PLC_READ_BITS : PLC_READ_REGISTERS);
}

/* Neighbours that are refused cost one request from now on. */
static void joinRefused(plcModbus *m, int output)
{
    session *s = &m->session;
    unsigned i, k;

    for (i = 0; i < s->turnCount; i++)
        for (k = 0; s->turns[i].refused && k < s->turnCount; k++) {
            if (k == i || s->turns[i].output != output || !continues(s, i, k))
                continue;
            dropCut(m, findCut(m, &s->turns[k].request, s->turns[k].output,
                               s->turns[k].request.start));
            s->turns[i].request.count += s->turns[k].request.count;
            s->turns[k] = s->turns[--s->turnCount];
            i = i == s->turnCount ? k : i;
            k = (unsigned)-1;
        }
}

static int sameValue(const turn *a, const turn *b)
{
    return b->wholeCount && a->output == b->output && a->whole == b->whole &&
           a->wholeCount == b->wholeCount && a->request.table == b->request.table &&
           a->request.unit == b->request.unit && a->request.period == b->request.period;
}

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
        char text[40], reason[PLC_REASON_SIZE], others[180] = "";
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
        plcWorkerNote(m, "read of %s: %s%s", text, good ? "good again" : reason, others);
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

/* The parts of a value are one read again. Returns its turn. */
static turn *joinParts(plcModbus *m, turn t)
{
    session *s = &m->session;
    unsigned i = 0;

    while (i < s->turnCount) {
        if (!sameValue(&t, &s->turns[i])) {
            i++;
            continue;
        }
        s->turns[i] = s->turns[--s->turnCount];
    }
    t.request.start = t.whole;
    t.request.count = t.wholeCount;
    t.wholeCount = 0;
    for (i = 1; i < t.request.count; i++)
        dropCut(m, findCut(m, &t.request, t.output, t.request.start + i));
    addTurn(s, &t.request, t.output, t.due);
    s->turns[s->turnCount - 1] = t;
    return &s->turns[s->turnCount - 1];
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
            refused += sameValue(t, &s->turns[k]) && s->turns[k].refused;
        if (!t->wholeCount || t->output != output || refused) {
            i++;
            continue;
        }
        wholeIsRefused(m, joinParts(m, *t));
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
        m->news.unread[0] = 0;
    }
    if (refused && strcmp(reason, s->unread)) {
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
        readSilent(m, &s->turns[at]);
    if (code < 0)
        return -1;
    if (plcWorkerLessMayHelp(code) && !s->turns[at].refused && split(m, at, code))
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
    joinRefused(m, output);
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

    s->turnCount = 0;
    s->toTell = 1;
    for (i = 0; i < m->cutCount;) /* it is tried again whether values can be read as a whole */
        if (m->cuts[i].inValue)
            dropCut(m, &m->cuts[i]);
        else
            i++;
    n = plcPlanReads(m->setup.outputs, m->setup.outputCount,
                     s->knowsOut ? m->ownJoinedOut : NULL, s->options.limits, &requests);
    for (i = 0; i < n; i++)
        addTurns(m, requests[i], 1, now - 1); /* before all others */
    free(requests);
    if (n == 0 && !s->outputsTried)
        tellOutputs(m);
    n = plcPlanReads(m->setup.inputs, m->setup.inputCount,
                     s->knowsIn ? m->ownJoinedIn : NULL, s->options.limits, &requests);
    for (i = 0; i < n; i++)
        addTurns(m, requests[i], 0, now);
    free(requests);
}
