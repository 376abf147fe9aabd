/* The Modbus/TCP side of the benchmark's PLC: 2048 holding registers, functions 3 and 16.
 * It shares no code with the driver, and knows no clock. */
#ifndef INC_benchModbus_H
#define INC_benchModbus_H

/* A new connection: what came of a request on the last one is forgotten. */
void modbusBegin(void);

/* Of so many registers from 16 on, so many change with each read that begins there. Before it is called:
 * none. */
void modbusPolled(int count, int change);

/* Reads what has come, and answers each whole request. put: is called with the 8 bytes of
 * registers 0 to 3 when they are in the memory. Returns 0; or -1 when the connection is to
 * be closed. */
int modbusServe(int socket, void (*put)(const unsigned char *bytes));

#endif /* INC_benchModbus_H */
