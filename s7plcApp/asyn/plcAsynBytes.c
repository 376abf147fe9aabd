/* The bytes of a place for a caller: out of the input image, or into the output image; in the
 * thread of the caller. Knows no interface.
 *
 * Both wait during iocInit, for the first block, and where the wire acknowledges puts a write
 * waits for the answer. */
#include <alarm.h>
#include <epicsAtomic.h>
#include <epicsStdio.h>

#include "plcAsynPort.h"

static void clearAlarm(asynUser *user)
{
    user->alarmStatus = user->alarmSeverity = 0;
    user->auxStatus = asynSuccess;
}

/* --- Reading --------------------------------------------------------------------- */

/* There is no valid data: why. */
static asynStatus noData(plcAsynPort *port, asynUser *user)
{
    char reason[PLC_REASON_SIZE];
    int connected = plcStationConnected(port->station, NULL);

    plcImageReason(plcStationInput(port->station), reason);
    return plcAsynFail(user, connected ? asynTimeout : asynDisconnected, COMM_ALARM,
                       "%s: %s", port->name, reason);
}

static asynStatus readInput(plcAsynPort *port, asynUser *user, size_t offset,
                            size_t length, void *bytes)
{
    plcFaults *faults = plcStationInFaults(port->station);
    char reason[PLC_REASON_SIZE];

    if (plcImageRead(plcStationInput(port->station), offset, length, bytes,
                     &user->timestamp))
        return noData(port, user);
    if (faults && plcFaultsFind(faults, offset, length, NULL, reason))
        return plcAsynFail(user, asynError, READ_ALARM, "%s: %s", port->name, reason);
    return asynSuccess;
}

static int isZero(const char *bytes, size_t length)
{
    size_t i;

    for (i = 0; i < length; i++)
        if (bytes[i])
            return 0;
    return 1;
}

/* What an output holds: where the PLC shows it, the value that the PLC shows; else what
 * was written. Zeros that nobody has written are no value. */
static asynStatus readOutput(plcAsynPort *port, asynUser *user, const plcAsynView *view,
                             size_t length, void *bytes)
{
    plcImage *out = plcStationOutput(port->station);
    int taken = plcStationTaken(port->station);
    char reason[PLC_REASON_SIZE];
    plcOptions options;

    plcStationGetOptions(port->station, &options);
    if (view->hasReadback && !((options.track || options.sync) && taken))
        return readInput(port, user, view->readback, length, bytes);
    plcImagePeek(out, view->offset, length, bytes);
    epicsTimeGetCurrent(&user->timestamp);
    if (view->follows && isZero(bytes, length) &&
        plcStationHides(port->station, view->offset, length, NULL, reason))
        return plcAsynFail(user, asynError, READ_ALARM, "%s: %s", port->name, reason);
    if (!(view->follows && taken) && isZero(bytes, length))
        return plcAsynFail(user, asynError, UDF_ALARM, "%s: not written yet", port->name);
    return asynSuccess;
}

asynStatus plcAsynRead(plcAsynPort *port, asynUser *user, const plcAsynView *view,
                            size_t length, void *bytes)
{
    char wrong[PLC_WRONG_SIZE];
    asynStatus status;

    clearAlarm(user);
    asynPrint(user, ASYN_TRACE_FLOW, "%s read %s \"%s\"\n", port->name,
              plcAsynFaceName(view->face), view->place->text);
    if (epicsAtomicGetIntT(&port->off))
        return plcAsynFail(user, asynDisconnected, COMM_ALARM,
                           "%s: disconnected by a user", port->name);
    if (view->place->output) {
        plcAsynWaitFirst(port, view);
        status = readOutput(port, user, view, length, bytes);
    } else {
        status = readInput(port, user, view->offset, length, bytes);
    }
    if (status == asynSuccess && plcAsynIsWrong(view, bytes, wrong))
        return plcAsynFail(user, asynError, READ_ALARM, "%s: %s", port->name, wrong);
    return status;
}

/* --- Writing --------------------------------------------------------------------- */

/* Until the PLC has taken or refused the put, or is lost. asyn's thread of the port, or who
 * has locked the port: one at a time. */
static void waitThrough(plcAsynPort *port, const plcPutMark *mark)
{
    plcStation *station = port->station;

    while (!plcStationThrough(station, mark) && !epicsAtomicGetIntT(&port->stop))
        plcWakeWait(&port->through, PLC_WAKE_NEVER);
}

asynStatus plcAsynWrite(plcAsynPort *port, asynUser *user, plcAsynView *view,
                             size_t length, const epicsUInt8 *bytes,
                             const epicsUInt8 *mask)
{
    char reason[PLC_REASON_SIZE];
    plcPutMark put;
    int status;

    asynPrintIO(user, ASYN_TRACE_FLOW, (const char *)bytes, length,
                "%s write %s \"%s\"\n", port->name, plcAsynFaceName(view->face),
                view->place->text);
    if (epicsAtomicGetIntT(&port->off))
        return plcAsynFail(user, asynDisconnected, COMM_ALARM,
                           "%s: disconnected by a user", port->name);
    plcAsynWriteBegins(port, view, user);
    status = plcStationPut(port->station, view->offset, length, bytes, mask, reason,
                           view->follows, &put);
    plcAsynWriteEnds(port, view, user, bytes, mask, length,
                     status      ? -1
                     : reason[0] ? 1
                                 : 0);
    if (status)
        return plcAsynFail(user, asynError, WRITE_ALARM, "%s: refused: %s", port->name,
                           reason);
    if (!reason[0] && put.number && port->blocks) {
        waitThrough(port, &put);
        plcStationOutputConnected(port->station, reason);
    }
    if (reason[0])
        return plcAsynFail(user, asynDisconnected, COMM_ALARM, "%s: kept for later: %s",
                           port->name, reason);
    if (view->faults && plcFaultsFind(view->faults, view->offset, length, mask, reason))
        return plcAsynFail(user, asynError, WRITE_ALARM, "%s: %s", port->name, reason);
    return asynSuccess;
}

plcAsynView *plcAsynOutputOf(plcAsynPort *port, asynUser *user, plcAsynFace face)
{
    plcAsynView *view;

    clearAlarm(user);
    view = plcAsynViewOf(port, user, face); /* which may set one */
    epicsTimeGetCurrent(&user->timestamp);
    if (!view || view->place->output)
        return view;
    plcAsynFail(user, asynError, WRITE_ALARM,
                "%s \"%s\" is in the input block; to write: \"out %s\"", port->name,
                view->place->text, view->place->text);
    return NULL;
}
