/* simEipTagService: the services on tags: Read Tag (4C), Write Tag (4D), both in
 * fragments (52, 53), Read-Modify-Write (4E).
 *
 *   4C   count(2)                                          -> type  data
 *   52   count(2)  offset(4)                               -> type  data
 *   4D   type  count(2)  data
 *   53   type  count(2)  offset(4)  data
 *   4E   size(2)  OR mask(size)  AND mask(size)
 *
 * With Omron only 4C and 4D; a single BOOL has two bytes, its value and whether it is forced; a
 * single byte that is read has another one behind it; a whole array of BOOL is words of 16 bits, some
 * elements of it one byte each.
 *
 * type is two bytes, or A0 02 and the handle of a structure. Offsets count bytes from the
 * element that the path names.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>

#include "simEipController.h"

#define READ 0x4C
#define WRITE 0x4D
#define MODIFY 0x4E
#define READ_FRAGMENT 0x52
#define WRITE_FRAGMENT 0x53

int simEipIsTagService(unsigned service)
{
    return service == READ || service == WRITE || service == MODIFY ||
           service == READ_FRAGMENT || service == WRITE_FRAGMENT;
}

static void general(simEipAnswer *answer, unsigned extended)
{
    simEipFail(answer, EIP_GENERAL, extended);
}

static int isText(const simEipType *type)
{
    return type->kind == eipShortText || type->kind == eipLongText;
}

/* Checks the number of elements, and that they are there. Returns 0 or -1. */
static int checkCount(const simEipController *c, const simEipPlace *place, size_t *count,
                      simEipAnswer *answer)
{
    if (c->profile->omron) {
        size_t most = place->isElement ? place->elements : 1;

        if (!*count || *count > most) {
            simEipFail(answer, EIP_PARAMETER,
                       *count && !place->isElement ? EIP_NO_ARRAY : EIP_RANGE);
            return -1;
        }
        if (place->isArray && !place->isElement)
            *count = place->elements;
        return 0;
    }
    if (*count && *count <= place->elements)
        return 0;
    general(answer, EIP_BEYOND);
    return -1;
}

/* ---- strings that are as long as their text ---- */

static size_t lengthBytes(const simEipType *type)
{
    return type->kind == eipShortText ? 1 : 2;
}

/* Bytes of one element as it goes over the wire. */
static size_t textSize(const simEipType *type, const epicsUInt8 *p)
{
    size_t head = lengthBytes(type);
    size_t length = (size_t)simEipGet(p, head);

    return head + (length < type->text ? length : type->text);
}

static epicsUInt8 *textsToWire(const simEipPlace *place, size_t count, size_t *size)
{
    epicsUInt8 *wire = mallocMustSucceed(count * place->type->size + 1, "simEip");
    size_t i;

    *size = 0;
    for (i = 0; i < count; i++) {
        const epicsUInt8 *p = place->bytes + i * place->type->size;
        size_t n = textSize(place->type, p);

        memcpy(wire + *size, p, n);
        *size += n;
    }
    return wire;
}

/* Bytes behind what a request needs. Clients that are in use send such: pycomm3 appends a
 * single write to itself, and controllers take it. */
static int mayFollow(const simEipController *c, size_t bytes)
{
    return !bytes || (!c->refuseExtra && !c->profile->omron);
}

/* Returns a general status. With `store` unset it only checks. */
static int textsFromWire(const simEipController *c, const simEipPlace *place,
                         size_t count, const epicsUInt8 *wire, size_t size, int store)
{
    size_t head = lengthBytes(place->type);
    size_t i;

    for (i = 0; i < count; i++) {
        epicsUInt8 *p = place->bytes + i * place->type->size;
        size_t n = size < head ? size + 1 : head + (size_t)simEipGet(wire, head);

        if (n > size)
            return EIP_TOO_SHORT;
        if (n > place->type->size)
            return EIP_TOO_LONG;
        if (store) {
            memset(p, 0, place->type->size);
            memcpy(p, wire, n);
        }
        wire += n;
        size -= n;
    }
    return mayFollow(c, size) ? EIP_OK : EIP_TOO_LONG;
}

/* ---- reading ---- */

static int addType(const simEipType *type, simEipAnswer *answer)
{
    if (simEipAddInt(answer, 2, type->code))
        return -1;
    return type->kind == eipStruct ? simEipAddInt(answer, 2, type->handle) : 0;
}

/* Bytes of `left` that one answer takes: whole elements, or words where not even one
 * fits. */
static size_t firstPart(const simEipType *type, size_t left, size_t room)
{
    if (left <= room)
        return left;
    if (isText(type))
        return room;
    return room >= type->size ? room / type->size * type->size : room / 4 * 4;
}

