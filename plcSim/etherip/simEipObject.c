/* simEipObject: the objects beside the tags: identity (01), the list of symbols (6B),
 * templates of structures (6C), the program's name (64), the clock (8B), and what changes
 * with a download (AC).
 *
 *   01   Get_Attributes_All        -> all values
 *   03   n(2)  attribute(2) ...    -> n(2)  attribute(2)  status(2)  value ...
 *   0E   (attribute in the path)   -> value
 *   55   n(2)  attribute(2) ...    -> instance(4)  value ...           for each symbol
 *   4C   offset(4)  bytes(2)       -> bytes of the template
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "simEipController.h"

#define GET_ALL 0x01
#define GET_LIST 0x03
#define GET_SINGLE 0x0E
#define READ_TEMPLATE 0x4C
#define GET_INSTANCES 0x55

#define CLASS_IDENTITY 0x01
#define CLASS_PROGRAM 0x64
#define CLASS_SYMBOL 0x6B
#define CLASS_TEMPLATE 0x6C
#define CLASS_CLOCK 0x8B
#define CLASS_CHANGES 0xAC

#define BASE_TAG 0x04000000u /* no alias */

/* ---- attributes ---- */

/* Adds the value of one attribute. Returns 0, or -1 when there is no such one. */
typedef int (*attributeFn)(const simEipController *c, const simEipOrigin *origin,
                           const void *what, unsigned attribute, simEipAnswer *answer);

static int hasCpuIdentity(const simEipController *c, const simEipOrigin *origin)
{
    return origin->connected || origin->routed || c->profile->frontIsCpu;
}

/* Bits of the status word that tell the position of the key. */
static unsigned statusWord(const simEipController *c)
{
    static const unsigned words[] = {0x3060, 0x1060, 0x2070}; /* as simEipKey */

    return words[c->key];
}

static void addShortString(const char *text, simEipAnswer *answer)
{
    simEipAddInt(answer, 1, strlen(text));
    simEipAdd(answer, text, strlen(text));
}

static int identityAttribute(const simEipController *c, const simEipOrigin *origin,
                             const void *what, unsigned attribute, simEipAnswer *answer)
{
    int isCpu = hasCpuIdentity(c, origin);
    const simEipIdentity *id = isCpu ? &c->profile->cpu : &c->profile->front;

    (void)what;
    switch (attribute) {
    case 1:
        simEipAddInt(answer, 2, id->vendor);
        break;
    case 2:
        simEipAddInt(answer, 2, id->deviceType);
        break;
    case 3:
        simEipAddInt(answer, 2, id->productCode);
        break;
    case 4:
        simEipAddInt(answer, 2, id->major | id->minor << 8);
        break;
    case 5:
        simEipAddInt(answer, 2, statusWord(c));
        break;
    case 6:
        simEipAddInt(answer, 4, c->serial + (isCpu ? 0u : 1u));
        break;
    case 7:
        addShortString(id->name, answer);
        break;
    default:
        return -1;
    }
    return 0;
}

void simEipIdentityBytes(const simEipController *c, int front, simEipAnswer *answer)
{
    simEipOrigin origin = {.routed = !front};
    unsigned attribute;

    for (attribute = 1; attribute <= 7; attribute++)
        identityAttribute(c, &origin, NULL, attribute, answer);
}

static int changesAttribute(const simEipController *c, const simEipOrigin *origin,
                            const void *what, unsigned attribute, simEipAnswer *answer)
{
    (void)origin;
    (void)what;
    switch (attribute) {
    case 1:
    case 2:
        simEipAddInt(answer, 2, 5 + c->downloads);
        break;
    case 3:
        simEipAddInt(answer, 4, 0x1000u + c->edits);
        break;
    case 4:
    case 10:
        simEipAddInt(answer, 4, 0x5A170000u + c->downloads * 0x101u + c->edits);
        break;
    default:
        return -1;
    }
    return 0;
}

static int clockAttribute(const simEipController *c, const simEipOrigin *origin,
                          const void *what, unsigned attribute, simEipAnswer *answer)
{
    (void)what;
    if (attribute != 6 && attribute != 11)
        return -1;
    simEipAddInt(answer, 8, (epicsUInt64)((c->clock + origin->now) * 1e6));
    return 0;
}

static int symbolAttribute(const simEipController *c, const simEipOrigin *origin,
                           const void *what, unsigned attribute, simEipAnswer *answer)
{
    const simEipTag *tag = what;
    unsigned id = simEipTagId(&c->tags, tag);
    int i;

    (void)origin;
    switch (attribute) {
    case 1:
        simEipAddInt(answer, 2, strlen(simEipTagName(tag)));
        simEipAdd(answer, simEipTagName(tag), strlen(simEipTagName(tag)));
        break;
    case 2:
        simEipAddInt(answer, 2,
                     tag->type ? simEipTypeWord(&c->types, tag->type, tag->dimCount)
                               : tag->word);
        break;
    case 3:
        simEipAddInt(answer, 4, 0x00400000u + id * 16u);
        break;
    case 5:
        simEipAddInt(answer, 4, 0x00800000u + id * 64u);
        break;
    case 6:
        simEipAddInt(answer, 4, BASE_TAG);
        break;
    case 7:
        simEipAddInt(answer, 2, tag->type ? tag->type->size : 0);
        break;
    case 8:
        for (i = 0; i < 3; i++)
            simEipAddInt(answer, 4, tag->dims[i]);
        break;
    case 10:
        if (!c->profile->externalAccess)
            return -1;
        simEipAddInt(answer, 1, tag->access);
        break;
    default:
        return -1;
    }
    return 0;
}

