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


# --- addresses and types that do not fit each other -------------------------------------------

MISFITS = [("DB10.DBW58", "Analog", "REAL has 4 bytes: write DB10.DBD58"), ("EW20", "Analog", "REAL has 4 bytes: write ID20"),
           ("DB10.DBW60", "Digital", "a BOOL needs a bit, such as DB10.DBX4.3 or M4.3"),
           ("M4.3", "Analog", "only a BOOL lies in a single bit, not REAL")]


@pytest.mark.parametrize("address, kind, text", MISFITS, ids=[" ".join(m[:2]) for m in MISFITS])
def test_width_in_a_list(tmp_path, address, kind, text):
    """{id}: type and address differ: the row is left out with the line that a map by hand gets, nothing is rewritten"""
    result = listed(tmp_path, signal("A", address, kind), signal("B", "DB10.DBD0"))
    assert "l.csv [l.csv] A2: warning: plc: T.A at " in result.err and text in result.err
    assert [(r["symbol"], r["plc"]) for r in rows(tmp_path / "m")] == [("T.B", "DB10.DBD0")]
    (tmp_path / "h").mkdir()
    type_ = {"Analog": "REAL", "Digital": "BOOL"}[kind]
    (tmp_path / "h" / "map.csv").write_text("symbol,plc,type,tx,pv\nA,%s,%s,%d,A\n" % (address, type_, 4))
    assert text in plcmap("check", tmp_path / "h").err


def test_width_in_tables(tmp_path):
    """A symbol table and a tag table with an address of another width than the type: left out, with the place"""
    (tmp_path / "x.asc").write_bytes(forms.asc("A", "MW 24", "REAL") + b"\r\n" + forms.asc("B", "MW 20", "INT"))
    result = plcmap("import", tmp_path / "x.asc")
    assert "x.asc:1: warning: plc: A at MW24: REAL has 4 bytes: write MD24: left out" in result.err
    assert "B MW20 INT" in result.out and "A M" not in result.out
    book = workbook(tmp_path / "t.xlsx", Tags=[["Name", "Data Type", "Logical Address"], ["A", "Int", "%MD20"], ["L", "LReal", "%MW40"],
                                               ["B", "Int", "%MW20"]])
    result = plcmap("import", book)
    assert "t.xlsx [Tags] A2: warning: plc: A at MD20: INT has 2 bytes: write MW20: left out" in result.err
    assert "L at MW40: LREAL has 8 bytes: write MB40: left out" in result.err
    assert "B MW20 INT" in result.out and "A M" not in result.out


def test_bit_of_an_offset(tmp_path):
    """An offset with bit 9 is left out, with its line"""
    (tmp_path / "o.txt").write_text("Offset\tName\tType\n0.0\tA\tBOOL\n0.9\tB\tBOOL\n")
    result = plcmap("import", tmp_path / "o.txt", "--db", "X=10")
    assert 'o.txt:3: warning: "0.9" is no offset: left out' in result.err and "B DB10" not in result.out


def test_tags_like_addresses(tmp_path):
    """A Rockwell tag that is called like an S7 address stays that tag"""
    (tmp_path / "r.csv").write_text(forms.ROCKWELL_CSV.replace("Start", "IW20"))
    assert "IW20 IW20 BOOL" in plcmap("import", tmp_path / "r.csv").out


# --- type sheets -----------------------------------------------------------------------------------

TYPES = "form = types\ntypes = address type name desc\ndirection.plc -> epics = in\n"
FIELDS = [(["DBD2", "REEL", "A"], 'VALVE_in.A: unknown type "REEL" (did you mean REAL?); allowed: blank (that of the address), BOOL'),
          (["DBW2", "INTEGER", "A"], 'unknown type "INTEGER"'), (["DBW2", "REAL", "A"], "REAL has 4 bytes: write DBD2"),
          (["DBW2", "LREAL", "A"], "LREAL has 8 bytes: write DBB2"), (["DBD2", "INT", "A"], "INT has 2 bytes: write DBW2"),
          (["DBX2.9", "BOOL", "A"], '"DBX2.9" is no address in a type; allowed: such as DBX0.3 DBB1 DBW2 DBD4'),
          (["DBX2", "BOOL", "A"], '"DBX2" is no address in a type'), (["DBW2.1", "INT", "A"], '"DBW2.1" is no address in a type'),
          (["DBW2", "BOOL", "A"], "BOOL does not lie at DBW2")]


