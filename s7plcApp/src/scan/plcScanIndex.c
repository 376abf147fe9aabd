/* Which groups of records a new block touches: an index from words of the block to groups. */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>

#include "plcHot.h"
#include "plcScanPvt.h"

#define WORD 8          /* bytes; the index knows which groups touch a word */
#define CHUNK 512       /* bytes compared at once; a multiple of WORD */
#define WIDE (8 * WORD) /* groups longer than this are not in the index */

/* First and last word that a group touches. Its length is not 0. */
static size_t firstWord(const group *g)
{
    return g->offset / WORD;
}

static size_t lastWord(const group *g)
{
    return (g->offset + g->length - 1) / WORD;
}

static entry entryOf(group *g)
{
    entry e = {g->offset, g->length, g};

    return e;
}

/* Others cannot be touched. */
static int isUsed(const plcScan *scan, const group *g)
{
    return g->offset + g->length <= scan->used;
}

/* Counts the groups of each word, then fills them in behind each other. */
PLC_COLD static void buildIndex(plcScan *scan)
{
    size_t numWords = scan->used / WORD + 1;
    size_t i, w;

    free(scan->wordStart);
    free(scan->entries);
    free(scan->wide);
    scan->wordStart =
        callocMustSucceed(numWords + 2, sizeof(*scan->wordStart), "plcScan");
    scan->wide = callocMustSucceed(scan->numGroups + 1, sizeof(entry), "plcScan");
    scan->numWide = 0;
    for (i = 0; i < scan->numGroups; i++) {
        group *g = scan->groups[i];

        if (!isUsed(scan, g))
            continue;
        if (g->length > WIDE)
            scan->wide[scan->numWide++] = entryOf(g);
        else if (g->length)
            for (w = firstWord(g); w <= lastWord(g); w++)
                scan->wordStart[w + 2]++;
    }
    for (w = 2; w < numWords + 2; w++)
        scan->wordStart[w] += scan->wordStart[w - 1];
    scan->entries =
        callocMustSucceed(scan->wordStart[numWords + 1] + 1, sizeof(entry), "plcScan");
    for (i = 0; i < scan->numGroups; i++) {
        group *g = scan->groups[i];

        if (isUsed(scan, g) && g->length && g->length <= WIDE)
            for (w = firstWord(g); w <= lastWord(g); w++)
                scan->entries[scan->wordStart[w + 1]++] = entryOf(g);
    }
    scan->indexOld = 0;
}

static int isTouched(const entry *e, const char *before, const char *after)
{
    return memcmp(before + e->offset, after + e->offset, e->length) != 0;
}

static void addTouched(plcScan *scan, group *const groups[], unsigned n)
{
    unsigned i;

    for (i = 0; i < n; i++)
        addPending(scan, groups[i], ALL_PRIOS);
}

/* Adds the words in [at, end) that changed to the n that are there. Returns the new n. */
static unsigned changedWords(const char *before, const char *after, size_t at, size_t end,
                             epicsUInt32 words[], unsigned n)
{
    for (; end - at >= WORD; at += WORD) {
        epicsUInt64 old, new;

        memcpy(&old, before + at, WORD);
        memcpy(&new, after + at, WORD);
        words[n] = (epicsUInt32)(at / WORD);
        n += old != new;
    }
    if (at < end && memcmp(before + at, after + at, end - at) != 0)
        words[n++] = (epicsUInt32)(at / WORD);
    return n;
}

/* The touched groups of these words. In steps, so that the cache fetches what the next one
 * needs for many words, or groups, at a time. */
PLC_HOT static void touchWords(plcScan *scan, const char *before, const char *after,
                               const epicsUInt32 words[], unsigned n)
{
    const epicsUInt32 *start = scan->wordStart;
    group *touched[BATCH];
    unsigned i, m = 0;
    size_t k;

    for (i = 0; i < n; i++)
        FETCH(&scan->entries[start[words[i]]]);
    for (i = 0; i < n; i++) {
        for (k = start[words[i]]; k < start[words[i] + 1]; k++) {
            if (!isTouched(&scan->entries[k], before, after))
                continue;
            if (m == BATCH) {
                addTouched(scan, touched, m);
                m = 0;
            }
            FETCH(scan->entries[k].group);
            touched[m++] = scan->entries[k].group;
        }
    }
    addTouched(scan, touched, m);
}

/* Marks the groups whose bytes differ as pending. */
PLC_HOT void plcScanTouch(plcScan *scan, const char *before, const char *after)
{
    epicsUInt32 words[2 * CHUNK / WORD] = {0};
    int changed = 0;
    unsigned m, n = 0;
    size_t at, i;

    if (scan->indexOld)
        buildIndex(scan);
    for (at = 0; at < scan->used; at += CHUNK) {
        size_t length = scan->used - at < CHUNK ? scan->used - at : CHUNK;

        if (memcmp(before + at, after + at, length) == 0)
            continue;
        changed = 1;
        m = n;
        n = changedWords(before, after, at, at + length, words, n);
        for (; m < n; m++)
            FETCH(&scan->wordStart[words[m]]);
        if (n > CHUNK / WORD) {
            touchWords(scan, before, after, words, n);
            n = 0;
        }
    }
    touchWords(scan, before, after, words, n);
    for (i = 0; changed && i < scan->numWide; i++) {
        if (isTouched(&scan->wide[i], before, after))
            addPending(scan, scan->wide[i].group, ALL_PRIOS);
    }
}
