"""Devices as they are: each habit of a Modbus device is read and written, with the log quiet."""
import re
import socket
import struct
import threading

import pytest

from ioc import errors_in
from waiting import until, until_equal

DB = """
record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT16") field(SCAN, "I/O Intr") }
record(longin, "$(P)last") { field(DTYP, "S7plc") field(INP, "@PLC/198 T=INT16") field(SCAN, "I/O Intr") }
record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT16") }
record(longout, "$(P)far") { field(DTYP, "S7plc") field(OUT, "@PLC/78 T=INT16") }
record(longin, "$(P)losses") { field(DTYP, "S7plc stats") field(INP, "@PLC/reconnects") field(SCAN, ".1 second") }
"""


def start(plc, new_ioc, *options, inputs="holding 0 100 every 50", outputs="holding 200 40", db=DB, unit=1):
    lines = [plc.configure(inputs, outputs, unit=unit)] + [f"s7plcSetOption PLC {o}" for o in options]
    ioc = new_ioc("\n".join(lines), db)
    ioc.wait_log("connected")
    return ioc


def use(plc, ioc, rounds=5):
    """Reads and writes, again and again."""
    for value in range(1, rounds + 1):
        plc.holding[0] = plc.holding[99] = value
        ioc.wait_value("in", value)
        ioc.wait_value("last", value)
        ioc.put("out", 100 + value)
        ioc.put("far", 200 + value)
        until_equal(lambda: (plc.holding[200], plc.holding[239]), (100 + value, 200 + value))
        assert ioc.severity("in") == ioc.severity("out") == ioc.severity("far") == "NO_ALARM"


def quiet(ioc, losses=0):
    """No word in the log after the connection, and no loss."""
    log = ioc.log
    assert "disconnected" not in log and "read of" not in log and "cannot" not in log, log[-600:]
    assert ioc.get("losses") == losses


def after_each_answer(plc):
    """Closes each connection behind its first answer."""
    def mangle(request, frame):
        handler = plc.handlers[-1]
        plc.loop.call_soon(lambda: (handler.send(frame), handler.drop(reset=False)))
        return b""
    plc.mangle = mangle


def test_closes_after_each_answer(new_modbus, new_ioc):
    """a device that closes after each answer is read and written: no alarm, no word in the log"""
    plc = new_modbus()
    after_each_answer(plc)
    ioc = start(plc, new_ioc, "readPeriod 100")
    use(plc, ioc)
    assert plc.connections > 20
    quiet(ioc)


def test_closes_when_idle(new_modbus, new_ioc):
    """a device that closes when nobody asks: the next request has a connection, no alarm, no word"""
    plc = new_modbus()
    ioc = start(plc, new_ioc, "readPeriod 0", inputs="",
                db="\n".join(line for line in DB.splitlines() if "INP" not in line or "stats" in line))
    for value in range(1, 6):
        count = plc.connections
        plc.hang_up()
        until(lambda: all(h.ended for h in plc.handlers), "the end of all connections")
        ioc.put("out", value)
        until_equal(lambda: plc.holding[200], value)
        assert plc.connections == count + 1
        assert ioc.severity("out") == "NO_ALARM"
    quiet(ioc)


def test_closes_after_two_idle_seconds(new_modbus, new_ioc):
    """a device that closes after 2 s without a request, between its polls: read and written, no alarm, no word"""
    plc, closed = new_modbus(), []

    def watch(handler, asked):
        if len(plc.requests) == asked and not handler.ended:
            closed.append(handler.number)
            handler.drop(reset=False)

    def mangle(request, frame):
        plc.loop.call_later(2, watch, plc.handlers[-1], len(plc.requests))
        return frame
    plc.mangle = mangle
    ioc = start(plc, new_ioc, "readPeriod 0", inputs="holding 0 100 every 5000")
    for value in range(1, 4):
        plc.holding[0] = plc.holding[99] = value
        until(lambda: len(closed) >= value, "a close because nobody asks")
        ioc.put("out", 100 + value)
        until_equal(lambda: plc.holding[200], 100 + value)
        ioc.wait_value("in", value)
        ioc.wait_value("last", value)
        assert ioc.severity("in") == ioc.severity("last") == ioc.severity("out") == "NO_ALARM"
    assert plc.connections > 3
    quiet(ioc)


def test_answers_twice(new_modbus, new_ioc):
    """a device that answers everything twice: the second answer is dropped"""
    plc = new_modbus()
    plc.mangle = lambda request, frame: frame + frame
    ioc = start(plc, new_ioc)
    use(plc, ioc)
    assert plc.connections == 1
    quiet(ioc)


def test_at_most_100_bits(new_modbus, new_ioc):
    """maxBits: no request for coils is longer, neither what reads nor what writes"""
    plc = new_modbus(size=1000)
    ioc = start(plc, new_ioc, "maxBits 100", inputs="coils 0 300 every 50", outputs="coils 400 320", db="""
        record(bi, "$(P)last") { field(DTYP, "S7plc") field(INP, "@PLC/37 T=BYTE B=3") field(SCAN, "I/O Intr") }
        record(aao, "$(P)all") { field(DTYP, "S7plc") field(OUT, "@PLC/0") field(FTVL, "UCHAR") field(NELM, "40") }
        """)
    plc.coils[299] = True
    ioc.wait_value("last", 1)
    ioc.put("all", [0x5A] * 40)
    until_equal(lambda: [plc.coils[400 + i] for i in range(320)], [bool(0x5A >> i & 1) for i in range(8)] * 40)
    assert plc.writes() and all(r.count <= 100 for r in plc.since())
    assert max(r.count for r in plc.since()) > 90


