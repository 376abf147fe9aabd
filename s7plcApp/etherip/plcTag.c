/* plcTag: lists, describes, reads, writes and watches the tags of a controller from the command
 * line, by EtherNet/IP. No IOC is needed. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <epicsString.h>
#include <epicsThread.h>
#include <epicsTime.h>

#include "eipConnect.h"
#include "eipSocket.h"
#include "eipTags.h"

enum { messageMax = 65000, valueMax = 1 << 20, nameSize = 2 * eipSymbolNameMax + 2 };

static const char usage[] =
    "usage: plcTag [options] host[:port] command\n"
    "\n"
    "  identify              which controller is it\n"
    "  list [pattern]        names and types of its tags; pattern with * and ?\n"
    "  describe tag          type of a tag, and the members of its structure\n"
    "  read tag ...          values, each as tag=value\n"
    "  write tag value ...   one value, or as many as elements are written from there on\n"
    "  watch tag ...         prints a tag when its value changes, until interrupted\n"
    "\n"
    "A tag is name, a.b[2].c, a[1,2], Program:Main.x or tag.5 (a bit).\n"
    "\n"
    "  -s slot     of the controller (0); -1: the address is that of the controller itself\n"
    "  -r route    instead of -s: port,link,port,link ..., as 1,6,18,10.0.0.4,1,0\n"
    "  -n count    elements of an array to be read (1)\n"
    "  -t ms       time for each answer (5000)\n"
    "  -w s        time between two reads of watch (1)\n"
    "  -c count    watch: so many reads (no end)\n"
    "  -u          open no connection in the controller\n"
    "  -v          say what happens\n";

typedef struct client {
    eipSocket socket;
    eipConnect connect;
    unsigned timeout;
    eipTemplates templates;
    epicsUInt8 *frame, *message;
} client;

static struct {
    const char *slot, *route;
    unsigned count, reads;
    int timeout, unconnected, verbose;
    double period;
} option = {"0", NULL, 1, 0, 5000, 0, 0, 1.0};

static void stop(const char *format, ...) EPICS_PRINTF_STYLE(1, 2);

static void stop(const char *format, ...)
{
    va_list args;

    fputs("plcTag: ", stderr);
    va_start(args, format);
    vfprintf(stderr, format, args);
    va_end(args);
    fputc('\n', stderr);
    exit(1);
}

/* --- Connection ---------------------------------------------------------------------------- */

static void begin(client *c, const char *host)
{
    char name[256], why[128];
    unsigned port = eipTcpPort;
    const char *colon = strchr(host, ':');

    epicsSnprintf(name, sizeof(name), "%.*s", (int)strcspn(host, ":"), host);
    if (colon && (sscanf(colon + 1, "%u", &port) != 1 || port > 65535 || !port))
        stop("port %s; allowed: 1 to 65535", colon + 1);
    if (eipSocketConnect(&c->socket, name, port, c->timeout, why, sizeof(why)))
        stop("%s: %s", host, why);
    eipConnectBegin(&c->connect, (epicsUInt32)epicsMonotonicGet());
}

static void hello(client *c, const char *host)
{
    char why[128] = "";
    size_t n, length;

    begin(c, host);
    while ((n = eipConnectNext(&c->connect, c->frame, eipFrameMax)) != 0) {
        eipOutcome outcome =
            eipSocketAsk(&c->socket, c->frame, n, c->timeout, &length, why, sizeof(why));

        if (outcome == eipAnswered) {
            if (eipConnectTake(&c->connect, c->socket.buffer, length, why, sizeof(why)))
                stop("%s: %s", host, why);
        } else if (eipConnectNoAnswer(&c->connect)) {
            begin(c, host); /* some close the connection at what they do not know */
        } else {
            stop("%s: %s", host, why);
        }
    }
    if (option.verbose) {
        eipConnectText(&c->connect, why, sizeof(why));
        fprintf(stderr, "plcTag: %s, %s\n", c->connect.identity.name, why);
    }
}

static void bye(client *c)
{
    size_t n = eipConnectClose(&c->connect, c->frame, eipFrameMax), length;
    char why[128];

    if (n)
        eipSocketAsk(&c->socket, c->frame, n, c->timeout, &length, why, sizeof(why));
    eipSocketFree(&c->socket);
}

