/* simEipServer: EtherNet/IP as a server of a PLC: its keys, its statements and its
 * command. What they do is done elsewhere.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <time.h>

#include <cantProceed.h>
#include <epicsString.h>

#include "simCall.h"
#include "simEipServer.h"
#include "simEipValue.h"

/* clang-format off */
static const simKey keys[] = {
#define AT(member) offsetof(simEipKeys, member)
    {.name = "etherip_port", .kind = keyOrNone, .offset = AT(port), .max = 65535,
     .initial = "off", .choices = "off",
     .help = "EtherNet/IP port, usually 44818; 0 = any free one"},
    {.name = "etherip_profile", .kind = keyChoice, .offset = AT(profile),
     .initial = "l8x", .choices = simEipProfileNames, .help = "which controller it is"},
    {.name = "etherip_slot", .kind = keyUnsigned, .offset = AT(slot), .max = 255,
     .initial = "0", .help = "slot of the CPU in its backplane"},
    {.name = "etherip_program", .kind = keyText, .offset = AT(program), .min = 1,
     .max = 31, .initial = "plcSim", .help = "name of the program in the controller"},
    {.name = "etherip_key", .kind = keyChoice, .offset = AT(key), .initial = "remote",
     .choices = "remote|run|prog",
     .help = "the switch at the front: in run nobody may write"},
    {.name = "etherip_lostid", .kind = keyChoice, .offset = AT(lostSilent),
     .initial = "error", .choices = "error|silence",
     .help = "what a request on a connection that is gone gets"},
    {.name = "etherip_extra", .kind = keyChoice, .offset = AT(refuseExtra),
     .initial = "accept", .choices = "accept|refuse",
     .help = "bytes behind the data of a write, as some clients send them"},
    {.name = "etherip_connections", .kind = keyUnsigned, .offset = AT(connections),
     .min = 1, .max = SIM_EIP_CONNECTIONS, .initial = "32",
     .help = "how many CIP connections there may be"},
    {.name = "etherip_size", .kind = keyUnsigned, .offset = AT(size), .max = 4002,
     .initial = "0", .help = "largest connection in bytes, 0 = what the profile has"},
#undef AT
};
/* clang-format on */

static const simKeyTable keyTable = {keys, sizeof(keys) / sizeof(keys[0]),
                                     sizeof(simEipKeys)};

/* ---- building ---- */

static void init(void *server, simPlc *plc)
{
    simEipServer *s = server;
    simEipController *c = &s->eip.controller;
    struct timespec wall;

    s->plc = plc;
    s->keys = simConfigValues(plc->config, &keyTable);
    s->profile = simEipProfiles[s->keys->profile];
    if (s->keys->size && s->profile.large > s->keys->size)
        s->profile.large = s->keys->size;
    if (s->keys->size && s->profile.small > s->keys->size)
        s->profile.small = s->keys->size;
    simEipControllerInit(c, &s->profile, &plc->memory);
    c->slot = s->keys->slot;
    c->key = (simEipKey)s->keys->key;
    c->connections.most = s->keys->connections;
    strcpy(c->program, s->keys->program);
    c->refuseExtra = s->keys->refuseExtra;
    s->eip.lostSilent = s->keys->lostSilent;
    clock_gettime(CLOCK_REALTIME, &wall);
    c->clock = (double)wall.tv_sec + (double)wall.tv_nsec * 1e-9 - simNow();
}

static void freeAll(void *server)
{
    simEipServer *s = server;

    simEipControllerFree(&s->eip.controller);
}

/* Values of the file, kept for a cold restart. */
static int initialise(simEipServer *s, simEipTag *tag, char **words, size_t count,
                      char error[SIM_ERROR_SIZE])
{
    simEipPlace place;
    size_t i;

    if (simEipTagsPlace(&s->eip.controller.tags, tag->name, &place, error) ||
        simEipValueSet(&place, words, count, error))
        return -1;
    tag->initial = callocMustSucceed(count + 1, sizeof(char *), "simEipServer");
    for (i = 0; i < count; i++)
        tag->initial[tag->initialCount++] = epicsStrDup(words[i]);
    return 0;
}

