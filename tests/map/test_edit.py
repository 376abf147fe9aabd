"""A map that is edited as people edit: what has a place keeps it, and the layout id changes
exactly when the bytes do."""
import csv
import random
import re

import pytest

import maps
import tank as example
from conftest import plcmap


def read(folder):
    with open(folder / "map.csv", newline="", encoding="utf-8") as f:
        return list(csv.DictReader(f))


def write(folder, rows):
    with open(folder / "map.csv", "w", newline="", encoding="utf-8") as f:
        writer = csv.DictWriter(f, maps.COLUMNS, lineterminator="\n", extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)


def places(folder):
    return {r["symbol"]: (r["tx"], r["rx"]) for r in read(folder)}


def layout_id(folder):
    result = plcmap("check", folder)
    assert result.status == 0, result.err
    return int(re.search(r"layout id (\d+)", result.out).group(1))


@pytest.fixture
def plant(tmp_path):
    """120 rows with places."""
    folder = maps.write(tmp_path / "plant", maps.rows(120, 21))
    assert plcmap("place", folder).status == 0
    return folder


def replaced(folder, change):
    rows = read(folder)
    change(rows)
    write(folder, rows)


def test_placed_again(plant):
    """A second `place` changes nothing"""
    before = (plant / "map.csv").read_bytes()
    result = plcmap("place", plant)
    assert (result.status, result.out) == (0, "") and (plant / "map.csv").read_bytes() == before


def test_rows_in_the_middle(plant):
    """Rows inserted in the middle get free places, all others keep theirs"""
    before, old = places(plant), layout_id(plant)
    new = [{"symbol": "New%d" % i, "plc": "DB90.DBW%d" % (2 * i), "type": "INT", "dir": "in",
            "pv": "New%d" % i} for i in range(5)]
    replaced(plant, lambda rows: rows.__setitem__(slice(60, 60), new))
    assert plcmap("place", plant).status == 0
    after = places(plant)
    assert {s: p for s, p in after.items() if s in before} == before
    assert all(after["New%d" % i][0] for i in range(5))
    assert layout_id(plant) != old


def test_many_edits(plant):
    """In 40 random edits no place moves"""
    rnd = random.Random(5)
    for step in range(40):
        before = places(plant)
        rows = read(plant)
        kind = rnd.choice(["insert", "delete", "shuffle", "rename", "limits"])
        if kind == "insert":
            rows.insert(rnd.randrange(len(rows)), {
                "symbol": "E%d" % step, "plc": "DB91.DBD%d" % (4 * step), "type": "REAL",
                "pv": "E%d" % step})
        elif kind == "delete":
            del rows[rnd.randrange(len(rows))]
        elif kind == "shuffle":
            rnd.shuffle(rows)
        elif kind == "rename":
            rnd.choice(rows)["pv"] = "Renamed%d" % step
        else:
            next(r for r in rows if r["type"] == "REAL")["hopr"] = str(1000 + step)
        write(plant, rows)
        result = plcmap("place", plant)
        assert result.status == 0, result.err
        after = places(plant)
        assert all(after[s] == p for s, p in before.items() if s in after)


def test_type_grows(plant):
    """A type that grows: only its own rows move, when they are told to"""
    replaced(plant, lambda rows: [r.update(plc="") for r in rows if r["type"] == "AXIS"])
    before, old = places(plant), layout_id(plant)
    users = {r["symbol"] for r in read(plant) if "AXIS" in r["type"]}
    text = (plant / "types.csv").read_text()
    lines = text.splitlines()
    at = next(i for i, l in enumerate(lines) if l.startswith("AXIS"))
    lines.insert(at + 2, ",Torque,REAL" + "," * (lines[0].count(",") - 2))
    (plant / "types.csv").write_text("\n".join(lines) + "\n")
    assert plcmap("place", plant, "--grow").status == 0
    after = places(plant)
    assert {s for s in before if after[s] != before[s]} <= users
    assert layout_id(plant) != old
    fields = [l.split(",")[1:4] for l in (plant / "types.csv").read_text().splitlines()]
    assert ["Torque", "REAL", "38"] in fields and ["Speed", "REAL", "2"] in fields
    assert users


