/* One Modbus request by libmodbus, and where its registers or bits lie in an image; see
 * plcModbusPvt.h. All functions run in the worker's thread. */
#include <errno.h>
#include <string.h>

#include <epicsStdio.h>

#include "plcModbusPvt.h"

enum { busyPause = 20 }; /* ms until a PLC that is busy is asked again */

/* --- One request ------------------------------------------------------------------ */

/* What kind of request needs what of libmodbus; the values are in m->registers or
 * m->bits, for FC22 the AND mask and the OR mask. */
static int call(plcModbus *m, const plcRequest *q)
{
    modbus_t *context = plcModbusRelayContext(m->relay);
    int start = (int)q->start, count = (int)q->count;

    switch (q->function) {
    case 1:
        return modbus_read_bits(context, start, count, m->bits);
    case 2:
        return modbus_read_input_bits(context, start, count, m->bits);
    case 3:
        return modbus_read_registers(context, start, count, m->registers);
    case 4:
        return modbus_read_input_registers(context, start, count, m->registers);
    case 5:
        return modbus_write_bit(context, start, m->bits[0]);
    case 6:
        return modbus_write_register(context, start, m->registers[0]);
    case 15:
        return modbus_write_bits(context, start, count, m->bits);
    case 16:
        return modbus_write_registers(context, start, count, m->registers);
    default:
        return modbus_mask_write_register(context, start, m->registers[0],
                                          m->registers[1]);
    }
}

static void countRequest(plcModbus *m, const plcModbusResult *x)
{
    m->news.requests++;
    m->news.exceptions += x->exception != 0;
    m->news.timeouts += x->timeout != 0;
    m->news.bytesOut += x->sent;
    m->news.bytesIn += x->received;
    if (x->latency > 0)
        m->news.latency = x->latency;
    if (x->latency > m->news.latencyMax)
        m->news.latencyMax = x->latency;
    m->hasNews = 1;
}

static void setRelay(plcModbus *m, const plcRequest *q)
{
    const plcModbusOptions *o = &m->session.options;
    plcModbusRequestOptions options = {
        .timeout = o->requestTimeout,
        .unit = q->unit == PLC_UNIT_OF_PLC ? m->setup.unit : q->unit - 1,
        .anyUnit = o->anyUnit,
        .anyTransaction = o->anyTransaction,
        .keepSilent = m->units > 1 || m->session.mayBeSilent,
        .mayFail = m->session.mayBeSilent,
        .rtu = o->rtu};

    plcModbusRelaySetOptions(m->relay, &options);
}

/* Returns 0, the code of an exception, or -1: the session is over. When that is because
 * the connection is lost, session.lost says why; `step` tells it. */
static int askOnce(plcModbus *m, const plcRequest *q)
{
    plcModbusResult x;
    int status;

    if (!plcWorkerEnter(m))
        return -1;
    epicsMutexUnlock(m->lock);
    setRelay(m, q);
    status = call(m, q);
    plcModbusRelayLast(m->relay, &x);
    if (status < 0 && !x.lost && !x.exception) {
        x.lost = 1;
        epicsSnprintf(x.why, sizeof(x.why), "libmodbus: error %d", errno);
    }
    if (!plcWorkerEnter(m))
        return -1;
    countRequest(m, &x);
    epicsMutexUnlock(m->lock);
    m->session.answered = epicsMonotonicGet();
    if (!x.silent) {
        m->session.silent = 0;
    } else if (++m->session.silent < m->units + 1) {
        strcpy(m->session.silentWhy, x.why);
        return PLC_WORKER_SILENT;
    }
    strcpy(m->session.lost, x.why);
    return x.lost ? -1 : x.exception;
}

/* Waits, but not longer than the session lasts. Returns 0 when it has ended. What wakes it
 * meanwhile (an order, a new session, the end) is not for us: the worker has to look. */
static int restUntil(plcModbus *m, epicsUInt64 end)
{
    int on = 1, woken = 0, late = 0;

    while (!late && (on = plcWorkerEnter(m))) {
        epicsMutexUnlock(m->lock);
        if (plcWakeWait(&m->wake, end))
            woken = 1;
        else
            late = 1;
    }
    if (woken)
        plcWakeUp(&m->wake);
    return on;
}