/* What is behind name, type and place of a tag: values, or a signal. */
static int tagValue(simEipServer *s, simEipTag *tag, char **words, size_t count,
                    simSignal *signal, char error[SIM_ERROR_SIZE])
{
    if (!count)
        return 0;
    if (!strcmp(words[0], "="))
        return initialise(s, tag, words + 1, count - 1, error);
    if (simEipValueSignal(&s->plc->memory, tag, words, count, signal, error))
        return -1;
    tag->moves = 1;
    return 0;
}

static void dropTag(simEipServer *s, simEipTag *tag)
{
    if (!tag)
        return;
    if (tag->moves)
        simPlcDropSignals(s->plc, tag->block, tag->offset);
    simEipTagFree(tag);
}

/* again: a tag of that name is replaced; one that is refused leaves it as it is. */
static int makeTag(simEipServer *s, char **words, size_t count, int again,
                   char error[SIM_ERROR_SIZE])
{
    simEipTags *tags = &s->eip.controller.tags;
    simEipTag *old = again && count ? simEipTagTake(tags, words[0]) : NULL;
    simEipTag *tag;
    simSignal signal;
    size_t used;

    tag = simEipTagAdd(tags, words, count, &used, error);
    if (!tag || tagValue(s, tag, words + used, count - used, &signal, error)) {
        if (tag)
            simEipTagRemove(tags, words[0]);
        if (old)
            simEipTagPutBack(tags, old);
        return -1;
    }
    dropTag(s, old);
    if (tag->moves)
        simPlcAddSignal(s->plc, &signal);
    return 0;
}

static int addTag(void *server, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    simEipServer *s = server;

    s->tags++;
    return makeTag(s, words, count, 0, error);
}

static int addUdt(void *server, char **words, size_t count, char error[SIM_ERROR_SIZE])
{
    simEipServer *s = server;

    s->tags++;
    return simEipTypeStatement(&s->eip.controller.types, words, count, error);
}

static const simServerStatement statements[] = {
    {"udt", 0, addUdt},
    {"tag", 0, addTag},
};

static int check(void *server, simText *out)
{
    const simEipServer *s = server;
    const simConfig *config = s->plc->config;
    const char *problem = NULL;

    if (s->keys->port >= 0 && config->role != simSingle)
        problem = "EtherNet/IP is for one PLC: etherip_port needs role = single";
    else if (s->keys->port >= 0 && config->bigEndian)
        problem = "tags are little-endian: etherip_port needs byteorder = little";
    else if (s->keys->port < 0 && s->tags)
        problem = "there are tags, but etherip_port = off";
    if (!problem)
        return 0;
    simTextAdd(out, "%s: %s\n", config->file, problem);
    return 1;
}

/* ---- opening, closing, and what happens to the PLC ---- */

static int openServer(void *server, const char *address, const void *like)
{
    simEipServer *s = server;

    (void)like; /* a pair has no EtherNet/IP */
    if (s->keys->port < 0)
        return 0;
    s->eip.clients.listener.receiveBuffer = s->plc->config->receiveBuffer;
    return simEipOpen(&s->eip, s->plc->loop, s->plc->name, address,
                      (unsigned)s->keys->port);
}

static void closeServer(void *server)
{
    simEipServer *s = server;

    simEipClose(&s->eip);
}

static const char *address(const void *server)
{
    const simEipServer *s = server;

    return simClientsAddress(&s->eip.clients);
}

static void onPower(void *server, int on)
{
    simEipServer *s = server;

    simEipPower(&s->eip, on);
}

/* All tags are zero, or what the file gave them. */
static void onCold(void *server, int value)
{
    simEipServer *s = server;
    simEipTags *tags = &s->eip.controller.tags;
    char error[SIM_ERROR_SIZE];
    simEipPlace place;
    size_t i;

    (void)value;
    for (i = 0; i < tags->count; i++) {
        simEipTag *tag = tags->list[i];

        if (!tag->type)
            continue;
        memset(simEipTagBytes(tag), 0, simEipTagSize(tag));
        if (tag->initialCount && !simEipTagsPlace(tags, tag->name, &place, error))
            simEipValueSet(&place, tag->initial, tag->initialCount, error);
    }
}

