/* simTransfers: what moves between PLC memory and the blocks IE_TX and IE_RX, by the transfers of
 * a program and its pointers. It does not know when.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simTransfers_H
#define INC_simTransfers_H

#include "simProgram.h"

/* Words behind "tx" or "rx":  <from> -> <to>, each an address or an ANY pointer. */
int simTransfersAdd(simProgram *program, int isTx, char **words, size_t count,
                    char error[SIM_ERROR_SIZE]);
/* Makes the pointer tables, after the transfers are added. Returns -1 with the reason in error. */
int simTransfersInit(simProgram *program, unsigned txPtrsDb, unsigned rxPtrsDb,
                     char error[SIM_ERROR_SIZE]);
/* Writes the pointer tables as configured. */
void simTransfersFill(simProgram *program);
void simTransfersFree(simProgram *program);

/* Moves all of one direction. */
void simTransfersCopy(simProgram *program, simTransfers *transfers);
/* 1 when all of the other direction are in these bytes, as IE_RX has them, as in the memory; else
 * program->difference says which not. */
int simTransfersSame(simProgram *program, epicsUInt8 *setpoints);

#endif
