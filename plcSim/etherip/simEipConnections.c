/* simEipConnections: CIP connections: Forward Open, its large form, Forward Close, who
 * owns one and when it times out. It knows no socket and no clock: time is given.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdlib.h>
#include <string.h>

#include "simEipController.h"

#define OPEN_SIZE 36  /* bytes of a Forward Open before the path; 4 more when large */
#define CLOSE_SIZE 12 /* bytes of a Forward Close before the path */
#define CLASS_3_SERVER 0xA3
#define POINT_TO_POINT 2
#define LEAST_RPI 1000 /* us */

/* Extended status with EIP_FAILURE. */
#define IN_USE 0x0100
#define BAD_TRANSPORT 0x0103
#define NOT_FOUND 0x0107
#define BAD_SIZE 0x0109
#define BAD_RPI 0x0111
#define TOO_MANY 0x0113
#define BAD_REQUEST_TYPE 0x0123
#define BAD_ANSWER_TYPE 0x0124
#define BAD_PORT 0x0311
#define BAD_LINK 0x0312
#define BAD_SEGMENT 0x0315

/* ---- the list ---- */

void simEipConnectionsInit(simEipConnections *all, size_t most)
{
    memset(all, 0, sizeof(*all));
    all->most = most < SIM_EIP_CONNECTIONS ? most : SIM_EIP_CONNECTIONS;
    all->seed = 0x5EED0000u;
}

static void endConnection(simEipConnection *connection)
{
    free(connection->answer);
    memset(connection, 0, sizeof(*connection));
}

void simEipConnectionsClear(simEipConnections *all)
{
    size_t i;

    for (i = 0; i < SIM_EIP_CONNECTIONS; i++)
        endConnection(&all->list[i]);
}

void simEipConnectionsFree(simEipConnections *all)
{
    simEipConnectionsClear(all);
}

void simEipConnectionsExpire(simEipConnections *all, double now)
{
    size_t i;

    for (i = 0; i < SIM_EIP_CONNECTIONS; i++) {
        simEipConnection *connection = &all->list[i];

        if (!connection->used || now - connection->heard <= connection->timeout)
            continue;
        all->timedOut++;
        endConnection(connection);
    }
}

void simEipConnectionsLeave(simEipConnections *all, unsigned client)
{
    size_t i;

    for (i = 0; i < SIM_EIP_CONNECTIONS; i++)
        if (all->list[i].client == client)
            all->list[i].client = 0;
}

size_t simEipConnectionsCount(const simEipConnections *all)
{
    size_t i, count = 0;

    for (i = 0; i < SIM_EIP_CONNECTIONS; i++)
        count += (size_t)all->list[i].used;
    return count;
}

simEipConnection *simEipConnectionFind(simEipConnections *all, epicsUInt32 toTarget)
{
    size_t i;

    for (i = 0; i < SIM_EIP_CONNECTIONS; i++)
        if (all->list[i].used && all->list[i].toTarget == toTarget)
            return &all->list[i];
    return NULL;
}

simEipConnection *simEipConnectionTriad(simEipConnections *all, unsigned serial,
                                        unsigned vendor, epicsUInt32 originator)
{
    size_t i;

    for (i = 0; i < SIM_EIP_CONNECTIONS; i++)
        if (all->list[i].used && all->list[i].serial == serial &&
            all->list[i].vendor == vendor && all->list[i].originator == originator)
            return &all->list[i];
    return NULL;
}

/* A free one with an id of its own; NULL when there are too many. */
static simEipConnection *newConnection(simEipConnections *all)
{
    simEipConnection *connection = NULL;
    size_t i;

    if (simEipConnectionsCount(all) >= all->most)
        return NULL;
    for (i = 0; i < SIM_EIP_CONNECTIONS && !connection; i++)
        if (!all->list[i].used)
            connection = &all->list[i];
    if (!connection)
        return NULL;
    connection->used = 1;
    /* never the same one soon */
    all->seed = all->seed * 1664525u + 1013904223u;
    connection->toTarget = all->seed | 1;
    return connection;
}

/* ---- paths ---- */

/* A port and a slot in front of a path. Returns the bytes they take, 0 when there is
 * none, -1 with an extended status. */
static long takeRoute(const simEipController *c, const epicsUInt8 *path, size_t size,
                      unsigned *extended)
{
    if (size < 2 || path[0] >= 0x20)
        return 0;
    *extended = BAD_PORT;
    if (!c->profile->route || path[0] != 1)
        return -1;
    *extended = BAD_LINK;
    return path[1] == c->slot ? 2 : -1;
}

