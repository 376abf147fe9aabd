/* How the tags of a PLC are read: units of one service each, and what becomes of the data; see
 * eipTags.h. */
#include <stdlib.h>

#include <cantProceed.h>
#include <epicsStdio.h>
#include <epicsString.h>

#include "eipTags.h"

enum {
    wholeLeast = 3,   /* members of a structure that make it worth reading it whole */
    countBytes = 2,   /* of a read service */
    countMax = 65535,
    serviceHead = 2
};

/* --- Making --------------------------------------------------------------------------------- */

static eipUnit *addUnit(eipTags *t)
{
    if (t->unitCount == t->unitRoom) {
        t->unitRoom = t->unitRoom * 2 + 64;
        t->units = realloc(t->units, t->unitRoom * sizeof(*t->units));
        if (!t->units)
            cantProceed("etherip: no memory for %u units\n", t->unitRoom);
    }
    memset(&t->units[t->unitCount], 0, sizeof(*t->units));
    return &t->units[t->unitCount++];
}

static void addPiece(eipTags *t, eipUnit *u, eipPiece piece)
{
    if (t->pieceCount == t->pieceRoom) {
        t->pieceRoom = t->pieceRoom * 2 + 64;
        t->pieces = realloc(t->pieces, t->pieceRoom * sizeof(*t->pieces));
        if (!t->pieces)
            cantProceed("etherip: no memory for %u pieces\n", t->pieceRoom);
    }
    t->pieces[t->pieceCount++] = piece;
    u->pieces++;
}

static eipTextKind textOf(const eipTag *tag)
{
    if (tag->code != eipStructureCode || tag->characters)
        return eipTextYes;
    return tag->plain ? eipTextNo : eipTextPerhaps;
}

static void addWish(eipTags *t, eipUnit *u, unsigned want)
{
    const eipTag *tag = &t->tags[u->tag];

    addPiece(t, u,
             (eipPiece){want, (t->wants[want].index - u->first) * tag->size, tag->code,
                        tag->size, -1, textOf(tag), tag->characters});
}

static eipUnit *newUnit(eipTags *t, unsigned number, epicsUInt32 first, epicsUInt32 count)
{
    const eipTag *tag = &t->tags[number];
    eipUnit *u = addUnit(t);

    u->tag = number;
    u->first = first;
    u->count = count;
    u->size = tag->size;
    u->period = tag->period;
    u->from = t->pieceCount;
    return u;
}

/* What was refused by itself stays by itself. */
static void makeRefused(eipTags *t, unsigned number)
{
    const eipTag *tag = &t->tags[number];
    unsigned i;

    for (i = tag->from; i < tag->from + tag->wants; i++) {
        eipUnit *u;

        if (!t->wants[i].refused)
            continue;
        u = newUnit(t, number, t->wants[i].index, t->wants[i].count);
        u->refused = 1;
        if (u->period < eipRetryMs)
            u->period = eipRetryMs;
        addWish(t, u, i);
    }
}

/* Runs of the elements of one tag. */
static void makeRuns(eipTags *t, unsigned number)
{
    const eipTag *tag = &t->tags[number];
    const eipType *type = eipTypeOf(tag->code);
    unsigned n = 0, i, k, runs;
    epicsUInt32 *first = callocMustSucceed(tag->wants, sizeof(*first), "etherip");
    epicsUInt32 *count = callocMustSucceed(tag->wants, sizeof(*count), "etherip");
    unsigned *want = callocMustSucceed(tag->wants, sizeof(*want), "etherip");
    eipRun *run = callocMustSucceed(tag->wants, sizeof(*run), "etherip");

    for (i = tag->from; i < tag->from + tag->wants; i++) {
        if (t->wants[i].refused)
            continue;
        want[n] = i;
        first[n] = t->wants[i].index;
        count[n++] = t->wants[i].count;
    }
    /* strings whose size depends on their text have no places in an array */
    runs = eipRuns(first, count, n, tag->size,
                   type->size || tag->code == eipStructureCode ? countMax : 1, run);
    for (i = 0; i < runs; i++) {
        eipUnit *u = newUnit(t, number, run[i].first, run[i].count);

        for (k = 0; k < run[i].wants; k++)
            addWish(t, u, want[run[i].from + k]);
    }
    if (n < tag->wants)
        makeRefused(t, number);
    free(first);
    free(count);
    free(want);
    free(run);
}

/* The characters of "a.b[1].c" before the last point; 0: it is no member. */
static size_t parentLength(const char *base)
{
    const char *point = strrchr(base, '.');

    if (!point || (size_t)(point - base) < eipNameRoot(base))
        return 0;
    return (size_t)(point - base);
}

/* Where a member is in the structure that is its parent, and the handle of that. Returns 0
 * when all templates that tell are known. */
