/* Inside of a station; only for plcStation*.c.
 *
 * Locking. Each lock is held for a copy or a look at a list; never across errlog, a scan request or
 * the processing of a record, nor across a system call but for those named here. In the order in
 * which they may be taken:
 *   a) the record lock (Base), by whoever processes a record or puts to it
 *   b) listLock (plcStation.c): the list of PLCs, and how far the IOC is. Threads are started under
 *      it, and when an IOC has ended its stations are freed, after their threads have
 *   c) those of what stands on top: the list of pairs, under which their passes are asked for when
 *      the IOC runs; that of an asyn port, its places and who is called back
 *   d) `lists.lock`: which records follow, wait, are silent
 *   e) `lock` of a station: options, counters, addresses, reasons, whether puts are refused
 *   f) those of the tables of read-backs, `readback` first: a put and its notes go together
 *   g) the mailbox of a worker, and what else it has; it closes sockets under it
 *   h) one of these, alone: of an image (its puts are under it, too), of faults, of a scan list, of
 *      the owners of bytes; of a resolver, which wakes the thread under it (a byte into a pipe)
 * Those of transports and policies in full: docs/architecture.md, which a test compares.
 * Without a lock: what the thread owns (lines, timers, leader), which no other thread touches;
 * words between threads, which are EPICS atomics; reading the input image (plcImage.h).
 */
#ifndef INC_plcStationPvt_H
#define INC_plcStationPvt_H

#include <poll.h>

#include <callback.h>
#include <epicsAtomic.h>
#include <ellLib.h>
#include <epicsEvent.h>
#include <epicsMutex.h>

#include "drvS7plc.h"
#include "plcConnection.h"
#include "plcLink.h"
#include "plcReadback.h"
#include "plcSync.h"
#include "plcTables.h"
#include "plcPointers.h"
#include "plcOptions.h"
#include "plcResolver.h"
#include "plcScan.h"
#include "plcStation.h"
#include "plcTransport.h"
#include "plcWake.h"

/* What the thread and a transport with a worker hand each other. */
typedef struct plcExchange {
    const plcTransport *transport;
    void *pvt;             /* the transport's own */
    unsigned line;         /* its connection; 0: all data goes there, 1: the output */
    /* owned by the thread */
    char *input, *output;  /* as news brings them */
    char *image, *mask;    /* what is put next */
    char *hidden;          /* bits of `output` that the PLC does not show; */
    int hides;             /* there are some, */
    char why[PLC_REASON_SIZE]; /* and that is why */
    char *older;           /* bits of `output` that were not read since they were put */
    char *unsure;          /* bits that were on their way when the connection was lost, */
    char *lost;            /* and those that the PLC did not hold after that */
    int waiting;           /* the connection is up, the worker has not got it yet */
    int shown;             /* `output` is news that nobody has looked at yet */
    epicsUInt64 through;   /* puts up to this one, when the news were fetched */
    epicsUInt64 ordered;   /* when the oldest put under way was made; 0: none is */
    epicsUInt64 told;      /* up to where all was through when that was last told */
    int late;              /* puts of before this connection may wait still; */
    epicsUInt64 lateTold;  /* their records were told when so many were through */
    epicsUInt64 listenerTold; /* the same, to the listener */
    size_t used;           /* bytes of the images in use, as the transport says */
    int owners;            /* plcOwnersChanges when the worker was told where values lie */
    epicsUInt64 sign;      /* the last request was through then; 0: there is none to come */
} plcExchange;

