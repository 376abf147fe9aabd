"""The soak itself (docs/soak.md): a short one on every transport, and lies that it must find."""
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from client import TOP
from soak.__main__ import PROGRAMS, TRANSPORTS, arguments, seconds
from waiting import until


def soak(folder, *words):
    return subprocess.run([sys.executable, "-m", "soak", "--out", str(folder), *words], cwd=TOP / "tests",
                          stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def test_short(tmp_path):
    """two episodes on each transport: nothing lost, doubled, torn, stale or wrong; a report with plots"""
    done = soak(tmp_path, "--seed", "1", "--duration", "10m", "--episodes", "2", "--transports", ",".join(TRANSPORTS))
    logs = "".join((tmp_path / f"{name}-0/log.txt").read_text()[-3000:] for name in TRANSPORTS) if done.returncode else ""
    assert done.returncode == 0, done.stdout + logs
    for name in TRANSPORTS:
        result = json.loads((tmp_path / f"{name}-0/result.json").read_text())
        assert result["ended"] and result["episodes"] == 2 and result["counts"]["values judged"] > 0, result
    page = (tmp_path / "report.html").read_text()
    assert "Nothing lost" in page and page.count("<svg") >= 5


@pytest.mark.parametrize("transport, lie, kinds", [
    ("blocks", "tear:in:96", "torn"), ("blocks", "repeat:in:96", "doubled|stale"), ("blocks", "drop:in:96", "stale"),
    ("blocks", "repeat:out:32", "doubled"), ("modbus", "tear:in:73", "torn"), ("sync", "repeat:out:28", "doubled|lost"),
])
def test_liar(tmp_path, transport, lie, kinds):
    """a wire that lies ({lie}) between {transport} and the IOC is found, with status 1, the seed and a log"""
    done = soak(tmp_path, "--seed", "3", "--duration", "5m", "--transports", transport, "--lie", lie)
    assert done.returncode == 1, done.stdout
    assert re.search(rf"episode \d+: ({kinds}): ", done.stdout), done.stdout
    assert "again: make soak SEED=3" in done.stdout
    log = (tmp_path / f"{transport}-0/log.txt").read_text()
    assert re.search(r"^ +\d+\.\d+ \S+ episode 0: .* s$", log, re.M) and "--- the IOC's log" in log and "--- plcSim" in log and "--- the last blocks: [(" in log
    assert "Nothing lost" not in (tmp_path / "report.html").read_text()


def test_killed(tmp_path):
    """a scenario that is killed makes the run red: on the console, in the status and in the report"""
    (tmp_path / "report.html").write_text("of an earlier run")
    run = subprocess.Popen([sys.executable, "-m", "soak", "--out", str(tmp_path), "--seed", "1", "--transports", "blocks"],
                           cwd=TOP / "tests", stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        until(lambda: (tmp_path / "blocks-0/result.json").exists() or run.poll() is not None, "a first result")
        assert not (tmp_path / "report.html").exists()
        for child in Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split():
            os.kill(int(child), signal.SIGKILL)
        console, _ = run.communicate()
    finally:
        run.send_signal(signal.SIGINT)  # it ends with all that it has started
        run.wait()
    assert run.returncode == 1 and re.search(r"blocks-0, episode \d+: did not end", console), console
    page = (tmp_path / "report.html").read_text()
    assert "Nothing lost" not in page and "<td>WRONG</td>" in page and "Started 20" in page


def test_defaults(monkeypatch):
    """ten minutes, one of each transport but cpppo and of the random unit tests, a seed from the clock, a folder named after it"""
    monkeypatch.setattr(sys, "argv", ["soak"])
    options = arguments()
    assert (options.duration, options.instances) == (600, 1) and options.out == TOP / f"tests/soak/O.{options.seed}"
    page = (TOP / "docs/soak.md").read_text()
    told = [name for row in re.findall(r"^\| `TRANSPORTS` .*$", page, re.M) for part in re.findall(r"`([\w,]+,[\w,]+)`", row)
            for name in part.split(",")]
    assert told == [*TRANSPORTS, *PROGRAMS] and options.transports == [name for name in told if name != "cpppo"]
    assert options.seed != arguments().seed
    assert [seconds(text) for text in ("90s", "10m", "1.5h")] == [90, 600, 5400]


def test_words(tmp_path):
    """the words of make soak reach the program: DURATION, SEED, TRANSPORTS, INSTANCES, OUT; the seed is printed"""
    done = subprocess.run([TOP / "tests/soak/run", "DURATION=2s", "SEED=42", "TRANSPORTS=blocks", "INSTANCES=2", f"OUT={tmp_path}"],
                          stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert done.returncode == 0, done.stdout
    assert f"soak: seed 42, 2 s, blocks, 2 of each; logs and report in {tmp_path}" in done.stdout
    for name in "blocks-0", "blocks-1":
        assert json.loads((tmp_path / name / "result.json").read_text())["about"]["seed"] == 42
    assert (tmp_path / "report.html").exists()
    assert re.search(r"^soak 0:00:\d\d  2 scenarios, \d+ episodes, \d+ values and \d+ setpoints judged", done.stdout, re.M)
    done = subprocess.run([TOP / "tests/soak/run", "PIGEON=1"], stdin=subprocess.DEVNULL, capture_output=True, text=True)
    assert done.returncode == 2 and "usage: make soak" in done.stderr


def test_arguments(tmp_path):
    """a wrong argument is one line that says what is allowed"""
    done = soak(tmp_path, "--transports", "pigeon")
    assert done.returncode == 2 and "allowed: blocks pair" in done.stdout
    done = soak(tmp_path, "--duration", "soon")
    assert done.returncode == 2 and "allowed: 90, 90s, 10m" in done.stdout
