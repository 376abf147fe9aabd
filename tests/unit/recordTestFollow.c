/* Outputs with a read-back: every record type takes the PLC's value at the first block of
 * each connection, without a byte that leaves because of it, and follows with track=on. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <callback.h>
#include <dbAccess.h>
#include <dbUnitTest.h>
#include <epicsEvent.h>
#include <epicsStdio.h>
#include <epicsUnitTest.h>
#include <epicsVersion.h>
#include <testMain.h>

#include "recordTest.h"
#include "testTools.h"

#define IN 128
#define OUT 112
#define MIRROR 16 /* the output block is shown in the input block from here on */

/* Each record has its place in the output block; `held` is what the PLC has there. */
static const struct {
    const char *type, *name, *fields; /* with the value of yesterday */
    size_t offset;
    const char *held;  /* hex */
    const char *value; /* of VAL then */
    const char *later; /* hex: changed by the PLC */
    const char *laterValue;
} rows[] = {
    {"ao", "ao", "OUT=@P/0|VAL=9", 0, "00fa", "250", "ff06", "-250"},
    {"ao", "linear", "OUT=@P/2 L=0 H=1000|LINR=LINEAR|EGUF=10|VAL=9", 2, "00fa", "2.5", "03e8",
     "10"},
    {"ao", "slope", "OUT=@P/4 T=WORD|LINR=SLOPE|ESLO=0.5|EOFF=1|VAL=9", 4, "0008", "5", "000a",
     "6"},
    {"ao", "scaled", "OUT=@P/6|ASLO=2|AOFF=1|VAL=9", 6, "0003", "7", "0004", "9"},
    {"ao", "real", "OUT=@P/8 T=FLOAT|ASLO=2|AOFF=1|VAL=77", 8, "40200000", "6", "40a00000",
     "11"},
    {"ao", "large", "OUT=@P/12 T=UINT32|VAL=9", 12, "fffffffe", "4294967294", "80000000",
     "2147483648"},
    {"ao", "slow", "OUT=@P/16|OROC=1|DRVH=100|DRVL=-100|VAL=9", 16, "01f4", "500", "0005",
     "5"},
    {"longout", "long", "OUT=@P/18|VAL=-5", 18, "04d2", "1234", "0000", "0"},
    {"longout", "equal", "OUT=@P/20|VAL=7", 20, "0007", "7", "0008", "8"},
    {"int64out", "int64", "OUT=@P/22 T=INT64|VAL=6", 22, "0000010000000000", "1099511627776",
     "ffffffffffffffff", "-1"},
    {"bo", "bit", "OUT=@P/30 T=BYTE B=2|VAL=0", 30, "56", "1", "52", "0"},
    {"mbbo", "states", "OUT=@P/30 T=BYTE|NOBT=3|SHFT=4|ZRVL=1|ONVL=5|VAL=0", 30, "56", "1",
     "52", "1"},
    {"mbboDirect", "direct", "OUT=@P/30 T=BYTE|NOBT=2|VAL=1", 30, "56", "2", "52", "2"},
    {"mbbo", "raw", "OUT=@P/31 T=BYTE|NOBT=4|VAL=1", 31, "0c", "12", "03", "3"},
    {"mbbo", "noState", "OUT=@P/31 T=BYTE|NOBT=2|SHFT=4|ZRVL=1|ONVL=2|VAL=0", 31, "3c", NULL,
     "33", NULL},
    {"stringout", "text", "OUT=@P/32 L=6|VAL=old", 32, "706c63000000", "plc", "6e6577657221",
     "newer!"},
    {"lso", "longText", "OUT=@P/38 L=4|SIZV=20", 38, "61620000", "ab", "00000000", ""},
    {"aao", "array", "OUT=@P/42|FTVL=SHORT|NELM=2", 42, "00030004", "3,4", "ffff0001", "-1,1"},
    {"aao", "time", "OUT=@P/46 T=TIME|FTVL=UCHAR|NELM=3", 46, "125959", "12,59,59", "130000",
     "13,0,0"},
    {"longout", "words", "OUT=@P/56 T=INT32 W=low|VAL=9", 56, "56781234", "305419896",
     "fffeffff", "-2"},
    {"ao", "realWords", "OUT=@P/60 T=FLOAT W=low|VAL=9", 60, "0000c049", "-3.140625",
     "00004049", "3.140625"},
    {"int64out", "wideWords", "OUT=@P/64 T=INT64 W=low|VAL=9", 64, "0000000001000000",
     "1099511627776", "fffeffffffffffff", "-2"},
    {"bo", "bitWords", "OUT=@P/72 T=DWORD W=low B=16|VAL=0", 72, "00020021", "1", "00010020",
     "0"},
    {"mbbo", "stateWords", "OUT=@P/72 T=DWORD W=low|NOBT=4|SHFT=20|VAL=0", 72, "00020021", "2",
     "00010020", "2"},
    {"mbboDirect", "directWords", "OUT=@P/72 T=DWORD W=low|NOBT=4|VAL=0", 72, "00020021", "2",
     "00010020", "1"},
    {"aao", "arrayWords", "OUT=@P/76 W=low|FTVL=LONG|NELM=2", 76, "0000000100010000",
     "65536,1", "00020000fffeffff", "2,-2"},
    {"calcout", "calc", "OUT=@P/52 T=FLOAT|CALC=A|A=4", 52, "41000000", NULL, "41100000", NULL},
};

