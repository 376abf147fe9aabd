/* What was put is written: which puts leave together, the messages with their items, and what
 * becomes of the answers; see eipWorkerPvt.h. Does not know how values become items. All functions
 * run in the worker's thread.
 *
 * Tags are written by name: after a download an instance may be another tag.
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>

#include "eipWorkerPvt.h"

enum {
    takenMost = 500, /* puts that leave together */
    putHead = 20     /* bytes that a put has in a message beside its value, about */
};

/* --- Messages --------------------------------------------------------------------------------- */

static void putType(eipWriter *m, const eipTag *tag)
{
    eipPut16(m, tag->code);
    if (tag->code == eipStructureCode)
        eipPut16(m, tag->handle);
}

/* A single BOOL of Omron: its value, and whether it is forced. */
static int isTwoBytes(const eipWorker *w, const eipItem *it)
{
    return w->tags.omron && it->count == 1 && w->tags.tags[it->tag].code == eipBool;
}

static void putItem(eipWorker *w, eipWriter *m, unsigned i, void *arg)
{
    const eipBatch *b = arg;
    const eipItem *it = &b->items[b->from + i];
    const eipTag *tag = &w->tags.tags[it->tag];
    size_t size = it->length / 2, k;

    if (it->kind == eipItemBits) {
        eipTagPathPut(m, &w->tags, tag, it->index, eipReadModifyWrite);
        eipPut16(m, (unsigned)size);
        for (k = 0; k < size; k++) /* v = (v | or) & and */
            eipPut8(m, it->bytes[k] & it->bytes[size + k]);
        for (k = 0; k < size; k++)
            eipPut8(m, (it->bytes[k] | (epicsUInt8)~it->bytes[size + k]) & 0xff);
        return;
    }
    eipTagPathPut(m, &w->tags, tag, it->index, eipWriteTag);
    putType(m, tag);
    eipPut16(m, it->count);
    eipPutBytes(m, it->bytes, it->length);
    if (isTwoBytes(w, it))
        eipPut8(m, 0);
}

/* Of the request, its data, and the answer. */
static eipLoad loadOf(const eipWorker *w, const eipItem *it)
{
    const eipTag *tag = &w->tags.tags[it->tag];

    return (eipLoad){
        eipWriteHead + 2 + eipTagPathBytes(&w->tags, tag, it->index) + (unsigned)it->length +
            (unsigned)isTwoBytes(w, it),
        eipAnswerHead + 4};
}

/* Returns 1 when one of its puts has another end than the put before. */
static int settleItem(eipWorker *w, const eipItem *it, const char *reason)
{
    int changed = 0;
    unsigned i;

    for (i = it->want; i < it->want + it->wants; i++)
        changed |= eipItemsSettle(w, &w->tags.wants[i], reason);
    if (!reason && eipWorkerEnter(w)) {
        w->news.writes++;
        epicsMutexUnlock(w->lock);
    }
    return changed;
}

/* A PLC that knows no read-modify-write: the element is read, and written with its new bits. */
static int writeBits(eipWorker *w, const eipItem *it)
{
    const eipTag *tag = &w->tags.tags[it->tag];
    size_t size = it->length / 2, k;
    epicsUInt8 raw[8];
    eipWriter m = eipWorkerWriter(w);
    eipAnswer answer;
    eipData data;
    char reason[PLC_REASON_SIZE];

    eipTagPathPut(&m, &w->tags, tag, it->index, eipReadTag);
    eipPut16(&m, 1);
    if (eipWorkerAsk(w, &m, &answer))
        return -1;
    if (!answer.status && (eipDataTake(&answer, &data) || data.length < size))
        answer.status = eipGeneral;
    if (!answer.status) {
        for (k = 0; k < size; k++)
            raw[k] = (epicsUInt8)((data.bytes[k] & ~it->bytes[size + k]) |
                                  (it->bytes[k] & it->bytes[size + k]));
        m = eipWorkerWriter(w);
        eipTagPathPut(&m, &w->tags, tag, it->index, eipWriteTag);
        putType(&m, tag);
        eipPut16(&m, 1);
        eipPutBytes(&m, raw, size);
        if (eipWorkerAsk(w, &m, &answer))
            return -1;
    }
    eipWorkerReason(&answer, reason);
    settleItem(w, it, answer.status ? reason : NULL);
    return 0;
}

/* Writes some of the elements. */
static int writePart(eipWorker *w, const eipItem *it, unsigned from, unsigned count, eipAnswer *answer)
{
    size_t size = it->length / it->count;
    eipItem part = *it;
    eipBatch b = {&part, 1, 1, 0, 0};
    eipWriter m = eipWorkerWriter(w);

    part.index += from;
    part.bytes += from * size;
    part.count = count;
    part.length = count * size;
    putItem(w, &m, 0, &b);
    return eipWorkerAsk(w, &m, answer);
}

