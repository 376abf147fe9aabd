"""What make says in a tree that cannot be built."""
import os
import shutil
import subprocess

from client import TOP


def make(directory, *targets):
    env = {k: v for k, v in os.environ.items() if not k.startswith(("EPICS", "MAKE", "TOP"))}
    return subprocess.run(["make", *targets], cwd=directory, env=env, text=True,
                          capture_output=True, stdin=subprocess.DEVNULL, timeout=60)


def copy(directory):
    directory.mkdir()
    shutil.copy(TOP / "Makefile", directory)
    shutil.copytree(TOP / "configure", directory / "configure",
                    ignore=shutil.ignore_patterns("O.*", "*.local"))
    return directory


def test_blank(tmp_path):
    """make in a path with a blank says in one line that EPICS cannot do that"""
    for target in ("all", "demo", "test"):
        run = make(copy(tmp_path / f"my tree {target}"), target)
        assert run.returncode != 0
        assert "blank" in run.stderr and len(run.stderr.splitlines()) == 1, run.stderr


def test_no_base(tmp_path):
    """plain make without an EPICS Base says what to do, and installs nothing"""
    tree = copy(tmp_path / "tree")
    for targets in ([], ["all"], ["clean"]):
        run = make(tree, *targets)
        assert run.returncode != 0
        assert "RELEASE.local" in run.stderr and "make demo" in run.stderr, run.stderr
    assert not (tree / "configure/RELEASE.local").exists()


def test_without_asyn():
    """a build without asyn says so in one line, with make -s and -j too"""
    for options in (["-s"], ["-s", "-j2"]):
        run = make(TOP, "-C", "s7plcApp", *options, "ASYN=")
        assert run.returncode == 0, run.stderr
        lines = [line for line in run.stdout.splitlines() if "left out" in line]
        assert lines == ["s7plcAsyn left out (PLCs as asyn ports): "
                         "ASYN is not set in configure/RELEASE.local"], run.stdout
