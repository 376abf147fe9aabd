"""The sync handshake: no IOC moves a plant whose setpoints it does not know."""
import os
import random
import signal
import struct
import threading
import time

import pytest

from client import SECOND_IOC, TOP
from demos import run_demo
from waiting import until, until_equal

# Setpoints: DB10, 20 bytes. They are bytes 4 ... 23 of both blocks.
#   4 REAL32 Temp   8 INT16 Speed   10.2 Pump   12 STRING[8] Recipe   20 INT16 Mode
PLC = """
in = 32
out = 24
period = 20 ms
sync = on
layout = 0x1234
watchdog = 10 min
restarttime = 100 ms
db 10 20 Setpoints
init DB10.0 REAL32 21.5
init DB10.4 INT16 100
init DB10.DBX6.2 1
init DB10.8 STRING[8] bread
init DB10.16 INT16 7
tx P#DB10.DBX0.0 BYTE 20 -> 4
rx 4 -> P#DB10.DBX0.0 BYTE 20
signal 28 UINT32 counter
"""
HELD = {"Temp": 21.5, "Speed": 100, "Pump": 1, "Recipe": "bread", "Mode": 7}
BYTES = struct.pack(">fhBx8sh2x", 21.5, 100, 4, b"bread", 7)

# What autosave brings back from yesterday; PINI processes all of it
DB = """
record(ao, "$(P)Temp")          { field(DTYP, "S7plc") field(OUT, "@PLC/4 T=REAL32$(R4)") field(VAL, "80") field(PINI, "YES") }
record(longout, "$(P)Speed")    { field(DTYP, "S7plc") field(OUT, "@PLC/8$(R8)") field(VAL, "-999") field(PINI, "YES") }
record(bo, "$(P)Pump")          { field(DTYP, "S7plc") field(OUT, "@PLC/10 T=BYTE B=2$(R10)") field(VAL, "0") field(PINI, "YES") }
record(stringout, "$(P)Recipe") { field(DTYP, "S7plc") field(OUT, "@PLC/12 L=8$(R12)") field(VAL, "old") field(PINI, "YES") }
record(longout, "$(P)Mode")     { field(DTYP, "S7plc") field(OUT, "@PLC/20$(R20)") field(VAL, "1") field(PINI, "YES") }
record(int64in, "$(P)Blocks")   { field(DTYP, "S7plc") field(INP, "@PLC/28 T=UINT32") field(SCAN, "I/O Intr") }
record(bi, "$(P)Connected")     { field(DTYP, "S7plc stat") field(INP, "@PLC") field(SCAN, "I/O Intr") }
""" + (TOP / "s7plcApp/Db/s7plcSync.db").read_text().replace("$(PLC)", "PLC")


# With the SCL of plc-programming.md as the PLC; PLCLINK_ALL=1 runs the others so, too
SCL_ALWAYS = ("test_put", "test_local", "test_hmi_during_check", "test_watchdog", "test_pair")


def database(explicit=False):
    text = DB
    for place in (4, 8, 10, 12, 20):
        text = text.replace(f"$(R{place})", f" R={place}" if explicit else "")
    return text


def configure(port, readback=True, layout=0x1234, send_interval=20, more=""):
    return (f's7plcConfigure("PLC", "127.0.0.1", {port}, 32, 24, 1, 5000, {send_interval})\n'
            f"s7plcSetOption PLC sync on\ns7plcSetOption PLC layout {layout}\n"
            + ("s7plcSetOption PLC readback 0\n" if readback else "") + more)


def memory(sim):
    """The setpoints, as bytes of PLC memory."""
    lines = sim.command("dump DB10").splitlines()
    return bytes.fromhex("".join(line.split(":", 1)[1] for line in lines))


def speed(sim):
    return struct.unpack_from(">h", memory(sim), 4)[0]


def flags(sim):
    """What `status` says of SYNC: "none", "SYNC", "none, TIMEOUT", ..."""
    line = next(line for line in sim.command("status").splitlines()
                if line.startswith("sync: "))
    return line[6:]


