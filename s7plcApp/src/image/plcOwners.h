/* The records of a station: who reads and writes which bytes. For people (s7plcShow) and
 * for whoever must know all of them; not needed to move data.
 *
 * Knows names and byte ranges; a record itself is only a name here.
 */
#ifndef INC_plcOwners_H
#define INC_plcOwners_H

#include <stddef.h>

#include <ellLib.h>
#include <epicsTypes.h>

#include "plcCodec.h"

typedef struct plcOwner {
    ELLNODE node;
    const char *name;       /* of the record; stays where it is */
    const char *recordType; /* "ai" */
    int output;             /* 0: in the input block, 1: in the output block */
    size_t offset, length;  /* bytes */
    const plcType *type;    /* of one element */
    int order;              /* of its bytes: plcCodec.h */
    epicsUInt64 mask;       /* the bits of the element that are its own; 0: all */
    int hasReadback;
    size_t readback;        /* offset in the input block, when hasReadback */
    int unwritten;          /* an output that never wrote, nor took the PLC's value */
} plcOwner;

typedef struct plcOwners plcOwners;

/* All functions may be called from any thread and do not block. */
plcOwners *plcOwnersCreate(void);
void plcOwnersDestroy(plcOwners *owners);

/* The record keeps *owner where it is until it is removed. */
void plcOwnersAdd(plcOwners *owners, plcOwner *owner);
void plcOwnersRemove(plcOwners *owners, plcOwner *owner);

/* The record has written, or has taken the PLC's value. */
void plcOwnersWritten(plcOwners *owners, plcOwner *owner);

/* A number that is another one after each of these. */
int plcOwnersChanges(plcOwners *owners);

/* A copy of those of one direction, sorted by offset; to be freed. *count is their number.
 * NULL when there are none. */
plcOwner *plcOwnersCopy(plcOwners *owners, int output, size_t *count);

/* How many have a place that begins in these bytes of the input or output block; *first is the name
 * of one. */
unsigned plcOwnersIn(plcOwners *owners, size_t offset, size_t length, char *first, size_t size);

/* True when the two claim the same bits of the same bytes. */
int plcOwnersOverlap(const plcOwner *a, const plcOwner *b);

#endif /* INC_plcOwners_H */
