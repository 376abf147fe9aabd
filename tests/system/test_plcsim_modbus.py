"""plcSim's Modbus seen by independent peers: pymodbus's client, mbpoll, and plain sockets."""
import contextlib
import math
import re
import select
import shutil
import socket
import struct
import subprocess
import threading
import time

import pytest
from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException

from client import TOP
from sim import PROGRAM
from test_plcsim import SYNC, Client, flags_become, status, sync_block
from waiting import LIMIT, until, until_equal

TYPES = ModbusTcpClient.DATATYPE

# Register n and coil n of each table have places of their own.
PLC = """
in = 32
period = 10 ms
modbus_port = 0
db 10 400
db 11 400
db 20 256
db 21 256
tx P#DB10.DBX0.0 BYTE 32 -> 0
modbus holding  0 150   -> DB10.0
modbus holding  1000 25 -> DB10.300 readonly
modbus input    0 150   -> DB11.0
modbus coils    0 2048  -> DB20.0
modbus discrete 0 2048  -> DB21.0
"""


@pytest.fixture
def sim(new_sim):
    return new_sim(PLC)


@pytest.fixture
def new_master(closing):
    """new_master(sim) is a client of pymodbus. timeout: s, for what is not answered."""
    def make(sim, timeout=LIMIT):
        master = ModbusTcpClient("127.0.0.1", port=sim.modbus_port, timeout=timeout, retries=0)
        closing(master)
        assert master.connect()
        return master
    return make


@pytest.fixture
def master(sim, new_master):
    return new_master(sim)


@pytest.fixture
def wire(sim, closing):
    connection = Wire(sim)
    closing(connection)
    return connection


class Wire:
    """Requests byte by byte: what pymodbus will not send."""

    def __init__(self, sim):
        self.socket = socket.create_connection(("127.0.0.1", sim.modbus_port), LIMIT)
        self.socket.settimeout(LIMIT)

    def ask(self, pdu, unit=1):
        """Returns the answer from the function on."""
        self.socket.sendall(struct.pack(">HHHB", 7, 0, len(pdu) + 1, unit) + pdu)
        transaction, protocol, length, answered = struct.unpack(">HHHB", self.read(7))
        assert (transaction, protocol, answered) == (7, 0, unit)
        return self.read(length - 1)

    def read(self, size):
        data = b""
        while len(data) < size:
            piece = self.socket.recv(size - len(data))
            if not piece:
                raise EOFError(f"{len(data)} bytes of {size}: {data.hex(' ')}")
            data += piece
        return data

    def close(self):
        self.socket.close()


def read(master, table, *args, **kw):
    """The values of a table, by the function for it."""
    function = {"holding": master.read_holding_registers, "input": master.read_input_registers,
                "coils": master.read_coils, "discrete": master.read_discrete_inputs}[table]
    answer = function(*args, **kw)
    assert not answer.isError(), answer
    return answer.registers if table in ("holding", "input") else answer.bits[:kw["count"]]


def good(answer):
    assert not answer.isError(), answer
    return answer


def numbers(sim, line):
    """The name=value pairs of a line of `modbus`."""
    text = next(text for text in sim.command("modbus").splitlines() if text.startswith(line))
    return dict(pair.split("=", 1) for pair in text[len(line):].split() if "=" in pair)


def last_request(sim):
    return sim.command("modbus received").splitlines()[-1]


# ---- tables and functions ----------------------------------------------------------------

@pytest.mark.parametrize("table, block", [("holding", "DB10"), ("input", "DB11")])
def test_read_registers(sim, master, table, block):
    """pymodbus reads {table} registers: what the HMI has set"""
    sim.command(f"set {block}.0 UINT16[5] 0 1 0xfffe 0x1234 65535")
    sim.command(f"set {block}.DBW298 77")
    assert read(master, table, 0, count=5) == [0, 1, 0xfffe, 0x1234, 65535]
    assert read(master, table, 25, count=125)[124] == 77
    assert read(master, table, 3, count=1) == [0x1234]


