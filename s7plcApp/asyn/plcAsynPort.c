/* A port: its life, connect and disconnect, report; see plcAsynPort.h. */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include <alarm.h>
#include <cantProceed.h>
#include <epicsAtomic.h>
#include <epicsExit.h>
#include <epicsStdio.h>
#include <epicsString.h>
#include <epicsTime.h>
#include <epicsVersion.h>
#include <errlog.h>
#include <initHooks.h>

#include "plcAsynPort.h"

static ELLLIST ports = ELLLIST_INIT; /* only grows; by the thread that runs st.cmd */
static epicsThreadOnceId onceId = EPICS_THREAD_ONCE_INIT;
static plcWake someEnded;     /* a thread has ended */
static plcListener listener;  /* plcAsynListener, and what a port does when its station goes */

/* All threads together may take so long to end, ms. */
#define STOP_MS 5000

/* --- asynCommon ------------------------------------------------------------------ */

/* True for the port itself, which is always connected; the PLC is device 0. */
static int isPort(asynUser *user)
{
    int addr = -1;

    return pasynManager->getAddr(user, &addr) == asynSuccess && addr < 0;
}

/* The station connects by itself; this only takes a disconnect back. */
static asynStatus commonConnect(void *pvt, asynUser *user)
{
    plcAsynPort *port = pvt;
    char reason[PLC_REASON_SIZE];

    if (isPort(user)) {
        pasynManager->exceptionConnect(user);
        return asynSuccess;
    }
    if (!port->station)
        return plcAsynFail(user, asynDisconnected, COMM_ALARM, "%s: its IOC has ended",
                           port->name);
    epicsAtomicSetIntT(&port->off, 0);
    plcWakeUp(&port->wake);
    if (plcStationConnected(port->station, reason))
        return asynSuccess;
    return plcAsynFail(user, asynDisconnected, COMM_ALARM, "%s: %s; the driver keeps trying",
                       port->name, reason);
}

/* Takes the port away from asyn; the PLC's connection stays, for all others. */
static asynStatus commonDisconnect(void *pvt, asynUser *user)
{
    plcAsynPort *port = pvt;

    if (isPort(user))
        return plcAsynFail(user, asynError, COMM_ALARM,
                           "%s: only the device at address 0 can be disconnected",
                           port->name);
    epicsAtomicSetIntT(&port->off, 1);
    plcWakeUp(&port->wake);
    return asynSuccess;
}

static void reportPlace(FILE *file, const plcAsynPlace *place)
{
    int i;

    fprintf(file, "    \"%s\"%s", place->text, place->output ? "" : " (in)");
    for (i = 0; i < plcAsynFaces; i++)
        if (place->views[i])
            fprintf(file, " %s%s", plcAsynFaceName((plcAsynFace)i),
                    place->views[i]->refused ? " REFUSED" : "");
    fprintf(file, ", %d called back\n", ellCount(&place->users));
}

static void commonReport(void *pvt, FILE *file, int details)
{
    plcAsynPort *port = pvt;
    epicsUInt64 passes, callbacks, coalesced;
    char reason[PLC_REASON_SIZE];
    int places, users;
    ELLNODE *node;

    if (!port->station) {
        fprintf(file, "    its IOC has ended\n");
        return;
    }
    epicsMutexMustLock(port->arrived);
    coalesced = port->coalesced;
    epicsMutexUnlock(port->arrived);
    epicsMutexMustLock(port->lock);
    passes = port->passes;
    callbacks = port->callbacks;
    places = ellCount(&port->places);
    users = ellCount(&port->users);
    epicsMutexUnlock(port->lock);
    plcStationConnected(port->station, reason);
    fprintf(file, "    PLC %s: %s%s%s\n", plcStationName(port->station),
            epicsAtomicGetIntT(&port->off) ? "disconnected by a user; " : "",
            reason[0] ? "not connected: " : "connected", reason);
    if (details < 1)
        return;
    fprintf(file,
            "    %d places, %d with callbacks; %llu callbacks in %llu passes; "
            "%llu blocks were replaced by a newer one; %u traces dropped\n",
            places, users, (unsigned long long)callbacks, (unsigned long long)passes,
            (unsigned long long)coalesced, plcAsynTraceDropped(port->trace));
    plcStationReport(port->station, file, details - 1);
    if (details < 2)
        return;
    /* The list only grows at its end: it may be walked without the lock. */
    epicsMutexMustLock(port->lock);
    for (node = ellFirst(&port->places); node; node = ellNext(node))
        reportPlace(file, CONTAINER(node, plcAsynPlace, node));
    epicsMutexUnlock(port->lock);
}

static asynCommon commonMethods = {commonReport, commonConnect, commonDisconnect};

static void gone(void *pvt);

/* --- Life ------------------------------------------------------------------------ */

static void initOnce(void *arg)
{
    (void)arg;
    (void)plcWakeInit(&someEnded);
    listener = plcAsynListener;
    listener.gone = gone;
}

static void serve(void *arg)
{
    plcAsynPort *port = arg;

    plcAsynThread(port);
    epicsEventSignal(port->ended);
    plcWakeUp(&someEnded);
}

