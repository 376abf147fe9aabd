/* simProgram: the program in the PLC that talks to EPICS: IE_COMMS, CHECKSYNC, PACK_TX_DB
 * and UNPACK_RX_DB, named as in the paper of the Canadian Light Source. It works on PLC
 * memory and knows nothing of sockets, files or consoles.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>

#include "simProgram.h"
#include "simTransfers.h"
#include "simValue.h"

/* ---- life ---- */

int simProgramInit(simProgram *program, unsigned txPtrsDb, unsigned rxPtrsDb,
                   char error[SIM_ERROR_SIZE])
{
    size_t size = program->rx ? program->rx->size : 1;

    program->accepted = callocMustSucceed(1, size, "simProgramInit");
    program->remote = 1;
    if (program->sync && (!program->tx || program->tx->size < SIM_HEADER ||
                          !program->rx || program->rx->size < SIM_HEADER))
        return simFail(error, "with sync = on, in and out need %d bytes at least",
                       SIM_HEADER);
    if (program->tables.rows && !program->sync)
        return simFail(error, "map = on needs sync = on");
    if (program->tables.rows % 8)
        return simFail(error, "map_rows is a multiple of 8");
    if (program->pack.pairCount + program->unpack.pairCount > program->tables.rows &&
        program->tables.rows)
        return simFail(error, "more pairs of pointers than map_rows");
    return simTransfersInit(program, txPtrsDb, rxPtrsDb, error);
}

void simProgramFree(simProgram *program)
{
    simTransfersFree(program);
    simTablesFree(&program->tables);
    free(program->accepted);
}

/* ---- the four functions ---- */

int CHECKSYNC(simProgram *program, epicsUInt8 *setpoints)
{
    if (program->refuseSync) {
        strcpy(program->difference, "refused at the console");
        return 0;
    }
    return simTransfersSame(program, setpoints);
}

static void packHeader(simProgram *program)
{
    epicsUInt8 *tx = program->tx->bytes;

    if (!program->counterFrozen)
        program->counter++;
    tx[0] = (epicsUInt8)((program->synced ? SIM_TX_SYNC : 0) |
                         (program->remote ? SIM_TX_REMOTE : 0) |
                         (program->timedOut ? SIM_TX_TIMEOUT : 0));
    tx[1] = program->counter;
    simPutInt(tx + 2, 2, program->memory->bigEndian, program->layout);
    if (program->tables.rows) {
        tx[0] |= SIM_TX_MAP;
        simTablesPack(&program->tables);
    }
}

void PACK_TX_DB(simProgram *program)
{
    simTransfersCopy(program, &program->pack);
    if (program->sync)
        packHeader(program);
}

void UNPACK_RX_DB(simProgram *program)
{
    simTransfersCopy(program, &program->unpack);
    memcpy(program->accepted, program->rx->bytes, program->rx->size);
    program->counts.unpacked++;
}

/* The one place where SYNC changes. */
static void setSync(simProgram *program, int synced, const char *reason)
{
    if (program->synced == synced)
        return;
    program->synced = synced;
    if (synced) {
        program->counts.syncs++;
        program->timedOut = 0;
        program->difference[0] = 0;
    } else {
        program->counts.syncsLost++;
    }
    simLog(program->name, "%s: %s", synced ? "SYNC" : "SYNC falls", reason);
}

static void interfere(simProgram *program, simPoint point)
{
    if (program->interfere)
        program->interfere(program->arg, point);
}

/* Layouts are compared when both sides have one. */
static int layoutDiffers(simProgram *program)
{
    unsigned theirs =
        (unsigned)simGetInt(program->rx->bytes + 2, 2, program->memory->bigEndian);
    int wrong = program->layout && theirs && theirs != program->layout;

    if (wrong && !program->layoutWrong)
        simComplain(program->name, "layout of the IOC is 0x%04x, of the PLC 0x%04x",
                    theirs, program->layout);
    program->layoutWrong = wrong;
    program->counts.layoutErrors += (epicsUInt64)wrong;
    return wrong;
}

/* In each cycle: SYNC stands only in REMOTE, and while the setpoints are those that were
 * last accepted. Whoever else moves one ends it, so that no block with the old value can
 * undo that. */
static void watchSetpoints(simProgram *program)
{
    if (!program->sync || !program->synced)
        return;
    if (!program->remote)
        setSync(program, 0, "LOCAL");
    else if (!CHECKSYNC(program, program->accepted))
        setSync(program, 0, "a setpoint was moved in the PLC");
}

