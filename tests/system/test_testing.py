"""docs/testing.md: what it says of the programs that run the tests, from these programs."""
import importlib.machinery
import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import conftest
import pytest
import test_promises

from client import ARCH, TOP

PAGE = (TOP / "docs/testing.md").read_text()
CHECK, RUN = (TOP / name for name in ("tests/check/run", "tests/run"))


def test_steps():
    """the steps of make check-all are those of the page, each with the flags that it names; another one is refused"""
    steps = re.search(r'^steps="(.+)"$', CHECK.read_text(), re.M)[1].split()
    rows = re.findall(r"^\| (`[^|]*`) \|", PAGE.split("## make check-all")[1], re.M)
    assert sorted(steps) == sorted(name for row in rows for name in re.findall(r"`([\w-]+)`", row))
    ended = subprocess.run([CHECK, "pigeon"], capture_output=True, text=True, timeout=60)
    assert ended.returncode == 2 and " ".join(steps) in ended.stderr
    warnings = (TOP / "configure/CONFIG_SITE").read_text() + "".join(
        file.read_text() for file in (TOP / "configure").glob("CONFIG_PLCLINK*"))
    assert all(flag in warnings for flag in ("-Wall", "-Wextra", "-Werror"))
    assert "history_size=4" in CHECK.read_text() and 'deadlocks=0\n    [ "$1" != unit-tsan ] || deadlocks=1' in CHECK.read_text()
    assert "-std=c99" in (TOP / "tests/check/c99").read_text() and "-pedantic" in (TOP / "tests/check/c99").read_text()


@pytest.mark.parametrize("failing", ["", "two"])
def test_check_goes_on(tmp_path, failing):
    """a step of make check-all that fails leaves its log and the others go on; status 1; when all is well nothing is left"""
    text = CHECK.read_text()
    loop = text[text.index("failed=\nfor step"):]
    work = tmp_path / "work"
    work.mkdir()
    script = (f"steps='one two three'\nwork={work}\nstep() {{ echo ran $1; echo $1 >>{tmp_path}/ran; [ $1 != '{failing}' ]; }}\n{loop}")
    ended = subprocess.run(["sh", "-c", script], capture_output=True, text=True, timeout=60)
    lines = ended.stdout.splitlines()
    assert (tmp_path / "ran").read_text().split() == ["one", "two", "three"]
    assert [line.split()[0] for line in lines[:3]] == ["one", "two", "three"] and lines[0].split()[-1] == "ok"
    assert ended.returncode == (1 if failing else 0) and work.exists() == bool(failing)
    if failing:
        assert "FAILED" in lines[1] and (work / "two.log").read_text() == "ran two\n" and lines[2].split()[-1] == "ok"
        assert lines[-1] == "failed: two"


@pytest.mark.parametrize("said", ["", "race"])
def test_said(tmp_path, said):
    """a step fails, too, when its tests pass and a program has said something of a sanitizer"""
    text = CHECK.read_text()
    tests = "tests() {" + text.split("\ntests() {")[1].split("\nstep() {")[0]
    script = (f"work={tmp_path}\ncopy() {{ :; }}\nsanitized() {{ [ -z '{said}' ] || echo '{said}' >$work/$1.said.12; }}\n{tests}\n"
              "tests unit-asan; echo status $?")
    shown = subprocess.run(["sh", "-c", script], capture_output=True, text=True, timeout=60).stdout
    assert shown.splitlines()[-1] == f"status {1 if said else 0}" and said in shown


@pytest.mark.parametrize("options", ["", "-k modbus"])
def test_check_system(tmp_path, options):
    """CHECK_SYSTEM="{options}": these options of pytest go to the system tests of make check-all"""
    tests = "tests() {" + CHECK.read_text().split("\ntests() {")[1].split("\nstep() {")[0]
    (tmp_path / "configure").mkdir()
    script = f'work={tmp_path}\ncopy() {{ :; }}\nsanitized() {{ echo "ran $*"; }}\n{tests}\ntests system-tsan\ntests unit-tsan'
    shown = subprocess.run(["sh", "-c", script], cwd=tmp_path, env={**os.environ, "CHECK_SYSTEM": options}, capture_output=True,
                           text=True, timeout=60).stdout
    assert shown.splitlines() == [f"ran system-tsan tests/run system {options}".rstrip(), "ran unit-tsan tests/run unit"]


