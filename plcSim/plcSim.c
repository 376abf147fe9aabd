/* plcSim: the PLC side of blocks, Modbus and EtherNet/IP, for demonstrations and tests.
 * This file reads the command line, puts the parts together and ends them. docs/plcsim.md
 * tells how to use it.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <arpa/inet.h>
#include <getopt.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <epicsString.h>

#include "simCommand.h"
#include "simConsole.h"
#include "simDial.h"
#include "simServers.h"

#define MAX_COMMANDS 64
#define TEXT(x) #x
#define TEXT_OF(x) TEXT(x) /* of what the Makefile defines */

typedef struct options {
    const char *file;
    const char *address;
    const char *port;
    const char *console;
    const char *dial; /* talk to the console of another one */
    char **words;     /* ... this command */
    int wordCount;
    const char *commands[MAX_COMMANDS];
    int commandCount;
    char *settings[MAX_COMMANDS]; /* key=value */
    int settingCount;
    int noStdin, check;
    double seconds; /* 0 = run until told to end */
} options;

static int wakeup[2]; /* a signal handler may only write to a pipe */

static void onSignal(int number)
{
    char c = (char)number;

    if (write(wakeup[1], &c, 1) < 0)
        _exit(1);
}

static void onWakeup(void *arg, int fd, short revents)
{
    simulator *sim = arg;

    (void)fd;
    (void)revents;
    sim->loop.quit = 1;
}

static int usage(FILE *fp)
{
    simText keys = {NULL, 0, 0};
    simConfig config;

    simConfigInit(&config);
    simServersKeys(&config);
    simConfigHelp(&config, &keys);
    simConfigFree(&config);
    fprintf(
        fp,
        "usage: plcSim [options] file.plc\n"
        "       plcSim --connect <path> [command]\n"
        "  -a, --address <address>   listen there, whatever the file says\n"
        "  -p, --port <port>         0 = any free port; the port is printed\n"
        "  -o, --option <key=value>  set a key of the file\n"
        "  -c, --console <path>      take commands on this unix socket too\n"
        "  -e, --execute <command>   run a console command at start; may be repeated\n"
        "  -C, --connect <path>      send a command, or those of stdin, to the console "
        "of a\n"
        "                            simulator that runs\n"
        "  -n, --no-stdin            take no commands from stdin\n"
        "  -q, --quiet               print only where it listens, and errors\n"
        "  -s, --seconds <n>         end after n seconds\n"
        "  -k, --check               check the file, then end\n"
        "  -V, --version             print the release of plclink\n"
        "  -h, --help                this text\n"
        "\nKeys of the file, with their defaults:\n%s"
        "\nStatements of the file: docs/plcsim.md. Type `help` for commands.\n",
        keys.text);
    simTextFree(&keys);
    return fp == stderr;
}

/* Returns -1 to go on, else the exit status. */
static int readOptions(options *opt, int argc, char **argv)
{
    static const struct option longOptions[] = {
        {"address",  required_argument, NULL, 'a'},
        {"port",     required_argument, NULL, 'p'},
        {"option",   required_argument, NULL, 'o'},
        {"console",  required_argument, NULL, 'c'},
        {"execute",  required_argument, NULL, 'e'},
        {"connect",  required_argument, NULL, 'C'},
        {"no-stdin", no_argument,       NULL, 'n'},
        {"quiet",    no_argument,       NULL, 'q'},
        {"seconds",  required_argument, NULL, 's'},
        {"check",    no_argument,       NULL, 'k'},
        {"version",  no_argument,       NULL, 'V'},
        {"help",     no_argument,       NULL, 'h'},
        {NULL,       0,                 NULL, 0  },
    };
    int c;

    memset(opt, 0, sizeof(*opt));
    while ((c = getopt_long(argc, argv, "a:p:o:c:e:C:nqs:kVh", longOptions, NULL)) != -1) {
        switch (c) {
        case 'a':
            opt->address = optarg;
            break;
        case 'p':
            opt->port = optarg;
            break;
        case 'o':
            if (opt->settingCount < MAX_COMMANDS)
                opt->settings[opt->settingCount++] = optarg;
            break;
        case 'c':
            opt->console = optarg;
            break;
        case 'e':
            if (opt->commandCount < MAX_COMMANDS)
                opt->commands[opt->commandCount++] = optarg;
            break;
        case 'C': /* the rest is the command, also words such as -5 */
            opt->dial = optarg;
            opt->words = argv + optind;
            opt->wordCount = argc - optind;
            return -1;
        case 'n':
            opt->noStdin = 1;
            break;
        case 'q':
            simLogQuiet(1);
            break;
        case 's':
            opt->seconds = atof(optarg);
            break;
        case 'k':
            opt->check = 1;
            break;
        case 'V':
            printf("plcSim, plclink %s\n", TEXT_OF(PLCLINK_VERSION));
            return 0;
        case 'h':
            return usage(stdout);
        default:
            return usage(stderr);
        }
    }
    if (optind != argc - 1)
        return usage(stderr);
    opt->file = argv[optind];
    return -1;
}

