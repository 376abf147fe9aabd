"""Gives places to what has none: rows in the blocks, fields in their types. What has a place
keeps it, always; only --grow moves rows whose type has outgrown their place."""
import bisect

from .check import needs_readback
from .types import Array, Elementary, Named, is_struct

LIMIT = 65536
NEIGHBOURS = 4
SLACK = 16  # bytes of a hole that a place beside its neighbour in the PLC may leave


class Room:
    """The bits of one block that are taken."""

    def __init__(self, map_, side):
        self.side = side
        self.header = map_.tx_header() if side == "tx" else map_.rx_header()
        self.refused = []  # (row, bytes) without room
        self.taken = bytearray(LIMIT + 8)
        self.bits = {}     # bytes that have single bits: byte -> PLC byte they come from
        self.by_memory = {}  # (area, db) -> [(PLC byte, block byte)]
        self.end = self.header
        self.taken[:self.header] = b"\xff" * self.header
        self.taken[LIMIT:] = b"\xff" * 8
        if side == "tx" and map_.number("layout_at") is not None:
            self.claim(map_.number("layout_at"), None, 2)
        for item, byte, bit, size in map_.uses(side):
            if byte + size <= LIMIT:
                self.put(item, byte, bit, size)

    def claim(self, byte, bit, size):
        if bit is not None:
            self.taken[byte] |= 1 << bit
            size = 1
        else:
            self.taken[byte:byte + size] = b"\xff" * size
        self.end = max(self.end, byte + size)

    def put(self, item, byte, bit, size):
        self.claim(byte, bit, size)
        a = item.address
        if a is not None and a.area:
            bisect.insort(self.by_memory.setdefault((a.area, a.db), []), (a.byte, byte))
        if bit is not None:
            source = (a.area, a.db, a.byte) if a is not None and a.area and a.bit == bit else None
            if self.bits.setdefault(byte, source) != source:
                self.bits[byte] = None

    def free(self, byte, bit, size):
        if byte < self.header or byte + size > LIMIT:
            return False
        if bit is not None:
            return not self.taken[byte] >> bit & 1
        return not any(self.taken[byte:byte + size])

    def beside(self, a, bit, size):
        """The place at the same distance as the neighbours in PLC memory, or None."""
        near = self.by_memory.get((a.area, a.db), [])
        middle = bisect.bisect(near, (a.byte, -1))
        near = near[max(middle - NEIGHBOURS, 0):middle + NEIGHBOURS]
        for memory, block in sorted(near, key=lambda m: (abs(m[0] - a.byte), m)):
            byte = block + a.byte - memory
            if byte > self.end + SLACK or not self.free(byte, bit, size):
                continue
            if bit is not None and self.taken[byte] and \
                    self.bits.get(byte) != (a.area, a.db, a.byte):
                continue
            return byte
        return None

    def find(self, even, size):
        """The first hole."""
        at = self.header
        while True:
            at = self.taken.find(bytes(size), at, LIMIT)
            if at < 0:
                return None
            if not even or at % 2 == 0:
                return at
            at += 1

    def find_bit(self, a, wanted=None):
        """A byte and a bit: among the bits of the same PLC byte, else in a new byte; bits that
        come from nowhere share a byte. wanted: the number that the bit must have."""
        if a is not None and a.area and a.bit is not None:
            source = (a.area, a.db, a.byte)
            for byte, other in self.bits.items():
                if other == source and self.free(byte, a.bit, 1):
                    return byte, a.bit
            byte = self.find(False, 1)
            return None if byte is None else (byte, a.bit)
        for byte, other in self.bits.items():
            if other is None:
                for bit in range(8) if wanted is None else [wanted]:
                    if self.free(byte, bit, 1):
                        return byte, bit
        byte = self.find(False, 1)
        return None if byte is None else (byte, wanted or 0)


