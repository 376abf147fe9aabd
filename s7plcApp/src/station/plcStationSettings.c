/* What people set and read of a station: its addresses, orders, options and statistics; any thread,
 * see plcStation.h.
 *
 * Only copies, and words left for the thread.
 */
#include <string.h>

#include <epicsAtomic.h>
#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <epicsString.h>
#include <errlog.h>
#include <osiSock.h>

#include "plcClock.h"
#include "plcResolver.h"
#include "plcStationPvt.h"

void plcStationAddress(plcStation *s, char *text, size_t size)
{
    epicsMutexMustLock(s->lock);
    if (s->port[0])
        epicsSnprintf(text, size, "%s:%d", s->address[0], s->port[0]);
    else
        epicsSnprintf(text, size, "%s", s->address[0]);
    epicsMutexUnlock(s->lock);
}

/* "192.168.1.2" plus 1. Names are left as they are: nothing here may wait for DNS. */
static void plusText(const char *host, int plus, char *text, size_t size)
{
    struct sockaddr_in address;
    char dotted[32];

    epicsSnprintf(text, size, "%s", host);
    if (plus == 0)
        return;
    if (strspn(host, "0123456789.") < strlen(host) || aToIPAddr(host, 1, &address)) {
        epicsSnprintf(text, size, "%s +%d", host, plus);
        return;
    }
    address.sin_addr.s_addr = htonl(ntohl(address.sin_addr.s_addr) + (epicsUInt32)plus);
    ipAddrToDottedIP(&address, dotted, sizeof(dotted));
    epicsSnprintf(text, size, "%.*s", (int)strcspn(dotted, ":"), dotted);
}

static void lineText(plcStation *s, unsigned line, char *text, size_t size)
{
    char host[PLC_NAME_MAX + 1];

    epicsMutexMustLock(s->lock);
    plusText(s->address[line], s->plus[line], host, sizeof(host));
    if (s->port[line])
        epicsSnprintf(text, size, "%s:%d", host, s->port[line]);
    else
        epicsSnprintf(text, size, "%s", host);
    epicsMutexUnlock(s->lock);
}

void plcStationLineAddress(plcStation *s, unsigned line, char *text, size_t size)
{
    text[0] = 0;
    if (line < s->policy->lines)
        lineText(s, line, text, size);
}

typedef struct Sharing {
    plcStation *station, *other; /* other: found, or NULL */
} Sharing;

static void compareLines(plcStation *other, void *arg)
{
    Sharing *sharing = arg;
    plcStation *s = sharing->station;
    char mine[PLC_NAME_MAX + 20], its[PLC_NAME_MAX + 20];
    unsigned i, j;

    if (other == s || sharing->other)
        return;
    for (i = 0; i < s->lineCount; i++) {
        lineText(s, i, mine, sizeof(mine));
        for (j = 0; j < other->lineCount; j++) {
            lineText(other, j, its, sizeof(its));
            if (mine[0] && mine[0] != ':' && epicsStrCaseCmp(mine, its) == 0)
                sharing->other = other;
        }
    }
}

const char *plcStationSharing(plcStation *s)
{
    Sharing sharing = {s, NULL};

    plcStationEach(compareLines, &sharing);
    return sharing.other ? sharing.other->name : NULL;
}

int plcStationMove(plcStation *s, const char *text, char *error, size_t size)
{
    char host[PLC_NAME_MAX + 1];
    size_t length = strcspn(text, ":");
    epicsInt32 port = 0;
    unsigned i;

    epicsSnprintf(host, sizeof(host), "%.*s", (int)length, text);
    if (length == 0 || length >= sizeof(host) || !plcAddressIsHost(host)) {
        epicsSnprintf(error, size, "need host[:port], IP of four numbers");
        return -1;
    }
    if (text[length] && (epicsParseInt32(text + length + 1, &port, 10, NULL) || port < 1 ||
                         port > 65535)) {
        epicsSnprintf(error, size, "port must be 1 to 65535");
        return -1;
    }

    epicsMutexMustLock(s->lock);
    if (!port)
        port = s->port[0];
    for (i = 0; port && i < s->policy->lines; i++) {
        /* a second PLC at IPaddr+1 moves along; one with an address of its own stays */
        if (i == 0 || s->plus[i])
            strcpy(s->address[i], host);
        if (i == 0 || s->plus[i] || s->port[i] != port)
            s->moved |= 1u << i;
        s->port[i] = port;
    }
    if (port && s->outHere) {
        strcpy(s->address[s->outLine], host);
        s->moved |= 1u << s->outLine;
    }
    epicsMutexUnlock(s->lock);
    if (!port) {
        epicsSnprintf(error, size, "need host:port");
        return -1;
    }
    plcStationWake(s);
    return 0;
}

void plcStationReconnect(plcStation *s)
{
    epicsMutexMustLock(s->lock);
    s->anew = 1;
    s->moved |= (1u << s->lineCount) - 1;
    epicsMutexUnlock(s->lock);
    plcStationWake(s);
}

void plcStationSend(plcStation *s)
{
    epicsAtomicSetIntT(&s->sendNow, 1);
    plcStationWake(s);
}

/* --- Options and statistics -------------------------------------------------------------*/

