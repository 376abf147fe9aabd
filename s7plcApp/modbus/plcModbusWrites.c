/* How what records have put gets into a Modbus PLC; see plcModbusPvt.h. All functions run
 * in the worker's thread. */
#include <stdlib.h>
#include <string.h>

#include <epicsStdio.h>

#include "plcModbusPvt.h"

/* Writes without an answer, one after the other, until parts of a request are not tried any more. */
#define MUTED_MOST 8

/* How a write has ended. */
typedef enum { writeTaken, writeRefused, writeUnanswered } writeEnd;

/* The bits of a piece that are being written, into mask; whether the PLC has them is known now,
 * or not. Those that had no answer before either are given up. Returns 1 when the log has not told
 * that of some. The lock is held. */
static int endBits(plcModbus *m, size_t offset, size_t size, epicsUInt8 *mask, writeEnd end)
{
    size_t k;
    int news = 0;

    for (k = 0; k < size; k++) {
        size_t at = offset + k;

        mask[k] &= m->leaving[at];
        m->leaving[at] &= (epicsUInt8)~mask[k];
        m->unsure[at] &= (epicsUInt8)~mask[k];
        if (end == writeUnanswered) {
            m->unsure[at] |= mask[k];
            m->givenUp[at] = m->session.lost[0] ? m->doubt[at] & mask[k] : mask[k];
            news |= (m->givenUp[at] & ~m->told[at]) != 0;
            m->told[at] |= m->givenUp[at];
            m->doubt[at] |= mask[k];
        } else {
            m->doubt[at] &= (epicsUInt8)~mask[k];
            m->told[at] &= (epicsUInt8)~mask[k];
        }
    }
    return news;
}

/* The write is through: the PLC has taken it, or refused it, or did not answer. A write without a
 * good answer is made once more after the reconnect, by the put that waits again; then its put is
 * given up. */
static void settle(plcModbus *m, const plcRequest *q, writeEnd end, const char *reason)
{
    unsigned i, n = plcWorkerOutPieces(m, q);
    int changed = 0, news = 0;
    char text[40], unit[20];

    if (!plcWorkerEnter(m))
        return;
    memset(m->givenUp, 0, m->setup.outSize);
    for (i = 0; i < n; i++) {
        const plcPiece *p = &m->pieces[i];
        epicsUInt8 mask[maskMax];
        size_t size = plcWorkerPieceBytes(q, p);

        plcWorkerPieceMask(q, p, mask);
        news |= endBits(m, p->offset, size, mask, end);
        if (end != writeTaken) {
            plcImagePutsFail(m->setup.out, p->offset, size, mask, reason);
            changed |= plcFaultsSet(m->setup.outFaults, p->offset, size, mask, reason);
        } else {
            changed |= plcFaultsClear(m->setup.outFaults, p->offset, size, mask);
            plcWorkerMix(m->out + p->offset, m->values + p->offset, mask, size);
        }
    }
    if (end == writeUnanswered)
        plcImagePutsGiveUp(m->setup.out, m->givenUp);
    if (news)
        plcWorkerNote(m, "write of %s%s: %s; not tried again", plcWorkerWhere(q, text),
                      plcWorkerUnit(m, q->unit, unit), reason);
    else if (changed && end == writeRefused)
        plcWorkerNote(m, "write of %s%s: %s", plcWorkerWhere(q, text),
                      plcWorkerUnit(m, q->unit, unit), reason);
    m->news.writes += end == writeTaken;
    m->news.outFaults |= changed || end != writeTaken; /* it may be another put */
    plcWorkerTell(m);
}

/* A bit of this write had no good answer before. */
static int isInDoubt(plcModbus *m, const plcRequest *q)
{
    unsigned i, n = plcWorkerOutPieces(m, q);

    for (i = 0; i < n; i++) {
        const plcPiece *p = &m->pieces[i];
        epicsUInt8 mask[maskMax];
        size_t k, size = plcWorkerPieceBytes(q, p);

        plcWorkerPieceMask(q, p, mask);
        for (k = 0; k < size; k++)
            if (mask[k] & m->leaving[p->offset + k] & m->doubt[p->offset + k])
                return 1;
    }
    return 0;
}

/* Sets only some bits of a register. Returns as plcWorkerAsk does. */
static int readModifyWrite(plcModbus *m, const plcRequest *q, epicsUInt16 mask,
                           epicsUInt16 value)
{
    plcRequest read = {3, q->table, q->start, 1, 0, q->unit};
    plcRequest write = {6, q->table, q->start, 1, 0, q->unit};
    int status = plcWorkerAsk(m, &read);

    if (status)
        return status;
    m->registers[0] = (epicsUInt16)((m->registers[0] & ~mask) | (value & mask));
    return plcWorkerAsk(m, &write);
}

