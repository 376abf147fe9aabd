/* Faults of an image: which bits are bad, why, what is news; against a simple model; and
 * among threads. */
#include <stdio.h>
#include <string.h>

#include <epicsAtomic.h>
#include <epicsEvent.h>
#include <epicsThread.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcFaults.h"

static const char refused[] = "exception 2, illegal data address";
static const char silent[] = "no answer for 1.0 s";

/* What is found at a place is this reason; NULL: the place is good. */
static int finds(plcFaults *faults, size_t offset, size_t length, const void *mask,
                 const char *expected)
{
    char reason[PLC_REASON_SIZE] = "untouched";
    int bad = plcFaultsFind(faults, offset, length, mask, reason);

    if (bad != (expected != NULL) || strcmp(reason, expected ? expected : "")) {
        testDiag("found %d \"%s\" instead of \"%s\"", bad, reason,
                 expected ? expected : "");
        return 0;
    }
    return 1;
}

static void testBytes(void)
{
    plcFaults *faults = plcFaultsCreate(20);

    testOk(finds(faults, 0, 20, NULL, NULL), "nothing is bad at the beginning");
    testOk(plcFaultsCount(faults, 0, 20) == 0, "0 bits");
    testOk(plcFaultsClear(faults, 0, 20, NULL) == 0 && plcFaultsClearAll(faults) == 0,
           "and nothing becomes good");
    plcFaultsDestroy(plcFaultsCreate(20));
    testPass("and where nothing was bad nothing is left at the end");
    testOk(plcFaultsSet(faults, 4, 6, NULL, refused) == 1, "six bytes become bad");
    testOk(plcFaultsSet(faults, 4, 6, NULL, refused) == 0, "again: no news");
    testOk(plcFaultsSet(faults, 6, 2, NULL, refused) == 0, "a part of them: no news");
    testOk(finds(faults, 0, 4, NULL, NULL), "not the byte before");
    testOk(finds(faults, 10, 10, NULL, NULL), "nor the byte behind");
    testOk(finds(faults, 4, 1, NULL, refused) && finds(faults, 9, 1, NULL, refused),
           "but the first and the last");
    testOk(finds(faults, 0, 20, NULL, refused) && finds(faults, 9, 4, NULL, refused),
           "and what overlaps them");
    testOk(plcFaultsSet(faults, 8, 4, NULL, silent) == 1, "two bytes more, two again");
    testOk(finds(faults, 8, 2, NULL, silent),
           "the new reason takes the place of the old");
    testOk(finds(faults, 4, 8, NULL, refused), "the reason of the first bad byte");
    testOk(plcFaultsCount(faults, 0, 20) == 64 && plcFaultsCount(faults, 7, 2) == 16,
           "all bits are counted, whatever the reason");
    testOk(finds(faults, 7, 2, NULL, refused) && finds(faults, 8, 4, NULL, silent),
           "at each place its own");
    testOk(plcFaultsClear(faults, 5, 6, NULL) == 1, "six bytes are good again");
    testOk(plcFaultsClear(faults, 5, 6, NULL) == 0, "which is news once");
    testOk(finds(faults, 5, 6, NULL, NULL), "they are");
    testOk(finds(faults, 4, 1, NULL, refused) && finds(faults, 11, 1, NULL, silent),
           "those beside them stay bad");
    testOk(plcFaultsClearAll(faults) == 1 && finds(faults, 0, 20, NULL, NULL),
           "then everything is good");
    testOk(plcFaultsClearAll(faults) == 0, "which is news once");
    testOk(plcFaultsSet(faults, 3, 0, NULL, silent) == 0 &&
               finds(faults, 3, 0, NULL, NULL),
           "no byte is never bad");
    plcFaultsDestroy(faults);
}

