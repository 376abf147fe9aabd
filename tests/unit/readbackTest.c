/* Read-backs: what the output image takes of what the PLC shows, and what it leaves alone
 * because a put is on its way. One byte that is put and shown in turns, step by step.
 */
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcReadback.h"

#define LIMIT 1000000000u /* ns */
#define STEP 1000000u

static plcReadback *r, *more;
static plcImage *out;
static epicsUInt64 now;
static int through;

static void begin(void)
{
    now = LIMIT;
    through = 1;
    r = plcReadbackCreate();
    more = plcReadbackCreate();
    out = plcImageCreate(4);
    plcReadbackNote(r, 1);
    plcReadbackNote(more, 1);
}

static void end(void)
{
    plcReadbackDestroy(r);
    plcReadbackDestroy(more);
    plcImageDestroy(out);
}

static void putByte(size_t offset, char byte, const void *mask)
{
    plcWritten written = {.last = NULL};

    plcReadbackWrite(r, more, out, offset, 1, &byte, mask, &written, now);
}

static void leave(void)
{
    char bytes[4];

    plcImageTake(out, bytes);
}

static unsigned show(const char *block)
{
    return plcReadbackTrack(r, block, NULL, out, now, LIMIT, through, NULL);
}

static char held(size_t offset)
{
    char byte;

    plcImagePeek(out, offset, 1, &byte);
    return byte;
}

/* --- One place ---------------------------------------------------------------------------
 * pX a put of X    t a block leaves    sX=Y the PLC shows X, then the image holds Y
 * w the limit goes by   < the PLC does not fetch what is sent, > it does
 * L another PLC leads and gets the image    K the image may have left at any time */
static const struct {
    const char *what, *steps;
} rows[] = {
    {"what the PLC changes is taken", "sA=A sB=B sC=C"},
    {"a put stays until the PLC shows it", "pB sA=B t sA=B sB=B sC=C"},
    {"a put that the PLC shows at once", "pB t sB=B sC=C"},
    {"a put whose value the PLC shows before it has left: that is an older one of the same value",
     "sA=A pB sB=B sA=B t sA=B sB=B sC=C"},
    {"a put that goes back before the PLC has shown the new value",
     "pB t sA=B pA t sA=A sA=A sB=A sB=A sA=A sC=C"},
    {"the same, and both leave before the next block", "pB t pA t sA=A sB=A sA=A sC=C"},
    {"the same, and the first never leaves", "pB pA t sA=A sC=C"},
    {"the same, and the PLC never shows the first", "pB t pA t sA=A sC=A w sC=C"},
    {"to and fro and to", "pB t pA t pB t sA=B sB=B sA=B sB=B sC=C"},
    {"to and fro and to and fro, some not shown", "pB t pA t pB t pA t sA=A sB=A sA=A sB=A sA=A"},
    {"to, and fro and to in one block", "pB t pA pB t sA=B sB=B sC=C"},
    {"a value, another, and the first again",
     "pB t pC t pB t sA=B sB=B sC=B sB=B sD=D"},
    {"the same value twice in a row, then another",
     "pB t pB pC t pB t sA=B sB=B sC=B sB=B sD=D"},
    {"a put of what is shown, while the PLC changes it", "pA sC=A t sC=A sA=A sC=C"},
    {"what the PLC refuses comes back", "pB t sA=B w sA=A"},
    {"what the PLC clips comes back as it is", "pZ t sA=Z sY=Z w sY=Y"},
    {"the limit counts from when the put has left", "pB sA=B w sA=B w sA=B t sA=B w sA=A"},
    {"and when the PLC has got it", "< pB t sA=B w sA=B w sA=B > sA=B w sA=A"},
    {"a second put begins anew", "pB t sA=B w pC sA=C t sA=C sB=C sC=C sD=D"},
    {"more puts than can be told apart: the limit",
     "pB t pC t pD t pE t pF t pG t pH t pI t pJ t sB=J sJ=J sI=J sJ=J w sK=K"},
    {"as many as can be told apart: seven puts and what was before",
     "pB t pC t pD t pE t pF t pG t pH t sB=H sH=H sK=K"},
    {"one more: the limit", "pB t pC t pD t pE t pF t pG t pH t pI t sB=I sI=I sK=I w sK=K"},
    {"another PLC gets what the first had", "pB t sB=B L sA=B t sA=B sB=B sC=C"},
    {"another PLC gets it, and what was put meanwhile",
     "pB t sB=B L pC sA=C t sA=C sC=C sD=D"},
    {"another PLC that does not take it", "pB t sB=B L sA=B t sA=B w sA=A"},
    {"another PLC, and none of the old one's blocks count", "pB t sA=B L sB=B t sB=B sA=A"},
    {"tracking begins while a put may be on its way", "K sB=A sC=A w sD=D"},
};

