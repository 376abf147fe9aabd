/* simTablesRow: one row of a table of pointers; inside of simTables.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simTablesRow_H
#define INC_simTablesRow_H

#include "simTables.h"

/* Byte 6 of IE_TX; docs/plc-tables.md */
enum {
    errorNone,
    errorPointer,
    errorArea,
    errorBit,
    errorMissing,
    errorForbidden,
    errorEnd,
    errorLengths,
    errorOurs,
    errorTwice,
    errorHidden,
    errorSession = 20,
    errorGap,
    errorPart,
    errorIncomplete,
    errorCrc,
    errorCommand,
    errorLocked,
    errorLocal,
    errorRows,
    errorLate
};

/* Rows that a table says it has; may be negative. */
int simTableRowsTx(const simBlock *table);
int simTableRowsRx(const simBlock *table);

/* 0, or an error of 1 to 10. All rows before it have been found good. */
int simTableCheckRow(const simTables *tables, const simBlock *table, int row);

#endif
