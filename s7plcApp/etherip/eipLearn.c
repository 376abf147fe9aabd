/* What a worker gets to know of the tags: by asking for each, then from the list of tags and
 * the templates, where the PLC has them; and anew when the program changed. See eipWorkerPvt.h.
 * All functions run in the worker's thread. */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>
#include <epicsString.h>

#include "eipWorkerPvt.h"

enum {
    answerGuess = 24, /* bytes that an answer to a question for a type takes: a string takes
                       * more, and is asked for again alone */
};

/* --- Asking for types ------------------------------------------------------------------------ */

/* Which tags a message asks for. */
typedef struct asked {
    unsigned tags[eipAskMost];
    unsigned count;
} asked;

static void forget(eipWorker *w)
{
    epicsMutexMustLock(w->tagsLock);
    w->turn = NULL;
    eipTagsForget(&w->tags);
    w->tags.byInstance = 0;
    epicsMutexUnlock(w->tagsLock);
    w->replan = 1;
    w->taught = 0;
    w->unknownRefusals = 0;
    eipBrowseEnd(w);
    w->browser.stage = eipBrowseNot;
}

void eipLearnBegin(eipWorker *w)
{
    forget(w);
    w->programLength = 0;
    w->programDue = 0;
    w->programRefused = 0;
    w->otherProgram = 0;
}

void eipLearnChanged(eipWorker *w)
{
    eipWorkerNote(w, "the program of the PLC has changed: tags are learned anew");
    if (eipWorkerEnter(w)) {
        w->state.programs++;
        epicsMutexUnlock(w->lock);
    }
    eipLearnBegin(w);
}

static void putAsk(eipWorker *w, eipWriter *m, unsigned i, void *arg)
{
    const asked *a = arg;

    eipTagAskPut(m, &w->tags, &w->tags.tags[a->tags[i]]);
}

/* Its first element does not fit one answer: what it takes is seen when it is read whole. */
static void learnLong(eipWorker *w, eipTag *tag)
{
    eipUnit unit = {.tag = (unsigned)(tag - w->tags.tags), .count = 1};
    eipAnswer last;
    eipData data;

    if (eipReadWhole(w, &unit, 0, &last, &data))
        return;
    if (!last.status) {
        epicsMutexMustLock(w->tagsLock);
        eipTagSetState(&w->tags, tag, eipTagKnown);
        tag->code = data.code;
        tag->handle = data.handle;
        tag->size = (unsigned)data.length;
        epicsMutexUnlock(w->tagsLock);
    } else {
        epicsMutexMustLock(w->tagsLock);
        eipTagLearn(&w->tags, tag, &last);
        epicsMutexUnlock(w->tagsLock);
    }
}

/* As a record names it: "a[1,2]" and "a[1,5]" are one tag. */
static const char *nameOf(const eipWorker *w, const eipTag *tag, char *name, size_t size)
{
    eipElementText(tag->base, tag->indexed, tag->indexed ? w->tags.wants[tag->from].index : 0, name,
                   size);
    return name;
}

static void takeAsk(eipWorker *w, unsigned i, const eipAnswer *answer, void *arg)
{
    const asked *a = arg;
    eipTag *tag = &w->tags.tags[a->tags[i]];
    eipTagState before = tag->state;
    char reason[eipReasonSize], name[eipNameMax + 16];

    if (answer->status == eipPartial) {
        learnLong(w, tag);
    } else {
        epicsMutexMustLock(w->tagsLock);
        strcpy(reason, tag->reason);
        eipTagLearn(&w->tags, tag, answer);
        epicsMutexUnlock(w->tagsLock);
        if (tag->state == eipTagBad && strcmp(reason, tag->reason))
            eipWorkerNoteOf(w, &w->tags.wants[tag->from], "tag %.80s: %s", nameOf(w, tag, name, sizeof(name)), tag->reason);
    }
    if (tag->state == eipTagBad) {
        tag->retry = epicsMonotonicGet() + eipRetryMs * EIP_NS_PER_MS;
        eipWorkerTagBad(w, tag, tag->reason);
    } else if (tag->state == eipTagKnown) {
        if (before == eipTagBad)
            eipWorkerNoteOf(w, &w->tags.wants[tag->from], "tag %.80s: good again", nameOf(w, tag, name, sizeof(name)));
        w->replan = 1;
    }
}

