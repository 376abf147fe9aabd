/* The requests that read ranges and write changes; see plcModbusPlan.h. */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>

#include "plcModbusPlan.h"

static const struct {
    int code;
    const char *text; /* short: all of it goes into a record's alarm message */
} exceptions[] = {
    {1,  "illegal function"    },
    {2,  "illegal data address"},
    {3,  "illegal data value"  },
    {4,  "device failure"      },
    {5,  "acknowledge"         },
    {6,  "device busy"         },
    {7,  "negative acknowledge"},
    {8,  "memory parity error" },
    {10, "no gateway path"     },
    {11, "gateway: no answer"  },
    {0,  NULL                  }
};

void plcExceptionText(int code, char *text, size_t size)
{
    int i;

    for (i = 0; exceptions[i].text && exceptions[i].code != code; i++)
        ;
    epicsSnprintf(text, size, "exception %d, %s", code,
                  exceptions[i].text ? exceptions[i].text : "not in the standard");
}

/* What the functions are, by table */
static const struct {
    epicsUInt8 read, write, writeSingle;
    unsigned readMax, writeMax; /* registers or bits in a request */
    int bits;
} tables[] = {
    [plcHolding] = {3, 16, 6, PLC_READ_REGISTERS, PLC_WRITE_REGISTERS, 0},
    [plcInputRegisters] = {4, 0,  0, PLC_READ_REGISTERS, 0,                   0},
    [plcCoils] = {1, 15, 5, PLC_READ_BITS,      PLC_WRITE_BITS,      1},
    [plcDiscrete] = {2, 0,  0, PLC_READ_BITS,      0,                   1},
};

typedef struct plan {
    const plcRange **ranges; /* of one table and period, by start */
    unsigned count;
    const epicsUInt8 *joined; /* or NULL */
    size_t imageSize;
    int bitsMaySplit; /* coils of one byte are values of their own */
    plcTable table;
    int unit;
    unsigned period;
    plcLimits limits;
    plcRequest *requests;
    unsigned made, room;
} plan;

static int byStart(const void *a, const void *b)
{
    const plcRange *first = *(const plcRange *const *)a;
    const plcRange *second = *(const plcRange *const *)b;

    if (first->start != second->start)
        return first->start < second->start ? -1 : 1;
    return first->offset < second->offset ? -1 : first->offset > second->offset;
}

/* The least of what the standard and the PLC allow. */
static unsigned mostOf(plcTable table, plcLimits limits, unsigned most)
{
    unsigned limit = tables[table].bits ? limits.bits : limits.registers;

    return limit && limit < most ? limit : most;
}

/* Chooses the ranges of this table, unit and period. */
static void choose(plan *p, const plcRange *ranges, unsigned count, plcTable table, int unit,
                   unsigned period)
{
    unsigned i;

    p->table = table;
    p->unit = unit;
    p->period = period;
    for (i = p->count = 0; i < count; i++)
        if (ranges[i].table == table && ranges[i].unit == unit && ranges[i].period == period)
            p->ranges[p->count++] = &ranges[i];
    qsort(p->ranges, p->count, sizeof(*p->ranges), byStart);
}

static plan begin(const plcRange *ranges, unsigned count, const epicsUInt8 *joined)
{
    plan p = {.joined = joined};
    unsigned i;

    p.ranges = callocMustSucceed(count + 1, sizeof(*p.ranges), "plcModbusPlan");
    for (i = 0; i < count; i++) {
        size_t end = ranges[i].offset + plcRangeBytes(&ranges[i]);

        if (end > p.imageSize)
            p.imageSize = end;
    }
    return p;
}

static void add(plan *p, epicsUInt8 function, unsigned start, unsigned count)
{
    if (p->made == p->room) {
        p->room = p->room * 2 + 16;
        p->requests = realloc(p->requests, p->room * sizeof(*p->requests));
        if (!p->requests)
            cantProceed("plcModbusPlan: no memory for %u requests\n", p->room);
    }
    p->requests[p->made++] = (plcRequest){function, p->table, start, count, p->period,
                                             p->unit};
}

