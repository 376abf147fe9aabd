/* plcSimTestModbusServer: the simulator's Modbus server over loopback: several clients,
 * half requests, garbage, a client that does not read, and each fault as the client sees
 * it.
 *
 * Server and clients share one thread: the loop runs for as long as a client waits.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcSimBuilt.h"
#include "plcSimClient.h"
#include "simModbusServer.h"

static plcSimBuilt built;
static simModbus *modbus; /* of its server */

static void setUp(const char *more)
{
    char text[500];

    snprintf(text, sizeof(text),
             "in = 8\nport = 0\nmodbus_port = 0\ndb 10 300\nperiod = 5 ms\n"
             "modbus holding 0 150 -> DB10.0\ninit DB10.DBW0 0x0102\n"
             "tx DB10.DBD0 -> 0\n%s",
             more);
    plcSimStart(&built, &clientLoop, text);
    modbus = &((simModbusServer *)simPlcServerOf(&built.plc, &simModbusServerType))->modbus;
}

static void tearDown(void)
{
    plcSimDismantle(&built);
    simLoopFree(&clientLoop);
}

/* ---- a client ---- */

static int openClient(void)
{
    return clientOpen(&modbus->clients);
}

/* Reads register 0. */
#define ASK "00 09 00 00 00 06 01 03 00 00 00 01"
#define TOLD "00 09 00 00 00 05 01 03 02 01 02"

static int works(int fd)
{
    clientSay(fd, ASK);
    return clientHears(fd, TOLD);
}

static int freshWorks(void)
{
    int fd = openClient();
    int good = works(fd);

    close(fd);
    return good;
}

static void fault(const char *line)
{
    char text[100], error[SIM_ERROR_SIZE];
    char *words[20];
    int count;

    strcpy(text, line);
    count = simSplit(text, words, 20, error);
    if (simModbusFaultParse(&modbus->faults, words, (size_t)count, error))
        testAbort("%s: %s", line, error);
}

/* ---- tests ---- */

static void testPieces(void)
{
    int fd = openClient();
    int i;

    for (i = 0; i < 12; i++) {
        char byte[3] = {ASK[3 * i], ASK[3 * i + 1], 0};

        clientSay(fd, byte);
        clientTurn();
    }
    testOk(clientHears(fd, TOLD), "a request in 12 pieces is answered");
    clientSay(fd, ASK " " ASK " 00 09");
    testOk(clientHears(fd, TOLD " " TOLD), "two requests at once are answered both");
    clientSay(fd, "00 00 00 06 01 03 00 00 00 01");
    testOk(clientHears(fd, TOLD), "and the third, whose rest comes later");
    clientSay(fd, "00 01 00 00 00 0b 01 10 00 00 00 02 04 11 12 13 14");
    testOk(clientHears(fd, "00 01 00 00 00 06 01 10 00 00 00 02"), "a write is answered");
    UNTIL(!memcmp(built.plc.tx->bytes, "\x11\x12\x13\x14", 4));
    testOk(!memcmp(built.plc.tx->bytes, "\x11\x12\x13\x14", 4), "and PACK_TX_DB sees it");
    memcpy(built.plc.memory.blocks[4]->bytes, "\x01\x02", 2);
    testOk(works(fd), "what the HMI sets is read");
    close(fd);
    UNTIL(modbus->clients.count == 0);
    testOk(modbus->clients.count == 0, "a client that has gone is forgotten");
}

