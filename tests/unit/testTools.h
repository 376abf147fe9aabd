/* What the tests share: waiting for a condition, and the PLC's end of a connection, byte by
 * byte. Knows nothing of the driver. */
#ifndef INC_testTools_H
#define INC_testTools_H

#include <stddef.h>

#include <epicsThread.h>
#include <epicsTime.h>
#include <epicsTypes.h>

/* Patience with a machine that is busy, s; reached only when a test fails. */
#define PATIENCE_S 30

/* WAIT_FOR(condition) looks each ms; comes back when it is true or patience is at an end. */
#define WAIT_FOR(condition)                                                               \
    do {                                                                                  \
        epicsUInt64 end_ = epicsMonotonicGet() + PATIENCE_S * 1000000000ull;               \
        while (!(condition) && epicsMonotonicGet() < end_)                                \
            epicsThreadSleep(0.001);                                                      \
    } while (0)

/* A file of the source tree, "docs/options.md", to be freed; tests run in their O.* folder
 * or beside their source. */
char *toolReadFile(const char *name);

/* A listening socket on loopback; *port is the one asked for or, for 0, a free one. */
int toolListen(int *port);

/* A port of loopback on which nobody listens. */
int toolFreePort(void);

/* The next connection; -1 when patience is at an end. */
int toolAccept(int listener);

/* 1 when a connection waits to be accepted now. */
int toolWaiting(int listener);

/* Sends all bytes. Returns 0, or -1. */
int toolSend(int fd, const void *bytes, size_t count);

/* Receives until `count` bytes are there, the peer closes, or patience is at an end.
 * Returns the number of bytes. */
size_t toolReceive(int fd, void *bytes, size_t count);

/* Receives what is there now, without waiting. -1: the peer has closed. */
long toolPeek(int fd, void *bytes, size_t count);

/* Waits until the peer has closed; drops what comes. 1 = closed, 0 = out of patience. */
int toolClosed(int fd);

void toolClose(int fd);

/* Closes with a reset. */
void toolReset(int fd);

#endif /* INC_testTools_H */
