/* Puts on their way; see plcPuts.h. */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>

#include "plcPutsPvt.h"

const char plcNotWritten[] = "not written: PLC was away";
const char plcNotConfirmed[] = "not confirmed: PLC was away";

struct plcPuts {
    size_t size, room; /* bytes in use, and at most: puts may lie behind those in use */
    unsigned most;
    ELLLIST waiting, underWay;
    epicsUInt64 number; /* of the last */
    epicsUInt64 dropped;
    int away;
    ELLLIST asking;     /* plcLastPut */
    unsigned failed;    /* of these: with a reason */
    entry **newest; /* for each offset: the last put that begins there and waits, or NULL */
};

plcPuts *plcPutsCreate(size_t size, unsigned most)
{
    plcPuts *p = callocMustSucceed(1, sizeof(*p), "plcPutsCreate");

    p->size = p->room = size;
    p->most = most;
    p->newest = callocMustSucceed(size + 1, sizeof(*p->newest), "plcPutsCreate");
    return p;
}

void plcPutsUse(plcPuts *p, size_t size)
{
    p->size = size;
}

void plcPutsDestroy(plcPuts *p)
{
    if (!p)
        return;
    ellFree(&p->waiting);
    ellFree(&p->underWay);
    free(p->newest);
    free(p);
}

/* --- Who asks ----------------------------------------------------------------------------*/

static void setWhy(plcPuts *p, plcLastPut *who, const char *why)
{
    char first = why[0];

    if (p)
        p->failed = p->failed + (first != 0) - (who->why[0] != 0);
    strncpy(who->why + 1, first ? why + 1 : why, sizeof(who->why) - 2);
    __atomic_store_n(&who->why[0], first, __ATOMIC_RELEASE);
}

void plcLastPutBegin(plcPuts *p, plcLastPut *who, epicsUInt64 number, const plcPut *put)
{
    /* The end of a pulse that was refused is tried again: a put like any other. */
    int again = who->bad == who->number && put->length &&
                memcmp(who->bytes, put->data, put->length) == 0;

    who->number = number;
    who->waits = p != NULL;
    if (put->length)
        memcpy(who->bytes, put->data, put->length);
    if (who->goesOn && !again)
        return;
    who->first = number;
    who->bad = who->again && who->why[0] ? number : 0;
    if (!who->bad)
        setWhy(p, who, "");
}

void plcLastPutFail(plcPuts *p, plcLastPut *who, epicsUInt64 number, const char *why)
{
    int begins = who->first != who->number && who->bad < number; /* of a pulse: that reason stays */

    if (who->why[0] && number != PLC_PUT_NEVER && (begins || who->bad == PLC_PUT_NEVER))
        return;
    who->bad = number;
    who->looks = 0;
    setWhy(p, who, why);
}

void plcLastPutForgive(plcPuts *p, plcLastPut *who)
{
    setWhy(p, who, "");
}

void plcPutsAsk(plcPuts *p, plcLastPut *who)
{
    ellAdd(&p->asking, &who->node);
}

static void forgetWho(ELLLIST *list, const plcLastPut *who)
{
    ELLNODE *node;

    for (node = ellFirst(list); node; node = ellNext(node))
        if (((entry *)node)->who == who)
            ((entry *)node)->who = NULL;
}

void plcPutsAskNot(plcPuts *p, plcLastPut *who)
{
    setWhy(p, who, "");
    ellDelete(&p->asking, &who->node);
    forgetWho(&p->waiting, who);
    forgetWho(&p->underWay, who);
}

/* Whose put the entry is; of one that is put again: all whose last put is through and lies there. The
 * next one after `before`, NULL: the first. */
static plcLastPut *nextWho(plcPuts *p, entry *e, plcLastPut *before)
{
    plcLastPut *who;

    if (!e->again)
        return before || !e->who || e->who->first > e->last ? NULL : e->who;
    who = (plcLastPut *)(before ? ellNext(&before->node) : ellFirst(&p->asking));
    while (who && (who->waits || !who->number || !plcEntryLiesIn(e, who)))
        who = (plcLastPut *)ellNext(&who->node);
    return who;
}

/* The entry is no more. */
static void letGo(entry *e)
{
    if (e->who && e->who->number == e->last)
        e->who->waits = 0;
    free(e);
}

