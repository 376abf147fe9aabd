"""A station as an asyn port: every interface through asyn's own device support, trace,
connection, read-back, refusals. Needs the IOC with asyn (ASYN in configure/RELEASE.local)."""
import os
import random
import re
import struct
import threading

import pytest

from client import ARCH, TOP
from demos import run_demo
from test_documented import table
from waiting import until, until_equal

PROGRAM = "s7plcAsynIoc"
DBD = TOP / "dbd" / f"{PROGRAM}.dbd"
# what this version of asyn has: (record type, DTYP)
DEVICES = set(re.findall(r'device\((\w+),\s*INST_IO,\s*\w+,\s*"(asyn\w+)"\)',
                         DBD.read_text())) if DBD.exists() else set()
HAVE_INT64 = ("int64in", "asynInt64") in DEVICES       # R4-37
HAVE_AAI = ("aai", "asynInt16ArrayIn") in DEVICES      # R4-44

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
    ("s7string", "stringin", "32 T=S7STRING L=6", "asynOctetRead", dict(info_asyn_FIFO="2")),
    *((f"string{order}", "stringin", f"24 T=STRING L=8 W={order}", "asynOctetRead",
       dict(info_asyn_FIFO="2")) for order in ("BADC", "CDAB", "DCBA", "A0", "0A")),
    ("chars", "waveform", "24 T=STRING L=8", "asynInt8ArrayIn", dict(FTVL="CHAR", NELM="8")),
    ("bcd", "waveform", "2 T=TIME", "asynInt8ArrayIn", dict(FTVL="UCHAR", NELM="2")),
    ("array8", "waveform", "0 T=INT8", "asynInt8ArrayIn", dict(FTVL="CHAR", NELM="16")),
    ("array16", "waveform", "0 T=INT16", "asynInt16ArrayIn", dict(FTVL="SHORT", NELM="8")),
    ("array32", "waveform", "0 T=INT32", "asynInt32ArrayIn", dict(FTVL="LONG", NELM="4")),
    ("arrayf", "waveform", "8 T=REAL32", "asynFloat32ArrayIn", dict(FTVL="FLOAT", NELM="2")),
    ("arrayd", "waveform", "16 T=REAL64", "asynFloat64ArrayIn", dict(FTVL="DOUBLE", NELM="1")),
    ("aai16", "aai", "0 T=UINT16", "asynInt16ArrayIn", dict(FTVL="USHORT", NELM="8")),
]
INPUTS = [row for row in INPUTS if (row[1], row[3]) in DEVICES]
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


BLOCK = struct.pack(">hBBifxxxxd8s8s", -1234, 0x95, 0x6A, -70000, 2.5, 1e10, b"plc\0junk",
                    b"\x06\x02S7junk")


def pairs_equal(ioc):
    for name, *_ in INPUTS:
        until_equal(lambda: ioc.plain(f"asyn:{name}"), ioc.plain(f"s7:{name}"))