static void testEnds(void)
{
    int fd = openClient();

    clientSay(fd, "47 45 54 20 2f 20 48 54 54 50");
    testOk(clientHearsEnd(fd) == ENDED, "garbage ends the connection");
    testOk(modbus->counts.garbage == 1, "and is counted");
    close(fd);

    fd = openClient();
    clientSay(fd, "00 09 00 00 00 06 01 03");
    UNTIL(modbus->clients.count == 1);
    close(fd);
    UNTIL(modbus->clients.count == 0);
    testOk(modbus->clients.count == 0, "half a request is forgotten with its client");

    fd = openClient();
    clientSay(fd, ASK);
    shutdown(fd, SHUT_WR);
    testOk(clientHears(fd, TOLD) && clientHearsEnd(fd) == ENDED,
           "a client that has closed its half gets its answer, then the end");
    close(fd);

    fd = openClient();
    clientSay(fd, "00 09 00 00 00 06 02 03 00 00 00 01 " ASK);
    testOk(clientHears(fd, TOLD), "another unit gets no answer");
    testOk(modbus->counts.otherUnit == 1, "and is counted");
    modbus->gateway = 1;
    clientSay(fd, "00 09 00 00 00 06 02 03 00 00 00 01");
    testOk(clientHears(fd, "00 09 00 00 00 03 02 83 0b"), "or exception 11");
    modbus->unit = -1;
    clientSay(fd, "00 09 00 00 00 06 ff 03 00 00 00 01");
    testOk(clientHears(fd, "00 09 00 00 00 05 ff 03 02 01 02"),
           "modbus_unit = any answers all");
    modbus->unit = 1;
    modbus->gateway = 0;
    close(fd);
}

static void testMany(void)
{
    int fds[SIM_MAX_CLIENTS];
    int good = 0;
    int extra, i;

    for (i = 0; i < SIM_MAX_CLIENTS; i++) {
        fds[i] = openClient();
        clientSay(fds[i], ASK);
    }
    for (i = SIM_MAX_CLIENTS; i-- > 0;)
        good += clientHears(fds[i], TOLD);
    testOk(good == 32 && SIM_MAX_CLIENTS == 32, "%d clients are served at a time", good);
    extra = openClient();
    testOk(clientHearsEnd(extra) == ENDED, "one more is sent away");
    close(extra);
    close(fds[3]);
    UNTIL(modbus->clients.count == SIM_MAX_CLIENTS - 1);
    fds[3] = openClient();
    testOk(works(fds[3]), "when one has gone, another is served");
    for (i = 0; i < SIM_MAX_CLIENTS; i++)
        close(fds[i]);
    UNTIL(modbus->clients.count == 0);
}

/* Sends requests until the server takes no more. Returns how many left. */
static long stuff(int fd)
{
    /* reads 125 registers: an answer of 259 bytes */
    static const epicsUInt8 ask[12] = {0, 9, 0, 0, 0, 6, 1, 3, 0, 0, 0, 125};
    unsigned long before;
    long bytes = 0;
    int quiet = 0;
    ssize_t n;

    while (quiet < 50) {
        before = (unsigned long)modbus->counts.requests;
        while ((n = send(fd, ask + bytes % 12, 12 - (size_t)(bytes % 12), MSG_NOSIGNAL)) >
               0)
            bytes += n;
        clientTurn();
        quiet = before == modbus->counts.requests ? quiet + 1 : 0;
    }
    return bytes / 12;
}

/* Bytes that wait for the client for which most do. */
static size_t largestQueue(void)
{
    size_t most = 0;
    int i;

    for (i = 0; i < SIM_MAX_CLIENTS; i++)
        if (modbus->clients.list[i] && modbus->clients.list[i]->queued > most)
            most = modbus->clients.list[i]->queued;
    return most;
}

static void testDeaf(void)
{
    int deaf = openClient(), other = openClient();
    epicsUInt8 answer[259];
    epicsUInt64 blocks;
    long asked, heard = 0;
    size_t waits;

    asked = stuff(deaf);
    testOk((long)modbus->counts.requests < asked,
           "of %ld requests whose answers are not read, only %lu are taken", asked,
           (unsigned long)modbus->counts.requests);
    waits = largestQueue();
    testOk(waits >= 65536 && waits < 65536 + modbus->clients.inboxSize / 12 * 259,
           "when 64 KiB wait nothing more is read, what was read is answered: %lu bytes",
           (unsigned long)waits);
    testOk(works(other), "another client is served all the same");
    blocks = built.plc.block;
    UNTIL(built.plc.block > blocks + 3);
    testOk(built.plc.block > blocks + 3, "and blocks go on");
    while (heard < asked && clientHear(deaf, answer, 259) == 259 && answer[7] == 3)
        heard++;
    testOk(heard == asked, "when it reads, it gets all its answers (%ld)", heard);
    testOk(works(deaf), "and is served again");
    close(deaf);
    close(other);
    UNTIL(modbus->clients.count == 0);
}