static int placeInParent(const eipTags *t, const eipTag *tag, eipMemberPlace *place,
                         const eipTemplate **parent)
{
    size_t root = eipNameRoot(tag->base), length = parentLength(tag->base);
    char path[eipNameMax + 1];
    const char *at;
    eipMemberPlace above = {0};
    unsigned id = tag->template;

    if (!length || !id)
        return -1;
    epicsSnprintf(path, sizeof(path), "%.*s", (int)length, tag->base);
    at = path + root;
    if (*at == '[')
        at += strcspn(at, "]") + 1;
    if (*at == '.') {
        if (eipMemberFind(t->templates, id, at + 1, &above) || !eipIsStructure(above.type))
            return -1;
        id = eipTemplateId(above.type);
    }
    *parent = t->templates->table[id];
    memset(place, 0, sizeof(*place));
    return *parent ? eipMemberFind(t->templates, id, tag->base + length + 1, place) : -1;
}

typedef struct member {
    eipMemberPlace place;
    const eipTemplate *parent;
} member;

/* Only numbers of one place each, and the type that the PLC has shown, are taken out of a
 * structure. */
static int canBeWhole(const eipTags *t, const eipTag *tag, member *m)
{
    const eipType *type = eipTypeOf(tag->code);
    unsigned i;

    if (tag->alone || tag->indexed || tag->apart || tag->state != eipTagKnown || !type ||
        placeInParent(t, tag, &m->place, &m->parent))
        return 0;
    if (m->place.size != tag->size)
        return 0;
    if (!eipIsStructure(m->place.type) && eipElementCode(m->place.type) != tag->code)
        return 0;
    for (i = 0; i < tag->wants; i++) {
        const eipWant *want = &t->wants[tag->from + i];

        if (want->refused)
            return 0;
        if ((epicsUInt64)want->index + want->count > m->place.elements &&
            !(want->index == 0 && want->count == 1))
            return 0;
    }
    return 1;
}

static unsigned readBytes(const eipTag *tag, const char *base, unsigned size)
{
    return 2 * eipMultipleEach + serviceHead + countBytes + eipAnswerHead + 2 + size +
           (unsigned)eipPathBytes(base, tag->instance);
}

/* Would these members, one by one, take more bytes than the whole structure? */
static int isCheaper(const eipTags *t, unsigned from, unsigned count,
                     const eipTemplate *parent, const char *base)
{
    unsigned whole = readBytes(&t->tags[from], base, parent->size + 2), apart = 0, i, k;

    for (i = from; i < from + count; i++) {
        const eipTag *tag = &t->tags[i];
        unsigned elements = 1;

        for (k = 0; k < tag->wants; k++) {
            const eipWant *want = &t->wants[tag->from + k];

            if (want->index + want->count > elements)
                elements = want->index + want->count;
        }
        apart += readBytes(tag, tag->base, elements * tag->size);
    }
    return whole < apart;
}

static void makeWhole(eipTags *t, unsigned from, unsigned count, const member *m,
                      const char *base)
{
    eipUnit *u = addUnit(t);
    unsigned i, k;

    u->tag = from;
    u->whole = epicsStrDup(base);
    u->handle = m->parent->handle;
    u->count = 1;
    u->size = m->parent->size;
    u->period = t->tags[from].period;
    u->from = t->pieceCount;
    for (i = 0; i < count; i++) {
        const eipTag *tag = &t->tags[from + i];

        for (k = 0; k < tag->wants; k++) {
            unsigned want = tag->from + k;

            addPiece(t, u,
                     (eipPiece){want,
                                m[i].place.offset + t->wants[want].index * tag->size,
                                tag->code, tag->size, m[i].place.bit, eipTextYes, 0});
        }
    }
}

/* Tags of one parent stand together. Makes a unit of as many as possible from `from` on.
 * Returns their number, 0: none. */
static unsigned tryWhole(eipTags *t, unsigned from)
{
    const char *first = t->tags[from].base;
    size_t length = parentLength(first);
    char base[eipNameMax + 1];
    member *members;
    unsigned n = 0, room = 0, i;

    if (!length)
        return 0;
    epicsSnprintf(base, sizeof(base), "%.*s", (int)length, first);
    for (i = from; i < t->tagCount && parentLength(t->tags[i].base) == length &&
                   epicsStrnCaseCmp(t->tags[i].base, first, length) == 0;
         i++)
        room++;
    if (room < wholeLeast)
        return 0;
    members = callocMustSucceed(room, sizeof(*members), "etherip");
    while (n < room && t->tags[from + n].period == t->tags[from].period &&
           canBeWhole(t, &t->tags[from + n], &members[n]))
        n++;
    if (n >= wholeLeast && isCheaper(t, from, n, members[0].parent, base))
        makeWhole(t, from, n, members, base);
    else
        n = 0;
    free(members);
    return n;
}

