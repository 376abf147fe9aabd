/* How a station and its PLC exchange values over a wire: the table of functions by which the core
 * knows a transport without knowing what it is.
 *
 * The station connects, waits before it tries again, logs, and decides what may leave and when. Of
 * two kinds a transport is one:
 *   - It reads and writes blocks on the socket in the station's thread, without waiting: `receive`,
 *     `send`.
 *   - It has a thread of its own, its worker, which gets the connected socket and may wait for the
 *     PLC: `news`, `put`. Station and worker meet in a mailbox: the station fetches what there is
 *     to tell, and hands over what records have put.
 * No transport calls the station, but for `wake`.
 *
 * Functions run in the station's thread unless they say otherwise. None blocks, but for destroy,
 * which joins the worker.
 */
#ifndef INC_plcTransport_H
#define INC_plcTransport_H

#include <stdio.h>

#include <epicsTime.h>
#include <epicsTypes.h>
#include <osiSock.h>

#include "plcConnection.h"
#include "plcFaults.h"
#include "plcImage.h"

struct plcOptions;
struct plcStats;

/* What has happened since it was last asked. */
typedef struct plcNews {
    int opened;                /* with `opens`: the PLC has answered, and is connected from now on */
    int lost;                  /* the socket is of no use any more, because: */
    char why[PLC_REASON_SIZE]; /* "no answer for 1.0 s", "connection closed by PLC" */
    unsigned blocks;           /* how often the input image was filled anew */
    epicsTimeStamp stamp;      /* when the newest was complete */
    int shown;                 /* 1: it is known what the PLC holds of the output image; for
                                * what is ordered meanwhile, that. Without outputs, 1 at
                                * connect */
    char unread[PLC_REASON_SIZE]; /* "": or why the PLC does not show its outputs (news when
                                   * this begins or changes). shown is 0 then, or the PLC
                                   * shows some of them: `hidden` says which it does not */
    int inFaults, outFaults;   /* 1: something changed in these */
    char log[PLC_REASON_SIZE + 260]; /* a line for the log, "": none. Transitions only */
    size_t at, room;           /* with log: the place in the images that it is about; room 0: none */
    int idle;                  /* without takesPuts: all puts are through (or refused) */
    /* counts since the last call */
    unsigned requests, exceptions, timeouts;
    epicsUInt64 bytesIn, bytesOut; /* of requests and answers, with their headers */
    unsigned writes;           /* write requests that were acknowledged; no heartbeat */
    double latency;            /* ms, last request; 0: none */
    double latencyMax;         /* ms */
} plcNews;

/* What has come on a connection. */
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

/* What a transport is made of, beside its own setup. */
typedef struct plcTransportSetup {
    const char *name;        /* of the PLC; stays where it is */
    int bigEndian;           /* byte order of 16-bit words in both images; 1: MSB first */
    size_t inSize;           /* bytes of the input image; 0: input comes by another way */
    plcImage *out;           /* the output image, which keeps its puts; outSize bytes */
    size_t outSize;
    plcFaults *inFaults;     /* where refused reads are put down; NULL with inSize 0 */
    plcFaults *outFaults;    /* and refused or unanswered writes, bit by bit */
    void (*wake)(void *arg); /* there may be news: any thread; no lock is held */
    void *arg;
} plcTransportSetup;

