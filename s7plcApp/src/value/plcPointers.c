/* A table of pointers as a file of text; see plcPointers.h. */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <epicsString.h>

#include "plcPointers.h"

#define HEAD 10 /* layout, rows TX, rows RX, CRC */
#define ROW 20
#define COUNT_MAX 1024 /* bytes of a row */
#define BYTE_MAX 32767 /* of a data block: an INT in the PLC */

typedef struct row {
    int rx;
    unsigned area, db, byte, count; /* in PLC memory */
    unsigned ours;                  /* byte of IE_TX or IE_RX */
    char *name;
} row;

typedef struct reading {
    row rows[PLC_POINTER_ROWS];
    unsigned count;
    epicsUInt32 layout, ieTx, ieRx, crc;
    int hasCrc;
    char *error;
    size_t size;
} reading;

static int fail(reading *r, const char *what, const char *allowed)
{
    epicsSnprintf(r->error, r->size, "\"%.60s\"; allowed: %s", what, allowed);
    return -1;
}

static int numberOf(reading *r, const char *text, epicsUInt32 most, epicsUInt32 *value)
{
    char allowed[40];

    if (text && epicsParseUInt32(text, value, 0, NULL) == 0 && *value <= most)
        return 0;
    epicsSnprintf(allowed, sizeof(allowed), "0 to %u", (unsigned)most);
    return fail(r, text ? text : "", allowed);
}

/* "P#DB10.DBX4.0" or "P#M4.0", then "BYTE", then "8" */
static int pointer(reading *r, char **words, row *row)
{
    unsigned bit;
    int used = 0;

    if (sscanf(words[0], "P#DB%5u.DBX%6u.%1u%n", &row->db, &row->byte, &bit, &used) ==
            3 &&
        !words[0][used] && row->db > 0) {
        row->area = 0x84;
    } else if (sscanf(words[0], "P#M%6u.%1u%n", &row->byte, &bit, &used) == 2 &&
               !words[0][used]) {
        row->area = 0x83;
        row->db = 0;
    } else {
        return fail(r, words[0], "P#DB10.DBX4.0 or P#M4.0");
    }
    if (row->db > 65535 || row->byte > BYTE_MAX || bit > 0)
        return fail(r, words[0], "a byte of 0 to 32767, and bit 0");
    if (epicsStrCaseCmp(words[1], "BYTE"))
        return fail(r, words[1], "BYTE");
    if (epicsParseUInt32(words[2], &row->count, 10, NULL) || row->count < 1 ||
        row->count > COUNT_MAX)
        return fail(r, words[2], "1 to 1024 bytes");
    return 0;
}

static char *nameOf(char **words, size_t count, size_t first)
{
    size_t length = 1, i;
    char *name;

    for (i = first; i < count; i++)
        length += strlen(words[i]) + 1;
    name = callocMustSucceed(1, length, "plcPointers");
    for (i = first; i < count; i++) {
        if (i > first)
            strcat(name, " ");
        strcat(name, words[i]);
    }
    return name;
}

/* "tx P#... BYTE n -> offset names" or "rx offset -> P#... BYTE n names" */
static int rowLine(reading *r, char **words, size_t count)
{
    int rx = epicsStrCaseCmp(words[0], "rx") == 0;
    size_t arrow = rx ? 2 : 4;
    epicsUInt32 ours;
    row *new;

    if (count < 6 || strcmp(words[arrow], "->"))
        return fail(r, words[0],
                    rx ? "rx <byte> -> P#DB10.DBX0.0 BYTE 8"
                       : "tx P#DB10.DBX0.0 BYTE 8 -> <byte>");
    if (r->count == PLC_POINTER_ROWS)
        return fail(r, words[0], "255 rows");
    new = &r->rows[r->count];
    new->rx = rx;
    if (pointer(r, words + (rx ? 3 : 1), new) ||
        numberOf(r, words[rx ? 1 : 5], BYTE_MAX, &ours))
        return -1;
    new->ours = ours;
    new->name = nameOf(words, count, 6);
    r->count++;
    return 0;
}

static int line(reading *r, char **words, size_t count)
{
    const char *value = count > 1 ? words[1] : NULL;

    if (epicsStrCaseCmp(words[0], "tx") == 0 || epicsStrCaseCmp(words[0], "rx") == 0)
        return rowLine(r, words, count);
    if (epicsStrCaseCmp(words[0], "layout") == 0)
        return numberOf(r, value, 65535, &r->layout);
    if (epicsStrCaseCmp(words[0], "ie_tx") == 0)
        return numberOf(r, value, 65535, &r->ieTx);
    if (epicsStrCaseCmp(words[0], "ie_rx") == 0)
        return numberOf(r, value, 65535, &r->ieRx);
    if (epicsStrCaseCmp(words[0], "crc") == 0) {
        r->hasCrc = 1;
        return numberOf(r, value, 0xffffffff, &r->crc);
    }
    return fail(r, words[0], "layout, ie_tx, ie_rx, crc, tx, rx");
}

