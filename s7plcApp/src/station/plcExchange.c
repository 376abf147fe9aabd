/* Between a station's thread and a transport with a worker: news become blocks, alarms and
 * counters; what records have put is handed over.
 *
 * Knows nothing of requests or of what the wire is. All functions run in the station's
 * thread, but for create, destroy and the report; none waits.
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsAtomic.h>
#include <epicsStdio.h>
#include <errlog.h>

#include "plcStationPvt.h"

/* A put may take this long until the PLC shows it, beyond the period of reading, ms. */
#define SHOWN_MS 1000

/* Beyond what requests may take, until a worker that makes none is given up, ms. */
#define SILENCE_MS 1000

/* Until a callback is asked for again, ms. */
#define ASK_AGAIN_MS 10

void plcExchangeCreate(plcStation *s, unsigned line)
{
    plcExchange *x = callocMustSucceed(1, sizeof(*x), "plcExchangeCreate");

    x->transport = s->lines[line].transport;
    x->pvt = s->lines[line].pvt;
    x->line = line;
    x->input = callocMustSucceed(1, s->inSize + 1, "plcExchangeCreate");
    x->output = callocMustSucceed(7, s->outSize + 1, "plcExchangeCreate");
    x->image = x->output + s->outSize;
    x->mask = x->image + s->outSize;
    x->hidden = x->mask + s->outSize;
    x->older = x->hidden + s->outSize;
    x->unsure = x->older + s->outSize;
    x->lost = x->unsure + s->outSize;
    if (x->transport->takesPuts)
        s->options.holdoff = 0; /* what comes while a request is under way gathers anyway */
    if (x->transport->used) {
        plcImageUse(s->in, 0);
        plcImageUse(s->out, 0);
        plcScanUse(s->inScan, 0);
    }
    s->exchange = x;
}

void plcExchangeBegin(plcStation *s)
{
    if (s->exchange)
        s->exchange->transport->begin(s->exchange->pvt);
}

void plcExchangeEnd(plcStation *s)
{
    if (s->exchange)
        s->exchange->transport->end(s->exchange->pvt);
}

void plcExchangeDestroy(plcStation *s)
{
    plcExchange *x = s->exchange;

    if (!x)
        return;
    free(x->input);
    free(x->output);
    free(x);
    s->exchange = NULL;
}

void plcExchangeOptions(plcStation *s)
{
    if (!s->exchange)
        return;
    s->exchange->transport->options(s->exchange->pvt, &s->now);
    epicsAtomicSetIntT(&s->acknowledges, s->exchange->transport->takesPuts &&
                                             s->now.complete == plcCompleteAcknowledged);
    plcImageAllEdges(s->out, s->now.writes == plcWritesAll);
}

/* --- The connection -----------------------------------------------------------------------*/

/* Which bytes of a block belong to one value: a request may end between values only, and between the
 * elements of an array. 1: of a number, 2: of a text that is read. To be freed; NULL when no record
 * needs it. */
static epicsUInt8 *wholeValues(plcStation *s, int output)
{
    size_t count, i, byte, size = plcImageSize(output ? s->out : s->in);
    plcOwner *owners = plcOwnersCopy(s->owners, output, &count);
    epicsUInt8 *whole = NULL;

    if (count)
        whole = callocMustSucceed(1, size + 1, "wholeValues");
    for (i = 0; i < count; i++) {
        const plcOwner *o = &owners[i];

        if (o->offset + o->length > size) /* one that has just come: the next time */
            continue;
        for (byte = 1; byte < o->length; byte++)
            if (byte % o->type->size)
                whole[o->offset + byte] = 1;
            else if (!output && o->type->kind & (plcText | plcBcd) && !whole[o->offset + byte])
                whole[o->offset + byte] = 2;
    }
    free(owners);
    return whole;
}

static void tellWhole(plcStation *s, int isUp)
{
    plcExchange *x = s->exchange;
    epicsUInt8 *in, *out;

    x->owners = plcOwnersChanges(s->owners);
    in = x->line == 0 ? wholeValues(s, 0) : NULL;
    out = wholeValues(s, 1);
    if (!isUp)
        x->transport->up(x->pvt, s->lines[x->line].connection.socket, in, out);
    else if (x->transport->whole)
        x->transport->whole(x->pvt, in, out);
    free(in);
    free(out);
}

