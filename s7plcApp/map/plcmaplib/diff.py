"""Two versions of a map: what came, went, moved, changed; and whether both sides must be
loaded together."""
from . import columns
from .show import place_text
from .transfer import layout_crc, layout_id

PLACES = ("tx", "rx")


def diff(old, new):
    """Lines. Rows are matched by their symbol, types by name and field."""
    lines = []
    lines += _plc(old, new)
    before = {r.symbol: r for r in old.rows if r.symbol}
    after = {r.symbol: r for r in new.rows if r.symbol}
    for symbol, row in before.items():
        if symbol not in after:
            lines.append("- %s %s%s" % (symbol, row.row.get("type"), _places(row)))
    for symbol, row in after.items():
        if symbol not in before:
            lines.append("+ %s %s%s" % (symbol, row.row.get("type"), _places(row)))
            continue
        lines += _row(symbol, before[symbol], row)
    lines += _sheet(old, new, "types", ("type", "field"), columns.TYPE_COLUMNS)
    lines += _sheet(old, new, "enums", ("enum", "value"), columns.ENUM_COLUMNS)
    for side, name in (("tx", "in"), ("rx", "out")):
        sizes = old.block_size(side), new.block_size(side)
        if sizes[0] != sizes[1]:
            lines.append("%s: %d bytes, were %d" % (name, sizes[1], sizes[0]))
    return lines + [_layout(layout_crc(old), layout_crc(new))]


def _layout(old, new):
    """Whether both sides must be loaded together."""
    before, after = layout_id(old), layout_id(new)
    if old == new:
        return "layout id: %d as before; the PLC's program fits" % after
    if before == after:  # one in 65535
        return ("layout id: %d as before by chance, but the layout is another: raise min_in by 2 for "
                "another id; PLC and IOC must be loaded together" % after)
    return "layout id: %d, was %d; PLC and IOC must be loaded together" % (after, before)


def _places(row):
    text = "".join(" %s %s" % (s, place_text(getattr(row, s))) for s in PLACES if getattr(row, s))
    return text


def _plc(old, new):
    return ["plc %s: %s, was %s" % (key, new.plc[key] or "(blank)", old.plc[key] or "(blank)")
            for key in columns.PLC_KEYS if old.plc[key] != new.plc[key]]


def _row(symbol, old, new):
    lines = []
    for side in PLACES:
        a, b = place_text(getattr(old, side)), place_text(getattr(new, side))
        if a != b:
            lines.append("> %s %s %s, was %s" % (symbol, side, b or "(none)", a or "(none)"))
    for column in columns.MAP_COLUMNS:
        a, b = old.row.get(column), new.row.get(column)
        if column not in PLACES and a != b:
            lines.append("* %s %s: %s, was %s" % (symbol, column, b or "(blank)", a or "(blank)"))
    return lines


def _keyed(map_, name, keys):
    """{(type, field): row}; a blank name is that of the row above."""
    sheet = map_.sheets.get(name)
    found, last = {}, ""
    for row in sheet.rows if sheet else []:
        last = row.get(keys[0]) or last
        found[(last, row.get(keys[1]))] = row
    return found


def _sheet(old, new, name, keys, table):
    lines = []
    before, after = _keyed(old, name, keys), _keyed(new, name, keys)
    for key in before:
        if key not in after:
            lines.append("- %s %s" % (name[:-1], ".".join(key)))
    for key, row in after.items():
        if key not in before:
            lines.append("+ %s %s" % (name[:-1], ".".join(key)))
            continue
        for column in table:
            a, b = before[key].get(column), row.get(column)
            if column not in keys and a != b:
                lines.append("* %s %s %s: %s, was %s" % (name[:-1], ".".join(key), column,
                                                         b or "(blank)", a or "(blank)"))
    return lines
