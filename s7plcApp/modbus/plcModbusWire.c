/* Frames between libmodbus and a PLC's socket; see plcModbusWire.h. */
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

#include "plcModbusWire.h"

enum {
    headerSize = 7, /* up to and with the unit */
    frameMax = 260,
    lengthAt = 4, /* of the bytes from the unit on */
    unitAt = 6,
    functionAt = 7,
    lengthMin = 3, /* unit, function, one byte */
    lengthMax = frameMax - unitAt
};

typedef struct frame {
    epicsUInt8 bytes[frameMax];
    size_t size;
} frame;

struct plcModbusWire {
    char name[40];
    int unit;
    void (*broken)(void *arg);
    void *arg;
    modbus_t *context;
    int near, far; /* libmodbus's end of the pair, and the thread's; -1: not there */
    epicsThreadId thread;
    epicsMutexId lock; /* guards the rest. The thread alone changes socket */
    int socket, next;  /* in use; to be used from the next request on; -1: none */
    double timeout;    /* ms */
    plcModbusResult last;
    char brokenWhy[PLC_REASON_SIZE]; /* "": it is not */
};

static void wireThread(void *arg);

static unsigned number(const epicsUInt8 *bytes)
{
    return (unsigned)bytes[0] << 8 | bytes[1];
}

/* --- Descriptors ------------------------------------------------------------------ */

static void closeIf(int *fd)
{
    if (*fd >= 0)
        close(*fd);
    *fd = -1;
}

/* The end for libmodbus must fit into an fd_set; the other one makes room for it. */
static void makePair(plcModbusWire *w)
{
    int pair[2], high;

    if (w->near >= 0 || socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair))
        return;
    w->near = pair[0];
    w->far = pair[1];
    if (w->near >= FD_SETSIZE) {
        closeIf(&w->near);
        closeIf(&w->far);
        return;
    }
    high = fcntl(w->far, F_DUPFD_CLOEXEC, FD_SETSIZE);
    if (high >= 0) {
        close(w->far);
        w->far = high;
    }
}

static modbus_t *makeContext(void)
{
    modbus_t *context = modbus_new_tcp("127.0.0.1", MODBUS_TCP_DEFAULT_PORT);

    if (!context)
        cantProceed("plcModbusWireCreate: no memory for libmodbus\n");
    /* The thread always answers in time: libmodbus must never give up before it does. */
    modbus_set_response_timeout(context, 1000000, 0);
    modbus_set_byte_timeout(context, 0, 0);
    return context;
}

plcModbusWire *plcModbusWireCreate(const char *name, int unit, void (*broken)(void *arg),
                                   void *arg)
{
    plcModbusWire *w = callocMustSucceed(1, sizeof(*w), "plcModbusWireCreate");

    epicsSnprintf(w->name, sizeof(w->name), "%s-mbw", name);
    w->unit = unit;
    w->broken = broken;
    w->arg = arg;
    w->timeout = 1000;
    w->near = w->far = w->socket = w->next = -1;
    w->lock = epicsMutexMustCreate();
    w->context = makeContext();
    makePair(w);
    return w;
}

void plcModbusWireDestroy(plcModbusWire *w)
{
    if (w->thread) {
        shutdown(w->near, SHUT_RDWR);
        epicsThreadMustJoin(w->thread);
    }
    closeIf(&w->near);
    closeIf(&w->far);
    closeIf(&w->socket);
    closeIf(&w->next);
    modbus_free(w->context);
    epicsMutexDestroy(w->lock);
    free(w);
}

static int startThread(plcModbusWire *w)
{
    epicsThreadOpts options = EPICS_THREAD_OPTS_INIT;

    if (w->thread)
        return 0;
    options.priority = epicsThreadPriorityMedium;
    options.stackSize = epicsThreadStackMedium;
    options.joinable = 1;
    modbus_set_socket(w->context, w->near);
    w->thread = epicsThreadCreateOpt(w->name, wireThread, w, &options);
    return w->thread ? 0 : -1;
}

