"""The outline of a data block as it is decoded from a compiled one: a line for each entry, with
its offset, indented by its level. The offsets are compared with those of the layout rules.

    DB10
    000.0: STATIC: STRUCT
    000.0:     A: BOOL := True
    002.0:     B: ARRAY [1..3] OF STRUCT
    002.0:         C: INT
"""
import re

from ..problems import Place, Refused
from ..types import Array, Layout, Struct, TypeProblem, parse_type
from .common import Source

_LINE = re.compile(r"^(\d+)\.([0-7]):(\s+)([^\s:][^:]*?)\s*:\s*(.+?)(?:\s*:=.*)?$")
_HEAD = re.compile(r"^\ufeff?DB\s*(\d+)$", re.I)
_STRUCT = re.compile(r"^(.*\bOF\s+)?STRUCT$", re.I)
DEPTH = 40


def is_outline(text):
    lines = [l for l in text.splitlines() if l.strip()][:2]
    return any(_LINE.match(l) for l in lines) and all(_LINE.match(l) or _HEAD.match(l) for l in lines)


class _Entry:
    __slots__ = ("name", "type", "level", "line", "byte", "bit", "inner")


def _entries(text, path):
    """[_Entry] in order, and the number of the block or None."""
    found, number = [], None
    for line, raw in enumerate(text.splitlines(), 1):
        if not raw.strip():
            continue
        m = _HEAD.match(raw.strip())
        if m and not found:
            number = int(m.group(1))
            continue
        m = _LINE.match(raw.rstrip())
        if not m or len(m.group(1)) > 6:
            raise Refused('"%s" is no entry such as 002.0: NAME: INT' % raw.strip()[:40],
                          Place(path, line))
        entry = _Entry()
        entry.byte, entry.bit, entry.name, entry.type = int(m.group(1)), int(m.group(2)), \
            m.group(4), m.group(5)
        entry.level = len(m.group(3).expandtabs(4))
        entry.line, entry.inner = line, []
        found.append(entry)
    return found, number


def _nested(entries, path):
    """The entries of the first level; inner ones are in those above them."""
    top, open_ = [], []
    for entry in entries:
        while open_ and open_[-1].level >= entry.level:
            open_.pop()
        if len(open_) > DEPTH:
            raise Refused("not more than %d levels" % DEPTH, Place(path, entry.line))
        (open_[-1].inner if open_ else top).append(entry)
        open_.append(entry)
    return top


def _type(entry, path):
    """The type of an entry with what is in it."""
    m = _STRUCT.match(entry.type.strip())
    try:
        if m is None:
            return parse_type(entry.type)
        inner = Struct([(e.name, _type(e, path), "", None, e.line) for e in entry.inner])
        if not m.group(1):
            return inner
        array = parse_type(m.group(1) + "INT")
        if not isinstance(array, Array):
            raise TypeProblem('"%s" is no type' % entry.type)
        return Array(array.bounds, inner)
    except TypeProblem as e:
        raise Refused(str(e), Place(path, entry.line)) from None


def _compare(entries, kind, base, path, report, layout):
    """Each offset in the text against that of the rules."""
    for entry, (name, inner, byte, bit) in zip(entries, layout.fields(kind)[0]):
        if (entry.byte, entry.bit) != (base + byte, bit or 0):
            report.error(Place(path, entry.line), None, "%s is at %d.%d here, and at %d.%d by the "
                         "layout rules" % (name, entry.byte, entry.bit, base + byte, bit or 0))
        element = inner.element if isinstance(inner, Array) else inner
        if isinstance(element, Struct):
            _compare(entry.inner, element, base + byte, path, report, layout)


def read(text, path, report):
    entries, number = _entries(text, path)
    top = _nested(entries, path)
    while len(top) == 1 and top[0].type.strip().upper() == "STRUCT" and top[0].inner:
        top = top[0].inner  # STATIC and the structure of the whole block
    kind = Struct([(e.name, _type(e, path), "", None, e.line) for e in top])
    layout = Layout({})
    try:
        layout.size(kind)
    except TypeProblem as e:
        raise Refused(str(e), Place(path)) from None
    _compare(top, kind, top[0].byte if top else 0, path, report, layout)
    source = Source("outline of a data block, %d entries" % len(entries))
    source.add("DB%d" % number if number else "DB", "", kind, "", Place(path, 1))
    return source