void eipUnitsMake(eipTags *t)
{
    unsigned i, n;

    for (i = 0; i < t->unitCount; i++)
        free(t->units[i].whole);
    t->unitCount = t->pieceCount = 0;
    for (i = 0; i < t->tagCount; i += n) {
        n = tryWhole(t, i);
        if (n)
            continue;
        n = 1;
        if (t->tags[i].state == eipTagKnown)
            makeRuns(t, i);
    }
}

/* The pieces of the second half are those of a new unit; what they read is counted anew. */
static void shrink(const eipTags *t, eipUnit *u)
{
    epicsUInt32 first = 0xffffffffu, end = 0;
    unsigned i;

    for (i = 0; i < u->pieces; i++) {
        const eipWant *want = &t->wants[t->pieces[u->from + i].want];

        if (want->index < first)
            first = want->index;
        if (want->index + want->count > end)
            end = want->index + want->count;
    }
    for (i = 0; i < u->pieces; i++) {
        eipPiece *p = &t->pieces[u->from + i];

        p->offset = (t->wants[p->want].index - first) * u->size;
    }
    u->first = first;
    u->count = end - first;
}

/* A structure that cannot be read whole is read member by member. */
static void dissolve(eipTags *t, unsigned unit)
{
    eipUnit u = t->units[unit];
    unsigned i;

    for (i = 0; i < u.pieces; i++) {
        eipPiece *p = &t->pieces[u.from + i];
        eipUnit *one = i ? addUnit(t) : &t->units[unit];
        unsigned tag = u.tag;

        while (t->tags[tag].from + t->tags[tag].wants <= p->want)
            tag++;
        t->tags[tag].apart = 1;
        memset(one, 0, sizeof(*one));
        one->tag = tag;
        one->first = t->wants[p->want].index;
        one->count = t->wants[p->want].count;
        one->size = t->tags[tag].size;
        one->period = u.period;
        one->from = u.from + i;
        one->pieces = 1;
        p->offset = 0;
        p->bit = -1;
    }
    free(u.whole);
}

int eipUnitSplit(eipTags *t, unsigned unit)
{
    eipUnit *u, *more;

    if (t->units[unit].whole) {
        dissolve(t, unit);
        return 1;
    }
    if (t->units[unit].pieces < 2)
        return 0;
    more = addUnit(t);
    u = &t->units[unit];
    *more = *u;
    u->pieces /= 2;
    more->from += u->pieces;
    more->pieces -= u->pieces;
    shrink(t, u);
    shrink(t, more);
    return 1;
}

/* --- Messages ------------------------------------------------------------------------------- */

static void putPath(eipWriter *w, const char *base, epicsUInt32 instance, epicsUInt32 index,
                    int hasElement, int service)
{
    epicsUInt8 path[eipPathMax + 16];
    eipWriter p = eipWriterOf(path, sizeof(path));

    if (eipPathPut(&p, base, instance))
        w->full = 1;
    if (hasElement)
        eipIndexPut(&p, index);
    eipRequestPut(w, (eipService)service, path, p.n);
}

/* Does the element stand in the path? The first one need not, but for Omron, to which an array
 * without an element is the whole. */
static int hasElement(const eipTags *t, const eipTag *tag, epicsUInt32 index)
{
    return index || tag->indexed || (t->omron && tag->array);
}

void eipTagPathPut(eipWriter *w, const eipTags *t, const eipTag *tag, epicsUInt32 index,
                   int service)
{
    putPath(w, tag->base, 0, index, hasElement(t, tag, index), service);
}

unsigned eipTagPathBytes(const eipTags *t, const eipTag *tag, epicsUInt32 index)
{
    return (unsigned)eipPathBytes(tag->base, 0) +
           (hasElement(t, tag, index) ? (unsigned)eipIndexBytes(index) : 0);
}

/* An array of Omron may begin at any number: one that is wanted is there rather than 0. */
static epicsUInt32 askedElement(const eipTags *t, const eipTag *tag)
{
    return t->omron && tag->wants ? t->wants[tag->from].index : 0;
}

void eipTagAskPut(eipWriter *w, const eipTags *t, const eipTag *tag)
{
    eipTagPathPut(w, t, tag, askedElement(t, tag), eipReadTag);
    eipPut16(w, 1);
}

unsigned eipTagAskBytes(const eipTags *t, const eipTag *tag)
{
    return eipTagPathBytes(t, tag, askedElement(t, tag));
}

static int unitHasElement(const eipTags *t, const eipUnit *u)
{
    return !u->whole && hasElement(t, &t->tags[u->tag], u->first);
}

