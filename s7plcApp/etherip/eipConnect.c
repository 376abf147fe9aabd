/* From a TCP connection to a session; see eipConnect.h. */
#include <epicsStdio.h>

#include "eipConnect.h"

enum {
    ourVendor = 0x6c70,
    interval = 2000000, /* us */
    multiplier = 2,     /* x 16: 32 s without a message are too long */
    triesMax = 4,
    patienceMax = 1024, /* sessions */
    listServicesHead = 2,
    canTcp = 0x20, /* capability: CIP over TCP */
    omronMultiple = 32,
    largest511 = 511
};

void eipConnectInit(eipConnect *c, const eipConnectOptions *options)
{
    memset(c, 0, sizeof(*c));
    c->options = *options;
}

static void advance(eipConnect *c, eipStep step)
{
    while (step < eipStepDone &&
           (c->skip & 1u << step || (!c->options.connected && step >= eipStepLarge) ||
            (step == eipStepLarge && c->options.size <= largest511)))
        step++;
    c->step = step;
    c->tries = 0;
    if (step == eipStepLarge || step == eipStepSmall) {
        unsigned most = step == eipStepLarge ? 65535 : eipSizeSmall;

        c->session.opening.large = step == eipStepLarge;
        c->session.opening.size = c->options.size < most ? c->options.size : most;
    }
}

/* Another number each time. */
static epicsUInt32 number(eipConnect *c)
{
    c->seed = c->seed * 1664525u + 1013904223u;
    return c->seed ^ c->seed >> 15;
}

static void newTriad(eipConnect *c)
{
    eipOpening *o = &c->session.opening;

    o->serial = number(c) & 0xffff;
    o->id = number(c) | 1;
}

void eipConnectBegin(eipConnect *c, epicsUInt32 seed)
{
    eipSession *s = &c->session;

    memset(s, 0, sizeof(*s));
    memset(&c->identity, 0, sizeof(c->identity));
    c->seed ^= seed;
    s->route = c->options.route;
    s->routeTimeout = c->options.timeout;
    s->opening.vendor = ourVendor;
    s->opening.originator = number(c);
    s->opening.interval = interval;
    s->opening.multiplier = multiplier;
    newTriad(c);
    c->learned = 0;
    c->room = c->options.room;
    c->multiple = 0;
    advance(c, eipStepList);
}

size_t eipConnectNext(eipConnect *c, void *frame, size_t room)
{
    epicsUInt8 message[256];
    eipWriter w = eipWriterOf(message, sizeof(message));
    epicsUInt8 path[12];

    switch (c->step) {
    case eipStepList:
        return eipSessionPlain(&c->session, eipListServices, frame, room);
    case eipStepRegister:
        return eipSessionPlain(&c->session, eipRegisterSession, frame, room);
    case eipStepIdentity:
        eipRequestPut(&w, eipGetAttributesAll, path, eipObjectPath(path, 1, 1, 0));
        return eipSessionWrap(&c->session, eipWayNormal, message, w.n, frame, room);
    case eipStepLarge:
    case eipStepSmall:
        eipForwardOpenPut(&w, &c->session.opening, &c->options.route);
        return eipSessionWrap(&c->session, eipWayHere, message, w.n, frame, room);
    default:
        return 0;
    }
}

/* --- Answers ------------------------------------------------------------------------------ */

/* A PLC that does not know the command, or has nothing to list, may be good all the same. */
static int listed(eipConnect *c, eipReader *r, epicsUInt32 status, char *why, size_t size)
{
    unsigned count = eipTake16(r);
    const epicsUInt8 *item;
    size_t length;

    if (!status && count) {
        eipTake16(r);
        length = eipTake16(r);
        item = eipTake(r, length);
        if (item && length <= listServicesHead)
            item = NULL; /* too short to say anything */
        if (item && !(item[listServicesHead] & canTcp)) {
            epicsSnprintf(why, size, "no CIP over TCP there");
            return -1;
        }
    }
    advance(c, eipStepRegister);
    return 0;
}

static int registered(eipConnect *c, eipReader *r, epicsUInt32 status, epicsUInt32 handle,
                      char *why, size_t size)
{
    if (status || !handle || eipTake16(r) != 1 || r->bad) {
        epicsSnprintf(why, size, "session refused%s%.20s", status ? ": " : "",
                      status ? eipFrameStatusText(status) : "");
        return -1;
    }
    c->session.handle = handle;
    advance(c, eipStepIdentity);
    return 0;
}

static void identityTake(eipIdentity *i, const eipAnswer *a)
{
    eipReader r = eipReaderOf(a->data, a->length);
    const epicsUInt8 *name;
    size_t n;

    i->vendor = eipTake16(&r);
    i->type = eipTake16(&r);
    i->code = eipTake16(&r);
    i->major = eipTake8(&r);
    i->minor = eipTake8(&r);
    i->status = eipTake16(&r);
    i->serial = eipTake32(&r);
    n = eipTake8(&r);
    name = eipTake(&r, n);
    i->known = !r.bad;
    if (!name || n >= sizeof(i->name))
        n = name ? sizeof(i->name) - 1 : 0;
    memcpy(i->name, name ? name : (const epicsUInt8 *)"", n);
    i->name[n] = 0;
}