static void startPort(plcAsynPort *port)
{
    if (!port->station || port->thread)
        return;
    epicsAtomicSetIntT(&port->stop, 0);
    epicsAtomicSetIntT(&port->running, 0);
    port->thread = epicsThreadCreate(port->name, epicsThreadPriorityMedium,
                                     epicsThreadGetStackSize(epicsThreadStackMedium),
                                     serve, port);
    if (!port->thread)
        errlogSevPrintf(errlogFatal, "s7plcAsyn %s: cannot start its thread\n", port->name);
    plcAsynTraceStart(port->trace);
}

static void stopAll(void)
{
    epicsUInt64 deadline = epicsMonotonicGet() + STOP_MS * 1000000ull;
    ELLNODE *node;

    for (node = ellFirst(&ports); node; node = ellNext(node)) {
        plcAsynPort *port = CONTAINER(node, plcAsynPort, node);

        epicsAtomicSetIntT(&port->stop, 1);
        plcWakeUp(&port->wake);
        plcWakeUp(&port->through);
        epicsEventSignal(port->drained);
    }
    for (node = ellFirst(&ports); node; node = ellNext(node)) {
        plcAsynPort *port = CONTAINER(node, plcAsynPort, node);

        if (!port->thread)
            continue;
        if (plcWakeJoin(&someEnded, port->ended, deadline))
            errlogSevPrintf(errlogMajor,
                            "s7plcAsyn %s: its thread does not end: does it wait for a "
                            "record?\n",
                            port->name);
        else
            port->thread = NULL;
        plcAsynTraceStop(port->trace, &someEnded, deadline);
    }
}

/* The end comes while there still are records; see drvS7plc.c. */
#if EPICS_VERSION_INT >= VERSION_INT(7, 0, 4, 0)
#define HAVE_SHUTDOWN_HOOK
#else
static void stop(void *arg)
{
    (void)arg;
    stopAll();
}
#endif

static void hook(initHookState state)
{
    ELLNODE *node;

#ifdef HAVE_SHUTDOWN_HOOK
    if (state == initHookAtShutdown)
        stopAll();
#else
    if (state == initHookAfterInitDatabase)
        epicsAtExit(stop, NULL);
#endif
    if (state != initHookAfterIocRunning && state != initHookAtIocPause)
        return;
    for (node = ellFirst(&ports); node; node = ellNext(node)) {
        plcAsynPort *port = CONTAINER(node, plcAsynPort, node);

        epicsAtomicSetIntT(&port->paused, state == initHookAtIocPause);
        if (state == initHookAfterIocRunning)
            epicsAtomicSetIntT(&port->running, 1);
        plcWakeUp(&port->wake);
    }
}

void plcAsynPortsBegin(void)
{
    ELLNODE *node;

    initHookRegister(hook); /* each IOC anew: an ended one has dropped its hooks */
    plcAsynFirstBegin();
    for (node = ellFirst(&ports); node; node = ellNext(node))
        startPort(CONTAINER(node, plcAsynPort, node));
}

void plcAsynPortsReport(FILE *file)
{
    ELLNODE *node;

    for (node = ellFirst(&ports); node; node = ellNext(node)) {
        plcAsynPort *port = CONTAINER(node, plcAsynPort, node);

        fprintf(file, "  %s: PLC %s\n", port->name,
                port->station ? plcStationName(port->station) : "none, its IOC has ended");
    }
}

/* Registers name and interfaces with asyn, and connects us to the port. */
static int registerPort(plcAsynPort *port)
{
    char traceName[80];

    /* Without a descriptor nobody could be told. */
    port->blocks = plcStationAcknowledges(port->station) && plcWakeDescriptor(&port->through) >= 0;
    if (pasynManager->registerPort(port->name,
                                   ASYN_MULTIDEVICE | (port->blocks ? ASYN_CANBLOCK : 0), 1,
                                   0, 0) != asynSuccess)
        return -1;
    port->known = 1;
    port->common.interfaceType = asynCommonType;
    port->common.pinterface = &commonMethods;
    port->common.drvPvt = port;
    if (pasynManager->registerInterface(port->name, &port->common) != asynSuccess ||
        plcAsynDrvUserRegister(port) || plcAsynIoRegister(port))
        return -1;
    port->user = pasynManager->createAsynUser(NULL, NULL);
    if (pasynManager->connectDevice(port->user, port->name, 0) != asynSuccess)
        return -1;
    epicsSnprintf(traceName, sizeof(traceName), "%s trace", port->name);
    port->trace = plcAsynTraceCreate(port->user, traceName);
    return 0;
}

/* For the blocks of its station. */
static void makeBuffers(plcAsynPort *port)
{
    size_t in = plcStationInSize(port->station), out = plcStationOutSize(port->station);

    port->newest = callocMustSucceed(1, in + 1, "plcAsynPort");
    port->block = callocMustSucceed(1, in + 1, "plcAsynPort");
    port->before = callocMustSucceed(1, in + 1, "plcAsynPort");
    port->scratch = callocMustSucceed(1, (in > out ? in : out) + 1, "plcAsynPort");
}

