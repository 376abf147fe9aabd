"""A whole PLC over Modbus/TCP (modbusplcConfigure) against pymodbus's server."""
import random
import struct
import time

import pytest

from ioc import SINCE_7_0_6, errors_in
from waiting import until, until_equal

FORMS = {"INT8": "b", "UINT8": "B", "INT16": "h", "UINT16": "H", "INT32": "i", "UINT32": "I",
         "INT64": "q", "UINT64": "Q", "REAL32": "f", "REAL64": "d"}
SIZES = {name: struct.calcsize(form) for name, form in FORMS.items()}
TO_32 = ["INT8", "UINT8", "INT16", "UINT16", "INT32", "UINT32"]
# Numbers whose bytes all differ; those of 64 bits fit a double, which CA makes of them.
NUMBERS = {"INT8": -0x35, "UINT8": 0xC7, "INT16": -0x2345, "UINT16": 0xA6B5,
           "INT32": -0x12345678, "UINT32": 0x7A6B5C4D, "INT64": -0x0012345678ABCDEF,
           "UINT64": 0x0019283746A5B4C3,
           "REAL32": struct.unpack("f", struct.pack("f", -1.23456e-7))[0],
           "REAL64": 3.141592653589793e100}


def encode(kind, value, low, swap=2):
    """Bytes in the registers; low: the lower word comes first."""
    data = struct.pack(">" + FORMS[kind], value)
    if low and len(data) > swap:
        data = b"".join(data[i:i + swap] for i in range(len(data) - swap, -1, -swap))
    return data


class Places:
    """Hands out places in an image, one behind the other."""

    def __init__(self):
        self.image = bytearray()

    def take(self, size):
        offset = len(self.image)
        offset += offset % 2 if size > 1 else 0
        self.image.extend(bytes(offset + size - len(self.image)))
        return offset

    def put(self, data):
        offset = self.take(len(data))
        self.image[offset:offset + len(data)] = data
        return offset


def bits_of_type(kind, value):
    return value & (1 << 8 * SIZES[kind]) - 1


