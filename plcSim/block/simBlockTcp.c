/* simBlockTcp: the TCP side of one PLC: listens, serves one client, sends and receives
 * blocks. It injects the faults of the wire. It does not know what is in a block.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <unistd.h>

#include <cantProceed.h>

#include "simBlockTcp.h"

#define MAX_QUEUED (4u * 1024 * 1024) /* bytes that `delay` may hold back */
#define FLOOD_BATCH 65536u            /* bytes made ready per round of a flood */
#define MAX_PARTS 64                  /* chunks that leave with one call */
#define READ_ROUNDS 64                /* reads per call, so that a flood leaves time */

/* Bytes on their way to the client. */
typedef struct chunk {
    ELLNODE node;
    double due; /* s, simNow() scale: not before */
    int isBlock;
    size_t size, sent;
    epicsUInt8 bytes[];
} chunk;

static void takeClient(void *owner, int fd, const char *peer);
static void onClient(void *arg, int fd, short revents);
static void update(simBlockTcp *server);

/* ---- opening and closing ---- */

const char *simBlockTcpAddress(const simBlockTcp *server)
{
    return simListenerAddress(&server->listener);
}

int simBlockTcpOpen(simBlockTcp *server, simLoop *loop, const char *name,
                    const char *address, unsigned port, size_t inSize, size_t outSize,
                    const simBlockTcpEvents *events, void *owner)
{
    server->loop = loop;
    server->name = name;
    server->events = events;
    server->owner = owner;
    server->inSize = inSize;
    server->outSize = outSize;
    server->client = -1;
    server->inbox = callocMustSucceed(1, outSize + 1, "simBlockTcpOpen");
    ellInit(&server->queue);
    server->faults.truncate = server->faults.cut = -1;
    server->listener.receiveBuffer = server->receiveBuffer;
    return simListenerOpen(&server->listener, loop, name, address, port, takeClient,
                           server);
}

static void dropQueue(simBlockTcp *server)
{
    chunk *c;

    while ((c = (chunk *)ellGet(&server->queue)))
        free(c);
    server->queued = 0;
}

void simBlockTcpClose(simBlockTcp *server)
{
    simTimerStop(server->loop, &server->timer);
    if (server->client >= 0) {
        simLoopForget(server->loop, server->client);
        close(server->client);
    }
    server->client = -1;
    simListenerClose(&server->listener);
    dropQueue(server);
    free(server->inbox);
    server->inbox = NULL;
}

/* ---- connection ---- */

int simBlockTcpConnected(const simBlockTcp *server)
{
    return server->client >= 0;
}

int simBlockTcpBusy(const simBlockTcp *server)
{
    return ellCount((ELLLIST *)&server->queue) > 0;
}

/* Reads away what is there, since close() with unread bytes sends RST instead of FIN. */
static void drain(int fd)
{
    char junk[4096];
    int rounds = 1000;

    while (rounds-- > 0 && recv(fd, junk, sizeof(junk), MSG_DONTWAIT) > 0)
        ;
}

void simBlockTcpDrop(simBlockTcp *server, int reset, const char *reason)
{
    struct linger linger = {1, 0};
    int fd = server->client;

    if (fd < 0)
        return;
    simLoopForget(server->loop, fd);
    server->client = -1;
    simTimerStop(server->loop, &server->timer);
    dropQueue(server);
    if (reset) {
        setsockopt(fd, SOL_SOCKET, SO_LINGER, &linger, sizeof(linger));
    } else {
        shutdown(fd, SHUT_WR);
        drain(fd);
    }
    close(fd);
    if (server->filled)
        simLog(server->name, "%lu bytes of a block were left over",
               (unsigned long)server->filled);
    server->filled = 0;
    simLog(server->name, "connection from %s ended: %s", server->peer, reason);
    server->events->disconnected(server->owner, reason);
}

/* A second client replaces the first, or is sent away. */
static void takeClient(void *owner, int fd, const char *peer)
{
    simBlockTcp *server = owner;

    if (server->client >= 0 && server->keepFirst) {
        simLog(server->name, "second connection sent away");
        close(fd);
        return;
    }
    simBlockTcpDrop(server, 0, "replaced by a new connection");
    snprintf(server->peer, sizeof(server->peer), "%s", peer);
    server->client = fd;
    server->filled = 0;
    server->nextPiece = 0;
    server->connectTime = simNow();
    server->counts.connections++;
    simLog(server->name, "connection from %s", server->peer);
    update(server);
    server->events->connected(server->owner);
}

/* ---- sending ---- */

static chunk *addChunk(simBlockTcp *server, size_t size)
{
    chunk *c = mallocMustSucceed(sizeof(*c) + size, "simBlockTcpSend");

    memset(c, 0, sizeof(*c));
    c->size = size;
    c->due = server->faults.delay > 0 ? simNow() + server->faults.delay : 0;
    ellAdd(&server->queue, &c->node);
    server->queued += size;
    return c;
}

static int maySend(const simBlockTcp *server)
{
    return server->client >= 0 && !server->faults.silence && !server->faults.unplugged;
}