static void check(simProgram *program)
{
    char last[sizeof(program->difference)];

    strcpy(last, program->difference);
    program->counts.checks++;
    if (CHECKSYNC(program, program->rx->bytes)) {
        memcpy(program->accepted, program->rx->bytes, program->rx->size);
        interfere(program, pointCheck);
        setSync(program, 1, "the IOC holds the PLC's values");
        return;
    }
    program->counts.checksFailed++;
    if (strcmp(last, program->difference))
        simLog(program->name, "CHECKSYNC: %s", program->difference);
    setSync(program, 0, "the IOC asked for a check that failed");
}

static void receive(simProgram *program, const epicsUInt8 *block)
{
    epicsUInt8 flags = block[0];

    if (program->tables.rows && !simTablesReady(&program->tables))
        return;
    if (!program->sync) {
        if (program->remote)
            UNPACK_RX_DB(program);
        return;
    }
    interfere(program, pointReceive);
    watchSetpoints(program);
    if (layoutDiffers(program))
        setSync(program, 0, "layouts differ");
    else if (flags & SIM_RX_CHECK && program->remote)
        check(program);
    else if (flags & SIM_RX_DATA && program->synced)
        UNPACK_RX_DB(program);
    else if (flags & SIM_RX_DATA)
        program->counts.ignored++;
}

static void takeInputs(simProgram *program, const simInputs *in)
{
    program->remote = in->remote;
    if (in->connected == program->connected)
        return;
    program->connected = in->connected;
    program->lastBlock = in->now;
    setSync(program, 0, in->connected ? "a new connection" : "the connection is gone");
}

static void watch(simProgram *program, double now)
{
    if (!program->sync || program->watchdog <= 0 || !program->connected ||
        now - program->lastBlock < program->watchdog)
        return;
    if (!program->timedOut) {
        program->counts.watchdogs++;
        simLog(program->name, "RECEIVE watchdog: no block from the IOC for %g s",
               program->watchdog);
    }
    setSync(program, 0, "RECEIVE watchdog");
    program->timedOut = 1;
}

/* The tables, before anything that needs them. Returns 1 when the block was for them. */
static int loadTables(simProgram *program, const simInputs *inputs, int reset)
{
    simTablesInputs in = {inputs->now, 0, reset, inputs->remote};

    if (!program->tables.rows || inputs->passive)
        return 0;
    in.table = inputs->received && inputs->received[0] & SIM_RX_TABLE;
    simTablesStep(&program->tables, &in);
    program->layout = simTablesLayout(&program->tables);
    if (!simTablesReady(&program->tables))
        setSync(program, 0, "the table of pointers is not ready");
    return in.table;
}

void IE_COMMS(simProgram *program, const simInputs *inputs)
{
    int edge = inputs->connected != program->connected, taken;

    takeInputs(program, inputs);
    if (inputs->received && program->rx) {
        program->lastBlock = inputs->now;
        memcpy(program->rx->bytes, inputs->received, program->rx->size);
    }
    taken = loadTables(program, inputs, edge);
    if (inputs->received && program->rx && !taken)
        receive(program, inputs->received);
    watch(program, inputs->now);
    watchSetpoints(program);
    if (inputs->send && program->tx)
        PACK_TX_DB(program);
}

void simProgramRestart(simProgram *program)
{
    setSync(program, 0, "PLC restart");
    program->timedOut = 0;
    program->connected = 0;
    program->counter = 0;
    program->layoutWrong = 0;
    program->difference[0] = 0;
    simTablesRestart(&program->tables);
}

void simProgramStatus(const simProgram *program, simText *out)
{
    const simProgramCounts *n = &program->counts;

    if (program->pack.table || program->unpack.table)
        simTextAdd(out, "pointers: %s, %llu errors\n",
                   program->pack.retVal || program->unpack.retVal ? "bad" : "good",
                   (unsigned long long)n->pointerErrors);
    if (!program->sync)
        return;
    if (program->tables.rows)
        simTablesStatus(&program->tables, out);
    simTextAdd(out, "sync: %s%s%s\n", program->synced ? "SYNC" : "none",
               program->timedOut ? ", TIMEOUT" : "",
               program->layoutWrong ? ", layouts differ" : "");
    simTextAdd(out,
               "checks: %llu, %llu failed; syncs: %llu, %llu lost; watchdogs: %llu; "
               "layout errors: %llu\n",
               (unsigned long long)n->checks, (unsigned long long)n->checksFailed,
               (unsigned long long)n->syncs, (unsigned long long)n->syncsLost,
               (unsigned long long)n->watchdogs, (unsigned long long)n->layoutErrors);
    simTextAdd(out, "taken: %llu blocks, %llu ignored\n", (unsigned long long)n->unpacked,
               (unsigned long long)n->ignored);
    if (program->difference[0])
        simTextAdd(out, "CHECKSYNC: %s\n", program->difference);
}
