"""Data types of a PLC and where their bytes lie, by the rules of S7 standard (not optimised)
blocks. Pure: no files, no maps.

The rules. BOOL: next free bit; after another type in the next byte. One-byte types: next byte.
All others: next even byte; nothing is aligned to 4 or 8. STRING[n]: n+2 bytes, begins even; in
an array each element begins even. Structures and arrays begin even and are followed by an even
byte; a structure's length is even. In arrays of BOOL each row of the last index begins in a
new byte. Values are big-endian.
"""
import re


class TypeProblem(Exception):
    """A type text that is none; str() says what is wrong and what is allowed."""


class Elementary:
    """BOOL, INT, REAL ...: a name, bytes, and what the bytes mean."""
    __slots__ = ("name", "size", "kind")

    def __init__(self, name, size, kind):
        self.name = name
        self.size = size
        self.kind = kind  # bool int uint bits real char time raw

    def __str__(self):
        return self.name

    def __eq__(self, other):
        return isinstance(other, Elementary) and other.name == self.name

    def __hash__(self):
        return hash(self.name)


class Text:
    """STRING[n] or WSTRING[n]."""
    __slots__ = ("length", "wide")

    def __init__(self, length, wide=False):
        self.length = length
        self.wide = wide

    def __str__(self):
        return "%sSTRING[%d]" % ("W" if self.wide else "", self.length)

    def __eq__(self, other):
        return isinstance(other, Text) and (other.length, other.wide) == (self.length, self.wide)

    def __hash__(self):
        return hash((self.length, self.wide))


class Array:
    """ARRAY [low..high, ...] OF element."""
    __slots__ = ("bounds", "element")

    def __init__(self, bounds, element):
        self.bounds = bounds
        self.element = element

    def __str__(self):
        return "ARRAY[%s] OF %s" % (
            ",".join("%d..%d" % b for b in self.bounds), self.element)

    def __eq__(self, other):
        return (isinstance(other, Array) and other.bounds == self.bounds and
                other.element == self.element)

    def __hash__(self):
        return hash((tuple(self.bounds), self.element))

    def count(self):
        n = 1
        for low, high in self.bounds:
            n *= high - low + 1
        return n

    def rows(self):
        """Number of rows of the last index, and elements in each."""
        low, high = self.bounds[-1]
        row = high - low + 1
        return self.count() // row, row

    def indices(self):
        """Texts '0,1' in the order of memory."""
        found = [""]
        for low, high in self.bounds:
            found = ["%s%s%d" % (f, "," if f else "", i)
                     for f in found for i in range(low, high + 1)]
        return found


class Named:
    """A structure by its name: a row of the types sheet, a UDT, an FB."""
    __slots__ = ("name",)

    def __init__(self, name):
        self.name = name

    def __str__(self):
        return self.name

    def __eq__(self, other):
        return isinstance(other, Named) and other.name.upper() == self.name.upper()

    def __hash__(self):
        return hash(self.name.upper())


class Struct:
    """A structure without a name, in a source. fields: (name, type, comment)."""
    __slots__ = ("fields",)

    def __init__(self, fields):
        self.fields = fields

    def __str__(self):
        return "STRUCT"


def _table(kind, size, names):
    return {n: Elementary(n, size, kind) for n in names.split()}


ELEMENTARY = {}
for _kind, _size, _names in [
        ("bool", 1, "BOOL"), ("bits", 1, "BYTE"), ("char", 1, "CHAR"), ("int", 1, "SINT"),
        ("uint", 1, "USINT"), ("int", 2, "INT"), ("uint", 2, "UINT"), ("bits", 2, "WORD"),
        ("uint", 2, "DATE"), ("bits", 2, "S5TIME"), ("raw", 2, "WCHAR"),
        ("raw", 2, "COUNTER TIMER"),
        ("int", 4, "DINT TIME"), ("uint", 4, "UDINT TIME_OF_DAY"), ("bits", 4, "DWORD"),
        ("real", 4, "REAL"), ("real", 8, "LREAL"), ("int", 8, "LINT LTIME LDT"),
        ("uint", 8, "ULINT LTOD"), ("bits", 8, "LWORD"), ("time", 8, "DATE_AND_TIME"),
        ("raw", 12, "DTL"), ("raw", 6, "POINTER"), ("raw", 10, "ANY"),
        ("raw", 16, "IEC_TIMER TON_TIME TOF_TIME TP_TIME"), ("raw", 2, "HW_IO")]:
    ELEMENTARY.update(_table(_kind, _size, _names))

ALIASES = {"TOD": "TIME_OF_DAY", "DT": "DATE_AND_TIME", "BIT": "BOOL", "DATE_TIME": "DATE_AND_TIME",
           "LTIME_OF_DAY": "LTOD", "DATE_AND_LTIME": "LDT"}

# What a record can show; the others only take their bytes.
VISIBLE = [n for n, t in ELEMENTARY.items() if t.kind != "raw" or n == "DTL"]

_ARRAY = re.compile(r"\s*ARRAY\s*\[([^\]]*)\]\s*OF\s+(.+)$", re.I | re.S)
_NESTED = re.compile(r"\bARRAY\s*\[", re.I)
_BOUND = re.compile(r"\s*(-?\d+)\s*\.\.\s*(-?\d+)\s*$")
_TEXT = re.compile(r"\s*(W?)STRING\s*(?:[\[(]\s*(\d+)\s*[\])])?\s*$", re.I)
MAX_TEXT = 254
MAX_WTEXT = 16382
MAX_COUNT = 65536
MAX_DIMENSIONS = 6


