/* Inside of the worker of a PLC; only for the files below, each of which calls only
 * those before it, and eipWorker.c, which calls them all.
 *
 * Locking. What goes between the worker and others is under `lock`, which is held to copy, never
 * during a system call. Each start and stop makes a new generation: the worker gives nothing
 * away, and takes nothing, when its session is of an older one. `tagsLock` guards the tags of
 * the worker's own against those who report: it changes them with it held, and reads them
 * without. Order: tagsLock, then lock.
 */
#ifndef INC_eipWorkerPvt_H
#define INC_eipWorkerPvt_H

#include <epicsMutex.h>
#include <epicsThread.h>
#include <epicsTime.h>

#include "eipSocket.h"
#include "eipWorker.h"
#include "plcWake.h"

#define EIP_NEVER (~(epicsUInt64)0)
#define EIP_NS_PER_MS 1000000ull

enum {
    eipClassesMax = 64, /* periods that differ; more share the fastest that is left */
    eipPlansMax = 32,
    eipAskMost = 400, /* tags in one message */
    eipMessageMax = 65500,
    eipWriteHead = 2 + 2 + 2, /* of a write: service, type, count */
    eipSilentTwice = 2 /* a PLC that was silent so often, when it was asked for this */
};

/* All units of one period. */
typedef struct eipClass {
    unsigned period;      /* ms */
    epicsUInt64 due;      /* ns; 0: at once */
    eipTimes times;
} eipClass;

/* The messages that read the units of some classes together. */
typedef struct eipReadPlan {
    epicsUInt64 classes;  /* bits */
    unsigned *units;      /* in the order of their messages */
    unsigned *ends;       /* behind the last unit of each message */
    unsigned messages;
} eipReadPlan;

/* A wish by its place in the images. */
typedef struct eipPlaced {
    size_t place;
    unsigned want;
} eipPlaced;

/* How far the list of tags and the templates are. */
typedef enum {
    eipBrowseNot,
    eipBrowseProgram,   /* which one is it; before its list */
    eipBrowseTags,      /* of the controller */
    eipBrowsePrograms,
    eipBrowseTemplates,
    eipBrowseDone
} eipBrowseStage;

/* What was asked when the connection was lost: it is not asked again where others answer. */
typedef enum { eipAskOther, eipAskBrowse, eipAskProgram, eipAskModify } eipAskKind;

typedef struct eipBrowser {
    eipBrowseStage stage;
    epicsUInt32 next;
    unsigned program;          /* index of the tag that names it */
    char programName[eipNameMax + 1];
    eipTemplate *template;     /* that is being read, NULL: none */
    epicsUInt8 *bytes;
    size_t got, need;
} eipBrowser;

struct eipWorker {
    plcTransportSetup setup;
    eipWantsSource *source;
    void *sourceArg;
    plcWake wake;
    int canWake; /* there were descriptors for it */
    epicsThreadId thread;

    epicsMutexId lock; /* guards from here on */
    int ending;
    eipWorkerOptions options;
    eipConnectOptions connectOptions;
    int newConnect;
    unsigned generation;
    int running;
    SOCKET handed;
    size_t newsUsed;
    int mayWrite; /* there are puts in the output image */
    int busy; /* a request is under way */
    plcNews news;
    int hasNews;
    unsigned moreLog;
    epicsUInt8 *inNews, *outNews;
    epicsUInt8 *older;           /* bits of outNews that were not read since they were put, */
    epicsUInt64 through;         /* and up to where puts were through */
    eipWorkerState state;
    eipClass classes[eipClassesMax]; /* written with the lock, by the worker */
    unsigned classCount;

    epicsMutexId tagsLock;
    eipTags tags;

    epicsUInt8 *olderTaken;      /* the same of the news taken last; of who takes it */
    epicsUInt64 throughTaken;
    size_t takenUsed;

