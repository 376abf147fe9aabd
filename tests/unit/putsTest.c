/* Puts on their way: their order, which of them take the place of others, and what leaves
 * together; at last a random walk against a plain list. */
#include <stdlib.h>
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcPuts.h"

enum { size = 8 };

static epicsUInt8 values[size], mask[size];

static epicsUInt64 add(plcPuts *p, size_t offset, const char *data, const char *bits,
                       int edges)
{
    plcPut put = {offset, strlen(data), (const epicsUInt8 *)data, (const epicsUInt8 *)bits,
                  NULL};

    return plcPutsAdd(p, &put, edges);
}

/* What leaves next, as text: a letter for each byte that is put, '.' for the others. */
static const char *next(plcPuts *p, int (*joins)(void *, const plcPut *), void *arg)
{
    static char text[size + 1];
    int i;

    memset(mask, 0, size);
    if (!plcPutsTake(p, joins, arg, values, mask))
        return "";
    for (i = 0; i < size; i++)
        text[i] = mask[i] ? (char)values[i] : '.';
    plcPutsDone(p);
    return text;
}

static int always(void *arg, const plcPut *put)
{
    (void)arg;
    (void)put;
    return 1;
}

/* Joins what begins where the last one ended. */
static int neighbours(void *arg, const plcPut *put)
{
    size_t *end = arg, before = *end;

    *end = put->offset + put->length;
    return put->offset == before;
}

static void order(void)
{
    plcPuts *p = plcPutsCreate(size, 100);
    size_t end = 0;

    add(p, 4, "A", NULL, 0);
    add(p, 0, "B", NULL, 0);
    add(p, 4, "C", NULL, 0);
    testOk(plcPutsCount(p) == 3, "three puts wait");
    testOk(!strcmp(next(p, NULL, NULL), "....A..."), "the first leaves first");
    testOk(!strcmp(next(p, NULL, NULL), "B......."), "then the second");
    testOk(!strcmp(next(p, NULL, NULL), "....C..."), "then the third, to the place of the first");
    testOk(!strcmp(next(p, NULL, NULL), ""), "then nothing");
    add(p, 1, "A", NULL, 0);
    add(p, 1, "B", NULL, 0);
    testOk(plcPutsCount(p) == 1 && !strcmp(next(p, NULL, NULL), ".B......"),
           "a value that follows directly on another takes its place");
    add(p, 1, "A", NULL, 1);
    add(p, 1, "B", NULL, 1);
    testOk(plcPutsCount(p) == 2, "but not where every value counts");
    testOk(!strcmp(next(p, always, NULL), ".A......") && !strcmp(next(p, always, NULL), ".B......"),
           "and both of a bit never leave together");
    add(p, 1, "A", NULL, 1);
    add(p, 1, "A", NULL, 1);
    testOk(plcPutsCount(p) == 1, "the same value twice is one");
    plcPutsVoidAll(p);
    add(p, 0, "AB", NULL, 0);
    add(p, 2, "C", NULL, 0);
    add(p, 4, "D", NULL, 0);
    end = size;
    testOk(!strcmp(next(p, neighbours, &end), "ABC....."), "neighbours leave together");
    testOk(!strcmp(next(p, neighbours, &end), "....D..."), "then who is none");
    add(p, 0, "AB", NULL, 0);
    add(p, 1, "B", NULL, 0);
    testOk(!strcmp(next(p, always, NULL), "AB......"), "what changes nothing may join");
    plcPutsDestroy(p);
}

static void bits(void)
{
    plcPuts *p = plcPutsCreate(size, 100);

    add(p, 0, "\x01", "\x01", 1);
    add(p, 0, "\xfe", "\x02", 1);
    memset(mask, 0, size);
    testOk(plcPutsTake(p, always, NULL, values, mask) == 2 && mask[0] == 3 &&
               (values[0] & 3) == 3,
           "bits of one byte leave together");
    plcPutsDone(p);
    add(p, 0, "\x01", "\x01", 1);
    add(p, 0, "\xfe", "\x01", 1);
    memset(mask, 0, size);
    testOk(plcPutsTake(p, always, NULL, values, mask) == 1 && (values[0] & 1) == 1,
           "a pulse: set");
    testOk(plcPutsTake(p, always, NULL, values, mask) == 0, "nothing leaves meanwhile");
    plcPutsDone(p);
    testOk(plcPutsTake(p, always, NULL, values, mask) == 1 && (values[0] & 1) == 0,
           "then cleared");
    plcPutsDone(p);
    plcPutsDestroy(p);
}

