/* The records of a station; see plcUsers.h. */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsAtomic.h>
#include <epicsMutex.h>

#include "plcUsers.h"

struct plcUsers {
    epicsMutexId lock;
    ELLLIST list;
    int changes; /* atomic */
};

plcUsers *plcUsersCreate(void)
{
    plcUsers *users = callocMustSucceed(1, sizeof(*users), "plcUsersCreate");

    users->lock = epicsMutexMustCreate();
    return users;
}

void plcUsersDestroy(plcUsers *users)
{
    if (!users)
        return;
    epicsMutexDestroy(users->lock);
    free(users);
}

void plcUsersAdd(plcUsers *users, plcUser *user)
{
    epicsMutexMustLock(users->lock);
    ellAdd(&users->list, &user->node);
    epicsMutexUnlock(users->lock);
    epicsAtomicIncrIntT(&users->changes);
}

void plcUsersRemove(plcUsers *users, plcUser *user)
{
    epicsMutexMustLock(users->lock);
    ellDelete(&users->list, &user->node);
    epicsMutexUnlock(users->lock);
    epicsAtomicIncrIntT(&users->changes);
}

void plcUsersWritten(plcUsers *users, plcUser *user)
{
    epicsMutexMustLock(users->lock);
    user->unwritten = 0;
    epicsMutexUnlock(users->lock);
}

int plcUsersChanges(plcUsers *users)
{
    return epicsAtomicGetIntT(&users->changes);
}

static int byPlace(const void *a, const void *b)
{
    const plcUser *left = a, *right = b;

    if (left->offset != right->offset)
        return left->offset < right->offset ? -1 : 1;
    if (left->mask != right->mask)
        return left->mask < right->mask ? -1 : 1;
    return strcmp(left->name, right->name);
}

plcUser *plcUsersCopy(plcUsers *users, int output, size_t *count)
{
    plcUser *copy, *user;

    *count = 0;
    epicsMutexMustLock(users->lock);
    copy = malloc((size_t)(ellCount(&users->list) + 1) * sizeof(*copy));
    for (user = (plcUser *)ellFirst(&users->list); copy && user;
         user = (plcUser *)ellNext(&user->node))
        if (user->output == output)
            copy[(*count)++] = *user;
    epicsMutexUnlock(users->lock);
    if (copy && *count)
        qsort(copy, *count, sizeof(*copy), byPlace);
    return copy;
}

/* True when both claim a bit of the same element, whatever the order of its bytes. */
static int sameBits(const plcUser *a, const plcUser *b)
{
    epicsUInt64 left = 0, right = 0; /* in the order of the wire */

    plcPutInt(a->type, &left, a->order, (epicsInt64)a->mask);
    plcPutInt(b->type, &right, b->order, (epicsInt64)b->mask);
    return (left & right) != 0;
}

int plcUsersOverlap(const plcUser *a, const plcUser *b)
{
    if (a->offset >= b->offset + b->length || b->offset >= a->offset + a->length)
        return 0;
    /* bits of one word are told apart where the word is the same for both */
    if (a->offset == b->offset && a->length == b->length && a->mask && b->mask)
        return sameBits(a, b);
    return 1;
}
