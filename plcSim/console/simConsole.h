/* simConsole: takes command lines from stdin and from a unix socket, and writes the
 * answers. It does not know the commands.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simConsole_H
#define INC_simConsole_H

#include "simulator.h"

#define SIM_MAX_CONSOLES 16

typedef struct simTypist {
    int in, out; /* descriptors, -1 = unused */
    char line[4096];
    size_t used;
    int overlong; /* the rest of a line that was too long is skipped */
    simText answer;
    size_t written;
} simTypist;

typedef struct simConsole {
    simulator *sim;
    int listener; /* -1 = none */
    char path[108];
    simTypist typists[SIM_MAX_CONSOLES];
} simConsole;

void simConsoleInit(simConsole *console, simulator *sim);
/* Takes commands from stdin until end of file; that does not end the simulator. */
void simConsoleStdin(simConsole *console);
/* Listens on a unix socket, which is made anew. Returns 0 or -1 after a message. */
int simConsoleListen(simConsole *console, const char *path);
void simConsoleClose(simConsole *console);

#endif
