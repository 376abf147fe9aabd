/* simPlc: one PLC: its memory, its signals, its program and the cycle that runs it. It
 * knows its servers by their tables (simServer.h) and nothing of consoles.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simPlc_H
#define INC_simPlc_H

#include "simConfig.h"
#include "simLoop.h"
#include "simMemory.h"
#include "simProgram.h"
#include "simServer.h"
#include "simSignal.h"

typedef enum simFreeze { freezeNothing, freezeHeartbeat, freezeAll } simFreeze;

#define SIM_MAX_SERVERS 4

typedef struct simPlcServer {
    const simServerType *type;
    void *state;
} simPlcServer;

typedef struct simPlc {
    simLoop *loop;
    const simConfig *config;
    char name[SIM_NAME_SIZE];
    simMemory memory;
    simBlock *tx, *rx; /* IE_TX, IE_RX; NULL when they have no bytes */
    simPlcServer servers[SIM_MAX_SERVERS];
    size_t serverCount;
    simProgram program;
    simSignal *signals;
    size_t signalCount;
    double epoch;      /* simNow() when time 0 was */
    double period;     /* s */
    double next;       /* s, simNow() scale: the next cycle */
    epicsUInt64 block; /* counts blocks made; counters show it */
    simFreeze freeze;
    int local;                  /* the HMI has control: received blocks are not taken */
    int off;                    /* restarting */
    int passive;                /* BACKUP of a pair: sends nothing, takes nothing */
    int connected;              /* to the IOC, as the program sees it */
    int unplugged;              /* the network cable is out */
    void (*changed)(void *arg); /* called when memory may have changed, or NULL */
    void *changedArg;
    unsigned restarts;
    simTimer cycle, power, watch, check;
    simPoint hmiPoint; /* the HMI waits for this moment ... */
    char **hmiWords;   /* ... to set this */
    size_t hmiCount;
} simPlc;

/* Builds memory, signals and servers from the configuration; messages go to out. `types`
 * ends with NULL; the configuration has all of their keys. Returns the number of errors.
 */
int simPlcBuild(simPlc *plc, simLoop *loop, const simConfig *config,
                const simServerType *const *types, const char *name, simText *out);
/* The structure of one of its servers. */
void *simPlcServerOf(const simPlc *plc, const simServerType *type);
/* Listens and starts the cycle. `like` is the partner in a pair, whose ports are taken,
 * or NULL. Returns 0; -1 after a message; 1 when other free ports might do. */
int simPlcStart(simPlc *plc, const char *address, const simPlc *like);
/* Stops the cycle and listening; may be started again. */
void simPlcStop(simPlc *plc);
void simPlcFree(simPlc *plc);

void simPlcPeriod(simPlc *plc, double seconds);
/* Moves the signals and packs IE_TX; the servers are told. Nothing, when it is passive.
 */
void simPlcMake(simPlc *plc);
/* Calls the program: the connection to the IOC has come or gone, or a block came
 * (`received`, config->out bytes, or NULL). */
void simPlcCall(simPlc *plc, const epicsUInt8 *received);
/* Memory has changed: to be told to the partner. */
void simPlcChanged(simPlc *plc);
/* The network cable of this PLC. */
void simPlcUnplug(simPlc *plc, int on);
/* All faults end. */
void simPlcNormal(simPlc *plc);
/* Power off, and on again after `seconds`. Data blocks keep their values, the send and
 * receive blocks become zero. A cold restart sets all memory to its initial values. */
void simPlcRestart(simPlc *plc, double seconds, int cold);
/* PRIMARY or BACKUP. A new PRIMARY sends a block at once. */
void simPlcLead(simPlc *plc, int lead);
void simPlcLocal(simPlc *plc, int local);
/* The HMI sets a value at once (pointNone), or at that moment of the program. */
int simPlcHmi(simPlc *plc, simPoint point, char **words, size_t count,
              char error[SIM_ERROR_SIZE]);
/* Adds another signal while running: the words behind "signal". */
int simPlcSignal(simPlc *plc, char **words, size_t count, char error[SIM_ERROR_SIZE]);
/* Adds a signal that is read already. */
void simPlcAddSignal(simPlc *plc, const simSignal *signal);
/* No more signals move what begins there. */
void simPlcDropSignals(simPlc *plc, const simBlock *block, size_t offset);
/* Reads "in 4 INT16", "DB10.DBW4", "DB10.4 REAL32". Returns the number of words used, or
 * -1. */
int simPlcPlace(simPlc *plc, char **words, size_t count, simPlace *place, simType *type,
                char error[SIM_ERROR_SIZE]);
/* "set" of the console and "init" of the file: <place> [type] <value> ... */
int simPlcSet(simPlc *plc, char **words, size_t count, char error[SIM_ERROR_SIZE]);

#endif
