/* The Modbus/TCP side of the benchmark's PLC: 256 holding registers, functions 3 and 16.
 * It shares no code with the driver, and knows no clock. */
#ifndef INC_benchModbus_H
#define INC_benchModbus_H

/* A new connection: what came of a request on the last one is forgotten. */
void modbusBegin(void);

/* Reads what has come, and answers each whole request. put: is called with the 8 bytes of
 * registers 0 to 3 when they are in the memory. Returns 0; or -1 when the connection is to
 * be closed. */
int modbusServe(int socket, void (*put)(const unsigned char *bytes));

#endif /* INC_benchModbus_H */
