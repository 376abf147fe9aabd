/* plcSim: the PLC side of block TCP, for demonstrations and tests. This file reads the
 * command line, puts the parts together and ends them. docs/plcsim.md tells how to use it.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <fcntl.h>
#include <getopt.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "simCommand.h"
#include "simConsole.h"

#define MAX_COMMANDS 64

typedef struct options {
    const char *file;
    const char *address;
    const char *port;
    const char *console;
    const char *commands[MAX_COMMANDS];
    int commandCount;
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

    simConfigHelp(&keys);
    fprintf(fp,
            "usage: plcSim [options] file.plc\n"
            "  -a, --address <address>   listen there, whatever the file says\n"
            "  -p, --port <port>         0 = any free port; the port is printed\n"
            "  -c, --console <path>      take commands on this unix socket too\n"
            "  -e, --execute <command>   run a console command at start; may be repeated\n"
            "  -n, --no-stdin            take no commands from stdin\n"
            "  -q, --quiet               print only where it listens, and errors\n"
            "  -s, --seconds <n>         end after n seconds\n"
            "  -k, --check               check the file, then end\n"
            "  -h, --help                this text\n"
            "\nKeys of the file, with their defaults:\n%s"
            "\nStatements of the file: db, init, signal, mirror. Type `help` for commands.\n",
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
        {"console",  required_argument, NULL, 'c'},
        {"execute",  required_argument, NULL, 'e'},
        {"no-stdin", no_argument,       NULL, 'n'},
        {"quiet",    no_argument,       NULL, 'q'},
        {"seconds",  required_argument, NULL, 's'},
        {"check",    no_argument,       NULL, 'k'},
        {"help",     no_argument,       NULL, 'h'},
        {NULL,       0,                 NULL, 0  },
    };
    int c;

    memset(opt, 0, sizeof(*opt));
    while ((c = getopt_long(argc, argv, "a:p:c:e:nqs:kh", longOptions, NULL)) != -1) {
        switch (c) {
        case 'a':
            opt->address = optarg;
            break;
        case 'p':
            opt->port = optarg;
            break;
        case 'c':
            opt->console = optarg;
            break;
        case 'e':
            if (opt->commandCount < MAX_COMMANDS)
                opt->commands[opt->commandCount++] = optarg;
            break;
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

/* Reads the file, lets options override it, and builds the PLC. Returns 0 or -1. */
static int configure(simulator *sim, const options *opt)
{
    simText messages = {NULL, 0, 0};
    char error[SIM_ERROR_SIZE];
    int errors;

    simConfigInit(&sim->config);
    errors = simConfigRead(&sim->config, opt->file);
    if ((opt->address && simConfigSet(&sim->config, "address", opt->address, error)) ||
        (opt->port && simConfigSet(&sim->config, "port", opt->port, error))) {
        fprintf(stderr, "plcSim: %s\n", error);
        errors++;
    }
    sim->count = 1;
    errors += simPlcBuild(&sim->plc[0], &sim->loop, &sim->config, sim->config.name, &messages);
    if (messages.text)
        fputs(messages.text, stderr);
    simTextFree(&messages);
    return errors ? -1 : 0;
}

static int start(simulator *sim)
{
    simPlc *plc = &sim->plc[0];

    if (simPlcStart(plc, sim->config.address, sim->config.port))
        return -1;
    simSay("plcSim: %s listening on %s", plc->name, simServerAddress(&plc->server));
    return 0;
}

static void runCommands(simulator *sim, const options *opt)
{
    simText answer = {NULL, 0, 0};
    int i;

    for (i = 0; i < opt->commandCount; i++) {
        char *line = strdup(opt->commands[i]);

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

    if (status >= 0)
        return status;
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
    simServerClose(&sim.plc[0].server);
done:
    simPlcFree(&sim.plc[0]);
    simConfigFree(&sim.config);
    simLoopFree(&sim.loop);
    return status;
}