int plcModbusWireOpen(plcModbusWire *w, SOCKET socket, char why[PLC_REASON_SIZE])
{
    makePair(w);
    if (w->near < 0 || startThread(w)) {
        close(socket);
        epicsSnprintf(why, PLC_REASON_SIZE,
                      w->near < 0 ? "no descriptor below %d for Modbus"
                                  : "no thread for Modbus",
                      FD_SETSIZE);
        return -1;
    }
    epicsMutexMustLock(w->lock);
    closeIf(&w->next);
    w->next = socket;
    w->brokenWhy[0] = 0;
    if (w->socket >= 0)
        shutdown(w->socket, SHUT_RDWR); /* the thread sees that, and takes the next */
    epicsMutexUnlock(w->lock);
    return 0;
}

void plcModbusWireCut(plcModbusWire *w)
{
    epicsMutexMustLock(w->lock);
    closeIf(&w->next);
    if (w->socket >= 0)
        shutdown(w->socket, SHUT_RDWR);
    epicsMutexUnlock(w->lock);
}

/* Takes the next socket if there is one. Returns 1 when it did. The lock is held. */
static int takeNext(plcModbusWire *w)
{
    if (w->next < 0)
        return 0;
    closeIf(&w->socket);
    w->socket = w->next;
    w->next = -1;
    return 1;
}

/* --- What others ask -------------------------------------------------------------- */

modbus_t *plcModbusWireContext(plcModbusWire *w)
{
    return w->context;
}

void plcModbusWireTimeout(plcModbusWire *w, double timeout)
{
    epicsMutexMustLock(w->lock);
    w->timeout = timeout;
    epicsMutexUnlock(w->lock);
}

void plcModbusWireLast(plcModbusWire *w, plcModbusResult *exchange)
{
    epicsMutexMustLock(w->lock);
    *exchange = w->last;
    epicsMutexUnlock(w->lock);
}

int plcModbusWireBroken(plcModbusWire *w, char why[PLC_REASON_SIZE])
{
    epicsMutexMustLock(w->lock);
    strcpy(why, w->brokenWhy);
    epicsMutexUnlock(w->lock);
    return why[0] != 0;
}

/* --- One request, by the thread --------------------------------------------------- */

static int lost(plcModbusResult *x, const char *format, ...) EPICS_PRINTF_STYLE(2, 3);

/* Returns -1. */
static int lost(plcModbusResult *x, const char *format, ...)
{
    va_list args;

    x->lost = 1;
    va_start(args, format);
    epicsVsnprintf(x->why, sizeof(x->why), format, args);
    va_end(args);
    return -1;
}

static int lostBy(plcModbusResult *x, int error)
{
    if (error == ECONNRESET || error == EPIPE)
        return lost(x, "connection reset by PLC");
    if (error == ETIMEDOUT)
        return lost(x, "PLC does not answer");
    return lost(x, "%s", strerror(error));
}

static int lostByTime(plcModbusResult *x, const char *what, double timeout)
{
    x->timeout = 1;
    if (timeout < 1000)
        return lost(x, "%s %.0f ms", what, timeout);
    return lost(x, "%s %.1f s", what, timeout / 1000);
}

/* Waits for the socket. Returns 1, or 0 when the deadline is over. */
static int await(int fd, short events, epicsUInt64 deadline)
{
    struct pollfd p = {fd, events, 0};

    for (;;) {
        epicsUInt64 now = epicsMonotonicGet();
        int ms = now < deadline ? (int)((deadline - now + 999999) / 1000000) : 0;
        int n = poll(&p, 1, ms);

        if (n > 0)
            return 1;
        if (n == 0 && ms == 0)
            return 0;
    }
}

static int sendFrame(plcModbusWire *w, const frame *q, epicsUInt64 deadline,
                     double timeout, plcModbusResult *x)
{
    while (x->sent < q->size) {
        ssize_t n = send(w->socket, q->bytes + x->sent, q->size - x->sent, MSG_NOSIGNAL);

        if (n > 0)
            x->sent += (unsigned)n;
        else if (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR)
            return lostBy(x, errno);
        else if (!await(w->socket, POLLOUT, deadline))
            return lostByTime(x, "PLC takes no request for", timeout);
    }
    return 0;
}

