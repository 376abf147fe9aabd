/* The tags of one PLC: wishes, and what is known; see eipTags.h. Units: eipUnits.c. */
#include <stdlib.h>

#include <cantProceed.h>
#include <epicsStdio.h>
#include <epicsString.h>

#include "eipTags.h"

void eipTagsInit(eipTags *t)
{
    memset(t, 0, sizeof(*t));
    t->templates = calloc(1, sizeof(*t->templates));
}

static void freeUnits(eipTags *t)
{
    unsigned i;

    for (i = 0; i < t->unitCount; i++)
        free(t->units[i].whole);
    t->unitCount = t->pieceCount = 0;
}

static void freeWants(eipWant *wants, unsigned count)
{
    unsigned i;

    for (i = 0; i < count; i++)
        free(wants[i].tag);
    free(wants);
}

void eipTagsFree(eipTags *t)
{
    freeUnits(t);
    freeWants(t->wants, t->wantCount);
    free(t->tags);
    free(t->units);
    free(t->pieces);
    if (t->templates)
        eipTemplatesClear(t->templates);
    free(t->templates);
    memset(t, 0, sizeof(*t));
}

/* --- Wishes -------------------------------------------------------------------------------- */

/* Names of tags are the same in upper and lower case. */
static int byTag(const eipWant *a, const eipWant *b)
{
    int order = epicsStrCaseCmp(a->tag, b->tag);

    if (!order)
        order = a->alone - b->alone;
    return order ? order : a->indexed - b->indexed;
}

static int byWish(const void *a, const void *b)
{
    const eipWant *x = a, *y = b;
    int order = byTag(x, y);

    if (order)
        return order;
    if (x->index != y->index)
        return x->index < y->index ? -1 : 1;
    return x->place < y->place ? -1 : x->place > y->place;
}

static int byBase(const void *a, const void *b)
{
    const eipTag *x = a, *y = b;
    int order = epicsStrCaseCmp(x->base, y->base);

    if (!order)
        order = x->alone - y->alone;
    return order ? order : x->indexed - y->indexed;
}

/* A wish to be read alone is a tag of its own. */
static int sameTag(const eipWant *a, const eipWant *b)
{
    return !a->alone && byTag(a, b) == 0;
}

static void forget(eipTag *tag)
{
    tag->state = eipTagNew;
    tag->reason[0] = 0;
    tag->retry = 0;
    tag->elements = tag->instance = 0;
    tag->code = tag->handle = tag->size = tag->template = tag->characters = 0;
    tag->plain = 0;
    tag->apart = 0;
}

/* What was refused by itself is not asked for at once because others come or go. */
static void keepRefused(const eipTags *t, eipWant *wants, unsigned count)
{
    const eipWant *old;
    unsigned i;

    for (i = 0; i < count && t->wantCount; i++) {
        old = bsearch(&wants[i], t->wants, t->wantCount, sizeof(*old), byWish);
        wants[i].refused = old && !wants[i].fresh ? old->refused : 0;
    }
}

void eipTagSetState(eipTags *t, eipTag *tag, eipTagState state)
{
    t->unknown += (state == eipTagNew) - (tag->state == eipTagNew);
    tag->state = state;
}

void eipTagsSet(eipTags *t, eipWant *wants, unsigned count)
{
    eipTag *tags = callocMustSucceed(count + 1, sizeof(*tags), "etherip"), *old;
    unsigned n = 0, i;

    if (count)
        qsort(wants, count, sizeof(*wants), byWish);
    t->unknown = 0;
    for (i = 0; i < count; i++) {
        eipTag *tag = n ? &tags[n - 1] : NULL;

        if (!tag || !sameTag(&wants[tag->from], &wants[i])) {
            tag = &tags[n++];
            tag->base = wants[i].tag;
            tag->alone = wants[i].alone;
            tag->indexed = wants[i].indexed;
            tag->from = i;
            tag->period = wants[i].period;
        }
        tag->wants++;
        tag->array |= wants[i].element || wants[i].index || wants[i].count > 1;
        if (wants[i].period < tag->period)
            tag->period = wants[i].period;
    }
    for (i = 0; i < n; i++) {
        old = t->tagCount ? bsearch(&tags[i], t->tags, t->tagCount, sizeof(*old), byBase)
                          : NULL;
        if (old) {
            eipTag now = tags[i];

            tags[i] = *old;
            tags[i].base = now.base;
            tags[i].from = now.from;
            tags[i].wants = now.wants;
            tags[i].array = now.array;
            tags[i].period = now.period;
        }
        t->unknown += tags[i].state == eipTagNew;
    }
    keepRefused(t, wants, count);
    freeUnits(t);
    freeWants(t->wants, t->wantCount);
    free(t->tags);
    t->wants = wants;
    t->wantCount = count;
    t->tags = tags;
    t->tagCount = n;
}

