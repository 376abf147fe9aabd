/* simEipServer: EtherNet/IP as a server of a PLC: its keys, its statements and its
 * command. What they do is done elsewhere.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simEipServer_H
#define INC_simEipServer_H

#include "simEip.h"
#include "simPlc.h"

/* Of the file. */
typedef struct simEipKeys {
    int port; /* -1 = no EtherNet/IP, 0 = any free one */
    int profile;
    unsigned slot;
    char program[32];
    int key;
    int lostSilent, refuseExtra;
    unsigned connections;
    unsigned size; /* largest connection in bytes, 0 = what the profile has */
} simEipKeys;

typedef struct simEipServer {
    simPlc *plc;
    const simEipKeys *keys;
    simEipProfile profile; /* as the keys have changed it */
    size_t tags;           /* statements */
    simEip eip;
} simEipServer;

extern const simServerType simEipServerType;

#endif