@pytest.mark.parametrize("field, text", FIELDS, ids=[" ".join(f[0][:2]) for f in FIELDS])
def test_field_of_a_type(tmp_path, field, text):
    """{id} in a type sheet is refused with its cell, and nothing is written"""
    (tmp_path / "d.txt").write_text(TYPES)
    book = workbook(tmp_path / "t.xlsx", T=[['Type "VALVE" PLC -> EPICS'], ["DBW0", "INT", "Z"], field])
    result = plcmap("import", book, "--columns", tmp_path / "d.txt", "--types", "--into", tmp_path / "m")
    assert result.status == 1 and "t.xlsx [T] A3: " in result.err and text in result.err, result.err
    assert not (tmp_path / "m").exists()


def test_gap_in_a_type(tmp_path):
    """Fields behind five blank rows are refused with their cell; four are as before"""
    (tmp_path / "d.txt").write_text(TYPES)
    for gap in (4, 5):
        book = workbook(tmp_path / "t.xlsx", T=[['Type "VALVE" PLC -> EPICS'], ["DBW0", "", "Z"], *[[None, None, None, "reserve"]] * gap,
                                                ["DBW20", "INT", "E"]])
        result = plcmap("import", book, "--columns", tmp_path / "d.txt", "--types", "--into", tmp_path / str(gap))
        assert result.status == (gap == 5), result.err
    assert "t.xlsx [T] A8: VALVE_in: DBW20 stands behind 5 rows without an address, which end a type; allowed: up to 4" in result.err
    types = (tmp_path / "4" / "types.csv").read_text()
    assert "Z,WORD" in types and "E,INT" in types


# --- sheets ------------------------------------------------------------------------------------------

TAGS = ["Name", "Path", "Data Type", "Logical Address", "Comment"]


def test_two_sheets_of_tags(tmp_path):
    """A workbook with two tables of tags: both are imported; a row without a name is left out"""
    book = workbook(tmp_path / "t.xlsx", **{"PLC Tags": [TAGS, ["A", "T", "Real", "%MD10"], ["", "T", "Int", "%MW50"]],
                                            "Constants": [["Name", "Value"]], "PLC Tags 2": [TAGS, ["B", "T", "Int", "%MW80"]]})
    result = plcmap("import", book, "--into", tmp_path / "m")
    assert "(.xlsx: PLC Tags, PLC Tags 2), 2 values" in result.out
    assert "t.xlsx [PLC Tags] A3: warning: %MW50 Int has no name: left out" in result.err
    assert [r["symbol"] for r in rows(tmp_path / "m")] == ["A", "B"]


def test_column_twice(tmp_path):
    """A column that is read and stands there twice is refused, in a list and in a table of tags"""
    result = listed(tmp_path, signal("A", "DB10.DBD0") + ["other"], head=HEAD + ["Description"])
    assert result.status == 1 and not (tmp_path / "m").exists()
    assert "l.csv [l.csv] H1: Description: the column is there twice, first as column F; allowed: each once" in result.err
    result = plcmap("import", workbook(tmp_path / "t.xlsx", T=[TAGS + ["Comment"], ["A", "T", "Int", "%MW10", "a", "b"]]))
    assert result.status == 1 and "t.xlsx [T] F1: Comment: the column is there twice, first as column E" in result.err


def test_column_missing(tmp_path):
    """A column of the description that the sheet has not is refused, with the nearest one; so is a sheet"""
    for words, text in ((LIST.replace("egu = Unit", "egu = Units"), 'l.csv [l.csv] A1: egu: the sheet has no column "Units" (did you mean Unit?); it has: Area, Sig'),
                        (LIST.replace("{Area}.", "{Aera}."), 'symbol: the sheet has no column "Aera" (did you mean Area?)'),
                        (LIST + "sheets = Signals\n", 'l.csv: sheets: "Signals" is not there; it has: l.csv')):
        result = listed(tmp_path, signal("A", "DB10.DBD0"), words=words)
        assert result.status == 1 and text in result.err, result.err
        assert not (tmp_path / "m").exists()


