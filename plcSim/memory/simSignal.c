/* simSignal: values that move by themselves, as a pure function of time and block number.
 * It does not know of blocks going anywhere: it writes bytes at a place in PLC memory.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <epicsString.h>

#include "simLog.h"
#include "simSignal.h"
#include "simValue.h"

#define PI 3.14159265358979323846

/* How the words behind the name of a shape are read. */
typedef enum simArgs {
    argValue,
    argRange,
    argRangePeriod,
    argPeriod,
    argTexts,
    argOffset
} simArgs;

struct simShape {
    const char *name;
    simArgs args;
    /* value of one element; phase is 0..1 along an array */
    double (*value)(const simSignal *signal, const simMoment *moment, double phase);
    const char *usage;
};

/* ---- shapes ---- */

static double turn(const simSignal *signal, const simMoment *moment, double phase)
{
    double turns = moment->time / signal->period + phase;

    return turns - floor(turns);
}

static double constantValue(const simSignal *signal, const simMoment *moment,
                            double phase)
{
    (void)moment;
    (void)phase;
    return signal->low;
}

static double rampValue(const simSignal *signal, const simMoment *moment, double phase)
{
    return signal->low + (signal->high - signal->low) * turn(signal, moment, phase);
}

static double sineValue(const simSignal *signal, const simMoment *moment, double phase)
{
    return (signal->low + signal->high) / 2 +
           (signal->high - signal->low) / 2 * sin(2 * PI * turn(signal, moment, phase));
}

static double squareValue(const simSignal *signal, const simMoment *moment, double phase)
{
    return turn(signal, moment, phase) < 0.5 ? signal->low : signal->high;
}

static double noiseValue(const simSignal *signal, const simMoment *moment, double phase)
{
    epicsUInt64 x = moment->block * 0x9e3779b97f4a7c15ull + signal->seed +
                    (epicsUInt64)(phase * 1e6) * 0xbf58476d1ce4e5b9ull;

    x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9ull;
    x = (x ^ x >> 27) * 0x94d049bb133111ebull;
    x ^= x >> 31;
    return signal->low +
           (signal->high - signal->low) * ((double)(x >> 11) / 9007199254740992.0);
}

static const struct simShape shapes[] = {
    {"constant", argValue,       constantValue, "<value>"                   },
    {"ramp",     argRangePeriod, rampValue,     "<low> <high> <period>"     },
    {"sine",     argRangePeriod, sineValue,     "<low> <high> <period>"     },
    {"square",   argRangePeriod, squareValue,   "<low> <high> <period>"     },
    {"noise",    argRange,       noiseValue,    "<low> <high>"              },
    {"counter",  argPeriod,      NULL,          "[<period>]"                },
    {"text",     argTexts,       NULL,          "\"a\" [\"b\" ... <period>]"},
    {"clock",    argOffset,      NULL,          "[<offset>]"                },
};

/* ---- reading ---- */

int simTimeParse(const char *text, double *seconds, char error[SIM_ERROR_SIZE])
{
    static const struct {
        const char *name;
        double seconds;
    } units[] = {
        {"",    1e-3},
        {"ms",  1e-3},
        {"s",   1   },
        {"us",  1e-6},
        {"min", 60  },
        {"h",   3600},
    };
    char *end;
    double value = strtod(text, &end);
    size_t i;

    if (end == text || !isfinite(value))
        return simFail(error, "\"%.40s\" is no time: allowed are 100 ms, 2 s, 1.5 min",
                       text);
    while (*end == ' ' || *end == '\t')
        end++;
    for (i = 0; i < sizeof(units) / sizeof(units[0]); i++) {
        if (strcmp(end, units[i].name))
            continue;
        *seconds = value * units[i].seconds;
        return 0;
    }
    return simFail(error, "\"%.40s\": unknown unit, allowed are us ms s min h", text);
}

static int realArg(const char *word, double *value, char error[SIM_ERROR_SIZE])
{
    char *end;

    *value = strtod(word, &end);
    if (end == word || *end || !isfinite(*value))
        return simFail(error, "\"%.40s\" is no number", word);
    return 0;
}

static int periodArg(const char *word, double *period, char error[SIM_ERROR_SIZE])
{
    if (simTimeParse(word, period, error))
        return -1;
    if (*period < 1e-6)
        return simFail(error, "\"%.40s\": a period must be greater than 0", word);
    return 0;
}

static int textArgs(char **words, size_t count, simSignal *signal,
                    char error[SIM_ERROR_SIZE])
{
    size_t texts = count > 1 ? count - 1 : count;
    size_t i;

    if (count < 1 || texts > SIM_MAX_TEXTS)
        return simFail(error, "text wants 1 ... %d texts, and a period behind several",
                       SIM_MAX_TEXTS);
    signal->period = 1;
    if (count > 1 && periodArg(words[count - 1], &signal->period, error))
        return -1;
    for (i = 0; i < texts; i++)
        signal->texts[signal->textCount++] = epicsStrDup(words[i]);
    return 0;
}