/* Returns what is wrong, or 0. */
static int play(const char *steps)
{
    const char *at;

    for (at = steps; *at; at += strcspn(at, " "), at += strspn(at, " ")) {
        now += STEP;
        switch (*at) {
        case 'p': putByte(0, at[1], NULL); break;
        case 't': leave(); break;
        case 'w': now += LIMIT; break;
        case '<': through = 0; break;
        case '>': through = 1; break;
        case 'K': plcReadbackWait(r, out, now, 0); break;
        case 'L':
            plcImageTouch(out);
            plcReadbackWait(r, out, now, 1);
            break;
        default:
            show(at + 1);
            if (held(0) != at[3]) {
                testDiag("after \"%.*s\" the image holds %c", (int)(at + 4 - steps), steps,
                         held(0));
                return (int)(at - steps) + 1;
            }
        }
    }
    return 0;
}

static void testSteps(void)
{
    size_t i;

    for (i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        begin();
        plcReadbackAdd(r, &r, 0, 0, 1, NULL);
        plcReadbackTake(r, "A", NULL, out);
        testOk(play(rows[i].steps) == 0, "%s", rows[i].what);
        end();
    }
}

/* --- Several ----------------------------------------------------------------------------- */

static void testMasks(void)
{
    static const char lower = 0x0F, upper = (char)0xF0;

    begin();
    plcReadbackAdd(r, &lower, 0, 0, 1, &lower);
    plcReadbackAdd(r, &upper, 0, 0, 1, &upper);
    plcReadbackTake(r, "\x11", NULL, out);
    putByte(0, 0x02, &lower);
    show("\x31");
    testOk(held(0) == 0x32, "a put of some bits leaves the others to the PLC");
    testOk(plcReadbackWaiting(r) == 1, "one place waits");
    leave();
    show("\x42");
    testOk(held(0) == 0x42 && plcReadbackWaiting(r) == 0, "until the PLC shows its bits");
    end();
}

static void putTwo(const char *bytes)
{
    plcWritten written = {.last = NULL};

    plcReadbackWrite(r, more, out, 0, 2, bytes, NULL, &written, now);
    leave();
}

/* The same bytes in another order are another value: a put to and fro is shown by both. */
static void testOrder(void)
{
    static const int both = 0;

    begin();
    plcReadbackAdd(r, &both, 0, 0, 2, NULL);
    plcReadbackTake(r, "xy", NULL, out);
    putTwo("yx");
    putTwo("xy");
    show("xy");
    testOk(plcReadbackWaiting(r) == 1, "what is shown is of before the puts");
    show("yx");
    testOk(held(0) == 'x' && held(1) == 'y', "the first of them changes nothing");
    show("xy");
    testOk(plcReadbackWaiting(r) == 0, "the second one ends it");
    end();
}

