"""The displays: what their generator writes, and what its lint sees."""
import re
import subprocess
import sys
import xml.etree.ElementTree as xml

import pytest

from client import TOP
from docblocks import blocks

GENERATE = TOP / "s7plcApp/op/generate.py"
sys.path.insert(0, str(GENERATE.parent))
from plcdisplays import displays, layout, lint  # noqa: E402


def generate(*arguments):
    return subprocess.run([sys.executable, str(GENERATE), *map(str, arguments)],
                          capture_output=True, text=True)


def test_generated():
    """the displays are what the generator writes, each PV has its record, and nothing overlaps"""
    run = generate("--check")
    assert run.returncode == 0, run.stdout + run.stderr


def test_small():
    """the overview needs no more of a PLC than s7plcStationSmall.db has"""
    known = lint.records({"P": "P:"}, ["s7plcApp/Db/s7plcStationSmall.db"])
    shown = {pv for i in displays.overview([("PLC", "P:", [])]).items for pv in i.pvs()}
    assert shown and shown <= known, shown - known


FAULTS = [
    ("no record for $(P)Nonsense", lambda d: d.value("$(P)Nonsense", 0, 0, 50)),
    ('"Much too long" needs', lambda d: d.label("Much too long", 0, 0, 50)),
    ("pixels high", lambda d: d.label("A", 0, 0, 50, 10, 24)),
    ("is outside", lambda d: d.label("A", 90, 0, 50)),
    ("overlaps", lambda d: (d.label("A", 0, 0, 50), d.label("B", 49, 0, 50))),
    ("no display plclinkNothing", lambda d: d.open("A", 0, 0, 50, 20, "plclinkNothing", {})),
    ('"NO ADDRESS" needs', lambda d: d.lamp("$(P)State", 0, 0, 40, 20, displays.STATE)),
]


@pytest.mark.parametrize("text, spoil", FAULTS, ids=[text for text, _ in FAULTS])
def test_lint(text, spoil):
    """the lint of displays says: {text}"""
    display = layout.Display("test", "test", 100, 40, "")
    spoil(display)
    assert any(text in line for line in lint.faults([display])), lint.faults([display])


def test_overview(tmp_path):
    """an overview of PLCs from a list; a line that is wrong is named"""
    plcs = tmp_path / "plcs"
    plcs.write_text("# two\nPRESS hall:PRESS: MODBUS\nPAIR hall:PAIR: PAIR\n")
    run = generate("--plcs", plcs, "-o", tmp_path)
    assert run.returncode == 0, run.stderr
    assert {p.name for p in tmp_path.glob("*/*")} == {f"plclinkOverview.{e}"
                                                      for e in ("bob", "adl", "ui")}
    tree = xml.parse(tmp_path / "bob/plclinkOverview.bob")
    pvs = [e.text for e in tree.iter("pv_name")]
    assert "hall:PRESS:State" in pvs and "hall:PAIR:Backup" in pvs
    assert "hall:PRESS:Backup" not in pvs
    plcs.write_text("PRESS hall:PRESS: MODBUSS\n")
    run = generate("--plcs", plcs, "-o", tmp_path)
    assert run.returncode != 0 and f"{plcs}:1:" in run.stderr


def test_documented(tmp_path):
    """the list and the command of docs/displays.md make an overview of three PLCs"""
    page = [b.text for b in blocks() if b.page == "displays.md"]
    (tmp_path / "hall2.plcs").write_text(next(text for text in page if text.startswith("# name")))
    command = next(text for text in page if text.startswith("python3 ")).split()
    words = [str(TOP / w) if w.startswith("s7plcApp/") else w for w in command[1:]]
    words[words.index("-o") + 1] = "out"
    subprocess.run([sys.executable, *words], cwd=tmp_path, check=True)
    text = (tmp_path / "out/bob/plclinkOverview.bob").read_text()
    assert all(f"hall2:{name}:State" in text for name in ("PRESS", "OVEN", "CUTTER"))


def test_ends(tmp_path):
    """displays of records whose names have ends: each PV has its record, in all displays"""
    ends = ("-R", "-S")
    known = lint.records({"P": "P:", "IOC": "P", "R": ends[0], "S": ends[1]})
    shown = {pv.split(".")[0].replace("$(P)", "P:")
             for d in displays.all_displays([("A", "P:", displays.PARTS)], *ends)
             for i in d.items for pv in i.pvs()}
    assert {"P:State-R", "P:Reset-S", "P:PeriodHistogram-R", "P:PLC_ERRORS"} <= shown
    assert shown <= known, shown - known
    run = generate("--read=-R", "--order=-S", "-o", tmp_path)
    assert run.returncode == 0, run.stderr
    assert len(list(tmp_path.glob("*/*"))) == 4 * 7
    assert "$(P)State-R" in (tmp_path / "bob/plclinkStation.bob").read_text()
    run = generate("--read=-R")
    assert run.returncode == 2 and "-o FOLDER" in run.stderr


