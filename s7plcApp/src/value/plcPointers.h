/* A table of pointers as a file of text (.ptr), and as the bytes that a PLC gets.
 *
 * Text and bytes; knows no PLC, and not what a PLC allows. A line is one of
 *
 *   # comment
 *   layout 0x1201                            the layout id, 0 to 65535
 *   ie_tx 1                                  number of the DB that goes to the IOC
 *   ie_rx 2                                  of the DB that comes from it
 *   crc 0x1A2B3C4D                           what the table must have; may be left out
 *   tx P#DB10.DBX0.0 BYTE 8 -> 16  names     PLC memory to byte 16 of IE_TX
 *   rx 4 -> P#DB10.DBX0.0 BYTE 8   names     byte 4 of IE_RX to PLC memory
 *
 * P#M10.0 BYTE 2 are flags. What follows a row names it in messages. The bytes are
 * described in plcTables.h: head, then 20 bytes for each row, big-endian.
 */
#ifndef INC_plcPointers_H
#define INC_plcPointers_H

#include <stddef.h>
#include <stdio.h>

#include <epicsTypes.h>

#define PLC_POINTER_ROWS 255 /* at most, both directions together */

typedef struct plcPointers {
    epicsUInt8 *bytes;
    size_t size;
    unsigned rowsTx, rowsRx;
    char **names; /* of the rows, TX first; "" where there is none */
} plcPointers;

/* Reads a file. Returns NULL with one line in `error` ("line 3: ..."). */
plcPointers *plcPointersRead(FILE *file, char *error, size_t size);

void plcPointersFree(plcPointers *table);

/* CRC-32 of IEEE 802.3 over the bytes of a table, of which 6 to 9, its own, count as 0.
 */
epicsUInt32 plcPointersCrc(const epicsUInt8 *bytes, size_t size);

unsigned plcPointersLayout(const plcPointers *table);

/* What the file calls a row, "" when it calls it nothing or there is no such row. */
const char *plcPointersRowName(const plcPointers *table, int row);

#endif /* INC_plcPointers_H */
