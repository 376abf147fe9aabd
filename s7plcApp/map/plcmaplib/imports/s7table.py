"""Symbol and tag tables as text: STEP 7 classic (.asc .sdf .seq .dif), TIA Portal's SDF, texts
with offsets (copied from an editor), PC WORX's variables, the CSV of S7-Project-Explorer."""
import re

from ..problems import Place, Refused
from ..sheets import csv_rows, decoded
from ..types import ELEMENTARY, Text
from .common import Source, add_symbol, known_type, siemens_address

ASC = (24, 12, 10, 80)  # symbol, address, type, comment: bytes behind "126,"


def is_asc(data):
    return re.match(rb"\s*126,", data) is not None


def read_asc(data, path, report, encoding):
    """Lines of fixed width; the width counts bytes."""
    source = Source("STEP 7 symbol table (.asc)")
    for number, raw in enumerate(data.replace(b"\r", b"").split(b"\n"), 1):
        line = raw.rstrip(b"\x1a")
        if not line.strip():
            continue
        place = Place(path, number)
        if not line.startswith(b"126,"):
            report.warning(place, None, "the line does not begin with 126,: left out")
            continue
        line, parts = line[4:].ljust(sum(ASC)), []
        for width in ASC:
            parts.append(decoded(line[:width], encoding, place).strip())
            line = line[width:]
        if not parts[0]:
            report.warning(place, None, "no symbol: left out")
            continue
        add_symbol(source, parts[0], parts[1], _no_block_type(parts[2]), parts[3], place, report)
    return source


def _no_block_type(text):
    return "" if siemens_address(text)[0] in ("block", "timer") else text


def _csv(text, path):
    first = text.lstrip().split("\n", 1)[0]
    delimiter = max(";,\t", key=first.count)
    return csv_rows(text, delimiter, path, True)


def is_tia_sdf(text, path):
    rows = [c for _, c in _csv(text[:4000], path) if any(c)][:3]
    return bool(rows) and all(len(c) >= 8 for c in rows[:1]) and \
        re.match(r"^%[A-Z]+\d", rows[0][1].strip(), re.I) is not None


def read_tia_sdf(text, path, report):
    """name, %address, type, three booleans, comment, (empty), boolean"""
    source = Source("TIA tag table (.sdf)", family="tia")
    for number, cells in _csv(text, path):
        cells = [c.strip() for c in cells]
        if not any(cells):
            continue
        place = Place(path, number)
        if len(cells) < 7:
            report.warning(place, None, "%d fields, 9 expected: left out" % len(cells))
            continue
        add_symbol(source, cells[0], cells[1], cells[2], cells[6], place, report)
    return source


def is_sdf(text, path):
    rows = [c for _, c in _csv(text[:4000], path) if any(c)][:3]
    return bool(rows) and all(3 <= len(c) <= 4 and c[0].strip() and
                              siemens_address(c[1])[0] for c in rows)


def read_sdf(text, path, report):
    """symbol, address, type, comment"""
    source = Source("STEP 7 symbol table (.sdf)")
    for number, cells in _csv(text, path):
        cells = [c.strip() for c in cells]
        if not any(cells):
            continue
        place = Place(path, number)
        if len(cells) < 3 or not cells[0]:
            report.warning(place, None, "symbol, address, type, comment expected: left out")
            continue
        add_symbol(source, cells[0], cells[1], _no_block_type(cells[2]),
                   " ".join(cells[3:]), place, report)
    return source


def is_seq(text):
    lines = [l for l in text.splitlines() if l.strip()][:3]
    return bool(lines) and all(l.startswith("\t") and len(l.split("\t")) >= 3 and
                               siemens_address(l.split("\t")[1])[0] for l in lines)


def read_seq(text, path, report):
    """TAB address TAB symbol TAB comment; the type is that of the address"""
    source = Source("STEP 5 assignment list (.seq)")
    for number, line in enumerate(text.splitlines(), 1):
        cells = [c.strip() for c in line.split("\t")]
        if not any(cells):
            continue
        place = Place(path, number)
        if len(cells) < 3 or cells[0] or not cells[2]:
            report.warning(place, None, "TAB address TAB symbol expected: left out")
            continue
        add_symbol(source, cells[2], cells[1], "", " ".join(cells[3:]), place, report)
    return source