static size_t blockSize(const simBlockTcp *server)
{
    return server->faults.truncate >= 0 ? (size_t)server->faults.truncate
                                        : server->inSize;
}

static int isFull(const simBlockTcp *server)
{
    if (server->faults.delay > 0)
        return server->queued + blockSize(server) > MAX_QUEUED;
    if (server->faults.flood)
        return server->queued >= FLOOD_BATCH;
    return simBlockTcpBusy(server);
}

int simBlockTcpReady(const simBlockTcp *server)
{
    return maySend(server) && !isFull(server);
}

int simBlockTcpSend(simBlockTcp *server, const epicsUInt8 *block)
{
    size_t size = blockSize(server);
    chunk *c;

    if (!maySend(server) || size == 0)
        return -1;
    if (isFull(server)) {
        server->counts.blocksSkipped++;
        return -1;
    }
    c = addChunk(server, size);
    c->isBlock = 1;
    memcpy(c->bytes, block, size < server->inSize ? size : server->inSize);
    if (size > server->inSize)
        memset(c->bytes + server->inSize, 0, size - server->inSize);
    update(server);
    return 0;
}

int simBlockTcpGarbage(simBlockTcp *server, size_t n)
{
    chunk *c;
    size_t i;

    if (server->client < 0 || server->queued + n > MAX_QUEUED)
        return -1;
    c = addChunk(server, n);
    for (i = 0; i < n; i++)
        c->bytes[i] = (epicsUInt8)(rand() >> 7);
    update(server);
    return 0;
}

/* When a chunk may go on: 0 = now. */
static double notBefore(const simBlockTcp *server, const chunk *c)
{
    double when = c->due;

    if (server->faults.fragment && server->nextPiece > when)
        when = server->nextPiece;
    return when;
}

/* Lists the bytes that may leave with one call: one piece, or all that is due. */
static size_t gather(simBlockTcp *server, struct iovec *parts, double now)
{
    chunk *c = (chunk *)ellFirst(&server->queue);
    size_t limit = server->faults.fragment;
    size_t count = 0;

    for (; c && count < MAX_PARTS && notBefore(server, c) <= now;
         c = (chunk *)ellNext(&c->node)) {
        parts[count].iov_base = c->bytes + c->sent;
        parts[count].iov_len = c->size - c->sent;
        if (limit && parts[count].iov_len > limit)
            parts[count].iov_len = limit;
        count++;
        if (limit)
            break;
    }
    return count;
}

/* Takes bytes that left from the queue. */
static void consume(simBlockTcp *server, size_t sent)
{
    chunk *c;

    server->counts.bytesSent += sent;
    while (sent && (c = (chunk *)ellFirst(&server->queue))) {
        size_t n = c->size - c->sent < sent ? c->size - c->sent : sent;

        c->sent += n;
        sent -= n;
        if (c->sent < c->size)
            return;
        server->counts.blocksSent += (epicsUInt64)c->isBlock;
        server->queued -= c->size;
        ellDelete(&server->queue, &c->node);
        free(c);
    }
}

