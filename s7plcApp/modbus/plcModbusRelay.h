/* Frames between libmodbus and the socket of a PLC: one request, then its answer.
 *
 * libmodbus waits with select(), which corrupts memory with descriptors above 1023. It
 * has one word for all bad answers, and finds no fault with one of another unit. So it
 * never sees the PLC's socket: it talks to one end of a pair of local sockets, and a
 * thread stands at the other. That thread passes the request on, waits for the answer up
 * to one deadline, and looks at it before libmodbus does. For an answer that is bad
 * or does not come, libmodbus gets an exception; plcModbusRelayLast has the truth.
 *
 *   libmodbus == pair == this thread == socket == PLC
 *
 * Knows frames; not what they are for.
 */
#ifndef INC_plcModbusRelay_H
#define INC_plcModbusRelay_H

#include <modbus/modbus.h>

#include <osiSock.h>

#include "plcModbusSocket.h"

typedef struct plcModbusRelay plcModbusRelay;

/* Takes a descriptor below FD_SETSIZE for itself for good: call it early. `broken` is
 * called by the relay's thread when the socket ends while no request is under way. */
plcModbusRelay *plcModbusRelayCreate(const char *name, void (*broken)(void *arg), void *arg);

/* No call of libmodbus may be under way. Joins the thread. */
void plcModbusRelayDestroy(plcModbusRelay *relay);

/* The connection from now on; the relay closes it. No call of libmodbus may be under way.
 * Returns 0, or -1 when libmodbus cannot be used: why says so, the socket is closed. */
int plcModbusRelayOpen(plcModbusRelay *relay, SOCKET socket, char why[PLC_REASON_SIZE]);

/* For the calls of libmodbus; one thread at a time. */
modbus_t *plcModbusRelayContext(plcModbusRelay *relay);

void plcModbusRelaySetOptions(plcModbusRelay *relay, const plcModbusRequestOptions *options);

/* How the last request ended. */
void plcModbusRelayLast(plcModbusRelay *relay, plcModbusResult *exchange);

/* Returns 1 and why when the socket ended while no request was under way, else 0. */
int plcModbusRelayBroken(plcModbusRelay *relay, char why[PLC_REASON_SIZE]);

/* Ends the connection, and a request under way with it. Any thread; never waits. */
void plcModbusRelayCut(plcModbusRelay *relay);

#endif /* INC_plcModbusRelay_H */