static void numbers(void)
{
    plcPuts *p = plcPutsCreate(size, 100);
    epicsUInt64 a, b, c;

    testOk(plcPutsThrough(p) == 0, "nothing is through");
    a = add(p, 0, "A", NULL, 0);
    b = add(p, 0, "B", NULL, 0);
    c = add(p, 1, "C", NULL, 0);
    testOk(a == 1 && b == 2 && c == 3, "puts are numbered");
    testOk(plcPutsThrough(p) == 0, "a value whose place was taken is not through");
    next(p, NULL, NULL);
    testOk(plcPutsThrough(p) == b, "but is when the other is");
    memset(mask, 0, size);
    plcPutsTake(p, NULL, NULL, values, mask);
    testOk(plcPutsThrough(p) == b, "what is under way is not through");
    plcPutsBack(p);
    testOk(plcPutsThrough(p) == b && plcPutsCount(p) == 1, "nor when it waits again");
    plcPutsVoid(p, 1, 1, NULL);
    testOk(plcPutsThrough(p) == c && plcPutsCount(p) == 0, "what is void is through");
    plcPutsDestroy(p);
}

/* What is given up, or made no more. */
static void ended(void)
{
    plcPuts *p = plcPutsCreate(size, 100);
    epicsUInt64 a, b, c;

    a = add(p, 0, "A", NULL, 1);
    b = add(p, 1, "B", NULL, 1);
    c = add(p, 1, "C", NULL, 1);
    memset(mask, 0, size);
    testOk(plcPutsTake(p, always, NULL, values, mask) == 2 && plcPutsThrough(p) == 0,
           "two are under way, one waits");
    memset(mask, 0, size);
    mask[0] = 0xff;
    plcPutsEnd(p, mask);
    testOk(plcPutsThrough(p) == a && plcPutsCount(p) == 2, "the bits of one are through");
    plcPutsBack(p);
    memset(mask, 0, size);
    testOk(plcPutsTake(p, NULL, NULL, values, mask) == 1 && !mask[0] && values[1] == 'B',
           "they do not wait again, the others do");
    testOk(plcPutsCancel(p, a) == plcPutThrough, "what is through cannot be cancelled");
    testOk(plcPutsCancel(p, b) == plcPutMaybe && plcPutsThrough(p) == a,
           "what is under way may be made");
    plcPutsBack(p);
    testOk(plcPutsThrough(p) == b && plcPutsCount(p) == 1, "but does not wait again");
    testOk(plcPutsCancel(p, c) == plcPutNever && plcPutsCount(p) == 0 && plcPutsThrough(p) == c,
           "what waits is not made");
    a = add(p, 0, "A", NULL, 0);
    b = add(p, 0, "B", NULL, 0);
    testOk(plcPutsCancel(p, a) == plcPutNever && plcPutsCount(p) == 1,
           "a newer value in its place is left alone");
    testOk(plcPutsCancel(p, b) == plcPutNever && plcPutsCount(p) == 0, "until it is cancelled");
    plcPutsDestroy(p);
}