/* Asks; the message was put into `w`. */
static void ask(client *c, eipWriter *w, eipAnswer *answer)
{
    char why[128] = "the message is too long";
    size_t length, n = w->full ? 0
                               : eipSessionWrap(&c->connect.session, eipWayNormal, w->start,
                                                w->n, c->frame, eipFrameMax);

    if (!n ||
        eipSocketAsk(&c->socket, c->frame, n, c->timeout, &length, why, sizeof(why)) !=
            eipAnswered ||
        eipSessionUnwrap(&c->connect.session, c->socket.buffer, length, answer, why,
                         sizeof(why)))
        stop("%s", why);
}

static eipWriter writerOf(client *c)
{
    return eipWriterOf(c->message, messageMax);
}

static const char *statusOf(const eipAnswer *a)
{
    static char text[64];

    eipStatusText(a->status, a->extended, text, sizeof(text));
    return text;
}

/* --- Values -------------------------------------------------------------------------------- */

typedef struct value {
    eipName name;
    eipData data; /* bytes point into `bytes` */
    epicsUInt8 *bytes;
} value;

static void nameOf(const char *text, eipName *name)
{
    char error[200];
    size_t column;

    if (eipNameParse(text, 0, name, &column, error, sizeof(error)))
        stop("%s: %s\n  %s\n  %*s", text, error, text, (int)column + 1, "^");
}

static void putPath(eipWriter *w, const eipName *name, int service)
{
    epicsUInt8 path[eipPathMax + 32];
    eipWriter p = eipWriterOf(path, sizeof(path));
    unsigned i;

    eipPathPut(&p, name->base, 0);
    for (i = 0; i < name->dimensions; i++)
        eipIndexPut(&p, name->index[i]);
    eipRequestPut(w, (eipService)service, path, p.n);
}

/* Reads `count` elements, in as many parts as it takes. Returns 0, or -1 and the answer. */
static int readValue(client *c, value *v, unsigned count, eipAnswer *answer)
{
    size_t got = 0;

    do {
        eipWriter w = writerOf(c);
        eipData part;

        putPath(&w, &v->name, got ? eipReadFragment : eipReadTag);
        eipPut16(&w, count);
        if (got)
            eipPut32(&w, (epicsUInt32)got);
        ask(c, &w, answer);
        if (answer->status && answer->status != eipPartial)
            return -1;
        if (eipDataTake(answer, &part) || got + part.length > valueMax ||
            (got && part.code != v->data.code) ||
            (answer->status == eipPartial && !part.length))
            stop("%s: answer not understood", v->name.base);
        memcpy(v->bytes + got, part.bytes, part.length);
        got += part.length;
        v->data = (eipData){part.code, part.handle, v->bytes, got};
    } while (answer->status == eipPartial);
    return 0;
}

static void printHex(const epicsUInt8 *bytes, size_t n)
{
    size_t i;

    for (i = 0; i < n; i++)
        printf("%s%02X", i ? " " : "", bytes[i]);
}

static void printValue(const value *v)
{
    const eipType *type = eipTypeOf(v->data.code);
    const char *text;
    char number[64];
    size_t i, n;

    if (!type->size) {
        text = eipTextGet(type->code, v->data.bytes, v->data.length, &n);
        if (text && (type->kind == eipText || v->data.handle == eipStringHandle)) {
            char escaped[400];

            epicsStrnEscapedFromRaw(escaped, sizeof(escaped), text, n);
            printf("\"%s\"", escaped);
        } else {
            printHex(v->data.bytes, v->data.length);
        }
        return;
    }
    for (i = 0; i + type->size <= v->data.length; i += type->size) {
        eipNumber one;

        eipNumberGet(type, v->data.bytes + i, &one);
        if (v->name.bit >= 0) {
            epicsSnprintf(number, sizeof(number), "%d",
                          v->name.bit < (int)type->size * 8 && one.kind != eipReal
                              ? (int)(one.u.integer >> v->name.bit & 1)
                              : 0);
        } else {
            eipNumberText(type, &one, number, sizeof(number));
        }
        printf("%s%s", i ? " " : "", number);
    }
}

