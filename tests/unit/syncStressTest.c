/* The sync handshake under random episodes: a real station of the driver against a real
 * PLC of the simulator, over TCP on loopback. Restarts of either side, broken
 * connections, LOCAL and REMOTE, the HMI, puts, and faults of the wire come in any order.
 *
 * The property is checked where it counts: at each change of PLC memory. Every put and
 * every change at the HMI has a number of its own, counted up, in its value. A block from
 * the IOC may move a setpoint only to a put that was accepted, and that is newer than
 * everything the HMI has done and than every put before. So neither yesterday's values
 * nor a put of before a loss ever get there. When the faults are over, both must find
 * each other.
 *
 * Arguments: number of episodes (300, or PLCLINK_EPISODES; "600s": so long), seed (from the
 * clock).
 * One thread plays the PLC, the HMI and the client; the station has its own.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <arpa/inet.h>

#include <epicsStdio.h>
#include <epicsTime.h>
#include <epicsUnitTest.h>
#include <errlog.h>
#include <testMain.h>

#include "plcBlocks.h"
#include "plcStation.h"
#include "simBlockServer.h"
#include "simCommand.h"
#include "simServers.h"
#include "simValue.h"

#define POINTS 4
#define PATIENCE_S 60.0 /* for what must happen in the end */
#define ACTIONS 14      /* at most, in an episode */

/* The value of a setpoint: who made it, and its number. */
#define HMI 0x10000000u
#define PUT 0x20000000u
#define STALE 0x30000000u /* what an IOC holds from yesterday */
#define NUMBER 0x0fffffffu

static const char file[] = "in = 24\nout = 20\nperiod = 2 ms\nsync = on\nlayout = 77\n"
                           "watchdog = 80 ms\nport = 0\n"
                           "db 10 16 Setpoints\n"
                           "tx P#DB10.DBX0.0 DWORD 4 -> 4\n"
                           "rx 4 -> P#DB10.DBX0.0 DWORD 2\n"
                           "rx 12 -> DB10.DBD8\n"
                           "rx 16 -> DB10.DBD12\n";

static simulator sim;
static simBlock *db;
static plcStation *station;
static int port;
static unsigned long long state;

static epicsUInt32 number;            /* the last that was used */
static epicsUInt32 memory[POINTS];    /* PLC memory, as seen last */
static epicsUInt32 lastHmi;           /* number of the HMI's last change */
static epicsUInt32 lastTaken[POINTS]; /* number of the last put that came through */
static epicsUInt8 *accepted;          /* per number: the put had no alarm */
static size_t acceptedSize;
static char failure[200];
static unsigned taken, refused, putCount, hmiChanges, iocRestarts, plcRestarts, breaks;

static unsigned randomBelow(unsigned n)
{
    state = state * 6364136223846793005ull + 1442695040888963407ull;
    return (unsigned)(state >> 33) % n;
}

static epicsUInt32 nextNumber(void)
{
    if (++number >= acceptedSize) {
        acceptedSize = acceptedSize ? acceptedSize * 2 : 1 << 16;
        accepted = realloc(accepted, acceptedSize);
        if (!accepted)
            testAbort("no memory");
        memset(accepted + number, 0, acceptedSize - number);
    }
    return number;
}

static epicsUInt32 plcHolds(int i)
{
    return (epicsUInt32)simGetInt(db->bytes + 4 * i, 4, 1);
}

static void look(void)
{
    int i;

    for (i = 0; i < POINTS; i++)
        memory[i] = plcHolds(i);
}

/* --- The property --------------------------------------------------------------------*/

static void judge(int i, epicsUInt32 value)
{
    epicsUInt32 n = value & NUMBER;
    const char *what = NULL;

    if ((value & ~NUMBER) == HMI) { /* at the moment that it had waited for */
        lastHmi = number;
        return;
    }
    if ((value & ~NUMBER) == STALE)
        what = "a value of yesterday";
    else if ((value & ~NUMBER) != PUT)
        what = "a value that nobody wrote";
    else if (!accepted[n])
        what = "a put that was refused";
    else if (n <= lastHmi)
        what = "a put from before the HMI's last change";
    else if (n <= lastTaken[i])
        what = "a put that is older than the one before";
    if (what)
        epicsSnprintf(failure, sizeof(failure), "setpoint %d: 0x%08x -> 0x%08x: %s", i,
                      (unsigned)memory[i], (unsigned)value, what);
    lastTaken[i] = n;
    taken++;
}