def place(map_, grow=False):
    """Fills the blanks. Returns lines that say what has been placed; cells that could not be
    are errors in map_.report."""
    if not map_.has_blocks():
        return []
    lines = place_fields(map_)
    if grow:
        lines += _release(map_)
    rooms = {side: Room(map_, side) for side in ("rx", "tx")}
    mirror = map_.number("readback")
    rows = sorted(map_.rows, key=_in_memory)
    for item in rows:
        if item.type is None:
            continue
        dirs = map_.dirs_of(item)
        if dirs & {"out", "cmd"} and item.rx is None and not item.row.get("rx"):
            if mirror is not None and item.tx is not None and "out" in dirs:
                lines += _set(map_, rooms["rx"], item, item.tx[0] - mirror, item.tx[1])
            else:
                lines += _fill(map_, rooms["rx"], item)
    if mirror is not None:
        low, high = mirror + map_.rx_header(), min(mirror + map_.block_size("rx"), LIMIT)
        if _shows_input(map_, rows, low, high):
            return []
        if low < high:  # whole bytes: the other bits, too, are those of setpoints
            rooms["tx"].claim(low, None, high - low)
    for item in rows:
        if item.type is None or item.tx is not None or item.row.get("tx"):
            continue
        dirs = map_.dirs_of(item)
        if "out" in dirs and mirror is not None and item.rx is not None:
            lines += _set(map_, rooms["tx"], item, item.rx[0] + mirror, item.rx[1])
        elif "in" in dirs or ("out" in dirs and needs_readback(map_)):
            lines += _fill(map_, rooms["tx"], item)
    for room in rooms.values():
        _tell_refused(map_, room)
    return lines


def _tell_refused(map_, room):
    """One line for all rows that a block has no room for."""
    if room.refused:
        item, size = room.refused[0]
        more = len(room.refused) - 1
        map_.report.error(item.row.place(room.side), room.side, "no room for %d bytes%s: a block has at "
                          "most %d; allowed: fewer rows, or a PLC for a part of them"
                          % (size, ", and for %d more rows" % more if more else "", LIMIT))


def _shows_input(map_, rows, low, high):
    """An input stands in bytes low to high - 1, where setpoints that just got a place would be
    shown: an error."""
    for other, byte, _, _ in map_.uses("tx"):
        if map_.dirs_of(other) != {"in"} or not low <= byte < high:
            continue
        for item in rows:
            if item.rx is not None and not item.tx and "out" in map_.dirs_of(item):
                map_.report.error(
                    item.row.place("rx"), "rx", "no room: readback=%d would show setpoints in bytes "
                    "%d to %d, and %s is at %d; allowed: leave the key readback blank, then each "
                    "setpoint is shown where there is room"
                    % (map_.number("readback"), low, high - 1, other.symbol, byte))
                return True
    return False


def _in_memory(item):
    """New rows get their places in the order of PLC memory, so that few pointer rows move them;
    what has no address there, in the order of the map."""
    a = item.address
    if a is None or not a.area:
        return (1, "", 0, 0, 0)
    return (0, a.area, a.db, a.byte, a.bit or 0)


def _is_bit(item):
    return isinstance(item.type, Elementary) and item.type.kind == "bool"


def _fill(map_, room, item):
    size = map_.size_of(item.type)
    even = not map_.layout.anywhere(item.type)
    a = item.address
    if _is_bit(item):
        bit = a.bit if a is not None and a.area else None
        byte = room.beside(a, bit, 1) if bit is not None else None
        found = (byte, bit) if byte is not None else room.find_bit(
            a, item.rx[1] if room.side == "tx" and item.rx is not None else None)
    else:
        byte = room.beside(a, None, size) if a is not None and a.area else None
        if byte is None or (even and byte & 1):
            byte = room.find(even, size)
        found = None if byte is None else (byte, None)
    if found is None:
        room.refused.append((item, size))
        return []
    return _set(map_, room, item, *found)


def _set(map_, room, item, byte, bit):
    text = "%d" % byte if bit is None else "%d.%d" % (byte, bit)
    setattr(item, room.side, (byte, bit))
    item.row.sheet.column(room.side)
    item.row.cells[room.side] = text
    if 0 <= byte < LIMIT:
        room.put(item, byte, bit, map_.size_of(item.type))
    map_.changed()
    return ["%s: %s %s at %s" % (item.row.place(room.side), item.symbol, room.side, text)]


