/* simBlockServer: blocks over TCP as a server of a PLC: its keys and statements, what it
 * does in the cycle and with a block that came, and its commands. How bytes travel is
 * simBlockTcp's.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <cantProceed.h>

#include "simBlockServer.h"
#include "simCall.h"

#define HISTORY_BYTES (1024u * 1024) /* memory for received blocks */
#define HISTORY_BLOCKS 1000u

/* clang-format off */
static const simKey keys[] = {
#define AT(member) offsetof(simBlockKeys, member)
    {.name = "port", .kind = keyOrNone, .offset = AT(port), .max = 65535,
     .initial = "2000", .choices = "off",
     .help = "TCP port, 0 = any free one"},
    {.name = "clients", .kind = keyChoice, .offset = AT(keepFirst),
     .initial = "replace", .choices = "replace|keep",
     .help = "a second connection replaces the first, or is closed"},
    {.name = "sendwatchdog", .kind = keyTime, .offset = AT(sendWatchdog), .max = 3600,
     .initial = "10 s",
     .help = "a block that does not leave ends the connection, 0 = never"},
#undef AT
};
/* clang-format on */

static const simKeyTable keyTable = {keys, sizeof(keys) / sizeof(keys[0]),
                                     sizeof(simBlockKeys)};

/* ---- building ---- */

static void init(void *server, simPlc *plc)
{
    simBlockServer *blocks = server;
    size_t size = plc->config->out;
    size_t i;

    blocks->plc = plc;
    blocks->keys = simConfigValues(plc->config, &keyTable);
    blocks->historySize = size ? HISTORY_BYTES / size : 0;
    if (blocks->historySize > HISTORY_BLOCKS)
        blocks->historySize = HISTORY_BLOCKS;
    blocks->history =
        callocMustSucceed(blocks->historySize + 1, sizeof(simReceived), "simBlockServer");
    for (i = 0; i < blocks->historySize; i++)
        blocks->history[i].bytes = callocMustSucceed(1, size, "simBlockServer");
}

static void freeAll(void *server)
{
    simBlockServer *blocks = server;
    size_t i;

    for (i = 0; i < blocks->historySize; i++)
        free(blocks->history[i].bytes);
    free(blocks->history);
    free(blocks->mirrors);
}

static int sizeArg(const char *word, size_t *value)
{
    char *end;

    if (word[0] < '0' || word[0] > '9')
        return -1;
    *value = strtoul(word, &end, 0);
    return *end || *value > SIM_MAX_BLOCK ? -1 : 0;
}

static int addMirror(void *server, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    simBlockServer *blocks = server;
    const simConfig *config = blocks->plc->config;
    simMirror m;

    if (count != 4 || strcmp(words[2], "->") || sizeArg(words[0], &m.from) ||
        sizeArg(words[1], &m.length) || sizeArg(words[3], &m.to))
        return simFail(error,
                       "a mirror wants: <offset in out> <length> -> <offset in in>");
    if (config->sync)
        return simFail(error, "no mirror with sync = on: use tx and rx");
    if (m.length < 1 || m.from > config->out || m.length > config->out - m.from)
        return simFail(
            error, "mirror: %lu bytes at offset %lu are outside of the %lu bytes of out",
            (unsigned long)m.length, (unsigned long)m.from, (unsigned long)config->out);
    if (m.to > config->in || m.length > config->in - m.to)
        return simFail(
            error, "mirror: %lu bytes at offset %lu are outside of the %lu bytes of in",
            (unsigned long)m.length, (unsigned long)m.to, (unsigned long)config->in);
    blocks->mirrors = realloc(blocks->mirrors, (blocks->mirrorCount + 1) * sizeof(m));
    if (!blocks->mirrors)
        cantProceed("simBlockServer: out of memory");
    blocks->mirrors[blocks->mirrorCount++] = m;
    return 0;
}

static const simServerStatement statements[] = {
    {"mirror", 0, addMirror},
};

/* ---- the cycle ---- */

/* SEND watchdog: a block that does not leave ends the connection. */
static void watchSend(simBlockServer *blocks)
{
    simBlockTcp *tcp = &blocks->tcp;
    double watchdog = blocks->keys->sendWatchdog;
    double now = simNow();

    if (!simBlockTcpBusy(tcp) || tcp->counts.bytesSent != blocks->sentBytes ||
        tcp->faults.silence || tcp->faults.unplugged || tcp->faults.delay > 0) {
        blocks->sentBytes = tcp->counts.bytesSent;
        blocks->sentTime = now;
        return;
    }
    if (watchdog > 0 && now - blocks->sentTime > watchdog)
        simBlockTcpDrop(tcp, 1, "SEND watchdog: the IOC does not read");
}

