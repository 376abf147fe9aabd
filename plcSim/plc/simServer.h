/* simServer: what a PLC asks of its servers (blocks, Modbus, ...): one const table of
 * functions for each kind. A PLC knows its servers by these tables alone.
 *
 * All functions run in the thread of the loop and never block. Those that are NULL are
 * not called; init, open, close, free and address must be there.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simServer_H
#define INC_simServer_H

#include "simConfig.h"
#include "simLog.h"

struct simPlc;
struct simCommand;

/* A statement of the file that belongs to a server. */
typedef struct simServerStatement {
    const char *name;
    int makesMemory; /* done before the statements that use memory */
    /* words behind the name. Returns 0, or -1 with the reason in error */
    int (*fn)(void *server, char **words, size_t count, char error[SIM_ERROR_SIZE]);
} simServerStatement;

/* What a PLC tells its servers, each with a value. */
typedef enum simEvent {
    simMade,   /* IE_TX is packed */
    simLead,   /* 1 = the PLC is PRIMARY, 0 = BACKUP and silent */
    simPower,  /* 0 = the PLC is off: no connections, nothing listens */
    simCold,   /* a cold restart: back to what the file said */
    simUnplug, /* 1 = the network cable is out */
    simNormal, /* all faults end */
    SIM_EVENTS
} simEvent;

typedef struct simServerType {
    const char *title;       /* in "plcSim: PLC <title> listening on ...", may be "" */
    const char *off;         /* what its commands say when it does not listen */
    const simKeyTable *keys; /* of the file; NULL = none */
    const simServerStatement *statements;
    size_t statementCount;
    const struct simCommand *commands; /* of the console */
    size_t commandCount;
    size_t size; /* bytes of the server's own structure, which begins as zeros */

    /* Before the statements of the file. */
    void (*init)(void *server, struct simPlc *plc);
    /* After them. Adds a line for each error to out, returns how many. */
    int (*check)(void *server, simText *out);
    /* Listens. `like` is the same server of the partner in a pair, or NULL: its port is
     * taken. Returns 0; -1 after a message; 1 when another port of the system's choice
     * might do. */
    int (*open)(void *server, const char *address, const void *like);
    /* Ends everything but what the file said; may be opened again. */
    void (*close)(void *server);
    void (*free)(void *server);

    /* Where it listens, "127.0.0.1:40123"; NULL = it does not. A static text. */
    const char *(*address)(const void *server);
    /* The cycle of the PLC has come. Returns 1 when no block may be made now. */
    int (*cycle)(void *server);
    /* What happens to the PLC. */
    void (*on[SIM_EVENTS])(void *server, int value);
    /* Adds lines for `status`. */
    void (*status)(const void *server, simText *out);
} simServerType;

#endif
