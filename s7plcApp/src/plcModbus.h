/* The Modbus/TCP side of one PLC: a thread that polls input ranges and writes what has
 * changed, by libmodbus. It is the only one that calls libmodbus, and it may wait for the PLC
 * as long as a request may take; nobody waits for it.
 *
 * Knows ranges, images as bytes, and a socket that is up; no station, no records, no options
 * but its own. It never connects: the station's thread does, and hands the socket over.
 * Functions are called by the station's thread, and never block.
 */
#ifndef INC_plcModbus_H
#define INC_plcModbus_H

#include <stddef.h>

#include <epicsTime.h>
#include <epicsTypes.h>
#include <osiSock.h>

#include "plcFaults.h"
#include "plcImage.h"
#include "plcModbusPlan.h"

typedef struct plcModbus plcModbus;

typedef struct plcModbusSetup {
    const char *name;       /* of the PLC; the thread is called "<name>-mb" */
    int unit;               /* 0 to 255 */
    int bigEndian;          /* byte order of a register in both images; 1: MSB first */
    const plcRange *inputs; /* stay where they are */
    unsigned inputCount;
    size_t inSize;          /* bytes of the input image */
    const plcRange *outputs;
    unsigned outputCount;
    size_t outSize;
    plcFaults *inFaults;    /* where refused ranges are put down, whole ranges */
    plcFaults *outFaults;   /* and refused or unanswered writes, bit by bit */
    void (*wake)(void *arg); /* there is news: any thread */
    void *arg;
} plcModbusSetup;

typedef struct plcModbusOptions {
    double requestTimeout;    /* ms */
    double readPeriod;        /* ms between two reads of the output ranges, 0: at connect only */
    int singleWrite;          /* FC6 and FC5 for single ones */
    int readModifyWrite;      /* where the PLC has no FC22 */
    int heartbeatRegister;    /* holding register, -1: none */
    double heartbeat;         /* ms between two counts */
} plcModbusOptions;

/* What has happened since the last plcModbusTake. */
typedef struct plcModbusNews {
    int lost;                  /* the socket is of no use any more, because: */
    char why[PLC_REASON_SIZE]; /* "no answer for 1.0 s", "closed by the PLC", ... */
    unsigned blocks;           /* times the input image was filled anew; the newest is in */
    epicsTimeStamp stamp;      /* `input`, complete at this time */
    int shown;                 /* 1: `output` holds what the PLC has in the output ranges */
    char unread[PLC_REASON_SIZE]; /* "": or why the PLC does not show them at connect */
    int inFaults, outFaults;   /* 1: something changed in these */
    char log[PLC_REASON_SIZE + 80]; /* a line for the log, "": none. Transitions only */
    int idle;                  /* all writes that were ordered are through (or refused) */
    /* counts since the last call */
    unsigned requests, exceptions, timeouts;
    epicsUInt64 bytesIn, bytesOut; /* of requests and answers */
    unsigned writes;           /* write requests that were acknowledged */
    double latency;            /* ms, last request; 0: none */
    double latencyMax;         /* ms */
} plcModbusNews;

plcModbus *plcModbusCreate(const plcModbusSetup *setup); /* no thread yet */
void plcModbusDestroy(plcModbus *modbus);                /* ends and joins the thread */

void plcModbusSetOptions(plcModbus *modbus, const plcModbusOptions *options);

/* The connection is up: begin (the worker uses a descriptor of its own for it). First the
 * output ranges are read (news: shown or unread), then all input ranges, then each by its
 * period. Orders from before are void. glueIn, glueOut (may be NULL) are copied. */
void plcModbusStart(plcModbus *modbus, SOCKET socket, const epicsUInt8 *glueIn,
                    const epicsUInt8 *glueOut);

/* Never mind the connection: a request under way is cut off; no news of it comes any more. */
void plcModbusStop(plcModbus *modbus);

/* Writes the bits of `image` that are set in `mask`, both outSize bytes. Joins what was
 * ordered before and has not left; the newest value of a bit counts. */
void plcModbusWrite(plcModbus *modbus, const void *image, const void *mask);

/* Fetches the news; `input` and `output` (inSize and outSize bytes) are only filled when
 * blocks or shown are not 0. Returns 0 when there is none. */
int plcModbusTake(plcModbus *modbus, plcModbusNews *news, void *input, void *output);

#endif /* INC_plcModbus_H */
