/* simModbusAnswer: from a Modbus/TCP request to its answer. libmodbus makes the answer,
 * on PLC memory. It does not know clients, nor faults.
 *
 *   byte   0    1    2    3    4    5    6      7
 *        +----+----+----+----+----+----+------+----------+----------- - -
 *        | trans-  | protocol|  length | unit | function | data
 *        | action  | 0       |  = n    |      |          |
 *        +----+----+----+----+----+----+------+----------+----------- - -
 *                                      |<------ n bytes, 2 ... 254 ------>
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simModbusAnswer_H
#define INC_simModbusAnswer_H

#include "simModbusMap.h"

#define SIM_MBAP 7           /* bytes in front of the function */
#define SIM_MODBUS_ADU 260   /* bytes of the longest request or answer */
#define SIM_MODBUS_FRAME 300 /* longer requests get exception 3 up to here */

/* Addresses that a request reads or writes; count 0 = none. */
typedef struct simSpan {
    simTable table;
    unsigned start, count;
} simSpan;

/* A request, taken apart. */
typedef struct simRequest {
    const epicsUInt8 *bytes;
    size_t size;
    unsigned transaction, unit, function;
    simSpan read, write;
} simRequest;

typedef struct simAnswerer {
    const simModbusMap *map;
    struct simModbusLibrary *library;
} simAnswerer;

/* Returns 0, or -1 after a message. */
int simAnswererOpen(simAnswerer *answerer, const simModbusMap *map, const char *name);
void simAnswererClose(simAnswerer *answerer);

/* Bytes of the first frame: more than `size` when it is not complete (as far as it can be
 * told), 0 when this is no Modbus/TCP. */
size_t simFrameSize(const epicsUInt8 *bytes, size_t size);

/* Takes a complete frame apart. Returns 0, or the exception that the request deserves by
 * itself: 1 no such function, 3 what the standard does not allow. read and write say the
 * addresses as far as they can be told, also with exception 3. */
int simRequestParse(simRequest *request, const epicsUInt8 *bytes, size_t size);
/* The exception that the PLC answers with, or 0: 1 `without`, 2 no such address. */
int simRequestCheck(const simRequest *request, const simModbusMap *map);

/* Does what the request says, and writes the answer. Returns its bytes, 0 = none. Only
 * for a request that parse and check have found good. */
size_t simAnswer(simAnswerer *answerer, const simRequest *request,
                 epicsUInt8 answer[SIM_MODBUS_ADU]);
/* The answer is this exception (1 ... 11). */
size_t simAnswerException(simAnswerer *answerer, const simRequest *request, int code,
                          epicsUInt8 answer[SIM_MODBUS_ADU]);

#endif
