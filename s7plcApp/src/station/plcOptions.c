/* The table of options; see plcOptions.h. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <epicsString.h>

#include "plcOptions.h"
#include "plcStation.h"

typedef enum {
    optNumber, /* a double from min to max */
    optPeriod, /* the same, or 0: off. What comes back in short turns has a least length */
    optChoice, /* one of the words in `words`, stored as its index */
    optOffset, /* "off" or a byte offset; "offset,word" when `words` is set */
    optPlace,  /* "off" or a number of `unit`, such as register */
    optAlive   /* "off", "offset" or "offset,type" */
} optKind;

typedef struct optRow {
    const char *key;
    optKind kind;
    size_t field; /* where in plcOptions */
    size_t second; /* where the word after the comma goes; 0: there is none */
    double min, max;
    const char *unit;
    const char *words; /* "keep|reject" */
    double initial;
    int early; /* only before iocInit */
    const char *help;
} optRow;

#define AT(member) offsetof(plcOptions, member)

/* clang-format off */
static const optRow rows[] = {
{"recvTimeout",    optNumber, AT(recvTimeout),    0, 10, 3600000, "ms", NULL, 2000, 0,
 "silence from block to block after which the connection is given up"},
{"sendInterval",   optNumber, AT(sendInterval),   0, 1,  3600000, "ms", NULL, 1000, 0,
 "two output blocks are at least this far apart"},
{"holdoff",        optPeriod, AT(holdoff),        0, 0.1, 10000,   "ms", NULL, 0.2,  0,
 "the first write after a pause waits this long for others to join its block"},
{"heartbeat",      optPeriod, AT(heartbeat),      0, 1, 3600000, "ms", NULL, 0,    0,
 "send the output block again when nothing was sent for so long; 0: never"},
{"offlineWrites",  optChoice, AT(offlineWrites),  0, 0,  0, "", "keep|reject",  0,  0,
 "puts while the PLC is away: sent on reconnect, or refused"},
{"minUpdate",      optPeriod, AT(minUpdate),      0, 1, 3600000, "ms", NULL, 0,    0,
 "records take at most one block in this time, the newest; 0: every block"},
{"scan",           optChoice, AT(scan),           0, 0,  0, "", "all|changed",  0,  1,
 "I/O Intr processes all input records at each block, or those whose bytes changed"},
{"wholeBlock",     optChoice, AT(wholeBlock),     0, 0,  0, "", "off|on",       0,  0,
 "one I/O Intr pass sees exactly one block, however long it takes"},
{"scanThread",     optChoice, AT(scanThread),     0, 0,  0, "", "own|callback", 0,  0,
 "small passes of I/O Intr run in the PLC's own thread where nothing waits for it, or never"},
{"alive",          optAlive,  AT(alive), AT(aliveType), 0, PLC_BLOCK_MAX, "bytes", NULL, PLC_OFF, 0,
 "a word of the input block that changes while the PLC program runs: offset[,type]"},
{"aliveTimeout",   optNumber, AT(aliveTimeout),   0, 10, 3600000, "ms", NULL, 2000, 0,
 "the word of `alive` may stand still that long"},
{"timestamp",      optOffset, AT(timestamp), AT(timestampFormat), 0, PLC_BLOCK_MAX, "bytes", "DT|DTL", PLC_OFF, 0,
 "PLC clock in the input block for records with TSE=-2: offset[,DT|DTL]"},
{"readback",       optOffset, AT(readback),       0, 0,  PLC_BLOCK_MAX, "bytes", NULL, PLC_OFF, 1,
 "where the input block mirrors the output block: outputs start from the PLC's values"},
{"track",          optChoice, AT(track),          0, 0,  0, "", "off|on",       0,  0,
 "output records with a read-back follow when the PLC changes the value"},
{"sync",           optChoice, AT(sync),           0, 0,  0, "", "off|on",       0,  1,
 "sync handshake: no put leaves before the PLC has agreed to the values we hold"},
{"layout",         optNumber, AT(layout),         0, 0,  65535,   "",   NULL, 0,    1,
 "layout id of both blocks, for the sync handshake and layoutAt; 0: not checked"},
{"map",            optChoice, AT(map),            0, 0,  0, "", "off|check|download", 0, 1,
 "the PLC's table of pointers (s7plcTables): not looked at, compared, or sent when it differs"},
{"layoutAt",       optOffset, AT(layoutAt),       0, 0,  PLC_BLOCK_MAX, "bytes", NULL, PLC_OFF, 1,
 "without sync: where the input block has the PLC's layout id, a UINT16"},
{"wordOrder",      optChoice, AT(wordOrder),      0, 0,  0, "", "bytes|high|low|ABCD|CDAB|BADC|DCBA", 0, 1,
 "which 16-bit word of values of 4 and 8 bytes comes first; bytes: as they are ordered"},
{"connectTimeout", optNumber, AT(connectTimeout), 0, 50, 60000,   "ms", NULL, 900,  0,
 "an attempt to connect is given up after this time, and the next one begins"},
{"pingPeriod",     optPeriod, AT(pingPeriod),     0, 50, 3600000, "ms", NULL, 1000, 0,
 "redundant pair: both PLCs are asked by ICMP echo whether they are there; 0: never"},
{"log",            optChoice, AT(log),            0, 0,  0, "", "error|warning|info|io", plcLogInfo, 0,
 "what the log says of this PLC; io: its blocks and puts too, in hex"},
{"logTime",        optChoice, AT(logTime),        0, 0,  0, "", "off|on",       0,  0,
 "lines of the log begin with the time"},
{"complete",       optChoice, AT(complete),       0, 0,  0, "", "acknowledged|sent", 0, 0,
 "over an acknowledging wire: a record is active until its put is taken, or only handed over"},
{"writes",         optChoice, AT(writes),         0, 0,  0, "", "newest|all",   0,  0,
 "over an acknowledging wire: of numbers that follow on each other the newest leaves, or all"},
{"requestTimeout", optNumber, AT(requestTimeout), 0, 10, 60000,   "ms", NULL, 1000, 0,
 "a request without an answer for so long: the connection is given up"},
{"readPeriod",     optPeriod, AT(readPeriod),     0, 10, 3600000, "ms", NULL, 1000, 0,
 "by requests: how often the outputs are read again; 0: only at connect"},
{"singleWrite",    optChoice, AT(singleWrite),    0, 0,  0, "", "off|on",       0,  0,
 "registers: a single one is written by function 6, a single coil by function 5"},
{"maskWrite",      optChoice, AT(maskWrite),      0, 0,  0, "", "refuse|rmw",   0,  0,
 "registers: single bits of a register where function 22 is missing: refuse, or read and write"},
{"maxRegisters",   optNumber, AT(maxRegisters),   0, 1,  125,     "registers", NULL, 125, 0,
 "registers: a request holds at most so many registers (a write 123)"},
{"maxBits",        optNumber, AT(maxBits),        0, 1,  2000,    "bits", NULL, 2000, 0,
 "registers: a request holds at most so many coils or discrete inputs (a write 1968)"},
{"requestPause",   optPeriod, AT(requestPause),   0, 1,  10000,   "ms", NULL, 0,    0,
 "registers: between an answer and the next request"},
{"check",          optChoice, AT(check),          0, 0,  0, "", "strict|anyUnit|anyTransaction|loose", 0, 0,
 "registers: what of an answer must be that of the request: unit and transaction number, or less"},
{"framing",        optChoice, AT(framing),  0, 0,  0, "", "tcp|rtu",      0,  0,
 "registers: tcp: with a header; rtu: as on a serial line, with a CRC, for converters"},
{"heartbeatRegister", optPlace, AT(heartbeatRegister), 0, 0, 65535, "register", NULL, PLC_OFF, 0,
 "registers: a holding register that counts up every `heartbeat` ms, 1000 if that is 0"},
};
/* clang-format on */

