"""An application of a user, outside the tree: what its Makefile must say, and what it links."""
import os
import re
import shutil
import subprocess

import pytest

from client import ARCH, BASE, TOP

pytestmark = pytest.mark.usefixtures("no_sanitizer")

MAKEFILE = """\
TOP = {top}
include $(TOP)/configure/CONFIG
{rules}
PROD_IOC = mine
DBD += mine.dbd
mine_DBD += base.dbd {dbd}
mine_SRCS += mine_registerRecordDeviceDriver.cpp mineMain.cpp
mine_LIBS += {libs}
mine_LIBS += $(EPICS_BASE_IOC_LIBS)
include $(TOP)/configure/RULES
"""

MAIN = """\
#include <iocsh.h>
int main(int argc, char *argv[]) { return argc < 2 || iocsh(argv[1]); }
"""

ST_CMD = """\
dbLoadDatabase "dbd/mine.dbd"
mine_registerRecordDeviceDriver pdbbase
s7plcConfigure PLC, 127.0.0.1, 2000, 8, 8, 1, 500, 100
{more}
s7plcReport PLC 0
"""


def build(directory, dbd, libs, static, module=TOP):
    """An application in the style of makeBaseApp, with the installed module; returns make's output."""
    (directory / "configure").mkdir()
    for name in ("CONFIG", "CONFIG_SITE", "RULES", "RULES_TOP", "RULES_DIRS", "Makefile"):
        shutil.copy(f"{BASE}/templates/makeBaseApp/top/configure/{name}", directory / "configure")
    (directory / "configure/RELEASE").write_text(f"S7PLC = {module}\nEPICS_BASE = {BASE}\n")
    (directory / "Makefile").write_text(
        "TOP = .\ninclude $(TOP)/configure/CONFIG\nDIRS += configure src\n"
        "src_DEPEND_DIRS = configure\ninclude $(TOP)/configure/RULES_TOP\n")
    (directory / "src").mkdir()
    (directory / "src/Makefile").write_text(
        MAKEFILE.format(top="..", rules="", dbd=dbd, libs=libs))
    (directory / "src/mineMain.cpp").write_text(MAIN)
    env = {k: v for k, v in os.environ.items() if not k.startswith(("MAKE", "MFLAGS", "TOP"))}
    run = subprocess.run(["make", "-s", f"STATIC_BUILD={'YES' if static else 'NO'}"],
                         cwd=directory, env=env, text=True, stdin=subprocess.DEVNULL,
                         stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=300)
    assert run.returncode == 0, run.stdout
    return run.stdout


def program(directory):
    return next((directory / "bin").glob("*/mine"))


def shell(directory, more=""):
    (directory / "st.cmd").write_text(ST_CMD.format(more=more))
    run = subprocess.run([program(directory), "st.cmd"], cwd=directory, text=True,
                         stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=60)
    assert "PLC 127.0.0.1:2000" in run.stdout, run.stdout
    return run.stdout


def needs(directory):
    return subprocess.run(["ldd", program(directory)], text=True, check=True,
                          stdout=subprocess.PIPE).stdout


@pytest.mark.skipif(not list((TOP / "lib" / ARCH).glob("libs7plc.so")), reason="built without shared libraries")
def test_needs():
    """libs7plc.so needs libraries of Base and of the system's C, and no others"""
    dynamic = subprocess.run(["readelf", "-d", TOP / "lib" / ARCH / "libs7plc.so"], capture_output=True, text=True,
                             check=True).stdout
    needed = re.findall(r"\(NEEDED\).*\[lib(\w+)\.so", dynamic)
    assert {"Com", "dbCore"} <= set(needed)
    assert not [name for name in needed if name not in ("c", "m", "pthread", "gcc_s", "rt")
                and not (BASE / "lib" / ARCH / f"lib{name}.so").exists()], needed


@pytest.mark.parametrize("static", [False, True], ids=["shared", "static"])
def test_blocks(tmp_path, static):
    """an application with s7plc alone links ({id}) without a word of Modbus"""
    out = build(tmp_path, "s7plc.dbd", "s7plc", static)
    assert "modbus" not in out.lower()
    assert "modbus" not in needs(tmp_path)
    shell(tmp_path)


@pytest.mark.parametrize("static", [False, True], ids=["shared", "static"])
def test_modbus(tmp_path, static):
    """an application with s7plcModbus links ({id}) without flags of its own"""
    build(tmp_path, "s7plc.dbd s7plcModbus.dbd", "s7plcModbus s7plc", static)
    assert "libmodbus" in needs(tmp_path)
    out = shell(tmp_path, 'modbusplcConfigure M, 127.0.0.1, 502, 1, "holding 0 4"\n'
                          "s7plcReport M 1")
    assert "in:  holding 0 to 3" in out, out
