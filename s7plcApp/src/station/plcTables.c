/* The pointer tables in the PLC, IOC side; see plcTables.h. */
#include <string.h>

#include <epicsStdio.h>

#include "plcCodec.h"
#include "plcSync.h"
#include "plcPointers.h"
#include "plcTables.h"

/* Blocks of the PLC without a change of its status, after which we begin anew: 10 s at
 * 100 ms. And so many times we do it on one connection. */
#define UNCHANGED_MAX 100
#define ATTEMPTS 3

/* clang-format off */
static const char *const stateNames[] = {
    [plcTablesDisconnected] = "disconnected",
    [plcTablesWaiting]      = "waiting",
    [plcTablesFixed]        = "fixed tables",
    [plcTablesEqual]        = "equal",
    [plcTablesMismatch]     = "map mismatch",
    [plcTablesBeginning]    = "beginning",
    [plcTablesLoading]      = "loading",
    [plcTablesCommitting]   = "PLC checks",
    [plcTablesRefused]      = "refused",
};
/* clang-format on */

static const struct {
    int error;
    const char *text;
} errors[] = {
    {0,  ""                                       },
    {1,  "no pointer to 1 to 1024 bytes"          },
    {2,  "area is neither DB nor M"               },
    {3,  "not on a byte boundary"                 },
    {4,  "no such data block"                     },
    {5,  "memory that the PLC does not allow"     },
    {6,  "beyond the end of the data block"       },
    {7,  "source and destination differ in length"},
    {8,  "not in the data of IE_TX or IE_RX"      },
    {9,  "bytes that another row has too"         },
    {10, "a setpoint that no TX row shows"        },
    {20, "nobody has begun this"                  },
    {21, "a part is missing"                      },
    {22, "a part is too long"                     },
    {23, "the table is incomplete"                },
    {24, "the CRC is wrong"                       },
    {25, "unknown command"                        },
    {26, "the PLC's tables are locked"            },
    {27, "PLC in LOCAL"                           },
    {28, "more rows than the PLC has"             },
    {29, "no part for 5 s"                        },
};

#define ERRORS (sizeof(errors) / sizeof(errors[0]))
#define ERROR_SESSION 20
#define ERROR_LOCKED 26
#define ERROR_LOCAL 27

const char *plcTablesStateName(int state)
{
    return state >= 0 && state <= plcTablesRefused ? stateNames[state] : "?";
}

/* Of an error that a PLC tells (byte 6). */
static const char *errorText(int error)
{
    size_t i;

    for (i = 0; i < ERRORS; i++)
        if (errors[i].error == error)
            return errors[i].text;
    return "unknown error";
}

void plcTablesInit(plcTables *t, plcMapMode mode, const epicsUInt8 *table, size_t size,
                   size_t outSize)
{
    memset(t, 0, sizeof(*t));
    t->mode = mode;
    t->table = table;
    t->size = size;
    t->crc = table ? plcPointersCrc(table, size) : 0;
    t->piece = outSize - PLC_TABLES_PIECE;
}

static void become(plcTables *t, plcTablesState state, const char *reason)
{
    t->state = state;
    t->command = 0;
    epicsSnprintf(t->reason, sizeof(t->reason), "%s", reason);
}

void plcTablesConnected(plcTables *t)
{
    t->attempts = 0;
    become(t, plcTablesWaiting, "no block yet");
}

void plcTablesLost(plcTables *t)
{
    become(t, plcTablesDisconnected, "PLC not connected");
}

static unsigned number(const epicsUInt8 *bytes, size_t size, int bigEndian)
{
    return (unsigned)plcGetInt(plcTypeOf(plcUnsigned, size), bytes, bigEndian);
}

static void readStatus(plcTablesStatus *status, const epicsUInt8 *b, int bigEndian)
{
    memset(status, 0, sizeof(*status));
    status->version = b[4];
    status->state = b[5];
    status->error = b[6];
    status->row = b[7];
    status->crc = number(b + 8, 4, bigEndian);
    status->expected = number(b + 12, 2, bigEndian);
    status->session = b[14];
    status->rows = b[15] * 8;
}

/* The PLC works with our table. */
static int isOurs(const plcTables *t, const plcTablesStatus *plc)
{
    return plc->version == 1 && t->table && plc->state != plcMapNone &&
           plc->crc == t->crc;
}

int plcTablesSame(const plcTables *t, const void *block, int bigEndian)
{
    const epicsUInt8 *b = block;
    plcTablesStatus plc;

    if (t->mode == plcMapOff || !(b[0] & plcFlagMap))
        return 1;
    readStatus(&plc, b, bigEndian);
    return isOurs(t, &plc);
}

static unsigned rowsOf(const plcTables *t)
{
    return (unsigned)((t->size - PLC_TABLE_HEAD) / PLC_TABLE_ROW);
}

