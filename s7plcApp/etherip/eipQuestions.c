/* Questions of people to controllers; see eipQuestions.h. */
#include <stdio.h>
#include <string.h>

#include <epicsStdio.h>
#include <errlog.h>

#include "eipClient.h"
#include "eipPlc.h"
#include "eipQuestions.h"

static int complain(const char *name, const char *why)
{
    errlogSevPrintf(errlogMajor, "EtherIP %s: %s\n", name, why);
    return -1;
}

/* What is to be asked. */
typedef struct question {
    const char *plc, *pattern, *name; /* name: of a type or tag, to be described */
    int type;                         /* to be described; -1: list the tags */
    unsigned timeout;
    int status, asked;
} question;

static int askPlc(eipPlc *plc, const question *q)
{
    eipClient *c = eipClientCreate(&plc->connect, q->timeout);
    char address[300];
    int status;

    if (!c)
        return complain(plc->name, "no memory");
    plcStationAddress(plc->station, address, sizeof(address));
    printf("%s:\n", plc->name);
    status = eipClientOpen(c, address);
    if (!status)
        status = q->name        ? eipClientDescribe(c, q->name, stdout)
                 : q->type >= 0 ? eipClientPrintTemplate(c, (unsigned)q->type, stdout)
                                : eipClientPrintList(c, q->pattern, stdout);
    if (status)
        complain(plc->name, c->why);
    eipClientDestroy(c);
    return status;
}

static void askEach(eipPlc *plc, void *arg)
{
    question *q = arg;

    if (q->plc && *q->plc && strcmp(q->plc, plc->name))
        return;
    q->asked = 1;
    q->status |= askPlc(plc, q);
}

typedef struct names {
    char text[300];
    size_t used;
} names;

static void addName(eipPlc *plc, void *arg)
{
    names *n = arg;

    n->used += (size_t)epicsSnprintf(n->text + n->used, sizeof(n->text) - n->used, " %.60s", plc->name);
    if (n->used >= sizeof(n->text))
        n->used = sizeof(n->text) - 1;
}

static int ask(const char *command, question *q)
{
    names there = {" none", 0};

    eipPlcEach(askEach, q);
    if (!q->asked) {
        eipPlcEach(addName, &there);
        errlogSevPrintf(errlogMajor, "%s: no PLC \"%.60s\" by EtherNet/IP; configured:%s\n", command,
                        q->plc ? q->plc : "", there.text);
        return -1;
    }
    return q->status;
}

int eipQuestionList(const char *command, const char *plc, const char *pattern, unsigned timeout)
{
    question q = {plc, pattern, NULL, -1, timeout, 0, 0};

    return ask(command, &q);
}

int eipQuestionDescribe(const char *command, const char *plc, const char *name, int type,
                        unsigned timeout)
{
    question q = {plc, NULL, name, type, timeout, 0, 0};

    return ask(command, &q);
}

int eipQuestionRead(const char *address, const eipConnectOptions *options, const char *tag,
                    unsigned elements)
{
    eipClient *c = eipClientCreate(options, options->timeout);
    eipValue value = {.bytes = NULL};
    int status;

    if (!c)
        return complain(address, "no memory");
    status = eipValueInit(c, &value, tag);
    if (!status)
        status = eipClientOpen(c, address);
    if (!status)
        status = eipClientRead(c, &value, elements);
    if (status) {
        complain(tag, c->why);
    } else {
        printf("%s=", tag);
        eipValuePrint(c, &value, stdout);
        printf("\n");
    }
    eipValueFree(&value);
    eipClientDestroy(c);
    return status;
}
