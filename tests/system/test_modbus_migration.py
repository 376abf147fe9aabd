"""From asyn's module modbus to a station: the example of docs/modbus.md, before and after, on the same server;
and each data type of that module. What is before runs where PLCLINK_ASYN_MODBUS names the top of a built module."""
import os
import struct
from pathlib import Path

import pytest

from client import ARCH
from docblocks import blocks
from ioc import Ioc, errors_in
from waiting import until, until_equal

MODULE = os.environ.get("PLCLINK_ASYN_MODBUS")
PROGRAM = f"{MODULE}/bin/{ARCH}/modbusApp"
with_module = pytest.mark.skipif(not MODULE, reason="PLCLINK_ASYN_MODBUS names no module modbus")


def block(beginning, behind=0):
    """The code block of docs/modbus.md that begins so, or one behind it."""
    page = [b for b in blocks() if b.page == "modbus.md"]
    at = next(i for i, b in enumerate(page) if b.text.startswith(beginning))
    return page[at + behind].text


def here(commands, plc):
    """With the address of the server of this test."""
    return commands.replace("192.168.0.20:502", f"127.0.0.1:{plc.port}") \
                   .replace('"192.168.0.20", 502', f'"127.0.0.1", {plc.port}')


@pytest.fixture
def new_before(tmp_path, closing):
    """An IOC with asyn's module."""
    def make(commands, db):
        ioc = Ioc.__new__(Ioc)
        ioc._setup("before:", (), None, PROGRAM)
        (tmp_path / "before.db").write_text(db)
        ioc.script = tmp_path / "before.cmd"
        ioc.script.write_text(f'dbLoadDatabase("{MODULE}/dbd/modbusApp.dbd")\nmodbusApp_registerRecordDeviceDriver(pdbbase)\n'
                              f'{commands}\ndbLoadRecords("{tmp_path}/before.db", "P={ioc.P}")\niocInit\n')
        closing(ioc)
        return ioc.start()
    return make


# --- The example -------------------------------------------------------------------------------------

def swapped(text, size):
    """A text with the first character in the lower half of each register."""
    data = text.encode().ljust(size, b"\0")
    return b"".join(data[i + 1:i + 2] + data[i:i + 1] for i in range(0, size, 2))


def words_low_first(form, value):
    data = struct.pack(">" + form, value)
    return b"".join(data[i:i + 2] for i in range(len(data) - 2, -1, -2))


def fill(plc):
    plc.holding.put(0, words_low_first("f", 21.5) + struct.pack(">HHh", 54321, 0x0F04, -1024))
    plc.holding.put(6, swapped("Chiller 2 of 3", 16))
    plc.holding.put(100, words_low_first("f", 19.25))


def use(plc, ioc):
    """Everything that the example has, in both directions."""
    ioc.wait_value("TEMP", 21.5)
    ioc.wait_value("COUNT", 54321)
    assert ioc.get("READY") == 1
    assert ioc.get("PRESSURE") == pytest.approx(-5, abs=0.01)
    until_equal(lambda: ioc.text("NAME"), "Chiller 2 of 3")
    ioc.wait_value("SETTEMP", 19.25)
    plc.holding[3] = 0x00FB
    ioc.wait_value("READY", 0)
    for name, value, register, data in (("SETTEMP", -40.125, 100, words_low_first("f", -40.125)),
                                        ("MODE", 1234, 102, b"\x12\x34"), ("SETNAME", "Room 7", 104, swapped("Room 7", 6))):
        ioc.put(name, value)
        until_equal(lambda: plc.holding.bytes(register, len(data)), data)
    for value in (1, 0, 1):
        ioc.put("START", value)
        until_equal(lambda: plc.coils[3], bool(value))
    assert [plc.coils[i] for i in range(8)] == [False] * 3 + [True] + [False] * 4
    for name in ("TEMP", "COUNT", "READY", "PRESSURE", "NAME", "SETTEMP", "MODE", "SETNAME", "START"):
        assert ioc.severity(name) == "NO_ALARM", name


def test_after(new_modbus, new_ioc):
    """the example of docs/modbus.md, after: values in both directions, no word in the log"""
    plc = new_modbus()
    fill(plc)
    ioc = new_ioc(here(block('modbusplcConfigure("DEV"'), plc), block('modbusplcConfigure("DEV"', 1))
    use(plc, ioc)
    assert not errors_in(ioc.log)


@with_module
def test_before(new_modbus, new_before):
    """the example of docs/modbus.md, before, by asyn's module: the same values"""
    plc = new_modbus()
    fill(plc)
    begin = 'drvAsynIPPortConfigure("DEVIP"'
    use(plc, new_before(here(block(begin), plc), block(begin, 1)))


# --- Data types --------------------------------------------------------------------------------------

INT = {"INT16": (-12345, "INT16"), "UINT16": (54321, "UINT16"), "INT16SM": (-1234, "SM16"),
       "BCD_UNSIGNED": (9876, "BCD16"), "BCD_SIGNED": (-5432, "SBCD16")}
