/* The blocks of a station for people: bytes in hex with the records that own them, who
 * overlaps whom, which bytes nobody uses. For s7plcShow and dbior. */
#ifndef INC_plcShow_H
#define INC_plcShow_H

#include <stdio.h>

#include "plcStation.h"

/* what: "in", "out" or "records". Returns 0, or -1 when it is none of these. Any thread. */
int plcShow(plcStation *station, const char *what, FILE *file);

#endif /* INC_plcShow_H */
