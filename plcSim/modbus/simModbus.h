/* simModbus: serves Modbus/TCP beside the blocks, on the same PLC memory, to several
 * clients. It does not know what a register means, nor consoles.
 *
 * All functions run in the thread of the loop and never block: libmodbus sees whole
 * requests only, and what a client does not read waits in a queue of its own.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simModbus_H
#define INC_simModbus_H

#include "simClients.h"
#include "simModbusAnswer.h"
#include "simModbusFaults.h"

#define SIM_MODBUS_HISTORY 1000

typedef struct simModbusCounts {
    epicsUInt64 requests, answers;
    epicsUInt64 function[256]; /* requests */
    epicsUInt64 refused[256];  /* requests that an exception answered */
    epicsUInt64 exception[12]; /* by code */
    epicsUInt64 otherUnit;     /* requests for another unit */
    epicsUInt64 silent;        /* requests that a fault kept from being answered */
    epicsUInt64 garbage;       /* connections closed since they did not speak Modbus */
    unsigned maxRead[2], maxWrite[2]; /* largest request: registers, bits */
} simModbusCounts;

/* One of the last requests, for the console. */
typedef struct simModbusRecord {
    double time; /* s, simNow() scale */
    unsigned client;
    int result; /* exception code, 0 = done, -1 = not answered */
    size_t size;
    epicsUInt8 bytes[SIM_MODBUS_FRAME];
} simModbusRecord;

typedef struct simModbus {
    simLoop *loop;
    const char *name;
    int unit;    /* that is answered, -1 = any */
    int gateway; /* another unit gets exception 11 instead of silence */
    simModbusMap map;
    simAnswerer answerer;
    simClients clients;
    simModbusFaults faults;
    simModbusCounts counts;
    simModbusRecord *history; /* ring of SIM_MODBUS_HISTORY */
} simModbus;

/* Listens on address:port (0 = any free port). name, the map and loop must outlive it.
 * Returns 0, or -1 after a message. */
int simModbusOpen(simModbus *modbus, simLoop *loop, const char *name, const char *address,
                  unsigned port);
/* Ends everything but the map and the configuration; may be opened again. */
void simModbusClose(simModbus *modbus);

/* All counts, and the list of requests, begin anew. */
void simModbusClearCounts(simModbus *modbus);
/* Adds lines that begin with "modbus", their values as name=value. */
void simModbusStatus(const simModbus *modbus, simText *out);
/* Adds the last n requests, oldest first, one a line. */
void simModbusReceived(const simModbus *modbus, unsigned long n, simText *out);

#endif
