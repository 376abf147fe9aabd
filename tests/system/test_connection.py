"""Connect, loss and return of the PLC, alarms, and the records of the connection itself."""
import os
import struct
import subprocess
from pathlib import Path

import pytest

from client import ARCH, epics_base
from peer import Peer
from waiting import until

DB = """
record(longin, "$(P)in")   { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") }
record(ai, "$(P)real")     { field(DTYP, "S7plc") field(INP, "@PLC/4 T=REAL32") field(SCAN, "I/O Intr") }
record(waveform, "$(P)wf") { field(DTYP, "S7plc") field(INP, "@PLC/0") field(FTVL, "SHORT") field(NELM, "4") field(SCAN, "I/O Intr") }
record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT32") }
record(bi, "$(P)stat")     { field(DTYP, "S7plc stat") field(INP, "@PLC") field(SCAN, "I/O Intr") field(ZNAM, "off") field(ONAM, "on") }
record(stringout, "$(P)addr") { field(DTYP, "S7plc addr") field(OUT, "@PLC") }
"""


def block(number, real=1.5):
    return struct.pack(">if", number, real)


@pytest.fixture
def pair(new_peer, new_ioc):
    """A PLC that listens and an IOC; no block yet."""
    peer = new_peer(8, 4)
    ioc = new_ioc(peer.configure(), DB)
    peer.wait_connected()
    return peer, ioc


def test_values(pair):
    """the IOC connects to the PLC and records show its values"""
    peer, ioc = pair
    peer.send(block(42, 2.5))
    ioc.wait_value("in", 42)
    assert ioc.get("real") == 2.5
    assert ioc.plain("wf") == [0, 42, 0x4020, 0]
    assert ioc.alarm("in") == ("NO_ALARM", "NO_ALARM", "")
    assert ioc.text("stat") == "on"


def test_put(pair):
    """a caput reaches the PLC as one block"""
    peer, ioc = pair
    ioc.put("out", 0x12345678)
    assert peer.wait_block(b"\x12\x34\x56\x78")


def test_no_block_yet(pair):
    """before the first block of a connection records are INVALID and undefined"""
    peer, ioc = pair
    ioc.process_record("in")
    assert ioc.alarm("in") == ("INVALID", "COMM", "connected, waiting for first block")
    assert ioc.get("in.UDF") == 1
    ioc.process_record("stat")
    assert ioc.text("stat") == "on"
    peer.send(block(7))
    ioc.wait_alarm("in", "NO_ALARM")
    assert ioc.get("in.UDF") == 0


COUNTED = DB + """
record(longin, "$(P)first") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") field(FLNK, "$(P)count") }
record(calc, "$(P)count") { field(INPA, "$(P)count") field(CALC, "A+1") }
record(bi, "$(P)seen") { field(DTYP, "S7plc stat") field(INP, "@PLC") field(SCAN, "I/O Intr") field(FLNK, "$(P)times") }
record(calc, "$(P)times") { field(INPA, "$(P)times") field(CALC, "A+1") }
"""


def test_processed_on_blocks_and_loss(new_peer, new_ioc):
    """I/O Intr records process on each block and once on a loss, never before the first block"""
    peer = new_peer(8, 4)
    peer.power_off()
    ioc = new_ioc(peer.configure(recv_timeout=30000), COUNTED)
    ioc.wait_log("cannot connect")
    ioc.wait_value("times", 1)  # "S7plc stat": once, for the PLC is not there
    peer.power_on()
    peer.wait_connected(1)
    ioc.process_record("stat")
    ioc.wait_value("stat", 1)
    assert ioc.get("count") == 0 and ioc.get("times") == 1
    for number in range(1, 4):
        peer.send(block(number))
        ioc.wait_value("count", number)
        ioc.wait_value("times", number + 1)
    assert ioc.get("first") == 3
    peer.hang_up()
    peer.wait_connected(2)
    assert ioc.get("count") == 4
    assert ioc.alarm("first")[2] == "connection closed by PLC"
    ioc.wait_value("times", 5)
    peer.send(block(8))
    ioc.wait_value("count", 5)
    ioc.wait_value("times", 6)


