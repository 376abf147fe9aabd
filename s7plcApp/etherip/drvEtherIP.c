/* The face of the driver for EtherNet/IP towards EPICS: driver entry, iocsh commands, and the C
 * functions of drvEtherIP.h. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <dbAccess.h>
#include <drvSup.h>
#include <epicsStdio.h>
#include <epicsStdlib.h>
#include <epicsString.h>
#include <errlog.h>
#include <iocsh.h>

#include "drvEtherIP.h"
#include "eipPlc.h"
#include "eipQuestions.h"
#include "plcComplete.h"
#include "plcConfigure.h"
#include "plcDriver.h"

#include <epicsExport.h>

enum {
    imageSize = 524288,
    imageSizeMax = 16 << 20,
    defaultTimeout = 2000, /* ms */
    timeoutMin = 10,
    timeoutMax = 60000,
    roomMin = 100, /* bytes of a message */
    roomMax = 1400
};

double drvEtherIP_default_rate = 0;
int EIP_verbosity = 4;
double EIP_TIMEOUT = 0;
unsigned EIP_buffer_limit = 0;
unsigned EIP_image_size = imageSize;

/* Variables that C code may have set to anything: what is not possible counts as not set. */
static double timeoutMs(void)
{
    return EIP_TIMEOUT >= timeoutMin && EIP_TIMEOUT <= timeoutMax ? EIP_TIMEOUT
                                                                  : defaultTimeout;
}

static unsigned roomOf(void)
{
    return EIP_buffer_limit >= roomMin && EIP_buffer_limit < eipUnconnectedRoom
               ? EIP_buffer_limit
               : eipUnconnectedRoom;
}

static eipPlcSetup setupOf(void)
{
    eipPlcSetup setup = {.imageSize = EIP_image_size,
                         .room = roomOf(),
                         .size = eipSizeLarge,
                         .connected = 1,
                         .instances = eipInstancesAuto};

    return setup;
}

static void setTimeout(eipPlc *plc, void *arg)
{
    char text[40], error[200];

    (void)arg;
    epicsSnprintf(text, sizeof(text), "%g", timeoutMs());
    if (plcStationSetOption(plc->station, "requestTimeout", text, error, sizeof(error)))
        errlogSevPrintf(errlogMajor, "EtherIP %s: %s\n", plc->name, error);
}

/* --- Definition ------------------------------------------------------------------------------- */

/* "slot" or a route with commas. Returns 0, or -1 after the error line. */
static int routeOf(const char *command, const char *name, const char *text, eipRoute *route)
{
    char whole[100], error[200];
    epicsUInt32 slot;

    if (!strchr(text, ',') && strcmp(text, "-1") &&
        (epicsParseUInt32(text, &slot, 10, NULL) || slot > 255 || strchr(text, '-')))
        strcpy(whole, ","); /* refused below */
    else if (strchr(text, ',') || strcmp(text, "-1") == 0)
        epicsSnprintf(whole, sizeof(whole), "%s", text);
    else
        epicsSnprintf(whole, sizeof(whole), "1,%s", text);
    if (strlen(text) < 90 && eipRouteParse(whole, route, error, sizeof(error)) == 0)
        return 0;
    plcConfigureRefuse(command, name, "slot \"%.60s\"; allowed: 0 to 255, -1 (the address is "
                       "that of the controller), or a route as 1,6,18,10.0.0.4,1,0", text);
    return -1;
}

/* "image=65536" */
static int isNumber(const char *word, const char *key, epicsUInt32 low, epicsUInt32 high,
                    epicsUInt32 *number)
{
    size_t n = strlen(key);

    return strncmp(word, key, n) == 0 && epicsParseUInt32(word + n, number, 10, NULL) == 0 &&
           *number >= low && *number <= high && !strchr(word, '-');
}

