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

/* Says why, and is -1, which checkers of code do not see through variable arguments. */
#define fail(c, ...) (explain(c, __VA_ARGS__), -1)

static void explain(eipClient *c, const char *format, ...) EPICS_PRINTF_STYLE(2, 3);

static void explain(eipClient *c, const char *format, ...)
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

static int begin(eipClient *c, const char *host)
{
    char name[256], why[100];
    epicsInt32 port = eipTcpPort;
    const char *colon = strchr(host, ':');

    epicsSnprintf(name, sizeof(name), "%.*s", (int)strcspn(host, ":"), host);
    if (colon && (epicsParseInt32(colon + 1, &port, 10, NULL) || port < 1 || port > 65535))
        return fail(c, "port %.40s; allowed: 1 to 65535", colon + 1);
    if (eipSocketConnect(&c->socket, name, (unsigned)port, c->timeout, why, sizeof(why)))
        return fail(c, "%.60s: %s", host, why);
    eipConnectBegin(&c->connect, (epicsUInt32)epicsMonotonicGet());
    return 0;
}

/* Some close the connection at what they do not know: then it is left out. */
int eipClientOpen(eipClient *c, const char *host)
{
    char why[100] = "";
    size_t n, length;

    if (begin(c, host))
        return -1;
    while ((n = eipConnectNext(&c->connect, c->frame, eipFrameMax)) != 0) {
        eipOutcome outcome =
            eipSocketAsk(&c->socket, c->frame, n, c->timeout, &length, why, sizeof(why));

        if (outcome == eipAnswered) {
            if (eipConnectTake(&c->connect, c->socket.buffer, length, why, sizeof(why)))
                return fail(c, "%.60s: %s", host, why);
        } else if (!eipConnectNoAnswer(&c->connect)) {
            return fail(c, "%.60s: %s", host, why);
        } else if (begin(c, host)) {
            return -1;
        }
    }
    return 0;
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
                         sizeof(why)))
        return fail(c, "%s", why);
    return 0;
}

static int statusFail(eipClient *c, const eipAnswer *a)
{
    char text[64];

    eipStatusText(a->status, a->extended, text, sizeof(text));
    return fail(c, "%s", text);
}

int eipClientTell(eipClient *c, eipWriter *w)
{
    eipAnswer answer;

    if (eipClientAsk(c, w, &answer))
        return -1;
    return answer.status ? statusFail(c, &answer) : 0;
}

/* --- Values -------------------------------------------------------------------------------- */

int eipValueInit(eipClient *c, eipValue *v, const char *tag)
{
    char error[200];
    size_t column;

    memset(v, 0, sizeof(*v));
    if (eipNameParse(tag, 0, &v->name, &column, error, sizeof(error)))
        return fail(c, "%s (at %u)", error, (unsigned)column + 1);
    v->bytes = mallocMustSucceed(eipClientValueMax, "eipClient");
    return 0;
}

void eipValueFree(eipValue *v)
{
    free(v->bytes);
    v->bytes = NULL;
}

void eipValuePath(eipWriter *w, const eipName *name, int service)
{
    epicsUInt8 path[eipPathMax + 32];
    eipWriter p = eipWriterOf(path, sizeof(path));
    unsigned i;

    eipPathPut(&p, name->base, 0);
    for (i = 0; i < name->dimensions; i++)
        eipIndexPut(&p, name->index[i]);
    eipRequestPut(w, (eipService)service, path, p.n);
}

/* The next part begins at a whole element. */
static size_t wholeElements(const eipData *part)
{
    const eipType *type = eipTypeOf(part->code);

    return type && type->size ? part->length - part->length % type->size : part->length;
}

static int typeOf(eipClient *c, const char *base, unsigned *type, epicsUInt32 dimension[3]);

/* Is a structure a string? Its template says it. */
static void learnString(eipClient *c, eipValue *v)
{
    epicsUInt32 dimension[3];
    const eipTemplate *t = NULL;
    unsigned type;

    if (v->data.code != eipStructureCode)
        return;
    if (v->data.handle == eipStringHandle)
        v->characters = eipStringRoom;
    else if (typeOf(c, v->name.base, &type, dimension) == 0 && eipIsStructure(type))
        t = eipClientTemplate(c, eipTemplateId(type));
    if (t && t->handle == v->data.handle) {
        v->characters = eipTemplateIsString(t);
        v->structure = t;
    }
}

