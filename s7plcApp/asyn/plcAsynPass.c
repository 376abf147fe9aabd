/* Callbacks of a port: the thread that tells each block to those who registered.
 *
 * Device support of asyn queues a callback for each record, and its queue has an end. So
 * a pass goes in portions, and waits behind each until the callback queues have worked it
 * off. Blocks that come meanwhile replace each other: records get the newest.
 */
#include <stdlib.h>
#include <string.h>

#include <alarm.h>
#include <cantProceed.h>
#include <epicsAtomic.h>
#include <epicsTime.h>

#include "plcAsynPort.h"

#define PORTION 300     /* callbacks before the queues are looked at */
#define CANCEL_NS 1000000000u /* see plcAsynLeave */
#define NEVER PLC_WAKE_NEVER
#define SETTLE_NS 100000000u    /* see isSettled */
#define PATIENCE_NS 1000000000u /* beyond sendInterval, until the PLC shows a write */

/* --- In the station's thread: word is left, the port's thread woken -------------- */

static void received(void *pvt, const void *block)
{
    plcAsynPort *port = pvt;

    plcAsynTraceBytes(port->trace, ASYN_TRACEIO_DRIVER, block,
                      plcImageSize(plcStationInput(port->station)), "in");
}

static void delivered(void *pvt, const void *block, const epicsTimeStamp *stamp)
{
    plcAsynPort *port = pvt;
    int running = epicsAtomicGetIntT(&port->running);

    epicsMutexMustLock(port->arrived);
    memcpy(port->newest, block, plcImageSize(plcStationInput(port->station)));
    port->newestStamp = *stamp;
    port->coalesced += running && port->fresh;
    port->fresh = 1;
    epicsMutexUnlock(port->arrived);
    if (!running)
        plcAsynFirst();
    plcWakeUp(&port->wake);
}

static void sent(void *pvt, const void *block)
{
    plcAsynPort *port = pvt;

    plcAsynTraceBytes(port->trace, ASYN_TRACEIO_DRIVER, block,
                      plcImageSize(plcStationOutput(port->station)), "out");
    plcWakeUp(&port->wake); /* other records may have changed the output image */
}

static void through(void *pvt)
{
    plcAsynPort *port = pvt;

    plcWakeUp(&port->through);
}

static void changed(void *pvt)
{
    plcAsynPort *port = pvt;
    char reason[PLC_REASON_SIZE];
    int connected = plcStationConnected(port->station, NULL);

    plcImageReason(plcStationInput(port->station), reason);
    epicsMutexMustLock(port->arrived);
    if (reason[0]) {
        port->lost = 1;
        port->fresh = 0;
    }
    if (!connected)
        port->dropped = 1;
    epicsMutexUnlock(port->arrived);
    plcWakeUp(&port->wake);
}

const plcListener plcAsynListener = {.received = received,
                                     .delivered = delivered,
                                     .sent = sent,
                                     .through = through,
                                     .changed = changed};

/* --- Who is called back ---------------------------------------------------------- */

static void makeMask(plcAsynUser *u, epicsUInt32 mask)
{
    const plcAsynView *view = u->view;

    if (view->bit >= 0)
        memcpy(u->maskBytes, view->mask, sizeof(u->maskBytes));
    else if (mask != 0xFFFFFFFFu)
        plcPutInt(view->type, u->maskBytes, view->order, (epicsInt64)mask);
    else
        return;
    u->mask = u->maskBytes;
}

asynStatus plcAsynJoin(plcAsynPort *port, asynUser *user, plcAsynFace face,
                       epicsUInt32 mask, plcAsynCallback callback, void *userPvt,
                       void **registrar)
{
    plcAsynView *view = plcAsynViewOf(port, user, face);
    plcAsynUser *u;

    *registrar = NULL;
    if (!view)
        return asynError;
    if (view->open && view->place->output)
        return plcAsynFail(user, asynError, LINK_ALARM,
                           "%s \"%s\": L= (length) is needed for callbacks", port->name,
                           view->place->text);
    u = callocMustSucceed(1, sizeof(*u), "plcAsynJoin");
    u->port = port;
    u->view = view;
    u->user = user;
    u->own = pasynManager->duplicateAsynUser(user, NULL, NULL);
    u->callback = callback;
    u->userPvt = userPvt;
    makeMask(u, mask);
    if (epicsAtomicGetIntT(&port->running))
        u->joined = epicsMonotonicGet();
    if (view->place->output) {
        u->value = callocMustSucceed(2, view->length + 1, "plcAsynJoin");
        u->shown = u->value + view->length + 1;
    }
    *registrar = u;
    epicsMutexMustLock(port->lock);
    ellAdd(&port->users, &u->node);
    ellAdd(&view->place->users, &u->atPlace);
    epicsMutexUnlock(port->lock);
    plcWakeUp(&port->wake);
    return asynSuccess;
}

