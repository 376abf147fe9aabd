/* A simulated PLC for the fuzz targets of the simulator: from a file as text to one that runs.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_fuzzSim_H
#define INC_fuzzSim_H

#include "simulator.h"

/* Builds one PLC from this text, without a word in the log. Returns the number of errors;
 * messages are in out. To be ended with fuzzSimEnd in any case. */
int fuzzSimBuild(simulator *sim, const char *text, simText *out);
void fuzzSimEnd(simulator *sim, simText *out);

#endif
