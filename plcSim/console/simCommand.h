/* simCommand: the commands of the console, as one table. It does not know who types.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simCommand_H
#define INC_simCommand_H

#include "simLog.h"
#include "simulator.h"

/* Runs one line; it is changed. Adds the answer to out: lines, the last of which is "ok"
 * or begins with "error: ". Nothing at all for an empty line or a comment. */
void simCommandRun(simulator *sim, char *line, simText *out);

#endif