def scalar_records():
    """(record type, data type, fields, value that it shows) for each pair that exists."""
    rows = []
    for kind in [*TO_32, "REAL32", "REAL64"]:
        rows.append(("ai", kind, 'field(PREC, "9")', NUMBERS[kind]))
    for kind in TO_32:
        bits = bits_of_type(kind, NUMBERS[kind])
        shown = NUMBERS[kind]
        rows.append(("longin", kind, "", shown))
        shift = 8 * SIZES[kind] - 6
        rows.append(("mbbi", kind, f'field(SHFT, "{shift}") field(NOBT, "4")', bits >> shift & 15))
        # CA has no number of 32 bits without sign
        rows.append(("mbbiDirect", kind, f'field(NOBT, "{8 * SIZES[kind]}")',
                     bits if SIZES[kind] < 4 else NUMBERS[kind]))
    for kind in [*TO_32, "INT64", "UINT64"]:
        bits = bits_of_type(kind, NUMBERS[kind])
        rows.append(("int64in", kind, "", NUMBERS[kind]))
        for bit in {0, 3, 8 * SIZES[kind] - 3, 8 * SIZES[kind] // 2 + 1}:
            rows.append(("bi", f"{kind} B={bit}", "", bits >> bit & 1))
    return rows


WORDS = {"high": "", "low": "\ns7plcSetOption PLC wordOrder low"}


@pytest.mark.parametrize("order", WORDS)
def test_inputs(new_modbus, new_ioc, order):
    """wordOrder={order}: every input record shows every type, also with W=high and W=low in the link"""
    peer, places, wanted, db = new_modbus(), Places(), {}, []
    for record, text, fields, value in scalar_records():
        kind = text.split()[0]
        for word in ("", "high", "low") if SIZES[kind] > 2 else ("",):
            offset = places.put(encode(kind, NUMBERS[kind], (word or order) == "low"))
            name = f"r{len(wanted)}"
            wanted[name] = record, text, word, value
            link = f"@PLC/{offset} T={text}" + (f" W={word}" if word else "")
            db.append(f'record({record}, "$(P){name}") {{ field(DTYP, "S7plc") '
                      f'field(INP, "{link}") field(SCAN, "I/O Intr") {fields} }}')
    size = len(places.image) // 2 + 1
    ioc = new_ioc(peer.configure(f"holding 100 {size}") + WORDS[order], "\n".join(db))
    peer.holding.put(100, places.image + bytes(-len(places.image) % 2))
    ioc.connect([*wanted, *(name + ".SEVR" for name in wanted)])
    for name in wanted: # one after the other: they were put while the IOC was reading
        ioc.wait_value(name, wanted[name][3])
    until_equal(lambda: {ioc.severity(name) for name in wanted}, {"NO_ALARM"})
    assert errors_in(ioc.log) == []


ELEMENTS = {"CHAR": "INT8", "UCHAR": "UINT8", "SHORT": "INT16", "USHORT": "UINT16",
            "LONG": "INT32", "ULONG": "UINT32", "INT64": "INT64", "UINT64": "UINT64",
            "FLOAT": "REAL32", "DOUBLE": "REAL64"}


def element_values(kind, count=4):
    """Numbers that differ, within the type."""
    base = NUMBERS[kind]
    return [base / 2 ** i if kind[0] == "R" else base // 2 ** i for i in range(count)]


@pytest.mark.parametrize("order", WORDS)
def test_input_arrays(new_modbus, new_ioc, order):
    """wordOrder={order}: arrays turn each element; texts and single bytes stay as they are"""
    peer, places, wanted, db = new_modbus(), Places(), {}, []
    for record in "waveform", "aai":
        for element, kind in ELEMENTS.items():
            for word in ("", "high", "low") if SIZES[kind] > 2 else ("",):
                low = (word or order) == "low"
                offset = places.put(b"".join(encode(kind, v, low) for v in element_values(kind)))
                name = f"r{len(wanted)}"
                wanted[name] = element_values(kind)
                link = f"@PLC/{offset}" + (f" W={word}" if word else "")
                db.append(f'record({record}, "$(P){name}") {{ field(DTYP, "S7plc") field(INP, "{link}") '
                          f'field(SCAN, "I/O Intr") field(FTVL, "{element}") field(NELM, "4") }}')
    text = b"Modbus \xb0C".ljust(20, b"\0")
    at = places.put(text)
    db.append(f"""
        record(stringin, "$(P)text") {{ field(DTYP, "S7plc") field(INP, "@PLC/{at} L=6") field(SCAN, "I/O Intr") }}
        record(lsi, "$(P)long") {{ field(DTYP, "S7plc") field(INP, "@PLC/{at} L=20") field(SIZV, "40") field(SCAN, "I/O Intr") }}
        record(waveform, "$(P)chars") {{ field(DTYP, "S7plc") field(INP, "@PLC/{at} T=STRING") field(FTVL, "UCHAR") field(NELM, "20") field(SCAN, "I/O Intr") }}
        record(waveform, "$(P)bcd") {{ field(DTYP, "S7plc") field(INP, "@PLC/{places.put(bytes([0x26, 0x11, 0x23, 0x59]))} T=TIME") field(FTVL, "UCHAR") field(NELM, "4") field(SCAN, "I/O Intr") }}
        """)
    ioc = new_ioc(peer.configure(f"input 40 {len(places.image) // 2}") + WORDS[order], "\n".join(db))
    peer.input.put(40, places.image)
    ioc.connect(wanted)
    ioc.wait_value("bcd", [26, 11, 23, 59])
    for name, value in wanted.items():  # CA has no bytes with sign; the server is polled piece by piece
        unsigned = [v & 0xFF if isinstance(v, int) else v for v in value]
        until(lambda: ioc.plain(name) in (value, unsigned), name)
    assert ioc.text("text") == "Modbus"
    assert bytes(ioc.plain("long.VAL$")).startswith(b"Modbus \xb0C\0")
    assert bytes(ioc.plain("chars")).startswith(b"Modbus \xb0C")


def put_rows():
    """(record type, data type, fields, what is put, bits that change, their new value)."""
    rows = []
    for kind in [*TO_32, "REAL32", "REAL64"]:
        rows.append(("ao", kind, 'field(PREC, "9")', NUMBERS[kind], None))
        rows.append(("calcout", kind, 'field(CALC, "A")', NUMBERS[kind], None))
    for kind in TO_32:
        rows.append(("longout", kind, "", NUMBERS[kind], None))
        shift = 8 * SIZES[kind] - 6
        rows.append(("mbbo", kind, f'field(SHFT, "{shift}") field(NOBT, "4")', 9, (15 << shift, 9 << shift)))
        mask = (1 << min(8 * SIZES[kind], 31)) - 1
        if SINCE_7_0_6:
            rows.append(("mbboDirect", kind, f'field(NOBT, "{min(8 * SIZES[kind], 31)}")',
                         NUMBERS["UINT32"] & mask, (mask, NUMBERS["UINT32"] & mask)))
    for kind in [*TO_32, "INT64", "UINT64"]:
        rows.append(("int64out", kind, "", NUMBERS[kind], None))
        for bit in {2, 8 * SIZES[kind] - 3}:
            rows.append(("bo", f"{kind} B={bit}", "", 1, (1 << bit, 1 << bit)))
    return rows


@pytest.mark.parametrize("order", WORDS)
def test_outputs(new_modbus, new_ioc, order):
    """wordOrder={order}: every output record writes every type, also with W=high and W=low"""
    peer, places, puts, db = new_modbus(), Places(), {}, []
    for record, text, fields, value, bits in put_rows():
        kind = text.split()[0]
        unsigned = "U" + kind if kind[0] == "I" else kind
        for word in ("", "high", "low") if SIZES[kind] > 2 else ("",):
            low = (word or order) == "low"
            offset = places.take(SIZES[kind])
            name = f"w{len(puts)}"
            if bits:  # of all ones and all zeros in turn, only those of the record change
                old = 0 if len(puts) % 2 else (1 << 8 * SIZES[kind]) - 1
                mask, new = bits
                places.image[offset:offset + SIZES[kind]] = encode(unsigned, old, low)
                wanted = encode(unsigned, old & ~mask | new, low)
            else:
                wanted = encode(kind, value, low)
            puts[name] = record, text, word, offset, value, wanted
            link = f"@PLC/{offset} T={text}" + (f" W={word}" if word else "")
            db.append(f'record({record}, "$(P){name}") {{ field(DTYP, "S7plc") '
                      f'field(OUT, "{link}") {fields} }}')
    image = bytes(places.image) + bytes(len(places.image) % 2)
    peer.holding.put(500, image)
    ioc = new_ioc(peer.configure("", f"holding 500 {len(image) // 2}") + WORDS[order], "\n".join(db))
    until(lambda: peer.requests, "the first read")
    ioc.connect([n + (".A" if put[0] == "calcout" else "") for n, put in puts.items()])
    ioc.connect(n + ".SEVR" for n in puts)
    for name, (record, _, _, _, value, _) in puts.items():
        ioc.put(name + (".A" if record == "calcout" else ""), value)

    def wrong():
        held = peer.holding.bytes(500, len(image))
        return [(*put, held[put[3]:put[3] + len(put[5])]) for put in puts.values()
                if held[put[3]:put[3] + len(put[5])] != put[5]]
    until(lambda: not wrong(), lambda: f"{wrong()[:5]}")
    assert {ioc.severity(name) for name in puts} == {"NO_ALARM"}


@pytest.mark.parametrize("order", WORDS)
def test_output_arrays(new_modbus, new_ioc, order):
    """wordOrder={order}: aao, texts and BCD are written as they are read"""
    peer, places, puts, db = new_modbus(), Places(), {}, []
    for element, kind in ELEMENTS.items():
        for word in ("", "high", "low") if SIZES[kind] > 2 else ("",):
            data = b"".join(encode(kind, v, (word or order) == "low") for v in element_values(kind))
            offset = places.put(data)
            name = f"w{len(puts)}"
            puts[name] = element_values(kind)
            link = f"@PLC/{offset}" + (f" W={word}" if word else "")
            db.append(f'record(aao, "$(P){name}") {{ field(DTYP, "S7plc") field(OUT, "{link}") '
                      f'field(FTVL, "{element}") field(NELM, "4") }}')
    for name, record, text in ("text", "stringout", "odd length"), ("long", "lso", "x" * 33 + "yz"):
        at = places.put(text.encode().ljust(36, b"\0"))
        db.append(f'record({record}, "$(P){name}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{at} L=36") '
                  f'{"field(SIZV, 80)" if record == "lso" else ""} }}')
        puts[name + (".VAL$" if record == "lso" else "")] = text
    ioc = new_ioc(peer.configure("", f"holding 0 {len(places.image) // 2}") + WORDS[order], "\n".join(db))
    until(lambda: peer.requests, "the first read")
    ioc.connect(puts)
    for name, value in puts.items():
        ioc.put(name, value)
    until_equal(lambda: peer.holding.bytes(0, len(places.image)), bytes(places.image))


def test_bits(new_modbus, new_ioc):
    """coils and discrete inputs: the first is bit 0 of the first byte, and a put changes its own only"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure("coils 3 20, discrete 100 9", "coils 30 20"), """
        record(bi, "$(P)c0") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=BYTE B=0") field(SCAN, "I/O Intr") }
        record(bi, "$(P)c9") { field(DTYP, "S7plc") field(INP, "@PLC/1 T=BYTE B=1") field(SCAN, "I/O Intr") }
        record(longin, "$(P)third") { field(DTYP, "S7plc") field(INP, "@PLC/2 T=BYTE") field(SCAN, "I/O Intr") }
        record(mbbi, "$(P)d") { field(DTYP, "S7plc") field(INP, "@PLC/3 T=BYTE") field(SHFT, "2") field(NOBT, "3") field(SCAN, "I/O Intr") }
        record(bi, "$(P)d8") { field(DTYP, "S7plc") field(INP, "@PLC/4 T=BYTE B=0") field(SCAN, "I/O Intr") }
        record(bo, "$(P)o") { field(DTYP, "S7plc") field(OUT, "@PLC/1 T=BYTE B=3") }
        record(mbbo, "$(P)m") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=BYTE") field(SHFT, "2") field(NOBT, "3") }
        record(longout, "$(P)byte") { field(DTYP, "S7plc") field(OUT, "@PLC/2 T=BYTE") }
        """)
    for i in 3, 12, 3 + 16, 3 + 18, 3 + 20, 103, 104, 108:
        peer.coils[i] = peer.discrete[i] = True
    ioc.wait_value("d8", 1)
    assert ioc.wait_value("third", 0b0101) and ioc.get("c0") == 1 and ioc.get("c9") == 1
    assert ioc.get("d") == 0b110
    peer.coils[3] = False
    ioc.wait_value("c0", 0)
    ioc.put("o", 1)
    ioc.put("m", 5)
    until_equal(lambda: [i for i in range(25, 55) if peer.coils[i]], [32, 34, 41])
    ioc.put("m", 2)
    ioc.put("o", 0)
    until_equal(lambda: [i for i in range(25, 55) if peer.coils[i]], [33])
    assert peer.written(table="coils") == {32, 33, 34, 41}
    # a byte of which only four coils exist
    ioc.put("byte", 0xF5)
    until_equal(lambda: [i for i in range(44, 70) if peer.coils[i]], [46, 48])
    assert max(peer.written(table="coils")) == 49
    assert {r.function for r in peer.writes()} == {15}
    assert ioc.severity("byte") == "NO_ALARM"


def test_four_tables(new_modbus, new_ioc):
    """ranges of all tables in one image, placed by `at`, each from its own table"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure("holding 10 2 at 100, input 10 2, coils 10 8 at 0, discrete 10 8, holding 500 1 at 50"), """
        record(longin, "$(P)h") { field(DTYP, "S7plc") field(INP, "@PLC/100 T=INT32") field(SCAN, "I/O Intr") }
        record(longin, "$(P)i") { field(DTYP, "S7plc") field(INP, "@PLC/104 T=INT32") field(SCAN, "I/O Intr") }
        record(longin, "$(P)c") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=BYTE") field(SCAN, "I/O Intr") }
        record(longin, "$(P)d") { field(DTYP, "S7plc") field(INP, "@PLC/1 T=BYTE") field(SCAN, "I/O Intr") }
        record(longin, "$(P)far") { field(DTYP, "S7plc") field(INP, "@PLC/50 T=INT16") field(SCAN, "I/O Intr") }
        """)
    peer.holding.pack(10, "i", 70001)
    peer.input.pack(10, "i", -70002)
    peer.holding[500] = 503
    peer.coils[11], peer.discrete[12] = True, True
    for name, value in ("h", 70001), ("i", -70002), ("c", 2), ("d", 4), ("far", 503):
        ioc.wait_value(name, value)
    turn = {r.key for r in peer.requests}
    assert turn == {(3, 10, 2), (4, 10, 2), (1, 10, 8), (2, 10, 8), (3, 500, 1)}


# --- Polling ---------------------------------------------------------------------------------

PROBE = """
record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT16") field(SCAN, "I/O Intr") }
"""


def test_periods(new_modbus, new_ioc):
    """each range is read at its own period, and not more often"""
    peer = new_modbus()
    new_ioc(peer.configure("holding 0 4 every 50, holding 4 4 every 200, input 0 4 every 500, coils 0 8"), PROBE)
    peer.wait_requests(4, 0, function=4)
    periods = {(3, 0, 4): 0.05, (3, 4, 4): 0.2, (4, 0, 4): 0.5, (1, 0, 8): 0.1}
    log = list(peer.requests)
    assert {r.key for r in log} == set(periods)
    counts = {}
    for key, period in periods.items():
        times = [r.time for r in log if r.key == key]
        counts[key] = len(times)
        assert len(times) <= (log[-1].time - log[0].time) / period + 3, key
    assert counts[3, 0, 4] > counts[1, 0, 8] > counts[3, 4, 4] > counts[4, 0, 4] >= 4


def test_number_of_requests(new_modbus, new_ioc):
    """2,000 registers in 8 ranges at 10 Hz: the 16 requests per turn that the limit forces, no more"""
    peer = new_modbus(size=4000)
    ranges = ", ".join(f"holding {400 * i} 250 every 100" for i in range(8))
    ioc = new_ioc(peer.configure(ranges), "".join(f"""
        record(longin, "$(P)first{i}") {{ field(DTYP, "S7plc") field(INP, "@PLC/{500 * i}") field(SCAN, "I/O Intr") }}
        record(longin, "$(P)last{i}") {{ field(DTYP, "S7plc") field(INP, "@PLC/{500 * i + 498}") field(SCAN, "I/O Intr") }}
        """ for i in range(8)))
    for i in range(8):
        peer.holding[400 * i], peer.holding[400 * i + 249] = i + 1, 100 + i
    log = peer.wait_requests(20 * 16, 0)
    wanted = {(3, 400 * i + start, 125) for i in range(8) for start in (0, 125)}
    # how often, not how punctual: a machine that is late begins a turn before the one before ends
    counts = {key: sum(r.key == key for r in log) for key in wanted}
    assert sum(counts.values()) == len(log), {r.key for r in log} - wanted
    assert max(counts.values()) - min(counts.values()) <= 3, counts
    seconds = log[-1].time - log[0].time
    assert len(log) // 16 <= seconds / 0.1 + 3
    for i in range(8):
        ioc.wait_value(f"first{i}", i + 1)
        ioc.wait_value(f"last{i}", 100 + i)


def test_adjacent_ranges(new_modbus, new_ioc):
    """ranges that follow each other in the PLC are read together, wherever they lie in the image"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure("holding 20 10 at 40, holding 0 10 at 0, holding 10 10 at 20, "
                                 "coils 8 8 at 60, coils 0 8 at 100, holding 30 10 at 120 every 150"), """
        record(longin, "$(P)a") { field(DTYP, "S7plc") field(INP, "@PLC/0") field(SCAN, "I/O Intr") }
        record(longin, "$(P)b") { field(DTYP, "S7plc") field(INP, "@PLC/20") field(SCAN, "I/O Intr") }
        record(longin, "$(P)c") { field(DTYP, "S7plc") field(INP, "@PLC/40") field(SCAN, "I/O Intr") }
        record(longin, "$(P)d") { field(DTYP, "S7plc") field(INP, "@PLC/60 T=BYTE") field(SCAN, "I/O Intr") }
        record(longin, "$(P)e") { field(DTYP, "S7plc") field(INP, "@PLC/100 T=BYTE") field(SCAN, "I/O Intr") }
        record(longin, "$(P)f") { field(DTYP, "S7plc") field(INP, "@PLC/120") field(SCAN, "I/O Intr") }
        """)
    for i in range(40):
        peer.holding[i] = 1000 + i
    peer.coils[1] = peer.coils[10] = True
    for name, value in zip("abcdef", (1000, 1010, 1020, 4, 2, 1030)):
        ioc.wait_value(name, value)
    assert {r.key for r in peer.requests} == {(3, 0, 30), (1, 0, 16), (3, 30, 10)}


