/* simEipValue: values of tags as text, for the console and the file. It does not know
 * requests.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simEipValue_H
#define INC_simEipValue_H

#include "simEipTags.h"
#include "simSignal.h"

/* Sets `count` words from this place on: one for each element, or one for all of them; a
 * structure is set by its members. Nothing is written on error. Returns 0, or -1 with the
 * reason in error. */
int simEipValueSet(const simEipPlace *place, char **words, size_t count,
                   char error[SIM_ERROR_SIZE]);
/* Adds the value: "1 2 3", "\"text\"", "{Open=1 Position=2.5}". */
void simEipValueGet(const simEipPlace *place, simText *out);

/* Reads the words of a signal ("sine -5 5 20s") that moves the whole tag. */
int simEipValueSignal(const simMemory *mem, const simEipTag *tag, char **words,
                      size_t count, simSignal *signal, char error[SIM_ERROR_SIZE]);

#endif
