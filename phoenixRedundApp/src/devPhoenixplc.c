/* Device support "phoenixplc": records that show the state of a redundant pair.
 *
 * Knows the status of a pair, not how it is found out. Links: @PLCname on an mbbi (the
 * BACKUP, as in the paper), @PLCname/key on all record types; the keys are one table.
 */
#include <stdlib.h>
#include <string.h>

#include <aiRecord.h>
#include <alarm.h>
#include <biRecord.h>
#include <cantProceed.h>
#include <dbAccess.h>
#include <dbEvent.h>
#include <devSup.h>
#include <epicsStdio.h>
#include <epicsString.h>
#include <errlog.h>
#include <int64inRecord.h>
#include <link.h>
#include <longinRecord.h>
#include <lsiRecord.h>
#include <mbbiRecord.h>
#include <menuFtype.h>
#include <recGbl.h>
#include <stringinRecord.h>

#include "phoenixPair.h"
#include "plcCompat.h"
#include "plcLink.h"
#include "plcStation.h"

#include <epicsExport.h> /* last */

#define TEXT_SIZE 64

/* --- Keys --------------------------------------------------------------------------- */

typedef double numberGetter(const phoenixStatus *status);
typedef void textGetter(const phoenixStatus *status, char text[TEXT_SIZE]);

static double getBackup(const phoenixStatus *s)
{
    return s->backup;
}

static void backupText(const phoenixStatus *s, char text[TEXT_SIZE])
{
    epicsSnprintf(text, TEXT_SIZE, "%s", phoenixBackupText[s->backup]);
}

static double getPrimary(const phoenixStatus *s)
{
    return s->primary + 1;
}

static void primaryText(const phoenixStatus *s, char text[TEXT_SIZE])
{
    epicsSnprintf(text, TEXT_SIZE, "%s",
                  s->primary == pairNobody ? "none" : phoenixName[s->primary]);
}

static double getSwitchovers(const phoenixStatus *s)
{
    return s->switchovers;
}

/* Seconds since 1970; 0: never. */
static double getSwitchTime(const phoenixStatus *s)
{
    if (s->switchTime.secPastEpoch == 0)
        return 0;
    return s->switchTime.secPastEpoch + (double)POSIX_TIME_AT_EPICS_EPOCH +
           s->switchTime.nsec * 1e-9;
}

static void switchTimeText(const phoenixStatus *s, char text[TEXT_SIZE])
{
    text[0] = 0;
    if (s->switchTime.secPastEpoch)
        epicsTimeToStrftime(text, TEXT_SIZE, "%Y-%m-%d %H:%M:%S.%03f", &s->switchTime);
}

static void switchReasonText(const phoenixStatus *s, char text[TEXT_SIZE])
{
    epicsSnprintf(text, TEXT_SIZE, "%s", s->switchReason);
}

static double getSwitchDuration(const phoenixStatus *s)
{
    return s->switchDuration;
}

static double getConnected1(const phoenixStatus *s)
{
    return s->connected[0];
}

/* 2: there is no SECOND. */
static double getConnected2(const phoenixStatus *s)
{
    return s->backup == phoenixNoPartner ? 2 : s->connected[1];
}

static void connected2Text(const phoenixStatus *s, char text[TEXT_SIZE])
{
    epicsSnprintf(text, TEXT_SIZE, "%s",
                  s->backup == phoenixNoPartner ? "no partner"
                  : s->connected[1]             ? "1"
                                                : "0");
}

/* By what the BACKUP is linked, or not. */
static void backupLinkText(const phoenixStatus *s, char text[TEXT_SIZE])
{
    static const char *const words[2][3] = {
        {"no TCP, no answer to ICMP", "no TCP, answers ICMP", "no TCP, ICMP not known"},
        {"TCP, no answer to ICMP",    "TCP and ICMP",         "TCP, ICMP not known"   },
    };
    int who = !s->primary;

    if (s->backup == phoenixNoPartner || s->primary == pairNobody)
        epicsSnprintf(text, TEXT_SIZE, "%s", phoenixBackupText[s->backup]);
    else if (s->twoPrimaries)
        epicsSnprintf(text, TEXT_SIZE, "both PLCs send");
    else
        epicsSnprintf(text, TEXT_SIZE, "%s",
                      words[s->connected[who] != 0][s->reachable[who]]);
}

