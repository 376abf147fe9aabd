/* A request and its answer on the socket of a PLC; see plcModbusSocket.h. */
#include <errno.h>
#include <poll.h>
#include <string.h>

#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <epicsTime.h>

#include "plcErrno.h"
#include "plcModbusSocket.h"

/* So many transaction numbers back, an answer is an old one. */
#define OLDEST 1000

/* No PLC starts anew, and is asked again, within this time after an answer; ns. */
static const epicsUInt64 startsIn = 1000000000u;

static void closeIf(int *fd)
{
    if (*fd >= 0)
        close(*fd);
    *fd = -1;
}

/* --- Which socket -------------------------------------------------------------------------- */

void plcModbusSocketInit(plcModbusSocket *s, epicsMutexId lock)
{
    s->lock = lock;
    s->fd = s->next = -1;
}

void plcModbusSocketFree(plcModbusSocket *s)
{
    closeIf(&s->fd);
    closeIf(&s->next);
}

void plcModbusSocketNext(plcModbusSocket *s, int fd)
{
    closeIf(&s->next);
    s->next = fd;
    s->cut = 0;
    if (s->fd >= 0)
        shutdown(s->fd, SHUT_RD); /* the thread sees that, and takes the next */
}

void plcModbusSocketCut(plcModbusSocket *s)
{
    closeIf(&s->next);
    s->cut = 1;
    if (s->fd >= 0)
        shutdown(s->fd, SHUT_RD); /* that it sees */
}

void plcModbusSocketClose(plcModbusSocket *s)
{
    closeIf(&s->fd);
}

void plcModbusSocketAbort(plcModbusSocket *s)
{
    struct linger none = {.l_onoff = 1};

    if (s->fd >= 0)
        (void)setsockopt(s->fd, SOL_SOCKET, SO_LINGER, &none, sizeof(none));
    closeIf(&s->fd);
}

/* A new connection: nothing has been asked on it. */
static void begin(plcModbusSocket *s)
{
    s->rx.size = 0;
    s->requests = 0;
    s->answered = 0;
}

int plcModbusSocketTake(plcModbusSocket *s)
{
    socklen_t size = sizeof(s->address);

    if (s->next < 0)
        return 0;
    closeIf(&s->fd);
    s->fd = s->next;
    s->next = -1;
    begin(s);
    if (getpeername(s->fd, (struct sockaddr *)&s->address, &size))
        s->address.sin_family = AF_UNSPEC; /* it is gone already */
    return 1;
}

/* --- Bytes --------------------------------------------------------------------------------- */

static int lostBy(plcModbusResult *x, int error)
{
    x->closed = error == ECONNRESET || error == EPIPE;
    x->reset = x->closed;
    return plcModbusLost(x, "%s", plcErrnoText(error));
}

