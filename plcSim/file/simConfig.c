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
    {"name", keyText, AT(name), 1, SIM_NAME_SIZE - 1, "PLC", NULL, "name in the log"},
    {"address", keyText, AT(address), 1, SIM_MAX_ADDRESS - 1, "127.0.0.1", NULL,
     "address to listen on"},
    {"in", keyCount, AT(in), 0, SIM_MAX_BLOCK, "0", NULL, "bytes in a block PLC -> IOC"},
    {"out", keyCount, AT(out), 0, SIM_MAX_BLOCK, "0", NULL,
     "bytes in a block IOC -> PLC"},
    {"byteorder", keyChoice, AT(bigEndian), 0, 0, "big", "little|big",
     "byte order of the PLC's memory"},
    {"period", keyTime, AT(period), 1e-4, 3600, "100 ms", NULL,
     "time from block to block"},
    {"rcvbuf", keyUnsigned, AT(receiveBuffer), 0, 1 << 24, "0", NULL,
     "bytes of the receive buffer, 0 = the system's default"},
    {"restarttime", keyTime, AT(restartTime), 0, 3600, "500 ms", NULL,
     "how long `restart` keeps the PLC off"},
    {"ie_tx", keyUnsigned, AT(txDb), 1, 65535, "1", NULL,
     "DB number of the block to the IOC"},
    {"ie_rx", keyUnsigned, AT(rxDb), 1, 65535, "2", NULL,
     "DB number of the block from the IOC"},
    {"tx_ptrs", keyUnsigned, AT(txPtrsDb), 1, 65535, "3", NULL,
     "DB number of DB_TX_PTRS"},
    {"rx_ptrs", keyUnsigned, AT(rxPtrsDb), 1, 65535, "4", NULL,
     "DB number of DB_RX_PTRS"},
    {"mode", keyChoice, AT(local), 0, 0, "remote", "remote|local",
     "who has control at start"},
    {"sync", keyChoice, AT(sync), 0, 0, "off", "off|on",
     "blocks begin with the header of the sync handshake"},
    {"layout", keyUnsigned, AT(layout), 0, 65535, "0", NULL,
     "layout id, 0 = not checked"},
    {"map", keyChoice, AT(map), 0, 0, "off", "off|on",
     "the IOC may bring tables of pointers; needs sync = on"},
    {"map_db", keyUnsigned, AT(mapDb), 1, 65530, "20", NULL,
     "DB number of MAP_A; MAP_B and MAP follow"},
    {"map_rows", keyUnsigned, AT(mapRows), 8, 248, "32", NULL,
     "rows of a table at most, a multiple of 8"},
    {"allow_map", keyChoice, AT(mapLocked), 0, 0, "on", "on|off",
     "key switch: whether another table is taken"},
    {"watchdog", keyTime, AT(watchdog), 0, 3600, "3 s", NULL,
     "sync: SYNC falls after this time without a block, 0 = never"},
    {"role", keyChoice, AT(role), 0, 0, "single", "single|pair|first|second",
     "one PLC, a pair, or one half of a pair in this process"},
    {"second", keyText, AT(second), 1, SIM_MAX_ADDRESS - 1, "", NULL,
     "address of SECOND, default: address + 1"},
    {"fibre", keyText, AT(fibre), 1, SIM_MAX_ADDRESS - 1, "", NULL,
     "link of two halves: host:port or path of a socket"},
    {"switchover", keyTime, AT(switchover), 0.005, 3600, "500 ms", NULL,
     "a BACKUP takes over after this time"},
    {"startwait", keyTime, AT(startWait), 0, 3600, "5 s", NULL,
     "SECOND alone waits so long for FIRST at start"},
    {"interface", keyText, AT(interface[0]), 1, 15, "", NULL,
     "interface of FIRST whose cable is watched"},
    {"interface_second", keyText, AT(interface[1]), 1, 15, "", NULL,
     "interface of SECOND whose cable is watched"},
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

        snprintf(what, sizeof(what), "%s = %s", key->name,
                 key->choices ? key->choices : key->initial);
        simTextAdd(out, "  %-26s %s\n", what, key->help);
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
