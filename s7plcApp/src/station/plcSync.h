/* The sync handshake, IOC side: may setpoints leave, and must they be read back first?
 *
 * Pure: headers of blocks go in, a state and what to do come out; no socket, no thread, no
 * clock, no records. Source: R. Tanner et al., "Integrating Siemens PLCs and EPICS over
 * Ethernet at the Canadian Light Source" (CHECKSYNC, LOCAL/REMOTE, four-byte header); the
 * bytes of the header are ours, see docs/plc-programming.md.
 *
 *        PLC -> IOC                              IOC -> PLC
 *   byte 0  flags 1 SYNC 2 REMOTE 4 TIMEOUT      flags 1 CHECK 2 DATA
 *   byte 1  counter, +1 per block                counter, +1 per block, heartbeats too
 *   byte 2  layout id, in the byte order of      the same
 *   byte 3  the station; 0 = not checked
 *
 * The PLC decides: it unpacks setpoints only while its SYNC is set, sets it only when a
 * block with CHECK equals what it holds, and clears it when anyone else moves a setpoint.
 * The IOC's part is to never lie: what it sends with CHECK is what it has read back.
 */
#ifndef INC_plcSync_H
#define INC_plcSync_H

#include <stddef.h>

#include <epicsTypes.h>

#define PLC_HEADER_SIZE 4 /* bytes at the start of each block with sync=on */

/* Flags in byte 0 */
enum { plcFlagSync = 1, plcFlagRemote = 2, plcFlagTimeout = 4 }; /* PLC -> IOC */
enum { plcFlagCheck = 1, plcFlagData = 2 };                      /* IOC -> PLC */

typedef enum {
    plcSyncDisconnected,
    plcSyncWaiting,       /* connected, no block yet; nothing is sent */
    plcSyncChecking,      /* what was read back is sent with CHECK */
    plcSyncSynced,        /* the PLC takes setpoints */
    plcSyncLocal,         /* the HMI has control; heartbeats without setpoints */
    plcSyncLayoutMismatch, /* the layout ids differ; nothing is sent */
    plcSyncMapMismatch,   /* the PLC has another table of pointers; nothing is sent */
    plcSyncMapDownload    /* it is getting ours; nothing else is sent */
} plcSyncState;

/* What the station has to do after a step. */
#define plcSyncTake 1 /* all outputs take the values that the PLC shows in this block, and
                         what was written before is forgotten */
#define plcSyncSend 2 /* send a block soon */

typedef struct plcSync {
    plcSyncState state;
    epicsUInt16 layout;  /* our layout id, 0 = not checked */
    epicsUInt16 theirs;  /* the PLC's, of its last block */
    epicsUInt8 counter;  /* of the last block sent */
    int asked;           /* the image is what left with the last CHECK */
    int flags;           /* of the PLC's last block */
} plcSync;

void plcSyncInit(plcSync *sync, epicsUInt16 layout);

/* The PLC that gets our output is there, or is another one now / is gone. */
void plcSyncConnected(plcSync *sync);
void plcSyncLost(plcSync *sync);

/* A block came. `same`: the read-backs in it equal our output image. Returns a mask of
 * plcSyncTake and plcSyncSend. */
int plcSyncBlock(plcSync *sync, const void *header, int same, int bigEndian);

/* The PLC works with another table than our records (plcTables.h), and may be getting
 * ours: the block that came says nothing to us. The next plcSyncBlock begins anew. */
void plcSyncMap(plcSync *sync, const void *header, int download);

/* True when blocks may leave at all in this state. */
int plcSyncMaySend(const plcSync *sync);

/* Writes the header of a block that leaves now. */
void plcSyncHeader(plcSync *sync, void *header, int bigEndian);

/* Why puts are refused in a state, in words for AMSG; "" when they are not. */
const char *plcSyncReason(int state);

const char *plcSyncStateName(int state);

#endif /* INC_plcSync_H */
