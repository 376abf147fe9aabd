"""What the rows of a map must be together: places, directions, names, limits. All errors are
told, not the first alone. What a cell must be by itself is checked where it is read."""
import re

from . import columns, tags
from .address import misfit
from .problems import Place
from .shown import ASCII_PV
from .transfer import MAX_ROW, method, same_source
from .types import Array, Elementary, Text, is_struct

_LEADING = re.compile(r"^[^\s\"'@]+$")
FILE_NAME = re.compile(r"[\w][\w.+ -]{0,99}$")
PLC_NAME = re.compile(r"^[^\s/,()\"']{1,255}$")

# How many bits an integer has, and whether it is signed
RANGES = {"SINT": (-128, 127), "USINT": (0, 255), "BYTE": (0, 255), "INT": (-32768, 32767),
          "UINT": (0, 65535), "WORD": (0, 65535), "DINT": (-2 ** 31, 2 ** 31 - 1),
          "UDINT": (0, 2 ** 32 - 1), "DWORD": (0, 2 ** 32 - 1), "TIME": (-2 ** 31, 2 ** 31 - 1),
          "TIME_OF_DAY": (0, 2 ** 32 - 1), "DATE": (0, 65535), "S5TIME": (0, 65535),
          "LINT": (-2 ** 63, 2 ** 63 - 1), "ULINT": (0, 2 ** 64 - 1), "LWORD": (0, 2 ** 64 - 1),
          "LTIME": (-2 ** 63, 2 ** 63 - 1), "LDT": (-2 ** 63, 2 ** 63 - 1),
          "LTOD": (0, 2 ** 64 - 1)}


def check(map_, placed=True):
    """Adds everything that is wrong to map_.report. placed=False: blank places are allowed
    (before `place`)."""
    _check_plc(map_)
    _check_rows(map_, placed)
    _check_blocks(map_)
    _check_overlaps(map_)
    _check_registers(map_)
    _check_readback(map_)
    _check_memory(map_)
    _check_variables(map_)
    _check_tags(map_)
    _check_leaves(map_)
    _check_unused(map_)
    return map_.report


def _error(map_, item, column, text):
    map_.report.error(item.row.place(column), column, text)


# --- the PLC -------------------------------------------------------------------------------

def _check_plc(map_):
    plc, report = map_.plc, map_.report
    if not FILE_NAME.match(map_.name()):
        report.error(Place(map_.path), None, '"%s" becomes the name of files and stands in st.cmd; allowed: '
                     "up to 100 letters, digits, blanks and . _ + -" % map_.name())
    if not PLC_NAME.match(plc["name"]):
        report.error(map_.plc_place("name"), "name", '"%s" is no name of a station; allowed: no '
                     "blanks, no / , ( ) and quotes" % plc["name"])
    for key in ("prefix", "rbv"):
        if not ASCII_PV.match(plc[key]) or re.search(r"[.$]", plc[key]):
            report.error(map_.plc_place(key), key, '"%s" has characters that no record name can have; '
                         "allowed: A-Z a-z 0-9 _ - : [ ] < > ;" % plc[key])
    for key in ("address", "second"):
        if re.search(r"[\s,\"'\\]", plc[key]):
            report.error(map_.plc_place(key), key, '"%s" is no host name or address; allowed: one, such '
                         "as 192.168.0.10" % plc[key])
    if plc["wire"] != "block":
        if plc["second"]:
            report.error(map_.plc_place("second"), "second", "a pair needs wire=block, not %s"
                         % plc["wire"])
        for key in ("sync", "download"):
            if map_.on(key):
                report.error(map_.plc_place(key), key, "%s=on needs wire=block, not %s"
                             % (key, plc["wire"]))
    if map_.on("download") and not map_.on("sync"):
        report.error(map_.plc_place("download"), "download", "download=on needs sync=on")
    if map_.on("sync") and map_.number("layout_at") is not None:
        report.error(map_.plc_place("layout_at"), "layout_at",
                     "with sync=on the layout id is in the header; leave layout_at blank")
    if plc["wire"] in ("modbus", "etherip") and map_.number("layout_at") is not None and \
            plc["wire"] == "etherip":
        report.error(map_.plc_place("layout_at"), "layout_at", "EtherNet/IP has no blocks")
    _check_db_numbers(map_)
    if map_.number("watchdog") and map_.number("watchdog") < 1000:
        report.warning(map_.plc_place("watchdog"), "watchdog", "the IOC's heartbeat is 500 ms: "
                       "a watchdog below 1000 ms falls by itself")


