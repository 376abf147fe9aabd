/* simBlockServer: blocks over TCP as a server of a PLC: its keys and statements, what it
 * does in the cycle and with a block that came, and its commands. How bytes travel is
 * simBlockTcp's.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simBlockServer_H
#define INC_simBlockServer_H

#include "simBlockTcp.h"
#include "simPlc.h"

/* Of the file. */
typedef struct simBlockKeys {
    int port; /* -1 = none, 0 = any free one */
    int keepFirst;
    double sendWatchdog; /* s, 0 = none */
} simBlockKeys;

/* Read-back: bytes of IE_RX that go into IE_TX when a block was taken. */
typedef struct simMirror {
    size_t from, length, to;
} simMirror;

/* A block that came from the IOC. */
typedef struct simReceived {
    double time; /* s, simNow() scale */
    epicsUInt8 *bytes;
} simReceived;

typedef struct simBlockServer {
    simPlc *plc;
    const simBlockKeys *keys;
    int open;
    simBlockTcp tcp;
    simMirror *mirrors;
    size_t mirrorCount;
    epicsUInt64 ignored;   /* blocks that came while the PLC was passive */
    epicsUInt64 sentBytes; /* when the SEND watchdog looked last */
    double sentTime;       /* s: when bytes left last */
    simReceived *history;  /* ring of the last blocks */
    size_t historySize;
    epicsUInt64 historyCount;
} simBlockServer;

extern const simServerType simBlockServerType;

#endif
