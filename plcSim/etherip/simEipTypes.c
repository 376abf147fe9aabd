/* simEipTypes: the data types of a Logix controller: elementary ones, strings and
 * structures with their layout and their template. It does not know tags.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <cantProceed.h>

#include "simEipTypes.h"

#define MAX_MEMBERS 500
#define MAX_ELEMENTS 2000000u
#define MEMBER_INFO 8  /* bytes for a member in the template */
#define SHORT_TEXT 80  /* characters of a Micro800 STRING */
#define LONG_TEXT 256  /* characters of an Omron STRING */
#define STRING_TEXT 82 /* characters of a Logix STRING */
#define STRING_TEMPLATE 0xFCE
#define FIRST_TEMPLATE 0x100
#define TEMPLATE_SPAN 3583u /* a prime; ids up to 0xEFE */

static const simEipType elementary[] = {
    {.name = "BOOL",  .kind = eipBool,     .code = 0xC1, .size = 1, .align = 1},
    {.name = "SINT",  .kind = eipInteger,  .code = 0xC2, .size = 1, .align = 1},
    {.name = "INT",   .kind = eipInteger,  .code = 0xC3, .size = 2, .align = 2},
    {.name = "DINT",  .kind = eipInteger,  .code = 0xC4, .size = 4, .align = 4},
    {.name = "LINT",  .kind = eipInteger,  .code = 0xC5, .size = 8, .align = 8},
    {.name = "USINT", .kind = eipUnsigned, .code = 0xC6, .size = 1, .align = 1},
    {.name = "UINT",  .kind = eipUnsigned, .code = 0xC7, .size = 2, .align = 2},
    {.name = "UDINT", .kind = eipUnsigned, .code = 0xC8, .size = 4, .align = 4},
    {.name = "ULINT", .kind = eipUnsigned, .code = 0xC9, .size = 8, .align = 8},
    {.name = "REAL",  .kind = eipReal,     .code = 0xCA, .size = 4, .align = 4},
    {.name = "LREAL", .kind = eipReal,     .code = 0xCB, .size = 8, .align = 8},
    {.name = "BYTE",  .kind = eipUnsigned, .code = 0xD1, .size = 1, .align = 1},
    {.name = "WORD",  .kind = eipUnsigned, .code = 0xD2, .size = 2, .align = 2},
    {.name = "DWORD", .kind = eipUnsigned, .code = 0xD3, .size = 4, .align = 4},
    {.name = "LWORD", .kind = eipUnsigned, .code = 0xD4, .size = 8, .align = 8},
};

/* Omron's own; the values of DATE_NSEC and those like it are nanoseconds. */
static const simEipType omrons[] = {
    {.name = "ENUM",               .kind = eipInteger, .code = 0x07, .size = 4, .align = 4},
    {.name = "DATE_NSEC",          .kind = eipInteger, .code = 0x08, .size = 8, .align = 8},
    {.name = "TIME_NSEC",          .kind = eipInteger, .code = 0x09, .size = 8, .align = 8},
    {.name = "DATE_AND_TIME_NSEC", .kind = eipInteger, .code = 0x0A, .size = 8, .align = 8},
    {.name = "TIME_OF_DAY_NSEC",   .kind = eipInteger, .code = 0x0B, .size = 8, .align = 8},
};

static const simEipType shortText = {.name = "STRING",
                                     .kind = eipShortText,
                                     .code = 0xDA,
                                     .size = 1 + SHORT_TEXT,
                                     .align = 1,
                                     .text = SHORT_TEXT};
static const simEipType longText = {.name = "STRING",
                                    .kind = eipLongText,
                                    .code = 0xD0,
                                    .size = 2 + LONG_TEXT,
                                    .align = 2,
                                    .text = LONG_TEXT};

/* ---- bytes ---- */