@pytest.mark.parametrize("table, block", [("coils", "DB20"), ("discrete", "DB21")])
def test_read_bits(sim, master, table, block):
    """pymodbus reads {table}: the first one is bit 0 of the first byte"""
    sim.command(f"set {block}.DBB0 0x01")
    sim.command(f"set {block}.DBB1 0x82")
    sim.command(f"set {block}.DBX255.7 1")
    wanted = [True] + 8 * [False] + [True] + 5 * [False] + [True]
    assert read(master, table, 0, count=16) == wanted
    assert read(master, table, 9, count=7) == wanted[9:]
    assert read(master, table, 48, count=2000) == 1999 * [False] + [True]


def test_write_registers(sim, master):
    """pymodbus writes registers by functions 6, 16, 22 and 23; the PLC holds them"""
    good(master.write_register(0, 0xabcd))
    assert last_request(sim).endswith("fc=6 write=holding,0,1 answer=ok pdu=06 00 00 ab cd")
    good(master.write_registers(1, [1, 2, 3]))
    good(master.mask_write_register(address=3, and_mask=0xff02, or_mask=0x0040))
    answer = good(master.readwrite_registers(read_address=0, read_count=6, write_address=4,
                                             values=[44, 55]))
    assert answer.registers == [0xabcd, 1, 2, 0x42, 44, 55]
    assert sim.command("get DB10.0 UINT16[6]").endswith(" = 43981 1 2 66 44 55")


def test_write_coils(sim, master):
    """pymodbus writes coils by functions 5 and 15, and no other bit changes"""
    sim.command("set DB20.DBD0 0xffff0000")
    good(master.write_coil(3, False))
    good(master.write_coil(20, True))
    good(master.write_coils(10, [False, True, False, True, False, True, True, False]))
    bits = read(master, "coils", 0, count=32)
    wanted = 16 * [True] + 16 * [False]
    wanted[3], wanted[20] = False, True
    wanted[10:18] = [False, True, False, True, False, True, True, False]
    assert bits == wanted


@pytest.mark.parametrize("pdu, code", [
    ("03 0096 0001", 2), ("03 0095 0002", 2), ("04 0096 0001", 2), ("01 0800 0001", 2),
    ("02 07ff 0002", 2), ("06 0096 0000", 2), ("06 03e8 0000", 2), ("10 03e8 0001 02 0000", 2),
    ("16 03e8 0000 0000", 2), ("05 0800 ff00", 2), ("05 0000 ff01", 3), ("0f 0000 0009 01 00", 3),
    ("10 0000 0002 03 000000", 3), ("03 0000", 3), ("07", 1), ("08 0000 0000", 1), ("11", 1),
    ("18 0000", 1), ("2b 0e 01 00", 1), ("64", 1)])
def test_refused(wire, pdu, code):
    """The request {pdu} gets exception {code}"""
    request = bytes.fromhex(pdu)
    assert wire.ask(request) == bytes([request[0] | 0x80, code])


@pytest.mark.parametrize("server", ["modbus", "etherip"])
def test_connections_end(new_sim, server):
    """{server} close and reset end all connections, with FIN and with RST, and the next one is taken"""
    sim = new_sim("byteorder = little\nmodbus_port = 0\netherip_port = 0\ndb 10 8\nmodbus holding 0 4 -> DB10.0\ntag A DINT\n")
    port = {"modbus": sim.modbus_port, "etherip": sim.etherip_port}[server]
    for command in ("close", "reset"):
        before = len([line for line in sim.lines if re.search(r"connection \d+ from \S+$", line)])
        plcs = [socket.create_connection(("127.0.0.1", port), LIMIT) for _ in range(2)]
        until(lambda: len([line for line in sim.lines if re.search(r"connection \d+ from \S+$", line)]) == before + 2, lambda: "\n".join(sim.lines))
        sim.command(f"{server} {command}")
        for plc in plcs:
            try:
                assert plc.recv(1) == b"" and command == "close"
            except ConnectionResetError:
                assert command == "reset"
            plc.close()
    sim.command(f"{server} refuse")
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), LIMIT)
    sim.command(f"{server} refuse off")
    socket.create_connection(("127.0.0.1", port), LIMIT).close()