/* A transport with places that are given away one by one uses more of the images. */
static void growWhenUsed(plcStation *s)
{
    plcExchange *x = s->exchange;
    size_t used = x->transport->used ? x->transport->used(x->pvt) : 0;

    if (used <= x->used)
        return;
    x->used = used;
    plcImageUse(s->in, used);
    plcImageUse(s->out, used);
    plcScanUse(s->inScan, used);
}

/* Not before all records are there: the worker must know where values lie, or it would cut
 * one. */
static void startWhenReady(plcStation *s)
{
    plcExchange *x = s->exchange;

    growWhenUsed(s);
    if (x->sign && x->owners != plcOwnersChanges(s->owners))
        tellWhole(s, 1);
    if (!x->waiting || !epicsAtomicGetIntT(&s->ready))
        return;
    x->waiting = 0;
    x->sign = epicsMonotonicGet();
    tellWhole(s, 0);
}

/* A number that grows when puts are through, or lost. Of those that were through when the news were
 * fetched: what the PLC has said of them is known then, too. */
static epicsUInt64 countThrough(plcStation *s)
{
    return s->exchange->through + (epicsUInt64)epicsAtomicGetIntT(&s->outLosses);
}

void plcExchangeUp(plcStation *s)
{
    plcExchange *x = s->exchange;

    x->ordered = 0;
    x->waiting = x->late = 1;
    x->lateTold = countThrough(s);
    startWhenReady(s);
}

static void tellListener(plcStation *s)
{
    plcExchange *x = s->exchange;
    epicsUInt64 through;

    if (!s->listener || !s->listener->through)
        return;
    through = countThrough(s);
    if (through != x->listenerTold)
        s->listener->through(s->listenerPvt);
    x->listenerTold = through;
}

/* Records that wait for their put are told, when it may be through. Where the queue of callbacks
 * is full, the next step asks again. */
static void tellThrough(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    plcExchange *x = s->exchange;
    epicsUInt64 through;

    if (!epicsAtomicGetIntT(&s->awaited)) /* who waits has said before whom to tell */
        return;
    through = countThrough(s);
    if (through == x->told)
        return;
    if (epicsAtomicCmpAndSwapIntT(&s->telling, 0, 1) == 0 &&
        callbackRequest(&s->throughCallback)) {
        epicsAtomicSetIntT(&s->telling, 0);
        plcScanQueueFull();
        plcEarlier(wake, now + plcMsToNs(ASK_AGAIN_MS));
        return;
    }
    x->told = through;
}

/* Records whose puts waited for this connection are told as they leave, one after the other. There
 * are none when no put waits once the PLC's values are taken, and none is through by then. */
static void tellLate(plcStation *s)
{
    plcExchange *x = s->exchange;
    epicsUInt64 news;
    int waits;

    if (!x->late || !epicsAtomicGetIntT(&s->taken))
        return;
    waits = plcImagePutsWaiting(s->out, NULL, NULL) != 0;
    news = plcImagePutsThrough(s->out, NULL) - x->through; /* after that look */
    if (waits || !news)
        x->late = waits;
    if (countThrough(s) == x->lateTold)
        return;
    x->lateTold = countThrough(s);
    plcInputFollow(s, 0);
}

/* What is under way may have reached the PLC, what waits has not, and nobody knows when it will. */
void plcExchangeLost(plcStation *s, const char *why)
{
    plcExchange *x = s->exchange;
    size_t i;

    plcImagePutsWaiting(s->out, x->image, x->mask);
    for (i = 0; epicsAtomicGetIntT(&s->taken) && i < plcImageSize(s->out); i++)
        x->unsure[i] |= x->mask[i];
    plcImagePutsFail(s->out, 0, plcImageSize(s->out), NULL, why);
    plcFaultsSet(s->outFaults, 0, plcImageSize(s->out), x->mask, why);
    plcInputFollow(s, 0);
}

/* What the PLC does not show, for this reason, is told to records; mask NULL: all of it, or (reason
 * "") nothing. */
static void tellHidden(plcStation *s, const char *mask, const char *reason)
{
    size_t i, size = plcImageSize(s->out);
    int changed = 0;

    if (!s->hidden)
        return;
    for (i = 0; mask && i < size; i++)
        s->exchange->mask[i] = (char)~mask[i];
    if (mask || !reason[0])
        changed = plcFaultsClear(s->hidden, 0, size, mask ? s->exchange->mask : NULL);
    if (reason[0])
        changed |= plcFaultsSet(s->hidden, 0, size, mask, reason);
    if (changed)
        plcInputFollow(s, 0);
}

