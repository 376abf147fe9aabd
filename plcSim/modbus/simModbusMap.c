/* simModbusMap: where the four tables of Modbus lie in PLC memory. It does not know the
 * protocol, nor libmodbus.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <ctype.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <cantProceed.h>

#include "simModbusMap.h"
#include "simValue.h"

static const struct table {
    const char *name;
    int bits;     /* else registers */
    int writable; /* by the protocol */
} tables[SIM_TABLES] = {
    {"coils",    1, 1},
    {"discrete", 1, 0},
    {"holding",  0, 1},
    {"input",    0, 0},
};

const char *simTableName(simTable table)
{
    return table >= 0 && table < SIM_TABLES ? tables[table].name : "none";
}

simTable simTableByName(const char *name)
{
    int i;

    for (i = 0; i < SIM_TABLES; i++)
        if (!strcasecmp(name, tables[i].name))
            return (simTable)i;
    return simNoTable;
}

int simMapNumber(const char *word, unsigned long max, unsigned long *value)
{
    char *end;

    errno = 0;
    *value = strtoul(word, &end, 10);
    return !isdigit((unsigned char)word[0]) || *end || errno || *value > max ? -1 : 0;
}

void simMapInit(simModbusMap *map, const simMemory *memory)
{
    memset(map, 0, sizeof(*map));
    map->memory = memory;
}

void simMapFree(simModbusMap *map)
{
    free(map->areas);
    map->areas = NULL;
    map->count = 0;
}

/* ---- statements ---- */

static int without(simModbusMap *map, char **words, size_t count,
                   char error[SIM_ERROR_SIZE])
{
    unsigned long function;
    size_t i;

    for (i = 0; i < count; i++) {
        if (simMapNumber(words[i], 127, &function) || function < 1)
            return simFail(error, "modbus without %.40s: a function is 1 ... 127",
                           words[i]);
        map->without[function] = 1;
    }
    return count ? 0 : simFail(error, "modbus without wants: <function> ...");
}

static const simArea *overlapping(const simModbusMap *map, const simArea *area)
{
    size_t i;

    for (i = 0; i < map->count; i++) {
        const simArea *other = &map->areas[i];

        if (other->table == area->table && area->start < other->start + other->count &&
            other->start < area->start + area->count)
            return other;
    }
    return NULL;
}

/* The area lies inside of its block. */
static int checkPlace(const simArea *area, const char *text, char error[SIM_ERROR_SIZE])
{
    const simPlace *place = &area->place;
    int bits = tables[area->table].bits;
    size_t first = (size_t)(place->bit > 0 ? place->bit : 0);
    size_t bytes = bits ? (first + area->count + 7) / 8 : 2 * (size_t)area->count;

    if (!bits && place->bit >= 0)
        return simFail(error, "\"%.60s\" names a bit, but %s are registers of 2 bytes",
                       text, tables[area->table].name);
    if (bytes > place->block->size - place->offset)
        return simFail(error,
                       "%u %s from %.60s on take %lu bytes and are outside of %s, "
                       "which has %lu bytes",
                       area->count, bits ? "bits" : "registers", text,
                       (unsigned long)bytes, simBlockName(place->block),
                       (unsigned long)place->block->size);
    return 0;
}

static int keepArea(simModbusMap *map, const simArea *area, char error[SIM_ERROR_SIZE])
{
    const simArea *other = overlapping(map, area);

    if (other)
        return simFail(error, "modbus %s: %u ... %u and %u ... %u overlap",
                       tables[area->table].name, other->start,
                       other->start + other->count - 1, area->start,
                       area->start + area->count - 1);
    map->areas = realloc(map->areas, (map->count + 1) * sizeof(simArea));
    if (!map->areas)
        cantProceed("simModbusMap: out of memory");
    map->areas[map->count++] = *area;
    return 0;
}

/* <table> <start> <count> -> <address> [readonly] */
static int addArea(simModbusMap *map, char **words, size_t count,
                   char error[SIM_ERROR_SIZE])
{
    unsigned long start, size;
    simArea area;

    memset(&area, 0, sizeof(area));
    area.table = simTableByName(words[0]);
    if (count < 5 || count > 6 || strcmp(words[3], "->") ||
        (count == 6 && strcasecmp(words[5], "readonly")))
        return simFail(error, "modbus %s wants: <first> <count> -> <address> [readonly]",
                       words[0]);
    if (simMapNumber(words[1], SIM_MODBUS_ADDRESSES - 1, &start) ||
        simMapNumber(words[2], SIM_MODBUS_ADDRESSES, &size) || size < 1 ||
        start + size > SIM_MODBUS_ADDRESSES)
        return simFail(error,
                       "modbus %s %.20s %.20s: allowed are addresses 0 ... 65535, and a "
                       "count that stays below 65536",
                       words[0], words[1], words[2]);
    area.start = (unsigned)start;
    area.count = (unsigned)size;
    area.readOnly = count == 6 || !tables[area.table].writable;
    if (simPlaceParse(map->memory, words[4], NULL, &area.place, error) ||
        checkPlace(&area, words[4], error))
        return -1;
    return keepArea(map, &area, error);
}

