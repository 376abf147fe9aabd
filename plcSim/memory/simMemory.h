/* simMemory: the memory of one PLC: data blocks, their addresses and types. It does not know what
 * the bytes are for, nor of the network.
 *
 * Every byte has an address as in a Siemens PLC. Data blocks may have a name too.
 *
 *   DB10.DBX4.3   bit 3 of byte 4          DB10.DBB4   byte 4
 *   DB10.DBW4     bytes 4..5               DB10.DBD4   bytes 4..7
 *   DB10.4        from byte 4 on, as long as the type that comes with it
 *   in.4, out.4   the blocks that go to the IOC (IE_TX) and come from it (IE_RX)
 *   M4.3 MB4 MW4 MD4, the same with I and Q: flags, inputs, outputs
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simMemory_H
#define INC_simMemory_H

#include <stddef.h>
#include <epicsTypes.h>

#include "simLog.h"

#define SIM_MAX_BLOCK 65536u /* bytes in a data block */
#define SIM_NAME_SIZE 32

/* Memory areas, with the codes that ANY pointers use. */
#define SIM_AREA_I 0x81
#define SIM_AREA_Q 0x82
#define SIM_AREA_M 0x83
#define SIM_AREA_DB 0x84

typedef struct simBlock {
    unsigned area;   /* SIM_AREA_... */
    unsigned number; /* of the data block; 0 in the other areas */
    size_t size;     /* bytes */
    epicsUInt8 *bytes;
    char name[SIM_NAME_SIZE]; /* empty: has none */
} simBlock;

typedef struct simMemory {
    simBlock **blocks;
    size_t count;
    int bigEndian;
} simMemory;

typedef enum simKind {
    simBool,
    simInteger,
    simUnsigned,
    simReal,
    simString,
    simS7String, /* two bytes, most and present number of characters; then those */
    simBcd,
    simDtl
} simKind;

typedef struct simTypeInfo {
    const char *name;
    simKind kind;
    size_t size; /* bytes of one element */
} simTypeInfo;

/* A type with its number of elements; for STRING and S7STRING of characters. */
typedef struct simType {
    const simTypeInfo *info;
    size_t count;
} simType;

typedef struct simPlace {
    simBlock *block;
    size_t offset; /* bytes */
    int bit;       /* 0..7, -1 = none given */
    size_t width;  /* bytes: 1, 2, 4; 0 = the address does not say */
} simPlace;

void simMemoryInit(simMemory *mem, int bigEndian);
void simMemoryFree(simMemory *mem);

/* Adds a block of zeros. NULL when (area, number) exists or size is 0 or too large. */
simBlock *simMemoryAdd(simMemory *mem, unsigned area, unsigned number, size_t size,
                       const char *name);
simBlock *simMemoryFind(const simMemory *mem, unsigned area, unsigned number);
simBlock *simMemoryFindName(const simMemory *mem, const char *name);
/* "DB10 (IE_TX)", for messages; a static text for each of the last four calls. */
const char *simBlockName(const simBlock *block);

/* Reads "INT16", "INT16[20]", "STRING[40]", "S7STRING[16]". Returns 0, or -1 with the reason in error. */
int simTypeParse(const char *text, simType *type, char error[SIM_ERROR_SIZE]);
#define SIM_S7STRING_HEAD 2 /* bytes: longest and present length */
/* Bytes that a value of this type takes. */
size_t simTypeSize(const simType *type);

/* Reads an address. A bare number is an offset in `byDefault` (may be NULL).
 * The byte(s) that the address names are inside the block on success. */
int simPlaceParse(const simMemory *mem, const char *text, simBlock *byDefault,
                  simPlace *place, char error[SIM_ERROR_SIZE]);
/* 0 when a value of this type fits at the place, else -1 with the reason in error. */
int simPlaceCheck(const simPlace *place, const simType *type, char error[SIM_ERROR_SIZE]);
/* The type that an address alone means: DBX BOOL, DBB UINT8, DBW UINT16, DBD UINT32. */
int simPlaceType(const simPlace *place, simType *type, char error[SIM_ERROR_SIZE]);

#endif
