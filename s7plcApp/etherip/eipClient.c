/* A session for people; see eipClient.h. */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <epicsString.h>
#include <epicsTime.h>

#include "eipClient.h"

void eipClientWhy(eipClient *c, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    epicsVsnprintf(c->why, sizeof(c->why), format, args);
    va_end(args);
}

/* --- Connection ---------------------------------------------------------------------------- */

eipClient *eipClientCreate(const eipConnectOptions *connect, unsigned timeout)
{
    eipClient *c = calloc(1, sizeof(*c));

    if (!c)
        return NULL;
    c->timeout = timeout;
    c->frame = mallocMustSucceed(eipFrameMax, "eipClient");
    c->message = mallocMustSucceed(eipClientMessageMax, "eipClient");
    eipSocketInit(&c->socket);
    eipConnectInit(&c->connect, connect);
    return c;
}

void eipClientDestroy(eipClient *c)
{
    eipClientClose(c);
    eipSocketFree(&c->socket);
    eipTemplatesClear(&c->templates);
    free(c->frame);
    free(c->message);
    free(c);
}

/* Name and port of host[:port]. An address that is short of numbers, as 127.1, is none. */
static int splitHost(eipClient *c, const char *host, char name[256], epicsInt32 *port)
{
    const char *colon = strchr(host, ':');
    size_t length = strcspn(host, ":");
    struct in_addr address;

    epicsSnprintf(name, 256, "%.*s", (int)length, host);
    *port = eipTcpPort;
    if (!length || length > 255 || strchr(host, '/') || (colon && strchr(colon + 1, ':')) ||
        (strspn(name, "0123456789.") == length && inet_pton(AF_INET, name, &address) != 1))
        return eipClientFail(c, "host \"%.60s\"; allowed: a name or an address as 10.0.0.5, with or without :port",
                             host);
    if (colon && (epicsParseInt32(colon + 1, port, 10, NULL) || *port < 1 || *port > 65535))
        return eipClientFail(c, "port %.40s; allowed: 1 to 65535", colon + 1);
    return 0;
}

int eipClientCheckHost(eipClient *c, const char *host)
{
    char name[256];
    epicsInt32 port;

    return splitHost(c, host, name, &port);
}

static int begin(eipClient *c)
{
    char name[256], why[100];
    const char *host = c->host;
    epicsInt32 port;

    if (splitHost(c, host, name, &port))
        return -1;
    if (eipSocketConnect(&c->socket, name, (unsigned)port, c->timeout, why, sizeof(why)))
        return eipClientFail(c, "%.60s: %s", host, why);
    eipConnectBegin(&c->connect, (epicsUInt32)epicsMonotonicGet());
    return 0;
}

/* Some close the connection at what they do not know: then it is left out. */
static int dial(eipClient *c)
{
    char why[100] = "";
    size_t n, length;

    if (begin(c))
        return -1;
    while ((n = eipConnectNext(&c->connect, c->frame, eipFrameMax)) != 0) {
        eipOutcome outcome =
            eipSocketAsk(&c->socket, c->frame, n, c->timeout, &length, why, sizeof(why));

        if (outcome == eipAnswered) {
            if (eipConnectTake(&c->connect, c->socket.buffer, length, why, sizeof(why)))
                return eipClientFail(c, "%.60s: %s", c->host, why);
        } else if (!eipConnectNoAnswer(&c->connect)) {
            return eipClientFail(c, "%.60s: %s", c->host, why);
        } else if (begin(c)) {
            return -1;
        }
    }
    c->lost = 0;
    return 0;
}

int eipClientOpen(eipClient *c, const char *host)
{
    epicsSnprintf(c->host, sizeof(c->host), "%s", host);
    return dial(c);
}

int eipClientReopen(eipClient *c)
{
    eipSocketClose(&c->socket);
    eipTemplatesClear(&c->templates);
    return dial(c);
}

void eipClientClose(eipClient *c)
{
    char why[100];
    size_t length, n;

    if (c->socket.fd == INVALID_SOCKET)
        return;
    n = eipConnectClose(&c->connect, c->frame, eipFrameMax);
    if (n)
        eipSocketAsk(&c->socket, c->frame, n, c->timeout, &length, why, sizeof(why));
    eipSocketClose(&c->socket);
}

eipWriter eipClientWriter(eipClient *c)
{
    return eipWriterOf(c->message, eipClientMessageMax);
}

int eipClientAsk(eipClient *c, eipWriter *w, eipAnswer *answer)
{
    char why[100] = "the message is too long";
    size_t length, n = w->full ? 0
                               : eipSessionWrap(&c->connect.session, eipWayNormal, w->start,
                                                w->n, c->frame, eipFrameMax);

    if (!n ||
        eipSocketAsk(&c->socket, c->frame, n, c->timeout, &length, why, sizeof(why)) !=
            eipAnswered ||
        eipSessionUnwrap(&c->connect.session, c->socket.buffer, length, answer, why,
                         sizeof(why))) {
        c->lost = n != 0;
        return eipClientFail(c, "%s", why);
    }
    c->lost = answer->status == eipConnectionFailure;
    return 0;
}

