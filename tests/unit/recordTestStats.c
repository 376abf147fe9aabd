/* Statistics as records: every name on every record type that shows it, what is refused,
 * links that change, I/O Intr; and s7plcShow, which tells whose bytes are whose. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <dbAccess.h>
#include <dbStaticLib.h>
#include <dbUnitTest.h>
#include <epicsStdio.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcShow.h"
#include "plcStationPvt.h"
#include "plcStatsTable.h"
#include "recordTest.h"
#include "testTools.h"

#define IN 64
#define OUT 32

static const struct {
    const char *recordType;
    unsigned kinds;
    const char *fields;
} types[] = {
    {"ai",       plcStatNumber,               ""                    },
    {"longin",   plcStatNumber,               ""                    },
    {"int64in",  plcStatNumber,               ""                    },
    {"bi",       plcStatInteger,              "ZNAM=no|ONAM=yes"    },
    {"mbbi",     plcStatInteger,              "ONST=connecting|NOBT=4"},
    {"stringin", plcStatNumber | plcStatText, ""                    },
    {"lsi",      plcStatNumber | plcStatText, "SIZV=200"            },
    {"waveform", plcStatArray,                "FTVL=DOUBLE|NELM=64" },
    {"aai",      plcStatArray,                "FTVL=LONG|NELM=100"  },
};

static void recordName(char *name, size_t size, const char *type, const char *statistic)
{
    epicsSnprintf(name, size, "%s:%s", type, statistic);
}

static void makeAll(void)
{
    const plcStatRow *row;
    char name[60], fields[200];
    size_t i;

    for (i = 0; i < COUNT(types); i++)
        for (row = plcStatRows; row->name; row++) {
            recordName(name, sizeof(name), types[i].recordType, row->name);
            epicsSnprintf(fields, sizeof(fields), "DTYP=S7plc stats|INP=@P/%s|%s", row->name,
                          types[i].fields);
            makeRecord(types[i].recordType, name, fields);
        }
}

static int invalid(const char *record)
{
    char pv[80];

    epicsSnprintf(pv, sizeof(pv), "%s.SEVR", record);
    return strcmp(get(pv), "INVALID") == 0;
}

static void process(const char *record)
{
    char pv[80];

    epicsSnprintf(pv, sizeof(pv), "%s.PROC", record);
    put(pv, "1");
}

/* What the record type can show has no alarm; the rest is refused. */
static void checkAll(void)
{
    const plcStatRow *row;
    char name[60], pv[80];
    size_t i;

    for (i = 0; i < COUNT(types); i++)
        for (row = plcStatRows; row->name; row++) {
            recordName(name, sizeof(name), types[i].recordType, row->name);
            process(name);
            epicsSnprintf(pv, sizeof(pv), "%s.UDF", name);
            if (row->kind & types[i].kinds)
                testOk(!invalid(name) && atoi(get(pv)) == 0, "%s shows %s",
                       types[i].recordType, row->name);
            else
                testOk(invalid(name), "%s cannot show %s", types[i].recordType,
                       row->name);
        }
}

static size_t combinations(void)
{
    const plcStatRow *row;
    size_t n = 0;

    for (row = plcStatRows; row->name; row++)
        n++;
    return n * COUNT(types);
}

static const struct {
    const char *title, *name, *link, *text, *amsg;
} refused[] = {
    {"an unknown name", "bad:name", "@P/blocksInn", "no statistic \"blocksInn\" for ai; "
     "allowed: connected alive state stateTime leader inSize", "no statistic \"blocksInn\" for ai"},
    {"a text on a number", "bad:kind", "@P/lastError", "no statistic \"lastError\" for ai",
     "no statistic \"lastError\" for ai"},
    {"an unknown PLC", "bad:plc", "@Q/blocksIn", "no PLC \"Q\"; configured: P",
     "no PLC \"Q\""},
    {"no name", "bad:none", "@P", "a link of S7plc stats is @PLCname/name",
     "a link of S7plc stats is @PLCname/name"},
    {"a type behind the name", "bad:more", "@P/blocksIn T=INT16", "text behind",
     "text behind the name of a statistic"},
    {"an empty name", "bad:empty", "@P/", "no statistic \"\" for ai",
     "no statistic \"\" for ai"},
};

static void testRefused(const char *log)
{
    char line[200];
    size_t i;

    for (i = 0; i < COUNT(refused); i++) {
        epicsSnprintf(line, sizeof(line), "S7plc stats ai \"%s\" INP: %s", refused[i].name,
                      refused[i].text);
        testOk(strstr(log, line) != NULL, "%s is refused", refused[i].title);
        process(refused[i].name);
        testOk(invalid(refused[i].name) && isReason(refused[i].name, refused[i].amsg),
               "AMSG says why: %s", refused[i].amsg);
    }
}

