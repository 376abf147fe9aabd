/* Alarms, their words and time stamps: while there is no valid data, when a value is
 * refused, and with a real connection to a PLC in this process.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <alarm.h>
#include <dbAccess.h>
#include <dbUnitTest.h>
#include <epicsStdio.h>
#include <epicsThread.h>
#include <epicsTime.h>
#include <epicsUnitTest.h>
#include <osiSock.h>
#include <testMain.h>

#include "plcBlocks.h"
#include "recordTest.h"
#include "testTools.h"

#define BLOCK 64

static const char *field(const char *record, const char *name)
{
    static char pv[60];

    epicsSnprintf(pv, sizeof(pv), "%s.%s", record, name);
    return pv;
}

static void isField(const char *record, const char *name, const char *expected,
                    const char *what)
{
    char title[120];

    epicsSnprintf(title, sizeof(title), "%s %s", record, what);
    isValue(field(record, name), expected, title);
}

/* The alarm of a record with its words. */
static void isAlarm(const char *record, const char *severity, const char *status,
                    const char *message, const char *when)
{
    char got[120], wanted[120];
    int n = epicsSnprintf(got, sizeof(got), "%s ", get(field(record, "SEVR"))), ok;

    epicsSnprintf(got + n, sizeof(got) - n, "%s", get(field(record, "STAT")));
    epicsSnprintf(wanted, sizeof(wanted), "%s %s", severity, status);
    ok = strcmp(got, wanted) == 0 && isReason(record, message);
    testOk(ok, "%s is %s \"%s\" %s", record, wanted, message, when);
    if (!ok)
        testDiag("it is %s, or has another message", got);
}

/* --- Inputs ------------------------------------------------------------------------- */

static const struct {
    const char *record, *fields;
    const char *value; /* of the block below */
} inputs[] = {
    {"ai", "INP=@P/0", "258"},
    {"bi", "INP=@P/0 T=BYTE", "1"},
    {"mbbi", "INP=@P/0|NOBT=8|ZRVL=2|ONVL=1|SHFT=0", "0"},
    {"mbbiDirect", "INP=@P/0|NOBT=16", "258"},
    {"longin", "INP=@P/0", "258"},
    {"int64in", "INP=@P/0", "258"},
    {"stringin", "INP=@P/2 L=2", "ab"},
    {"lsi", "INP=@P/2 L=2|SIZV=50", "ab"},
    {"waveform", "INP=@P/0|FTVL=SHORT|NELM=2", "258,24930"},
    {"aai", "INP=@P/0|FTVL=SHORT|NELM=2", "258,24930"},
};
#define IN_TESTS 9

static void processAll(void)
{
    size_t i;

    for (i = 0; i < COUNT(inputs); i++)
        put(field(inputs[i].record, "PROC"), "1");
}

/* waveform and aai clear UDF themselves, whatever device support says. */
static int ownsUdf(const char *record)
{
    return strcmp(record, "waveform") && strcmp(record, "aai");
}

static void testInputs(void)
{
    epicsUInt8 block[BLOCK] = {1, 2, 'a', 'b'}, next[BLOCK] = {3, 4, 'c', 'd'};
    plcStation *station;
    size_t i;

    iocBegin();
    station = makeStation("P", 1, BLOCK, BLOCK);
    for (i = 0; i < COUNT(inputs); i++)
        makeRecord(inputs[i].record, inputs[i].record, inputs[i].fields);
    iocRunOk();
    plcImageInvalidate(plcStationInput(station), "no block yet");
    processAll();
    for (i = 0; i < COUNT(inputs); i++) {
        isAlarm(inputs[i].record, "INVALID", "COMM", "no block yet",
                "before the first block");
        isField(inputs[i].record, "UDF", ownsUdf(inputs[i].record) ? "1" : "0",
                "leaves UDF before the first block as it was");
    }
    publish(station, block, 1);
    processAll();
    for (i = 0; i < COUNT(inputs); i++) {
        isAlarm(inputs[i].record, "NO_ALARM", "NO_ALARM", "", "with a block");
        isField(inputs[i].record, "VAL", inputs[i].value, "shows the block");
        isField(inputs[i].record, "UDF", "0", "is defined");
    }
    plcImageInvalidate(plcStationInput(station), "connection refused");
    processAll();
    for (i = 0; i < COUNT(inputs); i++) {
        isAlarm(inputs[i].record, "INVALID", "COMM", "connection refused",
                "when data is lost");
        isField(inputs[i].record, "VAL", inputs[i].value, "keeps its value");
    }
    publish(station, next, 2);
    processAll();
    for (i = 0; i < COUNT(inputs); i++) {
        isAlarm(inputs[i].record, "NO_ALARM", "NO_ALARM", "", "when data is back");
        testOk(strcmp(get(field(inputs[i].record, "VAL")), inputs[i].value) != 0 ||
                   strcmp(inputs[i].record, "bi") == 0,
               "%s shows the new block", inputs[i].record);
    }
    iocEnd();
}

