/* simEip: serves EtherNet/IP to several clients: sessions, requests with and without a
 * connection, what goes wrong on purpose, and a history of requests. It does not know
 * what a request means, nor consoles.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>

#include "simEip.h"
#include "simEipFrame.h"

#define INBOX (SIM_EIP_HEADER + 65536)
#define UNCONNECTED_REQUEST                                                              \
    (SIM_EIP_UNCONNECTED + 40) /* with Unconnected_Send around                           \
                                */
#define MAX_SUBJECTS 512

static simEipClient *ownOf(const simClient *client)
{
    return client->own;
}

static simEip *eipOf(const simClient *client)
{
    return client->all->server;
}

static void replace(epicsUInt8 **to, size_t *size, const epicsUInt8 *bytes, size_t count)
{
    free(*to);
    *to = mallocMustSucceed(count + 1, "simEip");
    memcpy(*to, bytes, count);
    *size = count;
}

/* ---- history ---- */

static void countRate(simEip *eip, double now)
{
    double second = floor(now);

    if (second != eip->second) {
        eip->lastSecond = second == eip->second + 1 ? eip->inSecond : 0;
        eip->inSecond = 0;
        eip->second = second;
    }
    eip->inSecond++;
}

static simEipRecord *remember(simClient *client, const simEipFrame *frame,
                              const simEipItems *items)
{
    simEip *eip = eipOf(client);
    simEipRecord *record = &eip->history[eip->historyCount++ % SIM_EIP_HISTORY];

    free(record->request);
    free(record->answer);
    memset(record, 0, sizeof(*record));
    record->time = simNow();
    record->client = client->number;
    record->connected = frame->command == EIP_UNIT_DATA;
    record->sequence = items->sequence;
    if (items->message)
        replace(&record->request, &record->requestSize, items->message, items->size);
    eip->counts.requests++;
    eip->counts.connected += (epicsUInt64)record->connected;
    ownOf(client)->requests++;
    countRate(eip, record->time);
    if (items->size > eip->counts.largestRequest)
        eip->counts.largestRequest = items->size;
    return record;
}

/* ---- faults ---- */

typedef struct subjects {
    const simEipController *controller;
    int connected;
    simEipSubject list[MAX_SUBJECTS];
    simText texts[MAX_SUBJECTS];
    size_t count;
} subjects;

static void addSubject(void *arg, const simEipRequest *request, const simEipPath *path)
{
    subjects *all = arg;
    simEipSubject *s;
    simText *text;

    if (all->count == MAX_SUBJECTS)
        return;
    s = &all->list[all->count];
    text = &all->texts[all->count++];
    text->text = NULL;
    text->length = text->room = 0;
    simEipControllerPathText(all->controller, path, text);
    s->service = request->service;
    s->connected = all->connected;
    s->path = text->text ? text->text : "";
}

static void meetFaults(simEip *eip, int connected, const simEipItems *items,
                       simEipFate *fate)
{
    static subjects all;
    size_t i;

    all.controller = &eip->controller;
    all.connected = connected;
    all.count = 0;
    if (eip->controller.faults.count)
        simEipWalk(items->message, items->size, addSubject, &all);
    simEipFaultsMeet(&eip->controller.faults, all.list, all.count, fate);
    for (i = 0; i < all.count; i++)
        simTextFree(&all.texts[i]);
}

/* ---- answers ---- */

static void sendBytes(simClient *client, const epicsUInt8 *bytes, size_t size,
                      double delay, int last)
{
    eipOf(client)->counts.bytesOut += size;
    simClientSend(client, bytes, size, delay, last);
}

/* An answer leaves, and behind it one that a fault held back. */
static void sendFrame(simClient *client, const epicsUInt8 *bytes, size_t size,
                      double delay)
{
    simEipClient *own = ownOf(client);

    sendBytes(client, bytes, size, delay, 0);
    if (own->held)
        sendBytes(client, own->held, own->heldSize, delay, 0);
    free(own->held);
    own->held = NULL;
}

