/* The arguments of s7plcConfigure and phoenixplcConfigure, from text to a station. */
#ifndef INC_plcConfigure_H
#define INC_plcConfigure_H

#include "plcStation.h"

/* args: PLCname, IPaddr, port, inSize, outSize, bigEndian, recvTimeout, sendInterval as the
 * user typed them, NULL where missing. IPaddr may be "first,second" for a policy with two
 * connections; with one address and two connections the second is IPaddr+1.
 * Returns the station; or NULL after one error line, which begins with `command`. */
plcStation *plcConfigure(const char *command, const char *const args[8],
                         const plcPolicy *policy, void *policyPvt);

#endif /* INC_plcConfigure_H */
