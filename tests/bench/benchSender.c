/* The PLC side of the benchmark: sends blocks at a given rate, and takes the time of
 * the blocks that come back. It shares no code with the driver.
 *
 * One listening socket per station, on 127.0.0.1, ports chosen by the system. Block to
 * the IOC, big endian:
 *
 *     0  UINT32  sequence number
 *     8  DOUBLE  CLOCK_MONOTONIC just before send(), seconds
 *    32  cells of 4 bytes; cell n is FLOAT, INT16, INT32, UINT16 by (n + n / 100) % 4.
 *        `changing` of them, evenly spread, get a new value with each block
 *
 * Block from the IOC: 0 DOUBLE CLOCK_MONOTONIC of the put, seconds; the rest is ignored.
 * The same DOUBLE may come by Modbus/TCP, in the holding registers 0 to 3 (benchModbus.c).
 *
 * Arguments: stations cells changing outSize. Then it prints "ports p1 p2 ... modbus p", and
 * obeys lines on standard input, each answered by one line:
 *     wait              until every station is connected       "connected"
 *     drop              closes the connections of all stations  "dropped"
 *     run RATE COUNT    COUNT blocks per station, RATE/s each   "sent N late MS"
 *     clear             forgets the puts seen                   "cleared"
 *     puts              latency of the puts seen, ms        "puts N P50 P99 MAX BLOCKS P98"
 *     modbus N CHANGING of N registers behind the first 16, so many change with each poll
 */
#include <arpa/inet.h>
#include <errno.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "benchModbus.h"

#define HEADER 32
#define SAMPLES 100000

typedef struct station {
    int listener, socket; /* socket: -1 not connected */
    uint32_t sequence;
    int left;              /* blocks to send */
    double due;            /* when the next one leaves */
    unsigned char in[256]; /* block from the IOC, as far as it came */
    int fill;
} station;

static station *stations;
static int numStations, cells, changing, outSize, blockSize;
static unsigned char *block;
static struct pollfd *fds;
static int modbusListener, modbusSocket = -1;
static double samples[SAMPLES], lastPut;
static int numSamples;
static long outBlocks;
static double rate, late;
static long sent;
static int running, waiting;

static double now(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + t.tv_nsec * 1e-9;
}

static void die(const char *what)
{
    perror(what);
    exit(1);
}

static void put(unsigned char *at, uint64_t value, int size)
{
    int i;

    for (i = 0; i < size; i++)
        at[i] = (unsigned char)(value >> 8 * (size - 1 - i));
}

static void putDouble(unsigned char *at, double value)
{
    uint64_t bits;

    memcpy(&bits, &value, 8);
    put(at, bits, 8);
}

/* --- Blocks to the IOC ------------------------------------------------------------- */

/* `changing` of the cells, evenly spread. */
static int changes(int cell)
{
    long long step = (long long)cell * changing;

    return step / cells != (step - changing < 0 ? -1 : (step - changing) / cells);
}

static void fillCell(int cell, uint32_t n)
{
    unsigned char *at = block + HEADER + 4 * cell;
    float real = (float)n;
    uint32_t bits;

    memcpy(&bits, &real, 4);
    switch ((cell + cell / 100) % 4) {
    case 0:
        put(at, bits, 4);
        break;
    case 1:
        put(at, n & 0x7FFF, 2);
        break;
    case 2:
        put(at, n, 4);
        break;
    default:
        put(at, n & 0xFFFF, 2);
        break;
    }
}

static void sendBlock(station *s)
{
    int i;
    ssize_t done, n;

    s->sequence++;
    put(block, s->sequence, 4);
    for (i = 0; i < cells; i++)
        fillCell(i, changes(i) ? s->sequence : 1);
    putDouble(block + 8, now());
    for (done = 0; done < blockSize; done += n) {
        n = send(s->socket, block + done, blockSize - done, MSG_NOSIGNAL);
        if (n < 0)
            die("send");
    }
    sent++;
}

