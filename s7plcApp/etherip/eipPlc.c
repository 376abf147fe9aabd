/* A PLC of this wire, and EtherNet/IP as a transport; see eipPlc.h. */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <dbDefs.h>
#include <epicsAtomic.h>
#include <epicsMutex.h>
#include <epicsStdio.h>
#include <epicsThread.h>

#include "eipPlc.h"
#include "plcConfigure.h"
#include "plcOptions.h"
#include "plcResolver.h"
#include "plcStats.h"

enum { relearnMs = 3000 };

/* All of them; none ever leaves, but in unit tests. */
static ELLLIST plcs = ELLLIST_INIT;
static epicsMutexId lock;
static epicsThreadOnceId once = EPICS_THREAD_ONCE_INIT;

static void initOnce(void *arg)
{
    (void)arg;
    lock = epicsMutexMustCreate();
}

static eipPlc *next(eipPlc *plc)
{
    ELLNODE *node;

    epicsThreadOnce(&once, initOnce, NULL);
    epicsMutexMustLock(lock);
    node = plc ? ellNext(&plc->node) : ellFirst(&plcs);
    epicsMutexUnlock(lock);
    return node ? CONTAINER(node, eipPlc, node) : NULL;
}

eipPlc *eipPlcFind(const char *name)
{
    eipPlc *plc = NULL;

    while ((plc = next(plc)))
        if (strcmp(plc->name, name) == 0)
            break;
    return plc;
}

void eipPlcEach(void (*visit)(eipPlc *plc, void *arg), void *arg)
{
    eipPlc *plc = NULL;

    while ((plc = next(plc)))
        visit(plc, arg);
}

/* A link that changes costs a wake-up; many of them, as when an IOC ends, cost one list. */
void eipPlcWantsChanged(eipPlc *plc)
{
    if (!epicsAtomicGetIntT(&plc->begun))
        return;
    plc->wake(plc->wakeArg);
    eipWorkerWant(plc->worker);
}

/* In the worker's thread. */
static int wants(void *arg, eipWant **all, unsigned *count, size_t *used)
{
    eipPlc *plc = arg;

    return epicsAtomicGetIntT(&plc->begun) && eipPlacesWants(plc->places, 0, all, count, used);
}

/* --- The transport ------------------------------------------------------------------------- */

static void *create(const plcTransportSetup *setup, const void *own)
{
    eipPlc *plc = *(eipPlc *const *)own;

    plc->worker = eipWorkerCreate(setup, &plc->connect, wants, plc);
    plc->wake = setup->wake;
    plc->wakeArg = setup->arg;
    return plc;
}

/* The station is gone for good (unit tests): so is the PLC. */
static void destroy(void *pvt)
{
    eipPlc *plc = pvt;

    epicsMutexMustLock(lock);
    ellDelete(&plcs, &plc->node);
    epicsMutexUnlock(lock);
    if (plc->worker)
        eipWorkerDestroy(plc->worker);
    eipPlacesDestroy(plc->places);
    free(plc);
}

static void begin(void *pvt)
{
    eipWorkerBegin(((eipPlc *)pvt)->worker);
}

static void end(void *pvt)
{
    eipWorkerEnd(((eipPlc *)pvt)->worker);
}

static double pauseOf(void *pvt, const plcOptions *o)
{
    (void)o;
    return eipWorkerPause(((eipPlc *)pvt)->worker);
}

static void options(void *pvt, const plcOptions *o)
{
    eipPlc *plc = pvt;
    eipWorkerOptions chosen = {o->requestTimeout, relearnMs};

    plc->connect.timeout = (unsigned)o->requestTimeout;
    eipWorkerSetConnect(plc->worker, &plc->connect);
    eipWorkerSetOptions(plc->worker, &chosen);
}

/* All records are there. */
static void up(void *pvt, SOCKET socket, const epicsUInt8 *wholeIn, const epicsUInt8 *wholeOut)
{
    eipPlc *plc = pvt;

    (void)wholeIn, (void)wholeOut; /* a worker that knows tags knows what is whole */
    epicsAtomicSetIntT(&plc->begun, 1);
    eipWorkerStart(plc->worker, socket);
}

static void down(void *pvt)
{
    eipWorkerStop(((eipPlc *)pvt)->worker);
}

static size_t used(void *pvt)
{
    return eipPlacesUsed(((eipPlc *)pvt)->places);
}

static int news(void *pvt, plcNews *n, void *input, void *output)
{
    return eipWorkerTake(((eipPlc *)pvt)->worker, n, input, output);
}

static void age(void *pvt, epicsUInt64 *through, void *older)
{
    eipWorkerAge(((eipPlc *)pvt)->worker, through, older);
}

static unsigned refused(void *pvt, unsigned *of, char *first, size_t size)
{
    eipPlc *plc = pvt;

    return eipPlacesBad(plc->places, plcStationInFaults(plc->station), of, first, size);
}

static void put(void *pvt, const void *image, const void *mask)
{
    (void)image, (void)mask; /* takesPuts */
    eipWorkerPut(((eipPlc *)pvt)->worker);
}

