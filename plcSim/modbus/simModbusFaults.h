/* simModbusFaults: what goes wrong on purpose, for which requests, how often. It decides;
 * simModbus does it.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simModbusFaults_H
#define INC_simModbusFaults_H

#include "simModbusAnswer.h"

#define SIM_MODBUS_RULES 64

typedef enum simModbusFault {
    simFaultException, /* number: the code */
    simFaultSlow,      /* number: ms */
    simFaultSilent,
    simFaultWrongUnit,
    simFaultWrongId,
    simFaultShort,   /* number: bytes that leave */
    simFaultClose,   /* half of the answer, then the end */
    simFaultGarbage, /* number: random bytes instead of the answer */
    SIM_MODBUS_FAULTS
} simModbusFault;

/* A fault, and the requests that it meets. */
typedef struct simModbusRule {
    simModbusFault fault;
    unsigned long number;
    int close;               /* short: the connection ends behind it */
    int reads, writes;       /* which requests; both 0 = all */
    unsigned function;       /* 0 = all */
    simTable table;          /* simNoTable = all */
    unsigned start, count;   /* count 0 = the whole table */
    unsigned long remaining; /* requests; 0 = always */
} simModbusRule;

typedef struct simModbusFaults {
    simModbusRule rules[SIM_MODBUS_RULES]; /* oldest first */
    size_t count;
} simModbusFaults;

/* What happens to one request. */
typedef struct simModbusFate {
    int silent;    /* not served, not answered */
    int exception; /* answered with this code, not served; 0 = none */
    double delay;  /* s that the answer leaves late */
    int wrongUnit, wrongId;
    int half;     /* half of the answer leaves, then the connection ends */
    long shorten; /* only so many bytes of the answer leave, -1 = all */
    int close;    /* then the connection ends, else it is mute */
    long garbage; /* so many random bytes instead of the answer, -1 = none */
} simModbusFate;

/* Adds a rule from words such as "exception 2 holding 17 write next 3", or ends faults
 * ("silent off"). Returns 0, or -1 with the reason in error. */
int simModbusFaultParse(simModbusFaults *faults, char **words, size_t count,
                        char error[SIM_ERROR_SIZE]);
/* True when this word is the name of a fault. */
int simModbusFaultKnown(const char *word);
void simModbusFaultsClear(simModbusFaults *faults);

/* What meets this request; counts it for the rules that have a number of requests. */
void simModbusFaultsMeet(simModbusFaults *faults, const simRequest *request,
                         simModbusFate *fate);

/* Adds " exception=2,write,holding=17..17,next=3", one for each rule, or " none". */
void simModbusFaultsText(const simModbusFaults *faults, simText *out);

#endif