/* Sends what is due. Returns the time of the next block, 0 when there is none. */
static double sendDue(void)
{
    double next = 0, t;
    int i;

    for (i = 0; i < numStations; i++) {
        station *s = &stations[i];

        if (!s->left)
            continue;
        t = now();
        if (t >= s->due) {
            if (t - s->due > late)
                late = t - s->due;
            sendBlock(s);
            s->left--;
            s->due += 1 / rate;
        }
        if (s->left && (!next || s->due < next))
            next = s->due;
    }
    return next;
}

static void startRun(int count)
{
    double t = now();
    int i;

    sent = 0;
    late = 0;
    running = 1;
    for (i = 0; i < numStations; i++) {
        stations[i].left = count;
        stations[i].due = t + i / rate / numStations;
    }
}

/* --- Blocks from the IOC ----------------------------------------------------------- */

static void takePut(const unsigned char *bytes)
{
    double t = now(), value;
    uint64_t bits = 0;
    int i;

    outBlocks++;
    for (i = 0; i < 8; i++)
        bits = bits << 8 | bytes[i];
    memcpy(&value, &bits, 8);
    if (value == lastPut || value <= 0)
        return;
    lastPut = value;
    if (numSamples < SAMPLES)
        samples[numSamples++] = t - value;
}

static void receive(station *s)
{
    ssize_t n = recv(s->socket, s->in + s->fill, outSize - s->fill, MSG_DONTWAIT);

    if (n > 0) {
        s->fill += n;
        if (s->fill == outSize) {
            takePut(s->in);
            s->fill = 0;
        }
    } else if (n == 0 || errno != EAGAIN) {
        close(s->socket);
        s->socket = -1;
        s->left = s->fill = 0;
    }
}

static void acceptOne(station *s)
{
    int one = 1, buffer = 4 << 20;

    if (s->socket >= 0)
        close(s->socket);
    s->socket = accept(s->listener, NULL, NULL);
    setsockopt(s->socket, IPPROTO_TCP, TCP_NODELAY, &one, sizeof(one));
    setsockopt(s->socket, SOL_SOCKET, SO_SNDBUF, &buffer, sizeof(buffer));
    s->fill = 0;
}

static void modbusAccept(void)
{
    int one = 1;

    if (modbusSocket >= 0)
        close(modbusSocket);
    modbusSocket = accept(modbusListener, NULL, NULL);
    setsockopt(modbusSocket, IPPROTO_TCP, TCP_NODELAY, &one, sizeof(one));
    modbusBegin();
}

static void modbusReceive(void)
{
    if (modbusServe(modbusSocket, takePut) == 0)
        return;
    close(modbusSocket);
    modbusSocket = -1;
}

/* The IOC has to connect anew. */
static void dropAll(void)
{
    int i;

    for (i = 0; i < numStations; i++) {
        if (stations[i].socket >= 0)
            close(stations[i].socket);
        stations[i].socket = -1;
        stations[i].left = stations[i].fill = 0;
    }
    printf("dropped\n");
}

static int compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

static void printPuts(void)
{
    int n = numSamples;

    qsort(samples, n, sizeof(double), compare);
    printf("puts %d %.4f %.4f %.4f %ld %.4f\n", n, n ? 1e3 * samples[n / 2] : 0,
           n ? 1e3 * samples[n * 99 / 100] : 0, n ? 1e3 * samples[n - 1] : 0, outBlocks,
           n ? 1e3 * samples[n * 98 / 100] : 0);
}

/* --- Loop -------------------------------------------------------------------------- */

static void command(char *line)
{
    int count, change;

    if (sscanf(line, "run %lf %d", &rate, &count) == 2) {
        startRun(count);
    } else if (sscanf(line, "modbus %d %d", &count, &change) == 2) {
        modbusPolled(count, change);
        printf("polled\n");
    } else if (strncmp(line, "wait", 4) == 0) {
        waiting = 1;
    } else if (strncmp(line, "drop", 4) == 0) {
        dropAll();
    } else if (strncmp(line, "clear", 5) == 0) {
        numSamples = 0;
        outBlocks = 0;
        printf("cleared\n");
    } else if (strncmp(line, "puts", 4) == 0) {
        printPuts();
    } else {
        exit(0);
    }
}

