/* Blocks of a fixed size as they come from a PLC: plcFraming between a connection and a station.
 *
 * Knows nothing of stations or records.
 */
#ifndef INC_plcBlocks_H
#define INC_plcBlocks_H

#include "plcReader.h"

extern const plcReader plcBlocks;

#endif /* INC_plcBlocks_H */