static int doRead(client *c, char **tags, int count)
{
    value v = {.bytes = mallocMustSucceed(valueMax, "plcTag")};
    eipAnswer answer;
    int i, failed = 0;

    for (i = 0; i < count; i++) {
        nameOf(tags[i], &v.name);
        if (readValue(c, &v, option.count, &answer)) {
            fprintf(stderr, "plcTag: %s: %s\n", tags[i], statusOf(&answer));
            failed = 1;
            continue;
        }
        printf("%s=", tags[i]);
        printValue(&v);
        putchar('\n');
    }
    free(v.bytes);
    return failed;
}

static int doWatch(client *c, char **tags, int count)
{
    value v = {.bytes = mallocMustSucceed(valueMax, "plcTag")};
    char stamp[40];
    epicsUInt8 **last = callocMustSucceed((size_t)count, sizeof(*last), "plcTag");
    size_t *length = callocMustSucceed((size_t)count, sizeof(*length), "plcTag");
    unsigned turn;
    eipAnswer answer;
    epicsTimeStamp now;
    int i;

    for (turn = 0; !option.reads || turn < option.reads; turn++) {
        if (turn)
            epicsThreadSleep(option.period);
        for (i = 0; i < count; i++) {
            nameOf(tags[i], &v.name);
            if (readValue(c, &v, option.count, &answer))
                stop("%s: %s", tags[i], statusOf(&answer));
            if (last[i] && length[i] == v.data.length &&
                memcmp(last[i], v.bytes, length[i]) == 0)
                continue;
            length[i] = v.data.length;
            free(last[i]);
            last[i] = mallocMustSucceed(length[i] + 1, "plcTag");
            memcpy(last[i], v.bytes, length[i]);
            epicsTimeGetCurrent(&now);
            epicsTimeToStrftime(stamp, sizeof(stamp), "%H:%M:%S.%03f", &now);
            printf("%s %s=", stamp, tags[i]);
            printValue(&v);
            putchar('\n');
            fflush(stdout);
        }
    }
    for (i = 0; i < count; i++)
        free(last[i]);
    free(last);
    free(length);
    free(v.bytes);
    return 0;
}

/* --- Writing ------------------------------------------------------------------------------- */

static void writeOrStop(client *c, eipWriter *w, const char *tag)
{
    eipAnswer answer;

    ask(c, w, &answer);
    if (answer.status)
        stop("%s: %s", tag, statusOf(&answer));
}

static void writeBit(client *c, const value *v, const eipType *type, const char *tag,
                     const char *text)
{
    epicsUInt64 bit = (epicsUInt64)1 << v->name.bit, on;
    eipWriter w = writerOf(c);

    if (!type->size || type->kind == eipReal || v->name.bit >= (int)type->size * 8)
        stop("%s: a %s has no bit %d", tag, type->name, v->name.bit);
    if (strcmp(text, "0") && strcmp(text, "1"))
        stop("%s: %s; allowed: 0 or 1", tag, text);
    on = text[0] == '1' ? bit : 0;
    putPath(&w, &v->name, eipReadModifyWrite);
    eipPut16(&w, type->size);
    eipPutUnsigned(&w, type->size, on);
    eipPutUnsigned(&w, type->size, on | ~bit);
    writeOrStop(c, &w, tag);
}

static void writeText(client *c, const value *v, const char *tag, const char *text)
{
    epicsUInt8 *raw = mallocMustSucceed(valueMax, "plcTag");
    size_t length = v->data.code == eipStructureCode ? v->data.length : 300;
    size_t room = v->data.handle == eipStringHandle ? eipStringRoom : 0;
    eipWriter w = writerOf(c);

    length = eipTextPut(v->data.code, raw, length, room, text, strlen(text));
    if (!length)
        stop("%s: the text is too long", tag);
    putPath(&w, &v->name, eipWriteTag);
    eipPut16(&w, v->data.code);
    if (v->data.code == eipStructureCode)
        eipPut16(&w, v->data.handle);
    eipPut16(&w, 1);
    eipPutBytes(&w, raw, length);
    free(raw);
    writeOrStop(c, &w, tag);
}