def test_limits_of_bits(new_modbus, new_ioc):
    """4,500 coils and 500 input registers: no request is larger than 2,000 bits or 125 registers"""
    peer = new_modbus(size=6000)
    ioc = new_ioc(peer.configure("coils 5 4500, input 0 500"), """
        record(bi, "$(P)last") { field(DTYP, "S7plc") field(INP, "@PLC/562 T=BYTE B=3") field(SCAN, "I/O Intr") }
        record(bi, "$(P)mid") { field(DTYP, "S7plc") field(INP, "@PLC/250 T=BYTE B=1") field(SCAN, "I/O Intr") }
        record(longin, "$(P)reg") { field(DTYP, "S7plc") field(INP, "@PLC/1562") field(SCAN, "I/O Intr") }
        """)
    peer.coils[5 + 4499] = peer.coils[5 + 2001] = True
    peer.input[499] = 77
    ioc.wait_value("reg", 77)
    ioc.wait_value("last", 1)
    ioc.wait_value("mid", 1)
    keys = {r.key for r in peer.requests}
    assert len([k for k in keys if k[0] == 1]) == 3 and len([k for k in keys if k[0] == 4]) == 4
    assert sum(k[2] for k in keys if k[0] == 1) == 4500
    assert max(k[2] for k in keys if k[0] == 1) == 2000 and max(k[2] for k in keys if k[0] == 4) == 125


