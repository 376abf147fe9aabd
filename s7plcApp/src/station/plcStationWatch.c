/* What happens on the lines of a station: their timers, what poll() reports, blocks that came, those
 * of a wrong size, and silence. Knows neither addresses nor who leads.
 *
 * All functions run in the station's thread; none waits.
 */
#include <poll.h>
#include <string.h>

#include <epicsAtomic.h>
#include <epicsStdio.h>
#include <errlog.h>

#include "plcHot.h"
#include "plcStationPvt.h"

/* Records that have not processed so long after a loss have something else to do, ms. */
#define LOSS_SEEN_MS 500

PLC_COLD static void countVerdict(plcLine *line, epicsUInt64 now)
{
    if (!line->verdicts || now - line->verdictsSince >= plcMsToNs(60000)) {
        line->verdicts = 0;
        line->verdictsSince = now;
    }
    line->verdicts++;
}

/* True when records have processed because of the loss, so that they saw it and its
 * reason before the next connection takes its place. */
static int lossSeen(plcStation *s, const plcLine *line, epicsUInt64 now,
                    epicsUInt64 *wake)
{
    epicsUInt64 limit = line->lostAt + plcMsToNs(LOSS_SEEN_MS);
    int seen = 1;

    if (line->lostAt && now < limit) {
        epicsAtomicSetIntT(&s->waiting, 1);
        seen = !plcScanBusy(s->inScan);
        plcEarlier(wake, seen ? PLC_NEVER : limit);
    }
    if (seen) /* else the end of each pass would wake us for ever */
        epicsAtomicSetIntT(&s->waiting, 0);
    return seen;
}

/* The size of the blocks is right, but they begin elsewhere than they did. */
PLC_COLD static void lineOutOfStep(plcStation *s, unsigned i, epicsUInt64 now)
{
    epicsMutexMustLock(s->lock);
    s->stats.outOfStep++;
    epicsMutexUnlock(s->lock);
    plcLineLost(s, i, now, "PLC out of step: bytes lost or too many");
}

/* Says once that the block size is wrong, and gives the connection up. */
PLC_COLD static void lineWrongSize(plcStation *s, unsigned i, size_t burst, epicsUInt64 now)
{
    plcLine *line = &s->lines[i];
    int first = !line->wrongSize;
    char why[PLC_REASON_SIZE], text[200];

    if (burst == s->inSize) {
        lineOutOfStep(s, i, now);
        return;
    }
    if (burst) {
        if (epicsSnprintf(why, sizeof(why), "PLC sends %u bytes, inSize is %u", (unsigned)burst,
                          (unsigned)s->inSize) >= (int)sizeof(why))
            epicsSnprintf(why, sizeof(why), "PLC sends %u, inSize is %u", (unsigned)burst,
                          (unsigned)s->inSize);
        epicsSnprintf(text, sizeof(text),
                      "the PLC sends blocks of %u bytes, but inSize "
                      "is %u: set inSize to %u or correct the PLC",
                      (unsigned)burst, (unsigned)s->inSize, (unsigned)burst);
    } else {
        epicsSnprintf(why, sizeof(why), "PLC sends no blocks of %u bytes",
                      (unsigned)s->inSize);
        epicsSnprintf(text, sizeof(text),
                      "what the PLC sends has no block size that "
                      "fits inSize %u",
                      (unsigned)s->inSize);
    }
    line->wrongSize = 1;
    epicsMutexMustLock(s->lock);
    s->stats.sizeMismatches++;
    s->stats.disconnects += !first; /* else plcLineLost counts it */
    s->stats.burstSize = (epicsUInt32)burst;
    epicsMutexUnlock(s->lock);
    plcStationReason(s, i, why);
    if (first) {
        countVerdict(line, now);
        if (!plcLineChangesOften(line))
            plcStationLog(s, errlogMajor, text);
        plcLineLost(s, i, now, why);
    } else {
        plcConnectionClose(&line->connection, why, now);
        plcLineTellPolicy(s, plcEventLost, i, now);
    }
    if (s->leader < 0) /* else the other one of a pair has good data */
        plcInputInvalidate(s, plcStateWrongSize, why);
    plcLineRetrySlowly(line, now); /* trying fast helps nobody */
}

/* No block could be taken for too long. Bytes that fit no block are another matter than
 * silence. */
PLC_COLD static void lineSilent(plcStation *s, unsigned i, epicsUInt64 now)
{
    plcLine *line = &s->lines[i];
    char why[PLC_REASON_SIZE];
    plcCame came;

    line->transport->giveUp(line->pvt, &came);
    if (came.wrong) {
        lineWrongSize(s, i, came.burst, now);
        return;
    }
    epicsSnprintf(why, sizeof(why), "no block for %.1f s", s->now.recvTimeout / 1000);
    plcLineLost(s, i, now, why);
}

