/* simBlockTcp: the TCP side of one PLC: listens, serves one client, sends and receives
 * blocks. It injects the faults of the wire. It does not know what is in a block.
 *
 * All functions run in the thread of the loop and never block.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simBlockTcp_H
#define INC_simBlockTcp_H

#include "simListener.h"
#include "simLog.h"
#include "simLoop.h"
#include "simMemory.h"

/* What the server tells its owner. */
typedef struct simBlockTcpEvents {
    void (*connected)(void *owner);
    void (*disconnected)(void *owner, const char *reason);
    /* outSize bytes from the IOC */
    void (*received)(void *owner, const epicsUInt8 *block);
    /* flood: the socket takes more, give it a block */
    void (*wantBlock)(void *owner);
} simBlockTcpEvents;

typedef struct simFaults {
    int silence;     /* send nothing */
    int refuse;      /* new connections get RST */
    int stall;       /* read nothing: the client's send backs up */
    int unplugged;   /* cable pulled: send and read nothing, new connections get no answer
                      */
    int flood;       /* send as fast as the socket takes */
    size_t fragment; /* send pieces of this many bytes, 0 = off */
    double fragmentPause; /* s between pieces */
    double delay;         /* s that each block leaves late */
    long truncate;        /* send blocks of this many bytes, -1 = off */
    long cut; /* reset the connection after so many received bytes, -1 = off */
} simFaults;

typedef struct simBlockTcpCounts {
    epicsUInt64 connections;
    epicsUInt64 blocksSent, bytesSent, blocksSkipped;
    epicsUInt64 blocksReceived, bytesReceived;
} simBlockTcpCounts;

typedef struct simBlockTcp {
    simLoop *loop;
    const char *name;
    const simBlockTcpEvents *events;
    void *owner;
    size_t inSize, outSize; /* bytes PLC->IOC and IOC->PLC */
    int keepFirst;     /* a second client is sent away instead of replacing the first */
    int receiveBuffer; /* bytes for SO_RCVBUF, 0 = system default */
    simListener listener;
    int client; /* descriptor, -1 = none */
    char peer[SIM_PEER_SIZE];
    ELLLIST queue;    /* what is to be sent */
    size_t queued;    /* bytes in it */
    int corked;       /* blocks are being collected, to leave together */
    double nextPiece; /* fragment: not before */
    simTimer timer;
    epicsUInt8 *inbox; /* the block that is arriving */
    size_t filled;
    double connectTime, receiveTime;
    simFaults faults;
    simBlockTcpCounts counts;
} simBlockTcp;

/* Starts listening on address:port (0 = any free port). Returns 0, or -1 after a message.
 * name, events and owner must outlive the server. */
int simBlockTcpOpen(simBlockTcp *server, simLoop *loop, const char *name,
                    const char *address, unsigned port, size_t inSize, size_t outSize,
                    const simBlockTcpEvents *events, void *owner);
void simBlockTcpClose(simBlockTcp *server);

/* "127.0.0.1:40123"; static text. */
const char *simBlockTcpAddress(const simBlockTcp *server);
int simBlockTcpConnected(const simBlockTcp *server);
/* True while a block is not yet completely with the kernel. */
int simBlockTcpBusy(const simBlockTcp *server);

/* Queues a block of inSize bytes. While the last one is still leaving, the new one is
 * skipped and counted, as a PLC's SEND does. Returns 0 when queued. */
int simBlockTcpSend(simBlockTcp *server, const epicsUInt8 *block);
/* True when simBlockTcpSend() would take a block now. */
int simBlockTcpReady(const simBlockTcp *server);
/* Sends n random bytes between two blocks. Returns -1 when not connected. */
int simBlockTcpGarbage(simBlockTcp *server, size_t n);

/* Takes back blocks that have not begun to leave. Where one is half out, the connection
 * is reset, since it could only go on with the rest of that block. */
void simBlockTcpForget(simBlockTcp *server);

/* Ends the connection with FIN, or with RST. The owner is told. */
void simBlockTcpDrop(simBlockTcp *server, int reset, const char *reason);
/* PLC off: connection reset, no listening. PLC on again. */
void simBlockTcpPower(simBlockTcp *server, int on);

void simBlockTcpSilence(simBlockTcp *server, int on);
void simBlockTcpRefuse(simBlockTcp *server, int on);
void simBlockTcpStall(simBlockTcp *server, int on);
void simBlockTcpFlood(simBlockTcp *server, int on);
void simBlockTcpUnplug(simBlockTcp *server, int on);
void simBlockTcpDelay(simBlockTcp *server, double seconds);
void simBlockTcpFragment(simBlockTcp *server, size_t bytes, double pause);
/* Everything above back to normal. */
void simBlockTcpClearFaults(simBlockTcp *server);
/* Adds " silence, fragment 3 bytes every 10 ms" or " none". */
void simBlockTcpFaultText(const simBlockTcp *server, simText *out);

#endif
