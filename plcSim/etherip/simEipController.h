/* simEipController: the controller as CIP requests see it: its tags, its objects, its
 * connections, and the answers. It knows no socket, no frame and no clock: time is given.
 *
 *   request   service(1)  path words(1)  path  data
 *   answer    service | 80(1)  0(1)  status(1)  n(1)  extended status(2 n)  data
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simEipController_H
#define INC_simEipController_H

#include "simEipConnections.h"
#include "simEipFaults.h"
#include "simEipProfile.h"
#include "simEipTags.h"

#define SIM_EIP_UNCONNECTED 504 /* bytes of a request or an answer without connection */
#define SIM_EIP_ANSWER 4096     /* bytes of the longest answer */

/* General status. */
#define EIP_OK 0x00
#define EIP_FAILURE 0x01 /* of the connection manager; see the extended status */
#define EIP_NO_RESOURCE 0x02
#define EIP_BAD_PARAMETER 0x03
#define EIP_PARTIAL 0x06
#define EIP_NO_SERVICE 0x08
#define EIP_BAD_ATTRIBUTE 0x0A
#define EIP_NO_PRIVILEGE 0x0F
#define EIP_STATE 0x10
#define EIP_TOO_LARGE 0x11
#define EIP_TOO_SHORT 0x13
#define EIP_NOT_SETTABLE 0x14
#define EIP_TOO_LONG 0x15
#define EIP_SERVICE_ERROR 0x1E /* one or more of a Multiple Service Packet */
#define EIP_BAD_PATH_SIZE 0x26
#define EIP_GENERAL 0xFF

/* Extended status with EIP_GENERAL. */
#define EIP_OFFSET 0x2104
#define EIP_BEYOND 0x2105
#define EIP_TYPE 0x2107
/* with EIP_STATE */
#define EIP_KEY_SWITCH 0x2101
/* Extended status of Omron, with EIP_PARAMETER. */
#define EIP_PARAMETER 0x20
#define EIP_NO_ARRAY 0x8017 /* several elements of one */
#define EIP_RANGE 0x8018    /* none, or more than there are */
#define EIP_OTHER_TYPE 0x8022

typedef enum simEipKey { eipRemote, eipRun, eipProgram } simEipKey;

typedef struct simEipController {
    const simEipProfile *profile;
    unsigned slot;
    epicsUInt32 serial;    /* of the identity object */
    char program[32];      /* its name */
    simEipKey key;         /* of the front: in RUN nobody else may write */
    int refuseExtra;       /* bytes behind the data of a write are EIP_TOO_LONG */
    epicsUInt8 address[4]; /* of ListIdentity, in network order */
    unsigned port;
    double clock; /* s since 1970 UTC minus the time of requests */
    simEipTypes types;
    simEipTags tags;
    simEipConnections connections;
    simEipFaults faults;
    epicsUInt32 downloads, edits; /* make the attributes of class AC */
    epicsUInt64 services[256];    /* requests, those in packets too */
    epicsUInt64 statuses[256];    /* answers */
} simEipController;

typedef struct simEipRequest {
    unsigned service;
    const epicsUInt8 *path, *data;
    size_t pathSize, dataSize;
} simEipRequest;

typedef struct simEipAnswer {
    unsigned status, extended[2];
    int extendedCount;
    size_t room; /* bytes that data may have */
    size_t size; /* bytes of data */
    epicsUInt8 data[SIM_EIP_ANSWER];
} simEipAnswer;

/* Where a request comes from. */
typedef struct simEipOrigin {
    unsigned client;
    double now;    /* s, monotonic */
    int connected; /* through a connection: it has reached the CPU */
    int routed;    /* in an Unconnected_Send: likewise */
    int nested;    /* in a Multiple Service Packet */
} simEipOrigin;

/* memory must outlive it. */
void simEipControllerInit(simEipController *c, const simEipProfile *profile,
                          simMemory *memory);
void simEipControllerFree(simEipController *c);
/* All ids change, those of structures too; `shift`: old ones mean other tags then. */
void simEipControllerDownload(simEipController *c, int shift);

/* Serves a request, and makes an answer of at most `limit` bytes at out (SIM_EIP_ANSWER
 * bytes). Returns its size. */
size_t simEipServe(simEipController *c, const simEipOrigin *origin,
                   const epicsUInt8 *bytes, size_t size, epicsUInt8 *out, size_t limit);

/* Calls fn for each request of a message, in its order: what an Unconnected_Send carries,
 * and those of a Multiple Service Packet. What cannot be taken apart is left out. */
void simEipWalk(const epicsUInt8 *bytes, size_t size,
                void (*fn)(void *arg, const simEipRequest *request,
                           const simEipPath *path),
                void *arg);

/* Adds the path as text; an instance of class 6B by the name of its tag. */
void simEipControllerPathText(const simEipController *c, const simEipPath *path,
                              simText *out);

/* Sets a status, with one word of extended status where `extended` is not 0. */
void simEipFail(simEipAnswer *answer, unsigned status, unsigned extended);
/* Adds to the answer; what does not fit makes it EIP_TOO_LARGE. Returns 0 or -1. */
int simEipAdd(simEipAnswer *answer, const void *bytes, size_t size);
int simEipAddInt(simEipAnswer *answer, size_t size, epicsUInt64 value);

/* ---- for simEipController alone ---- */

/* Services on tags: 4C 4D 4E 52 53. */
void simEipTagService(simEipController *c, const simEipRequest *request,
                      const simEipPath *path, simEipAnswer *answer);
int simEipIsTagService(unsigned service);
/* Identity 01, symbols 6B, templates 6C, program name 64, clock 8B, changes AC. */
void simEipObject(simEipController *c, const simEipOrigin *origin,
                  const simEipRequest *request, const simEipPath *path,
                  simEipAnswer *answer);
/* The identity of the CPU, or of the module in front, as Get_Attributes_All has it. */
void simEipIdentityBytes(const simEipController *c, int front, simEipAnswer *answer);

#endif
