/* The arguments of the configure commands, from text to a station. */
#ifndef INC_plcConfigure_H
#define INC_plcConfigure_H

#include "plcStation.h"

/* args: PLCname, IPaddr, port, inSize, outSize, bigEndian, recvTimeout, sendInterval as the
 * user typed them, NULL where missing. IPaddr may be "first,second" for a policy with two
 * connections; with one address and two connections the second is IPaddr+1.
 * Returns the station; or NULL after one error line, which begins with `command`. */
plcStation *plcConfigure(const char *command, const char *const args[8],
                         const plcPolicy *policy, void *policyPvt);

/* modbusplcConfigure. args: PLCname, IPaddr, port, unit, inputs, outputs, requestTimeout.
 * Returns as above. */
plcStation *plcConfigureModbus(const char *command, const char *const args[7]);

/* s7plcModbusOutput. args: PLCname, IPaddr, port, unit, startRegister. Returns 0, or -1
 * after one error line. */
int plcConfigureModbusOutput(const char *command, const char *const args[5]);

#endif /* INC_plcConfigure_H */
