/* plcSimClient: clients of the simulator's servers, over loopback, for their tests.
 * Server and clients share one thread: the loop runs for as long as a client waits.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_plcSimClient_H
#define INC_plcSimClient_H

#include "simClients.h"
#include "simLoop.h"

#define PATIENCE_S 30.0 /* reached only when a test fails */
#define ENDED (-1)      /* the connection has ended ... */
#define WAS_RESET (-2)  /* ... with RST */

/* The loop of the server under test. */
extern simLoop clientLoop;

/* The loop runs a little. */
void clientTurn(void);

#define UNTIL(condition)                                                                 \
    do {                                                                                 \
        double end_ = simNow() + PATIENCE_S;                                             \
        while (!(condition) && simNow() < end_)                                          \
            clientTurn();                                                                \
    } while (0)

/* A connection, as a descriptor; ends the test when there is none. */
int clientDial(const struct sockaddr_in *address);
/* The same, when the server has taken it. */
int clientOpen(simClients *server);
void clientSay(int fd, const char *hex);
/* Waits for `count` bytes. Returns how many came, or ENDED, WAS_RESET when none did. */
long clientHear(int fd, epicsUInt8 *bytes, size_t count);
/* True when exactly these bytes come; ## is any byte. */
int clientHears(int fd, const char *hex);
/* What a client sees as the end of its connection. */
long clientHearsEnd(int fd);

#endif
