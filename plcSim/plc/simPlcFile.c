/* simPlcFile: the statements of the file: they make the memory, signals, mirrors,
 * transfers and Modbus areas of a PLC. It does not know when they are used.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <cantProceed.h>

#include "simPlc.h"
#include "simPlcFile.h"

static void *grow(void *list, size_t count, size_t size)
{
    list = realloc(list, (count + 1) * size);
    if (!list)
        cantProceed("simPlc: out of memory");
    return list;
}

static int addSignal(simPlc *plc, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    simSignal signal;

    if (!plc->tx && words[0] && words[0][0] >= '0' && words[0][0] <= '9')
        return simFail(error, "a signal at %.40s needs a block to the IOC, but in = 0",
                       words[0]);
    if (simSignalParse(&plc->memory, plc->tx, words, count, &signal, error))
        return -1;
    plc->signals = grow(plc->signals, plc->signalCount, sizeof(simSignal));
    plc->signals[plc->signalCount++] = signal;
    return 0;
}

static int sizeArg(const char *word, size_t *value)
{
    char *end;

    if (word[0] < '0' || word[0] > '9')
        return -1;
    *value = strtoul(word, &end, 0);
    return *end || *value > SIM_MAX_BLOCK ? -1 : 0;
}

static int addMirror(simPlc *plc, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    simMirror m;

    if (count != 4 || strcmp(words[2], "->") || sizeArg(words[0], &m.from) ||
        sizeArg(words[1], &m.length) || sizeArg(words[3], &m.to))
        return simFail(error,
                       "a mirror wants: <offset in out> <length> -> <offset in in>");
    if (plc->config->sync)
        return simFail(error, "no mirror with sync = on: use tx and rx");
    if (m.length < 1 || m.from > plc->config->out || m.length > plc->config->out - m.from)
        return simFail(
            error, "mirror: %lu bytes at offset %lu are outside of the %lu bytes of out",
            (unsigned long)m.length, (unsigned long)m.from,
            (unsigned long)plc->config->out);
    if (m.to > plc->config->in || m.length > plc->config->in - m.to)
        return simFail(
            error, "mirror: %lu bytes at offset %lu are outside of the %lu bytes of in",
            (unsigned long)m.length, (unsigned long)m.to, (unsigned long)plc->config->in);
    plc->mirrors = grow(plc->mirrors, plc->mirrorCount, sizeof(simMirror));
    plc->mirrors[plc->mirrorCount++] = m;
    return 0;
}

static int addTx(simPlc *plc, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    return simProgramTransfer(&plc->program, 1, words, count, error);
}

static int addRx(simPlc *plc, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    return simProgramTransfer(&plc->program, 0, words, count, error);
}

static int addModbus(simPlc *plc, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    return simMapStatement(&plc->modbus.map, words, count, error);
}

/* db <number> <bytes> [name] */
static int addBlock(simPlc *plc, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    const char *name = count == 3 ? words[2] : "";
    size_t number, size;

    if (count < 2 || count > 3 || sizeArg(words[0], &number) || number < 1 ||
        number > 65535 || sizeArg(words[1], &size) || size < 1 ||
        strlen(name) >= SIM_NAME_SIZE)
        return simFail(error,
                       "a data block wants: <number 1 ... 65535> <bytes 1 ... %u> [name]",
                       SIM_MAX_BLOCK);
    if (simMemoryFindName(&plc->memory, name))
        return simFail(error, "there is a block \"%s\" already", name);
    if (!simMemoryAdd(&plc->memory, SIM_AREA_DB, (unsigned)number, size, name))
        return simFail(error, "there is a DB%lu already", (unsigned long)number);
    return 0;
}

