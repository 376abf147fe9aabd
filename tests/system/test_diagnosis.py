"""Wrong block sizes, floods, nonsense: the operator gets one line, the IOC stays calm."""
import random
import struct

import pytest

from waiting import until

IN = """
record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") }
"""


@pytest.mark.parametrize("sent, size", [(60, 64), (100, 64), (63, 64), (65, 64), (40, 64),
                                        (128, 100), (1000, 1024), (10, 4)])
def test_wrong_size(new_peer, new_ioc, sent, size):
    """blocks of {sent} bytes where inSize is {size}: said once with both numbers, INVALID, and counted"""
    peer = new_peer(size, 0)
    ioc = new_ioc(peer.configure(), IN + """
        record(longin, "$(P)count") { field(DTYP, "S7plc stats") field(INP, "@PLC/reconnects") }
        """)
    peer.wait_connected()
    peer.every(0.02, bytes(sent))
    line = ioc.wait_log("the PLC sends blocks of")
    assert f"of {sent} bytes" in line and f"inSize is {size}" in line
    ioc.wait_alarm("in", "INVALID", "COMM", f"PLC sends {sent} bytes, inSize is {size}",
                   ask=True)
    peer.wait_connected(len(peer.connections) + 2)  # it goes on trying
    ioc.process_record("count")
    assert ioc.log_count("the PLC sends blocks of") == 1 and ioc.get("count") >= 2
    assert ioc.alarm("in")[:2] == ("INVALID", "COMM")


def test_no_wrong_data(new_peer, new_ioc):
    """data of a wrong block size is never shown as good once the size is known, over many connections"""
    peer = new_peer(64, 0)
    ioc = new_ioc(peer.configure(), IN + """
        record(longin, "$(P)spy") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") field(FLNK, "$(P)good") }
        record(calc, "$(P)good") { field(INPA, "$(P)good") field(INPB, "$(P)spy.SEVR") field(CALC, "A+(B<3)") }
        """)
    peer.wait_connected()
    peer.every(0.02, b"\x01" * 60)
    ioc.wait_log("the PLC sends blocks of 60 bytes")
    ioc.wait_alarm("spy", "INVALID")
    good = ioc.get("good")
    peer.wait_connected(len(peer.connections) + 4)
    assert ioc.get("good") == good


def test_right_after_wrong(new_peer, new_ioc):
    """when the PLC's block size is corrected, values are good again without help"""
    peer = new_peer(64, 0)
    ioc = new_ioc(peer.configure(), IN)
    peer.wait_connected()
    peer.every(0.02, bytes(60))
    ioc.wait_alarm("in", "INVALID", "COMM", "inSize is 64", ask=True)
    peer.every(0.02, struct.pack(">i", 77).ljust(64, b"\0"))
    ioc.wait_value("in", 77)
    ioc.wait_alarm("in", "NO_ALARM")
    assert ioc.log_count("blocks have the right size again") == 1

# Each block holds its number at both ends; `wrong` counts those that do not.
ENDS = """
record(longin, "$(P)in")   { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") field(PHAS, "0") }
record(longin, "$(P)last") { field(DTYP, "S7plc") field(INP, "@PLC/92 T=INT32") field(SCAN, "I/O Intr") field(PHAS, "1") field(FLNK, "$(P)wrong") }
record(calc, "$(P)wrong")  { field(INPA, "$(P)wrong") field(INPB, "$(P)in") field(INPC, "$(P)last") field(INPD, "$(P)last.SEVR") field(CALC, "A+(D<3&&B#C)") }
record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT32 R=0") }
"""


@pytest.mark.parametrize("what, cut, sign", [
    ("7 bytes too many, once", lambda n, block: block + bytes(7) if n == 15 else block,
     "PLC out of step"),
    ("1 byte lost, once", lambda n, block: block[1:] if n == 15 else block,
     "PLC out of step"),
    ("60 bytes from then on", lambda n, block: block[:60] if n >= 15 else block,
     "PLC sends 60 bytes, inSize is 96"),
    ("half of it from then on", lambda n, block: block[:48] if n >= 15 else block,
     "PLC sends 48 bytes, inSize is 96"),
])
def test_slip(new_peer, new_ioc, what, cut, sign):
    """a stream of good blocks slips, {what}: nothing wrong is shown or sent, and the log says why"""
    peer = new_peer(96, 4)
    numbers, after = [0], []

    def make():
        numbers[0] += 1
        number = struct.pack(">i", numbers[0])
        if len(peer.connections) > 1:
            after.append(numbers[0])
            return number * 24
        return cut(numbers[0], number * 24)
    ioc = new_ioc(peer.configure(recv_timeout=5000)
                  + "\ns7plcSetOption PLC track on", ENDS)
    peer.wait_connected()
    peer.every(0.05, make)
    ioc.wait_log(f"disconnected: {sign}")
    until(lambda: after and ioc.get("in") > after[0] + 3, "blocks of the next connection")
    ioc.wait_alarm("in", "NO_ALARM")
    assert ioc.get("wrong") == 0
    ioc.put("out", ioc.get("in"))
    shown = {struct.pack(">i", n) for n in range(numbers[0] + 1)}
    for connection in peer.connections:
        assert set(connection.blocks()) <= shown


def test_random_sizes(new_peer, new_ioc):
    """a PLC that sends any number of bytes at a time: no crash, few lines, and never a hang"""
    chance = random.Random(3)
    peer = new_peer(64, 0)
    ioc = new_ioc(peer.configure(), IN)
    peer.wait_connected()
    peer.every(0.004, lambda: chance.randbytes(chance.randrange(1, 200)))
    ioc.wait_log("no block size that fits inSize 64")
    ioc.wait_alarm("in", "INVALID", "COMM", "PLC sends no blocks of 64 bytes", ask=True)
    ioc.wait_alarm("in", "INVALID")
    assert len(ioc.log.splitlines()) < 60


