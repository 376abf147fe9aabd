"""What the tests of plcmap share: the tool in this process, and the worked example as a map."""
import contextlib
import io
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
TOP = HERE.parents[1]
sys.path[:0] = [str(HERE), str(TOP / "s7plcApp" / "map")]

from plcmaplib.main import main  # noqa: E402


class Result:
    """Exit status and output of one call."""

    def __init__(self, status, out, err):
        self.status = status
        self.out = out
        self.err = err
        self.lines = err.splitlines()


def plcmap(*words):
    """Runs plcmap as its script does; an internal error is an exception here."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = main([str(w) for w in words])
        except SystemExit as e:  # argparse
            status = e.code
    return Result(status, out.getvalue(), err.getvalue())


@pytest.fixture(autouse=True)
def traces(monkeypatch):
    """An internal error of the tool is an error of the test, not a line."""
    monkeypatch.setenv("PLCMAP_TRACE", "1")


@pytest.fixture
def tank(tmp_path):
    """The worked example: a folder of its own."""
    import tank as example
    return example.write(tmp_path / "tank")


def pytest_collection_modifyitems(items):
    """The first line of a test's docstring is its name in the report. {x} is a parameter."""
    for item in items:
        sentence = (item.obj.__doc__ or item.name).strip().splitlines()[0].rstrip(".")
        if hasattr(item, "callspec"):
            sentence = sentence.format_map({**item.callspec.params, "id": item.callspec.id})
        item._nodeid = f"{item.nodeid.split('::')[0]}::{sentence}"
