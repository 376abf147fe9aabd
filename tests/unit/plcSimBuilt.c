/* plcSimBuilt: a PLC of the simulator from the text of a file; see plcSimBuilt.h.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <epicsUnitTest.h>

#include "plcSimBuilt.h"
#include "simServers.h"

int plcSimBuild(plcSimBuilt *built, simLoop *loop, const char *text)
{
    int errors;

    simLoopInit(loop);
    simConfigInit(&built->config);
    simServersKeys(&built->config);
    errors = simConfigReadText(&built->config, "t.plc", text, &built->messages);
    return errors + simPlcBuild(&built->plc, loop, &built->config, simServers, "PLC",
                                &built->messages);
}

void plcSimStart(plcSimBuilt *built, simLoop *loop, const char *text)
{
    if (plcSimBuild(built, loop, text) || simPlcStart(&built->plc, "127.0.0.1", NULL))
        testAbort("%s", built->messages.text ? built->messages.text : "cannot listen");
    built->listens = 1;
}

void plcSimDismantle(plcSimBuilt *built)
{
    if (built->listens)
        simPlcStop(&built->plc);
    built->listens = 0;
    simPlcFree(&built->plc);
    simConfigFree(&built->config);
    simTextFree(&built->messages);
}
