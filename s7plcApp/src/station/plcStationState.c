/* The state of a station, as its other files share it: its log, its reasons, whether puts pass,
 * and how its thread is woken.
 *
 * Calls no other file of the station.
 */
#include <stdio.h>
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

/* Bytes in a line of a block, and lines of a block at most. */
#define TRACE_BYTES 16
#define TRACE_LINES 64

/* "PLC", or with logTime "PLC 12:00:00.123": how a line begins. */
static const char *title(const plcStation *s, char *text, size_t size)
{
    char time[20] = "";
    epicsTimeStamp now;

    if (epicsAtomicGetIntT(&s->logTime) && epicsTimeGetCurrent(&now) == 0)
        epicsTimeToStrftime(time, sizeof(time), " %H:%M:%S.%03f", &now);
    epicsSnprintf(text, size, "%s%s", s->name, time);
    return text;
}

/* "00 2A FF". */
static void hex(const epicsUInt8 *bytes, size_t length, char text[3 * TRACE_BYTES + 1])
{
    size_t i;

    text[0] = 0;
    for (i = 0; i < length && i < TRACE_BYTES; i++)
        sprintf(text + 3 * i, "%02X ", bytes[i]);
    if (i)
        text[3 * i - 1] = 0;
}

PLC_COLD void plcStationTraceBlock(const plcStation *s, const char *what, const void *block,
                                   size_t size)
{
    char name[PLC_NAME_MAX + 24], bytes[3 * TRACE_BYTES + 1];
    size_t at;

    title(s, name, sizeof(name));
    for (at = 0; at < size && at < TRACE_BYTES * TRACE_LINES; at += TRACE_BYTES) {
        hex((const epicsUInt8 *)block + at, size - at, bytes);
        errlogPrintf("s7plc %s: %s %4u: %s\n", name, what, (unsigned)at, bytes);
    }
    if (at < size)
        errlogPrintf("s7plc %s: %s %4u: ... %u bytes more\n", name, what, (unsigned)at,
                     (unsigned)(size - at));
}

PLC_COLD void plcStationTracePut(const plcStation *s, size_t offset, size_t length,
                                 const void *data, const void *mask, const char *refusal)
{
    char name[PLC_NAME_MAX + 24], bytes[3 * TRACE_BYTES + 1], bits[3 * TRACE_BYTES + 1] = "";

    title(s, name, sizeof(name));
    hex(data, length, bytes);
    if (mask)
        hex(mask, length, bits);
    errlogPrintf("s7plc %s: put %4u: %s%s%s%s%s%s\n", name, (unsigned)offset, bytes,
                 length > TRACE_BYTES ? " ..." : "", mask ? " mask " : "", bits,
                 refusal ? " refused: " : "", refusal ? refusal : "");
}

PLC_COLD void plcStationLog(plcStation *s, int severity, const char *text)
{
    epicsUInt64 now = epicsMonotonicGet();
    char name[PLC_NAME_MAX + 24];

    if (severity + epicsAtomicGetIntT(&s->logLevel) < errlogMajor)
        return;
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
    errlogSevPrintf((errlogSevEnum)severity, "s7plc %s: %s\n", title(s, name, sizeof(name)),
                    text);
}

PLC_COLD void plcStationLogOf(plcStation *s, int severity, size_t at, size_t room, const char *text)
{
    char name[80], others[30] = "", line[PLC_REASON_SIZE + 400];
    unsigned count = room ? plcOwnersIn(s->owners, at, room, name, sizeof(name)) : 0;

    if (count > 1)
        epicsSnprintf(others, sizeof(others), " and %u more", count - 1);
    if (count)
        epicsSnprintf(line, sizeof(line), "record %s%s, %s", name, others, text);
    plcStationLog(s, severity, count ? line : text);
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
    epicsTimeGetCurrent(&s->stats.lastErrorTime);
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
    return s->header;
}

int plcLineDelivered(const plcLine *line)
{
    const plcTransport *t = line->transport;

    return !(t->sending && t->sending(line->pvt)) && plcConnectionDelivered(&line->connection);
}

int plcStationDelivered(const plcStation *s)
{
    if (s->exchange)
        return !s->exchange->ordered;
    return s->leader >= 0 && plcLineDelivered(&s->lines[s->leader]);
}

void plcStationCountPuts(plcStation *s)
{
    epicsUInt64 dropped, more;
    char text[140];
    int some = plcImagePutsWaiting(s->out, NULL, NULL) > 0;

    plcImagePutsThrough(s->out, &dropped);
    more = dropped - s->putsDropped;
    s->putsDropped = dropped;
    if (more) {
        epicsMutexMustLock(s->lock);
        s->stats.putsDropped += more;
        epicsMutexUnlock(s->lock);
    }
    if (more && !s->saidDropped) {
        epicsSnprintf(text, sizeof(text),
                      "puts come faster than the PLC takes them: %llu dropped, of each place the newest "
                      "is kept", (unsigned long long)more);
        plcStationLog(s, errlogMinor, text);
    }
    s->saidDropped = some && (s->saidDropped || more);
}