/* Timers of one connection. */
PLC_HOT void plcLineStep(plcStation *s, unsigned i, epicsUInt64 now, epicsUInt64 *wake)
{
    plcLine *line = &s->lines[i];
    plcConnection *c = &line->connection;
    epicsUInt64 due;

    if (!line->resolver)
        return;
    if (c->state == plcConnectionConnecting) {
        due = c->since + plcMsToNs(s->now.connectTimeout);
        if (now >= due) {
            plcConnectionClose(c, "PLC does not answer", now);
            plcLineFailed(s, i, now, c->error);
            line->retryAt = now; /* it has waited long enough */
        } else {
            plcEarlier(wake, due);
        }
    }
    if (c->state == plcConnectionUp && s->inSize && !plcLineExchanges(s, i) &&
        plcLineMustSend(s, i)) {
        due = plcLineSilenceDue(s, line);
        if (s->looked >= due) {
            lineSilent(s, i, now);
        } else {
            plcEarlier(wake, due);
        }
    }
    if (c->state == plcConnectionDown) {
        if (now >= line->retryAt && lossSeen(s, line, now, wake))
            plcLineOpen(s, i, now);
        if (c->state == plcConnectionDown && line->retryAt > now)
            plcEarlier(wake, line->retryAt);
        if (c->state == plcConnectionConnecting)
            plcEarlier(wake, now + plcMsToNs(s->now.connectTimeout));
    }
}

/* Whole blocks on a line whose size is right. */
static void lineBlocks(plcStation *s, unsigned i, const plcCame *came, epicsUInt64 now)
{
    plcLine *line = &s->lines[i];
    size_t burst = came->burst, count = came->count;
    const void *block = came->block;
    char text[200];

    if (line->wrongSize && !plcLineChangesOften(line))
        plcStationLog(s, errlogInfo, "blocks have the right size again");
    else if (!line->wrongSize && line->lostEmpty) {
        epicsSnprintf(text, sizeof(text), "blocks come again, after %.1f s",
                      (now - line->quietSince) * 1e-9);
        plcStationLog(s, errlogInfo, text);
    }
    line->wrongSize = line->lostEmpty = 0;
    line->lostWhy[0] = 0;
    line->lastBlock = now;
    epicsMutexMustLock(s->lock);
    s->stats.blocksIn += count;
    s->stats.skipped += count - 1;
    if (burst && burst != s->stats.burstSize)
        epicsSnprintf(text, sizeof(text), "bytes come %u at a time: is inSize %u right?",
                      (unsigned)burst, (unsigned)s->inSize);
    else
        text[0] = 0;
    s->stats.burstSize = (epicsUInt32)burst;
    epicsMutexUnlock(s->lock);
    if (text[0])
        plcStationLog(s, errlogMinor, text);
    plcLineTellPolicy(s, plcEventBlock, i, now);
    if (s->leader == (int)i) {
        plcInputBlock(s, block, plcInputStamp(s, block), count, now);
        return;
    }
    /* Kept: when the leader turns out to be silent, this is the newest there is. */
    memcpy(line->kept, block, s->inSize);
    line->keptStamp = plcInputStamp(s, block);
    line->isKept = 1;
    epicsMutexMustLock(s->lock);
    s->stats.ignored += count;
    epicsMutexUnlock(s->lock);
}

static void countDoubts(plcStation *s, plcLine *line, unsigned doubts)
{
    if (doubts > line->doubts) {
        epicsMutexMustLock(s->lock);
        s->stats.doubts++;
        epicsMutexUnlock(s->lock);
    }
    line->doubts = doubts;
}

/* Reads until nothing is left, for a while: the other line must have its turn. */
static void lineReceive(plcStation *s, unsigned i, epicsUInt64 now)
{
    plcLine *line = &s->lines[i];
    plcConnection *c = &line->connection;
    plcCame came;
    int got, turns = 16;

    do {
        got = line->transport->receive(line->pvt, c, now, &came);
        if (got <= 0)
            break;
        epicsMutexMustLock(s->lock);
        s->stats.bytesIn += got;
        epicsMutexUnlock(s->lock);
        if (!s->inSize)
            continue;
        if (came.wrong) {
            lineWrongSize(s, i, came.burst, now);
            return;
        }
        countDoubts(s, line, came.doubts);
        if (came.count)
            lineBlocks(s, i, &came, now);
    } while (came.more && --turns);
    if (got < 0)
        plcLineLost(s, i, now, c->error);
}

/* poll() reported something about this line. */
PLC_HOT void plcLineReady(plcStation *s, unsigned i, short revents, epicsUInt64 now)
{
    plcLine *line = &s->lines[i];
    plcConnection *c = &line->connection;
    int status;

    if (c->state == plcConnectionConnecting) {
        status = plcConnectionFinish(c, now);
        if (status > 0)
            plcLineUp(s, i, now);
        else if (status < 0)
            plcLineFailed(s, i, now, c->error);
        return;
    }
    if (c->state == plcConnectionUp && revents & (POLLIN | POLLHUP | POLLERR))
        lineReceive(s, i, now);
}

PLC_HOT void plcLinePoll(const plcStation *s, unsigned i, struct pollfd *fd)
{
    const plcLine *line = &s->lines[i];
    const plcConnection *c = &line->connection;
    int isUp = c->state == plcConnectionUp;

    fd->revents = 0;
    fd->fd = c->state == plcConnectionDown || (isUp && plcLineExchanges(s, i)) ? -1 : c->socket;
    fd->events = fd->fd < 0 ? 0
                            : plcConnectionEvents(c, isUp && line->transport->sending(line->pvt));
}