def test_no_function(wire):
    """A function of 128 and more gets no answer, and the next request one"""
    wire.socket.sendall(bytes.fromhex("0001 0000 0006 01 83 0000 0001" + "0002 0000 0006 01 03 0000 0001"))
    assert wire.socket.recv(100)[:8] == bytes.fromhex("0002 0000 0005 01 03")


def test_without(new_sim, new_master):
    """modbus without 22 23: exception 1, and the others work"""
    sim = new_sim(PLC + "modbus without 22 23\n")
    master = new_master(sim)
    assert master.mask_write_register(address=3, and_mask=0, or_mask=1).exception_code == 1
    assert master.readwrite_registers(read_address=0, read_count=1, write_address=0,
                                      values=[1]).exception_code == 1
    assert read(master, "holding", 0, count=1) == [0]
    assert numbers(sim, "modbus areas:")["without"] == "22,23"


# ---- limits ------------------------------------------------------------------------------

def writing(function, count, size):
    return struct.pack(">BHHB", function, 0, count, size) + size * b"\x5a"


LIMITS = [
    (3, struct.pack(">BHH", 3, 0, 125), None), (3, struct.pack(">BHH", 3, 0, 126), 3),
    (4, struct.pack(">BHH", 4, 0, 125), None), (4, struct.pack(">BHH", 4, 0, 126), 3),
    (1, struct.pack(">BHH", 1, 0, 2000), None), (1, struct.pack(">BHH", 1, 0, 2001), 3),
    (2, struct.pack(">BHH", 2, 0, 2000), None), (2, struct.pack(">BHH", 2, 0, 2001), 3),
    (16, writing(16, 123, 246), None), (16, writing(16, 124, 248), 3),
    (16, writing(16, 127, 254), 3),
    (15, writing(15, 1968, 246), None), (15, writing(15, 1969, 247), 3),
    (3, struct.pack(">BHH", 3, 0, 0), 3), (1, struct.pack(">BHH", 1, 0, 65535), 3),
    (23, struct.pack(">BHHHHB", 23, 0, 125, 0, 121, 242) + bytes(242), None),
    (23, struct.pack(">BHHHHB", 23, 0, 126, 0, 1, 2) + bytes(2), 3),
    (23, struct.pack(">BHHHHB", 23, 0, 1, 0, 122, 244) + bytes(244), 3),
]


@pytest.mark.parametrize("function, request_, code", LIMITS,
                         ids=[f"function {f}, {len(r)} bytes {r[3:5].hex()}: {c or 'served'}"
                              for f, r, c in LIMITS])
def test_limits(wire, function, request_, code):
    """The standard's limits: {id}"""
    answer = wire.ask(request_)
    if code:
        assert answer == bytes([function | 0x80, code])
    else:
        assert answer[0] == function
    assert wire.ask(struct.pack(">BHH", 3, 0, 1))[0] == 3, "and the connection goes on"


def test_largest(sim, master):
    """pymodbus reads and writes as much as fits, and `modbus` shows the largest requests"""
    values = [(997 * i) % 65536 for i in range(123)]
    good(master.write_registers(10, values))
    assert read(master, "holding", 9, count=125)[1:124] == values
    bits = [i % 3 == 0 for i in range(1968)]
    good(master.write_coils(5, bits))
    assert read(master, "coils", 5, count=1968) == bits
    assert len(read(master, "discrete", 0, count=2000)) == 2000
    assert numbers(sim, "modbus largest:") == {
        "read_registers": "125", "read_bits": "2000",
        "write_registers": "123", "write_bits": "1968"}
    counts = numbers(sim, "modbus requests:")
    assert (counts["total"], counts["fc16"], counts["fc1"]) == ("5", "1", "1")
    sim.command("modbus clear")
    assert numbers(sim, "modbus requests:")["total"] == "0"