    /* the worker's own */
    eipSocket socket;
    eipConnect connect;
    unsigned session; /* its generation */
    int on;           /* the socket is up */
    int open;         /* the session, too */
    int taught;       /* all tags were asked for, once */
    int firstTurn;    /* of this session is not through yet */
    char lost[PLC_REASON_SIZE];
    eipWorkerOptions now;
    eipAskKind asking;
    int noBrowse, noProgram, noModify; /* 2: the PLC has no such thing; 1: perhaps */
    int noMultiple;
    unsigned askMost; /* tags whose types are asked for in one message */
    eipLimits limits;
    epicsUInt8 *frame, *message, *assembly;
    size_t assemblyRoom;
    size_t used;                 /* bytes of the images in use */
    epicsUInt8 *in;              /* the image as the PLC has it */
    epicsUInt8 *leaving, *values; /* bits of puts that are being written */
    epicsUInt8 *waiting;         /* bits of puts: for a moment */
    epicsUInt8 *written;         /* bits that were written since they were read: `in` is older, */
    epicsUInt8 *holds;           /* and this is what the PLC has taken; */
    epicsUInt8 *unread;          /* and nothing was refused since: it will be read */
    epicsUInt8 *back;            /* bits of places that were bad and were read since; */
    int someBack;                /* there are some: their faults end with that value */
    eipPlaced *byPlace;          /* all wishes, sorted */
    epicsUInt8 *queued;          /* of each wish: it is among what is being written */
    eipReadPlan plans[eipPlansMax];
    unsigned planCount, planNext;
    eipReadPlan *turn;           /* that runs; NULL: none */
    unsigned turnMessage;        /* the next one of it */
    epicsUInt64 turnStart, published;
    unsigned turnRequests;
    int turnEnded;               /* just now */
    int stored;                  /* something is new since it was published */
    int refused;                 /* a put was, of those that are being written */
    int replan;                  /* units have changed */
    epicsUInt64 epoch;           /* ns: due times count from here */
    epicsUInt64 lastAsk;         /* ns: keeps the connection alive */
    epicsUInt64 programDue;      /* ns: to look whether the program changed */
    epicsUInt8 program[64];      /* what the PLC says of it: that to which all instances belong */
    size_t programLength;        /* 0: not known */
    int otherProgram;            /* it is another one */
    int hadProgram;              /* it was known once, of this PLC */
    int programRefused;          /* in this session */
    char noFit[PLC_REASON_SIZE]; /* a reason that is given on at once */
    int relearn;                 /* all tags are to be learned anew */
    unsigned unknownRefusals;    /* tags that were known and are not any more, in a turn */
    eipBrowser browser;
};

/* --- eipTell.c ---------------------------------------------------------------------------- */

/* Locks, if the session is still the one that counts. Returns 0 when it is not. */
int eipWorkerEnter(eipWorker *w);
/* Unlocks; there is news. */
void eipWorkerTell(eipWorker *w);
/* A line for the log; the lock is not held. */
void eipWorkerNote(eipWorker *w, const char *format, ...) EPICS_PRINTF_STYLE(2, 3);
/* The same, about the records of a wish. */
void eipWorkerNoteOf(eipWorker *w, const eipWant *want, const char *format, ...)
    EPICS_PRINTF_STYLE(3, 4);

/* "PLC: no such tag (05)" */
void eipWorkerReason(const eipAnswer *answer, char reason[PLC_REASON_SIZE]);

/* The place of a wish has no value, for this reason. */
void eipWorkerBad(eipWorker *w, const eipWant *want, const char *reason);
/* The wishes of a tag. */
void eipWorkerTagBad(eipWorker *w, const eipTag *tag, const char *reason);

/* --- eipPeriods.c ------------------------------------------------------------------------- */

/* The plans are no good any more, nor is a turn that runs. */
void eipPlansFree(eipWorker *w);
/* Units were made anew, or the limits are others. */
void eipPlansRenew(eipWorker *w);

/* --- eipAsk.c ------------------------------------------------------------------------------ */

/* Sends n bytes of w->frame; the answer is in w->socket.buffer. Returns its outcome; eipBroken
 * also when the session is over. */
eipOutcome eipWorkerExchange(eipWorker *w, size_t n, unsigned ms, size_t *length);
unsigned eipWorkerTimeout(const eipWorker *w); /* ms, for an answer */

/* What was being asked when the connection was lost, twice, is not asked for again. */
void eipWorkerBlame(eipWorker *w);

/* A message for eipWorkerAsk is put there. */
eipWriter eipWorkerWriter(eipWorker *w);

/* Asks, and waits. Returns 0, or -1: the session is over (w->lost says why, if it was the
 * connection). */
