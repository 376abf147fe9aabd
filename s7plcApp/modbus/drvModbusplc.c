/* iocsh commands of Modbus/TCP, from text to a station with this transport. */
#include <stdlib.h>

#include <cantProceed.h>
#include <epicsStdio.h>
#include <errlog.h>
#include <iocsh.h>

#include "plcComplete.h"
#include "plcConfigure.h"
#include "plcModbusOptions.h"
#include "plcModbusTransport.h"
#include "plcResolver.h"

#include <epicsExport.h>

static const plcNumberArg modbusPort = {"port", 502, 1, 65535, 1, "1 to 65535, or 0 for 502"};
static const plcNumberArg unit = {"unit", 1, 0, 255, 0, "0 to 255"};
static const plcNumberArg startRegister = {"startRegister", -1, 0, 65535, 0,
                                        "0 to 65535, the first register is 0"};
static const plcNumberArg requestTimeout = {.name = "requestTimeout"};

/* Parses the two texts with ranges. Returns 0, or -1 after the error line. */
static int ranges(const char *command, const char *name, const char *const text[2],
                  plcModbusOwn *own, size_t size[2])
{
    static const char *const what[] = {"inputs", "outputs"};
    plcRange *found[2] = {NULL, NULL};
    char error[300] = "";
    int count[2] = {0, 0}, i;

    for (i = 0; i < 2 && !error[0]; i++) {
        count[i] = plcRangesParse(text[i], i, &found[i], &size[i], error, sizeof(error));
        if (count[i] >= 0 && size[i] > PLC_BLOCK_MAX)
            epicsSnprintf(error, sizeof(error), "up to byte %lu; allowed: to 16777216",
                          (unsigned long)size[i]);
        if (error[0])
            plcConfigureRefuse(command, name, "%s: %s", what[i], error);
    }
    if (!error[0] && count[0] + count[1] == 0)
        plcConfigureRefuse(command, name,
                           "neither inputs nor outputs; allowed: \"table start count [at "
                           "offset] [every ms] [unit n], ...\" with table holding, input, coils or "
                           "discrete");
    if (error[0] || count[0] + count[1] == 0) {
        free(found[0]);
        free(found[1]);
        return -1;
    }
    own->inputs = found[0];
    own->inputCount = (unsigned)count[0];
    own->outputs = found[1];
    own->outputCount = (unsigned)count[1];
    return 0;
}

/* What may be a mistake: 40001 to 49999 and the like may be what a manual calls 1 and so on. */
static void hint(const char *command, const char *name, const plcRange *ranges, unsigned count,
                 int ofPlc)
{
    static const unsigned first[] = {[plcHolding] = 40001, [plcInputRegisters] = 30001,
                                     [plcCoils] = 65536, [plcDiscrete] = 10001};
    char doubt[200];
    unsigned i;

    for (i = 0; i < count; i++) {
        const plcRange *r = &ranges[i];

        plcRangeDoubt(ranges, i, ofPlc, doubt, sizeof(doubt));
        if (doubt[0])
            errlogSevPrintf(errlogInfo, "%s %.60s: %s: %s\n", command, name,
                            r->period ? "inputs" : "outputs", doubt);
        if (r->start >= first[r->table] && r->start < first[r->table] + 9999)
            errlogSevPrintf(errlogInfo, "%s %.60s: \"%s %u\" is address %u; if it is a manual's number, "
                            "write \"%s %u\": they count from %u\n", command, name,
                            plcTableName(r->table), r->start, r->start, plcTableName(r->table),
                            r->start - first[r->table], first[r->table]);
    }
}

static const char oneStation[] = "a device that takes only one needs one station, with \"unit n\" in "
                                 "its ranges";

/* modbusplcConfigure. Returns the station, or NULL after one error line. */
static plcStation *configure(const char *command, const char *const args[7])
{
    const char *name = args[0], *address = args[1] ? args[1] : "", *error;
    char host[PLC_LINES_MAX][PLC_NAME_MAX + 1], text[12], why[200];
    plcStationConfig config = {.name = name, .policy = &plcSingle, .bigEndian = 1,
                               .recvTimeout = 2000, .sendInterval = 1000};
    plcModbusOwn own = {0};
    epicsInt32 port, timeout;
    size_t size[2];
    plcStation *station;

    if (!plcConfigureIsNew(command, name))
        return NULL;
    if (!args[1])
        return plcConfigureRefuse(command, name, "IPaddr is missing; allowed: " PLC_HOST_ALLOWED
                                  ", or \"\" where a record brings it");
    if (plcConfigureAddress(address, &config, host, &error))
        return plcConfigureRefuse(command, name, "IPaddr \"%.60s\"; allowed: %s", address,
                                  error);
    if (plcConfigureNumber(command, name, &modbusPort, args[2], &port) ||
        plcConfigureNumber(command, name, &unit, args[3], &own.unit) ||
        plcConfigureNumber(command, name, &requestTimeout, args[6], &timeout) ||
        ranges(command, name, args + 4, &own, size))
        return NULL;
    config.port = port;
    config.inSize = size[0];
    config.outSize = size[1];
    config.transport = &plcModbusTransport;
    config.transportOwn = &own;
    station = plcStationCreate(&config);
    if (!station) {
        free(own.inputs);
        free(own.outputs);
        return NULL;
    }
    plcConfigureSharing(command, station, oneStation);
    hint(command, name, own.inputs, own.inputCount, own.unit);
    hint(command, name, own.outputs, own.outputCount, own.unit);
    sprintf(text, "%d", (int)timeout);
    plcStationSetOption(station, "requestTimeout", text, why, sizeof(why));
    return station;
}