/* The input image has the type of each tag that was read; both have its number. */
static void tells(void *pvt, const void *image, size_t offset, char *what, size_t whatSize,
                  char *value, size_t valueSize)
{
    eipPlc *plc = pvt;
    const epicsUInt8 *bytes = image;
    char tag[eipNameMax + 16];
    epicsUInt8 code[2];
    const eipType *type;
    eipNumber number;
    epicsUInt64 bits;
    size_t at;

    what[0] = value[0] = 0;
    if (eipPlacesTag(plc->places, offset, tag, sizeof(tag), &at))
        return;
    plcImagePeek(plcStationInput(plc->station), at, sizeof(code), code);
    type = eipTypeOf((unsigned)eipGetUnsigned(code, 2));
    epicsSnprintf(what, whatSize, "%s%s%s", tag, type ? " " : "", type ? type->name : "");
    if (!type || !type->size || offset != at + eipPlaceHead)
        return;
    bits = eipGetUnsigned(bytes + offset, 8);
    number.kind = (eipKind)bytes[at + eipPlaceKindAt];
    memcpy(&number.u, &bits, sizeof(bits));
    eipNumberText(type, &number, value, valueSize);
}

static void report(void *pvt, const char *where, const char *state, const plcStats *st,
                   FILE *file)
{
    eipPlc *plc = pvt;
    eipWorkerState s;

    eipWorkerStateGet(plc->worker, &s);
    fprintf(file, "    EtherNet/IP %s: %s%s, %llu requests, %llu refused, %llu not answered, "
            "latency [ms] %.3f (max %.3f)\n", where,
            !s.connected ? state : s.keeps ? "" : "connected, messages ",
            s.connected ? s.way : "", (unsigned long long)st->requests,
            (unsigned long long)st->exceptions, (unsigned long long)st->requestTimeouts,
            st->requestLatency, st->requestLatencyMax);
    if (s.identity.known)
        fprintf(file, "    %s, revision %u.%u, vendor %u, serial number %08X\n",
                s.identity.name, s.identity.major, s.identity.minor, s.identity.vendor,
                s.identity.serial);
    fprintf(file, "    %u tags, %u known, %u refused, read in %u parts by %u requests; "
            "%lu of %lu bytes in use; %llu turns late, %llu new programs\n", s.tags, s.known, s.bad, s.units,
            s.requests, (unsigned long)eipPlacesUsed(plc->places),
            (unsigned long)plcStationInSize(plc->station), (unsigned long long)s.late,
            (unsigned long long)s.programs);
}

const plcTransport eipTransport = {
    .name = "EtherNet/IP",
    .form = "DTYP \"EtherIP\", as in @PLC Tank.Level",
    .prefix = "EtherNet/IP ",
    .shows = 1,
    .opens = 1,
    .takesPuts = 1,
    .create = create,
    .destroy = destroy,
    .begin = begin,
    .end = end,
    .pause = pauseOf,
    .options = options,
    .up = up,
    .down = down,
    .used = used,
    .news = news,
    .age = age,
    .refused = refused,
    .put = put,
    .tells = tells,
    .report = report,
};

/* --- Configuration -------------------------------------------------------------------------- */

/* "host[:port]". Returns 0, or -1 after the error line. */
static int splitHost(const char *command, const char *name, const char *text, char *host,
                     size_t size, epicsInt32 *port)
{
    static const plcNumberArg portArg = {"port", eipTcpPort, 1, 65535, 0, "1 to 65535"};
    const char *colon = strchr(text, ':');

    epicsSnprintf(host, size, "%.*s", (int)strcspn(text, ":"), text);
    if (!host[0] || !plcAddressIsHost(host)) {
        plcConfigureRefuse(command, name,
                           "IPaddr \"%.60s\"; allowed: " PLC_HOST_ALLOWED ", with or without "
                           ":port", text);
        return -1;
    }
    return plcConfigureNumber(command, name, &portArg, colon ? colon + 1 : NULL, port);
}

eipPlc *eipPlcCreate(const char *command, const char *name, const char *address,
                     const eipPlcSetup *setup)
{
    char host[PLC_NAME_MAX + 1];
    plcStationConfig config = {.name = name, .policy = &plcSingle, .recvTimeout = 2000,
                               .sendInterval = 1000, .transport = &eipTransport};
    epicsInt32 port;
    eipPlc *plc;

    if (!plcConfigureIsNew(command, name) ||
        splitHost(command, name, address ? address : "", host, sizeof(host), &port))
        return NULL;
    epicsThreadOnce(&once, initOnce, NULL);
    plc = callocMustSucceed(1, sizeof(*plc), "etherip");
    epicsSnprintf(plc->name, sizeof(plc->name), "%s", name);
    plc->connect = (eipConnectOptions){setup->route, setup->connected, setup->size, setup->room,
                                       5000, setup->instances};
    plc->places = eipPlacesCreate(setup->imageSize);
    config.address[0] = host;
    config.port = port;
    config.inSize = config.outSize = setup->imageSize;
    config.transportOwn = &plc;
    config.follows = 1;
    epicsMutexMustLock(lock);
    ellAdd(&plcs, &plc->node);
    epicsMutexUnlock(lock);
    plc->station = plcStationCreate(&config);
    if (!plc->station) {
        destroy(plc);
        return NULL;
    }
    return plc;
}
