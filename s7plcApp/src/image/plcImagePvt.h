/* Inside of plcImage; only for plcImage*.c and the unit test.
 *
 * Output, the reason, and which buffer of input is seen: one mutex, held for a copy of at most
 * the block and for nothing else.
 */
#ifndef INC_plcImagePvt_H
#define INC_plcImagePvt_H

#include <epicsMutex.h>

#include "plcImage.h"
#include "plcPuts.h"

typedef size_t word;

#define WORD sizeof(word)
#define WORDS(size) (((size) + WORD - 1) / WORD)
#define STAMP_WORDS WORDS(sizeof(epicsTimeStamp))

struct plcImage {
    word *words[2]; /* atomic; the stamp of the block, then its bytes */
    word blocks;    /* atomic */
    int valid;      /* atomic */
    size_t size;    /* atomic, written with the lock held, by the thread that publishes */
    int dirty;      /* atomic; changed while the lock is held */
    epicsMutexId lock; /* guards the rest */
    int closed;                   /* writes are refused */
    size_t takes;                 /* how often the output was taken */
    char reason[PLC_REASON_SIZE]; /* "" when valid */
    plcPuts *puts;       /* what was written and has not left; NULL: not kept */
    plcPuts *edges;      /* puts that wait for the next take; NULL: none ever does */
    int away;            /* nobody takes: none waits */
    epicsUInt8 *batch;   /* edges: room for a mask as large as the image */
    epicsUInt8 *ours;    /* bits ever written, and not set since */
    int allEdges;        /* every value is to leave, not only of single bits */
};

/* The bytes that others see. By the thread that publishes, or with the lock held. */
static inline epicsUInt8 *plcImageSeen(const plcImage *image)
{
    return (epicsUInt8 *)(image->words[image->blocks & 1] + STAMP_WORDS);
}

#endif /* INC_plcImagePvt_H */
