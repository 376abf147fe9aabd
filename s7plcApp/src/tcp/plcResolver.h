/* Host names become addresses without anyone waiting: a look-up runs in a thread of its
 * own, which may take as long as DNS likes. A dotted address needs no thread.
 *
 * Knows nothing of stations or connections.
 */
#ifndef INC_plcResolver_H
#define INC_plcResolver_H

#include <stddef.h>

#include <osiSock.h>

typedef struct plcResolver plcResolver;

/* `host` is a dotted address or a name; `plus` is added to the address found (a redundant
 * pair: IPaddr+1). wake(arg) is called from the look-up's thread when there is news. */
plcResolver *plcResolverCreate(const char *host, unsigned plus, void (*wake)(void *arg),
                               void *arg);

/* The caller wants no more news; a look-up that still runs cleans up after itself. */
void plcResolverRelease(plcResolver *resolver);

/* Asks for the address. Returns 1 and the address (network byte order) when it is known,
 * be it from an earlier look-up; 0 while the first look-up runs; -1 with the reason when
 * it failed. Starts a look-up in the background when `refresh` is set. */
int plcResolverAddress(plcResolver *resolver, int refresh, struct in_addr *address,
                       char *error, size_t size);

/* True for "", a name of 1 to 255 letters, digits and . - _, and an IPv4 address of four decimal
 * numbers. What resolvers take for another address is none: 192.168.1 is 192.168.0.1 to them,
 * 0300.1.1.1 is 192.1.1.1. Whether the host exists is not asked. Any thread. */
int plcAddressIsHost(const char *host);
#define PLC_HOST_ALLOWED "host name or dotted IP address (four numbers)"

/* Adds `plus` to the last byte of the address. Returns 0, or -1 when that leaves 1..254. */
int plcAddressPlus(struct in_addr *address, unsigned plus);

#endif /* INC_plcResolver_H */
