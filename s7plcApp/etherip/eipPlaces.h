/* The places of the tags of one PLC in its images: who wants the same of a tag shares a place.
 *
 * Knows wishes, no records and no stations. Any thread; none blocks.
 */
#ifndef INC_eipPlaces_H
#define INC_eipPlaces_H

#include "eipTags.h"
#include "plcFaults.h"

typedef struct eipPlaces eipPlaces;
typedef struct eipPlace eipPlace;

/* In images of `size` bytes. */
eipPlaces *eipPlacesCreate(size_t size);
void eipPlacesDestroy(eipPlaces *places);

/* A place for this wish (its tag is copied, its place and room are looked up; `room` is that
 * of a text place, else it is known), read every `period` ms, and written where `output` is
 * set. The same wish has the same place for ever. Returns NULL when the images have no room
 * left. */
eipPlace *eipPlacesGet(eipPlaces *places, const eipWant *wish, unsigned period, int output);

/* No longer wanted, by one who got it so. */
void eipPlacesLeave(eipPlaces *places, eipPlace *place, unsigned period, int output);

size_t eipPlaceOffset(const eipPlace *place); /* bytes */
size_t eipPlaceRoom(const eipPlace *place);   /* bytes */

/* Bytes of the images that are in use. */
size_t eipPlacesUsed(eipPlaces *places);

/* How many of the places that are wanted now are bad in these faults, and of how many; the first
 * with its reason: "TAG: no such tag". */
unsigned eipPlacesBad(eipPlaces *places, plcFaults *faults, unsigned *of, char *first, size_t size);

/* The tag of the place that has this byte, "a[1,2]", and where the place begins. Returns 0, or -1: no
 * place has it. */
int eipPlacesTag(eipPlaces *places, size_t offset, char *tag, size_t size, size_t *place);

/* All that is wanted now, allocated, with its texts. Returns 1 when it is another set than
 * the last time, or `always`; else 0. *used: bytes of the images. */
int eipPlacesWants(eipPlaces *places, int always, eipWant **wants, unsigned *count, size_t *used);

#endif /* INC_eipPlaces_H */