@pytest.mark.parametrize("option,offset", [("anyUnit", 6), ("anyTransaction", 1), ("loose", 6), ("loose", 1)])
def test_wrong_numbers(new_modbus, new_ioc, option, offset):
    """check={option}: answers with another number in byte {offset} of the header are taken"""
    plc = new_modbus()
    plc.mangle = lambda request, frame: frame[:offset] + bytes([(frame[offset] + 9) % 256]) + frame[offset + 1:]
    ioc = start(plc, new_ioc, f"check {option}")
    use(plc, ioc)
    quiet(ioc)


def test_units(new_modbus, new_ioc):
    """three units behind one connection: each range asks its unit; one that is silent hurts nobody else"""
    plc = new_modbus()
    silent = set()
    plc.mangle = lambda request, frame: b"" if request.unit in silent else frame
    db = "\n".join(f"""
        record(longin, "$(P)in{u}") {{ field(DTYP, "S7plc") field(INP, "@PLC/{4 * u} T=INT16") field(SCAN, "I/O Intr") }}
        record(longout, "$(P)out{u}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{4 * u} T=INT16") }}""" for u in range(3))
    db += DB[DB.index('record(longin, "$(P)losses")'):]
    ioc = start(plc, new_ioc, inputs="holding 0 2 every 50, holding 10 2 every 50 unit 2, holding 20 2 every 50 unit 3",
                outputs="holding 100 2, holding 100 2 unit 2, holding 100 2 unit 3", db=db)
    for u in range(3):
        plc.holding[10 * u] = 7 + u
        ioc.wait_value(f"in{u}", 7 + u)
        mark = plc.mark()
        ioc.put(f"out{u}", 50 + u)
        assert [(r.unit, r.start) for r in plc.writes(mark)] == [(u + 1, 100)]
    assert {(r.unit, r.start) for r in plc.since(0, 3) if r.start < 100} == {(1, 0), (2, 10), (3, 20)}
    assert plc.connections == 1
    assert {ioc.severity(f"{way}{u}") for way in ("in", "out") for u in range(3)} == {"NO_ALARM"}
    quiet(ioc)


def test_silent_unit(new_modbus, new_ioc):
    """one of three units does not answer: its records say so, the others go on, on the same connection"""
    plc = new_modbus()
    db = "\n".join(f"""
        record(longin, "$(P)in{u}") {{ field(DTYP, "S7plc") field(INP, "@PLC/{4 * u} T=INT16") field(SCAN, "I/O Intr") }}"""
                   for u in range(3))
    lines = plc.configure("holding 0 2 every 50, holding 10 2 every 50 unit 2, holding 20 2 every 50 unit 3",
                          "", timeout=200)
    ioc = new_ioc(lines, db)
    plc.holding[0] = 1
    ioc.wait_value("in0", 1)
    plc.mangle = lambda request, frame: b"" if request.unit == 2 else frame
    ioc.wait_alarm("in1", "INVALID", "READ", "no answer")
    plc.holding[0] = plc.holding[20] = 5
    ioc.wait_value("in0", 5)
    ioc.wait_value("in2", 5)
    assert ioc.severity("in0") == ioc.severity("in2") == "NO_ALARM"
    plc.mangle = None
    plc.holding[10] = 6
    ioc.wait_value("in1", 6)
    ioc.wait_alarm("in1", "NO_ALARM")
    assert plc.connections == 1


def test_late_answers(new_modbus, new_ioc):
    """one of three units answers when its time is over: what comes late is dropped, the others are read and written on the same connection"""
    plc, late = new_modbus(), []
    db = "\n".join(f"""
        record(longin, "$(P)in{u}") {{ field(DTYP, "S7plc") field(INP, "@PLC/{4 * u} T=INT16") field(SCAN, "I/O Intr") }}
        record(longout, "$(P)out{u}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{4 * u} T=INT16") }}""" for u in range(3))
    ioc = new_ioc(plc.configure("holding 0 2 every 50, holding 10 2 every 50 unit 2, holding 20 2 every 50 unit 3",
                                "holding 100 2, holding 100 2 unit 2, holding 100 2 unit 3", timeout=200), db)
    for u in range(3):
        ioc.wait_alarm(f"in{u}", "NO_ALARM")

    def mangle(request, frame):
        if request.unit != 2:
            return frame
        handler = plc.handlers[-1]
        plc.loop.call_later(0.3, lambda: (handler.send(frame), late.append(request)))
        return b""
    plc.mangle = mangle
    ioc.wait_alarm("in1", "INVALID", "READ", "no answer")
    for value in range(1, 4):
        plc.holding[0] = plc.holding[20] = value
        seen = len(late)
        ioc.wait_value("in0", value)
        ioc.wait_value("in2", value)
        until(lambda: len(late) >= seen + 2, "late answers")
        ioc.put("out0", 10 * value)
        until_equal(lambda: plc.holding[100], 10 * value)
    assert {ioc.severity(name) for name in ("in0", "in2", "out0")} == {"NO_ALARM"}
    plc.mangle = None
    plc.holding[10] = 7
    ioc.wait_value("in1", 7)
    ioc.wait_alarm("in1", "NO_ALARM")
    assert plc.connections == 1
    lines = errors_in(ioc.log)
    assert lines and all("no answer from this unit" in line or "good again" in line for line in lines), lines
    assert all(" of unit " in line for line in lines), lines