static const epicsUInt8 *txBytes(const simBlockServer *blocks)
{
    return blocks->plc->tx ? blocks->plc->tx->bytes : NULL;
}

/* True while SEND does not take a block; the one that is due is counted as skipped. */
static int isBusy(simBlockServer *blocks)
{
    if (!simBlockTcpConnected(&blocks->tcp) || simBlockTcpReady(&blocks->tcp))
        return 0;
    if (!blocks->plc->passive)
        simBlockTcpSend(&blocks->tcp, txBytes(blocks));
    return 1;
}

static int cycle(void *server)
{
    simBlockServer *blocks = server;

    if (!blocks->open)
        return 0;
    watchSend(blocks);
    if (blocks->tcp.faults.flood && simBlockTcpConnected(&blocks->tcp))
        return 1;
    return isBusy(blocks);
}

static void onMade(void *server, int value)
{
    simBlockServer *blocks = server;

    (void)value;
    if (blocks->open && blocks->plc->tx)
        simBlockTcpSend(&blocks->tcp, txBytes(blocks));
}

/* ---- what the connection tells ---- */

static void onConnected(void *owner)
{
    simBlockServer *blocks = owner;

    blocks->plc->connected = 1;
    simPlcCall(blocks->plc, NULL);
}

static void onDisconnected(void *owner, const char *reason)
{
    simBlockServer *blocks = owner;

    (void)reason;
    blocks->plc->connected = 0;
    simPlcCall(blocks->plc, NULL);
}

static void remember(simBlockServer *blocks, const epicsUInt8 *block)
{
    simReceived *slot = &blocks->history[blocks->historyCount++ % blocks->historySize];

    slot->time = simNow();
    memcpy(slot->bytes, block, blocks->plc->config->out);
}

static void takeMirrors(simBlockServer *blocks)
{
    simPlc *plc = blocks->plc;
    size_t i;

    for (i = 0; i < blocks->mirrorCount; i++)
        memcpy(plc->tx->bytes + blocks->mirrors[i].to,
               plc->rx->bytes + blocks->mirrors[i].from, blocks->mirrors[i].length);
}

static void onReceived(void *owner, const epicsUInt8 *block)
{
    simBlockServer *blocks = owner;
    simPlc *plc = blocks->plc;

    remember(blocks, block);
    if (plc->passive) {
        blocks->ignored++;
        return;
    }
    simPlcCall(plc, block);
    if (!plc->local)
        takeMirrors(blocks);
    simPlcChanged(plc);
}

static void onWantBlock(void *owner)
{
    simBlockServer *blocks = owner;

    if (!isBusy(blocks))
        simPlcMake(blocks->plc);
}

static const simBlockTcpEvents tcpEvents = {onConnected, onDisconnected, onReceived,
                                            onWantBlock};

/* ---- opening, closing, and what happens to the PLC ---- */

static int openServer(void *server, const char *address, const void *like)
{
    simBlockServer *blocks = server;
    const simBlockServer *partner = like;
    const simPlc *plc = blocks->plc;
    unsigned port = partner ? ntohs(partner->tcp.listener.address.sin_port)
                            : (unsigned)blocks->keys->port;

    if (blocks->keys->port < 0)
        return 0;
    blocks->tcp.keepFirst = blocks->keys->keepFirst;
    blocks->tcp.receiveBuffer = plc->config->receiveBuffer;
    blocks->open = 1;
    if (simBlockTcpOpen(&blocks->tcp, plc->loop, plc->name, address, port,
                        plc->config->in, plc->config->out, &tcpEvents, blocks) == 0)
        return 0;
    return partner && blocks->keys->port == 0 ? 1 : -1;
}

static void closeServer(void *server)
{
    simBlockServer *blocks = server;

    if (blocks->open)
        simBlockTcpClose(&blocks->tcp);
    memset(&blocks->tcp, 0, sizeof(blocks->tcp));
    blocks->open = 0;
    blocks->plc->connected = 0;
}

static const char *address(const void *server)
{
    const simBlockServer *blocks = server;

    return blocks->open ? simBlockTcpAddress(&blocks->tcp) : NULL;
}

static void onLead(void *server, int lead)
{
    simBlockServer *blocks = server;

    if (blocks->open && !lead)
        simBlockTcpForget(&blocks->tcp);
}

static void onPower(void *server, int on)
{
    simBlockServer *blocks = server;

    if (blocks->open)
        simBlockTcpPower(&blocks->tcp, on);
}

