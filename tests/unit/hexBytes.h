/* Bytes of a text as frames are written down in tests. Knows nothing of the driver. */
#ifndef INC_hexBytes_H
#define INC_hexBytes_H

#include <stddef.h>
#include <stdio.h>

#include <epicsTypes.h>

/* Bytes of "0A 0b" or "0A0b", up to the first other character. Returns their number. */
static inline size_t hexBytes(const char *hex, epicsUInt8 *bytes)
{
    size_t n = 0;
    unsigned byte;

    for (; sscanf(hex, "%2x", &byte) == 1; hex += 2 + (hex[2] == ' '))
        bytes[n++] = (epicsUInt8)byte;
    return n;
}

#endif /* INC_hexBytes_H */
