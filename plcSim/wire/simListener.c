/* simListener: a listening TCP socket that can be pulled, refused or switched off. It
 * hands new connections to its owner and knows nothing of what they say.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* accept4 */
#endif
#include <arpa/inet.h>
#include <errno.h>
#include <netdb.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "simListener.h"
#include "simLog.h"

#define BACKLOG 16

/* ---- addresses ---- */

static const char *addressText(const struct sockaddr_in *address, char *text, size_t size)
{
    char ip[INET_ADDRSTRLEN] = "?";

    inet_ntop(AF_INET, &address->sin_addr, ip, sizeof(ip));
    snprintf(text, size, "%s:%u", ip, (unsigned)ntohs(address->sin_port));
    return text;
}

const char *simListenerAddress(const simListener *listener)
{
    static char text[SIM_PEER_SIZE];

    return addressText(&listener->address, text, sizeof(text));
}

static int resolve(const char *name, unsigned port, struct sockaddr_in *address)
{
    struct addrinfo hints;
    struct addrinfo *found = NULL;

    memset(&hints, 0, sizeof(hints));
    hints.ai_family = AF_INET;
    hints.ai_socktype = SOCK_STREAM;
    if (getaddrinfo(name, NULL, &hints, &found) || !found)
        return -1;
    memcpy(address, found->ai_addr, sizeof(*address));
    address->sin_port = htons((unsigned short)port);
    freeaddrinfo(found);
    return 0;
}

/* ---- new connections ---- */

/* Our own connections, which filled the queue while unplugged, are no clients. */
static int isDecoy(simListener *listener, const struct sockaddr_in *peer)
{
    struct sockaddr_in own = {0};
    socklen_t length;
    int i;

    for (i = 0; i < SIM_DECOYS; i++) {
        length = sizeof(own);
        if (listener->decoys[i] >= 0 &&
            getsockname(listener->decoys[i], (struct sockaddr *)&own, &length) == 0 &&
            own.sin_port == peer->sin_port &&
            own.sin_addr.s_addr == peer->sin_addr.s_addr)
            return 1;
    }
    return 0;
}

static void acceptAll(simListener *listener)
{
    char text[SIM_PEER_SIZE];
    struct sockaddr_in peer = {0};
    socklen_t length = sizeof(peer);
    int on = 1;
    int fd;

    while ((fd = accept4(listener->fd, (struct sockaddr *)&peer, &length,
                         SOCK_CLOEXEC | SOCK_NONBLOCK)) >= 0) {
        length = sizeof(peer);
        if (isDecoy(listener, &peer)) {
            close(fd);
            continue;
        }
        setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
        listener->accepted(listener->owner, fd, addressText(&peer, text, sizeof(text)));
    }
}

static void onListener(void *arg, int fd, short revents)
{
    (void)fd;
    (void)revents;
    acceptAll(arg);
}

/* ---- listening ---- */

static int bindSocket(simListener *listener)
{
    socklen_t length = sizeof(listener->address);
    int on = 1;
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);

    if (fd < 0)
        return -1;
    setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
    if (listener->receiveBuffer)
        setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &listener->receiveBuffer, sizeof(int));
    if (bind(fd, (struct sockaddr *)&listener->address, sizeof(listener->address)) ||
        getsockname(fd, (struct sockaddr *)&listener->address, &length)) {
        close(fd);
        return -1;
    }
    return fd;
}

/* With a full accept queue the kernel drops a SYN without an answer, which is what a
 * pulled cable looks like from the other end. We fill the queue with connections of our
 * own. */
static void fillQueue(simListener *listener)
{
    int i;

    listen(listener->fd, 0);
    for (i = 0; i < SIM_DECOYS; i++) {
        listener->decoys[i] =
            socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
        if (listener->decoys[i] >= 0)
            connect(listener->decoys[i], (struct sockaddr *)&listener->address,
                    sizeof(listener->address));
    }
}

static void closeDecoys(simListener *listener)
{
    int i;

    for (i = 0; i < SIM_DECOYS; i++) {
        if (listener->decoys[i] >= 0)
            close(listener->decoys[i]);
        listener->decoys[i] = -1;
    }
}

static void closeSocket(simListener *listener)
{
    if (listener->fd >= 0) {
        simLoopForget(listener->loop, listener->fd);
        close(listener->fd);
    }
    listener->fd = -1;
    closeDecoys(listener);
}

/* Makes the listening socket anew, for the state of things: unplugged it answers nobody;
 * off or refusing it is bound but does not listen, so that connects get RST and the port
 * stays ours. */
static int listenAgain(simListener *listener)
{
    int wanted = !listener->down && !listener->refuse;

    closeSocket(listener);
    listener->fd = bindSocket(listener);
    if (listener->fd < 0 ||
        (wanted && !listener->unplugged && listen(listener->fd, BACKLOG))) {
        simComplain(listener->name, "cannot listen on %s: %s",
                    simListenerAddress(listener), strerror(errno));
        return -1;
    }
    if (listener->unplugged)
        fillQueue(listener);
    else if (wanted)
        simLoopWatch(listener->loop, listener->fd, POLLIN, onListener, listener);
    return 0;
}

int simListenerOpen(simListener *listener, simLoop *loop, const char *name,
                    const char *address, unsigned port, simAcceptFn accepted, void *owner)
{
    int i;

    listener->loop = loop;
    listener->name = name;
    listener->accepted = accepted;
    listener->owner = owner;
    listener->fd = -1;
    for (i = 0; i < SIM_DECOYS; i++)
        listener->decoys[i] = -1;
    if (resolve(address, port, &listener->address)) {
        simComplain(name, "cannot find the address \"%s\"", address);
        return -1;
    }
    return listenAgain(listener);
}

void simListenerClose(simListener *listener)
{
    if (listener->loop)
        closeSocket(listener);
}

/* ---- faults ---- */

void simListenerPower(simListener *listener, int on)
{
    listener->down = !on;
    listenAgain(listener);
}

void simListenerRefuse(simListener *listener, int on)
{
    listener->refuse = on;
    listenAgain(listener);
}

/* The listening socket stays, so that connects which were tried meanwhile come through.
 */
static void plugIn(simListener *listener)
{
    if (listener->down || listener->refuse || listen(listener->fd, BACKLOG)) {
        listenAgain(listener);
        return;
    }
    acceptAll(listener);
    closeDecoys(listener);
    simLoopWatch(listener->loop, listener->fd, POLLIN, onListener, listener);
}

void simListenerUnplug(simListener *listener, int on)
{
    if (listener->unplugged == on)
        return;
    listener->unplugged = on;
    if (on)
        listenAgain(listener);
    else
        plugIn(listener);
}