/* Sends what may leave now. Returns -1 when the connection broke (and was dropped). */
static int pump(simBlockTcp *server)
{
    struct iovec parts[MAX_PARTS];
    struct msghdr message;
    ssize_t sent;
    double now;

    while (maySend(server)) {
        now = simNow();
        memset(&message, 0, sizeof(message));
        message.msg_iov = parts;
        message.msg_iovlen = gather(server, parts, now);
        if (!message.msg_iovlen)
            return 0;
        sent = sendmsg(server->client, &message, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (sent < 0) {
            if (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)
                return 0;
            simBlockTcpDrop(server, 1, strerror(errno));
            return -1;
        }
        consume(server, (size_t)sent);
        if (server->faults.fragment)
            server->nextPiece = now + server->faults.fragmentPause;
    }
    return 0;
}

void simBlockTcpForget(simBlockTcp *server)
{
    chunk *c = (chunk *)ellFirst(&server->queue);

    if (c && c->sent)
        simBlockTcpDrop(server, 1, "half a block was out");
    else
        dropQueue(server);
}

static void onTimer(void *arg)
{
    update(arg);
}

/* Sends what may leave now, then asks the loop for what is still needed. */
static void update(simBlockTcp *server)
{
    short events = 0;
    chunk *c;

    if (server->corked || pump(server) || server->client < 0)
        return;
    simTimerStop(server->loop, &server->timer);
    if (!server->faults.stall && !server->faults.unplugged)
        events |= POLLIN;
    if (maySend(server)) {
        c = (chunk *)ellFirst(&server->queue);
        if (c && notBefore(server, c) > simNow())
            simTimerSet(server->loop, &server->timer, notBefore(server, c), onTimer,
                        server);
        else if (c || server->faults.flood)
            events |= POLLOUT;
    }
    simLoopWatch(server->loop, server->client, events, onClient, server);
}

/* Asks for blocks until a batch is ready; they leave together. */
static void makeFlood(simBlockTcp *server)
{
    size_t before;

    server->corked = 1;
    while (server->queued < FLOOD_BATCH) {
        before = server->queued;
        server->events->wantBlock(server->owner);
        if (server->queued == before)
            break;
    }
    server->corked = 0;
}

/* ---- receiving ---- */

/* Copies received bytes into blocks; tells the owner of each complete one. */
static void sortBytes(simBlockTcp *server, const epicsUInt8 *bytes, size_t count)
{
    int client = server->client;

    server->counts.bytesReceived += count;
    server->receiveTime = simNow();
    while (count && server->outSize && server->client == client) {
        size_t n = server->outSize - server->filled;

        if (n > count)
            n = count;
        memcpy(server->inbox + server->filled, bytes, n);
        server->filled += n;
        bytes += n;
        count -= n;
        if (server->filled < server->outSize)
            return;
        server->filled = 0;
        server->counts.blocksReceived++;
        server->events->received(server->owner, server->inbox);
    }
}

/* One recv(). Returns 1 when there may be more. */
static int receiveSome(simBlockTcp *server)
{
    static epicsUInt8 buffer[65536];
    size_t room = sizeof(buffer);
    ssize_t n;

    if (server->faults.cut >= 0 && (size_t)server->faults.cut < room)
        room = (size_t)server->faults.cut;
    n = room ? recv(server->client, buffer, room, MSG_DONTWAIT) : 0;
    if (n > 0) {
        if (server->faults.cut >= 0)
            server->faults.cut -= (long)n;
        sortBytes(server, buffer, (size_t)n);
    }
    if (server->faults.cut == 0) {
        server->faults.cut = -1;
        simBlockTcpDrop(server, 1, "cut");
        return 0;
    }
    if (n == 0)
        simBlockTcpDrop(server, 0, "closed by the IOC");
    else if (n < 0 && errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR)
        simBlockTcpDrop(server, 1, strerror(errno));
    return n > 0;
}

static void onClient(void *arg, int fd, short revents)
{
    simBlockTcp *server = arg;
    int rounds = READ_ROUNDS;

    /* A pulled cable hides the end of the connection too; do not spin on it. */
    if ((server->faults.unplugged || server->faults.stall) && !(revents & POLLOUT)) {
        if (revents & (POLLHUP | POLLERR))
            simBlockTcpDrop(server, 1, "ended by the IOC");
        return;
    }
    if (revents & (POLLIN | POLLHUP | POLLERR))
        while (rounds-- > 0 && server->client == fd && receiveSome(server))
            ;
    if (server->client != fd)
        return;
    if (revents & POLLOUT && server->faults.flood && server->queued < FLOOD_BATCH)
        makeFlood(server);
    update(server);
}

/* ---- faults ---- */

void simBlockTcpPower(simBlockTcp *server, int on)
{
    if (!on)
        simBlockTcpDrop(server, 1, "PLC off");
    simListenerPower(&server->listener, on);
}

void simBlockTcpSilence(simBlockTcp *server, int on)
{
    server->faults.silence = on;
    update(server);
}

void simBlockTcpRefuse(simBlockTcp *server, int on)
{
    server->faults.refuse = on;
    simListenerRefuse(&server->listener, on);
}

void simBlockTcpStall(simBlockTcp *server, int on)
{
    server->faults.stall = on;
    update(server);
}

void simBlockTcpFlood(simBlockTcp *server, int on)
{
    server->faults.flood = on;
    update(server);
}

void simBlockTcpDelay(simBlockTcp *server, double seconds)
{
    server->faults.delay = seconds;
    update(server);
}

void simBlockTcpFragment(simBlockTcp *server, size_t bytes, double pause)
{
    server->faults.fragment = bytes;
    server->faults.fragmentPause = pause;
    server->nextPiece = 0;
    update(server);
}

void simBlockTcpUnplug(simBlockTcp *server, int on)
{
    if (server->faults.unplugged == on)
        return;
    server->faults.unplugged = on;
    simListenerUnplug(&server->listener, on);
    update(server);
}

void simBlockTcpClearFaults(simBlockTcp *server)
{
    int refused = server->faults.refuse;

    simBlockTcpUnplug(server, 0);
    memset(&server->faults, 0, sizeof(server->faults));
    server->faults.truncate = server->faults.cut = -1;
    if (refused)
        simListenerRefuse(&server->listener, 0);
    update(server);
}

void simBlockTcpFaultText(const simBlockTcp *server, simText *out)
{
    const simFaults *f = &server->faults;
    size_t before = out->length;

    if (f->unplugged)
        simTextAdd(out, " unplugged");
    if (f->silence)
        simTextAdd(out, " silence");
    if (f->refuse)
        simTextAdd(out, " refuse");
    if (f->stall)
        simTextAdd(out, " stall");
    if (f->flood)
        simTextAdd(out, " flood");
    if (f->fragment)
        simTextAdd(out, " fragment=%lu/%gms", (unsigned long)f->fragment,
                   f->fragmentPause * 1e3);
    if (f->delay > 0)
        simTextAdd(out, " delay=%gms", f->delay * 1e3);
    if (f->truncate >= 0)
        simTextAdd(out, " truncate=%ld", f->truncate);
    if (f->cut >= 0)
        simTextAdd(out, " cut=%ld", f->cut);
    if (out->length == before)
        simTextAdd(out, " none");
}
