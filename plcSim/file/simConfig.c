/* simConfig: reads the text file that describes a PLC. It does not act on anything.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <cantProceed.h>
#include <epicsString.h>

#include "simConfig.h"
#include "simLog.h"
#include "simSignal.h"

#define MAX_FILE (1024 * 1024)

/* ---- keys ---- */

/* clang-format off */
static const simKey ownKeys[] = {
#define AT(member) offsetof(simConfig, member)
    {.name = "name", .kind = keyText, .offset = AT(name), .min = 1,
     .max = SIM_NAME_SIZE - 1, .initial = "PLC", .help = "name in the log"},
    {.name = "address", .kind = keyText, .offset = AT(address), .min = 1,
     .max = SIM_MAX_ADDRESS - 1, .initial = "127.0.0.1", .help = "address to listen on"},
    {.name = "in", .kind = keyCount, .offset = AT(in), .max = SIM_MAX_BLOCK,
     .initial = "0", .help = "bytes in a block PLC -> IOC"},
    {.name = "out", .kind = keyCount, .offset = AT(out), .max = SIM_MAX_BLOCK,
     .initial = "0", .help = "bytes in a block IOC -> PLC"},
    {.name = "byteorder", .kind = keyChoice, .offset = AT(bigEndian), .initial = "big",
     .choices = "little|big", .help = "byte order of the PLC's memory"},
    {.name = "period", .kind = keyTime, .offset = AT(period), .min = 1e-4, .max = 3600,
     .initial = "100 ms", .help = "time from block to block"},
    {.name = "rcvbuf", .kind = keyUnsigned, .offset = AT(receiveBuffer), .max = 1 << 24,
     .initial = "0", .help = "bytes of the receive buffer, 0 = the system's default"},
    {.name = "restarttime", .kind = keyTime, .offset = AT(restartTime), .max = 3600,
     .initial = "500 ms", .help = "how long `restart` keeps the PLC off"},
    {.name = "ie_tx", .kind = keyUnsigned, .offset = AT(txDb), .min = 1, .max = 65535,
     .initial = "1", .help = "DB number of the block to the IOC"},
    {.name = "ie_rx", .kind = keyUnsigned, .offset = AT(rxDb), .min = 1, .max = 65535,
     .initial = "2", .help = "DB number of the block from the IOC"},
    {.name = "tx_ptrs", .kind = keyUnsigned, .offset = AT(txPtrsDb), .min = 1,
     .max = 65535, .initial = "3", .help = "DB number of DB_TX_PTRS"},
    {.name = "rx_ptrs", .kind = keyUnsigned, .offset = AT(rxPtrsDb), .min = 1,
     .max = 65535, .initial = "4", .help = "DB number of DB_RX_PTRS"},
    {.name = "mode", .kind = keyChoice, .offset = AT(local), .initial = "remote",
     .choices = "remote|local", .help = "who has control at start"},
    {.name = "sync", .kind = keyChoice, .offset = AT(sync), .initial = "off",
     .choices = "off|on", .help = "blocks begin with the header of the sync handshake"},
    {.name = "layout", .kind = keyUnsigned, .offset = AT(layout), .max = 65535,
     .initial = "0", .help = "layout id, 0 = not checked"},
    {.name = "map", .kind = keyChoice, .offset = AT(map), .initial = "off",
     .choices = "off|on",
     .help = "the IOC may bring tables of pointers; needs sync = on"},
    {.name = "map_db", .kind = keyUnsigned, .offset = AT(mapDb), .min = 1, .max = 65530,
     .initial = "20", .help = "DB number of MAP_A; MAP_B and MAP follow"},
    {.name = "map_rows", .kind = keyUnsigned, .offset = AT(mapRows), .min = 8,
     .max = 248, .initial = "32", .help = "rows of a table at most, a multiple of 8"},
    {.name = "allow_map", .kind = keyChoice, .offset = AT(mapLocked), .initial = "on",
     .choices = "on|off", .help = "key switch: whether another table is taken"},
    {.name = "watchdog", .kind = keyTime, .offset = AT(watchdog), .max = 3600,
     .initial = "3 s",
     .help = "sync: SYNC falls after this time without a block, 0 = never"},
    {.name = "role", .kind = keyChoice, .offset = AT(role), .initial = "single",
     .choices = "single|pair|first|second",
     .help = "one PLC, a pair, or one half of a pair in this process"},
    {.name = "second", .kind = keyText, .offset = AT(second), .min = 1,
     .max = SIM_MAX_ADDRESS - 1, .initial = "",
     .help = "address of SECOND, default: address + 1"},
    {.name = "fibre", .kind = keyText, .offset = AT(fibre), .min = 1,
     .max = SIM_MAX_ADDRESS - 1, .initial = "",
     .help = "link of two halves: host:port or path of a socket"},
    {.name = "switchover", .kind = keyTime, .offset = AT(switchover), .min = 0.005,
     .max = 3600, .initial = "500 ms", .help = "a BACKUP takes over after this time"},
    {.name = "startwait", .kind = keyTime, .offset = AT(startWait), .max = 3600,
     .initial = "5 s", .help = "SECOND alone waits so long for FIRST at start"},
    {.name = "interface", .kind = keyText, .offset = AT(interface[0]), .min = 1,
     .max = 15, .initial = "", .help = "interface of FIRST whose cable is watched"},
    {.name = "interface_second", .kind = keyText, .offset = AT(interface[1]), .min = 1,
     .max = 15, .initial = "", .help = "interface of SECOND whose cable is watched"},
#undef AT
};
/* clang-format on */

