/* Frames of EtherNet/IP; see eipFrame.h. */
#include "eipFrame.h"

enum {
    itemNull = 0x00,
    itemConnection = 0xa1,
    itemConnected = 0xb1,
    itemUnconnected = 0xb2,
    placeLength = 2,
    placeUnconnected = eipHeaderSize + 12, /* of the item that is ended later */
    placeConnected = eipHeaderSize + 16
};

void eipFrameBegin(eipWriter *w, eipCommand command, epicsUInt32 session,
                   const epicsUInt8 *context)
{
    static const epicsUInt8 none[eipContextSize];

    eipPut16(w, command);
    eipPut16(w, 0);
    eipPut32(w, session);
    eipPut32(w, 0);
    eipPutBytes(w, context ? context : none, eipContextSize);
    eipPut32(w, 0);
}

size_t eipFrameEnd(eipWriter *w)
{
    if (w->full || w->n < eipHeaderSize || w->n > eipFrameMax)
        return 0;
    eipSetUnsigned(w->start + placeLength, 2, w->n - eipHeaderSize);
    return w->n;
}

void eipItemsUnconnected(eipWriter *w, unsigned timeout)
{
    eipPut32(w, 0);
    eipPut16(w, timeout);
    eipPut16(w, 2);
    eipPut16(w, itemNull);
    eipPut16(w, 0);
    eipPut16(w, itemUnconnected);
    eipPut16(w, 0);
}

void eipItemsConnected(eipWriter *w, epicsUInt32 connection, unsigned sequence)
{
    eipPut32(w, 0);
    eipPut16(w, 0);
    eipPut16(w, 2);
    eipPut16(w, itemConnection);
    eipPut16(w, 4);
    eipPut32(w, connection);
    eipPut16(w, itemConnected);
    eipPut16(w, 0);
    eipPut16(w, sequence);
}

void eipItemsEnd(eipWriter *w)
{
    size_t place = w->start[0] == eipSendUnitData ? placeConnected : placeUnconnected;

    if (!w->full)
        eipSetUnsigned(w->start + place + 2, 2, w->n - place - 4);
}

size_t eipFrameLength(const epicsUInt8 *bytes, size_t have)
{
    return have < 4 ? 0 : eipHeaderSize + (size_t)eipGetUnsigned(bytes + placeLength, 2);
}

int eipHeaderTake(eipReader *r, eipHeader *h)
{
    const epicsUInt8 *context;

    h->command = eipTake16(r);
    h->length = eipTake16(r);
    h->session = eipTake32(r);
    h->status = eipTake32(r);
    context = eipTake(r, eipContextSize);
    if (context)
        memcpy(h->context, context, eipContextSize);
    h->options = eipTake32(r);
    return r->bad || h->length != r->left ? -1 : 0;
}

/* Takes the head of an item off; `item` is what it holds. */
static unsigned takeItem(eipReader *r, eipReader *item)
{
    unsigned type = eipTake16(r), length = eipTake16(r);
    const epicsUInt8 *at = eipTake(r, length);

    *item = eipReaderOf(at, at ? length : 0);
    item->bad = !at;
    return type;
}

int eipItemsTake(eipReader *r, unsigned command, eipItems *items)
{
    int connected = command == eipSendUnitData;
    epicsUInt32 interface = eipTake32(r);
    eipReader item;
    unsigned count, type, i;

    memset(items, 0, sizeof(*items));
    eipTake16(r);
    count = eipTake16(r);
    if (r->bad || interface != 0 || count < 2)
        return -1;
    type = takeItem(r, &item);
    if (connected && (type != itemConnection || item.left != 4))
        return -1;
    if (!connected && (type != itemNull || item.left != 0))
        return -1;
    items->connection = connected ? eipTake32(&item) : 0;
    type = takeItem(r, &item);
    if (type != (connected ? itemConnected : itemUnconnected))
        return -1;
    items->sequence = connected ? eipTake16(&item) : 0;
    items->message = item.at;
    items->length = item.left;
    if (item.bad)
        return -1;
    for (i = 2; i < count; i++)
        takeItem(r, &item);
    return r->bad || r->left ? -1 : 0;
}

const char *eipFrameStatusText(epicsUInt32 status)
{
    switch (status) {
    case 0x00:
        return "success";
    case 0x01:
        return "command not known to the PLC";
    case 0x02:
        return "no memory left in the PLC";
    case 0x03:
        return "data not understood by the PLC";
    case 0x64:
        return "session not known to the PLC";
    case 0x65:
        return "length not understood by the PLC";
    case 0x69:
        return "protocol revision not supported";
    default:
        return "encapsulation error";
    }
}