/* The data of the answer before, in the frame of this one. Returns the frame's size. */
static size_t putOld(simClient *client, epicsUInt8 *out, size_t at, size_t size)
{
    simEipClient *own = ownOf(client);
    size_t old = own->last ? own->lastSize : size - at;

    if (own->last)
        memcpy(out + at, own->last, old);
    simEipPut(out + 2, 2, at + old - SIM_EIP_HEADER);
    simEipPut(out + (at == SIM_EIP_UNIT_MESSAGE ? 42 : 38), 2,
              old + (at == SIM_EIP_UNIT_MESSAGE ? 2 : 0));
    return at + old;
}

/* Spoils what the fate says within the frame. Returns its size. */
static size_t spoil(simClient *client, epicsUInt8 *out, size_t at, size_t size,
                    const simEipFate *fate)
{
    epicsUInt8 *message = out + at;

    if (fate->old)
        size = putOld(client, out, at, size);
    if (fate->context)
        out[12] ^= 1;
    if (fate->session)
        out[4] ^= 1;
    if (fate->sequence && at == SIM_EIP_UNIT_MESSAGE)
        out[44] ^= 1;
    if (fate->id && at == SIM_EIP_UNIT_MESSAGE)
        out[36] ^= 1;
    if (fate->service)
        message[0] ^= 1;
    if (fate->length)
        simEipPut(out + 2, 2, size - SIM_EIP_HEADER + (size_t)fate->length);
    return size;
}

/* The answer leaves, as its fate has it. */
static void deliver(simClient *client, epicsUInt8 *out, size_t at, size_t size,
                    const simEipFate *fate)
{
    simEipClient *own = ownOf(client);
    size_t message = size - at;
    epicsUInt8 kept[SIM_EIP_FRAME];

    if (own->mute)
        return;
    eipOf(client)->counts.answers++;
    memcpy(kept, out + at, message);
    size = spoil(client, out, at, size, fate);
    replace(&own->last, &own->lastSize, kept, message);
    if (fate->half || (fate->shorten >= 0 && (size_t)fate->shorten < size)) {
        size = fate->half ? size / 2 : (size_t)fate->shorten;
        own->mute = 1;
        sendBytes(client, out, size, fate->delay, fate->half || fate->close);
    } else if (fate->garbage >= 0) {
        sendBytes(client, NULL, (size_t)fate->garbage, fate->delay, 0);
    } else if (fate->swap && !own->held) {
        replace(&own->held, &own->heldSize, out, size);
    } else {
        sendFrame(client, out, size, fate->delay);
    }
}

/* A header alone, with a status. */
static void answerError(simClient *client, const simEipFrame *frame, int status)
{
    epicsUInt8 out[SIM_EIP_HEADER];

    if (ownOf(client)->mute)
        return;
    eipOf(client)->counts.errors++;
    simEipFrameHeader(out, frame, frame->session, (unsigned)status, 0);
    sendBytes(client, out, sizeof(out), 0, 0);
}

static void answerData(simClient *client, const simEipFrame *frame, epicsUInt32 session,
                       epicsUInt8 *out, size_t size)
{
    if (ownOf(client)->mute)
        return;
    simEipFrameHeader(out, frame, session, ENCAP_OK, size);
    sendBytes(client, out, SIM_EIP_HEADER + size, 0, 0);
}

/* ---- commands without a session ---- */

static void listServices(simClient *client, const simEipFrame *frame)
{
    static const char name[16] = "Communications";
    epicsUInt8 out[SIM_EIP_HEADER + 26];
    epicsUInt8 *p = out + SIM_EIP_HEADER;

    simEipPut(p, 2, 1);          /* items */
    simEipPut(p + 2, 2, 0x0100); /* services */
    simEipPut(p + 4, 2, 20);
    simEipPut(p + 6, 2, 1);      /* version */
    simEipPut(p + 8, 2, 0x0120); /* CIP over TCP, class 0 and 1 over UDP */
    memcpy(p + 10, name, sizeof(name));
    answerData(client, frame, frame->session, out, 26);
}

