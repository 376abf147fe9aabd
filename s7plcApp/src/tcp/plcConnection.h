/* One TCP connection, without blocking: bytes come, and bytes leave.
 *
 * Knows sockets; knows nothing of where blocks begin, of stations, records, policies or what the
 * bytes mean. All functions are called by the station's thread; none waits.
 * Protocol: "send/receive" of Siemens S7 communication processors: raw blocks, no header,
 * inSize bytes PLC -> IOC, outSize bytes IOC -> PLC (papers: CLS 2013, Phoenix 2013).
 */
#ifndef INC_plcConnection_H
#define INC_plcConnection_H

#include <stddef.h>

#include <epicsTypes.h>
#include <osiSock.h>

typedef enum {
    plcConnectionDown,       /* no socket */
    plcConnectionConnecting, /* TCP handshake under way */
    plcConnectionUp
} plcConnectionState;

typedef struct plcConnection {
    plcConnectionState state;
    SOCKET socket;
    epicsUInt64 since;    /* monotonic ns: when `state` began */
    epicsUInt64 lasted;   /* ns: how long the last connection was up */
    epicsUInt64 given;    /* bytes that the kernel got on this connection */
    epicsUInt64 marked;   /* of them, so many at the time markedAt: not all acknowledged since */
    epicsUInt64 markedAt; /* monotonic ns */
    char error[80];       /* why it is down, in words: "connection refused" */
} plcConnection;

void plcConnectionInit(plcConnection *c);

/* Starts to connect; host and port in network byte order. Returns 0, or -1 with c->error. */
int plcConnectionOpen(plcConnection *c, struct in_addr host, unsigned short port,
                      epicsUInt64 now);

/* `why` may be NULL: keeps c->error. */
void plcConnectionClose(plcConnection *c, const char *why, epicsUInt64 now);

/* The same, and what the kernel has not brought to the PLC yet never gets there: no other
 * end of a cable may find an old block when it is plugged in again. */
void plcConnectionAbort(plcConnection *c, const char *why, epicsUInt64 now);

/* True when all that was sent has reached the PLC's host. */
int plcConnectionDelivered(const plcConnection *c);

/* What to wait for in poll(), given that the caller is ready for input; `sending`: and that there
 * is more to send. */
short plcConnectionEvents(const plcConnection *c, int sending);

/* After poll() reported something while connecting. Returns 1 when the connection is up,
 * 0 not yet, -1 failed (closed, c->error says why). */
int plcConnectionFinish(plcConnection *c, epicsUInt64 now);

/* Reads what is there, `room` bytes at most. Returns their number (0: none), or -1 when the
 * connection is lost (closed, c->error says why). */
int plcConnectionReceive(plcConnection *c, void *space, size_t room, epicsUInt64 now);

/* True when what was sent has left the kernel, too: the network has it, and the PLC's host has told
 * so or is about to. Where the system does not tell (see plcConnectionSmall), always. */
int plcConnectionReady(plcConnection *c, epicsUInt64 now);

/* Where the system does not tell what has left: its send buffer holds hardly more than this. */
void plcConnectionSmall(plcConnection *c, size_t size);

/* Sends what the kernel takes. Returns the number of bytes, or -1 when the connection is lost
 * (closed, c->error says why). */
int plcConnectionSend(plcConnection *c, const void *bytes, size_t count, epicsUInt64 now);

#endif /* INC_plcConnection_H */
