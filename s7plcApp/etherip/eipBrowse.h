/* What a controller tells of its tags: the list of them, and the templates of structures.
 *
 * Requests and answers as bytes; where they go and come from is not known here. Pure; any
 * thread.
 */
#ifndef INC_eipBrowse_H
#define INC_eipBrowse_H

#include "eipCip.h"
#include "eipType.h"

enum {
    eipSymbolNameMax = 255,
    eipMemberNameMax = 80,
    eipSymbolStructure = 0x8000, /* bits of a symbol's type */
    eipSymbolSystem = 0x1000,
    eipTemplatesMax = 4096,
    eipMembersMax = 1 << 18 /* of all templates together */
};

/* One tag of the list. */
typedef struct eipSymbol {
    epicsUInt32 id;
    char name[eipSymbolNameMax + 1];
    unsigned type; /* of the symbol, see below */
    epicsUInt32 dimension[3];
} eipSymbol;

/* Of a symbol's type, or of a member's. */
static inline int eipIsStructure(unsigned type)
{
    return (type & eipSymbolStructure) != 0;
}

static inline unsigned eipDimensions(unsigned type)
{
    return type >> 13 & 3;
}

static inline unsigned eipTemplateId(unsigned type)
{
    return type & 0xfff;
}

static inline unsigned eipElementCode(unsigned type)
{
    return type & 0xff;
}

/* Number of elements; 1: a scalar. */
static inline epicsUInt32 eipSymbolElements(const eipSymbol *symbol)
{
    epicsUInt64 n = 1;
    unsigned i;

    for (i = 0; i < eipDimensions(symbol->type) && n <= 0xffffffffu; i++)
        n *= symbol->dimension[i];
    return n > 0xffffffffu ? 0xffffffffu : (epicsUInt32)n;
}

/* Asks for the tags from `start` on, of the controller, or of "Program:x". */
void eipSymbolsPut(eipWriter *w, const char *program, epicsUInt32 start);

/* Takes one tag off the answer's data. Returns 1; 0 at the end; -1 when it is broken. */
int eipSymbolTake(eipReader *r, eipSymbol *symbol);

/* Is it a tag of somebody, and not the controller's own bookkeeping? */
int eipSymbolCounts(const eipSymbol *symbol);

/* --- Templates ---------------------------------------------------------------------------- */

typedef struct eipMember {
    char name[eipMemberNameMax + 1];
    unsigned info; /* elements of an array, or the bit of a BOOL */
    unsigned type; /* as of a symbol */
    epicsUInt32 offset; /* bytes from the start of the structure */
} eipMember;

/* Hosts of BOOLs, and what the controller keeps for itself. */
int eipMemberIsHidden(const eipMember *member);

typedef struct eipTemplate {
    unsigned id, handle;
    epicsUInt32 words;  /* of the definition, 4 bytes each */
    epicsUInt32 size;   /* bytes of the structure */
    unsigned count;     /* of members */
    char name[eipMemberNameMax + 1];
    eipMember *members; /* allocated */
} eipTemplate;

/* Asks how large a template is, and takes the answer. Returns 0, or -1: it is none. */
void eipTemplateSizePut(eipWriter *w, unsigned id);
int eipTemplateSizeTake(const eipAnswer *answer, unsigned id, eipTemplate *t);

/* The bytes of its definition, at most. */
size_t eipTemplateBytes(const eipTemplate *t);

/* Asks for a part of its definition. */
void eipTemplateReadPut(eipWriter *w, unsigned id, epicsUInt32 offset, unsigned bytes);

/* The members from the whole definition. Returns 0 and t->members, or -1: it is broken. */
int eipTemplateParse(eipTemplate *t, const epicsUInt8 *bytes, size_t length);

void eipTemplateFree(eipTemplate *t);

/* Is it a string? Returns the characters it has room for, 0: it is none. */
unsigned eipTemplateIsString(const eipTemplate *t);

/* All templates that are known, by their id. */
typedef struct eipTemplates {
    eipTemplate *table[eipTemplatesMax]; /* NULL: not known */
} eipTemplates;

void eipTemplatesClear(eipTemplates *templates);

/* May one more be kept, whose sizes are known? A PLC may tell of any number of members. */
int eipTemplatesHaveRoom(const eipTemplates *templates, const eipTemplate *t);

/* Where a member is, as "b[2].c" names it. */
typedef struct eipMemberPlace {
    epicsUInt32 offset;   /* bytes from the start of the structure */
    unsigned type;        /* as of a symbol */
    epicsUInt32 elements; /* 1: no array */
    unsigned size;        /* bytes of an element, 0: not known */
    int bit;              /* of a BOOL in its byte; -1: a byte or more */
} eipMemberPlace;

/* Returns 0; -1: there is no such member; or the id of a template that must be known first. */
int eipMemberFind(const eipTemplates *templates, unsigned id, const char *path,
                  eipMemberPlace *place);

/* The bytes of an element of this type, 0: not known. */
unsigned eipElementSize(const eipTemplates *templates, unsigned type);

#endif /* INC_eipBrowse_H */
