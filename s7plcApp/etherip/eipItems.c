/* What was put becomes items, each of which one service writes; see eipWorkerPvt.h. Knows the tags and
 * what records have put, nothing of messages. All functions run in the worker's thread.
 *
 * A value that was put whole is written as an element, several beside each other as one
 * service; single bits by read-modify-write, so that nothing else of the element changes.
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>

#include "eipWorkerPvt.h"

/* Bits of the puts that this wish has. */
static int hasPut(const eipWorker *w, const eipWant *want)
{
    size_t i;

    for (i = 0; i < want->room; i++)
        if (w->leaving[want->place + i])
            return 1;
    return 0;
}

int eipItemsSettle(eipWorker *w, const eipWant *want, const char *reason)
{
    epicsUInt8 *mask = w->leaving + want->place;
    int changed;
    size_t i;

    if (reason) {
        plcImagePutsFail(w->setup.out, want->place, want->room, mask, reason);
        changed = plcFaultsSet(w->setup.outFaults, want->place, want->room, mask, reason);
    } else {
        changed = plcFaultsClear(w->setup.outFaults, want->place, want->room, mask);
    }
    for (i = 0; i < want->room; i++) {
        size_t at = want->place + i;

        if (reason) {
            w->back[at] &= (epicsUInt8)~mask[i];
            w->unread[at] &= (epicsUInt8)~mask[i]; /* the PLC holds what it held */
            continue;
        }
        w->written[at] |= mask[i];
        w->unread[at] |= mask[i];
        w->holds[at] = (epicsUInt8)((w->holds[at] & ~mask[i]) | (w->values[at] & mask[i]));
    }
    w->refused |= reason != NULL;
    memset(mask, 0, want->room);
    if (!eipWorkerEnter(w))
        return 0;
    w->news.outFaults |= changed || reason || want->shared; /* another put, or others follow */
    w->hasNews = 1;
    epicsMutexUnlock(w->lock);
    return changed;
}

static eipItem *addItem(eipBatch *b, eipItemKind kind, unsigned tag, unsigned want,
                        const eipWant *wish, size_t length)
{
    eipItem *it;

    if (b->count == b->room) {
        b->room = b->room * 2 + 16;
        b->items = realloc(b->items, b->room * sizeof(*b->items));
        if (!b->items)
            cantProceed("etherip: no memory for %u writes\n", b->room);
    }
    it = &b->items[b->count++];
    *it = (eipItem){kind, tag, want, 1, wish->index, NULL, length, 1};
    it->bytes = callocMustSucceed(1, length + 8, "etherip");
    return it;
}

/* The number that stands in a cell. */
static eipNumber numberOf(const epicsUInt8 *place)
{
    epicsUInt64 bits = eipGetUnsigned(place + eipPlaceHead, 8);
    eipNumber number = {(eipKind)place[eipPlaceKindAt], {0}};

    if (number.kind != eipReal && number.kind != eipUnsigned)
        number.kind = eipSigned;
    memcpy(&number.u, &bits, sizeof(bits));
    return number;
}

/* Joins the element to the item before, when it follows it. */
static int join(eipWorker *w, eipBatch *b, unsigned tag, unsigned want, const epicsUInt8 *raw,
                unsigned size)
{
    eipItem *it = b->count ? &b->items[b->count - 1] : NULL;
    unsigned fits = w->limits.room - eipWriteHead - 2 -
                    (unsigned)eipPathBytes(w->tags.tags[tag].base, 0) - 6;

    if (!it || it->kind != eipItemElements || it->tag != tag || it->want + it->wants != want ||
        it->index + it->count != w->tags.wants[want].index ||
        it->length + size > fits)
        return 0;
    it->bytes = realloc(it->bytes, it->length + size + 8);
    if (!it->bytes)
        cantProceed("etherip: no memory for a write\n");
    memcpy(it->bytes + it->length, raw, size);
    it->length += size;
    it->count++;
    it->wants++;
    return 1;
}

static const char *noFit(eipWorker *w, const eipType *type)
{
    epicsSnprintf(w->noFit, sizeof(w->noFit), "the value does not fit %.12s", type->name);
    return w->noFit;
}