/* What the PLC does not show is not taken, bit by bit. */
static void testHidden(void)
{
    static const int first = 0, bits = 0, last = 0;

    begin();
    plcReadbackAdd(r, &first, 0, 0, 1, NULL);
    plcReadbackAdd(r, &bits, 1, 1, 1, "\x0f");
    plcReadbackAdd(r, &last, 2, 2, 2, NULL);
    plcReadbackTake(r, "abcd", "\0\x10\0\x80", out);
    testOk(held(0) == 'a', "hidden bytes: what is shown is taken");
    testOk(held(1) == ('b' & 0x0f), "other bits of the same byte hide nothing");
    testOk(held(2) == 0 && held(3) == 0, "a place of which a bit is hidden is not taken");
    leave();
    end();
}

static void testOverlap(void)
{
    static const int whole = 0, byte = 0;

    begin();
    plcReadbackAdd(r, &whole, 0, 0, 4, NULL);
    plcReadbackAdd(r, &byte, 1, 1, 1, NULL);
    plcReadbackTake(r, "abcd", NULL, out);
    putByte(1, 'B', NULL);
    show("abcX");
    testOk(held(1) == 'B', "a put in the mirror of a whole block stays");
    leave();
    show("aBcX");
    testOk(held(1) == 'B', "until it is shown");
    show("xbcX");
    testOk(held(0) == 'a' && held(1) == 'b', "then the place itself follows, the rest waits");
    now += LIMIT;
    show("xbcX");
    testOk(held(0) == 'x' && held(1) == 'b' && held(3) == 'X',
           "until all is as the PLC shows it");
    end();
}

static void testNew(void)
{
    static const int first = 0, second = 0, third = 0, fourth = 0;

    begin();
    plcReadbackNote(r, 0);
    plcReadbackAdd(r, &first, 0, 0, 1, NULL);
    plcReadbackTake(r, "abcd", NULL, out);
    testOk(plcReadbackTakeNew(r, "xyz", NULL, out) == 0 && held(0) == 'a',
           "a place that has its value takes no other");
    plcReadbackAdd(r, &second, 1, 1, 1, NULL);
    plcReadbackAdd(r, &third, 2, 2, 1, NULL);
    putByte(2, 'P', NULL);
    testOk(plcReadbackTakeNew(r, "xyz", NULL, out) == 1 && held(1) == 'y',
           "a new place takes what the PLC shows");
    testOk(held(2) == 'P' && held(0) == 'a', "but not where a put came first");
    testOk(plcReadbackTakeNew(r, "xYz", NULL, out) == 0 && held(1) == 'y', "and once");
    plcReadbackAdd(r, &fourth, 1, 1, 1, NULL);
    testOk(plcReadbackTrack(r, "ayP", NULL, out, now, LIMIT, 1, NULL) == 1,
           "a place that joins another one is told its value, which is no new one");
    testOk(plcReadbackTrack(r, "ayP", NULL, out, now, LIMIT, 1, NULL) == 0, "once");
    plcReadbackRemove(r, &fourth);
    plcReadbackRemove(r, &second);
    plcReadbackRemove(r, &third);
    testOk(plcReadbackCount(r) == 1 && plcReadbackTakeNew(r, "x", NULL, out) == 0, "none is left");
    end();
}

/* A put of before has had its time, but not this one. */
static void testMore(void)
{
    static const int place = 0;

    begin();
    plcReadbackAdd(more, &place, 0, 0, 1, NULL);
    plcReadbackTake(more, "a", NULL, out);
    putByte(0, 'b', NULL);
    plcImageHandOver(out);
    plcReadbackTrack(more, "a", NULL, out, now, LIMIT, 1, NULL);
    now += LIMIT;
    putByte(0, 'c', NULL);
    testOk(plcReadbackTrack(more, "a", NULL, out, now, LIMIT, 1, NULL) == 0 && held(0) == 'c',
           "a second list has its note with the put");
    end();
}

