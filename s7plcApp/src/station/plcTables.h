/* The pointer tables in the PLC, IOC side: does the PLC work with the table that our
 * records were made for, and if not, may we give it to the PLC?
 *
 * Pure: blocks go in, a state and blocks come out; no socket, no thread, no clock, no
 * file. Times are counted in blocks of the PLC. The PLC checks what it gets and decides;
 * until it has taken a whole good table it works with the one it had.
 *
 *   PLC -> IOC, flag MAP (8) in byte 0     IOC -> PLC, flag TABLE (4) in byte 0, neither
 *                                          CHECK nor DATA
 *    4      version, 1                      4      command, plcTablesCommand
 *    5      state, plcMap...                5      session
 *    6      error, see errorText            6..7   offset of the piece in the table
 *    7      row of the error, TX rows first 8..9   length of the piece, 1 ...
 *    8..11  CRC-32 of the table in use     10..11  0
 *   12..13  byte of the table that is next 12..    the piece; with COMMIT the CRC-32
 *   14      session
 *   15      rows possible / 8, 0 = locked
 *   16..    data
 *
 * Numbers are in the byte order of the station. The table itself is big-endian always:
 *
 *      0..1 layout id   2..3 rows TX   4..5 rows RX   6..9 CRC-32, counted as 0
 *     10..  20 bytes for each row: ANY pointer of the source, of the destination; TX first
 */
#ifndef INC_plcTables_H
#define INC_plcTables_H

#include <stddef.h>

#include <epicsTypes.h>

enum { plcFlagMap = 8 };   /* PLC -> IOC, byte 0 */
enum { plcFlagTable = 4 }; /* IOC -> PLC, byte 0 */

#define PLC_TABLES_STATUS 16 /* bytes of a block PLC -> IOC before its data */
#define PLC_TABLES_PIECE 12  /* where the piece begins in a block IOC -> PLC */
#define PLC_TABLE_HEAD 10    /* bytes of a table before its rows */
#define PLC_TABLE_ROW 20     /* bytes of a row */
#define PLC_TABLE_REASON 80  /* characters of a reason, with its zero */

typedef enum { plcMapOff, plcMapCheck, plcMapDownload } plcMapMode; /* option map= */

/* State of the PLC, byte 5 */
enum { plcMapNone, plcMapLoading, plcMapChecking, plcMapActive, plcMapRefused };

typedef enum {
    plcTablesBegin = 1,
    plcTablesPart,
    plcTablesCommit,
    plcTablesAbort
} plcTablesCommand;

typedef enum {
    plcTablesDisconnected,
    plcTablesWaiting,    /* connected, no block yet */
    plcTablesFixed,      /* the PLC tells of no table: it has its own, as ever */
    plcTablesEqual,      /* the PLC works with ours */
    plcTablesMismatch,   /* it works with another one, and nothing is sent */
    plcTablesBeginning,  /* BEGIN is on its way */
    plcTablesLoading,    /* so is a part */
    plcTablesCommitting, /* the PLC has it all, and checks */
    plcTablesRefused     /* it said no; nothing more is sent */
} plcTablesState;

/* What the PLC said in its last block. */
typedef struct plcTablesStatus {
    int version, state, error, row, session, rows;
    unsigned expected; /* bytes */
    epicsUInt32 crc;
} plcTablesStatus;

typedef struct plcTables {
    plcMapMode mode;
    const epicsUInt8 *table; /* ours; NULL: there is none */
    size_t size;             /* bytes */
    epicsUInt32 crc;
    size_t piece; /* bytes of it in a block, at most */
    plcTablesState state;
    int command;     /* plcTablesCommand of the block that has to leave, 0 = none has */
    unsigned done;   /* bytes that the PLC has */
    unsigned length; /* bytes of the part under way */
    int session;
    unsigned unchanged; /* blocks since the PLC's status last changed */
    unsigned attempts; /* to download, without an answer that makes sense */
    int remote;        /* of the PLC's last block */
    plcTablesStatus plc;
    char reason[PLC_TABLE_REASON]; /* why not equal, in words; "": it is */
} plcTables;

/* `table` stays the caller's. outSize: bytes of a block IOC -> PLC. */
void plcTablesInit(plcTables *tables, plcMapMode mode, const epicsUInt8 *table,
                   size_t size, size_t outSize);

/* The PLC that gets our output is there, or is another one now / is gone. */
void plcTablesConnected(plcTables *tables);
void plcTablesLost(plcTables *tables);

/* A block came. Returns 1 when its data is what our records expect. `command` says
 * whether a block has to leave now. */
int plcTablesBlock(plcTables *tables, const void *block, int bigEndian);

/* The same question without a step: nothing changes. */
int plcTablesSame(const plcTables *tables, const void *block, int bigEndian);

/* Writes bytes 4 and up of the block that `command` asks for, which then is done, and
 * returns the flags for byte 0; 0 and no byte when there is none to send. */
int plcTablesPack(plcTables *tables, void *block, int bigEndian);

/* How much of the download is done, 0 to 100 %; 100 only when the PLC works with our
 * table.
 */
int plcTablesProgress(const plcTables *tables);

const char *plcTablesStateName(int state);

#endif /* INC_plcTables_H */