/* --- Time stamps -------------------------------------------------------------------- */

static void timeOf(const char *record, epicsTimeStamp *stamp)
{
    dbCommon *prec = testdbRecordPtr(record);

    put(field(record, "PROC"), "1");
    dbScanLock(prec);
    *stamp = prec->time;
    dbScanUnlock(prec);
}

static epicsTimeStamp timeNow(const char *record)
{
    dbCommon *prec = testdbRecordPtr(record);
    epicsTimeStamp stamp;

    dbScanLock(prec);
    stamp = prec->time;
    dbScanUnlock(prec);
    return stamp;
}

static void testTimes(void)
{
    epicsUInt8 block[BLOCK] = {0};
    epicsTimeStamp stamp;
    plcStation *station;

    iocBegin();
    station = makeStation("P", 1, BLOCK, BLOCK);
    makeRecord("ai", "Block", "INP=@P/0|TSE=-2");
    makeRecord("waveform", "Array", "INP=@P/0|TSE=-2|FTVL=SHORT|NELM=2");
    makeRecord("ai", "Own", "INP=@P/0");
    makeRecord("ao", "Out", "OUT=@P/0|TSE=-2");
    makeRecord("bi", "Stat", "INP=@P|DTYP=S7plc stat|TSE=-2");
    iocRunOk();
    publish(station, block, 12345);
    timeOf("Block", &stamp);
    testOk(stamp.secPastEpoch == 12345, "TSE=-2 gives the time of the block");
    timeOf("Array", &stamp);
    testOk(stamp.secPastEpoch == 12345, "TSE=-2 of an array too");
    timeOf("Own", &stamp);
    testOk(stamp.secPastEpoch > 12345, "TSE=0 gives the time of processing");
    timeOf("Out", &stamp);
    testOk(stamp.secPastEpoch > 12345, "TSE=-2 of an output gives the time of writing");
    timeOf("Stat", &stamp);
    testOk(stamp.secPastEpoch > 12345,
           "TSE=-2 of S7plc stat gives the time of processing");
    plcImageInvalidate(plcStationInput(station), "gone");
    timeOf("Block", &stamp);
    testOk(stamp.secPastEpoch > 12345, "TSE=-2 without data gives the time of the loss");
    iocEnd();
}

static SOCKET listenLocal(unsigned short *port)
{
    struct sockaddr_in address = {.sin_family = AF_INET};
    osiSocklen_t size = sizeof(address);
    SOCKET s = epicsSocketCreate(AF_INET, SOCK_STREAM, 0);

    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (bind(s, (struct sockaddr *)&address, size) || listen(s, 1) ||
        getsockname(s, (struct sockaddr *)&address, &size))
        testAbort("cannot listen on loopback");
    *port = ntohs(address.sin_port);
    return s;
}

/* Where nobody listens. */
static void freeAddress(char text[40])
{
    unsigned short port;

    epicsSocketDestroy(listenLocal(&port));
    epicsSnprintf(text, 40, "127.0.0.1:%u", port);
}

/* --- Outputs without a connection --------------------------------------------------- */

static const struct {
    const char *record, *fields, *value;
} outputs[] = {
    {"ao", "", "5"},
    {"bo", "", "1"},
    {"mbbo", "|NOBT=4", "1"},
    {"mbboDirect", "|NOBT=4", "1"},
    {"longout", "", "5"},
    {"int64out", "", "5"},
    {"stringout", " L=4", "a"},
    {"lso", " L=4", "a"},
    {"aao", "|FTVL=SHORT|NELM=2", "1,2"},
};

