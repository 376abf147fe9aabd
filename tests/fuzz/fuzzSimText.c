/* Fuzz targets: the file and the console of plcSim. Each error has a line that says where; each
 * command has an answer that ends as the manual says.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdlib.h>
#include <string.h>

#include "fuzz.h"
#include "fuzzSim.h"
#include "simCommand.h"

fuzzTarget fuzzSimFile, fuzzSimConsole;

enum { textMost = 20000, commandsMost = 40 };

static size_t linesOf(const simText *out)
{
    const char *at = out->text;
    size_t n = 0;

    while (at && (at = strchr(at, '\n'))) {
        n++;
        at++;
    }
    return n;
}

int fuzzSimFile(const epicsUInt8 *data, size_t size)
{
    char *text = fuzzText(data, size < textMost ? size : textMost);
    simMoment moment = {.time = 12.5, .wall = 1.7e9, .block = 77};
    simulator sim;
    simText out;
    size_t i;
    int errors = fuzzSimBuild(&sim, text, &out);

    fuzzCheck(errors >= 0 && (errors == 0 || linesOf(&out) > 0));
    if (!errors)
        simPlcMake(&sim.plc[0]);
    for (i = 0; !errors && i < sim.plc[0].signalCount; i++)
        simSignalWrite(&sim.plc[0].memory, &sim.plc[0].signals[i], &moment);
    fuzzSimEnd(&sim, &out);
    free(text);
    return 0;
}

/* All servers, with something of everything to be named. */
static const char file[] =
    "in = 32\nout = 32\nport = 0\netherip_port = 0\nbyteorder = little\n"
    "period = 1 h\ndb 10 64 Setpoints\nsignal 0 INT16 counter\nmirror 0 4 -> 8\n"
#ifdef FUZZ_MODBUS
    "modbus_port = 0\nmodbus holding 0 16 -> DB10.0\nmodbus coils 0 8 -> DB10.40\n"
#endif
    "udt Axis Pos:REAL On:BOOL Text:STRING\ntag REALs REAL[10] = 1.5\ntag A Axis\n"
    "tag S STRING = bread\ntag B BOOL[32]\n";

static void checkAnswer(const simText *answer)
{
    const char *last;

    if (!answer->text || !answer->length)
        return; /* an empty line, or a comment */
    fuzzCheck(answer->text[answer->length - 1] == '\n');
    last = answer->text + answer->length - 1;
    while (last > answer->text && last[-1] != '\n')
        last--;
    fuzzCheck(strcmp(last, "ok\n") == 0 || strncmp(last, "error: ", 7) == 0);
}

int fuzzSimConsole(const epicsUInt8 *data, size_t size)
{
    char *text = fuzzText(data, size < textMost ? size : textMost), *rest = text, *line;
    simulator sim;
    simText out, answer;
    int commands = 0;

    fuzzCheck(fuzzSimBuild(&sim, file, &out) == 0);
    fuzzCheck(simPlcStart(&sim.plc[0], "127.0.0.1", NULL) == 0);
    while (!sim.loop.quit && commands++ < commandsMost && (line = fuzzLine(&rest))) {
        memset(&answer, 0, sizeof(answer));
        simCommandRun(&sim, line, &answer);
        checkAnswer(&answer);
        simTextFree(&answer);
        if (!sim.loop.quit)
            simPlcMake(&sim.plc[0]);
    }
    sim.loop.quit = 0;
    simLoopRun(&sim.loop, simNow() + 1e-6);
    simPlcStop(&sim.plc[0]);
    fuzzSimEnd(&sim, &out);
    free(text);
    return 0;
}
