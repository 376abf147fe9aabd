/* How what records have put gets into a Modbus PLC; see plcModbusPvt.h. All functions run
 * in the worker's thread. */
#include <stdlib.h>
#include <string.h>

#include <epicsStdio.h>

#include "plcModbusPvt.h"

/* The write is through: it was acknowledged (reason ""), or not. */
static void settle(plcModbus *m, const plcRequest *q, const char *reason)
{
    unsigned i, n = plcWorkerOutPieces(m, q);
    int changed = 0;
    char text[40];

    if (!plcWorkerEnter(m))
        return;
    for (i = 0; i < n; i++) {
        const plcPiece *p = &m->pieces[i];
        epicsUInt8 mask[maskMax];
        size_t k, size = plcWorkerPieceBytes(q, p);

        plcWorkerPieceMask(q, p, mask);
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
            plcWorkerMix(m->out + p->offset, m->values + p->offset, mask, size);
        }
    }
    if (changed && reason[0] && !m->session.lost[0])
        plcWorkerNote(m, "write of %s: %s", plcWorkerWhere(q, text), reason);
    m->news.writes += !reason[0];
    m->news.outFaults |= changed;
    plcWorkerTell(m);
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

/* With singleWrite a PLC may have no function for more than one. */
static int halvesMayHelp(const plcModbus *m, int code)
{
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
    plcWorkerReason(code, reason);
    if (code == 1 && (q->function == 16 || q->function == 15))
        epicsSnprintf(reason, sizeof(reason), "PLC has no FC%d: set singleWrite=on", q->function);
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

    if (q.count > 1 && m->session.options.singleWrite &&
        m->session.noMultiple[plcWorkerIsBits(q.table)])
        return writeEach(m, &q);
    if (q.count == 1 && q.function != 22 && m->session.options.singleWrite)
        q.function = plcWorkerIsBits(q.table) ? 5 : 6;
    status = q.function == 22 ? writeBits(m, &q) : writeWhole(m, &q);
    if (status > 0)
        return refused(m, &q, status);
    if (status == 0 || m->session.lost[0])
        settle(m, &q, m->session.lost);
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
    plcWorkerReason(PLC_WORKER_TORN, reason);
    part.count = head;
    if (head)
        settle(m, &part, reason);
    part.start = q.start + q.count - tail;
    part.count = tail;
    if (tail)
        settle(m, &part, reason);
    q.start += head;
    q.count -= head + tail;
    return q.count ? writeOne(m, &q) : 0;
}

/* What leaves together: puts that are neighbours in their order and in a table. Returns 0
 * when there is nothing, or the session is over. */
static unsigned takeTogether(plcModbus *m)
{
    plcJoin join = {m->setup.outputs, m->setup.outputCount, m->session.options.limits, .most = 0};
    unsigned count;

    if (!plcWorkerEnter(m))
        return 0;
    memset(m->leaving, 0, m->setup.outSize);
    count = m->mayWrite ? plcImageTakePuts(m->setup.out, plcPlanJoins, &join, m->values,
                                           m->leaving)
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

/* As many lots as puts wait now; those that come meanwhile have to wait for a read. What should have
 * been asked long ago has its turn between two lots. Returns 0, or -1: the session is over. */
int plcWorkerWriteAll(plcModbus *m)
{
    unsigned left = plcImagePutsWaiting(m->setup.out, NULL, NULL), count;

    for (; left; left -= count < left ? count : left) {
        count = takeTogether(m);
        if (!count)
            break;
        if (writeTogether(m))
            return -1;
        if (plcWorkerIsLate(&m->session))
            break;
    }
    return 0;
}