/* A controller that has no fragments: as many elements at a time as fit. */
static int writeRuns(eipWorker *w, const eipItem *it)
{
    unsigned size = (unsigned)it->length / it->count, at, n;
    unsigned head = loadOf(w, it).request - (unsigned)it->length + 4; /* and an index that grows */
    unsigned most = w->limits.room < head + size ? 1 : (w->limits.room - head) / size;
    eipAnswer answer = {0};
    char reason[PLC_REASON_SIZE];

    for (at = 0; at < it->count && !answer.status; at += n) {
        n = it->count - at < most ? it->count - at : most;
        if (writePart(w, it, at, n, &answer))
            return -1;
    }
    eipWorkerReason(&answer, reason);
    settleItem(w, it, answer.status ? reason : NULL);
    return 0;
}

/* More than fits a message: piece by piece, whole elements. */
static int writeLong(eipWorker *w, const eipItem *it)
{
    const eipTag *tag = &w->tags.tags[it->tag];
    eipLoad load = loadOf(w, it);
    size_t most = w->limits.room - (load.request - it->length) - 4, at = 0;
    eipAnswer answer = {0};
    char reason[PLC_REASON_SIZE];

    most -= most % 8;
    while (at < it->length && !answer.status) {
        size_t n = it->length - at < most ? it->length - at : most;
        eipWriter m = eipWorkerWriter(w);

        eipTagPathPut(&m, &w->tags, tag, it->index, eipWriteFragment);
        putType(&m, tag);
        eipPut16(&m, it->count);
        eipPut32(&m, (epicsUInt32)at);
        eipPutBytes(&m, it->bytes + at, n);
        if (eipWorkerAsk(w, &m, &answer))
            return -1;
        at += n;
    }
    eipWorkerReason(&answer, reason);
    settleItem(w, it, answer.status ? reason : NULL);
    return 0;
}

/* Several elements of which the PLC refused one are written one by one. */
static int writeApart(eipWorker *w, const eipItem *it)
{
    unsigned i;

    for (i = 0; i < it->wants; i++) {
        eipItem one = *it;
        eipAnswer answer;
        char reason[PLC_REASON_SIZE];

        one.want += i;
        one.wants = 1;
        if (writePart(w, it, i, 1, &answer))
            return -1;
        eipWorkerReason(&answer, reason);
        settleItem(w, &one, answer.status ? reason : NULL);
    }
    return 0;
}

static void takeItem(eipWorker *w, unsigned i, const eipAnswer *answer, void *arg)
{
    eipBatch *b = arg;
    const eipItem *it = &b->items[b->from + i];
    char reason[PLC_REASON_SIZE];

    b->sent = 1;
    if (it->kind == eipItemBits && answer->status == eipNoService) {
        w->noModify = eipSilentTwice;
        writeBits(w, it);
        return;
    }
    if (eipAnswerIsOtherType(answer)) {
        epicsMutexMustLock(w->tagsLock);
        eipTagSetState(&w->tags, &w->tags.tags[it->tag], eipTagNew); /* it is another one now */
        epicsMutexUnlock(w->tagsLock);
    }
    if (answer->status && it->kind == eipItemElements && it->wants > 1) {
        writeApart(w, it);
        return;
    }
    eipWorkerReason(answer, reason);
    if (it->index && (answer->status == eipPathSegment || answer->status == eipPathUnknown))
        epicsSnprintf(reason, sizeof(reason), "PLC: no such element (%02X)", answer->status);
    if (settleItem(w, it, answer->status ? reason : NULL) && answer->status)
        eipWorkerNoteOf(w, &w->tags.wants[it->want], "write of %.50s: %s", w->tags.tags[it->tag].base, reason);
}

/* A message with these has no answer: they may be in the PLC, or not. */
static void loseItems(eipWorker *w, const eipBatch *b, unsigned n)
{
    unsigned i, k;

    for (i = b->from; i < b->from + n; i++)
        for (k = b->items[i].want; k < b->items[i].want + b->items[i].wants; k++) {
            const eipWant *want = &w->tags.wants[k];
            const epicsUInt8 *mask = w->leaving + want->place;

            plcFaultsSet(w->setup.outFaults, want->place, want->room, mask, w->lost);
            plcImagePutsFail(w->setup.out, want->place, want->room, mask, w->lost);
        }
}

