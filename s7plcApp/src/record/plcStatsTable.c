/* The table of statistics; see plcStatsTable.h. */
#include <math.h>
#include <string.h>

#include <epicsStdio.h>
#include <epicsString.h>
#include <epicsTime.h>

#include "plcStatsTable.h"
#include "plcSync.h"
#include "plcTables.h"

#define GETTER(function)                                                                  \
    static void function(const plcStatRow *row, plcStation *station,                      \
                         const plcStats *stats, plcStatValue *value)

static const void *fieldOf(const plcStatRow *row, const plcStats *stats)
{
    return (const char *)stats + row->field;
}

/* --- Getters: each fills in `integer`, `real` or `text`, as the row's kind says ---------- */

GETTER(getInt)
{
    (void)station;
    value->integer = *(const int *)fieldOf(row, stats);
}

GETTER(getCount)
{
    (void)station;
    value->integer = (epicsInt64)*(const epicsUInt64 *)fieldOf(row, stats);
}

GETTER(getCount32)
{
    (void)station;
    value->integer = *(const epicsUInt32 *)fieldOf(row, stats);
}

GETTER(getReal)
{
    (void)station;
    value->real = *(const double *)fieldOf(row, stats);
}

/* Seconds since a monotonic time; 0 when there is none. */
GETTER(getAge)
{
    epicsUInt64 since = *(const epicsUInt64 *)fieldOf(row, stats);

    (void)station;
    value->real = since ? (epicsMonotonicGet() - since) * 1e-9 : 0;
}

GETTER(getText)
{
    (void)station;
    epicsSnprintf(value->text, sizeof(value->text), "%s",
                  (const char *)fieldOf(row, stats));
}

GETTER(getStamp)
{
    const epicsTimeStamp *stamp = fieldOf(row, stats);

    (void)station;
    if (stamp->secPastEpoch)
        epicsTimeToStrftime(value->text, sizeof(value->text), "%Y-%m-%d %H:%M:%S.%03f",
                            stamp);
}

GETTER(getStateText)
{
    (void)row, (void)station;
    epicsSnprintf(value->text, sizeof(value->text), "%s", plcStateName(stats->state));
}

GETTER(getSyncText)
{
    (void)row, (void)station;
    epicsSnprintf(value->text, sizeof(value->text), "%s",
                  plcSyncStateName(stats->syncState));
}

GETTER(getMapText)
{
    (void)row, (void)station;
    epicsSnprintf(value->text, sizeof(value->text), "%s",
                  plcTablesStateName(stats->mapState));
}

GETTER(getReason)
{
    (void)row;
    plcImageReason(plcStationInput(station), value->text);
    if (!value->text[0])
        epicsSnprintf(value->text, sizeof(value->text), "%s", stats->refusal);
}

GETTER(getAddress)
{
    (void)row, (void)stats;
    plcStationAddress(station, value->text, sizeof(value->text));
}

GETTER(getOptions)
{
    (void)row, (void)stats;
    plcStationOptionsText(station, value->text, sizeof(value->text));
}

GETTER(getName)
{
    (void)row, (void)stats;
    epicsSnprintf(value->text, sizeof(value->text), "%s", plcStationName(station));
}

GETTER(getFirst)
{
    (void)row, (void)stats;
    plcStationLineAddress(station, 0, value->text, sizeof(value->text));
}

GETTER(getSecond)
{
    (void)row, (void)stats;
    plcStationLineAddress(station, 1, value->text, sizeof(value->text));
}

/* What becomes of a put, whatever the wire and the policy are. */
enum { putsNoOutput, putsPass, putsWait, putsLocal, putsMismatch, putsRefused, putsNone,
       putsUnknown };

static int putsSynced(const plcStats *stats)
{
    switch (stats->syncState) {
    case plcSyncSynced:
        return putsPass;
    case plcSyncLocal:
        return putsLocal;
    case plcSyncLayoutMismatch:
    case plcSyncMapMismatch:
        return putsMismatch;
    case plcSyncDisconnected:
        return putsNoOutput;
    default:
        return putsWait;
    }
}

GETTER(getSetpoints)
{
    plcFaults *faults = plcStationOutFaults(station);
    size_t size = plcStationOutSize(station);
    char why[PLC_REASON_SIZE];

    (void)row;
    if (size == 0)
        value->integer = putsNone;
    else if (plcStationHeader(station))
        value->integer = putsSynced(stats);
    else if (!stats->outputConnected)
        value->integer = putsNoOutput;
    else if (stats->state == plcStateLayout)
        value->integer = putsMismatch;
    else if (plcStationHeld(station))
        value->integer = putsWait;
    else if (faults && plcFaultsFind(faults, 0, size, NULL, why))
        value->integer = putsRefused;
    else if (!faults && !stats->alive && plcStationInSize(station))
        value->integer = putsUnknown; /* no wire tells, and the PLC shows no sign of life */
    else
        value->integer = putsPass;
}

