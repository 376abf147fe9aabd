/* How a station reads blocks off a connection: the table of functions by which it knows where
 * blocks begin and end without knowing how that is found out.
 *
 * For a wire without a worker; see plcTransport.h for the others. All functions run in the
 * station's thread; none waits, and none calls the station.
 */
#ifndef INC_plcReader_H
#define INC_plcReader_H

#include <stddef.h>

#include <epicsTypes.h>

#include "plcConnection.h"

/* What has come. */
typedef struct plcCame {
    size_t count;      /* whole blocks since the last call that may be used */
    const void *block; /* the newest of them, until the next call; NULL with count 0 */
    int wrong;         /* the size of the blocks is wrong, or they begin elsewhere (burst is
                        * the size then): the connection is to be made anew */
    size_t burst;      /* bytes that come at a time, when that is not the size of a block; 0: no
                        * sign of it, or (wrong) no constant size at all */
    unsigned doubts;   /* whether a block began where it should, since the connection is up */
    int more;          /* there may be more bytes to read */
} plcCame;

typedef struct plcReader {
    /* For blocks of blockSize bytes; 0: everything that comes is dropped. */
    void *(*create)(size_t blockSize);
    void (*destroy)(void *pvt);

    /* A new connection: what came before is forgotten. */
    void (*up)(void *pvt);

    /* Reads what is there. Returns the bytes read, 0: none, or -1 when the connection is lost,
     * as plcConnectionReceive, with *came. */
    int (*receive)(void *pvt, plcConnection *c, epicsUInt64 now, plcCame *came);

    /* Blocks came, and none could be used for too long: a doubt becomes `wrong`. */
    void (*giveUp)(void *pvt, plcCame *came);
} plcReader;

#endif /* INC_plcReader_H */
