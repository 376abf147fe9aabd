/* simModbus: serves Modbus/TCP beside the blocks, on the same PLC memory, to several
 * clients. It does not know what a register means, nor consoles.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stdlib.h>
#include <string.h>

#include <cantProceed.h>

#include "simModbus.h"

#define INBOX 4096 /* bytes read at a time */

/* What is known of a client. */
typedef struct modbusClient {
    epicsUInt64 requests;
    int mute;         /* half an answer left: nothing more will */
    int otherUnit;    /* last unit asked for that is not here, + 1; 0 = none */
    unsigned refusal; /* function and exception that were logged last */
} modbusClient;

static modbusClient *ownOf(const simClient *client)
{
    return client->own;
}

static simModbus *modbusOf(const simClient *client)
{
    return client->all->server;
}

/* ---- requests ---- */

static void remember(simClient *client, const simRequest *request, int result)
{
    simModbus *modbus = modbusOf(client);
    simModbusRecord *record =
        &modbus->history[modbus->counts.requests % SIM_MODBUS_HISTORY];

    modbus->counts.requests++;
    modbus->counts.function[request->function]++;
    ownOf(client)->requests++;
    record->time = simNow();
    record->client = client->number;
    record->result = result;
    record->size = request->size;
    memcpy(record->bytes, request->bytes, request->size);
}

static void countSpan(unsigned largest[2], const simSpan *span)
{
    unsigned *max = &largest[span->table == simCoils || span->table == simDiscrete];

    if (span->count > *max)
        *max = span->count;
}

static void countException(simClient *client, const simRequest *request, int code)
{
    simModbusCounts *counts = &modbusOf(client)->counts;
    unsigned refusal = request->function << 8 | (unsigned)code;

    counts->refused[request->function]++;
    counts->exception[code]++;
    if (ownOf(client)->refusal != refusal)
        simLog(modbusOf(client)->name,
               "Modbus: connection %u: function %u is answered with exception %d",
               client->number, request->function, code);
    ownOf(client)->refusal = refusal;
}

/* The answer leaves, as the faults have it. */
static void sendAnswer(simClient *client, epicsUInt8 *answer, size_t size,
                       const simModbusFate *fate)
{
    int last = 0;

    modbusOf(client)->counts.answers++;
    if (fate->wrongId)
        answer[1] ^= 1;
    if (fate->wrongUnit)
        answer[6] ^= 1;
    if (fate->half || (fate->shorten >= 0 && (size_t)fate->shorten < size)) {
        size = fate->half ? size / 2 : (size_t)fate->shorten;
        last = fate->half || fate->close;
        ownOf(client)->mute = 1;
    }
    if (fate->garbage >= 0)
        simClientSend(client, NULL, (size_t)fate->garbage, fate->delay, last);
    else
        simClientSend(client, answer, size, fate->delay, last);
}

/* A complete request for our unit. */
static void serve(simClient *client, simRequest *request, int code)
{
    simModbus *modbus = modbusOf(client);
    epicsUInt8 answer[SIM_MODBUS_ADU];
    simModbusFate fate;
    size_t size;

    countSpan(modbus->counts.maxRead, &request->read);
    countSpan(modbus->counts.maxWrite, &request->write);
    simModbusFaultsMeet(&modbus->faults, request, &fate);
    if (ownOf(client)->mute || fate.silent || request->function >= 128) {
        modbus->counts.silent++;
        remember(client, request, -1);
        return;
    }
    if (fate.exception)
        code = fate.exception;
    else if (!code)
        code = simRequestCheck(request, &modbus->map);
    remember(client, request, code);
    if (code) {
        countException(client, request, code);
        size = simAnswerException(&modbus->answerer, request, code, answer);
    } else {
        size = simAnswer(&modbus->answerer, request, answer);
    }
    sendAnswer(client, answer, size, &fate);
}

/* A gateway has no such unit behind it: it says nothing, or exception 11. */
static void serveOther(simClient *client, simRequest *request)
{
    static const simModbusFate none = {.shorten = -1, .garbage = -1};
    simModbus *modbus = modbusOf(client);
    epicsUInt8 answer[SIM_MODBUS_ADU];
    int code =
        modbus->gateway && !ownOf(client)->mute && request->function < 128 ? 11 : -1;

    if (ownOf(client)->otherUnit != (int)request->unit + 1)
        simLog(modbus->name, "Modbus: connection %u: unit %u is not here, %d is: %s",
               client->number, request->unit, modbus->unit,
               code < 0 ? "no answer" : "exception 11");
    ownOf(client)->otherUnit = (int)request->unit + 1;
    modbus->counts.otherUnit++;
    remember(client, request, code);
    if (code < 0)
        return;
    countException(client, request, code);
    sendAnswer(client, answer,
               simAnswerException(&modbus->answerer, request, code, answer), &none);
}

/* One request from the inbox, see simClients.h. */
static long take(simClient *client)
{
    simModbus *modbus = modbusOf(client);
    size_t size = simFrameSize(client->inbox, client->filled);
    simRequest request;
    int code;

    if (size == 0) {
        modbus->counts.garbage++;
        simClientDrop(client, 0, "this is no Modbus/TCP");
        return SIM_CLIENT_GONE;
    }
    if (size > client->filled)
        return 0;
    code = simRequestParse(&request, client->inbox, size);
    if (modbus->unit >= 0 && request.unit != (unsigned)modbus->unit)
        serveOther(client, &request);
    else
        serve(client, &request, code);
    return (long)size;
}

