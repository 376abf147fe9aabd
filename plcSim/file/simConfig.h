/* simConfig: reads the text file that describes a PLC. It does not act on anything.
 *
 *   key = value          one of the keys of the table in simConfig.c
 *   statement word ...   kept as words; simPlc makes signals, mirrors, ... of them
 *   # comment
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simConfig_H
#define INC_simConfig_H

#include <stddef.h>

#include "simMemory.h"

#define SIM_MAX_WORDS 128
#define SIM_MAX_ADDRESS 108

/* A statement of the file. */
typedef struct simLine {
    unsigned number; /* in the file, from 1 */
    char **words;
    size_t count;
} simLine;

typedef struct simConfig {
    char file[256];
    char name[SIM_NAME_SIZE];
    char address[SIM_MAX_ADDRESS];
    unsigned port;
    size_t in, out; /* bytes PLC->IOC and IOC->PLC */
    int bigEndian;
    double period; /* s */
    int keepFirst;
    int receiveBuffer; /* bytes, 0 = default */
    double restartTime;
    unsigned txDb, rxDb, txPtrsDb, rxPtrsDb;
    int sync, local;
    unsigned layout;
    double watchdog, sendWatchdog; /* s, 0 = none */
    int role;                      /* simSingle ... */
    char second[SIM_MAX_ADDRESS];
    char fibre[SIM_MAX_ADDRESS];
    char interface[2][16]; /* of FIRST and SECOND */
    double switchover, startWait;
    int modbusPort; /* -1 = no Modbus, 0 = any free one */
    int modbusUnit; /* -1 = any */
    int modbusGateway;
    simLine *lines;
    size_t lineCount;
} simConfig;

enum { simSingle, simBoth, simFirst, simSecond };

/* Splits a line in place into words at blanks. "..." keeps blanks, \" and \\ within.
 * A word that begins with # ends the line. Returns the number of words, or -1 with the
 * reason in error. */
int simSplit(char *line, char **words, size_t max, char error[SIM_ERROR_SIZE]);

/* The defaults of all keys. */
void simConfigInit(simConfig *config);
void simConfigFree(simConfig *config);

/* Sets a key. Returns -1 with the reason in error; says what is allowed. */
int simConfigSet(simConfig *config, const char *key, const char *value,
                 char error[SIM_ERROR_SIZE]);

/* Reads a file; every error becomes a line on stderr. Returns the number of errors. */
int simConfigRead(simConfig *config, const char *file);
/* The same from memory, for tests; `file` is the name in messages. Messages go to out. */
int simConfigReadText(simConfig *config, const char *file, const char *text,
                      simText *out);

/* Adds a table of all keys. */
void simConfigHelp(simText *out);

#endif