/* BOOLs of Omron; see above. Returns bytes to be freed. */
static epicsUInt8 *boolsToWire(const simEipPlace *place, size_t count, size_t *size)
{
    int whole = place->isArray && !place->isElement;
    epicsUInt8 *wire;
    size_t i;

    *size = whole ? (count + 15) / 16 * 2 : count == 1 ? 2 : count;
    wire = callocMustSucceed(1, *size + 1, "simEip");
    for (i = 0; i < count; i++) {
        int on = place->bit < 0 ? place->bytes[i] != 0 : *place->bytes >> place->bit & 1;

        if (whole)
            wire[i / 8] |= (epicsUInt8)(on << i % 8);
        else
            wire[i] = (epicsUInt8)on;
    }
    return wire;
}

/* A byte of Omron, and the one behind it. */
static epicsUInt8 *byteToWire(const simEipPlace *place, size_t *size)
{
    epicsUInt8 *wire = callocMustSucceed(1, 2, "simEip");

    wire[0] = *place->bytes;
    *size = 2;
    return wire;
}

static void addData(const simEipController *c, const simEipPlace *place, size_t count,
                    size_t offset, simEipAnswer *answer)
{
    const simEipType *type = place->type;
    size_t size = count * type->size;
    const epicsUInt8 *data = place->bytes;
    epicsUInt8 *texts = NULL;
    epicsUInt8 truth;
    size_t part;

    if (type->kind == eipBool && c->profile->omron) {
        data = texts = boolsToWire(place, count, &size);
    } else if (type->size == 1 && c->profile->omron && count == 1) {
        data = texts = byteToWire(place, &size);
    } else if (type->kind == eipBool) {
        int on = place->bit < 0 ? *data != 0 : *data >> place->bit & 1;

        truth = (epicsUInt8)(on ? c->profile->trueByte : 0);
        data = &truth;
    } else if (isText(type)) {
        data = texts = textsToWire(place, count, &size);
    }
    if (offset && offset >= size) {
        general(answer, EIP_BEYOND);
    } else if (offset && type->kind != eipStruct && !texts && offset % type->size) {
        general(answer, EIP_OFFSET);
    } else if (c->profile->omron) { /* whole or not at all */
        if (!addType(type, answer))
            simEipAdd(answer, data, size);
    } else if (!addType(type, answer)) {
        part = firstPart(type, size - offset, answer->room - answer->size);
        simEipAdd(answer, data + offset, part);
        if (part < size - offset)
            answer->status = EIP_PARTIAL;
        if (!part && size)
            answer->size = 0; /* a type alone tells nothing */
    }
    free(texts);
}

static void readTag(const simEipController *c, const simEipRequest *request,
                    const simEipPlace *place, simEipAnswer *answer)
{
    size_t need = request->service == READ ? 2 : 6;
    size_t count;

    if (request->dataSize != need) {
        simEipFail(answer, request->dataSize < need ? EIP_TOO_SHORT : EIP_TOO_LONG, 0);
        return;
    }
    count = (size_t)simEipGet(request->data, 2);
    if (checkCount(c, place, &count, answer))
        return;
    addData(c, place, count, need == 6 ? (size_t)simEipGet(request->data + 2, 4) : 0,
            answer);
}

/* ---- writing ---- */

static void otherType(const simEipController *c, simEipAnswer *answer)
{
    if (c->profile->omron)
        simEipFail(answer, EIP_PARAMETER, EIP_OTHER_TYPE);
    else
        general(answer, EIP_TYPE);
}

/* Takes the type from the data. Returns its bytes, or 0 with an answer. */
static size_t takeType(const simEipController *c, const simEipRequest *request, const simEipType *type,
                       simEipAnswer *answer)
{
    size_t size = type->kind == eipStruct ? 4 : 2;

    if (request->dataSize < 2) {
        simEipFail(answer, EIP_TOO_SHORT, 0);
        return 0;
    }
    if (simEipGet(request->data, 2) != type->code) {
        otherType(c, answer);
        return 0;
    }
    if (request->dataSize < size) {
        simEipFail(answer, EIP_TOO_SHORT, 0);
        return 0;
    }
    if (size == 4 && simEipGet(request->data + 2, 2) != type->handle) {
        otherType(c, answer);
        return 0;
    }
    return size;
}

static void storeBool(const simEipPlace *place, int on)
{
    if (place->bit < 0)
        *place->bytes = (epicsUInt8)on;
    else if (on)
        *place->bytes |= (epicsUInt8)(1u << place->bit);
    else
        *place->bytes &= (epicsUInt8) ~(1u << place->bit);
}

/* BOOLs of Omron; see above. */
static void storeBools(const simEipPlace *place, size_t count, const epicsUInt8 *data,
                       size_t size, simEipAnswer *answer)
{
    int whole = place->isArray && !place->isElement;
    size_t want = whole ? (count + 15) / 16 * 2 : count == 1 ? 2 : count, i;

    if (size != want) {
        simEipFail(answer, size < want ? EIP_TOO_SHORT : EIP_TOO_LONG, 0);
        return;
    }
    for (i = 0; i < count; i++) {
        int on = whole ? data[i / 8] >> i % 8 & 1 : data[i] != 0;

        if (place->bit < 0)
            place->bytes[i] = (epicsUInt8)on;
        else
            storeBool(place, on);
    }
}

