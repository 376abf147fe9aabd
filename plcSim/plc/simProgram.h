/* simProgram: the program in the PLC that talks to EPICS: IE_COMMS, CHECKSYNC, PACK_TX_DB
 * and UNPACK_RX_DB, named as in the paper of the Canadian Light Source. It works on PLC
 * memory and knows nothing of sockets, files or consoles.
 *
 * Without sync a block is data from its first byte on. With sync it begins with a header:
 *
 *          0        1         2        3        4 ...
 *      +--------+---------+--------+--------+--------
 *      | flags  | counter |    layout id    | data        PLC -> IOC (IE_TX)
 *      +--------+---------+--------+--------+--------     1 SYNC  2 REMOTE  4 TIMEOUT
 *      | flags  | counter |    layout id    | data        IOC -> PLC (IE_RX)
 *      +--------+---------+--------+--------+--------     1 CHECK 2 DATA
 *
 * A transfer moves bytes between PLC memory and IE_TX or IE_RX: explicit ("DB4.DBD12 to
 * IE_TX.DBD8"), or by a pair of ANY pointers in the data blocks DB_TX_PTRS and
 * DB_RX_PTRS: source and destination, 20 bytes together; the first pair whose byte 0 is 0
 * ends the list.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simProgram_H
#define INC_simProgram_H

#include "simAny.h"
#include "simLog.h"
#include "simTables.h"

#define SIM_HEADER 4     /* bytes */
#define SIM_TX_SYNC 1    /* the PLC has accepted the IOC's values */
#define SIM_TX_REMOTE 2  /* the IOC has control */
#define SIM_TX_TIMEOUT 4 /* no block came for too long, since the last SYNC */
#define SIM_RX_CHECK 1   /* these are the values I hold: compare */
#define SIM_RX_DATA 2    /* setpoints */

/* Two ends of an explicit transfer. */
typedef struct simAssign {
    simPlace from, to;
} simAssign;

typedef struct simAnyPair {
    simAny from, to;
} simAnyPair;

/* All transfers of one direction. */
typedef struct simTransfers {
    simAssign *assigns;
    size_t assignCount;
    simAnyPair *pairs; /* what the table holds at a cold start */
    size_t pairCount;
    simBlock *table; /* DB_TX_PTRS or DB_RX_PTRS, NULL = none */
    unsigned retVal; /* of the last bad pointer, 0 = all were good */
    size_t badEntry;
} simTransfers;

typedef struct simProgramCounts {
    epicsUInt64 checks, checksFailed, syncs, syncsLost, unpacked, ignored, watchdogs,
        pointerErrors, layoutErrors;
} simProgramCounts;

/* Moments at which the program lets others interfere: the HMI may act in between. */
typedef enum simPoint { pointNone, pointReceive, pointCheck } simPoint;

typedef struct simProgram {
    const char *name; /* for the log */
    simMemory *memory;
    simBlock *tx, *rx; /* IE_TX, IE_RX */
    simTransfers pack, unpack;
    simTables tables; /* with map = on: the pointers come from there */
    /* settings */
    int sync;
    unsigned layout; /* 0 = not checked */
    double watchdog; /* s, 0 = none */
    int refuseSync; /* fault: CHECKSYNC always says unequal */
    void (*interfere)(void *arg, simPoint point);
    void *arg;
    /* state */
    int synced, timedOut, remote, connected;
    int layoutWrong;
    epicsUInt8 counter;  /* of blocks sent */
    int counterFrozen;   /* fault */
    double lastBlock;    /* s: when a block came, or the connection */
    epicsUInt8 *accepted; /* the setpoints that stand, as IE_RX has them */
    char difference[96]; /* what the last CHECKSYNC found unequal */
    simProgramCounts counts;
} simProgram;

/* Makes the pointer tables and the copies of IE_RX. Call once, after the transfers are
 * added. Returns -1 with the reason in error. */
int simProgramInit(simProgram *program, unsigned txPtrsDb, unsigned rxPtrsDb,
                   char error[SIM_ERROR_SIZE]);
void simProgramFree(simProgram *program);
/* Start of the PLC, warm or cold: SYNC falls. */
void simProgramRestart(simProgram *program);

/* What IE_COMMS is called with. */
typedef struct simInputs {
    double now; /* s */
    int connected;
    int remote;                 /* 0 = LOCAL */
    int passive;                /* BACKUP: its memory is the other's */
    int send;                   /* a block is due and SEND is free */
    const epicsUInt8 *received; /* outSize bytes, NULL = nothing came */
} simInputs;

/* The heart: takes a block that came, watches the time, and packs IE_TX when one is due.
 */
void IE_COMMS(simProgram *program, const simInputs *inputs);
/* 1 when every setpoint in a block, as IE_RX has it, equals what the PLC holds. */
int CHECKSYNC(simProgram *program, epicsUInt8 *setpoints);
/* PLC memory to IE_TX, header included. */
void PACK_TX_DB(simProgram *program);
/* IE_RX to PLC memory. */
void UNPACK_RX_DB(simProgram *program);

/* Adds lines for `status`. */
void simProgramStatus(const simProgram *program, simText *out);

#endif
