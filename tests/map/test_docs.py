"""docs/map.md: its tutorial is run, its descriptions are used, its tables are complete."""
import csv
import re

import pytest

from conftest import TOP, plcmap
from plcmaplib import columns, main

TEXT = (TOP / "docs/map.md").read_text(encoding="utf-8")


def block(after, kind=""):
    """The first code block behind a text."""
    part = TEXT[TEXT.index(after):]
    return re.search(r"```%s\n(.*?)```" % kind, part, re.S).group(1)


@pytest.fixture
def tutorial(tmp_path):
    folder = tmp_path / "tank"
    folder.mkdir()
    for name in columns.SHEETS:
        (folder / (name + ".csv")).write_text(block("`tank/%s.csv`" % name, "csv"), encoding="utf-8")
    return folder


def test_tutorial(tutorial, tmp_path):
    """The tutorial's map is placed, checked, shown, generated"""
    assert plcmap("check", tutorial).status == 1  # no places yet
    placed = plcmap("place", tutorial)
    assert placed.status == 0 and len(placed.out.splitlines()) == 9 + 4 + 4
    checked = plcmap("check", tutorial)
    assert (checked.status, checked.err) == (0, "")
    assert "free" in plcmap("show", tutorial).out
    out = tmp_path / "gen"
    assert plcmap("generate", tutorial, "-o", out).status == 0
    made = {f.name for f in out.iterdir()}
    assert {"tank.cmd", "tank-step7.scl", "tank.plc", "tank-VALVE.template", "tank.substitutions",
            "tank.db", "tank.archive", "tank.req", "tank-alarms.xml", "tank.md", "tank.html", "tank.svg",
            "tank.bob"} <= made
    cmd = (out / "tank.cmd").read_text()
    assert "TANK_ADDRESS" in cmd and "TANK_PORT" in cmd


def test_tutorial_is_proved(tutorial):
    """The tutorial's map is proved"""
    program = next(TOP.glob("bin/*/s7plcIoc"), None)
    if program is None:
        pytest.skip("the tree is not built")
    plcmap("place", tutorial)
    result = plcmap("prove", tutorial, "--bin", program.parent)
    assert result.status == 0 and ", 0 differ" in result.out, result.out


def test_mistakes_of_the_tutorial(tutorial):
    """The messages that the tutorial shows are those that come"""
    plcmap("place", tutorial)
    lines = (tutorial / "map.csv").read_text().splitlines()
    rows = list(csv.reader(lines))
    tx = rows[5][4]
    rows[5][2] = "REEL"
    rows[6][4] = tx
    with open(tutorial / "map.csv", "w", newline="") as f:
        csv.writer(f, lineterminator="\n").writerows(rows)
    err = plcmap("check", tutorial).err
    assert re.search(r'map.csv:6:3: type: unknown type "REEL" \(did you mean REAL\?\); allowed: BOOL', err)
    rows[5][2] = "REAL"
    with open(tutorial / "map.csv", "w", newline="") as f:
        csv.writer(f, lineterminator="\n").writerows(rows)
    told = "tx: byte %s is taken by line 6 (Tank.Temp); leave it blank, then `plcmap place` finds a free place\n" % tx
    assert "map.csv:7:5: " + told in plcmap("check", tutorial).err and told in TEXT


@pytest.mark.parametrize("sheet", columns.SHEETS)
def test_all_columns(sheet):
    """All columns of the sheet {sheet} are in the document"""
    part = TEXT[TEXT.index("## Sheet `%s`" % sheet):]
    part = part[:part.index("\n## ", 3)]
    names = columns.PLC_KEYS if sheet == "plc" else columns.SHEETS[sheet]
    assert [n for n in names if "`%s`" % n not in part] == []


def test_all_commands():
    """All commands are in the document, with options that exist"""
    parser = main._parser()
    commands = parser._subparsers._group_actions[0].choices
    part = TEXT[TEXT.index("## Commands"):TEXT.index("## Sheet `map`")]
    for name, sub in commands.items():
        assert "| `%s " % name in part
    for line in re.findall(r"^plcmap (.*)$", TEXT, re.M) + re.findall(r"`plcmap ([^`]*)`", TEXT):
        words = re.findall(r"'[^']*'|\S+", line)
        if words[0] not in commands or "\\" in line and "import" not in line:
            continue
        known = {o for a in commands[words[0]]._actions for o in a.option_strings}
        assert [w for w in words[1:] if w.startswith("--") and w not in known] == [], line


