/* Modbus/TCP as a transport: the station's table of functions on the worker of plcModbus.
 *
 * Knows options and reports; nothing of stations or records.
 */
#include <stdlib.h>

#include <cantProceed.h>

#include "plcModbus.h"
#include "plcModbusOptions.h"
#include "plcModbusTransport.h"
#include "plcStats.h"

/* Between two counts of the heartbeat register, where the option heartbeat is not set; ms. */
#define HEARTBEAT_MS 1000

typedef struct modbusTransport {
    plcModbusOwn own;
    plcModbusSetup setup;
    plcModbus *worker; /* NULL after end, until begin */
} modbusTransport;

static void begin(void *pvt)
{
    modbusTransport *t = pvt;

    if (!t->worker)
        t->worker = plcModbusCreate(&t->setup);
}

static void end(void *pvt)
{
    modbusTransport *t = pvt;

    plcModbusDestroy(t->worker);
    t->worker = NULL;
}

static void *create(const plcTransportSetup *setup, const void *own)
{
    modbusTransport *t = callocMustSucceed(1, sizeof(*t), "plcModbusTransport");
    const plcModbusOwn *o = own;

    t->own = *o;
    t->setup = (plcModbusSetup){.name = setup->name,
                                .unit = o->unit,
                                .bigEndian = setup->bigEndian,
                                .inputs = o->inputs,
                                .inputCount = o->inputCount,
                                .inSize = setup->inSize,
                                .outputs = o->outputs,
                                .outputCount = o->outputCount,
                                .out = setup->out,
                                .outSize = setup->outSize,
                                .inFaults = setup->inFaults,
                                .outFaults = setup->outFaults,
                                .wake = setup->wake,
                                .arg = setup->arg};
    begin(t); /* now: it needs a low descriptor, and nobody knows what opens more */
    return t;
}

static void destroy(void *pvt)
{
    modbusTransport *t = pvt;

    end(t);
    free(t->own.inputs);
    free(t->own.outputs);
    free(t);
}

static void options(void *pvt, const plcOptions *o)
{
    modbusTransport *t = pvt;
    const plcModbusChoices *own = plcModbusChoicesOf(o);
    int loose = own->check == plcCheckLoose;
    plcModbusOptions chosen = {
        .requestTimeout = o->requestTimeout,
        .readPeriod = o->readPeriod,
        .singleWrite = own->singleWrite,
        .readModifyWrite = own->maskWrite == plcMaskRmw,
        .heartbeatRegister = (int)own->heartbeatRegister,
        .heartbeat = o->heartbeat > 0 ? o->heartbeat : HEARTBEAT_MS,
        .limits = {(unsigned)own->maxRegisters, (unsigned)own->maxBits},
        .requestPause = own->requestPause,
        .anyUnit = loose || own->check == plcCheckAnyUnit,
        .anyTransaction = loose || own->check == plcCheckAnyTransaction,
        .rtu = own->framing == plcFramingRtu};

    plcModbusSetOptions(t->worker, &chosen);
}

/* The range that is read most often, or the outputs. */
static double longestPause(void *pvt, const plcOptions *o)
{
    modbusTransport *t = pvt;
    double least = t->own.outputCount ? o->readPeriod : 0;
    unsigned i;

    for (i = 0; i < t->own.inputCount; i++)
        if (!(least > 0) || t->own.inputs[i].period < least)
            least = t->own.inputs[i].period;
    return least > 0 ? least + plcModbusChoicesOf(o)->requestPause : 0;
}

static void up(void *pvt, SOCKET socket, const epicsUInt8 *wholeIn,
               const epicsUInt8 *wholeOut)
{
    modbusTransport *t = pvt;

    plcModbusStart(t->worker, socket, wholeIn, wholeOut);
}

static void whole(void *pvt, const epicsUInt8 *wholeIn, const epicsUInt8 *wholeOut)
{
    modbusTransport *t = pvt;

    plcModbusJoined(t->worker, wholeIn, wholeOut);
}

static void down(void *pvt)
{
    modbusTransport *t = pvt;

    plcModbusStop(t->worker);
}

static int news(void *pvt, plcNews *n, void *input, void *output)
{
    modbusTransport *t = pvt;

    return plcModbusTake(t->worker, n, input, output);
}

static void put(void *pvt, const void *image, const void *mask)
{
    modbusTransport *t = pvt;

    (void)image, (void)mask;
    plcModbusWrite(t->worker);
}

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
        if (r->unit != PLC_UNIT_OF_PLC)
            fprintf(file, ", unit %d", r->unit - 1);
        if (r->period)
            fprintf(file, ", every %u ms", r->period);
        if (faults && plcFaultsFind(faults, r->offset, plcRangeBytes(r), NULL, reason))
            fprintf(file, "; %s", reason);
        fprintf(file, "\n");
    }
}

static void report(void *pvt, const char *where, const char *state, const plcStats *st,
                   FILE *file)
{
    modbusTransport *t = pvt;
    const plcModbusOwn *o = &t->own;

    fprintf(file, "    Modbus %s unit %d: %s, %llu requests, %llu exceptions, %llu not "
            "answered, latency [ms] %.3f (max %.3f)\n", where, o->unit, state,
            (unsigned long long)st->requests, (unsigned long long)st->exceptions,
            (unsigned long long)st->requestTimeouts, st->requestLatency,
            st->requestLatencyMax);
    reportRanges(o->inputs, o->inputCount, t->setup.inFaults, "in: ", file);
    reportRanges(o->outputs, o->outputCount, t->setup.outFaults, "out:", file);
}

const plcTransport plcModbusTransport = {
    .name = "Modbus",
    .prefix = "Modbus ",
    .shows = 1,
    .takesPuts = 1,
    .create = create,
    .destroy = destroy,
    .begin = begin,
    .end = end,
    .pause = longestPause,
    .options = options,
    .up = up,
    .whole = whole,
    .down = down,
    .news = news,
    .put = put,
    .report = report,
};
