/* simEipController: the controller as CIP requests see it: its tags, its objects, its
 * connections, and the answers. It knows no socket, no frame and no clock: time is given.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <string.h>

#include "simEipController.h"

#define HEADER 4 /* bytes of an answer before extended status and data */

#define CLASS_IDENTITY 0x01
#define CLASS_ROUTER 0x02
#define CLASS_MANAGER 0x06

#define SERVICE_MULTIPLE 0x0A
#define SERVICE_CLOSE 0x4E
#define SERVICE_UNCONNECTED 0x52
#define SERVICE_OPEN 0x54
#define SERVICE_LARGE_OPEN 0x5B

/* ---- life ---- */

void simEipControllerInit(simEipController *c, const simEipProfile *profile,
                          simMemory *memory)
{
    memset(c, 0, sizeof(*c));
    c->profile = profile;
    c->serial = 0x00C0FFEE;
    simEipTypesInit(&c->types, profile->strings);
    simEipTagsInit(&c->tags, &c->types, memory);
    simEipConnectionsInit(&c->connections, SIM_EIP_CONNECTIONS / 2);
    if (!profile->list)
        return;
    /* what a real list has beside tags */
    simEipTagsEntry(&c->tags, "Task:MainTask", 0x1070);
    simEipTagsEntry(&c->tags, "Map:Local", 0x1069);
    simEipTagsEntry(&c->tags, "Cxn:Standard:0f2c6d91", 0x107E);
    simEipTagsEntry(&c->tags, "__DEFVAL_00000A4F", 0x00C4);
}

void simEipControllerFree(simEipController *c)
{
    simEipTagsFree(&c->tags);
    simEipTypesFree(&c->types);
    simEipConnectionsFree(&c->connections);
}

void simEipControllerDownload(simEipController *c, int shift)
{
    c->downloads++;
    simEipTagsDownload(&c->tags, shift);
}

/* ---- requests and answers ---- */

static int parseRequest(simEipRequest *request, const epicsUInt8 *bytes, size_t size)
{
    memset(request, 0, sizeof(*request));
    if (size < 2)
        return EIP_TOO_SHORT;
    request->service = bytes[0];
    request->path = bytes + 2;
    request->pathSize = 2 * (size_t)bytes[1];
    if (request->pathSize > size - 2) {
        request->pathSize = 0;
        return EIP_BAD_PATH_SIZE;
    }
    request->data = request->path + request->pathSize;
    request->dataSize = size - 2 - request->pathSize;
    return EIP_OK;
}

void simEipFail(simEipAnswer *answer, unsigned status, unsigned extended)
{
    answer->status = status;
    answer->extendedCount = extended != 0;
    answer->extended[0] = extended;
    answer->size = 0;
}

int simEipAdd(simEipAnswer *answer, const void *bytes, size_t size)
{
    if (answer->status == EIP_TOO_LARGE || size > answer->room - answer->size) {
        simEipFail(answer, EIP_TOO_LARGE, 0);
        return -1;
    }
    memcpy(answer->data + answer->size, bytes, size);
    answer->size += size;
    return 0;
}

int simEipAddInt(simEipAnswer *answer, size_t size, epicsUInt64 value)
{
    epicsUInt8 bytes[8];

    simEipPut(bytes, size, value);
    return simEipAdd(answer, bytes, size);
}

/* Writes the answer. One that does not fit says so: EIP_PARTIAL within a packet. */
static size_t writeAnswer(const simEipOrigin *origin, unsigned service,
                          simEipAnswer *answer, epicsUInt8 *out, size_t limit)
{
    size_t head = HEADER + 2 * (size_t)answer->extendedCount;
    int i;

    if (origin->nested &&
        (answer->status == EIP_TOO_LARGE || head + answer->size > limit))
        simEipFail(answer, EIP_PARTIAL, 0);
    else if (head + answer->size > limit)
        simEipFail(answer, EIP_TOO_LARGE, 0);
    out[0] = (epicsUInt8)(service | 0x80);
    out[1] = 0;
    out[2] = (epicsUInt8)answer->status;
    out[3] = (epicsUInt8)answer->extendedCount;
    for (i = 0; i < answer->extendedCount; i++)
        simEipPut(out + HEADER + 2 * i, 2, answer->extended[i]);
    head = HEADER + 2 * (size_t)answer->extendedCount;
    memcpy(out + head, answer->data, answer->size);
    return head + answer->size;
}

/* ---- Multiple Service Packet ---- */

/* The requests lie one behind the other; offsets count from the number of requests on. */
static int checkOffsets(const epicsUInt8 *data, size_t size, size_t count)
{
    size_t least = 2 + 2 * count;
    size_t i;

    if (!count || size < least)
        return EIP_TOO_SHORT;
    for (i = 0; i < count; i++) {
        size_t offset = (size_t)simEipGet(data + 2 + 2 * i, 2);

        if (offset < least || offset >= size)
            return EIP_BAD_PARAMETER;
        least = offset + 2;
    }
    return EIP_OK;
}