static void reconnect(void)
{
    plcPuts *p = plcPutsCreate(size, 100);
    size_t end = size;

    add(p, 3, "A", NULL, 1);
    add(p, 1, "B", NULL, 1);
    add(p, 3, "C", NULL, 1);
    memset(mask, 0, size);
    plcPutsTake(p, NULL, NULL, values, mask);
    plcPutsBack(p);
    plcPutsAway(p, 1);
    testOk(plcPutsCount(p) == 2, "of each place the newest waits for the PLC");
    add(p, 1, "D", NULL, 1);
    testOk(plcPutsCount(p) == 2, "also of what is put meanwhile");
    memset(mask, 0, size);
    plcPutsBits(p, mask);
    testOk(!memcmp(mask, "\0\xff\0\xff\0\0\0\0", size), "which bits wait is known");
    plcPutsAway(p, 0);
    testOk(plcPutsAhead(p, "abcdefgh", "\xff\xff\0\0\0\0\0\xff") == 1,
           "what the PLC has lost is put again");
    testOk(!strcmp(next(p, neighbours, &end), "a......h"),
           "it leaves first, but for what was put since");
    testOk(!strcmp(next(p, neighbours, &end), "...C...."), "then what was put");
    testOk(!strcmp(next(p, neighbours, &end), ".D......"), "in its order");
    testOk(plcPutsAhead(p, "abcdefgh", "\0\0\0\0\0\0\0\0") == 0, "nothing is put again");
    add(p, 0, "E", NULL, 1);
    add(p, 1, "F", NULL, 1);
    add(p, 0, "G", NULL, 1);
    plcPutsAway(p, 0);
    testOk(plcPutsCount(p) == 3, "while it is there each put waits, however often that is said");
    plcPutsDestroy(p);
}

/* While what the PLC has lost is put again, what was put since is cancelled, or another value of it
 * comes. */
static void cancelledMeanwhile(int sent)
{
    const char *what = sent ? "is on its way" : "waits";
    plcPuts *p = plcPutsCreate(size, 100);
    plcLastPut who = {.offset = 0, .length = 1, .masked = 1, .mask = "\x01", .bytes = (epicsUInt8[1]){0}};
    plcPut put = {0, 1, (const epicsUInt8 *)"\x01", (const epicsUInt8 *)"\x01", &who};
    epicsUInt64 a = add(p, 3, "A", NULL, 1);

    plcPutsAhead(p, "abcdefgh", "\xff\xff\0\0\0\0\0\0");
    if (sent)
        plcPutsTake(p, NULL, NULL, values, mask);
    testOk(plcPutsCancel(p, a) == plcPutNever && plcPutsCount(p) == 1,
           "what is put again %s: what waits behind it is not made", what);
    if (sent)
        plcPutsBack(p);
    testOk(!strcmp(next(p, always, NULL), "ab......") && plcPutsCount(p) == 0,
           "and what is put again leaves as a whole");
    plcPutsUse(p, 1);
    plcPutsAsk(p, &who);
    plcPutsAhead(p, "\x01", "\x01");
    plcPutsAdd(p, &put, 1);
    testOk(plcPutsCount(p) == 2, "the same value, put by somebody, is one of its own");
    plcPutsVoidAll(p);
    plcPutsDestroy(p);
}

/* What is put again, and nobody wants any more. */
static void notAgain(int sent)
{
    const char *what = sent ? "is on its way" : "waits";
    plcPuts *p = plcPutsCreate(size, 100);

    plcPutsAhead(p, "abcdefgh", "\xff\xff\0\0\0\0\0\0");
    if (sent)
        plcPutsTake(p, NULL, NULL, values, mask);
    add(p, 0, "A", NULL, 1);
    plcPutsAgainNot(p, 0, 1, NULL);
    testOk(plcPutsCount(p) == 2, "what is put again %s: without one of its bytes it is still made", what);
    plcPutsAgainNot(p, 1, 1, NULL);
    testOk(plcPutsCount(p) == 1, "without the other it is gone");
    if (sent)
        plcPutsBack(p);
    testOk(!strcmp(next(p, always, NULL), "A.......") && !strcmp(next(p, always, NULL), ""),
           "and what somebody has put stays");
    plcPutsDestroy(p);
}

static void tooMany(void)
{
    plcPuts *p = plcPutsCreate(size, 4);
    int i;

    for (i = 0; i < 20; i++) {
        char text[2] = {(char)('a' + i), 0};

        add(p, i % 2 ? 5 : 2, text, NULL, 1);
    }
    testOk(plcPutsCount(p) <= 5 && plcPutsDropped(p) > 0, "too many: they are thinned out");
    testOk(plcPutsDropped(p) + plcPutsCount(p) == 20, "and what was dropped is counted");
    while (plcPutsCount(p) > 2)
        next(p, NULL, NULL);
    testOk(!strcmp(next(p, NULL, NULL), "..s.....") && !strcmp(next(p, NULL, NULL), ".....t.."),
           "the newest of each place are there");
    plcPutsDestroy(p);
}

