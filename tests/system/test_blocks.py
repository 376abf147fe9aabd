"""The bytes themselves: sizes from 1 byte to 64 KiB, both byte orders, what leaves when."""
import os
import random
import re
import struct

import pytest

from waiting import until

SIZES = [1, 2, 3, 7, 64, 1000, 1460, 1461, 4096, 65535, 65536]


@pytest.mark.parametrize("size", SIZES)
def test_sizes(new_peer, new_ioc, size):
    """blocks of {size} bytes arrive byte for byte, in both directions"""
    count = min(size, 32000)  # elements of one record; the last bytes have one of their own
    last = size - count
    peer = new_peer(size, size)
    ioc = new_ioc(peer.configure(recv_timeout=20000), f"""
        record(waveform, "$(P)in") {{ field(DTYP, "S7plc") field(INP, "@PLC/{last}") field(FTVL, "UCHAR") field(NELM, "{count}") field(SCAN, "I/O Intr") }}
        record(longin, "$(P)first") {{ field(DTYP, "S7plc") field(INP, "@PLC/0 T=BYTE") field(SCAN, "I/O Intr") }}
        record(aao, "$(P)out") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{last}") field(FTVL, "UCHAR") field(NELM, "{count}") }}
        """)
    peer.wait_connected()
    data = random.Random(size).randbytes(size)
    assert peer.send(data)
    ioc.wait_value("in", list(data[last:]) if count > 1 else data[0])
    assert ioc.get("first") == data[0]
    other = bytes(b ^ 0xFF for b in data)
    ioc.put("out", list(other[last:]) if count > 1 else other[0])
    wanted = bytes(last) + other[last:]
    assert len(peer.wait_block(wanted)) == size
    assert len(peer.connection.received) == size


VALUES = {"INT8": ("b", -5), "UINT8": ("B", 250), "INT16": ("h", -12345), "UINT16": ("H", 54321),
          "INT32": ("i", -1234567890), "REAL32": ("f", 1.5), "REAL64": ("d", -2.25e-100)}


@pytest.mark.parametrize("big", [1, 0], ids=["most", "least"])
def test_byte_order(new_peer, new_ioc, big):
    """{id} significant byte first: values of every size in both directions"""
    order = ">" if big else "<"
    peer = new_peer(64, 64)
    db, offset, block = "", 0, b""
    for name, (code, value) in VALUES.items():
        record = "ai" if "REAL" in name else "longin"
        output = "ao" if "REAL" in name else "longout"
        db += f"""
        record({record}, "$(P)i{name}") {{ field(DTYP, "S7plc") field(INP, "@PLC/{offset} T={name}") field(SCAN, "I/O Intr") }}
        record({output}, "$(P)o{name}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{offset} T={name}") }}
        """
        block += struct.pack(order + code, value)
        offset = len(block)
    block += bytes(64 - len(block))
    ioc = new_ioc(peer.configure(big=big), db)
    peer.wait_connected()
    peer.send(block)
    for name, (_, value) in VALUES.items():
        ioc.wait_value("i" + name, value)
        ioc.put("o" + name, value)
    peer.wait_block(block)


OUTPUTS = """
record(longout, "$(P)a") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT16") field(VAL, "1") field(PINI, "$(PINI)") }
record(ao, "$(P)b")      { field(DTYP, "S7plc") field(OUT, "@PLC/2 T=REAL32") field(VAL, "2.5") field(PINI, "$(PINI)") }
record(bo, "$(P)c")      { field(DTYP, "S7plc") field(OUT, "@PLC/6 T=WORD B=15") field(VAL, "1") field(PINI, "$(PINI)") }
record(stringout, "$(P)d") { field(DTYP, "S7plc") field(OUT, "@PLC/8 L=8") field(VAL, "hello") field(PINI, "$(PINI)") }
record(longout, "$(P)n") { field(DTYP, "S7plc") field(OUT, "@PLC/16 T=INT16") field(VAL, "99") }
"""
FULL = struct.pack(">hfH8sh", 1, 2.5, 0x8000, b"hello", 0)


def test_pini(new_peer, new_ioc):
    """all PINI outputs leave in one block, before any other"""
    peer = new_peer(0, 18)
    ioc = new_ioc(peer.configure(), OUTPUTS.replace("$(PINI)", "YES"))
    peer.wait_connected()
    blocks = peer.wait_blocks(1)
    assert blocks[0] == FULL
    ioc.put("n", 7)
    peer.wait_block(FULL[:16] + b"\0\x07")
    assert len(peer.blocks()) == 2


