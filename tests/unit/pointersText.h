/* Tables of pointers from text, for tests. */
#ifndef INC_pointersText_H
#define INC_pointersText_H

#include <stdio.h>

#include <epicsUnitTest.h>

#include "plcPointers.h"

/* NULL with the reason in error. */
static plcPointers *read(const char *text, char *error, size_t size)
{
    FILE *file = tmpfile();
    plcPointers *table;

    if (!file)
        testAbort("no temporary file");
    fputs(text, file);
    rewind(file);
    error[0] = 0;
    table = plcPointersRead(file, error, size);
    fclose(file);
    return table;
}

static const char goodFile[] = "# plant\nlayout 0x1201\n"
                               "rx 4 -> P#DB10.DBX0.0 BYTE 8 Temp Speed\n"
                               "tx P#DB10.DBX0.0 BYTE 8 -> 16 Temp Speed # here\n"
                               "TX P#M100.0 byte 2 -> 24\n";

#endif
