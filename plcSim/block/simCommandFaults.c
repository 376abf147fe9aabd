/* simCommandFaults: the commands that make things go wrong. What they do is done
 * elsewhere.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <strings.h>

#include "simCall.h"

static int doSilence(simCall *c)
{
    int on;

    if (simCallOnOff(c, &on))
        return -1;
    simServerSilence(&c->plc->server, on);
    return 0;
}

static int doRefuse(simCall *c)
{
    int sync = c->count && !strcasecmp(c->words[0], "sync");
    int on;

    c->words += sync;
    c->count -= (size_t)sync;
    if (simCallOnOff(c, &on))
        return -1;
    if (sync) {
        c->plc->program.refuseSync = on;
        return 0;
    }
    simServerRefuse(&c->plc->server, on);
    return 0;
}

static int doStall(simCall *c)
{
    int on;

    if (simCallOnOff(c, &on))
        return -1;
    simServerStall(&c->plc->server, on);
    return 0;
}

static int doFlood(simCall *c)
{
    int on;

    if (simCallOnOff(c, &on))
        return -1;
    simServerFlood(&c->plc->server, on);
    return 0;
}

static int doClose(simCall *c)
{
    simServerDrop(&c->plc->server, 0, "closed at the console");
    return 0;
}

static int doReset(simCall *c)
{
    simServerDrop(&c->plc->server, 1, "reset at the console");
    return 0;
}

static int doFragment(simCall *c)
{
    unsigned long bytes = 0;
    double pause = 1e-3;

    if (!simCallIsOff(c) && (simCallNumber(c, 0, SIM_MAX_BLOCK, &bytes) ||
                             (c->count > 1 && simCallTime(c, 1, 0, &pause))))
        return -1;
    simServerFragment(&c->plc->server, bytes, pause);
    return 0;
}

static int doDelay(simCall *c)
{
    double seconds = 0;

    if (!simCallIsOff(c) && simCallTime(c, 0, 0, &seconds))
        return -1;
    simServerDelay(&c->plc->server, seconds);
    return 0;
}

static int doTruncate(simCall *c)
{
    unsigned long bytes;

    if (simCallIsOff(c)) {
        c->plc->server.faults.truncate = -1;
        return 0;
    }
    if (simCallNumber(c, 0, 2 * SIM_MAX_BLOCK, &bytes))
        return -1;
    c->plc->server.faults.truncate = (long)bytes;
    return 0;
}

static int doCut(simCall *c)
{
    unsigned long bytes;

    if (simCallIsOff(c)) {
        c->plc->server.faults.cut = -1;
        return 0;
    }
    if (simCallNumber(c, 0, 1000000000, &bytes))
        return -1;
    if (bytes == 0)
        return doReset(c);
    c->plc->server.faults.cut = (long)bytes;
    return 0;
}

static int doGarbage(simCall *c)
{
    unsigned long bytes;

    if (simCallNumber(c, 0, 1000000, &bytes))
        return -1;
    if (simServerGarbage(&c->plc->server, bytes))
        return simCallFail(c, "no client, or too much is waiting to be sent");
    return 0;
}

static int doNormal(simCall *c)
{
    c->plc->freeze = freezeNothing;
    c->plc->program.refuseSync = 0;
    simServerClearFaults(&c->plc->server);
    simModbusUnplug(&c->plc->modbus, 0);
    return simModbusNormal(c);
}

static int doFreeze(simCall *c)
{
    if (c->count == 0 || !strcasecmp(c->words[0], "all"))
        c->plc->freeze = freezeAll;
    else if (!strcasecmp(c->words[0], "heartbeat"))
        c->plc->freeze = freezeHeartbeat;
    else
        return simCallFail(c, "allowed are heartbeat and all");
    return 0;
}

static int doUnfreeze(simCall *c)
{
    c->plc->freeze = freezeNothing;
    return 0;
}

static int doUnplug(simCall *c)
{
    simPlc *plc = simCallPlc(c);

    if (!plc)
        return -1;
    simServerUnplug(&plc->server, 1);
    simModbusUnplug(&plc->modbus, 1);
    return 0;
}

static int doPlug(simCall *c)
{
    simPlc *plc = simCallPlc(c);

    if (!plc)
        return -1;
    simServerUnplug(&plc->server, 0);
    simModbusUnplug(&plc->modbus, 0);
    return 0;
}

/* clang-format off */
const simCommand simFaultCommands[SIM_FAULT_COMMANDS] = {
    {"silence", 0, 1, doSilence, 1, "[on|off]", "send nothing"},
    {"close", 0, 0, doClose, 1, "", "end the connection with FIN"},
    {"reset", 0, 0, doReset, 1, "", "end the connection with RST"},
    {"refuse", 0, 2, doRefuse, 1, "[sync] [on|off]", "refuse new connections, or SYNC"},
    {"stall", 0, 1, doStall, 1, "[on|off]", "read nothing"},
    {"unplug", 0, 1, doUnplug, 1, "[n]", "pull the network cable of PLC n"},
    {"plug", 0, 1, doPlug, 1, "[n]", "put it back"},
    {"fragment", 1, 2, doFragment, 1, "<bytes> [ms] | off", "send in pieces, ms apart"},
    {"delay", 1, 1, doDelay, 1, "<ms> | off", "each block leaves ms late"},
    {"truncate", 1, 1, doTruncate, 1, "<bytes> | off", "send blocks of another size"},
    {"garbage", 1, 1, doGarbage, 1, "<bytes>", "send random bytes once"},
    {"cut", 1, 1, doCut, 1, "<bytes> | off",
     "reset the connection after so many bytes came"},
    {"flood", 0, 1, doFlood, 1, "[on|off]", "send as fast as the socket takes"},
    {"freeze", 0, 1, doFreeze, 1, "[heartbeat|all]",
     "counters, or all signals, stand still"},
    {"unfreeze", 0, 0, doUnfreeze, 1, "", "they move again"},
    {"normal", 0, 0, doNormal, 1, "", "end all faults"},
};
/* clang-format on */
