"""DTYP "EtherIP": the way to a session, when a step of it is not answered: by a device that never does, and by a
controller that was only booting."""
import re

import pytest

from eipplant import rec
from waiting import until, until_equal

# the step that a booting controller does not answer, once; profile, slot; what the report says when all were answered
BOOTING = [("01", "omron", -1, "connected, 1994 bytes"), ("5b", "l8x", 0, "connected, 4002 bytes"),
           ("01", "l8x", 0, "connected, 4002 bytes")]


def report(plant):
    return plant.ioc.command("s7plcReport P 1")


def connects(plant):
    """Sessions, and attempts that ended before one."""
    return tuple(map(int, re.search(r"connects: (\d+) made, \d+ lost, (\d+) failed", report(plant)).groups()))


@pytest.mark.parametrize("service, profile, slot, way", BOOTING)
def test_booting(plant, service, profile, slot, way):
    """{profile}: a step {service} that was not answered once costs nothing for long: it is asked for again at once"""
    plant.tags("tag A DINT[20] = 3", profile=profile)
    plant.sim.command(f"etherip drop service {service} next 1")
    plant.records(rec("waveform", "w", "A S 0.05", "FTVL=LONG", "NELM=20"), slot=slot)
    until_equal(lambda: plant.ioc.plain("w"), [3] * 20)
    assert way in report(plant) and "serial number 00C0FFEE" in report(plant)
    assert connects(plant) == (1, 2)


def test_boots_later(plant):
    """A controller that is silent behind its module for two steps, months after it was good, is as before"""
    plant.tags("tag A DINT[20] = 3", profile="omron")
    plant.records(rec("waveform", "w", "A S 0.05", "FTVL=LONG", "NELM=20"), slot=-1,
                  configure='s7plcSetOption("P", "requestTimeout", "300")')
    plant.ioc.wait_alarm("w", "NO_ALARM")
    for boots in (1, 2):
        plant.sim.command("etherip silent unconnected")
        plant.sim.command("etherip close")
        plant.ioc.wait_alarm("w", "INVALID", "COMM", "no answer for 0.3 s")
        until(lambda: connects(plant)[1] >= 3 * boots, "attempts in vain")
        plant.sim.command("etherip normal")
        plant.ioc.wait_alarm("w", "NO_ALARM")
        assert "connected, 1994 bytes" in report(plant) and "vendor 47" in report(plant)


@pytest.mark.parametrize("fault", ["drop", "silent"])
def test_mute(plant, fault):
    """A device that never answers a step ({fault}) is asked for it ever less often: after 1, 2, 4 sessions"""
    plant.tags("tag D DINT = 7", profile="l8x")
    plant.sim.command(f"etherip {fault} service 5b")
    plant.records(rec("longin", "d", "D S 0.05"), configure='s7plcSetOption("P", "requestTimeout", "300")')
    plant.ioc.wait_value("d", 7)
    assert "connected, 504 bytes" in report(plant)
    assert connects(plant) == (1, 3)
    for made, failed in ((2, 3), (3, 4), (4, 4), (5, 4), (6, 5), (7, 5)):
        plant.sim.command("etherip close")
        until(lambda: connects(plant)[0] == made, f"session {made}")
        plant.ioc.wait_alarm("d", "NO_ALARM")
        assert connects(plant) == (made, failed)


def test_restart_asks_all(plant):
    """drvEtherIP_restart asks for what a device did not answer, and a device that has learned it is connected by it"""
    plant.tags("tag D DINT = 7", profile="l8x")
    plant.sim.command("etherip drop service 5b")
    plant.records(rec("longin", "d", "D S 0.05"))
    plant.ioc.wait_value("d", 7)
    assert "connected, 504 bytes" in report(plant)
    plant.sim.command("etherip normal")
    plant.ioc.command("drvEtherIP_restart")
    until(lambda: "connected, 4002 bytes" in report(plant), "the large connection")
    assert connects(plant) == (2, 3)
