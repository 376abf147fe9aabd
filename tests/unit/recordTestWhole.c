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

MAIN(recordTestWhole)
{
    testPlan(12);
    run("on");
    run("off");
    return testDone();
}
