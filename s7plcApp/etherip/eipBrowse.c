/* What a controller tells of its tags; see eipBrowse.h. */
#include <stdlib.h>

#include <cantProceed.h>
#include <epicsString.h>

#include "eipBrowse.h"

enum {
    classSymbol = 0x6b,
    classTemplate = 0x6c,
    attributeName = 1,
    attributeType = 2,
    attributeDimensions = 8,
    definitionBytesMax = 1 << 20,
    membersMax = 65535
};

/* --- The list ------------------------------------------------------------------------------ */

void eipSymbolsPut(eipWriter *w, const char *program, epicsUInt32 start)
{
    epicsUInt8 path[300];
    eipWriter p = eipWriterOf(path, sizeof(path));
    size_t n = program ? strlen(program) : 0;

    if (n) {
        eipPut8(&p, 0x91);
        eipPut8(&p, (unsigned)n);
        eipPutBytes(&p, program, n);
        if (n % 2)
            eipPut8(&p, 0);
    }
    eipPut8(&p, 0x20);
    eipPut8(&p, classSymbol);
    eipPut8(&p, start < 65536 ? 0x25 : 0x26);
    eipPut8(&p, 0);
    eipPutUnsigned(&p, start < 65536 ? 2 : 4, start);
    eipRequestPut(w, eipInstanceList, path, p.n);
    eipPut16(w, 3);
    eipPut16(w, attributeName);
    eipPut16(w, attributeType);
    eipPut16(w, attributeDimensions);
    if (n > 255)
        w->full = 1;
}

int eipSymbolTake(eipReader *r, eipSymbol *symbol)
{
    const epicsUInt8 *name;
    size_t n;
    unsigned i;

    if (!r->left && !r->bad)
        return 0;
    symbol->id = eipTake32(r);
    n = eipTake16(r);
    name = eipTake(r, n);
    symbol->type = eipTake16(r);
    for (i = 0; i < 3; i++)
        symbol->dimension[i] = eipTake32(r);
    if (r->bad || n > eipSymbolNameMax || memchr(name, 0, n))
        return -1;
    memcpy(symbol->name, name, n);
    symbol->name[n] = 0;
    return 1;
}

int eipSymbolCounts(const eipSymbol *symbol)
{
    static const char *const others[] = {"__", "Map:", "Cxn:", "Task:", "Routine:", "UDI:"};
    size_t i;

    /* Programs are marked as the controller's own. */
    if (epicsStrnCaseCmp(symbol->name, "Program:", 8) == 0)
        return 1;
    if (symbol->type & eipSymbolSystem || !symbol->name[0])
        return 0;
    for (i = 0; i < sizeof(others) / sizeof(others[0]); i++)
        if (strncmp(symbol->name, others[i], strlen(others[i])) == 0)
            return 0;
    return 1;
}

/* --- Templates ----------------------------------------------------------------------------- */

void eipTemplateSizePut(eipWriter *w, unsigned id)
{
    static const unsigned attributes[] = {4, 5, 2, 1};
    epicsUInt8 path[12];
    size_t i;

    eipRequestPut(w, eipGetAttributeList, path, eipObjectPath(path, classTemplate, id, 0));
    eipPut16(w, 4);
    for (i = 0; i < 4; i++)
        eipPut16(w, attributes[i]);
}

int eipTemplateSizeTake(const eipAnswer *answer, unsigned id, eipTemplate *t)
{
    eipReader r = eipReaderOf(answer->data, answer->length);
    unsigned n = eipTake16(&r), i, seen = 0;

    memset(t, 0, sizeof(*t));
    t->id = id;
    for (i = 0; i < n && !r.bad; i++) {
        unsigned attribute = eipTake16(&r);

        if (eipTake16(&r))
            return -1;
        seen |= 1u << (attribute & 31);
        switch (attribute) {
        case 1:
            t->handle = eipTake16(&r);
            break;
        case 2:
            t->count = eipTake16(&r);
            break;
        case 4:
            t->words = eipTake32(&r);
            break;
        case 5:
            t->size = eipTake32(&r);
            break;
        default:
            return -1;
        }
    }
    if (r.bad || seen != (1u << 1 | 1u << 2 | 1u << 4 | 1u << 5) || t->words < 6 ||
        t->words > definitionBytesMax / 4 || t->size > definitionBytesMax)
        return -1;
    return 0;
}

/* The definition counts 23 bytes that are not sent; whole words are asked for. */
size_t eipTemplateBytes(const eipTemplate *t)
{
    return (size_t)t->words * 4 - 20;
}

void eipTemplateReadPut(eipWriter *w, unsigned id, epicsUInt32 offset, unsigned bytes)
{
    epicsUInt8 path[12];

    eipRequestPut(w, eipReadTag, path, eipObjectPath(path, classTemplate, id, 0));
    eipPut32(w, offset);
    eipPut16(w, bytes);
}

