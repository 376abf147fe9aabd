/* What a drvInfo says: a place in the input or output block, and its bytes as the values
 * of one asyn interface.
 *
 *     [in|out] offset T=type L=low H=high B=bit R=readback W=high|low
 *
 * Parser and codec are those of the records (plcLink, plcCodec). Knows the station; no
 * asyn port, no asynUser, no thread.
 */
#ifndef INC_plcAsynPlace_H
#define INC_plcAsynPlace_H

#include <stddef.h>

#include <ellLib.h>
#include <epicsTypes.h>

#include "plcLink.h"
#include "plcStation.h"
#include "plcOwners.h"

/* The interfaces that move values. */
typedef enum {
    plcAsynInt32,
    plcAsynInt64,
    plcAsynUInt32Digital,
    plcAsynFloat64,
    plcAsynOctet,
    plcAsynInt8Array,
    plcAsynInt16Array,
    plcAsynInt32Array,
    plcAsynInt64Array,
    plcAsynFloat32Array,
    plcAsynFloat64Array,
    plcAsynFaces /* their number */
} plcAsynFace;

#define PLC_ASYN_SCALAR 8 /* bytes of the widest single value */

struct plcAsynPlace;

/* A place seen through one interface. It does not change once it is made. */
typedef struct plcAsynView {
    struct plcAsynPlace *place;
    plcAsynFace face;
    char *refused;       /* why this interface does not fit the place; NULL: it fits */
    char *doubt;         /* what looks like a mistake though it fits; NULL: nothing */
    const plcType *type; /* of one element */
    size_t offset;       /* bytes from the start of the block */
    size_t length;       /* bytes of the value, of the string, of the array */
    int open;            /* no L=: length is all there is up to the end of the block */
    int bit;             /* B=, or -1 */
    int clips;           /* L= or H= was given: what is written is cut to low..high */
    epicsInt64 low, high;
    int order;       /* of its bytes: plcCodec.h */
    int hasReadback; /* the input block shows it at */
    size_t readback; /* this offset */
    int follows;     /* the PLC shows it, there or as it is (Modbus with track=on) */
    plcFaults
        *faults; /* bits that the PLC did not give or take; NULL: it does not tell */
    epicsUInt8 mask[PLC_ASYN_SCALAR]; /* with B=: its bit, in wire order */
    plcOwner owner;                   /* for s7plcShow */
} plcAsynView;

/* A drvInfo that was accepted. Places live as long as the program. */
typedef struct plcAsynPlace {
    ELLNODE node;
    plcStation *station;
    char *text; /* as given */
    int output; /* 0: in the input block, 1: in the output block */
    plcLink link;
    plcAsynView *views[plcAsynFaces]; /* NULL: not used yet */
    ELLLIST users;                    /* plcAsynUser.atPlace: those who are called back */
} plcAsynPlace;

/* Parses a drvInfo and checks what does not depend on the interface. Returns NULL with
 * one line in error: what is wrong, and what is allowed. *warning (of the same size) is
 * "" or says what looks like a mistake. */
plcAsynPlace *plcAsynPlaceCreate(plcStation *station, const char *text, char *error,
                                 char *warning, size_t size);

/* The place as this interface sees it; never NULL, but see refused. The first call for an
 * interface makes it, and tells the station who uses these bytes. The caller holds a lock
 * that keeps others from doing the same. */
plcAsynView *plcAsynPlaceView(plcAsynPlace *place, plcAsynFace face, const char *port);

/* "asynInt32" */
const char *plcAsynFaceName(plcAsynFace face);

/* Bytes of one element of an array interface; 0: it has single values. */
unsigned plcAsynElementSize(plcAsynFace face);

/* --- Bytes in wire order <-> values ---------------------------------------------- */

/* A coded number with a digit that is none: 1, and what it holds; else 0. */
int plcAsynIsWrong(const plcAsynView *view, const void *bytes, char text[PLC_WRONG_SIZE]);

/* A whole number; with B= it is 0 or 1. A UINT64 comes with its bits unchanged. */
epicsInt64 plcAsynGetInt(const plcAsynView *view, const void *bytes);

/* The same as a floating point number, for any numeric type. */
double plcAsynGetReal(const plcAsynView *view, const void *bytes);

/* Characters up to the first NUL, or of an S7STRING as many as it says, at most `size`, into
 * text. Returns their number; a NUL follows them where there is room. */
size_t plcAsynGetText(const plcAsynView *view, const void *bytes, size_t length,
                      char *text, size_t size);

/* n elements in the order of this machine. */
void plcAsynGetArray(const plcAsynView *view, const void *bytes, void *values, size_t n);

/* The other way. Return 0; or -1 when the value does not fit, with the reason in error:
 * then nothing was written. With L= or H= values are cut to them. */
int plcAsynPutInt(const plcAsynView *view, epicsInt64 value, void *bytes, char *error,
                  size_t size);
int plcAsynPutReal(const plcAsynView *view, double value, void *bytes, char *error,
                   size_t size);

/* Cut off, or filled up with NULs, to view->length bytes; an S7STRING with its head. */
void plcAsynPutText(const plcAsynView *view, const char *text, size_t length,
                    void *bytes);
void plcAsynPutArray(const plcAsynView *view, const void *values, void *bytes, size_t n);

#endif /* INC_plcAsynPlace_H */
