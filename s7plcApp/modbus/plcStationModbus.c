/* Between a station's thread and the worker that speaks Modbus for it: news become blocks,
 * alarms and counters; what records have written becomes orders.
 *
 * Knows nothing of requests or sockets. All functions run in the station's thread, but for
 * create, destroy and the report; none waits.
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsAtomic.h>
#include <epicsStdio.h>
#include <errlog.h>

#include "plcStationPvt.h"

/* A put may take this long until the registers show it, beyond the period of reading, ms. */
#define PATIENCE_MS 1000

/* Between two counts of the heartbeat register, where the option heartbeat is not set; ms. */
#define HEARTBEAT_MS 1000

void plcWireCreate(plcStation *s, const plcWire *wire, unsigned line)
{
    plcModbusSide *m = &s->modbus;
    plcModbusSetup setup = {.name = s->name,
                            .unit = wire->unit,
                            .bigEndian = s->bigEndian,
                            .inputs = wire->inputs,
                            .inputCount = wire->inputCount,
                            .inSize = wire->inputCount ? s->inSize : 0,
                            .outputs = wire->outputs,
                            .outputCount = wire->outputCount,
                            .outSize = s->outSize,
                            .wake = plcStationWake,
                            .arg = s};

    m->on = 1;
    m->wire = *wire;
    m->line = line;
    m->inFaults = setup.inFaults = wire->inputCount ? plcFaultsCreate(s->inSize) : NULL;
    m->outFaults = setup.outFaults = plcFaultsCreate(s->outSize);
    m->readback = plcReadbackCreate();
    m->tracked = plcReadbackCreate();
    m->input = callocMustSucceed(1, s->inSize + 1, "plcWireCreate");
    m->output = callocMustSucceed(3, s->outSize + 1, "plcWireCreate");
    m->image = m->output + s->outSize;
    m->mask = m->image + s->outSize;
    plcImageTrackWrites(s->out);
    m->setup = setup;
    plcWireBegin(s); /* now: it needs a low descriptor, and nobody knows what opens more */
}

void plcWireBegin(plcStation *s)
{
    plcModbusSide *m = &s->modbus;

    if (!m->worker)
        m->worker = plcModbusCreate(&m->setup);
}

void plcWireEnd(plcStation *s)
{
    plcModbusDestroy(s->modbus.worker);
    s->modbus.worker = NULL;
}

void plcWireDestroy(plcStation *s)
{
    plcModbusSide *m = &s->modbus;

    if (!m->on)
        return;
    plcWireEnd(s);
    plcReadbackDestroy(m->readback);
    plcReadbackDestroy(m->tracked);
    plcFaultsDestroy(m->inFaults);
    plcFaultsDestroy(m->outFaults);
    free(m->input);
    free(m->output);
    free(m->wire.inputs);
    free(m->wire.outputs);
}

void plcWireOptions(plcStation *s)
{
    plcModbusOptions options = {
        .requestTimeout = s->now.requestTimeout,
        .readPeriod = s->now.readPeriod,
        .singleWrite = s->now.singleWrite,
        .readModifyWrite = s->now.maskWrite == plcMaskRmw,
        .heartbeatRegister = (int)s->now.heartbeatRegister,
        .heartbeat = s->now.heartbeat > 0 ? s->now.heartbeat : HEARTBEAT_MS};

    plcModbusSetOptions(s->modbus.worker, &options);
}

/* --- The connection -----------------------------------------------------------------------*/

/* Which bytes of a block belong to one value: a request may end between values only. To be
 * freed; NULL when no record needs it. */
static epicsUInt8 *glueOf(plcStation *s, int output)
{
    size_t count, i, byte;
    plcUser *users = plcUsersCopy(s->users, output, &count);
    epicsUInt8 *glue = NULL;

    if (count)
        glue = callocMustSucceed(1, (output ? s->outSize : s->inSize) + 1, "glueOf");
    for (i = 0; i < count; i++)
        for (byte = 1; users[i].type->size > 1 && byte < users[i].length; byte++)
            if (byte % users[i].type->size)
                glue[users[i].offset + byte] = 1;
    free(users);
    return glue;
}

/* Not before all records are there: the worker must know where values lie, or it would cut
 * one. */
static void startWhenReady(plcStation *s)
{
    plcModbusSide *m = &s->modbus;
    epicsUInt8 *in, *out;

    if (!m->waiting || !epicsAtomicGetIntT(&s->ready))
        return;
    m->waiting = 0;
    in = m->wire.inputCount ? glueOf(s, 0) : NULL;
    out = glueOf(s, 1);
    plcModbusStart(m->worker, s->lines[m->line].connection.socket, in, out);
    free(in);
    free(out);
}

