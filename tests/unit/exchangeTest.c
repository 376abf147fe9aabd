/* A station with a transport that the test plays itself, call by call: what the station makes
 * of its news, and of none. */
#include <stdio.h>
#include <string.h>

#include <epicsAtomic.h>
#include <epicsMutex.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcStation.h"
#include "plcTransport.h"
#include "testTools.h"

/* --- The transport: it brings a block when it is told to ---------------------------------- */

static plcTransportSetup made;
static double pauseMs;                  /* what it says */
static int ups, downs, works, asks;     /* atomic: calls; it works by itself; takes of news */

static void *create(const plcTransportSetup *setup, const void *own)
{
    made = *setup;
    return &made;
}

static void nothing(void *pvt)
{
    (void)pvt;
}

static void options(void *pvt, const plcOptions *o)
{
    (void)pvt, (void)o;
}

static double pause_(void *pvt, const plcOptions *o)
{
    (void)pvt, (void)o;
    return pauseMs;
}

static void up(void *pvt, SOCKET socket, const epicsUInt8 *in, const epicsUInt8 *out)
{
    (void)pvt, (void)socket, (void)in, (void)out;
    epicsAtomicIncrIntT(&ups);
}

static void down(void *pvt)
{
    (void)pvt;
    epicsAtomicIncrIntT(&downs);
}

static int news(void *pvt, plcNews *n, void *input, void *output)
{
    (void)pvt, (void)output;
    memset(n, 0, sizeof(*n));
    epicsAtomicIncrIntT(&asks);
    if (!epicsAtomicGetIntT(&works) || epicsAtomicGetIntT(&ups) == epicsAtomicGetIntT(&downs))
        return 0;
    n->requests = n->blocks = 1;
    epicsTimeGetCurrent(&n->stamp);
    memset(input, 7, made.inSize);
    return 1;
}

static void put(void *pvt, const void *image, const void *mask)
{
    (void)pvt, (void)image, (void)mask;
}

static const plcTransport fake = {.name = "fake",
                                  .prefix = "fake ",
                                  .create = create,
                                  .destroy = nothing,
                                  .begin = nothing,
                                  .end = nothing,
                                  .pause = pause_,
                                  .options = options,
                                  .up = up,
                                  .down = down,
                                  .news = news,
                                  .put = put};

/* --- The station -------------------------------------------------------------------------- */

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
                               .bigEndian = 1,
                               .recvTimeout = 2000,
                               .sendInterval = 100,
                               .transport = &fake};
    plcStation *s;

    ups = downs = 0;
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

    pauseMs = 20;
    epicsAtomicSetIntT(&works, 1);
    s = start(&listener);
    WAIT_FOR(!reason(s)[0]);
    testOk(!reason(s)[0], "the worker brings data");
    epicsAtomicSetIntT(&works, 0);
    WAIT_FOR(epicsAtomicGetIntT(&downs) > 0);
    plcStationStats(s, &st);
    testOk(strncmp(st.lastError, "no fake request for 1.", 22) == 0 && reason(s)[0],
           "it stands still: %s", st.lastError);
    before = epicsAtomicGetIntT(&ups);
    epicsAtomicSetIntT(&works, 1);
    WAIT_FOR(epicsAtomicGetIntT(&ups) > before && !reason(s)[0]);
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

    pauseMs = 0;
    epicsAtomicSetIntT(&works, 1);
    s = start(&listener);
    WAIT_FOR(!reason(s)[0]);
    epicsAtomicSetIntT(&works, 0);
    until = epicsMonotonicGet() + 1500000000u; /* longer than the other was allowed to */
    WAIT_FOR(epicsMonotonicGet() > until);
    testOk(!reason(s)[0] && epicsAtomicGetIntT(&downs) == 0, "a worker without reads may rest");
    plcStationsDestroy();
    toolClose(listener);
}

MAIN(exchangeTest)
{
    testPlan(4);
    testSilence();
    testQuiet();
    return testDone();
}