static int doWrite(client *c, char **words, int count)
{
    value v = {.bytes = mallocMustSucceed(valueMax, "plcTag")};
    const eipType *type;
    eipWriter w;
    eipAnswer answer;
    int i;

    nameOf(words[0], &v.name);
    if (readValue(c, &v, 1, &answer)) /* the type is needed */
        stop("%s: %s", words[0], statusOf(&answer));
    type = eipTypeOf(v.data.code);
    w = writerOf(c);
    if (v.name.bit >= 0) {
        writeBit(c, &v, type, words[0], words[1]);
    } else if (!type->size) {
        writeText(c, &v, words[0], words[1]);
    } else {
        putPath(&w, &v.name, eipWriteTag);
        eipPut16(&w, type->code);
        eipPut16(&w, (unsigned)count - 1);
        for (i = 1; i < count; i++) {
            epicsUInt8 raw[8];
            eipNumber number;

            if (eipNumberParse(type, words[i], &number) || eipNumberPut(type, raw, &number))
                stop("%s: %s does not fit %s", words[0], words[i], type->name);
            eipPutBytes(&w, raw, type->size);
        }
        if (w.full || w.n > c->connect.room)
            stop("%s: too many values for one message", words[0]);
        writeOrStop(c, &w, words[0]);
    }
    free(v.bytes);
    return 0;
}

/* --- The list ------------------------------------------------------------------------------ */

static const eipTemplate *templateOf(client *c, unsigned id)
{
    eipTemplate *t = callocMustSucceed(1, sizeof(*t), "plcTag");
    epicsUInt8 *bytes;
    size_t need, got = 0;
    eipAnswer answer;
    eipWriter w = writerOf(c);

    if (c->templates.table[id]) {
        free(t);
        return c->templates.table[id];
    }
    eipTemplateSizePut(&w, id);
    ask(c, &w, &answer);
    if (answer.status || eipTemplateSizeTake(&answer, id, t)) {
        free(t);
        return NULL;
    }
    need = eipTemplateBytes(t);
    bytes = callocMustSucceed(1, need, "plcTag");
    do {
        w = writerOf(c);
        eipTemplateReadPut(&w, id, (epicsUInt32)got, (unsigned)(need - got));
        ask(c, &w, &answer);
        if ((answer.status && answer.status != eipPartial) || answer.length > need - got)
            break;
        memcpy(bytes + got, answer.data, answer.length);
        got += answer.length;
    } while (answer.status == eipPartial && answer.length && got < need);
    if (answer.status || eipTemplateParse(t, bytes, got)) {
        free(bytes);
        free(t);
        return NULL;
    }
    free(bytes);
    c->templates.table[id] = t;
    return t;
}

