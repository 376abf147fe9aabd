"""plcSim seen from the other end of the wire, by plain sockets: without it nothing else holds."""
import os
import re
import select
import signal
import socket
import struct
import subprocess
import time
from collections import Counter

import pytest

from client import TOP
from ports import free_port
from sim import PROGRAM
from waiting import LIMIT, until, until_equal

PLAIN = """
in = 32
out = 16
period = 10 ms
signal 0 UINT32 counter
mirror 0 16 -> 16
"""
SYNC = """
in = 16
out = 16
period = 10 ms
sync = on
layout = 0x1234
watchdog = 10 min
db 10 16
init DB10.DBD0 77
tx P#DB10.DBX0.0 DWORD 2 -> 4
rx 4 -> P#DB10.DBX0.0 DWORD 2
"""
PAIR = PLAIN + """
address = 127.0.0.2
db 10 16
"""


class Client:
    """Reads and writes blocks, as an IOC does."""

    def __init__(self, port, host="127.0.0.1", size=32):
        self.size = size
        self.socket = socket.create_connection((host, port), LIMIT)
        self.socket.settimeout(LIMIT)

    def read(self, size=None):
        size = size or self.size
        data = b""
        while len(data) < size:
            piece = self.socket.recv(size - len(data))
            if not piece:
                raise EOFError(f"{len(data)} bytes of {size}")
            data += piece
        return data

    def write(self, data):
        self.socket.sendall(data)

    def quiet(self, seconds):
        return not select.select([self.socket], [], [], seconds)[0]

    def close(self):
        self.socket.close()


@pytest.fixture
def connect(closing):
    def make(*args, **kw):
        client = Client(*args, **kw)
        closing(client)
        return client
    return make


def counter(block):
    return struct.unpack(">I", block[:4])[0]


def status(sim, word, plc=""):
    """The line of `status` that begins with a word."""
    lines = sim.command(f"{plc} status".strip()).splitlines()
    return next(line for line in lines if line.startswith(word))


def read_until(client, condition):
    until(lambda: condition(client.read()), "a block that fits")


def test_mirror(new_sim, connect):
    """What the PLC receives comes back in the next block"""
    sim = new_sim(PLAIN)
    client = connect(sim.port)
    client.write(bytes(range(16)))
    read_until(client, lambda block: block[16:] == bytes(range(16)))
    assert sim.command("received").splitlines()[-1].endswith(bytes(range(16)).hex(" "))


def test_received(new_sim, connect):
    """received: blocks, bytes, those of an unfinished block; then the last n blocks, one by default"""
    sim = new_sim(PLAIN)
    client = connect(sim.port)
    before = time.monotonic()
    client.write(bytes(16) + bytes(range(16)) + b"half a")
    until(lambda: sim.command("received").startswith("blocks 2 bytes 38 partial 6\n"), lambda: sim.command("received"))
    lines = sim.command("received").splitlines()
    number, moment, data = lines[1].split(" ", 2)
    assert len(lines) == 2 and number == "2" and data == bytes(range(16)).hex(" ")
    assert before - 0.001 <= float(moment) <= time.monotonic() + 0.001
    assert [line.split()[0] for line in sim.command("received 5").splitlines()[1:]] == ["1", "2"]


def test_period(new_sim, connect):
    """A block leaves each period: a signal that counts periods goes on by 1 from block to block"""
    sim = new_sim("in = 8\nout = 0\nperiod = 40 ms\nsignal 0 UINT32 counter 40ms\n")
    client = connect(sim.port, size=8)
    numbers = [counter(client.read()) for _ in range(40)]
    steps = Counter(b - a for a, b in zip(numbers, numbers[1:]))  # a busy machine leaves some out
    assert steps.most_common(1)[0][0] == 1, steps


