/* simFibre: the synchronising link between the two PLCs of a pair. It carries messages,
 * in one process by a call, between two processes by a TCP or unix socket. It does not
 * know what the messages say.
 *
 * On the socket a message is its length (4 bytes, big-endian) and then its bytes.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simFibre_H
#define INC_simFibre_H

#include <sys/socket.h>

#include "simLoop.h"
#include "simMemory.h"

#define SIM_MAX_MESSAGE (SIM_MAX_BLOCK + 64u)

typedef struct simFibre {
    simLoop *loop;
    const char *name; /* for the log */
    void (*message)(void *owner, const epicsUInt8 *bytes, size_t size);
    void (*up)(void *owner); /* a new link: the other end knows nothing */
    void *owner;
    struct simFibre *peer; /* the other end in this process, or NULL */
    struct sockaddr_storage address;
    socklen_t addressSize;
    const char *path; /* of a unix socket, to remove at the end */
    int listener, fd, connecting;
    simTimer retry;
    epicsUInt8 *out; /* bytes to be sent */
    size_t outUsed, outRoom;
    epicsUInt8 *in; /* a message that is arriving */
    size_t inUsed;
} simFibre;

/* Joins two ends in this process. */
void simFibreJoin(simFibre *a, simFibre *b);
/* Opens one end: where is "host:port" or "/path/of/a/socket". The listening end waits,
 * the other one connects and tries again until it is there. Returns 0 or -1 after a
 * message. */
int simFibreOpen(simFibre *fibre, const char *where, int listens);
void simFibreClose(simFibre *fibre);

int simFibreIsUp(const simFibre *fibre);
/* Returns 0, or -1 when the link is down or too much is waiting. */
int simFibreSend(simFibre *fibre, const epicsUInt8 *bytes, size_t size);

#endif
