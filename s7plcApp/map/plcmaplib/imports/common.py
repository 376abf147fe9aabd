"""What all forms of exports have in common: what they bring, and addresses in their spellings."""
import re

from ..problems import Place, letters
from ..types import ELEMENTARY, ALIASES, Array, Struct, TypeProblem, parse_type


class Item:
    """One value or structure of an export. plc: address or symbol as the map writes it."""
    __slots__ = ("symbol", "plc", "type", "desc", "place")

    def __init__(self, symbol, plc, type_, desc, place):
        self.symbol = symbol
        self.plc = plc
        self.type = type_
        self.desc = desc
        self.place = place


class Source:
    """What a file brings. types: name -> [(field, type, comment, (byte, bit) or None)].
    blocks: numbers of data blocks by name. scope: data blocks that it has completely. keys: of
    the sheet plc, what a map of such symbols needs."""

    def __init__(self, form, **keys):
        self.form = form
        self.keys = keys
        self.items = []
        self.types = {}
        self.blocks = {}
        self.scope = set()
        self.comments = {}  # of members of items, by their whole name in upper case
        self.left_out = 0  # rows that are no values: blocks, timers, ...

    def add(self, symbol, plc, type_, desc, place):
        self.items.append(Item(symbol, plc, type_, " ".join(desc.split()), place))


_SPACES = re.compile(r"\s+")
_SIEMENS = re.compile(r"^%?(P?)([IQMEA])([BWDX]?)(\d+)(?:\.(\d+))?(:P)?$", re.I)
_BLOCK = re.compile(r"^%?(DB|FB|FC|SFC|SFB|OB|UDT|VAT|DI|SDB)(\d+)$", re.I)
_TIMER = re.compile(r"^%?[TCZ](\d+)$", re.I)
_DB = re.compile(r"^%?DB(\d+)\.DB([XBWD])(\d+)(?:\.(\d+))?$", re.I)
GERMAN = {"E": "I", "A": "Q"}


def siemens_address(text):
    """("value", "M4.3"), ("block", "DB60"), ("timer", "T5"), ("peripheral", "IW256") or
    (None, text) of an address in English or German spelling."""
    bare = _SPACES.sub("", text).upper()
    m = _DB.match(bare)
    if m:
        bit = "." + m.group(4) if m.group(4) else ""
        if (m.group(2) == "X") != bool(bit):
            return None, text
        return "value", "DB%s.DB%s%s%s" % (m.group(1), m.group(2), m.group(3), bit)
    m = _BLOCK.match(bare)
    if m:
        return "block", m.group(1) + m.group(2)
    if _TIMER.match(bare):
        return "timer", bare.lstrip("%")
    m = _SIEMENS.match(bare)
    if not m:
        return None, text
    peripheral, area, width, byte, bit, marked = m.groups()
    area = GERMAN.get(area, area)
    if peripheral or marked:
        return "peripheral", area + (width or "X") + byte
    if width in ("", "X"):
        if bit is None or int(bit) > 7:
            return None, text
        return "value", "%s%s.%s" % (area, byte, bit)
    if bit is not None:
        return None, text
    return "value", "%s%s%s" % (area, width, byte)


def width_type(address):
    """The type that an address alone means."""
    m = re.search(r"(?:^[IQM]|\.DB)([BWDX]?)\d", address)
    return ELEMENTARY[{"B": "BYTE", "W": "WORD", "D": "DWORD"}.get(m.group(1), "BOOL")
                      if m else "BOOL"]


def known_type(text):
    """A type, or None where the text is none that is known without further sources."""
    try:
        kind = parse_type(text)
    except TypeProblem:
        return None
    element = kind.element if isinstance(kind, Array) else kind
    if hasattr(element, "name") and not isinstance(element, Struct) and \
            ALIASES.get(element.name.upper(), element.name.upper()) not in ELEMENTARY:
        return None
    return kind


def once(header, wanted, place, report):
    """A column that is read must not be there twice: which would count?"""
    for name in wanted:
        if header.count(name) > 1:
            first = header.index(name)
            report.error(Place(place.file, place.line, header.index(name, first + 1) + 1, place.sheet),
                         name, "the column is there twice, first as column %s; allowed: each once"
                         % letters(first + 1))


def whole_row(line, numbers, lost, place, report):
    """True: all cells that are read have their values. Else the row is left out, and told."""
    for number in numbers:
        if (line, number) in lost:
            report.warning(Place(place.file, line, number, place.sheet), None,
                           "%s: the row is left out" % lost[line, number])
            return False
    return True


def add_symbol(source, symbol, address, type_text, comment, place, report):
    """A row of a symbol or tag table: symbol, address and type as they stand there."""
    kind, plc = siemens_address(address)
    if kind == "block":
        m = re.match(r"DB(\d+)$", plc)
        if m:
            source.blocks[symbol] = int(m.group(1))
        source.left_out += 1
        return
    if kind == "timer":
        source.left_out += 1
        return
    if not symbol:
        report.warning(place, None, "%s %s has no name: left out" % (address.strip() or "a row",
                                                                    type_text.strip()))
        return
    if kind == "peripheral":
        report.warning(place, None, '"%s" is peripheral memory (%s): left out; name its process '
                       "image" % (symbol, address.strip()))
        source.left_out += 1
        return
    if kind is None:
        report.warning(place, None, '"%s": "%s" is no address that is known: left out'
                       % (symbol, address.strip()))
        return
    type_ = known_type(type_text) if type_text.strip() else width_type(plc)
    if type_ is None:
        report.warning(place, None, '"%s": type "%s" is not known: left out'
                       % (symbol, type_text.strip()))
        return
    source.add(symbol, plc, type_, comment, place)
