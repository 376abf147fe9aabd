/* The watch on the hosts of a pair; see pairWatch.h.
 *
 * A question is up to four echo requests, a step apart; it is over with the first answer,
 * or a step after the fourth. An answer that comes later still counts.
 */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <netinet/in.h>

#include <cantProceed.h>
#include <epicsAssert.h>
#include <epicsAtomic.h>
#include <epicsEvent.h>
#include <epicsMutex.h>
#include <epicsThread.h>
#include <epicsTime.h>

#include "pairWatch.h"
#include "plcWake.h"

#define REQUESTS 4    /* of one question */
#define LEAST_MS 50.0 /* period */
#define STEP_MS 100.0 /* between them, at most */
#define NEVER ((epicsUInt64)-1)

extern char **environ;

/* ICMP echo (RFC 792), big endian, without data:
 *   0 type   1 code   2 checksum (UINT16)   4 id (UINT16)   6 sequence (UINT16) */
typedef struct echoPacket {
    epicsUInt8 type, code;
    epicsUInt16 checksum, id, sequence;
} echoPacket;

STATIC_ASSERT(sizeof(echoPacket) == 8);

enum { ECHO_REPLY = 0, ECHO_REQUEST = 8 };

typedef struct asked {
    struct in_addr wanted; /* whom to ask; s_addr 0: not known yet */
    int now;               /* ask at once */
    /* owned by the thread */
    struct in_addr host; /* its copy of wanted */
    epicsUInt64 next;    /* when to begin the next question */
    epicsUInt64 step;    /* when to send the next request, NEVER: no question is open */
    unsigned sent;       /* requests of the open question */
    int answers;         /* what the last question said */
    pid_t child;         /* ping, 0: none */
    int output;          /* its stdout: ends with it */
} asked;

struct pairWatch {
    pairWatchNews *news;
    void *pvt;
    unsigned ways;
    int stop; /* atomic */
    int way;  /* atomic: which of pairWatchDatagram ... is in use, 0: none */
    plcWake wake;
    epicsEventId ended;
    epicsMutexId lock;  /* guards period, and wanted and now of the hosts */
    epicsUInt64 period; /* ns */
    asked plc[PLC_LINES_MAX];
    /* owned by the thread */
    int socket;
    epicsUInt16 id, sequence;
};

static epicsMutexId spawning;
static epicsThreadOnceId once = EPICS_THREAD_ONCE_INIT;

static void initOnce(void *arg)
{
    (void)arg;
    spawning = epicsMutexMustCreate();
}

/* --- Ways to ask -------------------------------------------------------------------- */

/* Not for children of ours, and nobody waits on it. */
static void makePrivate(int fd)
{
    fcntl(fd, F_SETFD, FD_CLOEXEC);
    fcntl(fd, F_SETFL, fcntl(fd, F_GETFL) | O_NONBLOCK);
}

static int makePipe(int ends[2])
{
    if (pipe(ends))
        return -1;
    makePrivate(ends[0]);
    makePrivate(ends[1]);
    return 0;
}

/* The first way of those wanted that this machine allows. */
static void chooseWay(pairWatch *w)
{
    static const struct {
        int way, type;
    } sockets[] = {
        {pairWatchDatagram, SOCK_DGRAM},
        {pairWatchRaw,      SOCK_RAW  }
    };
    unsigned i;

    for (i = 0; i < 2; i++) {
        if (!(w->ways & sockets[i].way))
            continue;
        w->socket = socket(AF_INET, sockets[i].type, IPPROTO_ICMP);
        if (w->socket >= 0) {
            makePrivate(w->socket);
            epicsAtomicSetIntT(&w->way, sockets[i].way);
            return;
        }
    }
    epicsAtomicSetIntT(&w->way, w->ways & pairWatchCommand);
}

/* The Internet checksum: the one's complement of the one's complement sum. */
static epicsUInt16 checksum(const echoPacket *packet)
{
    epicsUInt16 words[sizeof(*packet) / 2];
    epicsUInt32 sum = 0;
    size_t i;

    memcpy(words, packet, sizeof(words));
    for (i = 0; i < sizeof(words) / sizeof(words[0]); i++)
        sum += words[i];
    sum = (sum >> 16) + (sum & 0xffff);
    return (epicsUInt16) ~(sum + (sum >> 16));
}

static void sendEcho(pairWatch *w, unsigned which)
{
    echoPacket echo = {.type = ECHO_REQUEST};
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_addr = w->plc[which].host};

    /* The kernel puts its own id into those of a datagram socket. */
    echo.id = htons(w->id);
    echo.sequence = htons(++w->sequence);
    echo.checksum = checksum(&echo);
    /* "no route" is no answer */
    (void)!sendto(w->socket, &echo, sizeof(echo), MSG_NOSIGNAL, (struct sockaddr *)&to,
                  sizeof(to));
}

