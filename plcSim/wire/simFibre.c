/* simFibre: the synchronising link between the two PLCs of a pair. It carries messages,
 * in one process by a call, between two processes by a TCP or unix socket. It does not
 * know what the messages say.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* accept4 */
#endif
#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/un.h>
#include <unistd.h>

#include <cantProceed.h>

#include "simFibre.h"
#include "simLog.h"
#include "simValue.h"

#define RETRY 0.1                  /* s */
#define MAX_OUT (8u * 1024 * 1024) /* bytes that may wait */
#define PREFIX 4u                  /* bytes of the length in front of a message */

static void tryConnect(void *arg);
static void onLink(void *arg, int fd, short revents);

void simFibreJoin(simFibre *a, simFibre *b)
{
    a->peer = b;
    b->peer = a;
    a->listener = a->fd = b->listener = b->fd = -1;
}

int simFibreIsUp(const simFibre *fibre)
{
    return fibre->peer || (fibre->fd >= 0 && !fibre->connecting);
}

/* ---- one link ---- */

static void dropLink(simFibre *fibre)
{
    if (fibre->fd < 0)
        return;
    simLoopForget(fibre->loop, fibre->fd);
    close(fibre->fd);
    if (!fibre->connecting)
        simLog(fibre->name, "fibre: down");
    fibre->fd = -1;
    fibre->outUsed = fibre->inUsed = 0;
    fibre->connecting = 0;
    if (fibre->listener < 0)
        simTimerSet(fibre->loop, &fibre->retry, simNow() + RETRY, tryConnect, fibre);
}