/* The path of a connection: through the backplane to the message router of the CPU. */
static int checkPath(const simEipController *c, const epicsUInt8 *path, size_t size,
                     unsigned *extended)
{
    static const epicsUInt8 router[] = {0x20, 0x02, 0x24, 0x01};
    long route = takeRoute(c, path, size, extended);

    if (route < 0)
        return -1;
    *extended = BAD_SEGMENT;
    if (!route && !c->profile->frontIsCpu)
        return -1;
    path += route;
    size -= (size_t)route;
    return size == sizeof(router) && !memcmp(path, router, size) ? 0 : -1;
}

/* ---- Forward Open ---- */

/* A Forward Open as it came. */
typedef struct opening {
    epicsUInt32 toOriginator;
    unsigned serial, vendor;
    epicsUInt32 originator;
    unsigned multiplier, transport;
    epicsUInt32 rpi[2], params[2]; /* requests (O->T), answers (T->O) */
    const epicsUInt8 *path;
    size_t pathSize;
} opening;

static int parseOpening(const simEipRequest *request, int isLarge, opening *o)
{
    const epicsUInt8 *p = request->data;
    size_t width = isLarge ? 4 : 2;
    size_t fixed = OPEN_SIZE + (isLarge ? 4 : 0);
    int i;

    if (request->dataSize < fixed)
        return EIP_TOO_SHORT;
    o->toOriginator = (epicsUInt32)simEipGet(p + 6, 4);
    o->serial = (unsigned)simEipGet(p + 10, 2);
    o->vendor = (unsigned)simEipGet(p + 12, 2);
    o->originator = (epicsUInt32)simEipGet(p + 14, 4);
    o->multiplier = p[18];
    p += 22;
    for (i = 0; i < 2; i++) {
        o->rpi[i] = (epicsUInt32)simEipGet(p, 4);
        o->params[i] = (epicsUInt32)simEipGet(p + 4, width);
        p += 4 + width;
    }
    o->transport = p[0];
    o->pathSize = 2 * (size_t)p[1];
    o->path = p + 2;
    if (request->dataSize < fixed + o->pathSize)
        return EIP_TOO_SHORT;
    return request->dataSize > fixed + o->pathSize ? EIP_TOO_LONG : 0;
}

static size_t sizeOf(epicsUInt32 params, int isLarge)
{
    return params & (isLarge ? 0xFFFF : 0x1FF);
}

static int typeOf(epicsUInt32 params, int isLarge)
{
    return params >> (isLarge ? 29 : 13) & 3;
}

/* Returns an extended status, 0 when all is well; *limit is set where sizes are wrong. */
static unsigned checkOpening(simEipController *c, const opening *o, int isLarge,
                             unsigned *limit)
{
    size_t most = isLarge ? c->profile->large : c->profile->small;
    unsigned extended;
    int i;

    if (checkPath(c, o->path, o->pathSize, &extended))
        return extended;
    if (o->transport != CLASS_3_SERVER)
        return BAD_TRANSPORT;
    for (i = 0; i < 2; i++) {
        if (typeOf(o->params[i], isLarge) != POINT_TO_POINT)
            return i ? BAD_ANSWER_TYPE : BAD_REQUEST_TYPE;
        if (o->rpi[i] < LEAST_RPI || o->multiplier > 7)
            return BAD_RPI;
        if (sizeOf(o->params[i], isLarge) < c->profile->smallest ||
            sizeOf(o->params[i], isLarge) > most) {
            *limit = (unsigned)most;
            return BAD_SIZE;
        }
    }
    if (simEipConnectionTriad(&c->connections, o->serial, o->vendor, o->originator))
        return IN_USE;
    return 0;
}

static void refuse(simEipController *c, const opening *o, unsigned extended,
                   unsigned limit, simEipAnswer *answer)
{
    c->connections.refused++;
    simEipFail(answer, EIP_FAILURE, extended);
    if (limit)
        answer->extended[answer->extendedCount++] = limit;
    simEipAddInt(answer, 2, o->serial);
    simEipAddInt(answer, 2, o->vendor);
    simEipAddInt(answer, 4, o->originator);
    simEipAddInt(answer, 2, 0); /* rest of the path, reserved */
}

