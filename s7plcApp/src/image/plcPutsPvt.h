/* Inside of plcPuts; only for plcPuts.c and plcPutEntry.c. */
#ifndef INC_plcPutsPvt_H
#define INC_plcPutsPvt_H

#include <ellLib.h>

#include "plcPuts.h"

/* One put; its bytes, and its mask where it has one, stand behind it. */
typedef struct entry {
    ELLNODE node;
    epicsUInt64 first, last; /* its number, and the first of those whose place it took */
    size_t offset, length;
    int edges;
    int cancelled; /* under way: it does not wait again */
    int masked;
    int failed;        /* not all of it is in the PLC */
    int lost;          /* and never will be */
    plcLastPut *who;   /* asks for it; NULL: nobody, */
    int again;         /* since it is put again, for all who have put there */
    epicsUInt8 bytes[1]; /* length, and as many again for the mask */
} entry;

/* Its mask; NULL: all bits. */
static inline epicsUInt8 *plcEntryMask(entry *e)
{
    return e->masked ? e->bytes + e->length : NULL;
}

static inline plcPut plcEntryView(entry *e)
{
    return (plcPut){e->offset, e->length, e->bytes, plcEntryMask(e), e->who};
}

/* --- plcPutEntry.c ---------------------------------------------------------------------------*/

/* True when the put is one of the same bytes and bits. */
int plcEntrySamePlace(entry *e, const plcPut *put);

/* True when bits of the entry are among these. */
int plcEntryTouches(entry *e, size_t offset, size_t length, const epicsUInt8 *mask);

/* True when all of its bits are. */
int plcEntryIsWithin(entry *e, size_t offset, size_t length, const epicsUInt8 *mask);

/* True when bits of that place are among those of the entry. */
int plcEntryLiesIn(entry *e, const plcLastPut *who);

/* To be freed. */
entry *plcEntryOf(const plcPut *put, int edges, epicsUInt64 number);

/* Takes bits out of an entry; without `mask` all that lie in the bytes. Returns 1 when none is
 * left. */
int plcEntryWithout(entry *e, size_t offset, size_t length, const epicsUInt8 *mask);

/* True when the value has other bits there than the entry. */
int plcEntryIsOther(entry *e, size_t offset, size_t length, const epicsUInt8 *value,
                    const epicsUInt8 *mask);

/* True when it would change a bit that is taken already. */
int plcEntryChanges(entry *e, const epicsUInt8 *values, const epicsUInt8 *mask);

/* Its bits are among those that are taken. */
void plcEntryTake(entry *e, epicsUInt8 *values, epicsUInt8 *mask);

#endif /* INC_plcPutsPvt_H */
