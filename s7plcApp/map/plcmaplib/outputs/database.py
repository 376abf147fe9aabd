"""Files of the IOC: .db with the single values, a .template for each type with .substitutions,
and the .cmd with the lines of st.cmd."""
import re

from ..types import Array, is_struct
from ..transfer import layout_id
from .lists import unique
from .records import quoted, record_text, records


def made_instances(map_):
    """What comes from templates: {key: [(name, row, leaves)]}; and the leaves of the rest."""
    groups, single = {}, []
    for leaf in map_.leaves():
        item = leaf.owner
        element = item.type.element if isinstance(item.type, Array) else item.type
        if not is_struct(element):
            single.append(leaf)
            continue
        key = (element.name.upper(), item.dir, item.shown.asg, item.shown.archive,
               tuple(item.shown.fields), item.tx is not None, item.rx is not None)
        index = leaf.member.split("]")[0] + "]" if isinstance(item.type, Array) else ""
        instances = groups.setdefault(key, {})
        instances.setdefault((id(item), index), []).append(leaf)
    return groups, single


def _instance(map_, leaves, index):
    """The instance's own name, places and description."""
    item = leaves[0].owner
    inside = index.strip("[]").replace(",", "_").replace("-", "m")
    pv = item.pv + (inside + ":" if index else "")
    start = 0
    if index:
        start = next(b for i, b, _ in map_.layout.elements(item.type) if "[%s]" % i == index)
    places = {s: None if getattr(item, s) is None else getattr(item, s)[0] + start
              for s in ("tx", "rx")}
    tag = (item.address.symbol if item.address is not None else "") + index
    return item, pv, start, places, tag


def _fits(map_, field_desc, items):
    return all(len(("%s %s" % (i.shown.desc, field_desc)).strip().encode("utf-8")) <= 40
               for i in items)


def templates(map_, name, head):
    """({file name: text}, substitutions text or "")"""
    groups, _ = made_instances(map_)
    files, lines, taken = {}, [], set()
    for key in sorted(groups, key=str):
        instances = [(k[1], leaves) for k, leaves in groups[key].items() if leaves[0].owner.pv]
        if not instances:
            continue
        typename = map_.types[key[0]].name
        file = unique("%s-%s" % (name, re.sub(r"[^\w]", "_", typename)), taken) + ".template"
        files[file] = _template(map_, head, typename, instances)
        macros = ["P", "TX", "RX", "DESC"] if map_.has_blocks() else ["P", "TAG", "DESC"]
        lines.append('file "%s" {\npattern { PLC, %s }' % (file, ", ".join(macros)))
        for index, leaves in instances:
            item, pv, _, places, tag = _instance(map_, leaves, index)
            values = [map_.plc["name"], map_.plc["prefix"] + pv]
            values += ["%s" % ("" if places[s] is None else places[s]) for s in ("tx", "rx")] \
                if map_.has_blocks() else [tag]
            lines.append("{ %s }" % ", ".join(quoted(v) for v in values + [item.shown.desc]))
        lines.append("}")
    return files, "\n".join([head, ""] + lines) + "\n" if lines else ""


def _template(map_, head, typename, instances):
    index, leaves = instances[0]
    item, pv, start, _, _ = _instance(map_, leaves, index)
    items = [l[0].owner for _, l in instances]
    base = {"plc": "$(PLC)", "tx": "$(TX)", "rx": "$(RX)", "tag": "$(TAG)"}
    lines = [head, "# Type %s. P: name in front, TX, RX: its place in the blocks" % typename
             if map_.has_blocks() else "# Type %s. P: name in front, TAG: its tag" % typename]
    for leaf in leaves:
        if not leaf.pv:
            continue
        own = leaf.shown.desc
        desc = ("$(DESC) %s" % own).strip() if _fits(map_, own, items) else own
        before, member = leaf.relative, leaf.member
        leaf.relative = (before[0] - start, before[1])
        leaf.member = member[len(index):]
        for record in records(map_, leaf, leaf.pv[len(pv):], base, desc):
            lines.append(record_text(record, "$(P)"))
        leaf.relative, leaf.member = before, member
    return "\n".join(lines) + "\n"