static void freeUser(plcAsynUser *u)
{
    pasynManager->freeAsynUser(u->own);
    free(u->value);
    free(u);
}

void plcAsynForgetUsers(plcAsynPort *port)
{
    ELLNODE *node;

    while ((node = ellGet(&port->users))) {
        plcAsynUser *u = CONTAINER(node, plcAsynUser, node);

        ellDelete(&u->view->place->users, &u->atPlace);
        freeUser(u);
    }
}

/* When its callback runs just now: waits until it has returned. Not for ever: the
 * callback may itself wait for a record that our caller has locked. */
asynStatus plcAsynLeave(plcAsynPort *port, asynUser *user, void *registrar)
{
    epicsUInt64 until = epicsMonotonicGet() + CANCEL_NS;
    plcAsynUser *u = registrar;
    int busy;

    if (!u)
        return plcAsynFail(user, asynError, LINK_ALARM, "%s: not registered", port->name);
    epicsMutexMustLock(port->lock);
    if (port->next == u)
        port->next = (plcAsynUser *)ellNext(&u->node);
    ellDelete(&port->users, &u->node);
    ellDelete(&u->view->place->users, &u->atPlace);
    busy = port->called == u;
    u->gone = busy;
    epicsMutexUnlock(port->lock);
    if (!busy)
        freeUser(u);
    while (busy && epicsThreadGetIdSelf() != port->thread) {
        if (!plcWakeWait(&port->released, until))
            break;
        epicsMutexMustLock(port->lock);
        busy = port->called == u;
        epicsMutexUnlock(port->lock);
    }
    return asynSuccess;
}

/* --- Writes of those who are called back ----------------------------------------- */

#define USER_AT_PLACE(NODE) CONTAINER(NODE, plcAsynUser, atPlace)

void plcAsynWriteBegins(plcAsynPort *port, plcAsynView *view, asynUser *user)
{
    ELLNODE *node;

    epicsMutexMustLock(port->lock);
    for (node = ellFirst(&view->place->users); node; node = ellNext(node))
        if (USER_AT_PLACE(node)->user == user)
            USER_AT_PLACE(node)->writing = 1;
    epicsMutexUnlock(port->lock);
}

/* It shows what it wrote. */
static void wrote(plcAsynUser *u, const epicsUInt8 *bytes, const epicsUInt8 *mask,
                  size_t length, epicsUInt64 olderUntil)
{
    size_t i;

    for (i = 0; i < length && i < u->view->length; i++)
        u->value[i] = (epicsUInt8)(mask ? (u->value[i] & ~mask[i]) | (bytes[i] & mask[i])
                                        : bytes[i]);
    u->told = 1;
    u->olderUntil = olderUntil;
}

void plcAsynWriteEnds(plcAsynPort *port, plcAsynView *view, asynUser *user,
                      const epicsUInt8 *bytes, const epicsUInt8 *mask, size_t length,
                      int outcome)
{
    epicsUInt64 olderUntil = 0;
    plcOptions options;
    ELLNODE *node;
    int wake = 0;

    if (view->follows) {
        plcStationGetOptions(port->station, &options);
        olderUntil =
            epicsMonotonicGet() + PATIENCE_NS + (epicsUInt64)(options.sendInterval * 1e6);
    }
    epicsMutexMustLock(port->lock);
    for (node = ellFirst(&view->place->users); node; node = ellNext(node)) {
        plcAsynUser *u = USER_AT_PLACE(node);

        wake = 1;
        if (u->user != user)
            continue;
        u->writing = 0;
        u->refused = outcome < 0;
        u->away = outcome > 0;
        if (outcome >= 0)
            wrote(u, bytes, mask, length, olderUntil);
    }
    epicsMutexUnlock(port->lock);
    if (wake)
        plcWakeUp(&port->wake);
}

