/* Faults of the machine, for tests: no thread to be had, the clock set back. They stand in the
 * place of functions of the C library, for all of the program. Knows nothing of the driver. */
#ifndef INC_testFaults_H
#define INC_testFaults_H

/* 1: no thread can be created; 0: as ever. */
void faultNoThreads(int on);

/* 1: the clock of the machine was set back by so much that no wait for a time of day comes to
 * its end; 0: as ever. */
void faultClockBack(int on);

#endif /* INC_testFaults_H */