void eipUnitPut(eipWriter *w, const eipTags *t, const eipUnit *u, int byInstance, long fragment)
{
    const eipTag *tag = &t->tags[u->tag];

    putPath(w, u->whole ? u->whole : tag->base, byInstance ? tag->instance : 0, u->first,
            unitHasElement(t, u), fragment < 0 ? eipReadTag : eipReadFragment);
    eipPut16(w, u->count);
    if (fragment >= 0)
        eipPut32(w, (epicsUInt32)fragment);
}

eipLoad eipUnitLoad(const eipTags *t, const eipUnit *u, int byInstance)
{
    const eipTag *tag = &t->tags[u->tag];
    int structure = u->whole || tag->code == eipStructureCode;
    epicsUInt64 data = (epicsUInt64)u->count * u->size;
    eipLoad load;

    load.request = serviceHead + countBytes +
                   (unsigned)eipPathBytes(u->whole ? u->whole : tag->base,
                                          byInstance ? tag->instance : 0) +
                   (unitHasElement(t, u) ? (unsigned)eipIndexBytes(u->first) : 0);
    data += eipAnswerHead + (structure ? 4 : 2) + (t->omron != 0); /* one byte is two there */
    load.answer = data > 0x7fffffff ? 0x7fffffff : (unsigned)data;
    return load;
}

/* --- Values --------------------------------------------------------------------------------- */

static void head(epicsUInt8 *place, unsigned code, unsigned kind, unsigned size, size_t count)
{
    eipSetUnsigned(place, 2, code);
    place[eipPlaceKindAt] = (epicsUInt8)kind;
    place[eipPlaceSizeAt] = (epicsUInt8)size;
    eipSetUnsigned(place + eipPlaceCountAt, 4, count);
}

const char eipNoArray[] = "the tag is no array of numbers";

static const char *storeCell(const eipPiece *p, const eipType *type, const epicsUInt8 *at,
                             epicsUInt8 *place)
{
    epicsUInt8 bit = p->bit >= 0 ? at[0] >> p->bit & 1 : 0;
    epicsUInt64 bits;
    eipNumber number;

    if (!type->size)
        return type->kind == eipStructure ? "the tag is a structure, no number"
                                          : "the tag is a string, no number";
    eipNumberGet(type, p->bit >= 0 ? &bit : at, &number);
    memcpy(&bits, &number.u, sizeof(bits));
    head(place, type->code, number.kind, type->size, 0);
    eipSetUnsigned(place + eipPlaceHead, 8, bits);
    return NULL;
}

static const char *storeText(const eipPiece *p, const eipType *type, const epicsUInt8 *at,
                             size_t length, epicsUInt8 *place, size_t room)
{
    const char *text;
    size_t n;

    if (type->size)
        return "the tag is a number, no string";
    text = eipTextGet(type->code, at, length, &n);
    if (!text || (p->characters && n > p->characters))
        return p->text == eipTextYes ? "its length is more than the string has"
                                     : "the tag is a structure, no string";
    if (n > room - eipPlaceHead)
        n = room - eipPlaceHead;
    head(place, type->code, eipText, 0, n);
    memset(place + eipPlaceHead, 0, room - eipPlaceHead);
    memcpy(place + eipPlaceHead, text, n);
    return NULL;
}

static const char *storeArray(const eipType *type, const epicsUInt8 *at, size_t count,
                              epicsUInt8 *place, size_t room)
{
    if (!type->size)
        return eipNoArray;
    if (count * type->size > room - eipPlaceHead)
        return "the array has no room";
    head(place, type->code, type->kind, type->size, count);
    memcpy(place + eipPlaceHead, at, count * type->size);
    return NULL;
}

const char *eipPieceStore(const eipTags *t, const eipPiece *p, const epicsUInt8 *data,
                          size_t length, epicsUInt8 *image)
{
    const eipWant *want = &t->wants[p->want];
    const eipType *type = eipTypeOf(p->code);
    epicsUInt8 *place = image + want->place;
    size_t need = (size_t)want->count * p->size;

    if (!type || p->offset > length)
        return "answer is too short";
    if (!type->size && want->kind == eipTextPlace)
        need = type->code == eipStructureCode ? p->size : 1;
    if (need > length - p->offset)
        return "answer is too short";
    switch (want->kind) {
    case eipCell:
        return storeCell(p, type, data + p->offset, place);
    case eipTextPlace:
        if (p->text == eipTextNo)
            return "the tag is a structure, no string";
        return storeText(p, type, data + p->offset,
                         type->code == eipStructureCode ? p->size : length - p->offset,
                         place, want->room);
    default:
        return storeArray(type, data + p->offset, want->count, place, want->room);
    }
}