def test_silence(new_sim, connect):
    """silence: the connection stays and nothing is sent; silence off: blocks come on it again"""
    sim = new_sim(PLAIN)
    client = connect(sim.port)
    client.read()
    sim.command("silence")
    sent = status(sim, "sent")
    assert "client: 127.0.0.1:" in sim.command("status")
    until(lambda: client.quiet(0.1) or not client.socket.recv(65536), "quiet")
    assert client.quiet(0.2) and status(sim, "sent") == sent
    sim.command("silence off")
    client.read()
    assert status(sim, "connections") == "connections: 1"


@pytest.mark.parametrize("fault", ["fragment 1", "fragment 5 2", "fragment 31", "delay 30", "flood"])
def test_framing(new_sim, connect, fault):
    """With {fault} no block is lost, doubled or torn"""
    sim = new_sim(PLAIN, "-o", "period=40 ms")
    client = connect(sim.port)
    sim.command(fault)
    blocks = [counter(client.read()) for _ in range(20)]
    assert blocks == list(range(blocks[0], blocks[0] + 20))


def test_pieces(new_sim, connect):
    """fragment 5 3600000: the first 5 bytes, and no more of the block before its time; close ends it in the middle"""
    sim = new_sim(PLAIN, "-e", "fragment 5 3600000")
    client = connect(sim.port)
    assert len(client.read(5)) == 5 and client.quiet(0.2)
    sim.command("close")
    assert client.socket.recv(1) == b""


def test_delay(new_sim, connect):
    """delay 3600000: no block comes before its time"""
    sim = new_sim(PLAIN, "-e", "delay 3600000")
    client = connect(sim.port)
    until(lambda: "client: 127.0.0.1:" in sim.command("status"), "a connection")
    assert client.quiet(0.3)


def stuffed(new_sim, connect, *options):
    """(sim, client, bytes that a stalled PLC has taken)"""
    sim = new_sim(PLAIN, "-e", "stall", *options)
    client = connect(sim.port)
    client.read()
    client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    client.socket.setblocking(False)
    count = 0
    while select.select([], [client.socket], [], 0.3)[1]:
        count += client.socket.send(bytes(1024))
    return sim, client, count


def test_stall(new_sim, connect):
    """stall: nothing is read, and the IOC's send backs up, with rcvbuf earlier; stall off: all is read"""
    sim, client, count = stuffed(new_sim, connect)
    assert status(sim, "received") == "received: 0 blocks, 0 bytes"
    sim.command("stall off")
    until_equal(lambda: status(sim, "received"), f"received: {count // 16} blocks, {count} bytes")
    client.close()
    assert stuffed(new_sim, connect, "-o", "rcvbuf=2048")[2] < count / 2


def test_slow_reader(new_sim, connect):
    """A client that does not read holds up nobody, and then finds whole blocks"""
    sim = new_sim(PLAIN)
    client = connect(sim.port)
    sim.command("flood")

    def stands():
        sent = status(sim, "sent")
        return client.quiet(0) is False and sent == status(sim, "sent")
    until(stands, "the socket is full")
    sim.command("flood off")
    last = counter(client.read())
    for _ in range(2000):
        number = counter(client.read())
        assert number == last + 1
        last = number


def test_truncate(new_sim, connect):
    """truncate 12 sends blocks of 12 bytes, truncate 40 fills up with zeros"""
    sim = new_sim(PLAIN)
    client = connect(sim.port, size=12)
    client.read(32)
    sim.command("silence")
    until(lambda: client.quiet(0) or not client.socket.recv(65536), "quiet")
    sim.command("truncate 12")
    sim.command("silence off")
    first = counter(client.read())
    assert counter(client.read()) == first + 1
    sim.command("silence")
    until(lambda: client.quiet(0) or not client.socket.recv(65536), "quiet")
    sim.command("truncate 40")
    sim.command("silence off")
    first = counter(client.read(40))
    block = client.read(40)
    assert counter(block) == first + 1 and block[32:] == bytes(8)


def test_garbage(new_sim, connect):
    """garbage 7 sends 7 bytes and nothing else"""
    sim = new_sim(PLAIN, "-o", "period=1 h")
    client = connect(sim.port)
    sim.command("garbage 7")
    first = client.read(7)
    assert client.quiet(0.1)
    sim.command("garbage 7")
    assert client.read(7) != first and client.quiet(0.1)


