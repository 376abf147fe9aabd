/* Errors of sockets in the words of an operator, for AMSG: "connection refused by PLC". Knows error
 * numbers only. */
#ifndef INC_plcErrno_H
#define INC_plcErrno_H

/* number: an errno. The text is good until the next call in this thread. */
const char *plcErrnoText(int number);

#endif /* INC_plcErrno_H */
