/* Puts on their way: what records have put into an output image and the PLC does not have yet,
 * in the order in which it was put.
 *
 * Knows bytes and bits; no records, no wire, no time. Not for several threads at once: the
 * image that owns the puts locks. The bytes of a put are its own copy.
 *
 *   add ->  [ waiting: first in, first out ]  -> take -> [ under way ] -> done
 *                                             <--------- back (connection lost)
 *
 * A value that follows directly on one for the same place takes its place, unless every one
 * of them is to be seen (edges). Nothing else changes the order.
 */
#ifndef INC_plcPuts_H
#define INC_plcPuts_H

#include <stddef.h>

#include <ellLib.h>
#include <epicsTypes.h>

#define PLC_REASON_SIZE 40 /* AMSG of a record, with its terminator */

typedef struct plcPuts plcPuts;

/* What becomes of the last put of one who asks: he gives the room and keeps it until he asks no more.
 * The alarm of a put is his who has put, until his next one. The image's lock guards what is below
 * the line. */
typedef struct plcLastPut {
    ELLNODE node;
    size_t offset, length; /* of his place: all of his puts are there */
    int masked;            /* only these bits of it, */
    epicsUInt8 mask[8];
    epicsUInt8 *bytes;     /* room for `length` bytes: the value of the last put */
    int goesOn;            /* before a put: it ends what the one before began (a pulse), whose reason stays */
    int again;             /* before a put: of what has failed, whose reason stays until it is taken */
    int tells;             /* before a put: that another value takes its place is worth a word */
    /* ---- */
    epicsUInt64 first, number; /* of his put, or of the first one of a pulse and the last; 0: none */
    size_t takes;              /* plcWritten.takes of the last */
    int waits;                 /* it is not through, nor void */
    epicsUInt64 bad;           /* this one is not in the PLC, */
    int looks;                 /* and the PLC has shown its values so often since */
    char why[PLC_REASON_SIZE]; /* for this reason; "": it is, or waits */
} plcLastPut;

/* plcLastPut.bad of a put that was not made: no value that the PLC shows ends its reason. */
#define PLC_PUT_NEVER (~(epicsUInt64)0)

/* plcLastPut.why of a put that never left, and in whose place the PLC's value came. */
extern const char plcNotWritten[];

/* The same of one that had left with a block, while it is not known whether it has arrived. */
extern const char plcNotConfirmed[];

/* A look at one. */
typedef struct plcPut {
    size_t offset, length;   /* bytes of the image */
    const epicsUInt8 *data;  /* length bytes */
    const epicsUInt8 *mask;  /* the bits that count; NULL: all */
    plcLastPut *last;        /* of the one who has put; NULL: nobody asks */
} plcPut;

/* For an image of `size` bytes. More than `most` puts are not kept in their order: of each
 * place the newest remains, and what is dropped is counted. */
plcPuts *plcPutsCreate(size_t size, unsigned most);
/* Only so many bytes of the image are in use, at most those that it was made for. */
void plcPutsUse(plcPuts *puts, size_t size);
void plcPutsDestroy(plcPuts *puts);

/* edges: 1: the PLC shall see this value, and the one before it. Returns the number of the
 * put, 1 or more, growing. */
epicsUInt64 plcPutsAdd(plcPuts *puts, const plcPut *put, int edges);

/* The PLC is away (1): from now on there is one put of each place, the newest, where it was
 * made; what waits is thinned out like that too. 0: it is back. */
void plcPutsAway(plcPuts *puts, int away);

/* Somebody asks what becomes of his puts / asks no more. */
void plcPutsAsk(plcPuts *puts, plcLastPut *last);
void plcPutsAskNot(plcPuts *puts, plcLastPut *last);

/* What is under way to these bits (mask NULL: all of them) has failed: it is not in the PLC, for this
 * reason, until it is taken after all. */
void plcPutsFail(plcPuts *puts, size_t offset, size_t length, const void *mask, const char *why);

/* The same for one who asks, without regard to what is on its way. plcLastPutBegin: he has put. puts
 * is NULL where none are kept. */
void plcLastPutFail(plcPuts *puts, plcLastPut *who, epicsUInt64 number, const char *why);
void plcLastPutBegin(plcPuts *puts, plcLastPut *who, epicsUInt64 number, const plcPut *put);
void plcLastPutForgive(plcPuts *puts, plcLastPut *who);

/* 1: somebody's last put has failed. */
int plcPutsFailed(const plcPuts *puts);

/* The PLC shows these bytes, as large as the image, but the bits set in `unknown` (NULL: none): where it
 * has what was put, that has not failed. Returns 1 when that is news. */
int plcPutsShown(plcPuts *puts, const void *shown, const void *unknown);

/* The PLC's value takes the place of what waits there: who has put another one and tells, gets
 * plcNotWritten, unless his put has failed already. */
void plcPutsReplace(plcPuts *puts, size_t offset, size_t length, const void *value,
                    const void *mask);

/* These bits are not to be put any more. mask NULL: all of them. */
void plcPutsVoid(plcPuts *puts, size_t offset, size_t length, const void *mask);
void plcPutsVoidAll(plcPuts *puts);

/* Before all that waits: the bits of image that are set in mask (both as large as the image)
 * and in no put that waits. Returns 1 when there were any. */
int plcPutsAhead(plcPuts *puts, const void *image, const void *mask);

/* Takes what may leave together, from the front: the first put, and the next ones as long as
 * joins() says so for each (NULL: only the first); never one that changes a bit that is taken
 * with it. Their bits are set in values and mask, as large as the image; other bits of these
 * stay as they are. They are under way then. Returns their count. Nothing is taken while
 * something is under way: then, too, it returns 0. */
unsigned plcPutsTake(plcPuts *puts, int (*joins)(void *arg, const plcPut *put), void *arg,
                     void *values, void *mask);

/* What was under way is through (acknowledged or refused) / waits again, at the front. */
void plcPutsDone(plcPuts *puts);
void plcPutsBack(plcPuts *puts);

/* Of what is under way only these bits are through: they do not wait again, whatever becomes of
 * the others. mask is as large as the image. */
void plcPutsEnd(plcPuts *puts, const void *mask);

/* What becomes of a put that is to be made no more. */
typedef enum {
    plcPutNever,  /* it waited, and is void */
    plcPutMaybe,  /* it is under way, and does not wait again */
    plcPutThrough /* it was through */
} plcPutFate;

/* The put of this number is to be made no more. A newer one that has taken its place is left alone. */
plcPutFate plcPutsCancel(plcPuts *puts, epicsUInt64 number);

/* What is put again on a new connection leaves these bits out. mask NULL: all of them. */
void plcPutsAgainNot(plcPuts *puts, size_t offset, size_t length, const void *mask);

/* How many wait or are under way. */
unsigned plcPutsCount(const plcPuts *puts);

/* What waits at `length` bytes from `offset` on, into `bytes` (NULL: it is only looked whether
 * there is any), the newest last; only the bits in mask (NULL: all). Returns 1 when there was
 * any. */
int plcPutsOverlay(const plcPuts *puts, size_t offset, size_t length, const void *mask,
                   void *bytes);

/* Sets in mask (as large as the image) the bits of all that wait or are under way. */
void plcPutsBits(const plcPuts *puts, void *mask);

/* All puts up to this number are through, or void. */
epicsUInt64 plcPutsThrough(const plcPuts *puts);

/* How many were dropped because there were too many, since the beginning. */
epicsUInt64 plcPutsDropped(const plcPuts *puts);

#endif /* INC_plcPuts_H */
