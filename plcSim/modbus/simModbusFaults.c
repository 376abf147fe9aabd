/* simModbusFaults: what goes wrong on purpose, for which requests, how often. It decides;
 * simModbus does it.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <string.h>
#include <strings.h>

#include "simModbusFaults.h"

static const struct fault {
    const char *name;
    unsigned long min, max; /* of the number behind it; max 0 = has none */
    const char *number;
} kinds[SIM_MODBUS_FAULTS] = {
    {"exception", 1, 11,      "a code"           },
    {"slow",      0, 3600000, "a time in ms"     },
    {"silent",    0, 0,       NULL               },
    {"wrongunit", 0, 0,       NULL               },
    {"wrongid",   0, 0,       NULL               },
    {"short",     0, 260,     "a number of bytes"},
    {"close",     0, 0,       NULL               },
    {"garbage",   1, 1000000, "a number of bytes"},
};

static int findKind(const char *word)
{
    int i;

    for (i = 0; i < SIM_MODBUS_FAULTS; i++)
        if (!strcasecmp(word, kinds[i].name))
            return i;
    return -1;
}

int simModbusFaultKnown(const char *word)
{
    return !strcasecmp(word, "busy") || findKind(word) >= 0;
}

void simModbusFaultsClear(simModbusFaults *faults)
{
    faults->count = 0;
}

/* ---- words ---- */

/* The words that are not read yet. */
typedef struct reader {
    char **words;
    size_t count;
    char *error;
} reader;

static int more(const reader *r)
{
    return r->count > 0;
}

static int takeWord(reader *r, const char *word)
{
    if (!r->count || strcasecmp(r->words[0], word))
        return 0;
    r->words++;
    r->count--;
    return 1;
}

static int takeNumber(reader *r, const char *what, unsigned long min, unsigned long max,
                      unsigned long *value)
{
    if (!r->count || simMapNumber(r->words[0], max, value) || *value < min)
        return simFail(r->error, "%s%s%.40s: allowed is %lu ... %lu", what,
                       r->count ? " " : "", r->count ? r->words[0] : " is missing", min,
                       max);
    r->words++;
    r->count--;
    return 0;
}

static int isNumber(const reader *r)
{
    return r->count && r->words[0][0] >= '0' && r->words[0][0] <= '9';
}

/* holding [<first> [<count>]] */
static int takeTable(reader *r, simModbusRule *rule)
{
    unsigned long start, count = 1;

    if (!isNumber(r))
        return 0;
    if (takeNumber(r, "address", 0, SIM_MODBUS_ADDRESSES - 1, &start))
        return -1;
    if (isNumber(r) && takeNumber(r, "count", 1, SIM_MODBUS_ADDRESSES - start, &count))
        return -1;
    rule->start = (unsigned)start;
    rule->count = (unsigned)count;
    return 0;
}

/* [read|write] [<table> ...] [function <n>] [next <n>], in any order */
static int takeFilter(reader *r, simModbusRule *rule)
{
    unsigned long number = 0;

    while (more(r)) {
        if (takeWord(r, "read")) {
            rule->reads = 1;
        } else if (takeWord(r, "write")) {
            rule->writes = 1;
        } else if (takeWord(r, "function")) {
            if (takeNumber(r, "function", 1, 255, &number))
                return -1;
            rule->function = (unsigned)number;
        } else if (takeWord(r, "next")) {
            if (takeNumber(r, "next", 1, 1000000000, &rule->remaining))
                return -1;
        } else if (simTableByName(r->words[0]) != simNoTable) {
            rule->table = simTableByName(r->words[0]);
            takeWord(r, r->words[0]);
            if (takeTable(r, rule))
                return -1;
        } else {
            return simFail(r->error,
                           "\"%.40s\": allowed are read, write, next <n>, function <n>, "
                           "<table> [<first> [<count>]]",
                           r->words[0]);
        }
    }
    return 0;
}

/* What belongs to the fault itself. "busy 3" is "exception 6 next 3". */
static int takeFault(reader *r, simModbusRule *rule)
{
    int kind;

    if (takeWord(r, "busy")) {
        rule->fault = simFaultException;
        rule->number = 6;
        return isNumber(r) ? takeNumber(r, "busy", 1, 1000000000, &rule->remaining) : 0;
    }
    kind = findKind(r->words[0]);
    takeWord(r, kinds[kind].name);
    rule->fault = (simModbusFault)kind;
    if (kinds[kind].max && takeNumber(r, kinds[kind].number, kinds[kind].min,
                                      kinds[kind].max, &rule->number))
        return -1;
    if (rule->fault == simFaultShort)
        rule->close = takeWord(r, "close");
    else if (rule->fault == simFaultClose)
        takeWord(r, "reply");
    else if (!kinds[kind].max)
        takeWord(r, "on");
    return 0;
}

/* ---- rules ---- */

static void removeRule(simModbusFaults *faults, size_t i)
{
    faults->count--;
    memmove(&faults->rules[i], &faults->rules[i + 1],
            (faults->count - i) * sizeof(simModbusRule));
}

