"""Exports of PLC tools into a map. The form of a file is recognised by its content, never by
its name; what is not understood is told with its place, never guessed."""
import os
import re

from .. import columns
from ..files import empty, is_workbook, load_sheets
from ..problems import Place, Refused
from ..sheets import csv_rows, decode, is_utf8, read_bytes
from . import iecxml, merge, outline, rockwell, s7source, s7table, sheetform, tia

FORMS = ("STEP 7 .asc .sdf .seq .dif; sources of data blocks and types; outlines; TIA tag tables (.xlsx .xml "
         ".sdf, Openness); texts with name, type and offset; Rockwell CSV, L5K, L5X; TwinCAT .tmc; "
         "CODESYS symbol configuration; PLCopen XML; PC WORX; S7-Project-Explorer CSV; with "
         "--columns sheets of your own")

_XML = [("Tagtable", tia.read_tagtable), ("Document", tia.read_openness),
        ("RSLogix5000Content", rockwell.read_l5x), ("TcModuleClass", iecxml.read_tmc),
        ("Symbolconfiguration", iecxml.read_codesys), ("project", iecxml.read_plcopen)]


def read_file(path, args, report):
    """What a file brings, as a Source."""
    data = read_bytes(path)
    if not data.strip():
        raise Refused("the file is empty", Place(path))
    if data.startswith(b"PK\x03\x04"):
        return _read_workbook(path, args, report)
    if re.match(rb"(\xef\xbb\xbf)?\s*<", data) or data[:4] in (b"\xff\xfe<\0", b"\xfe\xff\0<"):
        return _read_xml(data, path, report)
    if s7table.is_asc(data):
        return s7table.read_asc(data, path, report, args.encoding or "cp1252")
    text, _ = decode(data, path, report, args.encoding)
    if "\0" in text[:2000]:
        raise Refused("no text and no workbook. Forms that are known: %s" % FORMS, Place(path))
    if args.columns:
        delimiter = max(",;\t", key=text.split("\n", 1)[0].count)
        return sheetform.read({os.path.basename(path): csv_rows(text, delimiter, path)}, path,
                              _description(args, report), report)
    return _read_text(text, path, args, report)


def _read_text(text, path, args, report):
    forms = [(rockwell.is_csv(text), lambda: rockwell.read_csv(text, path, report)),
             (rockwell.is_l5k(text), lambda: rockwell.read_l5k(text, path, report)),
             (outline.is_outline(text), lambda: outline.read(text, path, report)),
             (s7source.is_source(text), lambda: s7source.read(text, path, report)),
             (s7table.is_dif(text), lambda: s7table.read_dif(text, path, report)),
             (s7table.is_explorer(text), lambda: s7table.read_explorer(text, path, report)),
             (s7table.is_pcworx(text), lambda: s7table.read_pcworx(text, path, report)),
             (s7table.is_seq(text), lambda: s7table.read_seq(text, path, report)),
             (s7table.is_offsets(text), lambda: s7table.read_offsets(
                 text, path, report, _one_number(args)))]
    for fits, read in forms:
        if fits:
            return read()
    try:
        if s7table.is_tia_sdf(text, path):
            return s7table.read_tia_sdf(text, path, report)
        if s7table.is_sdf(text, path):
            return s7table.read_sdf(text, path, report)
    except Refused:
        pass
    raise Refused("a form that is not known. Known are: %s" % FORMS, Place(path, 1))


def _read_xml(data, path, report):
    root = tia.parse_xml(data, path)
    name = tia.local(root.tag)
    for known, read in _XML:
        if name == known:
            try:
                return read(root, path, report)
            except RecursionError:
                raise Refused("elements nest too deep", Place(path)) from None
    raise Refused("XML of <%s>: not known. Known are: %s" % (name[:40], FORMS), Place(path, 1))


def _read_workbook(path, args, report):
    from ..workbook import read_cells
    cells = read_cells(path, report)
    if args.columns:
        return sheetform.read(cells, path, _description(args, report), report)
    if tia.find_tags(cells):
        return tia.read_workbook(cells, path, report)
    heads = "; ".join("%s: %s" % (tab, ", ".join(t for t in rows[0][1] if t)[:80] if rows else "empty")
                      for tab, rows in list(cells.items())[:4])
    raise Refused("a workbook without the columns %s (it has %s). For sheets of your own: --columns"
                  % (", ".join(tia.TAG_COLUMNS), heads), Place(path))