static int templateAttribute(const simEipController *c, const simEipOrigin *origin,
                             const void *what, unsigned attribute, simEipAnswer *answer)
{
    const simEipType *type = what;

    (void)c;
    (void)origin;
    switch (attribute) {
    case 1:
        simEipAddInt(answer, 2, type->handle);
        break;
    case 2:
        simEipAddInt(answer, 2, type->memberCount);
        break;
    case 3:
        simEipAddInt(answer, 2, 0);
        break;
    case 4:
        simEipAddInt(answer, 4, (type->definitionSize + 20) / 4);
        break;
    case 5:
        simEipAddInt(answer, 4, type->size);
        break;
    default:
        return -1;
    }
    return 0;
}

/* ---- services on one instance ---- */

static void getList(const simEipController *c, const simEipOrigin *origin,
                    const simEipRequest *request, attributeFn get, const void *what,
                    simEipAnswer *answer)
{
    size_t count = request->dataSize < 2 ? 0 : (size_t)simEipGet(request->data, 2);
    size_t i;

    if (!count || request->dataSize < 2 + 2 * count) {
        simEipFail(answer, EIP_TOO_SHORT, 0);
        return;
    }
    simEipAddInt(answer, 2, count);
    for (i = 0; i < count && answer->status != EIP_TOO_LARGE; i++) {
        unsigned attribute = (unsigned)simEipGet(request->data + 2 + 2 * i, 2);
        size_t at = answer->size + 2;

        simEipAddInt(answer, 2, attribute);
        simEipAddInt(answer, 2, 0);
        if (get(c, origin, what, attribute, answer) && answer->status != EIP_TOO_LARGE) {
            simEipPut(answer->data + at, 2, EIP_BAD_ATTRIBUTE);
            answer->status = EIP_BAD_ATTRIBUTE;
        }
    }
}

static void getSingle(const simEipController *c, const simEipOrigin *origin,
                      const simEipPath *path, attributeFn get, const void *what,
                      simEipAnswer *answer)
{
    if (path->count != 3 || path->segments[2].kind != eipAttribute)
        simEipFail(answer, EIP_PATH_SYNTAX, 0);
    else if (get(c, origin, what, path->segments[2].value, answer))
        simEipFail(answer, EIP_NOT_SETTABLE, 0);
}

/* Services that every object has here. */
static void getAttributes(const simEipController *c, const simEipOrigin *origin,
                          const simEipRequest *request, const simEipPath *path,
                          attributeFn get, const void *what, simEipAnswer *answer)
{
    if (request->service == GET_LIST)
        getList(c, origin, request, get, what, answer);
    else if (request->service == GET_SINGLE)
        getSingle(c, origin, path, get, what, answer);
    else
        simEipFail(answer, EIP_NO_SERVICE, 0);
}

static void serveTemplate(const simEipController *c, const simEipOrigin *origin,
                          const simEipRequest *request, const simEipPath *path,
                          const simEipType *type, simEipAnswer *answer)
{
    size_t offset, bytes, room;

    if (request->service != READ_TEMPLATE) {
        getAttributes(c, origin, request, path, templateAttribute, type, answer);
        return;
    }
    if (request->dataSize < 6) {
        simEipFail(answer, EIP_TOO_SHORT, 0);
        return;
    }
    offset = (size_t)simEipGet(request->data, 4);
    bytes = (size_t)simEipGet(request->data + 4, 2);
    if (offset > type->definitionSize || bytes > type->definitionSize - offset) {
        simEipFail(answer, EIP_GENERAL, EIP_BEYOND);
        return;
    }
    room = answer->room / 4 * 4;
    if (bytes > room) {
        bytes = room;
        answer->status = EIP_PARTIAL;
    }
    simEipAdd(answer, type->definition + offset, bytes);
}

/* ---- the list of symbols ---- */

/* Returns 0 when the tag does not fit any more, or an attribute is not known. */
static int addSymbol(const simEipController *c, const simEipOrigin *origin,
                     const simEipRequest *request, const simEipTag *tag,
                     simEipAnswer *answer)
{
    size_t count = (size_t)simEipGet(request->data, 2);
    size_t before = answer->size;
    size_t i;

    simEipAddInt(answer, 4, simEipTagId(&c->tags, tag));
    for (i = 0; i < count && !answer->status; i++)
        if (symbolAttribute(c, origin, tag,
                            (unsigned)simEipGet(request->data + 2 + 2 * i, 2), answer) &&
            !answer->status)
            simEipFail(answer, EIP_BAD_ATTRIBUTE, 0);
    if (!answer->status)
        return 1;
    if (answer->status == EIP_TOO_LARGE) {
        answer->status = EIP_PARTIAL;
        answer->size = before;
    }
    return 0;
}