int simMapStatement(simModbusMap *map, char **words, size_t count,
                    char error[SIM_ERROR_SIZE])
{
    if (count && !strcasecmp(words[0], "without"))
        return without(map, words + 1, count - 1, error);
    if (count && simTableByName(words[0]) != simNoTable)
        return addArea(map, words, count, error);
    return simFail(error,
                   "modbus%s%.40s: allowed are holding, input, coils, discrete and "
                   "without",
                   count ? " " : "", count ? words[0] : "");
}

/* ---- memory ---- */

static const simArea *areaOf(const simModbusMap *map, simTable table, unsigned address)
{
    size_t i;

    for (i = 0; i < map->count; i++) {
        const simArea *area = &map->areas[i];

        if (area->table == table && address >= area->start &&
            address - area->start < area->count)
            return area;
    }
    return NULL;
}

/* The area that holds `address`, and how many of `count` addresses lie in it. */
static const simArea *piece(const simModbusMap *map, simTable table, unsigned address,
                            unsigned count, unsigned *here)
{
    const simArea *area = areaOf(map, table, address);

    *here = area ? area->start + area->count - address : count;
    if (*here > count)
        *here = count;
    return area;
}

int simMapHas(const simModbusMap *map, simTable table, unsigned start, unsigned count,
              int writing)
{
    unsigned here;

    for (; count; start += here, count -= here) {
        const simArea *area = piece(map, table, start, count, &here);

        if (!area || (writing && area->readOnly))
            return 0;
    }
    return 1;
}

static epicsUInt8 *byteOf(const simArea *area, unsigned address, unsigned *bit)
{
    unsigned index = address - area->start;

    index += (unsigned)(area->place.bit > 0 ? area->place.bit : 0);
    *bit = index % 8;
    return area->place.block->bytes + area->place.offset + index / 8;
}

static epicsUInt8 *registerOf(const simArea *area, unsigned address)
{
    return area->place.block->bytes + area->place.offset +
           2 * (size_t)(address - area->start);
}

void simMapGetBits(const simModbusMap *map, simTable table, unsigned start,
                   unsigned count, epicsUInt8 *all)
{
    unsigned here, bit, i;

    for (; count; start += here, count -= here) {
        const simArea *area = piece(map, table, start, count, &here);

        for (i = 0; area && i < here; i++) {
            const epicsUInt8 *byte = byteOf(area, start + i, &bit);

            all[start + i] = *byte >> bit & 1;
        }
    }
}

void simMapPutBits(const simModbusMap *map, simTable table, unsigned start,
                   unsigned count, const epicsUInt8 *all)
{
    unsigned here, bit, i;

    for (; count; start += here, count -= here) {
        const simArea *area = piece(map, table, start, count, &here);

        for (i = 0; area && i < here; i++) {
            epicsUInt8 *byte = byteOf(area, start + i, &bit);
            epicsUInt8 mask = (epicsUInt8)(1u << bit);

            *byte = (epicsUInt8)(all[start + i] ? *byte | mask : *byte & ~mask);
        }
    }
}

void simMapGetRegisters(const simModbusMap *map, simTable table, unsigned start,
                        unsigned count, epicsUInt16 *all)
{
    unsigned here, i;

    for (; count; start += here, count -= here) {
        const simArea *area = piece(map, table, start, count, &here);

        for (i = 0; area && i < here; i++)
            all[start + i] = (epicsUInt16)simGetInt(registerOf(area, start + i), 2,
                                                    map->memory->bigEndian);
    }
}

void simMapPutRegisters(const simModbusMap *map, simTable table, unsigned start,
                        unsigned count, const epicsUInt16 *all)
{
    unsigned here, i;

    for (; count; start += here, count -= here) {
        const simArea *area = piece(map, table, start, count, &here);

        for (i = 0; area && i < here; i++)
            simPutInt(registerOf(area, start + i), 2, map->memory->bigEndian,
                      all[start + i]);
    }
}

static void placeText(const simPlace *place, simText *out)
{
    const simBlock *block = place->block;
    char letter = block->area == SIM_AREA_I ? 'I' : block->area == SIM_AREA_Q ? 'Q' : 'M';

    if (block->area != SIM_AREA_DB)
        simTextAdd(out, "%c%lu", letter, (unsigned long)place->offset);
    else
        simTextAdd(out, "DB%u.%s%lu", block->number, place->bit > 0 ? "DBX" : "",
                   (unsigned long)place->offset);
    if (place->bit > 0)
        simTextAdd(out, ".%d", place->bit);
}

void simMapText(const simModbusMap *map, simText *out)
{
    const char *separator = " without=";
    unsigned function;
    size_t i;

    for (i = 0; i < map->count; i++) {
        const simArea *area = &map->areas[i];

        simTextAdd(out, " %s=%u..%u@", tables[area->table].name, area->start,
                   area->start + area->count - 1);
        placeText(&area->place, out);
        if (area->readOnly && tables[area->table].writable)
            simTextAdd(out, ",readonly");
    }
    if (!map->count)
        simTextAdd(out, " none");
    for (function = 1; function < 128; function++) {
        if (!map->without[function])
            continue;
        simTextAdd(out, "%s%u", separator, function);
        separator = ",";
    }
}
