/* simEipConnections: CIP connections: Forward Open, its large form, Forward Close, who
 * owns one and when it times out. It knows no socket and no clock: time is given.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simEipConnections_H
#define INC_simEipConnections_H

#include <stddef.h>
#include <epicsTypes.h>

#define SIM_EIP_CONNECTIONS 64

typedef struct simEipConnection {
    int used;
    epicsUInt32 toTarget;           /* id that requests carry (O->T), ours */
    epicsUInt32 toOriginator;       /* id that answers carry (T->O), the client's */
    unsigned serial, vendor;        /* the triad ... */
    epicsUInt32 originator;         /* ... names a connection */
    size_t requestSize, answerSize; /* bytes, sequence count included */
    double timeout;                 /* s without a request */
    double heard;                   /* s: when the last came */
    unsigned client;                /* who opened it; 0 = that TCP connection is gone */
    int hasSequence;
    unsigned sequence;  /* of the last request */
    epicsUInt8 *answer; /* to it, sent again when it comes again */
    size_t answerLength;
    epicsUInt64 requests, duplicates;
} simEipConnection;

typedef struct simEipConnections {
    simEipConnection list[SIM_EIP_CONNECTIONS];
    size_t most; /* how many there may be */
    epicsUInt32 seed;
    epicsUInt64 opened, refused, closed, timedOut, duplicates, lost;
} simEipConnections;

void simEipConnectionsInit(simEipConnections *all, size_t most);
void simEipConnectionsFree(simEipConnections *all);

/* Ends those whose time is over. */
void simEipConnectionsExpire(simEipConnections *all, double now);
/* The TCP connection of this client is gone; its CIP connections live on. */
void simEipConnectionsLeave(simEipConnections *all, unsigned client);
size_t simEipConnectionsCount(const simEipConnections *all);
/* All end, as when the power goes. */
void simEipConnectionsClear(simEipConnections *all);

/* By the id that requests carry, NULL when there is none. */
simEipConnection *simEipConnectionFind(simEipConnections *all, epicsUInt32 toTarget);
/* By its triad. */
simEipConnection *simEipConnectionTriad(simEipConnections *all, unsigned serial,
                                        unsigned vendor, epicsUInt32 originator);
struct simEipController;
struct simEipRequest;
struct simEipAnswer;
struct simEipOrigin;

/* Services of the connection manager, class 06: 54 5B 4E. */
void simEipForwardOpen(struct simEipController *c, const struct simEipOrigin *origin,
                       const struct simEipRequest *request, int isLarge,
                       struct simEipAnswer *answer);
void simEipForwardClose(struct simEipController *c, const struct simEipRequest *request,
                        struct simEipAnswer *answer);
/* Unconnected_Send (52): checks route and size; *message is what it carries. Returns a
 * general status, with its extended status at *extended. */
int simEipUnconnectedSend(const struct simEipController *c,
                          const struct simEipRequest *request, const epicsUInt8 **message,
                          size_t *size, unsigned *extended);

#endif
