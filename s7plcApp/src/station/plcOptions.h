/* The options of a station: a table of keys with range, unit, default and help; transports and
 * policies add tables of their own.
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
enum { plcPassOwn, plcPassCallback };      /* scanThread= */

enum { plcCompleteAcknowledged, plcCompleteSent }; /* complete= */
enum { plcWritesNewest, plcWritesAll };    /* writes= */

enum { plcLogError, plcLogWarning, plcLogInfo, plcLogIo }; /* log= */

#define PLC_OFF (-1.0) /* an option with an offset or a place, not in use */

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
    double layout;         /* layout id, 0 = not checked */
    int map;               /* plcMapOff, ... of plcTables.h */
    double layoutAt;       /* offset of the PLC's in the input block, PLC_OFF */
    int wordOrder;         /* plcWordsAsBytes, ... */
    int textOrder;         /* plcTextABCD, ... */
    int complete;          /* plcCompleteAcknowledged, plcCompleteSent */
    int writes;            /* plcWritesNewest, plcWritesAll */
    double requestTimeout; /* ms, of transports with requests */
    int log;               /* plcLogError, ... */
    int logTime;           /* 0 or 1 */
    double readPeriod;     /* ms, 0 = only at connect; of transports with requests */
    double own[32];        /* of the tables that were added: plcOptionsOwn */
} plcOptions;

typedef enum {
    plcOptNumber, /* a double from min to max */
    plcOptPeriod, /* the same, or 0: off. What comes back in short turns has a least length */
    plcOptWhole,  /* a double without a fraction: digits only, or hex behind 0x */
    plcOptChoice, /* one of the words in `words`, stored as its index, an int */
    plcOptOffset, /* a double: "off" or a byte offset; "offset,word" when `words` is set */
    plcOptPlace,  /* a double: "off" or a number of `unit` */
    plcOptAlive   /* "off", "offset" or "offset,type" */
} plcOptionKind;

/* What a PLC must be, all of it, for an option to have an effect. 0: any will do. */
enum {
    plcOptInBlocks = 1,  /* it sends blocks */
    plcOptOutBlocks = 2, /* its outputs leave in blocks */
    plcOptRequests = 4,  /* it is asked by requests */
    plcOptAcks = 8,      /* it acknowledges puts */
    plcOptOffsets = 16   /* its values have offsets, not names */
};

typedef struct plcOptionRow {
    const char *key;
    plcOptionKind kind;
    size_t field;  /* where in the struct of its table */
    size_t second; /* where the word after the comma goes; 0: there is none */
    double min, max;
    const char *unit; /* NULL: a number without one */
    const char *words; /* "keep|reject" */
    double initial;
    int early; /* only before iocInit */
    unsigned wire;    /* plcOptInBlocks | ... */
    const char *with; /* has an effect only with one of these set, "sync|layoutAt"; NULL: alone */
    const char *help;
} plcOptionRow;

/* The options of one transport or policy. They are in each station, whether it uses them or not:
 * so they can be set before it is known, and are listed where the library is. */
typedef struct plcOptionTable {
    const plcOptionRow *rows;
    size_t count;
    size_t size; /* bytes of the struct that has their fields: of double and int alone */
    const char *of; /* the name of that transport or policy, for which alone they are; NULL: any */
    const char *uses, *usesWith; /* an option of the core that has an effect there in its own way,
                                  * with this one set; NULL: none */
    /* of plcOptionsAdd: */
    size_t at;
    struct plcOptionTable *next;
} plcOptionTable;

/* Adds a table, once, before there is any station: in a registrar. */
void plcOptionsAdd(plcOptionTable *table);

/* The struct of this table. */
const void *plcOptionsOwn(const plcOptions *options, const plcOptionTable *table);

void plcOptionsDefault(plcOptions *options);

/* What a number may be, and what it is unless set: for arguments that stand for an option.
 * Returns 0, or -1: no option of this key is a number. */
int plcOptionsLimits(const char *key, double *min, double *max, double *initial);

/* Sets one option from text. `running` is true after iocInit: some options are only good
 * before. Returns 0, or -1 with a message that says what is allowed. */
int plcOptionsSet(plcOptions *options, const char *key, const char *value, int running,
                  char *error, size_t size);

/* Tells each option that is another in *now than in *before, and not the default, but has no effect
 * on a PLC that is `wire` (plcOptInBlocks | ...) by transports and a policy of these names (the last
 * is NULL): a line that says for what it is. */
void plcOptionsIdle(const plcOptions *before, const plcOptions *now, unsigned wire,
                    const char *const names[], void (*tell)(void *arg, const char *line),
                    void *arg);

/* All tables with the values in *options (NULL: the defaults), for people. */
void plcOptionsPrint(const plcOptions *options, FILE *file);

/* Only the options that differ from the defaults: "heartbeat=500 scan=changed". */
void plcOptionsSummary(const plcOptions *options, char *text, size_t size);

#endif /* INC_plcOptions_H */
