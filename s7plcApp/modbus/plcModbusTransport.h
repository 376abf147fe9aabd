/* Modbus/TCP as a transport of a station: its setup, and its table of functions. */
#ifndef INC_plcModbusTransport_H
#define INC_plcModbusTransport_H

#include "plcModbusPlan.h"
#include "plcTransport.h"

/* Which registers and bits, of which unit: the transport's own setup. The
 * transport copies it, and takes over the ranges, which come from plcRangesParse. */
typedef struct plcModbusOwn {
    int unit; /* 0 to 255 */
    plcRange *inputs;
    unsigned inputCount; /* 0: input comes by block */
    plcRange *outputs;
    unsigned outputCount;
} plcModbusOwn;

extern const plcTransport plcModbusTransport;

#endif /* INC_plcModbusTransport_H */