static int holds(const plcRange *range, unsigned address)
{
    return address >= range->start && address - range->start < range->count;
}

/* The first and the last byte of a register, or the byte of a bit. */
static size_t firstByte(const plcRange *range, unsigned address)
{
    unsigned i = address - range->start;

    return range->offset + (tables[range->table].bits ? i / 8 : (size_t)i * 2);
}

static size_t lastByte(const plcRange *range, unsigned address)
{
    return firstByte(range, address) + (tables[range->table].bits ? 0 : 1);
}

/* True when a value begins before this address of the range and goes on in it. */
static int goesOn(const plan *p, const plcRange *range, unsigned address)
{
    size_t byte = firstByte(range, address);
    unsigned i;

    if (tables[p->table].bits && (address - range->start) % 8) /* within a byte */
        return !p->bitsMaySplit || p->joined[byte] ||
               (byte + 1 < p->imageSize && p->joined[byte + 1]);
    if (!p->joined[byte] || byte == 0)
        return 0;
    /* The byte before it may belong to another range, and to another address. */
    for (i = 0; i < p->count; i++)
        if (holds(p->ranges[i], address - 1) &&
            lastByte(p->ranges[i], address - 1) == byte - 1)
            return 1;
    return 0;
}

/* True when a value is cut by a request that begins at `address`. */
static int cuts(const plan *p, unsigned address)
{
    unsigned i;

    if (!p->joined)
        return 0;
    for (i = 0; i < p->count; i++)
        if (holds(p->ranges[i], address) && goesOn(p, p->ranges[i], address))
            return 1;
    return 0;
}

/* Where the request that begins at `start` ends; the run goes on to `end`. As far as it
 * may be, but not within a value; unless that needs more than one request anyway. */
static unsigned cutPlace(const plan *p, unsigned runStart, unsigned start, unsigned end,
                         unsigned max)
{
    unsigned place = start + max, first = place, behind = place + 1;

    if (!cuts(p, place))
        return place;
    while (first > runStart && place - first <= max && cuts(p, first))
        first--;
    while (behind < end && behind - first <= max && cuts(p, behind))
        behind++;
    return behind - first > max ? place : first; /* a value that fits begins behind `start` */
}

/* Requests for all of start to end - 1. */
static void cover(plan *p, epicsUInt8 function, unsigned start, unsigned end,
                  unsigned max)
{
    unsigned runStart = start;

    while (start < end) {
        unsigned next = end - start > max ? cutPlace(p, runStart, start, end, max) : end;

        add(p, function, start, next - start);
        start = next;
    }
}

static void planTable(plan *p)
{
    unsigned i = 0;

    while (i < p->count) {
        unsigned start = p->ranges[i]->start, end = start;

        for (; i < p->count && p->ranges[i]->start <= end; i++)
            if (p->ranges[i]->start + p->ranges[i]->count > end)
                end = p->ranges[i]->start + p->ranges[i]->count;
        cover(p, tables[p->table].read, start, end,
              mostOf(p->table, p->limits, tables[p->table].readMax));
    }
}

unsigned plcPlanReads(const plcRange *ranges, unsigned count, const epicsUInt8 *joined,
                      plcLimits limits, plcRequest **requests)
{
    plan p = begin(ranges, count, joined);
    unsigned i, j;

    p.limits = limits;
    for (i = 0; i < count; i++) {
        for (j = 0; j < i; j++)
            if (ranges[j].table == ranges[i].table && ranges[j].unit == ranges[i].unit &&
                ranges[j].period == ranges[i].period)
                break;
        if (j < i)
            continue;
        choose(&p, ranges, count, ranges[i].table, ranges[i].unit, ranges[i].period);
        planTable(&p);
    }
    free(p.ranges);
    *requests = p.requests;
    return p.made;
}

