/* The policy of a single PLC; see plcPolicy.h. */
#include "plcHot.h"
#include "plcPolicy.h"

PLC_HOT static int singleStep(void *pvt, plcEvent event, unsigned which, epicsUInt64 now,
                              epicsUInt64 *wake)
{
    (void)pvt;
    (void)which;
    (void)now;
    (void)wake; /* it never asks for a tick */
    return event == plcEventLost ? -1 : 0;
}

const plcPolicy plcSingle = {.name = "single", .lines = 1, .step = singleStep};
