"""A station as an asyn port: every interface through asyn's own device support, trace,
connection, read-back, refusals. Needs the IOC with asyn (ASYN in configure/RELEASE.local)."""
import struct

import pytest

from client import ARCH, TOP
from waiting import until, until_equal

PROGRAM = "s7plcAsynIoc"
HAVE_INT64 = (TOP / "dbd" / f"{PROGRAM}.dbd").exists() and \
    "asynAiInt64" in (TOP / "dbd" / f"{PROGRAM}.dbd").read_text()

pytestmark = pytest.mark.skipif(
    not (TOP / "bin" / ARCH / PROGRAM).exists(),
    reason="s7plcAsyn is not built: ASYN is not set in configure/RELEASE.local")


@pytest.fixture
def new_asyn(new_ioc):
    """new_asyn(peer or sim, database, options=(...)) makes an IOC with the asyn port A."""
    def make(configure, db, options=(), port='drvAsynS7plcConfigure("A", "PLC")', **kw):
        lines = [configure, *(f"s7plcSetOption PLC {o}" for o in options), port]
        return new_ioc("\n".join(lines), db, program=PROGRAM, **kw)
    return make


def record(rtype, name, dtyp, link, **fields):
    place = "OUT" if rtype in ("ao", "bo", "longout", "int64out", "mbbo", "mbboDirect",
                               "stringout", "lso", "aao") else "INP"
    info = "".join(f' info({k[5:].replace("_", ":")}, "{v}")' for k, v in fields.items()
                   if k.startswith("info_"))
    rest = "".join(f' field({k}, "{v}")' for k, v in fields.items() if not k.startswith("info_"))
    return (f'record({rtype}, "$(P){name}") {{ field(DTYP, "{dtyp}") '
            f'field({place}, "{link}"){rest}{info} }}\n')


# --- inputs: the same place by DTYP "S7plc" and by asyn ----------------------------------------
# name, record type, link text, asyn DTYP, fields for both, asyn only: mask
INPUTS = [
    ("ai16", "ai", "0 T=INT16", "asynInt32", dict()),
    ("ailin", "ai", "0 T=INT16 L=0 H=1000", "asynInt32",
     dict(LINR="LINEAR", EGUL="0", EGUF="10")),
    ("li8", "longin", "2 T=INT8", "asynInt32", dict()),
    ("liu8", "longin", "2 T=UINT8", "asynInt32", dict()),
    ("liu16", "longin", "0 T=WORD", "asynInt32", dict()),
    ("li32", "longin", "4 T=INT32", "asynInt32", dict()),
    ("bit3", "bi", "3 T=BYTE B=3", "asynInt32", dict()),
    ("digital", "bi", "3 T=BYTE B=5", "asynUInt32Digital", dict()),
    ("multi", "mbbi", "3 T=BYTE", "asynUInt32Digital", dict(NOBT="3", SHFT="1")),
    ("direct", "mbbiDirect", "0 T=WORD", "asynUInt32Digital", dict(NOBT="16")),
    ("real32", "ai", "8 T=REAL32", "asynFloat64", dict()),
    ("real64", "ai", "16 T=REAL64", "asynFloat64", dict()),
    ("float16", "ai", "0 T=INT16", "asynFloat64", dict()),
    ("floatu32", "ai", "4 T=UINT32", "asynFloat64", dict()),
    # asyn's strings have the block's time only with a FIFO
    ("string", "stringin", "24 T=STRING L=8", "asynOctetRead", dict(info_asyn_FIFO="2")),
    ("chars", "waveform", "24 T=STRING L=8", "asynInt8ArrayIn", dict(FTVL="CHAR", NELM="8")),
    ("bcd", "waveform", "2 T=TIME", "asynInt8ArrayIn", dict(FTVL="UCHAR", NELM="2")),
    ("array8", "waveform", "0 T=INT8", "asynInt8ArrayIn", dict(FTVL="CHAR", NELM="16")),
    ("array16", "waveform", "0 T=INT16", "asynInt16ArrayIn", dict(FTVL="SHORT", NELM="8")),
    ("array32", "waveform", "0 T=INT32", "asynInt32ArrayIn", dict(FTVL="LONG", NELM="4")),
    ("arrayf", "waveform", "8 T=REAL32", "asynFloat32ArrayIn", dict(FTVL="FLOAT", NELM="2")),
    ("arrayd", "waveform", "16 T=REAL64", "asynFloat64ArrayIn", dict(FTVL="DOUBLE", NELM="1")),
    ("aai16", "aai", "0 T=UINT16", "asynInt16ArrayIn", dict(FTVL="USHORT", NELM="8")),
]
if HAVE_INT64:
    INPUTS += [
        ("li64", "int64in", "16 T=INT64", "asynInt64", dict()),
        ("liu64", "int64in", "4 T=UINT32", "asynInt64", dict()),
        ("array64", "waveform", "0 T=INT64", "asynInt64ArrayIn", dict(FTVL="INT64", NELM="2")),
    ]


