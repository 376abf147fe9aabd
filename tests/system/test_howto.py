"""The how-tos: what a reader would copy into files of his own works as it stands there."""
import getpass
import os
import re
import shlex
import socket
import subprocess
import sys

import pytest

from client import ARCH, BASE, TOP
from ioc import Ioc, errors_in
from test_tutorial import file as tutorial
from waiting import LIMIT, until

sys.path.insert(0, str(TOP / "s7plcApp/op"))
from plcdisplays import lint  # noqa: E402

HOWTO = TOP / "docs/howto"


def block(page, begins):
    """The block of a how-to whose text begins so."""
    text = (HOWTO / page).read_text()
    for found in re.finditer(r"^```\w*\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        if found.group(1).startswith(begins):
            return found.group(1)
    raise AssertionError(f"{page}: no block that begins with {begins!r}")


def run(directory, *command, **more):
    env = {k: v for k, v in os.environ.items() if not k.startswith(("MAKE", "MFLAGS", "TOP"))}
    env.setdefault("USER", "someone")  # makeBaseApp.pl asks for it
    ended = subprocess.run(command, cwd=directory, env=env, text=True, stdout=subprocess.PIPE,
                           stderr=subprocess.STDOUT, timeout=600, **more)
    assert ended.returncode == 0, ended.stdout
    return ended.stdout


def here(text):
    """With the paths of this machine in place of those of the page."""
    return text.replace("/opt/epics/modules/plclink", str(TOP)).replace("/opt/epics/base", str(BASE))


EXTRA = """phoenixplcConfigure P, 127.0.0.1, 2000, 8, 8, 1, 500, 100, 1
modbusplcConfigure M, 127.0.0.1, 502, 1, "holding 0 4"
drvEtherIP_define_PLC E, 127.0.0.1, 0
iocInit
s7plcReport M 1
"""


@pytest.mark.usefixtures("no_sanitizer")
@pytest.mark.parametrize("static", [False, True], ids=["shared", "static"])
def test_application(tmp_path, static):
    """an application made as the how-to says has all wires, the records and the release ({id})"""
    page = "application.md"
    run(tmp_path, "bash", "-ec", here(block(page, "export PATH")), stdin=subprocess.DEVNULL)
    (tmp_path / "configure/RELEASE").write_text(here(block(page, "S7PLC =")))
    if static:
        (tmp_path / "configure/CONFIG_SITE.local").write_text("STATIC_BUILD = YES\n")
    (tmp_path / "pumpApp/src/Makefile").write_text(
        block(page, "TOP = ../..") + "$(info release $(PLCLINK_VERSION))\n")
    (tmp_path / "pumpApp/Db/pump.db").write_text(tutorial("pump.db"))
    makefile = tmp_path / "pumpApp/Db/Makefile"
    makefile.write_text(makefile.read_text().replace(
        "include $(TOP)/configure/RULES", "DB += pump.db\ninclude $(TOP)/configure/RULES"))
    assert re.search(r"^release \d+\.\d+\.\d+$", run(tmp_path, "make", "-s", stdin=subprocess.DEVNULL),
                     re.MULTILINE)

    st_cmd = block(page, "< envPaths").replace("192.168.0.10, 2000", "127.0.0.1, 1")
    folder = tmp_path / "iocBoot/iocpump"
    (folder / "st.cmd").write_text(st_cmd.replace("iocInit\n", EXTRA))
    out = run(folder, f"../../bin/{ARCH}/pump", "st.cmd", input="dbl\nexit\n")
    assert "in:  holding 0 to 3" in out and "ERROR" not in out, out
    assert "PUMP:Level" in out and "PUMP:PLC:State" in out, out
    program = run(tmp_path, "ldd", f"bin/{ARCH}/pump")
    assert ("libs7plc.so" in program) is ("libCom.so" in program) is not static
    assert "libmodbus.so" in program and "libc.so" in program


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


@pytest.mark.parametrize("gate", ["Alive", "Sync:Remote"])
def test_access_gate(tmp_path, new_sim, new_ioc, gate):
    """an operator of the control room may put while {gate} is 1, and never move the PLC; anybody else may not"""
    sim = new_sim("in = 48\nout = 48\nperiod = 50 ms\nsync = on\nrestarttime = 100 ms\n"
                  "db 10 40\ntx P#DB10.DBX0.0 BYTE 40 -> 4\nrx 4 -> P#DB10.DBX0.0 BYTE 40\n")
    record = block("access-security.md", "record(ao").replace("PUMP:", "$(P)").replace("/0 T=", "/4 T=").replace("R=32", "R=4")
    ioc = new_ioc(f's7plcConfigure PUMP, 127.0.0.1, {sim.port}, 48, 48, 1, 500, 100\ns7plcSetOption PUMP sync on\n'
                  f'asSetFilename "{tmp_path}/plant.acf"',
                  record + record.replace("Speed", "Other").replace("SETPOINT", "ELSEWHERE"), start=False,
                  templates=[(f, "P=$(P),PLC=PUMP") for f in ("s7plcStation.db", "s7plcSync.db", "s7plcStatus.template")])
    rules = block("access-security.md", "UAG(operators)").replace("PUMP:PLC:Alive", ioc.P + gate)
    rules = rules.replace("op1", getpass.getuser()).replace("console1", socket.gethostname())
    # the same rules, for consoles at which we do not sit
    elsewhere = rules[rules.index("ASG(SETPOINT)"):].replace("SETPOINT", "ELSEWHERE").replace("control", "nobody")
    (tmp_path / "plant.acf").write_text(rules.replace("ASG(DEFAULT)", "HAG(nobody) {console3}\nASG(DEFAULT)") + elsewhere)
    ioc.start()
    ioc.wait_value("Sync", 3)
    until(lambda: ioc.pv("Speed").write_access, "the right to put")
    ioc.put("Speed", 5)
    until(lambda: ioc.get("Speed") == 5 and ioc.severity("Speed") == "NO_ALARM", lambda: str(ioc.alarm("Speed")))
    assert not ioc.pv("AddressSet").write_access and not ioc.pv("Other").write_access
    away, back = ("unplug", "plug") if gate == "Alive" else ("local", "remote")
    sim.command(away)
    until(lambda: not ioc.pv("Speed").write_access, f"no right to put: {away}")
    assert ioc.pv("Speed").read_access
    sim.command(back)
    until(lambda: ioc.pv("Speed").write_access, f"the right to put: {back}")


def test_procserv(tmp_path, new_peer):
    """the line of the service starts an IOC, its console takes commands, and ends with procServ"""
    unit = block("procserv.md", "[Unit]").replace("\\\n", "")
    line = re.search(r"^ExecStart=(.*)$", unit, re.MULTILINE).group(1)
    line = line.replace("/run/ioc-pump", str(tmp_path)).replace(
        "/opt/ioc/pump/bin/linux-x86_64/pump", f"{TOP}/bin/{ARCH}/s7plcIoc")
    peer = new_peer(48, 48)
    (tmp_path / "st.cmd").write_text(
        f'dbLoadDatabase "{TOP}/dbd/s7plcIoc.dbd"\ns7plcIoc_registerRecordDeviceDriver pdbbase\n'
        f"s7plcConfigure PUMP, 127.0.0.1, {peer.port}, 48, 48, 1\niocInit\n")
    with open(tmp_path / "log", "w") as log:
        serv = subprocess.Popen(shlex.split(line), cwd=tmp_path, stdout=log, stdin=subprocess.DEVNULL)
    try:
        peer.wait_connected()
        with socket.socket(socket.AF_UNIX) as console:
            console.connect(str(tmp_path / "console"))
            console.sendall(b"s7plcReport PUMP\n")
            heard = b""
            while b"PUMP 127.0.0.1:" not in heard:
                more = console.recv(4096)
                assert more, heard
                heard += more
    finally:
        serv.terminate()
        serv.wait(LIMIT)
    until(lambda: peer.connection.ended, "the end of the connection")
    log = (tmp_path / "log").read_text()
    assert re.search(r"^sevr=\w+ s7plc PUMP: connected to 127.0.0.1", log, re.M), log


def test_alarm_tree():
    """the PVs of the alarm tree that are ours are records of the databases"""
    tree = block("alarm-server.md", "<config")
    known = lint.records({"P": "PUMP:PLC:"}) | {"PUMP:Pressure"}
    named = set(re.findall(r"PUMP:[\w:]+", tree))
    assert {"PUMP:PLC:State", "PUMP:PLC:Reason", "PUMP:PLC:Alive"} <= named <= known, named - known


def test_ibek(new_ioc):
    """the commands of the ibek support file are accepted, and its databases are there"""
    text = (HOWTO / "plclink.ibek.support.yaml").read_text()
    values = {"name": "PUMP", "address": "192.0.2.1", "port": "2000", "inSize": "48", "outSize": "16",
              "bigEndian": "1", "recvTimeout": "2000", "sendInterval": "100", "unit": "1",
              "inputs": "holding 0 100 every 500", "outputs": "", "slot": "0"}
    calls = re.findall(r"^ +(\w+(?:Configure|define_PLC) .*)$", text, re.MULTILINE)
    assert [call.split()[0] for call in calls] == ["s7plcConfigure", "phoenixplcConfigure",
                                                   "modbusplcConfigure", "drvEtherIP_define_PLC"]
    for call in calls:
        line = re.sub(r"{{(\w+)}}", lambda m: values[m[1]], call)
        ioc = new_ioc(line, "", program="phoenixIoc" if "phoenix" in line else "s7plcIoc")
        wrong = [e for e in errors_in(ioc.log) if "cannot connect" not in e and "ICMP echo" not in e]
        assert not wrong and "ERROR" not in ioc.log and "PUMP" in ioc.command("s7plcReport"), ioc.log
    for database in re.findall(r"\$\(S7PLC\)/(db/\S+)", text):
        assert (TOP / database).exists(), database
