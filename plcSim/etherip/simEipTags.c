/* simEipTags: the named tags of a controller and where their bytes lie. It does not know
 * requests.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <cantProceed.h>
#include <gpHash.h>

#include "simEipTags.h"

#define PROGRAM "Program:"
#define PROGRAM_WORD 0x1068 /* type word of a program's entry in the list */
#define SYMBOL_CLASS 0x6B
#define ID_STEP 4 /* ids of four generations have no one in common */

/* ---- the table ---- */

static void lower(const char *name, char *out, size_t size)
{
    size_t i;

    for (i = 0; name[i] && i + 1 < size; i++)
        out[i] = (char)tolower((unsigned char)name[i]);
    out[i] = 0;
}

void simEipTagsInit(simEipTags *tags, simEipTypes *types, simMemory *memory)
{
    memset(tags, 0, sizeof(*tags));
    tags->types = types;
    tags->memory = memory;
    gphInitPvt(&tags->names, 16384);
}

void simEipTagFree(simEipTag *tag)
{
    size_t i;

    for (i = 0; i < tag->initialCount; i++)
        free(tag->initial[i]);
    free(tag->initial);
    free(tag->own.bytes);
    free(tag);
}

void simEipTagsFree(simEipTags *tags)
{
    size_t i;

    for (i = 0; i < tags->count; i++)
        simEipTagFree(tags->list[i]);
    free(tags->list);
    if (tags->names)
        gphFreeMem(tags->names);
    memset(tags, 0, sizeof(*tags));
}

simEipTag *simEipTagFind(const simEipTags *tags, const char *name)
{
    char key[SIM_EIP_FULL_NAME];
    GPHENTRY *entry;

    if (strlen(name) >= sizeof(key))
        return NULL;
    lower(name, key, sizeof(key));
    entry = gphFind(tags->names, key, NULL);
    return entry ? entry->userPvt : NULL;
}

/* Orders only rise, so that the list is sorted by instance id. */
static size_t nextOrder(const simEipTags *tags)
{
    return tags->count ? tags->list[tags->count - 1]->order + 1 : 0;
}

static simEipTag *newTag(simEipTags *tags, const char *name)
{
    simEipTag *tag = callocMustSucceed(1, sizeof(*tag), "simEipTags");
    GPHENTRY *entry;

    snprintf(tag->name, sizeof(tag->name), "%s", name);
    lower(name, tag->key, sizeof(tag->key));
    tag->elements = 1;
    tag->order = nextOrder(tags);
    tags->list = realloc(tags->list, (tags->count + 1) * sizeof(*tags->list));
    if (!tags->list)
        cantProceed("simEipTags: out of memory");
    tags->list[tags->count++] = tag;
    entry = gphAdd(tags->names, tag->key, NULL);
    if (entry)
        entry->userPvt = tag;
    return tag;
}

void simEipTagsEntry(simEipTags *tags, const char *name, unsigned word)
{
    simEipTag *tag = newTag(tags, name);
    const char *dot = strncmp(name, PROGRAM, strlen(PROGRAM)) ? NULL : strchr(name, '.');

    tag->word = word;
    tag->scope = dot ? (size_t)(dot - name) + 1 : 0;
}

simEipTag *simEipTagTake(simEipTags *tags, const char *name)
{
    simEipTag *tag = simEipTagFind(tags, name);
    size_t i;

    if (!tag)
        return NULL;
    gphDelete(tags->names, tag->key, NULL);
    for (i = 0; tags->list[i] != tag; i++)
        ;
    tags->count--;
    memmove(tags->list + i, tags->list + i + 1, (tags->count - i) * sizeof(*tags->list));
    return tag;
}

void simEipTagPutBack(simEipTags *tags, simEipTag *tag)
{
    GPHENTRY *entry = gphAdd(tags->names, tag->key, NULL);
    size_t i = tags->count;

    if (entry)
        entry->userPvt = tag;
    tags->list = realloc(tags->list, (tags->count + 1) * sizeof(*tags->list));
    if (!tags->list)
        cantProceed("simEipTags: out of memory");
    for (; i > 0 && tags->list[i - 1]->order > tag->order; i--)
        tags->list[i] = tags->list[i - 1];
    tags->list[i] = tag;
    tags->count++;
}

int simEipTagRemove(simEipTags *tags, const char *name)
{
    simEipTag *tag = simEipTagTake(tags, name);

    if (!tag)
        return -1;
    simEipTagFree(tag);
    return 0;
}