def test_values_stay_whole(new_modbus, new_ioc):
    """a value that lies across the limit of 125 registers is read by one request"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure("holding 0 200 every 10"), """
        record(ai, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/246 T=REAL64") field(SCAN, "I/O Intr") }
        """)
    peer.holding.pack(123, "d", 12.5)
    ioc.wait_value("in", 12.5)
    assert all(r.start + r.count not in (124, 125, 126) for r in peer.requests)
    assert len({r.key for r in peer.requests}) == 2


def test_end_of_the_address_space(new_modbus, new_ioc):
    """register 65535 is read and written"""
    peer = new_modbus(size=65536)
    ioc = new_ioc(peer.configure("holding 65530 6", "holding 65530 6"), """
        record(longin, "$(P)in") { field(DTYP, "S7plc") field(INP, "@PLC/10") field(SCAN, "I/O Intr") }
        record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/10") }
        """)
    ioc.wait_alarm("in", "NO_ALARM")
    ioc.put("out", 4321)
    ioc.wait_value("in", 4321)
    assert peer.holding[65535] == 4321


# --- What blocks have too ----------------------------------------------------------------------

def test_move(new_modbus, new_ioc):
    """"S7plc addr" shows the address, and moves the IOC to another Modbus PLC"""
    peer, other = new_modbus(), new_modbus()
    ioc = new_ioc(peer.configure("holding 0 10 every 20", "holding 20 10"), PROBE + """
        record(stringout, "$(P)addr") { field(DTYP, "S7plc addr") field(OUT, "@PLC") }
        record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT16") }
        """)
    peer.holding[0], other.holding[0] = 5, 6
    ioc.wait_value("in", 5)
    ioc.put("out", 1)
    until_equal(lambda: peer.holding[20], 1)
    assert ioc.get("addr") == f"127.0.0.1:{peer.port}"
    ioc.put("addr", f"127.0.0.1:{other.port}")
    ioc.wait_value("in", 6)
    until_equal(lambda: other.holding[20], 1)
    mark = peer.mark()
    ioc.put("out", 2)
    until_equal(lambda: other.holding[20], 2)
    assert peer.mark() == mark and peer.holding[20] == 1


def test_scan_changed(new_modbus, new_ioc):
    """scan=changed: only records whose registers changed are processed"""
    peer = new_modbus()
    db = "".join(f"""
        record(longin, "$(P)i{i}") {{ field(DTYP, "S7plc") field(INP, "@PLC/{2 * i}") field(SCAN, "I/O Intr") field(FLNK, "$(P)n{i}") }}
        record(calc, "$(P)n{i}") {{ field(INPA, "$(P)n{i}") field(CALC, "A+1") }}
        """ for i in range(20))
    ioc = new_ioc(peer.configure("holding 0 20 every 20") + "\ns7plcSetOption PLC scan changed", db)
    ioc.wait_alarm("i19", "NO_ALARM")
    before = [ioc.get(f"n{i}") for i in range(20)]
    for value in range(1, 11):
        peer.holding[7] = value
        ioc.wait_value("i7", value)
    after = [ioc.get(f"n{i}") for i in range(20)]
    assert after[7] >= before[7] + 10
    assert all(a <= b + 1 for i, (a, b) in enumerate(zip(after, before)) if i != 7)


def test_alive(new_modbus, new_ioc):
    """alive: a PLC that answers but whose alive register stands still is INVALID"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure("holding 0 10 every 20") + "\ns7plcSetOption PLC alive 4,UINT16"
                  "\ns7plcSetOption PLC aliveTimeout 200", PROBE)
    ioc.wait_alarm("in", "INVALID", "COMM", "frozen", ask=True)
    for value in range(1, 200):
        peer.holding[2] = value
        if ioc.severity("in") == "NO_ALARM":
            break
        time.sleep(0.02)  # the PLC's program counts
    else:
        raise AssertionError(ioc.alarm("in"))
    ioc.wait_alarm("in", "INVALID", "COMM", "frozen")


# --- Refusals --------------------------------------------------------------------------------

REFUSED = """
record(longin, "$(P)a") { field(DTYP, "S7plc") field(INP, "@PLC/0") field(SCAN, "I/O Intr") }
record(longin, "$(P)b") { field(DTYP, "S7plc") field(INP, "@PLC/20") field(SCAN, "I/O Intr") }
record(waveform, "$(P)wf") { field(DTYP, "S7plc") field(INP, "@PLC/24") field(FTVL, "SHORT") field(NELM, "4") field(SCAN, "I/O Intr") }
record(longin, "$(P)c") { field(DTYP, "S7plc") field(INP, "@PLC/40") field(SCAN, "I/O Intr") }
record(bi, "$(P)stat") { field(DTYP, "S7plc stat") field(INP, "@PLC") field(SCAN, "I/O Intr") }
"""


@pytest.mark.parametrize("ranges, name", {
    "apart": ("holding 0 10 every 20, holding 100 10 every 20, input 0 10 every 20", "a range of its own"),
    "adjacent": ("holding 90 10 every 20, holding 100 10 every 20, holding 110 10 every 20", "one of three that are read together"),
}.values(), ids=["a range of its own", "one of three that are read together"])
def test_refused_range(new_modbus, new_ioc, ranges, name):
    """the PLC refuses {name}: its records are READ/INVALID, the others go on, until it does no more"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure(ranges), REFUSED)
    for record in "abc":
        ioc.wait_alarm(record, "NO_ALARM")
    first = 90 if "90" in ranges else 0
    third = (peer.holding, 110) if "90" in ranges else (peer.input, 0)
    rule = peer.refuse(3, 100, 4, code=2)
    for record in "b", "wf":
        ioc.wait_alarm(record, "INVALID", "READ", "exception 2, illegal data address")
    for value in range(1, 6):
        peer.holding[first], third[0][third[1]] = value, 10 * value
        ioc.wait_value("a", value)
        ioc.wait_value("c", 10 * value)
        assert ioc.severity("a") == ioc.severity("c") == "NO_ALARM"
    assert ioc.get("stat") == 1 and peer.connections == 1
    assert ioc.alarm("b")[:2] == ("INVALID", "READ")
    peer.refuse_no_more(rule)
    peer.holding[100] = 5
    ioc.wait_value("b", 5)
    for record in "b", "wf":
        ioc.wait_alarm(record, "NO_ALARM")
    assert peer.connections == 1
    # said when it begins and when it ends, not with each request
    assert ioc.log_count("illegal data address") <= 2


def test_refused_from_the_start(new_modbus, new_ioc):
    """a range that the PLC never had: its records say so, the other ranges are good"""
    peer = new_modbus(size=160)
    ioc = new_ioc(peer.configure("holding 0 10, holding 160 10, input 0 10"), REFUSED)
    ioc.wait_alarm("b", "INVALID", "READ", "exception 2, illegal data address")
    for record in "ac":
        ioc.wait_alarm(record, "NO_ALARM")
    assert peer.connections == 1


def test_all_refused(new_modbus, new_ioc):
    """a PLC that refuses every range: READ/INVALID with its reason, the connection stays"""
    peer = new_modbus()
    rules = [peer.refuse((3, 4), 0, 65536, code=4)]
    ioc = new_ioc(peer.configure("holding 0 10 every 20, holding 100 10 every 20, input 0 10 every 20"), REFUSED)
    for record in "abc":
        ioc.wait_alarm(record, "INVALID", "READ", "exception 4")
    peer.refuse_no_more(rules[0])
    for record in "abc":
        ioc.wait_alarm(record, "NO_ALARM")
    assert peer.connections == 1


def test_refused_state(new_modbus, new_ioc):
    """where the PLC shows some registers, or none, the state says so: MINOR or MAJOR, how many, which first and why; until it shows all"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure("holding 0 10 every 20, holding 100 10 every 20, coils 3 11 at 60 every 20"), REFUSED,
                  templates=[(f, "P=$(P),PLC=PLC") for f in ("s7plcStation.db", "s7plcModbus.db")])

    def shows(state, severity, reason, count):
        until_equal(lambda: (ioc.text("State"), ioc.severity("State"),
                             bytes(ioc.get("Reason.VAL$")).rstrip(b"\0").decode(),
                             ioc.message("State")[:31], ioc.get("RefusedReads")),
                    (state, severity, reason, reason[:31], count))

    shows("ok", "NO_ALARM", "", 0)
    some = peer.refuse(3, 102, 4, code=2)
    shows("some reads refused", "MINOR", "holding 102 to 105: exception 2, illegal data address (4 of 31 refused)", 4)
    assert ioc.get("Alive") == 1 and ioc.severity("a") == "NO_ALARM"
    assert "holding 102 to 105: exception 2" in ioc.command("s7plcReport")
    coil = peer.refuse(1, 4, code=2)
    shows("some reads refused", "MINOR", "holding 102 to 105: exception 2, illegal data address (5 of 31 refused)", 5)
    peer.refuse_no_more(some)
    shows("some reads refused", "MINOR", "coils 4: exception 2, illegal data address (1 of 31 refused)", 1)
    peer.refuse_no_more(coil)
    shows("ok", "NO_ALARM", "", 0)
    every = peer.refuse((1, 3), 0, 65536, code=2)
    shows("reads refused", "MAJOR", "holding 0 to 9: exception 2, illegal data address (31 of 31 refused)", 31)
    assert ioc.get("Alive") == 0
    peer.refuse_no_more(every)
    shows("ok", "NO_ALARM", "", 0)
    assert peer.connections == 1


