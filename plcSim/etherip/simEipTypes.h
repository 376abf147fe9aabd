/* simEipTypes: the data types of a Logix controller: elementary ones, strings and
 * structures with their layout and their template, as a browser reads it. It does not
 * know tags.
 *
 * Layout of a structure: members in their order, each at a multiple of its size (arrays
 * and structures: of 4 or 8); up to eight BOOLs that follow each other share a hidden
 * SINT; the whole is a multiple of 4 (8 where an 8-byte member is).
 *
 * Template, little-endian, padded with zeros to 4 x words - 20 bytes:
 *
 *   for each member   info(2) type(2) offset(4)     info: array length, or bit of a BOOL
 *   then              name ; n xx xx ... 00         two letters for each member
 *                     member name 00 ...
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simEipTypes_H
#define INC_simEipTypes_H

#include <stddef.h>
#include <epicsTypes.h>

#include "simLog.h"

#define SIM_EIP_NAME 41 /* bytes of a name, with its zero */

/* Codes on the wire. */
#define SIM_EIP_BOOL 0xC1
#define SIM_EIP_STRUCT 0x02A0 /* the handle follows */
#define SIM_EIP_STRING_HANDLE 0x0FCE

typedef enum simEipKind {
    eipBool,
    eipInteger,
    eipUnsigned,
    eipReal,
    eipStruct,    /* template and members */
    eipShortText, /* DA: USINT length, characters; as long as its text on the wire */
    eipLongText   /* D0: UINT length, characters; likewise */
} simEipKind;

struct simEipMember;

typedef struct simEipType {
    char name[SIM_EIP_NAME];
    simEipKind kind;
    unsigned code;       /* on the wire */
    size_t size;         /* bytes of one element in memory */
    size_t align;        /* bytes */
    size_t text;         /* strings: how many characters fit, else 0 */
    int index;           /* structures: order of definition */
    unsigned predefined; /* instance of its template, 0 = from a udt line */
    unsigned handle;
    struct simEipMember *members;
    size_t memberCount;     /* hidden ones too */
    epicsUInt8 *definition; /* the template */
    size_t definitionSize;  /* bytes; its size attribute is (this + 20) / 4 words */
} simEipType;

typedef struct simEipMember {
    char name[SIM_EIP_NAME];
    const simEipType *type;
    size_t count;  /* elements of an array, 0 = no array */
    size_t offset; /* bytes */
    int bit;       /* BOOL: 0 ... 7, else -1 */
    int hidden;    /* holds BOOLs */
} simEipMember;

typedef struct simEipTypes {
    simEipType **list; /* structures */
    size_t count;
    unsigned shift;           /* of the template ids: changes with a download */
    const simEipType *string; /* what STRING means here */
} simEipTypes;

/* What STRING is. */
typedef enum simEipStrings {
    eipStringStruct,
    eipStringShort,
    eipStringLong
} simEipStrings;

void simEipTypesInit(simEipTypes *types, simEipStrings strings);
void simEipTypesFree(simEipTypes *types);

/* By name, without regard to case; NULL when there is none. */
const simEipType *simEipTypeFind(const simEipTypes *types, const char *name);

/* Reads the words behind "udt":  <name> <member>:<type>[<n>] ...   or  <name> string <n>.
 * Returns 0, or -1 with the reason in error. */
int simEipTypeStatement(simEipTypes *types, char **words, size_t count,
                        char error[SIM_ERROR_SIZE]);

/* Reads "REAL[40]", "DINT[2,3,4]", "BOOL[64]" (two DWORDs; 64 BOOLs where STRING is D0). dims has three numbers, 0
 * where there are fewer. Returns 0, or -1 with the reason in error. */
int simEipTypeParse(const simEipTypes *types, const char *text, const simEipType **type,
                    unsigned dims[3], char error[SIM_ERROR_SIZE]);

/* Instance of the template object that describes this structure, and back. */
unsigned simEipTemplateId(const simEipTypes *types, const simEipType *type);
const simEipType *simEipTemplateFind(const simEipTypes *types, unsigned id);

/* A download: the structures get other template ids. */
void simEipTypesShift(simEipTypes *types);

/* The type word of a symbol or a member: structure bit, number of dimensions, type. */
unsigned simEipTypeWord(const simEipTypes *types, const simEipType *type, int dimensions);

/* Little-endian. */
void simEipPut(epicsUInt8 *p, size_t size, epicsUInt64 value);
epicsUInt64 simEipGet(const epicsUInt8 *p, size_t size);

#endif
