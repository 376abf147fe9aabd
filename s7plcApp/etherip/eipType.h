/* The data types of a controller's tags: their codes, and how their bytes become values and
 * text.
 *
 * Little-endian. Knows no tags, no messages, no records. Pure; any thread.
 */
#ifndef INC_eipType_H
#define INC_eipType_H

#include <stddef.h>

#include <epicsTypes.h>

typedef enum {
    eipSigned = 1, /* kinds are bits, so that a set of them is a mask */
    eipUnsigned = 2,
    eipReal = 4,
    eipText = 8,   /* STRING, STRING_n, SHORT_STRING */
    eipStructure = 16
} eipKind;

enum {
    eipBool = 0xc1,
    eipSint = 0xc2,
    eipInt = 0xc3,
    eipDint = 0xc4,
    eipUsint = 0xc6,
    eipRealCode = 0xca,
    eipStringCode = 0xd0,      /* length UINT, characters: not of Logix */
    eipByte = 0xd1,            /* the first that are bits, no numbers, */
    eipDword = 0xd3,           /* BOOL[32] */
    eipLword = 0xd4,           /* and the last */
    eipShortString = 0xda,     /* length USINT, characters */
    eipStructureCode = 0x02a0, /* a handle follows */
    eipStringHandle = 0x0fce,  /* that of STRING: LEN DINT, DATA SINT[82], 2 bytes */
    eipStringRoom = 82,
    eipStringData = 4          /* where the characters of a STRING begin */
};

typedef struct eipType {
    const char *name; /* "DINT" */
    unsigned code;
    eipKind kind;
    unsigned size; /* bytes of one, 0: it depends */
} eipType;

/* All of them; ends with a row whose name is NULL. */
extern const eipType eipTypes[];

/* The type of this code or name, NULL: there is none. */
const eipType *eipTypeOf(unsigned code);
const eipType *eipTypeNamed(const char *name);

/* --- Numbers ------------------------------------------------------------------------------ */

/* One number, of the kind of its type: `integer` sign- or zero-extended to 64 bits, or
 * `real`. A BOOL is 0 or 1. */
typedef struct eipNumber {
    eipKind kind; /* eipSigned, eipUnsigned, eipReal */
    union {
        epicsInt64 integer; /* eipUnsigned: the bits of it */
        double real;
    } u;
} eipNumber;

/* From type->size bytes; a number type. */
void eipNumberGet(const eipType *type, const epicsUInt8 *raw, eipNumber *number);

/* Into type->size bytes, whatever its kind: a real number is rounded to the nearest integer.
 * Returns 0; or -1 when the type has not this value (nothing is written). A number that is
 * too large for REAL does not fit; infinity and NaN do. */
int eipNumberPut(const eipType *type, epicsUInt8 *raw, const eipNumber *number);

/* A number of the type `from` as a variable of the type `to` has it. Where one of them is BYTE ...
 * LWORD, or both have one byte (characters), bits stay bits, as long as there is room for them.
 * Returns 0; or -1 when `to` has no such number, and why: "4000000000 is above 2147483647". */
int eipNumberAs(const eipType *to, const eipType *from, eipNumber *number, char *why, size_t size);

double eipNumberReal(const eipNumber *number);

/* As text: "-5", "0.1" (as short as the type allows), "1". */
void eipNumberText(const eipType *type, const eipNumber *number, char *text, size_t size);

/* From text: decimal, 0x...; of a BOOL 0, 1, true and false. Returns 0, or -1: it is none. */
int eipNumberParse(const eipType *type, const char *text, eipNumber *number);

/* --- Strings ------------------------------------------------------------------------------ */

/* The characters of a string of type D0, DA, or of a structure (LEN, DATA): their place and
 * number, never more than `length` bytes hold. Returns NULL when it is none. */
const char *eipTextGet(unsigned code, const epicsUInt8 *raw, size_t length,
                       size_t *characters);

/* A whole string of `length` bytes as it is written: what is behind the text is 0. `room`:
 * characters that a structure has room for, 0: all behind LEN. Returns the bytes (of D0, DA
 * they depend on the text), or 0: the text is too long. */
size_t eipTextPut(unsigned code, epicsUInt8 *raw, size_t length, size_t room,
                  const char *text, size_t characters);

#endif /* INC_eipType_H */
