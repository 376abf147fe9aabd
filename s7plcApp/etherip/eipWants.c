/* What is wanted of the PLC: taken over from those who want it, and found by its place; see
 * eipWorkerPvt.h. All functions run in the worker's thread.
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>

#include "eipWorkerPvt.h"

static int byPlace(const void *a, const void *b)
{
    const eipPlaced *x = a, *y = b;

    return x->place < y->place ? -1 : x->place > y->place;
}

/* What nobody wants any more has no value: who wants it again gets a new one. */
static void forgetLeft(eipWorker *w, const eipPlaced *before, unsigned count)
{
    unsigned i, k = 0;

    for (i = 0; i < count; i++) {
        while (k < w->tags.wantCount && w->byPlace[k].place < before[i].place)
            k++;
        if (k < w->tags.wantCount && w->byPlace[k].place == before[i].place)
            continue;
        memset(w->in + before[i].place, 0, 2);
        w->stored = 1;
    }
}

static void sortByPlace(eipWorker *w)
{
    unsigned n = w->tags.wantCount, i;

    free(w->queued);
    w->byPlace = callocMustSucceed(n + 1, sizeof(*w->byPlace), "etherip");
    w->queued = callocMustSucceed(n + 1, 1, "etherip");
    for (i = 0; i < n; i++)
        w->byPlace[i] = (eipPlaced){w->tags.wants[i].place, i};
    if (n)
        qsort(w->byPlace, n, sizeof(*w->byPlace), byPlace);
}

unsigned eipWantsBehind(const eipWorker *w, size_t offset)
{
    unsigned low = 0, high = w->tags.wantCount;

    while (low < high) {
        unsigned middle = low + (high - low) / 2;
        const eipWant *want = &w->tags.wants[w->byPlace[middle].want];

        if (want->place + want->room <= offset)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

int eipWantsTake(eipWorker *w)
{
    eipWant *wants = NULL;
    eipPlaced *before = w->byPlace;
    unsigned count = 0, had = w->tags.wantCount, i;
    size_t used;

    if (!w->source(w->sourceArg, &wants, &count, &used))
        return 0;
    w->used = used;
    for (i = 0; i < count; i++)
        if (wants[i].fresh) {
            memset(w->in + wants[i].place, 0, wants[i].room);
            memset(w->back + wants[i].place, 0, wants[i].room);
            plcFaultsClear(w->setup.inFaults, wants[i].place, wants[i].room, NULL);
        }
    epicsMutexMustLock(w->tagsLock);
    w->turn = NULL;
    eipTagsSet(&w->tags, wants, count);
    epicsMutexUnlock(w->tagsLock);
    sortByPlace(w);
    forgetLeft(w, before, had);
    free(before);
    w->browser.stage = w->browser.stage == eipBrowseNot ? eipBrowseNot : eipBrowseProgram;
    eipBrowseEnd(w);
    w->replan = 1;
    return 1;
}
