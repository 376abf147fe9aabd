/* simPlc: one PLC: its memory, its signals, its program and the cycle that runs it. It
 * knows its servers by their tables (simServer.h) and nothing of consoles.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <time.h>

#include <cantProceed.h>
#include <epicsString.h>

#include "simPlc.h"
#include "simPlcFile.h"
#include "simTransfers.h"

#define CHECK_PAUSE 0.005 /* s between two calls of the program that checks a new table  \
                           */
#define AREA_SIZE 256     /* bytes of I, Q and M */

/* ---- its servers ---- */

static void tell(simPlc *plc, simEvent event, int value)
{
    size_t i;

    for (i = 0; i < plc->serverCount; i++)
        if (plc->servers[i].type->on[event])
            plc->servers[i].type->on[event](plc->servers[i].state, value);
}

static void addServers(simPlc *plc, const simServerType *const *types)
{
    for (; *types && plc->serverCount < SIM_MAX_SERVERS; types++) {
        simPlcServer *server = &plc->servers[plc->serverCount++];

        server->type = *types;
        server->state = callocMustSucceed(1, server->type->size, "simPlcBuild");
        server->type->init(server->state, plc);
    }
}

static int checkServers(simPlc *plc, simText *out)
{
    int errors = 0;
    size_t i;

    for (i = 0; i < plc->serverCount; i++)
        if (plc->servers[i].type->check)
            errors += plc->servers[i].type->check(plc->servers[i].state, out);
    return errors;
}

void *simPlcServerOf(const simPlc *plc, const simServerType *type)
{
    size_t i;

    for (i = 0; i < plc->serverCount; i++)
        if (plc->servers[i].type == type)
            return plc->servers[i].state;
    return NULL;
}

/* ---- building ---- */

static simBlock *wireBlock(simPlc *plc, unsigned number, size_t size, const char *name,
                           simText *out, int *errors)
{
    simBlock *block;

    if (!size)
        return NULL;
    block = simMemoryAdd(&plc->memory, SIM_AREA_DB, number, size, name);
    if (!block) {
        simTextAdd(out, "%s: IE_TX and IE_RX must have different DB numbers\n",
                   plc->config->file);
        (*errors)++;
    }
    return block;
}

static void hmiActs(void *arg, simPoint point);

static void setUpProgram(simPlc *plc)
{
    const simConfig *config = plc->config;
    simProgram *program = &plc->program;

    program->name = plc->name;
    program->memory = &plc->memory;
    program->tx = plc->tx;
    program->rx = plc->rx;
    program->sync = config->sync;
    program->layout = config->layout;
    program->watchdog = config->watchdog;
    program->tables.name = plc->name;
    program->tables.memory = &plc->memory;
    program->tables.tx = plc->tx;
    program->tables.rx = plc->rx;
    program->tables.rows = config->map ? config->mapRows : 0;
    program->tables.allow = !config->mapLocked;
    program->interfere = hmiActs;
    program->arg = plc;
}

int simPlcBuild(simPlc *plc, simLoop *loop, const simConfig *config,
                const simServerType *const *types, const char *name, simText *out)
{
    char error[SIM_ERROR_SIZE];
    int errors = 0;

    memset(plc, 0, sizeof(*plc));
    plc->loop = loop;
    plc->config = config;
    snprintf(plc->name, sizeof(plc->name), "%s", name);
    plc->period = config->period;
    plc->local = config->local;
    simMemoryInit(&plc->memory, config->bigEndian);
    simMemoryAdd(&plc->memory, SIM_AREA_I, 0, AREA_SIZE, NULL);
    simMemoryAdd(&plc->memory, SIM_AREA_Q, 0, AREA_SIZE, NULL);
    simMemoryAdd(&plc->memory, SIM_AREA_M, 0, AREA_SIZE, NULL);
    plc->tx = wireBlock(plc, config->txDb, config->in, "IE_TX", out, &errors);
    plc->rx = wireBlock(plc, config->rxDb, config->out, "IE_RX", out, &errors);
    setUpProgram(plc);
    if (simTablesInit(&plc->program.tables, config->mapDb, error)) {
        simTextAdd(out, "%s: %s\n", config->file, error);
        errors++;
    }
    addServers(plc, types);
    errors += simPlcStatements(plc, 0, out);
    errors += simPlcStatements(plc, 1, out);
    if (simProgramInit(&plc->program, config->txPtrsDb, config->rxPtrsDb, error)) {
        simTextAdd(out, "%s: %s\n", config->file, error);
        errors++;
    }
    return errors + checkServers(plc, out);
}

