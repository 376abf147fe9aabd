/* simServers: the kinds of servers that a simulated PLC has. Only this list names them
 * all.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include "simServers.h"

#include "simBlockServer.h"
#include "simEipServer.h"
#include "simModbusServer.h"

const simServerType *const simServers[] = {&simBlockServerType, &simModbusServerType,
                                           &simEipServerType, NULL};

void simServersKeys(simConfig *config)
{
    size_t i;

    for (i = 0; simServers[i]; i++)
        if (simServers[i]->keys)
            simConfigAdd(config, simServers[i]->keys);
}