def is_dif(text):
    return re.match(r"\s*TABLE\s*\r?\n", text) is not None


def read_dif(text, path, report):
    """TABLE/VECTORS/TUPLES/DATA, then `type,number` and a text for each cell."""
    source = Source("STEP 7 symbol table (.dif)")
    lines = text.splitlines()
    start = next((i for i, l in enumerate(lines) if l.strip() == "DATA"), None)
    if start is None:
        raise Refused("a .dif without DATA", Place(path, 1))
    row, begin, at = None, 0, start + 3
    while at + 1 < len(lines):
        head, value = lines[at].strip(), lines[at + 1].strip()
        at += 2
        m = re.match(r"^(-?\d+),(.*)$", head)
        if not m:
            report.warning(Place(path, at - 1), None, '"%s" is no cell: the rest is left out'
                           % head[:30])
            break
        if m.group(1) == "-1":
            _dif_row(source, row, Place(path, begin), report)
            row, begin = [], at
            if value.upper() == "EOD":
                break
        elif row is not None:
            text_ = value[1:-1].replace('""', '"') if m.group(1) == "1" and len(value) > 1 and \
                value[0] == value[-1] == '"' else value if m.group(1) == "1" else m.group(2)
            row.append(text_.strip())
    return source


def _dif_row(source, row, place, report):
    if not row:
        return
    if len(row) < 3:
        report.warning(place, None, "symbol, address, type, comment expected: left out")
        return
    add_symbol(source, row[0], row[1], _no_block_type(row[2]), " ".join(row[3:]), place, report)


# --- PC WORX, S7-Project-Explorer ----------------------------------------------------------

_PCWORX = re.compile(r"^%[MIQ][XBWDL]\d+(\.\d+)*;")


def is_pcworx(text):
    first = text.lstrip().split("\n", 1)[0]
    return _PCWORX.match(first) is not None


def read_pcworx(text, path, report):
    """%MX1.2016.0;BOOL;flags NAME;comment"""
    source = Source("PC WORX variables", family="codesys")
    for number, line in enumerate(text.splitlines(), 1):
        cells = [c.strip() for c in line.split(";")]
        if not any(cells):
            continue
        place = Place(path, number)
        if len(cells) < 3 or not cells[2]:
            report.warning(place, None, "address;type;name;comment expected: left out")
            continue
        kind = known_type(cells[1])
        if kind is None:
            report.warning(place, None, 'type "%s" is not known: left out' % cells[1])
            continue
        source.add(cells[2].split()[-1], cells[0], kind, " ".join(cells[3:]), place)
    for item in source.items:  # its addresses are those of its own memory, not of an S7
        item.plc = item.symbol
    return source


def is_explorer(text):
    first = text.lstrip("\ufeff").split("\n", 1)[0].upper().replace('"', "")
    return [c.strip() for c in first.split(",")][:4] == ["DEVICE", "BLOCK", "VARIABLE", "CODE"]


def read_explorer(text, path, report):
    """DEVICE,BLOCK,VARIABLE,CODE: DB6:20.1 and the like, arrays element by element."""
    source = Source("CSV of S7-Project-Explorer")
    for number, cells in csv_rows(text, ",", path)[1:]:
        cells = [c.strip() for c in cells] + [""] * 4
        place = Place(path, number)
        if not any(cells):
            continue
        m = re.match(r"^DB(\d+):(\d+)(?:\.(\d))?(?:\s*:?\s*(\w.*))?$", cells[3], re.I)
        kind = known_type(m.group(4)) if m and m.group(4) else None
        if m and kind is None and m.group(3) is not None:
            kind = ELEMENTARY["BOOL"]
        if kind is None:
            report.warning(place, None, '"%s" names no type or is no place in a DB: left out'
                           % cells[3][:40])
            continue
        bit = m.group(3) if kind.__class__ is not Text and getattr(kind, "kind", "") == "bool" \
            else None
        source.add("%s.%s" % (cells[1], cells[2]), _db(m.group(1), m.group(2), bit, kind), kind, "",
                   place)
    return source


