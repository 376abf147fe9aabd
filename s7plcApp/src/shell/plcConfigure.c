/* Checks the arguments of a configure command; see plcConfigure.h. */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <errlog.h>

#include "plcBlocks.h"
#include "plcConfigure.h"
#include "plcLink.h"
#include "plcResolver.h"

static const plcNumberArg numbers[] = {
    {"port",         -1,   0,  65535,         0, "1 to 65535, or 0 without an address"},
    {"inSize",       -1,   0,  PLC_BLOCK_MAX, 0, "0 to 16777216 bytes"                },
    {"outSize",      -1,   0,  PLC_BLOCK_MAX, 0, "0 to 16777216 bytes"                },
    {"bigEndian",    0,    0,  1,             0, "0 (LSB first) or 1 (MSB first)"     },
    {.name = "recvTimeout"},
    {.name = "sendInterval"},
};
enum { port, inSize, outSize, bigEndian, recvTimeout, sendInterval };

plcStation *plcConfigureRefuse(const char *command, const char *name, const char *format, ...)
{
    char text[300];
    va_list args;

    va_start(args, format);
    epicsVsnprintf(text, sizeof(text), format, args);
    va_end(args);
    errlogSevPrintf(errlogMajor, "%s %.60s: %s\n", command, name ? name : "", text);
    return NULL;
}

void plcConfigureSharing(const char *command, plcStation *station, const char *advice)
{
    const char *other = plcStationSharing(station);

    if (other)
        errlogSevPrintf(errlogInfo, "%s %.60s: %.60s has the same host and port, and each makes a "
                        "connection of its own; %s\n", command, plcStationName(station), other,
                        advice);
}

static int isName(const char *name)
{
    size_t i;

    for (i = 0; name[i]; i++)
        if (name[i] == '/' || (unsigned char)name[i] <= ' ')
            return 0;
    return i > 0 && i <= PLC_NAME_MAX;
}

int plcConfigureIsNew(const char *command, const char *name)
{
    if (!name || !isName(name))
        plcConfigureRefuse(command, name, "PLCname is missing or wrong; allowed: 1 to %d characters "
               "without blank or '/'", PLC_NAME_MAX);
    else if (plcStationFind(name))
        plcConfigureRefuse(command, name, "this PLC is configured already; each name once");
    else
        return 1;
    return 0;
}

/* What the option of the same name may be, as an argument. */
static plcNumberArg optionArg(const char *option, char *allowed, size_t size)
{
    double min = 0, max = 0, initial = 0;
    plcNumberArg arg = {.name = option, .zeroMeansInitial = 1, .allowed = allowed};

    plcOptionsLimits(option, &min, &max, &initial);
    arg.min = (epicsInt32)min;
    arg.max = (epicsInt32)max;
    arg.initial = (epicsInt32)initial;
    epicsSnprintf(allowed, size, "%d to %d ms, or 0 for %d", (int)arg.min, (int)arg.max,
                  (int)arg.initial);
    return arg;
}

int plcConfigureNumber(const char *command, const char *name, const plcNumberArg *arg,
                  const char *text, epicsInt32 *value)
{
    char allowed[60];
    plcNumberArg option;

    if (!arg->allowed) {
        option = optionArg(arg->name, allowed, sizeof(allowed));
        arg = &option;
    }
    *value = arg->initial;
    if (!text && arg->initial >= 0)
        return 0;
    if (!text) {
        plcConfigureRefuse(command, name, "%s is missing; allowed: %s", arg->name, arg->allowed);
        return -1;
    }
    if (epicsParseInt32(text, value, 0, NULL)) {
        plcConfigureRefuse(command, name, "%s=%.60s is no number; allowed: %s", arg->name, text,
               arg->allowed);
        return -1;
    }
    if (*value == 0 && arg->initial > 0 && arg->zeroMeansInitial)
        *value = arg->initial;
    if (*value < arg->min || *value > arg->max) {
        plcConfigureRefuse(command, name, "%s=%.60s; allowed: %s", arg->name, text, arg->allowed);
        return -1;
    }
    return 0;
}

int plcConfigureAddress(const char *text, plcStationConfig *config,
                        char host[PLC_LINES_MAX][PLC_NAME_MAX + 1], const char **error)
{
    size_t length = strcspn(text, ",");
    unsigned lines = config->policy->lines;
    struct in_addr address;

    *error = PLC_HOST_ALLOWED;
    if (length > PLC_NAME_MAX || strlen(text) > length + 1 + PLC_NAME_MAX)
        return -1;
    epicsSnprintf(host[0], sizeof(host[0]), "%.*s", (int)length, text);
    epicsSnprintf(host[1], sizeof(host[1]), "%s", text[length] ? text + length + 1 : "");
    if (text[length] && (lines < 2 || !host[0][0] || !host[1][0])) {
        *error = lines < 2 ? "one address; two only with redundancy"
                           : "two addresses, FIRST,SECOND";
        return -1;
    }
    if (!plcAddressIsHost(host[0]) || !plcAddressIsHost(host[1]))
        return -1;
    if (lines > 1 && !text[length]) {
        strcpy(host[1], host[0]);
        config->plus[1] = 1;
        if (inet_pton(AF_INET, host[0], &address) == 1 && plcAddressPlus(&address, 1)) {
            *error = "the SECOND PLC would be at IPaddr+1 outside .1 to .254; give both: "
                     "\"FIRST,SECOND\"";
            return -1;
        }
    }
    config->address[0] = host[0];
    config->address[1] = host[1];
    return 0;
}

plcStation *plcConfigure(const char *command, const char *const args[8],
                         const plcPolicy *policy, void *policyPvt)
{
    const char *name = args[0], *address = args[1] ? args[1] : "", *error;
    char host[PLC_LINES_MAX][PLC_NAME_MAX + 1];
    plcStationConfig config = {.name = name, .policy = policy, .policyPvt = policyPvt,
                               .transport = &plcBlocks};
    epicsInt32 value[6];
    plcStation *station;
    int i;

    if (!plcConfigureIsNew(command, name))
        return NULL;
    if (plcConfigureAddress(address, &config, host, &error))
        return plcConfigureRefuse(command, name, "IPaddr \"%.60s\"; allowed: %s", address, error);
    for (i = 0; i < 6; i++)
        if (plcConfigureNumber(command, name, &numbers[i], args[i + 2], &value[i]))
            return NULL;
    if (address[0] && value[port] == 0)
        return plcConfigureRefuse(command, name, "port=0; allowed: %s", numbers[port].allowed);
    config.port = value[port];
    config.inSize = value[inSize];
    config.outSize = value[outSize];
    config.bigEndian = value[bigEndian];
    config.recvTimeout = value[recvTimeout];
    config.sendInterval = value[sendInterval];
    station = plcStationCreate(&config);
    if (station)
        plcConfigureSharing(command, station, "a PLC that takes one connection at a port needs a "
                                              "port for each");
    return station;
}
