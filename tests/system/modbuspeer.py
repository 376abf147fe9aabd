"""A Modbus PLC for the tests: pymodbus's server on a thread and an event loop of its own.

What the tables hold and what a request does is pymodbus's. This file adds a log of every
request, read from the bytes by a parser of its own that knows the limits of the standard
(what breaks them is in `errors`), and faults: refusals, silence, delay, wrong answers.
Source of functions and limits: MODBUS Application Protocol Specification V1.1b3.
"""
import asyncio
import logging
import socket
import struct
import threading
import time
from dataclasses import dataclass, field

from pymodbus.pdu import ExceptionResponse
from pymodbus.server import ModbusTcpServer
from pymodbus.server.requesthandler import ServerRequestHandler
from pymodbus.simulator import DataType, SimData, SimDevice

from ports import free_port
from waiting import LIMIT, until

logging.getLogger("pymodbus").setLevel(logging.CRITICAL)

# function: (table, most registers or bits in one request, writes)
FUNCTIONS = {
    1: ("coils", 2000, False), 2: ("discrete", 2000, False),
    3: ("holding", 125, False), 4: ("input", 125, False),
    5: ("coils", 1, True), 6: ("holding", 1, True),
    15: ("coils", 1968, True), 16: ("holding", 123, True), 22: ("holding", 1, True),
}


@dataclass
class Request:
    """One request as it came over the wire."""
    time: float       # s, monotonic
    connection: int   # from 1
    transaction: int
    unit: int
    function: int
    start: int = 0
    count: int = 0    # registers or bits
    values: list = field(default_factory=list)  # of writes; of FC22 [AND mask, OR mask]

    @property
    def table(self):
        return FUNCTIONS[self.function][0]

    @property
    def writes(self):
        return FUNCTIONS[self.function][2]

    @property
    def key(self):
        """Function, start and count: what one turn of polls repeats."""
        return self.function, self.start, self.count

    def addresses(self):
        return range(self.start, self.start + self.count)


