"""Blocks in, Modbus out (s7plcModbusOutput): what leaves, when, and whom a refusal concerns."""
import random
import re
import struct
import threading
import time

import epics
import pytest

from demos import run_demo
from ioc import SINCE_7_0_6, errors_in
from waiting import until, until_equal

IN = """
record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT16") field(SCAN, "I/O Intr") }
"""


IN_SIZE = 32  # bytes


class Station:
    """A PLC that sends blocks and serves Modbus on another port, and the IOC.

    Its records write registers 100 and up: byte offset 2 n is register 100 + n. They do not wait
    for the PLC (complete=sent), so that tests can put while an answer is held back."""

    START = 100

    def __init__(self, new_peer, new_modbus, new_ioc, db, *options, registers=400, big=1,
                 complete="sent", **kw):
        self.blocks = new_peer(IN_SIZE, 2 * registers)
        self.big = big
        self.plc = new_modbus(**kw)
        self.lines = (self.blocks.configure(recv_timeout=20000, send_interval=3600000, big=big) +
                      f'\ns7plcModbusOutput("PLC", "", {self.plc.port}, 1, {self.START})' +
                      "".join(f"\ns7plcSetOption PLC {option}"
                              for option in (f"complete {complete}", *options)))
        self.holding = self.plc.holding
        self.new_ioc, self.db = new_ioc, db

    def start(self, ready=True):
        self.ioc = self.new_ioc(self.lines, IN + self.db)
        self.blocks.wait_connected()
        self.show(5)
        if ready:
            self.ioc.wait_value("in", 5)
            until(lambda: self.plc.answers > 0 and self.plc.answers >= self.first_reads(),
                  "the first read of the registers")
        self.mark = self.plc.mark()
        return self

    def show(self, value):
        """Blocks with this value of record "in" from now on."""
        self.blocks.every(0.05, value.to_bytes(2, "big" if self.big else "little") + bytes(IN_SIZE - 2))

    def first_reads(self):
        return -(-self.blocks.out_size // 250)

    def register(self, n):
        return self.holding[self.START + n]

    def wait_register(self, n, value):
        until_equal(lambda: self.register(n), value)

    def writes(self):
        return self.plc.writes(self.mark)

    def written(self):
        """Offsets in registers that were written since the start."""
        return {a - self.START for a in self.plc.written(self.mark)}


@pytest.fixture
def new_station(new_peer, new_modbus, new_ioc):
    def make(db, *options, start=True, ready=True, **kw):
        station = Station(new_peer, new_modbus, new_ioc, db, *options, **kw)
        return station.start(ready) if start else station
    return make


def words(count, first=0, fields="", kind="INT16", step=1):
    """`count` longout records o0, o1, ... in registers first, first + step, ..."""
    return "\n".join(
        f'record(longout, "$(P)o{i}") {{ field(DTYP, "S7plc") '
        f'field(OUT, "@PLC/{2 * (first + step * i)} T={kind}") {fields} }}' for i in range(count))


def bits(count, register=0, fields=""):
    return "\n".join(f'record(bo, "$(P)b{i}") {{ field(DTYP, "S7plc") '
                     f'field(OUT, "@PLC/{2 * register} T=WORD B={i}") {fields} }}'
                     for i in range(count))


def put_together(station, values):
    """Puts that leave in one go: they gather behind a request that has no answer yet."""
    plc, ioc = station.plc, station.ioc
    ioc.connect([*values, *(name + ".SEVR" for name in values)])
    plc.answering.clear()
    until(lambda: plc.held, "a request on its way")
    for name, value in values.items():
        ioc.put(name, value)
    plc.answering.set()


# Requests that come by themselves, for puts to gather behind, and that may wait for a while
OFTEN = "readPeriod 20", "requestTimeout 30000"


# --- What leaves -------------------------------------------------------------------------------

def test_put(new_station):
    """a put is written to its register by itself, acknowledged, and the block connection carries none of it"""
    s = new_station(words(10))
    s.ioc.put("o3", 1234)
    s.wait_register(3, 1234)
    s.ioc.put("o3", -2)
    s.wait_register(3, 0xFFFE)
    assert [(r.function, r.start, r.count) for r in s.writes()] == [(16, 103, 1)] * 2
    assert s.ioc.alarm("o3") == ("NO_ALARM", "NO_ALARM", "")
    assert s.ioc.get("in") == 5
    assert s.blocks.connection.received == b""


ORDERS = [  # bigEndian, option, registers of INT16 0x1234, INT32 0x12345678 and "AB"
    (1, "", [0x1234, 0x1234, 0x5678, 0x4142]), (1, "wordOrder low", [0x1234, 0x5678, 0x1234, 0x4142]),
    (0, "", [0x1234, 0x5678, 0x1234, 0x4241]), (0, "wordOrder high", [0x1234, 0x1234, 0x5678, 0x4241])]


def test_byte_order(new_peer, new_modbus, new_ioc):
    """a register is the number of its two bytes in the PLC's order, whatever bigEndian and wordOrder are"""
    lines, db, plcs = [], "", []
    for i, (big, option, _) in enumerate(ORDERS):
        blocks, plc = new_peer(8, 8), new_modbus(size=16)
        plcs.append(plc)
        lines += [blocks.configure(name=f"PLC{i}", big=big, recv_timeout=60000),
                  f's7plcModbusOutput("PLC{i}", "", {plc.port}, 1, 3)']
        lines += [f"s7plcSetOption PLC{i} {option}"] if option else []
        db += f"""
            record(longout, "$(P)short{i}") {{ field(DTYP, "S7plc") field(OUT, "@PLC{i}/0 T=INT16") }}
            record(longout, "$(P)long{i}") {{ field(DTYP, "S7plc") field(OUT, "@PLC{i}/2 T=INT32") }}
            record(stringout, "$(P)text{i}") {{ field(DTYP, "S7plc") field(OUT, "@PLC{i}/6 L=2") }}
            """
    ioc = new_ioc("\n".join(lines), db)
    for i, (_, _, wanted) in enumerate(ORDERS):
        ioc.put(f"short{i}", 0x1234)
        ioc.put(f"long{i}", 0x12345678)
        ioc.put(f"text{i}", "AB")
        until_equal(lambda: plcs[i].holding[3:7], wanted)


def test_neighbours_together(new_station):
    """puts that come while a request is on its way leave behind it, neighbours in one request"""
    s = new_station(words(200), *OFTEN)
    put_together(s, {f"o{i}": 500 + i for i in [*range(20, 50), 60, 61]})
    s.wait_register(61, 561)
    assert [(r.function, r.start, r.count) for r in s.writes()] == [(16, 120, 30), (16, 160, 2)]
    assert [s.register(i) for i in range(20, 50)] == [500 + i for i in range(20, 50)]


def test_latest_value(new_station):
    """many puts to one record while a request is on its way: the last value leaves, once"""
    s = new_station(words(1), *OFTEN)
    put_together(s, {"o0": 1})
    s.wait_register(0, 1)
    s.plc.answering.clear()
    mark = s.plc.mark()
    until(lambda: s.plc.mark() > mark, "a request on its way")
    for value in range(2, 60):
        s.ioc.put("o0", value)
    s.plc.answering.set()
    s.wait_register(0, 59)
    assert len(s.writes()) == 2


def test_holdoff(new_station):
    """holdoff: puts that follow each other in this time leave in one request"""
    s = new_station(words(50), "holdoff 2000")
    names = [f"o{i}" for i in range(50)]
    s.ioc.connect([*names, *(name + ".SEVR" for name in names)])
    for i in range(50):
        s.ioc.put(f"o{i}", i + 1)
    s.wait_register(49, 50)
    assert [(r.function, r.start, r.count) for r in s.writes()] == [(16, 100, 50)]


@pytest.mark.parametrize("delay", [0, 0.02])
def test_burst(new_station, delay):
    """1,000 puts in a burst (answers take {delay} s): the last value of each record, in requests of legal size"""
    s = new_station(words(150, kind="INT32", step=2) + words(100, first=302, step=3).replace("$(P)o", "$(P)p") +
                    bits(16, 301), registers=620, complete="acknowledged")
    s.plc.delay = delay
    chance, last = random.Random(5), {}
    names = [f"o{i}" for i in range(150)] + [f"p{i}" for i in range(100)] + [f"b{i}" for i in range(16)]
    s.ioc.connect([*names, *(name + ".SEVR" for name in names)])
    for _ in range(1000):
        name = chance.choice(names)
        last[name] = chance.randrange(2) if name[0] == "b" else chance.randrange(1, 32767)
        s.ioc.put(name, last[name], wait=False)

    def held(name):
        n = int(name[1:])
        if name[0] == "o":
            return s.holding.unpack(100 + 2 * n, "i")[0]
        return s.register(302 + 3 * n) if name[0] == "p" else s.register(301) >> n & 1
    until(lambda: all(held(name) == value for name, value in last.items()),
          lambda: str([(n, held(n), v) for n, v in last.items() if held(n) != v][:5]))
    owned = {int(n[1:]) * 2 + k for n in last if n[0] == "o" for k in (0, 1)}
    owned |= {302 + 3 * int(n[1:]) for n in last if n[0] == "p"} | {301}
    assert s.written() == owned
    for name in last:
        assert s.ioc.severity(name) == "NO_ALARM", s.ioc.alarm(name)
    # values of 32 bits leave whole
    assert all(r.start % 2 == 0 for r in s.writes() if r.start < 400)
    if delay:
        assert len(s.writes()) < 700


def test_long_array(new_station):
    """an array longer than a request leaves in as few as the limit of 123 registers allows"""
    s = new_station('record(aao, "$(P)a") { field(DTYP, "S7plc") field(OUT, "@PLC/10") field(FTVL, "SHORT") field(NELM, "350") }')
    s.ioc.put("a", list(range(1, 351)))
    until_equal(lambda: s.holding[105:455], list(range(1, 351)))
    assert [r.count for r in s.writes()] == [123, 123, 104] and s.written() == set(range(5, 355))


def test_bits(new_station):
    """bits of a register leave by FC22 and touch no other bit, many of them in one request"""
    s = new_station(bits(16), *OFTEN)
    s.holding[100] = 0xA000
    s.ioc.put("b2", 1)
    s.wait_register(0, 0xA004)
    s.ioc.put("b15", 0)
    s.wait_register(0, 0x2004)
    # the HMI's bit of the same register
    s.holding[100] |= 0x0100
    s.ioc.put("b2", 0)
    s.wait_register(0, 0x2100)
    assert {r.function for r in s.writes()} == {22}
    count = len(s.writes())
    put_together(s, {f"b{i}": 1 for i in range(8)})
    s.wait_register(0, 0x21FF)
    assert len(s.writes()) == count + 1


def test_odd_byte(new_station):
    """a value at an odd byte: its ends leave by FC22, each by itself, and the other halves of their registers stay"""
    s = new_station('record(longout, "$(P)odd") { field(DTYP, "S7plc") field(OUT, "@PLC/1 T=INT32") }')
    s.holding[100], s.holding[102] = 0xAA00, 0x00BB
    s.ioc.put("odd", 0x01020304)
    until_equal(lambda: [s.register(i) for i in range(3)], [0xAA01, 0x0203, 0x04BB])
    assert sorted((r.function, r.start) for r in s.writes()) == [(16, 101), (22, 100), (22, 102)]
    s.ioc.wait_alarm("odd", "NO_ALARM")


def test_single_write(new_station):
    """singleWrite=on: FC6 for one register, FC16 for more"""
    s = new_station(words(10), *OFTEN, "singleWrite on")
    s.ioc.put("o3", 5)
    s.wait_register(3, 5)
    put_together(s, {"o4": 6, "o5": 7})
    s.wait_register(5, 7)
    assert [(r.function, r.start, r.count) for r in s.writes()] == [(6, 103, 1), (16, 104, 2)]


def test_coils(new_modbus, new_ioc):
    """coils leave by FC15, not more than 1,968 at a time, single ones by FC5 with singleWrite=on"""
    peer = new_modbus(size=4000)
    ioc = new_ioc(peer.configure("", "coils 7 3000") + "\ns7plcSetOption PLC singleWrite on", """
        record(aao, "$(P)a") { field(DTYP, "S7plc") field(OUT, "@PLC/0") field(FTVL, "UCHAR") field(NELM, "375") }
        record(bo, "$(P)b") { field(DTYP, "S7plc") field(OUT, "@PLC/374 T=BYTE B=7") }
        """)
    until(lambda: peer.answers >= 2, "the first read")
    pattern = random.Random(1).randbytes(375)
    ioc.put("a", list(pattern))
    wanted = [bool(byte >> i & 1) for byte in pattern for i in range(8)]
    until_equal(lambda: [peer.coils[7 + i] for i in range(3000)], wanted)
    assert [(r.function, r.count) for r in peer.writes()] in ([(15, 1968), (15, 1032)], [(15, 1960), (15, 1040)])
    ioc.put("b", not wanted[2999])
    until_equal(lambda: peer.coils[3006], not wanted[2999])
    assert peer.writes()[-1].key == (5, 3006, 1)
    assert {r.function for r in peer.since() if not r.writes} == {1}


def test_heartbeat_register(new_station):
    """heartbeatRegister counts up by one, by itself, and touches no other register"""
    s = new_station(words(2), "heartbeatRegister 50", "heartbeat 30")
    until(lambda: len(s.writes()) >= 20, "20 heartbeats")
    s.ioc.put("o0", 3)
    s.wait_register(0, 3)
    beats = [r.values[0] for r in s.plc.writes() if r.start == 50]
    assert all((b - a) % 65536 == 1 for a, b in zip(beats, beats[1:]))
    assert s.plc.written() == {50, 100}


# --- Refusals ------------------------------------------------------------------------------------

def test_one_refused(new_station):
    """one of 100 neighbours is refused: its record alone is WRITE/INVALID, the others are written"""
    s = new_station(words(100), *OFTEN)
    rule = s.plc.refuse((6, 16), 142, code=2)
    put_together(s, {f"o{i}": 1000 + i for i in range(100)})
    s.ioc.wait_alarm("o42", "INVALID", "WRITE", "exception 2")
    until_equal(lambda: [s.register(i) for i in range(100)],
                [0 if i == 42 else 1000 + i for i in range(100)])
    assert "illegal data address" in s.ioc.alarm("o42")[2]
    assert [i for i in range(100) if s.ioc.severity(f"o{i}") != "NO_ALARM"] == [42]
    # the others go on, it stays refused
    put_together(s, {"o41": 1, "o43": 3})
    s.wait_register(43, 3)
    s.wait_register(41, 1)
    assert s.ioc.severity("o41") == s.ioc.severity("o43") == "NO_ALARM"
    assert s.ioc.alarm("o42")[:2] == ("INVALID", "WRITE")
    # the alarm ends with the next write that the PLC takes
    s.plc.refuse_no_more(rule)
    s.ioc.put("o42", 77)
    s.wait_register(42, 77)
    s.ioc.wait_alarm("o42", "NO_ALARM")
    assert s.plc.connections == 1


def test_refused_value(new_station):
    """a refused 32-bit value: both its registers stay as they were, its neighbours are written"""
    s = new_station(words(40, kind="INT32", step=2), *OFTEN)
    s.plc.refuse((6, 16), 100 + 2 * 17 + 1, code=3)
    put_together(s, {f"o{i}": 0x10001 * (i + 1) for i in range(40)})
    s.ioc.wait_alarm("o17", "INVALID", "WRITE", "exception 3")
    until_equal(lambda: [s.holding.unpack(100 + 2 * i, "i")[0] for i in range(40)],
                [0 if i == 17 else 0x10001 * (i + 1) for i in range(40)])
    assert [i for i in range(40) if s.ioc.severity(f"o{i}") != "NO_ALARM"] == [17]


def test_several_refused(new_station):
    """registers here and there are refused: just their records say so"""
    s = new_station(words(123), *OFTEN)
    wrong = {0, 1, 60, 90, 91, 92, 122}
    for n in wrong:
        s.plc.refuse((6, 16), 100 + n, code=4)
    put_together(s, {f"o{i}": 7 for i in range(123)})
    until_equal(lambda: {i for i in range(123) if s.ioc.severity(f"o{i}") == "INVALID"}, wrong)
    until_equal(lambda: {i for i in range(123) if s.register(i) == 7}, set(range(123)) - wrong)
    assert s.plc.connections == 1


def test_refused_bits(new_station):
    """a refused bit: the record that wrote it is WRITE/INVALID, the others of its register are not"""
    s = new_station(bits(16) + words(1, first=1), *OFTEN)
    rule = s.plc.refuse(22, 100, code=2)
    s.ioc.put("b5", 1)
    s.ioc.wait_alarm("b5", "INVALID", "WRITE", "exception 2")
    s.ioc.put("o0", 9)
    s.wait_register(1, 9)
    assert [n for n in ("b4", "b6", "b0", "o0") if s.ioc.severity(n) == "INVALID" and
            s.ioc.alarm(n)[1] == "WRITE"] == []
    s.ioc.put("b6", 1)
    s.ioc.wait_alarm("b6", "INVALID", "WRITE")
    s.plc.refuse_no_more(rule)
    s.ioc.put("b6", 1)
    s.ioc.wait_alarm("b6", "NO_ALARM")
    assert s.ioc.alarm("b5")[1] == "WRITE"
    s.ioc.put("b5", 1)
    s.ioc.wait_alarm("b5", "NO_ALARM")
    assert s.register(0) == 0x60


def test_two_records_on_one_register(new_station):
    """the alarm is of the bytes: who shares them shows it, who put elsewhere does not"""
    s = new_station(words(3))
    rule = s.plc.refuse((6, 16), 101)
    s.ioc.put("o1", 1)
    s.ioc.wait_alarm("o1", "INVALID", "WRITE")
    s.ioc.put("o0", 1)
    s.ioc.put("o2", 1)
    s.wait_register(2, 1)
    assert s.ioc.severity("o0") == s.ioc.severity("o2") == "NO_ALARM"
    s.plc.refuse_no_more(rule)


REFUSALS = {1: "FC16: set singleWrite", 2: "illegal data address", 3: "illegal data value",
            4: "device failure", 5: "acknowledge", 6: "device busy", 7: "negative acknowledge", 8: "memory parity error",
            10: "no gateway path", 11: "gateway: no answer", 77: ""}


def test_codes(new_station):
    """every exception code of a write comes with its number and its words"""
    s = new_station(words(1))
    for value, (code, text) in enumerate(REFUSALS.items(), 1):
        rule = s.plc.refuse((6, 16), 100, code=code)
        s.ioc.put("o0", value)
        _, _, message = s.ioc.wait_alarm("o0", "INVALID", "WRITE", "" if code == 1 else f"exception {code}")
        assert text in message
        s.plc.refuse_no_more(rule)
        s.ioc.put("o0", 100 + value)
        s.ioc.wait_alarm("o0", "NO_ALARM")
        s.wait_register(0, 100 + value)
    assert s.plc.connections == 1


def test_no_mask_write(new_station):
    """a PLC without FC22: a single bit is refused with a hint, whole registers are written"""
    s = new_station(bits(4) + words(1, first=1))
    s.plc.without(22)
    s.ioc.put("b1", 1)
    _, _, message = s.ioc.wait_alarm("b1", "INVALID", "WRITE")
    assert message in ("PLC has no FC22: set maskWrite=rmw", ""), message  # an old Base has no message
    s.ioc.wait_log("maskWrite")
    s.ioc.put("o0", 4)
    s.wait_register(1, 4)
    assert s.ioc.severity("o0") == "NO_ALARM"
    assert s.register(0) == 0 and {r.function for r in s.writes()} == {16, 22}


def test_read_modify_write(new_station):
    """maskWrite=rmw: bits are read and written where the PLC has no FC22, and the other bits stay"""
    s = new_station(bits(16), "maskWrite rmw")
    s.plc.without(22)
    s.holding[100] = 0x8001
    s.ioc.put("b3", 1)
    s.wait_register(0, 0x8009)
    s.holding[100] = 0x4009
    s.ioc.put("b3", 0)
    s.wait_register(0, 0x4001)
    s.ioc.wait_alarm("b3", "NO_ALARM")
    assert s.plc.connections == 1


# --- At connect ------------------------------------------------------------------------------------

def test_read_first(new_station):
    """at connect the registers are read before anything is written; PINI values without R= are written"""
    s = new_station(words(10, fields='field(PINI, "YES") field(VAL, "5")') +
                    words(10, first=20).replace("$(P)o", "$(P)q"), ready=False)
    s.wait_register(9, 5)
    first = next(i for i, r in enumerate(s.plc.requests) if r.writes)
    reads = {a for r in s.plc.requests[:first] for a in r.addresses() if r.function == 3}
    assert set(range(100, 500)) <= reads
    assert s.plc.written() == set(range(100, 110))
    assert {r.function for r in s.plc.writes()} == {16}


def test_first_answer(new_station):
    """a put before all registers are read says what it waits for, and leaves behind that; only beside one that follows"""
    s = new_station(words(1) + """
        record(longout, "$(P)follower") { field(DTYP, "S7plc") field(OUT, "@PLC/2 T=INT16 R=4") }""",
                    "requestTimeout 60000", start=False)
    go_on = threading.Event()

    def late(request, frame):  # the first registers come, the next ones do not
        return go_on.wait(60) and frame if request.start > 100 else frame
    s.plc.mangle = late
    s.start(ready=False)
    until(lambda: s.plc.answers, "the first answer")
    s.ioc.put("o0", 7, wait=False)
    s.ioc.wait_alarm("o0", "INVALID", "COMM", "waits for the PLC's first answer")
    assert s.writes() == []
    go_on.set()
    s.wait_register(0, 7)
    s.ioc.wait_alarm("o0", "NO_ALARM")


@pytest.mark.parametrize("how", ["R=", "track=on"])
def test_bumpless(new_station, how):
    """{how}: outputs take the PLC's values, whatever PINI says, and nothing is written"""
    db = words(3, fields='field(PINI, "YES") field(VAL, "5")') + """
        record(ao, "$(P)real") { field(DTYP, "S7plc") field(OUT, "@PLC/10 T=REAL32 W=low$(R)") field(VAL, "3") field(PINI, "YES") }
        record(bo, "$(P)bit") { field(DTYP, "S7plc") field(OUT, "@PLC/14 T=WORD B=9$(R)") field(VAL, "0") field(PINI, "YES") }
        record(stringout, "$(P)text") { field(DTYP, "S7plc") field(OUT, "@PLC/16 L=6$(R)") field(VAL, "old") field(PINI, "YES") }
        """
    if how == "R=":
        for i in range(3):
            db = db.replace(f'@PLC/{2 * i} T=INT16"', f'@PLC/{2 * i} T=INT16 R={2 * i}"')
        for at in 10, 14, 16:
            db = "\n".join(line.replace("$(R)", f" R={at}") if f"@PLC/{at} " in line else line
                           for line in db.splitlines())
    s = new_station(db.replace("$(R)", ""), *["track on"] if how != "R=" else [], registers=20, start=False)
    s.holding.put(100, struct.pack(">hhh", 11, 12, 13))
    real = struct.pack(">f", 2.5)
    s.holding.put(105, real[2:] + real[:2])
    s.holding[107] = 0x0200
    s.holding.put(108, b"plc\0\0\0")
    s.start()
    for name, value in ("o0", 11), ("o1", 12), ("o2", 13), ("real", 2.5), ("bit", 1):
        s.ioc.wait_value(name, value)
        s.ioc.wait_alarm(name, "NO_ALARM")
    until_equal(lambda: s.ioc.text("text"), "plc")
    assert s.plc.writes() == []
    s.ioc.put("o1", -7)
    s.wait_register(1, 65529)
    assert s.written() == {1}


def test_some_follow(new_station):
    """beside outputs with R= the others keep their own value and write it"""
    s = new_station("""
        record(longout, "$(P)own") { field(DTYP, "S7plc") field(OUT, "@PLC/0") field(VAL, "5") field(PINI, "YES") }
        record(longout, "$(P)plc") { field(DTYP, "S7plc") field(OUT, "@PLC/2 R=2") field(VAL, "6") field(PINI, "YES") }
        record(longout, "$(P)none") { field(DTYP, "S7plc") field(OUT, "@PLC/4") field(VAL, "7") }
        """, start=False)
    s.holding.put(100, struct.pack(">hhh", 101, 102, 103))
    s.start()
    s.ioc.wait_value("plc", 102)
    s.wait_register(0, 5)
    assert s.ioc.get("own") == 5 and s.ioc.get("none") == 7
    assert s.plc.written() == {100}
    assert [s.register(i) for i in range(3)] == [5, 102, 103]


def test_shown_again(new_station):
    """R= where the PLC does not show its registers: the block tells; as soon as it does, they do"""
    s = new_station("""
        record(longout, "$(P)plc") { field(DTYP, "S7plc") field(OUT, "@PLC/2 R=2") field(VAL, "6") }
        record(longout, "$(P)own") { field(DTYP, "S7plc") field(OUT, "@PLC/8") }
        """, start=False)
    s.plc.without(3)
    s.start(ready=False)
    s.ioc.wait_value("plc", 0)  # what the block shows
    s.ioc.put("own", 4)
    s.wait_register(4, 4)
    assert s.ioc.log_count("the PLC does not show its outputs: PLC: exception 1, illegal function") == 1
    s.plc.power_off()
    s.ioc.wait_log("Modbus disconnected")
    s.plc.refuse_no_more()
    s.holding[101] = 77
    s.show(6)                   # a block while Modbus is down
    s.ioc.wait_value("in", 6)
    s.plc.power_on()
    s.ioc.wait_value("plc", 77)
    assert s.written() == {4}


def test_track(new_station):
    """track=on: outputs follow what the HMI writes, and nothing is written because of it"""
    s = new_station(words(3), *OFTEN, "track on")
    for value in range(100, 110):
        s.holding[101] = value
        s.ioc.wait_value("o1", value)
    assert s.writes() == []
    s.ioc.put("o1", 7)
    s.wait_register(1, 7)
    s.holding[102] = 9
    s.ioc.wait_value("o2", 9)
    assert s.ioc.get("o1") == 7 and s.register(1) == 7
    assert s.written() == {1}


def test_no_track(new_station):
    """without track an output keeps its value when the HMI changes the register"""
    s = new_station(words(3), *OFTEN)
    s.ioc.put("o1", 7)
    s.wait_register(1, 7)
    s.holding[101] = 9
    s.plc.wait_requests(5 * s.first_reads(), function=3)
    assert s.ioc.get("o1") == 7 and s.register(1) == 9
    assert s.written() == {1} and len(s.writes()) == 1


def test_resend(new_station):
    """after a PLC restart what was written is sent again where the PLC has something else, and only there"""
    s = new_station(words(20))
    for i in range(10):
        s.ioc.put(f"o{i}", 50 + i)
    s.wait_register(9, 59)
    s.plc.power_off()
    s.ioc.wait_log("Modbus")
    s.holding[103] = 0       # a value that was lost
    s.holding[115] = 1       # and one that is none of ours
    mark = s.plc.mark()
    s.plc.power_on()
    s.wait_register(3, 53)
    s.plc.wait_requests(s.first_reads(), mark, function=3)
    s.ioc.put("o11", 1)
    s.wait_register(11, 1)
    assert {a - 100 for a in s.plc.written(mark)} == {3, 11}
    assert {r.function for r in s.plc.writes(mark)} == {16}  # whole registers, as they were put
    assert s.register(15) == 1


def test_nothing_to_resend(new_station):
    """a connection that comes back to a PLC with our values writes nothing"""
    s = new_station(words(20))
    s.ioc.put("o4", 44)
    s.wait_register(4, 44)
    for count in range(2, 6):
        mark = s.plc.mark()
        s.plc.hang_up()
        s.plc.wait_connected(count)
        s.plc.wait_requests(s.first_reads(), mark, function=3)
    assert len(s.writes()) == 1
    s.ioc.wait_alarm("o4", "NO_ALARM")


# --- Away ------------------------------------------------------------------------------------------

def test_modbus_down(new_station):
    """Modbus down, blocks up: inputs are good, outputs are COMM/INVALID with the reason, and leave on return"""
    s = new_station(words(4))
    s.ioc.put("o0", 1)
    s.wait_register(0, 1)
    s.plc.power_off()
    until(lambda: s.ioc.put("o1", 2) or s.ioc.alarm("o1")[:2] == ("INVALID", "COMM"), "an alarm at o1")
    assert "PLC" in s.ioc.alarm("o1")[2]
    s.ioc.put("o2", 3)
    assert s.ioc.alarm("o2")[:2] == ("INVALID", "COMM")
    s.show(9)
    s.ioc.wait_value("in", 9)
    assert s.ioc.severity("in") == "NO_ALARM"
    s.plc.power_on()
    s.wait_register(2, 3)
    s.wait_register(1, 2)
    for name in "o1", "o2":
        s.ioc.wait_alarm(name, "NO_ALARM")
    assert len(s.blocks.connections) == 1
    assert s.written() == {0, 1, 2}


def test_blocks_down(new_station):
    """blocks down, Modbus up: inputs are COMM/INVALID, outputs are written and acknowledged"""
    s = new_station(words(4))
    s.ioc.put("o0", 1)
    s.wait_register(0, 1)
    s.blocks.power_off()
    s.ioc.wait_alarm("in", "INVALID", "COMM")
    s.ioc.put("o1", 2)
    s.wait_register(1, 2)
    s.ioc.wait_alarm("o1", "NO_ALARM")
    assert s.plc.connections == 1
    s.blocks.power_on()
    s.ioc.wait_alarm("in", "NO_ALARM")


def test_offline_reject(new_station):
    """offlineWrites=reject: a put while Modbus is down is refused and never leaves"""
    s = new_station(words(4), "offlineWrites reject")
    s.ioc.put("o0", 1)
    s.wait_register(0, 1)
    s.plc.power_off()
    s.ioc.wait_log("Modbus")
    until(lambda: s.ioc.put("o1", 99) or s.ioc.alarm("o1")[:2] == ("INVALID", "WRITE"), "a refusal")
    mark = s.plc.mark()
    s.ioc.put("o2", 98)
    assert s.ioc.alarm("o2")[:2] == ("INVALID", "WRITE")
    s.plc.power_on()
    s.plc.wait_requests(s.first_reads(), mark, function=3)
    until(lambda: s.ioc.put("o3", 3) or s.ioc.severity("o3") == "NO_ALARM", "a put that is taken")
    s.wait_register(3, 3)
    assert 2 not in {a - 100 for a in s.plc.written(mark)} and s.register(2) == 0


def test_timeout(new_station):
    """no answer to a write: WRITE/INVALID on what was under way, a new connection, and it is sent again"""
    s = new_station(words(10), "requestTimeout 200", "readPeriod 0")
    s.ioc.put("o0", 1)
    s.wait_register(0, 1)
    s.plc.silent = True
    s.ioc.put("o5", 55)
    s.ioc.wait_alarm("o5", "INVALID", "WRITE", "no answer for 200 ms")
    assert s.ioc.severity("o0") == "NO_ALARM"
    assert s.ioc.get("in") == 5 and s.ioc.severity("in") == "NO_ALARM"
    s.plc.wait_connected(2)
    s.plc.silent = False
    s.wait_register(5, 55)
    s.ioc.wait_alarm("o5", "NO_ALARM")
    assert s.written() == {0, 5}


def test_timeout_of_follower(new_station):
    """no answer to the write of an output that follows: not sent again, the PLC's value with an alarm until a write is acknowledged"""
    s = new_station(words(3), *OFTEN, "requestTimeout 200", "track on", complete="acknowledged")
    s.ioc.put("o0", 1)
    s.plc.judge = lambda request: 4 if request.writes else 0  # it does not do it either
    s.plc.mangle = lambda request, frame: b"" if request.writes else frame  # reads are answered
    s.ioc.put("o2", 55)
    s.plc.wait_connected(2)
    s.plc.judge, s.plc.mangle = lambda request: 0, None
    s.ioc.wait_value("o2", 0)
    s.ioc.wait_alarm("o2", "INVALID", "WRITE", "no answer for 200 ms")
    s.ioc.put("o0", 3)
    s.wait_register(0, 3)
    assert s.ioc.alarm("o2")[:2] == ("INVALID", "WRITE") and s.register(2) == 0
    s.ioc.put("o2", 56)
    s.wait_register(2, 56)
    assert s.ioc.alarm("o2") == ("NO_ALARM", "NO_ALARM", "")


def test_put_void(new_station):
    """track=on: a put while the device is away says so until the next put, when the device comes back with another value"""
    s = new_station(words(3), *OFTEN, "track on")
    s.ioc.put("o0", 1)
    s.wait_register(0, 1)
    s.plc.power_off()
    s.ioc.wait_log("disconnected")
    for name, value in ("o0", 5), ("o1", 6):
        s.ioc.put(name, value)
        s.ioc.wait_alarm(name, "INVALID", "COMM")
    s.plc.holding[s.START + 1] = 6
    s.plc.power_on()
    s.ioc.wait_alarm("o0", "INVALID", "WRITE", "not written: PLC was away")
    s.ioc.wait_alarm("o1", "NO_ALARM")
    assert s.ioc.get("o0") == s.register(0) == 1
    s.plc.holding[s.START] = 7
    s.ioc.wait_value("o0", 7)
    assert s.ioc.alarm("o0") == ("INVALID", "WRITE", "not written: PLC was away")
    s.ioc.put("o0", 8)
    s.wait_register(0, 8)
    s.ioc.wait_alarm("o0", "NO_ALARM")


def test_waiting_when_lost(new_station):
    """what waited behind a write without answer, or was put before the PLC answers again, has an alarm until it is written"""
    s = new_station(words(10), "requestTimeout 300", "readPeriod 0")
    s.ioc.connect([*(f"o{i}" for i in range(10)), *(f"o{i}.SEVR" for i in range(10))])
    s.ioc.put("o0", 1)
    s.wait_register(0, 1)
    s.plc.silent = True
    mark = s.plc.mark()
    s.ioc.put("o5", 55)
    s.plc.wait_requests(1, mark)
    s.ioc.put("o6", 66)
    s.ioc.put("o8", 88)
    for name in "o5", "o6", "o8":
        s.ioc.wait_alarm(name, "INVALID")
    s.plc.wait_connected(3)
    s.ioc.put("o7", 77)  # TCP is up, or just not: no matter
    s.ioc.wait_alarm("o7", "INVALID")
    s.plc.wait_connected(s.plc.connections + 2)
    assert [i for i in range(10) if s.ioc.severity(f"o{i}") == "INVALID" and
            s.ioc.alarm(f"o{i}")[1] in ("WRITE", "COMM")] == [5, 6, 7, 8]
    s.plc.silent = False
    s.wait_register(7, 77)
    for name in "o5", "o6", "o7", "o8":
        s.ioc.wait_alarm(name, "NO_ALARM")
    assert s.written() == {0, 5, 6, 7, 8}


def test_alarm_until_written(new_station):
    """a put whose write has no answer is in alarm over every reconnect, until another put is acknowledged"""
    s = new_station(words(2), "requestTimeout 200", "readPeriod 0")
    s.ioc.put("o0", 1)
    s.wait_register(0, 1)
    alarms = []
    pv = epics.PV(s.ioc.P + "o0", form="time", callback=lambda severity=None, **kw: alarms.append(severity))
    assert pv.wait_for_connection(60)
    s.plc.judge = lambda request: 4 if request.writes else 0  # it does not do it either
    s.plc.mangle = lambda request, frame: b"" if request.writes else frame  # reads are answered
    s.ioc.put("o0", 2)
    s.ioc.wait_log("not tried again")
    for _ in range(3):
        mark = s.plc.mark()
        s.plc.hang_up(reset=True)
        s.plc.wait_requests(s.first_reads(), mark, function=3)
    at = alarms.index(3)
    assert set(alarms[at:]) == {3}, alarms
    s.plc.judge, s.plc.mangle = lambda request: 0, None
    s.ioc.put("o0", 3)
    s.ioc.wait_alarm("o0", "NO_ALARM")
    assert s.register(0) == 3
    pv.disconnect()


def test_nothing_waits(new_station):
    """while a write has no answer puts, gets, reports and exit go on"""
    s = new_station(words(10), "requestTimeout 60000")
    s.plc.silent = True
    begin = time.monotonic()
    for value in range(1, 51):
        s.ioc.put("o5", value)
        s.ioc.put("o6", value)
        assert s.ioc.get("o5") == value
    for command in ("dbior s7plc 3", "s7plcReport PLC 2", "s7plcShow PLC", f"dbpr {s.ioc.P}o5 4"):
        assert s.ioc.command(command)
    assert s.plc.connections == 1 and "no answer" not in s.ioc.log
    assert s.ioc.exit() == 0
    assert time.monotonic() - begin < 30  # s; the PLC has 60 to answer


def test_black_hole(new_peer, new_ioc, black_hole):
    """the Modbus port swallows every packet: blocks come, outputs say why they cannot leave"""
    blocks = new_peer(8, 20)
    ioc = new_ioc(blocks.configure(recv_timeout=20000) +
                  f'\ns7plcModbusOutput("PLC", "127.0.0.1", {black_hole.port}, 1, 0)', IN + words(2))
    blocks.wait_connected()
    blocks.every(0.05, b"\0\5" + bytes(6))
    ioc.wait_value("in", 5)
    ioc.wait_log("does not answer")
    ioc.put("o0", 1)
    ioc.wait_alarm("o0", "INVALID", "COMM")
    assert ioc.severity("in") == "NO_ALARM"
    assert ioc.exit() == 0


# --- What users type -------------------------------------------------------------------------------

GOOD = 's7plcConfigure("{plc}", "127.0.0.1", {block}, 8, 20, 1, 20000, 100)'
WRONG = {
    "sync=on": (GOOD, "s7plcSetOption {plc} sync on\n" 's7plcModbusOutput("{plc}", "", {port}, 1, 0)'),
    "sync=on behind it": (GOOD, 's7plcModbusOutput("{plc}", "", {port}, 1, 0)\n' "s7plcSetOption {plc} sync on"),
    "a PLC that is not there": (GOOD, 's7plcModbusOutput("NOPLC", "", {port}, 1, 0)'),
    "no arguments": (GOOD, "s7plcModbusOutput"),
    "port 70000": (GOOD, 's7plcModbusOutput("{plc}", "", 70000, 1, 0)'),
    "unit 300": (GOOD, 's7plcModbusOutput("{plc}", "", {port}, 300, 0)'),
    "register 70000": (GOOD, 's7plcModbusOutput("{plc}", "", {port}, 1, 70000)'),
    "registers beyond 65535": (GOOD, 's7plcModbusOutput("{plc}", "", {port}, 1, 65530)'),
    "a second time": (GOOD + '\ns7plcModbusOutput("{plc}", "", {port}, 1, 0)', 's7plcModbusOutput("{plc}", "", {port}, 1, 0)'),
    "an odd outSize": (GOOD.replace("20,", "21,"), 's7plcModbusOutput("{plc}", "", {port}, 1, 0)'),
    "no output block": (GOOD.replace("20,", "0,"), 's7plcModbusOutput("{plc}", "", {port}, 1, 0)'),
    "a PLC that is all Modbus": ('modbusplcConfigure("{plc}", "127.0.0.1", {port}, 1, "holding 0 4", "holding 0 10")', 's7plcModbusOutput("{plc}", "", {port}, 1, 0)'),
}


def test_wrong(new_peer, new_modbus, new_ioc):
    """s7plcModbusOutput with wrong arguments: refused in one line each, the IOC and its PLCs go on"""
    blocks, others, plc = new_peer(8, 20), new_peer(8, 20), new_modbus()
    lines = []
    for i, texts in enumerate(WRONG.values()):
        for old, new in ("{block}", others.port), ("{port}", plc.port), ("{plc}", f"P{i}"):
            texts = [text.replace(old, str(new)) for text in texts]
        lines += "\n".join(texts).splitlines()
    ioc = new_ioc("\n".join([blocks.configure(recv_timeout=20000), *lines]), IN)
    errors = [line for line in ioc.log.splitlines() if line not in lines and "sevr=info" not in line and
              ("s7plcModbusOutput" in line or "option sync" in line)]
    assert len(errors) == len(WRONG), "\n".join(errors)
    for (name, texts), error in zip(WRONG.items(), errors):
        assert ("sync" in error) == ("sync" in name), (name, error)
    blocks.wait_connected()
    blocks.every(0.05, b"\0\5" + bytes(6))
    ioc.wait_value("in", 5)
    assert "s7plcModbusOutput PLC: comes before iocInit" in ioc.command(f's7plcModbusOutput PLC, "", {plc.port}, 1, 0')


def test_pair_refused(new_peer, new_modbus, new_ioc):
    """s7plcModbusOutput on a redundant pair is refused in one line"""
    plc = new_modbus()
    ioc = new_ioc('phoenixplcConfigure("PLC", "127.0.0.1", 2000, 8, 20, 1, 2000, 100, 1)\n'
                  f's7plcModbusOutput("PLC", "127.0.0.1", {plc.port}, 1, 0)', IN, program="phoenixIoc")
    errors = [line for line in errors_in(ioc.log) if "s7plcModbusOutput" in line]
    assert len(errors) == 1 and "pair" in errors[0], ioc.log


def test_own_address(new_peer, new_modbus, new_ioc):
    """an address of its own for Modbus, and unit and report"""
    blocks, plc = new_peer(8, 20), new_modbus(unit=255)
    ioc = new_ioc(blocks.configure(recv_timeout=20000).replace("127.0.0.1", "localhost") +
                  f'\ns7plcModbusOutput("PLC", "127.0.0.1", {plc.port}, 255, 7)', IN + words(2))
    blocks.wait_connected()
    blocks.every(0.05, b"\0\5" + bytes(6))
    ioc.put("o1", 3)
    until_equal(lambda: plc.holding[8], 3)
    for command in "s7plcReport PLC 1", "dbior s7plc 1":
        report = ioc.command(command)
        assert "Modbus" in report and f"127.0.0.1:{plc.port}" in report and "unit 255" in report, report
        assert "holding 7 to 16" in report, report
    assert f"{ioc.P}o1" in ioc.command("s7plcShow PLC out")


# --- plcSim: blocks and Modbus on one memory --------------------------------------------------------

SIM = """
in = 64
out = 64
period = 20 ms
modbus_port = 0
db 10 400 Set
tx P#DB10.DBX0.0 BYTE 32 -> 0
signal 40 UINT32 counter
modbus holding 100 200 -> DB10.0
"""


@pytest.fixture
def sim_station(new_sim, new_ioc):
    """plcSim, and an IOC that reads its blocks and writes its registers; DB10 begins both."""
    def make(db, *options):
        sim = new_sim(SIM)
        ioc = new_ioc(f's7plcConfigure("PLC", "127.0.0.1", {sim.port}, 64, 64, 1, 2000, 100)\n'
                      f's7plcModbusOutput("PLC", "", {sim.modbus_port}, 1, 100)' +
                      "".join(f"\ns7plcSetOption PLC {option}" for option in options), db)
        ioc.wait_alarm("count", "NO_ALARM")
        return sim, ioc
    return make


SIM_DB = """
record(longin, "$(P)count") { field(DTYP, "S7plc") field(INP, "@PLC/40 T=INT32") field(SCAN, "I/O Intr") }
record(ao, "$(P)real") { field(DTYP, "S7plc") field(OUT, "@PLC/4 T=REAL32") field(PREC, "3") }
record(ai, "$(P)real:RBV") { field(DTYP, "S7plc") field(INP, "@PLC/4 T=REAL32") field(SCAN, "I/O Intr") }
record(longout, "$(P)word") { field(DTYP, "S7plc") field(OUT, "@PLC/8 T=INT16") }
record(longin, "$(P)word:RBV") { field(DTYP, "S7plc") field(INP, "@PLC/8 T=INT16") field(SCAN, "I/O Intr") }
record(bo, "$(P)bit") { field(DTYP, "S7plc") field(OUT, "@PLC/10 T=WORD B=5") }
record(bi, "$(P)bit:RBV") { field(DTYP, "S7plc") field(INP, "@PLC/10 T=WORD B=5") field(SCAN, "I/O Intr") }
"""


def test_sim_round_trip(sim_station):
    """plcSim: what a put writes by Modbus comes back in the block, bits beside other bits"""
    sim, ioc = sim_station(SIM_DB)
    sim.command("set DB10.DBW10 0x4100")
    for i in range(10):
        ioc.put("real", 1.5 * i)
        ioc.put("word", -i)
        ioc.put("bit", i % 2)
        ioc.wait_value("real:RBV", 1.5 * i)
        ioc.wait_value("word:RBV", -i)
        ioc.wait_value("bit:RBV", i % 2)
    assert sim.command("get DB10.DBW10").split()[-1] in ("16672", "0x4120", "16#4120")
    assert {ioc.severity(name) for name in ("real", "word", "bit")} == {"NO_ALARM"}
    assert "ex2=0" in sim.command("modbus")


def test_sim_operator(sim_station):
    """plcSim with track=on: what the operator sets at the PLC is shown by the output records"""
    sim, ioc = sim_station(SIM_DB, "track on", "readPeriod 50")
    sim.command("set DB10.DBW8 77")
    ioc.wait_value("word", 77)
    ioc.put("word", 78)
    ioc.wait_value("word:RBV", 78)
    sim.command("set DB10.DBW8 79")
    ioc.wait_value("word", 79)
    assert ioc.severity("word") == "NO_ALARM"


SIM_FAULTS = {
    "modbus exception 4 write": ("WRITE", "exception 4"),
    "modbus busy": ("WRITE", "exception 6"),
    "modbus silent write": ("WRITE", "no answer for 200 ms"),
    "modbus wrongunit write": (None, ""),
    "modbus wrongid write": (None, ""),
    "modbus short 9 write": ("WRITE", "not complete after 200 ms"),
    "modbus short 3 close write": (None, ""),
    "modbus close reply write": (None, ""),
    "modbus garbage 20 write": (None, ""),
}


def test_sim_faults(sim_station):
    """plcSim's Modbus faults: the record that put says so, blocks go on, and the next put arrives"""
    sim, ioc = sim_station(SIM_DB, "requestTimeout 200", "readPeriod 0")
    for value, (fault, (status, message)) in enumerate(SIM_FAULTS.items(), 1):
        sim.command(fault)
        ioc.put("word", value)
        ioc.wait_alarm("word", "INVALID", *[status, message] if status else [])
        assert ioc.severity("count") == "NO_ALARM", fault
        sim.command("modbus normal")
        ioc.put("word", value)  # what was refused, or not answered twice, is not sent again by itself
        ioc.wait_value("word:RBV", value)
        ioc.wait_alarm("word", "NO_ALARM")


def test_sim_refuses_one(sim_station):
    """plcSim refuses one register, and can be read all the same"""
    sim, ioc = sim_station(SIM_DB)
    sim.command("modbus exception 2 holding 104 write")
    ioc.put("word", 5)
    ioc.put("real", 2.5)
    ioc.wait_alarm("word", "INVALID", "WRITE", "exception 2, illegal data address")
    ioc.wait_value("real:RBV", 2.5)
    assert ioc.severity("real") == "NO_ALARM" and ioc.get("word:RBV") == 0


def test_sim_restart(sim_station):
    """plcSim restarts: blocks and Modbus are back by themselves, and so is what was put meanwhile"""
    sim, ioc = sim_station(SIM_DB)
    ioc.put("word", 5)
    ioc.wait_value("word:RBV", 5)
    sim.command("restart 300")
    ioc.wait_alarm("count", "INVALID", "COMM")
    ioc.put("real", 6.5)
    ioc.wait_alarm("count", "NO_ALARM")
    ioc.wait_value("real:RBV", 6.5)
    ioc.wait_alarm("real", "NO_ALARM")


def test_sim_whole_plc(new_sim, new_ioc):
    """plcSim by Modbus alone: signals, bits and setpoints"""
    sim = new_sim("""
        in = 64
        period = 20 ms
        modbus_port = 0
        modbus_unit = 3
        db 10 400 Set
        signal 0 REAL32 sine -5 5 20s
        signal 4 UINT16 counter
        modbus input 0 32 -> in.0
        modbus holding 0 100 -> DB10.0
        modbus coils 0 64 -> DB10.50
        modbus discrete 7 16 -> in.4
        """)
    ioc = new_ioc(f'modbusplcConfigure("PLC", "127.0.0.1", {sim.modbus_port}, 3, '
                  '"input 0 10 every 20, holding 0 10 every 20, coils 0 16, discrete 7 16", "holding 0 10, coils 0 16")', """
        record(longin, "$(P)count") { field(DTYP, "S7plc") field(INP, "@PLC/4 T=UINT16") field(SCAN, "I/O Intr") }
        record(ai, "$(P)set:RBV") { field(DTYP, "S7plc") field(INP, "@PLC/20 T=REAL64") field(SCAN, "I/O Intr") }
        record(ao, "$(P)set") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=REAL64") }
        record(bi, "$(P)coil:RBV") { field(DTYP, "S7plc") field(INP, "@PLC/41 T=BYTE B=2") field(SCAN, "I/O Intr") }
        record(bo, "$(P)coil") { field(DTYP, "S7plc") field(OUT, "@PLC/21 T=BYTE B=2") }
        """)
    first = ioc.get("count")
    until(lambda: ioc.get("count") != first, "a counter that counts")
    ioc.put("set", 1e100)
    ioc.wait_value("set:RBV", 1e100)
    for value in 1, 0:
        ioc.put("coil", value)
        ioc.wait_value("coil:RBV", value)
    assert "other_unit=0" in sim.command("modbus")


# --- Order and completion ------------------------------------------------------------------------

def in_order(s):
    """(register, value) as the device saw them, one by one."""
    return [(r.start - s.START + i, value) for r in s.writes() for i, value in enumerate(r.values)]


def test_order(new_station):
    """puts leave in the order in which they were made, whatever their registers"""
    s = new_station(words(100), *OFTEN)
    order = list(range(100))
    random.Random(7).shuffle(order)
    put_together(s, {f"o{n}": 1000 + n for n in order})
    until_equal(lambda: in_order(s), [(n, 1000 + n) for n in order])


def test_order_neighbours(new_station):
    """neighbours in the order that are neighbours in the table share a request"""
    s = new_station(words(20), *OFTEN)
    put_together(s, {f"o{n}": n + 1 for n in (12, 4, 5, 6, 7, 15, 16, 3)})
    until_equal(lambda: [(r.start - s.START, r.count) for r in s.writes()],
                [(12, 1), (4, 4), (15, 2), (3, 1)])


def test_pulse(new_station):
    """a bit that was set and cleared while a request was on its way is seen as set, then as cleared"""
    s = new_station(bits(2), *OFTEN)
    plc, ioc = s.plc, s.ioc
    plc.answering.clear()
    until(lambda: plc.held, "a request on its way")
    for value in (1, 0, 1, 0):
        ioc.put("b1", value)
    plc.answering.set()
    until_equal(lambda: len(s.writes()), 4)
    assert [r.values[1] & 2 for r in s.writes()] == [2, 0, 2, 0], s.writes()


def test_writes_all(new_station):
    """writes=all: every value of a number leaves, in its order"""
    s = new_station(words(2), "writes all", *OFTEN)
    plc, ioc = s.plc, s.ioc
    plc.answering.clear()
    until(lambda: plc.held, "a request on its way")
    for value in range(5):
        ioc.put("o1", 100 + value)
    plc.answering.set()
    until_equal(lambda: in_order(s), [(1, 100 + value) for value in range(5)])


def test_thousand_puts(new_station):
    """1,000 puts wait in their order; of more, the newest of each place, which is said once and counted"""
    s = new_station(words(4) + "".join(
        f'record(longin, "$(P){name}") {{ field(DTYP, "S7plc stats") field(INP, "@PLC/{name}") }}'
        for name in ("putsWaiting", "putsDropped")), "writes all", *OFTEN, "requestTimeout 60000")
    plc, ioc = s.plc, s.ioc

    def put(first, last):
        ioc.command("\n".join(f"dbpf {ioc.P}o{i % 4} {i}" for i in range(first, last)))
        for name in "putsWaiting", "putsDropped":
            ioc.process_record(name)
        return ioc.get("putsWaiting"), ioc.get("putsDropped")
    plc.answering.clear()
    until(lambda: plc.held, "a request on its way")
    assert put(0, 1000) == (1000, 0)
    waiting, dropped = put(1000, 1020)
    assert waiting <= 1000 and waiting + dropped == 1020
    assert ioc.log_count("puts come faster than the PLC takes them") == 1
    plc.answering.set()
    until_equal(lambda: [s.register(i) for i in range(4)], list(range(1016, 1020)))
    kept = in_order(s)
    assert len(kept) == waiting and [value for _, value in kept] == sorted(value for _, value in kept)


def test_end_of_pulse(new_station):
    """the HIGH of a bo ends after its pulse was acknowledged, however long that takes"""
    s = new_station(bits(1, fields='field(HIGH, "0.05")') +
                    'record(calc, "$(P)clock") { field(SCAN, ".1 second") field(CALC, "VAL+1") }', *OFTEN,
                    complete="acknowledged")
    plc, ioc = s.plc, s.ioc
    ioc.connect(["b0", "clock"])
    plc.answering.clear()
    until(lambda: plc.held, "a request on its way")
    ioc.put("b0", 1, wait=False)
    until(lambda: ioc.get("b0") == 1, "the put")
    later = ioc.get("clock") + 5
    until(lambda: ioc.get("clock") > later, "much longer than HIGH")
    assert ioc.get("b0") == 1
    plc.answering.set()
    until_equal(lambda: [r.values[1] & 1 for r in s.writes()], [1, 0])
    ioc.wait_value("b0", 0)


def test_completion(new_station):
    """a put with callback waits for the PLC's answer"""
    s = new_station(words(2), *OFTEN, complete="acknowledged")
    plc, ioc = s.plc, s.ioc
    ioc.connect(["o0", "o0.PACT"])
    plc.answering.clear()
    until(lambda: plc.held, "a request on its way")
    done = ioc.put_callback("o0", 77)
    until_equal(lambda: ioc.get("o0.PACT"), 1)
    assert not done.is_set() and s.register(0) == 0
    plc.answering.set()
    until(done.is_set, "the end of the put")
    assert s.register(0) == 77 and ioc.get("o0.PACT") == 0


def test_completion_refused(new_station):
    """when a put with callback ends, the record says whether the PLC refused it"""
    s = new_station(words(2), *OFTEN, complete="acknowledged")
    s.plc.refuse((6, 16), 101, code=3)
    s.ioc.put("o1", 5)
    assert s.ioc.alarm("o1")[:2] == ("INVALID", "WRITE"), s.ioc.alarm("o1")
    s.ioc.put("o0", 5)
    assert s.ioc.severity("o0") == "NO_ALARM" and s.register(0) == 5


def test_completion_second(new_station):
    """two puts, the second while the first is on its way: the PLC has the second at the end"""
    s = new_station(words(2, fields='field(SCAN, "Passive")'), "track on", *OFTEN, complete="acknowledged")
    plc, ioc = s.plc, s.ioc
    for value in range(10, 30, 2):
        plc.answering.clear()
        until(lambda: plc.held, "a request on its way")
        first = ioc.put_callback("o0", value)
        second = ioc.put_callback("o0", value + 1)
        plc.answering.set()
        until(lambda: first.is_set() and second.is_set(), "the end of both puts")
        s.wait_register(0, value + 1)
        ioc.wait_value("o0", value + 1)


def test_completion_lost(new_station):
    """a put that waits ends when the connection is lost, and the record says why"""
    s = new_station(words(2), "readPeriod 20", "requestTimeout 500", complete="acknowledged")
    plc, ioc = s.plc, s.ioc
    ioc.connect(["o0", "o0.PACT"])
    plc.answering.clear()
    done = ioc.put_callback("o0", 77)
    until(done.is_set, "the end of the put")
    assert ioc.get("o0.PACT") == 0
    ioc.wait_alarm("o0", "INVALID")
    plc.answering.set()
    s.wait_register(0, 77)
    ioc.wait_alarm("o0", "NO_ALARM")


def test_completion_link(new_station):
    """a record whose link changes while it waits ends, and works at its new place"""
    s = new_station(words(2), *OFTEN, complete="acknowledged")
    plc, ioc = s.plc, s.ioc
    ioc.connect(["o0", "o0.PACT"])
    plc.answering.clear()
    until(lambda: plc.held, "a request on its way")
    done = ioc.put_callback("o0", 77)
    until_equal(lambda: ioc.get("o0.PACT"), 1)
    ioc.put("o0.OUT", "@PLC/20", wait=False)  # with wait CA itself waits for the record
    until(done.is_set, "the end of the put")
    assert ioc.get("o0.PACT") == 0
    plc.answering.set()
    ioc.put("o0", 78)
    assert s.register(10) == 78


LINKED = 'record(longout, "$(P)o0") { field(DTYP, "S7plc") field(OUT, "@PLC/0") field(FLNK, "$(P)n") }\n' \
         'record(bo, "$(P)b") { field(DTYP, "S7plc") field(OUT, "@PLC/8 T=WORD B=0") field(HIGH, "0.05") field(FLNK, "$(P)n") }\n' \
         'record(calc, "$(P)n") { field(CALC, "VAL+1") }'


def test_completion_sent(new_station):
    """complete=sent: a put with callback ends when its value is handed over, before the PLC has answered"""
    s = new_station(words(2), *OFTEN, complete="sent")
    plc, ioc = s.plc, s.ioc
    plc.answering.clear()
    until(lambda: plc.held, "a request on its way")
    done = ioc.put_callback("o0", 77)
    until(done.is_set, "the end of the put")
    assert s.register(0) == 0
    plc.answering.set()
    s.wait_register(0, 77)


@pytest.mark.parametrize("name,link", [("o0", "@PLC/20"), ("b", "@PLC/20 T=WORD B=3")])
@pytest.mark.parametrize("sent", [False, True])
def test_link_change_ends_put(new_station, name, link, sent):
    """a link changes while a put waits (on its way: {sent}): the put ends with an alarm and a line, FLNK runs, nothing of it leaves later"""
    s = new_station(LINKED, "readPeriod 20", f"requestTimeout {2000 if sent else 30000}", complete="acknowledged",
                    registers=20)
    plc, ioc = s.plc, s.ioc
    ioc.connect([name, name + ".PACT", name + ".UDF", "n"])
    if sent:  # it gets no answer
        plc.mangle = lambda request, frame: b"" if request.writes and request.start != 110 else frame
    else:
        plc.answering.clear()
        until(lambda: plc.held, "a request on its way")
    done = ioc.put_callback(name, 1)
    until_equal(lambda: ioc.get(name + ".PACT"), 1)
    if sent:
        until(lambda: s.writes(), "the put on its way")
    mark = plc.mark()
    ioc.put(name + ".OUT", link, wait=False)
    until(done.is_set, "the end of the put")
    ioc.wait_alarm(name, "INVALID", "WRITE", "link changed: value " + ("maybe written" if sent else "not written"))
    assert (ioc.get(name + ".PACT"), ioc.get(name + ".UDF"), ioc.get("n")) == (0, 0, 1)
    ioc.wait_log("the link has changed while its put waited for the PLC: the old place " +
                 ("may have been written" if sent else "was not written"))
    plc.answering.set()
    ioc.put(name, 1)
    until(lambda: s.register(10), "the new place")
    ioc.wait_alarm(name, "NO_ALARM")
    plc.power_off()
    ioc.wait_alarm(name, "INVALID", ask=True)
    plc.power_on()
    ioc.wait_alarm(name, "NO_ALARM", ask=True)
    assert {r.start - 100 for r in plc.writes(mark)} == {10}, plc.writes(mark)


@pytest.mark.parametrize("complete", ["acknowledged", "sent"])
@pytest.mark.parametrize("track", ["on", "off"])
def test_refused_pulse(new_station, complete, track):
    """the ON of a bo with HIGH is refused (complete={complete}, track={track}): OFF leaves all the same, the alarm of ON stays until the next put"""
    s = new_station('record(bo, "$(P)b") { field(DTYP, "S7plc") field(OUT, "@PLC/8 T=WORD B=0") field(HIGH, "0.2") }',
                    "readPeriod 20", f"track {track}", complete=complete, registers=20)
    plc, ioc = s.plc, s.ioc
    alarms = []
    pv = epics.PV(ioc.P + "b", form="time", callback=lambda severity=None, **kw: alarms.append(severity))
    assert pv.wait_for_connection(60)
    plc.judge = lambda request: 3 if request.writes and request.values[1] & 1 else 0
    ioc.put("b", 1)
    ioc.wait_alarm("b", "INVALID", "WRITE")
    alarms.clear()
    until(lambda: any(not r.values[1] & 1 for r in s.writes()), "OFF")
    plc.wait_requests(20)
    assert ioc.alarm("b") == ("INVALID", "WRITE", "PLC: exception 3, illegal data value")
    until_equal(lambda: ioc.get("b"), 0)
    assert 0 not in alarms, alarms
    plc.judge = lambda request: 0
    ioc.put("b", 0)
    ioc.wait_alarm("b", "NO_ALARM")
    ioc.put("b", 1)
    until_equal(lambda: (ioc.get("b"), s.register(4)), (0, 0))
    ioc.wait_alarm("b", "NO_ALARM")
    pv.disconnect()


CUT = [  # record, its link and fields, what is put, what the PLC gets and the record shows
    ("ao", "T=UINT32", 5e9, "I", 4294967295), ("ao", "T=UINT32", -1, "I", 0), ("ao", "T=INT16", 1e6, "h", 32767),
    ("ao", "T=INT32", -1e12, "i", -2147483647), ("ao", "T=INT32", 1e12, "i", 2147483647),
    ("ao", "T=UINT16 L=0 H=100", 150, "H", 100), ("ao", "T=UINT16", 3.7, "H", 4), ("ao", "T=REAL32", 0.1, "f", 0.1),
    ("longout", "T=INT16", 70000, "h", 4464), ("longout", "T=UINT16", -1, "H", 65535), ("int64out", "T=INT32", 2**32 + 5, "i", 5),
    ("longout", "T=UINT32", -1, "i", -1), ("stringout", "T=STRING L=4", "abcdef", "4s", "abcd"),
    ("lso", "T=STRING L=4", "abcdef", "4s", "abcd"), ("ao", "T=BCD16", 12345, "H", 9999)]


@pytest.mark.parametrize("complete", ["acknowledged", "sent"])
@pytest.mark.parametrize("track", ["on", "off"])
def test_what_does_not_fit(new_station, complete, track):
    """a value that does not fit its type (complete={complete}): with track={track} the record shows what the PLC holds"""
    size = {"lso": 'field(SIZV, "20")'}
    db = "\n".join(f'record({kind}, "$(P)c{i}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{4 * i} {link}") {size.get(kind, "")} }}'
                   for i, (kind, link, *_) in enumerate(CUT))
    s = new_station(db, "readPeriod 20", f"track {track}", complete=complete, registers=2 * len(CUT))
    ioc = s.ioc
    for i, (kind, link, value, form, shown) in enumerate(CUT):
        pv = f"c{i}.VAL$" if kind == "lso" else f"c{i}"
        ioc.put(pv, value)
        wanted = shown.encode() if form == "4s" else 0x9999 if "BCD" in link else pytest.approx(shown)
        until_equal(lambda: struct.unpack(">" + form, s.holding.bytes(100 + 2 * i, struct.calcsize(form)))[0], wanted)
        rounded = (kind, link) in (("ao", "T=UINT16"), ("ao", "T=REAL32"))  # as ever: only what is cut comes back
        wanted = value if track == "off" or rounded else shown
        until_equal(lambda: ioc.get(pv, as_string=True) if form == "4s" else ioc.get(pv), wanted)
        s.plc.wait_requests(5)
        assert (ioc.get(pv, as_string=True) if form == "4s" else ioc.get(pv)) == wanted, (kind, link)
        assert ioc.severity(f"c{i}") == "NO_ALARM"


def test_silent_server_does_not_chatter(new_modbus, new_ioc):
    """a server that accepts connections and answers nothing: outputConnected goes to 0 and stays there until it answers"""
    plc = new_modbus()
    plc.silent = True
    ioc = new_ioc(plc.configure("", "holding 0 10", timeout=100), """
        record(longout, "$(P)o") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT16") }
        record(longin, "$(P)connected") { field(DTYP, "S7plc stats") field(INP, "@PLC/outputConnected") field(SCAN, "I/O Intr") }
        """)
    plc.wait_connected(3)
    seen = ioc.watch("connected")
    ioc.wait_value("connected", 0)
    plc.wait_connected(8)
    assert 1 not in seen, seen
    plc.silent = False
    until(lambda: seen[-1] == 1, lambda: f"connected is {seen}")
    ioc.put("o", 5)
    until_equal(lambda: plc.holding[0], 5)
    ioc.wait_alarm("o", "NO_ALARM")


def test_demo():
    """make demo-modbus ends by itself: values are acknowledged, a refusal is shown where it belongs"""
    shown = run_demo("iocModbus", 120)
    said = "PLC: exception 3, illegal data value" if SINCE_7_0_6 else ""
    assert re.search(rf"Speed 9999 +33.25 +33.25 +9999 +100  {said}\n", shown)
    assert re.search(r"caput Force 12.5: others are not affected +12.5 +12.5 +9999 +100  NO_ALARM", shown)
