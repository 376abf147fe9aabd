/* simClients: the clients of a server that answers requests: several connections, bytes
 * that come, answers that wait until the client takes them. It does not know a protocol.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cantProceed.h>

#include "simClients.h"

#define MAX_QUEUED 65536u /* bytes that a client may leave unread */
#define READ_ROUNDS 4     /* reads per call, so that a fast client leaves time */

/* Bytes on their way to a client. */
typedef struct chunk {
    ELLNODE node;
    double due; /* s, simNow() scale: not before */
    int last;   /* the connection ends behind it */
    size_t size, sent;
    epicsUInt8 bytes[];
} chunk;

static void update(simClient *client);
static void onClient(void *arg, int fd, short revents);

/* ---- connections ---- */

static simClient **slotOf(simClients *all, const simClient *client)
{
    int i;

    for (i = 0; i < SIM_MAX_CLIENTS; i++)
        if (all->list[i] == client)
            return &all->list[i];
    return NULL;
}

/* Reads away what is there, since close() with unread bytes sends RST instead of FIN. */
static void drain(int fd)
{
    char junk[4096];
    int rounds = 1000;

    while (rounds-- > 0 && recv(fd, junk, sizeof(junk), MSG_DONTWAIT) > 0)
        ;
}

void simClientDrop(simClient *client, int reset, const char *reason)
{
    struct linger linger = {1, 0};
    simClients *all = client->all;
    chunk *c;

    simTimerStop(all->loop, &client->timer);
    simLoopForget(all->loop, client->fd);
    if (reset) {
        setsockopt(client->fd, SOL_SOCKET, SO_LINGER, &linger, sizeof(linger));
    } else {
        shutdown(client->fd, SHUT_WR);
        drain(client->fd);
    }
    close(client->fd);
    while ((c = (chunk *)ellGet(&client->queue)))
        free(c);
    simLog(all->name, "%s: connection %u from %s ended: %s", all->title, client->number,
           client->peer, reason);
    *slotOf(all, client) = NULL;
    all->count--;
    if (all->gone)
        all->gone(client);
    free(client->inbox);
    free(client->own);
    free(client);
}

void simClientsDrop(simClients *all, int reset, const char *reason)
{
    int i;

    for (i = 0; i < SIM_MAX_CLIENTS; i++)
        if (all->list[i])
            simClientDrop(all->list[i], reset, reason);
}

static void takeClient(void *owner, int fd, const char *peer)
{
    simClients *all = owner;
    simClient **slot = slotOf(all, NULL);
    simClient *client;

    if (!slot) {
        all->sentAway++;
        simLog(all->name, "%s: connection from %s sent away: %d are open", all->title,
               peer, SIM_MAX_CLIENTS);
        close(fd);
        return;
    }
    client = *slot = callocMustSucceed(1, sizeof(*client), "simClients");
    client->inbox = callocMustSucceed(1, all->inboxSize, "simClients");
    client->own = callocMustSucceed(1, all->ownSize, "simClients");
    all->count++;
    all->connections++;
    client->all = all;
    client->number = ++all->serial;
    client->fd = fd;
    client->connectTime = simNow();
    snprintf(client->peer, sizeof(client->peer), "%s", peer);
    ellInit(&client->queue);
    simLog(all->name, "%s: connection %u from %s", all->title, client->number, peer);
    update(client);
}

/* ---- sending ---- */

void simClientSend(simClient *client, const epicsUInt8 *bytes, size_t size, double delay,
                   int last)
{
    chunk *c = mallocMustSucceed(sizeof(*c) + size, "simClients");

    memset(c, 0, sizeof(*c));
    c->due = delay > 0 ? simNow() + delay : 0;
    c->last = last;
    c->size = size;
    if (bytes)
        memcpy(c->bytes, bytes, size);
    else
        while (size > 0)
            c->bytes[--size] = (epicsUInt8)(rand() >> 7);
    ellAdd(&client->queue, &c->node);
    client->queued += c->size;
}

/* Sends of one chunk what the socket takes. Returns 1 when it is all out, 0 when not, -1
 * when the connection broke. */
static int sendChunk(simClient *client, chunk *c)
{
    ssize_t sent;

    while (c->sent < c->size) {
        sent = send(client->fd, c->bytes + c->sent, c->size - c->sent,
                    MSG_NOSIGNAL | MSG_DONTWAIT);
        if (sent < 0)
            return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR ? 0 : -1;
        c->sent += (size_t)sent;
    }
    return 1;
}

