/* The state of a station, as its other files share it: its log, its reasons, whether puts pass,
 * and how its thread is woken.
 *
 * Calls no other file of the station.
 */
#include <string.h>

#include <epicsAtomic.h>
#include <epicsStdio.h>
#include <errlog.h>

#include "drvS7plc.h"
#include "plcHot.h"
#include "plcStationPvt.h"

int s7plcDebug = 0;

/* Log lines per minute and station; the rest is counted. */
#define LOG_LINES 20

PLC_COLD void plcStationLog(plcStation *s, int severity, const char *text)
{
    epicsUInt64 now = epicsMonotonicGet();

    if (now >= s->logRefill) {
        if (s->logDropped)
            errlogSevPrintf(errlogMinor,
                            "s7plc %s: %u more messages in the last minute\n", s->name,
                            s->logDropped);
        s->logDropped = 0;
        s->logTokens = LOG_LINES;
        s->logRefill = now + plcMsToNs(60000);
    }
    if (s->logTokens == 0) {
        s->logDropped++;
        return;
    }
    s->logTokens--;
    errlogSevPrintf((errlogSevEnum)severity, "s7plc %s: %s\n", s->name, text);
}

void plcStationWake(void *arg)
{
    plcStation *s = arg;

    plcWakeUp(&s->wake);
}

void plcStationReason(plcStation *s, unsigned i, const char *reason)
{
    char *to = plcLineIsOutput(s, i) ? s->outReason : s->reason;

    epicsMutexMustLock(s->lock);
    epicsSnprintf(to, PLC_REASON_SIZE, "%s", reason);
    epicsSnprintf(s->stats.lastError, sizeof(s->stats.lastError), "%s", reason);
    epicsMutexUnlock(s->lock);
    plcStationGate(s);
}

const char *plcStationOutReason(const plcStation *s)
{
    return plcStationHasOutLine(s) ? s->outReason : s->reason;
}

void plcStationGate(plcStation *s)
{
    const char *why = "";

    epicsMutexMustLock(s->lock);
    if (s->options.sync)
        why = plcSyncReason(s->stats.syncState);
    else if (s->layoutState == plcLayoutDiffers)
        why = plcSyncReason(plcSyncLayoutMismatch);
    else if (s->options.offlineWrites == plcOfflineReject &&
             !epicsAtomicGetIntT(&s->leads))
        why = plcStationOutReason(s);
    epicsSnprintf(s->refusal, sizeof(s->refusal), "%s", why);
    plcImageClose(s->out, s->refusal[0] != 0);
    epicsMutexUnlock(s->lock);
}

size_t plcStationHeader(const plcStation *s)
{
    return s->options.sync ? PLC_HEADER_SIZE : 0;
}

int plcStationDelivered(const plcStation *s)
{
    if (s->exchange)
        return !s->exchange->ordered;
    return s->leader >= 0 && plcConnectionDelivered(&s->lines[s->leader].connection);
}

void plcStationCountPuts(plcStation *s)
{
    epicsUInt64 dropped, more;
    int some = plcImagePutsWaiting(s->out, NULL, NULL) > 0;

    plcImagePutsThrough(s->out, &dropped);
    more = dropped - s->putsDropped;
    s->putsDropped = dropped;
    if (more) {
        epicsMutexMustLock(s->lock);
        s->stats.putsDropped += more;
        epicsMutexUnlock(s->lock);
    }
    if (more && !s->saidDropped)
        plcStationLog(s, errlogMinor,
                      "puts come faster than the PLC takes them: of each place the newest "
                      "is kept");
    s->saidDropped = some && (s->saidDropped || more);
}