def test_late_answer_of_the_only_unit(new_modbus, new_ioc):
    """the only unit answers when its time is over: no answer, a new connection, and the late answer is taken for no other"""
    plc = new_modbus()
    ioc = start(plc, new_ioc, "requestTimeout 200")
    use(plc, ioc, 1)

    def mangle(request, frame):
        handler, plc.mangle = plc.handlers[-1], None
        plc.loop.call_later(0.4, lambda: handler.send(frame))
        return b""
    plc.mangle = mangle
    ioc.wait_log("disconnected: no answer for 200 ms")
    for record in ("in", "out", "far"):
        ioc.wait_alarm(record, "NO_ALARM")
    use(plc, ioc)
    assert plc.connections == 2 and ioc.get("losses") == 1


def test_restart_while_idle(new_modbus, new_ioc):
    """a device that closes in an orderly way and starts anew while nobody asks: the next put has a connection, nothing else is written, no word; after a reset all is written again"""
    plc = new_modbus()
    ioc = start(plc, new_ioc, "readPeriod 0", inputs="",
                db="\n".join(line for line in DB.splitlines() if "INP" not in line or "stats" in line))
    ioc.put("out", 1)
    ioc.put("far", 2)
    plc.hang_up()
    until(lambda: all(h.ended for h in plc.handlers), "the end of all connections")
    plc.holding[200] = plc.holding[239] = 0
    mark = plc.mark()
    ioc.put("out", 3)
    assert [r.start for r in plc.since(mark)] == [200] and plc.holding[239] == 0
    quiet(ioc)
    plc.holding[200] = plc.holding[239] = 0
    plc.power_off()
    ioc.put("out", 4, wait=False)  # it is noticed now
    ioc.wait_value("losses", 1)
    plc.power_on()
    until_equal(lambda: (plc.holding[200], plc.holding[239]), (4, 2))
    ioc.wait_alarm("out", "NO_ALARM")


def test_at_most_32(new_modbus, new_ioc):
    """a device with at most 32 registers in a request, by exception: it is asked for less from then on"""
    plc = new_modbus()
    plc.judge = lambda request: 3 if request.count > 32 else 0
    ioc = start(plc, new_ioc)
    use(plc, ioc)
    mark = plc.mark()
    plc.wait_requests(20, mark)
    assert all(r.count <= 32 for r in plc.since(mark))
    quiet(ioc)


def test_at_most_32_by_silence(new_modbus, new_ioc):
    """the same by silence: with maxRegisters it never comes to that"""
    plc = new_modbus()
    plc.mangle = lambda request, frame: b"" if request.count > 32 else frame
    ioc = start(plc, new_ioc, "maxRegisters 32")
    use(plc, ioc)
    assert plc.connections == 1 and all(r.count <= 32 for r in plc.since())
    quiet(ioc)


def test_silence_splits(new_modbus, new_ioc):
    """two ranges of the user that are silent when read together are read apart after the first loss"""
    plc = new_modbus()
    plc.mangle = lambda request, frame: b"" if request.count > 50 else frame
    ioc = start(plc, new_ioc, "requestTimeout 200", inputs="holding 0 50 every 50, holding 50 50 every 50")
    use(plc, ioc)
    assert plc.connections == 2


def test_holes(new_modbus, new_ioc):
    """a device with holes: their registers are INVALID and named once, all others are read"""
    plc = new_modbus()
    plc.refuse(3, 40, 3)
    plc.refuse(3, 77, 1)
    db = DB + "\n".join(f'record(longin, "$(P)h{n}") {{ field(DTYP, "S7plc") field(INP, "@PLC/{2 * n} T=INT16") '
                        f'field(SCAN, "I/O Intr") }}' for n in (39, 40, 42, 43, 76, 77, 78))
    ioc = start(plc, new_ioc, db=db)
    for n in (40, 42, 77):
        ioc.wait_alarm(f"h{n}", "INVALID", "READ", "exception 2")
    use(plc, ioc)
    for n in (39, 43, 76, 78):
        assert ioc.severity(f"h{n}") == "NO_ALARM"
    ioc.wait_log("read of holding 40 to 42: PLC: exception 2")
    assert ioc.log_count("read of") == 1
    mark = plc.mark()
    plc.wait_requests(60, mark)
    # as few requests as that allows: no register of a hole is asked for by itself
    assert (3, 40, 3) in {r.key for r in plc.since(mark)}


def addresses(lines):
    """The addresses in "holding 10 to 12" and "holding 13" of lines, in a list for each."""
    found = [re.findall(r"holding (\d+)(?: to (\d+))?", line) for line in lines]
    return [[n for first, last in runs for n in range(int(first), int(last or first) + 1)] for runs in found]


