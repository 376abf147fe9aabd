/* simCommand: the commands of the console, as one table. It does not know who types.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "simCall.h"
#include "simCommand.h"
#include "simValue.h"

/* ---- looking ---- */

static void showPlc(simCall *c, simPlc *plc)
{
    simText *out = c->out;
    size_t i;

    simTextAdd(out, "%s: %s endian, every %g ms\n", plc->name,
               plc->memory.bigEndian ? "big" : "little", plc->period * 1e3);
    simTextAdd(out, "state: %s%s%s\n", plc->off ? "off" : "on",
               plc->local ? ", LOCAL" : ", REMOTE",
               plc->freeze == freezeAll         ? ", frozen"
               : plc->freeze == freezeHeartbeat ? ", heartbeat frozen"
                                                : "");
    simTextAdd(out, "restarts: %u\n", plc->restarts);
    simProgramStatus(&plc->program, out);
    for (i = 0; i < plc->serverCount; i++)
        if (plc->servers[i].type->status)
            plc->servers[i].type->status(plc->servers[i].state, out);
}

static int doStatus(simCall *c)
{
    int i;

    for (i = 0; i < c->sim->count; i++) {
        if (c->sim->isPair && c->chosen && c->plc != &c->sim->plc[i])
            continue;
        showPlc(c, &c->sim->plc[i]);
        if (c->sim->isPair)
            simPairStatus(&c->sim->pair[i], c->out);
    }
    return 0;
}

static int doGet(simCall *c)
{
    simPlace place;
    simType type;
    int used = simPlcPlace(c->plc, c->words, c->count, &place, &type, c->error);
    size_t i;

    if (used < 0)
        return -1;
    if ((size_t)used < c->count)
        return simCallFail(c, "too many words");
    for (i = 0; i < c->count; i++)
        simTextAdd(c->out, "%s ", c->words[i]);
    simTextAdd(c->out, "= ");
    simValueGet(&c->plc->memory, &place, &type, c->out);
    simTextAdd(c->out, "\n");
    return 0;
}

static int doSet(simCall *c)
{
    return simPlcSet(c->plc, c->words, c->count, c->error);
}

static int doDump(simCall *c)
{
    const simMemory *mem = &c->plc->memory;
    simBlock *block = NULL;
    unsigned number;
    char rest;

    if (c->count == 1) {
        block = simMemoryFindName(mem, c->words[0]);
        if (!block && sscanf(c->words[0], "%*1[dD]%*1[bB]%5u%c", &number, &rest) == 1)
            block = simMemoryFind(mem, SIM_AREA_DB, number);
    }
    if (!block)
        return simCallFail(c, "allowed are in, out, DB10 or the name of a block");
    simTextDump(c->out, block->bytes, block->size);
    return 0;
}

/* hmi [receive|check] <address> [type] <value> */
static int doHmi(simCall *c)
{
    simPoint point = !strcasecmp(c->words[0], "receive") ? pointReceive
                     : !strcasecmp(c->words[0], "check") ? pointCheck
                                                         : pointNone;
    int named = point != pointNone;

    return simPlcHmi(c->plc, point, c->words + named, c->count - (size_t)named, c->error);
}

/* ---- the PLC ---- */

/* restart [n] [ms] [cold]; n only where there is a pair. */
static int doRestart(simCall *c)
{
    double seconds = c->plc->config->restartTime;
    int cold = c->count && !strcasecmp(c->words[c->count - 1], "cold");
    simPlc *plc = c->plc;

    c->count -= (size_t)cold;
    if (c->sim->isPair && c->count) {
        plc = simCallPlc(c);
        if (!plc)
            return -1;
        c->words++;
        c->count--;
    }
    if (c->count > 1)
        return simCallFail(c, "too many words");
    if (c->count && simCallTime(c, 0, 0, &seconds))
        return -1;
    simPlcRestart(plc, seconds, cold);
    return 0;
}

static int noPair(simCall *c)
{
    return simCallFail(c, "this PLC has no partner: role = pair makes one");
}

static int doSwitchover(simCall *c)
{
    int i;

    if (!c->sim->isPair)
        return noPair(c);
    for (i = 0; i < c->sim->count; i++)
        if (c->sim->pair[i].isPrimary)
            return simPairSwitch(&c->sim->pair[i], c->error);
    return simCallFail(c, "there is no PRIMARY here");
}

