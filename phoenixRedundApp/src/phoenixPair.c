/* A redundant pair as a policy; see phoenixPair.h.
 *
 * `role` belongs to the station's thread alone. `status` is a copy for others, guarded by
 * `lock`, which is held only to copy. */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <ellLib.h>
#include <epicsMutex.h>
#include <epicsStdio.h>
#include <epicsString.h>
#include <epicsThread.h>
#include <errlog.h>

#include "phoenixPair.h"
#include "plcScan.h"

struct phoenixPair {
    ELLNODE node;
    char *name;
    pairRole role;
    plcScan *scan;
    epicsMutexId lock;
    phoenixStatus status;
};

static ELLLIST pairs = ELLLIST_INIT;
static epicsMutexId listLock;
static epicsThreadOnceId once = EPICS_THREAD_ONCE_INIT;

static void initOnce(void *arg)
{
    (void)arg;
    listLock = epicsMutexMustCreate();
}

static void lockList(void)
{
    epicsThreadOnce(&once, initOnce, NULL);
    epicsMutexMustLock(listLock);
}

phoenixPair *phoenixPairCreate(const char *name)
{
    phoenixPair *p = callocMustSucceed(1, sizeof(*p), "phoenixPairCreate");

    p->name = epicsStrDup(name);
    pairRoleInit(&p->role, 2000000000u);
    p->scan = plcScanCreate(0, NULL, NULL);
    p->lock = epicsMutexMustCreate();
    p->status.primary = pairNobody;
    p->status.backup = phoenixUnknown;
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
    epicsMutexDestroy(p->lock);
    free(p->name);
    free(p); /* its scan list stays: EPICS has no way to free it */
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

IOSCANPVT phoenixPairScan(phoenixPair *p, int prio, int leave)
{
    return plcScanJoin(p->scan, 0, 0, prio, leave);
}

/* The paper's six states. */
static phoenixBackup backupOf(const phoenixStatus *status)
{
    if (status->primary == pairNobody)
        return phoenixUnknown;
    if (status->primary == pairFirst)
        return status->connected[1] ? phoenixSecondLinked : phoenixSecondUnlinked;
    return status->connected[0] ? phoenixFirstLinked : phoenixFirstUnlinked;
}

/* Copies what the role machine knows into the status. Returns 1 when that is news. */
static int publish(phoenixPair *p)
{
    const pairRole *r = &p->role;
    phoenixStatus before;
    int i, news;

    epicsMutexMustLock(p->lock);
    before = p->status;
    p->status.primary = r->leader;
    p->status.twoPrimaries = r->twoPrimaries;
    p->status.twoPrimariesCount = r->twoPrimariesCount;
    if (p->status.switchovers != r->switchovers) {
        p->status.switchovers = r->switchovers;
        p->status.switchDuration = r->duration * 1e-6;
        epicsTimeGetCurrent(&p->status.switchTime);
    }
    for (i = 0; i < PLC_LINKS_MAX; i++)
        p->status.connected[i] = r->plc[i].connected;
    p->status.backup = backupOf(&p->status);
    news = memcmp(&before, &p->status, sizeof(before)) != 0;
    epicsMutexUnlock(p->lock);
    return news;
}

static int step(void *pvt, plcEvent event, unsigned which, epicsUInt64 now,
                epicsUInt64 *wake)
{
    phoenixPair *p = pvt;
    pairWho leader = pairRoleStep(&p->role, event, which, now, wake);

    if (publish(p))
        plcScanRequestAll(p->scan);
    return leader;
}

static void destroy(void *pvt)
{
    phoenixPairDestroy(pvt);
}

const plcPolicy phoenixPolicy = {"redundant pair", 2, step, NULL, destroy};
