/* simPair: one half of a redundant pair: who leads, and memory kept in step.
 *
 * FIRST and SECOND are the names that never change; PRIMARY and BACKUP are the roles that
 * do. Only the PRIMARY sends and takes blocks. The PRIMARY's memory is copied to the
 * BACKUP after every change. The halves tell each other their state through the fibre; a
 * BACKUP that has seen no PRIMARY for the switch-over time takes over.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simPair_H
#define INC_simPair_H

#include "simFibre.h"
#include "simPlc.h"

/* All that the decision needs. */
typedef struct simPairView {
    int isFirst;
    int isPrimary;
    int net;   /* the network cable is plugged */
    int ready; /* has the memory of the last PRIMARY */
    int split; /* fault: leads without asking */
    int heard; /* the partner is alive; what follows is valid */
    int partnerPrimary, partnerNet, partnerReady;
    double since, partnerSince; /* s, simNow() scale: in this role */
    double vacant;              /* s since a PRIMARY was last seen */
    double switchover;          /* s */
} simPairView;

/* Who leads: 1 = PRIMARY, 0 = BACKUP. A pure function. */
int simPairDecide(const simPairView *view);

typedef struct simPair {
    simLoop *loop;
    simPlc *plc;
    simFibre fibre;
    int isFirst, isPrimary, net, ready, split, off;
    char interface[32]; /* watched for its cable, empty = none */
    double switchover;  /* s */
    double since;       /* s: in this role */
    double primarySeen; /* s: when a PRIMARY was last there */
    double heardTime;   /* s: when the partner was last heard */
    int partnerPrimary, partnerNet, partnerReady;
    double partnerSince;
    epicsUInt8 **shadows; /* what the partner has of each block, NULL = unknown */
    size_t shadowCount;
    simTimer tick;
    double nextTick; /* s: when it should fire */
    unsigned takeovers;
} simPair;

/* Joins a PLC that is built but not started to its fibre end. `wait` is the time in s
 * that it waits for a PRIMARY at start before it leads. */
void simPairInit(simPair *pair, simLoop *loop, simPlc *plc, int isFirst,
                 double switchover, double wait, const char *interface);
/* After the fibre is joined or opened. */
void simPairStart(simPair *pair);
void simPairStop(simPair *pair);
/* Looks at everything again, now: called after each console command. */
void simPairPoll(simPair *pair);
/* The PRIMARY hands over at once. Returns -1 with a reason when it cannot. */
int simPairSwitch(simPair *pair, char error[SIM_ERROR_SIZE]);
/* Fault: the fibre is cut and both lead. */
void simPairSplit(simPair *pair, int on);
void simPairStatus(const simPair *pair, simText *out);

#endif