def test_holes_are_named_once(new_modbus, new_ioc):
    """holes that several reads meet, by ranges of two periods, by outputs and by a value over one: each register is named once; after a link has changed, or the device was away, only what is new; when the device shows them: once"""
    plc = new_modbus()
    plc.refuse(3, 10, 3)
    db = DB + """
    record(ai, "$(P)over") { field(DTYP, "S7plc") field(INP, "@PLC/24 T=REAL32") field(SCAN, "I/O Intr") }
    record(longin, "$(P)other") { field(DTYP, "S7plc") field(INP, "@PLC/202 T=INT16") field(SCAN, "I/O Intr") }
    """
    ioc = start(plc, new_ioc, "readPeriod 50", inputs="holding 0 100 every 50, holding 11 10 every 70",
                outputs="holding 200 40, holding 8 5", db=db)
    ioc.wait_log("read of holding 10 to 12: PLC: exception 2")
    for name in ("over", "other"):
        ioc.wait_alarm(name, "INVALID", "READ", "exception 2")

    def settle():
        mark = plc.mark()
        plc.wait_requests(40, mark)
        return ioc.log_count("read of")
    assert settle() == 1, ioc.log
    ioc.put("other.INP", "@PLC/204 T=INT16")
    ioc.wait_alarm("other", "NO_ALARM")
    ioc.put("over.INP", "@PLC/22 T=REAL32")
    ioc.wait_alarm("over", "INVALID", "READ", "exception 2")
    assert settle() == 1, ioc.log
    plc.refuse(3, 13)
    ioc.wait_log("read of holding 13: PLC: exception 2")
    plc.power_off()
    ioc.wait_value("losses", 1)
    plc.power_on()
    ioc.wait_alarm("in", "NO_ALARM")
    ioc.put("over.INP", "@PLC/26 T=REAL32")
    assert settle() == 2, ioc.log
    plc.refuse_no_more()
    ioc.wait_alarm("over", "NO_ALARM")
    until(lambda: "good again" in ioc.log, "the end of the holes")
    settle()
    assert all("read of" in line and "good again" in line for line in errors_in(ioc.log)[4:]), ioc.log
    assert sum(addresses(errors_in(ioc.log)[4:]), []) in ([10, 11, 12, 13], [12, 13, 10, 11]), ioc.log


def test_only_fc6(new_modbus, new_ioc):
    """a device without FC16: the hint, and with singleWrite=on a value of 32 bits leaves as two FC6"""
    plc = new_modbus()
    plc.without(16)
    ioc = start(plc, new_ioc, db=DB + 'record(longout, "$(P)long") { field(DTYP, "S7plc") field(OUT, "@PLC/20 T=INT32") }')
    ioc.put("long", 0x12345678)
    ioc.wait_alarm("long", "INVALID", "WRITE", "set singleWrite=on")
    ioc.command("s7plcSetOption PLC singleWrite on")
    ioc.put("long", 0x12345679)
    assert plc.holding[210:212] == [0x1234, 0x5679]
    mark = plc.mark()
    ioc.put("long", 0x1234567A)
    assert [(r.function, r.start) for r in plc.writes(mark)] == [(6, 210), (6, 211)]
    ioc.wait_alarm("long", "NO_ALARM")


def test_pause(new_modbus, new_ioc):
    """requestPause: no request sooner than that after an answer"""
    plc = new_modbus()
    ioc = start(plc, new_ioc, "requestPause 30", inputs="holding 0 100 every 10, coils 0 8 every 10")
    use(plc, ioc, 2)
    times = [r.time for r in plc.since()]
    assert min(b - a for a, b in zip(times, times[1:])) >= 0.029


SILLY = {"requestPause": ("-1", "1001", "10000", "text", "1e300", "nan"), "readPeriod": ("-1", "1", "99999999", "text"),
         "requestTimeout": ("0", "-1", "99999999", "text"), "maxRegisters": ("0", "-1", "126", "text"),
         "maxBits": ("0", "-1", "2001", "text"), "heartbeatRegister": ("-1", "65536", "text"),
         "check": ("0", "text"), "framing": ("1", "text"), "singleWrite": ("-1", "2"), "maskWrite": ("0", "text")}


def test_silly_numbers(new_ioc):
    """numbers that make no sense: each option and argument of Modbus has one line that says what is allowed"""
    port = ", 127.0.0.1, 1, "
    wrong = {'300, "holding 0 2"': "unit=300; allowed: 0 to 255", '-1, "holding 0 2"': "unit=-1; allowed: 0 to 255",
             '1, "holding 0 0"': 'count "0"; allowed: 1 to 65536', '1, "holding 0 2 every 0"': 'period "0"; allowed: 1 to 3600000 ms',
             '1, "holding 0 2 unit 300"': 'unit "300"; allowed: 0 to 255', '1, "holding 0 2", "", -1': "requestTimeout=-1; allowed: 10 to 60000"}
    ioc = new_ioc(f'modbusplcConfigure PLC{port}1, "holding 0 2"\n' +
                  "\n".join(f"modbusplcConfigure X{n}{port}{text}" for n, text in enumerate(wrong)), "")
    for n, words in enumerate(wrong.values()):
        assert [words in line for line in ioc.log.splitlines() if f"modbusplcConfigure X{n}:" in line] == [True], (words, ioc.log)
    for key, values in SILLY.items():
        for value in values:
            said = ioc.command(f"s7plcSetOption PLC {key} {value}").splitlines()
            assert len(said) == 1 and f"option {key}={value}; allowed: " in said[0], (key, value, said)