/* --- A pass ---------------------------------------------------------------------- */

/* What a pass knows when it begins. */
typedef struct pass {
    plcAsynPort *port;
    int isBlock;  /* there is a new block */
    int compares; /* with scan=changed */
    int tracks;   /* outputs follow the PLC from block to block */
    int connected;
    int leaves; /* what is written leaves */
    int taken;  /* the output image holds the PLC's values */
    epicsUInt64 now;
} pass;

static int sameBytes(const epicsUInt8 *a, const epicsUInt8 *b, const epicsUInt8 *mask,
                     size_t length)
{
    size_t i;

    if (!mask)
        return memcmp(a, b, length) == 0;
    for (i = 0; i < length; i++)
        if ((a[i] ^ b[i]) & mask[i])
            return 0;
    return 1;
}

static int isZero(const epicsUInt8 *bytes, size_t length)
{
    size_t i;

    for (i = 0; i < length; i++)
        if (bytes[i])
            return 0;
    return 1;
}

static void setStatus(plcAsynUser *u, asynStatus status, int alarm, epicsTimeStamp stamp)
{
    u->own->auxStatus = status;
    u->own->alarmStatus = alarm;
    u->own->alarmSeverity = alarm ? INVALID_ALARM : NO_ALARM;
    u->own->timestamp = stamp;
}

/* A record whose SCAN becomes I/O Intr registers before Base has it in a scan list. A
 * callback in between would leave a value in its queue, and all later ones would come one
 * too late. So one who joins a running IOC is told a moment later. */
static int isSettled(const pass *p, plcAsynUser *u)
{
    if (!u->joined)
        return 1;
    if (p->now >= u->joined + SETTLE_NS) {
        u->joined = 0;
        return 1;
    }
    if (u->joined + SETTLE_NS < p->port->look)
        p->port->look = u->joined + SETTLE_NS;
    return 0;
}

/* The PLC did not give or take it: 1, or 0. *news is 1 when that was not told yet. */
static int isFaulty(plcAsynUser *u, int *news)
{
    const plcAsynView *view = u->view;
    char reason[PLC_REASON_SIZE];
    int faulty = view->faults &&
                 plcFaultsFind(view->faults, view->offset, view->length, u->mask, reason);

    *news = faulty != u->faulty;
    u->faulty = faulty;
    return faulty;
}

/* The bytes an input has to be told, or NULL. */
static const void *inputNews(const pass *p, plcAsynUser *u)
{
    plcAsynPort *port = p->port;
    const char *bytes = port->block + u->view->offset;
    char wrong[PLC_WRONG_SIZE];
    epicsTimeStamp now;
    int faulty, news;

    if (!port->good) {
        if (!u->told)
            return NULL;
        u->told = 0;
        epicsTimeGetCurrent(&now);
        setStatus(u, port->badStatus, COMM_ALARM, now);
        return bytes; /* the last ones: nobody shall use them */
    }
    faulty = isFaulty(u, &news);
    if (u->told && !news && !p->isBlock)
        return NULL;
    if (u->told && !news && p->compares &&
        sameBytes((const epicsUInt8 *)bytes,
                  (const epicsUInt8 *)port->before + u->view->offset, u->mask,
                  u->view->length))
        return NULL;
    u->told = 1;
    faulty |= plcAsynIsWrong(u->view, bytes, wrong);
    setStatus(u, faulty ? asynError : asynSuccess, faulty ? READ_ALARM : NO_ALARM,
              port->stamp);
    return bytes;
}