static void fill(unsigned char block[IN], int later)
{
    size_t i;

    memset(block, 0, IN);
    for (i = 0; i < COUNT(rows); i++)
        unhex(later ? rows[i].later : rows[i].held, block + MIRROR + rows[i].offset);
}

/* Sends a block that differs in byte 0, and waits until it has come. */
static void sendNext(plcStation *s, int fd, unsigned char *block)
{
    unsigned char byte = 0;

    block[0]++;
    toolSend(fd, block, IN);
    WAIT_FOR(plcImageRead(plcStationInput(s), 0, 1, &byte, NULL) == 0 && byte == block[0]);
}

static void sendNext16(plcStation *s, int fd, unsigned char *block)
{
    unsigned char byte = 0;

    block[0]++;
    toolSend(fd, block, 16);
    WAIT_FOR(plcImageRead(plcStationInput(s), 0, 1, &byte, NULL) == 0 && byte == block[0]);
}

static int isNow(const char *pv, const char *value)
{
    const char *text = get(pv);

    return strcmp(text, value) == 0 ||
           (strchr("0123456789-", value[0]) && value[0] && !strchr(value, ',') &&
            atof(text) == atof(value));
}

static void follow(int later)
{
    char pv[60];
    size_t i;

    for (i = 0; i < COUNT(rows); i++) {
        const char *value = later ? rows[i].laterValue : rows[i].value;

        if (!value)
            continue;
        WAIT_FOR(isNow(rows[i].name, value));
        epicsSnprintf(pv, sizeof(pv), "%s.SEVR", rows[i].name);
        WAIT_FOR(strcmp(get(pv), "NO_ALARM") == 0);
        testOk(isNow(rows[i].name, value) && strcmp(get(pv), "NO_ALARM") == 0,
               "%s %s takes %s", rows[i].type, rows[i].name, value);
    }
    testDiag("an mbbo without a state for the value:");
    testdbGetFieldEqual("noState", DBR_LONG, 65535);
}

/* True when nothing leaves although the station looked around, twice. */
static int silent(plcStation *s, int fd, unsigned char *block)
{
    char bytes[OUT];

    sendNext(s, fd, block);
    sendNext(s, fd, block);
    return toolPeek(fd, bytes, OUT) == 0;
}

