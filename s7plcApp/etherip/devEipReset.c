/* Device support "EtherIPReset": a bo that resets the statistics of all PLCs of this wire when
 * 1 is put. Its link does not matter. */
#include <boRecord.h>
#include <dbCommon.h>
#include <devSup.h>

#include "drvEtherIP.h"

#include <epicsExport.h> /* last */

static long initRecord(dbCommon *prec)
{
    (void)prec;
    return 2; /* no conversion: VAL stays */
}

static long writeBo(boRecord *prec)
{
    if (prec->val)
        drvEtherIP_reset_statistics();
    return 0;
}

const struct {
    dset common;
    long (*write)(boRecord *prec);
} devEipResetBo = {{5, NULL, NULL, initRecord, NULL}, writeBo};
epicsExportAddress(dset, devEipResetBo);