@pytest.mark.parametrize("target, status", [("Link", True), ("Range", False)])
def test_fuzz(tmp_path, monkeypatch, capsys, target, status):
    """make fuzz: each target runs for so many minutes; what it finds is kept, and told with the command that repeats it: {target}"""
    shown = subprocess.run(["make", "-n", "-C", TOP, "fuzz", "MINUTES=5"], capture_output=True, text=True, timeout=60).stdout
    assert "tests/fuzz/run -m 5\n" in shown
    loader = importlib.machinery.SourceFileLoader("fuzz", str(TOP / "tests/fuzz/run"))
    fuzz = importlib.util.module_from_spec(importlib.util.spec_from_loader(loader.name, loader))
    loader.exec_module(fuzz)
    (tmp_path / "bin").mkdir()
    program = tmp_path / "bin" / target
    program.write_text('#!/bin/sh\necho "$@" >&2\n' + ("" if not status else
                       f'echo "ERROR: it fell" >&2\ntouch {tmp_path}/findings/{target}-crash-1\nexit 77\n'))
    program.chmod(0o755)
    monkeypatch.setattr(fuzz, "FINDINGS", tmp_path / "findings")
    monkeypatch.setattr(fuzz, "targets", lambda: [target, "Other"])
    monkeypatch.setattr(fuzz, "build", lambda out, jobs: None)
    monkeypatch.setattr(sys, "argv", ["run", "-m", "5", "-j", "1", "-o", str(tmp_path), target])
    assert fuzz.main() == status
    assert "-max_total_time=300" in (tmp_path / f"{target}.log").read_text()
    table = capsys.readouterr().out.split("\ntarget ")[1]
    found = tmp_path / "findings" / f"{target}-crash-1"
    assert (f"again: {program} {found}" in table and "ERROR: it fell" in table) == found.exists() == status


@pytest.mark.parametrize("program", ["blockStressTest", "pairStressTest", "syncStressTest"])
def test_random(program):
    """architecture.md: {program} plays so many episodes, or for a time, from a seed, which it prints"""
    path = next((TOP / "tests/unit").glob(f"O.{ARCH}/{program}"))
    for words, env, wanted in ((["2", "42"], {}, "# 2 episodes, seed 42"), ([], {"PLCLINK_EPISODES": "1"}, "# 1 episodes, seed "),
                               (["1s", "7"], {}, "seed 7")):
        ended = subprocess.run([path, *words], cwd=path.parent, env={**os.environ, **env}, capture_output=True, text=True, timeout=300)
        assert ended.returncode == 0 and any(wanted in line for line in ended.stdout.splitlines()), ended.stdout[-2000:]


def test_run():
    """tests/run takes unit, map and system, and three system tests run side by side unless it is told otherwise"""
    ended = subprocess.run([RUN, "pigeon"], capture_output=True, text=True, timeout=60)
    assert ended.returncode == 2 and "unit | map" in ended.stderr
    line = re.search(r"^workers=.*$", RUN.read_text(), re.M)[0]
    for told, workers in (None, "3"), ("1", "1"):
        env = {**os.environ, "PLCLINK_TEST_WORKERS": told} if told else \
            {k: v for k, v in os.environ.items() if k != "PLCLINK_TEST_WORKERS"}
        assert subprocess.run(["sh", "-c", f"{line}; echo $workers"], env=env, capture_output=True, text=True).stdout == workers + "\n"
    assert RUN.read_text().count('-n "$workers" "$@"') == 2


def test_limit():
    """PLCLINK_TEST_LIMIT=300 lets 300 s for what is waited for"""
    for told, limit in ("300", 300.0), ("", 60.0):
        env = {k: v for k, v in os.environ.items() if k != "PLCLINK_TEST_LIMIT"}
        env.update({"PLCLINK_TEST_LIMIT": told} if told else {})
        shown = subprocess.run([sys.executable, "-c", "import waiting; print(waiting.LIMIT)"], cwd=Path(__file__).parent,
                               env=env, capture_output=True, text=True, check=True).stdout
        assert float(shown) == limit


def test_all(monkeypatch):
    """PLCLINK_ALL=1: the runs against the SCL that are left out every day are run too"""
    item = SimpleNamespace(module=SimpleNamespace(SCL_ALWAYS=("test_put",)), callspec=SimpleNamespace(id="SCL-x"),
                           originalname="test_other")
    monkeypatch.delenv("PLCLINK_ALL", raising=False)
    assert conftest.left_out(item)
    monkeypatch.setenv("PLCLINK_ALL", "1")
    assert not conftest.left_out(item)


@pytest.mark.parametrize("old, new, fails", [
    ("| No record ever waits for the network |", "| No record never waits for the network |", test_promises.test_quoted),
    ("`test_scale.py::test_black_hole`", "`test_scale.py::test_white_hole`", test_promises.test_tests),
    ("`recordTestTypes`", "`recordTestTypos`", test_promises.test_tests)], ids=["a sentence", "a test", "a program"])
def test_of_promises(tmp_path, monkeypatch, old, new, fails):
    """test_promises.py fails where a quoted sentence has been changed, or a test is gone: {id}"""
    text = test_promises.PAGE.read_text()
    assert old in text
    page = SimpleNamespace(read_text=lambda: text.replace(old, new, 1), parent=test_promises.PAGE.parent)
    fails()
    monkeypatch.setattr(test_promises, "PAGE", page)
    with pytest.raises(AssertionError, match=new.split("|")[-2].strip() if "|" in new else new.strip("`")):
        fails()
