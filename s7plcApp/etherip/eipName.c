/* The text of a tag taken apart; see eipName.h. */
#include <ctype.h>
#include <stdarg.h>
#include <stdlib.h>

#include <epicsStdio.h>
#include <epicsString.h>

#include "eipName.h"

/* What a message of eipNameParse needs. */
typedef struct place {
    const char *text;
    size_t *column;
    char *error;
    size_t size;
} place;

static int fail(const place *p, const char *at, const char *format, ...)
{
    va_list args;

    if (p->column)
        *p->column = (size_t)(at - p->text);
    va_start(args, format);
    epicsVsnprintf(p->error, p->size, format, args);
    va_end(args);
    return -1;
}

/* Names go to the PLC as they stand: some have letters beyond ASCII. */
static int isNameChar(char c)
{
    return isalnum((unsigned char)c) || c == '_' || c == ':' || (unsigned char)c >= 0x80;
}

/* The characters of the name that begins here; 0: none. */
static size_t nameLength(const char *at)
{
    size_t n = 0;

    while (isNameChar(at[n]))
        n++;
    return n;
}

static int allDigits(const char *at, size_t n)
{
    size_t i;

    for (i = 0; i < n; i++)
        if (!isdigit((unsigned char)at[i]))
            return 0;
    return n > 0;
}

/* A number of one index; *end is behind it. Returns 0 or -1. */
static int indexNumber(const char *at, int base0, epicsUInt32 *value, const char **end)
{
    unsigned long long number = 0;
    char *behind;

    if (!isdigit((unsigned char)*at))
        return -1;
    number = strtoull(at, &behind, base0 ? 0 : 10);
    if (number > 0xffffffffu)
        return -1;
    *value = (epicsUInt32)number;
    *end = behind;
    return 0;
}

static int noIndex(const place *p, const char *at)
{
    size_t n = strcspn(at, ",]");

    if (!n)
        return fail(p, at, "an index is missing; allowed: [0] to [4294967295]");
    return fail(p, at, "%.*s is no index; allowed: [0] to [4294967295]", (int)(n < 20 ? n : 20), at);
}

/* "[1,2]" from the bracket on; *end is behind it. */
static int indices(const place *p, const char *at, int base0, eipName *name,
                   const char **end)
{
    const char *bracket = at;

    name->dimensions = 0;
    do {
        at += 1 + strspn(at + 1, " ");
        if (name->dimensions == eipDimensionsMax)
            return fail(p, at, "more than 3 dimensions; allowed: [i], [i,j], [i,j,k]");
        if (indexNumber(at, base0, &name->index[name->dimensions++], &at))
            return noIndex(p, at);
        at += strspn(at, " ");
    } while (*at == ',');
    if (*at != ']')
        return fail(p, bracket,
                    !*at    ? "\"%.20s\" does not end with ]; allowed: [i], [i,j], [i,j,k]"
                    : base0 ? "\"%.20s\" is no index; allowed: [8], with a leading 0 octal: [010], or [0x8]"
                            : "\"%.20s\" is no index; allowed: decimal numbers, [i], [i,j], [i,j,k]",
                    bracket);
    *end = at + 1;
    return 0;
}

/* Is this the last index of the text? Perhaps a bit follows. */
static int isLast(const char *behind)
{
    return !*behind || (*behind == '.' && allDigits(behind + 1, strlen(behind + 1)));
}

/* One name or bit behind a point, or the first; *at is moved behind it. */
static int part(const place *p, const char **at, int first, eipName *name)
{
    size_t n = nameLength(*at);

    if (!n)
        return fail(p, *at,
                    **at ? "'%c' is not possible in a tag; allowed: letters, digits, _ : "
                           "with . and [index] between names"
                         : "a name is missing at the end of the tag; allowed: name, "
                           "name.member, Program:name.tag",
                    **at);
    if (!first && !(*at)[n] && allDigits(*at, n)) {
        if (n > 2 || atoi(*at) > 63)
            return fail(p, *at, "bit %.*s; allowed: 0 to 63", (int)n, *at);
        name->bit = atoi(*at);
    } else if (!first && isdigit((unsigned char)**at)) {
        return fail(p, *at, "\"%.*s\" is no name: it begins with a digit", (int)n, *at);
    }
    *at += n;
    return 0;
}