/* One word of etheripConfigure's options. Returns 0, or -1 after the error line. */
static int setupWord(const char *command, const char *name, const char *word,
                     eipPlcSetup *setup)
{
    static const struct {
        const char *word;
        int connected, instances; /* -1: stays */
    } words[] = {{"connected=no", 0, -1},
                 {"connected=auto", 1, -1},
                 {"instances=no", -1, eipInstancesNo},
                 {"instances=auto", -1, eipInstancesAuto},
                 {"instances=always", -1, eipInstancesAlways}};
    epicsUInt32 number;
    size_t i;

    for (i = 0; i < sizeof(words) / sizeof(words[0]); i++)
        if (strcmp(word, words[i].word) == 0) {
            if (words[i].connected >= 0)
                setup->connected = words[i].connected;
            else
                setup->instances = (eipInstances)words[i].instances;
            return 0;
        }
    if (isNumber(word, "image=", 64, imageSizeMax, &number))
        setup->imageSize = number;
    else if (isNumber(word, "size=", 100, 65535, &number))
        setup->size = number;
    else if (isNumber(word, "buffer=", 100, 1400, &number))
        setup->room = number;
    else {
        plcConfigureRefuse(command, name, "option \"%.40s\"; allowed: image=64 to 16777216, "
                           "size=100 to 65535 (bytes of a connection), buffer=100 to 1400 "
                           "(bytes of a message without one), connected=auto or no, "
                           "instances=auto, no or always", word);
        return -1;
    }
    return 0;
}

static int setupWords(const char *command, const char *name, const char *text,
                      eipPlcSetup *setup)
{
    char *copy = epicsStrDup(text), *save = NULL, *word;
    int status = 0;

    for (word = epicsStrtok_r(copy, " \t", &save); word && !status;
         word = epicsStrtok_r(NULL, " \t", &save))
        status = setupWord(command, name, word, setup);
    free(copy);
    return status;
}

static int define(const char *command, const char *name, const char *ip, const char *slot,
                  const char *options)
{
    eipPlcSetup setup = setupOf();
    eipPlc *plc;

    if (routeOf(command, name, slot ? slot : "0", &setup.route) ||
        (options && setupWords(command, name, options, &setup)))
        return -1;
    plc = eipPlcCreate(command, name, ip, &setup);
    if (!plc)
        return -1;
    setTimeout(plc, NULL);
    return 0;
}

/* A PLC that is there already gets another address; without a port, the usual one. */
static int redefine(const char *command, eipPlc *plc, const char *ip, const char *slot)
{
    char address[300], error[200];

    ip = ip ? ip : "";
    epicsSnprintf(address, sizeof(address), *ip && !strchr(ip, ':') ? "%.280s:%d" : "%.280s",
                  ip, eipTcpPort);
    if (routeOf(command, plc->name, slot ? slot : "0", &plc->connect.route))
        return -1;
    eipWorkerSetConnect(plc->worker, &plc->connect);
    if (plcStationMove(plc->station, address, error, sizeof(error))) {
        plcConfigureRefuse(command, plc->name, "%s", error);
        return -1;
    }
    errlogSevPrintf(errlogInfo, "%s %s: it is there already; its address is %s now\n", command,
                    plc->name, address);
    return 0;
}

static int defineText(const char *name, const char *ip, const char *slot)
{
    static const char command[] = "drvEtherIP_define_PLC";
    eipPlc *plc = name ? eipPlcFind(name) : NULL;

    return plc ? redefine(command, plc, ip, slot) : define(command, name, ip, slot, NULL);
}

int drvEtherIP_define_PLC(const char *PLC, const char *ip, int slot)
{
    char text[20];

    epicsSnprintf(text, sizeof(text), "%d", slot);
    return defineText(PLC, ip, text);
}

void drvEtherIP_init(void)
{
}

/* --- Reports ---------------------------------------------------------------------------------- */

static void reportPlc(eipPlc *plc, void *arg)
{
    plcStationReport(plc->station, stdout, *(int *)arg);
}

void drvEtherIP_report(int level)
{
    eipPlcEach(reportPlc, &level);
}

static void dumpTag(const eipTag *tag, void *arg)
{
    const eipType *type = eipTypeOf(tag->code);
    char name[eipNameMax + 16];

    (void)arg;
    epicsSnprintf(name, sizeof(name), tag->indexed ? "%.*s,*]" : "%.*s",
                  (int)strlen(tag->base) - tag->indexed, tag->base);
    printf("  %-40s ", name);
    if (tag->state == eipTagKnown)
        printf("%s, %u bytes, every %g s", type ? type->name : "?", tag->size,
               tag->period / 1000.0);
    else
        printf("%s", tag->state == eipTagBad ? tag->reason : "not asked for yet");
    if (tag->instance)
        printf(", instance %u", tag->instance);
    printf("\n");
}

static void dumpPlc(eipPlc *plc, void *arg)
{
    (void)arg;
    printf("%s:\n", plc->name);
    eipWorkerEachTag(plc->worker, dumpTag, NULL);
}

void drvEtherIP_dump(void)
{
    eipPlcEach(dumpPlc, NULL);
}

static void resetPlc(eipPlc *plc, void *arg)
{
    (void)arg;
    eipWorkerTimesReset(plc->worker);
    plcStationStatsReset(plc->station);
}