static void onUnplug(void *server, int on)
{
    simBlockServer *blocks = server;

    if (blocks->open)
        simBlockTcpUnplug(&blocks->tcp, on);
}

static void onNormal(void *server, int value)
{
    simBlockServer *blocks = server;

    (void)value;
    if (blocks->open)
        simBlockTcpClearFaults(&blocks->tcp);
}

/* ---- looking ---- */

static void status(const void *server, simText *out)
{
    const simBlockServer *blocks = server;
    const simBlockTcp *tcp = &blocks->tcp;
    const simBlockTcpCounts *n = &tcp->counts;

    if (!blocks->open)
        return;
    simTextAdd(out, "blocks: listening on %s, in %lu bytes, out %lu bytes\n",
               simBlockTcpAddress(tcp), (unsigned long)tcp->inSize,
               (unsigned long)tcp->outSize);
    if (simBlockTcpConnected(tcp))
        simTextAdd(out, "client: %s for %.3f s\n", tcp->peer,
                   simNow() - tcp->connectTime);
    else
        simTextAdd(out, "client: none\n");
    simTextAdd(out, "connections: %llu\n", (unsigned long long)n->connections);
    simTextAdd(out, "sent: %llu blocks, %llu bytes, %llu skipped\n",
               (unsigned long long)n->blocksSent, (unsigned long long)n->bytesSent,
               (unsigned long long)n->blocksSkipped);
    simTextAdd(out, "received: %llu blocks, %llu bytes\n",
               (unsigned long long)n->blocksReceived,
               (unsigned long long)n->bytesReceived);
    if (blocks->ignored)
        simTextAdd(out, "ignored as BACKUP: %llu blocks\n",
                   (unsigned long long)blocks->ignored);
    simTextAdd(out, "faults:%s", blocks->plc->program.refuseSync ? " refuse-sync" : "");
    simBlockTcpFaultText(tcp, out);
    simTextAdd(out, "\n");
}

/* ---- commands ---- */

static simBlockServer *blocksOf(const simCall *c)
{
    return simPlcServerOf(c->plc, &simBlockServerType);
}

static simBlockTcp *tcp(const simCall *c)
{
    return &blocksOf(c)->tcp;
}

/* received: numbers and the last block. received n: the last n blocks, oldest first. */
static int doReceived(simCall *c)
{
    const simBlockServer *blocks = blocksOf(c);
    const simBlockTcpCounts *n = &blocks->tcp.counts;
    unsigned long wanted = 1;
    epicsUInt64 i;

    if (c->count && simCallNumber(c, 0, 1000000, &wanted))
        return -1;
    if (wanted > blocks->historySize)
        wanted = blocks->historySize;
    if (wanted > blocks->historyCount)
        wanted = (unsigned long)blocks->historyCount;
    simTextAdd(c->out, "blocks %llu bytes %llu partial %lu\n",
               (unsigned long long)n->blocksReceived,
               (unsigned long long)n->bytesReceived, (unsigned long)blocks->tcp.filled);
    for (i = blocks->historyCount - wanted; i < blocks->historyCount; i++) {
        const simReceived *block = &blocks->history[i % blocks->historySize];

        simTextAdd(c->out, "%llu %.6f ", (unsigned long long)i + 1, block->time);
        simTextHex(c->out, block->bytes, blocks->tcp.outSize);
        simTextAdd(c->out, "\n");
    }
    return 0;
}

static int doMirror(simCall *c)
{
    return addMirror(blocksOf(c), c->words, c->count, c->error);
}

static int doSilence(simCall *c)
{
    int on;

    if (simCallOnOff(c, &on))
        return -1;
    simBlockTcpSilence(tcp(c), on);
    return 0;
}

static int doRefuse(simCall *c)
{
    int sync = c->count && !strcasecmp(c->words[0], "sync");
    int on;

    c->words += sync;
    c->count -= (size_t)sync;
    if (simCallOnOff(c, &on))
        return -1;
    if (sync) {
        c->plc->program.refuseSync = on;
        return 0;
    }
    simBlockTcpRefuse(tcp(c), on);
    return 0;
}

static int doStall(simCall *c)
{
    int on;

    if (simCallOnOff(c, &on))
        return -1;
    simBlockTcpStall(tcp(c), on);
    return 0;
}

static int doFlood(simCall *c)
{
    int on;

    if (simCallOnOff(c, &on))
        return -1;
    simBlockTcpFlood(tcp(c), on);
    return 0;
}

static int doClose(simCall *c)
{
    simBlockTcpDrop(tcp(c), 0, "closed at the console");
    return 0;
}

