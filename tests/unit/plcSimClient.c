/* plcSimClient: clients of the simulator's servers, over loopback, for their tests.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <epicsUnitTest.h>

#include "plcSimClient.h"
#include "simLog.h"

#define MOST 8192 /* bytes that a test says or hears at once */

simLoop clientLoop;

void clientTurn(void)
{
    simLoopRun(&clientLoop, simNow() + 0.002);
}

int clientDial(const struct sockaddr_in *address)
{
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    int size = 4096; /* little is on its way that is not taken */

    setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &size, sizeof(size));
    if (connect(fd, (const struct sockaddr *)address, sizeof(*address)))
        testAbort("connect: %s", strerror(errno));
    fcntl(fd, F_SETFL, O_NONBLOCK);
    return fd;
}

int clientOpen(simClients *server)
{
    epicsUInt64 before = server->connections + server->sentAway;
    int fd = clientDial(&server->listener.address);

    UNTIL(server->connections + server->sentAway > before);
    return fd;
}

void clientSay(int fd, const char *hex)
{
    epicsUInt8 bytes[MOST];
    size_t count = 0;
    unsigned value;
    int used;

    for (; sscanf(hex, " %2x%n", &value, &used) == 1 && count < MOST; hex += used)
        bytes[count++] = (epicsUInt8)value;
    if (send(fd, bytes, count, MSG_NOSIGNAL) != (ssize_t)count)
        testDiag("send: %s", strerror(errno));
}

long clientHear(int fd, epicsUInt8 *bytes, size_t count)
{
    double end = simNow() + PATIENCE_S;
    size_t got = 0;
    ssize_t n;

    while (got < count && simNow() < end) {
        n = recv(fd, bytes + got, count - got, MSG_DONTWAIT);
        if (n > 0)
            got += (size_t)n;
        else if (n == 0 || (errno != EAGAIN && errno != EWOULDBLOCK))
            return got ? (long)got : n == 0 ? ENDED : WAS_RESET;
        else
            clientTurn();
    }
    return (long)got;
}

static int isLike(const char *text, const char *pattern)
{
    for (; *pattern && (*pattern == '#' || *pattern == *text); pattern++, text++)
        ;
    return !*pattern && !*text;
}

int clientHears(int fd, const char *hex)
{
    epicsUInt8 bytes[MOST];
    simText text = {NULL, 0, 0};
    long want = (long)(strlen(hex) + 1) / 3;
    long n = clientHear(fd, bytes, (size_t)want);
    int same;

    simTextHex(&text, bytes, n > 0 ? (size_t)n : 0);
    same = n == want && isLike(text.text, hex);
    if (!same)
        testDiag("%ld bytes: %s", n, text.text ? text.text : "");
    simTextFree(&text);
    return same;
}

long clientHearsEnd(int fd)
{
    epicsUInt8 byte;

    return clientHear(fd, &byte, 1);
}
