/* plcSimBuilt: a PLC of the simulator from the text of a file, for the tests of its servers.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_plcSimBuilt_H
#define INC_plcSimBuilt_H

#include "simConfig.h"
#include "simLog.h"
#include "simLoop.h"
#include "simPlc.h"

typedef struct plcSimBuilt {
    simConfig config;
    simPlc plc;
    simText messages; /* what was wrong with the text */
    int listens;
} plcSimBuilt;

/* Builds it; its servers do not listen yet. Returns the number of errors. */
int plcSimBuild(plcSimBuilt *built, simLoop *loop, const char *text);
/* Builds it, and its servers listen on 127.0.0.1; or the test ends. */
void plcSimStart(plcSimBuilt *built, simLoop *loop, const char *text);
/* The other way. */
void plcSimDismantle(plcSimBuilt *built);

#endif
