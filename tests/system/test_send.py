"""Sending under duress: slow readers, cuts in the middle, blocks that must stay whole."""
import random
import struct

import pytest

from waiting import until

SIZE = 65536
ARRAY = 30000

# Every write fills the block with one number: a spliced block would show two.
DB = f"""
record(aao, "$(P)a") {{ field(DTYP, "S7plc") field(OUT, "@PLC/0") field(FTVL, "USHORT") field(NELM, "{ARRAY // 2}") }}
record(longout, "$(P)n") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{SIZE - 4} T=INT32") }}
"""


def number_of(block):
    """The number in a block; AssertionError when the block holds two."""
    numbers = set(struct.unpack(f">{ARRAY // 2}H", block[:ARRAY]))
    assert len(numbers) == 1, f"spliced: {sorted(numbers)[:5]}"
    return numbers.pop()


def put(ioc, number):
    ioc.put("a", [number] * (ARRAY // 2))


def test_slow_reader(new_peer, new_ioc):
    """a PLC that reads slowly gets whole blocks, and the last value in the end"""
    peer = new_peer(0, SIZE, receive_buffer=2048)
    ioc = new_ioc(peer.configure(send_interval=1), DB)
    peer.wait_connected()
    peer.bite = 1000
    for number in range(1, 60):
        put(ioc, number)
    peer.wait_block(lambda block: number_of(block) == 59)
    numbers = [number_of(block) for block in peer.blocks()]
    assert numbers == sorted(numbers)
    assert len(peer.connections) == 1


def test_stalled_reader(new_peer, new_ioc):
    """a PLC that does not read for a while delays no put, and then gets the last value"""
    peer = new_peer(0, SIZE, receive_buffer=65536)
    ioc = new_ioc(peer.configure(send_interval=1), DB)
    peer.wait_connected()
    peer.reading.clear()
    for number in range(1, 400):
        put(ioc, number)  # more than any socket buffer holds
    assert ioc.get("a")[0] == 399
    ioc.wait_log("PLC takes blocks slowly: what is put waits for it")
    assert ioc.severity("a") == "NO_ALARM"
    peer.reading.set()
    peer.wait_block(lambda block: number_of(block) == 399)
    for block in peer.blocks():
        number_of(block)


CUTS = [1, 2, 1000, SIZE - 1, SIZE, SIZE + 1] + \
    [random.Random(seed).randrange(SIZE, 20 * SIZE) for seed in range(14)]


def test_cut(new_peer, new_ioc):
    """the connection is cut in the middle of a send, 20 times: blocks stay whole, the last value arrives"""
    peer = new_peer(0, SIZE, receive_buffer=4096)
    ioc = new_ioc(peer.configure(send_interval=1), DB)
    peer.wait_connected()
    number = 0
    for cut in CUTS:
        count = len(peer.connections)
        peer.cut_after = cut
        while peer.cut_after:
            number += 1
            put(ioc, number)
        peer.wait_connected(count + 1)
    number += 1
    put(ioc, number)
    peer.wait_block(lambda block: number_of(block) == number)
    for connection in peer.connections:
        for block in connection.blocks():
            number_of(block)


def test_last_value_after_cut(new_peer, new_ioc):
    """a block that was cut is sent again on the next connection, without a new put"""
    peer = new_peer(0, SIZE, receive_buffer=4096)
    ioc = new_ioc(peer.configure(), DB)
    peer.wait_connected()
    peer.cut_after = 1000
    put(ioc, 7)
    peer.wait_connected(2)
    peer.wait_block(lambda block: number_of(block) == 7)


def test_interval(new_peer, new_ioc):
    """the first write leaves at once; many writes in an interval leave as one block"""
    peer = new_peer(0, 4)
    ioc = new_ioc(peer.configure(send_interval=3000), """
        record(longout, "$(P)n") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT32") }
        """)
    peer.wait_connected()
    ioc.put("n", 1)
    peer.wait_block(b"\0\0\0\x01", limit=2.5)  # at the next interval it would be 3 s
    for number in range(2, 50):
        ioc.put("n", number)
    peer.wait_block(struct.pack(">i", 49))
    assert len(peer.blocks()) <= 3


def test_forced(new_peer, new_ioc):
    """s7plcSend sends the block again, changed or not, however long the interval is"""
    peer = new_peer(0, 4)
    ioc = new_ioc(peer.configure(send_interval=3600000), """
        record(longout, "$(P)n") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT32") }
        """)
    peer.wait_connected()
    ioc.put("n", 1)
    peer.wait_blocks(1)
    ioc.command("s7plcSend PLC")
    assert peer.wait_blocks(2) == [b"\0\0\0\x01"] * 2


@pytest.mark.parametrize("state", ["refused", "silent", "black hole", "no address", "sending",
                                   "stalled", "flooding", "unknown host"])
def test_exit(state, new_peer, new_ioc, black_hole):
    """exit ends the IOC cleanly while the PLC is: {state}"""
    peer = new_peer(8, SIZE, receive_buffer=2048)
    line = peer.configure(recv_timeout=20000, send_interval=1)
    if state == "refused":
        peer.power_off()
    elif state == "black hole":
        line = f's7plcConfigure("PLC", "127.0.0.1", {black_hole.port}, 8, {SIZE}, 1, 2000, 100)'
    elif state == "no address":
        line = f's7plcConfigure("PLC", "", 0, 8, {SIZE}, 1, 2000, 100)'
    elif state == "unknown host":
        line = f's7plcConfigure("PLC", "no-such-host.invalid", 2000, 8, {SIZE}, 1, 2000, 100)'
    ioc = new_ioc(line, DB + """
        record(waveform, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0") field(FTVL, "SHORT") field(NELM, "4") field(SCAN, "I/O Intr") }
        """)
    if state in ("sending", "silent", "stalled", "flooding"):
        peer.wait_connected()
    if state == "stalled":
        peer.reading.clear()
    if state in ("sending", "stalled"):
        for number in range(100):
            put(ioc, number)
    if state == "flooding":
        peer.every(0, bytes(80000))
        until(lambda: ioc.severity("in") == "NO_ALARM", "blocks")
    assert ioc.exit(limit=20) == 0


def edges_of(peer, bit):
    """The values of a bit that the PLC saw, each change once."""
    seen = [block[0] >> bit & 1 for block in peer.blocks()]
    return [b for a, b in zip([None] + seen, seen) if a != b]


@pytest.mark.parametrize("kind", ["bo", "mbbo", "mbboDirect"])
def test_pulses(new_peer, new_ioc, kind):
    """bits that are set and cleared again before a block can leave are seen as set, then as cleared"""
    field = {"bo": "VAL", "mbbo": "VAL", "mbboDirect": "B0"}[kind]
    link = "B=0" if kind == "bo" else ""
    peer = new_peer(0, 2)
    ioc = new_ioc(peer.configure(send_interval=150), f"""
        record({kind}, "$(P)bit") {{ field(DTYP, "S7plc") field(OUT, "@PLC/0 T=BYTE {link}") {'' if link else 'field(NOBT, "1")'} }}
        record(longout, "$(P)n") {{ field(DTYP, "S7plc") field(OUT, "@PLC/1 T=UINT8") }}
        record(longin, "$(P)waiting") {{ field(DTYP, "S7plc stats") field(INP, "@PLC/putsWaiting") field(SCAN, ".1 second") }}
        """)
    peer.wait_connected()
    ioc.put("n", 1)
    peer.wait_block(lambda block: block[1] == 1)
    for value in [1, 0] * 5:
        ioc.put(f"bit.{field}", value)
    ioc.put("n", 2)
    until(lambda: ioc.plain("waiting") > 0, "puts that wait")
    peer.wait_block(lambda block: block[1] == 2)
    until(lambda: edges_of(peer, 0)[-1] == 0 and len(edges_of(peer, 0)) >= 11, lambda: str(edges_of(peer, 0)))
    assert edges_of(peer, 0) == [0] + [1, 0] * 5
    # the number did not wait for the bits
    assert next(block for block in peer.blocks() if block[1] == 2)[0] == 1
    ioc.wait_value("waiting", 0)


def test_pulse_while_away(new_peer, new_ioc):
    """what was put while the PLC was away leaves once; what waits when it goes leaves with its last value"""
    peer = new_peer(0, 2)
    ioc = new_ioc(peer.configure(send_interval=500), """
        record(bo, "$(P)bit") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=BYTE B=0") }
        record(longout, "$(P)n") { field(DTYP, "S7plc") field(OUT, "@PLC/1 T=UINT8") }
        """)
    peer.wait_connected()
    ioc.put("n", 1)
    peer.wait_block(lambda block: block[1] == 1)
    for value in [1, 0, 1, 0, 1]:
        ioc.put("bit", value)
    peer.power_off()
    ioc.wait_alarm("bit", "INVALID", "COMM", ask=True)
    for value in [0, 1, 0, 1]:
        ioc.put("bit", value)
    ioc.put("n", 2)
    before = len(peer.connections)
    peer.power_on()
    peer.wait_connected(before + 1)
    peer.wait_block(lambda block: block[1] == 2)
    ioc.put("n", 3)
    peer.wait_block(lambda block: block[1] == 3)
    assert [block[0] for block in peer.connections[-1].blocks()] == [1] * len(peer.connections[-1].blocks())