def _bounds(text):
    bounds = []
    for part in text.split(","):
        m = _BOUND.match(part)
        if not m:
            raise TypeProblem('"%s" are no array bounds; allowed: such as ARRAY[1..4] OF REAL'
                              % text.strip())
        low, high = int(m.group(1)), int(m.group(2))
        if high < low:
            raise TypeProblem("array bounds %d..%d: the first must not be greater" % (low, high))
        bounds.append((low, high))
    if len(bounds) > MAX_DIMENSIONS:
        raise TypeProblem("an array has at most %d dimensions, not %d"
                          % (MAX_DIMENSIONS, len(bounds)))
    return bounds


def _check_depth(m):
    if len(_NESTED.findall(m.group(0))) > MAX_DIMENSIONS:
        raise TypeProblem("an array has at most %d dimensions" % MAX_DIMENSIONS)


def parse_type(text):
    """A type from its text. Unknown names become Named; raises TypeProblem."""
    text = text.strip()
    m = _ARRAY.match(text)
    if m:
        _check_depth(m)
        array = Array(_bounds(m.group(1)), parse_type(m.group(2)))
        if isinstance(array.element, Array):  # ARRAY OF ARRAY is one array of more dimensions
            array = Array(array.bounds + array.element.bounds, array.element.element)
        if array.count() > MAX_COUNT:
            raise TypeProblem("%d elements are too many; allowed: up to %d"
                              % (array.count(), MAX_COUNT))
        return array
    if re.match(r"ARRAY\b", text, re.I):
        raise TypeProblem('"%s" is no array; allowed: such as ARRAY[1..4] OF REAL' % text)
    m = _TEXT.match(text)
    if m:
        wide = bool(m.group(1))
        length = int(m.group(2)) if m.group(2) else 254
        most = MAX_WTEXT if wide else MAX_TEXT
        if not 1 <= length <= most:
            raise TypeProblem("STRING[%d]; allowed: STRING[1] to STRING[%d]" % (length, most))
        return Text(length, wide)
    bare = text.strip('"')
    upper = bare.upper()
    if not text.startswith('"'):
        upper = ALIASES.get(upper, upper)
        if upper in ELEMENTARY:
            return ELEMENTARY[upper]
    if not bare:
        raise TypeProblem("no type")
    return Named(bare)


def is_struct(kind):
    return isinstance(kind, (Named, Struct))


class Layout:
    """Sizes and offsets. `types`: upper-case name -> list of (name, type, at), where `at` is
    (byte, bit) or None: behind the one before. Raises TypeProblem for an unknown type or one
    that contains itself."""

    def __init__(self, types):
        self.types = types
        self.cache = {}
        self.open = []

    def fields(self, kind):
        """Offsets of a structure's fields: [(name, type, byte, bit or None)], size."""
        if isinstance(kind, Struct):
            return self.walk([(f[0], f[1], None) for f in kind.fields])
        key = kind.name.upper()
        if key not in self.cache:
            if key not in self.types:
                raise TypeProblem('unknown type "%s"' % kind.name)
            if key in self.open:
                raise TypeProblem("type %s contains itself: %s"
                                  % (kind.name, " > ".join(self.open[self.open.index(key):] + [key])))
            self.open.append(key)
            try:
                self.cache[key] = self.walk(self.types[key])
            finally:
                self.open.pop()
        return self.cache[key]

    def walk(self, fields):
        """[(name, type, byte, bit or None)] of [(name, type, at or None)], and the size."""
        placed = []
        byte, bit, end = 0, 0, 0
        for name, kind, at in fields:
            if at is not None:
                byte, bit = at[0], at[1] or 0
            elif isinstance(kind, Elementary) and kind.name == "BOOL":
                pass
            else:
                if bit:
                    byte, bit = byte + 1, 0
                if not self.anywhere(kind):
                    byte += byte & 1
            if isinstance(kind, Elementary) and kind.name == "BOOL":
                placed.append((name, kind, byte, bit))
                bit += 1
                if bit == 8:
                    byte, bit = byte + 1, 0
                end = max(end, byte + (1 if bit else 0))
                continue
            placed.append((name, kind, byte, None))
            byte, bit = byte + self.size(kind), 0
            end = max(end, byte)
            if isinstance(kind, Array) or is_struct(kind):
                byte += byte & 1
        return placed, end + (end & 1)

    @staticmethod
    def anywhere(kind):
        """May begin at an odd byte."""
        return isinstance(kind, Elementary) and kind.size == 1

    def size(self, kind):
        """Bytes; of a BOOL 1."""
        if isinstance(kind, Elementary):
            return kind.size
        if isinstance(kind, Text):
            return 4 + 2 * kind.length if kind.wide else 2 + kind.length
        if isinstance(kind, Array):
            rows, row = kind.rows()
            return rows * self._row(kind, row)
        return self.fields(kind)[1]

    def _row(self, array, row):
        if isinstance(array.element, Elementary) and array.element.name == "BOOL":
            return (row + 7) // 8
        return row * self.step(array)

    def step(self, array):
        """Bytes from one element to the next; not for BOOL."""
        size = self.size(array.element)
        return size + (size & 1) if isinstance(array.element, Text) else size

    def elements(self, array):
        """[(index text, byte, bit or None)] of all elements."""
        rows, row = array.rows()
        length = self._row(array, row)
        bits = isinstance(array.element, Elementary) and array.element.name == "BOOL"
        step = 0 if bits else self.step(array)
        found = []
        for number, index in enumerate(array.indices()):
            r, e = divmod(number, row)
            if bits:
                found.append((index, r * length + e // 8, e % 8))
            else:
                found.append((index, r * length + e * step, None))
        return found
