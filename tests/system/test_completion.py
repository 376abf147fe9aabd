"""The TAB key in the IOC's shell, on a terminal."""
import os
import pty
import re
import subprocess

import pytest

from client import ARCH, TOP, epics_base
from waiting import until


def has_completion():
    """Base that asks what completes a word, with readline"""
    base = epics_base()
    if "iocshArgStringPath" not in (base / "include/iocsh.h").read_text():
        return False
    com = next((base / "lib" / ARCH).glob("libCom.so"), None)
    return com and "readline" in subprocess.run(["ldd", com], capture_output=True, text=True).stdout


@pytest.mark.skipif(not has_completion(), reason="EPICS Base completes nothing: older, or without readline")
def test_tab(tmp_path):
    """TAB behind the beginning of a PLC's name completes it"""
    (tmp_path / "st.cmd").write_text(
        f'dbLoadDatabase("{TOP}/dbd/s7plcIoc.dbd")\ns7plcIoc_registerRecordDeviceDriver(pdbbase)\n'
        's7plcConfigure("PRESSURE", "", 0, 4, 4, 1, 2000, 100)\ns7plcConfigure("FLOW", "", 0, 4, 4, 1, 2000, 100)\n'
        "iocInit\n")
    ours, theirs = pty.openpty()
    ioc = subprocess.Popen([TOP / "bin" / ARCH / "s7plcIoc", tmp_path / "st.cmd"], stdin=theirs, stdout=theirs,
                           stderr=theirs, env={**os.environ, "TERM": "dumb"})
    os.close(theirs)
    os.set_blocking(ours, False)
    seen = []

    def shows(text):
        try:
            seen.append(os.read(ours, 65536).decode(errors="replace"))
        except BlockingIOError:
            pass
        return re.search(text, "".join(seen))

    try:
        until(lambda: shows("All initialization complete"), lambda: "".join(seen))
        until(lambda: shows("epics> $"), lambda: "".join(seen))
        os.write(ours, b"s7plcReport PRE\t")
        until(lambda: shows("s7plcReport PRESSURE"), lambda: "".join(seen))
        os.write(ours, b"\nexit\n")
        assert ioc.wait(60) == 0
    finally:
        ioc.kill()
        os.close(ours)
