/* The PLC's end of a connection for the tests; see testTools.h. */
#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <epicsUnitTest.h>

#include "testTools.h"

static int ready(int fd, short events)
{
    struct pollfd p = {fd, events, 0};
    epicsUInt64 end = epicsMonotonicGet() + PATIENCE_S * 1000000000ull;

    while (epicsMonotonicGet() < end)
        if (poll(&p, 1, 1000) > 0)
            return 1;
    return 0;
}

char *toolReadFile(const char *name)
{
    static const char *const tops[] = {"../../..", "../.."};
    char path[300], *text = calloc(1, 100001);
    size_t i;

    for (i = 0; i < 2; i++) {
        FILE *file;

        snprintf(path, sizeof(path), "%s/%s", tops[i], name);
        file = fopen(path, "r");
        if (!file)
            continue;
        if (!fread(text, 1, 100000, file))
            text[0] = 0;
        fclose(file);
        return text;
    }
    testAbort("no file %s", name);
    return NULL;
}

int toolListen(int *port)
{
    struct sockaddr_in address = {.sin_family = AF_INET};
    socklen_t length = sizeof(address);
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0), on = 1;

    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons((unsigned short)*port);
    setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
    if (bind(fd, (struct sockaddr *)&address, sizeof(address)) || listen(fd, 300) ||
        getsockname(fd, (struct sockaddr *)&address, &length))
        testAbort("cannot listen on port %d: %s", *port, strerror(errno));
    *port = ntohs(address.sin_port);
    return fd;
}

int toolFreePort(void)
{
    int port = 0;

    close(toolListen(&port));
    return port;
}

int toolAccept(int listener)
{
    int fd, on = 1;

    if (!ready(listener, POLLIN))
        return -1;
    fd = accept(listener, NULL, NULL);
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    return fd;
}

int toolWaiting(int listener)
{
    struct pollfd p = {listener, POLLIN, 0};

    return poll(&p, 1, 0) > 0;
}

int toolSend(int fd, const void *bytes, size_t count)
{
    const char *from = bytes;

    while (count) {
        ssize_t n;

        if (!ready(fd, POLLOUT))
            return -1;
        n = send(fd, from, count, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (n < 0 && errno != EAGAIN && errno != EINTR)
            return -1;
        if (n > 0) {
            from += n;
            count -= (size_t)n;
        }
    }
    return 0;
}

size_t toolReceive(int fd, void *bytes, size_t count)
{
    size_t got = 0;

    while (got < count && ready(fd, POLLIN)) {
        ssize_t n = recv(fd, (char *)bytes + got, count - got, 0);

        if (n <= 0)
            break;
        got += (size_t)n;
    }
    return got;
}

long toolPeek(int fd, void *bytes, size_t count)
{
    ssize_t n = recv(fd, bytes, count, MSG_DONTWAIT);

    if (n > 0)
        return n;
    return n < 0 && (errno == EAGAIN || errno == EINTR) ? 0 : -1;
}

int toolClosed(int fd)
{
    char dropped[4096];

    while (ready(fd, POLLIN))
        if (recv(fd, dropped, sizeof(dropped), 0) <= 0)
            return 1;
    return 0;
}

void toolClose(int fd)
{
    if (fd >= 0)
        close(fd);
}

void toolReset(int fd)
{
    struct linger now = {1, 0};

    setsockopt(fd, SOL_SOCKET, SO_LINGER, &now, sizeof(now));
    close(fd);
}
