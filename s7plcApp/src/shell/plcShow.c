/* The blocks of a station for people; see plcShow.h. Works on copies. */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsStdio.h>
#include <epicsString.h>

#include "plcShow.h"
#include "plcOwners.h"

#define ROW 16        /* bytes in a line */
#define MAX_PAIRS 100 /* overlaps that are told one by one */

/* What is shown of one direction. */
typedef struct view {
    FILE *file;
    plcStation *station;
    int output;
    size_t size;
    epicsUInt8 *bytes;
    plcOwner *owners; /* sorted by offset */
    size_t count;
} view;

static int viewOpen(view *v, plcStation *s, int output, FILE *file)
{
    memset(v, 0, sizeof(*v));
    v->file = file;
    v->station = s;
    v->output = output;
    v->size = plcImageSize(output ? plcStationOutput(s) : plcStationInput(s));
    v->owners = plcOwnersCopy(plcStationOwners(s), output, &v->count);
    v->bytes = malloc(v->size + 1);
    if (!v->owners || !v->bytes)
        return -1;
    plcImagePeek(output ? plcStationOutput(s) : plcStationInput(s), 0, v->size, v->bytes);
    return 0;
}

static void viewClose(view *v)
{
    free(v->owners);
    free(v->bytes);
}

/* --- One record --------------------------------------------------------------------------*/

/* "INT16", "INT16 bit 3", "INT16 bits 00F0", "INT32 W=low"; `name`: of the type */
static void typeText(const plcOwner *owner, const char *name, char *text, size_t size)
{
    unsigned bit = 0;
    size_t used;

    epicsSnprintf(text, size, "%s", name);
    used = strlen(text);
    if (owner->mask && owner->mask != ~(epicsUInt64)0) {
        while (!(owner->mask >> bit & 1))
            bit++;
        if (owner->mask == (epicsUInt64)1 << bit)
            epicsSnprintf(text + used, size - used, " bit %u", bit);
        else
            epicsSnprintf(text + used, size - used, " bits %0*llX",
                          (int)owner->type->size * 2, (unsigned long long)owner->mask);
    }
    used = strlen(text);
    if (owner->type->kind & plcText) {
        if (owner->order != plcTextABCD)
            epicsSnprintf(text + used, size - used, " W=%s", plcTextOrderName(owner->order));
    } else if (owner->order & plcWordsSwapped)
        epicsSnprintf(text + used, size - used, " W=%s",
                      owner->order & plcBigEndian ? "low" : "high");
}

/* The value as it stands in the block; "" for arrays. */
static void valueText(const view *v, const plcOwner *owner, char *text, size_t size)
{
    const epicsUInt8 *bytes = v->bytes + owner->offset;
    char chars[160]; /* more than a line shows */
    size_t count;
    epicsUInt64 raw;
    char *end;

    text[0] = 0;
    if (owner->type->kind & plcText && size > 12) {
        strcpy(text, " = \"");
        count = plcGetText(owner->type, bytes, owner->length, owner->order, chars,
                           sizeof(chars));
        epicsStrnEscapedFromRaw(text + 4, size - 6, chars, count);
        end = text + strlen(text);
        strcpy(end, "\"");
    } else if (owner->length != owner->type->size || owner->type->kind == plcBcd) {
        return;
    } else if (owner->type->kind == plcReal) {
        epicsSnprintf(text, size, " = %.7g", plcGetReal(owner->type, bytes, owner->order));
    } else if (owner->mask) {
        raw = (epicsUInt64)plcGetInt(owner->type, bytes, owner->order) & owner->mask;
        for (epicsUInt64 mask = owner->mask; !(mask & 1); mask >>= 1)
            raw >>= 1;
        epicsSnprintf(text, size, " = %llu", (unsigned long long)raw);
    } else {
        epicsSnprintf(text, size, " = %lld",
                      (long long)plcGetInt(owner->type, bytes, owner->order));
    }
}

/* "4-7", or "4" for a single byte */
static void placeText(size_t offset, size_t length, char *text, size_t size)
{
    if (length == 1)
        epicsSnprintf(text, size, "%lu", (unsigned long)offset);
    else
        epicsSnprintf(text, size, "%lu-%lu", (unsigned long)offset,
                      (unsigned long)(offset + length - 1));
}

static void printOwner(const view *v, const plcOwner *owner)
{
    char place[48], name[300], type[340], value[80], number[60] = "";
    int told = plcStationTells(v->station, v->bytes, owner->offset, name, sizeof(name), number,
                               sizeof(number));

    placeText(owner->offset, owner->length, place, sizeof(place));
    typeText(owner, told ? name : owner->type->name, type, sizeof(type));
    if (told && !owner->mask)
        epicsSnprintf(value, sizeof(value), "%s%s", number[0] ? " = " : "", number);
    else
        valueText(v, owner, value, sizeof(value));
    fprintf(v->file, "        %-11s %s (%s %s)%s", place, owner->name, owner->recordType, type,
            value);
    if (owner->hasReadback)
        fprintf(v->file, ", read back at %lu", (unsigned long)owner->readback);
    if (owner->unwritten)
        fprintf(v->file, ", never written");
    fprintf(v->file, "\n");
}

/* --- The block ---------------------------------------------------------------------------*/