static plcStation *begin(const char *pini, const char *option, int *listener)
{
    char address[40], error[200], fields[200];
    int port = 0;
    plcStation *s;
    size_t i;

    *listener = toolListen(&port);
    sprintf(address, "127.0.0.1:%d", port);
    iocBegin();
    s = makeStation("P", 1, IN, OUT);
    sprintf(error, "%d", MIRROR);
    if (plcStationSetOption(s, "readback", error, error, sizeof(error)) ||
        plcStationSetOption(s, "sendInterval", "5", error, sizeof(error)) ||
        (option && plcStationSetOption(s, option, "on", error, sizeof(error))))
        testAbort("%s", error);
    for (i = 0; i < COUNT(rows); i++) {
        epicsSnprintf(fields, sizeof(fields), "%s|PINI=%s", rows[i].fields, pini);
        makeRecord(rows[i].type, rows[i].name, fields);
    }
    plcStationMove(s, address, error, sizeof(error));
    iocRunOk();
    return s;
}

static void testFollow(const char *pini)
{
    unsigned char block[IN], received[OUT];
    int listener, fd;
    plcStation *s;

    testDiag("PINI=%s", pini);
    s = begin(pini, NULL, &listener);
    fd = toolAccept(listener);
    WAIT_FOR(plcStationConnected(s, NULL));
    put("long", "77");
    isMessage("long", "waiting for the PLC's value", "a put before the first block");
    isValue("long.STAT", "COMM", "is COMM");
    fill(block, 0);
    sendNext(s, fd, block);
    follow(0);
    testOk(silent(s, fd, block), "and nothing leaves because of it");
    put("long", "-2");
    memcpy(block + MIRROR + 18, "\xff\xfe", 2);
    testOk(toolReceive(fd, received, OUT) == OUT &&
               memcmp(received, block + MIRROR, OUT) == 0,
           "a put leaves: all else is what the PLC holds");
    sendNext(s, fd, block); /* the PLC goes on: the put has arrived */
    sendNext(s, fd, block);

    toolClose(fd);
    fd = toolAccept(listener);
    WAIT_FOR(plcStationConnected(s, NULL));
    fill(block, 1);
    sendNext(s, fd, block);
    follow(1);
    testOk(silent(s, fd, block), "a new connection: the same, and nothing leaves");
    toolClose(fd);
    toolClose(listener);
    iocEnd();
}

static void testTrack(void)
{
    unsigned char block[IN], received[OUT];
    int listener, fd, i;
    plcStation *s = begin("YES", "track", &listener);

    testDiag("track=on");
    fd = toolAccept(listener);
    fill(block, 0);
    sendNext(s, fd, block);
    WAIT_FOR(isNow("long", "1234"));
    fill(block, 1);
    sendNext(s, fd, block);
    follow(1);
    testOk(silent(s, fd, block), "nothing leaves because of it");
    put("long", "5");
    sendNext(s, fd, block); /* the PLC has not got it yet */
    testOk(toolReceive(fd, received, OUT) == OUT && isNow("long", "5"),
           "a put that is on its way is not undone");
    memcpy(block + MIRROR + 18, "\0\5", 2);
    sendNext(s, fd, block);
    memcpy(block + MIRROR + 18, "\0\6", 2);
    sendNext(s, fd, block);
    WAIT_FOR(isNow("long", "6"));
    testOk(isNow("long", "6"), "once it is there, the PLC may change it again");
    put("long", "9");
    toolReceive(fd, received, OUT);
    WAIT_FOR((sendNext(s, fd, block), isNow("long", "6")));
    testOk(isNow("long", "6"), "a put that the PLC does not take goes back");
    testOk(silent(s, fd, block), "without a block");
    /* The PLC and a client change it at the same time; both see the last word in the end. */
    for (i = 0; i < 50; i++) {
        char text[20];

        sprintf(text, "%d", 100 + i);
        put("long", text);
        if (toolPeek(fd, received, OUT) == OUT)
            memcpy(block + MIRROR, received, OUT);
        if (i % 3 == 0)
            block[MIRROR + 19] = (unsigned char)i;
        sendNext(s, fd, block);
    }
    WAIT_FOR((toolPeek(fd, received, OUT) == OUT ? memcpy(block + MIRROR, received, OUT) : 0,
              sendNext(s, fd, block), atoi(get("long")) == block[MIRROR + 19]));
    testOk(atoi(get("long")) == block[MIRROR + 19], "both at once: equal in the end (%s)",
           get("long"));
    toolClose(fd);
    toolClose(listener);
    iocEnd();
}