def test_close(new_sim, connect):
    """close ends the connection with FIN"""
    sim = new_sim(PLAIN)
    client = connect(sim.port)
    client.read()
    client.write(b"unread")
    sim.command("close")
    with pytest.raises(EOFError):
        while True:
            client.read()


@pytest.mark.parametrize("fault", ["reset", "restart 0", "cut 1"])
def test_reset(new_sim, connect, fault):
    """{fault} ends the connection with RST"""
    sim = new_sim(PLAIN)
    client = connect(sim.port)
    client.read()
    sim.command(fault)
    with pytest.raises(ConnectionResetError):
        if fault == "cut 1":
            client.write(bytes(16))
        while True:
            client.read()


def test_cut(new_sim, connect):
    """cut 20 takes one block of 16 bytes and 4 bytes more"""
    sim = new_sim(PLAIN)
    client = connect(sim.port)
    sim.command("cut 20")
    client.write(bytes(16) + bytes(16))
    with pytest.raises(ConnectionResetError):
        while True:
            client.read()
    assert sim.command("received").splitlines()[0] == "blocks 1 bytes 20 partial 0"


def test_refuse(new_sim, connect):
    """refuse gives RST to new connections and keeps the one there is"""
    sim = new_sim(PLAIN)
    client = connect(sim.port)
    sim.command("refuse")
    with pytest.raises(ConnectionRefusedError):
        connect(sim.port)
    client.read()
    sim.command("refuse off")
    connect(sim.port).read()


def test_unplug(new_sim, connect):
    """unplug: open connections fall silent, new ones get no answer; plug: all comes back"""
    sim = new_sim(PLAIN)
    client = connect(sim.port)
    client.read()
    sim.command("unplug")
    until(lambda: client.quiet(0.1) or not client.socket.recv(65536), "silence")
    client.write(bytes(16))
    trying = socket.socket()
    trying.setblocking(False)
    trying.connect_ex(("127.0.0.1", sim.port))
    assert not select.select([], [trying], [], 0.3)[1], "no answer to a connect"
    trying.close()
    assert status(sim, "received") == "received: 0 blocks, 0 bytes"
    sim.command("plug")
    until_equal(lambda: status(sim, "received"), "received: 1 blocks, 16 bytes")
    read_until(client, lambda block: True)
    connect(sim.port).read()


def test_unplugged_connect(new_sim, connect):
    """A connect that began while unplugged comes through after plug"""
    sim = new_sim(PLAIN)
    sim.command("unplug")
    trying = socket.socket()
    trying.setblocking(False)
    trying.connect_ex(("127.0.0.1", sim.port))
    sim.command("plug")
    assert select.select([], [trying], [], LIMIT)[1]
    trying.settimeout(LIMIT)
    assert trying.recv(1)
    trying.close()


def test_restart(new_sim, connect):
    """restart clears the send and receive blocks and keeps the others, cold all"""
    sim = new_sim(PLAIN + "db 10 4\ninit DB10.DBW0 5\n")
    client = connect(sim.port)
    client.write(b"x" * 16)
    read_until(client, lambda block: block[16:] == b"x" * 16)
    sim.command("set DB10.DBW0 6")
    sim.command("restart 0")
    until(lambda: status(sim, "state").startswith("state: on"), "the PLC is on")
    assert connect(sim.port).read()[16:] == bytes(16)
    assert sim.command("get DB10.DBW0") == "DB10.DBW0 = 6"
    assert sim.command("dump out").split(":")[1].split() == ["00"] * 16
    sim.command("restart 0 cold")
    assert sim.command("get DB10.DBW0") == "DB10.DBW0 = 5"
    with pytest.raises(AssertionError, match="too many words"):
        sim.command("restart 1 50")  # which of the two: only in a pair


