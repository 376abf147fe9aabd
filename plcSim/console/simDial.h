/* simDial: the other end of the console: sends command lines to a simulator that runs,
 * and prints the answers. It waits, and knows nothing of a PLC.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simDial_H
#define INC_simDial_H

/* Sends one command made of these words, or, with none, the lines of stdin with a prompt
 * on a terminal. Returns an exit status: 0, or 1 when the last answer was an error or the
 * simulator cannot be reached. */
int simDial(const char *path, char **words, int count);

#endif
