/* Driver functions of s7plc for device support of a site's own, as section 5 of the manual
 * of PSI's s7plc describes them: same names, same meaning of the arguments.
 *
 * All functions may be called from any thread after s7plcConfigure; none blocks on the
 * network.
 */
#ifndef INC_drvS7plc_H
#define INC_drvS7plc_H

#include <stddef.h>

#include <dbScan.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct plcStation s7plcStation;

/* -1 fatal errors only, 0 errors, 1 start-up, 2 outputs, 3 inputs, 4 driver calls, 5 I/O */
extern int s7plcDebug;

/* What s7plcReadArray and s7plcWriteMaskedArray return. */
#define S7PLC_OK 0
#define S7PLC_BAD_PARAM (-1) /* no station, or the place lies outside the block */
#define S7PLC_NO_CONN (-2)   /* read: no valid data, nothing copied; written: the PLC is
                                away, the value is kept and leaves on reconnect */
#define S7PLC_REFUSED (-3)   /* writes are refused now; nothing was written */

/* The release of plclink that this library is from, such as "1.0.0"; a constant. */
const char *s7plcVersion(void);

/* Makes a station; the iocsh command of the same name. Times in ms; recvTimeout 0 means
 * 2000, sendInterval 0 means 1000. inSize or outSize (bytes) may be 0; so may IPaddr be ""
 * when a record of DTYP "S7plc addr" brings it. bigEndian: 1 = most significant byte
 * first. Returns 0, or -1 after an error line. */
int s7plcConfigure(char *PLCname, char *IPaddr, unsigned int port, unsigned int inSize,
                   unsigned int outSize, unsigned int bigEndian,
                   unsigned int recvTimeout, unsigned int sendInterval);

/* The station of this name, or NULL. */
s7plcStation *s7plcOpen(char *PLCname);

/* Copies nelem elements of dlen bytes (1, 2, 4 or 8) at byte `offset` of the input block
 * to pdata, in the byte order of the IOC, as the station's byte order and its option
 * wordOrder say. For strings: dlen 1. */
int s7plcReadArray(s7plcStation *station, unsigned int offset, unsigned int dlen,
                   unsigned int nelem, void *pdata);

/* The other way, into the output block; only the bits set in the dlen bytes at pmask, in
 * each element (NULL: all). */
int s7plcWriteMaskedArray(s7plcStation *station, unsigned int offset, unsigned int dlen,
                          unsigned int nelem, void *pdata, void *pmask);

#define s7plcRead(station, offset, dlen, pdata) \
    s7plcReadArray(station, offset, dlen, 1, pdata)
#define s7plcWrite(station, offset, dlen, pdata) \
    s7plcWriteMaskedArray(station, offset, dlen, 1, pdata, NULL)
#define s7plcWriteMasked(station, offset, dlen, pdata, pmask) \
    s7plcWriteMaskedArray(station, offset, dlen, 1, pdata, pmask)
#define s7plcWriteArray(station, offset, dlen, nelem, pdata) \
    s7plcWriteMaskedArray(station, offset, dlen, nelem, pdata, NULL)

/* For get_ioint_info: the lists that fire with each block in, and each sendInterval, for
 * records of any PRIO. */
IOSCANPVT s7plcGetInScanPvt(s7plcStation *station);
IOSCANPVT s7plcGetOutScanPvt(s7plcStation *station);

#ifdef __cplusplus
}
#endif

#endif /* INC_drvS7plc_H */
