/* Inside of the worker of a Modbus PLC; only for plcModbus.c, plcModbusMailbox.c,
 * plcModbusAsk.c, plcModbusTurns.c, plcModbusReads.c and plcModbusWrites.c.
 *
 * The worker's thread alone uses `session` and calls libmodbus, never with the lock held.
 * What goes between it and the station's thread is in the structure under the lock. Each
 * start and stop makes a new generation: the worker gives nothing away, and takes
 * nothing, when its session is of an older one.
 */
#ifndef INC_plcModbusPvt_H
#define INC_plcModbusPvt_H

#include <epicsMutex.h>
#include <epicsThread.h>

#include "plcModbus.h"
#include "plcModbusHoles.h"
#include "plcModbusRelay.h"
#include "plcWake.h"

#define PLC_WORKER_NEVER PLC_WAKE_NEVER
#define NS_PER_MS 1000000ull

enum {
    maskMax = 256 /* bytes of the image in one piece of a request, at most 251 */
};

/* A read that comes back by its period */
typedef struct turn {
    plcRequest request;
    int output;      /* of the output ranges */
    epicsUInt64 due; /* ns */
    int asked;       /* once, at least */
    int refused;     /* by the PLC, the last time */
    int unsure;      /* its parts could be read; it was not asked for as a whole since */
    int torn;        /* not asked for: see PLC_WORKER_TORN */
    unsigned whole, wholeCount; /* a part of this value, which was refused as a whole with */
    int wholeCode;   /* this; wholeCount 0: it is no such part */
} turn;

/* Between two registers or bits that are not read in one request: the PLC has refused that, or
 * did not answer. Remembered for good. */
typedef struct cut {
    plcTable table;
    int output, unit;
    unsigned at;  /* the first behind it */
    int inValue;  /* it is within a value: for as long as that is refused */
} cut;

/* One connection, the worker's own. */
typedef struct session {
    unsigned generation;
    int on;
    char lost[PLC_REASON_SIZE]; /* why the connection is; "": it is not */
    plcModbusOptions options;   /* a copy, made before each step */
    turn *turns;
    unsigned turnCount, room;
    epicsUInt64 round[2]; /* reads of inputs, and of outputs, due by then belong to this round; 0: none */
    int toTell;        /* it is to be seen whether there is news of refused reads */
    int beatWasLast;   /* of heartbeat and reads of outputs */
    int inputsRead;    /* some, in this round */
    int inputsTried;   /* all of them, once */
    int outputsTried;
    char unread[PLC_REASON_SIZE];  /* why outputs are not shown; "": they are */
    int planIsOld;                 /* limits, or where values lie, have changed */
    int knowsIn, knowsOut;         /* where values lie */
    int noMaskWrite;               /* the PLC has no FC22 */
    int noMultiple[2];             /* nor FC16, FC15; with singleWrite it does without */
    unsigned silent;               /* requests without an answer since the last one */
    int mayBeSilent;               /* the next request may: the session goes on without an answer */
    unsigned muted;                /* writes without an answer since the last one that has one */
    char silentWhy[PLC_REASON_SIZE]; /* "no answer for 1.0 s" */
    epicsUInt64 answered;          /* ns, the last answer */
    epicsUInt64 beat;              /* ns, when the heartbeat is due */
    int beatRefused;
} session;

struct plcModbus {
    char name[40];
    plcModbusSetup setup;
    plcModbusRelay *relay;
    plcWake wake;
    int canWake; /* there were descriptors for it */
    epicsThreadId thread;

    epicsMutexId lock; /* guards from here on */
    int ending;
    plcModbusOptions options;
    unsigned generation;
    int running;   /* started and not stopped */
    SOCKET handed; /* for the worker; INVALID_SOCKET: none */
    epicsUInt8 *joinedIn, *joinedOut;
    int knowsIn, knowsOut;    /* joined was given */
    int joinedIsNew;          /* since the session began */
    int mayWrite; /* puts are to be taken, in this session */
    plcNews news;
    int hasNews;
    unsigned moreLog; /* lines for which there was no room */
    epicsUInt8 *inNews, *outNews;
    epicsUInt8 *hidden;   /* bits of outNews that the PLC refuses to show */
    int hides;            /* there are some */
    epicsUInt8 *hiddenTaken; /* the same of the outputs that were taken last: the caller's own */
    int hidesTaken;
    epicsUInt8 *readable; /* bits of inNews that were refused before */
    epicsUInt8 *clearing; /* the same of the image that was taken last: their fault ends
                          * when the records have it */
    int someReadable, someClearing;

    /* the worker's own */
    session session;
    epicsUInt8 *in, *out;         /* the images as the PLC has them */
    epicsUInt8 *leaving, *values; /* bits that a plan is still to write, their values */
    epicsUInt8 *waiting;          /* bits of all puts that have not left */
    epicsUInt8 *unsure;           /* bits whose write had no answer: the PLC may show them */
    epicsUInt8 *doubt;            /* bits whose last write had no answer, or a bad one */
    epicsUInt8 *told;             /* those of them that the log has */
    epicsUInt8 *givenUp;          /* room for a mask */
    int beatDoubt;                /* the same of the heartbeat register */
    epicsUInt64 beatRest;         /* ns, not before */
    epicsUInt8 *ownJoinedIn, *ownJoinedOut;
    plcPiece *pieces;
    cut *cuts;
    unsigned cutCount, cutRoom;
    plcHoles holes;               /* refused reads that the log has */
    unsigned units;               /* how many are asked */
    epicsUInt16 beatCount;
    epicsUInt16 registers[PLC_READ_REGISTERS];
    epicsUInt8 bits[PLC_READ_BITS]; /* one each, as libmodbus has them */
};

