/* Checks the arguments of a configure command; see plcConfigure.h. */
#include <ctype.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <errlog.h>

#include "plcConfigure.h"
#include "plcLink.h"
#include "plcResolver.h"

/* A number among the arguments. A missing one has its initial value; where that is -1, it
 * must be given. A time is the option of the same name: without `allowed` that table says
 * what it may be. */
typedef struct numberArg {
    const char *name;
    epicsInt32 initial, min, max;
    int zeroMeansInitial;
    const char *allowed;
} numberArg;

static const numberArg numbers[] = {
    {"port",         -1,   0,  65535,         0, "1 to 65535, or 0 without an address"},
    {"inSize",       -1,   0,  PLC_BLOCK_MAX, 0, "0 to 16777216 bytes"                },
    {"outSize",      -1,   0,  PLC_BLOCK_MAX, 0, "0 to 16777216 bytes"                },
    {"bigEndian",    0,    0,  1,             0, "0 (LSB first) or 1 (MSB first)"     },
    {.name = "recvTimeout"},
    {.name = "sendInterval"},
};
enum { port, inSize, outSize, bigEndian, recvTimeout, sendInterval };

static const numberArg modbusPort = {"port", 502, 1, 65535, 1, "1 to 65535, or 0 for 502"};
static const numberArg unit = {"unit", 1, 0, 255, 0, "0 to 255"};
static const numberArg startRegister = {"startRegister", -1, 0, 65535, 0,
                                        "0 to 65535, the first register is 0"};
static const numberArg requestTimeout = {.name = "requestTimeout"};

static plcStation *refuse(const char *command, const char *name, const char *format, ...)
{
    char text[300];
    va_list args;

    va_start(args, format);
    epicsVsnprintf(text, sizeof(text), format, args);
    va_end(args);
    errlogSevPrintf(errlogMajor, "%s %.60s: %s\n", command, name ? name : "", text);
    return NULL;
}

static int isName(const char *name)
{
    size_t i;

    for (i = 0; name[i]; i++)
        if (name[i] == '/' || (unsigned char)name[i] <= ' ')
            return 0;
    return i > 0 && i <= PLC_NAME_MAX;
}

/* True for a name that a new station may have; else after the error line. */
static int isNew(const char *command, const char *name)
{
    if (!name || !isName(name))
        refuse(command, name, "PLCname is missing or wrong; allowed: 1 to %d characters "
               "without blank or '/'", PLC_NAME_MAX);
    else if (plcStationFind(name))
        refuse(command, name, "this PLC is configured already; each name once");
    else
        return 1;
    return 0;
}

/* A host is characters of names and addresses; the resolver says whether it exists. */
static int isHost(const char *host)
{
    size_t i;

    for (i = 0; host[i]; i++)
        if (!isalnum((unsigned char)host[i]) && !strchr(".-_", host[i]))
            return 0;
    return i <= PLC_NAME_MAX;
}

/* What the option of the same name may be, as an argument. */
static numberArg optionArg(const char *option, char *allowed, size_t size)
{
    double min = 0, max = 0, initial = 0;
    numberArg arg = {.name = option, .zeroMeansInitial = 1, .allowed = allowed};

    plcOptionsLimits(option, &min, &max, &initial);
    arg.min = (epicsInt32)min;
    arg.max = (epicsInt32)max;
    arg.initial = (epicsInt32)initial;
    epicsSnprintf(allowed, size, "%d to %d ms, or 0 for %d", (int)arg.min, (int)arg.max,
                  (int)arg.initial);
    return arg;
}

/* A whole number, or its initial value when it is missing. Returns 0, or -1 after the error
 * line. */
static int number(const char *command, const char *name, const numberArg *arg,
                  const char *text, epicsInt32 *value)
{
    char allowed[60];
    numberArg option;

    if (!arg->allowed) {
        option = optionArg(arg->name, allowed, sizeof(allowed));
        arg = &option;
    }
    *value = arg->initial;
    if (!text && arg->initial >= 0)
        return 0;
    if (!text) {
        refuse(command, name, "%s is missing; allowed: %s", arg->name, arg->allowed);
        return -1;
    }
    if (epicsParseInt32(text, value, 0, NULL)) {
        refuse(command, name, "%s=%.60s is no number; allowed: %s", arg->name, text,
               arg->allowed);
        return -1;
    }
    if (*value == 0 && arg->initial > 0 && arg->zeroMeansInitial)
        *value = arg->initial;
    if (*value < arg->min || *value > arg->max) {
        refuse(command, name, "%s=%.60s; allowed: %s", arg->name, text, arg->allowed);
        return -1;
    }
    return 0;
}

