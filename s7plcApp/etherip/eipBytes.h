/* Bytes of a message, little-endian, read and written one after the other without ever
 * leaving the buffer.
 *
 * Knows no protocol. A reader that is asked for more than there is gives zeros and is `bad`
 * from then on; a writer that has no room left is `full` and writes nothing more. So a
 * message is taken apart, or made, first, and checked once at its end. Pure; any thread.
 */
#ifndef INC_eipBytes_H
#define INC_eipBytes_H

#include <stddef.h>
#include <string.h>

#include <epicsTypes.h>

typedef struct eipReader {
    const epicsUInt8 *at;
    size_t left; /* bytes */
    int bad;     /* more was asked for than there is */
} eipReader;

typedef struct eipWriter {
    epicsUInt8 *start;
    size_t room; /* bytes */
    size_t n;    /* bytes that are written */
    int full;    /* something had no room */
} eipWriter;

static inline eipReader eipReaderOf(const void *bytes, size_t length)
{
    eipReader r = {(const epicsUInt8 *)bytes, length, 0};

    return r;
}

/* The next n bytes, or NULL: there are not so many. */
static inline const epicsUInt8 *eipTake(eipReader *r, size_t n)
{
    const epicsUInt8 *at = r->at;

    if (r->bad || n > r->left) {
        r->bad = 1;
        return NULL;
    }
    r->at += n;
    r->left -= n;
    return at;
}

/* An unsigned number of `size` bytes, 1 to 8. */
static inline epicsUInt64 eipGetUnsigned(const epicsUInt8 *at, unsigned size)
{
    epicsUInt64 value = 0;

    while (size)
        value = value << 8 | at[--size];
    return value;
}

static inline epicsUInt64 eipTakeUnsigned(eipReader *r, unsigned size)
{
    const epicsUInt8 *at = eipTake(r, size);

    return at ? eipGetUnsigned(at, size) : 0;
}

static inline unsigned eipTake8(eipReader *r)
{
    return (unsigned)eipTakeUnsigned(r, 1);
}

static inline unsigned eipTake16(eipReader *r)
{
    return (unsigned)eipTakeUnsigned(r, 2);
}

static inline epicsUInt32 eipTake32(eipReader *r)
{
    return (epicsUInt32)eipTakeUnsigned(r, 4);
}

static inline eipWriter eipWriterOf(void *bytes, size_t room)
{
    eipWriter w = {(epicsUInt8 *)bytes, room, 0, 0};

    return w;
}

/* Room for the next n bytes, or NULL: there is none. */
static inline epicsUInt8 *eipRoom(eipWriter *w, size_t n)
{
    epicsUInt8 *at = w->start + w->n;

    if (w->full || n > w->room - w->n) {
        w->full = 1;
        return NULL;
    }
    w->n += n;
    return at;
}

static inline void eipSetUnsigned(epicsUInt8 *at, unsigned size, epicsUInt64 value)
{
    unsigned i;

    for (i = 0; i < size; i++)
        at[i] = (epicsUInt8)(value >> 8 * i);
}

static inline void eipPutUnsigned(eipWriter *w, unsigned size, epicsUInt64 value)
{
    epicsUInt8 *at = eipRoom(w, size);

    if (at)
        eipSetUnsigned(at, size, value);
}

static inline void eipPut8(eipWriter *w, unsigned value)
{
    eipPutUnsigned(w, 1, value);
}

static inline void eipPut16(eipWriter *w, unsigned value)
{
    eipPutUnsigned(w, 2, value);
}

static inline void eipPut32(eipWriter *w, epicsUInt32 value)
{
    eipPutUnsigned(w, 4, value);
}

static inline void eipPutBytes(eipWriter *w, const void *bytes, size_t n)
{
    epicsUInt8 *at = eipRoom(w, n);

    if (at && n)
        memcpy(at, bytes, n);
}

#endif /* INC_eipBytes_H */
