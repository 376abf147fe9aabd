"""A Phoebus display for each group: a line per value, with what one can do to it."""
import html
import re

from .lists import unique
from .records import records

LINE = 26
WIDTH = 760


def _widget(kind, name, x, y, width, height, **properties):
    lines = ['  <widget type="%s" version="2.0.0">' % kind, "    <name>%s</name>" % _x(name)]
    for key, value in properties.items():
        lines.append("    <%s>%s</%s>" % (key, _x(value), key))
    lines += ["    <x>%d</x>" % x, "    <y>%d</y>" % y, "    <width>%d</width>" % width,
              "    <height>%d</height>" % height, "  </widget>"]
    return "\n".join(lines)


def _x(text):
    return html.escape(str(text), quote=False)


SHOWS = {"bi": "led", "bo": "bool_button", "mbbo": "combo", "ao": "textentry",
         "longout": "textentry", "int64out": "textentry", "stringout": "textentry",
         "lso": "textentry"}


def _line(map_, leaf, y):
    """Description, setpoint, value, of one leaf."""
    prefix = map_.plc["prefix"]
    label = leaf.desc() or leaf.symbol
    parts = [_widget("label", "Label " + leaf.symbol, 20, y, 300, 20, text=label,
                     tooltip=leaf.symbol)]
    for record in records(map_, leaf):
        output = record.type in SHOWS and record.type != "bi"
        x = 330 if output else 500
        kind = SHOWS.get(record.type, "textupdate")
        width, height = (20, 20) if kind == "led" else (150, 22)
        parts.append(_widget(kind, record.name, x, y, width, height, pv_name=prefix + record.name))
        if kind == "led":
            parts.append(_widget("textupdate", record.name + " text", x + 30, y, 120, 20,
                                 pv_name=prefix + record.name))
    return "\n".join(parts)


def display(map_, title, leaves, head):
    """The text of one display."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', head, '<display version="2.0.0">',
             "  <name>%s</name>" % _x(title), "  <width>%d</width>" % WIDTH,
             "  <height>%d</height>" % (70 + LINE * len(leaves)),
             _widget("label", "Title", 20, 12, 720, 30, text=title).replace(
                 "    <x>", '    <font><font name="Header1" family="Liberation Sans" '
                 'style="BOLD" size="22.0"></font></font>\n    <x>', 1)]
    for number, leaf in enumerate(leaves):
        lines.append(_line(map_, leaf, 56 + LINE * number))
    return "\n".join(lines + ["</display>"]) + "\n"


def displays(map_, name, head):
    """{file: text}, one for each group; values without a group are in that of the PLC."""
    groups = {}
    for leaf in map_.leaves():
        if leaf.pv:
            groups.setdefault(leaf.group(), []).append(leaf)
    files, taken = {}, set()
    for group, leaves in sorted(groups.items()):
        file = unique("%s%s" % (name, "-" + re.sub(r"[^\w]+", "_", group) if group else ""), taken) + ".bob"
        files[file] = display(map_, "%s %s" % (map_.plc["name"], group) if group
                              else map_.plc["name"], leaves, head)
    return files
