/* What the files of the device support share: one row per record type (devSupport), one
 * structure per record (devRecord), and the few functions through which record adapters
 * meet the images. Private to device support.
 *
 * The files, each of which calls only those before it: devRecord, devList; devS7plcAway,
 * devS7plcSilent; devS7plcFollow; devPut; devTransfer; devS7plc; one for each kind of record.
 *
 * Knows links, types, images and stations; a record's own fields are the business of the
 * adapter of its record type.
 *
 * All functions run with the record locked (init, processing, put to a link) and block
 * no longer than a copy of the record's bytes takes.
 */
#ifndef INC_devS7plc_H
#define INC_devS7plc_H

#include <stddef.h>

#include <dbCommon.h>
#include <devSup.h>
#include <ellLib.h>
#include <epicsTypes.h>

#include "plcLink.h"
#include "plcStation.h"
#include "plcOwners.h"

struct plcStatRow;
struct aoRecord;
struct aaiRecord;
struct aaoRecord;

#define DEV_SCALAR 8 /* bytes of the widest element */

typedef enum {
    devIn,     /* INP in the input block; I/O Intr: with each block */
    devOut,    /* OUT in the output block; I/O Intr: each sendInterval */
    devStatus, /* no place in a block; I/O Intr: with each block, and on loss */
    devStatistics /* nor this; the link names a statistic; I/O Intr: once a second too */
} devDirection;

/* The lists of a PLC's records. */
typedef enum {
    devFollowers, /* outputs with a read-back */
    devWaiting,   /* outputs whose alarm depends on what becomes of their value */
    devSilent,    /* inputs with I/O Intr that no block has made process */
    devPutting,   /* outputs that are active until their put is through, in their order */
    devListKinds
} devListKind;

/* Membership of a record in one of them. */
typedef struct devMember {
    ELLNODE node;
    struct devRecord *dev;
} devMember;

/* What is kept for one record: its dpvt. */
typedef struct devRecord {
    plcStation *station; /* NULL: the link was refused */
    char *reason;        /* why, in words for AMSG; NULL when the link is good */
    plcImage *image;     /* input or output of the station */
    plcFaults *faults;   /* its bits that the PLC did not give or take; NULL: cannot be */
    const plcType *type; /* of one element */
    size_t offset;       /* bytes from the start of the block */
    size_t length;       /* bytes of the whole value */
    size_t head;         /* bytes before it that tell what it is: it is news when they change, too */
    int order;           /* of its bytes: plcCodec.h */
    unsigned has;    /* options that stood in the link: plcHasT | ... */
    unsigned in;     /* bits of devListKind: the lists that it is in; looked at for each value
                        that is read, and so in the lines that a pass fetches ahead */
    int buffered;    /* prepare sets this: make a buffer */
    size_t readback; /* R=: offset in the input block, when has & plcHasR */
    epicsInt64 low;  /* L= and H= of integer types */
    epicsInt64 high;
    epicsUInt64 mask; /* single bits (bi, bo): the bits of the element that are ours */
    epicsUInt32 *shifted;  /* MASK of a multibit record, which we have shifted by SHFT, */
    epicsUInt32 unshifted; /* and what it was; NULL and 0 else */
    const struct plcStatRow *statistic; /* of a devStatistics record */
    dbCommon *prec;
    const epicsEnum16 *simm; /* its field SIMM, NULL: it has none; */
    struct link *siml;       /* and SIML */
    devMember member[devListKinds];
    plcOwner owner; /* its place, for people; in a list while `listed` */
    int listed;
    int lost; /* an input with I/O Intr that has processed since its PLC was lost */
    epicsUInt8 *buffer; /* strings, arrays: `length` bytes in wire order, else NULL */
    /* outputs with a read-back */
    epicsUInt8 *shown; /* the bytes that VAL shows now, NULL: no read-back */
    int known;         /* shown is filled, */
    int taken;         /* by what the PLC has, not by a put */
    int unproven;      /* put, and the PLC's values were not taken since */
    int following;     /* the record processes in order to follow, not to write */
    int takes;         /* plcStationTakes when it followed last */
    int refused;       /* the write that runs was refused by the station */
    int cut;           /* the last value did not fit: what is written is another one */
    /* outputs that are active until the PLC has taken or refused their put */
    plcPutMark mark; /* of the last put; number 0: the record does not wait */
    int pulses;       /* bo: its last put is a 1, at whose end the record itself puts a 0; */
    int ended;        /* that 0 comes still, and is not written: it began at the place before this one */
    const char *ends; /* with this alarm it ends, since its link changes; NULL: it does not */
    /* outputs whose value waits for the PLC, or was refused by it */
    epicsEnum16 raised; /* the record has this alarm for it (COMM, WRITE; 0: none), instead of */
    epicsEnum16 hiddenStatus, hiddenSeverity; /* this one */
    plcLastPut last; /* what became of its last put; its alarm, until the next one */
    /* a wire that has links of its own */
    void *own; /* what its resolve has made, */
    void (*forget)(struct devRecord *dev); /* and what ends it; NULL: nothing */
    /* Outputs: returns 1 when the PLC does not show their place, and why. NULL: it does. */
    int (*unseen)(const struct devRecord *dev, char reason[PLC_REASON_SIZE]);
} devRecord;