static int lostByTime(plcModbusResult *x, const char *what, double timeout)
{
    x->timeout = 1;
    if (timeout < 1000)
        return plcModbusLost(x, "%s %.0f ms", what, timeout);
    return plcModbusLost(x, "%s %.1f s", what, timeout / 1000);
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

static int sendFrame(plcModbusSocket *s, const plcFrame *q, epicsUInt64 deadline,
                     double timeout, plcModbusResult *x)
{
    while (x->sent < q->size) {
        ssize_t n = send(s->fd, q->bytes + x->sent, q->size - x->sent, MSG_NOSIGNAL);

        if (n > 0)
            x->sent += (unsigned)n;
        else if (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR)
            return lostBy(x, errno);
        else if (!await(s->fd, POLLOUT, deadline))
            return lostByTime(x, "PLC takes no request for", timeout);
    }
    return 0;
}

/* Reads what is there into rx, up to `size` bytes in all. Returns 1: something came, 0: nothing
 * is there, -1: the socket is lost. */
static int receiveSome(plcModbusSocket *s, size_t size, plcModbusResult *x)
{
    plcFrame *rx = &s->rx;
    ssize_t n = recv(s->fd, rx->bytes + rx->size, size - rx->size, MSG_DONTWAIT);

    if (n > 0) {
        rx->size += (size_t)n;
        x->received += (unsigned)n;
        return 1;
    }
    if (n == 0) {
        x->closed = 1;
        return plcModbusLost(x, rx->size ? "closed by PLC within an answer"
                                         : "connection closed by PLC");
    }
    return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR ? 0 : lostBy(x, errno);
}

/* Receives up to `size` bytes in all. */
static int receive(plcModbusSocket *s, size_t size, epicsUInt64 deadline,
                   const plcModbusRequestOptions *o, plcModbusResult *x)
{
    while (s->rx.size < size) {
        int got = receiveSome(s, size, x);

        if (got < 0)
            return -1;
        if (got || await(s->fd, POLLIN, deadline))
            continue;
        x->silent = o->keepSilent && !s->rx.size;
        return s->rx.size ? lostByTime(x, "answer is not complete after", o->timeout)
                          : lostByTime(x, "no answer for", o->timeout);
    }
    return 0;
}

/* --- Answers ------------------------------------------------------------------------------- */

static int unitOf(const plcModbusRequestOptions *o)
{
    return o->anyUnit ? -1 : o->unit;
}

/* True for the number of a request that was made before the one under way. */
static int isOld(const plcModbusSocket *s, unsigned transaction)
{
    unsigned back = (s->number - transaction) & 0xffff;

    return back < s->requests && back < OLDEST;
}

/* The answer to the request, into *a. Old ones are dropped. */
static int receiveAnswer(plcModbusSocket *s, const plcFrame *q, plcFrame *a, epicsUInt64 deadline,
                         const plcModbusRequestOptions *o, plcModbusResult *x)
{
    for (;;) {
        unsigned transaction;
        size_t size;

        if (receive(s, plcFrameHead, deadline, o, x) ||
            (size = plcFrameSize(s->rx.bytes, x)) == 0)
            return -1;
        transaction = plcFrameTransaction(s->rx.bytes);
        if (transaction == plcFrameTransaction(q->bytes) || o->anyTransaction) {
            if (plcFrameCheckHead(q, s->rx.bytes, unitOf(o), x) ||
                receive(s, size, deadline, o, x))
                return -1;
            *a = s->rx;
            s->rx.size = 0;
            return 0;
        }
        if (!isOld(s, transaction))
            return plcModbusLost(x, "bad answer: wrong transaction number");
        if (receive(s, size, deadline, o, x))
            return -1;
        s->rx.size = 0;
    }
}

/* An answer on a serial line has no length and no number. */
static int receiveRtu(plcModbusSocket *s, const plcFrame *q, plcFrame *a, epicsUInt64 deadline,
                      const plcModbusRequestOptions *o, plcModbusResult *x)
{
    epicsUInt8 head[plcFrameHead];
    size_t size;

    if (receive(s, plcRtuHead, deadline, o, x))
        return -1;
    memcpy(head, q->bytes, plcFrameUnit);
    memcpy(head + plcFrameUnit, s->rx.bytes, plcRtuHead);
    size = plcRtuSize(q, s->rx.bytes);
    if (plcFrameCheckHead(q, head, unitOf(o), x) || receive(s, size, deadline, o, x) ||
        plcFrameFromRtu(q, s->rx.bytes, size, a, x))
        return -1;
    s->rx.size = 0;
    return 0;
}

/* --- The connection and its requests ------------------------------------------------------- */

/* With `strict`, only answers that come again or late may be there. */
int plcModbusSocketDrop(plcModbusSocket *s, const plcModbusRequestOptions *o, plcModbusResult *x)
{
    int strict = !o->anyTransaction && !o->rtu, got = 1;

    while (got > 0) {
        size_t size = !strict ? plcFrameMax : plcFrameHead;

        if (strict && s->rx.size >= size && (size = plcFrameSize(s->rx.bytes, x)) == 0)
            return plcModbusLost(x, "PLC sends what was not asked for");
        if (s->rx.size >= size || !strict)
            s->rx.size = 0; /* a whole one */
        got = receiveSome(s, strict && !s->rx.size ? plcFrameHead : size, x);
        if (got > 0 && strict && s->rx.size >= 2 && !isOld(s, plcFrameTransaction(s->rx.bytes)))
            return plcModbusLost(x, "PLC sends what was not asked for");
    }
    return got;
}

/* Connects again, to the same PLC. Returns 0, or -1. */
static int reopen(plcModbusSocket *s, epicsUInt64 deadline, const plcModbusRequestOptions *o,
                  plcModbusResult *x)
{
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0), on = 1, error = 0;
    socklen_t size = sizeof(error);
    int cut;

    if (fd < 0)
        return lostBy(x, errno);
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    setsockopt(fd, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof(on));
    epicsMutexMustLock(s->lock);
    cut = s->cut || s->address.sin_family != AF_INET;
    if (cut)
        close(fd);
    else
        s->fd = fd; /* whoever cuts the connection cuts this one */
    epicsMutexUnlock(s->lock);
    if (cut)
        return plcModbusLost(x, "not connected");
    begin(s);
    if (connect(fd, (struct sockaddr *)&s->address, sizeof(s->address)) == 0)
        return 0;
    if (errno != EINPROGRESS)
        return lostBy(x, errno);
    if (!await(fd, POLLOUT, deadline))
        return lostByTime(x, "PLC takes no connection for", o->timeout);
    getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &size);
    return error ? lostBy(x, error) : 0;
}