static int sendBatch(eipWorker *w, eipBatch *b)
{
    eipLoad *loads = callocMustSucceed(b->count + 1, sizeof(*loads), "etherip");
    unsigned *bins = callocMustSucceed(b->count + 1, sizeof(*bins), "etherip");
    unsigned i, n;
    int status = 0;

    for (i = 0; i < b->count; i++)
        loads[i] = loadOf(w, &b->items[i]);
    eipPack(loads, b->count, &w->limits, 1, bins);
    for (b->from = 0; b->from < b->count && !status; b->from += n) {
        const eipItem *it = &b->items[b->from];

        for (n = 1; b->from + n < b->count && bins[b->from + n] == bins[b->from]; n++)
            if (w->noModify >= eipSilentTwice && b->items[b->from + n].kind == eipItemBits)
                break;
        if (it->kind == eipItemBits && w->noModify >= eipSilentTwice) {
            n = 1;
            status = writeBits(w, it);
        } else if (!eipFitsAlone(&loads[b->from], &w->limits)) {
            n = 1;
            status = w->tags.omron && it->count > 1 ? writeRuns(w, it) : writeLong(w, it);
        } else {
            for (i = b->from; i < b->from + n; i++)
                if (b->items[i].kind == eipItemBits)
                    w->asking = eipAskModify;
            b->sent = 0;
            status = eipWorkerAskMany(w, n, eipAskPlain, putItem, takeItem, b);
            if (!status && !b->sent) /* not in one message: each in its own */
                for (i = 0; i < b->count; i++)
                    bins[i] = i;
            if (!status && !b->sent)
                n = 0;
        }
        if (status && w->lost[0])
            loseItems(w, b, n);
    }
    free(loads);
    free(bins);
    return status;
}

/* --- What leaves together ---------------------------------------------------------------------- */

/* Where the puts are that were taken together, in their order. */
typedef struct taken {
    size_t offset[takenMost], end[takenMost];
    unsigned count;
    size_t left; /* bytes; about one message: between two there may be reads */
} taken;

/* Called with the lock of the image held. */
static int joins(void *arg, const plcPut *put)
{
    taken *t = arg;
    size_t size = putHead + put->length;

    if (t->count == takenMost || (t->count && size > t->left))
        return 0;
    t->left -= size < t->left ? size : t->left;
    t->offset[t->count] = put->offset;
    t->end[t->count++] = put->offset + put->length;
    return 1;
}

/* Takes what leaves together. Returns 0 when there is nothing, or the session is over. */
static unsigned takeTogether(eipWorker *w, taken *t)
{
    unsigned count = 0;

    t->count = 0;
    t->left = w->limits.room;
    if (!eipWorkerEnter(w))
        return 0;
    memset(w->leaving, 0, w->used);
    if (w->mayWrite)
        count = plcImageTakePuts(w->setup.out, joins, t, w->values, w->leaving);
    if (!count)
        w->mayWrite = 0; /* the next ones have their holdoff */
    epicsMutexUnlock(w->lock);
    return count;
}

/* Writes what was taken, in its order. Returns 0, or -1: the session is over. */
static int writeTogether(eipWorker *w, const taken *t)
{
    eipBatch b = {0};
    unsigned i, k;
    int status;

    memset(w->queued, 0, w->tags.wantCount);
    w->refused = 0;
    for (i = 0; i < t->count; i++)
        for (k = eipWantsBehind(w, t->offset[i]); k < w->tags.wantCount; k++) {
            unsigned want = w->byPlace[k].want;

            if (w->byPlace[k].place >= t->end[i])
                break;
            eipItemsAdd(w, &b, want);
        }
    status = b.count ? sendBatch(w, &b) : 0;
    eipBatchFree(&b);
    if (status == 0 && eipWorkerEnter(w)) {
        plcImagePutsDone(w->setup.out);
        if (w->refused) /* the PLC holds what it held: the outputs go back to that */
            eipReadsShow(w);
        eipWorkerTell(w);
    }
    return status;
}

/* True when no wish has this put: one that has come later, or one that is not any more. */
static int isStray(const eipWorker *w, size_t offset, size_t end)
{
    unsigned k = eipWantsBehind(w, offset);

    return k == w->tags.wantCount || w->byPlace[k].place >= end;
}

/* A record whose link changes wants its tag before it puts something: then the wish is there by
 * now, and its put waits until the tag is known. Returns 1 when that is so, else 0. */
static int waitsForWish(eipWorker *w, const taken *t)
{
    unsigned i;

    for (i = 0; i < t->count && !isStray(w, t->offset[i], t->end[i]); i++)
        ;
    if (i == t->count || !eipWantsTake(w))
        return 0;
    if (eipWorkerEnter(w)) {
        plcImagePutsBack(w->setup.out);
        epicsMutexUnlock(w->lock);
    }
    return 1;
}

/* As many lots as puts wait now; those that come meanwhile have to wait for a read. Reads that are
 * late have their turn between two lots. Tags that are not known come first. */
int eipWriteAll(eipWorker *w)
{
    unsigned left = plcImagePutsWaiting(w->setup.out, NULL, NULL), count;
    taken *t;
    int status = 0;

    if (!left || !w->taught || w->tags.unknown)
        return 0;
    t = mallocMustSucceed(sizeof(*t), "etherip");
    for (; left && !status; left -= count < left ? count : left) {
        count = takeTogether(w, t);
        if (!count)
            break;
        if (!waitsForWish(w, t))
            status = writeTogether(w, t);
        else if (w->tags.unknown)
            break;
        else
            count = 0;
        if (eipReadsLate(w))
            break;
    }
    free(t);
    return status;
}
