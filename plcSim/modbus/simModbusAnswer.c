/* simModbusAnswer: from a Modbus/TCP request to its answer. libmodbus makes the answer,
 * on PLC memory. It does not know clients, nor faults.
 *
 * libmodbus sends its answer into one end of a socket pair of ours, and we read it at the
 * other end: so it can neither wait for a client nor eat bytes of one. It has its own
 * ideas of wrong requests (it sleeps, then throws away what came behind); therefore it is
 * given good ones only.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cantProceed.h>
#include <modbus/modbus.h>

#include "simModbusAnswer.h"

/* All addresses; those that a request touches are filled before it is served. */
struct simModbusLibrary {
    modbus_t *context;
    modbus_mapping_t *mapping;
    int ends[2]; /* of the socket pair: libmodbus's, ours */
};

/* ---- libmodbus ---- */

int simAnswererOpen(simAnswerer *answerer, const simModbusMap *map, const char *name)
{
    struct simModbusLibrary *library =
        callocMustSucceed(1, sizeof(*library), "simModbus");
    int all = (int)SIM_MODBUS_ADDRESSES;

    answerer->map = map;
    answerer->library = library;
    library->context = modbus_new_tcp("127.0.0.1", 502); /* never connects */
    library->mapping = modbus_mapping_new(all, all, all, all);
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0,
                   library->ends))
        library->ends[0] = library->ends[1] = -1;
    if (!library->context || !library->mapping || library->ends[0] < 0) {
        simComplain(name, "Modbus: no memory or no socket: %s", strerror(errno));
        simAnswererClose(answerer);
        return -1;
    }
    modbus_set_socket(library->context, library->ends[0]);
    return 0;
}

void simAnswererClose(simAnswerer *answerer)
{
    struct simModbusLibrary *library = answerer->library;

    if (!library)
        return;
    if (library->ends[0] >= 0) {
        close(library->ends[0]);
        close(library->ends[1]);
    }
    if (library->context)
        modbus_free(library->context);
    if (library->mapping)
        modbus_mapping_free(library->mapping);
    free(library);
    answerer->library = NULL;
}

/* ---- requests ---- */

static unsigned be16(const epicsUInt8 *p)
{
    return (unsigned)p[0] << 8 | p[1];
}

size_t simFrameSize(const epicsUInt8 *bytes, size_t size)
{
    unsigned length;

    if (size < 6)
        return size >= 4 && be16(bytes + 2) != 0 ? 0 : SIM_MBAP + 1;
    length = be16(bytes + 4);
    if (be16(bytes + 2) != 0 || length < 2 || 6 + length > SIM_MODBUS_FRAME)
        return 0;
    return 6 + (size_t)length;
}

typedef enum shape {
    shapeRead,      /* address, count */
    shapeOne,       /* address, value */
    shapeMany,      /* address, count, bytes, values */
    shapeMask,      /* address, AND, OR */
    shapeReadWrite, /* address, count, address, count, bytes, values */
} shape;

static const struct function {
    unsigned code;
    shape shape;
    simTable table;
    unsigned maxRead, maxWrite; /* what the standard allows */
} functions[] = {
    {1,  shapeRead,      simCoils,    2000, 0   },
    {2,  shapeRead,      simDiscrete, 2000, 0   },
    {3,  shapeRead,      simHolding,  125,  0   },
    {4,  shapeRead,      simInput,    125,  0   },
    {5,  shapeOne,       simCoils,    0,    1   },
    {6,  shapeOne,       simHolding,  0,    1   },
    {15, shapeMany,      simCoils,    0,    1968},
    {16, shapeMany,      simHolding,  0,    123 },
    {22, shapeMask,      simHolding,  0,    1   },
    {23, shapeReadWrite, simHolding,  125,  121 },
};

static const struct function *findFunction(unsigned code)
{
    size_t i;

    for (i = 0; i < sizeof(functions) / sizeof(functions[0]); i++)
        if (functions[i].code == code)
            return &functions[i];
    return NULL;
}

static void setSpan(simSpan *span, simTable table, unsigned start, unsigned count)
{
    span->table = table;
    span->start = start;
    span->count = count;
}

static int inRange(unsigned count, unsigned max)
{
    return count >= 1 && count <= max;
}

/* The values behind the byte count at `at` are `want` bytes, and nothing follows. */
static int hasValues(const epicsUInt8 *pdu, size_t size, size_t at, size_t want)
{
    return pdu[at] == want && size == at + 1 + want;
}

/* Reads the data of a request by the shape of its function. Returns true when it is as
 * the standard wants it. size: bytes of pdu, from the function on. */