# ---- values of 32 and 64 bits --------------------------------------------------------------

VALUES = [("INT32", -123456789), ("UINT32", 0x80010002), ("INT64", -(2 ** 62) - 3),
          ("UINT64", 2 ** 63 + 5), ("REAL32", -1.5e-10), ("REAL64", math.pi * 1e200)]


@pytest.mark.parametrize("order", ["big", "little"])
@pytest.mark.parametrize("name, value", VALUES, ids=[name for name, _ in VALUES])
def test_word_order(new_sim, new_master, name, value, order):
    """{name}: a {order} endian PLC has that order of words, read and written by pymodbus"""
    sim = new_sim(PLC, "-o", f"byteorder={order}")
    master = new_master(sim)
    kind = TYPES[name.replace("REAL", "FLOAT")]
    sim.command(f"set DB10.8 {name} {value!r}")
    registers = read(master, "holding", 4, count=kind.value[1])
    got = master.convert_from_registers(registers, kind, word_order=order)
    assert got == pytest.approx(value, rel=1e-6 if name == "REAL32" else 0)
    good(master.write_registers(20, master.convert_to_registers(value, kind, word_order=order)))
    text = sim.command(f"get DB10.40 {name}").split(" = ")[1]
    assert float(text) == pytest.approx(value, rel=1e-6) and (
        "REAL" in name or int(text) == value)


# ---- mbpoll --------------------------------------------------------------------------------

@pytest.fixture
def mbpoll(sim):
    if not shutil.which("mbpoll"):
        pytest.skip("needs mbpoll")

    def run(*args, port=None):
        """Returns the values by reference, or what it complains of."""
        done = subprocess.run(
            ["mbpoll", "-m", "tcp", "-p", str(port or sim.modbus_port), "-0", "-1", "-o", "10",
             *args[:-1], "127.0.0.1", *args[-1]], capture_output=True, text=True, timeout=LIMIT)
        rows = [line for line in done.stdout.splitlines() if line.startswith("[")]
        if rows:
            return {int(row[1:row.index("]")]): row.split("\t")[1].split()[0] for row in rows}
        return done.stdout + done.stderr
    return run


@pytest.mark.parametrize("kind, block", [("4", "DB10"), ("3", "DB11")])
def test_mbpoll_registers(sim, mbpoll, kind, block):
    """mbpoll reads registers (-t {kind})"""
    sim.command(f"set {block}.20 UINT16[3] 1 2 30000")
    assert mbpoll("-t", kind, "-r", "10", "-c", "3", []) == {10: "1", 11: "2", 12: "30000"}


@pytest.mark.parametrize("kind, block", [("0", "DB20"), ("1", "DB21")])
def test_mbpoll_bits(sim, mbpoll, kind, block):
    """mbpoll reads bits (-t {kind})"""
    sim.command(f"set {block}.DBB2 0x05")
    assert mbpoll("-t", kind, "-r", "16", "-c", "4", []) == {16: "1", 17: "0", 18: "1", 19: "0"}


def test_mbpoll_writes(sim, mbpoll):
    """mbpoll writes one register or coil by functions 6 and 5, several by 16 and 15"""
    assert "Written 1 ref" in mbpoll("-t", "4", "-r", "5", ["1234"])
    assert " fc=6 " in last_request(sim)
    assert "Written 3 ref" in mbpoll("-t", "4", "-r", "6", ["1", "2", "3"])
    assert " fc=16 " in last_request(sim)
    assert sim.command("get DB10.10 UINT16[4]").endswith("= 1234 1 2 3")
    assert "Written 1 ref" in mbpoll("-t", "0", "-r", "9", ["1"])
    assert " fc=5 " in last_request(sim)
    assert "Written 3 ref" in mbpoll("-t", "0", "-r", "10", ["0", "1", "1"])
    assert " fc=15 " in last_request(sim)
    assert sim.command("get DB20.DBB1") == "DB20.DBB1 = 26"


