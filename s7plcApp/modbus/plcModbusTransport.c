/* Modbus/TCP as a transport: the station's table of functions on the worker of plcModbus.
 *
 * Knows options and reports; nothing of stations or records.
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>

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

static int holds(void *pvt, int output, size_t offset, size_t length, const void *mask,
                 size_t *fits, char *error, size_t errorSize)
{
    modbusTransport *t = pvt;
    const plcModbusOwn *o = &t->own;

    return plcRangesHold(output ? o->outputs : o->inputs,
                         output ? o->outputCount : o->inputCount, offset, length, mask, output,
                         fits, error, errorSize);
}

static int news(void *pvt, plcNews *n, void *input, void *output)
{
    modbusTransport *t = pvt;

    return plcModbusTake(t->worker, n, input, output);
}

static int hidden(void *pvt, void *mask)
{
    modbusTransport *t = pvt;

    return plcModbusHidden(t->worker, mask);
}

static void put(void *pvt, const void *image, const void *mask)
{
    modbusTransport *t = pvt;

    (void)image, (void)mask;
    plcModbusWrite(t->worker);
}

static int isBits(const plcRange *r)
{
    return r->table == plcCoils || r->table == plcDiscrete;
}

/* Why the PLC does not show a register or bit of a range, by its place in it; "" when it does. */
static void whyNot(plcFaults *faults, const plcRange *r, unsigned at, char why[PLC_REASON_SIZE])
{
    epicsUInt8 bit = (epicsUInt8)(1 << at % 8);

    if (isBits(r))
        plcFaultsFind(faults, r->offset + at / 8, 1, &bit, why);
    else
        plcFaultsFind(faults, r->offset + 2 * (size_t)at, 2, NULL, why);
}

/* The first registers or bits of a range that are refused for one reason; one is. */
static void firstRefused(plcFaults *faults, const plcRange *r, char *text, size_t size)
{
    char why[PLC_REASON_SIZE] = "", next[PLC_REASON_SIZE];
    const char *words;
    unsigned from, to;

    for (from = 0; from < r->count && !why[0]; from++)
        whyNot(faults, r, from, why);
    from += r->start - 1;
    for (to = from + 1; to < r->start + r->count; to++) {
        whyNot(faults, r, to - r->start, next);
        if (strcmp(next, why))
            break;
    }
    words = strncmp(why, "PLC: ", 5) ? why : why + 5;
    if (--to > from)
        epicsSnprintf(text, size, "%s %u to %u: %s", plcTableName(r->table), from, to, words);
    else
        epicsSnprintf(text, size, "%s %u: %s", plcTableName(r->table), from, words);
}

static unsigned refused(void *pvt, unsigned *of, char *first, size_t size)
{
    modbusTransport *t = pvt;
    unsigned i, count = 0;

    *of = 0;
    first[0] = 0;
    for (i = 0; i < t->own.inputCount; i++) {
        const plcRange *r = &t->own.inputs[i];
        size_t bad = plcFaultsCount(t->setup.inFaults, r->offset, plcRangeBytes(r));

        if (bad && !first[0])
            firstRefused(t->setup.inFaults, r, first, size);
        *of += r->count;
        count += (unsigned)bad / (isBits(r) ? 1 : 16);
    }
    return count;
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
    .holds = holds,
    .news = news,
    .hidden = hidden,
    .refused = refused,
    .put = put,
    .report = report,
};
