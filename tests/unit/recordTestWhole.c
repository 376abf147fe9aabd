/* wholeBlock: one I/O Intr pass sees exactly one block, however long it takes; and what
 * happens without. The test holds a record's lock, so that a pass stops in the middle. With two
 * priorities passes run in callback threads. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <dbAccess.h>
#include <dbLock.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "recordTest.h"
#include "testTools.h"

static dbCommon *find(const char *name)
{
    DBADDR address;

    if (dbNameToAddr(name, &address))
        testAbort("no record %s", name);
    return address.precord;
}

static void sendBlock(int fd, unsigned char value)
{
    unsigned char block[2] = {0, value};

    toolSend(fd, block, 2);
}

static int inImage(plcStation *s)
{
    unsigned char block[2];

    return plcImageRead(plcStationInput(s), 0, 2, block, NULL) ? -1 : block[1];
}

static plcStats stats(plcStation *s)
{
    plcStats st;

    plcStationStats(s, &st);
    return st;
}

static int isNow(const char *pv, int value)
{
    return atoi(get(pv)) == value;
}

static void run(const char *wholeBlock)
{
    int port = 0, listener = toolListen(&port), fd, i, whole = strcmp(wholeBlock, "on") == 0;
    char address[40], error[200];
    dbCommon *second;
    plcStation *s;

    testDiag("wholeBlock=%s", wholeBlock);
    sprintf(address, "127.0.0.1:%d", port);
    iocBegin();
    s = makeStation("P", 1, 2, 0);
    plcStationSetOption(s, "wholeBlock", wholeBlock, error, sizeof(error));
    makeRecord("longin", "first", "INP=@P/0|SCAN=I/O Intr|PRIO=HIGH");
    makeRecord("longin", "second", "INP=@P/0|SCAN=I/O Intr|PRIO=LOW");
    iocRunOk();
    second = find("second");
    plcStationMove(s, address, error, sizeof(error));
    fd = toolAccept(listener);
    sendBlock(fd, 1);
    WAIT_FOR(isNow("second", 1));
    isValue("first", "1", "both records have");
    isValue("second", "1", "the first block");

    dbScanLock(second);
    /* A pass stops at the second record: with this block, or with the one before when it
     * had not ended yet. */
    for (i = 2; i <= 4; i++) {
        sendBlock(fd, (unsigned char)i);
        WAIT_FOR(stats(s).blocksIn == (epicsUInt64)i);
    }
    if (whole)
        WAIT_FOR(isNow("first", inImage(s)));
    else
        WAIT_FOR(inImage(s) == 4);
    testOk(whole ? inImage(s) <= 2 && isNow("first", inImage(s)) : inImage(s) == 4,
           whole ? "while a pass runs its block stays" : "without it the newest block comes");
    WAIT_FOR(stats(s).coalesced > 0);
    testOk(stats(s).coalesced > 0, "blocks were replaced by newer ones, and counted");
    dbScanUnlock(second);
    WAIT_FOR(isNow("first", 4) && isNow("second", 4));
    isValue("first", "4", "in the end both have");
    isValue("second", "4", "the newest");
    toolClose(fd);
    toolClose(listener);
    iocEnd();
}

/* --- A record that waits does not hold up what the PLC expects ----------------------- */

static const struct {
    const char *option, *value; /* of the PLC */
    const char *link;           /* of an output */
    int puts;                   /* blocks leave because of puts; else they do by themselves */
} duties[] = {
    {"heartbeat",  "20",       "@P/0",     0},
    {"sync",       "on",       "@P/4 R=4", 0},
    {"track",      "on",       "@P/0 R=0", 1},
    {"scanThread", "callback", "@P/0",     1},
};

static void sendHeader(int fd, unsigned char number)
{
    unsigned char block[6] = {3, number, 0, 0, 0, number}; /* SYNC, REMOTE */

    toolSend(fd, block, sizeof(block));
}

static void runDuty(size_t row)
{
    int port = 0, listener = toolListen(&port), fd, i, left = 0;
    char address[40], error[200], fields[60];
    unsigned char block[6];
    dbCommon *waits;
    plcStation *s;

    sprintf(address, "127.0.0.1:%d", port);
    iocBegin();
    s = makeStation("P", 1, 6, 6);
    plcStationSetOption(s, "sendInterval", "1", error, sizeof(error));
    if (plcStationSetOption(s, duties[row].option, duties[row].value, error, sizeof(error)))
        testAbort("%s", error);
    makeRecord("longin", "in", "INP=@P/4|SCAN=I/O Intr");
    sprintf(fields, "OUT=%s", duties[row].link);
    makeRecord("longout", "out", fields);
    iocRunOk();
    waits = find("in");
    plcStationMove(s, address, error, sizeof(error));
    fd = toolAccept(listener);
    sendHeader(fd, 1);
    WAIT_FOR(isNow("in", 1));
    dbScanLock(waits); /* as long as something slow is done behind it */
    sendHeader(fd, 2);
    WAIT_FOR(stats(s).blocksIn == 2);
    for (i = 0; i < 3; i++) {
        if (duties[row].puts)
            put("out", i & 1 ? "7" : "8");
        left += toolReceive(fd, block, sizeof(block)) == sizeof(block);
    }
    testOk(left == 3, "%s=%s: blocks leave while a record waits", duties[row].option,
           duties[row].value);
    dbScanUnlock(waits);
    WAIT_FOR(isNow("in", 2));
    isValue("in", "2", "then it has its value");
    toolClose(fd);
    toolClose(listener);
    iocEnd();
}

MAIN(recordTestWhole)
{
    size_t row;

    testPlan((int)(12 + 2 * COUNT(duties)));
    for (row = 0; row < COUNT(duties); row++)
        runDuty(row);
    run("on");
    run("off");
    return testDone();
}
