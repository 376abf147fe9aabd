/* simModbusServer: Modbus as a server of a PLC: its keys, its statement and its command.
 * What they do is done elsewhere.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <strings.h>

#include "simCall.h"
#include "simModbusServer.h"

/* clang-format off */
static const simKey keys[] = {
#define AT(member) offsetof(simModbusKeys, member)
    {.name = "modbus_port", .kind = keyOrNone, .offset = AT(port), .max = 65535,
     .initial = "off", .choices = "off", .help = "Modbus/TCP port, 0 = any free one"},
    {.name = "modbus_unit", .kind = keyOrNone, .offset = AT(unit), .max = 255,
     .initial = "1", .choices = "any",
     .help = "unit id that is answered"},
    {.name = "modbus_otherunit", .kind = keyChoice, .offset = AT(gateway),
     .initial = "silence", .choices = "silence|exception",
     .help = "what a request for another unit gets: nothing, or exception 11"},
#undef AT
};
/* clang-format on */

static const simKeyTable keyTable = {keys, sizeof(keys) / sizeof(keys[0]),
                                     sizeof(simModbusKeys)};

/* ---- building ---- */

static void init(void *server, simPlc *plc)
{
    simModbusServer *s = server;

    s->plc = plc;
    s->keys = simConfigValues(plc->config, &keyTable);
    s->modbus.unit = s->keys->unit;
    s->modbus.gateway = s->keys->gateway;
    simMapInit(&s->modbus.map, &plc->memory);
}

static void freeAll(void *server)
{
    simModbusServer *s = server;

    simMapFree(&s->modbus.map);
}

static int addArea(void *server, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    simModbusServer *s = server;

    return simMapStatement(&s->modbus.map, words, count, error);
}

static const simServerStatement statements[] = {
    {"modbus", 0, addArea},
};

static int check(void *server, simText *out)
{
    const simModbusServer *s = server;
    const simConfig *config = s->plc->config;
    const char *problem = NULL;

    if (s->keys->port >= 0 && config->role != simSingle)
        problem = "Modbus is for one PLC: modbus_port needs role = single";
    else if (s->keys->port < 0 && s->modbus.map.count)
        problem = "there are modbus areas, but modbus_port = off";
    if (!problem)
        return 0;
    simTextAdd(out, "%s: %s\n", config->file, problem);
    return 1;
}

/* ---- opening, closing, and what happens to the PLC ---- */

static int openServer(void *server, const char *address, const void *like)
{
    simModbusServer *s = server;

    (void)like; /* a pair has no Modbus */
    if (s->keys->port < 0)
        return 0;
    s->modbus.clients.listener.receiveBuffer = s->plc->config->receiveBuffer;
    return simModbusOpen(&s->modbus, s->plc->loop, s->plc->name, address,
                         (unsigned)s->keys->port);
}

static void closeServer(void *server)
{
    simModbusServer *s = server;

    simModbusClose(&s->modbus);
}

static const char *address(const void *server)
{
    const simModbusServer *s = server;

    return simClientsAddress(&s->modbus.clients);
}

static void onPower(void *server, int on)
{
    simModbusServer *s = server;

    simClientsPower(&s->modbus.clients, on);
}

static void onUnplug(void *server, int on)
{
    simModbusServer *s = server;

    simClientsUnplug(&s->modbus.clients, on);
}

static void onNormal(void *server, int value)
{
    simModbusServer *s = server;

    (void)value;
    simModbusFaultsClear(&s->modbus.faults);
    simClientsRefuse(&s->modbus.clients, 0);
}

static void status(const void *server, simText *out)
{
    const simModbusServer *s = server;

    simModbusStatus(&s->modbus, out);
}

/* ---- commands ---- */

static simModbus *modbusOf(const simCall *c)
{
    simModbusServer *s = simPlcServerOf(c->plc, &simModbusServerType);

    return &s->modbus;
}

/* modbus received [n] */
static int modbusReceived(simCall *c)
{
    unsigned long wanted = 1;

    if (c->count > 1 && simCallNumber(c, 1, 1000000, &wanted))
        return -1;
    simModbusReceived(modbusOf(c), wanted, c->out);
    return 0;
}

static int modbusRefuse(simCall *c)
{
    return simCallRefuse(c, &modbusOf(c)->clients);
}

static int modbusClose(simCall *c)
{
    return simCallClose(c, &modbusOf(c)->clients);
}

static int modbusNormal(simCall *c)
{
    onNormal(simPlcServerOf(c->plc, &simModbusServerType), 0);
    return 0;
}

static int modbusClear(simCall *c)
{
    simModbusClearCounts(modbusOf(c));
    return 0;
}

static int modbusHelp(simCall *c)
{
    simTextAdd(c->out,
               "  received [n]       the last n requests\n"
               "  clear              counts begin anew\n"
               "  close, reset       all connections end now, with FIN or RST\n"
               "  refuse [on|off]    new connections get RST\n"
               "  normal             all faults end\n"
               "  <fault> off        that fault ends\n"
               "  <fault> [filter] [next n], where a fault is\n"
               "    exception <code>       busy [n]       slow <ms>      silent\n"
               "    short <bytes> [close]  close reply    wrongunit      wrongid\n"
               "    garbage <bytes>\n"
               "  and a filter says which requests it meets:\n"
               "    read  write  function <n>  <table> [<first> [count]]\n"
               "    with holding, input, coils, discrete for <table>\n");
    return 0;
}

static const simCallWord words[] = {
    {"help",     1, modbusHelp,     0},
    {"received", 2, modbusReceived, 0},
    {"clear",    1, modbusClear,    0},
    {"refuse",   2, modbusRefuse,   1},
    {"close",    1, modbusClose,    1},
    {"reset",    1, modbusClose,    1},
    {"normal",   1, modbusNormal,   1},
};

/* Without a word: the status. The rest are faults. */
static int doModbus(simCall *c)
{
    simModbus *modbus = modbusOf(c);
    int status;

    if (!c->count) {
        simModbusStatus(modbus, c->out);
        return 0;
    }
    status = simCallWords(c, "modbus", words, sizeof(words) / sizeof(words[0]));
    if (status != SIM_NO_WORD)
        return status;
    if (!simModbusFaultKnown(c->words[0]))
        return simCallFail(c,
                           "\"%.40s\": allowed are exception, busy, slow, silent, "
                           "wrongunit, wrongid, short, close, garbage, reset, refuse, "
                           "normal, received, clear, help",
                           c->words[0]);
    simCallLog(c, "modbus");
    return simModbusFaultParse(&modbus->faults, c->words, c->count, c->error);
}

static const simCommand commands[] = {
    {.name = "modbus", .max = SIM_MAX_WORDS, .fn = doModbus, .usage = "[<word> ...]",
     .help = "Modbus: its status; faults and more: modbus help"},
};

const simServerType simModbusServerType = {
    .title = "Modbus",
    .off = "this PLC has no Modbus: modbus_port in the file switches it on",
    .keys = &keyTable,
    .statements = statements,
    .statementCount = sizeof(statements) / sizeof(statements[0]),
    .commands = commands,
    .commandCount = sizeof(commands) / sizeof(commands[0]),
    .size = sizeof(simModbusServer),
    .init = init,
    .check = check,
    .open = openServer,
    .close = closeServer,
    .free = freeAll,
    .address = address,
    .on = {[simPower] = onPower, [simUnplug] = onUnplug, [simNormal] = onNormal},
    .status = status,
};
