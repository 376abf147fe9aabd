/* Fuzz targets: what clients send to plcSim: frames of Modbus and of EtherNet/IP, blocks with
 * tables of pointers, and messages of the partner in a pair. Nothing is read behind what came;
 * memory that a table may not reach does not change.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "fuzz.h"
#include "fuzzSim.h"
#include "simEipFrame.h"
#include "simEipServer.h"
#include "simEipValue.h"
#include "simServers.h"
#include "simValue.h"
#ifdef FUZZ_MODBUS
#include "simModbusServer.h"
#endif

fuzzTarget fuzzSimModbus, fuzzSimEip, fuzzSimBlocks, fuzzSimPartner;

enum { queuedMost = 1 << 20, messageMost = 5000 };

static const char serversFile[] =
    "in = 32\nport = off\netherip_port = 0\nbyteorder = little\nperiod = 1 h\n"
    "db 10 400 Setpoints\n"
#ifdef FUZZ_MODBUS
    "modbus_port = 0\n"
    "modbus holding 0 100 -> DB10.0\nmodbus input 0 16 -> in.0\n"
    "modbus coils 5 64 -> DB10.200\nmodbus discrete 0 16 -> DB10.220 readonly\n"
#endif
    "udt Axis Pos:REAL On:BOOL Ready:BOOL Text:STRING Sub:INT[4]\n"
    "udt Two A:Axis B:Axis[3]\n"
    "tag REALs REAL[40] = 1.5\ntag A Axis\ntag T Two[2]\ntag S STRING = bread\n"
    "tag B BOOL[32]\ntag One BOOL\ntag Grid DINT[2,3,4]\ntag Program:Main.v LINT\ntag R INT readonly\n";

/* The same simulator for all calls, or one as Omron's: what they leave behind is cleared. */
static simulator *servers(int omron)
{
    static simulator sims[2];
    static simText out[2];
    static int made[2];
    char file[2000];

    if (!made[omron]) {
        snprintf(file, sizeof(file), "%s%s", serversFile, omron ? "etherip_profile = omron\n" : "");
        fuzzCheck(fuzzSimBuild(&sims[omron], file, &out[omron]) == 0);
        fuzzCheck(simPlcStart(&sims[omron].plc[0], "127.0.0.1", NULL) == 0);
        made[omron] = 1;
    }
    return &sims[omron];
}

static void clearMemory(const simMemory *memory)
{
    size_t i;

    for (i = 0; i < memory->count; i++)
        memset(memory->blocks[i]->bytes, 0, memory->blocks[i]->size);
}

static void clear(simulator *sim, simEip *eip)
{
    size_t i;

    clearMemory(&sim->plc[0].memory);
    for (i = 0; i < eip->controller.tags.count; i++)
        if (eip->controller.tags.list[i]->type)
            memset(simEipTagBytes(eip->controller.tags.list[i]), 0,
                   simEipTagSize(eip->controller.tags.list[i]));
    simEipConnectionsClear(&eip->controller.connections);
    eip->controller.connections.seed = 1;
}

/* A client whose bytes come from the fuzzer and go nowhere. */
static simClient *connectTo(simClients *all)
{
    int fd = open("/dev/null", O_RDWR | O_CLOEXEC), i;

    fuzzCheck(fd >= 0);
    all->listener.accepted(all, fd, "fuzz");
    for (i = 0; i < SIM_MAX_CLIENTS; i++)
        if (all->list[i])
            return all->list[i];
    fuzzFail(__FILE__, __LINE__, "a client");
    return NULL;
}

/* Gives bytes to the server, as they stand in a buffer of just their size. Returns -1 when the
 * client is gone. */
static int give(simClient *client, const epicsUInt8 *bytes, size_t size)
{
    epicsUInt8 *inbox = client->inbox;

    while (size) {
        epicsUInt8 *exact = malloc(size);
        long used;

        memcpy(exact, bytes, size);
        client->inbox = exact;
        client->filled = size;
        used = client->all->take(client);
        if (used == SIM_CLIENT_GONE) {
            free(inbox); /* the other one went with the client */
            return -1;
        }
        client->inbox = inbox;
        client->filled = 0;
        free(exact);
        fuzzCheck(used >= 0 && (size_t)used <= size);
        if (!used)
            return 0;
        bytes += used;
        size -= (size_t)used;
    }
    return client->queued > queuedMost ? -1 : 0;
}

static void leave(simClients *all)
{
    simClientsDrop(all, 0, "end");
    fuzzCheck(all->count == 0);
}

#ifdef FUZZ_MODBUS
int fuzzSimModbus(const epicsUInt8 *data, size_t size)
{
    simulator *sim = servers(0);
    simModbus *modbus = &((simModbusServer *)simPlcServerOf(&sim->plc[0],
                                                            &simModbusServerType))->modbus;
    simClient *client = connectTo(&modbus->clients);
    fuzzBytes b = {data, size};
    int gone = 0;

    clear(sim, &((simEipServer *)simPlcServerOf(&sim->plc[0], &simEipServerType))->eip);
    while (b.left && !gone) {
        unsigned how = fuzzTake(&b);
        size_t length;
        epicsUInt8 *frame = fuzzTakeMessage(&b, &length);

        if (how & 1 && length >= 7) { /* what is the same in all requests */
            frame[2] = frame[3] = 0;
            frame[4] = (epicsUInt8)((length - 6) >> 8);
            frame[5] = (epicsUInt8)(length - 6);
            frame[6] = 1;
        }
        gone = give(client, frame, length);
        free(frame);
    }
    leave(&modbus->clients);
    return 0;
}
#endif

