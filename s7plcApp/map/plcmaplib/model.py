"""The map: rows, types, enums and the PLC, from the sheets; and every single value (leaf) that
comes out of them when types and arrays are expanded.

What a row must look like by itself is checked here; what rows must be together, in check.
"""
import os
import re

from . import columns
from .address import AddressProblem, parse_address
from .problems import Place, Refused, nearest, one_of
from .sheets import one_line, whole
from .shown import Shown, State, check_state
from .types import (Array, Elementary, Layout, Named, TypeProblem, VISIBLE, is_struct,
                    parse_type)

MAX_LEAVES = 200000
_NAME = re.compile(r"^[^\s,;|\"']+(?: [^\s,;|\"']+)*$")


class Enum:
    __slots__ = ("name", "states", "row")

    def __init__(self, name, row):
        self.name = name
        self.states = []
        self.row = row


class TypeField:
    """One row of the sheet types."""
    __slots__ = ("row", "name", "type", "at", "suffix", "dir", "shown")


class TypeDef:
    __slots__ = ("name", "fields", "row")

    def __init__(self, name, row):
        self.name = name
        self.fields = []
        self.row = row


class MapRow:
    """One row of the sheet map."""
    __slots__ = ("row", "symbol", "address", "type", "dir", "tx", "rx", "via", "pv", "shown")

    def __init__(self, row):
        self.row = row
        self.address = self.type = self.tx = self.rx = self.shown = None


class Leaf:
    """One value: elementary, a text, or an array of elementary values."""
    __slots__ = ("owner", "field", "symbol", "type", "dir", "tx", "rx", "address", "suffix", "pv",
                 "shown", "relative", "member")

    def desc(self):
        """The row's description and the field's, as far as they fit."""
        own = self.shown.desc
        if self.field is None:
            return own
        both = ("%s %s" % (self.owner.shown.desc, own)).strip()
        return both if len(both.encode("utf-8")) <= columns.MAX_DESC else own

    def group(self):
        return self.owner.shown.group or self.shown.group

    def size(self):
        return leaf_size(self.type)

    def is_bit(self):
        return isinstance(self.type, Elementary) and self.type.kind == "bool"


def leaf_size(kind):
    """Bytes of a leaf's type."""
    return Layout({}).size(kind)