def bits_of(data, count):
    return [bool(data[i // 8] >> i % 8 & 1) for i in range(count)]


class Parser:
    """Takes the byte stream of one connection apart. `error` is called with words for what
    breaks the standard, `found` with each Request."""

    def __init__(self, connection, found, error):
        self.connection, self.found, self.error = connection, found, error
        self.buffer = b""

    def feed(self, data):
        self.buffer += data
        while len(self.buffer) >= 8:
            transaction, protocol, length, unit, function = struct.unpack(
                ">HHHBB", self.buffer[:8])
            if protocol != 0 or not 2 <= length <= 254:
                self.error(f"header {self.buffer[:8].hex(' ')}")
                self.buffer = b""
                return
            if len(self.buffer) < 6 + length:
                return
            body = self.buffer[8:6 + length]
            self.buffer = self.buffer[6 + length:]
            request = Request(time.monotonic(), self.connection, transaction, unit, function)
            try:
                self.judge(request, body)
            except struct.error:
                self.error(f"function {function} with {len(body)} bytes")
            self.found(request)

    def judge(self, request, body):
        function = request.function
        if function not in FUNCTIONS:
            self.error(f"function {function}")
            return
        request.start, = struct.unpack(">H", body[:2])
        request.count, used = 1, 4
        if function == 5:
            value, = struct.unpack(">H", body[2:4])
            request.values = [value == 0xFF00]
            if value not in (0, 0xFF00):
                self.error(f"function 5 with value {value:#x}")
        elif function == 6:
            request.values = list(struct.unpack(">H", body[2:4]))
        elif function == 22:
            request.values = list(struct.unpack(">HH", body[2:6]))
            used = 6
        else:
            request.count, = struct.unpack(">H", body[2:4])
            if request.writes:
                used = 5 + self.payload(request, body[4], body[5:])
        if used != len(body):
            self.error(f"{request} has {len(body)} bytes, not {used}")
        if not 1 <= request.count <= FUNCTIONS[function][1]:
            self.error(f"{request}: at most {FUNCTIONS[function][1]} are allowed")
        if request.start + request.count > 65536:
            self.error(f"{request}: beyond 65535")

    def payload(self, request, size, data):
        """The values of FC15 and FC16. Returns the bytes that belong there."""
        bits = request.function == 15
        wanted = (request.count + 7) // 8 if bits else 2 * request.count
        if size != wanted or len(data) != wanted:
            self.error(f"{request}: byte count {size}, {len(data)} bytes, not {wanted}")
        elif bits:
            request.values = bits_of(data, request.count)
            if request.count % 8 and data[-1] >> request.count % 8:
                self.error(f"{request}: spare bits are not 0")
        else:
            request.values = list(struct.unpack(f">{request.count}H", data))
        return wanted


class Handler(ServerRequestHandler):
    """One connection: pymodbus's, with the log and the faults around it."""

    def __init__(self, owner):
        super().__init__(owner, None, None, None)
        self.peer = owner.peer
        self.pending = None  # the request that has no answer yet
        self.ended = False

    def callback_connected(self):
        super().callback_connected()
        self.peer.handlers.append(self)
        self.number = len(self.peer.handlers)
        self.parser = Parser(self.number, self.found, self.peer.errors.append)

    def callback_disconnected(self, exc):
        super().callback_disconnected(exc)
        self.ended = True

    def found(self, request):
        if self.pending:
            self.peer.errors.append(f"{request} before {self.pending} was answered")
        self.pending = request
        self.peer.requests.append(request)

    def data_received(self, data):
        self.parser.feed(data)
        super().data_received(data)

    async def handle_request(self):
        peer, request = self.peer, self.pending
        if not self.last_pdu or not request or peer.silent:
            return
        if peer.unit is not None and request.unit != peer.unit:
            if peer.unit_code:
                self.refuse(peer.unit_code)
            return
        while not peer.answering.is_set() and (request.writes or not peer.reads_go_on):
            peer.held = True
            await asyncio.sleep(0.001)  # the pace of the looks
        peer.held = False
        if peer.delay:
            await asyncio.sleep(peer.delay)  # a PLC this slow
        if self.ended:
            return
        code = peer.judge(request)
        if code:
            self.refuse(code)
        else:
            await super().handle_request()

    def refuse(self, code):
        answer = ExceptionResponse(self.last_pdu.function_code, code)
        answer.transaction_id = self.last_pdu.transaction_id
        answer.dev_id = self.last_pdu.dev_id
        self.server_send(answer, None)

    def server_send(self, pdu, addr):
        request, self.pending = self.pending, None
        frame = self.framer.buildFrame(pdu)
        if self.peer.mangle:
            frame = self.peer.mangle(request, frame)
        if self.ended or not frame:
            return
        self.peer.answers += 1
        self.send(frame)

    def drop(self, reset):
        if self.ended or not self.transport:
            return
        self.ended = True
        if reset:
            sock = self.transport.get_extra_info("socket")
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.transport.abort() if reset else self.transport.close()


class Server(ModbusTcpServer):
    def __init__(self, peer, device, port):
        super().__init__(device, address=("127.0.0.1", port))
        self.peer = peer

    def callback_new_connection(self):
        return Handler(self)


class Words:
    """The registers of a table, by address."""

    def __init__(self, block):
        self.words = block[2]

    def __getitem__(self, where):
        return self.words[where]

    def __setitem__(self, where, value):
        if isinstance(where, slice):  # in one step: no request sees half of it
            value = list(value)
            where = slice(where.start, where.start + len(value))
        self.words[where] = value

    def pack(self, start, form, *values):
        """Puts values as struct has them, most significant byte first: pack(4, "f", 1.5)."""
        self.put(start, struct.pack(">" + form, *values))

    def unpack(self, start, form):
        return struct.unpack(">" + form, self.bytes(start, struct.calcsize(">" + form)))

    def put(self, start, data):
        """Puts bytes, the first one into the upper half of register `start`."""
        self[start:] = struct.unpack(f">{len(data) // 2}H", data)

    def bytes(self, start, size):
        return struct.pack(f">{size // 2}H", *self.words[start:start + size // 2])


class Bits:
    """Coils or discrete inputs, by address; pymodbus keeps 16 to a word."""

    def __init__(self, block):
        self.words = block[2]

    def __getitem__(self, i):
        return bool(self.words[i // 16] >> i % 16 & 1)

    def __setitem__(self, i, on):
        bit = 1 << i % 16
        self.words[i // 16] = self.words[i // 16] & ~bit | (bit if on else 0)


@dataclass
class Refusal:
    """A rule: these functions are refused where they touch these addresses."""
    code: int
    functions: tuple
    first: int
    last: int

    def meets(self, request):
        return (request.function in self.functions and request.start <= self.last and
                self.first < request.start + request.count)


class ModbusPeer:
    """size: addresses of each table, from 0; beyond them pymodbus answers exception 2.
    unit: the only one that it is (None: every one); unit_code: the exception for others
    (0: no answer)."""

    def __init__(self, size=2000, unit=None, unit_code=0, port=0):
        size = -(-size // 16) * 16
        bits = [[SimData(0, values=[False] * size, datatype=DataType.BITS)] for _ in "cd"]
        words = [[SimData(0, values=[0] * size, datatype=DataType.REGISTERS)] for _ in "hi"]
        self.device = SimDevice(0, simdata=(*bits, *words))
        self.unit, self.unit_code, self.port = unit, unit_code, port or free_port()
        self.requests, self.errors, self.handlers = [], [], []
        self.answers = 0
        self.rules = []
        self.silent = False
        self.held = False  # a request waits for `answering`
        self.delay = 0  # s, before each answer
        self.answering = threading.Event()  # while clear, answers wait,
        self.reads_go_on = False  # or those of writes alone
        self.answering.set()
        self.mangle = None  # (request, frame) -> what goes out instead; nothing: b""
        self.core = self.server = None
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self.thread.start()
        self.power_on()
        block = self.core.devices[0].block
        self.coils, self.discrete = Bits(block["c"]), Bits(block["d"])
        self.holding, self.input = Words(block["h"]), Words(block["i"])

    # --- power and cables ------------------------------------------------------------------

    def _do(self, coroutine):
        return asyncio.run_coroutine_threadsafe(coroutine, self.loop).result(LIMIT)

    def power_on(self):
        """Listens, at the same port and with the same memory as before."""
        async def start():
            server = Server(self, self.device, self.port)
            if self.core:
                server.context = self.core
            await server.serve_forever(background=True)
            return server
        self.server = self._do(start())
        self.core = self.server.context

    def power_off(self):
        """No listening, all connections reset."""
        async def stop():
            server, self.server = self.server, None
            for handler in self.handlers:
                handler.drop(reset=True)
            if server:
                await server.shutdown()
        self._do(stop())

    def hang_up(self, reset=False):
        """Ends all connections; the PLC goes on listening."""
        async def end():
            for handler in self.handlers:
                handler.drop(reset)
        self._do(end())

    def close(self):
        """What broke the standard in a test is a failure of the test."""
        self.answering.set()
        self.power_off()
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join(LIMIT)
        self.loop.close()
        assert not self.errors, "\n".join(self.errors[:10])

    def configure(self, inputs="", outputs="", name="PLC", unit=1, timeout=None):
        """The modbusplcConfigure line for this PLC."""
        more = f", {timeout}" if timeout else ""
        return (f'modbusplcConfigure("{name}", "127.0.0.1", {self.port}, {unit}, '
                f'"{inputs}", "{outputs}"{more})')

    # --- faults ----------------------------------------------------------------------------

    def refuse(self, functions, first, count=1, code=2):
        """Requests of these functions that touch these addresses get an exception."""
        functions = functions if isinstance(functions, tuple) else (functions,)
        rule = Refusal(code, functions, first, first + count - 1)
        self.rules.append(rule)
        return rule

    def without(self, function):
        """The PLC does not know a function: exception 1."""
        return self.refuse(function, 0, 65536, code=1)

    def refuse_no_more(self, rule=None):
        self.rules[:] = [r for r in self.rules if rule is not None and r is not rule]

    def judge(self, request):
        return next((rule.code for rule in list(self.rules) if rule.meets(request)), 0)

    # --- what came -------------------------------------------------------------------------

    @property
    def connections(self):
        return len(self.handlers)

    def mark(self):
        return len(self.requests)

    def since(self, mark=0, function=None):
        return [r for r in self.requests[mark:] if function in (None, r.function)]

    def writes(self, mark=0):
        return [r for r in self.requests[mark:] if r.function in FUNCTIONS and r.writes]

    def written(self, mark=0, table="holding"):
        """The addresses that were written, also in vain."""
        return {a for r in self.writes(mark) if r.table == table for a in r.addresses()}

    def wait_connected(self, count=1):
        until(lambda: self.connections >= count, f"connection {count}")

    def wait_requests(self, count, mark=None, function=None, limit=LIMIT):
        """Waits for so many requests from now on, or from a mark on; returns them."""
        mark = self.mark() if mark is None else mark
        until(lambda: len(self.since(mark, function)) >= count,
              lambda: f"{count} requests; came: {self.since(mark, function)[-5:]}", limit)
        return self.since(mark, function)