WIDE = {"INT32": -1234567890, "UINT32": 0x7A6B5C4D, "INT64": -0x12345678ABCDEF, "UINT64": 0x19283746A5B4C3,
        "FLOAT32": struct.unpack("f", struct.pack("f", -1.2345e-7))[0], "FLOAT64": 3.14159265358979e100}
ORDERS = {"LE": "CDAB", "LE_BS": "DCBA", "BE": "ABCD", "BE_BS": "BADC"}
TEXTS = {"STRING_HIGH": "W=A0", "STRING_LOW": "W=0A", "STRING_HIGH_LOW": "", "STRING_LOW_HIGH": "W=BADC"}
TEXT = "Press 32"


def data_types():
    """[name there, link here, value, bytes that it takes, asyn's interface, record types]"""
    rows = [(name, f"T={kind}", value, 2, "asynInt32", "longin", "longout") for name, (value, kind) in INT.items()]
    for kind, value in WIDE.items():
        ours = kind.replace("FLOAT", "REAL")
        face, records = ("asynFloat64", ("ai", "ao")) if "FLOAT" in kind else \
            ("asynInt64", ("int64in", "int64out")) if "64" in kind or kind == "UINT32" else ("asynInt32", ("longin", "longout"))
        rows += [(f"{kind}_{order}", f"T={ours} W={letters}", value, 8 if "64" in kind else 4, face, *records) for order, letters in ORDERS.items()]
    for name, order in TEXTS.items():
        size = 40 if name in ("STRING_HIGH", "STRING_LOW") else 20
        for z in ("", "Z"):
            rows.append((f"{z}{name}=20", f"T=STRING L={size} {order}", TEXT, len(TEXT) * size // 20, "asynOctet",
                         "stringin", "stringout"))
    return rows


PLACE, OUT = 20, 1000  # registers for each; where outputs begin


def data_type_db(before):
    db = ""
    for i, (name, link, _, _, face, record_in, record_out) in enumerate(data_types()):
        octet = face == "asynOctet"
        for way, record, field, port in (("in", record_in, "INP", "R"), ("out", record_out, "OUT", "W")):
            dtyp = (face + ("Read" if way == "in" else "Write") * octet) if before else "S7plc"
            text = f"@asyn({port}{i}, 0){name}" if before else f"@DEV/{2 * PLACE * i} {link}"
            scan = 'field(SCAN, "I/O Intr")' if way == "in" else 'info(asyn:INITIAL_READBACK, "0")'
            db += f'record({record}, "$(P){way}{i}") {{ field(DTYP, "{dtyp}") field({field}, "{text}") {scan} }}\n'
    return db


def run(plc, ioc):
    """Puts each value, brings what that makes to the inputs, and reads it. Returns the bytes of all."""
    made = []
    for i, (_, _, value, size, *_) in enumerate(data_types()):
        plc.holding[OUT + PLACE * i:] = [0x2323] * PLACE
        ioc.put(f"out{i}", value)
        until(lambda: plc.holding.bytes(OUT + PLACE * i, size) != b"#" * size, f"a write of out{i}")
        made.append(plc.holding.bytes(OUT + PLACE * i, size))
        plc.holding.put(PLACE * i, made[i].ljust(2 * PLACE, b"\0"))
        until_equal(lambda: ioc.text(f"in{i}") if value == TEXT else ioc.plain(f"in{i}"), value)
        assert ioc.severity(f"in{i}") == ioc.severity(f"out{i}") == "NO_ALARM"
        plc.holding[PLACE * i:] = [0] * PLACE
    return made


@with_module
def test_data_types(new_modbus, new_ioc, new_before):
    """each data type of asyn's module: a put makes the same registers, and they are read as the same value"""
    rows, plc = data_types(), new_modbus(size=2000)
    ports = "".join(f'drvModbusAsynConfigure("R{i}", "DEVIP", 1, 3, {PLACE * i}, {PLACE}, "INT16", 100, "device")\n'
                    f'drvModbusAsynConfigure("W{i}", "DEVIP", 1, 16, {OUT + PLACE * i}, {PLACE}, "INT16", 0, "device")\n'
                    for i in range(len(rows)))
    before = new_before(f'drvAsynIPPortConfigure("DEVIP", "127.0.0.1:{plc.port}", 0, 0, 1)\n'
                        f'modbusInterposeConfig("DEVIP", 0, 2000, 0)\n{ports}', data_type_db(True))
    theirs = run(plc, before)
    before.exit()
    n = PLACE * len(rows)
    ours = run(plc, new_ioc(plc.configure(f"holding 0 {n}", f"holding {OUT} {n}", name="DEV"), data_type_db(False)))
    print(f"\n{'asyn modbus':20}{'here':24}{'value':>26}  registers")
    for (name, link, value, *_), a, b in zip(rows, theirs, ours):
        print(f"{name:20}{link:24}{value!r:>26}  {b.hex()}")
        assert a == b, (name, a.hex(), b.hex())
