/* A transport that a test plays itself: it counts calls, and tells what the test sets. */
#ifndef INC_fakeTransport_H
#define INC_fakeTransport_H

#include "plcTransport.h"

extern const plcTransport fakeTransport;
extern const plcTransport fakeTransportPuts; /* the same, takesPuts: the test takes them */

/* All of it: from any thread, by EPICS atomics. */
typedef struct fakeState {
    int ups, downs, wholes; /* calls */
    int works;              /* 1: each look brings a block of bytes 7, and one request */
    int shows;              /* 1: the next look brings the outputs: */
    char output[8];         /* changed only while that is 0 */
    int lost;               /* 1: at the next look the connection is lost, "no answer" */
    int faults;             /* 1: the next look says that faults of outputs have changed */
    int puts;               /* calls */
    int whole;              /* of the output: bytes that belong to the one before */
    int pause;              /* what it says, ms */
} fakeState;

extern fakeState fake;

/* Before a station with it is made. */
void fakeReset(void);

#endif /* INC_fakeTransport_H */