def _check_db_numbers(map_):
    seen = {}
    for key in columns.OWN_BLOCKS:
        number = map_.plc[key]
        if number in seen:
            map_.report.error(map_.plc_place(key), key, "DB%s is %s already; allowed: another "
                              "number" % (number, seen[number]))
        seen[number] = key


# --- rows by themselves ------------------------------------------------------------------

def _check_rows(map_, placed):
    symbols = {}
    for item in map_.rows:
        if not item.symbol and item.dir != "reserved" and "symbol" in item.row.sheet.header:
            _error(map_, item, "symbol", "the row has no symbol; allowed: its name in the PLC")
        key = item.symbol.upper()
        if item.symbol and key in symbols:
            _error(map_, item, "symbol", "%s is there twice, see line %d; allowed: each name once"
                   % (item.symbol, symbols[key].row.line))
        symbols.setdefault(key, item)
        if item.type is None:
            continue
        _check_directions(map_, item, placed)
        if item.dir == "reserved" and (item.pv or item.shown.states):
            _error(map_, item, "pv" if item.pv else "states",
                   "reserved bytes have no record; allowed: dir in, out, cmd")


def _check_directions(map_, item, placed):
    blocks = map_.has_blocks()
    dirs = map_.dirs_of(item)
    if not blocks:
        for column in ("tx", "rx"):
            if item.row.get(column):
                _error(map_, item, column, "EtherNet/IP has tags and no places; leave it blank")
        if item.address is None and item.dir != "reserved":
            _error(map_, item, "plc", "EtherNet/IP needs the name of the tag")
        return
    wants_tx = "in" in dirs or ("out" in dirs and needs_readback(map_))
    wants_rx = bool(dirs & {"out", "cmd"})
    if item.dir == "reserved":
        if item.tx is None and item.rx is None and not item.row.get("tx") and \
                not item.row.get("rx"):
            _error(map_, item, "tx", "reserved bytes need a place: tx or rx")
        return
    if placed and wants_tx and item.tx is None and not item.row.get("tx"):
        _error(map_, item, "tx", "no place in the block to the IOC; `plcmap place` gives one")
    if placed and wants_rx and item.rx is None and not item.row.get("rx"):
        _error(map_, item, "rx", "no place in the block to the PLC; `plcmap place` gives one")
    if not wants_rx and item.row.get("rx"):
        _error(map_, item, "rx", "an input has no place in the block to the PLC; allowed: dir out "
               "or cmd, or leave rx blank")
    if dirs == {"cmd"} and item.row.get("tx"):
        _error(map_, item, "tx", "a command is not read back; allowed: dir out, or leave tx blank")


def needs_readback(map_):
    """Setpoints must be shown: with the handshake the PLC compares what it shows."""
    return map_.plc["wire"] == "block" and map_.on("sync")


# --- places in the blocks ------------------------------------------------------------------

def _check_blocks(map_):
    if not map_.has_blocks():
        return
    for side, header, name in (("tx", map_.tx_header(), "to the IOC"),
                               ("rx", map_.rx_header(), "to the PLC")):
        for item, byte, _, size in map_.uses(side):
            if byte < header:
                _error(map_, item, side, "bytes 0 to %d are the header of the block %s; allowed: "
                       "%d and up" % (header - 1, name, header))
            elif byte + size > 65536:
                _error(map_, item, side, "%d + %d bytes exceed the longest block, 65536"
                       % (byte, size))
            if byte & 1 and not map_.layout.anywhere(item.type) and \
                    not isinstance(item.type, Text):
                map_.report.warning(item.row.place(side), side, "%s at the odd byte %d: the "
                                    "blocks of an S7 cannot declare it" % (item.type, byte))


