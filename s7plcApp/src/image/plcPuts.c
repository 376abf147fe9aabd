/* Puts on their way; see plcPuts.h. */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <ellLib.h>

#include "plcPuts.h"

/* One put; its bytes, and its mask where it has one, stand behind it. */
typedef struct entry {
    ELLNODE node;
    epicsUInt64 first, last; /* its number, and the first of those whose place it took */
    size_t offset, length;
    int edges;
    int cancelled; /* under way: it does not wait again */
    int masked;
    epicsUInt8 bytes[1]; /* length, and as many again for the mask */
} entry;

struct plcPuts {
    size_t size, room; /* bytes in use, and at most: puts may lie behind those in use */
    unsigned most;
    ELLLIST waiting, underWay;
    epicsUInt64 number; /* of the last */
    epicsUInt64 dropped;
    int away;
    entry **newest; /* for each offset: the last put that begins there and waits, or NULL */
};

plcPuts *plcPutsCreate(size_t size, unsigned most)
{
    plcPuts *p = callocMustSucceed(1, sizeof(*p), "plcPutsCreate");

    p->size = p->room = size;
    p->most = most;
    p->newest = callocMustSucceed(size + 1, sizeof(*p->newest), "plcPutsCreate");
    return p;
}

void plcPutsUse(plcPuts *p, size_t size)
{
    p->size = size;
}

void plcPutsDestroy(plcPuts *p)
{
    if (!p)
        return;
    ellFree(&p->waiting);
    ellFree(&p->underWay);
    free(p->newest);
    free(p);
}

/* --- Entries -----------------------------------------------------------------------------*/

static epicsUInt8 *maskOf(entry *e)
{
    return e->masked ? e->bytes + e->length : NULL;
}

static plcPut viewOf(entry *e)
{
    return (plcPut){e->offset, e->length, e->bytes, maskOf(e)};
}

static int samePlace(entry *e, const plcPut *put)
{
    if (e->offset != put->offset || e->length != put->length || e->masked != !!put->mask)
        return 0;
    return !put->mask || memcmp(maskOf(e), put->mask, e->length) == 0;
}

static entry *entryOf(const plcPut *put, int edges, epicsUInt64 number)
{
    entry *e = callocMustSucceed(1, sizeof(*e) + 2 * put->length, "plcPuts");

    *e = (entry){.first = number, .last = number, .offset = put->offset,
                 .length = put->length, .edges = edges, .masked = put->mask != NULL};
    memcpy(e->bytes, put->data, put->length);
    if (put->mask)
        memcpy(maskOf(e), put->mask, put->length);
    return e;
}

/* An entry leaves the list of those that wait. */
static void unlinkEntry(plcPuts *p, entry *e)
{
    entry *before = (entry *)ellPrevious(&e->node);

    if (p->newest[e->offset] == e) {
        while (before && before->offset != e->offset)
            before = (entry *)ellPrevious(&before->node);
        p->newest[e->offset] = before;
    }
    ellDelete(&p->waiting, &e->node);
}

static void dropEntry(plcPuts *p, entry *e)
{
    unlinkEntry(p, e);
    free(e);
}

/* Of each place the newest remains, in the order in which these were made. */
static void thinOut(plcPuts *p)
{
    entry *e = (entry *)ellLast(&p->waiting), *before, *other;
    plcPut view;

    for (; e; e = before) {
        before = (entry *)ellPrevious(&e->node);
        other = p->newest[e->offset];
        view = viewOf(e);
        while (!samePlace(other, &view)) /* e at the latest */
            other = (entry *)ellPrevious(&other->node);
        if (other != e) {
            dropEntry(p, e);
            p->dropped++;
        }
    }
}

/* --- What is put -------------------------------------------------------------------------*/

/* The place of a put that waits is taken by this one. Returns 1 when there is such a one. */
static int takesPlace(plcPuts *p, const plcPut *put, int edges)
{
    entry *e = p->newest[put->offset];

    if (!e || !samePlace(e, put))
        return 0;
    if (p->away) {
        dropEntry(p, e); /* the new one is the last of all */
        return 0;
    }
    if (&e->node != ellLast(&p->waiting))
        return 0;
    if ((edges || e->edges) && memcmp(e->bytes, put->data, put->length) != 0)
        return 0;
    memcpy(e->bytes, put->data, put->length);
    e->last = p->number;
    return 1;
}