static void testAway(plcStation *station)
{
    const char *reason;
    char expected[PLC_REASON_SIZE];
    epicsUInt8 bytes[4];
    size_t i;

    plcStationConnected(station, expected);
    for (i = 0; i < COUNT(outputs); i++) {
        reason = expected;
        testOk(put(outputs[i].record, outputs[i].value) != 0, "%s tells the put that the "
               "PLC is away", outputs[i].record);
        isAlarm(outputs[i].record, "INVALID", "COMM", reason, "while the PLC is away");
        plcImagePeek(plcStationOutput(station), 4 * i, 4, bytes);
        testOk(memcmp(bytes, "\0\0\0", 4) != 0, "%s keeps its value for the PLC",
               outputs[i].record);
    }
}

static void testRefusedWrites(plcStation *station)
{
    char error[120], title[120];
    size_t i;

    for (i = 0; i < COUNT(outputs); i++)
        setOutput(station, 4 * i, "5a5a5a5a");
    testOk(plcStationSetOption(station, "offlineWrites", "reject", error,
                               sizeof(error)) == 0,
           "offlineWrites=reject is taken");
    for (i = 0; i < COUNT(outputs); i++) {
        put(outputs[i].record, outputs[i].value);
        isField(outputs[i].record, "STAT", "WRITE", "has a WRITE alarm with "
                "offlineWrites=reject");
        saysWhy(outputs[i].record);
        epicsSnprintf(title, sizeof(title), "%s writes nothing", outputs[i].record);
        isOutput(station, 4 * i, "5a5a5a5a", title);
    }
}

static void testOutputs(void)
{
    char fields[100], name[120], address[40];
    plcStation *station;
    size_t i;

    iocBegin();
    station = makeStation("P", 1, BLOCK, BLOCK);
    for (i = 0; i < COUNT(outputs); i++) {
        epicsSnprintf(fields, sizeof(fields), "OUT=@P/%lu%s", (unsigned long)(4 * i),
                      outputs[i].fields);
        makeRecord(outputs[i].record, outputs[i].record, fields);
    }
    makeRecord("ao", "aoNaN", "OUT=@P/60 T=INT32");
    makeRecord("calcout", "calcNaN", "OUT=@P/60 T=BYTE|CALC=A");
    makeRecord("bi", "Stat", "INP=@P|DTYP=S7plc stat");
    makeRecord("stringout", "Addr", "OUT=@P|DTYP=S7plc addr");
    iocRunOk();
    testAway(station);
    put("aoNaN", "nan");
    isAlarm("aoNaN", "INVALID", "WRITE", "NaN does not fit INT32", "for NaN");
    put("calcNaN.A", "nan");
    isAlarm("calcNaN", "INVALID", "WRITE", "NaN does not fit UINT8", "for NaN");

    put("Stat.PROC", "1");
    isValue("Stat", "0", "S7plc stat is 0 when not connected");
    isAlarm("Stat", "NO_ALARM", "NO_ALARM", "", "when not connected");
    testOk(put("Addr", "127.0.0.1:99999") != 0, "S7plc addr refuses a bad address");
    isField("Addr", "STAT", "WRITE", "has a WRITE alarm for a bad address");
    saysWhy("Addr");
    freeAddress(address);
    testOk(put("Addr", address) == 0, "S7plc addr takes host:port");
    isAlarm("Addr", "NO_ALARM", "NO_ALARM", "", "with a good address");
    plcStationAddress(station, name, sizeof(name));
    testOk(strcmp(name, address) == 0, "the PLC has moved to %s", name);
    testRefusedWrites(station);
    iocEnd();
}

/* --- A connection ------------------------------------------------------------------- */

/* Waits until the monitored field has this value. */
static void waitFor(testMonitor *monitor, const char *pv, const char *value)
{
    while (strcmp(get(pv), value))
        testMonitorWait(monitor);
}

static void receive(SOCKET plc, epicsUInt8 *block)
{
    size_t n = 0;

    while (n < BLOCK) {
        int got = recv(plc, (char *)block + n, (int)(BLOCK - n), 0);

        if (got <= 0)
            testAbort("the IOC closed the connection");
        n += (size_t)got;
    }
}

