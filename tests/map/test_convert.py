"""Round trips between CSV files and a workbook, and what people's programs make of both."""
import pytest

import maps
import tank as example
from conftest import plcmap

openpyxl = pytest.importorskip("openpyxl")


def sheets(folder):
    return {f.name: f.read_text(encoding="utf-8") for f in sorted(folder.glob("*.csv"))}


@pytest.mark.parametrize("count, seed", [(10, 1), (300, 2), (2000, 3)])
def test_round_trip(tmp_path, count, seed):
    """{count} rows: CSV to workbook and back is the same"""
    rows = maps.rows(count, seed)
    rows[0]["desc"] = "=1+1"
    rows[1]["desc"] = "0010"
    rows[2]["desc"] = 'a "b", c; \u00fc\u0394'
    folder = maps.write(tmp_path / "a", rows)
    plcmap("place", folder)
    assert plcmap("convert", folder, tmp_path / "a.xlsx").status == 0
    assert plcmap("convert", tmp_path / "a.xlsx", tmp_path / "b").status == 0
    assert sheets(tmp_path / "b") == sheets(folder)


def test_workbook_is_a_map(tmp_path, tank):
    """A workbook is checked and placed like a folder; it has drop-downs and only text"""
    book = tmp_path / "tank.xlsx"
    plcmap("convert", tank, book)
    assert plcmap("check", book).out == plcmap("check", tank).out
    tab = openpyxl.load_workbook(book)["map"]
    assert tab.freeze_panes == "B2"
    assert any("cmd" in str(v.formula1) for v in tab.data_validations.dataValidation)
    assert all(isinstance(c.value, (str, type(None))) for r in tab.iter_rows() for c in r)


def edited(tmp_path, tank, change):
    book = tmp_path / "tank.xlsx"
    plcmap("convert", tank, book, "-f")
    work = openpyxl.load_workbook(book)
    change(work["map"])
    work.save(book)
    return plcmap("check", book)


def test_error_names_the_cell(tmp_path, tank):
    """A mistake in a workbook is told with sheet and cell"""
    def change(tab):
        tab["C11"] = "REEL"
    assert "tank.xlsx [map] C11: type: unknown type" in edited(tmp_path, tank, change).err


def test_what_else_is_there_stays(tmp_path, tank):
    """place and import change their cells of a workbook; other sheets, notes, formulas stay"""
    book = tmp_path / "tank.xlsx"
    plcmap("convert", tank, book)
    work = openpyxl.load_workbook(book)
    work.create_sheet("My notes")["B2"] = "=1+1"
    tab = work["map"]
    tab["I3"].comment = openpyxl.comments.Comment("ask Anna", "me")
    tab.column_dimensions["A"].width = 55
    tab["E13"] = None
    work["types"].insert_rows(1, 2)  # blank rows above the header
    tab.cell(24, 1, "Late")  # behind blank rows
    tab.cell(24, 3, "INT")
    work.save(book)
    result = plcmap("place", book)
    assert result.status == 0 and "[map] E13: Tank.Count tx at 60" in result.out, result.err
    (tmp_path / "x.asc").write_bytes(b"126," + b"Extra".ljust(24) + b"MW     20".ljust(12) +
                                     b"INT".ljust(90) + b"\r\n")
    assert plcmap("import", tmp_path / "x.asc", "--into", book).status == 0
    work = openpyxl.load_workbook(book)
    assert work["My notes"]["B2"].value == "=1+1"
    tab = work["map"]
    assert tab["I3"].comment.text == "ask Anna" and tab.column_dimensions["A"].width == 55
    assert tab["E13"].value == "60" and tab["E24"].value and tab["A25"].value == "Extra"
    assert plcmap("place", book).status == 0 and plcmap("check", book).status == 0


def test_date(tmp_path, tank):
    """A date where 1.2 was typed is told with its cell"""
    import datetime

    def change(tab):
        tab["E17"] = datetime.datetime(2026, 2, 1)
    result = edited(tmp_path, tank, change)
    assert result.status == 1 and "[map] E17: the cell is a date" in result.err


def test_numbers(tmp_path, tank):
    """Numbers that a program has made of texts are read as they were meant"""
    def change(tab):
        tab["E2"], tab["E17"], tab["M2"] = 4.0, 98.0, 90
    assert edited(tmp_path, tank, change).status == 0


def test_formula(tmp_path, tank):
    """A formula that was never calculated is told with its cell"""
    def change(tab):
        tab["H11"] = '="Te"&"mp"'
    assert "[map] H11: warning: the formula" in edited(tmp_path, tank, change).err


def test_wide_range(tmp_path, tank):
    """Blanks, no-break blanks and a used range up to column AMJ do no harm"""
    def change(tab):
        tab["AMJ400"] = None
        tab.cell(400, 1024).number_format = "@"
        tab["C11"] = " REAL\u00a0"
    assert edited(tmp_path, tank, change).status == 0