def database(map_, head):
    """The records of all values that belong to no type."""
    _, single = made_instances(map_)
    lines = [head]
    for leaf in single:
        for record in records(map_, leaf):
            lines.append(record_text(record, map_.plc["prefix"]))
    return "\n".join(lines) + "\n"


def station(map_, name, head, crc, substitutions):
    """The lines of st.cmd."""
    plc = map_.plc
    who = re.sub(r"\W", "_", plc["name"])
    address = '"$(%s_ADDRESS=%s)"' % (who, plc["address"] or "127.0.0.1")
    order = 1 if plc["byteorder"] == "big" else 0
    sizes = map_.block_size("tx"), map_.block_size("rx")
    lines = [head, '# MAPDIR: where the files beside this one are. epicsEnvSet MAPDIR, "gen"',
             'epicsEnvSet EPICS_DB_INCLUDE_PATH, "$(EPICS_DB_INCLUDE_PATH=.):$(MAPDIR=.)"']
    if plc["wire"] in ("block", "block-modbus"):
        quiet = plc["recvtimeout"] or str(max(2000, 20 * int(plc["period"])))
        command, end = "s7plcConfigure", ""
        if plc["second"]:
            command, end = "phoenixplcConfigure", ", 1"
            address = '%s,$(%s_SECOND=%s)"' % (address[:-1], who, plc["second"])
        lines.append("%s(%s, %s, $(%s_PORT=%s), %d, %d, %d, %s, %s%s)" % (
            command, quoted(plc["name"]), address, who, plc["port"] or "2000", sizes[0], sizes[1],
            order, quiet, plc["sendinterval"] or plc["period"], end))
    if plc["wire"] == "block-modbus" and sizes[1]:
        lines.append('s7plcModbusOutput(%s, "", $(%s_MODBUS_PORT=502), %s, %s)' % (
            quoted(plc["name"]), who, plc["unit"], plc["out_register"]))
    if plc["wire"] == "modbus":
        lines += _modbus(map_, address, who, sizes)
    if plc["wire"] == "etherip":
        lines.append("drvEtherIP_define_PLC(%s, %s, %s)" % (quoted(plc["name"]), address,
                                                            plc["slot"]))
    lines += _options(map_, name, crc)
    lines.append('dbLoadRecords("$(MAPDIR=.)/%s.db", "P=%s,PLC=%s")' % (
        name, plc["prefix"], plc["name"]))
    if substitutions:
        lines.append('dbLoadTemplate("$(MAPDIR=.)/%s.substitutions")' % name)
    return "\n".join(lines) + "\n"


def _modbus(map_, address, who, sizes):
    plc = map_.plc
    ranges = ["holding %s %d every %s" % (plc["in_register"], sizes[0] // 2, plc["period"])
              if sizes[0] else "",
              "holding %s %d" % (plc["out_register"], sizes[1] // 2) if sizes[1] else ""]
    lines = ['modbusplcConfigure(%s, %s, $(%s_PORT=%s), %s, "%s", "%s")' % (
        quoted(plc["name"]), address, who, plc["port"] or "502", plc["unit"], *ranges)]
    if plc["byteorder"] == "little":
        lines.append("s7plcSetOption(%s, wordOrder, low)" % quoted(plc["name"]))
    return lines


def _options(map_, name, crc):
    plc, lines = map_.plc, []

    def option(key, value):
        lines.append("s7plcSetOption(%s, %s, %s)" % (quoted(plc["name"]), key, value))

    if map_.on("sync"):
        option("sync", "on")
    if map_.on("download"):
        option("map", "download")
        lines.append('s7plcTables(%s, "$(MAPDIR=.)/%s.ptr")' % (quoted(plc["name"]), name))
    elif map_.on("sync") or map_.number("layout_at") is not None:
        option("layout", layout_id(crc))
    if map_.number("layout_at") is not None:
        option("layoutAt", plc["layout_at"])
    if map_.number("readback") is not None and map_.block_size("rx"):
        option("readback", plc["readback"])
    if any(l.rx is not None and l.tx is not None for l in map_.leaves()) and \
            not map_.on("sync") and map_.has_blocks():
        option("track", "on")
    return lines
