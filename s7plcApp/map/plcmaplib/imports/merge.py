"""From what files bring to rows of a map: structures expanded, new rows added, known ones
updated; what people have written by hand stays."""
import fnmatch
import re

from .. import columns
from ..address import AddressProblem, misfit, parse_address
from ..problems import Place, Refused
from ..types import (Array, Elementary, Layout, Named, Struct, Text, TypeProblem, is_struct)

MAX_ROWS = 100000
_NOT_PV = re.compile(r"[^A-Za-z0-9_\-:\[\]<>;]+")


class New:
    """A row that an import wants."""
    __slots__ = ("symbol", "plc", "type", "desc", "place", "cells")

    def __init__(self, symbol, plc, type_, desc, place):
        self.symbol, self.plc, self.type = symbol, plc, type_
        self.desc, self.place = desc, place
        self.cells = {}


class Types:
    """All types of all files, with aliases resolved."""

    def __init__(self, sources, report):
        self.report = report
        self.names = {}
        self.fields = {}
        self.alias = {}
        for source in sources:
            for name, fields in source.types.items():
                if len(fields) == 1 and fields[0][0] == "":
                    self.alias[name.upper()] = fields[0][1]
                else:
                    self.names[name.upper()] = name
                    self.fields[name.upper()] = fields
        self.layout = Layout({k: [(f[0], self.resolve(f[1]), f[3]) for f in v]
                              for k, v in self.fields.items()})

    def resolve(self, kind, depth=0):
        """Aliases replaced by what they stand for."""
        if depth > 20:
            return kind
        if isinstance(kind, Named) and kind.name.upper() in self.alias:
            return self.resolve(self.alias[kind.name.upper()], depth + 1)
        if isinstance(kind, Array):
            element = self.resolve(kind.element, depth + 1)
            if isinstance(element, Array):
                return Array(kind.bounds + element.bounds, element.element)
            return Array(kind.bounds, element)
        if isinstance(kind, Struct):
            return Struct([(f[0], self.resolve(f[1], depth + 1)) + tuple(f[2:])
                           for f in kind.fields])
        return kind

    def comments(self, kind):
        """Descriptions of a structure's fields, in order."""
        fields = kind.fields if isinstance(kind, Struct) else self.fields[kind.name.upper()]
        return [f[2] for f in fields]

    def bound(self, kind, depth=0):
        """How many single values a type has at most."""
        if depth > 40:
            raise TypeProblem("types nest too deep")
        if isinstance(kind, Array):
            if isinstance(kind.element, Elementary) and kind.element.kind not in ("bool", "time",
                                                                                 "raw"):
                return 1
            return kind.count() * self.bound(kind.element, depth + 1)
        if is_struct(kind):
            total = 0
            for _, inner, _, _ in self.layout.fields(kind)[0]:
                total += self.bound(inner, depth + 1)
                if total > MAX_ROWS:
                    break
            return total
        return 1


def visible(kind):
    """A record can show it."""
    if isinstance(kind, Array):
        return visible(kind.element)
    if isinstance(kind, Text):
        return not kind.wide
    return isinstance(kind, Elementary) and (kind.kind != "raw" or kind.name == "DTL")


def rows_of(sources, numbers, keep_types, report):
    """[New] of all items. numbers: {name of a data block: number}. Returns (rows, types)."""
    types = Types(sources, report)
    blocks = dict(numbers)
    for source in sources:
        for name, number in source.blocks.items():
            blocks.setdefault(name, number)
    rows = []
    for source in sources:
        for item in source.items:
            kind = types.resolve(item.type)
            try:
                if types.bound(kind) + len(rows) > MAX_ROWS:
                    raise Refused("more than %d values; --select takes a part" % MAX_ROWS, item.place)
            except TypeProblem as e:
                report.warning(item.place, None, '"%s": %s: left out; import the file that has it '
                               "too" % (item.symbol, e))
                continue
            made = _rows_of_item(item, kind, types, blocks, keep_types, report, source)
            extra = getattr(source, "extra", {})
            for row in made:
                row.cells = dict(extra.get(row.symbol, {}))
                row.desc = source.comments.get(row.symbol.upper(), row.desc)
            rows += made
    return rows, types


