/* I/O Intr scanning of the records of one station and one direction.
 *
 * Knows byte ranges, not types or sockets. Each record belongs to a group; a request asks
 * for all groups or for those whose bytes changed; a pass processes them once for each
 * callback priority in use. While a pass runs, further requests gather and become one
 * more pass: at most one callback per priority is ever in the callback queue, so that it
 * cannot overflow, however fast the PLC sends.
 */
#ifndef INC_plcScan_H
#define INC_plcScan_H

#include <stddef.h>

#include <dbScan.h>

typedef struct plcScan plcScan;

/* Called from a callback thread when a pass is over; no lock is held. `requested` is the
 * monotonic time (ns) of the oldest request that this pass answered. A pass for which a
 * callback queue was full is not over before it was tried again: no call until then. No
 * call for a request that concerns no record at all. */
typedef void plcScanDone(void *pvt, epicsUInt64 requested);

/* `done` may be NULL. Functions below may be called from any thread, done() included, and
 * do not block; none calls done() itself. */
plcScan *plcScanCreate(size_t blockSize, plcScanDone *done, void *pvt);

/* For unit tests: no record is in the lists any more and no pass runs. The lists
 * themselves are Base's: testdbCleanup frees them. */
void plcScanDestroy(plcScan *scan);

/* Before any record joins: 0 = one group of all records (scan=all, the default),
 * 1 = a group for each distinct byte range (scan=changed). */
void plcScanByRange(plcScan *scan, int byRange);

/* The list for a record that reads `length` bytes at `offset`; for get_ioint_info.
 * `prio` is the record's PRIO; `leave` as get_ioint_info gets it (0 join, 1 leave). */
IOSCANPVT plcScanJoin(plcScan *scan, size_t offset, size_t length, int prio, int leave);

/* Asks for a pass over all records. Returns 1 when it was merged into one that was
 * already waiting (coalesced), 0 when it starts or will start a pass of its own.
 * Before iocInit is through and while the IOC is paused no pass begins, as with
 * scanIoRequest, but the request stays for the next one that comes later. The same holds
 * when a callback queue is full: only what could not be queued is tried again. */
int plcScanRequestAll(plcScan *scan);

/* Asks for a pass over the groups whose bytes differ between the two blocks of blockSize
 * bytes; with one group only, always that one. Returns as plcScanRequestAll. */
int plcScanRequestChanged(plcScan *scan, const void *before, const void *after);

/* True while a pass runs. */
int plcScanBusy(plcScan *scan);

/* Records that are in the lists now. */
unsigned plcScanCount(plcScan *scan);

#endif /* INC_plcScan_H */