@pytest.mark.parametrize("order, options", [("big", ["-B"]), ("little", [])])
def test_mbpoll_wide(new_sim, mbpoll, order, options):
    """mbpoll reads and writes integers and floats of 32 bits in a {order} endian PLC"""
    sim = new_sim(PLC, "-o", f"byteorder={order}")
    sim.command("set DB10.0 INT32[2] -2 70000")
    sim.command("set DB10.20 REAL32 2.5")
    port = sim.modbus_port
    assert mbpoll(*options, "-t", "4:int", "-r", "0", "-c", "2", [], port=port) == {
        0: "-2", 2: "70000"}
    assert mbpoll(*options, "-t", "4:float", "-r", "10", [], port=port) == {10: "2.5"}
    mbpoll(*options, "-t", "4:float", "-r", "12", ["0.125"], port=port)
    assert sim.command("get DB10.24 REAL32").endswith(" = 0.125")
    mbpoll(*options, "-t", "4:int", "-r", "14", ["100000"], port=port)
    assert sim.command("get DB10.28 INT32").endswith(" = 100000")


@pytest.mark.parametrize("code, words", [
    (1, "Illegal function"), (2, "Illegal data address"), (3, "Illegal data value"),
    (4, "Slave device or server failure"), (5, "Acknowledge"),
    (6, "Slave device or server is busy"), (7, "Negative acknowledge"),
    (8, "Memory parity error"), (10, "Gateway path unavailable"),
    (11, "Target device failed to respond")])
def test_mbpoll_exceptions(sim, mbpoll, code, words):
    """mbpoll is told exception {code}: {words}"""
    sim.command(f"modbus exception {code}")
    assert words in mbpoll("-t", "4", "-r", "0", [])


# ---- faults --------------------------------------------------------------------------------

@pytest.mark.parametrize("code", range(1, 12))
def test_exceptions(sim, master, code):
    """Exception {code}, for each function; then everything works again"""
    sim.command(f"modbus exception {code} next 5")
    answers = [master.read_coils(0, count=1), master.read_input_registers(0, count=1),
               master.write_register(0, 7), master.write_coils(0, [True]),
               master.mask_write_register(address=0, and_mask=0, or_mask=1)]
    assert [answer.exception_code for answer in answers] == 5 * [code]
    assert numbers(sim, "modbus exceptions:")[f"ex{code}"] == "5"
    assert read(master, "holding", 0, count=1) == [0], "nothing was written"


def test_one_register_refused(sim, master):
    """A PLC that refuses to have one register written, and is read all the same"""
    sim.command("modbus exception 2 holding 17 write")
    assert master.write_registers(10, 20 * [1]).exception_code == 2
    assert master.write_register(17, 1).exception_code == 2
    good(master.write_registers(10, 7 * [1]))
    good(master.write_registers(18, 2 * [1]))
    assert read(master, "holding", 10, count=10) == 7 * [1] + [0] + 2 * [1]
    assert "modbus faults: exception=2,write,holding=17..17" in sim.command("status")
    sim.command("modbus slow 1 input")
    sim.command("modbus exception off")
    good(master.write_register(17, 1))
    assert "modbus faults: slow=1,input" in sim.command("status")
    sim.command("modbus exception 2 holding 17 write")
    sim.command("modbus normal")
    good(master.write_register(17, 1))
    assert "modbus faults: none" in sim.command("status")


def test_busy(sim, master):
    """busy 3: three requests get exception 6"""
    sim.command("modbus busy 3")
    answers = [master.read_holding_registers(0, count=1) for _ in range(4)]
    assert [a.isError() and a.exception_code for a in answers] == [6, 6, 6, False]


