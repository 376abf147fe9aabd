"""Each statistic of blocks over TCP in a known life of one PLC: what docs/statistics.md says that it means."""
import datetime
import re
import struct
import time

import pytest

from client import TOP
from waiting import until, until_equal

SIZE = 16
BAD_CLOCK = b"\xff" * SIZE


def names(*heads):
    """{name: its kind} in the tables of these chapters of docs/statistics.md"""
    text = (TOP / "docs/statistics.md").read_text()
    parts = [text.split(f"### {head}")[1].split("\n## ")[0].split("\n### ")[0] for head in heads]
    return dict(re.findall(r"^\| `(\w+)` \| ([a-z]+[^|]*) \|", "".join(parts), re.M))


NAMES = names("State", "Sizes and times", "Counters", "Measured")
DB = "".join(f'record(lsi, "$(P){name}") {{ field(DTYP, "S7plc stats") field(INP, "@PLC/{name}") field(SIZV, "200") }}\n'
             for name in NAMES) + """
record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/8 T=INT16") }
record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/8 T=INT16") field(SCAN, "I/O Intr") }
"""


class Statistics:
    def __init__(self, ioc):
        self.ioc = ioc

    def text(self, name):
        """Its value now, as the record has it that shows every kind."""
        self.ioc.put(f"{name}.PROC", 1)
        return bytes(self.ioc.get(f"{name}.VAL$")).partition(b"\0")[0].decode()

    def __getitem__(self, name):
        return float(self.text(name)) if "number" in NAMES[name] else self.text(name)

    def are(self, **wanted):
        for name, value in wanted.items():
            until_equal(lambda n=name: self[n], value)

    def time(self, name):
        """A time as text, about that of this machine."""
        stamp = datetime.datetime.strptime(self[name], "%Y-%m-%d %H:%M:%S.%f")
        assert abs(stamp - datetime.datetime.now()) < datetime.timedelta(hours=1), stamp
        return stamp


def clock(ahead):
    """A block whose first 8 bytes are DATE_AND_TIME, so many seconds ahead of UTC."""
    now = datetime.datetime.now(datetime.timezone.utc) + datetime.timedelta(seconds=ahead)
    digits = now.strftime("%y%m%d%H%M%S") + f"{now.microsecond // 1000:03d}"
    return bytes.fromhex(digits + str(now.isoweekday() % 7 + 1)).ljust(SIZE, b"\0")


@pytest.fixture
def plc(new_peer, new_ioc):
    peer = new_peer(SIZE, 10)
    return peer, Statistics(new_ioc(peer.configure(send_interval=10) + "\ns7plcSetOption PLC, timestamp, 0", DB))


def test_connected(plc):
    """before the first block and after it: state, sizes, times, counters, address"""
    peer, now = plc
    peer.wait_connected()
    address = f"127.0.0.1:{peer.port}"
    now.are(connected=1, alive=0, state=2, stateText="waiting for data", reason="connected, waiting for first block",
            name="PLC", address=address, addressFirst=address, addressSecond="", inSize=SIZE, outSize=10,
            setpoints=7, options="recvTimeout=30000 sendInterval=10 timestamp=0,DT", connects=1, reconnects=0,
            connectErrors=0, blocksIn=0, bytesIn=0, blockAge=0, heartbeatAge=0, blocksOut=0, bytesOut=0, lostTime="",
            lastError="", lastErrorTime="", burstSize=0, blockTime="")
    now.time("connectTime")
    until(lambda: now["connectedFor"] > 0)
    until(lambda: now["stateTime"] > 0.1)
    begin = time.monotonic()
    peer.send(clock(1000))
    now.are(alive=1, state=3, stateText="ok", reason="", blocksIn=1, bytesIn=SIZE, periodMax=0, setpoints=1)
    assert now["stateTime"] < time.monotonic() - begin + 0.01 < now["connectedFor"]  # it began anew
    assert 900 < now["clockOffset"] < 1100
    assert now["blockAge"] >= 0 and now["clockErrors"] == 0
    assert now.time("blockTime") > now.time("connectTime") + datetime.timedelta(seconds=900)  # the PLC's clock
    peer.send(BAD_CLOCK)
    now.are(blocksIn=2, bytesIn=2 * SIZE, clockErrors=1)


def test_periods(plc):
    """periods of blocks, their mean and jitter, and how long I/O Intr took"""
    peer, now = plc
    peer.wait_connected()
    for n in range(1, 5):
        peer.send(clock(0))
        now.are(blocksIn=n)
    assert 0 < now["periodMin"] <= now["periodMean"] <= now["periodMax"]
    assert now["periodMin"] <= now["period"] <= now["periodMax"]
    assert 0 < now["jitter"] <= now["periodMax"] - now["periodMin"]
    until(lambda: 0 < now["scanLatency"] <= now["scanLatencyMax"])


