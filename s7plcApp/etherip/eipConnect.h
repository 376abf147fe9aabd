/* The way from a TCP connection to a session that can be used, one request after the other:
 *
 *     ListServices, RegisterSession, identity, Large Forward Open, Forward Open
 *
 * The size of a connection is learned from the refusal of a larger one; a PLC that opens none
 * is asked without. Knows frames in and out; no sockets, no clock, no tags. Pure; one thread
 * at a time.
 */
#ifndef INC_eipConnect_H
#define INC_eipConnect_H

#include "eipSession.h"

enum {
    eipSizeLarge = 4002,      /* bytes of a connection, sequence count included */
    eipSizeSmall = 504,
    eipUnconnectedRoom = 490, /* bytes of a message where there is no connection */
    eipVendorRockwell = 1,
    eipVendorOmron = 47
};

typedef struct eipIdentity {
    int known;
    unsigned vendor, type, code, major, minor, status;
    epicsUInt32 serial;
    char name[33];
} eipIdentity;

/* May the number by which the PLC lists a tag stand for its name? After a download it may be
 * that of another tag. */
typedef enum {
    eipInstancesNo,
    eipInstancesAuto,  /* where the PLC tells with each answer that its program is the same */
    eipInstancesAlways
} eipInstances;

typedef struct eipConnectOptions {
    eipRoute route;
    int connected;      /* 0: never open a connection */
    unsigned size;      /* of a connection at most, 100 to 65535 */
    unsigned room;      /* of a message without one */
    unsigned timeout;   /* ms for an answer from behind the route */
    eipInstances instances; /* what they are used for is the worker's business */
} eipConnectOptions;

typedef enum {
    eipStepList,
    eipStepRegister,
    eipStepIdentity,
    eipStepLarge,
    eipStepSmall,
    eipStepDone
} eipStep;

typedef struct eipConnect {
    eipConnectOptions options;
    eipSession session;
    eipStep step;
    unsigned skip;     /* 1 << step: left out, because it was not answered, */
    unsigned left;     /* for so many sessions more, */
    unsigned patience; /* of so many; 0: the last session had all steps */
    unsigned tries;    /* of the connection's serial number */
    int learned;       /* the size comes from a refusal */
    epicsUInt32 seed;  /* where numbers come from that must differ from time to time */
    /* what came out */
    eipIdentity identity;
    unsigned room;     /* bytes of a message, and of an answer, that fit */
    unsigned multiple; /* how many services fit into one: 0: any number, 1: no such thing */
} eipConnect;

/* Once, before the first connection. */
void eipConnectInit(eipConnect *c, const eipConnectOptions *options);

/* A TCP connection is up. `seed` is not the same the next time. */
void eipConnectBegin(eipConnect *c, epicsUInt32 seed);

/* The frame to be sent now. Returns its bytes; 0: done, or it failed. */
size_t eipConnectNext(eipConnect *c, void *frame, size_t room);

/* The answer to it. Returns 0, or -1: the TCP connection is of no use any more, and why. */
int eipConnectTake(eipConnect *c, const void *frame, size_t length, char *why, size_t size);

/* The controller does not know the connection any more: it is opened again, in the session that
 * is there. */
void eipConnectReopen(eipConnect *c);

/* No answer came in time, or the PLC has closed the TCP connection. The next time this step
 * is left out, where that is possible. Returns 1 when it was, else 0. */
int eipConnectNoAnswer(eipConnect *c);

/* The session is open. What was left out on the way is asked for again: on the next connection, and
 * when that was in vain after 1, 2, 4, ... sessions more. Returns 1 when the next connection is to be
 * made at once: a PLC that was just booting answers all by now. */
int eipConnectOpened(eipConnect *c);

/* The frame that closes the connection, before TCP is closed; the answer does not matter.
 * Returns its bytes, 0: there is none. */
size_t eipConnectClose(eipConnect *c, void *frame, size_t room);

/* "connected, 4002 bytes" or "unconnected, 490 bytes". */
void eipConnectText(const eipConnect *c, char *text, size_t size);

#endif /* INC_eipConnect_H */
