/* simEipFrame: the encapsulation around CIP messages: the header of 24 bytes and the
 * items behind it. It knows no CIP and no socket.
 *
 *   0         2        4         8        12            20         24
 *   | command | length | session | status | context (8) | options  | length bytes
 *
 *   6F, 70:  interface(4) = 0  timeout(2)  items(2) = 2  { type(2)  length(2)  bytes } x
 * 2 6F: items 0000 (empty), 00B2 (message) 70: items 00A1 (connection id), 00B1 (sequence
 * count (2), message)
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simEipFrame_H
#define INC_simEipFrame_H

#include <stddef.h>
#include <epicsTypes.h>

#define SIM_EIP_HEADER 24
#define SIM_EIP_FRAME (SIM_EIP_HEADER + 22 + 4096) /* bytes of our longest */
#define SIM_EIP_RR_MESSAGE 40   /* where the message begins in an answer, 6F ... */
#define SIM_EIP_UNIT_MESSAGE 46 /* ... and 70 */

/* Commands. */
#define EIP_NOP 0x00
#define EIP_LIST_SERVICES 0x04
#define EIP_LIST_IDENTITY 0x63
#define EIP_LIST_INTERFACES 0x64
#define EIP_REGISTER 0x65
#define EIP_UNREGISTER 0x66
#define EIP_RR_DATA 0x6F
#define EIP_UNIT_DATA 0x70

/* Status in the header. */
#define ENCAP_OK 0x00
#define ENCAP_BAD_COMMAND 0x01
#define ENCAP_BAD_DATA 0x03
#define ENCAP_BAD_SESSION 0x64
#define ENCAP_BAD_LENGTH 0x65
#define ENCAP_BAD_VERSION 0x69

typedef struct simEipFrame {
    unsigned command;
    epicsUInt32 session, options;
    const epicsUInt8 *context; /* 8 bytes */
    const epicsUInt8 *data;
    size_t size; /* bytes of data */
} simEipFrame;

/* Bytes of the frame that begins here, 0 when more must come. */
size_t simEipFrameSize(const epicsUInt8 *bytes, size_t size);
/* Takes a whole frame apart. */
void simEipFrameParse(simEipFrame *frame, const epicsUInt8 *bytes, size_t size);

/* The message of 6F and 70. */
typedef struct simEipItems {
    epicsUInt32 id;    /* 70: of the connection */
    unsigned sequence; /* 70 */
    const epicsUInt8 *message;
    size_t size; /* bytes of it */
} simEipItems;

/* Returns a status of the header. */
int simEipItemsParse(const simEipFrame *frame, simEipItems *items);

/* Writes the header of an answer with `size` bytes behind it. */
void simEipFrameHeader(epicsUInt8 *out, const simEipFrame *request, epicsUInt32 session,
                       unsigned status, size_t size);
/* Writes all in front of a message of `size` bytes, which stands at SIM_EIP_RR_MESSAGE or
 * SIM_EIP_UNIT_MESSAGE already. Returns the size of the frame. */
size_t simEipFrameAround(epicsUInt8 *out, const simEipFrame *request, epicsUInt32 id,
                         unsigned sequence, size_t size);

#endif
