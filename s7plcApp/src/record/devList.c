/* Lists of the records of a PLC, each for one purpose: who follows, whose alarm depends on the
 * PLC, who is silent, who waits for a put.
 *
 * Knows nothing of these purposes. The lock is only held to look at a list or to change it, never
 * while a record is locked by us or processes.
 */
#include <cantProceed.h>
#include <dbDefs.h>
#include <epicsAssert.h>
#include <epicsMutex.h>

#include "devS7plc.h"

STATIC_ASSERT(devListKinds <= PLC_LISTS);

static plcLists *enter(plcStation *station)
{
    plcLists *lists = plcStationLists(station);

    epicsMutexMustLock(lists->lock);
    return lists;
}

void devListJoin(devRecord *dev, devListKind which)
{
    plcLists *lists = enter(dev->station);

    if (!devIsIn(dev, which))
        ellAdd(&lists->list[which], &dev->member[which].node);
    dev->in |= 1u << which;
    dev->member[which].dev = dev;
    epicsMutexUnlock(lists->lock);
}

int devListLeave(devRecord *dev, devListKind which)
{
    plcLists *lists;
    int was;

    if (!dev->station)
        return 0;
    lists = enter(dev->station);
    was = devIsIn(dev, which);
    if (was)
        ellDelete(&lists->list[which], &dev->member[which].node);
    dev->in &= ~(1u << which);
    epicsMutexUnlock(lists->lock);
    return was;
}

dbCommon **devListRecords(plcStation *station, devListKind which, size_t *count)
{
    plcLists *lists = enter(station);
    ELLLIST *list = &lists->list[which];
    dbCommon **records =
        callocMustSucceed((size_t)ellCount(list) + 1, sizeof(*records), "devListRecords");
    ELLNODE *node;

    *count = 0;
    for (node = ellFirst(list); node; node = ellNext(node))
        records[(*count)++] = CONTAINER(node, devMember, node)->dev->prec;
    epicsMutexUnlock(lists->lock);
    return records;
}

dbCommon *devListTake(plcStation *station, devListKind which, int (*ready)(devRecord *dev))
{
    plcLists *lists = enter(station);
    dbCommon *prec = NULL;
    ELLNODE *node;

    for (node = ellFirst(&lists->list[which]); node && !prec; node = ellNext(node)) {
        devRecord *dev = CONTAINER(node, devMember, node)->dev;

        if (ready(dev)) {
            prec = dev->prec;
            dev->in &= ~(1u << which);
            ellDelete(&lists->list[which], node);
            break;
        }
    }
    epicsMutexUnlock(lists->lock);
    return prec;
}
