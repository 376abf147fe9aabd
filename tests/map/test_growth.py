"""Types that grow, also those inside other types, among other edits: what is not of such a type never
moves, and what is stays checked."""
import csv
import random

import pytest

import maps
from conftest import plcmap
from plcmaplib.files import load
from plcmaplib.problems import Report
from test_edit import read, write

EDITS = 25
KEYS = {"each setpoint by itself": {}, "mirrored": {"readback": "0", "min_out": "400"},
        "no handshake": {"sync": "off"}}


def types_of(folder):
    with open(folder / "types.csv", newline="", encoding="utf-8") as f:
        return list(csv.DictReader(f))


def write_types(folder, fields):
    with open(folder / "types.csv", "w", newline="", encoding="utf-8") as f:
        writer = csv.DictWriter(f, maps.TYPE_COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(fields)


def leaves(folder):
    """{symbol: (row's type, field, tx, rx)} of all values."""
    report = Report()
    map_ = load(str(folder), report)
    assert not report.errors(), report.lines()
    return {l.symbol: (str(l.owner.type).split(" OF ")[-1], l.tx, l.rx) for l in map_.leaves()}


def plant(folder, seed, keys):
    rows = [r for r in maps.rows(70, seed) if r["dir"] != "cmd"]
    for number, row in enumerate(rows):
        if "VALVE" in row["type"] or "AXIS" in row["type"]:
            row["plc"] = "Unit%d" % number  # the PLC moves it by name: its layout may change
    for number in range(6):
        rows.insert(number * 9, {"symbol": "X%d" % number, "plc": "X%d" % number, "pv": "X%d:" % number,
                                 "type": "AXIS" if number % 2 else "ARRAY[1..2] OF AXIS"})
    maps.write(folder, rows, {**keys, "family": "none"})
    assert plcmap("place", folder).status == 0
    return folder


def grow(folder, rnd, number):
    """One more field, anywhere in the sheet; or a field of another type. Returns the types that changed."""
    fields = types_of(folder)
    names = [f["type"] for f in fields]
    owner = rnd.choice(["VALVE", "AXIS"])
    first = names.index(owner)
    last = next((n for n in range(first + 1, len(names)) if names[n]), len(names))
    kind = rnd.choice(["BOOL", "INT", "REAL", "BYTE", "STRING[5]"] + ["VALVE"] * (owner == "AXIS"))
    if rnd.random() < 0.3:
        row = next(f for f in fields[first:last] if f["field"] in ("Cycles", "Speed"))
        row["ftype"] = {"INT": "DINT", "DINT": "LREAL", "REAL": "LREAL", "LREAL": "LREAL"}[row["ftype"]]
        row["high"] = ""
    else:
        fields.insert(rnd.randrange(first + 1, last + 1), {"field": "F%d" % number, "ftype": kind})
    write_types(folder, fields)
    return {owner, "AXIS"}  # an AXIS has a VALVE


def edit(folder, rnd, number):
    """Other edits; returns the types whose values may move: none."""
    rows = read(folder)
    kind = rnd.choice(["insert", "delete", "shuffle", "rename", "reserve"])
    if kind == "insert":
        rows.insert(rnd.randrange(len(rows)), {"symbol": "E%d" % number, "type": rnd.choice(
            ["REAL", "BOOL", "VALVE", "INT"]), "pv": "E%d:" % number, "dir": rnd.choice(["in", "out"])})
    elif kind == "delete":
        del rows[rnd.randrange(len(rows))]
    elif kind == "shuffle":
        rnd.shuffle(rows)
    elif kind == "rename":
        rnd.choice([r for r in rows if r["dir"] != "reserved"])["pv"] = "R%d:" % number
    else:
        rnd.choice([r for r in rows if r["type"] == "BOOL"]).update(dir="reserved", pv="", states="")
    write(folder, rows)
    return set()


@pytest.mark.parametrize("name", KEYS)
def test_only_users_move(tmp_path, name):
    """{name}: in random edits with types that grow only values of such types move"""
    for seed in range(3):
        rnd = random.Random(seed)
        folder = plant(tmp_path / str(seed), seed, KEYS[name])
        moved = grew = 0
        for number in range(EDITS):
            before = leaves(folder)
            step = rnd.choice([grow, edit, edit])
            changed = step(folder, rnd, number)
            result = plcmap("place", folder, *(["--grow"] if changed else []))
            assert result.status == 0, result.err
            after = leaves(folder)
            gone = [s for s, (kind, tx, rx) in before.items()
                    if s in after and after[s][1:] != (tx, rx) and kind not in changed]
            assert gone == [], "%s %d" % (step.__name__, number)
            moved += sum(1 for s in before if s in after and after[s][1:] != before[s][1:])
            grew += bool(changed)
            assert plcmap("place", folder, "--grow").out == ""
        assert grew > 3 and moved > 20


def test_grown_inside(tmp_path):
    """A type inside another one grows: check names the way out, place --grow goes it"""
    rows = [{"symbol": "Axis%d" % n, "plc": "Axis%d" % n, "type": "AXIS", "pv": "A%d:" % n} for n in range(2)]
    rows.append({"symbol": "N", "type": "INT", "pv": "N", "plc": "N"})
    folder = maps.write(tmp_path / "m", rows, {"sync": "off", "family": "none"})
    assert plcmap("place", folder).status == 0, plcmap("place", folder).err
    fields = types_of(folder)
    fields.insert(4, {"field": "Torque", "ftype": "REAL"})
    write_types(folder, fields)
    result = plcmap("check", folder)
    assert result.status == 1
    assert "at: byte 14 of AXIS is taken by Brake; if VALVE has grown: `plcmap place --grow`" in result.err
    before = (folder / "types.csv").read_bytes()
    told = plcmap("place", folder, "--grow", "-n")
    assert told.status == 0 and (folder / "types.csv").read_bytes() == before
    result = plcmap("place", folder, "--grow")
    assert "AXIS.Name at 18, was 14: Brake has grown" in result.out, result.out
    assert told.out == result.out
    assert {r["symbol"]: r["tx"] for r in read(folder)}["N"] == "76"
    assert plcmap("check", folder).status == 0
