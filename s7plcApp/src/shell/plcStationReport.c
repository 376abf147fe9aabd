/* A station in words: dbior, s7plcReport. Only copies; never waits for the thread. */
#include <string.h>

#include <epicsStdio.h>

#include "plcStationPvt.h"

static void histogram(FILE *file, const char *title, const epicsUInt32 *bins)
{
    epicsUInt32 most = 0;
    int i, first = PLC_BINS, last = -1;

    for (i = 0; i < PLC_BINS; i++) {
        if (!bins[i])
            continue;
        if (i < first)
            first = i;
        last = i;
        if (bins[i] > most)
            most = bins[i];
    }
    fprintf(file, "    %s\n", title);
    for (i = first; i <= last; i++)
        fprintf(file, "    %10.3g ms %10u %.*s\n", plcStatsBinStart(i), bins[i],
                (int)((epicsUInt64)bins[i] * 50 / most),
                "##################################################");
}

static void counters(const plcStats *st, FILE *file)
{
    fprintf(file, "    in:  %llu blocks, %llu bytes, %llu skipped, %llu coalesced, "
            "%llu ignored\n", (unsigned long long)st->blocksIn,
            (unsigned long long)st->bytesIn, (unsigned long long)st->skipped,
            (unsigned long long)st->coalesced, (unsigned long long)st->ignored);
    fprintf(file, "    out: %llu blocks, %llu bytes, %llu of them heartbeats, %llu had to wait, "
            "%llu puts refused\n", (unsigned long long)st->blocksOut,
            (unsigned long long)st->bytesOut, (unsigned long long)st->heartbeats,
            (unsigned long long)st->slowSends, (unsigned long long)st->refusedWrites);
    fprintf(file, "    connects: %llu made, %llu lost, %llu failed; wrong size: %llu, "
            "out of step: %llu, doubts: %llu\n", (unsigned long long)st->connects,
            (unsigned long long)st->disconnects, (unsigned long long)st->connectErrors,
            (unsigned long long)st->sizeMismatches, (unsigned long long)st->outOfStep,
            (unsigned long long)st->doubts);
    if (st->periods)
        fprintf(file, "    period [ms]: last %.3f min %.3f max %.3f mean %.3f jitter %.3f\n",
                st->periodLast, st->periodMin, st->periodMax, st->periodMean, st->jitter);
    fprintf(file, "    latency [ms]: block to end of scan %.3f (max %.3f), "
            "put to kernel %.3f (max %.3f)\n", st->scanLatency, st->scanLatencyMax,
            st->sendLatency, st->sendLatencyMax);
}

static void syncLine(const plcStats *st, FILE *file)
{
    double since = st->syncSince ? (epicsMonotonicGet() - st->syncSince) * 1e-9 : 0;

    fprintf(file, "    sync: %s for %.1f s, PLC in %s; %llu times synced, %llu times lost, "
            "%llu values read back\n", plcSyncStateName(st->syncState), since,
            st->remote ? "REMOTE" : "LOCAL", (unsigned long long)st->syncs,
            (unsigned long long)st->syncsLost, (unsigned long long)st->readbacks);
}

static void mapLine(const plcStats *st, FILE *file)
{
    fprintf(file, "    table of pointers: %s%s%s, %d %%; CRC ours 0x%08X, the PLC's 0x%08X; "
            "%llu downloads, %llu refused\n", plcTablesStateName(st->mapState),
            st->mapReason[0] ? ": " : "", st->mapReason, st->mapProgress,
            (unsigned)st->mapCrc, (unsigned)st->mapPlcCrc,
            (unsigned long long)st->mapDownloads, (unsigned long long)st->mapRefusals);
}

/* The order of words, where it is not that of the bytes. */
static const char *wordsText(int order)
{
    if (!(order & plcWordsSwapped))
        return "";
    return order & plcBigEndian ? ", low word first" : ", high word first";
}

/* A transport that has something to say of line i. */
static void transportLines(plcStation *s, unsigned i, FILE *file)
{
    const plcLine *line = &s->lines[i];
    plcStats stats;
    char where[PLC_NAME_MAX + 12], reason[PLC_REASON_SIZE], state[PLC_REASON_SIZE + 20];

    plcStationStats(s, &stats);
    epicsMutexMustLock(s->lock);
    epicsSnprintf(where, sizeof(where), "%s:%d", s->address[i], s->port[i]);
    epicsMutexUnlock(s->lock);
    if (plcStationOutputConnected(s, reason))
        strcpy(state, "connected");
    else
        epicsSnprintf(state, sizeof(state), "not connected (%s)", reason);
    line->transport->report(line->pvt, where, state, &stats, file);
}

void plcStationReport(plcStation *s, FILE *file, int level)
{
    plcStats st;
    char address[PLC_NAME_MAX + 10], reason[PLC_REASON_SIZE], text[400];
    unsigned i;

    plcStationStats(s, &st);
    plcStationAddress(s, address, sizeof(address));
    plcImageReason(s->in, reason);
    fprintf(file, "  %s %s: %s", s->name, address, plcStateName(st.state));
    if (st.state != plcStateOk && (reason[0] || st.refusal[0]))
        fprintf(file, " (%s)", reason[0] ? reason : st.refusal);
    fprintf(file, ", in %u bytes, out %u bytes, %s endian%s\n",
            (unsigned)plcImageSize(s->in), (unsigned)plcImageSize(s->out), s->bigEndian ? "big" : "little", wordsText(s->order));
    if (s->policy->report)
        s->policy->report(s->policyPvt, file, level);
    if (level < 1)
        return;
    for (i = 0; i < s->lineCount; i++)
        if (s->lines[i].transport->report)
            transportLines(s, i, file);
    plcStationOptionsText(s, text, sizeof(text));
    fprintf(file, "    options: %s\n", text[0] ? text : "all default");
    fprintf(file, "    I/O Intr records: %u in, %u out", plcScanCount(s->inScan),
            plcScanCount(s->outScan));
    if (plcScanHeld(s->inScan) > 0)
        fprintf(file, "; in callback threads, since they held the PLC's own up for %.0f ms",
                plcScanHeld(s->inScan));
    fprintf(file, "\n");
    if (plcStationHeader(s))
        syncLine(&st, file);
    if (st.mapState)
        mapLine(&st, file);
    counters(&st, file);
    if (st.lastError[0])
        fprintf(file, "    last error: %s\n", st.lastError);
    if (level < 2)
        return;
    if (s->exchange)
        fprintf(file, "    puts: %u wait, %llu dropped because too many waited\n", st.putsWaiting,
                (unsigned long long)st.putsDropped);
    histogram(file, "time from block to block", st.periodHist);
    histogram(file, "time from block to end of scan", st.latencyHist);
}

void plcStationOptions(plcStation *s, FILE *file)
{
    plcOptions options;

    epicsMutexMustLock(s->lock);
    options = s->options;
    epicsMutexUnlock(s->lock);
    fprintf(file, "Options of PLC %s:\n", s->name);
    plcOptionsPrint(&options, file);
}
