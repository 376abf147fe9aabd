/* A PLC for tests; see pairPeer.h. One thread, one poll; orders come through a pipe. */
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cantProceed.h>
#include <epicsEvent.h>
#include <epicsMutex.h>
#include <epicsThread.h>
#include <epicsTime.h>

#include "pairPeer.h"

#define WORDS 64 /* last first words of blocks that are remembered */

struct pairPeer {
    epicsUInt32 who;
    struct sockaddr_in address;
    size_t outSize;
    int pipe[2];
    epicsEventId done;
    epicsMutexId lock; /* guards from here ... */
    int stop, sends, pulled, closes, down;
    double period, slow; /* ms */
    int slip; /* bytes that the next block is too long, or (negative) too short */
    pairPeerSeen seen;
    epicsUInt32 words[WORDS];
    unsigned counts[WORDS], nextWord;
    /* ... to here */
    int listener, connection;
    epicsUInt64 nextSend, lastSend;
    size_t fill;
    unsigned char *block; /* from the IOC */
};

static int listenOn(pairPeer *p)
{
    int on = 1;

    p->listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (p->listener < 0)
        return -1;
    setsockopt(p->listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
    if (bind(p->listener, (struct sockaddr *)&p->address, sizeof(p->address)) ||
        listen(p->listener, 5)) {
        close(p->listener);
        p->listener = -1;
        return -1;
    }
    return 0;
}

static void hangUp(pairPeer *p)
{
    if (p->connection >= 0)
        close(p->connection);
    p->connection = -1;
    p->fill = 0;
    epicsMutexMustLock(p->lock);
    p->seen.connected = 0;
    epicsMutexUnlock(p->lock);
}

/* A new connection replaces the old one. */
static void takeConnection(pairPeer *p)
{
    int s, on = 1;

    while ((s = accept4(p->listener, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK)) >= 0) {
        hangUp(p);
        setsockopt(s, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
        p->connection = s;
        epicsMutexMustLock(p->lock);
        p->seen.connected = 1;
        p->seen.connects++;
        epicsMutexUnlock(p->lock);
    }
}

static void putWord(unsigned char *to, epicsUInt32 word)
{
    word = htonl(word);
    memcpy(to, &word, 4);
}

static void sendBlock(pairPeer *p, epicsUInt64 now)
{
    unsigned char block[2 * PEER_IN] = {0};
    size_t size;

    epicsMutexMustLock(p->lock);
    size = (size_t)(PEER_IN + p->slip);
    p->slip = 0;
    if (p->lastSend && now - p->lastSend > p->seen.longest)
        p->seen.longest = now - p->lastSend;
    p->lastSend = now;
    p->seen.sent++;
    putWord(block, p->who);
    putWord(block + 4, p->seen.sent);
    putWord(block + 8, p->seen.last);
    epicsMutexUnlock(p->lock);
    if (send(p->connection, block, size, MSG_NOSIGNAL) != (ssize_t)size)
        hangUp(p);
}

static void noteBlock(pairPeer *p)
{
    epicsUInt32 word;
    unsigned i;

    memcpy(&word, p->block, 4);
    word = ntohl(word);
    epicsMutexMustLock(p->lock);
    p->seen.lastCount =
        p->seen.received && word == p->seen.last ? p->seen.lastCount + 1 : 1;
    p->seen.last = word;
    p->seen.received++;
    for (i = 0; i < WORDS && p->words[i] != word; i++)
        ;
    if (i == WORDS) {
        i = p->nextWord++ % WORDS;
        p->words[i] = word;
        p->counts[i] = 0;
    }
    p->counts[i]++;
    epicsMutexUnlock(p->lock);
}

static void receive(pairPeer *p)
{
    ssize_t n;

    while ((n = recv(p->connection, p->block + p->fill, p->outSize - p->fill, 0)) > 0) {
        p->fill += n;
        if (p->fill < p->outSize)
            continue;
        p->fill = 0;
        noteBlock(p);
    }
    if (n == 0 || (errno != EAGAIN && errno != EINTR))
        hangUp(p);
}

/* Does what was ordered. Returns 0 when the thread is to end. */
static int obey(pairPeer *p, int *sends, int *pulled, double *period)
{
    int stop, closes, down;

    epicsMutexMustLock(p->lock);
    stop = p->stop;
    closes = p->closes;
    down = p->down;
    if (p->sends != *sends)
        p->lastSend = p->nextSend = 0;
    *sends = p->sends;
    *pulled = p->pulled;
    *period = p->period + (p->seen.sent % 4 == 0 ? p->slow : 0);
    p->closes = 0;
    epicsMutexUnlock(p->lock);
    if (down && p->listener >= 0) {
        close(p->listener);
        p->listener = -1;
    } else if (!down && p->listener < 0) {
        listenOn(p);
    }
    if (closes) {
        hangUp(p);
        epicsEventSignal(p->done);
    }
    return !stop;
}

static void peerThread(void *arg)
{
    pairPeer *p = arg;
    int sends = 0, pulled = 0;
    double period = 10;
    char orders[16];

    while (obey(p, &sends, &pulled, &period)) {
        struct pollfd fds[3] = {
            {p->pipe[0],                  POLLIN, 0},
            {pulled ? -1 : p->listener,   POLLIN, 0},
            {pulled ? -1 : p->connection, POLLIN, 0}
        };
        epicsUInt64 now = epicsMonotonicGet();
        struct timespec limit = {1, 0};

        if (sends && !pulled && p->connection >= 0) {
            if (now >= p->nextSend) {
                p->nextSend = now + (epicsUInt64)(period * 1e6);
                sendBlock(p, now);
            }
            limit.tv_sec = 0;
            limit.tv_nsec = (long)(p->nextSend - now);
        }
        if (limit.tv_nsec >= 1000000000)
            limit.tv_nsec = 999999999;
        if (ppoll(fds, 3, &limit, NULL) <= 0)
            continue;
        if (fds[0].revents)
            (void)!read(p->pipe[0], orders, sizeof(orders));
        if (fds[2].revents && p->connection >= 0)
            receive(p);
        if (fds[1].revents)
            takeConnection(p);
    }
    hangUp(p);
    if (p->listener >= 0)
        close(p->listener);
    epicsEventSignal(p->done);
}

pairPeer *pairPeerCreate(epicsUInt32 who, const char *address, int *port, size_t outSize)
{
    pairPeer *p = callocMustSucceed(1, sizeof(*p), "pairPeerCreate");
    socklen_t size = sizeof(p->address);

    p->who = who;
    p->outSize = outSize;
    p->address.sin_family = AF_INET;
    p->address.sin_port = htons((unsigned short)*port);
    inet_pton(AF_INET, address, &p->address.sin_addr);
    if (listenOn(p) || pipe2(p->pipe, O_CLOEXEC | O_NONBLOCK)) {
        free(p);
        return NULL;
    }
    getsockname(p->listener, (struct sockaddr *)&p->address, &size);
    *port = ntohs(p->address.sin_port);
    p->connection = -1;
    p->period = 10;
    p->block = callocMustSucceed(1, outSize, "pairPeerCreate");
    p->lock = epicsMutexMustCreate();
    p->done = epicsEventMustCreate(epicsEventEmpty);
    epicsThreadMustCreate("pairPeer", epicsThreadPriorityHigh,
                          epicsThreadGetStackSize(epicsThreadStackMedium), peerThread, p);
    return p;
}

static void order(pairPeer *p)
{
    epicsMutexUnlock(p->lock);
    (void)!write(p->pipe[1], "", 1);
}

void pairPeerDestroy(pairPeer *p)
{
    epicsMutexMustLock(p->lock);
    p->stop = 1;
    order(p);
    epicsEventMustWait(p->done);
    close(p->pipe[0]);
    close(p->pipe[1]);
    epicsEventDestroy(p->done);
    epicsMutexDestroy(p->lock);
    free(p->block);
    free(p);
}

void pairPeerPeriod(pairPeer *p, double ms)
{
    epicsMutexMustLock(p->lock);
    p->period = ms;
    order(p);
}

void pairPeerSlow(pairPeer *p, double ms)
{
    epicsMutexMustLock(p->lock);
    p->slow = ms;
    order(p);
}

void pairPeerSlip(pairPeer *p, int by)
{
    epicsMutexMustLock(p->lock);
    p->slip = by;
    order(p);
}

void pairPeerSend(pairPeer *p, int on)
{
    epicsMutexMustLock(p->lock);
    p->sends = on;
    order(p);
}

void pairPeerPull(pairPeer *p, int on)
{
    epicsMutexMustLock(p->lock);
    p->pulled = on;
    order(p);
}

void pairPeerClose(pairPeer *p, int down)
{
    epicsMutexMustLock(p->lock);
    p->closes = 1;
    p->down = down;
    order(p);
    epicsEventMustWait(p->done);
}

void pairPeerUp(pairPeer *p)
{
    epicsMutexMustLock(p->lock);
    p->down = 0;
    order(p);
}

void pairPeerLook(pairPeer *p, pairPeerSeen *seen)
{
    epicsMutexMustLock(p->lock);
    *seen = p->seen;
    epicsMutexUnlock(p->lock);
}

void pairPeerSeenReset(pairPeer *p)
{
    epicsMutexMustLock(p->lock);
    p->seen.longest = 0;
    epicsMutexUnlock(p->lock);
}

unsigned pairPeerCount(pairPeer *p, epicsUInt32 word)
{
    unsigned i, count = 0;

    epicsMutexMustLock(p->lock);
    for (i = 0; i < WORDS; i++)
        if (i < p->nextWord && p->words[i] == word)
            count = p->counts[i];
    epicsMutexUnlock(p->lock);
    return count;
}
