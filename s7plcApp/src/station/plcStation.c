/* Stations: their list and their life; see plcStation.h. The thread that does the work is in
 * plcStationThread.c, what records ask in plcStationFace.c. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsAtomic.h>
#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <epicsString.h>
#include <epicsThread.h>
#include <errlog.h>

#include "plcClock.h"
#include "plcHot.h"
#include "plcStationPvt.h"

/* The list only grows until plcStationsDestroy; `listLock` guards it, and the flags. */
static ELLLIST stations = ELLLIST_INIT;
static ELLLIST lost = ELLLIST_INIT; /* those whose threads did not end: nobody frees them */
static epicsMutexId listLock;
static epicsThreadOnceId once = EPICS_THREAD_ONCE_INIT;
static int allStarted, allReady, allRunning;
static int allEnded;      /* the IOC of these stations has ended */
static plcWake someEnded; /* a thread has ended */

/* All threads together may take so long to end, ms. */
#define STOP_MS 5000

/* Room for the log lines of hundreds of stations that connect or lose their PLCs at once;
 * EPICS's own is for a dozen. Without effect where st.cmd or the program has chosen one. */
#define ERRLOG_BYTES 65536
#define ERRLOG_MESSAGE 1024 /* a message that says what is allowed may be long */

static void initOnce(void *arg)
{
    (void)arg;
    errlogInit2(ERRLOG_BYTES, ERRLOG_MESSAGE);
    listLock = epicsMutexMustCreate();
    (void)plcWakeInit(&someEnded);
}

static void lockList(void)
{
    epicsThreadOnce(&once, initOnce, NULL);
    epicsMutexMustLock(listLock);
}

static void unlockList(void)
{
    epicsMutexUnlock(listLock);
}

plcStation *plcStationFind(const char *name)
{
    plcStation *s;

    lockList();
    s = allEnded ? NULL : (plcStation *)ellFirst(&stations);
    while (s && strcmp(s->name, name))
        s = (plcStation *)ellNext(&s->node);
    unlockList();
    return s;
}

void plcStationEach(void (*visit)(plcStation *station, void *arg), void *arg)
{
    plcStation *s;

    lockList();
    s = (plcStation *)ellFirst(&stations);
    while (s) {
        unlockList(); /* stations are not removed while anyone could visit them */
        visit(s, arg);
        lockList();
        s = (plcStation *)ellNext(&s->node);
    }
    unlockList();
}

void plcStationNames(char *text, size_t size)
{
    size_t used = 0;
    plcStation *s;

    text[0] = 0;
    lockList();
    for (s = (plcStation *)ellFirst(&stations); s && used + 1 < size;
         s = (plcStation *)ellNext(&s->node)) {
        epicsSnprintf(text + used, size - used, "%s%s", used ? " " : "", s->name);
        used = strlen(text);
    }
    if ((s || used + 1 >= size) && size > 4)
        strcpy(text + size - 4, "..."); /* that not all of them are here must be seen */
    unlockList();
}

/* Called from callback threads at the end of a pass of input records. */
PLC_HOT static void passDone(void *pvt, epicsUInt64 requested)
{
    plcStation *s = pvt;
    double ms = (epicsMonotonicGet() - requested) * 1e-6;

    epicsMutexMustLock(s->lock);
    plcStatsScan(&s->stats, ms);
    epicsMutexUnlock(s->lock);
    if (epicsAtomicGetIntT(&s->waiting))
        plcStationWake(s);
}

/* Line i goes by this transport, which makes a copy of `own`. */
static void setTransport(plcStation *s, unsigned i, const plcTransport *transport,
                         const void *own)
{
    plcTransportSetup setup = {.name = s->name,
                               .bigEndian = s->bigEndian,
                               .inSize = i < s->policy->lines ? s->inSize : 0,
                               .out = s->out,
                               .outSize = s->outSize,
                               .wake = plcStationWake,
                               .arg = s};

    if (transport->shows) {
        s->shows = 1;
        s->inFaults = setup.inFaults = setup.inSize ? plcFaultsCreate(s->inSize) : NULL;
        s->outFaults = setup.outFaults = plcFaultsCreate(s->outSize);
        s->hidden = plcFaultsCreate(s->outSize);
        s->notInBlock = callocMustSucceed(1, s->inSize + 1, "plcStationCreate");
    }
    if (transport->put)
        plcImageKeepPuts(s->out, PLC_PUTS_MAX);
    plcConnectionInit(&s->lines[i].connection);
    s->lines[i].transport = transport;
    s->lines[i].pvt = transport->create(&setup, own);
    if (transport->news)
        plcExchangeCreate(s, i);
}

