/* One session with a PLC: CIP messages into frames, and answers out of them, each looked at
 * closely. One request is under way at a time.
 *
 * Knows how a message gets to the controller (as it is, through Unconnected_Send, or on a
 * connection); no tags, no sockets, no clock. Pure; one thread at a time.
 */
#ifndef INC_eipSession_H
#define INC_eipSession_H

#include "eipCip.h"
#include "eipFrame.h"

typedef struct eipSession {
    epicsUInt32 handle; /* 0: not registered */
    eipRoute route;     /* to the controller, where there is no connection */
    int connected;      /* messages go on the connection `opened` */
    eipOpening opening; /* as it was asked for */
    eipOpened opened;
    unsigned routeTimeout; /* ms that a module may take to pass a message on */
    epicsUInt32 count;     /* of requests: makes the context */
    unsigned sequence;     /* of the connection */
    /* the request under way */
    unsigned command;
    unsigned service;
    int routed;
    epicsUInt8 context[eipContextSize];
} eipSession;

typedef enum {
    eipWayNormal, /* the connection, or the route */
    eipWayHere    /* to the module itself: its connection manager, its identity */
} eipWay;

/* The frame of a message. Returns its bytes, 0: it has no room. */
size_t eipSessionWrap(eipSession *s, eipWay way, const void *message, size_t length,
                      void *frame, size_t room);

/* A frame without a message: ListServices, RegisterSession, UnregisterSession. */
size_t eipSessionPlain(eipSession *s, eipCommand command, void *frame, size_t room);

/* The answer to it. Returns 0 and *answer (its data lies in the frame); or -1 when the
 * session is of no use any more, and why: the frame is no answer to this request. Words for
 * people, at most 39 characters. */
int eipSessionUnwrap(const eipSession *s, const void *frame, size_t length,
                     eipAnswer *answer, char *why, size_t size);

/* The same for eipSessionPlain: the data behind the header. A status of the header that is
 * not 0 is no error here; it is in *status. */
int eipSessionPlainTake(const eipSession *s, const void *frame, size_t length,
                        eipReader *data, epicsUInt32 *status, epicsUInt32 *handle,
                        char *why, size_t size);

#endif /* INC_eipSession_H */
