/* simEipFaults: what goes wrong on purpose, for which requests, how often. It decides;
 * simEip and simEipController do it.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "simEipFaults.h"

/* ---- words ---- */

static const struct faultWord {
    const char *name;
    int numbers;  /* that must follow */
    int optional; /* that may follow */
    int hex;
    long max;
} faultWords[] = {
    [eipFaultStatus] = {"status",        1, 1, 1, 0xFFFF },
    [eipFaultSlow] = {"slow",          1, 0, 0, 3600000},
    [eipFaultSilent] = {"silent",        0, 0, 0, 0      },
    [eipFaultDrop] = {"drop",          0, 0, 0, 0      },
    [eipFaultClose] = {"close",         0, 0, 0, 0      },
    [eipFaultShort] = {"short",         1, 0, 0, 65535  },
    [eipFaultGarbage] = {"garbage",       1, 0, 0, 65535  },
    [eipFaultLength] = {"length",        1, 0, 0, 65535  },
    [eipFaultContext] = {"wrongcontext",  0, 0, 0, 0      },
    [eipFaultSession] = {"wrongsession",  0, 0, 0, 0      },
    [eipFaultSequence] = {"wrongsequence", 0, 0, 0, 0      },
    [eipFaultId] = {"wrongid",       0, 0, 0, 0      },
    [eipFaultService] = {"wrongservice",  0, 0, 0, 0      },
    [eipFaultSwap] = {"swap",          0, 0, 0, 0      },
    [eipFaultOld] = {"old",           0, 0, 0, 0      },
};

static int findFault(const char *word)
{
    int i;

    for (i = 0; i < SIM_EIP_FAULTS; i++)
        if (!strcasecmp(word, faultWords[i].name))
            return i;
    return -1;
}

int simEipFaultKnown(const char *word)
{
    return findFault(word) >= 0;
}

void simEipFaultsClear(simEipFaults *faults)
{
    faults->count = 0;
}

static void endFault(simEipFaults *faults, int fault)
{
    size_t i, kept = 0;

    for (i = 0; i < faults->count; i++)
        if ((int)faults->rules[i].fault != fault)
            faults->rules[kept++] = faults->rules[i];
    faults->count = kept;
}

static int number(const char *word, int hex, long max, long *value)
{
    char *end;

    errno = 0;
    *value = strtol(word, &end, hex ? 16 : 10);
    return errno || *end || end == word || *value < 0 || *value > max ? -1 : 0;
}

/* The numbers behind the fault's name. Returns the words used, or -1. */
static long takeNumbers(simEipRule *rule, char **words, size_t count,
                        char error[SIM_ERROR_SIZE])
{
    const struct faultWord *word = &faultWords[rule->fault];
    size_t used = 0;

    if (word->numbers) {
        long max = rule->fault == eipFaultStatus ? 0xFF : word->max;

        if (used >= count || number(words[0], word->hex, max, &rule->number))
            return simFail(error,
                           word->hex ? "%s wants a hexadecimal number 0 ... %lx"
                                     : "%s wants a number 0 ... %ld",
                           word->name, max);
        used++;
    }
    if (word->optional && used < count &&
        !number(words[used], word->hex, word->max, &rule->second))
        used++;
    if (rule->fault == eipFaultShort && used < count &&
        !strcasecmp(words[used], "close")) {
        rule->close = 1;
        used++;
    }
    return (long)used;
}

/* One word of the filter, with its argument. Returns the words used, or -1. */
static long takeFilter(simEipRule *rule, char **words, size_t count,
                       char error[SIM_ERROR_SIZE])
{
    int argument = count > 1;
    long value;

    if (!strcasecmp(words[0], "read"))
        rule->reads = 1;
    else if (!strcasecmp(words[0], "write"))
        rule->writes = 1;
    else if (!strcasecmp(words[0], "connected"))
        rule->connected = 1;
    else if (!strcasecmp(words[0], "unconnected"))
        rule->connected = 2;
    else if (!strcasecmp(words[0], "service") && argument &&
             !number(words[1], 1, 0x7F, &value) && value) {
        rule->service = (unsigned)value;
        return 2;
    } else if (!strcasecmp(words[0], "tag") && argument &&
               strlen(words[1]) < sizeof(rule->tag)) {
        strcpy(rule->tag, words[1]);
        return 2;
    } else if (!strcasecmp(words[0], "next") && argument &&
               !number(words[1], 0, 1000000000, &value) && value) {
        rule->remaining = (unsigned long)value;
        return 2;
    } else
        return simFail(error,
                       "\"%.40s\": allowed are read, write, tag <name>, service <hex>, "
                       "connected, unconnected, next <n>",
                       words[0]);
    return 1;
}

