/* simMemory: the memory of one PLC: data blocks, their addresses and types. It does not know what
 * the bytes are for, nor of the network.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <cantProceed.h>

#include "simLog.h"
#include "simMemory.h"

#define S7STRING_MAX 254 /* characters */

/* ---- blocks ---- */

void simMemoryInit(simMemory *mem, int bigEndian)
{
    memset(mem, 0, sizeof(*mem));
    mem->bigEndian = bigEndian;
}

void simMemoryFree(simMemory *mem)
{
    size_t i;

    for (i = 0; i < mem->count; i++) {
        free(mem->blocks[i]->bytes);
        free(mem->blocks[i]);
    }
    free(mem->blocks);
    simMemoryInit(mem, mem->bigEndian);
}

simBlock *simMemoryFind(const simMemory *mem, unsigned area, unsigned number)
{
    size_t i;

    for (i = 0; i < mem->count; i++)
        if (mem->blocks[i]->area == area && mem->blocks[i]->number == number)
            return mem->blocks[i];
    return NULL;
}

simBlock *simMemoryFindName(const simMemory *mem, const char *name)
{
    size_t i;

    if (!name[0])
        return NULL;
    if (!strcasecmp(name, "in"))
        name = "IE_TX";
    else if (!strcasecmp(name, "out"))
        name = "IE_RX";
    for (i = 0; i < mem->count; i++)
        if (!strcasecmp(mem->blocks[i]->name, name))
            return mem->blocks[i];
    return NULL;
}

simBlock *simMemoryAdd(simMemory *mem, unsigned area, unsigned number, size_t size,
                       const char *name)
{
    simBlock *block;

    if (size < 1 || size > SIM_MAX_BLOCK || simMemoryFind(mem, area, number))
        return NULL;
    mem->blocks = realloc(mem->blocks, (mem->count + 1) * sizeof(*mem->blocks));
    if (!mem->blocks)
        cantProceed("simMemoryAdd: out of memory");
    block = callocMustSucceed(1, sizeof(*block), "simMemoryAdd");
    block->bytes = callocMustSucceed(1, size, "simMemoryAdd");
    block->area = area;
    block->number = number;
    block->size = size;
    snprintf(block->name, sizeof(block->name), "%s", name ? name : "");
    mem->blocks[mem->count++] = block;
    return block;
}

const char *simBlockName(const simBlock *block)
{
    static char texts[4][64];
    static unsigned next;
    char *text = texts[next++ % 4];

    if (block->area != SIM_AREA_DB)
        snprintf(text, sizeof(texts[0]), "%c",
                 block->area == SIM_AREA_I   ? 'I'
                 : block->area == SIM_AREA_Q ? 'Q'
                                             : 'M');
    else if (block->name[0])
        snprintf(text, sizeof(texts[0]), "DB%u (%s)", block->number, block->name);
    else
        snprintf(text, sizeof(texts[0]), "DB%u", block->number);
    return text;
}

/* ---- types ---- */

static const simTypeInfo types[] = {
    {"BOOL",          simBool,     1 },
    {"INT8",          simInteger,  1 },
    {"UINT8",         simUnsigned, 1 },
    {"INT16",         simInteger,  2 },
    {"UINT16",        simUnsigned, 2 },
    {"INT32",         simInteger,  4 },
    {"UINT32",        simUnsigned, 4 },
    {"INT64",         simInteger,  8 },
    {"UINT64",        simUnsigned, 8 },
    {"REAL32",        simReal,     4 },
    {"REAL64",        simReal,     8 },
    {"STRING",        simString,   1 },
    {"S7STRING",      simS7String, 1 },
    {"TIME",          simBcd,      8 },
    {"DTL",           simDtl,      12},
    /* other names of the same */
    {"BYTE",          simUnsigned, 1 },
    {"CHAR",          simUnsigned, 1 },
    {"SINT",          simInteger,  1 },
    {"USINT",         simUnsigned, 1 },
    {"INT",           simInteger,  2 },
    {"UINT",          simUnsigned, 2 },
    {"WORD",          simUnsigned, 2 },
    {"DATE",          simUnsigned, 2 },
    {"S5TIME",        simUnsigned, 2 },
    {"DINT",          simInteger,  4 },
    {"UDINT",         simUnsigned, 4 },
    {"DWORD",         simUnsigned, 4 },
    {"TIME_OF_DAY",   simUnsigned, 4 },
    {"TOD",           simUnsigned, 4 },
    {"LINT",          simInteger,  8 },
    {"ULINT",         simUnsigned, 8 },
    {"LWORD",         simUnsigned, 8 },
    {"LTIME",         simInteger,  8 },
    {"LTOD",          simUnsigned, 8 },
    {"LDT",           simInteger,  8 },
    {"REAL",          simReal,     4 },
    {"LREAL",         simReal,     8 },
    {"DATE_AND_TIME", simBcd,      8 },
    {"DT",            simBcd,      8 },
};

