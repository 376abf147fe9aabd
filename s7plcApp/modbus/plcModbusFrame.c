/* Frames of Modbus; see plcModbusFrame.h. */
#include <stdarg.h>
#include <string.h>

#include <epicsStdio.h>

#include "plcModbusFrame.h"

enum {
    lengthAt = 4, /* of the bytes from the unit on */
    functionAt = 7,
    lengthMin = 3, /* unit, function, one byte */
    lengthMax = plcFrameMax - plcFrameUnit,
    crcSize = 2,
    serverFailure = 4 /* an exception code */
};

int plcModbusLost(plcModbusResult *x, const char *format, ...)
{
    va_list args;

    x->lost = 1;
    va_start(args, format);
    epicsVsnprintf(x->why, sizeof(x->why), format, args);
    va_end(args);
    return -1;
}

static unsigned number(const epicsUInt8 *bytes)
{
    return (unsigned)bytes[0] << 8 | bytes[1];
}

unsigned plcFrameTransaction(const epicsUInt8 *bytes)
{
    return number(bytes);
}

size_t plcFrameSize(const epicsUInt8 *header, plcModbusResult *x)
{
    unsigned length = number(header + lengthAt);

    if (number(header + 2))
        plcModbusLost(x, "bad answer: no Modbus/TCP");
    else if (length < lengthMin || length > lengthMax)
        plcModbusLost(x, "bad answer: length %u", length);
    else
        return plcFrameUnit + length;
    return 0;
}

/* --- Is this the answer? ------------------------------------------------------------------- */

int plcFrameCheckHead(const plcFrame *q, const epicsUInt8 *head, int unit, plcModbusResult *x)
{
    unsigned function = head[functionAt] & 0x7f;

    if (unit >= 0 && head[plcFrameUnit] != unit)
        return plcModbusLost(x, "bad answer: unit %u instead of %d", head[plcFrameUnit], unit);
    if (function != q->bytes[functionAt])
        return plcModbusLost(x, "bad answer: function %u instead of %u", function,
                             q->bytes[functionAt]);
    return 0;
}

/* What is in the length of the answer's header. */
static unsigned expectedLength(const plcFrame *q)
{
    unsigned count = number(q->bytes + 10);

    switch (q->bytes[functionAt]) {
    case 1:
    case 2:
        return 3 + (count + 7) / 8;
    case 3:
    case 4:
        return 3 + 2 * count;
    case 22:
        return 8;
    default: /* writes: address and value or count come back */
        return 6;
    }
}

int plcFrameCheck(const plcFrame *q, const plcFrame *a, plcModbusResult *x)
{
    unsigned length = number(a->bytes + lengthAt);
    unsigned expected = a->bytes[functionAt] & 0x80 ? 3 : expectedLength(q);

    if (length != expected)
        return plcModbusLost(x, "bad answer: %s", length < expected ? "too short" : "too long");
    x->exception = a->bytes[functionAt] & 0x80 ? a->bytes[functionAt + 1] : 0;
    if (a->bytes[functionAt] & 0x80)
        return x->exception ? 0 : plcModbusLost(x, "bad answer: exception 0");
    if (q->bytes[functionAt] <= 4)
        return a->bytes[8] == expected - 3
                   ? 0
                   : plcModbusLost(x, "bad answer: wrong number of bytes");
    if (number(a->bytes + 8) != number(q->bytes + 8))
        return plcModbusLost(x, "bad answer: address %u, not %u", number(a->bytes + 8),
                             number(q->bytes + 8));
    if (memcmp(a->bytes + 10, q->bytes + 10, expected - 4))
        return plcModbusLost(x, "bad answer: not what was written");
    return 0;
}

void plcFrameRefuse(const plcFrame *q, plcFrame *a)
{
    memcpy(a->bytes, q->bytes, plcFrameHead);
    a->bytes[lengthAt] = 0;
    a->bytes[lengthAt + 1] = 3;
    a->bytes[functionAt] |= 0x80;
    a->bytes[plcFrameHead] = serverFailure;
    a->size = plcFrameHead + 1;
}

/* --- RTU ----------------------------------------------------------------------------------- */

/* CRC-16 of the serial line: polynomial 0xA001, from 0xFFFF on. */
static unsigned crcOf(const epicsUInt8 *bytes, size_t size)
{
    unsigned crc = 0xffff, bit;

    while (size--) {
        crc ^= *bytes++;
        for (bit = 0; bit < 8; bit++)
            crc = crc & 1 ? crc >> 1 ^ 0xa001 : crc >> 1;
    }
    return crc;
}

void plcFrameToRtu(const plcFrame *q, plcFrame *rtu)
{
    unsigned crc;

    rtu->size = q->size - plcFrameUnit;
    memcpy(rtu->bytes, q->bytes + plcFrameUnit, rtu->size);
    crc = crcOf(rtu->bytes, rtu->size);
    rtu->bytes[rtu->size++] = (epicsUInt8)crc; /* its low byte first */
    rtu->bytes[rtu->size++] = (epicsUInt8)(crc >> 8);
}

size_t plcRtuSize(const plcFrame *q, const epicsUInt8 *rtu)
{
    return (rtu[1] & 0x80 ? 3 : expectedLength(q)) + crcSize;
}

int plcFrameFromRtu(const plcFrame *q, const epicsUInt8 *rtu, size_t size, plcFrame *a,
                    plcModbusResult *x)
{
    size_t length = size - crcSize;
    unsigned crc = crcOf(rtu, length);

    if (rtu[length] != (crc & 0xff) || rtu[length + 1] != crc >> 8)
        return plcModbusLost(x, "bad answer: wrong CRC");
    memcpy(a->bytes, q->bytes, lengthAt);
    a->bytes[lengthAt] = (epicsUInt8)(length >> 8);
    a->bytes[lengthAt + 1] = (epicsUInt8)length;
    memcpy(a->bytes + plcFrameUnit, rtu, length);
    a->size = plcFrameUnit + length;
    return 0;
}
