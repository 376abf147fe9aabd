"""make demo-map: the map of a plant, and a row that is added to it."""
import os
import subprocess

from client import TOP


def test_demo():
    """make demo-map adds a row, shows the difference, and the new value lives"""
    env = {k: v for k, v in os.environ.items() if not k.startswith("EPICS_C")}
    run = subprocess.run([str(TOP / "iocBoot/iocMap/demo")], stdin=subprocess.DEVNULL, env=env,
                         capture_output=True, text=True, timeout=240)
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.endswith("demo ok\n"), run.stdout
    assert "+ Pump3 PUMP tx " in run.stdout and "loaded together" in run.stdout
    assert "cool:P3:Pressure  5.75 bar  MINOR" in run.stdout
