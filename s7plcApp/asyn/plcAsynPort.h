/* A station as an asyn port: what the files of this library share.
 *
 * A port is a multi-device port of which address 0 is the PLC. Reads and writes are copies
 * out of and into the images. It does not block, but where the wire acknowledges puts: there a
 * write returns when the PLC has taken or refused it, in a thread that asyn has for the port.
 * Multi-device, because
 * asynManager answers for a port that is not connected without asking its driver; for a
 * device it asks, so that a value written while the PLC is away is kept, or refused with
 * the reason.
 *
 * Threads: records read and write in their own threads. The station's thread only leaves
 * word (plcListener). One thread per port calls back those who registered, and announces
 * connections; another prints traces.
 *
 * Locks: `lock` guards places, views and those who are called back; never held while one
 * is called, nor in a system call. Order: record lock, asyn's locks, `lock`, then those
 * of the station. `arrived` guards what the station's thread leaves; it is taken alone.
 */
#ifndef INC_plcAsynPort_H
#define INC_plcAsynPort_H

#include <asynDriver.h>
#include <asynDrvUser.h>
#include <callback.h>
#include <dbDefs.h>
#include <ellLib.h>
#include <epicsEvent.h>
#include <epicsMutex.h>
#include <epicsThread.h>

#include "plcAsynPlace.h"
#include "plcAsynTrace.h"
#include "plcWake.h"

/* asynInt64 came with asyn R4-37. */
#if ASYN_VERSION > 4 || ASYN_REVISION >= 37
#define HAVE_ASYN_INT64
#endif

struct plcAsynUser;

typedef struct plcAsynPort {
    ELLNODE node;
    char *name;
    plcStation *station; /* NULL: its IOC has ended */
    asynUser *user; /* device 0: exceptions and traces */
    int known;      /* to asyn, which forgets no port */
    int blocks;     /* writes wait for the PLC's answer */
    plcAsynTrace *trace;
    asynInterface common, drvUser, faces[plcAsynFaces];
    /* calls the user back with the value of these bytes; of plcAsynIo */
    void (*call)(struct plcAsynUser *user, const void *bytes);

    epicsMutexId lock; /* guards from here ... */
    ELLLIST places;
    ELLLIST formerPlaces;          /* of IOCs that have ended: asynUsers know them */
    ELLLIST users;                 /* plcAsynUser.node */
    struct plcAsynUser *next;      /* the one that the pass looks at next */
    struct plcAsynUser *called;    /* the one that is called back now */
    epicsUInt64 passes, callbacks; /* ... to here */

    epicsMutexId arrived; /* guards from here ... */
    char *newest;         /* the last block, when fresh */
    epicsTimeStamp newestStamp;
    int fresh;             /* there is a block that nobody was told */
    int lost;              /* data was lost since the last pass, before that block */
    int dropped;           /* the connection was lost since the last pass */
    epicsUInt64 coalesced; /* blocks that a newer one replaced ... to here */

    /* owned by the port's thread */
    char *block, *before; /* the block that is told, and the one told before */
    epicsTimeStamp stamp;
    epicsUInt64 look;     /* when an output has to be looked at again; ns */
    int good;             /* block is valid */
    int announced;        /* asyn knows that we are connected */
    char *scratch;        /* as large as the larger block */
    asynStatus badStatus; /* while !good: what is told */

    epicsThreadId thread; /* NULL: between two IOCs */
    plcWake wake;
    epicsEventId ended;
    plcWake released;     /* a callback returned for which someone waits */
    plcWake through;      /* for the write that waits for its answer, in asyn's thread */
    epicsEventId drained; /* marks have passed the callback queues */
    epicsCallback marks[NUM_CALLBACK_PRIORITIES];
    int marksLeft; /* atomic */
    int running;   /* atomic: iocInit is over */
    int paused;    /* atomic: by iocPause; Base drops what callbacks ask for */
    int stop;      /* atomic */
    int off;       /* atomic: disconnected by a user */
} plcAsynPort;

/* Any function: an asyn callback, before its type is known. */
typedef void (*plcAsynCallback)(void);

