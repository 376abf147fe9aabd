/* simAny: ANY pointers; see simAny.h.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "simAny.h"
#include "simValue.h"

static const struct anyType {
    const char *name;
    epicsUInt8 code;
    size_t bits; /* of one element */
} anyTypes[] = {
    {"BOOL",          0x01, 1 },
    {"BYTE",          0x02, 8 },
    {"CHAR",          0x03, 8 },
    {"WORD",          0x04, 16},
    {"INT",           0x05, 16},
    {"DWORD",         0x06, 32},
    {"DINT",          0x07, 32},
    {"REAL",          0x08, 32},
    {"DATE",          0x09, 16},
    {"TIME_OF_DAY",   0x0a, 32},
    {"TIME",          0x0b, 32},
    {"S5TIME",        0x0c, 16},
    {"DATE_AND_TIME", 0x0e, 64},
};

#define ANY_TYPES (sizeof(anyTypes) / sizeof(anyTypes[0]))

static const struct anyType *anyType(epicsUInt8 code)
{
    size_t i;

    for (i = 0; i < ANY_TYPES; i++)
        if (anyTypes[i].code == code)
            return &anyTypes[i];
    return NULL;
}

size_t simAnySize(const simAny *any)
{
    const struct anyType *type = anyType(any->type);

    return type ? (type->bits * any->count + 7) / 8 : 0;
}

void simAnyEncode(const simAny *any, epicsUInt8 bytes[SIM_ANY])
{
    bytes[0] = 0x10;
    bytes[1] = any->type;
    simPutInt(bytes + 2, 2, 1, any->count);
    simPutInt(bytes + 4, 2, 1, any->db);
    simPutInt(bytes + 6, 4, 1, (epicsUInt32)any->area << 24 | any->bit);
}

void simAnyDecode(const epicsUInt8 bytes[SIM_ANY], simAny *any)
{
    epicsUInt32 pointer = (epicsUInt32)simGetInt(bytes + 6, 4, 1);

    any->type = bytes[1];
    any->count = (epicsUInt16)simGetInt(bytes + 2, 2, 1);
    any->db = (epicsUInt16)simGetInt(bytes + 4, 2, 1);
    any->area = (epicsUInt8)(pointer >> 24);
    any->bit = pointer & 0xffffff;
}

/* "DB2.DBX4.0", "M4.0", "I4.0", "Q4.0" */
static int anyAddress(const char *text, simAny *any)
{
    static const struct {
        const char *format;
        epicsUInt8 area;
    } forms[] = {
        {"%*1[Mm]%u.%u%c", SIM_AREA_M},
        {"%*1[Ii]%u.%u%c", SIM_AREA_I},
        {"%*1[Qq]%u.%u%c", SIM_AREA_Q},
    };
    unsigned db, byte, bit;
    char rest;
    size_t i;

    if (strlen(text) > 24)
        return -1;
    if (sscanf(text, "%*1[Dd]%*1[Bb]%5u.%*1[Dd]%*1[Bb]%*1[Xx]%5u.%1u%c", &db, &byte, &bit,
               &rest) == 3) {
        any->area = SIM_AREA_DB;
    } else {
        db = 0;
        for (i = 0; i < sizeof(forms) / sizeof(forms[0]); i++)
            if (sscanf(text, forms[i].format, &byte, &bit, &rest) == 2)
                break;
        if (i == sizeof(forms) / sizeof(forms[0]))
            return -1;
        any->area = forms[i].area;
    }
    if (db > 65535 || byte > 65535 || bit > 7)
        return -1;
    any->db = (epicsUInt16)db;
    any->bit = byte * 8 + bit;
    return 0;
}

int simAnyParse(char **words, simAny *any, char error[SIM_ERROR_SIZE])
{
    unsigned long count;
    char *end;
    size_t i;

    memset(any, 0, sizeof(*any));
    if (strncasecmp(words[0], "P#", 2) || anyAddress(words[0] + 2, any))
        return simFail(error,
                       "\"%.40s\" is no pointer: it looks like P#DB2.DBX4.0 BYTE 34",
                       words[0]);
    for (i = 0; i < ANY_TYPES && strcasecmp(words[1], anyTypes[i].name); i++)
        ;
    if (i == ANY_TYPES)
        return simFail(error, "\"%.40s\" is no type of an ANY pointer", words[1]);
    any->type = anyTypes[i].code;
    errno = 0;
    count = strtoul(words[2], &end, 10);
    if (!isdigit((unsigned char)words[2][0]) || *end || errno || count < 1 ||
        count > 65535)
        return simFail(error, "\"%.40s\": the length of a pointer is 1 ... 65535",
                       words[2]);
    any->count = (epicsUInt16)count;
    return 0;
}

unsigned simAnyBytes(const simMemory *memory, const epicsUInt8 *bytes, epicsUInt8 **target,
                     size_t *size)
{
    simAny any;
    simBlock *block;

    simAnyDecode(bytes, &any);
    *size = simAnySize(&any);
    if (bytes[0] != 0x10 || !*size)
        return 0x01;
    if (any.area != SIM_AREA_DB && any.area != SIM_AREA_M && any.area != SIM_AREA_I &&
        any.area != SIM_AREA_Q)
        return 0x24;
    if (any.bit % 8 || (any.type == 0x01 && any.count % 8))
        return 0x28;
    block = simMemoryFind(memory, any.area, any.area == SIM_AREA_DB ? any.db : 0);
    if (!block)
        return 0x3a;
    if (any.bit / 8 > block->size || *size > block->size - any.bit / 8)
        return 0x22;
    *target = block->bytes + any.bit / 8;
    return 0;
}

const char *simAnyError(unsigned code)
{
    static const struct {
        unsigned code;
        const char *text;
    } texts[] = {
        {0x01, "no valid ANY pointer"       },
        {0x22, "beyond the end of the block"},
        {0x23, "lengths differ"             },
        {0x24, "wrong area"                 },
        {0x28, "not on a byte boundary"     },
        {0x3a, "no such data block"         },
    };
    size_t i = 0;

    while (i + 1 < sizeof(texts) / sizeof(texts[0]) && texts[i].code != (code & 0xff))
        i++;
    return texts[i].text;
}
