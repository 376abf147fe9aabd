"""One reason for one fault: what the statistics, the records and the log say is the same, and said once, for
each fault of a Modbus PLC; and nothing is connected that does not answer."""
import pytest

from ioc import errors_in
from waiting import until, until_equal

DB = """
record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT16") field(SCAN, "I/O Intr") }
record(longin, "$(P)slow") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT16") field(SCAN, ".1 second") }
record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT16") }
record(longin, "$(P)oc") { field(DTYP, "S7plc stats") field(INP, "@PLC/outputConnected") field(SCAN, "I/O Intr") }
"""


@pytest.fixture
def ioc_of(new_ioc):
    def make(line):
        return new_ioc(line, DB, templates=[("s7plcStation.db", "P=$(P),PLC=PLC")])
    return make


def long_text(ioc, name):
    return bytes(ioc.get(f"{name}.VAL$")).rstrip(b"\0").decode()


def attempts(ioc, p=""):
    return ioc.get(f"{p}ConnectErrors") + ioc.get(f"{p}Reconnects")


# --- The connection is lost, or cannot be made ---------------------------------------------------

def wrong(change):
    """Answers are changed."""
    def begin(plc):
        plc.mangle = lambda request, frame: change(frame)
    return begin


def hangs_up(reset):
    """A PLC that ends the connection in place of its answer."""
    def begin(plc):
        def mangle(request, frame):
            plc.handlers[-1].drop(reset)
            return b""
        plc.mangle = mangle
    return begin


def mute(plc):
    plc.silent = True


FAULTS = {  # what happens, the reason
    "it is off": (lambda plc: plc.power_off(), "connection refused by PLC"),
    "it is mute": (mute, "no answer for 200 ms"),
    "it closes in place of an answer": (hangs_up(False), "connection closed by PLC"),
    "it resets in place of an answer": (hangs_up(True), "connection reset by PLC"),
    "another unit answers": (wrong(lambda f: f[:6] + b"\x63" + f[7:]), "bad answer: unit 99 instead of 1"),
    "another transaction": (wrong(lambda f: b"\x77\x77" + f[2:]), "bad answer: wrong transaction number"),
    "another function": (wrong(lambda f: f[:7] + b"\4" + f[8:]), "bad answer: function 4 instead of 3"),
    "another protocol": (wrong(lambda f: b"HTTP/1.1 400 Bad Request\r\n\r\n"), "bad answer: no Modbus/TCP"),
    "half an answer": (wrong(lambda f: f[:-1]), "answer is not complete after 200 ms"),
    "fewer registers": (wrong(lambda f: f[:4] + b"\0\5" + f[6:8] + b"\2\0\0"), "bad answer: too short"),
}


def says_everywhere(ioc, reason, p="", plc="PLC:"):
    until_equal(lambda: (ioc.text(f"{p}State"), long_text(ioc, f"{p}Reason"), long_text(ioc, f"{p}LastError")),
                ("connecting", reason, reason))
    for name in ("in", "slow", "out"):
        until_equal(lambda: ioc.alarm(f"{p}{name}"), ("INVALID", "COMM", reason))
    assert [line for line in errors_in(ioc.log) if plc in line and reason in line], ioc.log


@pytest.mark.parametrize("fault", FAULTS)
def test_connection(new_modbus, ioc_of, fault):
    """{fault}: statistics, records and the log have one reason, once; outputConnected is 0 until it answers"""
    plc = new_modbus()
    ioc = ioc_of(plc.configure("holding 0 10 every 20", "holding 20 10", timeout=200))
    ioc.wait_value("oc", 1)
    begin, reason = FAULTS[fault]
    connected = ioc.watch("oc")
    count = attempts(ioc)
    begin(plc)
    until(lambda: attempts(ioc) >= count + 3, "three attempts")
    ioc.put("out", 1)
    says_everywhere(ioc, reason)
    lines = errors_in(ioc.log)
    until(lambda: attempts(ioc) >= count + 8, "more attempts")
    says_everywhere(ioc, reason)
    # of the first loss, of the next for another reason, and what may be behind it
    assert len(lines) <= 3 and errors_in(ioc.log)[:len(lines)] == lines, ioc.log
    assert len(errors_in(ioc.log)) <= 3, ioc.log
    assert connected == [1, 0]
    plc.mangle, plc.silent = None, False
    plc.server or plc.power_on()
    for name in ("in", "slow", "out"):
        ioc.wait_alarm(name, "NO_ALARM")
    until_equal(lambda: long_text(ioc, "Reason"), "")
    assert connected == [1, 0, 1] and plc.holding[20] == 1


