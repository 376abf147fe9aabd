/* simModbusMap: where the four tables of Modbus lie in PLC memory. It does not know the
 * protocol, nor libmodbus.
 *
 *   modbus holding  0 100 -> DB10.0             registers 0..99 are bytes 0..199 of DB10
 *   modbus input    0  16 -> in.0
 *   modbus coils    0  64 -> DB20.0 readonly    coil 0 is bit 0 of byte 0
 *   modbus discrete 8   8 -> M4.3
 *   modbus without 22 23                        functions that the PLC does not know
 *
 * A register lies in the PLC's byte order, as any 16-bit number of it does. Addresses are
 * those of the protocol: the first one is 0.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simModbusMap_H
#define INC_simModbusMap_H

#include "simMemory.h"

#define SIM_MODBUS_ADDRESSES 65536u /* in each table */

typedef enum simTable {
    simNoTable = -1,
    simCoils,
    simDiscrete,
    simHolding,
    simInput,
    SIM_TABLES
} simTable;

/* Part of a table, and its place. */
typedef struct simArea {
    simTable table;
    unsigned start, count;
    simPlace place;
    int readOnly;
} simArea;

typedef struct simModbusMap {
    const simMemory *memory;
    simArea *areas;
    size_t count;
    unsigned char without[256]; /* 1 = this function is not known */
} simModbusMap;

void simMapInit(simModbusMap *map, const simMemory *memory);
void simMapFree(simModbusMap *map);

/* Reads the words behind "modbus" of a statement. Returns 0, or -1 with the reason. */
int simMapStatement(simModbusMap *map, char **words, size_t count,
                    char error[SIM_ERROR_SIZE]);

/* "holding", ... and back; simNoTable when it is none. */
const char *simTableName(simTable table);
simTable simTableByName(const char *name);

/* A decimal number of at most `max`. Returns 0 or -1. */
int simMapNumber(const char *word, unsigned long max, unsigned long *value);

/* True when all of these addresses exist and, for writing, may be written. */
int simMapHas(const simModbusMap *map, simTable table, unsigned start, unsigned count,
              int writing);

/* Copy between PLC memory and an array with one element for each address, where element
 * `start` is the first one that is copied. Only what simMapHas() may be given. */
void simMapGetBits(const simModbusMap *map, simTable table, unsigned start,
                   unsigned count, epicsUInt8 *all);
void simMapPutBits(const simModbusMap *map, simTable table, unsigned start,
                   unsigned count, const epicsUInt8 *all);
void simMapGetRegisters(const simModbusMap *map, simTable table, unsigned start,
                        unsigned count, epicsUInt16 *all);
void simMapPutRegisters(const simModbusMap *map, simTable table, unsigned start,
                        unsigned count, const epicsUInt16 *all);

/* Adds " holding=0..99@DB10.0", one for each area, or " none"; then " without=22,23". */
void simMapText(const simModbusMap *map, simText *out);

#endif