static const simTypeInfo *findType(const char *name, size_t length)
{
    size_t i;

    for (i = 0; i < sizeof(types) / sizeof(types[0]); i++)
        if (strlen(types[i].name) == length && !strncasecmp(types[i].name, name, length))
            return &types[i];
    return NULL;
}

int simTypeParse(const char *text, simType *type, char error[SIM_ERROR_SIZE])
{
    size_t length = strcspn(text, "[");
    char *end;
    unsigned long count = 1;

    type->info = findType(text, length);
    if (!type->info)
        return simFail(
            error,
            "\"%.40s\" is no type: allowed are BOOL INT8 UINT8 INT16 UINT16 INT32 "
            "UINT32 INT64 UINT64 REAL32 REAL64 STRING[n] S7STRING[n] TIME DTL, and IEC names",
            text);
    if (text[length] == '[') {
        errno = 0;
        count = strtoul(text + length + 1, &end, 0);
        if (!isdigit((unsigned char)text[length + 1]) || errno || strcmp(end, "]") ||
            count < 1 || count > SIM_MAX_BLOCK)
            return simFail(error, "\"%.40s\": the number in [ ] must be 1 ... %u", text,
                           SIM_MAX_BLOCK);
    } else if (type->info->kind == simString) {
        count = 40;
    } else if (type->info->kind == simS7String) {
        count = S7STRING_MAX;
    }
    if (type->info->kind == simS7String && count > S7STRING_MAX)
        return simFail(error, "\"%.40s\": an S7STRING has 1 ... %d characters", text,
                       S7STRING_MAX);
    if (count > 1 && (type->info->kind == simBcd || type->info->kind == simDtl ||
                      type->info->kind == simBool))
        return simFail(error, "\"%.40s\": no arrays of %s", text, type->info->name);
    type->count = count;
    return 0;
}

size_t simTypeSize(const simType *type)
{
    return type->info->size * type->count +
           (type->info->kind == simS7String ? SIM_S7STRING_HEAD : 0);
}

/* ---- places ---- */

/* A number without sign, decimal or 0x hex, that ends at one of the characters `stop`. */
static int number(const char **text, const char *stop, unsigned long max,
                  unsigned long *value)
{
    char *end;

    if (!isdigit((unsigned char)**text))
        return -1;
    errno = 0;
    *value =
        strtoul(*text, &end, (*text)[0] == '0' && tolower((*text)[1]) == 'x' ? 16 : 10);
    if (errno || *value > max || !(*end == 0 || strchr(stop, *end)))
        return -1;
    *text = end;
    return 0;
}

static const struct width {
    char letter;
    size_t bytes;
} widths[] = {
    {'X', 1},
    {'B', 1},
    {'W', 2},
    {'D', 4},
};

static const struct width *findWidth(char c)
{
    size_t i;

    for (i = 0; i < sizeof(widths) / sizeof(widths[0]); i++)
        if (toupper((unsigned char)c) == widths[i].letter)
            return &widths[i];
    return NULL;
}

/* Offset with an optional bit: "4", "4.3". */
static int offsetAndBit(const char *s, simPlace *place)
{
    unsigned long value;

    if (number(&s, ".", SIM_MAX_BLOCK, &value))
        return -1;
    place->offset = value;
    if (*s == '.') {
        s++;
        if (number(&s, "", 7, &value))
            return -1;
        place->bit = (int)value;
    }
    return 0;
}

/* What stands behind the block: "DBW4", "DBX4.3", "4", "4.3". */
static int placeInBlock(const char *s, simPlace *place)
{
    const struct width *width = NULL;

    if (!strncasecmp(s, "DB", 2)) {
        width = findWidth(s[2]);
        if (!width)
            return -1;
        s += 3;
    }
    if (offsetAndBit(s, place))
        return -1;
    if (!width)
        return 0;
    if ((width->letter == 'X') != (place->bit >= 0))
        return -1;
    place->width = width->bytes;
    return 0;
}

static const struct area {
    char letter;
    unsigned area;
} areas[] = {
    {'M', SIM_AREA_M},
    {'I', SIM_AREA_I},
    {'Q', SIM_AREA_Q},
};

