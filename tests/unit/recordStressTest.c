/* I/O Intr records under random episodes: blocks of which some bytes change, links that
 * change, SCAN and PRIO, pauses of the IOC, lost connections. After each of them every record
 * that is scanned must show what the PLC sent last, or say that it cannot.
 *
 * Arguments: number of episodes (60, or PLCLINK_EPISODES), seed (from the clock).
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <alarm.h>
#include <biRecord.h>
#include <dbAccess.h>
#include <dbLock.h>
#include <dbScan.h>
#include <epicsStdio.h>
#include <epicsThread.h>
#include <epicsTime.h>
#include <epicsUnitTest.h>
#include <iocInit.h>
#include <longinRecord.h>
#include <testMain.h>

#include "recordTest.h"
#include "testTools.h"

#define BLOCK 48
#define RECORDS 40

/* What must be true of a record. */
typedef struct model {
    longinRecord *record;
    int scanned; /* SCAN=I/O Intr */
    int good;    /* its link is */
    unsigned offset;
} model;

static model models[RECORDS];
static biRecord *stat;
static int statScanned = 1;
static unsigned char block[BLOCK]; /* what the PLC sent last */
static int listener, fd;           /* the PLC's end; -1: the connection was lost */
static int valid, paused;
static epicsUInt64 losses; /* of the connection */
static plcStation *station;
static unsigned long long state;

static unsigned dice(unsigned n)
{
    state = state * 6364136223846793005ull + 1442695040888963407ull;
    return (unsigned)(state >> 33) % n;
}

static void putField(const char *record, const char *field, const char *value)
{
    char pv[40];

    epicsSnprintf(pv, sizeof(pv), "%s.%s", record, field);
    put(pv, value);
}

/* --- What may happen ------------------------------------------------------------------ */

static void sendBlock(void)
{
    unsigned changes = dice(4);

    while (changes--)
        block[dice(BLOCK)] = (unsigned char)dice(4);
    if (fd >= 0 && toolSend(fd, block, BLOCK) == 0)
        valid = 1;
}

static void loseConnection(void)
{
    if (fd < 0)
        return;
    toolClose(fd);
    losses++;
    fd = -1;
    valid = 0;
}

static void connectAgain(void)
{
    if (fd >= 0)
        return;
    fd = toolAccept(listener);
    if (dice(2))
        sendBlock();
}

static void changeLink(void)
{
    model *m = &models[dice(RECORDS)];
    char link[40];

    m->good = dice(5) != 0;
    m->offset = dice(BLOCK - 1);
    epicsSnprintf(link, sizeof(link), "@P/%u T=UINT16", m->good ? m->offset : 9999u);
    putField(m->record->name, "INP", link);
}

static void changeScan(void)
{
    model *m = &models[dice(RECORDS)];

    m->scanned = dice(4) != 0;
    putField(m->record->name, "SCAN", m->scanned ? "I/O Intr" : "Passive");
}

static void changeOrder(void)
{
    static const char *const prios[] = {"LOW", "MEDIUM", "HIGH"};
    static const char *const phases[] = {"-1", "0", "1"};
    model *m = &models[dice(RECORDS)];

    if (dice(2))
        putField(m->record->name, "PRIO", prios[dice(3)]);
    else
        putField(m->record->name, "PHAS", phases[dice(3)]);
}

static void changeStat(void)
{
    statScanned = dice(4) != 0;
    putField("stat", "SCAN", statScanned ? "I/O Intr" : "Passive");
}

static void pauseOrRun(void)
{
    if (paused)
        iocRun();
    else
        iocPause();
    paused = !paused;
}

static const struct {
    const char *name;
    void (*run)(void);
    unsigned weight;
} actions[] = {
    {"block",   sendBlock,      10},
    {"lost",    loseConnection, 1 },
    {"connect", connectAgain,   3 },
    {"link",    changeLink,     5 },
    {"scan",    changeScan,     5 },
    {"order",   changeOrder,    3 },
    {"stat",    changeStat,     1 },
    {"pause",   pauseOrRun,     2 },
};

static char history[400]; /* of the episode */

static void act(void)
{
    unsigned which = 0, n = dice(30);

    while (n >= actions[which].weight)
        n -= actions[which++].weight;
    epicsSnprintf(history + strlen(history), sizeof(history) - strlen(history), " %s",
                  actions[which].name);
    actions[which].run();
}

/* --- What must be true then ------------------------------------------------------------ */

