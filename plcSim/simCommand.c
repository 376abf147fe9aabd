/* simCommand: the commands of the console, as one table. It does not know who types.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <ctype.h>
#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "simCommand.h"

/* What a command works on. */
typedef struct call {
    simulator *sim;
    simPlc *plc;
    int chosen;   /* by a word in front: "second status" */
    char **words; /* behind the command's name */
    size_t count;
    simText *out;
    char error[SIM_ERROR_SIZE];
} call;

typedef int (*commandFn)(call *c);

static int fail(call *c, const char *format, ...) EPICS_PRINTF_STYLE(2, 3);

static int fail(call *c, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    vsnprintf(c->error, sizeof(c->error), format, args);
    va_end(args);
    return -1;
}

/* ---- arguments ---- */

/* The one argument is on or off; none means on. */
static int onOff(call *c, int *on)
{
    *on = 1;
    if (c->count == 0)
        return 0;
    if (c->count == 1 && !strcasecmp(c->words[0], "on"))
        return 0;
    *on = 0;
    if (c->count == 1 && !strcasecmp(c->words[0], "off"))
        return 0;
    return fail(c, "allowed is on or off");
}

static int numberArg(call *c, size_t index, unsigned long max, unsigned long *value)
{
    char *end;

    *value = 0;
    if (index >= c->count)
        return fail(c, "a number is missing");
    errno = 0;
    *value = strtoul(c->words[index], &end, 10);
    if (!isdigit((unsigned char)c->words[index][0]) || *end || errno || *value > max)
        return fail(c, "\"%.40s\": allowed is a number 0 ... %lu", c->words[index], max);
    return 0;
}

static int timeArg(call *c, size_t index, double min, double *seconds)
{
    if (index >= c->count)
        return fail(c, "a time in ms is missing");
    if (simTimeParse(c->words[index], seconds, c->error))
        return -1;
    if (*seconds < min || *seconds > 3600)
        return fail(c, "%.40s: allowed is %g ms ... 1 h", c->words[index], min * 1e3);
    return 0;
}

static int isOff(const call *c)
{
    return c->count == 1 && !strcasecmp(c->words[0], "off");
}

/* ---- looking ---- */

static void showPlc(call *c, simPlc *plc)
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

static int doStatus(call *c)
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

static int doGet(call *c)
{
    simPlace place;
    simType type;
    int used = simPlcPlace(c->plc, c->words, c->count, &place, &type, c->error);
    size_t i;

    if (used < 0)
        return -1;
    if ((size_t)used < c->count)
        return fail(c, "too many words");
    for (i = 0; i < c->count; i++)
        simTextAdd(c->out, "%s ", c->words[i]);
    simTextAdd(c->out, "= ");
    simValueGet(&c->plc->memory, &place, &type, c->out);
    simTextAdd(c->out, "\n");
    return 0;
}

static int doSet(call *c)
{
    return simPlcSet(c->plc, c->words, c->count, c->error);
}

static int doDump(call *c)
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
        return fail(c, "allowed are in, out, DB10 or the name of a block");
    simTextDump(c->out, block->bytes, block->size);
    return 0;
}