/* Somebody who registered for callbacks of one interface. */
typedef struct plcAsynUser {
    ELLNODE node;    /* in port->users */
    ELLNODE atPlace; /* in view->place->users */
    plcAsynPort *port;
    plcAsynView *view;
    asynUser *user; /* that of the registration: who writes with it shows what it wrote */
    asynUser *own;  /* a copy, for the callbacks */
    plcAsynCallback callback;
    void *userPvt;
    epicsUInt64 joined; /* when; ns, 0: not while the IOC starts, or long ago */
    int told;           /* it has a value that is valid */
    int gone;           /* cancelled while it was called back */
    int faulty;         /* it was told that the PLC did not give or take it */
    int refused; /* its last write was refused: it gets the PLC's value, with the alarm */
    int away;    /* its last write waits for the PLC: its alarm has to end */
    int writing; /* a write of its own is under way */
    epicsUInt64 olderUntil; /* until then the PLC may still show an older value; ns */
    epicsUInt8 *mask;     /* of outputs of single bits, else NULL */
    epicsUInt8 maskBytes[PLC_ASYN_SCALAR];
    epicsUInt8 *value; /* of outputs: the bytes that it shows, when told */
    epicsUInt8 *shown; /* of outputs with a read-back: what the PLC showed last */
} plcAsynUser;

/* Makes the port. Returns 0, or -1 after an error line. initialWait: how long iocInit may
 * wait for the first blocks of PLCs, ms; see plcAsynWaitFirst. */
int plcAsynPortCreate(const char *name, const char *station, double initialWait);

/* For each IOC of this process: it begins. Threads start, hooks are registered. */
void plcAsynPortsBegin(void);

/* Lines for dbior. */
void plcAsynPortsReport(FILE *file);

/* --- plcAsynDrvUser.c: drvInfo --------------------------------------------------- */

/* Registers the interface with asyn. Returns 0 or -1. */
int plcAsynDrvUserRegister(plcAsynPort *port);

/* The view of the place that the asynUser has from its drvInfo. NULL with the message in
 * errorMessage when there is none, or the interface does not fit. */
plcAsynView *plcAsynViewOf(plcAsynPort *port, asynUser *user, plcAsynFace face);

/* Sets status, alarm and reason of an asynUser. Returns the status. */
asynStatus plcAsynFail(asynUser *user, asynStatus status, int alarm, const char *format,
                       ...) EPICS_PRINTF_STYLE(4, 5);

/* --- plcAsynFirst.c: iocInit waits for first blocks ------------------------------ */

/* During iocInit: waits for the first block of the PLC, for an output with a read-back
 * that wants its initial value. All waits of all ports together last initialWait at most.
 */
void plcAsynWaitFirst(plcAsynPort *port, const plcAsynView *view);

/* Word from the station's thread: a block came, before iocInit was over. */
void plcAsynFirst(void);

/* An IOC begins / all waits together last so long at most, ms; of several the longest; 0: none. */
void plcAsynFirstBegin(void);
void plcAsynFirstAtMost(double ms);

/* --- plcAsynBytes.c: bytes of images, in the caller's thread ---------------------- */

/* The first `length` bytes of the view's value, in wire order, with the time stamp in user. */
asynStatus plcAsynRead(plcAsynPort *port, asynUser *user, const plcAsynView *view,
                       size_t length, void *bytes);

/* The view for a write. NULL with the message when the place is not for writing. */
plcAsynView *plcAsynOutputOf(plcAsynPort *port, asynUser *user, plcAsynFace face);

/* Puts bytes into the output image, only the bits in mask (NULL: all). Waits for the answer
 * where the wire acknowledges puts. */
asynStatus plcAsynWrite(plcAsynPort *port, asynUser *user, plcAsynView *view, size_t length,
                        const epicsUInt8 *bytes, const epicsUInt8 *mask);

/* --- plcAsynIo.c: the interfaces, in the caller's thread -------------------------- */

/* Registers the interfaces with asyn. Returns 0 or -1. */
int plcAsynIoRegister(plcAsynPort *port);

/* --- plcAsynPass.c: callbacks ---------------------------------------------------- */

extern const plcListener plcAsynListener; /* `gone` is of plcAsynPort.c */

/* Nobody is called back any more: their IOC has ended, and the port's thread. */
void plcAsynForgetUsers(plcAsynPort *port);

/* The thread of the port. */
void plcAsynThread(plcAsynPort *port);

asynStatus plcAsynJoin(plcAsynPort *port, asynUser *user, plcAsynFace face,
                       epicsUInt32 mask, plcAsynCallback callback, void *userPvt,
                       void **registrar);
asynStatus plcAsynLeave(plcAsynPort *port, asynUser *user, void *registrar);

/* Around a write: before it, and after it with what was written (the bits in mask, NULL:
 * all) and how it went: 0 good, 1 kept for a PLC that is away, -1 refused. */
void plcAsynWriteBegins(plcAsynPort *port, plcAsynView *view, asynUser *user);
void plcAsynWriteEnds(plcAsynPort *port, plcAsynView *view, asynUser *user,
                      const epicsUInt8 *bytes, const epicsUInt8 *mask, size_t length,
                      int outcome);

#endif /* INC_plcAsynPort_H */
