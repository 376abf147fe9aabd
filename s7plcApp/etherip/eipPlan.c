/* Which services go together into one message; see eipPlan.h. */
#include <stdlib.h>

#include "eipCip.h"
#include "eipPlan.h"

typedef struct bin {
    unsigned request, answer, count; /* bytes as one of several, with heads */
} bin;

static void open(bin *b)
{
    b->request = eipMultipleHead;
    b->answer = eipMultipleAnswerHead;
    b->count = 0;
}

/* One more beside those that are there; the first one of a bin is not asked for: several need a
 * head, one alone does not. */
static int fits(const bin *b, const eipLoad *load, const eipLimits *limits)
{
    if (limits->multiple && b->count >= limits->multiple)
        return 0;
    return b->request + load->request + eipMultipleEach <= limits->room &&
           b->answer + load->answer + eipMultipleEach <= limits->room;
}

static void add(bin *b, const eipLoad *load)
{
    b->request += load->request + eipMultipleEach;
    b->answer += load->answer + eipMultipleEach;
    b->count++;
}

static unsigned larger(const eipLoad *load)
{
    return load->request > load->answer ? load->request : load->answer;
}

typedef struct entry {
    unsigned size, index;
} entry;

static int byDecreasing(const void *a, const void *b)
{
    const entry *x = a, *y = b;

    if (x->size != y->size)
        return x->size < y->size ? 1 : -1;
    return x->index < y->index ? -1 : 1;
}

/* The first bin from `from` on into which it goes. */
static unsigned firstFit(bin *bins, unsigned *n, unsigned from, const eipLoad *load,
                         const eipLimits *limits)
{
    unsigned b;

    for (b = from; b < *n; b++)
        if (fits(&bins[b], load, limits))
            break;
    if (b == *n)
        open(&bins[(*n)++]);
    add(&bins[b], load);
    return b;
}

unsigned eipPack(const eipLoad *loads, unsigned count, const eipLimits *limits, int inOrder,
                 unsigned *place)
{
    bin *bins = calloc(count + 1, sizeof(*bins));
    entry *order = calloc(count + 1, sizeof(*order));
    unsigned n = 0, i;

    for (i = 0; bins && order && i < count; i++)
        order[i] = (entry){larger(&loads[i]), i};
    if (order && !inOrder)
        qsort(order, count, sizeof(*order), byDecreasing);
    for (i = 0; bins && order && i < count; i++) {
        unsigned at = order[i].index;

        place[at] = firstFit(bins, &n, inOrder && n ? n - 1 : 0, &loads[at], limits);
    }
    free(bins);
    free(order);
    return n;
}

unsigned eipRuns(const epicsUInt32 *first, const epicsUInt32 *length, unsigned count,
                 unsigned elementSize, epicsUInt32 most, eipRun *runs)
{
    unsigned n = 0, i;

    for (i = 0; i < count; i++) {
        eipRun *run = n ? &runs[n - 1] : NULL;
        epicsUInt64 end = (epicsUInt64)first[i] + length[i];
        epicsUInt64 behind = run ? (epicsUInt64)run->first + run->count : 0;

        if (run && (first[i] <= behind || (first[i] - behind) * elementSize < eipGapMax) &&
            (!most || (end > behind ? end : behind) - run->first <= most)) {
            if (end > behind)
                run->count = (epicsUInt32)(end - run->first);
            run->wants++;
            continue;
        }
        runs[n++] = (eipRun){first[i], length[i], i, 1};
    }
    return n;
}
