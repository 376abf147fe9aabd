/* The transport of blocks: bytes of fixed sizes, both ways, on one connection.
 *
 * Knows nothing of stations or records.
 */
#ifndef INC_plcBlocks_H
#define INC_plcBlocks_H

#include "plcTransport.h"

extern const plcTransport plcBlocks;

#endif /* INC_plcBlocks_H */
