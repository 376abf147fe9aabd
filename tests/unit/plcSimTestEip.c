/* plcSimTestEip: the simulator's EtherNet/IP without a network: requests and answers by
 * literal bytes, connections with a given time, and which faults meet which requests.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <epicsUnitTest.h>
#include <testMain.h>

#include "plcSimBuilt.h"
#include "simEipServer.h"

static simLoop loop;
static plcSimBuilt built;
static simEipController *c; /* of its server */

static int build(const char *text)
{
    int errors = plcSimBuild(&built, &loop, text);
    simEipServer *server = simPlcServerOf(&built.plc, &simEipServerType);

    c = &server->eip.controller;
    return errors;
}

static void dismantle(void)
{
    plcSimDismantle(&built);
}

#define ON "port = off\nbyteorder = little\netherip_port = 0\n"

/* ---- requests and answers ---- */

static size_t parseHex(const char *hex, epicsUInt8 *bytes)
{
    size_t count = 0;
    unsigned value;
    int used;

    for (; sscanf(hex, " %2x%n", &value, &used) == 1; hex += used)
        bytes[count++] = (epicsUInt8)value;
    return count;
}

/* Compares with ## for any byte. */
static int fits(const char *answer, const char *pattern)
{
    for (; *pattern && (*pattern == '#' || *pattern == *answer); pattern++, answer++)
        ;
    return !*pattern && !*answer;
}

static const simEipOrigin connected = {.client = 1, .now = 100, .connected = 1};
static const simEipOrigin direct = {.client = 1, .now = 100};

/* Serves a request; a row: the answer must be these bytes. */
static void row(const simEipOrigin *origin, size_t limit, const char *what,
                const char *request, const char *answer)
{
    epicsUInt8 in[1000], out[SIM_EIP_ANSWER];
    simText text = {NULL, 0, 0};
    size_t size = simEipServe(c, origin, in, parseHex(request, in), out, limit);
    int ok;

    simTextHex(&text, out, size);
    ok = size <= limit && fits(text.text, answer);
    testOk(ok, "%s", what);
    if (!ok)
        testDiag("answer is %s", text.text);
    simTextFree(&text);
}

/* Ids: four entries that are no tags come first, so D is 11, B 15, I 19 and so on. */
static const char plant[] = ON "db 10 8\n"
                               "udt Pair A:INT Ok:BOOL Fine:BOOL\n"
                               "tag D DINT = 0x11223344\n"
                               "tag B BOOL = 1\n"
                               "tag I INT[10] = 1 2 3 4 5 6 7 8 9 10\n"
                               "tag R REAL = 1.5\n"
                               "tag T STRING = ab\n"
                               "tag P Pair[2]\n"
                               "tag X DINT[2,3] = 0 1 2 10 11 12\n"
                               "tag RO INT readonly = 5\n"
                               "tag HI INT hidden\n"
                               "tag Program:Main.Z SINT = -1\n"
                               "tag M INT[4] -> DB10.0\n"
                               "tag Bits BOOL[64]\n";

#define D "91 01 44 00 "
#define B "91 01 42 00 "
#define I "91 01 49 00 "
#define R "91 01 52 00 "
#define P "91 01 50 00 "
#define X "91 01 58 00 "
#define LIMIT 500