/* Splits "first,second" and checks both. Returns 0, or -1 with *error. */
static int splitAddress(const char *text, plcStationConfig *config,
                        char host[PLC_LINKS_MAX][PLC_NAME_MAX + 1], const char **error)
{
    size_t length = strcspn(text, ",");
    unsigned links = config->policy->links;
    struct in_addr address;

    *error = "host name or dotted IP address";
    if (length > PLC_NAME_MAX || strlen(text) > length + 1 + PLC_NAME_MAX)
        return -1;
    epicsSnprintf(host[0], sizeof(host[0]), "%.*s", (int)length, text);
    epicsSnprintf(host[1], sizeof(host[1]), "%s", text[length] ? text + length + 1 : "");
    if (text[length] && (links < 2 || !host[0][0] || !host[1][0])) {
        *error = links < 2 ? "one address; two only with redundancy"
                           : "two addresses, FIRST,SECOND";
        return -1;
    }
    if (!isHost(host[0]) || !isHost(host[1]))
        return -1;
    if (links > 1 && !text[length]) {
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
    char host[PLC_LINKS_MAX][PLC_NAME_MAX + 1];
    plcStationConfig config = {.name = name, .policy = policy, .policyPvt = policyPvt};
    epicsInt32 value[6];
    int i;

    if (!isNew(command, name))
        return NULL;
    if (splitAddress(address, &config, host, &error))
        return refuse(command, name, "IPaddr \"%.60s\"; allowed: %s", address, error);
    for (i = 0; i < 6; i++)
        if (number(command, name, &numbers[i], args[i + 2], &value[i]))
            return NULL;
    if (address[0] && value[port] == 0)
        return refuse(command, name, "port=0; allowed: %s", numbers[port].allowed);
    config.port = value[port];
    config.inSize = value[inSize];
    config.outSize = value[outSize];
    config.bigEndian = value[bigEndian];
    config.recvTimeout = value[recvTimeout];
    config.sendInterval = value[sendInterval];
    return plcStationCreate(&config);
}

/* --- Modbus/TCP ---------------------------------------------------------------------------*/

/* Parses the two texts with ranges. Returns 0, or -1 after the error line. */
static int ranges(const char *command, const char *name, const char *const text[2],
                  plcWire *wire, size_t size[2])
{
    static const char *const what[] = {"inputs", "outputs"};
    plcRange *found[2] = {NULL, NULL};
    char error[300] = "";
    int count[2] = {0, 0}, i;

    for (i = 0; i < 2 && !error[0]; i++) {
        count[i] = plcRangesParse(text[i], i, &found[i], &size[i], error, sizeof(error));
        if (count[i] >= 0 && size[i] > PLC_BLOCK_MAX)
            epicsSnprintf(error, sizeof(error), "up to byte %lu; allowed: to 16777216",
                          (unsigned long)size[i]);
        if (error[0])
            refuse(command, name, "%s: %s", what[i], error);
    }
    if (!error[0] && count[0] + count[1] == 0)
        refuse(command, name, "neither inputs nor outputs; allowed: \"table start count [at "
               "offset] [every ms], ...\" with table holding, input, coils or discrete");
    if (error[0] || count[0] + count[1] == 0) {
        free(found[0]);
        free(found[1]);
        return -1;
    }
    wire->inputs = found[0];
    wire->inputCount = (unsigned)count[0];
    wire->outputs = found[1];
    wire->outputCount = (unsigned)count[1];
    return 0;
}

plcStation *plcConfigureModbus(const char *command, const char *const args[7])
{
    const char *name = args[0], *address = args[1] ? args[1] : "", *error;
    char host[PLC_LINKS_MAX][PLC_NAME_MAX + 1], text[12], why[200];
    plcStationConfig config = {.name = name, .policy = &plcSingle, .bigEndian = 1,
                               .recvTimeout = 2000, .sendInterval = 1000};
    plcWire wire = {0};
    epicsInt32 port, timeout;
    size_t size[2];
    plcStation *station;

    if (!isNew(command, name))
        return NULL;
    if (splitAddress(address, &config, host, &error))
        return refuse(command, name, "IPaddr \"%.60s\"; allowed: %s", address, error);
    if (number(command, name, &modbusPort, args[2], &port) ||
        number(command, name, &unit, args[3], &wire.unit) ||
        number(command, name, &requestTimeout, args[6], &timeout) ||
        ranges(command, name, args + 4, &wire, size))
        return NULL;
    config.port = port;
    config.inSize = size[0];
    config.outSize = size[1];
    config.modbus = &wire;
    station = plcStationCreate(&config);
    sprintf(text, "%d", (int)timeout);
    plcStationSetOption(station, "requestTimeout", text, why, sizeof(why));
    return station;
}

int plcConfigureModbusOutput(const char *command, const char *const args[5])
{
    const char *name = args[0], *address = args[1] ? args[1] : "";
    plcStation *station = name ? plcStationFind(name) : NULL;
    plcWire wire = {0};
    epicsInt32 port, start;
    size_t size;
    char error[200];

    if (!station) {
        refuse(command, name, "no such PLC; s7plcConfigure comes first");
        return -1;
    }
    if (!isHost(address)) {
        refuse(command, name, "IPaddr \"%.60s\"; allowed: host name or dotted IP address, or "
               "\"\" for that of the PLC", address);
        return -1;
    }
    if (number(command, name, &modbusPort, args[2], &port) ||
        number(command, name, &unit, args[3], &wire.unit) ||
        number(command, name, &startRegister, args[4], &start))
        return -1;
    size = plcStationOutSize(station);
    if (size == 0 || size % 2 || start + size / 2 > 65536) {
        refuse(command, name, "outSize is %lu, startRegister %d; allowed: whole registers of "
               "2 bytes, from 0 to 65535", (unsigned long)size, (int)start);
        return -1;
    }
    wire.outputs = callocMustSucceed(1, sizeof(*wire.outputs), command);
    wire.outputs->table = plcHolding;
    wire.outputs->start = (unsigned)start;
    wire.outputs->count = (unsigned)size / 2;
    wire.outputCount = 1;
    if (plcStationModbusOutput(station, address, port, &wire, error, sizeof(error)) == 0)
        return 0;
    free(wire.outputs);
    refuse(command, name, "%s", error);
    return -1;
}
