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

typedef enum simKeyKind {
    keyText,
    keyCount,    /* size_t */
    keyUnsigned, /* unsigned */
    keyTime,     /* double, s */
    keyChoice,   /* int: the index */
    keyOrNone    /* int: a number, or -1 */
} simKeyKind;

typedef struct simKey {
    const char *name;
    simKeyKind kind;
    size_t offset;   /* in the structure that the table fills */
    double min, max; /* of numbers; of times in s; of text its length */
    const char *initial;
    const char *choices; /* "no|yes": the index is stored; keyOrNone: the word for -1 */
    const char *help;
} simKey;

typedef struct simKeyTable {
    const simKey *keys;
    size_t count;
    size_t size; /* bytes of the structure */
} simKeyTable;

#define SIM_MAX_KEY_TABLES 8

typedef struct simConfig {
    char file[256];
    char name[SIM_NAME_SIZE];
    char address[SIM_MAX_ADDRESS];
    size_t in, out; /* bytes PLC->IOC and IOC->PLC */
    int bigEndian;
    double period;     /* s */
    int receiveBuffer; /* bytes, 0 = default */
    double restartTime;
    unsigned txDb, rxDb, txPtrsDb, rxPtrsDb;
    int sync, local;
    unsigned layout;
    int map; /* tables of pointers that the IOC brings */
    unsigned mapDb, mapRows;
    int mapLocked;
    double watchdog; /* s, 0 = none */
    int role;        /* simSingle ... */
    char second[SIM_MAX_ADDRESS];
    char fibre[SIM_MAX_ADDRESS];
    char interface[2][16]; /* of FIRST and SECOND */
    double switchover, startWait;
    const simKeyTable *tables[SIM_MAX_KEY_TABLES]; /* of the servers */
    void *values[SIM_MAX_KEY_TABLES];              /* what they fill */
    size_t tableCount;
    simLine *lines;
    size_t lineCount;
} simConfig;

enum { simSingle, simBoth, simFirst, simSecond };

/* Splits a line in place into words at blanks. "..." keeps blanks, \" and \\ within.
 * A word that begins with # ends the line. Returns the number of words, or -1 with the
 * reason in error. */
int simSplit(char *line, char **words, size_t max, char error[SIM_ERROR_SIZE]);

/* The defaults of all keys but those of simConfigAdd(). */
void simConfigInit(simConfig *config);
/* One more table of keys, with its defaults. The table must outlive the configuration. */
void simConfigAdd(simConfig *config, const simKeyTable *table);
/* The structure that this table fills. */
const void *simConfigValues(const simConfig *config, const simKeyTable *table);
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
void simConfigHelp(const simConfig *config, simText *out);

#endif
