/* A redundant pair as the policy of a station, and what status records show of it.
 *
 * It joins the pure roles (pairRole) to the station's thread. It knows no record and no
 * socket. Functions that say "any thread" do not block.
 */
#ifndef INC_phoenixPair_H
#define INC_phoenixPair_H

#include <dbScan.h>
#include <epicsTime.h>

#include "pairRole.h"
#include "plcPolicy.h"

/* The BACKUP as the paper's mbbi record shows it */
typedef enum {
    phoenixNoPartner,     /* redundancy=0 */
    phoenixFirstUnlinked, /* FIRST is BACKUP, without a network connection */
    phoenixSecondUnlinked,
    phoenixFirstLinked, /* FIRST is BACKUP, ready to take over */
    phoenixSecondLinked,
    phoenixUnknown /* nobody leads, both do, or the BACKUP has not answered yet */
} phoenixBackup;

typedef enum { phoenixNoAnswer, phoenixAnswers, phoenixNotKnown } phoenixReach;

typedef struct phoenixStatus {
    phoenixBackup backup;
    pairWho primary;
    int connected[PLC_LINES_MAX];          /* TCP is up */
    phoenixReach reachable[PLC_LINES_MAX]; /* by ICMP echo */
    struct in_addr host[PLC_LINES_MAX];    /* s_addr 0: not known yet */
    int twoPrimaries;
    epicsUInt32 switchovers;
    epicsUInt32 twoPrimariesCount;
    epicsTimeStamp switchTime; /* of the last switch-over; 0: none yet */
    double switchDuration;     /* ms from the last old block until the new PRIMARY led */
    char switchReason[40];     /* "" none yet */
} phoenixStatus;

typedef struct phoenixPair phoenixPair;

extern const char *const phoenixName[PLC_LINES_MAX]; /* "FIRST", "SECOND" */
extern const char *const phoenixBackupText[]; /* as in the paper, by phoenixBackup */

extern const plcPolicy phoenixPolicy; /* its pvt is a phoenixPair */

/* Makes the options of pairs known; the first pair does so, too. */
void phoenixPairInit(void);

/* Makes a pair; the station destroys it, when there is one. */
phoenixPair *phoenixPairCreate(const char *name);
void phoenixPairDestroy(phoenixPair *pair);

/* The pair of this name, NULL: none. Any thread. */
phoenixPair *phoenixPairFind(const char *name);

/* A consistent copy. Any thread. */
void phoenixPairStatus(phoenixPair *pair, phoenixStatus *status);

/* For get_ioint_info: status records are processed when something changed. */
IOSCANPVT phoenixPairScan(phoenixPair *pair, struct dbCommon *prec, int leave);

/* Processes the status records of all pairs (scans are on). */
void phoenixPairsRun(void);

#endif /* INC_phoenixPair_H */