epicsUInt8 *simEipTagBytes(const simEipTag *tag)
{
    return tag->block->bytes + tag->offset;
}

size_t simEipTagSize(const simEipTag *tag)
{
    return tag->type->size * tag->elements;
}

const char *simEipTagName(const simEipTag *tag)
{
    return tag->name + tag->scope;
}

/* ---- instance ids ---- */

unsigned simEipTagId(const simEipTags *tags, const simEipTag *tag)
{
    return (unsigned)(ID_STEP * (tag->order + tags->shifts) + tags->generation % ID_STEP +
                      1);
}

simEipTag *simEipTagById(const simEipTags *tags, unsigned id)
{
    size_t low = 0, high = tags->count;

    while (low < high) {
        size_t middle = (low + high) / 2;
        unsigned at = simEipTagId(tags, tags->list[middle]);

        if (at == id)
            return tags->list[middle];
        if (at < id)
            low = middle + 1;
        else
            high = middle;
    }
    return NULL;
}

void simEipTagsDownload(simEipTags *tags, int shift)
{
    size_t i;

    if (shift)
        tags->shifts++;
    else
        tags->generation++;
    simEipTypesShift(tags->types);
    for (i = 0; i < tags->count; i++)
        tags->list[i]->order = i;
}

/* ---- statements ---- */

static int isNamePart(const char *name, size_t length)
{
    size_t i;

    if (!length || length >= SIM_EIP_NAME ||
        (!isalpha((unsigned char)name[0]) && name[0] != '_'))
        return 0;
    /* I/O tags have colons: Local:2:I */
    for (i = 0; i < length; i++)
        if (!isalnum((unsigned char)name[i]) && name[i] != '_' && name[i] != ':')
            return 0;
    return 1;
}

/* Characters of "Program:Main." in front, 0 = none, -1 = this is no name. */
static int scopeOf(const char *name)
{
    const char *dot = strchr(name, '.');
    size_t program = strlen(PROGRAM);

    if (strncasecmp(name, PROGRAM, program) || !dot)
        return dot || !isNamePart(name, strlen(name)) ||
                       !strncasecmp(name, PROGRAM, program)
                   ? -1
                   : 0;
    if (!isNamePart(name + program, (size_t)(dot - name) - program) ||
        !isNamePart(dot + 1, strlen(dot + 1)))
        return -1;
    return (int)(dot - name) + 1;
}

/* The program's own entry in the list of tags. */
static void needProgram(simEipTags *tags, const char *name, int scope)
{
    char program[SIM_EIP_FULL_NAME];

    snprintf(program, sizeof(program), "%.*s", scope - 1, name);
    if (!simEipTagFind(tags, program))
        simEipTagsEntry(tags, program, PROGRAM_WORD);
}

/* "-> DB10.4" */
static int mapTag(simEipTags *tags, simEipTag *tag, const char *address,
                  char error[SIM_ERROR_SIZE])
{
    simPlace place;

    if (simPlaceParse(tags->memory, address, NULL, &place, error))
        return -1;
    if (place.bit >= 0)
        return simFail(error, "tag %s: %s names a bit", tag->name, address);
    if (simEipTagSize(tag) > place.block->size - place.offset)
        return simFail(error,
                       "tag %s: %lu bytes from %s on are outside of %s, which has "
                       "%lu bytes",
                       tag->name, (unsigned long)simEipTagSize(tag), address,
                       simBlockName(place.block), (unsigned long)place.block->size);
    tag->block = place.block;
    tag->offset = place.offset;
    return 0;
}

static void ownBytes(simEipTag *tag)
{
    tag->own.size = simEipTagSize(tag);
    tag->own.bytes = callocMustSucceed(1, tag->own.size, "simEipTags");
    snprintf(tag->own.name, sizeof(tag->own.name), "%.30s", tag->name);
    tag->block = &tag->own;
}

/* Where it lies and who may touch it. */
static int tagOptions(simEipTags *tags, simEipTag *tag, char **words, size_t count,
                      size_t *used, char error[SIM_ERROR_SIZE])
{
    if (*used < count && !strcmp(words[*used], "->")) {
        if (*used + 1 == count)
            return simFail(error, "tag %s: an address is missing behind ->", tag->name);
        if (mapTag(tags, tag, words[*used + 1], error))
            return -1;
        *used += 2;
    } else {
        ownBytes(tag);
    }
    if (*used < count && !strcasecmp(words[*used], "readonly"))
        tag->access = eipReadOnly;
    else if (*used < count && !strcasecmp(words[*used], "hidden"))
        tag->access = eipNoAccess;
    else
        return 0;
    (*used)++;
    return 0;
}

