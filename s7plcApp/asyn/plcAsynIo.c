/* The interfaces of a port that move values: the functions that asyn calls, in the thread of
 * the caller. Knows no image: what it reads and writes goes through plcAsynBytes.c. */
#include <stdlib.h>

#include <alarm.h>
#include <asynFloat32Array.h>
#include <asynFloat64.h>
#include <asynFloat64Array.h>
#include <asynInt16Array.h>
#include <asynInt32.h>
#include <asynInt32Array.h>
#include <asynInt8Array.h>
#include <asynOctet.h>
#include <asynUInt32Digital.h>
#include <cantProceed.h>

#include "plcAsynPort.h"

#ifdef HAVE_ASYN_INT64
#include <asynInt64.h>
#include <asynInt64Array.h>
#endif

#define ALL_BITS 0xFFFFFFFFu

/* --- asynInt32, asynInt64, asynUInt32Digital, asynFloat64 ------------------------ */

static asynStatus readInt(plcAsynPort *port, asynUser *user, plcAsynFace face,
                          epicsInt64 *value)
{
    plcAsynView *view = plcAsynViewOf(port, user, face);
    epicsUInt8 bytes[PLC_ASYN_SCALAR];
    asynStatus status;

    if (!view)
        return asynError;
    status = plcAsynRead(port, user, view, view->length, bytes);
    if (status == asynSuccess)
        *value = plcAsynGetInt(view, bytes);
    return status;
}

static asynStatus writeInt(plcAsynPort *port, asynUser *user, plcAsynFace face,
                           epicsInt64 value, epicsUInt32 digitalMask)
{
    plcAsynView *view = plcAsynOutputOf(port, user, face);
    epicsUInt8 bytes[PLC_ASYN_SCALAR], bits[PLC_ASYN_SCALAR];
    const epicsUInt8 *mask = NULL;
    char error[80];

    if (!view)
        return asynError;
    if (plcAsynPutInt(view, value, bytes, error, sizeof(error)))
        return plcAsynFail(user, asynError, WRITE_ALARM, "%s: %s", port->name, error);
    if (view->bit >= 0) {
        mask = view->mask;
    } else if (digitalMask != ALL_BITS) {
        plcPutInt(view->type, bits, view->order, (epicsInt64)digitalMask);
        mask = bits;
    }
    return plcAsynWrite(port, user, view, view->length, bytes, mask);
}

/* L and H, for LINR=LINEAR; 0 and 0, which leave the scale alone, where they do not fit.
 */
static asynStatus boundsOf(plcAsynPort *port, asynUser *user, plcAsynFace face,
                           epicsInt64 limit, epicsInt64 *low, epicsInt64 *high)
{
    plcAsynView *view = plcAsynViewOf(port, user, face);

    *low = *high = 0;
    if (!view)
        return asynError;
    if (view->bit < 0 && view->high <= limit) {
        *low = view->low;
        *high = view->high;
    }
    return asynSuccess;
}

static asynStatus readInt32(void *pvt, asynUser *user, epicsInt32 *value)
{
    epicsInt64 whole;
    asynStatus status = readInt(pvt, user, plcAsynInt32, &whole);

    if (status == asynSuccess)
        *value = (epicsInt32)whole;
    return status;
}

static asynStatus writeInt32(void *pvt, asynUser *user, epicsInt32 value)
{
    return writeInt(pvt, user, plcAsynInt32, value, ALL_BITS);
}

static asynStatus boundsInt32(void *pvt, asynUser *user, epicsInt32 *low,
                              epicsInt32 *high)
{
    epicsInt64 low64, high64;
    asynStatus status = boundsOf(pvt, user, plcAsynInt32, 0x7FFFFFFF, &low64, &high64);

    *low = (epicsInt32)low64;
    *high = (epicsInt32)high64;
    return status;
}

static asynStatus joinInt32(void *pvt, asynUser *user, interruptCallbackInt32 callback,
                            void *userPvt, void **registrar)
{
    return plcAsynJoin(pvt, user, plcAsynInt32, ALL_BITS, (plcAsynCallback)callback,
                       userPvt, registrar);
}

static asynStatus leave(void *pvt, asynUser *user, void *registrar)
{
    return plcAsynLeave(pvt, user, registrar);
}

static asynInt32 int32Face = {writeInt32, readInt32, boundsInt32, joinInt32, leave};

static void callInt32(plcAsynUser *u, const void *bytes)
{
    ((interruptCallbackInt32)u->callback)(u->userPvt, u->own,
                                          (epicsInt32)plcAsynGetInt(u->view, bytes));
}