static void readCommands(void)
{
    static char text[256];
    static size_t fill;
    ssize_t n = read(0, text + fill, sizeof(text) - 1 - fill);
    char *end;

    if (n <= 0)
        exit(0);
    fill += n;
    text[fill] = 0;
    while ((end = strchr(text, '\n'))) {
        *end = 0;
        command(text);
        fill -= end + 1 - text;
        memmove(text, end + 1, fill + 1);
    }
}

static int allConnected(void)
{
    int i;

    for (i = 0; i < numStations; i++)
        if (stations[i].socket < 0)
            return 0;
    return 1;
}

static void waitFor(double next)
{
    struct timespec limit = {0, 0};
    struct pollfd *modbus = fds + 1 + 2 * numStations;
    double rest = next - now();
    int i;

    fds[0].fd = 0;
    fds[0].events = POLLIN;
    for (i = 0; i < numStations; i++) {
        fds[1 + 2 * i].fd = stations[i].listener;
        fds[2 + 2 * i].fd = stations[i].socket;
        fds[1 + 2 * i].events = fds[2 + 2 * i].events = POLLIN;
    }
    modbus[0].fd = modbusListener;
    modbus[1].fd = modbusSocket;
    modbus[0].events = modbus[1].events = POLLIN;
    if (rest > 0) {
        limit.tv_sec = (time_t)rest;
        limit.tv_nsec = (long)((rest - limit.tv_sec) * 1e9);
    }
    if (ppoll(fds, 3 + 2 * numStations, next ? &limit : NULL, NULL) <= 0)
        return;
    for (i = 0; i < numStations; i++) {
        if (fds[2 + 2 * i].revents && stations[i].socket >= 0)
            receive(&stations[i]);
        if (fds[1 + 2 * i].revents)
            acceptOne(&stations[i]);
    }
    if (modbus[1].revents && modbusSocket >= 0)
        modbusReceive();
    if (modbus[0].revents)
        modbusAccept();
    if (fds[0].revents)
        readCommands();
}

/* A listening socket; its port is printed. */
static int listenOne(void)
{
    struct sockaddr_in a = {.sin_family = AF_INET,
                            .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t length = sizeof(a);
    int s = socket(AF_INET, SOCK_STREAM, 0);

    if (bind(s, (struct sockaddr *)&a, sizeof(a)) || listen(s, 5) ||
        getsockname(s, (struct sockaddr *)&a, &length))
        die("listen");
    printf(" %d", ntohs(a.sin_port));
    return s;
}

static void listenAll(void)
{
    int i;

    printf("ports");
    for (i = 0; i < numStations; i++) {
        stations[i].listener = listenOne();
        stations[i].socket = -1;
    }
    printf(" modbus");
    modbusListener = listenOne();
    printf("\n");
}

int main(int argc, char *argv[])
{
    double next;

    if (argc != 5) {
        fprintf(stderr, "usage: benchSender stations cells changing outSize\n");
        return 2;
    }
    setvbuf(stdout, NULL, _IOLBF, 0);
    numStations = atoi(argv[1]);
    cells = atoi(argv[2]);
    changing = atoi(argv[3]);
    outSize = atoi(argv[4]);
    blockSize = HEADER + 4 * cells;
    if (numStations < 1 || cells < 1 || outSize < 8 || outSize > 256) {
        fprintf(stderr, "benchSender: at least 1 station and 1 cell, outSize 8..256\n");
        return 2;
    }
    stations = calloc(numStations, sizeof(*stations));
    fds = calloc(3 + 2 * numStations, sizeof(*fds));
    block = calloc(1, blockSize);
    listenAll();
    for (;;) {
        next = sendDue();
        if (running && !next) {
            running = 0;
            printf("sent %ld late %.3f\n", sent, 1e3 * late);
        }
        if (waiting && allConnected()) {
            waiting = 0;
            printf("connected\n");
        }
        waitFor(next);
    }
}
