/* Values that were read, as text for people; see eipClient.h. Structures by their members. */
#include <epicsString.h>

#include "eipClient.h"

static void printHex(const epicsUInt8 *bytes, size_t n, FILE *file)
{
    size_t i;

    for (i = 0; i < n; i++)
        fprintf(file, "%s%02X", i ? " " : "", bytes[i]);
}

static void printText(unsigned code, const epicsUInt8 *bytes, size_t length, FILE *file)
{
    char escaped[1200];
    size_t n;
    const char *text = eipTextGet(code, bytes, length, &n);

    if (text && n <= 256) {
        epicsStrnEscapedFromRaw(escaped, sizeof(escaped), text, n);
        fprintf(file, "\"%s\"", escaped);
    } else {
        printHex(bytes, length, file);
    }
}

/* bit -1: whole elements. */
static void printNumbers(const eipType *type, const epicsUInt8 *bytes, size_t length, int bit,
                         FILE *file)
{
    char number[64];
    size_t i;

    for (i = 0; i + type->size <= length; i += type->size) {
        eipNumber one;

        eipNumberGet(type, bytes + i, &one);
        if (bit >= 0 && one.kind != eipReal)
            one.u.integer = bit < (int)type->size * 8 ? one.u.integer >> bit & 1 : 0;
        eipNumberText(type, &one, number, sizeof(number));
        fprintf(file, "%s%s", i ? " " : "", number);
    }
}

static void printStructures(eipClient *c, const eipTemplate *t, const epicsUInt8 *bytes,
                            size_t length, FILE *file);

/* `length` bytes of the structure, from the member on. */
static void printMember(eipClient *c, const eipMember *m, const epicsUInt8 *bytes, size_t length,
                        FILE *file)
{
    const eipType *type = eipTypeOf(eipElementCode(m->type));
    int isStructure = eipIsStructure(m->type);
    const eipTemplate *t = isStructure ? eipClientTemplate(c, eipTemplateId(m->type)) : NULL;
    size_t size = t ? t->size : isStructure || !type ? 0 : type->size;
    size_t count = eipDimensions(m->type) ? m->info : 1;

    if (!size || count > length / size)
        fputc('?', file);
    else if (t)
        printStructures(c, t, bytes, count * size, file);
    else if (type->code == eipBool)
        fprintf(file, "%u", bytes[0] >> (m->info & 7) & 1);
    else
        printNumbers(type, bytes, count * size, -1, file);
}

/* One, or an array of them. */
static void printStructures(eipClient *c, const eipTemplate *t, const epicsUInt8 *bytes,
                            size_t length, FILE *file)
{
    int isString = eipTemplateIsString(t) != 0;
    size_t at;
    unsigned i;

    for (at = 0; t->size && t->size <= length - at; at += t->size) {
        const char *before = "";

        if (at)
            fputc(' ', file);
        if (isString) {
            printText(eipStructureCode, bytes + at, t->size, file);
            continue;
        }
        fputc('{', file);
        for (i = 0; i < t->count; i++) {
            const eipMember *m = &t->members[i];

            if (eipMemberIsHidden(m) || m->offset >= t->size)
                continue;
            fprintf(file, "%s%s=", before, m->name);
            printMember(c, m, bytes + at + m->offset, t->size - m->offset, file);
            before = " ";
        }
        fputc('}', file);
    }
}

void eipValuePrint(eipClient *c, const eipValue *v, FILE *file)
{
    const eipType *type = eipTypeOf(v->data.code);

    if (type->size)
        printNumbers(type, v->data.bytes, v->data.length, v->name.bit, file);
    else if (v->structure)
        printStructures(c, v->structure, v->data.bytes, v->data.length, file);
    else if (v->data.code != eipStructureCode || v->characters)
        printText(v->data.code, v->data.bytes, v->data.length, file);
    else
        printHex(v->data.bytes, v->data.length, file);
}
