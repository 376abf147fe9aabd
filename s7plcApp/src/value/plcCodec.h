/* The data types of a PLC block and how their bytes become values of the IOC.
 *
 * Pure functions: no records, no links, no sockets, no clock, no memory of anything.
 * Source of the names, aliases and default limits: the manual of PSI's s7plc, which this
 * module replaces; REAL is IEEE 754; BCD is the Siemens DATE_AND_TIME digit pair. BCD16,
 * BCD32, SM16 and SBCD16: what devices have in their registers.
 */
#ifndef INC_plcCodec_H
#define INC_plcCodec_H

#include <stddef.h>

#include <epicsTypes.h>

typedef enum {
    plcSigned = 1, /* kinds are bits, so that a set of allowed kinds is a mask */
    plcUnsigned = 2,
    plcReal = 4,
    plcString = 8,
    plcBcd = 16,
    plcS7String = 32, /* as S7 keeps a STRING[n]: two length bytes, then n characters */
    plcDigits = 64,   /* a whole number, a decimal digit in each 4 bits */
    plcMagnitude = 128,   /* a whole number, its sign in the highest bit */
    plcSignedDigits = 256 /* both: the first digit is 7 at most */
} plcKind;

#define plcInteger (plcSigned | plcUnsigned)        /* bits of them may be taken alone */
#define plcCoded (plcDigits | plcMagnitude | plcSignedDigits)
#define plcWhole (plcInteger | plcCoded)
#define plcText (plcString | plcS7String)

#define PLC_S7STRING_HEAD 2  /* bytes before the characters: most, and present number */
#define PLC_S7STRING_MAX 254 /* characters */

typedef struct plcType {
    const char *name; /* "INT16" */
    plcKind kind;
    unsigned size;   /* bytes of one element: 1, 2, 4 or 8 */
    epicsInt64 low;  /* default L: integers of at most 32 bits only. The most negative */
    epicsInt64 high; /* default H  value is left out: -0x7FFF for INT16 */
} plcType;

/* All types in the order of the documentation; ends with a row whose name is NULL. */
extern const plcType plcTypes[];

/* The type of this name or alias, upper or lower case; NULL if there is none.
 * `length` characters of `name` count: it need not be terminated. */
const plcType *plcTypeFind(const char *name, size_t length);

/* The type of this kind and element size; NULL if there is none. */
const plcType *plcTypeOf(plcKind kind, unsigned size);

/* Writes the names of all types whose kind is in `kinds`, separated by blanks, for error
 * messages: "INT8 UINT8 INT16 REAL32". Integers of more than `maxSize` bytes are left
 * out. A name that would not fit into `size` characters is left out too, whole. */
void plcTypeList(unsigned kinds, unsigned maxSize, char *text, size_t size);

/* The order of bytes on the wire. An option bigEndian=0 or 1 is such an order as it is.
 * The bytes of 0x0A0B0C0D in each of the four: */
enum {
    plcLittleEndian = 0, /* 0D 0C 0B 0A */
    plcBigEndian = 1,    /* 0A 0B 0C 0D */
    /* a bit beside: the 16-bit words of elements of 4 and 8 bytes the other way round */
    plcWordsSwapped = 2 /* 0B 0A 0D 0C;  with plcBigEndian 0C 0D 0A 0B */
};

/* The order for this order of the bytes in a 16-bit word (1: most significant first), and
 * of the words (1: most significant first). */
int plcOrder(int bigEndian, int highWordFirst);

/* One element. `bytes` need not be aligned. `order` is the order on the wire.
 *
 * plcGetInt gives the value sign-extended (plcSigned) or zero-extended to 64 bits; a
 * UINT64 comes back with its bits unchanged. plcPutInt writes the low bytes of `value`:
 * the rest is cut off (modulo 2^n). Any kind but plcReal is treated as an integer. */
epicsInt64 plcGetInt(const plcType *type, const void *bytes, int order);
void plcPutInt(const plcType *type, void *bytes, int order, epicsInt64 value);

/* A place with a digit that is none: fills `text` with what it holds, "0x1A2F is no BCD number", and
 * returns 1; else returns 0. plcBcd: `length` bytes, the first of them that is wrong: "byte 3 is 0xFA: no
 * BCD". Types without digits: always 0. */
#define PLC_WRONG_SIZE 28
int plcIsWrong(const plcType *type, const void *bytes, size_t length, int order,
               char text[PLC_WRONG_SIZE]);

/* REAL32 and REAL64 as double. A double beyond the range of REAL32 becomes infinite, as
 * IEEE 754 says. Type must be of kind plcReal. */
double plcGetReal(const plcType *type, const void *bytes, int order);
void plcPutReal(const plcType *type, void *bytes, int order, double value);

/* Copies n elements of `size` bytes (1, 2, 4, 8) between wire order and the order of this
 * machine. The same function serves both directions. No alignment is needed; dst and src
 * must not overlap. */
void plcCopyElements(void *dst, const void *src, unsigned size, size_t n, int order);

/* BCD: one byte holds two decimal digits, 0x59 <-> 59. Decoding a byte whose nibbles are
 * not digits (plcIsWrong) gives high*10 + low all the same (0xFF -> 165), so that nonsense is seen as
 * nonsense. Encoding a value outside 0..99 writes value modulo 100. */
void plcBcdDecode(epicsUInt8 *dst, const epicsUInt8 *src, size_t n);
void plcBcdEncode(epicsUInt8 *dst, const epicsUInt8 *src, size_t n);

/* How the characters A, B, C, D ... of a text (plcString, plcS7String with its head) stand in the
 * PLC's bytes. Where the numbers of a PLC have their words the other way round its texts need
 * not have it so, and the other way. */
enum {
    plcTextABCD,
    plcTextBADC,
    plcTextCDAB,
    plcTextDCBA,
    plcTextA0, /* one character in two bytes, the other one is 0 */
    plcText0A
};

/* "BADC" */
const char *plcTextOrderName(int order);

/* A text in this order is so many bytes, or a multiple of it. */
unsigned plcTextUnit(int order);

/* The bytes of so many characters, in an order that needs no multiple of characters. */
size_t plcTextBytes(int order, size_t chars);

/* All characters of `length` bytes, whatever they are, and back: as many as there is room for.
 * length is a multiple of plcTextUnit. */
void plcTextFromBytes(void *text, const void *bytes, size_t length, int order);
void plcTextToBytes(void *bytes, const void *text, size_t length, int order);

/* Copies the characters in `length` bytes, a multiple of plcTextUnit: at most `size`, up to the first
 * NUL, for plcS7String (2 characters at least) not more than its second byte says either. Returns
 * their number; no NUL is added. */
size_t plcGetText(const plcType *type, const void *bytes, size_t length, int order, char *text,
                  size_t size);

/* Fills `length` bytes: `text` of `chars` characters, cut off or filled up with NULs;
 * plcS7String: in front of it the number of characters that fit, and how many there are. */
void plcPutText(const plcType *type, void *bytes, size_t length, int order, const char *text,
                size_t chars);

#endif /* INC_plcCodec_H */