/* A record without read-back beside one with it: its value leaves after the first block. */
static void testMixed(void)
{
    unsigned char block[8] = {1, 0, 0, 0, 0, 42}, received[4];
    int port = 0, listener = toolListen(&port), fd;
    char address[40], error[200];
    plcStation *s;

    testDiag("records with and without R=");
    sprintf(address, "127.0.0.1:%d", port);
    iocBegin();
    s = makeStation("P", 1, 8, 4);
    makeRecord("longout", "plain", "OUT=@P/0|VAL=11|PINI=YES");
    makeRecord("longout", "back", "OUT=@P/2 R=4|VAL=22|PINI=YES");
    makeRecord("longout", "bad", "OUT=@P/2 R=7|VAL=22|PINI=YES");
    iocRunOk();
    testOk(strstr(messages(), "\"bad\" OUT: 7 + 2 bytes exceed the input block") != NULL,
           "R= outside of the input block is refused");
    plcStationMove(s, address, error, sizeof(error));
    fd = toolAccept(listener);
    WAIT_FOR(plcStationConnected(s, NULL));
    testOk(toolPeek(fd, received, 4) == 0, "nothing leaves before the first block");
    toolSend(fd, block, 8);
    testOk(toolReceive(fd, received, 4) == 4 && memcmp(received, "\0\13\0\52", 4) == 0,
           "then one block: our value beside the PLC's");
    WAIT_FOR(isNow("back", "42"));
    isValue("back", "42", "the one follows");
    isValue("plain", "11", "the other keeps its value");
    toolClose(fd);
    toolClose(listener);
    iocEnd();
}

/* An IOC with one PLC, 16 bytes each way, and the records that `make` makes. */
static plcStation *small(int *listener, void (*make)(void), const char *option)
{
    char address[40], error[200];
    int port = 0;
    plcStation *s;

    *listener = toolListen(&port);
    iocBegin();
    s = makeStation("P", 1, 16, 16);
    plcStationSetOption(s, "sendInterval", "5", error, sizeof(error));
    if (option && plcStationSetOption(s, option, "on", error, sizeof(error)))
        testAbort("%s", error);
    make();
    iocRunOk();
    sprintf(address, "127.0.0.1:%d", port);
    plcStationMove(s, address, error, sizeof(error));
    return s;
}

static void endSmall(int fd, int listener)
{
    toolClose(fd);
    toolClose(listener);
    iocEnd();
}

/* --- Delayed writes ------------------------------------------------------------------------ */

#if EPICS_VERSION_INT >= VERSION_INT(7, 0, 8, 0)
#define ON_CHANGE "|OOPT=On Change"
#else
#define ON_CHANGE
#endif

static void makeDelays(void)
{
    makeRecord("calcout", "late", "OUT=@P/0 R=0|CALC=A|A=7|ODLY=1|PINI=YES");
    makeRecord("calcout", "idle", "OUT=@P/2 R=2|CALC=A|A=8|ODLY=0.2");
    makeRecord("calcout", "rare", "OUT=@P/4 R=4|CALC=A|A=9|OOPT=On Change");
    makeRecord("bo", "pulse", "OUT=@P/6 T=BYTE B=0 R=6|HIGH=0.2");
    makeRecord("longout", "change", "OUT=@P/8 R=8|VAL=5|PINI=YES" ON_CHANGE);
    makeRecord("calcout", "clock", "OUT=@P/10|CALC=A+1|INPA=clock.VAL|ODLY=0.4");
}