/* One row per record type. A dset (its head is all that Base sees), with what the generic
 * code must know of the record type behind it. */
typedef struct devSupport {
    dset common;
    long (*transfer)(dbCommon *prec); /* read_xx or write_xx of the dset */
    /* special_linconv of ai and ao, or NULL */
    long (*linconv)(dbCommon *prec, int after);
    const char *dtyp;  /* "S7plc" and */
    const char *field; /* "INP" or "OUT", for messages */
    devDirection direction;
    plcShape shape;
    long initStatus; /* what init_record returns: 2 = keep VAL, do not convert */
    /* Adapts the shape to the fields of this record (FTVL of arrays) and sets *room to
     * the bytes of its own string. Returns 0 or -1 with *error. NULL: nothing to adapt.
     */
    int (*adapt)(dbCommon *prec, const plcLink *link, plcShape *shape, size_t *room,
                 plcLinkError *error);
    /* Prepares record and dev (masks, slopes, length), once the link is complete.
     * Returns 0 or -1 with *error. NULL: nothing to prepare. */
    int (*prepare)(dbCommon *prec, devRecord *dev, const plcLink *link,
                   plcLinkError *error);
    /* Outputs, whose transfer is devWrite: writes the value; sets the value from bytes in
     * wire order, as a put would have set it, without writing. */
    long (*write)(dbCommon *prec);
    void (*follow)(dbCommon *prec, const devRecord *dev, const epicsUInt8 *bytes);
    /* calcout: it does not process to follow, since that would calculate, and its write may
     * come later (ODLY): 1 when it is about to. NULL: other record types. */
    int (*delays)(const dbCommon *prec);
    /* bo: the field HIGH, after which a 1 that was put is put back to 0. NULL: others. */
    double *(*pulse)(dbCommon *prec);
    /* With pulse: 1 when the record itself puts the 0 at the end of a pulse, for all that is known. */
    int (*pulseEnds)(const dbCommon *prec);
    /* Links of its own: from the text to the station, and to a place in an image (image,
     * faults, type, offset, length, order, mask). Returns 0 or -1 with *error. NULL:
     * "@PLC/offset ...". */
    int (*resolve)(dbCommon *prec, devRecord *dev, const char *text, plcLinkError *error);
    /* Outputs that may decide not to follow: will it take the PLC's value, when it processes to
     * follow? NULL: always. */
    int (*follows)(const dbCommon *prec);
    /* 1: it does not process to follow now, but is to be asked again with the next news of the PLC.
     * NULL: never. */
    int (*rests)(const dbCommon *prec);
} devSupport;

static inline const devSupport *devSupportOf(const dbCommon *prec)
{
    return (const devSupport *)prec->dset;
}

/* The head of every row. */
#define DEV_DSET {6, NULL, devInit, devInitRecord, devIointInfo}

static inline int devIsIn(const devRecord *dev, devListKind which)
{
    return dev->in >> which & 1;
}

/* The record is in this list of its PLC from now on / no longer: returns 1 when it was. */
void devListJoin(devRecord *dev, devListKind which);
int devListLeave(devRecord *dev, devListKind which);