def test_alarm_follows(new_peer, new_ioc):
    """while the PLC stays away the alarm of an I/O Intr record follows the reason, and the record does not process"""
    peer = new_peer(8, 4)
    ioc = new_ioc(peer.configure(recv_timeout=30000), COUNTED)
    peer.wait_connected()
    peer.send(block(1))
    ioc.wait_value("count", 1)
    peer.hang_up()
    peer.wait_connected(2)
    ioc.wait_alarm("first", "INVALID", "COMM", "connection closed by PLC")
    ioc.wait_value("count", 2)
    peer.power_off()
    ioc.wait_alarm("first", "INVALID", "COMM", "connection refused by PLC")
    assert ioc.get("count") == 2


def test_after_reconnect(pair):
    """after a reconnect the old values are INVALID until a block comes"""
    peer, ioc = pair
    peer.send(block(7))
    ioc.wait_value("in", 7)
    peer.hang_up()
    peer.wait_connected(2)
    for record in "in", "wf":
        ioc.wait_alarm(record, "INVALID", "COMM", "closed by PLC")
        ioc.process_record(record)
        ioc.wait_alarm(record, "INVALID", "COMM", "waiting for first block")
    peer.send(block(8))
    ioc.wait_value("in", 8)
    ioc.wait_alarm("wf", "NO_ALARM")


@pytest.mark.parametrize("record", ["in", "real", "wf"])
def test_loss(pair, record):
    """when the PLC goes away, record "{record}" is INVALID with COMM and the reason"""
    peer, ioc = pair
    peer.send(block(7))
    ioc.wait_value("in", 7)
    peer.power_off()
    ioc.wait_alarm(record, "INVALID", "COMM", "by PLC")
    ioc.wait_value("stat", 0)
    until(lambda: ioc.process_record(record) or "refused" in ioc.alarm(record)[2],
          "the newest reason, for who asks")
    assert ioc.severity("stat") == "NO_ALARM"
    peer.power_on()
    peer.wait_connected(2)
    peer.send(block(9))
    ioc.wait_alarm(record, "NO_ALARM")
    ioc.wait_value("stat", 1)


def test_closed_by_plc(pair):
    """the log says once who closed the connection"""
    peer, ioc = pair
    peer.hang_up()
    peer.wait_connected(2)
    ioc.command("")
    assert ioc.log_count("disconnected: connection closed by PLC (127.0.0.1 port ") == 1


def test_another_client(new_peer, new_ioc):
    """a PLC that hangs up at once may have another client: the log asks that, once"""
    peer = new_peer(8, 4)
    ioc = new_ioc(peer.configure(), DB)
    for count in range(1, 4):
        peer.wait_connected(count)
        peer.hang_up()
    ioc.wait_log("is another client connected to it?")
    ioc.command("")
    assert ioc.log_count("is another client connected to it?") == 1


def test_silence(new_peer, new_ioc):
    """a PLC that says nothing for recvTimeout is INVALID, with the time in AMSG"""
    peer = new_peer(8, 4)
    ioc = new_ioc(peer.configure(recv_timeout=1000), DB)
    peer.wait_connected()
    peer.every(0.05, block(7))
    ioc.wait_value("in", 7)
    peer.stop_sending()
    ioc.wait_log("no block for 1.0 s")
    until(lambda: any(c.ended == "fin" for c in peer.connections), "end of the connection")
    ioc.wait_alarm("in", "INVALID", "COMM")


def test_restarts(pair):
    """the PLC is power-cycled 20 times, and the IOC is back each time"""
    peer, ioc = pair
    for number in range(1, 21):
        peer.power_off()
        ioc.wait_value("stat", 0)
        peer.power_on()
        peer.wait_connected(number + 1)
        peer.send(block(number))
        ioc.wait_value("in", number)
        assert ioc.severity("in") == "NO_ALARM"


def test_write_while_away(pair):
    """a value written while the PLC is away is COMM/INVALID, and leaves on reconnect"""
    peer, ioc = pair
    peer.power_off()
    ioc.wait_value("stat", 0)
    ioc.put("out", 5)
    assert ioc.alarm("out")[:2] == ("INVALID", "COMM")
    peer.power_on()
    peer.wait_connected(2)
    peer.wait_block(b"\0\0\0\x05")
    assert len(peer.blocks()) == 1