/* Session, lengths and connection, so that a frame comes further. */
static void makeFit(const simEip *eip, const simEipClient *own, epicsUInt8 *f, size_t length,
                    unsigned how)
{
    if (length < SIM_EIP_HEADER || !(how & 1))
        return;
    simPutInt(f + 2, 2, 0, length - SIM_EIP_HEADER);
    simPutInt(f + 4, 4, 0, own->session);
    simPutInt(f + 20, 4, 0, 0);
    if (!(how & 2))
        return;
    if (how & 4 && length >= 46) {
        simPutInt(f, 2, 0, 0x70);
        memcpy(f + 24, "\0\0\0\0\0\0\2\0\xa1\0\4\0", 12);
        simPutInt(f + 36, 4, 0, eip->controller.connections.list[how >> 6].toTarget);
        simPutInt(f + 40, 2, 0, 0xb1);
        simPutInt(f + 42, 2, 0, length - 44);
    } else if (length >= 40) {
        simPutInt(f, 2, 0, 0x6f);
        memcpy(f + 24, "\0\0\0\0\0\0\2\0\0\0\0\0\xb2\0", 14);
        simPutInt(f + 38, 2, 0, length - 40);
    }
}

/* The first byte says of which make it is. */
int fuzzSimEip(const epicsUInt8 *data, size_t size)
{
    static const epicsUInt8 registers[28] = {0x65, 0, 4, [24] = 1};
    simulator *const makes[] = {servers(0), servers(1)}; /* both at the first call: it is not measured */
    simulator *sim = makes[size && data[0] & 8];
    simEip *eip = &((simEipServer *)simPlcServerOf(&sim->plc[0], &simEipServerType))->eip;
    simClient *client = connectTo(&eip->clients);
    fuzzBytes b = {data, size};
    int gone;

    clear(sim, eip);
    gone = give(client, registers, sizeof(registers));
    while (b.left && !gone) {
        unsigned how = fuzzTake(&b);
        size_t length;
        epicsUInt8 *frame = fuzzTakeMessage(&b, &length);

        makeFit(eip, client->own, frame, length, how);
        gone = give(client, frame, length);
        free(frame);
        fuzzCheck(eip->counts.largestAnswer <= SIM_EIP_ANSWER);
    }
    leave(&eip->clients);
    return 0;
}

/* --- Blocks, with tables ---------------------------------------------------------------------- */

#define BLOCKS_FILE \
    "in = 64\nout = 48\nport = off\nperiod = 1 h\nsync = on\n" \
    "db 10 32 Setpoints\ndb 11 64 Measured\ndb 12 16 Safety\n" \
    "init DB12.0 INT16 4711\ninit DB11.4 INT16 5\ninit DB10.16 INT16 99\n"

/* The IOC brings the tables, or they stand in the PLC: what is checked may be moved only so far. */
static const char *const blocksFiles[] = {
    BLOCKS_FILE "map = on\nmap_rows = 16\nallow write DB10 0 16\nallow read DB11\n",
    BLOCKS_FILE "rx 4 -> P#DB10.DBX0.0 BYTE 12\nrx IE_RX.DBW16 -> DB10.DBW12\n"
                "rx IE_RX.DBX18.3 -> DB10.DBX14.0\ntx DB11.DBD0 -> IE_TX.DBD8\n"};

enum { outSize = 48 };

/* 48 bytes for each block, behind one that says what is done with it; that of the first one also
 * which PLC it is. */
int fuzzSimBlocks(const epicsUInt8 *data, size_t size)
{
    fuzzBytes b = {data, size};
    simulator sim;
    simText out;
    simPlc *plc = &sim.plc[0];
    simBlock *safety, *measured, *setpoints;
    epicsUInt8 was[3][64];
    unsigned turns, i;

    fuzzCheck(fuzzSimBuild(&sim, blocksFiles[size && data[0] & 0x80], &out) == 0);
    safety = simMemoryFind(&plc->memory, SIM_AREA_DB, 12);
    measured = simMemoryFind(&plc->memory, SIM_AREA_DB, 11);
    setpoints = simMemoryFind(&plc->memory, SIM_AREA_DB, 10);
    memcpy(was[0], safety->bytes, 16);
    memcpy(was[1], measured->bytes, 64);
    memcpy(was[2], setpoints->bytes + 16, 16);
    plc->connected = 1;
    for (turns = 0; b.left && turns < 400; turns++) {
        epicsUInt8 *block = malloc(outSize);
        unsigned how = fuzzTake(&b);

        for (i = 0; i < outSize; i++)
            block[i] = (epicsUInt8)fuzzTake(&b);
        if (how & 1) { /* as the IOC would: the CRC of what is there */
            block[0] = 4;
            block[5] = (epicsUInt8)plc->program.tables.session;
        }
        simPlcCall(plc, block);
        if (how & 2)
            simPlcMake(plc);
        if ((how & 0x1c) == 0x1c)
            simPlcLocal(plc, (int)(how & 0x20));
        free(block);
        fuzzCheck(memcmp(was[0], safety->bytes, 16) == 0);
        fuzzCheck(memcmp(was[1], measured->bytes, 64) == 0);
        fuzzCheck(memcmp(was[2], setpoints->bytes + 16, 16) == 0);
    }
    fuzzSimEnd(&sim, &out);
    return 0;
}