/* What the PLC shows, or the image holds, is new to this output. */
static int isNews(const pass *p, plcAsynUser *u, const epicsUInt8 *bytes, int shownByPlc)
{
    size_t length = u->view->length;
    int same = u->told && sameBytes(bytes, u->value, u->mask, length);

    if (!u->told)
        return shownByPlc || (u->view->follows && p->taken) || !isZero(bytes, length);
    if (!shownByPlc)
        return !same;
    if (same)
        u->olderUntil = 0; /* it has arrived */
    if (same || sameBytes(bytes, u->shown, u->mask, length)) {
        memcpy(u->shown, bytes, length);
        return 0;
    }
    if (p->now < u->olderUntil && u->olderUntil < p->port->look)
        p->port->look = u->olderUntil;
    return p->now >= u->olderUntil;
}

/* The bytes an output has to be told, or NULL. */
static const void *outputNews(const pass *p, plcAsynUser *u)
{
    plcAsynPort *port = p->port;
    const plcAsynView *view = u->view;
    epicsUInt8 *bytes = (epicsUInt8 *)port->scratch;
    int shownByPlc = view->hasReadback && !(p->tracks && p->taken);
    int back = u->away && p->leaves && (p->taken || !view->follows);
    char reason[PLC_REASON_SIZE], wrong[PLC_WRONG_SIZE];
    int faulty, news, alarm;
    epicsTimeStamp stamp;

    if (u->writing || (shownByPlc && !port->good))
        return NULL;
    if (!u->told && !shownByPlc && view->follows &&
        plcStationHides(port->station, view->offset, view->length, u->mask, reason))
        return NULL; /* nobody knows what the PLC holds */
    epicsTimeGetCurrent(&stamp);
    if (shownByPlc) {
        memcpy(bytes, port->block + view->readback, view->length);
        stamp = port->stamp;
    } else {
        plcImagePeek(plcStationOutput(port->station), view->offset, view->length, bytes);
    }
    faulty = isFaulty(u, &news);
    alarm = u->refused || faulty ? WRITE_ALARM : NO_ALARM;
    if (!isNews(p, u, bytes, shownByPlc) && !((u->refused || back || news) && u->told)) {
        u->refused = 0; /* there is no value to go back to */
        return NULL;
    }
    if (!alarm && plcAsynIsWrong(view, bytes, wrong))
        alarm = READ_ALARM;
    if (u->away && !back)
        alarm = COMM_ALARM;
    u->away = u->away && !back;
    u->refused = 0;
    u->told = 1;
    memcpy(u->value, bytes, view->length);
    memcpy(u->shown, bytes, view->length);
    setStatus(u, asynSuccess, alarm, stamp);
    return bytes;
}

/* Calls the next one back who has to be told something. Returns 0 when there is none. */
static int callNext(const pass *p)
{
    plcAsynPort *port = p->port;
    const void *bytes = NULL;
    plcAsynUser *u;
    int gone;

    epicsMutexMustLock(port->lock);
    while (!bytes && (u = port->next)) {
        port->next = (plcAsynUser *)ellNext(&u->node);
        if (isSettled(p, u))
            bytes = u->view->place->output ? outputNews(p, u) : inputNews(p, u);
    }
    port->called = bytes ? u : NULL;
    port->callbacks += bytes != NULL;
    epicsMutexUnlock(port->lock);
    if (!bytes)
        return 0;
    u->port->call(u, bytes);
    epicsMutexMustLock(port->lock);
    port->called = NULL;
    gone = u->gone;
    epicsMutexUnlock(port->lock);
    if (gone) {
        freeUser(u);
        plcWakeUp(&port->released);
    }
    return 1;
}

/* --- Flow control ---------------------------------------------------------------- */

/* In a callback thread: all that was queued before has been taken. */
static void marked(epicsCallback *mark)
{
    plcAsynPort *port;

    callbackGetUser(port, mark);
    if (epicsAtomicDecrIntT(&port->marksLeft) == 0)
        epicsEventSignal(port->drained);
}

/* Waits until the callback threads have come to what we have queued. */
static void drain(plcAsynPort *port)
{
    int i;

    epicsAtomicSetIntT(&port->marksLeft, NUM_CALLBACK_PRIORITIES);
    for (i = 0; i < NUM_CALLBACK_PRIORITIES; i++)
        if (callbackRequest(&port->marks[i])) /* its queue is full: no need to mark it */
            marked(&port->marks[i]);
    while (epicsAtomicGetIntT(&port->marksLeft) > 0 && !epicsAtomicGetIntT(&port->stop))
        epicsEventMustWait(port->drained);
}

