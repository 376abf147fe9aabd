/* A station with a pair and its two PLCs on 127.0.0.2 and 127.0.0.3, for tests. */
#ifndef INC_pairWorld_H
#define INC_pairWorld_H

#include "pairPeer.h"
#include "phoenixPair.h"
#include "plcStation.h"

typedef struct pairWorld {
    plcStation *station;
    phoenixPair *pair;
    pairPeer *plc[PLC_LINES_MAX];
    int follows; /* the word has a read-back, its mirror */
    int gap; /* data was seen to be not valid, though it had been */
    int valid;
    int strange; /* a value was seen that neither PLC has sent */
    phoenixStatus now; /* as of the last look */
    epicsUInt32 who;   /* whose block is in the image, 0: not valid */
    epicsUInt32 counter;
    epicsUInt32 mirror;
} pairWorld;

/* Makes and starts it: both PLCs connected, none sends. recvTimeout in ms, period of the
 * PLCs in ms. Ends the test program when it cannot. */
void pairWorldBegin(pairWorld *world, const char *name, size_t outSize,
                    unsigned recvTimeout, double period);

/* The stations stop (all of them), then the PLCs. */
void pairWorldEnd(pairWorld *world);

/* Looks at everything, fills in the structure. Returns 1, so that it can stand in a
 * condition. */
int pairWorldLook(pairWorld *world);

/* From now on the word that is put has a read-back; track: the option. */
void pairWorldReadback(pairWorld *world, int track);

/* A put of this word to the start of the output block. */
void pairWorldPut(pairWorld *world, epicsUInt32 word);

pairPeerSeen pairWorldSeen(pairWorld *world, int which);

/* Waits until the condition is true, looking each half ms; 20 s at most. Its value is
 * the condition's. */
#define pairWorldWait(world, condition)                                                  \
    ({                                                                                   \
        epicsUInt64 until_ = epicsMonotonicGet() + 20000000000ull;                       \
        int true_;                                                                       \
        while (!(true_ = (pairWorldLook(world) && (condition))) &&                       \
               epicsMonotonicGet() < until_)                                             \
            epicsThreadSleep(0.0005);                                                    \
        true_;                                                                           \
    })

#endif /* INC_pairWorld_H */
