/* A wake-up by a pipe; see plcWake.h. */
#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <epicsAtomic.h>
#include <epicsTime.h>

#include "plcHot.h"
#include "plcWake.h"

#define MS_MAX 3600000 /* poll() is called again after that */

int plcWakeInit(plcWake *w)
{
    int i;

    w->woken = 0;
    w->pipe[0] = w->pipe[1] = -1;
    if (pipe(w->pipe))
        return -1;
    for (i = 0; i < 2; i++) {
        fcntl(w->pipe[i], F_SETFL, fcntl(w->pipe[i], F_GETFL) | O_NONBLOCK);
        fcntl(w->pipe[i], F_SETFD, FD_CLOEXEC);
    }
    return 0;
}

void plcWakeFree(plcWake *w)
{
    int i;

    for (i = 0; i < 2; i++)
        if (w->pipe[i] >= 0)
            close(w->pipe[i]);
    w->pipe[0] = w->pipe[1] = -1;
}

void plcWakeUp(plcWake *w)
{
    if (epicsAtomicCmpAndSwapIntT(&w->woken, 0, 1) == 0) {
        ssize_t n = write(w->pipe[1], "", 1);
        (void)n; /* a full pipe wakes as well */
    }
}

int plcWakeDescriptor(const plcWake *w)
{
    return w->pipe[0];
}

PLC_COLD void plcWakeTake(plcWake *w)
{
    char buffer[16];

    while (read(w->pipe[0], buffer, sizeof(buffer)) > 0)
        ;
    /* Last: a byte that comes in between would be read while `woken` stays set, and no
     * wake would ever write another. A full barrier: what was to be done is looked at
     * later. */
    epicsAtomicCmpAndSwapIntT(&w->woken, 1, 0);
}

/* How long to let poll() wait, ms. */
static int msUntil(epicsUInt64 deadline)
{
    epicsUInt64 now = epicsMonotonicGet(), ms;

    if (deadline == PLC_WAKE_NEVER)
        return MS_MAX;
    ms = deadline > now ? (deadline - now + 999999) / 1000000 : 0;
    return ms < MS_MAX ? (int)ms : MS_MAX;
}

int plcWakeWait(plcWake *w, epicsUInt64 deadline)
{
    struct pollfd p = {.fd = w->pipe[0], .events = POLLIN};
    int ms;

    do {
        ms = msUntil(deadline);
        if (poll(&p, 1, ms) > 0) {
            plcWakeTake(w);
            return 1;
        }
    } while (ms > 0);
    return 0;
}

int plcWakeJoin(plcWake *some, epicsEventId ended, epicsUInt64 deadline)
{
    int woken = some->pipe[0] >= 0;

    if (!woken) { /* there was no descriptor for it */
        epicsEventMustWait(ended);
        return 0;
    }
    while (epicsEventTryWait(ended) != epicsEventOK) {
        if (!woken)
            return -1;
        woken = plcWakeWait(some, deadline);
    }
    return 0;
}