/* --- The partner ------------------------------------------------------------------------------ */

/* The same simulator for all calls, as `servers`. */
static simulator *half(void)
{
    static const char file[] = "in = 16\nout = 16\nport = off\nperiod = 1 h\ndb 10 32\n"
                               "signal 0 INT16 counter\nsignal 4 REAL32 ramp 0 9 1s\n"
                               "signal 8 STRING[4] text a b 1s\n";
    static simulator sim;
    static simText out;
    static int made;

    if (!made) {
        fuzzCheck(fuzzSimBuild(&sim, file, &out) == 0);
        made = 1;
    }
    return &sim;
}

static void quit(void *loop)
{
    ((simLoop *)loop)->quit = 1;
}

/* One round of the loop: what has come is read. */
static void settle(simLoop *loop)
{
    simTimer now = {.armed = 0};

    simTimerSet(loop, &now, 0, quit, loop);
    simLoopRun(loop, 0);
    simTimerStop(loop, &now);
    loop->quit = 0;
}

/* A new link to the half that listens at `path`. */
static int dial(simLoop *loop, const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);

    strcpy(address.sun_path, path);
    fuzzCheck(fd >= 0 && connect(fd, (struct sockaddr *)&address, sizeof(address)) == 0);
    settle(loop);
    return fd;
}

/* What the half has sent: whole messages, each of a kind that there is. */
static void drain(int fd)
{
    static epicsUInt8 bytes[1 << 18];
    ssize_t got = recv(fd, bytes, sizeof(bytes), MSG_DONTWAIT);
    size_t at = 0, size;

    fuzzCheck(got < (ssize_t)sizeof(bytes));
    for (; got > 0 && at < (size_t)got; at += 4 + size) {
        fuzzCheck((size_t)got - at > 4);
        size = (size_t)simGetInt(bytes + at, 4, 1);
        fuzzCheck(size && size <= (size_t)got - at - 4 && strchr("SBH", bytes[at + 4]));
    }
}

/* A message, or bytes of which the fuzzer makes the length too. */
static void tell(int fd, const epicsUInt8 *message, size_t length, int raw)
{
    epicsUInt8 head[4];

    simPutInt(head, 4, 1, length);
    if (!raw)
        send(fd, head, sizeof(head), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (length)
        send(fd, message, length, MSG_NOSIGNAL | MSG_DONTWAIT);
}

static void partnerStep(simulator *sim, unsigned how)
{
    simPair *pair = &sim->pair[0];
    char error[SIM_ERROR_SIZE];

    if (how & 8)
        sim->plc[0].off = !sim->plc[0].off;
    if (how & 1)
        simPairPoll(pair);
    if (how & 2)
        simPlcMake(&sim->plc[0]);
    if (how & 16)
        simPairSwitch(pair, error);
    if (how & 32)
        simPairSplit(pair, !pair->split);
    fuzzCheck(sim->plc[0].epoch > -1e13 && sim->plc[0].epoch < 1e13);
}

/* Messages come over a socket, as from another process; of each the first byte says what is done
 * after it, and whether its length goes before it. */
int fuzzSimPartner(const epicsUInt8 *data, size_t size)
{
    simulator *sim = half();
    simPair *pair = &sim->pair[0];
    simPlc *plc = &sim->plc[0];
    fuzzBytes b = {data, size};
    char path[40];
    int fd;

    snprintf(path, sizeof(path), "/tmp/plclink-fuzz-%ld", (long)getpid());
    clearMemory(&plc->memory);
    plc->block = 0;
    plc->epoch = plc->off = 0;
    simPairInit(pair, &sim->loop, plc, 1, 1000, 0, "");
    fuzzCheck(simFibreOpen(&pair->fibre, path, 1) == 0);
    fd = dial(&sim->loop, path);
    while (b.left) {
        unsigned how = fuzzTake(&b);
        size_t length;
        epicsUInt8 *message = fuzzTakeMessage(&b, &length);

        tell(fd, message, length, how & 4);
        free(message);
        settle(&sim->loop);
        partnerStep(sim, how);
        drain(fd);
        if (how & 64 || pair->fibre.fd < 0) {
            close(fd);
            fd = dial(&sim->loop, path);
        }
    }
    close(fd);
    simPairStop(pair);
    return 0;
}
