/* simEipFrame: the encapsulation around CIP messages: the header of 24 bytes and the
 * items behind it. It knows no CIP and no socket.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <string.h>

#include "simEipFrame.h"
#include "simEipTypes.h"

#define ITEM_NULL 0x0000
#define ITEM_MESSAGE 0x00B2
#define ITEM_CONNECTION 0x00A1
#define ITEM_CONNECTED 0x00B1

size_t simEipFrameSize(const epicsUInt8 *bytes, size_t size)
{
    size_t whole;

    if (size < SIM_EIP_HEADER)
        return 0;
    whole = SIM_EIP_HEADER + (size_t)simEipGet(bytes + 2, 2);
    return size < whole ? 0 : whole;
}

void simEipFrameParse(simEipFrame *frame, const epicsUInt8 *bytes, size_t size)
{
    frame->command = (unsigned)simEipGet(bytes, 2);
    frame->session = (epicsUInt32)simEipGet(bytes + 4, 4);
    frame->context = bytes + 12;
    frame->options = (epicsUInt32)simEipGet(bytes + 20, 4);
    frame->data = bytes + SIM_EIP_HEADER;
    frame->size = size - SIM_EIP_HEADER;
}

/* One item. Returns the bytes it takes, 0 when it is not all there. */
static size_t takeItem(const epicsUInt8 *p, size_t left, unsigned *type, size_t *size)
{
    if (left < 4)
        return 0;
    *type = (unsigned)simEipGet(p, 2);
    *size = (size_t)simEipGet(p + 2, 2);
    return *size <= left - 4 ? 4 + *size : 0;
}

int simEipItemsParse(const simEipFrame *frame, simEipItems *items)
{
    int connected = frame->command == EIP_UNIT_DATA;
    const epicsUInt8 *p = frame->data;
    size_t left = frame->size;
    unsigned first, second;
    size_t firstSize, secondSize, taken;

    memset(items, 0, sizeof(*items));
    if (left < 16)
        return ENCAP_BAD_LENGTH;
    if (simEipGet(p, 4) != 0 || simEipGet(p + 6, 2) != 2)
        return ENCAP_BAD_DATA;
    p += 8;
    left -= 8;
    taken = takeItem(p, left, &first, &firstSize);
    if (!taken)
        return ENCAP_BAD_DATA;
    if (connected && firstSize == 4)
        items->id = (epicsUInt32)simEipGet(p + 4, 4);
    p += taken;
    left -= taken;
    taken = takeItem(p, left, &second, &secondSize);
    if (!taken || taken != left)
        return ENCAP_BAD_DATA;
    items->message = p + 4;
    items->size = secondSize;
    if (!connected)
        return first == ITEM_NULL && !firstSize && second == ITEM_MESSAGE
                   ? ENCAP_OK
                   : ENCAP_BAD_DATA;
    if (first != ITEM_CONNECTION || firstSize != 4 || second != ITEM_CONNECTED ||
        secondSize < 2)
        return ENCAP_BAD_DATA;
    items->sequence = (unsigned)simEipGet(p + 4, 2);
    items->message += 2;
    items->size -= 2;
    return ENCAP_OK;
}

void simEipFrameHeader(epicsUInt8 *out, const simEipFrame *request, epicsUInt32 session,
                       unsigned status, size_t size)
{
    simEipPut(out, 2, request->command);
    simEipPut(out + 2, 2, size);
    simEipPut(out + 4, 4, session);
    simEipPut(out + 8, 4, status);
    memcpy(out + 12, request->context, 8);
    simEipPut(out + 20, 4, 0);
}

size_t simEipFrameAround(epicsUInt8 *out, const simEipFrame *request, epicsUInt32 id,
                         unsigned sequence, size_t size)
{
    int connected = request->command == EIP_UNIT_DATA;
    size_t at = connected ? SIM_EIP_UNIT_MESSAGE : SIM_EIP_RR_MESSAGE;
    epicsUInt8 *p = out + SIM_EIP_HEADER;

    simEipFrameHeader(out, request, request->session, ENCAP_OK,
                      at + size - SIM_EIP_HEADER);
    simEipPut(p, 6, 0); /* interface, timeout */
    simEipPut(p + 6, 2, 2);
    p += 8;
    if (!connected) {
        simEipPut(p, 4, 0);
        simEipPut(p + 4, 2, ITEM_MESSAGE);
        simEipPut(p + 6, 2, size);
        return at + size;
    }
    simEipPut(p, 2, ITEM_CONNECTION);
    simEipPut(p + 2, 2, 4);
    simEipPut(p + 4, 4, id);
    simEipPut(p + 8, 2, ITEM_CONNECTED);
    simEipPut(p + 10, 2, size + 2);
    simEipPut(p + 12, 2, sequence);
    return at + size;
}