def data_blocks(sim):
    """The setpoints of all blocks with DATA that the PLC has received."""
    lines = sim.command("received 1000").splitlines()[1:]
    blocks = [bytes.fromhex("".join(line.split()[2:])) for line in lines]
    return [block[4:] for block in blocks if block[0] & 2]


def wait_blocks(ioc, count=5):
    """Waits until so many more blocks from the PLC have reached the records."""
    first = ioc.get("Blocks")
    until(lambda: ioc.get("Blocks") >= first + count, "blocks from the PLC")


def wait_heartbeats(sim, count=2):
    """Waits until the PLC got so many more blocks of any kind."""
    def received():
        return int(sim.command("received").split()[1])
    first = received()
    until(lambda: received() >= first + count, "blocks from the IOC")


def wait_synced(sim, ioc):
    until_equal(lambda: flags(sim), "SYNC")
    wait_state(ioc, "synced")


def state(ioc):
    return ioc.text("Sync")


def wait_state(ioc, wanted):
    until_equal(lambda: state(ioc), wanted)


def wait_syncs(ioc, count):
    """Waits until the IOC is synchronised for the count-th time."""
    until(lambda: ioc.get("Sync:Count") >= count and state(ioc) == "synced",
          lambda: f"{count} times synced:\n{ioc.log}")


def values(ioc):
    return {name: ioc.text(name) if name == "Recipe" else ioc.get(name) for name in HELD}


def wait_values(ioc, **changes):
    until_equal(lambda: values(ioc), {**HELD, **changes})


@pytest.fixture
def pair_of(new_plc, new_ioc):
    """A running PLC and a stale IOC that has synchronised with it."""
    def make(**kw):
        sim = new_plc(PLC)
        ioc = new_ioc(configure(sim.port, **kw), database(not kw.get("readback", True)))
        wait_synced(sim, ioc)
        wait_values(ioc)
        return sim, ioc
    return make


@pytest.mark.parametrize("readback", [True, False], ids=["readback=", "R="])
def test_stale(new_plc, new_ioc, readback):
    """a stale IOC with PINI on every record changes not one byte of PLC memory ({id})"""
    sim = new_plc(PLC)
    assert memory(sim) == BYTES
    ioc = new_ioc(configure(sim.port, readback), database(not readback))
    wait_synced(sim, ioc)
    wait_values(ioc)
    wait_heartbeats(sim, 3)
    assert memory(sim) == BYTES
    assert [block for block in data_blocks(sim) if block != BYTES] == []
    assert ioc.alarm("Temp")[:2] == ("NO_ALARM", "NO_ALARM")
    assert "must show this output" not in ioc.log


def test_put(pair_of):
    """a put after Synced is in PLC memory, and nothing else is"""
    sim, ioc = pair_of()
    ioc.put("Speed", 123)
    assert ioc.alarm("Speed")[0] == "NO_ALARM"
    until_equal(lambda: memory(sim), BYTES[:4] + struct.pack(">h", 123) + BYTES[6:])
    ioc.put("Pump", 0)
    ioc.put("Recipe", "rolls")
    until_equal(lambda: memory(sim), struct.pack(">fhBx8sh2x", 21.5, 123, 0, b"rolls", 7))
    assert state(ioc) == "synced" and ioc.get("Sync:Count") == 1
    assert "sync: synced for" in ioc.command("s7plcReport PLC 1")
    for name in ("Remote", "Time", "Refused", "Count", "Lost", "Readbacks"):
        assert ioc.text(f"Sync{name}.NAME") == ioc.text(f"Sync:{name}.NAME"), name
    assert ioc.text("Sync:Remote") == "REMOTE" and ioc.get("Sync:Readbacks") > 0
    assert "sync: waiting -> checking" in ioc.log and "sync: checking -> synced" in ioc.log
    before = ioc.get("Sync:Time")
    until(lambda: ioc.get("Sync:Time") > before)