/* New ones, and bad ones whose time has come. */
static int isDue(const eipTag *tag, epicsUInt64 now, epicsUInt64 *next)
{
    if (tag->state == eipTagNew)
        return 1;
    if (tag->state != eipTagBad)
        return 0;
    if (tag->retry <= now)
        return 1;
    if (tag->retry < *next)
        *next = tag->retry;
    return 0;
}

/* As many as go into one message. */
static void choose(eipWorker *w, epicsUInt64 now, epicsUInt64 *next, asked *a)
{
    unsigned request = eipMultipleHead, answer = eipMultipleAnswerHead, i, size;
    unsigned most = w->limits.multiple ? w->limits.multiple : eipAskMost;

    a->count = 0;
    for (i = 0; i < w->tags.tagCount && a->count < most && a->count < w->askMost; i++) {
        const eipTag *tag = &w->tags.tags[i];

        if (!isDue(tag, now, next))
            continue;
        size = eipMultipleEach + 4 + eipTagAskBytes(&w->tags, tag);
        if (a->count && (request + size > w->limits.room ||
                         answer + answerGuess + eipMultipleEach > w->limits.room))
            break;
        request += size;
        answer += answerGuess + eipMultipleEach;
        a->tags[a->count++] = i;
    }
}

/* All that had to be asked was: what the tags are is known. */
static void taught(eipWorker *w)
{
    epicsMutexMustLock(w->tagsLock);
    w->turn = NULL;
    eipUnitsMake(&w->tags);
    epicsMutexUnlock(w->tagsLock);
    eipPlansRenew(w);
    w->replan = 0;
    w->taught = 1;
    if (w->browser.stage == eipBrowseNot && w->noBrowse < eipSilentTwice)
        w->browser.stage = eipBrowseProgram;
}

int eipLearnStep(eipWorker *w, epicsUInt64 now, epicsUInt64 *next)
{
    asked *a;
    int status;

    if (w->taught && w->turn)
        return 0; /* not while others wait for their values */
    a = mallocMustSucceed(sizeof(*a), "etherip");
    choose(w, now, next, a);
    status = 0;
    if (a->count) {
        status = eipWorkerAskMany(w, a->count, eipAskSeveral, putAsk, takeAsk, a) ? -1 : 1;
    } else if (w->replan || !w->taught) {
        taught(w);
        status = 1;
    }
    free(a);
    return status;
}

/* --- The list --------------------------------------------------------------------------------- */

void eipBrowseEnd(eipWorker *w)
{
    eipBrowser *b = &w->browser;

    if (b->template)
        eipTemplateFree(b->template);
    free(b->template);
    free(b->bytes);
    b->template = NULL;
    b->bytes = NULL;
    b->next = 0;
    b->program = 0;
    b->programName[0] = 0;
}

/* Takes one answer of the list. Returns 1 when there is more. */
static int takeList(eipWorker *w, const eipAnswer *answer)
{
    eipBrowser *b = &w->browser;
    eipReader r = eipReaderOf(answer->data, answer->length);
    epicsUInt32 first = b->next;
    eipSymbol symbol;
    int status;

    epicsMutexMustLock(w->tagsLock);
    while ((status = eipSymbolTake(&r, &symbol)) > 0) {
        if (symbol.id < b->next)
            break; /* it goes round in circles */
        b->next = symbol.id + 1;
        eipTagsListed(&w->tags, &symbol, b->programName[0] ? b->programName : NULL);
    }
    epicsMutexUnlock(w->tagsLock);
    return answer->status == eipPartial && status == 0 && b->next > first;
}

/* The next program that a tag names. Returns 0 when there is none. */
static int nextProgram(eipWorker *w)
{
    eipBrowser *b = &w->browser;

    for (; b->program < w->tags.tagCount; b->program++) {
        const char *base = w->tags.tags[b->program].base;
        size_t n = strcspn(base, ".");

        if (epicsStrnCaseCmp(base, "Program:", 8) || n > eipNameMax)
            continue;
        if (strlen(b->programName) == n && epicsStrnCaseCmp(base, b->programName, n) == 0)
            continue;
        memcpy(b->programName, base, n);
        b->programName[n] = 0;
        b->next = 0;
        return 1;
    }
    return 0;
}

