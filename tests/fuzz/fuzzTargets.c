/* The list of all fuzz targets. */
#include "fuzz.h"

fuzzTarget fuzzLink, fuzzOptions, fuzzPointers, fuzzTables, fuzzFraming, fuzzCodec, fuzzConfigure,
    fuzzDrvInfo, fuzzEipLink, fuzzEipName, fuzzEipRoute, fuzzEipType, fuzzEipSession, fuzzEipTags,
    fuzzSimFile, fuzzSimConsole, fuzzSimEip, fuzzSimBlocks, fuzzSimPartner;
#ifdef FUZZ_MODBUS
fuzzTarget fuzzRanges, fuzzModbusAnswer, fuzzSimModbus;
#endif

const fuzzRow fuzzTargets[] = {
    /* texts that people write */
    {"Link",         fuzzLink        },
    {"DrvInfo",      fuzzDrvInfo     },
    {"EipLink",      fuzzEipLink     },
    {"EipName",      fuzzEipName     },
    {"EipRoute",     fuzzEipRoute    },
    {"EipType",      fuzzEipType     },
    {"Options",      fuzzOptions     },
    {"Configure",    fuzzConfigure   },
    {"Pointers",     fuzzPointers    },
    {"SimFile",      fuzzSimFile     },
    {"SimConsole",   fuzzSimConsole  },
    /* bytes from the wire, to the driver */
    {"Codec",        fuzzCodec       },
    {"Framing",      fuzzFraming     },
    {"Tables",       fuzzTables      },
    {"EipSession",   fuzzEipSession  },
    {"EipTags",      fuzzEipTags     },
    /* to the simulator */
    {"SimBlocks",    fuzzSimBlocks   },
    {"SimEip",       fuzzSimEip      },
    {"SimPartner",   fuzzSimPartner  },
#ifdef FUZZ_MODBUS
    {"Ranges",       fuzzRanges      },
    {"ModbusAnswer", fuzzModbusAnswer},
    {"SimModbus",    fuzzSimModbus   },
#endif
    {0,              0               }
};
