/* One PLC of a pair for tests, in a thread of its own: sends blocks, takes blocks, fails
 * on command. Shares no code with the driver.
 *
 * Block to the IOC, big endian: 0 who sends (1, 2)  4 counter, +1 per block  8 mirror of
 * the first bytes of the last block from the IOC. All functions may be called from any
 * thread; they return at once, unless they say that they wait.
 */
#ifndef INC_pairPeer_H
#define INC_pairPeer_H

#include <stddef.h>

#include <epicsTypes.h>

#define PEER_IN 16 /* bytes of a block to the IOC */

typedef struct pairPeer pairPeer;

/* Listens on address:*port; *port 0: any, and *port becomes it. NULL: could not. */
pairPeer *pairPeerCreate(epicsUInt32 who, const char *address, int *port, size_t outSize);
void pairPeerDestroy(pairPeer *peer);

/* ms from block to block from now on. */
void pairPeerPeriod(pairPeer *peer, double ms);

/* Each fourth block comes this time later, ms. So the driver gets used to be patient, and
 * a busy machine that lets this thread sleep does not matter. */
void pairPeerSlow(pairPeer *peer, double ms);

/* The next block is so many bytes too long, or (negative) too short; under PEER_IN. */
void pairPeerSlip(pairPeer *peer, int by);

/* 1: sends (PRIMARY), the first block at once; 0: does not (BACKUP). */
void pairPeerSend(pairPeer *peer, int on);

/* 1: the cable is pulled: no byte in or out, and no close. 0: plugged in again. */
void pairPeerPull(pairPeer *peer, int on);

/* Closes the connection; `down`: takes no new one until pairPeerUp. Waits until done. */
void pairPeerClose(pairPeer *peer, int down);
void pairPeerUp(pairPeer *peer);

typedef struct pairPeerSeen {
    int connected;
    unsigned connects;
    epicsUInt32 sent;      /* counter of the last block that was sent */
    epicsUInt32 received;  /* whole blocks from the IOC */
    epicsUInt32 last;      /* first word of the last of them */
    epicsUInt32 lastCount; /* how many of them in a row had it */
    epicsUInt64 longest; /* ns: longest time between two blocks since pairPeerSeenReset */
} pairPeerSeen;

void pairPeerLook(pairPeer *peer, pairPeerSeen *seen);
void pairPeerSeenReset(pairPeer *peer);

/* How many blocks from the IOC began with this word. */
unsigned pairPeerCount(pairPeer *peer, epicsUInt32 word);

#endif /* INC_pairPeer_H */
