/* Fuzz target: options, a line "key value" each. What is refused changes nothing, and what the
 * summary says sets the same again. */
#include <stdlib.h>
#include <string.h>

#include "fuzz.h"
#ifdef FUZZ_MODBUS
#include "plcModbusOptions.h"
#endif
#include "plcOptions.h"

fuzzTarget fuzzOptions;

/* Fields, because structures may have holes. */
static int same(const plcOptions *a, const plcOptions *b)
{
    char x[4000], y[4000];

    plcOptionsSummary(a, x, sizeof(x));
    plcOptionsSummary(b, y, sizeof(y));
    return strcmp(x, y) == 0 && memcmp(a, b, sizeof(*a)) == 0;
}

static void setLine(plcOptions *options, char *line, int running)
{
    plcOptions before;
    char error[200], *value = strchr(line, ' ');

    memcpy(&before, options, sizeof(before)); /* holes too */
    if (value)
        *value++ = 0;
    if (plcOptionsSet(options, line, value ? value : "", running, error, sizeof(error)) == 0)
        return;
    fuzzCheck(error[0] && strlen(error) < sizeof(error));
    fuzzCheck(same(&before, options));
}

/* The summary, "key=value key=value", set one by one. */
static void setSummary(plcOptions *options, char *summary)
{
    char error[200], *word = summary, *next, *value;

    for (; word && *word; word = next) {
        next = strchr(word, ' ');
        if (next)
            *next++ = 0;
        value = strchr(word, '=');
        fuzzCheck(value);
        *value++ = 0;
        fuzzCheck(plcOptionsSet(options, word, value, 0, error, sizeof(error)) == 0);
    }
}

/* Those of a transport too, once. */
static void addTables(void)
{
#ifdef FUZZ_MODBUS
    static int added;

    if (!added++)
        plcOptionsAdd(&plcModbusOptionTable);
#endif
}

int fuzzOptions(const epicsUInt8 *data, size_t size)
{
    int running = size && data[0] == '!';
    char *text = fuzzText(data, size), *rest = text + running, *line;
    char summary[4000], again[4000];
    plcOptions options, back;

    addTables();
    plcOptionsDefault(&options);
    plcOptionsDefault(&back);
    while ((line = fuzzLine(&rest)))
        setLine(&options, line, running);
    plcOptionsSummary(&options, summary, sizeof(summary));
    fuzzCheck(strlen(summary) + 1 < sizeof(summary));
    memcpy(again, summary, sizeof(again));
    setSummary(&back, again);
    plcOptionsSummary(&back, again, sizeof(again));
    fuzzCheck(strcmp(summary, again) == 0);
    free(text);
    return 0;
}