def test_connection_at_start(new_modbus, new_ioc):
    """each of these when the IOC starts: the same, and nothing was ever connected"""
    lines, plcs, templates = [], {}, []
    for i, (fault, (begin, _)) in enumerate(FAULTS.items()):
        plcs[fault] = new_modbus()
        begin(plcs[fault])
        lines.append(plcs[fault].configure("holding 0 10 every 20", "holding 20 10", timeout=200, name=f"PLC{i}"))
        templates.append(("s7plcStation.db", f"P=$(P){i}:,PLC=PLC{i}"))
    db = "\n".join(DB.replace("$(P)", f"$(P){i}:").replace("@PLC/", f"@PLC{i}/") for i in range(len(FAULTS)))
    ioc = new_ioc("\n".join(lines), db, templates=templates)
    connected = [ioc.watch(f"{i}:oc") for i in range(len(FAULTS))]
    for i, (fault, (_, reason)) in enumerate(FAULTS.items()):
        until(lambda: attempts(ioc, f"{i}:") >= 4, f"four attempts where {fault}")
        ioc.put(f"{i}:out", 1)
        says_everywhere(ioc, reason, f"{i}:", f"PLC{i}:")
        said = [line for line in errors_in(ioc.log) if f" PLC{i}:" in line]
        assert len(said) <= 2 and connected[i] == [0], (fault, said, connected[i])


@pytest.mark.parametrize("outputs", ["holding 20 10", ""])
def test_bad_inputs(new_modbus, ioc_of, outputs):
    """a PLC that answers reads of outputs ("{outputs}") well and each read of inputs badly: that is said once, and once that it is over"""
    plc = new_modbus()
    plc.mangle = lambda request, frame: frame[:7] + b"\3" + frame[8:] if request.function == 4 else frame
    ioc = ioc_of(plc.configure("input 0 10 every 20", outputs, timeout=200))
    until(lambda: attempts(ioc) >= 6, "six attempts")
    assert len(errors_in(ioc.log)) == 1 and "bad answer: function 3 instead of 4" in errors_in(ioc.log)[0], ioc.log
    assert "answered again" not in ioc.log and ioc.log_count(" connected to") == 1, ioc.log
    plc.mangle = None
    ioc.wait_alarm("in", "NO_ALARM")
    ioc.wait_log("requests are answered again")
    assert ioc.log_count("answered again") == 1 and len(errors_in(ioc.log)) == 1, ioc.log


def test_no_answer_to_connect(ioc_of, black_hole):
    """an address that answers no connect: the same"""
    ioc = ioc_of(f'modbusplcConfigure("PLC", "127.0.0.1", {black_hole.port}, 1, "holding 0 10", "holding 20 10", 200)\n'
                 "s7plcSetOption PLC connectTimeout 100")
    until(lambda: attempts(ioc) >= 4, "four attempts")
    ioc.put("out", 1)
    says_everywhere(ioc, "PLC does not answer")
    assert len(errors_in(ioc.log)) == 1, ioc.log


def test_no_route(ioc_of):
    """an address that no machine can have: the same"""
    ioc = ioc_of('modbusplcConfigure("PLC", "240.0.0.1", 502, 1, "holding 0 10", "holding 20 10", 200)')
    until(lambda: attempts(ioc) >= 4, "four attempts")
    ioc.put("out", 1)
    reason = long_text(ioc, "Reason")
    assert reason
    says_everywhere(ioc, reason)
    assert len(errors_in(ioc.log)) == 1, ioc.log


