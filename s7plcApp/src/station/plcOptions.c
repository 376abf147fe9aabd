/* The options; see plcOptions.h. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <epicsString.h>

#include "plcOptions.h"
#include "plcStation.h"

#define AT(member) offsetof(plcOptions, member)

/* clang-format off */
static const plcOptionRow rows[] = {
    {.key = "recvTimeout", .kind = plcOptNumber, .field = AT(recvTimeout), .min = 10,
     .max = 3600000, .unit = "ms", .initial = 2000,
     .wire = plcOptInBlocks,
     .help = "silence from block to block after which the connection is given up"},
    {.key = "sendInterval", .kind = plcOptNumber, .field = AT(sendInterval), .min = 1,
     .max = 3600000, .unit = "ms", .initial = 1000,
     .help = "two output blocks are at least this far apart"},
    {.key = "holdoff", .kind = plcOptPeriod, .field = AT(holdoff), .min = 0.1, .max = 10000,
     .unit = "ms", .initial = 0.2,
     .help = "the first write after a pause waits this long for others to join its block"},
    {.key = "heartbeat", .kind = plcOptPeriod, .field = AT(heartbeat), .min = 1,
     .max = 3600000, .unit = "ms",
     .wire = plcOptOutBlocks,
     .help = "send the output block again when nothing was sent for so long; 0: never"},
    {.key = "offlineWrites", .kind = plcOptChoice, .field = AT(offlineWrites),
     .words = "keep|reject",
     .help = "puts while the PLC is away: sent on reconnect, or refused"},
    {.key = "minUpdate", .kind = plcOptPeriod, .field = AT(minUpdate), .min = 1,
     .max = 3600000, .unit = "ms",
     .help = "records take at most one block in this time, the newest; 0: every block"},
    {.key = "scan", .kind = plcOptChoice, .field = AT(scan), .words = "all|changed",
     .early = 1,
     .help = "I/O Intr processes all input records at each block, or those whose bytes changed"},
    {.key = "wholeBlock", .kind = plcOptChoice, .field = AT(wholeBlock), .words = "off|on",
     .help = "one I/O Intr pass sees exactly one block, however long it takes"},
    {.key = "scanThread", .kind = plcOptChoice, .field = AT(scanThread),
     .words = "own|callback",
     .help = "small passes of I/O Intr run in the PLC's own thread where nothing waits for it, or never"},
    {.key = "alive", .kind = plcOptAlive, .field = AT(alive), .second = AT(aliveType),
     .max = PLC_BLOCK_MAX, .initial = PLC_OFF,
     .help = "a word of the input block that changes while the PLC program runs: offset[,type]"},
    {.key = "aliveTimeout", .kind = plcOptNumber, .field = AT(aliveTimeout), .min = 10,
     .max = 3600000, .unit = "ms", .initial = 2000,
     .with = "alive",
     .help = "the word of `alive` may stand still that long"},
    {.key = "timestamp", .kind = plcOptOffset, .field = AT(timestamp),
     .second = AT(timestampFormat), .max = PLC_BLOCK_MAX, .words = "DT|DTL",
     .initial = PLC_OFF,
     .help = "PLC clock in the input block for records with TSE=-2: offset[,DT|DTL]"},
    {.key = "readback", .kind = plcOptOffset, .field = AT(readback), .max = PLC_BLOCK_MAX,
     .initial = PLC_OFF, .early = 1,
     .help = "where the input block mirrors the output block: outputs start from the PLC's values"},
    {.key = "track", .kind = plcOptChoice, .field = AT(track), .words = "off|on",
     .help = "output records with a read-back follow when the PLC changes the value"},
    {.key = "sync", .kind = plcOptChoice, .field = AT(sync), .words = "off|on", .early = 1,
     .help = "sync handshake: no put leaves before the PLC has agreed to the values we hold"},
    {.key = "layout", .kind = plcOptWhole, .field = AT(layout), .max = 65535, .early = 1,
     .with = "sync|layoutAt",
     .help = "layout id of both blocks, for the sync handshake and layoutAt; 0: not checked"},
    {.key = "map", .kind = plcOptChoice, .field = AT(map), .words = "off|check|download",
     .early = 1,
     .help = "the PLC's table of pointers (s7plcTables): not looked at, compared, or sent when it differs"},
    {.key = "layoutAt", .kind = plcOptOffset, .field = AT(layoutAt), .max = PLC_BLOCK_MAX,
     .initial = PLC_OFF, .early = 1,
     .help = "without sync: where the input block has the PLC's layout id, a UINT16"},
    {.key = "wordOrder", .kind = plcOptChoice, .field = AT(wordOrder),
     .words = "bytes|high|low|ABCD|CDAB|BADC|DCBA", .early = 1,
     .wire = plcOptOffsets,
     .help = "which 16-bit word of values of 4 and 8 bytes comes first; bytes: as they are ordered"},
    {.key = "textOrder", .kind = plcOptChoice, .field = AT(textOrder),
     .words = "ABCD|BADC|CDAB|DCBA|A0|0A", .early = 1,
     .wire = plcOptOffsets,
     .help = "how the characters of texts stand in the PLC's bytes; A0, 0A: one in two bytes"},
    {.key = "connectTimeout", .kind = plcOptNumber, .field = AT(connectTimeout), .min = 50,
     .max = 60000, .unit = "ms", .initial = 900,
     .help = "an attempt to connect is given up after this time, and the next one begins"},
    {.key = "log", .kind = plcOptChoice, .field = AT(log), .words = "error|warning|info|io",
     .initial = plcLogInfo,
     .help = "what the log says of this PLC; io: its blocks and puts too, in hex"},
    {.key = "logTime", .kind = plcOptChoice, .field = AT(logTime), .words = "off|on",
     .help = "lines of the log begin with the time"},
    {.key = "complete", .kind = plcOptChoice, .field = AT(complete),
     .words = "acknowledged|sent",
     .wire = plcOptAcks,
     .help = "over an acknowledging wire: a record is active until its put is taken, or only handed over"},
    {.key = "writes", .kind = plcOptChoice, .field = AT(writes), .words = "newest|all",
     .wire = plcOptAcks,
     .help = "over an acknowledging wire: of numbers that follow on each other the newest leaves, or all"},
    {.key = "requestTimeout", .kind = plcOptNumber, .field = AT(requestTimeout), .min = 10,
     .max = 60000, .unit = "ms", .initial = 1000,
     .wire = plcOptRequests,
     .help = "a request without an answer for so long: the connection is given up"},
    {.key = "readPeriod", .kind = plcOptPeriod, .field = AT(readPeriod), .min = 10,
     .max = 3600000, .unit = "ms", .initial = 1000,
     .wire = plcOptRequests | plcOptOffsets,
     .help = "by requests: how often the outputs are read again; 0: only at connect"},
};
/* clang-format on */

