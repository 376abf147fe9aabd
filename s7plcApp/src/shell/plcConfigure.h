/* The arguments of the configure commands, from text to a station. */
#ifndef INC_plcConfigure_H
#define INC_plcConfigure_H

#include "plcLink.h"
#include "plcStation.h"

/* args: PLCname, IPaddr, port, inSize, outSize, bigEndian, recvTimeout, sendInterval as the
 * user typed them, NULL where missing. IPaddr may be "first,second" for a policy with two
 * connections; with one address and two connections the second is IPaddr+1.
 * Returns the station; or NULL after one error line, which begins with `command`. */
plcStation *plcConfigure(const char *command, const char *const args[8],
                         const plcPolicy *policy, void *policyPvt);

/* --- For the commands of other transports -------------------------------------------------*/

/* A number among the arguments. A missing one has its initial value; where that is -1, it
 * must be given. A time is the option of the same name: without `allowed` that table says
 * what it may be. */
typedef struct plcNumberArg {
    const char *name;
    epicsInt32 initial, min, max;
    int zeroMeansInitial;
    const char *allowed; /* for the error line */
} plcNumberArg;

/* Writes the error line, which begins with `command` and the PLC's name. Returns NULL. */
plcStation *plcConfigureRefuse(const char *command, const char *name, const char *format, ...);

/* One line, when another station has a connection to the same host and port: that each makes its
 * own, and this advice. */
void plcConfigureSharing(const char *command, plcStation *station, const char *advice);

/* True for a name that a new station may have; else after the error line. */
int plcConfigureIsNew(const char *command, const char *name);

/* A whole number, or its initial value when text is NULL. Returns 0, or -1 after the error
 * line. */
int plcConfigureNumber(const char *command, const char *name, const plcNumberArg *arg,
                       const char *text, epicsInt32 *value);

/* Splits "first,second" for the config, whose policy is set, and checks both; the config
 * points into host. Returns 0, or -1 with *error. */
int plcConfigureAddress(const char *text, plcStationConfig *config,
                        char host[PLC_LINES_MAX][PLC_NAME_MAX + 1], const char **error);

#endif /* INC_plcConfigure_H */
