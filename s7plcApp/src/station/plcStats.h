/* What a station counts and measures. Filled by the station's thread, copied under its lock
 * (plcStationStats), read by statistics records, reports and tests.
 *
 * Pure: knows numbers, not where they come from.
 */
#ifndef INC_plcStats_H
#define INC_plcStats_H

#include <epicsTime.h>
#include <epicsTypes.h>

#define PLC_TEXT_SIZE 120

/* Bins of the histograms: three to the octave, bin i begins at 0.01 ms * 2^(i/3); the
 * first takes all that is shorter, the last (21 s) all that is longer. */
#define PLC_BINS 64

typedef struct plcStats {
    /* now */
    int connected;              /* 1: TCP to the leading PLC is up */
    int alive;                  /* 1: connected, and the data is valid */
    int state;                  /* plcStationState */
    epicsUInt64 stateSince;     /* monotonic ns: when it began */
    epicsTimeStamp lostTime;    /* wall clock: when valid data was last lost, 0 = never */
    int leader;                 /* line that leads, -1 none */
    epicsUInt64 connectedSince; /* monotonic ns, 0 = not connected */
    epicsUInt64 lastBlock;      /* monotonic ns, 0 = none */
    epicsUInt64 lastSend;       /* monotonic ns, 0 = none */
    epicsTimeStamp connectTime; /* wall clock of the last connect, 0 = never */
    epicsTimeStamp blockTime;   /* stamp of the last block, 0 = none */
    epicsUInt32 burstSize;      /* bytes that the PLC seems to send at a time where inSize
                                   are configured; 0 = the size is right */
    double clockOffset;         /* PLC clock minus IOC clock, s; 0 without timestamp= */
    int syncState;              /* plcSyncState; with sync=on */
    int remote;                 /* 1: REMOTE, 0: LOCAL, as the PLC last said */
    epicsUInt64 syncSince;      /* monotonic ns: when syncState began */
    int layoutPlc;              /* layout id that the PLC last showed, 0 = none */
    int mapState;               /* plcTablesState; with map=check or download */
    int mapProgress;            /* %, 100: the PLC works with our table */
    epicsUInt32 mapCrc;         /* of our table, 0 = there is none */
    epicsUInt32 mapPlcCrc;      /* of the table that the PLC works with, 0 = none */
    char mapReason[PLC_TEXT_SIZE]; /* why the PLC does not work with ours */
    unsigned refusedReads;      /* registers or bits of the input that the PLC does not show */
    unsigned refusedOf;         /* of so many; 0: the wire does not tell */
    char refusal[PLC_TEXT_SIZE]; /* which, and why; "": none */
    unsigned putsWaiting;       /* for an acknowledging wire */
    int outputConnected;        /* 1: outputs go somewhere; over another wire this may be another
                                   connection than that of the blocks */
    char lastError[PLC_TEXT_SIZE];
    epicsTimeStamp lastErrorTime; /* wall clock of it, 0 = none */

    /* counters since start or plcStatsReset */
    epicsUInt64 blocksIn;       /* whole blocks received */
    epicsUInt64 blocksOut;      /* whole blocks handed to the kernel */
    epicsUInt64 bytesIn;
    epicsUInt64 bytesOut;
    epicsUInt64 skipped;        /* older blocks of a backlog, replaced by a newer one */
    epicsUInt64 coalesced;      /* blocks that joined a scan pass that was still waiting */
    epicsUInt64 ignored;        /* blocks of a PLC that does not lead */
    epicsUInt64 heartbeats;     /* unchanged blocks sent */
    epicsUInt64 slowSends;      /* blocks that were due while the PLC had not taken the one
                                   before */
    epicsUInt64 refusedWrites;  /* puts refused (offline, not synchronised, LOCAL) */
    epicsUInt64 syncs;          /* times the PLC agreed */
    epicsUInt64 syncsLost;      /* times it took that back, or the connection broke */
    epicsUInt64 readbacks;      /* places where outputs took the PLC's value */
    epicsUInt64 sizeMismatches; /* times the block size was found wrong */
    epicsUInt64 layoutMismatches; /* times the layout ids were found to differ */
    epicsUInt64 doubts;         /* times bytes came where no block should begin; nothing was
                                   taken until that was resolved */
    epicsUInt64 outOfStep;      /* times it was not, and the connection was made anew */
    epicsUInt64 mapDownloads;   /* tables that the PLC took from us */
    epicsUInt64 mapRefusals;    /* tables that it refused */
    epicsUInt64 connects;       /* connections made */
    epicsUInt64 disconnects;    /* connections lost */
    epicsUInt64 connectErrors;  /* attempts that failed */
    epicsUInt64 clockErrors;    /* blocks whose PLC clock was nonsense */
    epicsUInt64 putsDropped;    /* because too many waited: a newer one of its place is kept */
    epicsUInt64 requests;       /* by requests: all that were sent */
    epicsUInt64 exceptions;     /* of them the PLC refused */
    epicsUInt64 requestTimeouts; /* of them it did not answer */

    /* times in ms, since start or plcStatsReset */
    double periodLast, periodMin, periodMax, periodMean; /* block to block */
    double jitter;              /* standard deviation of the period */
    double sendLatency;         /* last: first write to last byte in the kernel */
    double sendLatencyMax;
    double requestLatency;      /* last: request to answer */
    double requestLatencyMax;
    double scanLatency;         /* last: block's arrival to the end of its pass */
    double scanLatencyMax;
    epicsUInt32 periodHist[PLC_BINS];
    epicsUInt32 latencyHist[PLC_BINS];

    /* running sums behind periodMean and jitter (Welford) */
    epicsUInt64 periods;
    double periodSquares;
} plcStats;

/* Sets counters and measured times to zero; what is true now stays. */
void plcStatsReset(plcStats *stats);

/* A block came `ms` after the one before. */
void plcStatsPeriod(plcStats *stats, double ms);

/* A pass of input records ended, or an output block left, `ms` after its cause. */
void plcStatsScan(plcStats *stats, double ms);
void plcStatsSend(plcStats *stats, double ms);

/* The bin of a time, and the time where a bin begins; ms. */
int plcStatsBin(double ms);
double plcStatsBinStart(int bin);

#endif /* INC_plcStats_H */
