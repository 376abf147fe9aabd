/* iocsh commands of the Modbus/TCP wire; what they do is in plcConfigure and plcStation. */
#include <iocsh.h>

#include "plcComplete.h"
#include "plcConfigure.h"

#include <epicsExport.h>

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
    "inputs, outputs: table start count [at offset] [every ms], ...\n"
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
    plcConfigureModbus("modbusplcConfigure", text);
}

static void outputCall(const iocshArgBuf *args)
{
    const char *text[5];

    texts(args, 5, text);
    plcConfigureModbusOutput("s7plcModbusOutput", text);
}

static void modbusplcRegister(void)
{
    iocshRegister(&configureDef, configureCall);
    iocshRegister(&outputDef, outputCall);
}
epicsExportRegistrar(modbusplcRegister);