static int browseList(eipWorker *w)
{
    eipBrowser *b = &w->browser;
    const char *program = b->stage == eipBrowsePrograms ? b->programName : NULL;
    eipWriter m = eipWorkerWriter(w);
    eipAnswer answer;

    eipSymbolsPut(&m, program, b->next);
    w->asking = eipAskBrowse;
    if (eipWorkerAsk(w, &m, &answer))
        return -1;
    if ((answer.status == eipSuccess || answer.status == eipPartial) && takeList(w, &answer))
        return 1;
    if (b->stage == eipBrowseTags && !b->next)
        w->noBrowse = answer.status == eipNoService ? eipSilentTwice : 0;
    b->stage = nextProgram(w) ? eipBrowsePrograms : eipBrowseTemplates;
    return 1;
}

/* --- Templates -------------------------------------------------------------------------------- */

/* The id of a template that a tag needs and that is not known, 0: none. */
static unsigned missing(const eipWorker *w, const eipTag *tag)
{
    const eipTemplates *known = w->tags.templates;
    size_t root = eipNameRoot(tag->base);
    const char *at = tag->base + root;
    eipMemberPlace place = {0};
    int status;

    if (!tag->template || tag->state != eipTagKnown)
        return 0;
    if (*at == '[')
        at += strcspn(at, "]") + (strchr(at, ']') != NULL);
    if (*at == '.')
        status = eipMemberFind(known, tag->template, at + 1, &place);
    else
        status = known->table[tag->template] ? 0 : (int)tag->template;
    return status > 0 ? (unsigned)status : 0;
}

static int beginTemplate(eipWorker *w, unsigned id)
{
    eipBrowser *b = &w->browser;
    eipWriter m = eipWorkerWriter(w);
    eipAnswer answer;
    eipTemplate *t;

    eipTemplateSizePut(&m, id);
    w->asking = eipAskBrowse;
    if (eipWorkerAsk(w, &m, &answer))
        return -1;
    t = callocMustSucceed(1, sizeof(*t), "etherip");
    if (answer.status || eipTemplateSizeTake(&answer, id, t) ||
        !eipTemplatesHaveRoom(w->tags.templates, t)) {
        free(t);
        b->stage = eipBrowseDone; /* it would be asked for again and again */
        return 1;
    }
    b->template = t;
    b->need = eipTemplateBytes(t);
    b->got = 0;
    b->bytes = callocMustSucceed(1, b->need + 1, "etherip");
    return 1;
}

static int goOnTemplate(eipWorker *w)
{
    eipBrowser *b = &w->browser;
    eipWriter m = eipWorkerWriter(w);
    size_t rest = b->need - b->got;
    eipAnswer answer;

    eipTemplateReadPut(&m, b->template->id, (epicsUInt32)b->got,
                       rest > 65535 ? 65535 : (unsigned)rest);
    w->asking = eipAskBrowse;
    if (eipWorkerAsk(w, &m, &answer))
        return -1;
    if ((answer.status && answer.status != eipPartial) || answer.length > rest ||
        !answer.length) {
        b->stage = eipBrowseDone;
        return 1;
    }
    memcpy(b->bytes + b->got, answer.data, answer.length);
    b->got += answer.length;
    if (answer.status == eipPartial && b->got < b->need)
        return 1;
    if (eipTemplateParse(b->template, b->bytes, b->got)) {
        b->stage = eipBrowseDone;
        return 1;
    }
    epicsMutexMustLock(w->tagsLock);
    w->tags.templates->table[b->template->id] = b->template;
    epicsMutexUnlock(w->tagsLock);
    b->template = NULL;
    free(b->bytes);
    b->bytes = NULL;
    return 1;
}