static void onUnplug(void *server, int on)
{
    simEipServer *s = server;

    simClientsUnplug(&s->eip.clients, on);
}

static void onNormal(void *server, int value)
{
    simEipServer *s = server;

    (void)value;
    simEipFaultsClear(&s->eip.controller.faults);
    simClientsRefuse(&s->eip.clients, 0);
}

static void status(const void *server, simText *out)
{
    const simEipServer *s = server;

    simEipStatus(&s->eip, out);
}

/* ---- commands: the first word is the name of each ---- */

static simEipServer *serverOf(const simCall *c)
{
    return simPlcServerOf(c->plc, &simEipServerType);
}

static simEip *eipOf(const simCall *c)
{
    return &serverOf(c)->eip;
}

static int eipReceived(simCall *c)
{
    unsigned long wanted = 1;

    if (c->count > 1 && simCallNumber(c, 1, 1000000, &wanted))
        return -1;
    simEipReceived(eipOf(c), wanted, c->out);
    return 0;
}

static int eipClear(simCall *c)
{
    simEipClear(eipOf(c));
    return 0;
}

static int eipRefuse(simCall *c)
{
    return simCallRefuse(c, &eipOf(c)->clients);
}

static int eipClose(simCall *c)
{
    return simCallClose(c, &eipOf(c)->clients);
}

/* As if every connection had been silent for too long; TCP stays. */
static int eipTimeout(simCall *c)
{
    simEipConnections *all = &eipOf(c)->controller.connections;

    all->timedOut += simEipConnectionsCount(all);
    simEipConnectionsClear(all);
    return 0;
}

static int eipNormal(simCall *c)
{
    onNormal(serverOf(c), 0);
    return 0;
}

static int eipGet(simCall *c)
{
    simEipPlace place;

    if (c->count < 2)
        return simCallFail(c, "usage: etherip get <tag>");
    if (simEipTagsPlace(&eipOf(c)->controller.tags, c->words[1], &place, c->error))
        return -1;
    simTextAdd(c->out, "%s = ", c->words[1]);
    simEipValueGet(&place, c->out);
    simTextAdd(c->out, "\n");
    return 0;
}

static int eipSet(simCall *c)
{
    simEipPlace place;

    if (c->count < 3)
        return simCallFail(c, "usage: etherip set <tag> <value> ...");
    if (simEipTagsPlace(&eipOf(c)->controller.tags, c->words[1], &place, c->error))
        return -1;
    return simEipValueSet(&place, c->words + 2, c->count - 2, c->error);
}

static int eipTag(simCall *c)
{
    if (makeTag(serverOf(c), c->words + 1, c->count - 1, 1, c->error))
        return -1;
    eipOf(c)->controller.edits++;
    return 0;
}

static int eipUdt(simCall *c)
{
    if (addUdt(serverOf(c), c->words + 1, c->count - 1, c->error))
        return -1;
    eipOf(c)->controller.edits++;
    return 0;
}

static int eipRemove(simCall *c)
{
    if (c->count < 2 || !simEipTagFind(&eipOf(c)->controller.tags, c->words[1]))
        return simCallFail(c, "usage: etherip remove <tag>, one that exists");
    dropTag(serverOf(c), simEipTagTake(&eipOf(c)->controller.tags, c->words[1]));
    eipOf(c)->controller.edits++;
    return 0;
}

static int eipDownload(simCall *c)
{
    int shift = c->count > 1;

    if (shift && strcasecmp(c->words[1], "shift"))
        return simCallFail(c, "usage: etherip download [shift]");
    simEipControllerDownload(&eipOf(c)->controller, shift);
    return 0;
}