static void runPass(const pass *p)
{
    plcAsynPort *port = p->port;
    unsigned calls = 0;

    epicsMutexMustLock(port->lock);
    port->next = (plcAsynUser *)ellFirst(&port->users);
    port->passes++;
    epicsMutexUnlock(port->lock);
    while (!epicsAtomicGetIntT(&port->stop) && callNext(p))
        if (++calls % PORTION == 0)
            drain(port);
    if (calls % PORTION)
        drain(port);
    if (calls)
        plcAsynTraceLine(port->trace, ASYN_TRACE_FLOW, "%s %u callbacks for %s",
                         port->name, calls,
                         !port->good  ? "the loss of data"
                         : p->isBlock ? "a block"
                                      : "outputs");
}

/* --- Connection ------------------------------------------------------------------ */

/* Tells asyn whether device 0 is connected. Only this thread does, so that no two
 * exceptions overtake each other. */
static void announce(plcAsynPort *port, int connected, const char *reason)
{
    if (connected == port->announced)
        return;
    port->announced = connected;
    if (connected) {
        plcAsynTraceLine(port->trace, ASYN_TRACE_FLOW, "%s connected", port->name);
        pasynManager->exceptionConnect(port->user);
    } else {
        plcAsynTraceLine(port->trace, ASYN_TRACE_FLOW, "%s disconnected: %s", port->name,
                         reason);
        pasynManager->exceptionDisconnect(port->user);
    }
}

/* --- The thread ------------------------------------------------------------------ */

/* Fetches what the station has left. Returns 1 when data was lost in between. */
static int fetch(pass *p, int *dropped)
{
    plcAsynPort *port = p->port;
    char *block;
    int lost;

    epicsMutexMustLock(port->arrived);
    lost = port->lost;
    *dropped = port->dropped;
    port->lost = port->dropped = 0;
    p->isBlock = port->fresh;
    if (port->fresh) {
        port->fresh = 0;
        block = port->before;
        port->before = port->block;
        port->block = port->newest;
        port->newest = block;
        port->stamp = port->newestStamp;
    }
    epicsMutexUnlock(port->arrived);
    return lost;
}

static void once(plcAsynPort *port)
{
    int off = epicsAtomicGetIntT(&port->off), lost, dropped;
    char reason[PLC_REASON_SIZE];
    plcOptions options;
    pass p = {.port = port};

    p.connected = plcStationConnected(port->station, reason);
    p.leaves = plcStationOutputConnected(port->station, NULL) &&
               !plcStationHeld(port->station);
    lost = fetch(&p, &dropped);
    if (dropped || off || !p.connected)
        announce(port, 0, off ? "by a user" : reason);
    announce(port, p.connected && !off, reason);
    p.taken = plcStationTaken(port->station);
    p.now = epicsMonotonicGet();
    port->look = NEVER;
    plcStationGetOptions(port->station, &options);
    p.compares = options.scan == plcScanChanged;
    p.tracks = options.track || options.sync;
    if (port->good && (lost || off)) {
        int isBlock = p.isBlock;

        p.isBlock = port->good = 0;
        port->badStatus = p.connected && !off ? asynTimeout : asynDisconnected;
        runPass(&p);
        p.isBlock = isBlock;
    }
    if (p.isBlock && !off)
        port->good = 1;
    runPass(&p);
}

void plcAsynThread(plcAsynPort *port)
{
    int i;

    for (i = 0; i < NUM_CALLBACK_PRIORITIES; i++) {
        callbackSetCallback(marked, &port->marks[i]);
        callbackSetPriority(i, &port->marks[i]);
        callbackSetUser(port, &port->marks[i]);
    }
    port->look = NEVER;
    for (;;) {
        /* word from the station, or an output has been patient enough */
        plcWakeWait(&port->wake, port->look);
        if (epicsAtomicGetIntT(&port->stop))
            break;
        if (epicsAtomicGetIntT(&port->paused))
            port->look = NEVER; /* the end of the pause wakes us */
        else if (epicsAtomicGetIntT(&port->running))
            once(port);
    }
}
