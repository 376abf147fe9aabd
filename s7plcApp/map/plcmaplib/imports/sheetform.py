"""Sheets that a laboratory has made for itself, read by a small description of their columns.

A description is a text of lines `key = value`; # begins a remark. form = list: a row for each
signal. form = types: blocks of rows under a header cell, one for each device type and direction,
with addresses relative to the instance. docs/map.md has both in full.
"""
import re

from ..address import WIDTHS, Address, misfit
from ..problems import Place, Refused, nearest
from ..sheets import clean
from ..types import ELEMENTARY, VISIBLE
from .common import Source, known_type, once, siemens_address, whole_row

LIST_KEYS = ["symbol", "plc", "type", "dir", "pv", "desc", "egu", "prec", "lopr", "hopr", "lolo",
             "low", "high", "hihi", "states", "archive", "group", "note"]
OTHER = ["form", "sheets", "header", "none", "address", "name", "direction", "types"]


def read_description(text, path):
    """{key: value} and {key: {word: value}} of `type.Digital = BOOL`."""
    keys, words = {}, {}
    for number, line in enumerate(text.splitlines(), 1):
        line = clean(line.split(" #")[0] if not line.startswith("#") else "")
        if not line:
            continue
        key, equals, value = line.partition("=")
        key, value = clean(key), clean(value)
        base, dot, word = key.partition(".")
        if not equals or base not in LIST_KEYS + OTHER:
            raise Refused('"%s" is no key%s; allowed: %s' % (
                base[:40], nearest(base, LIST_KEYS + OTHER), " ".join(OTHER + LIST_KEYS)),
                Place(path, number))
        if dot:
            words.setdefault(base, {})[word.lower()] = value
        else:
            keys[key] = value
    if keys.get("form") not in ("list", "types"):
        raise Refused("form = list or form = types is missing", Place(path))
    return keys, words


def read(cells, path, description, report):
    """cells: {sheet: [(line, [texts])]}"""
    keys, words = description
    wanted = [w.strip() for w in keys.get("sheets", "*").split(",")]
    missing = [w for w in wanted if w != "*" and w not in cells]
    if missing:
        raise Refused('sheets: "%s" is not there%s; it has: %s' % (
            missing[0], nearest(missing[0], cells), ", ".join(cells)), Place(path))
    source = Source("sheet, by its description")
    source.extra = {}
    for tab, rows in cells.items():
        if wanted == ["*"] or tab in wanted:
            lost = getattr(cells, "lost", {}).get(tab, {})  # a CSV has none
            if keys["form"] == "list":
                _read_list(source, tab, rows, path, keys, words, lost, report)
            else:
                _read_types(source, tab, rows, path, keys, words, lost, report)
    if not source.items and not source.types and not report.errors():
        raise Refused("nothing that fits the description in the sheets %s" % ", ".join(cells),
                      Place(path))
    return source


# --- a row for each signal -----------------------------------------------------------------------

def _parts(template):
    """The columns that a template names: one without braces is a column."""
    return re.findall(r"\{([^}]*)\}", template) if "{" in template else [template]


def _filled(template, row):
    """{Column} replaced by its cell; nothing where all of them are blank."""
    parts = {p: row.get(p, "") for p in _parts(template)}
    if not any(parts.values()):
        return ""
    return re.sub(r"\{([^}]*)\}", lambda m: parts[m.group(1)], template) if "{" in template else \
        parts[template]


def _used(header, keys, place, report):
    """The numbers of the columns that the description names, each there and once; or None."""
    used = {part: key for key in LIST_KEYS if key in keys for part in _parts(keys[key])}
    missing = [part for part in used if part not in header]
    for part in missing:
        report.error(place, None, '%s: the sheet has no column "%s"%s; it has: %s' % (
            used[part], part, nearest(part, header), ", ".join(h for h in header if h)))
    once(header, used, place, report)
    return None if missing else [header.index(part) + 1 for part in used]


def _read_list(source, tab, rows, path, keys, words, lost, report):
    marker = keys.get("header", "")
    none = {w.strip().lower() for w in keys.get("none", "").split(",") if w.strip()}
    header = used = None
    for line, texts in rows:
        texts = [clean(t) for t in texts]
        if header is None:
            if marker in texts or (not marker and any(texts)):
                header = texts
                used = _used(header, keys, Place(path, line, 1, tab), report)
                if used is None:
                    return
            continue
        row = {h: "" if t.lower() in none else t for h, t in zip(header, texts) if h}
        place = Place(path, line, 1, tab)
        if any(row.values()) and whole_row(line, used, lost, place, report):
            _list_row(source, row, place, keys, words, report)
    if header is None:
        report.warning(Place(path, None, None, tab), None,
                       'no row with the header "%s": the sheet is left out' % marker)