def test_list_description(tmp_path):
    """The description of a list reads a list"""
    (tmp_path / "d.txt").write_text(block("**Sheets of your own.**"), encoding="utf-8")
    (tmp_path / "list.csv").write_text(
        "My signals,,,,,,\n,,,,,,\nArea,Signal,Kind,Address,In/Out,Description,Unit\n"
        "T1,Level,Analog,DB5.DBD4,Input,level,%\nT1,Pump,Digital,E 4.3,Output,pump,N/A\n"
        "T1,Odd,Complex,DB5.DBD8,Input,,\n,,,,,,\n", encoding="utf-8")
    result = plcmap("import", tmp_path / "list.csv", "--columns", tmp_path / "d.txt", "--into",
                    tmp_path / "m")
    assert 'list.csv [list.csv] A6: warning: type "Complex" is not in the description' in result.err
    with open(tmp_path / "m" / "map.csv", newline="") as f:
        rows = {r["symbol"]: r for r in csv.DictReader(f)}
    assert rows["T1.Level"]["type"] == "REAL" and rows["T1.Level"]["egu"] == "%"
    assert rows["T1.Level"]["pv"] == "T1:Level" and rows["T1.Level"]["plc"] == "DB5.DBD4"
    assert rows["T1.Pump"]["dir"] == "out" and rows["T1.Pump"]["plc"] == "I4.3"
    assert rows["T1.Pump"]["egu"] == "" and set(rows) == {"T1.Level", "T1.Pump"}


def sheet_of_types(tmp_path):
    """Two directions side by side, a type two columns away, a spare bit, a wrong row."""
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    tab = book.active
    tab.title = "Devices"
    lines = {
        2: {2: 'Type "VALVE" PLC -> EPICS', 8: 'Type "VALVE" EPICS -> PLC'},
        3: {2: "DBX0.0", 3: "Bool", 4: "Open", 5: "is open", 8: "DBX0.0", 9: "Bool", 10: "DoOpen"},
        4: {2: "DBX0.1", 3: "Bool", 5: "spare", 8: "DBW2", 9: "Int", 10: "Speed"},
        6: {2: "DBD2", 3: "Real", 4: "Pos ", 5: "position"},
        7: {2: "DBD9x", 3: "Real", 4: "Wrong"},
        20: {4: 'Type "PUMP" PLC -> EPICS'},
        21: {4: "DBW0", 5: "Int", 6: "Hours"},
    }
    for line, cells in lines.items():
        for column, text in cells.items():
            tab.cell(line, column, text)
    book.save(tmp_path / "types.xlsx")
    return tmp_path / "types.xlsx"


def test_types_description(tmp_path):
    """The description of type sheets finds types at any column, both directions"""
    (tmp_path / "d.txt").write_text(block("Type sheets, blocks of rows"), encoding="utf-8")
    result = plcmap("import", sheet_of_types(tmp_path), "--columns", tmp_path / "d.txt")
    assert result.status == 0 and "3 types" in result.out, result.err
    assert 'types.xlsx [Devices] B7: warning: "DBD9x" is no address in a type' in result.err


def test_types_into_a_map(tmp_path):
    """Types of a sheet become types of the map, with their places"""
    (tmp_path / "d.txt").write_text(block("Type sheets, blocks of rows"), encoding="utf-8")
    result = plcmap("import", sheet_of_types(tmp_path), "--columns", tmp_path / "d.txt", "--types",
                    "--into", tmp_path / "m")
    assert result.status == 0, result.err
    text = (tmp_path / "m" / "types.csv").read_text()
    assert "VALVE_in,Open,BOOL,0.0," in text and ",Pos,REAL,2," in text
    assert "VALVE_out,DoOpen,BOOL,0.0," in text and "PUMP_in,Hours,INT,0," in text


def test_bad_description(tmp_path):
    """A description with an unknown key is refused, with its line and the nearest key"""
    (tmp_path / "d.txt").write_text("form = list\nsymbl = X\n")
    (tmp_path / "l.csv").write_text("X\n1\n")
    result = plcmap("import", tmp_path / "l.csv", "--columns", tmp_path / "d.txt")
    assert result.status == 1 and 'd.txt:2: "symbl" is no key (did you mean symbol?)' in result.err