void plcExchangeDown(plcStation *s)
{
    plcExchange *x = s->exchange;

    x->waiting = 0;
    x->sign = 0;
    x->transport->down(x->pvt);
    plcInputRefused(s, 0, 0, "");
    plcImageAway(s->out, 1);
    epicsAtomicIncrIntT(&s->outLosses);
    tellHidden(s, NULL, "");
    x->shown = s->unread = 0; /* no block may tell what the next connection is asked for */
    epicsAtomicSetIntT(&s->taken, 0);
    tellListener(s);
}

/* --- News ---------------------------------------------------------------------------------*/

static void countNews(plcStation *s, const plcNews *news, epicsUInt64 now)
{
    plcExchange *x = s->exchange;

    epicsMutexMustLock(s->lock);
    s->stats.requests += news->requests;
    s->stats.exceptions += news->exceptions;
    s->stats.requestTimeouts += news->timeouts;
    s->stats.bytesIn += news->bytesIn;
    s->stats.bytesOut += news->bytesOut;
    s->stats.blocksOut += news->writes;
    s->stats.blocksIn += news->blocks;
    if (news->blocks)
        s->stats.skipped += news->blocks - 1;
    if (news->latency > 0)
        s->stats.requestLatency = news->latency;
    if (news->latencyMax > s->stats.requestLatencyMax)
        s->stats.requestLatencyMax = news->latencyMax;
    if (news->writes)
        s->stats.lastSend = now;
    if (x->ordered && (x->transport->takesPuts ? !plcImagePutsWaiting(s->out, NULL, NULL)
                                               : news->idle)) {
        plcStatsSend(&s->stats, (now - x->ordered) / PLC_NS_PER_MS);
        x->ordered = 0;
    }
    epicsMutexUnlock(s->lock);
}

/* The connection is good for something: it may be said again when it is lost. */
static void answered(plcStation *s)
{
    plcLine *line = &s->lines[s->exchange->line];
    char text[80];

    if (line->lostEmpty) {
        epicsSnprintf(text, sizeof(text), "%s requests are answered again",
                      s->exchange->transport->name);
        plcStationLog(s, errlogInfo, text);
    }
    line->hangUps = 0;
    if (line->lostEmpty) {
        line->lostEmpty = 0;
        plcInputSetLeads(s);
    }
}

/* The input image is new. */
static void inputCame(plcStation *s, const plcNews *news, epicsUInt64 now)
{
    const char *block = s->exchange->input;

    answered(s);
    s->lines[s->exchange->line].lastBlock = now;
    plcInputBlock(s, block, s->now.timestamp < 0 ? news->stamp : plcInputStamp(s, block),
                  news->blocks, now);
}

/* Before outputs take what the PLC shows: what was on its way when the connection was lost, and
 * is not there, is a fault until a later write is acknowledged, though nobody tries again. */
static void findLost(plcStation *s, const char *shown)
{
    plcExchange *x = s->exchange;
    size_t i;

    plcImagePeek(s->out, 0, plcImageSize(s->out), x->image);
    for (i = 0; i < plcImageSize(s->out); i++) {
        if (x->lost[i] && !plcFaultsCount(s->outFaults, i, 1))
            x->lost[i] = 0;
        x->lost[i] |= x->unsure[i] & (x->image[i] ^ shown[i]);
        x->unsure[i] = 0;
    }
}

/* What the PLC holds as we do is no fault any more. An alarm elsewhere ends with a write that
 * is acknowledged; so does that of a put that waits, which `shown` has as if it were there. */
static void forgetFaults(plcStation *s, const char *shown)
{
    plcExchange *x = s->exchange;
    size_t i;

    plcImagePeek(s->out, 0, plcImageSize(s->out), x->image);
    for (i = 0; i < plcImageSize(s->out); i++)
        x->mask[i] = (char)~(x->image[i] ^ shown[i]);
    plcImagePutsWaiting(s->out, NULL, x->image);
    for (i = 0; i < plcImageSize(s->out); i++)
        x->mask[i] &= (char)~(x->image[i] | x->lost[i] | (x->hides ? x->hidden[i] : 0));
    plcFaultsClear(s->outFaults, 0, plcImageSize(s->out), x->mask);
}