#ifdef HAVE_ASYN_INT64
static asynStatus readInt64(void *pvt, asynUser *user, epicsInt64 *value)
{
    return readInt(pvt, user, plcAsynInt64, value);
}

static asynStatus writeInt64(void *pvt, asynUser *user, epicsInt64 value)
{
    return writeInt(pvt, user, plcAsynInt64, value, ALL_BITS);
}

static asynStatus boundsInt64(void *pvt, asynUser *user, epicsInt64 *low,
                              epicsInt64 *high)
{
    return boundsOf(pvt, user, plcAsynInt64, 0x7FFFFFFFFFFFFFFFLL, low, high);
}

static asynStatus joinInt64(void *pvt, asynUser *user, interruptCallbackInt64 callback,
                            void *userPvt, void **registrar)
{
    return plcAsynJoin(pvt, user, plcAsynInt64, ALL_BITS, (plcAsynCallback)callback,
                       userPvt, registrar);
}

static asynInt64 int64Face = {writeInt64, readInt64, boundsInt64, joinInt64, leave};

static void callInt64(plcAsynUser *u, const void *bytes)
{
    ((interruptCallbackInt64)u->callback)(u->userPvt, u->own,
                                          plcAsynGetInt(u->view, bytes));
}
#endif

static asynStatus readDigital(void *pvt, asynUser *user, epicsUInt32 *value,
                              epicsUInt32 mask)
{
    epicsInt64 whole;
    asynStatus status = readInt(pvt, user, plcAsynUInt32Digital, &whole);

    if (status == asynSuccess)
        *value = (epicsUInt32)whole & mask;
    return status;
}

/* Only the bits in the mask count, so that no value is too large. */
static asynStatus writeDigital(void *pvt, asynUser *user, epicsUInt32 value,
                               epicsUInt32 mask)
{
    plcAsynView *view = plcAsynViewOf(pvt, user, plcAsynUInt32Digital);
    unsigned bits = view ? 8 * view->type->size : 32;

    if (bits < 32)
        value &= ((epicsUInt32)1 << bits) - 1;
    return writeInt(pvt, user, plcAsynUInt32Digital, value & mask, mask);
}

static asynStatus joinDigital(void *pvt, asynUser *user,
                              interruptCallbackUInt32Digital callback, void *userPvt,
                              epicsUInt32 mask, void **registrar)
{
    return plcAsynJoin(pvt, user, plcAsynUInt32Digital, mask, (plcAsynCallback)callback,
                       userPvt, registrar);
}

static asynUInt32Digital digitalFace = {
    .write = writeDigital,
    .read = readDigital,
    .registerInterruptUser = joinDigital,
    .cancelInterruptUser = leave,
};

static void callDigital(plcAsynUser *u, const void *bytes)
{
    epicsUInt32 mask =
        u->mask ? (epicsUInt32)plcGetInt(u->view->type, u->maskBytes, u->view->order)
                : ALL_BITS;
    epicsUInt32 value = (epicsUInt32)plcAsynGetInt(u->view, bytes);

    ((interruptCallbackUInt32Digital)u->callback)(
        u->userPvt, u->own, u->view->bit < 0 ? value & mask : value);
}

static asynStatus readFloat64(void *pvt, asynUser *user, epicsFloat64 *value)
{
    plcAsynView *view = plcAsynViewOf(pvt, user, plcAsynFloat64);
    epicsUInt8 bytes[PLC_ASYN_SCALAR];
    asynStatus status;

    if (!view)
        return asynError;
    status = plcAsynRead(pvt, user, view, view->length, bytes);
    if (status == asynSuccess)
        *value = plcAsynGetReal(view, bytes);
    return status;
}

static asynStatus writeFloat64(void *pvt, asynUser *user, epicsFloat64 value)
{
    plcAsynPort *port = pvt;
    plcAsynView *view = plcAsynOutputOf(port, user, plcAsynFloat64);
    epicsUInt8 bytes[PLC_ASYN_SCALAR];
    char error[80];

    if (!view)
        return asynError;
    if (plcAsynPutReal(view, value, bytes, error, sizeof(error)))
        return plcAsynFail(user, asynError, WRITE_ALARM, "%s: %s", port->name, error);
    return plcAsynWrite(port, user, view, view->length, bytes,
                      view->bit < 0 ? NULL : view->mask);
}

static asynStatus joinFloat64(void *pvt, asynUser *user,
                              interruptCallbackFloat64 callback, void *userPvt,
                              void **registrar)
{
    return plcAsynJoin(pvt, user, plcAsynFloat64, ALL_BITS, (plcAsynCallback)callback,
                       userPvt, registrar);
}

static asynFloat64 float64Face = {writeFloat64, readFloat64, joinFloat64, leave};