static void serveMultiple(simEipController *c, const simEipOrigin *origin,
                          const simEipRequest *request, simEipAnswer *answer)
{
    const epicsUInt8 *data = request->data;
    size_t count = request->dataSize < 2 ? 0 : (size_t)simEipGet(data, 2);
    int status = checkOffsets(data, request->dataSize, count);
    simEipOrigin inner = *origin;
    size_t used = 2 + 2 * count;
    size_t i;

    if (count > (size_t)c->profile->multiple)
        status = EIP_NO_RESOURCE;
    else if (!status && used + HEADER * count > answer->room)
        status = EIP_TOO_LARGE;
    if (status) {
        simEipFail(answer, (unsigned)status, 0);
        return;
    }
    inner.nested = 1;
    simEipPut(answer->data, 2, count);
    for (i = 0; i < count; i++) {
        size_t from = (size_t)simEipGet(data + 2 + 2 * i, 2);
        size_t to =
            i + 1 < count ? (size_t)simEipGet(data + 4 + 2 * i, 2) : request->dataSize;
        size_t limit = answer->room - used - HEADER * (count - 1 - i);
        epicsUInt8 *out = answer->data + used;

        simEipPut(answer->data + 2 + 2 * i, 2, used);
        used += simEipServe(c, &inner, data + from, to - from, out, limit);
        if (out[2] == EIP_PARTIAL && c->profile->omron) {
            simEipFail(answer, EIP_TOO_LARGE, 0); /* all of it */
            return;
        }
        if (out[2])
            answer->status = EIP_SERVICE_ERROR;
    }
    answer->size = used;
}

/* ---- routing ---- */

static void serveManager(simEipController *c, const simEipOrigin *origin,
                         const simEipRequest *request, simEipAnswer *answer)
{
    if (request->service == SERVICE_OPEN && !origin->nested)
        simEipForwardOpen(c, origin, request, 0, answer);
    else if (request->service == SERVICE_LARGE_OPEN && !origin->nested)
        simEipForwardOpen(c, origin, request, 1, answer);
    else if (request->service == SERVICE_CLOSE && !origin->nested)
        simEipForwardClose(c, request, answer);
    else
        simEipFail(answer, EIP_NO_SERVICE, 0);
}

/* A module in front of the CPU has an identity and a connection manager only. */
static int reachesCpu(const simEipController *c, const simEipOrigin *origin)
{
    return origin->connected || origin->routed || c->profile->frontIsCpu;
}

/* True when the path names tags: by name, or by class 6B and instance. */
static int isTagPath(const simEipPath *path)
{
    unsigned class;
    epicsUInt32 instance;

    if (path->count && path->segments[0].kind == eipSymbol)
        return 1;
    return simEipPathObject(path, &class, &instance) && class == 0x6B && instance;
}

static void route(simEipController *c, const simEipOrigin *origin,
                  const simEipRequest *request, const simEipPath *path,
                  simEipAnswer *answer)
{
    unsigned class = 0;
    epicsUInt32 instance = 0;
    int isObject = simEipPathObject(path, &class, &instance);

    if (isObject && class == CLASS_MANAGER && instance == 1)
        serveManager(c, origin, request, answer);
    else if (!reachesCpu(c, origin) && class != CLASS_IDENTITY)
        simEipFail(answer, EIP_PATH_UNKNOWN, 0);
    else if (isObject && class == CLASS_ROUTER && instance == 1) {
        if (request->service != SERVICE_MULTIPLE || !c->profile->multiple ||
            origin->nested)
            simEipFail(answer, EIP_NO_SERVICE, 0);
        else
            serveMultiple(c, origin, request, answer);
    } else if (isTagPath(path) && simEipIsTagService(request->service))
        simEipTagService(c, request, path, answer);
    else
        simEipObject(c, origin, request, path, answer);
}

/* A fault may answer in place of the controller. */
static int meetsFault(simEipController *c, const simEipOrigin *origin,
                      const simEipRequest *request, const simEipPath *path,
                      simEipAnswer *answer)
{
    simEipSubject subject = {request->service, origin->connected, ""};
    simText text = {NULL, 0, 0};
    unsigned status, extended;
    int met;

    if (!c->faults.count)
        return 0;
    simEipControllerPathText(c, path, &text);
    if (text.text)
        subject.path = text.text;
    met = simEipFaultsStatus(&c->faults, &subject, &status, &extended);
    if (met)
        simEipFail(answer, status, extended);
    simTextFree(&text);
    return met;
}