/* In their order, each on what the ones before have left. */
/* clang-format off */
static const struct {
    const char *what, *request, *answer;
} served[] = {
    {"a DINT", "4c 02 " D "01 00", "cc 00 00 00 c4 00 44 33 22 11"},
    {"in other letters", "4c 02 91 01 64 00 01 00", "cc 00 00 00 c4 00 44 33 22 11"},
    {"by its instance", "4c 02 20 6b 24 11 01 00", "cc 00 00 00 c4 00 44 33 22 11"},
    {"by its instance in 16 bits", "4c 03 20 6b 25 00 11 00 01 00",
     "cc 00 00 00 c4 00 44 33 22 11"},
    {"a BOOL", "4c 02 " B "01 00", "cc 00 00 00 c1 00 01"},
    {"a REAL", "4c 02 " R "01 00", "cc 00 00 00 ca 00 00 00 c0 3f"},
    {"an array from its start", "4c 02 " I "02 00", "cc 00 00 00 c3 00 01 00 02 00"},
    {"two elements of it", "4c 03 " I "28 03 02 00", "cc 00 00 00 c3 00 04 00 05 00"},
    {"an element in 16 bits", "4c 04 " I "29 00 03 00 01 00",
     "cc 00 00 00 c3 00 04 00"},
    {"an element in 32 bits", "4c 05 " I "2a 00 03 00 00 00 01 00",
     "cc 00 00 00 c3 00 04 00"},
    {"an element by instance", "4c 03 20 6b 24 19 28 09 01 00",
     "cc 00 00 00 c3 00 0a 00"},
    {"one element too many", "4c 03 " I "28 08 03 00", "cc 00 ff 01 05 21"},
    {"no element", "4c 02 " I "00 00", "cc 00 ff 01 05 21"},
    {"an element that is not there", "4c 03 " I "28 0a 01 00", "cc 00 05 00"},
    {"an element of a scalar", "4c 03 " D "28 00 01 00", "cc 00 05 00"},
    {"two dimensions", "4c 04 " X "28 01 28 01 02 00",
     "cc 00 00 00 c4 00 0b 00 00 00 0c 00 00 00"},
    {"one index of two", "4c 03 " X "28 01 01 00", "cc 00 05 00"},
    {"three indices of two", "4c 05 " X "28 01 28 01 28 00 01 00", "cc 00 05 00"},
    {"an index beyond its dimension", "4c 04 " X "28 00 28 03 01 00", "cc 00 05 00"},
    {"in a program", "4c 09 91 0c 50 72 6f 67 72 61 6d 3a 4d 61 69 6e 91 01 5a 00 "
     "01 00", "cc 00 00 00 c2 00 ff"},
    {"by its instance in the program", "4c 09 91 0c 50 72 6f 67 72 61 6d 3a 4d 61 69 6e "
     "20 6b 24 39 01 00", "cc 00 00 00 c2 00 ff"},
    {"by that instance outside of it", "4c 02 20 6b 24 39 01 00", "cc 00 05 00"},
    {"by a controller's instance in it", "4c 09 91 0c 50 72 6f 67 72 61 6d 3a 4d 61 69 "
     "6e 20 6b 24 11 01 00", "cc 00 05 00"},
    {"a tag of a program without it", "4c 02 91 01 5a 00 01 00", "cc 00 04 00"},
    {"a program alone", "4c 07 91 0c 50 72 6f 67 72 61 6d 3a 4d 61 69 6e 01 00",
     "cc 00 04 00"},
    {"a name that is not there", "4c 02 91 01 51 00 01 00", "cc 00 04 00"},
    {"an instance that is not there", "4c 02 20 6b 24 12 01 00", "cc 00 05 00"},
    {"an entry that is no tag", "4c 02 20 6b 24 01 01 00", "cc 00 05 00"},
    {"a member of a DINT", "4c 04 " D "91 01 41 00 01 00", "cc 00 05 00"},
    {"a member", "4c 05 " P "28 01 91 01 41 00 01 00", "cc 00 00 00 c3 00 00 00"},
    {"a member that is not there", "4c 05 " P "28 01 91 01 42 00 01 00", "cc 00 05 00"},
    {"a member of a whole array", "4c 04 " P "91 01 41 00 01 00", "cc 00 05 00"},
    {"a symbol that is cut", "4c 01 91 05 01 00", "cc 00 04 00"},
    {"a segment of no kind", "4c 01 60 00 01 00", "cc 00 04 00"},
    {"a path that is longer than the request", "4c 09 " D "01 00", "cc 00 26 00"},
    {"no path", "4c 00 01 00", "cc 00 04 00"},
    {"half a count", "4c 02 " D "01", "cc 00 13 00"},
    {"a byte too many", "4c 02 " D "01 00 00", "cc 00 15 00"},
    {"one byte", "4c", "80 00 13 00"},
    {"a service that is not known", "4b 02 " D "01 00", "cb 00 08 00"},

    {"a fragment", "52 02 " I "0a 00 10 00 00 00", "d2 00 00 00 c3 00 09 00 0a 00"},
    {"its offset counts from the element", "52 03 " I "28 08 02 00 02 00 00 00",
     "d2 00 00 00 c3 00 0a 00"},
    {"at the end", "52 02 " I "0a 00 14 00 00 00", "d2 00 ff 01 05 21"},
    {"between two elements", "52 02 " I "0a 00 03 00 00 00", "d2 00 ff 01 04 21"},
    {"without an offset", "52 02 " I "0a 00", "d2 00 13 00"},

    {"write a DINT", "4d 02 " D "c4 00 01 00 01 02 03 04", "cd 00 00 00"},
    {"it is there", "4c 02 " D "01 00", "cc 00 00 00 c4 00 01 02 03 04"},
    {"of another type", "4d 02 " D "c3 00 01 00 01 02", "cd 00 ff 01 07 21"},
    {"a structure's type", "4d 02 " D "a0 02 ce 0f 01 00 01 02 03 04",
     "cd 00 ff 01 07 21"},
    {"too few bytes", "4d 02 " D "c4 00 01 00 01 02 03", "cd 00 13 00"},
    {"no count", "4d 02 " D "c4 00 01", "cd 00 13 00"},
    {"no type", "4d 02 " D "c4", "cd 00 13 00"},
    {"bytes behind the data", "4d 02 " D "c4 00 01 00 05 00 00 00 ff", "cd 00 00 00"},
    {"write elements", "4d 03 " I "28 08 c3 00 02 00 88 00 99 00", "cd 00 00 00"},
    {"they are there", "4c 03 " I "28 07 03 00",
     "cc 00 00 00 c3 00 08 00 88 00 99 00"},
    {"one too many", "4d 03 " I "28 09 c3 00 02 00 88 00 99 00", "cd 00 ff 01 05 21"},
    {"write a BOOL", "4d 02 " B "c1 00 01 00 00", "cd 00 00 00"},
    {"it is false", "4c 02 " B "01 00", "cc 00 00 00 c1 00 00"},
    {"any value but 0", "4d 02 " B "c1 00 01 00 80", "cd 00 00 00"},
    {"is true", "4c 02 " B "01 00", "cc 00 00 00 c1 00 01"},
    {"a BOOL in a structure", "4d 06 " P "28 00 91 04 46 69 6e 65 c1 00 01 00 ff",
     "cd 00 00 00"},
    {"is bit 1 of the hidden SINT", "4c 03 " P "28 00 01 00",
     "cc 00 00 00 a0 02 ## ## 00 00 02 00"},
    {"a tag in PLC memory", "4d 02 91 01 4d 00 c3 00 02 00 11 22 33 44", "cd 00 00 00"},
    {"a tag that is read only", "4d 02 91 02 52 4f c3 00 01 00 00 00", "cd 00 0f 00"},
    {"is read", "4c 02 91 02 52 4f 01 00", "cc 00 00 00 c3 00 05 00"},
    {"a hidden tag", "4c 02 91 02 48 49 01 00", "cc 00 0f 00"},

    {"write a fragment", "53 02 " I "c3 00 0a 00 02 00 00 00 77 00", "d3 00 00 00"},
    {"it is there too", "4c 02 " I "02 00", "cc 00 00 00 c3 00 01 00 77 00"},
    {"a fragment behind the end", "53 02 " I "c3 00 0a 00 14 00 00 00 77 00",
     "d3 00 ff 01 04 21"},
    {"a fragment over the end", "53 02 " I "c3 00 0a 00 12 00 00 00 77 00 78 00",
     "d3 00 ff 01 05 21"},
    {"a fragment of nothing", "53 02 " I "c3 00 0a 00 00 00 00 00", "d3 00 13 00"},

    {"set bits", "4e 02 " D "04 00 02 01 00 00 ff ff ff fe", "ce 00 00 00"},
    {"(5 or 0102) and feffffff", "4c 02 " D "01 00", "cc 00 00 00 c4 00 07 01 00 00"},
    {"clear a bit", "4e 02 " D "04 00 00 00 00 00 fe ff ff ff", "ce 00 00 00"},
    {"is 0106", "4c 02 " D "01 00", "cc 00 00 00 c4 00 06 01 00 00"},
    {"the mask of another size", "4e 02 " D "02 00 01 00 ff ff", "ce 00 03 00"},
    {"a mask that is too short", "4e 02 " D "04 00 01 00 00 00 ff ff ff",
     "ce 00 13 00"},
    {"bits of a REAL", "4e 02 " R "04 00 01 00 00 00 ff ff ff ff", "ce 00 ff 01 07 21"},
    {"a bit in an array of BOOL",
     "4e 04 91 04 42 69 74 73 28 01 04 00 20 00 00 00 ff ff ff ff", "ce 00 00 00"},
    {"is bit 5 of its second word", "4c 03 91 04 42 69 74 73 02 00",
     "cc 00 00 00 d3 00 00 00 00 00 20 00 00 00"},

    {"three in a packet",
     "0a 02 20 02 24 01 03 00 08 00 10 00 18 00 4c 02 " D "01 00 4c 02 91 01 51 00 01 00 "
     "4c 02 " B "01 00",
     "8a 00 1e 00 03 00 08 00 12 00 16 00 cc 00 00 00 c4 00 06 01 00 00 cc 00 04 00 "
     "cc 00 00 00 c1 00 01"},
    {"all good: no 1e", "0a 02 20 02 24 01 01 00 04 00 4c 02 " B "01 00",
     "8a 00 00 00 01 00 04 00 cc 00 00 00 c1 00 01"},
    {"a packet in a packet",
     "0a 02 20 02 24 01 01 00 04 00 0a 02 20 02 24 01 01 00 04 00 4c 02 " B "01 00",
     "8a 00 1e 00 01 00 04 00 8a 00 08 00"},
    {"an empty packet", "0a 02 20 02 24 01 00 00", "8a 00 13 00"},
    {"an offset behind the end", "0a 02 20 02 24 01 01 00 40 00 4c 02 " B "01 00",
     "8a 00 03 00"},
    {"offsets that go back",
     "0a 02 20 02 24 01 02 00 0e 00 06 00 4c 02 " B "01 00 4c 02 " B "01 00",
     "8a 00 03 00"},

    {"identity: vendor", "0e 03 20 01 24 01 30 01", "8e 00 00 00 01 00"},
    {"identity: an attribute that is not there", "0e 03 20 01 24 01 30 63",
     "8e 00 14 00"},
    {"identity: name", "0e 03 20 01 24 01 30 07",
     "8e 00 00 00 0b 31 37 35 36 2d 4c 38 33 45 2f 42"},
    {"a class that is not there", "0e 03 20 f6 24 01 30 01", "8e 00 05 00"},
    {"what changes with a download", "03 02 20 ac 24 01 02 00 01 00 03 00",
     "83 00 00 00 02 00 01 00 00 00 05 00 03 00 00 00 00 10 00 00"},
    {"symbols from 11 on, names", "55 02 20 6b 24 3d 01 00 01 00",
     "d5 00 00 00 3d 00 00 00 01 00 4d 41 00 00 00 04 00 42 69 74 73"},
    {"types and dimensions", "55 02 20 6b 24 3d 02 00 02 00 08 00",
     "d5 00 00 00 3d 00 00 00 c3 20 04 00 00 00 00 00 00 00 00 00 00 00 41 00 00 00 d3 "
     "20 02 00 00 00 00 00 00 00 00 00 00 00"},
    {"symbols of a program",
     "55 09 91 0c 50 72 6f 67 72 61 6d 3a 4d 61 69 6e 20 6b 24 00 02 00 01 00 0a 00",
     "d5 00 00 00 39 00 00 00 01 00 5a 00"},
    {"one symbol", "03 02 20 6b 24 2d 02 00 01 00 0a 00",
     "83 00 00 00 02 00 01 00 00 00 02 00 52 4f 0a 00 00 00 02"},
    {"the template of STRING", "03 03 20 6c 25 00 ce 0f 02 00 05 00 01 00",
     "83 00 00 00 02 00 05 00 00 00 58 00 00 00 01 00 00 00 ce 0f"},
    {"its members", "4c 03 20 6c 25 00 ce 0f 00 00 00 00 10 00",
     "cc 00 00 00 00 00 c4 00 00 00 00 00 52 00 c2 20 04 00 00 00"},
    {"the template of TIMER", "03 03 20 6c 25 00 83 0f 04 00 04 00 05 00 02 00 01 00",
     "83 00 00 00 04 00 04 00 00 00 19 00 00 00 05 00 00 00 0c 00 00 00 02 00 00 00 06 00 "
     "01 00 00 00 83 0f"},
    {"its bit TT is bit 6 of byte 3", "4c 03 20 6c 25 00 83 0f 20 00 00 00 08 00",
     "cc 00 00 00 06 00 c1 00 03 00 00 00"},
    {"a template that is not there", "03 03 20 6c 25 00 00 02 01 00 01 00",
     "83 00 05 00"},
    {"Unconnected_Send in a connection", "52 02 20 06 24 01 0a f0 02 00 4c 00 01 00 01 00",
     "d2 00 08 00"},
};
/* clang-format on */

