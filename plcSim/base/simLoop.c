/* simLoop: one thread waits here for descriptors and timers and calls who asked.
 * It does not know what a PLC, a socket or a console is.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* ppoll */
#endif
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <cantProceed.h>

#include "simLoop.h"

struct simWatch {
    int fd;
    short events;
    unsigned long serial; /* tells a watch from an older one with the same fd */
    simIoFn fn;
    void *arg;
};

double simNow(void)
{
    struct timespec ts;

    clock_gettime(CLOCK_MONOTONIC, &ts);
    return ts.tv_sec + ts.tv_nsec * 1e-9;
}

void simLoopInit(simLoop *loop)
{
    memset(loop, 0, sizeof(*loop));
    ellInit(&loop->timers);
}

void simLoopFree(simLoop *loop)
{
    free(loop->watches);
    simLoopInit(loop);
}

static simWatch *findWatch(simLoop *loop, int fd)
{
    size_t i;

    for (i = 0; i < loop->count; i++)
        if (loop->watches[i].fd == fd)
            return &loop->watches[i];
    return NULL;
}

void simLoopWatch(simLoop *loop, int fd, short events, simIoFn fn, void *arg)
{
    simWatch *watch = findWatch(loop, fd);

    if (!watch) {
        if (loop->count == loop->room) {
            loop->room = loop->room ? 2 * loop->room : 16;
            loop->watches = realloc(loop->watches, loop->room * sizeof(simWatch));
            if (!loop->watches)
                cantProceed("simLoopWatch: out of memory");
        }
        watch = &loop->watches[loop->count++];
        watch->fd = fd;
        watch->serial = ++loop->serial;
    }
    watch->events = events;
    watch->fn = fn;
    watch->arg = arg;
}

void simLoopForget(simLoop *loop, int fd)
{
    simWatch *watch = findWatch(loop, fd);

    if (watch)
        *watch = loop->watches[--loop->count];
}

void simTimerSet(simLoop *loop, simTimer *timer, double deadline, simTimerFn fn,
                 void *arg)
{
    if (!timer->armed)
        ellAdd(&loop->timers, &timer->node);
    timer->armed = 1;
    timer->deadline = deadline;
    timer->fn = fn;
    timer->arg = arg;
}

void simTimerStop(simLoop *loop, simTimer *timer)
{
    if (timer->armed)
        ellDelete(&loop->timers, &timer->node);
    timer->armed = 0;
}

static simTimer *firstTimer(simLoop *loop)
{
    simTimer *first = NULL;
    simTimer *timer;

    for (timer = (simTimer *)ellFirst(&loop->timers); timer;
         timer = (simTimer *)ellNext(&timer->node))
        if (!first || timer->deadline < first->deadline)
            first = timer;
    return first;
}

/* Fires what is due now; what a callback sets anew waits for the next round. */
static void runTimers(simLoop *loop)
{
    double now = simNow();
    int limit = ellCount(&loop->timers);
    simTimer *timer;

    while (limit-- > 0 && !loop->quit) {
        timer = firstTimer(loop);
        if (!timer || timer->deadline > now)
            return;
        simTimerStop(loop, timer);
        timer->fn(timer->arg);
    }
}

static void waitTime(simLoop *loop, double end, struct timespec *ts)
{
    simTimer *timer = firstTimer(loop);
    double until = timer ? timer->deadline : simNow() + 10.0;
    double wait;

    if (end > 0 && end < until)
        until = end;
    wait = until - simNow();
    if (wait < 0)
        wait = 0;
    if (wait > 10.0)
        wait = 10.0;
    ts->tv_sec = (time_t)wait;
    ts->tv_nsec = (long)((wait - (double)ts->tv_sec) * 1e9);
}

static void dispatch(simLoop *loop, const struct pollfd *fds,
                     const unsigned long *serials, size_t count)
{
    size_t i;

    for (i = 0; i < count && !loop->quit; i++) {
        simWatch *watch;

        if (!fds[i].revents)
            continue;
        watch = findWatch(loop, fds[i].fd);
        if (watch && watch->serial == serials[i])
            watch->fn(watch->arg, watch->fd, fds[i].revents);
    }
}

void simLoopRun(simLoop *loop, double end)
{
    struct pollfd *fds = NULL;
    unsigned long *serials = NULL;
    size_t room = 0, count, i;
    struct timespec ts;

    while (!loop->quit && (end <= 0 || simNow() < end)) {
        if (room < loop->count) {
            room = loop->count + 8;
            free(fds);
            free(serials);
            fds = callocMustSucceed(room, sizeof(*fds), "simLoopRun");
            serials = callocMustSucceed(room, sizeof(*serials), "simLoopRun");
        }
        count = loop->count;
        for (i = 0; i < count; i++) {
            fds[i].fd = loop->watches[i].fd;
            fds[i].events = loop->watches[i].events;
            fds[i].revents = 0;
            serials[i] = loop->watches[i].serial;
        }
        waitTime(loop, end, &ts);
        if (ppoll(fds, count, &ts, NULL) > 0)
            dispatch(loop, fds, serials, count);
        runTimers(loop);
    }
    free(fds);
    free(serials);
}