/* `scope` is "Program:Main." or empty. */
static void listSymbols(const simEipController *c, const simEipOrigin *origin,
                        const simEipRequest *request, const char *scope,
                        epicsUInt32 start, simEipAnswer *answer)
{
    size_t count = request->dataSize < 2 ? 0 : (size_t)simEipGet(request->data, 2);
    size_t length = strlen(scope);
    size_t i;

    if (!c->profile->list) {
        simEipFail(answer, EIP_NO_SERVICE, 0);
        return;
    }
    if (!count || request->dataSize < 2 + 2 * count) {
        simEipFail(answer, EIP_TOO_SHORT, 0);
        return;
    }
    for (i = 0; i < c->tags.count; i++) {
        const simEipTag *tag = c->tags.list[i];

        if (tag->scope != length || strncasecmp(tag->name, scope, length) ||
            simEipTagId(&c->tags, tag) < start)
            continue;
        if (!addSymbol(c, origin, request, tag, answer))
            return;
    }
}

static void serveSymbols(const simEipController *c, const simEipOrigin *origin,
                         const simEipRequest *request, const simEipPath *path,
                         const char *scope, epicsUInt32 instance, simEipAnswer *answer)
{
    const simEipTag *tag;

    if (request->service == GET_INSTANCES) {
        listSymbols(c, origin, request, scope, instance, answer);
        return;
    }
    tag = simEipTagById(&c->tags, instance);
    if (!tag)
        simEipFail(answer, EIP_PATH_UNKNOWN, 0);
    else
        getAttributes(c, origin, request, path, symbolAttribute, tag, answer);
}

/* Program:Main, then class 6B and an instance. Returns 0 when the path is none of this.
 */
static int serveScope(const simEipController *c, const simEipOrigin *origin,
                      const simEipRequest *request, const simEipPath *path,
                      simEipAnswer *answer)
{
    const simEipSegment *s = path->segments;
    char scope[SIM_EIP_FULL_NAME];

    if (path->count < 3 || s[0].kind != eipSymbol || s[1].kind != eipClass ||
        s[1].value != CLASS_SYMBOL || s[2].kind != eipInstance ||
        s[0].length >= sizeof(scope) - 1)
        return 0;
    snprintf(scope, sizeof(scope), "%.*s", (int)s[0].length, (const char *)s[0].text);
    if (!simEipTagFind(&c->tags, scope)) {
        simEipFail(answer, EIP_PATH_SYNTAX, 0);
        return 1;
    }
    strcat(scope, ".");
    serveSymbols(c, origin, request, path, scope, s[2].value, answer);
    return 1;
}

/* ---- all of them ---- */

static void serveIdentity(const simEipController *c, const simEipOrigin *origin,
                          const simEipRequest *request, const simEipPath *path,
                          simEipAnswer *answer)
{
    if (request->service == GET_ALL)
        simEipIdentityBytes(c, !hasCpuIdentity(c, origin), answer);
    else
        getAttributes(c, origin, request, path, identityAttribute, NULL, answer);
}

static void serveProgram(const simEipController *c, const simEipRequest *request,
                         simEipAnswer *answer)
{
    if (request->service != GET_ALL) {
        simEipFail(answer, EIP_NO_SERVICE, 0);
        return;
    }
    simEipAddInt(answer, 2, strlen(c->program));
    simEipAdd(answer, c->program, strlen(c->program));
}

void simEipObject(simEipController *c, const simEipOrigin *origin,
                  const simEipRequest *request, const simEipPath *path,
                  simEipAnswer *answer)
{
    unsigned class;
    epicsUInt32 instance;
    const simEipType *type;
    int logix = c->profile->list;

    if (path->count && path->segments[0].kind == eipSymbol) {
        if (!serveScope(c, origin, request, path, answer))
            simEipFail(answer, EIP_NO_SERVICE, 0);
        return;
    }
    if (!simEipPathObject(path, &class, &instance)) {
        simEipFail(answer, EIP_PATH_SYNTAX, 0);
        return;
    }
    type = class == CLASS_TEMPLATE ? simEipTemplateFind(&c->types, instance) : NULL;
    if (class == CLASS_IDENTITY && instance == 1)
        serveIdentity(c, origin, request, path, answer);
    else if (class == CLASS_SYMBOL)
        serveSymbols(c, origin, request, path, "", instance, answer);
    else if (type && logix)
        serveTemplate(c, origin, request, path, type, answer);
    else if (class == CLASS_PROGRAM && instance == 1 && logix)
        serveProgram(c, request, answer);
    else if (class == CLASS_CLOCK && instance == 1)
        getAttributes(c, origin, request, path, clockAttribute, NULL, answer);
    else if (class == CLASS_CHANGES && instance == 1 && logix)
        getAttributes(c, origin, request, path, changesAttribute, NULL, answer);
    else
        simEipFail(answer, EIP_PATH_UNKNOWN, 0);
}
