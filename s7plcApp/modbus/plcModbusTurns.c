/* The turns of a Modbus PLC: how planned requests become reads that come back, and where one is taken
 * apart, or several are put together, after the PLC has refused them or said nothing; see
 * plcModbusPvt.h. Knows neither when they are due nor what becomes of their values. All functions run
 * in the worker's thread. */
#include <stdlib.h>

#include <cantProceed.h>

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

void plcWorkerTurnsClear(plcModbus *m)
{
    unsigned i;

    m->session.turnCount = 0;
    for (i = 0; i < m->cutCount;)
        if (m->cuts[i].inValue)
            dropCut(m, &m->cuts[i]);
        else
            i++;
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

void plcWorkerTurnsAdd(plcModbus *m, plcRequest q, int output, epicsUInt64 due)
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

/* --- Apart, and together ------------------------------------------------------------- */

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

void plcWorkerTurnsSilent(plcModbus *m, const turn *t)
{
    turn rest = *t;
    unsigned end = rest.request.start + rest.request.count, place;

    while ((place = rangePlace(m, &rest)) < end) {
        addCut(m, &rest.request, rest.output, place, 0);
        rest.request.start = place;
        rest.request.count = end - place;
    }
}

int plcWorkerTurnsSplit(plcModbus *m, unsigned at, int code)
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

void plcWorkerTurnsJoin(plcModbus *m, int output)
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

int plcWorkerSameValue(const turn *a, const turn *b)
{
    return b->wholeCount && a->output == b->output && a->whole == b->whole &&
           a->wholeCount == b->wholeCount && a->request.table == b->request.table &&
           a->request.unit == b->request.unit && a->request.period == b->request.period;
}

turn *plcWorkerJoinParts(plcModbus *m, turn t)
{
    session *s = &m->session;
    unsigned i = 0;

    while (i < s->turnCount) {
        if (!plcWorkerSameValue(&t, &s->turns[i])) {
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