static int checkNew(simEipTags *tags, const char *name, int scope,
                    char error[SIM_ERROR_SIZE])
{
    if (scope < 0)
        return simFail(
            error,
            "\"%.60s\" is no name of a tag: letters, digits and _, at most %d, "
            "or Program:<name>.<name>",
            name, SIM_EIP_NAME - 1);
    if (simEipTagFind(tags, name))
        return simFail(error, "there is a tag %s already", name);
    if (nextOrder(tags) + tags->shifts + 2 > SIM_EIP_TAGS)
        return simFail(error, "more than %d tags", SIM_EIP_TAGS);
    return 0;
}

simEipTag *simEipTagAdd(simEipTags *tags, char **words, size_t count, size_t *used,
                        char error[SIM_ERROR_SIZE])
{
    const simEipType *type;
    simEipTag *tag;
    unsigned dims[3];
    int scope;

    if (count < 2) {
        simFail(error, "tag wants: <name> <type> [-> <address>] [readonly|hidden] "
                       "[= <value> ... | <signal> ...]");
        return NULL;
    }
    scope = scopeOf(words[0]);
    if (checkNew(tags, words[0], scope, error) ||
        simEipTypeParse(tags->types, words[1], &type, dims, error))
        return NULL;
    if (scope)
        needProgram(tags, words[0], scope);
    tag = newTag(tags, words[0]);
    tag->scope = (size_t)scope;
    tag->type = type;
    while (tag->dimCount < 3 && dims[tag->dimCount]) {
        tag->dims[tag->dimCount] = dims[tag->dimCount];
        tag->elements *= dims[tag->dimCount++];
    }
    *used = 2;
    if (tagOptions(tags, tag, words, count, used, error)) {
        simEipTagRemove(tags, words[0]);
        return NULL;
    }
    return tag;
}

/* ---- paths ---- */

static simEipTag *findBytes(const simEipTags *tags, const char *scope,
                            const simEipSegment *s)
{
    char name[SIM_EIP_FULL_NAME];

    if (s->length >= SIM_EIP_NAME || memchr(s->text, 0, s->length))
        return NULL;
    snprintf(name, sizeof(name), "%s%.*s", scope, (int)s->length, (const char *)s->text);
    return simEipTagFind(tags, name);
}

/* The tag that the first segments name; *next is the segment behind. */
static int findFirst(const simEipTags *tags, const simEipPath *path, simEipTag **tag,
                     size_t *next)
{
    const simEipSegment *s = path->segments;
    char scope[SIM_EIP_NAME + 2] = "";
    unsigned class;
    epicsUInt32 instance;
    size_t i = 0;

    *tag = NULL;
    if (simEipPathObject(path, &class, &instance)) {
        *next = 2;
        *tag = class == SYMBOL_CLASS ? simEipTagById(tags, instance) : NULL;
        return *tag && (*tag)->type && !(*tag)->scope ? 0 : EIP_PATH_UNKNOWN;
    }
    if (!path->count || s[0].kind != eipSymbol)
        return EIP_PATH_SYNTAX;
    if (s[0].length > strlen(PROGRAM) && s[0].length < SIM_EIP_NAME &&
        !strncasecmp((const char *)s[0].text, PROGRAM, strlen(PROGRAM))) {
        snprintf(scope, sizeof(scope), "%.*s.", (int)s[0].length,
                 (const char *)s[0].text);
        i = 1;
    }
    if (i && path->count > 2 && s[1].kind == eipClass && s[2].kind == eipInstance) {
        /* an instance within a program */
        *next = 3;
        *tag = s[1].value == SYMBOL_CLASS ? simEipTagById(tags, s[2].value) : NULL;
        return *tag && (*tag)->type && (*tag)->scope == strlen(scope) &&
                       !strncasecmp((*tag)->name, scope, strlen(scope))
                   ? 0
                   : EIP_PATH_UNKNOWN;
    }
    if (i >= path->count || s[i].kind != eipSymbol)
        return EIP_PATH_SYNTAX;
    *tag = findBytes(tags, scope, &s[i]);
    *next = i + 1;
    return *tag && (*tag)->type ? 0 : EIP_PATH_SYNTAX;
}

