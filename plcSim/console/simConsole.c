/* simConsole: takes command lines from stdin and from a unix socket, and writes the
 * answers. It does not know the commands.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* accept4 */
#endif
#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "simCommand.h"
#include "simConsole.h"

#define MAX_ANSWER                                                                       \
    (8u * 1024 * 1024) /* bytes waiting for a console that does not read                 \
                        */

static void onTypist(void *arg, int fd, short revents);

void simConsoleInit(simConsole *console, simulator *sim)
{
    int i;

    memset(console, 0, sizeof(*console));
    console->sim = sim;
    console->listener = -1;
    for (i = 0; i < SIM_MAX_CONSOLES; i++)
        console->typists[i].in = console->typists[i].out = -1;
}

static void dismiss(simConsole *console, simTypist *typist)
{
    simLoopForget(&console->sim->loop, typist->in);
    if (typist->in != STDIN_FILENO)
        close(typist->in);
    typist->in = typist->out = -1;
    typist->used = typist->written = 0;
    typist->overlong = 0;
    simTextFree(&typist->answer);
}

static simTypist *admit(simConsole *console, int in, int out)
{
    int i;

    for (i = 0; i < SIM_MAX_CONSOLES; i++) {
        simTypist *typist = &console->typists[i];

        if (typist->in >= 0)
            continue;
        typist->in = in;
        typist->out = out;
        simLoopWatch(&console->sim->loop, in, POLLIN, onTypist, console);
        return typist;
    }
    return NULL;
}

/* Writes what the descriptor takes. Returns -1 when it is broken. */
static int flush(simConsole *console, simTypist *typist)
{
    simText *answer = &typist->answer;
    int isSocket = typist->in == typist->out;
    ssize_t n;

    while (typist->written < answer->length) {
        const char *p = answer->text + typist->written;
        size_t left = answer->length - typist->written;

        n = isSocket ? send(typist->out, p, left, MSG_NOSIGNAL | MSG_DONTWAIT)
                     : write(typist->out, p, left);
        if (n < 0 && (errno == EAGAIN || errno == EINTR))
            break;
        if (n < 0)
            return -1;
        typist->written += (size_t)n;
    }
    if (typist->written == answer->length)
        typist->written = answer->length = 0;
    if (answer->length > MAX_ANSWER)
        return -1;
    if (isSocket)
        simLoopWatch(&console->sim->loop, typist->in,
                     answer->length ? POLLIN | POLLOUT : POLLIN, onTypist, console);
    return 0;
}

static void takeLine(simConsole *console, simTypist *typist)
{
    typist->line[typist->used] = 0;
    typist->used = 0;
    if (typist->overlong)
        simTextAdd(&typist->answer, "error: the line is too long\n");
    else
        simCommandRun(console->sim, typist->line, &typist->answer);
    typist->overlong = 0;
}

static void takeByte(simConsole *console, simTypist *typist, char c)
{
    if (c == '\n') {
        takeLine(console, typist);
    } else if (typist->used < sizeof(typist->line) - 1) {
        /* a zero byte would hide the rest of the line */
        typist->line[typist->used++] = c ? c : '?';
    } else {
        typist->overlong = 1;
    }
}

/* Reads once. Returns -1 at end of file. */
static int readSome(simConsole *console, simTypist *typist)
{
    char buffer[4096];
    ssize_t n = read(typist->in, buffer, sizeof(buffer));
    ssize_t i;

    if (n < 0)
        return errno == EAGAIN || errno == EINTR ? 0 : -1;
    for (i = 0; i < n; i++)
        takeByte(console, typist, buffer[i]);
    if (n == 0 && typist->used)
        takeLine(console, typist);
    return n == 0 ? -1 : 0;
}

static void onTypist(void *arg, int fd, short revents)
{
    simConsole *console = arg;
    simTypist *typist = NULL;
    int ended = 0;
    int i;

    for (i = 0; i < SIM_MAX_CONSOLES; i++)
        if (console->typists[i].in == fd)
            typist = &console->typists[i];
    if (!typist)
        return;
    if (revents & (POLLIN | POLLHUP | POLLERR | POLLNVAL))
        ended = readSome(console, typist);
    if (flush(console, typist) || ended)
        dismiss(console, typist);
}

static void onListener(void *arg, int fd, short revents)
{
    simConsole *console = arg;
    int client = accept4(fd, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);

    (void)revents;
    if (client >= 0 && !admit(console, client, client))
        close(client);
}

void simConsoleStdin(simConsole *console)
{
    admit(console, STDIN_FILENO, STDOUT_FILENO);
}

/* A socket that nobody serves is left from an earlier run and may go. */
static int isStale(const struct sockaddr_un *address)
{
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    int stale = connect(fd, (const struct sockaddr *)address, sizeof(*address)) != 0 &&
                errno == ECONNREFUSED;

    close(fd);
    return stale;
}

int simConsoleListen(simConsole *console, const char *path)
{
    struct sockaddr_un address;
    int fd;

    memset(&address, 0, sizeof(address));
    address.sun_family = AF_UNIX;
    if (strlen(path) >= sizeof(address.sun_path)) {
        simComplain("plcSim", "console %s: a path may have %u characters", path,
                    (unsigned)sizeof(address.sun_path) - 1);
        return -1;
    }
    strcpy(address.sun_path, path);
    strcpy(console->path, path);
    if (isStale(&address))
        unlink(path);
    fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fd < 0 || bind(fd, (struct sockaddr *)&address, sizeof(address)) ||
        listen(fd, 8)) {
        simComplain("plcSim", "console %s: %s", path, strerror(errno));
        if (fd >= 0)
            close(fd);
        return -1;
    }
    console->listener = fd;
    simLoopWatch(&console->sim->loop, fd, POLLIN, onListener, console);
    return 0;
}

void simConsoleClose(simConsole *console)
{
    int i;

    for (i = 0; i < SIM_MAX_CONSOLES; i++) {
        if (console->typists[i].in < 0)
            continue;
        flush(console, &console->typists[i]);
        dismiss(console, &console->typists[i]);
    }
    if (console->listener < 0)
        return;
    simLoopForget(&console->sim->loop, console->listener);
    close(console->listener);
    unlink(console->path);
    console->listener = -1;
}
