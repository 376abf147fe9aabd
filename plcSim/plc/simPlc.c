/* simPlc: one PLC: its memory, its signals, the cycle that sends, and what happens to a
 * block that arrives. It knows the server as "send this block" and nothing of consoles.
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

#define AREA_SIZE 256                /* bytes of I, Q and M */
#define HISTORY_BYTES (1024u * 1024) /* memory for received blocks */
#define HISTORY_BLOCKS 1000u

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
    program->interfere = hmiActs;
    program->arg = plc;
}

static int setUpModbus(simPlc *plc, simText *out)
{
    const simConfig *config = plc->config;
    const char *problem = NULL;

    plc->modbus.enabled = config->modbusPort >= 0;
    plc->modbus.unit = config->modbusUnit;
    plc->modbus.gateway = config->modbusGateway;
    if (plc->modbus.enabled && config->role != simSingle)
        problem = "Modbus is for one PLC: modbus_port needs role = single";
    else if (!plc->modbus.enabled && plc->modbus.map.count)
        problem = "there are modbus areas, but modbus_port = off";
    if (!problem)
        return 0;
    simTextAdd(out, "%s: %s\n", config->file, problem);
    return 1;
}

static void makeHistory(simPlc *plc)
{
    size_t size = plc->config->out;
    size_t i;

    plc->historySize = size ? HISTORY_BYTES / size : 0;
    if (plc->historySize > HISTORY_BLOCKS)
        plc->historySize = HISTORY_BLOCKS;
    plc->history =
        callocMustSucceed(plc->historySize + 1, sizeof(simReceived), "simPlcBuild");
    for (i = 0; i < plc->historySize; i++)
        plc->history[i].bytes = callocMustSucceed(1, size, "simPlcBuild");
}

int simPlcBuild(simPlc *plc, simLoop *loop, const simConfig *config, const char *name,
                simText *out)
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
    simMapInit(&plc->modbus.map, &plc->memory);
    simMemoryAdd(&plc->memory, SIM_AREA_I, 0, AREA_SIZE, NULL);
    simMemoryAdd(&plc->memory, SIM_AREA_Q, 0, AREA_SIZE, NULL);
    simMemoryAdd(&plc->memory, SIM_AREA_M, 0, AREA_SIZE, NULL);
    plc->tx = wireBlock(plc, config->txDb, config->in, "IE_TX", out, &errors);
    plc->rx = wireBlock(plc, config->rxDb, config->out, "IE_RX", out, &errors);
    setUpProgram(plc);
    errors += simPlcStatements(plc, 0, out);
    errors += simPlcStatements(plc, 1, out);
    if (simProgramInit(&plc->program, config->txPtrsDb, config->rxPtrsDb, error)) {
        simTextAdd(out, "%s: %s\n", config->file, error);
        errors++;
    }
    errors += setUpModbus(plc, out);
    makeHistory(plc);
    return errors;
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
    for (i = 0; i < plc->historySize; i++)
        free(plc->history[i].bytes);
    free(plc->history);
    free(plc->signals);
    free(plc->mirrors);
    forgetHmi(plc);
    simMapFree(&plc->modbus.map);
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
    in.connected = simServerConnected(&plc->server) && !plc->passive;
    in.remote = !plc->local;
    in.send = send;
    in.received = received;
    IE_COMMS(program, &in);
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

static void tellChanged(simPlc *plc)
{
    if (plc->changed)
        plc->changed(plc->changedArg);
}

/* While SEND is busy nothing is made, so that counters count what was sent. */
static void makeBlock(simPlc *plc)
{
    if (plc->passive)
        return;
    if (simServerConnected(&plc->server) && !simServerReady(&plc->server)) {
        simServerSend(&plc->server, plc->tx ? plc->tx->bytes : NULL);
        return;
    }
    plc->block++;
    plc->program.counterFrozen = plc->freeze != freezeNothing;
    moveSignals(plc);
    callProgram(plc, 1, NULL);
    if (plc->tx)
        simServerSend(&plc->server, plc->tx->bytes);
    tellChanged(plc);
}