/* Of what the PLC does not show nothing is taken, and nobody follows it. */
static void hide(plcStation *s)
{
    plcExchange *x = s->exchange;
    size_t i;

    x->hides = x->transport->hidden && x->transport->hidden(x->pvt, x->hidden);
    tellHidden(s, x->hides ? x->hidden : NULL, x->hides ? x->why : "");
    if (!x->hides)
        return;
    plcImagePeek(s->out, 0, plcImageSize(s->out), x->image);
    for (i = 0; i < plcImageSize(s->out); i++)
        x->output[i] = (char)((x->output[i] & ~x->hidden[i]) | (x->image[i] & x->hidden[i]));
}

/* The outputs as the PLC holds them, on a new connection: outputs with a read-back
 * take them, and what else the IOC has written is put again where it differs, or where the PLC does
 * not show it. */
static void outputsTake(plcStation *s, char *shown)
{
    plcExchange *x = s->exchange;
    epicsUInt8 *whole = wholeValues(s, 1);
    unsigned places = 0;
    size_t i;

    if (shown) {
        const char *hidden = x->hides ? x->hidden : NULL;

        findLost(s, shown);
        places = plcReadbackTake(s->atConnect, shown, hidden, s->out) +
                 plcReadbackTake(s->tracked, shown, hidden, s->out);
        forgetFaults(s, shown);
    }
    if (!s->inSize || plcLineIsOutput(s, x->line)) /* else the first input tells */
        answered(s);
    plcImageAway(s->out, 0);
    for (i = 0; shown && x->hides && i < plcImageSize(s->out); i++)
        shown[i] = (char)(shown[i] ^ x->hidden[i]);
    plcImagePutAgain(s->out, shown, whole);
    free(whole);
    s->dirtySince = 0;
    epicsAtomicIncrIntT(&s->takes);
    epicsAtomicSetIntT(&s->taken, 1);
    plcInputHeld(s);
    plcInputFollow(s, places);
}

/* Puts whose value the PLC shows are in the PLC, whatever became of them. */
static void findPuts(plcStation *s)
{
    plcExchange *x = s->exchange;
    size_t i, size = plcImageSize(s->out);

    if (!plcImagePutsFailed(s->out))
        return;
    for (i = 0; i < size; i++)
        x->mask[i] = (char)((x->hides ? x->hidden[i] : 0) |
                            (x->transport->age ? x->older[i] : 0));
    if (plcImagePutsShown(s->out, x->output, x->mask))
        plcInputFollow(s, 0);
}

/* Outputs follow what the PLC shows of them. */
static void track(plcStation *s, const plcShownAfter *after, epicsUInt64 now)
{
    plcExchange *x = s->exchange;
    epicsUInt64 limit = plcMsToNs(s->now.readPeriod + SHOWN_MS);
    unsigned places;

    places = plcReadbackTrack(s->tracked, x->output, x->hides ? x->hidden : NULL, s->out, now,
                              limit, !x->ordered,
                              x->transport->age ? after : NULL);
    if (places)
        plcInputFollow(s, places);
}

/* Not before the PINI run is over: its values would come later and count as puts. */
static void lookAtOutputs(plcStation *s, epicsUInt64 now)
{
    plcExchange *x = s->exchange;
    int first = !epicsAtomicGetIntT(&s->taken);
    plcShownAfter after = {0, x->older};

    if (!epicsAtomicGetIntT(&s->running))
        return;
    if (x->shown && x->transport->age)
        x->transport->age(x->pvt, &after.through, x->older);
    if (x->shown)
        findPuts(s);
    if (x->shown && first) {
        outputsTake(s, x->output);
    } else if (x->shown && s->now.track) {
        track(s, &after, now);
    } else if (s->unread && first && !plcReadbackCount(s->readback)) {
        outputsTake(s, NULL); /* else the first block tells */
    }
    x->shown = 0;
}

/* A worker that stands still must not leave old data with the records as good. A request, and
 * a second one where the PLC was busy, may take requestTimeout each. */
static int workerStands(plcStation *s, epicsUInt64 now, epicsUInt64 *wake,
                        char why[PLC_REASON_SIZE])
{
    plcExchange *x = s->exchange;
    double pause = x->transport->pause(x->pvt, &s->now);
    epicsUInt64 due;

    if (!x->sign || !(pause > 0))
        return 0;
    due = x->sign + plcMsToNs(pause + 2 * s->now.requestTimeout + SILENCE_MS);
    if (now < due) {
        plcEarlier(wake, due);
        return 0;
    }
    epicsSnprintf(why, PLC_REASON_SIZE, "no %s request for %.1f s", x->transport->name,
                  (now - x->sign) * 1e-9);
    return 1;
}