static void testServed(void)
{
    size_t i;

    testOk(build(plant) == 0, "a plant: %s", built.messages.text ? built.messages.text : "built");
    for (i = 0; i < sizeof(served) / sizeof(served[0]); i++)
        row(&connected, LIMIT, served[i].what, served[i].request, served[i].answer);
    testOk(!memcmp(simMemoryFind(&built.plc.memory, SIM_AREA_DB, 10)->bytes, "\x11\x22\x33\x44",
                   4),
           "what was written to a tag in PLC memory is in its data block");
    dismantle();
}

/* ---- what does not fit ---- */

#define PACKET "0a 02 20 02 24 01 02 00 06 00 0e 00 "

/* clang-format off */
static const struct {
    const char *what;
    size_t limit;
    const char *request, *answer;
} limited[] = {
    {"an array that fits", 26, "4c 02 " I "0a 00",
     "cc 00 00 00 c3 00 01 00 02 00 03 00 04 00 05 00 06 00 07 00 08 00 09 00 0a 00"},
    {"one byte less: 06 and nine elements", 25, "4c 02 " I "0a 00",
     "cc 00 06 00 c3 00 01 00 02 00 03 00 04 00 05 00 06 00 07 00 08 00 09 00"},
    {"a fragment in the same way", 11, "52 02 " I "0a 00 04 00 00 00",
     "d2 00 06 00 c3 00 03 00 04 00"},
    {"a structure larger than an answer is cut at words", 15, "4c 02 91 01 54 00 01 00",
     "cc 00 06 00 a0 02 ce 0f 02 00 00 00"},
    {"no room for one element", 7, "4c 02 " I "01 00", "cc 00 06 00"},
    {"two in a packet", 62, PACKET "4c 02 " I "0a 00 4c 02 " I "0a 00",
     "8a 00 00 00 02 00 06 00 20 00 "
     "cc 00 00 00 c3 00 01 00 02 00 03 00 04 00 05 00 06 00 07 00 08 00 09 00 0a 00 "
     "cc 00 00 00 c3 00 01 00 02 00 03 00 04 00 05 00 06 00 07 00 08 00 09 00 0a 00"},
    {"the second is cut: 1e and its 06", 46, PACKET "4c 02 " I "0a 00 4c 02 " I "0a 00",
     "8a 00 1e 00 02 00 06 00 20 00 "
     "cc 00 00 00 c3 00 01 00 02 00 03 00 04 00 05 00 06 00 07 00 08 00 09 00 0a 00 "
     "cc 00 06 00 c3 00 01 00 02 00"},
    {"no room for the second: 06 alone", 40, PACKET "4c 02 " I "0a 00 4c 02 " I "0a 00",
     "8a 00 1e 00 02 00 06 00 20 00 "
     "cc 00 00 00 c3 00 01 00 02 00 03 00 04 00 05 00 06 00 07 00 08 00 09 00 0a 00 "
     "cc 00 06 00"},
    {"the first leaves room for the status of the second", 36,
     PACKET "4c 02 " I "0a 00 4c 02 " I "0a 00",
     "8a 00 1e 00 02 00 06 00 1c 00 "
     "cc 00 06 00 c3 00 01 00 02 00 03 00 04 00 05 00 06 00 07 00 08 00 "
     "cc 00 06 00"},
    {"not even for two statuses", 17, PACKET "4c 02 " I "0a 00 4c 02 " I "0a 00",
     "8a 00 11 00"},
    {"an attribute that does not fit", 10, "0e 03 20 01 24 01 30 07", "8e 00 11 00"},
    {"a list that is cut within the dimensions of its second tag", 32,
     "55 02 20 6b 24 3d 02 00 02 00 08 00",
     "d5 00 06 00 3d 00 00 00 c3 20 04 00 00 00 00 00 00 00 00 00 00 00"},
    {"the list of symbols: 06, go on at the last id + 1", 17,
     "55 02 20 6b 24 3d 01 00 01 00", "d5 00 06 00 3d 00 00 00 01 00 4d"},
};
/* clang-format on */