static void listIdentity(simClient *client, const simEipFrame *frame)
{
    const simEipController *c = &eipOf(client)->controller;
    epicsUInt8 out[SIM_EIP_HEADER + 200];
    epicsUInt8 *p = out + SIM_EIP_HEADER;
    simEipAnswer identity;
    size_t size;

    memset(p, 0, 24);
    identity.status = 0;
    identity.size = 0;
    identity.room = 150;
    simEipIdentityBytes(c, 1, &identity);
    size = 18 + identity.size + 1;
    simEipPut(p, 2, 1); /* items */
    simEipPut(p + 2, 2, 0x000C);
    simEipPut(p + 4, 2, size);
    simEipPut(p + 6, 2, 1); /* version; then a socket address, big-endian */
    p[9] = 2;
    p[10] = (epicsUInt8)(c->port >> 8);
    p[11] = (epicsUInt8)c->port;
    memcpy(p + 12, c->address, 4);
    memcpy(p + 24, identity.data, identity.size);
    p[24 + identity.size] = 3; /* state: operational */
    answerData(client, frame, frame->session, out, 6 + size);
}

static void registerSession(simClient *client, const simEipFrame *frame)
{
    simEipClient *own = ownOf(client);
    epicsUInt8 out[SIM_EIP_HEADER + 4];
    int status = ENCAP_OK;

    if (frame->size != 4)
        status = ENCAP_BAD_LENGTH;
    else if (simEipGet(frame->data, 2) != 1 || simEipGet(frame->data + 2, 2) != 0)
        status = ENCAP_BAD_VERSION;
    else if (own->session)
        status = ENCAP_BAD_COMMAND; /* one session for a TCP connection */
    if (status) {
        answerError(client, frame, status);
        return;
    }
    own->session = 0x10000u + client->number * 0x101u;
    memcpy(out + SIM_EIP_HEADER, frame->data, 4);
    answerData(client, frame, own->session, out, 4);
}

/* ---- messages ---- */

static void noteAnswer(simEip *eip, simEipRecord *record, const epicsUInt8 *message,
                       size_t size)
{
    replace(&record->answer, &record->answerSize, message, size);
    if (size > eip->counts.largestAnswer)
        eip->counts.largestAnswer = size;
}

/* The connection that a request came by, NULL after an answer (or none, as configured).
 */
static simEipConnection *connectionOf(simClient *client, const simEipFrame *frame,
                                      const simEipItems *items, simEipRecord *record)
{
    simEip *eip = eipOf(client);
    simEipConnection *connection =
        simEipConnectionFind(&eip->controller.connections, items->id);

    if (connection && connection->client == client->number) {
        if (items->size + 2 <= connection->requestSize)
            return connection;
        record->error = ENCAP_BAD_LENGTH;
    } else {
        eip->controller.connections.lost++;
        if (eip->lostSilent) {
            eip->counts.ignored++;
            return NULL;
        }
        record->error = ENCAP_BAD_COMMAND;
    }
    answerError(client, frame, (int)record->error);
    return NULL;
}

/* Serves, or finds the answer that this sequence count got before. */
static size_t serveConnected(simClient *client, simEipConnection *connection,
                             const simEipItems *items, epicsUInt8 *out)
{
    simEip *eip = eipOf(client);
    simEipOrigin origin = {.client = client->number, .now = simNow(), .connected = 1};
    size_t limit = connection->answerSize - 2;
    size_t size;

    connection->heard = origin.now;
    connection->requests++;
    if (connection->hasSequence && connection->sequence == items->sequence) {
        connection->duplicates++;
        eip->controller.connections.duplicates++;
        memcpy(out, connection->answer, connection->answerLength);
        return connection->answerLength;
    }
    if (limit > SIM_EIP_ANSWER)
        limit = SIM_EIP_ANSWER;
    size =
        simEipServe(&eip->controller, &origin, items->message, items->size, out, limit);
    connection->hasSequence = 1;
    connection->sequence = items->sequence;
    replace(&connection->answer, &connection->answerLength, out, size);
    return size;
}

