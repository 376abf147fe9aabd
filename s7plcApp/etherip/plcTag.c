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

#include "eipClient.h"

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

/* --- Commands ------------------------------------------------------------------------------ */

static int complain(const char *tag, const eipClient *c)
{
    fprintf(stderr, "plcTag: %s: %s\n", tag, c->why);
    return 1;
}

/* Reads and prints one tag. Returns 0, or 1 after the error line. */
static int readOne(eipClient *c, const char *tag)
{
    eipValue v;

    if (eipValueInit(c, &v, tag))
        return complain(tag, c);
    if (eipClientRead(c, &v, option.count)) {
        eipValueFree(&v);
        return complain(tag, c);
    }
    printf("%s=", tag);
    eipValuePrint(c, &v, stdout);
    putchar('\n');
    eipValueFree(&v);
    return 0;
}

static int doRead(eipClient *c, char **tags, int count)
{
    int i, failed = 0;

    for (i = 0; i < count; i++)
        failed |= readOne(c, tags[i]);
    return failed;
}

/* What a tag of doWatch was the last time. */
typedef struct watched {
    epicsUInt8 *bytes; /* NULL: nothing yet */
    size_t length;
} watched;

static int watchOne(eipClient *c, const char *tag, watched *last)
{
    char stamp[40];
    epicsTimeStamp now;
    eipValue v;

    if (eipValueInit(c, &v, tag))
        return complain(tag, c);
    if (eipClientRead(c, &v, option.count)) {
        eipValueFree(&v);
        return complain(tag, c);
    }
    if (!last->bytes || last->length != v.data.length ||
        memcmp(last->bytes, v.bytes, last->length)) {
        free(last->bytes);
        last->length = v.data.length;
        last->bytes = mallocMustSucceed(last->length + 1, "plcTag");
        memcpy(last->bytes, v.bytes, last->length);
        epicsTimeGetCurrent(&now);
        epicsTimeToStrftime(stamp, sizeof(stamp), "%H:%M:%S.%03f", &now);
        printf("%s %s=", stamp, tag);
        eipValuePrint(c, &v, stdout);
        putchar('\n');
        fflush(stdout);
    }
    eipValueFree(&v);
    return 0;
}

static int doWatch(eipClient *c, char **tags, int count)
{
    watched *last = callocMustSucceed((size_t)count, sizeof(*last), "plcTag");
    unsigned turn;
    int i, failed = 0;

    for (turn = 0; !failed && (!option.reads || turn < option.reads); turn++) {
        if (turn)
            epicsThreadSleep(option.period);
        for (i = 0; i < count && !failed; i++)
            failed = watchOne(c, tags[i], &last[i]);
    }
    for (i = 0; i < count; i++)
        free(last[i].bytes);
    free(last);
    return failed;
}

/* --- Writing ------------------------------------------------------------------------------- */

/* The messages that write: put into w. Return 0, or -1 with c->why. */
static int refuse(eipClient *c, const char *text, const char *type)
{
    epicsSnprintf(c->why, sizeof(c->why), "\"%.60s\" does not fit %s", text, type);
    return -1;
}

/* More than one of them. */
static int refuseSeveral(eipClient *c, const char *what)
{
    epicsSnprintf(c->why, sizeof(c->why), "several values for %s; allowed: one", what);
    return -1;
}

static int refuseNumber(eipClient *c, const char *text, const eipType *type)
{
    unsigned bits = 8 * type->size - (type->kind == eipSigned);
    epicsUInt64 high = ~(epicsUInt64)0 >> (64 - bits);
    char what[100];

    if (type->kind == eipReal)
        epicsSnprintf(what, sizeof(what), "%s; allowed: a number", type->name);
    else if (type->code == eipBool)
        epicsSnprintf(what, sizeof(what), "%s; allowed: 0, 1, false, true", type->name);
    else
        epicsSnprintf(what, sizeof(what), "%s; allowed: %lld to %llu", type->name,
                      type->kind == eipSigned ? -(long long)high - 1 : 0,
                      (unsigned long long)high);
    return refuse(c, text, what);
}

static int putBit(eipClient *c, eipWriter *w, const eipValue *v, const eipType *type,
                  const char *text)
{
    epicsUInt64 bit = (epicsUInt64)1 << v->name.bit, on;

    if (strcmp(text, "0") && strcmp(text, "1"))
        return refuse(c, text, "a bit; allowed: 0 or 1");
    on = text[0] == '1' ? bit : 0;
    eipValuePath(w, &v->name, eipReadModifyWrite);
    eipPut16(w, type->size);
    eipPutUnsigned(w, type->size, on);
    eipPutUnsigned(w, type->size, on | ~bit);
    return 0;
}

