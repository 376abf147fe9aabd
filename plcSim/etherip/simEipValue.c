/* simEipValue: values of tags as text, for the console and the file. It does not know
 * requests.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>

#include "simEipValue.h"
#include "simValue.h"

/* What simMemory calls this type; NULL = a string or a structure. */
static const char *plainName(const simEipType *type)
{
    static const char *const integers[] = {NULL, "INT8", "INT16", NULL, "INT32"};
    static const char *const naturals[] = {NULL, "UINT8", "UINT16", NULL, "UINT32"};

    switch (type->kind) {
    case eipBool:
        return "BOOL";
    case eipInteger:
        return type->size == 8 ? "INT64" : integers[type->size];
    case eipUnsigned:
        return type->size == 8 ? "UINT64" : naturals[type->size];
    case eipReal:
        return type->size == 8 ? "REAL64" : "REAL32";
    default:
        return NULL;
    }
}

/* One element as simMemory has it: a block that begins there. */
static void elementOf(const simEipPlace *place, size_t index, simBlock *block,
                      simPlace *at, simType *type)
{
    char error[SIM_ERROR_SIZE];

    memset(block, 0, sizeof(*block));
    memset(at, 0, sizeof(*at));
    block->bytes = place->bytes + index * place->type->size;
    block->size = place->type->size;
    at->block = block;
    at->bit = place->type->kind != eipBool ? -1 : place->bit < 0 ? 0 : place->bit;
    simTypeParse(plainName(place->type), type, error);
}

static const simMemory wireOrder; /* little-endian */

/* ---- strings ---- */

static size_t textHead(const simEipType *type)
{
    return type->kind == eipShortText ? 1 : type->kind == eipLongText ? 2 : 4;
}

static int setText(const simEipType *type, epicsUInt8 *p, const char *word,
                   char error[SIM_ERROR_SIZE])
{
    size_t length = strlen(word);

    if (length > type->text)
        return simFail(error, "\"%.40s\": %lu characters, but %s has %lu", word,
                       (unsigned long)length, type->name, (unsigned long)type->text);
    memset(p, 0, type->size);
    simEipPut(p, textHead(type), length);
    /* NOLINTNEXTLINE(bugprone-not-null-terminated-result): its length stands in front */
    memcpy(p + textHead(type), word, length);
    return 0;
}

static void getText(const simEipType *type, const epicsUInt8 *p, simText *out)
{
    size_t length = (size_t)simEipGet(p, textHead(type));
    size_t i;

    if (length > type->text)
        length = type->text;
    p += textHead(type);
    simTextAdd(out, "\"");
    for (i = 0; i < length; i++)
        simTextAdd(out, isprint(p[i]) && p[i] != '"' && p[i] != '\\' ? "%c" : "\\x%02x",
                   p[i]);
    simTextAdd(out, "\"");
}

/* ---- values ---- */

static int setElement(const simEipPlace *place, size_t index, char *word,
                      char error[SIM_ERROR_SIZE])
{
    simBlock block;
    simPlace at;
    simType type;

    if (place->type->text)
        return setText(place->type, place->bytes + index * place->type->size, word,
                       error);
    elementOf(place, index, &block, &at, &type);
    return simValueSet(&wireOrder, &at, &type, &word, 1, error);
}

int simEipValueSet(const simEipPlace *place, char **words, size_t count,
                   char error[SIM_ERROR_SIZE])
{
    size_t all = place->isElement ? 1 : place->elements;
    epicsUInt8 *before;
    int status = 0;
    size_t i;

    if (!place->type->text && !plainName(place->type))
        return simFail(error, "%s is a structure: set its members", place->type->name);
    if (count > 1 && place->isElement && count <= place->elements)
        all = count;
    if (count != 1 && count != all)
        return simFail(error, "%lu value(s) given, but 1 or %lu wanted",
                       (unsigned long)count, (unsigned long)all);
    before = mallocMustSucceed(all * place->type->size, "simEipValueSet");
    memcpy(before, place->bytes, all * place->type->size);
    for (i = 0; i < all && !status; i++)
        status = setElement(place, i, words[count == 1 ? 0 : i], error);
    if (status)
        memcpy(place->bytes, before, all * place->type->size);
    free(before);
    return status;
}

static void getStruct(const simEipType *type, epicsUInt8 *bytes, simText *out)
{
    const char *between = "";
    size_t i;

    simTextAdd(out, "{");
    for (i = 0; i < type->memberCount; i++) {
        const simEipMember *m = &type->members[i];
        simEipPlace inner;

        if (m->hidden)
            continue;
        memset(&inner, 0, sizeof(inner));
        inner.type = m->type;
        inner.bytes = bytes + m->offset;
        inner.bit = m->bit;
        inner.elements = m->count ? m->count : 1;
        inner.isArray = m->count > 0;
        simTextAdd(out, "%s%s=%s", between, m->name, m->count ? "[" : "");
        simEipValueGet(&inner, out);
        simTextAdd(out, m->count ? "]" : "");
        between = " ";
    }
    simTextAdd(out, "}");
}

void simEipValueGet(const simEipPlace *place, simText *out)
{
    size_t all = place->isElement ? 1 : place->elements;
    const char *between = "";
    size_t i;

    for (i = 0; i < all; i++) {
        epicsUInt8 *p = place->bytes + i * place->type->size;
        simBlock block;
        simPlace at;
        simType type;

        simTextAdd(out, "%s", between);
        between = " ";
        if (place->type->text) {
            getText(place->type, p, out);
        } else if (!plainName(place->type)) {
            getStruct(place->type, p, out);
        } else {
            elementOf(place, i, &block, &at, &type);
            simValueGet(&wireOrder, &at, &type, out);
        }
    }
}

int simEipValueSignal(const simMemory *mem, const simEipTag *tag, char **words,
                      size_t count, simSignal *signal, char error[SIM_ERROR_SIZE])
{
    const char *name = plainName(tag->type);
    char *all[SIM_ERROR_SIZE / 2];
    char address[32], type[32];
    size_t i;

    if (!name || (tag->type->kind == eipBool && tag->dimCount))
        return simFail(error, "tag %s: no signals for %s%s", tag->name, tag->type->name,
                       name ? "[]" : "");
    if (count + 2 > sizeof(all) / sizeof(all[0]))
        return simFail(error, "tag %s: too many words", tag->name);
    snprintf(address, sizeof(address), tag->type->kind == eipBool ? "%lu.0" : "%lu",
             (unsigned long)tag->offset);
    if (tag->elements > 1)
        snprintf(type, sizeof(type), "%s[%lu]", name, (unsigned long)tag->elements);
    else
        snprintf(type, sizeof(type), "%s", name);
    all[0] = address;
    all[1] = type;
    for (i = 0; i < count; i++)
        all[2 + i] = words[i];
    return simSignalParse(mem, tag->block, all, count + 2, signal, error);
}