/* The simulator calls this after each block, in and out. */
static void onChanged(void *arg)
{
    int i;

    (void)arg;
    for (i = 0; i < POINTS; i++)
        if (plcHolds(i) != memory[i])
            judge(i, plcHolds(i));
    look();
}

/* --- The actors ----------------------------------------------------------------------*/

static void command(const char *format, ...)
{
    simText answer = {NULL, 0, 0};
    char line[100];
    va_list args;

    va_start(args, format);
    epicsVsnprintf(line, sizeof(line), format, args);
    va_end(args);
    simCommandRun(&sim, line, &answer);
    if (!answer.text || strncmp(answer.text, "error", 5) == 0)
        testAbort("plcSim: %s", answer.text ? answer.text : "no answer");
    simTextFree(&answer);
    look(); /* what it changed was the HMI's, or the PLC's own, doing */
}

static void run(double seconds)
{
    simLoopRun(&sim.loop, simNow() + seconds);
}

static void hmi(void)
{
    static const char *const moments[] = {"", "", "receive ", "check "};

    const char *moment = moments[randomBelow(4)];

    hmiChanges++;
    command("hmi %sDB10.DBD%u %u", moment, 4 * randomBelow(POINTS), HMI | nextNumber());
    if (!moment[0])
        lastHmi = number;
}

static int put(int i, epicsUInt32 value)
{
    char reason[PLC_REASON_SIZE];
    epicsUInt32 wire = htonl(value);

    return plcStationWrite(station, 4 + 4 * (size_t)i, 4, &wire, NULL, reason);
}

static void clientPuts(void)
{
    epicsUInt32 n = nextNumber();
    int status = put((int)randomBelow(POINTS), PUT | n);

    putCount++;
    refused += status != 0;
    accepted[n] = status == 0;
}

static void option(const char *key, const char *value)
{
    char error[300];

    if (plcStationSetOption(station, key, value, error, sizeof(error)))
        testAbort("%s", error);
}

/* An IOC comes up with values of yesterday in its output image. */
static void iocStarts(void)
{
    plcStationConfig config = {
        .transport = &plcBlocks, .name = "PLC",
        .address = {"127.0.0.1", ""},
        .port = port,
        .inSize = 24,
        .outSize = 20,
        .bigEndian = 1,
        .recvTimeout = 100,
        .sendInterval = 1
    };
    int i;

    station = plcStationCreate(&config);
    for (i = 0; i < POINTS; i++)
        put(i, STALE | nextNumber());
    option("sync", "on");
    option("layout", "77");
    option("readback", "0");
    option("heartbeat", "20");
    option("connectTimeout", "50");
    plcStationsStart();
    plcStationsRun();
}

static void iocAgain(void)
{
    plcStationsDestroy();
    iocRestarts++;
    iocStarts();
}

static void plcAgain(void)
{
    plcRestarts++;
    command("restart %u %s", randomBelow(8), randomBelow(2) ? "cold" : "");
    lastHmi = nextNumber(); /* its start values are newer than any put */
}

static void wireBreaks(void)
{
    static const char *const ways[] = {"close", "reset", "cut 7", "cut 27"};

    breaks++;
    command(ways[randomBelow(4)]);
}

static void wireFails(void)
{
    static const char *const ways[] = {
        "silence",      "silence off",     "delay 3",   "delay off", "fragment 5 1",
        "fragment off", "stall",           "stall off", "refuse",    "refuse off",
        "refuse sync",  "refuse sync off", "unplug",    "plug",      "normal"};

    command(ways[randomBelow(sizeof(ways) / sizeof(ways[0]))]);
}

static void localRemote(void)
{
    command(randomBelow(3) ? "remote" : "local");
}

static void act(void)
{
    static const struct {
        void (*fn)(void);
        unsigned weight;
    } actors[] = {
        {clientPuts,  40},
        {hmi,         20},
        {localRemote, 8 },
        {wireBreaks,  6 },
        {wireFails,   10},
        {plcAgain,    2 },
        {iocAgain,    4 }
    };
    unsigned draw = randomBelow(90), i = 0;

    while (draw >= actors[i].weight)
        draw -= actors[i++].weight;
    actors[i].fn();
}

/* --- Episodes ------------------------------------------------------------------------*/

static int bothEqual(void)
{
    epicsUInt32 image[POINTS];
    int i;

    plcImagePeek(plcStationOutput(station), 4, sizeof(image), image);
    for (i = 0; i < POINTS; i++)
        if (ntohl(image[i]) != plcHolds(i))
            return 0;
    return 1;
}

static int synced(void)
{
    plcStats stats;

    plcStationStats(station, &stats);
    return stats.syncState == 3 && sim.plc[0].program.synced;
}

