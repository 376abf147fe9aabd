/* simEip: serves EtherNet/IP to several clients: sessions, requests with and without a
 * connection, what goes wrong on purpose, and a history of requests. It does not know
 * what a request means, nor consoles.
 *
 * All functions run in the thread of the loop and never block.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simEip_H
#define INC_simEip_H

#include "simClients.h"
#include "simEipController.h"

#define SIM_EIP_HISTORY 1000

typedef struct simEipCounts {
    epicsUInt64 requests;  /* 6F and 70 */
    epicsUInt64 connected; /* 70 */
    epicsUInt64 answers;
    epicsUInt64 silent;  /* a fault kept them from being answered */
    epicsUInt64 errors;  /* answered with a status in the header */
    epicsUInt64 ignored; /* options that are not 0, an id that nobody has */
    epicsUInt64 bytesIn, bytesOut;
    size_t largestRequest, largestAnswer; /* bytes of the message */
} simEipCounts;

/* One of the last requests. */
typedef struct simEipRecord {
    double time; /* s, simNow() scale */
    unsigned client;
    int connected;
    unsigned sequence;
    unsigned error;               /* status in the header of the answer */
    epicsUInt8 *request, *answer; /* messages; answer NULL = none */
    size_t requestSize, answerSize;
} simEipRecord;

/* What is known of a client. */
typedef struct simEipClient {
    epicsUInt32 session; /* 0 = none */
    epicsUInt64 requests;
    int mute;         /* a part of an answer left: nothing more will */
    epicsUInt8 *last; /* the message of the last answer, for `old` */
    size_t lastSize;
    epicsUInt8 *held; /* a frame that leaves behind the next one */
    size_t heldSize;
} simEipClient;

typedef struct simEip {
    simLoop *loop;
    const char *name;
    simEipController controller;
    int lostSilent; /* a connection id that nobody has: no answer instead of an error */
    simClients clients;
    simEipCounts counts;
    double second; /* the whole second that requests are counted in */
    unsigned inSecond, lastSecond;
    simEipRecord *history; /* ring of SIM_EIP_HISTORY */
    epicsUInt64 historyCount;
} simEip;

/* Listens on address:port (0 = any free port). name and loop must outlive it; the
 * controller is made already. Returns 0, or -1 after a message. */
int simEipOpen(simEip *eip, simLoop *loop, const char *name, const char *address,
               unsigned port);
/* Ends everything but the controller; may be opened again. */
void simEipClose(simEip *eip);

/* PLC off: all connections end. PLC on again. */
void simEipPower(simEip *eip, int on);

/* All counts, and the list of requests, begin anew. */
void simEipClear(simEip *eip);
/* Adds lines that begin with "etherip", their values as name=value. */
void simEipStatus(const simEip *eip, simText *out);
/* Adds the last n requests, oldest first, one a line. */
void simEipReceived(const simEip *eip, unsigned long n, simText *out);

#endif
