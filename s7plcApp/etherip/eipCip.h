/* CIP messages: requests and answers of the message router, several in one, through the
 * connection manager, and a connection opened and closed.
 *
 *     request  service  path words  path  data
 *     answer   service|80  0  status  n  n words of extended status  data
 *
 * Little-endian. Knows no frames, no tags, no sockets, no clock. Pure; any thread.
 */
#ifndef INC_eipCip_H
#define INC_eipCip_H

#include "eipBytes.h"

typedef enum {
    eipGetAttributesAll = 0x01,
    eipGetAttributeList = 0x03,
    eipMultipleService = 0x0a,
    eipGetAttributeSingle = 0x0e,
    eipReadTag = 0x4c,
    eipWriteTag = 0x4d,
    eipReadModifyWrite = 0x4e,
    eipForwardClose = 0x4e, /* of the connection manager */
    eipReadFragment = 0x52,
    eipUnconnectedSend = 0x52, /* of the connection manager */
    eipWriteFragment = 0x53,
    eipForwardOpen = 0x54,
    eipInstanceList = 0x55,
    eipLargeForwardOpen = 0x5b
} eipService;

/* General status */
enum {
    eipSuccess = 0x00,
    eipConnectionFailure = 0x01,
    eipPathSegment = 0x04,
    eipPathUnknown = 0x05,
    eipPartial = 0x06,
    eipNoService = 0x08,
    eipEmbedded = 0x1e, /* some of several services have failed */
    eipParameter = 0x20,
    eipGeneral = 0xff
};

/* Extended status, beside eipConnectionFailure, then beside eipGeneral */
enum {
    eipExtInUse = 0x0100,
    eipExtNoConnection = 0x0107,
    eipExtSize = 0x0109,
    eipExtOffset = 0x2104,
    eipExtEnd = 0x2105,
    eipExtType = 0x2107,
    eipExtName = 0x210a
};

/* Extended status of Omron, beside eipParameter */
enum {
    eipExtNoArray = 0x8017, /* several elements of what is one */
    eipExtRange = 0x8018,   /* more elements than there are */
    eipExtNotType = 0x8022
};

typedef struct eipAnswer {
    unsigned service; /* that of the request */
    unsigned status;
    unsigned extended; /* the first word, 0: none */
    unsigned size;     /* the second, 0: none; with eipExtSize what is possible */
    const epicsUInt8 *data;
    size_t length;
} eipAnswer;

enum {
    eipAnswerHead = 4,   /* bytes of an answer without data */
    eipMultipleHead = 8, /* of a request for several: with its path and their number */
    eipMultipleAnswerHead = 6,
    eipMultipleEach = 2, /* for each of them, its offset */
    eipRouteMax = 64     /* bytes */
};

/* Where the controller is, seen from the module whose address we have: pairs of port and
 * link. length 0: that module is it. */
typedef struct eipRoute {
    epicsUInt8 bytes[eipRouteMax]; /* of even length */
    unsigned length;
} eipRoute;

/* "1,6,18,10.206.1.40,1,4" (ports and links in turn, a link that is no number below 256 is a
 * text), "" or "-1": no route. Returns 0, or -1 with what is wrong in error. */
int eipRouteParse(const char *text, eipRoute *route, char *error, size_t size);

/* A request without its data. `path` is of even length, up to 510 bytes. */
void eipRequestPut(eipWriter *w, eipService service, const void *path, size_t length);

/* Class and instance as a path, and perhaps an attribute (0: none). Returns its bytes. */
size_t eipObjectPath(epicsUInt8 path[12], unsigned class, unsigned instance,
                     unsigned attribute);

/* Takes an answer apart. Returns 0; or -1 when it is not whole, or not one to `service`. */
int eipAnswerTake(const void *bytes, size_t length, unsigned service, eipAnswer *answer);

/* Does a status say that there are not so many elements, or that the tag has another type? Each
 * make of controller has words of its own. */
int eipAnswerIsEnd(const eipAnswer *answer);
int eipAnswerIsOtherType(const eipAnswer *answer);

/* --- Several in one ----------------------------------------------------------------------- */

/* Begins a request with `count` others, each then put after eipMultipleNext(i). */
void eipMultipleBegin(eipWriter *w, unsigned count);
void eipMultipleNext(eipWriter *w, unsigned i);

/* The i-th of `count` answers of one whose data this is. Returns its bytes and *length; or
 * NULL when there are not so many, or one does not lie where it says. */
const epicsUInt8 *eipMultipleTake(const eipAnswer *answer, unsigned count, unsigned i,
                                  size_t *length);

/* --- The connection manager --------------------------------------------------------------- */

/* A message to be passed on to the end of a route; ms: how long that may take. */
void eipUnconnectedSendPut(eipWriter *w, const void *message, size_t length,
                           const eipRoute *route, unsigned ms);

/* Was this answered by a module on the way, which could not pass the message on? */
int eipIsRouteFailure(const epicsUInt8 *answer, size_t length, unsigned service);

typedef struct eipOpening {
    int large;       /* 1: up to 65,535 bytes, 0: up to 511 */
    unsigned size;   /* bytes in each direction, the sequence count included */
    epicsUInt32 id;  /* T->O: the connection as we call it */
    unsigned serial, vendor;
    epicsUInt32 originator;
    epicsUInt32 interval;  /* us between two messages, as announced */
    unsigned multiplier;   /* code: a message later than interval x 4 x 2^code is too late */
} eipOpening;

typedef struct eipOpened {
    epicsUInt32 toPlc, fromPlc; /* ids: O->T, T->O */
    epicsUInt32 interval;       /* us, as granted */
} eipOpened;

void eipForwardOpenPut(eipWriter *w, const eipOpening *opening, const eipRoute *route);

/* Returns 0; or -1 when the answer is not one to this opening. */
int eipForwardOpenTake(const eipAnswer *answer, const eipOpening *opening,
                       eipOpened *opened);

void eipForwardClosePut(eipWriter *w, const eipOpening *opening, const eipRoute *route);

/* --- Words -------------------------------------------------------------------------------- */

/* A status in words: "no such tag (05)"; at most 38 characters, the room of AMSG, also behind
 * "PLC: " where it is about a tag. */
void eipStatusText(unsigned status, unsigned extended, char *text, size_t size);

#endif /* INC_eipCip_H */