static void isNow(const char *pv, const char *expected, const char *title)
{
    process(pv);
    isValue(pv, expected, title);
}

#define COUNTER(name) {#name, offsetof(plcStats, name)}

/* What other tests see counted in plcStats is what the statistic of that name shows. */
static const struct {
    const char *name;
    size_t at;
} counters[] = {
    COUNTER(blocksIn),      COUNTER(blocksOut),      COUNTER(bytesIn),       COUNTER(bytesOut),
    COUNTER(skipped),       COUNTER(coalesced),      COUNTER(ignored),       COUNTER(heartbeats),
    COUNTER(slowSends),     COUNTER(refusedWrites),  COUNTER(doubts),        COUNTER(outOfStep),
    COUNTER(sizeMismatches), COUNTER(connects),      COUNTER(connectErrors), COUNTER(clockErrors),
    COUNTER(putsDropped),   COUNTER(requests),       COUNTER(exceptions),    COUNTER(requestTimeouts),
    COUNTER(syncs),         COUNTER(syncsLost),      COUNTER(layoutMismatches), COUNTER(readbacks),
    COUNTER(mapDownloads),  COUNTER(mapRefusals),
};

static void testCounters(plcStation *s)
{
    plcStatValue value;
    plcStats before;
    size_t i;

    epicsMutexMustLock(s->lock);
    before = s->stats;
    for (i = 0; i < COUNT(counters); i++)
        *(epicsUInt64 *)((char *)&s->stats + counters[i].at) = 1000 + i;
    epicsMutexUnlock(s->lock);
    for (i = 0; i < COUNT(counters); i++) {
        plcStatGet(plcStatFind(counters[i].name, plcStatNumber), s, &value);
        testOk(value.integer == (epicsInt64)(1000 + i), "%s is the counter of its name",
               counters[i].name);
    }
    epicsMutexMustLock(s->lock);
    s->stats = before;
    epicsMutexUnlock(s->lock);
}

static void testValues(plcStation *s, int *listener, int *fd)
{
    char block[IN] = {0}, address[60], error[200], out[OUT], expected[80];
    int port = 0, i;

    *listener = toolListen(&port);
    sprintf(address, "127.0.0.1:%d", port);
    isNow("longin:state", "0", "state: no address");
    isNow("stringin:stateText", "no address", "in words");
    isNow("lsi:reason", "no address configured", "reason");
    plcStationMove(s, address, error, sizeof(error));
    *fd = toolAccept(*listener);
    for (i = 0; i < 3; i++) {
        toolSend(*fd, block, IN);
        WAIT_FOR((process("longin:blocksIn"), atoi(get("longin:blocksIn")) == i + 1));
    }
    isNow("int64in:blocksIn", "3", "three blocks came");
    isNow("lsi:blocksIn", "3", "as text too");
    sprintf(expected, "%d", 3 * IN);
    isNow("ai:bytesIn", expected, "their bytes");
    isNow("bi:connected", "1", "connected");
    isNow("mbbi:state", "3", "state ok");
    isNow("stringin:stateText", "ok", "in words");
    isNow("lsi:reason", "", "no reason");
    isNow("lsi:address", address, "address");
    isNow("longin:inSize", "64", "inSize");
    isNow("longin:outSize", "32", "outSize");
    isNow("lsi:options", "recvTimeout=60000 sendInterval=100", "options");
    plcStationSend(s);
    toolReceive(*fd, out, OUT);
    WAIT_FOR((process("longin:blocksOut"), atoi(get("longin:blocksOut")) == 1));
    isNow("longin:blocksOut", "1", "one block went");
    process("ai:connectedFor");
    testOk(atof(get("ai:connectedFor")) > 0, "connected for %s s", get("ai:connectedFor"));
    process("ai:period");
    testOk(atof(get("ai:period")) > 0, "period %s ms", get("ai:period"));
    process("stringin:connectTime");
    testOk(strlen(get("stringin:connectTime")) == 23, "connected at %s",
           get("stringin:connectTime"));
    process("waveform:periodHistogram");
    isValue("waveform:periodHistogram.NORD", "64", "64 bins");
    {
        plcStatValue unused;
        double bins[PLC_BINS], sum = 0;

        for (i = 0; i < (int)plcStatGetArray(plcStatFind("periodHistogram", plcStatArray), s,
                                             bins, PLC_BINS);
             i++)
            sum += bins[i];
        testOk(sum == 2, "two periods in the histogram");
        testOk(plcStatGetArray(plcStatFind("histogramBins", plcStatArray), s, bins, 4) == 4 &&
                   bins[0] == 0.01 && bins[3] > 0.0199 && bins[3] < 0.0201,
               "its x axis");
        epicsMutexMustLock(s->lock);
        s->stats.bytesOut = (epicsUInt64)1 << 40;
        epicsMutexUnlock(s->lock);
        isNow("longin:bytesOut", "2147483647", "a longin ends at its largest number");
        isNow("int64in:bytesOut", "1099511627776", "an int64in goes on");
        plcStationSetOption(s, "heartbeat", "3600000", error, sizeof(error));
        isNow("lsi:options", "recvTimeout=60000 sendInterval=100 heartbeat=3600000", "a long text");
        isNow("stringin:options", "recvTimeout=60000 sendInterval=100 hear", "is cut in a stringin");
        plcStatGet(plcStatFind("BLOCKSIN", plcStatNumber), s, &unused);
        testOk(unused.integer == 3, "upper and lower case are the same");
    }
    isNow("waveform:wrong", "", "an array of a type that holds no bin");
    testOk(invalid("waveform:wrong"), "is INVALID");
}