void simEipPut(epicsUInt8 *p, size_t size, epicsUInt64 value)
{
    size_t i;

    for (i = 0; i < size; i++)
        p[i] = (epicsUInt8)(value >> 8 * i);
}

epicsUInt64 simEipGet(const epicsUInt8 *p, size_t size)
{
    epicsUInt64 value = 0;

    while (size-- > 0)
        value = value << 8 | p[size];
    return value;
}

/* ---- finding ---- */

static const simEipType *findElementary(const char *name)
{
    size_t i;

    for (i = 0; i < sizeof(elementary) / sizeof(elementary[0]); i++)
        if (!strcasecmp(name, elementary[i].name))
            return &elementary[i];
    return NULL;
}

static int isOmron(const simEipTypes *types)
{
    return types->string == &longText;
}

const simEipType *simEipTypeFind(const simEipTypes *types, const char *name)
{
    size_t i;

    if (!strcasecmp(name, "STRING"))
        return types->string;
    for (i = 0; i < types->count; i++)
        if (!strcasecmp(name, types->list[i]->name))
            return types->list[i];
    for (i = 0; isOmron(types) && i < sizeof(omrons) / sizeof(omrons[0]); i++)
        if (!strcasecmp(name, omrons[i].name))
            return &omrons[i];
    return findElementary(name);
}

unsigned simEipTemplateId(const simEipTypes *types, const simEipType *type)
{
    if (type->predefined)
        return type->predefined;
    return FIRST_TEMPLATE +
           ((unsigned)type->index * 7 + types->shift * 53) % TEMPLATE_SPAN;
}

const simEipType *simEipTemplateFind(const simEipTypes *types, unsigned id)
{
    size_t i;

    for (i = 0; i < types->count; i++)
        if (simEipTemplateId(types, types->list[i]) == id)
            return types->list[i];
    return NULL;
}

unsigned simEipTypeWord(const simEipTypes *types, const simEipType *type, int dimensions)
{
    unsigned word = (unsigned)dimensions << 13;

    if (type->kind == eipStruct)
        return word | 0x8000u | simEipTemplateId(types, type);
    return word | type->code;
}

/* ---- parsing ---- */

static int dimension(const char **text, unsigned *value)
{
    char *end;
    unsigned long n;

    if (!isdigit((unsigned char)**text))
        return -1;
    n = strtoul(*text, &end, 10);
    if (n < 1 || n > MAX_ELEMENTS)
        return -1;
    *value = (unsigned)n;
    *text = end;
    return 0;
}

/* "[2,3,4]" */
static int dimensions(const char *text, unsigned dims[3])
{
    int i;

    for (i = 0; i < 3; i++) {
        text++;
        if (dimension(&text, &dims[i]))
            return -1;
        if (*text == ']')
            return text[1] ? -1 : 0;
        if (*text != ',')
            return -1;
    }
    return -1;
}

int simEipTypeParse(const simEipTypes *types, const char *text, const simEipType **type,
                    unsigned dims[3], char error[SIM_ERROR_SIZE])
{
    size_t length = strcspn(text, "[");
    char name[SIM_EIP_NAME];

    dims[0] = dims[1] = dims[2] = 0;
    snprintf(name, sizeof(name), "%.*s", (int)length, text);
    *type = length < sizeof(name) ? simEipTypeFind(types, name) : NULL;
    if (!*type)
        return simFail(error,
                       "\"%.40s\" is no type: allowed are BOOL SINT INT DINT LINT USINT "
                       "UINT UDINT ULINT REAL LREAL BYTE WORD DWORD LWORD STRING, and "
                       "what a udt statement above made",
                       text);
    if (!text[length])
        return 0;
    if (dimensions(text + length, dims))
        return simFail(error,
                       "\"%.40s\": dimensions are [n], [n,m] or [n,m,k], each from 1 on",
                       text);
    if ((epicsUInt64)dims[0] * (dims[1] ? dims[1] : 1) * (dims[2] ? dims[2] : 1) >
        MAX_ELEMENTS)
        return simFail(error, "\"%.40s\": more than %u elements", text, MAX_ELEMENTS);
    if ((*type)->kind != eipBool || isOmron(types))
        return 0; /* Omron has arrays of BOOL, one byte each here */
    if (dims[1] || dims[0] % 32)
        return simFail(error,
                       "\"%.40s\": an array of BOOL has one dimension, a multiple of 32",
                       text);
    *type = findElementary("DWORD");
    dims[0] /= 32;
    return 0;
}

