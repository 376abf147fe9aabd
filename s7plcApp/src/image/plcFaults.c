/* Which bits of an image are bad, and why; see plcFaults.h.
 *
 * For each reason a mask as large as the image. A bit is set in one mask at most. There
 * are as few masks as there were ever reasons at the same time: one that became empty is
 * used again.
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>
#include <epicsMutex.h>
#include <epicsStdio.h>

#include "plcFaults.h"

typedef struct cause {
    struct cause *next;
    size_t count; /* bits set in mask; 0: not in use */
    char reason[PLC_REASON_SIZE];
    epicsUInt8 mask[];
} cause;

struct plcFaults {
    size_t size;
    size_t bad;        /* atomic, written with the lock held: bits in all masks */
    epicsMutexId lock; /* guards the rest */
    cause *causes;
};

plcFaults *plcFaultsCreate(size_t size)
{
    plcFaults *faults = callocMustSucceed(1, sizeof(*faults), "plcFaultsCreate");

    faults->size = size;
    faults->lock = epicsMutexMustCreate();
    return faults;
}

void plcFaultsDestroy(plcFaults *faults)
{
    cause *c;

    if (!faults)
        return;
    while ((c = faults->causes)) {
        faults->causes = c->next;
        free(c);
    }
    epicsMutexDestroy(faults->lock);
    free(faults);
}

static size_t bitsOf(epicsUInt8 byte)
{
    size_t n = 0;

    for (; byte; byte &= (epicsUInt8)(byte - 1))
        n++;
    return n;
}

/* The bits of a cause in byte `offset + i` that are asked for. */
static epicsUInt8 asked(const cause *c, size_t offset, size_t i, const epicsUInt8 *mask)
{
    return (epicsUInt8)(c->mask[offset + i] & (mask ? mask[i] : 0xFF));
}

/* Takes bits out of a cause. Returns how many were in it. */
static size_t takeOut(cause *c, size_t offset, size_t length, const epicsUInt8 *mask)
{
    size_t n = 0, i;
    epicsUInt8 bits;

    for (i = 0; c->count && i < length; i++) {
        bits = asked(c, offset, i, mask);
        if (!bits)
            continue;
        c->mask[offset + i] ^= bits;
        n += bitsOf(bits);
    }
    c->count -= n;
    return n;
}

/* Puts bits into a cause. Returns how many were not in it. */
static size_t putIn(cause *c, size_t offset, size_t length, const epicsUInt8 *mask)
{
    size_t n = 0, i;
    epicsUInt8 bits;

    for (i = 0; i < length; i++) {
        bits = (epicsUInt8)((mask ? mask[i] : 0xFF) & ~c->mask[offset + i]);
        if (!bits)
            continue;
        c->mask[offset + i] |= bits;
        n += bitsOf(bits);
    }
    c->count += n;
    return n;
}

/* The cause of this reason; else one that is not in use, or a new one. */
static cause *causeFor(plcFaults *faults, const char *reason)
{
    char wanted[PLC_REASON_SIZE];
    cause *c, *unused = NULL;

    epicsSnprintf(wanted, sizeof(wanted), "%s", reason);
    for (c = faults->causes; c; c = c->next) {
        if (!c->count)
            unused = c;
        else if (strcmp(c->reason, wanted) == 0)
            return c;
    }
    if (!unused) {
        unused = callocMustSucceed(1, sizeof(*unused) + faults->size, "plcFaultsSet");
        unused->next = faults->causes;
        faults->causes = unused;
    }
    memcpy(unused->reason, wanted, sizeof(wanted));
    return unused;
}

/* The lock is held. */
static void setBad(plcFaults *faults, size_t bad)
{
    __atomic_store_n(&faults->bad, bad, __ATOMIC_RELEASE);
}

static size_t getBad(plcFaults *faults)
{
    return __atomic_load_n(&faults->bad, __ATOMIC_ACQUIRE);
}

int plcFaultsSet(plcFaults *faults, size_t offset, size_t length, const void *mask,
                 const char *reason)
{
    cause *own, *c;
    size_t added, removed = 0;

    epicsMutexMustLock(faults->lock);
    own = causeFor(faults, reason);
    added = putIn(own, offset, length, mask);
    for (c = faults->causes; c && added; c = c->next) {
        if (c != own)
            removed += takeOut(c, offset, length, mask);
    }
    setBad(faults, faults->bad + added - removed);
    epicsMutexUnlock(faults->lock);
    return added != 0;
}

int plcFaultsClear(plcFaults *faults, size_t offset, size_t length, const void *mask)
{
    cause *c;
    size_t removed = 0;

    if (!getBad(faults))
        return 0;
    epicsMutexMustLock(faults->lock);
    for (c = faults->causes; c; c = c->next)
        removed += takeOut(c, offset, length, mask);
    setBad(faults, faults->bad - removed);
    epicsMutexUnlock(faults->lock);
    return removed != 0;
}

int plcFaultsClearAll(plcFaults *faults)
{
    return plcFaultsClear(faults, 0, faults->size, NULL);
}

/* The cause of the lowest bad bit in byte `offset + i`; NULL: none of those asked for is
 * bad. The lock is held. */
static const cause *causeOf(const plcFaults *faults, size_t offset, size_t i,
                            const epicsUInt8 *mask)
{
    const cause *c, *found = NULL;
    unsigned bits, lowest = 0x100;

    for (c = faults->causes; c; c = c->next) {
        bits = asked(c, offset, i, mask);
        bits &= 0u - bits;
        if (bits && bits < lowest) {
            lowest = bits;
            found = c;
        }
    }
    return found;
}

int plcFaultsFind(plcFaults *faults, size_t offset, size_t length, const void *mask,
                  char reason[PLC_REASON_SIZE])
{
    const cause *found = NULL;
    size_t i;

    reason[0] = 0;
    if (!getBad(faults))
        return 0;
    epicsMutexMustLock(faults->lock);
    for (i = 0; !found && i < length; i++)
        found = causeOf(faults, offset, i, mask);
    if (found)
        memcpy(reason, found->reason, PLC_REASON_SIZE);
    epicsMutexUnlock(faults->lock);
    return found != NULL;
}

int plcFaultsMask(plcFaults *faults, void *mask)
{
    epicsUInt8 *to = mask;
    const cause *c;
    size_t i;

    if (!getBad(faults))
        return 0;
    memset(to, 0, faults->size);
    epicsMutexMustLock(faults->lock);
    for (c = faults->causes; c; c = c->next)
        for (i = 0; c->count && i < faults->size; i++)
            to[i] |= c->mask[i];
    epicsMutexUnlock(faults->lock);
    return 1;
}

size_t plcFaultsCount(plcFaults *faults, size_t offset, size_t length)
{
    const cause *c;
    size_t n = 0, i;

    if (!getBad(faults))
        return 0;
    epicsMutexMustLock(faults->lock);
    for (c = faults->causes; c; c = c->next)
        for (i = 0; c->count && i < length; i++)
            n += bitsOf(c->mask[offset + i]);
    epicsMutexUnlock(faults->lock);
    return n;
}