def test_inputs(new_peer, new_asyn):
    """every interface reads what DTYP "S7plc" reads, with the block's time"""
    peer = new_peer(40, 0)
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
    ("bit5", "bo", "8 T=BYTE B=5", "asynInt32", dict(), 1, "28"),
    ("digital", "bo", "9 T=BYTE", "asynUInt32Digital", dict(), 1, "01"),
    ("digital2", "mbbo", "9 T=BYTE", "asynUInt32Digital", dict(NOBT="2", SHFT="5", ONVL="2"), 1, "41"),
    ("multi", "mbbo", "10 T=BYTE", "asynUInt32Digital", dict(NOBT="3", SHFT="4", ZRVL="1",
                                                             ONVL="5"), 1, "50"),
    ("direct", "mbboDirect", "12 T=WORD", "asynUInt32Digital", dict(NOBT="16"), 0x8001, "8001"),
    ("real32", "ao", "16 T=REAL32", "asynFloat64", dict(), 1.5, "3fc00000"),
    ("real64", "ao", "24 T=REAL64", "asynFloat64", dict(), -1.5, "bff8000000000000"),
    ("round", "ao", "32 T=INT16 H=100", "asynFloat64", dict(), 99.6, "0064"),
    ("clip", "ao", "34 T=INT16 H=100", "asynFloat64", dict(), 1e6, "0064"),
    ("string", "stringout", "36 T=STRING L=6", "asynOctetWrite", dict(), "hello", "68656c6c6f00"),
    ("stringBADC", "stringout", "104 T=STRING L=6 W=BADC", "asynOctetWrite", dict(), "hello",
     "65686c6c006f"),
    ("stringDCBA", "stringout", "112 T=STRING L=8 W=DCBA", "asynOctetWrite", dict(), "hello",
     "6c6c65680000006f"),
    ("stringA0", "stringout", "120 T=STRING L=6 W=A0", "asynOctetWrite", dict(), "abc",
     "610062006300"),
    ("s7string", "stringout", "88 T=S7STRING L=6", "asynOctetWrite", dict(), "bread",
     "0605627265616400"),
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
OUTPUTS = [row for row in OUTPUTS if (row[1], row[3]) in DEVICES]
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
    peer = new_peer(16, 128)
    ioc = new_asyn(peer.configure(recv_timeout=60000, send_interval=20), output_records())
    peer.wait_connected()
    peer.send(bytes(16))
    wanted = bytearray(128)
    until(lambda: "connected" in ioc.command("asynReport 0 A"), "connected")
    for name, _, link, _, _, value, held in OUTPUTS:
        ioc.put(name, value)
        assert ioc.severity(name) == "NO_ALARM", (name, ioc.alarm(name))
        offset = int(link.split()[0])
        wanted[offset:offset + len(held) // 2] = bytes.fromhex(held)
        peer.wait_block(bytes(wanted))
    ioc.put("string", "too long a text")
    wanted[36:42] = b"too lo"
    peer.wait_block(bytes(wanted))


def test_too_large(new_peer, new_asyn):
    """a value that does not fit its type is refused, and nothing is written"""
    peer = new_peer(16, 16)
    ioc = new_asyn(peer.configure(recv_timeout=60000, send_interval=20),
                   record("longout", "small", "asynInt32", "@asyn(A)out 0 T=INT8")
                   + record("longout", "limited", "asynInt32", "@asyn(A)out 1 T=INT8 L=-5 H=5")
                   + record("longout", "open", "asynInt32", "@asyn(A)out 4 T=INT16")
                   + record("stringout", "text", "asynOctetWrite", "@asyn(A)out 8 T=STRING")
                   + (record("stringout", "called", "asynOctetWrite", "@asyn(A)out 8 T=STRING", **RB) if HAVE_AAI else "")
                   + record("ao", "nan", "asynFloat64", "@asyn(A)out 2 T=INT16"))
    peer.wait_connected()
    ioc.put("small", 300)
    assert ioc.alarm("small")[:2] == ("INVALID", "WRITE")
    ioc.put("nan", float("nan"))
    assert ioc.severity("nan") == "INVALID"
    ioc.put("text", "abc")
    assert ioc.alarm("text")[:2] == ("INVALID", "WRITE")
    ioc.wait_log("L= (length) is needed to write a string")
    assert "L= (length) is needed for callbacks" in ioc.log or not HAVE_AAI
    for value, good in (-32769, False), (65536, False), (65535, True), (-32768, True):
        ioc.put("open", value)
        assert (ioc.severity("open") == "NO_ALARM") is good, value
    ioc.put("open", 0)
    ioc.put("limited", 300)
    assert ioc.severity("limited") == "NO_ALARM"
    ioc.put("small", 255)
    assert ioc.severity("small") == "NO_ALARM"
    assert peer.wait_block(bytes([255, 5]) + bytes(14))
    assert b"\x2c" not in b"".join(peer.blocks())


# --- drvInfo ---------------------------------------------------------------------------------------
BAD = [  # what is wrong, drvInfo, record type, DTYP, the message
    ("no type of this name", "0 T=INT99", "ai", "asynInt32",
     "T=INT99 is no data type; allowed: INT8 UINT8 INT16"),
    ("no offset", "out", "ao", "asynInt32", "no offset; allowed: [in|out] offset T=type"),
    ("an offset that is none", "inn 0", "ai", "asynInt32",
     'offset "inn" is no number; allowed: such as 20 or 20+2'),
    ("an unknown option", "0 T=INT16 X=3", "ai", "asynInt32",
     'unknown option "X=3"; allowed: T= L= H= B= R='),
    ("beyond the input block", "15 T=INT16", "ai", "asynInt32",
     "15 + 2 bytes exceed the input block; inSize is 16"),
    ("beyond the output block", "out 16 T=BYTE", "ao", "asynInt32",
     "16 + 1 bytes exceed the output block; outSize is 16"),
    ("a read-back of an input", "0 T=INT16 R=4", "ai", "asynInt32",
     "R= (read-back) is for outputs only; allowed: out offset T=type R="),
    ("a read-back beyond the block", "out 0 T=INT32 R=14", "ao", "asynInt32",
     "14 + 4 bytes exceed the input block; inSize is 16"),
    ("a bit too high", "0 T=BYTE B=8", "bi", "asynInt32", "B=8: UINT8 has bits 0 to 7"),
    ("a bit of a float", "0 T=REAL32 B=1", "bi", "asynInt32",
     "B= is for whole numbers only, not REAL32"),
    ("a type that the interface has not", "0 T=REAL32", "longin", "asynInt32",
     "T=REAL32 does not fit asynInt32; allowed: INT8 UINT8 INT16 UINT16 INT32 UINT32"),
    ("a type too wide", "0 T=INT64", "longin", "asynInt32",
     "T=INT64 does not fit asynInt32; allowed: INT8 UINT8 INT16 UINT16 INT32 UINT32"),
    ("a number as a string", "0 T=INT16", "stringin", "asynOctetRead",
     "T=INT16 does not fit asynOctet; allowed: STRING S7STRING"),
    ("an S7STRING that is too long", "0 T=S7STRING L=255", "stringin", "asynOctetRead",
     "L=255: an S7STRING has 1 to 254 characters"),
    ("an S7STRING without L= beyond the block", "8 T=S7STRING", "stringin", "asynOctetRead",
     "8 + 256 bytes exceed the input block; inSize is 16"),
    ("an S7STRING beyond the block", "0 T=S7STRING L=15", "stringin", "asynOctetRead",
     "0 + 17 bytes exceed the input block; inSize is 16"),
    ("half a register", "0 T=STRING L=5 W=BADC", "stringin", "asynOctetRead",
     "L=5: in this order a text has a multiple of 2 bytes; allowed: such as L=6"),
    ("a string without characters", "0 T=STRING L=0", "stringin", "asynOctetRead",
     "L=0; allowed for asynOctet: 1 element or more"),
    ("an array without room for one element", "15", "waveform", "asynInt16ArrayIn",
     "15 + 2 bytes exceed the input block; inSize is 16"),
    ("an array too long", "0 T=INT16 L=9", "waveform", "asynInt16ArrayIn",
     "bytes exceed the input block; inSize is 16"),
    ("elements of another size", "0 T=INT32", "waveform", "asynInt16ArrayIn",
     "T=INT32 does not fit asynInt16Array; allowed: INT8 UINT8 INT16 UINT16"),
    ("smaller elements", "0 T=INT8", "waveform", "asynInt16ArrayIn",
     "T=INT8 does not fit asynInt16Array; allowed: types of 2 bytes"),
    ("limits the wrong way round", "0 T=INT16 L=5 H=4", "ai", "asynInt32",
     "L=5 H=4: L must be less than H"),
    ("one bit of an array", "0 T=INT16 B=4", "waveform", "asynInt16ArrayIn",
     "B= (one bit) does not fit asynInt16Array"),
    ("a read-back of unknown length", "out 0 T=INT16 R=0", "aao", "asynInt16ArrayOut",
     "R= needs the length; allowed: L=elements"),
]


BAD = [row for row in BAD if (row[2], row[3]) in DEVICES]
FITS_NOT = [row[0] for row in BAD + [("a type that the interface has not",)]].index(
    "a type that the interface has not")


def test_bad_drvinfo(new_peer, new_asyn):
    """each mistake in a drvInfo gives one line: port, text, what is wrong, what is allowed"""
    peer = new_peer(16, 16)
    db = ""
    for i, (_, info, rtype, dtyp, _) in enumerate(BAD):
        fields = dict(FTVL="SHORT", NELM="4") if rtype in ("waveform", "aao") else {}
        db += record(rtype, f"bad{i}", dtyp, f"@asyn(A){info}", **fields)
    ioc = new_asyn(peer.configure(), db)
    peer.wait_connected()
    peer.send(bytes(16))
    for i, (what, info, rtype, dtyp, message) in enumerate(BAD):
        ioc.put(f"bad{i}.PROC", 1, wait=False)  # asyn leaves refused records at PACT=1
        ioc.wait_log(f's7plcAsyn A "{info}": ')
        lines = [line for line in ioc.log.splitlines()
                 if f's7plcAsyn A "{info}": ' in line]
        assert len(lines) == 1, (what, lines, ioc.log)
        assert message in lines[0], what
        until_equal(lambda: ioc.severity(f"bad{i}"), "INVALID")
        # as docs/asyn.md says: what cannot be understood ends the record at init, in asyn's
        # device support; what does not fit its interface is refused each time it processes
        stuck = ioc.get(f"bad{i}.PACT") == 1
        assert stuck == (i < FITS_NOT), what
        if stuck or rtype != "aao":  # of an aao it depends on the release of asyn
            until_equal(lambda: ioc.text(f"bad{i}.STAT"), "17" if stuck else "LINK")  # 17: UDF, CA names the first 16
    # what device support prints carries the message too
    assert 'A "0 T=INT99": T=INT99 is no data type' in ioc.log.split("drvUserCreate", 1)[1]


def test_limits_of_a_float(new_peer, new_asyn):
    """limits of a float are not promised: a warning says that they do nothing"""
    peer = new_peer(16, 16)
    ioc = new_asyn(peer.configure(recv_timeout=60000, send_interval=20),
                   record("ao", "o", "asynFloat64", "@asyn(A)out 4 T=REAL32 L=0 H=100")
                   + record("aao", "array", "asynFloat32ArrayOut", "@asyn(A)out 8 T=REAL32 L=2",
                            FTVL="FLOAT", NELM="2"))
    peer.wait_connected()
    peer.send(bytes(16))
    ioc.put("o", 150)
    peer.wait_block(struct.pack(">4xf8x", 150))
    ioc.put("array", [1, 2])
    peer.wait_block(struct.pack(">4xfff", 150, 1, 2))
    assert ioc.log_count("L= and H= have no effect on REAL32: it is neither cut nor scaled") == 1


def test_forms(new_peer, new_asyn):
    """in, a slash and small letters may stand in a drvInfo, as in the links of records"""
    peer = new_peer(16, 16)
    texts = ["2 T=INT16", "/2 T=INT16", "in 2 T=INT16", "in /2", "IN/2 t=short", " 1+1  T=INT16"]
    db = "".join(record("longin", f"v{i}", "asynInt32", f"@asyn(A){text}", SCAN="I/O Intr")
                 for i, text in enumerate(texts))
    db += record("longout", "o", "asynInt32", "@asyn(A,0,1)OUT/2+2 T=INT16")
    ioc = new_asyn(peer.configure(recv_timeout=60000, send_interval=20), db)
    peer.wait_connected()
    peer.send(struct.pack(">hh12x", 1, 4711))
    for i in range(len(texts)):
        ioc.wait_value(f"v{i}", 4711)
    ioc.put("o", 5)
    peer.wait_block(struct.pack(">hhh10x", 0, 0, 5))


@pytest.mark.parametrize("line, message", [
    ('drvAsynS7plcConfigure("A", "Nemo")', 'no PLC "Nemo"; configured: PLC'),
    ('drvAsynS7plcConfigure("A B", "PLC")', "a port name has no blanks, commas or brackets"),
    ('drvAsynS7plcConfigure("", "PLC")', "the name of the port is missing"),
    ('drvAsynS7plcConfigure("A", "PLC")\ndrvAsynS7plcConfigure("B", "PLC")',
     "this PLC has an asyn port already"),
    ('drvAsynS7plcConfigure("A", "PLC")\ns7plcConfigure "OTHER", "", 0, 8, 8\ndrvAsynS7plcConfigure("A", "OTHER")',
     "asyn does not take this port name; is it in use?"),
    ("iocInit\ndrvAsynS7plcConfigure A, PLC", "comes before iocInit"),
    ('drvAsynS7plcConfigure("A", "PLC", -1)', "initialWait=-1; allowed: 0 to 60000 ms"),
    ('drvAsynS7plcConfigure("A", "PLC", 60001)', "initialWait=60001; allowed: 0 to 60000 ms"),
    ('drvAsynS7plcConfigure("A,B", "PLC")', "a port name has no blanks, commas or brackets"),
    ('drvAsynS7plcConfigure("A)", "PLC")', "a port name has no blanks, commas or brackets"),
    ('drvAsynS7plcConfigure("A", "PLC", "soon")', "initialWait=soon; allowed: 0 to 60000 ms"),
], ids=["no such PLC", "a blank in the name", "no name", "a second port", "a name in use", "after iocInit",
        "-1", "60001", "a comma", "a bracket", "a bad number"])
def test_bad_configure(new_peer, new_asyn, line, message):
    """drvAsynS7plcConfigure says what is wrong: {id}"""
    peer = new_peer(16, 16)
    ioc = new_asyn(peer.configure(), record("longin", "x", "Soft Channel", "5"), port=line)
    lines = [text for text in ioc.log.splitlines() if message in text and "echo" not in text]
    assert len(lines) == 1 and "drvAsynS7plcConfigure" in lines[0], ioc.log


def test_etherip(new_asyn):
    """a PLC with tags has no asyn port, and one line says so"""
    ioc = new_asyn('etheripConfigure("TAGS", "127.0.0.1:1", 0)', record("longin", "x", "Soft Channel", "5"),
                   port='drvAsynS7plcConfigure("A", "TAGS")')
    lines = [text for text in ioc.log.splitlines() if "has tags, no offsets" in text]
    assert len(lines) == 1 and lines[0].endswith("allowed: PLCs with blocks, pairs, Modbus"), ioc.log


ACCESS = {"asynInt32": "longin", "asynInt64": "int64in", "asynUInt32Digital": "mbbi", "asynFloat64": "ai",
          "asynOctet": "stringin"}
GROUPS = {"integers up to 4 bytes": "INT8 UINT8 INT16 UINT16 INT32 UINT32", "TIME (BCD)": "TIME",
          "all integers": "INT8 UINT8 INT16 UINT16 INT32 UINT32 INT64 UINT64"}
TYPES = "INT8 UINT8 INT16 UINT16 INT32 UINT32 INT64 UINT64 REAL32 REAL64 STRING TIME S7STRING BCD16 BCD32 SM16 SBCD16".split()
ELEMENTS = {"Int8": "CHAR", "Int16": "SHORT", "Int32": "LONG", "Int64": "INT64", "Float32": "FLOAT", "Float64": "DOUBLE"}


def test_interfaces(new_peer, new_asyn):
    """asyn.md: each interface takes the types that the table says, and no others, and has this type without T="""
    rows = {row[0].split()[0]: row[2:] for row in table("asyn.md", "interface", "DTYP", "T=", "default T=") if row[2]}
    rows = {name: row for name, row in rows.items() if HAVE_INT64 or "Int64" not in name}
    db, place = "", {}
    for name, (_, default) in rows.items():
        element = next((ftvl for key, ftvl in ELEMENTS.items() if f"asyn{key}Array" == name), None)
        rtype, dtyp = ("waveform", name + "In") if element else (ACCESS[name], name.replace("Octet", "OctetRead"))
        fields = dict(FTVL=element, NELM="4") if element else dict(NOBT="4") if rtype == "mbbi" else {}
        for kind in TYPES + [""]:
            at = place[name, kind] = 300 * len(place)
            text = f"{at} " + (f"T={kind} L=4" if kind == "S7STRING" else f"T={kind}" if kind else "")
            where = f"@asynMask(A,0,15){text}" if rtype == "mbbi" else f"@asyn(A){text}"
            db += record(rtype, f"{name}{kind}", dtyp, where, **fields)
    peer = new_peer(300 * (len(place) + 1), 0)
    ioc = new_asyn(peer.configure(recv_timeout=60000), db)
    for name, kind in place:
        ioc.put(f"{name}{kind}.PROC", 1, wait=False)
    until(lambda: re.search(r'"\d+" \(in\) asynFloat64Array', ioc.command("asynReport 2 A")), "the last of them")
    for name, (allowed, default) in rows.items():
        for words, types in GROUPS.items():
            allowed = allowed.replace(words, types.replace(" ", ", "))
        good = {kind for kind in TYPES if f'A "{place[name, kind]} T={kind}' not in ioc.log}
        assert good == set(allowed.split(", ")), name
        shown = ioc.command("s7plcShow PLC records")
        assert re.search(rf"^ +{place[name, '']}-?\d* +A \({name} {default}\)", shown, re.M), (name, default, shown)


def test_wrong_use(new_peer, new_asyn):
    """an input cannot be written, other addresses than 0 are refused, both with the reason"""
    peer = new_peer(16, 16)
    ioc = new_asyn(peer.configure(recv_timeout=60000),
                   record("longout", "w", "asynInt32", "@asyn(A)0 T=INT16")
                   + record("longin", "addr", "asynInt32", "@asyn(A,1)0 T=INT16"))
    peer.wait_connected()
    peer.send(bytes(16))
    ioc.put("w", 3)
    assert ioc.alarm("w")[:2] == ("INVALID", "WRITE")
    ioc.wait_log('is in the input block; to write: "out 0 T=INT16"')
    assert "address 1; a PLC is one device; allowed: 0" in ioc.log


# --- loss, alarms, connection --------------------------------------------------------------------
def test_loss(new_peer, new_asyn):
    """when data is lost inputs turn COMM/INVALID at once, and are told again when it is back"""
    peer = new_peer(40, 0)
    ioc = new_asyn(peer.configure(recv_timeout=60000), input_records())
    peer.wait_connected()
    peer.send(BLOCK)
    pairs_equal(ioc)
    peer.hang_up()
    for name, *_ in INPUTS:
        ioc.wait_alarm(f"asyn:{name}", "INVALID", "COMM")
    assert ioc.get("asyn:ai16") == -1234
    peer.wait_connected(2)
    peer.send(struct.pack(">h", 77) + BLOCK[2:])
    ioc.wait_value("asyn:ai16", 77)
    for name, *_ in INPUTS:
        ioc.wait_alarm(f"asyn:{name}", "NO_ALARM")
    pairs_equal(ioc)


def test_silence(new_peer, new_asyn):
    """a PLC that is connected but silent gives COMM/INVALID, polled as well as by I/O Intr"""
    peer = new_peer(16, 0)
    ioc = new_asyn(peer.configure(recv_timeout=300),
                   record("longin", "poll", "asynInt32", "@asyn(A)0", SCAN=".1 second")
                   + record("longin", "intr", "asynInt32", "@asyn(A)0", SCAN="I/O Intr"))
    assert ioc.get("intr.UDF") == 1  # never before the first block
    ioc.wait_alarm("poll", "INVALID", "COMM")
    peer.wait_connected()
    peer.every(0.05, struct.pack(">h14x", 9))
    ioc.wait_value("poll", 9)
    ioc.wait_value("intr", 9)
    peer.stop_sending()
    for name in ("poll", "intr"):
        ioc.wait_alarm(name, "INVALID", "COMM")


def test_changed(new_peer, new_asyn):
    """with scan=changed only those are called back whose bytes changed"""
    peer = new_peer(16, 0)
    db = "".join(
        record("longin", name, "asynInt32", f"@asyn(A){place}", SCAN="I/O Intr",
               FLNK=f"$(P){name}n")
        + f'record(calc, "$(P){name}n") {{ field(INPA, "$(P){name}n") field(CALC, "A+1") }}\n'
        for name, place in (("a", "0"), ("b", "2"), ("bit", "4 T=BYTE B=0"), ("end", "14")))
    ioc = new_asyn(peer.configure(recv_timeout=60000), db, options=["scan changed"])
    peer.wait_connected()

    def send(a, b, bits, end):
        peer.send(struct.pack(">hhB9xh", a, b, bits, end))
        ioc.wait_value("end", end)

    send(1, 1, 0, 1)
    send(1, 2, 0xFE, 2)
    send(3, 2, 0xFC, 3)
    send(3, 4, 0xFD, 4)
    assert [ioc.get(f"{n}n") for n in ("a", "b", "bit", "end")] == [2, 3, 2, 4]


def test_pause(new_peer, new_asyn):
    """after iocPause and iocRun records show what changed meanwhile, also with scan=changed"""
    peer = new_peer(16, 0)
    ioc = new_asyn(peer.configure(recv_timeout=60000),
                   record("longin", "a", "asynInt32", "@asyn(A)0", SCAN="I/O Intr")
                   + record("longin", "b", "asynInt32", "@asyn(A)2", SCAN="I/O Intr"),
                   options=["scan changed"])
    peer.wait_connected()
    peer.send(struct.pack(">hh12x", 1, 1))
    ioc.wait_value("a", 1)
    for turn in range(2, 8):
        ioc.command("iocPause")
        peer.send(struct.pack(">hh12x", turn, 1))
        until_equal(lambda: f"in:  {turn} blocks" in ioc.command("s7plcReport PLC"), True)
        ioc.command("iocRun")
        ioc.wait_value("a", turn)
    peer.send(struct.pack(">hh12x", 100, 2))
    ioc.wait_value("a", 100)
    ioc.wait_value("b", 2)


def test_every_block(new_peer, new_asyn):
    """without scan=changed each block calls back, changed or not"""
    peer = new_peer(16, 0)
    db = (record("longin", "a", "asynInt32", "@asyn(A)0", SCAN="I/O Intr", FLNK="$(P)n")
          + 'record(calc, "$(P)n") { field(INPA, "$(P)n") field(CALC, "A+1") }\n')
    ioc = new_asyn(peer.configure(recv_timeout=60000), db)
    peer.wait_connected()
    for count in range(1, 20):
        peer.send(bytes(16))
        ioc.wait_value("n", count)


def test_scan_at_run_time(new_peer, new_asyn):
    """a record that joins I/O Intr later is told at the next block, one that leaves is not"""
    peer = new_peer(16, 0)
    ioc = new_asyn(peer.configure(recv_timeout=60000),
                   record("longin", "a", "asynInt32", "@asyn(A)0")
                   + record("waveform", "w", "asynInt16ArrayIn", "@asyn(A)0 T=INT16", NELM="2",
                            FTVL="SHORT")
                   + record("longin", "end", "asynInt32", "@asyn(A)2", SCAN="I/O Intr"),
                   options=["scan changed"])
    peer.wait_connected()
    for turn in range(20):
        for name in ("a", "w"):
            ioc.put(f"{name}.SCAN", "I/O Intr")
        peer.send(struct.pack(">hh12x", 5, 2 * turn))
        ioc.wait_value("a", 5)
        ioc.wait_value("w", [5, 2 * turn])
        for name in ("a", "w"):
            ioc.put(f"{name}.SCAN", "Passive")
        peer.send(struct.pack(">hh12x", 6, 2 * turn + 1))
        ioc.wait_value("end", 2 * turn + 1)
        assert ioc.get("a") == 5
        peer.send(struct.pack(">hh12x", 5, 2 * turn + 1))


# --- outputs that the PLC shows --------------------------------------------------------------------
RB = dict(info_asyn_READBACK="1")


def test_initial_value(new_sim, new_asyn):
    """outputs with R= start from the PLC's value, and nothing is written because of it"""
    sim = new_sim("name = PLC1\nport = 0\nin = 32\nout = 16\nbyteorder = big\nperiod = 20 ms\n"
                  "signal 16 INT16 constant 1234\nsignal 18 REAL32 constant 2.5\n"
                  "signal 22 UINT8 constant 8\n")
    db = (record("longout", "long", "asynInt32", "@asyn(A)out 0 T=INT16 R=16")
          + record("ao", "real", "asynFloat64", "@asyn(A)out 2 T=REAL32 R=18")
          + record("bo", "bit", "asynInt32", "@asyn(A)out 6 T=BYTE B=3 R=22")
          + record("ao", "lin", "asynInt32", "@asyn(A)out 0 T=INT16 L=0 H=10000 R=16",
                   LINR="LINEAR", EGUL="0", EGUF="100")
          + record("longout", "none", "asynInt32", "@asyn(A)out 8 T=INT16", VAL="-3")
          + record("longin", "blocks", "S7plc stats", "@PLC/blocksOut"))
    ioc = new_asyn(f's7plcConfigure("PLC", "127.0.0.1", {sim.port}, 32, 16, 1, 2000, 50)', db,
                   port='drvAsynS7plcConfigure("A", "PLC", 30000)')
    assert ioc.get("long") == 1234
    assert ioc.get("real") == 2.5
    assert ioc.get("bit") == 1
    assert ioc.get("lin") == pytest.approx(12.34)
    assert ioc.get("none") == -3
    ioc.process_record("blocks")
    assert ioc.get("blocks") == 0


def test_readback(new_peer, new_asyn):
    """asyn:READBACK shows what the PLC shows at R=, but not an older value after a put"""
    peer = new_peer(16, 8)
    db = (record("longout", "o", "asynInt32", "@asyn(A)out 0 T=INT16 R=0", FLNK="$(P)n", VAL="-7", **RB)
          + record("longin", "end", "asynInt32", "@asyn(A)14", SCAN="I/O Intr")
          + 'record(calc, "$(P)n") { field(INPA, "$(P)n") field(CALC, "A+1") }\n')
    ioc = new_asyn(peer.configure(recv_timeout=60000, send_interval=20), db,
                   port='drvAsynS7plcConfigure("A", "PLC", 0)')
    peer.wait_connected()
    ends = iter(range(1, 100))

    def shows(value):
        end = next(ends)
        peer.send(struct.pack(">h12xh", value, end))
        ioc.wait_value("end", end)

    assert ioc.get("o") == -7  # what the database said: the PLC is late
    shows(5)
    ioc.wait_value("o", 5)
    shows(6)
    ioc.wait_value("o", 6)
    assert peer.blocks() == []
    count = ioc.get("n")
    ioc.put("o", 7)
    peer.wait_block(struct.pack(">h6x", 7))
    shows(6)  # was on its way before the PLC had the 7
    shows(7)
    assert ioc.get("o") == 7
    assert ioc.get("n") == count + 1  # the put, and no callback
    shows(8)
    ioc.wait_value("o", 8)
    ioc.command("s7plcSend PLC")  # without track=on the output block keeps its own value
    assert peer.wait_blocks(2) == [struct.pack(">h6x", 7)] * 2


def test_before_first_block(new_peer, new_asyn):
    """with a record with R= by asyn no block leaves before the PLC's first, not by s7plcSend either"""
    peer = new_peer(16, 8)
    ioc = new_asyn(peer.configure(recv_timeout=60000, send_interval=20),
                   record("longout", "o", "asynInt32", "@asyn(A)out 0 T=INT16 R=0", **RB)
                   + record("longout", "other", "asynInt32", "@asyn(A)out 4 T=INT16")
                   + record("longin", "puts", "S7plc stats", "@PLC/blocksOut"))
    peer.wait_connected()
    ioc.put("other", 3)
    ioc.command("s7plcSend PLC")
    ioc.process_record("puts")
    assert ioc.get("puts") == 0 and peer.blocks() == []
    peer.send(struct.pack(">h14x", 5))
    peer.wait_block(lambda block: block[4:6] == b"\0\3")


def test_readback_track(new_peer, new_asyn):
    """with track=on asyn:READBACK shows the output image, which follows the PLC"""
    peer = new_peer(16, 8)
    db = (record("longout", "o", "asynInt32", "@asyn(A)out 0 T=INT16 R=0", **RB)
          + record("ao", "s7", "S7plc", "@PLC/0 T=INT16 R=0")
          + record("bo", "bit", "asynInt32", "@asyn(A)out 2 T=BYTE B=1 R=2", **RB)
          + record("stringout", "text", "asynOctetWrite", "@asyn(A)out 4 L=4 R=4", **RB)
          + record("longin", "end", "asynInt32", "@asyn(A)14", SCAN="I/O Intr"))
    ioc = new_asyn(peer.configure(recv_timeout=60000, send_interval=20), db, options=["track on"])
    peer.wait_connected()
    for value in (3, 4, 5):
        peer.send(struct.pack(">hBx4s6xh", value, 2 * (value & 1), b"t%d" % value, value))
        for name in ("o", "s7"):
            ioc.wait_value(name, value)
        ioc.wait_value("bit", value & 1)
        if HAVE_AAI:
            ioc.wait_value("text", f"t{value}")
    ioc.put("s7", 9)
    ioc.wait_value("o", 9)
    ioc.put("o", 10)
    peer.wait_block(lambda block: block[:2] == b"\0\x0a")


def test_readback_of_others(new_peer, new_asyn):
    """without R= asyn:READBACK shows what other records write to the place"""
    peer = new_peer(0, 8)
    db = (record("longout", "a", "asynInt32", "@asyn(A)out 0 T=INT16", **RB)
          + record("longout", "b", "asynInt32", "@asyn(A)out 0 T=INT16", **RB)
          + record("longin", "in", "asynInt32", "@asyn(A)out 0 T=INT16", SCAN="I/O Intr")
          + (record("aao", "array", "asynInt8ArrayOut", "@asyn(A)out 0 T=UINT8 L=4",
                    FTVL="UCHAR", NELM="4", **RB) if HAVE_AAI else ""))
    ioc = new_asyn(peer.configure(send_interval=20), db)
    peer.wait_connected()
    until(lambda: "connected" in ioc.command("asynReport 0 A"))
    ioc.put("a", 258)
    for name in ("b", "in"):
        ioc.wait_value(name, 258)
    if not HAVE_AAI:
        return
    ioc.wait_value("array", [1, 2, 0, 0])
    ioc.put("array", [3, 4, 5, 6])
    for name in ("a", "b", "in"):
        ioc.wait_value(name, 772)
    peer.wait_block(bytes([3, 4, 5, 6, 0, 0, 0, 0]))


# --- writes that the PLC does not get now -----------------------------------------------------------
def test_kept(new_peer, new_asyn):
    """a value written while the PLC is away has COMM, leaves when it is back, and the alarm ends"""
    peer = new_peer(0, 8)
    peer.power_off()
    ioc = new_asyn(peer.configure(send_interval=20),
                   record("longout", "a", "asynInt32", "@asyn(A)out 0 T=INT16", **RB)
                   + record("longout", "b", "asynInt32", "@asyn(A)out 2 T=INT16")
                   + record("longout", "pini", "asynInt32", "@asyn(A)out 4 T=INT16", VAL="3",
                            PINI="YES"))
    for name in ("a", "b"):
        ioc.put(name, 7)
        assert ioc.alarm(name)[:2] == ("INVALID", "COMM")
    ioc.wait_log("kept for later: connection refused")
    peer.power_on()
    peer.wait_block(struct.pack(">hhhh", 7, 7, 3, 0))
    ioc.wait_alarm("a", "NO_ALARM")
    assert ioc.get("a") == 7
    assert ioc.alarm("b")[:2] == ("INVALID", "COMM")  # without asyn:READBACK
    ioc.put("b", 8)
    assert ioc.severity("b") == "NO_ALARM"


def test_rejected(new_peer, new_asyn):
    """offlineWrites=reject: WRITE/INVALID with the reason, and nothing leaves later"""
    peer = new_peer(0, 8)
    peer.power_off()
    ioc = new_asyn(peer.configure(send_interval=20),
                   record("longout", "a", "asynInt32", "@asyn(A)out 0 T=INT16", **RB)
                   + record("ao", "b", "asynFloat64", "@asyn(A)out 2 T=INT16"),
                   options=["offlineWrites reject"])
    for name in ("a", "b"):
        ioc.put(name, 7)
        assert ioc.alarm(name)[:2] == ("INVALID", "WRITE")
    ioc.wait_log("refused: connection refused")
    peer.power_on()
    peer.wait_connected()
    until(lambda: "PLC: connected" in ioc.command("asynReport 0 A"))
    ioc.put("a", 9)
    peer.wait_block(struct.pack(">hhhh", 9, 0, 0, 0))
    assert ioc.severity("a") == "NO_ALARM"


SYNC = """
name = PLC1
port = 0
in = 32
out = 16
byteorder = big
period = 20 ms
sync = on
watchdog = 10 min
db 10 12 Setpoints
tx P#DB10.DBX0.0 BYTE 12 -> 4
rx 4 -> P#DB10.DBX0.0 BYTE 12
"""


def test_sync(new_sim, new_asyn):
    """with sync=on a put is refused in LOCAL, and asyn:READBACK takes the value back"""
    sim = new_sim(SYNC)
    ioc = new_asyn(f's7plcConfigure("PLC", "127.0.0.1", {sim.port}, 32, 16, 1, 2000, 50)',
                   record("longout", "a", "asynInt32", "@asyn(A)out 4 T=INT16 R=4", **RB)
                   + record("longout", "head", "asynInt32", "@asyn(A)out 2 T=INT16")
                   + record("longin", "state", "S7plc stats", "@PLC/syncState",
                            SCAN="I/O Intr"),
                   options=["sync on"])
    ioc.wait_log("bytes 0 to 3 are the header of the sync handshake; allowed: 4 and up")
    ioc.wait_value("state", 3)  # synced
    ioc.put("a", 5)
    assert ioc.severity("a") == "NO_ALARM"
    until_equal(lambda: sim.command("get DB10.0 INT16"), "DB10.0 INT16 = 5")
    sim.command("local")
    ioc.wait_value("state", 4)  # local
    ioc.put("a", 6)
    ioc.wait_alarm("a", "INVALID", "WRITE")
    ioc.wait_value("a", 5)
    assert ioc.alarm("a")[:2] == ("INVALID", "WRITE")
    ioc.wait_log("refused: PLC in LOCAL")
    sim.command("remote")
    ioc.wait_value("state", 3)  # synced
    ioc.put("a", 7)
    assert ioc.severity("a") == "NO_ALARM"


# --- asynRecord, trace, report ------------------------------------------------------------------------
ASYN = ('record(asyn, "$(P)port") { field(DTYP, "asynRecordDevice") field(PORT, "A") '
        'field(ADDR, "0") field(OMAX, "80") field(IMAX, "80") }\n')


def test_asyn_record(new_peer, new_asyn):
    """asynRecord shows the connection, and disconnects and connects the port, not the PLC"""
    peer = new_peer(16, 2)
    ioc = new_asyn(peer.configure(recv_timeout=60000),
                   ASYN + record("longin", "a", "asynInt32", "@asyn(A)0", SCAN="I/O Intr")
                   + record("longin", "poll", "asynInt32", "@asyn(A)0", SCAN=".1 second")
                   + record("longin", "s7", "S7plc", "@PLC/0", SCAN="I/O Intr")
                   + record("longout", "o", "asynInt32", "@asyn(A)out 0"))
    peer.wait_connected()
    ioc.wait_value("port.CNCT", 1)
    assert ioc.text("port.PCNCT") == "Connect"
    peer.every(0.02, struct.pack(">h14x", 1))
    ioc.wait_value("a", 1)
    ioc.put("port.CNCT", 0)
    ioc.wait_value("port.CNCT", 0)
    for name in ("a", "poll"):
        ioc.wait_alarm(name, "INVALID", "COMM")
    peer.every(0.02, struct.pack(">h14x", 2))
    ioc.wait_value("s7", 2)
    assert ioc.severity("s7") == "NO_ALARM" and len(peer.connections) == 1
    assert ioc.get("a") == 1
    ioc.put("o", 5)
    assert ioc.severity("o") == "INVALID" and peer.blocks() == []
    assert "disconnected by a user" in ioc.command("asynReport 0 A")
    ioc.put("port.CNCT", 1)
    ioc.wait_value("port.CNCT", 1)
    for name in ("a", "poll"):
        ioc.wait_value(name, 2)
        ioc.wait_alarm(name, "NO_ALARM")
    # the PLC itself
    ioc.command("asynAutoConnect A 0 0")
    ioc.command("asynAutoConnect A -1 0")
    peer.stop_sending()
    peer.power_off()
    ioc.wait_value("port.CNCT", 0)
    ioc.put("port.CNCT", 1)
    until(lambda: "connection refused" in ioc.text("port.ERRS"))
    peer.power_on()
    ioc.wait_value("port.CNCT", 1)


def hex_of(block):
    """As asyn prints it: 20 bytes in a line."""
    return "".join("\n" + "".join(f"{b:02x} " for b in block[i:i + 20])
                   for i in range(0, len(block), 20))


def test_trace(new_peer, new_asyn, tmp_path):
    """asynRecord switches the trace: blocks in and out in hex, flow, into a file; and off"""
    peer = new_peer(24, 8)
    ioc = new_asyn(peer.configure(recv_timeout=60000, send_interval=20),
                   ASYN + record("longin", "a", "asynInt32", "@asyn(A)0", SCAN="I/O Intr")
                   + record("longout", "o", "asynInt32", "@asyn(A)out 0"))
    peer.wait_connected()
    ioc.wait_value("port.CNCT", 1)
    file = tmp_path / "trace"
    ioc.command(f'asynSetTraceFile A 0 "{file}"')
    ioc.put("port.TB3", 1)    # ASYN_TRACEIO_DRIVER
    ioc.put("port.TIB2", 1)   # ASYN_TRACEIO_HEX
    block = struct.pack(">h", 4711) + bytes(range(22))
    peer.send(block)
    until(lambda: f" in, 24 bytes\n{hex_of(block)}" in file.read_text(), file.read_text)
    printed, happened = re.search(r" (\S+) (\S+) in, 24 bytes", file.read_text()).groups()
    assert happened[:12] <= printed or happened > "23:59"
    ioc.put("o", 258)
    until(lambda: f" out, 8 bytes\n{hex_of(bytes([1, 2, 0, 0, 0, 0, 0, 0]))}" in file.read_text(),
          file.read_text)
    assert "callbacks" not in file.read_text()
    ioc.put("port.TSIZ", 4)
    peer.send(block)
    until(lambda: f" in, 24 bytes\n{hex_of(block[:4])}\n" in file.read_text(), file.read_text)
    ioc.put("port.TB4", 1)    # ASYN_TRACE_FLOW
    peer.send(block)
    until(lambda: "A 1 callbacks for a block" in file.read_text(), file.read_text)
    peer.hang_up()
    until(lambda: "A disconnected: " in file.read_text(), file.read_text)
    peer.wait_connected(2)
    until(lambda: "A connected" in file.read_text(), file.read_text)
    ioc.put("port.TMSK", 1)
    size = file.stat().st_size
    peer.send(struct.pack(">h", 1) + bytes(22))
    ioc.wait_value("a", 1)
    ioc.command("")
    assert file.stat().st_size == size


def test_slow_trace(new_peer, new_asyn, tmp_path):
    """a trace file that nobody reads holds up neither blocks nor records; drops are counted"""
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    peer = new_peer(4000, 0)
    ioc = new_asyn(peer.configure(recv_timeout=60000),
                   record("longin", "a", "asynInt32", "@asyn(A)0 T=UINT16", SCAN="I/O Intr")
                   + record("longin", "s7", "S7plc", "@PLC/0 T=UINT16", SCAN="I/O Intr"))
    peer.wait_connected()
    ioc.command(f'asynSetTraceFile A 0 "{fifo}"')
    ioc.command("asynSetTraceIOTruncateSize A 0 4000")
    ioc.command("asynSetTraceIOMask A 0 4")
    ioc.command("asynSetTraceMask A 0 8")
    for n in range(1, 400):
        peer.send(struct.pack(">H", n) + bytes(3998))
        ioc.wait_value("s7", n)
        ioc.wait_value("a", n)
    # read it: the trace goes on, and tells how many were lost
    text = bytearray()

    def read():
        os.set_blocking(reader, True)
        while True:
            data = os.read(reader, 65536)
            if not data:
                return
            text.extend(data)
    threading.Thread(target=read, daemon=True).start()
    until(lambda: b"traces were dropped: printing is too slow" in text, "drops told")
    assert re.search(r"[1-9]\d* traces dropped", ioc.command("asynReport 1 A"))
    ioc.command("asynSetTraceMask A 0 1")


def test_report(new_peer, new_asyn):
    """asynReport and s7plcShow tell what the port does, the more the higher the level"""
    peer = new_peer(16, 8)
    ioc = new_asyn(peer.configure(recv_timeout=60000),
                   record("longin", "a", "asynInt32", "@asyn(A)0", SCAN="I/O Intr")
                   + record("longout", "o", "asynInt32", "@asyn(A)out 4 R=4", **RB)
                   + record("longin", "bad", "asynInt32", "@asyn(A)0 T=REAL32"))
    peer.wait_connected()
    peer.send(bytes(16))
    ioc.put("bad.PROC", 1, wait=False)
    until(lambda: "PLC PLC: connected" in ioc.command("asynReport 0 A"))
    one = ioc.command("asynReport 1 A")
    assert "multiDevice:Yes canBlock:No" in one
    assert "3 places, 2 with callbacks" in one and "0 traces dropped" in one
    assert "in 16 bytes, out 8 bytes" in one
    two = ioc.command("asynReport 2 A")
    assert '"out 4 R=4" asynInt32, 1 called back' in two
    until(lambda: '"0 T=REAL32" (in) asynInt32 REFUSED' in ioc.command("asynReport 2 A"))
    shown = ioc.command("s7plcShow PLC records")
    assert "A (asynInt32 INT16)" in shown, shown


# --- many ---------------------------------------------------------------------------------------------
BLOCK_SIZE = 1024
COUNT_AT = BLOCK_SIZE - 4
KINDS = [  # record type, link, asyn DTYP, fields, bytes
    ("ai", "T=INT16", "asynInt32", "", 2),
    ("ai", "T=INT16 L=-5000 H=5000", "asynInt32",
     'field(LINR, "LINEAR") field(EGUL, "-1") field(EGUF, "1")', 2),
    ("ai", "T=REAL32", "asynFloat64", "", 4),
    ("ai", "T=REAL64", "asynFloat64", "", 8),
    ("ai", "T=INT32", "asynFloat64", "", 4),
    ("longin", "T=INT8", "asynInt32", "", 1),
    ("longin", "T=UINT16", "asynInt32", "", 2),
    ("longin", "T=INT32 W=low", "asynInt32", "", 4),
    ("longin", "T=UINT32", "asynInt32", "", 4),
    ("bi", "T=WORD B=11", "asynInt32", "", 2),
    ("mbbi", "T=BYTE", "asynUInt32Digital", 'field(NOBT, "4")', 1),
    ("mbbiDirect", "T=WORD", "asynUInt32Digital", 'field(NOBT, "16")', 2),
]
if HAVE_INT64:
    KINDS += [("int64in", "T=INT64", "asynInt64", "", 8)]


def pair_records(rng, count):
    """count pairs of records at random places, each with a calc that is 1 when they differ."""
    db = ""
    for i in range(count):
        rtype, link, dtyp, fields, size = KINDS[i % len(KINDS)]
        place = f"{rng.randrange(COUNT_AT - size)} {link}"
        mask = {"mbbi": "Mask(A,0,15)", "mbbiDirect": "Mask(A,0,65535)"}.get(rtype, "(A)")
        for name, driver, text in ((f"a{i}", dtyp, f"@asyn{mask}{place}"),
                                   (f"s{i}", "S7plc", f"@PLC/{place}")):
            db += (f'record({rtype}, "$(P){name}") {{ field(DTYP, "{driver}") field(INP, "{text}") '
                   f'field(SCAN, "I/O Intr") {fields} }}\n')
        db += (f'record(calc, "$(P)d{i}") {{ field(INPA, "$(P)a{i}") field(INPB, "$(P)s{i}") '
               f'field(SCAN, "Event") field(EVNT, "compare") '
               f'field(CALC, "(A=B||(ISNAN(A)&&ISNAN(B)))?0:1") }}\n')
    return db


def sums(names, level=1):
    """Records that add these up, 12 at a time, one level after the other; the last is "sum"."""
    db, above = "", []
    for i in range(0, len(names), 12):
        name = f"sum{level}_{i // 12}" if len(names) > 12 else "sum"
        part = names[i:i + 12]
        inputs = "".join(f'field(INP{"ABCDEFGHIJKL"[k]}, "$(P){n}") ' for k, n in enumerate(part))
        db += (f'record(calc, "$(P){name}") {{ {inputs} field(SCAN, "Event") field(EVNT, "compare") '
               f'field(PHAS, "{level}") field(CALC, "{"+".join("ABCDEFGHIJKL"[:len(part)])}") }}\n')
        above.append(name)
    return db if len(names) <= 12 else db + sums(above, level + 1)


@pytest.mark.parametrize("scan", ["all", "changed"])
def test_thousand(new_peer, new_asyn, scan):
    """1,000 records by asyn equal 1,000 by "S7plc" over 1,000 random blocks, scan={scan}"""
    rng = random.Random(4711)
    pairs, blocks = 1000, 1000
    names = [f"d{i}" for i in range(pairs)]
    db = pair_records(rng, pairs) + sums(names)
    # the last of a pass: waveforms are the last records that register, and PHAS tells ours
    db += record("waveform", "aEnd", "asynInt32ArrayIn", f"@asyn(A){COUNT_AT} T=INT32",
                 FTVL="LONG", NELM="1", SCAN="I/O Intr")
    db += record("longin", "sEnd", "S7plc", f"@PLC/{COUNT_AT} T=INT32", SCAN="I/O Intr",
                 PHAS="9")
    # and one pair that differs: the comparison works
    db += record("longin", "other", "asynInt32", "@asyn(A)0 T=INT32", SCAN="I/O Intr")
    db += record("longin", "another", "S7plc", "@PLC/1 T=INT32", SCAN="I/O Intr")
    db += ('record(calc, "$(P)differs") { field(INPA, "$(P)other") field(INPB, "$(P)another") '
           'field(INPC, "$(P)differs") field(SCAN, "Event") field(EVNT, "compare") '
           'field(CALC, "(A=B)?C:C+1") }\n')
    db += ('record(event, "$(P)compare") { field(VAL, "compare") }\n'
           'record(calc, "$(P)checked") { field(INPA, "$(P)aEnd") field(CALC, "A") field(PHAS, "9") '
           'field(SCAN, "Event") field(EVNT, "compare") }\n')
    peer = new_peer(BLOCK_SIZE, 0)
    ioc = new_asyn(peer.configure(recv_timeout=60000), db, options=[f"scan {scan}"])
    peer.wait_connected()
    data = bytearray(BLOCK_SIZE)
    for n in range(1, blocks + 1):
        if scan == "all":
            data[:COUNT_AT] = rng.randbytes(COUNT_AT)
        else:  # a few bytes here and there
            for _ in range(30):
                data[rng.randrange(COUNT_AT)] = rng.randrange(256)
        struct.pack_into(">i", data, COUNT_AT, n)
        peer.send(bytes(data))
        ioc.wait_value("aEnd", n)
        ioc.wait_value("sEnd", n)
        ioc.put("compare.PROC", 1)
        ioc.wait_value("checked", n)
        differ = ioc.get("sum")
        assert differ == 0, [(name, ioc.get(f"a{name[1:]}"), ioc.get(f"s{name[1:]}"))
                             for name in names if ioc.get(name)][:5]
    assert ioc.get("differs") > blocks * 0.9
    values = {ioc.get(f"a{i}") for i in range(100)}
    assert len(values) > 50  # they do move


def test_flood(new_peer, new_asyn):
    """6,000 I/O Intr records and a PLC that floods: no callback is lost, the newest block wins"""
    count = 6000
    peer = new_peer(64, 0)
    db = "".join(record("longin", f"a{i}", "asynInt32", "@asyn(A)60 T=INT32", SCAN="I/O Intr")
                 for i in range(count))
    ioc = new_asyn(peer.configure(recv_timeout=60000), db)
    peer.wait_connected()
    for n in range(1, 3000):
        peer.send(bytes(60) + struct.pack(">i", n))
    peer.send(bytes(60) + struct.pack(">i", 3000))
    for i in (0, 1, count // 2, count - 1):
        ioc.wait_value(f"a{i}", 3000)
    assert re.search(r"[1-9]\d* blocks were replaced by a newer one", ioc.command("asynReport 1 A"))
    values = set()
    for line in ioc.command('dbl longin VAL', limit=60).splitlines():
        if line.startswith(ioc.P):
            values.add(line.split()[-1].strip('"'))
    assert values == {"3000"}, values
    assert "ring buffer" not in ioc.log and "full" not in ioc.log
    assert "callbackRequest" not in ioc.log


def test_exit_busy(new_peer, new_asyn):
    """the IOC ends at once while blocks, callbacks and traces are under way"""
    peer = new_peer(64, 8)
    db = "".join(record("longin", f"a{i}", "asynInt32", "@asyn(A)60 T=INT32", SCAN="I/O Intr")
                 for i in range(1000))
    ioc = new_asyn(peer.configure(recv_timeout=60000), db)
    peer.wait_connected()
    ioc.command("asynSetTraceMask A 0 0x19")
    ioc.command("asynSetTraceFile A 0 /dev/null")
    peer.every(0.0005, bytes(64))
    until(lambda: int(ioc.command("asynReport 1 A").split(" callbacks in")[0].split()[-1]) > 10000)
    assert ioc.exit() == 0


PAIR = """
name = PLC
port = 0
role = pair
address = 127.0.0.2
switchover = 300 ms
in = 32
out = 16
period = 20 ms
signal 0 UINT32 counter
mirror 0 16 -> 16
"""


def test_pair(new_sim, new_ioc):
    """a redundant pair is one asyn port: a switch-over neither disconnects nor invalidates it"""
    sim = new_sim(PAIR)
    ioc = new_ioc(f'phoenixplcConfigure("PLC", "127.0.0.2", {sim.port}, 32, 16, 1, 2000, 20, 1)\n'
                  'drvAsynS7plcConfigure("A", "PLC")',
                  ASYN + record("int64in" if HAVE_INT64 else "longin", "count",
                                "asynInt64" if HAVE_INT64 else "asynInt32", "@asyn(A)0 T=UINT32",
                                SCAN="I/O Intr", FLNK="$(P)worst")
                  + record("longout", "o", "asynInt32", "@asyn(A)out 0 T=INT16 R=16", **RB)
                  + record("mbbi", "backup", "phoenixplc", "@PLC", SCAN="I/O Intr")
                  + 'record(calc, "$(P)worst") { field(INPA, "$(P)count.SEVR") '
                  'field(INPB, "$(P)port.CNCT") field(CALC, "A>C?A:C") field(INPC, "$(P)worst") }\n',
                  program="phoenixIoc")
    ioc.wait_value("port.CNCT", 1)
    ioc.wait_value("backup", 4)  # plc-2nd linked
    ioc.put("o", 7)
    before = ioc.get("count")
    until(lambda: ioc.get("count") > before)
    sim.command("switchover")
    ioc.wait_value("backup", 3)
    count = ioc.get("count")
    until(lambda: ioc.get("count") > count + 5)
    assert ioc.get("worst") == 0
    assert ioc.get("port.CNCT") == 1
    ioc.put("o", 8)
    assert ioc.severity("o") == "NO_ALARM"
    sim.command("unplug 1")
    sim.command("unplug 2")
    ioc.wait_value("port.CNCT", 0)
    ioc.wait_alarm("count", "INVALID", "COMM")


def test_modbus(new_modbus, new_asyn):
    """over Modbus: what the PLC refuses has its reason by asyn too, and nothing else has"""
    peer = new_modbus(size=40)
    peer.holding[4] = 7
    ioc = new_asyn(peer.configure("input 0 4 every 50, input 20 4 every 50", "holding 0 8"),
                   record("longin", "good", "asynInt32", "@asyn(A)0 T=INT16", SCAN="I/O Intr")
                   + record("longin", "bad", "asynInt32", "@asyn(A)8 T=INT16", SCAN="I/O Intr")
                   + record("longin", "poll", "asynInt32", "@asyn(A)8 T=INT16", SCAN=".1 second")
                   + record("longout", "o0", "asynInt32", "@asyn(A)out 0 T=INT16", **RB)
                   + record("longout", "o2", "asynInt32", "@asyn(A)out 2 T=INT16", **RB)
                   + record("longout", "o4", "asynInt32", "@asyn(A)out 8 T=INT16", **RB)
                   + record("ao", "low", "asynFloat64", "@asyn(A)out 12 T=REAL32 W=low", **RB),
                   options=["track on"])
    ioc.wait_value("o4", 7)  # the PLC's value, by track=on
    for name in ("good", "bad", "poll"):
        ioc.wait_alarm(name, "NO_ALARM")
    rule = peer.refuse(4, 20)
    for name in ("bad", "poll"):
        ioc.wait_alarm(name, "INVALID", "READ")
    assert ioc.severity("good") == "NO_ALARM"
    peer.refuse_no_more(rule)
    for name in ("bad", "poll"):
        ioc.wait_alarm(name, "NO_ALARM")
    rule = peer.refuse((6, 16), 1)
    for name in ("o0", "o2", "o4"):
        ioc.put(name, 5)
    ioc.wait_alarm("o2", "INVALID", "WRITE")
    until_equal(lambda: peer.holding[0], 5)
    until_equal(lambda: peer.holding[4], 5)
    assert ioc.severity("o0") == ioc.severity("o4") == "NO_ALARM"
    peer.refuse_no_more(rule)
    ioc.put("o2", 6)
    until_equal(lambda: peer.holding[1], 6)
    ioc.wait_alarm("o2", "NO_ALARM")
    ioc.put("low", 1.5)
    until_equal(lambda: [peer.holding[6], peer.holding[7]], [0, 0x3FC0])
    peer.holding[0] = 99  # someone else writes it
    ioc.wait_value("o0", 99)


COMPLETED = [  # record type, interface, drvInfo, value, what the registers hold then
    ("longout", "asynInt32", "out 0 T=INT16", 5, [5]),
    ("ao", "asynFloat64", "out 4 T=REAL32", 1.5, [0x3FC0, 0]),
    ("bo", "asynUInt32Digital", "out 8 T=UINT16", 1, [1]),
    ("stringout", "asynOctetWrite", "out 12 T=STRING L=4", "abcd", [0x6162, 0x6364]),
]


@pytest.mark.parametrize("rtype,dtyp,link,value,registers", COMPLETED)
def test_modbus_completion(new_modbus, new_asyn, rtype, dtyp, link, value, registers):
    """over Modbus: a put by {dtyp} ends when the PLC has answered, and a refusal is the alarm then"""
    peer = new_modbus(size=64)
    where = f"@asynMask(A,0,1){link}" if "Digital" in dtyp else f"@asyn(A){link}"
    ioc = new_asyn(peer.configure("", "holding 10 16", timeout=60000), record(rtype, "o", dtyp, where),
                   options=["readPeriod 0"])
    until(lambda: peer.answers, "the first read")
    ioc.wait_log("connected to")
    ioc.pv("o"), ioc.pv("o.PACT")
    peer.reads_go_on = True  # a record that has joined late is read for
    peer.answering.clear()
    done = ioc.put_callback("o", value)
    until(lambda: peer.writes(), "the write")
    assert not done.is_set() and ioc.get("o.PACT") == 1
    assert "canBlock:Yes" in ioc.command("asynReport 0 A")
    peer.answering.set()
    assert done.wait(60)
    first = 10 + int(link.split()[1]) // 2
    assert peer.holding[first:first + len(registers)] == registers
    assert ioc.severity("o") == "NO_ALARM"
    rule = peer.refuse((6, 16, 22), 0, 64)
    ioc.put("o", "dcba" if rtype == "stringout" else 0)
    assert ioc.alarm("o")[:2] == ("INVALID", "WRITE")
    peer.refuse_no_more(rule)
    ioc.put("o", value)
    assert ioc.severity("o") == "NO_ALARM"


def test_modbus_sent(new_modbus, new_asyn):
    """over Modbus: with complete=sent a put by asyn ends before the PLC has answered"""
    peer = new_modbus(size=64)
    ioc = new_asyn(peer.configure("", "holding 10 16", timeout=60000), record("longout", "o", "asynInt32", "@asyn(A)out 0 T=INT16"),
                   options=["readPeriod 0", "complete sent"])
    until(lambda: peer.answers, "the first read")
    ioc.wait_log("connected to")
    ioc.pv("o")
    peer.answering.clear()
    assert ioc.put_callback("o", 5).wait(60)
    until(lambda: peer.writes(), "the write")
    assert ioc.severity("o") == "NO_ALARM" and ioc.get("o.PACT") == 0 and peer.holding[10] == 0
    peer.answering.set()
    until_equal(lambda: peer.holding[10], 5)


def test_modbus_places(new_modbus, new_asyn):
    """over Modbus: a drvInfo into a gap, over two ranges or behind the last coil is refused; an open array ends with its range"""
    peer = new_modbus(size=64)
    peer.holding[0], peer.holding[2] = 5, 6
    links = {"gap": "@asyn(A)out 6 T=INT16", "two": "@asyn(A)out 8 T=INT32", "bit": "@asyn(A)out 12 T=UINT8 B=3",
             "good": "@asyn(A)out 8 T=INT16"}
    ioc = new_asyn(peer.configure("holding 0 3, holding 10 3 at 8", "holding 10 3, holding 20 1 at 8, holding 30 1, coils 0 3"),
                   "".join(record("longout", name, "asynInt32", link) for name, link in links.items())
                   + record("waveform", "open", "asynInt16ArrayIn", "@asyn(A)0", FTVL="SHORT", NELM="20", SCAN="I/O Intr"))
    for name, message in (("gap", '"out 6 T=INT16": bytes 6 to 7 are in no range; allowed: bytes 0 to 5, 8 to 9, 10 to 11, 12 to 12'),
                          ("two", '"out 8 T=INT32": bytes 8 to 11 are in two ranges; allowed: a value in one of them: '),
                          ("bit", '"out 12 T=UINT8 B=3": byte 12 has no bit 3; allowed: bits 0 to 2, which are coils')):
        ioc.put(name, 1)
        ioc.wait_alarm(name, "INVALID", "LINK")
        assert message in ioc.log, message
    ioc.put("good", 7)
    ioc.wait_alarm("good", "NO_ALARM")
    assert peer.holding[20] == 7 and peer.written() == {20}
    until_equal(lambda: ioc.plain("open"), [5, 0, 6])


def test_modbus_order(new_modbus, new_asyn):
    """over Modbus: puts by asyn and by DTYP S7plc leave in the order in which they were made; nothing waits at the end"""
    peer = new_modbus(size=64)
    ioc = new_asyn(peer.configure("", "holding 0 32", timeout=60000),
                   "".join(record("longout", f"a{i}", "asynInt32", f"@asyn(A)out {4 * i} T=INT16") +
                           record("longout", f"s{i}", "S7plc", f"@PLC/{4 * i + 2} T=INT16") for i in range(8)),
                   options=["readPeriod 0"])
    until(lambda: peer.answers, "the first read")
    ioc.wait_log("connected to")
    names = [f"{kind}{i}" for i in (5, 2, 7, 0, 3) for kind in "as"]
    ioc.connect(names)
    mark = peer.mark()
    for n, name in enumerate(names):
        ioc.put(name, n + 1)
    assert [r.start for r in peer.writes(mark)] == [2 * int(name[1]) + (name[0] == "s") for name in names]
    peer.answering.clear()
    mark = peer.mark()
    for name in names:
        ioc.put(name, 77, wait=False)
    until(lambda: peer.writes(mark), "a write that is not answered")
    assert ioc.exit() == 0


def test_modbus_lost(new_modbus, new_asyn):
    """over Modbus: a put by asyn that is not answered ends with the connection; what follows works"""
    peer = new_modbus(size=64)
    ioc = new_asyn(peer.configure("", "holding 0 32", timeout=300), record("longout", "o", "asynInt32", "@asyn(A)out 0 T=INT16"),
                   options=["readPeriod 0"])
    until(lambda: peer.answers, "the first read")
    ioc.put("o", 1)
    assert ioc.severity("o") == "NO_ALARM"
    peer.answering.clear()
    ioc.put("o", 2)
    assert ioc.severity("o") == "INVALID"
    peer.answering.set()
    until_equal(lambda: peer.holding[0], 2)
    ioc.put("o", 3)
    assert peer.holding[0] == 3 and ioc.severity("o") == "NO_ALARM"


def test_demo():
    """make demo-asyn ends well: the same values side by side, and a trace"""
    run_demo("iocAsyn", 300)
