/* What the fuzz targets share: a target takes any bytes, gives them to one parser, and checks
 * what must be true of the result whatever the bytes were.
 *
 * Knows no target. A target keeps nothing from one call to the next, so that the bytes alone
 * repeat a finding.
 */
#ifndef INC_fuzz_H
#define INC_fuzz_H

#include <stddef.h>

#include <epicsTypes.h>

/* A target: returns 0. What is wrong ends the program (fuzzCheck, or a sanitizer). */
typedef int fuzzTarget(const epicsUInt8 *data, size_t size);

typedef struct fuzzRow {
    const char *name;   /* folder of its seeds */
    fuzzTarget *target;
} fuzzRow;

/* All targets; ends with a row whose name is NULL. */
extern const fuzzRow fuzzTargets[];

/* Ends the program, after one line, when `what` is not true. */
#define fuzzCheck(what) ((what) ? (void)0 : fuzzFail(__FILE__, __LINE__, #what))
void fuzzFail(const char *file, int line, const char *what);

/* The bytes as a text of exactly their length, to be freed. A NUL among them ends it. */
char *fuzzText(const epicsUInt8 *data, size_t size);

/* Bytes that are taken one after the other; behind their end come zeros. */
typedef struct fuzzBytes {
    const epicsUInt8 *at;
    size_t left;
} fuzzBytes;

unsigned fuzzTake(fuzzBytes *b);   /* one byte */
unsigned fuzzTake16(fuzzBytes *b); /* two, big-endian */

/* A message of up to 65535 bytes: two bytes of length, then the bytes, as many as there are.
 * A copy of exactly that size, to be freed. */
epicsUInt8 *fuzzTakeMessage(fuzzBytes *b, size_t *size);

/* The next line of a text, which is changed; NULL at its end. */
char *fuzzLine(char **text);

#endif /* INC_fuzz_H */