def test_refused_state_at_start(new_modbus, new_ioc):
    """a PLC that refuses every read from the start is never shown as ok, nor after it was lost"""
    peer = new_modbus()
    rule = peer.refuse((3, 4), 0, 65536, code=2)
    ioc = new_ioc(peer.configure("holding 0 10 every 20", timeout=300), REFUSED, templates=[("s7plcStation.db", "P=$(P),PLC=PLC")])
    states = ioc.watch("State")
    ioc.wait_value("State", 9)
    assert ioc.text("LostTime") == ""
    peer.silent = True
    ioc.wait_value("State", 1)
    peer.silent = False
    ioc.wait_value("State", 9)
    assert 3 not in states, states
    peer.refuse_no_more(rule)
    until(lambda: states[-1] == 3, lambda: f"ok; it was {states}")


CODES = {1: "illegal function", 2: "illegal data address", 3: "illegal data value",
         4: "device failure", 5: "acknowledge", 6: "device busy", 8: "memory parity error",
         10: "no gateway path", 11: "gateway: no answer", 7: "negative acknowledge", 9: "", 77: "", 255: ""}


def test_exception_codes(new_modbus, new_ioc):
    """every exception code comes with its number and its words in AMSG"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure("holding 0 10 every 20"), PROBE)
    for code, words in CODES.items():
        rule = peer.refuse(3, 0, code=code)
        _, _, message = ioc.wait_alarm("in", "INVALID", "READ", f"exception {code}")
        assert words in message
        peer.refuse_no_more(rule)
        ioc.wait_alarm("in", "NO_ALARM")
    assert peer.connections == 1


# --- Answers that are wrong --------------------------------------------------------------------

def header(frame, **new):
    transaction, protocol, length, unit = struct.unpack(">HHHB", frame[:7])
    words = {"transaction": transaction, "protocol": protocol, "length": length, "unit": unit, **new}
    return struct.pack(">HHHB", words["transaction"], words["protocol"], words["length"],
                       words["unit"]) + frame[7:]


MANGLED = {
    "a short frame": lambda f: f[:-3],
    "a short frame that says so": lambda f: header(f[:-3], length=len(f) - 9),
    "another transaction": lambda f: header(f, transaction=0x7777),
    "another unit": lambda f: header(f, unit=99),
    "another protocol": lambda f: header(f, protocol=5),
    "another function": lambda f: f[:7] + b"\4" + f[8:],
    "another byte count": lambda f: f[:8] + bytes([f[8] - 2]) + f[9:],
    "two registers less": lambda f: header(f[:8] + bytes([f[8] - 4]) + f[9:-4], length=len(f) - 10),
    "two registers more": lambda f: header(f[:8] + bytes([f[8] + 4]) + f[9:] + b"abcd", length=len(f) - 2),
    "bytes behind it": lambda f: f + b"more",
    "an answer twice": lambda f: f + f,
    "a header only": lambda f: header(f[:7], length=1),
    "length 0": lambda f: header(f, length=0),
    "length 65535": lambda f: header(f, length=65535),
    "an exception of another function": lambda f: header(f[:7], length=3) + b"\x84\2",
    "an exception without code": lambda f: header(f[:7], length=2) + b"\x83",
    "text": lambda f: b"HTTP/1.1 400 Bad Request\r\n\r\n",
    "300 bytes": lambda f: header(f[:9], length=300) + bytes(300),
}


def test_wrong_answers(new_modbus, new_ioc):
    """wrong answers of every kind: the connection is given up, no wrong value, the IOC lives, and all is good afterwards"""
    peers, lines, db = {}, [], ""
    for i, name in enumerate(MANGLED):
        peers[name] = new_modbus(size=16)
        peers[name].holding[0] = 1234
        lines.append(peers[name].configure("holding 0 10 every 20, input 0 10 every 20", name=f"PLC{i}",
                                           timeout=500))
        db += f"""
        record(longin, "$(P)in{i}") {{ field(DTYP, "S7plc") field(INP, "@PLC{i}/0 T=INT16") field(SCAN, "I/O Intr") }}
        record(calc, "$(P)wrong{i}") {{ field(INPA, "$(P)in{i} CP") field(INPB, "$(P)in{i}.SEVR") field(CALC, "VAL+(B==0&&A!=1234&&A!=0&&A!=4321)") }}
        """
    ioc = new_ioc("\n".join(lines), db)
    ioc.connect([f"{name}{i}" for i in range(len(MANGLED)) for name in ("in", "wrong")])
    for i in range(len(MANGLED)):
        ioc.wait_value(f"in{i}", 1234)
        ioc.wait_alarm(f"in{i}", "NO_ALARM")
    marks = {name: peer.mark() for name, peer in peers.items()}
    before = {name: peer.connections for name, peer in peers.items()}
    for name, peer in peers.items():
        peer.mangle = lambda request, frame, wrong=MANGLED[name]: wrong(frame) if request.function == 3 else frame
    for i, (name, peer) in enumerate(peers.items()):
        peer.wait_requests(4, marks[name], function=3)
        if name not in ("bytes behind it", "an answer twice"):
            ioc.wait_alarm(f"in{i}", "INVALID")
            peer.wait_connected(before[name] + 1)
    for peer in peers.values():
        peer.mangle = None
        peer.holding[0] = 4321
    for i, name in enumerate(MANGLED):
        ioc.wait_value(f"in{i}", 4321)
        ioc.wait_alarm(f"in{i}", "NO_ALARM")
        assert ioc.get(f"wrong{i}") == 0, name
    assert ioc.log_count("sevr=") < 20 * len(MANGLED), ioc.log


def spoiler(seed):
    """Changes, takes away and adds bytes at random."""
    chance = random.Random(seed)

    def spoil(_, frame):
        data = bytearray(frame)
        for _ in range(chance.randrange(3)):
            data[chance.randrange(len(data))] = chance.randrange(256)
        if chance.randrange(4) == 0:
            del data[chance.randrange(len(data)):]
        return bytes(data) + chance.randbytes(chance.choice((0, 0, 0, 1, 7, 300)))
    return spoil


def test_random_answers(new_modbus, new_ioc):
    """answers with random bytes changed, missing and added: the IOC lives, and all is good afterwards"""
    peers = [new_modbus(size=64) for _ in range(8)]
    ioc = new_ioc("\n".join(peer.configure("holding 0 10 every 10, coils 0 30 every 10", "holding 20 10",
                                           name=f"PLC{i}", timeout=30) for i, peer in enumerate(peers)),
                  probes(8) + "".join(f"""
        record(longout, "$(P)out{i}") {{ field(DTYP, "S7plc") field(OUT, "@PLC{i}/0 T=INT16") }}
        """ for i in range(8)))
    for i, peer in enumerate(peers):
        ioc.wait_alarm(f"in{i}", "NO_ALARM")
        peer.mangle = spoiler(i)
    marks = [peer.mark() for peer in peers]
    for value in range(10):
        for i in range(8):
            ioc.put(f"out{i}", value)
    for peer, mark in zip(peers, marks):
        peer.wait_requests(8, mark)
    for peer in peers:
        peer.mangle = None
        peer.holding[0] = 4321
    for i, peer in enumerate(peers):
        ioc.wait_value(f"in{i}", 4321)
        ioc.wait_alarm(f"in{i}", "NO_ALARM")
        ioc.put(f"out{i}", 99)
        until_equal(lambda: peer.holding[20], 99)
        ioc.wait_alarm(f"out{i}", "NO_ALARM")


def test_answer_in_pieces(new_modbus, new_ioc):
    """an answer that comes byte by byte is a good one"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure("holding 0 20 every 20", timeout=20000), PROBE)
    ioc.wait_alarm("in", "NO_ALARM")

    def bytewise(_, frame):
        handler = peer.handlers[-1]
        for byte in frame:
            handler.transport.write(bytes([byte]))
        return b""
    peer.mangle = bytewise
    for value in range(1, 20):
        peer.holding[0] = value
        ioc.wait_value("in", value)
    assert ioc.severity("in") == "NO_ALARM" and peer.connections == 1


