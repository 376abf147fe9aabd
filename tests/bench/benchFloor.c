/* The floors of the benchmark: device support that reads nothing, moved in two ways.
 *
 * Records of the same database as with the driver, with DTYP "floor" in place of "S7plc",
 * get a value from memory without a lock.
 *   benchFloorRun       A thread per station asks for their I/O Intr scan at a given rate.
 *                       What this costs is record processing alone.
 *   benchFloorReceive   A thread per station receives blocks and processes the records
 *                       that change, which it knows beforehand: it compares and copies
 *                       nothing. No driver with scan=changed can cost less.
 *
 * The link is "@PLCn/offset ...": n is the station; bytes 8..15 are the time of the
 * block, cells of 4 bytes follow from byte 32 on, of which some change with each block.
 */
#include <arpa/inet.h>
#include <math.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>

#include <aiRecord.h>
#include <biRecord.h>
#include <cantProceed.h>
#include <dbAccess.h>
#include <dbLink.h>
#include <dbLock.h>
#include <dbScan.h>
#include <devSup.h>
#include <epicsThread.h>
#include <iocsh.h>
#include <link.h>
#include <longinRecord.h>

#include <epicsExport.h>

#define STATIONS 200
#define HEADER 32

typedef struct station {
    IOSCANPVT list;
    double time;     /* CLOCK_MONOTONIC of the block, s */
    double sequence; /* blocks so far */
    double rate;     /* blocks per second */
    int count;
    dbCommon **changing; /* records that change with each block, by PHAS */
    int numChanging;
    int socket;
    int size; /* of a block */
} station;

typedef struct place {
    station *station;
    const double *value;
} place;

static station stations[STATIONS];
static const double still = 1;
static int cells = 1, changing = 1;
static int left; /* stations that still run */

static double now(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + t.tv_nsec * 1e-9;
}

/* --- Device support ---------------------------------------------------------------- */

/* The same cells change as those of benchSender. */
static int changes(int cell)
{
    long long step = (long long)cell * changing;

    return step / cells != (step - changing < 0 ? -1 : (step - changing) / cells);
}

static void addChanging(station *s, dbCommon *prec)
{
    int i = s->numChanging++;

    s->changing = realloc(s->changing, s->numChanging * sizeof(*s->changing));
    if (!s->changing)
        cantProceed("floor: no memory");
    for (; i > 0 && s->changing[i - 1]->phas > prec->phas; i--)
        s->changing[i] = s->changing[i - 1];
    s->changing[i] = prec;
}

static long initRecord(dbCommon *prec)
{
    place *own = callocMustSucceed(1, sizeof(*own), "floor");
    const struct link *link = dbGetDevLink(prec);
    unsigned number = 0, offset = 0;

    if (!link || sscanf(link->value.instio.string, "PLC%u/%u", &number, &offset) < 2 ||
        number >= STATIONS)
        return S_db_badField;
    own->station = &stations[number];
    if (!own->station->list)
        scanIoInit(&own->station->list);
    own->value = &still;
    if (offset == 8)
        own->value = &own->station->time;
    else if (offset >= HEADER && changes((int)(offset - HEADER) / 4))
        own->value = &own->station->sequence;
    if (own->value != &still)
        addChanging(own->station, prec);
    prec->dpvt = own;
    return 0;
}

static long ioInfo(int leave, dbCommon *prec, IOSCANPVT *list)
{
    (void)leave;
    *list = ((place *)prec->dpvt)->station->list;
    return 0;
}

static double value(void *prec)
{
    return *((place *)((dbCommon *)prec)->dpvt)->value;
}

static long readAi(aiRecord *prec)
{
    prec->val = value(prec);
    return 2;
}

static long readBi(biRecord *prec)
{
    prec->rval = (int)value(prec) & 1;
    return 0;
}

static long readLongin(longinRecord *prec)
{
    prec->val = (int)value(prec);
    return 0;
}

static aidset devFloorAi = {
    {6, NULL, NULL, initRecord, ioInfo},
    readAi, NULL
};
static bidset devFloorBi = {
    {5, NULL, NULL, initRecord, ioInfo},
    readBi
};
static longindset devFloorLongin = {
    {5, NULL, NULL, initRecord, ioInfo},
    readLongin
};
epicsExportAddress(dset, devFloorAi);
epicsExportAddress(dset, devFloorBi);
epicsExportAddress(dset, devFloorLongin);

/* --- The clock --------------------------------------------------------------------- */

