/* The PLC's table of pointers: between the step function (plcTables) and the station:
 * which states others see, log, counters, the row's name in a refusal.
 *
 * Knows nothing of sockets. All functions but plcStationSetTable run in the station's
 * thread.
 */
#include <string.h>

#include <epicsAtomic.h>
#include <epicsStdio.h>
#include <errlog.h>

#include "plcStationPvt.h"

int plcStationSetTable(plcStation *s, plcPointers *table)
{
    if (s->started)
        return -1;
    plcPointersFree(s->table);
    s->table = table;
    return 0;
}

/* The layout id comes with the table. */
static void takeLayout(plcStation *s)
{
    unsigned layout = plcPointersLayout(s->table);
    char text[100];

    if (s->now.layout && s->now.layout != layout) {
        epicsSnprintf(text, sizeof(text),
                      "option layout is %.0f, the table has %u, which "
                      "counts",
                      s->now.layout, layout);
        plcStationLog(s, errlogMajor, text);
    }
    plcSyncInit(&s->sync, (epicsUInt16)layout);
}

void plcTablesStart(plcStation *s)
{
    const plcPointers *table = s->table;

    plcTablesInit(&s->tables, s->now.map, table ? table->bytes : NULL,
                  table ? table->size : 0, s->outSize);
    if (s->now.map == plcMapOff)
        return;
    if (table)
        takeLayout(s);
    else
        plcStationLog(s, errlogMajor,
                      "option map is set, and there is no table: s7plcTables");
    epicsMutexMustLock(s->lock);
    s->stats.mapCrc = s->tables.crc;
    epicsMutexUnlock(s->lock);
}

/* Why, with the name that the table's file gives to a row. */
static void reasonText(const plcStation *s, char *text, size_t size)
{
    const plcTables *t = &s->tables;
    const char *name = "";

    if (s->table && t->state == plcTablesRefused && t->plc.error < 20)
        name = plcPointersRowName(s->table, t->plc.row);
    epicsSnprintf(text, size, name[0] ? "%s: %.60s" : "%s", t->reason, name);
}

static void logState(plcStation *s, int state, const char *reason)
{
    int bad = state == plcTablesRefused || state == plcTablesMismatch;
    char text[PLC_TEXT_SIZE + 60];

    epicsSnprintf(text, sizeof(text), "table of pointers: %s%s%s",
                  plcTablesStateName(state), reason[0] ? ": " : "", reason);
    plcStationLog(s, bad ? errlogMajor : errlogInfo, text);
}

/* The one place where the state of the tables shows to others. */
static void show(plcStation *s)
{
    const plcTables *t = &s->tables;
    char reason[PLC_TEXT_SIZE];
    int before, changed;

    reasonText(s, reason, sizeof(reason));
    epicsMutexMustLock(s->lock);
    before = s->stats.mapState;
    changed = before != (int)t->state || strcmp(s->stats.mapReason, reason);
    s->stats.mapState = t->state;
    s->stats.mapProgress = plcTablesProgress(t);
    s->stats.mapPlcCrc = t->plc.crc;
    s->stats.mapDownloads += before == plcTablesCommitting && t->state == plcTablesEqual;
    s->stats.mapRefusals += before != plcTablesRefused && t->state == plcTablesRefused;
    memcpy(s->stats.mapReason, reason, sizeof(reason));
    epicsMutexUnlock(s->lock);
    if (changed && t->state != plcTablesLoading && t->state != plcTablesWaiting)
        logState(s, t->state, reason);
}

void plcTablesLeader(plcStation *s)
{
    if (s->now.map == plcMapOff)
        return;
    if (s->leader >= 0)
        plcTablesConnected(&s->tables);
    else
        plcTablesLost(&s->tables);
    show(s);
}

int plcTablesLook(plcStation *s, const void *block)
{
    plcTables *t = &s->tables;
    int good;

    if (s->now.map == plcMapOff)
        return 1;
    /* Before PINI is over nothing may leave, so that nothing is begun. */
    good = epicsAtomicGetIntT(&s->running) ? plcTablesBlock(t, block, s->bigEndian)
                                           : plcTablesSame(t, block, s->bigEndian);
    show(s);
    if (!good)
        plcSyncMap(&s->sync, block,
                   t->state >= plcTablesBeginning && t->state <= plcTablesCommitting);
    return good;
}