/* A link may change at run time, on each record type: to another statistic, to nonsense,
 * and back. */
static void testLinks(void)
{
    char name[60], pv[80], link[60];
    size_t i;

    for (i = 0; i < COUNT(types); i++) {
        const char *good = types[i].kinds & plcStatArray ? "histogramBins" : "connected";
        int first, middle;

        recordName(name, sizeof(name), types[i].recordType,
                   types[i].kinds & plcStatArray ? "periodHistogram" : "state");
        epicsSnprintf(pv, sizeof(pv), "%s.INP", name);
        epicsSnprintf(link, sizeof(link), "@P/%s", good);
        put(pv, link);
        process(name);
        first = !invalid(name);
        put(pv, "@P/nonsense");
        process(name);
        middle = invalid(name);
        put(pv, link);
        process(name);
        testOk(first && middle && !invalid(name), "%s: the link changes, to nonsense and back",
               types[i].recordType);
    }
}

/* Every record of the template shows something. */
static void testTemplate(void)
{
    DBENTRY entry;
    long status;
    int count = 0, bad = 0;

    dbInitEntry(pdbbase, &entry);
    for (status = dbFirstRecordType(&entry); !status; status = dbNextRecordType(&entry)) {
        long found;

        for (found = dbFirstRecord(&entry); !found; found = dbNextRecord(&entry)) {
            const char *name = dbGetRecordName(&entry);

            if (strncmp(name, "T:", 2))
                continue;
            count++;
            process(name);
            if (invalid(name)) {
                bad++;
                testDiag("%s is INVALID", name);
            }
        }
    }
    dbFinishEntry(&entry);
    testOk(count > 40 && bad == 0, "s7plcStation.db: %d records, all show something", count);
}

/* Records with SCAN=I/O Intr follow without anyone asking. */
static void testScan(plcStation *s, int *fd, int listener)
{
    (void)s;
    WAIT_FOR(atoi(get("scan:state")) == 3);
    isValue("scan:state", "3", "I/O Intr: the state");
    WAIT_FOR(atoi(get("scan:blocksIn")) == 3);
    isValue("scan:blocksIn", "3", "and the counters, within a second");
    toolClose(*fd);
    *fd = toolAccept(listener);
    WAIT_FOR(atoi(get("scan:state")) == 2);
    isValue("scan:state", "2", "a state that changes");
    put("scan:blocksIn.INP", "@P/reconnects");
    WAIT_FOR(atoi(get("scan:blocksIn")) == 1);
    isValue("scan:blocksIn", "1", "a link that changes");
    put("scan:blocksIn.INP", "@P/nonsense");
    process("scan:blocksIn");
    isMessage("scan:blocksIn", "no statistic \"nonsense\" for longin",
              "to nonsense: INVALID with the reason");
    put("scan:blocksIn.INP", "@P/inSize");
    WAIT_FOR(atoi(get("scan:blocksIn")) == 64);
    isValue("scan:blocksIn", "64", "and back");
    isValue("scan:blocksIn.SEVR", "NO_ALARM", "without alarm");
}

/* The manual has a line for each name. */
static void testManual(void)
{
    char *manual = toolReadFile("docs/statistics.md"), cell[60];
    const plcStatRow *row;
    int missing = 0;

    for (row = plcStatRows; row->name; row++) {
        epicsSnprintf(cell, sizeof(cell), "| `%s` |", row->name);
        if (!strstr(manual, cell)) {
            missing++;
            testDiag("docs/statistics.md has no %s", row->name);
        }
    }
    testOk(missing == 0, "docs/statistics.md has all names");
    free(manual);
}

/* --- s7plcShow ---------------------------------------------------------------------------*/

static const char *shown(plcStation *s, const char *what)
{
    static char text[20000];
    FILE *file = fmemopen(text, sizeof(text), "w");

    testOk(plcShow(s, what, file) == 0, "show %s", what);
    fclose(file);
    return text;
}