def _description(args, report):
    data = read_bytes(args.columns)
    text, _ = decode(data, args.columns, report, None if is_utf8(data) else args.encoding)
    return sheetform.read_description(text, args.columns)


def _numbers(args):
    """{name: number} of --db."""
    found = {}
    for text in args.db:
        name, equals, number = text.rpartition("=")
        if not equals or not number.isdigit() or not 1 <= int(number) <= 65535:
            raise Refused('--db "%s"; allowed: such as Tank=10' % text)
        found[name.strip('"')] = int(number)
    return found


def _one_number(args):
    numbers = list(_numbers(args).values())
    return str(numbers[0]) if len(numbers) == 1 else None


def run_import(args, report):
    """Lines that say what was done."""
    lines, sources = [], []
    if args.columns:
        _description(args, report)  # refused before anything else
    for path in args.files:
        source = read_file(path, args, report)
        sources.append(source)
        lines.append("%s: %s, %d values or structures, %d types%s" % (
            path, source.form, len(source.items), len(source.types),
            ", %d rows are no memory" % source.left_out if source.left_out else ""))
    rows, types = merge.rows_of(sources, _numbers(args), args.types, report)
    rows = merge.selected(rows, args.select, report)
    if not args.into:
        return lines + ["%s %s %s %s" % (r.symbol, r.plc, r.type, r.desc) for r in rows]
    sheets = empty(args.into)
    exists = os.path.exists(args.into)
    if exists:
        try:
            sheets.update(load_sheets(args.into, report, args.encoding))
        except Refused:
            if os.path.isdir(args.into) and not os.listdir(args.into):
                exists = False
            else:
                raise
    if report.errors():
        return lines
    _suit(sheets["plc"], exists, sources, report)
    merger = merge.Merge(sheets, args, report)
    merger.run(rows, types, set().union(*[s.scope for s in sources]) if sources else set())
    if not exists:
        lines += _own_blocks(sheets, sources)
    _save(sheets, args.into, exists)
    return lines + merger.lines


def _own_blocks(sheets, sources):
    """In a new map: numbers for the program's own data blocks that the PLC does not use."""
    used = {n for s in sources for n in s.blocks.values()}
    for row in sheets["map"].rows:
        m = re.match(r"DB(\d+)\.", row.get("plc"))
        if m:
            used.add(int(m.group(1)))
    own = {key: int(columns.PLC_KEYS[key][0]) for key in columns.OWN_BLOCKS}
    free = (n for n in range(1, 65536) if n not in used and n not in own.values())
    lines = []
    for key, number in own.items():
        if number in used:
            own[key] = next(free)
            sheets["plc"].append({"key": key, "value": "%d" % own[key]})
            lines.append("%s: %d, because the PLC has a DB%d" % (key, own[key], number))
    return lines


def _suit(plc, exists, sources, report):
    """The keys that such symbols need: written into a new map; told where a map has others."""
    if not exists and not plc.rows:
        plc.append({"key": "name", "value": "PLC"})
    for source in sources:
        for key, value in source.keys.items():
            row = next((r for r in plc.rows if r.get("key") == key), None)
            has = (row.get("value") if row else "") or columns.PLC_KEYS[key][0]
            if row is None and not exists:
                plc.append({"key": key, "value": value})
            elif has != value:
                report.warning(Place(plc.file, row.line if row else None, None, plc.tab), key,
                               "%s in this map; for symbols of %s it is %s"
                               % (has, source.form, value))


def _save(sheets, path, exists):
    import argparse
    from ..files import save
    kept = {n: s for n, s in sheets.items() if s.rows or n in ("map", "plc") or exists}
    if exists and not is_workbook(path):
        kept = {n: s for n, s in kept.items() if s.rows or os.path.exists(s.file)}
    save(argparse.Namespace(sheets=kept, path=path))
