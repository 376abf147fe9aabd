/* A station with a transport that the test plays itself: what the station makes of its news,
 * and of none. */
#include <stdio.h>
#include <string.h>

#include <epicsAtomic.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "fakeTransport.h"
#include "plcBlocks.h"
#include "plcStation.h"
#include "testTools.h"

static const char *reason(plcStation *s)
{
    static char text[PLC_REASON_SIZE];

    plcImageReason(plcStationInput(s), text);
    return text;
}

static plcStation *start(int *listener)
{
    int port = 0;
    char error[200];
    plcStationConfig config = {.name = "PLC",
                               .address = {"127.0.0.1", ""},
                               .inSize = 4,
                               .outSize = 16,
                               .bigEndian = 1,
                               .recvTimeout = 2000,
                               .sendInterval = 100,
                               .transport = &fakeTransport};
    plcStation *s;

    *listener = toolListen(&port);
    config.port = port;
    s = plcStationCreate(&config);
    if (plcStationSetOption(s, "requestTimeout", "10", error, sizeof(error)))
        testAbort("%s", error);
    plcStationsStart();
    plcStationsRun();
    return s;
}

/* The worker brings one block, and then nothing at all. */
static void testSilence(void)
{
    int listener, before;
    plcStats st;
    plcStation *s;

    fakeReset();
    fake.pause = 20;
    fake.works = 1;
    s = start(&listener);
    WAIT_FOR(!reason(s)[0]);
    testOk(!reason(s)[0], "the worker brings data");
    before = epicsAtomicGetIntT(&fake.ups);
    epicsAtomicSetIntT(&fake.works, 0);
    WAIT_FOR(epicsAtomicGetIntT(&fake.downs) > 0 && reason(s)[0] &&
             (plcStationStats(s, &st), st.lastError[0]));
    testOk(strncmp(st.lastError, "no fake request for 1.", 22) == 0 && reason(s)[0],
           "it stands still: %s", st.lastError);
    epicsAtomicSetIntT(&fake.works, 1);
    WAIT_FOR(epicsAtomicGetIntT(&fake.ups) > before && !reason(s)[0]);
    testOk(!reason(s)[0], "on the next connection it works again, and data is good");
    plcStationsDestroy();
    toolClose(listener);
}

/* One that need not ask for anything may be silent. */
static void testQuiet(void)
{
    epicsUInt64 until;
    int listener;
    plcStation *s;

    fakeReset();
    fake.works = 1;
    s = start(&listener);
    WAIT_FOR(!reason(s)[0]);
    epicsAtomicSetIntT(&fake.works, 0);
    until = epicsMonotonicGet() + 1500000000u; /* longer than the other was allowed to */
    WAIT_FOR(epicsMonotonicGet() > until);
    testOk(!reason(s)[0] && epicsAtomicGetIntT(&fake.downs) == 0,
           "a worker without reads may rest");
    plcStationsDestroy();
    toolClose(listener);
}

/* Records that come later have values that must stay whole, too. */
static void testUsers(void)
{
    plcOwner owner = {.name = "late", .recordType = "ao", .output = 1, .offset = 4, .length = 8,
                    .type = plcTypeFind("FLOAT", 5)};
    int listener;
    plcStation *s;

    fakeReset();
    s = start(&listener);
    WAIT_FOR(epicsAtomicGetIntT(&fake.ups) == 1);
    testOk(epicsAtomicGetIntT(&fake.whole) == 0, "no record, no value");
    plcOwnersAdd(plcStationOwners(s), &owner);
    plcStationSend(s);
    WAIT_FOR(epicsAtomicGetIntT(&fake.wholes));
    testOk(epicsAtomicGetIntT(&fake.whole) == 6, "two values of 4 bytes are told at once");
    plcOwnersRemove(plcStationOwners(s), &owner);
    plcStationSend(s);
    WAIT_FOR(epicsAtomicGetIntT(&fake.wholes) == 2);
    testOk(epicsAtomicGetIntT(&fake.whole) == 0, "and that they are gone");
    plcStationsDestroy();
    toolClose(listener);
}

/* The PLC moves; who takes its outputs stays where it is. */
static void testMove(void)
{
    int port[3] = {0, 0, 0}, listener[3], i, fd;
    char text[40], error[200];
    plcStationConfig config = {.name = "PLC",
                               .address = {"127.0.0.1", ""},
                               .inSize = 4,
                               .outSize = 4,
                               .bigEndian = 1,
                               .recvTimeout = 60000,
                               .sendInterval = 100,
                               .transport = &plcBlocks};
    plcStation *s;

    fakeReset();
    for (i = 0; i < 3; i++)
        listener[i] = toolListen(&port[i]);
    config.port = port[0];
    s = plcStationCreate(&config);
    if (plcStationOutputBy(s, "127.0.0.1", port[2], &fakeTransport, NULL, error, sizeof(error)))
        testAbort("%s", error);
    plcStationsStart();
    plcStationsRun();
    fd = toolAccept(listener[0]);
    WAIT_FOR(epicsAtomicGetIntT(&fake.ups) == 1);
    sprintf(text, "127.0.0.1:%d", port[1]);
    plcStationMove(s, text, error, sizeof(error));
    testOk(toolClosed(fd), "the connection to the old address ends");
    toolClose(fd);
    fd = toolAccept(listener[1]);
    testOk(fd >= 0, "there is one to the new address");
    testOk(epicsAtomicGetIntT(&fake.downs) == 0 && plcStationOutputConnected(s, NULL),
           "that of the outputs stays");
    plcStationsDestroy();
    toolClose(fd);
    for (i = 0; i < 3; i++)
        toolClose(listener[i]);
}

MAIN(exchangeTest)
{
    testPlan(10);
    testSilence();
    testQuiet();
    testUsers();
    testMove();
    return testDone();
}