static size_t serveUnconnected(simClient *client, const simEipItems *items,
                               epicsUInt8 *out)
{
    simEipOrigin origin = {.client = client->number, .now = simNow()};

    if (items->size <= UNCONNECTED_REQUEST)
        return simEipServe(&eipOf(client)->controller, &origin, items->message,
                           items->size, out, SIM_EIP_UNCONNECTED);
    out[0] = items->message[0] | 0x80;
    out[1] = out[3] = 0;
    out[2] = EIP_NO_RESOURCE;
    return 4;
}

/* Connections that were silent for too long end before anything is served. */
static void expire(simEip *eip)
{
    simEipConnections *all = &eip->controller.connections;
    epicsUInt64 before = all->timedOut;

    simEipConnectionsExpire(all, simNow());
    if (all->timedOut != before)
        simLog(eip->name, "EtherNet/IP: %u CIP connection(s) timed out",
               (unsigned)(all->timedOut - before));
}

/* A message without a connection may open or close one: that is said. */
static size_t serveAndTell(simClient *client, const simEipItems *items, epicsUInt8 *out)
{
    simEipConnections *all = &eipOf(client)->controller.connections;
    epicsUInt64 opened = all->opened, refused = all->refused, closed = all->closed;
    size_t size = serveUnconnected(client, items, out);
    char what[60] = "";

    if (all->opened != opened)
        strcpy(what, "opens a CIP connection");
    else if (all->closed != closed)
        strcpy(what, "closes a CIP connection");
    else if (all->refused != refused)
        sprintf(what, "Forward Open is refused: 01/%04x",
                (unsigned)simEipGet(out + 4, 2));
    if (what[0])
        simLog(eipOf(client)->name, "EtherNet/IP: connection %u: %s", client->number,
               what);
    return size;
}

/* 6F and 70. Returns -1 when the client is gone. */
static int serveMessage(simClient *client, const simEipFrame *frame)
{
    simEip *eip = eipOf(client);
    int connected = frame->command == EIP_UNIT_DATA;
    size_t at = connected ? SIM_EIP_UNIT_MESSAGE : SIM_EIP_RR_MESSAGE;
    simEipConnection *connection = NULL;
    epicsUInt8 out[SIM_EIP_FRAME];
    simEipItems items;
    simEipRecord *record;
    simEipFate fate;
    epicsUInt32 id = 0;
    size_t size;
    int error = simEipItemsParse(frame, &items);

    if (!ownOf(client)->session || frame->session != ownOf(client)->session)
        error = ENCAP_BAD_SESSION;
    record = remember(client, frame, &items);
    if (error) {
        record->error = (unsigned)error;
        answerError(client, frame, error);
        return 0;
    }
    expire(eip);
    if (connected) {
        connection = connectionOf(client, frame, &items, record);
        if (!connection)
            return 0;
        id = connection->toOriginator;
    }
    meetFaults(eip, connected, &items, &fate);
    if (fate.silent || fate.drop || ownOf(client)->mute)
        eip->counts.silent++;
    if (fate.drop) {
        simClientDrop(client, 0, "closed by a fault");
        return -1;
    }
    if (fate.silent || ownOf(client)->mute)
        return 0;
    size = connected ? serveConnected(client, connection, &items, out + at)
                     : serveAndTell(client, &items, out + at);
    noteAnswer(eip, record, out + at, size);
    size = simEipFrameAround(out, frame, id, items.sequence, size);
    deliver(client, out, at, size, &fate);
    return 0;
}