/* True when the packet is an answer to one of our requests. */
static int isOurs(const pairWatch *w, const char *packet, size_t length)
{
    echoPacket echo;
    size_t skip = 0;

    if (w->way == pairWatchRaw) /* the IP header comes first */
        skip = length ? (packet[0] & 0x0f) * 4u : 0;
    if (length < skip + sizeof(echo))
        return 0;
    memcpy(&echo, packet + skip, sizeof(echo));
    return echo.type == ECHO_REPLY &&
           (w->way == pairWatchDatagram || echo.id == htons(w->id));
}

/* Starts `ping host`, without a shell, with its output to this pipe. Returns 0 or -1. */
static int spawn(asked *a, int output)
{
    char host[INET_ADDRSTRLEN];
    char *const args[] = {"ping", "-n", "-q", "-c", "1", "-W", "1", host, NULL};
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    sigset_t signals;
    int status;

    inet_ntop(AF_INET, &a->host, host, sizeof(host));
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_adddup2(&actions, output, 1);
    posix_spawn_file_actions_addopen(&actions, 2, "/dev/null", O_WRONLY, 0);
    posix_spawnattr_init(&attributes);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK);
    sigemptyset(&signals);
    posix_spawnattr_setsigmask(&attributes, &signals);
    status = posix_spawnp(&a->child, "ping", &actions, &attributes, args, environ);
    if (status)
        a->child = 0;
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
    return status ? -1 : 0;
}

/* Asks by a process. Its end shows as the end of its output. */
static void startPing(pairWatch *w, unsigned which)
{
    asked *a = &w->plc[which];
    int ends[2], status = 0;

    /* One at a time: a child must not inherit the pipe of another's ping. */
    epicsMutexMustLock(spawning);
    if (makePipe(ends) == 0) {
        status = spawn(a, ends[1]);
        close(ends[1]);
        if (status)
            close(ends[0]);
        else
            a->output = ends[0];
    }
    epicsMutexUnlock(spawning);
    if (status) { /* there is no such command */
        epicsAtomicSetIntT(&w->way, 0);
        w->news(w->pvt, which, -1);
    }
}

