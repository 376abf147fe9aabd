/* One TCP connection; see plcConnection.h. */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <string.h>

#include <netinet/tcp.h>
#include <sys/ioctl.h>
#ifdef __linux__
#include <linux/sockios.h>
#endif

#include <epicsStdio.h>

#include "plcConnection.h"
#include "plcErrno.h"
#include "plcHot.h"

#ifndef MSG_NOSIGNAL
#define MSG_NOSIGNAL 0 /* SO_NOSIGPIPE is set instead */
#endif

/* Socket options that make a dead peer known; s. Data unacknowledged that long, too. */
enum { keepIdle = 5, keepInterval = 2, keepCount = 3, userTimeout = 10 };

/* A host may wait so long before it acknowledges a block. The next ones do not wait for it. */
#define ACK_NS 250000000u

static void setError(plcConnection *c, int number)
{
    epicsSnprintf(c->error, sizeof(c->error), "%s", plcErrnoText(number));
}

static int fail(plcConnection *c, int number, epicsUInt64 now)
{
    setError(c, number);
    plcConnectionClose(c, NULL, now);
    return -1;
}

void plcConnectionInit(plcConnection *c)
{
    memset(c, 0, sizeof(*c));
    c->socket = INVALID_SOCKET;
}

static void setOption(SOCKET s, int level, int option, int value)
{
    /* Helpful, not vital: a system that lacks one works without. */
    (void)setsockopt(s, level, option, (char *)&value, sizeof(value));
}

static void setOptions(SOCKET s)
{
    setOption(s, IPPROTO_TCP, TCP_NODELAY, 1);
    setOption(s, SOL_SOCKET, SO_KEEPALIVE, 1);
#ifdef SO_NOSIGPIPE
    setOption(s, SOL_SOCKET, SO_NOSIGPIPE, 1);
#endif
#ifdef TCP_KEEPIDLE
    setOption(s, IPPROTO_TCP, TCP_KEEPIDLE, keepIdle);
    setOption(s, IPPROTO_TCP, TCP_KEEPINTVL, keepInterval);
    setOption(s, IPPROTO_TCP, TCP_KEEPCNT, keepCount);
#endif
#ifdef TCP_USER_TIMEOUT
    setOption(s, IPPROTO_TCP, TCP_USER_TIMEOUT, userTimeout * 1000);
#endif
}

int plcConnectionOpen(plcConnection *c, struct in_addr host, unsigned short port,
                      epicsUInt64 now)
{
    struct sockaddr_in peer = {.sin_family = AF_INET, .sin_port = port, .sin_addr = host};
    int flags;

    plcConnectionClose(c, NULL, now);
    c->socket = epicsSocketCreate(AF_INET, SOCK_STREAM, 0);
    if (c->socket == INVALID_SOCKET)
        return fail(c, errno, now);
    flags = fcntl(c->socket, F_GETFL);
    if (flags < 0 || fcntl(c->socket, F_SETFL, flags | O_NONBLOCK) < 0)
        return fail(c, errno, now);
    setOptions(c->socket);
    if (connect(c->socket, (struct sockaddr *)&peer, sizeof(peer)) < 0 &&
        errno != EINPROGRESS)
        return fail(c, errno, now);
    /* A connect that succeeded at once shows as writable too. */
    c->state = plcConnectionConnecting;
    c->since = now;
    return 0;
}

void plcConnectionClose(plcConnection *c, const char *why, epicsUInt64 now)
{
    if (c->socket != INVALID_SOCKET)
        epicsSocketDestroy(c->socket);
    c->socket = INVALID_SOCKET;
    if (c->state == plcConnectionUp)
        c->lasted = now - c->since;
    if (c->state != plcConnectionDown)
        c->since = now;
    c->state = plcConnectionDown;
    if (why && why != c->error)
        epicsSnprintf(c->error, sizeof(c->error), "%s", why);
}

void plcConnectionAbort(plcConnection *c, const char *why, epicsUInt64 now)
{
    struct linger none = {.l_onoff = 1};

    if (c->socket != INVALID_SOCKET)
        (void)setsockopt(c->socket, SOL_SOCKET, SO_LINGER, (char *)&none, sizeof(none));
    plcConnectionClose(c, why, now);
}

/* Bytes that the kernel has, because the PLC's host has not acknowledged them yet; -1: it does
 * not tell. */
static int queued(const plcConnection *c)
{
#ifdef TIOCOUTQ
    int left;

    if (ioctl(c->socket, TIOCOUTQ, &left) == 0)
        return left;
#else
    (void)c;
#endif
    return -1;
}

/* Of them those that are not on their way: the PLC has no room for them. */
static int unsent(const plcConnection *c)
{
#ifdef SIOCOUTQNSD
    int left;

    if (ioctl(c->socket, SIOCOUTQNSD, &left) == 0)
        return left;
#endif
    return queued(c);
}

int plcConnectionDelivered(const plcConnection *c)
{
    return queued(c) == 0;
}

int plcConnectionReady(plcConnection *c, epicsUInt64 now)
{
    int left = queued(c);

    if (left <= 0)
        return 1;
    if (c->given - (epicsUInt64)left >= c->marked) {
        c->marked = c->given;
        c->markedAt = now;
    }
    return now - c->markedAt < ACK_NS && unsent(c) == 0;
}

PLC_HOT short plcConnectionEvents(const plcConnection *c, int sending)
{
    switch (c->state) {
    case plcConnectionConnecting:
        return POLLOUT;
    case plcConnectionUp:
        return sending ? POLLIN | POLLOUT : POLLIN;
    default:
        return 0;
    }
}

int plcConnectionFinish(plcConnection *c, epicsUInt64 now)
{
    int number = 0;
    osiSocklen_t length = sizeof(number);
    struct sockaddr_in peer;
    osiSocklen_t peerLength = sizeof(peer);

    if (getsockopt(c->socket, SOL_SOCKET, SO_ERROR, (char *)&number, &length) < 0)
        number = errno;
    if (number)
        return fail(c, number, now);
    if (getpeername(c->socket, (struct sockaddr *)&peer, &peerLength) < 0)
        return errno == ENOTCONN ? 0 : fail(c, errno, now);
    c->state = plcConnectionUp;
    c->since = now;
    c->given = c->marked = 0;
    c->error[0] = 0;
    return 1;
}

PLC_HOT int plcConnectionReceive(plcConnection *c, void *space, size_t room, epicsUInt64 now)
{
    ssize_t count = recv(c->socket, space, room, 0);

    if (count > 0)
        return (int)count;
    if (count == 0) {
        plcConnectionClose(c, "connection closed by PLC", now);
        return -1;
    }
    if (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)
        return 0;
    return fail(c, errno, now);
}

void plcConnectionSmall(plcConnection *c, size_t size)
{
    if (queued(c) < 0)
        setOption(c->socket, SOL_SOCKET, SO_SNDBUF, (int)size);
}

int plcConnectionSend(plcConnection *c, const void *bytes, size_t count, epicsUInt64 now)
{
    ssize_t sent;

    do
        sent = send(c->socket, bytes, count, MSG_NOSIGNAL);
    while (sent < 0 && errno == EINTR);
    if (sent < 0)
        return errno == EAGAIN || errno == EWOULDBLOCK ? 0 : fail(c, errno, now);
    c->given += (epicsUInt64)sent;
    return (int)sent;
}