class RtuDevice:
    """RTU frames over TCP: holding registers, FC3 and FC16, with a CRC of its own (bit by bit)."""

    def __init__(self):
        self.holding, self.bad = [0] * 300, []
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        threading.Thread(target=self.run, daemon=True).start()

    @staticmethod
    def crc(data):
        crc = 0xFFFF
        for byte in data:
            crc ^= byte
            for _ in range(8):
                crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
        return struct.pack("<H", crc)

    def answer(self, frame):
        unit, function, start, count = struct.unpack(">BBHH", frame[:6])
        if self.crc(frame[:-2]) != frame[-2:]:
            self.bad.append(frame)
        if function == 3:
            data = struct.pack(f">{count}H", *self.holding[start:start + count])
            body = struct.pack(">BBB", unit, 3, len(data)) + data
        else:
            self.holding[start:start + count] = struct.unpack(f">{count}H", frame[7:7 + 2 * count])
            body = frame[:6]
        return body + self.crc(body)

    def run(self):
        while True:
            try:
                sock, _ = self.listener.accept()
            except OSError:
                return
            buffer = b""
            while data := sock.recv(4096):
                buffer += data
                while len(buffer) >= 8 and len(buffer) >= (size := 8 if buffer[1] == 3 else 9 + buffer[6]):
                    sock.sendall(self.answer(buffer[:size]))
                    buffer = buffer[size:]

    def close(self):
        self.listener.close()


def test_rtu(closing, new_ioc):
    """framing=rtu: requests and answers with a CRC and no header"""
    plc = RtuDevice()
    closing(plc)
    ioc = new_ioc(f'modbusplcConfigure("PLC", "127.0.0.1", {plc.port}, 17, "holding 0 100 every 50", "holding 200 40")\n'
                  "s7plcSetOption PLC framing rtu", DB)
    use(plc, ioc)
    assert not plc.bad
    quiet(ioc)


def test_rtu_crc():
    """the CRC of the standard's own example: 02 07 has 41 12"""
    assert RtuDevice.crc(b"\x02\x07") == b"\x41\x12"


def test_another_client(new_modbus, new_ioc):
    """a device that hangs up before it answers: after the third time the log says what that may be, once"""
    plc = new_modbus()

    def hang_up(request, frame):
        plc.handlers[-1].drop(reset=False)
        return b""
    plc.mangle = hang_up
    ioc = new_ioc(plc.configure("holding 0 100 every 50", "holding 200 40"), DB)
    plc.wait_connected(6)
    ioc.wait_log("the PLC hangs up before it answers, again and again: another client takes this connection")
    assert ioc.log_count("another client") == 1 and ioc.log_count("disconnected") == 1
    plc.mangle = None
    use(plc, ioc, 2)


def test_one_address_twice(new_ioc):
    """two stations on one host and port: one line for each later one, and none for another port or host, nor for a name beside its address"""
    ioc = new_ioc("""modbusplcConfigure A, plc.invalid, 502, 1, "holding 0 1"
                     modbusplcConfigure B, PLC.invalid, 502, 2, "holding 0 1"
                     modbusplcConfigure C, plc.invalid, 503, 1, "holding 0 1"
                     s7plcConfigure D, 127.0.0.87, 2000, 0, 2
                     s7plcConfigure E, 127.0.0.87, 2000, 0, 2
                     s7plcConfigure F, 127.0.0.88, 2000, 0, 2
                     s7plcModbusOutput F, plc.invalid, 503, 1, 0
                     s7plcConfigure G, "", 0, 0, 2
                     s7plcConfigure H, "", 0, 0, 2
                     s7plcConfigure I, localhost, 2001, 0, 2
                     s7plcConfigure J, 127.0.0.1, 2001, 0, 2""", "")
    lines = [line for line in ioc.log.splitlines() if "has the same host and port" in line]
    assert len(lines) == 3, lines
    assert "modbusplcConfigure B: A has" in lines[0] and 'one station, with "unit n"' in lines[0]
    assert "s7plcConfigure E: D has" in lines[1] and "a port for each" in lines[1]
    assert "s7plcModbusOutput F: C has" in lines[2]


def test_refused_arguments(new_ioc):
    """an address that is no full IPv4 address, and reference numbers of manuals, are refused with what is allowed"""
    ioc = new_ioc("""modbusplcConfigure A, 192.168.1, 502, 1, "holding 0 1"
                     s7plcConfigure C, "", 0, 0, 2
                     s7plcModbusOutput C, 0300.1.1.1, 502, 1, 0
                     modbusplcConfigure B, 192.168.0.1, 502, 1, "40001 10" """, "")
    assert 'IPaddr "192.168.1"; allowed: host name or dotted IP address' in ioc.log
    assert 's7plcModbusOutput C: IPaddr "0300.1.1.1"; allowed: host name or dotted IP address' in ioc.log
    assert '40001 is "holding 0"' in ioc.log