def test_put_while_checking(pair_of):
    """a put while the PLC checks is refused with the reason, and never jumps out later"""
    sim, ioc = pair_of()
    sim.command("refuse sync")
    wait_state(ioc, "checking")
    assert ioc.severity("Sync") == "MINOR"
    for name, value in (("Speed", 5), ("Temp", 1), ("Pump", 0), ("Recipe", "no")):
        ioc.put(name, value)
        assert ioc.alarm(name) == ("INVALID", "WRITE", "not synchronised: PLC checks")
    assert values(ioc) == HELD
    until(lambda: ioc.get("Sync:Refused") >= 4, "refused puts are counted")
    sim.command("refuse sync off")
    wait_synced(sim, ioc)
    wait_heartbeats(sim)
    assert memory(sim) == BYTES
    ioc.put("Speed", 6)
    assert ioc.alarm("Speed")[0] == "NO_ALARM"
    until_equal(lambda: speed(sim), 6)


def test_no_block(new_peer, new_ioc):
    """a PLC that takes the connection and shows nothing yet: puts are refused with the reason, nothing is sent"""
    peer = new_peer(32, 24)
    ioc = new_ioc(configure(peer.port), database())
    peer.wait_connected()
    wait_state(ioc, "waiting")
    ioc.put("Speed", 5)
    assert ioc.alarm("Speed") == ("INVALID", "WRITE", "not synchronised: no block yet")
    assert not peer.connection.received


def test_local(pair_of):
    """in LOCAL a put is refused, the HMI's values are followed, and going REMOTE moves nothing"""
    sim, ioc = pair_of()
    sim.command("local")
    wait_state(ioc, "LOCAL")
    ioc.put("Speed", 5)
    assert ioc.alarm("Speed") == ("INVALID", "WRITE", "PLC in LOCAL")
    assert ioc.get("Speed") == 100
    sim.command("hmi DB10.4 INT16 -7")
    wait_values(ioc, Speed=-7)
    assert ioc.alarm("Speed") == ("INVALID", "WRITE", "PLC in LOCAL")  # until the next put
    assert ioc.text("Sync:Remote") == "LOCAL" and ioc.severity("Sync") == "NO_ALARM"
    before = memory(sim)
    sim.command("remote")
    wait_synced(sim, ioc)
    wait_heartbeats(sim)
    assert memory(sim) == before
    assert values(ioc) == {**HELD, "Speed": -7}
    ioc.put("Speed", 8)
    until_equal(lambda: speed(sim), 8)


def test_local_is_an_alarm(new_sim, new_ioc):
    """LOCAL is no alarm, unless the macro LSV of s7plcSync.db says so"""
    sim = new_sim(PLC)
    sim.command("local")
    ioc = new_ioc(configure(sim.port), "",
                  templates=[("s7plcSync.db", "P=$(P)A:,PLC=PLC"), ("s7plcSync.db", "P=$(P)B:,PLC=PLC,LSV=MINOR")])
    for name in "A:Sync", "B:Sync":
        until_equal(lambda: ioc.text(name), "LOCAL")  # noqa: B023
    assert [ioc.severity(name) for name in ("A:Sync", "B:Sync")] == ["NO_ALARM", "MINOR"]


def test_hmi(pair_of):
    """a setpoint changed at the HMI in REMOTE is the record's value, and is not undone"""
    sim, ioc = pair_of()
    for turn, value in enumerate((200, 300, 400), 2):
        sim.command(f"hmi DB10.4 INT16 {value}")
        wait_values(ioc, Speed=value)
        wait_syncs(ioc, turn)
        assert speed(sim) == value
    ioc.put("Mode", 9)
    until_equal(lambda: memory(sim), struct.pack(">fhBx8sh2x", 21.5, 400, 4, b"bread", 9))


def test_taken_back(pair_of):
    """what the PLC changes of a put, a start bit taken back or a speed clipped, ends SYNC, and the record follows"""
    sim, ioc = pair_of()
    ioc.put("Pump", 0)
    until_equal(lambda: memory(sim)[6] >> 2 & 1, 0)
    for turn, (name, value, place, back) in enumerate((("Pump", 1, "DB10.DBX6.2", 0), ("Speed", 500, "DB10.4 INT16", 400)), 2):
        ioc.put(name, value)
        until_equal(lambda: values(ioc)[name], value)
        until(lambda: struct.unpack_from(">h", memory(sim), 4)[0] == 500 if turn == 3 else memory(sim)[6] >> 2 & 1)
        sim.command(f"hmi {place} {back}")
        wait_syncs(ioc, turn)
        until_equal(lambda: values(ioc)[name], back)