void drvEtherIP_reset_statistics(void)
{
    eipPlcEach(resetPlc, NULL);
}

static void restartPlc(eipPlc *plc, void *arg)
{
    (void)arg;
    eipWorkerSetConnect(plc->worker, &plc->connect);
    plcStationReconnect(plc->station);
}

void drvEtherIP_restart(void)
{
    eipPlcEach(restartPlc, NULL);
}

void drvEtherIP_help(void)
{
    printf("drvEtherIP_define_PLC PLC, ip[:port], slot     makes a PLC; slot -1: none\n"
           "etheripConfigure PLC, ip[:port], slot or route, options\n"
           "drvEtherIP_default_rate seconds                for links without a period\n"
           "EIP_timeout ms, EIP_buffer_limit bytes         of all PLCs\n"
           "drvEtherIP_report level, drvEtherIP_dump       PLCs, tags\n"
           "drvEtherIP_list [PLC, pattern]                 tags of the controllers\n"
           "drvEtherIP_describe [PLC,] type or tag         members of a structure, by number or name\n"
           "drvEtherIP_read_tag ip, slot, tag, elements, timeout\n"
           "drvEtherIP_reset_statistics, drvEtherIP_restart\n");
}

/* --- Questions with a connection of their own ------------------------------------------------- */

int drvEtherIP_list(const char *PLC, const char *pattern)
{
    return eipQuestionList("drvEtherIP_list", PLC, pattern, (unsigned)timeoutMs());
}

int drvEtherIP_describe(const char *PLC, int type)
{
    return eipQuestionDescribe("drvEtherIP_describe", PLC, NULL, type, (unsigned)timeoutMs());
}

int drvEtherIP_read_tag(const char *ip, int slot, const char *tag, int elements, int timeout)
{
    eipConnectOptions options = {.size = eipSizeLarge, .room = eipUnconnectedRoom,
                                 .connected = 1};
    char text[20];

    epicsSnprintf(text, sizeof(text), "%d", slot);
    if (!ip || !tag) {
        errlogSevPrintf(errlogMajor, "EtherIP drvEtherIP_read_tag: needs ip, slot, tag [, elements, "
                        "timeout ms]\n");
        return -1;
    }
    if (routeOf("drvEtherIP_read_tag", ip, text, &options.route))
        return -1;
    options.timeout = timeout > 0 ? (unsigned)timeout : (unsigned)timeoutMs();
    return eipQuestionRead(ip, &options, tag, elements > 0 ? (unsigned)elements : 1);
}

/* --- iocsh ------------------------------------------------------------------------------------ */

static const iocshArg newArg = {"PLC", iocshArgString};
static const iocshArg plcArg = {"PLC", PLC_ARG_STATION};
static const iocshArg ipArg = {"ip[:port]", iocshArgString};
static const iocshArg slotArg = {"slot [0]", iocshArgString};
static const iocshArg routeArg = {"slot or route [0]", iocshArgString};
static const iocshArg optionsArg = {"options", iocshArgString};
static const iocshArg secondsArg = {"seconds", iocshArgString};
static const iocshArg msArg = {"ms", iocshArgString};
static const iocshArg waitArg = {"ms", iocshArgString};
static const iocshArg bytesArg = {"bytes", iocshArgString};
static const iocshArg verbosityArg = {"level", iocshArgString};
static const iocshArg levelArg = {"level [0]", iocshArgString};
static const iocshArg patternArg = {"pattern", iocshArgString};
static const iocshArg typeArg = {"type", iocshArgString};
static const iocshArg numberArg = {"slot", iocshArgString};
static const iocshArg tagArg = {"tag", iocshArgString};
static const iocshArg elementsArg = {"elements [1]", iocshArgString};

static const iocshArg *const defineArgs[] = {&newArg, &ipArg, &slotArg};
static const iocshArg *const configureArgs[] = {&newArg, &ipArg, &routeArg, &optionsArg};
static const iocshArg *const rateArgs[] = {&secondsArg};
static const iocshArg *const msArgs[] = {&msArg};
static const iocshArg *const bytesArgs[] = {&bytesArg};
static const iocshArg *const levelArgs[] = {&levelArg};
static const iocshArg *const verbosityArgs[] = {&verbosityArg};
static const iocshArg *const listArgs[] = {&plcArg, &patternArg};
static const iocshArg *const describeArgs[] = {&plcArg, &typeArg};
static const iocshArg *const readArgs[] = {&ipArg, &numberArg, &tagArg, &elementsArg, &waitArg};