def asyn_link(name, link, dtyp, fields):
    """Arrays say their length with L=; digital inputs have a mask in asyn's own place."""
    if dtyp == "asynUInt32Digital":
        shift = int(fields.get("SHFT", 0))
        mask = ((1 << int(fields.get("NOBT", 1))) - 1) << shift
        return f"@asynMask(A,0,{mask:#x}){link}"
    if "Array" in dtyp and "STRING" not in link:
        link += f" L={fields['NELM']}"
    return f"@asyn(A){link}"


def input_records():
    db = ""
    for name, rtype, link, dtyp, fields in INPUTS:
        db += record(rtype, f"s7:{name}", "S7plc", f"@PLC/{link}", SCAN="I/O Intr", TSE="-2",
                     **fields)
        db += record(rtype, f"asyn:{name}", dtyp, asyn_link(name, link, dtyp, fields),
                     SCAN="I/O Intr", TSE="-2", **fields)
    return db


BLOCK = struct.pack(">hBBifxxxxd8s", -1234, 0x95, 0x6A, -70000, 2.5, 1e10, b"plc\0junk")


def pairs_equal(ioc):
    for name, *_ in INPUTS:
        until_equal(lambda: ioc.plain(f"asyn:{name}"), ioc.plain(f"s7:{name}"))


def test_inputs(new_peer, new_asyn):
    """every interface reads what DTYP "S7plc" reads, with the block's time"""
    peer = new_peer(32, 0)
    ioc = new_asyn(peer.configure(recv_timeout=60000), input_records())
    peer.wait_connected()
    peer.send(BLOCK)
    until_equal(lambda: ioc.get("asyn:ai16"), -1234)
    pairs_equal(ioc)
    assert ioc.get("asyn:ailin") == pytest.approx(-12.34)
    assert ioc.get("asyn:bit3") == 1 and ioc.get("asyn:digital") == 1
    assert ioc.get("asyn:string") == "plc"
    assert ioc.get("asyn:floatu32") == 2**32 - 70000
    for name, *_ in INPUTS:
        assert ioc.severity(f"asyn:{name}") == "NO_ALARM", name
        assert ioc.pv(f"asyn:{name}").get_timevars()["timestamp"] == \
            ioc.pv(f"s7:{name}").get_timevars()["timestamp"], name


