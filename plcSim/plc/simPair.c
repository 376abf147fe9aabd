/* simPair: one half of a redundant pair: who leads, and memory kept in step.
 *
 * Messages on the fibre, big-endian:
 *
 *   'S' flags since(8) epoch(8) block(8)     state: 1 PRIMARY 2 net 4 ready
 *   'B' area number(2) bytes ...             a block of memory
 *   'H'                                      lead, at once
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <math.h>
#include <net/if.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cantProceed.h>

#include "simPair.h"
#include "simValue.h"

#define STATE_SIZE 26
#define BLOCK_HEAD 4
#define FLAG_PRIMARY 1
#define FLAG_NET 2
#define FLAG_READY 4

static void onTick(void *arg);
static void share(simPair *pair);
static void consider(simPair *pair);

/* ---- the decision ---- */

int simPairDecide(const simPairView *v)
{
    int mine = 4 * v->net + 2 * v->ready + v->isFirst;
    int theirs = 4 * v->partnerNet + 2 * v->partnerReady + !v->isFirst;

    if (v->split)
        return 1;
    if (!v->heard)
        return v->isPrimary || v->vacant >= v->switchover;
    if (v->isPrimary && v->partnerPrimary) {
        if (v->net != v->partnerNet)
            return v->net;
        /* who has led longer stays */
        return v->since < v->partnerSince || (v->since == v->partnerSince && v->isFirst);
    }
    if (v->isPrimary)
        return v->net || !v->partnerNet;
    if (v->partnerPrimary)
        return 0;
    return mine > theirs && v->vacant >= v->switchover;
}

static int isHeard(const simPair *pair)
{
    return simFibreIsUp(&pair->fibre) && !pair->split &&
           simNow() - pair->heardTime < pair->switchover / 2;
}

/* Also in the moment before watchPower() has seen it: its memory is cleared by then. */
static int isOff(const simPair *pair)
{
    return pair->off || pair->plc->off;
}

/* ---- messages out ---- */

static epicsUInt64 doubleBits(double value)
{
    epicsUInt64 bits;

    memcpy(&bits, &value, sizeof(bits));
    return bits;
}

static double bitsDouble(epicsUInt64 bits)
{
    double value;

    memcpy(&value, &bits, sizeof(value));
    return value;
}

/* Of a message: s, as simNow; what is no time is now. */
static double timeOf(const epicsUInt8 *p)
{
    double time = bitsDouble(simGetInt(p, 8, 1));

    return fabs(time) < 1e12 ? time : simNow();
}

static void sendState(simPair *pair)
{
    epicsUInt8 m[STATE_SIZE];

    if (pair->split || isOff(pair))
        return;
    share(pair); /* a state from the PRIMARY says: you have all of my memory */
    m[0] = 'S';
    m[1] = (epicsUInt8)((pair->isPrimary ? FLAG_PRIMARY : 0) |
                        (pair->net ? FLAG_NET : 0) | (pair->ready ? FLAG_READY : 0));
    simPutInt(m + 2, 8, 1, doubleBits(pair->since));
    simPutInt(m + 10, 8, 1, doubleBits(pair->plc->epoch));
    simPutInt(m + 18, 8, 1, pair->plc->block);
    simFibreSend(&pair->fibre, m, sizeof(m));
}

static void forgetShadows(simPair *pair)
{
    size_t i;

    for (i = 0; i < pair->shadowCount; i++) {
        free(pair->shadows[i]);
        pair->shadows[i] = NULL;
    }
}

static void sendBlock(simPair *pair, size_t index)
{
    static epicsUInt8 m[SIM_MAX_MESSAGE];
    const simBlock *block = pair->plc->memory.blocks[index];
    epicsUInt8 *shadow = pair->shadows[index];

    if (shadow && !memcmp(shadow, block->bytes, block->size))
        return;
    m[0] = 'B';
    m[1] = (epicsUInt8)block->area;
    simPutInt(m + 2, 2, 1, block->number);
    memcpy(m + BLOCK_HEAD, block->bytes, block->size);
    if (simFibreSend(&pair->fibre, m, BLOCK_HEAD + block->size))
        return;
    if (!shadow)
        shadow = pair->shadows[index] = mallocMustSucceed(block->size, "simPair");
    memcpy(shadow, block->bytes, block->size);
}

/* The PRIMARY's memory goes to the partner, as far as it changed. */
static void share(simPair *pair)
{
    size_t i;

    if (!pair->isPrimary || pair->split || isOff(pair) || !simFibreIsUp(&pair->fibre))
        return;
    for (i = 0; i < pair->shadowCount; i++)
        sendBlock(pair, i);
}

