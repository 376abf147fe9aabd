/* What the tests of the device support share: an IOC without network in this process,
 * records made from text, and checks that read as sentences.
 *
 * Input bytes are published straight into the image of a station, output bytes are read
 * back from it: no socket, no PLC.
 */
#ifndef INC_recordTest_H
#define INC_recordTest_H

#include <stddef.h>

#include <epicsTypes.h>

#include "plcStation.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

/* An IOC: begin, make stations and records, run (iocInit), end. */
void iocBegin(void);
void iocRunOk(void);
void iocEnd(void);

/* A station that is never connected. */
plcStation *makeStation(const char *name, int bigEndian, size_t inSize, size_t outSize);

/* A record. fields: "INP=@A/0 T=INT16|LINR=LINEAR"; DTYP is "S7plc" unless given. */
void makeRecord(const char *type, const char *name, const char *fields);

/* The name of the link field of a record type: "INP" or "OUT". */
const char *linkField(const char *type);

/* A block of inSize bytes from the PLC, stamped `seconds` after the EPICS epoch. */
void publish(plcStation *station, const void *block, unsigned seconds);

/* Writes text to a field: numbers, strings (also long ones), arrays as "1,2,3". Returns
 * the status of dbPutField. */
long put(const char *pv, const char *text);

/* The field as text: VAL of bits as number, arrays as "1,2,3". The text is good until the
 * next call. */
const char *get(const char *pv);

/* Passes when the field has this value: as text, or as a number. */
void isValue(const char *pv, const char *expected, const char *title);

/* AMSG came with Base 7.0.6; before, the device support has nobody to tell its words to.
 * isMessage passes when they are these, and is skipped there; saysWhy when there are any; isReason
 * is for conditions together with STAT, and always 1 there. */
void isMessage(const char *record, const char *expected, const char *title);
void saysWhy(const char *record);
int isReason(const char *record, const char *expected);

/* Passes when bytes of the output image are these, written as hex: "01ff". */
void isOutput(plcStation *station, size_t offset, const char *hex, const char *title);

/* Sets bytes of the output image. */
void setOutput(plcStation *station, size_t offset, const char *hex);

/* Hex text to bytes. Returns their number. */
size_t unhex(const char *hex, epicsUInt8 *bytes);

/* What errlog said since the last call. Until then it is kept from the terminal. */
const char *messages(void);

#endif /* INC_recordTest_H */
