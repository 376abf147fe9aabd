/* Blocks of fixed sizes on a connection, both ways; see plcBlocks.h. */
#include <stdlib.h>

#include <cantProceed.h>

#include "plcBlocks.h"
#include "plcFraming.h"

typedef struct blocks {
    plcFraming *framing; /* of what comes */
    char *out;           /* the block that leaves, */
    size_t outSize;
    size_t sent;         /* and its bytes that are with the kernel; outSize: all */
} blocks;

static void *create(const plcTransportSetup *setup, const void *own)
{
    blocks *b = callocMustSucceed(1, sizeof(*b), "plcBlocks");

    (void)own;
    b->framing = plcFramingCreate(setup->inSize);
    b->out = callocMustSucceed(1, setup->outSize + 1, "plcBlocks");
    b->outSize = b->sent = setup->outSize;
    return b;
}

static void destroy(void *pvt)
{
    blocks *b = pvt;

    plcFramingDestroy(b->framing);
    free(b->out);
    free(b);
}

static void connected(void *pvt, plcConnection *c)
{
    blocks *b = pvt;

    plcFramingReset(b->framing);
    b->sent = b->outSize;
    plcConnectionSmall(c, b->outSize);
}

static void look(const plcFraming *framing, plcCame *came)
{
    plcFramingVerdict verdict = plcFramingJudge(framing);

    came->count = verdict == plcFramingTrusted ? plcFramingCount(framing) : 0;
    came->block = came->count ? plcFramingNewest(framing) : NULL;
    came->wrong = verdict == plcFramingWrong;
    came->burst = plcFramingBurst(framing);
    came->doubts = plcFramingDoubts(framing);
}

static int receive(void *pvt, plcConnection *c, epicsUInt64 now, plcCame *came)
{
    plcFraming *framing = ((blocks *)pvt)->framing;
    size_t room;
    void *space;
    int got;

    plcFramingConsume(framing); /* those of the call before */
    space = plcFramingSpace(framing, &room);
    got = plcConnectionReceive(c, space, room, now);
    if (got > 0)
        plcFramingAdd(framing, (size_t)got, now);
    look(framing, came);
    came->more = got > 0 && (size_t)got == room;
    return got;
}

static void giveUp(void *pvt, plcCame *came)
{
    plcFraming *framing = ((blocks *)pvt)->framing;

    plcFramingGiveUp(framing);
    look(framing, came);
    came->more = 0;
}

static char *space(void *pvt)
{
    return ((blocks *)pvt)->out;
}

static int sendOut(void *pvt, plcConnection *c, int begin, epicsUInt64 now)
{
    blocks *b = pvt;
    int count;

    if (begin)
        b->sent = 0;
    while (b->sent < b->outSize) {
        count = plcConnectionSend(c, b->out + b->sent, b->outSize - b->sent, now);
        if (count <= 0)
            return count;
        b->sent += (size_t)count;
    }
    return 1;
}

static int sending(const void *pvt)
{
    const blocks *b = pvt;

    return b->sent < b->outSize;
}

const plcTransport plcBlocks = {.name = "",
                                .prefix = "",
                                .syncs = 1,
                                .create = create,
                                .destroy = destroy,
                                .connected = connected,
                                .receive = receive,
                                .giveUp = giveUp,
                                .space = space,
                                .send = sendOut,
                                .sending = sending};