/* Outputs that were written while the PLC was away, and then it comes. */
static void testReturn(void)
{
    testMonitor *pini, *high;
    epicsTimeStamp began, ended;
    unsigned short port;
    SOCKET server = listenLocal(&port), plc;
    epicsUInt8 sent[BLOCK];
    char address[40];

    iocBegin();
    makeStation("P", 1, BLOCK, BLOCK);
    makeRecord("stringout", "Addr", "OUT=@P|DTYP=S7plc addr");
    makeRecord("ao", "Pini", "OUT=@P/0|VAL=7|PINI=YES");
    makeRecord("ao", "High", "OUT=@P/2|VAL=9|PINI=YES|HIHI=8|HHSV=MAJOR");
    makeRecord("longout", "Never", "OUT=@P/4|PINI=YES");
    iocRunOk();
    isField("Pini", "STAT", "COMM", "has a COMM alarm while the PLC is away");
    isField("High", "STAT", "COMM", "has a COMM alarm while the PLC is away");
    began = timeNow("Pini");
    pini = testMonitorCreate("Pini", DBE_ALARM, 0);
    high = testMonitorCreate("High", DBE_ALARM, 0);
    epicsSnprintf(address, sizeof(address), "127.0.0.1:%u", port);
    put("Addr", address);
    plc = epicsSocketAccept(server, NULL, NULL);
    waitFor(pini, "Pini.SEVR", "NO_ALARM");
    isAlarm("Pini", "NO_ALARM", "NO_ALARM", "", "when the PLC has come");
    ended = timeNow("Pini");
    testOk(epicsTimeGreaterThan(&ended, &began), "the end of an alarm has a time of its own");
    waitFor(high, "High.SEVR", "MAJOR");
    isAlarm("High", "MAJOR", "HIHI", "", "again when the PLC has come");
    isField("Never", "STAT", "UDF", "without a value keeps its UDF alarm");
    receive(plc, sent);
    testOk(memcmp(sent, "\0\7\0\11\0\0", 6) == 0, "the PLC gets the values");
    testMonitorDestroy(pini);
    testMonitorDestroy(high);
    epicsSocketDestroy(plc);
    epicsSocketDestroy(server);
    iocEnd();
}

/* --- The PLC is off, and records have I/O Intr --------------------------------------------- */

static void waitText(const char *pv, const char *text)
{
    WAIT_FOR(strcmp(get(pv), text) == 0);
}

static void waitReason(const char *record, const char *text)
{
    waitText(field(record, "STAT"), "COMM");
    WAIT_FOR(isReason(record, text));
}

static void testOff(void)
{
    static const char refused[] = "connection refused by PLC";
    epicsUInt8 block[BLOCK] = {0};
    epicsTimeStamp start, stamp;
    char address[40], error[200];
    plcStation *live, *dead;
    unsigned short port;
    SOCKET server;

    iocBegin();
    live = makeStation("P", 1, BLOCK, BLOCK);
    dead = makeStation("Q", 1, BLOCK, BLOCK);
    freeAddress(address);
    plcStationMove(dead, address, error, sizeof(error));
    makeRecord("ai", "In", "INP=@Q/0|SCAN=I/O Intr|FLNK=Chain");
    makeRecord("ai", "Event", "INP=@Q/0|SCAN=I/O Intr|TSE=-2");
    makeRecord("waveform", "Array", "INP=@Q/0|FTVL=SHORT|NELM=2|SCAN=I/O Intr");
    makeRecord("longin", "Passive", "INP=@Q/0");
    makeRecord("ai", "Moved", "INP=@P/0|SCAN=I/O Intr");
    makeRecord("ai", "Bad", "INP=@P/0|SCAN=I/O Intr");
    makeRecord("bi", "Stat", "INP=@Q|DTYP=S7plc stat|SCAN=I/O Intr|ZSV=MAJOR|TSE=-2");
    makeRecord("calc", "Chain", "DTYP=|CALC=VAL+1");
    epicsTimeGetCurrent(&start);
    iocRunOk();
    waitReason("In", refused);
    waitReason("Event", refused);
    waitReason("Array", refused);
    waitText("Stat.STAT", "STATE");
    isAlarm("In", "INVALID", "COMM", refused, "without a block");
    isAlarm("Event", "INVALID", "COMM", refused, "without a block");
    isAlarm("Array", "INVALID", "COMM", refused, "without a block");
    isField("In", "UDF", "1", "is not defined");
    isValue("Chain", "0", "it has not processed for that");
    stamp = timeNow("In");
    testOk(epicsTimeGreaterThanEqual(&stamp, &start), "the alarm has a time");
    stamp = timeNow("Event");
    testOk(epicsTimeGreaterThanEqual(&stamp, &start), "with TSE=-2, too");
    isAlarm("Passive", "INVALID", "UDF", "", "as long as nobody reads it");
    isField("Stat", "SEVR", "MAJOR", "has its own severity");
    isField("Stat", "STAT", "STATE", "says that the PLC is off");
    isField("Stat", "UDF", "0", "is defined");
    isValue("Stat", "0", "S7plc stat is 0");

    publish(live, block, 1);
    put("Moved.PROC", "1");
    isAlarm("Moved", "NO_ALARM", "NO_ALARM", "", "with a value of its PLC");
    put("Moved.INP", "@Q/0");
    waitReason("Moved", refused);
    isAlarm("Moved", "INVALID", "COMM", refused, "when its link goes to a PLC that is off");
    put("Bad.PROC", "1");
    stamp = timeNow("Bad");
    put("Bad.INP", "@Q/9999");
    isField("Bad", "STAT", "LINK", "has a bad link now");
    start = timeNow("Bad");
    testOk(epicsTimeGreaterThan(&start, &stamp), "that alarm has a time of its own");

    server = listenLocal(&port);
    epicsSnprintf(address, sizeof(address), "127.0.0.1:%u", port);
    plcStationMove(dead, address, error, sizeof(error));
    waitReason("In", "connected, waiting for first block");
    isAlarm("In", "INVALID", "COMM", "connected, waiting for first block",
            "when that is the reason");
    isValue("Chain", "0", "nor for a reason that changes");
    publish(dead, block, 1);
    put("In.PROC", "1");
    isAlarm("In", "NO_ALARM", "NO_ALARM", "", "with a block");
    epicsSocketDestroy(server);
    iocEnd();
}