/* Returns -1 when the client is gone. */
static int serveFrame(simClient *client, const simEipFrame *frame)
{
    simEip *eip = eipOf(client);

    if (frame->options) {
        eip->counts.ignored++; /* as the standard has it */
        return 0;
    }
    switch (frame->command) {
    case EIP_NOP:
        break;
    case EIP_LIST_SERVICES:
        listServices(client, frame);
        break;
    case EIP_LIST_IDENTITY:
        listIdentity(client, frame);
        break;
    case EIP_LIST_INTERFACES: {
        epicsUInt8 out[SIM_EIP_HEADER + 2] = {0};

        answerData(client, frame, frame->session, out, 2);
        break;
    }
    case EIP_REGISTER:
        registerSession(client, frame);
        break;
    case EIP_UNREGISTER:
        simClientDrop(client, 0, "the session ends");
        return -1;
    case EIP_RR_DATA:
    case EIP_UNIT_DATA:
        return serveMessage(client, frame);
    default:
        answerError(client, frame, ENCAP_BAD_COMMAND);
    }
    return 0;
}

/* One frame from the inbox, see simClients.h. */
static long take(simClient *client)
{
    size_t size = simEipFrameSize(client->inbox, client->filled);
    simEipFrame frame;

    if (!size)
        return 0;
    eipOf(client)->counts.bytesIn += size;
    simEipFrameParse(&frame, client->inbox, size);
    return serveFrame(client, &frame) ? SIM_CLIENT_GONE : (long)size;
}

static void onGone(simClient *client)
{
    simEipConnectionsLeave(&eipOf(client)->controller.connections, client->number);
    free(ownOf(client)->last);
    free(ownOf(client)->held);
}

/* ---- opening and closing ---- */

int simEipOpen(simEip *eip, simLoop *loop, const char *name, const char *address,
               unsigned port)
{
    eip->loop = loop;
    eip->name = name;
    eip->history = callocMustSucceed(SIM_EIP_HISTORY, sizeof(simEipRecord), "simEipOpen");
    eip->clients.inboxSize = INBOX;
    eip->clients.ownSize = sizeof(simEipClient);
    eip->clients.server = eip;
    eip->clients.take = take;
    eip->clients.gone = onGone;
    if (simClientsOpen(&eip->clients, loop, name, "EtherNet/IP", address, port))
        return -1;
    memcpy(eip->controller.address, &eip->clients.listener.address.sin_addr, 4);
    eip->controller.port = ntohs(eip->clients.listener.address.sin_port);
    return 0;
}

static void forgetHistory(simEip *eip)
{
    size_t i;

    for (i = 0; i < SIM_EIP_HISTORY; i++) {
        free(eip->history[i].request);
        free(eip->history[i].answer);
    }
    memset(eip->history, 0, SIM_EIP_HISTORY * sizeof(simEipRecord));
    eip->historyCount = 0;
}

void simEipClose(simEip *eip)
{
    if (!eip->loop)
        return;
    simClientsClose(&eip->clients);
    simEipConnectionsClear(&eip->controller.connections);
    forgetHistory(eip);
    free(eip->history);
    eip->history = NULL;
    eip->loop = NULL;
}

void simEipPower(simEip *eip, int on)
{
    if (!eip->loop)
        return;
    simClientsPower(&eip->clients, on);
    if (!on)
        simEipConnectionsClear(&eip->controller.connections);
}

void simEipClear(simEip *eip)
{
    simEipController *c = &eip->controller;
    simEipConnections *n = &c->connections;

    memset(&eip->counts, 0, sizeof(eip->counts));
    memset(c->services, 0, sizeof(c->services));
    memset(c->statuses, 0, sizeof(c->statuses));
    n->opened = n->refused = n->closed = n->timedOut = n->duplicates = n->lost = 0;
    eip->clients.connections = eip->clients.sentAway = 0;
    forgetHistory(eip);
}
