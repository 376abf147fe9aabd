/* A station: one PLC as the IOC sees it, and the one thread that serves it.
 *
 * The thread owns the connections, timers, policy and sync state. Records meet it only in
 * the two images and in the functions below. Functions that say "any thread" do not block
 * on the network, ever.
 */
#ifndef INC_plcStation_H
#define INC_plcStation_H

#include <stddef.h>
#include <stdio.h>

#include <dbScan.h>
#include <ellLib.h>
#include <epicsMutex.h>
#include <epicsTime.h>
#include <epicsTypes.h>

#include "plcFaults.h"
#include "plcImage.h"
#include "plcOptions.h"
#include "plcPolicy.h"
#include "plcStats.h"
#include "plcPointers.h"
#include "plcTransport.h"
#include "plcOwners.h"

typedef struct plcStation plcStation;

typedef enum {
    plcStateNoAddress,  /* configured without one; "S7plc addr" brings it */
    plcStateConnecting, /* no connection, or not even an address yet */
    plcStateWaiting,    /* connected, no block yet on this connection */
    plcStateOk,
    plcStateWrongSize,  /* the PLC sends blocks of another size */
    plcStateFrozen,     /* blocks come, but the alive word stands still */
    plcStateNoPrimary,  /* a pair of which neither sends */
    plcStateLayout,     /* sync=on or layoutAt, and the layout ids differ */
    plcStateSome,       /* the PLC refuses to show some of its registers; the others are ok */
    plcStateRefused     /* it refuses all */
} plcStationState;

typedef struct plcStationConfig {
    const char *name;       /* 1 to PLC_NAME_MAX characters, no '/', no blank */
    const char *address[PLC_LINES_MAX]; /* host name or dotted IP, or "" (records of
                               "S7plc addr" will bring it) */
    unsigned plus[PLC_LINES_MAX]; /* added to the address found: 1 for IPaddr+1 */
    int port;               /* TCP port of the PLC, 1 to 65535, or 0 with an address "" */
    size_t inSize;          /* bytes PLC -> IOC, 0: nothing is read */
    size_t outSize;         /* bytes IOC -> PLC, 0: nothing is written */
    int bigEndian;          /* byte order on the wire: 1 MSB first */
    unsigned recvTimeout;   /* ms from block to block */
    unsigned sendInterval;  /* ms between two output blocks at least */
    const plcPolicy *policy;
    void *policyPvt;
    const plcTransport *transport; /* by which all data goes */
    const void *transportOwn; /* its own setup; the transport makes a copy */
    int follows;            /* 1: the options scan=changed and track=on to begin with */
} plcStationConfig;

#define PLC_BLOCK_MAX (16u << 20) /* bytes: a larger block is a typing error */

/* Makes a station. All arguments have been checked (plcConfigure does). Before iocInit its
 * thread waits for plcStationsStart; later it starts at once. Returns NULL, after an error
 * line, when the process has no descriptors left; the policy stays with the caller then. */
plcStation *plcStationCreate(const plcStationConfig *config);

/* Before iocInit: outputs of a station without a worker leave by this transport, to this
 * host ("": that of the station) and port. Returns 0, and the transport has a copy of `own`;
 * or -1 with the message in error. */
int plcStationOutputBy(plcStation *station, const char *host, int port,
                       const plcTransport *transport, const void *own, char *error, size_t size);

/* The station of this name, or NULL. Any thread. */
plcStation *plcStationFind(const char *name);

/* Calls visit for each station, in the order of their configuration. Any thread. */
void plcStationEach(void (*visit)(plcStation *station, void *arg), void *arg);

/* Names of all stations, separated by blanks, for error messages; "..." where there is no room
 * for more. */
void plcStationNames(char *text, size_t size);

/* Starts the threads of all stations (iocInit) / tells them that all records are there / that
 * the PINI run is over and scans are on / ends and joins them (before the database goes; one
 * that does not end in 5 s is left behind, with an error line). The stations of an IOC that
 * has ended stay, not connected and not found any more, until the next IOC of this process is
 * configured or starts. */