/* One way to the PLC, with its connection. Owned by the thread. */
typedef struct plcLine {
    plcConnection connection;
    const plcTransport *transport;
    void *pvt;             /* its own */
    plcResolver *resolver; /* NULL: no address */
    char host[PLC_NAME_MAX + 1]; /* copies of the station's: name or address, */
    unsigned plus;               /* what is added to it, */
    int port;                    /* TCP port */
    epicsUInt64 retryAt;   /* when to try to connect next */
    unsigned failures;     /* in a row, for the back-off */
    epicsUInt64 lastBlock; /* 0: none on this connection */
    epicsUInt64 lostAt;    /* 0: not lost, or never was up */
    unsigned doubts;       /* of its framing, as counted */
    int wrongSize;         /* the block size was found wrong and not found right since */
    unsigned verdicts;     /* that the size is wrong, since: */
    epicsUInt64 verdictsSince;
    unsigned hangUps;      /* in a row: the PLC has closed it at once, without an answer */
    int lostEmpty;         /* it was lost before its first block, and has said so, since: */
    epicsUInt64 quietSince;
    int opened;            /* it counts as connected, which is more than TCP with `opens` */
    unsigned logged;       /* "cannot connect" has been said: of TCP, of what is behind it */
    char lostWhy[PLC_REASON_SIZE]; /* it has been silent: why it was lost; "": it sends */
    char *kept;            /* of a pair: its newest block while the other leads */
    int isKept;            /* there is one */
    epicsTimeStamp keptStamp;
} plcLine;

struct plcStation {
    ELLNODE node;
    char name[PLC_NAME_MAX + 1];
    size_t inSize, outSize;
    int bigEndian;
    int order; /* the same, and the option wordOrder: plcCodec.h */
    int textOrder;
    size_t header;             /* bytes of each block before the data: of sync=on, else 0 */
    const plcPolicy *policy;
    void *policyPvt;

    plcExchange *exchange; /* with the transport that has a worker; NULL: none has */
    unsigned lineCount;    /* of the policy, and one where outputs have one of their own */
    unsigned outLine;      /* 0: outputs take the line that leads; or the one of their own */
    int shows;             /* the transport of the outputs reads what the PLC holds of them, */
    int unread;            /* but this PLC does not show them; by the thread */
    plcFaults *inFaults, *outFaults; /* NULL: the wire does not tell */
    plcFaults *hidden;     /* bits of the outputs that the PLC does not show, and why; or NULL */
    epicsUInt8 *notInBlock; /* room for a mask of inFaults; by the thread */

    plcImage *in, *out;
    plcReadback *readback; /* places that take what blocks show of the outputs */
    plcReadback *atConnect, *tracked; /* what the transport shows of them: at connect, and whenever
                                       * it changes; none, unless it `shows` */
    epicsCallback followCallback;
    void (*follow)(plcStation *);
    int follows; /* atomic: the two are set, since there are records that follow */
    int following;                /* atomic: the callback is queued */
    epicsCallback throughCallback;
    void (*through)(plcStation *); /* NULL: nobody waits for puts to be through */
    int telling;      /* atomic: the callback is queued */
    int awaited;      /* atomic: so many puts are waited for */
    int outLosses;    /* atomic: how often the output's connection was lost */
    int acknowledges; /* atomic: complete=acknowledged */
    int tell;                     /* atomic: it is wanted, by another thread than ours */
    plcScan *inScan, *outScan, *statusScan, *statsScan;
    plcOwners *owners;
    plcLists lists;
    const plcListener *listener; /* NULL: none; set before the thread starts */
    void *listenerPvt;

    plcPointers *table; /* of s7plcTables, NULL = none; before the thread starts */

    /* from any thread to ours */
    plcWake wake;
    int stop;    /* atomic */
    int ready;   /* atomic: all records are there */
    int running; /* atomic: PINI is over, scans are on: how often they began */
    int sendNow; /* atomic: s7plcSend */
    int written; /* atomic: an output without read-back was written since start */
    int followed; /* atomic: one with a read-back was, since all took the PLC's values */
    epicsEventId ended;
    int started;