/* ---- building structures ---- */

static size_t aligned(size_t offset, size_t align)
{
    return (offset + align - 1) / align * align;
}

static simEipMember *addMember(simEipType *type, const char *name, const simEipType *what,
                               size_t count)
{
    simEipMember *m;

    type->members = realloc(type->members, (type->memberCount + 1) * sizeof(*m));
    if (!type->members)
        cantProceed("simEipTypes: out of memory");
    m = &type->members[type->memberCount++];
    memset(m, 0, sizeof(*m));
    snprintf(m->name, sizeof(m->name), "%s", name);
    m->type = what;
    m->count = count;
    m->bit = -1;
    return m;
}

/* Places a member that is no BOOL behind those that are there. */
static void place(simEipType *type, simEipMember *m)
{
    size_t align = m->type->align;

    if ((m->count || m->type->kind == eipStruct) && align < 4)
        align = 4;
    m->offset = aligned(type->size, align);
    type->size = m->offset + m->type->size * (m->count ? m->count : 1);
    if (align > type->align)
        type->align = align;
}

/* A BOOL goes into the hidden SINT of the BOOL before it, or into a new one. */
static void placeBool(simEipType *type, const char *name)
{
    const simEipMember *last =
        type->memberCount ? &type->members[type->memberCount - 1] : NULL;
    int bit = last && last->bit >= 0 ? last->bit + 1 : 8;
    size_t offset = last ? last->offset : 0;
    char host[SIM_EIP_NAME];
    simEipMember *m;

    if (bit == 8) {
        snprintf(host, sizeof(host), "ZZZZZZZZZZ%.20s%lu", type->name,
                 (unsigned long)type->memberCount);
        m = addMember(type, host, findElementary("SINT"), 0);
        m->hidden = 1;
        place(type, m);
        offset = m->offset;
        bit = 0;
    }
    m = addMember(type, name, findElementary("BOOL"), 0);
    m->offset = offset;
    m->bit = bit;
}

static unsigned crc16(unsigned crc, const void *bytes, size_t size)
{
    const epicsUInt8 *p = bytes;
    int i;

    while (size-- > 0) {
        crc ^= *p++;
        for (i = 0; i < 8; i++)
            crc = crc & 1 ? crc >> 1 ^ 0xA001 : crc >> 1;
    }
    return crc;
}

/* The handle tells one layout from another; no two types here share one. */
static void makeHandle(const simEipTypes *types, simEipType *type)
{
    size_t i;

    type->handle = crc16(0xFFFF, type->name, strlen(type->name));
    for (i = 0; i < type->memberCount; i++) {
        const simEipMember *m = &type->members[i];

        type->handle = crc16(type->handle, m->name, strlen(m->name));
        type->handle = crc16(type->handle, m->type->name, strlen(m->type->name));
        type->handle = crc16(type->handle, &m->count, sizeof(m->count));
    }
    for (i = 0; i < types->count; i++) {
        if (types->list[i]->handle == type->handle || !type->handle) {
            type->handle = (type->handle + 1) & 0xFFFF;
            i = (size_t)-1; /* once more from the first */
        }
    }
}

/* Names and member infos; type words hold template ids, so this is made anew when they
 * change. */
