/* The release of plclink as text: configure/CONFIG_PLCLINK_VERSION by way of the Makefile. It
 * knows nothing else. */
#include "plcVersion.h"

#define TEXT(x) #x
#define TEXT_OF(x) TEXT(x)

const char *s7plcVersion(void)
{
    return TEXT_OF(PLCLINK_VERSION);
}
