/* simTables: tables of pointers that the IOC brings: the loader, the checks, the table in
 * use. The same rules as the functions MAP_LOAD and MAP_ROW of docs/plc-tables.scl; both
 * put the same bytes on the wire. It works on PLC memory and knows nothing of sockets,
 * files or consoles.
 *
 *          4       5      6      7     8 .. 11     12 .. 13   14       15        16 ..
 *      +-------+-------+-------+-----+-----------+----------+---------+--------+------
 *      |version| state | error | row |CRC in use | expected | session | rows/8 | data TX
 *      +-------+-------+-------+-----+-----------+----------+---------+--------+------
 *      |command|session|   offset    |  length   |    0     |     piece, CRC RX
 *      +-------+-------+-------------+-----------+----------+-------------------------
 *
 * A table is in one of two data blocks: layout id, rows TX, rows RX (2 bytes each), CRC
 * (4, counted as 0), then 20 bytes for each row, TX first; big-endian always.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simTables_H
#define INC_simTables_H

#include "simLog.h"
#include "simMemory.h"

#define SIM_TX_MAP 8         /* flag: bytes 4 to 15 tell of the tables */
#define SIM_RX_TABLE 4       /* flag: a command to the loader */
#define SIM_TABLES_STATUS 16 /* bytes before the data of IE_TX */
#define SIM_TABLE_HEAD 10
#define SIM_TABLE_ROW 20

enum { simMapNone, simMapLoading, simMapChecking, simMapActive, simMapRefused };

/* Memory that a table may reach: the PLC's own list. */
typedef struct simAllow {
    simBlock *block;
    size_t start, size; /* bytes */
    int write;
} simAllow;

typedef struct simTables {
    const char *name; /* for the log */
    simMemory *memory;
    simBlock *tx, *rx;
    unsigned rows; /* that a table may have, a multiple of 8; 0 = there are no tables */
    simBlock *table[2]; /* MAP_A, MAP_B */
    simBlock *kept; /* MAP: which of them is in use, and its CRC; outlives a restart */
    simAllow *allows;
    size_t allowCount;
    int allow; /* the key switch */
    /* state */
    int state, error, row, session, expected;
    epicsUInt32 inUse; /* CRC */
    int active;        /* 0, 1; -1 = none */
    epicsUInt32 wanted, sum, tailSum;
    int position, nextRow, tailPos;
    double pause; /* s: when the silence in a download began, -1 = there is none */
    unsigned loads, refusals;
} simTables;

/* Makes MAP_A, MAP_B and MAP, data blocks from `db` on. Returns -1 with the reason. */
int simTablesInit(simTables *tables, unsigned db, char error[SIM_ERROR_SIZE]);
void simTablesFree(simTables *tables);

/* Words behind "allow": read|write <block> [<first byte> <bytes>]. Returns 0 or -1. */
int simTablesAllow(simTables *tables, char **words, size_t count,
                   char error[SIM_ERROR_SIZE]);

/* What the loader is called with. */
typedef struct simTablesInputs {
    double now; /* s */
    int table;  /* IE_RX has a block with the flag TABLE */
    int reset;  /* the connection begins or ends */
    int remote;
} simTablesInputs;

/* One cycle. */
void simTablesStep(simTables *tables, const simTablesInputs *inputs);

/* After a start, or when another PLC's memory has come here: is the table that was in use
 * still good? */
void simTablesRestart(simTables *tables);

/* Puts a table into MAP_A and into use, unchecked: what the PLC had from the beginning.
 * `bytes` has head and rows; the CRC is filled in. */
void simTablesPreload(simTables *tables, const epicsUInt8 *bytes, size_t size);

/* Blocks may be checked and taken. */
int simTablesReady(const simTables *tables);

/* Of the table in use, 0 = there is none: rows; their bytes; the layout id. */
size_t simTablesRows(const simTables *tables, int isTx);
epicsUInt8 *simTablesRow(const simTables *tables, int isTx, size_t row);
unsigned simTablesLayout(const simTables *tables);

/* Bytes 4 to 15 of IE_TX. */
void simTablesPack(const simTables *tables);

void simTablesStatus(const simTables *tables, simText *out);

#endif