static void fail(plcPuts *p, entry *e, const char *why)
{
    plcLastPut *who = NULL;

    e->failed = 1;
    while ((who = nextWho(p, e, who)))
        plcLastPutFail(p, who, e->again ? who->number : e->last, why);
}

/* It is in the PLC. */
static void taken(plcPuts *p, entry *e)
{
    plcLastPut *who = NULL;

    while ((who = nextWho(p, e, who)))
        if (who->why[0] && (e->again ? who->bad == who->number
                                     : who->bad >= e->first && who->bad <= e->last))
            setWhy(p, who, "");
}

/* --- Lists -------------------------------------------------------------------------------*/

/* An entry leaves the list of those that wait. */
static void unlinkEntry(plcPuts *p, entry *e)
{
    entry *before = (entry *)ellPrevious(&e->node);

    if (p->newest[e->offset] == e) {
        while (before && before->offset != e->offset)
            before = (entry *)ellPrevious(&before->node);
        p->newest[e->offset] = before;
    }
    ellDelete(&p->waiting, &e->node);
}

static void dropEntry(plcPuts *p, entry *e)
{
    unlinkEntry(p, e);
    letGo(e);
}

/* Of each place the newest remains, in the order in which these were made. */
static void thinOut(plcPuts *p)
{
    entry *e = (entry *)ellLast(&p->waiting), *before, *other;
    plcPut view;

    for (; e; e = before) {
        before = (entry *)ellPrevious(&e->node);
        other = p->newest[e->offset];
        view = plcEntryView(e);
        while (!plcEntrySamePlace(other, &view)) /* e at the latest */
            other = (entry *)ellPrevious(&other->node);
        if (other != e) {
            dropEntry(p, e);
            p->dropped++;
        }
    }
}

/* --- What is put -------------------------------------------------------------------------*/

/* The place of a put that waits is taken by this one. Returns 1 when there is such a one. */
static int takesPlace(plcPuts *p, const plcPut *put, int edges)
{
    entry *e = p->newest[put->offset];

    if (!e || e->again || !plcEntrySamePlace(e, put))
        return 0;
    if (p->away) {
        dropEntry(p, e); /* the new one is the last of all */
        return 0;
    }
    if (&e->node != ellLast(&p->waiting))
        return 0;
    if ((edges || e->edges) && memcmp(e->bytes, put->data, put->length) != 0)
        return 0;
    memcpy(e->bytes, put->data, put->length);
    if (e->who && e->who != put->last)
        e->who->waits = 0;
    e->who = put->last;
    e->last = p->number;
    return 1;
}

epicsUInt64 plcPutsAdd(plcPuts *p, const plcPut *put, int edges)
{
    entry *e;

    p->number++;
    if (put->last)
        plcLastPutBegin(p, put->last, p->number, put);
    if (put->length == 0 || takesPlace(p, put, edges))
        return p->number;
    if ((unsigned)ellCount(&p->waiting) >= p->most)
        thinOut(p);
    e = plcEntryOf(put, edges, p->number);
    ellAdd(&p->waiting, &e->node);
    p->newest[e->offset] = e;
    return p->number;
}

void plcPutsAway(plcPuts *p, int away)
{
    epicsUInt64 dropped = p->dropped;
    ELLNODE *node = away && p->failed ? ellFirst(&p->asking) : NULL;

    for (; node; node = ellNext(node))
        ((plcLastPut *)node)->looks = 1; /* what the PLC shows next is no older */
    p->away = away;
    if (away)
        thinOut(p);
    p->dropped = dropped; /* none of these was too many */
}

void plcPutsVoid(plcPuts *p, size_t offset, size_t length, const void *mask)
{
    entry *e, *next;

    for (e = (entry *)ellFirst(&p->waiting); e; e = next) {
        next = (entry *)ellNext(&e->node);
        if (plcEntryWithout(e, offset, length, mask))
            dropEntry(p, e);
    }
}

void plcPutsVoidAll(plcPuts *p)
{
    ELLNODE *node;

    while ((node = ellGet(&p->waiting))) {
        p->newest[((entry *)node)->offset] = NULL;
        letGo((entry *)node);
    }
}