#define runUntil(condition, what)                                                        \
    do {                                                                                 \
        double end = simNow() + PATIENCE_S;                                              \
        while (!(condition) && simNow() < end)                                           \
            run(0.002);                                                                  \
        if (!(condition) && !failure[0])                                                 \
            epicsSnprintf(failure, sizeof(failure), "never: %s", what);                  \
    } while (0)

static int imageHolds(int i, epicsUInt32 value)
{
    epicsUInt32 wire;

    plcImagePeek(plcStationOutput(station), 4 + 4 * (size_t)i, 4, &wire);
    return ntohl(wire) == value;
}

/* Once the faults are over a put gets through; the first ones may be overtaken by what
 * the HMI is still about to do, and then the output holds the PLC's value again. */
static void settle(void)
{
    double end = simNow() + PATIENCE_S;
    epicsUInt32 value;

    command("normal");
    command("plug");
    command("remote");
    runUntil(synced() && bothEqual(), "synchronised, with equal values");
    do {
        value = PUT | nextNumber();
        accepted[value & NUMBER] = put(0, value) == 0;
        do
            run(0.001);
        while (imageHolds(0, value) && plcHolds(0) != value && simNow() < end);
    } while (plcHolds(0) != value && simNow() < end);
    if (plcHolds(0) != value && !failure[0])
        epicsSnprintf(failure, sizeof(failure), "never: a put is in PLC memory");
}

static int episode(void)
{
    unsigned i, count = 2 + randomBelow(ACTIONS);

    failure[0] = 0;
    for (i = 0; i < count && !failure[0]; i++) {
        act();
        run(randomBelow(3) ? randomBelow(5) * 1e-3 : randomBelow(20) * 1e-4);
        if (randomBelow(60) == 0)
            run(0.1); /* long enough for both watchdogs */
    }
    if (!failure[0])
        settle();
    return failure[0] == 0;
}

/* --- The PLC -------------------------------------------------------------------------*/

static void plcStarts(void)
{
    simText messages = {NULL, 0, 0};
    const simBlockServer *blocks;

    simLogQuiet(2);
    simLoopInit(&sim.loop);
    simConfigInit(&sim.config);
    simServersKeys(&sim.config);
    sim.count = 1;
    if (simConfigReadText(&sim.config, "stress", file, &messages) ||
        simPlcBuild(&sim.plc[0], &sim.loop, &sim.config, simServers, "PLC", &messages) ||
        simPlcStart(&sim.plc[0], "127.0.0.1", NULL))
        testAbort("%s", messages.text ? messages.text : "the PLC does not start");
    simTextFree(&messages);
    blocks = simPlcServerOf(&sim.plc[0], &simBlockServerType);
    port = ntohs(blocks->tcp.listener.address.sin_port);
    db = simMemoryFind(&sim.plc[0].memory, SIM_AREA_DB, 10);
    look();
    sim.plc[0].changed = onChanged;
}

static void plcEnds(void)
{
    sim.plc[0].changed = NULL;
    simPlcStop(&sim.plc[0]);
    simPlcFree(&sim.plc[0]);
    simConfigFree(&sim.config);
    simLoopFree(&sim.loop);
}

MAIN(syncStressTest)
{
    const char *wanted = argc > 1 ? argv[1] : getenv("PLCLINK_EPISODES");
    unsigned long episodes = wanted ? strtoul(wanted, NULL, 0) : 300;
    unsigned long long seed = argc > 2 ? strtoull(argv[2], NULL, 0) : epicsMonotonicGet();
    unsigned long i;
    double begin = simNow();
    double end = wanted && strchr(wanted, 's') ? begin + (double)episodes : 0;

    testPlan(2);
    testDiag("%s episodes, seed %llu", wanted ? wanted : "300", seed);
    state = seed;
    eltc(0);
    plcStarts();
    iocStarts();
    for (i = 0; (end ? simNow() < end : i < episodes) && episode(); i++)
        ;
    if (failure[0])
        testDiag("episode %lu: %s", i, failure);
    testDiag(
        "%lu episodes in %.0f s: %u puts (%u refused), %u taken; HMI %u; restarts of "
        "the IOC %u, of the PLC %u; breaks %u",
        i, simNow() - begin, putCount, refused, taken, hmiChanges, iocRestarts,
        plcRestarts, breaks);
    testOk(!failure[0],
           "the PLC never took a setpoint but a client's put after SYNC, and "
           "after each episode both sides found each other");
    testOk(taken > i / 2, "many puts got through");
    plcStationsDestroy();
    plcEnds();
    free(accepted);
    return testDone();
}
