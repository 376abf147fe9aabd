"""Where a value may lie among the ranges of a Modbus PLC: not in a gap, not in bits that no coil has, not in two
ranges; told when the IOC starts and when a link changes."""
import pytest

from docblocks import blocks
from waiting import until

IN = "holding 0 10, holding 10 2, holding 20 10 at 30, coils 0 12, discrete 0 3 at 60"
OUT = "holding 100 3, holding 200 3 at 8, coils 0 3, holding 300 4 at 20, coils 8 8"

IN_BYTES = "bytes 0 to 19, 20 to 23, 30 to 49, 50 to 51, 60 to 60"
OUT_BYTES = "bytes 0 to 5, 8 to 13, 14 to 14, 20 to 27, 28 to 28"

# what: record type, link, other fields, the message; "": the link is good
LINKS = {
    "an output in a gap": ("longout", "@PLC/6", "", f"bytes 6 to 7 are in no range; allowed: {OUT_BYTES}"),
    "one half in a gap": ("ao", "@PLC/4 T=UINT32", "", f"bytes 6 to 7 are in no range; allowed: {OUT_BYTES}"),
    "one byte in a gap": ("longout", "@PLC/15 T=UINT8", "", f"byte 15 is in no range; allowed: {OUT_BYTES}"),
    "a gap in a 64-bit value": ("int64out", "@PLC/4 T=INT64", "", f"bytes 6 to 7 are in no range; allowed: {OUT_BYTES}"),
    "a text over a gap": ("stringout", "@PLC/0 L=10", "", f"bytes 6 to 7 are in no range; allowed: {OUT_BYTES}"),
    "an array over a gap": ("aao", "@PLC/0", 'field(FTVL, "SHORT") field(NELM, "6")',
                            f"bytes 6 to 7 are in no range; allowed: {OUT_BYTES}"),
    "a bit in a gap": ("bo", "@PLC/6 T=UINT16 B=3", "", f"byte 7 is in no range; allowed: {OUT_BYTES}"),
    "bits in a gap": ("mbbo", "@PLC/6 T=UINT16", 'field(NOBT, "4")', f"byte 7 is in no range; allowed: {OUT_BYTES}"),
    "direct bits in a gap": ("mbboDirect", "@PLC/6 T=UINT16", 'field(NOBT, "9")',
                             f"bytes 6 to 7 are in no range; allowed: {OUT_BYTES}"),
    "direct bits without NOBT in a gap": ("mbboDirect", "@PLC/6 T=UINT16", "",
                                          f"bytes 6 to 7 are in no range; allowed: {OUT_BYTES}"),
    "a bit behind the coils": ("bo", "@PLC/14 T=UINT8 B=5", "", "byte 14 has no bit 5; allowed: bits 0 to 2, which are coils"),
    "bits behind the coils": ("mbbo", "@PLC/14 T=UINT8", 'field(NOBT, "4")',
                              "byte 14 has no bit 3; allowed: bits 0 to 2, which are coils"),
    "a value in registers and coils": ("ao", "@PLC/12 T=UINT32", "", f"byte 15 is in no range; allowed: {OUT_BYTES}"),
    "a value in two tables": ("ao", "@PLC/25 T=UINT32", "",
                              f"bytes 25 to 28 are in two ranges; allowed: a value in one of them: {OUT_BYTES}"),
    "a coil": ("bo", "@PLC/14 T=UINT8 B=2", "", ""),
    "bits of coils": ("mbbo", "@PLC/14 T=UINT8", 'field(NOBT, "3")', ""),
    "a number that has more bits than coils": ("longout", "@PLC/14 T=UINT8", "", ""),  # with a warning, below
    "all coils of a byte": ("longout", "@PLC/28 T=UINT8", "", ""),
    "a bit in a word that goes on in a gap": ("bo", "@PLC/14 T=UINT16 B=9", "", ""),
    "registers up to the end of a range": ("int64out", "@PLC/20 T=INT64", "", ""),
    "an input in a gap": ("longin", "@PLC/26", "", f"bytes 26 to 27 are in no range; allowed: {IN_BYTES}"),
    "an input bit in a gap": ("bi", "@PLC/52 T=UINT8 B=0", "", f"byte 52 is in no range; allowed: {IN_BYTES}"),
    "input bits in a gap": ("mbbi", "@PLC/52 T=UINT8", 'field(NOBT, "2")', f"byte 52 is in no range; allowed: {IN_BYTES}"),
    "an input bit behind the coils": ("bi", "@PLC/51 T=UINT8 B=4", "",
                                      "byte 51 has no bit 4; allowed: bits 0 to 3, which are coils"),
    "an input bit behind discrete inputs": ("mbbiDirect", "@PLC/60 T=UINT8", 'field(NOBT, "8")',
                                            "byte 60 has no bits 3 to 7; allowed: bits 0 to 2, which are discrete inputs"),
    "an input in two ranges that are neighbours": (
        "ai", "@PLC/18 T=REAL32", "", f"bytes 18 to 21 are in two ranges; allowed: a value in one of them: {IN_BYTES}"),
    "an input in two tables": ("int64in", "@PLC/44 T=INT64", "",
                               f"bytes 44 to 51 are in two ranges; allowed: a value in one of them: {IN_BYTES}"),
    "an input text in two ranges": ("stringin", "@PLC/10 L=12", "",
                                    f"bytes 10 to 21 are in two ranges; allowed: a value in one of them: {IN_BYTES}"),
    "an input array in two ranges": ("waveform", "@PLC/0", 'field(FTVL, "SHORT") field(NELM, "12")',
                                     f"bytes 0 to 23 are in two ranges; allowed: a value in one of them: {IN_BYTES}"),
    "an input array over a gap": ("aai", "@PLC/20", 'field(FTVL, "LONG") field(NELM, "4")',
                                  f"bytes 24 to 29 are in no range; allowed: {IN_BYTES}"),
    "an input number with bits that no coil has": ("longin", "@PLC/50 T=UINT16", "", ""),
    "an input array up to the end of a range": ("waveform", "@PLC/30", 'field(FTVL, "SHORT") field(NELM, "10")', ""),
    "a read-back in a gap": ("longout", "@PLC/0 R=26", "", f"bytes 26 to 27 are in no range; allowed: {IN_BYTES}"),
    "a read-back of one bit behind the coils": ("bo", "@PLC/14 T=UINT8 B=2 R=52", "",
                                                f"byte 52 is in no range; allowed: {IN_BYTES}"),
}
OUTPUTS = ("longout", "int64out", "ao", "bo", "mbbo", "mbboDirect", "stringout", "aao")


