"""The map for people: the blocks byte by byte, free places, transfers; one value in full."""
import re

from .problems import Place, Refused, nearest
from .transfer import layout_crc, layout_id, owned, transfers


def ranges(numbers):
    """[(first, last)] of a set of numbers."""
    found = []
    for n in sorted(numbers):
        if found and n == found[-1][1] + 1:
            found[-1][1] = n
        else:
            found.append([n, n])
    return [tuple(f) for f in found]


def span_text(first, last):
    return "%d" % first if first == last else "%d-%d" % (first, last)


def place_text(place):
    return "" if place is None else "%d" % place[0] if place[1] is None else "%d.%d" % place


def free_places(map_, side):
    """[(first, last)] of bytes that nobody has."""
    header = map_.tx_header() if side == "tx" else map_.rx_header()
    taken = owned(map_, side)
    if side == "tx" and map_.number("layout_at") is not None:
        taken |= {map_.number("layout_at"), map_.number("layout_at") + 1}
    return ranges(set(range(header, map_.block_size(side))) - taken)


def head(map_):
    crc = layout_crc(map_)
    lines = ["%s: %d rows, %d values, layout id %d (0x%04X), CRC 0x%08X" % (
        map_.plc["name"], len(map_.rows), len(map_.leaves()), layout_id(crc), layout_id(crc), crc)]
    if map_.has_blocks():
        lines.append("in %d bytes (PLC to IOC), out %d bytes, %s-endian" % (
            map_.block_size("tx"), map_.block_size("rx"), map_.plc["byteorder"]))
    return lines


def picture(map_, side):
    """Lines: bytes, symbol, type, record."""
    header = map_.tx_header() if side == "tx" else map_.rx_header()
    lines = []
    if header:
        lines.append((0, 0, header, None, "header"))
    if side == "tx" and map_.number("layout_at") is not None:
        lines.append((map_.number("layout_at"), 0, 2, None, "layout id"))
    for item, byte, bit, size in map_.uses(side):
        text = "%-24s %-22s %s" % (item.symbol or "-", item.type,
                                   item.pv if item.dir != "reserved" else "reserved")
        lines.append((byte, bit or 0, size, bit, text.rstrip()))
    for first, last in free_places(map_, side):
        lines.append((first, 0, last - first + 1, None, "free"))
    out = []
    for byte, _, size, bit, text in sorted(lines, key=lambda l: (l[0], l[1])):
        place = span_text(byte, byte + size - 1) if bit is None else "%d.%d" % (byte, bit)
        out.append("  %-12s %s" % (place, text))
    return out


def transfer_lines(map_, side):
    found = transfers(map_, side)
    arrow = "->" if side == "tx" else "<-"
    lines = ["  ptr       %s%s BYTE %d %s %d" % (
        "P#", s.memory.text(1, 0), s.length, arrow, s.offset) for s in found.spans]
    for e in found.explicit:
        place = "%d" % e.offset if e.bit is None else "%d.%d" % (e.offset, e.bit)
        lines.append("  explicit  %s %s %s" % (e.memory.text(e.size), arrow, place))
    for leaf in found.unmoved:
        lines.append("  ?         %s: no place in the PLC is known" % leaf.symbol)
    return lines


def show(map_, what=None):
    """Lines for the command show. what: None, a byte such as 54 or out.54, a symbol or a PV."""
    if what:
        return _show_one(map_, what)
    lines = head(map_)
    for side, name in (("tx", "PLC to IOC"), ("rx", "IOC to PLC")):
        if not map_.has_blocks() or not map_.block_size(side):
            continue
        lines += ["", "block %s, %d bytes" % (name, map_.block_size(side))]
        lines += picture(map_, side)
        moved = transfer_lines(map_, side)
        if moved:
            lines += ["", "transfers %s" % name] + moved
    return lines


def _show_one(map_, what):
    """All values at a byte, or of a name."""
    m = re.match(r"^(?:(in|out|tx|rx)\.)?(\d+)$", what)
    sides = ("tx", "rx") if not m or not m.group(1) else \
        ("tx",) if m.group(1) in ("in", "tx") else ("rx",)
    lines = []
    for leaf in map_.leaves():
        full = map_.plc["prefix"] + leaf.pv
        if m:
            byte = int(m.group(2))
            hit = any(getattr(leaf, s) is not None and
                      getattr(leaf, s)[0] <= byte < getattr(leaf, s)[0] + leaf.size()
                      for s in sides)
        else:
            hit = what in (leaf.symbol, leaf.pv, full) or leaf.owner.symbol == what
        if hit:
            lines += _one(map_, leaf)
    if lines:
        return lines
    if not m:
        raise Refused('no symbol and no record "%s"%s; allowed: one of the map, or a byte such as 54 '
                      "or out.10" % (what, nearest(what, [l.symbol for l in map_.leaves()])), Place(map_.path))
    ends = [map_.block_size(side) for side in sides] if map_.has_blocks() else [0]
    if int(m.group(2)) >= max(ends):
        raise Refused("no byte %s; allowed: below %d" % (what, max(ends)) if max(ends) else
                      "no byte %s: there is no block" % what, Place(map_.path))
    return ["nothing is at byte %s" % what]


def _one(map_, leaf):
    item = leaf.owner
    rows = [("symbol", leaf.symbol), ("type", str(leaf.type)), ("dir", leaf.dir),
            ("tx", place_text(leaf.tx)), ("rx", place_text(leaf.rx)),
            ("plc", leaf.address.text(leaf.size(), leaf.address.bit) if leaf.address else ""),
            ("record", map_.plc["prefix"] + leaf.pv if leaf.pv else ""), ("desc", leaf.desc()),
            ("row", str(item.row.place()))]
    if leaf.field is not None:
        rows.append(("field", str(leaf.field.row.place())))
    return ["%-8s %s" % (k, v) for k, v in rows if v] + [""]
