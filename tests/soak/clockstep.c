/* For LD_PRELOAD: the time of day of one process is off by as many ns as the file named by SOAK_CLOCK says (int64),
 * and jumps when that changes, for those who wait for a time of day, too. Knows nothing of EPICS. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define SECOND 1000000000ll
#define SLICE 20000000ll /* ns: so soon a wait notices a jump */

static volatile int64_t *offset;

__attribute__((constructor)) static void begin(void)
{
    const char *path = getenv("SOAK_CLOCK");
    int fd = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    void *page = fd < 0 ? MAP_FAILED : mmap(NULL, sizeof(*offset), PROT_READ, MAP_SHARED, fd, 0);

    if (fd >= 0)
        close(fd);
    if (page != MAP_FAILED)
        offset = page;
}

static int64_t realNow(clockid_t id)
{
    static int (*get)(clockid_t, struct timespec *);
    struct timespec now = {0, 0};

    if (!get)
        *(void **)&get = dlsym(RTLD_NEXT, "clock_gettime");
    get(id, &now);
    return now.tv_sec * SECOND + now.tv_nsec;
}

int clock_gettime(clockid_t id, struct timespec *now)
{
    int64_t at = realNow(id) + (id == CLOCK_REALTIME && offset ? *offset : 0);

    now->tv_sec = at / SECOND;
    now->tv_nsec = at % SECOND;
    return 0;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone)
{
    int64_t at = realNow(CLOCK_REALTIME) + (offset ? *offset : 0);

    (void)zone;
    now->tv_sec = at / SECOND;
    now->tv_usec = at % SECOND / 1000;
    return 0;
}

time_t time(time_t *where)
{
    time_t at = (realNow(CLOCK_REALTIME) + (offset ? *offset : 0)) / SECOND;

    if (where)
        *where = at;
    return at;
}

/* Slices of the wait, each by the true clock, until the time is over by the clock that jumps. */
int pthread_cond_timedwait(pthread_cond_t *restrict condition, pthread_mutex_t *restrict mutex,
                           const struct timespec *restrict until)
{
    static int (*wait)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);

    if (!wait)
        *(void **)&wait = dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2");
    if (!wait)
        *(void **)&wait = dlsym(RTLD_NEXT, "pthread_cond_timedwait");
    for (;;) {
        int64_t now = realNow(CLOCK_REALTIME);
        int64_t left = until->tv_sec * SECOND + until->tv_nsec - now - (offset ? *offset : 0);
        int64_t end = now + (left < SLICE ? left : SLICE);
        struct timespec slice = {end / SECOND, end % SECOND};
        int status;

        if (end < 0)
            return ETIMEDOUT;
        status = wait(condition, mutex, &slice);
        if (status != ETIMEDOUT || left <= SLICE)
            return status;
    }
}
