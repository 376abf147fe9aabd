"""Many records, and a PLC that does not answer: nothing in the IOC waits for it."""
import re
import time

import pytest

from waiting import until

COUNT = 10000


def database(count):
    kinds = [
        ('longin', 'field(INP, "@PLC/{offset} T=INT32") field(SCAN, "I/O Intr")'),
        ('ai', 'field(INP, "@PLC/{offset} T=REAL32") field(SCAN, "I/O Intr")'),
        ('bi', 'field(INP, "@PLC/{offset} T=WORD B={bit}") field(SCAN, "I/O Intr")'),
        ('ao', 'field(OUT, "@PLC/{offset} T=INT16")'),
        ('longout', 'field(OUT, "@PLC/{offset} T=INT32") field(PINI, "YES") field(VAL, "{i}")'),
    ]
    lines = []
    for i in range(count):
        kind, fields = kinds[i % len(kinds)]
        fields = fields.format(offset=4 * (i % 10000), bit=i % 16, i=i)
        lines.append(f'record({kind}, "$(P)r{i}") {{ field(DTYP, "S7plc") {fields} }}')
    return "\n".join(lines)


def duration(action):
    begin = time.monotonic()
    action()
    return time.monotonic() - begin


def test_start(new_peer, new_ioc, capsys):
    """10,000 records on one station: the IOC starts in a few seconds, and every record has its value"""
    peer = new_peer(40000, 40000)
    begin = time.monotonic()
    ioc = new_ioc(peer.configure(recv_timeout=20000), database(COUNT))
    seconds = time.monotonic() - begin
    peer.wait_connected()
    peer.send(bytes(range(200)) * 200)
    ioc.wait_alarm("r9995", "NO_ALARM")
    for i in range(0, COUNT, 500):  # longin and bi
        offset = 4 * i % 200
        assert ioc.get(f"r{i}") == int.from_bytes(bytes(range(offset, offset + 4)), "big", signed=True)
    block = peer.wait_blocks(1)[0]
    assert all(int.from_bytes(block[4 * i:4 * i + 4], "big") == i for i in range(4, COUNT, 5))
    with capsys.disabled():
        print(f"\n    [start with {COUNT} records: {seconds:.1f} s] ", end="")
    assert seconds < 30  # s; on an idle machine it is well under 3


@pytest.fixture
def deaf(new_ioc, black_hole):
    """10,000 records on a PLC whose address swallows every packet."""
    ioc = new_ioc(f's7plcConfigure("PLC", "127.0.0.1", {black_hole.port}, 40000, 40000, 1, 2000, 100)',
                  database(COUNT) + """
        record(calc, "$(P)clock") { field(SCAN, ".1 second") field(INPA, "$(P)clock") field(CALC, "A+1") field(FLNK, "$(P)scanned") }
        record(longin, "$(P)scanned") { field(DTYP, "S7plc") field(INP, "@PLC/0") }
        """)
    ioc.wait_log("does not answer")
    return ioc


# A driver that waits for the network does so for 5 s or more.
INSTANT = 3.0


def test_black_hole(deaf):
    """while the PLC swallows every packet: dbior, caget, caput and processing are instant"""
    deaf.get("r0")
    deaf.get("r4")
    deaf.pv("r0.PROC")
    worst = {}
    for _ in range(15):
        for name, action in (("dbior", lambda: deaf.command("dbior s7plc 1")),
                             ("caget", lambda: deaf.get("r0")),
                             ("caput", lambda: deaf.put("r4", 5)),
                             ("processing", lambda: deaf.process_record("r0"))):
            worst[name] = max(worst.get(name, 0), duration(action))
    assert max(worst.values()) < INSTANT, worst
    assert deaf.alarm("r0") == ("INVALID", "COMM", "PLC does not answer")


def test_black_hole_scan(deaf):
    """while the PLC swallows every packet: a scan thread at 0.1 s goes on without a gap"""
    seen, begin, last, gap = deaf.get("clock"), time.monotonic(), time.monotonic(), 0
    goal = seen + 50

    def look():
        nonlocal seen, last, gap
        now, value = time.monotonic(), deaf.get("clock")
        if value != seen:
            gap, last, seen = max(gap, now - last), now, value
        return seen >= goal
    until(look, "50 scans")
    assert gap < INSTANT, f"{gap:.1f} s in {time.monotonic() - begin:.1f} s"


def test_hundred_stations(new_peer, new_ioc):
    """100 stations in one IOC: each has its own values"""
    peers = [new_peer(4, 4) for _ in range(100)]
    lines = "\n".join(peer.configure(name=f"PLC{i}", recv_timeout=60000)
                      for i, peer in enumerate(peers))
    ioc = new_ioc(lines, "".join(f"""
        record(longin, "$(P)in{i}") {{ field(DTYP, "S7plc") field(INP, "@PLC{i}/0 T=INT32") field(SCAN, "I/O Intr") }}
        record(longout, "$(P)out{i}") {{ field(DTYP, "S7plc") field(OUT, "@PLC{i}/0 T=INT32") }}
        """ for i in range(100)))
    for i, peer in enumerate(peers):
        peer.wait_connected()
        peer.send(i.to_bytes(4, "big"))
    for i, peer in enumerate(peers):
        ioc.wait_value(f"in{i}", i)
        ioc.put(f"out{i}", 1000 + i)
        peer.wait_block((1000 + i).to_bytes(4, "big"))
    assert all(len(peer.connections) == 1 for peer in peers)
    threads = [line for line in ioc.command("epicsThreadShowAll").splitlines() if re.match(r" *PLC\d+ ", line)]
    assert len(threads) == 100, threads[:3]
    assert 300 < ioc.descriptors() < 300 + 60  # three each, and those of an IOC


def test_many_descriptors(new_peer, new_ioc):
    """a station works on descriptors above 1023"""
    peer = new_peer(4, 4)
    ioc = new_ioc(peer.configure(), """
        record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") }
        """, wrapper=["sh", "-c", 'ulimit -n 4096 && exec perl -e \'use POSIX; '
                      'POSIX::dup(0) for 1 .. 1100; exec @ARGV\' -- "$@"', "sh"])
    peer.wait_connected()
    peer.send(b"\0\0\0\x09")
    ioc.wait_value("in", 9)
    assert ioc.descriptors() > 1100
