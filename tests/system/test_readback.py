"""Bumpless outputs: R=, readback= and track: outputs start from the PLC's values."""
import struct
import time

import pytest

from waiting import until_equal

# out block                      shown in the input block at
#  0 INT16 ao, LINEAR            16
#  2 INT16 longout               18
#  4 BYTE  bo (bit 2), mbbo (bits 4..6), mbboDirect (bits 0..1)   20
#  6 REAL32 ao                   22
# 10 STRING 6                    26
# 16 REAL32 calcout              32
# 20 INT64                       36
# 28 INT16[2] aao                44
DB = """
record(ao, "$(P)linear")  { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT16 L=0 H=1000$(R0=)") field(LINR, "LINEAR") field(EGUL, "0") field(EGUF, "10") field(VAL, "9") field(PINI, "$(PINI)") }
record(longout, "$(P)long") { field(DTYP, "S7plc") field(OUT, "@PLC/2$(R2=)") field(VAL, "-5") field(PINI, "$(PINI)") }
record(bo, "$(P)bit")     { field(DTYP, "S7plc") field(OUT, "@PLC/4 T=BYTE B=2$(R4=)") field(VAL, "1") field(PINI, "$(PINI)") }
record(mbbo, "$(P)multi") { field(DTYP, "S7plc") field(OUT, "@PLC/4 T=BYTE$(R4=)") field(NOBT, "3") field(SHFT, "4") field(ZRVL, "1") field(ONVL, "5") field(ONST, "five") field(VAL, "0") field(PINI, "$(PINI)") }
record(mbboDirect, "$(P)direct") { field(DTYP, "S7plc") field(OUT, "@PLC/4 T=BYTE$(R4=)") field(NOBT, "2") field(VAL, "3") field(PINI, "$(PINI)") }
record(ao, "$(P)real")    { field(DTYP, "S7plc") field(OUT, "@PLC/6 T=REAL32$(R6=)") field(ASLO, "2") field(AOFF, "1") field(VAL, "77") field(PINI, "$(PINI)") }
record(stringout, "$(P)text") { field(DTYP, "S7plc") field(OUT, "@PLC/10 L=6$(R10=)") field(VAL, "old") field(PINI, "$(PINI)") }
record(calcout, "$(P)calc") { field(DTYP, "S7plc") field(OUT, "@PLC/16 T=REAL32$(R16=)") field(CALC, "A") field(A, "4") field(PINI, "$(PINI)") }
record(int64out, "$(P)big") { field(DTYP, "S7plc") field(OUT, "@PLC/20 T=INT64$(R20=)") field(VAL, "6") field(PINI, "$(PINI)") }
record(aao, "$(P)array")  { field(DTYP, "S7plc") field(OUT, "@PLC/28$(R28=)") field(FTVL, "SHORT") field(NELM, "2") field(PINI, "$(PINI)") }
"""
PLACES = [0, 2, 4, 6, 10, 16, 20, 28]

# what the PLC holds: 2.5 as 250, 1234, bits 0101 0110, (6.0 - 1) / 2, "plc", 8, 2^40, 3 4
HELD = struct.pack(">hhBxf6sfqhh", 250, 1234, 0x56, 2.5, b"plc\0\0\0", 8.0, 1 << 40, 3, 4)


def held(*, linear=250, long=1234):
    return struct.pack(">hh", linear, long) + HELD[4:]


def database(explicit, pini):
    text = DB.replace("$(PINI)", pini)
    for place in PLACES:
        text = text.replace(f"$(R{place}=)", f" R={place + 16}" if explicit else "")
    return text


def assert_follows(ioc):
    until_equal(lambda: ioc.get("linear"), 2.5)
    until_equal(lambda: ioc.get("long"), 1234)
    until_equal(lambda: ioc.get("bit"), 1)
    until_equal(lambda: ioc.get("multi"), 1)
    until_equal(lambda: ioc.get("direct"), 2)
    until_equal(lambda: ioc.get("real"), 6.0)
    until_equal(lambda: ioc.text("text"), "plc")
    until_equal(lambda: ioc.get("calc.OVAL"), 8.0)
    until_equal(lambda: ioc.get("big"), 1 << 40)
    until_equal(lambda: list(ioc.plain("array")), [3, 4])
    until_equal(lambda: ioc.alarm("long")[0], "NO_ALARM")


@pytest.fixture(params=[(True, "NO"), (True, "YES"), (False, "NO"), (False, "YES")],
                ids=["R=", "R= with PINI", "readback=", "readback= with PINI"])
def bumpless(request, new_peer, new_ioc):
    """A PLC that shows what it holds at byte 16, and an IOC with other values."""
    explicit, pini = request.param
    peer = new_peer(48, 32)
    option = "" if explicit else "\ns7plcSetOption PLC readback 16"
    ioc = new_ioc(peer.configure(recv_timeout=20000, send_interval=50) + option, database(explicit, pini))
    peer.wait_connected()
    return peer, ioc