static int doReset(simCall *c)
{
    simBlockTcpDrop(tcp(c), 1, "reset at the console");
    return 0;
}

static int doFragment(simCall *c)
{
    unsigned long bytes = 0;
    double pause = 1e-3;

    if (!simCallIsOff(c) && (simCallNumber(c, 0, SIM_MAX_BLOCK, &bytes) ||
                             (c->count > 1 && simCallTime(c, 1, 0, &pause))))
        return -1;
    simBlockTcpFragment(tcp(c), bytes, pause);
    return 0;
}

static int doDelay(simCall *c)
{
    double seconds = 0;

    if (!simCallIsOff(c) && simCallTime(c, 0, 0, &seconds))
        return -1;
    simBlockTcpDelay(tcp(c), seconds);
    return 0;
}

static int doTruncate(simCall *c)
{
    unsigned long bytes;

    if (simCallIsOff(c)) {
        tcp(c)->faults.truncate = -1;
        return 0;
    }
    if (simCallNumber(c, 0, 2 * SIM_MAX_BLOCK, &bytes))
        return -1;
    tcp(c)->faults.truncate = (long)bytes;
    return 0;
}

static int doCut(simCall *c)
{
    unsigned long bytes;

    if (simCallIsOff(c)) {
        tcp(c)->faults.cut = -1;
        return 0;
    }
    if (simCallNumber(c, 0, 1000000000, &bytes))
        return -1;
    if (bytes == 0)
        return doReset(c);
    tcp(c)->faults.cut = (long)bytes;
    return 0;
}

static int doGarbage(simCall *c)
{
    unsigned long bytes;

    if (simCallNumber(c, 0, 1000000, &bytes))
        return -1;
    if (simBlockTcpGarbage(tcp(c), bytes))
        return simCallFail(c, "no client, or too much is waiting to be sent");
    return 0;
}

/* clang-format off */
static const simCommand commands[] = {
    {.name = "received", .max = 1, .fn = doReceived, .usage = "[n]",
     .help = "number of blocks from the IOC and the last n"},
    {.name = "mirror", .min = 4, .max = 4, .fn = doMirror, .logged = 1,
     .usage = "<offset> <length> -> <offset>",
     .help = "one more read-back, as in the file"},
    {.name = "silence", .max = 1, .fn = doSilence, .logged = 1, .usage = "[on|off]",
     .help = "send nothing"},
    {.name = "close", .fn = doClose, .logged = 1, .usage = "",
     .help = "end the connection with FIN"},
    {.name = "reset", .fn = doReset, .logged = 1, .usage = "",
     .help = "end the connection with RST"},
    {.name = "refuse", .max = 2, .fn = doRefuse, .logged = 1,
     .usage = "[sync] [on|off]", .help = "refuse new connections, or SYNC"},
    {.name = "stall", .max = 1, .fn = doStall, .logged = 1, .usage = "[on|off]",
     .help = "read nothing"},
    {.name = "fragment", .min = 1, .max = 2, .fn = doFragment, .logged = 1,
     .usage = "<bytes> [ms] | off", .help = "send in pieces, ms apart"},
    {.name = "delay", .min = 1, .max = 1, .fn = doDelay, .logged = 1,
     .usage = "<ms> | off", .help = "each block leaves ms late"},
    {.name = "truncate", .min = 1, .max = 1, .fn = doTruncate, .logged = 1,
     .usage = "<bytes> | off", .help = "send blocks of another size"},
    {.name = "garbage", .min = 1, .max = 1, .fn = doGarbage, .logged = 1,
     .usage = "<bytes>", .help = "send random bytes once"},
    {.name = "cut", .min = 1, .max = 1, .fn = doCut, .logged = 1,
     .usage = "<bytes> | off", .help = "reset the connection after so many bytes came"},
    {.name = "flood", .max = 1, .fn = doFlood, .logged = 1, .usage = "[on|off]",
     .help = "send as fast as the socket takes"},
};
/* clang-format on */

const simServerType simBlockServerType = {
    .title = "",
    .off = "this PLC sends no blocks: port in the file switches them on",
    .keys = &keyTable,
    .statements = statements,
    .statementCount = sizeof(statements) / sizeof(statements[0]),
    .commands = commands,
    .commandCount = sizeof(commands) / sizeof(commands[0]),
    .size = sizeof(simBlockServer),
    .init = init,
    .open = openServer,
    .close = closeServer,
    .free = freeAll,
    .address = address,
    .cycle = cycle,
    .on = {[simMade] = onMade,
           [simLead] = onLead,
           [simPower] = onPower,
           [simUnplug] = onUnplug,
           [simNormal] = onNormal},
    .status = status,
};
