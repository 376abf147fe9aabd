/* A redundant pair as a policy; see phoenixPair.h.
 *
 * Threads: `role` belongs to the station's thread alone. What it and the thread of the
 * watch find out meets in `status` and `asked`, guarded by `lock`, which is held only to
 * copy and compare: never across a system call, errlog, a scan request or another lock.
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <ellLib.h>
#include <epicsMutex.h>
#include <epicsStdio.h>
#include <epicsString.h>
#include <epicsThread.h>
#include <errlog.h>

#include "pairWatch.h"
#include "phoenixPair.h"
#include "plcOptions.h"
#include "plcScan.h"
#include "plcStation.h"

/* One line of the log per PLC in this time about its reachability, s. */
#define REACH_LOG_S 30.0

const char *const phoenixName[PLC_LINES_MAX] = {"FIRST", "SECOND"};
const char *const phoenixBackupText[] = {"no partner",       "plc-1st unlinked",
                                         "plc-2nd unlinked", "plc-1st linked",
                                         "plc-2nd linked",   "unknown"};

/* What s7plcSetOption sets of a pair alone. */
typedef struct choices {
    double pingPeriod; /* ms, 0 = off */
} choices;

static const plcOptionRow optionRows[] = {
    {.key = "pingPeriod", .kind = plcOptPeriod, .field = offsetof(choices, pingPeriod),
     .min = 50, .max = 3600000, .unit = "ms", .initial = 1000,
     .help = "redundant pair: both PLCs are asked by ICMP echo whether they are there; 0: never"},
};

static plcOptionTable optionTable = {.rows = optionRows, .count = 1, .size = sizeof(choices),
                                     .of = "redundant pair"};

struct phoenixPair {
    ELLNODE node;
    char *name;
    plcScan *scan;
    pairWatch *watch; /* while the station's thread runs */
    /* the station's thread */
    plcStation *station;
    pairRole role;
    double pingPeriod; /* ms */
    /* the watch's thread */
    epicsUInt64 reachLogged[PLC_LINES_MAX]; /* 0: never */
    epicsMutexId lock;                      /* guards from here on */
    phoenixStatus status;
    int answeredOnce[PLC_LINES_MAX]; /* to ICMP echo */
    int asked[PLC_LINES_MAX];        /* its role changed; the watch was asked about it */
};

/* --- The list of pairs -------------------------------------------------------------- */

static ELLLIST pairs = ELLLIST_INIT;
static epicsMutexId listLock;
static epicsThreadOnceId once = EPICS_THREAD_ONCE_INIT;

static void initOnce(void *arg)
{
    (void)arg;
    plcOptionsAdd(&optionTable);
    listLock = epicsMutexMustCreate();
}

void phoenixPairInit(void)
{
    epicsThreadOnce(&once, initOnce, NULL);
}

static void lockList(void)
{
    phoenixPairInit();
    epicsMutexMustLock(listLock);
}

phoenixPair *phoenixPairCreate(const char *name)
{
    phoenixPair *p = callocMustSucceed(1, sizeof(*p), "phoenixPairCreate");
    int i;

    p->name = epicsStrDup(name);
    pairRoleInit(&p->role, 2000000000u);
    p->scan = plcScanCreate(0, NULL, NULL);
    p->lock = epicsMutexMustCreate();
    p->status.primary = pairNobody;
    p->status.backup = phoenixUnknown;
    for (i = 0; i < PLC_LINES_MAX; i++)
        p->status.reachable[i] = phoenixNotKnown;
    lockList();
    ellAdd(&pairs, &p->node);
    epicsMutexUnlock(listLock);
    return p;
}

void phoenixPairDestroy(phoenixPair *p)
{
    lockList();
    ellDelete(&pairs, &p->node);
    epicsMutexUnlock(listLock);
    pairWatchDestroy(p->watch);
    plcScanDestroy(p->scan);
    epicsMutexDestroy(p->lock);
    free(p->name);
    free(p);
}

phoenixPair *phoenixPairFind(const char *name)
{
    phoenixPair *p;

    lockList();
    for (p = (phoenixPair *)ellFirst(&pairs); p; p = (phoenixPair *)ellNext(&p->node))
        if (strcmp(p->name, name) == 0)
            break;
    epicsMutexUnlock(listLock);
    return p;
}

void phoenixPairsRun(void)
{
    phoenixPair *p;

    lockList();
    for (p = (phoenixPair *)ellFirst(&pairs); p; p = (phoenixPair *)ellNext(&p->node))
        plcScanRequestAll(p->scan);
    epicsMutexUnlock(listLock);
}

void phoenixPairStatus(phoenixPair *p, phoenixStatus *status)
{
    epicsMutexMustLock(p->lock);
    *status = p->status;
    epicsMutexUnlock(p->lock);
}

IOSCANPVT phoenixPairScan(phoenixPair *p, dbCommon *prec, int leave)
{
    return plcScanRecord(p->scan, 0, 0, prec, leave);
}

/* --- Status ------------------------------------------------------------------------- */

