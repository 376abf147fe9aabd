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

/* ---- looking ---- */

static void showPlc(simCall *c, simPlc *plc)
{
    simServer *server = &plc->server;
    const simServerCounts *n = &server->counts;
    simText *out = c->out;

    simTextAdd(
        out, "%s: listening on %s, in %lu bytes, out %lu bytes, %s endian, every %g ms\n",
        plc->name, simServerAddress(server), (unsigned long)server->inSize,
        (unsigned long)server->outSize, plc->memory.bigEndian ? "big" : "little",
        plc->period * 1e3);
    simTextAdd(out, "state: %s%s%s\n", plc->off ? "off" : "on",
               plc->local ? ", LOCAL" : ", REMOTE",
               plc->freeze == freezeAll         ? ", frozen"
               : plc->freeze == freezeHeartbeat ? ", heartbeat frozen"
                                                : "");
    if (simServerConnected(server))
        simTextAdd(out, "client: %s for %.3f s\n", server->peer,
                   simNow() - server->connectTime);
    else
        simTextAdd(out, "client: none\n");
    simTextAdd(out, "connections: %llu\n", (unsigned long long)n->connections);
    simTextAdd(out, "sent: %llu blocks, %llu bytes, %llu skipped\n",
               (unsigned long long)n->blocksSent, (unsigned long long)n->bytesSent,
               (unsigned long long)n->blocksSkipped);
    simTextAdd(out, "received: %llu blocks, %llu bytes\n",
               (unsigned long long)n->blocksReceived,
               (unsigned long long)n->bytesReceived);
    if (plc->ignored)
        simTextAdd(out, "ignored as BACKUP: %llu blocks\n",
                   (unsigned long long)plc->ignored);
    simTextAdd(out, "restarts: %u\n", plc->restarts);
    simProgramStatus(&plc->program, out);
    simTextAdd(out, "faults:%s", plc->program.refuseSync ? " refuse-sync" : "");
    simServerFaultText(server, out);
    simTextAdd(out, "\n");
    simModbusStatus(&plc->modbus, out);
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

/* received: numbers and the last block. received n: the last n blocks, oldest first. */
static int doReceived(simCall *c)
{
    simPlc *plc = c->plc;
    const simServerCounts *n = &plc->server.counts;
    unsigned long wanted = 1;
    epicsUInt64 i;

    if (c->count && simCallNumber(c, 0, 1000000, &wanted))
        return -1;
    if (wanted > plc->historySize)
        wanted = plc->historySize;
    if (wanted > plc->historyCount)
        wanted = (unsigned long)plc->historyCount;
    simTextAdd(c->out, "blocks %llu bytes %llu partial %lu\n",
               (unsigned long long)n->blocksReceived,
               (unsigned long long)n->bytesReceived, (unsigned long)plc->server.filled);
    for (i = plc->historyCount - wanted; i < plc->historyCount; i++) {
        const simReceived *block = &plc->history[i % plc->historySize];

        simTextAdd(c->out, "%llu %.6f ", (unsigned long long)i + 1, block->time);
        simTextHex(c->out, block->bytes, plc->server.outSize);
        simTextAdd(c->out, "\n");
    }
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

static int doPeriod(simCall *c)
{
    double seconds;

    if (simCallTime(c, 0, 1e-4, &seconds))
        return -1;
    simPlcPeriod(c->plc, seconds);
    return 0;
}

/* signal and mirror: the words before are the command's name and belong to the statement.
 */
static int doStatement(simCall *c)
{
    return simPlcStatement(c->plc, c->words - 1, c->count + 1, c->error);
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
    {"help", 0, 1, doHelp, 0, "[command]", "this list"},
    {"status", 0, 0, doStatus, 0, "", "connections, blocks, faults"},
    {"get", 1, 3, doGet, 0, "<address> [type]", "a value in PLC memory: get in 4 INT16"},
    {"set", 2, SIM_MAX_WORDS, doSet, 1, "<address> [type] <value> ...",
     "change it: set DB10.DBW4 5"},
    {"hmi", 2, SIM_MAX_WORDS, doHmi, 0, "[receive|check] <address> [type] <value>",
     "the HMI sets a value, now or at that moment"},
    {"dump", 1, 1, doDump, 0, "in|out|<block>", "all bytes of a block"},
    {"received", 0, 1, doReceived, 0, "[n]",
     "number of blocks from the IOC and the last n"},
    {"signal", 3, SIM_MAX_WORDS, doStatement, 1, "<address> <type> <kind> ...",
     "one more signal, as in the file"},
    {"mirror", 4, 4, doStatement, 1, "<offset> <length> -> <offset>",
     "one more read-back, as in the file"},
    {"period", 1, 1, doPeriod, 1, "<ms>", "time from block to block"},
    {"modbus", 0, SIM_MAX_WORDS, simDoModbus, 0, "[<word> ...]",
     "Modbus: its status; faults and more: modbus help"},
    {"restart", 0, 3, doRestart, 1, "[n] [ms] [cold]",
     "power the PLC (of a pair: n) off and on"},
    {"switchover", 0, 0, doSwitchover, 1, "", "the PRIMARY hands over to the BACKUP"},
    {"twoprimaries", 0, 1, doTwoPrimaries, 1, "[on|off]",
     "the fibre is cut and both lead"},
    {"local", 0, 0, doLocal, 1, "", "the HMI has control"},
    {"remote", 0, 0, doRemote, 1, "", "the IOC has control"},
    {"quit", 0, 0, doQuit, 1, "", "end the simulator"},
};
/* clang-format on */

static const struct list {
    const simCommand *commands;
    size_t count;
} lists[] = {
    {commands,         sizeof(commands) / sizeof(commands[0])},
    {simFaultCommands, SIM_FAULT_COMMANDS                    },
};

static const simCommand *findCommand(const char *name)
{
    size_t i, k;

    for (k = 0; k < 2; k++)
        for (i = 0; i < lists[k].count; i++)
            if (!strcasecmp(name, lists[k].commands[i].name))
                return &lists[k].commands[i];
    return NULL;
}

static void helpLine(const simCommand *command, simText *out)
{
    char what[64];

    snprintf(what, sizeof(what), "%s %s", command->name, command->usage);
    simTextAdd(out, "  %-38s %s\n", what, command->help);
}

static int doHelp(simCall *c)
{
    size_t i, k;

    if (c->count) {
        const simCommand *command = findCommand(c->words[0]);

        if (!command)
            return simCallFail(c, "\"%.40s\" is no command", c->words[0]);
        helpLine(command, c->out);
        return 0;
    }
    for (k = 0; k < 2; k++)
        for (i = 0; i < lists[k].count; i++)
            helpLine(&lists[k].commands[i], c->out);
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

    if (choosePlc(c))
        return -1;
    command = findCommand(c->words[0]);
    if (!command)
        return simCallFail(c, "\"%.40s\" is no command; try help", c->words[0]);
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