def counter(start=0):
    number = start

    def blocks():
        nonlocal number
        number += 1000
        return b"".join(struct.pack(">i", n).ljust(64, b"\0")
                        for n in range(number - 1000, number))
    return blocks


def test_flood(new_peer, new_ioc):
    """a PLC that sends as fast as it can: no queue overflow, few log lines, the IOC answers, memory is flat"""
    peer = new_peer(64, 4)
    ioc = new_ioc(peer.configure(), IN + "".join(f"""
        record(longin, "$(P)i{i}") {{ field(DTYP, "S7plc") field(INP, "@PLC/{i % 60} T=INT32") field(SCAN, "I/O Intr") field(PRIO, "{('LOW', 'MEDIUM', 'HIGH')[i % 3]}") }}
        """ for i in range(300)) + """
        record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT32") }
        """)
    peer.wait_connected()
    peer.every(0, counter())
    until(lambda: ioc.get("in") > 20000, "20,000 blocks")
    memory = ioc.memory()
    goal = ioc.get("in") + 200000
    until(lambda: ioc.get("in") > goal, "200,000 blocks more", limit=120)
    ioc.put("out", 99)
    peer.wait_block(b"\0\0\0\x63")
    assert ioc.memory() < memory + 20e6
    report = ioc.command("s7plcReport PLC 1")
    assert "coalesced" in report
    log = ioc.log
    assert "overflow" not in log.lower() and "full" not in log.lower(), log
    assert log.count("sevr=") < 10, log
    assert len(peer.connections) == 1


def test_sim_flood(new_sim, new_ioc):
    """plcSim's flood for a while: all is calm, and the values are good afterwards"""
    sim = new_sim("in = 64\nout = 64\nperiod = 20 ms\nsignal 0 UINT32 counter\n")
    ioc = new_ioc(f's7plcConfigure("PLC", "127.0.0.1", {sim.port}, 64, 64, 1, 30000, 100)', IN)
    until(lambda: ioc.get("in") > 5, "first blocks")
    sim.command("flood on")
    until(lambda: ioc.get("in") > 200000, "a flood", limit=120)
    sim.command("flood off")
    first = ioc.get("in")
    until(lambda: ioc.get("in") > first + 5, "blocks after the flood")
    ioc.wait_alarm("in", "NO_ALARM")
    assert "overflow" not in ioc.log.lower()


@pytest.mark.parametrize("fault, sign", {
    "silence on": "no block for",
    "close": "closed by PLC",
    "reset": "reset by PLC",
    "restart 300": "reset by PLC",
    "unplug": "no block for",
    "truncate 60": "PLC sends blocks of 60",
}.items(), ids=lambda value: value.split()[0])
def test_sim_fault(new_sim, new_ioc, fault, sign):
    """plcSim's fault "{fault}": the log says "{sign}", and values are good again after it"""
    sim = new_sim("in = 64\nout = 64\nperiod = 20 ms\nsignal 0 UINT32 counter\n")
    ioc = new_ioc(f's7plcConfigure("PLC", "127.0.0.1", {sim.port}, 64, 64, 1, 500, 100)', IN)
    ioc.wait_alarm("in", "NO_ALARM")
    sim.command(fault)
    ioc.wait_log(sign)
    sim.command("plug" if fault == "unplug" else "normal")
    ioc.wait_alarm("in", "NO_ALARM")
    first = ioc.get("in")
    until(lambda: ioc.get("in") != first, "values that move")


@pytest.mark.parametrize("fault", ["fragment 10", "fragment 1", "delay 100"])
def test_sim_harmless_fault(new_sim, new_ioc, fault):
    """plcSim's "{fault}" is no fault: no alarm, no message"""
    sim = new_sim("in = 64\nout = 64\nperiod = 200 ms\nsignal 0 UINT32 counter\n")
    ioc = new_ioc(f's7plcConfigure("PLC", "127.0.0.1", {sim.port}, 64, 64, 1, 30000, 100)', IN)
    ioc.wait_alarm("in", "NO_ALARM")
    sim.command(fault)
    first = ioc.get("in")
    until(lambda: ioc.get("in") > first + 10, "ten more blocks")
    assert ioc.severity("in") == "NO_ALARM"
    assert "disconnected" not in ioc.log


def test_log_of_a_plc_that_is_down(new_peer, new_ioc):
    """a PLC that is off for a while gives one line, not one per attempt"""
    peer = new_peer(64, 0)
    peer.power_off()
    ioc = new_ioc(peer.configure(), IN)
    until(lambda: int(ioc.command("s7plcReport PLC").split(" failed")[0].split()[-1]) >= 8,
          "eight attempts")
    assert ioc.log_count("cannot connect") == 1


def test_log_of_a_silent_plc(new_peer, new_ioc):
    """a PLC that accepts connections and never sends gives a few lines, not two per attempt"""
    peer = new_peer(64, 0)
    ioc = new_ioc(peer.configure(recv_timeout=50), IN)
    peer.wait_connected(8)
    assert ioc.log_count("sevr=") <= 4, ioc.log
    peer.every(0.01, struct.pack(">i", 5).ljust(64, b"\0"))
    ioc.wait_value("in", 5)
    ioc.wait_alarm("in", "NO_ALARM")
    assert ioc.log_count("blocks come again") == 1
