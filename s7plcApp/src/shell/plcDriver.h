/* What the driver of any wire does when an IOC begins; once is enough, more do no harm: an IOC
 * may have the driver of one wire only. */
#ifndef INC_plcDriver_H
#define INC_plcDriver_H

/* Registers the commands that all PLCs share (s7plcSetOption, s7plcReport ...). */
void plcDriverRegister(void);

/* Called by iocInit before records are initialised: PLCs connect meanwhile. */
void plcDriverInit(void);

#endif /* INC_plcDriver_H */
