"""make demo, and the tutorial IOC of iocBoot/iocS7plc: each record and its read-back."""
import os
import subprocess

import pytest

from client import TOP
from demos import run_demo
from ioc import Ioc
from sim import Sim
from terminal import Terminal
from waiting import until

EXAMPLE = TOP / "iocBoot/iocS7plc"


def test_demo():
    """make demo without a terminal shows values that move, ends by itself and says demo ok"""
    shown = run_demo("iocS7plc", 120)
    assert "caput s7:Setpoint 37.25" in shown


def test_demo_in_a_laboratory():
    """make demo is deaf to what the environment says of other IOCs"""
    foreign = dict(EPICS_CAS_INTF_ADDR_LIST="192.0.2.1", EPICS_CAS_SERVER_PORT="7",
                   EPICS_CAS_IGNORE_ADDR_LIST="127.0.0.1", EPICS_CA_NAME_SERVERS="192.0.2.1",
                   EPICS_CA_ADDR_LIST="192.0.2.1", EPICS_PVAS_INTF_ADDR_LIST="192.0.2.1")
    run = subprocess.run([str(EXAMPLE / "demo")], stdin=subprocess.DEVNULL,
                         env={**os.environ, **foreign}, capture_output=True, text=True, timeout=120)
    assert run.returncode == 0 and run.stdout.endswith("demo ok\n"), run.stdout + run.stderr


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """st.cmd of the tutorial as it is, against plcSim with the file beside it."""
    tmp = tmp_path_factory.mktemp("example")
    sim = Sim(tmp, (EXAMPLE / "example.plc").read_text())
    ioc = Ioc.of_script(EXAMPLE / "st.cmd", "tutorial:",
                        {"PLC_PORT": str(sim.port), "P": "tutorial:"})
    ioc.start()
    ioc.wait_value("PLC1:Connected", 1)
    yield ioc
    ioc.close()
    sim.close()


INPUTS = ["Ramp", "Blocks", "Level", "Count16", "Position", "Count32", "Far",
          "Count64", "Temperature", "Wave", "Profile", "Channels", "Flags", "Pressure"]


@pytest.mark.parametrize("name", INPUTS)
def test_input_moves(example, name):
    """the tutorial's input {name} has no alarm from the PLC and moves"""
    first = example.plain(name)
    until(lambda: example.plain(name) != first, f"{name} moves from {first}")
    assert example.severity(name) in ("NO_ALARM", "MINOR")


OUTPUTS = {
    "Speed": -77, "Mode": 200, "Valve:Set": 50.0, "Lamps": 0xA5C3, "Pump:Start": 1, "Horn": 1,
    "Target": -123456789, "Mask": 4000000000, "Steps": -(2 ** 40), "Serial": 2 ** 50,
    "Setpoint": 33.5, "Gain": 0.0625, "Recipe": "bread", "Alarm:Time": [26, 11, 23, 12, 59, 0, 12, 34],
    "Curve": [1.5, -2.5, 3.25, 1e10], "Command": 2,
}


@pytest.mark.parametrize("name", OUTPUTS)
def test_output_comes_back(example, name):
    """a caput to the tutorial's output {name} comes back from the PLC in {name}:RBV"""
    value = OUTPUTS[name]
    (example.put_direct if name == "Lamps" else example.put)(name, value)
    example.wait_value(name + ":RBV", value)
    assert example.severity(name) == "NO_ALARM"


def test_long_string_comes_back(example):
    """a caput to the tutorial's long string comes back from the PLC"""
    text = "36 bytes are enough for this remark"
    example.put("Comment.VAL$", text)
    example.wait_value("Comment:RBV.VAL$", [ord(c) for c in text] + [0])


def test_hand_made_heartbeat(example):
    """the tutorial's calcout with SCAN "I/O Intr" counts in the PLC"""
    first = example.get("Alive:RBV")
    until(lambda: example.get("Alive:RBV") >= first + 3, "three heartbeats")


def test_no_error(example):
    """the tutorial starts without a line of error"""
    log = example.log.lower()
    for word in ("error", "warning", "sevr=major", "sevr=minor", "fail"):
        assert word not in log, example.log


def test_demo_in_a_terminal():
    """make demo in a terminal ends in the shell of its IOC, which exit leaves"""
    env = {k: v for k, v in os.environ.items() if not k.startswith("EPICS_C")}
    with Terminal([EXAMPLE / "demo"], env) as demo:
        demo.wait("Try here, in the IOC shell", 120)
        demo.type("echo still-$(P)-here\n")
        demo.wait("still-s7:-here")
        assert demo.program.poll() is None
        demo.type("exit\n")
        assert demo.status() == 0, demo.seen
