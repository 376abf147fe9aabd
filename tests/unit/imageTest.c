/* Images: validity, masks, the dirty flag, edges of bits, which bits were written, and no torn block
 * among threads. */
#include <stdio.h>
#include <string.h>

#include <epicsAtomic.h>
#include <epicsEvent.h>
#include <epicsThread.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcImagePvt.h"

static const epicsTimeStamp stampA = {1000, 5}, stampB = {2000, 7};

static int reasonIs(plcImage *image, const char *expected)
{
    char reason[PLC_REASON_SIZE];

    plcImageReason(image, reason);
    return strcmp(reason, expected) == 0;
}

static int writeTo(plcImage *image, size_t offset, size_t length, const void *src,
                   const void *mask)
{
    return plcImageWrite(image, offset, length, src, mask, NULL);
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

/* A reader whom blocks overtake again and again copies with the lock at last. What it copies moves the
 * count of blocks itself here: into the count goes the first word of a block, and the stamp becomes the
 * first word of the buffer that an even count shows. It reads block 3, then 2, 4 and 6: three were
 * overtaken, and the fourth shows itself. */
static void testOvertaken(void)
{
    static const epicsTimeStamp four = {4, 4}, six = {6, 6};
    word block[16] = {2}, last;
    plcImage *image = plcImageCreate(sizeof(block));
    int i;

    for (i = 1; i <= 3; i++)
        plcImagePublish(image, block, i == 3 ? &four : &six);
    memcpy(&last, &six, sizeof(last));
    testOk(plcImageRead(image, 0, sizeof(last), &image->blocks,
                        (epicsTimeStamp *)(image->words[0] + STAMP_WORDS)) == 0 &&
               image->blocks == last,
           "a reader who is overtaken three times has the fourth block");
    plcImageDestroy(image);
}

/* Puts of bits between two takes, as letters: lower case clears, upper case sets bit 0 (a), 1 (b)
 * of byte 0; "1".."9" put byte 1 as a number; "+" takes; "-" the PLC goes away, "*" it is back; "="
 * it shows 0x03 in byte 0; "#" closes and opens. Each take is two digits, bytes 0 and 1. */
static const struct {
    const char *what, *steps, *taken;
    unsigned waiting;
} edges[] = {
    {"a pulse is seen as set, then as cleared", "*Aa++", "10 00", 0},
    {"so are two pulses", "*AaAa++++", "10 00 10 00", 0},
    {"a change that has left may be undone at once", "*A+a+", "10 00", 0},
    {"what is cleared twice is cleared once", "*Aaa++", "10 00", 0},
    {"a pulse of 0 too", "*A+aA++", "10 00 10", 0},
    {"another bit does not wait", "*AaB++", "30 20", 0},
    {"what follows on one that waits does too", "*AaABb+++", "30 20 10", 0},
    {"numbers: the newest counts", "*123+", "03", 0},
    {"numbers do not wait for bits", "*Aa5++", "15 05", 0},
    {"nothing waits while the PLC is away", "AaA*+", "10", 0},
    {"what waits is in the image when the PLC goes away", "*AaA-*+", "10", 0},
    {"and when it is cleared last", "*Aa-*+", "00", 0},
    {"what the PLC shows voids what waits", "*Aa=+", "30", 0},
    {"and counts as what has left", "*=a+", "20", 0},
    {"a change of what it has shown may not be undone", "*=aA++", "20 30", 0},
    {"what waits is in the image when it is closed", "*Aa#+", "00", 0},
    {"two of three edges wait", "*AaA", "", 2},
};

static void edgeStep(plcImage *image, char step, char *taken)
{
    static const epicsUInt8 bit[] = {1, 2}, none = 0, shown = 3;
    epicsUInt8 bytes[2];

    if (strchr("aAbB", step)) {
        const epicsUInt8 *mask = &bit[(step | 0x20) - 'a'];

        writeTo(image, 0, 1, step & 0x20 ? &none : mask, mask);
    } else if (step >= '1' && step <= '9') {
        bytes[0] = (epicsUInt8)(step - '0');
        writeTo(image, 1, 1, bytes, NULL);
    } else if (step == '+') {
        plcImageTake(image, bytes);
        sprintf(taken + strlen(taken), "%s%d%d", taken[0] ? " " : "", bytes[0], bytes[1]);
    } else if (step == '=') {
        plcImageSet(image, 0, 1, &shown, NULL, NULL);
    } else if (step == '#') {
        plcImageClose(image, 1);
        plcImageClose(image, 0);
    } else {
        plcImageAway(image, step == '-');
    }
}

static void testEdges(void)
{
    size_t i;

    for (i = 0; i < sizeof(edges) / sizeof(edges[0]); i++) {
        plcImage *image = plcImageCreate(2);
        char taken[80] = "";
        const char *c;

        plcImageKeepEdges(image, 100);
        for (c = edges[i].steps; *c; c++)
            edgeStep(image, *c, taken);
        testOk(strcmp(taken, edges[i].taken) == 0 &&
                   plcImagePutsWaiting(image, NULL, NULL) == edges[i].waiting,
               "%s: %s", edges[i].what, taken);
        plcImageDestroy(image);
    }
}

/* What waits is what is shown; it is dirty until all has left; too many are thinned out. */
static void testEdgesSeen(void)
{
    plcImage *image = plcImageCreate(1);
    epicsUInt8 seen = 9;
    plcWritten written = {.last = NULL};
    epicsUInt64 dropped = 0;
    int i, takes = 0;

    plcImageKeepEdges(image, 4);
    plcImageAway(image, 0);
    testOk(plcImageWrite(image, 0, 1, "\1", "\1", &written) == 1 && written.takes == 0,
           "a change of a bit: it leaves with the next take");
    testOk(plcImageWrite(image, 0, 1, "\0", "\1", &written) == 0 && written.takes == 1,
           "it is undone: that leaves with the one after it");
    plcImagePeek(image, 0, 1, &seen);
    testOk(seen == 0 && plcImageDirty(image), "what was put last is shown");
    testOk(plcImageTake(image, &seen) == 0 && seen == 1 && plcImageDirty(image),
           "after the first take it is dirty again");
    plcImageTake(image, &seen);
    testOk(seen == 0 && !plcImageDirty(image), "and clean after the second");
    for (i = 0; i < 41; i++)
        writeTo(image, 0, 1, i % 2 ? "\0" : "\1", "\1");
    plcImagePutsThrough(image, &dropped);
    testOk(dropped > 30 && plcImagePutsWaiting(image, NULL, NULL) <= 4,
           "too many edges: %u dropped", (unsigned)dropped);
    while (plcImageDirty(image) && takes++ < 10)
        plcImageTake(image, &seen);
    testOk(seen == 1 && takes < 10, "the last value is the last that leaves");
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

        writeTo(image, 0, 4, before, NULL);
        writeTo(image, writes[i].offset, writes[i].length, writes[i].src,
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
    testOk(writeTo(image, 1, 1, "x", NULL) == 1, "the first write says so");
    testOk(writeTo(image, 2, 1, "y", NULL) == 0, "the second is not the first");
    testOk(plcImageDirty(image), "now there is something to send");
    plcImagePeek(image, 0, 3, got);
    testOk(memcmp(got, "\0xy", 3) == 0 && plcImageDirty(image),
           "peek does not forget it");
    plcImageTake(image, got);
    testOk(memcmp(got, "\0xy", 3) == 0 && !plcImageDirty(image), "take does");
    plcImageTouch(image);
    testOk(plcImageDirty(image), "touch makes it leave again");
    testOk(writeTo(image, 0, 1, "z", NULL) == 0,
           "a write after touch is not the first");
    plcImageTake(image, got);
    testOk(writeTo(image, 0, 1, "z", NULL) == 1,
           "the same value after take is a first write");
    plcImageDestroy(image);
}

static void testEmpty(void)
{
    plcImage *image = plcImageCreate(0);
    char nothing[1] = "#";

    plcImagePublish(image, NULL, &stampA);
    testOk(plcImageRead(image, 0, 0, nothing, NULL) == 0, "an image of 0 bytes is read");
    testOk(writeTo(image, 0, 0, nothing, NULL) == 1, "and written");
    plcImageTake(image, nothing);
    plcImagePeek(image, 0, 0, nothing);
    testOk(nothing[0] == '#', "and no byte is copied");
    plcImageDestroy(image);
    plcImageDestroy(NULL);
}

/* --- Which bits were written -------------------------------------------------------- */

static int always(void *arg, const plcPut *put)
{
    (void)arg;
    (void)put;
    return 1;
}

/* All that waits leaves: the image, and the bits that were put. */
static void takeChanges(plcImage *image, void *bytes, void *mask)
{
    plcImageHandOver(image);
    memset(mask, 0, plcImageSize(image));
    plcImagePeek(image, 0, plcImageSize(image), bytes);
    while (plcImagePutsWaiting(image, NULL, NULL)) {
        if (plcImageTakePuts(image, always, NULL, bytes, mask))
            plcImagePutsDone(image);
    }
}

static int takes(plcImage *image, const char *bytes, const char *mask)
{
    char gotBytes[4], gotMask[4];

    takeChanges(image, gotBytes, gotMask);
    return memcmp(gotBytes, bytes, 4) == 0 && memcmp(gotMask, mask, 4) == 0 &&
           !plcImageDirty(image);
}

static void testChanges(void)
{
    plcImage *image = plcImageCreate(4);

    plcImageKeepPuts(image, 1000);
    testOk(takes(image, "\0\0\0\0", "\0\0\0\0"), "nothing was written at first");
    writeTo(image, 1, 2, "AB", NULL);
    writeTo(image, 3, 1, "\x0F", "\x03");
    testOk(takes(image, "\0AB\x03", "\0\xFF\xFF\x03"), "two bytes and two bits");
    testOk(takes(image, "\0AB\x03", "\0\0\0\0"), "once");
    writeTo(image, 1, 1, "A", NULL);
    testOk(takes(image, "\0AB\x03", "\0\xFF\0\0"), "the same value again is a write");
    writeTo(image, 1, 1, "a", NULL);
    plcImageForget(image);
    testOk(takes(image, "\0aB\x03", "\0\0\0\0"), "not what is forgotten");
    writeTo(image, 1, 1, "b", NULL);
    plcImageTake(image, (char[4]){0});
    testOk(takes(image, "\0bB\x03", "\0\0\0\0"), "nor what was taken as a whole");
    plcImageTouch(image);
    testOk(plcImageDirty(image) && takes(image, "\0bB\x03", "\0\0\0\0"),
           "touch writes no bit");
    plcImageClose(image, 1);
    testOk(writeTo(image, 0, 1, "x", NULL) == -1 &&
               takes(image, "\0bB\x03", "\0\0\0\0"),
           "nor does a write that is refused");
    plcImageDestroy(image);
}

/* What is put again where the PLC shows this */
static int again(plcImage *image, const char *shown, const epicsUInt8 *joined, const char *mask)
{
    char bytes[8], got[8];

    if (!plcImagePutAgain(image, shown, joined))
        return 0;
    takeChanges(image, bytes, got);
    return memcmp(got, mask, 8) == 0 && memcmp(bytes, "ABCDE\0G\x08", 8) == 0;
}

static void testOwedWhole(void)
{
    static const epicsUInt8 joined[8] = {0, 1, 1, 1}; /* a value of four bytes */
    plcImage *image = plcImageCreate(8);
    char taken[8];

    plcImageKeepPuts(image, 1000);
    writeTo(image, 0, 5, "ABCDE", NULL);
    writeTo(image, 6, 2, "G\x08", "\xFF\x0F");
    plcImageTake(image, taken);
    testOk(again(image, "ABCE" "E\0G\x08", joined, "\xFF\xFF\xFF\xFF\0\0\0\0"),
           "a value that differs is put again whole");
    testOk(again(image, "ABCD" "D\0F\x07", joined, "\0\0\0\0\x01\0\x01\x0F"),
           "but only bits where a part of its register is not ours");
    testOk(again(image, "ABCE" "E\0G\x08", NULL, "\0\0\0\x01\0\0\0\0"),
           "or where nobody says what a value is");
    writeTo(image, 5, 1, "\0", NULL);
    plcImageTake(image, taken);
    testOk(again(image, "ABCD" "E\1G\x08", joined, "\0\0\0\0\xFF\xFF\0\0"),
           "both bytes of a register together");
    plcImageDestroy(image);
}

static void testOwed(void)
{
    plcImage *image = plcImageCreate(4);

    plcImageKeepPuts(image, 1000);
    testOk(plcImagePutAgain(image, "wxyz", NULL) == 0 && plcImagePutAgain(image, NULL, NULL) == 0 &&
               !plcImageDirty(image),
           "who has written nothing has nothing to put again");
    writeTo(image, 0, 2, "AB", NULL);
    writeTo(image, 3, 1, "\x02", "\x03");
    testOk(takes(image, "AB\0\x02", "\xFF\xFF\0\x03"), "written and taken");
    testOk(plcImagePutAgain(image, "AB\x55\xF2", NULL) == 0 && !plcImageDirty(image),
           "a PLC that shows it gets nothing");
    testOk(plcImagePutAgain(image, "ACzz", NULL) == 1 && plcImageDirty(image) &&
               takes(image, "AB\0\x02", "\0\x01\0\0"),
           "else the bits that differ");
    testOk(plcImagePutAgain(image, NULL, NULL) == 1 && takes(image, "AB\0\x02", "\xFF\xFF\0\x03"),
           "or all, if it shows nothing");
    testOk(plcImageSet(image, 0, 1, "A", NULL, NULL) == 0 &&
               plcImagePutAgain(image, NULL, NULL) == 1 && takes(image, "AB\0\x02", "\0\xFF\0\x03"),
           "what was set meanwhile is not ours any more, though it was the same");
    testOk(plcImageSet(image, 1, 1, "C", NULL, "D") == 0 &&
               plcImagePutAgain(image, "AA\0\x02", NULL) && takes(image, "AB\0\x02", "\0\x03\0\0"),
           "it is when another value was expected there");
    writeTo(image, 1, 1, "E", NULL);
    testOk(plcImageSet(image, 1, 1, "\0", "\x0F", "E") == 1 && plcImagePutAgain(image, NULL, NULL) &&
               takes(image, "A\x40\0\x02", "\0\xF0\0\x03"),
           "bits that are set take only themselves out, also of what waits");
    writeTo(image, 2, 1, "z", NULL);
    testOk(plcImagePutAgain(image, "A\x40z\x02", NULL) == 0 &&
               takes(image, "A\x40z\x02", "\0\0\xFF\0"),
           "what waits leaves in any case");
    plcImageDestroy(image);

    testOwedWhole();
    image = plcImageCreate(0);
    plcImageKeepPuts(image, 1000);
        testOk(plcImagePutAgain(image, NULL, NULL) == 0, "an image of 0 bytes has nothing to put again");
    plcImageDestroy(image);

    image = plcImageCreate(4);
    writeTo(image, 0, 4, "ABCD", NULL);
    testOk(plcImagePutAgain(image, NULL, NULL) == 0, "an image that keeps no puts has none to put again");
    plcImageDestroy(image);
}

/* A put of somebody who asks what becomes of it */
static void testAsked(void)
{
    plcImage *image = plcImageCreate(4);
    epicsUInt8 room[1], got[4], mask[4];
    plcLastPut last = {.length = 1, .bytes = room};
    plcWritten written = {.last = &last};

    plcImageKeepPuts(image, 1000);
    plcImageAsk(image, &last);
    plcImageWrite(image, 0, 1, "A", NULL, &written);
    plcImageTakePuts(image, NULL, NULL, got, mask);
    plcImagePutsFail(image, 1, 3, NULL, "refused");
    testOk(!plcImagePutsFailed(image), "what is refused behind it is none of it");
    plcImagePutsFail(image, 0, 1, NULL, "refused");
    testOk(plcImagePutsFailed(image), "that it is refused is known");
    plcImageAskNot(image, &last);
    plcImageDestroy(image);
}

/* A put that its record has taken back */
static void testCancel(void)
{
    plcImage *image = plcImageCreate(4);
    plcWritten first = {.last = NULL}, second = {.last = NULL};

    plcImageKeepPuts(image, 1000);
    plcImageWrite(image, 0, 1, "A", NULL, &first);
    testOk(plcImageCancel(image, first.number, 0, 1, NULL) == plcPutNever &&
               takes(image, "A\0\0\0", "\0\0\0\0") && !plcImagePutAgain(image, NULL, NULL),
           "a put that waits and is taken back never leaves, on this connection or another");
    plcImageWrite(image, 1, 1, "B", NULL, &first);
    testOk(takes(image, "AB\0\0", "\0\xFF\0\0") &&
               plcImageCancel(image, first.number, 1, 1, NULL) == plcPutThrough &&
               plcImagePutAgain(image, NULL, NULL) && takes(image, "AB\0\0", "\0\xFF\0\0"),
           "one that is through is put again as ever");
    plcImageWrite(image, 2, 1, "\x03", "\x03", &first);
    plcImageWrite(image, 2, 1, "\x00", "\x02", &second);
    writeTo(image, 3, 1, "z", NULL);
    testOk(plcImageCancel(image, first.number, 2, 1, "\x03") == plcPutNever &&
               second.number > first.number && takes(image, "AB\x01z", "\0\0\x02\xFF"),
           "of two bits a newer put of one leaves, and that of the byte behind it");
    testOk(plcImagePutAgain(image, NULL, NULL) && takes(image, "AB\x01z", "\0\xFF\x02\xFF"),
           "which alone are put again");
    plcImageDestroy(image);
}

/* One whose place its record leaves, while its value, which was refused, waits for its second try. */
static void testWithdraw(int when)
{
    static const char *const whens[] = {"before a reconnect", "when it waits to be put again",
                                        "when that is on its way"};
    plcImage *image = plcImageCreate(4);
    epicsUInt8 bytes[1] = {0}, values[4], mask[4] = {0};
    plcLastPut last = {.offset = 1, .length = 1, .bytes = bytes};
    plcWritten written = {.last = &last};

    plcImageKeepPuts(image, 1000);
    plcImageAsk(image, &last);
    writeTo(image, 0, 1, "A", NULL);
    plcImageWrite(image, 1, 1, "B", NULL, &written);
    plcImageTakePuts(image, always, NULL, values, mask);
    plcImagePutsFail(image, 1, 1, NULL, "refused");
    plcImagePutsDone(image);
    if (when)
        plcImagePutAgain(image, NULL, NULL);
    if (when == 2)
        plcImageTakePuts(image, always, NULL, values, mask);
    plcImageWithdraw(image, &last);
    if (when == 2)
        plcImagePutsBack(image);
    if (!when)
        plcImagePutAgain(image, NULL, NULL);
    testOk(takes(image, "AB\0\0", "\xFF\0\0\0"),
           "a refused put whose record leaves its place %s is not put again, others are", whens[when]);
    testOk(plcImagePutAgain(image, NULL, NULL) && takes(image, "AB\0\0", "\xFF\0\0\0"),
           "nor on another connection");
    plcImageAskNot(image, &last);
    plcImageDestroy(image);
}

/* --- Which bits were written: against a model --------------------------------------- */

#define SMALL 12
#define STEPS 200000

typedef struct model {
    epicsUInt8 bytes[SMALL], changed[SMALL], ours[SMALL];
    int dirty;
} model;

static epicsUInt32 seed = 4711;

static epicsUInt32 random32(epicsUInt32 below)
{
    seed = seed * 1664525u + 1013904223u;
    return (seed >> 8) % below;
}

/* Few different bytes, so that values are often the same. */
static void randomBytes(epicsUInt8 *bytes)
{
    static const epicsUInt8 some[] = {0, 1, 0x80, 0xFF};
    int i;

    for (i = 0; i < SMALL; i++)
        bytes[i] = some[random32(4)];
}

static int sameBytes(const epicsUInt8 *a, const epicsUInt8 *b, size_t n)
{
    while (n && a[n - 1] == b[n - 1])
        n--;
    return n == 0;
}

/* Puts bits; returns 1 when one changed. */
static int modelPut(model *m, size_t offset, size_t length, const epicsUInt8 *src,
                    const epicsUInt8 *mask, int ours)
{
    size_t bit;
    int changed = 0;

    for (bit = 0; bit < 8 * length; bit++) {
        size_t at = offset + bit / 8;
        epicsUInt8 one = (epicsUInt8)(1 << bit % 8);

        if (!(mask[bit / 8] & one))
            continue;
        changed |= (m->bytes[at] ^ src[bit / 8]) & one;
        m->bytes[at] = (epicsUInt8)((m->bytes[at] & ~one) | (src[bit / 8] & one));
        m->changed[at] =
            (epicsUInt8)(ours ? m->changed[at] | one : m->changed[at] & ~one);
        m->ours[at] = (epicsUInt8)(ours ? m->ours[at] | one : m->ours[at] & ~one);
    }
    return changed != 0;
}

static int modelAgain(model *m, const epicsUInt8 *shown)
{
    int i, any = 0;

    for (i = 0; i < SMALL; i++) {
        epicsUInt8 again = m->ours[i] & (shown ? shown[i] ^ m->bytes[i] : 0xFF);

        m->changed[i] |= again;
        any |= again;
    }
    m->dirty |= any != 0;
    return any != 0;
}

static void modelForget(model *m)
{
    memset(m->changed, 0, SMALL);
    m->dirty = 0;
}

/* One random step on both. Returns 0 when they agree. */
static int randomStep(plcImage *image, model *m)
{
    epicsUInt8 src[SMALL], mask[SMALL], expected[SMALL], got[SMALL], gotMask[SMALL];
    size_t offset = random32(SMALL + 1);
    size_t length = random32((epicsUInt32)(SMALL - offset + 1));
    int masked = random32(2) != 0, wrong = 0;

    randomBytes(src);
    memset(mask, 0xFF, SMALL);
    if (masked)
        randomBytes(mask);
    memcpy(expected, m->bytes + offset, length);
    if (length && random32(2))
        expected[random32((epicsUInt32)length)] ^= (epicsUInt8)random32(2);
    switch (random32(8)) {
    case 0:
    case 1:
        wrong =
            writeTo(image, offset, length, src, masked ? mask : NULL) == m->dirty;
        modelPut(m, offset, length, src, mask, 1);
        m->dirty = 1;
        break;
    case 2:
        wrong = plcImageSet(image, offset, length, src, masked ? mask : NULL, NULL) !=
                modelPut(m, offset, length, src, mask, 0);
        break;
    case 3:
        wrong = plcImageSet(image, offset, length, src, masked ? mask : NULL, expected) !=
                (sameBytes(expected, m->bytes + offset, length) &&
                 modelPut(m, offset, length, src, mask, 0));
        break;
    case 4:
        wrong =
            plcImagePutAgain(image, masked ? src : NULL, NULL) != modelAgain(m, masked ? src : NULL);
        break;
    case 5:
        takeChanges(image, got, gotMask);
        wrong =
            !sameBytes(got, m->bytes, SMALL) || !sameBytes(gotMask, m->changed, SMALL);
        modelForget(m);
        break;
    case 6:
        if (masked)
            plcImageForget(image);
        else
            plcImageTake(image, got);
        modelForget(m);
        break;
    default:
        plcImageTouch(image);
        m->dirty = 1;
    }
    plcImagePeek(image, 0, SMALL, got);
    return wrong || plcImageDirty(image) != m->dirty || !sameBytes(got, m->bytes, SMALL);
}

static void testModel(void)
{
    plcImage *image = plcImageCreate(SMALL);
    model m = {{0}, {0}, {0}, 0};
    int i, wrong = 0;

    plcImageKeepPuts(image, 1000);
    for (i = 0; i < STEPS; i++)
        wrong += randomStep(image, &m);
    testOk(wrong == 0, "%d random steps as the model says, %d wrong", STEPS, wrong);
    plcImageDestroy(image);
}

/* --- Threads: a block is always filled with one byte value -------------------------- */

#define BLOCK 4096
#define ROUNDS 3000

typedef struct race {
    plcImage *in, *out;
    int tornIn, tornOut, wrongStamps; /* atomic: what must not happen */
    int writersEnded;                 /* atomic */
    epicsUInt8 held[4];               /* of bitTaker */
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
        writeTo(r->out, 0, BLOCK, block, NULL);
    }
}

/* Writes its own bytes, and its own bit of a byte that is shared. */
#define WRITERS 3

static void bitWriter(race *r, int number)
{
    epicsUInt8 value, mask = (epicsUInt8)(1 << number);
    int i;

    for (i = 0; i < 2 * ROUNDS; i++) {
        value = (epicsUInt8)(i * 7);
        writeTo(r->out, (size_t)number, 1, &value, NULL);
        writeTo(r->out, WRITERS, 1, &value, &mask);
    }
    epicsAtomicIncrIntT(&r->writersEnded);
}

static void bitWriter0(void *r)
{
    bitWriter(r, 0);
}
static void bitWriter1(void *r)
{
    bitWriter(r, 1);
}
static void bitWriter2(void *r)
{
    bitWriter(r, 2);
}

/* Plays the PLC: holds what came with its mask. Now and then it has lost everything. */
static void bitTaker(void *arg)
{
    race *r = arg;
    epicsUInt8 bytes[WRITERS + 1], mask[WRITERS + 1];
    int last, round, i;

    for (round = 0, last = 0; !last; round++) {
        last = epicsAtomicGetIntT(&r->writersEnded) == WRITERS;
        if (round % 100 == 99) {
            memset(r->held, round & 0xFF, sizeof(r->held));
            plcImagePutAgain(r->out, round % 200 == 99 ? r->held : NULL, NULL);
        }
        takeChanges(r->out, bytes, mask);
        for (i = 0; i <= WRITERS; i++)
            r->held[i] = (epicsUInt8)((r->held[i] & ~mask[i]) | (bytes[i] & mask[i]));
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

/* Runs all functions, each in a thread, until each of them has ended. */
static void runRace(race *r, const EPICSTHREADFUNC *functions, size_t count)
{
    racer racers[8];
    size_t i;

    for (i = 0; i < count; i++) {
        racers[i] = (racer){functions[i], r, epicsEventMustCreate(epicsEventEmpty)};
        epicsThreadMustCreate("race", epicsThreadPriorityMedium,
                              epicsThreadGetStackSize(epicsThreadStackMedium), runRacer,
                              &racers[i]);
    }
    for (i = 0; i < count; i++) {
        epicsEventMustWait(racers[i].ended);
        epicsEventDestroy(racers[i].ended);
    }
}

/* All end after their rounds, whatever the scheduler does. */
static void testThreads(void)
{
    static EPICSTHREADFUNC const functions[] = {publisher, reader, reader, reader,
                                                writer};
    race r = {.in = plcImageCreate(BLOCK), .out = plcImageCreate(BLOCK)};

    publish(&r, 0);
    runRace(&r, functions, sizeof(functions) / sizeof(functions[0]));
    testOk(r.tornIn == 0, "three readers saw no torn block");
    testOk(r.wrongStamps == 0, "the stamp always belonged to the block");
    testOk(r.tornOut == 0, "the sender took no half-written block");
    plcImageDestroy(r.in);
    plcImageDestroy(r.out);
}

static void locker(void *arg)
{
    race *r = arg;

    if (epicsMutexTryLock(r->in->lock) != epicsMutexLockOK)
        return;
    r->tornIn = 1;
    epicsMutexUnlock(r->in->lock);
}

/* A reader who is not overtaken has nothing to do with the lock; here he has it for another reason. */
static void testNotOvertaken(void)
{
    static EPICSTHREADFUNC const functions[] = {locker};
    race r = {.in = plcImageCreate(BLOCK)};
    char got[4];

    publish(&r, 0);
    epicsMutexMustLock(r.in->lock);
    plcImageRead(r.in, 0, 4, got, NULL);
    runRace(&r, functions, 1);
    testOk(!r.tornIn, "a reader who is not overtaken does not give the lock back");
    epicsMutexUnlock(r.in->lock);
    plcImageDestroy(r.in);
}

static void testBitThreads(void)
{
    static EPICSTHREADFUNC const functions[] = {bitTaker, bitWriter0, bitWriter1,
                                                bitWriter2};
    race r = {.out = plcImageCreate(WRITERS + 1)};
    epicsUInt8 bytes[WRITERS + 1];

    plcImageKeepPuts(r.out, 1000);
    runRace(&r, functions, sizeof(functions) / sizeof(functions[0]));
    plcImagePeek(r.out, 0, sizeof(bytes), bytes);
    testOk(memcmp(bytes, r.held, WRITERS) == 0 &&
               ((bytes[WRITERS] ^ r.held[WRITERS]) & 7) == 0,
           "every written bit has left with its last value");
    plcImageDestroy(r.out);
}

/* Puts that leave one by one, and only a part of the image in use. */
static void testPuts(void)
{
    plcImage *image = plcImageCreate(8);
    epicsTimeStamp stamp = {1, 2};
    char values[8] = "........", block[8] = "abcdefgh";
    epicsUInt8 mask[8];
    epicsUInt64 dropped;

    plcImageUse(image, 4);
    testOk(plcImageSize(image) == 4, "four bytes of eight are in use");
    plcImagePublish(image, block, &stamp);
    testOk(memcmp(plcImageBytes(image), "abcd\0\0", 6) == 0, "and no others are copied");
    plcImageKeepPuts(image, 10);
    plcImageUse(image, 6);
    plcImageAllEdges(image, 1);
    plcImageWrite(image, 1, 1, "X", NULL, NULL);
    plcImageWrite(image, 1, 1, "Y", NULL, NULL);
    testOk(plcImagePutsWaiting(image, values, mask) == 2 && memcmp(mask, "\0\xff\0\0\0\0", 6) == 0 &&
               values[1] == 'Y' && values[0] == '.',
           "each value waits, and the newest of them is shown");
    plcImageTakePuts(image, NULL, NULL, values, mask);
    plcImageHandOver(image);
    testOk(values[1] == 'X' && !plcImageDirty(image), "the first leaves");
    plcImagePutsBack(image);
    testOk(plcImagePutsWaiting(image, NULL, mask) == 2 && plcImagePutsThrough(image, &dropped) == 0 &&
               !dropped,
           "and comes back");
    plcImageAway(image, 1);
    testOk(plcImagePutsWaiting(image, NULL, NULL) == 1 && !plcImageDirty(image),
           "while the PLC is away one of each place waits");
    plcImageAway(image, 0);
    testOk(plcImageDirty(image), "back: it wants to leave");
    plcImageTakePuts(image, NULL, NULL, values, mask);
    plcImagePutsDone(image);
    testOk(values[1] == 'Y' && plcImagePutsThrough(image, &dropped) == 2, "it is the newest");
    plcImageAllEdges(image, 0);
    plcImageWrite(image, 1, 1, "V", NULL, NULL);
    plcImageWrite(image, 1, 1, "W", NULL, NULL);
    testOk(plcImagePutsWaiting(image, NULL, NULL) == 1, "where not each value counts the newest waits");
    plcImageDestroy(image);
}

MAIN(imageTest)
{
    int when;

    testPlan(17 + 7 + 13 + 1 + 1 + 2 + 10 + 10 + 3 + 8 + 11 + 4 + 1 + 9 + 3 + 1 + 4 + 6);
    testDiag("Input");
    testEdges();
    testEdgesSeen();
    testInput();
    testOvertaken();
    testDiag("Output");
    testWrites();
    testDirty();
    testDiag("No bytes");
    testEmpty();
    testDiag("Which bits were written");
    testChanges();
    testOwed();
    testAsked();
    testCancel();
    for (when = 0; when < 3; when++)
        testWithdraw(when);
    testModel();
    testPuts();
    testDiag("Threads");
    testThreads();
    testNotOvertaken();
    testBitThreads();
    return testDone();
}