/* ---- opening and closing ---- */

int simModbusOpen(simModbus *modbus, simLoop *loop, const char *name, const char *address,
                  unsigned port)
{
    modbus->loop = loop;
    modbus->name = name;
    modbus->history =
        callocMustSucceed(SIM_MODBUS_HISTORY, sizeof(simModbusRecord), "simModbusOpen");
    if (simAnswererOpen(&modbus->answerer, &modbus->map, name))
        return -1;
    modbus->clients.inboxSize = INBOX;
    modbus->clients.ownSize = sizeof(modbusClient);
    modbus->clients.server = modbus;
    modbus->clients.take = take;
    return simClientsOpen(&modbus->clients, loop, name, "Modbus", address, port);
}

void simModbusClose(simModbus *modbus)
{
    if (!modbus->loop)
        return;
    simClientsClose(&modbus->clients);
    simAnswererClose(&modbus->answerer);
    free(modbus->history);
    modbus->history = NULL;
    modbus->loop = NULL;
}

/* ---- looking ---- */

void simModbusClearCounts(simModbus *modbus)
{
    memset(&modbus->counts, 0, sizeof(modbus->counts));
    modbus->clients.connections = modbus->clients.sentAway = 0;
}

static void countsText(const simModbusCounts *n, simText *out)
{
    int i;

    simTextAdd(out,
               "modbus requests: total=%llu answered=%llu silent=%llu "
               "other_unit=%llu garbage=%llu",
               (unsigned long long)n->requests, (unsigned long long)n->answers,
               (unsigned long long)n->silent, (unsigned long long)n->otherUnit,
               (unsigned long long)n->garbage);
    for (i = 0; i < 256; i++)
        if (n->function[i])
            simTextAdd(out, " fc%d=%llu", i, (unsigned long long)n->function[i]);
    simTextAdd(out, "\nmodbus exceptions:");
    for (i = 1; i < 12; i++)
        simTextAdd(out, " ex%d=%llu", i, (unsigned long long)n->exception[i]);
    for (i = 0; i < 256; i++)
        if (n->refused[i])
            simTextAdd(out, " fc%d=%llu", i, (unsigned long long)n->refused[i]);
    simTextAdd(out,
               "\nmodbus largest: read_registers=%u read_bits=%u write_registers=%u "
               "write_bits=%u\n",
               n->maxRead[0], n->maxRead[1], n->maxWrite[0], n->maxWrite[1]);
}

void simModbusStatus(const simModbus *modbus, simText *out)
{
    double now = simNow();
    int i;

    if (!modbus->loop)
        return;
    simTextAdd(out, "modbus: address=%s", simClientsAddress(&modbus->clients));
    if (modbus->unit >= 0)
        simTextAdd(out, " unit=%d", modbus->unit);
    else
        simTextAdd(out, " unit=any");
    simTextAdd(out, " clients=%d connections=%llu sent_away=%llu\n",
               modbus->clients.count, (unsigned long long)modbus->clients.connections,
               (unsigned long long)modbus->clients.sentAway);
    simTextAdd(out, "modbus areas:");
    simMapText(&modbus->map, out);
    simTextAdd(out, "\n");
    for (i = 0; i < SIM_MAX_CLIENTS; i++) {
        const simClient *c = modbus->clients.list[i];

        if (c)
            simTextAdd(out,
                       "modbus client: number=%u peer=%s seconds=%.3f requests=%llu "
                       "unsent=%lu\n",
                       c->number, c->peer, now - c->connectTime,
                       (unsigned long long)ownOf(c)->requests, (unsigned long)c->queued);
    }
    countsText(&modbus->counts, out);
    simTextAdd(out, "modbus faults:");
    if (!simClientsFaults(&modbus->clients, out) || modbus->faults.count)
        simModbusFaultsText(&modbus->faults, out);
    simTextAdd(out, "\n");
}

static void spanText(const char *what, const simSpan *span, simText *out)
{
    if (span->table != simNoTable)
        simTextAdd(out, " %s=%s,%u,%u", what, simTableName(span->table), span->start,
                   span->count);
}

void simModbusReceived(const simModbus *modbus, unsigned long n, simText *out)
{
    epicsUInt64 count = modbus->counts.requests;
    epicsUInt64 i;

    if (n > SIM_MODBUS_HISTORY)
        n = SIM_MODBUS_HISTORY;
    for (i = n < count ? count - n : 0; i < count; i++) {
        const simModbusRecord *record = &modbus->history[i % SIM_MODBUS_HISTORY];
        simRequest request;

        simRequestParse(&request, record->bytes, record->size);
        simTextAdd(out, "%llu time=%.6f client=%u unit=%u fc=%u",
                   (unsigned long long)i + 1, record->time, record->client, request.unit,
                   request.function);
        spanText("read", &request.read, out);
        spanText("write", &request.write, out);
        simTextAdd(out,
                   record->result < 0 ? " answer=none"
                   : record->result   ? " answer=exception%d"
                                      : " answer=ok",
                   record->result);
        simTextAdd(out, " pdu=");
        simTextHex(out, record->bytes + SIM_MBAP, record->size - SIM_MBAP);
        simTextAdd(out, "\n");
    }
}