static plcStation *makeConnected(const char *name, unsigned short port)
{
    plcStationConfig config = {.transport = &plcBlocks};

    config.name = name;
    config.address[0] = "127.0.0.1";
    config.address[1] = "";
    config.port = port;
    config.inSize = config.outSize = BLOCK;
    config.bigEndian = 1;
    config.recvTimeout = 3600000;
    config.sendInterval = 10;
    config.policy = &plcSingle;
    return plcStationCreate(&config);
}

static void testConnection(void)
{
    epicsUInt8 block[BLOCK] = {1, 2}, sent[BLOCK];
    testMonitor *stat, *value, *counter;
    unsigned short port;
    SOCKET server = listenLocal(&port), plc;
    char address[40];

    iocBegin();
    makeConnected("P", port);
    makeRecord("bi", "Stat", "INP=@P|DTYP=S7plc stat|SCAN=I/O Intr");
    makeRecord("stringout", "Addr", "OUT=@P|DTYP=S7plc addr");
    makeRecord("stringout", "OwnAddr", "OUT=@P|DTYP=S7plc addr|VAL=10.0.0.1:2000");
    makeRecord("ai", "In", "INP=@P/0|SCAN=I/O Intr");
    makeRecord("ao", "Out", "OUT=@P/0");
    makeRecord("ao", "Pini", "OUT=@P/2|VAL=7|PINI=YES");
    makeRecord("calc", "Counter", "DTYP=|CALC=VAL+1");
    makeRecord("longout", "Beat",
               "OUT=@P/4|SCAN=I/O Intr|OMSL=closed_loop|DOL=Counter PP");
    iocRunOk();
    stat = testMonitorCreate("Stat", DBE_VALUE | DBE_ALARM, 0);
    value = testMonitorCreate("In", DBE_VALUE | DBE_ALARM, 0);
    counter = testMonitorCreate("Beat", DBE_VALUE | DBE_ALARM, 0);
    epicsSnprintf(address, sizeof(address), "127.0.0.1:%u", port);
    isValue("Addr", address, "S7plc addr shows the address of s7plcConfigure");
    isField("Addr", "SEVR", "NO_ALARM", "is defined from the start");
    isValue("OwnAddr", "10.0.0.1:2000", "unless the database has set one");

    plc = epicsSocketAccept(server, NULL, NULL);
    receive(plc, sent);
    testOk(memcmp(sent, "\0\0\0\7", 4) == 0, "the first block has the PINI values");
    isValue("In.SEVR", "INVALID", "an input is INVALID before the first block");
    send(plc, (char *)block, BLOCK, 0);
    waitFor(value, "In", "258");
    isAlarm("In", "NO_ALARM", "NO_ALARM", "", "with a block");
    waitFor(stat, "Stat", "1");
    isAlarm("Stat", "NO_ALARM", "NO_ALARM", "", "while connected");
    while (atoi(get("Beat")) < 2)
        testMonitorWait(counter);
    testPass("an output with I/O Intr is processed by itself: a heartbeat");
    testOk(put("Out", "5") == 0, "ao takes a value");
    isAlarm("Out", "NO_ALARM", "NO_ALARM", "", "while connected");
    do {
        receive(plc, sent);
    } while (memcmp(sent, "\0\5", 2));
    testPass("its value reaches the PLC");

    epicsSocketDestroy(server); /* or it would be back at once */
    epicsSocketDestroy(plc);
    waitFor(stat, "Stat", "0");
    waitFor(value, "In.SEVR", "INVALID");
    isField("In", "STAT", "COMM", "has a COMM alarm after the connection was lost");
    isValue("In", "258", "In keeps its value after the connection was lost");
    isField("Stat", "SEVR", "NO_ALARM", "has no alarm after the connection was lost");
    testMonitorDestroy(stat);
    testMonitorDestroy(value);
    testMonitorDestroy(counter);
    iocEnd();
}

