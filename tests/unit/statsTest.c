/* The arithmetic of the statistics: bins, minimum, maximum, mean, jitter, reset. */
#include <math.h>
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcStats.h"

static int near(double a, double b)
{
    return fabs(a - b) <= 1e-9 * (fabs(a) + fabs(b) + 1);
}

static const struct {
    double ms;
    int bin;
} bins[] = {
    {-1, 0},      {0, 0},       {0.001, 0},  {0.01, 0},        {0.0125, 0},
    {0.0127, 1},  {0.0201, 3},  {0.0399, 5}, {0.0401, 6},      {10.25, 30},
    {20.5, 33},   {100, 39},    {1000, 49},  {20971.6, 63},    {1e9, PLC_BINS - 1},
    {1e300, PLC_BINS - 1},
};

static void testBins(void)
{
    size_t i;
    int bin, ok = 1;

    for (i = 0; i < sizeof(bins) / sizeof(bins[0]); i++)
        testOk(plcStatsBin(bins[i].ms) == bins[i].bin, "%g ms is in bin %d (%d)", bins[i].ms,
               bins[i].bin, plcStatsBin(bins[i].ms));
    for (bin = 0; bin < PLC_BINS; bin++)
        ok = ok && plcStatsBin(plcStatsBinStart(bin) * 1.001) == bin;
    testOk(ok, "each bin holds the times from its start on");
    testOk(near(plcStatsBinStart(0), 0.01) && near(plcStatsBinStart(3), 0.02),
           "bins begin at 0.01 ms, three to the octave");
}

static void testPeriods(void)
{
    static const double periods[] = {100, 110, 90, 104, 96};
    plcStats s;
    size_t i;

    memset(&s, 0, sizeof(s));
    plcStatsPeriod(&s, 100);
    testOk(near(s.periodMin, 100) && near(s.periodMax, 100) && near(s.periodMean, 100) &&
               s.jitter == 0,
           "one period: minimum = maximum = mean, no jitter");
    for (i = 1; i < 5; i++)
        plcStatsPeriod(&s, periods[i]);
    testOk(near(s.periodLast, 96), "last");
    testOk(near(s.periodMin, 90) && near(s.periodMax, 110), "minimum and maximum");
    testOk(near(s.periodMean, 100), "mean");
    testOk(near(s.jitter, sqrt((100 + 100 + 16 + 16) / 5.0)), "jitter: standard deviation");
    testOk(s.periodHist[plcStatsBin(100)] + s.periodHist[plcStatsBin(110)] +
                   s.periodHist[plcStatsBin(90)] >= 5,
           "histogram of periods");
    for (i = 0; i < 1000000; i++)
        plcStatsPeriod(&s, i & 1 ? 1000.001 : 999.999);
    testOk(s.jitter < 3 && s.jitter > 0, "no loss of digits over a million periods");
}

static void testReset(void)
{
    plcStats s;

    memset(&s, 0, sizeof(s));
    s.connected = 1;
    s.state = 3;
    s.burstSize = 60;
    strcpy(s.lastError, "connection refused by PLC");
    s.blocksIn = s.blocksOut = s.skipped = 7;
    plcStatsPeriod(&s, 10);
    plcStatsScan(&s, 2);
    plcStatsScan(&s, 1);
    plcStatsSend(&s, 4);
    plcStatsSend(&s, 3);
    testOk(s.scanLatency == 1 && s.scanLatencyMax == 2 && s.sendLatency == 3 &&
               s.sendLatencyMax == 4,
           "latencies: the last and the largest");
    testOk(s.latencyHist[plcStatsBin(2)] == 1 && s.latencyHist[plcStatsBin(1)] == 1,
           "each in its bin");
    plcStatsReset(&s);
    testOk(s.blocksIn == 0 && s.blocksOut == 0 && s.skipped == 0 && s.periods == 0 &&
               s.periodMean == 0 && s.scanLatencyMax == 0 && s.latencyHist[22] == 0,
           "reset: counters and times are zero");
    testOk(s.connected == 1 && s.state == 3 && s.burstSize == 60 && s.lastError[0],
           "reset: what is true now stays");
}

MAIN(statsTest)
{
    testPlan((int)(sizeof(bins) / sizeof(bins[0])) + 13);
    testBins();
    testPeriods();
    testReset();
    return testDone();
}
