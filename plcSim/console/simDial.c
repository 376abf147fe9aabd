/* simDial: the other end of the console: sends command lines to a simulator that runs,
 * and prints the answers. It waits, and knows nothing of a PLC.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "simDial.h"

#define MAX_LINE 4096 /* as the console takes them */
#define PROMPT "plcSim> "

static FILE *dial(const char *path)
{
    struct sockaddr_un address;
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);

    memset(&address, 0, sizeof(address));
    address.sun_family = AF_UNIX;
    if (strlen(path) >= sizeof(address.sun_path))
        errno = ENAMETOOLONG;
    else {
        strcpy(address.sun_path, path);
        if (fd >= 0 && !connect(fd, (struct sockaddr *)&address, sizeof(address)))
            return fdopen(fd, "r+");
    }
    fprintf(stderr, "plcSim: no console at %s: %s\n", path, strerror(errno));
    if (fd >= 0)
        close(fd);
    return NULL;
}

/* Sends one line and prints its answer. Returns 0, 1 for an error, -1 when the simulator
 * is gone. */
static int ask(FILE *console, const char *line)
{
    char answer[MAX_LINE];

    if (fprintf(console, "%s\n", line) < 0 || fflush(console))
        return -1;
    while (fgets(answer, sizeof(answer), console)) {
        if (!strcmp(answer, "ok\n"))
            return 0;
        if (!strncmp(answer, "error: ", 7)) {
            fputs(answer, stderr);
            return 1;
        }
        fputs(answer, stdout);
    }
    return -1;
}

static int isBlank(const char *line)
{
    line += strspn(line, " \t");
    return !*line || *line == '#';
}

/* Lines of stdin until its end. Returns as ask(). */
static int askAll(FILE *console)
{
    int terminal = isatty(STDIN_FILENO);
    char line[MAX_LINE];
    int status = 0;

    while (status >= 0) {
        if (terminal) {
            fputs(PROMPT, stdout);
            fflush(stdout);
        }
        if (!fgets(line, sizeof(line), stdin))
            break;
        line[strcspn(line, "\n")] = 0;
        if (isBlank(line)) /* gets no answer */
            continue;
        status = ask(console, line);
        fflush(stdout);
    }
    return status;
}

static int askWords(FILE *console, char **words, int count)
{
    char line[MAX_LINE] = "";
    size_t length = 0;
    int i;

    for (i = 0; i < count; i++) {
        int n = snprintf(line + length, sizeof(line) - length, "%s%s", i ? " " : "",
                         words[i]);

        if (n < 0 || (size_t)n >= sizeof(line) - length) {
            fprintf(stderr, "plcSim: the command is too long\n");
            return 1;
        }
        length += (size_t)n;
    }
    return isBlank(line) ? 0 : ask(console, line);
}

int simDial(const char *path, char **words, int count)
{
    FILE *console = dial(path);
    int status;

    if (!console)
        return 1;
    status = count ? askWords(console, words, count) : askAll(console);
    fclose(console);
    if (status < 0)
        fprintf(stderr, "plcSim: %s has closed its console\n", path);
    return status != 0;
}