/* Ours; behind it those that others have added. */
static plcOptionTable core = {.rows = rows, .count = sizeof(rows) / sizeof(rows[0])};

/* Goes through the rows of all tables. */
#define EACH_ROW(table, row)                                                              \
    for ((table) = &core; (table); (table) = (table)->next)                               \
        for ((row) = (table)->rows; (row) < (table)->rows + (table)->count; (row)++)

void plcOptionsAdd(plcOptionTable *table)
{
    plcOptionTable *last = &core;
    size_t used = offsetof(plcOptions, own);

    while (last->next && last != table) {
        last = last->next;
        used = last->at + last->size;
    }
    if (last == table)
        return;
    used = (used + sizeof(double) - 1) / sizeof(double) * sizeof(double);
    if (used + table->size > sizeof(plcOptions))
        cantProceed("plcOptionsAdd: no room for %lu bytes of options\n",
                    (unsigned long)table->size);
    table->at = used;
    last->next = table;
}

const void *plcOptionsOwn(const plcOptions *o, const plcOptionTable *table)
{
    return (const char *)o + table->at;
}

/* The same, to be changed. */
static void *ownOf(plcOptions *o, const plcOptionTable *table)
{
    return (char *)o + table->at;
}

static void *field(void *own, size_t offset)
{
    return (char *)own + offset;
}