def test_connection_is_taken(new_modbus, ioc_of):
    """a PLC that takes one client and has another: connection closed, and the log says what that may be"""
    plc = new_modbus()
    hangs_up(False)(plc)
    ioc = ioc_of(plc.configure("holding 0 10 every 20", "holding 20 10", timeout=200))
    until(lambda: attempts(ioc) >= 6, "six attempts")
    ioc.put("out", 1)
    says_everywhere(ioc, "connection closed by PLC")
    lines = errors_in(ioc.log)
    assert len(lines) == 2 and "another client takes this connection" in lines[1], lines


# --- Exceptions: the connection stays ----------------------------------------------------------------

# Two lines for each: of more than 20 in a minute the log of a PLC only tells how many there were.
CODES = {1: "exception 1, illegal function", 2: "exception 2, illegal data address",
         3: "exception 3, illegal data value", 4: "exception 4, device failure",
         5: "exception 5, acknowledge", 6: "exception 6, device busy",
         10: "exception 10, no gateway path", 11: "exception 11, gateway: no answer", 99: "exception 99, not in the standard"}


def test_refused_read(new_modbus, ioc_of):
    """each exception on a read: statistics, records and the log have one reason, the log once"""
    plc = new_modbus()
    ioc = ioc_of(plc.configure("holding 0 10 every 20", "holding 20 10", timeout=200))
    ioc.wait_value("oc", 1)
    connected = ioc.watch("oc")
    for code, words in CODES.items():
        rule = plc.refuse(3, 0, 10, code=code)
        for name in ("in", "slow"):
            until_equal(lambda: ioc.alarm(name), ("INVALID", "READ", f"PLC: {words}"))
        until_equal(lambda: (ioc.text("State"), long_text(ioc, "Reason")),
                    ("reads refused", f"holding 0 to 9: {words} (10 of 10 refused)"))
        plc.wait_requests(10)
        ioc.wait_log(f"read of holding 0 to 9: PLC: {words}")
        assert ioc.log_count(words) == 1 and ioc.log_count("read of") == 2 * ioc.log_count("good again") + 1, ioc.log
        ioc.put("out", code)
        assert ioc.severity("out") == "NO_ALARM"
        plc.refuse_no_more(rule)
        for name in ("in", "slow"):
            ioc.wait_alarm(name, "NO_ALARM")
        until_equal(lambda: (ioc.text("State"), long_text(ioc, "Reason")), ("ok", ""))
    assert plc.connections == 1 and connected == [1]


def test_refused_write(new_modbus, ioc_of):
    """each exception on a write: the record and the log have one reason, setpoints says that some are refused"""
    plc = new_modbus()
    ioc = ioc_of(plc.configure("holding 0 10 every 20", "holding 20 10", timeout=200))
    ioc.wait_value("oc", 1)
    connected, told = ioc.watch("oc"), 0
    for code, words in CODES.items():
        rule = plc.refuse((6, 16), 20, 10, code=code)
        reason = "PLC has no FC16: set singleWrite=on" if code == 1 else f"PLC: {words}"
        for value in (1, 2):
            ioc.put("out", value)
            until_equal(lambda: ioc.alarm("out"), ("INVALID", "WRITE", reason))
        until_equal(lambda: ioc.get("Setpoints"), 5)
        ioc.wait_log(f"write of holding 20: {reason}")
        told += 1
        assert ioc.log_count(reason) == 1 and ioc.log_count("write of") == told, ioc.log
        assert ioc.severity("in") == ioc.severity("slow") == "NO_ALARM"
        assert (ioc.text("State"), long_text(ioc, "Reason")) == ("ok", "")
        plc.refuse_no_more(rule)
        ioc.put("out", 100 + code)
        until_equal(lambda: (ioc.severity("out"), ioc.get("Setpoints"), plc.holding[20]), ("NO_ALARM", 1, 100 + code))
    assert plc.connections == 1 and connected == [1]