#define KEY_COUNT (sizeof(ownKeys) / sizeof(ownKeys[0]))

static const simKeyTable ownTable = {ownKeys, KEY_COUNT, 0};

static int setNumber(const simKey *key, void *member, const char *value,
                     char error[SIM_ERROR_SIZE])
{
    char *end;
    unsigned long number;
    int hex = value[0] == '0' && tolower((unsigned char)value[1]) == 'x';

    if (key->kind == keyOrNone && !strcasecmp(value, key->choices)) {
        *(int *)member = -1;
        return 0;
    }
    errno = 0;
    number = strtoul(value, &end, hex ? 16 : 10);
    if (!isdigit((unsigned char)value[0]) || *end || errno || (double)number < key->min ||
        (double)number > key->max)
        return simFail(error, "%s = %.40s: allowed is %s%sa number %.0f ... %.0f",
                       key->name, value, key->choices ? key->choices : "",
                       key->choices ? " or " : "", key->min, key->max);
    if (key->kind == keyCount)
        *(size_t *)member = number;
    else
        *(unsigned *)member = (unsigned)number;
    return 0;
}

static int setTime(const simKey *key, double *member, const char *value,
                   char error[SIM_ERROR_SIZE])
{
    char reason[SIM_ERROR_SIZE];
    double seconds;

    if (simTimeParse(value, &seconds, reason))
        return simFail(error, "%s = %.40s: %.120s", key->name, value, reason);
    if (seconds < key->min || seconds > key->max)
        return simFail(error, "%s = %.40s: allowed is %g ms ... %g s", key->name, value,
                       key->min * 1e3, key->max);
    *member = seconds;
    return 0;
}

static int setChoice(const simKey *key, int *member, const char *value,
                     char error[SIM_ERROR_SIZE])
{
    const char *choice = key->choices;
    int index;

    for (index = 0; *choice; index++) {
        size_t length = strcspn(choice, "|");

        if (strlen(value) == length && !strncasecmp(choice, value, length)) {
            *member = index;
            return 0;
        }
        choice += length;
        choice += *choice == '|';
    }
    return simFail(error, "%s = %.40s: allowed is %s", key->name, value, key->choices);
}

static int setText(const simKey *key, char *member, const char *value,
                   char error[SIM_ERROR_SIZE])
{
    size_t length = strlen(value);

    if (length < (size_t)key->min || length > (size_t)key->max)
        return simFail(error, "%s: allowed are %.0f ... %.0f characters", key->name,
                       key->min, key->max);
    strcpy(member, value);
    return 0;
}