def _rows_of_item(item, kind, types, blocks, keep_types, report, source):
    plc, symbol = item.plc, item.symbol
    if plc == "":  # a data block
        m = re.match(r"^DB\s*(\d+)$", symbol, re.I)
        number = int(m.group(1)) if m else blocks.get(symbol)
        if number is None and is_struct(kind):
            report.warning(item.place, None, 'the number of data block "%s" is not known: its '
                           "fields get symbols; --db '%s=10' or a symbol table tells it"
                           % (symbol, symbol))
            plc = symbol
        elif is_struct(kind):
            plc = "DB%d.DBX0.0" % number
            source.scope.add("DB%d" % number)
            if m:
                symbol = "DB%d" % number
    address = None
    named = source.keys.get("family") in ("codesys", "none")  # MW1 is a tag there
    if plc != symbol or not named and re.match(r"^%?(DB\d|[IQM][BWDX]?\d)", plc):
        try:
            address = parse_address(plc)
        except AddressProblem:
            address = None
    if address is not None and not address.area:
        address = None
    problem = misfit(kind, address) if address is not None else None
    if problem:  # what the export says twice is not the same: which is right?
        report.warning(item.place, "plc", "%s at %s: %s: left out" % (symbol, plc, problem))
        return []
    made = []
    _expand(made, types, kind, symbol, plc, address, 0, None, item.desc, item.place, keep_types,
            report, top=True)
    return made


def _expand(made, types, kind, symbol, path, address, byte, bit, desc, place, keep_types, report,
            top=False):
    if isinstance(kind, Named) and keep_types and not (top and path == ""):
        made.append(_row(kind, symbol, path, address, byte, bit, desc, place, types))
        return
    if isinstance(kind, Array) and is_struct(kind.element) and keep_types and \
            isinstance(kind.element, Named):
        made.append(_row(kind, symbol, path, address, byte, bit, desc, place, types))
        return
    if isinstance(kind, Array) and (is_struct(kind.element) or isinstance(kind.element, Text) or
                                    kind.element.kind in ("bool", "time", "raw")):
        for index, b, i in types.layout.elements(kind):
            _expand(made, types, kind.element, "%s[%s]" % (symbol, index), "%s[%s]" % (path, index),
                    address, byte + b, i, desc, place, keep_types, report)
        return
    if is_struct(kind):
        comments = types.comments(kind)
        for (name, inner, b, i), comment in zip(types.layout.fields(kind)[0], comments):
            _expand(made, types, inner, "%s.%s" % (symbol, name), "%s.%s" % (path, name), address,
                    byte + b, i, comment or desc, place, keep_types, report)
        return
    if not visible(kind):
        report.warning(place, None, "%s: no record shows %s: left out" % (symbol, kind))
        return
    made.append(_row(kind, symbol, path, address, byte, bit, desc, place, types))


def _row(kind, symbol, path, address, byte, bit, desc, place, types):
    plc = path
    if address is not None:
        size = kind.size if isinstance(kind, Elementary) else 0
        own = address.bit if bit is None and isinstance(kind, Elementary) and \
            kind.kind == "bool" else bit
        plc = address.plus(byte, own).text(size, own)
    return New(symbol, plc, str(kind), desc, place)


def selected(rows, patterns, report):
    """The rows that one of the patterns means; a pattern that means none is an error."""
    if not patterns:
        return rows
    found = set()
    for pattern in patterns:
        fits = re.compile(fnmatch.translate(pattern)).match
        hits = [id(r) for r in rows if fits(r.symbol) or fits(r.plc)]
        if not hits and rows:
            report.error(Place("--select"), None, '"%s" means none of the %d symbols and addresses, such '
                         "as %s %s; allowed: * ? [abc]" % (pattern, len(rows), rows[0].symbol,
                                                         rows[0].plc))
        found.update(hits)
    return [r for r in rows if id(r) in found]


# --- names of records --------------------------------------------------------------------------

class Names:
    """--pv: none, or s/pattern/replacement/; without it dots become colons."""

    def __init__(self, rule):
        self.none = rule == "none"
        self.pattern = None
        if rule and not self.none:
            parts = rule.split(rule[1]) if len(rule) > 2 and rule[0] == "s" else []
            if len(parts) != 4 or not parts[1] or parts[3] not in ("", "g"):
                raise Refused('--pv "%s"; allowed: none, or such as s/Tank\\.(.*)/T1:\\1/' % rule)
            try:
                self.pattern = re.compile(parts[1])
            except re.error as e:
                raise Refused('--pv "%s": %s' % (rule, e)) from None
            self.replacement = parts[2]

    def of(self, symbol):
        if self.none:
            return ""
        name = symbol
        if self.pattern:
            try:
                name = self.pattern.sub(self.replacement, symbol)
            except re.error as e:
                raise Refused("--pv: %s" % e) from None
        name = name.replace("\"", "").replace(".", ":").replace("[", "").replace("]", "")
        if any(_foreign(part) for part in name.split(":")):
            return ""
        return _NOT_PV.sub("_", name).strip("_")


def _foreign(text):
    """All its letters are such as no record name can have: what would be left is no name."""
    letters = [c for c in text if c.isalpha()]
    return bool(letters) and not any(c.isascii() for c in letters)


# --- into the map ----------------------------------------------------------------------------------

