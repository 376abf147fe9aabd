"""Types of SCL and where their parts lie in a standard (non-optimized) block.

Sizes are bytes; a place is (byte, bit). Rules: a BOOL takes the next free bit, BYTE and CHAR
the next byte, everything else the next even byte; structures and arrays begin and end at even
bytes; elements of arrays are packed.
"""
from dataclasses import dataclass, field

from .parse import SclError

# name: bytes, struct format (None: no arithmetic here)
BASIC = {
    "BOOL": (0, None), "BYTE": (1, "B"), "CHAR": (1, "B"), "WORD": (2, "H"), "INT": (2, "h"),
    "DATE": (2, "H"), "S5TIME": (2, "H"), "DWORD": (4, "I"), "DINT": (4, "i"),
    "REAL": (4, "f"), "TIME": (4, "i"), "TIME_OF_DAY": (4, "I"), "TOD": (4, "I"),
    "DATE_AND_TIME": (8, None), "DT": (8, None), "ANY": (10, None), "POINTER": (6, None),
}


@dataclass(frozen=True)
class Basic:
    name: str

    @property
    def size(self):
        return BASIC[self.name][0]

    @property
    def format(self):
        return BASIC[self.name][1]

    def __str__(self):
        return self.name


@dataclass(frozen=True)
class Text:
    length: int

    @property
    def size(self):
        return self.length + 2

    def __str__(self):
        return f"STRING[{self.length}]"


@dataclass(frozen=True)
class Array:
    bounds: tuple
    of: object

    @property
    def step(self):
        """Bytes from element to element; of BOOL: 0, eight share a byte."""
        if self.of == BOOL:
            return 0
        return even(self.of.size) if isinstance(self.of, Text) else self.of.size

    @property
    def row(self):
        """Bytes of the last dimension."""
        low, high = self.bounds[-1]
        count = high - low + 1
        return (count + 7) // 8 if self.of == BOOL else count * self.step

    @property
    def size(self):
        rows = 1
        for low, high in self.bounds[:-1]:
            rows *= high - low + 1
        return even(rows * self.row)

    def __str__(self):
        return f"ARRAY [{', '.join(f'{a}..{b}' for a, b in self.bounds)}] OF {self.of}"


@dataclass(frozen=True, eq=False)
class Field:
    name: str
    type: object
    byte: int
    bit: int
    initial: object = None
    pos: tuple = None


@dataclass(eq=False)
class Struct:
    name: str                       # of the type, "" where it has none
    fields: dict = field(default_factory=dict)
    size: int = 0

    def __str__(self):
        return self.name or "STRUCT"

    def shape(self):
        """Equal for structures that may be assigned to each other."""
        return [(f.name, f.type.shape() if isinstance(f.type, Struct) else f.type)
                for f in self.fields.values()]


@dataclass(eq=False)
class Instance:
    """The memory of a function block; its fields are those of a structure."""
    name: str
    struct: Struct

    @property
    def size(self):
        return self.struct.size

    @property
    def fields(self):
        return self.struct.fields

    def __str__(self):
        return self.name


BOOL, INT, DINT, REAL = Basic("BOOL"), Basic("INT"), Basic("DINT"), Basic("REAL")
BYTE, WORD, DWORD, TIME = Basic("BYTE"), Basic("WORD"), Basic("DWORD"), Basic("TIME")
ANY = Basic("ANY")
BITS = [BOOL, BYTE, WORD, DWORD]
NUMBERS = [INT, DINT, REAL]
WIDTH = {BOOL: 1, BYTE: 8, WORD: 16, DWORD: 32, INT: 16, DINT: 32, TIME: 32}

# What the compiler converts by itself.
IMPLICIT = {(BITS[i], BITS[j]) for i in range(4) for j in range(i + 1, 4)} | {
    (INT, DINT), (INT, REAL), (DINT, REAL)}


def even(size):
    return size + 1 & ~1


class Layout:
    """Gives places to fields, one after another."""

    def __init__(self):
        self.byte = self.bit = 0

    def place(self, kind):
        if kind == BOOL:
            place = (self.byte, self.bit)
            self.bit += 1
            if self.bit == 8:
                self.byte, self.bit = self.byte + 1, 0
            return place
        self.close()
        if not (isinstance(kind, Basic) and kind.size == 1):
            self.byte = even(self.byte)
        place = (self.byte, 0)
        self.byte += kind.size
        if not isinstance(kind, (Basic, Text)):
            self.byte = even(self.byte)
        return place

    def close(self):
        if self.bit:
            self.byte, self.bit = self.byte + 1, 0

    def end(self):
        self.close()
        return even(self.byte)


def make_struct(name, fields):
    """fields: (name, type, initial, pos) in their order."""
    struct, layout = Struct(name), Layout()
    for word, kind, initial, pos in fields:
        if word in struct.fields:
            raise SclError(pos, f"{word} is declared twice")
        struct.fields[word] = Field(word, kind, *layout.place(kind), initial, pos)
    struct.size = layout.end()
    return struct


# SFB 3, 4, 5 in their instance data: the last fields are the block's own
def timer(name):
    parts = [("IN", BOOL), ("PT", TIME), ("Q", BOOL), ("ET", TIME), ("STATE", BYTE),
             ("STIME", TIME), ("ATIME", TIME)]
    return Instance(name, make_struct(name, [(n, t, None, None) for n, t in parts]))


TIMERS = {name: timer(name) for name in ("TP", "TON", "TOF")}


def leaves(kind, name="", byte=0, bit=0):
    """(name, byte, bit, type) of everything elementary in a type."""
    if isinstance(kind, (Struct, Instance)):
        for part in kind.fields.values():
            yield from leaves(part.type, f"{name}.{part.name}" if name else part.name,
                              byte + part.byte, part.bit)
    elif isinstance(kind, Array):
        yield from elements(kind, name, byte)
    else:
        yield name, byte, bit, kind


def elements(kind, name, byte):
    rows = [()]
    for low, high in kind.bounds[:-1]:
        rows = [row + (i,) for row in rows for i in range(low, high + 1)]
    low, high = kind.bounds[-1]
    for number, row in enumerate(rows):
        for i in range(low, high + 1):
            index, at = ",".join(map(str, row + (i,))), byte + number * kind.row
            if kind.of == BOOL:
                yield f"{name}[{index}]", at + (i - low) // 8, (i - low) % 8, BOOL
            else:
                yield from leaves(kind.of, f"{name}[{index}]", at + (i - low) * kind.step)