    epicsMutexId lock; /* guards from here ... */
    plcOptions options;
    int optionsChanged;
    plcStats stats;
    char address[PLC_LINES_MAX][PLC_NAME_MAX + 1]; /* host as configured */
    int plus[PLC_LINES_MAX];
    int port[PLC_LINES_MAX];
    int outHere;                   /* the output line goes to the address of line 0 */
    unsigned moved;                /* bit i: address or port of line i is new, */
    int anew;                      /* or is to be connected anew all the same */
    char reason[PLC_REASON_SIZE];  /* why not connected */
    char outReason[PLC_REASON_SIZE]; /* the same of a line that is only for output */
    int layoutState;               /* plcLayoutUnknown, ...: what layoutAt has shown */
    char refusal[PLC_REASON_SIZE]; /* why puts are refused, "": they are not */
                                   /* ... to here */
    int logLevel;  /* atomic: the option log */
    int logTime;   /* atomic: the option logTime */
    int connected; /* atomic: a line leads, or another is about to; for record threads */
    int leads;   /* atomic: the same of the line that outputs take */
    int waiting; /* atomic: the thread waits for the end of a scan pass */
    int taken;   /* atomic: the output image holds what the PLC has shown */
    int takes;   /* atomic: how often that began */
    size_t arrived;     /* atomic: takes of the output image that had reached the PLC before that, */
    size_t left;        /* and that had left */
    size_t takesSeen[2]; /* owned by the thread: takes at the last block, and at the one before */
    int waitsFirst; /* atomic: nothing leaves before the PLC has shown its values */

    /* owned by the thread */
    plcOptions now; /* its copy of the options */
    plcLine lines[PLC_LINES_MAX];
    int leader;              /* index of the leading line, -1 none */
    int lastLeader;          /* the same, or the last that led */
    epicsUInt64 leaderSince; /* monotonic: since when leader is what it is; 0: the start */
    epicsUInt64 looked;      /* all that came in until then was seen */
    int valid;               /* the input image is valid */
    int frozen;              /* the alive word stands still */
    plcSync sync;            /* with sync=on */
    plcTables tables;        /* with map=check or download */
    epicsUInt64 syncSince;   /* when its state began */
    int syncDoubted;         /* "does not agree" has been said in this state */
    epicsUInt64 lastBlock;   /* of any leader; 0: none since data was lost */
    epicsUInt64 lastDeliver; /* when records got their last block */
    epicsUInt64 lastAlive;   /* when the alive word last changed; 0: not seen yet */
    epicsInt64 aliveWord;
    char *held; /* a block that waits for minUpdate or wholeBlock */
    int holding;
    epicsTimeStamp heldStamp;
    epicsUInt64 dirtySince; /* 0: output image not written */
    epicsUInt64 putsDropped; /* since the beginning */
    int saidDropped;         /* that there are too many */
    epicsUInt64 lastSend;   /* 0: nothing sent on this connection */
    epicsUInt64 slowSince;  /* a block waits until the one before has left; 0: none */
    epicsUInt64 slowLook;   /* ns until it is looked again */
    epicsUInt64 slowSaid;   /* when the PLC last was slow; 0: never */
    epicsUInt64 nextOutScan;
    epicsUInt64 nextStatsScan;
    int tracks;                /* the option track, as read-backs know it */
    epicsUInt64 followAgain;   /* when to ask for the callback again; 0: not wanted */
    int heldTold;              /* that a scan pass held the thread up has been said */
    int toldState, toldLeader; /* when statistics were last scanned */
    epicsUInt64 policyWake;    /* 0: none */
    unsigned logTokens;        /* log lines that may still be written this minute */
    unsigned logDropped;
    epicsUInt64 logRefill;
};

/* What the PLC shows at layoutAt: no block yet, our id (or one of both is 0), another. */
enum { plcLayoutUnknown, plcLayoutAgrees, plcLayoutDiffers };

/* So many puts wait in their order; of more, the newest of each place. */
#define PLC_PUTS_MAX 1000

/* All that the thread does. */
void plcStationThread(plcStation *station);

/* --- plcStationState.c; any thread, but for the log ---------------------------------------- */

/* Lines in the log with the bytes of a block ("in", "out") / of a put, which was refused for
 * this reason (NULL: it was not). Any thread, no lock held. */
void plcStationTraceBlock(const plcStation *s, const char *what, const void *block,
                          size_t size);
void plcStationTracePut(const plcStation *s, size_t offset, size_t length, const void *data,
                        const void *mask, const char *refusal);

/* True when puts / blocks are to be traced: option log=io, or s7plcDebug of PSI's driver, for
 * all PLCs: 2 and up, 5 and up. */
