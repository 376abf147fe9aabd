/* The places of tags in the images of a PLC; see eipPlaces.h. */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <dbDefs.h>
#include <ellLib.h>
#include <epicsMutex.h>
#include <epicsStdio.h>
#include <epicsString.h>
#include <gpHash.h>

#include "eipPlaces.h"

/* Of those who want a place, how many have which period. */
typedef struct user {
    ELLNODE node;
    unsigned period, count;
} user;

struct eipPlace {
    ELLNODE node;
    char *key; /* in the table, which keeps no copy */
    eipWant want;
    ELLLIST users;
    unsigned outputs; /* of them */
    int fresh; /* wanted anew: what stands there is old */
};

struct eipPlaces {
    epicsMutexId lock; /* guards from here on */
    struct gphPvt *table;
    ELLLIST list;
    size_t size, used;
    int changed;
};

eipPlaces *eipPlacesCreate(size_t size)
{
    eipPlaces *p = callocMustSucceed(1, sizeof(*p), "eipPlaces");

    p->lock = epicsMutexMustCreate();
    gphInitPvt(&p->table, 4096);
    ellInit(&p->list);
    p->size = size;
    return p;
}

void eipPlacesDestroy(eipPlaces *p)
{
    ELLNODE *node;

    while ((node = ellGet(&p->list))) {
        eipPlace *place = CONTAINER(node, eipPlace, node);

        ellFree(&place->users);
        free(place->want.tag);
        free(place->key);
        free(place);
    }
    gphFreeMem(p->table);
    epicsMutexDestroy(p->lock);
    free(p);
}

/* Tags are the same in upper and lower case. The hash keeps the text. */
static char *keyOf(const eipWant *w)
{
    char text[eipNameMax + 80];
    char *at;

    epicsSnprintf(text, sizeof(text), "%s#%u#%u#%d#%d#%d#%lu", w->tag, w->index, w->count,
                  w->alone, w->indexed, (int)w->kind, w->kind == eipTextPlace ? (unsigned long)w->room : 0);
    for (at = text; *at; at++)
        *at = (char)tolower((unsigned char)*at);
    return epicsStrDup(text);
}

static size_t roomOf(const eipWant *w)
{
    size_t room = w->kind == eipCell        ? eipCellSize
                  : w->kind == eipTextPlace ? w->room
                                            : eipPlaceHead + (size_t)w->count * 8;

    return (room + 7) / 8 * 8;
}

static void addUser(eipPlace *place, unsigned period)
{
    ELLNODE *node;
    user *u;

    for (node = ellFirst(&place->users); node; node = ellNext(node)) {
        u = CONTAINER(node, user, node);
        if (u->period == period) {
            u->count++;
            return;
        }
    }
    u = callocMustSucceed(1, sizeof(*u), "eipPlaces");
    u->period = period;
    u->count = 1;
    ellAdd(&place->users, &u->node);
}

static eipPlace *make(eipPlaces *p, const eipWant *wish, char *key)
{
    size_t room = roomOf(wish);
    eipPlace *place;
    GPHENTRY *entry;

    if (room > p->size - p->used)
        return NULL;
    place = callocMustSucceed(1, sizeof(*place), "eipPlaces");
    place->key = key;
    place->want = *wish;
    place->want.tag = epicsStrDup(wish->tag);
    place->want.place = p->used;
    place->want.room = room;
    ellInit(&place->users);
    p->used += room;
    ellAdd(&p->list, &place->node);
    entry = gphAdd(p->table, key, p);
    entry->userPvt = place;
    return place;
}

eipPlace *eipPlacesGet(eipPlaces *p, const eipWant *wish, unsigned period, int output)
{
    char *key = keyOf(wish);
    GPHENTRY *entry;
    eipPlace *place;

    epicsMutexMustLock(p->lock);
    entry = gphFind(p->table, key, p);
    place = entry ? entry->userPvt : make(p, wish, key);
    if (entry || !place)
        free(key);
    if (place) {
        if (!ellCount(&place->users))
            place->fresh = 1;
        addUser(place, period);
        place->outputs += output != 0;
        place->want.element |= wish->element;
        p->changed = 1;
    }
    epicsMutexUnlock(p->lock);
    return place;
}

