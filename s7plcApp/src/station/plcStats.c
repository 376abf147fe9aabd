/* Arithmetic of the statistics; see plcStats.h. */
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "plcHot.h"
#include "plcStats.h"

#define FIRST_BIN_MS 0.01
#define BINS_PER_OCTAVE 3

/* The logarithm by hand: it comes with every block, and a page of the C library that
 * nothing else needs then costs more than these few steps. */
PLC_HOT int plcStatsBin(double ms)
{
    static const double third = 1.2599210498948732, twoThirds = 1.5874010519681994;
    double part = ms / FIRST_BIN_MS;
    int bin = 0;

    if (!(part > 1))
        return 0;
    while (part >= 2 && bin < PLC_BINS) {
        part /= 2;
        bin += BINS_PER_OCTAVE;
    }
    bin += (part >= third) + (part >= twoThirds);
    return bin < PLC_BINS - 1 ? bin : PLC_BINS - 1;
}

double plcStatsBinStart(int bin)
{
    return FIRST_BIN_MS * exp2((double)bin / BINS_PER_OCTAVE);
}

void plcStatsReset(plcStats *s)
{
    size_t start = offsetof(plcStats, blocksIn);

    memset((char *)s + start, 0, sizeof(*s) - start);
}

PLC_HOT void plcStatsPeriod(plcStats *s, double ms)
{
    double before = ms - s->periodMean;

    s->periodLast = ms;
    if (s->periods == 0 || ms < s->periodMin)
        s->periodMin = ms;
    if (ms > s->periodMax)
        s->periodMax = ms;
    s->periods++;
    s->periodMean += before / s->periods;
    s->periodSquares += before * (ms - s->periodMean);
    s->jitter = sqrt(s->periodSquares / s->periods);
    s->periodHist[plcStatsBin(ms)]++;
}

PLC_HOT void plcStatsScan(plcStats *s, double ms)
{
    s->scanLatency = ms;
    if (ms > s->scanLatencyMax)
        s->scanLatencyMax = ms;
    s->latencyHist[plcStatsBin(ms)]++;
}

void plcStatsSend(plcStats *s, double ms)
{
    s->sendLatency = ms;
    if (ms > s->sendLatencyMax)
        s->sendLatencyMax = ms;
}
