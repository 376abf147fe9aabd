/* The sync handshake; see plcSync.h. */
#include <string.h>

#include "plcCodec.h"
#include "plcSync.h"

static const struct {
    const char *name;
    const char *refusal; /* AMSG of a put that comes in this state */
    int sends;           /* blocks may leave */
    int flags;           /* of blocks that leave */
} states[] = {
    [plcSyncDisconnected]   = {"disconnected",    "not synchronised: PLC not connected",  0, 0           },
    [plcSyncWaiting]        = {"waiting",         "not synchronised: no block yet",       0, 0           },
    [plcSyncChecking]       = {"checking",        "not synchronised: PLC checks",         1, plcFlagCheck},
    [plcSyncSynced]         = {"synced",          "",                                     1, plcFlagData },
    [plcSyncLocal]          = {"LOCAL",           "PLC in LOCAL",                         1, 0           },
    [plcSyncLayoutMismatch] = {"layout mismatch", "layout ids of PLC and IOC differ",     0, 0           },
    [plcSyncMapMismatch]    = {"map mismatch",    "PLC has another table of pointers",    0, 0           },
    [plcSyncMapDownload]    = {"map download",    "PLC is getting its table of pointers", 1, 0           },
};

void plcSyncInit(plcSync *s, epicsUInt16 layout)
{
    memset(s, 0, sizeof(*s));
    s->layout = layout;
}

void plcSyncConnected(plcSync *s)
{
    s->state = plcSyncWaiting;
    s->asked = 0;
}

void plcSyncLost(plcSync *s)
{
    s->state = plcSyncDisconnected;
    s->asked = 0;
}

int plcSyncBlock(plcSync *s, const void *header, int same, int bigEndian)
{
    const epicsUInt8 *h = header;

    s->flags = h[0];
    s->theirs = (epicsUInt16)plcGetInt(plcTypeOf(plcUnsigned, 2), h + 2, bigEndian);
    if (s->state == plcSyncDisconnected)
        return 0;
    if (s->layout && s->theirs && s->layout != s->theirs) {
        s->state = plcSyncLayoutMismatch;
        return 0;
    }
    if (!(s->flags & plcFlagRemote)) {
        s->state = plcSyncLocal;
        s->asked = 0;
        return plcSyncTake;
    }
    if ((s->flags & plcFlagSync) && s->state == plcSyncSynced)
        return 0;
    if ((s->flags & plcFlagSync) && s->state == plcSyncChecking && s->asked && same) {
        s->state = plcSyncSynced;
        return 0;
    }
    /* Not synchronised, or SYNC of a time before we asked, or the PLC agreed to an older
     * block than our last: show what we have read back. */
    if (s->state != plcSyncChecking || !same)
        s->asked = 0;
    s->state = plcSyncChecking;
    return plcSyncTake | plcSyncSend;
}

void plcSyncMap(plcSync *s, const void *header, int download)
{
    s->flags = *(const epicsUInt8 *)header;
    s->asked = 0;
    if (s->state != plcSyncDisconnected)
        s->state = download ? plcSyncMapDownload : plcSyncMapMismatch;
}

int plcSyncMaySend(const plcSync *s)
{
    return states[s->state].sends;
}

void plcSyncHeader(plcSync *s, void *header, int bigEndian)
{
    epicsUInt8 *h = header;

    h[0] = (epicsUInt8)states[s->state].flags;
    h[1] = ++s->counter;
    plcPutInt(plcTypeOf(plcUnsigned, 2), h + 2, bigEndian, s->layout);
    if (s->state == plcSyncChecking)
        s->asked = 1;
}

const char *plcSyncReason(int state)
{
    return states[state].refusal;
}

const char *plcSyncStateName(int state)
{
    return state >= 0 && state < (int)(sizeof(states) / sizeof(states[0]))
               ? states[state].name
               : "?";
}