/* The paper's six states. The BACKUP is linked when TCP is up and it has not stopped to
 * answer: a connection to a PLC whose cable was pulled looks sound for long. */
static phoenixBackup backupOf(const phoenixPair *p)
{
    const phoenixStatus *s = &p->status;
    int who = !s->primary;

    if (s->primary == pairNobody || s->twoPrimaries)
        return phoenixUnknown;
    if (!s->connected[who] || s->reachable[who] == phoenixNoAnswer)
        return who ? phoenixSecondUnlinked : phoenixFirstUnlinked;
    if (p->asked[who])
        return phoenixUnknown;
    return who ? phoenixSecondLinked : phoenixFirstLinked;
}

/* What one echo says. Who never answered may never answer ICMP: then TCP alone tells. */
static phoenixReach reachOf(const phoenixPair *p, unsigned which, int answers)
{
    if (answers > 0)
        return phoenixAnswers;
    if (answers < 0 || (p->status.connected[which] && !p->answeredOnce[which]))
        return phoenixNotKnown;
    return phoenixNoAnswer;
}

static void logReach(phoenixPair *p, unsigned which, phoenixReach reach)
{
    epicsUInt64 now = epicsMonotonicGet();

    if (p->reachLogged[which] && now - p->reachLogged[which] < REACH_LOG_S * 1e9)
        return;
    p->reachLogged[which] = now;
    if (reach == phoenixNoAnswer)
        errlogSevPrintf(errlogMinor, "s7plc %s: %s does not answer ICMP echo\n", p->name,
                        phoenixName[which]);
    else if (reach == phoenixAnswers)
        errlogSevPrintf(errlogInfo, "s7plc %s: %s answers ICMP echo\n", p->name,
                        phoenixName[which]);
}

/* In the thread of the watch, after each question. */
static void news(void *pvt, unsigned which, int answers)
{
    phoenixPair *p = pvt;
    phoenixReach before, reach;
    int changed;

    epicsMutexMustLock(p->lock);
    before = p->status.reachable[which];
    reach = reachOf(p, which, answers);
    changed = reach != before || p->asked[which];
    p->status.reachable[which] = reach;
    p->answeredOnce[which] |= answers > 0;
    p->asked[which] = 0;
    p->status.backup = backupOf(p);
    epicsMutexUnlock(p->lock);
    if (!changed)
        return;
    plcScanRequestAll(p->scan);
    /* That all is well at the start needs no line. */
    if (reach != before && !(before == phoenixNotKnown && reach == phoenixAnswers))
        logReach(p, which, reach);
}

static const char *reasonText(const pairRole *r, char *text, size_t size)
{
    const char *old = phoenixName[!r->leader];

    if (r->reason == pairDisconnected)
        epicsSnprintf(text, size, "%s disconnected", old);
    else
        epicsSnprintf(text, size, "%s silent for %.0f ms", old, r->duration * 1e-6);
    return text;
}

/* Copies what the roles have become into the status. Lock held. Returns 1 on news. */
static int copyRole(phoenixPair *p)
{
    const pairRole *r = &p->role;
    phoenixStatus *s = &p->status;
    int i, changed = s->primary != r->leader || s->twoPrimaries != r->twoPrimaries ||
                     s->switchovers != r->switchovers;

    s->primary = r->leader;
    s->twoPrimaries = r->twoPrimaries;
    s->twoPrimariesCount = r->twoPrimariesCount;
    if (s->switchovers != r->switchovers) {
        s->switchovers = r->switchovers;
        s->switchDuration = r->duration * 1e-6;
        epicsTimeGetCurrent(&s->switchTime);
        reasonText(r, s->switchReason, sizeof(s->switchReason));
    }
    for (i = 0; i < PLC_LINES_MAX; i++) {
        if (s->connected[i] == r->plc[i].connected)
            continue;
        changed = 1;
        s->connected[i] = r->plc[i].connected;
        /* Who takes a connection is there. */
        if (s->connected[i] && s->reachable[i] == phoenixNoAnswer)
            s->reachable[i] = p->answeredOnce[i] ? phoenixAnswers : phoenixNotKnown;
    }
    s->backup = backupOf(p);
    return changed;
}

/* --- The policy --------------------------------------------------------------------- */

static void logRole(phoenixPair *p, const pairRole *before)
{
    const pairRole *r = &p->role;
    char text[120], reason[60];

    if (r->leader != before->leader && r->leader != pairNobody) {
        if (r->switchovers != before->switchovers)
            epicsSnprintf(text, sizeof(text), "%s is PRIMARY now, %s",
                          phoenixName[r->leader], reasonText(r, reason, sizeof(reason)));
        else
            epicsSnprintf(text, sizeof(text), "%s is PRIMARY", phoenixName[r->leader]);
        plcStationLog(p->station,
                      r->switchovers == before->switchovers ? errlogInfo : errlogMinor,
                      text);
    }
    if (r->twoPrimaries && !before->twoPrimaries) {
        /* NOLINTNEXTLINE(clang-analyzer-core.CallAndMessage): of two that send one leads */
        epicsSnprintf(text, sizeof(text), "two PRIMARIES: both PLCs send; %s stays",
                      phoenixName[r->leader]);
        plcStationLog(p->station, errlogMajor, text);
    } else if (before->twoPrimaries && !r->twoPrimaries) {
        plcStationLog(p->station, errlogInfo, "no longer two PRIMARIES");
    }
}

