/* Frames of EtherNet/IP: the encapsulation header, and the two items in which a CIP message
 * travels.
 *
 *     0 command   2 length of the rest   4 session   8 status   12 context   20 options   24
 *     SendRRData    0 interface  4 timeout  6 items=2  8 type 0 length 0
 *                   12 type B2 length n  16 message
 *     SendUnitData  0 interface  4 timeout  6 items=2  8 type A1 length 4 connection id
 *                   16 type B1 length n  20 sequence count  22 message
 *
 * Little-endian. Knows no sessions, no messages, no sockets, no clock. Pure; any thread.
 */
#ifndef INC_eipFrame_H
#define INC_eipFrame_H

#include "eipBytes.h"

enum {
    eipHeaderSize = 24,
    eipFrameMax = eipHeaderSize + 65535, /* bytes */
    eipTcpPort = 44818,
    eipContextSize = 8
};

typedef enum {
    eipListServices = 0x04,
    eipListIdentity = 0x63,
    eipRegisterSession = 0x65,
    eipUnregisterSession = 0x66,
    eipSendRRData = 0x6f,
    eipSendUnitData = 0x70
} eipCommand;

typedef struct eipHeader {
    unsigned command, length; /* length: bytes behind the header */
    epicsUInt32 session, status;
    epicsUInt8 context[eipContextSize];
    epicsUInt32 options;
} eipHeader;

/* Begins a frame; context may be NULL: zeros. */
void eipFrameBegin(eipWriter *w, eipCommand command, epicsUInt32 session,
                   const epicsUInt8 *context);

/* Ends it: the length is known now. Returns the bytes of the frame; 0: it had no room. */
size_t eipFrameEnd(eipWriter *w);

/* The items around a message that follows; `timeout` in s is for who forwards it. */
void eipItemsUnconnected(eipWriter *w, unsigned timeout);
void eipItemsConnected(eipWriter *w, epicsUInt32 connection, unsigned sequence);

/* Ends the items: their length is known now. Before eipFrameEnd. */
void eipItemsEnd(eipWriter *w);

/* How long is the frame that begins with these bytes? 0: they are too few to tell. */
size_t eipFrameLength(const epicsUInt8 *bytes, size_t have);

/* Takes the header off. Returns 0, or -1 when there is no whole frame, or more. */
int eipHeaderTake(eipReader *r, eipHeader *header);

/* What stands around a message. */
typedef struct eipItems {
    epicsUInt32 connection;  /* connected only */
    unsigned sequence;       /* the same */
    const epicsUInt8 *message;
    size_t length;
} eipItems;

/* Takes the items of an answer off what is behind the header: connected or not, as `command`
 * says. Items behind the two are left alone. Returns 0, or -1 when they are not whole. */
int eipItemsTake(eipReader *r, unsigned command, eipItems *items);

/* A status of the header in words: "session not known to the PLC". */
const char *eipFrameStatusText(epicsUInt32 status);

#endif /* INC_eipFrame_H */
