/* Name look-ups off the station's thread; see plcResolver.h. */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <netdb.h>

#include <cantProceed.h>
#include <epicsMutex.h>
#include <epicsStdio.h>
#include <epicsString.h>
#include <epicsThread.h>

#include "plcResolver.h"

enum { HOST_MAX = 255 };

/* Shared by the owner and a look-up that runs; the last of them frees it. */
struct plcResolver {
    epicsMutexId lock;
    char *host;
    unsigned plus;
    int numeric;      /* nothing to look up */
    int known;        /* address holds the last good answer */
    struct in_addr address;
    char error[80];   /* of the last look-up, "" = it was good */
    int running;      /* a look-up runs */
    void (*wake)(void *arg); /* NULL: the owner has gone */
    void *arg;
};

int plcAddressIsHost(const char *host)
{
    struct in_addr address;
    size_t i;

    for (i = 0; host[i]; i++)
        if (!isalnum((unsigned char)host[i]) && !strchr(".-_", host[i]))
            return 0;
    if (i > HOST_MAX)
        return 0;
    if (i == 0 || inet_pton(AF_INET, host, &address) == 1)
        return 1;
    return strspn(host, "0123456789.") < i && !inet_aton(host, &address);
}

int plcAddressPlus(struct in_addr *address, unsigned plus)
{
    epicsUInt32 host = ntohl(address->s_addr);
    unsigned last = host & 0xff;

    if (plus && (last + plus < 1 || last + plus > 254))
        return -1;
    address->s_addr = htonl(host + plus);
    return 0;
}

/* A good answer; the lock is held or not needed yet. */
static void setAddress(plcResolver *r, struct in_addr address)
{
    if (plcAddressPlus(&address, r->plus)) {
        epicsSnprintf(r->error, sizeof(r->error), "%s+%u leaves the range .1 to .254",
                      r->host, r->plus);
        return;
    }
    r->address = address;
    r->known = 1;
    r->error[0] = 0;
}

static void destroy(plcResolver *r)
{
    epicsMutexDestroy(r->lock);
    free(r->host);
    free(r);
}

static void lookUp(void *arg)
{
    plcResolver *r = arg;
    struct addrinfo hints = {.ai_family = AF_INET, .ai_socktype = SOCK_STREAM};
    struct addrinfo *found = NULL;
    int status = getaddrinfo(r->host, NULL, &hints, &found);
    int unwanted;

    epicsMutexMustLock(r->lock);
    if (status == 0)
        setAddress(r, ((struct sockaddr_in *)found->ai_addr)->sin_addr);
    else
        epicsSnprintf(r->error, sizeof(r->error), "no address for host \"%s\"", r->host);
    r->running = 0;
    unwanted = !r->wake;
    /* Called with the lock held, so that the owner cannot go away meanwhile. */
    if (!unwanted)
        r->wake(r->arg);
    epicsMutexUnlock(r->lock);
    if (found)
        freeaddrinfo(found);
    if (unwanted)
        destroy(r);
}

plcResolver *plcResolverCreate(const char *host, unsigned plus, void (*wake)(void *arg),
                               void *arg)
{
    plcResolver *r = callocMustSucceed(1, sizeof(*r), "plcResolverCreate");
    struct in_addr address;

    r->lock = epicsMutexMustCreate();
    r->host = epicsStrDup(host);
    r->plus = plus;
    r->wake = wake;
    r->arg = arg;
    if (inet_pton(AF_INET, host, &address) == 1) {
        r->numeric = 1;
        setAddress(r, address);
    }
    return r;
}

void plcResolverRelease(plcResolver *r)
{
    int running;

    if (!r)
        return;
    epicsMutexMustLock(r->lock);
    running = r->running;
    r->wake = NULL;
    epicsMutexUnlock(r->lock);
    if (!running)
        destroy(r);
}

int plcResolverAddress(plcResolver *r, int refresh, struct in_addr *address, char *error,
                       size_t size)
{
    int result;

    epicsMutexMustLock(r->lock);
    if (refresh && !r->numeric && !r->running) {
        r->running = epicsThreadCreate("s7plcDNS", epicsThreadPriorityLow,
                                       epicsThreadGetStackSize(epicsThreadStackMedium),
                                       lookUp, r) != NULL;
    }
    result = r->known ? 1 : r->running && !r->error[0] ? 0 : -1;
    if (r->known)
        *address = r->address;
    if (result < 0)
        epicsSnprintf(error, size, "%s", r->error);
    epicsMutexUnlock(r->lock);
    return result;
}
