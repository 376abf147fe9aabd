/* simModbusServer: Modbus as a server of a PLC: its keys, its statement and its command.
 * What they do is done elsewhere.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simModbusServer_H
#define INC_simModbusServer_H

#include "simModbus.h"
#include "simPlc.h"

/* Of the file. */
typedef struct simModbusKeys {
    int port; /* -1 = no Modbus, 0 = any free one */
    int unit; /* -1 = any */
    int gateway;
} simModbusKeys;

typedef struct simModbusServer {
    simPlc *plc;
    const simModbusKeys *keys;
    simModbus modbus;
} simModbusServer;

extern const simServerType simModbusServerType;

#endif