static void testFaults(void)
{
    epicsUInt8 bytes[300];
    char line[40], wanted[40];
    double start;
    int fd = openClient();
    int code;

    for (code = 1; code <= 11; code++) {
        snprintf(line, sizeof(line), "exception %d next 1", code);
        snprintf(wanted, sizeof(wanted), "00 09 00 00 00 03 01 83 %02x", (unsigned)code);
        fault(line);
        clientSay(fd, ASK);
        testOk(clientHears(fd, wanted), "exception %d", code);
    }
    testOk(works(fd), "next 1: then it works again");
    fault("exception 2 holding 1 write");
    clientSay(fd, "00 01 00 00 00 0b 01 10 00 00 00 02 04 21 22 23 24");
    testOk(clientHears(fd, "00 01 00 00 00 03 01 90 02"), "a write that is refused");
    testOk(works(fd), "has written nothing");
    fault("exception off");

    fault("slow 60 next 1");
    start = simNow();
    clientSay(fd, ASK " " ASK);
    testOk(clientHears(fd, TOLD " " TOLD) && simNow() - start >= 0.06,
           "slow: not before its time, and the next one waits behind it");
    fault("wrongid next 1");
    clientSay(fd, ASK);
    testOk(clientHears(fd, "00 08 00 00 00 05 01 03 02 01 02"), "another transaction id");
    fault("wrongunit next 1");
    clientSay(fd, ASK);
    testOk(clientHears(fd, "00 09 00 00 00 05 00 03 02 01 02"), "another unit");
    fault("silent next 2");
    clientSay(fd, "00 01 00 00 00 06 01 06 00 00 77 77 " ASK " " ASK);
    testOk(clientHears(fd, TOLD), "silent: two get no answer, and are not done");
    testOk(modbus->counts.silent == 2, "which is counted");
    fault("garbage 20 next 1");
    clientSay(fd, ASK);
    testOk(clientHear(fd, bytes, 20) == 20 && works(fd), "20 bytes of garbage");

    fault("short 9 next 1");
    clientSay(fd, ASK " " ASK);
    testOk(clientHears(fd, "00 09 00 00 00 05 01 03 02"), "short: 9 bytes");
    UNTIL(modbus->counts.silent == 3);
    testOk(modbus->counts.silent == 3 && recv(fd, bytes, 1, MSG_DONTWAIT) < 0,
           "then nothing more on this connection");
    testOk(freshWorks(), "a new one works");
    close(fd);

    fd = openClient();
    fault("short 3 close next 1");
    clientSay(fd, ASK " " ASK);
    testOk(clientHear(fd, bytes, 99) == 3 && clientHearsEnd(fd) == ENDED,
           "3 bytes, then the end");
    close(fd);
    fd = openClient();
    fault("short 0 close next 1");
    clientSay(fd, ASK);
    testOk(clientHearsEnd(fd) == ENDED, "the end instead of an answer");
    close(fd);
    fd = openClient();
    fault("close reply next 1");
    clientSay(fd, "00 01 00 00 00 06 01 06 00 00 01 02");
    testOk(clientHear(fd, bytes, 99) == 6 && clientHearsEnd(fd) == ENDED,
           "half an answer, then the end");
    close(fd);
    testOk(freshWorks() && modbus->faults.count == 0, "all faults are used up");
}

