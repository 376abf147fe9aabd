/* plcTag: lists, describes, reads, writes and watches the tags of a controller from the command
 * line, by EtherNet/IP. No IOC is needed. */
#include <signal.h>
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

#include "plcTag.h"

static const char usage[] =
    "usage: plcTag [options] host[:port] command\n"
    "\n"
    "  identify              which controller is it\n"
    "  list [pattern]        names and types of its tags; pattern with * and ?, in quotes\n"
    "  describe tag          type of a tag, and the members of its structure\n"
    "  read tag ...          values, each as tag=value\n"
    "  write tag value ...   one value, or as many as elements are written from there on\n"
    "  watch tag ...         prints a tag when its value changes, until ctrl-C\n"
    "\n"
    "A tag is name, a.b[2].c, a[1,2], Program:Main.x or tag.5 (a bit). Options stand before host.\n"
    "\n"
    "  -s slot     of the controller (0); -1: the address is that of the controller itself\n"
    "  -r route    instead of -s: port,link,port,link ..., as 1,6,18,10.0.0.4,1,0\n"
    "  -n count    elements of an array to be read (1)\n"
    "  -t ms       time for each answer (5000)\n"
    "  -w s        time between two reads of watch (1)\n"
    "  -c count    watch: so many reads (no end)\n"
    "  -u          open no connection in the controller\n"
    "  -v          say what happens\n"
    "  -h          this text\n";

static struct {
    const char *slot, *route;
    unsigned count, reads;
    int timeout, unconnected, verbose;
    double period;
} option = {NULL, NULL, 0, 0, 5000, 0, 0, 1.0};

/* Elements to be read; without -n one. */
static unsigned elements(void)
{
    return option.count ? option.count : 1;
}

__attribute__((noreturn)) static void stop(const char *format, ...) EPICS_PRINTF_STYLE(1, 2);
__attribute__((noreturn)) static void wrong(const char *format, ...) EPICS_PRINTF_STYLE(1, 2);

__attribute__((noreturn)) static void end(int status, const char *format, va_list args, const char *behind)
{
    fputs("plcTag: ", stderr);
    vfprintf(stderr, format, args);
    fputs(behind, stderr);
    exit(status);
}

static void stop(const char *format, ...)
{
    va_list args;

    va_start(args, format);
    end(1, format, args, "\n");
    va_end(args);
}

/* A word of the command line is not allowed: the line has said what is. */
__attribute__((noreturn)) static void refuse(const char *format, ...) EPICS_PRINTF_STYLE(1, 2);
static void refuse(const char *format, ...)
{
    va_list args;

    va_start(args, format);
    end(2, format, args, "\n");
    va_end(args);
}

/* The command line is wrong. */
static void wrong(const char *format, ...)
{
    va_list args;

    va_start(args, format);
    end(2, format, args, "; plcTag -h says more\n");
    va_end(args);
}

/* --- Commands ------------------------------------------------------------------------------ */

static int complain(const char *tag, const eipClient *c)
{
    fflush(stdout);
    fprintf(stderr, "plcTag: %s: %s\n", tag, c->why);
    return 1;
}

/* Reads and prints one tag. Returns 0, or 1 after the error line. */
static int readOne(eipClient *c, const char *tag)
{
    eipValue v;

    if (eipValueInit(c, &v, tag))
        return complain(tag, c);
    if (eipClientRead(c, &v, elements())) {
        eipValueFree(&v);
        return complain(tag, c);
    }
    printf("%s=", tag);
    eipValuePrint(c, &v, stdout);
    putchar('\n');
    if (!option.count && eipClientHasMore(c, &v)) {
        fflush(stdout);
        fprintf(stderr, "plcTag: %s is an array, this is its first element; more: -n count before the host\n",
                tag);
    }
    eipValueFree(&v);
    return 0;
}

static int doRead(eipClient *c, char **tags, int count)
{
    int i, failed = 0;

    for (i = 0; i < count; i++) {
        if (c->lost && eipClientReopen(c))
            return complain(tags[i], c);
        failed |= readOne(c, tags[i]);
    }
    return failed;
}

static int doWrite(eipClient *c, char **words, int count)
{
    return plcTagWrite(c, words[0], words + 1, count - 1) ? complain(words[0], c) : 0;
}

/* --- Watching -------------------------------------------------------------------------------- */

/* What a tag of doWatch was the last time. */
typedef struct watched {
    epicsUInt8 *bytes; /* NULL: nothing yet */
    size_t length;
} watched;

static volatile sig_atomic_t interrupted;

