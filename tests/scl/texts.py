"""SCL out of the documents, fitted to a plant's sizes as its programmer would.

Every replacement must hit as often as it says, so that a document that changes is noticed.
"""
import re
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"


def blocks(document):
    """All SCL of a Markdown document, at the lines where it stands there."""
    lines, inside = [], False
    for line in (DOCS / document).read_text().split("\n"):
        if line.startswith("```"):
            inside = line == "```pascal"
            lines.append("")
        else:
            lines.append(line if inside else "")
    return "\n".join(lines)


def symbols(text):
    """The symbol table: DATA_BLOCK NAME ... // DBn"""
    return {name: int(number) for name, number in
            re.findall(r"^DATA_BLOCK (\w+)[^/\n]*// DB(\d+)", text, re.M)}


def replace(text, old, new, count):
    assert text.count(old) == count, f"{old!r}: {text.count(old)} times, not {count}"
    return text.replace(old, new)


def fitted(text, in_size, out_size, points=None, tx=(), rx=()):
    """plc-programming.md for other blocks. points: bytes of the setpoints in DB10, which go
    behind the header on both sides; tx, rx: explicit transfers."""
    text = replace(text, "ARRAY [4..31] OF BYTE", f"ARRAY [4..{in_size - 1}] OF BYTE", 1)
    text = replace(text, "ARRAY [4..11] OF BYTE", f"ARRAY [4..{out_size - 1}] OF BYTE", 3)
    text = replace(text, "LEN := 32", f"LEN := {in_size}", 2)
    if points is not None:
        text = replace(text, "Count := 8;", f"Count := {points};", 4)
    return explicit(text, tx, rx)


def explicit(text, tx, rx):
    text = replace(text, "    // IE_TX.DD8 := DB4.DD12;\n", "".join(f"    {t};\n" for t in tx), 1)
    text = replace(text, "    // DB10.DD24 := IE_RX.DD16;\n",
                   "".join(f"    {target} := IE_RX.{source};\n" for target, source in rx), 1)
    compare = ("    IF WORD_TO_BLOCK_DB(INT_TO_WORD(BLOCK)).{1} <> {0} THEN EQUAL := FALSE; "
               "END_IF;\n")
    line = re.search(r"    // IF WORD_TO_BLOCK_DB\(INT_TO_WORD\(BLOCK\)\)[^\n]*\n", text)[0]
    return replace(text, line, "".join(compare.format(*pair) for pair in rx), 1)


def fitted_tables(text, in_size, out_size, rows, allows, tx=()):
    """plc-tables.scl for other blocks. allows: (DB number, first byte, bytes, write) of
    MAP_ALLOWED; number 0 are flags."""
    pieces = [
        ("[16..47] OF BYTE;", f"[16..{in_size - 1}] OF BYTE;", 1),
        ("START > 48 - COUNT", f"START > {in_size} - COUNT", 1),
        ("INDEX := 16 TO 47 DO", f"INDEX := 16 TO {in_size - 1} DO", 2),
        ("LEN := 48", f"LEN := {in_size}", 2),
        ("[4..31] OF BYTE;", f"[4..{out_size - 1}] OF BYTE;", 3),
        ("START > 32 - COUNT", f"START > {out_size} - COUNT", 1),
        ("COUNT > 20", f"COUNT > {out_size - 12}", 1),
        ("[0..31] OF STRUCT", f"[0..{rows - 1}] OF STRUCT", 2),
        ("ROWSTX <= 32 AND ROWSRX <= 32", f"ROWSTX <= {rows} AND ROWSRX <= {rows}", 1),
        ("ROWSTX > 32 OR ROWSRX > 32", f"ROWSTX > {rows} OR ROWSRX > {rows}", 1),
        ("IF ROWS > 32 THEN", f"IF ROWS > {rows} THEN", 1),
        ("FIRST > 32 OR ROWS > 32", f"FIRST > {rows} OR ROWS > {rows}", 2),
        ("> 650", f"> {10 + 20 * rows}", 2),
        ("MAP.Status.Rows := B#16#4;", f"MAP.Status.Rows := B#16#{rows // 8:X};", 1),
        ("    // IE_TX.DD44 := DB11.DD12;\n", "".join(f"    {t};\n" for t in tx), 1)]
    for piece in pieces:
        text = replace(text, *piece)
    begin = text.index("    CASE NUMBER OF\n        10 :")
    end = text.index("END_FUNCTION", begin)
    return text[:begin] + allowed(allows) + text[end:]


def allowed(allows):
    lines = ["    MAP_ALLOWED := FALSE;"]
    for number, first, size, write in allows:
        right = "" if write else " AND NOT WRITE"
        lines.append(f"    IF NUMBER = {number}{right} AND START >= {first} AND START <= "
                     f"{first + size} - COUNT THEN MAP_ALLOWED := TRUE; END_IF;")
    return "\n".join(lines) + "\n"


def with_tsend(text):
    """plc-tables.scl with TSEND and TRCV, as docs/plc-tables.md says."""
    var, receive, send = re.findall(r"```pascal\n(.*?)```", (DOCS / "plc-tables.md").read_text(),
                                    re.S)
    text = replace(text, "    SENDING   : BOOL;\n", "    SENDING   : BOOL;\n" + var, 1)
    text = cut_out(text, "    AG_RECV(ID", "    RX_WATCH(", receive)
    text = cut_out(text, "        AG_SEND(ACT := TRUE", "    ELSIF SENDING THEN", "")
    return cut_out(text, "    ELSIF SENDING THEN", "    TX_WATCH(", send)


def cut_out(text, begin, end, new):
    at = text.index(begin)
    return text[:at] + new + text[text.index(end, at):]
