/* See testFaults.h. */
#include <dlfcn.h>
#include <errno.h>
#include <pthread.h>

#include <epicsAtomic.h>

#include "testFaults.h"

static int noThreads, clockBack; /* atomic */

void faultNoThreads(int on)
{
    epicsAtomicSetIntT(&noThreads, on);
}

void faultClockBack(int on)
{
    epicsAtomicSetIntT(&clockBack, on);
}

int pthread_create(pthread_t *thread, const pthread_attr_t *attributes,
                   void *(*function)(void *), void *arg)
{
    int (*real)(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *);

    if (epicsAtomicGetIntT(&noThreads))
        return EAGAIN;
    *(void **)&real = dlsym(RTLD_NEXT, "pthread_create");
    return real(thread, attributes, function, arg);
}

int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex,
                           const struct timespec *time)
{
    int (*real)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);

    if (epicsAtomicGetIntT(&clockBack))
        return pthread_cond_wait(condition, mutex);
#ifdef __SANITIZE_THREAD__
    real = NULL; /* the one of the sanitizer has no version */
#else
    /* glibc has an older one of this name, which dlsym might find */
    *(void **)&real = dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2");
#endif
    if (!real)
        *(void **)&real = dlsym(RTLD_NEXT, "pthread_cond_timedwait");
    return real(condition, mutex, time);
}