void plcStationsStart(void);
void plcStationsReady(void);
void plcStationsRun(void);
void plcStationsStop(void);

/* For unit tests: stops and frees all stations. No record may refer to one. */
void plcStationsDestroy(void);

/* --- What records need; any thread ----------------------------------------------------- */

const char *plcStationName(const plcStation *station);

/* The order of plcCodec.h for values of this PLC: its byte order and the option
 * wordOrder; and for texts: the option textOrder. */
int plcStationOrder(const plcStation *station);
int plcStationTextOrder(const plcStation *station);

/* The wire by which values are found by their names in the PLC, for people; NULL: they have
 * offsets. */
const char *plcStationByName(const plcStation *station);
/* How their links look then: "DTYP \"X\", as in @PLC name". */
const char *plcStationNameForm(const plcStation *station);

/* As `tells` of plcTransport.h. Returns 0 where the type of the record tells. Any thread. */
int plcStationTells(const plcStation *station, const void *image, size_t offset, char *what,
                    size_t whatSize, char *value, size_t valueSize);

/* May a value lie in these bytes of the input or output block, as far as its transport knows? As
 * `holds` of plcTransport.h. The caller has compared them with the sizes before. */
int plcStationHolds(const plcStation *station, int output, size_t offset, size_t length,
                    const void *mask, size_t *fits, char *error, size_t errorSize);

size_t plcStationInSize(const plcStation *station);
size_t plcStationOutSize(const plcStation *station);
plcImage *plcStationInput(plcStation *station);  /* never NULL */
plcImage *plcStationOutput(plcStation *station); /* never NULL */

/* Writes into the output image and wakes the thread when needed. Returns 0; or -1 with
 * the reason, when writes are refused now (offlineWrites=reject, not synchronised, LOCAL):
 * then nothing was written.
 * Returns 0 with a reason that is not empty when the PLC is away but the value is kept. */
int plcStationWrite(plcStation *station, size_t offset, size_t length, const void *data,
                    const void *mask, char reason[PLC_REASON_SIZE]);

/* A put on its way, where the wire acknowledges it and the option complete=acknowledged is set;
 * else its number is 0. */
typedef struct plcPutMark {
    epicsUInt64 number;
    int losses; /* of the connection before it */
} plcPutMark;

/* The same, with the mark (may be NULL). follows: to a place with a read-back; on each
 * connection the PLC's value comes first, so that nothing of what was written before leaves
 * with it. */
int plcStationPut(plcStation *station, size_t offset, size_t length, const void *data,
                  const void *mask, char reason[PLC_REASON_SIZE], int follows,
                  plcPutMark *mark);

/* The same by one who asks what becomes of it: his place, plcLastPut. */
int plcStationPutBy(plcStation *station, plcLastPut *last, size_t offset, size_t length,
                    const void *data, const void *mask, char reason[PLC_REASON_SIZE],
                    int follows, plcPutMark *mark);

/* Returns 1 and the reason when what is put now cannot leave, and is kept; else 0 and "". */
int plcStationKeeps(plcStation *station, int follows, char reason[PLC_REASON_SIZE]);

/* Blocks: why the put, in whose place the PLC's first value has come, is not in the PLC. NULL: it
 * had left, and the PLC had sent on, before the connection was lost. Over other wires NULL: the
 * image knows. */
const char *plcStationVoid(plcStation *station, const plcLastPut *last);

/* Option track is on. */
int plcStationTracks(plcStation *station);

/* The IOC ends: plcStationsStop was called. Any thread. */
int plcStationStops(const plcStation *station);

/* Does the wire acknowledge puts? Then marks have numbers, unless complete=sent. */
int plcStationAcknowledges(plcStation *station);

/* 1 when the PLC has taken or refused the put, or the connection was lost since. */
int plcStationThrough(plcStation *station, const plcPutMark *mark);

/* The put with a number is to be made no more, and what becomes of it. */
plcPutFate plcStationCancel(plcStation *station, const plcPutMark *mark, size_t offset,
                            size_t length, const void *mask);