static int statusFail(eipClient *c, const eipAnswer *a)
{
    char text[64];

    eipStatusText(a->status, a->extended, text, sizeof(text));
    return eipClientFail(c, "%s", text);
}

int eipClientTell(eipClient *c, eipWriter *w)
{
    eipAnswer answer;

    if (eipClientAsk(c, w, &answer))
        return -1;
    return answer.status ? statusFail(c, &answer) : 0;
}

/* --- The list ------------------------------------------------------------------------------ */

const eipTemplate *eipClientTemplate(eipClient *c, unsigned id)
{
    eipTemplate *t;
    epicsUInt8 *bytes;
    size_t need, got = 0;
    eipAnswer answer;
    eipWriter w = eipClientWriter(c);

    if (c->templates.table[id])
        return c->templates.table[id];
    t = callocMustSucceed(1, sizeof(*t), "eipClient");
    eipTemplateSizePut(&w, id);
    if (eipClientAsk(c, &w, &answer) || answer.status || eipTemplateSizeTake(&answer, id, t) ||
        !eipTemplatesHaveRoom(&c->templates, t)) {
        free(t);
        return NULL;
    }
    need = eipTemplateBytes(t);
    bytes = callocMustSucceed(1, need, "eipClient");
    do {
        w = eipClientWriter(c);
        eipTemplateReadPut(&w, id, (epicsUInt32)got,
                           (unsigned)(need - got < 65535 ? need - got : 65535));
        if (eipClientAsk(c, &w, &answer) || (answer.status && answer.status != eipPartial) ||
            answer.length > need - got) {
            answer.status = eipGeneral;
            break;
        }
        memcpy(bytes + got, answer.data, answer.length);
        got += answer.length;
    } while (answer.status == eipPartial && answer.length && got < need);
    if ((answer.status && answer.status != eipPartial) || eipTemplateParse(t, bytes, got)) {
        free(bytes);
        free(t);
        return NULL;
    }
    free(bytes);
    c->templates.table[id] = t;
    return t;
}

/* The symbols of one answer, behind those that are there. Returns as eipSymbolTake at the end;
 * -1 too when the list goes round in circles, -2 when it is too long. */
static int takeSymbols(const eipAnswer *answer, epicsUInt32 *next, eipSymbol **found, size_t *n,
                       size_t *room)
{
    eipReader r = eipReaderOf(answer->data, answer->length);
    epicsUInt32 first = *next;
    eipSymbol symbol;
    int status;

    while ((status = eipSymbolTake(&r, &symbol)) > 0) {
        if (symbol.id < *next)
            return -1;
        if (*n >= eipClientTagsMax)
            return -2;
        *next = symbol.id + 1;
        if (!eipSymbolCounts(&symbol))
            continue;
        if (*n == *room) {
            *room = *room * 2 + 64;
            *found = realloc(*found, *room * sizeof(**found));
            if (!*found)
                cantProceed("eipClient: no memory for %lu tags\n", (unsigned long)*room);
        }
        (*found)[(*n)++] = symbol;
    }
    return answer->status == eipPartial && *next == first ? -1 : status;
}

static int listScope(eipClient *c, const char *program, eipSymbolVisit *visit, void *arg)
{
    eipSymbol *found = NULL;
    size_t n = 0, room = 0, i;
    epicsUInt32 next = 0;
    eipAnswer answer;
    char name[eipClientNameMax];
    int status = 0, taken;

    do {
        eipWriter w = eipClientWriter(c);

        eipSymbolsPut(&w, program, next);
        status = eipClientAsk(c, &w, &answer);
        if (!status && answer.status && answer.status != eipPartial) {
            if (!n && !program)
                status = statusFail(c, &answer);
            break;
        }
        taken = status ? 0 : takeSymbols(&answer, &next, &found, &n, &room);
        if (taken == -2)
            status = eipClientFail(c, "the list has more than %d tags", eipClientTagsMax);
        else if (taken < 0)
            status = eipClientFail(c, "the list of tags is not understood");
    } while (!status && answer.status == eipPartial);
    for (i = 0; i < n && !status; i++) {
        if (!program && epicsStrnCaseCmp(found[i].name, "Program:", 8) == 0) {
            status = listScope(c, found[i].name, visit, arg);
            continue;
        }
        epicsSnprintf(name, sizeof(name), "%s%s%s", program ? program : "",
                      program ? "." : "", found[i].name);
        visit(c, name, &found[i], arg);
    }
    free(found);
    return status;
}

int eipClientList(eipClient *c, eipSymbolVisit *visit, void *arg)
{
    return listScope(c, NULL, visit, arg);
}
