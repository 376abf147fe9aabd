/* The options of a station: one table of keys with range, unit, default and help.
 *
 * Pure: text goes in, values come out. What an option does is written where it is used.
 */
#ifndef INC_plcOptions_H
#define INC_plcOptions_H

#include <stddef.h>
#include <stdio.h>

#include "plcCodec.h"

enum { plcOfflineKeep, plcOfflineReject }; /* offlineWrites= */
enum { plcScanAll, plcScanChanged };       /* scan= */
enum { plcClockIsDt, plcClockIsDtl };      /* timestamp= */
/* wordOrder= */
enum { plcWordsAsBytes, plcWordsHigh, plcWordsLow, plcWordsABCD, plcWordsCDAB, plcWordsBADC,
       plcWordsDCBA };
enum { plcMaskRefuse, plcMaskRmw };        /* maskWrite= */
enum { plcPassOwn, plcPassCallback };      /* scanThread= */

enum { plcCompleteAcknowledged, plcCompleteSent }; /* complete= */
enum { plcWritesNewest, plcWritesAll };    /* writes= */

enum { plcLogError, plcLogWarning, plcLogInfo, plcLogIo }; /* log= */
enum { plcCheckStrict, plcCheckAnyUnit, plcCheckAnyTransaction, plcCheckLoose }; /* check= */
enum { plcFramingTcp, plcFramingRtu };     /* framing= */

#define PLC_OFF (-1.0) /* an option with an offset or a register, not in use */

typedef struct plcOptions {
    double recvTimeout;    /* ms */
    double sendInterval;   /* ms */
    double holdoff;        /* ms */
    double heartbeat;      /* ms, 0 = off */
    double minUpdate;      /* ms, 0 = off */
    double connectTimeout; /* ms */
    int offlineWrites;
    int scan;
    int wholeBlock;        /* 0 or 1 */
    int scanThread;        /* plcPassOwn, plcPassCallback */
    int track;             /* 0 or 1 */
    double readback;       /* offset in the input block, PLC_OFF */
    double alive;          /* offset in the input block, PLC_OFF */
    const plcType *aliveType;
    double aliveTimeout;   /* ms */
    double timestamp;      /* offset in the input block, PLC_OFF */
    int timestampFormat;   /* plcClockIsDt, plcClockIsDtl */
    int sync;              /* 0 or 1 */
    double pingPeriod;     /* ms, 0 = off */
    double layout;         /* layout id, 0 = not checked */
    int map;               /* plcMapOff, ... of plcTables.h */
    double layoutAt;       /* offset of the PLC's in the input block, PLC_OFF */
    int wordOrder;         /* plcWordsAsBytes, ... */
    int complete;          /* plcCompleteAcknowledged, plcCompleteSent */
    int writes;            /* plcWritesNewest, plcWritesAll */
    double requestTimeout; /* ms, of transports with requests */
    int singleWrite;       /* 0 or 1; this and the next two: registers */
    int maskWrite;         /* plcMaskRefuse, plcMaskRmw */
    double heartbeatRegister; /* holding register, PLC_OFF */
    int log;               /* plcLogError, ... */
    int logTime;           /* 0 or 1 */
    double readPeriod;     /* ms, 0 = only at connect; of transports with requests */
    double maxRegisters;   /* in one request */
    double maxBits;        /* the same of coils and discrete inputs */
    double requestPause;   /* ms between an answer and the next request, 0 = none */
    int check;             /* plcCheckStrict, ... */
    int framing;     /* plcFramingTcp, plcFramingRtu */
} plcOptions;

void plcOptionsDefault(plcOptions *options);

/* What a number may be, and what it is unless set: for arguments that stand for an option.
 * Returns 0, or -1: no option of this key is a number. */
int plcOptionsLimits(const char *key, double *min, double *max, double *initial);

/* Sets one option from text. `running` is true after iocInit: some options are only good
 * before. Returns 0, or -1 with a message that says what is allowed. */
int plcOptionsSet(plcOptions *options, const char *key, const char *value, int running,
                  char *error, size_t size);

/* The table with the values in *options (NULL: the defaults), for people. */
void plcOptionsPrint(const plcOptions *options, FILE *file);

/* Only the options that differ from the defaults: "heartbeat=500 scan=changed". */
void plcOptionsSummary(const plcOptions *options, char *text, size_t size);

#endif /* INC_plcOptions_H */
