/* simPlc: one PLC: its memory, its signals, the cycle that sends, and what happens to a
 * block that arrives. It knows the server as "send this block" and nothing of consoles.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simPlc_H
#define INC_simPlc_H

#include "simConfig.h"
#include "simLoop.h"
#include "simMemory.h"
#include "simModbus.h"
#include "simProgram.h"
#include "simServer.h"
#include "simSignal.h"

/* Read-back: bytes of IE_RX that go into IE_TX when a block was taken. */
typedef struct simMirror {
    size_t from, length, to;
} simMirror;

typedef enum simFreeze { freezeNothing, freezeHeartbeat, freezeAll } simFreeze;

/* A block that came from the IOC. */
typedef struct simReceived {
    double time; /* s, simNow() scale */
    epicsUInt8 *bytes;
} simReceived;

typedef struct simPlc {
    simLoop *loop;
    const simConfig *config;
    char name[SIM_NAME_SIZE];
    simMemory memory;
    simBlock *tx, *rx; /* IE_TX, IE_RX; NULL when they have no bytes */
    simServer server;
    simModbus modbus; /* on the same memory; see its `enabled` */
    simProgram program;
    simSignal *signals;
    size_t signalCount;
    simMirror *mirrors;
    size_t mirrorCount;
    double epoch;      /* simNow() when time 0 was */
    double period;     /* s */
    double next;       /* s, simNow() scale: the next cycle */
    epicsUInt64 block; /* counts blocks made; counters show it */
    simFreeze freeze;
    int local;                  /* the HMI has control: received blocks are not taken */
    int off;                    /* restarting */
    int passive;                /* BACKUP of a pair: sends nothing, takes nothing */
    epicsUInt64 ignored;        /* blocks that came while passive */
    void (*changed)(void *arg); /* called when memory may have changed, or NULL */
    void *changedArg;
    unsigned restarts;
    simTimer cycle, power, watch;
    epicsUInt64 sentBytes; /* when the SEND watchdog looked last */
    double sentTime;       /* s: when bytes left last */
    simPoint hmiPoint;     /* the HMI waits for this moment ... */
    char **hmiWords;       /* ... to set this */
    size_t hmiCount;
    simReceived *history; /* ring of the last blocks */
    size_t historySize;
    epicsUInt64 historyCount;
} simPlc;

/* Builds memory, signals and mirrors from the configuration; messages go to out.
 * Returns the number of errors. */
int simPlcBuild(simPlc *plc, simLoop *loop, const simConfig *config, const char *name,
                simText *out);
/* Listens and starts the cycle. Returns 0 or -1 after a message. */
int simPlcStart(simPlc *plc, const char *address, unsigned port);
/* Stops the cycle and listening; may be started again. */
void simPlcStop(simPlc *plc);
void simPlcFree(simPlc *plc);

void simPlcPeriod(simPlc *plc, double seconds);
/* Power off, and on again after `seconds`. Data blocks keep their values, the send and
 * receive blocks become zero. A cold restart sets all memory to its initial values. */
void simPlcRestart(simPlc *plc, double seconds, int cold);
/* PRIMARY or BACKUP. A new PRIMARY sends a block at once. */
void simPlcLead(simPlc *plc, int lead);
void simPlcLocal(simPlc *plc, int local);
/* The HMI sets a value at once (pointNone), or at that moment of the program. */
int simPlcHmi(simPlc *plc, simPoint point, char **words, size_t count,
              char error[SIM_ERROR_SIZE]);
/* Adds another signal or mirror while running: words as in the file, keyword first. */
int simPlcStatement(simPlc *plc, char **words, size_t count, char error[SIM_ERROR_SIZE]);
/* Reads "in 4 INT16", "DB10.DBW4", "DB10.4 REAL32". Returns the number of words used, or
 * -1. */
int simPlcPlace(simPlc *plc, char **words, size_t count, simPlace *place, simType *type,
                char error[SIM_ERROR_SIZE]);
/* "set" of the console and "init" of the file: <place> [type] <value> ... */
int simPlcSet(simPlc *plc, char **words, size_t count, char error[SIM_ERROR_SIZE]);

#endif