/* The PLC has closed the socket: for the next request there is a new one. */
static void dropSocket(plcModbusSocket *s)
{
    epicsMutexMustLock(s->lock);
    plcModbusSocketClose(s);
    epicsMutexUnlock(s->lock);
    s->rx.size = 0;
}

/* A socket on which a request can be made. Returns 0, or -1. */
static int makeReady(plcModbusSocket *s, epicsUInt64 deadline, const plcModbusRequestOptions *o,
                     plcModbusResult *x)
{
    if (s->fd >= 0 && plcModbusSocketDrop(s, o, x) == 0)
        return 0;
    if (x->lost && (!x->closed || x->reset))
        return -1;
    dropSocket(s);
    *x = (plcModbusResult){.lost = 0};
    return reopen(s, deadline, o, x);
}

/* Request out, answer in. */
static int converse(plcModbusSocket *s, plcFrame *q, plcFrame *a, epicsUInt64 deadline,
                    const plcModbusRequestOptions *o, plcModbusResult *x)
{
    plcFrame rtu = *q;

    a->size = 0;
    s->number = plcFrameTransaction(q->bytes);
    s->requests++;
    if (!o->rtu)
        return sendFrame(s, q, deadline, o->timeout, x) ||
               receiveAnswer(s, q, a, deadline, o, x) || plcFrameCheck(q, a, x);
    plcFrameToRtu(q, &rtu);
    return sendFrame(s, &rtu, deadline, o->timeout, x) ||
           receiveRtu(s, q, a, deadline, o, x) || plcFrameCheck(q, a, x);
}

/* Request out, answer in; once more where the PLC has closed the connection instead. */
static int askOnIt(plcModbusSocket *s, plcFrame *q, plcFrame *a,
                   const plcModbusRequestOptions *o, plcModbusResult *x)
{
    epicsUInt64 start = epicsMonotonicGet();
    epicsUInt64 deadline = start + (epicsUInt64)(o->timeout * 1e6);
    plcModbusResult first;

    if (makeReady(s, deadline, o, x))
        return -1;
    x->received = 0;
    if (converse(s, q, a, deadline, o, x)) {
        first = *x;
        if (!x->closed || x->received || !s->answered ||
            (x->reset && start - s->answered > startsIn))
            return -1;
        dropSocket(s);
        *x = (plcModbusResult){.lost = 0};
        if (reopen(s, deadline, o, x)) { /* it is gone: the first reason says it better */
            *x = first;
            return -1;
        }
        if (converse(s, q, a, deadline, o, x))
            return -1;
    }
    s->answered = epicsMonotonicGet();
    x->latency = (double)(s->answered - start) / 1e6;
    return 0;
}

/* When the request may fail, the next one has a new connection, but after silence where a late answer is known
 * by its number. */
int plcModbusSocketAsk(plcModbusSocket *s, plcFrame *q, plcFrame *a,
                       const plcModbusRequestOptions *o, plcModbusResult *x)
{
    q->bytes[plcFrameUnit] = (epicsUInt8)o->unit; /* libmodbus would refuse 248 to 254 */
    if (askOnIt(s, q, a, o, x) == 0)
        return 0;
    if (o->mayFail && (x->silent ? o->rtu || o->anyTransaction : !x->closed && s->requests > 0)) {
        x->silent = 1;
        dropSocket(s);
    }
    return -1;
}