static int setKey(const simKey *key, void *member, const char *value,
                  char error[SIM_ERROR_SIZE])
{
    switch (key->kind) {
    case keyText:
        return setText(key, member, value, error);
    case keyTime:
        return setTime(key, member, value, error);
    case keyChoice:
        return setChoice(key, member, value, error);
    default:
        return setNumber(key, member, value, error);
    }
}

static const simKey *findKey(const simKeyTable *table, const char *name)
{
    size_t i;

    for (i = 0; i < table->count; i++)
        if (!strcasecmp(name, table->keys[i].name))
            return &table->keys[i];
    return NULL;
}

int simConfigSet(simConfig *config, const char *name, const char *value,
                 char error[SIM_ERROR_SIZE])
{
    const simKey *key = findKey(&ownTable, name);
    size_t i;

    if (key)
        return setKey(key, (char *)config + key->offset, value, error);
    for (i = 0; i < config->tableCount; i++) {
        key = findKey(config->tables[i], name);
        if (key)
            return setKey(key, (char *)config->values[i] + key->offset, value, error);
    }
    return simFail(error, "\"%.40s\" is no key; `plcSim --help` lists them", name);
}

static void helpTable(const simKeyTable *table, simText *out)
{
    char what[64];
    size_t i;

    for (i = 0; i < table->count; i++) {
        const simKey *key = &table->keys[i];

        snprintf(what, sizeof(what), "%s = %s", key->name, key->initial);
        simTextAdd(out, "  %-26s %s%s%s\n", what, key->help,
                   !key->choices            ? ""
                   : key->kind == keyChoice ? "; "
                                            : ", or ",
                   key->choices ? key->choices : "");
    }
}

void simConfigHelp(const simConfig *config, simText *out)
{
    size_t i;

    helpTable(&ownTable, out);
    for (i = 0; i < config->tableCount; i++)
        helpTable(config->tables[i], out);
}

static void setDefaults(const simKeyTable *table, void *values)
{
    char error[SIM_ERROR_SIZE];
    size_t i;

    for (i = 0; i < table->count; i++) {
        const simKey *key = &table->keys[i];

        if (key->initial[0] &&
            setKey(key, (char *)values + key->offset, key->initial, error))
            cantProceed("simConfigInit: %s", error);
    }
}

void simConfigInit(simConfig *config)
{
    memset(config, 0, sizeof(*config));
    setDefaults(&ownTable, config);
}

void simConfigAdd(simConfig *config, const simKeyTable *table)
{
    void *values = callocMustSucceed(1, table->size, "simConfigAdd");

    if (config->tableCount == SIM_MAX_KEY_TABLES)
        cantProceed("simConfigAdd: too many tables");
    config->tables[config->tableCount] = table;
    config->values[config->tableCount++] = values;
    setDefaults(table, values);
}

const void *simConfigValues(const simConfig *config, const simKeyTable *table)
{
    size_t i;

    for (i = 0; i < config->tableCount; i++)
        if (config->tables[i] == table)
            return config->values[i];
    cantProceed("simConfigValues: the table was not added");
    return NULL;
}

void simConfigFree(simConfig *config)
{
    size_t i, j;

    for (i = 0; i < config->lineCount; i++) {
        for (j = 0; j < config->lines[i].count; j++)
            free(config->lines[i].words[j]);
        free(config->lines[i].words);
    }
    free(config->lines);
    for (i = 0; i < config->tableCount; i++)
        free(config->values[i]);
    config->lines = NULL;
    config->lineCount = config->tableCount = 0;
}

/* ---- lines ---- */

/* Copies one quoted word down over the line. Returns the end of it, or NULL. */
static char *quoted(char *from, char **to)
{
    for (from++; *from && *from != '"'; from++) {
        if (*from == '\\' && (from[1] == '"' || from[1] == '\\'))
            from++;
        *(*to)++ = *from;
    }
    return *from == '"' ? from + 1 : NULL;
}

