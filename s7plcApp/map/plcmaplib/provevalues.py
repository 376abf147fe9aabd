"""Which values prove a leaf: what is written into the PLC, and what its record must show then.
Pure: no process, no file."""
import math
import struct

from . import tags
from .check import RANGES
from .outputs.records import kind_of
from .types import Array, Text

SIM_TYPES = {"BYTE": "UINT8", "CHAR": "STRING[1]", "DATE_AND_TIME": "TIME", "TIME": "INT32",
             "TIME_OF_DAY": "UINT32"}


class Value:
    """One value. words: for plcSim's `set`; shown: what dbgf shows, as text, number or list;
    severity: of the record, None: not looked at; put: for dbpf, None: cannot be put."""
    __slots__ = ("words", "shown", "severity", "put")

    def __init__(self, words, shown, severity=None, put=None):
        self.words = words
        self.shown = shown
        self.severity = severity
        self.put = put


def sim_type(map_, kind):
    """The name of a type for plcSim."""
    if isinstance(kind, Array):
        if kind.element.kind == "char":
            return "STRING[%d]" % kind.count()
        return "%s[%d]" % (sim_type(map_, kind.element), kind.count())
    if isinstance(kind, Text):
        return "S7STRING[%d]" % kind.length if map_.s7_strings() else \
            "STRING[%d]" % (kind.length + 1)
    return SIM_TYPES.get(kind.name, kind.name)


def _float32(value):
    return struct.unpack(">f", struct.pack(">f", value))[0]


def _reals(kind, number):
    own = 1000 + number % 9000 + 0.25
    values = [0.0, -1.5, own, -own, 1e-3, 123456.5]
    return [_float32(v) if kind.size == 4 else v for v in values]


def _integers(kind, number):
    """Limits of the type, a value of its own, bytes that all differ, each byte alone."""
    low, high = RANGES[kind.name]
    pattern = int.from_bytes(bytes(range(0x12, 0x12 + 0x11 * kind.size, 0x11)), "big") & high
    values = [0, 1, low, high, (number * 7 + 1) & high, pattern]
    values += [0x5A << 8 * i & high for i in range(kind.size)]
    if low < 0:
        values += [-1, -(number % 100) - 2]
    return values


def _limit_points(shown, values, step):
    """Values at and beside each limit."""
    points = []
    for limit in shown.limits.values():
        if limit is not None:
            points += [limit, limit - step, limit + step]
    return points + values


def severity_of(shown, value):
    """As a record with these limits judges."""
    limits, severities = shown.limits, shown.severities
    for column, beyond in (("hihi", lambda v, l: v >= l), ("lolo", lambda v, l: v <= l),
                           ("high", lambda v, l: v >= l), ("low", lambda v, l: v <= l)):
        if limits[column] is not None and beyond(value, limits[column]):
            if severities[column] != "NO_ALARM":
                return severities[column]
    return "NO_ALARM"


def _text_values(length, number):
    own = "v%d" % number
    texts = ["", own[:length], "abcdefghijklmnopqrstuvwxyz0123456789"[:length],
             "Z" * length, "two words"[:length].strip()]
    return texts


def values(map_, leaf, number):
    """All values of a leaf. number: another one for each leaf, so that no two are alike."""
    kind = leaf.type
    if isinstance(kind, Array):
        return _array(map_, leaf, kind, number)
    if isinstance(kind, Text):
        return [Value([t], t, None, t) for t in _text_values(kind.length, number)]
    if kind.kind == "bool":
        return _bits(leaf, number)
    if kind.kind == "char":
        return [Value([t], t, None, t) for t in ("A", "z", chr(0x30 + number % 10))]
    if kind.kind == "time":
        texts = ["2611291840123455", "%02d01020304050607" % (number % 100), "9912312359599991"]
        rows = [[int(t[i:i + 2]) for i in range(0, 16, 2)] for t in texts]
        rows += [_letters(8, number), _letters(8, number + 9)]
        return [Value(["".join("%02d" % b for b in r)], r, None, _byte_put(r)) for r in rows]
    if kind.kind == "raw":
        rows = [[7, 234, 11, 29, 1, 18, 40, 12, 0, 0, 1, number % 256], [255] * 12,
                _letters(12, number), _letters(12, number + 5)]
        return [Value(["".join("%02x" % b for b in r)], r, None, _byte_put(r)) for r in rows]
    if leaf.shown.states is not None:
        return _states(leaf, kind)
    return _numbers(map_, leaf, kind, number)


def _letters(count, number):
    """Bytes that are letters."""
    return [65 + (number + i) % 26 for i in range(count)]