def _db(db, byte, bit, kind):
    if bit is not None:
        return "DB%s.DBX%s.%s" % (db, byte, bit)
    letter = {1: "B", 2: "W", 4: "D"}.get(getattr(kind, "size", 0), "B")
    return "DB%s.DB%s%s" % (db, letter, byte)


# --- names, types and offsets as text --------------------------------------------------------

_NAME_HEADS = ("name", "symbol", "bezeichnung", "nom", "nombre", "nome")
_TYPE_HEADS = ("data type", "datatype", "type", "datentyp", "type de donn\u00e9es", "tipo de datos",
               "tipo di dati", "typ")
_OFFSET_HEADS = ("offset", "address", "adresse", "desplazamiento", "d\u00e9calage", "versatz")
_COMMENT_HEADS = ("comment", "kommentar", "commentaire", "comentario", "commento")
_OFFSET = re.compile(r"^[+=*]?\s*(\d+)(?:[.,]([0-7]))?$")


def _columns(cells):
    """{what: column} of a header row, or None."""
    lower = [c.strip().strip('"').lower() for c in cells]
    found = {}
    for what, heads in (("name", _NAME_HEADS), ("type", _TYPE_HEADS), ("offset", _OFFSET_HEADS),
                        ("comment", _COMMENT_HEADS)):
        for number, cell in enumerate(lower):
            if cell in heads:
                found.setdefault(what, number)
    return found if {"name", "type", "offset"} <= set(found) else None


def is_offsets(text):
    lines = [l for l in text.splitlines() if l.strip()][:3]
    if lines and any(_columns(re.split(r"\t", l)) for l in lines):
        return True
    plain = [l.split() for l in lines]
    return bool(plain) and all(len(p) >= 3 and _OFFSET.match(p[0]) and known_type(" ".join(p[2:3]))
                               for p in plain)


def read_offsets(text, path, report, db):
    """Name, type and offset of each field of one data block. db: its number, or None."""
    source = Source("text with offsets")
    columns, rows = None, []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        cells = [c.strip().strip('"') for c in line.split("\t")]
        if columns is None and "\t" in line and _columns(cells):
            columns = _columns(cells)
            continue
        if columns is None:
            words = line.split(None, 2)
            cells, use = words, {"offset": 0, "name": 1, "type": 2}
        else:
            use = columns
        rows.append((number, {w: cells[c] if c < len(cells) else "" for w, c in use.items()}))
    for number, row in rows:
        _offset_row(source, row, Place(path, number), report, db)
    return source


def _offset_row(source, row, place, report, db):
    if row["offset"] in ("", "...") and row["name"]:
        if row["offset"] == "..." or known_type(row["type"]):
            report.warning(place, None, '"%s" has no offset: compile the block and switch the '
                           "column on: left out" % row["name"])
        return
    m = _OFFSET.match(row["offset"])
    if not m:
        report.warning(place, None, '"%s" is no offset: left out' % row["offset"][:30])
        return
    if row["type"].strip('"').upper() in ("STRUCT", "END_STRUCT"):
        return
    kind = known_type(row["type"])
    if kind is None:
        report.warning(place, None, '"%s": type "%s" is not known: left out'
                       % (row["name"], row["type"][:40]))
        return
    is_bit = getattr(kind, "kind", "") == "bool"
    if not is_bit and m.group(2) not in (None, "0"):
        report.warning(place, None, '"%s": %s does not begin at bit %s: left out'
                       % (row["name"], kind, m.group(2)))
        return
    plc = _db(db, m.group(1), m.group(2) or "0" if is_bit else None, kind) if db else row["name"]
    source.add(row["name"], plc, kind, row.get("comment", ""), place)
