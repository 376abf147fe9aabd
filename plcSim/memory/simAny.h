/* simAny: ANY pointers of Siemens PLCs: text, ten bytes, and what they point to.
 *
 *          0      1      2      3      4      5      6      7 ... 9
 *      +------+------+-------------+-------------+------+-------------+   always
 *      | 0x10 | type |    count    |  DB number  | area | bit address |   big-endian
 *      +------+------+-------------+-------------+------+-------------+
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simAny_H
#define INC_simAny_H

#include "simMemory.h"

#define SIM_ANY 10 /* bytes of an ANY pointer */

typedef struct simAny {
    epicsUInt8 type;   /* Siemens code: 2 BYTE, 4 WORD, 5 INT, 6 DWORD, 7 DINT, 8 REAL, ... */
    epicsUInt16 count; /* elements */
    epicsUInt16 db;
    epicsUInt8 area;   /* SIM_AREA_... */
    epicsUInt32 bit;   /* address in bits: byte 4 is 32 */
} simAny;

/* Reads "P#DB2.DBX4.0 BYTE 34", given as three words. Returns 0, or -1 and the reason. */
int simAnyParse(char **words, simAny *any, char error[SIM_ERROR_SIZE]);
void simAnyEncode(const simAny *any, epicsUInt8 bytes[SIM_ANY]);
void simAnyDecode(const epicsUInt8 bytes[SIM_ANY], simAny *any);
/* Bytes that the pointer covers, 0 for an unknown type. */
size_t simAnySize(const simAny *any);

/* Finds the bytes of a pointer. Returns 0, or the low byte of the error code that a CPU's
 * BLKMOV gives: 01 syntax, 22 length, 24 area, 28 alignment, 3A no such data block. */
unsigned simAnyBytes(const simMemory *memory, const epicsUInt8 *bytes, epicsUInt8 **target,
                     size_t *size);
/* Such a code in words. */
const char *simAnyError(unsigned code);

#endif