/* Nothing behind the route: there is no use in going on. */
static int isNoController(const eipAnswer *a)
{
    return a->status == eipConnectionFailure &&
           (a->extended == 0x0204 || a->extended == 0x0205 || a->extended == 0x0311 ||
            a->extended == 0x0312 || a->extended == 0x0315 || a->extended == 0x0318);
}

/* A slot where there is no backplane, none where there is one: the status alone tells nobody. */
static const char *routeHint(const eipConnect *c, const eipAnswer *a)
{
    const eipRoute *route = &c->options.route;
    int isSlot = route->length == 2 && route->bytes[0] == 1;

    if (isSlot && a->extended == 0x0311)
        return "no backplane: slot -1";
    return !route->length && (a->extended == 0x0311 || a->extended == 0x0315)
               ? "no controller, slot needed" : NULL;
}

static int statusFail(const eipConnect *c, const eipAnswer *a, char *why, size_t size)
{
    const char *hint = routeHint(c, a);

    eipStatusText(a->status, a->extended, why, size);
    if (hint)
        epicsSnprintf(why, size, "%s (%02X %04X)", hint, a->status, a->extended);
    return -1;
}

static int identified(eipConnect *c, const eipAnswer *a, char *why, size_t size)
{
    if (isNoController(a))
        return statusFail(c, a, why, size);
    if (!a->status)
        identityTake(&c->identity, a);
    if (c->identity.known && strncmp(c->identity.name, "2080-", 5) == 0)
        c->multiple = 1;
    else if (c->identity.known && c->identity.vendor == eipVendorOmron)
        c->multiple = omronMultiple;
    advance(c, eipStepLarge);
    return 0;
}

/* Another size, which the PLC has named in its refusal. Returns 1 when there is one. */
static int smallerSize(eipConnect *c, const eipAnswer *a)
{
    eipOpening *o = &c->session.opening;

    if (a->status != eipConnectionFailure || a->extended != eipExtSize ||
        a->size < 100 || a->size >= o->size)
        return 0;
    if (a->size <= largest511 && o->large) {
        advance(c, eipStepSmall);
        if (c->step != eipStepSmall)
            return 1;
    }
    o->size = a->size;
    newTriad(c);
    c->learned = 1;
    return 1;
}

static int opened(eipConnect *c, const eipAnswer *a, char *why, size_t size)
{
    eipSession *s = &c->session;

    if (!a->status) {
        if (eipForwardOpenTake(a, &s->opening, &s->opened)) {
            epicsSnprintf(why, size, "answer to another connection");
            return -1;
        }
        s->connected = 1;
        c->room = s->opening.size - 2; /* the sequence count is in it */
        c->step = eipStepDone;
        return 0;
    }
    if (isNoController(a))
        return statusFail(c, a, why, size);
    if (a->status == eipConnectionFailure && a->extended == eipExtInUse &&
        ++c->tries < triesMax)
        newTriad(c);
    else if (!smallerSize(c, a))
        advance(c, c->step + 1);
    return 0;
}

int eipConnectTake(eipConnect *c, const void *frame, size_t length, char *why, size_t size)
{
    eipReader r;
    eipAnswer a;
    epicsUInt32 status = 0, handle = 0;

    if (c->step <= eipStepRegister) {
        if (eipSessionPlainTake(&c->session, frame, length, &r, &status, &handle, why, size))
            return -1;
        return c->step == eipStepList ? listed(c, &r, status, why, size)
                                      : registered(c, &r, status, handle, why, size);
    }
    if (eipSessionUnwrap(&c->session, frame, length, &a, why, size))
        return -1;
    return c->step == eipStepIdentity ? identified(c, &a, why, size)
                                      : opened(c, &a, why, size);
}

void eipConnectReopen(eipConnect *c)
{
    c->session.connected = 0;
    c->session.sequence = 0;
    c->tries = 0;
    newTriad(c);
    c->step = c->session.opening.large ? eipStepLarge : eipStepSmall;
}

int eipConnectNoAnswer(eipConnect *c)
{
    if (c->step == eipStepRegister || c->step == eipStepDone)
        return 0;
    c->skip |= 1u << c->step;
    return 1;
}

int eipConnectOpened(eipConnect *c)
{
    int first = !c->patience;

    if (!c->skip) {
        c->patience = c->left = 0;
        return 0;
    }
    if (c->left) {
        c->left--;
        return 0;
    }
    if (c->patience < patienceMax)
        c->patience = first ? 1 : 2 * c->patience;
    c->left = c->patience;
    c->skip = 0;
    return first;
}

size_t eipConnectClose(eipConnect *c, void *frame, size_t room)
{
    epicsUInt8 message[128];
    eipWriter w = eipWriterOf(message, sizeof(message));

    if (!c->session.connected)
        return 0;
    eipForwardClosePut(&w, &c->session.opening, &c->options.route);
    return eipSessionWrap(&c->session, eipWayHere, message, w.n, frame, room);
}

void eipConnectText(const eipConnect *c, char *text, size_t size)
{
    if (c->session.connected)
        epicsSnprintf(text, size, "connected, %u bytes", c->session.opening.size);
    else
        epicsSnprintf(text, size, "unconnected, %u bytes", c->room);
}
