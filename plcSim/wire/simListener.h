/* simListener: a listening TCP socket that can be pulled, refused or switched off. It
 * hands new connections to its owner and knows nothing of what they say.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simListener_H
#define INC_simListener_H

#include <netinet/in.h>

#include "simLoop.h"

#define SIM_DECOYS 8
#define SIM_PEER_SIZE 64

/* A new connection: non-blocking, TCP_NODELAY. The owner must close fd. */
typedef void (*simAcceptFn)(void *owner, int fd, const char *peer);

typedef struct simListener {
    simLoop *loop;
    const char *name; /* in the log */
    simAcceptFn accepted;
    void *owner;
    struct sockaddr_in address;
    int receiveBuffer;      /* bytes for SO_RCVBUF, 0 = system default */
    int fd;                 /* -1 = none */
    int down;               /* PLC is off */
    int refuse;             /* new connections get RST */
    int unplugged;          /* new connections get no answer */
    int decoys[SIM_DECOYS]; /* own connections that fill the accept queue while unplugged
                             */
} simListener;

/* Listens on address:port (0 = any free port). Returns 0, or -1 after a message. name and
 * owner must outlive the listener. receiveBuffer may be set before. */
int simListenerOpen(simListener *listener, simLoop *loop, const char *name,
                    const char *address, unsigned port, simAcceptFn accepted,
                    void *owner);
void simListenerClose(simListener *listener);

/* "127.0.0.1:40123"; static text. */
const char *simListenerAddress(const simListener *listener);

/* Off: nothing listens, but the port stays ours. */
void simListenerPower(simListener *listener, int on);
void simListenerRefuse(simListener *listener, int on);
/* Unplugged: connects get no answer; those that are tried come through when plugged. */
void simListenerUnplug(simListener *listener, int on);

#endif
