/* The socket of a PLC that is asked by requests: a request leaves, its whole answer comes, up to one
 * deadline.
 *
 * A PLC may close while no request is under way: for the next one there is a new connection, to
 * the same address, and nobody hears of it. The same where the PLC has answered on the connection
 * before, and closes it without a byte in answer: it is asked once more. A reset is another matter:
 * it is what a PLC sends that has started anew, unless its last answer is younger than a second:
 * it has closed behind that, then. What comes again or late is told by its transaction number, and
 * dropped.
 *
 * Knows frames; neither libmodbus nor what requests are for. One thread makes the requests, and
 * may wait; others cut the connection, or bring the next.
 */
#ifndef INC_plcModbusSocket_H
#define INC_plcModbusSocket_H

#include <epicsMutex.h>

#include <netinet/in.h>

#include "plcModbusFrame.h"

/* For the next requests. */
typedef struct plcModbusRequestOptions {
    double timeout;     /* ms: the whole answer must be there by then */
    int unit;           /* 0 to 255 */
    int anyUnit;        /* that of the answer does not matter */
    int anyTransaction; /* nor its number: what is there before a request is dropped */
    int keepSilent;     /* a request without an answer does not end the connection */
    int mayFail;        /* nor does one with a bad answer, which is taken as one without */
    int rtu;            /* framing */
} plcModbusRequestOptions;

typedef struct plcModbusSocket {
    epicsMutexId lock; /* of the relay: guards the next three. The thread alone changes fd */
    int fd, next;      /* in use; to be used from the next request on; -1: none */
    int cut;           /* the connection is not wanted any more */

    /* the thread's own, of the socket in use */
    struct sockaddr_in address; /* of the PLC */
    plcFrame rx;          /* what has come and is no whole answer yet */
    unsigned number;      /* transaction number of the last request, */
    unsigned requests;    /* and how many there were */
    epicsUInt64 answered; /* ns, when the last of them was; 0: none */
} plcModbusSocket;

void plcModbusSocketInit(plcModbusSocket *s, epicsMutexId lock);
void plcModbusSocketFree(plcModbusSocket *s);

/* This one from the next request on; the one in use ends / the connection ends, and a request
 * under way with it. Any thread, with the lock. */
void plcModbusSocketNext(plcModbusSocket *s, int fd);
void plcModbusSocketCut(plcModbusSocket *s);

/* The thread takes the next one, if there is one: returns 1 then / closes the one in use. With
 * the lock. */
int plcModbusSocketTake(plcModbusSocket *s);
void plcModbusSocketClose(plcModbusSocket *s);

/* The same after a loss: what the PLC has not got yet, or not looked at, never gets there. */
void plcModbusSocketAbort(plcModbusSocket *s);

/* The thread makes a request. Returns 0 with a good answer (exceptions are), or -1; *x says how it
 * ended. The unit of *request becomes that of the options. */
int plcModbusSocketAsk(plcModbusSocket *s, plcFrame *request, plcFrame *answer,
                       const plcModbusRequestOptions *o, plcModbusResult *x);

/* The thread drops what is there and was not asked for. Returns 0, or -1: the socket is lost. */
int plcModbusSocketDrop(plcModbusSocket *s, const plcModbusRequestOptions *o, plcModbusResult *x);

#endif /* INC_plcModbusSocket_H */