void plcOptionsDefault(plcOptions *o)
{
    const plcOptionTable *table;
    const plcOptionRow *row;

    memset(o, 0, sizeof(*o));
    EACH_ROW(table, row) {
        if (row->kind == plcOptChoice)
            *(int *)field(ownOf(o, table), row->field) = (int)row->initial;
        else
            *(double *)field(ownOf(o, table), row->field) = row->initial;
    }
    o->aliveType = plcTypeFind("UINT16", 6);
}

/* The row of this key and its table; NULL: there is none. */
static const plcOptionRow *find(const char *key, const plcOptionTable **table)
{
    const plcOptionRow *row;

    EACH_ROW(*table, row)
        if (epicsStrCaseCmp(row->key, key) == 0)
            return row;
    return NULL;
}

int plcOptionsLimits(const char *key, double *min, double *max, double *initial)
{
    const plcOptionTable *table;
    const plcOptionRow *row = find(key, &table);

    if (!row || row->kind != plcOptNumber)
        return -1;
    *min = row->min;
    *max = row->max;
    *initial = row->initial;
    return 0;
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
static void describe(const plcOptionRow *row, char *text, size_t size)
{
    char types[120];

    switch (row->kind) {
    case plcOptNumber:
    case plcOptPeriod:
    case plcOptWhole:
        epicsSnprintf(text, size, "%s%.10g to %.10g%s%s",
                      row->kind == plcOptPeriod ? "0, or " : "", row->min, row->max,
                      row->unit ? " " : "", row->unit ? row->unit : "");
        break;
    case plcOptChoice:
        epicsSnprintf(text, size, "%s", row->words);
        break;
    case plcOptOffset:
        epicsSnprintf(text, size, "off, or byte offset%s%s%s", row->words ? "[," : "",
                      row->words ? row->words : "", row->words ? "]" : "");
        break;
    case plcOptPlace:
        epicsSnprintf(text, size, "off, or %s %.10g to %.10g", row->unit, row->min,
                      row->max);
        break;
    case plcOptAlive:
        plcTypeList(plcInteger, 8, types, sizeof(types));
        epicsSnprintf(text, size, "off, or byte offset[,type] with type %s", types);
        break;
    }
}

static int setNumber(const plcOptionRow *row, void *own, const char *value)
{
    double number;

    if (epicsParseDouble(value, &number, NULL) || !isfinite(number))
        return -1;
    if ((number < row->min || number > row->max) &&
        !(number == 0 && row->kind == plcOptPeriod))
        return -1;
    *(double *)field(own, row->field) = number == 0 ? 0 : number; /* no -0 */
    return 0;
}

/* 1e2 is refused: it may be meant as hex. */
static int setWhole(const plcOptionRow *row, void *own, const char *value)
{
    int base = value[0] == '0' && (value[1] == 'x' || value[1] == 'X') ? 16 : 10;
    epicsUInt32 number;

    if (strchr(value, '-') || epicsParseUInt32(value, &number, base, NULL) ||
        number < row->min || number > row->max)
        return -1;
    *(double *)field(own, row->field) = number;
    return 0;
}

static int setChoice(const plcOptionRow *row, void *own, const char *value)
{
    int index = findWord(row->words, value);

    /* "1" and "0" serve for on and off */
    if (index < 0 && strcmp(row->words, "off|on") == 0 &&
        (strcmp(value, "0") == 0 || strcmp(value, "1") == 0))
        index = value[0] - '0';
    if (index < 0)
        return -1;
    *(int *)field(own, row->field) = index;
    return 0;
}

static int setOffset(const plcOptionRow *row, void *own, const char *value)
{
    const plcType *type = plcTypeFind("UINT16", 6);
    epicsUInt32 offset;
    char *rest;
    int word = 0;

    if (epicsStrCaseCmp(value, "off") == 0) {
        *(double *)field(own, row->field) = PLC_OFF;
        return 0;
    }
    if (strchr(value, '-') || epicsParseUInt32(value, &offset, 0, &rest) ||
        offset > row->max)
        return -1;
    if (*rest == ',' && row->kind == plcOptAlive) {
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
    *(double *)field(own, row->field) = offset;
    if (row->kind == plcOptAlive)
        *(const plcType **)field(own, row->second) = type;
    else if (row->words)
        *(int *)field(own, row->second) = word;
    return 0;
}

int plcOptionsSet(plcOptions *o, const char *key, const char *value, int running,
                  char *error, size_t size)
{
    static int (*const set[])(const plcOptionRow *, void *, const char *) = {
        [plcOptNumber] = setNumber, [plcOptPeriod] = setNumber, [plcOptWhole] = setWhole,
        [plcOptChoice] = setChoice, [plcOptOffset] = setOffset, [plcOptPlace] = setOffset,
        [plcOptAlive] = setOffset};
    const plcOptionTable *table;
    const plcOptionRow *row = find(key, &table);
    char allowed[200];
    int used;

    if (!row) {
        used = epicsSnprintf(error, size, "there is no option \"%.40s\"; allowed:", key);
        EACH_ROW(table, row)
            if (used > 0 && (size_t)used < size)
                used += epicsSnprintf(error + used, size - used, " %s", row->key);
        return -1;
    }
    if (running && row->early) {
        epicsSnprintf(error, size, "option %s can only be set before iocInit", row->key);
        return -1;
    }
    if (set[row->kind](row, ownOf(o, table), value)) {
        describe(row, allowed, sizeof(allowed));
        epicsSnprintf(error, size, "option %s=%.60s; allowed: %s%s", row->key, value, allowed,
                      row->kind == plcOptWhole && value[strspn(value, "+-0123456789")]
                          ? ", a whole number" : "");
        return -1;
    }
    return 0;
}

/* The value of a row as it would be typed. */
static void valueText(const plcOptionTable *table, const plcOptionRow *row, const plcOptions *o,
                      char *text, size_t size)
{
    void *own = ownOf((plcOptions *)o, table);
    double number;
    int length;
    const char *word;

    if (row->kind == plcOptChoice) {
        word = nthWord(row->words, *(int *)field(own, row->field), &length);
        epicsSnprintf(text, size, "%.*s", length, word);
        return;
    }
    number = *(double *)field(own, row->field);
    if (row->kind <= plcOptWhole) {
        epicsSnprintf(text, size, "%.10g", number);
    } else if (number < 0) {
        epicsSnprintf(text, size, "off");
    } else if (row->kind == plcOptAlive) {
        epicsSnprintf(text, size, "%.0f,%s", number,
                      (*(const plcType **)field(own, row->second))->name);
    } else if (row->words) {
        word = nthWord(row->words, *(int *)field(own, row->second), &length);
        epicsSnprintf(text, size, "%.0f,%.*s", number, length, word);
    } else {
        epicsSnprintf(text, size, "%.0f", number);
    }
}

/* True when the option is not what it is by default. */
static int isSet(const plcOptionTable *table, const plcOptionRow *row, const plcOptions *o,
                 char *value, size_t size)
{
    plcOptions defaults;
    char initial[40];

    plcOptionsDefault(&defaults);
    valueText(table, row, o, value, size);
    valueText(table, row, &defaults, initial, sizeof(initial));
    return strcmp(value, initial) != 0;
}

static int isAmong(const char *const names[], const char *name)
{
    while (*names && strcmp(*names, name))
        names++;
    return *names != NULL;
}

/* True when one of the options "sync|layoutAt" is set. */
static int oneIsSet(const char *keys, const plcOptions *o)
{
    const plcOptionTable *table;
    const plcOptionRow *row;
    char value[40];

    EACH_ROW(table, row)
        if (findWord(keys, row->key) >= 0 && isSet(table, row, o, value, sizeof(value)))
            return 1;
    return 0;
}

/* The table that has this option of ours in its own way; NULL: none for this PLC. */
static const plcOptionTable *userOf(const plcOptionRow *row, const char *const names[])
{
    const plcOptionTable *table = &core;

    while (table && !(table->uses && strcmp(table->uses, row->key) == 0 &&
                      isAmong(names, table->of)))
        table = table->next;
    return table;
}

/* Why the option has no effect, "" when it has. */
static void whyIdle(const plcOptionTable *table, const plcOptionRow *row, const plcOptions *o,
                    unsigned wire, const char *const names[], char *why, size_t size)
{
    static const char *const what[] = {"PLCs that send blocks", "outputs that leave in blocks",
                                       "PLCs that are asked by requests",
                                       "wires that acknowledge puts",
                                       "values with offsets, not names"};
    const plcOptionTable *user = userOf(row, names);
    const char *with = user ? user->usesWith : row->with;
    unsigned i, missing = user ? 0 : row->wire & ~wire;

    why[0] = 0;
    for (i = 0; missing >> i && !(missing >> i & 1); i++)
        ;
    if (missing)
        epicsSnprintf(why, size, "only for %s", what[i]);
    else if (table->of && !isAmong(names, table->of))
        epicsSnprintf(why, size, "only for: %s", table->of);
    else if (with && !oneIsSet(with, o))
        epicsSnprintf(why, size, "it needs option %.*s%s%s", (int)strcspn(with, "|"), with,
                      strchr(with, '|') ? " or " : "",
                      strchr(with, '|') ? strchr(with, '|') + 1 : "");
}

void plcOptionsIdle(const plcOptions *before, const plcOptions *now, unsigned wire,
                    const char *const names[], void (*tell)(void *arg, const char *line), void *arg)
{
    const plcOptionTable *table;
    const plcOptionRow *row;
    char value[40], old[40], why[80], line[200];

    EACH_ROW(table, row) {
        valueText(table, row, before, old, sizeof(old));
        if (!isSet(table, row, now, value, sizeof(value)) || strcmp(value, old) == 0)
            continue;
        whyIdle(table, row, now, wire, names, why, sizeof(why));
        if (!why[0])
            continue;
        epicsSnprintf(line, sizeof(line), "option %s=%s has no effect on this PLC: %s", row->key,
                      value, why);
        tell(arg, line);
    }
}

void plcOptionsPrint(const plcOptions *options, FILE *file)
{
    const plcOptionTable *table;
    const plcOptionRow *row;
    plcOptions defaults;
    char value[40], allowed[200];

    plcOptionsDefault(&defaults);
    EACH_ROW(table, row) {
        valueText(table, row, options ? options : &defaults, value, sizeof(value));
        describe(row, allowed, sizeof(allowed));
        fprintf(file, "  %-17s %-10s %s%s\n  %28s allowed: %s\n", row->key, value, row->help,
                row->early ? " (before iocInit)" : "", "", allowed);
    }
}

void plcOptionsSummary(const plcOptions *options, char *text, size_t size)
{
    const plcOptionTable *table;
    const plcOptionRow *row;
    char value[40];
    size_t used = 0;

    text[0] = 0;
    EACH_ROW(table, row) {
        if (!isSet(table, row, options, value, sizeof(value)))
            continue;
        epicsSnprintf(text + used, size - used, "%s%s=%s", used ? " " : "", row->key, value);
        used = strlen(text);
    }
}