def test_holes_among_outputs(new_modbus, new_ioc):
    """a device with holes among its writable registers: the others start from what it holds, follow it and are written; the log names the holes once"""
    plc = new_modbus()
    for functions in (3, (6, 16)):
        plc.refuse(functions, 210, 3)
        plc.refuse(functions, 230, 1)
    db = DB + "\n".join(f'record(longout, "$(P)o{n}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{2 * (n - 200)} T=INT16") }}'
                        for n in (201, 209, 211, 213, 229, 230, 231))
    plc.holding[200:] = [500 + i for i in range(40)]
    ioc = start(plc, new_ioc, "track on", "readPeriod 50", db=db)
    for n in (201, 209, 213, 229, 231):
        ioc.wait_value(f"o{n}", 300 + n)
        assert ioc.severity(f"o{n}") == "NO_ALARM"
    assert plc.writes() == []
    use(plc, ioc)
    for n in (201, 209, 213, 229, 231):
        ioc.put(f"o{n}", n)
        until_equal(lambda: plc.holding[n], n)
        plc.holding[n] = -n & 0xFFFF
        ioc.wait_value(f"o{n}", -n)
        assert ioc.severity(f"o{n}") == "NO_ALARM"
    ioc.put("o211", 1)
    ioc.wait_alarm("o211", "INVALID", "WRITE", "exception 2")
    ioc.wait_log("write of holding 211: PLC: exception 2")
    ioc.wait_log("read of holding 210 to 212: PLC: exception 2")
    mark = plc.mark()
    plc.wait_requests(60, mark)
    assert len(errors_in(ioc.log)) == 2 and "(and of holding 230)" in ioc.log, ioc.log  # the holes, the put
    # after a loss: the holes are tried once more, what the device still holds is not
    mark = plc.mark()
    plc.power_off()
    ioc.wait_value("losses", 1)
    plc.power_on()
    until(lambda: [r for r in plc.writes(mark) if r.start == 211], "the put into the hole once more")
    ioc.wait_alarm("o211", "INVALID", "WRITE", "exception 2")
    assert {a for r in plc.writes(mark) for a in r.addresses()} == {211}


TRUTH = """
record(longout, "$(P)hole") { field(DTYP, "S7plc") field(OUT, "@PLC/4") }
record(bo, "$(P)bit") { field(DTYP, "S7plc") field(OUT, "@PLC/5 T=UINT8 B=1") }
record(stringout, "$(P)text") { field(DTYP, "S7plc") field(OUT, "@PLC/2 L=4") }
record(aao, "$(P)array") { field(DTYP, "S7plc") field(OUT, "@PLC/0") field(FTVL, "SHORT") field(NELM, "4") }
record(longout, "$(P)before") { field(DTYP, "S7plc") field(OUT, "@PLC/2") }
record(longout, "$(P)behind") { field(DTYP, "S7plc") field(OUT, "@PLC/6") }
"""
REFUSED = ("INVALID", "READ", "PLC: exception 2, illegal data address")


def test_outputs_in_a_hole(new_modbus, new_ioc):
    """outputs that follow: with a register in a hole READ/INVALID until the device shows the registers; others are not touched"""
    plc = new_modbus()
    plc.holding[200], plc.holding[201], plc.holding[202], plc.holding[203] = 10, 11, 12, 13
    rule = plc.refuse(3, 202)
    ioc = start(plc, new_ioc, "track on", "readPeriod 100", inputs="holding 200 20 every 50", db=TRUTH)
    for name in ("hole", "bit", "text", "array"):
        ioc.wait_alarm(name, *REFUSED)
    ioc.wait_value("before", 11)
    ioc.wait_value("behind", 13)
    assert ioc.severity("before") == ioc.severity("behind") == "NO_ALARM"
    # what is put is taken by the device: it is not known what it holds, but what was put is there
    ioc.put("hole", 77)
    assert plc.holding[202] == 77 and ioc.alarm("hole")[0] == "NO_ALARM"
    plc.holding[202] = 0
    plc.refuse_no_more(rule)
    for name, value in ("hole", 0), ("bit", 0):
        ioc.wait_value(name, value)
        ioc.wait_alarm(name, "NO_ALARM")
    until_equal(lambda: ioc.plain("array"), [10, 11, 0, 13])
    ioc.wait_alarm("array", "NO_ALARM")
    ioc.wait_alarm("text", "NO_ALARM")


def test_becomes_a_hole(new_modbus, new_ioc):
    """an output that followed, and whose register is refused from then on, says so; VAL stays the last that was seen"""
    plc = new_modbus()
    plc.holding[202] = 12
    ioc = start(plc, new_ioc, "track on", "readPeriod 100", db=TRUTH.splitlines()[1])
    ioc.wait_value("hole", 12)
    rule = plc.refuse(3, 202)
    ioc.wait_alarm("hole", *REFUSED)
    assert ioc.get("hole") == 12
    plc.refuse_no_more(rule)
    ioc.wait_alarm("hole", "NO_ALARM")
    assert ioc.get("hole") == 12


def test_read_back_in_a_hole(new_modbus, new_ioc):
    """an output whose R= lies in a hole of the inputs takes nothing from there, and says so until it can"""
    plc = new_modbus()
    plc.holding[2] = 5
    rule = plc.refuse(3, 2)
    plc.refuse(3, 200, 40)  # a device that does not show its outputs: the block tells
    ioc = start(plc, new_ioc, db='record(longout, "$(P)back") { field(DTYP, "S7plc") field(OUT, "@PLC/20 R=4") }\n'
                'record(longout, "$(P)other") { field(DTYP, "S7plc") field(OUT, "@PLC/22 R=6") }')
    plc.holding[3] = 6
    ioc.wait_alarm("back", *REFUSED)
    ioc.wait_alarm("other", "NO_ALARM")
    plc.refuse_no_more(rule)
    ioc.wait_value("back", 5)
    ioc.wait_alarm("back", "NO_ALARM")
    assert plc.writes() == []


