/* simLog: lines with a time stamp on stdout, and growing text for console answers.
 * It never blocks: when nobody reads stdout, lines are dropped and counted.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#ifndef INC_simLog_H
#define INC_simLog_H

#include <stddef.h>
#include <compilerDependencies.h>

/* 0 prints everything, 1 only lines of simSay() and simComplain(), 2 (for tests) nothing.
 */
void simLogQuiet(int quiet);

/* "2026-11-23 11:52:49.123 <name>: <text>", one line. */
void simLog(const char *name, const char *format, ...) EPICS_PRINTF_STYLE(2, 3);
/* The same, printed in quiet mode too: errors. */
void simComplain(const char *name, const char *format, ...) EPICS_PRINTF_STYLE(2, 3);
/* A line for programs to read, without time stamp: "plcSim: PLC listening on ...". */
void simSay(const char *format, ...) EPICS_PRINTF_STYLE(1, 2);

#define SIM_ERROR_SIZE 256

/* Writes the reason why something was refused. Returns -1. */
int simFail(char error[SIM_ERROR_SIZE], const char *format, ...) EPICS_PRINTF_STYLE(2, 3);

/* Growing text. Always terminated once something was added. */
typedef struct simText {
    char *text;
    size_t length, room;
} simText;

void simTextAdd(simText *out, const char *format, ...) EPICS_PRINTF_STYLE(2, 3);
/* Bytes as hex, 16 to a line with their offset in front. */
void simTextDump(simText *out, const unsigned char *bytes, size_t size);
/* Bytes as hex on one line, with blanks between. */
void simTextHex(simText *out, const unsigned char *bytes, size_t size);
void simTextFree(simText *out);

#endif