void simEipForwardOpen(simEipController *c, const simEipOrigin *origin,
                       const simEipRequest *request, int isLarge, simEipAnswer *answer)
{
    simEipConnection *connection;
    unsigned extended, limit = 0;
    opening o;
    int status;

    if (isLarge && !c->profile->large) {
        simEipFail(answer, EIP_NO_SERVICE, 0);
        return;
    }
    status = parseOpening(request, isLarge, &o);
    if (status) {
        simEipFail(answer, (unsigned)status, 0);
        return;
    }
    extended = checkOpening(c, &o, isLarge, &limit);
    connection = extended ? NULL : newConnection(&c->connections);
    if (!connection) {
        refuse(c, &o, extended ? extended : TOO_MANY, limit, answer);
        return;
    }
    c->connections.opened++;
    connection->toOriginator = o.toOriginator;
    connection->serial = o.serial;
    connection->vendor = o.vendor;
    connection->originator = o.originator;
    connection->requestSize = sizeOf(o.params[0], isLarge);
    connection->answerSize = sizeOf(o.params[1], isLarge);
    connection->timeout = o.rpi[0] * 1e-6 * 4 * (1 << o.multiplier);
    connection->heard = origin->now;
    connection->client = origin->client;
    simEipAddInt(answer, 4, connection->toTarget);
    simEipAddInt(answer, 4, o.toOriginator);
    simEipAddInt(answer, 2, o.serial);
    simEipAddInt(answer, 2, o.vendor);
    simEipAddInt(answer, 4, o.originator);
    simEipAddInt(answer, 4, o.rpi[0]);
    simEipAddInt(answer, 4, o.rpi[1]);
    simEipAddInt(answer, 2, 0); /* no application data, reserved */
}

/* ---- Forward Close ---- */

void simEipForwardClose(simEipController *c, const simEipRequest *request,
                        simEipAnswer *answer)
{
    const epicsUInt8 *p = request->data;
    simEipConnection *connection;
    unsigned serial, vendor, extended;
    epicsUInt32 originator;

    if (request->dataSize < CLOSE_SIZE ||
        request->dataSize < CLOSE_SIZE + 2 * (size_t)p[10]) {
        simEipFail(answer, EIP_TOO_SHORT, 0);
        return;
    }
    serial = (unsigned)simEipGet(p + 2, 2);
    vendor = (unsigned)simEipGet(p + 4, 2);
    originator = (epicsUInt32)simEipGet(p + 6, 4);
    connection = simEipConnectionTriad(&c->connections, serial, vendor, originator);
    if (checkPath(c, p + CLOSE_SIZE, 2 * (size_t)p[10], &extended))
        simEipFail(answer, EIP_FAILURE, extended);
    else if (!connection)
        simEipFail(answer, EIP_FAILURE, NOT_FOUND);
    simEipAddInt(answer, 2, serial);
    simEipAddInt(answer, 2, vendor);
    simEipAddInt(answer, 4, originator);
    simEipAddInt(answer, 2, 0); /* application data or rest of the path, reserved */
    if (!connection || answer->status)
        return;
    c->connections.closed++;
    endConnection(connection);
}

/* ---- Unconnected_Send ---- */

int simEipUnconnectedSend(const simEipController *c, const simEipRequest *request,
                          const epicsUInt8 **message, size_t *size, unsigned *extended)
{
    const epicsUInt8 *p = request->data;
    size_t head, length, route;
    long taken;

    *extended = 0;
    if (!c->profile->route)
        return EIP_NO_SERVICE;
    if (request->dataSize < 4)
        return EIP_TOO_SHORT;
    length = (size_t)simEipGet(p + 2, 2);
    head = 4 + length + length % 2;
    if (request->dataSize < head + 2)
        return EIP_TOO_SHORT;
    route = 2 * (size_t)p[head];
    if (request->dataSize < head + 2 + route)
        return EIP_TOO_SHORT;
    if (request->dataSize > head + 2 + route)
        return EIP_TOO_LONG;
    if (length > SIM_EIP_UNCONNECTED)
        return EIP_NO_RESOURCE;
    taken = takeRoute(c, p + head + 2, route, extended);
    if (taken < 0)
        return EIP_FAILURE;
    *extended = BAD_SEGMENT;
    if (!taken || (size_t)taken != route)
        return EIP_FAILURE;
    *extended = 0;
    *message = p + 4;
    *size = length;
    return 0;
}
