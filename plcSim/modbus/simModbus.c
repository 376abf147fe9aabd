/* simModbus: serves Modbus/TCP beside the blocks, on the same PLC memory, to several
 * clients. It does not know what a register means, nor consoles.
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

#include "simModbus.h"

#define INBOX 4096        /* bytes read at a time */
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

struct simModbusClient {
    simModbus *modbus;
    unsigned number;
    int fd;
    char peer[SIM_PEER_SIZE];
    double connectTime;
    epicsUInt64 requests;
    epicsUInt8 inbox[INBOX];
    size_t filled;
    ELLLIST queue;
    size_t queued; /* bytes in it */
    simTimer timer;
    int mute;         /* half an answer left: nothing more will */
    int ended;        /* the client sends no more */
    int otherUnit;    /* of the last request that was for another unit, -1 = none */
    unsigned refusal; /* function and exception that were logged last */
};

static void update(simModbusClient *client);
static void onClient(void *arg, int fd, short revents);

/* ---- connections ---- */

static simModbusClient **slotOf(simModbus *modbus, const simModbusClient *client)
{
    int i;

    for (i = 0; i < SIM_MODBUS_CLIENTS; i++)
        if (modbus->clients[i] == client)
            return &modbus->clients[i];
    return NULL;
}

/* Reads away what is there, since close() with unread bytes sends RST instead of FIN. */
static void drain(int fd)
{
    char junk[INBOX];
    int rounds = 1000;

    while (rounds-- > 0 && recv(fd, junk, sizeof(junk), MSG_DONTWAIT) > 0)
        ;
}

/* Ends a connection; the client is gone afterwards. */
static void dropClient(simModbusClient *client, int reset, const char *reason)
{
    struct linger linger = {1, 0};
    simModbus *modbus = client->modbus;
    chunk *c;

    simTimerStop(modbus->loop, &client->timer);
    simLoopForget(modbus->loop, client->fd);
    if (reset) {
        setsockopt(client->fd, SOL_SOCKET, SO_LINGER, &linger, sizeof(linger));
    } else {
        shutdown(client->fd, SHUT_WR);
        drain(client->fd);
    }
    close(client->fd);
    while ((c = (chunk *)ellGet(&client->queue)))
        free(c);
    simLog(modbus->name, "Modbus: connection %u from %s ended: %s", client->number,
           client->peer, reason);
    *slotOf(modbus, client) = NULL;
    modbus->clientCount--;
    free(client);
}

int simModbusDrop(simModbus *modbus, int reset, const char *reason)
{
    int count = 0;
    int i;

    for (i = 0; i < SIM_MODBUS_CLIENTS; i++) {
        if (!modbus->clients[i])
            continue;
        dropClient(modbus->clients[i], reset, reason);
        count++;
    }
    return count;
}

static void takeClient(void *owner, int fd, const char *peer)
{
    simModbus *modbus = owner;
    simModbusClient **slot = slotOf(modbus, NULL);
    simModbusClient *client;

    if (!slot) {
        modbus->counts.sentAway++;
        simLog(modbus->name, "Modbus: connection from %s sent away: %d are open", peer,
               SIM_MODBUS_CLIENTS);
        close(fd);
        return;
    }
    client = *slot = callocMustSucceed(1, sizeof(*client), "simModbus");
    modbus->clientCount++;
    modbus->counts.connections++;
    client->modbus = modbus;
    client->number = ++modbus->serial;
    client->fd = fd;
    client->otherUnit = -1;
    client->connectTime = simNow();
    snprintf(client->peer, sizeof(client->peer), "%s", peer);
    ellInit(&client->queue);
    simLog(modbus->name, "Modbus: connection %u from %s", client->number, peer);
    update(client);
}

/* ---- sending ---- */