static void testDelays(void)
{
    unsigned char block[16] = {1, 2, 3, 4, 5, 6, 1, 0, 7, 8}, received[16];
    int listener, fd;
    plcStation *s = small(&listener, makeDelays, NULL);

    testDiag("writes that come later");
    fd = toolAccept(listener);
    WAIT_FOR(plcStationConnected(s, NULL));
    testOk(strcmp(get("late.DLYA"), "1") == 0, "a calcout is in its delay when the PLC comes");
    toolSend(fd, block, 16);
    WAIT_FOR(isNow("idle.OVAL", "772") && isNow("rare.OVAL", "1286") && isNow("pulse", "1") &&
             isNow("change", "1800"));
    isValue("idle.OVAL", "772", "a calcout with ODLY takes the PLC's value");
    isValue("idle", "0", "and does not calculate for that");
    isValue("rare.OVAL", "1286", "one with OOPT too");
    isValue("pulse", "1", "a bo with HIGH too");
    isValue("change", "1800", "a longout with OOPT, where Base has that, too");
    WAIT_FOR(strcmp(get("late.DLYA"), "0") == 0 && isNow("late.OVAL", "258"));
    isValue("late.OVAL", "258", "the delayed write takes the PLC's value, too");
    put("clock.PROC", "1"); /* leaves when all others could have */
    testOk(toolReceive(fd, received, 16) == 16 && memcmp(received, block, 10) == 0 &&
               received[11] == 1,
           "no byte has left until the first put; then all is as the PLC holds it");
    put("late.A", "21");
    testOk(toolReceive(fd, received, 16) == 16 && received[1] == 21,
           "what it calculates later is a put");
    put("rare.A", "22");
    testOk(toolReceive(fd, received, 16) == 16 && received[5] == 22, "and of the other");
    put("pulse", "1");
    do
        received[6] = 1;
    while (toolReceive(fd, received, 16) == 16 && received[6]);
    testOk(received[6] == 0, "the end of a pulse that was put is written");
    endSmall(fd, listener);
}

/* --- A PLC that is connected and silent ---------------------------------------------------- */

static void makeMute(void)
{
    makeRecord("longout", "plain", "OUT=@P/0|VAL=11|PINI=YES");
    makeRecord("longout", "late", "OUT=@P/4");
    makeRecord("longout", "back", "OUT=@P/2 R=2");
}

static void isHeld(const char *record, const char *when)
{
    char pv[40], title[80];

    epicsSnprintf(title, sizeof(title), "%s, %s, says so", record, when);
    isMessage(record, "waits for the PLC's first block", title);
    epicsSnprintf(pv, sizeof(pv), "%s.STAT", record);
    isValue(pv, "COMM", title);
}

static void testMute(void)
{
    unsigned char block[16] = {0}, received[16];
    int listener, fd;
    plcStation *s = small(&listener, makeMute, NULL);

    testDiag("one record with R= holds the others back");
    fd = toolAccept(listener);
    WAIT_FOR(plcStationHeld(s) && plcStationOutputConnected(s, NULL));
    put("late", "12");
    isHeld("late", "put while nothing leaves");
    put("plain", "13");
    isHeld("plain", "written before the PLC came");
    testOk(toolPeek(fd, received, 16) == 0, "nothing has left");
    toolSend(fd, block, 16);
    WAIT_FOR(strcmp(get("late.SEVR"), "NO_ALARM") == 0 &&
             strcmp(get("plain.SEVR"), "NO_ALARM") == 0);
    isValue("late.SEVR", "NO_ALARM", "the first block ends it");
    isValue("plain.SEVR", "NO_ALARM", "for all");
    testOk(toolReceive(fd, received, 16) == 16 && received[1] == 13 && received[5] == 12,
           "and the values leave");
    toolClose(fd);
    fd = toolAccept(listener);
    WAIT_FOR(plcStationHeld(s) && plcStationOutputConnected(s, NULL));
    put("late", "14");
    isHeld("late", "on the next connection");
    put("back.OUT", "@P/2");
    WAIT_FOR(strcmp(get("late.SEVR"), "NO_ALARM") == 0);
    isValue("late.SEVR", "NO_ALARM", "no record has R= any more: it ends");
    testOk(toolReceive(fd, received, 16) == 16 && received[5] == 14, "and the value leaves");
    endSmall(fd, listener);
}