/* Options that point into the input block must lie in it. */
static int optionsFit(plcStation *s, const plcOptions *o, char *error, size_t size)
{
    const struct {
        const char *key;
        double offset;
        size_t length;
    } places[] = {
        {"alive",     o->alive,     o->aliveType->size                         },
        {"timestamp", o->timestamp, o->timestampFormat == plcClockIsDtl ? PLC_CLOCK_DTL_SIZE : PLC_CLOCK_DT_SIZE},
        {"readback",  o->readback,  s->outSize                                 },
        {"layoutAt",  o->layoutAt,  2                                          },
    };
    size_t i;

    for (i = 0; plcStationByName(s) && i < sizeof(places) / sizeof(places[0]); i++)
        if (places[i].offset >= 0) {
            epicsSnprintf(error, size, "option %s: a PLC by %s has tags, no offsets", places[i].key,
                          plcStationByName(s));
            return -1;
        }
    if (o->sync && o->layoutAt >= 0) {
        epicsSnprintf(error, size, "option layoutAt: with sync=on the layout id is in the "
                      "header of the blocks");
        return -1;
    }
    if (o->map && (!o->sync || s->inSize < PLC_TABLES_STATUS ||
                   s->outSize < PLC_TABLES_PIECE + 4)) {
        epicsSnprintf(error, size, "option map: sync=on first, and blocks of %d bytes in and "
                      "%d out at least; inSize is %u, outSize %u", PLC_TABLES_STATUS,
                      PLC_TABLES_PIECE + 4, (unsigned)s->inSize, (unsigned)s->outSize);
        return -1;
    }
    if (o->sync && !s->lines[s->outLine].transport->syncs) {
        epicsSnprintf(error, size, "option sync: the handshake is in the blocks both ways, "
                      "and this PLC gets its values over %s", s->lines[s->outLine].transport->name);
        return -1;
    }
    if (o->sync && (s->inSize < PLC_HEADER_SIZE || s->outSize < PLC_HEADER_SIZE)) {
        epicsSnprintf(error, size, "option sync: both blocks begin with a header of %d "
                      "bytes; inSize is %u, outSize %u", PLC_HEADER_SIZE,
                      (unsigned)s->inSize, (unsigned)s->outSize);
        return -1;
    }
    for (i = 0; i < sizeof(places) / sizeof(places[0]); i++)
        if (places[i].offset >= 0 && places[i].offset + places[i].length > s->inSize) {
            epicsSnprintf(error, size,
                          "option %s: %u bytes at %.0f do not fit the input block of %u",
                          places[i].key, (unsigned)places[i].length, places[i].offset,
                          (unsigned)s->inSize);
            return -1;
        }
    return 0;
}

static int orderOf(int bigEndian, int wordOrder)
{
    if (wordOrder == plcWordsAsBytes)
        return bigEndian;
    if (wordOrder >= plcWordsABCD)
        bigEndian = wordOrder == plcWordsABCD || wordOrder == plcWordsCDAB;
    return plcOrder(bigEndian, wordOrder == plcWordsHigh || wordOrder == plcWordsABCD ||
                                   wordOrder == plcWordsBADC);
}

int plcStationSetOption(plcStation *s, const char *key, const char *value, char *error,
                        size_t size)
{
    plcOptions options;
    int status;

    /* Under the lock as a whole: who sets another one meanwhile shall not lose it. */
    epicsMutexMustLock(s->lock);
    options = s->options;
    status = plcOptionsSet(&options, key, value, s->started, error, size);
    if (status == 0)
        status = optionsFit(s, &options, error, size);
    if (status == 0) {
        s->options = options;
        s->optionsChanged = 1;
        epicsAtomicSetIntT(&s->logLevel, options.log);
        epicsAtomicSetIntT(&s->logTime, options.logTime);
    }
    if (status == 0 && !s->started) {
        plcScanByRange(s->inScan, options.scan == plcScanChanged);
        s->order = orderOf(s->bigEndian, options.wordOrder);
        s->textOrder = options.textOrder;
        s->header = options.sync ? PLC_HEADER_SIZE : 0;
    }
    epicsMutexUnlock(s->lock);
    if (status)
        return status;
    plcStationGate(s);
    plcStationWake(s);
    return 0;
}

void plcStationGetOptions(plcStation *s, plcOptions *options)
{
    epicsMutexMustLock(s->lock);
    *options = s->options;
    epicsMutexUnlock(s->lock);
}

void plcStationStats(plcStation *s, plcStats *stats)
{
    epicsMutexMustLock(s->lock);
    *stats = s->stats;
    stats->putsWaiting = plcImagePutsWaiting(s->out, NULL, NULL);
    epicsMutexUnlock(s->lock);
}

void plcStationStatsReset(plcStation *s)
{
    epicsMutexMustLock(s->lock);
    plcStatsReset(&s->stats);
    epicsMutexUnlock(s->lock);
}

void plcStationOptionsText(plcStation *s, char *text, size_t size)
{
    plcOptions options;

    epicsMutexMustLock(s->lock);
    options = s->options;
    epicsMutexUnlock(s->lock);
    plcOptionsSummary(&options, text, size);
}

const char *plcStateName(int state)
{
    static const char *const names[] = {"no address", "connecting", "waiting for data",
                                        "ok",         "wrong size", "frozen",
                                        "no PRIMARY", "layout mismatch",
                                        "some reads refused", "reads refused"};

    return state >= 0 && state < (int)(sizeof(names) / sizeof(names[0])) ? names[state]
                                                                        : "?";
}