def test_bumpless(bumpless):
    """with {id} all outputs take the PLC's values, and not one byte of them changes"""
    peer, ioc = bumpless
    # connected, but no block yet: nothing to follow
    for _ in range(20):
        assert ioc.get("long") == -5
    assert peer.blocks() == []
    peer.send(bytes(16) + HELD)
    assert_follows(ioc)
    for block in peer.blocks():
        assert block[:32] == HELD[:32]
    ioc.put("long", -2)
    assert peer.wait_block(held(long=-2))
    assert peer.blocks()[-1] == held(long=-2)


def test_no_track(new_peer, new_ioc):
    """without track the output keeps its own value when the PLC changes its"""
    peer = new_peer(48, 32)
    ioc = new_ioc(peer.configure(recv_timeout=20000, send_interval=50), database(True, "NO"))
    peer.wait_connected()
    peer.send(bytes(16) + HELD)
    assert_follows(ioc)
    peer.send(b"\1" + bytes(15) + held(long=55))
    ioc.put("linear", 1.0)
    assert peer.wait_block(held(linear=100))
    assert ioc.get("long") == 1234


def test_track(new_peer, new_ioc):
    """with track=on outputs follow the PLC, and nothing is sent because of it"""
    peer = new_peer(48, 32)
    ioc = new_ioc(peer.configure(recv_timeout=20000, send_interval=50) + "\ns7plcSetOption PLC track on",
                  database(True, "NO"))
    peer.wait_connected()
    peer.send(bytes(16) + HELD)
    assert_follows(ioc)
    for value in range(100, 120):
        peer.send(bytes(16) + held(long=value))
        until_equal(lambda: ioc.get("long"), value)
    assert peer.blocks() == []
    # a put wins over what the PLC shows until it has arrived, and comes back
    ioc.put("long", 7)
    assert peer.wait_block(held(long=7))
    peer.send(bytes(16) + held(long=119))
    peer.send(bytes(16) + held(long=7))
    # again and again: a busy IOC may skip the block before
    peer.every(0.05, bytes(16) + held(long=8))
    until_equal(lambda: ioc.get("long"), 8)
    assert [block[2:4] for block in peer.blocks()] == [b"\0\7"]


def test_time_of_following(new_peer, new_ioc):
    """an output with TSE=-2 has the time at which it took the PLC's value, at the start and by track=on"""
    peer = new_peer(48, 32)
    ioc = new_ioc(peer.configure(recv_timeout=20000, send_interval=50) + "\ns7plcSetOption PLC track on",
                  database(True, "NO").replace('field(DTYP', 'field(TSE, "-2") field(DTYP'))
    peer.wait_connected()
    for value in (1234, 55):
        began = time.time()
        peer.send(bytes(16) + held(long=value))
        ioc.wait_value("long", value)
        assert ioc.stamp("long") >= began
    assert min(ioc.stamp(name) for name in ("linear", "bit", "multi", "direct", "real", "text", "calc", "big", "array")) > began - 60


def test_rejected_put(new_peer, new_ioc):
    """with track=on a put that the PLC does not take goes back to the PLC's value"""
    peer = new_peer(48, 32)
    ioc = new_ioc(peer.configure(recv_timeout=20000, send_interval=50) + "\ns7plcSetOption PLC track on",
                  database(True, "NO"))
    peer.wait_connected()
    peer.send(bytes(16) + HELD)
    assert_follows(ioc)
    ioc.put("long", 7)
    until_equal(lambda: ioc.get("long"), 7)
    peer.every(0.05, bytes(16) + HELD)
    until_equal(lambda: ioc.get("long"), 1234)


def test_put_too_early(new_peer, new_ioc):
    """a put before the first block says so, and the PLC's value wins"""
    peer = new_peer(48, 32)
    ioc = new_ioc(peer.configure(recv_timeout=20000, send_interval=50), database(True, "NO"))
    peer.wait_connected()
    ioc.put("long", 9)
    assert ioc.alarm("long") == ("INVALID", "COMM", "waiting for the PLC's value")
    assert peer.blocks() == []
    peer.send(bytes(16) + HELD)
    assert_follows(ioc)


def test_put_void(new_peer, new_ioc):
    """a put that the PLC's value replaces at a reconnect says so until the next put; not if it is that value"""
    peer = new_peer(48, 32)
    ioc = new_ioc(peer.configure(recv_timeout=20000, send_interval=50), database(True, "NO"))
    peer.wait_connected()
    peer.send(bytes(16) + HELD)
    assert_follows(ioc)
    ioc.put("long", 7)
    assert peer.wait_block(held(long=7))
    peer.hang_up()  # has it arrived?
    peer.wait_connected()
    ioc.put("linear", 1.0)
    ioc.put("big", 1 << 40)
    assert ioc.alarm("linear") == ioc.alarm("big") == ("INVALID", "COMM", "waiting for the PLC's value")
    peer.send(bytes(16) + HELD)
    ioc.wait_alarm("long", "INVALID", "WRITE", "not confirmed: PLC was away")
    ioc.wait_alarm("linear", "INVALID", "WRITE", "not written: PLC was away")
    ioc.wait_alarm("big", "NO_ALARM")
    assert ioc.get("long") == 1234 and ioc.get("linear") == 2.5
    assert ioc.alarm("real")[0] == "NO_ALARM"
    ioc.put("linear", 2.0)
    assert ioc.alarm("linear")[0] == "NO_ALARM" and ioc.alarm("long")[1] == "WRITE"


