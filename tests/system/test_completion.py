"""The TAB key in the IOC's shell, on a terminal."""
import os
import re
import subprocess

import pytest

from client import ARCH, TOP, epics_base
from terminal import Terminal


def has_completion():
    """Base that asks what completes a word, with readline"""
    base = epics_base()
    if "iocshArgStringPath" not in (base / "include/iocsh.h").read_text():
        return False
    com = next((base / "lib" / ARCH).glob("libCom.so"), None)
    return com and "readline" in subprocess.run(["ldd", com], capture_output=True, text=True).stdout


@pytest.mark.skipif(not has_completion(), reason="EPICS Base completes nothing: older, or without readline")
def test_tab(tmp_path):
    """TAB behind the beginning of a PLC's name completes it, behind each command that iocsh.md names"""
    said = re.search(r"the TAB key completes the PLC's name behind\s(.*?)\.\s", (TOP / "docs/iocsh.md").read_text(), re.DOTALL)
    commands = re.findall(r"`(\w+)`", said[1])
    assert len(commands) > 8
    (tmp_path / "st.cmd").write_text(
        f'dbLoadDatabase("{TOP}/dbd/s7plcIoc.dbd")\ns7plcIoc_registerRecordDeviceDriver(pdbbase)\n'
        's7plcConfigure("PRESSURE", "", 0, 4, 4, 1, 2000, 100)\ns7plcConfigure("FLOW", "", 0, 4, 4, 1, 2000, 100)\n'
        "iocInit\n")
    with Terminal([TOP / "bin" / ARCH / "s7plcIoc", tmp_path / "st.cmd"], {**os.environ, "TERM": "dumb"}) as ioc:
        ioc.wait("All initialization complete")
        ioc.wait("epics> $")
        for command in commands:
            ioc.type(f"{command} PRE\t")
            ioc.wait(f"{command} PRESSURE")
            ioc.type("\x15")  # the line is thrown away
        ioc.type("exit\n")
        assert ioc.status() == 0
