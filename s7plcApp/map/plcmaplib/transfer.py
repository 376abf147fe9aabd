"""Which bytes of PLC memory go where in the blocks: pointer rows, explicit transfers, the
pointer table that the IOC can download, and the layout id.

A pointer row moves up to 1024 bytes from one block to another (BLKMOV); an explicit transfer
moves a bit, byte, word or double word. Rows that lie side by side on both ends are one.
"""
import re
import zlib

from .types import Array, Elementary, is_struct

MAX_ROW = 1024  # bytes of a pointer row


class Span:
    """A pointer row: bytes of PLC memory at `memory`, of the block at `offset`. wide: it may take a
    byte between two values along."""
    __slots__ = ("memory", "offset", "length", "names", "wide")

    def __init__(self, memory, offset, length, names, wide=False):
        self.memory = memory
        self.offset = offset
        self.length = length
        self.names = names
        self.wide = wide


class Explicit:
    """One value by itself; memory may be a symbol."""
    __slots__ = ("leaf", "memory", "offset", "bit", "size", "compared")

    def __init__(self, leaf, offset, bit, size):
        self.leaf = leaf
        self.memory = leaf.address
        self.offset = offset
        self.bit = bit
        self.size = size
        self.compared = leaf.dir != "cmd"


class Transfers:
    """What moves on one side ("tx": PLC to IOC, "rx")."""

    def __init__(self, side):
        self.side = side
        self.spans = []
        self.explicit = []
        self.unmoved = []  # leaves without a place in PLC memory


def _whole(item):
    """A structure or an array of them that moves as it stands in memory."""
    kind = item.type.element if isinstance(item.type, Array) else item.type
    return is_struct(kind) or isinstance(item.type, Array)


def inputs(map_):
    """Bytes of PLC memory, (area, db, byte), that have inputs: no setpoint may move them too."""
    found = set()
    for leaf in map_.leaves():
        a = leaf.address
        if leaf.dir == "in" and a is not None and a.area:
            found.update((a.area, a.db, a.byte + i) for i in range(leaf.size()))
    return found


def same_source(map_, leaves, side):
    """{block byte: the one PLC byte that all its bits come from at their own numbers, or None}
    of single bits. None, too, for a byte to the PLC that has inputs there."""
    found = {}
    foreign = inputs(map_) if side == "rx" else ()
    for leaf in leaves:
        if not leaf.is_bit():
            continue
        byte, bit = getattr(leaf, side)
        a = leaf.address
        source = (a.area, a.db, a.byte) if a is not None and a.area and a.bit == bit else None
        if source in foreign:
            source = None
        if byte in found and found[byte][0] != source:
            found[byte] = (None, 0)
        else:
            mask = found.get(byte, (source, 0))[1]
            found[byte] = (source, mask | 1 << bit)
    return found


def method(map_, leaf, side, bits):
    """How a leaf moves: "ptr", "explicit" or "" (nothing is known of its place in the PLC)."""
    via = leaf.owner.via
    a = leaf.address
    if a is None:
        return ""
    if not a.area or leaf.dir == "cmd" or via == "explicit":
        return "explicit"
    if via == "ptr":
        return "ptr"
    small = leaf.is_bit() or leaf.size() in (1, 2, 4)
    if side == "rx" and a.area in "IQ" and small:
        return "explicit"
    if leaf.is_bit():
        source, mask = bits[getattr(leaf, side)[0]]
        if source is None:
            return "explicit"
        if side == "rx" and mask != 0xFF and not map_.on("download"):
            return "explicit"  # the other bits are somebody's
    return "ptr"


def transfers(map_, side):
    """All transfers of one side."""
    found = Transfers(side)
    leaves = [l for l in map_.leaves() if getattr(l, side) is not None]
    bits = same_source(map_, leaves, side)
    spans, by_item = [], {}
    for leaf in leaves:
        by_item.setdefault(id(leaf.owner), []).append(leaf)
    for group in by_item.values():
        ways = [method(map_, leaf, side, bits) for leaf in group]
        item = group[0].owner
        if set(ways) == {"ptr"} and _whole(item) and len({l.dir for l in group}) == 1 and \
                (side == "tx" or map_.number("readback") is not None):
            at = getattr(item, side)[0]
            spans.append(Span(item.address.plus(0), at, map_.size_of(item.type), [item.symbol],
                              _wide(map_, item, side)))
            continue
        for leaf, way in zip(group, ways):
            byte, bit = getattr(leaf, side)
            if way == "":
                found.unmoved.append(leaf)
            elif way == "explicit":
                found.explicit.append(Explicit(leaf, byte, bit, leaf.size()))
            else:
                spans.append(Span(leaf.address.plus(0), byte, leaf.size(), [leaf.symbol],
                                  _wide(map_, item, side)))
    found.spans = _joined(map_, spans, side)
    found.explicit.sort(key=lambda e: (e.offset, e.bit or 0))
    return found


