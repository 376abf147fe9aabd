/* The periods of the units that a worker reads, and the end of what was planned for them; see
 * eipWorkerPvt.h. All functions run in the worker's thread. */
#include <stdlib.h>
#include <string.h>

#include "eipWorkerPvt.h"

void eipPlansFree(eipWorker *w)
{
    unsigned i;

    for (i = 0; i < w->planCount; i++) {
        free(w->plans[i].units);
        free(w->plans[i].ends);
    }
    w->planCount = w->planNext = 0;
    w->turn = NULL;
}

static int hasClass(const eipWorker *w, unsigned period)
{
    unsigned i;

    for (i = 0; i < w->classCount; i++)
        if (w->classes[i].period == period)
            return 1;
    return 0;
}

/* The periods that units have; times of those that were there before stay. */
static void makeClasses(eipWorker *w)
{
    eipClass old[eipClassesMax];
    unsigned oldCount = w->classCount, i, k;

    memcpy(old, w->classes, sizeof(old));
    epicsMutexMustLock(w->lock);
    w->classCount = 0;
    for (i = 0; i < w->tags.unitCount; i++) {
        unsigned period = w->tags.units[i].period;

        if (w->classCount == eipClassesMax || hasClass(w, period))
            continue;
        memset(&w->classes[w->classCount], 0, sizeof(w->classes[0]));
        w->classes[w->classCount].period = period;
        for (k = 0; k < oldCount; k++)
            if (old[k].period == period)
                w->classes[w->classCount] = old[k];
        w->classes[w->classCount++].times.period = period;
    }
    epicsMutexUnlock(w->lock);
}

void eipPlansRenew(eipWorker *w)
{
    eipPlansFree(w);
    makeClasses(w);
}