static int doTwoPrimaries(simCall *c)
{
    int on, i;

    if (!c->sim->isPair)
        return noPair(c);
    if (simCallOnOff(c, &on))
        return -1;
    for (i = 0; i < c->sim->count; i++)
        simPairSplit(&c->sim->pair[i], on);
    return 0;
}

static int doLocal(simCall *c)
{
    simPlcLocal(c->plc, 1);
    return 0;
}

static int doRemote(simCall *c)
{
    simPlcLocal(c->plc, 0);
    return 0;
}

static int doAllowMap(simCall *c)
{
    int on;

    if (simCallOnOff(c, &on))
        return -1;
    c->plc->program.tables.allow = on;
    simPlcCall(c->plc, NULL);
    return 0;
}

static int doPeriod(simCall *c)
{
    double seconds;

    if (simCallTime(c, 0, 1e-4, &seconds))
        return -1;
    simPlcPeriod(c->plc, seconds);
    return 0;
}

static int doSignal(simCall *c)
{
    return simPlcSignal(c->plc, c->words, c->count, c->error);
}

static int doNormal(simCall *c)
{
    simPlcNormal(c->plc);
    return 0;
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
    simPlcUnplug(plc, 1);
    return 0;
}

static int doPlug(simCall *c)
{
    simPlc *plc = simCallPlc(c);

    if (!plc)
        return -1;
    simPlcUnplug(plc, 0);
    return 0;
}

static int doQuit(simCall *c)
{
    c->sim->loop.quit = 1;
    return 0;
}

static int doHelp(simCall *c);

/* ---- the table ---- */

/* clang-format off */
static const simCommand commands[] = {
    {.name = "help", .max = 1, .fn = doHelp, .usage = "[command]", .help = "this list"},
    {.name = "status", .fn = doStatus, .usage = "",
     .help = "connections, blocks, faults"},
    {.name = "get", .min = 1, .max = 3, .fn = doGet, .usage = "<address> [type]",
     .help = "a value in PLC memory: get in 4 INT16"},
    {.name = "set", .min = 2, .max = SIM_MAX_WORDS, .fn = doSet, .logged = 1,
     .usage = "<address> [type] <value> ...", .help = "change it: set DB10.DBW4 5"},
    {.name = "hmi", .min = 2, .max = SIM_MAX_WORDS, .fn = doHmi,
     .usage = "[receive|check] <address> [type] <value>",
     .help = "the HMI sets a value, now or at that moment"},
    {.name = "dump", .min = 1, .max = 1, .fn = doDump, .usage = "in|out|<block>",
     .help = "all bytes of a block"},
    {.name = "signal", .min = 3, .max = SIM_MAX_WORDS, .fn = doSignal, .logged = 1,
     .usage = "<address> <type> <kind> ...", .help = "one more signal, as in the file"},
    {.name = "period", .min = 1, .max = 1, .fn = doPeriod, .logged = 1, .usage = "<ms>",
     .help = "time from block to block"},
    {.name = "unplug", .max = 1, .fn = doUnplug, .logged = 1, .usage = "[n]",
     .help = "pull the network cable of PLC n"},
    {.name = "plug", .max = 1, .fn = doPlug, .logged = 1, .usage = "[n]",
     .help = "put it back"},
    {.name = "freeze", .max = 1, .fn = doFreeze, .logged = 1,
     .usage = "[heartbeat|all]", .help = "counters, or all signals, stand still"},
    {.name = "unfreeze", .fn = doUnfreeze, .logged = 1, .usage = "",
     .help = "they move again"},
    {.name = "normal", .fn = doNormal, .logged = 1, .usage = "",
     .help = "end all faults"},
    {.name = "restart", .max = 3, .fn = doRestart, .logged = 1,
     .usage = "[n] [ms] [cold]", .help = "power the PLC (of a pair: n) off and on"},
    {.name = "switchover", .fn = doSwitchover, .logged = 1, .usage = "",
     .help = "the PRIMARY hands over to the BACKUP"},
    {.name = "twoprimaries", .max = 1, .fn = doTwoPrimaries, .logged = 1,
     .usage = "[on|off]", .help = "the fibre is cut and both lead"},
    {.name = "local", .fn = doLocal, .logged = 1, .usage = "",
     .help = "the HMI has control"},
    {.name = "remote", .fn = doRemote, .logged = 1, .usage = "",
     .help = "the IOC has control"},
    {.name = "allowmap", .max = 1, .fn = doAllowMap, .logged = 1, .usage = "[on|off]",
     .help = "the key switch: the IOC may bring a table of pointers"},
    {.name = "quit", .fn = doQuit, .logged = 1, .usage = "",
     .help = "end the simulator"},
};
/* clang-format on */

