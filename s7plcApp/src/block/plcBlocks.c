/* Blocks of a fixed size off a connection; see plcBlocks.h. */
#include "plcBlocks.h"
#include "plcFraming.h"

static void *create(size_t blockSize)
{
    return plcFramingCreate(blockSize);
}

static void destroy(void *pvt)
{
    plcFramingDestroy(pvt);
}

static void up(void *pvt)
{
    plcFramingReset(pvt);
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
    plcFraming *framing = pvt;
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
    plcFramingGiveUp(pvt);
    look(pvt, came);
    came->more = 0;
}

const plcReader plcBlocks = {
    .create = create, .destroy = destroy, .up = up, .receive = receive, .giveUp = giveUp};