typedef struct plcTransport {
    const char *name;   /* of the wire, for people; "" for blocks */
    const char *form;   /* of links where values have names: "DTYP \"X\", as in @PLC name"; else NULL */
    const char *prefix; /* the same and a blank: before log lines about its connection */

    /* What it can: */
    int syncs;     /* the handshake is in its blocks (option sync) */
    int shows;     /* on each connection it reads first what the PLC holds of the outputs: until
                    * then none leaves. And it tells which bits were refused (plcFaults) */
    int opens;     /* TCP leads to a door only: the PLC is connected when its worker says so. What
                    * goes wrong before then is an attempt that failed */
    int takesPuts; /* it takes puts out of the output image in their order until none is left
                    * (plcImageTakePuts, plcImagePutsDone), and each is acknowledged */

    /* Makes one for a connection of a PLC, when it is configured. `own` is the transport's own
     * setup, of which it makes a copy. No thread yet. */
    void *(*create)(const plcTransportSetup *setup, const void *own);
    void (*destroy)(void *pvt); /* ends and joins the worker, if there is one */

    /* --- In the station's thread; all NULL with a worker ----------------------------------- */

    /* A new connection: what came before is forgotten, and a block half sent. */
    void (*connected)(void *pvt, plcConnection *c);

    /* Reads what is there. Returns the bytes read, 0: none, or -1 when the connection is lost,
     * as plcConnectionReceive, with *came. */
    int (*receive)(void *pvt, plcConnection *c, epicsUInt64 now, plcCame *came);

    /* Blocks came, and none could be used for too long: a doubt becomes `wrong`. */
    void (*giveUp)(void *pvt, plcCame *came);

    /* Where the next block is made, while none is being sent; outSize bytes. */
    char *(*space)(void *pvt);

    /* Begins (begin=1) to send what is there, or goes on with it. Returns 1 when all of it is with
     * the kernel, 0 when some is left for later, -1 lost as plcConnectionSend. */
    int (*send)(void *pvt, plcConnection *c, int begin, epicsUInt64 now);

    /* 1 while a block is half sent. */
    int (*sending)(const void *pvt);

    /* --- By a worker ------------------------------------------------------------------------ */

    /* Before the thread of the station begins, also again after it ended / when it ends. */
    void (*begin)(void *pvt);
    void (*end)(void *pvt);

    /* So long it may go without any request, ms; 0: it need not make one. A worker that is
     * silent for longer, and for the requests that may be under way, is given up. */
    double (*pause)(void *pvt, const struct plcOptions *options);

    /* From the next request on. */
    void (*options)(void *pvt, const struct plcOptions *options);

    /* The socket is connected: begin. `wholeIn` and `wholeOut` (NULL: nothing is known) have
     * a byte for each byte of an image, not 0 where it belongs to the same value as the one
     * before: such a value is transferred as a whole. They are the station's. */
    void (*up)(void *pvt, SOCKET socket, const epicsUInt8 *wholeIn,
               const epicsUInt8 *wholeOut);
    /* Records have come or gone: what `up` was told of them is this now. May be NULL. */
    void (*whole)(void *pvt, const epicsUInt8 *wholeIn, const epicsUInt8 *wholeOut);
    /* The connection is to be given up: no news of it comes any more. */
    void (*down)(void *pvt);

    /* Images of which the first bytes only are in use: how many, of both; never less than before.
     * Images are as long, up to inSize and outSize. NULL: all of them. */
    size_t (*used)(void *pvt);

    /* May a value lie in these bytes of the input or output image? `mask` (NULL: all) has the bits
     * of them that it has. Returns 1, and a doubt or ""; or 0 with a line of what is wrong and what is
     * allowed, and in *fits how many bytes from `offset` on may be one value. NULL: anywhere. Any
     * thread. */
    int (*holds)(void *pvt, int output, size_t offset, size_t length, const void *mask,
                 size_t *fits, char *error, size_t errorSize);

    /* Fetches the news. *input and *output, as long as the images, are filled when blocks or
     * shown are not 0. Returns 0 when there is none. */
    int (*news)(void *pvt, plcNews *news, void *input, void *output);

    /* Fills *mask, as long as the output image, with the bits that the PLC did not show when it
     * was last shown; those in *output are of no meaning. Returns 1 when there are any. NULL: it
     * shows all or none. */
    int (*hidden)(void *pvt, void *mask);

    /* How old what was shown last is: all puts up to *through were through by then
     * (plcImagePutsThrough), and fills *older, as long as the output image, with the bits that
     * were not read since a put of them was. NULL: that is not known. */
    void (*age)(void *pvt, epicsUInt64 *through, void *older);

    /* How many places of the input (registers, bits, tags) the PLC refuses to show now, and of how
     * many; which comes first, and why: "holding 4 to 7: exception 2, illegal data address".
     * NULL: it is not known. */
    unsigned (*refused)(void *pvt, unsigned *of, char *first, size_t size);

    /* With takesPuts: there are puts in the output image; image and mask are NULL. Without: puts
     * are the bits of `image` that are set in `mask`, both outSize bytes. They join what was
     * handed over before and has not left. */
    void (*put)(void *pvt, const void *image, const void *mask);

    /* For people: what stands at this offset of `image`, the input or output image, where records
     * name it and the type of a record does not tell: "Tank.Level REAL", and of a number its value,
     * else "". Any thread. NULL: it tells. */
    void (*tells)(void *pvt, const void *image, size_t offset, char *what, size_t whatSize,
                  char *value, size_t valueSize);

    /* Lines for s7plcReport: `where` is "host:port", `state` "connected" or why not. Any
     * thread. */
    void (*report)(void *pvt, const char *where, const char *state,
                   const struct plcStats *stats, FILE *file);
} plcTransport;

#endif /* INC_plcTransport_H */