/* s7plcModbusOutput. Returns 0, or -1 after one error line. */
static int configureOutput(const char *command, const char *const args[5])
{
    const char *name = args[0], *address = args[1] ? args[1] : "";
    plcStation *station = name ? plcStationFind(name) : NULL;
    plcModbusOwn own = {0};
    epicsInt32 port, start;
    size_t size;
    char error[200];

    if (!station) {
        plcConfigureRefuse(command, name, "no such PLC; s7plcConfigure comes first");
        return -1;
    }
    if (!plcAddressIsHost(address)) {
        plcConfigureRefuse(command, name,
                           "IPaddr \"%.60s\"; allowed: " PLC_HOST_ALLOWED ", or \"\" for that of "
                           "the PLC", address);
        return -1;
    }
    if (plcConfigureNumber(command, name, &modbusPort, args[2], &port) ||
        plcConfigureNumber(command, name, &unit, args[3], &own.unit) ||
        plcConfigureNumber(command, name, &startRegister, args[4], &start))
        return -1;
    size = plcStationOutSize(station);
    if (size == 0 || size % 2 || start + size / 2 > 65536) {
        plcConfigureRefuse(command, name,
                           "outSize is %lu, startRegister %d; allowed: whole registers of "
                           "2 bytes, from 0 to 65535", (unsigned long)size, (int)start);
        return -1;
    }
    own.outputs = callocMustSucceed(1, sizeof(*own.outputs), command);
    own.outputs->table = plcHolding;
    own.outputs->unit = PLC_UNIT_OF_PLC;
    own.outputs->start = (unsigned)start;
    own.outputs->count = (unsigned)size / 2;
    own.outputCount = 1;
    if (plcStationOutputBy(station, address, port, &plcModbusTransport, &own, error,
                           sizeof(error)) == 0) {
        plcConfigureSharing(command, station, oneStation);
        return 0;
    }
    free(own.outputs);
    plcConfigureRefuse(command, name, "%s", error);
    return -1;
}

/* --- iocsh ------------------------------------------------------------------------------*/

/* Numbers are strings here, so that a missing or mistyped one gets a message of ours. */
static const iocshArg newArg = {"PLCname", iocshArgString};
static const iocshArg stationArg = {"PLCname", PLC_ARG_STATION};
static const iocshArg addressArg = {"IPaddr", iocshArgString};
static const iocshArg portArg = {"port [502]", iocshArgString};
static const iocshArg unitArg = {"unit [1]", iocshArgString};
static const iocshArg startArg = {"startRegister", iocshArgString};
static const iocshArg inputsArg = {"inputs", iocshArgString};
static const iocshArg outputsArg = {"outputs", iocshArgString};
static const iocshArg timeoutArg = {"requestTimeout [ms]", iocshArgString};

static const iocshArg *const configureArgs[] = {&newArg,    &addressArg, &portArg,
                                                &unitArg,   &inputsArg,  &outputsArg,
                                                &timeoutArg};
static const iocshArg *const outputArgs[] = {&stationArg, &addressArg, &portArg, &unitArg,
                                             &startArg};

static const iocshFuncDef configureDef = {
    "modbusplcConfigure", 7, configureArgs
#ifdef IOCSHFUNCDEF_HAS_USAGE
    ,
    "Makes a station: a PLC that is read and written over Modbus/TCP.\n"
    "inputs, outputs: table start count [at offset] [every ms] [unit n], ...\n"
    "  with table holding, input, coils or discrete (outputs: holding, coils)\n"
    "  modbusplcConfigure PLC,192.168.0.20,502,1,\"holding 0 100 every 100, coils 0 64\","
    "\"holding 200 50\"\n"
#endif
};
static const iocshFuncDef outputDef = {
    "s7plcModbusOutput", 5, outputArgs
#ifdef IOCSHFUNCDEF_HAS_USAGE
    ,
    "The outputs of a PLC of s7plcConfigure leave over Modbus/TCP: outSize/2 holding\n"
    "registers from startRegister on. Before iocInit. IPaddr \"\": that of the PLC.\n"
    "  s7plcModbusOutput PLC,\"\",502,1,1000\n"
#endif
};

static void texts(const iocshArgBuf *args, int count, const char **text)
{
    int i;

    for (i = 0; i < count; i++)
        text[i] = args[i].sval;
}

static void configureCall(const iocshArgBuf *args)
{
    const char *text[7];

    texts(args, 7, text);
    iocshSetError(configure("modbusplcConfigure", text) ? 0 : -1);
}

static void outputCall(const iocshArgBuf *args)
{
    const char *text[5];

    texts(args, 5, text);
    iocshSetError(configureOutput("s7plcModbusOutput", text));
}

static void modbusplcRegister(void)
{
    plcOptionsAdd(&plcModbusOptionTable);
    iocshRegister(&configureDef, configureCall);
    iocshRegister(&outputDef, outputCall);
}
epicsExportRegistrar(modbusplcRegister);