/* A cell: a whole number, or some bits of it. Returns why not, or NULL. */
static const char *cellItem(eipWorker *w, eipBatch *b, unsigned tag, unsigned want)
{
    const eipWant *wish = &w->tags.wants[want];
    const eipTag *t = &w->tags.tags[tag];
    const eipType *type = eipTypeOf(t->code);
    const epicsUInt8 *mask = w->leaving + wish->place, *place = w->values + wish->place;
    epicsUInt64 bits = eipGetUnsigned(mask + eipPlaceHead, 8);
    eipNumber number = numberOf(place);
    epicsUInt8 raw[8];
    eipItem *it;

    if (!type || !type->size)
        return "the tag is no number";
    if (!bits) { /* only what kind of number will come */
        eipItemsSettle(w, wish, NULL);
        return NULL;
    }
    if (bits == ~(epicsUInt64)0 || type->code == eipBool) {
        if (type->code == eipBool && bits != ~(epicsUInt64)0)
            number.u.integer &= (epicsInt64)bits;
        if (eipNumberPut(type, raw, &number))
            return noFit(w, type);
        if (!wish->alone && join(w, b, tag, want, raw, type->size))
            return NULL;
        it = addItem(b, eipItemElements, tag, want, wish, type->size);
        memcpy(it->bytes, raw, type->size);
        return NULL;
    }
    if (type->kind == eipReal)
        return "a real number has no bits";
    it = addItem(b, eipItemBits, tag, want, wish, 2 * type->size);
    memcpy(it->bytes, place + eipPlaceHead, type->size);
    memcpy(it->bytes + type->size, mask + eipPlaceHead, type->size);
    return NULL;
}

/* Strings are written whole: what is behind the text is 0. */
static const char *textItem(eipWorker *w, eipBatch *b, unsigned tag, unsigned want)
{
    const eipWant *wish = &w->tags.wants[want];
    const eipTag *t = &w->tags.tags[tag];
    const eipType *type = eipTypeOf(t->code);
    const epicsUInt8 *place = w->values + wish->place;
    size_t n = (size_t)eipGetUnsigned(place + eipPlaceCountAt, 4);
    size_t length = t->code == eipStructureCode ? t->size : n + 2;
    eipItem *it;

    if (!type || type->size)
        return "the tag is no string";
    /* Its length and text would lie over the first members of any other structure. */
    if (t->code == eipStructureCode && !t->characters)
        return "a structure not known as a string";
    if (n > wish->room - eipPlaceHead)
        n = wish->room - eipPlaceHead;
    it = addItem(b, eipItemText, tag, want, wish, length);
    it->length = eipTextPut(t->code, it->bytes, length, t->characters,
                            (const char *)place + eipPlaceHead, n);
    if (it->length)
        return NULL;
    free(it->bytes);
    b->count--;
    return "the text is too long for the tag";
}

/* An array, element by element, from the type of the record to that of the tag. */
static const char *arrayItem(eipWorker *w, eipBatch *b, unsigned tag, unsigned want)
{
    const eipWant *wish = &w->tags.wants[want];
    const eipTag *t = &w->tags.tags[tag];
    const eipType *type = eipTypeOf(t->code);
    const epicsUInt8 *place = w->values + wish->place;
    size_t n = (size_t)eipGetUnsigned(place + eipPlaceCountAt, 4), i;
    eipType from = {"", 0, (eipKind)place[eipPlaceKindAt], place[eipPlaceSizeAt]};
    eipItem *it;

    if (!type || !type->size)
        return "the tag is no array of numbers";
    if (!from.size || from.size > 8 || n > (wish->room - eipPlaceHead) / from.size)
        return "no array was put";
    it = addItem(b, eipItemArray, tag, want, wish, n * type->size);
    it->count = (unsigned)n;
    for (i = 0; i < n; i++) {
        eipNumber number;

        eipNumberGet(&from, place + eipPlaceHead + i * from.size, &number);
        if (eipNumberAs(type, &from, &number, w->noFit, sizeof(w->noFit)) ||
            eipNumberPut(type, it->bytes + i * type->size, &number)) {
            free(it->bytes);
            b->count--;
            return noFit(w, type);
        }
    }
    return NULL;
}

/* The tag of a wish: wishes of a tag stand together. */
static unsigned tagOf(const eipWorker *w, unsigned want)
{
    unsigned low = 0, high = w->tags.tagCount;

    while (high - low > 1) {
        unsigned middle = low + (high - low) / 2;

        if (w->tags.tags[middle].from <= want)
            low = middle;
        else
            high = middle;
    }
    return low;
}

void eipItemsAdd(eipWorker *w, eipBatch *b, unsigned want)
{
    unsigned tag = tagOf(w, want);
    const eipTag *t = &w->tags.tags[tag];
    const eipWant *wish = &w->tags.wants[want];
    const char *why;

    if (w->queued[want] || !hasPut(w, wish))
        return;
    w->queued[want] = 1;
    if (t->state != eipTagKnown)
        why = t->state == eipTagBad ? t->reason : "the tag is another one now";
    else if (wish->kind == eipCell)
        why = cellItem(w, b, tag, want);
    else
        why = wish->kind == eipTextPlace ? textItem(w, b, tag, want)
                                         : arrayItem(w, b, tag, want);
    if (why)
        eipItemsSettle(w, wish, why);
}

void eipBatchFree(eipBatch *b)
{
    unsigned i;

    for (i = 0; i < b->count; i++)
        free(b->items[i].bytes);
    free(b->items);
}