static void callFloat64(plcAsynUser *u, const void *bytes)
{
    ((interruptCallbackFloat64)u->callback)(u->userPvt, u->own,
                                            plcAsynGetReal(u->view, bytes));
}

/* --- asynOctet ------------------------------------------------------------------- */

static asynStatus readOctet(void *pvt, asynUser *user, char *data, size_t max,
                            size_t *got, int *reason)
{
    plcAsynView *view = plcAsynViewOf(pvt, user, plcAsynOctet);
    asynStatus status;
    char *bytes;

    *got = 0;
    if (reason)
        *reason = ASYN_EOM_END;
    if (!view)
        return asynError;
    bytes = mallocMustSucceed(view->length + 1, "s7plcAsyn");
    status = plcAsynRead(pvt, user, view, view->length, bytes);
    if (status == asynSuccess)
        *got = plcAsynGetText(view, bytes, view->length, data, max);
    free(bytes);
    return status;
}

static asynStatus writeOctet(void *pvt, asynUser *user, const char *data, size_t length,
                             size_t *wrote)
{
    plcAsynPort *port = pvt;
    plcAsynView *view = plcAsynOutputOf(port, user, plcAsynOctet);
    asynStatus status;
    epicsUInt8 *bytes;

    *wrote = 0;
    if (!view)
        return asynError;
    if (view->open)
        return plcAsynFail(user, asynError, WRITE_ALARM,
                           "%s \"%s\": L= (length) is needed to write a string",
                           port->name, view->place->text);
    bytes = mallocMustSucceed(view->length + 1, "s7plcAsyn");
    plcAsynPutText(view, data, length, bytes);
    status = plcAsynWrite(port, user, view, view->length, bytes, NULL);
    free(bytes);
    if (status == asynSuccess)
        *wrote = length;
    return status;
}

/* Nothing is buffered. */
static asynStatus flushOctet(void *pvt, asynUser *user)
{
    (void)pvt, (void)user;
    return asynSuccess;
}

static asynStatus joinOctet(void *pvt, asynUser *user, interruptCallbackOctet callback,
                            void *userPvt, void **registrar)
{
    return plcAsynJoin(pvt, user, plcAsynOctet, ALL_BITS, (plcAsynCallback)callback,
                       userPvt, registrar);
}

static asynOctet octetFace = {
    .write = writeOctet,
    .read = readOctet,
    .flush = flushOctet,
    .registerInterruptUser = joinOctet,
    .cancelInterruptUser = leave,
};

static void callOctet(plcAsynUser *u, const void *bytes)
{
    size_t length = u->view->length;
    char *text = mallocMustSucceed(length + 1, "s7plcAsyn");
    size_t count = plcAsynGetText(u->view, bytes, length, text, length + 1);

    ((interruptCallbackOctet)u->callback)(u->userPvt, u->own, text, count, ASYN_EOM_END);
    free(text);
}

/* --- Arrays ---------------------------------------------------------------------- */

static asynStatus readArray(plcAsynPort *port, asynUser *user, plcAsynFace face,
                            void *values, size_t max, size_t *got)
{
    plcAsynView *view = plcAsynViewOf(port, user, face);
    asynStatus status;
    size_t n;
    char *bytes;

    *got = 0;
    if (!view)
        return asynError;
    n = view->length / view->type->size;
    n = n < max ? n : max;
    bytes = mallocMustSucceed(n * view->type->size + 1, "s7plcAsyn");
    status = plcAsynRead(port, user, view, n * view->type->size, bytes);
    if (status == asynSuccess) {
        plcAsynGetArray(view, bytes, values, n);
        *got = n;
    }
    free(bytes);
    return status;
}

static asynStatus writeArray(plcAsynPort *port, asynUser *user, plcAsynFace face,
                             const void *values, size_t n)
{
    plcAsynView *view = plcAsynOutputOf(port, user, face);
    asynStatus status;
    epicsUInt8 *bytes;

    if (!view)
        return asynError;
    if (n > view->length / view->type->size)
        return plcAsynFail(user, asynError, WRITE_ALARM,
                           "%s \"%s\": %lu elements; there is room for %lu", port->name,
                           view->place->text, (unsigned long)n,
                           (unsigned long)(view->length / view->type->size));
    if (n == 0)
        return asynSuccess;
    bytes = mallocMustSucceed(n * view->type->size, "s7plcAsyn");
    plcAsynPutArray(view, values, bytes, n);
    status = plcAsynWrite(port, user, view, n * view->type->size, bytes, NULL);
    free(bytes);
    return status;
}

/* clang-format off */
/* What the functions of the array interfaces differ in is the type of their elements,
 * which asyn has in their signatures. */