void plcPutsReplace(plcPuts *p, size_t offset, size_t length, const void *value,
                    const void *mask)
{
    entry *e, *next;

    for (e = (entry *)ellFirst(&p->waiting); e; e = next) {
        next = (entry *)ellNext(&e->node);
        if (!plcEntryIsOther(e, offset, length, value, mask)) {
            if (!e->lost && plcEntryIsWithin(e, offset, length, mask))
                taken(p, e); /* so it is there */
        } else if (e->who && e->who->tells && e->who->first <= e->last && !e->who->why[0]) {
            fail(p, e, plcNotWritten);
        }
    }
    plcPutsVoid(p, offset, length, mask);
}

void plcPutsFail(plcPuts *p, size_t offset, size_t length, const void *mask, const char *why)
{
    entry *e;

    for (e = (entry *)ellFirst(&p->underWay); e; e = (entry *)ellNext(&e->node))
        if (!e->failed && plcEntryTouches(e, offset, length, mask))
            fail(p, e, why);
}

static int isShown(const plcLastPut *who, const epicsUInt8 *shown, const epicsUInt8 *unknown)
{
    size_t i, at;

    for (i = 0; i < who->length; i++) {
        at = who->offset + i;
        if (((who->bytes[i] ^ shown[at]) | (unknown ? unknown[at] : 0)) &
            (who->masked ? who->mask[i] : 0xff))
            return 0;
    }
    return 1;
}

int plcPutsFailed(const plcPuts *p)
{
    return p->failed != 0;
}

/* The first look may be older than what has failed. */
int plcPutsShown(plcPuts *p, const void *shown, const void *unknown)
{
    plcLastPut *who = (plcLastPut *)ellFirst(&p->asking);
    int news = 0;

    for (; who; who = (plcLastPut *)ellNext(&who->node)) {
        if (!who->why[0] || who->waits || who->bad != who->number || !who->looks++ ||
            !isShown(who, shown, unknown))
            continue;
        setWhy(p, who, "");
        news = 1;
    }
    return news;
}

int plcPutsAhead(plcPuts *p, const void *image, const void *mask)
{
    const epicsUInt8 *bits = mask;
    plcPut all = {0, p->size, image, mask, NULL};
    epicsUInt8 *waiting;
    entry *e;
    size_t i;
    int any = 0;

    if (p->size == 0)
        return 0;
    waiting = callocMustSucceed(1, p->room, "plcPutsAhead");
    plcPutsBits(p, waiting);
    e = plcEntryOf(&all, 1, 0);
    for (i = 0; i < p->size; i++)
        any |= plcEntryMask(e)[i] = (epicsUInt8)(bits[i] & ~waiting[i]);
    free(waiting);
    if (!any) {
        free(e);
        return 0;
    }
    e->first = e->last = plcPutsThrough(p) + 1; /* of the first that waits: that is not through */
    e->again = 1;
    ellInsert(&p->waiting, NULL, &e->node);
    if (!p->newest[0])
        p->newest[0] = e;
    return 1;
}

/* --- What leaves -------------------------------------------------------------------------*/

unsigned plcPutsTake(plcPuts *p, int (*joins)(void *arg, const plcPut *put), void *arg,
                     void *values, void *mask)
{
    entry *e;
    plcPut view;
    unsigned count = 0;

    if (ellCount(&p->underWay))
        return 0;
    while ((e = (entry *)ellFirst(&p->waiting))) {
        view = plcEntryView(e);
        /* The first is asked too, so that joins() knows it. */
        if (joins && !joins(arg, &view) && count)
            break;
        if (count && (!joins || plcEntryChanges(e, values, mask)))
            break;
        unlinkEntry(p, e);
        plcEntryTake(e, values, mask);
        ellAdd(&p->underWay, &e->node);
        count++;
    }
    return count;
}

void plcPutsDone(plcPuts *p)
{
    entry *e;

    while ((e = (entry *)ellGet(&p->underWay))) {
        if (!e->failed && !e->lost)
            taken(p, e);
        letGo(e);
    }
}

