/* Tab completion of PLC names; see plcComplete.h.
 *
 * Base completes record names through a function of its database (since 7.0.8). We stand
 * before it: on the line of a command of ours, PLC names are meant. Which line that is, only
 * readline knows; without readline there is no completion at all.
 */
#define EPICS_PRIVATE_API /* iocshCompleteRecord */
#include <stdlib.h>
#include <string.h>

#include <epicsString.h>

#include "plcComplete.h"
#include "plcStation.h"

#if EPICS_VERSION_INT >= VERSION_INT(7, 0, 8, 0) && defined(__GNUC__) && defined(__linux__)

extern char *rl_line_buffer __attribute__((weak));

static char **(*previous)(const char *word);

typedef struct matches {
    const char *word;
    char **list; /* [0] what all have in common, [1]... the names, NULL */
    size_t count;
} matches;

static void addMatch(plcStation *station, void *arg)
{
    const char *name = plcStationName(station);
    matches *m = arg;
    char **list;
    size_t same = 0;

    if (strncmp(name, m->word, strlen(m->word)))
        return;
    list = realloc(m->list, (m->count + 3) * sizeof(*list));
    if (!list)
        return;
    if (m->count == 0)
        list[0] = epicsStrDup(name);
    while (list[0][same] && list[0][same] == name[same])
        same++;
    list[0][same] = 0;
    list[++m->count] = epicsStrDup(name);
    list[m->count + 1] = NULL;
    m->list = list;
}

/* readline frees what is returned. */
static char **complete(const char *word)
{
    const char *line = &rl_line_buffer && rl_line_buffer ? rl_line_buffer : "";
    matches m = {word, NULL, 0};

    line += strspn(line, " \t");
    if (strncmp(line, "s7plc", 5) && strncmp(line, "phoenixplc", 10) &&
        strncmp(line, "drvEtherIP_", 11))
        return previous ? previous(word) : NULL;
    plcStationEach(addMatch, &m);
    return m.list;
}

void plcCompleteInstall(void)
{
    if (iocshCompleteRecord == complete)
        return;
    previous = iocshCompleteRecord;
    iocshCompleteRecord = complete;
}

#else

void plcCompleteInstall(void)
{
}

#endif
