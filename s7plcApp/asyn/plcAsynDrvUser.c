/* drvInfo: from the text that a record gives to a place of the PLC, shared by all that give the
 * same, and its view by one interface; and how an asynUser is told what is wrong.
 *
 * Knows nothing of threads, nor how values move.
 */
#include <stdarg.h>
#include <string.h>

#include <alarm.h>
#include <epicsStdio.h>
#include <errlog.h>

#include "plcAsynPort.h"

asynStatus plcAsynFail(asynUser *user, asynStatus status, int alarm, const char *format,
                       ...)
{
    va_list args;

    user->alarmStatus = alarm;
    user->alarmSeverity = INVALID_ALARM;
    va_start(args, format);
    epicsVsnprintf(user->errorMessage, user->errorMessageSize, format, args);
    va_end(args);
    return status;
}

/* One place for each text: the records of a place share it. */
static plcAsynPlace *findPlace(plcAsynPort *port, const char *text)
{
    ELLNODE *node;

    for (node = ellFirst(&port->places); node; node = ellNext(node))
        if (strcmp(CONTAINER(node, plcAsynPlace, node)->text, text) == 0)
            return CONTAINER(node, plcAsynPlace, node);
    return NULL;
}

static asynStatus userCreate(void *pvt, asynUser *user, const char *text,
                             const char **typeName, size_t *size)
{
    plcAsynPort *port = pvt;
    char error[640], warning[640] = "";
    plcAsynPlace *place;
    int addr = 0;

    (void)typeName, (void)size;
    if (!port->station)
        return plcAsynFail(user, asynError, LINK_ALARM, "%s: its IOC has ended", port->name);
    pasynManager->getAddr(user, &addr);
    if (addr > 0)
        return plcAsynFail(user, asynError, LINK_ALARM,
                           "%s: address %d; a PLC is one device; allowed: 0", port->name,
                           addr);
    epicsMutexMustLock(port->lock);
    place = findPlace(port, text);
    if (!place) {
        place = plcAsynPlaceCreate(port->station, text, error, warning, sizeof(error));
        if (place)
            ellAdd(&port->places, &place->node);
    }
    epicsMutexUnlock(port->lock);
    if (!place) {
        errlogSevPrintf(errlogMajor, "s7plcAsyn %s \"%s\": %s\n", port->name, text,
                        error);
        return plcAsynFail(user, asynError, LINK_ALARM, "%s \"%s\": %s", port->name, text,
                           error);
    }
    if (warning[0])
        errlogSevPrintf(errlogMinor, "s7plcAsyn %s \"%s\" warning: %s\n", port->name,
                        text, warning);
    user->drvUser = place;
    /* A device that is not connected: the driver says why, and keeps what is written. */
    user->reason = ASYN_REASON_QUEUE_EVEN_IF_NOT_CONNECTED;
    return asynSuccess;
}

static asynStatus userGetType(void *pvt, asynUser *user, const char **typeName,
                              size_t *size)
{
    plcAsynPlace *place = user->drvUser;

    (void)pvt;
    if (!place)
        return plcAsynFail(user, asynError, LINK_ALARM, "no drvInfo");
    if (typeName)
        *typeName = place->text;
    if (size)
        *size = 0;
    return asynSuccess;
}

/* Places stay: records that come later with the same text use them. */
static asynStatus userDestroy(void *pvt, asynUser *user)
{
    (void)pvt;
    user->drvUser = NULL;
    return asynSuccess;
}

static asynDrvUser drvUserMethods = {userCreate, userGetType, userDestroy};

int plcAsynDrvUserRegister(plcAsynPort *port)
{
    port->drvUser.interfaceType = asynDrvUserType;
    port->drvUser.pinterface = &drvUserMethods;
    port->drvUser.drvPvt = port;
    return pasynManager->registerInterface(port->name, &port->drvUser) == asynSuccess ? 0 : -1;
}

plcAsynView *plcAsynViewOf(plcAsynPort *port, asynUser *user, plcAsynFace face)
{
    plcAsynPlace *place = user->drvUser;
    plcAsynView *view;
    int isNew;

    if (!place) {
        plcAsynFail(user, asynError, LINK_ALARM,
                    "%s: no drvInfo; needed: [in|out] offset T=type", port->name);
        return NULL;
    }
    if (!place->station) {
        plcAsynFail(user, asynError, LINK_ALARM, "%s \"%s\": its IOC has ended", port->name,
                    place->text);
        return NULL;
    }
    epicsMutexMustLock(port->lock);
    isNew = !place->views[face];
    view = plcAsynPlaceView(place, face, port->name);
    epicsMutexUnlock(port->lock);
    if (isNew && view->doubt)
        errlogSevPrintf(errlogMinor, "s7plcAsyn %s \"%s\" warning: %s\n", port->name,
                        place->text, view->doubt);
    if (isNew && !view->refused && place->output && !view->hasReadback &&
        plcStationHeader(port->station))
        errlogSevPrintf(
            errlogMinor,
            "s7plcAsyn %s \"%s\" warning: with sync=on the PLC must "
            "show this output: add R=offset, or set the PLC's option readback\n",
            port->name, place->text);
    if (!view->refused)
        return view;
    if (isNew)
        errlogSevPrintf(errlogMajor, "s7plcAsyn %s \"%s\": %s\n", port->name, place->text,
                        view->refused);
    plcAsynFail(user, asynError, LINK_ALARM, "%s \"%s\": %s", port->name, place->text,
                view->refused);
    return NULL;
}