/* Whatever happens: bits leave with the values that were put, in their order, and at the end
 * the PLC holds the newest of each. */
static void randomWalk(unsigned seed)
{
    plcPuts *p = plcPutsCreate(size, 50);
    epicsUInt8 plc[size] = {0}, want[size] = {0}, sent[size], bits[size];
    int away = 0, wrong = 0, round;

    srand(seed);
    for (round = 0; round < 2000; round++) {
        int what = rand() % 10;

        if (what < 5) {
            size_t offset = (size_t)rand() % size, length = 1 + (size_t)rand() % (size - offset);
            epicsUInt8 data[size], some[size];
            size_t i;
            int masked = rand() % 2;
            plcPut put = {offset, length, data, masked ? some : NULL, NULL};

            for (i = 0; i < length; i++) {
                data[i] = (epicsUInt8)rand();
                some[i] = masked ? (epicsUInt8)(1 << rand() % 8) : 0xff;
                want[offset + i] = (epicsUInt8)((want[offset + i] & ~some[i]) |
                                                (data[i] & some[i]));
            }
            plcPutsAdd(p, &put, rand() % 2);
        } else if (what < 8 && !away) {
            size_t i;

            memset(bits, 0, size);
            memcpy(sent, plc, size);
            plcPutsTake(p, rand() % 2 ? always : NULL, NULL, sent, bits);
            if (rand() % 4 == 0) {
                plcPutsBack(p);
                continue;
            }
            for (i = 0; i < size; i++)
                plc[i] = (epicsUInt8)((plc[i] & ~bits[i]) | (sent[i] & bits[i]));
            plcPutsDone(p);
        } else if (what == 8) {
            away = !away;
            plcPutsAway(p, away);
        } else if (what == 9) {
            epicsUInt8 all[size];
            size_t i;

            for (i = 0; i < size; i++)
                all[i] = plc[i] ^ want[i];
            memset(bits, 0, size);
            plcPutsBits(p, bits);
            for (i = 0; i < size; i++)
                wrong += (all[i] & ~bits[i]) != 0;
        }
    }
    while (plcPutsCount(p)) {
        size_t i;

        memset(bits, 0, size);
        plcPutsTake(p, NULL, NULL, sent, bits);
        for (i = 0; i < size; i++)
            plc[i] = (epicsUInt8)((plc[i] & ~bits[i]) | (sent[i] & bits[i]));
        plcPutsDone(p);
    }
    testOk(!wrong && !memcmp(plc, want, size), "a random walk ends with the newest values");
    plcPutsDestroy(p);
}

/* Links that change at run time put to places that are not in use yet. */
static void behind(void)
{
    static const epicsUInt8 image[size] = "abcd", all[size] = {255, 255, 255, 255};
    plcPuts *p = plcPutsCreate(size, 100);

    plcPutsUse(p, 4);
    add(p, 6, "AB", NULL, 0);
    plcPutsVoidAll(p);
    add(p, 6, "CD", NULL, 0);
    testOk(plcPutsCount(p) == 1, "behind what is in use a void put leaves nothing behind");
    testOk1(plcPutsAhead(p, image, all) == 1);
    testOk1(strcmp(next(p, always, NULL), "abcd..CD") == 0);
    plcPutsDestroy(p);
}

