/* simEipProfile: what one kind of controller can and cannot, as one const row each. It
 * does nothing.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simEipProfile_H
#define INC_simEipProfile_H

#include <stddef.h>

#include "simEipTypes.h"

/* As the identity object tells it. */
typedef struct simEipIdentity {
    unsigned vendor, deviceType, productCode, major, minor;
    const char *name;
} simEipIdentity;

typedef struct simEipProfile {
    const char *name;
    simEipIdentity cpu, front; /* the module that has the network port */
    int frontIsCpu;            /* requests without a route reach the tags */
    int route;                 /* has a backplane: Unconnected_Send, and slots */
    size_t smallest, small,
        large;          /* bytes of a connection; large 0 = no Large Forward Open */
    int multiple;       /* requests in a Multiple Service Packet, 0 = none */
    int list;           /* the tag list (55) and templates */
    int externalAccess; /* attribute 10 */
    int omron; /* services 4C and 4D only; an array without an element is the whole, with count
                * 1; each BOOL of an array is an element; statuses of its own */
    unsigned trueByte;  /* what a BOOL that is true looks like */
    simEipStrings strings;
} simEipProfile;

/* In the order of simEipProfileNames. */
extern const simEipProfile simEipProfiles[];
/* For the key of the file. */
extern const char simEipProfileNames[];

#endif
