/* The operator's side of the benchmark: a Channel Access client that takes the time of
 * monitors and puts times.
 *
 * The value of every record that it monitors is CLOCK_MONOTONIC of when its block left
 * the PLC, in seconds; IOC, PLC and client run on one machine and share that clock.
 *
 * Obeys lines on standard input, each answered by one line:
 *     monitor PV ...         waits for the first value of each       "monitoring N"
 *     clear                  forgets the updates seen                "cleared"
 *     report                 of all PVs together, ms             "updates N P50 P99 MAX"
 *     one I                  the same of PV number I (from 0)    "updates N P50 P99 MAX"
 *     put PV N MIN MAX       puts the time N times, MIN..MAX ms apart  "put N"
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <cadef.h>
#include <epicsMutex.h>
#include <epicsThread.h>

#define SAMPLES 400000
#define TIMEOUT 60.0

typedef struct sample {
    int pv;
    double latency; /* s */
} sample;

static sample samples[SAMPLES];
static double sorted[SAMPLES];
static int numSamples, numPvs, numFirst;
static epicsMutexId lock;

static double now(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + t.tv_nsec * 1e-9;
}

static void update(struct event_handler_args args)
{
    double t = now();
    char *seen = args.usr;

    if (args.status != ECA_NORMAL)
        return;
    epicsMutexMustLock(lock);
    if (!*seen) {
        *seen = 1;
        numFirst++;
    }
    if (numSamples < SAMPLES) {
        samples[numSamples].pv = (int)(size_t)ca_puser(args.chid);
        samples[numSamples++].latency = t - *(const double *)args.dbr;
    }
    epicsMutexUnlock(lock);
}

static void monitor(char *names)
{
    char *name = strtok(names, " ");
    double end = now() + TIMEOUT;
    int done;
    chid id;

    for (; name; name = strtok(NULL, " ")) {
        SEVCHK(ca_create_channel(name, NULL, (void *)(size_t)numPvs, 0, &id), name);
        SEVCHK(ca_create_subscription(DBR_DOUBLE, 1, id, DBE_VALUE, update, calloc(1, 1),
                                      NULL),
               name);
        numPvs++;
    }
    ca_flush_io();
    do {
        ca_pend_event(0.01);
        epicsMutexMustLock(lock);
        done = numFirst;
        epicsMutexUnlock(lock);
    } while (done < numPvs && now() < end);
    printf("monitoring %d\n", done);
}

static int compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

/* pv: -1 all of them */
static void report(int pv)
{
    int i, n = 0;

    epicsMutexMustLock(lock);
    for (i = 0; i < numSamples; i++)
        if (pv < 0 || samples[i].pv == pv)
            sorted[n++] = samples[i].latency;
    epicsMutexUnlock(lock);
    qsort(sorted, n, sizeof(double), compare);
    printf("updates %d %.4f %.4f %.4f\n", n, n ? 1e3 * sorted[n / 2] : 0,
           n ? 1e3 * sorted[n * 99 / 100] : 0, n ? 1e3 * sorted[n - 1] : 0);
}

static void putTimes(const char *name, int count, double min, double max)
{
    chid id;
    double value;
    int i;

    SEVCHK(ca_create_channel(name, NULL, NULL, 0, &id), name);
    SEVCHK(ca_pend_io(TIMEOUT), name);
    for (i = 0; i < count; i++) {
        epicsThreadSleep(1e-3 * (min + (max - min) * rand() / RAND_MAX));
        value = now();
        ca_put(DBR_DOUBLE, id, &value);
        ca_flush_io();
    }
    epicsThreadSleep(1e-3 * max); /* the last one may be on its way */
    ca_clear_channel(id);
    printf("put %d\n", count);
}

int main(void)
{
    static char line[1 << 16];
    char name[64];
    double min, max;
    int count;

    setvbuf(stdout, NULL, _IOLBF, 0);
    lock = epicsMutexMustCreate();
    SEVCHK(ca_context_create(ca_enable_preemptive_callback), "context");
    while (fgets(line, sizeof(line), stdin)) {
        line[strcspn(line, "\n")] = 0;
        if (strncmp(line, "monitor ", 8) == 0) {
            monitor(line + 8);
        } else if (strcmp(line, "clear") == 0) {
            epicsMutexMustLock(lock);
            numSamples = 0;
            epicsMutexUnlock(lock);
            printf("cleared\n");
        } else if (strcmp(line, "report") == 0) {
            report(-1);
        } else if (sscanf(line, "one %d", &count) == 1) {
            report(count);
        } else if (sscanf(line, "put %63s %d %lf %lf", name, &count, &min, &max) == 4) {
            putTimes(name, count, min, max);
        } else {
            printf("what?\n");
        }
    }
    ca_context_destroy();
    return 0;
}