static size_t split(char *text, char **words, size_t most)
{
    size_t count = 0;
    char *save = NULL, *word = epicsStrtok_r(text, " \t\r\n", &save);

    while (word && count < most && (word[0] != '#')) {
        words[count++] = word;
        word = epicsStrtok_r(NULL, " \t\r\n", &save);
    }
    return count;
}

/* Of a very long line only the names at its end are lost. */
static void skipRest(const char *text, FILE *file)
{
    int c = strchr(text, '\n') ? '\n' : 0;

    while (c != '\n' && c != EOF)
        c = getc(file);
}

static int readLines(reading *r, FILE *file)
{
    char text[500], *words[40], why[200];
    char *error = r->error;
    size_t size = r->size, count;
    unsigned number = 0;
    int failed = 0;

    r->error = why;
    r->size = sizeof(why);
    while (!failed && fgets(text, sizeof(text), file)) {
        number++;
        skipRest(text, file);
        count = split(text, words, 40);
        failed = count && line(r, words, count);
        if (failed)
            epicsSnprintf(error, size, "line %u: %s", number, why);
    }
    r->error = error;
    r->size = size;
    return -failed;
}

static void big(epicsUInt8 *bytes, size_t size, epicsUInt32 value)
{
    while (size--) {
        bytes[size] = (epicsUInt8)value;
        value >>= 8;
    }
}

static void any(epicsUInt8 *bytes, unsigned area, unsigned db, unsigned byte,
                unsigned count)
{
    bytes[0] = 0x10;
    bytes[1] = 0x02;
    big(bytes + 2, 2, count);
    big(bytes + 4, 2, db);
    big(bytes + 6, 4, (epicsUInt32)area << 24 | byte * 8);
}

epicsUInt32 plcPointersCrc(const epicsUInt8 *bytes, size_t size)
{
    epicsUInt32 crc = 0xffffffff;
    size_t i;
    int bit;

    for (i = 0; i < size; i++) {
        crc ^= i >= 6 && i < HEAD ? 0 : bytes[i];
        for (bit = 0; bit < 8; bit++)
            crc = crc & 1 ? crc >> 1 ^ 0xedb88320 : crc >> 1;
    }
    return crc ^ 0xffffffff;
}

static void addRow(plcPointers *table, const reading *r, row *from, unsigned to)
{
    epicsUInt8 *bytes = table->bytes + HEAD + to * ROW;

    any(bytes + (from->rx ? ROW / 2 : 0), from->area, from->db, from->byte, from->count);
    any(bytes + (from->rx ? 0 : ROW / 2), 0x84, from->rx ? r->ieRx : r->ieTx, from->ours,
        from->count);
    table->names[to] = from->name;
    from->name = NULL;
}

static plcPointers *make(reading *r)
{
    plcPointers *table = callocMustSucceed(1, sizeof(*table), "plcPointers");
    unsigned i, to = 0;
    int rx;

    table->size = HEAD + r->count * ROW;
    table->bytes = callocMustSucceed(1, table->size, "plcPointers");
    table->names = callocMustSucceed(r->count, sizeof(char *), "plcPointers");
    for (rx = 0; rx < 2; rx++)
        for (i = 0; i < r->count; i++)
            if (r->rows[i].rx == rx)
                addRow(table, r, &r->rows[i], to++);
    for (i = 0; i < r->count; i++)
        table->rowsRx += (unsigned)r->rows[i].rx;
    table->rowsTx = r->count - table->rowsRx;
    big(table->bytes, 2, r->layout);
    big(table->bytes + 2, 2, table->rowsTx);
    big(table->bytes + 4, 2, table->rowsRx);
    big(table->bytes + 6, 4, plcPointersCrc(table->bytes, table->size));
    return table;
}

plcPointers *plcPointersRead(FILE *file, char *error, size_t size)
{
    reading r = {.count = 0, .ieTx = 1, .ieRx = 2, .error = error, .size = size};
    plcPointers *table = NULL;
    unsigned i;

    if (readLines(&r, file))
        goto done;
    if (!r.count) {
        epicsSnprintf(error, size, "there is no row");
        goto done;
    }
    table = make(&r);
    if (r.hasCrc && r.crc != plcPointersCrc(table->bytes, table->size)) {
        epicsSnprintf(error, size, "the file says crc 0x%08X, its rows have 0x%08X",
                      (unsigned)r.crc,
                      (unsigned)plcPointersCrc(table->bytes, table->size));
        plcPointersFree(table);
        table = NULL;
    }
done:
    for (i = 0; i < r.count; i++)
        free(r.rows[i].name);
    return table;
}

void plcPointersFree(plcPointers *table)
{
    unsigned i;

    if (!table)
        return;
    for (i = 0; i < table->rowsTx + table->rowsRx; i++)
        free(table->names[i]);
    free(table->names);
    free(table->bytes);
    free(table);
}

unsigned plcPointersLayout(const plcPointers *table)
{
    return (unsigned)table->bytes[0] << 8 | table->bytes[1];
}

const char *plcPointersRowName(const plcPointers *table, int row)
{
    int rows = (int)(table->rowsTx + table->rowsRx);

    return row >= 0 && row < rows ? table->names[row] : "";
}
