/* One session with a PLC; see eipSession.h. */
#include <epicsStdio.h>

#include "eipSession.h"

static int fail(char *why, size_t size, const char *text)
{
    epicsSnprintf(why, size, "%s", text);
    return -1;
}

/* A context that no other request of this session has. */
static void nextContext(eipSession *s)
{
    s->count++;
    eipSetUnsigned(s->context, 4, s->count);
    eipSetUnsigned(s->context + 4, 4, s->opening.originator ^ (s->count * 2654435761u));
}

size_t eipSessionPlain(eipSession *s, eipCommand command, void *frame, size_t room)
{
    eipWriter w = eipWriterOf(frame, room);

    s->command = command;
    memset(s->context, 0, sizeof(s->context)); /* some PLCs take no other */
    eipFrameBegin(&w, command, command == eipListServices ? 0 : s->handle, NULL);
    if (command == eipRegisterSession) {
        eipPut16(&w, 1);
        eipPut16(&w, 0);
    }
    return eipFrameEnd(&w);
}

size_t eipSessionWrap(eipSession *s, eipWay way, const void *message, size_t length,
                      void *frame, size_t room)
{
    eipWriter w = eipWriterOf(frame, room);
    int connected = way == eipWayNormal && s->connected;

    s->service = length ? ((const epicsUInt8 *)message)[0] : 0;
    s->routed = way == eipWayNormal && !connected && s->route.length;
    s->command = connected ? eipSendUnitData : eipSendRRData;
    nextContext(s);
    eipFrameBegin(&w, s->command, s->handle, s->context);
    if (connected) {
        s->sequence = (s->sequence + 1) & 0xffff;
        eipItemsConnected(&w, s->opened.toPlc, s->sequence);
        eipPutBytes(&w, message, length);
    } else {
        eipItemsUnconnected(&w, s->routeTimeout / 1000 + 1);
        if (s->routed)
            eipUnconnectedSendPut(&w, message, length, &s->route, s->routeTimeout);
        else
            eipPutBytes(&w, message, length);
    }
    eipItemsEnd(&w);
    return eipFrameEnd(&w);
}

/* The header of an answer. Returns 0 or -1 with why. */
static int takeHeader(const eipSession *s, eipReader *r, eipHeader *h, char *why,
                      size_t size)
{
    if (eipHeaderTake(r, h))
        return fail(why, size, "answer of wrong length");
    if (h->command != s->command)
        return fail(why, size, "answer to another command");
    if (h->options != 0)
        return fail(why, size, "answer with options");
    return 0;
}

int eipSessionPlainTake(const eipSession *s, const void *frame, size_t length,
                        eipReader *data, epicsUInt32 *status, epicsUInt32 *handle,
                        char *why, size_t size)
{
    eipHeader h;

    *data = eipReaderOf(frame, length);
    if (takeHeader(s, data, &h, why, size))
        return -1;
    if (memcmp(h.context, s->context, sizeof(h.context)))
        return fail(why, size, "answer to another request");
    *status = h.status;
    *handle = h.session;
    return 0;
}

/* On a connection a PLC may leave the context out: the sequence count tells. */
static int isContext(const eipSession *s, const epicsUInt8 *context)
{
    static const epicsUInt8 none[eipContextSize];

    return memcmp(context, s->context, eipContextSize) == 0 ||
           (s->command == eipSendUnitData && memcmp(context, none, eipContextSize) == 0);
}

/* Some say so of a connection that they do not know any more, others by its status. */
static int isForgotten(const eipSession *s, const eipHeader *h)
{
    return s->command == eipSendUnitData && h->status == 1 && !h->length;
}

int eipSessionUnwrap(const eipSession *s, const void *frame, size_t length,
                     eipAnswer *answer, char *why, size_t size)
{
    eipReader r = eipReaderOf(frame, length);
    eipHeader h;
    eipItems items;

    if (takeHeader(s, &r, &h, why, size))
        return -1;
    if (h.status && !isForgotten(s, &h)) {
        epicsSnprintf(why, size, "%s", eipFrameStatusText(h.status));
        return -1;
    }
    if (h.session != s->handle)
        return fail(why, size, "answer to another session");
    if (!isContext(s, h.context))
        return fail(why, size, "answer to another request");
    if (h.status) {
        *answer = (eipAnswer){.service = s->service, .status = eipConnectionFailure,
                              .extended = eipExtNoConnection};
        return 0;
    }
    if (eipItemsTake(&r, s->command, &items))
        return fail(why, size, "answer not understood");
    if (s->command == eipSendUnitData && items.connection != s->opened.fromPlc &&
        items.connection != s->opened.toPlc) /* some give the id of the request back */
        return fail(why, size, "answer on another connection");
    if (s->command == eipSendUnitData && items.sequence != s->sequence)
        return fail(why, size, "answer out of sequence");
    if (s->routed && eipIsRouteFailure(items.message, items.length, s->service)) {
        eipAnswerTake(items.message, items.length, eipUnconnectedSend, answer);
        answer->service = s->service;
        return 0;
    }
    if (eipAnswerTake(items.message, items.length, s->service, answer))
        return fail(why, size, "answer to another service");
    return 0;
}