static void testLimits(void)
{
    size_t i;

    build(plant);
    for (i = 0; i < sizeof(limited) / sizeof(limited[0]); i++)
        row(&connected, limited[i].limit, limited[i].what, limited[i].request,
            limited[i].answer);
    dismantle();
}

/* ---- without a connection ---- */

#define SEND "52 02 20 06 24 01 0a f0 "

/* clang-format off */
static const struct {
    const char *what, *request, *answer;
} unconnected[] = {
    {"a request as it is", "4c 02 " B "01 00", "cc 00 00 00 c1 00 01"},
    {"to slot 0", SEND "08 00 4c 02 " B "01 00 01 00 01 00", "cc 00 00 00 c1 00 01"},
    {"with a pad behind an odd length", SEND "07 00 4c 02 " B "01 00 01 00 01 00",
     "cc 00 13 00"},
    {"to slot 3", SEND "08 00 4c 02 " B "01 00 01 00 01 03", "d2 00 01 01 12 03"},
    {"to another port", SEND "08 00 4c 02 " B "01 00 01 00 02 00", "d2 00 01 01 11 03"},
    {"nowhere", SEND "08 00 4c 02 " B "01 00 00 00", "d2 00 01 01 15 03"},
    {"further than the CPU", SEND "08 00 4c 02 " B "01 00 02 00 01 00 01 00",
     "d2 00 01 01 15 03"},
    {"longer than it is", SEND "40 00 4c 02 " B "01 00 01 00 01 00", "d2 00 13 00"},
    {"a route longer than it is", SEND "08 00 4c 02 " B "01 00 02 00 01 00",
     "d2 00 13 00"},
    {"bytes behind the route", SEND "08 00 4c 02 " B "01 00 01 00 01 00 00",
     "d2 00 15 00"},
    {"nothing in it", SEND, "d2 00 13 00"},
    {"one in another",
     SEND "16 00 " SEND "08 00 4c 02 " B "01 00 01 00 01 00 01 00 01 00", "d2 00 08 00"},
    {"class 06 has no other services", "4c 02 20 06 24 01 01 00", "cc 00 08 00"},
    {"nor another instance", "54 02 20 06 24 02", "d4 00 05 00"},
};
/* clang-format on */

static void testUnconnected(void)
{
    size_t i;

    build(plant);
    for (i = 0; i < sizeof(unconnected) / sizeof(unconnected[0]); i++)
        row(&direct, SIM_EIP_UNCONNECTED, unconnected[i].what, unconnected[i].request,
            unconnected[i].answer);
    dismantle();
}

/* ---- connections ---- */

#define HEAD "0a 0e 00 00 00 00 44 33 22 11 " /* ticks, ids */
#define TRIAD "01 00 37 13 2a 00 00 00 "
#define SECOND "40 42 0f 00 "         /* RPI */
#define ROUTER "03 01 00 20 02 24 01" /* words, backplane, slot 0, router */
#define OPEN "54 02 20 06 24 01 "
#define LARGE "5b 02 20 06 24 01 "
#define ECHO "01 00 37 13 2a 00 00 00 00 00" /* behind a refusal */
#define TAIL "44 33 22 11 01 00 37 13 2a 00 00 00 40 42 0f 00 40 42 0f 00 00 00"