def _check_registers(map_):
    """The holding registers of both blocks: within the protocol's, and each of one block."""
    plc = map_.plc
    if plc["wire"] not in ("modbus", "block-modbus"):
        return
    ranges = {}
    for side, key, name in (("tx", "in_register", "input"), ("rx", "out_register", "output")):
        if side == "tx" and plc["wire"] != "modbus":
            continue
        first, count = map_.number(key) or 0, map_.block_size(side) // 2
        ranges[side] = first, first + count
        if first + count > 65536:
            map_.report.error(map_.plc_place(key), key, "%d registers of the %s from %d end at %d; allowed: "
                              "up to register 65535" % (count, name, first, first + count - 1))
    (low, end), (first, behind) = ranges.get("tx", (0, 0)), ranges["rx"]
    if first < end and low < behind:
        map_.report.error(map_.plc_place("out_register"), "out_register", "registers %d to %d are input and "
                          "output; allowed: %d and up" % (max(first, low), min(behind, end) - 1, end))


def _check_overlaps(map_):
    for side in ("tx", "rx"):
        taken = {}
        fixed = []
        if side == "tx" and map_.number("layout_at") is not None:
            at = map_.number("layout_at")
            fixed = [(at, at + 2, "the layout id (layout_at)")]
        for item, byte, bit, size in map_.uses(side):
            for low, high, name in fixed:
                if byte < high and low < byte + size:
                    _error(map_, item, side, "byte %d is taken by %s" % (max(low, byte), name))
            _claim(map_, taken, item, side, byte, bit, size)


def _claim(map_, taken, item, side, byte, bit, size):
    """Marks the bits of a row; the first one that another has is an error."""
    for b in range(byte, byte + size):
        old = taken.get(b)
        mask = 0xFF if bit is None else 1 << bit
        if old is None:
            taken[b] = [(mask, item)]
            continue
        for mask_, other in old:
            if mask_ & mask:
                place = "byte %d" % b if bit is None else "bit %d.%d" % (b, bit)
                _error(map_, item, side, "%s is taken by line %d (%s)%s"
                       % (place, other.row.line, other.symbol or "reserved", _grown(other, byte, side)))
                return
        old.append((mask, item))


def _grown(other, byte, side):
    """The way out, where a structure in front may have grown."""
    kind = other.type.element if isinstance(other.type, Array) else other.type
    return "; if %s has grown: `plcmap place --grow`" % kind if is_struct(kind) and \
        getattr(other, side)[0] < byte else "; leave it blank, then `plcmap place` finds a free place"


def _check_readback(map_):
    mirror = map_.number("readback")
    if not map_.has_blocks():
        return
    if mirror is None:
        for item in map_.rows:
            if item.tx is not None and item.rx is not None and item.tx[1] != item.rx[1]:
                _error(map_, item, "tx", "bit %d of the block to the PLC is read back as bit %d; "
                       "allowed: the same bit" % (item.rx[1], item.tx[1]))
        return
    header = map_.rx_header()
    low, high = mirror + header, mirror + map_.block_size("rx")
    if map_.tx_header() > low and high > low:
        map_.report.error(map_.plc_place("readback"), "readback", "setpoints would be shown in the "
                          "header; allowed: %d and up" % (map_.tx_header() - header))
    for item in map_.rows:
        if item.type is None or item.dir == "reserved":
            continue
        dirs = map_.dirs_of(item)
        if "cmd" in dirs:
            _error(map_, item, "dir", "a command is not shown: with readback=%d all bytes to the "
                   "PLC are; leave readback blank" % mirror)
        if "out" in dirs and item.tx is not None and item.rx is not None and \
                item.tx[0] != item.rx[0] + mirror:
            _error(map_, item, "tx", "readback=%d shows byte %d of the block to the PLC at byte %d, "
                   "not %d" % (mirror, item.rx[0], item.rx[0] + mirror, item.tx[0]))
        elif "out" in dirs and item.tx is not None and item.rx is not None and \
                item.tx[1] != item.rx[1]:
            _error(map_, item, "tx", "readback=%d: the bit numbers must be the same" % mirror)
        elif dirs == {"in"} and item.tx is not None and low <= item.tx[0] < high:
            _error(map_, item, "tx", "bytes %d to %d show the setpoints (readback=%d)"
                   % (low, high - 1, mirror))