@pytest.mark.parametrize("moment", ["receive", "check"])
def test_hmi_during_check(pair_of, moment):
    """the HMI wins when it acts at the moment "{moment}" of the PLC's program"""
    sim, ioc = pair_of()
    sim.command("refuse sync")
    wait_state(ioc, "checking")
    sim.command(f"hmi {moment} DB10.4 INT16 55")
    sim.command("refuse sync off")
    wait_values(ioc, Speed=55)
    wait_synced(sim, ioc)
    wait_heartbeats(sim)
    assert speed(sim) == 55


def plc_block(flag, speed):
    return struct.pack(">BBH", flag, 0, 0x1234) + BYTES[:4] + struct.pack(">h", speed) \
        + BYTES[6:] + bytes(8)


def test_one_block(new_peer, new_ioc):
    """a value of the HMI is the record's after one block, and only a check goes out for it"""
    peer = new_peer(32, 24)
    ioc = new_ioc(configure(peer.port, more="s7plcSetOption PLC recvTimeout 60000\n"
                            "s7plcSetOption PLC heartbeat 60000\n"), database())
    peer.wait_connected()
    assert peer.blocks() == []
    peer.send(plc_block(2, 100))
    until_equal(lambda: [block[0] for block in peer.blocks()], [1])
    peer.send(plc_block(3, 100))
    wait_state(ioc, "synced")
    wait_values(ioc)
    peer.send(plc_block(2, 101))
    wait_values(ioc, Speed=101)
    until(lambda: len(peer.blocks()) == 2, "a check")
    check = plc_block(1, 101)[:24]
    assert peer.blocks()[1][:1] + peer.blocks()[1][2:] == check[:1] + check[2:]
    peer.send(plc_block(3, 101))
    wait_syncs(ioc, 2)
    ioc.put("Speed", 102)
    until(lambda: len(peer.blocks()) == 3, "the put")
    assert peer.blocks()[2][0] == 2 and peer.blocks()[2][8:10] == struct.pack(">h", 102)


@pytest.mark.parametrize("cold", ["", "cold"], ids=["warm", "cold"])
def test_plc_restart(pair_of, cold):
    """after a {id} restart of the PLC the IOC has the PLC's values, and puts pass again"""
    sim, ioc = pair_of()
    ioc.put("Speed", 123)
    until_equal(lambda: speed(sim), 123)
    sim.command(f"restart {cold}")
    wait_syncs(ioc, 2)
    value = 100 if cold else 123
    wait_values(ioc, Speed=value)
    wait_heartbeats(sim)
    assert speed(sim) == value
    ioc.put("Speed", 124)
    until_equal(lambda: speed(sim), 124)


@pytest.mark.parametrize("fault", ["close", "reset", "cut 30"])
def test_break(pair_of, fault):
    """a connection that breaks ({fault}) clears SYNC; setpoints and a put since stay the PLC's"""
    sim, ioc = pair_of()
    sim.command("refuse")
    sim.command(fault)
    until_equal(lambda: ioc.get("Connected"), 0)
    until_equal(lambda: flags(sim), "none")
    ioc.put("Speed", 5)
    assert ioc.alarm("Speed") == ("INVALID", "WRITE", "not synchronised: PLC not connected")
    assert ioc.get("Speed") == 100
    sim.command("hmi DB10.4 INT16 77")
    sim.command("refuse off")
    wait_syncs(ioc, 2)
    wait_values(ioc, Speed=77)
    wait_heartbeats(sim)
    assert speed(sim) == 77


def test_silent_plc(pair_of):
    """a PLC that falls silent: puts are refused, and nothing jumps out when it comes back"""
    sim, ioc = pair_of(more="s7plcSetOption PLC recvTimeout 300\n")
    sim.command("unplug")
    wait_state(ioc, "disconnected")
    ioc.put("Speed", 5)
    assert ioc.alarm("Speed")[:2] == ("INVALID", "WRITE")
    sim.command("plug")
    wait_syncs(ioc, 2)
    wait_heartbeats(sim)
    assert memory(sim) == BYTES


