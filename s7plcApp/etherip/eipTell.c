/* What a worker tells the station: its log, its faults, that there is news; see eipWorkerPvt.h.
 * All functions run in the worker's thread. */
#include <stdarg.h>
#include <string.h>

#include <epicsStdio.h>

#include "eipWorkerPvt.h"

int eipWorkerEnter(eipWorker *w)
{
    epicsMutexMustLock(w->lock);
    if (w->on && w->running && w->generation == w->session)
        return 1;
    epicsMutexUnlock(w->lock);
    return 0;
}

void eipWorkerTell(eipWorker *w)
{
    w->hasNews = 1;
    epicsMutexUnlock(w->lock);
    w->setup.wake(w->setup.arg);
}

static void note(eipWorker *w, const eipWant *want, const char *format, va_list args)
{
    if (!eipWorkerEnter(w))
        return;
    if (w->news.log[0]) {
        w->moreLog++;
    } else {
        epicsVsnprintf(w->news.log, sizeof(w->news.log), format, args);
        w->news.at = want ? want->place : 0;
        w->news.room = want ? want->room : 0;
    }
    eipWorkerTell(w);
}

void eipWorkerNote(eipWorker *w, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    note(w, NULL, format, args);
    va_end(args);
}

void eipWorkerNoteOf(eipWorker *w, const eipWant *want, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    note(w, want, format, args);
    va_end(args);
}

void eipWorkerReason(const eipAnswer *answer, char reason[PLC_REASON_SIZE])
{
    char text[64];

    eipStatusText(answer->status, answer->extended, text, sizeof(text));
    epicsSnprintf(reason, PLC_REASON_SIZE, "PLC: %.34s", text);
}

void eipWorkerBad(eipWorker *w, const eipWant *want, const char *reason)
{
    int changed = plcFaultsSet(w->setup.inFaults, want->place, want->room, NULL, reason);

    memset(w->back + want->place, 0, want->room);
    if (w->in[want->place] || w->in[want->place + 1]) {
        memset(w->in + want->place, 0, 2); /* no type: no value */
        changed = 1;
    }
    if (!changed)
        return;
    w->stored = 1;
    if (eipWorkerEnter(w)) {
        w->news.inFaults = 1;
        w->news.outFaults = 1; /* outputs look, too */
        w->hasNews = 1;
        epicsMutexUnlock(w->lock);
    }
}

void eipWorkerTagBad(eipWorker *w, const eipTag *tag, const char *reason)
{
    unsigned i;

    for (i = 0; i < tag->wants; i++)
        eipWorkerBad(w, &w->tags.wants[tag->from + i], reason);
}
