/* A PLC of this wire: its places, its worker, its station; and EtherNet/IP as a transport.
 *
 * Knows stations; no records.
 */
#ifndef INC_eipPlc_H
#define INC_eipPlc_H

#include <ellLib.h>

#include "eipPlaces.h"
#include "eipWorker.h"
#include "plcStation.h"

typedef struct eipPlc {
    ELLNODE node;
    char name[eipNameMax + 1];
    eipConnectOptions connect;
    eipPlaces *places;
    eipWorker *worker;   /* once there is a station */
    plcStation *station;
    void (*wake)(void *arg); /* the station */
    void *wakeArg;
    int begun;           /* atomic: its records are all there; changes are told */
} eipPlc;

extern const plcTransport eipTransport; /* transportOwn is a pointer to an eipPlc */

/* The PLC of this name, or NULL. Any thread. */
eipPlc *eipPlcFind(const char *name);

/* Calls visit for each, in the order of their configuration. Any thread. */
void eipPlcEach(void (*visit)(eipPlc *plc, void *arg), void *arg);

/* What a definition needs beside name and address. */
typedef struct eipPlcSetup {
    eipRoute route;
    size_t imageSize; /* bytes for the places of all its tags */
    unsigned room;    /* bytes of an unconnected message */
    unsigned size;    /* bytes of a connection at most */
    int connected;    /* 0: never open a connection */
    eipInstances instances;
} eipPlcSetup;

/* Makes a PLC and its station. `host` is host[:port]. Returns NULL after one error line, which
 * begins with `command`. */
eipPlc *eipPlcCreate(const char *command, const char *name, const char *host,
                     const eipPlcSetup *setup);

/* What is wanted has changed: the worker takes it over soon. Any thread. */
void eipPlcWantsChanged(eipPlc *plc);

#endif /* INC_eipPlc_H */