def test_resend(pair):
    """after a reconnect the PLC gets the current values, once, without a new put"""
    peer, ioc = pair
    ioc.put("out", 5)
    peer.wait_block(b"\0\0\0\x05")
    peer.hang_up()
    peer.wait_connected(2)
    peer.wait_block(b"\0\0\0\x05")
    ioc.put("out", 6)
    peer.wait_block(b"\0\0\0\x06")
    assert len(peer.blocks()) == 2


def test_address_shown(pair):
    """"S7plc addr" shows host and port of s7plcConfigure"""
    peer, ioc = pair
    assert ioc.get("addr") == f"127.0.0.1:{peer.port}"


def test_move(pair, new_peer):
    """a put to "S7plc addr" moves the IOC to another port at once"""
    peer, ioc = pair
    other = new_peer(8, 4)
    ioc.put("addr", f"127.0.0.1:{other.port}")
    other.wait_connected()
    until(lambda: peer.connection.ended == "fin", "end of the old connection")
    other.send(block(11))
    ioc.wait_value("in", 11)
    ioc.put("addr", f"127.0.0.1:{peer.port}")
    peer.wait_connected(2)


def test_bad_move(pair):
    """a wrong address is refused with WRITE/INVALID, and the connection stays"""
    peer, ioc = pair
    ioc.put("addr", "127.0.0.1:99999")
    assert ioc.alarm("addr") == ("INVALID", "WRITE", "port must be 1 to 65535")
    peer.send(block(3))
    ioc.wait_value("in", 3)
    assert len(peer.connections) == 1


def test_move_from_nowhere(new_peer, new_ioc):
    """a PLC configured without an address waits for "S7plc addr" """
    peer = new_peer(8, 4)
    ioc = new_ioc('s7plcConfigure("PLC", "", 0, 8, 4, 1, 1000, 100)', DB)
    ioc.process_record("in")
    ioc.wait_alarm("in", "INVALID", "COMM", "no address configured")
    ioc.put("addr", f"localhost:{peer.port}")
    peer.wait_connected()
    peer.send(block(4))
    ioc.wait_value("in", 4)


def reads_of(ioc, thread):
    """Calls of read() that a thread of the IOC has made: its sockets are not among them, the
    pipe that wakes it is."""
    for task in Path(f"/proc/{ioc.process.pid}/task").iterdir():
        if (task / "comm").read_text().strip() == thread:
            words = (task / "io").read_text().split()
            return int(words[words.index("syscr:") + 1])
    raise AssertionError(f"no thread {thread}")


def test_no_wakes_after_loss(new_peer, new_ioc):
    """after a lost connection a block costs no more than before: nothing wakes the thread"""
    peer = new_peer(8, 4)
    ioc = new_ioc(peer.configure(recv_timeout=60000), DB)
    peer.wait_connected()
    counts = []
    for connection in (1, 2):
        peer.send(block(1))
        ioc.wait_value("in", 1)
        before = reads_of(ioc, "PLC")
        for number in range(2, 52):
            peer.send(block(number))
            ioc.wait_value("in", number)
        counts.append(reads_of(ioc, "PLC") - before)
        if connection == 1:
            peer.hang_up()
            peer.wait_connected(2)
    assert max(counts) < 10, f"{counts} reads for 50 blocks before and after a loss"


SILENT = {
    "blocks": ('s7plcConfigure("PLC", "127.0.0.1", {port}, 4, 4000000, 1, 300, 100)', "@PLC/0 T=INT32"),
    "Modbus": ('modbusplcConfigure PLC, 127.0.0.1, {port}, 1, "", "holding 0 10", 300', "@PLC/0 T=INT16")}


@pytest.mark.parametrize("wire", SILENT)
def test_nothing_comes_late(wire, new_ioc):
    """{wire}: a lost connection is reset: what the PLC has not got, or not looked at, does not come behind newer values"""
    configure, link = SILENT[wire]
    peer = Peer(4, 4000000)
    peer.reading.clear()  # no kernel takes a block of 4 MB
    ioc = new_ioc(configure.format(port=peer.port), f'record(longout, "$(P)o") {{ field(DTYP, "S7plc") field(OUT, "{link}") }}')
    ioc.put("o", 1)
    peer.wait_connected()
    ioc.wait_log("no block" if wire == "blocks" else "no answer")
    count = len(peer.connections)
    peer.wait_connected(count + 2)
    peer.reading.set()
    until(lambda: any(c.ended == "reset" for c in peer.connections), "the end of a connection")


