/* The watch on the hosts of a pair, in each of its ways to ask. A way that this machine
 * does not allow is skipped. */
#include <epicsEvent.h>
#include <epicsMutex.h>
#include <epicsThread.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include <string.h>

#include "pairWatch.h"
#include "testFaults.h"

/* Class E: no machine has this address, and no router takes it. */
#define NOBODY "240.0.0.1"

static epicsMutexId lock;
static epicsEventId told; /* there is news */
static int last[PLC_LINES_MAX];       /* -2: no news yet */
static unsigned count[PLC_LINES_MAX]; /* of news */

static void news(void *pvt, unsigned which, int answers)
{
    epicsMutexMustLock(lock);
    last[which] = answers;
    count[which]++;
    epicsMutexUnlock(lock);
    epicsEventMustTrigger(told);
}

static void forget(void)
{
    int i;

    epicsMutexMustLock(lock);
    for (i = 0; i < PLC_LINES_MAX; i++) {
        last[i] = -2;
        count[i] = 0;
    }
    epicsMutexUnlock(lock);
}

/* Waits for news about this host; 20 s at most. */
static int waitFor(unsigned which, int answers)
{
    epicsEventStatus waited = epicsEventOK;
    int now;

    for (;;) {
        epicsMutexMustLock(lock);
        now = last[which];
        epicsMutexUnlock(lock);
        if (now == answers || waited != epicsEventOK)
            return now == answers;
        waited = epicsEventWaitWithTimeout(told, 20);
    }
}

static unsigned countOf(unsigned which)
{
    unsigned n;

    epicsMutexMustLock(lock);
    n = count[which];
    epicsMutexUnlock(lock);
    return n;
}

static void setHost(pairWatch *w, unsigned which, const char *text)
{
    struct in_addr host;

    inet_pton(AF_INET, text, &host);
    pairWatchHost(w, which, host);
}

static void testWay(unsigned way, const char *name)
{
    pairWatch *w;

    testDiag("%s", name);
    forget();
    w = pairWatchCreate(way, news, NULL);
    setHost(w, 0, "127.0.0.2");
    setHost(w, 1, NOBODY);
    pairWatchPeriod(w, 200);
    if (!waitFor(0, 1)) {
        testSkip(5, "loopback does not answer");
        pairWatchDestroy(w);
        return;
    }
    testOk(strcmp(pairWatchWay(w), name) == 0, "the way is \"%s\"", pairWatchWay(w));
    testOk(waitFor(1, 0), "who is not there does not answer");
    setHost(w, 1, "127.0.0.3");
    testOk(waitFor(1, 1), "another host is asked at once, and answers");
    setHost(w, 0, NOBODY);
    testOk(waitFor(0, 0), "a host that goes away is missed");
    pairWatchDestroy(w);
    forget();
    testOk(last[0] == -2 && last[1] == -2, "no news after the end");
}

/* What this machine allows. */
static int canDatagram(void)
{
    int s = socket(AF_INET, SOCK_DGRAM, IPPROTO_ICMP);

    if (s >= 0)
        epicsSocketDestroy(s);
    return s >= 0;
}

static int canRaw(void)
{
    int s = socket(AF_INET, SOCK_RAW, IPPROTO_ICMP);

    if (s >= 0)
        epicsSocketDestroy(s);
    return s >= 0;
}

static int canCommand(void)
{
    static const char *const places[] = {"/bin/ping", "/usr/bin/ping", "/sbin/ping"};
    int i;

    for (i = 0; i < 3; i++)
        if (access(places[i], X_OK) == 0)
            return 1;
    return 0;
}

static void off(void)
{
    pairWatch *w;
    unsigned before;

    testDiag("Period");
    forget();
    w = pairWatchCreate(pairWatchAny, news, NULL);
    setHost(w, 0, NOBODY);
    pairWatchPeriod(w, 100);
    if (!waitFor(0, 0)) {
        testSkip(3, "this machine has no way to ask");
        pairWatchDestroy(w);
        return;
    }
    pairWatchPeriod(w, 0);
    testPass("with a period it asks");
    pairWatchDestroy(w);
    w = pairWatchCreate(pairWatchAny, news, NULL);
    before = countOf(0);
    setHost(w, 0, NOBODY);
    pairWatchNow(w, 0);
    pairWatchDestroy(w);
    testOk(countOf(0) == before, "without one it does not, not even when told to");
    w = pairWatchCreate(0, news, NULL);
    setHost(w, 0, "127.0.0.1");
    pairWatchPeriod(w, 100);
    pairWatchDestroy(w);
    testOk(countOf(0) == before, "with no way to ask there is no news");
}

/* The machine has no thread left: the station goes on without. */
static void noThread(void)
{
    pairWatch *w;

    faultNoThreads(1);
    w = pairWatchCreate(pairWatchAny, news, NULL);
    faultNoThreads(0);
    testOk(!w, "without a thread there is no watch");
    setHost(w, 0, "127.0.0.1");
    pairWatchPeriod(w, 100);
    pairWatchNow(w, 0);
    testOk(strcmp(pairWatchWay(w), "nothing") == 0, "and it can be told what it likes");
    pairWatchDestroy(w);
}

MAIN(watchTest)
{
    static const struct {
        unsigned way;
        const char *name;
        int (*can)(void);
    } ways[] = {
        {pairWatchDatagram, "ICMP datagram socket", canDatagram},
        {pairWatchRaw,      "raw ICMP socket",      canRaw     },
        {pairWatchCommand,  "ping command",         canCommand },
    };
    int i;

    testPlan(20);
    lock = epicsMutexMustCreate();
    told = epicsEventMustCreate(epicsEventEmpty);
    for (i = 0; i < 3; i++)
        if (ways[i].can())
            testWay(ways[i].way, ways[i].name);
        else
            testSkip(5, ways[i].name);
    off();
    noThread();
    return testDone();
}