/* Sets one key from the command line. Returns the number of errors. */
static int override(simulator *sim, const char *key, const char *value)
{
    char error[SIM_ERROR_SIZE];

    if (simConfigSet(&sim->config, key, value, error) == 0)
        return 0;
    fprintf(stderr, "plcSim: %s\n", error);
    return 1;
}

static int overrideAll(simulator *sim, const options *opt)
{
    int errors = 0;
    int i;

    for (i = 0; i < opt->settingCount; i++) {
        /* NOLINTNEXTLINE(clang-analyzer-core.NonNullParamChecker): -o always has its word */
        char *equals = strchr(opt->settings[i], '=');

        if (!equals) {
            fprintf(stderr, "plcSim: -o %s: allowed is key=value\n", opt->settings[i]);
            errors++;
            continue;
        }
        *equals = 0;
        errors += override(sim, opt->settings[i], equals + 1);
    }
    if (opt->address)
        errors += override(sim, sim->config.role == simSecond ? "second" : "address",
                           opt->address);
    if (opt->port)
        errors += override(sim, "port", opt->port);
    return errors;
}

/* SECOND has the address of FIRST plus one when the file does not say another. */
static int nextAddress(simConfig *config)
{
    struct in_addr ip;

    if (config->second[0])
        return 0;
    if (inet_pton(AF_INET, config->address, &ip) != 1) {
        fprintf(stderr, "plcSim: address = %s has no next one: set `second`\n",
                config->address);
        return 1;
    }
    ip.s_addr = htonl(ntohl(ip.s_addr) + 1);
    inet_ntop(AF_INET, &ip, config->second, sizeof(config->second));
    return 0;
}

/* Reads the file, lets options override it, and builds the PLCs. Returns 0 or -1. */
static int configure(simulator *sim, const options *opt)
{
    static const char *const names[][2] = {
        {NULL,     NULL    },
        {"FIRST",  "SECOND"},
        {"FIRST",  NULL    },
        {"SECOND", NULL    }
    };
    simConfig *config = &sim->config;
    simText messages = {NULL, 0, 0};
    int errors, i;

    simConfigInit(config);
    simServersKeys(config);
    errors = simConfigRead(config, opt->file);
    errors += overrideAll(sim, opt);
    sim->isPair = config->role != simSingle;
    if (sim->isPair)
        errors += nextAddress(config);
    if (config->role > simBoth && !config->fibre[0]) {
        fprintf(stderr, "plcSim: half of a pair needs fibre = host:port or a path\n");
        errors++;
    }
    sim->count = config->role == simBoth ? 2 : 1;
    for (i = 0; i < sim->count; i++) {
        simTextFree(&messages); /* both say the same */
        if (simPlcBuild(&sim->plc[i], &sim->loop, config, simServers,
                        sim->isPair ? names[config->role][i] : config->name, &messages))
            errors++;
    }
    if (messages.text)
        fputs(messages.text, stderr);
    simTextFree(&messages);
    return errors ? -1 : 0;
}

static void sayListening(const simPlc *plc)
{
    size_t i;

    for (i = 0; i < plc->serverCount; i++) {
        const simServerType *type = plc->servers[i].type;
        const char *address = type->address(plc->servers[i].state);

        if (address)
            simSay("plcSim: %s %s%slistening on %s", plc->name, type->title,
                   type->title[0] ? " " : "", address);
    }
}

