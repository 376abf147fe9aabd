/* simEipProfile: what one kind of controller can and cannot, as one const row each. It
 * does nothing.
 *
 * What is known of Omron NJ and NX: their manual W506, sections 8-4-5 (paths, ranges of an
 * array), 8-6 (services 4C and 4D) and 8-7 (types, formats of BOOL and arrays); the extended status 8017
 * of NX1P2 in libplctag.NET 381, the others in libplctag 466; no fragments in libplctag 308 and
 * 430; no byte behind one that is written in libplctag 457; answers that are too long in
 * libplctag 307 and 454. Not known, and stricter here than perhaps there: a BOOL that is written
 * must have its second byte. Not as there: the layout of a whole structure.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include "simEipProfile.h"

#define ROCKWELL 1
#define OMRON 47
#define CONTROLLER 0x0E /* device types */
#define ADAPTER 0x0C

const char simEipProfileNames[] = "l8x|enet|micro800|omron";

/* clang-format off */
const simEipProfile simEipProfiles[] = {
    {
        .name = "l8x",
        .cpu = {ROCKWELL, CONTROLLER, 166, 33, 11, "1756-L83E/B"},
        .front = {ROCKWELL, CONTROLLER, 166, 33, 11, "1756-L83E/B"},
        .frontIsCpu = 1,
        .route = 1,
        .smallest = 32,
        .small = 511,
        .large = 4002,
        .multiple = 1000,
        .list = 1,
        .externalAccess = 1,
        .trueByte = 0x01,
        .strings = eipStringStruct,
    },
    {
        .name = "enet",
        .cpu = {ROCKWELL, CONTROLLER, 51, 13, 24, "1756-L55/A LOGIX5555"},
        .front = {ROCKWELL, ADAPTER, 58, 2, 7, "1756-ENET/A"},
        .route = 1,
        .smallest = 32,
        .small = 504,
        .multiple = 1000,
        .list = 1,
        .trueByte = 0xFF,
        .strings = eipStringStruct,
    },
    {
        .name = "micro800",
        .cpu = {ROCKWELL, CONTROLLER, 151, 12, 11, "2080-LC50-48QWB"},
        .front = {ROCKWELL, CONTROLLER, 151, 12, 11, "2080-LC50-48QWB"},
        .frontIsCpu = 1,
        .smallest = 32,
        .small = 504,
        .trueByte = 0x01,
        .strings = eipStringShort,
    },
    {
        .name = "omron",
        .cpu = {OMRON, ADAPTER, 1635, 2, 10, "NJ501-1300"},
        .front = {OMRON, ADAPTER, 1635, 2, 10, "NJ501-1300"},
        .frontIsCpu = 1,
        .route = 1,
        .smallest = 32,
        .small = 502,
        .large = 1994,
        .multiple = 32,
        .omron = 1,
        .trueByte = 0x01,
        .strings = eipStringLong,
    },
};
/* clang-format on */