# --- places in PLC memory ------------------------------------------------------------------

def _check_memory(map_):
    if not map_.has_blocks() or map_.plc["wire"] == "modbus":
        return
    ours = {map_.number(k): k for k in columns.OWN_BLOCKS}
    for item in map_.rows:
        a = item.address
        if item.type is None or a is None or not a.area or item.dir == "reserved":
            continue
        if map_.plc["family"] == "codesys":
            _error(map_, item, "plc", "%s is a place in an S7; allowed with family=codesys: the name "
                   "of a variable" % item.row.get("plc"))
            continue
        problem = misfit(item.type, a)
        if problem:
            _error(map_, item, "plc", problem)
        if a.area == "DB" and a.db in ours:
            _error(map_, item, "plc", "DB%d is %s, which the program itself uses; allowed: "
                   "another block, or another number for the key %s" % (a.db, ours[a.db], ours[a.db]))
        if a.byte & 1 and a.area == "DB" and not map_.layout.anywhere(item.type):
            _error(map_, item, "plc", "%s begins at an even byte in a DB, not %d"
                   % (item.type, a.byte))
        if a.byte + map_.size_of(item.type) > 65536:
            _error(map_, item, "plc", "%d + %d bytes exceed a data block, 65536"
                   % (a.byte, map_.size_of(item.type)))
        if a.area == "I" and map_.dirs_of(item) & {"out", "cmd"}:
            _error(map_, item, "plc", "an input of the PLC cannot be written; allowed: Q, M or a DB")
    _check_via(map_)
    _check_written(map_)


# How a program of the PLC can name a variable
_VARIABLES = {
    "codesys": (re.compile(r"%[\w.]+$|\.?[^\W\d]\w*\^?(\[[^\[\]\"';:]+\])?"
                           r"(\.([^\W\d]\w*\^?(\[[^\[\]\"';:]+\])?|\d+))*$"),
                "GVL.Tank.Level or Motors[3].Speed"),
    "s7-classic": (re.compile(r"(\"[^\"]+\"|[^\"#.][^\".]*)(\.(\"[^\"]+\"|[^\W\d]\w*)(\[[-\d, ]+\])?)*$"),
                   'Motor, "Motor 1".Speed'),
}
_VARIABLES["tia"] = _VARIABLES["s7-classic"]


def _check_variables(map_):
    """Symbols that become a part of the PLC's program are names there, and nothing else."""
    family = map_.plc["family"]
    if map_.plc["wire"] not in ("block", "block-modbus") or family not in _VARIABLES:
        return
    allowed, example = _VARIABLES[family]
    told = set()
    for leaf in map_.leaves():
        name = leaf.address.symbol if leaf.address is not None else \
            leaf.symbol if family == "codesys" else ""
        if name and id(leaf.owner) not in told and not allowed.match(name):
            told.add(id(leaf.owner))
            _error(map_, leaf.owner, "plc", "%s cannot be a variable in the PLC's program; allowed: such "
                   "as %s" % (name[:60], example))


def _check_tags(map_):
    """EtherNet/IP: names, types that a controller has, and tags that fit each other."""
    if map_.has_blocks():
        return
    root = tags.Node()
    for leaf in map_.leaves():
        arrays = [leaf.owner.type] + ([leaf.field.type] if leaf.field is not None else [])
        if any(low for kind in arrays if isinstance(kind, Array) for low, _ in kind.bounds):
            _error(map_, leaf.owner, "type", "%s: arrays of a controller begin at 0" % leaf.symbol)
        if leaf.address is None:
            continue
        try:
            column = "type"
            tags.kind_of(leaf.type)
            column = "plc"
            tags.add(root, leaf)
        except tags.TagProblem as e:
            _error(map_, leaf.owner, column, str(e))