/* Two places share a byte that the PLC changes: the second one finds it changed already. */
static void testShared(void)
{
    static const int first = 0, second = 0;

    begin();
    plcReadbackAdd(r, &first, 0, 0, 2, NULL);
    plcReadbackAdd(r, &second, 1, 1, 2, NULL);
    plcReadbackTake(r, "abc", NULL, out);
    show("aXc");
    testOk(held(0) == 'a' && held(1) == 'X' && held(2) == 'c', "both have what the PLC shows");
    now += STEP;
    show("aYz");
    testOk(held(1) == 'Y' && held(2) == 'c', "what is of the second alone waits, as for a put");
    now += LIMIT;
    show("aYz");
    testOk(held(1) == 'Y' && held(2) == 'z', "and follows after that");
    end();
}

/* A wire that tells what was read after which put: neither time nor value counts. */
static void testAfter(void)
{
    static const int place = 0, other = 0;
    plcShownAfter after = {0, "\0\0\0\0"};

    begin();
    plcImageKeepPuts(out, 10);
    plcReadbackAdd(r, &place, 0, 0, 2, NULL);
    plcReadbackAdd(r, &other, 1, 1, 2, NULL);
    plcReadbackTake(r, "abc", NULL, out);
    putByte(0, 'X', NULL);
    now += 2 * LIMIT;
    plcReadbackTrack(r, "abc", NULL, out, now, LIMIT, 1, &after);
    testOk(held(0) == 'X', "a put that is not through stays, however long it takes");
    plcReadbackTrack(r, "Xbd", NULL, out, now, LIMIT, 1, &after);
    plcReadbackTrack(r, "abd", NULL, out, now, LIMIT, 1, &after);
    testOk(held(0) == 'X', "also when the PLC shows it, and then another value");
    testOk(held(2) == 'd', "another place follows");
    after = (plcShownAfter){1, "\0\1\0\0"};
    plcReadbackTrack(r, "abe", NULL, out, now, LIMIT, 1, &after);
    testOk(held(0) == 'X' && held(2) == 'e', "it is through, a bit of it was not read since");
    after.older = "\0\0\0\0";
    plcReadbackTrack(r, "abe", NULL, out, now, LIMIT, 1, &after);
    testOk(held(0) == 'a' && held(2) == 'e', "read after it was through: the PLC's value counts");
    plcReadbackTrack(r, "zyx", NULL, out, now, LIMIT, 1, &after);
    testOk(held(0) == 'z' && held(1) == 'y' && held(2) == 'x',
           "places that share bytes follow at once");
    end();
}

/* Does the PLC show what we hold? And who keeps no notes. */
static void testSame(void)
{
    static const int whole = 0, bits = 0;
    static const unsigned char low = 0x0f;

    begin();
    testOk(plcReadbackSame(r, "xxxx", out), "without places anything is the same");
    plcReadbackAdd(r, &whole, 1, 0, 2, NULL);
    plcReadbackAdd(r, &bits, 3, 2, 1, &low);
    plcReadbackTake(r, "AB3.", NULL, out);
    testOk(plcReadbackSame(r, "AB3.", out), "what was taken is the same");
    testOk(plcReadbackSame(r, "ABC.", out) && !plcReadbackSame(r, "AB4.", out),
           "of bits only these count");
    testOk(!plcReadbackSame(r, "AX3.", out), "another byte is not");
    end();
    begin();
    plcReadbackNote(r, 0);
    plcReadbackAdd(r, &whole, 0, 0, 1, NULL);
    plcReadbackTake(r, "A", NULL, out);
    putByte(0, 'B', NULL);
    testOk(plcReadbackWaiting(r) == 0 && held(0) == 'B', "without notes nothing waits, the put is there");
    plcReadbackNote(r, 1);
    putByte(0, 'C', NULL);
    testOk(plcReadbackWaiting(r) == 1 && held(0) == 'C', "with them the place of a put waits");
    end();
}

MAIN(readbackTest)
{
    testPlan((int)(sizeof(rows) / sizeof(rows[0])) + 3 + 4 + 7 + 1 + 3 + 3 + 6 + 6 + 3);
    testSteps();
    testMasks();
    testOrder();
    testOverlap();
    testHidden();
    testNew();
    testMore();
    testShared();
    testAfter();
    testSame();
    return testDone();
}
