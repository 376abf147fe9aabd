/* What an application may call of the library phoenixRedund. */
#ifndef INC_phoenixRedund_H
#define INC_phoenixRedund_H

#ifdef __cplusplus
extern "C" {
#endif

/* Makes a station of one PLC or of a redundant pair. args are the texts a user would
 * type, NULL where missing: PLCname, IPaddr, IPport, inSize, outSize, bigEndian,
 * recvTimeout [ms], sendInterval [ms], redundancy. Returns 0, or -1 after an error line. */
int phoenixplcConfigure(const char *const args[9]);

#ifdef __cplusplus
}
#endif

#endif /* INC_phoenixRedund_H */