def test_deleted_and_reserved(tank):
    """Reserved bytes are not given to others before --compact"""
    def reserve(rows):
        row = next(r for r in rows if r["symbol"] == "Tank.Count")
        row.update(dir="reserved", pv="", via="", desc="")
        rows.append({"symbol": "New", "plc": "DB11.DBD60", "type": "UDINT", "pv": "New"})
    replaced(tank, reserve)
    assert plcmap("place", tank).status == 0
    assert places(tank)["New"][0] not in ("60", "")

    def again(rows):
        next(r for r in rows if r["symbol"] == "New")["tx"] = ""
    replaced(tank, again)
    result = plcmap("place", tank, "--compact")
    assert result.status == 0 and "Tank.Count is no longer reserved" in result.out
    assert places(tank)["New"][0] == "60"


SAME = [("names of records", "Temp,temperature,", "Hot,temperature,"),
        ("descriptions", ",temperature,C", ",warmth,C"), ("limits", ",5,10,80,95,", ",5,10,70,95,"),
        ("units", ",temperature,C,", ",temperature,K,"), ("states", "closed|OPEN", "shut|WIDE"),
        ("a scale", "0..27648,0..100,1", "0..27648,0..200,1"),
        ("symbols", "Tank.Door,M4.3", "Tank.Gate,M4.3"),
        ("bounds of an array", "ARRAY[0..4] OF INT", "ARRAY[1..5] OF INT"),
        ("how it is moved", "in,54,,explicit", "in,54,,ptr")]
OTHER = [("a type", "DB11.DBD6,UDINT", "DB11.DBD6,DINT"), ("a place", "BOOL,in,98.0", "BOOL,in,98.1"),
         ("a byte", "DATE_AND_TIME,in,116", "DATE_AND_TIME,in,118"),
         ("the length of a text", "STRING[20]", "STRING[19]"),
         ("the number of elements", "ARRAY[0..4] OF INT", "ARRAY[0..3] OF INT"),
         ("a place in the PLC", "M4.3", "M5.3"),
         ("a row less", [l for l in example.MAP.splitlines() if l.startswith("Clock")][0] + "\n", ""),
         ("a value that is reserved", "UDINT,in,60,,explicit,Count,pieces", "UDINT,reserved,60,,,,")]


@pytest.mark.parametrize("title, old, new", SAME, ids=[s[0] for s in SAME])
def test_id_stays(tmp_path, title, old, new):
    """The layout id does not change with {title}"""
    first = layout_id(example.write(tmp_path / "a"))
    assert old in example.MAP
    second = example.write(tmp_path / "b", map=example.MAP.replace(old, new))
    assert layout_id(second) == first


@pytest.mark.parametrize("title, old, new", OTHER, ids=[s[0] for s in OTHER])
def test_id_changes(tmp_path, title, old, new):
    """The layout id changes with {title}"""
    first = layout_id(example.write(tmp_path / "a"))
    assert old in example.MAP
    second = example.write(tmp_path / "b", map=example.MAP.replace(old, new))
    assert layout_id(second) != first


@pytest.mark.parametrize("key, value", [("byteorder", "little"), ("min_in", "200")])
def test_id_of_the_plc(tmp_path, key, value):
    """The layout id changes with {key}"""
    first = layout_id(example.write(tmp_path / "a"))
    assert layout_id(example.write(tmp_path / "b", plc=example.PLC + "%s,%s\n" % (key, value))) != first


def test_diff(tmp_path):
    """diff tells what came, went, moved and changed, and whether the layout did"""
    old = example.write(tmp_path / "old")
    text = example.MAP.replace("Temp,temperature,C", "Temp,warmth,C").replace("in,98.0", "in,99.0")
    text = text.replace("Tank.Flags", "Tank.Bits")
    new = example.write(tmp_path / "new", map=text)
    lines = plcmap("diff", old, new).out.splitlines()
    assert "- Tank.Flags WORD tx 64" in lines and "+ Tank.Bits WORD tx 64" in lines
    assert "> Tank.Door tx 99.0, was 98.0" in lines
    assert "* Tank.Temp desc: warmth, was temperature" in lines
    assert any(l.startswith("layout id: ") and "loaded together" in l for l in lines)
    assert plcmap("diff", old, old).out.startswith("layout id: ")