def test_link_changes_while_away(pair):
    """the alarm of what was put while the PLC was away ends with a change of the link"""
    peer, ioc = pair
    peer.power_off()
    ioc.wait_log("disconnected")
    ioc.put("out", 7)
    ioc.wait_alarm("out", "INVALID", "COMM")
    ioc.put("out.OUT", "@PLC/2 T=INT16")
    ioc.wait_alarm("out", "NO_ALARM")
    ioc.put("out", 8)
    ioc.wait_alarm("out", "INVALID", "COMM")
    peer.power_on()
    ioc.wait_alarm("out", "NO_ALARM")
    assert peer.wait_block(b"\0\0\0\x08")


def test_caput_while_away(pair):
    """caput of an output while the PLC is away says that the write failed; the value is kept, and leaves when it is back"""
    peer, ioc = pair
    peer.power_off()
    ioc.wait_log("disconnected")
    done = subprocess.run([epics_base() / "bin" / ARCH / "caput", ioc.P + "out", "7"], capture_output=True, text=True,
                          env=ioc.env)
    assert "Channel write request failed" in done.stdout + done.stderr, done
    ioc.wait_alarm("out", "INVALID", "COMM")
    peer.power_on()
    ioc.wait_alarm("out", "NO_ALARM")
    assert peer.wait_block(b"\0\0\0\x07")


def test_link_changes_in_pulse(new_peer, new_ioc):
    """the link of a bo with HIGH changes during its pulse: the pulse ends at its old place, and nothing is written to the new one"""
    peer = new_peer(8, 4)
    ioc = new_ioc(peer.configure(), 'record(bo, "$(P)pulse") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=BYTE B=0") field(HIGH, "1") }\n'
                                    'record(longout, "$(P)byte") { field(DTYP, "S7plc") field(OUT, "@PLC/1 T=BYTE") }')
    peer.wait_connected()
    ioc.put("byte", 0xFF)
    ioc.put("pulse", 1)
    until(lambda: b"\x01\xff\0\0" in peer.blocks(), "the pulse")
    ioc.put("pulse.OUT", "@PLC/1 T=BYTE B=3")
    assert peer.wait_block(b"\0\xff\0\0")
    until(lambda: ioc.get("pulse") == 0, "the end of the pulse")
    ioc.put("byte", 0xFE)
    assert peer.wait_block(b"\0\xfe\0\0")
    assert b"\0\xf7\0\0" not in peer.blocks()
    assert ioc.alarm("pulse") == ("NO_ALARM", "NO_ALARM", "")
    ioc.put("pulse", 1)
    assert peer.wait_block(b"\0\xf6\0\0")


def test_simulated_while_lost(new_peer, new_ioc):
    """an input with SIMM=YES and I/O Intr does not get the alarm of a PLC that is lost"""
    peer = new_peer(8, 4)
    ioc = new_ioc(peer.configure(), """
record(longin, "$(P)sim") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") field(SIMM, "YES") field(SIMS, "MINOR") field(SVAL, "7") }
record(longin, "$(P)off") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") field(DISA, "1") }
""")  # the second does not process either, and is looked at after the first
    peer.wait_connected()
    peer.send(block(42))
    ioc.wait_alarm("sim", "MINOR")
    peer.power_off()
    ioc.wait_log("cannot connect")
    until(lambda: ioc.message("off") == "connection refused by PLC", "the reason")
    assert ioc.alarm("sim")[0] == "MINOR"


def test_address_of_another_link(new_peer, new_ioc):
    """S7plc addr whose link changes shows the address of the other PLC; after a bad link, too, and without an alarm"""
    first, second = new_peer(8, 4), new_peer(8, 4)
    ioc = new_ioc(first.configure() + "\n" + second.configure(name="Q"), DB)
    shown = [f"127.0.0.1:{peer.port}" for peer in (first, second)]
    assert ioc.text("addr") == shown[0]
    ioc.put("addr.OUT", "@Q")
    assert ioc.text("addr") == shown[1]
    ioc.put("addr.OUT", "@Nowhere")
    ioc.wait_alarm("addr", "INVALID", "LINK")
    ioc.put("addr.OUT", "@PLC")
    ioc.wait_alarm("addr", "NO_ALARM")
    assert ioc.text("addr") == shown[0]
