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

/* A wire that acknowledges goes somewhere when it has answered: a server that accepts
 * connections and is silent would else be connected for a second, again and again. */
static int putsGo(plcStation *station, const plcStats *stats)
{
    return stats->outputConnected &&
           !(plcStationOutFaults(station) && plcStationHeld(station));
}

GETTER(getOutputConnected)
{
    (void)row;
    value->integer = putsGo(station, stats);
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
    else if (!putsGo(station, stats))
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

/* clang-format off */
const plcStatRow plcStatRows[] = {
    {"connected",        plcStatInteger, getInt,       AT(connected),       "",
     "1 while TCP to the PLC is up"},
    {"alive",            plcStatInteger, getInt,       AT(alive),           "",
     "1 while the data of the PLC is valid"},
    {"state",            plcStatInteger, getInt,       AT(state),           "",
     "0 no address, 1 connecting, 2 waiting for data, 3 ok, 4 wrong size, 5 frozen, "
     "6 no PRIMARY, 7 layout mismatch, 8 some reads refused, 9 reads refused"},
    {"stateText",        plcStatText,    getStateText, 0,                   "",
     "the same in words"},
    {"stateTime",        plcStatReal,    getAge,       AT(stateSince),      "s",
     "how long it has been in this state"},
    {"lostTime",         plcStatText,    getStamp,     AT(lostTime),        "",
     "when valid data was last lost; empty: never"},
    {"reason",           plcStatText,    getReason,    0,                   "",
     "why the data, or some of it, is not valid; empty while all is"},
    {"lastError",        plcStatText,    getText,      AT(lastError),       "",
     "why the connection was lost or not made the last time"},
    {"lastErrorTime",    plcStatText,    getStamp,     AT(lastErrorTime),   "",
     "when that was"},
    {"name",             plcStatText,    getName,      0,                   "",
     "name of the PLC"},
    {"address",          plcStatText,    getAddress,   0,                   "",
     "host:port"},
    {"addressFirst",     plcStatText,    getFirst,     0,                   "",
     "the same, of the FIRST of a pair; of a single PLC its address"},
    {"addressSecond",    plcStatText,    getSecond,    0,                   "",
     "of the SECOND of a pair; empty: there is none"},
    {"options",          plcStatText,    getOptions,   0,                   "",
     "options that are not at their default"},
    {"leader",           plcStatInteger, getInt,       AT(leader),          "",
     "of a pair: 0 FIRST, 1 SECOND, -1 none"},
    {"inSize",           plcStatInteger, getInSize,    0,                   "bytes",
     "size of a block PLC -> IOC"},
    {"outSize",          plcStatInteger, getOutSize,   0,                   "bytes",
     "size of a block IOC -> PLC"},
    {"burstSize",        plcStatInteger, getCount32,   AT(burstSize),       "bytes",
     "what the PLC seems to send at a time; 0: inSize is right"},
    {"connectTime",      plcStatText,    getStamp,     AT(connectTime),     "",
     "when the connection was made"},
    {"connectedFor",     plcStatReal,    getAge,       AT(connectedSince),  "s",
     "how long the connection has lasted; 0: not connected"},
    {"blockTime",        plcStatText,    getStamp,     AT(blockTime),       "",
     "time stamp of the last block"},
    {"blockAge",         plcStatReal,    getAge,       AT(lastBlock),       "s",
     "time since the last block came; 0: none yet"},
    {"heartbeatAge",     plcStatReal,    getAge,       AT(lastSend),        "s",
     "time since the last block left; 0: none yet"},
    {"blocksIn",         plcStatInteger, getCount,     AT(blocksIn),        "",
     "whole blocks received"},
    {"blocksOut",        plcStatInteger, getCount,     AT(blocksOut),       "",
     "whole blocks sent"},
    {"bytesIn",          plcStatInteger, getCount,     AT(bytesIn),         "bytes",
     "bytes received"},
    {"bytesOut",         plcStatInteger, getCount,     AT(bytesOut),        "bytes",
     "bytes sent"},
    {"skipped",          plcStatInteger, getCount,     AT(skipped),         "",
     "blocks of a backlog that a newer one replaced"},
    {"coalesced",        plcStatInteger, getCount,     AT(coalesced),       "",
     "blocks that came while records were still busy with the one before"},
    {"ignored",          plcStatInteger, getCount,     AT(ignored),         "",
     "blocks of a PLC that does not lead"},
    {"heartbeats",       plcStatInteger, getCount,     AT(heartbeats),      "",
     "blocks sent although nothing had changed"},
    {"slowSends",        plcStatInteger, getCount,     AT(slowSends),       "",
     "blocks that had to wait, because the PLC had not taken the one before"},
    {"refusedWrites",    plcStatInteger, getCount,     AT(refusedWrites),   "",
     "puts that were refused"},
    {"syncState",        plcStatInteger, getInt,       AT(syncState),       "",
     "sync handshake: 0 disconnected, 1 waiting, 2 checking, 3 synced, 4 LOCAL, "
     "5 layout mismatch, 6 map mismatch, 7 map download"},
    {"syncText",         plcStatText,    getSyncText,  0,                   "",
     "the same in words"},
    {"syncTime",         plcStatReal,    getAge,       AT(syncSince),       "s",
     "how long the handshake has been in this state"},
    {"remote",           plcStatInteger, getInt,       AT(remote),          "",
     "1 REMOTE, 0 LOCAL: who has control, as the PLC last said"},
    {"syncs",            plcStatInteger, getCount,     AT(syncs),           "",
     "times the PLC agreed to our values"},
    {"syncsLost",        plcStatInteger, getCount,     AT(syncsLost),       "",
     "times that ended: HMI, LOCAL, watchdog, restart, connection"},
    {"layoutPlc",        plcStatInteger, getInt,       AT(layoutPlc),       "",
     "layout id that the PLC last showed, in the header or at layoutAt; 0: none"},
    {"layoutMismatches", plcStatInteger, getCount,     AT(layoutMismatches), "",
     "times the layout ids of PLC and IOC were found to differ"},
    {"readbacks",        plcStatInteger, getCount,     AT(readbacks),       "",
     "times an output took the PLC's value"},
    {"doubts",           plcStatInteger, getCount,     AT(doubts),          "",
     "times bytes came where no block begins; nothing was taken until it was clear why"},
    {"outOfStep",        plcStatInteger, getCount,     AT(outOfStep),       "",
     "times bytes were lost or came too many, and the connection was made anew"},
    {"mapState",         plcStatInteger, getInt,       AT(mapState),        "",
     "table of pointers: 0 disconnected, 1 waiting, 2 fixed tables, 3 equal, 4 map mismatch, "
     "5 beginning, 6 loading, 7 PLC checks, 8 refused"},
    {"mapText",          plcStatText,    getMapText,   0,                   "",
     "the same in words"},
    {"mapReason",        plcStatText,    getText,      AT(mapReason),       "",
     "why the PLC does not work with our table; empty when it does"},
    {"mapProgress",      plcStatInteger, getInt,       AT(mapProgress),     "%",
     "how much of our table the PLC has; 100: it works with it"},
    {"mapCrc",           plcStatInteger, getCount32,   AT(mapCrc),          "",
     "CRC-32 of our table; 0: there is none"},
    {"mapPlcCrc",        plcStatInteger, getCount32,   AT(mapPlcCrc),       "",
     "CRC-32 of the table that the PLC works with; 0: none"},
    {"mapDownloads",     plcStatInteger, getCount,     AT(mapDownloads),    "",
     "tables that the PLC took from us"},
    {"mapRefusals",      plcStatInteger, getCount,     AT(mapRefusals),     "",
     "tables that it refused"},
    {"sizeMismatches",   plcStatInteger, getCount,     AT(sizeMismatches),  "",
     "times the block size was found wrong"},
    {"connects",         plcStatInteger, getCount,     AT(connects),        "",
     "connections made"},
    {"reconnects",       plcStatInteger, getCount,     AT(disconnects),     "",
     "connections lost; each is made again"},
    {"connectErrors",    plcStatInteger, getCount,     AT(connectErrors),   "",
     "attempts to connect that failed"},
    {"setpoints",        plcStatInteger, getSetpoints, 0,                   "",
     "what becomes of puts: 0 no output, 1 they pass, 2 they wait for the PLC, 3 LOCAL, "
     "4 layout or map mismatch, 5 the PLC has refused some, 6 there are none, "
     "7 not known: connected, but no valid data comes"},
    {"outputConnected",  plcStatInteger, getOutputConnected, 0,             "",
     "1 while outputs go somewhere; over another wire that may be another connection"},
    {"putsWaiting",      plcStatInteger, getInt,       AT(putsWaiting),     "",
     "puts that wait for the PLC to take them, over a wire that acknowledges"},
    {"putsDropped",      plcStatInteger, getCount,     AT(putsDropped),     "",
     "puts that were overtaken by a newer one of their place, because too many waited"},
    {"requests",         plcStatInteger, getCount,     AT(requests),        "",
     "requests sent"},
    {"exceptions",       plcStatInteger, getCount,     AT(exceptions),      "",
     "requests that the PLC refused"},
    {"refusedReads",     plcStatInteger, getInt,       AT(refusedReads),    "",
     "registers, bits or tags that the PLC refuses to show now"},
    {"requestTimeouts",  plcStatInteger, getCount,     AT(requestTimeouts), "",
     "requests that were not answered in time"},
    {"requestLatency",   plcStatReal,    getReal,      AT(requestLatency),  "ms",
     "from a request to its answer, the last"},
    {"requestLatencyMax", plcStatReal,   getReal,      AT(requestLatencyMax), "ms",
     "the longest"},
    {"clockErrors",      plcStatInteger, getCount,     AT(clockErrors),     "",
     "blocks whose PLC clock showed no valid date"},
    {"clockOffset",      plcStatReal,    getReal,      AT(clockOffset),     "s",
     "PLC clock minus IOC clock (option timestamp)"},
    {"period",           plcStatReal,    getReal,      AT(periodLast),      "ms",
     "from block to block, the last"},
    {"periodMin",        plcStatReal,    getReal,      AT(periodMin),       "ms",
     "the shortest"},
    {"periodMax",        plcStatReal,    getReal,      AT(periodMax),       "ms",
     "the longest"},
    {"periodMean",       plcStatReal,    getReal,      AT(periodMean),      "ms",
     "the mean"},
    {"jitter",           plcStatReal,    getReal,      AT(jitter),          "ms",
     "standard deviation of the period"},
    {"sendLatency",      plcStatReal,    getReal,      AT(sendLatency),     "ms",
     "from the first put to the block's last byte in the kernel, the last"},
    {"sendLatencyMax",   plcStatReal,    getReal,      AT(sendLatencyMax),  "ms",
     "the longest"},
    {"scanLatency",      plcStatReal,    getReal,      AT(scanLatency),     "ms",
     "from a block to the end of its I/O Intr pass, the last"},
    {"scanLatencyMax",   plcStatReal,    getReal,      AT(scanLatencyMax),  "ms",
     "the longest"},
    {"periodHistogram",  plcStatArray,   NULL,         AT(periodHist),      "",
     "blocks in each bin of the period"},
    {"latencyHistogram", plcStatArray,   NULL,         AT(latencyHist),     "",
     "passes in each bin of scanLatency"},
    {"histogramBins",    plcStatArray,   NULL,         0,                   "ms",
     "where each bin of the histograms begins: their x axis"},
    {"reset",            plcStatOrder,   doReset,      0,                   "",
     "counters and measured times begin anew"},
    {"send",             plcStatOrder,   doSend,       0,                   "",
     "the output block leaves now, changed or not"},
    {NULL,               plcStatText,    NULL,         0,                   NULL, NULL},
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