/* clang-format off */
static const struct {
    const char *what, *request, *answer;
} opens[] = {
    {"511 bytes and 500", OPEN HEAD TRIAD "01 00 00 00 " SECOND "ff 43 " SECOND "f4 43 a3 "
     ROUTER, "d4 00 00 00 ## ## ## ## " TAIL},
    {"the same triad again", OPEN HEAD TRIAD "01 00 00 00 " SECOND "f4 43 " SECOND
     "f4 43 a3 " ROUTER, "d4 00 01 01 00 01 " ECHO},
    {"close it", "4e 02 20 06 24 01 0a 0e " TRIAD "03 00 01 00 20 02 24 01",
     "ce 00 00 00 01 00 37 13 2a 00 00 00 00 00"},
    {"close it again", "4e 02 20 06 24 01 0a 0e " TRIAD "03 00 01 00 20 02 24 01",
     "ce 00 01 01 07 01 01 00 37 13 2a 00 00 00 00 00"},
    {"half a close", "4e 02 20 06 24 01 0a 0e " TRIAD "03", "ce 00 13 00"},
    {"4002 bytes", LARGE HEAD TRIAD "01 00 00 00 " SECOND "a2 0f 00 42 " SECOND
     "a2 0f 00 42 a3 " ROUTER, "db 00 00 00 ## ## ## ## " TAIL},
    {"close that", "4e 02 20 06 24 01 0a 0e " TRIAD "03 00 01 00 20 02 24 01",
     "ce 00 00 00 01 00 37 13 2a 00 00 00 00 00"},
    {"4003 bytes: 0109 and 4002", LARGE HEAD TRIAD "01 00 00 00 " SECOND "a3 0f 00 42 "
     SECOND "a2 0f 00 42 a3 " ROUTER, "db 00 01 02 09 01 a2 0f " ECHO},
    {"4003 bytes the other way", LARGE HEAD TRIAD "01 00 00 00 " SECOND "a2 0f 00 42 "
     SECOND "a3 0f 00 42 a3 " ROUTER, "db 00 01 02 09 01 a2 0f " ECHO},
    {"10 bytes", OPEN HEAD TRIAD "01 00 00 00 " SECOND "0a 42 " SECOND "f4 43 a3 " ROUTER,
     "d4 00 01 02 09 01 ff 01 " ECHO},
    {"no type", OPEN HEAD TRIAD "01 00 00 00 " SECOND "f4 03 " SECOND "f4 43 a3 " ROUTER,
     "d4 00 01 01 23 01 " ECHO},
    {"a multicast", OPEN HEAD TRIAD "01 00 00 00 " SECOND "f4 43 " SECOND "f4 23 a3 "
     ROUTER, "d4 00 01 01 24 01 " ECHO},
    {"no RPI", OPEN HEAD TRIAD "01 00 00 00 00 00 00 00 f4 43 " SECOND "f4 43 a3 " ROUTER,
     "d4 00 01 01 11 01 " ECHO},
    {"a multiplier of 8", OPEN HEAD TRIAD "08 00 00 00 " SECOND "f4 43 " SECOND
     "f4 43 a3 " ROUTER, "d4 00 01 01 11 01 " ECHO},
    {"a transport of class 1", OPEN HEAD TRIAD "01 00 00 00 " SECOND "f4 43 " SECOND
     "f4 43 01 " ROUTER, "d4 00 01 01 03 01 " ECHO},
    {"to slot 1", OPEN HEAD TRIAD "01 00 00 00 " SECOND "f4 43 " SECOND "f4 43 a3 "
     "03 01 01 20 02 24 01", "d4 00 01 01 12 03 " ECHO},
    {"to port 2", OPEN HEAD TRIAD "01 00 00 00 " SECOND "f4 43 " SECOND "f4 43 a3 "
     "03 02 00 20 02 24 01", "d4 00 01 01 11 03 " ECHO},
    {"to another object", OPEN HEAD TRIAD "01 00 00 00 " SECOND "f4 43 " SECOND
     "f4 43 a3 03 01 00 20 04 24 01", "d4 00 01 01 15 03 " ECHO},
    {"a path that is cut", OPEN HEAD TRIAD "01 00 00 00 " SECOND "f4 43 " SECOND
     "f4 43 a3 03 01 00 20 02", "d4 00 13 00"},
    {"bytes behind the path", OPEN HEAD TRIAD "01 00 00 00 " SECOND "f4 43 " SECOND
     "f4 43 a3 " ROUTER " 00", "d4 00 15 00"},
    {"half of it", OPEN HEAD TRIAD "01 00 00 00", "d4 00 13 00"},
};
/* clang-format on */

static const char opening[] =
    OPEN HEAD TRIAD "01 00 00 00 " SECOND "ff 43 " SECOND "f4 43 a3 " ROUTER;

static void testTimeout(void)
{
    simEipConnection *k;

    row(&direct, SIM_EIP_UNCONNECTED, "open one more", opening,
        "d4 00 00 00 ## ## ## ## " TAIL);
    k = simEipConnectionTriad(&c->connections, 1, 0x1337, 42);
    testOk(k && k->requestSize == 511 && k->answerSize == 500 && k->client == 1,
           "its sizes and its owner");
    testOk(k && k->timeout == 8, "RPI of 1 s, x 4 x 2: 8 s");
    testOk(k && k->toOriginator == 0x11223344 &&
               simEipConnectionFind(&c->connections, k->toTarget) == k,
           "its ids");
    simEipConnectionsLeave(&c->connections, 1);
    testOk(k && k->used && k->client == 0, "it outlives its TCP connection");
    simEipConnectionsExpire(&c->connections, 108);
    testOk(k && k->used, "after 8 s it is there");
    simEipConnectionsExpire(&c->connections, 108.01);
    testOk(k && !k->used && c->connections.timedOut == 1, "then it is not");
    c->connections.most = 1;
    row(&direct, SIM_EIP_UNCONNECTED, "its triad is free", opening,
        "d4 00 00 00 ## ## ## ## " TAIL);
    row(&direct, SIM_EIP_UNCONNECTED, "one more than there may be",
        OPEN HEAD "02 00 37 13 2a 00 00 00 01 00 00 00 " SECOND "ff 43 " SECOND
                  "f4 43 a3 " ROUTER,
        "d4 00 01 01 13 01 02 00 37 13 2a 00 00 00 00 00");
}

