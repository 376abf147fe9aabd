/* Outputs whose value the PLC refuses or takes after they have processed, by a transport that
 * the test plays itself: only the alarm that came with the refusal ends with it. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <epicsAtomic.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "fakeTransport.h"
#include "recordTest.h"
#include "testTools.h"

#define NO "the PLC says no"

static plcStation *makeFake(int port)
{
    plcStationConfig config = {.name = "P",
                               .address = {"127.0.0.1", ""},
                               .port = port,
                               .outSize = 4,
                               .bigEndian = 1,
                               .recvTimeout = 60000,
                               .sendInterval = 10,
                               .transport = &fakeTransport};

    fakeReset();
    return plcStationCreate(&config);
}

/* The PLC refuses the outputs (or, with NULL, has taken them). */
static void answer(plcStation *s, const char *why)
{
    static const epicsUInt8 mask[4] = {0xff, 0xff, 0xff, 0xff};

    if (why)
        plcFaultsSet(plcStationOutFaults(s), 0, 4, mask, why);
    else
        plcFaultsClear(plcStationOutFaults(s), 0, 4, mask);
    epicsAtomicSetIntT(&fake.faults, 1);
    plcStationSend(s);
}

static int isAlarm(const char *record, const char *status, const char *message)
{
    char stat[40];

    sprintf(stat, "%s.STAT", record);
    return strcmp(get(stat), status) == 0 && isReason(record, message);
}

static void testOrigins(void)
{
    int port = 0, listener = toolListen(&port);
    plcStation *s;

    iocBegin();
    s = makeFake(port);
    makeRecord("ao", "first", "OUT=@P/0");
    makeRecord("ao", "second", "OUT=@P/2");
    iocRunOk();
    WAIT_FOR(epicsAtomicGetIntT(&fake.ups));
    epicsAtomicSetIntT(&fake.shows, 1);
    plcStationSend(s);
    WAIT_FOR(plcStationTaken(s));
    put("first", "5");
    put("second", "5");
    answer(s, NO);
    WAIT_FOR(isAlarm("second", "WRITE", NO));
    testOk(isAlarm("first", "WRITE", NO) && isAlarm("second", "WRITE", NO),
           "a refusal comes after the put");
    put("first", "nan");
    testOk(isAlarm("first", "WRITE", "NaN does not fit INT16"),
           "another put cannot be written");
    answer(s, NULL);
    WAIT_FOR(isAlarm("second", "NO_ALARM", "")); /* its turn is behind that of the first */
    testOk(isAlarm("second", "NO_ALARM", ""), "a refusal ends when the PLC takes the value");
    testOk(isAlarm("first", "WRITE", "NaN does not fit INT16"),
           "the alarm of the other put stays");
    iocEnd();
    toolClose(listener);
}

MAIN(recordTestRefused)
{
    testPlan(4);
    testOrigins();
    return testDone();
}
