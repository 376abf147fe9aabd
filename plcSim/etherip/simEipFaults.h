/* simEipFaults: what goes wrong on purpose, for which requests, how often. It decides;
 * simEip and simEipController do it.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simEipFaults_H
#define INC_simEipFaults_H

#include <stddef.h>
#include <epicsTypes.h>

#include "simLog.h"

#define SIM_EIP_RULES 64
#define SIM_EIP_FILTER 100 /* bytes of a tag's path in a filter */

typedef enum simEipFault {
    eipFaultStatus, /* number: general status, second: extended, 0 = none */
    eipFaultSlow,   /* number: ms */
    eipFaultSilent,
    eipFaultDrop,    /* the connection ends, without an answer */
    eipFaultClose,   /* half of the answer, then the end */
    eipFaultShort,   /* number: bytes that leave */
    eipFaultGarbage, /* number: random bytes instead of the answer */
    eipFaultLength,  /* number: what the length field says too much */
    eipFaultContext,
    eipFaultSession,
    eipFaultSequence,
    eipFaultId,      /* connection id */
    eipFaultService, /* the service in the answer */
    eipFaultSwap,    /* the answer leaves behind the next one */
    eipFaultOld,     /* the data of the answer before */
    SIM_EIP_FAULTS
} simEipFault;

/* A fault, and the requests that it meets. */
typedef struct simEipRule {
    simEipFault fault;
    long number, second;
    int close;                /* short: the connection ends behind it */
    int reads, writes;        /* which requests; both 0 = all */
    int connected;            /* 1 connected, 2 unconnected, 0 = all */
    unsigned service;         /* 0 = all */
    char tag[SIM_EIP_FILTER]; /* its path, or the beginning; empty = all */
    unsigned long remaining;  /* requests; 0 = always */
} simEipRule;

typedef struct simEipFaults {
    simEipRule rules[SIM_EIP_RULES]; /* oldest first */
    size_t count;
} simEipFaults;

/* What a filter looks at: one request, not a packet of them. */
typedef struct simEipSubject {
    unsigned service;
    int connected;
    const char *path; /* "REALs[3]" */
} simEipSubject;

/* What happens to a frame. */
typedef struct simEipFate {
    int silent; /* not served, not answered */
    int drop;   /* likewise, and the connection ends */
    double delay;
    int half, close; /* as in Modbus: half, or `shorten` bytes, then the end */
    long shorten;    /* -1 = all */
    long garbage;    /* -1 = none */
    long length;     /* added to the length field */
    int context, session, sequence, id, service, swap, old;
} simEipFate;

/* Adds a rule from words such as "status 05 tag REALs write next 3", or ends faults
 * ("silent off"). Returns 0, or -1 with the reason in error. */
int simEipFaultParse(simEipFaults *faults, char **words, size_t count,
                     char error[SIM_ERROR_SIZE]);
/* True when this word is the name of a fault. */
int simEipFaultKnown(const char *word);
void simEipFaultsClear(simEipFaults *faults);

/* The status that answers this request instead of serving it: 1 with both numbers, or 0.
 */
int simEipFaultsStatus(simEipFaults *faults, const simEipSubject *subject,
                       unsigned *status, unsigned *extended);

/* What meets a frame that carries these requests; counts it once for each rule. */
void simEipFaultsMeet(simEipFaults *faults, const simEipSubject *subjects, size_t count,
                      simEipFate *fate);

/* Adds " status=05,tag=REALs,next=3", one for each rule, or " none". */
void simEipFaultsText(const simEipFaults *faults, simText *out);

#endif