def test_diff_of_sheets(tmp_path):
    """diff tells what became of keys, types and enums, too"""
    old = example.write(tmp_path / "old")
    new = example.write(tmp_path / "new", plc=example.PLC.replace("prefix,tank:", "prefix,t:"),
                        enums=example.ENUMS.replace("manual", "by hand").replace(",2,auto,\n", ""),
                        types=example.TYPES.replace("position", "place") + ",More,INT,,,,,,\n")
    lines = plcmap("diff", old, new).out.splitlines()
    assert [line for line in lines if "layout id" not in line] == [
        "plc prefix: t:, was tank:", "* type VALVE.Pos desc: place, was position", "+ type VALVE.More",
        "- enum MODE.2", "* enum MODE.1 text: by hand, was manual"]


def edited(text, changes):
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    return text


SWAPPED = [("in,100,,ptr,V101", "in,X,,ptr,V101"), ("in,108,,ptr,V102", "in,100,,ptr,V102"),
           ("in,X,,ptr,V101", "in,108,,ptr,V101")]


@pytest.mark.parametrize("title, changes, words", [
    ("a name", [("Temp,temperature,C", "Hot,temperature,C")], " as before; the PLC's program fits"),
    ("another place in the PLC", [("M4.3", "M5.3")], "PLC and IOC must be loaded together"),
    ("two rows that swap places", SWAPPED, "PLC and IOC must be loaded together"),
])
def test_diff_of_the_layout(tmp_path, title, changes, words):
    """{title}: diff says whether PLC and IOC must be loaded together"""
    old = example.write(tmp_path / "old")
    new = example.write(tmp_path / "new", map=edited(example.MAP, changes))
    last = plcmap("diff", old, new).out.splitlines()[-1]
    assert last.startswith("layout id: ") and words in last


def test_diff_of_equal_ids(tmp_path, monkeypatch):
    """Two layouts that have one id by chance are told, with a way out"""
    from plcmaplib import diff
    monkeypatch.setattr(diff, "layout_id", lambda crc: 7)
    old = example.write(tmp_path / "old")
    new = example.write(tmp_path / "new", map=edited(example.MAP, SWAPPED))
    assert "by chance" in plcmap("diff", old, new).out.splitlines()[-1]


def test_place_near(tmp_path):
    """Neighbours in the PLC get the same distance in the block: one pointer row moves them"""
    rows = [{"symbol": "A%d" % i, "plc": "DB10.DBW%d" % (2 * i), "type": "INT", "pv": "A%d" % i}
            for i in range(20)]
    random.Random(1).shuffle(rows)
    folder = maps.write(tmp_path / "m", rows, {"sync": "off"})
    assert plcmap("place", folder).status == 0
    shown = plcmap("show", folder).out
    assert shown.count("ptr  ") <= 5


def test_show_one(tank):
    """show tells all about one byte, one symbol or one record"""
    for what in ("54", "in.54", "Tank.Temp", "Temp", "tank:Temp"):
        out = plcmap("show", tank, what).out
        assert "symbol   Tank.Temp\n" in out and "plc      DB11.DBD0" in out
    assert "nothing is at byte 99" in plcmap("show", tank, "99").out


def test_show_nothing(tank):
    """show of a name or a byte that is not there ends with 1 and says what there is; a free byte is an answer"""
    for what, text in (("Tank.Tmp", 'no symbol and no record "Tank.Tmp" (did you mean Tank.Temp?)'), ("x", "allowed: one of the map, or a byte"),
                       ("9999", "no byte 9999; allowed: below 124"), ("out.200", "no byte out.200; allowed: below 54")):
        result = plcmap("show", tank, what)
        assert result.status == 1 and text in result.err, result.err
    assert plcmap("show", tank, "99").status == 0


MIRRORED = [
    {"symbol": "Temp.SP", "plc": "DB10.DBD0", "type": "REAL", "dir": "out", "pv": "SP"},
    {"symbol": "Pump", "plc": "DB10.DBX4.0", "type": "BOOL", "dir": "out", "pv": "Pump"},
    {"symbol": "Temp", "plc": "DB11.DBD0", "type": "REAL", "dir": "in", "pv": "Temp"},
]
RUNNING = {"symbol": "Running", "plc": "DB10.DBX4.1", "type": "BOOL", "dir": "in", "pv": "Running"}


