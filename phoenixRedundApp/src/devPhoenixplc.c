/* Device support "phoenixplc": records that show the state of a redundant pair.
 *
 * Knows the status of a pair, not where it comes from. Links: @PLCname, @PLCname/key.
 */
#include <stdlib.h>
#include <string.h>

#include <alarm.h>
#include <cantProceed.h>
#include <dbAccess.h>
#include <devSup.h>
#include <epicsString.h>
#include <errlog.h>
#include <link.h>
#include <mbbiRecord.h>
#include <recGbl.h>

#include "phoenixPair.h"
#include "plcCompat.h"
#include "plcStation.h"

#include <epicsExport.h> /* last */

typedef struct phoenixRecord {
    phoenixPair *pair; /* NULL: a single PLC */
} phoenixRecord;

static long initRecord(dbCommon *common)
{
    const struct link *link = dbGetDevLink(common);
    const char *name = link->type == INST_IO ? link->value.instio.string : "";
    phoenixRecord *own;

    if (!plcStationFind(name)) {
        errlogPrintf("phoenixplc %s: no PLC \"%s\"\n", common->name, name);
        return S_db_badField;
    }
    own = callocMustSucceed(1, sizeof(*own), "phoenixplc record");
    own->pair = phoenixPairFind(name);
    common->dpvt = own;
    return 0;
}

static long getIointInfo(int leave, dbCommon *common, IOSCANPVT *list)
{
    static IOSCANPVT never;
    const phoenixRecord *own = common->dpvt;

    if (!own)
        return -1;
    if (!own->pair && !never)
        scanIoInit(&never);
    *list = own->pair ? phoenixPairScan(own->pair, common->prio, leave) : never;
    return 0;
}

static long readMbbi(mbbiRecord *prec)
{
    const phoenixRecord *own = prec->dpvt;
    phoenixStatus status = {.backup = phoenixNoPartner};

    if (!own)
        return -1;
    if (own->pair)
        phoenixPairStatus(own->pair, &status);
    prec->rval = prec->val = status.backup;
    prec->udf = FALSE;
    return 2;
}

static mbbidset devPhoenixplcMbbi = {{5, NULL, NULL, initRecord, getIointInfo}, readMbbi};
epicsExportAddress(dset, devPhoenixplcMbbi);
