/* What the tags of a controller are, in words: types, structures, and why a read or write of one
 * was refused, from the list of tags; see eipClient.h. */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include <epicsStdio.h>
#include <epicsString.h>

#include "eipClient.h"

const char *eipClientTypeText(eipClient *c, unsigned type, const epicsUInt32 *dimension,
                              char *text, size_t size)
{
    const eipType *row = eipTypeOf(eipElementCode(type));
    const eipTemplate *t = NULL;
    size_t n;
    unsigned i;

    if (eipIsStructure(type))
        t = eipClientTemplate(c, eipTemplateId(type));
    if (t)
        epicsSnprintf(text, size, "%s", t->name);
    else if (!eipIsStructure(type) && row)
        epicsSnprintf(text, size, "%s", row->name);
    else
        epicsSnprintf(text, size, "type %04X", type);
    for (i = 0; i < eipDimensions(type); i++) {
        n = strlen(text);
        epicsSnprintf(text + n, size - n, "%s%u", i ? "," : "[", dimension[i]);
    }
    n = strlen(text);
    if (i)
        epicsSnprintf(text + n, size - n, "]");
    return text;
}

/* "A is DINT[10]; allowed: A[0] to A[9]" */
static void rangeText(eipClient *c, const char *name, unsigned type, const epicsUInt32 *dimension,
                      char *text, size_t size)
{
    unsigned d = eipDimensions(type), side, i;
    char what[120];
    size_t n;

    epicsSnprintf(text, size, "%.60s is %s", name,
                  eipClientTypeText(c, type, dimension, what, sizeof(what)));
    if (!d) {
        n = strlen(text);
        epicsSnprintf(text + n, size - n, ", no array");
    }
    for (side = 0; d && side < 2; side++) {
        n = strlen(text);
        epicsSnprintf(text + n, size - n, "%s%.60s[", side ? " to " : "; allowed: ", name);
        for (i = 0; i < d; i++) {
            n = strlen(text);
            epicsSnprintf(text + n, size - n, "%s%u", i ? "," : "",
                          side && dimension[i] ? dimension[i] - 1 : 0);
        }
        n = strlen(text);
        epicsSnprintf(text + n, size - n, "]");
    }
}

/* The elements from the one that is named to the end; 0: there is no such one. */
static epicsUInt64 elementsFrom(const eipName *name, unsigned type, const epicsUInt32 *dimension)
{
    unsigned d = eipDimensions(type), i;
    epicsUInt64 all = 1, before = 0;

    if (name->dimensions && name->dimensions != d)
        return 0;
    for (i = 0; i < d; i++) {
        epicsUInt32 index = name->dimensions ? name->index[i] : 0;

        if (index >= dimension[i])
            return 0;
        all *= dimension[i];
        before = before * dimension[i] + index;
    }
    return all - before;
}

/* --- Types --------------------------------------------------------------------------------- */

int eipClientPrintTemplate(eipClient *c, unsigned id, FILE *file)
{
    const eipTemplate *t = eipClientTemplate(c, id & 0xfff);
    char text[120];
    unsigned i;

    if (!t)
        return eipClientFail(c, "the PLC has no type %u", id);
    fprintf(file, "%s  %u bytes, handle %04X\n", t->name, t->size, t->handle);
    for (i = 0; i < t->count; i++) {
        const eipMember *m = &t->members[i];
        epicsUInt32 length[3] = {m->info, 0, 0};

        if (eipMemberIsHidden(m))
            continue;
        fprintf(file, "  %5u  .%-38s %s", m->offset, m->name,
                eipClientTypeText(c, m->type, length, text, sizeof(text)));
        if (!eipIsStructure(m->type) && eipElementCode(m->type) == eipBool)
            fprintf(file, " bit %u", m->info);
        fputc('\n', file);
    }
    return 0;
}

typedef struct search {
    const char *name;
    eipSymbol symbol;
    int found;
} search;

static void findSymbol(eipClient *c, const char *name, const eipSymbol *symbol, void *arg)
{
    search *s = arg;

    (void)c;
    if (epicsStrCaseCmp(name, s->name) == 0) {
        s->symbol = *symbol;
        s->found = 1;
    }
}