/* What an image would hold if all that waits had left. */
static void overlay(void)
{
    plcPuts *p = plcPutsCreate(size, 100);
    epicsUInt8 bytes[3] = "abc";

    testOk(!plcPutsOverlay(p, 0, size, NULL, NULL), "nothing waits anywhere");
    add(p, 2, "XY", NULL, 0);
    add(p, 4, "\x0f", "\x05", 1);
    testOk(plcPutsOverlay(p, 3, 1, NULL, NULL) && !plcPutsOverlay(p, 1, 1, NULL, NULL) &&
               !plcPutsOverlay(p, 5, 3, NULL, NULL),
           "bytes for which something waits, and their neighbours");
    testOk(plcPutsOverlay(p, 4, 1, "\x04", NULL) && !plcPutsOverlay(p, 4, 1, "\x0a", NULL),
           "of a bit only that bit");
    testOk(plcPutsOverlay(p, 1, 3, NULL, bytes) && memcmp(bytes, "aXY", 3) == 0,
           "they are put over what stands there");
    bytes[0] = 0xf0;
    testOk(plcPutsOverlay(p, 4, 1, NULL, bytes) && bytes[0] == 0xf5, "bit by bit");
    add(p, 4, "\x10", "\x01", 1);
    bytes[0] = 0xf0;
    testOk(plcPutsOverlay(p, 4, 1, NULL, bytes) && bytes[0] == 0xf4, "the newest counts");
    plcPutsDestroy(p);
}

/* Under way when the connection is lost, and while the PLC is away more is put. */
static void backWhileAway(void)
{
    plcPuts *p = plcPutsCreate(size, 100);

    add(p, 1, "A", NULL, 1);
    add(p, 1, "B", NULL, 1);
    add(p, 3, "C", NULL, 1);
    memset(mask, 0, size);
    plcPutsTake(p, NULL, NULL, values, mask);
    plcPutsAway(p, 1);
    plcPutsBack(p);
    testOk(plcPutsCount(p) == 2, "of each place one put is left");
    testOk(!strcmp(next(p, NULL, NULL), ".B......") && !strcmp(next(p, NULL, NULL), "...C....") ,
           "the newest, in the order of the places");
    plcPutsDestroy(p);
    p = plcPutsCreate(0, 100);
    testOk(!plcPutsAhead(p, "", ""), "an image of no bytes has nothing to put again");
    plcPutsDestroy(p);
    p = plcPutsCreate(size, 100);
    plcPutsAhead(p, "abcdefgh", "\xff\0\0\0\0\0\0\0");
    plcPutsAway(p, 1);
    testOk(plcPutsCount(p) == 1 && !strcmp(next(p, NULL, NULL), "a......."),
           "what is to be put again is thinned out as well, and stays");
    plcPutsDestroy(p);
    p = plcPutsCreate(size, 100);
    add(p, 0, "AB", NULL, 0);
    add(p, 4, "CD", NULL, 0);
    plcPutsVoid(p, 2, 2, NULL);
    testOk(plcPutsCount(p) == 2, "puts beside the bytes that are taken out stay");
    plcPutsVoid(p, 1, 1, NULL);
    testOk(!strcmp(next(p, NULL, NULL), "A.......") && !strcmp(next(p, NULL, NULL), "....CD.."),
           "of one that is half in it the other half stays");
    plcPutsDestroy(p);
}

static epicsUInt64 addAsking(plcPuts *p, plcLastPut *who, const char *data)
{
    plcPut put = {who->offset, who->length, (const epicsUInt8 *)data, NULL, who};

    return plcPutsAdd(p, &put, 0);
}

static void takeAll(plcPuts *p)
{
    memset(mask, 0, size);
    plcPutsTake(p, always, NULL, values, mask);
}