def _wide(map_, item, side):
    """May a pointer row move a byte beside this row's that no row has? To the IOC always; to the
    PLC where it comes back as it was shown, and via says ptr or there is no other way."""
    return side == "tx" or (map_.number("readback") is not None and
                            (item.via == "ptr" or map_.on("download")))


def owned(map_, side):
    """Bytes of a block that rows have."""
    taken = set()
    for _, byte, _, size in map_.uses(side):
        taken.update(range(byte, byte + size))
    return taken


def _joined(map_, spans, side):
    """Neighbours of equal distance as one row, over a single byte that nobody has, too, where
    both are wide and it is no input."""
    taken = owned(map_, side)
    foreign = inputs(map_) if side == "rx" else ()
    out = []
    for span in sorted(spans, key=lambda s: (s.memory.area, s.memory.db, s.memory.byte, s.offset)):
        last = out[-1] if out else None
        if last and (last.memory.area, last.memory.db) == (span.memory.area, span.memory.db) and \
                span.memory.byte - last.memory.byte == span.offset - last.offset:
            gap = span.offset - last.offset - last.length
            if gap < 0 and span.offset + span.length <= last.offset + last.length:
                last.names += span.names  # another bit of the same byte
                continue
            memory = (last.memory.area, last.memory.db, last.memory.byte + last.length)
            if gap == 0 or (gap == 1 and last.wide and span.wide and last.offset + last.length not in taken and
                            memory not in foreign):
                last.length = span.offset + span.length - last.offset
                last.names += span.names
                last.wide = span.wide
                continue
        out.append(Span(span.memory, span.offset, span.length, list(span.names), span.wide))
    return _cut(out)


def _cut(spans):
    """Rows of at most MAX_ROW bytes, in the order of the block."""
    out = []
    for span in spans:
        done = 0
        while done < span.length:
            part = min(MAX_ROW, span.length - done)
            out.append(Span(span.memory.plus(done), span.offset + done, part, span.names))
            done += part
    return sorted(out, key=lambda s: s.offset)


def table(map_, layout, tx, rx):
    """The bytes of the pointer table for the download, CRC filled in: layout id, rows TX, rows
    RX, CRC-32, then source and destination of each row; big-endian."""
    from .address import Address
    rows = b""
    tx_block = Address("DB", map_.number("tx_db"), 0)
    rx_block = Address("DB", map_.number("rx_db"), 0)
    for span in tx.spans:
        rows += span.memory.any_pointer(span.length) + \
            tx_block.plus(span.offset).any_pointer(span.length)
    for span in rx.spans:
        rows += rx_block.plus(span.offset).any_pointer(span.length) + \
            span.memory.any_pointer(span.length)
    head = layout.to_bytes(2, "big") + len(tx.spans).to_bytes(2, "big") + \
        len(rx.spans).to_bytes(2, "big")
    crc = zlib.crc32(head + bytes(4) + rows) & 0xFFFFFFFF
    return head + crc.to_bytes(4, "big") + rows


def _type_key(kind):
    """A type as its bytes are: bounds and names do not count."""
    if isinstance(kind, Array):
        return "%d*%s" % (kind.count(), kind.element)
    return str(kind)


def _source(leaf):
    """Where a value comes from: the PLC's place of its row, else the row's symbol there, else its
    symbol in the map; and the names of fields on the way. Bounds of arrays do not count."""
    a, item = leaf.owner.address, leaf.owner
    if a is not None and a.area:
        start = "%s %d" % (a.block(), a.byte) + ("" if a.bit is None else ".%d" % a.bit)
    else:
        start = (a.symbol if a is not None else item.symbol).upper()
    return start + re.sub(r"\[[^\]]*\]", "[]", leaf.member).upper()


def layout_crc(map_):
    """CRC-32 over what the bytes of both blocks mean: side, place, type and source of each value.
    Symbols of rows with an address, records, limits and texts do not count."""
    lines = []
    for leaf in map_.leaves():
        for side in ("tx", "rx"):
            place = getattr(leaf, side)
            if place is None:
                continue
            at = "%d" % place[0] if place[1] is None else "%d.%d" % place
            lines.append("%s %s %s %s" % (side, at, _type_key(leaf.type), _source(leaf)))
    lines.sort()
    lines.append("in %d out %d %s" % (map_.block_size("tx"), map_.block_size("rx"),
                                      map_.plc["byteorder"]))
    if not map_.has_blocks():
        lines = ["tag %s %s" % (l.address.symbol if l.address else "", _type_key(l.type))
                 for l in map_.leaves()]
        lines.sort()
    return zlib.crc32("\n".join(lines).encode("utf-8")) & 0xFFFFFFFF


def layout_id(crc):
    """The CRC folded to 1 ... 65535."""
    return (crc >> 16 ^ crc & 0xFFFF) or 1


__all__ = ["Span", "Explicit", "Transfers", "transfers", "table", "layout_crc",
           "layout_id", "method", "owned", "Elementary"]
