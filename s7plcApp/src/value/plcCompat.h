/* What releases of EPICS Base 7 do differently: there is no AMSG before 7.0.6, and at first
 * nobody cleared it when its alarm was over.
 */
#ifndef INC_plcCompat_H
#define INC_plcCompat_H

#include <recGbl.h>

#ifdef HAS_ALARM_MESSAGE
/* The words of the alarm before stay in AMSG unless a new alarm brings its own. */
#define plcClearMessage(prec) ((void)((prec)->nsev == NO_ALARM ? (prec)->namsg[0] = 0 : 0))
#define plcMessage(prec) ((prec)->amsg)
#else
#define plcMessage(prec) ""
static inline void plcNoMessage(const char *format, ...)
{
    (void)format;
}
#define recGblSetSevrMsg(prec, stat, sevr, ...) \
    (plcNoMessage(__VA_ARGS__), recGblSetSevr(prec, stat, sevr))
#define plcClearMessage(prec) ((void)(prec))
#endif

#endif /* INC_plcCompat_H */
