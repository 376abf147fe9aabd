/* All fuzz targets with their seeds, and with some mutilated copies of each: what a compiler
 * without a fuzzer can do, in the unit tests.
 *
 * PLCLINK_MUTANTS: copies of each seed (50). An argument: the folder of the seeds.
 */
#include <dirent.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cantProceed.h>
#include <epicsStdio.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "fuzz.h"

#define SEED_MAX 65536

static char doing[300]; /* for the message when the program ends by a signal */
static unsigned state;

static void onSignal(int number)
{
    static const char text[] = "# ended by a signal: ";

    if (write(1, text, sizeof(text) - 1) < 0 || write(1, doing, strlen(doing)) < 0)
        _exit(3);
    signal(number, SIG_DFL);
    raise(number);
}

static unsigned randomBelow(size_t n)
{
    state = state * 1664525u + 1013904223u;
    return n ? (state >> 8) % (unsigned)n : 0;
}

/* One change: a byte, a bit, a piece less, a piece twice. */
static size_t change(epicsUInt8 *bytes, size_t size)
{
    size_t at = randomBelow(size), n = 1 + randomBelow(16);

    if (!size)
        return 0;
    switch (randomBelow(5)) {
    case 0:
        bytes[at] = (epicsUInt8)randomBelow(256);
        break;
    case 1:
        bytes[at] ^= (epicsUInt8)(1 << randomBelow(8));
        break;
    case 2:
        if (n > size - at)
            n = size - at;
        memmove(bytes + at, bytes + at + n, size - at - n);
        return size - n;
    case 3:
        bytes[at] = (epicsUInt8) "\0\xff,/[]\n@ -+.=\"9"[randomBelow(16)];
        break;
    default:
        if (n > size - at || size + n > SEED_MAX)
            break;
        memmove(bytes + at + n, bytes + at, size - at);
        return size + n;
    }
    return size;
}

/* A copy of just its size: the target may not read beyond it. */
static void give(const fuzzRow *row, const epicsUInt8 *bytes, size_t size)
{
    epicsUInt8 *copy = mallocMustSucceed(size + 1, "fuzzSeedTest");

    memcpy(copy, bytes, size);
    row->target(copy, size);
    free(copy);
}

static void runSeed(const fuzzRow *row, const char *path, unsigned mutants)
{
    epicsUInt8 *bytes = mallocMustSucceed(SEED_MAX, "fuzzSeedTest");
    epicsUInt8 *mutant = mallocMustSucceed(SEED_MAX, "fuzzSeedTest");
    FILE *file = fopen(path, "rb");
    size_t size = file ? fread(bytes, 1, SEED_MAX, file) : 0, n;
    unsigned i, changes;

    if (!file)
        testAbort("cannot read %s", path);
    fclose(file);
    for (i = 0; i <= mutants; i++) {
        epicsSnprintf(doing, sizeof(doing), "%s, mutant %u\n", path, i);
        memcpy(mutant, bytes, size);
        state = i;
        n = size;
        for (changes = i ? 1 + randomBelow(6) : 0; changes; changes--)
            n = change(mutant, n);
        give(row, mutant, n);
    }
    free(bytes);
    free(mutant);
}

static unsigned runTarget(const fuzzRow *row, const char *folder, unsigned mutants)
{
    char path[500];
    struct dirent *entry;
    unsigned seeds = 0;
    DIR *dir;

    epicsSnprintf(path, sizeof(path), "%s/%s", folder, row->name);
    dir = opendir(path);
    while (dir && (entry = readdir(dir))) {
        if (entry->d_name[0] == '.')
            continue;
        epicsSnprintf(path, sizeof(path), "%s/%s/%s", folder, row->name, entry->d_name);
        runSeed(row, path, mutants);
        seeds++;
    }
    if (dir)
        closedir(dir);
    return seeds;
}

MAIN(fuzzSeedTest)
{
    const char *folder = argc > 1 ? argv[1] : "../../fuzz/seeds";
    const char *number = getenv("PLCLINK_MUTANTS");
    unsigned mutants = number ? (unsigned)atoi(number) : 50, rows, i;

    for (rows = 0; fuzzTargets[rows].name; rows++)
        ;
    testPlan((int)rows);
    signal(SIGABRT, onSignal);
    signal(SIGSEGV, onSignal);
    for (i = 0; i < rows; i++) {
        unsigned seeds = runTarget(&fuzzTargets[i], folder, mutants);

        testOk(seeds > 0, "%s: %u seeds, %u mutants of each", fuzzTargets[i].name, seeds, mutants);
    }
    return testDone();
}
