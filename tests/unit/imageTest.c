/* Images: validity, masks, the dirty flag, and no torn block among threads. */
#include <string.h>

#include <epicsAtomic.h>
#include <epicsEvent.h>
#include <epicsThread.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcImage.h"

static const epicsTimeStamp stampA = {1000, 5}, stampB = {2000, 7};

static int reasonIs(plcImage *image, const char *expected)
{
    char reason[PLC_REASON_SIZE];

    plcImageReason(image, reason);
    return strcmp(reason, expected) == 0;
}

static void testInput(void)
{
    plcImage *image = plcImageCreate(6);
    epicsUInt8 got[6] = {9, 9, 9, 9, 9, 9};
    epicsTimeStamp stamp = {1, 1};

    testOk1(plcImageSize(image) == 6);
    testOk(plcImageRead(image, 0, 6, got, &stamp) == -1, "a new image is not valid");
    testOk(got[0] == 9 && stamp.secPastEpoch == 1, "nothing is copied then");
    testOk(reasonIs(image, "not connected yet"), "the reason is \"not connected yet\"");
    plcImageInvalidate(image, "connection refused");
    testOk(reasonIs(image, "connection refused"), "a better reason replaces it");
    plcImagePublish(image, "ABCDEF", &stampA);
    testOk(plcImageRead(image, 2, 3, got, &stamp) == 0,
           "a published block makes it valid");
    testOk(memcmp(got, "CDE\x09", 4) == 0, "3 bytes at offset 2 are read");
    testOk(stamp.secPastEpoch == 1000 && stamp.nsec == 5, "with the stamp of the block");
    testOk(reasonIs(image, ""), "there is no reason any more");
    plcImagePublish(image, "abcdef", &stampB);
    testOk(plcImageRead(image, 0, 6, got, NULL) == 0 && memcmp(got, "abcdef", 6) == 0,
           "the next block replaces all bytes; the stamp need not be asked for");
    plcImageInvalidate(image, "0123456789012345678901234567890123456789 too long");
    testOk(plcImageRead(image, 0, 1, got, &stamp) == -1 && stamp.secPastEpoch == 1000,
           "an invalidated image is not read");
    testOk(reasonIs(image, "012345678901234567890123456789012345678"),
           "a long reason is cut to 39 characters");
    plcImagePeek(image, 4, 2, got);
    testOk(memcmp(got, "ef", 2) == 0, "peek shows the last bytes all the same");
    plcImageDestroy(image);
}

static const struct {
    const char *what;
    size_t offset, length;
    epicsUInt8 src[4], mask[4];
    int masked;
    epicsUInt8 expect[4]; /* the image held 11 22 33 44 */
} writes[] = {
    {"all bytes",                             0, 4, {0xA1, 0xB2, 0xC3, 0xD4}, {0},                      0, {0xA1, 0xB2, 0xC3, 0xD4}},
    {"one byte in the middle",                1, 1, {0xFF},                   {0},                      0, {0x11, 0xFF, 0x33, 0x44}},
    {"the last byte",                         3, 1, {0x00},                   {0},                      0, {0x11, 0x22, 0x33, 0x00}},
    {"no byte at the end",                    4, 0, {0xFF},                   {0},                      0, {0x11, 0x22, 0x33, 0x44}},
    {"bit 0 set",                             0, 1, {0xFF},                   {0x02},                   1, {0x13, 0x22, 0x33, 0x44}},
    {"bit 0 cleared",                         0, 1, {0x00},                   {0x01},                   1, {0x10, 0x22, 0x33, 0x44}},
    {"bits outside of the mask do not count",
     2,                                          1,
     {0xF0},
     {0x0F},
     1,                                                                                                    {0x11, 0x22, 0x30, 0x44}},
    {"a mask across two bytes",
     1,                                          2,
     {0xAB, 0xCD},
     {0x0F, 0xF0},
     1,                                                                                                    {0x11, 0x2B, 0xC3, 0x44}},
    {"an empty mask",                         0, 4, {0xFF, 0xFF, 0xFF, 0xFF}, {0},                      1, {0x11, 0x22, 0x33, 0x44}},
    {"a full mask",                           0, 4, {1, 2, 3, 4},             {0xFF, 0xFF, 0xFF, 0xFF}, 1, {1, 2, 3, 4}            },
};

static void testWrites(void)
{
    static const epicsUInt8 before[] = {0x11, 0x22, 0x33, 0x44};
    size_t i;

    for (i = 0; i < sizeof(writes) / sizeof(writes[0]); i++) {
        plcImage *image = plcImageCreate(4);
        epicsUInt8 got[4];

        plcImageWrite(image, 0, 4, before, NULL);
        plcImageWrite(image, writes[i].offset, writes[i].length, writes[i].src,
                      writes[i].masked ? writes[i].mask : NULL);
        plcImageTake(image, got);
        testOk(memcmp(got, writes[i].expect, 4) == 0, "write of %s", writes[i].what);
        plcImageDestroy(image);
    }
}