/* FC22, or what takes its place. Returns as plcWorkerAsk does; 1 where the PLC has no
 * FC22. */
static int writeBits(plcModbus *m, const plcRequest *q)
{
    epicsUInt16 mask, value;
    int status;

    if (plcWorkerOutPieces(m, q) == 0)
        return 0;
    mask = plcWorkerGetRegister(m, m->leaving + m->pieces[0].offset);
    value = plcWorkerGetRegister(m, m->values + m->pieces[0].offset);
    if (!m->session.noMaskWrite) {
        m->registers[0] = (epicsUInt16)~mask;
        m->registers[1] = value & mask;
        status = plcWorkerAsk(m, q);
        if (status != 1)
            return status;
        m->session.noMaskWrite = 1;
    }
    return m->session.options.readModifyWrite ? readModifyWrite(m, q, mask, value) : 1;
}

static int writeWhole(plcModbus *m, const plcRequest *q)
{
    unsigned i, n = plcWorkerOutPieces(m, q);

    for (i = 0; i < n; i++)
        plcWorkerLoad(m, q, &m->pieces[i], m->values);
    return plcWorkerAsk(m, q);
}

/* With singleWrite a PLC may have no function for more than one. Where nothing is answered at all,
 * parts are not tried one by one. */
static int halvesMayHelp(const plcModbus *m, int code)
{
    if (code == PLC_WORKER_SILENT)
        return m->units == 1 && m->session.muted < MUTED_MOST;
    return plcWorkerLessMayHelp(code) || (code == 1 && m->session.options.singleWrite);
}

static int writeOne(plcModbus *m, const plcRequest *request);

/* One by one, by FC6 or FC5, also the registers of one value. Returns as writeOne does. */
static int writeEach(plcModbus *m, const plcRequest *q)
{
    plcRequest one = *q;
    int status = 0;

    for (one.count = 1; one.start < q->start + q->count && status == 0; one.start++)
        status = writeOne(m, &one);
    return status;
}

/* Returns as writeOne does. */
static int refused(plcModbus *m, const plcRequest *q, int code)
{
    plcRequest half[2];
    char reason[PLC_REASON_SIZE];

    if (halvesMayHelp(m, code) &&
        plcPlanHalve(m->setup.outputs, m->setup.outputCount,
                     m->session.knowsOut ? m->ownJoinedOut : NULL, q, half))
        return writeOne(m, &half[0]) || writeOne(m, &half[1]) ? -1 : 0;
    if (code == 1 && q->count > 1 && m->session.options.singleWrite) {
        m->session.noMultiple[plcWorkerIsBits(q->table)] = 1;
        return writeEach(m, q);
    }
    plcWorkerReason(m, code, reason);
    if (code == 1 && (q->function == 16 || q->function == 15))
        epicsSnprintf(reason, sizeof(reason), "PLC has no FC%d: set singleWrite=on", q->function);
    if (q->function == 22 && code == 1 && !m->session.options.readModifyWrite)
        epicsSnprintf(reason, sizeof(reason), "PLC has no FC22: set maskWrite=rmw");
    settle(m, q, code == PLC_WORKER_SILENT && m->units == 1 ? writeUnanswered : writeRefused, reason);
    return 0;
}

/* A write has no answer: before the next one everything is read that is due, which shows whether the
 * PLC is there. Returns 0, or -1: the session is over, because of this write, for all that is
 * known. */
static int readBetween(plcModbus *m, const plcRequest *q)
{
    unsigned left = m->session.turnCount + 2;

    m->session.muted++;
    if (m->units > 1)
        return 0;
    while (left-- && m->session.on && !m->session.lost[0] && plcWorkerPoll(m) == 0)
        ;
    if (!m->session.lost[0])
        return m->session.on ? 0 : -1;
    settle(m, q, writeUnanswered, m->session.lost);
    return -1;
}

/* Writes, in parts where the PLC refuses the whole. Returns 0, or -1: session over. */
static int writeOne(plcModbus *m, const plcRequest *request)
{
    plcRequest q = *request, half[2];
    int status, inDoubt = isInDoubt(m, &q);

    /* What had no good answer is written value by value, so that only the one to blame is given up. */
    if (inDoubt && m->session.muted < MUTED_MOST &&
        plcPlanHalve(m->setup.outputs, m->setup.outputCount,
                     m->session.knowsOut ? m->ownJoinedOut : NULL, &q, half))
        return writeOne(m, &half[0]) || writeOne(m, &half[1]) ? -1 : 0;
    if (q.count > 1 && m->session.options.singleWrite &&
        m->session.noMultiple[plcWorkerIsBits(q.table)])
        return writeEach(m, &q);
    if (q.count == 1 && q.function != 22 && m->session.options.singleWrite)
        q.function = plcWorkerIsBits(q.table) ? 5 : 6;
    m->session.mayBeSilent = inDoubt;
    status = q.function == 22 ? writeBits(m, &q) : writeWhole(m, &q);
    m->session.mayBeSilent = 0;
    if (status == PLC_WORKER_SILENT && readBetween(m, &q))
        return -1;
    if (status > 0)
        return refused(m, &q, status);
    if (status >= 0 && status != PLC_WORKER_SILENT)
        m->session.muted = 0;
    if (status == 0 || m->session.lost[0])
        settle(m, &q, status ? writeUnanswered : writeTaken, m->session.lost);
    return status;
}