#define ARRAY_FACE(NAME, TYPE)                                                        \
    static asynStatus read##NAME(void *pvt, asynUser *user, TYPE *value, size_t max,  \
                                 size_t *got)                                         \
    {                                                                                 \
        return readArray(pvt, user, plcAsyn##NAME, value, max, got);                  \
    }                                                                                 \
    static asynStatus write##NAME(void *pvt, asynUser *user, TYPE *value, size_t n)   \
    {                                                                                 \
        return writeArray(pvt, user, plcAsyn##NAME, value, n);                        \
    }                                                                                 \
    static asynStatus join##NAME(void *pvt, asynUser *user,                           \
                                 interruptCallback##NAME callback, void *userPvt,     \
                                 void **registrar)                                    \
    {                                                                                 \
        return plcAsynJoin(pvt, user, plcAsyn##NAME, ALL_BITS, (plcAsynCallback)callback,\
                           userPvt, registrar);                                       \
    }                                                                                 \
    static void call##NAME(plcAsynUser *u, const void *bytes)                         \
    {                                                                                 \
        size_t n = u->view->length / u->view->type->size;                             \
        TYPE *values = mallocMustSucceed(u->view->length + 1, "s7plcAsyn");           \
                                                                                      \
        plcAsynGetArray(u->view, bytes, values, n);                                   \
        ((interruptCallback##NAME)u->callback)(u->userPvt, u->own, values, n);        \
        free(values);                                                                 \
    }                                                                                 \
    static asyn##NAME face##NAME = {write##NAME, read##NAME, join##NAME, leave};

/* clang-format on */
ARRAY_FACE(Int8Array, epicsInt8)
ARRAY_FACE(Int16Array, epicsInt16)
ARRAY_FACE(Int32Array, epicsInt32)
#ifdef HAVE_ASYN_INT64
ARRAY_FACE(Int64Array, epicsInt64)
#endif
ARRAY_FACE(Float32Array, epicsFloat32)
ARRAY_FACE(Float64Array, epicsFloat64)

/* --- All of them ----------------------------------------------------------------- */

/* asynOctet has more arguments than the others. */
static asynStatus beginOctet(const char *portName, asynInterface *face)
{
    return pasynOctetBase->initialize(portName, face, 0, 0, 0);
}

static const struct {
    const char *type;
    void *methods;
    void (*call)(plcAsynUser *user, const void *bytes);
} faces[plcAsynFaces] = {
    /* clang-format off */
    [plcAsynInt32] = {asynInt32Type, &int32Face, callInt32},
    [plcAsynUInt32Digital] = {asynUInt32DigitalType, &digitalFace, callDigital},
    [plcAsynFloat64] = {asynFloat64Type, &float64Face, callFloat64},
    [plcAsynOctet] = {asynOctetType, &octetFace, callOctet},
    [plcAsynInt8Array] = {asynInt8ArrayType, &faceInt8Array, callInt8Array},
    [plcAsynInt16Array] = {asynInt16ArrayType, &faceInt16Array, callInt16Array},
    [plcAsynInt32Array] = {asynInt32ArrayType, &faceInt32Array, callInt32Array},
    [plcAsynFloat32Array] = {asynFloat32ArrayType, &faceFloat32Array, callFloat32Array},
    [plcAsynFloat64Array] = {asynFloat64ArrayType, &faceFloat64Array, callFloat64Array},
#ifdef HAVE_ASYN_INT64
    [plcAsynInt64] = {asynInt64Type, &int64Face, callInt64},
    [plcAsynInt64Array] = {asynInt64ArrayType, &faceInt64Array, callInt64Array},
#endif
    /* clang-format on */
};

/* Lets asyn fill in what we have no function for; it says so when it is called. */
static asynStatus begin(plcAsynPort *port, plcAsynFace i)
{
    asynInterface *face = &port->faces[i];

    if (i == plcAsynOctet)
        return beginOctet(port->name, face);
    if (i == plcAsynUInt32Digital)
        return pasynUInt32DigitalBase->initialize(port->name, face);
    return pasynManager->registerInterface(port->name, face);
}

static void call(plcAsynUser *user, const void *bytes)
{
    faces[user->view->face].call(user, bytes);
}

int plcAsynIoRegister(plcAsynPort *port)
{
    int i;

    port->call = call;
    for (i = 0; i < plcAsynFaces; i++) {
        if (!faces[i].type)
            continue;
        port->faces[i].interfaceType = faces[i].type;
        port->faces[i].pinterface = faces[i].methods;
        port->faces[i].drvPvt = port;
        if (begin(port, (plcAsynFace)i) != asynSuccess)
            return -1;
    }
    return 0;
}
