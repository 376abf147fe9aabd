/* simValue: values in PLC memory, as numbers and as text. It does not know where they are nor what
 * they are for.
 *
 * Values of several bytes lie in the PLC's byte order (configuration: byteorder).
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simValue_H
#define INC_simValue_H

#include "simMemory.h"

/* One element at p, clipped to the type's range. Not for texts, TIME and DTL. */
void simPutReal(const simTypeInfo *info, epicsUInt8 *p, int bit, int bigEndian,
                double value);
/* An integer of 1, 2, 4 or 8 bytes. */
void simPutInt(epicsUInt8 *p, size_t size, int bigEndian, epicsUInt64 value);
epicsUInt64 simGetInt(const epicsUInt8 *p, size_t size, int bigEndian);
/* Text of a STRING or S7STRING, cut or filled with zeros. */
void simPutText(const simType *type, epicsUInt8 *p, const char *text);
/* Siemens DATE_AND_TIME: 8 bytes BCD  yy mm dd HH MM SS mm mw  (ms and weekday, Sunday
 * 1). `seconds` since 1970 UTC. */
void simPutBcdTime(epicsUInt8 *p, double seconds);
/* Siemens DTL: 12 bytes  yyyy(2) mm dd weekday HH MM SS ns(4). */
void simPutDtl(epicsUInt8 *p, int bigEndian, double seconds);

/* Writes a value given as text (several, for an array). Nothing is written on error. */
int simValueSet(const simMemory *mem, const simPlace *place, const simType *type,
                char **words, size_t count, char error[SIM_ERROR_SIZE]);
/* Adds the value as text to out. */
void simValueGet(const simMemory *mem, const simPlace *place, const simType *type,
                 simText *out);

#endif