/* SEND watchdog: a block that does not leave ends the connection. */
static void watchSend(simPlc *plc, double now)
{
    simServer *server = &plc->server;

    if (!simServerBusy(server) || server->counts.bytesSent != plc->sentBytes ||
        server->faults.silence || server->faults.unplugged || server->faults.delay > 0) {
        plc->sentBytes = server->counts.bytesSent;
        plc->sentTime = now;
        return;
    }
    if (plc->config->sendWatchdog > 0 && now - plc->sentTime > plc->config->sendWatchdog)
        simServerDrop(server, 1, "SEND watchdog: the IOC does not read");
}

static void onCycle(void *arg)
{
    simPlc *plc = arg;
    double now = simNow();

    plc->next += plc->period;
    if (plc->next < now - plc->period || plc->next > now + plc->period)
        plc->next = now + plc->period;
    simTimerSet(plc->loop, &plc->cycle, plc->next, onCycle, plc);
    watchSend(plc, now);
    if (!plc->server.faults.flood || !simServerConnected(&plc->server))
        makeBlock(plc);
}

static void onConnected(void *owner)
{
    callProgram(owner, 0, NULL);
}

static void onDisconnected(void *owner, const char *reason)
{
    (void)reason;
    callProgram(owner, 0, NULL);
}

static void remember(simPlc *plc, const epicsUInt8 *block)
{
    simReceived *slot = &plc->history[plc->historyCount++ % plc->historySize];

    slot->time = simNow();
    memcpy(slot->bytes, block, plc->config->out);
}

static void takeMirrors(simPlc *plc)
{
    size_t i;

    for (i = 0; i < plc->mirrorCount; i++)
        memcpy(plc->tx->bytes + plc->mirrors[i].to, plc->rx->bytes + plc->mirrors[i].from,
               plc->mirrors[i].length);
}

static void onReceived(void *owner, const epicsUInt8 *block)
{
    simPlc *plc = owner;

    remember(plc, block);
    if (plc->passive) {
        plc->ignored++;
        return;
    }
    callProgram(plc, 0, block);
    if (!plc->local)
        takeMirrors(plc);
    tellChanged(plc);
}

static void onWantBlock(void *owner)
{
    makeBlock(owner);
}

static const simServerEvents serverEvents = {onConnected, onDisconnected, onReceived,
                                             onWantBlock};

int simPlcStart(simPlc *plc, const char *address, unsigned port)
{
    plc->server.keepFirst = plc->config->keepFirst;
    plc->server.receiveBuffer = plc->config->receiveBuffer;
    if (simServerOpen(&plc->server, plc->loop, plc->name, address, port, plc->config->in,
                      plc->config->out, &serverEvents, plc))
        return -1;
    plc->modbus.listener.receiveBuffer = plc->config->receiveBuffer;
    if (plc->modbus.enabled && simModbusOpen(&plc->modbus, plc->loop, plc->name, address,
                                             (unsigned)plc->config->modbusPort))
        return -1;
    plc->epoch = plc->next = simNow();
    onCycle(plc);
    return 0;
}

void simPlcStop(simPlc *plc)
{
    simTimerStop(plc->loop, &plc->cycle);
    simTimerStop(plc->loop, &plc->power);
    simTimerStop(plc->loop, &plc->watch);
    simModbusClose(&plc->modbus);
    if (plc->server.loop)
        simServerClose(&plc->server);
    memset(&plc->server, 0, sizeof(plc->server));
    plc->server.client = -1;
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
    if (!lead)
        simServerForget(&plc->server);
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
    simServerPower(&plc->server, 1);
    simModbusPower(&plc->modbus, 1);
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
        simPlcStatementsCold(plc);
        simProgramFillTables(&plc->program);
    }
}

void simPlcRestart(simPlc *plc, double seconds, int cold)
{
    simLog(plc->name, "%s restart, off for %g ms", cold ? "cold" : "warm", seconds * 1e3);
    plc->off = 1;
    plc->restarts++;
    simTimerStop(plc->loop, &plc->cycle);
    simServerPower(&plc->server, 0);
    simModbusPower(&plc->modbus, 0);
    simTimerStop(plc->loop, &plc->watch);
    simProgramRestart(&plc->program);
    clearMemory(plc, cold);
    simTimerSet(plc->loop, &plc->power, simNow() + seconds, onPower, plc);
}

void simPlcLocal(simPlc *plc, int local)
{
    if (plc->local != local)
        simLog(plc->name, local ? "LOCAL: the HMI has control" : "REMOTE");
    plc->local = local;
    callProgram(plc, 0, NULL);
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