#define ROWS (sizeof(rows) / sizeof(rows[0]))

static void *field(plcOptions *o, size_t offset)
{
    return (char *)o + offset;
}

void plcOptionsDefault(plcOptions *o)
{
    size_t i;

    memset(o, 0, sizeof(*o));
    for (i = 0; i < ROWS; i++) {
        if (rows[i].kind == optChoice)
            *(int *)field(o, rows[i].field) = (int)rows[i].initial;
        else
            *(double *)field(o, rows[i].field) = rows[i].initial;
    }
    o->aliveType = plcTypeFind("UINT16", 6);
}

int plcOptionsLimits(const char *key, double *min, double *max, double *initial)
{
    size_t i;

    for (i = 0; i < ROWS; i++)
        if (rows[i].kind == optNumber && strcmp(rows[i].key, key) == 0) {
            *min = rows[i].min;
            *max = rows[i].max;
            *initial = rows[i].initial;
            return 0;
        }
    return -1;
}

/* The index of `word` in "a|b|c", or -1. */
static int findWord(const char *words, const char *word)
{
    size_t length = strlen(word);
    int index = 0;

    while (*words) {
        size_t n = strcspn(words, "|");

        if (n == length && epicsStrnCaseCmp(words, word, n) == 0)
            return index;
        words += n + (words[n] == '|');
        index++;
    }
    return -1;
}