/* A text up to NUL, or the end; `stop` ends it too. What is too long is cut. */
static void takeName(eipReader *r, char *name, char stop)
{
    size_t n = 0, used;
    const epicsUInt8 *at = r->at;

    while (n < r->left && at[n])
        n++;
    for (used = 0; used < n && used < eipMemberNameMax && at[used] != (epicsUInt8)stop; used++)
        name[used] = (char)at[used];
    name[used] = 0;
    eipTake(r, n < r->left ? n + 1 : n);
}

int eipTemplateParse(eipTemplate *t, const epicsUInt8 *bytes, size_t length)
{
    eipReader r = eipReaderOf(bytes, length);
    unsigned i;

    if (t->count > membersMax || (size_t)t->count * 8 > length)
        return -1;
    t->members = callocMustSucceed(t->count + 1, sizeof(*t->members), "etherip");
    for (i = 0; i < t->count; i++) {
        eipMember *m = &t->members[i];

        m->info = eipTake16(&r);
        m->type = eipTake16(&r);
        m->offset = eipTake32(&r);
        if (m->offset >= t->size && t->size)
            r.bad = 1;
    }
    if (!r.bad)
        takeName(&r, t->name, ';');
    for (i = 0; i < t->count && !r.bad; i++)
        takeName(&r, t->members[i].name, 0);
    if (r.bad) {
        eipTemplateFree(t);
        return -1;
    }
    return 0;
}

void eipTemplateFree(eipTemplate *t)
{
    free(t->members);
    t->members = NULL;
    t->count = 0;
}

unsigned eipTemplateIsString(const eipTemplate *t)
{
    const eipMember *m = t->members;

    if (t->count != 2 || strcmp(m[0].name, "LEN") || strcmp(m[1].name, "DATA") ||
        eipElementCode(m[0].type) != eipDint || eipElementCode(m[1].type) != eipSint ||
        eipDimensions(m[1].type) != 1 || m[0].offset != 0 || m[1].offset != eipStringData ||
        m[1].info > t->size - eipStringData)
        return 0;
    return m[1].info;
}

int eipMemberIsHidden(const eipMember *m)
{
    return m->name[0] == '_' || strncmp(m->name, "ZZZZ", 4) == 0;
}

void eipTemplatesClear(eipTemplates *templates)
{
    unsigned i;

    for (i = 0; i < eipTemplatesMax; i++) {
        if (!templates->table[i])
            continue;
        eipTemplateFree(templates->table[i]);
        free(templates->table[i]);
        templates->table[i] = NULL;
    }
}

int eipTemplatesHaveRoom(const eipTemplates *templates, const eipTemplate *t)
{
    unsigned n = t->count, i;

    for (i = 0; i < eipTemplatesMax; i++)
        n += templates->table[i] ? templates->table[i]->count : 0;
    return n <= eipMembersMax;
}

unsigned eipElementSize(const eipTemplates *templates, unsigned type)
{
    const eipTemplate *t;
    const eipType *row;

    if (eipIsStructure(type)) {
        t = templates->table[eipTemplateId(type)];
        return t ? t->size : 0;
    }
    row = eipTypeOf(eipElementCode(type));
    return row ? row->size : 0;
}

static const eipMember *memberOf(const eipTemplate *t, const char *name, size_t length)
{
    unsigned i;

    for (i = 0; i < t->count; i++)
        if (strlen(t->members[i].name) == length &&
            epicsStrnCaseCmp(t->members[i].name, name, length) == 0)
            return &t->members[i];
    return NULL;
}

/* This template must be known first. No template has the number 0. */
static int unknown(unsigned id)
{
    return id ? (int)id : -1;
}

/* "b[2].c": one name at a time. */
int eipMemberFind(const eipTemplates *templates, unsigned id, const char *path,
                  eipMemberPlace *place)
{
    const eipTemplate *t = templates->table[id];
    size_t n = strcspn(path, ".[");
    const eipMember *m;
    int more;

    if (!t)
        return unknown(id);
    m = memberOf(t, path, n);
    if (!m)
        return -1;
    place->offset += m->offset;
    place->type = m->type;
    place->elements = eipDimensions(m->type) ? m->info : 1;
    place->size = eipElementSize(templates, m->type);
    place->bit = !eipIsStructure(m->type) && eipElementCode(m->type) == eipBool &&
                         !eipDimensions(m->type)
                     ? (int)(m->info & 7)
                     : -1;
    if (eipIsStructure(m->type) && !place->size)
        return unknown(eipTemplateId(m->type));
    path += n;
    if (*path == '[') {
        char *end;
        unsigned long index = strtoul(path + 1, &end, 10);

        if (*end != ']' || index >= place->elements)
            return -1;
        place->offset += (epicsUInt32)index * place->size;
        place->elements = 1;
        path = end + 1;
    }
    if (!*path)
        return place->size ? 0 : -1;
    if (*path != '.' || !eipIsStructure(place->type))
        return -1;
    more = eipMemberFind(templates, eipTemplateId(place->type), path + 1, place);
    return more;
}