# --- outputs --------------------------------------------------------------------------------------
OUTPUTS = [  # name, record type, link text, asyn DTYP, fields, value, bytes at its place
    ("ao16", "ao", "0 T=INT16", "asynInt32", dict(), -77, "ffb3"),
    ("aolin", "ao", "2 T=INT16 L=0 H=1000", "asynInt32",
     dict(LINR="LINEAR", EGUL="0", EGUF="10"), 2.5, "00fa"),
    ("lo32", "longout", "4 T=INT32", "asynInt32", dict(), -2, "fffffffe"),
    ("bit", "bo", "8 T=BYTE B=3", "asynInt32", dict(), 1, "08"),
    ("digital", "bo", "9 T=BYTE", "asynUInt32Digital", dict(), 1, "01"),
    ("multi", "mbbo", "10 T=BYTE", "asynUInt32Digital", dict(NOBT="3", SHFT="4", ZRVL="1",
                                                             ONVL="5"), 1, "50"),
    ("direct", "mbboDirect", "12 T=WORD", "asynUInt32Digital", dict(NOBT="16"), 0x8001, "8001"),
    ("real32", "ao", "16 T=REAL32", "asynFloat64", dict(), 1.5, "3fc00000"),
    ("real64", "ao", "24 T=REAL64", "asynFloat64", dict(), -1.5, "bff8000000000000"),
    ("round", "ao", "32 T=INT16 H=100", "asynFloat64", dict(), 99.6, "0064"),
    ("clip", "ao", "34 T=INT16 H=100", "asynFloat64", dict(), 1e6, "0064"),
    ("string", "stringout", "36 T=STRING L=6", "asynOctetWrite", dict(), "hello", "68656c6c6f00"),
    ("array8", "aao", "44", "asynInt8ArrayOut", dict(FTVL="CHAR", NELM="3"), [1, 2, -3], "0102fd"),
    ("array16", "aao", "48", "asynInt16ArrayOut", dict(FTVL="SHORT", NELM="2"), [1, -2],
     "0001fffe"),
    ("array32", "aao", "52", "asynInt32ArrayOut", dict(FTVL="LONG", NELM="2"), [1, -2],
     "00000001fffffffe"),
    ("arrayf", "aao", "60", "asynFloat32ArrayOut", dict(FTVL="FLOAT", NELM="1"), 1.5,
     "3fc00000"),
    ("arrayd", "aao", "64", "asynFloat64ArrayOut", dict(FTVL="DOUBLE", NELM="1"), 1.5,
     "3ff8000000000000"),
]
if HAVE_INT64:
    OUTPUTS += [
        ("lo64", "int64out", "72 T=INT64", "asynInt64", dict(), 1 << 40, "0000010000000000"),
        ("array64", "aao", "80", "asynInt64ArrayOut", dict(FTVL="INT64", NELM="1"), -2,
         "fffffffffffffffe"),
    ]


def output_records(suffix="", **more):
    db = ""
    for name, rtype, link, dtyp, fields, *_ in OUTPUTS:
        text = asyn_link(name, f"out {link}", dtyp, fields)
        db += record(rtype, name + suffix, dtyp, text, **fields, **more)
    return db


def test_outputs(new_peer, new_asyn):
    """every interface writes its bytes and no others"""
    peer = new_peer(16, 96)
    ioc = new_asyn(peer.configure(recv_timeout=60000, send_interval=20), output_records())
    peer.wait_connected()
    peer.send(bytes(16))
    wanted = bytearray(96)
    until(lambda: "connected" in ioc.command("asynReport 0 A"), "connected")
    for name, _, link, _, _, value, held in OUTPUTS:
        ioc.put(name, value)
        assert ioc.severity(name) == "NO_ALARM", (name, ioc.alarm(name))
        offset = int(link.split()[0])
        wanted[offset:offset + len(held) // 2] = bytes.fromhex(held)
        peer.wait_block(bytes(wanted))


def test_too_large(new_peer, new_asyn):
    """a value that does not fit its type is refused, and nothing is written"""
    peer = new_peer(16, 16)
    ioc = new_asyn(peer.configure(recv_timeout=60000, send_interval=20),
                   record("longout", "small", "asynInt32", "@asyn(A)out 0 T=INT8")
                   + record("longout", "limited", "asynInt32", "@asyn(A)out 1 T=INT8 L=-5 H=5")
                   + record("ao", "nan", "asynFloat64", "@asyn(A)out 2 T=INT16"))
    peer.wait_connected()
    ioc.put("small", 300)
    assert ioc.alarm("small")[:2] == ("INVALID", "WRITE")
    ioc.put("nan", float("nan"))
    assert ioc.severity("nan") == "INVALID"
    ioc.put("limited", 300)
    assert ioc.severity("limited") == "NO_ALARM"
    ioc.put("small", 255)
    assert ioc.severity("small") == "NO_ALARM"
    assert peer.wait_block(bytes([255, 5]) + bytes(14))
    assert b"\x2c" not in b"".join(peer.blocks())