def mirrored(tmp_path, rows, **keys):
    folder = maps.write(tmp_path / "m", rows, {"readback": "0", **keys})
    result = plcmap("place", folder)
    assert result.status == 0, result.err
    return folder


@pytest.mark.parametrize("title, keys", [
    ("a bit beside that of a setpoint", {}),
    ("room for setpoints to come", {"min_out": "64"}),
])
def test_place_beside_the_mirror(tmp_path, title, keys):
    """readback, {title}: `place` puts no input where setpoints are shown"""
    folder = mirrored(tmp_path, MIRRORED, **keys)
    old = places(folder)
    write(folder, read(folder) + [RUNNING])
    result = plcmap("place", folder)
    assert result.status == 0, result.err
    new = places(folder)
    assert {s: new[s] for s in old} == old and layout_id(folder)


def test_mirror_has_no_room(tmp_path):
    """readback: a setpoint that would be shown on an input is refused, nothing is written, and
    the way out that the message names works without moving anything"""
    folder = mirrored(tmp_path, MIRRORED)
    old = places(folder)
    write(folder, read(folder) + [{"symbol": "Sp2", "plc": "DB10.DBD40", "type": "REAL",
                                   "dir": "out", "pv": "SP2"}])
    before = (folder / "map.csv").read_bytes()
    result = plcmap("place", folder)
    assert result.status == 1 and (folder / "map.csv").read_bytes() == before
    assert "taken by" not in result.err and ":5:6: rx: no room: readback=0 " in result.err
    assert "leave the key readback blank" in result.err
    text = (folder / "plc.csv").read_text(encoding="utf-8").replace("readback,0", "readback,")
    (folder / "plc.csv").write_text(text, encoding="utf-8")
    assert plcmap("place", folder).status == 0
    assert {s: places(folder)[s] for s in old} == old and layout_id(folder)


def test_mirror_beyond_the_end(tmp_path):
    """readback near the end of the longest block: errors, no traceback"""
    folder = maps.write(tmp_path / "m", MIRRORED, {"readback": "65535"})
    result = plcmap("place", folder)
    assert result.status == 1 and "exceed the longest block" in result.err


def test_setpoint_beside_an_input(tmp_path):
    """readback: a setpoint's bit, or a hole between setpoints, never takes inputs of the PLC along"""
    folder = mirrored(tmp_path, MIRRORED + [
        RUNNING,
        {"symbol": "State", "plc": "DB10.DBB5", "type": "BYTE", "dir": "in", "pv": "State"},
        {"symbol": "Mode", "plc": "DB10.DBW6", "type": "INT", "dir": "out", "pv": "Mode"}])
    shown = plcmap("show", folder).out.split("transfers IOC to PLC\n")[1].splitlines()
    assert [line.split(" <-")[0].split(None, 1) for line in shown if line] == [
        ["ptr", "P#DB10.DBX0.0 BYTE 4"], ["ptr", "P#DB10.DBX6.0 BYTE 2"],
        ["explicit", "DB10.DBX4.0"]]


@pytest.mark.parametrize("via, moved", [
    ("", [["ptr", "P#DB10.DBX0.0 BYTE 4"], ["ptr", "P#DB10.DBX6.0 BYTE 2"], ["explicit", "DB10.DBX4.0"]]),
    ("ptr", [["ptr", "P#DB10.DBX0.0 BYTE 8"]])])
def test_bits_of_nobody(tmp_path, via, moved):
    """readback, via "{via}": bits and bytes that no row has move to the PLC only where via says so"""
    rows = MIRRORED[:2] + [{"symbol": "Mode", "plc": "DB10.DBW6", "type": "INT", "dir": "out",
                            "pv": "Mode"}]
    folder = mirrored(tmp_path, [{**r, "via": via} for r in rows])
    shown = plcmap("show", folder).out.split("transfers IOC to PLC\n")[1].splitlines()
    assert [line.split(" <-")[0].split(None, 1) for line in shown if line] == moved
