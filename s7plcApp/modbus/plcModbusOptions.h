/* The options of s7plcSetOption that only Modbus has: a table, and the values. */
#ifndef INC_plcModbusOptions_H
#define INC_plcModbusOptions_H

#include "plcOptions.h"

enum { plcMaskRefuse, plcMaskRmw };                                              /* maskWrite= */
enum { plcCheckStrict, plcCheckAnyUnit, plcCheckAnyTransaction, plcCheckLoose }; /* check= */
enum { plcFramingTcp, plcFramingRtu };                                           /* framing= */

typedef struct plcModbusChoices {
    double maxRegisters;      /* in one request */
    double maxBits;           /* the same of coils and discrete inputs */
    double requestPause;      /* ms between an answer and the next request, 0 = none */
    int check;                /* plcCheckStrict, ... */
    int framing;              /* plcFramingTcp, plcFramingRtu */
    int singleWrite;          /* 0 or 1 */
    int maskWrite;            /* plcMaskRefuse, plcMaskRmw */
    double heartbeatRegister; /* holding register, PLC_OFF */
} plcModbusChoices;

extern plcOptionTable plcModbusOptionTable;

static inline const plcModbusChoices *plcModbusChoicesOf(const plcOptions *options)
{
    return plcOptionsOwn(options, &plcModbusOptionTable);
}

#endif /* INC_plcModbusOptions_H */