/* through(station) is called in a callback thread when puts may be through, while somebody
 * waits for one (plcStationAwait with 1, until the same with -1; plcStationOnThrough first). */
void plcStationOnThrough(plcStation *station, void (*through)(plcStation *station));
void plcStationAwait(plcStation *station, int more);

/* --- A second face of the station, beside the records (an asyn port) ---------------------- */

/* What it is told; a NULL function is left out. All are called in the station's thread,
 * which waits for them: they must not block, and a block is theirs until they return. */
typedef struct plcListener {
    /* The PLC that leads sent this block of inSize bytes: it was not looked at yet. */
    void (*received)(void *pvt, const void *block);
    /* The records have this block now. */
    void (*delivered)(void *pvt, const void *block, const epicsTimeStamp *stamp);
    /* All bytes of this output block, outSize bytes, are with the kernel; by a transport:
     * what has changed of it is on its way. */
    void (*sent)(void *pvt, const void *block);
    /* Puts may be through: plcStationThrough. */
    void (*through)(void *pvt);
    /* The connection or the validity of the input may have changed: ask again. */
    void (*changed)(void *pvt);
    /* The station goes with its IOC; its thread has ended. In the thread that makes the next
     * IOC, with the list of stations locked. */
    void (*gone)(void *pvt);
} plcListener;

/* Registers the one listener of a station, or takes it back (NULL); before iocInit. Returns 0;
 * or -1 when there is one, or the station runs already. */
int plcStationListen(plcStation *station, const plcListener *listener, void *pvt);

/* --- Read-back: the PLC shows what it holds of our outputs ------------------------------- */

/* The table of pointers that the PLC is to work with (option map). Becomes the station's.
 * Returns -1 after iocInit, when it stays the caller's. */
int plcStationSetTable(plcStation *station, plcPointers *table);

/* Bytes at the start of both blocks that are no data: the header of sync=on, or 0. */
size_t plcStationHeader(const plcStation *station);

/* `length` bytes at `out` of the output block are shown at `in` of the input block, only
 * the bits in mask (NULL: all; else length <= PLC_MASK_MAX). `key` is one record. */
void plcStationAddReadback(plcStation *station, const void *key, size_t out, size_t in,
                           size_t length, const void *mask);
void plcStationRemoveReadback(plcStation *station, const void *key);

/* True when outputs without R= have to be added too (in: PLC_NO_PLACE), because the PLC shows
 * them where they are: a transport, with track=on. */
int plcStationShowsOutputs(plcStation *station);
#define PLC_NO_PLACE ((size_t)-1)

/* Where the option readback= shows byte 0 of the output block; -1: not set. */
long plcStationMirror(plcStation *station);

/* True when the output image holds what the PLC has shown, not only what was written. */
int plcStationTaken(plcStation *station);

/* How often that began: on each connection once. */
int plcStationTakes(plcStation *station);

/* True while no output leaves although the PLC is connected: on this connection it has not
 * shown yet the values of outputs with a read-back, or its layout id, or (a transport with
 * requests) what it holds. */
int plcStationHeld(plcStation *station);

/* follow(station) is called in a callback thread after the PLC came or went, after outputs
 * took values from it, after it refused or took a value that it had refused, and when there
 * is another reason why there is no data. */
void plcStationOnTake(plcStation *station, void (*follow)(plcStation *station));

/* Asks for such a call. */
void plcStationTell(plcStation *station);
/* The same, but not before there is news of the PLC. */
void plcStationTellLater(plcStation *station);

/* 1 while TCP to the PLC is up; of a pair: to the one that leads, and in a switch-over
 * while the data is still valid. *reason (may be NULL) says why not. */
int plcStationConnected(plcStation *station, char reason[PLC_REASON_SIZE]);

/* The same for the connection by which outputs leave, which may be another one. */
int plcStationOutputConnected(plcStation *station, char reason[PLC_REASON_SIZE]);

/* Bits of the input or output image that the PLC did not give or take, and why: where the
 * wire tells, else NULL. Stays the same after iocInit. */
