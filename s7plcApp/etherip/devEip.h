/* What the files of the device support "EtherIP" share: from the link to a tag's place, and
 * between place and record. Private to devEip*.c.
 *
 * All functions run with the record locked and block no longer than a copy takes.
 */
#ifndef INC_devEip_H
#define INC_devEip_H

#include "devS7plc.h"
#include "eipLink.h"
#include "eipPlc.h"

/* What a record is kept for, beside its devRecord. */
typedef struct devEip {
    eipPlc *plc;
    eipPlace *place;      /* NULL: a statistic */
    unsigned period;      /* ms */
    size_t at;            /* of the place in both images, bytes */
    size_t room;          /* of the place, bytes */
    epicsUInt32 elements; /* of an array */
    const eipType *holds; /* what the record can have of it, NULL: any number */
    int counted;          /* an index that counts bits led to it: not one of single BOOLs */
    int ofNumber;         /* its bits are the low ones of the whole number, none was named */
    unsigned shift;       /* of the bits that are the record's own; all: dev->mask is 0 */
    epicsUInt64 across;   /* bits that lie in two elements; 0: they do not. Inputs: the place
                           * is an array of two */
    eipPlace *second;     /* outputs: the place of the other element */
    plcLastPut last;      /* of it */
    int output;
    int force;            /* the PLC's value is written over, not followed, */
    int forced;           /* once the record has a value of its own */
    epicsUInt64 turns;    /* reads of its period there were before it was written */
    eipStatistic statistic;
    char misfit[PLC_REASON_SIZE]; /* outputs: why the record cannot have what the PLC shows */
} devEip;

static inline devEip *eipOf(const devRecord *dev)
{
    return (devEip *)dev->own;
}

/* --- From the link to a place: functions for `resolve` of a row --------------------------- */

/* A number, or some of its bits. */
int devEipNumber(dbCommon *prec, devRecord *dev, const char *text, plcLinkError *error);
/* One bit; NOBT bits: without B= an index counts bits of DINTs. */
int devEipBit(dbCommon *prec, devRecord *dev, const char *text, plcLinkError *error);
int devEipBits(dbCommon *prec, devRecord *dev, const char *text, plcLinkError *error);
/* A string, an array. */
int devEipText(dbCommon *prec, devRecord *dev, const char *text, plcLinkError *error);
int devEipArray(dbCommon *prec, devRecord *dev, const char *text, plcLinkError *error);

/* --- Between place and record --------------------------------------------------------------- */

/* The number of the place, its own bits only. Returns 0, or -1 with an alarm. */
long devEipFetch(dbCommon *prec, eipNumber *number);

/* The whole place into `bytes` (room bytes), its head too. Returns as devEipFetch. */
long devEipFetchPlace(dbCommon *prec, epicsUInt8 *bytes);

/* Writes a number: whole, or its bits. Returns as devStore. */
long devEipStore(dbCommon *prec, const eipNumber *number);

/* Writes a text / an array of `count` elements, in the byte order of the machine. */
long devEipStoreText(dbCommon *prec, const char *text, size_t length);
long devEipStoreArray(dbCommon *prec, const void *array, size_t count);

/* Elements of the type `from` into those of the record's array; NULL: only to see whether it can
 * have them. Returns 0; or -1 when it cannot have one of them, and why. */
int devEipElements(const devRecord *dev, const eipType *from, const epicsUInt8 *bytes, size_t count,
                   void *array, char reason[PLC_REASON_SIZE]);

/* The record cannot show what the PLC has, for this reason. Returns -1. */
long devEipUnshown(dbCommon *prec, const char *reason);

/* Why there is no value for the record in what the PLC shows of an output: bits that the type has
 * not, a number that the record has not. Returns 0: there is. */
int devEipLacks(const devRecord *dev, char reason[PLC_REASON_SIZE]);

/* The value cannot be written, for this reason. Returns -1. */
long devEipRefuse(dbCommon *prec, const char *format, const char *what);

/* The type of the tag as it was read last, NULL: not known. */
const eipType *devEipType(const devRecord *dev);

/* What the 8 bytes of a cell mean for an output that follows: the nearest number that it has. */
void devEipShown(const devRecord *dev, const epicsUInt8 *bytes, eipNumber *number);

/* Is it none that an output of whole numbers can follow? Then devEipLacks says so. */
int devEipIsNan(const devRecord *dev, const eipNumber *number);

/* The transfer of all outputs: devWrite, or with FORCE the value again. */
long devEipWrite(dbCommon *prec);

/* Will it take the PLC's value, when it processes to follow? */
int devEipFollows(const dbCommon *prec);

/* FORCE: what was refused is written again after the next read, not before. */
int devEipRests(const dbCommon *prec);

/* An integer from a number: a real one is rounded; the nearest one there is. */
epicsInt64 devEipInteger(const eipNumber *number);

extern const char devEipNan[]; /* why NaN is not shown */

static inline eipNumber devEipSigned(epicsInt64 value)
{
    eipNumber number = {eipSigned, {0}};

    number.u.integer = value;
    return number;
}

static inline eipNumber devEipReal(double value)
{
    eipNumber number = {eipReal, {0}};

    number.u.real = value;
    return number;
}

/* The value of a statistic (devEip.statistic). Returns 0, or -1: there is none yet. */
int devEipStatistic(const devRecord *dev, double *value);

#endif /* INC_devEip_H */