/* --- Orders ------------------------------------------------------------------------------ */

GETTER(doReset)
{
    (void)row, (void)stats, (void)value;
    plcStationStatsReset(station);
}

GETTER(doSend)
{
    (void)row, (void)stats, (void)value;
    plcStationSend(station);
}

GETTER(getInSize)
{
    (void)row, (void)stats;
    value->integer = (epicsInt64)plcImageSize(plcStationInput(station));
}

GETTER(getOutSize)
{
    (void)row, (void)stats;
    value->integer = (epicsInt64)plcImageSize(plcStationOutput(station));
}

/* --- The table --------------------------------------------------------------------------*/

#define AT(member) offsetof(plcStats, member)

/* What they mean stands in docs/statistics.md. */
/* clang-format off */
const plcStatRow plcStatRows[] = {
    {"connected",         plcStatInteger, getInt,             AT(connected)},
    {"alive",             plcStatInteger, getInt,             AT(alive)},
    {"state",             plcStatInteger, getInt,             AT(state)},
    {"stateText",         plcStatText,    getStateText,       0},
    {"stateTime",         plcStatReal,    getAge,             AT(stateSince)},
    {"lostTime",          plcStatText,    getStamp,           AT(lostTime)},
    {"reason",            plcStatText,    getReason,          0},
    {"lastError",         plcStatText,    getText,            AT(lastError)},
    {"lastErrorTime",     plcStatText,    getStamp,           AT(lastErrorTime)},
    {"name",              plcStatText,    getName,            0},
    {"address",           plcStatText,    getAddress,         0},
    {"addressFirst",      plcStatText,    getFirst,           0},
    {"addressSecond",     plcStatText,    getSecond,          0},
    {"options",           plcStatText,    getOptions,         0},
    {"leader",            plcStatInteger, getInt,             AT(leader)},
    {"inSize",            plcStatInteger, getInSize,          0},
    {"outSize",           plcStatInteger, getOutSize,         0},
    {"burstSize",         plcStatInteger, getCount32,         AT(burstSize)},
    {"connectTime",       plcStatText,    getStamp,           AT(connectTime)},
    {"connectedFor",      plcStatReal,    getAge,             AT(connectedSince)},
    {"blockTime",         plcStatText,    getStamp,           AT(blockTime)},
    {"blockAge",          plcStatReal,    getAge,             AT(lastBlock)},
    {"heartbeatAge",      plcStatReal,    getAge,             AT(lastSend)},
    {"blocksIn",          plcStatInteger, getCount,           AT(blocksIn)},
    {"blocksOut",         plcStatInteger, getCount,           AT(blocksOut)},
    {"bytesIn",           plcStatInteger, getCount,           AT(bytesIn)},
    {"bytesOut",          plcStatInteger, getCount,           AT(bytesOut)},
    {"skipped",           plcStatInteger, getCount,           AT(skipped)},
    {"coalesced",         plcStatInteger, getCount,           AT(coalesced)},
    {"ignored",           plcStatInteger, getCount,           AT(ignored)},
    {"heartbeats",        plcStatInteger, getCount,           AT(heartbeats)},
    {"slowSends",         plcStatInteger, getCount,           AT(slowSends)},
    {"refusedWrites",     plcStatInteger, getCount,           AT(refusedWrites)},
    {"syncState",         plcStatInteger, getInt,             AT(syncState)},
    {"syncText",          plcStatText,    getSyncText,        0},
    {"syncTime",          plcStatReal,    getAge,             AT(syncSince)},
    {"remote",            plcStatInteger, getInt,             AT(remote)},
    {"syncs",             plcStatInteger, getCount,           AT(syncs)},
    {"syncsLost",         plcStatInteger, getCount,           AT(syncsLost)},
    {"layoutPlc",         plcStatInteger, getInt,             AT(layoutPlc)},
    {"layoutMismatches",  plcStatInteger, getCount,           AT(layoutMismatches)},
    {"readbacks",         plcStatInteger, getCount,           AT(readbacks)},
    {"doubts",            plcStatInteger, getCount,           AT(doubts)},
    {"outOfStep",         plcStatInteger, getCount,           AT(outOfStep)},
    {"mapState",          plcStatInteger, getInt,             AT(mapState)},
    {"mapText",           plcStatText,    getMapText,         0},
    {"mapReason",         plcStatText,    getText,            AT(mapReason)},
    {"mapProgress",       plcStatInteger, getInt,             AT(mapProgress)},
    {"mapCrc",            plcStatInteger, getCount32,         AT(mapCrc)},
    {"mapPlcCrc",         plcStatInteger, getCount32,         AT(mapPlcCrc)},
    {"mapDownloads",      plcStatInteger, getCount,           AT(mapDownloads)},
    {"mapRefusals",       plcStatInteger, getCount,           AT(mapRefusals)},
    {"sizeMismatches",    plcStatInteger, getCount,           AT(sizeMismatches)},
    {"connects",          plcStatInteger, getCount,           AT(connects)},
    {"reconnects",        plcStatInteger, getCount,           AT(disconnects)},
    {"connectErrors",     plcStatInteger, getCount,           AT(connectErrors)},
    {"setpoints",         plcStatInteger, getSetpoints,       0},
    {"outputConnected",   plcStatInteger, getInt,             AT(outputConnected)},
    {"putsWaiting",       plcStatInteger, getInt,             AT(putsWaiting)},
    {"putsDropped",       plcStatInteger, getCount,           AT(putsDropped)},
    {"requests",          plcStatInteger, getCount,           AT(requests)},
    {"exceptions",        plcStatInteger, getCount,           AT(exceptions)},
    {"refusedReads",      plcStatInteger, getInt,             AT(refusedReads)},
    {"requestTimeouts",   plcStatInteger, getCount,           AT(requestTimeouts)},
    {"requestLatency",    plcStatReal,    getReal,            AT(requestLatency)},
    {"requestLatencyMax", plcStatReal,    getReal,            AT(requestLatencyMax)},
    {"clockErrors",       plcStatInteger, getCount,           AT(clockErrors)},
    {"clockOffset",       plcStatReal,    getReal,            AT(clockOffset)},
    {"period",            plcStatReal,    getReal,            AT(periodLast)},
    {"periodMin",         plcStatReal,    getReal,            AT(periodMin)},
    {"periodMax",         plcStatReal,    getReal,            AT(periodMax)},
    {"periodMean",        plcStatReal,    getReal,            AT(periodMean)},
    {"jitter",            plcStatReal,    getReal,            AT(jitter)},
    {"sendLatency",       plcStatReal,    getReal,            AT(sendLatency)},
    {"sendLatencyMax",    plcStatReal,    getReal,            AT(sendLatencyMax)},
    {"scanLatency",       plcStatReal,    getReal,            AT(scanLatency)},
    {"scanLatencyMax",    plcStatReal,    getReal,            AT(scanLatencyMax)},
    {"periodHistogram",   plcStatArray,   NULL,               AT(periodHist)},
    {"latencyHistogram",  plcStatArray,   NULL,               AT(latencyHist)},
    {"histogramBins",     plcStatArray,   NULL,               0},
    {"reset",             plcStatOrder,   doReset,            0},
    {"send",              plcStatOrder,   doSend,             0},
    {NULL,                plcStatText,    NULL,               0},
};
/* clang-format on */