def test_no_pini(new_peer, new_ioc):
    """outputs with PINI=NO send nothing, and zeros until they are processed"""
    peer = new_peer(2, 18)
    ioc = new_ioc(peer.configure(send_interval=20, recv_timeout=20000),
                  OUTPUTS.replace("$(PINI)", "NO") + """
        record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0") field(SCAN, "I/O Intr") }
        """)
    peer.wait_connected()
    for number in range(1, 6):  # the station lives, and still sends nothing
        peer.send(struct.pack(">h", number))
        ioc.wait_value("in", number)
    assert not peer.connection.received
    ioc.put("n", 7)
    assert peer.wait_blocks(1)[0] == bytes(16) + b"\0\x07"


def test_late_plc(new_peer, new_ioc):
    """PINI values reach a PLC that is switched on later, in one block"""
    peer = new_peer(0, 18)
    peer.power_off()
    ioc = new_ioc(peer.configure(), OUTPUTS.replace("$(PINI)", "YES"))
    ioc.wait_log("cannot connect")
    peer.power_on()
    peer.wait_connected()
    assert peer.wait_blocks(1)[0] == FULL


def test_shared_word(new_peer, new_ioc):
    """bo, mbbo and mbboDirect change only their own bits of a word that they share"""
    peer = new_peer(0, 2)
    ioc = new_ioc(peer.configure(send_interval=10), """
        record(bo, "$(P)bo") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=WORD B=0") }
        record(mbbo, "$(P)mbbo") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=WORD") field(NOBT, "2") field(SHFT, "4") field(ZRVL, "0") field(ONVL, "1") field(TWVL, "2") field(THVL, "3") }
        record(mbboDirect, "$(P)direct") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=WORD") field(NOBT, "4") field(SHFT, "8") }
        """)
    peer.wait_connected()
    ioc.put("bo", 1)
    peer.wait_block(b"\x00\x01")
    ioc.put("mbbo", 3)
    peer.wait_block(b"\x00\x31")
    ioc.put_direct("direct", 10)
    peer.wait_block(b"\x0a\x31")
    ioc.put("bo", 0)
    peer.wait_block(b"\x0a\x30")


def test_burst_is_one_block(new_peer, new_ioc):
    """outputs that a fan-out chain writes together leave in one block"""
    peer = new_peer(0, 200)
    links = "".join(f"""
        record(longout, "$(P)o{i}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{2 * i}")
            field(DOL, "$(P)source") field(OMSL, "closed_loop") field(FLNK, "$(P)o{i + 1}") }}
        """ for i in range(100))
    ioc = new_ioc(peer.configure(send_interval=1000) + "\ns7plcSetOption PLC holdoff 50", f"""
        record(longout, "$(P)source") {{ field(FLNK, "$(P)o0") }}
        {links}
        record(calc, "$(P)o100") {{}}
        """)
    peer.wait_connected()
    ioc.put("source", 513)
    assert peer.wait_blocks(1)[0] == b"\x02\x01" * 100


def test_heartbeat_by_hand(new_peer, new_ioc):
    """an output with SCAN "I/O Intr" and DOL counts every sendInterval in the PLC"""
    peer = new_peer(0, 2)
    new_ioc(peer.configure(send_interval=50), """
        record(calc, "$(P)count") { field(INPA, "$(P)count") field(CALC, "A+1") }
        record(longout, "$(P)beat") { field(DTYP, "S7plc") field(OUT, "@PLC/0") field(SCAN, "I/O Intr")
            field(DOL, "$(P)count PP") field(OMSL, "closed_loop") }
        """)
    peer.wait_connected()
    numbers = [struct.unpack(">h", block)[0] for block in peer.wait_blocks(10)]
    steps = [b - a for a, b in zip(numbers, numbers[1:])]
    # Under a sanitizer the record may have counted twice between two blocks.
    assert set(steps) <= ({1, 2} if os.environ.get("SANITIZE") else {1}), numbers


