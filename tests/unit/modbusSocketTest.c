/* The socket of a Modbus PLC, whose other end the test holds: bytes that nobody asked for, and a PLC
 * that takes none. Requests and answers are in modbusTest.c. */
#include <string.h>
#include <unistd.h>

#include <sys/socket.h>

#include <epicsMutex.h>
#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcModbusSocket.h"

static plcModbusSocket s;
static int plc; /* its end */
static const plcModbusRequestOptions options = {.timeout = 20, .unit = 1};

static void begin(void)
{
    int fds[2];

    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK, 0, fds))
        testAbort("no pair of sockets");
    plcModbusSocketInit(&s, epicsMutexMustCreate());
    plc = fds[1];
    plcModbusSocketNext(&s, fds[0]);
    plcModbusSocketTake(&s);
}

static void end(void)
{
    close(plc);
    plcModbusSocketFree(&s);
    epicsMutexDestroy(s.lock);
}

/* What the PLC sends while nobody asks. */
static const struct {
    const char *what, *bytes;
    size_t size;
    const char *why; /* NULL: no fault */
} unasked[] = {
    {"nothing", "", 0, NULL},
    {"the beginning of an answer", "\0", 1, NULL},
    {"an answer to no request", "\x12\x34\0\0\0\3\1\x83\2", 9, "PLC sends what was not asked for"},
    {"no Modbus/TCP", "HTTP/1.1 400 Bad Request", 24, "PLC sends what was not asked for"},
};

static void testUnasked(void)
{
    size_t i;

    for (i = 0; i < sizeof(unasked) / sizeof(unasked[0]); i++) {
        plcModbusResult x = {.lost = 0};
        int status;

        begin();
        if (send(plc, unasked[i].bytes, unasked[i].size, 0) != (ssize_t)unasked[i].size)
            testAbort("cannot send");
        status = plcModbusSocketDrop(&s, &options, &x);
        testOk(unasked[i].why ? status == -1 && strcmp(x.why, unasked[i].why) == 0 : status == 0,
               "while nobody asks, %s: %s", unasked[i].what, status ? x.why : "good");
        end();
    }
}

/* Its buffers are full: it has read nothing for long. */
static void testFull(void)
{
    static const char junk[4096];
    plcFrame request = {.size = 12, .bytes = {0, 1, 0, 0, 0, 6, 1, 3, 0, 0, 0, 1}}, answer;
    plcModbusResult x = {.lost = 0};

    begin();
    while (send(s.fd, junk, sizeof(junk), MSG_DONTWAIT) > 0) {
    }
    testOk(plcModbusSocketAsk(&s, &request, &answer, &options, &x) == -1 && x.lost &&
               strcmp(x.why, "PLC takes no request for 20 ms") == 0,
           "a PLC that reads nothing: %s", x.why);
    end();
}

MAIN(modbusSocketTest)
{
    testPlan(5);
    testUnasked();
    testFull();
    return testDone();
}