/* Waits until the PLC may be asked again. Returns 0 when the session has ended. */
static int pauseBefore(plcModbus *m)
{
    epicsUInt64 due = m->session.answered +
                      (epicsUInt64)(m->session.options.requestPause * NS_PER_MS);

    return epicsMonotonicGet() >= due || restUntil(m, due);
}

/* As askOnce; a PLC that is busy is asked again for as long as a request may take. */
int plcWorkerAsk(plcModbus *m, const plcRequest *q)
{
    epicsUInt64 end = epicsMonotonicGet() +
                      (epicsUInt64)(m->session.options.requestTimeout * NS_PER_MS);

    for (;;) {
        int status;

        if (!pauseBefore(m))
            return -1;
        status = askOnce(m, q);

        if ((status != 5 && status != 6) ||
            epicsMonotonicGet() + busyPause * NS_PER_MS >= end)
            return status;
        if (!restUntil(m, epicsMonotonicGet() + busyPause * NS_PER_MS))
            return -1;
    }
}

/* Can it help to ask for less? Not where the PLC has no such function, or no time. */
int plcWorkerLessMayHelp(int code)
{
    return code >= 2 && code <= 4;
}

/* --- Bits and registers in an image ----------------------------------------------- */

int plcWorkerIsBits(plcTable table)
{
    return table == plcCoils || table == plcDiscrete;
}

size_t plcWorkerPieceBytes(const plcRequest *q, const plcPiece *p)
{
    return plcWorkerIsBits(q->table) ? (p->bit + p->count + 7) / 8 : (size_t)p->count * 2;
}

/* Which bits of its bytes belong to the piece. */
void plcWorkerPieceMask(const plcRequest *q, const plcPiece *p, epicsUInt8 *mask)
{
    unsigned i;

    memset(mask, plcWorkerIsBits(q->table) ? 0 : 0xff, plcWorkerPieceBytes(q, p));
    for (i = p->bit; plcWorkerIsBits(q->table) && i < p->bit + p->count; i++)
        mask[i / 8] |= (epicsUInt8)(1 << i % 8);
}

epicsUInt16 plcWorkerGetRegister(const plcModbus *m, const epicsUInt8 *at)
{
    return m->setup.bigEndian ? (epicsUInt16)(at[0] << 8 | at[1])
                              : (epicsUInt16)(at[1] << 8 | at[0]);
}

static void putRegister(const plcModbus *m, epicsUInt8 *at, epicsUInt16 value)
{
    at[m->setup.bigEndian ? 0 : 1] = (epicsUInt8)(value >> 8);
    at[m->setup.bigEndian ? 1 : 0] = (epicsUInt8)value;
}

/* From m->registers or m->bits into the image. */
void plcWorkerStore(plcModbus *m, const plcRequest *q, const plcPiece *p,
                    epicsUInt8 *image)
{
    epicsUInt8 *at = image + p->offset;
    unsigned i;

    for (i = 0; i < p->count; i++) {
        unsigned bit = p->bit + i;

        if (!plcWorkerIsBits(q->table))
            putRegister(m, at + 2 * i, m->registers[p->first + i]);
        else if (m->bits[p->first + i])
            at[bit / 8] |= (epicsUInt8)(1 << bit % 8);
        else
            at[bit / 8] &= (epicsUInt8) ~(1 << bit % 8);
    }
}

/* The other way round. */
void plcWorkerLoad(plcModbus *m, const plcRequest *q, const plcPiece *p,
                   const epicsUInt8 *image)
{
    const epicsUInt8 *at = image + p->offset;
    unsigned i;

    for (i = 0; i < p->count; i++) {
        unsigned bit = p->bit + i;

        if (plcWorkerIsBits(q->table))
            m->bits[p->first + i] = at[bit / 8] >> bit % 8 & 1;
        else
            m->registers[p->first + i] = plcWorkerGetRegister(m, at + 2 * i);
    }
}

unsigned plcWorkerInPieces(plcModbus *m, const plcRequest *q)
{
    return plcPlanPieces(m->setup.inputs, m->setup.inputCount, q, m->pieces,
                         m->setup.inputCount);
}

unsigned plcWorkerOutPieces(plcModbus *m, const plcRequest *q)
{
    return plcPlanPieces(m->setup.outputs, m->setup.outputCount, q, m->pieces,
                         m->setup.outputCount);
}