/* Receives up to `size` bytes of the answer in all. */
static int receive(plcModbusWire *w, frame *a, size_t size, epicsUInt64 deadline,
                   double timeout, plcModbusResult *x)
{
    while (a->size < size) {
        ssize_t n = recv(w->socket, a->bytes + a->size, size - a->size, MSG_DONTWAIT);

        if (n > 0) {
            a->size += (size_t)n;
            x->received = (unsigned)a->size;
        } else if (n == 0) {
            return lost(x, a->size ? "closed by PLC within an answer"
                                   : "connection closed by PLC");
        } else if (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR) {
            return lostBy(x, errno);
        } else if (!await(w->socket, POLLIN, deadline)) {
            return a->size ? lostByTime(x, "answer is not complete after", timeout)
                           : lostByTime(x, "no answer for", timeout);
        }
    }
    return 0;
}

/* Is this the header of an answer to the request? */
static int checkHeader(const plcModbusWire *w, const frame *q, const frame *a,
                       plcModbusResult *x)
{
    unsigned function = a->bytes[functionAt] & 0x7f, length = number(a->bytes + lengthAt);

    if (number(a->bytes + 2))
        return lost(x, "bad answer: no Modbus/TCP");
    if (number(a->bytes) != number(q->bytes))
        return lost(x, "bad answer: wrong transaction number");
    if (length < lengthMin || length > lengthMax)
        return lost(x, "bad answer: length %u", length);
    if (a->bytes[unitAt] != w->unit)
        return lost(x, "bad answer: unit %u instead of %d", a->bytes[unitAt], w->unit);
    if (function != q->bytes[functionAt])
        return lost(x, "bad answer: function %u instead of %u", function,
                    q->bytes[functionAt]);
    return 0;
}

/* What is in the length of the answer's header. */
static unsigned expectedLength(const frame *q)
{
    unsigned count = number(q->bytes + 10);

    switch (q->bytes[functionAt]) {
    case 1:
    case 2:
        return 3 + (count + 7) / 8;
    case 3:
    case 4:
        return 3 + 2 * count;
    case 22:
        return 8;
    default: /* writes: address and value or count come back */
        return 6;
    }
}

/* The whole answer is there, its header is good. */
static int checkAnswer(const frame *q, const frame *a, plcModbusResult *x)
{
    unsigned length = number(a->bytes + lengthAt);
    unsigned expected = a->bytes[functionAt] & 0x80 ? 3 : expectedLength(q);

    if (length != expected)
        return lost(x, "bad answer: %s", length < expected ? "too short" : "too long");
    x->exception = a->bytes[functionAt] & 0x80 ? a->bytes[functionAt + 1] : 0;
    if (a->bytes[functionAt] & 0x80)
        return x->exception ? 0 : lost(x, "bad answer: exception 0");
    if (q->bytes[functionAt] <= 4)
        return a->bytes[8] == expected - 3 ? 0
                                           : lost(x, "bad answer: wrong number of bytes");
    if (number(a->bytes + 8) != number(q->bytes + 8))
        return lost(x, "bad answer: address %u, not %u", number(a->bytes + 8),
                    number(q->bytes + 8));
    if (memcmp(a->bytes + 10, q->bytes + 10, expected - 4))
        return lost(x, "bad answer: not what was written");
    return 0;
}

/* Nothing may be there before the request is. */
static int checkQuiet(plcModbusWire *w, plcModbusResult *x)
{
    char byte;
    ssize_t n;

    do
        n = recv(w->socket, &byte, 1, MSG_DONTWAIT | MSG_PEEK);
    while (n < 0 && errno == EINTR);
    if (n > 0)
        return lost(x, "PLC sends what was not asked for");
    if (n == 0)
        return lost(x, "connection closed by PLC");
    return errno == EAGAIN || errno == EWOULDBLOCK ? 0 : lostBy(x, errno);
}