static int describe(eipClient *c, const char *name, unsigned type,
                    const epicsUInt32 *dimension, FILE *file)
{
    char text[120];

    fprintf(file, "%s  %s\n", name, eipClientTypeText(c, type, dimension, text, sizeof(text)));
    return eipIsStructure(type) ? eipClientPrintTemplate(c, eipTemplateId(type), file) : 0;
}

/* The root's index in "base[7].x" is beyond the end of its tag? Returns 0 or 1. */
static int isRootBeyond(const char *index, const eipSymbol *symbol)
{
    unsigned d;

    for (d = 0; *index && *index != ']' && d < 3; d++) {
        char *end;

        if (strtoul(index + 1, &end, 10) >= symbol->dimension[d])
            return 1;
        index = end;
    }
    return 0;
}

eipClientFound eipClientTypeOf(eipClient *c, const char *base, unsigned *type,
                               epicsUInt32 dimension[3])
{
    eipMemberPlace place = {0};
    search s = {.name = ""};
    char root[eipNameMax + 1], range[160];
    size_t n = eipNameRoot(base);
    int missing;

    epicsSnprintf(root, sizeof(root), "%.*s", (int)n, base);
    s.name = root;
    if (eipClientList(c, findSymbol, &s))
        return eipNoList;
    if (!s.found) {
        eipClientWhy(c, "the PLC lists no such tag; those there are: list");
        return eipNoTag;
    }
    *type = s.symbol.type;
    memcpy(dimension, s.symbol.dimension, sizeof(s.symbol.dimension));
    if (base[n] == '[' ? isRootBeyond(base + n, &s.symbol) : base[n] && eipDimensions(*type)) {
        rangeText(c, root, *type, dimension, range, sizeof(range));
        eipClientWhy(c, "%s", range);
        return eipNoTag;
    }
    if (base[n] == '[')
        n += strcspn(base + n, "]") + 1;
    if (!base[n])
        return eipTypeFound;
    do { /* reads templates until all are there that lead to the member */
        memset(&place, 0, sizeof(place));
        missing = eipMemberFind(&c->templates, eipTemplateId(s.symbol.type), base + n + 1,
                                &place);
    } while (missing > 0 && eipClientTemplate(c, (unsigned)missing));
    *type = place.type;
    dimension[0] = place.elements;
    if (!missing)
        return eipTypeFound;
    if (eipIsStructure(s.symbol.type))
        eipClientWhy(c, "no such member or element; those there are: describe %.80s", root);
    else
        eipClientWhy(c, "%.80s is no structure, it has no members", root);
    return eipNoTag;
}

/* Fetches the template of a structure, and those of its members. */
static void fetch(eipClient *c, unsigned type)
{
    const eipTemplate *t;
    unsigned i;

    if (!eipIsStructure(type) || c->templates.table[eipTemplateId(type)])
        return;
    t = eipClientTemplate(c, eipTemplateId(type));
    for (i = 0; t && i < t->count; i++)
        fetch(c, t->members[i].type);
}

static void fetchSymbol(eipClient *c, const char *name, const eipSymbol *symbol, void *arg)
{
    (void)name, (void)arg;
    fetch(c, symbol->type);
}

/* A structure that some tag has. Returns its id, or 0: there is none of this name. */
static unsigned structureNamed(eipClient *c, const char *name)
{
    unsigned i;

    if (eipClientList(c, fetchSymbol, NULL))
        return 0;
    for (i = 0; i < eipTemplatesMax; i++)
        if (c->templates.table[i] && epicsStrCaseCmp(c->templates.table[i]->name, name) == 0)
            return i;
    return 0;
}

int eipClientDescribe(eipClient *c, const char *tag, FILE *file)
{
    epicsUInt32 dimension[3] = {0, 0, 0};
    eipName name;
    char error[sizeof(c->why)];
    size_t column;
    unsigned type;

    if (eipNameParse(tag, 0, &name, &column, error, sizeof(error)))
        return eipClientFail(c, "%s (at %u)", error, (unsigned)column + 1);
    if (eipClientTypeOf(c, name.base, &type, dimension) == eipTypeFound) {
        if (elementsFrom(&name, type, dimension))
            return describe(c, tag, type, dimension, file);
        rangeText(c, name.base, type, dimension, error, sizeof(error));
        return eipClientFail(c, "%s", error);
    }
    epicsSnprintf(error, sizeof(error), "%s", c->why);
    type = structureNamed(c, tag);
    return type ? eipClientPrintTemplate(c, type, file) : eipClientFail(c, "%s", error);
}