static int putText(eipClient *c, eipWriter *w, const eipValue *v, const char *text)
{
    epicsUInt8 raw[70000];
    size_t length = v->data.code == eipStructureCode ? v->data.length : strlen(text) + 2;

    length = length > sizeof(raw) ? 0
                                  : eipTextPut(v->data.code, raw, length,
                                               v->characters, text, strlen(text));
    if (!length)
        return refuse(c, text, "the string");
    eipValuePath(w, &v->name, eipWriteTag);
    eipPut16(w, v->data.code);
    if (v->data.code == eipStructureCode)
        eipPut16(w, v->data.handle);
    eipPut16(w, 1);
    eipPutBytes(w, raw, length);
    return 0;
}

static int putNumbers(eipClient *c, eipWriter *w, const eipValue *v, const eipType *type,
                      char **words, int count)
{
    int i;

    eipValuePath(w, &v->name, eipWriteTag);
    eipPut16(w, type->code);
    eipPut16(w, (unsigned)count);
    for (i = 0; i < count; i++) {
        epicsUInt8 raw[8];
        eipNumber number;

        if (eipNumberParse(type, words[i], &number) || eipNumberPut(type, raw, &number))
            return refuseNumber(c, words[i], type);
        eipPutBytes(w, raw, type->size);
    }
    return w->full || w->n > c->connect.room ? refuse(c, "so many", "one message") : 0;
}

static int putValue(eipClient *c, eipWriter *w, const eipValue *v, char **words, int count)
{
    const eipType *type = eipTypeOf(v->data.code);

    if (count > 1 && (v->name.bit >= 0 || !type->size))
        return refuseSeveral(c, v->name.bit >= 0 ? "a bit" : "a string");
    if (v->name.bit >= 0)
        return putBit(c, w, v, type, words[0]);
    if (v->data.code == eipStructureCode && !v->characters)
        return refuse(c, words[0], "a structure; its members can be written");
    if (!type->size)
        return putText(c, w, v, words[0]);
    return putNumbers(c, w, v, type, words, count);
}

/* The tag is read first: its type is needed. */
static int doWrite(eipClient *c, char **words, int count)
{
    eipWriter w;
    eipValue v;
    int status;

    if (eipValueInit(c, &v, words[0]))
        return complain(words[0], c);
    status = eipClientRead(c, &v, 1);
    w = eipClientWriter(c);
    if (!status)
        status = putValue(c, &w, &v, words + 1, count - 1);
    if (!status)
        status = eipClientTell(c, &w);
    eipValueFree(&v);
    return status ? complain(words[0], c) : 0;
}

static int doIdentify(eipClient *c)
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
    int isWhole = letter != 'w';
    double number;

    if (epicsParseDouble(text, &number, NULL) || !(number >= low && number <= high) ||
        (isWhole && number != (epicsInt64)number))
        stop("-%c %s; allowed: %.10g to %.10g", letter, text, low, high);
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

static int run(eipClient *c, const char *name, char **words, int count)
{
    switch (name[0]) {
    case 'i':
        return doIdentify(c);
    case 'l':
        return eipClientPrintList(c, count ? words[0] : NULL, stdout) ? complain("list", c) : 0;
    case 'd':
        return eipClientDescribe(c, words[0], stdout) ? complain(words[0], c) : 0;
    case 'r':
        return doRead(c, words, count);
    default:
        return (name[1] == 'a' ? doWatch : doWrite)(c, words, count);
    }
}

int main(int argc, char **argv)
{
    eipClient *c;
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
    connect.connected = !option.unconnected;
    connect.timeout = (unsigned)option.timeout;
    osiSockAttach();
    c = eipClientCreate(&connect, (unsigned)option.timeout);
    if (!c) {
        fputs("plcTag: no memory\n", stderr);
        return 1;
    }
    if (eipClientOpen(c, argv[first]))
        stop("%s", c->why);
    if (option.verbose) {
        eipConnectText(&c->connect, error, sizeof(error));
        fprintf(stderr, "plcTag: %s, %s\n", c->connect.identity.name, error);
    }
    status = run(c, argv[first + 1], argv + first + 2, argc - first - 2);
    eipClientDestroy(c);
    return status;
}
