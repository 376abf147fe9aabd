/* Values of tags, as they are read; see eipClient.h. */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>

#include "eipClient.h"

int eipValueInit(eipClient *c, eipValue *v, const char *tag)
{
    char error[200];
    size_t column;

    memset(v, 0, sizeof(*v));
    if (eipNameParse(tag, 0, &v->name, &column, error, sizeof(error)))
        return eipClientFail(c, "%s (at %u)", error, (unsigned)column + 1);
    v->bytes = mallocMustSucceed(eipClientValueMax, "eipClient");
    return 0;
}

void eipValueFree(eipValue *v)
{
    free(v->bytes);
    v->bytes = NULL;
}

void eipValuePath(eipWriter *w, const eipName *name, int service)
{
    epicsUInt8 path[eipPathMax + 32];
    eipWriter p = eipWriterOf(path, sizeof(path));
    unsigned i;

    eipPathPut(&p, name->base, 0);
    for (i = 0; i < name->dimensions; i++)
        eipIndexPut(&p, name->index[i]);
    eipRequestPut(w, (eipService)service, path, p.n);
}

/* The next part begins at a whole element. */
static size_t wholeElements(const eipData *part)
{
    const eipType *type = eipTypeOf(part->code);

    return type && type->size ? part->length - part->length % type->size : part->length;
}

/* Is a structure a string? Its template says it. */
static void learnString(eipClient *c, eipValue *v)
{
    epicsUInt32 dimension[3];
    const eipTemplate *t = NULL;
    unsigned type;

    if (v->data.code != eipStructureCode)
        return;
    if (v->data.handle == eipStringHandle)
        v->characters = eipStringRoom;
    else if (eipClientTypeOf(c, v->name.base, &type, dimension) == eipTypeFound && eipIsStructure(type))
        t = eipClientTemplate(c, eipTemplateId(type));
    if (t && t->handle == v->data.handle) {
        v->characters = eipTemplateIsString(t);
        v->structure = t;
    }
}

/* Has its type the bit that the name asks for? */
static int checkBit(eipClient *c, const eipValue *v)
{
    const eipType *type = eipTypeOf(v->data.code);
    int bits = type->kind & (eipSigned | eipUnsigned) ? (int)type->size * 8 : 0;

    if (v->name.bit < (type->code == eipBool ? 1 : bits))
        return 0;
    if (type->code == eipBool)
        return eipClientFail(c, "bit %d; BOOL has bit 0 only", v->name.bit);
    return bits ? eipClientFail(c, "bit %d; %s has bits 0 to %d", v->name.bit, type->name, bits - 1)
                : eipClientFail(c, "bit %d; %s has no bits", v->name.bit, type->name);
}

static int isOmron(const eipClient *c)
{
    return c->connect.identity.known && c->connect.identity.vendor == eipVendorOmron;
}

void eipValueFirst(const eipClient *c, eipValue *v, unsigned count)
{
    if (isOmron(c) && count > 1 && !v->name.dimensions) {
        v->name.dimensions = 1;
        v->name.index[0] = 0;
    }
}

/* The elements that were asked for: Omron has bytes behind a single one, or the whole array. */
static void trim(eipValue *v, unsigned count)
{
    const eipType *type = eipTypeOf(v->data.code);
    size_t length = (size_t)count * type->size;

    if (type->code == eipBool && count == 1 && v->data.length)
        v->bytes[0] &= 1; /* BOOLs in an array are bits */
    if (type->size && v->data.length > length)
        v->data.length = length;
}

/* As many elements at a time as fit for sure: Omron has no fragments. */
static int readRuns(eipClient *c, eipValue *v, unsigned count)
{
    unsigned most = (c->connect.room - 40) / 8, at, n;
    eipValue part = *v;
    eipAnswer answer;
    size_t got = 0;

    for (at = 0; at < count; at += n, part.name.index[part.name.dimensions - 1] += n) {
        eipWriter w = eipClientWriter(c);

        n = count - at < most ? count - at : most;
        eipValuePath(&w, &part.name, eipReadTag);
        eipPut16(&w, n);
        if (eipClientAsk(c, &w, &answer))
            return -1;
        if (answer.status) {
            eipClientExplain(c, &v->name, count, &answer);
            return -1;
        }
        if (eipDataTake(&answer, &part.data) || got + part.data.length > eipClientValueMax)
            return eipClientFail(c, "answer not understood");
        memcpy(v->bytes + got, part.data.bytes, part.data.length);
        part.data.bytes = v->bytes + got;
        trim(&part, n);
        got += part.data.length;
    }
    v->data = (eipData){part.data.code, part.data.handle, v->bytes, got};
    return 0;
}

static int readFragments(eipClient *c, eipValue *v, unsigned count)
{
    eipAnswer answer;
    size_t got = 0;

    do {
        eipWriter w = eipClientWriter(c);
        eipData part;

        eipValuePath(&w, &v->name, got ? eipReadFragment : eipReadTag);
        eipPut16(&w, count);
        if (got)
            eipPut32(&w, (epicsUInt32)got);
        if (eipClientAsk(c, &w, &answer))
            return -1;
        if (answer.status && answer.status != eipPartial) {
            eipClientExplain(c, &v->name, count, &answer);
            return -1;
        }
        if (eipDataTake(&answer, &part) || got + part.length > eipClientValueMax ||
            (got && part.code != v->data.code) ||
            (answer.status == eipPartial && !wholeElements(&part)))
            return eipClientFail(c, "answer not understood");
        memcpy(v->bytes + got, part.bytes, part.length);
        got += answer.status == eipPartial ? wholeElements(&part) : part.length;
        v->data = (eipData){part.code, part.handle, v->bytes, got};
    } while (answer.status == eipPartial);
    return 0;
}

/* A second one is asked for, which costs less than the list. Omron has shown the whole. */
int eipClientHasMore(eipClient *c, const eipValue *v)
{
    eipWriter w = eipClientWriter(c);
    eipAnswer answer;

    if (v->name.dimensions || v->name.bit >= 0 || isOmron(c))
        return 0;
    eipValuePath(&w, &v->name, eipReadTag);
    eipPut16(&w, 2);
    return !eipClientAsk(c, &w, &answer) && (!answer.status || answer.status == eipPartial);
}

int eipClientRead(eipClient *c, eipValue *v, unsigned count)
{
    eipValueFirst(c, v, count);
    if (isOmron(c) && count > 1 ? readRuns(c, v, count) : readFragments(c, v, count))
        return -1;
    if (isOmron(c))
        trim(v, count);
    if (checkBit(c, v))
        return -1;
    learnString(c, v);
    return 0;
}
