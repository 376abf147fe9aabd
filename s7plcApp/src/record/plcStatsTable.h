/* The statistics of a station by name: one table for the records of DTYP "S7plc stats" and
 * their error messages. docs/statistics.md says what each means.
 *
 * Knows stations and their counters, but no record type.
 */
#ifndef INC_plcStatsTable_H
#define INC_plcStatsTable_H

#include <stddef.h>

#include <epicsTypes.h>

#include "plcStation.h"

typedef enum { /* bits, so that a set of allowed kinds is a mask */
    plcStatInteger = 1,
    plcStatReal = 2,
    plcStatText = 4,
    plcStatArray = 8,
    plcStatOrder = 16 /* no value: a put does something */
} plcStatKind;

#define plcStatNumber (plcStatInteger | plcStatReal)

typedef struct plcStatValue {
    epicsInt64 integer; /* of a real: rounded; of a text: 0 */
    double real;
    char text[PLC_TEXT_SIZE + 1]; /* of a number: its digits */
} plcStatValue;

typedef struct plcStatRow plcStatRow;
struct plcStatRow {
    const char *name; /* "blocksIn" */
    plcStatKind kind;
    void (*get)(const plcStatRow *row, plcStation *station, const plcStats *stats,
                plcStatValue *value);
    size_t field; /* in plcStats, for `get` */
};

/* All of them; ends with a row whose name is NULL. */
extern const plcStatRow plcStatRows[];

/* The row of this name, upper or lower case; NULL if there is none of these kinds. */
const plcStatRow *plcStatFind(const char *name, unsigned kinds);

/* Writes the names of all rows of these kinds, separated by blanks, for error messages. */
void plcStatNames(unsigned kinds, char *text, size_t size);

/* The value now, of a row that is no array. Any thread. */
void plcStatGet(const plcStatRow *row, plcStation *station, plcStatValue *value);

/* Does what an order says (plcStatOrder). Any thread. */
void plcStatDo(const plcStatRow *row, plcStation *station);

/* Fills in at most `room` values of an array row. Returns their number. Any thread. */
size_t plcStatGetArray(const plcStatRow *row, plcStation *station, double *values,
                       size_t room);

#endif /* INC_plcStatsTable_H */