static void countRefused(plcStation *s)
{
    plcExchange *x = s->exchange;
    char first[PLC_REASON_SIZE + 60];
    unsigned count, of;

    if (!x->transport->refused)
        return;
    count = x->transport->refused(x->pvt, &of, first, sizeof(first));
    plcInputRefused(s, count, of, first);
}

int plcExchangeNews(plcStation *s, epicsUInt64 now, plcExchangeOpened *opened, epicsUInt64 *wake,
                    char why[PLC_REASON_SIZE])
{
    plcExchange *x = s->exchange;
    plcNews news;
    char text[PLC_REASON_SIZE + 60];
    int byBlock;
    int others = x->sign && x->owners != plcOwnersChanges(s->owners);

    x->through = plcImagePutsThrough(s->out, NULL);
    startWhenReady(s);
    if (others) /* what a record has left is of no interest any more */
        countRefused(s);
    if (x->transport->news(x->pvt, &news, x->input, x->output)) {
        countNews(s, &news, now);
        if (x->sign && news.requests)
            x->sign = now;
        if (news.opened)
            opened(s, x->line, now);
        if (news.log[0])
            plcStationLogOf(s, errlogMajor, news.at, news.room, news.log);
        if (news.unread[0])
            memcpy(x->why, news.unread, PLC_REASON_SIZE);
        if (news.shown)
            hide(s);
        else if (news.unread[0])
            tellHidden(s, NULL, x->why);
        /* Outputs that begin with the block are not to begin with a part of the registers. */
        byBlock = !news.shown || (x->hides && plcReadbackCount(s->readback));
        if (news.shown && !byBlock)
            x->shown = 1;
        if (news.unread[0] && byBlock && !s->unread) {
            s->unread = 1;
            epicsSnprintf(text, sizeof(text), "the PLC does not show its outputs: %s",
                          news.unread);
            plcStationLog(s, errlogMinor, text);
        }
        if (news.inFaults)
            countRefused(s);
        if (news.blocks)
            inputCame(s, &news, now);
        if (news.inFaults && s->valid)
            plcScanRequestAll(s->inScan);
        if (news.outFaults)
            plcInputFollow(s, 0);
        if (news.inFaults)
            plcStationChanged(s);
        if (news.lost) {
            memcpy(why, news.why, PLC_REASON_SIZE);
            return 1;
        }
    }
    if (s->lines[x->line].connection.state == plcConnectionUp && s->outSize)
        lookAtOutputs(s, now);
    return workerStands(s, now, wake, why);
}

void plcExchangePuts(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    plcStationCountPuts(s);
    tellListener(s);
    tellThrough(s, now, wake);
    tellLate(s);
}

/* --- Orders -------------------------------------------------------------------------------*/

static int always(void *arg, const plcPut *put)
{
    (void)arg, (void)put;
    return 1;
}

/* For a transport that does not take puts one by one: their newest values, and their bits. */
static void takeAll(plcStation *s)
{
    plcExchange *x = s->exchange;

    memset(x->mask, 0, plcImageSize(s->out));
    while (plcImageTakePuts(s->out, always, NULL, x->image, x->mask))
        plcImagePutsDone(s->out);
}

void plcExchangeOutputStep(plcStation *s, epicsUInt64 now, epicsUInt64 *wake)
{
    plcExchange *x = s->exchange;
    int forced;
    epicsUInt64 due;

    if (s->lines[x->line].connection.state != plcConnectionUp ||
        !epicsAtomicGetIntT(&s->taken))
        return;
    forced = epicsAtomicGetIntT(&s->sendNow);
    if (forced) {
        epicsAtomicSetIntT(&s->sendNow, 0);
        plcImagePutAgain(s->out, NULL, NULL);
    }
    if (!plcImageDirty(s->out))
        return;
    if (!s->dirtySince)
        s->dirtySince = now;
    due = forced ? now : s->dirtySince + plcMsToNs(s->now.holdoff);
    if (now < due) {
        plcEarlier(wake, due);
        return;
    }
    plcImageHandOver(s->out);
    if (x->transport->takesPuts) {
        x->transport->put(x->pvt, NULL, NULL);
    } else {
        takeAll(s);
        x->transport->put(x->pvt, x->image, x->mask);
    }
    if (s->listener && s->listener->sent) {
        plcImagePeek(s->out, 0, plcImageSize(s->out), x->image);
        s->listener->sent(s->listenerPvt, x->image);
    }
    if (!x->ordered)
        x->ordered = s->dirtySince;
    s->dirtySince = 0;
}