/* What one is told who asks for his puts of bytes 2 and 3. */
static void asking(void)
{
    static const epicsUInt8 shown[size] = "..AB....";
    epicsUInt8 bytes[2];
    plcPuts *p = plcPutsCreate(size, 100);
    plcLastPut who = {.offset = 2, .length = 2, .bytes = bytes, .tells = 1};

    plcPutsAsk(p, &who);
    addAsking(p, &who, "AB");
    testOk(who.waits && !who.why[0], "a put waits");
    takeAll(p);
    plcPutsFail(p, 0, 2, NULL, "refused");
    plcPutsFail(p, 4, 2, NULL, "refused");
    testOk(!plcPutsFailed(p), "what is refused on both sides of it is none of his");
    plcPutsFail(p, 3, 1, NULL, "refused");
    testOk(plcPutsFailed(p) && strcmp(who.why, "refused") == 0, "a byte of it is: %s", who.why);
    plcPutsDone(p);
    testOk(!who.waits, "it waits no more");
    testOk(plcPutsShown(p, shown, NULL) == 0 && plcPutsFailed(p),
           "that the PLC shows it all the same may be older, once");
    testOk(plcPutsShown(p, shown, NULL) == 1 && !plcPutsFailed(p) && !who.why[0], "the second time it is there");
    addAsking(p, &who, "CD");
    takeAll(p);
    plcPutsFail(p, 2, 2, NULL, "no answer");
    plcPutsBack(p);
    testOk(plcPutsFailed(p) && who.waits, "what has failed and waits again has still failed");
    plcPutsReplace(p, 2, 1, "C", NULL);
    testOk(plcPutsFailed(p) && who.waits, "also when the PLC has a part of it by itself");
    plcPutsReplace(p, 2, 2, "CD", NULL);
    testOk(!plcPutsFailed(p) && !who.waits && plcPutsCount(p) == 0, "until it has all of it");
    addAsking(p, &who, "AB");
    takeAll(p);
    plcPutsFail(p, 2, 2, NULL, "refused");
    plcPutsDone(p);
    testOk(plcPutsShown(p, shown, NULL) == 0 && plcPutsShown(p, shown, NULL) == 1,
           "after each refusal what the PLC shows may be older once");
    addAsking(p, &who, "EF");
    plcPutsReplace(p, 2, 1, "X", NULL);
    testOk(strcmp(who.why, plcNotWritten) == 0 && !strcmp(next(p, NULL, NULL), "...F...."),
           "another value in a part of its place: %s", who.why);
    plcPutsAskNot(p, &who);
    plcPutsDestroy(p);
}

/* Two of one place, and one beside it: what is put again is put for all whose last put it is. */
static void askingTogether(void)
{
    epicsUInt8 bytes[3][2];
    plcPuts *p = plcPutsCreate(size, 100);
    plcLastPut one = {.offset = 2, .length = 2, .bytes = bytes[0]}, two = one, beside = one;

    two.bytes = bytes[1];
    beside.bytes = bytes[2];
    beside.offset = 6;
    plcPutsAsk(p, &beside);
    plcPutsAsk(p, &one);
    plcPutsAsk(p, &two);
    addAsking(p, &beside, "ab");
    addAsking(p, &one, "AB");
    addAsking(p, &two, "CD");
    testOk(!one.waits && two.waits && plcPutsCount(p) == 2, "the put of one is where that of another was");
    takeAll(p);
    plcPutsDone(p);
    plcPutsAhead(p, "..CD..ab", (const epicsUInt8 *)"\0\0\xff\xff\0\0\0\0");
    takeAll(p);
    plcPutsFail(p, 2, 2, NULL, "refused");
    plcPutsDone(p);
    testOk(!strcmp(one.why, "refused") && !strcmp(two.why, "refused") && !beside.why[0],
           "both are told that it is refused when it is put again");
    plcLastPutFail(p, &one, PLC_PUT_NEVER, "never made");
    plcLastPutFail(p, &one, one.number, "refused");
    testOk(!strcmp(one.why, "never made"), "what was never made stays so: %s", one.why);
    plcLastPutForgive(p, &two);
    addAsking(p, &two, "EF");
    plcPutsAskNot(p, &one);
    plcPutsAskNot(p, &two);
    takeAll(p);
    plcPutsFail(p, 2, 2, NULL, "refused");
    plcPutsDone(p);
    testOk(!plcPutsFailed(p) && !two.why[0], "who asks no more is told nothing");
    plcPutsDestroy(p);
}

MAIN(putsTest)
{
    unsigned i;

    testPlan(87 + 7 + 5 + 10 + 11 + 4 + 6 + 6);
    order();
    bits();
    numbers();
    ended();
    reconnect();
    cancelledMeanwhile(0);
    cancelledMeanwhile(1);
    notAgain(0);
    notAgain(1);
    tooMany();
    behind();
    overlay();
    backWhileAway();
    asking();
    askingTogether();
    for (i = 0; i < 50; i++)
        randomWalk(i);
    return testDone();
}