def test_part_of_a_name_is_blank(tmp_path):
    """A row whose symbol would lack a part is left out, with the column: ".B" is no name"""
    result = listed(tmp_path, signal("A", "DB10.DBD0"), signal("B", "DB10.DBD4", area=""), signal("", "DB10.DBD8"))
    assert 'l.csv [l.csv] A3: warning: symbol: the column "Area" is blank: left out' in result.err
    assert 'l.csv [l.csv] A4: warning: symbol: the column "Signal" is blank: left out' in result.err
    assert [r["symbol"] for r in rows(tmp_path / "m")] == ["T.A"]


def test_cells_without_a_value(tmp_path):
    """Merged cells and formulas that were never calculated: their rows are left out, with the cell"""
    openpyxl = pytest.importorskip("openpyxl")
    book = workbook(tmp_path / "l.xlsx", S=[HEAD, *[signal("ABCDE"[i], "DB10.DBD%d" % (4 * i)) for i in range(5)]])
    work = openpyxl.load_workbook(book)
    work["S"].merge_cells("A2:A3")
    work["S"]["C4"] = '="DB10.DBD"&(4+4)'
    work["S"]["J5"] = "=1+1"  # a column that is not read
    work.save(book)
    (tmp_path / "d.txt").write_text(LIST)
    result = plcmap("import", book, "--columns", tmp_path / "d.txt", "--into", tmp_path / "m")
    assert "l.xlsx [S] A3: warning: merged cells A2:A3: only the first one has the value: the row is left out" in result.err
    assert "l.xlsx [S] C4: warning: the formula =\"DB10.DBD\"&(4+4) was never calculated: open the file and save it: the row" in result.err
    assert "J5" not in result.err
    assert [r["symbol"] for r in rows(tmp_path / "m")] == ["T.A", "T.D", "T.E"]


# --- names and descriptions ---------------------------------------------------------------------

def test_no_letters_for_a_record(tmp_path):
    """A symbol whose letters no record name can have: no record is made of the rest; a line says which symbol"""
    names = {"\u0423\u0440\u043e\u0432\u0435\u043d\u044c": "", "\u041d\u0430\u0441\u043e\u0441_1": "", "\u6e29\u5ea6.Level": "",
             "F\u00fcll stand": "F_ll_stand", "7": "7"}
    tags = [[name, "Int", "%%MW%d" % (2 * i)] for i, name in enumerate(names)]
    book = workbook(tmp_path / "t.xlsx", T=[["Name", "Data Type", "Logical Address"], *tags])
    result = plcmap("import", book, "--into", tmp_path / "m")
    assert {r["symbol"]: r["pv"] for r in rows(tmp_path / "m")} == names
    told = [line for line in result.lines if "no record name is made of its letters; it gets no record before column pv" in line]
    assert len(told) == 3 and told[1].startswith("%s [T] A3: warning: pv: \u041d\u0430\u0441\u043e\u0441_1: " % book)
    plcmap("import", book, "--into", tmp_path / "n", "--pv", "none")
    assert not any(r["pv"] for r in rows(tmp_path / "n"))


def test_long_descriptions(tmp_path):
    """Descriptions that DESC cannot hold are cut; a line says how many, and of which rows"""
    texts = ["x" * 40, "y" * 41, "z  " + "\u00e4" * 20]
    result = listed(tmp_path, *[signal("ABC"[i], "DB10.DBD%d" % (4 * i), desc=text) for i, text in enumerate(texts)])
    assert "warning: desc: 2 descriptions are longer than 40 bytes and are cut: T.B T.C" in result.err
    assert [r["desc"] for r in rows(tmp_path / "m")] == ["x" * 40, "y" * 40, "z " + "\u00e4" * 19]


def test_symbol_twice(tmp_path):
    """A symbol that a list has twice: the first row counts in all its columns"""
    result = listed(tmp_path, signal("A", "DB10.DBD0", unit="C"), signal("A", "DB10.DBD4", unit="m"))
    assert 'l.csv [l.csv] A3: warning: "T.A" is there twice with another place or type' in result.err
    assert rows(tmp_path / "m")[0]["egu"] == "C"


def test_row_without_a_symbol(tmp_path):
    """A row with an address and no symbol is left out, and told"""
    result = listed(tmp_path, ["", "", "DB10.DBD8", "", "", "", ""], signal("A", "DB10.DBD0"))
    assert "l.csv [l.csv] A2: warning: symbol: it is blank: left out" in result.err