def _check_via(map_):
    for side in ("tx", "rx"):
        leaves = [l for l in map_.leaves() if getattr(l, side) is not None]
        bits = same_source(map_, leaves, side)
        for leaf in leaves:
            item = leaf.owner
            way = method(map_, leaf, side, bits)
            if map_.on("download") and not item.via == "ptr" and not _in_table(leaf, way):
                _error(map_, item, "via", "download=on: %s would need a line in the PLC's program; "
                       "allowed: whole bytes of a DB or of M, by ptr" % leaf.symbol)
            elif item.via == "ptr" and leaf.address is None and item.row.get("plc"):
                pass  # told with the address
            elif item.via == "ptr" and (leaf.address is None or not leaf.address.area):
                _error(map_, item, "via", "a pointer needs an address such as DB10.DBW4 in column "
                       "plc, not a symbol" if leaf.address is not None else
                       "a pointer needs an address in column plc")
            elif item.via == "ptr" and leaf.dir == "cmd":
                _error(map_, item, "via", "a command is not compared, rows of the pointer table are; "
                       "allowed: explicit")
            elif item.via == "ptr" and leaf.is_bit():
                _check_bit_pointer(map_, item, side, bits, leaf)
            elif way == "explicit" and leaf.address.area and not leaf.is_bit() and \
                    leaf.size() not in (1, 2, 4):
                _error(map_, item, "via", "%s has %d bytes: an explicit transfer moves 1, 2 or 4; "
                       "allowed: ptr" % (leaf.type, leaf.size()))
            elif way == "explicit" and not leaf.address.area and (
                    isinstance(leaf.type, (Array, Text)) or leaf.type.kind in ("time", "raw")) and \
                    map_.plc["family"] in ("s7-classic", "tia"):
                _error(map_, item, "plc", "%s needs an address such as DB10.DBB4, not the symbol %s"
                       % (leaf.type, leaf.address.symbol))


def _in_table(leaf, way):
    """The table that the IOC brings moves it."""
    return way == "ptr" and leaf.address.area in ("DB", "M")


def _check_bit_pointer(map_, item, side, bits, leaf):
    byte, bit = getattr(leaf, side)
    source, mask = bits[byte]
    if leaf.address.bit != bit:
        _error(map_, item, "via", "a pointer moves whole bytes: bit %d of %s cannot become bit %d; "
               "allowed: explicit, or the same bit" % (leaf.address.bit, leaf.address.block(), bit))
    elif source is None:
        _error(map_, item, "via", "a pointer moves whole bytes: other bits of byte %d come from "
               "elsewhere, or are inputs in the PLC; allowed: explicit" % byte)
    elif side == "rx" and mask != 0xFF and map_.number("readback") is None:
        _error(map_, item, "via", "a pointer would write all 8 bits of %s, and nobody has the others; "
               "allowed: explicit, or the key readback" % leaf.address.text(1, leaf.address.bit))


def _check_written(map_):
    """No byte of PLC memory is written by two rows, and none is a read-back of another."""
    written = {}
    for leaf in map_.leaves():
        a = leaf.address
        if leaf.rx is None or a is None or not a.area:
            continue
        for byte in range(a.byte, a.byte + leaf.size()):
            mask = 0xFF if not leaf.is_bit() or a.bit is None else 1 << a.bit
            for mask_, other in written.setdefault((a.area, a.db, byte), []):
                if mask_ & mask and other.owner is not leaf.owner:
                    _error(map_, leaf.owner, "plc", "%s is written by line %d (%s) too; allowed: one row"
                           % (a.text(leaf.size()), other.owner.row.line, other.symbol))
                    return
            written[(a.area, a.db, byte)].append((mask, leaf))


# --- single values -------------------------------------------------------------------------