def _byte_put(row):
    """dbpf puts an array of bytes as text: letters, or None."""
    return "".join(map(chr, row)) if all(65 <= b <= 90 for b in row) else None


def _bits(leaf, number):
    """In rounds 0-7 each bit of a byte alone, in 8-15 all but it, then a code of its own."""
    place = leaf.tx or leaf.rx
    bit = (tags.place(leaf)[1] or 0) % 8 if place is None else place[1]
    pattern = [int(bit == r) for r in range(8)] + [int(bit != r) for r in range(8)]
    pattern += [number >> r & 1 for r in range(14)]
    states = leaf.shown.states
    texts = [s.text for s in states] if states else ["0", "1"]
    severities = [s.severity or "NO_ALARM" for s in states] if states else ["NO_ALARM"] * 2
    return [Value([str(b)], texts[b], severities[b], texts[b]) for b in pattern]


def _states(leaf, kind):
    return [Value([str(s.value)], s.text, s.severity or "NO_ALARM", s.text)
            for s in leaf.shown.states]


def _numbers(map_, leaf, kind, number):
    shown = leaf.shown
    record = kind_of(map_, leaf)[0]
    if kind.kind == "real":
        raws = [_float32(v) if kind.size == 4 else v
                for v in _limit_points(shown, _reals(kind, number), 0.5)]
        return [Value([repr(v)], v, severity_of(shown, v), repr(v)) for v in raws]
    if shown.raw is not None:
        return _scaled(leaf, kind, number)
    low, high = RANGES[kind.name]
    points = [int(p) for p in _limit_points(shown, _integers(kind, number), 1)]
    found = []
    for raw in points:
        if not low <= raw <= high:
            continue
        if raw >= 2 ** 63 and record == "int64in" and kind.name == "ULINT" and not (leaf.tx or leaf.rx):
            continue  # of a tag it is refused
        # a 64-bit number without sign shows its upper half as negative
        view = raw - 2 ** 64 if raw >= 2 ** 63 and record == "int64in" else raw
        put = str(view)
        if record == "ai" and raw in (low, high) and low < 0:
            put = None  # an ao never writes the most negative number
        found.append(Value([str(raw)], float(view) if record == "ai" else view,
                           severity_of(shown, view), put))
    return found


def _scaled(leaf, kind, number):
    """Raw and engineering values of a linear scale."""
    shown = leaf.shown
    (r0, r1), (e0, e1) = shown.raw, shown.eng
    slope = (e1 - e0) / (r1 - r0)
    low, high = RANGES[kind.name]
    raws = [int(r0), int(r1), int((r0 + r1) / 2), int(r0 + (r1 - r0) * (number % 97) / 97), low, high]
    for limit in shown.limits.values():
        if limit is not None:
            at = r0 + (limit - e0) / slope
            raws += [math.floor(at) - 1, math.ceil(at) + 1]
    found = []
    for raw in raws:
        if not low <= raw <= high:
            continue
        value = e0 + slope * (raw - r0)
        put = repr(value) if r0 <= raw <= r1 else None
        found.append(Value([str(raw)], value, severity_of(shown, value), put))
    return found


def _array(map_, leaf, kind, number):
    count = kind.count()
    if kind.element.kind == "char":
        return [Value([t], t, None, t) for t in _text_values(count, number)]
    if kind.element.kind == "real":
        rows = [[(number + i) % 1000 + 0.5 for i in range(count)], [-1.0 * i for i in range(count)]]
        return [Value([repr(v) for v in r], r, None, r) for r in rows]
    low, high = RANGES[kind.element.name]
    rows = [[(number * 3 + i) % (min(high, 30000) + 1) for i in range(count)],
            [(high if i % 2 else low) for i in range(count)]]
    if kind.element.size == 1:
        rows += [_letters(count, number), _letters(count, number + 1)]
        return [Value([str(v) for v in r], r, None, _byte_put(r) if count > 1 else r)
                for r in rows]
    return [Value([str(v) for v in r], r, None, r) for r in rows]


def same(shown, text):
    """True when what dbgf printed, parsed, is this value."""
    if isinstance(shown, list):
        return isinstance(text, list) and len(text) == len(shown) and \
            all(same(a, b) for a, b in zip(shown, text))
    if isinstance(shown, float) or isinstance(text, float):
        if not isinstance(text, (int, float)) or not isinstance(shown, (int, float)):
            return False
        return abs(shown - text) <= 1e-8 * max(abs(shown), abs(text), 1e-3)
    return shown == text
