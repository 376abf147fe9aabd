"""Everything that is generated from a map: file by file, the same bytes each time."""
import os

from ..problems import Place, Refused
from ..sheets import write_bytes
from ..transfer import layout_crc, layout_id
from . import controller, database, display, lists, manual, pointers, scl, simulator, st, tia

MARK = "Made from the map by plcmap; edits are lost."


def head_of(map_, crc):
    return "map %s, layout id %d, CRC 0x%08X. %s" % (map_.name(), layout_id(crc), crc, MARK)


def contents(map_):
    """{file name: bytes} of all files."""
    name = map_.name()
    crc = layout_crc(map_)
    text = head_of(map_, crc)
    shell, xml, st_ = "# " + text, "<!-- %s -->" % text.replace("--", "- -"), "// " + text
    files, substitutions = database.templates(map_, name, shell)
    if substitutions:
        files[name + ".substitutions"] = substitutions
    files[name + ".db"] = database.database(map_, shell)
    files[name + ".cmd"] = database.station(map_, name, shell, crc, bool(substitutions))
    files[name + ".archive"] = lists.archive(map_, shell)
    files[name + ".req"] = lists.autosave(map_, shell)
    files[name + "-alarms.xml"] = lists.alarms(map_, name, xml)
    files[name + ".md"] = manual.markdown(map_, name, xml, crc)
    files[name + ".html"] = manual.page(map_, name, xml, crc)
    if map_.has_blocks():
        files[name + ".svg"] = manual.picture(map_, xml) + "\n"
        files[name + ".plc"] = simulator.simulator(map_, shell, crc)
    else:
        files[name + ".plc"] = controller.controller(map_, shell)
    files.update(display.displays(map_, name, xml))
    if map_.plc["wire"] in ("block", "block-modbus"):
        files.update(_plc_code(map_, name, st_, crc))
    if map_.on("download"):
        files[name + ".ptr"] = pointers.table(map_, shell, crc)
    return {file: text_.encode("utf-8") for file, text_ in files.items() if text_ is not None}


def _plc_code(map_, name, head, crc):
    family = map_.plc["family"]
    if family == "s7-classic":
        return {name + "-step7.scl": scl.program(map_, head, crc)}
    if family == "tia":
        return {name + "-tia.scl": tia.program(map_, head, crc)}
    if family == "codesys":
        return {name + ".st": st.program(map_, head, crc)}
    return {}


def ours(data):
    """True when a file that is there was generated."""
    return MARK.encode() in data[:2000]


def generate(map_, folder, only=None):
    """Writes what has changed. Refuses to overwrite a file that it has not made. Returns lines
    that say what was done."""
    files = contents(map_)
    if only:
        files = {f: c for f, c in files.items() if any(f.endswith(o) for o in only)}
        if not files:
            raise Refused("no file ends with %s; there are: %s"
                          % (" ".join(only), " ".join(sorted(contents(map_)))))
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as e:
        raise Refused(e.strerror or str(e), Place(folder)) from None
    for file in sorted(files):
        path = os.path.join(folder, file)
        if os.path.exists(path):
            with open(path, "rb") as f:
                data = f.read()
            if not ours(data):
                raise Refused("is there and was not made by plcmap: move it away", Place(path))
    lines, written = [], 0
    for file in sorted(files):
        if write_bytes(os.path.join(folder, file), files[file]):
            written += 1
            lines.append(os.path.join(folder, file))
    lines.append("%d files, %d of them new or changed" % (len(files), written))
    return lines
