/* The program of plcSim, one cycle at a time: orders come on stdin, one a line, and each
 * is answered by one line. For tests that compare it with the same program in another
 * language.
 *
 *   db <number> <bytes>                     makes a data block
 *   allow read|write <block> [<byte> <n>]   as in a .plc file
 *   blocks <in> <out>                       makes IE_TX and IE_RX
 *   begin <rows> <watchdog ms>              after these: makes the program
 *   tx|rx <words>, layout <id>              before `begin`, for a program without tables
 *   cycle <ms> <connected> <remote> <allow> <send> <block in hex, or ->
 *                                           IE_TX in hex when send is 1
 *   put <number> <byte> <hex>   get <number>      memory of a data block; number 0: M
 *   restart                                 OB100
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "simProgram.h"
#include "simTransfers.h"

#define LINE 200000

static simMemory memory;
static simProgram program;
static char *line, *words[8];

static void split(void)
{
    size_t i;
    char *save = NULL, *word = strtok_r(line, " \n", &save);

    for (i = 0; i < 8; i++, word = word ? strtok_r(NULL, " \n", &save) : NULL)
        words[i] = word ? word : (char *)"";
}

static size_t bytesOf(const char *hex, epicsUInt8 *bytes)
{
    size_t n = 0;
    unsigned value;

    while (sscanf(hex + 2 * n, "%2x", &value) == 1)
        bytes[n++] = (epicsUInt8)value;
    return n;
}

static void print(const epicsUInt8 *bytes, size_t size)
{
    size_t i;

    for (i = 0; i < size; i++)
        printf("%02x", bytes[i]);
    printf("\n");
}

static simBlock *block(const char *word)
{
    unsigned number = (unsigned)atoi(word);

    return number ? simMemoryFind(&memory, SIM_AREA_DB, number)
                  : simMemoryFind(&memory, SIM_AREA_M, 0);
}

static void wire(void)
{
    program.name = program.tables.name = "step";
    program.memory = program.tables.memory = &memory;
    program.tx = program.tables.tx =
        simMemoryAdd(&memory, SIM_AREA_DB, 1, (size_t)atoi(words[1]), "IE_TX");
    program.rx = program.tables.rx =
        simMemoryAdd(&memory, SIM_AREA_DB, 2, (size_t)atoi(words[2]), "IE_RX");
}

static int transfer(int isTx, char error[SIM_ERROR_SIZE])
{
    size_t count = 0;

    while (count < 7 && words[count + 1][0])
        count++;
    return simTransfersAdd(&program, isTx, words + 1, count, error);
}

static int begin(char error[SIM_ERROR_SIZE])
{
    program.sync = 1;
    program.tables.rows = (unsigned)atoi(words[1]);
    program.watchdog = atoi(words[2]) * 1e-3;
    if (simTablesInit(&program.tables, 20, error))
        return -1;
    return simProgramInit(&program, 3, 4, error);
}

static void cycle(epicsUInt8 *bytes)
{
    simInputs in = {
        atof(words[1]) * 1e-3, atoi(words[2]), atoi(words[3]), 0, atoi(words[5]), NULL};

    program.tables.allow = atoi(words[4]);
    if (words[6][0] != '-' && bytesOf(words[6], bytes) == program.rx->size)
        in.received = bytes;
    IE_COMMS(&program, &in);
    print(program.tx->bytes, in.send ? program.tx->size : 0);
}

static int put(epicsUInt8 *bytes, char error[SIM_ERROR_SIZE])
{
    simBlock *to = block(words[1]);
    size_t size = bytesOf(words[3], bytes), at = (size_t)atoi(words[2]);

    if (!to || at > to->size || size > to->size - at)
        return simFail(error, "%lu bytes do not fit there", (unsigned long)size);
    memcpy(to->bytes + at, bytes, size);
    return 0;
}

static int order(epicsUInt8 *bytes, char error[SIM_ERROR_SIZE])
{
    const char *word = words[0];
    int status = 0;

    if (!strcmp(word, "cycle")) {
        cycle(bytes);
        return 0;
    }
    if (!strcmp(word, "get")) {
        print(block(words[1])->bytes, block(words[1])->size);
        return 0;
    }
    if (!strcmp(word, "put"))
        status = put(bytes, error);
    else if (!strcmp(word, "db"))
        simMemoryAdd(&memory, SIM_AREA_DB, (unsigned)atoi(words[1]),
                     (size_t)atoi(words[2]), "");
    else if (!strcmp(word, "allow"))
        status = simTablesAllow(&program.tables, words + 1, words[3][0] ? 4 : 2, error);
    else if (!strcmp(word, "tx") || !strcmp(word, "rx"))
        status = transfer(!strcmp(word, "tx"), error);
    else if (!strcmp(word, "layout"))
        program.layout = (unsigned)atoi(words[1]);
    else if (!strcmp(word, "blocks"))
        wire();
    else if (!strcmp(word, "begin"))
        status = begin(error);
    else if (!strcmp(word, "restart"))
        simProgramRestart(&program);
    else
        return simFail(error, "what is %.40s?", word);
    if (!status)
        printf("ok\n");
    return status;
}

int main(void)
{
    static epicsUInt8 bytes[65536];
    char error[SIM_ERROR_SIZE];

    line = malloc(LINE);
    simMemoryInit(&memory, 1);
    program.tables.memory = &memory;
    simMemoryAdd(&memory, SIM_AREA_M, 0, 256, NULL);
    simLogQuiet(2);
    while (fgets(line, LINE, stdin)) {
        split();
        if (order(bytes, error))
            printf("error: %s\n", error);
        fflush(stdout);
    }
    return 0;
}