/* The one that led is BACKUP now. Is it there? Until it answers, that is not known. */
static void askBackup(phoenixPair *p, unsigned which)
{
    int ask;

    epicsMutexMustLock(p->lock);
    ask = p->watch && p->pingPeriod > 0 && p->status.reachable[which] == phoenixAnswers;
    p->asked[which] = ask;
    p->status.backup = backupOf(p);
    epicsMutexUnlock(p->lock);
    if (ask)
        pairWatchNow(p->watch, which);
}

static int step(void *pvt, plcEvent event, unsigned which, epicsUInt64 now,
                epicsUInt64 *wake)
{
    phoenixPair *p = pvt;
    pairRole before = p->role;
    int changed;

    pairRoleStep(&p->role, event, which, now, wake);
    epicsMutexMustLock(p->lock);
    changed = copyRole(p);
    epicsMutexUnlock(p->lock);
    if (!changed)
        return p->role.leader;
    if (p->role.leader != before.leader && p->role.leader != pairNobody)
        askBackup(p, !p->role.leader);
    logRole(p, &before);
    plcScanRequestAll(p->scan);
    return p->role.leader;
}

static void begin(void *pvt, plcStation *station)
{
    phoenixPair *p = pvt;

    p->station = station;
    p->watch = pairWatchCreate(pairWatchAny, news, p);
    if (!p->watch)
        plcStationLog(station, errlogMajor, "cannot ask by ICMP echo: no thread or no "
                      "descriptor for it");
    p->pingPeriod = -1; /* options() tells the watch */
}

static void options(void *pvt, const plcOptions *o)
{
    const choices *own = plcOptionsOwn(o, &optionTable);
    phoenixPair *p = pvt;
    int i;

    p->role.recvTimeout = (epicsUInt64)(o->recvTimeout * 1e6);
    if (p->pingPeriod == own->pingPeriod)
        return;
    p->pingPeriod = own->pingPeriod;
    pairWatchPeriod(p->watch, p->pingPeriod);
    epicsMutexMustLock(p->lock);
    for (i = 0; i < PLC_LINES_MAX && p->pingPeriod <= 0; i++)
        p->status.reachable[i] = phoenixNotKnown;
    epicsMutexUnlock(p->lock);
}

static void address(void *pvt, unsigned which, struct in_addr host)
{
    phoenixPair *p = pvt;

    epicsMutexMustLock(p->lock);
    p->status.host[which] = host;
    epicsMutexUnlock(p->lock);
    pairWatchHost(p->watch, which, host);
}

static int suspect(void *pvt, unsigned which)
{
    const phoenixPair *p = pvt;

    return p->role.leader == (pairWho)!which && pairRoleMissed(&p->role);
}

static void end(void *pvt)
{
    phoenixPair *p = pvt;

    pairWatchDestroy(p->watch);
    p->watch = NULL;
}

static void report(void *pvt, FILE *file, int level)
{
    phoenixPair *p = pvt;
    phoenixStatus s;
    char when[40] = "", host[INET_ADDRSTRLEN];
    int i;

    phoenixPairStatus(p, &s);
    fprintf(file, "    pair: PRIMARY %s, BACKUP %s%s, %u switch-over%s\n",
            s.primary == pairNobody ? "unknown" : phoenixName[s.primary],
            phoenixBackupText[s.backup], s.twoPrimaries ? ", TWO PRIMARIES" : "",
            (unsigned)s.switchovers, s.switchovers == 1 ? "" : "s");
    if (level < 1)
        return;
    for (i = 0; i < PLC_LINES_MAX; i++)
        fprintf(file, "    %s at %s: %s, %s ICMP echo\n", phoenixName[i],
                s.host[i].s_addr ? inet_ntop(AF_INET, &s.host[i], host, sizeof(host))
                                 : "?",
                s.connected[i] ? "connected" : "not connected",
                s.reachable[i] == phoenixAnswers    ? "answers"
                : s.reachable[i] == phoenixNoAnswer ? "does not answer"
                                                    : "not known to answer");
    fprintf(file, "    two PRIMARIES: %u times\n", (unsigned)s.twoPrimariesCount);
    if (!s.switchovers)
        return;
    epicsTimeToStrftime(when, sizeof(when), "%Y-%m-%d %H:%M:%S.%03f", &s.switchTime);
    fprintf(file, "    last switch-over: %s, %s; %.1f ms without data\n", when,
            s.switchReason, s.switchDuration);
}

static void destroy(void *pvt)
{
    phoenixPairDestroy(pvt);
}

const plcPolicy phoenixPolicy = {
    .name = "redundant pair",
    .lines = 2,
    .step = step,
    .begin = begin,
    .options = options,
    .address = address,
    .suspect = suspect,
    .end = end,
    .report = report,
    .destroy = destroy,
};
