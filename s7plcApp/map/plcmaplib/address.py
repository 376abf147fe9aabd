"""Places in PLC memory: DB10.DBD0, DB10.DBX6.0, M4.3, MW10, %QB7; or a symbol of the PLC.
Pure."""
import re

from .types import Elementary

AREAS = {"DB": 0x84, "M": 0x83, "I": 0x81, "Q": 0x82}
WIDTHS = {"X": 1, "B": 1, "W": 2, "D": 4}
MAX_DB = 65535
MAX_BYTE = 65535

_DB = re.compile(r"^%?DB(\d+)\.DB([XBWD])(\d+)(?:\.(\d+))?$", re.I)
_AREA = re.compile(r"^%?([MIQEA])([BWDX]?)(\d+)(?:\.(\d+))?$", re.I)
_PERIPHERAL = re.compile(r"^%?P[IQEA][BWD]?\d+$|^%[IQEA][BWD]?\d+:P$", re.I)
# what looks like an address but is none must not pass for a symbol
_LIKE = re.compile(r"^(%|DB\d+[.,]|P#|[MIQEA][BWD]?\d)", re.I)


class AddressProblem(Exception):
    """str() says what is wrong and what is allowed."""


class Address:
    """An absolute place, or (area "") a symbol. Bits only for BOOL."""
    __slots__ = ("area", "db", "byte", "bit", "width", "symbol")

    def __init__(self, area="", db=0, byte=0, bit=None, width=None, symbol=""):
        self.area = area
        self.db = db
        self.byte = byte
        self.bit = bit
        self.width = width
        self.symbol = symbol

    def plus(self, byte, bit=None):
        """A place behind this one; of a symbol itself."""
        if not self.area:
            return self
        return Address(self.area, self.db, self.byte + byte, bit)

    def text(self, size, bit=None):
        """As it is written for a value of so many bytes."""
        if not self.area:
            return self.symbol
        bit = self.bit if bit is None else bit
        if bit is not None:
            return "DB%d.DBX%d.%d" % (self.db, self.byte, bit) if self.area == "DB" \
                else "%s%d.%d" % (self.area, self.byte, bit)
        letter = {1: "B", 2: "W", 4: "D"}.get(size, "B")
        if self.area == "DB":
            return "DB%d.DB%s%d" % (self.db, letter, self.byte)
        return "%s%s%d" % (self.area, letter, self.byte)

    def block(self):
        """The block it is in, for people and for sorting."""
        return "DB%d" % self.db if self.area == "DB" else self.area

    def any_pointer(self, count):
        """The ten bytes of a Siemens ANY pointer to `count` bytes from here."""
        bits = self.byte * 8
        return (bytes([0x10, 2]) + count.to_bytes(2, "big") + self.db.to_bytes(2, "big") +
                bytes([AREAS[self.area]]) + bits.to_bytes(3, "big"))


def parse_address(text):
    """An Address; texts that do not look like one are symbols. Raises AddressProblem."""
    symbol = " ".join(text.split())
    text = symbol if text.startswith('"') else symbol.replace(" ", "")
    m = _DB.match(text)
    if m:
        return _made("DB", int(m.group(1)), m.group(2).upper(), m.group(3), m.group(4), text)
    if _PERIPHERAL.match(text):
        raise AddressProblem('"%s" is peripheral memory, which no block can show; allowed: its '
                             'process image, such as IW256' % text)
    m = _AREA.match(text)
    if m:
        area = {"E": "I", "A": "Q"}.get(m.group(1).upper(), m.group(1).upper())
        letter = m.group(2).upper()
        if letter in ("", "X") and m.group(4) is None:
            raise AddressProblem('"%s" is no address: a bit needs its number, such as M4.3' % text)
        return _made(area, 0, letter or "X", m.group(3), m.group(4), text)
    if _LIKE.match(text):
        raise AddressProblem('"%s" is no address; allowed: DB10.DBX4.3 DB10.DBB4 DB10.DBW4 '
                             'DB10.DBD4 M4.3 MB4 MW4 MD4, I and Q likewise, or a symbol' % text)
    return Address(symbol=symbol)


def misfit(kind, address):
    """Why a value of this type cannot lie there, or None. DBX for bits, DBW for two bytes, ...;
    eight bytes begin at a DBB; what begins a text, array or structure is free."""
    if isinstance(kind, Elementary) and kind.kind == "bool":
        return "a BOOL needs a bit, such as DB10.DBX4.3 or M4.3" if address.bit is None else None
    if address.bit:
        return "only a BOOL lies in a single bit, not %s" % kind
    if isinstance(kind, Elementary) and address.bit is None and \
            address.width != (kind.size if kind.size in (1, 2, 4) else 1):
        return "%s has %d bytes: write %s" % (kind, kind.size, address.text(kind.size))
    return None


def _made(area, db, letter, byte, bit, text):
    byte = int(byte)
    if byte > MAX_BYTE or not 0 <= db <= MAX_DB or (area == "DB" and db == 0):
        raise AddressProblem('"%s": allowed are DB1 to DB%d and bytes up to %d'
                             % (text, MAX_DB, MAX_BYTE))
    if letter == "X":
        if bit is None:
            raise AddressProblem('"%s" is no address: DBX needs a bit, such as DBX4.3' % text)
        if int(bit) > 7:
            raise AddressProblem('"%s": a byte has bits 0 to 7' % text)
        return Address(area, db, byte, int(bit), 1)
    if bit is not None:
        raise AddressProblem('"%s" is no address: only DBX and M4.3 have a bit' % text)
    return Address(area, db, byte, None, WIDTHS[letter])