int simEipFaultParse(simEipFaults *faults, char **words, size_t count,
                     char error[SIM_ERROR_SIZE])
{
    simEipRule rule;
    int fault = count ? findFault(words[0]) : -1;
    size_t at = 1;
    long used;

    if (fault < 0)
        return simFail(error, "no such fault");
    if (count == 2 && !strcasecmp(words[1], "off")) {
        endFault(faults, fault);
        return 0;
    }
    if (faults->count == SIM_EIP_RULES)
        return simFail(error, "more than %d faults", SIM_EIP_RULES);
    memset(&rule, 0, sizeof(rule));
    rule.fault = (simEipFault)fault;
    used = takeNumbers(&rule, words + at, count - at, error);
    while (used >= 0 && (at += (size_t)used) < count)
        used = takeFilter(&rule, words + at, count - at, error);
    if (used < 0)
        return -1;
    faults->rules[faults->count++] = rule;
    return 0;
}

/* ---- meeting ---- */

static int isRead(unsigned service)
{
    return service == 0x4C || service == 0x52;
}

static int isWrite(unsigned service)
{
    return service == 0x4D || service == 0x4E || service == 0x53;
}

/* "REALs" fits REALs, REALs[3] and REALs.x. */
static int tagFits(const char *filter, const char *path)
{
    size_t length = strlen(filter);

    return !strncasecmp(filter, path, length) &&
           (!path[length] || path[length] == '[' || path[length] == '.');
}

static int fits(const simEipRule *rule, const simEipSubject *s)
{
    if (rule->service && rule->service != s->service)
        return 0;
    if (rule->connected && (rule->connected == 1) != s->connected)
        return 0;
    if ((rule->reads || rule->writes) && !(rule->reads && isRead(s->service)) &&
        !(rule->writes && isWrite(s->service)))
        return 0;
    return !rule->tag[0] || tagFits(rule->tag, s->path);
}

static void countRule(simEipFaults *faults, size_t *index)
{
    simEipRule *rule = &faults->rules[*index];

    if (!rule->remaining || --rule->remaining)
        return;
    faults->count--;
    memmove(rule, rule + 1, (faults->count - *index) * sizeof(*rule));
    (*index)--; /* the next one has this index now */
}

int simEipFaultsStatus(simEipFaults *faults, const simEipSubject *subject,
                       unsigned *status, unsigned *extended)
{
    size_t i;

    for (i = 0; i < faults->count; i++) {
        const simEipRule *rule = &faults->rules[i];

        if (rule->fault != eipFaultStatus || !fits(rule, subject))
            continue;
        *status = (unsigned)rule->number & 0xFF;
        *extended = (unsigned)rule->second;
        countRule(faults, &i);
        return 1;
    }
    return 0;
}

static void apply(const simEipRule *rule, simEipFate *fate)
{
    switch (rule->fault) {
    case eipFaultSlow:
        fate->delay += (double)rule->number * 1e-3;
        break;
    case eipFaultSilent:
        fate->silent = 1;
        break;
    case eipFaultDrop:
        fate->drop = 1;
        break;
    case eipFaultClose:
        fate->half = 1;
        break;
    case eipFaultShort:
        fate->shorten = rule->number;
        fate->close = rule->close;
        break;
    case eipFaultGarbage:
        fate->garbage = rule->number;
        break;
    case eipFaultLength:
        fate->length = rule->number;
        break;
    case eipFaultContext:
        fate->context = 1;
        break;
    case eipFaultSession:
        fate->session = 1;
        break;
    case eipFaultSequence:
        fate->sequence = 1;
        break;
    case eipFaultId:
        fate->id = 1;
        break;
    case eipFaultService:
        fate->service = 1;
        break;
    case eipFaultSwap:
        fate->swap = 1;
        break;
    case eipFaultOld:
        fate->old = 1;
        break;
    default:
        break;
    }
}

void simEipFaultsMeet(simEipFaults *faults, const simEipSubject *subjects, size_t count,
                      simEipFate *fate)
{
    size_t i, k;

    memset(fate, 0, sizeof(*fate));
    fate->shorten = fate->garbage = -1;
    for (i = 0; i < faults->count; i++) {
        const simEipRule *rule = &faults->rules[i];

        if (rule->fault == eipFaultStatus)
            continue;
        for (k = 0; k < count && !fits(rule, &subjects[k]); k++)
            ;
        if (k == count)
            continue;
        apply(rule, fate);
        countRule(faults, &i);
    }
}

/* ---- text ---- */

void simEipFaultsText(const simEipFaults *faults, simText *out)
{
    size_t i;

    if (!faults->count)
        simTextAdd(out, " none");
    for (i = 0; i < faults->count; i++) {
        const simEipRule *rule = &faults->rules[i];
        const struct faultWord *word = &faultWords[rule->fault];

        simTextAdd(out, " %s", word->name);
        if (word->numbers)
            simTextAdd(out, word->hex ? "=%02lx" : "=%ld", rule->number);
        if (rule->second)
            simTextAdd(out, "/%04lx", rule->second);
        if (rule->close)
            simTextAdd(out, ",close");
        if (rule->reads)
            simTextAdd(out, ",read");
        if (rule->writes)
            simTextAdd(out, ",write");
        if (rule->connected)
            simTextAdd(out, rule->connected == 1 ? ",connected" : ",unconnected");
        if (rule->service)
            simTextAdd(out, ",service=%02x", rule->service);
        if (rule->tag[0])
            simTextAdd(out, ",tag=%s", rule->tag);
        if (rule->remaining)
            simTextAdd(out, ",next=%lu", rule->remaining);
    }
}
