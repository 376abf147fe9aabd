"""The map for the manual: Markdown and HTML, with a picture of both blocks (SVG)."""
import html

from ..show import place_text, span_text, free_places, transfer_lines
from ..transfer import layout_id

COLORS = {"in": "#cfe3f7", "out": "#fbe0b8", "cmd": "#f6c7c0", "reserved": "#e4e4e4",
          "free": "#ffffff", "header": "#d8d8d8"}
PER_LINE = 16


def _limits(shown):
    parts = ["%s %g %s" % (c, v, shown.severities[c]) for c, v in shown.limits.items()
             if v is not None]
    if shown.states:
        parts += ["%d %s%s" % (s.value, s.text, " (%s)" % s.severity if s.severity else "")
                  for s in shown.states]
    if shown.raw is not None:
        parts.append("raw %g..%g = %g..%g" % (shown.raw + shown.eng))
    return ", ".join(parts)


def _table(map_):
    """Rows of texts for all values."""
    rows = []
    for leaf in map_.leaves():
        where = leaf.address.text(leaf.size(), leaf.address.bit) if leaf.address else ""
        rows.append([leaf.symbol, where, str(leaf.type), leaf.dir, place_text(leaf.tx),
                     place_text(leaf.rx), map_.plc["prefix"] + leaf.pv if leaf.pv else "",
                     leaf.desc(), leaf.shown.egu, _limits(leaf.shown),
                     leaf.shown.note or leaf.owner.shown.note])
    return rows


HEADS = ["symbol", "PLC", "type", "dir", "tx", "rx", "record", "description", "unit",
         "limits, states", "note"]


def facts(map_, crc):
    """What belongs to the whole."""
    lines = ["PLC %s, %s, %s" % (map_.plc["name"], map_.plc["wire"], map_.plc["family"])]
    if map_.has_blocks():
        lines.append("block PLC to IOC %d bytes, IOC to PLC %d bytes, %s-endian" % (
            map_.block_size("tx"), map_.block_size("rx"), map_.plc["byteorder"]))
    lines.append("layout id %d (0x%04X), CRC-32 0x%08X" % (layout_id(crc), layout_id(crc), crc))
    return lines


def _escaped(text):
    return text.replace("|", "\\|").replace("<", "&lt;")


def markdown(map_, name, head, crc):
    lines = [head, "", "# %s: map of the PLC" % name, ""]
    lines += ["- %s" % f for f in facts(map_, crc)] + [""]
    lines += ["| %s |" % " | ".join(HEADS), "|%s" % ("---|" * len(HEADS))]
    lines += ["| %s |" % " | ".join(_escaped(c) for c in row) for row in _table(map_)]
    for side, title in (("tx", "PLC to IOC"), ("rx", "IOC to PLC")):
        moved = transfer_lines(map_, side)
        if moved:
            lines += ["", "## Transfers %s" % title, "", "```"] + moved + ["```"]
    lines += ["", "![blocks](%s.svg)" % name]
    return "\n".join(lines) + "\n"


def _cells(map_, side):
    """[(first byte, last byte, kind, text)] of a block, without overlap."""
    header = map_.tx_header() if side == "tx" else map_.rx_header()
    cells = [(0, header - 1, "header", "header")] if header else []
    if side == "tx" and map_.number("layout_at") is not None:
        at = map_.number("layout_at")
        cells.append((at, at + 1, "header", "layout"))
    bits = {}
    for item, byte, bit, size in map_.uses(side):
        if bit is not None:
            bits.setdefault(byte, []).append(item)
            continue
        cells.append((byte, byte + size - 1, item.dir, item.symbol or "reserved"))
    for byte, items in bits.items():
        cells.append((byte, byte, items[0].dir, items[0].symbol if len(items) == 1
                      else "%d bits" % len(items)))
    cells += [(a, b, "free", "") for a, b in free_places(map_, side)]
    return sorted(cells)


def picture(map_, head):
    """Both blocks as SVG, 16 bytes in a line."""
    width, high, left = 62, 26, 50
    shapes, y = [], 20
    for side, title in (("tx", "PLC to IOC"), ("rx", "IOC to PLC")):
        size = map_.block_size(side)
        if not size:
            continue
        shapes.append('<text x="4" y="%d" font-weight="bold">%s, %d bytes</text>'
                      % (y, title, size))
        y += 10
        for line in range((size + PER_LINE - 1) // PER_LINE):
            shapes.append('<text x="4" y="%d">%d</text>' % (y + line * high + 17, line * PER_LINE))
        for first, last, kind, text in _cells(map_, side):
            shapes += _boxes(first, last, kind, text, left, y, width, high)
        y += ((size + PER_LINE - 1) // PER_LINE) * high + 34
    return ('<svg xmlns="http://www.w3.org/2000/svg" width="%d" height="%d" '
            'font-family="sans-serif" font-size="11">\n<!-- %s -->\n%s\n</svg>' % (
                left + PER_LINE * width + 10, y, html.escape(head.strip("#<!-> ")),
                "\n".join(shapes)))


def _boxes(first, last, kind, text, left, y, width, high):
    """A cell, cut at the ends of lines."""
    found = []
    byte = first
    while byte <= last:
        end = min(last, byte // PER_LINE * PER_LINE + PER_LINE - 1)
        x = left + byte % PER_LINE * width
        wide = (end - byte + 1) * width
        top = y + byte // PER_LINE * high
        fits = max(1, wide // 7)
        shown = text if len(text) <= fits else text[:max(1, fits - 1)] + "\u2026"
        found.append('<g><title>%s %s</title><rect x="%d" y="%d" width="%d" height="%d" fill="%s" '
                     'stroke="#555"/><text x="%d" y="%d">%s</text></g>' % (
                         span_text(first, last), html.escape(text), x, top, wide, high,
                         COLORS[kind], x + 3, top + 17, html.escape(shown) if byte == first
                         else ""))
        byte = end + 1
    return found


def page(map_, name, head, crc):
    """The same as one HTML file."""
    escape = html.escape
    rows = "\n".join("<tr>%s</tr>" % "".join("<td>%s</td>" % escape(c) for c in row)
                     for row in _table(map_))
    moved = "\n".join("<h2>Transfers %s</h2>\n<pre>%s</pre>" % (
        title, escape("\n".join(transfer_lines(map_, side))))
        for side, title in (("tx", "PLC to IOC"), ("rx", "IOC to PLC"))
        if transfer_lines(map_, side))
    return """<!DOCTYPE html>
<!-- %s -->
<html lang="en"><head><meta charset="utf-8"><title>%s</title>
<style>
body { font-family: sans-serif; margin: 1.5em }
table { border-collapse: collapse } td, th { border: 1px solid #aaa; padding: 2px 6px;
 font-size: 90%%; vertical-align: top } th { background: #eee; text-align: left }
</style></head><body>
<h1>%s: map of the PLC</h1>
<ul>%s</ul>
%s
<h2>Values</h2>
<table><tr>%s</tr>
%s</table>
%s
</body></html>
""" % (escape(head.strip("#<!-> ")), escape(name), escape(name),
       "".join("<li>%s</li>" % escape(f) for f in facts(map_, crc)),
       picture(map_, head) if map_.has_blocks() else "",
       "".join("<th>%s</th>" % h for h in HEADS), rows, moved)
