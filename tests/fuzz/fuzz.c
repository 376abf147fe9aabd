/* What the fuzz targets share; see fuzz.h. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>

#include "fuzz.h"

void fuzzFail(const char *file, int line, const char *what)
{
    fprintf(stderr, "%s:%d: not true: %s\n", file, line, what);
    abort();
}

char *fuzzText(const epicsUInt8 *data, size_t size)
{
    char *text = mallocMustSucceed(size + 1, "fuzzText");

    if (size)
        memcpy(text, data, size);
    text[size] = 0;
    return text;
}

unsigned fuzzTake(fuzzBytes *b)
{
    if (!b->left)
        return 0;
    b->left--;
    return *b->at++;
}

unsigned fuzzTake16(fuzzBytes *b)
{
    unsigned high = fuzzTake(b);

    return high << 8 | fuzzTake(b);
}

epicsUInt8 *fuzzTakeMessage(fuzzBytes *b, size_t *size)
{
    epicsUInt8 *message;

    *size = fuzzTake16(b);
    if (*size > b->left)
        *size = b->left;
    message = malloc(*size ? *size : 1); /* a byte that must not be read is no harm */
    if (!message)
        cantProceed("fuzzTakeMessage\n");
    if (*size)
        memcpy(message, b->at, *size);
    b->at += *size;
    b->left -= *size;
    return message;
}

char *fuzzLine(char **text)
{
    char *line = *text, *end;

    if (!line)
        return NULL;
    end = strchr(line, '\n');
    if (end)
        *end = 0;
    *text = end ? end + 1 : NULL;
    return line;
}