/* Both halves listen on the same port: with port 0, on one that is free for both. */
static int startServers(simulator *sim)
{
    const simConfig *config = &sim->config;
    int tries, status = 1;

    if (config->role == simSecond)
        return simPlcStart(&sim->plc[0], config->second, NULL);
    for (tries = 20; tries > 0 && status > 0; tries--) {
        status = simPlcStart(&sim->plc[0], config->address, NULL);
        if (status || sim->count == 1)
            return status;
        status = simPlcStart(&sim->plc[1], config->second, &sim->plc[0]);
        if (status) {
            simPlcStop(&sim->plc[0]);
            simPlcStop(&sim->plc[1]);
        }
    }
    return status;
}

static int startPair(simulator *sim)
{
    const simConfig *config = &sim->config;
    int i;

    for (i = 0; i < sim->count; i++) {
        int isFirst = config->role != simSecond && i == 0;
        double wait = config->role == simFirst    ? config->switchover
                      : config->role == simSecond ? config->startWait
                      : isFirst                   ? 0
                                                  : config->switchover;

        simPairInit(&sim->pair[i], &sim->loop, &sim->plc[i], isFirst, config->switchover,
                    wait, config->interface[!isFirst]);
    }
    if (sim->count == 2)
        simFibreJoin(&sim->pair[0].fibre, &sim->pair[1].fibre);
    else if (simFibreOpen(&sim->pair[0].fibre, config->fibre, config->role == simFirst))
        return -1;
    for (i = 0; i < sim->count; i++)
        simPairStart(&sim->pair[i]);
    return 0;
}

static int start(simulator *sim)
{
    int i;

    if (startServers(sim))
        return -1;
    for (i = 0; i < sim->count; i++)
        sayListening(&sim->plc[i]);
    return sim->isPair ? startPair(sim) : 0;
}

static void stop(simulator *sim)
{
    int i;

    for (i = 0; i < sim->count; i++) {
        simPairStop(&sim->pair[i]);
        sim->plc[i].changed = NULL;
        simPlcStop(&sim->plc[i]);
    }
}

static void runCommands(simulator *sim, const options *opt)
{
    simText answer = {NULL, 0, 0};
    int i;

    for (i = 0; i < opt->commandCount; i++) {
        char *line = epicsStrDup(opt->commands[i]);

        simCommandRun(sim, line, &answer);
        free(line);
    }
    if (answer.text)
        fputs(answer.text, stdout);
    fflush(stdout);
    simTextFree(&answer);
}

static void catchSignals(simulator *sim)
{
    struct sigaction action;

    memset(&action, 0, sizeof(action));
    action.sa_handler = onSignal;
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    action.sa_handler = SIG_IGN;
    sigaction(SIGPIPE, &action, NULL);
    simLoopWatch(&sim->loop, wakeup[0], POLLIN, onWakeup, sim);
}

int main(int argc, char **argv)
{
    static simulator sim;
    static simConsole console;
    options opt;
    int status = readOptions(&opt, argc, argv);
    int i;

    if (status >= 0)
        return status;
    if (opt.dial)
        return simDial(opt.dial, opt.words, opt.wordCount);
    simLoopInit(&sim.loop);
    simConsoleInit(&console, &sim);
    status = 1;
    if (pipe(wakeup) || configure(&sim, &opt))
        goto done;
    if (opt.check) {
        status = 0;
        goto done;
    }
    catchSignals(&sim);
    if (start(&sim))
        goto stop;
    if (opt.console) {
        if (simConsoleListen(&console, opt.console))
            goto stop;
        simSay("plcSim: console on %s", opt.console);
    }
    if (!opt.noStdin)
        simConsoleStdin(&console);
    runCommands(&sim, &opt);
    simLoopRun(&sim.loop, opt.seconds > 0 ? simNow() + opt.seconds : 0);
    simLog("plcSim", "ends");
    status = 0;
stop:
    simConsoleClose(&console);
    stop(&sim);
done:
    for (i = 0; i < sim.count; i++)
        simPlcFree(&sim.plc[i]);
    simConfigFree(&sim.config);
    simLoopFree(&sim.loop);
    return status;
}
