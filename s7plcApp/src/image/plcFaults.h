/* Which bits of an image are bad, and why: a range of registers that the PLC will not show,
 * a value that it refused to take.
 *
 * Knows bytes and words for people; no records, no wire. All functions may be called from
 * any thread and never wait for more than a copy. An image without a fault, the usual case,
 * costs its readers one load.
 */
#ifndef INC_plcFaults_H
#define INC_plcFaults_H

#include <stddef.h>

#include "plcImage.h"

typedef struct plcFaults plcFaults;

/* For an image of `size` bytes. */
plcFaults *plcFaultsCreate(size_t size);
void plcFaultsDestroy(plcFaults *faults);

/* These bits (mask NULL: all of the bytes) are bad from now on, for this reason; it takes
 * the place of an earlier one. Returns 1 when that is news: a bit was good before, or had
 * another reason; else 0. */
int plcFaultsSet(plcFaults *faults, size_t offset, size_t length, const void *mask,
                 const char *reason);

/* These bits are good again. Returns 1 when one of them was not, else 0. */
int plcFaultsClear(plcFaults *faults, size_t offset, size_t length, const void *mask);

/* Everything is good again. Returns 1 when something was not, else 0. */
int plcFaultsClearAll(plcFaults *faults);

/* Returns 1 and the reason (of the first bad byte) when one of these bits is bad; else 0
 * and "". */
int plcFaultsFind(plcFaults *faults, size_t offset, size_t length, const void *mask,
                  char reason[PLC_REASON_SIZE]);

/* Fills *mask, as long as the image, with the bad bits. Returns 1; or 0, without filling it, when there
 * are none. */
int plcFaultsMask(plcFaults *faults, void *mask);

/* How many bits of these bytes are bad. */
size_t plcFaultsCount(plcFaults *faults, size_t offset, size_t length);

#endif /* INC_plcFaults_H */
