"""Texts in registers, in every order of their characters: by link and by the option textOrder, read,
written and taken over from the PLC. pymodbus holds the registers; the orders are spelled out here."""
import pytest

from ioc import errors_in
from waiting import until_equal

# What a text of two registers, ABCD, is in the bytes of the registers, the upper half first.
ORDERS = {"ABCD": "ABCD", "BADC": "BADC", "CDAB": "CDAB", "DCBA": "DCBA", "A0": "A\0B\0C\0D\0",
          "0A": "\0A\0B\0C\0D"}
TEXT = "Pump 7 of 12"  # three times four characters, all others behind it are 0


def in_registers(text, order, size):
    """The bytes of `size` in which a text stands."""
    pattern = ORDERS[order]
    room = text.ljust(size, "\0")
    data = "".join("".join(room[i:i + 4]["ABCD".index(c)] if c in "ABCD" else "\0" for c in pattern)
                   for i in range(0, size, 4))
    return data[:size].encode("latin1")


def size_of(order, characters):
    return characters * (2 if order in ("A0", "0A") else 1)


def records(order, link):
    """Records of every type that has texts, 100 bytes apart; link: what is said of the order."""
    n = size_of(order, 16)
    return f"""
    record(stringin, "$(P)in") {{ field(DTYP, "S7plc") field(INP, "@PLC/0 L={n}{link}") field(SCAN, "I/O Intr") }}
    record(lsi, "$(P)long") {{ field(DTYP, "S7plc") field(INP, "@PLC/0 L={n}{link}") field(SIZV, "120") field(SCAN, "I/O Intr") }}
    record(lsi, "$(P)all") {{ field(DTYP, "S7plc") field(INP, "@PLC/0 {link}") field(SIZV, "41") field(SCAN, "I/O Intr") }}
    record(waveform, "$(P)chars") {{ field(DTYP, "S7plc") field(INP, "@PLC/0 T=STRING L={n}{link}") field(FTVL, "CHAR")
        field(NELM, "16") field(SCAN, "I/O Intr") }}
    record(stringin, "$(P)s7") {{ field(DTYP, "S7plc") field(INP, "@PLC/100 T=S7STRING L=14{link}") field(SCAN, "I/O Intr") }}
    record(stringout, "$(P)out") {{ field(DTYP, "S7plc") field(OUT, "@PLC/0 L={n}{link}") }}
    record(lso, "$(P)longout") {{ field(DTYP, "S7plc") field(OUT, "@PLC/100 L={n}{link}") field(SIZV, "120") }}
    record(aao, "$(P)charsout") {{ field(DTYP, "S7plc") field(OUT, "@PLC/200 T=STRING L={n}{link}") field(FTVL, "CHAR")
        field(NELM, "16") }}
    record(stringout, "$(P)s7out") {{ field(DTYP, "S7plc") field(OUT, "@PLC/300 T=S7STRING L=14{link}") }}
    """


@pytest.mark.parametrize("by", ["link", "option"])
@pytest.mark.parametrize("order", ORDERS)
def test_text_order(new_modbus, new_ioc, order, by):
    """texts in order {order}, said by {by}: read and written on every record type; what the PLC holds is taken"""
    plc, size = new_modbus(), size_of(order, 16)
    plc.holding.put(0, in_registers(TEXT, order, size))
    plc.holding.put(50, in_registers("\x0e\x0c" + TEXT, order, size_of(order, 16)))
    plc.holding.put(100, in_registers("what it holds", order, size))
    lines = [plc.configure("holding 0 100 every 50", "holding 100 200"), "s7plcSetOption PLC track on",
             f"s7plcSetOption PLC textOrder {order if by == 'option' else 'ABCD'}"]
    ioc = new_ioc("\n".join(lines), records(order, f" W={order}" if by == "link" else ""))
    for name in ("in", "long", "all", "s7"):
        until_equal(lambda: ioc.text(name), TEXT)
    until_equal(lambda: bytes(ioc.get("chars")).rstrip(b"\0"), TEXT.encode())
    until_equal(lambda: ioc.text("out"), "what it holds")
    assert plc.writes() == []
    for name, register, put, characters in (("out", 100, "Valve 3", "Valve 3"), ("longout", 150, "A longer 1", "A longer 1"),
                                            ("charsout", 200, [65, 66, 67, 68, 69], "ABCDE"),
                                            ("s7out", 250, "Tank 2", "\x0e\x06Tank 2")):
        ioc.put(name, put)
        until_equal(lambda: plc.holding.bytes(register, size), in_registers(characters, order, size))
        assert ioc.severity(name) == "NO_ALARM"
    plc.holding.put(100, in_registers("by hand", order, size))
    until_equal(lambda: ioc.text("out"), "by hand")
    assert not errors_in(ioc.log) and not plc.errors


def test_text_order_and_numbers(new_modbus, new_ioc):
    """a device with its floats in CDAB and its texts in BADC: wordOrder and textOrder do not touch each other"""
    plc = new_modbus()
    plc.holding.put(0, bytes.fromhex("0000c049") + in_registers("ABCDEF", "BADC", 8))
    ioc = new_ioc("\n".join([plc.configure("holding 0 20 every 50", ""), "s7plcSetOption PLC wordOrder CDAB",
                             "s7plcSetOption PLC textOrder BADC"]), """
    record(ai, "$(P)number") { field(DTYP, "S7plc") field(INP, "@PLC/0 T=REAL32") field(SCAN, "I/O Intr") }
    record(stringin, "$(P)text") { field(DTYP, "S7plc") field(INP, "@PLC/4 L=8") field(SCAN, "I/O Intr") }
    record(stringin, "$(P)plain") { field(DTYP, "S7plc") field(INP, "@PLC/4 L=8 W=ABCD") field(SCAN, "I/O Intr") }
    """)
    ioc.wait_value("number", -3.140625)
    until_equal(lambda: ioc.text("text"), "ABCDEF")
    until_equal(lambda: ioc.text("plain"), "BADCFE")