plcFaults *plcStationInFaults(plcStation *station);
plcFaults *plcStationOutFaults(plcStation *station);

/* Returns 1, and why, when the PLC does not show one of these bits (mask NULL: of these bytes) of the
 * output image: nobody knows what it holds there. */
int plcStationHides(plcStation *station, size_t offset, size_t length, const void *mask,
                    char reason[PLC_REASON_SIZE]);

/* Lists for get_ioint_info. Input: processed when a block came (option scan), and once when
 * data was lost; never before the first block. Length 0: with scan=changed only when data
 * comes or goes. Output: every sendInterval while connected, after the send. Status: when
 * the state of the connection changes. A record that joins a running IOC is processed at once,
 * but for outputs. See plcScanRecord and plcScanJoin. */
IOSCANPVT plcStationInRecord(plcStation *station, size_t offset, size_t length,
                             struct dbCommon *prec, int leave);
IOSCANPVT plcStationInScan(plcStation *station, size_t offset, size_t length, int prio,
                           int leave);
IOSCANPVT plcStationOutScan(plcStation *station, int prio, int leave);
IOSCANPVT plcStationStatusRecord(plcStation *station, struct dbCommon *prec, int leave);

/* The same for statistics: when the state changes, and once a second. */
IOSCANPVT plcStationStatsScan(plcStation *station, int prio, int leave);

/* Lists of records of this station, for device support, which knows what each is for. The lock
 * guards them all; it is never held while a record is locked by who holds it, or processes. */
#define PLC_LISTS 4
typedef struct plcLists {
    epicsMutexId lock;
    ELLLIST list[PLC_LISTS];
} plcLists;

plcLists *plcStationLists(plcStation *station);

/* The records of this station, for those who add and remove them. */
plcOwners *plcStationOwners(plcStation *station);

/* The address of the PLC as "host:port" text (of the FIRST of a pair); moving it closes
 * the connection and connects anew at once. `text` is host[:port]. Returns 0 or -1 with the
 * message in error. */
void plcStationAddress(plcStation *station, char *text, size_t size);

/* The same for one connection of a pair: 0 FIRST, 1 SECOND; "" where there is none. */
void plcStationLineAddress(plcStation *station, unsigned line, char *text, size_t size);

/* The name of another station that was configured with a connection to the same host and port,
 * compared as they were written; NULL: none. Any thread. */
const char *plcStationSharing(plcStation *station);

int plcStationMove(plcStation *station, const char *text, char *error, size_t size);

/* All its connections end, and are made anew. Any thread. */
void plcStationReconnect(plcStation *station);

/* A line in the log of this PLC; transitions only, at most some per minute pass, the rest
 * is counted. Only for a policy, in the station's thread. `severity` is an errlogSevEnum. */
void plcStationLog(plcStation *station, int severity, const char *text);

/* The same, with the record before it whose place begins in these bytes of the images; room 0: none. */
void plcStationLogOf(plcStation *station, int severity, size_t at, size_t room, const char *text);

/* Sends the output image now, changed or not (s7plcSend). */
void plcStationSend(plcStation *station);

/* --- Options, statistics, reports; any thread ------------------------------------------ */

/* Sets an option of plcOptions.h by its key. Returns 0 or -1 with the message in error. */
int plcStationSetOption(plcStation *station, const char *key, const char *value,
                        char *error, size_t size);

/* A copy of the options as they are now. */
void plcStationGetOptions(plcStation *station, plcOptions *options);

/* A consistent copy of the counters. */
void plcStationStats(plcStation *station, plcStats *stats);
void plcStationStatsReset(plcStation *station);

/* level 0: one line, 1: options and counters, 2: histograms */
void plcStationReport(plcStation *station, FILE *file, int level);
void plcStationOptions(plcStation *station, FILE *file);

/* The options that are not at their default: "heartbeat=500 scan=changed". */
void plcStationOptionsText(plcStation *station, char *text, size_t size);

/* A plcStationState in words. */
const char *plcStateName(int state);

#endif /* INC_plcStation_H */