static void testDirty(void)
{
    plcImage *image = plcImageCreate(3);
    char got[3] = "";

    testOk(!plcImageDirty(image), "a new image has nothing to send");
    plcImagePeek(image, 0, 3, got);
    testOk(memcmp(got, "\0\0\0", 3) == 0, "it is all zero");
    testOk(plcImageWrite(image, 1, 1, "x", NULL) == 1, "the first write says so");
    testOk(plcImageWrite(image, 2, 1, "y", NULL) == 0, "the second is not the first");
    testOk(plcImageDirty(image), "now there is something to send");
    plcImagePeek(image, 0, 3, got);
    testOk(memcmp(got, "\0xy", 3) == 0 && plcImageDirty(image),
           "peek does not forget it");
    plcImageTake(image, got);
    testOk(memcmp(got, "\0xy", 3) == 0 && !plcImageDirty(image), "take does");
    plcImageTouch(image);
    testOk(plcImageDirty(image), "touch makes it leave again");
    testOk(plcImageWrite(image, 0, 1, "z", NULL) == 0,
           "a write after touch is not the first");
    plcImageTake(image, got);
    testOk(plcImageWrite(image, 0, 1, "z", NULL) == 1,
           "the same value after take is a first write");
    plcImageDestroy(image);
}

static void testEmpty(void)
{
    plcImage *image = plcImageCreate(0);
    char nothing[1] = "#";

    plcImagePublish(image, NULL, &stampA);
    testOk(plcImageRead(image, 0, 0, nothing, NULL) == 0, "an image of 0 bytes is read");
    testOk(plcImageWrite(image, 0, 0, nothing, NULL) == 1, "and written");
    plcImageTake(image, nothing);
    plcImagePeek(image, 0, 0, nothing);
    testOk(nothing[0] == '#', "and no byte is copied");
    plcImageDestroy(image);
    plcImageDestroy(NULL);
}

/* --- Threads: a block is always filled with one byte value -------------------------- */

#define BLOCK 4096
#define ROUNDS 3000

typedef struct race {
    plcImage *in, *out;
    int tornIn, tornOut, wrongStamps; /* atomic: what must not happen */
} race;

static int isUniform(const epicsUInt8 *bytes, size_t n)
{
    return memcmp(bytes, bytes + 1, n - 1) == 0;
}

static void publish(race *r, int i)
{
    epicsUInt8 block[BLOCK];
    epicsTimeStamp stamp = {(epicsUInt32)i, 0};

    memset(block, i & 0xFF, BLOCK);
    plcImagePublish(r->in, block, &stamp);
}

static void publisher(void *arg)
{
    race *r = arg;
    epicsUInt8 block[BLOCK];
    int i;

    for (i = 0; i < ROUNDS; i++) {
        publish(r, i);
        if (i % 100 == 0)
            plcImageInvalidate(r->in, "silent");
        plcImageTake(r->out, block);
        if (!isUniform(block, BLOCK))
            epicsAtomicIncrIntT(&r->tornOut);
    }
}

static void reader(void *arg)
{
    race *r = arg;
    epicsUInt8 block[BLOCK];
    epicsTimeStamp stamp;
    int i;

    for (i = 0; i < ROUNDS; i++) {
        if (plcImageRead(r->in, 0, BLOCK, block, &stamp) == 0) {
            if (!isUniform(block, BLOCK))
                epicsAtomicIncrIntT(&r->tornIn);
            if ((epicsUInt8)stamp.secPastEpoch != block[0])
                epicsAtomicIncrIntT(&r->wrongStamps);
        }
        if (plcImageRead(r->in, BLOCK / 2 - 3, 8, block, NULL) == 0 &&
            !isUniform(block, 8))
            epicsAtomicIncrIntT(&r->tornIn);
    }
}

static void writer(void *arg)
{
    race *r = arg;
    epicsUInt8 block[BLOCK];
    int i;

    for (i = 0; i < ROUNDS; i++) {
        memset(block, i & 0xFF, BLOCK);
        plcImageWrite(r->out, 0, BLOCK, block, NULL);
    }
}

/* One thread of the race. (epicsThreadMustJoin cannot be had in all releases of Base 7.) */
typedef struct racer {
    EPICSTHREADFUNC function;
    race *r;
    epicsEventId ended;
} racer;

static void runRacer(void *arg)
{
    racer *own = arg;

    own->function(own->r);
    epicsEventMustTrigger(own->ended);
}

/* All end after their rounds, whatever the scheduler does. */
static void testThreads(void)
{
    static EPICSTHREADFUNC const functions[] = {publisher, reader, reader, reader,
                                                writer};
    race r = {plcImageCreate(BLOCK), plcImageCreate(BLOCK), 0, 0, 0};
    racer racers[sizeof(functions) / sizeof(functions[0])];
    size_t i;

    publish(&r, 0);
    for (i = 0; i < sizeof(racers) / sizeof(racers[0]); i++) {
        racers[i] = (racer){functions[i], &r, epicsEventMustCreate(epicsEventEmpty)};
        epicsThreadMustCreate("race", epicsThreadPriorityMedium,
                              epicsThreadGetStackSize(epicsThreadStackMedium), runRacer,
                              &racers[i]);
    }
    for (i = 0; i < sizeof(racers) / sizeof(racers[0]); i++) {
        epicsEventMustWait(racers[i].ended);
        epicsEventDestroy(racers[i].ended);
    }
    testOk(r.tornIn == 0, "three readers saw no torn block");
    testOk(r.wrongStamps == 0, "the stamp always belonged to the block");
    testOk(r.tornOut == 0, "the sender took no half-written block");
    plcImageDestroy(r.in);
    plcImageDestroy(r.out);
}

MAIN(imageTest)
{
    testPlan(13 + 10 + 10 + 3 + 3);
    testDiag("Input");
    testInput();
    testDiag("Output");
    testWrites();
    testDirty();
    testDiag("No bytes");
    testEmpty();
    testDiag("Threads");
    testThreads();
    return testDone();
}
