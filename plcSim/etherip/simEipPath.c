/* simEipPath: the path of a CIP request taken apart into segments. It does not know what
 * the segments lead to.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <ctype.h>

#include "simEipPath.h"
#include "simEipTypes.h"

static const struct logical {
    epicsUInt8 type; /* with one byte; + 1 with two, + 2 with four */
    simEipSegmentKind kind;
    size_t longest; /* bytes of the value */
} logicals[] = {
    {0x20, eipClass,     2},
    {0x24, eipInstance,  4},
    {0x28, eipElement,   4},
    {0x30, eipAttribute, 2},
};

/* Each returns the bytes that the segment takes, 0 = it is none. */
static size_t takeSymbol(simEipSegment *s, const epicsUInt8 *p, size_t left)
{
    size_t length = left > 1 ? p[1] : 0;
    size_t size = 2 + length + length % 2;

    if (!length || size > left)
        return 0;
    s->kind = eipSymbol;
    s->text = p + 2;
    s->length = length;
    return size;
}

static size_t takeLogical(simEipSegment *s, const epicsUInt8 *p, size_t left)
{
    size_t i;

    for (i = 0; i < sizeof(logicals) / sizeof(logicals[0]); i++) {
        const struct logical *l = &logicals[i];
        size_t width = (size_t)1 << (p[0] & 3);
        size_t at = width == 1 ? 1 : 2; /* a pad byte in front of the longer ones */

        if ((p[0] & 0xFC) != l->type)
            continue;
        if ((p[0] & 3) == 3 || width > l->longest || at + width > left)
            return 0;
        s->kind = l->kind;
        s->value = (epicsUInt32)simEipGet(p + at, width);
        return at + width;
    }
    return 0;
}

int simEipPathParse(simEipPath *path, const epicsUInt8 *bytes, size_t size)
{
    path->count = 0;
    while (size > 0) {
        simEipSegment *s = &path->segments[path->count];
        size_t taken;

        if (path->count == SIM_EIP_SEGMENTS)
            return -1;
        taken =
            bytes[0] == 0x91 ? takeSymbol(s, bytes, size) : takeLogical(s, bytes, size);
        if (!taken)
            return -1;
        path->count++;
        bytes += taken;
        size -= taken;
    }
    return 0;
}

int simEipPathObject(const simEipPath *path, unsigned *class, epicsUInt32 *instance)
{
    if (path->count < 2 || path->segments[0].kind != eipClass ||
        path->segments[1].kind != eipInstance)
        return 0;
    *class = path->segments[0].value;
    *instance = path->segments[1].value;
    return 1;
}

void simEipPathText(const simEipPath *path, simText *out)
{
    size_t i, k;

    for (i = 0; i < path->count; i++) {
        const simEipSegment *s = &path->segments[i];
        int again = i > 0 && s[-1].kind == eipElement;

        switch (s->kind) {
        case eipSymbol:
            simTextAdd(out, "%s", i ? "." : "");
            for (k = 0; k < s->length; k++)
                simTextAdd(out, isgraph(s->text[k]) ? "%c" : "\\x%02x", s->text[k]);
            break;
        case eipElement:
            /* a[1,2]: the bracket of the element before is open still */
            simTextAdd(out, "%s%lu", again ? "," : "[", (unsigned long)s->value);
            if (i + 1 == path->count || s[1].kind != eipElement)
                simTextAdd(out, "]");
            break;
        case eipClass:
            simTextAdd(out, "%s@%02lx", i ? "." : "", (unsigned long)s->value);
            break;
        default:
            simTextAdd(out, "/%lu", (unsigned long)s->value);
        }
    }
}