int eipWorkerAsk(eipWorker *w, eipWriter *message, eipAnswer *answer);

typedef enum {
    eipAskPlain,    /* one service goes by itself */
    eipAskSeveral,  /* also one goes as if there were more */
    eipAskVerified  /* the question for the program goes behind them: when it is another one
                     * (w->otherProgram), no answer counts */
} eipAskHow;

/* The question for the program, and its answer: is it the one that is known? */
void eipProgramPut(eipWriter *m);
int eipProgramIs(const eipWorker *w, const eipAnswer *answer);
/* The bytes that it takes of a message. */
unsigned eipProgramLoad(const eipWorker *w);

/* Several services of which the i-th is `put(w, message, i, arg)`: their answers go to
 * `take(w, i, answer, arg)`. Returns as eipWorkerAsk. */
int eipWorkerAskMany(eipWorker *w, unsigned count, eipAskHow how,
                     void (*put)(eipWorker *w, eipWriter *m, unsigned i, void *arg),
                     void (*take)(eipWorker *w, unsigned i, const eipAnswer *answer,
                                  void *arg),
                     void *arg);

/* --- eipLearn.c --------------------------------------------------------------------------- */

/* All tags of a new session, or of a new program, are to be learned. */
void eipLearnBegin(eipWorker *w);
/* The same, since the program is another one. */
void eipLearnChanged(eipWorker *w);
/* The next message that is due for that. Returns 1: it was sent, 0: none is due, -1: the
 * session is over. *next: when to come again, if it is earlier. */
int eipLearnStep(eipWorker *w, epicsUInt64 now, epicsUInt64 *next);
/* The list and the templates, and looks whether the program changed. */
int eipBrowseStep(eipWorker *w, epicsUInt64 now, epicsUInt64 *next);
void eipBrowseEnd(eipWorker *w);

/* --- eipReads.c --------------------------------------------------------------------------- */

void eipReadsBegin(eipWorker *w);
int eipReadsStep(eipWorker *w, epicsUInt64 now, epicsUInt64 *next);

/* True when reads are so late that no more puts may go before them. */
int eipReadsLate(const eipWorker *w);

/* Reads a unit by itself, in as many parts as it takes. `from` bytes of it are in w->assembly
 * already. Returns 0 with *answer (the last one; data in w->assembly, *length) or -1. */
int eipReadWhole(eipWorker *w, const eipUnit *u, size_t from, eipAnswer *answer,
                 eipData *data);

/* What the PLC holds of the outputs, as far as that is known, is news. The lock is held. */
void eipReadsShow(eipWorker *w);

/* --- eipWants.c --------------------------------------------------------------------------- */

/* Takes over what is wanted now. Returns 1 when that is something new, else 0. */
int eipWantsTake(eipWorker *w);

/* The first wish, as an index of w->byPlace, that ends behind this offset. */
unsigned eipWantsBehind(const eipWorker *w, size_t offset);

/* --- eipItems.c --------------------------------------------------------------------------- */

/* What one service writes. */
typedef enum { eipItemElements, eipItemBits, eipItemText, eipItemArray } eipItemKind;

typedef struct eipItem {
    eipItemKind kind;
    unsigned tag, want, wants; /* wishes, one after the other */
    epicsUInt32 index;
    epicsUInt8 *bytes;  /* of the tag's type; eipItemBits: the bits, then which of them */
    size_t length;
    unsigned count;     /* elements */
} eipItem;

typedef struct eipBatch {
    eipItem *items;
    unsigned count, room;
    unsigned from, sent; /* of the message that is under way */
} eipBatch;

/* What is to be written of one wish; it is refused here, if it cannot be. */
void eipItemsAdd(eipWorker *w, eipBatch *b, unsigned want);
void eipBatchFree(eipBatch *b);

/* The put of a wish is through: written, or refused for a reason. Returns 1 when that is another end
 * than that of the put before. */
int eipItemsSettle(eipWorker *w, const eipWant *want, const char *reason);

/* --- eipWrites.c -------------------------------------------------------------------------- */

/* Writes what was put. Returns 0, or -1: the session is over. */
int eipWriteAll(eipWorker *w);

#endif /* INC_eipWorkerPvt_H */