/* The records that are in it now, in an array to be freed. */
dbCommon **devListRecords(plcStation *station, devListKind which, size_t *count);

/* Takes out the first for which ready() is not 0, with the list locked; NULL: there is none. */
dbCommon *devListTake(plcStation *station, devListKind which, int (*ready)(devRecord *dev));

/* The transfer of all outputs: writes, or follows the PLC's value. */
long devWrite(dbCommon *prec);

/* The record asks what becomes of its puts to this place. Who ends that frees last->bytes. */
void devAsk(devRecord *dev, plcLastPut *last, size_t offset, size_t length, const void *mask);

/* The record follows the read-back of its place from now on / no longer. */
void devFollowJoin(devRecord *dev);
void devFollowLeave(devRecord *dev);

/* In a callback thread, after the PLC came back, or the output image took values of it.
 */
void devFollowAll(plcStation *station);

/* The output has written, or has taken the PLC's value. */
void devHasValue(devRecord *dev);

/* VAL shows what the output image holds now. */
void devShow(devRecord *dev);

/* The same, and the record's value is that: without processing. */
void devTakeValue(dbCommon *prec, devRecord *dev);

/* The same after a put: VAL shows these bytes, whatever the image holds by now. */
void devWrote(devRecord *dev, const epicsUInt8 *bytes, const epicsUInt8 *mask);

/* A put was refused: the value goes back to that of the PLC, when that is known. */
void devGoBack(dbCommon *prec, devRecord *dev);

/* Functions of the dset, the same for all record types. */
long devInit(int after);
long devInitRecord(dbCommon *prec);
long devIointInfo(int leave, dbCommon *prec, IOSCANPVT *list);

/* devRecord.unseen of outputs that follow: the PLC refuses to show the place of which VAL would be
 * taken, or holds no BCD number there. */
int devNotShown(const devRecord *dev, char reason[PLC_REASON_SIZE]);

/* Raises READ_ALARM, and returns -1, when bytes of the place have digits that are none; else 0. */
long devCheckDigits(dbCommon *prec, const devRecord *dev, const void *bytes);

/* Finds the station of this name. Returns 0 and dev->station, or -1 with *error. */
int devFindStation(devRecord *dev, const char *name, plcLinkError *error);

/* The same for one record, which is locked. */
void devFollowOne(dbCommon *prec, plcStation *station);

/* The record has just put dev->mark: returns 1 when it waits for the PLC (PACT is set), 0 when
 * there is nothing to wait for. */
int devPutWait(dbCommon *prec, devRecord *dev);

/* The record waits no longer. Returns 1 when it did. */
int devPutLeave(devRecord *dev);

/* The record leaves us while it may wait: its put ends. */
void devPutAbandon(devRecord *dev);

/* The same of a record that is not active: what waits for its old place does not get there any more.
 * Returns the words for its alarm; NULL: nothing waits, or over this wire it cannot be taken back. */
const char *devPutWithdraw(dbCommon *prec, devRecord *dev);

/* The PLC has answered, or is gone: records whose put is through process to their end. In a
 * callback thread. */
void devPutUpdate(plcStation *station);

/* The value of an output is kept, but the PLC is away: raises COMM_ALARM, which ends when
 * the PLC is back. Returns -1; or 0 when the PLC has just come. */
long devAway(dbCommon *prec, devRecord *dev);

/* The record leaves its place, and is not active: its alarm for its put there ends, or is WRITE_ALARM
 * with these words. */
void devAwayLeave(dbCommon *prec, devRecord *dev, const char *why);

/* The last put is not in the PLC: raises WRITE_ALARM, which ends with the next put, or when the PLC
 * shows what was put. Returns -1; or 0 when it is, or waits. */
long devRefused(dbCommon *prec, devRecord *dev);

/* The PLC does not show this place: raises READ_ALARM, which ends when it does. Returns -1; or 0
 * when it shows it. */
long devUnseen(dbCommon *prec, devRecord *dev);

/* The PLC is back, or has refused something or taken it: raises and ends the alarms of its
 * outputs. In a callback thread. */
void devAwayUpdate(plcStation *station);

/* The record has no value of its PLC yet, and says why there is none, without processing,
 * until a block makes it process. `later`: not at iocInit, since its link is new. */
