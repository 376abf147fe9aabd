/* What older releases of EPICS Base 7 lack. Nothing here is for Base 7.0.6 or newer.
 */
#ifndef INC_plcCompat_H
#define INC_plcCompat_H

#include <recGbl.h>

#ifndef HAS_ALARM_MESSAGE
/* Before 7.0.6 records have no AMSG: the alarm is raised without its words. */
#define recGblSetSevrMsg(prec, stat, sevr, ...) recGblSetSevr(prec, stat, sevr)
#endif

#endif /* INC_plcCompat_H */