static int readShape(const struct function *f, const epicsUInt8 *pdu, size_t size,
                     simRequest *request)
{
    unsigned count;

    if (size < 5)
        return 0;
    count = be16(pdu + 3);
    switch (f->shape) {
    case shapeRead:
        setSpan(&request->read, f->table, be16(pdu + 1), count);
        return size == 5 && inRange(count, f->maxRead);
    case shapeOne:
        setSpan(&request->write, f->table, be16(pdu + 1), 1);
        return size == 5 && (f->table == simHolding || count == 0 || count == 0xff00);
    case shapeMany:
        setSpan(&request->write, f->table, be16(pdu + 1), count);
        return size > 6 && inRange(count, f->maxWrite) &&
               hasValues(pdu, size, 5,
                         f->table == simCoils ? (count + 7) / 8 : 2 * count);
    case shapeMask:
        setSpan(&request->write, f->table, be16(pdu + 1), 1);
        return size == 7;
    default:
        setSpan(&request->read, f->table, be16(pdu + 1), count);
        if (size < 10)
            return 0;
        setSpan(&request->write, f->table, be16(pdu + 5), be16(pdu + 7));
        return inRange(count, f->maxRead) && inRange(request->write.count, f->maxWrite) &&
               hasValues(pdu, size, 9, 2 * request->write.count);
    }
}

int simRequestParse(simRequest *request, const epicsUInt8 *bytes, size_t size)
{
    const struct function *f;

    memset(request, 0, sizeof(*request));
    request->bytes = bytes;
    request->size = size;
    request->transaction = be16(bytes);
    request->unit = bytes[6];
    request->function = bytes[SIM_MBAP];
    request->read.table = request->write.table = simNoTable;
    f = findFunction(request->function);
    if (!f)
        return MODBUS_EXCEPTION_ILLEGAL_FUNCTION;
    if (!readShape(f, bytes + SIM_MBAP, size - SIM_MBAP, request) ||
        size > SIM_MODBUS_ADU)
        return MODBUS_EXCEPTION_ILLEGAL_DATA_VALUE;
    return 0;
}

int simRequestCheck(const simRequest *request, const simModbusMap *map)
{
    const simSpan *read = &request->read, *write = &request->write;

    if (map->without[request->function])
        return MODBUS_EXCEPTION_ILLEGAL_FUNCTION;
    if (!simMapHas(map, read->table, read->start, read->count, 0) ||
        !simMapHas(map, write->table, write->start, write->count, 1))
        return MODBUS_EXCEPTION_ILLEGAL_DATA_ADDRESS;
    return 0;
}

/* ---- answers ---- */

/* Brings what a request touches from PLC memory to libmodbus, or back. */
static void load(const simModbusMap *map, modbus_mapping_t *mapping, const simSpan *span)
{
    switch (span->table) {
    case simCoils:
        simMapGetBits(map, simCoils, span->start, span->count, mapping->tab_bits);
        break;
    case simDiscrete:
        simMapGetBits(map, simDiscrete, span->start, span->count,
                      mapping->tab_input_bits);
        break;
    case simHolding:
        simMapGetRegisters(map, simHolding, span->start, span->count,
                           mapping->tab_registers);
        break;
    case simInput:
        simMapGetRegisters(map, simInput, span->start, span->count,
                           mapping->tab_input_registers);
        break;
    default:
        break;
    }
}

static void store(const simModbusMap *map, const modbus_mapping_t *mapping,
                  const simSpan *span)
{
    if (span->table == simCoils)
        simMapPutBits(map, simCoils, span->start, span->count, mapping->tab_bits);
    else if (span->table == simHolding)
        simMapPutRegisters(map, simHolding, span->start, span->count,
                           mapping->tab_registers);
}

static size_t fetch(struct simModbusLibrary *library, epicsUInt8 answer[SIM_MODBUS_ADU])
{
    ssize_t size = recv(library->ends[1], answer, SIM_MODBUS_ADU, MSG_DONTWAIT);

    return size > 0 ? (size_t)size : 0;
}

size_t simAnswer(simAnswerer *answerer, const simRequest *request,
                 epicsUInt8 answer[SIM_MODBUS_ADU])
{
    struct simModbusLibrary *library = answerer->library;

    load(answerer->map, library->mapping, &request->read);
    load(answerer->map, library->mapping, &request->write);
    modbus_reply(library->context, request->bytes, (int)request->size, library->mapping);
    store(answerer->map, library->mapping, &request->write);
    return fetch(library, answer);
}

size_t simAnswerException(simAnswerer *answerer, const simRequest *request, int code,
                          epicsUInt8 answer[SIM_MODBUS_ADU])
{
    modbus_reply_exception(answerer->library->context, request->bytes, (unsigned)code);
    return fetch(answerer->library, answer);
}
