/* Names of data types from elsewhere; see plcOtherTypes.h. */
#include <string.h>

#include <epicsStdio.h>
#include <epicsString.h>

#include "plcOtherTypes.h"

typedef struct name {
    const char *name, *here;
} name;

/* IEC 61131-3 */
static const name ofPlc[] = {
    {"REAL",  "T=REAL32, a REAL of the PLC" },
    {"LREAL", "T=REAL64, an LREAL of the PLC"},
    {"SINT",  "T=INT8, a SINT of the PLC"   },
    {"USINT", "T=UINT8, a USINT of the PLC" },
    {"INT",   "T=INT16, an INT of the PLC"  },
    {"UINT",  "T=UINT16, a UINT of the PLC" },
    {"DINT",  "T=INT32, a DINT of the PLC"  },
    {"UDINT", "T=UINT32, a UDINT of the PLC"},
    {"LINT",  "T=INT64, a LINT of the PLC"  },
    {"ULINT", "T=UINT64, a ULINT of the PLC"},
    {"BOOL",  "T=BYTE B=bit, in a bi or bo" },
};

/* The driver of registers for asyn: a type, behind some an order. */
static const name ofAsyn[] = {
    {"BCD_UNSIGNED",     "T=BCD16"        },
    {"BCD_SIGNED",       "T=SBCD16"       },
    {"INT16SM",          "T=SM16"         },
    {"STRING_HIGH",      "T=STRING W=A0"  },
    {"STRING_LOW",       "T=STRING W=0A"  },
    {"STRING_HIGH_LOW",  "T=STRING"       },
    {"STRING_LOW_HIGH",  "T=STRING W=BADC"},
    {"ZSTRING_HIGH",     "T=STRING W=A0"  },
    {"ZSTRING_LOW",      "T=STRING W=0A"  },
    {"ZSTRING_HIGH_LOW", "T=STRING"       },
    {"ZSTRING_LOW_HIGH", "T=STRING W=BADC"},
};
static const name numbers[] = {
    {"INT32",   "INT32" },
    {"UINT32",  "UINT32"},
    {"INT64",   "INT64" },
    {"UINT64",  "UINT64"},
    {"FLOAT32", "REAL32"},
    {"FLOAT64", "REAL64"},
};
static const name orders[] = {
    {"_LE",    "CDAB"},
    {"_BE",    "ABCD"},
    {"_LE_BS", "DCBA"},
    {"_BE_BS", "BADC"},
};

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static const char *find(const name *names, size_t count, const char *text, size_t length)
{
    size_t i;

    for (i = 0; i < count; i++)
        if (strlen(names[i].name) == length &&
            epicsStrnCaseCmp(names[i].name, text, length) == 0)
            return names[i].here;
    return NULL;
}

static int ofAsynNumber(const char *name, size_t length, char *text, size_t size)
{
    const char *tail = memchr(name, '_', length);
    size_t head = tail ? (size_t)(tail - name) : length;
    const char *type = find(numbers, COUNT(numbers), name, head);
    const char *order = find(orders, COUNT(orders), name + head, length - head);

    if (!type || !order)
        return 0;
    epicsSnprintf(text, size, "T=%s W=%s, the same in asyn's modbus", type, order);
    return 1;
}

int plcOtherType(const char *name, size_t length, char *text, size_t size)
{
    const char *here = find(ofPlc, COUNT(ofPlc), name, length);

    if (here) {
        epicsSnprintf(text, size, "%s", here);
        return 1;
    }
    if ((here = find(ofAsyn, COUNT(ofAsyn), name, length))) {
        epicsSnprintf(text, size, "%s, the same in asyn's modbus", here);
        return 1;
    }
    return ofAsynNumber(name, length, text, size);
}