def fit(text, most):
    """One line, cut to so many bytes, at a character."""
    text = " ".join("".join(c if ord(c) > 31 else " " for c in text).split())
    return text.encode("utf-8")[:most].decode("utf-8", "ignore").strip()


class Merge:
    """Updates the sheets of a map. `lines` says what was done."""

    def __init__(self, sheets, options, report):
        self.sheet = sheets["map"]
        self.sheets = sheets
        self.options = options
        self.report = report
        self.lines = []
        for column in ("symbol", "plc", "type", "dir", "tx", "rx", "pv", "desc"):
            self.sheet.column(column)
        self.by_symbol = {r.get("symbol"): r for r in self.sheet.rows if r.get("symbol")}
        self.by_upper = {s.upper(): r for s, r in self.by_symbol.items()}
        self.by_plc = {}
        for row in self.sheet.rows:
            if row.get("plc"):
                self.by_plc.setdefault(row.get("plc").upper(), row)
        self.pvs = {r.get("pv") for r in self.sheet.rows if r.get("pv")}
        self.names = Names(options.pv)
        self.counts = {"new": 0, "changed": 0, "same": 0}
        keys = {r.get("key"): r.get("value") for r in sheets["plc"].rows}
        self.room = columns.MAX_PV - len(keys.get("prefix", ""))
        self.rbv = len(keys.get("rbv", columns.PLC_KEYS["rbv"][0]).strip("-"))
        self.long = []  # symbols whose records would have names that are too long
        self.cut = []  # symbols whose descriptions were

    def run(self, rows, types, scope):
        wanted = {}
        for row in rows:
            if row.symbol in wanted:
                other = wanted[row.symbol]
                if (other.plc, other.type) != (row.plc, row.type):
                    self.report.warning(row.place, None, '"%s" is there twice with another place or '
                                        "type (%s): the first counts" % (row.symbol, other.place))
                continue
            wanted[row.symbol] = row
        seen = set()
        for row in wanted.values():
            known = self._known(row, wanted)
            if known is None:
                self._add(row)
                continue
            seen.add(id(known))
            self._update(known, row)
        self._tell_long()
        self._vanished(wanted, seen, scope)
        if self.options.types:
            self._add_types(types, rows)
        if self.cut:
            self.report.warning(Place(self.sheet.file, None, None, self.sheet.tab), "desc",
                                "%d descriptions are longer than %d bytes and are cut: %s" % (
                                    len(self.cut), columns.MAX_DESC, " ".join(self.cut)))
        self.lines.append("%d new, %d changed, %d as they were" % (
            self.counts["new"], self.counts["changed"], self.counts["same"]))

    def _known(self, row, wanted):
        known = self.by_symbol.get(row.symbol) or self.by_upper.get(row.symbol.upper())
        if known is not None:
            return known
        other = self.by_plc.get(row.plc.upper()) if row.plc else None
        if other is not None and other.get("symbol") not in wanted and \
                row.plc != row.symbol and other.get("type") == row.type:
            before = other.get("symbol")
            self.lines.append("renamed: %s is %s now (%s)" % (before or "a row without a symbol",
                                                              row.symbol, row.plc))
            self.by_symbol.pop(before, None)
            other.cells["symbol"] = row.symbol
            self.by_symbol[row.symbol] = other
            self.counts["changed"] += 1
            return other
        return None

    def _add(self, row):
        pv = row.cells.get("pv") or self.names.of(row.symbol)
        direction = row.cells.get("dir") or self.options.dir
        if not pv and not self.names.none:
            self.report.warning(row.place, "pv", "%s: no record name is made of its letters; it gets no "
                                "record before column pv has one; allowed: A-Z a-z 0-9 _ - : [ ] < > ;"
                                % row.symbol)
        if len(pv) > self.room - (self.rbv if direction == "out" else 0):
            self.long.append(row)
            pv = ""
        elif pv in self.pvs:
            self.report.warning(row.place, None, 'record "%s" is there already: %s gets none'
                                % (pv, row.symbol))
            pv = ""
        if pv:
            self.pvs.add(pv)
        cells = {"symbol": row.symbol, "plc": row.plc, "type": row.type,
                 "dir": direction, "pv": pv,
                 "desc": self._desc(row.desc, row.symbol)}
        for column, value in row.cells.items():
            if column in columns.MAP_COLUMNS and column not in cells:
                self.sheet.column(column)
                cells[column] = value
        if cells["dir"] == "in":
            del cells["dir"]
        self.sheet.append({c: v for c, v in cells.items() if v})
        self.counts["new"] += 1
        self.lines.append("new: %s %s %s" % (row.symbol, row.type, row.plc))

    def _desc(self, text, symbol):
        """What DESC can hold of a description."""
        found = fit(text, columns.MAX_DESC)
        if found != fit(text, len(text.encode("utf-8"))):
            self.cut.append(symbol)
        return found

    def _tell_long(self):
        if self.long:
            self.report.warning(self.long[0].place, None, "%d values would have records with more "
                                "than %d characters, such as %s: they get none; --pv makes shorter "
                                "names, such as 's/Main\\.(.*)/M:\\1/'" % (
                                    len(self.long), columns.MAX_PV,
                                    self.names.of(self.long[0].symbol)))

    def _update(self, known, row):
        changed = False
        if known.get("dir") == "reserved":
            self.lines.append("is back: %s; it was reserved" % row.symbol)
            known.cells["dir"] = self.options.dir
            changed = True
        if known.get("plc") != row.plc and row.plc:
            self.lines.append("moved in the PLC: %s %s, was %s" % (row.symbol, row.plc,
                                                                   known.get("plc") or "(blank)"))
            known.cells["plc"] = row.plc
            changed = True
        if known.get("type").replace(" ", "").upper() != row.type.replace(" ", "").upper():
            self.lines.append("retyped: %s %s, was %s" % (row.symbol, row.type, known.get("type")))
            known.cells["type"] = row.type
            for side in ("tx", "rx"):
                if known.get(side):
                    self.lines.append("    its place %s %s is given up; `plcmap place` gives another"
                                      % (side, known.cells.pop(side)))
            changed = True
        if not known.get("desc") and row.desc:
            known.cells["desc"] = self._desc(row.desc, row.symbol)
            changed = True
        self.counts["changed" if changed else "same"] += 1

    def _vanished(self, wanted, seen, scope):
        """Rows of data blocks that the export has completely, and no longer with them."""
        for row in self.sheet.rows:
            block = row.get("plc").split(".")[0].upper()
            if block not in scope or id(row) in seen or row.get("symbol") in wanted or \
                    row.get("dir") == "reserved" or self.options.select:
                continue
            if self.options.keep_vanished:
                self.lines.append("vanished: %s (%s); the row stays" % (row.get("symbol"),
                                                                      row.get("plc")))
                continue
            self.lines.append("vanished: %s (%s); its bytes are reserved" % (row.get("symbol"),
                                                                           row.get("plc")))
            self.sheet.column("note")
            note = "was %s %s" % (row.get("type"), row.get("pv"))
            if not (row.get("tx") or row.get("rx")):
                row.cells["note"] = (row.get("note") + " " + note).strip()
            keep = {c: row.get(c) for c in ("symbol", "plc", "type", "tx", "rx", "note")}
            keep["note"] = (keep["note"] + " " + note).strip()
            keep["dir"] = "reserved"
            row.cells.clear()
            row.cells.update({c: v for c, v in keep.items() if v})
            self.counts["changed"] += 1
        self.sheet.rows[:] = [r for r in self.sheet.rows
                              if not (r.get("dir") == "reserved" and not r.get("tx") and
                                      not r.get("rx"))]

    def _add_types(self, types, rows):
        """The types that rows use, and those that these use; all, where there are no rows."""
        used, todo = set(), [r.type for r in rows] or list(types.names.values())
        while todo:
            text = todo.pop()
            name = re.sub(r"^ARRAY\[[^\]]*\] OF ", "", text).upper()
            if name in types.fields and name not in used:
                used.add(name)
                todo += [str(types.resolve(f[1])) for f in types.fields[name]]
        sheet = self.sheets["types"]
        known = {r.get("type").upper() for r in sheet.rows if r.get("type")}
        for name in sorted(used):
            if name in known:
                self.lines.append("type %s is in the map already; it stays as it is"
                                  % types.names[name])
                continue
            self._add_type(sheet, types, name)

    def _add_type(self, sheet, types, name):
        for column in ("type", "field", "ftype", "at", "dir", "desc"):
            sheet.column(column)
        placed, _ = types.layout.fields(Named(name))
        for number, ((field, kind, byte, bit), comment) in enumerate(
                zip(placed, types.comments(Named(name)))):
            cells = {"type": types.names[name] if number == 0 else "", "field": field,
                     "ftype": str(kind), "at": "%d" % byte if bit is None else "%d.%d" % (byte, bit),
                     "desc": self._desc(comment, "%s.%s" % (types.names[name], field))}
            if isinstance(kind, Struct):
                self.report.warning(Place("type %s" % types.names[name]), None, "%s is a structure "
                                    "without a name: give it one in the PLC, or import single "
                                    "values; reserved" % field)
                cells.update(ftype="ARRAY[1..%d] OF BYTE" % types.layout.size(kind), dir="reserved")
            elif not is_struct(kind) and not is_struct(getattr(kind, "element", kind)) and \
                    not visible(kind):
                cells["dir"] = "reserved"
            sheet.append({c: v for c, v in cells.items() if v})
        self.lines.append("new type: %s" % types.names[name])
