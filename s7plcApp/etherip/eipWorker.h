/* The EtherNet/IP side of one PLC: a thread that opens a session, learns the tags that somebody
 * wants, reads them by their periods and writes what was put. It may wait for the PLC as long
 * as a request may take; nobody waits for it.
 *
 * Knows tags, places in two images, and a socket that is up; no stations, no records. It never
 * connects: the station's thread does, and hands the socket over. Functions may be called by
 * any thread, and never block, but for eipWorkerDestroy.
 */
#ifndef INC_eipWorker_H
#define INC_eipWorker_H

#include <epicsTypes.h>
#include <osiSock.h>

#include "eipConnect.h"
#include "eipTags.h"
#include "plcFaults.h"
#include "plcTransport.h"

typedef struct eipWorker eipWorker;

typedef struct eipWorkerOptions {
    double requestTimeout; /* ms: a whole answer must be there by then */
    int relearn;           /* ms between two looks whether the program changed; 0: never */
} eipWorkerOptions;

/* What it knows, for reports. */
typedef struct eipWorkerState {
    int connected;        /* the session is open, */
    int keeps;            /* with a connection that must be kept alive */
    eipIdentity identity;
    char way[60];         /* "connected, 4002 bytes" */
    unsigned tags, known, bad, units;
    unsigned requests;    /* of the last turn of the fastest period */
    epicsUInt64 late;     /* turns that were left out, because the one before took longer */
    epicsUInt64 programs; /* how often all tags were learned anew */
} eipWorkerState;

/* Times of one period, for its statistics; seconds. */
typedef struct eipTimes {
    unsigned period;        /* ms */
    double last, min, max;  /* from the start of a turn to its last answer */
    epicsUInt64 turns;
    epicsTimeStamp stamp;   /* of the last turn */
} eipTimes;

/* What is wanted, all of it, if that is not what was told the last time: then 1, and the worker
 * takes `wants` and their texts over; else 0. *used: their places lie in so many bytes of the
 * images. Called in the worker's thread without a lock; must not block. Who puts something has
 * told before what he wants. */
typedef int eipWantsSource(void *arg, eipWant **wants, unsigned *count, size_t *used);

/* No thread yet. setup stays where it is; inSize and outSize are the same. */
eipWorker *eipWorkerCreate(const plcTransportSetup *setup, const eipConnectOptions *connect,
                           eipWantsSource *source, void *arg);
void eipWorkerBegin(eipWorker *w);   /* the thread */
void eipWorkerEnd(eipWorker *w);     /* ends and joins it, if there is one */
void eipWorkerDestroy(eipWorker *w);

void eipWorkerSetOptions(eipWorker *w, const eipWorkerOptions *options);

/* From the next connection on, on which no step is left out. */
void eipWorkerSetConnect(eipWorker *w, const eipConnectOptions *connect);

void eipWorkerWant(eipWorker *w); /* the source has something new */

/* The connection is up / is to be given up: see plcTransport.h. */
void eipWorkerStart(eipWorker *w, SOCKET socket);
void eipWorkerStop(eipWorker *w);
void eipWorkerPut(eipWorker *w); /* there are puts in the output image */
int eipWorkerTake(eipWorker *w, plcNews *news, void *input, void *output);
/* Of the outputs that were taken last: age of plcTransport.h. By who takes. */
void eipWorkerAge(eipWorker *w, epicsUInt64 *through, void *older);

/* So long it may go without any request, ms; 0: it need not make one. */
double eipWorkerPause(eipWorker *w);

void eipWorkerStateGet(eipWorker *w, eipWorkerState *state);

/* The times of the period nearest to `period` ms. Returns 0, or -1: there is none yet. */
int eipWorkerTimes(eipWorker *w, unsigned period, eipTimes *times);
void eipWorkerTimesReset(eipWorker *w);

/* Calls visit for each tag, with its texts; the tags do not change meanwhile. It must not
 * block. */
void eipWorkerEachTag(eipWorker *w, void (*visit)(const eipTag *tag, void *arg), void *arg);

#endif /* INC_eipWorker_H */