static void queueBytes(simModbusClient *client, const epicsUInt8 *bytes, size_t size,
                       double delay, int last)
{
    chunk *c = mallocMustSucceed(sizeof(*c) + size, "simModbus");

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
static int sendChunk(simModbusClient *client, chunk *c)
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
static int pump(simModbusClient *client)
{
    chunk *c;

    while ((c = (chunk *)ellFirst(&client->queue)) && c->due <= simNow()) {
        int status = sendChunk(client, c);
        int last = c->last;

        if (status < 0) {
            dropClient(client, 1, strerror(errno));
            return -1;
        }
        if (status == 0)
            return 0;
        client->queued -= c->size;
        ellDelete(&client->queue, &c->node);
        free(c);
        if (last) {
            dropClient(client, 0, "closed by a fault");
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
static void update(simModbusClient *client)
{
    simModbus *modbus = client->modbus;
    short events = 0;
    chunk *c;

    simTimerStop(modbus->loop, &client->timer);
    if (!modbus->faults.unplugged) {
        if (pump(client))
            return;
        c = (chunk *)ellFirst(&client->queue);
        if (!c && client->ended) {
            dropClient(client, 0, "closed by the client");
            return;
        }
        if (c && c->due > simNow())
            simTimerSet(modbus->loop, &client->timer, c->due, onTimer, client);
        else if (c)
            events |= POLLOUT;
        if (!client->ended && client->queued < MAX_QUEUED)
            events |= POLLIN;
    }
    simLoopWatch(modbus->loop, client->fd, events, onClient, client);
}

/* ---- requests ---- */

static void remember(simModbusClient *client, const simRequest *request, int result)
{
    simModbus *modbus = client->modbus;
    simModbusRecord *record =
        &modbus->history[modbus->counts.requests % SIM_MODBUS_HISTORY];

    modbus->counts.requests++;
    modbus->counts.function[request->function]++;
    client->requests++;
    record->time = simNow();
    record->client = client->number;
    record->result = result;
    record->size = request->size;
    memcpy(record->bytes, request->bytes, request->size);
}

static void countSpan(unsigned largest[2], const simSpan *span)
{
    unsigned *max = &largest[span->table == simCoils || span->table == simDiscrete];

    if (span->count > *max)
        *max = span->count;
}

static void countException(simModbusClient *client, const simRequest *request, int code)
{
    simModbusCounts *counts = &client->modbus->counts;
    unsigned refusal = request->function << 8 | (unsigned)code;

    counts->refused[request->function]++;
    counts->exception[code]++;
    if (client->refusal != refusal)
        simLog(client->modbus->name,
               "Modbus: connection %u: function %u is answered with exception %d",
               client->number, request->function, code);
    client->refusal = refusal;
}

/* The answer leaves, as the faults have it. */
static void sendAnswer(simModbusClient *client, epicsUInt8 *answer, size_t size,
                       const simModbusFate *fate)
{
    int last = 0;

    client->modbus->counts.answers++;
    if (fate->wrongId)
        answer[1] ^= 1;
    if (fate->wrongUnit)
        answer[6] ^= 1;
    if (fate->half || (fate->shorten >= 0 && (size_t)fate->shorten < size)) {
        size = fate->half ? size / 2 : (size_t)fate->shorten;
        last = fate->half || fate->close;
        client->mute = 1;
    }
    if (fate->garbage >= 0)
        queueBytes(client, NULL, (size_t)fate->garbage, fate->delay, last);
    else
        queueBytes(client, answer, size, fate->delay, last);
}

/* A complete request for our unit. */
static void serve(simModbusClient *client, simRequest *request, int code)
{
    simModbus *modbus = client->modbus;
    epicsUInt8 answer[SIM_MODBUS_ADU];
    simModbusFate fate;
    size_t size;

    countSpan(modbus->counts.maxRead, &request->read);
    countSpan(modbus->counts.maxWrite, &request->write);
    simModbusFaultsMeet(&modbus->faults, request, &fate);
    if (client->mute || fate.silent || request->function >= 128) {
        modbus->counts.silent++;
        remember(client, request, -1);
        return;
    }
    if (fate.exception)
        code = fate.exception;
    else if (!code)
        code = simRequestCheck(request, &modbus->map);
    remember(client, request, code);
    if (code) {
        countException(client, request, code);
        size = simAnswerException(&modbus->answerer, request, code, answer);
    } else {
        size = simAnswer(&modbus->answerer, request, answer);
    }
    sendAnswer(client, answer, size, &fate);
}

/* A gateway has no such unit behind it: it says nothing, or exception 11. */
static void serveOther(simModbusClient *client, simRequest *request)
{
    static const simModbusFate none = {.shorten = -1, .garbage = -1};
    simModbus *modbus = client->modbus;
    epicsUInt8 answer[SIM_MODBUS_ADU];
    int code = modbus->gateway && !client->mute && request->function < 128 ? 11 : -1;

    if (client->otherUnit != (int)request->unit)
        simLog(modbus->name, "Modbus: connection %u: unit %u is not here, %d is: %s",
               client->number, request->unit, modbus->unit,
               code < 0 ? "no answer" : "exception 11");
    client->otherUnit = (int)request->unit;
    modbus->counts.otherUnit++;
    remember(client, request, code);
    if (code < 0)
        return;
    countException(client, request, code);
    sendAnswer(client, answer,
               simAnswerException(&modbus->answerer, request, code, answer), &none);
}

/* Serves all complete requests in the inbox. Returns -1 when the client is gone. */
static int serveInbox(simModbusClient *client)
{
    simModbus *modbus = client->modbus;
    size_t done = 0, size;
    simRequest request;
    int code;

    while (done < client->filled) {
        const epicsUInt8 *frame = client->inbox + done;

        size = simFrameSize(frame, client->filled - done);
        if (size == 0) {
            modbus->counts.garbage++;
            dropClient(client, 0, "this is no Modbus/TCP");
            return -1;
        }
        if (size > client->filled - done)
            break;
        code = simRequestParse(&request, frame, size);
        if (modbus->unit >= 0 && request.unit != (unsigned)modbus->unit)
            serveOther(client, &request);
        else
            serve(client, &request, code);
        done += size;
    }
    client->filled -= done;
    memmove(client->inbox, client->inbox + done, client->filled);
    return 0;
}

/* One recv(). Returns 1 when there may be more, -1 when the client is gone. */
static int receiveSome(simModbusClient *client)
{
    ssize_t n = recv(client->fd, client->inbox + client->filled, INBOX - client->filled,
                     MSG_DONTWAIT);

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
    dropClient(client, 1, strerror(errno));
    return -1;
}

static void onClient(void *arg, int fd, short revents)
{
    simModbusClient *client = arg;
    int rounds = READ_ROUNDS;
    int status = 1;
    int waits =
        client->modbus->faults.unplugged || client->ended || client->queued >= MAX_QUEUED;

    (void)fd;
    /* Where nothing is read, only poll() can tell that the connection is gone. */
    if (waits && revents & (POLLHUP | POLLERR)) {
        dropClient(client, 1, "ended by the client");
        return;
    }
    while (!waits && rounds-- > 0 && status > 0)
        status = receiveSome(client);
    if (status >= 0)
        update(client);
}

/* ---- opening and closing ---- */

int simModbusOpen(simModbus *modbus, simLoop *loop, const char *name, const char *address,
                  unsigned port)
{
    modbus->loop = loop;
    modbus->name = name;
    modbus->history =
        callocMustSucceed(SIM_MODBUS_HISTORY, sizeof(simModbusRecord), "simModbusOpen");
    if (simAnswererOpen(&modbus->answerer, &modbus->map, name))
        return -1;
    return simListenerOpen(&modbus->listener, loop, name, address, port, takeClient,
                           modbus);
}

void simModbusClose(simModbus *modbus)
{
    if (!modbus->loop)
        return;
    simModbusDrop(modbus, 0, "the simulator ends");
    simListenerClose(&modbus->listener);
    simAnswererClose(&modbus->answerer);
    free(modbus->history);
    modbus->history = NULL;
    modbus->loop = NULL;
}

const char *simModbusAddress(const simModbus *modbus)
{
    return simListenerAddress(&modbus->listener);
}

void simModbusPower(simModbus *modbus, int on)
{
    if (!modbus->loop)
        return;
    if (!on)
        simModbusDrop(modbus, 1, "PLC off");
    simListenerPower(&modbus->listener, on);
}

void simModbusUnplug(simModbus *modbus, int on)
{
    int i;

    if (!modbus->loop || modbus->faults.unplugged == on)
        return;
    modbus->faults.unplugged = on;
    simListenerUnplug(&modbus->listener, on);
    for (i = 0; i < SIM_MODBUS_CLIENTS; i++)
        if (modbus->clients[i])
            update(modbus->clients[i]);
}

void simModbusRefuse(simModbus *modbus, int on)
{
    if (!modbus->loop || modbus->faults.refuse == on)
        return;
    modbus->faults.refuse = on;
    simListenerRefuse(&modbus->listener, on);
}

/* ---- looking ---- */

void simModbusClearCounts(simModbus *modbus)
{
    memset(&modbus->counts, 0, sizeof(modbus->counts));
}

static void countsText(const simModbusCounts *n, simText *out)
{
    int i;

    simTextAdd(out,
               "modbus requests: total=%llu answered=%llu silent=%llu "
               "other_unit=%llu garbage=%llu",
               (unsigned long long)n->requests, (unsigned long long)n->answers,
               (unsigned long long)n->silent, (unsigned long long)n->otherUnit,
               (unsigned long long)n->garbage);
    for (i = 0; i < 256; i++)
        if (n->function[i])
            simTextAdd(out, " fc%d=%llu", i, (unsigned long long)n->function[i]);
    simTextAdd(out, "\nmodbus exceptions:");
    for (i = 1; i < 12; i++)
        simTextAdd(out, " ex%d=%llu", i, (unsigned long long)n->exception[i]);
    for (i = 0; i < 256; i++)
        if (n->refused[i])
            simTextAdd(out, " fc%d=%llu", i, (unsigned long long)n->refused[i]);
    simTextAdd(out,
               "\nmodbus largest: read_registers=%u read_bits=%u write_registers=%u "
               "write_bits=%u\n",
               n->maxRead[0], n->maxRead[1], n->maxWrite[0], n->maxWrite[1]);
}

void simModbusStatus(const simModbus *modbus, simText *out)
{
    double now = simNow();
    int i;

    if (!modbus->loop)
        return;
    simTextAdd(out, "modbus: address=%s", simModbusAddress(modbus));
    if (modbus->unit >= 0)
        simTextAdd(out, " unit=%d", modbus->unit);
    else
        simTextAdd(out, " unit=any");
    simTextAdd(out, " clients=%d connections=%llu sent_away=%llu\n", modbus->clientCount,
               (unsigned long long)modbus->counts.connections,
               (unsigned long long)modbus->counts.sentAway);
    simTextAdd(out, "modbus areas:");
    simMapText(&modbus->map, out);
    simTextAdd(out, "\n");
    for (i = 0; i < SIM_MODBUS_CLIENTS; i++) {
        const simModbusClient *c = modbus->clients[i];

        if (c)
            simTextAdd(out,
                       "modbus client: number=%u peer=%s seconds=%.3f requests=%llu "
                       "unsent=%lu\n",
                       c->number, c->peer, now - c->connectTime,
                       (unsigned long long)c->requests, (unsigned long)c->queued);
    }
    countsText(&modbus->counts, out);
    simTextAdd(out, "modbus faults:");
    simModbusFaultsText(&modbus->faults, out);
    simTextAdd(out, "\n");
}

static void spanText(const char *what, const simSpan *span, simText *out)
{
    if (span->table != simNoTable)
        simTextAdd(out, " %s=%s,%u,%u", what, simTableName(span->table), span->start,
                   span->count);
}

void simModbusReceived(const simModbus *modbus, unsigned long n, simText *out)
{
    epicsUInt64 count = modbus->counts.requests;
    epicsUInt64 i;

    if (n > SIM_MODBUS_HISTORY)
        n = SIM_MODBUS_HISTORY;
    for (i = n < count ? count - n : 0; i < count; i++) {
        const simModbusRecord *record = &modbus->history[i % SIM_MODBUS_HISTORY];
        simRequest request;

        simRequestParse(&request, record->bytes, record->size);
        simTextAdd(out, "%llu time=%.6f client=%u unit=%u fc=%u",
                   (unsigned long long)i + 1, record->time, record->client, request.unit,
                   request.function);
        spanText("read", &request.read, out);
        spanText("write", &request.write, out);
        simTextAdd(out,
                   record->result < 0 ? " answer=none"
                   : record->result   ? " answer=exception%d"
                                      : " answer=ok",
                   record->result);
        simTextAdd(out, " pdu=");
        simTextHex(out, record->bytes + SIM_MBAP, record->size - SIM_MBAP);
        simTextAdd(out, "\n");
    }
}