static void run(void *arg)
{
    station *s = arg;
    double due = now() + (double)(s - stations) / STATIONS / s->rate;
    int i;

    for (i = 0; i < s->count; i++) {
        struct timespec until;

        due += 1 / s->rate;
        until.tv_sec = (time_t)due;
        until.tv_nsec = (long)((due - floor(due)) * 1e9);
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL);
        s->sequence++;
        s->time = now();
        scanIoRequest(s->list);
    }
    if (__sync_sub_and_fetch(&left, 1) == 0) {
        printf("floor done\n");
        fflush(stdout);
    }
    epicsThreadSuspendSelf(); /* its CPU time is still to be read */
}

static void start(double rate, int count)
{
    int i;

    for (i = 0; i < STATIONS; i++)
        left += stations[i].list != NULL;
    for (i = 0; i < STATIONS; i++) {
        stations[i].rate = rate;
        stations[i].count = count;
        if (stations[i].list)
            epicsThreadMustCreate("floor", epicsThreadPriorityHigh,
                                  epicsThreadGetStackSize(epicsThreadStackSmall), run,
                                  &stations[i]);
    }
}

/* --- Blocks that come --------------------------------------------------------------- */

/* The time in a block: a double, big endian, at byte 8. */
static double timeOf(const unsigned char *block)
{
    uint64_t bits = 0;
    double value;
    int i;

    for (i = 8; i < 16; i++)
        bits = bits << 8 | block[i];
    memcpy(&value, &bits, 8);
    return value;
}

static void processChanging(station *s)
{
    int i;

    for (i = 0; i < s->numChanging; i++) {
        dbScanLock(s->changing[i]);
        dbProcess(s->changing[i]);
        dbScanUnlock(s->changing[i]);
    }
}

static void receive(void *arg)
{
    station *s = arg;
    unsigned char *block = callocMustSucceed(1, s->size, "floor");
    struct pollfd fd = {s->socket, POLLIN, 0};
    ssize_t fill = 0, n;

    for (;;) {
        if (ppoll(&fd, 1, NULL, NULL) < 0)
            break;
        n = recv(s->socket, block + fill, s->size - fill, MSG_DONTWAIT);
        if (n <= 0)
            break;
        fill += n;
        if (fill < s->size)
            continue;
        fill = 0;
        s->sequence++;
        s->time = timeOf(block);
        processChanging(s);
    }
    epicsThreadSuspendSelf(); /* its CPU time is still to be read */
}

static void connectTo(station *s, int port, int size)
{
    struct sockaddr_in peer = {.sin_family = AF_INET,
                               .sin_port = htons((uint16_t)port),
                               .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};

    s->size = size;
    s->socket = socket(AF_INET, SOCK_STREAM, 0);
    if (s->socket < 0 || connect(s->socket, (struct sockaddr *)&peer, sizeof(peer)) < 0) {
        perror("benchFloorReceive");
        return;
    }
    epicsThreadMustCreate("floor", epicsThreadPriorityMedium,
                          epicsThreadGetStackSize(epicsThreadStackMedium), receive, s);
}

/* --- Commands ------------------------------------------------------------------------ */

static const iocshArg cellsArg = {"cells", iocshArgInt};
static const iocshArg changingArg = {"changing", iocshArgInt};
static const iocshArg *const floorArgs[] = {&cellsArg, &changingArg};
static const iocshFuncDef floorDef = {"benchFloor", 2, floorArgs, NULL};

static void floorCall(const iocshArgBuf *args)
{
    cells = args[0].ival;
    changing = args[1].ival;
}

static const iocshArg rateArg = {"blocks/s", iocshArgDouble};
static const iocshArg countArg = {"blocks", iocshArgInt};
static const iocshArg *const runArgs[] = {&rateArg, &countArg};
static const iocshFuncDef runDef = {"benchFloorRun", 2, runArgs, NULL};

static void runCall(const iocshArgBuf *args)
{
    start(args[0].dval, args[1].ival);
}

static const iocshArg stationArg = {"station", iocshArgInt};
static const iocshArg portArg = {"port", iocshArgInt};
static const iocshArg sizeArg = {"size", iocshArgInt};
static const iocshArg *const receiveArgs[] = {&stationArg, &portArg, &sizeArg};
static const iocshFuncDef receiveDef = {"benchFloorReceive", 3, receiveArgs, NULL};

static void receiveCall(const iocshArgBuf *args)
{
    int number = args[0].ival;

    if (number >= 0 && number < STATIONS && args[2].ival > 16)
        connectTo(&stations[number], args[1].ival, args[2].ival);
}

static void benchFloorRegister(void)
{
    iocshRegister(&receiveDef, receiveCall);
    iocshRegister(&floorDef, floorCall);
    iocshRegister(&runDef, runCall);
}
epicsExportRegistrar(benchFloorRegister);
