/* Fuzz target: a file of pointers (.ptr), and the way of the table into a PLC that answers what
 * the fuzzer likes: status bytes of blocks. Parts stay within the table and within a block. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fuzz.h"
#include "plcPointers.h"
#include "plcSync.h"
#include "plcTables.h"

fuzzTarget fuzzPointers, fuzzTables;

static void checkTable(const plcPointers *table)
{
    unsigned rows = table->rowsTx + table->rowsRx, i;

    fuzzCheck(rows > 0 && rows <= PLC_POINTER_ROWS);
    fuzzCheck(table->size == PLC_TABLE_HEAD + (size_t)rows * PLC_TABLE_ROW);
    fuzzCheck(plcPointersCrc(table->bytes, table->size) ==
              ((epicsUInt32)table->bytes[6] << 24 | (epicsUInt32)table->bytes[7] << 16 |
               (epicsUInt32)table->bytes[8] << 8 | table->bytes[9]));
    fuzzCheck(plcPointersLayout(table) <= 65535);
    for (i = 0; i < rows; i++)
        fuzzCheck(plcPointersRowName(table, (int)i));
    fuzzCheck(!plcPointersRowName(table, (int)rows)[0] && !plcPointersRowName(table, -1)[0]);
}

int fuzzPointers(const epicsUInt8 *data, size_t size)
{
    epicsUInt8 *copy = malloc(size + 1);
    char error[200] = "";
    FILE *file;
    plcPointers *table;

    if (size)
        memcpy(copy, data, size);
    copy[size] = '\n';
    file = fmemopen(copy, size + 1, "r");
    fuzzCheck(file);
    table = plcPointersRead(file, error, sizeof(error));
    fclose(file);
    fuzzCheck(table || (error[0] && strlen(error) < sizeof(error)));
    if (table)
        checkTable(table);
    plcPointersFree(table);
    free(copy);
    return 0;
}

enum { tableRows = 7, tableSize = PLC_TABLE_HEAD + tableRows * PLC_TABLE_ROW };

/* One block of the IOC: what leaves is a part of our table, and nothing else of the block is
 * touched. */
static void pack(plcTables *t, const epicsUInt8 *table, size_t outSize, int bigEndian)
{
    epicsUInt8 *block = malloc(outSize), *was = malloc(outSize);
    size_t offset, length;

    memset(block, 0x5a, outSize);
    memcpy(was, block, outSize);
    if (plcTablesPack(t, block, bigEndian)) {
        offset = bigEndian ? block[6] << 8 | block[7] : block[7] << 8 | block[6];
        length = bigEndian ? block[8] << 8 | block[9] : block[9] << 8 | block[8];
        fuzzCheck(memcmp(block, was, 4) == 0);
        if (block[4] == plcTablesPart) {
            fuzzCheck(length > 0 && offset + length <= tableSize &&
                      PLC_TABLES_PIECE + length <= outSize);
            fuzzCheck(memcmp(block + PLC_TABLES_PIECE, table + offset, length) == 0);
        }
    } else {
        fuzzCheck(memcmp(block, was, outSize) == 0);
    }
    free(block);
    free(was);
}

static void checkTables(const plcTables *t)
{
    int progress = plcTablesProgress(t);

    fuzzCheck(progress >= 0 && progress <= 100);
    fuzzCheck(progress < 100 || t->state == plcTablesEqual);
    fuzzCheck(t->state <= plcTablesRefused && t->done <= t->size);
    fuzzCheck(strlen(t->reason) < sizeof(t->reason) && plcTablesStateName(t->state)[0] != '?');
}

/* Blocks of a PLC with the header of sync and the status of tables, 16 bytes each, to both. */
int fuzzTables(const epicsUInt8 *data, size_t size)
{
    fuzzBytes b = {data, size};
    int bigEndian = fuzzTake(&b) & 1, connected = 1, i;
    size_t outSize = PLC_TABLES_PIECE + 4 + fuzzTake(&b) % 40;
    plcTables tables;
    plcSync sync;
    epicsUInt8 table[tableSize], header[PLC_HEADER_SIZE];

    for (i = 0; i < tableSize; i++)
        table[i] = (epicsUInt8)(i * 7);
    plcTablesInit(&tables, (plcMapMode)(fuzzTake(&b) % 3), table, tableSize, outSize);
    plcSyncInit(&sync, (epicsUInt16)fuzzTake16(&b));
    plcTablesConnected(&tables);
    plcSyncConnected(&sync);
    while (b.left) {
        epicsUInt8 *block = malloc(PLC_TABLES_STATUS);
        int does;

        for (i = 0; i < PLC_TABLES_STATUS; i++)
            block[i] = (epicsUInt8)fuzzTake(&b);
        switch (fuzzTake(&b) % 16) {
        case 0:
            plcTablesLost(&tables);
            plcSyncLost(&sync);
            connected = 0;
            fuzzCheck(!plcSyncMaySend(&sync));
            break;
        case 1:
            plcTablesConnected(&tables);
            plcSyncConnected(&sync);
            connected = 1;
            fuzzCheck(!plcSyncMaySend(&sync));
            break;
        case 2:
            memcpy(block + 8, &tables.crc, 4); /* may be our table in one of the orders */
            /* fall through */
        default:
            if (!connected)
                break;
            if (plcTablesBlock(&tables, block, bigEndian)) {
                fuzzCheck(tables.mode == plcMapOff || tables.state == plcTablesDisconnected ||
                          plcTablesSame(&tables, block, bigEndian));
                does = plcSyncBlock(&sync, block, (int)(b.left & 1), bigEndian);
                fuzzCheck((does & ~(plcSyncTake | plcSyncSend)) == 0);
            } else {
                plcSyncMap(&sync, block, tables.command != 0);
                fuzzCheck(sync.state != plcSyncSynced);
            }
        }
        fuzzCheck(sync.state != plcSyncSynced || (sync.flags & plcFlagSync &&
                                                  sync.flags & plcFlagRemote));
        fuzzCheck(plcSyncStateName(sync.state)[0] && plcSyncReason(sync.state));
        if (plcSyncMaySend(&sync))
            plcSyncHeader(&sync, header, bigEndian);
        checkTables(&tables);
        pack(&tables, table, outSize, bigEndian);
        free(block);
    }
    return 0;
}