static void initCall(const iocshArgBuf *args)
{
    (void)args;
    drvEtherIP_init();
}

static void defineCall(const iocshArgBuf *args)
{
    iocshSetError(defineText(args[0].sval, args[1].sval, args[2].sval));
}

static void configureCall(const iocshArgBuf *args)
{
    iocshSetError(define("etheripConfigure", args[0].sval, args[1].sval, args[2].sval,
                         args[3].sval));
}

/* A number as text within its limits. Returns 0; or -1 after one line: the setting stays. */
static int setting(const char *command, const iocshArgBuf *arg, double low, double high,
                   const char *unit, double *value)
{
    if (arg->sval && epicsParseDouble(arg->sval, value, NULL) == 0 && *value >= low &&
        *value <= high)
        return 0;
    errlogSevPrintf(errlogMajor, "%s \"%.40s\"; allowed: %.10g to %.10g%s\n", command,
                    arg->sval ? arg->sval : "", low, high, unit);
    iocshSetError(-1);
    return -1;
}

/* The same, of whole numbers: a fraction would be cut without a word. */
static int wholeSetting(const char *command, const iocshArgBuf *arg, int low, int high,
                        const char *unit, int *value)
{
    if (arg->sval && epicsParseInt32(arg->sval, value, 0, NULL) == 0 && *value >= low &&
        *value <= high)
        return 0;
    errlogSevPrintf(errlogMajor, "%s \"%.40s\"; allowed: %d to %d%s, a whole number\n", command,
                    arg->sval ? arg->sval : "", low, high, unit);
    iocshSetError(-1);
    return -1;
}

/* Records that are there have theirs. */
static void rateCall(const iocshArgBuf *args)
{
    double seconds;

    if (setting("drvEtherIP_default_rate", args, 0, 86400, " s (0: none)", &seconds))
        return;
    drvEtherIP_default_rate = seconds;
    if (interruptAccept)
        errlogSevPrintf(errlogInfo, "drvEtherIP_default_rate %g: for links that change from now "
                        "on; those of iocInit keep theirs\n", seconds);
}

static void verbosityCall(const iocshArgBuf *args)
{
    int level;

    if (wholeSetting("EIP_verbosity", args, 0, 10, "", &level) == 0)
        EIP_verbosity = level;
}

static void timeoutCall(const iocshArgBuf *args)
{
    double ms;

    if (setting("EIP_timeout", args, timeoutMin, timeoutMax, " ms", &ms))
        return;
    EIP_TIMEOUT = ms;
    eipPlcEach(setTimeout, NULL);
}

static void setRoom(eipPlc *plc, void *arg)
{
    (void)arg;
    plc->connect.room = roomOf();
    eipWorkerSetConnect(plc->worker, &plc->connect);
}

static void limitCall(const iocshArgBuf *args)
{
    int bytes;

    if (wholeSetting("EIP_buffer_limit", args, roomMin, roomMax, " bytes", &bytes))
        return;
    EIP_buffer_limit = (unsigned)bytes;
    eipPlcEach(setRoom, NULL);
}

static void imageCall(const iocshArgBuf *args)
{
    int bytes;

    if (wholeSetting("drvEtherIP_image_size", args, 64, imageSizeMax, " bytes", &bytes) == 0)
        EIP_image_size = (unsigned)bytes;
}

static void reportCall(const iocshArgBuf *args)
{
    int level = 0;

    if (!args[0].sval || wholeSetting("drvEtherIP_report", args, 0, 99, "", &level) == 0)
        drvEtherIP_report(level);
}

static void dumpCall(const iocshArgBuf *args)
{
    (void)args;
    drvEtherIP_dump();
}

static void listCall(const iocshArgBuf *args)
{
    iocshSetError(drvEtherIP_list(args[0].sval, args[1].sval));
}

/* As ether_ip has it, the type alone: of all PLCs. */
static void describeCall(const iocshArgBuf *args)
{
    const char *text = args[1].sval ? args[1].sval : args[0].sval;
    const char *plc = args[1].sval ? args[0].sval : NULL;
    epicsInt32 type = 1;
    int isNumber = text && epicsParseInt32(text, &type, 0, NULL) == 0;

    if (!text || !*text || type < 1 || type > 4095) {
        errlogSevPrintf(errlogMajor, "EtherIP drvEtherIP_describe: needs [PLC,] type or tag; allowed: "
                        "1 to 4095, or the name of a type or tag\n");
        iocshSetError(-1);
        return;
    }
    iocshSetError(eipQuestionDescribe("drvEtherIP_describe", plc, isNumber ? NULL : text, type,
                                      (unsigned)timeoutMs()));
}