static int eipKey(simCall *c)
{
    static const char *const names[] = {"remote", "run", "prog"};
    int i;

    for (i = 0; i < 3 && c->count > 1; i++)
        if (!strcasecmp(c->words[1], names[i])) {
            eipOf(c)->controller.key = (simEipKey)i;
            return 0;
        }
    return simCallFail(c, "usage: etherip key remote|run|prog");
}

static int eipHelp(simCall *c)
{
    simTextAdd(
        c->out,
        "  received [n]         the last n requests\n"
        "  clear                counts begin anew\n"
        "  get <tag>            set <tag> <value> ...\n"
        "  tag <name> <type> .. one more tag, or another type for it, as in the file\n"
        "  udt <name> ...       one more structure, as in the file\n"
        "  remove <tag>\n"
        "  download [shift]     all ids change; shift: old ones mean other tags\n"
        "  key remote|run|prog  the switch at the front\n"
        "  timeout              all CIP connections end, TCP stays\n"
        "  close, reset         all TCP connections end now, with FIN or RST\n"
        "  refuse [on|off]      new connections get RST\n"
        "  normal               all faults end\n"
        "  <fault> off          that fault ends\n"
        "  <fault> [filter] [next n], where a fault is\n"
        "    status <hex> [<hex>]  slow <ms>     silent        drop\n"
        "    short <bytes> [close] close         garbage <n>   length <n>\n"
        "    wrongcontext  wrongsession  wrongsequence  wrongid  wrongservice\n"
        "    swap  old\n"
        "  and a filter says which requests it meets:\n"
        "    read  write  tag <name>  service <hex>  connected  unconnected\n");
    return 0;
}

static const simCallWord words[] = {
    {"help",     1,             eipHelp,     0},
    {"received", 2,             eipReceived, 0},
    {"clear",    1,             eipClear,    0},
    {"get",      2,             eipGet,      0},
    {"set",      SIM_MAX_WORDS, eipSet,      1},
    {"tag",      SIM_MAX_WORDS, eipTag,      1},
    {"udt",      SIM_MAX_WORDS, eipUdt,      1},
    {"remove",   2,             eipRemove,   1},
    {"download", 2,             eipDownload, 1},
    {"key",      2,             eipKey,      1},
    {"timeout",  1,             eipTimeout,  1},
    {"refuse",   2,             eipRefuse,   1},
    {"close",    1,             eipClose,    1},
    {"reset",    1,             eipClose,    1},
    {"normal",   1,             eipNormal,   1},
};

/* Without a word: the status. `close` with more words, and the rest, are faults. */
static int doEtherip(simCall *c)
{
    int status;

    if (!c->count) {
        simEipStatus(eipOf(c), c->out);
        return 0;
    }
    status = simCallWords(c, "etherip", words, sizeof(words) / sizeof(words[0]));
    if (status != SIM_NO_WORD)
        return status;
    if (!simEipFaultKnown(c->words[0]))
        return simCallFail(c, "\"%.40s\": etherip help lists what is allowed",
                           c->words[0]);
    simCallLog(c, "etherip");
    return simEipFaultParse(&eipOf(c)->controller.faults, c->words, c->count, c->error);
}

static const simCommand commands[] = {
    {.name = "etherip", .max = SIM_MAX_WORDS, .fn = doEtherip, .usage = "[<word> ...]",
     .help = "EtherNet/IP: its status; tags, faults and more: etherip help"},
};

const simServerType simEipServerType = {
    .title = "EtherNet/IP",
    .off = "this PLC has no EtherNet/IP: etherip_port in the file switches it on",
    .keys = &keyTable,
    .statements = statements,
    .statementCount = sizeof(statements) / sizeof(statements[0]),
    .commands = commands,
    .commandCount = sizeof(commands) / sizeof(commands[0]),
    .size = sizeof(simEipServer),
    .init = init,
    .check = check,
    .open = openServer,
    .close = closeServer,
    .free = freeAll,
    .address = address,
    .on = {[simPower] = onPower,
           [simCold] = onCold,
           [simUnplug] = onUnplug,
           [simNormal] = onNormal},
    .status = status,
};
