/* simLoop: one thread waits here for descriptors and timers and calls who asked.
 * It does not know what a PLC, a socket or a console is.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simLoop_H
#define INC_simLoop_H

#include <stddef.h>
#include <ellLib.h>

typedef void (*simIoFn)(void *arg, int fd, short revents);
typedef void (*simTimerFn)(void *arg);

/* A timer belongs to its user. It is set, fires once, and may be set again. */
typedef struct simTimer {
    ELLNODE node;
    double deadline; /* s, simNow() scale */
    simTimerFn fn;
    void *arg;
    int armed;
} simTimer;

typedef struct simWatch simWatch;

typedef struct simLoop {
    simWatch *watches;
    size_t count, room;
    unsigned long serial;
    ELLLIST timers;
    int quit;
} simLoop;

/* Monotonic time in s. The zero is the same for all processes of the machine. */
double simNow(void);

void simLoopInit(simLoop *loop);
void simLoopFree(simLoop *loop);

/* Calls fn(arg, fd, revents) when poll() reports one of `events` (or an error) for fd.
 * A second call for the same fd replaces the first; events may be 0. */
void simLoopWatch(simLoop *loop, int fd, short events, simIoFn fn, void *arg);
/* No more calls for fd, also when called from within a callback. Call it before close().
 */
void simLoopForget(simLoop *loop, int fd);

/* Calls fn(arg) once at `deadline`. Setting a timer that is set already moves it. */
void simTimerSet(simLoop *loop, simTimer *timer, double deadline, simTimerFn fn,
                 void *arg);
void simTimerStop(simLoop *loop, simTimer *timer);

/* Serves until loop->quit is set or until time `end` (s, simNow() scale; 0 = no end). */
void simLoopRun(simLoop *loop, double end);

#endif
