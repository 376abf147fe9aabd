/* Fuzz target: a stream of bytes cut into blocks, as bursts of any length at any time. Each block
 * that is shown is the piece of the stream where it must be. */
#include <stdlib.h>
#include <string.h>

#include "fuzz.h"
#include "plcFraming.h"

fuzzTarget fuzzFraming;

enum { streamMax = 1 << 17 };

typedef struct stream {
    plcFraming *framing;
    size_t block;     /* bytes */
    epicsUInt8 *bytes; /* all that came on this connection */
    size_t length;
} stream;

static void look(stream *s)
{
    size_t count = plcFramingCount(s->framing);
    const void *newest = plcFramingNewest(s->framing);
    plcFramingVerdict verdict = plcFramingJudge(s->framing);

    fuzzCheck((count == 0) == (newest == NULL));
    fuzzCheck(verdict <= plcFramingWrong);
    fuzzCheck(!count || verdict != plcFramingDoubt);
    (void)plcFramingBurst(s->framing);
    if (!newest)
        return;
    fuzzCheck(s->block && count <= s->length / s->block);
    fuzzCheck(memcmp(newest, s->bytes + (s->length / s->block - 1) * s->block, s->block) == 0);
}

/* `n` bytes come at the time `now`, in as many pieces as there is room for. */
static void arrive(stream *s, size_t n, epicsUInt64 now, unsigned salt)
{
    while (n && s->length < streamMax && plcFramingJudge(s->framing) != plcFramingWrong) {
        size_t room = 0, i;
        epicsUInt8 *at;

        plcFramingConsume(s->framing); /* as the reader of a station does */
        at = plcFramingSpace(s->framing, &room);
        fuzzCheck(room > 0);
        if (room > n)
            room = n;
        if (room > streamMax - s->length)
            room = streamMax - s->length;
        for (i = 0; i < room; i++)
            at[i] = s->bytes[s->length + i] = (epicsUInt8)((s->length + i) * 31 + salt);
        s->length += room;
        n -= room;
        plcFramingAdd(s->framing, room, now);
        look(s);
    }
}

int fuzzFraming(const epicsUInt8 *data, size_t size)
{
    fuzzBytes b = {data, size};
    stream s = {.block = fuzzTake16(&b) % 2000};
    epicsUInt64 now = 1000000;

    s.framing = plcFramingCreate(s.block);
    s.bytes = malloc(streamMax);
    while (b.left && plcFramingJudge(s.framing) != plcFramingWrong) {
        unsigned what = fuzzTake(&b);

        now += (epicsUInt64)fuzzTake(&b) * (what & 8 ? 1000000u : 20000u);
        switch (what & 7) {
        case 0:
            plcFramingConsume(s.framing);
            fuzzCheck(plcFramingCount(s.framing) == 0);
            break;
        case 1:
            if (what & 0x70)
                break;
            plcFramingReset(s.framing);
            s.length = 0;
            break;
        case 2:
            if (!(what & 0x70))
                plcFramingGiveUp(s.framing);
            break;
        case 3: /* as many as a block has, and more or less */
            arrive(&s, s.block + fuzzTake(&b) % 8, now, what);
            break;
        case 4:
            arrive(&s, s.block * (1 + fuzzTake(&b) % 4), now, what);
            break;
        case 5:
            arrive(&s, fuzzTake16(&b) % 9000, now, what);
            break;
        default:
            arrive(&s, s.block ? s.block : 1, now, what);
        }
        look(&s);
    }
    plcFramingDestroy(s.framing);
    free(s.bytes);
    return 0;
}
