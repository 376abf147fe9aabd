/* simEipProfile: what one kind of controller can and cannot, as one const row each. It
 * does nothing.
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
        .wholeArrays = 1,
        .trueByte = 0x01,
        .strings = eipStringLong,
    },
};
/* clang-format on */