def test_slow(sim, master, wire):
    """slow: the answer is late, and other clients do not wait for it"""
    sim.command("modbus slow 50 input")
    start = time.monotonic()
    read(master, "input", 0, count=1)
    assert time.monotonic() - start >= 0.05
    sim.command("modbus slow 3600000 function 6 next 1")
    wire.socket.sendall(bytes.fromhex("0001 0000 0006 01 06 0000 002a"))
    until(lambda: numbers(sim, "modbus requests:").get("fc6") == "1", "the request")
    assert read(master, "holding", 0, count=1) == [42], "it is done at once"
    assert not select.select([wire.socket], [], [], 0)[0]


@pytest.mark.parametrize("fault", ["silent", "wrongid", "wrongunit", "short 5", "short 9 close",
                                   "close reply", "short 0 close", "garbage 40"])
def test_no_answer(sim, new_master, fault):
    """{fault}: pymodbus gets no answer, and the next connection works"""
    master = new_master(sim, timeout=0.2)
    sim.command(f"modbus {fault} next 1")
    try:
        answer = master.read_holding_registers(0, count=1)
    except ModbusException:
        answer = None
    assert answer is None or answer.isError() or not answer.registers
    assert numbers(sim, "modbus requests:")["total"] == "1"
    assert read(new_master(sim), "holding", 0, count=1) == [0]
    sim.command(f"modbus {fault} next 1")
    with contextlib.suppress(ModbusException):
        new_master(sim, timeout=0.2).write_register(0, 7)
    wanted = 0 if fault == "silent" else 7  # the others do what is asked
    assert read(new_master(sim), "holding", 0, count=1) == [wanted]


def test_wrong_unit(new_sim, new_master, sim):
    """Another unit gets no answer, or exception 11 with modbus_otherunit = exception"""
    silent = new_master(sim, timeout=0.2)
    with pytest.raises(ModbusException):
        silent.read_holding_registers(0, count=1, device_id=2)
    until(lambda: any("unit 2 is not here, 1 is: no answer" in line for line in sim.lines),
          "a line in the log")
    gateway = new_sim(PLC, "-o", "modbus_otherunit=exception", "-o", "modbus_unit=255")
    master = new_master(gateway)
    assert master.read_holding_registers(0, count=1, device_id=1).exception_code == 11
    good(master.read_holding_registers(0, count=1, device_id=255))
    any_ = new_master(new_sim(PLC, "-o", "modbus_unit=any"))
    for unit in 0, 1, 77, 255:
        good(any_.read_holding_registers(0, count=1, device_id=unit))


def test_restart_and_unplug(sim, new_master):
    """restart, unplug, refuse: Modbus goes with the PLC, and comes back at its port"""
    master = new_master(sim, timeout=0.3)
    sim.command("set DB10.DBW0 5")

    def fails():
        try:
            return master.read_holding_registers(0, count=1).isError()
        except ModbusException:
            return True
    sim.command("unplug")
    assert fails()
    sim.command("plug")
    until(lambda: not fails(), "an answer after plug")
    sim.command("restart 50")
    assert fails()
    until(lambda: not fails(), "an answer after the restart")
    sim.command("modbus refuse")
    sim.command("modbus reset")
    assert fails()
    assert "modbus faults: refuse" in sim.command("status")
    sim.command("normal")
    until(lambda: not fails(), "an answer after refuse")
    assert read(master, "holding", 0, count=1) == [5]


# ---- clients and garbage --------------------------------------------------------------------

