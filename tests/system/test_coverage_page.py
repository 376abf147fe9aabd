"""docs/coverage.md: its guard of the pure parts, its lists, and the names in its table."""
import importlib.machinery
import importlib.util
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from test_promises import unit_programs

from client import TOP

PAGE = (TOP / "docs/coverage.md").read_text()


def load(name):
    loader = importlib.machinery.SourceFileLoader(f"coverage_{name}", str(TOP / "tests/coverage" / name))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(loader.name, loader))
    loader.exec_module(module)
    return module


@pytest.mark.parametrize("missed, faults", [((), 0), ((2,), 1), ((3,), 0)], ids=["all lines run", "one not", "one that is argued"])
def test_guard(tmp_path, monkeypatch, missed, faults):
    """make coverage: a line of a pure part that no unit test runs is a fault, unless it is argued ({id})"""
    run = load("run")
    (tmp_path / "a.c").write_text("one;\ntwo;\nabort();\n")
    monkeypatch.setattr(run, "pure", lambda: ["a.c"])
    monkeypatch.setattr(run, "argued", lambda: [("a.c", "abort();")] if 3 in missed else [])
    found = run.guard({"a.c": (3, 3 - len(missed), 0, 0, list(missed))}, tmp_path)
    assert len(found) == faults and (not faults or "a.c:2: no unit test runs: two;" in found[0])
    assert re.search(r"return 1 if status or faults else 0", Path(run.__file__).read_text())


def test_lists():
    """the pure parts are files that are there; each argued line stands in its file; four places have ended memory or room"""
    run = load("run")
    assert len(run.pure()) > 30 and all((TOP / file).is_file() for file in run.pure())
    for file, text in run.argued():
        assert text in (line.strip() for line in (TOP / file).read_text().splitlines()), (file, text)
    starts = [text for _, text in run.argued() if text.startswith("cantProceed(")]
    assert len(starts) == 4 and "four places where memory, or the room for options, has ended" in " ".join(PAGE.split())


def test_survivors():
    """each mutant in the list of survivors has a reason above it, and changes a line that is there"""
    reason = False
    for line in (TOP / "tests/coverage/survivors").read_text().splitlines():
        if line.startswith("#"):
            reason = True
        elif not line.strip():
            reason = False
        else:
            file, _, change = line.partition(": ")
            assert reason and change.split("  ==>")[0].strip() in (TOP / file).read_text(), line


@pytest.mark.parametrize("survives, listed, status", [(True, False, 1), (True, True, 0), (False, False, 0)],
                         ids=["one that survives", "one that is listed", "one that is found"])
def test_status(monkeypatch, capsys, survives, listed, status):
    """make mutants: what survives is printed by file, line and change; status 1 when it is not in the list ({id})"""
    mutate = load("mutate")
    file = TOP / "s7plcApp/src/value/plcCodec.c"
    mutant = ("plcCodec", file, 0, "changed;")
    for name, value in {"Build": lambda jobs: SimpleNamespace(tests_of=lambda part: ["codecTest"]), "sources": lambda: {"plcCodec": file},
                        "original": lambda build, file: None, "check_tests": lambda build, tests: None,
                        "mutants": lambda part, file: [mutant], "judge": lambda build, mutant, originals: survives,
                        "explained": lambda: {mutate.change(mutant)} if listed else set()}.items():
        monkeypatch.setattr(mutate, name, value)
    monkeypatch.setattr(sys, "argv", ["mutate", "--seed", "7", "--count", "1"])
    assert mutate.main() == status
    shown = capsys.readouterr().out
    assert shown.startswith("seed 7: ") and ("line 1, s7plcApp/src/value/plcCodec.c: " in shown and "==>  changed;" in shown) == survives


def test_table():
    """each file in the table of what unit tests run less is there, and so is each test that it names"""
    rows = re.findall(r"^\| (.*) \| (?:\d.*%) \| (.*) \|$", PAGE.split("nine in ten of a file")[1].split("## Mutants")[0], re.M)
    assert len(rows) > 12
    pytests = {file.name for file in (TOP / "tests").glob("*/test_*.py")}
    for files, why in rows:
        for name in re.findall(r"`([\w*]+\.(?:c|cpp))`", files):
            assert list(TOP.glob(f"s7plcApp/**/{name}")) + list(TOP.glob(f"phoenixRedundApp/src/{name}")) + \
                list(TOP.glob(f"plcSim/**/{name}")), name
        for name in re.findall(r"`(test_[\w*]+\.py)`", why):
            assert any(Path(have).match(name) for have in pytests), name
        assert all(name in unit_programs() for name in re.findall(r"`(\w+Test)`", why)), why