def test_every_block_counts(new_peer, new_ioc):
    """I/O Intr inputs process on every block, changed or not, and once on disconnect"""
    peer = new_peer(4, 0)
    ioc = new_ioc(peer.configure(recv_timeout=20000), """
        record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0") field(SCAN, "I/O Intr") field(FLNK, "$(P)n") }
        record(calc, "$(P)n") { field(INPA, "$(P)n") field(CALC, "A+1") }
        """)
    peer.wait_connected()
    peer.send(b"\0\0\0\x01")
    ioc.wait_value("in", 0)  # the upper half: it stays what it is
    ioc.wait_alarm("in", "NO_ALARM")
    count = before = ioc.get("n")
    for _ in range(8):
        peer.send(b"\0\0\0\x01")
        count = until(lambda: ioc.get("n") > count and ioc.get("n"), f"more than {count} passes")
    assert 8 <= count - before <= 10  # the first block may have had its pass late
    peer.power_off()
    until(lambda: ioc.get("n") > count, "a pass on disconnect")
    assert ioc.severity("in") == "INVALID"


def test_newest_of_a_backlog(new_peer, new_ioc):
    """after a pile of blocks in one piece the records have the newest"""
    peer = new_peer(4, 0)
    ioc = new_ioc(peer.configure(recv_timeout=20000), """
        record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") }
        """)
    peer.wait_connected()
    peer.send(b"".join(struct.pack(">i", i) for i in range(1, 50001)))
    ioc.wait_value("in", 50000)
    report = ioc.command("s7plcReport PLC")
    assert "in:  50000 blocks" in report and re.search(r" [1-9]\d* skipped", report), report


def test_out_size_0(new_peer, new_ioc):
    """outSize 0: input goes on, nothing is ever sent, and an output has nowhere to go"""
    peer = new_peer(4, 0)
    ioc = new_ioc(peer.configure(send_interval=10) + "\ns7plcSetOption PLC heartbeat 20", """
        record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") field(SCAN, "I/O Intr") }
        record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT32") field(PINI, "YES") }
        """)
    peer.wait_connected()
    for number in range(1, 20):
        peer.send(struct.pack(">i", number))
        ioc.wait_value("in", number)
    ioc.put("out", 1)
    assert ioc.alarm("out") == ("INVALID", "LINK", "the PLC has no output block")
    assert not peer.connection.received


def test_one_block_per_array(new_peer, new_ioc):
    """an array never mixes two blocks, however fast they come"""
    size = 20000
    peer = new_peer(size, 0)
    ioc = new_ioc(peer.configure(recv_timeout=20000), f"""
        record(waveform, "$(P)in") {{ field(DTYP, "S7plc") field(INP, "@PLC/0") field(FTVL, "UCHAR") field(NELM, "{size}") }}
        """)
    peer.wait_connected()
    tick = iter(range(10 ** 9))
    peer.every(0.0005, lambda: bytes([next(tick) % 251]) * size)
    seen = set()

    def look():
        ioc.process_record("in")
        if ioc.severity("in") == "NO_ALARM":
            values = set(ioc.plain("in"))
            assert len(values) == 1
            seen.update(values)
        return len(seen) > 60
    until(look, lambda: f"{len(seen)} different blocks")


def test_trickle(new_peer, new_ioc):
    """a PLC that sends one byte at a time and never a whole block in time is given up"""
    peer = new_peer(1000, 0)
    ioc = new_ioc(peer.configure(recv_timeout=500), """
        record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0") field(SCAN, "I/O Intr") }
        """)
    peer.wait_connected()
    peer.every(0.05, b"x")
    until(lambda: len(peer.connections) >= 3, "connections given up")
    assert "no block for 0.5 s" in ioc.log
    assert ioc.severity("in") == "INVALID"


@pytest.mark.parametrize("piece", [1, 10, 63])
def test_fragments(new_peer, new_ioc, piece):
    """blocks of 64 bytes that come in pieces of {piece} are blocks, and no wrong size"""
    peer = new_peer(64, 0)
    ioc = new_ioc(peer.configure(recv_timeout=20000), """
        record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/60 T=INT32") field(SCAN, "I/O Intr") }
        """)
    peer.wait_connected()
    stream = b"".join(bytes(60) + struct.pack(">i", i) for i in range(1, 41))
    place = 0

    def next_piece():
        nonlocal place
        data = stream[place:place + piece] if place % 64 + piece <= 64 \
            else stream[place:place - place % 64 + 64]
        place += len(data)
        return data
    peer.every(0.003, next_piece)
    ioc.wait_value("in", 40, limit=60)
    assert len(peer.connections) == 1
    assert "the PLC sends" not in ioc.log
    assert ioc.severity("in") == "NO_ALARM"
