"""docs/tutorial.md: its files are taken out of it, and what it promises happens."""
import os
import re
import subprocess
import xml.etree.ElementTree as xml

import pytest

from client import TOP
from docblocks import blocks
from ioc import SINCE_7_0_6, Ioc, errors_in
from waiting import until, until_equal

TEXT = (TOP / "docs/tutorial.md").read_text()


def file(name):
    """The block behind `name`:"""
    found = re.search(rf"`{re.escape(name)}`[^`]*?:\n\n```\w*\n(.*?)^```", TEXT,
                      re.DOTALL | re.MULTILINE)
    assert found, f"no block for {name}"
    return found.group(1)


@pytest.fixture
def pump(tmp_path, new_sim, closing):
    """pump.sim is the PLC; pump() starts the IOC, in a folder beside dbd and db."""
    for name in ("dbd", "db"):
        (tmp_path / name).symlink_to(TOP / name)
    folder = tmp_path / "pump"
    folder.mkdir()
    sim = new_sim(file("pump.plc"))
    (folder / "pump.db").write_text(file("pump.db"))
    st_cmd = file("st.cmd")
    assert "127.0.0.1, 2000," in st_cmd
    (folder / "st.cmd").write_text(st_cmd.replace("2000,", f"{sim.port},"))

    def start():
        ioc = Ioc.of_script(folder / "st.cmd", "PUMP:", {})
        closing(ioc)
        ioc.start()
        ioc.wait_value("PLC:State", 3)
        return ioc
    start.sim, start.folder = sim, folder
    return start


def test_values(pump):
    """the tutorial's values move, its puts reach the PLC, and nothing is complained about"""
    ioc = pump()
    ioc.wait_value("Level.SEVR", 0)
    assert 1.99 < ioc.get("Level") < 3.01
    ioc.put("Speed", 1450)
    ioc.put("Run", 1)
    ioc.wait_value("Run.SEVR", 0)
    assert "Speed" in ioc.command("s7plcShow PUMP out")
    came_back = re.compile(r"^ +32 +44 b5 40 00 ", re.M | re.I)  # 1450 as REAL32
    until(lambda: came_back.search(ioc.command("s7plcShow PUMP in")), lambda: ioc.command("s7plcShow PUMP in"))
    assert not errors_in(ioc.log) and "arning" not in ioc.log, ioc.log


def test_silence(pump):
    """the tutorial's silence is told in AMSG in its words, and ends as it says"""
    ioc = pump()
    for command in ("silence", "normal"):
        assert f"plc.sock {command}" in TEXT
    ioc.wait_value("Level.SEVR", 0)
    pump.sim.command("silence")
    ioc.wait_value("Level.SEVR", 3)
    until_equal(lambda: ioc.message("Level"), "no block for 0.5 s")
    assert "`no block for 0.5 s`" in TEXT
    pump.sim.command("normal")
    ioc.wait_value("Level.SEVR", 0)


def test_restart(pump):
    """after a restart of the tutorial's IOC the pump runs on, and Speed is what the PLC holds"""
    ioc = pump()
    ioc.wait_value("Speed.SEVR", 0)
    ioc.put("Speed", 1450)
    ioc.put("Run", 1)
    ioc.command("s7plcSend PUMP")
    assert ioc.exit() == 0
    assert pump.sim.command("get out 4.0").endswith("= 1")
    ioc = pump()
    ioc.wait_value("Speed", 1450)
    ioc.wait_value("Run", 1)
    assert pump.sim.command("get out 4.0").endswith("= 1")


def test_display(pump):
    """each PV of the tutorial's display has its record"""
    ioc = pump()
    names = [pv.text for pv in xml.fromstring(file("pump.bob")).iter("pv_name")]
    assert len(names) == 5
    for name in names:
        ioc.get(name.replace("$(P)", ""))


def block(page, begins):
    return next(b.text for b in blocks() if b.page == page and b.first.startswith(begins))


def test_shell(pump, tmp_path):
    """what the tutorial types into its third terminal works there, and a line of troubleshooting.md"""
    ioc = pump()
    ioc.wait_value("Speed.SEVR", 0)
    for name in ("bin", "configure"):
        (tmp_path / name).symlink_to(TOP / name)
    (pump.folder / "plc.sock").symlink_to(pump.sim.path)
    terminal = block("tutorial.md", "base=")
    assert "cd pump" in block("tutorial.md", "mkdir pump")

    def typed(text):
        # the tests have addresses of their own, where the tutorial has those of its terminal
        lines = [line for line in terminal.splitlines() if "EPICS_CA_ADDR_LIST" not in line]
        ended = subprocess.run(["bash", "-ec", "\n".join(lines) + "\n" + text], cwd=pump.folder, env=os.environ,
                               capture_output=True, text=True, timeout=60)
        assert ended.returncode == 0, ended.stdout + ended.stderr
        return ended.stdout

    printed = typed(block("tutorial.md", "caput PUMP:Speed"))
    assert re.search(r"^PUMP:Speed +1450$", printed, re.MULTILINE), printed
    typed("command -v s7plcIoc plcSim")
    typed(block("tutorial.md", "plcSim --connect plc.sock silence").splitlines()[0])
    ioc.wait_value("Level.SEVR", 3)
    line = block("troubleshooting.md", "caget PUMP:Level.SEVR")
    printed = typed(line if SINCE_7_0_6 else line.replace(" PUMP:Level.AMSG", ""))
    assert "INVALID" in printed and "COMM" in printed, printed
    assert "no block for 0.5 s" in printed or not SINCE_7_0_6, printed
    typed("plcSim --connect plc.sock normal")
    ioc.wait_value("Level.SEVR", 0)