COLOURS = {
    layout.GREEN: "BACKUP ready, DATA OK, EQUAL, FIRST leads, SECOND leads, SYNCED, answers, connected, output ok",
    layout.RED: "2 PRIMARIES, ALL REFUSED, CONNECTING, FROZEN, LAYOUT, LAYOUT MISMATCH, MAP MISMATCH, MISMATCH, NO ADDRESS, "
                "NO DATA, NO OUTPUT, NO PRIMARY, NOT CONNECTED, REFUSED, WRONG SIZE",
    layout.ORANGE: "BACKUP ?, BACKUP LOST, BEGINNING, CHECKING, DISCONNECTED, IOC REFUSED, LOADING, MAP DOWNLOAD, NO ANSWER, "
                   "NOT CONNECTED, NOW FIRST, NOW SECOND, OUTPUT ?, OUTPUT WAITS, PLC CHECKS, PLC REFUSES, SOME REFUSED, WAITING",
    layout.BLUE: "HMI controls, LOCAL",
    layout.GREY: "EPICS controls, FIXED TABLES, IOC refused none, no output, no partner, not known",
}


def lamps():
    for display in displays.all_displays([("PLC", "P:", list(displays.PARTS))]):
        yield from (item for item in display.items if item.kind == "lamp")


def test_colours():
    """each word that a lamp can show has its colour: what is good is green, and nothing else"""
    found = {colour: set() for colour in COLOURS}
    for lamp in lamps():
        for _, word, colour in lamp.states:
            found[colour].add(word)
    assert found == {colour: set(words.split(", ")) for colour, words in COLOURS.items()}


def test_unknown():
    """a lamp is purple for a value that it does not know, in MEDM with a question mark; it looks at VAL, not at severities"""
    purple = '<fallback_color><color red="%d" green="%d" blue="%d"' % tuple(layout.PURPLE)
    station = next(d for d in displays.all_displays([]) if d.name == "plclinkStation")
    own = [lamp for lamp in station.items if lamp.kind == "lamp"]
    bob, adl = ((GENERATE.parent / tool / f"plclinkStation.{tool}").read_text() for tool in ("bob", "adl"))
    assert bob.count(purple) == len(own) == 5
    assert adl.count('textix="?"') == len([lamp for lamp in own if not lamp.part]) == 3
    assert not [lamp.pv for lamp in lamps() if "." in lamp.pv]


def test_buttons():
    """P, NAME and HAS_... are all that a display wants; buttons of what a PLC has not are hidden, in MEDM all are there"""
    for file in sorted((GENERATE.parent / "bob").iterdir()):
        assert {re.sub("=.*", "", word) for word in re.findall(r"\$\(([^)]*)\)", file.read_text())} <= \
            {"P", "NAME", "IOC", *("HAS_" + part for part in displays.PARTS)}, file
    bob, adl, pair = ((GENERATE.parent / file).read_text() for file in (
        "bob/plclinkStation.bob", "adl/plclinkStation.adl", "adl/plclinkPair.adl"))
    for part in displays.PARTS:
        assert f"<visible>$(HAS_{part}=false)</visible>" in bob
    buttons = adl.split('"related display" {')[1:]
    assert len(buttons) == 6 and not any("vis=" in text.split("related")[0].split("rectangle {")[0].split("text {")[0]
                                         for text in buttons)
    assert "$(P)Pair" in bob and "$(P)Pair" in pair and "$(P)Pair" not in adl


def test_orders_ask():
    """Reset counters and Send now ask before they do it; in MEDM and caQtDM they are menus"""
    bob, adl, ui, pydm = ((GENERATE.parent / tool / f"plclinkStation.{end}").read_text() for tool, end in (
        ("bob", "bob"), ("adl", "adl"), ("ui", "ui"), ("pydm", "ui")))
    assert bob.count("<show_confirm_dialog>true<") == pydm.count('"showConfirmDialog" stdset="0"><bool>true<') == 2
    menus = re.findall(r"\nmenu \{.*?chan=\"\$\(P\)(\w+)", adl, re.S)
    assert sorted(menus) == ["Reset", "Send"] and ui.count("caMenu") == 2


@pytest.mark.parametrize("tool", ["bob", "ui", "pydm", "adl"])
def test_well_formed(tool):
    """the files for {tool} are XML, but for those of MEDM, and are installed"""
    files = sorted((GENERATE.parent / tool).iterdir())
    assert len(files) == 7
    for file in files:
        if tool != "adl":
            xml.parse(file)
        assert (TOP / "op" / tool / file.name).read_text() == file.read_text()


def test_adl():
    """the files for MEDM have their brackets in pairs, and name no colour that is not there"""
    for file in sorted((GENERATE.parent / "adl").iterdir()):
        text = file.read_text()
        assert text.count("{") == text.count("}"), file
        number = int(text.split("ncolors=")[1].split()[0])
        used = [int(word.split("=")[1]) for word in text.split()
                if word.startswith(("clr=", "bclr="))]
        assert used and max(used) < number, file
