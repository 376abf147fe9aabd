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
    text = replace(text, "ARRAY [4..11] OF BYTE", f"ARRAY [4..{out_size - 1}] OF BYTE", 2)
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
