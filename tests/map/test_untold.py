"""What an import leaves out, refuses or cuts: a line names the file, the row and what is allowed.
Nothing is guessed from what does not fit together."""
import csv

import pytest

import forms
from conftest import plcmap

HEAD = ["Area", "Signal", "Address", "Kind", "In/Out", "Description", "Unit"]
LIST = """form = list
header = Signal
symbol = {Area}.{Signal}
plc = Address
type = Kind
type.Analog = REAL
type.Digital = BOOL
dir = In/Out
dir.Input = in
dir.Output = out
pv = {Area}:{Signal}
desc = Description
egu = Unit
"""


def rows(folder):
    with open(folder / "map.csv", newline="", encoding="utf-8") as f:
        return list(csv.DictReader(f))


def signal(name, address, kind="Analog", area="T", desc="", unit="C"):
    return [area, name, address, kind, "Input", desc, unit]


def listed(tmp_path, *signals, head=HEAD, words=LIST, encoding="utf-8", options=()):
    """An import of a list in CSV, by its description"""
    (tmp_path / "d.txt").write_text(words, encoding="utf-8")
    with open(tmp_path / "l.csv", "w", newline="", encoding=encoding) as f:
        csv.writer(f).writerows([head, *signals])
    return plcmap(*options, "import", tmp_path / "l.csv", "--columns", tmp_path / "d.txt", "--into", tmp_path / "m")


def workbook(path, **sheets):
    """An .xlsx of sheets {title: rows}"""
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, lines in sheets.items():
        tab = book.create_sheet(title)
        for line in lines:
            tab.append(line)
    book.save(path)
    return path


# --- code pages ---------------------------------------------------------------------------------

def test_code_page_of_the_export(tmp_path):
    """--encoding is the export's: a map in UTF-8 is read as UTF-8, and a second import changes nothing"""
    names = ["\u0414\u0430\u0432\u043b\u0435\u043d\u0438\u0435", "\u0422\u0435\u043c\u043f1"]
    for count in (1, 2, 2):
        (tmp_path / "x.asc").write_bytes(b"\r\n".join(
            b"126," + n.encode("cp1251").ljust(24) + b"MW     %d0       " % (1 + i) + b"INT".ljust(90)
            for i, n in enumerate(names[:count])))
        result = plcmap("--encoding", "cp1251", "import", tmp_path / "x.asc", "--into", tmp_path / "m")
        assert result.status == 0 and "renamed" not in result.out, result.out
    assert "0 new, 0 changed, 2 as they were" in result.out
    assert [r["symbol"] for r in rows(tmp_path / "m")] == names


def test_code_page_and_mark(tmp_path):
    """A byte order mark says UTF-8, whatever --encoding says: the first column is there"""
    result = listed(tmp_path, signal("H\u00f6he", "DB10.DBD0"), encoding="utf-8-sig", options=["--encoding", "cp1252"])
    assert result.status == 0 and rows(tmp_path / "m")[0]["symbol"] == "T.H\u00f6he", result.err


def test_code_page_lacks_a_byte(tmp_path):
    """A byte that the code page of a symbol table has not is told with its line, not replaced"""
    (tmp_path / "x.asc").write_bytes(forms.asc("A", "MW 10", "INT") + b"\r\n" +
                                     forms.asc("B", "MW 20", "INT").replace(b"B  ", b"B\x81 "))
    result = plcmap("import", tmp_path / "x.asc")
    assert result.status == 1 and "x.asc:2: not cp1252: byte 0x81 at 1; --encoding says another" in result.err