def probes(count):
    """PROBE for PLC0, PLC1, ...: records in0, in1, ..."""
    return "".join(PROBE.replace("$(P)in", f"$(P)in{i}").replace("@PLC", f"@PLC{i}") for i in range(count))


def test_wrong_unit(new_modbus, new_ioc):
    """another unit than the PLC's (answer: exception 10 or 11, or none): the alarm says it, no other harm"""
    codes = [0, 10, 11]
    peers = [new_modbus(size=16, unit=7, unit_code=code) for code in codes]
    ioc = new_ioc("\n".join(peer.configure("holding 0 10", name=f"PLC{i}", unit=8, timeout=30000 if code else 100)
                            for i, (peer, code) in enumerate(zip(peers, codes))), probes(3))
    for i, code in enumerate(codes):
        if code:
            assert "gateway" in ioc.wait_alarm(f"in{i}", "INVALID", "READ", f"exception {code}")[2]
            assert peers[i].connections == 1
        else:
            ioc.wait_alarm(f"in{i}", "INVALID", "COMM", ask=True)
            ioc.wait_log("no answer for 100 ms")
            peers[i].wait_connected(3)
        assert {r.unit for r in peers[i].requests} == {8}
        peers[i].unit = 8
        ioc.wait_alarm(f"in{i}", "NO_ALARM")


def test_units(new_modbus, new_ioc):
    """the PLC is asked for the unit that is configured, 0 to 255"""
    units = [0, 1, 17, 247, 248, 255]
    peers = [new_modbus(size=16, unit=unit) for unit in units]
    ioc = new_ioc("\n".join(peer.configure("holding 0 10", name=f"PLC{i}", unit=peer.unit)
                            for i, peer in enumerate(peers)), probes(len(units)))
    for i, unit in enumerate(units):
        ioc.wait_alarm(f"in{i}", "NO_ALARM")
        assert {r.unit for r in peers[i].requests} == {unit}


# --- A PLC that is away, or silent ---------------------------------------------------------------

AWAY = PROBE + """
record(longin, "$(P)slow") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT16") field(SCAN, "1 second") }
record(bi, "$(P)stat") { field(DTYP, "S7plc stat") field(INP, "@PLC") field(SCAN, "I/O Intr") }
record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT16") }
record(calc, "$(P)clock") { field(SCAN, ".1 second") field(INPA, "$(P)clock") field(CALC, "A+1") field(FLNK, "$(P)scanned") }
record(longin, "$(P)scanned") { field(DTYP, "S7plc") field(INP, "@PLC/0") }
"""


def nothing_waits(ioc):
    """All that an operator does, in much less time than the PLC is given to answer."""
    begin = time.monotonic()
    for value in range(1, 51):
        ioc.put("out", value, wait=False)  # who waits for the end of it waits for the PLC
        assert ioc.get("out") == value
        ioc.process_record("in")
    for command in ("dbior s7plc 3", "s7plcReport PLC 2", "s7plcShow PLC", f"dbpr {ioc.P}out 4"):
        assert ioc.command(command)
    clock = ioc.get("clock")
    until(lambda: ioc.get("clock") >= clock + 5, "periodic scans")
    assert time.monotonic() - begin < 30  # s; the PLC has 60 to answer


def test_silent(new_modbus, new_ioc):
    """while a request has no answer nothing in the IOC waits, and exit does not either"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure("holding 0 10", "holding 0 10", timeout=60000), AWAY)
    ioc.wait_alarm("in", "NO_ALARM")
    peer.silent = True
    asked = peer.answers
    until(lambda: peer.mark() > asked, "a request that gets no answer")
    nothing_waits(ioc)
    assert peer.connections == 1 and "no answer" not in ioc.log
    begin = time.monotonic()
    assert ioc.exit() == 0
    assert time.monotonic() - begin < 30


def test_timeout(new_modbus, new_ioc):
    """no answer for requestTimeout: the connection is given up, alarms say why, data is back with the PLC"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure("holding 0 10 every 20", "holding 20 10", timeout=200), AWAY)
    ioc.wait_alarm("in", "NO_ALARM")
    peer.silent = True
    ioc.wait_log("no answer for 200 ms")
    ioc.wait_alarm("in", "INVALID", "COMM")
    peer.wait_connected(3)
    ioc.wait_alarm("slow", "INVALID", "COMM")
    until(lambda: ioc.put("out", 99) or ioc.severity("out") == "INVALID", "an alarm at out")
    assert ioc.log_count("sevr=") < 8, ioc.log
    peer.silent = False
    peer.holding[0] = 8
    ioc.wait_value("in", 8)
    ioc.wait_alarm("in", "NO_ALARM")
    until_equal(lambda: peer.holding[20], 99)
    ioc.wait_alarm("out", "NO_ALARM")


def test_no_answer_yet(new_modbus, new_ioc):
    """a server that takes the first connection and has not answered yet: AMSG says so"""
    peer = new_modbus()
    peer.silent = True
    ioc = new_ioc(peer.configure("holding 0 10", timeout=60000), PROBE)
    ioc.wait_alarm("in", "INVALID", "COMM", "connected, waiting for first answer", ask=True)


def test_output_connected(new_modbus, new_ioc):
    """outputConnected stays 0 while a server takes connections and answers nothing"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure("holding 0 10", "holding 20 10", timeout=100),
                  'record(longin, "$(P)oc") { field(DTYP, "S7plc stats") '
                  'field(INP, "@PLC/outputConnected") field(SCAN, "I/O Intr") }')
    ioc.wait_value("oc", 1)
    peer.silent = True
    ioc.wait_value("oc", 0)
    seen = ioc.watch("oc")
    peer.wait_connected(peer.connections + 8)
    ioc.get("oc")
    assert set(seen) == {0}, seen
    peer.silent = False
    until(lambda: seen[-1] == 1, lambda: f"outputConnected is {seen}")


def test_black_hole(new_ioc, black_hole):
    """an address that swallows every packet: nothing waits, and the alarms say so"""
    ioc = new_ioc(f'modbusplcConfigure("PLC", "127.0.0.1", {black_hole.port}, 1, "holding 0 10", "holding 0 10", 60000)', AWAY)
    ioc.wait_log("does not answer")
    nothing_waits(ioc)
    ioc.wait_alarm("in", "INVALID", "COMM", "PLC does not answer", ask=True)
    assert ioc.alarm("out")[:2] == ("INVALID", "COMM")
    begin = time.monotonic()
    assert ioc.exit() == 0
    assert time.monotonic() - begin < 30


def test_restarts(new_modbus, new_ioc):
    """the PLC is switched off and on five times, and the data is back each time"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure("holding 0 10 every 20", "holding 20 10"), AWAY)
    ioc.wait_alarm("in", "NO_ALARM")
    for number in range(1, 6):
        peer.power_off()
        ioc.wait_value("stat", 0)
        ioc.wait_alarm("in", "INVALID", "COMM")
        peer.holding[0] = number
        peer.power_on()
        ioc.wait_value("in", number)
        ioc.wait_alarm("in", "NO_ALARM")
        assert ioc.get("stat") == 1
    assert peer.written() == set()


