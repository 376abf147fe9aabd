/* simLog: lines with a time stamp on stdout, and growing text for console answers.
 * It never blocks: when nobody reads stdout, lines are dropped and counted.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <poll.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <cantProceed.h>

#include "simLog.h"

/* A pipe that poll() calls writable takes this many bytes without blocking. */
#define LINE_MAX_BYTES 1000

static int isQuiet;
static unsigned long dropped;

void simLogQuiet(int quiet)
{
    isQuiet = quiet;
}

static int stdoutReady(void)
{
    struct pollfd p = {STDOUT_FILENO, POLLOUT, 0};

    return poll(&p, 1, 0) == 1 && (p.revents & POLLOUT);
}

static void writeLine(char *line, size_t used)
{
    if (used > LINE_MAX_BYTES - 2)
        used = LINE_MAX_BYTES - 2;
    line[used++] = '\n';
    if (!stdoutReady()) {
        dropped++;
        return;
    }
    if (dropped) {
        char note[80];
        int n = snprintf(note, sizeof(note), "plcSim: %lu lines dropped here\n", dropped);

        dropped = 0;
        if (write(STDOUT_FILENO, note, (size_t)n) < 0)
            return;
    }
    if (write(STDOUT_FILENO, line, used) < 0)
        return;
}

static size_t stamp(char *line, size_t room)
{
    struct timespec ts;
    struct tm tm;
    size_t used;

    clock_gettime(CLOCK_REALTIME, &ts);
    localtime_r(&ts.tv_sec, &tm);
    used = strftime(line, room, "%Y-%m-%d %H:%M:%S", &tm);
    used += (size_t)snprintf(line + used, room - used, ".%03ld ", ts.tv_nsec / 1000000);
    return used;
}

static void logLine(const char *name, const char *format, va_list args)
{
    char line[LINE_MAX_BYTES];
    size_t used = stamp(line, sizeof(line));

    used += (size_t)snprintf(line + used, sizeof(line) - used, "%.40s: ", name);
    used += (size_t)vsnprintf(line + used, sizeof(line) - used, format, args);
    writeLine(line, used);
}

void simLog(const char *name, const char *format, ...)
{
    va_list args;

    if (isQuiet)
        return;
    va_start(args, format);
    logLine(name, format, args);
    va_end(args);
}

void simComplain(const char *name, const char *format, ...)
{
    va_list args;

    if (isQuiet > 1)
        return;
    va_start(args, format);
    logLine(name, format, args);
    va_end(args);
}

void simSay(const char *format, ...)
{
    char line[LINE_MAX_BYTES];
    int used;
    va_list args;

    va_start(args, format);
    used = vsnprintf(line, sizeof(line), format, args);
    va_end(args);
    if (used > 0)
        writeLine(line, (size_t)used);
}

int simFail(char error[SIM_ERROR_SIZE], const char *format, ...)
{
    va_list args;

    va_start(args, format);
    vsnprintf(error, SIM_ERROR_SIZE, format, args);
    va_end(args);
    return -1;
}

static void makeRoom(simText *out, size_t more)
{
    size_t need = out->length + more + 1;

    if (need <= out->room)
        return;
    out->room = need + need / 2 + 128;
    out->text = realloc(out->text, out->room);
    if (!out->text)
        cantProceed("simTextAdd: out of memory");
}

void simTextAdd(simText *out, const char *format, ...)
{
    va_list args;
    int need;

    va_start(args, format);
    need = vsnprintf(NULL, 0, format, args);
    va_end(args);
    if (need < 0)
        return;
    makeRoom(out, (size_t)need);
    va_start(args, format);
    vsnprintf(out->text + out->length, out->room - out->length, format, args);
    va_end(args);
    out->length += (size_t)need;
}

void simTextHex(simText *out, const unsigned char *bytes, size_t size)
{
    static const char digit[] = "0123456789abcdef";
    size_t i;

    makeRoom(out, 3 * size);
    for (i = 0; i < size; i++) {
        if (i)
            out->text[out->length++] = ' ';
        out->text[out->length++] = digit[bytes[i] >> 4];
        out->text[out->length++] = digit[bytes[i] & 15];
    }
    out->text[out->length] = 0;
}

void simTextDump(simText *out, const unsigned char *bytes, size_t size)
{
    size_t i;

    for (i = 0; i < size; i += 16) {
        simTextAdd(out, "%5lu: ", (unsigned long)i);
        simTextHex(out, bytes + i, size - i < 16 ? size - i : 16);
        simTextAdd(out, "\n");
    }
}

void simTextFree(simText *out)
{
    free(out->text);
    memset(out, 0, sizeof(*out));
}
