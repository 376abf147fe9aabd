/* simClients: the clients of a server that answers requests: several connections, bytes
 * that come, answers that wait until the client takes them. It does not know a protocol.
 *
 * All functions run in the thread of the loop and never block: what a client does not
 * read waits in a queue of its own.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simClients_H
#define INC_simClients_H

#include <ellLib.h>
#include <epicsTypes.h>

#include "simListener.h"
#include "simLog.h"

#define SIM_MAX_CLIENTS 32
#define SIM_CLIENT_GONE (-1L)

typedef struct simClients simClients;

typedef struct simClient {
    simClients *all;
    unsigned number; /* from 1, never used again */
    int fd;
    char peer[SIM_PEER_SIZE];
    double connectTime; /* s, simNow() scale */
    epicsUInt8 *inbox;  /* all->inboxSize bytes */
    size_t filled;      /* bytes in it */
    ELLLIST queue;      /* what is to be sent */
    size_t queued;      /* bytes in it */
    simTimer timer;
    int ended; /* the client sends no more */
    void *own; /* all->ownSize bytes of the server, which begin as zeros */
} simClient;

struct simClients {
    /* set by the server before simClientsOpen() */
    size_t inboxSize, ownSize; /* bytes; the inbox holds the longest request */
    void *server;
    /* Takes one request from the inbox. Returns the bytes it took, 0 when more must come,
     * or SIM_CLIENT_GONE when it dropped the client. */
    long (*take)(simClient *client);
    void (*gone)(simClient *client); /* before it is freed; NULL = nothing to do */

    simLoop *loop;
    const char *name, *title; /* in the log */
    simListener listener;
    simClient *list[SIM_MAX_CLIENTS]; /* NULL = free */
    int count;
    unsigned serial; /* of the newest client */
    epicsUInt64 connections, sentAway;
    int refuse, unplugged;
};

/* Listens on address:port (0 = any free port). name and title must outlive it. Returns 0,
 * or -1 after a message. */
int simClientsOpen(simClients *all, simLoop *loop, const char *name, const char *title,
                   const char *address, unsigned port);
void simClientsClose(simClients *all);

/* Those below do nothing where nothing was opened. */
/* "127.0.0.1:40124"; static text; NULL: not open. */
const char *simClientsAddress(const simClients *all);
/* Ends all connections with FIN, or with RST. */
void simClientsDrop(simClients *all, int reset, const char *reason);
/* PLC off: connections reset, no listening. PLC on again. */
void simClientsPower(simClients *all, int on);
/* The network cable: nothing is read or sent, new connections get no answer. */
void simClientsUnplug(simClients *all, int on);
/* New connections get RST. */
void simClientsRefuse(simClients *all, int on);
/* Adds " unplugged" and " refuse". Returns how many of them there are. */
int simClientsFaults(const simClients *all, simText *out);

/* Queues bytes (NULL = random ones) that leave `delay` s later; with `last` the
 * connection ends behind them. They leave when the loop comes round. */
void simClientSend(simClient *client, const epicsUInt8 *bytes, size_t size, double delay,
                   int last);
/* Ends a connection; the client is gone afterwards. */
void simClientDrop(simClient *client, int reset, const char *reason);

#endif
