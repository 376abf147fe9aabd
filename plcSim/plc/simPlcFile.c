/* simPlcFile: the statements of the file: they make the memory, signals and transfers of
 * a PLC; those of its servers are theirs. It does not know when they are used.
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
#include "simTransfers.h"
#include "simValue.h"

static void *grow(void *list, size_t count, size_t size)
{
    list = realloc(list, (count + 1) * size);
    if (!list)
        cantProceed("simPlc: out of memory");
    return list;
}

void simPlcAddSignal(simPlc *plc, const simSignal *signal)
{
    plc->signals = grow(plc->signals, plc->signalCount, sizeof(simSignal));
    plc->signals[plc->signalCount++] = *signal;
}

void simPlcDropSignals(simPlc *plc, const simBlock *block, size_t offset)
{
    size_t i, kept = 0;

    for (i = 0; i < plc->signalCount; i++) {
        const simPlace *place = &plc->signals[i].place;

        if (place->block == block && place->offset == offset)
            simSignalFree(&plc->signals[i]);
        else
            plc->signals[kept++] = plc->signals[i];
    }
    plc->signalCount = kept;
}

int simPlcSignal(simPlc *plc, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    simSignal signal;

    if (!plc->tx && words[0] && words[0][0] >= '0' && words[0][0] <= '9')
        return simFail(error, "a signal at %.40s needs a block to the IOC, but in = 0",
                       words[0]);
    if (simSignalParse(&plc->memory, plc->tx, words, count, &signal, error))
        return -1;
    simPlcAddSignal(plc, &signal);
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

static int addTx(simPlc *plc, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    return simTransfersAdd(&plc->program, 1, words, count, error);
}

static int addRx(simPlc *plc, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    return simTransfersAdd(&plc->program, 0, words, count, error);
}

/* allow read|write <block> [<first byte> <bytes>] */
static int addAllow(simPlc *plc, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    if (!plc->config->map)
        return simFail(error, "allow is for map = on");
    return simTablesAllow(&plc->program.tables, words, count, error);
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
    int makesMemory; /* done before those that use it */
    int atCold;      /* done again at a cold restart */
} statements[] = {
    {"db",     addBlock,     1, 0},
    {"init",   simPlcSet,    0, 1},
    {"signal", simPlcSignal, 0, 0},
    {"tx",     addTx,        0, 0},
    {"rx",     addRx,        0, 0},
    {"allow",  addAllow,     0, 0},
};

static const struct statement *findStatement(const char *name)
{
    size_t i;

    for (i = 0; i < sizeof(statements) / sizeof(statements[0]); i++)
        if (!strcasecmp(name, statements[i].name))
            return &statements[i];
    return NULL;
}

/* One of a server's own. */
static const simServerStatement *findServers(simPlc *plc, const char *name, void **state)
{
    size_t i, k;

    for (i = 0; i < plc->serverCount; i++) {
        const simServerType *type = plc->servers[i].type;

        *state = plc->servers[i].state;
        for (k = 0; k < type->statementCount; k++)
            if (!strcasecmp(name, type->statements[k].name))
                return &type->statements[k];
    }
    return NULL;
}

static void unknown(simPlc *plc, const simLine *line, simText *out)
{
    size_t i, k;

    simTextAdd(out, "%s:%u: \"%.40s\" is no statement: allowed are ", plc->config->file,
               line->number, line->words[0]);
    for (i = 0; i < sizeof(statements) / sizeof(statements[0]); i++)
        simTextAdd(out, "%s, ", statements[i].name);
    for (i = 0; i < plc->serverCount; i++)
        for (k = 0; k < plc->servers[i].type->statementCount; k++)
            simTextAdd(out, "%s, ", plc->servers[i].type->statements[k].name);
    simTextAdd(out, "and key = value\n");
}

/* Returns the number of errors. */
static int statementOfPass(simPlc *plc, const simLine *line, int pass, simText *out)
{
    const struct statement *own = findStatement(line->words[0]);
    const simServerStatement *servers = NULL;
    char error[SIM_ERROR_SIZE];
    void *state;
    int status = 0;

    if (!own)
        servers = findServers(plc, line->words[0], &state);
    if (own && own->makesMemory == !pass)
        status = own->fn(plc, line->words + 1, line->count - 1, error);
    else if (servers && servers->makesMemory == !pass)
        status = servers->fn(state, line->words + 1, line->count - 1, error);
    if (status)
        simTextAdd(out, "%s:%u: %s\n", plc->config->file, line->number, error);
    if (own || servers || pass)
        return status != 0;
    unknown(plc, line, out);
    return 1;
}

int simPlcStatements(simPlc *plc, int pass, simText *out)
{
    int errors = 0;
    size_t i;

    for (i = 0; i < plc->config->lineCount; i++)
        errors += statementOfPass(plc, &plc->config->lines[i], pass, out);
    return errors;
}

void simPlcStatementsCold(simPlc *plc)
{
    char error[SIM_ERROR_SIZE];
    size_t i;

    for (i = 0; i < plc->config->lineCount; i++) {
        const simLine *line = &plc->config->lines[i];
        const struct statement *statement = findStatement(line->words[0]);

        if (statement && statement->atCold)
            statement->fn(plc, line->words + 1, line->count - 1, error);
    }
}
