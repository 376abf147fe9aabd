/* simCall: one call of a console command, its arguments, and the tables of commands. It
 * is what the files with commands share.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simCall_H
#define INC_simCall_H

#include <stddef.h>

#include "simClients.h"
#include "simLog.h"
#include "simulator.h"

/* What a command works on. */
typedef struct simCall {
    simulator *sim;
    simPlc *plc;
    int chosen;   /* by a word in front: "second status" */
    char **words; /* behind the command's name */
    size_t count;
    simText *out;
    char error[SIM_ERROR_SIZE];
} simCall;

/* Returns 0, or -1 with the reason in the call's error. */
typedef int (*simCommandFn)(simCall *c);

typedef struct simCommand {
    const char *name;
    size_t min, max; /* arguments */
    simCommandFn fn;
    int logged;
    const char *usage;
    const char *help;
} simCommand;

/* A word behind a command: `modbus close`. */
typedef struct simCallWord {
    const char *name;
    size_t max; /* words, with the name */
    simCommandFn fn;
    int logged;
} simCallWord;

/* Calls what the first word of `command` asks for. Returns what that returns, or
 * SIM_NO_WORD where none of the rows fits. */
#define SIM_NO_WORD 1
int simCallWords(simCall *c, const char *command, const simCallWord *rows, size_t count);
/* Words that all servers with clients have: refuse [on|off]; close, reset. */
int simCallRefuse(simCall *c, simClients *clients);
int simCallClose(simCall *c, simClients *clients);

/* Writes the reason why a command was refused. Returns -1. */
int simCallFail(simCall *c, const char *format, ...) EPICS_PRINTF_STYLE(2, 3);
/* The command and its words go to the log. */
void simCallLog(const simCall *c, const char *name);

/* The one argument is on or off; none means on. */
int simCallOnOff(simCall *c, int *on);
int simCallIsOff(const simCall *c);
/* Argument `index` is a number 0 ... max. */
int simCallNumber(simCall *c, size_t index, unsigned long max, unsigned long *value);
/* Argument `index` is a time of at least `min` s; ms without a unit. */
int simCallTime(simCall *c, size_t index, double min, double *seconds);
/* The pair's half that is FIRST (1) or SECOND (2); a single PLC is 1. NULL: not here. */
simPlc *simCallPlcByNumber(simulator *sim, unsigned long number);
/* The PLC that the first argument numbers, or the one the command is for. NULL: refused.
 */
simPlc *simCallPlc(simCall *c);

#endif