void plcWireUp(plcStation *s)
{
    plcModbusSide *m = &s->modbus;

    m->ordered = 0;
    m->waiting = 1;
    startWhenReady(s);
}

/* What waits has not reached the PLC, and nobody knows when it will. It is owed to the next
 * connection, as is all that the PLC does not show then. */
void plcWireLost(plcStation *s, const char *why)
{
    plcModbusSide *m = &s->modbus;

    plcImageTakeChanges(s->out, m->image, m->mask);
    if (plcFaultsSet(m->outFaults, 0, s->outSize, m->mask, why))
        plcInputFollow(s, 0);
}

void plcWireDown(plcStation *s)
{
    plcModbusSide *m = &s->modbus;

    m->waiting = 0;
    plcModbusStop(m->worker);
    m->shown = m->unread = 0; /* no block may tell what the next connection is asked for */
    epicsAtomicSetIntT(&s->taken, 0);
}

/* --- News ---------------------------------------------------------------------------------*/

static void countNews(plcStation *s, const plcModbusNews *news, epicsUInt64 now)
{
    plcModbusSide *m = &s->modbus;

    epicsMutexMustLock(s->lock);
    s->stats.requests += news->requests;
    s->stats.exceptions += news->exceptions;
    s->stats.requestTimeouts += news->timeouts;
    s->stats.bytesIn += news->bytesIn;
    s->stats.bytesOut += news->bytesOut;
    s->stats.blocksOut += news->writes;
    s->stats.blocksIn += news->blocks;
    if (news->blocks)
        s->stats.skipped += news->blocks - 1;
    if (news->latency > 0)
        s->stats.requestLatency = news->latency;
    if (news->latencyMax > s->stats.requestLatencyMax)
        s->stats.requestLatencyMax = news->latencyMax;
    if (news->writes)
        s->stats.lastSend = now;
    if (news->idle && m->ordered) {
        plcStatsSend(&s->stats, (now - m->ordered) / PLC_NS_PER_MS);
        m->ordered = 0;
    }
    epicsMutexUnlock(s->lock);
}

/* The connection is good for something: it may be said again when it is lost. */
static void bearFruit(plcStation *s)
{
    plcLine *line = &s->lines[s->modbus.line];

    if (line->fruitless)
        plcStationLog(s, errlogInfo, "Modbus requests are answered again");
    line->fruitless = 0;
}

/* The input image is new. */
static void inputCame(plcStation *s, const plcModbusNews *news, epicsUInt64 now)
{
    const char *block = s->modbus.input;

    bearFruit(s);
    s->lines[s->modbus.line].lastBlock = now;
    plcInputBlock(s, block, s->now.timestamp < 0 ? news->stamp : plcInputStamp(s, block),
                  news->blocks, now);
}

/* What the PLC holds as we do is no fault any more. An alarm elsewhere ends with a write that
 * is acknowledged. */
static void forgetFaults(plcStation *s, const char *shown)
{
    plcModbusSide *m = &s->modbus;
    size_t i;

    plcImagePeek(s->out, 0, s->outSize, m->image);
    for (i = 0; i < s->outSize; i++)
        m->mask[i] = (char)~(m->image[i] ^ shown[i]);
    plcFaultsClear(m->outFaults, 0, s->outSize, m->mask);
}

/* The output registers as the PLC holds them, on a new connection: outputs with a read-back
 * take them, and what else the IOC has written is owed where it differs. */
static void outputsTake(plcStation *s, const char *shown)
{
    plcModbusSide *m = &s->modbus;
    epicsUInt8 *glue = glueOf(s, 1);
    unsigned places = 0;

    if (shown) {
        places = plcReadbackTake(m->readback, shown, s->out) +
                 plcReadbackTake(m->tracked, shown, s->out);
        forgetFaults(s, shown);
    }
    bearFruit(s);
    plcImageOwe(s->out, shown, glue);
    free(glue);
    s->dirtySince = 0;
    epicsAtomicSetIntT(&s->taken, 1);
    plcInputFollow(s, places);
}

/* Not before the PINI run is over: its values would come later and count as puts. */
static void lookAtOutputs(plcStation *s, epicsUInt64 now)
{
    plcModbusSide *m = &s->modbus;
    epicsUInt64 patience = plcMsToNs(s->now.readPeriod + PATIENCE_MS);
    int first = !epicsAtomicGetIntT(&s->taken);
    unsigned places;

    if (!epicsAtomicGetIntT(&s->running))
        return;
    if (m->shown && first) {
        outputsTake(s, m->output);
    } else if (m->shown && s->now.track) {
        places = plcReadbackTrack(m->tracked, m->output, s->out, now, patience);
        if (places)
            plcInputFollow(s, places);
    } else if (m->unread && first && !plcReadbackCount(s->readback)) {
        outputsTake(s, NULL); /* else the first block tells */
    }
    m->shown = 0;
}