/* How many characters a string has room for. */
static void learnStrings(eipWorker *w)
{
    unsigned i, k;

    for (i = 0; i < w->tags.tagCount; i++) {
        eipTag *tag = &w->tags.tags[i];

        for (k = 0; k < eipTemplatesMax && tag->code == eipStructureCode; k++) {
            const eipTemplate *t = w->tags.templates->table[k];

            if (t && t->handle == tag->handle && t->size == tag->size)
                tag->plain = !(tag->characters = eipTemplateIsString(t));
        }
    }
}

static int mayUseInstances(const eipWorker *w)
{
    eipInstances allowed = w->connect.options.instances;

    return w->limits.multiple != 1 && (allowed == eipInstancesAlways ||
                                       (allowed == eipInstancesAuto && w->programLength));
}

static int browseTemplates(eipWorker *w)
{
    eipBrowser *b = &w->browser;
    unsigned i, id = 0;
    int status;

    if (b->template) {
        status = goOnTemplate(w);
    } else {
        for (i = 0; i < w->tags.tagCount && !id; i++)
            id = missing(w, &w->tags.tags[i]);
        if (!id)
            b->stage = eipBrowseDone;
        status = id ? beginTemplate(w, id) : 1;
    }
    if (status > 0 && b->stage == eipBrowseDone) {
        epicsMutexMustLock(w->tagsLock);
        learnStrings(w);
        w->tags.byInstance = mayUseInstances(w);
        epicsMutexUnlock(w->tagsLock);
        eipBrowseEnd(w);
        w->replan = 1; /* instances and structures make other units */
    }
    return status;
}

/* --- A new program ----------------------------------------------------------------------------- */

/* Before the list is read, and when no read has shown for a while that the program is still the
 * same. */
static int lookAtProgram(eipWorker *w, epicsUInt64 now)
{
    eipWriter m = eipWorkerWriter(w);
    eipAnswer answer;

    eipProgramPut(&m);
    w->asking = eipAskProgram;
    if (eipWorkerAsk(w, &m, &answer))
        return -1;
    w->programDue = now + (epicsUInt64)w->now.relearn * EIP_NS_PER_MS;
    if (w->programLength && !eipProgramIs(w, &answer)) {
        eipLearnChanged(w);
    } else if (answer.status || answer.length > sizeof(w->program) || !answer.length) {
        w->programRefused = 1;
    } else {
        memcpy(w->program, answer.data, answer.length);
        w->programLength = answer.length;
        w->hadProgram = 1;
    }
    if (eipWorkerEnter(w))
        eipWorkerTell(w); /* counters, where nothing else is told */
    return 1;
}

/* Which program is it that will be listed? A PLC that has told once tells again, after a
 * download, say. */
static int browseProgram(eipWorker *w, epicsUInt64 now)
{
    int status = w->noProgram >= eipSilentTwice || w->programRefused ? 1 : lookAtProgram(w, now);

    if (status > 0 && w->browser.stage == eipBrowseProgram)
        w->browser.stage = eipBrowseTags;
    return status;
}

/* All is known: is it still so? */
static int browseAgain(eipWorker *w, epicsUInt64 now, epicsUInt64 *next)
{
    if (!w->now.relearn || w->noProgram >= eipSilentTwice || w->noBrowse >= eipSilentTwice ||
        (w->programRefused && !w->hadProgram))
        return 0;
    if (now < w->programDue) {
        if (w->programDue < *next)
            *next = w->programDue;
        return 0;
    }
    if (w->programLength)
        return lookAtProgram(w, now);
    w->programRefused = 0;
    w->browser.stage = eipBrowseProgram;
    return 1;
}

int eipBrowseStep(eipWorker *w, epicsUInt64 now, epicsUInt64 *next)
{
    if (!w->taught || w->firstTurn)
        return 0;
    if (w->noBrowse >= eipSilentTwice)
        w->browser.stage = eipBrowseDone;
    switch (w->browser.stage) {
    case eipBrowseProgram:
        return browseProgram(w, now);
    case eipBrowseTags:
    case eipBrowsePrograms:
        return browseList(w);
    case eipBrowseTemplates:
        return browseTemplates(w);
    default:
        return browseAgain(w, now, next);
    }
}
