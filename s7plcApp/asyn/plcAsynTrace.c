/* A bounded queue of what is to be traced, and the thread that prints it; see
 * plcAsynTrace.h. */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsEvent.h>
#include <epicsMutex.h>
#include <epicsStdio.h>
#include <epicsString.h>
#include <epicsThread.h>
#include <epicsTime.h>

#include "plcAsynTrace.h"

#define LINE_SIZE 300
#define BYTES_MAX (4u << 20) /* of all blocks that wait; a single one may be larger */

typedef struct traceEntry {
    int reason;
    int isBytes;
    epicsTimeStamp time;
    char line[LINE_SIZE];
    size_t whole, length; /* of the bytes: there were, are here */
    char bytes[];
} traceEntry;

struct plcAsynTrace {
    asynUser *user;
    char *name;
    int started;
    plcWake *some; /* for who joins the thread */
    epicsEventId wake, ended;
    epicsMutexId lock; /* guards the rest; held for a copy of a pointer */
    traceEntry *queue[PLC_ASYN_TRACE_ENTRIES];
    unsigned first, count;
    size_t bytes;           /* of all of them */
    unsigned dropped, told; /* dropped in all; of them printed */
    int stop;
};

static void print(plcAsynTrace *t, const traceEntry *entry)
{
    char when[40];

    epicsTimeToStrftime(when, sizeof(when), "%H:%M:%S.%06f", &entry->time);
    if (entry->isBytes)
        asynPrintIO(t->user, entry->reason, entry->bytes, entry->length,
                    "%s %s, %lu bytes\n", when, entry->line, (unsigned long)entry->whole);
    else
        asynPrint(t->user, entry->reason, "%s %s\n", when, entry->line);
}

/* Takes the oldest entry out; NULL when there is none. */
static traceEntry *take(plcAsynTrace *t, unsigned *lost, int *stop)
{
    traceEntry *entry = NULL;

    epicsMutexMustLock(t->lock);
    if (t->count) {
        entry = t->queue[t->first];
        t->first = (t->first + 1) % PLC_ASYN_TRACE_ENTRIES;
        t->count--;
        t->bytes -= entry->length;
    }
    *lost = t->dropped - t->told;
    t->told = t->dropped;
    *stop = t->stop;
    epicsMutexUnlock(t->lock);
    return entry;
}

static void traceThread(void *arg)
{
    plcAsynTrace *t = arg;
    traceEntry *entry;
    unsigned lost;
    int stop;

    do {
        epicsEventMustWait(t->wake);
        while ((entry = take(t, &lost, &stop)) || lost) {
            if (entry)
                print(t, entry);
            free(entry);
            if (lost)
                asynPrint(t->user, ASYN_TRACE_FLOW | ASYN_TRACEIO_DRIVER,
                          "%u traces were dropped: printing is too slow\n", lost);
        }
    } while (!stop);
    epicsEventSignal(t->ended);
    plcWakeUp(t->some);
}

plcAsynTrace *plcAsynTraceCreate(asynUser *user, const char *name)
{
    plcAsynTrace *t = callocMustSucceed(1, sizeof(*t), "plcAsynTraceCreate");

    t->user = user;
    t->wake = epicsEventMustCreate(epicsEventEmpty);
    t->ended = epicsEventMustCreate(epicsEventEmpty);
    t->lock = epicsMutexMustCreate();
    t->name = epicsStrDup(name);
    return t;
}

void plcAsynTraceStart(plcAsynTrace *t)
{
    if (t->started)
        return;
    t->stop = 0;
    t->started = epicsThreadCreate(t->name, epicsThreadPriorityLow,
                                   epicsThreadGetStackSize(epicsThreadStackSmall),
                                   traceThread, t) != NULL;
}

void plcAsynTraceStop(plcAsynTrace *t, plcWake *some, epicsUInt64 deadline)
{
    if (!t->started)
        return;
    epicsMutexMustLock(t->lock);
    t->stop = 1;
    t->some = some;
    epicsMutexUnlock(t->lock);
    epicsEventSignal(t->wake);
    if (plcWakeJoin(some, t->ended, deadline) == 0)
        t->started = 0;
}

/* Puts the entry at the end of the queue, or counts it. */
static void put(plcAsynTrace *t, traceEntry *entry)
{
    epicsTimeGetCurrent(&entry->time);
    epicsMutexMustLock(t->lock);
    if (t->count < PLC_ASYN_TRACE_ENTRIES &&
        (!t->count || t->bytes + entry->length <= BYTES_MAX)) {
        t->bytes += entry->length;
        t->queue[(t->first + t->count++) % PLC_ASYN_TRACE_ENTRIES] = entry;
        entry = NULL;
    } else {
        t->dropped++;
    }
    epicsMutexUnlock(t->lock);
    free(entry);
    epicsEventSignal(t->wake);
}

static int isWanted(plcAsynTrace *t, int reason)
{
    return (pasynTrace->getTraceMask(t->user) & reason) != 0;
}

void plcAsynTraceBytes(plcAsynTrace *t, int reason, const void *bytes, size_t length,
                       const char *heading)
{
    traceEntry *entry;
    size_t shown;

    if (!isWanted(t, reason))
        return;
    shown = pasynTrace->getTraceIOTruncateSize(t->user);
    shown = shown < length ? shown : length;
    entry = callocMustSucceed(1, sizeof(*entry) + shown, "plcAsynTraceBytes");
    entry->reason = reason;
    entry->isBytes = 1;
    entry->whole = length;
    entry->length = shown;
    memcpy(entry->bytes, bytes, shown);
    epicsSnprintf(entry->line, sizeof(entry->line), "%s", heading);
    put(t, entry);
}

void plcAsynTraceLine(plcAsynTrace *t, int reason, const char *format, ...)
{
    traceEntry *entry;
    va_list args;

    if (!isWanted(t, reason))
        return;
    entry = callocMustSucceed(1, sizeof(*entry), "plcAsynTraceLine");
    entry->reason = reason;
    va_start(args, format);
    epicsVsnprintf(entry->line, sizeof(entry->line), format, args);
    va_end(args);
    put(t, entry);
}

unsigned plcAsynTraceDropped(plcAsynTrace *t)
{
    unsigned dropped;

    epicsMutexMustLock(t->lock);
    dropped = t->dropped;
    epicsMutexUnlock(t->lock);
    return dropped;
}
