/* Fuzz target: what a PLC answers to a request of Modbus, in pieces as the fuzzer likes, over TCP
 * and with framing rtu. What is passed on to libmodbus is whole, as long as the request wants,
 * and to that request; no more is read than there is room for.
 *
 * The driver's own file, with the calls of the system replaced by bytes in memory. */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include "fuzz.h"

fuzzTarget fuzzModbusAnswer;

static fuzzBytes wire;   /* length of a piece, then the piece, ...; 0: nothing is there */
static int wireEnds;     /* how: 0 no answer, 1 closed, 2 reset */
static size_t wireLeft;  /* of the piece */

static ssize_t fuzzRecv(int fd, void *to, size_t size, int flags)
{
    size_t n, i;

    (void)fd;
    (void)flags;
    fuzzCheck(size > 0);
    if (!wireLeft && !wire.left) {
        errno = wireEnds == 2 ? ECONNRESET : EAGAIN;
        return wireEnds == 1 ? 0 : -1;
    }
    if (!wireLeft)
        wireLeft = fuzzTake(&wire);
    n = wireLeft < size ? wireLeft : size;
    if (!n) {
        errno = EAGAIN;
        return -1;
    }
    for (i = 0; i < n; i++)
        ((epicsUInt8 *)to)[i] = (epicsUInt8)fuzzTake(&wire);
    wireLeft -= n;
    return (ssize_t)n;
}

static ssize_t fuzzSend(int fd, const void *bytes, size_t size, int flags)
{
    (void)fd;
    (void)flags;
    fuzzCheck(bytes && size > 0 && size <= 260);
    return (ssize_t)(size > 3 ? size - 1 : size); /* in two parts */
}

/* Ready while there is something; else the time is over. */
static int fuzzPoll(struct pollfd *p, unsigned n, int ms)
{
    (void)p;
    (void)n;
    return wire.left || wireLeft || ms > 0 || wireEnds ? 1 : 0;
}

static int fuzzSocket(int domain, int type, int protocol)
{
    (void)domain;
    (void)type;
    (void)protocol;
    errno = EMFILE;
    return -1;
}

#define recv fuzzRecv
#define send fuzzSend
#define poll(p, n, ms) fuzzPoll(p, n, ms)
#define socket(domain, type, protocol) fuzzSocket(domain, type, protocol)
/* beside the library's own */
#define plcModbusSocketInit fuzzSocketInit
#define plcModbusSocketFree fuzzSocketFree
#define plcModbusSocketNext fuzzSocketNext
#define plcModbusSocketCut fuzzSocketCut
#define plcModbusSocketTake fuzzSocketTake
#define plcModbusSocketClose fuzzSocketClose
#define plcModbusSocketAsk fuzzSocketAsk
#define plcModbusSocketDrop fuzzSocketDrop
#include "plcModbusSocket.c"
#undef recv
#undef send
#undef poll
#undef socket

/* No descriptor of the system: closing it does nothing. */
enum { fuzzDescriptor = 1 << 20 };

enum { functionAt = plcFrameUnit + 1, lengthAt = 4 };

/* Requests as libmodbus makes them. */
static void ask(plcFrame *q, fuzzBytes *b)
{
    static const epicsUInt8 functions[] = {1, 2, 3, 4, 5, 6, 15, 16, 22};
    unsigned function = functions[fuzzTake(b) % sizeof(functions)], count, i;
    unsigned start = fuzzTake16(b);

    count = fuzzTake(b);
    count = function <= 2 ? 1 + count * 8 % 2000 : 1 + count % (function <= 4 ? 125 : 20);
    memset(q, 0, sizeof(*q));
    q->bytes[1] = (epicsUInt8)fuzzTake(b);
    q->bytes[functionAt] = (epicsUInt8)function;
    q->bytes[8] = (epicsUInt8)(start >> 8);
    q->bytes[9] = (epicsUInt8)start;
    q->bytes[10] = (epicsUInt8)(count >> 8);
    q->bytes[11] = (epicsUInt8)count;
    q->size = 12;
    if (function >= 15) {
        q->size = function == 22 ? 14 : 13 + (function == 15 ? (count + 7) / 8 : 2 * count);
        for (i = 12; i < q->size; i++)
            q->bytes[i] = (epicsUInt8)i;
    }
    q->bytes[lengthAt + 1] = (epicsUInt8)(q->size - plcFrameUnit);
}

static void checkGood(const plcFrame *q, const plcFrame *a)
{
    fuzzCheck(a->size >= 9 && a->size <= plcFrameMax);
    fuzzCheck(a->size == plcFrameUnit + plcFrameTransaction(a->bytes + lengthAt));
    fuzzCheck((a->bytes[functionAt] & 0x7f) == q->bytes[functionAt]);
    if (a->bytes[functionAt] & 0x80)
        fuzzCheck(a->size == 9 && a->bytes[8]);
    else if (q->bytes[functionAt] <= 4)
        fuzzCheck(a->size == 9u + a->bytes[8]);
    else
        fuzzCheck(a->bytes[8] == q->bytes[8] && a->bytes[9] == q->bytes[9]);
}

int fuzzModbusAnswer(const epicsUInt8 *data, size_t size)
{
    fuzzBytes b = {data, size};
    unsigned how = fuzzTake(&b), turns;
    plcModbusRequestOptions o = {.timeout = 0, .unit = 1, .anyUnit = how >> 2 & 1,
                                 .anyTransaction = how >> 3 & 1, .keepSilent = how >> 4 & 1,
                                 .rtu = how >> 5 & 1};
    epicsMutexId lock = epicsMutexMustCreate();
    plcModbusSocket s = {.rx = {.size = 0}};
    plcFrame q;

    plcModbusSocketInit(&s, lock);
    wireEnds = how % 3;
    wireLeft = 0;
    wire = (fuzzBytes){NULL, 0};
    for (turns = 0; b.left && turns < 8; turns++) {
        plcFrame *a = calloc(1, sizeof(*a));
        plcModbusResult x = {.lost = 0};
        int bad;

        s.fd = fuzzDescriptor;
        ask(&q, &b);
        wire = b; /* what comes from now on */
        bad = plcModbusSocketAsk(&s, &q, a, &o, &x);
        fuzzCheck(s.rx.size <= plcFrameMax && strlen(x.why) < sizeof(x.why));
        fuzzCheck(!bad || (x.lost && x.why[0]));
        if (!bad)
            checkGood(&q, a);
        b = wire;
        free(a);
        if (bad && !x.silent)
            break;
    }
    s.fd = -1;
    plcModbusSocketFree(&s);
    epicsMutexDestroy(lock);
    return 0;
}
