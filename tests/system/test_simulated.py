"""SIMM: a simulated record has to do with SIOL only, not with the PLC; also an aai and an aao, of which Base leaves SIOL to
device support, and an output that follows the PLC."""
import pytest

from eipplant import rec
from waiting import until_equal

SIMM = "19"  # SIMM_ALARM, which pyepics has no word for
ARRAY = 'field(FTVL, "SHORT") field(NELM, "5")'


def simulated(name, sdly):
    return (f'field(SIML, "$(P)sim") field(SIOL, "$(P){name}T") field(SIMS, "MINOR") field(SDLY, "{sdly}") '
            'field(SSCN, ".1 second")')


def helpers(*arrays):
    return 'record(bo, "$(P)sim") {}\n' + "".join(
        f'record(waveform, "$(P){name}T") {{ {ARRAY} }}\n' for name in arrays)


def blocks(new_sim, new_ioc, sdly):
    """An IOC with blocks; what the PLC has."""
    sim = new_sim("name=PLC\nport=0\nin=20\nout=20\n")
    ioc = new_ioc(f's7plcConfigure("PLC", "127.0.0.1", {sim.port}, 20, 20, 1, 2000, 50)', f"""
record(aao, "$(P)ao") {{ field(DTYP, "S7plc") field(OUT, "@PLC/0") {ARRAY} {simulated("ao", sdly)} }}
record(aai, "$(P)ai") {{ field(DTYP, "S7plc") field(INP, "@PLC/0") {ARRAY} {simulated("ai", sdly)} }}
{helpers("ao", "ai")}""")
    return ioc, lambda: [int(sim.command(f"get out {2 * k} INT16").split()[-1]) for k in range(5)]


def etherip(plant, sdly):
    plant.tags("tag W INT[5] = 2", "tag I INT[5] = 2")
    fields = ["FTVL=SHORT", "NELM=5", "SIML=$(P)sim", "SIMS=MINOR", f"SDLY={sdly}", "SSCN=.1 second"]
    plant.records(rec("aao", "ao", "W S 0.05", *fields, "SIOL=$(P)aoT"),
                  rec("aai", "ai", "I S 0.05", *fields, "SIOL=$(P)aiT"), helpers("ao", "ai"))
    plant.ioc.wait_alarm("ao", "NO_ALARM")
    return plant.ioc, lambda: [int(word) for word in plant.tag("W").split()]


@pytest.mark.parametrize("wire", ["blocks", "EtherNet/IP"])
@pytest.mark.parametrize("sdly", [-1, 0.05])
def test_arrays(new_sim, new_ioc, plant, wire, sdly):
    """{wire}: a simulated aao writes to SIOL and not to the PLC, an aai shows SIOL and not the PLC (SDLY={sdly})"""
    ioc, held = blocks(new_sim, new_ioc, sdly) if wire == "blocks" else etherip(plant, sdly)
    before = held()
    ioc.put("ai.PROC", 1)
    real = ioc.plain("ai")
    ioc.put("sim", 1)
    ioc.put("aiT", [6, 7, 8])
    for value in ([1, 2, 3, 4, 5], [9, 8]):
        ioc.put("ao", value)
        until_equal(lambda: ioc.plain("aoT"), value)  # by SSCN, or at once
        assert ioc.plain("ao") == value
        until_equal(lambda: ioc.alarm("ao")[:2], ("MINOR", SIMM))
    assert ioc.text("ao.SCAN") == ".1 second"
    ioc.put("ai.PROC", 1)
    assert ioc.plain("ai") == [6, 7, 8]
    assert (ioc.get("ai.NORD"), ioc.alarm("ai")[:2], ioc.get("ai.UDF")) == (3, ("MINOR", SIMM), 0)
    ioc.put("aiT", [5])
    until_equal(lambda: ioc.plain("ai"), [5])  # by SSCN
    assert held() == before
    ioc.put("sim", 0)
    until_equal(lambda: ioc.plain("ai"), real)
    ioc.put("ao", [5, 4, 3, 2, 1])
    until_equal(held, [5, 4, 3, 2, 1])
    assert ioc.severity("ao") == "NO_ALARM"
    assert ioc.plain("aoT") == [9, 8]


def test_follows_later(plant):
    """A simulated output does not follow the PLC; it does when the simulation has ended"""
    plant.tags("tag A DINT = 5", "tag W INT[5] = 2", "tag F REAL = 2")
    siml = "SIML=$(P)sim"
    plant.records(rec("longout", "a", "A S 0.05", siml, "SIOL=$(P)aT"), rec("aao", "w", "W S 0.05", siml, "SIOL=$(P)wT", "FTVL=SHORT", "NELM=5"),
                  rec("ao", "f", "F S 0.05", siml, "SIOL=$(P)fT"), rec("longin", "i", "A S 0.05"),
                  'record(longout, "$(P)aT") {}\nrecord(ao, "$(P)fT") {}\n', helpers("w"))
    for record, value in (("a", 5), ("w", [2] * 5), ("f", 2), ("i", 5)):
        plant.ioc.wait_value(record, value)
    plant.ioc.put("sim", 1)
    for value in (6, 7):
        for tag in ("W", "F", "A"):
            plant.set(tag, value)
        plant.ioc.wait_value("i", value)
    plant.ioc.put("a", 70)
    plant.ioc.put("w", [1, 2])
    assert plant.ioc.get("a") == plant.ioc.get("aT") == 70
    assert plant.ioc.plain("w") == plant.ioc.plain("wT") == [1, 2]
    assert (plant.ioc.get("f"), plant.ioc.get("fT")) == (2, 0)
    plant.ioc.put("sim", 0)
    for record, value in (("a", 7), ("w", [7] * 5), ("f", 7)):
        plant.ioc.wait_value(record, value)
        assert plant.ioc.severity(record) == "NO_ALARM"
    assert (plant.ioc.get("aT"), plant.ioc.plain("wT"), plant.ioc.get("fT")) == (70, [1, 2], 0)
    assert (plant.tag("A"), plant.tag("W"), plant.tag("F")) == ("7", "7 7 7 7 7", "7")


def test_stays(plant):
    """What was put in simulation stays in VAL, and out of the PLC, until the PLC changes its value"""
    plant.tags("tag A DINT = 5")
    plant.records(rec("longout", "a", "A S 0.05", "SIML=$(P)sim", "SIOL=$(P)aT"), rec("longin", "i", "A S 0.05"),
                  'record(longout, "$(P)aT") {}\n', helpers())
    plant.ioc.wait_value("a", 5)
    plant.ioc.put("sim", 1)
    plant.ioc.put("a", 70)
    plant.ioc.put("sim", 0)
    plant.ioc.put("a.SIMM", 0)
    assert (plant.ioc.get("a"), plant.tag("A")) == (70, "5")
    plant.set("A", 6)
    plant.ioc.wait_value("a", 6)
    plant.ioc.wait_value("i", 6)
    assert plant.ioc.severity("a") == "NO_ALARM"