static void has(const char *text, const char *part)
{
    if (!testOk(strstr(text, part) != NULL, "it shows \"%.*s\"", (int)strcspn(part, "\n"),
                part))
        testDiag("%s", text);
}

static void testShow(plcStation *s)
{
    static const unsigned char block[IN] = {0x12, 0x34, 'A', 'B', 0, 0, 0, 0, 0x41, 0x20};
    const char *text;

    publish(s, block, 1000);
    text = shown(s, "in");
    has(text, "P in, PLC -> IOC: 64 bytes, 6 records\n");
    has(text, "       0   12 34 41 42  00 00 00 00  41 20 00 00  00 00 00 00   .4AB....A ....");
    has(text, "        0-1         show:word (longin INT16) = 4660\n");
    has(text, "        0           show:byte (longin UINT8) = 18\n");
    has(text, "        2-7         show:text (stringin STRING) = \"AB\"\n");
    has(text, "        8-11        show:real (ai REAL32) = 10\n");
    has(text, "        12-13       show:bit0 (bi INT16 bit 0) = 0\n");
    has(text, "        12-13       show:bit1 (bi INT16 bit 1) = 0\n");
    has(text, "  Overlaps:\n        show:byte at 0 and show:word at 0-1\n  Bytes");
    has(text, "  Bytes that no record reads: 14-19, 24-63 (46 of 64)\n");
    has(text, "       *  zeros\n");
    text = shown(s, "out");
    has(text, "P out, IOC -> PLC: 32 bytes, 2 records\n");
    has(text, "        4-7         show:out (ao INT32) = 0, read back at 20\n");
    has(text, "        8-9         show:bits (mbbo UINT16 bits 0030) = 0, never written\n");
    has(text, "  Overlaps: none\n  Bytes that no record writes: 0-3, 10-31 (26 of 32)\n");
    put("show:out.OUT", "@P/16 T=INT16");
    put("show:byte.INP", "@P/nonsense here");
    text = shown(s, "records");
    has(text, "P: 5 input records\n");
    has(text, "P: 2 output records\n");
    has(text, "        16-17       show:out (ao INT16) = 0, never written\n");
    testOk(strstr(text, "show:byte") == NULL, "a refused link is not in the list");
    put("show:out", "5");
    has(shown(s, "records"), "        16-17       show:out (ao INT16) = 5\n");
    testOk(plcShow(s, "nonsense", stdout) == -1, "show nonsense is refused");
}

static void runRefused(void)
{
    char fields[100];
    size_t i;

    iocBegin();
    makeStation("P", 1, IN, OUT);
    for (i = 0; i < COUNT(refused); i++) {
        epicsSnprintf(fields, sizeof(fields), "DTYP=S7plc stats|INP=%s", refused[i].link);
        makeRecord("ai", refused[i].name, fields);
    }
    iocRunOk();
    testRefused(messages());
    iocEnd();
}

static void runGood(void)
{
    int listener, fd;
    plcStation *s;

    iocBegin();
    s = makeStation("P", 1, IN, OUT);
    makeAll();
    makeRecord("waveform", "waveform:wrong",
               "DTYP=S7plc stats|INP=@P/histogramBins|FTVL=SHORT|NELM=64");
    makeRecord("longin", "scan:state", "DTYP=S7plc stats|INP=@P/state|SCAN=I/O Intr");
    makeRecord("longin", "scan:blocksIn", "DTYP=S7plc stats|INP=@P/blocksIn|SCAN=I/O Intr");
    makeRecord("longin", "show:word", "INP=@P/0");
    makeRecord("longin", "show:byte", "INP=@P/0 T=BYTE");
    makeRecord("stringin", "show:text", "INP=@P/2 L=6");
    makeRecord("ai", "show:real", "INP=@P/8 T=FLOAT");
    makeRecord("bi", "show:bit0", "INP=@P/12 B=0");
    makeRecord("bi", "show:bit1", "INP=@P/12 B=1");
    makeRecord("ao", "show:out", "OUT=@P/4 T=INT32 R=20");
    makeRecord("mbbo", "show:bits", "OUT=@P/8 T=WORD|NOBT=2|SHFT=4");
    testdbReadDatabase("s7plcStation.db", "../../../s7plcApp/Db:../../s7plcApp/Db",
                       "P=T:,PLC=P");
    iocRunOk();
    checkAll();
    testCounters(s);
    testValues(s, &listener, &fd);
    testTemplate();
    testLinks();
    testScan(s, &fd, listener);
    testShow(s);
    toolClose(fd);
    toolClose(listener);
    iocEnd();
}

MAIN(recordTestStats)
{
    testPlan((int)combinations() + 2 * (int)COUNT(refused) + 62 + (int)COUNT(types) +
             (int)COUNT(counters));
    testManual();
    runRefused();
    runGood();
    return testDone();
}