static void setLine(plcStation *s, unsigned i, const plcStationConfig *config)
{
    epicsSnprintf(s->address[i], sizeof(s->address[i]), "%s", config->address[i]);
    s->plus[i] = config->plus[i];
    s->port[i] = config->port;
    setTransport(s, i, config->transport, config->transportOwn);
    if (s->policy->lines > 1)
        s->lines[i].kept = callocMustSucceed(1, s->inSize + 1, "plcStationCreate");
}

/* The thread's main function. */
static void serve(void *arg)
{
    plcStation *s = arg;

    plcStationThread(s);
    epicsEventSignal(s->ended);
    plcWakeUp(&someEnded);
}

static void startThread(plcStation *s)
{
    if (s->started)
        return;
    s->started = 1;
    if (!epicsThreadCreate(s->name, epicsThreadPriorityMedium,
                           epicsThreadGetStackSize(epicsThreadStackMedium),
                           serve, s)) {
        s->started = 0;
        errlogSevPrintf(errlogFatal, "s7plc %s: cannot start its thread\n", s->name);
    }
}

int plcStationOutputBy(plcStation *s, const char *host, int port,
                       const plcTransport *transport, const void *own, char *error, size_t size)
{
    const char *why = NULL;

    if (s->started)
        why = "comes before iocInit";
    else if (s->exchange)
        why = "the outputs of this PLC have a wire of their own already";
    else if (plcStationIsPair(s))
        why = "not for a redundant pair";
    else if (s->options.sync)
        why = "not with sync=on, whose handshake is in the blocks both ways";
    if (why) {
        epicsSnprintf(error, size, "%s", why);
        return -1;
    }
    s->outHere = !host[0];
    epicsSnprintf(s->address[1], sizeof(s->address[1]), "%s", host[0] ? host : s->address[0]);
    s->port[1] = port;
    epicsSnprintf(s->outReason, sizeof(s->outReason), "not connected yet");
    s->outLine = 1;
    setTransport(s, 1, transport, own);
    s->lineCount = 2;
    return 0;
}

/* A new IOC begins in this process (a test program, say): it knows nothing of the one before. */
static void forgetEnded(void)
{
    int ended;

    lockList();
    ended = allEnded;
    unlockList();
    if (ended)
        plcStationsDestroy();
}

plcStation *plcStationCreate(const plcStationConfig *config)
{
    plcStation *s = callocMustSucceed(1, sizeof(*s), "plcStationCreate");
    unsigned i;

    forgetEnded();
    epicsSnprintf(s->name, sizeof(s->name), "%s", config->name);
    if (plcWakeInit(&s->wake)) {
        errlogSevPrintf(errlogFatal, "s7plc %s: no pipe: %s\n", s->name, strerror(errno));
        free(s);
        return NULL;
    }
    s->inSize = config->inSize;
    s->outSize = config->outSize;
    s->bigEndian = s->order = config->bigEndian != 0;
    s->policy = config->policy ? config->policy : &plcSingle;
    s->policyPvt = config->policyPvt;
    s->in = plcImageCreate(s->inSize);
    s->out = plcImageCreate(s->outSize);
    plcImageKeepEdges(s->out, PLC_PUTS_MAX);
    s->inScan = plcScanCreate(s->inSize, passDone, s);
    s->outScan = plcScanCreate(s->outSize, NULL, NULL);
    s->statusScan = plcScanCreate(0, NULL, NULL);
    s->readback = plcReadbackCreate();
    s->atConnect = plcReadbackCreate();
    s->tracked = plcReadbackCreate();
    s->statsScan = plcScanCreate(0, NULL, NULL);
    s->owners = plcOwnersCreate();
    s->held = callocMustSucceed(1, s->inSize + 1, "plcStationCreate");
    s->lock = epicsMutexMustCreate();
    s->lists.lock = epicsMutexMustCreate();
    s->ended = epicsEventMustCreate(epicsEventEmpty);
    plcOptionsDefault(&s->options);
    s->logLevel = s->options.log;
    s->options.recvTimeout = config->recvTimeout;
    s->options.sendInterval = config->sendInterval;
    if (config->follows) {
        s->options.track = 1;
        s->options.scan = plcScanChanged;
        plcScanByRange(s->inScan, 1);
    }
    s->optionsChanged = 1;
    s->leader = s->lastLeader = s->stats.leader = -1;
    s->stats.state = config->address[0][0] ? plcStateConnecting : plcStateNoAddress;
    s->stats.stateSince = epicsMonotonicGet();
    epicsSnprintf(s->reason, sizeof(s->reason), "not connected yet");
    s->lineCount = s->policy->lines;
    for (i = 0; i < s->lineCount; i++)
        setLine(s, i, config);

    lockList();
    ellAdd(&stations, &s->node);
    s->ready = allReady;
    s->running = allRunning;
    if (allStarted)
        startThread(s);
    unlockList();
    return s;
}