static int isRight(const model *m)
{
    int wanted = block[m->offset] << 8 | block[m->offset + 1], right;
    longinRecord *prec = m->record;

    if (!m->scanned)
        return 1;
    dbScanLock((dbCommon *)prec);
    if (!m->good)
        right = prec->stat == LINK_ALARM && prec->sevr == INVALID_ALARM;
    else if (!valid)
        right = prec->stat == COMM_ALARM && prec->sevr == INVALID_ALARM;
    else
        right = prec->val == wanted && prec->sevr == NO_ALARM;
    dbScanUnlock((dbCommon *)prec);
    return right;
}

/* The first record that is wrong; NULL: none. */
static const model *wrong(void)
{
    size_t i;

    for (i = 0; i < RECORDS; i++)
        if (!isRight(&models[i]))
            return &models[i];
    return NULL;
}

/* S7plc stat is told with blocks; without them TCP may be up or not. */
static int statIsRight(void)
{
    int right;

    dbScanLock((dbCommon *)stat);
    right = !statScanned || !valid || stat->val == 1;
    dbScanUnlock((dbCommon *)stat);
    return right;
}

/* The station has got what the PLC did. */
static int isThrough(void)
{
    unsigned char bytes[BLOCK];
    plcStats stats;

    plcStationStats(station, &stats);
    if (stats.disconnects != losses)
        return 0;
    return !valid || (plcImageRead(plcStationInput(station), 0, BLOCK, bytes, NULL) == 0 &&
                      memcmp(bytes, block, BLOCK) == 0);
}

static int episode(void)
{
    unsigned n = 1 + dice(6);
    const model *m;

    history[0] = 0;
    while (n--)
        act();
    if (paused)
        pauseOrRun();
    WAIT_FOR(isThrough());
    if (!isThrough())
        testDiag("after%s: the station has not got through", history);
    WAIT_FOR(!wrong() && statIsRight());
    m = wrong();
    if (m)
        testDiag("after%s: %s (%s, PRIO %d) at %u is %d, %s", history, m->record->name,
                 m->good ? "good link" : "bad link", m->record->prio, m->offset,
                 m->record->val, epicsAlarmConditionStrings[m->record->stat]);
    if (m)
        plcStationReport(station, stdout, 1);
    else if (!statIsRight())
        testDiag("after%s: S7plc stat is %d", history, stat->val);
    return !m && statIsRight();
}

/* --- All together ---------------------------------------------------------------------- */

static dbCommon *find(const char *name)
{
    DBADDR address;

    if (dbNameToAddr(name, &address))
        testAbort("no record %s", name);
    return address.precord;
}

static void begin(const char *scan)
{
    char address[40], error[200], name[20], fields[80];
    int port = 0, i;

    listener = toolListen(&port);
    sprintf(address, "127.0.0.1:%d", port);
    iocBegin();
    station = makeStation("P", 1, BLOCK, 0);
    plcStationSetOption(station, "scan", scan, error, sizeof(error));
    for (i = 0; i < RECORDS; i++) {
        models[i].good = models[i].scanned = 1;
        models[i].offset = (unsigned)i;
        sprintf(name, "r%d", i);
        sprintf(fields, "INP=@P/%d T=UINT16|SCAN=I/O Intr", i);
        makeRecord("longin", name, fields);
    }
    makeRecord("bi", "stat", "DTYP=S7plc stat|INP=@P|SCAN=I/O Intr|ZNAM=no|ONAM=yes");
    iocRunOk();
    for (i = 0; i < RECORDS; i++) {
        sprintf(name, "r%d", i);
        models[i].record = (longinRecord *)find(name);
    }
    stat = (biRecord *)find("stat");
    statScanned = 1;
    losses = 0;
    plcStationMove(station, address, error, sizeof(error));
    fd = toolAccept(listener);
    sendBlock();
    WAIT_FOR(!wrong());
}

static void end(void)
{
    toolClose(fd);
    toolClose(listener);
    iocEnd();
}

static void run(const char *scan, unsigned long episodes)
{
    unsigned long good = 0;

    testDiag("scan=%s", scan);
    begin(scan);
    while (good < episodes && episode())
        good++;
    testOk(good == episodes, "scan=%s: %lu of %lu episodes end with what the PLC sent", scan,
           good, episodes);
    end();
}

MAIN(recordStressTest)
{
    const char *wanted = getenv("PLCLINK_EPISODES");
    unsigned long episodes = argc > 1 ? strtoul(argv[1], NULL, 0)
                             : wanted ? strtoul(wanted, NULL, 0)
                                      : 60;

    testPlan(2);
    state = argc > 2 ? strtoull(argv[2], NULL, 0) : epicsMonotonicGet();
    testDiag("%lu episodes each, seed %llu", episodes, state);
    run("changed", episodes);
    run("all", episodes);
    return testDone();
}