class Map:
    """Everything that the sheets say. `report` has what is wrong with them."""

    def __init__(self, path, sheets, report):
        self.path = path
        self.sheets = sheets
        self.report = report
        self.plc = {}
        self.plc_rows = {}
        self.enums = {}
        self.types = {}
        self.broken = set()  # types that cannot be laid out: their rows are left out
        self.rows = []
        self._leaves = self._dirs = None
        self._stale = False
        for name, sheet in sheets.items():
            self._check_columns(name, sheet)
        self._load_plc()
        self._load_enums()
        self._load_types()
        self.relay()
        self._check_types()
        self._load_rows()

    # --- what the PLC's keys mean -----------------------------------------------------------

    def on(self, key):
        return self.plc[key] == "on"

    def number(self, key):
        """A key as a number; None when it is blank."""
        return int(self.plc[key]) if self.plc[key] != "" else None

    def tx_header(self):
        if self.plc["wire"] != "block":
            return 0
        return (16 if self.on("download") else 4) if self.on("sync") else 0

    def rx_header(self):
        return 4 if self.plc["wire"] == "block" and self.on("sync") else 0

    def has_blocks(self):
        return self.plc["wire"] != "etherip"

    def s7_strings(self):
        """A STRING has its two length bytes; else it ends with a NUL."""
        return self.plc["family"] != "codesys"

    def size_of(self, kind):
        """Bytes of a type in the blocks."""
        return self.layout.size(kind)

    def name(self):
        """Of the files that are generated: the folder or workbook."""
        base = os.path.basename(os.path.abspath(self.path))
        return re.sub(r"\.xlsx$", "", base, flags=re.I)

    # --- sheets ----------------------------------------------------------------------------

    def _check_columns(self, name, sheet):
        allowed = columns.SHEETS[name]
        for number_, column in enumerate(sheet.header, 1):
            if column and not column.startswith("#") and column not in allowed:
                self.report.error(Place(sheet.file, sheet.line, number_, sheet.tab), None,
                                  'unknown column "%s"%s; allowed: %s, and #notes'
                                  % (column, nearest(column, allowed), " ".join(allowed)))
        needed = {"plc": ["key", "value"], "map": ["symbol", "type"],
                  "types": ["type", "field", "ftype"], "enums": ["enum", "value", "text"]}[name]
        for column in needed:
            if column not in sheet.header:
                self.report.error(sheet.place(), None, 'the column "%s" is missing; allowed: any order, but %s'
                                  % (column, " and ".join(needed) + " must be there"))
        for row in sheet.rows:
            for column in row.cells:
                words = allowed.get(column, (None,))[0]
                value = row.get(column)
                if words and value not in words:
                    self.report.error(row.place(column), column, one_of(value, words))
                elif column != "note" and not column.startswith("#") and not one_line(value):
                    self.report.error(row.place(column), column, "a line break or another control "
                                      "character; allowed: one line")

    def _load_plc(self):
        self.plc = {key: spec[0] for key, spec in columns.PLC_KEYS.items()}
        sheet = self.sheets.get("plc")
        for row in sheet.rows if sheet else []:
            key, value = row.get("key"), row.get("value")
            if key.startswith("#") or not key:
                continue
            if key not in columns.PLC_KEYS:
                self.report.error(row.place("key"), "key", 'unknown key "%s"%s; allowed: %s' % (
                    key, nearest(key, columns.PLC_KEYS), " ".join(columns.PLC_KEYS)))
                continue
            if key in self.plc_rows:
                self.report.error(row.place("key"), "key", '"%s" is there twice, see line %d; allowed: each key once'
                                  % (key, self.plc_rows[key].line))
            self.plc_rows[key] = row
            default, allowed, _ = columns.PLC_KEYS[key]
            if isinstance(allowed, list) and value not in allowed:
                self.report.error(row.place("value"), key, one_of(value, allowed))
            elif isinstance(allowed, tuple) and not self._within(value, default, allowed):
                self.report.error(row.place("value"), key, '"%s"; allowed: %d to %d'
                                  % (value, allowed[0], allowed[1]))
            else:
                self.plc[key] = value if value or default == "" else default

    @staticmethod
    def _within(value, default, allowed):
        if value == "":
            return True
        return len(value) < 10 and whole(value) is not None and \
            allowed[0] <= int(value) <= allowed[1]

    def plc_place(self, key):
        row = self.plc_rows.get(key)
        if row:
            return row.place("value")
        sheet = self.sheets.get("plc") or self.sheets["map"]
        return Place(sheet.file, None, None, sheet.tab)

    def _load_enums(self):
        sheet = self.sheets.get("enums")
        current = None
        for row in sheet.rows if sheet else []:
            name = row.get("enum")
            if name and name.upper() not in self.enums:
                current = self.enums[name.upper()] = Enum(name, row)
            elif name:
                current = self.enums[name.upper()]
            if current is None:
                self.report.error(row.place("enum"), "enum", "the first row needs a name")
                continue
            value = row.get("value")
            if not re.match(r"^-?\d{1,10}$", value):
                self.report.error(row.place("value"), "value",
                                  '"%s" is no whole number; allowed: such as 0, 7, -1' % value)
                continue
            severity = row.get("sev") if row.get("sev") in columns.SEVERITIES else ""
            check_state(current.states, int(value), row.get("text"), severity,
                        row.place("text"), "text", self.report)
            current.states.append(State(int(value), row.get("text"), severity))
            if len(current.states) == columns.MAX_STATES + 1:
                self.report.error(row.place("value"), "value", "enum %s has more than %d states"
                                  % (current.name, columns.MAX_STATES))

    def _load_types(self):
        sheet = self.sheets.get("types")
        current = None
        for row in sheet.rows if sheet else []:
            name = row.get("type")
            if name and (current is None or name.upper() != current.name.upper()):
                if name.upper() in self.types:
                    self.report.error(row.place("type"), "type", "type %s began in line %d: its "
                                      "rows must stand together"
                                      % (name, self.types[name.upper()].row.line))
                self._check_type_name(row, name)
                current = self.types.setdefault(name.upper(), TypeDef(name, row))
            if current is None:
                self.report.error(row.place("type"), "type", "the first row needs a name")
                continue
            self._load_field(current, row)

    def _check_type_name(self, row, name):
        try:
            kind = parse_type(name)
        except TypeProblem:
            kind = None
        if not isinstance(kind, Named) or not _NAME.match(name):
            self.report.error(row.place("type"), "type", '"%s" cannot be the name of a type; '
                              "allowed: a name that is no type of the PLC" % name)

    def _load_field(self, typedef, row):
        field = TypeField()
        field.row = row
        field.name = row.get("field")
        field.dir = row.get("dir") if row.get("dir") in columns.DIRECTIONS else ""
        field.suffix = row.get("suffix")
        if not field.name and field.dir != "reserved":
            self.report.error(row.place("field"), "field", "the field has no name; allowed: its name in the "
                              "PLC, or dir reserved")
        for other in typedef.fields:
            if field.name and other.name.upper() == field.name.upper():
                self.report.error(row.place("field"), "field", "%s.%s is there twice, see line %d; allowed: each field once"
                                  % (typedef.name, field.name, other.row.line))
        field.type = self._type(row, "ftype")
        field.at = self._offset(row, "at", field.type)
        field.shown = Shown(row, self.report, self.enums)
        typedef.fields.append(field)

    def _check_types(self):
        """Types that can be laid out, and whose fields do not overlap."""
        for key, typedef in self.types.items():
            try:
                placed, _ = self.layout.fields(Named(typedef.name))
            except TypeProblem as e:
                self.report.error(typedef.row.place("type"), "type", str(e))
                self.broken.add(key)
                continue
            except RecursionError:
                self.report.error(typedef.row.place("type"), "type", "types nest too deep")
                self.broken.add(key)
                continue
            taken = {}
            rows = [f.row for f in typedef.fields if f.type]
            for row, (name, kind, byte, bit) in zip(rows, placed):
                self._claim(taken, row, typedef, name, kind, byte, bit)

    def _claim(self, taken, row, typedef, name, kind, byte, bit):
        size = self.layout.size(kind)
        if bit is None and byte & 1 and not self.layout.anywhere(kind) and row.get("at"):
            self.report.error(row.place("at"), "at", "%s begins at an even byte, not %d"
                              % (kind, byte))
        for place in [(byte, bit)] if bit is not None else \
                [(b, None) for b in range(byte, byte + size)]:
            for bits in range(8) if place[1] is None else [place[1]]:
                other = taken.get((place[0], bits))
                if other is not None:
                    self.report.error(row.place("at"), "at", "byte %d of %s is taken by %s%s"
                                      % (place[0], typedef.name, other, self._grown(typedef, other)))
                    return
                taken[(place[0], bits)] = name

    def _grown(self, typedef, name):
        """The way out, where a field in front may have grown."""
        kind = next((f.type for f in typedef.fields if f.name == name and f.type), None)
        element = kind.element if isinstance(kind, Array) else kind
        if kind is None or self.layout.size(kind) < 2:
            return ""
        return "; if %s has grown: `plcmap place --grow`" % (element if is_struct(element) else name)

    def _type(self, row, column):
        text = row.get(column)
        if not text:
            self.report.error(row.place(column), column, "no type; allowed: such as INT REAL BOOL "
                              "STRING[16] ARRAY[1..4] OF REAL, or one of the sheet types")
            return None
        try:
            kind = parse_type(text)
        except TypeProblem as e:
            self.report.error(row.place(column), column, str(e))
            return None
        name = kind.element if isinstance(kind, Array) else kind
        if isinstance(name, Named) and column == "type" and name.name.upper() not in self.types:
            self.report.error(row.place(column), column, self._unknown(name.name))
            return None
        if isinstance(name, Named) and name.name.upper() in self.broken:
            return None
        if isinstance(name, Named) and column == "ftype" and not self._will_have(name.name):
            self.report.error(row.place(column), column, self._unknown(name.name))
            return None
        return kind

    def _type_names(self):
        sheet = self.sheets.get("types")
        return [r.get("type") for r in sheet.rows if r.get("type")] if sheet else []

    def _will_have(self, name):
        return name.upper() in {n.upper() for n in self._type_names()}

    def _unknown(self, name):
        known = VISIBLE + sorted(set(self._type_names()))
        return 'unknown type "%s"%s; allowed: %s STRING[n] ARRAY[a..b] OF, and the sheet types' \
            % (name, nearest(name, known), " ".join(VISIBLE))

    def _offset(self, row, column, kind):
        """(byte, bit) of a cell; None when it is blank or wrong."""
        text = row.get(column)
        if not text:
            return None
        m = re.match(r"^(\d{1,6})(?:\.(\d))?$", text)
        if not m or (m.group(2) and int(m.group(2)) > 7):
            self.report.error(row.place(column), column, '"%s" is no place; allowed: a byte such '
                              "as 10, or byte.bit such as 10.3" % text)
            return None
        byte, bit = int(m.group(1)), int(m.group(2) or 0)
        is_bool = isinstance(kind, Elementary) and kind.kind == "bool"
        if bit and not is_bool:
            self.report.error(row.place(column), column, "only a BOOL has a bit, not %s"
                              % (kind or "this"))
            return None
        return byte, bit if is_bool else None

    def _load_rows(self):
        for row in self.sheets["map"].rows:
            item = MapRow(row)
            item.symbol = row.get("symbol")
            item.dir = row.get("dir") or "in"
            if item.dir not in columns.DIRECTIONS:
                item.dir = "in"
            item.via = row.get("via") if row.get("via") in columns.TRANSFERS else ""
            item.pv = row.get("pv")
            item.type = self._type(row, "type")
            item.tx = self._offset(row, "tx", item.type)
            item.rx = self._offset(row, "rx", item.type)
            item.address = self._address(row)
            item.shown = Shown(row, self.report, self.enums)
            self.rows.append(item)

    def _address(self, row):
        text = row.get("plc")
        if not text or self.plc["wire"] in ("etherip", "modbus"):
            return parse_symbol(text) if text else None
        try:
            return parse_address(text)
        except AddressProblem as e:
            if self.plc["family"] == "codesys" and re.match(r"^[A-Za-z_]\w*$", text):
                return parse_symbol(text)  # M1 is a variable there
            self.report.error(row.place("plc"), "plc", str(e))
            return None

    # --- from rows to values ----------------------------------------------------------------

    def leaves(self):
        """All values, in the order of the rows. Rows with errors are left out."""
        if self._leaves is None:
            self._leaves = []
            for item in self.rows:
                if item.type is not None and item.dir != "reserved":
                    self._expand_row(item)
        elif self._stale:
            for leaf in self._leaves:
                self._place_leaf(leaf)
        self._stale = False
        return self._leaves

    def changed(self):
        """Places have changed: what was made of them is made anew."""
        self._stale = True

    def relay(self):
        """Places of fields have changed."""
        self.layout = Layout({key: [(f.name, f.type, f.at) for f in t.fields if f.type]
                              for key, t in self.types.items()})
        for key, typedef in self.types.items():
            self.layout.types[key] = self._appended([f for f in typedef.fields if f.type])
        self._leaves = self._dirs = None

    def _appended(self, fields):
        """(name, type, at) of a type's fields. Where some are pinned the others come behind
        them, in their order; where none is, at None leaves it to the rules."""
        if all(f.at is None for f in fields) or all(f.at is not None for f in fields):
            return [(f.name, f.type, f.at) for f in fields]
        try:
            sizes = [self.layout.size(f.type) for f in fields]
        except (TypeProblem, RecursionError):  # told where the type is looked at
            return [(f.name, f.type, f.at) for f in fields]
        end, free = 0, (0, 8)  # the byte behind all; the byte of the last bits, its next bit
        for field, size in zip(fields, sizes):
            if field.at is not None and field.at[0] + size >= end:
                end = field.at[0] + size
                bit = field.at[1]
                same = free[1] if free[0] == field.at[0] and free[1] < 8 else 0
                free = (field.at[0], 8 if bit is None else max(same, bit + 1))
        found = []
        for field, size in zip(fields, sizes):
            at = field.at
            if at is None and isinstance(field.type, Elementary) and field.type.kind == "bool":
                at = free if free[1] < 8 and free[0] == end - 1 else (end, 0)
                free = (at[0], at[1] + 1)
            elif at is None:
                at = (end + (0 if self.layout.anywhere(field.type) else end & 1), None)
                free = (0, 8)
            end = max(end, at[0] + size)
            found.append((field.name, field.type, at))
        return found

    def dirs_of(self, item):
        """The directions of a row's values: {"in", "out", "cmd"}."""
        if self._dirs is None:
            self._dirs = {}
            for leaf in self.leaves():
                self._dirs.setdefault(id(leaf.owner), set()).add(leaf.dir)
        return self._dirs.get(id(item), set())

    def _expand_row(self, item):
        leaf = Leaf()
        leaf.owner, leaf.field, leaf.shown = item, None, item.shown
        leaf.symbol, leaf.type, leaf.dir = item.symbol, item.type, item.dir
        leaf.relative, leaf.suffix, leaf.member = (0, None), "", ""
        self._expand(leaf, item.type)

    def _expand(self, leaf, kind):
        """Adds the leaves of a value of this type whose place, names and direction are those
        of `leaf`."""
        if len(self._leaves) >= MAX_LEAVES:
            raise Refused("more than %d values" % MAX_LEAVES, leaf.owner.row.place("type"))
        if isinstance(kind, Array) and not _stays_array(kind):
            ends = ":" if is_struct(kind.element) else ""
            stem = leaf.suffix[:-1] if ends and leaf.suffix.endswith(":") and leaf.field \
                else leaf.suffix
            for index, byte, bit in self.layout.elements(kind):
                part = self._part(leaf, leaf.field, byte, bit)
                part.symbol = "%s[%s]" % (leaf.symbol, index)
                part.member = "%s[%s]" % (leaf.member, index)
                part.suffix = leaf.suffix if leaf.suffix == "-" else \
                    "%s%s%s" % (stem, index.replace(",", "_").replace("-", "m"), ends)
                self._expand(part, kind.element)
            return
        if is_struct(kind):
            fields = [f for f in self.types[kind.name.upper()].fields if f.type]
            try:
                placed, _ = self.layout.fields(kind)
            except TypeProblem:
                return
            for field, (name, ftype, byte, bit) in zip(fields, placed):
                if (field.dir or leaf.dir) == "reserved":
                    continue
                part = self._part(leaf, field, byte, bit)
                part.symbol = "%s.%s" % (leaf.symbol, name)
                part.member = "%s.%s" % (leaf.member, name)
                part.dir = field.dir or leaf.dir
                part.shown = field.shown
                part.suffix = _suffix(leaf.suffix, field)
                self._expand(part, ftype)
            return
        self._finish(leaf, kind)

    @staticmethod
    def _part(leaf, field, byte, bit):
        part = Leaf()
        part.owner, part.field, part.shown = leaf.owner, field, leaf.shown
        part.dir = leaf.dir
        part.relative = (leaf.relative[0] + byte, bit)
        return part

    @staticmethod
    def _place_leaf(leaf):
        item = leaf.owner
        leaf.tx = _at(item.tx, leaf.relative) if leaf.dir != "cmd" else None
        leaf.rx = _at(item.rx, leaf.relative) if leaf.dir != "in" else None

    def _finish(self, leaf, kind):
        item = leaf.owner
        leaf.type = kind
        self._place_leaf(leaf)
        leaf.address = None
        if item.address is not None and item.address.area:
            byte, bit = leaf.relative
            own = item.address.bit if leaf.is_bit() and bit is None else bit
            leaf.address = item.address.plus(byte, own)
        elif item.address is not None:
            leaf.address = parse_symbol(item.address.symbol + leaf.member)
        leaf.pv = "" if not item.pv or leaf.suffix == "-" or leaf.suffix.startswith("-") \
            else item.pv + leaf.suffix
        self._leaves.append(leaf)

    # --- sizes -----------------------------------------------------------------------------

    def uses(self, side):
        """[(row, byte, bit or None, bytes)] that rows take on a side, "tx" or "rx"."""
        found = []
        for item in self.rows:
            at = item.tx if side == "tx" else item.rx
            if item.type is None or at is None:
                continue
            try:
                size = self.size_of(item.type)
            except (TypeProblem, KeyError):
                continue
            found.append((item, at[0], at[1], size))
        return found

    def block_size(self, side):
        """Bytes of a block: even, at least its header and its minimum."""
        if not self.has_blocks():
            return 0
        header = self.tx_header() if side == "tx" else self.rx_header()
        end = max([header, self.number("min_in" if side == "tx" else "min_out") or 0] +
                  [byte + size for _, byte, _, size in self.uses(side)])
        if side == "tx" and self.number("layout_at") is not None:
            end = max(end, self.number("layout_at") + 2)
        if side == "tx" and self.number("readback") is not None:
            end = max(end, self.number("readback") + self.block_size("rx"))
        return end + (end & 1)

    def row_of(self, symbol):
        return next((r for r in self.rows if r.symbol == symbol), None)


def parse_symbol(text):
    from .address import Address
    return Address(symbol=text)


def _stays_array(kind):
    """Arrays that one record shows: numbers and characters."""
    return isinstance(kind.element, Elementary) and kind.element.kind in (
        "int", "uint", "bits", "real", "char")


def _suffix(before, field):
    if before == "-" or field.suffix == "-":
        return "-"
    own = field.suffix
    if not own:
        element = field.type.element if isinstance(field.type, Array) else field.type
        own = field.name + (":" if is_struct(element) else "")
    return before + own


def _at(place, relative):
    """A place inside a row's place."""
    if place is None:
        return None
    byte, bit = relative
    return place[0] + byte, (place[1] if bit is None else bit)