def _check_leaves(map_):
    names = {}
    rbv = map_.plc["rbv"]
    for leaf in map_.leaves():
        if isinstance(leaf.type, Text) and leaf.type.wide or \
                isinstance(leaf.type, Elementary) and leaf.type.kind == "raw" and \
                leaf.type.name != "DTL":
            _error(map_, leaf.owner, "type", "%s: no record shows %s; allowed: dir reserved, or "
                   "another type" % (leaf.symbol, leaf.type))
            continue
        if not leaf.pv:
            continue
        full = map_.plc["prefix"] + leaf.pv
        longest = full + (rbv if leaf.dir == "out" and rbv != "-" else "")
        _check_name(map_, leaf, full, longest, names)
        if leaf.dir == "out" and rbv != "-" and (leaf.tx is not None or not map_.has_blocks()):
            _check_taken(map_, leaf, longest, names)
        _check_shown(map_, leaf)
        _check_macros(map_, leaf)


def _cell(leaf, column):
    """Where a value comes from: the row of the type, or the map's own."""
    row = leaf.shown.row
    return row.place(column)


def _check_name(map_, leaf, full, longest, names):
    place = leaf.owner.row.place("pv")
    if not ASCII_PV.match(map_.plc["prefix"]) or re.search(r"[.$]", map_.plc["prefix"]):
        # told with the key
        full = full[len(map_.plc["prefix"]):]
    if not ASCII_PV.match(full) or full[:1] in "-+[{":
        map_.report.error(place, "pv", '"%s" has characters that no record name can have; allowed: '
                          "A-Z a-z 0-9 _ - : [ ] < > ;" % full)
    if "." in full or "$" in full:
        map_.report.error(place, "pv", '"%s": no . and no $ in a record name' % full)
    if len(longest) > columns.MAX_PV:
        map_.report.error(place, "pv", '"%s" has %d characters; allowed: %d'
                          % (longest, len(longest), columns.MAX_PV))
    _check_taken(map_, leaf, full, names)


def _check_macros(map_, leaf):
    """$( in a text would be taken for a macro when the records are loaded."""
    for column in ("desc", "egu", "states", "asg"):
        for row in {id(leaf.shown.row): leaf.shown.row,
                    id(leaf.owner.row): leaf.owner.row}.values():
            if "$(" in row.get(column) or "${" in row.get(column):
                map_.report.error(row.place(column), column,
                                  "$( would be taken for a macro; allowed: other characters")


def _check_taken(map_, leaf, name, names):
    other = names.get(name)
    if other is not None:
        map_.report.error(leaf.owner.row.place("pv"), "pv", 'record "%s" is there already: line %d '
                          "(%s); allowed: another name" % (name, other.owner.row.line, other.symbol))
    names[name] = leaf


def _check_shown(map_, leaf):
    shown, report, kind = leaf.shown, map_.report, leaf.type
    numeric = isinstance(kind, Elementary) and kind.kind in ("int", "uint", "bits", "real")
    limits = [(c, shown.limits[c]) for c in columns.LIMIT_COLUMNS if shown.limits[c] is not None]
    if limits and (not numeric or shown.states):
        report.error(_cell(leaf, limits[0][0]), limits[0][0],
                     "%s has no limits; allowed: numbers without states" %
                     ("a state" if shown.states else kind))
        limits = []
    for (a, va), (b, vb) in zip(limits, limits[1:]):
        if va > vb:
            report.error(_cell(leaf, b), b, "%s=%g is below %s=%g; allowed: lolo <= low <= high "
                         "<= hihi" % (b, vb, a, va))
    if shown.lopr is not None and shown.hopr is not None and shown.lopr >= shown.hopr:
        report.error(_cell(leaf, "hopr"), "hopr", "hopr=%g must be greater than lopr=%g"
                     % (shown.hopr, shown.lopr))
    if isinstance(kind, Text) and shown.egu:
        report.error(_cell(leaf, "egu"), "egu", "a text has no unit; leave it blank")
    _check_states(map_, leaf)
    _check_scale(map_, leaf, numeric, limits)
    if leaf.shown.fields and is_struct(leaf.owner.type) and leaf.field is None:
        report.error(_cell(leaf, "fields"), "fields", "a structure has no fields")


