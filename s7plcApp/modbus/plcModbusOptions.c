/* The options that only Modbus has; see plcModbusOptions.h. */
#include "plcModbusOptions.h"

#define AT(member) offsetof(plcModbusChoices, member)

/* clang-format off */
static const plcOptionRow rows[] = {
    {.key = "maxRegisters", .kind = plcOptWhole, .field = AT(maxRegisters), .min = 1,
     .max = 125, .unit = "registers", .initial = 125,
     .help = "Modbus: a request holds at most so many registers (a write 123)"},
    {.key = "maxBits", .kind = plcOptWhole, .field = AT(maxBits), .min = 1, .max = 2000,
     .unit = "bits", .initial = 2000,
     .help = "Modbus: a request holds at most so many coils or discrete inputs (a write 1968)"},
    {.key = "requestPause", .kind = plcOptPeriod, .field = AT(requestPause), .min = 1,
     .max = 1000, .unit = "ms",
     .help = "Modbus: between an answer and the next request; reads that are due sooner come late"},
    {.key = "check", .kind = plcOptChoice, .field = AT(check),
     .words = "strict|anyUnit|anyTransaction|loose",
     .help = "Modbus: what of an answer must be that of the request: unit and transaction number, or less"},
    {.key = "framing", .kind = plcOptChoice, .field = AT(framing), .words = "tcp|rtu",
     .help = "Modbus: tcp: with a header; rtu: as on a serial line, with a CRC, for converters"},
    {.key = "singleWrite", .kind = plcOptChoice, .field = AT(singleWrite),
     .words = "off|on",
     .help = "Modbus: a single one is written by function 6, a single coil by function 5"},
    {.key = "maskWrite", .kind = plcOptChoice, .field = AT(maskWrite),
     .words = "refuse|rmw",
     .help = "Modbus: single bits of a register where function 22 is missing: refuse, or read and write"},
    {.key = "heartbeatRegister", .kind = plcOptPlace, .field = AT(heartbeatRegister),
     .max = 65535, .unit = "register", .initial = PLC_OFF,
     .help = "Modbus: a holding register that counts up every `heartbeat` ms, 1000 if that is 0"},
};
/* clang-format on */

plcOptionTable plcModbusOptionTable = {.rows = rows,
                                       .count = sizeof(rows) / sizeof(rows[0]),
                                       .size = sizeof(plcModbusChoices),
                                       .of = "Modbus",
                                       .uses = "heartbeat",
                                       .usesWith = "heartbeatRegister"};
