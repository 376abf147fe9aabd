/* A pair and its PLCs for tests; see pairWorld.h. */
#include <arpa/inet.h>
#include <stdio.h>
#include <string.h>

#include <epicsThread.h>
#include <epicsTime.h>
#include <epicsUnitTest.h>

#include "pairWorld.h"
#include "phoenixRedund.h"

static int makePeers(pairWorld *w, size_t outSize)
{
    int port, attempt;

    for (attempt = 0; attempt < 20; attempt++) {
        port = 0;
        w->plc[0] = pairPeerCreate(1, "127.0.0.2", &port, outSize);
        w->plc[1] = w->plc[0] ? pairPeerCreate(2, "127.0.0.3", &port, outSize) : NULL;
        if (w->plc[1])
            return port;
        if (w->plc[0])
            pairPeerDestroy(w->plc[0]);
    }
    testAbort("no port on 127.0.0.2 and 127.0.0.3");
    return 0;
}

void pairWorldBegin(pairWorld *w, const char *name, size_t outSize, unsigned recvTimeout,
                    double period)
{
    char port[12], out[12], timeout[12], error[200];
    const char *args[9] = {name, "127.0.0.2", port, "16", out, "1", timeout, "2", "1"};

    memset(w, 0, sizeof(*w));
    sprintf(port, "%d", makePeers(w, outSize));
    sprintf(out, "%u", (unsigned)outSize);
    sprintf(timeout, "%u", recvTimeout);
    if (phoenixplcConfigure(args))
        testAbort("cannot configure");
    w->station = plcStationFind(name);
    w->pair = phoenixPairFind(name);
    plcStationSetOption(w->station, "pingPeriod", "0", error, sizeof(error));
    pairPeerPeriod(w->plc[0], period);
    pairPeerPeriod(w->plc[1], period);
    plcStationsStart();
    plcStationsRun();
    if (!pairWorldWait(w, w->now.connected[0] && w->now.connected[1]))
        testAbort("the PLCs are not connected");
}

void pairWorldEnd(pairWorld *w)
{
    plcStationsDestroy();
    pairPeerDestroy(w->plc[0]);
    pairPeerDestroy(w->plc[1]);
}

static epicsUInt32 wordAt(const unsigned char *block, size_t offset)
{
    epicsUInt32 word;

    memcpy(&word, block + offset, 4);
    return ntohl(word);
}

int pairWorldLook(pairWorld *w)
{
    unsigned char block[PEER_IN];

    w->who = 0;
    if (plcImageRead(plcStationInput(w->station), 0, sizeof(block), block, NULL)) {
        w->gap |= w->valid;
        w->valid = 0;
    } else {
        w->valid = 1;
        w->who = wordAt(block, 0);
        w->counter = wordAt(block, 4);
        w->mirror = wordAt(block, 8);
        w->strange |= (w->who != 1 && w->who != 2) || wordAt(block, 12);
    }
    phoenixPairStatus(w->pair, &w->now);
    return 1;
}

void pairWorldReadback(pairWorld *w, int track)
{
    char error[200];

    w->follows = 1;
    plcStationAddReadback(w->station, w, 0, 8, 4, NULL);
    if (plcStationSetOption(w->station, "track", track ? "on" : "off", error, sizeof(error)))
        testAbort("%s", error);
}

void pairWorldPut(pairWorld *w, epicsUInt32 word)
{
    char reason[PLC_REASON_SIZE];

    word = htonl(word);
    plcStationPut(w->station, 0, sizeof(word), &word, NULL, reason, w->follows, NULL);
}

pairPeerSeen pairWorldSeen(pairWorld *w, int which)
{
    pairPeerSeen seen;

    pairPeerLook(w->plc[which], &seen);
    return seen;
}