/* Keys of the file that the tests above do without. */
static void testKeys(void)
{
    build(ON "etherip_connections = 3\netherip_extra = refuse\ntag D DINT\n");
    testOk(c->connections.most == 3, "etherip_connections: so many there may be");
    row(&connected, LIMIT, "etherip_extra = refuse: bytes behind the data are too many",
        "4d 02 " D "c4 00 01 00 05 00 00 00 ff", "cd 00 15 00");
    dismantle();
}

static void testConnections(void)
{
    size_t i;

    build(plant);
    for (i = 0; i < sizeof(opens) / sizeof(opens[0]); i++)
        row(&direct, SIM_EIP_UNCONNECTED, opens[i].what, opens[i].request,
            opens[i].answer);
    testTimeout();
    dismantle();
}

/* ---- profiles ---- */

/* clang-format off */
static const struct {
    const char *profile, *what, *request, *answer;
} profiles[] = {
    {"enet", "a true BOOL is ff", SEND "08 00 4c 02 " B "01 00 01 00 01 00",
     "cc 00 00 00 c1 00 ff"},
    {"enet", "its own module has no tags", "4c 02 " B "01 00", "cc 00 05 00"},
    {"enet", "but an identity: 1756-ENET/A", "0e 03 20 01 24 01 30 07",
     "8e 00 00 00 0b 31 37 35 36 2d 45 4e 45 54 2f 41"},
    {"enet", "no Large Forward Open", LARGE HEAD TRIAD "01 00 00 00 " SECOND
     "a2 0f 00 42 " SECOND "a2 0f 00 42 a3 " ROUTER, "db 00 08 00"},
    {"enet", "505 bytes: 0109 and 504", OPEN HEAD TRIAD "01 00 00 00 " SECOND "f9 43 "
     SECOND "f4 43 a3 " ROUTER, "d4 00 01 02 09 01 f8 01 " ECHO},
    {"enet", "a connection needs the backplane", OPEN HEAD TRIAD "01 00 00 00 " SECOND
     "f4 43 " SECOND "f4 43 a3 02 20 02 24 01", "d4 00 01 01 15 03 " ECHO},
    {"micro800", "no backplane", SEND "08 00 4c 02 " B "01 00 01 00 01 00",
     "d2 00 08 00"},
    {"micro800", "a connection without one", OPEN HEAD TRIAD "01 00 00 00 " SECOND
     "f4 43 " SECOND "f4 43 a3 02 20 02 24 01", "d4 00 00 00 ## ## ## ## " TAIL},
    {"micro800", "505 bytes: 0109 and 504", OPEN HEAD "02 00 37 13 2a 00 00 00 01 00 00 00 " SECOND
     "f9 43 " SECOND "f4 43 a3 02 20 02 24 01", "d4 00 01 02 09 01 f8 01 02 00 37 13 2a 00 00 00 00 00"},
    {"micro800", "a slot", OPEN HEAD TRIAD "01 00 00 00 " SECOND "f4 43 " SECOND
     "f4 43 a3 " ROUTER, "d4 00 01 01 11 03 " ECHO},
    {"micro800", "no packets", "0a 02 20 02 24 01 01 00 04 00 4c 02 " B "01 00",
     "8a 00 08 00"},
    {"micro800", "no list", "55 02 20 6b 24 00 01 00 01 00", "d5 00 08 00"},
    {"micro800", "a STRING is as long as its text", "4c 02 91 01 54 00 01 00",
     "cc 00 00 00 da 00 02 61 62"},
    {"micro800", "write one", "4d 02 91 01 54 00 da 00 01 00 03 78 79 7a", "cd 00 00 00"},
    {"micro800", "it is there", "4c 02 91 01 54 00 01 00",
     "cc 00 00 00 da 00 03 78 79 7a"},
    {"micro800", "one that is cut", "4d 02 91 01 54 00 da 00 01 00 03 78 79",
     "cd 00 13 00"},
    {"omron", "an array is read whole", "4c 02 91 01 41 00 01 00",
     "cc 00 00 00 c3 00 07 00 08 00 09 00"},
    {"omron", "with count 1 only", "4c 02 91 01 41 00 03 00", "cc 00 20 01 17 80"},
    {"omron", "or one element", "4c 03 91 01 41 00 28 02 01 00", "cc 00 00 00 c3 00 09 00"},
    {"omron", "or two, from the one that is named on", "4c 03 91 01 41 00 28 01 02 00",
     "cc 00 00 00 c3 00 08 00 09 00"},
    {"omron", "not more than there are", "4c 03 91 01 41 00 28 01 03 00", "cc 00 20 01 18 80"},
    {"omron", "nor none", "4c 03 91 01 41 00 28 01 00 00", "cc 00 20 01 18 80"},
    {"omron", "two are written likewise", "4d 03 91 01 41 00 28 01 c3 00 02 00 05 00 06 00",
     "cd 00 00 00"},
    {"omron", "the whole with count 1", "4d 02 91 01 41 00 c3 00 01 00 01 00 02 00 03 00",
     "cd 00 00 00"},
    {"omron", "not one element of it", "4d 02 91 01 41 00 c3 00 01 00 01 00", "cd 00 13 00"},
    {"omron", "it is there", "4c 02 91 01 41 00 01 00", "cc 00 00 00 c3 00 01 00 02 00 03 00"},
    {"omron", "not as another type", "4d 03 91 01 41 00 28 01 c4 00 01 00 05 00 06 00",
     "cd 00 20 01 22 80"},
    {"omron", "a BOOL: value, is it forced", "4c 02 91 01 42 00 01 00", "cc 00 00 00 c1 00 01 00"},
    {"omron", "written likewise", "4d 02 91 01 42 00 c1 00 01 00 00 00", "cd 00 00 00"},
    {"omron", "not one byte", "4d 02 91 01 42 00 c1 00 01 00 01", "cd 00 13 00"},
    {"omron", "BOOLs of an array have one each", "4c 03 91 01 46 00 28 01 03 00",
     "cc 00 00 00 c1 00 01 00 01"},
    {"omron", "written likewise", "4d 03 91 01 46 00 28 10 c1 00 02 00 01 01", "cd 00 00 00"},
    {"omron", "one of them two bytes", "4d 03 91 01 46 00 28 01 c1 00 01 00 00 00", "cd 00 00 00"},
    {"omron", "all of them are words of bits", "4c 02 91 01 46 00 01 00",
     "cc 00 00 00 c1 00 08 00 03 00"},
    {"omron", "a byte has another behind it", "4c 02 91 01 53 00 01 00", "cc 00 00 00 c2 00 fb 00"},
    {"omron", "when it is read", "4d 02 91 01 53 00 c2 00 01 00 04 00", "cd 00 15 00"},
    {"omron", "no list", "55 02 20 6b 24 00 01 00 01 00", "d5 00 08 00"},
    {"omron", "no fragments", "52 02 91 01 41 00 01 00 00 00 00 00", "d2 00 08 00"},
    {"omron", "no read-modify-write", "4e 02 91 01 53 00 01 00 01 ff", "ce 00 08 00"},
    {"omron", "a name that is not there", "4c 02 91 01 58 00 01 00", "cc 00 05 00"},
    {"omron", "1200 bytes do not fit", "4c 02 91 01 4c 00 01 00", "cc 00 11 00"},
    {"omron", "a STRING has two bytes of length", "4c 02 91 01 54 00 01 00",
     "cc 00 00 00 d0 00 02 00 61 62"},
    {"omron", "503 bytes: 0109 and 502", OPEN HEAD TRIAD "01 00 00 00 " SECOND "f7 43 " SECOND
     "f6 43 a3 " ROUTER, "d4 00 01 02 09 01 f6 01 " ECHO},
    {"omron", "1995 bytes: 0109 and 1994", LARGE HEAD TRIAD "01 00 00 00 " SECOND
     "cb 07 00 42 " SECOND "ca 07 00 42 a3 " ROUTER, "db 00 01 02 09 01 ca 07 " ECHO},
};
/* clang-format on */