void eipPlacesLeave(eipPlaces *p, eipPlace *place, unsigned period, int output)
{
    ELLNODE *node;

    epicsMutexMustLock(p->lock);
    place->outputs -= output != 0;
    for (node = ellFirst(&place->users); node; node = ellNext(node)) {
        user *u = CONTAINER(node, user, node);

        if (u->period != period)
            continue;
        if (--u->count == 0) {
            ellDelete(&place->users, node);
            free(u);
        }
        break;
    }
    p->changed = 1;
    epicsMutexUnlock(p->lock);
}

size_t eipPlaceOffset(const eipPlace *place)
{
    return place->want.place;
}

size_t eipPlaceRoom(const eipPlace *place)
{
    return place->want.room;
}

size_t eipPlacesUsed(eipPlaces *p)
{
    size_t used;

    epicsMutexMustLock(p->lock);
    used = p->used;
    epicsMutexUnlock(p->lock);
    return used;
}

/* "a[3]: no such element (05)" */
static void tell(const eipWant *want, const char *why, char *text, size_t size)
{
    char name[eipNameMax + 16];

    eipElementText(want->tag, want->indexed, want->index, name, sizeof(name));
    epicsSnprintf(text, size, "%s: %s", name, strncmp(why, "PLC: ", 5) ? why : why + 5);
}

unsigned eipPlacesBad(eipPlaces *p, plcFaults *faults, unsigned *of, char *first, size_t size)
{
    char why[PLC_REASON_SIZE];
    unsigned bad = 0;
    ELLNODE *node;

    *of = 0;
    first[0] = 0;
    epicsMutexMustLock(p->lock);
    for (node = ellFirst(&p->list); node; node = ellNext(node)) {
        const eipPlace *place = CONTAINER(node, eipPlace, node);

        if (!ellCount(&place->users))
            continue;
        ++*of;
        if (!plcFaultsFind(faults, place->want.place, place->want.room, NULL, why))
            continue;
        if (!bad++)
            tell(&place->want, why, first, size);
    }
    epicsMutexUnlock(p->lock);
    return bad;
}

int eipPlacesTag(eipPlaces *p, size_t offset, char *tag, size_t size, size_t *at)
{
    int status = -1;
    ELLNODE *node;

    epicsMutexMustLock(p->lock);
    for (node = ellFirst(&p->list); node && status; node = ellNext(node)) {
        const eipWant *want = &CONTAINER(node, eipPlace, node)->want;

        if (offset < want->place || offset - want->place >= want->room)
            continue;
        eipElementText(want->tag, want->indexed, want->index, tag, size);
        *at = want->place;
        status = 0;
    }
    epicsMutexUnlock(p->lock);
    return status;
}

int eipPlacesWants(eipPlaces *p, int always, eipWant **wants, unsigned *count, size_t *used)
{
    ELLNODE *node, *each;
    int changed;

    epicsMutexMustLock(p->lock);
    changed = p->changed || always;
    p->changed = 0;
    *count = 0;
    *used = p->used;
    *wants = changed ? callocMustSucceed((size_t)ellCount(&p->list) + 1, sizeof(**wants),
                                         "eipPlaces")
                     : NULL;
    for (node = changed ? ellFirst(&p->list) : NULL; node; node = ellNext(node)) {
        eipPlace *place = CONTAINER(node, eipPlace, node);
        eipWant *w = &(*wants)[*count];

        if (!ellCount(&place->users))
            continue;
        *w = place->want;
        w->tag = epicsStrDup(place->want.tag);
        w->period = ~0u;
        for (each = ellFirst(&place->users); each; each = ellNext(each)) {
            unsigned period = CONTAINER(each, user, node)->period;

            if (period < w->period)
                w->period = period;
        }
        w->shared = place->outputs > 1;
        w->fresh = place->fresh;
        place->fresh = 0;
        (*count)++;
    }
    epicsMutexUnlock(p->lock);
    return changed;
}