static void printBytes(const view *v, size_t row)
{
    size_t i;

    fprintf(v->file, "  %6lu ", (unsigned long)row);
    for (i = row; i < row + ROW; i++) {
        if (i < v->size)
            fprintf(v->file, "%s%02x", i % 4 ? " " : "  ", v->bytes[i]);
        else
            fprintf(v->file, "%s  ", i % 4 ? " " : "  ");
    }
    fprintf(v->file, "   ");
    for (i = row; i < row + ROW && i < v->size; i++)
        fputc(isprint(v->bytes[i]) ? v->bytes[i] : '.', v->file);
    fprintf(v->file, "\n");
}

/* Lines of 16 bytes, each with the records that begin in it. Lines of zeros that nobody
 * uses are left out. */
static void printBlock(const view *v)
{
    size_t row, next = 0, i, end = 0;
    int skipped = 0;

    for (row = 0; row < v->size; row += ROW) {
        int zero = row >= end;

        for (i = row; zero && i < row + ROW && i < v->size; i++)
            zero = v->bytes[i] == 0;
        if (zero && row && (next == v->count || v->owners[next].offset >= row + ROW)) {
            if (!skipped)
                fprintf(v->file, "       *  zeros\n");
            skipped = 1;
            continue;
        }
        skipped = 0;
        printBytes(v, row);
        for (; next < v->count && v->owners[next].offset < row + ROW; next++) {
            printOwner(v, &v->owners[next]);
            i = v->owners[next].offset + v->owners[next].length;
            if (i > end)
                end = i;
        }
    }
}

static void printOverlaps(const view *v)
{
    size_t i, j, pairs = 0;
    char left[48], right[48];

    for (i = 0; i < v->count; i++) {
        const plcOwner *a = &v->owners[i];

        for (j = i + 1; j < v->count && v->owners[j].offset < a->offset + a->length; j++) {
            const plcOwner *b = &v->owners[j];

            if (!plcOwnersOverlap(a, b) || ++pairs > MAX_PAIRS)
                continue;
            if (pairs == 1)
                fprintf(v->file, "  Overlaps:\n");
            placeText(a->offset, a->length, left, sizeof(left));
            placeText(b->offset, b->length, right, sizeof(right));
            fprintf(v->file, "        %s at %s and %s at %s\n", a->name, left, b->name,
                    right);
        }
    }
    if (pairs > MAX_PAIRS)
        fprintf(v->file, "        and %lu more\n", (unsigned long)(pairs - MAX_PAIRS));
    if (!pairs)
        fprintf(v->file, "  Overlaps: none\n");
}

static void mark(const view *v, char *used, size_t offset, size_t length)
{
    if (offset <= v->size && length <= v->size - offset)
        memset(used + offset, 1, length);
}

/* A byte for each of the block, 1 where a record has it; the input also by read-backs of outputs. */
static char *usedBytes(const view *v)
{
    char *used = callocMustSucceed(v->size + 1, 1, "s7plcShow");
    size_t i, count = 0;
    plcOwner *outputs = v->output ? NULL : plcOwnersCopy(plcStationOwners(v->station), 1, &count);

    for (i = 0; i < v->count; i++)
        mark(v, used, v->owners[i].offset, v->owners[i].length);
    for (i = 0; outputs && i < count; i++)
        if (outputs[i].hasReadback)
            mark(v, used, outputs[i].readback, outputs[i].length);
    free(outputs);
    return used;
}

static void printUnused(const view *v)
{
    char *used = usedBytes(v), place[48];
    size_t i, start, total = 0;

    fprintf(v->file, "  Bytes that no record %s:", v->output ? "writes" : "reads");
    for (i = 0; i < v->size;) {
        for (start = i; i < v->size && !used[i]; i++)
            ;
        if (i > start) {
            placeText(start, i - start, place, sizeof(place));
            fprintf(v->file, "%s %s", total ? "," : "", place);
            total += i - start;
        }
        while (i < v->size && used[i])
            i++;
    }
    free(used);
    if (total)
        fprintf(v->file, " (%lu of %lu)\n", (unsigned long)total, (unsigned long)v->size);
    else
        fprintf(v->file, " none\n");
}

static void showBlock(plcStation *s, int output, FILE *file)
{
    char reason[PLC_REASON_SIZE];
    view v;

    if (viewOpen(&v, s, output, file) == 0) {
        plcImageReason(plcStationInput(s), reason);
        fprintf(file, "%s %s: %lu bytes, %lu records%s%s\n", plcStationName(s),
                output ? "out, IOC -> PLC" : "in, PLC -> IOC", (unsigned long)v.size,
                (unsigned long)v.count, !output && reason[0] ? ", not valid: " : "",
                output ? "" : reason);
        printBlock(&v);
        printOverlaps(&v);
        printUnused(&v);
    }
    viewClose(&v);
}

static void showRecords(plcStation *s, FILE *file)
{
    int output;

    for (output = 0; output < 2; output++) {
        view v;
        size_t i;

        if (viewOpen(&v, s, output, file) == 0) {
            fprintf(file, "%s: %lu %s records\n", plcStationName(s),
                    (unsigned long)v.count, output ? "output" : "input");
            for (i = 0; i < v.count; i++)
                printOwner(&v, &v.owners[i]);
        }
        viewClose(&v);
    }
}

int plcShow(plcStation *s, const char *what, FILE *file)
{
    if (epicsStrCaseCmp(what, "in") == 0)
        showBlock(s, 0, file);
    else if (epicsStrCaseCmp(what, "out") == 0)
        showBlock(s, 1, file);
    else if (epicsStrCaseCmp(what, "records") == 0)
        showRecords(s, file);
    else
        return -1;
    return 0;
}