/* A run of registers or coils to be written */
typedef struct run {
    unsigned start, end;
} run;

static void writeRun(plan *p, run *r, int single)
{
    unsigned i = p->made;

    cover(p, tables[p->table].write, r->start, r->end,
          mostOf(p->table, p->limits, tables[p->table].writeMax));
    for (; single && i < p->made; i++)
        if (p->requests[i].count == 1)
            p->requests[i].function = tables[p->table].writeSingle;
    r->start = r->end = 0;
}

/* How much of the i-th register or coil of the range is to be written: 0 nothing, 1 some
 * bits of it, 2 all. */
static int written(const plcRange *range, const epicsUInt8 *mask, unsigned i)
{
    if (range->table == plcCoils)
        return mask[range->offset + i / 8] >> i % 8 & 1 ? 2 : 0;
    mask += range->offset + (size_t)i * 2;
    return mask[0] == 0xff && mask[1] == 0xff ? 2 : mask[0] || mask[1];
}

static void writeRange(plan *p, const plcRange *range, const epicsUInt8 *mask, int single,
                       run *r)
{
    unsigned i;

    for (i = 0; i < range->count; i++) {
        unsigned address = range->start + i;
        int how = written(range, mask, i);

        if (how == 2 && r->end > r->start && r->end == address) {
            r->end++;
            continue;
        }
        if (how && r->end > r->start)
            writeRun(p, r, single);
        if (how == 2)
            *r = (run){address, address + 1};
        else if (how)
            add(p, 22, address, 1);
    }
}

unsigned plcPlanWrites(const plcRange *ranges, unsigned count, const epicsUInt8 *mask,
                       const epicsUInt8 *joined, plcLimits limits, int single,
                       plcRequest **requests)
{
    plan p = begin(ranges, count, joined);
    unsigned i, j;

    p.limits = limits;
    for (i = 0; i < count; i++) {
        run r = {0, 0};

        for (j = 0; j < i && (ranges[j].table != ranges[i].table ||
                              ranges[j].unit != ranges[i].unit);
             j++)
            ;
        if (j < i || !tables[ranges[i].table].write)
            continue;
        choose(&p, ranges, count, ranges[i].table, ranges[i].unit, 0);
        for (j = 0; j < p.count; j++)
            writeRange(&p, p.ranges[j], mask, single, &r);
        if (r.end > r.start)
            writeRun(&p, &r, single);
    }
    free(p.ranges);
    *requests = p.requests;
    return p.made;
}

/* The range in which the bytes of a put lie, all of them; or NULL. */
static const plcRange *rangeOf(const plcJoin *j, const plcPut *put)
{
    unsigned i;

    for (i = 0; i < j->count; i++)
        if (put->offset >= j->ranges[i].offset &&
            put->offset + put->length <= j->ranges[i].offset + plcRangeBytes(&j->ranges[i]))
            return &j->ranges[i];
    return NULL;
}

/* The bits that a put sets, counted from the start of the range: *first to *end - 1, and
 * whether there is a gap between. Returns 0 when there is none. */
static int bitsOf(const plcPut *put, size_t offset, unsigned *first, unsigned *end, int *gap)
{
    unsigned i, count = 8 * (unsigned)put->length, base = 8 * (unsigned)(put->offset - offset);
    unsigned set = 0;

    for (i = 0; i < count; i++) {
        if (put->mask && !(put->mask[i / 8] >> i % 8 & 1))
            continue;
        if (!set)
            *first = base + i;
        *end = base + i + 1;
        set++;
    }
    *gap = set != *end - *first;
    return set != 0;
}

/* What a put asks for: its table, which registers or coils, whether these as a whole. Returns
 * 0 when it joins nobody. */
