/* Device support: what all of it stands on: the structure of a record and its row, alarms and
 * messages, time stamps.
 *
 * Knows neither what a link says nor how bytes travel.
 */
#include <stdarg.h>
#include <string.h>

#include <alarm.h>
#include <dbAccess.h>
#include <dbBase.h>
#include <dbLink.h>
#include <epicsStdio.h>
#include <epicsTime.h>
#include <errlog.h>
#include <link.h>

#include "plcCompat.h"
#include "devS7plc.h"
#include "plcHot.h"

/* --- Messages ----------------------------------------------------------------------- */

void devWarn(dbCommon *prec, const char *format, ...)
{
    const devSupport *support = devSupportOf(prec);
    char text[400];
    va_list args;

    va_start(args, format);
    epicsVsnprintf(text, sizeof(text), format, args);
    va_end(args);
    errlogPrintf("%s %s \"%s\" warning: %s\n", support->dtyp, support->shape.recordType,
                 prec->name, text);
}

const char *devLinkText(dbCommon *prec)
{
    const struct link *link = dbGetDevLink(prec);

    if (!link || link->type != INST_IO || !link->value.instio.string)
        return "";
    return link->value.instio.string;
}

/* --- Simulation ------------------------------------------------------------------------ */

/* A field of the record by its name; NULL: its type has none. */
static void *fieldOf(dbCommon *prec, const char *name)
{
    const dbRecordType *type = prec->rdes;
    int i;

    for (i = 0; i < type->no_fields; i++)
        if (strcmp(type->papFldDes[i]->name, name) == 0)
            return (char *)prec + type->papFldDes[i]->offset;
    return NULL;
}

void devFindSimulation(devRecord *dev)
{
    dev->simm = fieldOf(dev->prec, "SIMM");
    dev->siml = fieldOf(dev->prec, "SIML");
}

int devIsSimulated(dbCommon *prec)
{
    const devRecord *dev = prec->dpvt;
    epicsEnum16 mode, status = prec->nsta, severity = prec->nsev;

    if (!dev->simm)
        return 0;
    mode = *dev->simm;
    dbGetLink(dev->siml, DBR_USHORT, &mode, NULL, NULL);
    prec->nsta = status; /* a link that cannot be read is told when the record processes */
    prec->nsev = severity;
    plcClearMessage(prec);
    return mode != 0;
}

/* --- Alarms and time stamps ----------------------------------------------------------- */

void devStampNow(dbCommon *prec)
{
    if (prec->tse == epicsTimeEventDeviceTime)
        epicsTimeGetCurrent(&prec->time);
}

void devStamp(dbCommon *prec)
{
    recGblGetTimeStamp(prec);
    devStampNow(prec);
}

/* The reason that follows says more than the UDF alarm of an output without a value. */
void devOverUndefined(dbCommon *prec)
{
    if (prec->nsta == UDF_ALARM)
        prec->nsev = NO_ALARM;
}

PLC_HOT devRecord *devOf(dbCommon *prec)
{
    devRecord *dev = prec->dpvt;

    if (dev && dev->station) {
        plcClearMessage(prec);
        return dev;
    }
    devOverUndefined(prec);
    recGblSetSevrMsg(prec, LINK_ALARM, INVALID_ALARM, "%s",
                     dev ? dev->reason : "no link to a PLC");
    devStampNow(prec);
    return NULL;
}

const void *devMask(const devRecord *dev, epicsUInt8 bytes[DEV_SCALAR])
{
    epicsUInt64 bits = dev->mask ? dev->mask : dev->shifted ? *dev->shifted : 0;

    if (!bits)
        return NULL;
    plcPutInt(dev->type, bytes, dev->order, (epicsInt64)bits);
    return bytes;
}

/* For s7plcShow: an output that no one ever wrote is a PINI that was forgotten. */
void devHasValue(devRecord *dev)
{
    if (dev->owner.unwritten) /* no other thread sets it */
        plcOwnersWritten(plcStationOwners(dev->station), &dev->owner);
}

int devSays(const dbCommon *prec, const char *reason)
{
#ifdef HAS_ALARM_MESSAGE
    return strcmp(prec->amsg, reason) == 0;
#else
    (void)prec, (void)reason;
    return 1;
#endif
}
