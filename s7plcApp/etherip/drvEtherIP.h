/* The C functions and variables of the driver for EtherNet/IP, with the names that ether_ip has.
 * Each is also a command of the IOC shell. */
#ifndef INC_drvEtherIP_H
#define INC_drvEtherIP_H

#include <shareLib.h>

#ifdef __cplusplus
extern "C" {
#endif

extern double drvEtherIP_default_rate; /* s, for links without a period; 0: none */
extern int EIP_verbosity;              /* 0 to 10; kept for scripts, has no effect */
extern double EIP_TIMEOUT;             /* ms, for PLCs defined from then on; 10 to 60000, else 2000 */
extern unsigned EIP_buffer_limit;      /* bytes of an unconnected message at most */
extern unsigned EIP_image_size;        /* bytes for the tags of a PLC defined from then on */

/* Kept for scripts: nothing needs it. */
void drvEtherIP_init(void);

/* Makes a PLC, or gives one that is there another address. ip is host[:port]; slot -1: the
 * address is that of the controller. Returns 0; or -1 after an error line. */
int drvEtherIP_define_PLC(const char *PLC, const char *ip, int slot);

void drvEtherIP_report(int level);
void drvEtherIP_dump(void);
void drvEtherIP_reset_statistics(void);
void drvEtherIP_restart(void);
void drvEtherIP_help(void);

/* Wait for the PLC, in the calling thread. Return 0; or -1 after an error line. */
int drvEtherIP_list(const char *PLC, const char *pattern);
int drvEtherIP_describe(const char *PLC, int type);
int drvEtherIP_read_tag(const char *ip, int slot, const char *tag, int elements, int timeout);

#ifdef __cplusplus
}
#endif

#endif /* INC_drvEtherIP_H */
