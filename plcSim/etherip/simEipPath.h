/* simEipPath: the path of a CIP request taken apart into segments. It does not know what
 * the segments lead to.
 *
 *   91 n text [00]                  symbol
 *   20 c   21 00 c c                class
 *   24 i   25 00 i i   26 00 i(4)   instance
 *   30 a   31 00 a a                attribute
 *   28 e   29 00 e e   2A 00 e(4)   element
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simEipPath_H
#define INC_simEipPath_H

#include <stddef.h>
#include <epicsTypes.h>

#include "simLog.h"

#define SIM_EIP_SEGMENTS 64

typedef enum simEipSegmentKind {
    eipSymbol,
    eipClass,
    eipInstance,
    eipAttribute,
    eipElement
} simEipSegmentKind;

typedef struct simEipSegment {
    simEipSegmentKind kind;
    epicsUInt32 value;      /* of all but a symbol */
    const epicsUInt8 *text; /* of a symbol: not terminated */
    size_t length;          /* bytes of it */
} simEipSegment;

typedef struct simEipPath {
    simEipSegment segments[SIM_EIP_SEGMENTS];
    size_t count;
} simEipPath;

/* Returns 0, or -1 where a segment is not one of these or is cut by the end. */
int simEipPathParse(simEipPath *path, const epicsUInt8 *bytes, size_t size);

/* 1 when the path begins with class and instance, which are stored; else 0. */
int simEipPathObject(const simEipPath *path, unsigned *class, epicsUInt32 *instance);

/* Adds "REALs[3].x", "@6b/12[3]", or "@01/1/7". */
void simEipPathText(const simEipPath *path, simText *out);

#endif
