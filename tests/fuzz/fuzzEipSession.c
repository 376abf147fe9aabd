/* Fuzz target: the answers of a PLC over EtherNet/IP on the way to a session, and on it. What is
 * taken out of a frame lies in the frame; what is asked fits into a connection. */
#include <stdlib.h>
#include <string.h>

#include "eipConnect.h"
#include "fuzz.h"

fuzzTarget fuzzEipSession;

enum { room = 5000 };

static void inside(const void *at, size_t n, const epicsUInt8 *frame, size_t length)
{
    const epicsUInt8 *from = at;

    fuzzCheck(n == 0 || (from >= frame && from + n <= frame + length));
}

/* The numbers of the connection that is asked for, as a PLC that opens it repeats them. */
static void open(const eipOpening *o, epicsUInt8 *data)
{
    eipSetUnsigned(data + 4, 4, o->id);
    eipSetUnsigned(data + 8, 2, o->serial);
    eipSetUnsigned(data + 10, 2, o->vendor);
    eipSetUnsigned(data + 12, 4, o->originator);
}

/* What is the same in an answer as in its request is put there in three of four cases: else
 * no frame would come far. */
static void makeFit(const eipSession *s, epicsUInt8 *frame, size_t length, unsigned how)
{
    if (!(how & 3) || length < eipHeaderSize)
        return;
    eipSetUnsigned(frame, 2, s->command);
    eipSetUnsigned(frame + 2, 2, length - eipHeaderSize);
    if (s->handle)
        eipSetUnsigned(frame + 4, 4, s->handle);
    eipSetUnsigned(frame + 8, 4, 0);
    memcpy(frame + 12, s->context, eipContextSize);
    eipSetUnsigned(frame + 20, 4, 0);
    if (!(how & 4) || s->command < eipSendRRData)
        return;
    if (s->command == eipSendUnitData && length >= 50) {
        static const epicsUInt8 items[] = {0, 0, 0, 0, 0, 0, 2, 0, 0xa1, 0, 4, 0};

        memcpy(frame + 24, items, sizeof(items));
        eipSetUnsigned(frame + 36, 4, s->opened.fromPlc);
        eipSetUnsigned(frame + 40, 2, 0xb1);
        eipSetUnsigned(frame + 42, 2, length - 44);
        eipSetUnsigned(frame + 44, 2, s->sequence);
        frame[46] = (epicsUInt8)(s->service | 0x80);
        frame[47] = 0;
    } else if (s->command == eipSendRRData && length >= 44) {
        static const epicsUInt8 items[] = {0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0xb2, 0};

        memcpy(frame + 24, items, sizeof(items));
        eipSetUnsigned(frame + 38, 2, length - 40);
        frame[40] = (epicsUInt8)(s->service | 0x80);
        frame[41] = 0;
        if (how & 8 && length >= 60 && (s->service == eipForwardOpen || s->service == eipLargeForwardOpen)) {
            frame[42] = frame[43] = 0;
            open(&s->opening, frame + 44);
        }
    }
}

static void takeApart(const eipAnswer *a, const epicsUInt8 *frame, size_t length)
{
    char text[64];
    unsigned count, i;

    inside(a->data, a->length, frame, length);
    eipStatusText(a->status, a->extended, text, sizeof(text));
    fuzzCheck(strlen(text) <= 39);
    for (count = 1; count < 5; count++)
        for (i = 0; i < count; i++) {
            size_t n = 0;
            const epicsUInt8 *one = eipMultipleTake(a, count, i, &n);

            if (one)
                inside(one, n, frame, length);
        }
}

/* Any request of a session that is up. */
static void talk(eipConnect *c, fuzzBytes *b)
{
    epicsUInt8 *frame = malloc(room), message[40], *answer;
    char why[60] = "";
    size_t n = fuzzTake(b) % sizeof(message), i, length;
    unsigned how;
    eipAnswer a;

    for (i = 0; i < n; i++)
        message[i] = (epicsUInt8)(i ? fuzzTake(b) : fuzzTake(b) & 0x7f);
    fuzzCheck(eipSessionWrap(&c->session, fuzzTake(b) & 1 ? eipWayNormal : eipWayHere, message, n,
                             frame, room));
    how = fuzzTake(b);
    answer = fuzzTakeMessage(b, &length);
    makeFit(&c->session, answer, length, how);
    if (eipSessionUnwrap(&c->session, answer, length, &a, why, sizeof(why)))
        fuzzCheck(why[0] && strlen(why) <= 39);
    else
        takeApart(&a, answer, length);
    free(answer);
    free(frame);
}

static void way(eipConnect *c, fuzzBytes *b)
{
    epicsUInt8 *frame = malloc(room), *answer;
    char why[60];
    size_t length;
    unsigned turns = 0;

    eipConnectBegin(c, fuzzTake(b));
    while (eipConnectNext(c, frame, room)) {
        unsigned how = fuzzTake(b);
        int lost;

        fuzzCheck(turns++ < 100); /* it ends, whatever the PLC says */
        fuzzCheck(c->session.opening.size <= 65535);
        if (how & 0x80) {
            eipConnectNoAnswer(c);
            break;
        }
        answer = fuzzTakeMessage(b, &length);
        makeFit(&c->session, answer, length, how);
        why[0] = 0;
        lost = eipConnectTake(c, answer, length, why, sizeof(why));
        free(answer);
        fuzzCheck(strlen(why) <= 39);
        if (lost) {
            fuzzCheck(why[0]);
            break;
        }
    }
    if (c->step == eipStepDone)
        fuzzCheck(c->room >= 64 && c->room <= 65535);
    free(frame);
}

int fuzzEipSession(const epicsUInt8 *data, size_t size)
{
    fuzzBytes b = {data, size};
    unsigned how = fuzzTake(&b);
    eipConnectOptions options = {.connected = how & 1, .size = how & 2 ? eipSizeLarge : 500,
                                 .room = eipUnconnectedRoom, .timeout = 1000};
    epicsUInt8 frame[200];
    char text[64];
    eipConnect *c = malloc(sizeof(*c));

    if (how & 4)
        eipRouteParse("1,0", &options.route, text, sizeof(text));
    eipConnectInit(c, &options);
    while (b.left) {
        way(c, &b);
        while (c->step == eipStepDone && b.left && fuzzTake(&b) & 7)
            talk(c, &b);
        eipConnectText(c, text, sizeof(text));
        eipConnectClose(c, frame, sizeof(frame));
    }
    free(c);
    return 0;
}