static void freeBuffers(plcAsynPort *port)
{
    free(port->newest);
    free(port->block);
    free(port->before);
    free(port->scratch);
    port->newest = port->block = port->before = port->scratch = NULL;
}

/* asyn knows the port for good; it serves another PLC when a later IOC makes it again. */
static void gone(void *pvt)
{
    plcAsynPort *port = pvt;
    ELLNODE *node;

    if (port->thread) { /* it did not end */
        errlogSevPrintf(errlogFatal, "s7plcAsyn %s: cannot be used again\n", port->name);
        return;
    }
    epicsMutexMustLock(port->lock);
    plcAsynForgetUsers(port);
    while ((node = ellGet(&port->places))) {
        CONTAINER(node, plcAsynPlace, node)->station = NULL;
        ellAdd(&port->formerPlaces, node);
    }
    port->station = NULL;
    freeBuffers(port);
    port->fresh = port->lost = port->dropped = port->good = 0;
    plcAsynFirstAtMost(0);
    epicsMutexUnlock(port->lock);
}

/* What is wrong with the arguments, in words; or NULL. */
static const char *refuse(const char *name, plcStation *station)
{
    const char *c;
    ELLNODE *node;

    for (c = name; *c; c++)
        if (isspace((unsigned char)*c) || strchr(",()", *c))
            return "a port name has no blanks, commas or brackets";
    if (!*name)
        return "the name of the port is missing";
    for (node = ellFirst(&ports); node; node = ellNext(node)) {
        plcAsynPort *port = CONTAINER(node, plcAsynPort, node);

        if (port->station == station)
            return "this PLC has an asyn port already; a second one would show the same";
        if (port->station && strcmp(port->name, name) == 0)
            return "asyn does not take this port name; is it in use?";
    }
    return NULL;
}

/* One of an IOC that has ended, or a new one. */
static plcAsynPort *findPort(const char *name)
{
    plcAsynPort *port;
    ELLNODE *node;

    for (node = ellFirst(&ports); node; node = ellNext(node))
        if (strcmp(CONTAINER(node, plcAsynPort, node)->name, name) == 0)
            return CONTAINER(node, plcAsynPort, node);
    port = callocMustSucceed(1, sizeof(*port), "plcAsynPortCreate");
    port->name = epicsStrDup(name);
    port->lock = epicsMutexMustCreate();
    port->arrived = epicsMutexMustCreate();
    port->ended = epicsEventMustCreate(epicsEventEmpty);
    port->drained = epicsEventMustCreate(epicsEventEmpty);
    if (plcWakeInit(&port->wake) || plcWakeInit(&port->released) ||
        plcWakeInit(&port->through))
        errlogSevPrintf(errlogFatal, "s7plcAsyn %s: too many open files in IOC\n", name);
    return port;
}

static void freePort(plcAsynPort *port)
{
    freeBuffers(port);
    plcWakeFree(&port->wake);
    plcWakeFree(&port->released);
    plcWakeFree(&port->through);
    epicsEventDestroy(port->ended);
    epicsEventDestroy(port->drained);
    epicsMutexDestroy(port->lock);
    epicsMutexDestroy(port->arrived);
    free(port->name);
    free(port);
}

/* Binds station and port to each other. Returns NULL, or what is wrong in words: then the port
 * is freed, unless asyn knows it. */
static const char *bindPort(plcAsynPort *port, plcStation *station)
{
    const char *error = NULL;
    int isNew = !port->trace;

    port->station = station;
    makeBuffers(port);
    if (plcStationListen(station, &listener, port)) {
        error = "comes before iocInit";
    } else if (isNew && registerPort(port)) {
        plcStationListen(station, NULL, NULL);
        error = "asyn does not take this port name; is it in use?";
    } else if (isNew) {
        ellAdd(&ports, &port->node);
    }
    if (!error)
        return NULL;
    freeBuffers(port);
    port->station = NULL;
    if (!port->known)
        freePort(port);
    return error;
}

int plcAsynPortCreate(const char *name, const char *stationName, double initialWait)
{
    plcStation *station = plcStationFind(stationName);
    char names[400];
    const char *error;

    epicsThreadOnce(&onceId, initOnce, NULL);
    if (!station) {
        plcStationNames(names, sizeof(names));
        errlogSevPrintf(errlogMajor,
                        "drvAsynS7plcConfigure %s: no PLC \"%s\"; configured: %s\n", name,
                        stationName, names[0] ? names : "none (s7plcConfigure first)");
        return -1;
    }
    if (plcStationByName(station)) {
        errlogSevPrintf(errlogMajor,
                        "drvAsynS7plcConfigure %s %s: a PLC by %s has tags, no offsets; allowed: "
                        "PLCs with blocks, pairs, Modbus\n",
                        name, stationName, plcStationByName(station));
        return -1;
    }
    error = refuse(name, station);
    if (!error)
        error = bindPort(findPort(name), station);
    if (error) {
        errlogSevPrintf(errlogMajor, "drvAsynS7plcConfigure %s %s: %s\n", name,
                        stationName, error);
        return -1;
    }
    if (initialWait > 0)
        plcAsynFirstAtMost(initialWait);
    return 0;
}