#define OWN_COUNT (sizeof(commands) / sizeof(commands[0]))

static const simCommand *findIn(const simCommand *list, size_t count, const char *name)
{
    size_t i;

    for (i = 0; i < count; i++)
        if (!strcasecmp(name, list[i].name))
            return &list[i];
    return NULL;
}

/* One of our own, or of a server, which is stored then. */
static const simCommand *findCommand(const simPlc *plc, const char *name,
                                     const simPlcServer **server)
{
    const simCommand *command = findIn(commands, OWN_COUNT, name);
    size_t i;

    *server = NULL;
    for (i = 0; i < plc->serverCount && !command; i++) {
        *server = &plc->servers[i];
        command = findIn((*server)->type->commands, (*server)->type->commandCount, name);
    }
    return command;
}

static void helpLine(const simCommand *command, simText *out)
{
    char what[64];

    snprintf(what, sizeof(what), "%s %s", command->name, command->usage);
    simTextAdd(out, "  %-38s %s\n", what, command->help);
}

static void helpList(const simCommand *list, size_t count, simText *out)
{
    size_t i;

    for (i = 0; i < count; i++)
        helpLine(&list[i], out);
}

static int doHelp(simCall *c)
{
    const simPlcServer *server;
    size_t i;

    if (c->count) {
        const simCommand *command = findCommand(c->plc, c->words[0], &server);

        if (!command)
            return simCallFail(c, "\"%.40s\" is no command", c->words[0]);
        helpLine(command, c->out);
        return 0;
    }
    helpList(commands, OWN_COUNT, c->out);
    for (i = 0; i < c->plc->serverCount; i++)
        helpList(c->plc->servers[i].type->commands, c->plc->servers[i].type->commandCount,
                 c->out);
    return 0;
}

/* "first", "second" in front of a command choose the PLC; else it is the PRIMARY. */
static int choosePlc(simCall *c)
{
    int isFirst = !strcasecmp(c->words[0], "first");
    int i;

    c->plc = &c->sim->plc[0];
    for (i = 0; i < c->sim->count; i++)
        if (c->sim->isPair && c->sim->pair[i].isPrimary)
            c->plc = &c->sim->plc[i];
    if (!isFirst && strcasecmp(c->words[0], "second"))
        return 0;
    c->plc = simCallPlcByNumber(c->sim, isFirst ? 1 : 2);
    if (!c->plc)
        return simCallFail(c, "%s is not in this process", c->words[0]);
    c->chosen = 1;
    c->words++;
    c->count--;
    return c->count ? 0 : simCallFail(c, "a command is missing");
}

static int run(simCall *c)
{
    const simCommand *command;
    const simPlcServer *server;

    if (choosePlc(c))
        return -1;
    command = findCommand(c->plc, c->words[0], &server);
    if (!command)
        return simCallFail(c, "\"%.40s\" is no command; try help", c->words[0]);
    if (server && !server->type->address(server->state))
        return simCallFail(c, "%s", server->type->off);
    c->words++;
    c->count--;
    if (c->count < command->min || c->count > command->max)
        return simCallFail(c, "usage: %s %s", command->name, command->usage);
    if (command->logged)
        simCallLog(c, command->name);
    return command->fn(c);
}

void simCommandRun(simulator *sim, char *line, simText *out)
{
    char *words[SIM_MAX_WORDS];
    simCall c;
    int count, i;

    memset(&c, 0, sizeof(c));
    c.sim = sim;
    c.words = words;
    c.out = out;
    count = simSplit(line, words, SIM_MAX_WORDS, c.error);
    if (count == 0)
        return;
    c.count = count > 0 ? (size_t)count : 0;
    if (count > 0 && run(&c) == 0)
        c.error[0] = 0;
    else
        count = -1;
    for (i = 0; sim->isPair && i < sim->count; i++)
        simPairPoll(&sim->pair[i]);
    if (count < 0)
        simTextAdd(out, "error: %s\n", c.error);
    else
        simTextAdd(out, "ok\n");
}