/* Sends what is due. Returns -1 when the client is gone. */
static int pump(simClient *client)
{
    chunk *c;

    while ((c = (chunk *)ellFirst(&client->queue)) && c->due <= simNow()) {
        int status = sendChunk(client, c);
        int last = c->last;

        if (status < 0) {
            simClientDrop(client, 1, strerror(errno));
            return -1;
        }
        if (status == 0)
            return 0;
        client->queued -= c->size;
        ellDelete(&client->queue, &c->node);
        free(c);
        if (last) {
            simClientDrop(client, 0, "closed by a fault");
            return -1;
        }
    }
    return 0;
}

static void onTimer(void *arg)
{
    update(arg);
}

/* Sends what may leave now, then asks the loop for what is still needed. The client may
 * be gone afterwards. */
static void update(simClient *client)
{
    simClients *all = client->all;
    short events = 0;
    chunk *c;

    simTimerStop(all->loop, &client->timer);
    if (!all->unplugged) {
        if (pump(client))
            return;
        c = (chunk *)ellFirst(&client->queue);
        if (!c && client->ended) {
            simClientDrop(client, 0, "closed by the client");
            return;
        }
        if (c && c->due > simNow())
            simTimerSet(all->loop, &client->timer, c->due, onTimer, client);
        else if (c)
            events |= POLLOUT;
        if (!client->ended && client->queued < MAX_QUEUED)
            events |= POLLIN;
    }
    simLoopWatch(all->loop, client->fd, events, onClient, client);
}

/* ---- receiving ---- */

/* Serves all complete requests in the inbox. Returns -1 when the client is gone. */
static int serveInbox(simClient *client)
{
    while (client->filled > 0) {
        long used = client->all->take(client);

        if (used == SIM_CLIENT_GONE)
            return -1;
        if (used == 0)
            return 0;
        client->filled -= (size_t)used;
        memmove(client->inbox, client->inbox + used, client->filled);
    }
    return 0;
}

/* One recv(). Returns 1 when there may be more, -1 when the client is gone. */
static int receiveSome(simClient *client)
{
    ssize_t n = recv(client->fd, client->inbox + client->filled,
                     client->all->inboxSize - client->filled, MSG_DONTWAIT);

    if (n > 0) {
        client->filled += (size_t)n;
        return serveInbox(client) ? -1 : client->queued < MAX_QUEUED;
    }
    if (n == 0) {
        client->ended = 1;
        return 0;
    }
    if (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)
        return 0;
    simClientDrop(client, 1, strerror(errno));
    return -1;
}

static void onClient(void *arg, int fd, short revents)
{
    simClient *client = arg;
    int rounds = READ_ROUNDS;
    int status = 1;
    int waits = client->all->unplugged || client->ended || client->queued >= MAX_QUEUED;

    (void)fd;
    /* Where nothing is read, only poll() can tell that the connection is gone. */
    if (waits && revents & (POLLHUP | POLLERR)) {
        simClientDrop(client, 1, "ended by the client");
        return;
    }
    while (!waits && rounds-- > 0 && status > 0)
        status = receiveSome(client);
    if (status >= 0)
        update(client);
}

/* ---- opening and closing ---- */

int simClientsOpen(simClients *all, simLoop *loop, const char *name, const char *title,
                   const char *address, unsigned port)
{
    all->loop = loop;
    all->name = name;
    all->title = title;
    return simListenerOpen(&all->listener, loop, name, address, port, takeClient, all);
}

void simClientsClose(simClients *all)
{
    simClientsDrop(all, 0, "the simulator ends");
    simListenerClose(&all->listener);
    all->loop = NULL;
}

const char *simClientsAddress(const simClients *all)
{
    return all->loop ? simListenerAddress(&all->listener) : NULL;
}

void simClientsPower(simClients *all, int on)
{
    if (!all->loop)
        return;
    if (!on)
        simClientsDrop(all, 1, "PLC off");
    simListenerPower(&all->listener, on);
}

void simClientsUnplug(simClients *all, int on)
{
    int i;

    if (!all->loop || all->unplugged == on)
        return;
    all->unplugged = on;
    simListenerUnplug(&all->listener, on);
    for (i = 0; i < SIM_MAX_CLIENTS; i++)
        if (all->list[i])
            update(all->list[i]);
}

void simClientsRefuse(simClients *all, int on)
{
    if (!all->loop || all->refuse == on)
        return;
    all->refuse = on;
    simListenerRefuse(&all->listener, on);
}

int simClientsFaults(const simClients *all, simText *out)
{
    simTextAdd(out, "%s%s", all->unplugged ? " unplugged" : "",
               all->refuse ? " refuse" : "");
    return all->unplugged + all->refuse;
}