/* "in 4" is the same as "in.4": joins the two words. Returns the number of words used. */
static size_t placeWords(char **words, size_t count, char place[80])
{
    if (count > 1 && !strchr(words[0], '.') && words[1][0] >= '0' && words[1][0] <= '9' &&
        !(words[0][0] >= '0' && words[0][0] <= '9')) {
        size_t length = strlen(words[0]);
        int isArea = length > 1 && words[0][length - 1] >= '0' &&
                     words[0][length - 1] <= '9' && strchr("MIQmiq", words[0][0]);

        if (!isArea) {
            snprintf(place, 80, "%.40s.%.30s", words[0], words[1]);
            return 2;
        }
    }
    snprintf(place, 80, "%.79s", words[0]);
    return 1;
}

int simPlcPlace(simPlc *plc, char **words, size_t count, simPlace *place, simType *type,
                char error[SIM_ERROR_SIZE])
{
    char text[80];
    size_t used;

    if (count < 1)
        return simFail(error, "an address is missing, such as DB10.DBW4 or in.4");
    used = placeWords(words, count, text);
    if (simPlaceParse(&plc->memory, text, NULL, place, error))
        return -1;
    if (used < count && simTypeParse(words[used], type, error) == 0)
        used++;
    else if (simPlaceType(place, type, error))
        return -1;
    return simPlaceCheck(place, type, error) ? -1 : (int)used;
}

int simPlcSet(simPlc *plc, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    simPlace place;
    simType type;
    int used = simPlcPlace(plc, words, count, &place, &type, error);

    if (used < 0)
        return -1;
    return simValueSet(&plc->memory, &place, &type, words + used, count - (size_t)used,
                       error);
}

typedef int (*statementFn)(simPlc *plc, char **words, size_t count,
                           char error[SIM_ERROR_SIZE]);

static const struct statement {
    const char *name;
    statementFn fn;
    int pass;    /* 0 makes memory, 1 uses it */
    int atCold;  /* done again at a cold restart */
    int running; /* allowed from the console */
} statements[] = {
    {"db",     addBlock,  0, 0, 0},
    {"init",   simPlcSet, 1, 1, 0},
    {"signal", addSignal, 1, 0, 1},
    {"mirror", addMirror, 1, 0, 1},
    {"tx",     addTx,     1, 0, 0},
    {"rx",     addRx,     1, 0, 0},
    {"modbus", addModbus, 1, 0, 0},
};

static const struct statement *findStatement(const char *name)
{
    size_t i;

    for (i = 0; i < sizeof(statements) / sizeof(statements[0]); i++)
        if (!strcasecmp(name, statements[i].name))
            return &statements[i];
    return NULL;
}

int simPlcStatement(simPlc *plc, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    const struct statement *statement = count ? findStatement(words[0]) : NULL;

    if (!statement || !statement->running)
        return simFail(error, "no such statement");
    return statement->fn(plc, words + 1, count - 1, error);
}

int simPlcStatements(simPlc *plc, int pass, simText *out)
{
    char error[SIM_ERROR_SIZE];
    int errors = 0;
    size_t i;

    for (i = 0; i < plc->config->lineCount; i++) {
        const simLine *line = &plc->config->lines[i];
        const struct statement *statement = findStatement(line->words[0]);

        if (!statement && pass == 0) {
            simTextAdd(out,
                       "%s:%u: \"%.40s\" is no statement: allowed are db, init, signal, "
                       "mirror, modbus, tx, rx, and key = value\n",
                       plc->config->file, line->number, line->words[0]);
            errors++;
        } else if (statement && statement->pass == pass &&
                   statement->fn(plc, line->words + 1, line->count - 1, error)) {
            simTextAdd(out, "%s:%u: %s\n", plc->config->file, line->number, error);
            errors++;
        }
    }
    return errors;
}

void simPlcStatementsCold(simPlc *plc)
{
    char error[SIM_ERROR_SIZE];
    size_t i;

    for (i = 0; i < plc->config->lineCount; i++) {
        const simLine *line = &plc->config->lines[i];
        const struct statement *statement = findStatement(line->words[0]);

        if (statement->atCold)
            statement->fn(plc, line->words + 1, line->count - 1, error);
    }
}