/* Elements behind a tag or member: all dimensions, or none. */
static int takeElements(simEipPlace *place, const unsigned dims[3], int dimCount,
                        const simEipPath *path, size_t *next)
{
    size_t index = 0;
    int i;

    if (*next >= path->count || path->segments[*next].kind != eipElement)
        return 0;
    for (i = 0; i < dimCount; i++, (*next)++) {
        const simEipSegment *s = &path->segments[*next];

        if (*next >= path->count || s->kind != eipElement || s->value >= dims[i])
            return EIP_PATH_UNKNOWN;
        index = index * dims[i] + s->value;
    }
    if (!dimCount)
        return EIP_PATH_UNKNOWN;
    place->bytes += index * place->type->size;
    place->elements -= index;
    place->isElement = 1;
    return 0;
}

static int takeMember(simEipPlace *place, const simEipPath *path, size_t *next)
{
    const simEipSegment *s = &path->segments[(*next)++];
    const simEipType *type = place->type;
    unsigned dims[3] = {0, 0, 0};
    size_t i;

    /* of an array one element must be named first */
    if (s->kind != eipSymbol || type->kind != eipStruct ||
        (place->isArray && !place->isElement))
        return EIP_PATH_UNKNOWN;
    for (i = 0; i < type->memberCount; i++) {
        const simEipMember *m = &type->members[i];

        if (strlen(m->name) != s->length ||
            strncasecmp(m->name, (const char *)s->text, s->length))
            continue;
        place->type = m->type;
        place->bytes += m->offset;
        place->bit = m->bit;
        place->elements = m->count ? m->count : 1;
        place->isArray = m->count > 0;
        place->isElement = 0;
        dims[0] = (unsigned)m->count;
        return takeElements(place, dims, m->count > 0, path, next);
    }
    return EIP_PATH_UNKNOWN;
}

int simEipTagsResolve(const simEipTags *tags, const simEipPath *path, simEipPlace *place)
{
    size_t next;
    simEipTag *tag;
    int status = findFirst(tags, path, &tag, &next);

    if (status)
        return status;
    memset(place, 0, sizeof(*place));
    place->tag = tag;
    place->type = tag->type;
    place->bytes = simEipTagBytes(tag);
    place->bit = -1;
    place->elements = tag->elements;
    place->isArray = tag->dimCount > 0;
    status = takeElements(place, tag->dims, tag->dimCount, path, &next);
    while (!status && next < path->count)
        status = takeMember(place, path, &next);
    return status;
}

/* ---- text ---- */

/* "[1,2]" as elements. Returns the end of it, or NULL. */
static const char *textElements(const char *p, simEipPath *path)
{
    char *end;

    do {
        if (!isdigit((unsigned char)p[1]) || path->count == SIM_EIP_SEGMENTS)
            return NULL;
        path->segments[path->count].kind = eipElement;
        path->segments[path->count++].value = (epicsUInt32)strtoul(p + 1, &end, 10);
        p = end;
    } while (*p == ',');
    return *p == ']' ? p + 1 : NULL;
}

static int textPath(const char *p, simEipPath *path)
{
    path->count = 0;
    for (;;) {
        size_t length = strcspn(p, ".[");
        simEipSegment *s = &path->segments[path->count];

        if (!length || path->count >= SIM_EIP_SEGMENTS - 4)
            return -1;
        s->kind = eipSymbol;
        s->text = (const epicsUInt8 *)p;
        s->length = length;
        path->count++;
        p += length;
        if (*p == '[')
            p = textElements(p, path);
        if (!p || (*p && *p != '.'))
            return -1;
        if (!*p)
            return 0;
        p++;
    }
}

int simEipTagsPlace(const simEipTags *tags, const char *text, simEipPlace *place,
                    char error[SIM_ERROR_SIZE])
{
    simEipPath path;

    if (textPath(text, &path))
        return simFail(error,
                       "\"%.80s\" is no tag: such as a, a[2], a.b[2].c, a[1,2], "
                       "Program:Main.a",
                       text);
    if (simEipTagsResolve(tags, &path, place))
        return simFail(error, "\"%.80s\": there is no such tag, member or element", text);
    return 0;
}
