/* What a Modbus PLC refuses to show; see plcModbusHoles.h. */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>

#include "plcModbusHoles.h"

void plcHolesFree(plcHoles *h)
{
    free(h->hole);
    memset(h, 0, sizeof(*h));
}

static int samePlace(const plcHole *a, const plcHole *b)
{
    return a->table == b->table && a->unit == b->unit;
}

static unsigned endOf(const plcHole *h)
{
    return h->start + h->count;
}

static int comesBefore(const plcHole *a, const plcHole *b)
{
    return a->table != b->table ? a->table < b->table : a->start < b->start;
}

/* Takes out all that become one with the hole, and makes it as large. */
static void swallow(plcHoles *h, plcHole *hole)
{
    unsigned i, left = 0, end = endOf(hole);

    for (i = 0; i < h->count; i++) {
        plcHole *o = &h->hole[i];

        if (!samePlace(o, hole) || o->code != hole->code || o->start > end ||
            endOf(o) < hole->start) {
            h->hole[left++] = *o;
            continue;
        }
        end = endOf(o) > end ? endOf(o) : end;
        hole->start = o->start < hole->start ? o->start : hole->start;
    }
    hole->count = end - hole->start;
    h->count = left;
}

void plcHolesAdd(plcHoles *h, plcHole hole)
{
    unsigned at;

    swallow(h, &hole);
    if (h->count == h->room) {
        h->room = h->room * 2 + 16;
        h->hole = realloc(h->hole, h->room * sizeof(*h->hole));
        if (!h->hole)
            cantProceed("plcHolesAdd: no memory for %u holes\n", h->room);
    }
    for (at = h->count++; at > 0 && comesBefore(&hole, &h->hole[at - 1]); at--)
        h->hole[at] = h->hole[at - 1];
    h->hole[at] = hole;
}

/* What two holes have in common; count 0: nothing. */
static plcHole common(const plcHole *a, const plcHole *b)
{
    unsigned start = a->start > b->start ? a->start : b->start;
    unsigned end = endOf(a) < endOf(b) ? endOf(a) : endOf(b);
    plcHole both = *a;

    both.start = start;
    both.count = samePlace(a, b) && start < end ? end - start : 0;
    return both;
}

void plcHolesRest(plcHoles *to, plcHole hole, const plcHoles *known, int anyCode)
{
    unsigned i;

    for (i = 0; i < known->count && hole.count; i++) {
        plcHole both = common(&hole, &known->hole[i]), before = hole;

        if (!both.count || !(anyCode || known->hole[i].code == hole.code))
            continue;
        before.count = both.start - hole.start;
        if (before.count)
            plcHolesRest(to, before, known, anyCode);
        hole.count = endOf(&hole) - endOf(&both);
        hole.start = endOf(&both);
    }
    if (hole.count)
        plcHolesAdd(to, hole);
}

void plcHolesWithin(plcHoles *to, plcHole hole, const plcHoles *known)
{
    unsigned i;

    for (i = 0; i < known->count; i++) {
        plcHole both = common(&known->hole[i], &hole);

        if (both.count)
            plcHolesAdd(to, both);
    }
}