/* received: numbers and the last block. received n: the last n blocks, oldest first. */
static int doReceived(call *c)
{
    simPlc *plc = c->plc;
    const simServerCounts *n = &plc->server.counts;
    unsigned long wanted = 1;
    epicsUInt64 i;

    if (c->count && numberArg(c, 0, 1000000, &wanted))
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
static int doHmi(call *c)
{
    simPoint point = !strcasecmp(c->words[0], "receive") ? pointReceive
                     : !strcasecmp(c->words[0], "check") ? pointCheck
                                                         : pointNone;
    int named = point != pointNone;

    return simPlcHmi(c->plc, point, c->words + named, c->count - (size_t)named, c->error);
}

/* ---- Modbus ---- */

/* modbus received [n] */
static int modbusReceived(call *c)
{
    unsigned long wanted = 1;

    if (c->count > 1 && numberArg(c, 1, 1000000, &wanted))
        return -1;
    simModbusReceived(&c->plc->modbus, wanted, c->out);
    return 0;
}

static int modbusRefuse(call *c)
{
    int on;

    c->words++;
    c->count--;
    if (onOff(c, &on))
        return -1;
    simModbusRefuse(&c->plc->modbus, on);
    return 0;
}

static int modbusClose(call *c)
{
    simModbusDrop(&c->plc->modbus, !strcasecmp(c->words[0], "reset"),
                  "ended at the console");
    return 0;
}

static int modbusNormal(call *c)
{
    simModbusFaultsClear(&c->plc->modbus.faults);
    simModbusRefuse(&c->plc->modbus, 0);
    return 0;
}

static int modbusClear(call *c)
{
    simModbusClearCounts(&c->plc->modbus);
    return 0;
}

static const struct modbusCommand {
    const char *name;
    size_t max; /* words, with the name */
    commandFn fn;
} modbusCommands[] = {
    {"received", 2, modbusReceived}, {"refuse", 2, modbusRefuse},
    {"close", 1, modbusClose},       {"reset", 1, modbusClose},
    {"normal", 1, modbusNormal},     {"clear", 1, modbusClear},
};

/* Without a word: the status. The rest are faults. */
static int doModbus(call *c)
{
    simModbus *modbus = &c->plc->modbus;
    size_t i;

    if (!modbus->loop)
        return fail(c, "this PLC has no Modbus: modbus_port in the file switches it on");
    if (!c->count) {
        simModbusStatus(modbus, c->out);
        return 0;
    }
    for (i = 0; i < sizeof(modbusCommands) / sizeof(modbusCommands[0]); i++)
        if (!strcasecmp(c->words[0], modbusCommands[i].name) &&
            c->count <= modbusCommands[i].max)
            return modbusCommands[i].fn(c);
    if (!simModbusFaultKnown(c->words[0]))
        return fail(c, "\"%.40s\": allowed are exception, busy, slow, silent, wrongunit, "
                    "wrongid, short, close, garbage, reset, refuse, normal, received, "
                    "clear", c->words[0]);
    return simModbusFaultParse(&modbus->faults, c->words, c->count, c->error);
}

/* ---- faults ---- */

static int doSilence(call *c)
{
    int on;

    if (onOff(c, &on))
        return -1;
    simServerSilence(&c->plc->server, on);
    return 0;
}

static int doRefuse(call *c)
{
    int sync = c->count && !strcasecmp(c->words[0], "sync");
    int on;

    c->words += sync;
    c->count -= (size_t)sync;
    if (onOff(c, &on))
        return -1;
    if (sync) {
        c->plc->program.refuseSync = on;
        return 0;
    }
    simServerRefuse(&c->plc->server, on);
    return 0;
}

static int doStall(call *c)
{
    int on;

    if (onOff(c, &on))
        return -1;
    simServerStall(&c->plc->server, on);
    return 0;
}

static int doFlood(call *c)
{
    int on;

    if (onOff(c, &on))
        return -1;
    simServerFlood(&c->plc->server, on);
    return 0;
}

static int doClose(call *c)
{
    simServerDrop(&c->plc->server, 0, "closed at the console");
    return 0;
}

static int doReset(call *c)
{
    simServerDrop(&c->plc->server, 1, "reset at the console");
    return 0;
}

static int doFragment(call *c)
{
    unsigned long bytes = 0;
    double pause = 1e-3;

    if (!isOff(c) && (numberArg(c, 0, SIM_MAX_BLOCK, &bytes) ||
                      (c->count > 1 && timeArg(c, 1, 0, &pause))))
        return -1;
    simServerFragment(&c->plc->server, bytes, pause);
    return 0;
}

static int doDelay(call *c)
{
    double seconds = 0;

    if (!isOff(c) && timeArg(c, 0, 0, &seconds))
        return -1;
    simServerDelay(&c->plc->server, seconds);
    return 0;
}

static int doTruncate(call *c)
{
    unsigned long bytes;

    if (isOff(c)) {
        c->plc->server.faults.truncate = -1;
        return 0;
    }
    if (numberArg(c, 0, 2 * SIM_MAX_BLOCK, &bytes))
        return -1;
    c->plc->server.faults.truncate = (long)bytes;
    return 0;
}

static int doCut(call *c)
{
    unsigned long bytes;

    if (isOff(c)) {
        c->plc->server.faults.cut = -1;
        return 0;
    }
    if (numberArg(c, 0, 1000000000, &bytes))
        return -1;
    if (bytes == 0)
        return doReset(c);
    c->plc->server.faults.cut = (long)bytes;
    return 0;
}

static int doGarbage(call *c)
{
    unsigned long bytes;

    if (numberArg(c, 0, 1000000, &bytes))
        return -1;
    if (simServerGarbage(&c->plc->server, bytes))
        return fail(c, "no client, or too much is waiting to be sent");
    return 0;
}

static int doNormal(call *c)
{
    c->plc->freeze = freezeNothing;
    c->plc->program.refuseSync = 0;
    simServerClearFaults(&c->plc->server);
    simModbusUnplug(&c->plc->modbus, 0);
    return modbusNormal(c);
}

static int doFreeze(call *c)
{
    if (c->count == 0 || !strcasecmp(c->words[0], "all"))
        c->plc->freeze = freezeAll;
    else if (!strcasecmp(c->words[0], "heartbeat"))
        c->plc->freeze = freezeHeartbeat;
    else
        return fail(c, "allowed are heartbeat and all");
    return 0;
}

static int doUnfreeze(call *c)
{
    c->plc->freeze = freezeNothing;
    return 0;
}

/* The pair's half that is FIRST (1) or SECOND (2); a single PLC is 1. NULL: not here. */
static simPlc *plcByNumber(simulator *sim, unsigned long number)
{
    int i;

    if (!sim->isPair)
        return number == 1 ? &sim->plc[0] : NULL;
    for (i = 0; i < sim->count; i++)
        if (sim->pair[i].isFirst == (number == 1))
            return &sim->plc[i];
    return NULL;
}

/* The PLC that the last argument numbers, or the one the command is for. */
static simPlc *numberedPlc(call *c)
{
    unsigned long number;
    simPlc *plc;

    if (!c->count)
        return c->plc;
    if (numberArg(c, 0, 2, &number))
        return NULL;
    plc = number ? plcByNumber(c->sim, number) : NULL;
    if (!plc)
        fail(c, "PLC %lu is not in this process", number);
    return plc;
}

static int doUnplug(call *c)
{
    simPlc *plc = numberedPlc(c);

    if (!plc)
        return -1;
    simServerUnplug(&plc->server, 1);
    simModbusUnplug(&plc->modbus, 1);
    return 0;
}

static int doPlug(call *c)
{
    simPlc *plc = numberedPlc(c);

    if (!plc)
        return -1;
    simServerUnplug(&plc->server, 0);
    simModbusUnplug(&plc->modbus, 0);
    return 0;
}

/* ---- the PLC ---- */

/* restart [n] [ms] [cold]; n only where there is a pair. */
static int doRestart(call *c)
{
    double seconds = c->plc->config->restartTime;
    int cold = c->count && !strcasecmp(c->words[c->count - 1], "cold");
    simPlc *plc = c->plc;

    c->count -= (size_t)cold;
    if (c->sim->isPair && c->count) {
        plc = numberedPlc(c);
        if (!plc)
            return -1;
        c->words++;
        c->count--;
    }
    if (c->count > 1)
        return fail(c, "too many words");
    if (c->count && timeArg(c, 0, 0, &seconds))
        return -1;
    simPlcRestart(plc, seconds, cold);
    return 0;
}

static int noPair(call *c)
{
    return fail(c, "this PLC has no partner: role = pair makes one");
}

static int doSwitchover(call *c)
{
    int i;

    if (!c->sim->isPair)
        return noPair(c);
    for (i = 0; i < c->sim->count; i++)
        if (c->sim->pair[i].isPrimary)
            return simPairSwitch(&c->sim->pair[i], c->error);
    return fail(c, "there is no PRIMARY here");
}

static int doTwoPrimaries(call *c)
{
    int on, i;

    if (!c->sim->isPair)
        return noPair(c);
    if (onOff(c, &on))
        return -1;
    for (i = 0; i < c->sim->count; i++)
        simPairSplit(&c->sim->pair[i], on);
    return 0;
}

static int doLocal(call *c)
{
    simPlcLocal(c->plc, 1);
    return 0;
}

static int doRemote(call *c)
{
    simPlcLocal(c->plc, 0);
    return 0;
}

static int doPeriod(call *c)
{
    double seconds;

    if (timeArg(c, 0, 1e-4, &seconds))
        return -1;
    simPlcPeriod(c->plc, seconds);
    return 0;
}

/* signal and mirror: the words before are the command's name and belong to the statement.
 */
static int doStatement(call *c)
{
    return simPlcStatement(c->plc, c->words - 1, c->count + 1, c->error);
}

static int doQuit(call *c)
{
    c->sim->loop.quit = 1;
    return 0;
}

static int doHelp(call *c);

/* ---- the table ---- */

/* clang-format off */
static const struct command {
    const char *name;
    size_t min, max; /* arguments */
    commandFn fn;
    int logged;
    const char *usage;
    const char *help;
} commands[] = {
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
    {"modbus", 0, SIM_MAX_WORDS, doModbus, 1, "[<fault> ... | received [n] | ...]",
     "Modbus: status, faults, last requests"},
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

static const struct command *findCommand(const char *name)
{
    size_t i;

    for (i = 0; i < sizeof(commands) / sizeof(commands[0]); i++)
        if (!strcasecmp(name, commands[i].name))
            return &commands[i];
    return NULL;
}

static void helpLine(const struct command *command, simText *out)
{
    char what[64];

    snprintf(what, sizeof(what), "%s %s", command->name, command->usage);
    simTextAdd(out, "  %-38s %s\n", what, command->help);
}

static int doHelp(call *c)
{
    size_t i;

    if (c->count) {
        const struct command *command = findCommand(c->words[0]);

        if (!command)
            return fail(c, "\"%.40s\" is no command", c->words[0]);
        helpLine(command, c->out);
        return 0;
    }
    for (i = 0; i < sizeof(commands) / sizeof(commands[0]); i++)
        helpLine(&commands[i], c->out);
    return 0;
}

static void logCall(const call *c, const char *name)
{
    simText text = {NULL, 0, 0};
    size_t i;

    for (i = 0; i < c->count; i++)
        simTextAdd(&text, " %s", c->words[i]);
    simLog(c->plc->name, "> %s%.200s", name, text.text ? text.text : "");
    simTextFree(&text);
}

/* "first", "second" in front of a command choose the PLC; else it is the PRIMARY. */
static int choosePlc(call *c)
{
    int isFirst = !strcasecmp(c->words[0], "first");
    int i;

    c->plc = &c->sim->plc[0];
    for (i = 0; i < c->sim->count; i++)
        if (c->sim->isPair && c->sim->pair[i].isPrimary)
            c->plc = &c->sim->plc[i];
    if (!isFirst && strcasecmp(c->words[0], "second"))
        return 0;
    c->plc = plcByNumber(c->sim, isFirst ? 1 : 2);
    if (!c->plc)
        return fail(c, "%s is not in this process", c->words[0]);
    c->chosen = 1;
    c->words++;
    c->count--;
    return c->count ? 0 : fail(c, "a command is missing");
}

static int run(call *c)
{
    const struct command *command;

    if (choosePlc(c))
        return -1;
    command = findCommand(c->words[0]);
    if (!command)
        return fail(c, "\"%.40s\" is no command; try help", c->words[0]);
    c->words++;
    c->count--;
    if (c->count < command->min || c->count > command->max)
        return fail(c, "usage: %s %s", command->name, command->usage);
    if (command->logged)
        logCall(c, command->name);
    return command->fn(c);
}

void simCommandRun(simulator *sim, char *line, simText *out)
{
    char *words[SIM_MAX_WORDS];
    call c;
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
