/* iocInit waits for the first blocks of PLCs: outputs with a read-back want their initial values.
 *
 * Knows ports only to ask for their stations.
 */
#include <epicsAtomic.h>
#include <epicsThread.h>
#include <epicsTime.h>

#include "plcAsynPort.h"

static epicsThreadOnceId onceId = EPICS_THREAD_ONCE_INIT;
static plcWake first;     /* a block came, before iocInit was over */
static epicsMutexId lock; /* guards the next two */
static epicsUInt64 until; /* iocInit may wait so long; ns, 0: not begun */
static double atMost;     /* ms */

static void initOnce(void *arg)
{
    (void)arg;
    lock = epicsMutexMustCreate();
    (void)plcWakeInit(&first);
}

static void enter(void)
{
    epicsThreadOnce(&onceId, initOnce, NULL);
    epicsMutexMustLock(lock);
}

void plcAsynFirstBegin(void)
{
    enter();
    until = 0;
    epicsMutexUnlock(lock);
}

void plcAsynFirstAtMost(double ms)
{
    enter();
    if (ms > atMost || ms == 0)
        atMost = ms;
    epicsMutexUnlock(lock);
}

void plcAsynFirst(void)
{
    epicsThreadOnce(&onceId, initOnce, NULL);
    plcWakeUp(&first);
}

/* When the wait of all ports together is over. */
static epicsUInt64 waitUntil(epicsUInt64 now)
{
    epicsUInt64 time;

    enter();
    if (!until)
        until = now + (epicsUInt64)(atMost * 1e6);
    time = until;
    epicsMutexUnlock(lock);
    return time;
}

void plcAsynWaitFirst(plcAsynPort *port, const plcAsynView *view)
{
    char reason[PLC_REASON_SIZE];
    epicsUInt64 now, limit;

    if (epicsAtomicGetIntT(&port->running) || !view->hasReadback)
        return;
    for (;;) {
        plcImageReason(plcStationInput(port->station), reason);
        if (!reason[0])
            return;
        now = epicsMonotonicGet();
        limit = waitUntil(now);
        if (now >= limit)
            return;
        plcWakeWait(&first, limit);
    }
}