static void makeDefinition(const simEipTypes *types, simEipType *type)
{
    size_t size = type->memberCount * MEMBER_INFO + 1;
    simText names = {NULL, 0, 0};
    epicsUInt8 *p;
    size_t i;

    simTextAdd(&names, "%s", type == types->string ? "ASCIISTRING82" : type->name);
    if (!type->predefined) {
        simTextAdd(&names, ";n");
        for (i = 0; i < type->memberCount; i++)
            simTextAdd(&names, type->members[i].hidden ? "E@" : "EA");
    }
    size += names.length;
    for (i = 0; i < type->memberCount; i++)
        size += strlen(type->members[i].name) + 1;
    size = aligned(size + 3, 4); /* browsers read 4 x words - 23 bytes */
    free(type->definition);
    p = type->definition = callocMustSucceed(1, size, "simEipTypes");
    type->definitionSize = size;
    for (i = 0; i < type->memberCount; i++, p += MEMBER_INFO) {
        const simEipMember *m = &type->members[i];

        simEipPut(p, 2, m->bit >= 0 ? (unsigned)m->bit : m->count);
        simEipPut(p + 2, 2, simEipTypeWord(types, m->type, m->count > 0));
        simEipPut(p + 4, 4, m->offset);
    }
    memcpy(p, names.text, names.length);
    p += names.length + 1;
    for (i = 0; i < type->memberCount; i++) {
        strcpy((char *)p, type->members[i].name);
        p += strlen(type->members[i].name) + 1;
    }
    simTextFree(&names);
}

static void freeType(simEipType *type)
{
    free(type->members);
    free(type->definition);
    free(type);
}

static simEipType *newType(const simEipTypes *types, const char *name)
{
    simEipType *type = callocMustSucceed(1, sizeof(*type), "simEipTypes");

    snprintf(type->name, sizeof(type->name), "%s", name);
    type->kind = eipStruct;
    type->code = SIM_EIP_STRUCT;
    type->index = (int)types->count;
    type->align = 4;
    return type;
}

static void addType(simEipTypes *types, simEipType *type)
{
    type->size = aligned(type->size, type->align);
    if (!type->predefined)
        makeHandle(types, type);
    makeDefinition(types, type);
    types->list = realloc(types->list, (types->count + 1) * sizeof(*types->list));
    if (!types->list)
        cantProceed("simEipTypes: out of memory");
    types->list[types->count++] = type;
}

/* LEN and DATA. */
static void makeString(simEipType *type, size_t text)
{
    type->text = text;
    place(type, addMember(type, "LEN", findElementary("DINT"), 0));
    place(type, addMember(type, "DATA", findElementary("SINT"), text));
}

void simEipTypesShift(simEipTypes *types)
{
    size_t i;

    types->shift++;
    for (i = 0; i < types->count; i++)
        makeDefinition(types, types->list[i]);
}

/* TIMER and COUNTER: a word of bits, a preset and what has been counted. */
static void addCounters(simEipTypes *types)
{
    static const struct counter {
        const char *name;
        unsigned id;         /* of its template, and its handle */
        const char *bits[6]; /* from bit 31 of the word down */
    } counters[] = {
        {"TIMER",   0xF83, {"EN", "TT", "DN"}            },
        {"COUNTER", 0xF82, {"CU", "CD", "DN", "OV", "UN"}},
    };
    size_t i;
    int k;

    for (i = 0; i < sizeof(counters) / sizeof(counters[0]); i++) {
        simEipType *type = newType(types, counters[i].name);

        type->predefined = type->handle = counters[i].id;
        place(type, addMember(type, "CTL", findElementary("DINT"), 0));
        type->members[0].hidden = 1;
        place(type, addMember(type, "PRE", findElementary("DINT"), 0));
        place(type, addMember(type, "ACC", findElementary("DINT"), 0));
        for (k = 0; counters[i].bits[k]; k++) {
            simEipMember *m =
                addMember(type, counters[i].bits[k], findElementary("BOOL"), 0);

            m->offset = 3; /* the last byte of CTL */
            m->bit = 7 - k;
        }
        addType(types, type);
    }
}