static int shapeArgs(char **words, size_t count, simSignal *signal,
                     char error[SIM_ERROR_SIZE])
{
    static const struct {
        size_t min, max;
    } wanted[] = {
        [argValue] = {1, 1                },
        [argRange] = {2, 2                },
        [argRangePeriod] = {3, 3                },
        [argPeriod] = {0, 1                },
        [argTexts] = {1, SIM_MAX_TEXTS + 1},
        [argOffset] = {0, 1                },
    };
    simArgs args = signal->shape->args;

    if (count < wanted[args].min || count > wanted[args].max)
        return simFail(error, "%s wants: %s", signal->shape->name, signal->shape->usage);
    switch (args) {
    case argValue:
        return realArg(words[0], &signal->low, error);
    case argRangePeriod:
        if (periodArg(words[2], &signal->period, error))
            return -1;
        /* fall through */
    case argRange:
        return realArg(words[0], &signal->low, error) ||
                       realArg(words[1], &signal->high, error)
                   ? -1
                   : 0;
    case argPeriod:
        return count ? periodArg(words[0], &signal->period, error) : 0;
    case argOffset:
        return count ? simTimeParse(words[0], &signal->low, error) : 0;
    default:
        return textArgs(words, count, signal, error);
    }
}

/* Texts go into strings, clocks into times, numbers into numbers. */
static int shapeFits(const simSignal *signal)
{
    simKind kind = signal->type.info->kind;
    simArgs args = signal->shape->args;

    if (args == argTexts)
        return kind == simString || kind == simS7String;
    if (args == argOffset)
        return kind == simBcd || kind == simDtl;
    return kind == simBool || kind == simInteger || kind == simUnsigned ||
           kind == simReal;
}

static const struct simShape *findShape(const char *name)
{
    size_t i;

    for (i = 0; i < sizeof(shapes) / sizeof(shapes[0]); i++)
        if (!strcasecmp(name, shapes[i].name))
            return &shapes[i];
    return NULL;
}

int simSignalParse(const simMemory *mem, simBlock *byDefault, char **words, size_t count,
                   simSignal *signal, char error[SIM_ERROR_SIZE])
{
    memset(signal, 0, sizeof(*signal));
    if (count < 3)
        return simFail(error, "a signal wants: <place> <type> <kind> ...");
    if (simPlaceParse(mem, words[0], byDefault, &signal->place, error) ||
        simTypeParse(words[1], &signal->type, error) ||
        simPlaceCheck(&signal->place, &signal->type, error))
        return -1;
    signal->shape = findShape(words[2]);
    if (!signal->shape)
        return simFail(
            error,
            "\"%.40s\" is not known: a signal is constant, ramp, sine, square, noise, "
            "counter, text or clock",
            words[2]);
    if (!shapeFits(signal))
        return simFail(error, "%s cannot be written as %s", signal->shape->name,
                       signal->type.info->name);
    if (shapeArgs(words + 3, count - 3, signal, error)) {
        simSignalFree(signal);
        return -1;
    }
    signal->seed =
        (unsigned)(signal->place.offset * 8 + signal->place.block->number * 524309u);
    return 0;
}

void simSignalFree(simSignal *signal)
{
    size_t i;

    for (i = 0; i < signal->textCount; i++)
        free(signal->texts[i]);
    signal->textCount = 0;
}

int simSignalIsCounter(const simSignal *signal)
{
    return signal->shape->args == argPeriod;
}

/* ---- writing ---- */

/* Counters wrap around at the width of their type; the bytes do that by themselves. */
static void writeCounter(const simMemory *mem, const simSignal *signal,
                         const simMoment *moment, epicsUInt8 *p)
{
    const simTypeInfo *info = signal->type.info;
    epicsUInt64 value =
        signal->period > 0 ? (epicsUInt64)(epicsInt64)floor(moment->time / signal->period)
                           : moment->block;
    size_t i;

    for (i = 0; i < signal->type.count; i++, p += info->size) {
        if (info->kind == simInteger || info->kind == simUnsigned)
            simPutInt(p, info->size, mem->bigEndian, value);
        else
            simPutReal(info, p, signal->place.bit, mem->bigEndian,
                       info->kind == simBool ? (double)(value & 1) : (double)value);
    }
}

static void writeNumbers(const simMemory *mem, const simSignal *signal,
                         const simMoment *moment, epicsUInt8 *p)
{
    const simTypeInfo *info = signal->type.info;
    size_t i;

    for (i = 0; i < signal->type.count; i++)
        simPutReal(
            info, p + i * info->size, signal->place.bit, mem->bigEndian,
            signal->shape->value(signal, moment, (double)i / (double)signal->type.count));
}

void simSignalWrite(const simMemory *mem, const simSignal *signal,
                    const simMoment *moment)
{
    epicsUInt8 *p = signal->place.block->bytes + signal->place.offset;
    double turn;

    switch (signal->shape->args) {
    case argPeriod:
        writeCounter(mem, signal, moment, p);
        break;
    case argTexts:
        turn = fmod(floor(moment->time / signal->period), (double)signal->textCount);
        turn += turn < 0 ? (double)signal->textCount : 0; /* before its beginning */
        simPutText(&signal->type, p, signal->texts[(size_t)turn]);
        break;
    case argOffset:
        if (signal->type.info->kind == simBcd)
            simPutBcdTime(p, moment->wall + signal->low);
        else
            simPutDtl(p, mem->bigEndian, moment->wall + signal->low);
        break;
    default:
        writeNumbers(mem, signal, moment, p);
    }
}
