/* Frames between libmodbus and a PLC's socket; see plcModbusWire.h. */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include <netinet/in.h>
#include <netinet/tcp.h>
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
    lengthMax = frameMax - unitAt,
    oldest = 1000, /* so many transaction numbers back, an answer is an old one */
    crcSize = 2
};

/* No PLC starts anew, and is asked again, within this time after an answer; ns. */
static const epicsUInt64 startsIn = 1000000000u;

typedef struct frame {
    epicsUInt8 bytes[frameMax];
    size_t size;
} frame;

struct plcModbusWire {
    char name[40];
    void (*broken)(void *arg);
    void *arg;
    modbus_t *context;
    int near, far; /* libmodbus's end of the pair, and the thread's; -1: not there */
    epicsThreadId thread;
    epicsMutexId lock; /* guards the rest. The thread alone changes socket */
    int socket, next;  /* in use; to be used from the next request on; -1: none */
    int cut;           /* the connection is not wanted any more */
    plcModbusWireOptions options;
    plcModbusResult last;
    char brokenWhy[PLC_REASON_SIZE]; /* "": it is not */

    /* the thread's own, of the socket in use */
    struct sockaddr_in address; /* of the PLC */
    frame rx;          /* what has come and is no whole answer yet */
    unsigned number;   /* transaction number of the last request, */
    unsigned requests; /* and how many there were */
    epicsUInt64 answered; /* ns, when the last of them was; 0: none */
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

plcModbusWire *plcModbusWireCreate(const char *name, void (*broken)(void *arg), void *arg)
{
    plcModbusWire *w = callocMustSucceed(1, sizeof(*w), "plcModbusWireCreate");

    epicsSnprintf(w->name, sizeof(w->name), "%s-mbw", name);
    w->broken = broken;
    w->arg = arg;
    w->options.timeout = 1000;
    w->options.unit = 1;
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
    w->cut = 0;
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
    w->cut = 1;
    if (w->socket >= 0)
        shutdown(w->socket, SHUT_RDWR);
    epicsMutexUnlock(w->lock);
}

/* A new connection: nothing has been asked on it. */
static void begin(plcModbusWire *w)
{
    w->rx.size = 0;
    w->requests = 0;
    w->answered = 0;
}

/* Takes the next socket if there is one. Returns 1 when it did. The lock is held. */
static int takeNext(plcModbusWire *w)
{
    socklen_t size;

    if (w->next < 0)
        return 0;
    closeIf(&w->socket);
    w->socket = w->next;
    w->next = -1;
    begin(w);
    size = sizeof(w->address);
    if (getpeername(w->socket, (struct sockaddr *)&w->address, &size))
        w->address.sin_family = AF_UNSPEC; /* it is gone already */
    return 1;
}

/* --- What others ask -------------------------------------------------------------- */

modbus_t *plcModbusWireContext(plcModbusWire *w)
{
    return w->context;
}

void plcModbusWireOptionsSet(plcModbusWire *w, const plcModbusWireOptions *options)
{
    epicsMutexMustLock(w->lock);
    w->options = *options;
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
    x->closed = error == ECONNRESET || error == EPIPE;
    x->reset = x->closed;
    if (x->closed)
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

/* Reads what is there into rx, up to `size` bytes in all. Returns 1: something came, 0: nothing
 * is there, -1: the socket is lost. */
static int receiveSome(plcModbusWire *w, size_t size, plcModbusResult *x)
{
    frame *rx = &w->rx;
    ssize_t n = recv(w->socket, rx->bytes + rx->size, size - rx->size, MSG_DONTWAIT);

    if (n > 0) {
        rx->size += (size_t)n;
        x->received += (unsigned)n;
        return 1;
    }
    if (n == 0) {
        x->closed = 1;
        return lost(x, rx->size ? "closed by PLC within an answer" : "connection closed by PLC");
    }
    return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR ? 0 : lostBy(x, errno);
}

/* Receives up to `size` bytes in all. */
static int receive(plcModbusWire *w, size_t size, epicsUInt64 deadline,
                   const plcModbusWireOptions *o, plcModbusResult *x)
{
    while (w->rx.size < size) {
        int got = receiveSome(w, size, x);

        if (got < 0)
            return -1;
        if (got || await(w->socket, POLLIN, deadline))
            continue;
        x->silent = o->keepSilent && !w->rx.size;
        return w->rx.size ? lostByTime(x, "answer is not complete after", o->timeout)
                          : lostByTime(x, "no answer for", o->timeout);
    }
    return 0;
}

/* True for the number of a request that was made before the one under way. */
static int isOld(const plcModbusWire *w, unsigned transaction)
{
    unsigned back = (w->number - transaction) & 0xffff;

    return back < w->requests && back < oldest;
}

/* The length of the first frame in rx, which has a header. Returns 0 when that makes no sense. */
static size_t frameSize(const plcModbusWire *w, plcModbusResult *x)
{
    unsigned length = number(w->rx.bytes + lengthAt);

    if (number(w->rx.bytes + 2))
        lost(x, "bad answer: no Modbus/TCP");
    else if (length < lengthMin || length > lengthMax)
        lost(x, "bad answer: length %u", length);
    else
        return unitAt + length;
    return 0;
}

/* Is this the answer to the request, by its function and unit? */
static int checkHeader(const frame *q, const frame *a, const plcModbusWireOptions *o,
                       plcModbusResult *x)
{
    unsigned function = a->bytes[functionAt] & 0x7f;

    if (!o->anyUnit && a->bytes[unitAt] != o->unit)
        return lost(x, "bad answer: unit %u instead of %d", a->bytes[unitAt], o->unit);
    if (function != q->bytes[functionAt])
        return lost(x, "bad answer: function %u instead of %u", function,
                    q->bytes[functionAt]);
    return 0;
}

/* The answer to the request, into *a. Old ones are dropped. */
static int receiveAnswer(plcModbusWire *w, const frame *q, frame *a, epicsUInt64 deadline,
                         const plcModbusWireOptions *o, plcModbusResult *x)
{
    for (;;) {
        unsigned transaction;
        size_t size;

        if (receive(w, headerSize + 1, deadline, o, x) || (size = frameSize(w, x)) == 0)
            return -1;
        transaction = number(w->rx.bytes);
        if (transaction == number(q->bytes) || o->anyTransaction) {
            if (checkHeader(q, &w->rx, o, x) || receive(w, size, deadline, o, x))
                return -1;
            *a = w->rx;
            w->rx.size = 0;
            return 0;
        }
        if (!isOld(w, transaction))
            return lost(x, "bad answer: wrong transaction number");
        if (receive(w, size, deadline, o, x))
            return -1;
        w->rx.size = 0;
    }
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

/* --- RTU ---------------------------------------------------------------------------- */

/* CRC-16 of the serial line: polynomial 0xA001, from 0xFFFF on. */
static unsigned crcOf(const epicsUInt8 *bytes, size_t size)
{
    unsigned crc = 0xffff, bit;

    while (size--) {
        crc ^= *bytes++;
        for (bit = 0; bit < 8; bit++)
            crc = crc & 1 ? crc >> 1 ^ 0xa001 : crc >> 1;
    }
    return crc;
}

/* The header goes, the CRC comes, its low byte first. */
static void toRtu(const frame *q, frame *rtu)
{
    unsigned crc;

    rtu->size = q->size - unitAt;
    memcpy(rtu->bytes, q->bytes + unitAt, rtu->size);
    crc = crcOf(rtu->bytes, rtu->size);
    rtu->bytes[rtu->size++] = (epicsUInt8)crc;
    rtu->bytes[rtu->size++] = (epicsUInt8)(crc >> 8);
}

/* An answer has no length: the request says it. */
static int receiveRtu(plcModbusWire *w, const frame *q, frame *a, epicsUInt64 deadline,
                      const plcModbusWireOptions *o, plcModbusResult *x)
{
    size_t size;
    unsigned crc;

    if (receive(w, 2, deadline, o, x))
        return -1;
    size = (w->rx.bytes[1] & 0x80 ? 3 : expectedLength(q)) + crcSize;
    memcpy(a->bytes, q->bytes, unitAt);
    memcpy(a->bytes + unitAt, w->rx.bytes, 2);
    if (checkHeader(q, a, o, x) || receive(w, size, deadline, o, x))
        return -1;
    crc = crcOf(w->rx.bytes, size - crcSize);
    if (w->rx.bytes[size - 2] != (crc & 0xff) || w->rx.bytes[size - 1] != crc >> 8)
        return lost(x, "bad answer: wrong CRC");
    a->size = unitAt + size - crcSize;
    memcpy(a->bytes + unitAt, w->rx.bytes, size - crcSize);
    a->bytes[lengthAt] = (epicsUInt8)((size - crcSize) >> 8);
    a->bytes[lengthAt + 1] = (epicsUInt8)(size - crcSize);
    w->rx.size = 0;
    return 0;
}

/* --- The connection and its requests ------------------------------------------------- */

/* Drops what is there and was not asked for. With `strict`, only answers that come again or late
 * may be there. Returns 0, or -1: the socket is lost. */
static int dropOld(plcModbusWire *w, const plcModbusWireOptions *o, plcModbusResult *x)
{
    int strict = !o->anyTransaction && !o->rtu, got = 1;

    while (got > 0) {
        size_t size = !strict ? frameMax : headerSize + 1;

        if (strict && w->rx.size >= size && (size = frameSize(w, x)) == 0)
            return lost(x, "PLC sends what was not asked for");
        if (w->rx.size >= size || !strict)
            w->rx.size = 0; /* a whole one */
        got = receiveSome(w, strict && !w->rx.size ? headerSize + 1 : size, x);
        if (got > 0 && strict && w->rx.size >= 2 && !isOld(w, number(w->rx.bytes)))
            return lost(x, "PLC sends what was not asked for");
    }
    return got;
}

/* Connects again, to the same PLC. Returns 0, or -1. */
static int reopen(plcModbusWire *w, epicsUInt64 deadline, const plcModbusWireOptions *o,
                  plcModbusResult *x)
{
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0), on = 1, error = 0;
    socklen_t size = sizeof(error);
    int cut;

    if (fd < 0)
        return lostBy(x, errno);
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    setsockopt(fd, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof(on));
    epicsMutexMustLock(w->lock);
    cut = w->cut || w->address.sin_family != AF_INET;
    if (cut)
        close(fd);
    else
        w->socket = fd; /* whoever cuts the connection cuts this one */
    epicsMutexUnlock(w->lock);
    if (cut)
        return lost(x, "not connected");
    begin(w);
    if (connect(fd, (struct sockaddr *)&w->address, sizeof(w->address)) == 0)
        return 0;
    if (errno != EINPROGRESS)
        return lostBy(x, errno);
    if (!await(fd, POLLOUT, deadline))
        return lostByTime(x, "PLC takes no connection for", o->timeout);
    getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &size);
    return error ? lostBy(x, error) : 0;
}

/* The PLC has closed the socket: for the next request there is a new one. */
static void dropSocket(plcModbusWire *w)
{
    epicsMutexMustLock(w->lock);
    if (w->socket >= 0)
        shutdown(w->socket, SHUT_RDWR);
    closeIf(&w->socket);
    epicsMutexUnlock(w->lock);
    w->rx.size = 0;
}

/* A socket on which a request can be made. Returns 0, or -1. */
static int makeReady(plcModbusWire *w, epicsUInt64 deadline, const plcModbusWireOptions *o,
                     plcModbusResult *x)
{
    if (w->socket >= 0 && dropOld(w, o, x) == 0)
        return 0;
    if (x->lost && (!x->closed || x->reset))
        return -1;
    dropSocket(w);
    *x = (plcModbusResult){.lost = 0};
    return reopen(w, deadline, o, x);
}

/* Request out, answer in. */
static int converse(plcModbusWire *w, frame *q, frame *a, epicsUInt64 deadline,
                    const plcModbusWireOptions *o, plcModbusResult *x)
{
    frame rtu = *q;

    a->size = 0;
    w->number = number(q->bytes);
    w->requests++;
    if (!o->rtu)
        return sendFrame(w, q, deadline, o->timeout, x) ||
               receiveAnswer(w, q, a, deadline, o, x) || checkAnswer(q, a, x);
    toRtu(q, &rtu);
    return sendFrame(w, &rtu, deadline, o->timeout, x) ||
           receiveRtu(w, q, a, deadline, o, x) || checkAnswer(q, a, x);
}

/* Request out, answer in, on a new connection where the PLC has closed the old one. Returns 0 with
 * a good answer (exceptions are), or -1. */
static int exchange(plcModbusWire *w, frame *q, frame *a, const plcModbusWireOptions *o,
                    plcModbusResult *x)
{
    epicsUInt64 start = epicsMonotonicGet();
    epicsUInt64 deadline = start + (epicsUInt64)(o->timeout * 1e6);
    plcModbusResult first;

    q->bytes[unitAt] = (epicsUInt8)o->unit; /* libmodbus would refuse 248 to 254 */
    if (makeReady(w, deadline, o, x))
        return -1;
    x->received = 0;
    if (converse(w, q, a, deadline, o, x)) {
        first = *x;
        if (!x->closed || x->received || !w->answered ||
            (x->reset && start - w->answered > startsIn))
            return -1;
        dropSocket(w);
        *x = (plcModbusResult){.lost = 0};
        if (reopen(w, deadline, o, x)) { /* it is gone: the first reason says it better */
            *x = first;
            return -1;
        }
        if (converse(w, q, a, deadline, o, x))
            return -1;
    }
    w->answered = epicsMonotonicGet();
    x->latency = (double)(w->answered - start) / 1e6;
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
    plcModbusWireOptions o;

    epicsMutexMustLock(w->lock);
    takeNext(w);
    o = w->options;
    epicsMutexUnlock(w->lock);
    if (exchange(w, q, &a, &o, &x)) {
        makeRefusal(q, &a);
    } else { /* libmodbus compares these */
        memcpy(a.bytes, q->bytes, 2);
        a.bytes[unitAt] = q->bytes[unitAt];
    }
    epicsMutexMustLock(w->lock);
    w->last = x;
    if (x.lost && !x.silent && w->socket >= 0) {
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
    plcModbusWireOptions o;
    int tell = 0;

    epicsMutexMustLock(w->lock);
    o = w->options;
    epicsMutexUnlock(w->lock);
    if (dropOld(w, &o, &x) == 0)
        return;
    epicsMutexMustLock(w->lock);
    if (!takeNext(w)) {
        tell = !x.closed || x.reset; /* else there is a new one for the next request */
        shutdown(w->socket, SHUT_RDWR);
        closeIf(&w->socket);
    }
    if (tell)
        strcpy(w->brokenWhy, x.why);
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
