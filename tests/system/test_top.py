"""What make says in a tree that cannot be built."""
import os
import shutil
import subprocess

import pytest

import test_application as application
from client import ARCH, BASE, TOP


def make(directory, *targets, **more):
    env = {k: v for k, v in os.environ.items() if not k.startswith(("EPICS", "MAKE", "TOP"))}
    env.update(more)
    return subprocess.run(["make", *targets], cwd=directory, env=env, text=True,
                          capture_output=True, stdin=subprocess.DEVNULL, timeout=900)


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
    for targets in ([], ["all"], ["install"]):
        run = make(tree, *targets)
        assert run.returncode != 0
        assert "No EPICS Base" in run.stderr and "RELEASE.local" in run.stderr and "make demo" in run.stderr, run.stderr
    assert not (tree / "configure/RELEASE.local").exists()


def test_bare(tmp_path):
    """clean, distclean and help work in a bare clone"""
    tree = copy(tmp_path / "tree")
    (tree / "src/O.Common").mkdir(parents=True)
    (tree / "lib").mkdir()
    assert "make demo" in make(tree, "help").stdout
    for target, left in (("clean", True), ("distclean", False)):
        run = make(tree, target)
        assert run.returncode == 0 and not run.stderr, run.stderr
        assert (tree / "lib").exists() == left
    assert (tree / "src").exists() and not (tree / "src/O.Common").exists()


@pytest.mark.parametrize("place", ["configure/RELEASE", "configure/RELEASE.local",
                                   "../RELEASE.local", "../RELEASE.{arch}.local",
                                   "configure/RELEASE.{arch}.local", "environment"])
def test_named(tmp_path, place):
    """an EPICS Base that is named in {place} is found"""
    tree = copy(tmp_path / "tree")
    env = {"EPICS_HOST_ARCH": ARCH}
    if place == "environment":
        env["EPICS_BASE"] = str(BASE)
    else:
        with open(tree / place.format(arch=ARCH), "a") as file:
            file.write(f"EPICS_BASE = {BASE}\n")
    (tree / "Makefile").write_text((tree / "Makefile").read_text().replace(
        "DIRS += s7plcApp phoenixRedundApp plcSim tests iocBoot docs\n", ""))
    run = make(tree, "-s", **env)
    assert run.returncode == 0, run.stderr
    assert (tree / f"configure/O.{ARCH}/MODBUS").exists()
    if place == "environment":
        assert f"EPICS_BASE = {BASE}" in (tree / "configure/RELEASE.local").read_text()
    made = tree / f"configure/O.{ARCH}"
    (made / "old.d").touch()
    run = make(tree, "-s", "rebuild", **env)  # what was built before goes first
    assert run.returncode == 0, run.stderr
    assert not (made / "old.d").exists() and (made / "MODBUS").exists()


def traps(folder, **scripts):
    """PATH with programs of these names in front; each writes its words into folder/called, then does as its script says."""
    folder.mkdir()
    for name, script in scripts.items():
        (folder / name).write_text(f'#!/bin/sh\necho {name} "$@" >>{folder}/called\n{script}\n')
        (folder / name).chmod(0o755)
    return f"{folder}:{os.environ['PATH']}"


def called(folder):
    return (folder / "called").read_text().splitlines() if (folder / "called").exists() else []