/* "M4.3", "MB4", "MW4", "MD4". Returns 1 when it is one, 0 when it is something else. */
static int placeInArea(const simMemory *mem, const char *s, simPlace *place)
{
    const struct width *width = NULL;
    size_t i;

    for (i = 0; i < sizeof(areas) / sizeof(areas[0]); i++)
        if (toupper((unsigned char)s[0]) == areas[i].letter)
            break;
    if (i == sizeof(areas) / sizeof(areas[0]))
        return 0;
    s++;
    if (!isdigit((unsigned char)*s)) {
        width = findWidth(*s);
        if (!width || width->letter == 'X')
            return 0;
        s++;
    }
    if (offsetAndBit(s, place) || (width && place->bit >= 0))
        return 0;
    place->width = width ? width->bytes : 0;
    place->block = simMemoryFind(mem, areas[i].area, 0);
    return 1;
}

static simBlock *blockByText(const simMemory *mem, const char *text, size_t length)
{
    char name[SIM_NAME_SIZE];
    const char *digits = name + 2;
    unsigned long value;
    simBlock *block;

    if (length >= sizeof(name))
        return NULL;
    memcpy(name, text, length);
    name[length] = 0;
    block = simMemoryFindName(mem, name);
    if (!block && !strncasecmp(name, "DB", 2) && !number(&digits, "", 65535, &value))
        block = simMemoryFind(mem, SIM_AREA_DB, (unsigned)value);
    return block;
}

int simPlaceParse(const simMemory *mem, const char *text, simBlock *byDefault,
                  simPlace *place, char error[SIM_ERROR_SIZE])
{
    static const char allowed[] =
        "allowed are DB10.DBX4.3 DB10.DBB4 DB10.DBW4 DB10.DBD4 DB10.4 in.4 out.4 MB4";
    const char *dot = strchr(text, '.');
    size_t need;

    memset(place, 0, sizeof(*place));
    place->bit = -1;
    if (isdigit((unsigned char)text[0])) {
        place->block = byDefault;
        if (!byDefault)
            return simFail(error, "\"%.60s\" needs a block in front, such as in.%.20s",
                           text, text);
        if (offsetAndBit(text, place))
            return simFail(error, "\"%.60s\" is no address: %s", text, allowed);
    } else if (placeInArea(mem, text, place)) {
        if (!place->block)
            return simFail(error, "\"%.60s\": this PLC has no such memory area", text);
    } else {
        if (!dot)
            return simFail(error, "\"%.60s\" is no address: %s", text, allowed);
        place->block = blockByText(mem, text, (size_t)(dot - text));
        if (!place->block)
            return simFail(error, "\"%.60s\": no block \"%.*s\" in this PLC", text,
                           (int)(dot - text < 40 ? dot - text : 40), text);
        if (placeInBlock(dot + 1, place))
            return simFail(error, "\"%.60s\" is no address: %s", text, allowed);
    }
    need = place->width ? place->width : 1;
    if (place->offset >= place->block->size || need > place->block->size - place->offset)
        return simFail(error, "\"%.60s\" is outside of %s, which has %lu bytes", text,
                       simBlockName(place->block), (unsigned long)place->block->size);
    return 0;
}

int simPlaceCheck(const simPlace *place, const simType *type, char error[SIM_ERROR_SIZE])
{
    size_t size = simTypeSize(type);

    if (type->info->kind != simBool && place->bit >= 0)
        return simFail(error, "the address names a bit, but %s is no BOOL",
                       type->info->name);
    if (type->info->kind == simBool && place->bit < 0)
        return simFail(error, "BOOL needs an address with a bit, such as DB10.DBX4.3");
    if (place->width && place->width != size)
        return simFail(error, "the address is %lu bytes wide, but %s has %lu",
                       (unsigned long)place->width, type->info->name,
                       (unsigned long)size);
    if (place->offset > place->block->size || size > place->block->size - place->offset)
        return simFail(
            error, "%s of %lu bytes at offset %lu is outside of %s, which has %lu bytes",
            type->info->name, (unsigned long)size, (unsigned long)place->offset,
            simBlockName(place->block), (unsigned long)place->block->size);
    return 0;
}

int simPlaceType(const simPlace *place, simType *type, char error[SIM_ERROR_SIZE])
{
    static const char *const byWidth[] = {NULL, "UINT8", "UINT16", NULL, "UINT32"};
    const char *name = place->bit >= 0 ? "BOOL" : byWidth[place->width];

    if (!name)
        return simFail(error, "this address needs a type behind it, such as INT16");
    return simTypeParse(name, type, error);
}
