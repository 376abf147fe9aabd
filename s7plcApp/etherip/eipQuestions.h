/* Questions of people to controllers: each has a connection of its own, made for it and closed
 * behind it, and waits for its answers. The answer goes to the standard output, why there is
 * none to the log.
 *
 * Called by the IOC's shell. All return 0, or -1 after an error line; timeouts are in ms.
 */
#ifndef INC_eipQuestions_H
#define INC_eipQuestions_H

#include "eipConnect.h"

/* The tags that match the pattern (NULL: all) of this PLC, NULL or "": of all PLCs. */
int eipQuestionList(const char *command, const char *plc, const char *pattern, unsigned timeout);

/* The members of a structure: by the name of a type or tag, or (NULL) by the number of the type. */
int eipQuestionDescribe(const char *command, const char *plc, const char *name, int type,
                        unsigned timeout);

/* Elements of a tag of the controller at this address. */
int eipQuestionRead(const char *address, const eipConnectOptions *options, const char *tag,
                    unsigned elements);

#endif /* INC_eipQuestions_H */