static int askedFor(const plcJoin *j, const plcPut *put, plcJoin *what, unsigned *start)
{
    const plcRange *r = rangeOf(j, put);
    unsigned first = 0, end = 0;
    int gap, coils = r && r->table == plcCoils;

    if (!r || !bitsOf(put, r->offset, &first, &end, &gap) ||
        (gap && (coils || first / 16 != (end - 1) / 16)))
        return 0;
    what->table = r->table;
    what->unit = r->unit;
    what->whole = coils || (!gap && first % 16 == 0 && end % 16 == 0);
    *start = r->start + (coils ? first : first / 16);
    what->end = r->start + (coils ? end : (end + 15) / 16);
    what->most = mostOf(r->table, j->limits, tables[r->table].writeMax);
    return 1;
}

int plcPlanJoins(void *join, const plcPut *put)
{
    plcJoin *j = join, what = *j;
    unsigned start, length;
    int joins;

    if (!askedFor(j, put, &what, &start)) {
        j->most = 0;
        return 0;
    }
    length = what.end - start;
    joins = j->most && what.table == j->table && what.unit == j->unit &&
            what.whole == j->whole &&
            (what.whole ? start == j->end && length <= j->most
                        : length == 1 && what.end == j->end);
    if (!joins)
        j->most = what.most; /* of a first one; nobody asks any more else */
    j->most = j->most > length ? j->most - length : 0;
    j->table = what.table;
    j->unit = what.unit;
    j->whole = what.whole;
    j->end = what.end;
    return joins;
}

int plcPlanHalve(const plcRange *ranges, unsigned count, const epicsUInt8 *joined,
                 const plcRequest *request, plcRequest halves[2])
{
    plan p = begin(ranges, count, joined);
    unsigned start = request->start, end = start + request->count;
    unsigned middle = start + request->count / 2, place = middle;

    choose(&p, ranges, count, request->table, request->unit, request->period);
    p.bitsMaySplit = 1;
    while (place > start && cuts(&p, place))
        place--;
    if (place == start)
        for (place = middle + 1; place < end && cuts(&p, place); place++)
            ;
    free(p.ranges);
    if (place >= end)
        return 0;
    halves[0] = halves[1] = *request;
    halves[0].count = place - start;
    halves[1].start = place;
    halves[1].count = end - place;
    return 1;
}

/* A number begins before this address and goes on in it. */
static int tears(const plan *p, unsigned address)
{
    unsigned i;

    for (i = 0; i < p->count; i++)
        if (holds(p->ranges[i], address) && p->joined[firstByte(p->ranges[i], address)] == 1 &&
            goesOn(p, p->ranges[i], address))
            return 1;
    return 0;
}

void plcPlanTorn(const plcRange *ranges, unsigned count, const epicsUInt8 *joined,
                 const plcRequest *q, unsigned *head, unsigned *tail)
{
    plan p;

    *head = *tail = 0;
    if (!joined)
        return;
    p = begin(ranges, count, joined);
    choose(&p, ranges, count, q->table, q->unit, q->period);
    p.bitsMaySplit = 1;
    while (*head < q->count && tears(&p, q->start + *head))
        ++*head;
    if (*head < q->count && tears(&p, q->start + q->count))
        do
            ++*tail;
        while (*head + *tail < q->count && tears(&p, q->start + q->count - *tail));
    free(p.ranges);
}

unsigned plcPlanPieces(const plcRange *ranges, unsigned count, const plcRequest *request,
                       plcPiece *pieces, unsigned max)
{
    unsigned i, made = 0, requestEnd = request->start + request->count;

    for (i = 0; i < count && made < max; i++) {
        const plcRange *range = &ranges[i];
        unsigned rangeEnd = range->start + range->count;
        unsigned first = request->start > range->start ? request->start : range->start;
        unsigned end = requestEnd < rangeEnd ? requestEnd : rangeEnd;

        if (range->table != request->table || range->unit != request->unit ||
            range->period != request->period ||
            first >= end)
            continue;
        pieces[made].offset = firstByte(range, first);
        pieces[made].first = first - request->start;
        pieces[made].count = end - first;
        pieces[made].bit = tables[range->table].bits ? (first - range->start) % 8 : 0;
        made++;
    }
    return made;
}