def test_closed_by_plc(new_modbus, new_ioc):
    """a PLC that closes the connection while nobody asks: connected again, without alarm or word"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure("holding 0 10 every 20", "holding 20 10"), AWAY)
    ioc.wait_alarm("in", "NO_ALARM")
    peer.hang_up()
    peer.wait_connected(2)
    peer.holding[0] = 77
    ioc.wait_value("in", 77)
    assert ioc.severity("in") == "NO_ALARM"
    assert ioc.log_count("closed by PLC") == 0


def test_exit_while_away(new_modbus, new_ioc):
    """exit while the PLC is off"""
    peer = new_modbus()
    peer.power_off()
    ioc = new_ioc(peer.configure("holding 0 10", "holding 0 10"), AWAY)
    ioc.wait_log("refused")
    ioc.put("out", 5)
    assert ioc.exit() == 0


@pytest.mark.parametrize("code", [5, 6])
def test_exit_while_busy(new_modbus, new_ioc, code):
    """exit, six times, while three PLCs answer that they are busy (exception {code})"""
    peers = [new_modbus() for _ in range(3)]
    for peer in peers:
        peer.refuse((1, 2, 3, 4), 0, 65536, code=code)
    for turn in range(6):
        marks = [peer.mark() for peer in peers]
        ioc = new_ioc("\n".join(peer.configure("holding 0 4", "holding 100 4", name=name)
                                for peer, name in zip(peers, ("PLC", "B", "C"))), AWAY)
        for peer, mark in zip(peers, marks):
            peer.wait_requests(2 + turn, mark)
        assert ioc.exit() == 0


def test_exit_with_puts(new_modbus, new_ioc):
    """exit while 1,000 puts wait for a PLC that answers no more"""
    peer = new_modbus()
    db = "".join(f'record(longout, "$(P)o{i}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{2 * i}") }}\n'
                 for i in range(1000))
    ioc = new_ioc(peer.configure("holding 0 4", "holding 500 1000", timeout=60000), AWAY + db)
    ioc.wait_alarm("in", "NO_ALARM")
    mark = peer.mark()
    peer.silent = True
    ioc.command("\n".join(f"dbpf {ioc.P}o{i} {i}" for i in range(1000)))
    until(lambda: peer.since(mark), "a request that gets no answer")
    assert ioc.exit() == 0


# --- What users type -----------------------------------------------------------------------------

WRONG = {
    "no arguments": "",
    "only a name": "B",
    "no port": "B, 127.0.0.1",
    "an empty name": '"", 127.0.0.1, 502, 1, "holding 0 1", ""',
    "the name of another PLC": 'PLC, 127.0.0.1, 502, 1, "holding 0 1", ""',
    "a host with a blank": 'B, "two words", 502, 1, "holding 0 1", ""',
    "port 70000": 'B, 127.0.0.1, 70000, 1, "holding 0 1", ""',
    "port -1": 'B, 127.0.0.1, -1, 1, "holding 0 1", ""',
    "unit 256": 'B, 127.0.0.1, 502, 256, "holding 0 1", ""',
    "unit -1": 'B, 127.0.0.1, 502, -1, "holding 0 1", ""',
    "unit one": 'B, 127.0.0.1, 502, one, "holding 0 1", ""',
    "neither inputs nor outputs": 'B, 127.0.0.1, 502, 1, "", ""',
    "a timeout of 5 ms": 'B, 127.0.0.1, 502, 1, "holding 0 1", "", 5',
    "a timeout of an hour": 'B, 127.0.0.1, 502, 1, "holding 0 1", "", 3600000',
    "no such table": 'B, 127.0.0.1, 502, 1, "registers 0 1"',
    "no start": 'B, 127.0.0.1, 502, 1, "holding"',
    "no count": 'B, 127.0.0.1, 502, 1, "holding 0"',
    "count 0": 'B, 127.0.0.1, 502, 1, "holding 0 0"',
    "count -3": 'B, 127.0.0.1, 502, 1, "holding 0 -3"',
    "beyond 65535": 'B, 127.0.0.1, 502, 1, "holding 65530 7"',
    "start 65536": 'B, 127.0.0.1, 502, 1, "coils 65536 1"',
    "start -1": 'B, 127.0.0.1, 502, 1, "coils -1 1"',
    "start 4x": 'B, 127.0.0.1, 502, 1, "holding 4x 1"',
    "at nowhere": 'B, 127.0.0.1, 502, 1, "holding 0 1 at"',
    "at -2": 'B, 127.0.0.1, 502, 1, "holding 0 1 at -2"',
    "at 2 GB": 'B, 127.0.0.1, 502, 1, "holding 0 1 at 2147483648"',
    "every 0": 'B, 127.0.0.1, 502, 1, "holding 0 1 every 0"',
    "every hour and more": 'B, 127.0.0.1, 502, 1, "holding 0 1 every 3600001"',
    "every day": 'B, 127.0.0.1, 502, 1, "holding 0 1 every day"',
    "every twice": 'B, 127.0.0.1, 502, 1, "holding 0 1 every 10 every 20"',
    "one word too many": 'B, 127.0.0.1, 502, 1, "holding 0 1 often"',
    "overlap": 'B, 127.0.0.1, 502, 1, "holding 0 10, input 0 10 at 18"',
    "two commas": 'B, 127.0.0.1, 502, 1, "holding 0 10,, input 0 10"',
    "a comma at the end": 'B, 127.0.0.1, 502, 1, "holding 0 10,"',
    "outputs to input registers": 'B, 127.0.0.1, 502, 1, "", "input 0 10"',
    "outputs to discrete inputs": 'B, 127.0.0.1, 502, 1, "", "discrete 0 10"',
    "outputs with every": 'B, 127.0.0.1, 502, 1, "", "holding 0 10 every 100"',
    "outputs that overlap": 'B, 127.0.0.1, 502, 1, "", "holding 0 10, coils 0 8 at 0"',
    "a range of 10,000 characters": 'B, 127.0.0.1, 502, 1, "' + "holding " * 1250 + '"',
}


def test_wrong_arguments(new_modbus, new_ioc):
    """modbusplcConfigure with wrong arguments: one error line each, the IOC and its other PLC live"""
    peer = new_modbus()
    lines = "".join(f"modbusplcConfigure {wrong}\n" for wrong in WRONG.values())
    ioc = new_ioc(f"{peer.configure('holding 0 10')}\n{lines}", PROBE)
    errors = errors_in(ioc.log)
    assert len(errors) == len(WRONG), "\n".join(errors)
    for name, error in zip(WRONG, errors):
        assert "modbusplcConfigure" in error, (name, error)
        assert "allowed" in error or "once" in error, (name, error)
    peer.holding[0] = 7
    ioc.wait_value("in", 7)


RANGES = {
    "capitals and blanks": " Holding  0   10 ,INPUT 0 4 EVERY 50 ",
    "hex": "holding 0x0 0xA every 0x32",
    "more gaps than registers": "holding 0 10, input 0 1 at 1000",
    "the whole table": "holding 0 65536 every 1000",
}


def test_good_ranges(new_modbus, new_ioc):
    """ranges with capitals and blanks, in hex, with large gaps, and of a whole table"""
    peers = [new_modbus(size=65536 if "65536" in text else 1008) for text in RANGES.values()]
    ioc = new_ioc("\n".join(peer.configure(text, name=f"PLC{i}")
                            for i, (peer, text) in enumerate(zip(peers, RANGES.values()))), probes(len(peers)))
    for i, peer in enumerate(peers):
        peer.holding[0] = 7
        ioc.wait_value(f"in{i}", 7)
    assert errors_in(ioc.log) == []


def test_short_forms(new_modbus, new_ioc):
    """modbusplcConfigure without outputs, without a time-out, with an empty unit of 0"""
    peer = new_modbus()
    peer.holding[0] = 7
    ioc = new_ioc(f'modbusplcConfigure PLC 127.0.0.1 {peer.port} 1 "holding 0 2"', PROBE)
    ioc.wait_value("in", 7)
    assert {r.function for r in peer.requests} == {3}


def test_word_order_that_means_nothing(new_modbus, new_ioc):
    """W= on two bytes or a text is taken with a warning; W=middle is refused with what is allowed"""
    peer = new_modbus()
    peer.holding[0] = 0x4142
    ioc = new_ioc(peer.configure("holding 0 10"), """
        record(longin, "$(P)short") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=INT16 W=low") field(SCAN, "I/O Intr") }
        record(stringin, "$(P)text") { field(DTYP, "S7plc") field(INP, "@PLC/0 L=2 W=low") field(SCAN, "I/O Intr") }
        record(ai, "$(P)bad") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=REAL32 W=middle") field(SCAN, "I/O Intr") }
        """)
    ioc.wait_value("short", 0x4142)
    assert ioc.text("text") == "AB"
    lines = ioc.log.splitlines()
    for name in "short", "text":
        assert any(f'{ioc.P}{name}"' in line and "W=" in line for line in lines), ioc.log
    assert any(f'{ioc.P}bad"' in line and "high" in line and "low" in line for line in lines)
    ioc.process_record("bad")
    assert ioc.alarm("bad")[:2] == ("INVALID", "LINK")


# --- Reports and statistics ------------------------------------------------------------------------

STATS = "".join(f'record(ai, "$(P){name}") {{ field(DTYP, "S7plc stats") field(INP, "@PLC/{name}") '
                f'field(SCAN, ".1 second") field(PREC, "3") }}\n'
                for name in ("requests", "exceptions", "requestTimeouts", "requestLatency",
                             "requestLatencyMax", "blocksIn", "blocksOut", "connects"))

OUT = 'record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/0 T=INT16") }\n'


def test_statistics(new_modbus, new_ioc):
    """statistics count requests, exceptions and time-outs, and time the answers"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure("holding 0 10 every 20, input 0 10 every 20", "holding 40 10", timeout=300),
                  PROBE + STATS + OUT)
    until(lambda: ioc.get("requests") >= 20, "20 requests")
    assert ioc.get("requests") <= peer.mark()
    assert ioc.get("exceptions") == ioc.get("requestTimeouts") == 0
    assert 0 < ioc.get("requestLatency") <= ioc.get("requestLatencyMax")
    assert ioc.get("blocksIn") > 0
    assert ioc.get("blocksOut") == 0
    for value in 1, 2, 3:
        ioc.put("out", value)
        until_equal(lambda: ioc.get("blocksOut"), value)
    rule = peer.refuse((6, 16), 40)
    ioc.put("out", 4)
    ioc.wait_alarm("out", "INVALID", "WRITE")
    peer.refuse_no_more(rule)
    ioc.put("out", 5)
    until_equal(lambda: peer.holding[40], 5)
    until_equal(lambda: ioc.get("blocksOut"), 4)  # the refused one does not count
    peer.delay = 0.05
    until(lambda: ioc.get("requestLatency") >= 50, "latency of a slow PLC")
    assert ioc.get("requestLatencyMax") >= 50
    peer.delay = 0
    rule, refused = peer.refuse(4, 5), ioc.get("exceptions")
    until(lambda: ioc.get("exceptions") >= refused + 3, "exceptions")
    peer.refuse_no_more(rule)
    peer.silent = True
    until(lambda: ioc.get("requestTimeouts") >= 1, "a time-out")
    peer.silent = False
    until(lambda: ioc.get("connects") >= 2, "a new connection")
    ioc.wait_alarm("in", "NO_ALARM")


