/* Tab completion of PLC names in the IOC shell, where Base offers it. */
#ifndef INC_plcComplete_H
#define INC_plcComplete_H

#include <epicsVersion.h>
#include <iocsh.h>

/* The type of an iocsh argument that is a PLC name; completes since Base 7.0.8. */
#if EPICS_VERSION_INT >= VERSION_INT(7, 0, 8, 0)
#define PLC_ARG_STATION iocshArgStringRecord
#define PLC_ARG_PATH iocshArgStringPath
#else
#define PLC_ARG_STATION iocshArgString
#define PLC_ARG_PATH iocshArgString
#endif

/* Once, when commands are registered. Does nothing where the shell cannot complete. */
void plcCompleteInstall(void);

#endif /* INC_plcComplete_H */
