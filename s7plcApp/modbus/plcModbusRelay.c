/* Frames between libmodbus and a PLC's socket; see plcModbusRelay.h. */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include <sys/select.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cantProceed.h>
#include <epicsMutex.h>
#include <epicsStdio.h>
#include <epicsThread.h>
#include <epicsTime.h>

#include "plcModbusRelay.h"

struct plcModbusRelay {
    char name[40];
    void (*broken)(void *arg);
    void *arg;
    modbus_t *context;
    int near, far; /* libmodbus's end of the pair, and the thread's; -1: not there */
    epicsThreadId thread;
    epicsMutexId lock; /* guards the rest */
    plcModbusRequestOptions options;
    plcModbusResult last;
    char brokenWhy[PLC_REASON_SIZE]; /* "": it is not */
    plcModbusSocket socket;
};

static void relayThread(void *arg);

/* --- Descriptors ------------------------------------------------------------------ */

static void closeIf(int *fd)
{
    if (*fd >= 0)
        close(*fd);
    *fd = -1;
}

/* The end for libmodbus must fit into an fd_set; the other one makes room for it. */
static void makePair(plcModbusRelay *r)
{
    int pair[2], high;

    if (r->near >= 0 || socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair))
        return;
    r->near = pair[0];
    r->far = pair[1];
    if (r->near >= FD_SETSIZE) {
        closeIf(&r->near);
        closeIf(&r->far);
        return;
    }
    high = fcntl(r->far, F_DUPFD_CLOEXEC, FD_SETSIZE);
    if (high >= 0) {
        close(r->far);
        r->far = high;
    }
}

static modbus_t *makeContext(void)
{
    modbus_t *context = modbus_new_tcp("127.0.0.1", MODBUS_TCP_DEFAULT_PORT);

    if (!context)
        cantProceed("plcModbusRelayCreate: no memory for libmodbus\n");
    /* The thread always answers in time: libmodbus must never give up before it does. */
    modbus_set_response_timeout(context, 1000000, 0);
    modbus_set_byte_timeout(context, 0, 0);
    return context;
}

plcModbusRelay *plcModbusRelayCreate(const char *name, void (*broken)(void *arg), void *arg)
{
    plcModbusRelay *r = callocMustSucceed(1, sizeof(*r), "plcModbusRelayCreate");

    epicsSnprintf(r->name, sizeof(r->name), "%s-mbw", name);
    r->broken = broken;
    r->arg = arg;
    r->options.timeout = 1000;
    r->options.unit = 1;
    r->near = r->far = -1;
    r->lock = epicsMutexMustCreate();
    plcModbusSocketInit(&r->socket, r->lock);
    r->context = makeContext();
    makePair(r);
    return r;
}

void plcModbusRelayDestroy(plcModbusRelay *r)
{
    if (r->thread) {
        shutdown(r->near, SHUT_RDWR);
        epicsThreadMustJoin(r->thread);
    }
    closeIf(&r->near);
    closeIf(&r->far);
    plcModbusSocketFree(&r->socket);
    modbus_free(r->context);
    epicsMutexDestroy(r->lock);
    free(r);
}

static int startThread(plcModbusRelay *r)
{
    epicsThreadOpts options = EPICS_THREAD_OPTS_INIT;

    if (r->thread)
        return 0;
    options.priority = epicsThreadPriorityMedium;
    options.stackSize = epicsThreadStackMedium;
    options.joinable = 1;
    modbus_set_socket(r->context, r->near);
    r->thread = epicsThreadCreateOpt(r->name, relayThread, r, &options);
    return r->thread ? 0 : -1;
}

int plcModbusRelayOpen(plcModbusRelay *r, SOCKET socket, char why[PLC_REASON_SIZE])
{
    makePair(r);
    if (r->near < 0 || startThread(r)) {
        close(socket);
        epicsSnprintf(why, PLC_REASON_SIZE,
                      r->near < 0 ? "no descriptor below %d for Modbus"
                                  : "no thread for Modbus",
                      FD_SETSIZE);
        return -1;
    }
    epicsMutexMustLock(r->lock);
    plcModbusSocketNext(&r->socket, socket);
    r->brokenWhy[0] = 0;
    epicsMutexUnlock(r->lock);
    return 0;
}

