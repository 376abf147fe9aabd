/* simServers: the kinds of servers that a simulated PLC has. Only this list names them
 * all.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include "simServers.h"

#include "simBlockServer.h"
#include "simEipServer.h"
#ifdef PLCSIM_MODBUS /* where libmodbus is */
#include "simModbusServer.h"
#endif

const simServerType *const simServers[] = {
    &simBlockServerType,
#ifdef PLCSIM_MODBUS
    &simModbusServerType,
#endif
    &simEipServerType,
    NULL,
};

void simServersKeys(simConfig *config)
{
    size_t i;

    for (i = 0; simServers[i]; i++)
        if (simServers[i]->keys)
            simConfigAdd(config, simServers[i]->keys);
}
