/* A simulated PLC for the fuzz targets; see fuzzSim.h.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <string.h>

#include "fuzzSim.h"
#include "simServers.h"

int fuzzSimBuild(simulator *sim, const char *text, simText *out)
{
    int errors;

    simLogQuiet(2);
    memset(sim, 0, sizeof(*sim));
    memset(out, 0, sizeof(*out));
    simLoopInit(&sim->loop);
    simConfigInit(&sim->config);
    simServersKeys(&sim->config);
    errors = simConfigReadText(&sim->config, "t.plc", text, out);
    errors += simPlcBuild(&sim->plc[0], &sim->loop, &sim->config, simServers, "PLC", out);
    sim->count = 1;
    return errors;
}

void fuzzSimEnd(simulator *sim, simText *out)
{
    simPlcFree(&sim->plc[0]);
    simConfigFree(&sim->config);
    simLoopFree(&sim->loop);
    simTextFree(out);
}