static void testProfiles(void)
{
    char text[500];
    size_t i;

    for (i = 0; i < sizeof(profiles) / sizeof(profiles[0]); i++) {
        char what[200];

        if (!i || strcmp(profiles[i].profile, profiles[i - 1].profile)) {
            if (i)
                dismantle();
            snprintf(text, sizeof(text),
                     ON "etherip_profile = %s\ntag B BOOL = 1\ntag T STRING = ab\n"
                        "tag A INT[3] = 7 8 9\n%s",
                     profiles[i].profile,
                     strcmp(profiles[i].profile, "omron")
                         ? ""
                         : "tag F BOOL[18] = 0 1 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0\n"
                           "tag S SINT = -5\ntag L DINT[300]\n");
            build(text);
        }
        snprintf(what, sizeof(what), "%s: %s", profiles[i].profile, profiles[i].what);
        row(&direct, SIM_EIP_UNCONNECTED, what, profiles[i].request, profiles[i].answer);
    }
    dismantle();
}

static void testOmronPacket(void)
{
    epicsUInt8 in[400], out[SIM_EIP_ANSWER];
    size_t size = parseHex("0a 02 20 02 24 01 21 00", in), i;

    build(ON "etherip_profile = omron\ntag B BOOL = 1\n");
    for (i = 0; i < 33; i++)
        simEipPut(in + size + 2 * i, 2, 68 + 8 * i);
    size += 66;
    for (i = 0; i < 33; i++)
        size += parseHex("4c 02 " B "01 00", in + size);
    simEipServe(c, &direct, in, size, out, SIM_EIP_ANSWER);
    testOk(out[2] == EIP_NO_RESOURCE, "omron: not 33 requests in a packet");
    simEipPut(in + 6, 2, 32);
    for (i = 0; i < 32; i++)
        simEipPut(in + 8 + 2 * i, 2, 68 + 8 * i);
    simEipServe(c, &direct, in, size - 8, out, SIM_EIP_ANSWER);
    testOk(out[2] == 0 && out[4] == 32, "omron: but 32");
    dismantle();
}

/* ---- the key, and a download ---- */

static void testChanges(void)
{
    unsigned id;

    build(plant);
    c->key = eipRun;
    row(&connected, LIMIT, "RUN: nobody writes", "4d 02 " D "c4 00 01 00 01 02 03 04",
        "cd 00 10 01 01 21");
    row(&connected, LIMIT, "nor sets bits", "4e 02 " D "04 00 02 01 00 00 ff ff ff fe",
        "ce 00 10 01 01 21");
    row(&connected, LIMIT, "but reads", "4c 02 " D "01 00",
        "cc 00 00 00 c4 00 44 33 22 11");
    row(&connected, LIMIT, "and sees the key", "0e 03 20 01 24 01 30 05",
        "8e 00 00 00 60 10");
    c->key = eipRemote;
    id = simEipTemplateId(&c->types, simEipTypeFind(&c->types, "Pair"));
    simEipControllerDownload(c, 0);
    row(&connected, LIMIT, "after a download the old id is nothing",
        "4c 02 20 6b 24 11 01 00", "cc 00 05 00");
    row(&connected, LIMIT, "there is another", "4c 02 20 6b 24 12 01 00",
        "cc 00 00 00 c4 00 44 33 22 11");
    row(&connected, LIMIT, "the name is the same", "4c 02 " D "01 00",
        "cc 00 00 00 c4 00 44 33 22 11");
    row(&connected, LIMIT, "class AC tells it", "03 02 20 ac 24 01 01 00 01 00",
        "83 00 00 00 01 00 01 00 00 00 06 00");
    testOk(id != simEipTemplateId(&c->types, simEipTypeFind(&c->types, "Pair")),
           "structures have other templates");
    simEipControllerDownload(c, 1);
    row(&connected, LIMIT, "a shift: that id is the tag in front of it now",
        "4c 02 20 6b 24 16 01 00", "cc 00 00 00 c4 00 44 33 22 11");
    dismantle();
}

/* ---- faults ---- */