/* --- The list --------------------------------------------------------------------------------- */

typedef struct printing {
    const char *pattern;
    FILE *file;
    unsigned printed;
} printing;

static const char *lower(const char *text, char *low, size_t size)
{
    size_t i;

    for (i = 0; text[i] && i + 1 < size; i++)
        low[i] = (char)tolower((unsigned char)text[i]);
    low[i] = 0;
    return low;
}

static void printSymbol(eipClient *c, const char *name, const eipSymbol *symbol, void *arg)
{
    printing *p = arg;
    char text[120], low[eipClientNameMax];

    if (p->pattern && !epicsStrGlobMatch(lower(name, low, sizeof(low)), p->pattern))
        return;
    fprintf(p->file, "%-40s %s\n", name,
            eipClientTypeText(c, symbol->type, symbol->dimension, text, sizeof(text)));
    p->printed++;
}

int eipClientPrintList(eipClient *c, const char *pattern, FILE *file)
{
    char low[eipClientNameMax];
    printing p = {NULL, file, 0};

    if (pattern && *pattern)
        p.pattern = lower(pattern, low, sizeof(low));
    if (eipClientList(c, printSymbol, &p))
        return -1;
    return p.printed || !p.pattern
               ? 0
               : eipClientFail(c, "no tag matches \"%.60s\"; allowed: a name, with * and ?", pattern);
}

/* --- Refusals --------------------------------------------------------------------------------- */

/* Only these are about what the tag is. */
static int isAboutTag(const eipAnswer *a)
{
    return a->status == eipPathSegment || a->status == eipPathUnknown || eipAnswerIsEnd(a);
}

/* A BOOL array is one of DWORDs: who counts BOOLs is beyond its end soon. */
static void hintAtBit(eipClient *c, const eipName *name, unsigned type, const epicsUInt32 *dimension)
{
    size_t n = strlen(c->why);
    epicsUInt32 bit = name->index[0];

    if (eipDimensions(type) == 1 && eipElementCode(type) == eipDword && !eipIsStructure(type) &&
        name->dimensions == 1 && name->bit < 0 && bit / 32 < dimension[0])
        epicsSnprintf(c->why + n, sizeof(c->why) - n, "; BOOL %u is %.60s[%u].%u", bit, name->base,
                      bit / 32, bit % 32);
}

void eipClientExplain(eipClient *c, const eipName *name, unsigned count, const eipAnswer *answer)
{
    epicsUInt32 dimension[3] = {0, 0, 0};
    char before[sizeof(c->why)], text[160];
    epicsUInt64 there;
    size_t n;
    unsigned type = 0;

    eipStatusText(answer->status, answer->extended, c->why, sizeof(c->why));
    if (!isAboutTag(answer))
        return;
    strcpy(before, c->why);
    switch (eipClientTypeOf(c, name->base, &type, dimension)) {
    case eipNoTag:
        if (strstr(c->why, "lists no such"))
            eipClientWhy(c, "%s; those there are: list", before);
        return;
    case eipNoList:
        if (c->lost) /* some close the connection when they are asked for a list */
            eipClientReopen(c);
        eipClientWhy(c, "%s", before);
        return;
    case eipTypeFound:
        break;
    }
    there = elementsFrom(name, type, dimension);
    rangeText(c, name->base, type, dimension, text, sizeof(text));
    if (!there) {
        eipClientWhy(c, "%s", text);
        hintAtBit(c, name, type, dimension);
    } else if (count > there) {
        eipClientWhy(c, "%u elements are more than there are: %s", count, text);
    } else {
        n = strlen(before);
        epicsSnprintf(before + n, sizeof(before) - n, "; %.80s", text);
        strcpy(c->why, before);
    }
}
