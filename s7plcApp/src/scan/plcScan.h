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

#include <dbCommon.h>
#include <dbScan.h>

typedef struct plcScan plcScan;

/* Called from the thread of the pass when it is over; no lock is held. `requested` is the
 * monotonic time (ns) of the oldest request that this pass answered. A pass for which a
 * callback queue was full is not over before it was tried again: no call until then. No
 * call for a request that concerns no record at all. */
typedef void plcScanDone(void *pvt, epicsUInt64 requested);

/* `done` may be NULL. Functions below may be called from any thread, done() included, and
 * do not block; none calls done() itself (but see plcScanHere). */
plcScan *plcScanCreate(size_t blockSize, plcScanDone *done, void *pvt);

/* Only the first bytes of a block are in use, at most blockSize: others never change. */
void plcScanUse(plcScan *scan, size_t size);

/* For unit tests: no record is in the lists any more and no pass runs. The lists
 * themselves are Base's: testdbCleanup frees them. */
void plcScanDestroy(plcScan *scan);

/* Before any record joins: 0 = one group of all records (scan=all, the default),
 * 1 = a group for each distinct byte range (scan=changed). */
void plcScanByRange(plcScan *scan, int byRange);

/* 1: from now on only the calling thread asks for passes, and they run in that thread, before
 * the request returns: it does not hold a lock then, and may wait for records. This holds
 * for passes over records of one priority, the others go to the callback threads as ever;
 * and of a large pass only for its first records. No pass runs there any more after one
 * that took longer than 20 ms. 0: none does (as in the beginning). */
void plcScanHere(plcScan *scan, int on);

/* How long a pass has held that thread up, ms, so that it gets none any more; else 0. */
double plcScanHeld(plcScan *scan);

/* A record that reads `length` bytes at `offset` joins, or leaves; `leave` as
 * get_ioint_info gets it (0 join, 1 leave), which calls this with the record locked. The
 * passes process it, by PHAS among the records of its group; and once there were passes, one
 * in a callback thread at once, as soon as the record is unlocked: bytes that stand still
 * would ask for none. Returns the list to give to Base: the same for all, and never scanned.
 */
IOSCANPVT plcScanRecord(plcScan *scan, size_t offset, size_t length, dbCommon *prec,
                        int leave);

/* The same when the record is not known, only its PRIO: a list of Base's for these bytes,
 * which the passes scan. PLC_SCAN_ANY_PRIO: not even that is known (device support of others,
 * through s7plcGetInScanPvt), and passes go through all three from then on. */
#define PLC_SCAN_ANY_PRIO (-1)
IOSCANPVT plcScanJoin(plcScan *scan, size_t offset, size_t length, int prio, int leave);

/* Asks for a pass over all records. Returns 1 when it was merged into one that was
 * already waiting (coalesced), 0 when it starts or will start a pass of its own.
 * Before iocInit is through and while the IOC is paused no pass begins, as with
 * scanIoRequest, but the request stays for the next one that comes later. When a callback
 * queue is full, what could not be queued is tried again, soon and on its own. */
int plcScanRequestAll(plcScan *scan);

/* A callback could not be queued and is asked for again: says so, once while the process lives. No lock
 * is held. */
void plcScanQueueFull(void);

/* Asks for a pass over the groups whose bytes differ between the two blocks of blockSize
 * bytes; with one group only, always that one. Returns as plcScanRequestAll. */
int plcScanRequestChanged(plcScan *scan, const void *before, const void *after);

/* After a pause of the IOC: begins the pass that has become due meanwhile, if any. */
void plcScanResume(plcScan *scan);

/* True while a pass runs. */
int plcScanBusy(plcScan *scan);

/* Records that are in the lists now. */
unsigned plcScanCount(plcScan *scan);

#endif /* INC_plcScan_H */