void devSilentJoin(devRecord *dev, int later);

/* The PLC came or went, or there is another reason why there is no data. In a callback
 * thread. */
void devSilentUpdate(plcStation *station);

/* The bits of the record's place that are its own, in wire order; NULL: all of them. */
const void *devMask(const devRecord *dev, epicsUInt8 bytes[DEV_SCALAR]);

/* Makes room for the alarm that is about to be raised, where the present one is only UDF. */
void devOverUndefined(dbCommon *prec);

/* SIMM is not NO, or would not be when the record processes now: it has to do with SIOL, not with the
 * PLC. The record is locked, and has its dpvt; FindSimulation is called when that is made. */
int devIsSimulated(dbCommon *prec);
void devFindSimulation(devRecord *dev);

/* INP or OUT as it stands there, without its @. */
const char *devLinkText(dbCommon *prec);

/* A one-line warning about the record; it works all the same. */
void devWarn(dbCommon *prec, const char *format, ...) EPICS_PRINTF_STYLE(2, 3);

/* prepare of the string records: they have a buffer. */
int devPrepareString(dbCommon *prec, devRecord *dev, const plcLink *link,
                     plcLinkError *error);

/* prepare of the multibit records: moves MASK, NOBT bits, to its place at SHFT. It is
 * moved back when the record leaves us. Inputs read those bits that the type has, with a warning.
 * Returns 0; or -1 with *error, when the type has none of them, or not all of an output. */
int devPrepareMask(dbCommon *prec, devRecord *dev, const plcLink *link,
                   plcLinkError *error, epicsUInt32 *mask, unsigned nobt, unsigned shft);

/* Warns of states of an mbbi or mbbo that have a text and the same value 0. 16 values, texts of
 * `size` bytes each. */
void devCheckStates(dbCommon *prec, const epicsUInt32 *values, const char *texts,
                    size_t size);

/* Warns of a LINR (menuConvert) of ai or ao that does nothing, or makes all values one. */
void devCheckScale(dbCommon *prec, const devRecord *dev, unsigned linr, double egul,
                   double eguf);

/* Sets ESLO and EOFF of ai and ao so that L..H and EGUL..EGUF are the same. Float types are
 * not converted: nothing is set. */
void devScale(const devRecord *dev, double egul, double eguf, double *eslo, double *eoff);

/* What an ao makes of its OVAL, in double to the end: RVAL has only 31 bits for a UINT32. */
double devAoRaw(struct aoRecord *prec);

/* With SIMM=YES: from SIOL to the array, and from the array to SIOL. Return what the link does. */
long devReadSimulated(struct aaiRecord *prec);
long devWriteSimulated(struct aaoRecord *prec);

/* The dpvt of a record, when its link is good. Else NULL, and the alarm is raised. */
devRecord *devOf(dbCommon *prec);

/* Copies the record's bytes from the input image, in wire order, and sets its time with
 * TSE=-2. Returns 0; or -1 when there is no valid data: the alarm is raised, the value
 * must stay as it is, and the adapter returns -1 so that the record does not convert. */
long devFetch(dbCommon *prec, void *bytes);

/* Puts the record's bytes into the output image, only the bits set in mask (NULL: all).
 * Returns 0, or -1 with an alarm: COMM when the PLC is away (the value is kept and leaves
 * when it is back), WRITE when the value was refused. */
long devStore(dbCommon *prec, const void *bytes, const void *mask);

/* The same for one integer: zero- or sign-extended to 64 bits; only the bits in mask. */
long devFetchInt(dbCommon *prec, epicsInt64 *value);
long devStoreInt(dbCommon *prec, epicsInt64 value, epicsUInt64 mask);

/* Sets the time of a record with TSE=-2 that gets none from a block. */
void devStampNow(dbCommon *prec);

/* The time of a record whose alarm or value changes without processing. */
void devStamp(dbCommon *prec);

/* Its alarm has these words; where Base has no AMSG: always. */
int devSays(const dbCommon *prec, const char *reason);

/* Refuses to write: WRITE_ALARM with these words, until the next put. Returns -1. */
long devRefuseWrite(dbCommon *prec, const char *format, ...) EPICS_PRINTF_STYLE(2, 3);

#endif /* INC_devS7plc_H */