def puts_to_a_slow_plc(new_modbus, new_ioc, count, inputs, outputs, heartbeat, *options):
    """So many puts to a PLC that takes 0.1 s for each request; returns the requests from then on."""
    peer = new_modbus()
    db = "".join(f'record(longout, "$(P)o{n}") {{ field(DTYP, "S7plc") field(OUT, "@PLC/{4 * n} T=INT16") }}\n'
                 for n in range(count))
    ioc = new_ioc(peer.configure(inputs, outputs) + "".join(f"\ns7plcSetOption PLC {option}" for option in (
        "complete sent", "heartbeatRegister 300", f"heartbeat {heartbeat}", *options)), PROBE + db)
    ioc.wait_alarm("in", "NO_ALARM")
    until(lambda: 300 in peer.written(), "a heartbeat")
    peer.delay = 0.1
    mark = peer.mark()
    for n in range(count):
        ioc.put(f"o{n}", n + 1)
    until_equal(lambda: [peer.holding[100 + 2 * n] for n in range(count)], list(range(1, count + 1)))
    return peer.requests[mark:]


def test_reads_between_puts(new_modbus, new_ioc):
    """thirty puts to a PLC that takes 0.1 s for each: it is read between them, and its heartbeat goes on"""
    all_of_them = puts_to_a_slow_plc(new_modbus, new_ioc, 30, "holding 0 10 every 100", "holding 100 60", 500)
    requests = [r for r in all_of_them if r.start != 300]
    puts = [i for i, r in enumerate(requests) if r.writes]
    assert len(puts) == 30
    in_a_row = longest = 0
    for request in requests[puts[0]:puts[-1]]:
        in_a_row = in_a_row + 1 if request.writes else 0
        longest = max(longest, in_a_row)
    assert longest <= 5, longest
    assert len(all_of_them) - len(requests) >= 3  # heartbeats


def test_inputs_of_a_slow_device(new_modbus, new_ioc):
    """a slow device, with puts, a heartbeat and outputs in three requests (track=on): between two reads of the inputs are one lot of puts and one other request"""
    requests = puts_to_a_slow_plc(new_modbus, new_ioc, 20, "holding 0 10 every 50",
                                  "holding 100 40, holding 200 10, coils 0 16", 250, "track on")
    kinds = "".join("H" if r.start == 300 else "p" if r.writes else "i" if r.key == (3, 0, 10) else "o"
                    for r in requests)
    between = kinds[kinds.index("p"):kinds.rindex("p")].split("i")[1:-1]
    assert len(between) >= 15, kinds
    assert not [b for b in between if b.count("p") > 1 or len(b) > 2], kinds
    assert kinds.count("H") >= 3 and kinds.count("o") >= 6, kinds


def test_reports(new_modbus, new_ioc):
    """s7plcReport, dbior and s7plcShow tell what is particular to Modbus"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure("holding 7 10, coils 0 16", "holding 40 5", unit=9), PROBE + """
        record(longout, "$(P)out") { field(DTYP, "S7plc") field(OUT, "@PLC/2 T=INT16") }
        """)
    ioc.wait_alarm("in", "NO_ALARM")
    ioc.put("out", 55)
    until_equal(lambda: peer.holding[41], 55)
    for command in "s7plcReport PLC 1", "dbior s7plc 1":
        report = ioc.command(command)
        assert "Modbus" in report and "unit 9" in report, report
        for word in ("requests", "exceptions", "holding", "coils"):
            assert word in report, report
        assert "holding 7 to 16" in report and "holding 40 to 44" in report, report
    show = ioc.command("s7plcShow PLC")
    assert f"{ioc.P}in" in show and f"{ioc.P}out" in show


def test_log_io(new_modbus, new_ioc):
    """log=io: `in` is the input image whenever it is filled anew, `put` what a record has written, and there is no `out`"""
    peer = new_modbus()
    ioc = new_ioc(peer.configure("holding 0 2 every 50", "holding 20 2") + "\ns7plcSetOption PLC log io", AWAY)
    ioc.wait_log("s7plc PLC: in    0: 00 00 00 00")
    peer.holding[0] = 0x0102
    ioc.wait_log("s7plc PLC: in    0: 01 02 00 00")
    ioc.put("out", 7)
    ioc.wait_log("s7plc PLC: put    0: 00 07")
    until_equal(lambda: peer.holding[20], 7)
    assert "s7plc PLC: out" not in ioc.log
