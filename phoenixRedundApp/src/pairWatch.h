/* Is there anybody? Asks the hosts of a pair by ICMP echo, in a thread of its own.
 *
 * Knows addresses, not roles, blocks or records. It asks in the first of these ways that
 * the machine allows: an ICMP datagram socket (needs no privilege where the kernel's
 * net.ipv4.ping_group_range allows it), a raw socket (root), the command `ping`.
 */
#ifndef INC_pairWatch_H
#define INC_pairWatch_H

#include <osiSock.h>

#include "plcPolicy.h"

typedef struct pairWatch pairWatch;

enum { pairWatchDatagram = 1, pairWatchRaw = 2, pairWatchCommand = 4, pairWatchAny = 7 };

/* Host `which` was found to answer (1) or not (0), or it cannot be asked (-1). Called in
 * the thread of the watch after each question, with no lock held. */
typedef void pairWatchNews(void *pvt, unsigned which, int answers);

/* Starts the thread; it asks when it knows hosts and a period. `ways` is a set of
 * pairWatchDatagram ...; a machine that allows none of them brings no news. Returns NULL when
 * there is no thread or no descriptor for it; the functions below take that, and do nothing. */
pairWatch *pairWatchCreate(unsigned ways, pairWatchNews *news, void *pvt);

/* Ends and joins the thread. No news after that. */
void pairWatchDestroy(pairWatch *watch);

/* The rest may be called from any thread and does not block. */

/* From now on `which` is this host (network byte order). */
void pairWatchHost(pairWatch *watch, unsigned which, struct in_addr host);

/* ms from question to question, 0: never ask. An answer has 0.4 of it, 400 ms at most. */
void pairWatchPeriod(pairWatch *watch, double ms);

/* Ask this one now. */
void pairWatchNow(pairWatch *watch, unsigned which);

/* "ICMP datagram socket", "raw ICMP socket", "ping command", "nothing" */
const char *pairWatchWay(pairWatch *watch);

#endif /* INC_pairWatch_H */