epicsUInt64 plcPutsAdd(plcPuts *p, const plcPut *put, int edges)
{
    entry *e;

    p->number++;
    if (put->length == 0 || takesPlace(p, put, edges))
        return p->number;
    if ((unsigned)ellCount(&p->waiting) >= p->most)
        thinOut(p);
    e = entryOf(put, edges, p->number);
    ellAdd(&p->waiting, &e->node);
    p->newest[e->offset] = e;
    return p->number;
}

void plcPutsAway(plcPuts *p, int away)
{
    epicsUInt64 dropped = p->dropped;

    p->away = away;
    if (away)
        thinOut(p);
    p->dropped = dropped; /* none of these was too many */
}

/* Takes bits out of an entry; without `mask` all that lie in the bytes. Returns 1 when none is
 * left. */
static int without(entry *e, size_t offset, size_t length, const epicsUInt8 *mask)
{
    size_t i, at;
    epicsUInt8 any = 0, *bits;

    if (e->offset + e->length <= offset || offset + length <= e->offset)
        return 0;
    if (!e->masked) {
        e->masked = 1;
        memset(maskOf(e), 0xff, e->length);
    }
    bits = maskOf(e);
    for (i = 0; i < e->length; i++) {
        at = e->offset + i;
        if (at >= offset && at < offset + length)
            bits[i] &= mask ? (epicsUInt8)~mask[at - offset] : 0;
        any |= bits[i];
    }
    return !any;
}

void plcPutsVoid(plcPuts *p, size_t offset, size_t length, const void *mask)
{
    entry *e, *next;

    for (e = (entry *)ellFirst(&p->waiting); e; e = next) {
        next = (entry *)ellNext(&e->node);
        if (without(e, offset, length, mask))
            dropEntry(p, e);
    }
}

void plcPutsVoidAll(plcPuts *p)
{
    ELLNODE *node;

    for (node = ellFirst(&p->waiting); node; node = ellNext(node))
        p->newest[((entry *)node)->offset] = NULL;
    ellFree(&p->waiting);
}

int plcPutsAhead(plcPuts *p, const void *image, const void *mask)
{
    const epicsUInt8 *bits = mask;
    plcPut all = {0, p->size, image, mask};
    epicsUInt8 *waiting;
    entry *e;
    size_t i;
    int any = 0;

    if (p->size == 0)
        return 0;
    waiting = callocMustSucceed(1, p->room, "plcPutsAhead");
    plcPutsBits(p, waiting);
    e = entryOf(&all, 1, 0);
    for (i = 0; i < p->size; i++)
        any |= maskOf(e)[i] = (epicsUInt8)(bits[i] & ~waiting[i]);
    free(waiting);
    if (!any) {
        free(e);
        return 0;
    }
    e->first = e->last = plcPutsThrough(p) + 1; /* nobody waits for it */
    ellInsert(&p->waiting, NULL, &e->node);
    if (!p->newest[0])
        p->newest[0] = e;
    return 1;
}

/* --- What leaves -------------------------------------------------------------------------*/

/* True when it would change a bit that is taken already. */
static int changes(entry *e, const epicsUInt8 *values, const epicsUInt8 *mask)
{
    size_t i, at;

    for (i = 0; i < e->length; i++) {
        at = e->offset + i;
        if ((e->bytes[i] ^ values[at]) & mask[at] & (e->masked ? maskOf(e)[i] : 0xff))
            return 1;
    }
    return 0;
}

static void take(entry *e, epicsUInt8 *values, epicsUInt8 *mask)
{
    size_t i, at;
    epicsUInt8 bits;

    for (i = 0; i < e->length; i++) {
        at = e->offset + i;
        bits = e->masked ? maskOf(e)[i] : 0xff;
        values[at] = (epicsUInt8)((values[at] & ~bits) | (e->bytes[i] & bits));
        mask[at] |= bits;
    }
}