def test_restarttime(new_sim, connect):
    """For so long restart keeps the PLC off: nothing listens"""
    sim = new_sim(PLAIN, "-o", "restarttime=1 h")
    sim.command("restart")
    until(lambda: any("warm restart, off for 3.6e+06 ms" in line for line in sim.lines), lambda: "\n".join(sim.lines))
    assert status(sim, "state").startswith("state: off")
    with pytest.raises(ConnectionRefusedError):
        connect(sim.port)


def test_second_client(new_sim, connect):
    """A second client replaces the first, or is sent away where the file says so"""
    sim = new_sim(PLAIN)
    first = connect(sim.port)
    first.read()
    connect(sim.port).read()
    with pytest.raises(EOFError):
        while True:
            first.read()
    sim = new_sim(PLAIN, "-o", "clients=keep")
    first = connect(sim.port)
    first.read()
    with pytest.raises((EOFError, ConnectionResetError)):
        connect(sim.port).read()
    first.read()


def test_local(new_sim, connect):
    """In LOCAL a block is counted and not taken"""
    sim = new_sim(PLAIN)
    client = connect(sim.port)
    sim.command("local")
    client.write(b"y" * 16)
    until(lambda: sim.command("received").startswith("blocks 1 "), "the block has come")
    client.read()
    assert client.read()[16:] == bytes(16)


def test_freeze(new_sim, connect):
    """freeze heartbeat: blocks go on, the counter stands; freeze all: each signal does"""
    sim = new_sim(PLAIN + "signal 4 UINT32 ramp 0 1e9 1h\n")
    client = connect(sim.port)
    sim.command("freeze heartbeat")
    read_until(client, lambda block: counter(block) == counter(client.read()))
    read_until(client, lambda block: block[4:8] != client.read()[4:8])
    sim.command("freeze all")
    read_until(client, lambda block: block[:8] == client.read()[:8])
    sim.command("unfreeze")
    read_until(client, lambda block: counter(block) != counter(client.read()))


def test_console(new_sim):
    """A console line of any kind gets one answer, and the next line too"""
    sim = new_sim(PLAIN)
    console = socket.socket(socket.AF_UNIX)
    console.connect(str(sim.path))
    console.settimeout(LIMIT)
    answers = console.makefile("rb")
    for line in [b"\x00\xff\x80", b"get", b"get \"", b"x" * 10000, b"set in.0 INT16[99999999] 1",
                 b"garbage -1", b"second status", b"switchover", b"dump DB99", b"period 0"]:
        console.sendall(line + b"\n")
        assert answers.readline().startswith(b"error: "), line
    console.sendall(b"\n# nothing\nget in 16 INT16\n")
    assert answers.readline() == b"in 16 INT16 = 0\n" and answers.readline() == b"ok\n"
    console.close()


def sync_block(flags, first, second=0):
    return struct.pack(">BBHII4x", flags, 0, 0x1234, first, second)


def flags_become(client, wanted):
    return read_until(client, lambda block: block[0] == wanted and block[2:4] == b"\x12\x34")


def test_sync(new_sim, connect):
    """Setpoints pass after a check that was equal, and not before"""
    sim = new_sim(SYNC)
    client = connect(sim.port, size=16)
    client.write(sync_block(2, 1))
    client.write(sync_block(1, 1))
    until(lambda: "checks: 1, 1 failed" in sim.command("status"), "one failed check")
    assert sim.command("get DB10.DBD0") == "DB10.DBD0 = 77"
    report = sim.command("status")
    assert "taken: 0 blocks, 1 ignored" in report and "sync: none" in report
    assert "byte 7 of IE_RX is 0x01, the PLC has 0x4d" in report
    client.write(sync_block(1, 77))
    flags_become(client, 3)
    client.write(sync_block(2, 78, 5))
    until_equal(lambda: sim.command("get DB10.DBD4"), "DB10.DBD4 = 5")
    sim.command("local")
    flags_become(client, 0)
    sim.command("hmi DB10.DBD0 100")
    read_until(client, lambda block: block[4:8] == struct.pack(">I", 100))
    sim.command("remote")
    flags_become(client, 2)
    client.write(sync_block(1, 100, 5))
    flags_become(client, 3)
    assert "sync: SYNC" in sim.command("status") and "taken: 1 blocks, " in sim.command("status")
    assert connect(sim.port, size=16).read()[0] == 2, "a new connection begins without SYNC"