static double getReachable1(const phoenixStatus *s)
{
    return s->reachable[0];
}

static double getReachable2(const phoenixStatus *s)
{
    return s->reachable[1];
}

static double getTwoPrimaries(const phoenixStatus *s)
{
    return s->twoPrimaries;
}

static double getTwoPrimariesCount(const phoenixStatus *s)
{
    return s->twoPrimariesCount;
}

typedef struct keyRow {
    const char *key;
    numberGetter *number; /* NULL: a text only */
    textGetter *text;     /* NULL: the number as text */
} keyRow;

static const keyRow keys[] = {
    {"backup",             getBackup,            backupText      }, /* the first: no key */
    {"backupLink",         NULL,                 backupLinkText  },
    {"primary",            getPrimary,           primaryText     },
    {"switchovers",        getSwitchovers,       NULL            },
    {"lastSwitchTime",     getSwitchTime,        switchTimeText  },
    {"lastSwitchReason",   NULL,                 switchReasonText},
    {"lastSwitchDuration", getSwitchDuration,    NULL            },
    {"connected1",         getConnected1,        NULL            },
    {"connected2",         getConnected2,        connected2Text  },
    {"reachable1",         getReachable1,        NULL            },
    {"reachable2",         getReachable2,        NULL            },
    {"twoPrimaries",       getTwoPrimaries,      NULL            },
    {"twoPrimariesCount",  getTwoPrimariesCount, NULL            },
};

#define KEYS (sizeof(keys) / sizeof(keys[0]))

static const keyRow *findKey(const char *name)
{
    size_t i;

    for (i = 0; i < KEYS; i++)
        if (epicsStrCaseCmp(keys[i].key, name) == 0)
            return &keys[i];
    return NULL;
}

/* --- One row per record type -------------------------------------------------------- */

/* A dset; its head is all that Base sees. */
typedef struct phoenixSupport {
    dset common;
    long (*read)(dbCommon *common);
    const char *recordType;
    int wantsText;
} phoenixSupport;

/* The dpvt */
typedef struct phoenixRecord {
    plcStation *station; /* NULL: the link was refused */
    phoenixPair *pair;   /* NULL: a single PLC */
    const keyRow *row;
} phoenixRecord;

static int running; /* 1 after iocInit: add_record means a link that changed */
static IOSCANPVT neverScan;

/* Says what is wrong with a link. Returns -1. */
static int refuse(const dbCommon *prec, const char *link, const char *why,
                  const char *allowed)
{
    const phoenixSupport *support = (const phoenixSupport *)prec->dset;

    errlogSevPrintf(errlogMajor,
                    "phoenixplc %s \"%s\" INP: %s\n    @%s\n    allowed: %s\n",
                    support->recordType, prec->name, why, link, allowed);
    return -1;
}

static int refuseKey(const dbCommon *prec, const char *link, int wantsText)
{
    char allowed[300] = "";
    size_t i, used = 0;

    for (i = 0; i < KEYS; i++)
        if (keys[i].number || wantsText) {
            epicsSnprintf(allowed + used, sizeof(allowed) - used, "%s%s", used ? " " : "",
                          keys[i].key);
            used = strlen(allowed);
        }
    return refuse(prec, link, "no such value of a pair for this record type", allowed);
}

