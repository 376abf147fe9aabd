/* Frames of Modbus: how long one is, whether an answer is the one to a request, and the same as on
 * a serial line.
 *
 *   bytes: 0 1 transaction, 2 3 zero, 4 5 length of the rest, 6 unit, 7 function, 8 ...
 *
 * With framing rtu there is no header: unit, function, ..., and a CRC behind.
 *
 * Pure: knows neither sockets nor what requests are for.
 */
#ifndef INC_plcModbusFrame_H
#define INC_plcModbusFrame_H

#include <stddef.h>

#include <compilerDependencies.h>
#include <epicsTypes.h>

#include "plcImage.h" /* PLC_REASON_SIZE */

enum {
    plcFrameMax = 260,
    plcFrameUnit = 6, /* where it is; the length counts from here on */
    plcFrameHead = 8, /* up to and with the function */
    plcRtuHead = 2    /* unit and function */
};

typedef struct plcFrame {
    epicsUInt8 bytes[plcFrameMax];
    size_t size;
} plcFrame;

/* How a request ended. */
typedef struct plcModbusResult {
    int lost;                  /* the socket is of no use any more, because: */
    char why[PLC_REASON_SIZE];
    int timeout;               /* it is lost because the answer was late */
    int silent;                /* nothing of an answer came; the socket is kept, if that is wanted */
    int closed, reset;         /* it is lost because the PLC has closed it; by a reset */
    int exception;             /* code of the PLC's answer; 0: none */
    unsigned sent, received;   /* bytes */
    double latency;            /* ms from the request to the whole answer; 0: none came */
} plcModbusResult;

/* The socket is lost, for this reason. Returns -1. */
int plcModbusLost(plcModbusResult *x, const char *format, ...) EPICS_PRINTF_STYLE(2, 3);

unsigned plcFrameTransaction(const epicsUInt8 *bytes);

/* The bytes of the frame whose header (plcFrameUnit bytes) this is; 0, and why in *x: it is none. */
size_t plcFrameSize(const epicsUInt8 *header, plcModbusResult *x);

/* Is what begins with this head the answer to the request, by its function and unit (-1: any)?
 * Returns 0, or -1 and why. */
int plcFrameCheckHead(const plcFrame *request, const epicsUInt8 *head, int unit,
                      plcModbusResult *x);

/* Is the whole of it? Its head is good. Returns 0, with the code of an exception, or -1 and why. */
int plcFrameCheck(const plcFrame *request, const plcFrame *answer, plcModbusResult *x);

/* To libmodbus: the request was refused. */
void plcFrameRefuse(const plcFrame *request, plcFrame *answer);

/* The request for a serial line: the header goes, the CRC comes. */
void plcFrameToRtu(const plcFrame *request, plcFrame *rtu);

/* The bytes of the answer that begins with these plcRtuHead bytes: the request says it. */
size_t plcRtuSize(const plcFrame *request, const epicsUInt8 *rtu);

/* The whole answer with a header, that of the request. Returns 0, or -1: the CRC is wrong. */
int plcFrameFromRtu(const plcFrame *request, const epicsUInt8 *rtu, size_t size,
                    plcFrame *answer, plcModbusResult *x);

#endif /* INC_plcModbusFrame_H */
