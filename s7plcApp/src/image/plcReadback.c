/* Read-back of outputs; see plcReadback.h. */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <ellLib.h>
#include <epicsAtomic.h>
#include <epicsMutex.h>

#include "plcHot.h"
#include "plcReadback.h"

typedef struct place {
    ELLNODE node;
    const void *key;
    size_t out, in, length;
    int masked;
    epicsUInt8 mask[PLC_MASK_MAX];
    /* tracking */
    int known;              /* ours is what the image held at the last look */
    epicsUInt64 pending;    /* when a write of ours was seen, 0: none on its way */
    epicsUInt8 *ours;
    epicsUInt8 *now;        /* room to look at the image */
} place;

struct plcReadback {
    epicsMutexId lock; /* guards the list and all places */
    ELLLIST places;
    int count; /* atomic: how many there are */
};

plcReadback *plcReadbackCreate(void)
{
    plcReadback *r = callocMustSucceed(1, sizeof(*r), "plcReadbackCreate");

    r->lock = epicsMutexMustCreate();
    ellInit(&r->places);
    return r;
}

static void freePlace(place *p)
{
    free(p->ours);
    free(p->now);
    free(p);
}

void plcReadbackDestroy(plcReadback *r)
{
    place *p;

    while ((p = (place *)ellGet(&r->places)))
        freePlace(p);
    epicsMutexDestroy(r->lock);
    free(r);
}

void plcReadbackRemove(plcReadback *r, const void *key)
{
    place *p;

    epicsMutexMustLock(r->lock);
    for (p = (place *)ellFirst(&r->places); p && p->key != key;
         p = (place *)ellNext(&p->node))
        ;
    if (p) {
        ellDelete(&r->places, &p->node);
        epicsAtomicDecrIntT(&r->count);
        freePlace(p);
    }
    epicsMutexUnlock(r->lock);
}

void plcReadbackAdd(plcReadback *r, const void *key, size_t out, size_t in, size_t length,
                    const void *mask)
{
    place *p = callocMustSucceed(1, sizeof(*p), "plcReadbackAdd");

    p->key = key;
    p->out = out;
    p->in = in;
    p->length = length;
    p->masked = mask != NULL;
    if (mask)
        memcpy(p->mask, mask, length);
    p->ours = callocMustSucceed(1, length + 1, "plcReadbackAdd");
    p->now = callocMustSucceed(1, length + 1, "plcReadbackAdd");
    epicsMutexMustLock(r->lock);
    ellAdd(&r->places, &p->node);
    epicsAtomicIncrIntT(&r->count);
    epicsMutexUnlock(r->lock);
}

PLC_HOT unsigned plcReadbackCount(plcReadback *r)
{
    return (unsigned)epicsAtomicGetIntT(&r->count);
}

/* Equal in the bits that count. */
static int equal(const place *p, const epicsUInt8 *a, const epicsUInt8 *b)
{
    size_t i;

    if (!p->masked)
        return memcmp(a, b, p->length) == 0;
    for (i = 0; i < p->length; i++)
        if ((a[i] ^ b[i]) & p->mask[i])
            return 0;
    return 1;
}

int plcReadbackSame(plcReadback *r, const void *block, plcImage *out)
{
    int same = 1;
    place *p;

    epicsMutexMustLock(r->lock);
    for (p = (place *)ellFirst(&r->places); p && same; p = (place *)ellNext(&p->node)) {
        plcImagePeek(out, p->out, p->length, p->now);
        same = equal(p, p->now, (const epicsUInt8 *)block + p->in);
    }
    epicsMutexUnlock(r->lock);
    return same;
}

/* The image holds the PLC's value at this place from now on. */
static void taken(place *p, plcImage *out)
{
    plcImagePeek(out, p->out, p->length, p->ours);
    p->known = 1;
    p->pending = 0;
}

unsigned plcReadbackTake(plcReadback *r, const void *block, plcImage *out)
{
    unsigned changed = 0;
    place *p;

    epicsMutexMustLock(r->lock);
    for (p = (place *)ellFirst(&r->places); p; p = (place *)ellNext(&p->node)) {
        changed += plcImageSet(out, p->out, p->length, (const epicsUInt8 *)block + p->in,
                               p->masked ? p->mask : NULL, NULL);
        taken(p, out);
    }
    epicsMutexUnlock(r->lock);
    return changed;
}

/* Returns 1 when the place took the PLC's value. */
static int trackPlace(place *p, const epicsUInt8 *shown, plcImage *out, epicsUInt64 now,
                      epicsUInt64 patience)
{
    plcImagePeek(out, p->out, p->length, p->now);
    if (!p->known || !equal(p, p->now, p->ours)) {
        p->pending = now;
        p->known = 1;
        memcpy(p->ours, p->now, p->length);
    }
    if (equal(p, p->now, shown)) {
        p->pending = 0;
        return 0;
    }
    if (p->pending && now - p->pending < patience)
        return 0;
    /* Not when a put came in this very moment: the next block will see it. */
    if (!plcImageSet(out, p->out, p->length, shown, p->masked ? p->mask : NULL, p->now))
        return 0;
    taken(p, out);
    return 1;
}

unsigned plcReadbackTrack(plcReadback *r, const void *block, plcImage *out,
                          epicsUInt64 now, epicsUInt64 patience)
{
    unsigned changed = 0;
    place *p;

    epicsMutexMustLock(r->lock);
    for (p = (place *)ellFirst(&r->places); p; p = (place *)ellNext(&p->node))
        changed += trackPlace(p, (const epicsUInt8 *)block + p->in, out, now, patience);
    epicsMutexUnlock(r->lock);
    return changed;
}
