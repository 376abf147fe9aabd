/* The tags of one PLC: what somebody wants of them and where it goes in the image, what is
 * known of them, and how they are read.
 *
 * Knows no sockets, no clock, no records. Pure; one thread at a time.
 *
 * Each wish has a place in the input image, and the same one in the output image:
 *
 *     cell    0 type code  2 kind  3 size  4 -          8 number: integer of 64 bits, or
 *                                                         double, little-endian   16
 *     text    0 type code  2 kind  3 -     4 length     8 characters ...
 *     array   0 type code  2 kind  3 size  4 elements   8 elements as the PLC has them ...
 *
 * so that who reads a place gets value and type of one and the same moment. In the output
 * image `kind` says what the number is; the PLC's type is looked up when it is written.
 */
#ifndef INC_eipTags_H
#define INC_eipTags_H

#include "eipBrowse.h"
#include "eipName.h"
#include "eipPlan.h"
#include "eipType.h"

enum {
    eipRetryMs = 10000, /* until what was refused is asked for again */
    eipPlaceHead = 8,
    eipPlaceKindAt = 2,
    eipPlaceSizeAt = 3,
    eipPlaceCountAt = 4,
    eipCellSize = 16, /* bytes of a cell */
    eipReasonSize = 40
};

typedef enum { eipCell, eipTextPlace, eipArrayPlace } eipPlaceKind;

typedef struct eipWant {
    char *tag;           /* base text (eipName); the inner indices stand in it */
    epicsUInt32 index;   /* of the first element; 0 where the tag has none */
    epicsUInt32 count;   /* elements: of an array place; else 1 */
    int alone;           /* reads no other elements with it */
    eipPlaceKind kind;
    unsigned period;     /* ms */
    size_t place, room;  /* bytes in both images */
    int refused;         /* by itself, the last time: it is asked for seldom, and alone */
    int fresh;           /* what stands in its place is of nobody */
    int indexed;         /* the element always stands in the path: more than one dimension */
    int shared;          /* several outputs have this place */
    int element;         /* its link names an element */
} eipWant;

typedef enum { eipTagNew, eipTagKnown, eipTagBad } eipTagState;

/* One base text, with the wishes for its elements. */
typedef struct eipTag {
    const char *base;      /* that of its first wish */
    int alone, indexed;
    int array;             /* elements of it are wanted */
    unsigned from, wants;  /* its wishes, sorted by index */
    unsigned period;       /* ms, the fastest of them */
    eipTagState state;
    char reason[eipReasonSize]; /* why it is bad */
    epicsUInt64 retry;     /* when to ask again for a bad one, ns */
    unsigned code, handle; /* of an element */
    unsigned size;         /* bytes of an element; of a string that has no fixed size those
                            * of the last one */
    epicsUInt32 elements;  /* as listed; 0: not known */
    epicsUInt32 instance;  /* as listed; 0: not known */
    unsigned template;     /* of the root's structure, 0: none or not known */
    unsigned characters;   /* that a string has room for, 0: not known */
    int plain;             /* a structure that is no string, as its template shows */
    int apart;             /* the PLC does not show its structure whole */
} eipTag;

/* Is a structure a string? Only its template shows it. */
typedef enum { eipTextYes, eipTextNo, eipTextPerhaps } eipTextKind;

/* A part of what a message reads: where it goes. */
typedef struct eipPiece {
    unsigned want;
    epicsUInt32 offset; /* bytes in the data that was read */
    unsigned code, size; /* of an element */
    int bit;            /* of a BOOL in a byte; -1: none */
    eipTextKind text;   /* of a structure */
    unsigned characters; /* that it has room for as a string; 0: not known */
} eipPiece;

/* What one service reads. */
typedef struct eipUnit {
    unsigned tag;
    char *whole;         /* a structure that holds the pieces, NULL: elements of the tag */
    unsigned handle;     /* of that structure */
    epicsUInt32 first, count; /* elements */
    unsigned size;       /* bytes of an element */
    unsigned from, pieces;
    unsigned period;     /* ms */
    int refused;         /* a wish by itself that the PLC refused */
} eipUnit;

typedef struct eipTags {
    eipWant *wants; /* sorted by tag, alone, index */
    unsigned wantCount;
    eipTag *tags;   /* sorted by base, alone */
    unsigned tagCount;
    eipUnit *units;
    unsigned unitCount, unitRoom;
    eipPiece *pieces;
    unsigned pieceCount, pieceRoom;
    unsigned unknown; /* tags that are new */
    eipTemplates *templates;
    int omron;      /* an array without an index is always the whole; no services for fragments */
    int byInstance; /* several in one message go by their instances, not by name */
} eipTags;

void eipTagsInit(eipTags *t);
void eipTagsFree(eipTags *t);

/* Takes the wishes over (they are allocated, as are their texts). What is known of tags that
 * were there before stays. All units are gone. */
void eipTagsSet(eipTags *t, eipWant *wants, unsigned count);

/* Its state, and with it the number of tags that are new. */
void eipTagSetState(eipTags *t, eipTag *tag, eipTagState state);

/* A new session, or a new program: nothing is known any more. */
void eipTagsForget(eipTags *t);

/* The tag whose root has this name, from *at on (0 at first): *at is moved on. -1: none. */
int eipTagsOfRoot(const eipTags *t, const char *root, size_t length, unsigned *at);

/* The list names a tag. Returns the number of tags that got to know something. */
unsigned eipTagsListed(eipTags *t, const eipSymbol *symbol, const char *program);

/* --- Reading ------------------------------------------------------------------------------ */

/* Makes the units of all tags that are known: runs of elements, and structures that are read
 * whole where that takes fewer bytes. */
void eipUnitsMake(eipTags *t);

/* A unit of several pieces was refused: two take its place. Returns 0 when it has but one. */
int eipUnitSplit(eipTags *t, unsigned unit);

/* The bytes of the service that reads it, and of its answer; by its instance, where that is
 * known, or by its name. */
eipLoad eipUnitLoad(const eipTags *t, const eipUnit *u, int byInstance);

/* Puts this service. `fragment`: read from this offset on, -1: in one piece. */
void eipUnitPut(eipWriter *w, const eipTags *t, const eipUnit *u, int byInstance, long fragment);

/* Puts the path of elements of a tag, from `index` on, by its name: after a download an instance
 * may be another tag. */
void eipTagPathPut(eipWriter *w, const eipTags *t, const eipTag *tag, epicsUInt32 index,
                   int service);

/* The bytes of that path. */
unsigned eipTagPathBytes(const eipTags *t, const eipTag *tag, epicsUInt32 index);

/* Puts the question for its type: one element, by its name; and the bytes of its path. */
void eipTagAskPut(eipWriter *w, const eipTags *t, const eipTag *tag);
unsigned eipTagAskBytes(const eipTags *t, const eipTag *tag);

/* What an answer to a read begins with. */
typedef struct eipData {
    unsigned code, handle;
    const epicsUInt8 *bytes;
    size_t length;
} eipData;

/* Returns 0, or -1: no data of a type that is known. */
int eipDataTake(const eipAnswer *answer, eipData *data);

/* The answer to eipTagAskPut: the tag is known, or bad for a reason. */
void eipTagLearn(eipTags *t, eipTag *tag, const eipAnswer *answer);

/* Why a text or a structure is no value for an array record. */
extern const char eipNoArray[];

/* Stores a piece of data into the image. Returns NULL, or why it cannot be: for AMSG. */
const char *eipPieceStore(const eipTags *t, const eipPiece *piece, const epicsUInt8 *data,
                          size_t length, epicsUInt8 *image);

#endif /* INC_eipTags_H */