/* The word number `index` of "a|b|c", for "%.*s". */
static const char *nthWord(const char *words, int index, int *length)
{
    while (index-- > 0)
        words += strcspn(words, "|") + 1;
    *length = (int)strcspn(words, "|");
    return words;
}

/* What a row allows, for error messages and the printed table. */
static void describe(const optRow *row, char *text, size_t size)
{
    char types[120];

    switch (row->kind) {
    case optNumber:
    case optPeriod:
        epicsSnprintf(text, size, "%s%.10g to %.10g %s",
                      row->kind == optPeriod ? "0, or " : "", row->min, row->max, row->unit);
        break;
    case optChoice:
        epicsSnprintf(text, size, "%s", row->words);
        break;
    case optOffset:
        epicsSnprintf(text, size, "off, or byte offset%s%s%s", row->words ? "[," : "",
                      row->words ? row->words : "", row->words ? "]" : "");
        break;
    case optPlace:
        epicsSnprintf(text, size, "off, or %s %.10g to %.10g", row->unit, row->min,
                      row->max);
        break;
    case optAlive:
        plcTypeList(plcInteger, 8, types, sizeof(types));
        epicsSnprintf(text, size, "off, or byte offset[,type] with type %s", types);
        break;
    }
}

static int setNumber(const optRow *row, plcOptions *o, const char *value)
{
    double number;

    if (epicsParseDouble(value, &number, NULL) || !isfinite(number))
        return -1;
    if ((number < row->min || number > row->max) &&
        !(number == 0 && row->kind == optPeriod))
        return -1;
    *(double *)field(o, row->field) = number == 0 ? 0 : number; /* no -0 */
    return 0;
}

static int setChoice(const optRow *row, plcOptions *o, const char *value)
{
    int index = findWord(row->words, value);

    /* "1" and "0" serve for on and off */
    if (index < 0 && strcmp(row->words, "off|on") == 0 &&
        (strcmp(value, "0") == 0 || strcmp(value, "1") == 0))
        index = value[0] - '0';
    if (index < 0)
        return -1;
    *(int *)field(o, row->field) = index;
    return 0;
}

static int setOffset(const optRow *row, plcOptions *o, const char *value)
{
    const plcType *type = plcTypeFind("UINT16", 6);
    epicsUInt32 offset;
    char *rest;
    int word = 0;

    if (epicsStrCaseCmp(value, "off") == 0) {
        *(double *)field(o, row->field) = PLC_OFF;
        return 0;
    }
    if (strchr(value, '-') || epicsParseUInt32(value, &offset, 0, &rest) ||
        offset > row->max)
        return -1;
    if (*rest == ',' && row->kind == optAlive) {
        type = plcTypeFind(rest + 1, strlen(rest + 1));
        if (!type || !(type->kind & plcInteger))
            return -1;
    } else if (*rest == ',' && row->words) {
        word = findWord(row->words, rest + 1);
        if (word < 0)
            return -1;
    } else if (*rest) {
        return -1;
    }
    *(double *)field(o, row->field) = offset;
    if (row->kind == optAlive)
        *(const plcType **)field(o, row->second) = type;
    else if (row->words)
        *(int *)field(o, row->second) = word;
    return 0;
}