static void store(const simEipController *c, const simEipPlace *place, size_t count,
                  const epicsUInt8 *data, size_t size, simEipAnswer *answer)
{
    size_t want = count * place->type->size;
    int status;

    if (place->type->kind == eipBool && c->profile->omron) {
        storeBools(place, count, data, size, answer);
    } else if (isText(place->type)) {
        status = textsFromWire(c, place, count, data, size, 0);
        if (status)
            simEipFail(answer, (unsigned)status, 0);
        else
            textsFromWire(c, place, count, data, size, 1);
    } else if (size < want || !mayFollow(c, size - want)) {
        simEipFail(answer, size < want ? EIP_TOO_SHORT : EIP_TOO_LONG, 0);
    } else if (place->type->kind == eipBool) {
        storeBool(place, data[0] != 0);
    } else {
        memcpy(place->bytes, data, want);
    }
}

/* A part of what 4D would write: any part, since clients cut where they like. */
static void storePart(const simEipPlace *place, size_t count, size_t offset,
                      const epicsUInt8 *data, size_t size, simEipAnswer *answer)
{
    size_t all = count * place->type->size;

    if (isText(place->type) || place->type->kind == eipBool)
        simEipFail(answer, EIP_NO_SERVICE, 0);
    else if (!size)
        simEipFail(answer, EIP_TOO_SHORT, 0);
    else if (offset >= all)
        general(answer, EIP_OFFSET);
    else if (size > all - offset)
        general(answer, EIP_BEYOND);
    else
        memcpy(place->bytes + offset, data, size);
}

static void writeTag(const simEipController *c, const simEipRequest *request,
                     const simEipPlace *place, simEipAnswer *answer)
{
    int isPart = request->service == WRITE_FRAGMENT;
    size_t at = takeType(c, request, place->type, answer);
    size_t head = at + 2 + (isPart ? 4 : 0);
    const epicsUInt8 *data = request->data + head;
    size_t count;

    if (!at)
        return;
    if (request->dataSize < head) {
        simEipFail(answer, EIP_TOO_SHORT, 0);
        return;
    }
    count = (size_t)simEipGet(request->data + at, 2);
    if (checkCount(c, place, &count, answer))
        return;
    if (isPart)
        storePart(place, count, (size_t)simEipGet(request->data + at + 2, 4), data,
                  request->dataSize - head, answer);
    else
        store(c, place, count, data, request->dataSize - head, answer);
}

static void modifyTag(const simEipController *c, const simEipRequest *request,
                      const simEipPlace *place, simEipAnswer *answer)
{
    const simEipType *type = place->type;
    size_t size, i;

    if (request->dataSize < 2) {
        simEipFail(answer, EIP_TOO_SHORT, 0);
        return;
    }
    size = (size_t)simEipGet(request->data, 2);
    if (type->kind != eipInteger && type->kind != eipUnsigned)
        general(answer, EIP_TYPE);
    else if (size != type->size)
        simEipFail(answer, EIP_BAD_PARAMETER, 0);
    else if (request->dataSize < 2 + 2 * size)
        simEipFail(answer, EIP_TOO_SHORT, 0);
    else if (!mayFollow(c, request->dataSize - 2 - 2 * size))
        simEipFail(answer, EIP_TOO_LONG, 0);
    else
        for (i = 0; i < size; i++)
            place->bytes[i] = (epicsUInt8)((place->bytes[i] | request->data[2 + i]) &
                                           request->data[2 + size + i]);
}

void simEipTagService(simEipController *c, const simEipRequest *request,
                      const simEipPath *path, simEipAnswer *answer)
{
    int isRead = request->service == READ || request->service == READ_FRAGMENT;
    simEipPlace place;
    int status = simEipTagsResolve(&c->tags, path, &place);

    if (c->profile->omron && request->service != READ && request->service != WRITE)
        simEipFail(answer, EIP_NO_SERVICE, 0);
    else if (status)
        simEipFail(answer, c->profile->omron ? EIP_PATH_UNKNOWN : (unsigned)status, 0);
    else if (place.tag->access == eipNoAccess ||
             (!isRead && place.tag->access == eipReadOnly))
        simEipFail(answer, EIP_NO_PRIVILEGE, 0);
    else if (!isRead && c->key == eipRun)
        simEipFail(answer, EIP_STATE, EIP_KEY_SWITCH);
    else if (isRead)
        readTag(c, request, &place, answer);
    else if (request->service == MODIFY)
        modifyTag(c, request, &place, answer);
    else
        writeTag(c, request, &place, answer);
}