def field(kind):
    return "OUT" if kind in OUTPUTS else "INP"


def record(name, kind, link, more):
    return f'record({kind}, "$(P){name}") {{ field(DTYP, "S7plc") field({field(kind)}, "{link}") {more} }}\n'


def short(message):
    """What fits into AMSG: what is wrong, without what is allowed."""
    return message.split(";")[0]


@pytest.mark.parametrize("track", ["on", "off"])
def test_links(new_modbus, new_ioc, track):
    """links into gaps, spare bits and two ranges are refused, others taken (track={track})"""
    plc = new_modbus()
    ioc = new_ioc(f"{plc.configure(IN, OUT)}\ns7plcSetOption PLC track {track}",
                  "".join(record(f"r{i}", *LINKS[what][:3]) for i, what in enumerate(LINKS)))
    log = ioc.log.splitlines()
    for i, (what, (kind, link, _, message)) in enumerate(LINKS.items()):
        lines = [n for n, line in enumerate(log) if f'"{ioc.P}r{i}" {field(kind)}:' in line]
        if not message:
            assert lines == [] and ioc.alarm(f"r{i}")[1] != "LINK", what
            continue
        assert [log[n] for n in lines] == [f'S7plc {kind} "{ioc.P}r{i}" {field(kind)}: {message}'], what
        assert log[lines[0] + 1].strip() == link, what
        assert ioc.alarm(f"r{i}") == ("INVALID", "LINK", short(message)), what


def test_links_that_change(new_modbus, new_ioc):
    """the same at run time: a link that changes is refused with the line, and good again with a good one"""
    plc = new_modbus()
    good = {"OUT": "@PLC/20", "INP": "@PLC/0"}
    special = {"stringout": "@PLC/20 L=2", "stringin": "@PLC/0 L=2", "bo": "@PLC/28 T=UINT8 B=0", "int64out": "@PLC/20 T=INT64",
               "aao": "@PLC/20"}
    wrong = {what: row for what, row in LINKS.items() if row[3] and row[0] not in ("aao", "aai", "waveform")}
    ioc = new_ioc(plc.configure(IN, OUT), "".join(
        record(f"r{i}", kind, special.get(kind, good[field(kind)]), more)
        for i, (kind, _, more, _) in enumerate(wrong.values())))
    for i, (what, (kind, link, _, message)) in enumerate(wrong.items()):
        name = f"r{i}"
        assert f'"{ioc.P}{name}" {field(kind)}:' not in ioc.log, what
        ioc.put(f"{name}.{field(kind)}", link)
        until(lambda: f'S7plc {kind} "{ioc.P}{name}" {field(kind)}: {message}' in ioc.log, what)
        assert ioc.alarm(name) == ("INVALID", "LINK", short(message)), what
        ioc.process_record(name)
        assert ioc.alarm(name) == ("INVALID", "LINK", short(message)), what
        ioc.put(f"{name}.{field(kind)}", special.get(kind, good[field(kind)]))
        if field(kind) == "OUT":
            ioc.put(name, "1" if kind == "stringout" else 1)
        ioc.wait_alarm(name, "NO_ALARM", ask=True)
    assert plc.holding[100] == plc.holding[103] == 0


def test_number_of_some_coils(new_modbus, new_ioc):
    """an output number in a byte with less than eight coils: a warning, and the bits that there are are written"""
    plc = new_modbus()
    ioc = new_ioc(plc.configure("", OUT), record("number", "longout", "@PLC/14 T=UINT8", ""))
    assert (f'S7plc longout "{ioc.P}number" warning: OUT: byte 14 has no bits 3 to 7, they are not written; there are: '
            "bits 0 to 2, which are coils") in ioc.log
    ioc.put("number", 0xFD)
    assert [plc.coils[i] for i in range(4)] == [True, False, True, False]


def test_shown_message(new_modbus, new_ioc):
    """the message of docs/modbus.md is what is printed, with its mark at the same place"""
    text = next(b.text for b in blocks() if b.page == "modbus.md" and b.first.startswith("S7plc longout"))
    ioc = new_ioc(new_modbus().configure("", "holding 0 3, holding 10 3 at 8", name="CHILLER"),
                  'record(longout, "CHILLER:SET") { field(DTYP, "S7plc") field(OUT, "@CHILLER/6") }')
    assert text.rstrip() in ioc.log
