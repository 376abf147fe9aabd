/* One TCP socket on which frames go out and come in: a question, its one answer, one deadline
 * for both.
 *
 * Knows how long a frame is; nothing of what it means. It waits: only for threads that may.
 */
#ifndef INC_eipSocket_H
#define INC_eipSocket_H

#include <osiSock.h>

#include "eipFrame.h"

typedef struct eipSocket {
    SOCKET fd;            /* INVALID_SOCKET: none */
    epicsUInt8 *buffer;   /* of eipFrameMax bytes: the answer */
} eipSocket;

typedef enum { eipAnswered, eipTooLate, eipBroken } eipOutcome;

void eipSocketInit(eipSocket *s);
void eipSocketFree(eipSocket *s); /* closes it, too */

/* Uses this socket from now on, which is up; the one before is closed. */
void eipSocketUse(eipSocket *s, SOCKET fd);
void eipSocketClose(eipSocket *s);

/* Connects. Returns 0; or -1 with the reason, after `ms` at most (and what a host name
 * takes). */
int eipSocketConnect(eipSocket *s, const char *host, unsigned port, unsigned ms, char *why,
                     size_t size);

/* Sends a frame and waits for the one that answers it, not longer than `ms`. *length are its
 * bytes in s->buffer. eipBroken: `why` says it; bytes that nobody asked for are a reason, too.
 */
eipOutcome eipSocketAsk(eipSocket *s, const void *frame, size_t n, unsigned ms,
                        size_t *length, char *why, size_t size);

/* Sends a frame whose answer does not matter. */
void eipSocketTell(eipSocket *s, const void *frame, size_t n);

/* Has the PLC closed it, or sent what nobody asked for? Does not wait. Returns 1 and why. */
int eipSocketBroken(eipSocket *s, char *why, size_t size);

#endif /* INC_eipSocket_H */
