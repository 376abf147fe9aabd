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
#define SILENT "no answer from the PLC"

static plcStation *makeFake(int port)
{
    plcStationConfig config = {.name = "P",
                               .address = {"127.0.0.1", ""},
                               .port = port,
                               .outSize = 4,
                               .bigEndian = 1,
                               .recvTimeout = 60000,
                               .sendInterval = 10,
                               .transport = &fakeTransportPuts};

    fakeReset();
    return plcStationCreate(&config);
}

static int always(void *arg, const plcPut *put)
{
    (void)arg, (void)put;
    return 1;
}

typedef enum { takes, refuses, isSilent } answerKind;

/* What becomes of all that was put. */
static void answer(plcStation *s, answerKind kind)
{
    epicsUInt8 values[4], mask[4] = {0};

    while (plcImageTakePuts(plcStationOutput(s), always, NULL, values, mask)) {
        if (kind != takes)
            plcImagePutsFail(plcStationOutput(s), 0, 4, NULL, kind == refuses ? NO : SILENT);
        if (kind != isSilent)
            plcImagePutsDone(plcStationOutput(s));
    }
    epicsAtomicSetIntT(&fake.faults, 1);
    plcStationTell(s);
}

/* The outputs as the PLC has them. */
static void show(plcStation *s, int first, int second)
{
    fake.output[1] = (char)first;
    fake.output[3] = (char)second;
    epicsAtomicCmpAndSwapIntT(&fake.shows, 0, 1);
    plcStationTell(s);
    WAIT_FOR(epicsAtomicCmpAndSwapIntT(&fake.shows, 0, 0) == 0 && plcStationTaken(s));
}

static void reconnect(plcStation *s)
{
    int ups = epicsAtomicGetIntT(&fake.ups);

    epicsAtomicSetIntT(&fake.lost, 1);
    plcStationTell(s);
    WAIT_FOR(epicsAtomicGetIntT(&fake.ups) > ups);
}

static int isAlarm(const char *record, const char *status, const char *message)
{
    char stat[40];

    sprintf(stat, "%s.STAT", record);
    return strcmp(get(stat), status) == 0 && isReason(record, message);
}

/* The record has this value and this alarm; WRITE where there is a message. */
static int has(const char *record, const char *value, const char *message)
{
    return strcmp(get(record), value) == 0 &&
           isAlarm(record, message[0] ? "WRITE" : "NO_ALARM", message);
}

#define BECOMES(record, value, message, title)                                             \
    do {                                                                                   \
        WAIT_FOR(has(record, value, message));                                             \
        testOk(has(record, value, message), "%s: %s", title, get(record));                  \
    } while (0)

static plcStation *begin(int port, const char *track)
{
    plcStation *s;
    char error[100];

    iocBegin();
    s = makeFake(port);
    plcStationSetOption(s, "track", track, error, sizeof(error));
    makeRecord("ao", "first", "OUT=@P/0");
    makeRecord("ao", "second", "OUT=@P/2");
    makeRecord("longout", "same", "OUT=@P/2");
    iocRunOk();
    WAIT_FOR(epicsAtomicGetIntT(&fake.ups));
    return s;
}

static void testOrigins(void)
{
    int port = 0, listener = toolListen(&port);
    plcStation *s = begin(port, "off");

    show(s, 0, 0);
    put("first", "5");
    put("second", "5");
    answer(s, refuses);
    WAIT_FOR(has("second", "5", NO));
    testOk(has("first", "5", NO) && has("second", "5", NO), "a refusal comes after the put");
    testOk(isAlarm("same", "NO_ALARM", "") || isAlarm("same", "UDF", ""),
           "another output of the same place has not put");
    put("first", "nan");
    testOk(isAlarm("first", "WRITE", "NaN does not fit INT16"),
           "another put cannot be written");
    put("second", "6");
    answer(s, takes);
    BECOMES("second", "6", "", "a refusal ends when the PLC takes the next value");
    testOk(isAlarm("first", "WRITE", "NaN does not fit INT16"),
           "the alarm of the other put stays");
    iocEnd();
    toolClose(listener);
}

/* With track=on the PLC's value counts; the alarm is that of the last put, until the next one. */
static void testFollowing(void)
{
    int port = 0, listener = toolListen(&port);
    plcStation *s = begin(port, "on");

    put("first", "4");
    testOk(isAlarm("first", "COMM", "waiting for the PLC's value"), "at the start a put waits");
    show(s, 1, 2);
    BECOMES("first", "1", "", "the PLC's value takes its place, without an alarm");

    put("first", "5");
    reconnect(s);
    WAIT_FOR(isAlarm("first", "COMM", "waiting for the PLC's value"));
    testOk(isAlarm("first", "COMM", "waiting for the PLC's value"), "later: it waits");
    show(s, 1, 2);
    BECOMES("first", "1", plcNotWritten, "the PLC's value takes its place: not written");
    show(s, 3, 2);
    BECOMES("first", "3", plcNotWritten, "that stays when the value changes");
    reconnect(s);
    show(s, 4, 2);
    BECOMES("first", "4", plcNotWritten, "and when the PLC was away once more");
    put("first", "6");
    answer(s, takes);
    show(s, 6, 2);
    BECOMES("first", "6", "", "until the next put");

    put("second", "7");
    reconnect(s);
    put("first", "8");
    show(s, 6, 7);
    BECOMES("second", "7", "", "the PLC has what was put: no alarm");
    BECOMES("first", "6", plcNotWritten, "a put while the PLC is away is void, too");

    put("first", "9");
    answer(s, isSilent);
    put("second", "9");
    reconnect(s);
    show(s, 6, 7);
    BECOMES("first", "6", SILENT, "what was on its way has its own reason");
    BECOMES("second", "7", plcNotWritten, "what waited behind it has not");
    show(s, 9, 9);
    BECOMES("first", "9", "", "that ends when the PLC shows what was put");
    BECOMES("second", "9", "", "here too");

    put("first", "10");
    answer(s, refuses);
    WAIT_FOR((show(s, 9, 9), has("first", "9", NO))); /* it had time to show it */
    BECOMES("first", "9", NO, "a refused put goes back");
    show(s, 11, 9);
    BECOMES("first", "11", NO, "its alarm stays when the value changes");
    reconnect(s);
    show(s, 12, 9);
    BECOMES("first", "12", NO, "and after a reconnect");
    put("first", "nan");
    show(s, 13, 9);
    BECOMES("first", "13", "NaN does not fit INT16", "so does that of a value that does not fit");
    testOk(has("same", "9", ""), "nobody has put to the other one");
    iocEnd();
    toolClose(listener);
}

MAIN(recordTestRefused)
{
    testPlan(23);
    testOrigins();
    testFollowing();
    return testDone();
}