def test_sent(plc):
    """blocks that leave: how many, how late, and those that nothing has changed in"""
    peer, now = plc
    peer.wait_connected()
    peer.send(clock(0))
    now.are(alive=1)
    now.ioc.put("out", 7)
    peer.wait_block(lambda block: block[8:] == struct.pack(">h", 7))
    now.are(blocksOut=1, bytesOut=10, setpoints=1, heartbeats=0)
    assert 0 < now["sendLatency"] <= now["sendLatencyMax"]
    now.ioc.command("s7plcSetOption PLC holdoff 300")
    now.ioc.put("out", 8)
    peer.wait_block(lambda block: block[8:] == struct.pack(">h", 8))
    until(lambda: now["blocksOut"] == 2)
    assert now["sendLatency"] >= 300  # from the put on
    until(lambda: now["heartbeatAge"] > 0)
    now.ioc.command("s7plcSetOption PLC heartbeat 20")
    until(lambda: now["heartbeats"] >= 3)
    assert now["blocksOut"] > now["heartbeats"] and now["heartbeatAge"] < 30


def test_lost(plc):
    """a connection that ends, attempts that fail, and counters that begin anew"""
    peer, now = plc
    peer.wait_connected()
    peer.send(clock(0))
    now.are(alive=1)
    peer.power_off()
    now.are(connected=0, alive=0, state=1, stateText="connecting", reconnects=1, connectedFor=0)
    until(lambda: now["connectErrors"] >= 2)
    now.are(lastError="connection refused by PLC", reason="connection refused by PLC")
    assert now.time("lostTime") <= now.time("lastErrorTime")
    peer.power_on()
    peer.wait_connected(2)
    peer.send(clock(0))
    now.are(connected=1, alive=1, connects=2, lastError="connection refused by PLC", reason="")
    now.ioc.command("s7plcStatsReset PLC")
    now.are(blocksIn=0, bytesIn=0, connects=0, reconnects=0, connectErrors=0, periodMax=0, scanLatencyMax=0)
    assert now["connectedFor"] > 0 and now.time("lostTime")


SYNC = ["syncState", "syncText", "syncTime", "remote", "syncs", "syncsLost", "layoutPlc", "layoutMismatches", "readbacks"]


def test_sync(new_sim, new_ioc):
    """the handshake: its state, who has control, how often it began and ended, layout ids, read-backs"""
    sim = new_sim("sync = on\nlayout = 7\nin = 16\nout = 16\nperiod = 50 ms\ndb 10 16\ninit DB10.DBD0 5\n"
                  "tx DB10.DBD0 -> in.DBD4\nrx 4 -> DB10.DBD0\n")
    ioc = new_ioc(f'''s7plcConfigure("PLC", "127.0.0.1", {sim.port}, 16, 16, 1, 30000, 20)
        s7plcSetOption PLC sync on
        s7plcSetOption PLC layout 7''', "".join(
        f'record(lsi, "$(P){name}") {{ field(DTYP, "S7plc stats") field(INP, "@PLC/{name}") field(SIZV, "200") }}\n'
        for name in (*SYNC, "setpoints")) + 'record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/4 T=INT32 R=4") }\n')
    now = Statistics(ioc)

    def are(**wanted):
        for name, value in wanted.items():
            until_equal(lambda n=name: now.text(n), str(value))
    are(syncState=3, syncText="synced", remote=1, syncs=1, syncsLost=0, layoutPlc=7, layoutMismatches=0, readbacks=1,
        setpoints=1)
    until(lambda: float(now.text("syncTime")) > 0)
    sim.command("local")
    are(syncState=4, syncText="LOCAL", remote=0, syncs=1, syncsLost=1, setpoints=3)
    sim.command("remote")
    are(syncState=3, syncText="synced", remote=1, syncs=2)
    sim.command("set DB10.DBD0 9")
    are(syncs=3, syncsLost=2, readbacks=2)
    assert ioc.get("out") == 9
    sim.command("refuse sync")
    are(syncState=2, setpoints=2)


@pytest.mark.parametrize("size, option, wanted", [(0, "heartbeat 0", 6), (16, "layout 8", 4)], ids=["no output", "another layout"])
def test_setpoints(new_sim, new_ioc, size, option, wanted):
    """what becomes of puts where there is {id}: setpoints is what the table says"""
    sim = new_sim("sync = on\nlayout = 7\nin = 16\nout = 16\nperiod = 50 ms\n")
    ioc = new_ioc(f's7plcConfigure("PLC", "127.0.0.1", {sim.port}, 16, {size}, 1, 30000, 20)\n' +
                  ("s7plcSetOption PLC sync on\n" if size else "") + f"s7plcSetOption PLC {option}",
                  'record(longin, "$(P)it") { field(DTYP, "S7plc stats") field(INP, "@PLC/setpoints") field(SCAN, "I/O Intr") }')
    ioc.wait_value("it", wanted)
