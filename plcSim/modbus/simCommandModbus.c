/* simCommandModbus: the console command `modbus`. What it does is done elsewhere.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <strings.h>

#include "simCall.h"

/* modbus received [n] */
static int modbusReceived(simCall *c)
{
    unsigned long wanted = 1;

    if (c->count > 1 && simCallNumber(c, 1, 1000000, &wanted))
        return -1;
    simModbusReceived(&c->plc->modbus, wanted, c->out);
    return 0;
}

static int modbusRefuse(simCall *c)
{
    int on;

    c->words++;
    c->count--;
    if (simCallOnOff(c, &on))
        return -1;
    simModbusRefuse(&c->plc->modbus, on);
    return 0;
}

static int modbusClose(simCall *c)
{
    simModbusDrop(&c->plc->modbus, !strcasecmp(c->words[0], "reset"),
                  "ended at the console");
    return 0;
}

int simModbusNormal(simCall *c)
{
    simModbusFaultsClear(&c->plc->modbus.faults);
    simModbusRefuse(&c->plc->modbus, 0);
    return 0;
}

static int modbusClear(simCall *c)
{
    simModbusClearCounts(&c->plc->modbus);
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

static const struct modbusCommand {
    const char *name;
    size_t max; /* words, with the name */
    simCommandFn fn;
    int logged;
} commands[] = {
    {"help",     1, modbusHelp,      0},
    {"received", 2, modbusReceived,  0},
    {"clear",    1, modbusClear,     0},
    {"refuse",   2, modbusRefuse,    1},
    {"close",    1, modbusClose,     1},
    {"reset",    1, modbusClose,     1},
    {"normal",   1, simModbusNormal, 1},
};

/* Without a word: the status. The rest are faults. */
int simDoModbus(simCall *c)
{
    simModbus *modbus = &c->plc->modbus;
    size_t i;

    if (!modbus->loop)
        return simCallFail(
            c, "this PLC has no Modbus: modbus_port in the file switches it on");
    if (!c->count) {
        simModbusStatus(modbus, c->out);
        return 0;
    }
    for (i = 0; i < sizeof(commands) / sizeof(commands[0]); i++) {
        if (strcasecmp(c->words[0], commands[i].name) || c->count > commands[i].max)
            continue;
        if (commands[i].logged)
            simCallLog(c, "modbus");
        return commands[i].fn(c);
    }
    if (!simModbusFaultKnown(c->words[0]))
        return simCallFail(c,
                           "\"%.40s\": allowed are exception, busy, slow, silent, "
                           "wrongunit, wrongid, short, close, garbage, reset, refuse, "
                           "normal, received, clear, help",
                           c->words[0]);
    simCallLog(c, "modbus");
    return simModbusFaultParse(&modbus->faults, c->words, c->count, c->error);
}
