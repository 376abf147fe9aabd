/* Frames between libmodbus and the socket of a PLC: one request, then its answer.
 *
 * libmodbus waits with select(), which corrupts memory with descriptors above 1023. It
 * has one word for all bad answers, and finds no fault with one of another unit. So it
 * never sees the PLC's socket: it talks to one end of a pair of local sockets, and a
 * thread stands at the other. That thread passes the request on, waits for the answer up
 * to one deadline, and looks at it before libmodbus does. For an answer that is bad
 * or does not come, libmodbus gets an exception; plcModbusWireLast has the truth.
 *
 *   libmodbus == pair == this thread == socket == PLC
 *
 *   bytes: 0 1 transaction, 2 3 zero, 4 5 length of the rest, 6 unit, 7 function, 8 ...
 *
 * A PLC may close while no request is under way: for the next one the wire connects again, to
 * the same address, and nobody hears of it. The same where the PLC has answered on the connection
 * before, and closes it without a byte in answer: it is asked once more. A reset is another matter:
 * it is what a PLC sends that has started anew, unless its last answer is younger than a second:
 * it has closed behind that, then. What comes again or late
 * is told by its transaction number, and dropped.
 *
 * With framing rtu there is no header: unit, function, ..., and a CRC behind.
 *
 * Knows frames; not what they are for.
 */
#ifndef INC_plcModbusWire_H
#define INC_plcModbusWire_H

#include <modbus/modbus.h>

#include <osiSock.h>

#include "plcImage.h" /* PLC_REASON_SIZE */

typedef struct plcModbusWire plcModbusWire;

/* How a request ended. */
typedef struct plcModbusResult {
    int lost;                  /* the socket is of no use any more, because: */
    char why[PLC_REASON_SIZE];
    int timeout;               /* it is lost because the answer was late */
    int silent;                /* nothing of an answer came; the socket is kept (see below) */
    int closed, reset;         /* it is lost because the PLC has closed it; by a reset */
    int exception;             /* code of the PLC's answer; 0: none */
    unsigned sent, received;   /* bytes */
    double latency;            /* ms from the request to the whole answer; 0: none came */
} plcModbusResult;

/* For the next requests. */
typedef struct plcModbusWireOptions {
    double timeout;     /* ms: the whole answer must be there by then */
    int unit;           /* 0 to 255 */
    int anyUnit;        /* that of the answer does not matter */
    int anyTransaction; /* nor its number: what is there before a request is dropped */
    int keepSilent;     /* a request without an answer does not end the connection */
    int rtu;            /* framing */
} plcModbusWireOptions;

/* Takes a descriptor below FD_SETSIZE for itself for good: call it early. `broken` is
 * called by the wire's thread when the socket ends while no request is under way. */
plcModbusWire *plcModbusWireCreate(const char *name, void (*broken)(void *arg), void *arg);

/* No call of libmodbus may be under way. Joins the thread. */
void plcModbusWireDestroy(plcModbusWire *wire);

/* The connection from now on; the wire closes it. No call of libmodbus may be under way.
 * Returns 0, or -1 when libmodbus cannot be used: why says so, the socket is closed. */
int plcModbusWireOpen(plcModbusWire *wire, SOCKET socket, char why[PLC_REASON_SIZE]);

/* For the calls of libmodbus; one thread at a time. */
modbus_t *plcModbusWireContext(plcModbusWire *wire);

void plcModbusWireOptionsSet(plcModbusWire *wire, const plcModbusWireOptions *options);

/* How the last request ended. */
void plcModbusWireLast(plcModbusWire *wire, plcModbusResult *exchange);

/* Returns 1 and why when the socket ended while no request was under way, else 0. */
int plcModbusWireBroken(plcModbusWire *wire, char why[PLC_REASON_SIZE]);

/* Ends the connection, and a request under way with it. Any thread; never waits. */
void plcModbusWireCut(plcModbusWire *wire);

#endif /* INC_plcModbusWire_H */