def test_merged(tmp_path, tank):
    """Merged data cells are told"""
    def change(tab):
        tab.merge_cells("I11:I12")
    assert "merged cells I11:I12" in edited(tmp_path, tank, change).err


@pytest.mark.parametrize("delimiter, encoding", [(";", "utf-8"), ("\t", "utf-16"), (",", "utf-8-sig"),
                                                 (";", "cp1252")])
def test_csv_of_programs(tmp_path, tank, delimiter, encoding):
    """CSV with {delimiter!r} in {encoding} is the same map"""
    want = plcmap("check", tank).out
    for file in tank.glob("*.csv"):
        text = file.read_text(encoding="utf-8").replace("pieces", "St\u00fcck")
        if delimiter != ",":
            text = text.replace(",", delimiter)
        file.write_bytes(text.replace("\n", "\r\n").encode(encoding))
    result = plcmap("check", tank)
    assert result.status == 0 and result.out == want
    assert ("read as cp1252" in result.err) == (encoding == "cp1252")


def test_decimal_comma(tmp_path, tank):
    """A decimal comma is one where ; separates the cells"""
    for file in tank.glob("*.csv"):
        text = file.read_text(encoding="utf-8").replace(",5,10,80,95,", ",5,10,80@5,95,")
        file.write_text(text.replace(",", ";").replace("@", ","), encoding="utf-8")
    result = plcmap("check", tank)
    assert result.status == 0, result.err
    plcmap("generate", tank, "-o", tmp_path / "gen", "--only", ".db")
    assert 'field(HIGH, "80.5")' in (tmp_path / "gen" / "tank.db").read_text()


def test_notes_stay(tank, tmp_path):
    """Columns that begin with # stay through place and convert"""
    text = example.MAP.replace("\n", ",#mine\n", 1).replace("Valves,,\n", "Valves,,,keep me\n", 1)
    (tank / "map.csv").write_text(text)
    plcmap("place", tank)
    plcmap("convert", tank, tmp_path / "t.xlsx")
    plcmap("convert", tmp_path / "t.xlsx", tmp_path / "t")
    assert "keep me" in (tmp_path / "t" / "map.csv").read_text()


def test_to_stdout(tank):
    """convert MAP - prints all sheets, for git"""
    out = plcmap("convert", tank, "-").out
    assert out.startswith("# sheet plc\nkey,value\n") and "# sheet enums\n" in out


def test_characters_that_an_encoding_lacks(tmp_path, tank):
    """A map in cp1252 takes no symbol that cp1252 cannot hold, and stays as it was"""
    file = tank / "map.csv"
    file.write_bytes(file.read_text(encoding="utf-8").replace("pieces", "St\u00fcck").encode("cp1252"))
    before = file.read_bytes()
    (tmp_path / "x.asc").write_bytes(b"126," + "\u042f".encode("cp1251").ljust(24) + b"MW     20".ljust(12) +
                                     b"INT".ljust(90) + b"\r\n")
    result = plcmap("--encoding", "cp1251", "import", tmp_path / "x.asc", "--into", tank)
    assert result.status == 0, result.err  # the whole map is read in that code page
    file.write_bytes(before)
    (tmp_path / "x.xml").write_text('<Tagtable name="T"><Tag type="Int" addr="%MW20">\u042f</Tag></Tagtable>',
                                    encoding="utf-8")
    result = plcmap("import", tmp_path / "x.xml", "--into", tank)
    assert result.status == 1 and 'cp1252 has no "\u042f"; allowed: save the file as UTF-8 first' in result.err
    assert file.read_bytes() == before


def test_failed_write_leaves_the_workbook(tmp_path, tank, monkeypatch):
    """A workbook that cannot be written whole stays as it was, and nothing lies beside it"""
    book = tmp_path / "w" / "tank.xlsx"
    book.parent.mkdir()
    plcmap("convert", tank, book)
    before = book.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")
    monkeypatch.setattr("os.replace", full)
    result = plcmap("convert", "-f", example.write(tmp_path / "b", map=example.MAP + "X,,INT,in,130,,,X\n"), book)
    assert result.status == 1 and "No space left on device" in result.err
    assert book.read_bytes() == before and list(book.parent.iterdir()) == [book]


def test_written_through_a_link(tmp_path, tank):
    """A sheet that is a symbolic link stays one, and keeps the mode of its file"""
    other = tmp_path / "shared.csv"
    (tank / "map.csv").rename(other)
    other.write_text(other.read_text().replace("in,54,", "in,,"))
    other.chmod(0o664)
    (tank / "map.csv").symlink_to(other)
    assert plcmap("place", tank).status == 0
    assert (tank / "map.csv").is_symlink() and "in,54," in other.read_text()
    assert other.stat().st_mode & 0o777 == 0o664
