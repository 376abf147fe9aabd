/* A PLC as an asyn port, for programs that have no iocsh. */
#ifndef INC_drvAsynS7plc_H
#define INC_drvAsynS7plc_H

#ifdef __cplusplus
extern "C" {
#endif

/* Makes an asyn port of a PLC, after its own configure command and before iocInit.
 * initialWait (ms as text, NULL: 0): how long iocInit may wait for the first blocks, for
 * outputs whose initial value the PLC shows; the longest of all ports counts, for all of
 * them together. Returns 0, or -1 after an error line. */
int drvAsynS7plcConfigure(const char *port, const char *PLCname, const char *initialWait);

#ifdef __cplusplus
}
#endif

#endif /* INC_drvAsynS7plc_H */