static void resetCall(const iocshArgBuf *args)
{
    (void)args;
    drvEtherIP_reset_statistics();
}

static void restartCall(const iocshArgBuf *args)
{
    (void)args;
    drvEtherIP_restart();
}

static void helpCall(const iocshArgBuf *args)
{
    (void)args;
    drvEtherIP_help();
}

static void readCall(const iocshArgBuf *args)
{
    static const char command[] = "drvEtherIP_read_tag";
    int slot = 0, elements = 1, timeout = 0;

    if ((args[1].sval && wholeSetting(command, args + 1, -1, 255, " (slot)", &slot)) ||
        (args[3].sval && wholeSetting(command, args + 3, 0, 65535, " elements (0: one)", &elements)) ||
        (args[4].sval &&
         wholeSetting(command, args + 4, 0, timeoutMax, " ms (0: EIP_timeout)", &timeout)))
        return;
    iocshSetError(drvEtherIP_read_tag(args[0].sval, slot, args[2].sval, elements, timeout));
}

#ifdef IOCSHFUNCDEF_HAS_USAGE
#define USAGE(text) , text
#else
#define USAGE(text)
#endif

static const struct {
    iocshFuncDef def;
    iocshCallFunc call;
} commands[] = {
    {{"drvEtherIP_init", 0, NULL USAGE("Kept for scripts; nothing needs it.\n")}, initCall},
    {{"drvEtherIP_define_PLC", 3, defineArgs USAGE(
        "Makes a PLC; slot -1: the address is that of the controller itself.\n"
        "  drvEtherIP_define_PLC plc1, 160.91.232.217, 0\n")}, defineCall},
    {{"etheripConfigure", 4, configureArgs USAGE(
        "The same with a route and options: image=bytes size=bytes buffer=bytes connected=no "
        "instances=no\n"
        "  etheripConfigure plc1, 10.0.0.4:44818, \"1,6,18,10.206.1.40,1,4\", image=262144\n")},
     configureCall},
    {{"drvEtherIP_default_rate", 1, rateArgs USAGE("Period of links without one.\n")}, rateCall},
    {{"EIP_verbosity", 1, verbosityArgs USAGE("Kept for scripts; has no effect.\n")}, verbosityCall},
    {{"EIP_timeout", 1, msArgs USAGE(
        "Time for each answer, of all PLCs; option requestTimeout.\n")},
     timeoutCall},
    {{"EIP_buffer_limit", 1, bytesArgs USAGE(
        "Bytes of a message without connection, of all PLCs, from their next session on.\n")}, limitCall},
    {{"drvEtherIP_image_size", 1, bytesArgs USAGE(
        "Bytes for the tags of a PLC, of PLCs defined from then on: 16 for each number.\n")},
     imageCall},
    {{"drvEtherIP_report", 1, levelArgs USAGE("PLCs, level 0 to 2.\n")}, reportCall},
    {{"drvEtherIP_dump", 0, NULL USAGE("All tags that records use.\n")}, dumpCall},
    {{"drvEtherIP_list", 2, listArgs USAGE("Tags of the controllers.\n")}, listCall},
    {{"drvEtherIP_describe", 2, describeArgs USAGE("Members of a structure.\n")}, describeCall},
    {{"drvEtherIP_reset_statistics", 0, NULL USAGE("Of all PLCs.\n")}, resetCall},
    {{"drvEtherIP_restart", 0, NULL USAGE("Connects all PLCs anew.\n")}, restartCall},
    {{"drvEtherIP_help", 0, NULL USAGE("Lists these commands.\n")}, helpCall},
    {{"drvEtherIP_read_tag", 5, readArgs USAGE(
        "Reads a tag, on a connection of its own.\n")}, readCall},
};

static void drvEtherIP_Register(void)
{
    size_t i;

    plcDriverRegister();
    for (i = 0; i < sizeof(commands) / sizeof(commands[0]); i++)
        iocshRegister(&commands[i].def, commands[i].call);
}
epicsExportRegistrar(drvEtherIP_Register);

/* --- Driver entry ----------------------------------------------------------------------------- */

static long init(void)
{
    plcDriverInit();
    return 0;
}

static long report(int level)
{
    drvEtherIP_report(level);
    return 0;
}

static drvet drvEtherIP = {2, (DRVSUPFUN)report, (DRVSUPFUN)init};
epicsExportAddress(drvet, drvEtherIP);