def test_contradiction(new_peer, new_ioc):
    """an R= that contradicts readback= is refused with both numbers"""
    peer = new_peer(48, 32)
    ioc = new_ioc(peer.configure(recv_timeout=20000) + "\ns7plcSetOption PLC readback 16",
                  'record(longout, "$(P)o") { field(DTYP, "S7plc") field(OUT, "@PLC/2 R=20") }')
    ioc.wait_log("option readback=16 shows this place at 18")
    assert ioc.alarm("o")[1] == "LINK"


ALARMS = """
record(ao, "$(P)real") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=REAL32 R=8") field(HIGH, "50") field(HSV, "MINOR") field(HIHI, "80") field(HHSV, "MAJOR") }
record(longout, "$(P)long") { field(DTYP, "S7plc") field(OUT, "@PLC/4 R=12") field(LOW, "10") field(LSV, "MAJOR") }
record(bo, "$(P)bit") { field(DTYP, "S7plc") field(OUT, "@PLC/6 T=BYTE B=0 R=14") field(OSV, "MINOR") }
record(mbbo, "$(P)multi") { field(DTYP, "S7plc") field(OUT, "@PLC/7 T=BYTE R=15") field(NOBT, "2") field(ZRVL, "0") field(ONVL, "1") field(TWVL, "2") field(TWSV, "MAJOR") }
"""


def test_alarm_of_value(new_peer, new_ioc):
    """an output that follows has the alarm of the value that it shows, not of the one before"""
    peer = new_peer(16, 8)
    ioc = new_ioc(peer.configure(recv_timeout=20000, send_interval=50) + "\ns7plcSetOption PLC track on", ALARMS)
    peer.wait_connected()

    def show(real, long, bit, multi, *wanted):
        peer.send(bytes(8) + struct.pack(">fhBB", real, long, bit, multi))
        for name, severity in zip(("real", "long", "bit", "multi"), wanted):
            ioc.wait_alarm(name, severity)
        assert ioc.get("real") == real and ioc.get("long") == long
        assert (ioc.get("bit"), ioc.get("multi")) == (bit, multi)
    show(60, 5, 1, 2, "MINOR", "MAJOR", "MINOR", "MAJOR")
    show(20, 15, 0, 1, "NO_ALARM", "NO_ALARM", "NO_ALARM", "NO_ALARM")
    show(90, 9, 1, 2, "MAJOR", "MAJOR", "MINOR", "MAJOR")
    show(10, 10, 0, 0, "NO_ALARM", "MAJOR", "NO_ALARM", "NO_ALARM")


def test_closed_loop(new_peer, new_ioc):
    """with OMSL closed_loop the PLC's value is shown until the record processes; then DOL is written, as a put"""
    peer = new_peer(8, 8)
    ioc = new_ioc(peer.configure(send_interval=10), """
        record(longout, "$(P)loop") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT32 R=0") field(OMSL, "closed_loop") field(DOL, "$(P)source") field(PINI, "YES") }
        record(longout, "$(P)source") { field(VAL, "7") }
        record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/4 T=INT32") field(SCAN, "I/O Intr") }
        """)
    peer.wait_connected()
    peer.send(struct.pack(">ii", 5, 1))
    ioc.wait_value("in", 1)
    ioc.wait_value("loop", 5)
    peer.send(struct.pack(">ii", 5, 2))
    ioc.wait_value("in", 2)
    assert ioc.get("loop") == 5 and all(block == struct.pack(">ii", 5, 0) for block in peer.blocks())
    ioc.put("loop.PROC", 1)
    peer.wait_block(struct.pack(">ii", 7, 0))
    assert ioc.get("loop") == 7


def test_shown_as_read(new_ioc):
    """s7plcShow counts what read-backs read among the bytes of the input block that are in use"""
    ioc = new_ioc('s7plcConfigure("PLC", "", 0, 16, 8, 1, 2000, 100)',
                  'record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT32") }\n'
                  'record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/2 T=INT32 R=8") }\n')
    assert "Bytes that no record reads: 4-7, 12-15 (8 of 16)" in ioc.command("s7plcShow PLC in")
    assert "Bytes that no record writes: 0-1, 6-7 (4 of 8)" in ioc.command("s7plcShow PLC out")
