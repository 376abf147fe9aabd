/* Fuzz target: the text of an INP or OUT link of blocks, completed as each kind of record does.
 * What was understood, written as a text again, means the same. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <epicsStdio.h>

#include "fuzz.h"
#include "plcLink.h"

fuzzTarget fuzzLink;

/* clang-format off */
static const plcShape shapes[] = {
    {"ai", plcInteger | plcReal | plcBcd, 4, plcHasL | plcHasH | plcHasW, "INT16"},
    {"bo", plcInteger, 4, plcHasB | plcHasR | plcHasW, "INT16"},
    {"int64out", plcInteger | plcBcd, 8, plcHasL | plcHasH | plcHasR | plcHasW, "INT16"},
    {"stringin", plcText, 1, plcHasL, "STRING"},
    {"waveform", plcInteger | plcReal | plcText | plcBcd, 8, plcHasL | plcHasH | plcHasW, "INT16"},
};
/* clang-format on */

static void print(const plcLink *link, char *text, size_t size)
{
    static const char *const words[3][2] = {{"low", "high"}, {"DCBA", "BADC"}, {"CDAB", "ABCD"}};
    size_t n = (size_t)epicsSnprintf(text, size, "@%s/%llu", link->station,
                                     (unsigned long long)link->offset);

    if (link->has & plcHasT)
        n += (size_t)epicsSnprintf(text + n, size - n, " T=%s", link->type->name);
    if (link->has & plcHasL)
        n += (size_t)epicsSnprintf(text + n, size - n, " L=%lld", (long long)link->low);
    if (link->has & plcHasH)
        n += (size_t)epicsSnprintf(text + n, size - n, " H=%lld", (long long)link->high);
    if (link->has & plcHasB)
        n += (size_t)epicsSnprintf(text + n, size - n, " B=%u", link->bit);
    if (link->has & plcHasR)
        n += (size_t)epicsSnprintf(text + n, size - n, " R=%llu",
                                   (unsigned long long)link->readback);
    if (link->has & plcHasW && link->highWordFirst < 0)
        n += (size_t)epicsSnprintf(text + n, size - n, " W=%s", plcTextOrderName(link->textOrder));
    else if (link->has & plcHasW)
        n += (size_t)epicsSnprintf(text + n, size - n, " W=%s",
                                   words[link->wordBigEndian + 1][link->highWordFirst]);
    fuzzCheck(n < size);
}

static void checkSame(const plcLink *a, const plcLink *b)
{
    fuzzCheck(strcmp(a->station, b->station) == 0);
    fuzzCheck(a->has == b->has && a->type == b->type && a->offset == b->offset);
    fuzzCheck(a->low == b->low && a->high == b->high && a->bit == b->bit);
    fuzzCheck(a->readback == b->readback && a->highWordFirst == b->highWordFirst);
    fuzzCheck(a->wordBigEndian == b->wordBigEndian && a->textOrder == b->textOrder);
}

static void complete(const plcLink *parsed, const plcShape *shape, size_t length)
{
    plcLink link = *parsed;
    plcLinkError error;
    int order;

    if (plcLinkComplete(&link, shape, length, &error)) {
        fuzzCheck(error.text[0] && strlen(error.text) < sizeof(error.text));
        return;
    }
    fuzzCheck(link.type && link.type->kind & shape->kinds);
    fuzzCheck(!(link.has & shape->options & plcHasB) || link.bit < 8 * link.type->size);
    for (order = 0; order < 4; order++) {
        int found = plcLinkOrder(&link, order, order);
        size_t bytes = length;

        fuzzCheck(found >= 0 && found <= (link.type->kind & plcText ? plcText0A : 3));
        if (link.type->kind & plcText && plcLinkTextLength(&link, found, &bytes, &error) == 0)
            fuzzCheck(bytes && bytes <= length && bytes % plcTextUnit(found) == 0);
    }
}

int fuzzLink(const epicsUInt8 *data, size_t size)
{
    char *text = fuzzText(data, size), again[PLC_NAME_MAX + 200];
    plcLink link, back;
    plcLinkError error;
    size_t i;

    if (plcLinkParse(text, &link, &error)) {
        fuzzCheck(error.text[0] && error.column <= strlen(text));
        goto done;
    }
    fuzzCheck(strlen(link.station) <= PLC_NAME_MAX && strlen(error.text) < sizeof(error.text));
    for (i = 0; i < sizeof(shapes) / sizeof(shapes[0]); i++)
        complete(&link, &shapes[i], size % 300);
    print(&link, again, sizeof(again));
    fuzzCheck(plcLinkParse(again, &back, &error) == 0);
    checkSame(&link, &back);
done:
    free(text);
    return 0;
}