@pytest.mark.parametrize("there", [False, True], ids=["missing", "there"])
def test_setup(tmp_path, there):
    """what the demonstrations call installs the Debian packages that are {id}, and takes the EPICS Base of its cache"""
    tree, cache = copy(tmp_path / "tree"), tmp_path / "cache"
    base = cache / f"epics-base-7-{os.uname().machine}-r1"
    base.mkdir(parents=True)
    (base / ".complete").touch()
    path = traps(tmp_path / "traps", **{"dpkg-query": "echo install ok installed" if there else "exit 1",
                                        "apt-get": "", "sudo": 'exec "$@"'})
    env = {k: v for k, v in os.environ.items() if k != "EPICS_BASE"}
    ended = subprocess.run([tree / "configure/setup.sh", "base"], text=True, capture_output=True, timeout=60,
                           env={**env, "PATH": path, "PLCLINK_CACHE": str(cache)})
    assert ended.returncode == 0, ended.stderr
    installed = [line for line in called(tmp_path / "traps") if line.startswith("apt-get")]
    assert installed == ([] if there else [
        "apt-get update",
        "apt-get install -y --no-install-recommends build-essential perl libmodbus-dev pkg-config"])
    assert f"EPICS_BASE = {base}\n" in (tree / "configure/RELEASE.local").read_text()


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A copy of the tree as it was built: other tests run the programs of the tree itself."""
    tree = tmp_path_factory.mktemp("top") / "tree"
    shutil.copytree(TOP, tree, symlinks=True, ignore=shutil.ignore_patterns(".git", "html", "O.site"))
    yield tree
    shutil.rmtree(tree)


def test_plain_make(tmp_path, built, no_sanitizer):
    """plain make where an EPICS Base is named builds, and asks nothing that installs or downloads"""
    names = ("apt-get", "apt", "dpkg", "dpkg-query", "sudo", "pip", "pip3", "curl", "wget", "git")
    path = traps(tmp_path / "traps", **{name: "exit 1" for name in names})
    program = built / "bin" / ARCH / "plcSim"
    program.unlink()
    run = make(built, "-s", PATH=path, PLCLINK_CACHE=str(tmp_path / "cache"))
    assert run.returncode == 0 and program.exists(), run.stderr
    assert called(tmp_path / "traps") == [] and not (tmp_path / "cache").exists()


def test_without_asyn(built):
    """a build without asyn says so in one line, with make -s and -j too"""
    for options in (["-s"], ["-s", "-j2"]):
        run = make(built, "-C", "s7plcApp", *options, "ASYN=")
        assert run.returncode == 0, run.stderr
        lines = [line for line in run.stdout.splitlines() if "left out" in line]
        assert lines == ["s7plcAsyn left out (PLCs as asyn ports): "
                         "ASYN is not set in configure/RELEASE.local"], run.stdout


def test_without_modbus(tmp_path, no_sanitizer):
    """a build without libmodbus says so in one line, and its IOC knows no Modbus; without shared libraries, too"""
    tree = tmp_path / "tree"
    shutil.copytree(TOP, tree, ignore=shutil.ignore_patterns(
        "O.*", ".git", "bin", "lib", "dbd", "db", "include", "cfg", "tests", "iocBoot", "*.pyc"))
    (tree / "configure/CONFIG_SITE.local").write_text("HAS_MODBUS = NO\nSHARED_LIBRARIES = NO\n")
    (tree / "configure/RELEASE.local").write_text(f"EPICS_BASE = {BASE}\n")
    said = ""
    for directory in ("configure", "s7plcApp", "phoenixRedundApp", "plcSim"):
        run = make(tree, "-s", "-j2", "-C", directory)
        assert run.returncode == 0, run.stderr
        said += run.stdout
    needs = subprocess.run(["ldd", *(tree / "bin" / ARCH).glob("*Ioc"), tree / "bin" / ARCH / "plcSim"],
                           text=True, stdout=subprocess.PIPE, check=True).stdout
    assert "libmodbus" not in needs
    libraries = {file.name for file in (tree / "lib" / ARCH).iterdir()}
    assert "libs7plc.a" in libraries and not [name for name in libraries if ".so" in name], libraries
    assert [line for line in said.splitlines() if "Modbus" in line] == [
        f"s7plcModbus left out for {ARCH} (PLCs over Modbus/TCP): libmodbus is not there "
        "(Debian: libmodbus-dev)"], run.stdout
    assert "modbus" not in (tree / "dbd/s7plcIoc.dbd").read_text()


def test_install_location(tmp_path, built, no_sanitizer):
    """with INSTALL_LOCATION documents and examples are there; an example and an application start"""
    there = tmp_path / "there"
    run = make(built, "-s", "-j2", f"INSTALL_LOCATION={there}")
    assert run.returncode == 0, run.stderr
    assert (there / "docs/records.md").exists() and (there / "db/s7plcStation.db").exists()
    directory = there / "iocBoot/iocS7plc"
    text = (directory / "st.cmd").read_text().replace("iocInit\n", "iocInit\ns7plcReport\nexit\n")
    (directory / "st.cmd").write_text(text)
    out = subprocess.run([there / f"bin/{ARCH}/s7plcIoc", "st.cmd"], cwd=directory, text=True,
                         stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=60,
                         env={**os.environ, "PLC_PORT": "1"}).stdout
    assert "PLC1 127.0.0.1:1" in out and "Can't open" not in out, out
    for static in (False, True):
        mine = tmp_path / f"mine{static}"
        mine.mkdir()
        application.build(mine, "s7plc.dbd", "s7plc", static, there)
        application.shell(mine)
        assert (str(there) in application.needs(mine)) is not static