DIGITS = """
record(longin, "$(P)in16") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=BCD16") field(SCAN, "I/O Intr") }
record(ai, "$(P)in32") { field(DTYP, "S7plc") field(INP, "@PLC/2 T=BCD32") field(SCAN, "I/O Intr") }
record(int64in, "$(P)signed") { field(DTYP, "S7plc") field(INP, "@PLC/6 T=SBCD16") field(SCAN, "I/O Intr") }
record(waveform, "$(P)time") { field(DTYP, "S7plc") field(INP, "@PLC/8 T=BCD") field(FTVL, "UCHAR") field(NELM, "2") field(SCAN, "I/O Intr") }
record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=BCD16") }
"""


def test_wrong_digits(new_modbus, new_ioc):
    """registers that hold no BCD number: READ/INVALID with what they hold, inputs and outputs that follow; good with digits"""
    plc = new_modbus()
    plc.holding.put(0, bytes.fromhex("1234 00123456 9012 5958"))
    plc.holding[200] = 0x1234
    ioc = start(plc, new_ioc, "track on", "readPeriod 100", db=DIGITS)
    for name, value in ("in16", 1234), ("in32", 123456), ("signed", -1012), ("out", 1234), ("time", [59, 58]):
        until_equal(lambda: ioc.plain(name), value)
        ioc.wait_alarm(name, "NO_ALARM")
    plc.holding.put(0, bytes.fromhex("1A2F 00123C56 901F 59FA"))
    plc.holding[200] = 0xFFFF
    for name, reason in (("in16", "0x1A2F is no BCD number"), ("in32", "0x00123C56 is no BCD number"),
                         ("signed", "0x901F is no BCD number"), ("time", "byte 1 is 0xFA: no BCD"),
                         ("out", "0xFFFF is no BCD number")):
        ioc.wait_alarm(name, "INVALID", "READ", reason)
    assert (ioc.get("in16"), ioc.get("in32"), ioc.get("signed"), ioc.get("out")) == (1234, 123456, -1012, 1234)
    ioc.put("out", 42)
    ioc.wait_alarm("out", "NO_ALARM")
    assert plc.holding[200] == 0x42
    plc.holding.put(0, bytes.fromhex("0001 00000002 F999 0000"))
    for name, value in ("in16", 1), ("in32", 2), ("signed", -7999), ("time", [0, 0]):
        until_equal(lambda: ioc.plain(name), value)
        ioc.wait_alarm(name, "NO_ALARM")


OVER = "".join(f'record(longin, "$(P)i{n}") {{ field(DTYP, "S7plc") field(INP, "@PLC/{2 * n} T=UINT16") field(SCAN, "I/O Intr") }}\n'
               f'record(longout, "$(P)o{n}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{2 * n} T=UINT16") }}\n'
               for n in (3, 4, 5, 6)) + """
record(ai, "$(P)iover") { field(DTYP, "S7plc") field(INP, "@PLC/8 T=UINT32") field(SCAN, "I/O Intr") }
record(ao, "$(P)oover") { field(DTYP, "S7plc") field(OUT, "@PLC/8 T=UINT32") }
record(int64in, "$(P)ilong") { field(DTYP, "S7plc") field(INP, "@PLC/20 T=UINT64") field(SCAN, "I/O Intr") }
record(longin, "$(P)i13") { field(DTYP, "S7plc") field(INP, "@PLC/26 T=UINT16") field(SCAN, "I/O Intr") }
"""


def test_value_over_a_hole(new_modbus, new_ioc):
    """a value over a hole is READ/INVALID, a neighbour that shares its other register is not; as a whole again when the hole ends"""
    plc = new_modbus()
    for n in range(16):
        plc.holding[n], plc.holding[200 + n] = n, 1000 + n
    rules = [plc.refuse(3, n) for n in (4, 204, 11)]
    ioc = start(plc, new_ioc, "track on", "readPeriod 100", db=OVER)
    for name in ("i4", "iover", "o4", "oover", "ilong"):
        ioc.wait_alarm(name, *REFUSED)
    for name, value in ("i3", 3), ("i5", 5), ("i6", 6), ("i13", 13), ("o3", 1003), ("o5", 1005), ("o6", 1006):
        ioc.wait_value(name, value)
        ioc.wait_alarm(name, "NO_ALARM")
    until(lambda: "read of holding 4: PLC: exception 2, illegal data address (and of holding 11, holding 204)" in ioc.log,
          "the holes")
    ioc.put("o5", 7)
    ioc.wait_alarm("o5", "NO_ALARM")
    for rule in rules:
        plc.refuse_no_more(rule)
    for name, value in (("i4", 4), ("iover", 0x40005), ("o4", 1004), ("oover", (1004 << 16) + 7),
                        ("ilong", 0xa000b000c000d)):
        ioc.wait_value(name, value)
        ioc.wait_alarm(name, "NO_ALARM")
    mark = plc.mark()
    plc.wait_requests(40, mark)
    asked = [r for r in plc.requests[mark:] if r.function == 3]
    assert not [r for r in asked if r.start in (5, 205, 11, 12, 13) or r.start + r.count in (5, 205, 11, 12, 13)], asked


