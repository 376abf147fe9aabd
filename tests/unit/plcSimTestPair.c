/* plcSimTestPair: who leads in the simulator's pair, as a table.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <epicsUnitTest.h>
#include <testMain.h>

#include "simPair.h"

static const struct {
    const char *what;
    /* me: first primary net ready split   partner: heard primary net ready
     * since partnerSince   vacant switchover */
    simPairView view;
    int lead;
} rows[] = {
    {"PRIMARY, BACKUP well: stays", {1, 1, 1, 1, 0, 1, 0, 1, 1, 1, 2, 0, 0.5}, 1},
    {"BACKUP, PRIMARY well: stays BACKUP", {0, 0, 1, 1, 0, 1, 1, 1, 1, 2, 1, 0, 0.5}, 0},
    {"PRIMARY loses its network, partner has one: yields",
     {1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 2, 0, 0.5}, 0},
    {"PRIMARY loses its network, partner has none: stays",
     {1, 1, 0, 1, 0, 1, 0, 0, 1, 1, 2, 0, 0.5}, 1},
    {"PRIMARY loses its network, partner silent: stays",
     {1, 1, 0, 1, 0, 0, 0, 1, 1, 1, 2, 0, 0.5}, 1},
    {"PRIMARY, partner silent: stays", {1, 1, 1, 1, 0, 0, 0, 0, 0, 1, 2, 9, 0.5}, 1},
    {"SECOND after FIRST yielded, too early", {0, 0, 1, 1, 0, 1, 0, 0, 1, 1, 2, 0.49, 0.5}, 0},
    {"SECOND after FIRST yielded, in time", {0, 0, 1, 1, 0, 1, 0, 0, 1, 1, 2, 0.5, 0.5}, 1},
    {"BACKUP, partner silent, too early", {0, 0, 1, 1, 0, 0, 1, 1, 1, 1, 2, 0.49, 0.5}, 0},
    {"BACKUP, partner silent, in time", {0, 0, 1, 1, 0, 0, 1, 1, 1, 1, 2, 0.5, 0.5}, 1},
    {"BACKUP without network, partner silent", {0, 0, 0, 1, 0, 0, 1, 1, 1, 1, 2, 9, 0.5}, 1},
    {"BACKUP without network, partner has one and leads not",
     {1, 0, 0, 1, 0, 1, 0, 1, 1, 1, 2, 9, 0.5}, 0},
    {"both new, FIRST leads", {1, 0, 1, 0, 0, 1, 0, 1, 0, 1, 1, 0.5, 0.5}, 1},
    {"both new, SECOND waits for FIRST", {0, 0, 1, 0, 0, 1, 0, 1, 0, 1, 1, 9, 0.5}, 0},
    {"FIRST restarted, SECOND has the memory: FIRST waits",
     {1, 0, 1, 0, 0, 1, 0, 1, 1, 1, 1, 9, 0.5}, 0},
    {"FIRST restarted, SECOND has the memory: SECOND leads",
     {0, 0, 1, 1, 0, 1, 0, 1, 0, 1, 1, 0.5, 0.5}, 1},
    {"two lead, I have led longer: stays", {0, 1, 1, 1, 0, 1, 1, 1, 1, 1, 2, 0, 0.5}, 1},
    {"two lead, the partner has led longer: yields", {1, 1, 1, 1, 0, 1, 1, 1, 1, 2, 1, 0, 0.5}, 0},
    {"two lead since the same moment: FIRST stays", {1, 1, 1, 1, 0, 1, 1, 1, 1, 1, 1, 0, 0.5}, 1},
    {"two lead since the same moment: SECOND yields", {0, 1, 1, 1, 0, 1, 1, 1, 1, 1, 1, 0, 0.5}, 0},
    {"two lead, only I have a network: stays", {1, 1, 1, 1, 0, 1, 1, 0, 1, 2, 1, 0, 0.5}, 1},
    {"two lead, only the partner has one: yields", {1, 1, 0, 1, 0, 1, 1, 1, 1, 1, 2, 0, 0.5}, 0},
    {"twoprimaries: leads whatever the partner does", {0, 0, 1, 1, 1, 1, 1, 1, 1, 2, 1, 0, 0.5}, 1},
};

/* Two halves that hear each other never both lead and, after the wait, one of them does. */
static void testBothViews(void)
{
    int bits, both = 0, none = 0;

    for (bits = 0; bits < 16; bits++) {
        simPairView a = {1, 0, bits & 1, bits >> 1 & 1, 0, 1, 0, 0, 0, 1, 1, 9, 0.5};
        simPairView b = {0, 0, bits >> 2 & 1, bits >> 3 & 1, 0, 1, 0, 0, 0, 1, 1, 9, 0.5};
        int leads;

        a.partnerNet = b.net;
        a.partnerReady = b.ready;
        b.partnerNet = a.net;
        b.partnerReady = a.ready;
        leads = simPairDecide(&a) + simPairDecide(&b);
        both += leads == 2;
        none += leads == 0;
    }
    testOk(both == 0, "of two BACKUPs never both take over");
    testOk(none == 0, "of two BACKUPs always one takes over");
}

MAIN(plcSimTestPair)
{
    size_t i;

    testPlan(23 + 2);
    for (i = 0; i < sizeof(rows) / sizeof(rows[0]); i++)
        testOk(simPairDecide(&rows[i].view) == rows[i].lead, "%s", rows[i].what);
    testBothViews();
    return testDone();
}
