/* Errors of sockets in the words of an operator; see plcErrno.h. */
#include <errno.h>
#include <string.h>

#include "plcErrno.h"

static const struct {
    int number;
    const char *text;
} reasons[] = {
    {ECONNREFUSED, "connection refused by PLC"   },
    {ETIMEDOUT,    "PLC does not answer"         },
    {EHOSTUNREACH, "no route to PLC"             },
    {ENETUNREACH,  "network unreachable"         },
    {EHOSTDOWN,    "PLC host is down"            },
    {ECONNRESET,   "connection reset by PLC"     },
    {EPIPE,        "connection reset by PLC"     },
    {EADDRNOTAVAIL, "no local port or address"    },
    {EMFILE,       "too many open files in IOC"  },
    {0,            NULL                          }
};

const char *plcErrnoText(int number)
{
    int i;

    for (i = 0; reasons[i].text; i++)
        if (reasons[i].number == number)
            return reasons[i].text;
    return strerror(number);
}