/* Takes the ping of a host away. Returns 1 when it had an answer. */
static int reapPing(asked *a, int kills)
{
    int status = -1;

    if (!a->child)
        return 0;
    if (kills)
        kill(a->child, SIGKILL);
    while (waitpid(a->child, &status, 0) < 0 && errno == EINTR)
        ;
    close(a->output);
    a->child = 0;
    a->output = -1;
    return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

/* --- Questions ---------------------------------------------------------------------- */

static epicsUInt64 stepTime(epicsUInt64 period)
{
    epicsUInt64 step = period / 10, most = (epicsUInt64)(STEP_MS * 1e6);

    return step < most ? step : most;
}

static void answered(pairWatch *w, unsigned which)
{
    w->plc[which].step = NEVER;
    w->plc[which].answers = 1;
    reapPing(&w->plc[which], 1);
    w->news(w->pvt, which, 1);
}

static void request(pairWatch *w, unsigned which)
{
    if (epicsAtomicGetIntT(&w->way) != pairWatchCommand)
        sendEcho(w, which);
    else if (w->plc[which].sent % 2 == 0) { /* a process has two steps */
        reapPing(&w->plc[which], 1);
        startPing(w, which);
    }
    w->plc[which].sent++;
}

/* Timers of one host. */
static void askStep(pairWatch *w, unsigned which, epicsUInt64 period, epicsUInt64 now,
                    epicsUInt64 *wake)
{
    asked *a = &w->plc[which];

    if (a->step == NEVER && now >= a->next) {
        a->sent = 0;
        a->step = now;
        /* Who does not answer is asked more often, to be seen soon when it is back. */
        a->next = now + (a->answers ? period : period / 2);
    }
    if (now >= a->step) {
        if (a->sent < REQUESTS) {
            request(w, which);
            a->step = now + stepTime(period);
        } else {
            a->step = NEVER;
            a->answers = 0;
            reapPing(a, 1);
            w->news(w->pvt, which, 0);
        }
    }
    if (a->step < *wake)
        *wake = a->step;
    if (a->step == NEVER && a->next < *wake)
        *wake = a->next;
}

/* Copies what others want. Returns the period, 0: do not ask. */
static epicsUInt64 takeOrders(pairWatch *w)
{
    epicsUInt64 period;
    unsigned i;

    epicsMutexMustLock(w->lock);
    period = w->period;
    for (i = 0; i < PLC_LINES_MAX; i++) {
        w->plc[i].host = w->plc[i].wanted;
        if (w->plc[i].now) {
            w->plc[i].next = 0;
            w->plc[i].step = NEVER;
            w->plc[i].now = 0;
        }
    }
    epicsMutexUnlock(w->lock);
    return epicsAtomicGetIntT(&w->way) ? period : 0;
}

static void readSocket(pairWatch *w)
{
    struct sockaddr_in from = {0};
    socklen_t size = sizeof(from);
    char packet[512];
    ssize_t length;
    unsigned i;

    while ((length = recvfrom(w->socket, packet, sizeof(packet), 0,
                              (struct sockaddr *)&from, &size)) >= 0) {
        for (i = 0; i < PLC_LINES_MAX; i++)
            if (w->plc[i].host.s_addr == from.sin_addr.s_addr &&
                isOurs(w, packet, length))
                answered(w, i);
        size = sizeof(from);
    }
}

static void waitFor(pairWatch *w, epicsUInt64 wake)
{
    struct pollfd fds[2 + PLC_LINES_MAX] = {
        {plcWakeDescriptor(&w->wake), POLLIN, 0},
        {w->socket,                   POLLIN, 0}
    };
    epicsUInt64 now = epicsMonotonicGet();
    char buffer[16];
    unsigned i;
    int ms = -1;

    if (wake != NEVER)
        ms = wake > now ? (int)((wake - now + 999999) / 1000000) : 0;
    for (i = 0; i < PLC_LINES_MAX; i++) {
        fds[2 + i].fd = w->plc[i].child ? w->plc[i].output : -1;
        fds[2 + i].events = POLLIN;
    }
    if (poll(fds, 2 + PLC_LINES_MAX, ms) <= 0)
        return;
    if (fds[0].revents)
        plcWakeTake(&w->wake);
    if (fds[1].revents)
        readSocket(w);
    for (i = 0; i < PLC_LINES_MAX; i++)
        if (fds[2 + i].revents && read(w->plc[i].output, buffer, sizeof(buffer)) <= 0 &&
            reapPing(&w->plc[i], 0))
            answered(w, i);
}

static void watchThread(void *arg)
{
    pairWatch *w = arg;
    unsigned i;

    chooseWay(w);
    while (!epicsAtomicGetIntT(&w->stop)) {
        epicsUInt64 wake = NEVER, period = takeOrders(w);
        epicsUInt64 now = epicsMonotonicGet();

        for (i = 0; period && i < PLC_LINES_MAX; i++)
            if (w->plc[i].host.s_addr)
                askStep(w, i, period, now, &wake);
        waitFor(w, wake);
    }
    for (i = 0; i < PLC_LINES_MAX; i++)
        reapPing(&w->plc[i], 1);
    if (w->socket >= 0)
        close(w->socket);
    epicsEventSignal(w->ended);
}

/* --- From outside ------------------------------------------------------------------- */

static void freeWatch(pairWatch *w)
{
    plcWakeFree(&w->wake);
    epicsEventDestroy(w->ended);
    epicsMutexDestroy(w->lock);
    free(w);
}

pairWatch *pairWatchCreate(unsigned ways, pairWatchNews *news, void *pvt)
{
    static int number;
    pairWatch *w = callocMustSucceed(1, sizeof(*w), "pairWatchCreate");
    unsigned i;

    epicsThreadOnce(&once, initOnce, NULL);
    w->ways = ways;
    w->news = news;
    w->pvt = pvt;
    w->socket = -1;
    w->id = (epicsUInt16)(getpid() * 31 + epicsAtomicIncrIntT(&number));
    w->lock = epicsMutexMustCreate();
    w->ended = epicsEventMustCreate(epicsEventEmpty);
    for (i = 0; i < PLC_LINES_MAX; i++) {
        w->plc[i].step = NEVER;
        w->plc[i].output = -1;
    }
    if (plcWakeInit(&w->wake) == 0 &&
        epicsThreadCreate("pairWatch", epicsThreadPriorityLow,
                          epicsThreadGetStackSize(epicsThreadStackMedium), watchThread, w))
        return w;
    freeWatch(w);
    return NULL;
}

void pairWatchDestroy(pairWatch *w)
{
    if (!w)
        return;
    epicsAtomicSetIntT(&w->stop, 1);
    plcWakeUp(&w->wake);
    epicsEventMustWait(w->ended);
    freeWatch(w);
}

void pairWatchHost(pairWatch *w, unsigned which, struct in_addr host)
{
    int news;

    if (!w)
        return;
    epicsMutexMustLock(w->lock);
    news = w->plc[which].wanted.s_addr != host.s_addr;
    w->plc[which].wanted = host;
    w->plc[which].now |= news;
    epicsMutexUnlock(w->lock);
    if (news)
        plcWakeUp(&w->wake);
}

void pairWatchPeriod(pairWatch *w, double ms)
{
    unsigned i;

    if (!w)
        return;
    epicsMutexMustLock(w->lock);
    w->period = (epicsUInt64)((ms > 0 && ms < LEAST_MS ? LEAST_MS : ms) * 1e6);
    for (i = 0; i < PLC_LINES_MAX; i++)
        w->plc[i].now = 1;
    epicsMutexUnlock(w->lock);
    plcWakeUp(&w->wake);
}

void pairWatchNow(pairWatch *w, unsigned which)
{
    if (!w)
        return;
    epicsMutexMustLock(w->lock);
    w->plc[which].now = 1;
    epicsMutexUnlock(w->lock);
    plcWakeUp(&w->wake);
}

const char *pairWatchWay(pairWatch *w)
{
    switch (w ? epicsAtomicGetIntT(&w->way) : 0) {
    case pairWatchDatagram:
        return "ICMP datagram socket";
    case pairWatchRaw:
        return "raw ICMP socket";
    case pairWatchCommand:
        return "ping command";
    }
    return "nothing";
}
