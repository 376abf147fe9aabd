/* PLC_HOT marks what runs for every block, PLC_COLD what hardly ever runs but is called from
 * there. The linker then puts the hot functions side by side.
 *
 * Why: between two blocks the cache forgets the program. After a sleep of 10 ms each 64 bytes
 * of code cost about 0.1 us again, and each further page of 4 KiB another 0.2 us.
 */
#ifndef INC_plcHot_H
#define INC_plcHot_H

#ifdef __GNUC__
#define PLC_HOT __attribute__((hot))
#define PLC_COLD __attribute__((cold))
#else
#define PLC_HOT
#define PLC_COLD
#endif

#endif /* INC_plcHot_H */