static void forgetHmi(simPlc *plc)
{
    size_t i;

    for (i = 0; i < plc->hmiCount; i++)
        free(plc->hmiWords[i]);
    free(plc->hmiWords);
    plc->hmiWords = NULL;
    plc->hmiCount = 0;
    plc->hmiPoint = pointNone;
}

void simPlcFree(simPlc *plc)
{
    size_t i;

    for (i = 0; i < plc->signalCount; i++)
        simSignalFree(&plc->signals[i]);
    free(plc->signals);
    for (i = 0; i < plc->serverCount; i++) {
        plc->servers[i].type->free(plc->servers[i].state);
        free(plc->servers[i].state);
    }
    plc->serverCount = 0;
    forgetHmi(plc);
    simProgramFree(&plc->program);
    simMemoryFree(&plc->memory);
}

/* ---- the cycle ---- */

static void moveSignals(simPlc *plc)
{
    struct timespec wall;
    simMoment moment;
    size_t i;

    clock_gettime(CLOCK_REALTIME, &wall);
    moment.time = simNow() - plc->epoch;
    moment.wall = (double)wall.tv_sec + (double)wall.tv_nsec * 1e-9;
    moment.block = plc->block;
    for (i = 0; i < plc->signalCount; i++) {
        if (plc->freeze == freezeAll ||
            (plc->freeze == freezeHeartbeat && simSignalIsCounter(&plc->signals[i])))
            continue;
        simSignalWrite(&plc->memory, &plc->signals[i], &moment);
    }
}

static void onWatch(void *arg);

/* One call of the PLC program, and a look at the clock when its watchdog would expire. */
static void callProgram(simPlc *plc, int send, const epicsUInt8 *received)
{
    simProgram *program = &plc->program;
    simInputs in;

    in.now = simNow();
    in.connected = plc->connected && !plc->passive;
    in.remote = !plc->local;
    in.passive = plc->passive;
    in.send = send;
    in.received = received;
    IE_COMMS(program, &in);
    if (program->tables.state == simMapChecking)
        simTimerSet(plc->loop, &plc->check, in.now + CHECK_PAUSE, onWatch, plc);
    if (program->sync && program->watchdog > 0 && in.connected && !program->timedOut)
        simTimerSet(plc->loop, &plc->watch, program->lastBlock + program->watchdog,
                    onWatch, plc);
    else
        simTimerStop(plc->loop, &plc->watch);
}

static void onWatch(void *arg)
{
    callProgram(arg, 0, NULL);
}

void simPlcCall(simPlc *plc, const epicsUInt8 *received)
{
    callProgram(plc, 0, received);
}

void simPlcChanged(simPlc *plc)
{
    if (plc->changed)
        plc->changed(plc->changedArg);
}

void simPlcMake(simPlc *plc)
{
    if (plc->passive)
        return;
    plc->block++;
    plc->program.counterFrozen = plc->freeze != freezeNothing;
    moveSignals(plc);
    callProgram(plc, 1, NULL);
    tell(plc, simMade, 0);
    simPlcChanged(plc);
}

/* While a server's SEND is busy nothing is made, so that counters count what was sent. */
static int mayMake(simPlc *plc)
{
    int busy = 0;
    size_t i;

    for (i = 0; i < plc->serverCount; i++)
        if (plc->servers[i].type->cycle)
            busy |= plc->servers[i].type->cycle(plc->servers[i].state);
    return !busy;
}

static void onCycle(void *arg)
{
    simPlc *plc = arg;
    double now = simNow();

    plc->next += plc->period;
    if (plc->next < now - plc->period || plc->next > now + plc->period)
        plc->next = now + plc->period;
    simTimerSet(plc->loop, &plc->cycle, plc->next, onCycle, plc);
    if (mayMake(plc))
        simPlcMake(plc);
}

static int openServers(simPlc *plc, const char *address, const simPlc *like)
{
    int status = 0;
    size_t i;

    for (i = 0; i < plc->serverCount && !status; i++)
        status = plc->servers[i].type->open(plc->servers[i].state, address,
                                            like ? like->servers[i].state : NULL);
    return status;
}

int simPlcStart(simPlc *plc, const char *address, const simPlc *like)
{
    int status = openServers(plc, address, like);

    if (status)
        return status;
    plc->epoch = plc->next = simNow();
    onCycle(plc);
    return 0;
}

