"""The soak itself (docs/soak.md): a short one on every transport, and lies that it must find."""
import json
import re
import subprocess
import sys

import pytest

from client import TOP
from soak.__main__ import TRANSPORTS


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
    assert "IOC's log" in (tmp_path / f"{transport}-0/log.txt").read_text()
    assert "Nothing lost" not in (tmp_path / "report.html").read_text()


def test_arguments(tmp_path):
    """a wrong argument is one line that says what is allowed"""
    done = soak(tmp_path, "--transports", "pigeon")
    assert done.returncode == 2 and "allowed: blocks pair" in done.stdout
    done = soak(tmp_path, "--duration", "soon")
    assert done.returncode == 2 and "allowed: 90, 90s, 10m" in done.stdout