void plcModbusRelayCut(plcModbusRelay *r)
{
    epicsMutexMustLock(r->lock);
    plcModbusSocketCut(&r->socket);
    epicsMutexUnlock(r->lock);
}

/* --- What others ask -------------------------------------------------------------- */

modbus_t *plcModbusRelayContext(plcModbusRelay *r)
{
    return r->context;
}

void plcModbusRelaySetOptions(plcModbusRelay *r, const plcModbusRequestOptions *options)
{
    epicsMutexMustLock(r->lock);
    r->options = *options;
    epicsMutexUnlock(r->lock);
}

void plcModbusRelayLast(plcModbusRelay *r, plcModbusResult *exchange)
{
    epicsMutexMustLock(r->lock);
    *exchange = r->last;
    epicsMutexUnlock(r->lock);
}

int plcModbusRelayBroken(plcModbusRelay *r, char why[PLC_REASON_SIZE])
{
    epicsMutexMustLock(r->lock);
    strcpy(why, r->brokenWhy);
    epicsMutexUnlock(r->lock);
    return why[0] != 0;
}

/* --- The thread ------------------------------------------------------------------- */

/* A whole request of libmodbus. Returns 0, or -1: the relay is to end. */
static int takeRequest(plcModbusRelay *r, plcFrame *q)
{
    plcModbusResult x = {.lost = 0};
    size_t size = plcFrameUnit;

    for (q->size = 0; q->size < size;) {
        ssize_t n = recv(r->far, q->bytes + q->size, size - q->size, 0);

        if (n < 0 && errno == EINTR)
            continue;
        if (n <= 0)
            return -1;
        q->size += (size_t)n;
        if (q->size == plcFrameUnit && size == plcFrameUnit &&
            (size = plcFrameSize(q->bytes, &x)) == 0)
            return -1;
    }
    return 0;
}

static void answer(plcModbusRelay *r, plcFrame *q)
{
    plcModbusResult x = {.lost = 0};
    plcFrame a = {.size = 0};
    plcModbusRequestOptions o;

    epicsMutexMustLock(r->lock);
    plcModbusSocketTake(&r->socket);
    o = r->options;
    epicsMutexUnlock(r->lock);
    if (plcModbusSocketAsk(&r->socket, q, &a, &o, &x)) {
        plcFrameRefuse(q, &a);
    } else { /* libmodbus compares these */
        memcpy(a.bytes, q->bytes, 2);
        a.bytes[plcFrameUnit] = q->bytes[plcFrameUnit];
    }
    epicsMutexMustLock(r->lock);
    r->last = x;
    if (x.lost && !x.silent)
        plcModbusSocketAbort(&r->socket);
    epicsMutexUnlock(r->lock);
    /* A local socket takes a frame as a whole. */
    (void)send(r->far, a.bytes, a.size, MSG_NOSIGNAL);
}

/* Something happens at the PLC's socket, and nobody has asked. */
static void breakOff(plcModbusRelay *r)
{
    plcModbusResult x = {.lost = 0};
    plcModbusRequestOptions o;
    int tell = 0;

    epicsMutexMustLock(r->lock);
    o = r->options;
    epicsMutexUnlock(r->lock);
    if (plcModbusSocketDrop(&r->socket, &o, &x) == 0)
        return;
    epicsMutexMustLock(r->lock);
    if (!plcModbusSocketTake(&r->socket)) {
        tell = !x.closed || x.reset; /* else there is a new one for the next request */
        plcModbusSocketClose(&r->socket);
    }
    if (tell)
        strcpy(r->brokenWhy, x.why);
    epicsMutexUnlock(r->lock);
    if (tell)
        r->broken(r->arg);
}

static void relayThread(void *arg)
{
    plcModbusRelay *r = arg;
    plcFrame request;

    for (;;) {
        struct pollfd p[2] = {
            {r->far,       POLLIN, 0},
            {r->socket.fd, POLLIN, 0}
        };

        if (poll(p, 2, -1) < 0)
            continue;
        if (p[0].revents) {
            if (takeRequest(r, &request))
                return;
            answer(r, &request);
        } else if (p[1].revents) {
            breakOff(r);
        }
    }
}