static void testPower(void)
{
    int fd = openClient();
    int late, n;

    works(fd);
    simClientsDrop(&modbus->clients, 0, "test");
    testOk(clientHearsEnd(fd) == ENDED, "close");
    close(fd);
    fd = openClient();
    works(fd);
    simClientsDrop(&modbus->clients, 1, "test");
    testOk(clientHearsEnd(fd) == WAS_RESET, "reset");
    close(fd);

    fd = openClient();
    works(fd);
    simClientsUnplug(&modbus->clients, 1);
    clientSay(fd, ASK);
    late = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    n = connect(late, (struct sockaddr *)&modbus->clients.listener.address,
                sizeof(modbus->clients.listener.address));
    testOk(n < 0 && errno == EINPROGRESS, "unplugged: a new connection gets no answer");
    close(late);
    for (n = 0; n < 10; n++)
        clientTurn();
    testOk(recv(fd, &n, 1, MSG_DONTWAIT) < 0 && errno == EAGAIN, "nor does a request");
    simClientsUnplug(&modbus->clients, 0);
    testOk(clientHears(fd, TOLD), "plugged: it does");
    testOk(freshWorks(), "and new connections come through");

    simPlcRestart(&built.plc, 0.01, 0);
    testOk(clientHearsEnd(fd) == WAS_RESET, "a restart resets the connection");
    UNTIL(!built.plc.off);
    testOk(freshWorks(), "and then the PLC is there again, at its port");
    close(fd);
    simClientsRefuse(&modbus->clients, 1);
    late = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    n = connect(late, (struct sockaddr *)&modbus->clients.listener.address,
                sizeof(modbus->clients.listener.address));
    testOk(n < 0 && errno == ECONNREFUSED, "refuse");
    close(late);
    simClientsRefuse(&modbus->clients, 0);
    testOk(freshWorks(), "refuse off");
}

static void testStatus(void)
{
    simText out = {NULL, 0, 0};
    int fd = openClient();

    simModbusClearCounts(modbus);
    works(fd);
    clientSay(
        fd, "00 01 00 00 00 06 01 03 00 00 00 7e 00 02 00 00 00 0b 01 10 00 00 00 02 04 "
            "01 02 "
            "03 04");
    clientHears(fd, "00 01 00 00 00 03 01 83 03 00 02 00 00 00 06 01 10 00 00 00 02");
    simModbusStatus(modbus, &out);
    testOk(strstr(out.text, "modbus areas: holding=0..149@DB10.0\n") != NULL, "areas");
    testOk(strstr(out.text, "modbus requests: total=3 answered=3 silent=0 other_unit=0 "
                            "garbage=0 fc3=2 fc16=1\n") != NULL,
           "requests");
    testOk(strstr(out.text, "ex2=0 ex3=1 ex4=0") && strstr(out.text, "ex11=0 fc3=1\n"),
           "exceptions");
    testOk(strstr(out.text, "modbus largest: read_registers=126 read_bits=0 "
                            "write_registers=2 write_bits=0\n") != NULL,
           "the largest requests");
    testOk(strstr(out.text, "modbus faults: none\n") != NULL, "faults");
    simTextFree(&out);
    simModbusReceived(modbus, 2, &out);
    testOk(strstr(out.text, "2 time=") == out.text &&
               strstr(out.text,
                      "fc=3 read=holding,0,126 answer=exception3 pdu=03 00 00 00 7e\n"),
           "a request that was refused");
    testOk(strstr(out.text,
                  "fc=16 write=holding,0,2 answer=ok pdu=10 00 00 00 02 04 01 02 03 "
                  "04\n") != NULL,
           "and one that was served");
    simTextFree(&out);
    close(fd);
}

MAIN(plcSimTestModbusServer)
{
    testPlan(68);
    simLogQuiet(2);
    setUp("rcvbuf = 4096\n");
    testPieces();
    testEnds();
    testMany();
    testDeaf();
    testFaults();
    testPower();
    testStatus();
    tearDown();
    return testDone();
}
