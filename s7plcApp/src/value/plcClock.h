/* The clock of a PLC as it stands in a block, turned into EPICS time.
 *
 * Pure. PLC clocks have no time zone: they are read as UTC; the offset PV shows what a
 * clock in local time is off by.
 */
#ifndef INC_plcClock_H
#define INC_plcClock_H

#include <epicsTime.h>

/* Siemens DATE_AND_TIME ("DT", S7-300/400), 8 bytes, BCD:
 *   0 year (90..99 = 1990.., 0..89 = 2000..)  1 month  2 day  3 hour  4 minute  5 second
 *   6 ms, hundreds and tens                   7 ms, ones (high nibble), weekday (low)
 * Siemens DTL (S7-1200/1500), 12 bytes:
 *   0 year (UINT16)  2 month  3 day  4 weekday  5 hour  6 minute  7 second  8 ns (UINT32)
 * both numbers of DTL in the byte order of the block. */
#define PLC_CLOCK_DT_SIZE 8
#define PLC_CLOCK_DTL_SIZE 12

/* Return 0, or -1 when the bytes are no date: then *stamp is untouched. */
int plcClockDateAndTime(const void *bytes, epicsTimeStamp *stamp);
int plcClockDtl(const void *bytes, int bigEndian, epicsTimeStamp *stamp);

#endif /* INC_plcClock_H */