def test_watchdog(new_plc, new_ioc):
    """an IOC that stands still: the PLC's watchdog clears SYNC, says so, and all begins anew"""
    sim = new_plc(PLC, "-o", "watchdog=3 s")
    ioc = new_ioc(configure(sim.port), database())
    wait_synced(sim, ioc)
    wait_values(ioc)
    os.kill(ioc.process.pid, signal.SIGSTOP)
    try:
        until_equal(lambda: flags(sim), "none, TIMEOUT")
        until(lambda: any("no block from the IOC for 3 s" in line for line in sim.lines), "log")
        sim.command("hmi DB10.4 INT16 55")
    finally:
        os.kill(ioc.process.pid, signal.SIGCONT)
    until_equal(lambda: flags(sim), "SYNC")
    wait_values(ioc, Speed=55)
    assert speed(sim) == 55


def test_short_watchdog(new_plc, new_ioc):
    """a watchdog of the PLC that is shorter than the heartbeat lets SYNC fall again and again"""
    sim = new_plc(PLC, "-o", "watchdog=200 ms")
    ioc = new_ioc(configure(sim.port), database())
    until(lambda: ioc.get("Sync:Lost") >= 3, "SYNC falls three times")


def test_heartbeat(new_plc, new_ioc):
    """with sync=on blocks go out without being asked for, and carry a counter"""
    sim = new_plc(PLC)
    ioc = new_ioc(configure(sim.port), database())
    wait_synced(sim, ioc)
    wait_heartbeats(sim, 4)
    lines = sim.command("received 4").splitlines()[1:]
    counters = [bytes.fromhex("".join(line.split()[2:]))[1] for line in lines]
    assert counters == [(counters[0] + i) % 256 for i in range(4)]
    times = [float(line.split()[1]) for line in lines]
    assert times[-1] - times[0] > 3 * 0.5 - 0.2  # each 500 ms


def test_layout(new_plc, new_ioc):
    """layouts that differ: nothing is sent, inputs and puts say why; then the right PLC comes"""
    sim = new_plc(PLC)
    ioc = new_ioc(configure(sim.port, layout=0x4321), database())
    line = ioc.wait_log("layout id")
    assert str(0x1234) in line and str(0x4321) in line
    ioc.wait_alarm("Blocks", "INVALID", "COMM", "layout ids of PLC and IOC differ")
    assert ioc.severity("Sync") == "MAJOR"
    ioc.put("Speed", 5)
    assert ioc.alarm("Speed") == ("INVALID", "WRITE", "layout ids of PLC and IOC differ")
    assert sim.command("received").startswith("blocks 0 ")
    assert ioc.log_count("layout id") == 1


def test_layout_unchecked(new_plc, new_ioc):
    """a PLC without a layout id takes any IOC"""
    sim = new_plc(PLC, "-o", "layout=0")
    ioc = new_ioc(configure(sim.port, layout=0x4321), database())
    wait_synced(sim, ioc)


def test_no_readback(new_plc, new_ioc):
    """sync=on without a read-back: a warning per output, and why the PLC does not agree"""
    sim = new_plc(PLC)
    begin = time.monotonic()
    ioc = new_ioc(configure(sim.port, readback=False), database())
    assert ioc.log_count("with sync=on the PLC must show this output, unless it is a command that "
                         "the PLC does not compare") == 5
    ioc.wait_log("sync: the PLC does not agree")
    assert time.monotonic() - begin >= 5
    assert memory(sim) == BYTES


def test_header_offset(new_plc, new_ioc):
    """an output in the header of the handshake is refused with what is allowed"""
    sim = new_plc(PLC)
    ioc = new_ioc(configure(sim.port),
                  'record(longout, "$(P)o") { field(DTYP, "S7plc") field(OUT, "@PLC/3 T=INT8") }')
    ioc.wait_log("bytes 0 to 3 are the header of the sync handshake; allowed: 4 and up")
    assert ioc.alarm("o")[1] == "LINK"