def test_sync_watchdog(new_sim, connect):
    """SYNC falls when the IOC is silent, and TIMEOUT tells it"""
    sim = new_sim(SYNC.replace("10 min", "100 ms"))
    client = connect(sim.port, size=16)
    client.write(sync_block(1, 77))
    read_until(client, lambda block: block[0] == 6)
    assert "watchdogs: 1" in sim.command("status")


def roles(sim):
    return [status(sim, "role", plc).split()[1] for plc in ("first", "second")]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT], ids=lambda number: number.name)
def test_end_of_stdin(tmp_path, number):
    """The end of stdin closes that console, not the simulator; {number} ends it"""
    (tmp_path / "a.plc").write_text("in = 8\nout = 0\nperiod = 10 ms\n")
    sim = subprocess.Popen([PROGRAM, "-p", "0", tmp_path / "a.plc"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        port = int(re.search(r"listening on 127.0.0.1:(\d+)", sim.stdout.readline())[1])
        sim.stdin.write("get in 0 INT16\n")
        sim.stdin.close()
        assert "in 0 INT16 = 0" in iter(lambda: sim.stdout.readline().strip(), "")
        client = Client(port, size=8)
        assert client.read() == bytes(8) and sim.poll() is None
        client.close()
    finally:
        sim.send_signal(number)
        assert sim.wait(LIMIT) == 0


def test_send_watchdog(new_sim, connect):
    """sendwatchdog: a block that does not leave for so long ends the connection; 0: it stays, and blocks are skipped"""
    text = "in = 65536\nout = 0\nperiod = 1 ms\n"
    sim = new_sim(text + "sendwatchdog = 200 ms\n")
    connect(sim.port)
    until(lambda: any("ended: " in line for line in sim.lines), lambda: "\n".join(sim.lines))
    assert sim.process.poll() is None
    sim = new_sim(text + "sendwatchdog = 0\n")
    connect(sim.port)
    until(lambda: int(status(sim, "sent").split()[-2]) > 500, lambda: status(sim, "sent"))  # half a second at least
    assert "client: 127.0.0.1:" in sim.command("status") and status(sim, "connections") == "connections: 1"


def test_block_numbers(new_sim):
    """ie_tx, ie_rx, tx_ptrs, rx_ptrs and map_db: the data blocks have these numbers"""
    sim = new_sim("in = 24\nout = 20\ntx_ptrs = 73\nrx_ptrs = 74\ndb 10 8\ntx P#DB10.DBX0.0 BYTE 8 -> 4\nrx 4 -> P#DB10.DBX0.0 BYTE 8\n")
    assert sim.command("dump DB73").split(":")[1].split()[:6] == "10 02 00 08 00 0a".split()
    assert sim.command("dump DB74").split(":")[1].split()[:6] == "10 02 00 08 00 02".split()
    sim = new_sim("in = 24\nout = 20\nie_tx = 71\nie_rx = 72\nsync = on\nmap = on\nmap_db = 75\n")
    for number in (71, 72, 75, 76, 77):
        assert ":" in sim.command(f"dump DB{number}")
    for number in (1, 2, 20):
        with pytest.raises(AssertionError, match="name of a block"):
            sim.command(f"dump DB{number}")


def test_list_of_pointers(new_sim, connect):
    """The list of pointers has eight spare places, and ends at the first pair whose byte 0 is 0"""
    sim = new_sim("in = 8\nout = 0\nperiod = 10 ms\ndb 10 8\ninit DB10.0 UINT16 1\ninit DB10.2 UINT16 2\n"
                  "tx P#DB10.DBX0.0 BYTE 2 -> 0\n")
    client = connect(sim.port, size=8)
    assert sum(len(line.split(":")[1].split()) for line in sim.command("dump DB3").splitlines()) == 9 * 20
    until(lambda: client.read() == b"\0\1" + bytes(6))
    pair = bytes.fromhex("1002 0002 000a 84000010" + "1002 0002 0001 84000020")  # DB10.DBX2.0 -> DB1.DBX4.0
    for i in range(19, -1, -1):  # the byte that makes it count comes last
        sim.command(f"set DB3.DBB{20 + i} {pair[i]}")
    until(lambda: client.read() == b"\0\1\0\0\0\2\0\0")
    sim.command("set DB3.DBB0 0")
    sim.command("set DB10.DBW2 3")
    assert {client.read()[4:6] for _ in range(20)} == {b"\0\2"}, "behind the end of the list nothing is moved"


def test_bad_pointer(new_sim, connect):
    """A pointer that is spoilt on the console is refused and logged once; the next one is served; mended it works"""
    sim = new_sim("in = 4\nout = 0\nperiod = 10 ms\ndb 10 8\ninit DB10.0 UINT16[2] 1 2\n"
                  "tx P#DB10.DBX0.0 BYTE 2 -> 0\ntx P#DB10.DBX2.0 BYTE 2 -> 2\n")
    client = connect(sim.port, size=4)
    sim.command("set DB3.DBB0 5")
    sim.command("set DB10.0 UINT16[2] 7 8")
    read_until(client, lambda block: block == b"\0\1\0\x08")
    for _ in range(5):
        assert client.read() == b"\0\1\0\x08"
    sim.command("set DB3.DBB0 16")
    read_until(client, lambda block: block == b"\0\7\0\x08")
    sim.command("silence")
    until(lambda: any("> silence" in line for line in sim.lines), lambda: "\n".join(sim.lines))
    assert len([line for line in sim.lines if "W#16#8101" in line]) == 1, "\n".join(sim.lines)


def test_pair(new_sim, connect):
    """Only the PRIMARY sends, and after unplug the BACKUP does, with the same memory"""
    sim = new_sim(PAIR, "-o", "role=pair")
    until_equal(lambda: roles(sim), ["PRIMARY", "BACKUP"])
    first, second = connect(sim.port, "127.0.0.2"), connect(sim.port, "127.0.0.3")
    first.write(b"z" * 16)
    read_until(first, lambda block: block[16:] == b"z" * 16)
    last = counter(first.read())
    assert second.quiet(0.1)
    sim.command("unplug 1")
    block = second.read()
    assert counter(block) >= last and block[16:] == b"z" * 16
    assert roles(sim) == ["BACKUP", "PRIMARY"]
    sim.command("plug 1")
    until(lambda: first.quiet(0.1) or not first.socket.recv(65536), "FIRST is quiet")
    first.write(b"a" * 16)
    until(lambda: "ignored as BACKUP: 1 " in sim.command("first status"), "it came to FIRST")
    assert second.read()[16:] == b"z" * 16


def test_pair_switchover(new_sim, connect):
    """switchover: the new PRIMARY goes on counting where the old one ended"""
    sim = new_sim(PAIR, "-o", "role=pair")
    until_equal(lambda: roles(sim), ["PRIMARY", "BACKUP"])
    assert sim.lines[:2] == [f"plcSim: {name} listening on 127.0.0.{last}:{sim.port}"
                             for name, last in (("FIRST", 2), ("SECOND", 3))]
    first, second = connect(sim.port, "127.0.0.2"), connect(sim.port, "127.0.0.3")
    last = counter(first.read())
    sim.command("switchover")
    assert roles(sim) == ["BACKUP", "PRIMARY"]
    while not first.quiet(0.1):
        last = counter(first.read())
    assert counter(second.read()) == last + 1
    sim.command("silence")
    assert [status(sim, "faults", plc) for plc in ("first", "second")] == ["faults: none", "faults: silence"]


def test_pair_at_once(new_sim, connect):
    """A new PRIMARY sends a block at once; the old one ends its connection where half a block was out"""
    sim = new_sim(PAIR, "-o", "role=pair", "-o", "second=127.0.0.7")
    until_equal(lambda: roles(sim), ["PRIMARY", "BACKUP"])
    sim.command("first fragment 5 3600000")
    first, second = connect(sim.port, "127.0.0.2"), connect(sim.port, "127.0.0.7")
    first.read(5)
    for plc in "first", "second":
        sim.command(f"{plc} period 3600000")
    sim.command("switchover")
    second.read()
    with pytest.raises(ConnectionResetError):
        first.read()


def test_pair_two_primaries(new_sim):
    """twoprimaries: both lead; off: one of them, and both have its memory"""
    sim = new_sim(PAIR, "-o", "role=pair")
    until_equal(lambda: roles(sim), ["PRIMARY", "BACKUP"])
    sim.command("twoprimaries")
    assert roles(sim) == ["PRIMARY", "PRIMARY"]
    sim.command("first set DB10.DBW0 1")
    sim.command("second set DB10.DBW0 2")
    sim.command("twoprimaries off")
    until_equal(lambda: roles(sim), ["PRIMARY", "BACKUP"])
    until_equal(lambda: sim.command("second get DB10.DBW0"), "DB10.DBW0 = 1")


def test_pair_of_processes(new_sim, tmp_path, connect):
    """Two processes make a pair; when FIRST is killed SECOND leads with its memory"""
    fibre = f"fibre={tmp_path / 'fibre'}"
    first = new_sim(PAIR, "-o", "role=first", "-o", fibre)
    second = new_sim(PAIR, "-o", "role=second", "-o", fibre, "-o", "startwait=1 h")
    until_equal(lambda: status(first, "role").split()[1], "PRIMARY")
    first.command("set DB10.DBW0 42")
    until_equal(lambda: second.command("get DB10.DBW0"), "DB10.DBW0 = 42")
    first.process.kill()
    connect(second.port, "127.0.0.3").read()
    assert second.command("get DB10.DBW0") == "DB10.DBW0 = 42"


def test_pair_by_tcp(new_sim):
    """The fibre may be TCP: FIRST listens"""
    fibre = f"fibre=127.0.0.1:{free_port()}"
    first = new_sim(PAIR, "-o", "role=first", "-o", fibre)
    second = new_sim(PAIR, "-o", "role=second", "-o", fibre, "-o", "startwait=1 h")
    first.command("set DB10.DBW0 42")
    until_equal(lambda: second.command("get DB10.DBW0"), "DB10.DBW0 = 42")
    assert [status(sim, "role").split()[1] for sim in (first, second)] == ["PRIMARY", "BACKUP"]


def test_startwait(new_sim, tmp_path):
    """Alone SECOND waits for FIRST for so long, then it leads"""
    start = time.monotonic()
    second = new_sim(PAIR, "-o", "role=second", "-o", f"fibre={tmp_path / 'fibre'}", "-o", "startwait=2 s")
    until_equal(lambda: status(second, "role").split()[1], "PRIMARY")
    assert time.monotonic() - start >= 2


def test_off(tmp_path):
    """Without blocks (port = off) nothing listens for them, and their commands say so"""
    file = tmp_path / "off.plc"
    file.write_text("port = off\nin = 8\nsignal 0 UINT32 counter\nmodbus_port = 0\n")
    done = subprocess.run([str(PROGRAM), "-n", "-s", "0.05", "-e", "silence", "-e", "status",
                           str(file)], capture_output=True, text=True, timeout=LIMIT)
    assert done.returncode == 0 and done.stdout.count("listening on") == 1
    assert "error: this PLC sends no blocks: port in the file switches them on" in done.stdout
    assert "client: none" not in done.stdout and "modbus requests: total=0" in done.stdout


def test_folders():
    """No file of plcSim includes one of a later folder, and no server another one"""
    top = TOP / "plcSim"
    folders = (top / "FOLDERS").read_text().split("=")[1].split()
    place = {file.name: folder for folder in folders for file in (top / folder).glob("*.h")}
    servers = {folder for folder in folders if list((top / folder).glob("*Server.c"))}
    wrong = []
    for folder in folders:
        for file in (top / folder).glob("*.[ch]"):
            for name in re.findall(r'#include "(\w+\.h)"', file.read_text()):
                to = place[name]
                if folders.index(to) > folders.index(folder) or \
                        (to != folder and {to, folder} <= servers):
                    wrong.append(f"{folder}/{file.name} includes {to}/{name}")
    assert servers == {"block", "modbus", "etherip"} and not wrong, wrong


def test_received_limit(new_sim, connect):
    """Of the blocks that were received the last 1000 are kept, 1 MiB of large ones"""
    for size, kept in ((16, 1000), (4096, 256)):
        sim = new_sim(f"in = 16\nout = {size}\nperiod = 10 ms\n")
        client = connect(sim.port, size=16)
        for number in range(kept + 20):
            client.write(number.to_bytes(4, "big") + bytes(size - 4))
        until(lambda: f"received: {kept + 20} blocks" in sim.command("status"),  # noqa: B023
              lambda: sim.command("status"))  # noqa: B023
        lines = sim.command("received 5000").splitlines()[1:]
        assert len(lines) == kept
        assert lines[0].split()[0] == "21" and lines[-1].split()[0] == str(kept + 20)


def test_quiet(new_sim, connect):
    """With -q nothing is printed but where it listens, and errors"""
    sim = new_sim(PLAIN, "-q", "-e", "nonsense")
    connect(sim.port).read()
    sim.command("silence on")
    sim.command("restart cold")
    until(lambda: len(sim.lines) == 3, lambda: "\n".join(sim.lines))
    assert [line for line in sim.lines if " on " not in line] == ['error: "nonsense" is no command; try help'], sim.lines


def test_stamps(new_sim, connect):
    """Each line of the log has a time stamp in front; those for programs have not, and the PLC's name"""
    sim = new_sim(PLAIN, "-o", "name=Press 1")
    connect(sim.port).read()
    sim.command("silence on")
    until(lambda: len(sim.lines) >= 4, lambda: "\n".join(sim.lines))
    listening, console, *log = sim.lines
    assert listening == f"plcSim: Press 1 listening on 127.0.0.1:{sim.port}" and console.startswith("plcSim: console on ")
    assert all(re.match(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d{3} Press 1: ", line) for line in log), log


def test_deaf_stdout(tmp_path, connect, closing):
    """When nobody reads its stdout, it drops lines and goes on"""
    file, path = tmp_path / "deaf.plc", tmp_path / "deaf.sock"
    file.write_text(PLAIN)
    sim = subprocess.Popen([PROGRAM, "-n", "-p", "0", "-c", path, file], stdin=subprocess.DEVNULL,
                           stdout=subprocess.PIPE, text=True)
    closing(sim.stdout)
    try:
        port = int(re.search(r":(\d+)$", sim.stdout.readline())[1])
        with socket.socket(socket.AF_UNIX) as console:
            until(lambda: console.connect_ex(str(path)) == 0, "a console that listens")
            answers = console.makefile("r")
            for _ in range(3000):  # far more than a pipe holds
                console.sendall(b"silence on\nsilence off\n")
                assert answers.readline() == answers.readline() == "ok\n"
            client = connect(port)
            first = struct.unpack_from(">I", client.read())[0]
            assert struct.unpack_from(">I", client.read())[0] == first + 1
            assert os.read(sim.stdout.fileno(), 1 << 16)  # there is room again, for the next line
            console.sendall(b"silence off\n")
            assert answers.readline() == "ok\n"
    finally:
        sim.terminate()
    rest = sim.stdout.read()
    assert sim.wait(LIMIT) == 0
    assert re.search(r"plcSim: \d+ lines dropped here", rest), rest[-500:]
