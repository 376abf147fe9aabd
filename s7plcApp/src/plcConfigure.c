/* Checks the arguments of a configure command; see plcConfigure.h. */
#include <ctype.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <errlog.h>

#include "plcConfigure.h"
#include "plcLink.h"
#include "plcResolver.h"

/* The six numbers among the arguments. A missing one has its initial value; where that is
 * -1, it must be given. */
static const struct {
    const char *name;
    epicsInt32 initial, min, max;
    const char *allowed;
} numbers[] = {
    {"port",         -1,   0,  65535,         "1 to 65535, or 0 without an address"},
    {"inSize",       -1,   0,  PLC_BLOCK_MAX, "0 to 16777216 bytes"                },
    {"outSize",      -1,   0,  PLC_BLOCK_MAX, "0 to 16777216 bytes"                },
    {"bigEndian",    0,    0,  1,             "0 (LSB first) or 1 (MSB first)"     },
    {"recvTimeout",  2000, 10, 3600000,       "10 to 3600000 ms, or 0 for 2000"    },
    {"sendInterval", 1000, 1,  3600000,       "1 to 3600000 ms, or 0 for 1000"     },
};
enum { port, inSize, outSize, bigEndian, recvTimeout, sendInterval };

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

/* A host is characters of names and addresses; the resolver says whether it exists. */
static int isHost(const char *host)
{
    size_t i;

    for (i = 0; host[i]; i++)
        if (!isalnum((unsigned char)host[i]) && !strchr(".-_", host[i]))
            return 0;
    return i <= PLC_NAME_MAX;
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

    if (!name || !isName(name))
        return refuse(command, name, "PLCname is missing or wrong; allowed: 1 to %d "
                      "characters without blank or '/'", PLC_NAME_MAX);
    if (plcStationFind(name))
        return refuse(command, name, "this PLC is configured already; each name once");
    if (splitAddress(address, &config, host, &error))
        return refuse(command, name, "IPaddr \"%.60s\"; allowed: %s", address, error);
    for (i = 0; i < 6; i++) {
        const char *text = args[i + 2];

        value[i] = numbers[i].initial;
        if (!text && value[i] < 0)
            return refuse(command, name, "%s is missing; allowed: %s", numbers[i].name,
                          numbers[i].allowed);
        if (!text)
            continue;
        if (epicsParseInt32(text, &value[i], 0, NULL))
            return refuse(command, name, "%s=%.60s is no number; allowed: %s",
                          numbers[i].name, text, numbers[i].allowed);
        if (value[i] == 0 && numbers[i].initial > 0)
            value[i] = numbers[i].initial;
        if (value[i] < numbers[i].min || value[i] > numbers[i].max)
            return refuse(command, name, "%s=%.60s; allowed: %s", numbers[i].name, text,
                          numbers[i].allowed);
    }
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
