/* A wake-up: one thread waits, any other wakes it.
 *
 * As an event of Base, but its limit is a time of the monotonic clock (Base's events wait by
 * the wall clock, which may be set meanwhile), and poll() can wait for it beside sockets.
 * Knows nothing of who waits for what.
 */
#ifndef INC_plcWake_H
#define INC_plcWake_H

#include <epicsEvent.h>
#include <epicsTypes.h>

#define PLC_WAKE_NEVER ((epicsUInt64)-1)

typedef struct plcWake {
    int pipe[2];
    int woken; /* atomic: a byte is in the pipe already */
} plcWake;

/* Takes two descriptors. Returns 0; or -1 with errno: then nothing wakes, but
 * plcWakeFree is allowed. */
int plcWakeInit(plcWake *wake);
void plcWakeFree(plcWake *wake);

/* Any thread, also with locks held; never blocks. Those before the next wait are one. */
void plcWakeUp(plcWake *wake);

/* Waits for a wake-up, also one from before, or until `deadline`, monotonic ns; that may
 * have passed: then it only looks. One thread at a time. Returns 1: woken, 0: too late. */
int plcWakeWait(plcWake *wake, epicsUInt64 deadline);

/* The same in two parts, for who waits for more: the descriptor for poll(), to be readable,
 * and what follows when it was. What was to be done has to be looked at after that. */
int plcWakeDescriptor(const plcWake *wake);
void plcWakeTake(plcWake *wake);

/* Waits for a thread that signals `ended`, and then wakes `some` (of which there may be one for
 * many threads, one of which waits). Returns 0; or -1 when it has not ended by then. */
int plcWakeJoin(plcWake *some, epicsEventId ended, epicsUInt64 deadline);

#endif /* INC_plcWake_H */
