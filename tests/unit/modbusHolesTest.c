/* What a Modbus PLC refuses to show, as the log names it. */
#include <stdlib.h>
#include <string.h>

#include <epicsStdio.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcModbusHoles.h"

/* "h10-12=2 h20-20=2": table, first, last, code; "/n" behind it: the unit. */
static const char *textOf(const plcHoles *h, char *text, size_t size)
{
    size_t used = 0;
    unsigned i;

    text[0] = 0;
    for (i = 0; i < h->count; i++) {
        const plcHole *o = &h->hole[i];

        used += (size_t)epicsSnprintf(text + used, size - used, "%s%c%u-%u=%d", i ? " " : "",
                                      "hicd"[o->table], o->start, o->start + o->count - 1, o->code);
        if (o->unit)
            used += (size_t)epicsSnprintf(text + used, size - used, "/%d", o->unit);
    }
    return text;
}

static plcHole holeOf(const char *text)
{
    plcHole h = {plcHolding, 0, 0, 0, 0};
    unsigned first, last;
    char table;

    if (sscanf(text, "%c%u-%u=%d/%d", &table, &first, &last, &h.code, &h.unit) < 4)
        abort();
    h.table = (plcTable)(strchr("hicd", table) - "hicd");
    h.start = first;
    h.count = last - first + 1;
    return h;
}

static plcHoles holesOf(const char *text)
{
    plcHoles h = {NULL, 0, 0};

    for (; *text; text += strcspn(text, " "), text += *text == ' ')
        plcHolesAdd(&h, holeOf(text));
    return h;
}

static const struct {
    const char *what, *added, *found;
} adds[] = {
    {"one",                          "h10-12=2",                      "h10-12=2"               },
    {"the same again",               "h10-12=2 h10-12=2",             "h10-12=2"               },
    {"one within it",                "h10-12=2 h11-12=2",             "h10-12=2"               },
    {"one around it",                "h11-12=2 h10-13=2",             "h10-13=2"               },
    {"neighbours",                   "h10-12=2 h13-14=2",             "h10-14=2"               },
    {"neighbours, the other order",  "h13-14=2 h10-12=2",             "h10-14=2"               },
    {"one that joins two",           "h10-10=2 h12-12=2 h11-11=2",    "h10-12=2"               },
    {"not with one between",         "h12-12=2 h10-10=2",             "h10-10=2 h12-12=2"      },
    {"other codes stay apart",       "h10-12=2 h11-11=4",             "h10-12=2 h11-11=4"      },
    {"other units stay apart",       "h10-12=2 h11-12=2/3",           "h10-12=2 h11-12=2/3"    },
    {"other tables stay apart",      "c10-12=2 h13-13=2 i1-1=2",      "h13-13=2 i1-1=2 c10-12=2"},
    {"the last register",            "h65535-65535=2 h65534-65534=2", "h65534-65535=2"         },
};

/* Of a hole: what is not known of it, and what is. */
static const struct {
    const char *what, *hole, *known, *rest, *within;
    int anyCode;
} rests[] = {
    {"nothing known",       "h10-12=2",   "",                          "h10-12=2",          "",           0},
    {"all known",           "h10-12=2",   "h5-20=2",                   "",                  "h10-12=2",   0},
    {"its begin",           "h10-12=2",   "h5-10=2",                   "h11-12=2",          "h10-10=2",   0},
    {"its end",             "h10-12=2",   "h12-20=2",                  "h10-11=2",          "h12-12=2",   0},
    {"its middle",          "h10-12=2",   "h11-11=2",                  "h10-10=2 h12-12=2", "h11-11=2",   0},
    {"two of it",           "h10-20=2",   "h11-12=2 h15-30=2",         "h10-10=2 h13-14=2", "h11-12=2 h15-20=2", 0},
    {"for another reason",  "h10-12=2",   "h5-20=4",                   "h10-12=2",          "h10-12=4",   0},
    {"whatever the reason", "h10-12=2",   "h11-11=4",                  "h10-10=2 h12-12=2", "h11-11=4",   1},
    {"two reasons overlap", "h10-14=2",   "h11-12=4 h12-13=6",         "h10-10=2 h14-14=2", "h11-12=4 h12-13=6", 1},
    {"another unit",        "h10-12=2",   "h10-12=2/3",                "h10-12=2",          "",           1},
    {"another table",       "c10-12=2",   "h10-12=2",                  "c10-12=2",          "",           1},
    {"a neighbour",         "h10-12=2",   "h13-14=2",                  "h10-12=2",          "",           0},
};

MAIN(modbusHolesTest)
{
    char text[300], within[300];
    unsigned i;

    testPlan((int)(sizeof(adds) / sizeof(adds[0]) + sizeof(rests) / sizeof(rests[0])) + 1);
    for (i = 0; i < sizeof(adds) / sizeof(adds[0]); i++) {
        plcHoles h = holesOf(adds[i].added);

        testOk(strcmp(textOf(&h, text, sizeof(text)), adds[i].found) == 0, "added: %s: %s",
               adds[i].what, text);
        plcHolesFree(&h);
    }
    for (i = 0; i < sizeof(rests) / sizeof(rests[0]); i++) {
        plcHoles known = holesOf(rests[i].known), rest = {NULL, 0, 0}, in = {NULL, 0, 0};

        plcHolesRest(&rest, holeOf(rests[i].hole), &known, rests[i].anyCode);
        plcHolesWithin(&in, holeOf(rests[i].hole), &known);
        testOk(strcmp(textOf(&rest, text, sizeof(text)), rests[i].rest) == 0 &&
                   strcmp(textOf(&in, within, sizeof(within)), rests[i].within) == 0,
               "known: %s: not \"%s\", but \"%s\"", rests[i].what, text, within);
        plcHolesFree(&known);
        plcHolesFree(&rest);
        plcHolesFree(&in);
    }
    {
        plcHoles many = {NULL, 0, 0};

        for (i = 0; i < 200; i++)
            plcHolesAdd(&many, (plcHole){plcCoils, 0, (i * 77 % 200) * 2, 1, 2});
        for (i = 1; i < many.count && many.hole[i].start > many.hole[i - 1].start; i++)
            ;
        testOk(many.count == 200 && i == 200, "200 in the order of their addresses");
        plcHolesFree(&many);
    }
    return testDone();
}
