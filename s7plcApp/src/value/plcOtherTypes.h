/* Names of data types that people bring along from other drivers and from PLC programs.
 *
 * Pure: for messages only; links know none of them.
 */
#ifndef INC_plcOtherTypes_H
#define INC_plcOtherTypes_H

#include <stddef.h>

/* What `length` characters of `name`, in upper or lower case, are here: "T=INT32 W=CDAB, the same in
 * asyn's modbus". Returns 1; 0: no such name. */
int plcOtherType(const char *name, size_t length, char *text, size_t size);

#endif /* INC_plcOtherTypes_H */
