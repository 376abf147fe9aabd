/* simServers: the kinds of servers that a simulated PLC has. Only this list names them
 * all.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simServers_H
#define INC_simServers_H

#include "simServer.h"

/* Ends with NULL. */
extern const simServerType *const simServers[];

/* The keys of all servers, with their defaults. */
void simServersKeys(simConfig *config);

#endif