def test_value_that_cannot_be_read_whole(new_modbus, new_ioc):
    """a device that shows each register of a value, but not both in one request: never a value of two moments, READ/INVALID"""
    plc = new_modbus()
    plc.judge = lambda r: 2 if r.function == 3 and r.start <= 4 < r.start + r.count - 1 else 0
    ioc = start(plc, new_ioc, db=OVER)
    ioc.wait_alarm("iover", *REFUSED)
    values = []
    ioc.pv("iover").add_callback(lambda value, **kw: values.append(value))
    for n in range(1, 20):
        plc.holding[4] = plc.holding[5] = plc.holding[6] = n
        ioc.wait_value("i6", n)
        assert ioc.alarm("iover") == REFUSED
    assert not [v for v in values if v], values
    plc.judge = lambda r: 0
    ioc.wait_value("iover", 19 * 65536 + 19)
    ioc.wait_alarm("iover", "NO_ALARM")
    assert ioc.get("i4") == ioc.get("i5") == 19


WIDTHS = "".join(
    f'record({kind}, "$(P)i{n}") {{ field(DTYP, "S7plc") field(INP, "@PLC/{2 * at} T={t}") field(SCAN, "I/O Intr") }}\n'
    f'record({out}, "$(P)o{n}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{2 * at} T={t}") }}\n'
    for n, (at, t, kind, out) in enumerate(((0, "UINT16", "longin", "longout"), (1, "UINT32", "int64in", "int64out"),
                                            (3, "UINT16", "longin", "longout"), (4, "UINT64", "int64in", "int64out"),
                                            (8, "UINT16", "longin", "longout")))) + """
record(stringin, "$(P)text") { field(DTYP, "S7plc") field(INP, "@PLC/20 L=10") field(SCAN, "I/O Intr") }
record(stringout, "$(P)textout") { field(DTYP, "S7plc") field(OUT, "@PLC/20 L=10") }
"""
SHORT = "maxRegisters is less than the value"


@pytest.mark.parametrize("most,wide", [(1, (1, 3)), (2, (3,)), (3, (3,)), (4, ())])
def test_less_than_a_value(new_modbus, new_ioc, most, wide):
    """maxRegisters={most}: numbers of more registers are refused with words, never in two requests; all others and texts are read and written"""
    plc = new_modbus()
    plc.judge = lambda r: 3 if r.count > most else 0
    plc.holding.put(10, b"ABCDEFGHIJ")
    ioc = start(plc, new_ioc, f"maxRegisters {most}", db=WIDTHS)
    values = {}
    for round_ in (1, 2):
        for n, (at, size) in enumerate(((0, 1), (1, 2), (3, 1), (4, 4), (8, 1))):
            values[n] = sum(round_ << 16 * k for k in range(size))
            for k in range(size):
                plc.holding[at + k] = round_
        for n, value in values.items():
            if n in wide:
                ioc.wait_alarm(f"i{n}", "INVALID", "READ", SHORT)
                assert ioc.get(f"i{n}") == 0
            else:
                ioc.wait_value(f"i{n}", value)
                ioc.wait_alarm(f"i{n}", "NO_ALARM")
    until_equal(lambda: ioc.text("text"), "ABCDEFGHIJ")
    for n, value in values.items():
        ioc.put(f"o{n}", value)
        assert ioc.alarm(f"o{n}") == (("INVALID", "WRITE", SHORT) if n in wide else ("NO_ALARM", "NO_ALARM", ""))
    ioc.put("textout", "abcdefghij")
    until_equal(lambda: plc.holding.bytes(210, 10), b"abcdefghij")
    assert all(r.count <= most for r in plc.requests)
    assert [plc.holding[200 + at] for at in (1, 2, 4, 7)] == [0 if n in wide else 2 for n in (1, 1, 3, 3)]
    # the device can do more after all
    plc.judge = lambda r: 0
    ioc.command("s7plcSetOption PLC maxRegisters 125")
    for n, value in values.items():
        ioc.wait_value(f"i{n}", value)
        ioc.wait_alarm(f"i{n}", "NO_ALARM")
        ioc.put(f"o{n}", value)
        ioc.wait_alarm(f"o{n}", "NO_ALARM")


def test_hints(new_ioc):
    """numbers of manuals and an address that is missing: one line each says what to write"""
    ioc = new_ioc("""modbusplcConfigure A, 127.0.0.1, 1, 1, "holding 40001 2, input 30101 2, holding 100 2", "discrete 10001 2"
                     modbusplcConfigure B, 127.0.0.1, 1, 1, "holding 40001 2, input 30101 2, holding 100 2", "coils 1 2"
                     modbusplcConfigure C, 127.0.0.1, 1, 1, "4xxxx 0 2"
                     modbusplcConfigure E, 127.0.0.1, 1, 1, "holding 0 9 at 1, holding 4 9", "holding 0 9"
                     modbusplcConfigure D""", "")
    log = ioc.log
    assert "modbusplcConfigure E: inputs: range 1 has its registers at an odd byte, 1" in log
    assert "modbusplcConfigure E: inputs: range 2 has holding 4 to 8 once more: they are in range 1 too" in log
    assert "modbusplcConfigure E: outputs" not in log
    assert log.count("modbusplcConfigure B: \"") == 2
    assert '"holding 40001" is address 40001; if it is a manual\'s number, write "holding 0": they count from 40001' in log
    assert 'write "input 100": they count from 30001' in log
    assert 'table "4xxxx": 4xxxx is holding' in log and "modbusplcConfigure D: IPaddr is missing; allowed: " in log