static void linkUp(simFibre *fibre)
{
    int on = 1;

    fibre->connecting = 0;
    if (fibre->address.ss_family == AF_INET)
        setsockopt(fibre->fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    simLoopWatch(fibre->loop, fibre->fd, POLLIN, onLink, fibre);
    simLog(fibre->name, "fibre: up");
    fibre->up(fibre->owner);
}

/* Sends what the socket takes. Returns -1 when the link broke. */
static int flush(simFibre *fibre)
{
    ssize_t n = 0;

    if (fibre->outUsed)
        n = send(fibre->fd, fibre->out, fibre->outUsed, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (n < 0 && errno != EAGAIN && errno != EINTR)
        return -1;
    if (n > 0) {
        fibre->outUsed -= (size_t)n;
        memmove(fibre->out, fibre->out + n, fibre->outUsed);
    }
    simLoopWatch(fibre->loop, fibre->fd, fibre->outUsed ? POLLIN | POLLOUT : POLLIN,
                 onLink, fibre);
    return 0;
}

int simFibreSend(simFibre *fibre, const epicsUInt8 *bytes, size_t size)
{
    if (fibre->peer) {
        fibre->peer->message(fibre->peer->owner, bytes, size);
        return 0;
    }
    if (!simFibreIsUp(fibre) || fibre->outUsed + size + PREFIX > MAX_OUT)
        return -1;
    if (fibre->outRoom < fibre->outUsed + size + PREFIX) {
        fibre->outRoom = 2 * (fibre->outUsed + size + PREFIX);
        fibre->out = realloc(fibre->out, fibre->outRoom);
        if (!fibre->out)
            cantProceed("simFibreSend: out of memory");
    }
    simPutInt(fibre->out + fibre->outUsed, PREFIX, 1, size);
    memcpy(fibre->out + fibre->outUsed + PREFIX, bytes, size);
    fibre->outUsed += size + PREFIX;
    if (flush(fibre)) {
        dropLink(fibre);
        return -1;
    }
    return 0;
}

/* Hands on the complete messages. Returns -1 on nonsense. */
static int handOn(simFibre *fibre)
{
    size_t used = 0;
    size_t size;

    while (fibre->inUsed - used >= PREFIX) {
        size = (size_t)simGetInt(fibre->in + used, PREFIX, 1);
        if (size < 1 || size > SIM_MAX_MESSAGE)
            return -1;
        if (fibre->inUsed - used < PREFIX + size)
            break;
        fibre->message(fibre->owner, fibre->in + used + PREFIX, size);
        if (fibre->fd < 0)
            return 0;
        used += PREFIX + size;
    }
    fibre->inUsed -= used;
    memmove(fibre->in, fibre->in + used, fibre->inUsed);
    return 0;
}

static void receive(simFibre *fibre)
{
    size_t room = SIM_MAX_MESSAGE + PREFIX - fibre->inUsed;
    ssize_t n = recv(fibre->fd, fibre->in + fibre->inUsed, room, MSG_DONTWAIT);

    if (n < 0 && (errno == EAGAIN || errno == EINTR))
        return;
    if (n <= 0) {
        dropLink(fibre);
        return;
    }
    fibre->inUsed += (size_t)n;
    if (handOn(fibre)) {
        simComplain(fibre->name, "fibre: this is no partner");
        dropLink(fibre);
    }
}

static void onLink(void *arg, int fd, short revents)
{
    simFibre *fibre = arg;
    int error = 0;
    socklen_t size = sizeof(error);

    if (fibre->connecting) {
        if (getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &size) || error)
            dropLink(fibre);
        else
            linkUp(fibre);
        return;
    }
    if (revents & POLLOUT && flush(fibre)) {
        dropLink(fibre);
        return;
    }
    if (revents & (POLLIN | POLLHUP | POLLERR))
        receive(fibre);
}

/* ---- making a link ---- */

static void tryConnect(void *arg)
{
    simFibre *fibre = arg;

    fibre->fd =
        socket(fibre->address.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fibre->fd < 0) {
        simTimerSet(fibre->loop, &fibre->retry, simNow() + RETRY, tryConnect, fibre);
        return;
    }
    fibre->connecting = 1;
    if (connect(fibre->fd, (struct sockaddr *)&fibre->address, fibre->addressSize) == 0)
        linkUp(fibre);
    else if (errno == EINPROGRESS)
        simLoopWatch(fibre->loop, fibre->fd, POLLOUT, onLink, fibre);
    else
        dropLink(fibre);
}

static void onListener(void *arg, int fd, short revents)
{
    simFibre *fibre = arg;
    int link = accept4(fd, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);

    (void)revents;
    if (link < 0)
        return;
    dropLink(fibre); /* a partner that comes again was away */
    fibre->fd = link;
    linkUp(fibre);
}

static int readAddress(simFibre *fibre, const char *where)
{
    struct sockaddr_un *un = (struct sockaddr_un *)&fibre->address;
    struct addrinfo hints;
    struct addrinfo *found = NULL;
    const char *colon = strrchr(where, ':');
    char host[256];

    if (strchr(where, '/')) {
        if (strlen(where) >= sizeof(un->sun_path))
            return -1;
        un->sun_family = AF_UNIX;
        strcpy(un->sun_path, where);
        fibre->addressSize = sizeof(*un);
        fibre->path = where;
        return 0;
    }
    if (!colon || colon == where || (size_t)(colon - where) >= sizeof(host))
        return -1;
    memcpy(host, where, (size_t)(colon - where));
    host[colon - where] = 0;
    memset(&hints, 0, sizeof(hints));
    hints.ai_family = AF_INET;
    hints.ai_socktype = SOCK_STREAM;
    if (getaddrinfo(host, colon + 1, &hints, &found) || !found)
        return -1;
    memcpy(&fibre->address, found->ai_addr, found->ai_addrlen);
    fibre->addressSize = found->ai_addrlen;
    freeaddrinfo(found);
    return 0;
}

static int startListening(simFibre *fibre)
{
    int on = 1;

    if (fibre->path)
        unlink(fibre->path);
    fibre->listener =
        socket(fibre->address.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fibre->listener < 0)
        return -1;
    setsockopt(fibre->listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
    if (bind(fibre->listener, (struct sockaddr *)&fibre->address, fibre->addressSize) ||
        listen(fibre->listener, 2))
        return -1;
    simLoopWatch(fibre->loop, fibre->listener, POLLIN, onListener, fibre);
    return 0;
}

int simFibreOpen(simFibre *fibre, const char *where, int listens)
{
    fibre->listener = fibre->fd = -1;
    fibre->in = callocMustSucceed(1, SIM_MAX_MESSAGE + PREFIX, "simFibreOpen");
    if (readAddress(fibre, where)) {
        simComplain(fibre->name,
                    "fibre = %s: allowed is host:port or the path of a socket", where);
        return -1;
    }
    if (!listens) {
        fibre->path = NULL;
        tryConnect(fibre);
        return 0;
    }
    if (startListening(fibre)) {
        simComplain(fibre->name, "fibre = %s: %s", where, strerror(errno));
        return -1;
    }
    return 0;
}

void simFibreClose(simFibre *fibre)
{
    if (!fibre->loop)
        return;
    simTimerStop(fibre->loop, &fibre->retry);
    if (fibre->fd >= 0) {
        simLoopForget(fibre->loop, fibre->fd);
        close(fibre->fd);
    }
    if (fibre->listener >= 0) {
        simLoopForget(fibre->loop, fibre->listener);
        close(fibre->listener);
        if (fibre->path)
            unlink(fibre->path);
    }
    fibre->fd = fibre->listener = -1;
    free(fibre->out);
    free(fibre->in);
    fibre->out = fibre->in = NULL;
}