/* ---- statements ---- */

static int isName(const char *name)
{
    const char *p;

    if (!isalpha((unsigned char)name[0]) && name[0] != '_')
        return 0;
    for (p = name; *p; p++)
        if (!isalnum((unsigned char)*p) && *p != '_')
            return 0;
    return p - name < SIM_EIP_NAME;
}

static int hasMember(const simEipType *type, const char *name)
{
    size_t i;

    for (i = 0; i < type->memberCount; i++)
        if (!strcasecmp(type->members[i].name, name))
            return 1;
    return 0;
}

/* "Position:REAL", "Counts:INT[5]" */
static int parseMember(const simEipTypes *types, simEipType *type, const char *word,
                       char error[SIM_ERROR_SIZE])
{
    const char *colon = strchr(word, ':');
    const simEipType *what;
    char name[SIM_EIP_NAME];
    unsigned dims[3];

    snprintf(name, sizeof(name), "%.*s", colon ? (int)(colon - word) : 0, word);
    if (!colon || !isName(name) || (size_t)(colon - word) >= sizeof(name))
        return simFail(error, "udt %s: \"%.40s\": a member is <name>:<type>", type->name,
                       word);
    if (hasMember(type, name))
        return simFail(error, "udt %s: two members %s", type->name, name);
    if (simEipTypeParse(types, colon + 1, &what, dims, error))
        return -1;
    if (dims[1])
        return simFail(error, "udt %s: a member has one dimension", type->name);
    if (type->memberCount >= MAX_MEMBERS ||
        /* NOLINTNEXTLINE(clang-analyzer-core.NullDereference): a failed parse is not 0 */
        what->size * (dims[0] ? dims[0] : 1) > MAX_ELEMENTS - type->size)
        return simFail(error, "udt %s is too large", type->name);
    if (what->kind == eipBool && !dims[0])
        placeBool(type, name);
    else
        place(type, addMember(type, name, what, dims[0]));
    return 0;
}

int simEipTypeStatement(simEipTypes *types, char **words, size_t count,
                        char error[SIM_ERROR_SIZE])
{
    simEipType *type;
    int status = 0;
    size_t i;

    if (count < 2 || !isName(words[0]))
        return simFail(error,
                       "udt wants: <name> <member>:<type> ..., or <name> string <n>");
    if (simEipTypeFind(types, words[0]))
        return simFail(error, "there is a type %s already", words[0]);
    if (types->count >= TEMPLATE_SPAN)
        return simFail(error, "more than %u types", TEMPLATE_SPAN);
    type = newType(types, words[0]);
    if (!strcasecmp(words[1], "string")) {
        unsigned long text = count == 3 ? strtoul(words[2], NULL, 10) : 0;

        if (text < 1 || text > 65535)
            status =
                simFail(error, "udt %s string wants: <characters 1 ... 65535>", words[0]);
        else
            makeString(type, text);
    } else {
        for (i = 1; i < count && !status; i++)
            status = parseMember(types, type, words[i], error);
    }
    if (status)
        freeType(type);
    else
        addType(types, type);
    return status;
}

void simEipTypesInit(simEipTypes *types, simEipStrings strings)
{
    simEipType *type;

    memset(types, 0, sizeof(*types));
    types->string = strings == eipStringShort  ? &shortText
                    : strings == eipStringLong ? &longText
                                               : NULL;
    if (types->string)
        return;
    type = newType(types, "STRING");
    type->predefined = STRING_TEMPLATE;
    type->handle = SIM_EIP_STRING_HANDLE;
    makeString(type, STRING_TEXT);
    types->string = type;
    addType(types, type);
    addCounters(types);
}

void simEipTypesFree(simEipTypes *types)
{
    size_t i;

    for (i = 0; i < types->count; i++)
        freeType(types->list[i]);
    free(types->list);
    memset(types, 0, sizeof(*types));
}
