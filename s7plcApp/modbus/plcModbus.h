/* The Modbus/TCP side of one PLC: a thread that polls input ranges and writes what has
 * changed, by libmodbus. It is the only one that calls libmodbus, and it may wait for the
 * PLC as long as a request may take; nobody waits for it.
 *
 * Knows ranges, images as bytes, and a socket that is up; no station, no records, no
 * options but its own. It never connects: the station's thread does, and hands the socket
 * over. Functions are called by the station's thread, and never block.
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
#include "plcTransport.h"

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
    plcImage *out;          /* the output image, which keeps its puts; outSize bytes */
    size_t outSize;
    plcFaults *inFaults;    /* where refused reads are put down: the part of a range that
                             * was in the request, once it is read by itself. A fault ends
                             * when the caller of plcModbusTake, who got the good bytes,
                             * comes back for more */
    plcFaults *outFaults;   /* and refused or unanswered writes, bit by bit */
    void (*wake)(void *arg); /* there may be news: any thread; no lock is held */
    void *arg;
} plcModbusSetup;

typedef struct plcModbusOptions {
    double requestTimeout;    /* ms: a whole answer must be there by then */
    double readPeriod;        /* ms between reads of the outputs; 0: at connect only */
    int singleWrite;          /* FC6 and FC5 for single ones */
    int readModifyWrite;      /* FC3 and FC6 where the PLC has no FC22 */
    int heartbeatRegister;    /* holding register, written by FC6; -1: none */
    double heartbeat;         /* ms between two counts; 0: 1000 */
    plcLimits limits;         /* of one request */
    double requestPause;      /* ms between an answer and the next request */
    int anyUnit, anyTransaction; /* not looked at in answers */
    int rtu;                  /* framing */
} plcModbusOptions;

/* No thread yet; but it takes a descriptor for libmodbus, which can only use those below
 * 1024: call it when the PLC is configured. Without one, or without a thread, each
 * connection is lost at once, with the reason. */
plcModbus *plcModbusCreate(const plcModbusSetup *setup);
void plcModbusDestroy(plcModbus *modbus); /* ends and joins the thread */

/* From the next request on. */
void plcModbusSetOptions(plcModbus *modbus, const plcModbusOptions *options);

/* The connection is up: begin (the worker uses a descriptor of its own for it; the caller
 * closes its one when the news say that it is lost, or with plcModbusStop). First the output ranges are read (news: shown or
 * unread), then all input ranges, then each by its period. Orders from before are void.
 * joinedIn, joinedOut (may be NULL) are copied. */
void plcModbusStart(plcModbus *modbus, SOCKET socket, const epicsUInt8 *joinedIn,
                    const epicsUInt8 *joinedOut);

/* New ones, from the next request on. */
void plcModbusJoined(plcModbus *modbus, const epicsUInt8 *joinedIn, const epicsUInt8 *joinedOut);

/* Never mind the connection: it is shut down, a request under way is cut off; no news of
 * it comes any more, and no change of the faults. */
void plcModbusStop(plcModbus *modbus);

/* There are puts in the output image: they leave in their order, neighbours together, and so do
 * those that come before the last of these has left. */
void plcModbusWrite(plcModbus *modbus);

/* What a PLC with holes did not show of the outputs that were taken last: plcTransport.hidden. */
int plcModbusHidden(plcModbus *modbus, void *mask);

/* Fetches the news; `input` and `output` (inSize and outSize bytes) are only filled when
 * blocks or shown are not 0. Returns 0 when there is none. */
int plcModbusTake(plcModbus *modbus, plcNews *news, void *input, void *output);

#endif /* INC_plcModbus_H */