static void testBits(void)
{
    static const epicsUInt8 bit0[] = {0x01}, bit3[] = {0x08}, bit7[] = {0x80};
    static const epicsUInt8 none[] = {0}, across[] = {0x80, 0x01}, upper[] = {0, 0xFE};
    epicsUInt8 all[4];
    plcFaults *faults = plcFaultsCreate(4);

    testOk(plcFaultsSet(faults, 1, 1, bit3, refused) == 1, "one bit becomes bad");
    testOk(finds(faults, 1, 1, bit3, refused) && finds(faults, 1, 1, NULL, refused),
           "it is found alone and in its byte");
    testOk(finds(faults, 1, 1, bit0, NULL) && finds(faults, 1, 1, bit7, NULL),
           "its neighbours are good");
    testOk(plcFaultsSet(faults, 1, 1, bit0, silent) == 1, "another bit, another reason");
    testOk(finds(faults, 1, 1, bit3, refused) && finds(faults, 1, 1, bit0, silent),
           "each has its own");
    testOk(finds(faults, 1, 1, NULL, silent), "of several the lowest is told");
    testOk(plcFaultsSet(faults, 1, 1, none, silent) == 0, "an empty mask is no news");
    testOk(plcFaultsClear(faults, 1, 1, bit0) == 1 && finds(faults, 1, 1, NULL, refused),
           "one bit is good again, the other is not");
    testOk(plcFaultsSet(faults, 1, 2, across, silent) == 1 &&
               finds(faults, 1, 2, across, silent) && finds(faults, 2, 1, bit0, silent),
           "a mask across two bytes");
    testOk(finds(faults, 1, 2, upper, NULL), "which leaves the rest of the second");
    testOk(plcFaultsMask(faults, all) == 1 && memcmp(all, "\0\x88\x01\0", 4) == 0,
           "all bad bits at once, of each reason");
    testOk(plcFaultsClear(faults, 0, 4, NULL) == 1 && finds(faults, 0, 4, NULL, NULL),
           "all bits of all bytes");
    testOk(plcFaultsMask(faults, all) == 0 && all[1] == 0x88, "where none is bad it leaves the mask alone");
    plcFaultsDestroy(faults);
}

static void testReasons(void)
{
    plcFaults *faults = plcFaultsCreate(300);
    char reason[PLC_REASON_SIZE];
    int i, wrong = 0;

    plcFaultsSet(faults, 0, 1, NULL, "0123456789012345678901234567890123456789 too long");
    testOk(finds(faults, 0, 1, NULL, "012345678901234567890123456789012345678"),
           "a long reason is cut to 39 characters");
    testOk(plcFaultsSet(faults, 0, 1, NULL,
                        "0123456789012345678901234567890123456789 too long") == 0,
           "and is the same reason again");
    for (i = 0; i < 300; i++) {
        sprintf(reason, "reason %d", i);
        plcFaultsSet(faults, (size_t)i, 1, NULL, reason);
    }
    for (i = 0; i < 300; i++) {
        sprintf(reason, "reason %d", i);
        wrong += !finds(faults, (size_t)i, 1, NULL, reason);
    }
    testOk(wrong == 0, "300 reasons at the same time");
    testOk(plcFaultsSet(faults, 0, 300, NULL, silent) == 1 &&
               finds(faults, 299, 1, NULL, silent),
           "one takes the place of all");
    plcFaultsDestroy(faults);

    faults = plcFaultsCreate(0);
    testOk(plcFaultsSet(faults, 0, 0, NULL, silent) == 0 &&
               plcFaultsClearAll(faults) == 0 && finds(faults, 0, 0, NULL, NULL),
           "an image of 0 bytes");
    plcFaultsDestroy(faults);
    plcFaultsDestroy(NULL);
}

/* --- Against a model: a number of a reason for each bit, 0: good ---------------------
 */

#define SIZE 24
#define STEPS 200000

static const char *const reasons[] = {"", refused, silent, "PLC has no function 22",
                                      "PLC refused: exception 3"};
#define REASONS (sizeof(reasons) / sizeof(reasons[0]))

static epicsUInt32 seed = 20261;

static epicsUInt32 random32(epicsUInt32 below)
{
    seed = seed * 1664525u + 1013904223u;
    return (seed >> 8) % below;
}

typedef struct step {
    size_t offset, length;
    epicsUInt8 mask[SIZE];
    int masked;
} step;

static step nextStep(void)
{
    step s;
    size_t i;

    s.offset = random32(SIZE + 1);
    s.length = random32((epicsUInt32)(SIZE - s.offset + 1));
    if (s.length > 4 && random32(4))
        s.length = 4;
    s.masked = random32(2) != 0;
    for (i = 0; i < SIZE; i++)
        s.mask[i] = s.masked ? (epicsUInt8)(random32(256) & random32(256)) : 0xFF;
    return s;
}

/* Puts `number` into the bits of the model. Returns 1 when one was another. */
static int modelSet(epicsUInt8 model[SIZE * 8], const step *s, epicsUInt8 number)
{
    size_t bit;
    int news = 0;

    for (bit = 0; bit < 8 * s->length; bit++) {
        epicsUInt8 *at = model + 8 * s->offset + bit;

        if (!(s->mask[bit / 8] >> bit % 8 & 1))
            continue;
        news |= *at != number;
        *at = number;
    }
    return news;
}

static epicsUInt8 modelFind(const epicsUInt8 model[SIZE * 8], const step *s)
{
    size_t bit;

    for (bit = 0; bit < 8 * s->length; bit++) {
        if (s->mask[bit / 8] >> bit % 8 & 1 && model[8 * s->offset + bit])
            return model[8 * s->offset + bit];
    }
    return 0;
}