/* Begins a download, or says why not. */
static void begin(plcTables *t)
{
    if (!t->table) {
        become(t, plcTablesMismatch, "the IOC has no table: s7plcTables");
    } else if (t->mode != plcMapDownload) {
        become(t, plcTablesMismatch, "the PLC has another table");
    } else if (!t->remote) {
        become(t, plcTablesMismatch, "another table; PLC in LOCAL");
        t->attempts = 0; /* people count their own */
    } else if (t->plc.rows == 0) {
        become(t, plcTablesMismatch, "another table; the PLC's are locked");
        t->attempts = 0;
    } else if (rowsOf(t) > (unsigned)t->plc.rows) {
        become(t, plcTablesMismatch, "");
        epicsSnprintf(t->reason, sizeof(t->reason), "table of %u rows, the PLC has %d",
                      rowsOf(t), t->plc.rows);
    } else if (t->attempts >= ATTEMPTS) {
        if (t->state != plcTablesMismatch)
            t->command = plcTablesAbort;
        t->state = plcTablesMismatch;
        epicsSnprintf(t->reason, sizeof(t->reason), "the download does not end");
    } else {
        become(t, plcTablesBeginning, "table is being downloaded");
        t->attempts++;
        t->unchanged = 0;
        t->done = t->length = 0;
        t->session = t->plc.session % 255 + 1;
        t->command = plcTablesBegin;
    }
}

/* The next part, or COMMIT behind the last. */
static void goOn(plcTables *t)
{
    size_t rest = t->size - t->done;

    t->length = (unsigned)(rest < t->piece ? rest : t->piece);
    t->state = rest ? plcTablesLoading : plcTablesCommitting;
    t->command = rest ? plcTablesPart : plcTablesCommit;
}

static void refused(plcTables *t)
{
    const char *text = errorText(t->plc.error);

    become(t, plcTablesRefused, text);
    if (t->plc.error > 0 && t->plc.error < 20)
        epicsSnprintf(t->reason, sizeof(t->reason), "row %d: %s", t->plc.row, text);
}

/* The PLC answered to something of our session, while a download runs. */
static void answer(plcTables *t)
{
    if (t->plc.state == plcMapRefused && t->plc.error == ERROR_SESSION) {
        begin(t); /* it had dropped what it had before our command came: key, LOCAL, restart */
    } else if (t->plc.state == plcMapRefused) {
        refused(t);
    } else if (t->plc.state == plcMapChecking && t->state == plcTablesCommitting) {
        ; /* it takes its time */
    } else if (t->plc.state != plcMapLoading) {
        begin(t); /* it has dropped what it had */
    } else if (t->state == plcTablesBeginning && t->plc.expected == 0) {
        goOn(t);
    } else if (t->state == plcTablesLoading && t->plc.expected == t->done + t->length) {
        t->done += t->length;
        goOn(t);
    } else if (t->plc.expected != t->done) {
        begin(t);
    }
}

/* One block of a PLC while a download runs. */
static void download(plcTables *t, int changed)
{
    t->unchanged = changed ? 0 : t->unchanged + 1;
    if (!t->remote)
        begin(t); /* which waits for REMOTE */
    else if (t->plc.session == t->session)
        answer(t);
    else if (t->state != plcTablesBeginning)
        begin(t); /* another one loads, or the PLC has restarted */
    if (t->unchanged >= UNCHANGED_MAX)
        begin(t);
}

/* LOCAL and a key switch end by themselves; what was wrong with a table does not. */
static int mayTryAgain(const plcTables *t)
{
    return t->state != plcTablesRefused || t->plc.error == ERROR_LOCAL ||
           t->plc.error == ERROR_LOCKED;
}

int plcTablesBlock(plcTables *t, const void *block, int bigEndian)
{
    const plcTablesStatus before = t->plc;
    const epicsUInt8 *b = block;

    if (t->mode == plcMapOff || t->state == plcTablesDisconnected)
        return 1;
    if (!(b[0] & plcFlagMap)) {
        become(t, plcTablesFixed, "");
        return 1;
    }
    readStatus(&t->plc, b, bigEndian);
    t->remote = (b[0] & plcFlagRemote) != 0;
    if (t->plc.version != 1) {
        become(t, plcTablesMismatch, "");
        epicsSnprintf(t->reason, sizeof(t->reason), "tables of version %d, known: 1",
                      t->plc.version);
    } else if (isOurs(t, &t->plc)) {
        become(t, plcTablesEqual, "");
        t->attempts = 0;
        return 1;
    } else if (t->state >= plcTablesBeginning && t->state <= plcTablesCommitting) {
        download(t, memcmp(&t->plc, &before, sizeof(before)) != 0);
    } else if (mayTryAgain(t)) {
        begin(t);
    }
    return 0;
}

static void put(epicsUInt8 *bytes, size_t size, int bigEndian, epicsUInt32 value)
{
    plcPutInt(plcTypeOf(plcUnsigned, size), bytes, bigEndian, value);
}

int plcTablesPack(plcTables *t, void *block, int bigEndian)
{
    epicsUInt8 *b = block;

    if (!t->command)
        return 0;
    memset(b + 4, 0, PLC_TABLES_PIECE - 4 + t->piece);
    b[4] = (epicsUInt8)t->command;
    b[5] = (epicsUInt8)t->session;
    if (t->command == plcTablesPart) {
        put(b + 6, 2, bigEndian, t->done);
        put(b + 8, 2, bigEndian, t->length);
        memcpy(b + PLC_TABLES_PIECE, t->table + t->done, t->length);
    } else if (t->command == plcTablesCommit) {
        put(b + PLC_TABLES_PIECE, 4, bigEndian, t->crc);
    }
    t->command = 0;
    return plcFlagTable;
}

int plcTablesProgress(const plcTables *t)
{
    if (t->state == plcTablesEqual)
        return 100;
    if (t->state != plcTablesLoading && t->state != plcTablesCommitting)
        return 0;
    return (int)(t->done * 99 / t->size);
}