/* Has its type the bit that the name asks for? */
static int checkBit(eipClient *c, const eipValue *v)
{
    const eipType *type = eipTypeOf(v->data.code);
    int bits = type->kind & (eipSigned | eipUnsigned) ? (int)type->size * 8 : 0;

    if (v->name.bit < (type->code == eipBool ? 1 : bits))
        return 0;
    if (type->code == eipBool)
        return fail(c, "bit %d; BOOL has bit 0 only", v->name.bit);
    return bits ? fail(c, "bit %d; %s has bits 0 to %d", v->name.bit, type->name, bits - 1)
                : fail(c, "bit %d; %s has no bits", v->name.bit, type->name);
}

int eipClientRead(eipClient *c, eipValue *v, unsigned count)
{
    eipAnswer answer;
    size_t got = 0;

    do {
        eipWriter w = eipClientWriter(c);
        eipData part;

        eipValuePath(&w, &v->name, got ? eipReadFragment : eipReadTag);
        eipPut16(&w, count);
        if (got)
            eipPut32(&w, (epicsUInt32)got);
        if (eipClientAsk(c, &w, &answer))
            return -1;
        if (answer.status && answer.status != eipPartial)
            return statusFail(c, &answer);
        if (eipDataTake(&answer, &part) || got + part.length > eipClientValueMax ||
            (got && part.code != v->data.code) ||
            (answer.status == eipPartial && !wholeElements(&part)))
            return fail(c, "answer not understood");
        memcpy(v->bytes + got, part.bytes, part.length);
        got += answer.status == eipPartial ? wholeElements(&part) : part.length;
        v->data = (eipData){part.code, part.handle, v->bytes, got};
    } while (answer.status == eipPartial);
    if (checkBit(c, v))
        return -1;
    learnString(c, v);
    return 0;
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

/* "DINT[10]", "Motor" */
static const char *typeText(eipClient *c, unsigned type, const epicsUInt32 *dimension,
                            char *text, size_t size)
{
    const eipType *row = eipTypeOf(eipElementCode(type));
    const eipTemplate *t = NULL;
    size_t n;
    unsigned i;

    if (eipIsStructure(type))
        t = eipClientTemplate(c, eipTemplateId(type));
    if (t)
        epicsSnprintf(text, size, "%s", t->name);
    else if (!eipIsStructure(type) && row)
        epicsSnprintf(text, size, "%s", row->name);
    else
        epicsSnprintf(text, size, "type %04X", type);
    for (i = 0; i < eipDimensions(type); i++) {
        n = strlen(text);
        epicsSnprintf(text + n, size - n, "%s%u", i ? "," : "[", dimension[i]);
    }
    n = strlen(text);
    if (i)
        epicsSnprintf(text + n, size - n, "]");
    return text;
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
            status = fail(c, "the list has more than %d tags", eipClientTagsMax);
        else if (taken < 0)
            status = fail(c, "the list of tags is not understood");
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

typedef struct printing {
    const char *pattern;
    FILE *file;
    unsigned printed;
} printing;

static void printSymbol(eipClient *c, const char *name, const eipSymbol *symbol, void *arg)
{
    printing *p = arg;
    char text[120];

    if (p->pattern && !epicsStrGlobMatch(name, p->pattern))
        return;
    fprintf(p->file, "%-40s %s\n", name,
            typeText(c, symbol->type, symbol->dimension, text, sizeof(text)));
    p->printed++;
}

int eipClientPrintList(eipClient *c, const char *pattern, FILE *file)
{
    printing p = {pattern && *pattern ? pattern : NULL, file, 0};

    if (eipClientList(c, printSymbol, &p))
        return -1;
    return p.printed || !p.pattern
               ? 0
               : fail(c, "no tag matches \"%.60s\"; allowed: a name, with * and ?", p.pattern);
}

/* --- Types --------------------------------------------------------------------------------- */

int eipClientPrintTemplate(eipClient *c, unsigned id, FILE *file)
{
    const eipTemplate *t = eipClientTemplate(c, id & 0xfff);
    char text[120];
    unsigned i;

    if (!t)
        return fail(c, "the PLC has no type %u", id);
    fprintf(file, "%s  %u bytes, handle %04X\n", t->name, t->size, t->handle);
    for (i = 0; i < t->count; i++) {
        const eipMember *m = &t->members[i];
        epicsUInt32 length[3] = {m->info, 0, 0};

        if (eipMemberIsHidden(m))
            continue;
        fprintf(file, "  %5u  .%-38s %s", m->offset, m->name,
                typeText(c, m->type, length, text, sizeof(text)));
        if (!eipIsStructure(m->type) && eipElementCode(m->type) == eipBool)
            fprintf(file, " bit %u", m->info);
        fputc('\n', file);
    }
    return 0;
}

typedef struct search {
    const char *name;
    eipSymbol symbol;
    int found;
} search;

static void findSymbol(eipClient *c, const char *name, const eipSymbol *symbol, void *arg)
{
    search *s = arg;

    (void)c;
    if (epicsStrCaseCmp(name, s->name) == 0) {
        s->symbol = *symbol;
        s->found = 1;
    }
}

static int describe(eipClient *c, const char *name, unsigned type,
                    const epicsUInt32 *dimension, FILE *file)
{
    char text[120];

    fprintf(file, "%s  %s\n", name, typeText(c, type, dimension, text, sizeof(text)));
    return eipIsStructure(type) ? eipClientPrintTemplate(c, eipTemplateId(type), file) : 0;
}

/* The type of a tag or member, as it is listed, and how many elements it has. */
static int typeOf(eipClient *c, const char *base, unsigned *type, epicsUInt32 dimension[3])
{
    eipMemberPlace place = {0};
    search s = {.name = ""};
    char root[eipNameMax + 1];
    size_t n = eipNameRoot(base);
    int missing;

    epicsSnprintf(root, sizeof(root), "%.*s", (int)n, base);
    s.name = root;
    if (eipClientList(c, findSymbol, &s))
        return -1;
    if (!s.found)
        return fail(c, "the PLC lists no such tag");
    n += base[n] == '[' ? strcspn(base + n, "]") + 1 : 0;
    *type = s.symbol.type;
    memcpy(dimension, s.symbol.dimension, sizeof(s.symbol.dimension));
    if (!base[n])
        return 0;
    do { /* reads templates until all are there that lead to the member */
        memset(&place, 0, sizeof(place));
        missing = eipMemberFind(&c->templates, eipTemplateId(s.symbol.type), base + n + 1,
                                &place);
    } while (missing > 0 && eipClientTemplate(c, (unsigned)missing));
    *type = place.type;
    dimension[0] = place.elements;
    return missing ? fail(c, "no such member") : 0;
}

/* Fetches the template of a structure, and those of its members. */
static void fetch(eipClient *c, unsigned type)
{
    const eipTemplate *t;
    unsigned i;

    if (!eipIsStructure(type) || c->templates.table[eipTemplateId(type)])
        return;
    t = eipClientTemplate(c, eipTemplateId(type));
    for (i = 0; t && i < t->count; i++)
        fetch(c, t->members[i].type);
}

static void fetchSymbol(eipClient *c, const char *name, const eipSymbol *symbol, void *arg)
{
    (void)name, (void)arg;
    fetch(c, symbol->type);
}

/* A structure that some tag has. Returns its id, or 0: there is none of this name. */
static unsigned structureNamed(eipClient *c, const char *name)
{
    unsigned i;

    if (eipClientList(c, fetchSymbol, NULL))
        return 0;
    for (i = 0; i < eipTemplatesMax; i++)
        if (c->templates.table[i] && epicsStrCaseCmp(c->templates.table[i]->name, name) == 0)
            return i;
    return 0;
}

int eipClientDescribe(eipClient *c, const char *tag, FILE *file)
{
    epicsUInt32 dimension[3];
    eipName name;
    char error[150];
    size_t column;
    unsigned type;

    if (eipNameParse(tag, 0, &name, &column, error, sizeof(error)))
        return fail(c, "%s (at %u)", error, (unsigned)column + 1);
    if (typeOf(c, name.base, &type, dimension) == 0)
        return describe(c, tag, type, dimension, file);
    epicsSnprintf(error, sizeof(error), "%s", c->why);
    type = structureNamed(c, tag);
    return type ? eipClientPrintTemplate(c, type, file) : fail(c, "%s", error);
}
