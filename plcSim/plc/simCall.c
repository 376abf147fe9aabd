/* simCall: one call of a console command: its arguments.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <ctype.h>
#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <strings.h>

#include "simCall.h"

int simCallFail(simCall *c, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    vsnprintf(c->error, sizeof(c->error), format, args);
    va_end(args);
    return -1;
}

int simCallOnOff(simCall *c, int *on)
{
    *on = 1;
    if (c->count == 0)
        return 0;
    if (c->count == 1 && !strcasecmp(c->words[0], "on"))
        return 0;
    *on = 0;
    if (c->count == 1 && !strcasecmp(c->words[0], "off"))
        return 0;
    return simCallFail(c, "allowed is on or off");
}

int simCallNumber(simCall *c, size_t index, unsigned long max, unsigned long *value)
{
    char *end;

    *value = 0;
    if (index >= c->count)
        return simCallFail(c, "a number is missing");
    errno = 0;
    *value = strtoul(c->words[index], &end, 10);
    if (!isdigit((unsigned char)c->words[index][0]) || *end || errno || *value > max)
        return simCallFail(c, "\"%.40s\": allowed is a number 0 ... %lu", c->words[index],
                           max);
    return 0;
}

int simCallTime(simCall *c, size_t index, double min, double *seconds)
{
    if (index >= c->count)
        return simCallFail(c, "a time in ms is missing");
    if (simTimeParse(c->words[index], seconds, c->error))
        return -1;
    if (*seconds < min || *seconds > 3600)
        return simCallFail(c, "%.40s: allowed is %g ms ... 1 h", c->words[index],
                           min * 1e3);
    return 0;
}

int simCallIsOff(const simCall *c)
{
    return c->count == 1 && !strcasecmp(c->words[0], "off");
}

simPlc *simCallPlcByNumber(simulator *sim, unsigned long number)
{
    int i;

    if (!sim->isPair)
        return number == 1 ? &sim->plc[0] : NULL;
    for (i = 0; i < sim->count; i++)
        if (sim->pair[i].isFirst == (number == 1))
            return &sim->plc[i];
    return NULL;
}

simPlc *simCallPlc(simCall *c)
{
    unsigned long number;
    simPlc *plc;

    if (!c->count)
        return c->plc;
    if (simCallNumber(c, 0, 2, &number))
        return NULL;
    plc = number ? simCallPlcByNumber(c->sim, number) : NULL;
    if (!plc)
        simCallFail(c, "PLC %lu is not in this process", number);
    return plc;
}

void simCallLog(const simCall *c, const char *name)
{
    simText text = {NULL, 0, 0};
    size_t i;

    for (i = 0; i < c->count; i++)
        simTextAdd(&text, " %s", c->words[i]);
    simLog(c->plc->name, "> %s%.200s", name, text.text ? text.text : "");
    simTextFree(&text);
}

int simCallWords(simCall *c, const char *command, const simCallWord *rows, size_t count)
{
    size_t i;

    for (i = 0; i < count; i++) {
        if (strcasecmp(c->words[0], rows[i].name) || c->count > rows[i].max)
            continue;
        if (rows[i].logged)
            simCallLog(c, command);
        return rows[i].fn(c);
    }
    return SIM_NO_WORD;
}

int simCallRefuse(simCall *c, simClients *clients)
{
    int on;

    c->words++;
    c->count--;
    if (simCallOnOff(c, &on))
        return -1;
    simClientsRefuse(clients, on);
    return 0;
}

int simCallClose(simCall *c, simClients *clients)
{
    simClientsDrop(clients, !strcasecmp(c->words[0], "reset"), "ended at the console");
    return 0;
}