void simPlcStop(simPlc *plc)
{
    size_t i;

    simTimerStop(plc->loop, &plc->cycle);
    simTimerStop(plc->loop, &plc->power);
    simTimerStop(plc->loop, &plc->watch);
    simTimerStop(plc->loop, &plc->check);
    for (i = 0; i < plc->serverCount; i++)
        plc->servers[i].type->close(plc->servers[i].state);
}

void simPlcPeriod(simPlc *plc, double seconds)
{
    plc->period = seconds;
    if (plc->off)
        return;
    plc->next = simNow();
    onCycle(plc);
}

/* ---- roles, restart, LOCAL ---- */

void simPlcLead(simPlc *plc, int lead)
{
    plc->passive = !lead;
    if (plc->off)
        return;
    tell(plc, simLead, lead);
    if (lead)
        simTablesRestart(&plc->program.tables);
    callProgram(plc, 0, NULL);
    if (lead)
        simPlcPeriod(plc, plc->period);
}

static void onPower(void *arg)
{
    simPlc *plc = arg;

    plc->off = 0;
    plc->block = 0;
    plc->epoch = plc->next = simNow();
    simLog(plc->name, "restarted");
    tell(plc, simPower, 1);
    onCycle(plc);
}

static void clearMemory(simPlc *plc, int cold)
{
    size_t i;

    for (i = 0; i < plc->memory.count; i++) {
        simBlock *block = plc->memory.blocks[i];

        if (cold || block == plc->tx || block == plc->rx)
            memset(block->bytes, 0, block->size);
    }
    if (cold) {
        tell(plc, simCold, 0);
        simPlcStatementsCold(plc);
        simTransfersFill(&plc->program);
    }
}

void simPlcRestart(simPlc *plc, double seconds, int cold)
{
    simLog(plc->name, "%s restart, off for %g ms", cold ? "cold" : "warm", seconds * 1e3);
    plc->off = 1;
    plc->restarts++;
    simTimerStop(plc->loop, &plc->cycle);
    tell(plc, simPower, 0);
    simTimerStop(plc->loop, &plc->watch);
    simTimerStop(plc->loop, &plc->check);
    clearMemory(plc, cold);
    simProgramRestart(&plc->program);
    simTimerSet(plc->loop, &plc->power, simNow() + seconds, onPower, plc);
}

void simPlcLocal(simPlc *plc, int local)
{
    if (plc->local != local)
        simLog(plc->name, local ? "LOCAL: the HMI has control" : "REMOTE");
    plc->local = local;
    callProgram(plc, 0, NULL);
}

/* ---- faults ---- */

void simPlcUnplug(simPlc *plc, int on)
{
    plc->unplugged = on;
    tell(plc, simUnplug, on);
}

void simPlcNormal(simPlc *plc)
{
    plc->freeze = freezeNothing;
    plc->program.refuseSync = 0;
    simPlcUnplug(plc, 0);
    tell(plc, simNormal, 0);
}

/* ---- the HMI ---- */

static void logHmi(simPlc *plc, char **words, size_t count)
{
    simText text = {NULL, 0, 0};
    size_t i;

    for (i = 0; i < count; i++)
        simTextAdd(&text, " %s", words[i]);
    simLog(plc->name, "HMI sets%.200s", text.text ? text.text : "");
    simTextFree(&text);
}

static void hmiActs(void *arg, simPoint point)
{
    simPlc *plc = arg;
    char error[SIM_ERROR_SIZE];

    if (point == pointNone || point != plc->hmiPoint)
        return;
    logHmi(plc, plc->hmiWords, plc->hmiCount);
    if (simPlcSet(plc, plc->hmiWords, plc->hmiCount, error))
        simComplain(plc->name, "HMI: %s", error);
    forgetHmi(plc);
}

int simPlcHmi(simPlc *plc, simPoint point, char **words, size_t count,
              char error[SIM_ERROR_SIZE])
{
    simPlace place;
    simType type;
    size_t i;

    if (point == pointNone) {
        logHmi(plc, words, count);
        return simPlcSet(plc, words, count, error);
    }
    if (simPlcPlace(plc, words, count, &place, &type, error) < 0)
        return -1;
    forgetHmi(plc);
    plc->hmiWords = callocMustSucceed(count + 1, sizeof(char *), "simPlcHmi");
    for (i = 0; i < count; i++)
        plc->hmiWords[plc->hmiCount++] = epicsStrDup(words[i]);
    plc->hmiPoint = point;
    return 0;
}
