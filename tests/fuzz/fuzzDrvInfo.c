/* Fuzz target: a drvInfo of asyn, seen through all interfaces; and a configure command with an
 * option or two. Bytes of each view lie in the block; text of all lengths fits. */
#include <stdlib.h>
#include <string.h>

#include <epicsStdio.h>
#include <errlog.h>

#include "fuzz.h"
#include "plcAsynPlace.h"
#include "plcBlocks.h"
#include "plcConfigure.h"
#include "plcPolicy.h"
#include "plcResolver.h"

fuzzTarget fuzzDrvInfo, fuzzConfigure;

enum { inSize = 200, outSize = 100 };

static plcStation *station(void)
{
    static plcStation *one;
    plcStationConfig config = {.name = "P", .address = {"", ""}, .inSize = inSize,
                               .outSize = outSize, .bigEndian = 1, .recvTimeout = 1000,
                               .sendInterval = 100, .policy = &plcSingle,
                               .transport = &plcBlocks};

    if (!one)
        one = plcStationCreate(&config);
    return one;
}

/* A view that fits: its bytes to values and back stay where they belong. */
static void move(const plcAsynView *view, plcAsynFace face)
{
    size_t block = view->place->output ? outSize : inSize, n = view->length, chars;
    epicsUInt8 *bytes = calloc(1, n + 1), *values = calloc(1, 8 * n + 8);
    char error[200], text[300];

    fuzzCheck(view->offset <= block && n > 0 && n <= block - view->offset);
    fuzzCheck(!view->hasReadback || view->open ||
              (view->readback <= inSize && n <= inSize - view->readback));
    if (face == plcAsynOctet) {
        chars = plcAsynGetText(view, bytes, n, text, sizeof(text));
        fuzzCheck(chars <= n && chars <= sizeof(text));
        memset(text, 'x', sizeof(text));
        plcAsynPutText(view, text, n / 2, bytes);
        plcAsynPutText(view, text, sizeof(text), bytes);
    } else if (plcAsynElementSize(face)) {
        fuzzCheck(n % plcAsynElementSize(face) == 0);
        plcAsynGetArray(view, bytes, values, n / plcAsynElementSize(face));
        plcAsynPutArray(view, values, bytes, n / plcAsynElementSize(face));
    } else {
        fuzzCheck(n <= PLC_ASYN_SCALAR);
        if (plcAsynPutInt(view, 1, bytes, error, sizeof(error)) == 0 && !(view->clips))
            fuzzCheck(plcAsynGetInt(view, bytes) == 1 || view->type->kind == plcReal);
        plcAsynPutReal(view, -1.5, bytes, error, sizeof(error));
        (void)plcAsynGetReal(view, bytes);
    }
    fuzzCheck(bytes[n] == 0);
    free(bytes);
    free(values);
}

/* The parser makes places that live for ever: here they go. */
static void freePlace(plcAsynPlace *place)
{
    int face;

    for (face = 0; face < plcAsynFaces; face++) {
        plcAsynView *view = place->views[face];

        if (!view)
            continue;
        if (!view->refused)
            plcOwnersRemove(plcStationOwners(place->station), &view->owner);
        free(view->refused);
        free(view->doubt);
        free(view);
    }
    free(place->text);
    free(place);
}

int fuzzDrvInfo(const epicsUInt8 *data, size_t size)
{
    char *text = fuzzText(data, size), error[900] = "", warning[900] = "";
    plcAsynPlace *place;
    int face;

    eltc(0);
    place = plcAsynPlaceCreate(station(), text, error, warning, sizeof(error));
    fuzzCheck(place || error[0]);
    for (face = 0; place && face < plcAsynFaces; face++) {
        plcAsynView *view = plcAsynPlaceView(place, (plcAsynFace)face, "port");

        fuzzCheck(!view->refused || view->refused[0]);
        if (!view->refused)
            move(view, (plcAsynFace)face);
    }
    if (place)
        freePlace(place);
    free(text);
    return 0;
}

int fuzzConfigure(const epicsUInt8 *data, size_t size)
{
    char *text = fuzzText(data, size), *rest = text, *line;
    char host[PLC_LINES_MAX][PLC_NAME_MAX + 1], *args[8] = {NULL};
    static const char *const options[] = {"recvTimeout", "sendInterval"};
    static const plcNumberArg port = {"port", -1, 0, 65535, 0, "1 to 65535"};
    plcStationConfig config = {.policy = &plcSingle};
    plcPolicy pair = plcSingle;
    const char *error = NULL;
    epicsInt32 value;
    int i;

    eltc(0);
    (void)station();
    pair.lines = 2;
    for (i = 0; i < 8 && (line = fuzzLine(&rest)); i++)
        args[i] = line;
    for (i = 0; i < 2; i++) {
        config.policy = i ? &pair : &plcSingle;
        if (args[1] && plcConfigureAddress(args[1], &config, host, &error) == 0)
            fuzzCheck(plcAddressIsHost(host[0]) && plcAddressIsHost(host[1]));
        else
            fuzzCheck(!args[1] || (error && error[0]));
    }
    if (plcConfigureNumber("fuzz", args[0], &port, args[2], &value) == 0)
        fuzzCheck(value >= 0 && value <= 65535);
    for (i = 0; i < 2; i++) {
        plcNumberArg arg = {.name = options[i], .zeroMeansInitial = 1};
        double min, max, initial;

        plcOptionsLimits(options[i], &min, &max, &initial);
        if (plcConfigureNumber("fuzz", args[0], &arg, args[3 + i], &value) == 0)
            fuzzCheck(value >= min && value <= max);
    }
    /* A whole command is good at most once for each name: it is given a bad port. */
    if (args[0] && plcConfigureIsNew("fuzz", args[0]))
        fuzzCheck(args[0][0] && strlen(args[0]) <= PLC_NAME_MAX && !strchr(args[0], '/'));
    args[2] = "65536";
    fuzzCheck(!plcConfigure("fuzz", (const char *const *)args, &plcSingle, NULL));
    free(text);
    return 0;
}
