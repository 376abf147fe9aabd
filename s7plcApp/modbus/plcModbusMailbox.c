/* What the worker of a Modbus PLC tells the station's thread: the mailbox's side of the
 * worker, and its words; see plcModbusPvt.h. */
#include <stdarg.h>
#include <string.h>

#include <epicsStdio.h>

#include "plcModbusPvt.h"

/* Locks, if the session is still the one that counts. Returns 0 when it is not. */
int plcWorkerEnter(plcModbus *m)
{
    epicsMutexMustLock(m->lock);
    if (m->session.on && m->running && m->generation == m->session.generation)
        return 1;
    epicsMutexUnlock(m->lock);
    m->session.on = 0;
    return 0;
}

/* Ends what plcWorkerEnter began; there is news. */
void plcWorkerTell(plcModbus *m)
{
    m->hasNews = 1;
    epicsMutexUnlock(m->lock);
    m->setup.wake(m->setup.arg);
}

/* A line for the log; the lock is held. */
void plcWorkerNote(plcModbus *m, const char *format, ...)
{
    va_list args;

    if (m->news.log[0]) {
        m->moreLog++;
        return;
    }
    va_start(args, format);
    epicsVsnprintf(m->news.log, sizeof(m->news.log), format, args);
    va_end(args);
}

/* "holding 100" or "coils 0 to 9" */
const char *plcWorkerWhere(const plcRequest *q, char text[40])
{
    if (q->count == 1)
        epicsSnprintf(text, 40, "%s %u", plcTableName(q->table), q->start);
    else
        epicsSnprintf(text, 40, "%s %u to %u", plcTableName(q->table), q->start,
                      q->start + q->count - 1);
    return text;
}

/* " of unit 5" where there are several, else "" */
const char *plcWorkerUnit(const plcModbus *m, unsigned unit, char text[20])
{
    text[0] = 0;
    if (m->units > 1)
        epicsSnprintf(text, 20, " of unit %u", unit);
    return text;
}

/* "PLC: exception 2, illegal data address" */
void plcWorkerReason(const plcModbus *m, int code, char reason[PLC_REASON_SIZE])
{
    char text[PLC_REASON_SIZE];

    if (code == PLC_WORKER_SILENT) {
        strcpy(reason, m->units > 1 ? "no answer from this unit" : m->session.silentWhy);
        return;
    }
    if (code == PLC_WORKER_TORN) {
        strcpy(reason, "maxRegisters is less than the value");
        return;
    }
    plcExceptionText(code, text, sizeof(text));
    epicsSnprintf(reason, PLC_REASON_SIZE, "PLC: %.34s", text);
}

/* Bits of `from` that are set in the mask, into `to`. */
void plcWorkerMix(epicsUInt8 *to, const epicsUInt8 *from, const epicsUInt8 *mask,
                  size_t size)
{
    size_t i;

    for (i = 0; i < size; i++)
        if (mask[i])
            to[i] = (epicsUInt8)((to[i] & ~mask[i]) | (from[i] & mask[i]));
}
