/* simEipTags: the named tags of a controller and where their bytes lie. It does not know
 * requests.
 *
 *   tag <name> <type> [-> <address>] [readonly|hidden] [= <value> ... | <signal> ...]
 *
 * A tag lies in PLC memory at <address>, or has bytes of its own. Bytes are in the order
 * of the wire: little-endian. A name "Program:Main.Speed" lies in the scope of a program.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simEipTags_H
#define INC_simEipTags_H

#include "simEipPath.h"
#include "simEipTypes.h"
#include "simMemory.h"

#define SIM_EIP_TAGS 16000 /* instance ids have 16 bits */
#define SIM_EIP_FULL_NAME (2 * SIM_EIP_NAME + 10)

/* General status of CIP that this file gives. */
#define EIP_PATH_SYNTAX 0x04 /* and a name that is not known */
#define EIP_PATH_UNKNOWN 0x05

/* As attribute 10 tells it. */
typedef enum simEipAccess {
    eipReadWrite = 0,
    eipReadOnly = 2,
    eipNoAccess = 3
} simEipAccess;

typedef struct simEipTag {
    char name[SIM_EIP_FULL_NAME]; /* with its program */
    char key[SIM_EIP_FULL_NAME];  /* the same in lower case, for the hash */
    size_t scope;                 /* characters of "Program:Main." in front, 0 = none */
    const simEipType *type;       /* NULL: an entry of the list that is no tag */
    unsigned word;                /* such an entry's type word */
    unsigned dims[3];             /* 0 = not there */
    int dimCount;
    size_t elements; /* of the array, 1 = no array */
    simEipAccess access;
    simBlock own;    /* bytes of its own, or none */
    simBlock *block; /* where it lies */
    size_t offset;   /* bytes in it */
    int moves;       /* a signal moves it */
    char **initial;  /* values of the file, for a cold restart */
    size_t initialCount;
    size_t order; /* of definition: makes the instance id */
} simEipTag;

typedef struct simEipTags {
    simEipTypes *types;
    simMemory *memory;
    simEipTag **list; /* in the order of their instance ids */
    size_t count;
    struct gphPvt *names; /* lower case -> tag */
    unsigned generation;  /* downloads */
    unsigned shifts;      /* downloads after which an old id means another tag */
} simEipTags;

/* types and memory must outlive it. */
void simEipTagsInit(simEipTags *tags, simEipTypes *types, simMemory *memory);
void simEipTagsFree(simEipTags *tags);

/* Reads the words behind "tag" up to "=" or a signal; *used says how many. Returns the
 * tag, or NULL with the reason in error. */
simEipTag *simEipTagAdd(simEipTags *tags, char **words, size_t count, size_t *used,
                        char error[SIM_ERROR_SIZE]);
/* An entry of the tag list that is no tag: "Task:MainTask". */
void simEipTagsEntry(simEipTags *tags, const char *name, unsigned word);
/* Returns 0, or -1 when there is no such tag. */
int simEipTagRemove(simEipTags *tags, const char *name);
/* Out of the list, and back to its place in it; between both it is the caller's to free. */
simEipTag *simEipTagTake(simEipTags *tags, const char *name); /* NULL: there is none */
void simEipTagPutBack(simEipTags *tags, simEipTag *tag);
void simEipTagFree(simEipTag *tag);
simEipTag *simEipTagFind(const simEipTags *tags, const char *name);

epicsUInt8 *simEipTagBytes(const simEipTag *tag);
size_t simEipTagSize(const simEipTag *tag);      /* bytes */
const char *simEipTagName(const simEipTag *tag); /* without its program */

/* Instance in class 6B. It changes with each download. */
unsigned simEipTagId(const simEipTags *tags, const simEipTag *tag);
simEipTag *simEipTagById(const simEipTags *tags, unsigned id);
/* A download: all ids are others; with `shift` an old one means another tag. */
void simEipTagsDownload(simEipTags *tags, int shift);

/* What a path leads to. */
typedef struct simEipPlace {
    simEipTag *tag;
    const simEipType *type;
    epicsUInt8 *bytes;
    int bit;         /* BOOL in a structure: 0 ... 7, else -1 */
    size_t elements; /* from here to the end of the array; 1 where there is none */
    int isArray;     /* a whole array is named, or one element of it */
    int isElement;   /* one element is named */
} simEipPlace;

/* Follows a path of names, or of class 6B and instance. Returns a general status: 0,
 * EIP_PATH_SYNTAX or EIP_PATH_UNKNOWN. */
int simEipTagsResolve(const simEipTags *tags, const simEipPath *path, simEipPlace *place);
/* The same for text: "a.b[2].c", "Program:Main.x". Returns 0, or -1 with the reason. */
int simEipTagsPlace(const simEipTags *tags, const char *text, simEipPlace *place,
                    char error[SIM_ERROR_SIZE]);

#endif
