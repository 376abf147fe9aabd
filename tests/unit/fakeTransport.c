/* See fakeTransport.h. */
#include <string.h>

#include <epicsAtomic.h>

#include "fakeTransport.h"

fakeState fake;

static plcTransportSetup made;

void fakeReset(void)
{
    memset(&fake, 0, sizeof(fake));
}

static void *create(const plcTransportSetup *setup, const void *own)
{
    made = *setup;
    return &made;
}

static void nothing(void *pvt)
{
    (void)pvt;
}

static void options(void *pvt, const struct plcOptions *o)
{
    (void)pvt, (void)o;
}

static double longestPause(void *pvt, const struct plcOptions *o)
{
    (void)pvt, (void)o;
    return epicsAtomicGetIntT(&fake.pause);
}

static void takeWhole(const epicsUInt8 *out)
{
    size_t i;
    int n = 0;

    for (i = 0; out && i < made.outSize; i++)
        n += out[i] != 0;
    epicsAtomicSetIntT(&fake.whole, n);
}

static void up(void *pvt, SOCKET socket, const epicsUInt8 *in, const epicsUInt8 *out)
{
    (void)pvt, (void)socket, (void)in;
    takeWhole(out);
    epicsAtomicIncrIntT(&fake.ups);
}

static void whole(void *pvt, const epicsUInt8 *in, const epicsUInt8 *out)
{
    (void)pvt, (void)in;
    takeWhole(out);
    epicsAtomicIncrIntT(&fake.wholes);
}

static void down(void *pvt)
{
    (void)pvt;
    epicsAtomicIncrIntT(&fake.downs);
}

static int news(void *pvt, plcNews *n, void *input, void *output)
{
    (void)pvt;
    memset(n, 0, sizeof(*n));
    n->idle = 1;
    if (epicsAtomicGetIntT(&fake.ups) == epicsAtomicGetIntT(&fake.downs))
        return 0;
    if (epicsAtomicGetIntT(&fake.works)) {
        n->requests = 1;
        n->blocks = made.inSize != 0;
        epicsTimeGetCurrent(&n->stamp);
        memset(input, 7, made.inSize);
    }
    n->shown = epicsAtomicCmpAndSwapIntT(&fake.shows, 1, 2) == 1;
    if (n->shown) {
        memcpy(output, fake.output, made.outSize);
        epicsAtomicCmpAndSwapIntT(&fake.shows, 2, 0); /* now it may have others */
    }
    n->lost = epicsAtomicCmpAndSwapIntT(&fake.lost, 1, 0);
    if (n->lost)
        strcpy(n->why, "no answer");
    n->outFaults = epicsAtomicCmpAndSwapIntT(&fake.faults, 1, 0);
    return 1;
}

static void put(void *pvt, const void *image, const void *mask)
{
    (void)pvt, (void)image, (void)mask;
    epicsAtomicIncrIntT(&fake.puts);
}

/* takes: takesPuts */
#define FAKE(takes)                                                                        \
    {                                                                                      \
        .name = "fake", .prefix = "fake ", .shows = 1, .takesPuts = takes,                 \
        .create = create, .destroy = nothing, .begin = nothing, .end = nothing,            \
        .pause = longestPause, .options = options, .up = up, .whole = whole, .down = down, \
        .news = news, .put = put                                                           \
    }

const plcTransport fakeTransport = FAKE(0);
const plcTransport fakeTransportPuts = FAKE(1);
