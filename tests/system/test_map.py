"""make demo-map: the map of a plant, and a row that is added to it."""
from demos import run_demo


def test_demo():
    """make demo-map adds a row, shows the difference, and the new value lives"""
    shown = run_demo("iocMap", 240)
    assert "+ Pump3 PUMP tx " in shown and "loaded together" in shown
    assert "cool:P3:Pressure  5.75 bar  MINOR" in shown