/* Request out, answer in. Returns 0 with a good answer (exceptions are), or -1. */
static int exchange(plcModbusWire *w, frame *q, frame *a, double timeout, plcModbusResult *x)
{
    epicsUInt64 begin = epicsMonotonicGet();
    epicsUInt64 deadline = begin + (epicsUInt64)(timeout * 1e6);

    if (w->socket < 0)
        return lost(x, "not connected");
    q->bytes[unitAt] = (epicsUInt8)w->unit; /* libmodbus would refuse 248 to 254 */
    if (checkQuiet(w, x) || sendFrame(w, q, deadline, timeout, x) ||
        receive(w, a, headerSize + 1, deadline, timeout, x) || checkHeader(w, q, a, x) ||
        receive(w, a, unitAt + number(a->bytes + lengthAt), deadline, timeout, x) ||
        checkAnswer(q, a, x))
        return -1;
    x->latency = (double)(epicsMonotonicGet() - begin) / 1e6;
    return 0;
}

/* --- The thread ------------------------------------------------------------------- */

/* A whole request of libmodbus. Returns 0, or -1: the wire is to end. */
static int takeRequest(plcModbusWire *w, frame *q)
{
    size_t size = headerSize;

    for (q->size = 0; q->size < size;) {
        ssize_t n = recv(w->far, q->bytes + q->size, size - q->size, 0);

        if (n < 0 && errno == EINTR)
            continue;
        if (n <= 0)
            return -1;
        q->size += (size_t)n;
        if (q->size == headerSize && size == headerSize)
            size = unitAt + number(q->bytes + lengthAt);
        if (size > frameMax)
            return -1;
    }
    return 0;
}

/* For libmodbus: the request was refused. */
static void makeRefusal(const frame *q, frame *a)
{
    memcpy(a->bytes, q->bytes, functionAt + 1);
    a->bytes[lengthAt] = 0;
    a->bytes[lengthAt + 1] = 3;
    a->bytes[functionAt] |= 0x80;
    a->bytes[functionAt + 1] = MODBUS_EXCEPTION_SLAVE_OR_SERVER_FAILURE;
    a->size = functionAt + 2;
}

static void answer(plcModbusWire *w, frame *q)
{
    plcModbusResult x = {.lost = 0};
    frame a = {.size = 0};
    double timeout;

    epicsMutexMustLock(w->lock);
    takeNext(w);
    timeout = w->timeout;
    epicsMutexUnlock(w->lock);
    if (exchange(w, q, &a, timeout, &x))
        makeRefusal(q, &a);
    epicsMutexMustLock(w->lock);
    w->last = x;
    if (x.lost && w->socket >= 0) {
        shutdown(w->socket, SHUT_RDWR);
        closeIf(&w->socket);
    }
    epicsMutexUnlock(w->lock);
    /* A local socket takes a frame as a whole. */
    (void)send(w->far, a.bytes, a.size, MSG_NOSIGNAL);
}

/* Something happens at the PLC's socket, and nobody has asked. */
static void breakWire(plcModbusWire *w)
{
    plcModbusResult x = {.lost = 0};
    int tell;

    if (checkQuiet(w, &x) == 0)
        return;
    epicsMutexMustLock(w->lock);
    tell = !takeNext(w);
    if (tell) {
        shutdown(w->socket, SHUT_RDWR);
        closeIf(&w->socket);
        strcpy(w->brokenWhy, x.why);
    }
    epicsMutexUnlock(w->lock);
    if (tell)
        w->broken(w->arg);
}

static void wireThread(void *arg)
{
    plcModbusWire *w = arg;
    frame request;

    for (;;) {
        struct pollfd p[2] = {
            {w->far,    POLLIN, 0},
            {w->socket, POLLIN, 0}
        };

        if (poll(p, 2, -1) < 0)
            continue;
        if (p[0].revents) {
            if (takeRequest(w, &request))
                return;
            answer(w, &request);
        } else if (p[1].revents) {
            breakWire(w);
        }
    }
}
