"""Lists for the archiver, autosave and the alarm server; and names of files."""
import html

from .records import records


def unique(name, taken):
    """A file's name, with a number where another one, in capitals or not, has it already."""
    found, number = name, 1
    while found.lower() in taken:
        number += 1
        found = "%s-%d" % (name, number)
    taken.add(found.lower())
    return found


def _records(map_):
    for leaf in map_.leaves():
        for record in records(map_, leaf):
            yield leaf, record


def archive(map_, head):
    """PV, method and seconds of all records that are archived."""
    lines = [head]
    for leaf, record in _records(map_):
        for name, value in record.infos:
            if name == "archive":
                method, period = value.split()
                lines.append("%s %s %s" % (map_.plc["prefix"] + record.name, period, method))
    return "\n".join([lines[0]] + sorted(lines[1:])) + "\n"


def autosave(map_, head):
    """The .req file: PV.FIELD of setpoints that are saved."""
    found = set()
    for leaf, record in _records(map_):
        if record.readback:
            continue
        for field in leaf.shown.autosave or leaf.owner.shown.autosave:
            found.add("%s.%s" % (map_.plc["prefix"] + record.name, field))
    return "\n".join([head] + sorted(found)) + "\n"


def _alarms(leaf):
    """True when the record can have an alarm of its own."""
    shown = leaf.shown
    return any(v is not None for v in shown.limits.values()) or \
        any(s.severity not in ("", "NO_ALARM") for s in shown.states or [])


def alarms(map_, name, head):
    """The alarm tree of Phoebus: components are the groups."""
    tree = {}
    for leaf, record in _records(map_):
        if not record.readback and _alarms(leaf):
            node = tree
            for part in (leaf.group() or map_.plc["name"]).split("/"):
                node = node.setdefault(part, {})
            node.setdefault("", []).append((map_.plc["prefix"] + record.name, leaf.desc()))
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', head,
             '<config name="%s">' % html.escape(name)]
    lines += _branch(tree, "  ")
    return "\n".join(lines + ["</config>"]) + "\n"


def _branch(node, indent):
    lines = []
    for pv, desc in sorted(node.get("", [])):
        lines += ['%s<pv name="%s">' % (indent, html.escape(pv)),
                  "%s  <description>%s</description>" % (indent, html.escape(desc or pv)),
                  "%s  <latching>true</latching>" % indent,
                  "%s  <annunciating>true</annunciating>" % indent, "%s</pv>" % indent]
    for part in sorted(p for p in node if p):
        lines += ['%s<component name="%s">' % (indent, html.escape(part))]
        lines += _branch(node[part], indent + "  ")
        lines.append("%s</component>" % indent)
    return lines