int eipNameParse(const char *text, int base0, eipName *name, size_t *column, char *error,
                 size_t size)
{
    place p = {text, column, error, size};
    const char *at = text, *end = NULL;
    int first = 1;

    name->dimensions = 0;
    name->bit = -1;
    if (strlen(text) > eipNameMax)
        return fail(&p, text, "the tag has more than %d characters", eipNameMax);
    for (;;) {
        if (part(&p, &at, first, name))
            return -1;
        if (name->bit < 0) {
            end = at;
            name->dimensions = 0;
        }
        first = 0;
        if (*at == '[') {
            const char *bracket = at, *behind = strchr(at, ']');

            if (indices(&p, at, base0 && behind && isLast(behind + 1), name, &at))
                return -1;
            end = isLast(at) ? bracket : at;
        }
        if (!*at)
            break;
        if (*at != '.')
            return fail(&p, at, "'%c' is not possible here; allowed: . or the end", *at);
        at++;
    }
    memcpy(name->base, text, (size_t)(end - text));
    name->base[end - text] = 0;
    return 0;
}

void eipElementText(const char *base, int indexed, epicsUInt32 index, char *text, size_t size)
{
    size_t n = strlen(base);

    if (indexed && n && base[n - 1] == ']')
        epicsSnprintf(text, size, "%.*s,%u]", (int)n - 1, base, index);
    else if (indexed || index)
        epicsSnprintf(text, size, "%s[%u]", base, index);
    else
        epicsSnprintf(text, size, "%s", base);
}

/* --- Paths -------------------------------------------------------------------------------- */

size_t eipIndexBytes(epicsUInt32 index)
{
    return index < 256 ? 2 : index < 65536 ? 4 : 6;
}

void eipIndexPut(eipWriter *w, epicsUInt32 index)
{
    unsigned size = index < 256 ? 1 : index < 65536 ? 2 : 4;

    eipPut8(w, size == 1 ? 0x28 : size == 2 ? 0x29 : 0x2a);
    if (size > 1)
        eipPut8(w, 0);
    eipPutUnsigned(w, size, index);
}

static void putSymbol(eipWriter *w, const char *name, size_t length)
{
    eipPut8(w, 0x91);
    eipPut8(w, (unsigned)length);
    eipPutBytes(w, name, length);
    if (length % 2)
        eipPut8(w, 0);
}

/* The symbol object's instance of this number. */
static void putInstance(eipWriter *w, epicsUInt32 instance)
{
    eipPut8(w, 0x20);
    eipPut8(w, 0x6b);
    eipPut8(w, instance < 256 ? 0x24 : instance < 65536 ? 0x25 : 0x26);
    if (instance >= 256)
        eipPut8(w, 0);
    eipPutUnsigned(w, instance < 256 ? 1 : instance < 65536 ? 2 : 4, instance);
}

size_t eipNameRoot(const char *base)
{
    static const char program[] = "program:";
    size_t n = nameLength(base);

    if (epicsStrnCaseCmp(base, program, strlen(program)) == 0 && base[n] == '.')
        n += 1 + nameLength(base + n + 1);
    return n;
}

int eipPathPut(eipWriter *w, const char *base, epicsUInt32 instance)
{
    const char *at = base;
    size_t n;

    if (instance) {
        putInstance(w, instance);
        at += eipNameRoot(base);
    }
    while (*at) {
        if (*at == '[') {
            do {
                epicsUInt32 index;

                at += 1 + strspn(at + 1, " ");
                if (indexNumber(at, 0, &index, &at))
                    return -1;
                eipIndexPut(w, index);
                at += strspn(at, " ");
            } while (*at == ',');
            if (*at++ != ']')
                return -1;
            continue;
        }
        if (*at == '.')
            at++;
        n = nameLength(at);
        if (!n)
            return -1;
        putSymbol(w, at, n);
        at += n;
    }
    return w->full ? -1 : 0;
}

size_t eipPathBytes(const char *base, epicsUInt32 instance)
{
    epicsUInt8 path[eipPathMax];
    eipWriter w = eipWriterOf(path, sizeof(path));

    return eipPathPut(&w, base, instance) ? 0 : w.n;
}