const plcStatRow *plcStatFind(const char *name, unsigned kinds)
{
    const plcStatRow *row;

    for (row = plcStatRows; row->name; row++)
        if (row->kind & kinds && epicsStrCaseCmp(row->name, name) == 0)
            return row;
    return NULL;
}

void plcStatNames(unsigned kinds, char *text, size_t size)
{
    const plcStatRow *row;
    size_t used = 0;

    text[0] = 0;
    for (row = plcStatRows; row->name; row++) {
        if (!(row->kind & kinds) || used + strlen(row->name) + 2 > size)
            continue;
        used += (size_t)epicsSnprintf(text + used, size - used, "%s%s", used ? " " : "",
                                      row->name);
    }
}

void plcStatGet(const plcStatRow *row, plcStation *station, plcStatValue *value)
{
    plcStats stats;

    memset(value, 0, sizeof(*value));
    plcStationStats(station, &stats);
    row->get(row, station, &stats, value);
    if (row->kind == plcStatInteger) {
        value->real = (double)value->integer;
        epicsSnprintf(value->text, sizeof(value->text), "%lld", (long long)value->integer);
    } else if (row->kind == plcStatReal) {
        value->integer = (epicsInt64)floor(value->real + 0.5);
        epicsSnprintf(value->text, sizeof(value->text), "%.6g", value->real);
    }
}

void plcStatDo(const plcStatRow *row, plcStation *station)
{
    plcStatValue value;

    row->get(row, station, NULL, &value);
}

size_t plcStatGetArray(const plcStatRow *row, plcStation *station, double *values,
                       size_t room)
{
    const epicsUInt32 *bins;
    plcStats stats;
    size_t i;

    plcStationStats(station, &stats);
    bins = row->field ? fieldOf(row, &stats) : NULL;
    for (i = 0; i < PLC_BINS && i < room; i++)
        values[i] = bins ? bins[i] : plcStatsBinStart((int)i);
    return i;
}