static inline int plcStationTraces(const plcStation *s, int debug)
{
    return epicsAtomicGetIntT(&s->logLevel) == plcLogIo || s7plcDebug >= debug;
}
#define PLC_TRACE_PUTS 2
#define PLC_TRACE_BLOCKS 5

/* Why there is no connection on line i, for AMSG and statistics. */
void plcStationReason(plcStation *s, unsigned i, const char *reason);

/* Counts puts that were dropped because too many wait; says so once, until none waits. By the
 * thread. */
void plcStationCountPuts(plcStation *station);

/* Why outputs go nowhere. With the lock held. */
const char *plcStationOutReason(const plcStation *s);

/* True when all that was sent on the line that takes the output has reached the PLC / the same of
 * a line that is up; of one with a worker, what the kernel has. By the thread. */
int plcStationDelivered(const plcStation *s);
int plcLineDelivered(const plcLine *line);

/* Opens or closes the output image for puts, after anything changed that matters to it.
 * Any thread. */
void plcStationGate(plcStation *station);

/* Tells the listener, if there is one, that something may have changed. */
static inline void plcStationChanged(plcStation *s)
{
    if (s->listener && s->listener->changed)
        s->listener->changed(s->listenerPvt);
}

/* Makes the thread look around. Any thread, also with locks held. */
void plcStationWake(void *station);

/* --- Time: monotonic, in ns --------------------------------------------------------- */

#define PLC_NS_PER_MS 1e6
#define PLC_NEVER ((epicsUInt64) - 1)

static inline epicsUInt64 plcMsToNs(double ms)
{
    return (epicsUInt64)(ms * PLC_NS_PER_MS);
}

/* Steps set the time when they want to be called again. */
static inline void plcEarlier(epicsUInt64 *wake, epicsUInt64 time)
{
    if (time < *wake)
        *wake = time;
}

static inline int plcStationIsPair(const plcStation *s)
{
    return s->policy->lines > 1;
}

/* --- plcStationInput.c: from a block to the records; the thread only ---------------- */

/* `count` whole blocks came from the PLC that leads; `block` is the newest, taken at
 * stamp. */
void plcInputBlock(plcStation *s, const void *block, epicsTimeStamp stamp, size_t count,
                   epicsUInt64 now);

/* The time stamp for a block that came just now: its arrival, or the PLC's own clock. */
epicsTimeStamp plcInputStamp(plcStation *s, const char *block);

/* The data is not to be used, or there is a better reason why not. */
void plcInputInvalidate(plcStation *s, int state, const char *reason);

/* The PLC refuses to show `count` of `of` places, the `first` of them ...; of 0: not
 * known. */
void plcInputRefused(plcStation *s, unsigned count, unsigned of, const char *first);

/* For record threads, after leader or validity changed: outputs go somewhere, or not. */
void plcInputSetLeads(plcStation *s);

/* --- plcStationTables.c: the PLC's table of pointers; the thread only --------------- */

void plcTablesStart(plcStation *s);

/* Another PLC gets our output, or none. */
void plcTablesLeader(plcStation *s);

/* Returns 1 when the data of a block is what our records expect. */
int plcTablesLook(plcStation *s, const void *block);

/* Another PLC gets our output, or none. */
void plcInputSyncLeader(plcStation *s, epicsUInt64 now);

/* Records are told that `places` of them took the PLC's value, or (0) that there is news of
 * the connection. */
void plcInputFollow(plcStation *s, unsigned places);

/* Whether outputs leave may have changed: says so to record threads, and to records. */
void plcInputHeld(plcStation *s);

/* There is no input block: nothing to wait for. */
void plcInputNone(plcStation *s);

/* Asks again when the callback queue was full, or when another thread wants it. */
void plcInputFollowStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake);

/* Timers: a block that was held back; the alive word. */
void plcInputHoldStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake);
void plcInputAliveStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake);

/* --- plcStationLines.c: the connections; the thread only ---------------------------- */

/* (Re)creates what finds the address of line i, after it changed. */
void plcLineAddress(plcStation *s, unsigned i, epicsUInt64 now);

/* The data of a pair lives on for recvTimeout without a leader. */
void plcLineDataStep(plcStation *s, epicsUInt64 *wake);