/* The run goes on from one request to the next. */
static int goesOn(const plcRequest *before, const plcRequest *next)
{
    return before->table == next->table && before->unit == next->unit && before->function != 22 &&
           next->function != 22 && before->start + before->count == next->start;
}

/* Leaves out what is a part only of a number that is longer than a request may be; with singleWrite it is
 * written register by register. Returns as writeOne does. */
static int writePlanned(plcModbus *m, const plcRequest *requests, unsigned i, unsigned count)
{
    plcRequest q = requests[i], part = q;
    char reason[PLC_REASON_SIZE];
    unsigned head = 0, tail = 0;

    if (!m->session.options.singleWrite)
        plcPlanTorn(m->setup.outputs, m->setup.outputCount,
                    m->session.knowsOut ? m->ownJoinedOut : NULL, &q, &head, &tail);
    if (i == 0 || !goesOn(&requests[i - 1], &q))
        head = 0; /* all that was put of it */
    if (i + 1 == count || !goesOn(&q, &requests[i + 1]))
        tail = 0;
    plcWorkerReason(m, PLC_WORKER_TORN, reason);
    part.count = head;
    if (head)
        settle(m, &part, writeRefused, reason);
    part.start = q.start + q.count - tail;
    part.count = tail;
    if (tail)
        settle(m, &part, writeRefused, reason);
    q.start += head;
    q.count -= head + tail;
    return q.count ? writeOne(m, &q) : 0;
}

typedef struct together {
    plcJoin join;
    const epicsUInt8 *doubt;
    unsigned count;
    int inDoubt; /* the first one */
} together;

static int hasDoubt(const epicsUInt8 *doubt, const plcPut *put)
{
    size_t i;

    for (i = 0; i < put->length; i++)
        if (doubt[put->offset + i] & (put->mask ? put->mask[i] : 0xff))
            return 1;
    return 0;
}

/* What had no answer leaves apart from the rest. */
static int joins(void *arg, const plcPut *put)
{
    together *t = arg;
    int inDoubt = hasDoubt(t->doubt, put);

    if (!t->count++)
        t->inDoubt = inDoubt;
    return inDoubt == t->inDoubt && plcPlanJoins(&t->join, put);
}

/* What leaves together: puts that are neighbours in their order and in a table. Returns 0
 * when there is nothing, or the session is over. */
static unsigned takeTogether(plcModbus *m)
{
    together t = {
        {m->setup.outputs, m->setup.outputCount, m->session.options.limits, .most = 0},
        m->doubt, 0, 0};
    unsigned count;

    if (!plcWorkerEnter(m))
        return 0;
    memset(m->leaving, 0, m->setup.outSize);
    count = m->mayWrite
                ? plcImageTakePuts(m->setup.out, joins, &t, m->values, m->leaving)
                : 0;
    if (!count)
        m->mayWrite = 0; /* the next ones have their holdoff */
    epicsMutexUnlock(m->lock);
    return count;
}

/* Writes what was taken. Returns 0, or -1: the session is over. */
static int writeTogether(plcModbus *m)
{
    plcRequest *requests;
    unsigned i, n;
    int status = 0;

    n = plcPlanWrites(m->setup.outputs, m->setup.outputCount, m->leaving,
                      m->session.knowsOut ? m->ownJoinedOut : NULL, m->session.options.limits,
                      m->session.options.singleWrite, &requests);
    for (i = 0; i < n && status == 0; i++)
        status = writePlanned(m, requests, i, n);
    free(requests);
    if (status == 0 && plcWorkerEnter(m)) {
        plcImagePutsDone(m->setup.out);
        plcWorkerTell(m);
    }
    return status;
}

/* As many lots as puts wait now; but what is to be read now, or the heartbeat, has its turn between two
 * lots: else many puts to a slow PLC would leave old values with the records as good. */
int plcWorkerWriteAll(plcModbus *m)
{
    const session *s = &m->session;
    unsigned left = plcImagePutsWaiting(m->setup.out, NULL, NULL), count;

    for (; left; left -= count < left ? count : left) {
        count = takeTogether(m);
        if (!count)
            break;
        if (writeTogether(m))
            return -1;
        if (plcWorkerIsDue(s, 0) || plcWorkerIsDue(s, 1) || plcWorkerBeatIsDue(s))
            return left > count;
    }
    return 0;
}
