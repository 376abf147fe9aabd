/* One TCP socket on which frames go out and come in; see eipSocket.h. */
#include <errno.h>
#include <fcntl.h>
#include <netdb.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <netinet/tcp.h>

#include <cantProceed.h>
#include <epicsStdio.h>
#include <epicsTime.h>

#include "eipSocket.h"
#include "plcErrno.h"

#define NS_PER_MS 1000000ull

#ifndef MSG_NOSIGNAL
#define MSG_NOSIGNAL 0
#endif

void eipSocketInit(eipSocket *s)
{
    s->fd = INVALID_SOCKET;
    s->buffer = mallocMustSucceed(eipFrameMax, "etherip");
}

void eipSocketFree(eipSocket *s)
{
    eipSocketClose(s);
    free(s->buffer);
    s->buffer = NULL;
}

void eipSocketClose(eipSocket *s)
{
    if (s->fd != INVALID_SOCKET)
        close(s->fd);
    s->fd = INVALID_SOCKET;
}

void eipSocketUse(eipSocket *s, SOCKET fd)
{
    int on = 1;

    eipSocketClose(s);
    s->fd = fd;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    fcntl(fd, F_SETFL, fcntl(fd, F_GETFL) | O_NONBLOCK);
}

/* Waits until the socket can be read or written. Returns 0, or -1: it is too late. */
static int waitFor(eipSocket *s, short events, epicsUInt64 deadline)
{
    for (;;) {
        struct pollfd p = {s->fd, events, 0};
        epicsUInt64 now = epicsMonotonicGet();
        epicsUInt64 ms = now < deadline ? (deadline - now + NS_PER_MS - 1) / NS_PER_MS : 0;
        int n = poll(&p, 1, ms > 3600000 ? 3600000 : (int)ms);

        if (n > 0 || (n < 0 && errno != EINTR))
            return 0;
        if (epicsMonotonicGet() >= deadline)
            return -1;
    }
}

static int tryConnect(eipSocket *s, const struct addrinfo *a, epicsUInt64 deadline,
                      char *why, size_t size)
{
    SOCKET fd = epicsSocketCreate(a->ai_family, a->ai_socktype, a->ai_protocol);
    int error = 0;
    socklen_t length = sizeof(error);

    if (fd == INVALID_SOCKET) {
        epicsSnprintf(why, size, "no socket: %s", plcErrnoText(errno));
        return -1;
    }
    eipSocketUse(s, fd);
    if (connect(fd, a->ai_addr, a->ai_addrlen) == 0)
        return 0;
    if (errno != EINPROGRESS)
        error = errno;
    else if (waitFor(s, POLLOUT, deadline))
        error = ETIMEDOUT;
    else
        getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &length);
    if (!error)
        return 0;
    epicsSnprintf(why, size, "%s", plcErrnoText(error));
    eipSocketClose(s);
    return -1;
}

int eipSocketConnect(eipSocket *s, const char *host, unsigned port, unsigned ms, char *why,
                     size_t size)
{
    struct addrinfo hints = {.ai_family = AF_INET, .ai_socktype = SOCK_STREAM}, *found;
    epicsUInt64 deadline = epicsMonotonicGet() + ms * NS_PER_MS;
    char service[12];
    int status;

    epicsSnprintf(service, sizeof(service), "%u", port);
    status = getaddrinfo(host, service, &hints, &found);
    if (status) {
        epicsSnprintf(why, size, "%s", gai_strerror(status));
        return -1;
    }
    status = tryConnect(s, found, deadline, why, size);
    freeaddrinfo(found);
    return status;
}

static eipOutcome broken(char *why, size_t size, const char *text)
{
    epicsSnprintf(why, size, "%s", text);
    return eipBroken;
}

/* What recv says when it gives nothing. */
static const char *lossText(ssize_t n)
{
    return n == 0 ? "connection closed by PLC" : plcErrnoText(errno);
}

static eipOutcome sendAll(eipSocket *s, const char *bytes, size_t n, epicsUInt64 deadline,
                          char *why, size_t size)
{
    size_t sent = 0;

    while (sent < n) {
        ssize_t k = send(s->fd, bytes + sent, n - sent, MSG_NOSIGNAL);

        if (k > 0)
            sent += (size_t)k;
        else if (k < 0 && errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR)
            return broken(why, size, plcErrnoText(errno));
        else if (waitFor(s, POLLOUT, deadline))
            return eipTooLate;
    }
    return eipAnswered;
}

/* Reads what is there, but not more than `most` bytes in all: what comes behind the frame is
 * seen later, as bytes that nobody asked for. */
static eipOutcome receive(eipSocket *s, epicsUInt64 deadline, size_t *length, char *why,
                          size_t size)
{
    size_t have = 0, most = eipHeaderSize;

    while (have < most) {
        ssize_t k = recv(s->fd, (char *)s->buffer + have, most - have, 0);

        if (k > 0) {
            have += (size_t)k;
            if (have >= eipHeaderSize && most == eipHeaderSize)
                most = eipFrameLength(s->buffer, have);
            continue;
        }
        if (k == 0 || (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR))
            return broken(why, size, lossText(k));
        if (waitFor(s, POLLIN, deadline))
            return eipTooLate;
    }
    *length = have;
    return eipAnswered;
}

int eipSocketBroken(eipSocket *s, char *why, size_t size)
{
    char byte;
    ssize_t k = recv(s->fd, &byte, 1, MSG_PEEK);

    if (k < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR))
        return 0;
    epicsSnprintf(why, size, "%s",
                  k > 0 ? "the PLC sends what nobody asked for" : lossText(k));
    return 1;
}

eipOutcome eipSocketAsk(eipSocket *s, const void *frame, size_t n, unsigned ms,
                        size_t *length, char *why, size_t size)
{
    epicsUInt64 deadline = epicsMonotonicGet() + ms * NS_PER_MS;
    eipOutcome outcome = eipBroken;

    if (s->fd == INVALID_SOCKET)
        return broken(why, size, "not connected");
    if (!eipSocketBroken(s, why, size))
        outcome = sendAll(s, frame, n, deadline, why, size);
    if (outcome == eipAnswered)
        outcome = receive(s, deadline, length, why, size);
    if (outcome == eipTooLate)
        epicsSnprintf(why, size, "no answer for %.1f s", ms / 1e3);
    return outcome;
}

void eipSocketTell(eipSocket *s, const void *frame, size_t n)
{
    if (s->fd != INVALID_SOCKET && n)
        (void)!send(s->fd, frame, n, MSG_NOSIGNAL | MSG_DONTWAIT);
}
