"""Mutilated copies of maps and exports: refused or read, never with an internal error. For a longer
run the number, PLCMAP_MUTANTS=20000, and which ones, PLCMAP_SEED=7 (make fuzz does that)."""
import os
import random

import pytest

import forms
import maps
import tank as example
from conftest import plcmap

COUNT = int(os.environ.get("PLCMAP_MUTANTS", "1000"))
SEED = 1000 * int(os.environ.get("PLCMAP_SEED", "0"))
PIECES = [b'"', b"'", b";", b",", b"\n", b"<", b">", b"[", b"]", b"99999999999", b"-1", b"\0", b"\xff\xfe",
          b"STRUCT", b"END_STRUCT;", b"ARRAY [1..99999] OF ", b"{", b"(*", b"//", b"$", b"&amp;", b"\r",
          b"\t", b"..", b"@", b"|", b"=", b"!", b"NaN", b"inf", b"1e999", b"\xe2\x80\xae", b"VALVE", b"%"]


def mutilated(data, rnd):
    data = bytearray(data)
    for _ in range(rnd.choice([1, 1, 3, 10, 40])):
        kind, at = rnd.randrange(6), rnd.randrange(len(data) + 1)
        if kind == 0 and data:
            data[at % len(data)] = rnd.randrange(256)
        elif kind == 1:
            del data[at:at + rnd.choice([1, 5, 100, 2000])]
        elif kind == 2:
            data[at:at] = data[rnd.randrange(len(data) + 1):][:rnd.choice([1, 20, 300])]
        elif kind == 3:
            data[at:at] = rnd.choice(PIECES)
        elif kind == 4 and rnd.random() < 0.2:
            del data[at:]
        elif kind == 5:
            old, new = rnd.choice([(b"\n", b"\r\n"), (b" ", b"\t"), (b"0", b""), (b"BOOL", b"REEL"),
                                   (b"1", b"\xc3\xbc"), (b",", b";")])
            data = bytearray(bytes(data).replace(old, new, rnd.choice([1, 5, -1])))
    return bytes(data)


@pytest.mark.parametrize("part", range(4))
def test_exports(tmp_path, part):
    """exports, part {part}"""
    rnd = random.Random(SEED + 100 + part)
    originals = list(forms.FORMS.values()) + list(forms.OTHERS.values())
    statuses = set()
    for _ in range(COUNT // 8):
        (tmp_path / "x").write_bytes(mutilated(rnd.choice(originals), rnd))
        statuses.add(plcmap("import", tmp_path / "x", *rnd.choice(
            [(), ("--types",), ("--into", tmp_path / ("m%d" % rnd.randrange(5)))])).status)
    assert statuses <= {0, 1} and len(statuses) == 2


@pytest.mark.parametrize("part", range(4))
def test_maps(tmp_path, part):
    """maps, part {part}: check, place, show, diff, generate"""
    rnd = random.Random(SEED + 200 + part)
    folder = example.write(tmp_path / "a")
    big = maps.write(tmp_path / "b", maps.rows(40, part))
    plcmap("place", big)
    originals = [{f.name: f.read_bytes() for f in g.glob("*.csv")} for g in (folder, big)]
    statuses = set()
    for number in range(COUNT // 8):
        files = dict(rnd.choice(originals))
        name = rnd.choice(sorted(files))
        files[name] = mutilated(files[name], rnd)
        copy = tmp_path / "m"
        copy.mkdir(exist_ok=True)
        for file, data in files.items():
            (copy / file).write_bytes(data)
        commands = [("check", copy), ("place", "-n", copy), ("show", copy), ("diff", folder, copy),
                    ("generate", copy, "-o", tmp_path / "g")]
        for words in commands[:1] + [commands[1 + number % 4]]:
            statuses.add(plcmap(*words).status)
    assert statuses <= {0, 1} and len(statuses) == 2


def test_workbooks(tmp_path):
    """workbooks: refused or read"""
    pytest.importorskip("openpyxl")
    folder = example.write(tmp_path / "a")
    plcmap("convert", folder, tmp_path / "a.xlsx")
    data = (tmp_path / "a.xlsx").read_bytes()
    rnd = random.Random(SEED + 3)
    for _ in range(max(20, COUNT // 50)):
        (tmp_path / "b.xlsx").write_bytes(mutilated(data, rnd))
        assert plcmap("check", tmp_path / "b.xlsx").status in (0, 1)
        assert plcmap("import", tmp_path / "b.xlsx").status in (0, 1)
