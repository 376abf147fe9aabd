/* The text of an INP or OUT link of DTYP "EtherIP" taken apart:
 *
 *     @PLC tag [E] [S seconds] [B bit] [FORCE] [PLC_ERRORS ...]
 *
 * as ether_ip has it, its words separated by blanks. Knows no PLCs and no records. Pure.
 */
#ifndef INC_eipLink_H
#define INC_eipLink_H

#include "eipName.h"

/* The words that stand for a statistic of the period of a link. */
typedef enum {
    eipNoStatistic,
    eipPlcErrors,
    eipPlcTaskSlow,
    eipListErrors,
    eipListTicks,
    eipListTime,
    eipListScanTime,
    eipListMinScanTime,
    eipListMaxScanTime,
    eipTagTransferTime
} eipStatistic;

enum { eipPlcNameMax = 255 };

typedef struct eipLink {
    char plc[eipPlcNameMax + 1];
    char tag[eipNameMax + 16]; /* base text, indices but the last one in it */
    int hasIndex;
    epicsUInt32 index;         /* the last index; 0: none */
    int indexed;               /* of several: it always stands in the path */
    int alone;                 /* E */
    double period;             /* S, in seconds; 0: not given */
    int bit;                   /* B, or tag.5; -1: not given */
    int force;                 /* FORCE */
    eipStatistic statistic;
    char doubt[60];            /* what is odd about it but taken, as ether_ip takes it; "": nothing */
} eipLink;

/* The word that stands for it. */
const char *eipStatisticWord(eipStatistic statistic);

/* Returns 0; or -1 with the message in error, and *column where it is. */
int eipLinkParse(const char *text, eipLink *link, size_t *column, char *error, size_t size);

#endif /* INC_eipLink_H */