void plcStationsStart(void)
{
    plcStation *s;

    forgetEnded();
    lockList();
    allStarted = 1;
    for (s = (plcStation *)ellFirst(&stations); s; s = (plcStation *)ellNext(&s->node))
        startThread(s);
    unlockList();
}

/* From now on the stations know all records, or that scans run too. */
static void reach(int running)
{
    plcStation *s;

    lockList();
    allReady = 1;
    allRunning += running;
    for (s = (plcStation *)ellFirst(&stations); s; s = (plcStation *)ellNext(&s->node)) {
        epicsAtomicSetIntT(&s->ready, 1);
        epicsAtomicSetIntT(&s->running, allRunning);
        plcStationWake(s);
    }
    unlockList();
}

void plcStationsReady(void)
{
    reach(0);
}

void plcStationsRun(void)
{
    reach(1);
}

/* Tells all threads to end. Returns their stations, to be freed, with a NULL behind. */
static plcStation **tellToStop(void)
{
    plcStation *s, **all;
    size_t count = 0;

    lockList();
    all = callocMustSucceed(ellCount(&stations) + 1, sizeof(*all), "plcStationsStop");
    for (s = (plcStation *)ellFirst(&stations); s; s = (plcStation *)ellNext(&s->node)) {
        if (!s->started)
            continue;
        s->started = 0;
        epicsAtomicSetIntT(&s->stop, 1);
        plcStationWake(s);
        all[count++] = s;
    }
    allEnded |= allStarted;
    allStarted = allReady = allRunning = 0;
    unlockList();
    return all;
}

/* Its records are gone with their IOC, and it may live on. */
static void forgetRecords(plcStation *s)
{
    unsigned i;

    epicsMutexMustLock(s->lists.lock);
    for (i = 0; i < PLC_LISTS; i++)
        ellInit(&s->lists.list[i]);
    epicsMutexUnlock(s->lists.lock);
}

void plcStationsStop(void)
{
    plcStation **all = tellToStop();
    epicsUInt64 deadline = epicsMonotonicGet() + plcMsToNs(STOP_MS);
    size_t i;

    for (i = 0; all[i]; i++) {
        if (plcWakeJoin(&someEnded, all[i]->ended, deadline) == 0)
            continue;
        errlogSevPrintf(errlogMajor,
                        "s7plc %s: its thread does not end: does it wait for a record?\n",
                        all[i]->name);
        forgetRecords(all[i]);
        lockList();
        ellDelete(&stations, &all[i]->node);
        ellAdd(&lost, &all[i]->node);
        unlockList();
    }
    free(all);
}

void plcStationsDestroy(void)
{
    plcStation *s;
    unsigned i;

    plcStationsStop();
    lockList();
    allEnded = 0;
    while ((s = (plcStation *)ellGet(&stations))) {
        if (s->listener && s->listener->gone)
            s->listener->gone(s->listenerPvt);
        if (s->policy->destroy)
            s->policy->destroy(s->policyPvt);
        for (i = 0; i < s->lineCount; i++) {
            plcConnectionClose(&s->lines[i].connection, NULL, 0);
            s->lines[i].transport->destroy(s->lines[i].pvt);
            free(s->lines[i].kept);
        }
        plcExchangeDestroy(s);
        plcFaultsDestroy(s->inFaults);
        plcFaultsDestroy(s->outFaults);
        plcFaultsDestroy(s->hidden);
        free(s->notInBlock);
        plcImageDestroy(s->in);
        plcImageDestroy(s->out);
        plcReadbackDestroy(s->readback);
        plcReadbackDestroy(s->atConnect);
        plcReadbackDestroy(s->tracked);
        plcWakeFree(&s->wake);
        epicsEventDestroy(s->ended);
        epicsMutexDestroy(s->lock);
        epicsMutexDestroy(s->lists.lock);
        free(s->held);
        plcScanDestroy(s->inScan);
        plcScanDestroy(s->outScan);
        plcScanDestroy(s->statusScan);
        plcScanDestroy(s->statsScan);
        plcOwnersDestroy(s->owners);
        plcPointersFree(s->table);
        free(s);
    }
    unlockList();
}
