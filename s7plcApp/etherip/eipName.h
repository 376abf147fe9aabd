/* The text of a tag taken apart, and the path that stands for it in a message:
 *
 *     name   a.b[2].c   a[1,2]   Local:2:I.Ch0Data   Program:Main.x   tag.5
 *
 * Knows the syntax only: whether there is such a tag, the PLC says. Pure; any thread.
 */
#ifndef INC_eipName_H
#define INC_eipName_H

#include <stddef.h>

#include <epicsTypes.h>

#include "eipBytes.h"

enum {
    eipNameMax = 255,   /* characters of a whole text */
    eipPathMax = 510,   /* bytes of the longest path */
    eipDimensionsMax = 3
};

typedef struct eipName {
    char base[eipNameMax + 1]; /* the text without its last index and its bit */
    unsigned dimensions;       /* of the last index; 0: there is none */
    epicsUInt32 index[eipDimensionsMax];
    int bit;                   /* tag.5: 5; -1: none */
} eipName;

/* Returns 0; or -1 with the message in error, and in *column (may be NULL) where it is.
 * base0: the numbers of the last index are as C has them, 010 is 8 and 0x10 is 16 (as
 * ether_ip reads them); else all are decimal. */
int eipNameParse(const char *text, int base0, eipName *name, size_t *column, char *error,
                 size_t size);

/* The text of an element of a base text: "a[1]" and 2 are "a[1,2]" where a has several dimensions,
 * which is `indexed`; "a" and 0 are "a". */
void eipElementText(const char *base, int indexed, epicsUInt32 index, char *text, size_t size);

/* Puts the path of a base text (inner indices included). instance: of the first name, as
 * the PLC listed it; 0: not known, it goes by its name. Returns 0, or -1 where eipNameParse
 * refuses it too. */
int eipPathPut(eipWriter *w, const char *base, epicsUInt32 instance);

/* Puts the segment of one index. */
void eipIndexPut(eipWriter *w, epicsUInt32 index);

/* The bytes that eipPathPut and eipIndexPut need. */
size_t eipPathBytes(const char *base, epicsUInt32 instance);
size_t eipIndexBytes(epicsUInt32 index);

/* The length of the first name of a base text, in characters, behind "Program:x." when it
 * begins so: what is listed as one tag. */
size_t eipNameRoot(const char *base);

#endif /* INC_eipName_H */
