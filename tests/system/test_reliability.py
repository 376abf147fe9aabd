"""docs/reliability.md: each test that it names is there."""
import re

from client import TOP

NAMED = re.compile(r"`((?:test_\w+)|(?:\w+Test\w*))`")


def known():
    """Names of the functions of pytest, and of the programs of tests/unit."""
    found = set()
    for file in (TOP / "tests").glob("*/test_*.py"):
        found |= set(re.findall(r"^def (test_\w+)\(", file.read_text(), re.M))
    for line in (TOP / "tests/unit/Makefile").read_text().splitlines():
        if line.startswith("TESTS += "):
            found |= set(line.split()[2:])
    return found


def test_named_tests():
    """each test that docs/reliability.md names is there, and each of its faults names one"""
    text = (TOP / "docs/reliability.md").read_text()
    named, tests = set(NAMED.findall(text)), known()
    assert len(named) > 50
    assert not named - tests, f"no such tests: {sorted(named - tests)}"
    rows = [line for line in text.split("## What was tried")[0].splitlines()
            if line.startswith("| ") and not re.match(r"\| (fault|---)", line) and not line.startswith("|---")]
    assert len(rows) > 40
    without = [row for row in rows if not NAMED.search(row)]
    assert not without, without