static void interrupt(int number)
{
    (void)number;
    interrupted = 1;
}

/* A signal does not end a sleep: so it is one of many short ones. */
static void pauseFor(double seconds)
{
    epicsUInt64 end = epicsMonotonicGet() + (epicsUInt64)(seconds * 1e9), now;

    while (!interrupted && (now = epicsMonotonicGet()) < end)
        epicsThreadSleep(end - now > 50000000 ? 0.05 : (double)(end - now) / 1e9);
}

static const char *timeText(char *text, size_t size)
{
    epicsTimeStamp now;

    epicsTimeGetCurrent(&now);
    epicsTimeToStrftime(text, size, "%H:%M:%S.%03f", &now);
    return text;
}

static int watchOne(eipClient *c, const char *tag, watched *last)
{
    char stamp[40];
    eipValue v;

    if (eipValueInit(c, &v, tag))
        return -1;
    if (eipClientRead(c, &v, elements())) {
        eipValueFree(&v);
        return -1;
    }
    if (!last->bytes || last->length != v.data.length ||
        memcmp(last->bytes, v.bytes, last->length)) {
        free(last->bytes);
        last->length = v.data.length;
        last->bytes = mallocMustSucceed(last->length + 1, "plcTag");
        memcpy(last->bytes, v.bytes, last->length);
        printf("%s %s=", timeText(stamp, sizeof(stamp)), tag);
        eipValuePrint(c, &v, stdout);
        putchar('\n');
        fflush(stdout);
    }
    eipValueFree(&v);
    return 0;
}

static void tellWatch(const char *what, const char *why)
{
    char stamp[40];

    fprintf(stderr, "%s plcTag: %s%s%s\n", timeText(stamp, sizeof(stamp)), what, *why ? ": " : "", why);
}

/* Reads all of them once. Returns 0; 1 after the error line of a tag that is refused; or -1: the
 * connection is lost. */
static int watchAll(eipClient *c, char **tags, int count, watched *last)
{
    int i;

    for (i = 0; i < count; i++)
        if (watchOne(c, tags[i], &last[i]))
            return c->lost ? -1 : complain(tags[i], c);
    return 0;
}

/* Goes on when the connection is lost, until a tag is refused, or ctrl-C. */
static int doWatch(eipClient *c, char **tags, int count)
{
    watched *last = callocMustSucceed((size_t)count, sizeof(*last), "plcTag");
    unsigned turn;
    int i, status = 0;

    signal(SIGINT, interrupt);
    signal(SIGTERM, interrupt);
    for (turn = 0; status <= 0 && !interrupted && (!option.reads || turn < option.reads); turn++) {
        int wasLost = status < 0;

        if (turn)
            pauseFor(wasLost && option.period < 0.5 ? 0.5 : option.period);
        if (interrupted)
            break;
        if (wasLost && eipClientReopen(c))
            continue;
        if (wasLost)
            tellWatch("connected again", "");
        status = watchAll(c, tags, count, last);
        if (status < 0)
            tellWatch("connection lost, trying again", c->why);
    }
    for (i = 0; i < count; i++)
        free(last[i].bytes);
    free(last);
    if (status < 0) {
        eipSocketClose(&c->socket); /* nobody is there to close the connection */
        return 1;
    }
    return status;
}

static int doIdentify(eipClient *c, char **words, int count)
{
    const eipIdentity *i = &c->connect.identity;
    char text[60];

    (void)words, (void)count;
    if (!i->known)
        stop("the PLC does not say what it is");
    eipConnectText(&c->connect, text, sizeof(text));
    printf("%s, revision %u.%u, vendor %u, type %u, code %u, serial number %08X, "
           "status %04X\n%s\n",
           i->name, i->major, i->minor, i->vendor, i->type, i->code, i->serial, i->status,
           text);
    return 0;
}

static int doList(eipClient *c, char **words, int count)
{
    return eipClientPrintList(c, count ? words[0] : NULL, stdout) ? complain("list", c) : 0;
}

static int doDescribe(eipClient *c, char **words, int count)
{
    (void)count;
    return eipClientDescribe(c, words[0], stdout) ? complain(words[0], c) : 0;
}

/* --- Command line -------------------------------------------------------------------------- */

static double numberArg(char letter, const char *text, double low, double high)
{
    int isOther = letter != 'w' && text[strspn(text, "-+0123456789")]; /* 1.5, 1e1, 0x1 */
    double number;

    if (epicsParseDouble(text, &number, NULL) || !(number >= low && number <= high) || isOther)
        refuse("-%c %.40s; allowed: %.10g to %.10g%s", letter, text, low, high,
               isOther ? ", a whole number" : "");
    return number;
}