void plcWireStep(plcStation *s, epicsUInt64 now)
{
    plcModbusSide *m = &s->modbus;
    plcModbusNews news;
    char text[PLC_REASON_SIZE + 60];

    startWhenReady(s);
    if (plcModbusTake(m->worker, &news, m->input, m->output)) {
        countNews(s, &news, now);
        if (news.log[0])
            plcStationLog(s, errlogMajor, news.log);
        if (news.shown)
            m->shown = 1;
        if (news.unread[0] && !m->unread) {
            m->unread = 1;
            epicsSnprintf(text, sizeof(text), "the PLC does not show its output registers: %s",
                          news.unread);
            plcStationLog(s, errlogMinor, text);
        }
        if (news.blocks)
            inputCame(s, &news, now);
        if (news.inFaults && s->valid)
            plcScanRequestAll(s->inScan);
        if (news.outFaults)
            plcInputFollow(s, 0);
        if (news.inFaults)
            plcStationChanged(s);
        if (news.lost) {
            plcLineLost(s, m->line, now, news.why);
            return;
        }
    }
    if (s->lines[m->line].connection.state == plcConnectionUp && s->outSize)
        lookAtOutputs(s, now);
}

/* --- Orders -------------------------------------------------------------------------------*/

void plcWireOutputStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    plcModbusSide *m = &s->modbus;
    int forced;
    epicsUInt64 due;

    if (s->lines[m->line].connection.state != plcConnectionUp ||
        !epicsAtomicGetIntT(&s->taken))
        return;
    forced = epicsAtomicGetIntT(&s->sendNow);
    if (forced) {
        epicsAtomicSetIntT(&s->sendNow, 0);
        plcImageOwe(s->out, NULL, NULL);
    }
    if (!plcImageDirty(s->out))
        return;
    if (!s->dirtySince)
        s->dirtySince = now;
    due = forced ? now : s->dirtySince + plcMsToNs(s->now.holdoff);
    if (now < due) {
        plcEarlier(wake, due);
        return;
    }
    plcImageTakeChanges(s->out, m->image, m->mask);
    plcModbusWrite(m->worker, m->image, m->mask);
    if (s->listener && s->listener->sent)
        s->listener->sent(s->listenerPvt, m->image);
    if (!m->ordered)
        m->ordered = s->dirtySince;
    s->dirtySince = 0;
}

/* --- For people; any thread ---------------------------------------------------------------*/

static void reportRanges(const plcRange *ranges, unsigned count, plcFaults *faults,
                         const char *what, FILE *file)
{
    char reason[PLC_REASON_SIZE];
    unsigned i;

    for (i = 0; i < count; i++) {
        const plcRange *r = &ranges[i];

        fprintf(file, "    %s %s %u to %u: byte %u to %u", what, plcTableName(r->table),
                r->start, r->start + r->count - 1, (unsigned)r->offset,
                (unsigned)(r->offset + plcRangeBytes(r) - 1));
        if (r->period)
            fprintf(file, ", every %u ms", r->period);
        if (faults && plcFaultsFind(faults, r->offset, plcRangeBytes(r), NULL, reason))
            fprintf(file, "; %s", reason);
        fprintf(file, "\n");
    }
}

void plcWireReport(plcStation *s, FILE *file)
{
    const plcModbusSide *m = &s->modbus;
    plcStats st;
    char host[PLC_NAME_MAX + 1], reason[PLC_REASON_SIZE];
    int port;

    plcStationStats(s, &st);
    epicsMutexMustLock(s->lock);
    strcpy(host, s->address[m->line]);
    port = s->port[m->line];
    epicsMutexUnlock(s->lock);
    fprintf(file, "    Modbus %s:%d unit %d: ", host, port, m->wire.unit);
    if (plcStationOutputConnected(s, reason))
        fprintf(file, "connected");
    else
        fprintf(file, "not connected (%s)", reason);
    fprintf(file, ", %llu requests, %llu exceptions, %llu not answered, latency [ms] %.3f "
            "(max %.3f)\n", (unsigned long long)st.requests,
            (unsigned long long)st.exceptions, (unsigned long long)st.requestTimeouts,
            st.requestLatency, st.requestLatencyMax);
    reportRanges(m->wire.inputs, m->wire.inputCount, m->inFaults, "in: ", file);
    reportRanges(m->wire.outputs, m->wire.outputCount, m->outFaults, "out:", file);
}