/* --- A record that holds up the threads of several PLCs ------------------------------------ */

static int reportHas(plcStation *s, const char *text)
{
    char report[4000];
    FILE *file = tmpfile();
    size_t length;

    plcStationReport(s, file, 1);
    rewind(file);
    length = fread(report, 1, sizeof(report) - 1, file);
    report[length] = 0;
    fclose(file);
    return strstr(report, text) != NULL;
}

/* A block comes while somebody else has its record. Returns 1 when the thread waited. */
static int holdUp(plcStation *s, const char *record, SOCKET plc)
{
    static const epicsUInt8 block[BLOCK];
    dbCommon *prec = testdbRecordPtr(record);
    int tries;

    for (tries = 0; tries < 100; tries++) {
        dbScanLock(prec);
        send(plc, (const char *)block, BLOCK, 0);
        epicsThreadSleep(0.04); /* so long is the record busy */
        dbScanUnlock(prec);
        if (reportHas(s, "in callback threads, since they held the PLC's own up for "))
            return 1;
    }
    return 0;
}

static void testHeldUp(void)
{
    static const char *const names[] = {"P", "Q", "R"};
    SOCKET server[COUNT(names)], plc[COUNT(names)];
    plcStation *station[COUNT(names)];
    const char *said = NULL;
    unsigned short port;
    unsigned i, held = 0;
    char link[40];

    iocBegin();
    for (i = 0; i < COUNT(names); i++) {
        server[i] = listenLocal(&port);
        station[i] = makeConnected(names[i], port);
        epicsSnprintf(link, sizeof(link), "INP=@%s/0|SCAN=I/O Intr", names[i]);
        makeRecord("ai", names[i], link);
    }
    iocRunOk();
    for (i = 0; i < COUNT(names); i++)
        plc[i] = epicsSocketAccept(server[i], NULL, NULL);
    testOk(!reportHas(station[0], "callback threads"), "no record has held up a PLC so far");
    messages();
    for (i = 0; i < COUNT(names); i++)
        held += holdUp(station[i], names[i], plc[i]);
    testOk(held == COUNT(names), "records hold up %u PLCs: the report says so for each", held);
    WAIT_FOR((said = strstr(messages(), "thread waited for them")));
    testOk(said && !strstr(said + 1, "thread waited for them"), "the log does for one of them");
    for (i = 0; i < COUNT(names); i++) {
        epicsSocketDestroy(server[i]);
        epicsSocketDestroy(plc[i]);
    }
    iocEnd();
}

MAIN(recordTestAlarms)
{
    testPlan((int)(IN_TESTS * COUNT(inputs) + 6 + 6 * COUNT(outputs) + 11 + 7 + 19 + 14 +
                   3));
    testHeldUp(); /* first: what else holds a thread up may be said as well */
    testInputs();
    testTimes();
    testOutputs();
    testReturn();
    testOff();
    testConnection();
    return testDone();
}
