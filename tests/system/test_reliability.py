"""docs/reliability.md: each test that it names is there, and is the only one of its name, or has its file with it."""
import collections
import re

from client import TOP

NAMED = re.compile(r"`((?:test_\w+\.py::)?test_\w+|\w+Test\w*)`")


def known():
    """What a test may be called: a function of pytest with its file, without where there is one of that name, a program."""
    with_file = [f"{file.name}::{name}" for file in (TOP / "tests").glob("*/test_*.py")
                 for name in re.findall(r"^def (test_\w+)\(", file.read_text(), re.M)]
    alone = collections.Counter(name.partition("::")[2] for name in with_file)
    found = set(with_file) | {name for name, count in alone.items() if count == 1}
    for line in (TOP / "tests/unit/Makefile").read_text().splitlines():
        if line.startswith("TESTS += "):
            found |= set(line.split()[2:])
    return found


def test_named_tests():
    """each test that docs/reliability.md names is there, and each of its faults names one"""
    text = (TOP / "docs/reliability.md").read_text()
    named, tests = set(NAMED.findall(text)), known()
    assert len(named) > 50
    assert not named - tests, f"no such tests, or several: {sorted(named - tests)}"
    rows = [line for line in text.split("## What was tried")[0].splitlines()
            if line.startswith("| ") and not re.match(r"\| (fault|---)", line) and not line.startswith("|---")]
    assert len(rows) > 40
    without = [row for row in rows if not NAMED.search(row)]
    assert not without, without