int plcOptionsSet(plcOptions *o, const char *key, const char *value, int running,
                  char *error, size_t size)
{
    static int (*const set[])(const optRow *, plcOptions *, const char *) = {
        setNumber, setNumber, setChoice, setOffset, setOffset, setOffset};
    char allowed[200];
    size_t i;
    int used;

    for (i = 0; i < ROWS && epicsStrCaseCmp(rows[i].key, key); i++)
        ;
    if (i == ROWS) {
        used = epicsSnprintf(error, size, "there is no option \"%s\"; allowed:", key);
        for (i = 0; i < ROWS && used > 0 && (size_t)used < size; i++)
            used += epicsSnprintf(error + used, size - used, " %s", rows[i].key);
        return -1;
    }
    if (running && rows[i].early) {
        epicsSnprintf(error, size, "option %s can only be set before iocInit",
                      rows[i].key);
        return -1;
    }
    if (set[rows[i].kind](&rows[i], o, value)) {
        describe(&rows[i], allowed, sizeof(allowed));
        epicsSnprintf(error, size, "option %s=%s; allowed: %s", rows[i].key, value,
                      allowed);
        return -1;
    }
    return 0;
}

/* The value of a row as it would be typed. */
static void valueText(const optRow *row, const plcOptions *o, char *text, size_t size)
{
    plcOptions *any = (plcOptions *)o;
    double number;
    int length;
    const char *word;

    if (row->kind == optChoice) {
        word = nthWord(row->words, *(int *)field(any, row->field), &length);
        epicsSnprintf(text, size, "%.*s", length, word);
        return;
    }
    number = *(double *)field(any, row->field);
    if (row->kind <= optPeriod) {
        epicsSnprintf(text, size, "%.10g", number);
    } else if (number < 0) {
        epicsSnprintf(text, size, "off");
    } else if (row->kind == optAlive) {
        epicsSnprintf(text, size, "%.0f,%s", number,
                      (*(const plcType **)field(any, row->second))->name);
    } else if (row->words) {
        word = nthWord(row->words, *(int *)field(any, row->second), &length);
        epicsSnprintf(text, size, "%.0f,%.*s", number, length, word);
    } else {
        epicsSnprintf(text, size, "%.0f", number);
    }
}

void plcOptionsPrint(const plcOptions *options, FILE *file)
{
    plcOptions defaults;
    char value[40], allowed[200];
    size_t i;

    plcOptionsDefault(&defaults);
    for (i = 0; i < ROWS; i++) {
        valueText(&rows[i], options ? options : &defaults, value, sizeof(value));
        describe(&rows[i], allowed, sizeof(allowed));
        fprintf(file, "  %-17s %-10s %s%s\n  %28s allowed: %s\n", rows[i].key, value,
                rows[i].help, rows[i].early ? " (before iocInit)" : "", "", allowed);
    }
}

void plcOptionsSummary(const plcOptions *options, char *text, size_t size)
{
    plcOptions defaults;
    char value[40], initial[40];
    size_t used = 0, i;

    plcOptionsDefault(&defaults);
    text[0] = 0;
    for (i = 0; i < ROWS; i++) {
        valueText(&rows[i], options, value, sizeof(value));
        valueText(&rows[i], &defaults, initial, sizeof(initial));
        if (strcmp(value, initial) == 0)
            continue;
        epicsSnprintf(text + used, size - used, "%s%s=%s", used ? " " : "", rows[i].key,
                      value);
        used = strlen(text);
    }
}