static void setOption(char letter, const char *text)
{
    switch (letter) {
    case 's':
        numberArg('s', text, -1, 255);
        option.slot = text;
        break;
    case 'r':
        if (!text[strspn(text, " ")])
            refuse("-r is blank; allowed: port,link,port,link ... as 1,0, or -1");
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

/* Returns the index of the first word that is no option. */
static int options(int argc, char **argv)
{
    int i;

    for (i = 1; i < argc && argv[i][0] == '-'; i++) {
        char letter = argv[i][1];
        const char *text = argv[i][1] && argv[i][2] ? argv[i] + 2 : argv[i + 1];

        if (letter == 'h' || strcmp(argv[i], "--help") == 0) {
            fputs(usage, stdout);
            exit(0);
        }
        if (letter && strchr("uv", letter) && !argv[i][2]) {
            *(letter == 'u' ? &option.unconnected : &option.verbose) = 1;
            continue;
        }
        if (!letter || !strchr("srntwc", letter))
            wrong("unknown option \"%.40s\"; allowed: -s -r -n -t -w -c with a value, -u -v -h", argv[i]);
        if (!text)
            wrong("-%c wants a value behind it", letter);
        i += !argv[i][2];
        setOption(letter, text);
    }
    return i;
}

static const struct command {
    const char *name;
    int (*run)(eipClient *c, char **words, int count);
    int least, most; /* words behind it */
    const char *words;
} commands[] = {
    {"identify", doIdentify, 0, 0,     ""                 },
    {"list",     doList,     0, 1,     " [\"pattern\"]"    },
    {"describe", doDescribe, 1, 1,     " tag"             },
    {"read",     doRead,     1, 10000, " tag ..."         },
    {"write",    doWrite,    2, 10000, " tag value ..."   },
    {"watch",    doWatch,    1, 10000, " tag ..."         },
};

/* The command of the words behind the host. */
static const struct command *find(char **words, int count)
{
    const struct command *c = commands, *behind = commands + sizeof(commands) / sizeof(commands[0]);
    int k;

    if (!count)
        wrong("no command behind the host; allowed: identify, list, describe, read, write, watch");
    while (c < behind && strcmp(words[0], c->name))
        c++;
    if (c == behind)
        wrong("unknown command \"%.40s\"; allowed: host, then identify, list, describe, read, write or watch",
              words[0]);
    for (k = 1; k < count && (k == 1 || c->run != doWrite); k++)
        if (words[k][0] == '-')
            wrong("\"%.40s\" is behind the command; allowed: options before the host", words[k]);
    if (count - 1 < c->least || count - 1 > c->most)
        wrong("%d word%s behind %s; allowed: %s%s", count - 1, count == 2 ? "" : "s", words[0], words[0],
              c->words);
    return c;
}

int main(int argc, char **argv)
{
    eipClient *c;
    eipConnectOptions connect = {.connected = 1, .size = eipSizeLarge,
                                 .room = eipUnconnectedRoom};
    char route[80], error[200];
    int first = options(argc, argv), status;
    const struct command *command;

    if (argc < 2) {
        fputs(usage, stderr);
        return 2;
    }
    if (first >= argc || !argv[first][0])
        wrong("no host; allowed: the name or address of the controller, then a command");
    command = find(argv + first + 1, argc - first - 1);
    if (option.slot && option.route)
        wrong("-s and -r; allowed: one of them");
    if (!option.slot)
        option.slot = "0";
    epicsSnprintf(route, sizeof(route), strcmp(option.slot, "-1") ? "1,%s" : "%s", option.slot);
    if (eipRouteParse(option.route ? option.route : route, &connect.route, error,
                      sizeof(error)))
        refuse("%s", error);
    connect.connected = !option.unconnected;
    connect.timeout = (unsigned)option.timeout;
    osiSockAttach();
    c = eipClientCreate(&connect, (unsigned)option.timeout);
    if (!c) {
        fputs("plcTag: no memory\n", stderr);
        return 1;
    }
    if (eipClientCheckHost(c, argv[first]))
        refuse("%s", c->why);
    if (eipClientOpen(c, argv[first]))
        stop("%s", c->why);
    if (option.verbose) {
        eipConnectText(&c->connect, error, sizeof(error));
        fprintf(stderr, "plcTag: %s, %s\n", c->connect.identity.name, error);
    }
    status = command->run(c, argv + first + 2, argc - first - 2);
    eipClientDestroy(c);
    return status;
}