/* The PLC took a block from the IOC or sent one: both must survive this PLC. */
static void onChanged(void *arg)
{
    sendState(arg);
}

/* ---- the role ---- */

static void setRole(simPair *pair, int isPrimary, const char *reason)
{
    if (pair->isPrimary == isPrimary)
        return;
    pair->isPrimary = isPrimary;
    pair->since = simNow();
    pair->ready = isPrimary;
    simLog(pair->plc->name, "%s: %s", isPrimary ? "PRIMARY" : "BACKUP", reason);
    if (isPrimary) {
        pair->takeovers++;
        forgetShadows(pair);
        share(pair);
    }
    simPlcLead(pair->plc, isPrimary);
    sendState(pair);
}

/* When its cable is out, or its carrier gone. */
static int cablePlugged(const simPair *pair)
{
    struct ifreq request;
    int fd, plugged;

    if (pair->plc->unplugged)
        return 0;
    if (!pair->interface[0])
        return 1;
    fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return 1;
    memset(&request, 0, sizeof(request));
    snprintf(request.ifr_name, sizeof(request.ifr_name), "%.15s", pair->interface);
    plugged = ioctl(fd, SIOCGIFFLAGS, &request) == 0 && request.ifr_flags & IFF_UP &&
              request.ifr_flags & IFF_RUNNING;
    close(fd);
    return plugged;
}

static void watchCable(simPair *pair)
{
    int net = cablePlugged(pair);

    if (net == pair->net)
        return;
    pair->net = net;
    simLog(pair->plc->name, net ? "network cable plugged" : "network cable unplugged");
    sendState(pair);
}

static const char *reasonText(const simPairView *v, int lead)
{
    if (v->split)
        return "leads without asking";
    if (lead)
        return v->heard ? "no PRIMARY in sight" : "the partner is silent";
    return v->partnerPrimary ? "the partner leads too"
                             : "no network here, the partner has one";
}

/* Looks at the situation and takes or gives up the lead. */
static void consider(simPair *pair)
{
    simPairView v;
    int lead;

    v.isFirst = pair->isFirst;
    v.isPrimary = pair->isPrimary;
    v.net = pair->net;
    v.ready = pair->ready;
    v.split = pair->split;
    v.heard = isHeard(pair);
    v.partnerPrimary = pair->partnerPrimary;
    v.partnerNet = pair->partnerNet;
    v.partnerReady = pair->partnerReady;
    v.since = pair->since;
    v.partnerSince = pair->partnerSince;
    v.vacant = simNow() - pair->primarySeen;
    v.switchover = pair->switchover;
    lead = simPairDecide(&v);
    if (lead != pair->isPrimary)
        setRole(pair, lead, reasonText(&v, lead));
}

/* ---- messages in ---- */

static void takeState(simPair *pair, const epicsUInt8 *m)
{
    int wasReady = pair->partnerReady;

    pair->heardTime = simNow();
    pair->partnerPrimary = (m[1] & FLAG_PRIMARY) != 0;
    pair->partnerNet = (m[1] & FLAG_NET) != 0;
    pair->partnerReady = (m[1] & FLAG_READY) != 0;
    pair->partnerSince = timeOf(m + 2);
    if (pair->partnerPrimary) {
        pair->primarySeen = pair->heardTime;
        if (!pair->isPrimary) {
            /* it sends its memory before its state, so all of it is here */
            pair->ready = 1;
            pair->plc->epoch = timeOf(m + 10);
            pair->plc->block = simGetInt(m + 18, 8, 1);
        }
    }
    if (wasReady && !pair->partnerReady)
        forgetShadows(pair);
    consider(pair);
}

static void takeBlock(simPair *pair, const epicsUInt8 *m, size_t size)
{
    unsigned number = (unsigned)simGetInt(m + 2, 2, 1);
    simBlock *block = simMemoryFind(&pair->plc->memory, m[1], number);

    if (pair->isPrimary)
        return;
    if (!block || block->size != size - BLOCK_HEAD) {
        simComplain(pair->plc->name,
                    "fibre: the partner has another DB%u: start both with the "
                    "same file",
                    number);
        return;
    }
    memcpy(block->bytes, m + BLOCK_HEAD, block->size);
}

static void onMessage(void *owner, const epicsUInt8 *m, size_t size)
{
    simPair *pair = owner;

    if (pair->split || isOff(pair))
        return;
    if (m[0] == 'S' && size == STATE_SIZE)
        takeState(pair, m);
    else if (m[0] == 'B' && size > BLOCK_HEAD)
        takeBlock(pair, m, size);
    else if (m[0] == 'H' && size == 1)
        setRole(pair, 1, "the partner hands over");
}

