/* The parts of framingTest: framingTestSlip.c plays streams that slip. */
#ifndef INC_framingTest_H
#define INC_framingTest_H

/* How many tests framingSlips makes. */
int framingSlipTests(void);
void framingSlips(void);

#endif /* INC_framingTest_H */
