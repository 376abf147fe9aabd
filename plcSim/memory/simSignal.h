/* simSignal: values that move by themselves, as a pure function of time and block number.
 * It does not know of blocks going anywhere: it writes bytes at a place in PLC memory.
 *
 *   signal <place> <type> constant <value>
 *   signal <place> <type> ramp <low> <high> <period>       saw tooth
 *   signal <place> <type> sine <low> <high> <period>
 *   signal <place> <type> square <low> <high> <period>     low first
 *   signal <place> <type> noise <low> <high>               new value with each block
 *   signal <place> <type> counter [<period>]               +1 per block, or per period
 *   signal <place> STRING[n] text "a" ["b" ... <period>]   changes text each period
 *   signal <place> TIME|DTL clock [<offset>]               UTC, offset may be negative
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simSignal_H
#define INC_simSignal_H

#include "simMemory.h"

#define SIM_MAX_TEXTS 16

struct simShape;

typedef struct simSignal {
    simPlace place;
    simType type;
    const struct simShape *shape;
    double low, high;
    double period; /* s */
    unsigned seed;
    char *texts[SIM_MAX_TEXTS];
    size_t textCount;
} simSignal;

/* The moment a signal is computed for. */
typedef struct simMoment {
    double time;       /* s since the PLC started */
    double wall;       /* s since 1970 UTC */
    epicsUInt64 block; /* number of the block that goes out */
} simMoment;

/* Reads "100 ms", "2s", "1.5 min", "20us"; without a unit ms. Result in s. */
int simTimeParse(const char *text, double *seconds, char error[SIM_ERROR_SIZE]);

/* Reads the words behind "signal". A bare offset lies in `byDefault`. Returns 0 or -1. */
int simSignalParse(const simMemory *mem, simBlock *byDefault, char **words, size_t count,
                   simSignal *signal, char error[SIM_ERROR_SIZE]);
void simSignalFree(simSignal *signal);
/* True when the signal is a counter: `freeze heartbeat` stops these. */
int simSignalIsCounter(const simSignal *signal);
/* Writes the value of this moment. */
void simSignalWrite(const simMemory *mem, const simSignal *signal,
                    const simMoment *moment);

#endif
