/* One target for libFuzzer: the one that FUZZ_TARGET names. */
#include "fuzz.h"

fuzzTarget FUZZ_TARGET;

int LLVMFuzzerTestOneInput(const epicsUInt8 *data, size_t size);

int LLVMFuzzerTestOneInput(const epicsUInt8 *data, size_t size)
{
    return FUZZ_TARGET(data, size);
}