void plcPutsBack(plcPuts *p)
{
    entry *e;

    while ((e = (entry *)ellLast(&p->underWay))) {
        ellDelete(&p->underWay, &e->node);
        if (e->cancelled) {
            letGo(e);
            continue;
        }
        e->failed = 0; /* the next time it may not */
        ellInsert(&p->waiting, NULL, &e->node);
        if (!p->newest[e->offset])
            p->newest[e->offset] = e;
    }
    if (p->away)
        plcPutsAway(p, 1);
}

void plcPutsEnd(plcPuts *p, const void *mask)
{
    entry *e, *next;

    for (e = (entry *)ellFirst(&p->underWay); e; e = next) {
        next = (entry *)ellNext(&e->node);
        e->lost |= plcEntryTouches(e, 0, p->room, mask);
        if (!plcEntryWithout(e, 0, p->room, mask))
            continue;
        ellDelete(&p->underWay, &e->node);
        letGo(e);
    }
}

/* What is put again has no number of its own, only one that says how far puts are through. */
static entry *findNumber(ELLLIST *list, epicsUInt64 number)
{
    entry *e = (entry *)ellFirst(list);

    while (e && (e->again || number < e->first || number > e->last))
        e = (entry *)ellNext(&e->node);
    return e;
}

plcPutFate plcPutsCancel(plcPuts *p, epicsUInt64 number)
{
    entry *e = findNumber(&p->underWay, number);

    if (e) {
        e->cancelled = e->last == number;
        return plcPutMaybe;
    }
    e = findNumber(&p->waiting, number);
    if (!e)
        return plcPutsThrough(p) >= number ? plcPutThrough : plcPutNever;
    if (e->last == number)
        dropEntry(p, e);
    return plcPutNever;
}

/* Of a list. Under way, it does not wait again. */
static void againNot(plcPuts *p, ELLLIST *list, size_t offset, size_t length, const void *mask)
{
    entry *e, *next;

    for (e = (entry *)ellFirst(list); e; e = next) {
        next = (entry *)ellNext(&e->node);
        if (!e->again || !plcEntryWithout(e, offset, length, mask))
            continue;
        if (list == &p->waiting)
            unlinkEntry(p, e);
        else
            ellDelete(list, &e->node);
        letGo(e);
    }
}

void plcPutsAgainNot(plcPuts *p, size_t offset, size_t length, const void *mask)
{
    againNot(p, &p->waiting, offset, length, mask);
    againNot(p, &p->underWay, offset, length, mask);
}

unsigned plcPutsCount(const plcPuts *p)
{
    return (unsigned)(ellCount(&p->waiting) + ellCount(&p->underWay));
}

static void addBits(const ELLLIST *list, epicsUInt8 *mask)
{
    ELLNODE *node;
    size_t i;

    for (node = ellFirst(list); node; node = ellNext(node)) {
        entry *e = (entry *)node;

        for (i = 0; i < e->length; i++)
            mask[e->offset + i] |= e->masked ? plcEntryMask(e)[i] : 0xff;
    }
}

int plcPutsOverlay(const plcPuts *p, size_t offset, size_t length, const void *mask, void *bytes)
{
    const epicsUInt8 *wanted = mask;
    epicsUInt8 *to = bytes, bits;
    ELLNODE *node;
    size_t i, at;
    int any = 0;

    for (node = ellFirst(&p->waiting); node; node = ellNext(node)) {
        entry *e = (entry *)node;

        for (i = 0; i < e->length; i++) {
            at = e->offset + i;
            if (at < offset || at - offset >= length)
                continue;
            bits = (epicsUInt8)((e->masked ? plcEntryMask(e)[i] : 0xff) &
                                (wanted ? wanted[at - offset] : 0xff));
            any |= bits;
            if (to)
                to[at - offset] = (epicsUInt8)((to[at - offset] & ~bits) | (e->bytes[i] & bits));
        }
    }
    return any != 0;
}

void plcPutsBits(const plcPuts *p, void *mask)
{
    addBits(&p->underWay, mask);
    addBits(&p->waiting, mask);
}

epicsUInt64 plcPutsThrough(const plcPuts *p)
{
    const entry *e = (const entry *)ellFirst(&p->underWay);

    if (!e)
        e = (const entry *)ellFirst(&p->waiting);
    return e ? e->first - 1 : p->number;
}

epicsUInt64 plcPutsDropped(const plcPuts *p)
{
    return p->dropped;
}