static int fault(const char *words)
{
    char line[100], error[SIM_ERROR_SIZE];
    char *list[20];
    int count;

    snprintf(line, sizeof(line), "%s", words);
    count = simSplit(line, list, 20, error);
    return simEipFaultParse(&c->faults, list, (size_t)count, error);
}

static const struct {
    const char *words;
    int bad;
} faultWords[] = {
    {"status 05 tag D write next 2", 0},
    {"status ff 2105 service 4c",    0},
    {"status",                       1},
    {"status 100",                   1},
    {"slow 100 read connected",      0},
    {"slow",                         1},
    {"slow -1",                      1},
    {"short 10 close unconnected",   0},
    {"wrongcontext next 0",          1},
    {"wrongcontext tag",             1},
    {"swap sometimes",               1},
    {"nonsense",                     1},
    {"service 4c",                   1},
};

static void testFaults(void)
{
    static const simEipSubject read = {0x4C, 1, "D"}, write = {0x4D, 1, "D[2]"};
    static const simEipSubject other = {0x4C, 0, "Dx"};
    simEipSubject two[2] = {other, write};
    simText text = {NULL, 0, 0};
    simEipFate fate;
    size_t i;

    build(plant);
    for (i = 0; i < sizeof(faultWords) / sizeof(faultWords[0]); i++)
        testOk(!fault(faultWords[i].words) == !faultWords[i].bad, "\"%s\" is %s",
               faultWords[i].words, faultWords[i].bad ? "refused" : "taken");
    simEipFaultsText(&c->faults, &text);
    testOk(!strcmp(text.text, " status=05,write,tag=D,next=2 status=ff/2105,service=4c"
                              " slow=100,read,connected short=10,close,unconnected"),
           "they are listed:%s", text.text);
    simTextFree(&text);
    row(&connected, LIMIT, "a status answers in place of the PLC",
        "4d 02 " D "c4 00 01 00 01 02 03 04", "cd 00 05 00");
    row(&connected, LIMIT, "within a packet too",
        "0a 02 20 02 24 01 01 00 04 00 4d 02 " D "c4 00 01 00 01 02 03 04",
        "8a 00 1e 00 01 00 04 00 cd 00 05 00");
    row(&connected, LIMIT, "twice", "4d 02 " D "c4 00 01 00 01 02 03 04", "cd 00 00 00");
    row(&connected, LIMIT, "an extended one", "4c 02 " D "01 00", "cc 00 ff 01 05 21");
    fault("status off");
    row(&connected, LIMIT, "and off", "4c 02 " D "01 00",
        "cc 00 00 00 c4 00 01 02 03 04");
    simEipFaultsClear(&c->faults);
    fault("silent tag D write next 1");
    simEipFaultsMeet(&c->faults, &read, 1, &fate);
    testOk(!fate.silent, "a read does not meet a fault of writes");
    simEipFaultsMeet(&c->faults, &other, 1, &fate);
    testOk(!fate.silent, "nor Dx one of D");
    simEipFaultsMeet(&c->faults, two, 2, &fate);
    testOk(fate.silent, "D[2] does, in any place of a packet");
    simEipFaultsMeet(&c->faults, two, 2, &fate);
    testOk(!fate.silent && c->faults.count == 0, "once");
    dismantle();
}

/* ---- anything at all ---- */

/* Spoils some bytes of a good request: other values, cut, longer. */
static size_t mutate(epicsUInt8 *bytes, size_t size, size_t room)
{
    int n = 1 + rand() % 4;

    while (n-- > 0) {
        size_t at = (size_t)rand() % (size + 1);

        switch (rand() % 5) {
        case 0:
            size = at;
            break;
        case 1:
            if (size < room)
                bytes[size++] = (epicsUInt8)rand();
            break;
        case 2:
            bytes[at % (size + 1)] = rand() % 2 ? 0xFF : 0x00;
            break;
        default:
            bytes[at] = (epicsUInt8)(rand() >> 5);
        }
    }
    return size;
}

static void countRequest(void *arg, const simEipRequest *request, const simEipPath *path)
{
    simText text = {NULL, 0, 0};

    simEipControllerPathText(c, path, &text);
    simTextFree(&text);
    *(size_t *)arg += request->dataSize;
}

static void testMutated(void)
{
    size_t rows = sizeof(served) / sizeof(served[0]);
    size_t more = sizeof(opens) / sizeof(opens[0]);
    epicsUInt8 in[1000], out[SIM_EIP_ANSWER + 8];
    int odd = 0, spilled = 0, n;

    build(plant);
    srand(20260405);
    for (n = 0; n < 200000; n++) {
        size_t i = (size_t)rand() % (rows + more);
        const char *request = i < rows ? served[i].request : opens[i - rows].request;
        size_t size = mutate(in, parseHex(request, in), sizeof(in) - 1);
        size_t limit = n % 3 ? LIMIT : 12 + (size_t)rand() % 200, got, walked = 0;
        epicsUInt8 *exact = malloc(size + 1);

        /* a copy that ends where it ends, so that the address sanitizer sees more */
        memcpy(exact, in, size);
        memset(out + limit, 0xA5, 8);
        got = simEipServe(c, n % 2 ? &connected : &direct, exact, size, out, limit);
        simEipWalk(exact, size, countRequest, &walked);
        odd += got < 4 || got > limit || !(out[0] & 0x80) || out[1];
        spilled += out[limit] != 0xA5 || out[limit + 7] != 0xA5;
        free(exact);
    }
    testOk(!odd, "200000 spoiled requests: each gets an answer (%d odd ones)", odd);
    testOk(!spilled, "none longer than it may be (%d)", spilled);
    testOk(simEipTagBytes(simEipTagFind(&c->tags, "RO"))[0] == 5 &&
               simEipTagBytes(simEipTagFind(&c->tags, "HI"))[0] == 0,
           "tags that nobody may write are as ever");
    testOk(simEipConnectionsCount(&c->connections) <= c->connections.most,
           "no more connections than there may be");
    dismantle();
}

MAIN(plcSimTestEip)
{
    testPlan(245);
    testServed();
    testLimits();
    testUnconnected();
    testConnections();
    testKeys();
    testProfiles();
    testOmronPacket();
    testChanges();
    testFaults();
    testMutated();
    return testDone();
}