/* The next time after `now` in step with `due`; a period has a millisecond at least. */
static inline epicsUInt64 plcWorkerNext(epicsUInt64 due, epicsUInt64 period,
                                        epicsUInt64 now)
{
    period = period < NS_PER_MS ? NS_PER_MS : period;
    return due > now ? due : due + period * ((now - due) / period + 1);
}

/* The heartbeat register is to be written now. */
static inline int plcWorkerBeatIsDue(const session *s)
{
    return s->options.heartbeatRegister >= 0 && s->outputsTried && epicsMonotonicGet() >= s->beat;
}

/* --- plcModbusMailbox.c: what the worker tells ------------------------------------- */

/* Locks, if the session is still the one that counts. Returns 0 when it is not. */
int plcWorkerEnter(plcModbus *m);

/* Ends what plcWorkerEnter began; there is news. */
void plcWorkerTell(plcModbus *m);

/* A line for the log; the lock is held. */
void plcWorkerNote(plcModbus *m, const char *format, ...) EPICS_PRINTF_STYLE(2, 3);

/* "holding 100" or "coils 0 to 9" */
const char *plcWorkerWhere(const plcRequest *q, char text[40]);
const char *plcWorkerUnit(const plcModbus *m, unsigned unit, char text[20]);

/* "PLC: exception 2, illegal data address" */
void plcWorkerReason(const plcModbus *m, int code, char reason[PLC_REASON_SIZE]);

/* Bits of `from` that are set in the mask, into `to`. */
void plcWorkerMix(epicsUInt8 *to, const epicsUInt8 *from, const epicsUInt8 *mask,
                  size_t size);

/* --- plcModbusAsk.c: one request, and where it lies in an image -------------------- */

/* Sends a request and waits for its answer; the values are in m->registers or m->bits. A
 * PLC that is busy is asked again for as long as a request may take. Returns 0, the code
 * of an exception, or -1: the session is over. When that is because the connection is
 * lost, session.lost says why; the caller of all these functions tells it. */
int plcWorkerAsk(plcModbus *m, const plcRequest *q);

/* Instead of the code of an exception: no answer from one of several units, or to a write that
 * had none before. */
#define PLC_WORKER_SILENT 256
/* Or: it was not asked, since a part of a number is all that fits into a request. */
#define PLC_WORKER_TORN 257

/* Can it help to ask for less? Not where the PLC refuses the function, or can do nothing.
 */
int plcWorkerLessMayHelp(int code);

int plcWorkerIsBits(plcTable table);

/* The pieces of a request in the input or output image, into m->pieces; their number. */
unsigned plcWorkerInPieces(plcModbus *m, const plcRequest *q);
unsigned plcWorkerOutPieces(plcModbus *m, const plcRequest *q);

/* Of one piece: its bytes, and which bits of them belong to it. */
size_t plcWorkerPieceBytes(const plcRequest *q, const plcPiece *p);
void plcWorkerPieceMask(const plcRequest *q, const plcPiece *p, epicsUInt8 *mask);

/* A register in an image. */
epicsUInt16 plcWorkerGetRegister(const plcModbus *m, const epicsUInt8 *at);

/* A piece: from m->registers or m->bits into an image, and the other way. */
void plcWorkerStore(plcModbus *m, const plcRequest *q, const plcPiece *p,
                    epicsUInt8 *image);
void plcWorkerLoad(plcModbus *m, const plcRequest *q, const plcPiece *p,
                   const epicsUInt8 *image);

/* --- plcModbusWrites.c ------------------------------------------------------------- */

/* Writes what is ordered now, until a read or the heartbeat is due. Returns 0; 1: there is more; or -1:
 * the session is over. */
int plcWorkerWriteAll(plcModbus *m);

/* --- plcModbusTurns.c -------------------------------------------------------------- */

/* No turns any more, for a new plan: it is tried again whether values can be read as a whole. */
void plcWorkerTurnsClear(plcModbus *m);

/* A request that was planned, as one or more turns. */
void plcWorkerTurnsAdd(plcModbus *m, plcRequest q, int output, epicsUInt64 due);

/* A read of several ranges got no answer: they are not read together any more. */
void plcWorkerTurnsSilent(plcModbus *m, const turn *t);

/* A read that was refused comes again in this round as two: first where the user's ranges meet,
 * then in halves, until it is known which registers the PLC refuses; also those of one value, so that
 * its neighbours that share one of them are read. Returns 0 when it is of one register or bit. */
int plcWorkerTurnsSplit(plcModbus *m, unsigned at, int code);

/* Neighbours that are refused cost one request from now on. */
void plcWorkerTurnsJoin(plcModbus *m, int output);

/* True when b is a part of the value of which a is one. */
int plcWorkerSameValue(const turn *a, const turn *b);

/* The parts of a value are one read again. Returns its turn. */
turn *plcWorkerJoinParts(plcModbus *m, turn t);

/* --- plcModbusReads.c -------------------------------------------------------------- */

/* The reads that come back by their periods, all due now: a new session, or values lie
 * elsewhere. */
void plcWorkerPlan(plcModbus *m);

/* Is a read of inputs, or of outputs, to be made now? */
int plcWorkerIsDue(const session *s, int output);

/* Makes one, if one is due. */
void plcWorkerRead(plcModbus *m, int output);

/* When the next one is due, monotonic ns; 0: some are under way. */
epicsUInt64 plcWorkerNextRead(const session *s);

/* Makes one read of outputs and one of inputs, if they are due. Returns when to go on, monotonic ns,
 * 0: at once; or PLC_WORKER_NEVER. */
epicsUInt64 plcWorkerPoll(plcModbus *m);

/* When a read that was made, or whose period has changed, is due again. */
void plcWorkerSetDue(session *s, turn *t);

#endif /* INC_plcModbusPvt_H */
