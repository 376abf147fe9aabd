/* simEipText: the EtherNet/IP server in words: status, and the list of requests.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <math.h>

#include "simEip.h"

/* ---- looking ---- */

static void countsText(const simEip *eip, simText *out)
{
    const simEipCounts *n = &eip->counts;
    const simEipController *c = &eip->controller;
    double second = floor(simNow());
    unsigned rate = second == eip->second       ? eip->lastSecond
                    : second == eip->second + 1 ? eip->inSecond
                                                : 0;
    int i;

    simTextAdd(out,
               "etherip requests: total=%llu connected=%llu answered=%llu silent=%llu "
               "errors=%llu ignored=%llu per_second=%u bytes_in=%llu bytes_out=%llu\n",
               (unsigned long long)n->requests, (unsigned long long)n->connected,
               (unsigned long long)n->answers, (unsigned long long)n->silent,
               (unsigned long long)n->errors, (unsigned long long)n->ignored, rate,
               (unsigned long long)n->bytesIn, (unsigned long long)n->bytesOut);
    simTextAdd(out, "etherip services:");
    for (i = 0; i < 256; i++)
        if (c->services[i])
            simTextAdd(out, " %02x=%llu", i, (unsigned long long)c->services[i]);
    simTextAdd(out, "\netherip statuses:");
    for (i = 0; i < 256; i++)
        if (c->statuses[i])
            simTextAdd(out, " %02x=%llu", i, (unsigned long long)c->statuses[i]);
    simTextAdd(out, "\netherip largest: request=%lu answer=%lu\n",
               (unsigned long)n->largestRequest, (unsigned long)n->largestAnswer);
}

static void connectionsText(const simEip *eip, simText *out)
{
    const simEipConnections *all = &eip->controller.connections;
    double now = simNow();
    size_t i;

    simTextAdd(out,
               "etherip opens: opened=%llu refused=%llu closed=%llu timed_out=%llu "
               "duplicates=%llu unknown_id=%llu\n",
               (unsigned long long)all->opened, (unsigned long long)all->refused,
               (unsigned long long)all->closed, (unsigned long long)all->timedOut,
               (unsigned long long)all->duplicates, (unsigned long long)all->lost);
    for (i = 0; i < SIM_EIP_CONNECTIONS; i++) {
        const simEipConnection *k = &all->list[i];

        if (!k->used || now - k->heard > k->timeout)
            continue;
        simTextAdd(out,
                   "etherip connection: id=%08lx client=%u request=%lu answer=%lu "
                   "timeout=%.3f idle=%.3f requests=%llu\n",
                   (unsigned long)k->toTarget, k->client, (unsigned long)k->requestSize,
                   (unsigned long)k->answerSize, k->timeout, now - k->heard,
                   (unsigned long long)k->requests);
    }
}

void simEipStatus(const simEip *eip, simText *out)
{
    static const char *const keys[] = {"remote", "run", "prog"};
    const simEipController *c = &eip->controller;
    double now = simNow();
    int i;

    if (!eip->loop)
        return;
    simTextAdd(out,
               "etherip: address=%s profile=%s slot=%u key=%s tags=%lu downloads=%lu "
               "clients=%d connections=%llu sent_away=%llu\n",
               simListenerAddress(&eip->clients.listener), c->profile->name, c->slot,
               keys[c->key], (unsigned long)c->tags.count, (unsigned long)c->downloads,
               eip->clients.count, (unsigned long long)eip->clients.connections,
               (unsigned long long)eip->clients.sentAway);
    for (i = 0; i < SIM_MAX_CLIENTS; i++) {
        const simClient *client = eip->clients.list[i];
        const simEipClient *own = client ? client->own : NULL;

        if (client)
            simTextAdd(out,
                       "etherip client: number=%u peer=%s seconds=%.3f session=%08lx "
                       "requests=%llu unsent=%lu\n",
                       client->number, client->peer, now - client->connectTime,
                       (unsigned long)own->session, (unsigned long long)own->requests,
                       (unsigned long)client->queued);
    }
    connectionsText(eip, out);
    countsText(eip, out);
    simTextAdd(out, "etherip faults:");
    if (!simClientsFaults(&eip->clients, out) || c->faults.count)
        simEipFaultsText(&c->faults, out);
    simTextAdd(out, "\n");
}

/* ---- the list of requests ---- */

typedef struct listing {
    const simEip *eip;
    const simEipRecord *record;
    size_t index;
    simText *out;
} listing;

/* The status that request `index` of a packet got, -1 = none. */
static int statusOf(const simEipRecord *record, size_t index)
{
    const epicsUInt8 *p = record->answer;
    size_t count, at;

    if (!p || record->answerSize < 4)
        return -1;
    if (p[0] != 0x8A || (p[2] && p[2] != EIP_SERVICE_ERROR))
        return p[2];
    p += 4;
    count = (size_t)simEipGet(p, 2);
    at = index < count ? (size_t)simEipGet(p + 2 + 2 * index, 2) : 0;
    return at && at + 7 < record->answerSize + 1 ? p[at + 2] : -1;
}

static void listRequest(void *arg, const simEipRequest *request, const simEipPath *path)
{
    listing *l = arg;
    int status = statusOf(l->record, l->index++);

    simTextAdd(l->out, " %02x:", request->service);
    simEipControllerPathText(&l->eip->controller, path, l->out);
    if (status >= 0)
        simTextAdd(l->out, "=%02x", (unsigned)status);
}

void simEipReceived(const simEip *eip, unsigned long n, simText *out)
{
    epicsUInt64 count = eip->historyCount;
    epicsUInt64 i;

    if (n > SIM_EIP_HISTORY)
        n = SIM_EIP_HISTORY;
    for (i = n < count ? count - n : 0; i < count; i++) {
        const simEipRecord *record = &eip->history[i % SIM_EIP_HISTORY];
        listing l = {eip, record, 0, out};

        simTextAdd(out, "%llu time=%.6f client=%u", (unsigned long long)i + 1,
                   record->time, record->client);
        if (record->connected)
            simTextAdd(out, " sequence=%u", record->sequence);
        simTextAdd(out, " request=%lu answer=", (unsigned long)record->requestSize);
        if (record->error)
            simTextAdd(out, "error%02x", record->error);
        else if (record->answer)
            simTextAdd(out, "%lu", (unsigned long)record->answerSize);
        else
            simTextAdd(out, "none");
        if (record->request)
            simEipWalk(record->request, record->requestSize, listRequest, &l);
        simTextAdd(out, "\n");
    }
}
