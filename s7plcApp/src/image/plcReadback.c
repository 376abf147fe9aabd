/* Read-back of outputs; see plcReadback.h. */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <ellLib.h>
#include <epicsAtomic.h>
#include <epicsMutex.h>

#include "plcHot.h"
#include "plcReadback.h"

/* Values of one place that may be under way at once; with more only time tells. */
#define UNDER_WAY 8

typedef struct place {
    ELLNODE node;
    const void *key;
    size_t out, in, length;
    int masked;
    epicsUInt8 mask[PLC_MASK_MAX];
    int taken;         /* it has taken the PLC's value, or was put to, since it was added */
    epicsUInt8 *ours;  /* what the image held at the last look, put or take */
    epicsUInt8 *shown; /* what the PLC showed last, while `seen` */
    int seen;
    epicsUInt8 *now;   /* room to look at the image */
    /* a put that the PLC has not shown yet */
    int waits;
    epicsUInt64 since; /* when it was made; once it has left: when it had */
    int left;
    size_t takes;      /* of the image, before the put */
    epicsUInt64 number; /* of the put; 0: it has none */
    int pushed;        /* it has made the last of: */
    int many;          /* (more are under way than there is room for) */
    unsigned count;    /* digests of what the PLC showed before, and of what left since; */
    unsigned reached;  /* it has shown so many of them for sure */
    epicsUInt64 values[UNDER_WAY];
} place;

struct plcReadback {
    epicsMutexId lock; /* guards the list and all places */
    ELLLIST places;
    int count;   /* atomic: how many there are */
    int fresh;   /* atomic: how many have taken no value yet */
    int noting;  /* atomic: puts are noted */
    int waiting; /* how many wait */
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
    free(p->shown);
    free(p->now);
    free(p);
}

/* The lock is held. */
static void setWaits(plcReadback *r, place *p, int waits)
{
    r->waiting += waits - p->waits;
    p->waits = waits;
}

