/* simPlcFile: the statements of the file, for simPlc alone.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simPlcFile_H
#define INC_simPlcFile_H

#include "simPlc.h"

/* Runs the statements of one pass: 0 makes memory, 1 uses it. Messages go to out. Returns
 * the number of errors. */
int simPlcStatements(simPlc *plc, int pass, simText *out);
/* Those that are done again at a cold restart. */
void simPlcStatementsCold(simPlc *plc);

#endif
