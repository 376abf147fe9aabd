/* simulator: what one plcSim process holds: the loop, the configuration, the PLCs.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simulator_H
#define INC_simulator_H

#include "simConfig.h"
#include "simLoop.h"
#include "simPair.h"
#include "simPlc.h"

typedef struct simulator {
    simLoop loop;
    simConfig config;
    simPlc plc[2];   /* one, or FIRST and SECOND */
    simPair pair[2]; /* beside it, when there is a pair */
    int count;
    int isPair;
} simulator;

#endif
