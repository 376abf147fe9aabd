"""Constants of SCL: text to (type, value)."""
import re

from .parse import SclError
from .types import BOOL, BYTE, DINT, DWORD, INT, REAL, TIME, WORD, Basic

S5TIME, CHAR = Basic("S5TIME"), Basic("CHAR")

PREFIXES = {
    "B": BYTE, "BYTE": BYTE, "W": WORD, "WORD": WORD, "DW": DWORD, "DWORD": DWORD,
    "INT": INT, "L": DINT, "DINT": DINT, "REAL": REAL, "BOOL": BOOL,
}
RANGES = {BOOL: (0, 1), BYTE: (0, 0xff), WORD: (0, 0xffff), DWORD: (0, 0xffffffff),
          INT: (-0x8000, 0x7fff), DINT: (-0x80000000, 0x7fffffff)}
UNITS = (("D", 86400000), ("H", 3600000), ("M", 60000), ("S", 1000), ("MS", 1))
DURATION = re.compile(r"(?:(\d+(?:\.\d+)?)D)?(?:(\d+(?:\.\d+)?)H)?(?:(\d+(?:\.\d+)?)M(?!S))?"
                      r"(?:(\d+(?:\.\d+)?)S)?(?:(\d+)MS)?$")


def number(text, pos):
    if "." in text:
        return REAL, float(text)
    value = int(text.replace("_", ""))
    if value > 0x7fffffff:
        raise SclError(pos, f"{text} is too large for DINT")
    return (INT if value <= 0x7fff else DINT), value


def literal(text, pos):
    prefix, rest = text.upper().split("#", 1)
    if prefix in ("T", "TIME"):
        return TIME, duration(rest, text, pos)
    if prefix in ("S5T", "S5TIME"):
        return S5TIME, s5time(duration(rest, text, pos), text, pos)
    if prefix in ("2", "8", "16"):
        value = digits(rest, int(prefix), text, pos)
        return (INT if value <= 0x7fff else DINT), value
    kind = PREFIXES.get(prefix)
    if not kind:
        raise SclError(pos, f"{text}: unknown kind of constant")
    if kind == REAL:
        return REAL, float(rest.replace("_", ""))
    radix = 10
    if "#" in rest:
        head, rest = rest.split("#", 1)
        if head not in ("2", "8", "16"):
            raise SclError(pos, f"{text}: the base is 2, 8 or 16")
        radix = int(head)
    value = digits(rest, radix, text, pos)
    low, high = RANGES[kind]
    if not low <= value <= high:
        raise SclError(pos, f"{text} does not fit into {kind}")
    return kind, bool(value) if kind == BOOL else value


def digits(text, radix, whole, pos):
    try:
        return int(text.replace("_", ""), radix)
    except ValueError:
        raise SclError(pos, f"{whole} is no number to the base {radix}") from None


def duration(text, whole, pos):
    """Milliseconds."""
    match = DURATION.match(text.replace("_", ""))
    if not match or not text or not any(match.groups()):
        raise SclError(pos, f"{whole} is no duration, such as T#1S500MS")
    ms = round(sum(float(n) * unit for n, (_, unit) in zip(match.groups(), UNITS) if n))
    if ms > 0x7fffffff:
        raise SclError(pos, f"{whole} is too long for TIME")
    return ms


def s5time(ms, whole, pos):
    """The 16 bits of an S5 time: base of time, three BCD digits."""
    for base, unit in enumerate((10, 100, 1000, 10000)):
        if ms <= 999 * unit:
            return base << 12 | int(str(ms // unit), 16)
    raise SclError(pos, f"{whole} is too long for S5TIME; allowed: 2H46M30S")


def string(text, pos):
    value = re.sub(r"\$(.)", r"\1", text[1:-1]).encode("latin-1", "replace")
    if len(value) == 1:
        return CHAR, value[0]
    raise SclError(pos, "texts are not in this subset, only single characters")
