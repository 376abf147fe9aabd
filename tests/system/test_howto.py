"""The how-tos: what a reader would copy into files of his own works as it stands there."""
import re

import pytest

import test_application as application
from client import TOP
from ioc import Ioc

HOWTO = TOP / "docs/howto"


def block(page, begins):
    """The block of a how-to whose text begins so."""
    text = (HOWTO / page).read_text()
    for found in re.finditer(r"^```\w*\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        if found.group(1).startswith(begins):
            return found.group(1)
    raise AssertionError(f"{page}: no block that begins with {begins!r}")


@pytest.mark.parametrize("static", [False, True], ids=["shared", "static"])
def test_application(tmp_path, static, monkeypatch):
    """the Makefile of the how-to for applications links all wires ({id}); the release is known"""
    makefile = block("application.md", "TOP = ../..").replace("TOP = ../..", "TOP = ..")
    makefile = makefile.replace("pump", "mine") + "$(info release $(PLCLINK_VERSION))\n"
    monkeypatch.setattr(application, "MAKEFILE", re.sub(r"([{}])", r"\1\1", makefile))
    out = application.build(tmp_path, "", "", static)
    assert re.search(r"^release \d+\.\d+\.\d+$", out, re.MULTILINE), out
    out = application.shell(tmp_path, "phoenixplcConfigure P, 127.0.0.1, 2000, 8, 8, 1, 500, 100, 1\n"
                            'modbusplcConfigure M, 127.0.0.1, 502, 1, "holding 0 4"\n'
                            "drvEtherIP_define_PLC E, 127.0.0.1, 0\ns7plcReport M 1")
    assert "in:  holding 0 to 3" in out and "ERROR" not in out, out
    assert ("libs7plc.so" in application.needs(tmp_path)) is not static


def test_many(tmp_path, closing):
    """the start-up files of the how-to for many PLCs make three PLCs, each with its records"""
    (tmp_path / "plc.iocsh").write_text(block("many-plcs.md", "s7plcConfigure"))
    (tmp_path / "pump.db").write_text('record(ai, "$(P)Level") {\n    field(DTYP, "S7plc")\n'
                                      '    field(INP, "@$(PLC)/0 T=REAL32")\n}\n')
    lines = block("many-plcs.md", "callbackParallelThreads")
    (tmp_path / "st.cmd").write_text(
        f'epicsEnvSet S7PLC "{TOP}"\non error break\ndbLoadDatabase "{TOP}/dbd/s7plcIoc.dbd"\n'
        f"s7plcIoc_registerRecordDeviceDriver pdbbase\n{lines}\necho all of it was run\n")
    ioc = Ioc.of_script(tmp_path / "st.cmd", "PUMP2:", {})
    closing(ioc)
    ioc.start()
    assert "all of it was run" in ioc.log, ioc.log
    assert len(re.findall(r"^  PUMP[123] 192", ioc.command("s7plcReport"), re.MULTILINE)) == 3
    ioc.get("PLC:State")


def test_access(tmp_path, new_ioc):
    """the access rules are accepted; while the PLC is away a setpoint is not writable"""
    rules = block("access-security.md", "UAG(operators)").replace("PUMP:PLC:Alive", "$(ALIVE)")
    (tmp_path / "plant.acf").write_text(rules)
    ioc = new_ioc("s7plcConfigure PUMP, 127.0.0.1, 1, 48, 48, 1\n"
                  f'asSetFilename "{tmp_path}/plant.acf"\nasSetSubstitutions "ALIVE=none"',
                  block("access-security.md", "record(ao").replace("PUMP:", "$(P)"))
    assert "rror" not in ioc.log, ioc.log
    assert "SETPOINT" in ioc.command("asprules SETPOINT")
    assert not ioc.pv("Speed").write_access and ioc.pv("Speed").read_access


def test_ibek():
    """each command of the ibek support file is one of ours, with as many arguments as it takes"""
    text = (HOWTO / "plclink.ibek.support.yaml").read_text()
    calls = re.findall(r"^ +((?:s7|phoenix|modbus)plcConfigure) (.*)$", text, re.MULTILINE)
    assert [(name, rest.count(",") + 1) for name, rest in calls] == [
        ("s7plcConfigure", 8), ("phoenixplcConfigure", 9), ("modbusplcConfigure", 6)]
    for database in re.findall(r"\$\(S7PLC\)/(db/\S+)", text):
        assert (TOP / database).exists(), database