/* Takes "@PLCname/key" apart. Returns 0 or -1 after an error line. */
static int resolve(const dbCommon *prec, const char *link, phoenixRecord *own)
{
    const phoenixSupport *support = (const phoenixSupport *)prec->dset;
    size_t length = strcspn(link, "/ \t");
    const char *key = link + length;
    char name[PLC_NAME_MAX + 1], names[200], word[TEXT_SIZE];

    epicsSnprintf(name, sizeof(name), "%.*s", (int)length, link);
    own->station = plcStationFind(name);
    if (!own->station) {
        plcStationNames(names, sizeof(names));
        return refuse(prec, link, "no PLC of this name is configured",
                      names[0] ? names
                               : "none (phoenixplcConfigure comes before iocInit)");
    }
    own->pair = phoenixPairFind(name);
    key += strspn(key, "/ \t");
    epicsSnprintf(word, sizeof(word), "%.*s", (int)strcspn(key, " \t"), key);
    own->row = word[0] ? findKey(word) : &keys[0];
    if (!own->row || (!own->row->number && !support->wantsText)) {
        own->station = NULL;
        return refuseKey(prec, link, support->wantsText);
    }
    return 0;
}

static void attach(dbCommon *prec)
{
    const struct link *link = dbGetDevLink(prec);
    phoenixRecord *own = callocMustSucceed(1, sizeof(*own), "phoenixplc record");
    const char *text = link && link->type == INST_IO ? link->value.instio.string : NULL;

    prec->dpvt = own;
    if (resolve(prec, text ? text : "", own) == 0)
        return;
    recGblSetSevrMsg(prec, LINK_ALARM, INVALID_ALARM, "wrong link, see the IOC's log");
    if (running)
        recGblGetTimeStamp(prec);
    if (recGblResetAlarms(prec) && running)
        db_post_events(prec, NULL, DBE_ALARM);
}

/* --- Functions that Base calls ------------------------------------------------------ */

static long addRecord(dbCommon *prec)
{
    if (running)
        attach(prec);
    return 0;
}

static long delRecord(dbCommon *prec)
{
    free(prec->dpvt);
    prec->dpvt = NULL;
    return 0;
}

static dsxt extension = {addRecord, delRecord};

static long init(int after)
{
    /* after an IOC that has ended its scan lists are gone */
    if (!after && (running || !neverScan))
        scanIoInit(&neverScan);
    if (!after)
        devExtend(&extension);
    running = after;
    return 0;
}

static long initRecord(dbCommon *prec)
{
    attach(prec);
    return 0;
}

static long getIointInfo(int leave, dbCommon *prec, IOSCANPVT *list)
{
    const phoenixRecord *own = prec->dpvt;

    if (!own || !own->station)
        *list = neverScan;
    else if (own->pair)
        *list = phoenixPairScan(own->pair, prec, leave);
    else
        *list = plcStationStatusRecord(own->station, prec, leave);
    return 0;
}

/* A consistent copy of the status; of a single PLC, what there is of it. Returns the row,
 * or NULL with an alarm when the link was refused. */
static const keyRow *fetch(dbCommon *prec, phoenixStatus *status)
{
    const phoenixRecord *own = prec->dpvt;

    if (prec->tse == epicsTimeEventDeviceTime)
        epicsTimeGetCurrent(&prec->time);
    if (!own || !own->station) {
        recGblSetSevrMsg(prec, LINK_ALARM, INVALID_ALARM,
                         "wrong link, see the IOC's log");
        return NULL;
    }
    if (own->pair) {
        phoenixPairStatus(own->pair, status);
        return own->row;
    }
    memset(status, 0, sizeof(*status));
    status->backup = phoenixNoPartner;
    status->connected[0] = plcStationConnected(own->station, NULL);
    status->primary = status->connected[0] ? pairFirst : pairNobody;
    status->reachable[0] = status->reachable[1] = phoenixNotKnown;
    return own->row;
}

static int fetchNumber(dbCommon *prec, double *value)
{
    phoenixStatus status;
    const keyRow *row = fetch(prec, &status);

    if (!row)
        return -1;
    *value = row->number(&status);
    prec->udf = FALSE;
    return 0;
}