int simSplit(char *line, char **words, size_t max, char error[SIM_ERROR_SIZE])
{
    size_t count = 0;
    char *from = line;

    for (;;) {
        char *to;

        from += strspn(from, " \t\r\n");
        if (*from == 0 || *from == '#')
            return (int)count;
        if (count == max) {
            simFail(error, "more than %lu words", (unsigned long)max);
            return -1;
        }
        words[count++] = to = from;
        while (*from && !strchr(" \t\r\n", *from)) {
            if (*from != '"') {
                *to++ = *from++;
                continue;
            }
            from = quoted(from, &to);
            if (!from) {
                simFail(error, "a \" is missing");
                return -1;
            }
        }
        if (*from)
            from++;
        *to = 0;
    }
}

static void keepLine(simConfig *config, unsigned number, char **words, size_t count)
{
    simLine *line;
    size_t i;

    config->lines = realloc(config->lines, (config->lineCount + 1) * sizeof(simLine));
    if (!config->lines)
        cantProceed("simConfigRead: out of memory");
    line = &config->lines[config->lineCount++];
    line->number = number;
    line->count = count;
    line->words = callocMustSucceed(count + 1, sizeof(char *), "simConfigRead");
    for (i = 0; i < count; i++)
        line->words[i] = epicsStrDup(words[i]);
}

/* The value behind '=': without comment, blanks at the ends, and quotes. */
static char *cleanValue(char *value)
{
    size_t length;
    char *comment = strchr(value, '#');

    if (comment)
        *comment = 0;
    value += strspn(value, " \t");
    length = strlen(value);
    while (length && isspace((unsigned char)value[length - 1]))
        value[--length] = 0;
    if (length >= 2 && value[0] == '"' && value[length - 1] == '"') {
        value[length - 1] = 0;
        value++;
    }
    return value;
}

static int readLine(simConfig *config, unsigned number, char *text,
                    char error[SIM_ERROR_SIZE])
{
    char *words[SIM_MAX_WORDS];
    char *name = text + strspn(text, " \t");
    size_t length = strspn(name, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_");
    char *equals = name + length + strspn(name + length, " \t");
    int count;

    if (length && *equals == '=') {
        name[length] = 0;
        return simConfigSet(config, name, cleanValue(equals + 1), error);
    }
    count = simSplit(text, words, SIM_MAX_WORDS, error);
    if (count > 0)
        keepLine(config, number, words, (size_t)count);
    return count < 0 ? -1 : 0;
}

int simConfigReadText(simConfig *config, const char *file, const char *text, simText *out)
{
    char error[SIM_ERROR_SIZE];
    char *copy = epicsStrDup(text);
    char *line = copy;
    unsigned number;
    int errors = 0;

    snprintf(config->file, sizeof(config->file), "%s", file);
    for (number = 1; line; number++) {
        char *next = strchr(line, '\n');

        if (next)
            *next++ = 0;
        if (readLine(config, number, line, error)) {
            simTextAdd(out, "%s:%u: %s\n", file, number, error);
            errors++;
        }
        line = next;
    }
    free(copy);
    return errors;
}

int simConfigRead(simConfig *config, const char *file)
{
    simText messages = {NULL, 0, 0};
    FILE *fp = fopen(file, "r");
    char *text;
    size_t length;
    int errors;

    if (!fp) {
        fprintf(stderr, "plcSim: cannot read %s: %s\n", file, strerror(errno));
        return 1;
    }
    text = callocMustSucceed(1, MAX_FILE + 1, "simConfigRead");
    length = fread(text, 1, MAX_FILE, fp);
    errors = ferror(fp) || length == MAX_FILE || memchr(text, 0, length);
    fclose(fp);
    if (errors)
        simTextAdd(&messages, "plcSim: %s is no text file of less than 1 MiB\n", file);
    else
        errors = simConfigReadText(config, file, text, &messages);
    free(text);
    if (messages.text)
        fputs(messages.text, stderr);
    simTextFree(&messages);
    return errors;
}
