/* The trace of a port: blocks and lines that a thread of its own prints, so that nobody
 * who has something to trace waits for a terminal or a file.
 *
 * Knows asynTrace; no station, no records. What does not fit into the queue is counted,
 * and the count is printed.
 */
#ifndef INC_plcAsynTrace_H
#define INC_plcAsynTrace_H

#include <stddef.h>

#include <asynDriver.h>
#include <epicsTypes.h>

#include "plcWake.h"

typedef struct plcAsynTrace plcAsynTrace;

#define PLC_ASYN_TRACE_ENTRIES 256 /* that may wait to be printed */

/* Traces as this asynUser, which is connected to the port: its masks and its file apply.
 * The thread will have this name. */
plcAsynTrace *plcAsynTraceCreate(asynUser *user, const char *name);

/* Starts the thread / ends it; what waits is printed first, as far as there is time: see
 * plcWakeJoin. Both as often as there is an IOC. */
void plcAsynTraceStart(plcAsynTrace *trace);
void plcAsynTraceStop(plcAsynTrace *trace, plcWake *some, epicsUInt64 deadline);

/* Bytes with a heading, when `reason` (ASYN_TRACEIO_DRIVER) is in the mask. Any thread;
 * does not block. Only as many bytes are copied as asynSetTraceIOTruncateSize shows. */
void plcAsynTraceBytes(plcAsynTrace *trace, int reason, const void *bytes, size_t length,
                       const char *heading);

/* A line, when `reason` (ASYN_TRACE_FLOW) is in the mask. Any thread; does not block. */
void plcAsynTraceLine(plcAsynTrace *trace, int reason, const char *format, ...)
    EPICS_PRINTF_STYLE(3, 4);

/* How many were not printed because the queue was full. */
unsigned plcAsynTraceDropped(plcAsynTrace *trace);

#endif /* INC_plcAsynTrace_H */