static void testModel(void)
{
    plcFaults *faults = plcFaultsCreate(SIZE);
    epicsUInt8 model[SIZE * 8] = {0}, number;
    int i, wrong = 0, found = 0;

    for (i = 0; i < STEPS; i++) {
        step s = nextStep();
        const void *mask = s.masked ? s.mask : NULL;
        epicsUInt32 what = random32(100);

        if (what < 25) {
            number = (epicsUInt8)(1 + random32(REASONS - 1));
            wrong += plcFaultsSet(faults, s.offset, s.length, mask, reasons[number]) !=
                     modelSet(model, &s, number);
        } else if (what < 60) {
            wrong += plcFaultsClear(faults, s.offset, s.length, mask) !=
                     modelSet(model, &s, 0);
        } else if (what < 61) {
            s = (step){.offset = 0, .length = SIZE};
            memset(s.mask, 0xFF, SIZE);
            wrong += plcFaultsClearAll(faults) != modelSet(model, &s, 0);
        } else {
            number = modelFind(model, &s);
            found += number != 0;
            wrong +=
                !finds(faults, s.offset, s.length, mask, number ? reasons[number] : NULL);
        }
    }
    testOk(wrong == 0, "%d random steps as the model says, %d wrong", STEPS, wrong);
    testOk(found > STEPS / 10 && found < STEPS / 3, "%d of them found a bad bit", found);
    plcFaultsDestroy(faults);
}

/* --- Threads: a reason is never seen half, and no bit is lost ------------------------
 */

#define ROUNDS 5000
#define PLACES 3

typedef struct race {
    plcFaults *faults;
    int strange, lost, ended; /* atomic */
    epicsEventId done;
} race;

typedef struct racer {
    race *r;
    size_t place;
} racer;

/* Owns 8 bytes; its neighbours' reasons come and go meanwhile. */
static void setter(void *arg)
{
    racer *own = arg;
    race *r = own->r;
    char reason[PLC_REASON_SIZE];
    int i;

    for (i = 0; i < ROUNDS; i++) {
        const char *now = reasons[1 + (size_t)i % (REASONS - 1)];

        if (plcFaultsSet(r->faults, 8 * own->place, 8, NULL, now) != 1 ||
            !plcFaultsFind(r->faults, 8 * own->place, 8, NULL, reason) ||
            strcmp(reason, now))
            epicsAtomicIncrIntT(&r->lost);
        if (i % 2 && plcFaultsClear(r->faults, 8 * own->place, 8, NULL) != 1)
            epicsAtomicIncrIntT(&r->lost);
    }
    if (epicsAtomicIncrIntT(&r->ended) == PLACES + 1)
        epicsEventMustTrigger(r->done);
}

static void finder(void *arg)
{
    racer *own = arg;
    race *r = own->r;
    char reason[PLC_REASON_SIZE];
    size_t i;
    int n;

    for (n = 0; n < ROUNDS; n++) {
        plcFaultsFind(r->faults, 0, 8 * PLACES, NULL, reason);
        for (i = 0; i < REASONS && strcmp(reason, reasons[i]); i++)
            ;
        if (i == REASONS)
            epicsAtomicIncrIntT(&r->strange);
    }
    if (epicsAtomicIncrIntT(&r->ended) == PLACES + 1)
        epicsEventMustTrigger(r->done);
}

static void testThreads(void)
{
    race r = {plcFaultsCreate(8 * PLACES), 0, 0, 0,
              epicsEventMustCreate(epicsEventEmpty)};
    racer racers[PLACES + 1];
    size_t i;

    for (i = 0; i <= PLACES; i++) {
        racers[i] = (racer){&r, i};
        epicsThreadMustCreate("race", epicsThreadPriorityMedium,
                              epicsThreadGetStackSize(epicsThreadStackMedium),
                              i < PLACES ? setter : finder, &racers[i]);
    }
    epicsEventMustWait(r.done);
    testOk(r.strange == 0, "every reason that was found is a whole one");
    testOk(r.lost == 0, "each thread finds what it has set");
    testOk(plcFaultsClearAll(r.faults) == 0, "at last everything is good");
    epicsEventDestroy(r.done);
    plcFaultsDestroy(r.faults);
}

MAIN(faultsTest)
{
    testPlan(22 + 1 + 13 + 5 + 2 + 3);
    testDiag("Bytes");
    testBytes();
    testDiag("Bits");
    testBits();
    testDiag("Reasons");
    testReasons();
    testDiag("Against a model");
    testModel();
    testDiag("Threads");
    testThreads();
    return testDone();
}