/* The same. */
static void setTaken(plcReadback *r, place *p)
{
    if (!p->taken)
        epicsAtomicDecrIntT(&r->fresh);
    p->taken = 1;
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
        setTaken(r, p);
        setWaits(r, p, 0);
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
    p->shown = callocMustSucceed(1, length + 1, "plcReadbackAdd");
    p->now = callocMustSucceed(1, length + 1, "plcReadbackAdd");
    epicsMutexMustLock(r->lock);
    ellAdd(&r->places, &p->node);
    epicsAtomicIncrIntT(&r->count);
    epicsAtomicIncrIntT(&r->fresh);
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

/* The PLC shows this. The lock is held, here and below. */
static void show(place *p, const epicsUInt8 *shown)
{
    memcpy(p->shown, shown, p->length);
    p->seen = 1;
}

/* The image holds the PLC's value at this place from now on. */
static unsigned take(plcReadback *r, place *p, const epicsUInt8 *shown, plcImage *out)
{
    int changed = plcImageSet(out, p->out, p->length, shown, p->masked ? p->mask : NULL,
                              NULL);

    plcImagePeek(out, p->out, p->length, p->ours);
    show(p, shown);
    setTaken(r, p);
    setWaits(r, p, 0);
    return (unsigned)changed;
}

/* The PLC does not show it. */
static int isHidden(const place *p, const epicsUInt8 *hidden)
{
    size_t i;

    for (i = 0; hidden && i < p->length; i++)
        if (hidden[p->in + i] & (p->masked ? p->mask[i] : 0xff))
            return 1;
    return 0;
}

unsigned plcReadbackTake(plcReadback *r, const void *block, const void *hidden, plcImage *out)
{
    unsigned changed = 0;
    place *p;

    epicsMutexMustLock(r->lock);
    for (p = (place *)ellFirst(&r->places); p; p = (place *)ellNext(&p->node))
        if (!isHidden(p, hidden))
            changed += take(r, p, (const epicsUInt8 *)block + p->in, out);
    epicsMutexUnlock(r->lock);
    return changed;
}

unsigned plcReadbackTakeNew(plcReadback *r, const void *block, const void *hidden, plcImage *out)
{
    unsigned count = 0;
    place *p;

    if (!epicsAtomicGetIntT(&r->fresh))
        return 0;
    epicsMutexMustLock(r->lock);
    for (p = (place *)ellFirst(&r->places); p; p = (place *)ellNext(&p->node))
        if (!p->taken && !isHidden(p, hidden)) {
            take(r, p, (const epicsUInt8 *)block + p->in, out);
            count++;
        }
    epicsMutexUnlock(r->lock);
    return count;
}

/* --- Tracking ---------------------------------------------------------------------- */

/* Stands for the bits of the place that count: FNV-1a. */
static epicsUInt64 digest(const place *p, const epicsUInt8 *bytes)
{
    epicsUInt64 sum = 0xCBF29CE484222325ull;
    size_t i;

    for (i = 0; i < p->length; i++) {
        sum ^= p->masked ? bytes[i] & p->mask[i] : bytes[i];
        sum *= 0x100000001B3ull;
    }
    return sum;
}

/* p->ours is under way to the PLC, behind what is already. */
static void push(place *p)
{
    epicsUInt64 value = digest(p, p->ours);

    p->pushed = 0;
    if (p->count && p->values[p->count - 1] == value)
        return;
    p->pushed = p->count < UNDER_WAY;
    if (p->pushed)
        p->values[p->count++] = value;
    else
        p->many = 1;
}

/* A put has changed p->ours. What was put before and has not left never will. */
static void noteWrite(plcReadback *r, place *p, const plcWritten *written, epicsUInt64 now)
{
    if (!p->waits) {
        p->count = 0;
        p->many = 0;
        if (p->seen)
            p->values[p->count++] = digest(p, p->shown);
        p->reached = p->count;
    } else if (p->pushed && p->takes == written->takes && p->count > p->reached) {
        p->count--;
    }
    push(p);
    p->takes = written->takes;
    p->number = written->number;
    p->since = now;
    p->left = 0;
    setTaken(r, p);
    setWaits(r, p, 1);
}

/* True when the bytes written, only the bits in mask, are bits of the place. */
static int touches(const place *p, size_t offset, size_t length, const epicsUInt8 *mask)
{
    size_t i, first = offset > p->out ? offset : p->out;
    size_t end = offset + length < p->out + p->length ? offset + length : p->out + p->length;

    if (first >= end)
        return 0;
    for (i = first; i < end; i++)
        if ((p->masked ? p->mask[i - p->out] : 0xFF) & (mask ? mask[i - offset] : 0xFF))
            return 1;
    return 0;
}

void plcReadbackNote(plcReadback *r, int on)
{
    epicsAtomicSetIntT(&r->noting, on);
}

/* The lock is held. */
static void noteAll(plcReadback *r, plcImage *out, size_t offset, size_t length,
                    const void *mask, const plcWritten *written, epicsUInt64 now)
{
    place *p;

    for (p = (place *)ellFirst(&r->places); p; p = (place *)ellNext(&p->node))
        if (touches(p, offset, length, mask)) {
            plcImagePeek(out, p->out, p->length, p->ours);
            noteWrite(r, p, written, now);
        }
}

static int takesNotes(plcReadback *r)
{
    return epicsAtomicGetIntT(&r->noting) || epicsAtomicGetIntT(&r->fresh);
}

/* No block is judged between the write and the note: the locks are held. */
int plcReadbackWrite(plcReadback *r, plcReadback *more, plcImage *out, size_t offset,
                     size_t length, const void *src, const void *mask, plcWritten *written,
                     epicsUInt64 now)
{
    plcReadback *noting[2] = {takesNotes(r) ? r : NULL, takesNotes(more) ? more : NULL};
    int status, i;

    for (i = 0; i < 2; i++)
        if (noting[i])
            epicsMutexMustLock(noting[i]->lock);
    status = plcImageWrite(out, offset, length, src, mask, written);
    for (i = 0; i < 2; i++)
        if (noting[i] && status >= 0)
            noteAll(noting[i], out, offset, length, mask, written, now);
    for (i = 2; i-- > 0;)
        if (noting[i])
            epicsMutexUnlock(noting[i]->lock);
    return status;
}

void plcReadbackWait(plcReadback *r, plcImage *out, epicsUInt64 now, int leaves)
{
    plcWritten written = {.takes = plcImageTakes(out)};
    place *p;

    epicsMutexMustLock(r->lock);
    for (p = (place *)ellFirst(&r->places); p; p = (place *)ellNext(&p->node)) {
        p->seen = 0; /* what it has shown does not count any more */
        setWaits(r, p, 0);
        plcImagePeek(out, p->out, p->length, p->ours);
        noteWrite(r, p, &written, now);
        p->left = !leaves;
    }
    epicsMutexUnlock(r->lock);
}

unsigned plcReadbackWaiting(plcReadback *r)
{
    unsigned waiting;

    epicsMutexMustLock(r->lock);
    waiting = (unsigned)r->waiting;
    epicsMutexUnlock(r->lock);
    return waiting;
}

/* How far the PLC is for sure in the row of values under way. */
static void advance(place *p, const epicsUInt8 *shown)
{
    epicsUInt64 value = digest(p, shown);
    unsigned i = p->reached ? p->reached - 1 : 0;

    while (i < p->count && p->values[i] != value)
        i++;
    if (i < p->count)
        p->reached = i + 1;
}

/* True when the PLC has had time enough since the put has left. */
static int isOver(place *p, size_t takes, epicsUInt64 now, epicsUInt64 limit, int through)
{
    if (!p->left && through && takes > p->takes) {
        p->left = 1;
        p->since = now;
    }
    return p->left && now > p->since && now - p->since >= limit;
}

/* What is shown of the place was read after its put was through. */
static int isAfter(const place *p, const plcShownAfter *after)
{
    return p->number <= after->through && !isHidden(p, after->older);
}

/* What is the same for all places of a block. */
typedef struct look {
    size_t takes;
    epicsUInt64 now, limit;
    int through;
    const plcShownAfter *after;
} look;

/* True when the PLC's value counts again. What is shown before the put has left is an older one of
 * the same value. */
static int isDone(place *p, const epicsUInt8 *shown, int same, const look *l)
{
    if (l->after)
        return isAfter(p, l->after);
    advance(p, shown);
    return (same && (p->left || l->takes > p->takes) && p->reached == p->count && !p->many) ||
           isOver(p, l->takes, l->now, l->limit, l->through);
}

/* Returns 1 when the place took the PLC's value: another one, or its first. */
static unsigned trackPlace(plcReadback *r, place *p, const epicsUInt8 *shown, plcImage *out,
                           const look *l)
{
    plcWritten other = {.takes = l->takes};
    int same, fresh = !p->taken;

    plcImagePeek(out, p->out, p->length, p->now);
    if (p->taken && !equal(p, p->now, p->ours)) { /* a place that overlaps took something, */
        memcpy(p->ours, p->now, p->length);       /* or a note is about to come */
        if (!p->waits) {
            noteWrite(r, p, &other, l->now);
            p->left = 1;
        }
    }
    same = equal(p, p->now, shown);
    if (p->waits && isDone(p, shown, same, l))
        setWaits(r, p, 0);
    show(p, shown);
    if (p->waits || (same && !fresh))
        return 0;
    return take(r, p, shown, out) || fresh;
}

unsigned plcReadbackTrack(plcReadback *r, const void *block, const void *hidden, plcImage *out,
                          epicsUInt64 now, epicsUInt64 limit, int through,
                          const plcShownAfter *after)
{
    look l = {plcImageTakes(out), now, limit, through, after};
    unsigned changed = 0;
    place *p;

    epicsMutexMustLock(r->lock);
    for (p = (place *)ellFirst(&r->places); p; p = (place *)ellNext(&p->node))
        if (!isHidden(p, hidden))
            changed += trackPlace(r, p, (const epicsUInt8 *)block + p->in, out, &l);
    epicsMutexUnlock(r->lock);
    return changed;
}