def _list_row(source, row, place, keys, words, report):
    cells = {}
    for key in LIST_KEYS:
        if key not in keys:
            continue
        value = _filled(keys[key], row)
        blank = [p for p in _parts(keys[key]) if not row.get(p)]
        if value and blank and key in ("symbol", "plc", "type", "pv"):  # ".B" would be a guess
            report.warning(place, None, '%s: the column "%s" is blank: left out' % (key, blank[0]))
            return
        if key in words and value:
            if value.lower() not in words[key]:
                report.warning(place, None, '%s "%s" is not in the description: left out; known: %s'
                               % (key, value, " ".join(words[key])))
                return
            value = words[key][value.lower()]
        cells[key] = value
    kind = known_type(cells.get("type", ""))
    if not cells.get("symbol"):
        if any(cells.values()):
            report.warning(place, None, "symbol: it is blank: left out")
        return
    if kind is None:
        report.warning(place, None, '"%s": type "%s" is not known: left out' % (
            cells["symbol"], cells.get("type", "")))
        return
    plc = cells.get("plc", "")
    found, normal = siemens_address(plc) if plc else (None, "")
    source.add(cells["symbol"], normal if found == "value" else plc, kind, cells.get("desc", ""),
               place)
    source.extra.setdefault(cells["symbol"], {k: v for k, v in cells.items() if v and
                                              k not in ("symbol", "plc", "type", "desc")})


# --- blocks of rows for each type ------------------------------------------------------------------

_HEAD = re.compile(r'Type\s*["\u201c\u201e]([^"\u201d\u201c]+)["\u201d\u201c]', re.I)
_PLACE = re.compile(r"^DB([XBWD])\s*(\d+)(?:\.(\d))?$", re.I)
GAP = 4  # blank rows that end a block
_BY_WIDTH = {"X": "BOOL", "B": "BYTE", "W": "WORD", "D": "DWORD"}


def _read_types(source, tab, rows, path, keys, words, lost, report):
    """Header cells at any column; below them address, type, name, description."""
    order = [w.strip() for w in keys.get("types", "address type name desc").split()]
    grid = {line: [clean(t) for t in texts] for line, texts in rows}
    heads = []
    for line, texts in sorted(grid.items()):
        for column, text in enumerate(texts):
            m = _HEAD.search(text)
            if m:
                heads.append((line, column, m.group(1).strip(), text))
    for line, column, name, text in heads:
        above = [t for n in (line, line - 1, line - 2) for t in grid.get(n, [])[column:column + 4]]
        direction = _direction(above, words)
        end = min([l for l, c, _, _ in heads if c == column and l > line] + [max(grid) + 1])
        typename = name + ("_" + direction if direction else "")
        fields = _type_fields(grid, line, end, column, order, Place(path, line, column + 1, tab),
                              typename, lost, report, path, tab)
        if typename in source.types:
            report.error(Place(path, line, column + 1, tab), None,
                         "type %s is there twice" % typename)
        elif fields:
            source.types[typename] = fields


def _direction(texts, words):
    for text in texts:
        for word, direction in words.get("direction", {}).items():
            if word in text.lower():
                return direction
    return ""


def _field_type(text, place):
    """(type, None), or (None, what is wrong) of a field's type and its address."""
    letter, byte, bit = place.group(1).upper(), int(place.group(2)), place.group(3)
    if (letter == "X") != (bit is not None) or int(bit or 0) > 7:
        return None, '"%s" is no address in a type; allowed: such as DBX0.3 DBB1 DBW2 DBD4' \
            % place.group(0)
    kind = known_type(text) if text else ELEMENTARY[_BY_WIDTH[letter]]
    if kind is None:
        return None, 'unknown type "%s"%s; allowed: blank (that of the address), %s' % (
            text, nearest(text, VISIBLE), " ".join(VISIBLE))
    if (kind == ELEMENTARY["BOOL"]) != (letter == "X"):
        return None, "%s does not lie at %s" % (kind, place.group(0))
    problem = misfit(kind, Address("DB", 0, byte, int(bit) if bit else None, WIDTHS[letter]))
    return kind, problem and problem.replace("DB0.", "")


def _type_fields(grid, line, end, column, order, place, typename, lost, report, path, tab):
    fields, blanks, names = [], 0, set()
    for number in range(line + 1, end):
        texts = grid.get(number, [])
        cells = dict(zip(order, (texts + [""] * (column + len(order)))[column:column + len(order)]))
        here = Place(path, number, column + 1, tab)
        m = _PLACE.match(cells.get("address", ""))
        if m and blanks > GAP:
            report.error(here, None, "%s: %s stands behind %d rows without an address, which end a "
                         "type; allowed: up to %d" % (typename, m.group(0), blanks, GAP))
            break
        if not m:
            blanks += 1
            text = cells.get("address", "")
            if any(cells.values()) and blanks <= GAP and (fields or text.upper().startswith("DB")):
                report.warning(here, None, '"%s" is no address in a type: left out' % text[:30])
            continue
        blanks = 0
        if not whole_row(number, range(column + 1, column + 1 + len(order)), lost, here, report):
            continue
        name = cells.get("name", "")
        if not name:
            continue  # a spare bit
        kind, problem = _field_type(cells.get("type", ""), m)
        if problem:
            report.error(here, None, "%s.%s: %s" % (typename, name, problem))
            continue
        if name.upper() in names:
            report.error(here, None, "%s.%s is there twice" % (typename, name))
            continue
        names.add(name.upper())
        fields.append((name, kind, cells.get("desc", ""),
                       (int(m.group(2)), int(m.group(3)) if m.group(1).upper() == "X" else None), number))
    if not fields:
        report.warning(place, None, "type %s has no rows that are understood" % typename)
    return fields
