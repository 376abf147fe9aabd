/* The records of a station; see plcOwners.h. */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsAtomic.h>
#include <epicsMutex.h>
#include <epicsStdio.h>

#include "plcOwners.h"

struct plcOwners {
    epicsMutexId lock;
    ELLLIST list;
    int changes; /* atomic */
};

plcOwners *plcOwnersCreate(void)
{
    plcOwners *owners = callocMustSucceed(1, sizeof(*owners), "plcOwnersCreate");

    owners->lock = epicsMutexMustCreate();
    return owners;
}

void plcOwnersDestroy(plcOwners *owners)
{
    if (!owners)
        return;
    epicsMutexDestroy(owners->lock);
    free(owners);
}

void plcOwnersAdd(plcOwners *owners, plcOwner *owner)
{
    epicsMutexMustLock(owners->lock);
    ellAdd(&owners->list, &owner->node);
    epicsMutexUnlock(owners->lock);
    epicsAtomicIncrIntT(&owners->changes);
}

void plcOwnersRemove(plcOwners *owners, plcOwner *owner)
{
    epicsMutexMustLock(owners->lock);
    ellDelete(&owners->list, &owner->node);
    epicsMutexUnlock(owners->lock);
    epicsAtomicIncrIntT(&owners->changes);
}

void plcOwnersWritten(plcOwners *owners, plcOwner *owner)
{
    epicsMutexMustLock(owners->lock);
    owner->unwritten = 0;
    epicsMutexUnlock(owners->lock);
}

int plcOwnersChanges(plcOwners *owners)
{
    return epicsAtomicGetIntT(&owners->changes);
}

static int byPlace(const void *a, const void *b)
{
    const plcOwner *left = a, *right = b;

    if (left->offset != right->offset)
        return left->offset < right->offset ? -1 : 1;
    if (left->mask != right->mask)
        return left->mask < right->mask ? -1 : 1;
    return strcmp(left->name, right->name);
}

plcOwner *plcOwnersCopy(plcOwners *owners, int output, size_t *count)
{
    plcOwner *copy, *owner;

    *count = 0;
    epicsMutexMustLock(owners->lock);
    copy = malloc((size_t)(ellCount(&owners->list) + 1) * sizeof(*copy));
    for (owner = (plcOwner *)ellFirst(&owners->list); copy && owner;
         owner = (plcOwner *)ellNext(&owner->node))
        if (owner->output == output)
            copy[(*count)++] = *owner;
    epicsMutexUnlock(owners->lock);
    if (copy && *count)
        qsort(copy, *count, sizeof(*copy), byPlace);
    return copy;
}

unsigned plcOwnersIn(plcOwners *owners, size_t offset, size_t length, char *first, size_t size)
{
    unsigned count = 0;
    plcOwner *owner;

    epicsMutexMustLock(owners->lock);
    for (owner = (plcOwner *)ellFirst(&owners->list); owner;
         owner = (plcOwner *)ellNext(&owner->node))
        if (owner->offset >= offset && owner->offset - offset < length && !count++)
            epicsSnprintf(first, size, "%s", owner->name);
    epicsMutexUnlock(owners->lock);
    return count;
}

/* True when both claim a bit of the same element, whatever the order of its bytes. */
static int sameBits(const plcOwner *a, const plcOwner *b)
{
    epicsUInt64 left = 0, right = 0; /* in the order of the wire */

    plcPutInt(a->type, &left, a->order, (epicsInt64)a->mask);
    plcPutInt(b->type, &right, b->order, (epicsInt64)b->mask);
    return (left & right) != 0;
}

int plcOwnersOverlap(const plcOwner *a, const plcOwner *b)
{
    if (a->offset >= b->offset + b->length || b->offset >= a->offset + a->length)
        return 0;
    /* bits of one word are told apart where the word is the same for both */
    if (a->offset == b->offset && a->length == b->length && a->mask && b->mask)
        return sameBits(a, b);
    return 1;
}