void eipTagsForget(eipTags *t)
{
    unsigned i;

    for (i = 0; i < t->tagCount; i++)
        forget(&t->tags[i]);
    for (i = 0; i < t->wantCount; i++)
        t->wants[i].refused = 0;
    t->unknown = t->tagCount;
    freeUnits(t);
    if (t->templates)
        eipTemplatesClear(t->templates);
}

/* --- What the list tells ------------------------------------------------------------------- */

static int rootOrder(const eipTag *tag, const char *root, size_t length)
{
    return epicsStrnCaseCmp(tag->base, root, length);
}

/* Tags are sorted without regard to case, and '.' and '[' sort before letters: those of a
 * root stand together, but "ab" may stand among those of "a". */
int eipTagsOfRoot(const eipTags *t, const char *root, size_t length, unsigned *at)
{
    unsigned low = *at, high = t->tagCount;

    while (low < high) {
        unsigned middle = low + (high - low) / 2;

        if (rootOrder(&t->tags[middle], root, length) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    for (; low < t->tagCount && rootOrder(&t->tags[low], root, length) == 0; low++)
        if (eipNameRoot(t->tags[low].base) == length) {
            *at = low + 1;
            return (int)low;
        }
    return -1;
}

unsigned eipTagsListed(eipTags *t, const eipSymbol *symbol, const char *program)
{
    char root[2 * eipSymbolNameMax + 2];
    unsigned at = 0, n = 0;
    int i;

    epicsSnprintf(root, sizeof(root), "%s%s%s", program ? program : "", program ? "." : "",
                  symbol->name);
    while ((i = eipTagsOfRoot(t, root, strlen(root), &at)) >= 0) {
        eipTag *tag = &t->tags[i];

        n++;
        if (!program)
            tag->instance = symbol->id;
        if (eipIsStructure(symbol->type))
            tag->template = eipTemplateId(symbol->type);
        if (!tag->base[strlen(root)] && eipDimensions(symbol->type) == 1)
            tag->elements = symbol->dimension[0];
        else if (!tag->base[strlen(root)] && eipDimensions(symbol->type) == 0)
            tag->elements = 1;
    }
    return n;
}

/* --- Answers of reads ---------------------------------------------------------------------- */

int eipDataTake(const eipAnswer *answer, eipData *data)
{
    eipReader r = eipReaderOf(answer->data, answer->length);

    data->code = eipTake16(&r);
    data->handle = data->code == eipStructureCode ? eipTake16(&r) : 0;
    data->bytes = r.at;
    data->length = r.left;
    return r.bad || !eipTypeOf(data->code) ? -1 : 0;
}

static void bad(eipTags *t, eipTag *tag, const char *reason)
{
    eipTagSetState(t, tag, eipTagBad);
    epicsSnprintf(tag->reason, sizeof(tag->reason), "PLC: %.34s", reason);
}

void eipTagLearn(eipTags *t, eipTag *tag, const eipAnswer *answer)
{
    const eipType *type;
    eipData data;
    char text[64];

    if (answer->status && answer->status != eipPartial) {
        eipStatusText(answer->status, answer->extended, text, sizeof(text));
        if (tag->indexed && (answer->status == eipPathSegment || answer->status == eipPathUnknown))
            epicsSnprintf(text, sizeof(text), "no such tag or dimension (%02X)", answer->status);
        else if (strchr(tag->base, '[') && answer->status == eipPathUnknown)
            epicsSnprintf(text, sizeof(text), "no such tag or index (%02X)", answer->status);
        bad(t, tag, text);
        return;
    }
    if (eipDataTake(answer, &data)) {
        epicsSnprintf(text, sizeof(text), "type %04X is not known", data.code);
        bad(t, tag, text);
        return;
    }
    type = eipTypeOf(data.code);
    if (!data.length || (type->size && data.length < type->size)) {
        bad(t, tag, "answer without a value");
        return;
    }
    eipTagSetState(t, tag, eipTagKnown);
    tag->reason[0] = 0;
    tag->code = data.code;
    tag->handle = data.handle;
    tag->size = type->size ? type->size : (unsigned)data.length;
    if (data.code == eipStructureCode && data.handle == eipStringHandle)
        tag->characters = eipStringRoom;
}