def _check_states(map_, leaf):
    states, kind = leaf.shown.states, leaf.type
    if states is None:
        return
    place = _cell(leaf, "states")
    if not isinstance(kind, Elementary) or kind.kind not in ("bool", "int", "uint", "bits"):
        map_.report.error(place, "states", "%s has no states; allowed: BOOL and whole numbers" % kind)
        return
    if kind.kind == "bool":
        if [s.value for s in states] != [0, 1]:
            map_.report.error(place, "states", "a BOOL has the states 0 and 1, such as off|on")
        return
    if kind.size == 8:
        map_.report.error(place, "states", "%s has no states; allowed: up to 32 bits" % kind)
        return
    low, high = RANGES[kind.name]
    for state in states:
        if not low <= state.value <= high:
            map_.report.error(place, "states", "state %d is beyond %s (%d ... %d)"
                              % (state.value, kind, low, high))


def _check_scale(map_, leaf, numeric, limits):
    shown, kind, report = leaf.shown, leaf.type, map_.report
    if (shown.raw is None) != (shown.eng is None):
        given = "raw" if shown.raw is not None else "eng"
        if leaf.shown.row.get("raw") == "" or leaf.shown.row.get("eng") == "":
            report.error(_cell(leaf, given), given, "%s needs %s beside it"
                         % (given, "eng" if given == "raw" else "raw"))
        return
    if shown.raw is None:
        _check_values(map_, leaf, numeric, limits)
        return
    if not numeric or kind.kind == "real" or kind.size > 4 or shown.states:
        report.error(_cell(leaf, "raw"), "raw", "%s is not scaled; allowed: integers to 32 bits "
                     "without states" % kind)
        return
    low, high = RANGES[kind.name]
    for end in shown.raw:
        if not low <= end <= high or end != int(end):
            report.error(_cell(leaf, "raw"), "raw", "%g is no %s (%d ... %d)" % (end, kind, low, high))
    if shown.raw[0] >= shown.raw[1]:
        report.error(_cell(leaf, "raw"), "raw", "%g..%g: the first must be less" % shown.raw)
        return
    slope = (shown.eng[1] - shown.eng[0]) / (shown.raw[1] - shown.raw[0])
    ends = sorted(shown.eng[0] + slope * (r - shown.raw[0]) for r in (low, high))
    for column, value in limits:
        if not ends[0] <= value <= ends[1]:
            report.error(_cell(leaf, column), column, "%g cannot be reached: %s goes from %g to %g"
                         % (value, kind, ends[0], ends[1]))


def _check_values(map_, leaf, numeric, limits):
    """Limits within the type."""
    kind = leaf.type
    if not numeric or kind.kind == "real":
        return
    low, high = RANGES[kind.name]
    for column, value in limits:
        if not low <= value <= high:
            map_.report.error(_cell(leaf, column), column, "%g cannot be reached: %s goes from %d "
                              "to %d" % (value, kind, low, high))


# --- what is defined and not used ------------------------------------------------------------

def _check_unused(map_):
    used = set()
    for leaf in map_.leaves():
        if leaf.shown.enum:
            used.add(leaf.shown.enum.upper())
    for typedef in map_.types.values():
        for field in typedef.fields:
            if field.shown.enum:
                used.add(field.shown.enum.upper())
    for key, enum in map_.enums.items():
        if key not in used:
            map_.report.warning(enum.row.place("enum"), "enum", "%s is used nowhere" % enum.name)
        if not enum.states:
            map_.report.error(enum.row.place("enum"), "enum", "%s has no states" % enum.name)
    if not map_.rows:
        sheet = map_.sheets["map"]
        map_.report.warning(Place(sheet.file, None, None, sheet.tab), None, "no rows")


__all__ = ["check", "needs_readback", "RANGES", "MAX_ROW"]
