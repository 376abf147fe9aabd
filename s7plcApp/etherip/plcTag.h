/* The parts of plcTag: tags of a controller from the command line. */
#ifndef INC_plcTag_H
#define INC_plcTag_H

#include "eipClient.h"

/* Writes a value, or as many elements as there are words. Returns 0, or -1 with c->why. */
int plcTagWrite(eipClient *c, const char *tag, char **words, int count);

#endif /* INC_plcTag_H */