def _release(map_):
    """Takes the place away from structures and arrays of them that reach into the next row. Where
    all setpoints are mirrored, on both sides."""
    lines = []
    for side in ("tx", "rx"):
        uses = sorted(map_.uses(side), key=lambda u: (u[1], u[2] or 0))
        for (item, byte, _, size), (_, after, _, _) in zip(uses, uses[1:]):
            kind = item.type.element if isinstance(item.type, Array) else item.type
            if byte + size > after and is_struct(kind) and getattr(item, side) is not None:
                lines.append("%s: %s has outgrown %s %d: %d bytes, and the next row is at %d"
                             % (item.row.place(side), item.symbol, side, byte, size, after))
                mirrored = map_.number("readback") is not None and item.rx is not None
                for given_up in ("tx", "rx") if mirrored else (side,):
                    setattr(item, given_up, None)
                    item.row.cells.pop(given_up, None)
    map_.changed()
    return lines


def grow_types(map_):
    """Moves fields that others have grown into: inside their type, the first of them and all behind
    it are laid out anew, as an S7 does it. Returns lines; the map must be read anew then."""
    lines, done = [], set()
    if not map_.broken:
        for key in map_.types:
            _grow_type(map_, key, done, lines)
    return lines


def _grow_type(map_, key, done, lines):
    if key in done or key not in map_.types:
        return
    done.add(key)
    typedef = map_.types[key]
    fields = [f for f in typedef.fields if f.type is not None]
    for field in fields:
        kind = field.type.element if isinstance(field.type, Array) else field.type
        if isinstance(kind, Named):
            _grow_type(map_, kind.name.upper(), done, lines)
    fields = sorted((f for f in fields if f.at is not None), key=lambda f: (f.at[0], f.at[1] or 0))
    first, grown = _first_hit(map_, fields)
    if first is None:
        return
    placed = map_.layout.walk([(f.name, f.type, f.at if n < first else None)
                               for n, f in enumerate(fields)])[0]
    for field, (_, _, byte, bit) in list(zip(fields, placed))[first:]:
        before = field.row.get("at")
        lines.append("%s, was %s: %s has grown" % (_pin(typedef, field, byte, bit), before,
                                                   grown.name or "a reserved field"))
    map_.relay()


def _first_hit(map_, fields):
    """(index of the first field that another one reaches into, that one), or (None, None)."""
    end, last = (0, 0), None
    for number, field in enumerate(fields):
        if (field.at[0], field.at[1] or 0) < end:
            return number, last
        byte, bit = field.at
        end, last = ((byte, bit + 1) if bit is not None else
                     (byte + map_.size_of(field.type), 0)), field
    return None, None


def place_fields(map_):
    """Pins the fields of all types: where nothing is pinned, as an S7 places them; else behind
    what is there."""
    lines = []
    for typedef in map_.types.values():
        fields = [f for f in typedef.fields if f.type]
        blank = [f for f in fields if f.at is None and not f.row.get("at")]
        if not blank:
            continue
        placed = map_.layout.fields(Named(typedef.name))[0]
        for field, (_, _, byte, bit) in zip(fields, placed):
            if field in blank:
                lines.append(_pin(typedef, field, byte, bit))
    if lines:
        map_.relay()
    return lines


def _pin(typedef, field, byte, bit):
    field.at = (byte, bit)
    text = "%d" % byte if bit is None else "%d.%d" % (byte, bit)
    field.row.sheet.column("at")
    field.row.cells["at"] = text
    return "%s: %s.%s at %s" % (field.row.place("at"), typedef.name, field.name or "reserved", text)


def compact(map_):
    """Removes reserved rows: their bytes are free again. Returns lines that say which."""
    lines = []
    sheet = map_.sheets["map"]
    for item in [r for r in map_.rows if r.dir == "reserved"]:
        lines.append("%s: %s is no longer reserved" % (item.row.place("symbol"),
                                                        item.symbol or "(no name)"))
        sheet.rows.remove(item.row)
        map_.rows.remove(item)
    map_.changed()
    return lines
