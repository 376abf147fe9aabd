"""One release, one place: configure/CONFIG_PLCLINK_VERSION; everything that names it agrees."""
import re
import subprocess

import pytest

from client import ARCH, TOP

LIBRARIES = sorted((TOP / "lib" / ARCH).glob("lib*.so"))


def released():
    numbers = re.findall(r"^PLCLINK_\w+_VERSION = (\d+)$",
                         (TOP / "configure/CONFIG_PLCLINK_VERSION").read_text(), re.MULTILINE)
    assert len(numbers) == 3
    return ".".join(numbers)


@pytest.mark.parametrize("program", ["plcSim", "plcmap"])
def test_program(program):
    """{program} --version prints it"""
    run = subprocess.run([TOP / "bin" / ARCH / program, "--version"], capture_output=True,
                         text=True, check=True, timeout=60)
    assert run.stdout.split()[-1] == released()


@pytest.mark.skipif(not LIBRARIES, reason="built without shared libraries")
def test_soname():
    """major and minor number are the SONAME of each library: a new minor release is linked anew"""
    wanted = released().rpartition(".")[0]
    for library in LIBRARIES:
        dynamic = subprocess.run(["readelf", "-d", library], capture_output=True, text=True,
                                 check=True).stdout
        assert f"[{library.name}.{wanted}]" in dynamic


def test_ioc(new_ioc):
    """the IOC says it when it starts, in s7plcReport and in dbior"""
    ioc = new_ioc("s7plcConfigure PLC, 127.0.0.1, 1, 8, 8", "")
    assert f"s7plc: plclink {released()}" in ioc.log
    for command in ("s7plcReport", "dbior s7plc 0"):
        assert f"plclink {released()}" in ioc.command(command), command


def test_release_notes():
    """the release notes begin with it"""
    notes = (TOP / "docs/release-notes.md").read_text()
    assert re.search(r"^## (\S+)", notes, re.MULTILINE).group(1) == released()
