/* The text of a link of DTYP "EtherIP" taken apart; see eipLink.h. */
#include <stdarg.h>

#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <epicsString.h>

#include "eipLink.h"

static const struct {
    const char *word;
    eipStatistic statistic;
} statistics[] = {
    {"PLC_ERRORS",         eipPlcErrors      },
    {"PLC_TASK_SLOW",      eipPlcTaskSlow    },
    {"LIST_ERRORS",        eipListErrors     },
    {"LIST_TICKS",         eipListTicks      },
    {"LIST_TIME",          eipListTime       },
    {"LIST_SCAN_TIME",     eipListScanTime   },
    {"LIST_MIN_SCAN_TIME", eipListMinScanTime},
    {"LIST_MAX_SCAN_TIME", eipListMaxScanTime},
    {"TAG_TRANSFER_TIME",  eipTagTransferTime},
};

const char *eipStatisticWord(eipStatistic statistic)
{
    size_t i;

    for (i = 0; i < sizeof(statistics) / sizeof(statistics[0]); i++)
        if (statistics[i].statistic == statistic)
            return statistics[i].word;
    return "";
}

static const char blanks[] = " \t";

/* Where a word is in a text. */
typedef struct word {
    const char *at;
    size_t length;
} word;

static word nextWord(const char **at)
{
    word w;

    *at += strspn(*at, blanks);
    w.at = *at;
    w.length = strcspn(*at, blanks);
    *at += w.length;
    return w;
}

static int is(const word *w, const char *text)
{
    return w->length == strlen(text) && strncmp(w->at, text, w->length) == 0;
}

/* What a message of eipLinkParse needs. */
typedef struct place {
    const char *text;
    size_t *column;
    char *error;
    size_t size;
} place;

static int fail(const place *p, const char *at, const char *format, ...)
{
    va_list args;

    *p->column = (size_t)(at - p->text);
    va_start(args, format);
    epicsVsnprintf(p->error, p->size, format, args);
    va_end(args);
    return -1;
}

/* The number behind S or B. Returns 0 or -1. */
static int number(const place *p, const char **at, char letter, double low, double high,
                  double *value)
{
    word w = nextWord(at);
    char text[40];

    epicsSnprintf(text, sizeof(text), "%.*s", (int)w.length, w.at);
    if (w.length < sizeof(text) && epicsParseDouble(text, value, NULL) == 0 &&
        *value >= low && *value <= high)
        return 0;
    if (!w.length)
        return fail(p, w.at, "%c has no number; allowed: %c, a blank, %g to %g", letter, letter, low,
                    high);
    return fail(p, w.at, letter == 'S' ? "S %.20s is no period; allowed: S, a blank, %g to %g"
                                       : "B %.20s is no bit; allowed: B, a blank, %g to %g",
                text, low, high);
}

/* ether_ip takes a flag twice, and the last one counts. */
static void twice(eipLink *link, int before, const word *w)
{
    if (before && !link->doubt[0])
        epicsSnprintf(link->doubt, sizeof(link->doubt), "%.*s stands there twice; the last one counts",
                      (int)(w->length < 20 ? w->length : 20), w->at);
}

static int flag(const place *p, const word *w, const char **at, eipLink *link)
{
    double value;
    size_t i;

    for (i = 0; i < sizeof(statistics) / sizeof(statistics[0]); i++)
        if (is(w, statistics[i].word)) {
            twice(link, link->statistic != eipNoStatistic, w);
            link->statistic = statistics[i].statistic;
            return 0;
        }
    if (is(w, "S")) { /* 0: none is said */
        twice(link, link->period > 0, w);
        if (number(p, at, 'S', 0, 86400, &link->period))
            return -1;
        if (link->period > 0 && link->period < 0.001)
            link->period = 0.001;
        return 0;
    }
    if (is(w, "B")) {
        const char *begin = *at;

        twice(link, link->bit >= 0, w);
        if (number(p, at, 'B', 0, 63, &value))
            return -1;
        link->bit = (int)value;
        if (link->bit != value)
            return fail(p, begin, "B %g is no bit; allowed: B, a blank, 0 to 63", value);
        return 0;
    }
    if (is(w, "FORCE")) {
        twice(link, link->force, w);
        link->force = 1;
    } else if (w->at[0] == 'E') {
        twice(link, link->alone, w);
        link->alone = 1;
    } else {
        return fail(p, w->at,
                    "\"%.*s\" is no flag; allowed: E, S seconds, B bit, FORCE, or one of "
                    "PLC_ERRORS PLC_TASK_SLOW LIST_ERRORS LIST_TICKS LIST_TIME "
                    "LIST_SCAN_TIME LIST_MIN_SCAN_TIME LIST_MAX_SCAN_TIME TAG_TRANSFER_TIME",
                    (int)(w->length < 40 ? w->length : 40), w->at);
    }
    return 0;
}

/* All indices but the last one become part of the base: a[1,2] is element 2 of a[1]. */
static int tag(const place *p, const word *w, eipLink *link)
{
    char text[eipNameMax + 1];
    size_t column = 0;
    eipName name;
    unsigned i;

    if (w->length > eipNameMax)
        return fail(p, w->at, "the tag has more than %d characters", eipNameMax);
    epicsSnprintf(text, sizeof(text), "%.*s", (int)w->length, w->at);
    if (eipNameParse(text, !link->alone, &name, &column, p->error, p->size)) {
        *p->column = (size_t)(w->at - p->text) + column;
        return -1;
    }
    if (name.bit >= 0 && link->bit >= 0)
        return fail(p, w->at, "a bit in the tag (.%d) and B %d; allowed: one of them",
                    name.bit, link->bit);
    if (name.bit >= 0)
        link->bit = name.bit;
    epicsSnprintf(link->tag, sizeof(link->tag), "%s", name.base);
    link->hasIndex = name.dimensions > 0;
    if (link->hasIndex)
        link->index = name.index[name.dimensions - 1];
    link->indexed = name.dimensions > 1;
    for (i = 0; i + 1 < name.dimensions; i++) {
        size_t n = strlen(link->tag);

        epicsSnprintf(link->tag + n, sizeof(link->tag) - n, "%s%u%s", i ? "," : "[",
                      name.index[i], i + 2 == name.dimensions ? "]" : "");
    }
    if (strlen(link->tag) > eipNameMax || !eipPathBytes(link->tag, 0))
        return fail(p, w->at, "the tag has no path of at most %d bytes", eipPathMax);
    return 0;
}

int eipLinkParse(const char *text, eipLink *link, size_t *column, char *error, size_t size)
{
    place p = {text, column, error, size};
    const char *at = text + (*text == '@');
    word plc = nextWord(&at), name = nextWord(&at), w;

    memset(link, 0, sizeof(*link));
    link->bit = -1;
    error[0] = 0;
    *column = 0;
    if (!plc.length)
        return fail(&p, text, "no link to a PLC; allowed: @PLC tag [flags]");
    if (plc.length > eipPlcNameMax)
        return fail(&p, text, "the PLC's name is too long; allowed: %d characters", eipPlcNameMax);
    if (!name.length)
        return fail(&p, plc.at + plc.length, "no tag; allowed: @PLC tag [flags]");
    epicsSnprintf(link->plc, sizeof(link->plc), "%.*s", (int)plc.length, plc.at);
    for (w = nextWord(&at); w.length; w = nextWord(&at))
        if (flag(&p, &w, &at, link))
            return -1;
    return tag(&p, &name, link);
}