static int isManager(const simEipPath *path)
{
    unsigned class;
    epicsUInt32 instance;

    return simEipPathObject(path, &class, &instance) && class == CLASS_MANAGER &&
           instance == 1;
}

/* Unconnected_Send: the answer is that of the message which it carries. Returns its size,
 * or 0 when the answer says why there is none. */
static size_t serveUnconnected(simEipController *c, const simEipOrigin *origin,
                               const simEipRequest *request, simEipAnswer *answer,
                               epicsUInt8 *out, size_t limit)
{
    simEipOrigin inner = *origin;
    const epicsUInt8 *message;
    size_t size;
    unsigned extended;
    int status;

    status = simEipUnconnectedSend(c, request, &message, &size, &extended);
    if (origin->connected || origin->nested || origin->routed)
        status = EIP_NO_SERVICE;
    if (status) {
        simEipFail(answer, (unsigned)status, status == EIP_FAILURE ? extended : 0);
        return 0;
    }
    inner.routed = 1;
    return simEipServe(c, &inner, message, size, out, limit);
}

size_t simEipServe(simEipController *c, const simEipOrigin *origin,
                   const epicsUInt8 *bytes, size_t size, epicsUInt8 *out, size_t limit)
{
    simEipAnswer answer;
    simEipRequest request;
    simEipPath path;
    int status = parseRequest(&request, bytes, size);

    answer.status = 0;
    answer.extendedCount = 0;
    answer.size = 0;
    answer.room = limit > HEADER ? limit - HEADER : 0;
    c->services[request.service]++;
    if (!status && simEipPathParse(&path, request.path, request.pathSize))
        status = EIP_PATH_SYNTAX;
    if (status) {
        simEipFail(&answer, (unsigned)status, 0);
    } else if (request.service == SERVICE_UNCONNECTED && isManager(&path)) {
        size_t done = serveUnconnected(c, origin, &request, &answer, out, limit);

        if (done)
            return done;
    } else if (!meetsFault(c, origin, &request, &path, &answer)) {
        route(c, origin, &request, &path, &answer);
    }
    size = writeAnswer(origin, request.service, &answer, out, limit);
    c->statuses[out[2]]++;
    return size;
}

/* ---- looking into messages ---- */

typedef void (*walkFn)(void *arg, const simEipRequest *request, const simEipPath *path);

static void walkMultiple(const simEipRequest *request, walkFn fn, void *arg)
{
    const epicsUInt8 *data = request->data;
    size_t count = request->dataSize < 2 ? 0 : (size_t)simEipGet(data, 2);
    size_t i;

    if (checkOffsets(data, request->dataSize, count))
        return;
    for (i = 0; i < count; i++) {
        size_t from = (size_t)simEipGet(data + 2 + 2 * i, 2);
        size_t to =
            i + 1 < count ? (size_t)simEipGet(data + 4 + 2 * i, 2) : request->dataSize;
        simEipRequest inner;
        simEipPath path;

        if (!parseRequest(&inner, data + from, to - from) &&
            !simEipPathParse(&path, inner.path, inner.pathSize))
            fn(arg, &inner, &path);
    }
}

void simEipWalk(const epicsUInt8 *bytes, size_t size, walkFn fn, void *arg)
{
    simEipRequest request;
    simEipPath path;
    unsigned class = 0;
    epicsUInt32 instance;
    size_t length;

    if (parseRequest(&request, bytes, size) ||
        simEipPathParse(&path, request.path, request.pathSize))
        return;
    simEipPathObject(&path, &class, &instance);
    if (class == CLASS_MANAGER && request.service == SERVICE_UNCONNECTED) {
        length = request.dataSize < 4 ? 0 : (size_t)simEipGet(request.data + 2, 2);
        if (length && length <= request.dataSize - 4 &&
            length < size) /* each step is shorter */
            simEipWalk(request.data + 4, length, fn, arg);
    } else if (class == CLASS_ROUTER && request.service == SERVICE_MULTIPLE)
        walkMultiple(&request, fn, arg);
    else
        fn(arg, &request, &path);
}

/* ---- text ---- */

void simEipControllerPathText(const simEipController *c, const simEipPath *path,
                              simText *out)
{
    simEipPath rest = *path;
    unsigned class;
    epicsUInt32 instance;
    const simEipTag *tag;

    if (!simEipPathObject(path, &class, &instance) || class != 0x6B ||
        !(tag = simEipTagById(&c->tags, instance))) {
        simEipPathText(path, out);
        return;
    }
    /* an instance reads better by its name */
    rest.segments[1].kind = eipSymbol;
    rest.segments[1].text = (const epicsUInt8 *)tag->name;
    rest.segments[1].length = strlen(tag->name);
    rest.count--;
    memmove(rest.segments, rest.segments + 1, rest.count * sizeof(rest.segments[0]));
    simEipPathText(&rest, out);
}