/* --- Links that change --------------------------------------------------------------------- */

static void makeLinked(void)
{
    makeRecord("longout", "first", "OUT=@P/0 R=0");
    makeRecord("longout", "moved", "OUT=@P/4|VAL=3");
    makeRecord("longout", "put", "OUT=@P/6|VAL=3");
}

static void testLinks(void)
{
    unsigned char block[16] = {0, 1, 0, 2, 0, 3, 0, 4, 0, 5, 0, 6}, received[16];
    int listener, fd;
    plcStation *s = small(&listener, makeLinked, NULL);

    testDiag("a link gets a read-back");
    fd = toolAccept(listener);
    sendNext16(s, fd, block);
    WAIT_FOR(isNow("first", "257"));
    put("moved.OUT", "@P/8 R=8");
    put("put.OUT", "@P/10 R=10");
    put("put", "77");
    testOk(toolReceive(fd, received, 16) == 16, "a put leaves");
    sendNext16(s, fd, block);
    WAIT_FOR(isNow("moved", "5"));
    isValue("moved", "5", "a new place begins with the PLC's value");
    isValue("put", "77", "but a put that came first stays");
    put("first", "1");
    testOk(toolReceive(fd, received, 16) == 16 && received[9] == 5 && received[11] == 77,
           "the next block has both");
    endSmall(fd, listener);
}

/* --- A callback queue that is full --------------------------------------------------------- */

static epicsEventId hangs, goOn;

static void hang(epicsCallback *callback)
{
    (void)callback;
    epicsEventMustTrigger(hangs);
    epicsEventMustWait(goOn);
}

static void nothing(epicsCallback *callback)
{
    (void)callback;
}

static void testQueueFull(void)
{
    epicsCallback hanging, filler;
    unsigned char block[16] = {0};
    int listener, fd;
    plcStation *s;

    testDiag("a callback queue that is full when the PLC comes back");
    callbackSetQueueSize(10);
    hangs = epicsEventMustCreate(epicsEventEmpty);
    goOn = epicsEventMustCreate(epicsEventEmpty);
    s = small(&listener, makeMute, NULL);
    callbackSetCallback(hang, &hanging);
    callbackSetPriority(priorityMedium, &hanging);
    callbackSetCallback(nothing, &filler);
    callbackSetPriority(priorityMedium, &filler);
    fd = toolAccept(listener);
    WAIT_FOR(plcStationHeld(s) && plcStationOutputConnected(s, NULL));
    put("late", "12");
    isHeld("late", "before the first block");
    callbackRequest(&hanging);
    epicsEventMustWait(hangs);
    while (callbackRequest(&filler) == 0)
        ;
    sendNext16(s, fd, block);
    WAIT_FOR(!plcStationHeld(s));
    epicsEventMustTrigger(goOn);
    WAIT_FOR(strcmp(get("late.SEVR"), "NO_ALARM") == 0);
    isValue("late.SEVR", "NO_ALARM", "the alarm ends all the same");
    WAIT_FOR(isNow("back", "0") && strcmp(get("back.UDF"), "0") == 0);
    isValue("back.UDF", "0", "and the read-back comes");
    endSmall(fd, listener);
    epicsEventDestroy(hangs);
    epicsEventDestroy(goOn);
    callbackSetQueueSize(2000);
}

MAIN(recordTestFollow)
{
    testPlan(2 * (2 + 26 + 1 + 1 + 26 + 1) + 26 + 6 + 5 + 11 + 12 + 4 + 4);
    testFollow("NO");
    testFollow("YES");
    testTrack();
    testMixed();
    testDelays();
    testMute();
    testLinks();
    testQueueFull();
    return testDone();
}