def test_small_blocks(new_ioc):
    """sync=on with blocks that have no room for the header is refused"""
    ioc = new_ioc('s7plcConfigure("PLC", "127.0.0.1", 1, 2, 2, 1, 5000, 20)\n'
                  "s7plcSetOption PLC sync on\n", "", start=True)
    assert "both blocks begin with a header of 4 bytes" in ioc.log


def test_second_ioc(new_plc, new_ioc):
    """a second IOC that takes the connection over begins without SYNC"""
    sim = new_plc(PLC)
    first = new_ioc(configure(sim.port), database())
    wait_synced(sim, first)
    first.put("Speed", 123)
    until_equal(lambda: speed(sim), 123)
    os.kill(first.process.pid, signal.SIGSTOP)
    try:
        second = new_ioc(configure(sim.port), database(),
                         env={**os.environ, "EPICS_CAS_INTF_ADDR_LIST": SECOND_IOC})
        wait_synced(sim, second)
        wait_values(second, Speed=123)
        wait_heartbeats(sim)
        assert speed(sim) == 123
        second.close()
    finally:
        os.kill(first.process.pid, signal.SIGCONT)


def test_pair(new_plc, new_ioc):
    """a redundant pair: a switch-over keeps every setpoint, and puts pass to the new PRIMARY"""
    sim = new_plc(PLC, "-o", "role=pair", "-o", "address=127.0.0.2")
    ioc = new_ioc(f'phoenixplcConfigure("PLC", "127.0.0.2", {sim.port}, 32, 24, 1, 5000, 20, 1)\n'
                  "s7plcSetOption PLC sync on\ns7plcSetOption PLC readback 0\n", database(),
                  program="phoenixIoc")
    wait_syncs(ioc, 1)
    wait_values(ioc)
    for turn in range(1, 5):
        ioc.put("Speed", 100 + turn)
        until_equal(lambda: speed(sim), 100 + turn)
        before = memory(sim)
        sim.command("switchover")
        wait_syncs(ioc, turn + 1)
        assert memory(sim) == before
        assert values(ioc) == {**HELD, "Speed": 100 + turn}
        assert ioc.alarm("Blocks")[0] == "NO_ALARM"


def test_no_ping_pong(pair_of):
    """HMI changes at 10 Hz against puts at 10 Hz end with both sides equal

    PLCLINK_PINGPONG: seconds, 5 by default.
    """
    sim, ioc = pair_of(send_interval=1)
    end = time.monotonic() + float(os.environ.get("PLCLINK_PINGPONG", "5"))
    numbers = iter(range(1, 1 << 30))
    hmi = threading.Event()

    def operator():
        while not hmi.wait(0.1):
            sim.command(f"hmi DB10.4 INT16 {next(numbers) % 30000}")
    thread = threading.Thread(target=operator)
    thread.start()
    puts = accepted = 0
    pause = threading.Event()
    try:
        while time.monotonic() < end:
            pause.wait(random.uniform(0.05, 0.15))
            ioc.put(random.choice(["Speed", "Mode"]), -(next(numbers) % 30000))
            puts += 1
            accepted += ioc.severity("Speed") == "NO_ALARM" == ioc.severity("Mode")
    finally:
        hmi.set()
        thread.join()
    wait_synced(sim, ioc)

    def plc():
        return struct.unpack_from(">h", memory(sim), 4) + struct.unpack_from(">h", memory(sim), 16)
    until(lambda: plc() == (ioc.get("Speed"), ioc.get("Mode")), "both sides equal")
    settled = plc()
    print(f"{puts} puts, {accepted} of them accepted, {ioc.get('Sync:Count')} syncs")
    wait_heartbeats(sim, 4)
    assert plc() == settled == (ioc.get("Speed"), ioc.get("Mode"))

    def passes():
        ioc.put("Speed", -1)
        return ioc.severity("Speed") == "NO_ALARM"
    until(passes, "a put passes")
    until_equal(lambda: plc()[0], -1)


def test_demo():
    """make demo-sync without a terminal ends by itself and says demo ok"""
    run_demo("iocSync", 120)