static int sameFilter(const simModbusRule *a, const simModbusRule *b)
{
    return a->fault == b->fault && a->reads == b->reads && a->writes == b->writes &&
           a->function == b->function && a->table == b->table && a->start == b->start &&
           a->count == b->count;
}

/* A rule replaces the one for the same requests. */
static int addRule(simModbusFaults *faults, const simModbusRule *rule, char *error)
{
    size_t i;

    for (i = faults->count; i-- > 0;)
        if (sameFilter(&faults->rules[i], rule))
            removeRule(faults, i);
    if (faults->count == SIM_MODBUS_RULES)
        return simFail(error, "more than %d faults at a time", SIM_MODBUS_RULES);
    faults->rules[faults->count++] = *rule;
    return 0;
}

static void removeKind(simModbusFaults *faults, const char *word)
{
    int kind = !strcasecmp(word, "busy") ? simFaultException : findKind(word);
    size_t i;

    for (i = faults->count; i-- > 0;)
        if ((int)faults->rules[i].fault == kind)
            removeRule(faults, i);
}

int simModbusFaultParse(simModbusFaults *faults, char **words, size_t count,
                        char error[SIM_ERROR_SIZE])
{
    reader r = {words, count, error};
    simModbusRule rule;

    if (count == 2 && !strcasecmp(words[1], "off")) {
        removeKind(faults, words[0]);
        return 0;
    }
    memset(&rule, 0, sizeof(rule));
    rule.table = simNoTable;
    if (takeFault(&r, &rule) || takeFilter(&r, &rule))
        return -1;
    return addRule(faults, &rule, error);
}

/* ---- requests ---- */

static int spanMeets(const simModbusRule *rule, const simSpan *span)
{
    if (!span->count)
        return 0;
    if (rule->table == simNoTable)
        return 1;
    if (span->table != rule->table)
        return 0;
    return !rule->count || (rule->start < span->start + span->count &&
                            span->start < rule->start + rule->count);
}

static int ruleMeets(const simModbusRule *rule, const simRequest *request)
{
    int all = !rule->reads && !rule->writes;

    if (rule->function && rule->function != request->function)
        return 0;
    if (all && rule->table == simNoTable)
        return 1;
    return ((all || rule->reads) && spanMeets(rule, &request->read)) ||
           ((all || rule->writes) && spanMeets(rule, &request->write));
}

static void apply(const simModbusRule *rule, simModbusFate *fate)
{
    switch (rule->fault) {
    case simFaultException:
        fate->exception = (int)rule->number;
        break;
    case simFaultSlow:
        fate->delay = (double)rule->number * 1e-3;
        break;
    case simFaultSilent:
        fate->silent = 1;
        break;
    case simFaultWrongUnit:
        fate->wrongUnit = 1;
        break;
    case simFaultWrongId:
        fate->wrongId = 1;
        break;
    case simFaultShort:
        fate->shorten = (long)rule->number;
        fate->close = rule->close;
        break;
    case simFaultClose:
        fate->half = 1;
        break;
    default:
        fate->garbage = (long)rule->number;
    }
}

/* Of two rules for the same fault the newer one counts, and only that one is used up. */
void simModbusFaultsMeet(simModbusFaults *faults, const simRequest *request,
                         simModbusFate *fate)
{
    int met[SIM_MODBUS_FAULTS] = {0};
    size_t i;

    memset(fate, 0, sizeof(*fate));
    fate->shorten = fate->garbage = -1;
    for (i = faults->count; i-- > 0;) {
        simModbusRule *rule = &faults->rules[i];

        if (met[rule->fault] || !ruleMeets(rule, request))
            continue;
        met[rule->fault] = 1;
        apply(rule, fate);
        if (rule->remaining && --rule->remaining == 0)
            removeRule(faults, i);
    }
}

static void ruleText(const simModbusRule *rule, simText *out)
{
    simTextAdd(out, " %s", kinds[rule->fault].name);
    if (kinds[rule->fault].max)
        simTextAdd(out, "=%lu", rule->number);
    if (rule->close)
        simTextAdd(out, ",close");
    if (rule->reads)
        simTextAdd(out, ",read");
    if (rule->writes)
        simTextAdd(out, ",write");
    if (rule->function)
        simTextAdd(out, ",function=%u", rule->function);
    if (rule->table != simNoTable)
        simTextAdd(out, ",%s", simTableName(rule->table));
    if (rule->count)
        simTextAdd(out, "=%u..%u", rule->start, rule->start + rule->count - 1);
    if (rule->remaining)
        simTextAdd(out, ",next=%lu", rule->remaining);
}

void simModbusFaultsText(const simModbusFaults *faults, simText *out)
{
    size_t i;

    for (i = 0; i < faults->count; i++)
        ruleText(&faults->rules[i], out);
    if (!faults->count)
        simTextAdd(out, " none");
}