/* Line i was up and is gone, or has to go: closes it and says why. */
void plcLineLost(plcStation *s, unsigned i, epicsUInt64 now, const char *why);
/* The PLC behind a connection has answered (plcTransport.opens). */
void plcLineOpened(plcStation *s, unsigned i, epicsUInt64 now);

/* Something happened that the policy must know; the leader may change. */
void plcLineTellPolicy(plcStation *s, plcEvent event, unsigned i, epicsUInt64 now);

/* Connects line i, if its address is known. */
void plcLineOpen(plcStation *s, unsigned i, epicsUInt64 now);
/* TCP is up. */
void plcLineUp(plcStation *s, unsigned i, epicsUInt64 now);
/* TCP could not be made. */
void plcLineFailed(plcStation *s, unsigned i, epicsUInt64 now, const char *why);
/* The next attempt is after the longest wait. */
void plcLineRetrySlowly(plcLine *line, epicsUInt64 now);

/* A PLC whose blocks look right and wrong in turns: that is said twice a minute. */
int plcLineChangesOften(const plcLine *line);

/* When the PLC has been silent for too long on this connection. One of a pair may begin to send
 * when nobody leads any more. */
epicsUInt64 plcLineSilenceDue(const plcStation *s, const plcLine *line);

/* Of a pair only the PRIMARY sends. When nobody leads, one of both connections may be dead
 * although TCP has not noticed: each is made anew in its turn. */
int plcLineMustSend(const plcStation *s, unsigned i);

/* True for a line that only carries output, while blocks come by another. */
static inline int plcLineIsOutput(const plcStation *s, unsigned i)
{
    return i > 0 && s->outLine == i;
}

/* True for a line whose transport has a worker. */
static inline int plcLineExchanges(const plcStation *s, unsigned i)
{
    return s->lines[i].transport->news != NULL;
}

/* True when outputs leave by a line of their own. */
static inline int plcStationHasOutLine(const plcStation *s)
{
    return s->outLine > 0;
}

/* --- plcStationWatch.c: what happens on the connections; the thread only ------------- */

/* Timers of line i: connect, give up, silence. */
void plcLineStep(plcStation *s, unsigned i, epicsUInt64 now, epicsUInt64 *wake);

/* What to wait for in poll() on line i. Nothing where a worker watches the socket, and knows why it
 * ends. */
void plcLinePoll(const plcStation *s, unsigned i, struct pollfd *fd);

/* poll() reported something about line i. */
void plcLineReady(plcStation *s, unsigned i, short revents, epicsUInt64 now);

/* --- plcExchange.c: between the thread and the transport that has a worker; the thread only.
 * Nothing happens where none has. --------------------------------------------------------- */

/* The thread begins / ends. */
void plcExchangeBegin(plcStation *s);
void plcExchangeEnd(plcStation *s);

/* The connection is up / was up, and is lost for this reason / is gone. */
void plcExchangeUp(plcStation *s);
void plcExchangeLost(plcStation *s, const char *why);
void plcExchangeDown(plcStation *s);

/* The PLC behind the connection has answered (plcTransport.opens). */
typedef void plcExchangeOpened(plcStation *s, unsigned line, epicsUInt64 now);

/* What the worker has to tell; and whether it still does. `opened` is called before anything else
 * is made of the news. Returns 1 when the connection is of no use any more, and why. */
int plcExchangeNews(plcStation *s, epicsUInt64 now, plcExchangeOpened *opened, epicsUInt64 *wake,
                    char why[PLC_REASON_SIZE]);

/* Puts under way: how many, and who waits for them. */
void plcExchangePuts(plcStation *s, epicsUInt64 now, epicsUInt64 *wake);

/* What records have written. */
void plcExchangeOutputStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake);

/* Hands the options on. */
void plcExchangeOptions(plcStation *s);

/* By plcStation.c, while there is no thread, for the line whose transport has a worker. */
void plcExchangeCreate(plcStation *s, unsigned line);
void plcExchangeDestroy(plcStation *s);

#endif /* INC_plcStationPvt_H */