def test_eight_clients(sim, new_master, closing):
    """Eight clients read and write at a time, and blocks keep their pace"""
    block = Client(sim.port)
    closing(block)
    masters = [new_master(sim) for _ in range(8)]
    failures = []

    def work(number, master):
        for i in range(100):
            good(master.write_registers(40 + number, [i]))
            if read(master, "holding", 40 + number, count=1) != [i]:
                failures.append((number, i))
    threads = [threading.Thread(target=work, args=args) for args in enumerate(masters)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        block.read()
    for thread in threads:
        thread.join()
    assert not failures
    assert numbers(sim, "modbus requests:")["total"] == "1600"
    assert len(sim.command("modbus received").splitlines()) == 1
    kept = sim.command("modbus received 5000").splitlines()
    assert len(kept) == 1000 and kept[0].startswith("601 ") and kept[-1].startswith("1600 ")
    assert sim.command("get DB10.80 UINT16[8]").endswith(" = " + " ".join(8 * ["99"]))


@pytest.mark.parametrize("data", [b"GET / HTTP/1.0\r\n\r\n", bytes(64), b"\xff" * 300,
                                  bytes.fromhex("0001 0000 0001 01"),
                                  bytes.fromhex("0001 0000 0127 01 03")],
                         ids=["HTTP", "zeros", "ones", "too short", "too long"])
def test_garbage(sim, wire, master, data):
    """Garbage ({id}) ends its connection and no other"""
    read(master, "holding", 0, count=1)
    wire.socket.sendall(data)
    assert wire.socket.recv(1000) == b""
    assert numbers(sim, "modbus requests:")["garbage"] == "1"
    read(master, "holding", 0, count=1)


# ---- with the PLC program --------------------------------------------------------------------

def test_block(sim, master, closing):
    """A register that Modbus writes is in a block that comes later, and the other way round"""
    block = Client(sim.port)
    closing(block)
    good(master.write_registers(4, [0x1234, 0x5678]))
    until(lambda: block.read()[8:12] == bytes.fromhex("12345678"), "the block shows it")
    sim.command("hmi DB10.DBW8 99")
    assert read(master, "holding", 4, count=2) == [99, 0x5678]


def test_sync(new_sim, new_master, closing):
    """The sync handshake: Modbus beside it changes nothing; a setpoint by Modbus is as by HMI"""
    sim = new_sim(SYNC + "modbus_port = 0\nmodbus holding 0 8 -> DB10.0\n"
                  "modbus input 0 8 -> in.0\n")
    master = new_master(sim)
    client = Client(sim.port, size=16)
    closing(client)
    client.write(sync_block(1, 77))
    flags_become(client, 3)
    for _ in range(5):
        assert read(master, "holding", 0, count=2) == [0, 77]
        assert client.read()[0] == 3
    client.write(sync_block(2, 88))
    until_equal(lambda: read(master, "holding", 0, count=2), [0, 88])
    assert client.read()[0] == 3
    good(master.write_register(1, 99))
    flags_become(client, 2)  # a setpoint has moved: SYNC falls
    assert sim.command("get DB10.DBD0") == "DB10.DBD0 = 99"
    sim.command("local")
    good(master.write_register(1, 98))
    assert sim.command("get DB10.DBD0") == "DB10.DBD0 = 98"
    assert status(sim, "faults") == "faults: none"


def test_example(new_sim, new_master):
    """The example of docs/plcsim.md works"""
    manual = (TOP / "docs" / "plcsim.md").read_text().split("## Modbus")[1]
    text = next(part for part in manual.split("```") if "modbus_port = 1502" in part)
    sim = new_sim(text, "-o", "modbus_port=0")
    master = new_master(sim)
    good(master.write_registers(0, [1, 2, 3]))
    assert read(master, "holding", 0, count=3) == [1, 2, 3]
    good(master.write_coil(63, True))
    assert read(master, "holding", 503, count=1) == [0x0080]
    assert read(master, "discrete", 0, count=16) == 16 * [False]
    until(lambda: read(master, "input", 0, count=3) == [1, 2, 3], "the block shows them")


def test_file(tmp_path):
    """What the file says wrong is told with its line, and nothing starts"""
    file = tmp_path / "bad.plc"
    file.write_text("role = pair\nmodbus_port = 0\ndb 10 10\nmodbus holding 0 6 -> DB10.0\n")
    for options in ["-k"], []:
        done = subprocess.run([str(PROGRAM), *options, str(file)], capture_output=True, text=True, timeout=LIMIT)
        assert done.returncode != 0 and not done.stdout
        assert "bad.plc:4: 6 registers from DB10.0 on take 12 bytes" in done.stderr
        assert "modbus_port needs role = single" in done.stderr