static void onUp(void *owner)
{
    simPair *pair = owner;

    forgetShadows(pair);
    share(pair);
    sendState(pair);
}

/* ---- life ---- */

/* A PLC that is off says nothing, and knows nothing when it is back. */
static void watchPower(simPair *pair)
{
    if (pair->plc->off == pair->off)
        return;
    pair->off = pair->plc->off;
    pair->split = 0;
    pair->primarySeen = simNow();
    pair->heardTime = 0;
    pair->ready = 0;
    if (pair->off && pair->isPrimary)
        setRole(pair, 0, "off");
    pair->ready = 0;
}

void simPairPoll(simPair *pair)
{
    watchPower(pair);
    if (pair->off)
        return;
    watchCable(pair);
    /* In one process nobody is silent because the machine was busy. */
    if (pair->fibre.peer)
        sendState(pair->fibre.peer->owner);
    sendState(pair);
    consider(pair);
}

static void onTick(void *arg)
{
    simPair *pair = arg;
    double period = pair->switchover / 10;
    double now = simNow();
    double takeover;
    double late = pair->nextTick > 0 ? now - pair->nextTick : 0;

    if (period > 0.05)
        period = 0.05;
    if (late > period) {
        /* this process stood still: that is no silence of the partner */
        pair->primarySeen += late;
        pair->heardTime += late;
    }
    pair->nextTick = now + period;
    takeover = pair->primarySeen + pair->switchover;
    if (takeover > now && takeover < pair->nextTick)
        pair->nextTick = takeover;
    simTimerSet(pair->loop, &pair->tick, pair->nextTick, onTick, pair);
    simPairPoll(pair);
}

void simPairInit(simPair *pair, simLoop *loop, simPlc *plc, int isFirst,
                 double switchover, double wait, const char *interface)
{
    memset(pair, 0, sizeof(*pair));
    pair->loop = loop;
    pair->plc = plc;
    pair->isFirst = isFirst;
    pair->net = 1;
    pair->switchover = switchover;
    pair->since = simNow();
    pair->primarySeen = simNow() + wait - switchover;
    snprintf(pair->interface, sizeof(pair->interface), "%s", interface);
    pair->shadowCount = plc->memory.count;
    pair->shadows =
        callocMustSucceed(pair->shadowCount, sizeof(*pair->shadows), "simPair");
    pair->fibre.loop = loop;
    pair->fibre.name = plc->name;
    pair->fibre.message = onMessage;
    pair->fibre.up = onUp;
    pair->fibre.owner = pair;
    pair->fibre.listener = pair->fibre.fd = -1;
    plc->passive = 1;
    plc->changed = onChanged;
    plc->changedArg = pair;
}

void simPairStart(simPair *pair)
{
    onTick(pair);
}

void simPairStop(simPair *pair)
{
    if (!pair->loop)
        return;
    simTimerStop(pair->loop, &pair->tick);
    simFibreClose(&pair->fibre);
    forgetShadows(pair);
    free(pair->shadows);
    pair->shadows = NULL;
    pair->shadowCount = 0;
}

int simPairSwitch(simPair *pair, char error[SIM_ERROR_SIZE])
{
    static const epicsUInt8 handOver = 'H';

    if (!pair->isPrimary)
        return simFail(error, "this PLC is not PRIMARY");
    if (!isHeard(pair))
        return simFail(error, "the partner is not there");
    if (!pair->partnerNet)
        return simFail(error, "the partner has no network");
    share(pair);
    setRole(pair, 0, "hands over");
    pair->primarySeen = simNow();
    pair->ready = 1;
    simFibreSend(&pair->fibre, &handOver, 1);
    return 0;
}

void simPairSplit(simPair *pair, int on)
{
    if (pair->split == on)
        return;
    pair->split = on;
    simLog(pair->plc->name,
           on ? "fibre cut: leads without asking" : "fibre joined again");
    if (!on) {
        pair->heardTime = 0;
        pair->primarySeen = simNow();
        forgetShadows(pair);
    }
}

void simPairStatus(const simPair *pair, simText *out)
{
    simTextAdd(out, "role: %s for %.3f s, cable %s, fibre %s, partner %s, %u takeovers\n",
               pair->isPrimary ? "PRIMARY" : "BACKUP", simNow() - pair->since,
               pair->net ? "plugged" : "unplugged",
               pair->split                  ? "cut"
               : simFibreIsUp(&pair->fibre) ? "up"
                                            : "down",
               !isHeard(pair)         ? "silent"
               : pair->partnerPrimary ? "PRIMARY"
                                      : "BACKUP",
               pair->takeovers);
}
