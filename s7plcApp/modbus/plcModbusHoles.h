/* What a Modbus PLC refuses to show, as the log names it: runs of registers or bits, each once,
 * neighbours together.
 *
 * Pure: no requests, no log, no lock.
 */
#ifndef INC_plcModbusHoles_H
#define INC_plcModbusHoles_H

#include "plcModbusPlan.h"

typedef struct plcHole {
    plcTable table;
    int unit; /* as in a range */
    unsigned start, count;
    int code; /* why: whatever the caller has for it */
} plcHole;

/* In the order of tables, then of addresses; 0 at first. */
typedef struct plcHoles {
    plcHole *hole;
    unsigned count, room;
} plcHoles;

void plcHolesFree(plcHoles *h); /* empty then, and can be used again */

/* Adds one; what touches it, or overlaps, of the same table, unit and code becomes one with it. */
void plcHolesAdd(plcHoles *h, plcHole hole);

/* Adds to `to` what of the hole is not among `known`; anyCode: for whatever reason that is there. */
void plcHolesRest(plcHoles *to, plcHole hole, const plcHoles *known, int anyCode);

/* Adds to `to` what of `known` lies in the hole. */
void plcHolesWithin(plcHoles *to, plcHole hole, const plcHoles *known);

#endif /* INC_plcModbusHoles_H */