unsigned plcPutsTake(plcPuts *p, int (*joins)(void *arg, const plcPut *put), void *arg,
                     void *values, void *mask)
{
    entry *e;
    plcPut view;
    unsigned count = 0;

    if (ellCount(&p->underWay))
        return 0;
    while ((e = (entry *)ellFirst(&p->waiting))) {
        view = viewOf(e);
        /* The first is asked too, so that joins() knows it. */
        if (joins && !joins(arg, &view) && count)
            break;
        if (count && (!joins || changes(e, values, mask)))
            break;
        unlinkEntry(p, e);
        take(e, values, mask);
        ellAdd(&p->underWay, &e->node);
        count++;
    }
    return count;
}

void plcPutsDone(plcPuts *p)
{
    ellFree(&p->underWay);
}

void plcPutsBack(plcPuts *p)
{
    entry *e;

    while ((e = (entry *)ellLast(&p->underWay))) {
        ellDelete(&p->underWay, &e->node);
        if (e->cancelled) {
            free(e);
            continue;
        }
        ellInsert(&p->waiting, NULL, &e->node);
        if (!p->newest[e->offset])
            p->newest[e->offset] = e;
    }
    if (p->away)
        plcPutsAway(p, 1);
}

void plcPutsEnd(plcPuts *p, const void *mask)
{
    entry *e, *next;

    for (e = (entry *)ellFirst(&p->underWay); e; e = next) {
        next = (entry *)ellNext(&e->node);
        if (!without(e, 0, p->room, mask))
            continue;
        ellDelete(&p->underWay, &e->node);
        free(e);
    }
}

static entry *findNumber(ELLLIST *list, epicsUInt64 number)
{
    entry *e = (entry *)ellFirst(list);

    while (e && (number < e->first || number > e->last))
        e = (entry *)ellNext(&e->node);
    return e;
}

plcPutFate plcPutsCancel(plcPuts *p, epicsUInt64 number)
{
    entry *e = findNumber(&p->underWay, number);

    if (e) {
        e->cancelled = e->last == number;
        return plcPutMaybe;
    }
    e = findNumber(&p->waiting, number);
    if (!e)
        return plcPutsThrough(p) >= number ? plcPutThrough : plcPutNever;
    if (e->last == number)
        dropEntry(p, e);
    return plcPutNever;
}

unsigned plcPutsCount(const plcPuts *p)
{
    return (unsigned)(ellCount(&p->waiting) + ellCount(&p->underWay));
}

static void addBits(const ELLLIST *list, epicsUInt8 *mask)
{
    ELLNODE *node;
    size_t i;

    for (node = ellFirst(list); node; node = ellNext(node)) {
        entry *e = (entry *)node;

        for (i = 0; i < e->length; i++)
            mask[e->offset + i] |= e->masked ? maskOf(e)[i] : 0xff;
    }
}

int plcPutsOverlay(const plcPuts *p, size_t offset, size_t length, const void *mask, void *bytes)
{
    const epicsUInt8 *wanted = mask;
    epicsUInt8 *to = bytes, bits;
    ELLNODE *node;
    size_t i, at;
    int any = 0;

    for (node = ellFirst(&p->waiting); node; node = ellNext(node)) {
        entry *e = (entry *)node;

        for (i = 0; i < e->length; i++) {
            at = e->offset + i;
            if (at < offset || at - offset >= length)
                continue;
            bits = (epicsUInt8)((e->masked ? maskOf(e)[i] : 0xff) &
                                (wanted ? wanted[at - offset] : 0xff));
            any |= bits;
            if (to)
                to[at - offset] = (epicsUInt8)((to[at - offset] & ~bits) | (e->bytes[i] & bits));
        }
    }
    return any != 0;
}

void plcPutsBits(const plcPuts *p, void *mask)
{
    addBits(&p->underWay, mask);
    addBits(&p->waiting, mask);
}

epicsUInt64 plcPutsThrough(const plcPuts *p)
{
    const entry *e = (const entry *)ellFirst(&p->underWay);

    if (!e)
        e = (const entry *)ellFirst(&p->waiting);
    return e ? e->first - 1 : p->number;
}

epicsUInt64 plcPutsDropped(const plcPuts *p)
{
    return p->dropped;
}