static int fetchText(dbCommon *prec, char text[TEXT_SIZE])
{
    phoenixStatus status;
    const keyRow *row = fetch(prec, &status);

    if (!row)
        return -1;
    if (row->text)
        row->text(&status, text);
    else
        epicsSnprintf(text, TEXT_SIZE, "%g", row->number(&status));
    prec->udf = FALSE;
    return 0;
}

/* --- Adapters ----------------------------------------------------------------------- */

/* Where the state of the BACKUP is an alarm, AMSG says by what it is linked, or not. */
static void sayLink(mbbiRecord *prec)
{
    const epicsEnum16 *severities = &prec->zrsv;
    phoenixStatus status;
    char text[TEXT_SIZE];

    if (fetch((dbCommon *)prec, &status) != keys || prec->val >= 16)
        return;
    backupLinkText(&status, text);
    if (severities[prec->val])
        recGblSetSevrMsg(prec, STATE_ALARM, severities[prec->val], "%s", text);
}

/* The paper's record has no ZRVL...: VAL is the state itself, nothing is converted. */
static long readMbbi(dbCommon *common)
{
    mbbiRecord *prec = (mbbiRecord *)common;
    double value;

    if (fetchNumber(common, &value))
        return -1;
    prec->rval = (epicsUInt32)value;
    prec->val = (epicsEnum16)value;
    sayLink(prec);
    return 2;
}

static long readBi(dbCommon *common)
{
    double value;

    if (fetchNumber(common, &value))
        return -1;
    if (((phoenixRecord *)common->dpvt)->row->number == getConnected2)
        value = value == 1;
    ((biRecord *)common)->rval = value != 0;
    ((biRecord *)common)->val = value != 0;
    return 2;
}

static long readLongin(dbCommon *common)
{
    double value;

    if (fetchNumber(common, &value))
        return -1;
    ((longinRecord *)common)->val = (epicsInt32)value;
    return 0;
}

static long readInt64in(dbCommon *common)
{
    double value;

    if (fetchNumber(common, &value))
        return -1;
    ((int64inRecord *)common)->val = (epicsInt64)value;
    return 0;
}

static long readAi(dbCommon *common)
{
    double value;

    if (fetchNumber(common, &value))
        return -1;
    ((aiRecord *)common)->val = value;
    return 2;
}

static long readStringin(dbCommon *common)
{
    stringinRecord *prec = (stringinRecord *)common;
    char text[TEXT_SIZE];

    if (fetchText(common, text))
        return -1;
    epicsSnprintf(prec->val, sizeof(prec->val), "%s", text);
    return 0;
}

static long readLsi(dbCommon *common)
{
    lsiRecord *prec = (lsiRecord *)common;
    char text[TEXT_SIZE];

    if (fetchText(common, text))
        return -1;
    epicsSnprintf(prec->val, prec->sizv, "%s", text);
    prec->len = (epicsUInt32)strlen(prec->val) + 1;
    return 0;
}

/* clang-format off */
#define HEAD {6, NULL, init, initRecord, getIointInfo}

static const phoenixSupport
    devPhoenixplcMbbi     = {HEAD, readMbbi,     "mbbi",     0},
    devPhoenixplcBi       = {HEAD, readBi,       "bi",       0},
    devPhoenixplcLongin   = {HEAD, readLongin,   "longin",   0},
    devPhoenixplcInt64in  = {HEAD, readInt64in,  "int64in",  0},
    devPhoenixplcAi       = {HEAD, readAi,       "ai",       0},
    devPhoenixplcStringin = {HEAD, readStringin, "stringin", 1},
    devPhoenixplcLsi      = {HEAD, readLsi,      "lsi",      1};
/* clang-format on */

epicsExportAddress(dset, devPhoenixplcMbbi);
epicsExportAddress(dset, devPhoenixplcBi);
epicsExportAddress(dset, devPhoenixplcLongin);
epicsExportAddress(dset, devPhoenixplcInt64in);
epicsExportAddress(dset, devPhoenixplcAi);
epicsExportAddress(dset, devPhoenixplcStringin);
epicsExportAddress(dset, devPhoenixplcLsi);