/* "DINT[10]", "Motor" */
static const char *typeText(client *c, unsigned type, const epicsUInt32 *dimension,
                            char *text, size_t size)
{
    const eipType *row = eipTypeOf(eipElementCode(type));
    const eipTemplate *t = NULL;
    size_t n;
    unsigned i;

    if (eipIsStructure(type))
        t = templateOf(c, eipTemplateId(type));
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

/* All tags of the controller, or of one program; programs are visited as well. */
static void eachSymbol(client *c, const char *program,
                       void (*visit)(client *c, const char *name, const eipSymbol *symbol,
                                     void *arg),
                       void *arg)
{
    eipSymbol *found = NULL;
    size_t n = 0, room = 0, i;
    epicsUInt32 next = 0;
    eipAnswer answer;
    char name[nameSize];

    do {
        eipWriter w = writerOf(c);
        eipSymbol symbol;
        eipReader r;
        int status, some = 0;

        eipSymbolsPut(&w, program, next);
        ask(c, &w, &answer);
        if (answer.status && answer.status != eipPartial) {
            if (n || program)
                break;
            stop("the PLC does not list its tags: %s", statusOf(&answer));
        }
        r = eipReaderOf(answer.data, answer.length);
        while ((status = eipSymbolTake(&r, &symbol)) > 0) {
            some = 1;
            if (symbol.id < next)
                stop("the list of tags goes round in circles");
            next = symbol.id + 1;
            if (!eipSymbolCounts(&symbol))
                continue;
            if (n == room) {
                room = room * 2 + 64;
                found = realloc(found, room * sizeof(*found));
                if (!found)
                    cantProceed("plcTag: no memory for %lu tags\n", (unsigned long)room);
            }
            found[n++] = symbol;
        }
        if (status < 0 || (answer.status == eipPartial && !some))
            stop("the list of tags is not understood");
    } while (answer.status == eipPartial);
    for (i = 0; i < n; i++) {
        if (!program && epicsStrnCaseCmp(found[i].name, "Program:", 8) == 0) {
            eachSymbol(c, found[i].name, visit, arg);
            continue;
        }
        epicsSnprintf(name, sizeof(name), "%s%s%s", program ? program : "",
                      program ? "." : "", found[i].name);
        visit(c, name, &found[i], arg);
    }
    free(found);
}

static void printSymbol(client *c, const char *name, const eipSymbol *symbol, void *arg)
{
    char text[120];

    if (!arg || epicsStrGlobMatch(name, arg))
        printf("%-40s %s\n", name,
               typeText(c, symbol->type, symbol->dimension, text, sizeof(text)));
}

typedef struct search {
    const char *name;
    eipSymbol symbol;
    int found;
} search;

static void findSymbol(client *c, const char *name, const eipSymbol *symbol, void *arg)
{
    search *s = arg;

    (void)c;
    if (epicsStrCaseCmp(name, s->name) == 0) {
        s->symbol = *symbol;
        s->found = 1;
    }
}

static void describe(client *c, const char *name, unsigned type, const epicsUInt32 *dimension)
{
    char text[120];
    const eipTemplate *t;
    unsigned i;

    printf("%s  %s", name, typeText(c, type, dimension, text, sizeof(text)));
    t = eipIsStructure(type) ? templateOf(c, eipTemplateId(type)) : NULL;
    if (!t) {
        putchar('\n');
        return;
    }
    printf("  %u bytes, handle %04X\n", t->size, t->handle);
    for (i = 0; i < t->count; i++) {
        const eipMember *m = &t->members[i];
        epicsUInt32 length[3] = {m->info, 0, 0};

        if (m->name[0] == '_' || strncmp(m->name, "ZZZZ", 4) == 0)
            continue;
        printf("  %5u  .%-38s %s", m->offset, m->name,
               typeText(c, m->type, length, text, sizeof(text)));
        if (!eipIsStructure(m->type) && eipElementCode(m->type) == eipBool)
            printf(" bit %u", m->info);
        putchar('\n');
    }
}

static int doDescribe(client *c, const char *text)
{
    search s = {.name = text};
    value v = {.bytes = mallocMustSucceed(valueMax, "plcTag")};
    eipMemberPlace place = {0};
    eipName name;
    char root[eipNameMax + 1];
    size_t n;
    int missing;

    nameOf(text, &name);
    n = eipNameRoot(name.base);
    epicsSnprintf(root, sizeof(root), "%.*s", (int)n, name.base);
    s.name = root;
    eachSymbol(c, NULL, findSymbol, &s);
    if (!s.found)
        stop("%s: the PLC lists no such tag", root);
    n += name.base[n] == '[' ? strcspn(name.base + n, "]") + 1 : 0;
    if (!name.base[n]) {
        describe(c, text, s.symbol.type, s.symbol.dimension);
    } else {
        do { /* reads templates until all are there that lead to the member */
            memset(&place, 0, sizeof(place));
            missing = eipMemberFind(&c->templates, eipTemplateId(s.symbol.type),
                                    name.base + n + 1, &place);
        } while (missing > 0 && templateOf(c, (unsigned)missing));
        if (missing)
            stop("%s: no such member", text);
        describe(c, text, place.type, (epicsUInt32[3]){place.elements, 0, 0});
    }
    free(v.bytes);
    return 0;
}

static int doIdentify(client *c)
{
    const eipIdentity *i = &c->connect.identity;
    char text[60];

    if (!i->known)
        stop("the PLC does not say what it is");
    eipConnectText(&c->connect, text, sizeof(text));
    printf("%s, revision %u.%u, vendor %u, type %u, code %u, serial number %08X, "
           "status %04X\n%s\n",
           i->name, i->major, i->minor, i->vendor, i->type, i->code, i->serial, i->status,
           text);
    return 0;
}

/* --- Command line -------------------------------------------------------------------------- */

static double numberArg(char letter, const char *text, double low, double high)
{
    double number;

    if (epicsParseDouble(text, &number, NULL) || number < low || number > high)
        stop("-%c %s; allowed: %g to %g", letter, text, low, high);
    return number;
}

/* Returns the index of the first word that is no option. */
static int options(int argc, char **argv)
{
    int i;

    for (i = 1; i < argc && argv[i][0] == '-'; i++) {
        char letter = argv[i][1];
        const char *text = argv[i][1] && argv[i][2] ? argv[i] + 2 : argv[i + 1];

        if (letter == 'u') {
            option.unconnected = 1;
            continue;
        }
        if (letter == 'v') {
            option.verbose = 1;
            continue;
        }
        if (letter == 'h') {
            fputs(usage, stdout);
            exit(0);
        }
        if (!letter || !strchr("srntwc", letter) || !text) {
            fputs(usage, stderr);
            exit(2);
        }
        i += !argv[i][2];
        switch (letter) {
        case 's':
            numberArg('s', text, -1, 255);
            option.slot = text;
            break;
        case 'r':
            option.route = text;
            break;
        case 'n':
            option.count = (unsigned)numberArg('n', text, 1, 65535);
            break;
        case 't':
            option.timeout = (int)numberArg('t', text, 10, 600000);
            break;
        case 'w':
            option.period = numberArg('w', text, 0.001, 86400);
            break;
        default:
            option.reads = (unsigned)numberArg('c', text, 1, 4e9);
            break;
        }
    }
    return i;
}

static const struct {
    const char *name;
    int least, most; /* words behind it */
} commands[] = {{"identify", 0, 0}, {"list", 0, 1},     {"describe", 1, 1},
                {"read", 1, 10000}, {"write", 2, 10000}, {"watch", 1, 10000}};

static int run(client *c, const char *name, char **words, int count)
{
    switch (name[0]) {
    case 'i':
        return doIdentify(c);
    case 'l':
        eachSymbol(c, NULL, printSymbol, count ? words[0] : NULL);
        return 0;
    case 'd':
        return doDescribe(c, words[0]);
    case 'r':
        return doRead(c, words, count);
    default:
        return (name[1] == 'a' ? doWatch : doWrite)(c, words, count);
    }
}

int main(int argc, char **argv)
{
    client *c;
    eipConnectOptions connect = {.connected = 1, .size = eipSizeLarge,
                                 .room = eipUnconnectedRoom};
    char route[80], error[200];
    int first = options(argc, argv), status;
    size_t i;

    for (i = 0; first + 1 < argc && i < sizeof(commands) / sizeof(commands[0]); i++)
        if (strcmp(argv[first + 1], commands[i].name) == 0)
            break;
    if (first + 1 >= argc || i == sizeof(commands) / sizeof(commands[0]) ||
        argc - first - 2 < commands[i].least || argc - first - 2 > commands[i].most) {
        fputs(usage, stderr);
        return 2;
    }
    epicsSnprintf(route, sizeof(route), strcmp(option.slot, "-1") ? "1,%s" : "%s", option.slot);
    if (eipRouteParse(option.route ? option.route : route, &connect.route, error,
                      sizeof(error)))
        stop("%s", error);
    c = callocMustSucceed(1, sizeof(*c), "plcTag");
    connect.connected = !option.unconnected;
    connect.timeout = (unsigned)option.timeout;
    c->timeout = (unsigned)option.timeout;
    c->frame = mallocMustSucceed(eipFrameMax, "plcTag");
    c->message = mallocMustSucceed(messageMax, "plcTag");
    eipSocketInit(&c->socket);
    eipConnectInit(&c->connect, &connect);
    osiSockAttach();
    hello(c, argv[first]);
    status = run(c, argv[first + 1], argv + first + 2, argc - first - 2);
    bye(c);
    eipTemplatesClear(&c->templates);
    free(c->frame);
    free(c->message);
    free(c);
    return status;
}
