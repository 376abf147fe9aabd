/* Fuzz target: links, texts of tags and routes of EtherNet/IP. The path of a tag has as many
 * bytes as was said, and the simulator, which shares no code, reads the same tag in it. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <epicsStdio.h>
#include <epicsString.h>

#include "eipCip.h"
#include "eipLink.h"
#include "eipName.h"
#include "fuzz.h"
#include "simEipPath.h"

fuzzTarget fuzzEipLink, fuzzEipName, fuzzEipRoute;

/* As the simulator shows it: without blanks, a[1][2] as a[1,2]. */
static void plain(const char *text, char *to)
{
    for (; *text; text++)
        if (text[0] == ']' && text[1] == '[') {
            *to++ = ',';
            text++;
        } else if (*text != ' ') {
            *to++ = *text;
        }
    *to = 0;
}

/* Leading zeros of numbers in brackets are not shown again. */
static void withoutZeros(char *text)
{
    char *to = text, *at = text;

    for (; *at; at++) {
        int opens = to > text && (to[-1] == '[' || to[-1] == ',');

        if (opens && *at == '0' && at[1] >= '0' && at[1] <= '9')
            continue;
        *to++ = *at;
    }
    *to = 0;
}

/* The simulator shows other bytes in a way of its own. */
static int isAscii(const char *text)
{
    for (; *text; text++)
        if ((unsigned char)*text >= 0x80)
            return 0;
    return 1;
}

static void checkPath(const char *base)
{
    epicsUInt8 *bytes = malloc(eipPathMax);
    eipWriter w = eipWriterOf(bytes, eipPathMax);
    char expected[eipNameMax + 20];
    simEipPath path;
    simText text = {NULL, 0, 0};

    if (eipPathPut(&w, base, 0)) {
        fuzzCheck(eipPathBytes(base, 0) == 0);
        free(bytes);
        return;
    }
    fuzzCheck(w.n == eipPathBytes(base, 0) && w.n % 2 == 0 && w.n <= eipPathMax);
    if (simEipPathParse(&path, bytes, w.n) == 0) {
        simEipPathText(&path, &text);
        plain(base, expected);
        withoutZeros(expected);
        fuzzCheck(text.text && (!isAscii(base) || strcmp(text.text, expected) == 0));
        simTextFree(&text);
    } else {
        fuzzCheck(path.count == SIM_EIP_SEGMENTS); /* more than it knows */
    }
    free(bytes);
}

int fuzzEipName(const epicsUInt8 *data, size_t size)
{
    char *text = fuzzText(data, size), error[200] = "";
    size_t column = 0;
    eipName name;
    epicsUInt8 bytes[6];
    eipWriter w;
    unsigned i;

    if (eipNameParse(text, (int)(size & 1), &name, &column, error, sizeof(error))) {
        fuzzCheck(error[0] && column <= strlen(text));
        free(text);
        return 0;
    }
    fuzzCheck(strlen(name.base) <= strlen(text) && name.base[0]);
    fuzzCheck(name.dimensions <= eipDimensionsMax && name.bit >= -1 && name.bit <= 63);
    fuzzCheck(eipNameRoot(name.base) > 0 && eipNameRoot(name.base) <= strlen(name.base));
    for (i = 0; i < name.dimensions; i++) {
        w = eipWriterOf(bytes, sizeof(bytes));
        eipIndexPut(&w, name.index[i]);
        fuzzCheck(!w.full && w.n == eipIndexBytes(name.index[i]));
    }
    checkPath(name.base);
    free(text);
    return 0;
}

int fuzzEipLink(const epicsUInt8 *data, size_t size)
{
    char *text = fuzzText(data, size), error[300] = "";
    size_t column = 0;
    eipLink link;

    if (eipLinkParse(text, &link, &column, error, sizeof(error))) {
        fuzzCheck(error[0] && column <= strlen(text));
    } else {
        fuzzCheck(link.plc[0] && link.tag[0] && strlen(link.tag) <= eipNameMax);
        fuzzCheck(link.bit >= -1 && link.bit <= 63);
        fuzzCheck(link.period == 0 || (link.period >= 0.001 && link.period <= 86400));
        fuzzCheck(eipPathBytes(link.tag, 0) > 0);
        checkPath(link.tag);
    }
    free(text);
    return 0;
}

int fuzzEipRoute(const epicsUInt8 *data, size_t size)
{
    char *text = fuzzText(data, size), error[300] = "";
    eipRoute route;

    if (eipRouteParse(text, &route, error, sizeof(error)))
        fuzzCheck(error[0]);
    else
        fuzzCheck(route.length <= eipRouteMax && route.length % 2 == 0);
    free(text);
    return 0;
}
